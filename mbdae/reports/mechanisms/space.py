"""A mechanism in space over its input: bodies on joints whose coordinates are known, and legs.

A body is its centre and the three axes that it has, with their angular velocity. A leg lies between a cross with two pins and a
ball: one body, or two with a slide between them.

    the swing of what the leg holds, where its length is known   A cos(phi) + B sin(phi) = C, from the distance of its ends
    its length, where its ends are known                         by the distance of the ends
    the angles of the cross                                      A cos(beta) + B sin(beta) = C, from the part along the first pin

Rates and second rates of the angles follow from the closure differentiated, projected on both pins."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.documents.blocks import escaped
from mbdae.reports.mechanisms.over_input import OverInput
from mbdae.reports.page import NEXT_TO_ZERO
from mbdae.reports.vectors import ZERO
from mbdae.symbolic.frames import Frame, NodeKind
from mbdae.symbolic.motion import Motion, Step, symbolic_steps, turned
from mbdae.symbolic.vectors import UNIT, Expr, Vec
from mbdae.symbolic.vectors import ZERO as NONE
from mbdae.system.model.nodes import Instance, Node, quaternion, rotation_matrices
from mbdae.system.prepare import Prepared

Axes = tuple[Vec, Vec, Vec]


class Pose(NamedTuple):
    """Where a body is: its centre, its axes and its angular velocity, in inertial components."""

    centre: Vec
    axes: Axes
    spin: Vec

    def turned(self, a: Any) -> Vec:
        """A vector of the body in inertial components."""
        found: Vec = self.axes[0] * a[0] + self.axes[1] * a[1] + self.axes[2] * a[2]
        return found

    def point(self, a: Any) -> Vec:
        """The place of a point of the body."""
        found: Vec = self.centre + self.turned(a)
        return found

    @property
    def x(self) -> Expr:
        """The coordinate of a joint's node, which has no axes."""
        return self.centre[0]


class SpatialLink(NamedTuple):
    """A joint between two bodies, None for the ground, by the steps of its motion from k to l. frames: its axes on k and l, in
    body axes; at, Q: its points and frames in numbers."""

    item: str
    k: Node | None
    l: Node | None
    points: tuple[Vec, Vec]
    frames: tuple[Axes, Axes]
    at: tuple[Any, Any]
    Q: tuple[Any, Any]
    steps: tuple[Step, ...]

    @property
    def coordinates(self) -> list[str]:
        """Names of its coordinates that are no free rotations."""
        return list(dict.fromkeys(str(s) for step in self.steps for s in sorted(step.amount.free_symbols, key=str)))

    @property
    def coordinate(self) -> str:
        """Its only coordinate; "" where it has none or several."""
        return names[0] if len(names := self.coordinates) == 1 and not self.ball else ""

    @property
    def ball(self) -> bool:
        """Whether it leaves a free rotation."""
        return any(step.rotation is not None for step in self.steps)

    @property
    def turn(self) -> int:
        """1 where its coordinate is an angle."""
        return int(any(step.turns and step.amount == se.Symbol(self.coordinate) for step in self.steps))

    @property
    def slide(self) -> Step | None:
        """Its only step, where this is a displacement by a coordinate."""
        return self.steps[0] if len(self.steps) == 1 and not self.turn and self.coordinate and self.steps[0].amount.is_Symbol else None

    @property
    def cross(self) -> bool:
        """Whether it is two turns about axes at right angles."""
        return len(self.steps) == len(self.coordinates) == 2 and not self.ball and all(
            s.turns and s.amount.is_Symbol for s in self.steps) and self.steps[0].axis @ self.steps[1].axis == 0

    def side(self, node: Node | None) -> int:
        """0 for k, 1 for l."""
        return 0 if node is self.k else 1

    def towards(self, node: Node | None) -> Motion:
        """Its motion from the other body to this one."""
        return Motion(self.steps) if node is self.l else Motion(self.steps).inverse()


class Leg(NamedTuple):
    """A leg from a cross on `base` to a ball on `end`, of one body or of two with a slide."""

    cross: SpatialLink
    ball: SpatialLink
    slide: SpatialLink | None
    base: Node | None
    end: Node | None
    first: Node
    second: Node


class InSpace(OverInput):
    """The closed forms of a mechanism in space, as functions of one input. Raises ValueError, with the reason, where the bodies do
    not follow from one another."""

    KINDS = (NodeKind.SPATIAL,)
    GROUND = Pose(NONE, UNIT, NONE)

    def __init__(self, prepared: Prepared) -> None:
        self.angles: dict[str, dict[str, Expr]] = {}  #: coordinates of joints that have several, by item
        super().__init__(prepared)

    # -- the joints

    def _link(self, instance: Instance, joint: Any) -> SpatialLink:
        steps, n = symbolic_steps(joint), instance.numbers
        if steps is None:
            raise ValueError(f"{escaped(instance.item)} states no motion")
        points, frames, at, Q = [], [], [], []
        for side in "kl":
            points.append(Vec(*self.number_of(instance, side, "p1", "p2", "p3")))
            frames.append(tuple(Vec(*self.number_of(instance, side, *(f"Q{a}{i}" for i in (1, 2, 3)))) for a in "xyz"))
            at.append(np.array([n[f"{side}_p{i}"] for i in (1, 2, 3)]))
            Q.append(np.array([[n[f"{side}_Q{a}{i}"] for a in "xyz"] for i in (1, 2, 3)]))
        return SpatialLink(instance.item, instance.nodes[0], instance.nodes[1], (points[0], points[1]), (frames[0], frames[1]),
                           (at[0], at[1]), (Q[0], Q[1]), steps)

    def _may_drive(self, link: Any) -> bool:
        return bool(link.coordinate)

    def _known(self, link: Any) -> bool:
        return not link.ball and (len(link.coordinates) == 0 or link.item in self.amounts or link.item in self.angles)

    def _frame(self, link: SpatialLink, node: Node | None) -> Axes:
        """Axes of a joint on a known body, in inertial components."""
        x, y, z = (self.placed[node].turned(column) for column in link.frames[link.side(node)])
        return x, y, z

    def _amount(self, link: Any) -> Expr:
        k, l, step = self.placed[link.k], self.placed[link.l], next(s for s in link.steps if s.amount == se.Symbol(link.coordinate))
        ak, al = self._frame(link, link.k), self._frame(link, link.l)
        if not step.turns:
            return step.direction(ak) @ (l.point(link.points[1]) - k.point(link.points[0]))
        p = UNIT[int(np.argmin([abs(float(c)) for c in step.axis]))]
        p = p - step.axis * (p @ step.axis)
        q = step.axis.cross(p)
        (kp, kq), lp = ((ak[0] * a[0] + ak[1] * a[1] + ak[2] * a[2] for a in (p, q)), al[0] * p[0] + al[1] * p[1] + al[2] * p[2])
        return se.atan2(kq @ lp, kp @ lp)

    # -- the bodies

    def coordinates_of(self, node: Node) -> list[tuple[Expr, Expr, Expr]]:
        return super().coordinates_of(node) if node.kind is NodeKind.COORDINATE else [
            self.moving(f"x{at}", (v.letter, f"_{v.below}"), v.unit, v.of)
            for at in range(node.u, node.u + 3) for v in [self.velocities[at]]]

    def _defined(self, name: str, latex: str, unit: str, meaning: str, e: Expr) -> Expr:
        """A letter with its formula; 0, 1 and -1 are written as such."""
        if e in (0, 1, -1):
            return e
        self.letter(name, latex, unit, meaning)
        return self.follow(name, e)

    def _vector(self, name: str, latex: str, unit: str, meaning: str, e: Vec, spin: Vec | None = None) -> Vec:
        """Letters for the components of a vector (% in latex); spin: the angular velocity of what it is fixed to."""
        found = Vec(*(self._defined(f"{name}_{i}", latex.replace("%", "xyz"[i]), unit, f"{meaning}, component {'xyz'[i]}",
                                    se.expand(c)) for i, c in enumerate(e)))
        if spin is not None:
            self.rates |= {s: rate for s, rate in zip(found, spin.cross(found), strict=True) if s.is_Symbol}
        return found

    def _place(self, node: Node, link: Any, known: Node | None, amount: Expr, angle: Expr | None = None) -> None:
        """Define a body on a known one: its axes, its angular velocity and its centre."""
        amounts = {se.Symbol(c): e for c, e in (self.angles.get(link.item) or {link.coordinate: amount}).items()}
        axes, spin = self._frame(link, known), self.placed[known].spin
        motion, at = link.towards(node).substituted(amounts), self._frame(link, known)
        moved, there = motion.pose(axes)
        for step in motion.steps:
            if step.turns:
                spin = spin + step.direction(at) * self.rate(step.amount)
                at = turned(at, step)
        said, body = self.names.said("node", node.name), escaped(node.name)
        w = Vec(*(self._spin(node, i, said, c) for i, c in enumerate(spin)))
        own = link.frames[link.side(node)]
        columns = []
        for j in range(3):
            column = there[0] * own[0][j] + there[1] * own[1][j] + there[2] * own[2][j]
            columns.append(self._vector(f"R{node.u}{j}", f"R^{{{said}}}_{{%{j + 1}}}", "1", f"axis {'xyz'[j]} of {node.name}", column, w))
        self.placed[node] = Pose(NONE, (columns[0], columns[1], columns[2]), w)
        e = self.placed[known].point(link.points[link.side(known)]) + moved - self.placed[node].turned(link.points[link.side(node)])
        letters = self.coordinates_of(node)
        for s, c in zip(letters, e, strict=True):
            self.with_rates(s, c)
        self.placed[node] = Pose(Vec(*(s[0] for s in letters)), self.placed[node].axes, w)
        dw = Vec(*(self.rates.get(c, ZERO) for c in w))
        for j in range(3):
            for d, e in (("d", w), ("dd", dw)):
                v = self.velocities[node.u + 3 + j]
                self.letter(f"x{node.u + 3 + j}{d}", f"\\{d}ot{{{v.letter}}}_{v.below}", "rad/s" if d == "d" else "rad/s^2",
                            f"{'angular velocity' if d == 'd' else 'angular acceleration'} of {body} about its axis {'xyz'[j]}")
                self.follow(f"x{node.u + 3 + j}{d}", columns[j] @ e)

    def _spin(self, node: Node, i: int, said: str, e: Expr) -> Expr:
        """A component of an angular velocity, with its rate."""
        if (e := se.expand(e)) == 0:
            return ZERO
        name, of = f"om{node.u}_{i}", f"of {node.name} along the inertial axis {'xyz'[i]}"
        w = self.letter(name, f"\\omega^{{{said}}}_{{{'xyz'[i]}}}", "rad/s", f"angular velocity {of}")
        dw = self.letter(f"{name}d", f"\dot{{\\omega}}^{{{said}}}_{{{'xyz'[i]}}}", "rad/s^2", f"angular acceleration {of}")
        self.rates[w] = dw
        self.with_rates((w, dw), e)  # type: ignore[arg-type]
        return w

    # -- legs

    def _dyad(self) -> bool:
        """A leg whose ends are known, or whose length is and that holds a body on a joint with one coordinate."""
        for leg in self._legs():
            known = [end in self.placed for end in (leg.base, leg.end)]
            if all(known):
                self._close_leg(leg)
                return True
            if any(known) and (leg.slide is None or leg.slide.item in self.amounts):
                held = leg.base if known[1] else leg.end
                for hinge in self.links:
                    other = hinge.l if hinge.k is held else hinge.k
                    if held in (hinge.k, hinge.l) and other in self.placed and hinge.coordinate and len(hinge.steps) == 1 \
                            and hinge.steps[0].amount.is_Symbol and hinge.item not in self.amounts:
                        self._swing(leg, hinge, held, other)
                        return True
        return False

    def _legs(self) -> list[Leg]:
        """Legs whose bodies are not known yet."""
        found = []
        for cross in (link for link in self.links if link.cross and link.item not in self.angles):
            for ball in (link for link in self.links if link.ball and len(link.steps) == 1):
                for base, first in ((cross.k, cross.l), (cross.l, cross.k)):
                    for end, second in ((ball.k, ball.l), (ball.l, ball.k)):
                        if first is None or second is None or first in self.placed or second in self.placed:
                            continue
                        slide = next((x for x in self.links if x.slide and {x.k, x.l} == {first, second}), None)
                        if first is second or slide is not None:
                            found.append(Leg(cross, ball, None if first is second else slide, base, end, first, second))
        return found

    def _arm(self, leg: Leg) -> tuple[Any, Any]:
        """Numbers: the vector from the cross to the ball at the amount 0 of the slide, and what an amount of 1 adds, in axes of the
        cross on the leg."""
        i, j = leg.cross.side(leg.first), leg.ball.side(leg.second)
        start, end = leg.cross.at[i], leg.ball.at[j]
        back = leg.cross.Q[i].T
        if leg.slide is None:
            return back @ (end - start), np.zeros(3)
        a, b = leg.slide.side(leg.first), leg.slide.side(leg.second)
        Qa, Qb, step = leg.slide.Q[a], leg.slide.Q[b], leg.slide.slide
        assert step is not None
        across = Qa @ Qb.T  # from axes of the second body to those of the first
        along = Qa @ [float(c) for c in step.axis] * (1 if b == 1 else -1)
        return back @ (leg.slide.at[a] - start + across @ (end - leg.slide.at[b])), back @ along

    def _numbers(self, name: str, latex: str, unit: str, meaning: str, values: Any) -> Vec:
        """Letters for the components of a vector of numbers."""
        return Vec(*(self.constant(f"{name}_{i}", latex.replace("%", "xyz"[i]), float(v), unit, f"{meaning}, component {'xyz'[i]}")
                     for i, v in enumerate(values)))

    def _begin(self, leg: Leg) -> tuple[int, Vec, Vec, Expr, Expr, Expr]:
        """Number of a leg; its vector at the amount 0 of the slide and what an amount of 1 adds, in axes of the cross; its length
        but for the amount, the amount, and the offset of the slide's axis from the ends."""
        self.dyads += 1
        n, (w, e) = self.dyads, self._arm(leg)
        arm = self._numbers(f"w{n}", f"w^{{({n})}}_{{%}}", "m", f"leg {n} from cross to ball, in axes of the cross", w)
        if leg.slide is None:
            length = self.constant(f"le{n}", f"\ell^{{({n})}}", float(np.linalg.norm(w)), "m", f"length of leg {n}")
            return n, arm, NONE, length, ZERO, ZERO
        along = self._numbers(f"e{n}", f"e^{{({n})}}_{{%}}", "1", f"direction of the slide of leg {n}, in axes of the cross", e)
        rest = self.constant(f"le{n}", f"\ell^{{({n})}}_0", float(w @ e), "m", f"length of leg {n} where its slide is at 0")
        beside = self.constant(f"h{n}r", f"h^{{({n})}}", float(np.linalg.norm(w - e * (w @ e))), "m", f"offset of the slide of leg {n}")
        amount = self.amounts.get(leg.slide.item) or self._coordinate(leg.slide)[0]
        return n, arm, along, rest, amount, beside

    def _coordinate(self, link: SpatialLink) -> tuple[Expr, Expr, Expr]:
        """Letters of the coordinate of a joint with its rates."""
        below = f"_{{{self.names.said('item', link.item)}}}"
        return self.moving(f"sl{link.item}", (r"\varphi" if link.turn else "u", below), "rad" if link.turn else "m",
                           f"{link.coordinate} of {link.item}")

    def _swing(self, leg: Leg, hinge: SpatialLink, held: Node, other: Node | None) -> None:
        """The coordinate of the joint of a body that a leg of known length holds."""
        names = [escaped(x.item) for x in (leg.cross, leg.ball, hinge)]
        self.say(f"The length of the leg from {names[0]} to {names[1]} is known; it holds {escaped(held.name)} on {names[2]}:")
        n, _, _, length, amount, beside = self._begin(leg)
        length = length + amount
        (near, far), start = ((leg.cross, leg.ball), leg.end) if held is leg.base else ((leg.ball, leg.cross), leg.base)
        b = self._numbers(f"b{n}s", f"b^{{({n})}}_{{%}}", "m", f"from {hinge.item} to {near.item}, in axes of {hinge.item} on its body",
                          hinge.Q[hinge.side(held)].T @ (near.at[near.side(held)] - hinge.at[hinge.side(held)]))
        q = self._coordinate(hinge)
        motion = hinge.towards(held).substituted({se.Symbol(hinge.coordinate): q[0]})
        step, axes = motion.steps[0], self._frame(hinge, other)
        base = self.placed[other].point(hinge.points[hinge.side(other)])
        A = self.placed[start].point(far.points[far.side(start)])
        m = self._vector(f"m{n}", f"m^{{({n})}}_{{%}}", "m", f"from {hinge.item} to {far.item}, in axes of {hinge.item}",
                         Vec(*(a @ (A - base) for a in axes)))
        h = step.axis * (1 if step.amount == q[0] else -1)
        rest = (b @ b + m @ m - length**2 - beside**2) / 2
        if hinge.turn:
            aside = (m @ h) * (b @ h)
            self._angle_by(q, m @ b - aside, m @ h.cross(b), rest - aside, "m^2",
                           f"the line from {names[0]} to {names[1]} meets the axis of {names[2]}, or is along it")
        else:
            self._slide_by(n, q[0], h @ (b - m), rest - b @ m, f"the line from {names[0]} to {names[1]} is normal to {names[2]}")
        moved, there = motion.pose(axes)
        e = base + moved + there[0] * b[0] + there[1] * b[1] + there[2] * b[2] - A
        D = self._vector(f"D{n}", f"D^{{({n})}}_{{%}}", "m", f"between the ends of leg {n}", e)
        self.letter(f"De{n}", f"\Delta_{{{n}}}", "m^2" if hinge.turn else "m",
                    f"part of the distance of the ends of leg {n} along a motion of {hinge.item}, 0 at its dead centre")
        self.apart[f"De{n}"] = ""
        det = self.follow(f"De{n}", D @ Vec(*(se.diff(c, q[0]) for c in e)))
        de = Vec(*map(self.rate, e))
        change = self.rate(length)
        self.follow(str(q[1]), (length * change - D @ _without(de, q[1])) / det)
        dD = self._vector(f"D{n}d", f"\dot{{D}}^{{({n})}}_{{%}}", "m/s", f"rate between the ends of leg {n}", de)
        dde = _without(Vec(*map(self.rate, de)), q[2])
        self.follow(str(q[2]), (change**2 + length * self.rate(change) - dD @ dD - D @ dde) / det)
        self.amounts[hinge.item] = q[0]

    def _slide_by(self, n: int, q: Expr, half: Expr, rest: Expr, dead: str) -> None:
        """A displacement by q^2 / 2 + half q + rest = 0, on the side on which it starts."""
        self.letter(f"B{n}", f"B^{{({n})}}", "m", f"minus the displacement of dyad {n} at its dead centre")
        B = self.follow(f"B{n}", half)
        self.letter(f"S{n}", f"S^{{({n})}}", "m", f"distance of dyad {n} from its dead centre")
        side = self.start_of(q + B)
        if abs(side) < NEXT_TO_ZERO * self.prepared.length:
            raise ValueError(f"it starts at a dead centre: {dead}")
        S = self.follow(f"S{n}", se.sqrt(B**2 - 2 * rest))
        self.limits[f"S{n}"] = dead
        self.follow(str(q), -B + (S if side > 0 else -S))

    def _close_leg(self, leg: Leg) -> None:
        """The angles of the cross of a leg between known ends, and its length where a slide makes it."""
        names = [escaped(x.item) for x in (leg.cross, leg.ball)]
        self.say(f"The leg between {names[0]} and {names[1]}, whose ends are known:")
        n, arm, along, rest, amount, beside = self._begin(leg)
        start = self.placed[leg.base]
        e = self.placed[leg.end].point(leg.ball.points[leg.ball.side(leg.end)]) \
            - start.point(leg.cross.points[leg.cross.side(leg.base)])
        letters = [self.moving(f"D{n}_{i}", ("D", f"^{{({n})}}_{{{'xyz'[i]}}}"), "m",
                               f"leg {n} from cross to ball, component {'xyz'[i]}") for i in range(3)]
        for s, c in zip(letters, e, strict=True):
            self.with_rates(s, se.expand(c))
        D, dD, ddD = (Vec(*(s[i] for s in letters)) for i in range(3))
        if leg.slide is not None and leg.slide.item not in self.amounts:
            self.letter(f"l{n}ength", f"\ell^{{({n})}}", "m", f"length of leg {n} along its slide")
            sign = 1 if self.start_of(rest + amount) > 0 else -1
            length = self.follow(f"l{n}ength", se.sqrt(D @ D - beside**2))
            self.apart[f"l{n}ength"] = ""
            rate = self.rates[amount]
            self.follow(str(amount), sign * length - rest)
            self.follow(str(rate), sign * (D @ dD) / length)
            self.follow(str(self.rates[rate]), sign * (dD @ dD + D @ ddD - rate**2) / length)
            self.amounts[leg.slide.item] = amount
        self._pins(leg, n, arm + along * amount, along, amount, D, dD)

    def _pins(self, leg: Leg, n: int, arm: Vec, along: Vec, amount: Expr, D: Vec, dD: Vec) -> None:
        """The angles about the pins of a cross, with their rates. arm: the leg in axes of the cross."""
        item, axes, spin = leg.cross.item, self._frame(leg.cross, leg.base), self.placed[leg.base].spin
        steps = leg.cross.towards(leg.first).steps
        said, q = self.names.said("item", item), []
        for letter, step in zip((r"\alpha", r"\gamma"), steps, strict=True):
            (symbol,) = step.amount.free_symbols
            q.append(self.moving(f"an{item}_{symbol}", (letter, f"_{{{said}}}"), "rad", f"{symbol} of {item}"))
        i, j = (step.axis * (1 if step.amount.is_Symbol else -1) for step in steps)
        k = i.cross(j)
        e1 = self._vector(f"pa{n}", f"a^{{({n})}}_{{%}}", "1", f"first pin of {item}", _along(axes, i), spin)
        side = [_along(axes, a) for a in (j, k)]
        self._angle_by(q[1], arm @ i, arm @ k, D @ e1, "m", f"the line between the ends is along the first pin of {escaped(item)}")
        of_j, of_k = arm @ j, (arm @ k) * se.cos(q[1][0]) - (arm @ i) * se.sin(q[1][0])
        at_j, at_k = D @ side[0], D @ side[1]
        self.follow(str(q[0][0]), se.atan2(of_j * at_k - of_k * at_j, of_j * at_j + of_k * at_k))
        e2 = self._vector(f"pb{n}", f"b^{{({n})}}_{{%}}", "1", f"second pin of {item}",
                          side[0] * se.cos(q[0][0]) + side[1] * se.sin(q[0][0]), spin + e1 * q[0][1])
        v = dD - spin.cross(D)
        if along.c != NONE.c:
            there = Motion(steps).substituted({next(iter(s.amount.free_symbols)): c[0] for s, c in zip(steps, q, strict=True)}).pose(axes)
            e3 = self._vector(f"pc{n}", f"c^{{({n})}}_{{%}}", "1", f"direction of the slide of leg {n}", _along(there[1], along),
                              spin + e1 * q[0][1] + e2 * q[1][1])
            v = v - e3 * self.rate(amount)
        self.letter(f"De{n}", f"\Delta_{{{n}}}", "m", f"part of leg {n} normal to both pins, 0 at its dead centre")
        self.apart[f"De{n}"] = f"the line between the ends lies in the plane of the pins of {escaped(item)}"
        det = self.follow(f"De{n}", e2 @ e1.cross(D))
        for order, what in ((1, "velocity"), (2, "acceleration")):
            if order == 2:
                dv = Vec(*map(self.rate, v))
                v = dv - Vec(*map(self.rate, e1.cross(D))) * q[0][1] - Vec(*map(self.rate, e2.cross(D))) * q[1][1]
            h = self._vector(f"h{n}{order}", f"h^{{({n},{order})}}_{{%}}", f"m/s^{order}" if order > 1 else "m/s",
                             f"{what} of the ball of leg {n} that the angles make", v)
            self.follow(str(q[0][order]), (e2 @ h) / det)
            self.follow(str(q[1][order]), -(e1 @ h) / det)
        self.angles[item] = {str(next(iter(s.amount.free_symbols))): c[0] for s, c in zip(steps, q, strict=True)}

    # -- values

    def _rate_of(self, link: Any) -> Expr:
        letter = self.amounts.get(link.item, ZERO)
        return self.rates[letter] if letter in self.rates else self.rate(self._amount(link))

    def _shown(self, link: Any) -> bool:
        return bool(link.coordinate)

    def _unknowns_of(self, f: Frame, node: Node) -> dict[Expr, Expr]:
        place = self.placed[node]
        if node.kind is NodeKind.COORDINATE:
            return {f.q[0]: place.x}
        found = dict(zip(f.q, place.centre, strict=False))
        for a, b in zip(f.body, place.axes, strict=True):
            found |= dict(zip(a, b, strict=True))
        return found

    def _bodies(self) -> list[Node]:
        return [n for n in self.prepared.model.nodes if n.kind is NodeKind.SPATIAL]

    def _unplaced(self, node: Node) -> Any:
        if node.kind is NodeKind.COORDINATE:
            return super()._unplaced(node)
        axes = tuple(Vec(*(se.Symbol(f"R{node.u}{j}_{i}") for i in range(3))) for j in range(3))
        w = Vec(*(se.Symbol(f"om{node.u}_{i}") for i in range(3)))
        for s, d in zip(w, range(3), strict=True):
            self.rates.setdefault(s, se.Symbol(f"om{node.u}_{d}d"))
        for a in axes:
            for s, rate in zip(a, w.cross(a), strict=True):
                self.rates.setdefault(s, rate)
        return Pose(Vec(*(se.Symbol(f"x{node.u + i}") for i in range(3))), axes, w)  # type: ignore[arg-type]

    def states_as_letters(self, q: Any, u: Any, change: Any) -> dict[str, Any]:
        found = dict[str, Any]()
        for node in self.prepared.model.nodes:
            size, at = node.kind.sizes, node.u
            for i in range(node.kind.translations):
                found |= {f"x{at + i}": q[:, node.q + i]}
            for i in range(size[1]):
                found |= {f"x{at + i}d": u[:, at + i], f"x{at + i}dd": change[:, at + i]}
            if node.kind is NodeKind.COORDINATE:
                found[f"x{at}"] = q[:, node.q]
                continue
            R = rotation_matrices(q[:, node.q + 3 : node.q + 7])
            w, dw = (np.einsum("tij,tj->ti", R, x[:, at + 3 : at + 6]) for x in (u, change))
            found |= {f"R{at}{j}_{i}": R[:, i, j] for i in range(3) for j in range(3)}
            found |= {f"om{at}_{i}{d}": x[:, i] for d, x in (("", w), ("d", dw)) for i in range(3)}
        return found

    def start_letters(self) -> dict[str, Any]:
        found = super().start_letters()
        for link in (x for x in self.links if x.cross):
            ends = [np.eye(3) if node is None else np.array([[found[f"R{node.u}{j}_{i}"][0] for j in range(3)] for i in range(3)])
                    for node in (link.k, link.l)]
            M = link.Q[0].T @ ends[0].T @ ends[1] @ link.Q[1]
            (i, a), (j, b) = (((np.array(s.axis.c, float)), str(s.amount)) for s in link.steps)
            n = np.cross(i, j)
            found |= {f"an{link.item}_{a}": np.arctan2(n @ M @ j, j @ M @ j), f"an{link.item}_{b}": np.arctan2(i @ M @ n, i @ M @ i)}
        return found

    def states_of(self, table: dict[str, Any]) -> tuple[Any, Any]:
        nt = len(table[str(self.inputs[0])])
        q, u = np.zeros((nt, len(self.prepared.start.q))), np.zeros((nt, len(self.prepared.start.u)))
        for node in self.prepared.model.nodes:
            at = node.u
            for i in range(1 if node.kind is NodeKind.COORDINATE else 3):
                q[:, node.q + i] = table[f"x{at + i}"]
            for i in range(node.kind.sizes[1]):
                u[:, at + i] = table[f"x{at + i}d"]
            if node.kind is not NodeKind.COORDINATE:
                R = np.stack([np.stack([np.broadcast_to(self._of(table, c), (nt,)) for c in a], -1) for a in self.placed[node].axes], -1)
                q[:, node.q + 3 : node.q + 7] = quaternion(R)
        return q, u


def _along(axes: Axes, a: Vec) -> Vec:
    """A vector by its components along axes."""
    found: Vec = axes[0] * a[0] + axes[1] * a[1] + axes[2] * a[2]
    return found


def _without(e: Vec, s: Expr) -> Vec:
    return Vec(*(c.subs({s: ZERO}) for c in e))
