"""The scene as the user states it. Nothing is derived or solved here.

Statements are collected as they come; every mistake found is kept in `problems` and reported together by `check`.
"""

from __future__ import annotations

import os
from typing import Any
from uuid import uuid4

import numpy as np

from mbdae.errors import LawError
from mbdae.inputs.sensed import paths
from mbdae.inputs.tables import from_data
from mbdae.laws.forces import (
    AppliedForce,
    AppliedTorque,
    Bushing,
    PointSpring,
    RotationalBushing,
    rope_over,
    tangents,
    wraps_of,
)
from mbdae.scene import contacts as mass_properties
from mbdae.scene import reading
from mbdae.scene.beams import BeamStatements
from mbdae.scene.components import Beam, Body, Connection, JointModel, Place
from mbdae.scene.connections import where
from mbdae.scene.contacts import ContactStatements, color, looking, shapes
from mbdae.scene.control import ControlStatements
from mbdae.scene.joints import JointStatements
from mbdae.scene.models import replaced, with_recursive_tree
from mbdae.scene.reading import FEEDS, Argument, reads
from mbdae.scene.record import FrameOnBody, Statement, encode, statement, tables_in
from mbdae.scene.replay import Known, replay
from mbdae.symbolic.derive import digest_of
from mbdae.symbolic.law import Force, TwoBodyLaw
from mbdae.symbolic.stated import own, own_class
from mbdae.values import shown

MASS, SPEED, TURNING = reading.quantity("kg", "not negative"), reading.vector("m/s"), reading.vector("rad/s")
GRAVITY = reading.vector("m/s^2")
FRAME = reading.one_of("inertial", "body")
MOST_WRAPPED = 1.5 * np.pi  #: angle (rad) from which on a rope as drawn is taken to go round a pulley on the wrong side


def _pulleys(arg: Argument, value: Any) -> list[list[Any]]:
    """Reader of pulleys, [(body, radius), ...] or with their centre as drawn."""
    if not isinstance(value, list | tuple) or not all(isinstance(one, list | tuple) and len(one) in (2, 3) for one in value):
        arg.wrong(shown(value), "give a list of (body, radius) or (body, radius, centre), in the order of the rope")
        return []
    found = []
    for n, (body, radius, *center) in enumerate(value):
        part = arg.part(f"{arg.option}[{n}]")
        found.append([reading.body(part, body), _radius(part, radius), *(reading.point(part, one) for one in center)])
    return found


def _radius(arg: Argument, value: Any) -> float:
    """Reader of a radius with the sign of the side, m."""
    before, found = len(arg.scene.problems), reading.quantity("m")(arg, value)
    if found == 0 and len(arg.scene.problems) == before:
        arg.wrong("0 m", "give the radius, positive where the rope goes about the axis with the right hand, negative against it")
    return found or 1.0


_TOKEN = uuid4().hex


def _process() -> tuple[str, int]:
    """What tells this process from others, forked ones included."""
    return _TOKEN, os.getpid()


def stated_laws(scene: SceneData) -> dict[str, str]:
    """What the laws of a scene state now that are not mbdae's, as texts by item: equal in all processes where they state the
    same."""
    return {f"{c.name}.{i}" if i else c.name: digest_of(law)
            for c in scene.connections for i, law in enumerate(c.laws) if own(law)}


def refuse_other_laws(scene: SceneData) -> None:
    """Raise LawError where a law of a scene states something else than in the process that sent the scene to this one."""
    if scene._sent is None:
        return
    stated = stated_laws(scene)
    if other := next((item for item, sent in scene._sent.items() if stated.get(item) != sent), None):
        raise LawError(f"'{other}' states something else in this process than where the scene comes from: a process reads its "
                       f"class from the file, without what was changed elsewhere after the import; give what varies as a "
                       f"parameter (params = mb.params(...)), or pass executor=ThreadPoolExecutor()")
    scene._sent = None


class SceneData(BeamStatements, JointStatements, ContactStatements, ControlStatements):
    """Bodies, joints and forces by name. Lengths in m, angles in rad, SI throughout; inertial frame, right-handed.

    A mistake in a statement raises nothing at once: `check`, `simulate` and the other analyses raise SceneError with all."""

    #: what its own laws stated in the process that sent it to this one, until the first model of it is made; None: not sent
    _sent: dict[str, str] | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Pickle, with the process and what its own laws state here: code is sent by name, so that they may state something else
        where the scene arrives."""
        kept = {k: v for k, v in vars(self).items() if k not in ("_models", "_open_tree")}
        return kept | {"_sent": (_process(), stated_laws(self))}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Unpickle: the tables of its expressions are registered first, because another process does not know them."""
        for stored in tables_in(state["statements"]):
            from_data(*stored)
        vars(self).update(state)
        process, stated = state["_sent"]
        self._sent = None if process == _process() else stated

    # -- bodies

    @reads(name=reading.name, mass=MASS, inertia=reading.inertia, at=reading.point, rotation=reading.rotation,
           velocity=SPEED, angular_velocity=TURNING, shape=shapes, color=color, as_given=reading.switch, gravity=GRAVITY)
    @statement
    def rigid_body(self, name: str, mass: float, inertia: Any, at: Any = (0, 0, 0), rotation: Any = None,
                   velocity: Any = (0, 0, 0), angular_velocity: Any = (0, 0, 0), shape: Any = None,
                   color: Any = None, as_given: bool = False, gravity: Any = None) -> Body:
        """A rigid body: `mass` kg; `inertia` about its centre of mass in body axes, kg m^2 (one number: about z; 3
        principal values; or 3x3); `at` centre of mass, m; `rotation` 3x3 (body to inertial); `velocity` m/s and
        `angular_velocity` rad/s in the inertial frame. In pictures: `shape`, one of mb.Box, mb.Sphere, mb.Cylinder, mb.Plane,
        mb.Point as drawn, or a list of them, and `color` as matplotlib names it; neither changes the motion. as_given: True
        takes an inertia whose principal moments violate the triangle inequality, as no body's do, as it is. gravity (3,): that
        of this body, m/s^2; None: that of the scene."""
        R = np.eye(3) if rotation is None else rotation
        v, w, where = (np.array(a, dtype=float) for a in (velocity, angular_velocity, at))
        matrix, planar = mass_properties.matrix(np.asarray(inertia)), np.ndim(inertia) == 0
        self.problems += mass_properties.problems(name, matrix, planar, as_given)
        body = Body(name, mass, matrix, where, R, v, w, given_velocity=bool(np.any(v) or np.any(w)), outline=where[None],
                    principal_plane=planar, gravity=gravity)
        return self._add_body(looking(body, shape, color))

    @reads(name=reading.name, mass=MASS, at=reading.point, velocity=SPEED, shape=shapes, color=color, gravity=GRAVITY)
    @statement
    def point_mass(self, name: str, mass: float, at: Any, velocity: Any = (0, 0, 0), shape: Any = None,
                   color: Any = None, gravity: Any = None) -> Body:
        """A point mass without orientation, so that joints on it constrain no rotation. `shape`, `color`, `gravity` as in
        `rigid_body`."""
        speed = np.array(velocity, dtype=float)
        body = Body(name, mass, None, at, np.eye(3), speed, np.zeros(3), given_velocity=bool(np.any(speed)), outline=at[None],
                    is_point=True, gravity=gravity)
        return self._add_body(looking(body, shape, color))

    @reads(name=reading.name, points=reading.point, mass=MASS, mass_per_length=reading.quantity("kg/m", "not negative"),
           shape=shapes, color=color, gravity=GRAVITY)
    @statement
    def link(self, name: str, *points: Any, mass: float | None = None, mass_per_length: float | None = None, shape: Any = None,
             color: Any = None, gravity: Any = None) -> Body:
        """A rigid polyline of slender rods through `points` (m); `mass` kg in all, or `mass_per_length` kg/m. `shape`, `color`
        and `gravity` as in `rigid_body`."""
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
        body = Body(name, total, J, center, np.eye(3), np.zeros(3), np.zeros(3), outline=outline, gravity=gravity)
        return self._add_body(looking(body, shape, color))

    @reads(name=reading.name, body=reading.body, at=reading.point, rotation=reading.rotation)
    @statement
    def frame(self, name: str, body: Any, at: Any = None, rotation: Any = None) -> Body:
        """A named frame on a body, which moves nothing: `s.tree()` gives its Jacobian, r["its name"].position, .velocity, ... the
        motion of its origin in a run, and `rotation` that of the body. `at`: its origin, m, as drawn, by default
        the centre of mass; `rotation` 3x3, its axes as drawn, by default those of the body. The frame of a link of a robot file
        has the name of the link. Returns the body."""
        owner = body.body if isinstance(body, Place) else body
        if name in self.frames:
            self.problems.append(f"two frames have the name '{name}'; give each its own")
        point = where(self, f"frame '{name}'", body, at)
        self.frames[name] = FrameOnBody(name, owner, point, owner.drawn.rotation if rotation is None else rotation)
        return owner

    # -- forces

    @reads(name=reading.name, k=reading.body, l=reading.body, at_k=reading.point, at_l=reading.point,
           stiffness=reading.driven("N/m", True), damping=reading.driven("N s/m", True, least=FEEDS),
           length=reading.driven("m", True, least="no length is"))
    @statement
    def spring(self, name: str, k: Any, l: Any, at_k: Any, at_l: Any, stiffness: Any, damping: Any = 0.0,
               length: Any = None) -> Connection:
        """Spring (N/m) and damper (N s/m) between two points (m, as drawn); natural `length` m (default: as drawn). Each is a
        number or an expression of mb.t and sensors; what the changes of stiffness and length bring in is work."""
        natural = float(np.linalg.norm(at_l - at_k)) if length is None else length
        if damping and natural == 0:
            self.problems.append(f"spring '{name}': its natural length is 0 m, so its damper has no direction where the points "
                                 f"meet; use s.bushing, or give a length")
            damping = 0.0
        law = PointSpring(name, k, l, at_k, at_l=at_l, stiffness=stiffness, damping=damping or None, length=natural or None)
        return self._connect(Connection(name, "spring", k, l, [law]))

    @reads(name=reading.name, k=reading.body, l=reading.body, at_k=reading.point, at_l=reading.point, over=_pulleys,
           stiffness=reading.driven("N", True, least="a rope would push"), damping=reading.driven("N s", True, least=FEEDS),
           length=reading.driven("m", True, least="no length is"), radius_k=_radius, radius_l=_radius, axis=reading.direction)
    @statement
    def rope(self, name: str, k: Any, l: Any, at_k: Any, at_l: Any, stiffness: Any, damping: Any = 0.0, length: Any = None,
             over: Any = (), radius_k: Any = None, radius_l: Any = None, axis: Any = (0, 0, 1)) -> Connection:
        """A rope that pulls only, from a point of k over pulleys to one of l (m, as drawn): `stiffness` EA, N, tension over
        strain; `damping` N s, tension over rate of strain; natural `length` m (default: of its path as drawn). Each is a number
        or an expression of mb.t and sensors, such as the length of a winch.

        `over`: pulleys without friction in the order of the rope, (body, radius) or (body, radius, centre), m; the radius is
        positive where the rope goes about `axis` with the right hand. `radius_k`, `radius_l`: the end is wound on a drum about
        `axis` through at_k or at_l, without slip: two ropes that end on one wheel pass it without slip. Sensors: tension, length,
        and on_pulleys, the lengths that lie on pulleys; a run in which one becomes negative warns that the rope has left it."""
        z = reading.unit(axis)
        x = reading.unit(np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))]))
        radii = np.array([radius_k or 0.0, *(one[1] for one in over), radius_l or 0.0])
        bodies = [one[0].body if isinstance(one[0], Place) else one[0] for one in over]
        centers = [where(self, f"rope '{name}'", one[0], one[2] if len(one) > 2 else None) for one in over]
        spans, ways = tangents(np.array([at_k, *centers, at_l]), radii, z)
        wraps = wraps_of(ways, radii, z)
        natural = float(np.sum(np.linalg.norm(spans[:, 1] - spans[:, 0], axis=1)) + radii[1:-1] @ wraps)
        self._check_rope(f"rope '{name}'", bodies, natural if length is None or length else 0.0, wraps)
        numbers = {f"{what}_{n + 1}": float(value) for what, values in (("radius", radii[1:-1]), ("wrap", wraps))
                   for n, value in enumerate(values)}
        for side, radius, way in (("k", radius_k, ways[0]), ("l", radius_l, ways[-1])):
            if radius is not None:
                numbers |= {f"radius_{side}": radius, f"angle_{side}": float(np.arctan2(way @ np.cross(z, x), way @ x))}
        sides = {f"p{n + 1}": body for n, body in enumerate(bodies)} | {f"at_p{n + 1}": c for n, c in enumerate(centers)}
        if damping and paths(length):
            self.problems.append(f"rope '{name}': its damper cannot follow how fast a length changes that reads sensors; give "
                                 f"the length as an expression of mb.t, wind the end on a drum (radius_k=), or leave damping out")
        law = rope_over(len(over))(name, k, l, at_k, z, at_l, x, stiffness=stiffness, damping=damping or None,
                                   length=natural if length is None else length, **sides, **numbers)
        return self._connect(Connection(name, "rope", k, l, [law]))

    def _check_rope(self, item: str, bodies: list[Body], natural: float, wraps: Any) -> None:
        if not np.isfinite(natural) or natural == 0:
            self.problems.append(f"{item}: it has no length, or circles overlap or points meet as drawn: there is no tangent "
                                 f"between them; draw them apart")
        for body, wrap in zip(bodies, wraps, strict=True):
            if isinstance(body, Beam):
                self.problems.append(f"{item}: a pulley cannot be on the beam '{body.name}'; put a body on it by s.weld")
            if abs(wrap) > MOST_WRAPPED:
                self.problems.append(f"{item}: it would go round '{body.name}' by {np.degrees(abs(wrap)):.0f} deg as drawn; give "
                                     f"that pulley the radius with the other sign")

    @reads(name=reading.name, k=reading.body, l=reading.body, at=reading.point,
           stiffness=reading.along_axes("N/m", "N m/rad"), damping=reading.along_axes("N s/m", "N m s/rad", FEEDS))
    @statement
    def bushing(self, name: str, k: Any, l: Any, at: Any, stiffness: Any, damping: Any = (0, 0, 0)) -> Connection:
        """Elastic connection: 3 translational values (N/m, N s/m), or 6 with rotations (N m/rad, N m s/rad), along k's axes:
        numbers or expressions of mb.t and sensors."""
        values: dict[str, Any] = {}
        for entries, names in ((stiffness, "kr"), (damping, "cs")):
            for letter, part in zip(names, (entries[:3], entries[3:]), strict=True):
                if any(v != 0 for v in part):
                    values |= {letter + axis: v for axis, v in zip("xyz", part, strict=True)}
        own = {law: {p: values[p] for p in law.params if p in values} for law in (Bushing, RotationalBushing)}
        laws: list[TwoBodyLaw] = [law(name, k, l, at, **numbers) for law, numbers in own.items() if numbers]
        return self._connect(Connection(name, "bushing", k, l, laws or [Bushing(name, k, l, at)]))

    @reads(name=reading.name, body=reading.body, value=reading.components("N", sensors=True), at=reading.point, frame=FRAME)
    @statement
    def force(self, name: str, body: Any, value: Any, at: Any = None, frame: str = "inertial") -> Connection:
        """Applied force, N, three numbers or expressions of mb.t and sensors, in the inertial frame or along the body's axes; at
        the point `at`, m as drawn, by default the centre of mass."""
        return self._load("force", AppliedForce, ("fx", "fy", "fz"), name, body, value, at, frame)

    @reads(name=reading.name, body=reading.body, value=reading.components("N m", sensors=True), frame=FRAME)
    @statement
    def torque(self, name: str, body: Any, value: Any, frame: str = "inertial") -> Connection:
        """Applied torque, N m, three numbers or expressions of mb.t and sensors, inertial or along the body's axes."""
        return self._load("torque", AppliedTorque, ("mx", "my", "mz"), name, body, value, None, frame)

    def _load(self, kind: str, law: type[Force], names: tuple[str, ...], name: str, body: Any, value: Any, at: Any,
              frame: str) -> Connection:
        components = {n: v or None for n, v in zip(names, value, strict=True)}
        point = where(self, f"{kind} '{name}'", body, at)
        load = law(name, self.ground, body, point, following=frame == "body", **components)
        return self._connect(Connection(name, kind, self.ground, body, [load]))

    def _said(self) -> tuple[Any, ...] | None:
        """All that was stated: equal for scenes with the same equations. Classes of the user's own count by themselves, and their
        laws by what they state now. None where mistakes were found, or functions or further objects of the user's own take
        part."""
        laws = [law for c in self.connections for law in (*c.laws, *c.as_kinematic)]
        classes = {type(one) for law in laws for one in (law, *law.parts)}
        if self.problems or not all(isinstance(thing, type) for thing in self.own.values()):
            return None
        stated = stated_laws(self) if any(map(own_class, classes)) else {}
        text = repr((self.name, self.space, self.gravity.tolist(), self.statements, [encode(law) for law in laws], stated))
        if "'unreadable'" in text or not all(stated.values()):
            return None
        return text, type(self), frozenset(classes), str([sorted(vars(law)) for law in laws]), *self.own.items()

    def _copied(self, statements: list[Statement] | None = None) -> Any:
        """A scene made by the same statements, or by others, which nobody else changes."""
        return replay({"name": self.name, "gravity": self.gravity.tolist(), "space": self.space,
                       "statements": self.statements if statements is None else statements}, type(self), Known(dict(self.own)))

    def replace(self, *names: str, model: JointModel) -> Any:
        """A new scene with another model of the named joints; without names, of all joints of one or two coordinates that admit
        it. Raises SceneError where a name is no joint, or a joint does not admit the model."""
        return replaced(self, names, model)

    def recursive(self) -> Any:
        """A new scene whose joints are recursive where they form a tree; joints that close loops become kinematic, joints on
        point masses stay as they are."""
        return with_recursive_tree(self)
