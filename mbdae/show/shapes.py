"""The geometry of a result: bodies, and joints by the motion they allow (`joint_shapes.py`), forces, couplings.

Rigid bodies move by position and rotation, beams by the interpolation of their elements; an item attached to a beam moves with
the section there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.inputs import timed
from mbdae.laws.forces import tangents, wraps_of
from mbdae.results.result import Result
from mbdae.results.sensors import reaction_outputs
from mbdae.scene.components import BeamLoad, Connection, Place
from mbdae.scene.shapes import Plane
from mbdae.show import symbols
from mbdae.show.geometry import INK, Geometry, ends
from mbdae.show.joint_shapes import BodyShapes, JointShapes
from mbdae.show.plots import COLOURS, strips, track
from mbdae.symbolic.joint import Coupling
from mbdae.values import Array, shown

PUSH = "#e6007e"  #: colour of forces of contacts
SLIGHT = 1e-3  #: sine of the angle between a force and a plane below which they do not meet
ARC = 13  #: number of points of a rope on a pulley
ARROWS = 9  #: number of arrows of a distributed load
UNMARKED = ("force", "torque", "spring", "pointspring", "rope")  #: kinds of forces drawn without a marker at their point


def geometry(result: Result, hide: Sequence[str] = ()) -> Geometry:
    """Shapes and names of a result at its times, without the items named in `hide`."""
    return _Builder(result, hide).build()


class _Builder(JointShapes, BodyShapes):
    """Draws bodies, joints, forces and couplings."""

    def build(self) -> Geometry:
        for i, body in enumerate(self.scene.bodies):
            if body.name not in self.hidden:
                self._body(body, body.color or COLOURS[i % (len(COLOURS) - 1)])
        for item in self.shown(self.scene.connections):
            if item.shapes:
                self._contact(touching := self._on_sections(item))
                if not self.planar:
                    self._pushes(touching)
            else:
                self._connection(self._on_sections(item))
        for load in self.shown(self.scene.line_loads):
            self._distributed(load)
        self._planes()
        newtons = self._arrows()
        self._gather()
        if not self.shapes:
            raise OptionError(f"hide = {shown(sorted(self.hidden))} leaves nothing of scene '{self.scene.name}': name fewer "
                              f"items")
        found = (tuple(self.shapes), tuple(self.labels))
        return Geometry(self.scene.name, self.result.t, self.planar, self.size, self.scene.gravity, self.poses, *found, newtons)

    # -- forces and couplings

    def _connection(self, item: Connection) -> None:
        at, at_l = ends(item)
        if isinstance(item.joint, Coupling):
            self._coupling(item, item.joint)
        elif item.is_joint:
            self._joint(item)
        else:
            self._force(item, item.joint)
        if np.linalg.norm(at_l - at) > self.mark:
            middle = (self._over_time(item.k, at) + self._over_time(item.l, at_l)) / 2
            return self._name(item.name, self.scene.ground, middle)
        return self._name(item.name, item.l, at_l)

    def _force(self, item: Connection, law: Any) -> None:
        at, at_l = ends(item)
        if item.kind not in UNMARKED:
            self._marked(item, "dot" if item.kind == "bushing" else "pin", item.k)
        draw = {"rope": self._rope, "spring": self._spring, "pointspring": self._spring, "bushing": self._bushing,
                "force": self._load, "torque": self._load}
        if item.kind in draw:
            draw[item.kind](item, law)
        if item.k.is_ground and item.kind not in ("force", "torque", "bushing"):
            self._ground(item.name, at)
        if item.l.is_ground:
            self._ground(item.name, at_l)

    def _coupling(self, item: Connection, law: Coupling) -> None:
        """Draw a dashed line through the joints whose coordinates are coupled, or a dashed ring where they coincide."""
        joints = [self.scene[joint] for joint, _ in law.coordinates_in(item.name)]
        path = np.stack([self._place_of(joint) for joint in joints], axis=1)
        if np.max(np.ptp(path[0], axis=0)) < self.mark:
            e1, e2 = (2 * self.mark * e for e in symbols.plane_of(law.axis))
            path = path[:, :1] + symbols.circle(np.zeros(3), e1, e2)
        self._add(item.name, "dashed", path)

    def _place_of(self, joint: Connection) -> Array:
        """Position over time (nt, 3), m, of a joint's point on l."""
        at = ends(joint)[1]
        return self.result[Place(joint.l, at)].position if joint.l in self.lines else self._over_time(joint.l, at)

    def _spring(self, item: Connection, law: Any) -> None:
        self._spring_between(item, law.at, law.at_l)

    def _rope(self, item: Connection, law: Any) -> None:
        """Draw the spans along their tangents, arcs on the pulleys, and a circle for every pulley and drum."""
        bodies = [(item.k, law.at), *((body, law.points[side]) for side, body in item.others.items()), (item.l, law.at_l)]
        numbers = [law.radius_k, *(getattr(law, f"radius_{n + 1}") for n in range(law.pulleys)), law.radius_l]
        radii = np.array([radius or 0.0 for radius in numbers])
        points = np.stack([self._over_time(body, at) for body, at in bodies], axis=1)
        spans, ways = tangents(points, radii, law.axis)
        parts, turns = [spans[:, 0]], wraps_of(ways, radii, law.axis)
        for n in range(1, len(radii) - 1):
            arm = spans[:, n - 1, 1] - points[:, n]
            angles = turns[:, n - 1, None, None] * np.linspace(0, 1, ARC)[None, :, None]
            parts.append(points[:, n, None] + np.cos(angles) * arm[:, None] + np.sin(angles) * np.cross(law.axis, arm)[:, None])
            parts.append(spans[:, n])
        self._add(item.name, "thin", np.concatenate(parts, axis=1))
        e1, e2 = symbols.plane_of(law.axis)
        for n, radius in enumerate(radii):
            if radius:
                self._add(item.name, "thin", points[:, n, None] + symbols.circle(np.zeros(3), abs(radius) * e1, abs(radius) * e2))

    def _bushing(self, item: Connection, law: Any) -> None:
        """Draw a spring along every elastic axis of k."""
        for i, stiffness in enumerate("xyz"):
            if not getattr(law, f"k{stiffness}", None):
                continue
            axis = item.k.drawn.rotation[:, i]
            axis = -axis if axis @ self.down < -0.5 else axis * (1 if axis @ self.down > 0.5 else -1)
            anchor = law.at + 6 * self.mark * axis
            self._spring_between(item, anchor, law.at)
            if item.k.is_ground:
                self._ground(item.name, anchor, axis)

    def _load(self, item: Connection, law: Any) -> None:
        values, at = self.result.read(f"{item.name}.{item.kind}"), self._over_time(item.l, law.at)
        if item.kind == "force":
            self.forces.append((item.name, "arrow", at, values))
            return
        share = np.linalg.norm(values, axis=1) / (np.max(np.linalg.norm(values, axis=1)) or 1.0)
        ways = [symbols.unit(value) if s else symbols.Z for value, s in zip(values, share, strict=True)]
        self._add(item.name, "arrow", np.array([symbols.turning_arrow(p, way, 2.6 * self.mark * s**0.5)
                                                for p, way, s in zip(at, ways, share, strict=True)]))

    def _pushes(self, item: Connection) -> None:
        """The force of every law of a contact on body l, at the point where its line of action meets the plane of k, or the
        surface of the ball of l."""
        one = item.shapes[0]
        for law, _, wrench in self.result.over_laws(reaction_outputs, item):
            force, torque = wrench[:, :3], wrench[:, 3:]
            size = np.linalg.norm(force, axis=1)[:, None]
            acts = size > 1e-9 * np.max(size, initial=0.0)
            way = np.divide(force, size, out=np.zeros_like(force), where=acts)
            arm = np.divide(np.cross(way, torque), size, out=np.zeros_like(force), where=acts)
            middle = self._over_time(item.l, law.point_on("l"))
            if isinstance(one, Plane):
                at = self._over_time(item.k, one.at)
                normal = self._over_time(item.k, one.at + one.normal) - at
                height, slope = (np.sum(x * normal, axis=1)[:, None] for x in (at - middle - arm, way))
                far = np.divide(height, slope, out=np.zeros_like(size), where=acts & (slope > SLIGHT))
            else:
                radius = getattr(law, "radius_l", None) or 0.0
                far = -np.sqrt(np.maximum(radius**2 - np.sum(arm**2, axis=1), 0.0))[:, None]
            self.forces.append((item.name, "push", middle + arm + far * way, np.where(acts, force, 0.0)))

    def _arrows(self) -> float:
        """Draw all forces by one scale, N per m, which is returned: the largest as an arrow of six marks."""
        largest = max((float(np.max(np.linalg.norm(force, axis=1))) for *_, force in self.forces), default=0.0)
        if not largest:
            return 0.0
        newtons = largest / (6 * self.mark)
        for item, kind, at, force in self.forces:
            self._add(item, kind, np.array([symbols.arrow(p, p + f / newtons, 1.5 * self.mark)
                                            for p, f in zip(at, force, strict=True)]), colour=PUSH if kind == "push" else INK)
        return newtons

    def _distributed(self, load: BeamLoad) -> None:
        """Draw a row of arrows along the beam, with lengths proportional to the load, joined at their tails."""
        t = self.result.t
        parts = [getattr(load.law, f"f{i}") or 0.0 for i in (1, 2, 3)]
        values = np.stack([timed.values(timed.expression(part), t) for part in parts], axis=1)
        largest = np.max(np.linalg.norm(values, axis=1)) or 1.0
        places = [self.result[load.beam.at(s)] for s in np.linspace(0.0, 1.0, ARROWS)]
        lines = []
        for k in range(len(t)):
            row = []
            for place in places:
                f = place.rotation[k] @ values[k] if load.law.following else values[k]
                tip = place.position[k]
                row.append(symbols.arrow(tip - 4 * self.mark * f / largest, tip, 0.8 * self.mark))
            lines.append(np.concatenate([arrow[[0, 1, 2, 1, 4, 1, 0]] for arrow in row]))
        self._add(load.name, "thin", np.array(lines))
        self._name(load.name, self.scene.ground, np.array(lines)[:, 7 * (ARROWS // 2)])


# -- Data of an animation: times of the frames, geometry at these times, paths of places, curves of sensors


LARGEST = 600  #: largest number of frames
SMOOTH = 240  #: smallest number of frames of a player, which may run slowly, and of points of a line over time
#: s on the screen: shortest and longest duration shown in real time, and the duration aimed at otherwise
COMFORTABLE = (1.0, 60.0, 8.0)


@dataclass(frozen=True)
class Curve:
    """One panel of the strip chart: a sensor's name with its unit, its component names and values (nt, n)."""

    label: str
    components: tuple[str, ...]
    values: Array


@dataclass(frozen=True)
class Trail:
    """The path (nt, 3), m, of a place."""

    name: str
    colour: str
    points: Array


@dataclass(frozen=True)
class Film:
    """Data of an animation: geometry at the times of the frames; trails and curves with `fine` points per frame, at times (n,),
    s."""

    seen: Geometry
    fine: int
    times: Array
    trails: tuple[Trail, ...]
    curves: tuple[Curve, ...]
    speed: float  #: simulated s per s on the screen


def natural_speed(duration: float) -> float:
    """Simulated s per s on the screen: 1 where that gives a suitable duration, else 1, 2 or 5 times a power of ten."""
    least, most, aim = COMFORTABLE
    if duration <= 0 or least <= duration <= most:
        return 1.0
    wanted = duration / aim
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(f"{power * max(n for n in (1, 2, 5) if n <= wanted / power * (1 + 1e-9)):.3g}")


def frame_times(start: float, duration: float, step: float, least: int = 2) -> Array:
    """Times (nt,) of the frames, s, at most `LARGEST` and at least `least` of them."""
    n = int(np.clip(np.ceil(duration / step - 1e-9) + 1, least if duration > 0 else 1, LARGEST))
    return np.asarray(start + np.linspace(0.0, duration, n))


def filmed(result: Any, t: Array, sensors: Sequence[str], places: Sequence[Any], speed: float,
           hide: Sequence[str] = ()) -> Film:
    """The data of an animation with frames at times t (nt,), s."""
    fine = max(1, -(-SMOOTH // len(t))) if len(t) > 1 else 1
    times = np.interp(np.arange((len(t) - 1) * fine + 1) / fine, np.arange(len(t)), t)
    dense = result(times)
    tracks = [track(dense, place) for place in places]
    trails = tuple(Trail(name, COLOURS[(i + 1) % len(COLOURS)], points) for i, (name, points) in enumerate(tracks))
    curves = [Curve(label, tuple(c for c, _ in parts), np.stack([v for _, v in parts], axis=1))
              for sensor in sensors for label, parts in strips(dense, sensor)]
    return Film(geometry(result(t), hide), fine, times, trails, tuple(curves), speed)


def digits(t: Array) -> int:
    """Number of decimals that distinguishes the times of any two frames."""
    step = float(t[-1] - t[0]) / 200
    return int(np.clip(np.ceil(-np.log10(step)), 0, 9)) if step > 0 else 2
