"""Robots: files read into scenes, joint-space dynamics.

A robot as its file says it, and the scene that states it: what readers of files fill, whatever the format.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError, SceneError, warn
from mbdae.laws.friction import Coulomb
from mbdae.laws.joint_rows import Free
from mbdae.laws.joints import Planar, Prismatic, Revolute, Spherical
from mbdae.scene.components import Recursive, Stop
from mbdae.scene.shapes import Box, Cylinder, Sphere

EXTRA = "pip install 'mbdae[robots]'"


def library(name: str, what: str) -> Any:
    """A library of the extra `robots`."""
    try:
        return import_module(name)
    except ImportError as error:
        raise OptionError(f"{what} needs {name.partition('.')[0]}, which is not installed: {EXTRA}") from error


Array = NDArray[np.float64]
LAWS: dict[str, Any] = {"revolute": Revolute, "prismatic": Prismatic, "planar": Planar, "spherical": Spherical, "free": Free}
#: speed (rad/s or m/s) at which dry friction of a file, which jumps at rest, reaches its value
SMOOTH = 1e-3
#: how far (rad or m) a stop yields under the largest effort of its joint, or under the weight of what it carries
YIELD, EARTH = 1e-3, 9.81  #: EARTH: m/s^2, for weights where no gravity is stated
#: share of its largest principal moment by which a moment may exceed the sum of the others, from rounded files
ROUNDED = 1e-6
GROUND = "ground"  #: name of what carries all in a scene
#: inertia about a body's centre, over its mass times the square of 1 m, below which it counts as none
NONE = 1e-24


@dataclass
class Pose:
    """A frame in another one: axes R (3, 3) by columns, origin p (3,)."""

    R: Array = field(default_factory=lambda: np.eye(3))
    p: Array = field(default_factory=lambda: np.zeros(3))

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.R @ other.R, self.p + self.R @ other.p)

    def point(self, p: Any) -> Array:
        """A point given in this frame, in the frame that this one is given in."""
        return np.asarray(self.p + self.R @ np.asarray(p, dtype=float))


@dataclass
class Link:
    """A body: centre of mass (3,) and inertia (3, 3) about it, in axes of the link; shapes: kind, pose and sizes for pictures."""

    name: str
    mass: float = 0.0
    centre: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    shapes: list[tuple[str, Pose, tuple[float, ...]]] = field(default_factory=list)
    color: Any = None
    gravity: Any = None  #: (3,) its own, m/s^2; None: that of the scene
    velocity: Any = (0, 0, 0)  #: at the start, of a link that floats: of its centre, m/s, inertial; spin: rad/s
    spin: Any = (0, 0, 0)


@dataclass
class Joint:
    """How a child is carried: its frame in that of its parent at the file's zero; point and axis in axes of the child. kind: of
    `LAWS`, or "fixed". parent "": the ground. ref: value of the coordinate in the file at the drawing."""

    name: str
    kind: str
    parent: str
    child: str
    pose: Pose = field(default_factory=Pose)
    at: Array = field(default_factory=lambda: np.zeros(3))
    axis: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    limits: tuple[float | None, float | None] | None = None
    effort: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    rotor: float = 0.0
    spring: float = 0.0
    rest: float = 0.0
    start: float = 0.0
    rate: float = 0.0
    stop: Stop | None = None
    tied: bool = False  #: whether ties of joints say its start

    def inside(self) -> float:
        """The value within the limits that is nearest to the start."""
        low, high = self.limits or (None, None)
        return float(np.clip(self.start, -np.inf if low is None else low, np.inf if high is None else high))


@dataclass
class Robot:
    """Links and joints in the order of the file, parents first; closing: statements that close loops or tie coordinates, made
    after all joints, of the scene and of the bodies that links are part of ("": the ground); told: what the scene says otherwise
    than the file, or not at all; heard: those of them that change a run."""

    name: str
    links: dict[str, Link] = field(default_factory=dict)
    joints: list[Joint] = field(default_factory=list)
    closing: list[Callable[[Any, dict[str, Any]], Any]] = field(default_factory=list)
    roots: dict[str, Pose] = field(default_factory=dict)  #: links that float, with their poses in the drawing
    frames: dict[str, tuple[str, Pose]] = field(default_factory=dict)  #: further frames: link ("": the ground), pose on it
    told: list[str] = field(default_factory=list)
    heard: list[str] = field(default_factory=list)
    renamed: list[str] = field(default_factory=list)  #: what has another name in the scene than in the file

    def own_name(self, name: str, what: str, taken: Collection[str] = ()) -> str:
        """The name of an item of the file in the scene, where links, joints and the ground have names of their own; what: "link",
        "joint", ...; taken: names of other items."""
        if name != GROUND and name not in taken:
            return name
        own = f"{name} {what}"
        while own in taken:
            own = f"{own} {what}"
        self.renamed.append(f"{what} '{name}' is '{own}'")
        return own


def impossible(J: Array) -> bool:
    """Whether no body has this inertia: a principal moment exceeds the sum of the others, or is negative."""
    moments = np.sort(np.linalg.eigvalsh(J))
    return bool(moments[0] < -ROUNDED * moments[2] or moments[2] > moments[0] + moments[1] + ROUNDED * moments[2])


def checked(robot: Robot, keep: bool) -> None:
    """Refuse numbers that no body has; inertias that violate the triangle inequality are kept where that was asked for."""
    wrong = []
    for link in robot.links.values():
        if np.max(np.abs(link.inertia), initial=0.0) < NONE * (link.mass or 1.0):
            link.inertia = np.zeros((3, 3))
        if not (np.isfinite(link.mass) and np.all(np.isfinite(link.inertia)) and np.all(np.isfinite(link.centre))):
            wrong.append(f"link '{link.name}': its mass, centre or inertia is not finite")
        elif link.mass < 0:
            wrong.append(f"link '{link.name}': its mass {link.mass:g} kg is negative")
        elif impossible(link.inertia):
            values = np.linalg.eigvalsh(link.inertia)
            moments = ", ".join(f"{m:.4g}" for m in values)
            text = f"link '{link.name}': no body has principal moments of inertia {moments} kg m^2: one exceeds the others' sum"
            if not keep or values[0] < -ROUNDED * abs(values[2]):
                wrong.append(f"{text}, or is negative; correct the file" + ("" if keep else ", or pass keep_inertias=True"))
            else:
                robot.heard.append(f"{text}; it was kept, as asked")
    for joint in robot.joints:
        numbers = [*joint.pose.R.ravel(), *joint.pose.p, *joint.at, *joint.axis, joint.damping, joint.friction, joint.rotor]
        if not np.all(np.isfinite(numbers)):
            wrong.append(f"joint '{joint.name}': a number of it is not finite")
        elif joint.kind in ("revolute", "prismatic", "planar") and not np.linalg.norm(joint.axis) > 0:
            wrong.append(f"joint '{joint.name}': its axis is zero; correct the file")
        elif min(joint.damping, joint.friction, joint.rotor, joint.spring) < 0:
            wrong.append(f"joint '{joint.name}': its damping, friction, armature or stiffness is negative; correct the file")
    if wrong:
        raise SceneError(wrong)


def build(make: Any, robot: Robot, gravity: Any, keep: bool) -> Any:
    """The scene of a robot. make: the class of scenes."""
    checked(robot, keep)
    s = make(robot.name, gravity=tuple(gravity))
    poses: dict[str, Pose] = {"": Pose()}
    carried = {j.child: j for j in robot.joints}
    bodies: dict[str, Any] = {"": s.ground}
    moved = {j.parent for j in robot.joints if j.kind != "fixed"} | {j.child for j in robot.joints if j.kind != "fixed"}
    for link in robot.links.values():
        joint = carried.get(link.name)
        poses[link.name] = poses[joint.parent] @ joint.pose if joint else robot.roots.get(link.name, Pose())
    weights = _weights(robot, poses, gravity)
    for link in robot.links.values():
        joint, pose = carried.get(link.name), poses[link.name]
        fixed = joint is None or joint.kind == "fixed"
        on = bodies[joint.parent] if joint else s.ground
        held = joint is not None and fixed and on is s.ground
        empty = not link.mass and not np.any(link.inertia)
        if fixed and (held or empty) and (joint is not None or empty):
            bodies[link.name] = on  # no body of its own: a frame on what carries it
        else:
            bodies[link.name] = s.rigid_body(link.name, link.mass, link.inertia, at=pose.point(link.centre), rotation=pose.R,
                                             shape=[_shape(pose @ at, kind, size) for kind, at, size in link.shapes] or None,
                                             color=link.color, as_given=True, gravity=link.gravity, velocity=link.velocity,
                                             angular_velocity=link.spin)
        s.frame(link.name, bodies[link.name], at=pose.p, rotation=pose.R)
        if joint is not None and bodies[link.name] is not on:
            _joint(s, robot, joint, on, bodies[link.name], pose, weights.get(joint.name, 0.0))
    for name, (on, at) in robot.frames.items():
        pose = poses[on] @ at
        s.frame(name, bodies[on], at=pose.p, rotation=pose.R)
    for make_closing in robot.closing:
        make_closing(s, bodies)
    _massless(s, robot, moved)
    if s.problems:
        raise SceneError(list(s.problems))
    if robot.renamed:
        s.told.append(f"named otherwise than in the file, since other items have these names: {', '.join(robot.renamed)}")
    s.told.extend(robot.told + robot.heard)
    for text in robot.heard:
        warn(text)
    return s


def _massless(s: Any, robot: Robot, moved: set[str]) -> None:
    """Refuse a moving link at the end of a chain without any mass: nothing says how it accelerates."""
    heavy = {name for name, link in robot.links.items() if link.mass}
    rotors = {j.child for j in robot.joints if j.rotor > 0}
    for joint in reversed(robot.joints):
        if joint.child in heavy or joint.child in rotors:
            heavy.add(joint.parent)
    for joint in robot.joints:
        if joint.kind != "fixed" and joint.child not in heavy and joint.child not in rotors:
            s.problems.append(f"joint '{joint.name}': link '{joint.child}' and all that it carries have no mass, so that nothing "
                              f"says how it moves; give it a mass, or make the joint fixed")


def _joint(s: Any, robot: Robot, joint: Joint, k: Any, l: Any, pose: Pose, weight: float) -> None:
    at = pose.point(joint.at)
    if joint.kind == "fixed":
        s.weld(joint.name, k, l, at=at)
        return
    law = LAWS[joint.kind]
    if joint.kind == "free":  # displacements along the axes of the parent
        s.joint(law, joint.name, k, l, at=at, axis=(pose.R @ joint.pose.R.T)[:, 2], axis_x=(pose.R @ joint.pose.R.T)[:, 0],
                model=Recursive())
        if joint.damping:
            damped(s, joint.name, k, l, at, (joint.damping, joint.damping))
        return
    options: dict[str, Any] = {}
    if joint.kind in ("revolute", "prismatic"):
        options = _options(robot, joint, weight)
    elif joint.kind == "planar" and joint.damping:
        options["damper"] = dict.fromkeys(("x", "y", "angle"), joint.damping)
    axis = pose.R @ joint.axis
    if joint.kind in ("revolute", "prismatic", "planar"):
        axis = axis / np.linalg.norm(axis)
    s.joint(law, joint.name, k, l, at=at, axis=(0, 0, 1) if joint.kind == "spherical" else axis, model=Recursive(), **options)
    if joint.kind == "spherical" and joint.damping:
        damped(s, joint.name, k, l, at, (0.0, joint.damping))


def damped(s: Any, joint: str, k: Any, l: Any, at: Any, damping: tuple[float, float]) -> None:
    """Damping (N s/m, N m s/rad), equal in all directions, of the motion of l relative to k."""
    s.bushing(f"damping of {joint}", k, l, at=at, stiffness=(0,) * 6, damping=(*(damping[0],) * 3, *(damping[1],) * 3))


def _weights(robot: Robot, poses: dict[str, Pose], gravity: Any) -> dict[str, float]:
    """Of joints by name the weight of what they carry, N, of hinges times its distance from their axes as drawn, N m."""
    size, found, beyond = float(np.linalg.norm(gravity)) or EARTH, dict[str, float](), dict[str, list[Link]]()
    for joint in reversed(robot.joints):
        links = [robot.links[joint.child], *beyond.get(joint.child, [])]
        beyond.setdefault(joint.parent, []).extend(links)
        pose = poses[joint.child]
        if joint.kind in ("revolute", "prismatic") and joint.limits is not None:
            axis = pose.R @ joint.axis / np.linalg.norm(joint.axis)
            arms = [poses[link.name].point(link.centre) - pose.point(joint.at) for link in links]
            levers = [np.linalg.norm(np.cross(axis, arm)) if joint.kind == "revolute" else 1.0 for arm in arms]
            found[joint.name] = size * float(sum(link.mass * lever for link, lever in zip(links, levers, strict=True)))
    return found


def _options(robot: Robot, joint: Joint, weight: float) -> dict[str, Any]:
    unit, effort = ("rad", "N m") if joint.kind == "revolute" else ("m", "N")
    options: dict[str, Any] = {}
    if joint.limits is not None:
        options["limits"] = joint.limits
        options["stop"] = joint.stop or Stop((max(joint.effort, weight) or 1.0) / YIELD, 0.0)
        if (inside := joint.inside()) != joint.start:
            robot.heard.append(f"joint '{joint.name}': its start {joint.start:g} {unit} is outside of its limits; " + (
                "ties of joints demand it, and its stop pushes it back" if joint.tied else f"it starts at {inside:g}"))
            joint.start = joint.start if joint.tied else inside
        if joint.stop is None:
            robot.told.append(f"joint '{joint.name}': its limits are elastic stops of {options['stop'].stiffness:g} "
                              f"{effort}/{unit} without damping, which the file does not say; limits=False leaves them out, "
                              f"or pass stop=")
    if joint.start:
        options["start"] = joint.start
    if joint.rate:
        options["start_rate"] = joint.rate
    if joint.damping:
        options["damper"] = joint.damping
    if joint.spring:
        options["spring"] = joint.spring
        if joint.rest:
            options["load"] = joint.spring * joint.rest
    if joint.rotor:
        options["rotor"] = joint.rotor
    if joint.friction:
        options |= {"friction": Coulomb(1.0, SMOOTH), "normal_force": joint.friction} | (
            {"radius": 1.0} if joint.kind == "revolute" else {})
        robot.told.append(f"joint '{joint.name}': its dry friction of {joint.friction:g} {effort} is smoothed below {SMOOTH:g} "
                          f"{unit}/s")
    return options


def _shape(pose: Pose, kind: str, size: tuple[float, ...]) -> Any:
    if kind == "sphere":
        return Sphere(tuple(pose.p), radius=size[0])
    if kind == "cylinder":
        return Cylinder(tuple(pose.p), axis=tuple(pose.R[:, 2]), radius=size[0], length=size[1])
    return Box(tuple(pose.p), size=size, rotation=pose.R)
