"""Letters of symbols: how a parameter, a state or a multiplier is written, with unit and meaning."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

from mbdae.documents.blocks import Block, Equation, Paragraph, Section
from mbdae.reports.reading import Symbols, key_of
from mbdae.reports.vectors import Base, NamedQuantities
from mbdae.symbolic.law import Law, Structure
from mbdae.symbolic.part import Parameter

GREEK = {"alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu", "xi", "pi",
         "rho", "sigma", "tau", "phi", "chi", "psi", "omega"}
#: letters of parameters whose names are words
WORDS = {
    "stiffness": "k", "damping": "c", "length": "L", "mass": "m", "rest": "c_0", "turns": r"\varphi_n", "torque": r"\tau",
    "force": "f", "normal_force": "f_n", "radius": r"\rho", "outer": r"\rho_k", "inner": r"\rho_l", "scaling": r"\sigma",
    "penalty": "p", "normal_stiffness": "k_h", "normal_damping": r"\lambda_h", "followed": r"\hat\varphi",
    "mass_per_length": r"\rho_A", "angle": r"\varphi", "displacement": "s", "load": "f",
    "mu": r"\mu_0", "phi": r"\varphi", "x": "x", "weight": "w", "ds": r"\mathrm{d}s",
}
INERTIA = "kg, kg m, kg m^2"  #: units of the blocks of a mass matrix
#: letters, in this order, of vectors that a law does not name
VECTORS = tuple(f"\\mathbf{{{letter}}}" for letter in "abcegpq")


@dataclass(frozen=True)
class Letter:
    """The LaTeX of a symbol, its unit and its meaning."""

    latex: str
    unit: str
    meaning: str

    @property
    def row(self) -> list[str]:
        """The row of the letter in a table of symbols; what an absent parameter does is no part of equations that have it."""
        return [f"${self.latex}$", unit_text(self.unit), worded(re.sub(r"; None: [^;]*", "", self.meaning))]


#: left-hand sides of printed equations: beginning of the LaTeX, unit (empty: the page knows it), meaning
RESULTS = (
    (r"c_", "", "rows: must vanish"), (r"\dot c_", "", "rates of the rows"),
    (r"\gamma_", "", "second rates of the rows without the accelerations of centres and the angular accelerations"),
    (r"\delta c_", "", "variations of the rows"), (r"b_{", "", "positive on the wanted branch"),
    (r"\delta W", "J", "virtual work"),
    (r"\mathbf{f}", "N", "forces at the points: factors of virtual displacements; with all: with those of friction"),
    (r"\mathbf{m}", "N m", "moments about the points: factors of virtual rotations; with all: with those of friction"),
    (r"\delta\mathbf{f}", "N", "changes of the forces"), (r"\delta\mathbf{m}", "N m", "changes of the moments"),
    (r"m^{\text{2D}}", "N m", "moments in the plane"), (r"c^{\text{2D}}", "", "rows in the plane"),
    (r"\dot c^{\text{2D}}", "", "rows of velocities in the plane"),
    (r"\frac{\partial \mathbf{f}", "", "derivatives of forces by a parameter"),
    (r"\frac{\partial \mathbf{m}", "", "derivatives of moments by a parameter"),
    (r"\frac{\partial \mu}", "", "derivatives of the friction coefficient by a parameter"),
    (r"\frac{\partial f_n", "", "derivatives of the normal force by a parameter"),
    (r"\frac{\partial h_{", "", "derivatives of terms in the equations of coordinates by a parameter"),
    (r"h_{", "", "terms in the equations of coordinates"), ("V", "J", "potential energy"),
    ("D", "W", "dissipation function"), ("P", "W", "power"), ("q", "", "length or angle along which a force works"),
    ("Q", "", "generalised force along $q$"), (r"\mathbf{F}", "N", "stated force on l"),
    (r"\mathbf{T}", "N m", "stated torque on l"), (r"\bar{\mathbf{F}}", "N", "force passed on to k"),
    (r"\bar{\mathbf{M}}_", "N m", "moment passed on to k"), (r"\bar r_", "", "equations of the coordinates"),
    (r"\bar{\mathbf{M}}", INERTIA, "mass passed on"),
    (r"\delta\bar{\mathbf{F}}", "N", "change of the force passed on"),
    (r"\delta\bar{\mathbf{M}}", "N m", "change of the moment passed on"),
    (r"\delta \bar r_", "", "changes of the equations of the coordinates"),
)


def results(units: Mapping[str, str]) -> list[list[str]]:
    """Rows of a table of symbols for left-hand sides, equal kinds merged. units: those the page knows, by LaTeX."""
    found: dict[tuple[str, str], list[str]] = {}
    for latex, known in units.items():
        kind = max((r for r in RESULTS if latex.startswith(r[0])), key=lambda r: len(r[0]), default=None)
        if kind is not None:
            found.setdefault((known or kind[1], kind[2]), []).append(f"${latex}$")
    return [[", ".join(symbols), unit_text(unit), meaning] for (unit, meaning), symbols in found.items()]


def effort_unit(unit: str) -> str:
    """Unit of the generalised force on a coordinate with the given unit."""
    return "N" if unit == "m" else "N m" if unit in ("rad", "rotation") else "N or N m"


def unit_on(unit: str, coordinates: Collection[str]) -> str:
    """The alternative of a unit such as "N m/rad or N/m" that fits the units of all coordinates on which a law acts."""
    angle = min(unit.split(" or "), key=lambda part: ("rad" not in part, "N m" not in part))
    if len({*coordinates}) != 1 or " or " not in unit or not {*coordinates} <= {"rad", "m"}:
        return unit
    return next(part for part in unit.split(" or ") if (part == angle) == ("rad" in coordinates))


def worded(text: str) -> str:
    """Text of a law with the vectors of frames, such as k.z, written as symbols."""
    vectors = {"w": r"\boldsymbol{\omega}"} | {a: rf"\mathbf{{{a}}}" for a in "rvxyz"}
    return re.sub(r"\b([klm])\.([rvwxyz])\b", lambda m: f"${vectors[m[2]]}_{m[1]}$", text)


def of_name(name: str, unit: str = "") -> str:
    """LaTeX of a parameter or state by its name."""
    if name == "drive":
        return r"\varphi_d" if unit == "rad" else "s_d"
    if name.startswith("drive_"):
        letter, _, below = of_name(name.removeprefix("drive_"), unit).partition("_")
        return f"{letter}_{{d{',' if below else ''}{below.strip('{}')}}}"
    if name in WORDS:
        return WORDS[name]
    for option in ("friction_", "normal_"):
        if name.startswith(option):
            return of_name(name.removeprefix(option), unit)
    base, *lower = name.split("_")
    match = re.fullmatch(r"([A-Za-z]+?)(\d+)", base)
    if match:
        base, lower = match[1], [match[2], *lower]
    elif re.fullmatch(r"[A-Za-z][xyz]{1,2}", base):
        base, lower = base[0], [base[1:], *lower]
    if base in WORDS and base not in GREEK and lower and "_" not in WORDS[base]:
        base = WORDS[base]
    whole = len(base) == 1 or base.startswith("\\")
    first = f"\\{base}" if base.lower() in GREEK else base if whole else f"\\text{{{base}}}"
    if not lower:
        return first
    below = ",".join(f"\\{part}" if part in GREEK else part if len(part) == 1 or part.isdigit() else f"\\text{{{part}}}"
                     for part in lower)
    return f"{first}_{{{below}}}"


def multiplier(row: str) -> str:
    """LaTeX of the multiplier of a row."""
    return f"\\lambda_{{\\text{{{row.replace('_', ' ')}}}}}"


def unit_text(unit: str) -> str:
    """A unit as text with exponents in LaTeX; "1" as it is."""
    if unit in ("1", ""):
        return "1" if unit else ""
    return re.sub(r"\^\(?([-0-9.]+)\)?", r"$^{\1}$", re.sub(r"\^([23])(?![0-9.])", lambda m: "²³"[int(m[1]) - 2], unit))


#: letters that pages use for their own quantities, and names of functions
RESERVED = {"V", "D", "P", "Q", "m", r"\pi", r"\delta", r"\gamma", r"\omega", r"\theta", "sin", "cos", "tan", "sinh", "cosh",
            "tanh", "exp", "ln", "log", "sgn", "max", "min", "sqrt"}


def read_alike(latex: str) -> str:
    """LaTeX without what is invisible in print: braces and the command for upright text."""
    return re.sub(r"\\text|[{} ]", "", latex)


def apart(name: str, latex: str, rows: Collection[str]) -> str:
    """The letter of a parameter, with index p where the page prints another quantity alike. rows: names of the law's rows."""
    heads = [latex for latex, _, _ in RESULTS if latex.endswith("_") and not latex.startswith(r"\mathbf")]
    own = {read_alike(f"{head}{row.replace('_', ' ')}") for head in (*heads, "b_", "h_", "q_", "Q_") for row in rows}
    own |= RESERVED | {f"\\{letter}_{side}" for letter in ("omega", "theta") for side in "klm"}
    if name in WORDS or read_alike(latex) not in own:
        return latex
    head, _, below = latex.partition("_")
    return f"{head}_{{{below.removeprefix('{').removesuffix('}')}{',' if below else ''}\\text{{p}}}}"


def letters(law: type[Law], shape: Structure, instance: Any, rows: Collection[str] = ()) -> dict[str, Letter]:
    """Letters of the symbols of a law: parameters, states and coordinates, with rates. rows: names of its rows."""
    found: dict[str, Letter] = {}
    coordinates = specs_of_coordinates(instance)
    acts_on = [coordinates[name].unit for name in instance.own_coordinates] or [getattr(instance, "unit", "")]
    specs = [(name, name, spec) for name, spec in (coordinates | dict(instance.params)).items()]
    specs += [(f"state_{name}", name, spec) for name, spec in instance.states.items()]
    for symbol, name, spec in specs:
        timed, unit = name in shape.timed, unit_on(spec.unit, acts_on)
        latex = of_name(name, unit)
        if latex in {letter.latex for letter in found.values()}:
            latex = f"\\text{{{name.replace('_', ' ')}}}"
        latex = apart(name, latex, rows) if symbol in instance.params else latex
        further = ", given over time" if timed else ", internal state" if symbol != name else ""
        found[symbol] = Letter(latex, unit, spec.meaning + further)
        if timed:
            found[name + "_dot"], found[name + "_ddot"] = rate_of(found[symbol]), second_rate_of(found[symbol])
    return found


def rate_of(letter: Letter) -> Letter:
    """The letter of the rate of a quantity."""
    return Letter(f"\\dot{{{letter.latex}}}", f"{letter.unit or 1}/s", f"rate of ${letter.latex}$")


def second_rate_of(letter: Letter) -> Letter:
    """The letter of the second rate of a quantity."""
    return Letter(f"\\ddot{{{letter.latex}}}", f"{letter.unit or 1}/s^2", f"second rate of ${letter.latex}$")


def specs_of_coordinates(law: Any) -> dict[str, Parameter]:
    """Unit and meaning of the coordinates in a law: its own, or those of the joint on which it acts."""
    stated = dict(getattr(law, "coordinates", None) or getattr(getattr(law, "joint", None), "coordinates", {}))
    return stated | {name: Parameter("rad or m", "coordinate of a joint") for name in law.own_coordinates if name not in stated}


def name_vectors(record: NamedQuantities, others: frozenset[str] = frozenset()) -> dict[int, str]:
    """Letters of named vectors: given by the law, d between the points, else a, b, c. others: letters already used."""
    found: dict[int, str] = {}
    own = {key: label if label.startswith("\\") else f"\\mathbf{{{label}}}" for key, label in record.labels.items()}
    taken = {letter for key, letter in own.items() if isinstance(key, int)}
    letters = [letter for letter in VECTORS if letter not in taken | others]
    difference = {Base("r", record.sides[1]): 1, Base("r", record.sides[0]): -1} if len(record.sides) > 1 else None
    scalars = name_scalars(record, others)
    for number, value in record.vectors.items():
        if number in record.changes:
            sign, of = record.changes[number]
            found[number] = (
                f"\\ddot{found[of].removeprefix(sign)}" if sign == r"\dot" == found[of][:4] else f"{sign}{{{found[of]}}}"
            )
        elif number in record.gradients:
            kind, symbol, side = record.gradients[number]
            found[number] = f"\\nabla_{{{kind},{side}}}\\,{scalars[str(symbol)]}"
        elif number in record.labels:
            found[number] = _own(own[number], {*found.values(), *others})
        elif value.terms == difference:
            found[number] = _own(r"\mathbf{d}", others)
        else:
            found[number] = letters.pop(0) if letters else f"\\mathbf{{a}}_{{{number}}}"
    return found


def name_scalars(record: NamedQuantities, others: frozenset[str] = frozenset()) -> dict[str, str]:
    """Letters of named scalars: given by the law, with as many primes as what they follow from, else eta with a number. others:
    letters already used."""
    found: dict[str, str] = {}
    numbers = count(1 + max((int(letter[6:-1]) for letter in others if letter.startswith(r"\eta_")), default=0))
    for symbol, value in record.scalars.items():
        label = record.labels.get(symbol)
        if symbol in record.changes:
            sign, of = record.changes[symbol]
            found[str(symbol)] = f"{sign}{{{found[str(of)]}}}"
        else:
            primes = max((found.get(str(of), "").count("'") for of in value.free_symbols), default=0) * "'" if label else ""
            found[str(symbol)] = _own(label + primes, {*found.values(), *others}) if label else f"\\eta_{{{next(numbers)}}}"
    return found


def _own(letter: str, taken: Collection[str]) -> str:
    """The letter, with as many primes as needed to differ from those taken."""
    while letter in taken:
        letter += "'"
    return letter


# -- symbols where they appear


def introduced(blocks: Sequence[Block], rows: Sequence[Sequence[str]], told: set[str] | None = None) -> list[Block]:
    """The blocks with a sentence after the equations in which a symbol stands for the first time: its unit and meaning.

    rows: those of a table of symbols; told: symbols that earlier blocks have introduced, to which these are added."""
    told = set() if told is None else told
    known = {latex: (unit, meaning) for cell, unit, meaning in rows for latex in re.findall(r"\$([^$]*)\$", cell)
             for latex in latex.split(r",\ ")}
    symbols, out, new = Symbols(known), list[Block](), dict[str, None]()
    for block, after in zip(blocks, [*blocks[1:], None], strict=False):
        if isinstance(block, Section):
            block = Section(block.title, introduced(block.blocks, rows, told), block.level)
        out.append(block)
        if isinstance(block, Equation):
            new |= dict.fromkeys(latex for latex in _symbols(symbols, known, block.latex) if latex not in told)
        if new and not isinstance(after, Equation) and after != Paragraph("with"):
            told |= {*new}
            out.append(Paragraph(f"Here {_meanings({latex: known[latex] for latex in new})}."))
            new = {}
    return out


def _symbols(symbols: Symbols, known: Mapping[str, Any], latex: str) -> list[str]:
    """The symbols of a formula, in their order."""
    line, i, found, names = key_of(latex), 0, list[str](), {key_of(name): name for name in known}
    while i < len(line):
        key = symbols.at(line, i)
        i += len(key) if key else 1
        if key and line[i : i + 1] not in (("_",), ("'",)):
            found.append(names[key])
    return found


def _meanings(new: Mapping[str, tuple[str, str]]) -> str:
    """Symbols with their meanings, those of the same kind on several bodies or rows together."""
    found: dict[tuple[str, str], list[str]] = {}
    for latex, (unit, meaning) in new.items():
        found.setdefault((unit, meaning), []).append(latex)
    kinds: dict[tuple[str, str], list[tuple[str, list[str]]]] = {}
    for (unit, meaning), letters_ in found.items():
        kind = re.sub(r"\bbody \$[a-z]\$", "its body", re.sub(r"of row \S+$", "of its row", meaning))
        kinds.setdefault((unit, kind), []).append((meaning, letters_))
    said = []
    for (unit, kind), parts in kinds.items():
        shown = ", ".join(f"${latex}$" for _, each in parts for latex in each)
        said.append(f"{shown}{f' ({unit})' if unit != '1' else ''}: {kind if len(parts) > 1 else parts[0][0]}")
    return "; ".join(said)


# -- letters of elements of lines: index i for their nodes, none for their integration points

_ALONG, _OF = "derivative by the length", "change of ${}$"
#: of an element of a law on a line
SCALARS_OF_ELEMENTS = {
    "L": Letter("L_i", "1", "shape function of node i: 1 there, 0 at all others"), "Ls": Letter("L_i'", "1/m", _ALONG),
    "weight": Letter("w", "m", "weight of the integration point: that of Gauss times the length per unit of the element"),
    "p0i": Letter("e_{0i}", "1", "scalar part of the quaternion of node i"), "p0": Letter("e_0", "1", "value at the point"),
    "p0s": Letter("e_0'", "1/m", _ALONG), "nu": Letter(r"\nu", "1", "square of the quaternion's length"),
    "u0": Letter("u_0", "1", "scalar part of the inverse quaternion"), "k0": Letter("k_0", "1/m", "stretch of the quaternion"),
    "a0": Letter(r"\alpha_i", "1", "scalar part of the quaternion that turns the section to node i"),
    "b0": Letter(r"\beta_i", "1", "part of the rotation of node i that the section takes as it is"),
    "b0s": Letter(r"\beta_i'", "1/m", _ALONG), "s0": Letter(r"\Lambda_0", "1", "relative change of the quaternion's length"),
    "s0s": Letter(r"\Lambda_0'", "1/m", _ALONG), "db0": Letter(r"\Delta\beta_i", "1", _OF.format(r"\beta_i")),
    "db0s": Letter(r"\Delta\beta_i'", "1/m", _OF.format(r"\beta_i'")),
}
VECTORS_OF_ELEMENTS = {
    Base("r", "i"): (r"\mathbf{r}_i", "m", "position of node i"),
    Base("p", "i"): (r"\mathbf{e}_i", "1", "vector part of the quaternion of node i"),
    Base("p", "b"): (r"\mathbf{e}", "1", "value at the point"), Base("ps", "b"): (r"\mathbf{e}'", "1/m", _ALONG),
    Base("u", "b"): (r"\mathbf{u}", "1", "vector part of the inverse quaternion"),
    Base("k", "b"): (r"\mathbf{k}", "1/m", "half the curvature, inertial"),
    Base("a", "i"): (r"\mathbf{a}_i", "1", "vector part of the quaternion that turns the section to node i"),
    Base("b", "i"): (r"\mathbf{b}_i", "1", "part of the rotation of node i that the section takes crosswise"),
    Base("bs", "i"): (r"\mathbf{b}_i'", "1/m", _ALONG),
    Base("dr", "i"): (r"\delta\mathbf{r}_i", "m", "virtual displacement of node i"),
    Base("dpsi", "i"): (r"\delta\boldsymbol{\psi}_i", "rad", "virtual rotation of node i"),
    Base("Dr", "i"): (r"\Delta\mathbf{r}_i", "m", "displacement of node i"),
    Base("Dpsi", "i"): (r"\Delta\boldsymbol{\psi}_i", "rad", "rotation of node i"),
    Base("Drs", "b"): (r"\Delta\mathbf{r}'", "1", _OF.format(r"\mathbf{r}'")),
    Base("Dpsi", "b"): (r"\Delta\boldsymbol{\psi}", "rad", "rotation of the section"),
    Base("Dpsis", "b"): (r"\Delta\boldsymbol{\psi}'", "rad/m", _ALONG),
    Base("Db", "i"): (r"\Delta\mathbf{b}_i", "1", _OF.format(r"\mathbf{b}_i")),
    Base("Dbs", "i"): (r"\Delta\mathbf{b}_i'", "1/m", _OF.format(r"\mathbf{b}_i'")),
    Base("dv", "i"): (r"\dot{\mathbf{v}}_i", "m/s^2", "acceleration of node i"),
    Base("dv", "b"): (r"\dot{\mathbf{v}}", "m/s^2", "acceleration of the axis"),
    Base("W", "i"): (r"\boldsymbol{\Omega}_i", "rad/s", "angular velocity of the section at node i, in its own axes"),
    Base("W", "b"): (r"\boldsymbol{\Omega}", "rad/s", "angular velocity of the section, in its own axes"),
    Base("dW", "i"): (r"\dot{\boldsymbol{\Omega}}_i", "rad/s^2", "rate of $\\boldsymbol{\\Omega}_i$"),
    Base("dW", "b"): (r"\dot{\boldsymbol{\Omega}}", "rad/s^2", "rate of $\\boldsymbol{\\Omega}$"),
    Base("H", "i"): (r"\mathbf{H}_i", "N m s", "angular momentum of node i, in its own axes"),
}
for _x, _unit, _by in (("n", "N", r"\delta\mathbf{r}'"), ("q", "N", r"\delta\boldsymbol{\psi}"),
                       ("m", "N m", r"\delta\boldsymbol{\psi}'")):
    VECTORS_OF_ELEMENTS[Base(_x, "b")] = rf"\mathbf{{{_x}}}", _unit, f"factor of ${_by}$ in the virtual work per length"
    VECTORS_OF_ELEMENTS[Base(f"D{_x}", "b")] = rf"\Delta\mathbf{{{_x}}}", _unit, _OF.format(rf"\mathbf{{{_x}}}")
