"""The scene: what the user says, as data. Nothing is derived or solved here.

Statements are collected as they come; every mistake found is kept in `problems` and reported together by `check`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbdae.errors import SceneError
from mbdae.laws.forces import (
    AppliedForce,
    AppliedTorque,
    Bushing,
    JointTorque,
    PointSpring,
    RotationalBushing,
)
from mbdae.scene import inertia as mass_properties
from mbdae.scene import reading
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
from mbdae.scene.own_laws import plain_law
from mbdae.scene.reading import FEEDS, Told, reads
from mbdae.scene.record import Own, Statement, statement
from mbdae.scene.variants import replaced, with_recursive_tree
from mbdae.symbolic.law import Force, Joint, Law

MASS, SPEED, TURNING = reading.quantity("kg", "not negative"), reading.vector("m/s"), reading.vector("rad/s")
FRAME = reading.one_of("inertial", "body")


class SceneData(BeamStatements, JointStatements):
    """Bodies, joints and forces by name. Lengths in m, angles in rad, SI throughout; inertial frame, right-handed."""

    def __init__(self, name: str = "scene", gravity: Any = (0.0, 0.0, 0.0), space: str = "auto") -> None:
        """`gravity` (3,) in m/s^2; `space` "auto" (planar where that can be proved), "planar" or "spatial"."""
        self.problems: list[str] = []
        self.name = reading.name(Told(self, "scene", "name"), name)
        head = f"scene '{self.name}'"
        self.space = reading.one_of("auto", "planar", "spatial")(Told(self, head, "space"), space)
        self.statements: list[Statement] = []  #: what was said, as plain data (see `record.py`)
        self.own: Own = {}  #: classes and functions by the names they have in `statements`
        self.recording = True
        self.gravity = reading.vector("m/s^2")(Told(self, head, "gravity"), gravity)
        eye, zero = np.eye(3), np.zeros(3)
        self.ground = Body("ground", math.inf, None, zero, eye, zero, zero, is_ground=True, scene=self)
        self.bodies: list[Body] = []
        self.connections: list[Connection] = []
        self.line_loads: list[BeamLoad] = []
        self.attachments: dict[Beam, tuple[float, ...]] = {}

    # -- bodies

    @reads(name=reading.name, mass=MASS, inertia=reading.inertia, at=reading.point, rotation=reading.rotation,
           velocity=SPEED, angular_velocity=TURNING)  # fmt: skip
    @statement
    def rigid_body(self, name: str, mass: float, inertia: Any, at: Any = (0, 0, 0), rotation: Any = None,
                   velocity: Any = (0, 0, 0), angular_velocity: Any = (0, 0, 0)) -> Body:  # fmt: skip
        """A rigid body: `mass` kg; `inertia` about its centre of mass in body axes, kg m^2 (one number: about z; 3
        principal values; or 3x3); `at` centre of mass, m; `rotation` 3x3 (body to inertial); `velocity` m/s and
        `angular_velocity` rad/s in the inertial frame."""
        R = np.eye(3) if rotation is None else rotation
        v, w, where = (np.array(a, dtype=float) for a in (velocity, angular_velocity, at))
        matrix, planar = mass_properties.matrix(np.asarray(inertia)), np.ndim(inertia) == 0
        self.problems += mass_properties.problems(name, matrix, planar)
        body = Body(name, mass, matrix, where, R, v, w, given_velocity=bool(np.any(v) or np.any(w)), outline=where[None],
                    principal_plane=planar)  # fmt: skip
        return self._add_body(body)

    @reads(name=reading.name, mass=MASS, at=reading.point, velocity=SPEED)
    @statement
    def point_mass(self, name: str, mass: float, at: Any, velocity: Any = (0, 0, 0)) -> Body:
        """A mass point: no orientation, rotation rows of joints on it fall away."""
        speed = np.array(velocity, dtype=float)
        body = Body(name, mass, None, at, np.eye(3), speed, np.zeros(3), given_velocity=bool(np.any(speed)), outline=at[None],
                    is_point=True)  # fmt: skip
        return self._add_body(body)

    @reads(name=reading.name, points=reading.point, mass=MASS, mass_per_length=reading.quantity("kg/m", "not negative"))
    @statement
    def link(self, name: str, *points: Any, mass: float | None = None, mass_per_length: float | None = None) -> Body:
        """A rigid polyline of slender rods through `points`; `mass` kg in all, or `mass_per_length` kg/m."""
        outline = np.array(points)
        if len(points) < 2 or not np.all(np.linalg.norm(np.diff(outline, axis=0), axis=1) > 0):
            self.problems.append(f"link '{name}': needs at least two points, each different from the one before")
            outline = np.array([np.zeros(3), np.eye(3)[0]])
        if (mass is None) == (mass_per_length is None):
            self.problems.append(f"link '{name}': give either mass (kg) or mass_per_length (kg/m)")
            mass, mass_per_length = 1.0, None
        length = float(np.sum(np.linalg.norm(np.diff(outline, axis=0), axis=1)))
        total = mass if mass is not None else mass_per_length * length  # type: ignore[operator]
        center, J = mass_properties.of_rods(outline, total)
        body = Body(name, total, J, center, np.eye(3), np.zeros(3), np.zeros(3), outline=outline)
        return self._add_body(body)

    def _add_body(self, body: Body) -> Body:
        body.scene = self
        self._claim(body.name)
        self.bodies.append(body)
        return body

    # -- forces

    @reads(name=reading.name, k=reading.body, l=reading.body, at_k=reading.point, at_l=reading.point,
           stiffness=reading.quantity("N/m"), damping=reading.quantity("N s/m", "not negative", FEEDS),
           length=reading.quantity("m", "not negative"))  # fmt: skip
    @statement
    def spring(self, name: str, k: Any, l: Any, at_k: Any, at_l: Any, stiffness: float, damping: float = 0.0,
               length: float | None = None) -> Connection:  # fmt: skip
        """Spring (N/m) and damper (N s/m) between two points; natural `length` m (default: as drawn)."""
        natural = float(np.linalg.norm(at_l - at_k)) if length is None else length
        if damping and natural == 0:
            self.problems.append(f"spring '{name}': its natural length is 0 m, so its damper has no direction where the points "
                                 f"meet; use s.bushing, or give a length")  # fmt: skip
            damping = 0.0
        law = PointSpring(name, k, l, at_k, at_l=at_l, stiffness=stiffness, damping=damping or None, length=natural or None)
        return self._connect(Connection(name, "spring", k, l, [law]))

    @reads(name=reading.name, k=reading.body, l=reading.body, at=reading.point,
           stiffness=reading.values("give 3 numbers (translation, N/m), or 6 (then rotation, N m/rad)", 3, 6),
           damping=reading.values("give 3 numbers (translation, N s/m), or 6 (then rotation, N m s/rad)", 3, 6))  # fmt: skip
    @statement
    def bushing(self, name: str, k: Any, l: Any, at: Any, stiffness: Any, damping: Any = (0, 0, 0)) -> Connection:
        """Elastic connection: 3 translational values (N/m, N s/m), or 6 with rotations (N m/rad, N m s/rad), along k's axes."""
        values: dict[str, Any] = {}
        for what, entries, names in (("stiffness", stiffness, ("k", "r")), ("damping", damping, ("c", "s"))):
            numbers = np.asarray(entries, dtype=float)
            if what == "damping" and np.any(numbers < 0):
                self.problems.append(f"bushing '{name}': damping = {numbers.tolist()} has a negative value: it would feed energy")
            for letter, part in zip(names, (numbers[:3], numbers[3:]), strict=True):
                if np.any(part):
                    values |= {letter + axis: float(v) for axis, v in zip("xyz", part, strict=True)}
        own = {law: {p: values[p] for p in law.params if p in values} for law in (Bushing, RotationalBushing)}
        laws: list[Law] = [law(name, k, l, at, **numbers) for law, numbers in own.items() if numbers]
        return self._connect(Connection(name, "bushing", k, l, laws or [Bushing(name, k, l, at)]))

    @reads(name=reading.name, body=reading.body, value=reading.components("N"), at=reading.point, frame=FRAME)
    @statement
    def force(self, name: str, body: Any, value: Any, at: Any = None, frame: str = "inertial") -> Connection:
        """Applied force, N, three numbers or expressions of mb.t, in the inertial frame or along the body's axes."""
        return self._load("force", AppliedForce, ("fx", "fy", "fz"), name, body, value, at, frame)

    @reads(name=reading.name, body=reading.body, value=reading.components("N m"), frame=FRAME)
    @statement
    def torque(self, name: str, body: Any, value: Any, frame: str = "inertial") -> Connection:
        """Applied torque, N m, three numbers or expressions of mb.t."""
        return self._load("torque", AppliedTorque, ("mx", "my", "mz"), name, body, value, None, frame)

    def _load(self, kind: str, law: type[Force], names: tuple[str, ...], name: str, body: Any, value: Any, at: Any,
              frame: str) -> Connection:  # fmt: skip
        components = {n: v or None for n, v in zip(names, value, strict=True)}
        where = _place_of(body) if at is None else at
        load = law(name, self.ground, body, where, following=frame == "body", **components)
        return self._connect(Connection(name, kind, self.ground, body, [load]))

    @reads(law=plain_law)
    @statement
    def add(self, law: Joint | Force) -> Connection:
        """Add a joint or force law, the package's or the user's own. The scene keeps a copy: what happens to the law afterwards
        does not change it."""
        if law.at is None:
            law.at = _place_of(law.l)
        law.axis = reading.unit(law.axis)
        return self._connect(Connection(law.name, type(law).__name__.lower(), law.k, law.l, [law], isinstance(law, Joint)))

    def _connect(self, item: Connection) -> Connection:
        item.places = {side: b.point for side, b in (("k", item.k), ("l", item.l)) if isinstance(b, Place)}
        item.k, item.l = (b.body if isinstance(b, Place) else b for b in (item.k, item.l))
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
        if name == "ground" or (name != reading.NAMELESS and any(item.name == name for item in self._items)):
            self.problems.append(f"two items have the name '{name}'; give each its own")


def _place_of(body: Body | Place) -> Array:
    """Where a joint or force is that names no point: at the place, or the body's centre of mass."""
    return np.array(body.point if isinstance(body, Place) else body.position, dtype=float)
