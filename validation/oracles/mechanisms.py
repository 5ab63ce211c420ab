"""Mechanisms with loops, drawn at random for a test: as data of the hand-written reference, and as scenes of the package."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import sympy as sp
from scipy.spatial.transform import Rotation

import mbdae as mb
from mbdae.laws.joint_rows import same_point
from mbdae.system.model.nodes import joint_axes
from oracles.bodies import GROUND, Body, Input, Joint, Load, Mechanism, Spring, State, perpendicular

LETTERS = {"R": "revolute", "P": "prismatic", "S": "spherical", "U": "universal", "D": "distance", "W": "weld",
           "O": "fixed_orientation"}

FORCE = (Input(0.8, 0.3, -0.5, 2.0), Input(-1.1), Input(0.4, -0.7))  #: the same in all: expressions are compiled once
TORQUE = (Input(-0.6), Input(0.2, 0.5, 0.9, 3.0), Input(0.7, -0.4))
COORDINATE = ("revolute", "prismatic")  #: kinds of joints with one coordinate, which have models


class Universal(mb.Joint):
    """The points coincide; k.z stays perpendicular to the pin of l, l.x along + l.y across."""

    params = mb.params(along=("1", "pin along l.x"), across=("1", "pin along l.y"))

    def constraints(self, k, l):
        return same_point(k, l) | {"cross": k.z @ (l.x * self.along + l.y * self.across)}


# ---- drawing


def unit(rng):
    """A random direction."""
    a = rng.normal(size=3)
    return a / np.linalg.norm(a)


def a_body(rng, name, at, point=False):
    """A body of random inertia and attitude."""
    mass = rng.uniform(0.5, 2.0)
    if point:
        return Body(name, mass, None, np.asarray(at, dtype=float))
    R = Rotation.random(random_state=rng).as_matrix()
    lumps = rng.normal(size=(6, 3)) * 0.3
    J = mass / 6 * (np.sum(lumps**2) * np.eye(3) - lumps.T @ lumps)
    return Body(name, mass, J, np.asarray(at, dtype=float), R)


def a_joint(rng, letter, name, k, l, at, axis=None, **own):
    """A joint by its letter, about a random axis."""
    axis = unit(rng) if axis is None else axis
    if letter == "D":
        own["at_l"] = at + 0.4 * unit(rng)
    if letter == "U" and "pin" not in own:
        x, y = perpendicular(axis)
        angle = rng.uniform(0, 2 * np.pi)
        own["pin"] = np.cos(angle) * x + np.sin(angle) * y
    return Joint(LETTERS[letter], name, k, l, np.asarray(at, dtype=float), axis, **own)


def around(rng, mechanism):
    """The mechanism with gravity, a spring between two bodies, one to the ground, a damper, a force and a torque of time."""
    n, bodies = len(mechanism.bodies), mechanism.bodies
    turning = [i for i, b in enumerate(bodies) if b.inertia is not None]
    first, last = turning[0], turning[-1]

    def near(i):
        return bodies[i].at + 0.2 * rng.normal(size=3)

    springs = [Spring("to ground", GROUND, first, 1.5 * unit(rng), near(first), rng.uniform(5, 20), rng.uniform(0.1, 1), 0.7)]
    if first != last:
        springs.append(Spring("between", first, last, near(first), near(last), rng.uniform(5, 20), rng.uniform(0.1, 1), 0.3))
    loads = (Load("push", n // 2, FORCE, near(n // 2) if bodies[n // 2].inertia is not None else bodies[n // 2].at),
             Load("twist", first, TORQUE, following=True))
    return replace(mechanism, springs=tuple(springs), loads=loads, gravity=9.81 * unit(rng))


def acted(rng, joints, springs=(), drives=()):
    """The joints with springs, dampers and loads, or drives, on the coordinates of some, by their numbers."""
    out = list(joints)
    for i in springs:
        out[i] = replace(out[i], spring=rng.uniform(2, 10), damper=rng.uniform(0.1, 1), load=rng.normal())
    for i in drives:
        out[i] = replace(out[i], drive=Input(0.1 * rng.normal(), rng.normal(), 0.2 * rng.normal(), 2.0))
    return tuple(out)


def loop(rng, letters, points=(), springs=(0,), drives=()):
    """A chain from the ground to the ground, joints by their letters, points and axes at random; points: numbers of the bodies
    that are mass points."""
    n = len(letters) - 1
    angles = 2 * np.pi * np.arange(n + 1) / (n + 1)
    places = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(n + 1)]) + 0.25 * rng.normal(size=(n + 1, 3))
    centres = [(places[i] + places[i + 1]) / 2 + 0.1 * rng.normal(size=3) for i in range(n)]
    for i in points:
        centres[i] = places[i]
        places[i + 1] = places[i]
    bodies = tuple(a_body(rng, f"b{i}", c, i in points) for i, c in enumerate(centres))
    ends = [GROUND, *range(n), GROUND]
    joints = [a_joint(rng, a, f"J{i}", ends[i], ends[i + 1], places[i]) for i, a in enumerate(letters)]
    return around(rng, Mechanism(bodies, acted(rng, joints, springs, drives)))


def second_loop(rng, mechanism, letters, start, end, springs=()):
    """The mechanism with a further chain between two of its bodies."""
    n, m = len(mechanism.bodies), len(letters) - 1
    begin, finish = mechanism.drawn.r[start] + 0.3 * unit(rng), mechanism.drawn.r[end] + 0.3 * unit(rng)
    shares = np.arange(m + 1)[:, None] / max(m, 1)
    out = np.sin(np.pi * shares) * unit(rng)
    places = begin + shares * (finish - begin) + out + 0.1 * rng.normal(size=(m + 1, 3))
    bodies = [a_body(rng, f"c{i}", (places[i] + places[i + 1]) / 2 + 0.1 * rng.normal(size=3)) for i in range(m)]
    ends = [start, *range(n, n + m), end]
    joints = [a_joint(rng, a, f"K{i}", ends[i], ends[i + 1], places[i]) for i, a in enumerate(letters)]
    return replace(mechanism, bodies=(*mechanism.bodies, *bodies), joints=(*mechanism.joints, *acted(rng, joints, springs)))


# ---- random starts


@dataclass(frozen=True)
class Drawn:
    """A mechanism with what a start states: the value of a joint that is held, and velocities (n, 6) of the bodies."""

    mechanism: Mechanism
    hold: dict[str, float]
    velocities: np.ndarray

    def nearer(self, share):
        """The same, that far from where it is drawn: not every loop closes anywhere."""
        joints = (j if j.drive is None else replace(j, drive=j.drive.moved((share - 1) * j.drive(0.0)[0]))
                  for j in self.mechanism.joints)
        return Drawn(replace(self.mechanism, joints=tuple(joints)), {k: share * v for k, v in self.hold.items()}, self.velocities)


def start_of(rng, mechanism):
    """Where and how fast a mechanism starts: its first free angle or displacement away from where it is drawn."""
    free = [j.name for j in mechanism.joints if j.kind in COORDINATE and j.drive is None]
    velocities = 3.0 * rng.normal(size=(len(mechanism.bodies), 6)) * mechanism.moving.reshape(-1, 6)
    driven = any(j.drive is not None for j in mechanism.joints)
    return Drawn(mechanism, {} if driven or not free else {free[0]: rng.uniform(0.05, 0.2)}, velocities)


def flattened(start):
    """The start of a planar mechanism with everything in the plane z = 0, its bodies too."""
    m, flat = start.mechanism, np.array([1.0, 1.0, 0.0])
    bodies = []
    for b in m.bodies:
        R = Rotation.from_rotvec([0, 0, np.arctan2(b.rotation[1, 0], b.rotation[0, 0])]).as_matrix()
        J = b.inertia.copy()
        J[2, :2] = J[:2, 2] = 0.0
        bodies.append(replace(b, at=flat * b.at, rotation=R, inertia=J))
    joints = tuple(replace(j, at=flat * j.at, axis=np.round(j.axis, 15)) for j in m.joints)
    springs = tuple(replace(s, at=flat * s.at, at_l=flat * s.at_l) for s in m.springs)
    none = Input()
    loads = tuple(replace(load, at=flat * load.at, value=(*load.value[:2], none)) if load.at is not None else
                  replace(load, value=(none, none, load.value[2])) for load in m.loads)
    m = replace(m, bodies=tuple(bodies), joints=joints, springs=springs, loads=loads, gravity=flat * m.gravity)
    return Drawn(m, start.hold, start.velocities * np.array([1.0, 1, 0, 0, 0, 1]))


# ---- as scenes


def text(i):
    """An input as an expression of time, or a number."""
    return i.constant + i.slope * mb.t + i.height * sp.sin(i.frequency * mb.t + 1) if i.slope or i.height else i.constant


def scene_of(mechanism, models=None, hold=None, velocities=None, space="auto", name="drawn"):
    """The scene of a mechanism. models: of its joints, by their names; hold: name of a joint -> its angle or displacement at the
    start; velocities: (n, 6) of the bodies as stated, inertial frame."""
    s = mb.Scene(name, gravity=tuple(mechanism.gravity), space=space)
    given, made = np.zeros((len(mechanism.bodies), 6)) if velocities is None else velocities, []
    for b, u in zip(mechanism.bodies, given, strict=True):
        if b.inertia is None:
            made.append(s.point_mass(b.name, b.mass, at=b.at, velocity=u[:3]))
        else:
            made.append(s.rigid_body(b.name, b.mass, b.inertia, at=b.at, rotation=b.rotation, velocity=u[:3],
                                     angular_velocity=u[3:]))
    made.append(s.ground)
    for joint in mechanism.joints:
        add_joint(s, joint, made[joint.k], made[joint.l], (models or {}).get(joint.name), (hold or {}).get(joint.name))
    for spring in mechanism.springs:
        ends = made[spring.k], made[spring.l], spring.at, spring.at_l
        s.spring(spring.name, *ends, spring.stiffness, spring.damping, spring.length)
    for load in mechanism.loads:
        value, frame = [text(part) for part in load.value], "body" if load.following else "inertial"
        if load.at is None:
            s.torque(load.name, made[load.body], value, frame=frame)
        else:
            s.force(load.name, made[load.body], value, at=load.at, frame=frame)
    return s


def add_joint(s, joint, k, l, model, held):
    """A joint of a mechanism in a scene."""
    what = {"revolute": ("angle", "torque"), "prismatic": ("position", "force")}.get(joint.kind)
    if what is not None:
        options = {"model": model, "spring": joint.spring or None, "damper": joint.damper or None, what[1]: joint.load or None}
        options |= {what[0]: None if joint.drive is None else text(joint.drive), what[0] + "0": held}
        getattr(s, joint.kind)(joint.name, k, l, at=joint.at, axis=joint.axis, **options)
    elif joint.kind == "universal":
        law = Universal(joint.name, k, l, at=joint.at, axis=joint.axis)
        law.along, law.across = (float(joint.pin @ a) for a in joint_axes(law, k).T[:2])
        s.add(law)
    elif joint.kind == "distance":
        s.distance(joint.name, k, l, joint.at, joint.at_l)
    elif joint.kind == "fixed_orientation":
        s.fixed_orientation(joint.name, k, l)
    else:
        getattr(s, joint.kind)(joint.name, k, l, at=joint.at)


def state_of(prepared, t, q, u):
    """The state of the bodies of a prepared scene."""
    bodies = prepared.model.scene.bodies
    r, v, w = np.zeros((3, len(bodies) + 1, 3))
    R = np.broadcast_to(np.eye(3), (len(bodies) + 1, 3, 3)).copy()
    for i, b in enumerate(bodies):
        node = prepared.model.node(b)
        size, speeds = node.kind.sizes
        own, rate = q[node.q : node.q + size], u[node.u : node.u + speeds]
        if size == 7:
            r[i], R[i], v[i] = own[:3], Rotation.from_quat(own[[4, 5, 6, 3]]).as_matrix(), rate[:3]
            w[i] = R[i] @ rate[3:]
        else:
            n = 2 if prepared.model.planar else 3
            r[i, :n], v[i, :n] = own[:n], rate[:n]
            if n == 2 and size == 3:
                R[i], w[i, 2] = Rotation.from_rotvec([0, 0, own[2]]).as_matrix(), rate[2]
    return State(t, r, R, v, w)


def node_accelerations(prepared, state, a, coordinates):
    """Accelerations of the unknowns of all nodes (nu,) from those of the bodies (n, 6), inertial frame, and of joint coordinates
    by their joint's name."""
    out = np.zeros(prepared.model.nu)
    for i, b in enumerate(prepared.model.scene.bodies):
        node = prepared.model.node(b)
        speeds = node.kind.sizes[1]
        planar = prepared.model.planar
        own = a[i, :3] if b.is_point else np.r_[a[i, :3], state.R[i].T @ a[i, 3:]]
        out[node.u : node.u + speeds] = own[[0, 1] if b.is_point else [0, 1, 5]] if planar else own
    for node in prepared.model.joint_coordinates:
        turns = node.kind.sizes[1] == 3
        out[node.u : node.u + node.kind.sizes[1]] = rotation_rate(prepared, state, a, node) if turns else coordinates[node.name]
    return out


def rotation_rate(prepared, state, a, node):
    """Rate (3,) of the angular velocity of l relative to k along the axes of the joint in l, of a free rotation."""
    scene = prepared.model.scene
    joint = scene[node.joint]

    def turning(body):
        i = None if body.is_ground else scene.bodies.index(body)
        return (np.eye(3), np.zeros(3), np.zeros(3)) if i is None else (state.R[i], state.w[i], a[i, 3:])

    (_, wk, ak), (R, wl, al) = turning(joint.k), turning(joint.l)
    axes = R @ joint.l.drawn.rotation.T @ joint_axes(joint.joint, joint.k)
    return axes.T @ (al - ak + np.cross(wl, wk))
