"""MJCF into a scene: MuJoCo's own compiler resolves the file, this module says what its model means."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.errors import OptionError, SceneError, unknown_name
from mbdae.robots import Joint, Link, Pose, Robot, build, damped, library
from mbdae.robots.bounds import (
    BALL,
    DOFS,
    FREE,
    HINGE,
    MOST_MADE,
    SAME,
    SLIDE,
    Files,
    compiled,
    name_of,
    open_at,
    parsed,
    picture_of,
    text_of,
    verify,
)
from mbdae.robots.couplings import Tie, satisfied

CLOSED = 1e-9  #: m and rad, over the model's extent, up to which an equality holds as drawn
SIZES = {FREE: 7, BALL: 4, SLIDE: 1, HINGE: 1}  #: numbers of a joint in qpos
OF_JOINT = (0, 1)  #: kinds of transmission: an actuator on a joint
KEPT = 1e-6  #: m, rad, m/s and rad/s, up to which a key frame satisfies an equality: digits of saved files


def read(make: Any, path: Any, keep: bool, limits: bool, stop: Any, key: Any) -> Any:
    """The scene of an MJCF file; arguments as of `mb.read_mjcf`, make: the class of scenes."""
    mujoco = library("mujoco", "reading MJCF")
    found, data = text_of(path, "read_mjcf")
    if Files(found.resolve()).check(parsed(data, found.name, "mujoco")) > MOST_MADE:
        raise OptionError(f"{found.name}: with what is attached the model has more than {MOST_MADE} elements; state fewer")
    model = compiled(mujoco, found)
    robot = Robot(name_of(model, "names", 0) or found.stem)
    reader = _Reader(mujoco, model, robot, limits, stop, key)
    reader.refuse()
    reader.bodies()
    verify(reader)
    reader.equalities()
    reader.tell()
    s = build(make, robot, (0.0, 0.0, 0.0) if "GRAVITY" in reader.off else tuple(map(float, model.opt.gravity)), keep)
    for name, at in list(zip(reader.names, reader.data.xpos, strict=True))[1:]:
        if np.linalg.norm(s.frames[name].point - at) > SAME * max(1.0, float(model.stat.extent)):
            raise SceneError([f"body '{name}': MuJoCo has it at {at}, what is read at {s.frames[name].point}; give it another "
                              f"name"])
    return s


#: what a tendon does -> MuJoCo's switch of it
TENDON = {"stiffness": "SPRING", "damping": "DAMPER", "limited": "LIMIT", "frictionloss": "FRICTIONLOSS", "armature": ""}


class _Reader:
    """A compiled model into a `Robot`."""

    def __init__(self, mujoco: Any, model: Any, robot: Robot, limits: bool, stop: Any, key: Any) -> None:
        self.mujoco, self.m, self.robot, self.limits, self.stop = mujoco, model, robot, limits, stop
        self.data, self.keyed = mujoco.MjData(model), key is not None
        self.start, self.rates = self._key(key)
        bits = mujoco.mjtDisableBit  #: names of MuJoCo's switches that are off: of gravity, springs, dampers, ...
        self.off = {word[7:] for word in dir(bits) if word.startswith("mjDSBL_")
                    and model.opt.disableflags & int(getattr(bits, word))}
        for one, all_of in (("PASSIVE", {"SPRING", "DAMPER"}), ("CONSTRAINT", {"FRICTIONLOSS", "LIMIT", "EQUALITY"})):
            self.off |= all_of if one in self.off else set()
        for i, kind in enumerate(model.jnt_type):  # what has no coordinate of its own in a scene is drawn as it starts
            if kind in (FREE, BALL):
                q = int(model.jnt_qposadr[i])
                self.data.qpos[q : q + SIZES[int(kind)]] = self.start[q : q + SIZES[int(kind)]]
        mujoco.mj_kinematics(model, self.data)
        self.names = ["", *(robot.own_name(name_of(model, "name_bodyadr", i) or f"body {i}", "body")
                            for i in range(1, model.nbody))]
        self.joint_names = [name_of(model, "name_jntadr", i) or f"joint {i} of {self.names[int(model.jnt_bodyid[i])]}"
                            for i in range(model.njnt)]
        for names, what in ((self.names, "bodies"), (self.joint_names, "joints")):
            if len(set(names)) < len(names):
                raise SceneError([f"{what} without names would have names that others have; name all"])
        self.joint_names = [robot.own_name(name, "joint", self.names) for name in self.joint_names]

    def _key(self, key: Any) -> tuple[Any, Any]:
        """qpos and qvel of the key frame that was asked for; without one, those of the file."""
        m = self.m
        names = [name_of(m, "name_keyadr", i) or f"key {i}" for i in range(m.nkey)]
        if key is None:
            if names:
                said = f"{', '.join(map(repr, names[:8]))}{', ...' if len(names) > 8 else ''}"
                self.robot.told.append(f"key frames ({said}) are not read; key= makes one the start")
            return m.qpos0.copy(), np.zeros(m.nv)
        if key not in names:
            raise OptionError(f"key = {unknown_name(str(key), names)}" if names else f"key = {key!r}: the file has no key frames")
        q, v, t = (part[names.index(key)].copy() for part in (m.key_qpos, m.key_qvel, m.key_time))
        self.robot.told += [f"the time {t:g} s of key frame '{key}' is not read; runs begin at 0 s"] * bool(t)
        self.mujoco.mj_normalizeQuat(m, q)
        if not (np.all(np.isfinite(q)) and np.all(np.isfinite(v))):
            raise SceneError([f"key frame '{key}': a number of it is not finite"])
        return q, v

    # -- what cannot be said

    def refuse(self) -> None:
        m, wrong = self.m, []
        for i in range(m.ntendon):
            name = name_of(m, "name_tendonadr", i) or f"{i}"
            if any(np.any(getattr(m, f"tendon_{what}")[i]) for what, off in TENDON.items() if off not in self.off):
                wrong.append(f"tendon '{name}': tendons are not modelled; state s.spring or s.rope, and remove it from the file")
            else:
                self.robot.told.append(f"tendon '{name}' is not read; alone it exerts no force")
        wrong += [f"{what}: not modelled; remove them from the file" for what, n in (("flexible bodies (flex)", m.nflex),
                  ("plugins", m.nplugin)) if n]
        for i in range(m.njnt):
            kind, dof, name = int(m.jnt_type[i]), int(m.jnt_dofadr[i]), self.joint_names[i]
            if kind in (FREE, BALL):
                for what, values in (("armature", m.dof_armature), ("frictionloss", m.dof_frictionloss)):
                    if np.any(values[dof : dof + DOFS[kind]]):
                        wrong.append(f"joint '{name}': {what} of a {'free' if kind == FREE else 'ball'} joint is not modelled; "
                                     f"set it to 0")
                if m.jnt_stiffness[i] and "SPRING" not in self.off:
                    self.robot.heard.append(f"joint '{name}': stiffness of a free or ball joint is left out")
                if kind == BALL and m.jnt_limited[i] and "LIMIT" not in self.off and self.limits:
                    self.robot.heard.append(f"joint '{name}': the limit of a ball joint is left out")
            for what, at in (("dof_dampingpoly", dof), ("jnt_stiffnesspoly", i)):
                if np.any(self._of(what, at)):
                    wrong.append(f"joint '{name}': a polynomial of its {what[4:-4]} is not modelled; make it linear")
            if self._of("jnt_actgravcomp", i) and np.any(m.body_gravcomp):
                self.robot.heard.append(f"joint '{name}': gravity is compensated in full, not within the limits of actuators")
            if self._of("jnt_springyield", i):
                wrong.append(f"joint '{name}': a spring that yields is not modelled; remove its springyield")
        if wrong:
            raise SceneError(wrong)

    def _of(self, array: str, i: int) -> Any:
        """Entry of an array that versions of MuJoCo before the one that brought it do not have: 0 there."""
        return getattr(self.m, array)[i] if hasattr(self.m, array) else 0.0

    def tell(self) -> None:
        m, told, heard = self.m, self.robot.told, self.robot.heard
        if m.nu:
            names = ", ".join(f"'{name_of(m, 'name_actuatoradr', i) or i}'" for i in range(min(m.nu, 8)))
            told.append(f"actuators ({m.nu}: {names}{', ...' if m.nu > 8 else ''}) are not read, nor controls: state loads")
        if (np.any(m.geom_contype) and np.any(m.geom_conaffinity)) or m.npair:
            told.append("contacts between geoms are not read: state them by s.contact")
        if m.opt.density or m.opt.viscosity or np.any(m.opt.wind):
            heard.append("the medium (density, viscosity, wind) around the bodies is left out")
        if any(getattr(m, "tree_sleep_policy", ())[i] == self.mujoco.mjtSleepPolicy.mjSLEEP_INIT for i in range(m.ntree)) and (
                m.opt.enableflags & int(self.mujoco.mjtEnableBit.mjENBL_SLEEP)):
            heard.append("bodies that sleep at the start, held in the air until something wakes them, move from the start on")
        if m.nmocap:
            told.append("mocap bodies stay where the file has them, whatever a key frame says")
        pictures = {"planes": np.sum(m.geom_type == 0), "height fields": m.nhfield, "skins": m.nskin}
        unread = {"sensors": m.nsensor, "cameras": m.ncam, "lights": m.nlight, "custom numbers, texts and tuples":
                  m.nnumeric + m.ntext + m.ntuple} | {f"pictures of {what}": n for what, n in pictures.items()}
        if any(unread.values()):
            told.append(f"{', '.join(f'{what} ({n})' for what, n in unread.items() if n)} are not read")

    # -- bodies and joints

    def _pose(self, p: Any, quat: Any) -> Pose:
        R = np.zeros(9)
        self.mujoco.mju_quat2Mat(R, np.asarray(quat, dtype=float))
        return Pose(R.reshape(3, 3), np.array(p, dtype=float))

    def bodies(self) -> None:
        m, robot = self.m, self.robot
        for b in range(1, m.nbody):
            made, inner = Link(self.names[b]), self._pose(m.body_ipos[b], m.body_iquat[b])
            made.mass, made.centre = float(m.body_mass[b]), inner.p
            made.inertia = inner.R @ np.diag(m.body_inertia[b]) @ inner.R.T
            made.inertia = (made.inertia + made.inertia.T) / 2
            for g in range(int(m.body_geomadr[b]), int(m.body_geomadr[b]) + int(m.body_geomnum[b])):
                made.shapes += picture_of(m, g, self._pose(m.geom_pos[g], m.geom_quat[g]))
            self._carried(b, made)
            if m.body_gravcomp[b] and not self.off >= {"SPRING", "DAMPER"}:  # without both MuJoCo leaves it out, too
                made.gravity = tuple(float(x) for x in (1 - m.body_gravcomp[b]) * m.opt.gravity * ("GRAVITY" not in self.off))
        for i in range(m.nsite):
            if name := name_of(m, "name_siteadr", i):
                own = robot.own_name(name, "site", (*self.names, *self.joint_names, *robot.frames))
                robot.frames[own] = self.names[int(m.site_bodyid[i])], self._pose(m.site_pos[i], m.site_quat[i])

    def _carried(self, b: int, link: Link) -> None:
        m, robot = self.m, self.robot
        parent, pose = self.names[int(m.body_parentid[b])], self._pose(m.body_pos[b], m.body_quat[b])
        joints = range(int(m.body_jntadr[b]), int(m.body_jntadr[b]) + int(m.body_jntnum[b]))
        if len(joints) == 1 and int(m.jnt_type[joints[0]]) == FREE and not parent:
            q, v = int(m.jnt_qposadr[joints[0]]), int(m.jnt_dofadr[joints[0]])
            robot.links[link.name], robot.roots[link.name] = link, self._pose(self.start[q : q + 3], self.start[q + 3 : q + 7])
            R = robot.roots[link.name].R
            link.spin = R @ self.rates[v + 3 : v + 6]
            link.velocity = self.rates[v : v + 3] + np.cross(link.spin, R @ link.centre)
            if (d := self._damping(joints[0])) > 0:
                at, name = robot.roots[link.name].p, self.joint_names[joints[0]]
                robot.closing.append(lambda s, _: damped(s, name, "ground", link.name, at, (d, d)))
            return
        if not len(joints):
            robot.joints.append(Joint(f"{link.name} fixed", "fixed", parent, link.name, pose))
        for n, i in enumerate(joints):
            last = i == joints[-1]
            child = link.name if last else f"{link.name} after {self.joint_names[i]}"
            while not last and (child in robot.links or child in self.names):  # names of others
                child += " link"
            if not last:
                robot.links[child] = Link(child)
            robot.joints.append(self._joint(i, parent, child, pose if n == 0 else Pose()))
            parent = child
        robot.links[link.name] = link

    def _joint(self, i: int, parent: str, child: str, pose: Pose) -> Joint:
        m = self.m
        kind, dof, q = int(m.jnt_type[i]), int(m.jnt_dofadr[i]), int(m.jnt_qposadr[i])
        word = {FREE: "free", BALL: "spherical", SLIDE: "prismatic", HINGE: "revolute"}[kind]
        made = Joint(self.joint_names[i], word, parent, child, pose, np.array(m.jnt_pos[i]), np.array(m.jnt_axis[i]))
        made.damping = self._damping(i)
        if kind in (FREE, BALL):
            if kind == BALL:
                R = self._pose(np.zeros(3), self.start[q : q + 4]).R
                made.pose = pose @ Pose(R, made.at - R @ made.at)
                if np.any(self.rates[dof : dof + 3]):
                    self.robot.heard.append(f"joint '{made.name}': the velocity of a ball joint in the key frame is left out")
            return made
        acts = {"FRICTIONLOSS": m.dof_frictionloss[dof], "SPRING": m.jnt_stiffness[i]}
        made.friction, made.spring = (0.0 if word in self.off else float(x) for word, x in acts.items())
        made.rotor = float(m.dof_armature[dof]) + self._of_actuators("armature", i)
        ref = float(m.qpos0[q])
        made.start, made.rate = float(self.start[q]) - ref, float(self.rates[dof])
        made.rest = float(m.qpos_spring[q]) - ref
        if ref:
            self.robot.told.append(f"joint '{made.name}': its coordinate is 0 as drawn, where the file counts from {ref:g}")
        if m.jnt_limited[i] and self.limits and "LIMIT" not in self.off:
            low, high = (float(x) - ref for x in m.jnt_range[i])
            made.limits, made.stop = (low, high), self.stop
            acting = [a for a in range(m.nu) if int(m.actuator_trntype[a]) in OF_JOINT and int(m.actuator_trnid[a][0]) == i]
            efforts = [float(np.max(np.abs(m.actuator_gear[a][0] * m.actuator_forcerange[a]))) for a in acting]
            most = [sum(efforts)] if acting and np.all(m.actuator_forcelimited[acting]) else []
            most += [float(np.max(np.abs(m.jnt_actfrcrange[i])))] if m.jnt_actfrclimited[i] else []
            made.effort = min(most, default=0.0)
        return made

    def _damping(self, i: int) -> float:
        own = float(self.m.dof_damping[int(self.m.jnt_dofadr[i])])
        return 0.0 if "DAMPER" in self.off else own + self._of_actuators("damping", i)

    def _of_actuators(self, what: str, i: int) -> float:
        """Armature or damping of the actuators that turn with joint i."""
        m = self.m
        return sum(float(self._of(f"actuator_{what}", a) * m.actuator_gear[a][0] ** 2) for a in range(m.nu)
                   if int(m.actuator_trntype[a]) in OF_JOINT and int(m.actuator_trnid[a][0]) == i)

    # -- equalities

    def equalities(self) -> None:
        m, wrong, types, ties = self.m, list[str](), self.mujoco.mjtEq, list[Tie]()
        self.hinges = self._hinges()
        for e in range(m.neq):
            name, kind = name_of(m, "name_eqadr", e) or f"equality {e}", int(m.eq_type[e])
            if not m.eq_active0[e] or "EQUALITY" in self.off:
                self.robot.told.append(f"'{name}' is not active in the file, and not read")
            elif kind in (types.mjEQ_CONNECT, types.mjEQ_WELD):
                wrong += self._closed(e, name, kind == types.mjEQ_WELD)
            elif kind == types.mjEQ_JOINT:
                wrong += self._tied(e, name, ties)
            else:
                wrong.append(f"equality '{name}': of tendons or flexes it is not modelled; remove it from the file")
        for e, off in (open_at(self.mujoco, m, self.start, self.rates) if self.keyed else {}).items():
            if off > KEPT and int(m.eq_type[e]) in (types.mjEQ_CONNECT, types.mjEQ_WELD):
                name = name_of(m, "name_eqadr", e) or f"equality {e}"
                self.robot.heard.append(f"the key frame contradicts '{name}', by {off:.3g} (m, m/s, rad or rad/s): the start is "
                                        f"where that holds, elsewhere than in the key frame")
        wrong += satisfied(self.robot, ties, self.keyed, KEPT if self.keyed else CLOSED)
        if wrong:
            raise SceneError(wrong)

    def _hinges(self) -> dict[int, Any]:
        """Where two connects between the same two bodies are one hinge: the first of them -> the axis, the second one -> None."""
        m, found, pairs = self.m, dict[int, Any](), dict[frozenset[int], list[int]]()
        for e in range(m.neq):
            if m.eq_active0[e] and int(m.eq_type[e]) == self.mujoco.mjtEq.mjEQ_CONNECT:
                pairs.setdefault(frozenset(self._ends(e)[0]), []).append(e)
        for es in pairs.values():
            points = [one.p if self._of_sites(e) else one.point(m.eq_data[e][:3]) for e in es for one in self._ends(e)[1][:1]]
            if len(es) == 2 and np.linalg.norm(points[1] - points[0]) > 1e-6 * max(float(m.stat.extent), 1e-3):
                found |= {es[0]: points[1] - points[0], es[1]: None}
        return found

    def _of_sites(self, e: int) -> bool:
        return int(self.m.eq_objtype[e]) == int(self.mujoco.mjtObj.mjOBJ_SITE)

    def _ends(self, e: int) -> tuple[list[int], list[Pose]]:
        """Numbers of both bodies and the poses, as drawn, of the frames that the equality names."""
        m, d = self.m, self.data
        ids = [int(m.eq_obj1id[e]), int(m.eq_obj2id[e])]
        if self._of_sites(e):
            return [int(m.site_bodyid[i]) for i in ids], [Pose(d.site_xmat[i].reshape(3, 3), d.site_xpos[i].copy()) for i in ids]
        return ids, [Pose(d.xmat[i].reshape(3, 3).copy(), d.xpos[i].copy()) for i in ids]

    def _closed(self, e: int, name: str, weld: bool) -> list[str]:
        """A weld or a ball joint between two bodies; it has to hold as drawn."""
        m, slack = self.m, CLOSED * max(float(self.m.stat.extent), 1.0)
        bodies, (one, other) = self._ends(e)
        sites, data = self._of_sites(e), m.eq_data[e]
        k, l = (self.names[b] for b in bodies)
        at = one.p if sites else one.point(data[3:6]) if weld else one.point(data[:3])
        off = np.linalg.norm(at - (other.p if sites else other.point(data[:3] if weld else data[3:6])))
        turned = 0.0
        if weld and not sites and not data[10]:
            return [f"equality '{name}': a weld with torquescale=\"0\" is a connect; state it so"]
        if weld:
            wanted = one.R if sites else one.R @ self._pose(np.zeros(3), data[6:10]).R
            turned = float(np.max(np.abs(wanted - other.R)))
        if off > slack or turned > slack:
            return [f"equality '{name}': it does not hold as drawn, {off:.3g} m and {turned:.3g} apart; draw the bodies closed"]
        axis = self.hinges.get(e) if not weld else None

        def close(s: Any, on: dict[str, Any]) -> None:
            if on[k] is on[l]:
                s.told.append(f"'{name}' always holds: both its bodies are fixed to each other; it is left out")
            elif axis is not None:
                s.revolute(name, on[k], on[l], at=at, axis=axis)
            else:
                (s.weld if weld else s.spherical)(name, on[k], on[l], at=at)

        if weld or e not in self.hinges or axis is not None:
            self.robot.closing.append(close)
        return []

    def _tied(self, e: int, name: str, ties: list[Tie]) -> list[str]:
        m, (a0, a1, *more) = self.m, [float(x) for x in self.m.eq_data[e][:5]]
        one, other = (int(of[e]) for of in (m.eq_obj1id, m.eq_obj2id))
        if any(more):
            return [f"equality '{name}': a polynomial of degree 2 or more between joints is not modelled; make it linear"]
        if any(int(m.jnt_type[i]) not in (SLIDE, HINGE) for i in (one, other) if i >= 0):
            return [f"equality '{name}': it ties joints of more than one coordinate, which is not modelled"]
        of = {one: 1.0} | ({other: -a1} if other >= 0 and a1 else {})
        words = {f"{self.joint_names[i]}.{'angle' if m.jnt_type[i] == HINGE else 'displacement'}": f for i, f in of.items()}
        ties.append((name, [(self.joint_names[i], f) for i, f in of.items()], a0))
        self.robot.closing.append(lambda s, _: s.couple(name, words, a0))
        return []
