"""Legs of a mechanism in space: each lies between a cross with two pins and a ball, one body, or two with a slide between them.

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
from mbdae.reports.mechanisms.space import Spatial, SpatialLink, on_axes
from mbdae.reports.vectors import ZERO
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.vectors import ZERO as NONE
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.system.model.nodes import Node
from mbdae.system.prepare import Prepared


def mechanism(prepared: Prepared) -> OverInput:
    """The closed forms of a mechanism over its input. Raises ValueError, with the reason, where the bodies do not follow from one
    another."""
    return (OverInput if prepared.model.planar else InSpace)(prepared)


class Leg(NamedTuple):
    """A leg from a cross on `base` to a ball on `end`, of one body or of two with a slide."""

    cross: SpatialLink
    ball: SpatialLink
    slide: SpatialLink | None
    base: Node | None
    end: Node | None
    first: Node
    second: Node


class InSpace(Spatial):
    """The closed forms of a mechanism in space, as functions of one input. Raises ValueError, with the reason, where the bodies
    do not follow from one another."""

    def _dyad(self) -> bool:
        """A leg whose ends are known, or whose length is and that holds a body on a joint with one coordinate."""
        for leg in self._legs():
            known = [end in self.placed for end in (leg.base, leg.end)]
            if all(known):
                self._close_leg(leg)
                return True
            if any(known) and (leg.slide is None or leg.slide.item in self.amounts):
                held = leg.base if known[1] else leg.end
                assert held is not None  # the ground is known
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
        """Numbers: the vector from the cross to the ball at the amount 0 of the slide, and what an amount of 1 adds, in axes of
        the cross on the leg."""
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
        return Vec(*(self.constant(f"{name}_{a}", latex.replace("%", a), float(v), unit, f"{meaning}, component {a}")
                     for a, v in zip("xyz", values, strict=True)))

    def _begin(self, leg: Leg) -> tuple[int, Vec, Vec, Expr, Expr, Expr]:
        """Number of a leg; its vector at the amount 0 of the slide and what an amount of 1 adds, in axes of the cross; its length
        but for the amount, the amount, and the offset of the slide's axis from the ends."""
        self.dyads += 1
        n, (w, e) = self.dyads, self._arm(leg)
        arm = self._numbers(f"w{n}", f"w^{{({n})}}_{{%}}", "m", f"leg {n} from cross to ball, in axes of the cross", w)
        if leg.slide is None:
            length = self.constant(f"le{n}", f"\\ell^{{({n})}}", float(np.linalg.norm(w)), "m", f"length of leg {n}")
            return n, arm, NONE, length, ZERO, ZERO
        along = self._numbers(f"e{n}", f"e^{{({n})}}_{{%}}", "1", f"direction of the slide of leg {n}, in axes of the cross", e)
        rest = self.constant(f"le{n}", f"\\ell^{{({n})}}_0", float(w @ e), "m", f"length of leg {n} where its slide is at 0")
        offset = float(np.linalg.norm(w - e * (w @ e)))
        beside = self.constant(f"h{n}r", f"h^{{({n})}}", offset, "m", f"offset of the slide of leg {n}")
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
        what = f"from {hinge.item} to {near.item}, in axes of {hinge.item} on its body"
        b = self._numbers(f"b{n}s", f"b^{{({n})}}_{{%}}", "m", what,
                          hinge.Q[hinge.side(held)].T @ (near.at[near.side(held)] - hinge.at[hinge.side(held)]))
        q = self._coordinate(hinge)
        motion = hinge.towards(held).substituted({se.Symbol(hinge.coordinate): q[0]})
        step, axes = motion.steps[0], self._frame(hinge, other)
        base, A = self._point(hinge, other), self._point(far, start)
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
        self.letter(f"De{n}", rf"\Delta_{{{n}}}", "m^2" if hinge.turn else "m",
                    f"part of the distance of the ends of leg {n} along a motion of {hinge.item}, 0 at its dead centre")
        self.apart[f"De{n}"] = ""
        det = self.follow(f"De{n}", D @ Vec(*(se.diff(c, q[0]) for c in e)))
        de = Vec(*map(self.rate, e))
        change = self.rate(length)
        self.follow(str(q[1]), (length * change - D @ _without(de, q[1])) / det)
        dD = self._vector(f"D{n}d", f"\\dot{{D}}^{{({n})}}_{{%}}", "m/s", f"rate between the ends of leg {n}", de)
        dde = _without(Vec(*map(self.rate, de)), q[2])
        self.follow(str(q[2]), (change**2 + length * self.rate(change) - dD @ dD - D @ dde) / det)
        self.amounts[hinge.item] = q[0]

    def _slide_by(self, n: int, q: Expr, half: Expr, rest: Expr, dead: str) -> None:
        """A displacement by q^2 / 2 + half q + rest = 0, on the side on which it starts."""
        self.letter(f"B{n}", f"B^{{({n})}}", "m", f"minus the displacement of dyad {n} at its dead centre")
        B = self.follow(f"B{n}", half)
        self.letter(f"S{n}", f"S^{{({n})}}", "m", f"distance of dyad {n} from its dead centre")
        S, sign = self._root(n, B**2 - 2 * rest, B**2 + self.prepared.length**2, q + B, self.prepared.length, dead)
        self.follow(str(q), -B + sign * S)

    def _close_leg(self, leg: Leg) -> None:
        """The angles of the cross of a leg between known ends, and its length where a slide makes it."""
        names = [escaped(x.item) for x in (leg.cross, leg.ball)]
        self.say(f"The leg between {names[0]} and {names[1]}, whose ends are known:")
        n, arm, along, rest, amount, beside = self._begin(leg)
        e = self._point(leg.ball, leg.end) - self._point(leg.cross, leg.base)
        letters = [self.moving(f"D{n}_{i}", ("D", f"^{{({n})}}_{{{'xyz'[i]}}}"), "m",
                               f"leg {n} from cross to ball, component {'xyz'[i]}") for i in range(3)]
        for s, c in zip(letters, e, strict=True):
            self.with_rates(s, se.expand(c))
        D, dD, ddD = (Vec(*(s[i] for s in letters)) for i in range(3))
        if leg.slide is not None and leg.slide.item not in self.amounts:
            self.letter(f"l{n}ength", f"\\ell^{{({n})}}", "m", f"length of leg {n} along its slide")
            sign = 1 if self.start_of(rest + amount) > 0 else -1
            length = self.follow(f"l{n}ength", se.sqrt(D @ D - beside**2))
            self.apart[f"l{n}ength"] = ""
            rate = self.rates[amount]
            self.follow(str(amount), sign * length - rest)
            self.follow(str(rate), sign * (D @ dD) / length)
            self.follow(str(self.rates[rate]), sign * (dD @ dD + D @ ddD - rate**2) / length)
            self.amounts[leg.slide.item] = amount
        self._pins(leg, n, arm + along * amount, along, amount, D, dD)

    def _pins(self, leg: Leg, n: int, arm: Vec, direction: Vec, amount: Expr, D: Vec, dD: Vec) -> None:
        """The angles about the pins of a cross, with their rates. arm: the leg in axes of the cross."""
        item, axes, spin = leg.cross.item, self._frame(leg.cross, leg.base), self.placed[leg.base].spin
        steps = leg.cross.towards(leg.first).steps
        said, q, angles = self.names.said("item", item), [], dict[str, Expr]()
        for letter, step in zip((r"\alpha", r"\gamma"), steps, strict=True):
            (symbol,) = step.amount.free_symbols
            q.append(self.moving(f"an{item}_{symbol}", (letter, f"_{{{said}}}"), "rad", f"{symbol} of {item}"))
            angles[str(symbol)] = q[-1][0]
        i, j = (step.axis * (1 if step.amount.is_Symbol else -1) for step in steps)
        k = i.cross(j)
        e1 = self._vector(f"pa{n}", f"a^{{({n})}}_{{%}}", "1", f"first pin of {item}", on_axes(axes, i), spin)
        side = [on_axes(axes, a) for a in (j, k)]
        dead = f"the line between the ends lies along the first pin of {escaped(item)}"
        self._angle_by(q[1], arm @ i, arm @ k, D @ e1, "m", dead)
        where = f"part of leg {n} along the second pin", f"part of leg {n} normal to both pins"
        of_j, of_k, at_j, at_k = (self._defined(f"{letter}{n}{end}", f"{letter}^{{({n})}}{end}", "m", f"{meaning}{of}", e)
                                  for letter, end, meaning, of, e in (
            ("X", "", where[0], "", arm @ j), ("Y", "", where[1], "", (arm @ k) * se.cos(q[1][0]) - (arm @ i) * se.sin(q[1][0])),
            ("X", "_0", where[0], " as it is at the angle 0 of the first", D @ side[0]),
            ("Y", "_0", where[1], " as they are at the angle 0 of the first", D @ side[1])))
        self.follow(str(q[0][0]), se.atan2(of_j * at_k - of_k * at_j, of_j * at_j + of_k * at_k))
        e2 = self._vector(f"pb{n}", f"b^{{({n})}}_{{%}}", "1", f"second pin of {item}",
                          side[0] * se.cos(q[0][0]) + side[1] * se.sin(q[0][0]), spin + e1 * q[0][1])
        v = dD - spin.cross(D)
        if direction.c != NONE.c:
            there = Motion(steps).substituted({se.Symbol(name): e for name, e in angles.items()}).pose(axes)
            e3 = self._vector(f"pc{n}", f"c^{{({n})}}_{{%}}", "1", f"direction of the slide of leg {n}",
                              on_axes(there[1], direction), spin + e1 * q[0][1] + e2 * q[1][1])
            v = v - e3 * self.rate(amount)
        self.letter(f"De{n}", rf"\Delta_{{{n}}}", "m", f"part of leg {n} normal to both pins, 0 at its dead centre")
        self.apart[f"De{n}"] = ""
        det = self.follow(f"De{n}", e2 @ e1.cross(D))
        for order, what in ((1, "velocity"), (2, "acceleration")):
            if order == 2:
                dv = Vec(*map(self.rate, v))
                v = dv - Vec(*map(self.rate, e1.cross(D))) * q[0][1] - Vec(*map(self.rate, e2.cross(D))) * q[1][1]
            h = self._vector(f"h{n}{order}", f"h^{{({n},{order})}}_{{%}}", f"m/s^{order}" if order > 1 else "m/s",
                             f"{what} of the ball of leg {n} that the angles make", v)
            self.follow(str(q[0][order]), (e2 @ h) / det)
            self.follow(str(q[1][order]), -(e1 @ h) / det)
        self.angles[item] = angles


def _without(e: Vec, s: Expr) -> Vec:
    return Vec(*(c.subs({s: ZERO}) for c in e))
