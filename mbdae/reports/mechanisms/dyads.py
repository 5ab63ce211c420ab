"""Two bodies between known ones: the closure of their loop, solved for two unknowns, and its rates.

    two angles      A cos(theta) + B sin(theta) = C, from the distance of the outer points; the other angle from what is left
    one, a slide    A cos(theta) + B sin(theta) = C, from the closure across the slide; the displacement from that along it
    two slides      linear

Velocities and accelerations solve the closure differentiated, two linear equations with the same determinant each. Where this is
0 is a dead centre of the dyad."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import escaped
from mbdae.reports.mechanisms.links import Link, Links, Pair, Place
from mbdae.reports.mechanisms.solution import determinant
from mbdae.reports.page import NEXT_TO_ZERO
from mbdae.reports.states import value
from mbdae.reports.vectors import ZERO
from mbdae.symbolic.vectors import Expr
from mbdae.system.model.nodes import Node
from mbdae.system.prepare import Prepared


class Dyads(Links):
    """Bodies that follow from the input alone or as two between known ones. Raises ValueError, with the reason, where others
    remain."""

    def __init__(self, prepared: Prepared) -> None:
        self.limits: dict[str, str] = {}  #: roots that vanish at a dead centre, and what this is
        self.dyads = self.solves = 0
        super().__init__(prepared)
        while self._hung() or self._geared() or self._dyad():
            pass
        left = [n.name for n in prepared.model.nodes if n not in self.placed]
        if left:
            raise ValueError(f"with {escaped(self.input.item)} as its input, {escaped(', '.join(left))} "
                             "follow neither from joints and couplings nor as two bodies between known ones")

    def _dyad(self) -> bool:
        """Two bodies with a joint between them, each with a joint to a known body."""
        for inner in self.links:
            for first, second in ((inner.k, inner.l), (inner.l, inner.k)):
                if first in self.placed or second in self.placed or first is None or second is None:
                    continue
                outer = [[x for x in self.links if node in (x.k, x.l) and {x.k, x.l} - {node} <= self.placed.keys()]
                         for node in (first, second)]
                if all(outer):
                    self._close(outer[0][0], inner, outer[1][0], first, second)
                    return True
        return False

    def _close(self, a: Link, b: Link, c: Link, first: Node, second: Node) -> None:
        """Close the loop of a dyad: joint a between a known body and the first, b between both, c between the second and a known
        body."""
        slides = [link for link in (a, b, c) if not link.turn]
        if len(slides) > 2:
            raise ValueError(f"{escaped(a.item)}, {escaped(b.item)} and {escaped(c.item)} all slide")
        self.dyads += 1
        ends = a.l if a.k is first else a.k, c.l if c.k is second else c.k
        names = [escaped(x) for x in (first.name, second.name, a.item, b.item, c.item)]
        self.say(f"The loop of {names[0]} and {names[1]} closes between {names[2]} and {names[4]}, with {names[3]} between them.")
        for node in (first, second):
            self.letters_of[node] = self.coordinates_of(node)
        angles = [self.letters_of[node][2] for node in (first, second)]
        turns = [angles[0][0], angles[1][0]]
        offset = b.rest if b.k is first else -b.rest  # of the second body to the first, where b slides
        if not a.turn:
            self.with_rates(angles[0], self._angle(a, ends[0], ZERO))
        if not c.turn:
            self.with_rates(angles[1], self._angle(c, ends[1], ZERO))
        if not b.turn and not a.turn:
            self.with_rates(angles[1], turns[0] + offset)
        elif not b.turn and not c.turn:
            self.with_rates(angles[0], turns[1] - offset)
        elif not b.turn:
            turns[1] = turns[0] + offset
        bodies = {first: Place(ZERO, ZERO, turns[0]), second: Place(ZERO, ZERO, turns[1])}
        places = self.placed | bodies
        u = [_less(b.points[b.l is first], a.points[a.l is first]), _less(c.points[c.l is second], b.points[b.l is second])]
        across = _less(self.placed[ends[1]].point(c.points[c.k is second]), self.placed[ends[0]].point(a.points[a.k is first]))
        sigma = {link.item: self.moving(f"sl{link.item}", ("u", f"_{{{self.names.said('item', link.item)}}}"), "m",
                                        f"{link.coordinate} of {link.item}") for link in slides}
        sign = {link.item: 1 if link.k is start else -1 for link, start in zip((a, b, c), (ends[0], first, second), strict=True)}
        along = {link.item: places[link.k].turned(link.axis) for link in slides}
        arms = [bodies[first].turned(u[0]), bodies[second].turned(u[1])]
        rows = [arms[0][i] + arms[1][i] - across[i] + sum((sign[n] * s[0] * along[n][i] for n, s in sigma.items()), ZERO)
                for i in (0, 1)]
        self._letters(("D", "distance of the outer points"), across, "m")
        D = self.last
        unknown = self._positions(slides, (a, b, c), u, D, angles, arms, along, sign, sigma, offset, rows)
        self._rates_of(unknown, rows)
        if not b.turn and a.turn and c.turn:
            self.with_rates(angles[1], turns[1])
        self.amounts |= {n: s[0] for n, s in sigma.items()}
        for node, link, end in ((first, a, ends[0]), (second, c, ends[1])):
            self._place(node, link, end, self.amounts.get(link.item, ZERO), self.letters_of[node][2][0])

    def _letters(self, said: tuple[str, str], e: tuple[Expr, ...], unit: str) -> None:
        """Letters with an index for components, kept in `last`."""
        letter, meaning = said
        found = []
        for i, part in enumerate(e):
            name = f"{letter}{self.dyads}_{i}"
            self.letter(name, f"{letter}^{{({self.dyads})}}_{{{'xy'[i]}}}", unit,
                        f"{meaning} of dyad {self.dyads}, along {'xy'[i]}")
            found.append(self.follow(name, part))
        self.last = (found[0], found[1])

    def _angle_by(self, angle: tuple[Expr, Expr, Expr], A: Expr, B: Expr, C: Expr, unit: str, dead: str) -> None:
        """An angle by A cos + B sin = C, on the side on which it starts."""
        n, found = self.dyads, []
        for letter, e, what in (("A", A, "factor of the cosine"), ("B", B, "factor of the sine"), ("C", C, "right-hand side")):
            self.letter(f"{letter}{n}", f"{letter}^{{({n})}}", unit, f"{what} in the closure of dyad {n}")
            found.append(self.follow(f"{letter}{n}", e))
        A, B, C = found
        self.letter(f"S{n}", f"S^{{({n})}}", unit, f"distance of dyad {n} from its dead centre")
        at = self.start_of(angle[0])
        side = self.start_of(A) * np.sin(at) - self.start_of(B) * np.cos(at)
        if abs(side) < NEXT_TO_ZERO * np.hypot(self.start_of(A), self.start_of(B)):
            raise ValueError(f"it starts at a dead centre: {dead}")
        sign = se.Integer(1 if side > 0 else -1)
        S = self.follow(f"S{n}", se.sqrt(A**2 + B**2 - C**2))
        self.limits[f"S{n}"] = dead
        self.follow(str(angle[0]), se.atan2(B * C + sign * A * S, A * C - sign * B * S))

    def _positions(self, slides: list[Link], links: tuple[Link, Link, Link], u: list[Pair], D: Pair, angles: Any,
                   arms: list[Pair], along: dict[str, Pair], sign: dict[str, int], sigma: dict[str, Any], offset: Expr,
                   rows: list[Expr]) -> list[Any]:
        """Define the two unknowns of a closure; returns them with their rates."""
        a, b = links[:2]
        names = [escaped(link.item) for link in links]
        if len(slides) == 2:
            both = [sigma[link.item] for link in slides]
            still = {s[0]: ZERO for s in both}
            J = [[se.diff(row, s[0]) for s in both] for row in rows]
            self._cramer([s[0] for s in both], J, [-row.subs(still) for row in rows], "the two slides are parallel")
            return both
        if not slides:
            size = [x**2 + y**2 for x, y in u]
            dead = f"{names[0]}, {names[1]} and {names[2]} lie on one line"
            self._angle_by(angles[0], _dot(D, u[0]), D[1] * u[0][0] - D[0] * u[0][1], (_dot(D, D) + size[0] - size[1]) / 2, "m^2",
                           dead)
            self._letters(("w", "vector between the points of the second body"), _less(D, arms[0]), "m")
            w = self.last
            self.follow(str(angles[1][0]), se.atan2(u[1][0] * w[1] - u[1][1] * w[0], _dot(u[1], w)))
            return [angles[0], angles[1]]
        link = slides[0]
        e, s = along[link.item], sigma[link.item]
        if link is b:
            cos, sin = se.cos(offset), se.sin(offset)
            turned = (u[1][0] * cos - u[1][1] * sin, u[1][0] * sin + u[1][1] * cos)
            whole = (u[0][0] + turned[0], u[0][1] + turned[1])
            back = ZERO if sign[link.item] > 0 else offset  # the slide's direction in axes of the first body
            n = Place(ZERO, ZERO, back).turned((-link.axis[1], link.axis[0]))
            dead = f"the line from {names[0]} to {names[2]} is normal to the slide {names[1]}"
            self._angle_by(angles[0], _dot(n, D), n[0] * D[1] - n[1] * D[0], _dot(n, whole), "m", dead)
            unknown = angles[0]
        else:
            free = 1 if link is a else 0
            n, w = (-e[1], e[0]), _less(D, arms[1 - free])
            dead = f"the line from {names[free]} to {names[free + 1]} is normal to the slide {escaped(link.item)}"
            self._angle_by(angles[free], _dot(n, u[free]), n[1] * u[free][0] - n[0] * u[free][1], _dot(n, w), "m", dead)
            unknown = angles[free]
        rest = _less(_less(D, arms[0]), arms[1])
        self.follow(str(s[0]), sign[link.item] * _dot(e, rest))
        return [unknown, s]

    def _rates_of(self, unknown: list[Any], rows: list[Expr]) -> None:
        """Rates and second rates of the two unknowns of a closure: its rows differentiated, solved by determinants."""
        J = [[se.diff(row, s[0]) for s in unknown] for row in rows]
        for order in (1, 2):
            rows = [self.rate(row) for row in rows]
            still = {s[order]: ZERO for s in unknown}
            self._cramer([s[order] for s in unknown], J, [-row.subs(still) for row in rows], "")

    def _cramer(self, unknown: list[Expr], J: list[list[Expr]], right: list[Expr], dead: str) -> None:
        """Define two unknowns by two linear equations."""
        self.solves += 1
        n, order = self.dyads, self.solves
        said = [self.said[self.latex[str(s)]].unit for s in unknown]
        per, time = ["m" if x.startswith("rad") else "1" for x in said], said[0].partition("/")[2]
        if f"J{n}_00" not in self.latex:
            for i in (0, 1):
                for j in (0, 1):
                    self.letter(f"J{n}_{i}{j}", f"J^{{({n})}}_{{{i + 1}{j + 1}}}", per[j], f"factor in the closure of dyad {n}")
                    self.follow(f"J{n}_{i}{j}", J[i][j])
            own = [[se.Symbol(f"J{n}_{i}{j}") for j in (0, 1)] for i in (0, 1)]
            unit = "m^2" if per == ["m", "m"] else "m" if "m" in per else "1"
            self.letter(f"De{n}", f"\\Delta_{{{n}}}", unit, f"determinant of the closure of dyad {n}, 0 at its dead centre")
            self.follow(f"De{n}", determinant(own))
            self.apart[f"De{n}"] = dead
        own = [[se.Symbol(f"J{n}_{i}{j}") for j in (0, 1)] for i in (0, 1)]
        h = []
        for i, e in enumerate(right):
            self.letter(f"k{order}_{i}", f"k^{{({order})}}_{{{i + 1}}}", f"m/{time}" if time else "m",
                        "minus the rest of the closure or of its derivative")
            h.append(self.follow(f"k{order}_{i}", e))
        for j, s in enumerate(unknown):
            swapped = [[h[i] if column == j else own[i][column] for column in (0, 1)] for i in (0, 1)]
            self.follow(str(s), determinant(swapped) / se.Symbol(f"De{n}"))

    # -- values at the start

    def _of(self, table: dict[str, Any], e: Expr) -> Any:
        return value(se.sympify(e), lambda s: table[str(s)])

    def start_of(self, e: Expr) -> float:
        """Value of a formula at the start."""
        table = dict(self.constants) | self.start_letters()
        table |= {f"sl{link.item}": self._of(table, self._drawn_amount(link)) for link in self.links
                  if f"sl{link.item}" in self.latex}
        table[str(self.inputs[0])] = self._of(table, self._drawn_amount(self.input))
        known = dict(self.formulas)

        def get(s: Expr) -> Any:
            if str(s) not in table:
                table[str(s)] = value(known[str(s)], get)
            return table[str(s)]

        return float(np.reshape(value(se.sympify(e), get), ()))

    def start_letters(self) -> dict[str, Any]:
        """Values of the coordinates of bodies and joints at the start, by their symbols."""
        start = self.prepared.start
        return self.states_as_letters(start.q[None], start.u[None], np.zeros((1, len(start.u))))

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


def _dot(a: Pair, b: Pair) -> Expr:
    return a[0] * b[0] + a[1] * b[1]


def _less(a: Pair, b: Pair) -> Pair:
    return a[0] - b[0], a[1] - b[1]
