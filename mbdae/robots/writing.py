"""A scene into MJCF by MuJoCo's own writer, read back and compared; what MJCF cannot say is refused by name."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.errors import OptionError, SceneError
from mbdae.files import replacing
from mbdae.laws.forces import JointDamper, JointFriction, JointLoad, JointSpring
from mbdae.laws.friction import Coulomb
from mbdae.laws.joint_rows import Free
from mbdae.laws.joints import Prismatic, Revolute, Spherical, Weld
from mbdae.laws.on_coordinates import Gear, JointStop, Rack, WeightedSum
from mbdae.robots import Pose, library
from mbdae.robots.joint_space import FLOATS, Tree, couples
from mbdae.robots.mjcf import quiet
from mbdae.scene.models import spanning_tree
from mbdae.scene.shapes import Box, Cylinder, Sphere

STATES = 5  #: random states at which mass matrix and bias of the file are compared with those of the scene
#: largest difference of these, over their largest entry: round-off of two roots of quaternions and of principal axes
EQUAL = 1e-9
DIGITS = 17  #: of numbers in the file: all of them


def write(scene: Any, path: Any, read: Callable[[Any], Any]) -> tuple[str, ...]:
    """Write the MJCF file of a scene; arguments and errors as of `Scene.write_mjcf`, read: `mb.read_mjcf`."""
    mujoco = library("mujoco", "writing MJCF")
    to = Path(path)
    if scene.problems:
        raise SceneError(list(scene.problems))
    writer = _Writer(mujoco, scene)
    writer.write()
    if writer.wrong:
        raise SceneError(writer.wrong)
    try:
        with quiet(), _all_digits(mujoco):
            writer.starts(writer.spec.compile())
            writer.spec.compile()
            text = writer.spec.to_xml()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SceneError([f"MJCF cannot say this scene: {' '.join(str(error).split())}"]) from error
    with replacing(to) as new:
        new = Path(new)
        new.write_text(text, encoding="utf-8")
        _compare(scene.tree(), read(new).tree(), writer.renamed)
    return tuple(writer.told)


@contextmanager
def _all_digits(mujoco: Any) -> Iterator[None]:
    """MuJoCo writes numbers with 6 digits, unless its library is told otherwise."""
    found = next(iter(sorted(Path(mujoco.__file__).parent.glob("*mujoco.*so*")) + sorted(Path(mujoco.__file__).parent.glob(
        "*mujoco*.d*"))), None)
    mine: Any = ctypes.CDLL(str(found)) if found else None
    ask, tell = (getattr(mine, f"_mjPRIVATE__{word}_xml_precision", None) for word in ("get", "set"))
    if ask is None or tell is None:
        raise OptionError(f"write_mjcf: MuJoCo {mujoco.__version__} writes numbers with 6 digits alone; install another version")
    before = ask()
    tell(DIGITS)
    try:
        yield
    finally:
        tell(before)


def _compare(one: Tree, other: Tree, renamed: dict[str, str]) -> None:
    """Mass matrix and bias of what was written against those of the scene, coordinates by name."""
    joints: dict[str, list[Any]] = {}
    for c in other._coordinates:
        joints.setdefault(c.joint.removesuffix(FLOATS.format("")), []).append(c)
    q_of, v_of = np.zeros(one.nq, dtype=int), np.zeros(one.nv, dtype=int)
    taken: dict[str, int] = {}
    for c in one._coordinates:
        name = c.joint.removesuffix(FLOATS.format(""))
        there = joints.get(renamed.get(name, name), [])
        n = taken.get(name, 0)
        taken[name] = n + 1
        if n >= len(there) or there[n].nv != c.nv:
            raise SceneError([f"joint '{c.joint}': MJCF does not say it with the same coordinates"])
        q_of[c.q : c.q + c.nq] = range(there[n].q, there[n].q + c.nq)
        v_of[c.v : c.v + c.nv] = range(there[n].v, there[n].v + c.nv)
    rng = np.random.default_rng(0)
    for _ in range(STATES):
        q, v = rng.normal(size=one.nq), rng.normal(size=one.nv)
        for c in one._coordinates:
            if c.nq == 4:
                q[c.q : c.q + 4] /= np.linalg.norm(q[c.q : c.q + 4])
        q_there, v_there = np.zeros(other.nq), np.zeros(other.nv)
        q_there[q_of], v_there[v_of] = q, v
        for a, b in ((one.mass_matrix(q), other.mass_matrix(q_there)[np.ix_(v_of, v_of)]),
                     (one.bias(q, v), other.bias(q_there, v_there)[v_of])):
            if not np.max(np.abs(a - b)) <= EQUAL * max(1e-9, float(np.max(np.abs(a)))):
                raise SceneError([f"what MJCF says of this scene moves otherwise: its mass matrix or bias differs by "
                                  f"{np.max(np.abs(a - b)):.3g}, of {np.max(np.abs(a)):.3g}; nothing was written"])


class _Writer:
    """A scene into a specification of MuJoCo. wrong: what cannot be said; told: what the file says otherwise."""

    def __init__(self, mujoco: Any, scene: Any) -> None:
        self.mujoco, self.s, self.spec = mujoco, scene, mujoco.MjSpec()
        self.wrong: list[str] = []
        self.told: list[str] = []
        self.renamed: dict[str, str] = {}
        self.made: dict[str, Any] = {"ground": self.spec.worldbody}
        self.poses: dict[str, Pose] = {"ground": Pose()}
        self.joints: dict[str, Any] = {}
        self.start: dict[str, float] = {}
        self.rates: dict[str, float] = {}

    def write(self) -> None:
        self.spec.modelname, self.spec.compiler.degree = self.s.name, False
        self.spec.compiler.inertiafromgeom = self.mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        self.spec.option.gravity = [float(g) for g in self.s.gravity]
        self._refuse()
        if self.wrong:
            return
        tree = spanning_tree(self.s)
        carried = {child.name: (parent, joint) for parent, joint, child in tree.edges}
        moves = {joint.name for _, joint, _ in tree.edges}
        onto = self._merged(tree)
        for body in [*(root for root in tree.roots if root is not self.s.ground), *(child for _, _, child in tree.edges)]:
            if body.name in onto:
                continue
            chain = [carried.get(body.name)]
            while chain[-1] is not None and chain[-1][0].name in onto:
                chain.append(carried[chain[-1][0].name])
            self._body(body, [link for link in reversed(chain) if link is not None])
        for c in self.s.connections:
            if c.name not in moves:
                self._closing(c)
        for name, f in self.s.frames.items():
            if f.body.name == name or name in onto:
                continue
            if f.body.name in onto:
                self.wrong.append(f"frame '{name}': body '{f.body.name}' has no mass and is none in MJCF; put it elsewhere")
                continue
            at = self._inside(f.body.name, Pose(f.axes, f.point))
            self.made[f.body.name].add_site(name=name, pos=at.p, quat=self._quat(at.R), group=4)

    def _refuse(self) -> None:
        s, say = self.s, self.wrong.append
        if not s.space:
            say(f"scene '{s.name}' is planar, and MJCF speaks of space: state it in space")
        for b in s.bodies:
            if b.inertia is None:
                say(f"'{b.name}' is a point mass or a beam, which MJCF does not say; state s.rigid_body")
            elif b.given_velocity:
                say(f"body '{b.name}': a start velocity is not in MJCF; leave it out, and set qvel there")
            elif b.gravity is not None and self._lifted(b) is None:
                say(f"body '{b.name}': its gravity is not along that of the scene, as in MJCF (gravcomp)")
        for what, items in (("line load", s.line_loads), ("controller", s.controllers)):
            for item in items:
                say(f"{what} '{item.name}': MJCF does not say it; take it out of the scene that is written")

    def _merged(self, tree: Any) -> set[str]:
        """Bodies without mass between two joints: in MJCF both joints are of the body behind them."""
        children: dict[str, int] = {}
        for parent, _, _ in tree.edges:
            children[parent.name] = children.get(parent.name, 0) + 1
        loops = {body.name for c in self.s.connections if c in tree.closing or not c.is_joint for body in (c.k, c.l)}
        carried = {child.name for _, joint, child in tree.edges if not isinstance(joint.laws[0], Weld | Free)}
        welded = {parent.name for parent, joint, _ in tree.edges if isinstance(joint.laws[0], Weld | Free)}
        return {b.name for b in self.s.bodies if not b.mass and b.inertia is not None and not np.any(b.inertia)
                and children.get(b.name) == 1 and b.name in carried - welded and b.name not in loops}

    def _lifted(self, b: Any) -> float | None:
        """Share of gravity that is taken off a body; None where MJCF cannot say its gravity."""
        if b.gravity is None:
            return 0.0
        g = self.s.gravity
        size = float(g @ g)
        share = 1.0 - float(b.gravity @ g) / size if size else 0.0
        return share if np.allclose(b.gravity, (1 - share) * g, rtol=0, atol=1e-12 * (size**0.5 or 1.0)) else None

    # -- bodies

    def _quat(self, R: Any) -> Any:
        found = np.zeros(4)
        self.mujoco.mju_mat2Quat(found, np.ascontiguousarray(R, dtype=float).ravel())
        return found

    def _inside(self, body: str, pose: Pose) -> Pose:
        """A pose as drawn, in axes of the frame that a body has in the file."""
        of = self.poses[body]
        return Pose(of.R.T @ pose.R, of.R.T @ (pose.p - of.p))

    def _body(self, b: Any, chain: list[Any]) -> None:
        """A body, and the joints from the body that carries it, outwards."""
        parent = chain[0][0].name if chain else "ground"
        frame = self.s.frames.get(b.name)
        own = frame is not None and frame.body is b
        drawn = self.poses[b.name] = Pose(frame.axes, frame.point) if own else Pose(b.drawn.rotation, b.drawn.position)
        at = self._inside(parent, drawn)
        made = self.made[b.name] = self.made[parent].add_body(name=b.name, pos=at.p, quat=self._quat(at.R))
        if b.mass or np.any(b.inertia):
            R = drawn.R.T @ b.drawn.rotation
            J = R @ b.inertia @ R.T
            made.mass, made.ipos, made.explicitinertial = float(b.mass), drawn.R.T @ (b.drawn.position - drawn.p), True
            made.fullinertia = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
        made.gravcomp = self._lifted(b)
        for shape in b.shapes or ():
            self._shape(b, made, shape)
        if not chain:
            made.add_freejoint(name=FLOATS.format(b.name))
        inner = b
        for n, (carrier, joint) in enumerate(chain):
            outer = b if n + 1 == len(chain) else chain[n + 1][0]
            self._joint(joint, made, drawn, 1.0 if joint.k is carrier and joint.l is outer else -1.0, inner)

    def _shape(self, b: Any, made: Any, shape: Any) -> None:
        kinds, middle = self.mujoco.mjtGeom, b.drawn.position if shape.at is None else np.asarray(shape.at, dtype=float)
        R = np.eye(3)
        if isinstance(shape, Sphere):
            kind, size = kinds.mjGEOM_SPHERE, [shape.radius, 0, 0]
        elif isinstance(shape, Cylinder) and shape.length is not None:
            kind, size, axis = kinds.mjGEOM_CYLINDER, [shape.radius, shape.length / 2, 0], np.asarray(shape.axis, dtype=float)
            x = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
            R = np.column_stack([v / np.linalg.norm(v) for v in (x, np.cross(axis, x), axis)])
        elif isinstance(shape, Box):
            kind, size = kinds.mjGEOM_BOX, [x / 2 for x in np.broadcast_to(shape.size, 3)]
            R = R if shape.rotation is None else np.asarray(shape.rotation, dtype=float)
        else:
            self.told.append(f"body '{b.name}': its {type(shape).__name__} is not drawn in MJCF")
            return
        at = self._inside(b.name, Pose(R, middle))
        made.add_geom(type=kind, size=size, pos=at.p, quat=self._quat(at.R), contype=0, conaffinity=0, mass=0)

    # -- joints

    def _joint(self, c: Any, made: Any, drawn: Pose, sense: float, body: Any) -> None:
        law, kinds = c.laws[0], self.mujoco.mjtJoint
        if any(getattr(law, key) is not None for key in ("at_l", "axis_l", "axis_x_l")):
            self.wrong.append(f"joint '{c.name}': its frame on l is stated apart from that on k, where MJCF has one: draw the "
                              f"bodies in the joint")
            return
        if isinstance(law, Weld) and len(c.laws) == 1:
            return
        kind = next((k for of, k in ((Revolute, kinds.mjJNT_HINGE), (Prismatic, kinds.mjJNT_SLIDE), (Spherical, kinds.mjJNT_BALL),
                                     (Free, kinds.mjJNT_FREE)) if type(law) is of), None)
        if kind is None or c.prescribed or c.others or c.loose:
            why = "a prescribed motion" if c.prescribed else f"{type(law).__name__} with this model"
            self.wrong.append(f"joint '{c.name}': {why} is not said by MJCF, which has hinges, slides, balls and free joints")
            return
        if kind == kinds.mjJNT_FREE:
            if sense < 0 or c.k is not self.s.ground or len(c.laws) > 1:
                self.wrong.append(f"joint '{c.name}': MJCF has free joints of bodies on the ground alone, without forces")
            made.add_freejoint(name=c.name)
            self.renamed[c.name] = body.name
            return
        name = c.name
        at = drawn.R.T @ (np.asarray(law.at, dtype=float) - drawn.p)
        self.joints[name] = j = made.add_joint(name=name, type=kind, pos=at)
        if kind == kinds.mjJNT_BALL:
            if sense < 0 or len(c.laws) > 1:
                self.wrong.append(f"joint '{name}': a ball of MJCF turns its outer body, l, relative to k, without forces")
            return
        axis = np.asarray(law.axis, dtype=float)
        j.axis = sense * drawn.R.T @ axis / np.linalg.norm(axis)
        j.armature = float(next(iter(c.rotor.values()), 0.0))
        for word, held, to in (("start", c.hold, self.start), ("start rate", c.hold_rate, self.rates)):
            to.update((name, self._number(value, c, word)) for value in held.values())
        for force in c.laws[1:]:
            self._acts(j, c, force)
        load = next((self._number(f.load, c, "load") for f in c.laws[1:] if isinstance(f, JointLoad)), 0.0)
        if load and not j.stiffness[0]:
            self.wrong.append(f"joint '{name}': MJCF says no load on it (but actuators, which are no part of the mechanics)")
        elif load:
            j.springref += load / j.stiffness[0]

    def _number(self, value: Any, c: Any, what: str) -> float:
        try:
            return float(value)
        except (TypeError, ValueError, RuntimeError):
            self.wrong.append(f"'{c.name}': its {what} changes during the run, where MJCF has numbers")
            return 0.0

    def _acts(self, j: Any, c: Any, force: Any) -> None:
        if isinstance(force, JointDamper):
            j.damping[0] = self._number(force.damping, c, "damper")
        elif isinstance(force, JointSpring):
            j.stiffness[0], j.springref = self._number(force.stiffness, c, "spring"), self._number(force.rest, c, "rest")
        elif isinstance(force, JointStop):
            low, high = force.lower, force.upper
            j.limited = self.mujoco.mjtLimited.mjLIMITED_TRUE
            j.range = [-1e10 if low is None else float(low), 1e10 if high is None else float(high)]
            self.told.append(f"joint '{c.name}': its limits are those of the scene, but yield as MuJoCo's do (solreflimit)")
        elif isinstance(force, JointFriction) and type(force.friction) is Coulomb and force.normal_force is not None:
            lever = 1.0 if isinstance(c.laws[0], Prismatic) else float(force.radius)
            j.frictionloss = self._number(force.normal_force, c, "normal force") * lever * float(force.friction.mu)
            self.told.append(f"joint '{c.name}': its friction jumps at rest in MuJoCo, where the scene smooths it")
        elif not isinstance(force, JointLoad):
            self.wrong.append(f"joint '{c.name}': {type(force).__name__} on it is not said by MJCF")

    # -- what is not in the tree

    def _closing(self, c: Any) -> None:
        law, kinds = c.laws[0], self.mujoco.mjtEq
        if isinstance(law, Gear | Rack | WeightedSum) and len(couples(law)[0]) == 2:
            ((one, _), f), ((other, _), g) = couples(law)[0]
            value = self._number(couples(law)[1], c, "value")
            if one in self.joints and other in self.joints and f:
                made = self.spec.add_equality(name=c.name, type=kinds.mjEQ_JOINT, objtype=self.mujoco.mjtObj.mjOBJ_JOINT,
                                              name1=one, name2=other)
                made.data[:5] = value / f, -g / f, 0, 0, 0
                return
        ends = ["world" if b is self.s.ground else b.name for b in (c.k, c.l)]
        if type(law) in (Weld, Spherical) and len(c.laws) == 1 and all(b.name in self.made for b in (c.k, c.l)):
            weld, at = type(law) is Weld, c.l.drawn.position if law.at is None else np.asarray(law.at, dtype=float)
            point = self._inside((c.l if weld else c.k).name, Pose(p=at)).p
            made = self.spec.add_equality(name=c.name, type=kinds.mjEQ_WELD if weld else kinds.mjEQ_CONNECT, name1=ends[0],
                                          name2=ends[1], objtype=self.mujoco.mjtObj.mjOBJ_BODY)
            made.data[:11] = *point, *np.zeros(7), float(weld)
            self.told.append(f"'{c.name}' closes a loop: exact in the scene, soft in MuJoCo")
            return
        self.wrong.append(f"{c.kind} '{c.name}': MJCF does not say it; " + (
            "it closes a loop: close it by s.spherical or s.weld, with model=mb.Recursive() at the joints that carry bodies"
            if c.is_joint else "take it out of the scene that is written"))

    def starts(self, model: Any) -> None:
        """The values of coordinates at the start as a key frame, where any is stated."""
        if not (self.start or self.rates):
            return
        q, v = np.array(model.qpos0), np.zeros(model.nv)
        for name, joint in ((name, model.joint(name)) for name in self.joints):
            q[joint.qposadr[0]] += self.start.get(name, 0.0)
            v[joint.dofadr[0]] += self.rates.get(name, 0.0)
        self.spec.add_key(name="start", qpos=q, qvel=v)
        self.told.append("start values of joints are in the key frame 'start'")
