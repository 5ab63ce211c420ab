"""Letters of symbols: how a parameter, a state or a multiplier is written, with unit and meaning."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

from mbdae.reports.vectors import Base, Record
from mbdae.symbolic.law import Law, Structure
from mbdae.symbolic.part import Parameter

GREEK = {"alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu", "xi", "pi",
         "rho",
         "sigma", "tau", "phi", "chi", "psi", "omega"}  # fmt: skip
#: letters of parameters that have words for names
WORDS = {
    "stiffness": "k", "damping": "c", "length": "L", "mass": "m", "rest": "c_0", "turns": r"\varphi_n", "torque": r"\tau",
    "force": "f", "normal_force": "f_n", "radius": r"\rho", "outer": r"\rho_k", "inner": r"\rho_l",
    "scaling": r"\sigma", "penalty": "p",
    "normal_stiffness": "k_h", "normal_damping": r"\lambda_h", "followed": r"\hat\varphi", "mass_per_length": r"\rho_A",
    "angle": r"\varphi", "displacement": "s", "load": "f",
    "mu": r"\mu_0", "phi": r"\varphi", "x": "x", "weight": "w", "ds": r"\mathrm{d}s",
}  # fmt: skip
#: letters of vectors that a law gives no name
VECTORS = tuple(f"\\mathbf{{{letter}}}" for letter in "abcegpq")


@dataclass(frozen=True)
class Letter:
    """How a symbol is written, its unit and what it is."""

    latex: str
    unit: str
    meaning: str

    @property
    def row(self) -> list[str]:
        """Its row in a table of symbols."""
        return [f"${self.latex}$", unit_text(self.unit), worded(self.meaning)]


#: what equations of laws have on their left-hand sides: beginning of the LaTeX, unit, meaning
RESULTS = (
    (r"c_", "", "rows: must vanish"), (r"\dot c_", "", "rates of the rows"),
    (r"\gamma_", "", "second rates of the rows without the accelerations of centres and the angular accelerations"),
    (r"\delta c_", "", "variations of the rows"), (r"b_{", "", "positive where right"), (r"\delta W", "J", "virtual work"),
    (r"\mathbf{f}", "N", "forces at the points: factors of virtual displacements; with all: with those of friction"),
    (r"\mathbf{m}", "N m", "moments about the points: factors of virtual rotations; likewise"),
    (r"\delta\mathbf{f}", "N", "their change"), (r"\delta\mathbf{m}", "N m", "their change"),
    (r"m^{\text{2D}}", "N m", "moments in the plane"), (r"c^{\text{2D}}", "", "rows in the plane"),
    (r"h_{", "N or N m", "terms in the equations of coordinates"), ("V", "J", "potential energy"),
    ("D", "W", "dissipation function"), ("P", "W", "power"), ("q", "m or rad", "length or angle along which a force works"),
    ("Q", "N or N m", "that force"), (r"\mathbf{F}", "N", "stated force on l"), (r"\mathbf{T}", "N m", "stated torque on l"),
    (r"\bar{\mathbf{F}}", "N", "force passed on to k"), (r"\bar{\mathbf{M}}_", "N m", "moment passed on to k"),
    (r"\bar r_", "N or N m", "equations of the coordinates"), (r"\bar{\mathbf{M}}", "", "mass passed on"),
    (r"\delta\bar{\mathbf{F}}", "N", "their change"), (r"\delta\bar{\mathbf{M}}", "N m", "their change"),
    (r"\delta \bar r_", "N or N m", "their change"),
)  # fmt: skip


def results(written: Iterable[str]) -> list[list[str]]:
    """Rows of a table of symbols for left-hand sides: those of a kind together."""
    found: dict[tuple[str, str], list[str]] = {}
    for latex in written:
        kind = max((r for r in RESULTS if latex.startswith(r[0])), key=lambda r: len(r[0]), default=None)
        if kind is not None:
            found.setdefault(kind[1:], []).append(f"${latex}$")
    return [[", ".join(symbols), unit_text(unit), meaning] for (unit, meaning), symbols in found.items()]


def worded(text: str) -> str:
    """Text of a law in which the vectors of frames, such as k.z, are symbols."""
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
                     for part in lower)  # fmt: skip
    return f"{first}_{{{below}}}"


def multiplier(row: str) -> str:
    """LaTeX of the multiplier of a row."""
    return f"\\lambda_{{\\text{{{row.replace('_', ' ')}}}}}"


def unit_text(unit: str) -> str:
    """A unit as text: exponents as mathematics, "1" as a dash."""
    if unit in ("1", ""):
        return "1" if unit else ""
    return re.sub(r"\^\(?([-0-9.]+)\)?", r"$^{\1}$", re.sub(r"\^([23])(?![0-9.])", lambda m: "²³"[int(m[1]) - 2], unit))


def letters(law: type[Law], shape: Structure, instance: Any) -> dict[str, Letter]:
    """Letters of the symbols a law may bring: parameters with their rates, states with their rates, coordinates."""
    found: dict[str, Letter] = {}
    specs = [(name, name, spec) for name, spec in instance.params.items()]
    specs += [(f"state_{name}", name, spec) for name, spec in instance.states.items()]
    specs = [(name, name, spec) for name, spec in specs_of_coordinates(instance).items()] + specs
    for symbol, name, spec in specs:
        state, latex = symbol != name, of_name(name, spec.unit)
        timed = name in shape.timed
        known = {letter.latex for letter in found.values()}
        if latex in known:
            latex = f"\\text{{{name.replace('_', ' ')}}}"
        meaning = spec.meaning + (", given over time" if timed else ", internal state" if state else "")
        found[symbol] = Letter(latex, spec.unit, meaning)
        for end, dots, per in (("_dot", r"\dot", "/s"), ("_ddot", r"\ddot", "/s^2")):
            if timed:
                found[name + end] = Letter(
                    f"{dots}{{{latex}}}", _per(spec.unit, per), f"its {'rate' if per == '/s' else 'second rate'}"
                )
    return found


def specs_of_coordinates(law: Any) -> dict[str, Parameter]:
    """Unit and meaning of the coordinates that a law speaks of: its own, or those of the joint it acts on."""
    stated = dict(getattr(law, "coordinates", None) or getattr(getattr(law, "joint", None), "coordinates", {}))
    return stated | {name: Parameter("rad or m", "coordinate of a joint") for name in law.own_coordinates if name not in stated}


def _per(unit: str, per: str) -> str:
    return f"1{per}" if unit in ("1", "") else f"{unit}{per}"


def name_vectors(record: Record, others: frozenset[str] = frozenset()) -> dict[int, str]:
    """Letters of the named vectors: the law's own, d from point to point, then a, b, c. others: letters that are taken."""
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


def name_scalars(record: Record, others: frozenset[str] = frozenset()) -> dict[str, str]:
    """Letters of the named scalars: the law's own, else eta with a number. others: letters that are taken."""
    found: dict[str, str] = {}
    start = max((int(letter[6:-1]) for letter in others if letter.startswith(r"\eta_")), default=0)
    for symbol in record.scalars:
        label = record.labels.get(symbol)
        found[str(symbol)] = _own(label, {*found.values(), *others}) if label else f"\\eta_{{{start + len(found) + 1}}}"
    return found


def _own(letter: str, taken: Collection[str]) -> str:
    """The letter, with a prime where it is taken."""
    while letter in taken:
        letter += "'"
    return letter
