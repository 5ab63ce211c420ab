"""Symbols of joints, chosen by the relative motion that a joint allows: axes of rotation, directions of sliding.

One axis is drawn as a pin, two as a cross in two forks, three as a ball; one direction as a guide with a slider, two as a plane.
A thread is drawn where one coordinate turns and slides. Joints that state no motion have symbols of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.laws.forces import JointLoad, JointSpring
from mbdae.laws.joints import Distance
from mbdae.scene.components import Array, Connection
from mbdae.show import symbols
from mbdae.show.collected import Collected, ends
from mbdae.symbolic.joint import Joint
from mbdae.system.model.joint_motion import JointMotion

SLIGHT = 1e-9  #: bound below which rates (m or rad per unit of a coordinate) and sines of angles count as zero


@dataclass(frozen=True)
class Freedom:
    """Motion of l relative to k that a joint allows, as drawn: for each coordinate the velocity (3,) of l's point (m/s) and the
    angular velocity (3,) (rad/s) per unit rate; ball: whether l turns about all axes."""

    rates: dict[str, tuple[Array, Array]]
    ball: bool

    @cached_property
    def slides(self) -> list[Array]:
        """Unit vectors (3,) along which l slides, without duplicates."""
        return _directions([v for v, _ in self.rates.values()])

    @cached_property
    def turns(self) -> list[Array]:
        """Unit vectors (3,) about which l turns, without duplicates."""
        return list(np.eye(3)) if self.ball else _directions([w for _, w in self.rates.values()])

    @property
    def thread(self) -> float:
        """1 or -1 where one coordinate turns l and moves it along the same axis, right- or left-handed; else 0."""
        return next((float(np.sign(v @ w)) for v, w in self.rates.values() if abs(v @ w) > SLIGHT**2), 0.0)


def freedom(item: Connection) -> Freedom | None:
    """The motion that a joint allows; None where it states no motion."""
    law: Any = (item.as_kinematic or item.laws)[0] if item.loose else item.joint
    if not isinstance(law, Joint) or not law.states_motion():
        return None
    motion = JointMotion(item)
    ball = law.scalars().keys() != law.coordinates.keys()
    return Freedom({c: motion.rates({}, {c: 1.0})[1:] for c in law.scalars()}, ball)


def _directions(vectors: list[Array]) -> list[Array]:
    found: list[Array] = []
    for v in vectors:
        if np.linalg.norm(v) > SLIGHT and not any(np.linalg.norm(np.cross(symbols.unit(v), e)) < SLIGHT for e in found):
            found.append(symbols.unit(v))
    return found


class JointShapes(Collected):
    """Draws joints."""

    def _joint(self, item: Connection) -> None:
        free = freedom(item)
        if free is None:
            self._by_rows(item, item.joint)
        else:
            self._by_motion(item, free)
        at, at_l = ends(item)
        if item.k.is_ground and (free is None or len(free.slides) in (0, 2)):
            self._ground(item.name, at)
        if item.l.is_ground:
            self._ground(item.name, at_l)

    # -- joints that state no motion, drawn by the rows they hold

    def _by_rows(self, item: Connection, law: Any) -> None:
        if isinstance(law, Distance):
            self._marked(item, "dot", item.k)
            self._marked(item, "dot", item.l)
            ways = [self._over_time(body, at) for body, at in zip((item.k, item.l), ends(item), strict=True)]
            self._add(item.name, "dashed", np.stack(ways, 1))
        else:
            self._marked(item, "pin", item.k)
            if not self.planar:
                self._add(item.name, "guide", law.at + np.outer([-5, 5], self.mark * law.axis), item.k)

    # -- joints drawn by their motion

    def _by_motion(self, item: Connection, free: Freedom) -> None:
        slides, turns = free.slides, free.turns
        if len(slides) == 1:
            self._guide(item, slides[0], free.thread)
        elif len(slides) == 2:
            self._plane(item, slides)
        elif len(slides) == 3:
            self._marked(item, "dot" if turns else "lock", item.k)
        if not (slides or turns):
            self._marked(item, "weld", item.k)
        elif len(turns) == 1:
            self._pin(item, turns[0], slides)
        elif len(turns) == 2:
            self._cross(item, turns)
        elif turns and len(slides) < 3:
            self._marked(item, "ball", item.l if slides else item.k)
        if (len(slides) in (1, 2) and not turns) or _along(turns, slides):
            self._slider(item, slides[0])
        for c, (v, w) in free.rates.items():
            self._on_coordinate(item, c, v, w)

    def _pin(self, item: Connection, axis: Array, slides: list[Array]) -> None:
        """Draw a pin, in space with a ring about its axis; only a ring for a sleeve that turns about its guide."""
        body, at = (item.l, ends(item)[1]) if slides else (item.k, ends(item)[0])
        sleeve = _along([axis], slides)
        if not sleeve:
            self._add(item.name, "pin", np.array([at]), body)
        if not self.planar:
            size = (1.7 if sleeve else 1.2) * self.mark
            e1, e2 = (size * e for e in symbols.plane_of(axis))
            self._add(item.name, "line", symbols.circle(at, e1, e2), body)
            if not sleeve:
                self._add(item.name, "line", at + np.outer([-2.5, 2.5], self.mark * axis), body)

    def _cross(self, item: Connection, turns: list[Array]) -> None:
        """Draw two crossed pins, the first in a fork of k, the second in a fork of l."""
        at, at_l = ends(item)
        normal = symbols.unit(np.cross(turns[0], turns[1]))
        away = at - item.k.drawn.position if item.l.is_ground else item.l.drawn.position - at_l
        back = (1.0 if normal @ away < 0 else -1.0) * 1.6 * self.mark * normal
        self._add(item.name, "line", symbols.yoke(at, 1.6 * self.mark * turns[0], back), item.k)
        self._add(item.name, "line", symbols.yoke(at_l, 1.6 * self.mark * turns[1], -back), item.l)
        self._marked(item, "dot", item.k)

    def _guide(self, item: Connection, along: Array, thread: float) -> None:
        """Draw the guide of a slider on k, with a ground symbol at its start, and a thread about it."""
        low, high = self._reach(item, along)
        at = item.joint.at
        self._add(item.name, "guide", at + np.outer([low, high], along), item.k)
        if thread:
            ends_of = (at + low * along, at + high * along)
            self._add(item.name, "thin", symbols.helix(*ends_of, 0.6 * self.mark, thread * self.mark), item.k)
        if item.k.is_ground and not any(isinstance(law, JointSpring) and law.unit == "m" for law in item.laws):
            self._ground(item.name, at + low * along, self._aside(along))

    def _plane(self, item: Connection, along: list[Array]) -> None:
        """Draw the plane on k in which l slides, as large as the displacement of l."""
        (a, b), (c, d) = (self._reach(item, e) for e in along)
        corners = [x * along[0] + y * along[1] for x, y in ((a, c), (b, c), (b, d), (a, d), (a, c))]
        self._add(item.name, "guide", item.joint.at + np.array(corners), item.k)

    def _slider(self, item: Connection, along: Array) -> None:
        box = symbols.slider(item.joint.at, along, 3 * self.mark, 1.8 * self.mark, self.planar)
        self._add(item.name, "box", box, item.l)

    def _aside(self, axis: Array) -> Array:
        side = symbols.across(axis)
        return -side if side @ self.down < 0 else side

    def _reach(self, item: Connection, along: Array) -> tuple[float, float]:
        """Smallest and largest position of l along a direction fixed to k, m from the joint as drawn, and room for its symbol."""
        at = item.joint.at
        apart = self._over_time(item.l, at) - self._over_time(item.k, at)
        axis = self._over_time(item.k, at + along) - self._over_time(item.k, at)
        way = np.einsum("ti,ti->t", apart, axis)
        return float(way.min() - 2.5 * self.mark), float(way.max() + 2.5 * self.mark)

    # -- springs, drives and loads on a coordinate

    def _on_coordinate(self, item: Connection, c: str, v: Array, w: Array) -> None:
        """Draw springs on a coordinate, and a turning arrow where its angle is prescribed or a torque acts."""
        acting = [law for law in item.laws if isinstance(law, JointSpring | JointLoad) and law.name_of_coordinate == c]
        sprung = any(isinstance(law, JointSpring) for law in acting)
        at = item.joint.at
        if item.unit(c) == "m" and sprung and np.any(v):
            along = symbols.unit(v)
            anchor = at + (self._reach(item, along)[0] - 7 * self.mark) * along
            self._spring_between(item, anchor, at)
            if item.k.is_ground:
                self._ground(item.name, anchor, -along)
        if item.unit(c) != "rad" or not np.any(w):
            return
        axis = symbols.unit(w)
        if sprung:
            self._add(item.name, "thin", symbols.spiral(at, axis, 1.8 * self.mark), item.k)
        if getattr(item.prescribed.get(c), "free_symbols", None) or any(isinstance(law, JointLoad) for law in acting):
            self._add(item.name, "arrow", symbols.turning_arrow(at, axis, 2.6 * self.mark), item.k)


def _along(turns: list[Array], slides: list[Array]) -> bool:
    """Whether the only axis of rotation is also the only direction of sliding, as of a sleeve."""
    return len(turns) == len(slides) == 1 and bool(np.linalg.norm(np.cross(turns[0], slides[0])) < SLIGHT)
