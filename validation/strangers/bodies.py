"""Bodies and joints of a story for the reference, without mbdae: masses, frames, and what joints keep fixed as distances along
directions, products of directions, and turning rates."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from strangers.story import Input, Said, Story

Array = NDArray[np.float64]


class NotStatedError(Exception):
    """A story with something that the reference does not know."""


def three(p: Any) -> Array:
    """A point or direction with two or three coordinates."""
    return np.array([*p, 0.0][:3], dtype=float)


def unit(p: Any) -> Array:
    """A direction."""
    a = three(p)
    return a / np.linalg.norm(a)


def across(axis: Array) -> tuple[Array, Array]:
    """Two directions normal to an axis and to each other."""
    a = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    a /= np.linalg.norm(a)
    return a, np.cross(axis, a)


@dataclass
class Functionals:
    """Scalars of the motion, a row each: k, l numbers of bodies (the last one is the ground); a, b directions and r, s points in
    body axes. kind 0: a_k . (x_l - x_k); 1: a_k . b_l; 2: the angle about a_k; 3: |x_l - x_k|^2 / 2."""

    rows: list[tuple[int, int, int, Array, Array, Array, Array]] = field(default_factory=list)

    def add(self, kind: int, k: int, l: int, a: Any = None, b: Any = None, r: Any = None, s: Any = None) -> int:
        """Its number."""
        none = np.zeros(3)
        self.rows.append((kind, k, l, *(none if v is None else v for v in (a, b, r, s))))  # type: ignore[arg-type]
        return len(self.rows) - 1


@dataclass
class World:
    """All of a story that does not move: masses, inertias in body axes, drawn positions and rotations, functionals, constraints
    (rows of weights on functionals and what they equal), coordinates of joints by name as weights on functionals."""

    names: list[str]
    mass: Array
    inertia: Array
    at: Array
    turned: Array
    scalars: Functionals = field(default_factory=Functionals)
    constraints: list[tuple[dict[int, float], Input | None]] = field(default_factory=list)
    owners: list[str] = field(default_factory=list)  #: of every constraint, the statement that makes it
    coordinates: dict[str, int] = field(default_factory=dict)

    def number(self, name: str) -> int:
        """Of a body; the ground is the last."""
        return len(self.names) if name == "ground" else self.names.index(name)

    def inside(self, body: int, point: Any) -> Array:
        """A point as drawn in body axes."""
        return np.asarray(self.turned[body].T @ (three(point) - self.at[body]))

    def along(self, body: int, direction: Array) -> Array:
        """A direction as drawn in body axes."""
        return np.asarray(self.turned[body].T @ direction)


def rods(points: Any, mass: float) -> tuple[Array, Array]:
    """Centre and inertia about it, in the axes as drawn, of slender rods through points."""
    p = np.array([three(q) for q in points])
    d, middle = np.diff(p, axis=0), (p[1:] + p[:-1]) / 2
    m = mass * np.linalg.norm(d, axis=1) / np.linalg.norm(d, axis=1).sum()
    c, J = m @ middle / mass, np.zeros((3, 3))
    for mi, di, ri in zip(m, d, middle - c, strict=True):
        J += mi * ((di @ di * np.eye(3) - np.outer(di, di)) / 12 + ri @ ri * np.eye(3) - np.outer(ri, ri))
    return c, J


def world_of(story: Story) -> World:
    """Bodies first, then joints in their order."""
    names, mass, inertia, at, turned = [], [], [], [], []
    for a in story.of("rigid_body", "link", "point_mass"):
        where, J = three(a.args.get("at", (0, 0, 0))), np.eye(3)
        if a.verb == "link":
            where, J = rods(a.args["points"], a.args["mass"])
            if story.planar:
                J = J + 1e-3 * np.eye(3) * np.trace(J)  # a straight rod has none about its axis: of no account in the plane
                J[2, 2] = rods(a.args["points"], a.args["mass"])[1][2, 2]
        elif a.verb == "rigid_body":
            given = np.array(a.args["inertia"], dtype=float)
            J = np.diag([given] * 3) if given.ndim == 0 else np.diag(given) if given.ndim == 1 else given
        names.append(a.name)
        mass.append(a.args["mass"])
        inertia.append(J)
        at.append(where)
        turned.append(np.array(a.args["rotation"], dtype=float) if a.args.get("rotation") is not None else np.eye(3))
    w = World(names, np.array(mass), np.array(inertia), np.array([*at, np.zeros(3)]), np.array([*turned, np.eye(3)]))
    for a in story.statements:
        if a.verb in JOINTS:
            _joint(w, a)
        elif a.verb == "couple" or a.verb in ("gear", "rack", "differential"):
            _coupling(w, a)
        w.owners += [a.name] * (len(w.constraints) - len(w.owners))
    return w


JOINTS = {"revolute": ("xyz", True, False), "prismatic": ("xy", True, True), "cylindrical": ("xy", True, False),
          "screw": ("xy", True, False), "planar": ("z", True, False), "spherical": ("xyz", False, False),
          "weld": ("xyz", True, True), "point_on_line": ("xy", False, False), "point_on_plane": ("z", False, False),
          "fixed_orientation": ("", True, True), "universal": ("xyz", False, False), "distance": ("", False, False)}
# by verb: along which axes the points of k and l keep together, whether z is kept in direction, and x too


def _joint(w: World, a: Said) -> None:
    k, l = w.number(a.args["k"]), w.number(a.args["l"])
    if a.verb == "distance":
        w.constraints.append(({w.scalars.add(3, k, l, r=w.inside(k, a.args["at_k"]), s=w.inside(l, a.args["at_l"])): 1.0}, None))
        return
    at = a.args.get("at")
    at = w.at[l] if at is None else at
    z = unit(a.args.get("axis", (0, 0, 1)))
    x, y = across(z)
    if a.args.get("axis_x") is not None:
        x = unit(a.args["axis_x"])
        y = np.cross(z, x)
    points = {"r": w.inside(k, at), "s": w.inside(l, at)}
    way = {n: w.scalars.add(0, k, l, w.along(k, e), **points) for n, e in zip("xyz", (x, y, z), strict=True)}
    angle = w.scalars.add(2, k, l, w.along(k, z))
    kept, upright, locked = JOINTS[a.verb]
    loose = str(a.args.get("model", "")).startswith("mb.Clearance")
    rows = [{way[n]: 1.0} for n in kept if not (loose and n != "z")]
    if upright:
        rows += [{w.scalars.add(1, k, l, w.along(k, e), w.along(l, z)): 1.0} for e in (x, y)]
    if locked:
        rows.append({w.scalars.add(1, k, l, w.along(k, x), w.along(l, y)): 1.0})
    if a.verb == "universal":
        pin = unit(a.args["pin"])
        rows.append({w.scalars.add(1, k, l, w.along(k, pin), w.along(l, np.cross(z, pin))): 1.0})
    if a.verb == "screw":
        rows.append({way["z"]: 1.0, angle: -a.args["lead"] / (2 * np.pi)})
    w.constraints += [(row, None) for row in rows]
    own = {"revolute": {"angle": angle}, "screw": {"angle": angle}, "prismatic": {"displacement": way["z"]},
           "cylindrical": {"displacement": way["z"], "angle": angle}, "planar": {**way, "angle": angle},
           "point_on_line": {"displacement": way["z"]}, "point_on_plane": way, "fixed_orientation": way}
    w.coordinates |= {f"{a.name}.{c}": n for c, n in own.get(a.verb, {}).items()}
    for c in own.get(a.verb, {}):
        drive = option(a, "prescribed", c)
        if drive is not None:
            w.constraints.append(({w.coordinates[f"{a.name}.{c}"]: 1.0}, drive))


SHORT = {"prescribed": ("angle", "position"), "load": ("torque", "force")}


def option(a: Said, word: str, coordinate: str) -> Any:
    """The value of an option of a joint for a coordinate, in the words of revolutes and slides or by name; None without."""
    given = a.args.get(word)
    for short in SHORT.get(word, ()):
        given = a.args.get(short, given)
    return given.get(coordinate) if isinstance(given, dict) else given


def _coupling(w: World, a: Said) -> None:
    def of(key: str, coordinate: str) -> int:
        return w.coordinates[f"{a.args[key]}.{coordinate}"]

    if a.verb == "gear":
        row = {of("driven", "angle"): 1.0, of("driving", "angle"): -a.args["ratio"]}
    elif a.verb == "rack":
        row = {of("rack", "displacement"): 1.0, of("pinion", "angle"): -a.args["radius"]}
    elif a.verb == "differential":
        row = {of("first", "angle"): 1.0, of("second", "angle"): 1.0, of("carrier", "angle"): -2.0}
    else:
        row = {w.coordinates[name]: factor for name, factor in a.args["of"].items()}
    w.constraints.append((row, None))
