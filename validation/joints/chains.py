"""Random chains of bodies in space, as the hand-written reference has them and as scenes; the same state in every joint model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import symengine as se
import sympy as sp
from joints.kinematics import KINDS, LEAD, STROKE
from joints.oracle import Chain, Link, Moving, Wave, accelerations
from scipy.spatial.transform import Rotation

import mbdae as mb
from mbdae.laws.joint_rows import FixedOrientation, Free, PointOnLine, PointOnPlane
from mbdae.laws.joints import Cylindrical, Planar, Prismatic, Revolute, Screw, Spherical, Universal
from mbdae.results.sensors import wrenches
from mbdae.results.states import States
from mbdae.system.prepare import Prepared


class Cam(mb.Joint):
    """A user's joint: l turns about k.z and slides along its own x axis as a cam tells it."""

    coordinates = mb.params(turn=("rad", "rotation about k.z"))
    params = mb.params(stroke=("m", "largest travel"))

    def motion(self, from_k):
        return from_k.about("z", self.turn).along("x", self.stroke * se.sin(2 * self.turn))


class Boom(mb.Joint):
    """A user's joint of two coordinates: an arm that swings about k.y and reaches out along its own z axis."""

    coordinates = mb.params(swing=("rad", "rotation about k.y"), reach=("m", "displacement along l.z"))

    def motion(self, from_k):
        return from_k.about("y", self.swing).along("z", self.reach)


LAWS: dict[str, Any] = {
    "revolute": (Revolute, {}), "prismatic": (Prismatic, {}), "cylindrical": (Cylindrical, {}), "screw": (Screw, {"lead": LEAD}),
    "universal": (Universal, {}), "planar": (Planar, {}), "spherical": (Spherical, {}), "free": (Free, {}),
    "point_on_line": (PointOnLine, {}), "point_on_plane": (PointOnPlane, {}), "fixed_orientation": (FixedOrientation, {}),
    "cam": (Cam, {"stroke": STROKE}), "boom": (Boom, {}),
}
MODELS = (mb.Kinematic(), mb.Classical(), mb.Recursive())
FORCE = (Wave(0.8, 0.3, -0.5, 2.0), Wave(-1.1), Wave(0.4, -0.7))  #: the same in all chains: expressions are compiled once
TORQUE = (Wave(-0.6), Wave(0.2, 0.5, 0.9, 3.0), Wave(0.7, -0.4))
DRIVE = Wave(0.1, 0.4, 0.2, 2.0)


# ---- drawing


def unit(rng: np.random.Generator) -> np.ndarray:
    """A random direction."""
    a = rng.normal(size=3)
    return a / np.linalg.norm(a)


def drawn(rng: np.random.Generator, kinds: Sequence[str], outer: str, driven: int | None = None) -> Chain:
    """A chain of joints of these kinds from the ground; outer: for every joint "k" or "l", the side that is its outer body;
    driven: number of the joint whose last coordinate is prescribed."""
    links, at = [], 0.5 * unit(rng)
    for i, (kind, side) in enumerate(zip(kinds, outer, strict=True)):
        size, lumps, mass = len(KINDS[kind].scalars), rng.normal(size=(6, 3)) * 0.3, rng.uniform(0.5, 2.0)
        inertia = mass / 6 * (np.sum(lumps**2) * np.eye(3) - lumps.T @ lumps)
        axes, rotation = (Rotation.random(random_state=rng).as_matrix() for _ in range(2))
        centre = at + 0.4 * unit(rng)
        on = rng.uniform(2, 10, size), rng.uniform(0.1, 1, size), rng.normal(size=size)
        links.append(Link(kind, side, at, axes, mass, inertia, centre, rotation, *on,
                          {size - 1: DRIVE} if i == driven and size else {}))
        at = centre + 0.4 * unit(rng)
    return Chain(tuple(links), 9.81 * unit(rng), FORCE, at, TORQUE)


def admits(chain: Chain, mixed: bool = True) -> list[list[Any]]:
    """The models of its joints: all of them kinematic, classical where that exists, recursive, and the three in turn."""
    kinematic, classical, recursive = MODELS
    without = [link.joint.rotates for link in chain.links]
    found = [[kinematic for _ in without], [kinematic if w else classical for w in without], [recursive for _ in without]]
    turns = [[recursive, kinematic, classical][i % 3] for i in range(len(without))]
    return [*found, [kinematic if w and m is classical else m for m, w in zip(turns, without, strict=True)]] if mixed else found


def random_state(rng: np.random.Generator, chain: Chain) -> tuple[float, np.ndarray, np.ndarray]:
    """t, coordinates up to 1 (rad or m), and rates."""
    positions, rates = chain.sizes
    t, q, v = rng.uniform(0, 1), rng.uniform(-1, 1, positions), 2 * rng.normal(size=rates)
    for link, (at, _) in zip(chain.links, chain.parts, strict=True):
        if link.joint.rotates:
            turn = slice(at.stop - 4, at.stop)
            q[turn] /= np.linalg.norm(q[turn])
    return (t, *chain.prescribed(t, q, v))


def as_drawn(chain: Chain, q: np.ndarray) -> np.ndarray:
    """The positions without the rotations, whose start no statement gives."""
    q = q.copy()
    for link, (at, _) in zip(chain.links, chain.parts, strict=True):
        if link.joint.rotates:
            q[at.stop - 4 : at.stop] = [1, 0, 0, 0]
    return q


# ---- as scenes


def text(wave: Wave) -> Any:
    """A wave as an expression of time."""
    return wave.constant + wave.slope * mb.t + wave.height * sp.sin(wave.frequency * mb.t + 1)


def scene_of(chain: Chain, models: Sequence[Any], q: np.ndarray | None = None, v: np.ndarray | None = None) -> mb.Scene:
    """The scene of a chain with its joints in these models, started at positions q, rotations as drawn, with rates v."""
    s = mb.Scene("chain", gravity=tuple(chain.gravity))
    none = np.zeros(chain.sizes[1])
    q, v = as_drawn(chain, np.zeros(chain.sizes[0])) if q is None else q, none if v is None else v
    before, moving = s.ground, chain.motion(q, v, none)
    options = ("spring", "damper", "load")
    for i, (link, (at, rate), model) in enumerate(zip(chain.links, chain.parts, models, strict=True)):
        speeds = {"velocity": moving[i].v, "angular_velocity": moving[i].w} if any(a.joint.rotates for a in chain.links) else {}
        body = s.rigid_body(f"b{i}", link.mass, link.inertia, at=link.centre, rotation=link.rotation, **speeds)
        names, (law, numbers) = link.joint.scalars, LAWS[link.kind]
        start = {} if speeds else {names[n]: v[rate][n] for n in range(len(names)) if n not in link.drives}
        k, l = (before, body) if link.outer == "l" else (body, before)
        s.joint(law, f"J{i}", k, l, at=link.at, axis=link.axes[:, 2], axis_x=link.axes[:, 0], model=model, **numbers,
                prescribed={names[n]: text(wave) for n, wave in link.drives.items()} or None,
                start={names[n]: q[at][n] for n in range(len(names)) if n not in link.drives} or None, start_rate=start or None,
                **{option: dict(zip(names, getattr(link, option), strict=True)) or None for option in options})
        before = body
    s.force("push", before, [text(w) for w in chain.push], at=chain.tip)
    s.torque("twist", s["b0"], [text(w) for w in chain.twist], frame="body")
    return s


def unknowns(chain: Chain, prepared: Prepared, bodies: Sequence[Moving], q: np.ndarray,
             v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of all nodes of a prepared scene, in a state of the chain."""
    model = prepared.model
    all_q, all_u = np.zeros(model.nq), np.zeros(model.nu)
    for i, (link, b) in enumerate(zip(chain.links, bodies, strict=True)):
        node = model.node(model.scene.bodies[i])
        R = b.turn @ link.rotation
        all_q[node.q : node.q + 7] = np.r_[b.r, Rotation.from_matrix(R).as_quat()[[3, 0, 1, 2]]]
        all_u[node.u : node.u + 6] = np.r_[b.v, R.T @ b.w]
    for node, at, rate in coordinate_nodes(chain, prepared):
        all_q[node.q : node.q + node.kind.sizes[0]], all_u[node.u : node.u + node.kind.sizes[1]] = q[at], v[rate]
    return all_q, all_u


def coordinate_nodes(chain: Chain, prepared: Prepared) -> Iterator[tuple[Any, slice, slice]]:
    """Nodes of joint coordinates, with their positions and rates in the chain."""
    for i, (link, (at, rate)) in enumerate(zip(chain.links, chain.parts, strict=True)):
        for n, (name, unit) in enumerate(link.joint.coordinates.items()):
            node, wide = prepared.model.coordinate_node(f"J{i}", name), (4, 3) if unit == "rotation" else (1, 1)
            if node is not None:
                yield node, *(slice(part.start + n, part.start + n + size) for part, size in zip((at, rate), wide, strict=True))


@dataclass(frozen=True)
class Mechanics:
    """Accelerations of bodies (n, 6), inertial frame; (joints, 6) force and torque of joints on l, about the point of l; (n,)
    second derivatives of the coordinates, nan where they are no unknowns."""

    bodies: np.ndarray
    joints: np.ndarray
    coordinates: np.ndarray


def by_hand(chain: Chain, t: float, q: np.ndarray, v: np.ndarray) -> Mechanics:
    """By the reference."""
    a = chain.second(t, q, v)
    bodies = chain.motion(q, v, a)
    return Mechanics(accelerations(bodies), chain.wrenches(t, bodies), a)


def by_package(chain: Chain, prepared: Prepared, t: float, q: np.ndarray, v: np.ndarray) -> Mechanics:
    """By the package, in the same state."""
    bodies = chain.motion(q, v, np.zeros(len(v)))
    all_q, all_u = unknowns(chain, prepared, bodies, q, v)
    s = np.zeros((1, len(prepared.mechanics.numbering.states)))
    at = np.array([t])
    a = prepared.mechanics.accelerations(at, all_q[None], all_u[None], s)[0][0]
    shown, coordinates = np.zeros((len(bodies), 6)), np.full(len(v), np.nan)
    for i, (link, b) in enumerate(zip(chain.links, bodies, strict=True)):
        node = prepared.model.node(prepared.model.scene.bodies[i])
        shown[i] = np.r_[a[node.u : node.u + 3], b.turn @ link.rotation @ a[node.u + 3 : node.u + 6]]
    for node, _, rate in coordinate_nodes(chain, prepared):
        coordinates[rate] = a[node.u : node.u + node.kind.sizes[1]]
    names = [c.name for c in prepared.model.scene.connections]
    forces = wrenches(prepared, States(at, all_q[None], all_u[None], s, None))[0]
    return Mechanics(shown, forces[[names.index(f"J{i}") for i in range(len(bodies))]], coordinates)


def off(found: Mechanics, reference: Mechanics) -> tuple[float, float]:
    """Differences of accelerations and of joint forces, over the largest of each."""
    known = ~np.isnan(found.coordinates)
    size = max(np.max(np.abs(reference.bodies)), np.max(np.abs(reference.coordinates)))
    apart = max(np.max(np.abs(found.bodies - reference.bodies)),
                np.max(np.abs(found.coordinates - reference.coordinates)[known], initial=0.0))
    return apart / size, np.max(np.abs(found.joints - reference.joints)) / np.max(np.abs(reference.joints))


# ---- starts and runs


def start_off(chain: Chain, prepared: Prepared, t: float, q: np.ndarray, v: np.ndarray) -> float:
    """How far the start is off that states coordinates and rates: positions, velocities and accelerations of the unknowns, each
    over the largest."""
    a = chain.second(t, q, v)
    bodies = chain.motion(q, v, a)
    all_q, all_u = unknowns(chain, prepared, bodies, q, v)
    begin, found = prepared.start, []
    for i, (link, b) in enumerate(zip(chain.links, bodies, strict=True)):
        node, R = prepared.model.node(prepared.model.scene.bodies[i]), b.turn @ link.rotation
        turn = slice(node.q + 3, node.q + 7)
        all_q[turn] *= np.sign(all_q[turn] @ begin.q[turn])
        second = np.r_[b.a, R.T @ b.w1]
        found.append(np.max(np.abs(begin.acceleration[node.u : node.u + 6] - second)) / np.max(np.abs(a)))
    found += [np.max(np.abs(one - other)) / np.max(np.abs(other)) for one, other in ((begin.q, all_q), (begin.u, all_u))]
    return max(found)


@dataclass(frozen=True)
class Run:
    """The reference of a run: times, places (nt, bodies, 3), joint coordinates and rates (nt, n)."""

    times: np.ndarray
    places: np.ndarray
    q: np.ndarray
    v: np.ndarray

    @classmethod
    def of(cls, chain: Chain, q: np.ndarray, v: np.ndarray, t_end: float) -> Run:
        """From t = 0 on, by the reference."""
        times = np.linspace(0, t_end, 11)
        at_q, at_v = chain.run(q, v, times)
        none = np.zeros(len(v))
        moving = [chain.motion(x, y, none) for x, y in zip(at_q, at_v, strict=True)]
        return cls(times, np.array([[b.r for b in bodies] for bodies in moving]), at_q, at_v)

    def off(self, chain: Chain, r: mb.Result) -> float:
        """Largest difference: positions over the size of the scene, angles in rad, rates over the largest of their kind."""
        length = r.prepared.length
        apart = [np.max(np.abs(r[f"b{i}"].position - self.places[:, i])) / length for i in range(len(chain.links))]
        for i, (link, (at, rate)) in enumerate(zip(chain.links, chain.parts, strict=True)):
            for n, name in enumerate(link.joint.scalars):
                size = 1.0 if link.joint.coordinates[name] == "rad" else length
                apart.append(np.max(np.abs(getattr(r[f"J{i}"], name) - self.q[:, at.start + n])) / size)
                speed = max(float(np.max(np.abs(self.v))), 1.0)
                apart.append(np.max(np.abs(getattr(r[f"J{i}"], f"{name}_rate") - self.v[:, rate.start + n])) / speed)
        return float(max(apart))
