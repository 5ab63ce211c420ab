"""Joints and couplings of a planar mechanism, and the bodies that follow from one coordinate by them one after the other.

A joint enters by the motion that it states: it turns its bodies, or slides one along an axis of the other. A coupling enters by
its rows. Every coordinate gets a formula by those before it; its rates are the derivatives of the formula."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.documents.blocks import escaped
from mbdae.notation import counted
from mbdae.reports.mechanisms.solution import determinant
from mbdae.reports.scene_forces import ClosedForms
from mbdae.reports.states import value
from mbdae.reports.units import parameter_unit
from mbdae.reports.vectors import ZERO
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.motion import symbolic_motion
from mbdae.symbolic.outputs import lowest
from mbdae.symbolic.vectors import Expr
from mbdae.system.model.nodes import Instance, Node
from mbdae.system.prepare import Prepared

Pair = tuple[Expr, Expr]  #: a vector of the plane


class Place(NamedTuple):
    """Where a body is: its centre and its angle."""

    x: Expr
    y: Expr
    angle: Expr

    def turned(self, a: Pair) -> Pair:
        """A vector of the body in inertial components."""
        c, s = se.cos(self.angle), se.sin(self.angle)
        return a[0] * c - a[1] * s, a[0] * s + a[1] * c

    def point(self, a: Pair) -> Pair:
        """The place of a point of the body."""
        x, y = self.turned(a)
        return self.x + x, self.y + y


class Link(NamedTuple):
    """A joint between two bodies, None for the ground: it turns them by an angle, or slides one along an axis of k.
    turn: 1 or -1, 0 where it slides; axis: in axes of k; rest: angle of l less that of k as drawn."""

    item: str
    k: Node | None
    l: Node | None
    points: tuple[Pair, Pair]  #: of k and l, in body axes
    turn: int
    axis: Pair
    rest: Expr
    coordinate: str


class Links(ClosedForms):
    """Links of a mechanism of the plane with one input, and the bodies that follow from it by joints and couplings. Raises
    ValueError, with the reason, where there is no such input."""

    MOVES = True
    KINDS: tuple[NodeKind, ...] = (NodeKind.PLANAR,)  #: of the bodies
    GROUND: Any = Place(ZERO, ZERO, ZERO)

    def __init__(self, prepared: Prepared) -> None:
        self.formulas: list[tuple[str, Expr]] = []  #: symbols with their formulas, in the order in which they follow
        self.sayings: dict[int, str] = {}  #: sentences before a formula, by its number
        self.apart: dict[str, str] = {}  #: symbols that differ from 0, and what their zeros are
        self.rates: dict[Expr, Expr] = {}
        self.raw: dict[str, tuple[Any, Any]] = {}  #: entries of G with a letter of their own, in symbols of the law
        self.letters_of: dict[Node, list[tuple[Expr, Expr, Expr]]] = {}  #: of bodies to which a dyad has given an angle
        self._coordinates: dict[Expr, Node] = {}  #: symbols of coordinates in couplings that are not known yet
        super().__init__(prepared)
        if self.without:  # letters of the balances, which are not printed
            self.unknowns = []
            for table in (self.latex, self.said, self.taken, self.rows, self.on_l, self.entries, self.places, self.raw):
                table.clear()
        if prepared.model.lines:
            raise ValueError("its beams are flexible, so that more than one coordinate moves it")
        odd = [n.name for n in prepared.model.nodes if n.kind not in (*self.KINDS, NodeKind.COORDINATE)]
        if odd:
            raise ValueError(f"{escaped(odd[0])} is no rigid body")
        self.placed: dict[Node | None, Any] = {None: self.GROUND}
        self.amounts: dict[str, Expr] = {}  #: coordinates of joints that are known, by item
        self.links = [*self._links()]
        self._input()

    # -- letters

    def constant(self, name: str, latex: str, value_: float, unit: str, meaning: str) -> Expr:
        """A number of the scene with its letter; 0, and 1 and -1 without a unit, are written as such."""
        plain = round(value_, 14)
        if plain == 0 or (unit == "1" and plain in (1.0, -1.0)):
            return se.Integer(int(plain))
        if name not in self.latex:
            self.letter(name, latex, unit, meaning)
            self.constants[name] = value_
        return se.Symbol(name)

    def follow(self, name: str, e: Expr) -> Expr:
        """A symbol that a formula defines."""
        self.formulas.append((name, e))
        return se.Symbol(name)

    def say(self, text: str) -> None:
        """A sentence before the next formula."""
        self.sayings[len(self.formulas)] = self.sayings.get(len(self.formulas), "") + text

    def moving(self, name: str, latex: tuple[str, str], unit: str, meaning: str) -> tuple[Expr, Expr, Expr]:
        """Letters of a coordinate and its two rates. latex: letter and subscript."""
        found = tuple(self.letter(f"{name}{d * i}", f"\\{'d' * i}ot{{{latex[0]}}}{latex[1]}" if i else "".join(latex),
                                  f"{unit}/s^{i}" if i > 1 else f"{unit}/s" if i else unit,
                                  f"{('', 'rate: ', 'second rate: ')[i]}{meaning}") for i, d in ((0, "d"), (1, "d"), (2, "d")))
        self.rates |= {found[0]: found[1], found[1]: found[2]}
        return found[0], found[1], found[2]

    def rate(self, e: Expr) -> Expr:
        """The time derivative of a formula."""
        return sum((se.diff(e, s) * self.rates[s] for s in sorted(e.free_symbols & self.rates.keys(), key=str)), ZERO)

    def with_rates(self, symbols: tuple[Expr, Expr, Expr], e: Expr) -> None:
        """Define a coordinate by a formula, and its rates by the derivatives of the formula."""
        for s in symbols:
            self.follow(str(s), e)
            e = self.rate(e)

    # -- the joints

    def _links(self) -> Iterator[Any]:
        model = self.prepared.model
        joints = {c.name: c for c in model.scene.joints}
        seen = set[str]()
        for row in self.m.rows:
            instance = model.groups[row.group].instances[row.instance]
            if instance.item in seen or instance.item not in joints or "l_p1" not in instance.numbers:
                continue
            seen.add(instance.item)
            yield self._link(instance, joints[instance.item].joint, row)

    def _link(self, instance: Instance, joint: Any, row: Any) -> Any:
        motion = symbolic_motion(joint) if hasattr(joint, "states_motion") else None
        coordinates = [s for s in (motion.steps if motion else ()) if s.amount.free_symbols]
        if len(coordinates) != 1 or not coordinates[0].amount.is_Symbol or len(motion.steps) != 1:  # type: ignore[union-attr]
            raise ValueError(f"{escaped(instance.item)} has not one coordinate, the amount of one turn or one displacement")
        step = coordinates[0]
        item, n = instance.item, instance.numbers
        Q = np.array([[n[f"k_Q{a}{i}"] for a in "xyz"] for i in (1, 2, 3)])
        axis = Q @ [float(c) for c in step.axis]
        turn = round(axis[2]) if step.turns else 0
        angle = [n[f"{side}_theta0"] if turn else _heading(n, side) for side in "kl"]
        rest = angle[1] - angle[0] if turn else angle[0] - angle[1]
        at = self.names.said("item", item)
        ends = [self.number_of(instance, "k", "p1", "p2"), self.number_of(instance, "l", "p1", "p2")]
        along = (self.constant(f"e{item}1", f"e_{{{at},x}}", axis[0], "1", f"direction of {item} on its body k, component x"),
                 self.constant(f"e{item}2", f"e_{{{at},y}}", axis[1], "1", f"direction of {item} on its body k, component y"))
        by = self.constant(f"rest{item}", f"\\beta_{{{at}}}", rest, "rad", f"angle of l less that of k as drawn, at {item}")
        return Link(item, instance.nodes[0], instance.nodes[1], (ends[0], ends[1]), turn, along, by, str(step.amount))

    def number_of(self, instance: Instance, side: str, *names: str) -> Any:
        """Numbers of a frame in body axes, as letters."""
        node = dict(zip(instance.law.frames, instance.nodes, strict=False)).get(side)
        body = node.name if node is not None else "ground"
        found = []
        for name in names:
            axis, letter = "xyz"[int(name[-1]) - 1], "d" if name[0] == "p" else rf"\bar{{{name[1]}}}"
            latex = f"{letter}^{{{self.names.said('node', body)}}}_{{{self.names.said('item', instance.item)},{axis}}}"
            what = "place" if name[0] == "p" else f"axis {name[1]}"
            found.append(self.constant(f"n{instance.item}{side}{name}", latex, instance.numbers[f"{side}_{name}"],
                                       "m" if name[0] == "p" else "1",
                                       f"{what} of {instance.item} in axes of {body}, along {axis}"))
        return tuple(found)

    # -- the bodies, one after the other

    def coordinates_of(self, node: Node) -> list[tuple[Expr, Expr, Expr]]:
        """Letters of the coordinates of a body, or of a joint's coordinate, with their rates."""
        found = []
        for at in range(node.u, node.u + node.kind.sizes[1]):
            v = self.velocities[at]
            found.append(self.moving(f"x{at}", (v.letter, f"_{v.below}"), v.unit, v.of))
        return found

    def _input(self) -> None:
        """The input: a prescribed coordinate of a joint of a known body, else that of the first joint on the ground."""
        scene = self.prepared.model.scene
        driven = {c.name for c in scene.joints if c.prescribed}
        if len(driven) > 1:
            raise ValueError(f"it has {counted(len(driven), 'prescribed joint')}, where one input is needed")
        found = [link for link in self.links if (link.item in driven if driven else None in (link.k, link.l))]
        if not found or not self._may_drive(found[0]):
            raise ValueError("no joint on the ground has the input")
        self.input = link = found[0]
        at = self.names.said("item", link.item)
        letter = r"\varphi" if link.turn else "u"
        self.inputs = self.moving("in", (letter, f"_{{{at}}}"), "rad" if link.turn else "m",
                                  f"the input, {link.coordinate} of {link.item}")
        self.amounts[link.item] = self.inputs[0]

    def _may_drive(self, link: Any) -> bool:
        return None in (link.k, link.l)

    def _known(self, link: Any) -> bool:
        """Whether the coordinates of a joint are known."""
        return link.item in self.amounts

    def _hung(self) -> bool:
        """A body on a joint whose coordinate is known, and coordinates of joints between known bodies."""
        for link in self.links:
            ends = [end in self.placed for end in (link.k, link.l)]
            node = self.prepared.model.coordinate_node(link.item, link.coordinate)
            if node is not None and node not in self.placed and (link.item in self.amounts or all(ends)):
                e = self.amounts[link.item] if link.item in self.amounts else self._amount(link)
                own = self.coordinates_of(node)[0]
                self.with_rates(own, e)
                self.placed[node], self.amounts[link.item] = Place(own[0], ZERO, ZERO), own[0]
                return True
            if sum(ends) == 1 and self._known(link):
                outwards = ends[0]
                known, node = (link.k, link.l) if outwards else (link.l, link.k)
                assert node is not None
                self.say(f"{escaped(node.name)} follows by {escaped(link.item)}:")
                self._place(node, link, known, self.amounts.get(link.item, ZERO))
                return True
        return False

    def _amount(self, link: Any) -> Expr:
        """The coordinate of a joint between two known bodies."""
        k, l = self.placed[link.k], self.placed[link.l]
        if link.turn:
            return link.turn * (l.angle - k.angle - link.rest)
        (ax, ay), (bx, by) = k.point(link.points[0]), l.point(link.points[1])
        ex, ey = k.turned(link.axis)
        return ex * (bx - ax) + ey * (by - ay)

    def _angle(self, link: Link, known: Node | None, amount: Expr) -> Expr:
        """Angle of the other body of a joint."""
        there = link.rest + (link.turn * amount if link.turn else ZERO)
        return self.placed[known].angle + (there if known is link.k else -there)

    def _place(self, node: Node, link: Any, known: Node | None, amount: Expr, angle: Expr | None = None) -> None:
        """Define a body on a known one: its angle, unless it is known already, and its centre."""
        x, y, theta = self.coordinates_of(node) if node not in self.letters_of else self.letters_of[node]
        if angle is None:
            self.with_rates(theta, self._angle(link, known, amount))
        self.placed[node] = Place(x[0], y[0], theta[0])
        outwards = known is link.k
        ex, ey = ZERO, ZERO
        if not link.turn:
            ex, ey = (amount * c for c in self.placed[link.k].turned(link.axis))
        at = self.placed[known].point(link.points[0 if outwards else 1])
        own = self.placed[node].turned(link.points[1 if outwards else 0])
        sign = 1 if outwards else -1
        self.with_rates(x, at[0] + sign * ex - own[0])
        self.with_rates(y, at[1] + sign * ey - own[1])

    def _geared(self) -> bool:
        """Coordinates of joints by couplings that are linear in them: one by one, or two by two rows."""
        rows = [self._coupling(row) for row in self.m.rows if self._couples(row)]
        open_ = [(e, own, item) for e, item in rows if (own := frozenset(e.free_symbols & self._coordinates.keys()))]
        for number in (1, 2):
            for chosen in combinations(open_, number):
                unknown = sorted(frozenset().union(*(own for _, own, _ in chosen)), key=str)
                A = [[se.diff(e, s) for s in unknown] for e, _, _ in chosen]
                if len(unknown) != number or any(a.free_symbols & self._coordinates.keys() for a in itertools.chain(*A)):
                    continue
                self.say(f"By {' and '.join(escaped(item) for _, _, item in chosen)}:")
                still, det = dict.fromkeys(unknown, ZERO), determinant(A)
                h = [-e.subs(still) for e, _, _ in chosen]
                if det.free_symbols:
                    det = self.constant_of(det, len(self.formulas))
                for j, s in enumerate(unknown):
                    node = self._coordinates.pop(s)
                    letters = self.coordinates_of(node)[0]
                    swapped = [[h[i] if k == j else A[i][k] for k in range(number)] for i in range(number)]
                    self.with_rates(letters, se.expand(determinant(swapped)) / det)
                    self.placed[node], self.amounts[node.joint] = Place(letters[0], ZERO, ZERO), letters[0]
                return True
        return False

    def constant_of(self, e: Expr, n: int) -> Expr:
        """A letter for a divisor of the couplings."""
        self.letter(f"De{n}", f"\\Delta_{{\\text{{mesh}},{n}}}", "1", "determinant of the couplings")
        self.apart[f"De{n}"] = ""
        return self.follow(f"De{n}", e)

    def _couples(self, row: Any) -> bool:
        d, instance = (group := self.prepared.model.groups[row.group]).derived, group.instances[row.instance]
        return all(n is not None and n.kind is NodeKind.COORDINATE for n in instance.nodes) and row.row not in d.by_rates \
            and len(instance.nodes) > 1

    def _coupling(self, row: Any) -> tuple[Expr, str]:
        """A row of a coupling in letters of the scene, and its item; coordinates that are not known have symbols of their own."""
        d, instance = (group := self.prepared.model.groups[row.group]).derived, group.instances[row.instance]
        e, table = d.variation.resolve(lowest(d)[row.row][1]), dict[Expr, Expr]()
        for f, node in zip(d.frames, instance.nodes, strict=True):
            assert node is not None
            table[f.q[0]] = self.placed[node].x if node in self.placed else se.Symbol(f"open{node.u}")
            if node not in self.placed:
                self._coordinates[table[f.q[0]]] = node
        for s in e.free_symbols - table.keys():
            if str(s) not in instance.numbers:
                raise ValueError(f"{escaped(str(s))} of {escaped(instance.item)} changes with time")
            latex = self.parameter_letter(instance, str(s))
            table[s] = self.constant(f"r{instance.item}{s}", latex, instance.numbers[str(s)],
                                     parameter_unit(instance, str(s)), f"{s} of {instance.item}")
        return se.sympify(e.subs(table)), instance.item

    # -- values

    def _of(self, table: dict[str, Any], e: Expr) -> Any:
        return value(se.sympify(e), lambda s: table[str(s)])

    def states_as_letters(self, q: Any, u: Any, change: Any) -> dict[str, Any]:
        """Values of the coordinates of bodies and joints and of their rates, by their symbols, at states (nt, n)."""
        return {f"x{n}{d}": v[:, n] for n in range(u.shape[1]) for d, v in (("", q), ("d", u), ("dd", change))}

    def _unplaced(self, node: Node) -> Any:
        """A body where its unknowns say that it is."""
        return Place(*(se.Symbol(f"x{node.u + i}") for i in range(3)))

    def _drawn_amount(self, link: Any) -> Expr:
        """The coordinate of a joint by the unknowns of its bodies, whole turns included."""
        held, self.placed = self.placed, {None: self.placed[None]} | {
            end: self._unplaced(end) for end in (link.k, link.l) if end is not None}
        try:
            return self._amount(link)
        finally:
            self.placed = held


def minus(e: Expr) -> Expr:
    """Minus a sum, term by term, so that lines can end between them."""
    return sum((-part for part in e.args), ZERO) if e.is_Add else -e


def _heading(numbers: Any, side: str) -> float:
    """Angle in the plane, in body axes, of that axis of a joint's frame that lies in the plane."""
    axis = max("xy", key=lambda a: np.hypot(numbers[f"{side}_Q{a}1"], numbers[f"{side}_Q{a}2"]))
    return float(np.arctan2(numbers[f"{side}_Q{axis}2"], numbers[f"{side}_Q{axis}1"]))
