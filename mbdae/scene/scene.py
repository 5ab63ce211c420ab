"""The scene: what the user says, as data. Nothing is derived or solved here.

Statements are collected as they come; every mistake found is kept in `problems` and reported together by `check`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbdae.errors import SceneError
from mbdae.forces import (
    AppliedForce,
    AppliedTorque,
    Bushing,
    JointTorque,
    PointSpring,
    RotationalBushing,
)
from mbdae.scene import inertia as mass_properties
from mbdae.scene.beams import BeamLoad, BeamStatements
from mbdae.scene.components import (
    Array,
    Beam,
    Body,
    Connection,
    JointModel,
    Place,
)
from mbdae.scene.joints import JointStatements
from mbdae.scene.record import Own, Statement, statement
from mbdae.scene.variants import replaced, with_recursive_tree
from mbdae.symbolic.law import Force, Joint, Law


class SceneData(BeamStatements, JointStatements):
    """Bodies, joints and forces by name. Lengths in m, angles in rad, SI throughout; inertial frame, right-handed."""

    def __init__(self, name: str = "scene", gravity: Any = (0.0, 0.0, 0.0), space: str = "auto") -> None:
        """`gravity` (3,) in m/s^2; `space` "auto" (planar where that can be proved), "planar" or "spatial"."""
        self.name, self.space = name, space
        self.problems: list[str] = []
        self.statements: list[Statement] = []  #: what was said, as plain data (see `record.py`)
        self.own: Own = {}  #: classes and functions by the names they have in `statements`
        self.recording = True
        self.gravity = self._vector("scene", "gravity", gravity, "m/s^2")
        if space not in ("auto", "planar", "spatial"):
            self.problems.append(f"scene: space={space!r} is unknown; use 'auto', 'planar' or 'spatial'")
        eye, zero = np.eye(3), np.zeros(3)
        self.ground = Body("ground", math.inf, None, zero, eye, zero, zero, is_ground=True)
        self.bodies: list[Body] = []
        self.connections: list[Connection] = []
        self.line_loads: list[BeamLoad] = []
        self.attachments: dict[Beam, tuple[float, ...]] = {}

    # -- bodies

    @statement
    def rigid_body(self, name: str, mass: float, inertia: Any, at: Any = (0, 0, 0), rotation: Any = None,
                   velocity: Any = (0, 0, 0), angular_velocity: Any = (0, 0, 0)) -> Body:  # fmt: skip
        """A rigid body: `mass` kg; `inertia` about its centre of mass in body axes, kg m^2 (one number: about z; 3
        principal values; or 3x3); `at` centre of mass, m; `rotation` 3x3 (body to inertial); `velocity` m/s and
        `angular_velocity` rad/s in the inertial frame."""
        return self._body(name, mass, inertia, at, rotation, velocity, angular_velocity)

    @statement
    def point_mass(self, name: str, mass: float, at: Any, velocity: Any = (0, 0, 0)) -> Body:
        """A mass point: no orientation, rotation rows of joints on it fall away."""
        where, speed = self._vector(name, "at", at, "m"), self._vector(name, "velocity", velocity, "m/s")
        body = Body(name, self._number(name, "mass", mass, "kg"), None, where, np.eye(3), speed, np.zeros(3),
                    given_velocity=bool(np.any(speed)), outline=where[None], is_point=True)  # fmt: skip
        return self._add_body(body)

    @statement
    def link(self, name: str, *points: Any, mass: float | None = None, mass_per_length: float | None = None) -> Body:
        """A rigid polyline of slender rods through `points`; `mass` kg in all, or `mass_per_length` kg/m."""
        outline = np.array([self._vector(name, f"point {i + 1}", p, "m") for i, p in enumerate(points)])
        if len(points) < 2 or not np.all(np.linalg.norm(np.diff(outline, axis=0), axis=1) > 0):
            self.problems.append(f"link '{name}': needs at least two points, each different from the one before")
            outline = np.array([np.zeros(3), np.eye(3)[0]])
        if (mass is None) == (mass_per_length is None):
            self.problems.append(f"link '{name}': give either mass (kg) or mass_per_length (kg/m)")
            mass, mass_per_length = 1.0, None
        length = float(np.sum(np.linalg.norm(np.diff(outline, axis=0), axis=1)))
        total = self._number(name, "mass", mass if mass is not None else mass_per_length * length, "kg")  # type: ignore[operator]
        center, J = mass_properties.of_rods(outline, total)
        body = Body(name, total, J, center, np.eye(3), np.zeros(3), np.zeros(3), outline=outline)
        return self._add_body(body)

    def _body(self, name: str, mass: float, J: Any, at: Any, rotation: Any, velocity: Any, angular_velocity: Any) -> Body:
        R = np.eye(3) if rotation is None else self._array(name, "rotation", rotation, (3, 3))
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-9) or np.linalg.det(R) < 0:
            self.problems.append(f"body '{name}': rotation is not a rotation matrix (R R^T differs from 1 by "
                                 f"{np.max(np.abs(R @ R.T - np.eye(3))):.2g}, det {np.linalg.det(R):.3g})")  # fmt: skip
            R = np.eye(3)
        v = self._vector(name, "velocity", velocity, "m/s")
        w = self._vector(name, "angular_velocity", angular_velocity, "rad/s")
        matrix, planar = np.zeros((3, 3)), np.ndim(J) == 0
        if J is None:
            self.problems.append(f"body '{name}': inertia is missing; give one number (about z), 3 values or 3x3, kg m^2")
        else:
            matrix = mass_properties.matrix(self._array(name, "inertia", J, None))
            self.problems += mass_properties.problems(name, matrix, planar)
        where = self._vector(name, "at", at, "m")
        body = Body(name, self._number(name, "mass", mass, "kg"), matrix, where, R, v, w,
                    given_velocity=bool(np.any(v) or np.any(w)), outline=where[None], principal_plane=planar)  # fmt: skip
        return self._add_body(body)

    def _add_body(self, body: Body) -> Body:
        if body.mass < 0:
            self.problems.append(f"body '{body.name}': mass = {body.mass:g} kg is negative")
        self._claim(body.name)
        self.bodies.append(body)
        return body

    # -- forces

    @statement
    def spring(self, name: str, k: Any, l: Any, at_k: Any, at_l: Any, stiffness: float, damping: float = 0.0,
               length: float | None = None) -> Connection:  # fmt: skip
        """Spring (N/m) and damper (N s/m) between two points; natural `length` m (default: as drawn)."""
        a, b = self._vector(name, "at_k", at_k, "m"), self._vector(name, "at_l", at_l, "m")
        natural = float(np.linalg.norm(b - a)) if length is None else self._number(name, "length", length, "m")
        damping = self._damping(name, "damping", damping, "N s/m")
        if natural < 0:
            self.problems.append(f"spring '{name}': length = {natural:g} m is negative")
        if damping and natural == 0:
            self.problems.append(f"spring '{name}': its natural length is 0 m, so its damper has no direction where the points "
                                 f"meet; use s.bushing, or give a length")  # fmt: skip
            damping = 0.0
        law = PointSpring(name, k, l, a, at_l=b, stiffness=self._number(name, "stiffness", stiffness, "N/m"),
                          damping=damping or None, length=natural or None)  # fmt: skip
        return self._connect(Connection(name, "spring", k, l, [law]))

    @statement
    def bushing(self, name: str, k: Any, l: Any, at: Any, stiffness: Any, damping: Any = (0, 0, 0)) -> Connection:
        """Elastic connection: 3 translational values (N/m, N s/m), or 6 with rotations (N m/rad, N m s/rad), along k's axes."""
        values: dict[str, Any] = {}
        for what, entries, names in (("stiffness", stiffness, ("k", "r")), ("damping", damping, ("c", "s"))):
            numbers = self._array(name, what, entries, None).ravel()
            if numbers.size not in (3, 6):
                self.problems.append(f"bushing '{name}': {what} has {numbers.size} values; give 3 (translation) or 6 (rotation)")
                continue
            if what == "damping" and np.any(numbers < 0):
                self.problems.append(f"bushing '{name}': damping = {numbers.tolist()} has a negative value: it would feed energy")
            for letter, part in zip(names, (numbers[:3], numbers[3:]), strict=True):
                if np.any(part):
                    values |= {letter + axis: float(v) for axis, v in zip("xyz", part, strict=True)}
        where = self._vector(name, "at", at, "m")
        own = {law: {p: values[p] for p in law.params if p in values} for law in (Bushing, RotationalBushing)}
        laws: list[Law] = [law(name, k, l, where, **numbers) for law, numbers in own.items() if numbers]
        return self._connect(Connection(name, "bushing", k, l, laws or [Bushing(name, k, l, where)]))

    @statement
    def force(self, name: str, body: Any, value: Any, at: Any = None, frame: str = "inertial") -> Connection:
        """Applied force, N, three numbers or expressions of mb.t, in the inertial frame or along the body's axes."""
        return self._load("force", AppliedForce, ("fx", "fy", "fz"), name, body, value, at, frame)

    @statement
    def torque(self, name: str, body: Any, value: Any, frame: str = "inertial") -> Connection:
        """Applied torque, N m, three numbers or expressions of mb.t."""
        return self._load("torque", AppliedTorque, ("mx", "my", "mz"), name, body, value, None, frame)

    def _load(self, kind: str, law: type[Force], names: tuple[str, ...], name: str, body: Any, value: Any, at: Any,
              frame: str) -> Connection:  # fmt: skip
        if frame not in ("inertial", "body"):
            self.problems.append(f"{kind} '{name}': frame={frame!r} is unknown; use 'inertial' or 'body'")
        entries = list(value) if np.ndim(np.asarray(value, dtype=object)) == 1 else [value]
        if len(entries) == 2:
            entries.append(0.0)
        if len(entries) != 3:
            self.problems.append(f"{kind} '{name}': value has {len(entries)} components, needs 3")
            entries = [0.0, 0.0, 0.0]
        if isinstance(body, Place):
            at = at if at is not None else body.point
        components = {n: self._timed(name, f"value[{i}]", v) or None for i, (n, v) in enumerate(zip(names, entries, strict=True))}
        where = self._place_of(body) if at is None else self._vector(name, "at", at, "m")
        following = frame == "body"
        load = law(name, self.ground, body, where, following=following, **components)
        return self._connect(Connection(name, kind, self.ground, body, [load]))

    @statement
    def add(self, law: Joint | Force) -> Connection:
        """Add a joint or force law, the package's or the user's own."""
        is_joint = isinstance(law, Joint)
        law.at = self._vector(law.name, "at", law.at if law.at is not None else self._place_of(law.l), "m")
        law.axis = self._axis(law.name, law.axis)
        for key, parameter in law.params.items():
            value = getattr(law, key)
            if value is not None:
                setattr(law, key, self._timed(law.name, key, value, parameter.unit))
        kind = type(law).__name__.lower()
        return self._connect(Connection(law.name, kind, law.k, law.l, [law], is_joint))

    def _connect(self, item: Connection) -> Connection:
        item.places = {side: b.point for side, b in (("k", item.k), ("l", item.l)) if isinstance(b, Place)}
        item.k, item.l = self._resolve(item, item.k), self._resolve(item, item.l)
        for law in (*item.laws, *item.as_kinematic):
            law.k, law.l = item.k, item.l  # type: ignore[attr-defined]
            if item.loose and item.l.is_point:  # the pin may be drawn anywhere in its play
                law.at_l = item.l.position  # type: ignore[attr-defined]
        if item.loose and item.k.is_point:
            self.problems.append(f"{item.kind} '{item.name}': the point mass '{item.k.name}' cannot carry the race: it has no "
                                 f"orientation; name it second, or use s.rigid_body")  # fmt: skip
        if item.k is item.l:
            self.problems.append(f"{item.kind} '{item.name}': connects '{item.k.name}' with itself; name two different bodies")
        self._check_point_masses(item)
        self._check_attachments(item)
        self._claim(item.name)
        self.connections.append(item)
        return item

    def _check_point_masses(self, item: Connection) -> None:
        """A point mass has no axes and no extent."""
        for body, side in ((item.k, "k"), (item.l, "l")):
            for law in item.laws if body.is_point else ():
                if isinstance(law, JointTorque | AppliedTorque):
                    self.problems.append(f"{item.kind} '{item.name}': a torque does nothing on the point mass '{body.name}'; "
                                         f"use s.rigid_body")  # fmt: skip
                if law is item.joint and item.rubs and (item.kind == "revolute" or side == "k"):
                    self.problems.append(f"{item.kind} '{item.name}': friction needs the axes of both bodies, the point mass "
                                         f"'{body.name}' has none; use s.rigid_body")  # fmt: skip
                at: Any = law.at_l if side == "l" and getattr(law, "at_l", None) is not None else law.at
                if np.linalg.norm(at - body.position) > 1e-9 * (1 + np.linalg.norm(body.position)):
                    self.problems.append(f"{item.kind} '{item.name}': the point mass '{body.name}' is at "
                                         f"{body.position.tolist()} m, not at {np.asarray(at).tolist()} m; "
                                         f"attach to it where it is")  # fmt: skip
                    break

    # -- variants

    def replace(self, *names: str, model: JointModel) -> Any:
        """A new scene with another model of the named revolute or prismatic joints, without names of all of them (a model
        with scaling or penalty: of all revolute ones)."""
        return replaced(self, names, model)

    def recursive(self) -> Any:
        """A new scene whose revolute and prismatic joints are recursive where they form a tree; joints that close loops
        become kinematic, joints on point masses stay as they are."""
        return with_recursive_tree(self)

    # -- access

    @property
    def _items(self) -> list[Any]:
        return [*self.bodies, *self.connections, *self.line_loads]

    @property
    def joints(self) -> list[Connection]:
        """The joints, in the order of their statement."""
        return [c for c in self.connections if c.is_joint]

    def __getitem__(self, name: str) -> Any:
        for item in [self.ground, *self._items]:
            if item.name == name:
                return item
        raise SceneError([f"there is no item '{name}' in scene '{self.name}'; it has {self._names()}"])

    def _names(self) -> str:
        names = [item.name for item in self._items]
        return ", ".join(repr(n) for n in names[:12]) + (", ..." if len(names) > 12 else "")

    # -- reading what the user wrote

    def _claim(self, name: str) -> None:
        if not isinstance(name, str) or not name:
            self.problems.append(f"an item has the name {name!r}; names are non-empty strings")
        if name == "ground" or any(item.name == name for item in self._items):
            self.problems.append(f"two items have the name '{name}'; give each its own")

    def _resolve(self, item: Connection, body: Any) -> Body:
        if isinstance(body, Place):
            body = body.body
        if isinstance(body, str):
            for candidate in [self.ground, *self.bodies]:
                if candidate.name == body:
                    return candidate
        if isinstance(body, Body) and (body is self.ground or body in self.bodies):
            return body
        name = body.name if isinstance(body, Body) else body
        known = ", ".join(repr(b.name) for b in [self.ground, *self.bodies][:12])
        self.problems.append(f"{item.kind} '{item.name}': body {name!r} is not in this scene; it has {known}")
        zero, eye = np.zeros(3), np.eye(3)
        return self.ground if item.k is not self.ground else Body("?", 0.0, eye, zero, eye, zero, zero)

    def _place_of(self, body: Any) -> Array:
        if isinstance(body, Place):
            return body.point
        if isinstance(body, str):
            body = next((b for b in self.bodies if b.name == body), self.ground)
        return np.asarray(body.position if isinstance(body, Body) else np.zeros(3))
