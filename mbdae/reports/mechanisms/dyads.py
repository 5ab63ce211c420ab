"""Two bodies between known ones: the closure of their loop, solved for two unknowns, and its rates.

    two angles      A cos(theta) + B sin(theta) = C, from the distance of the outer points; the other angle from what is left
    one, a slide    A cos(theta) + B sin(theta) = C, from the closure across the slide; the displacement from that along it
    two slides      linear

Velocities and accelerations solve the closure differentiated, two linear equations with the same determinant each. Where this is
0 is a dead centre of the dyad, beyond which it does not close; or a change point, where both roots of its closure meet and the
mechanism passes from the one to the other."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.documents.blocks import escaped
from mbdae.reports.mechanisms.links import Link, Links, Pair, Place, minus
from mbdae.reports.mechanisms.solution import determinant
from mbdae.reports.page import NEXT_TO_ZERO
from mbdae.reports.states import value
from mbdae.reports.vectors import ZERO
from mbdae.symbolic.vectors import Expr
from mbdae.system.model.nodes import Node
from mbdae.system.prepare import Prepared

TURN = 361  #: places over one turn of the input at which dead centres are sought and curves drawn
LENGTHS = 3  #: the same for a displacement: lengths of the scene to each side, with as many places for each
TOUCHES = 1e-11  #: what is under a root touches 0 where it is below this part of its terms


class Branch(NamedTuple):
    """The two roots of a closure that meet at change points. side: what is positive on one and negative on the other; start: its
    sign at the start; changes: values of the input at which the mechanism passes from one to the other; touches: at which it
    stays; period: of these, 0 for a displacement."""

    side: Expr
    start: int
    changes: list[float]
    touches: list[float]
    period: float

    @property
    def points(self) -> list[float]:
        """All change points."""
        return sorted([*self.changes, *self.touches])


class Dyads(Links):
    """Bodies that follow from the input alone or as two between known ones. Raises ValueError, with the reason, where others
    remain."""

    def __init__(self, prepared: Prepared) -> None:
        self.limits: dict[str, str] = {}  #: roots that vanish at a dead centre, and what this is
        self.roots: dict[str, Expr] = {}  #: these by the bodies, over the root of their terms: negative beyond a dead centre
        self.branches: dict[str, Branch] = {}  #: of closures with change points, by the symbols of their signs
        self.met: dict[str, str] = {}  #: of branches of dyads with three pins: that the outer two coincide
        self.lowest: list[float] = []  #: values of the input where what is under a root is least
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
        D = self._letters(("D", "distance of the outer points"), across, "m")
        unknown = self._positions(slides, (a, b, c), u, D, angles, arms, along, sign, sigma, offset, rows)
        self._rates_of(unknown, rows)
        if not b.turn and a.turn and c.turn:
            self.with_rates(angles[1], turns[1])
        self.amounts |= {n: s[0] for n, s in sigma.items()}
        for node, link, end in ((first, a, ends[0]), (second, c, ends[1])):
            self._place(node, link, end, self.amounts.get(link.item, ZERO), self.letters_of[node][2][0])

    def _letters(self, said: tuple[str, str], e: tuple[Expr, ...], unit: str) -> Pair:
        """Letters with an index for components."""
        letter, meaning = said
        found = []
        for i, part in enumerate(e):
            name = f"{letter}{self.dyads}_{i}"
            self.letter(name, f"{letter}^{{({self.dyads})}}_{{{'xy'[i]}}}", unit,
                        f"{meaning} of dyad {self.dyads}, along {'xy'[i]}")
            found.append(self.follow(name, part))
        return found[0], found[1]

    def _angle_by(self, angle: tuple[Expr, Expr, Expr], A: Expr, B: Expr, C: Expr, unit: str, dead: str) -> None:
        """An angle by A cos + B sin = C, on the side on which it starts."""
        n, found = self.dyads, []
        for letter, e, what in (("A", A, "factor of the cosine"), ("B", B, "factor of the sine"), ("C", C, "right-hand side")):
            self.letter(f"{letter}{n}", f"{letter}^{{({n})}}", unit, f"{what} in the closure of dyad {n}")
            found.append(self.follow(f"{letter}{n}", e))
        A, B, C = found
        self.letter(f"S{n}", f"S^{{({n})}}", unit, f"distance of dyad {n} from its dead centre")
        size = np.hypot(self.start_of(A), self.start_of(B))
        S, sign = self._root(n, A**2 + B**2 - C**2, A**2 + B**2 + C**2, A * se.sin(angle[0]) - B * se.cos(angle[0]), size, dead)
        self.follow(str(angle[0]), se.atan2(B * C + sign * A * S, A * C - sign * B * S))

    def _root(self, n: int, under: Expr, terms: Expr, side: Expr, size: float, dead: str) -> tuple[Expr, Expr]:
        """The root of a closure, with the sign of its branch where it has change points, and its sign at the start. terms: sum of
        the sizes of what is under the root; side: plus or minus the root; size: of the side, where it is far from 0."""
        at = self.start_of(side)
        if not abs(at) > NEXT_TO_ZERO * size:
            raise ValueError(f"it starts at a dead centre or change point: {dead}")
        start = 1 if at > 0 else -1
        changes, touches, period = self._change_points(under, terms)
        S = se.sqrt(under)
        if changes or touches:
            branch = self.letter(f"br{n}", rf"\sigma^{{({n})}}", "1", f"branch of dyad {n}: 1 as at the start, -1 the other")
            self.constants[str(branch)] = 1.0
            self.branches[str(branch)] = Branch(side, start, changes, touches, period)
            S = branch * S
        self.limits[f"S{n}"], self.roots[f"S{n}"] = dead, start * side / se.sqrt(terms)
        return self.follow(f"S{n}", S), se.Integer(start)

    def _change_points(self, under: Expr, terms: Expr) -> tuple[list[float], list[float], float]:
        """Values of the input at which what is under a root touches 0, with and without a change of the branch, and the period of
        these."""
        at, period = self.turn(), self.period()

        def of(x: Any, e: Expr = under) -> Any:
            return np.broadcast_to(self._of(self.along(x), e), np.shape(x)) / whole

        whole, step = 1.0, at[1] - at[0]
        whole = float(np.nanmax(of(at, terms))) or 1.0
        inside = np.concatenate([[at[0] - step], at, [at[-1] + step]])
        v, changes, touches = of(inside), list[float](), list[float]()
        for i in range(1, len(inside) - 1):
            if not v[i] <= min(v[i - 1], v[i + 1]) or v[i] > 0.01:
                continue
            low, high = inside[i - 1], inside[i + 1]
            for _ in range(14):
                grid = np.linspace(low, high, 11)
                best = int(np.nanargmin(of(grid)))
                low, high = grid[max(best - 1, 0)], grid[min(best + 1, 10)]
            x = (low + high) / 2
            near = of(x + step * np.array([0.0, 1.0, 2.0, -1.0]))
            if not abs(near[0]) < TOUCHES or not min(near[1], near[3]) > 0:
                self.lowest.append(float(x))
                continue
            x = self.within(x) if period else x
            found = changes if round(np.log2(near[2] / near[1])) // 2 % 2 else touches
            if all(abs(x - other) > step for other in (*changes, *touches)):
                found.append(float(x))
        return sorted(changes), sorted(touches), period

    def period(self) -> float:
        """The range of the input after which the mechanism is as before, 0 for a displacement: one turn, or two where it is on
        another branch after one."""
        turn = 2 * np.pi * bool(self.input.turn)
        return turn * (1 + any(len(b.changes) % 2 and b.period == turn for b in self.branches.values()))

    def within(self, x: Any) -> Any:
        """An angle less whole periods, within one from the start."""
        start = self.start_of(self.inputs[0])
        return start + np.mod(x - start, self.period())

    def branch_at(self, branch: Branch, at: Any) -> Any:
        """The sign of a branch, 1 as at the start, at values of the input reached without a turn back at a change point."""
        start, passed = self.start_of(self.inputs[0]), np.zeros(np.shape(at))
        for x in branch.changes:
            passed += np.floor((at - x) / branch.period) - np.floor((start - x) / branch.period) if branch.period else \
                ((at > x) != (start > x))
        return 1.0 - 2.0 * (np.abs(passed) % 2)

    # -- one turn of the input

    def along(self, at: Any, rate: Any = 1.0) -> dict[str, Any]:
        """Values of all symbols of the formulas at values of the input, with its rate and without second rate; NaN where a loop
        does not close."""
        at = np.asarray(at, dtype=float)
        table: dict[str, Any] = {name: np.full(len(at), x) for name, x in self.constants.items()}
        table |= {name: self.branch_at(b, at) for name, b in self.branches.items()}
        inputs = at, np.broadcast_to(rate, np.shape(at)), np.zeros(len(at))
        table |= dict(zip(map(str, self.inputs), inputs, strict=True))
        with np.errstate(all="ignore"):
            for name, e in self.formulas:
                try:
                    table[name] = np.broadcast_to(self._of(table, e), np.shape(at))
                except KeyError:
                    continue  # letters of the balances, which no motion defines
        return table

    def turn(self) -> Any:
        """Values of the input: one period from the start, or for a displacement some lengths of the scene to both sides."""
        start, size = self.start_of(self.inputs[0]), LENGTHS * self.prepared.length
        if period := self.period():
            return start + np.linspace(0, period, round(period / (2 * np.pi)) * (TURN - 1) + 1)
        return start + np.linspace(-size, size, LENGTHS * (TURN - 1) + 1)

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
            self._cramer([s[0] for s in both], J, [minus(row.subs(still)) for row in rows], "the two slides are parallel")
            return both
        if not slides:
            size = [x**2 + y**2 for x, y in u]
            dead = f"{names[0]}, {names[1]} and {names[2]} lie on one line"
            self.met[f"br{self.dyads}"] = f"{names[0]} and {names[2]} coincide"
            self._angle_by(angles[0], _dot(D, u[0]), D[1] * u[0][0] - D[0] * u[0][1], (_dot(D, D) + size[0] - size[1]) / 2, "m^2",
                           dead)
            w = self._letters(("w", "vector between the points of the second body"), _less(D, arms[0]), "m")
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
            self._cramer([s[order] for s in unknown], J, [minus(row.subs(still)) for row in rows], "")

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

    def start_of(self, e: Expr) -> float:
        """Value of a formula at the start."""
        start = self.prepared.start
        return float(np.reshape(self.at_states(e, start.q[None], start.u[None]), ()))

    def at_states(self, e: Expr, q: Any, u: Any) -> Any:
        """Values (nt,) of a formula where states say that bodies and joints are."""
        table = dict(self.constants) | self.drawn_letters(q, u)
        table |= {f"sl{link.item}": self._of(table, self._drawn_amount(link)) for link in self.links
                  if f"sl{link.item}" in self.latex}
        table[str(self.inputs[0])] = self._of(table, self._drawn_amount(self.input))
        known = dict(self.formulas)

        def get(s: Expr) -> Any:
            if str(s) not in table:
                table[str(s)] = value(known[str(s)], get)
            return table[str(s)]

        return np.broadcast_to(value(se.sympify(e), get), (len(q),))

    def drawn_letters(self, q: Any, u: Any) -> dict[str, Any]:
        """Values of the coordinates of bodies and joints at states, by their symbols."""
        return self.states_as_letters(q, u, np.zeros_like(u))


def _dot(a: Pair, b: Pair) -> Expr:
    return a[0] * b[0] + a[1] * b[1]


def _less(a: Pair, b: Pair) -> Pair:
    return a[0] - b[0], a[1] - b[1]
