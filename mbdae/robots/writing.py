"""A scene into MJCF by MuJoCo's own writer, read back and compared; what MJCF cannot say is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.errors import OptionError, SceneError
from mbdae.files import path_of, replacing
from mbdae.laws.forces import JointDamper, JointFriction, JointLoad, JointSpring
from mbdae.laws.friction import Coulomb
from mbdae.laws.joints import Revolute, Spherical, Weld
from mbdae.laws.on_coordinates import Gear, JointStop, Rack, WeightedSum
from mbdae.robots import GROUND, Pose, library
from mbdae.robots.bounds import add, all_digits, geom_of, quiet
from mbdae.robots.couplings import FLOATS, acting, couples, differences, solid, unusual
from mbdae.scene.models import spanning_tree
from mbdae.scene.shapes import joint_axes
from mbdae.symbolic.motion import Step, symbolic_steps

EXACT = 1e-15  #: difference of a start from the drawing, m and rad, that is round-off of rotations
EQUAL = 1e-9  #: largest difference of its forces, over the largest of them: round-off of quaternions and of principal axes


def write(scene: Any, path: Any, read: Callable[[Any], Any]) -> tuple[str, ...]:
    """Write the MJCF file of a scene; arguments and errors as of `Scene.write_mjcf`, read: `mb.read_mjcf`."""
    mujoco, to = library("mujoco", "writing MJCF"), path_of(path)
    if scene.problems:
        raise SceneError(list(scene.problems))
    stated, (scene, given) = scene, solid(scene)
    (writer := _Writer(mujoco, scene)).write()
    writer.told += given
    if writer.wrong:
        raise SceneError(writer.wrong)
    try:
        with quiet():
            model = writer.spec.compile()
        writer.starts(model, stated)
        with quiet(), all_digits(mujoco):
            writer.spec.compile()
            text = writer.spec.to_xml()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise SceneError([f"MJCF cannot say this scene: {' '.join(str(error).split())}"]) from error
    with replacing(to) as new:
        new = Path(new)
        new.write_text(text, encoding="utf-8")
        try:
            back = read(new)
            back.space = scene.space
            again = back.tree()
        except OptionError as error:
            raise SceneError([f"what MJCF says of scene '{scene.name}' cannot be read back: "
                              f"{str(error).removeprefix(new.name)}; nothing was written"]) from error
        off, size = differences(scene.tree(), again, lambda joint, of: writer.names.get(
            (joint, of), (joint, of)))
        if not np.all(off <= EQUAL * np.maximum(1e-9, size)):
            raise SceneError([f"what MJCF says of this scene moves otherwise: forces for accelerations differ by "
                              f"{np.max(off):.3g}, of {np.max(size):.3g}; nothing was written"])
    return tuple(writer.told)


class _Writer:
    """A scene into a specification of MuJoCo. wrong: what cannot be said; told: what the file says otherwise."""

    def __init__(self, mujoco: Any, scene: Any) -> None:
        self.mujoco, self.s, self.spec, self.wrong, self.told = mujoco, scene, mujoco.MjSpec(), list[str](), list[str]()
        self.taken = {item.name for item in (*scene.bodies, *scene.connections, *scene.frames.values())}
        self.made: dict[str, Any] = {GROUND: self.spec.worldbody}
        self.poses: dict[str, Pose] = {GROUND: Pose()}
        self.joints: dict[tuple[str, str], Any] = {}  #: by joint and coordinate
        self.names: dict[tuple[str, str], tuple[str, str]] = {}  #: the same in the scene that is read back
        #: joints that turn freely by bodies k and l: the slides before, the ball, the point of a floating body or joint, axes
        self.round: dict[tuple[str, str], Any] = {}

    def write(self) -> None:
        self.spec.modelname, self.spec.compiler.degree = self.s.name, False
        self.spec.compiler.inertiafromgeom = self.mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        self.spec.option.gravity = [float(g) for g in self.s.gravity]
        tree = spanning_tree(self.s)
        self._refuse()
        if self.wrong:
            return
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
        for b in s.bodies:
            if b.name == "world":
                say("body 'world': MuJoCo calls the ground so; give it another name")
            if b.inertia is None:
                say(f"'{b.name}' is a point mass or a beam, which MJCF does not say; state s.rigid_body")
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
        loops = {body.name for c in tree.closing for body in (c.k, c.l)}
        carried = {child.name for _, joint, child in tree.edges if not isinstance(joint.laws[0], Weld)}
        welded = {parent.name for parent, joint, _ in tree.edges if isinstance(joint.laws[0], Weld)}
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

    def _new(self, name: str, what: str) -> str:
        """A name that nothing in the scene or the file has."""
        found = name
        while found in self.taken:
            found = f"{found} {what}"
        self.taken.add(found)
        self.told += [f"{what} '{name}' is '{found}' in the file, since something else is called '{name}'"] * (found != name)
        return found

    def _inside(self, body: str, pose: Pose) -> Pose:
        """A pose as drawn, in axes of the frame that a body has in the file."""
        of = self.poses[body]
        return Pose(of.R.T @ pose.R, of.R.T @ (pose.p - of.p))

    def _body(self, b: Any, chain: list[Any]) -> None:
        """A body, and the joints from the body that carries it, outwards."""
        parent = chain[0][0].name if chain else GROUND
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
            free = made.add_freejoint(name=self._new(FLOATS.format(b.name), "joint"))
            self.round["ground", b.name] = ([], free, drawn.p, drawn.R)
        for n, (carrier, joint) in enumerate(chain):
            outer = b if n + 1 == len(chain) else chain[n + 1][0]
            self._joint(joint, made, drawn, 1.0 if joint.k is carrier and joint.l is outer else -1.0)

    def _shape(self, b: Any, made: Any, shape: Any) -> None:
        if (found := geom_of(self.mujoco, shape)) is None:
            self.told.append(f"body '{b.name}': its {type(shape).__name__} is not drawn in MJCF")
            return
        kind, size, R = found
        at = self._inside(b.name, Pose(R, b.drawn.position if shape.at is None else np.array(shape.at, dtype=float)))
        made.add_geom(type=kind, size=size, pos=at.p, quat=self._quat(at.R), contype=0, conaffinity=0, mass=0)

    # -- joints

    def _joint(self, c: Any, made: Any, drawn: Pose, sense: float) -> None:
        law, kinds = c.laws[0], self.mujoco.mjtJoint
        if isinstance(law, Weld) and len(c.laws) == 1 and not unusual(c):
            return
        if unusual(c) or not (steps := self._steps(law)):
            self.wrong.append(f"joint '{c.name}': {', '.join(unusual(c)) or type(law).__name__} is not said by MJCF: hinges, "
                              f"slides, chains of them, balls")
            return
        at, slides = drawn.R.T @ (np.asarray(law.at, dtype=float) - drawn.p), list[Any]()
        for of, step in list(steps.items())[:: int(sense)]:
            name = c.name if len(steps) == 1 else self._new(f"{c.name} {of}", "joint")
            if step.turns and any(j.type == kinds.mjJNT_BALL for j in made.joints):
                self.wrong.append(f"joint '{c.name}': MJCF has no hinge that a ball carries without a body between them; give "
                                  f"'{(c.k if sense > 0 else c.l).name}' mass and inertia")
            if step.rotation is not None:
                ball = made.add_joint(name=name, type=kinds.mjJNT_BALL, pos=at)
                self.round[c.k.name, c.l.name] = (slides, ball, law.at if len(slides) == 3 else None, drawn.R)
                self.names[c.name, of] = (name, "rotation")
                if sense < 0:
                    self.wrong.append(f"joint '{c.name}': a ball of MJCF turns its outer body, l, relative to k; exchange "
                                      f"'{c.k.name}' and '{c.l.name}' in its statement")
                continue
            axis = sense * drawn.R.T @ joint_axes(law, c.k) @ [float(x) for x in step.axis]
            self.joints[c.name, of] = made.add_joint(name=name, type=kinds.mjJNT_HINGE if step.turns else kinds.mjJNT_SLIDE,
                                                     pos=at, axis=axis, armature=float(c.rotor.get(of, 0.0)))
            self.names[c.name, of] = (name, "angle" if step.turns else "displacement")
            slides += [] if step.turns else [self.joints[c.name, of]]
        for act in (self._acts, self._loaded):  # what MJCF says of a load stands on the spring
            for force in c.laws[1:]:
                act(self.joints.get((c.name, getattr(force, "coordinate", None) or [*steps][-1])), c, force)

    def _steps(self, law: Any) -> dict[str, Step]:
        """The hinges, slides and balls of a joint by their coordinates; none where it is no chain of such."""
        steps = symbolic_steps(law) or ()
        names = [str(s.amount) if s.rotation is None else str(s.rotation.P[0]).removesuffix("_P1") for s in steps]
        turning = [s for s in steps if s.turns]
        if names != list(law.coordinates) or (any(s.rotation for s in turning) and len(turning) > 1):
            return {}
        return dict(zip(names, steps, strict=True))

    def _loaded(self, j: Any, c: Any, force: Any) -> None:
        load = self._number(force.load, c, "load") if isinstance(force, JointLoad) else 0.0
        if j is not None and (stiffness := float(np.ravel(j.stiffness)[0])):
            j.springref += load / stiffness
        elif load:
            self.wrong.append(f"joint '{c.name}': MJCF says no load on it (but actuators, which are no part of the mechanics)")

    def _number(self, value: Any, c: Any, what: str) -> float:
        try:
            return float(value)
        except (TypeError, ValueError, RuntimeError):
            self.wrong.append(f"'{c.name}': its {what} changes during the run, where MJCF has numbers")
            return 0.0

    def _acts(self, j: Any, c: Any, force: Any) -> None:
        if isinstance(force, JointDamper):
            add(j, "damping", self._number(force.damping, c, "damper"))
        elif isinstance(force, JointSpring):
            add(j, "stiffness", self._number(force.stiffness, c, "spring"))
            j.springref = self._number(force.rest, c, "rest")
        elif isinstance(force, JointStop):
            j.limited = self.mujoco.mjtLimited.mjLIMITED_TRUE
            j.range = [far if end is None else float(end) for end, far in ((force.lower, -1e10), (force.upper, 1e10))]
            self.told.append(f"joint '{c.name}': its limits are those of the scene, but yield as MuJoCo's do (solreflimit)")
        elif isinstance(force, JointFriction) and type(force.friction) is Coulomb and (
                len(c.coordinates) == 1 and force.normal_force is not None):
            lever = 1.0 if j.type == self.mujoco.mjtJoint.mjJNT_SLIDE else float(force.radius)
            j.frictionloss = self._number(force.normal_force, c, "normal force") * lever * float(force.friction.mu)
            self.told.append(f"joint '{c.name}': its friction jumps at rest in MuJoCo, where the scene smooths it")
        elif j is None or not isinstance(force, JointLoad):
            self.wrong.append(f"joint '{c.name}': {type(force).__name__} on it is not said by MJCF")

    # -- what is not in the tree

    def _damped(self, c: Any) -> bool:
        """State a bushing that only damps all directions alike, at a ball or a floating body, as the damping of that joint."""
        slides, ball, at, _ = self.round.get((c.k.name, c.l.name), ([], None, None, None))
        stated = {p: getattr(law, p) for law in c.laws for p in law.params if getattr(law, p) is not None}
        point = "c" if any(p.startswith("c") for p in stated) else ""
        placed = at is not None and np.allclose(c.laws[0].at, at) if point else slides or at is None
        if ball is None or set(stated) != {f"{head}{a}" for head in f"{point}s" for a in "xyz"} or (
                len(set(stated.values())) > 1 or not placed):
            return False
        for j in (*slides, ball) if point else (ball,):
            add(j, "damping", self._number(stated["sx"], c, "damping"))
        return True

    def _closing(self, c: Any) -> None:
        law, kinds = c.laws[0], self.mujoco.mjtEq
        if c.kind == "bushing" and self._damped(c):
            return
        why = "take it out of the scene that is written"
        if isinstance(law, Gear | Rack | WeightedSum):
            terms, value = couples(law)
            if len(terms) <= 2 and all(of in self.joints for of, _ in terms) and terms[0][1]:
                (one, f), *others = terms
                made = self.spec.add_equality(name=c.name, type=kinds.mjEQ_JOINT, name1=self.names[one][0],
                                              objtype=self.mujoco.mjtObj.mjOBJ_JOINT)
                made.data[:5] = self._number(value, c, "value") / f, 0, 0, 0, 0
                for other, g in others:
                    made.name2, made.data[1] = self.names[other][0], -g / f
                self.told.append(f"'{c.name}' couples exactly in the scene, softly in MuJoCo")
                return
            why = "MJCF couples one or two coordinates that turn or slide, the first with a factor other than 0"
        elif c.is_joint:
            found = type(law) in (Weld, Spherical, Revolute)
            if found and not (beside := [*acting(c), *unusual(c)]):
                at = c.l.drawn.position if law.at is None else np.array(law.at, dtype=float)
                self._closed(c, c.name, at, type(law) is Weld)
                if type(law) is Revolute:  # two balls on its axis
                    self._closed(c, self._new(f"{c.name} axis", "loop"), at + joint_axes(law, c.k)[:, 2], False)
                self.told.append(f"'{c.name}' closes a loop: exact in the scene, soft in MuJoCo")
                return
            why = "it closes a loop, which MJCF does by points and welds alone" + (
                f", without {', '.join(beside)}: state that elsewhere, or let another hinge, ball or weld close it" if found else
                ": let s.revolute, s.spherical or s.weld close it") + ", with model=mb.Recursive() at joints that carry bodies"
        self.wrong.append(f"{c.kind} '{c.name}': MJCF does not say it; {why}")

    def _closed(self, c: Any, name: str, at: Any, weld: bool) -> None:
        kinds, (k, l) = self.mujoco.mjtEq, ("world" if b is self.s.ground else b.name for b in (c.k, c.l))
        made = self.spec.add_equality(name=name, type=kinds.mjEQ_WELD if weld else kinds.mjEQ_CONNECT, name1=k, name2=l,
                                      objtype=self.mujoco.mjtObj.mjOBJ_BODY)
        made.data[:11] = *self._inside((c.l if weld else c.k).name, Pose(p=at)).p, *np.zeros(7), float(weld)

    def starts(self, model: Any, s: Any) -> None:
        """The start of a run as a key frame, where it is not the drawing at rest: what joints and bodies state, and what
        couplings and loops make of it."""
        if not (self.spec.equalities or any(b.given_velocity for b in s.bodies) or any(c.hold or c.hold_rate for c in s.joints)):
            return
        r, q, v = s.simulate(1e-9, outputs=[0.0, 1e-9]), np.array(model.qpos0), np.zeros(model.nv)
        for c, of in self.joints:
            joint = model.joint(self.names[c, of][0])
            q[joint.qposadr[0]], v[joint.dofadr[0]] = getattr(r[c], of)[0], getattr(r[c], f"{of}_rate")[0]
        for (k, l), (_, made, _, F) in self.round.items():
            joint, (A_k, _, w_k), (A_l, p, w_l) = model.joint(made.name), moved(r, s[k]), moved(r, s[l])
            at, to, turned, floats = int(joint.qposadr[0]), int(joint.dofadr[0]), F.T @ A_k.T @ A_l @ F, len(joint.qpos0) == 7
            if floats:
                arm, turned = A_l @ (self.poses[l].p - s[l].drawn.position), A_l @ F
                q[at : at + 3], v[to : to + 3] = p + arm, r[l].velocity[0] + np.cross(w_l, arm)
                at, to = at + 3, to + 3
            q[at : at + 4], v[to : to + 3] = self._quat(turned), (A_l @ F).T @ (w_l - w_k)
        if np.any(v) or not np.allclose(q, model.qpos0, rtol=EXACT, atol=EXACT):
            self.spec.add_key(name="start", qpos=q, qvel=v)
            self.told.append("the start is the key frame 'start'")


def moved(r: Any, b: Any) -> tuple[Any, Any, Any]:
    """Rotation (3, 3) of a body from the drawing to the start of a run, place of its centre and angular velocity there."""
    of = r[b.name]
    return of.rotation[0] @ b.drawn.rotation.T, of.position[0], of.angular_velocity[0]
