"""The equations of motion of a scene in symbols, solved for the multipliers.

The rows are M u' + G^T lambda = f with the entries of G that the laws of this scene have; `solution` has their order.
"""

from __future__ import annotations

import re
from functools import cached_property
from itertools import count
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.reports.letters import of_name
from mbdae.reports.mechanisms.solution import Coefficients
from mbdae.reports.states import POINTS
from mbdae.reports.units import Unit, parameter_unit, unit, unit_of_row
from mbdae.reports.vectors import ZERO, NamedQuantities
from mbdae.reports.writer import Writer
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Frame, NodeKind
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target, reaction, scatter_pair
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.system.model.nodes import Instance
from mbdae.system.prepare import Prepared

LARGEST_SCENE = 60  #: largest number of multipliers for which a closed form is sought; with more the page says that there is none
SLIGHTLY = 1e-6  #: factor of the displacements of beams' nodes in random states: forces of their elements would drown all others
SHORT = 2  #: largest number of symbols in an entry of G that is written out instead of getting a letter


def symbols_of_rows(d: Derived) -> list[tuple[Target, Expr]]:
    """Every symbol in the gradients G of a law's rows and in the arms of its frames."""
    found = set().union(*(se.sympify(c).free_symbols for row in d.G for pair in row.values() for part in pair for c in part))
    found = found.union(*(se.sympify(c).free_symbols for f in d.frames if d.rows for c in (*arm_of(d, f), *arm_of_l(d, f))))
    return [(("symbol", str(s)), s) for s in sorted(found, key=str)]


def arm_of(d: Derived, f: Frame) -> Vec:
    """The arm of a frame; components that are known to be zero for this scene are replaced by 0."""
    return Vec(*map(d.variation.resolve, f.arm))


def arm_of_l(d: Derived, f: Frame) -> Vec:
    """From the centre of a frame to the point of a joint on l, about which its moment is stated."""
    return arm_of(d, f) if f.side == "l" or len(d.sides) < 2 else Vec(*map(d.variation.resolve, d.frames[1].r - f.center))


def own_forces(d: Derived) -> list[tuple[Target, Expr]]:
    """Force and moment on l of a law's own forces: springs, dampers and loads of a joint, where its reactions are 0."""
    return [] if isinstance(d.law, Element) or not d.force else reaction(d)


ROUNDED = 1e-13  #: part of the largest multiplier of a state below which a difference is round-off of their solution


class Velocity(NamedTuple):
    """A velocity of a body: subscript, letter of the position, letter of the inertia."""

    below: str
    letter: str
    mass: str
    unit: str  #: unit of the position whose rate this velocity is
    of: str  #: the position whose rate this velocity is, in words

    @property
    def balance(self) -> tuple[str, str]:
        """What this is one of up to three balances of: the forces on a body, or the moments."""
        return self.below.rpartition(",")[0], self.letter

    @property
    def effort(self) -> Unit:
        """Unit of the generalised force along this velocity."""
        return unit("J") / unit(self.unit)


class Said(NamedTuple):
    """Unit and meaning of a letter."""

    unit: str
    meaning: str


class SceneEquations:
    """Rows of a scene with letters for their coefficients, their solution, and values at states. Raises ValueError, with the
    reason, where a scene has no closed form."""

    def __init__(self, prepared: Prepared) -> None:
        self.prepared, self.m = prepared, prepared.mechanics
        self._refuse()
        self.latex: dict[str, str] = {}
        self.constants: dict[str, float] = {}  #: numbers of the scene that have a letter, by its symbol
        self.said: dict[str, Said] = {}  #: unit and meaning, by the LaTeX of a letter
        self.names = Names()
        self.writer = Writer(NamedQuantities(), self.latex)
        units = [unit_of_row(prepared.model, row, effort=True) for row in self.m.rows]
        self.unknowns = [self.letter(f"l{i}", rf"\lambda_{{{self.names.said('row', row.name)}}}", units[i],
                                     f"multiplier of the row {row.name}") for i, row in enumerate(self.m.rows)]
        self.entries: dict[str, tuple[int, int]] = {}  #: letter of an entry of G -> (row, place in u)
        self.places: dict[Any, str] = {}  #: (group, instance, symbol of the law) -> name of the letter
        self.rows = self._equations()
        self.on_l = self._forces_on_l()

    def _refuse(self) -> None:
        """Raise ValueError, with the reason, where no equations of the scene are printed."""
        if not self.m.m:
            joints = self.prepared.model.scene.joints
            raise ValueError("its joints have no constraint rows" if joints else "the scene has no joints")
        if self.m.m > LARGEST_SCENE:
            raise ValueError(f"it has more than {LARGEST_SCENE} multipliers")

    def _refuse_forces(self) -> None:
        """Raise ValueError, with the reason, where the rows do not give the multipliers."""
        if self.prepared.rank.dropped:
            raise ValueError("its reactions are not unique")
        if self.m.reactive:
            raise ValueError("friction follows from the reactions")

    def letter(self, name: str, latex: str, unit_: str, meaning: str) -> Expr:
        """A new symbol with its LaTeX, unit and meaning."""
        self.latex[name] = latex
        self.said[latex] = Said(unit_, meaning)
        return se.Symbol(name)

    # -- the equations

    @cached_property
    def velocities(self) -> dict[int, Velocity]:
        """Every velocity of the scene by its place in u."""
        found = {}
        for node in self.prepared.model.nodes:
            name = self.names.said("node", node.name if node.body is None else node.body.name)
            for i in range(node.kind.sizes[1]):
                turns = i >= node.kind.translations
                axis = "" if node.kind.sizes[1] == 1 or (turns and node.kind.flat) else "xyz"[i % 3]
                own = node.kind is NodeKind.COORDINATE
                letter = (r"\theta" if node.kind.flat else r"\psi") if turns else "q" if own else "c"
                unit_ = "rad" if turns else node.unit if own else "m"
                what = "coordinate" if own else "rotation" if turns else "position of the centre"
                along = f" {'about' if turns else 'along'} {axis}" if axis and not own else ""
                of, below = f"{what} {'' if own else 'of '}{node.name}{along}", f"{{{name}{',' if axis else ''}{axis}}}"
                found[node.u + i] = Velocity(below, letter, "J" if unit_ == "rad" else "m", unit_, of)
        return found

    def mass_letter(self, i: int, j: int) -> str:
        """The letter of an entry of the mass matrix."""
        v, name, other = self.velocities[i], self.velocities[i].below, self.velocities[j].below
        if name.partition(",")[0].strip("{}") != other.partition(",")[0].strip("{}"):
            return f"{v.mass}_{{{name[1:-1]};{other[1:-1]}}}"
        if i != j:
            return f"{v.mass}_{{{name[1:-1]}{self.velocities[j].below[-2]}}}"
        return f"{v.mass}_{name.rpartition(',')[0]}}}" if v.mass == "m" and "," in name else f"{v.mass}_{name}"

    @cached_property
    def mass(self) -> dict[int, dict[int, float]]:
        """Nonzero entries of the mass matrix, by row and column."""
        full = np.asarray(self.m.mass.todense() if hasattr(self.m.mass, "todense") else self.m.mass)
        return {i: {int(j): float(row[j]) for j in np.flatnonzero(row)} for i, row in enumerate(full)}

    def _equations(self) -> dict[int, Coefficients]:
        """The rows of the equations of motion, by their places in u: of beams those of nodes on which joints act."""
        rows: dict[int, Coefficients] = {at: {} for at in self.velocities}
        groups = self.prepared.model.groups
        for n, row in enumerate(self.m.rows):
            d, instance = groups[row.group].derived, groups[row.group].instances[row.instance]
            for f, node in zip(d.frames, instance.nodes, strict=True):
                first = node.u if node is not None else 0
                for (_, _, i), e in scatter_pair(f, d.G[row.row][f.side]) if node is not None else []:
                    rows[first + i][self.unknowns[n]] = self._entry(n, first + i, e)
        inside = {node.u + i for line in self.prepared.model.lines for node in line.nodes for i in range(node.kind.sizes[1])}
        return {at: row | {None: self.letter(f"p{at}", f"p^{v.letter}_{v.below}", v.effort.of_force,
                                             f"inertia less forces along: {v.of}")}
                for (at, v), row in zip(self.velocities.items(), rows.values(), strict=True) if row or at not in inside}

    def _entry(self, n: int, at: int, e: Expr) -> Expr:
        """An entry of G in letters of the scene; one letter for an entry of more than `SHORT` symbols."""
        row = self.m.rows[n]
        if len(se.sympify(e).free_symbols) <= SHORT:
            return self._renamed(row, self.prepared.model.groups[row.group].derived, e)
        self.entries[f"g{n}_{at}"] = (n, at)
        v = self.velocities[at]
        latex = f"g^{{{self.names.said('row', row.name)}}}_{{{v.below[1:-1]},{v.letter}}}"
        known = unit_of_row(self.prepared.model, row)
        meaning = f"derivative of the row {row.name} by the {v.of}"
        return self.letter(f"g{n}_{at}", latex, str(unit(known) / unit(v.unit)) if known else "", meaning)

    def _renamed(self, row: Any, d: Derived, e: Expr) -> Expr:
        """An entry of G with the law's symbols replaced by letters of the scene."""
        instance = self.prepared.model.groups[row.group].instances[row.instance]
        nodes, table = dict(zip([f.side for f in d.frames], instance.nodes, strict=True)), {}
        for s in sorted(se.sympify(e).free_symbols, key=str):
            key = (row.group, row.instance, str(s))
            if key not in self.places:
                side, _, what = str(s).partition("_")
                node = nodes.get(side)
                self.places[key] = self._named(instance, str(s), what, node, side in nodes)
            table[s] = se.Symbol(self.places[key])
        return se.sympify(e).subs(table)

    def _named(self, instance: Instance, symbol: str, what: str, node: Any, of_frame: bool) -> str:
        """The symbol of the letter for a symbol of a law: of a frame's axis, arm or place, a coordinate or a parameter."""
        name, item = f"c{len(self.places)}", instance.item
        if node is not None and node.kind is NodeKind.COORDINATE:
            self.letter(name, f"{{q}}_{{{self.names.said('node', node.name)}}}", node.unit, f"coordinate {node.name}")
        elif not of_frame:
            stated = parameter_unit(instance, symbol) if symbol in instance.law.params else ""
            self.letter(name, self.parameter_letter(instance, symbol), stated, f"{symbol} of {item}")
        elif node is not None and (what[0] == "r" or what == "theta"):
            at = node.u + (2 if what == "theta" else int(what[-1]) - 1)
            v = self.velocities[at]
            self.letter(name := f"x{at}", f"{v.letter}_{v.below}", v.unit, v.of)
        else:
            body, kind = node.body.name if node is not None and node.body is not None else "ground", what[:-1]
            axis = "xyz"[int(what[-1]) - 1]
            meaning, unit_ = {
                "s": (f"arm from the centre of {body} to {item}", "m"), "p": (f"place of {item} on {body}", "m"),
                **{f"b{a}": (f"axis {a} of {body}", "1") for a in "xyz"}}.get(kind, (f"axis {kind[-1]} of {item} on {body}", "1"))
            below = "" if kind[0] == "b" else f"{self.names.said('item', item)},"
            self.letter(name, f"{{{kind.removeprefix('b')}}}^{{{self.names.said('node', body)}}}_{{{below}{axis}}}", unit_,
                        f"{meaning}, component {axis}")
        return name

    def parameter_letter(self, instance: Instance, symbol: str) -> str:
        """The letter of a parameter of a law, by its symbol in the law."""
        return f"{{{of_name(symbol, 'rad')}}}_{{{self.names.said('item', instance.item)}}}"

    def unit_of(self, multiplier: Any) -> Unit:
        """Unit of a multiplier of the rows."""
        return unit(self.said[self.latex[str(multiplier)]].unit or "1")

    def sizes(self) -> dict[str, float]:
        """Sizes that lengths and their products have in a scene of this length, and pure numbers, by the LaTeX of the letter."""
        powers = {latex: unit(said.unit or "1").powers for latex, said in self.said.items()}
        return {latex: self.prepared.length ** p[0] for latex, p in powers.items() if not any(p[1:])}

    # -- forces by the multipliers

    def _forces_on_l(self) -> dict[tuple[str, str, int], Expr]:
        """Components of the joint forces ("F") on the bodies l and of their moments ("T") about the joint's
        point on l, by item and axis."""
        found: dict[tuple[str, str, int], Expr] = {}
        groups = self.prepared.model.groups
        for n, row in enumerate(self.m.rows):
            d, instance = groups[row.group].derived, groups[row.group].instances[row.instance]
            nodes = dict(zip([f.side for f in d.frames], instance.nodes, strict=True))
            side, sign = ("l", -1) if nodes.get("l") is not None else ("k", 1)
            if nodes.get(side) is None:
                continue
            force, moment = d.G[row.row][side]
            arm = arm_of_l(d, next(f for f in d.frames if f.side == side))
            for letter, part in (("F", force), ("T", moment - arm.cross(force))):
                for i, e in enumerate(part):
                    if (entry := se.expand(e)) != 0:
                        old = found.get((letter, instance.item, i), ZERO)
                        found[letter, instance.item, i] = old + sign * self._renamed(row, d, entry) * self.unknowns[n]
        for item in dict.fromkeys(groups[row.group].instances[row.instance].item for row in self.m.rows):
            own = [group.derived for group in groups if any(one.item == item for one in group.instances)]
            for i in sorted({target[1] for d in own for target, e in own_forces(d) if e != 0}):
                letter, axis = "FT"[i // 3], "xyz"[i % 3]
                latex = f"{letter}^{{\\text{{own}}}}_{{{self.names.said('item', item)},{axis}}}"
                kind = "force" if i < 3 else "moment"
                meaning = f"{kind} of the springs, dampers and loads of {item} on its body l, component {axis}"
                place = letter, item, i % 3
                found[place] = found.get(place, ZERO) + self.letter(f"own{item}{i}", latex, "N" if i < 3 else "N m", meaning)
        return dict(sorted(found.items(), key=lambda entry: entry[0][0]))

    # -- values at states

    def values(self, t: Any, q: Any, u: Any, s: Any = None, z: Any = None) -> tuple[dict[str, Any], Any]:
        """Values of all letters by their LaTeX, and the multipliers (nt, m), at states of the scene. z: stresses of its beams,
        by default those that follow from the strains."""
        change, multipliers = self.m.accelerations(t, q, u, s, z)
        load, known = self.m.load(t, q, u, s, z), dict[str, Any]()
        for at in dict.fromkeys(j for i in self.rows for j in (i, *self.mass[i])):
            v = self.velocities[at]
            acceleration = f"\\ddot{{{v.letter}}}_{v.below}"
            known[acceleration] = change[:, at]
            self.said[acceleration] = Said(f"{v.unit}/s^2", f"second rate: {v.of}")
        for at in self.rows:
            v, force = self.velocities[at], f"f^{self.velocities[at].letter}_{self.velocities[at].below}"
            known[force] = load[:, at]
            known |= {self.mass_letter(at, j): np.full(len(t), m) for j, m in self.mass[at].items()}
            self.said[force] = Said(v.effort.of_force, f"all forces but reactions along: {v.of}")
            for j in self.mass[at]:
                meaning = "inertia: " + " and ".join(dict.fromkeys((v.of, self.velocities[j].of)))
                self.said.setdefault(self.mass_letter(at, j), Said("kg m^2" if v.mass == "J" else "kg", meaning))
        G = self.m.constraint_jacobian(t, q)
        known |= {self.latex[name]: G[:, n, at] for name, (n, at) in self.entries.items()}
        for g, p, found in self.m.evaluate(symbols_of_rows, t, q, u, s):
            for (group, instance, symbol), name in self.places.items():
                if group == g and ("symbol", symbol) in p.targets:
                    known[self.latex[name]] = found[:, instance, p.targets.index(("symbol", symbol))]
        for g, p, found in self.m.evaluate(own_forces, t, q, u, s):
            for instance, values in zip(self.prepared.model.groups[g].instances, found.swapaxes(0, 1), strict=True):
                for (_, i), v in zip(p.targets, values.T, strict=True):
                    if latex := self.latex.get(f"own{instance.item}{i}"):
                        known[latex] = known.get(latex, 0.0) + v
        return known, multipliers

    def states(self) -> tuple[Any, Any, Any, Any]:
        """Random states around the start; loops may be open, as the balances hold there too, recursive joints are satisfied."""
        start, rng = self.prepared.start, np.random.default_rng(8)
        size = np.full(len(start.q), 1e-3 * self.prepared.length)
        for node in (node for line in self.prepared.model.lines for node in line.nodes):
            size[node.q : node.q + node.kind.sizes[0]] *= SLIGHTLY
        q = start.q + size * rng.normal(size=(POINTS, len(start.q)))
        t, u = np.full(POINTS, start.t), rng.normal(size=(POINTS, len(start.u)))
        return t, *self.m.admissible(t, q, u), np.tile(start.s, (POINTS, 1))


class Names:
    """Names of items as text in formulas, distinct within each role."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str], str] = {}
        self.renamed: dict[str, str] = {}  #: names printed with an appended number because another would print alike

    def said(self, role: str, name: str) -> str:
        """A name as text in a formula, with a number appended where another of the role prints alike."""
        if (role, name) not in self._known:
            plain = re.sub(r"[^\w.-]|_", " ", name).strip() or "name"
            taken = {words for (r, _), words in self._known.items() if r == role}
            words = plain if plain not in taken else next(w for i in count(2) if (w := f"{plain} ({i})") not in taken)
            self._known[role, name] = words
            self.renamed |= {name: words} if words != plain else {}
        return f"\\text{{{self._known[role, name]}}}"
