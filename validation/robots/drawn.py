"""Models of MJCF and URDF drawn at random, beside MuJoCo and Pinocchio: accelerations and poses, runs, loops by equalities. Files
are written to the working folder, which is made for that."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from robots.beside import SIZES, Beside, compared, off, turning
from runner import Found

import mbdae as mb

MODELS, STATES, CLOSED_END = 40, 6, 0.2
#: shapes, with how many numbers their sizes have
GEOMS = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}


def words(x: Any) -> str:
    """Numbers as an attribute has them."""
    return " ".join(repr(float(v)) for v in np.atleast_1d(x))


class Drawn:
    """A model of MJCF: floating bases, balls, hinges, slides, several joints of a body, armature, springs with references,
    dampers, classes, frames, orientations and inertias of every kind, switches of the compiler."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.turn = 180 / np.pi if self.chance(0.5) else 1.0  # angles of the file, by rad
        self.names, self.scalars = list[str](), list[str]()
        self.by_geom = self.pick(["auto", "true", "false"])
        self.root_free = self.chance(0.5)

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def pick(self, of: list[Any]) -> Any:
        return of[int(self.rng.integers(len(of)))]

    def orientation(self) -> str:
        rng, angle = self.rng, self.turn * self.rng.uniform(-3, 3)
        return self.pick(["", f'euler="{words(self.turn * rng.uniform(-3, 3, 3))}"', f'quat="{words(rng.normal(size=4))}"',
                          f'axisangle="{words([*rng.normal(size=3), angle])}"', f'zaxis="{words(rng.normal(size=3))}"',
                          f'xyaxes="1 0.2 0.1 0 1 {words(rng.uniform(-0.5, 0.5))}"'])

    def joint(self) -> str:
        kind, rng = self.pick(["hinge", "hinge", "slide"]), self.rng
        unit, name = self.turn if kind == "hinge" else 1.0, f"j{len(self.scalars)}"
        self.scalars.append(name)
        more = [f'pos="{words(0.2 * rng.normal(size=3))}"', f'armature="{words(0.1 * rng.random())}"',
                f'damping="{words(rng.random())}"', f'stiffness="{words(5 * rng.random())}"',
                f'springref="{words(unit * rng.uniform(-1, 1))}"', f'ref="{words(unit * rng.uniform(-1, 1))}"',
                f'springdamper="{words(rng.uniform(0.2, 1, 2))}"', f'class="{self.pick(["stiff", "slow"])}"',
                f'limited="true" range="{words(unit * np.array([-2, 2]))}"']
        kept = " ".join(text for text in more if self.chance(0.35))
        return f'<joint name="{name}" type="{kind}" axis="{words(rng.normal(size=3))}" {kept}/>'

    def geom(self) -> str:
        kind, rng = self.pick([*GEOMS]), self.rng
        mass = self.pick(["", f'density="{words(rng.uniform(300, 2000))}"', f'mass="{words(rng.uniform(0.3, 3))}"'])
        size, place = words(rng.uniform(0.05, 0.3, GEOMS[kind])), words(0.2 * rng.normal(size=3))
        return f'<geom type="{kind}" size="{size}" pos="{place}" {self.orientation()} {mass}/>'

    def inertial(self) -> str:
        A = self.rng.normal(size=(3, 3))
        J = 0.05 * (np.trace(A @ A.T) * np.eye(3) - A @ A.T)
        head = f'<inertial mass="{words(self.rng.uniform(0.3, 3))}" pos="{words(0.1 * self.rng.normal(size=3))}"'
        if self.chance(0.5):
            return f'{head} fullinertia="{words(J[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])}"/>'
        return f'{head} {self.orientation()} diaginertia="{words(np.linalg.eigvalsh(J))}"/>'

    def body(self, level: int = 0) -> str:
        name = f"b{len(self.names)}"
        self.names.append(name)
        kind = "free" if level == 0 and self.root_free else self.pick(["one", "one", "two", "ball", "fixed" if level else "one"])
        inside = {"free": '<joint type="free" damping="0.2"/>', "ball": '<joint type="ball" pos="0.1 0 0.2"/>'}.get(kind, "")
        inside += "".join(self.joint() for _ in range({"one": 1, "two": 2}.get(kind, 0)))
        inside += self.geom() + (self.inertial() if self.by_geom == "false" or self.chance(0.5) else "")
        while level < 4 and len(self.names) < 8 and self.chance(0.75):
            inside += self.body(level + 1)
        lift, of = ('gravcomp="0.4"' if self.chance(0.1) else ""), ('childclass="slow"' if self.chance(0.2) else "")
        place = words(0.5 * self.rng.normal(size=3))
        text = f'<body name="{name}" pos="{place}" {self.orientation()} {lift} {of}>{inside}</body>'
        return f'<frame pos="0.1 0 0.2" {self.orientation()}>{text}</frame>' if level and self.chance(0.2) else text

    def text(self) -> str:
        """The file."""
        order = self.pick(["zyx", "XYZ", "zxZ"])
        more = [f'eulerseq="{order}"', 'balanceinertia="true"', 'boundmass="0.05"', 'autolimits="false"']
        compiler = " ".join(text for text in more if self.chance(0.3))
        body = self.body()
        unread = '<actuator><motor joint="j0" gear="2" /></actuator>' if self.scalars and self.chance(0.3) else ""
        angle, gravity = "degree" if self.turn > 1 else "radian", words(5 * self.rng.normal(size=3))
        classes = ('<default><joint damping="0.1"/><default class="stiff"><joint stiffness="0.7"/></default>'
                   '<default class="slow"><joint damping="0.4"/></default></default>')
        return (f'<mujoco><compiler angle="{angle}" inertiafromgeom="{self.by_geom}" {compiler}/><option gravity="{gravity}"/>'
                f"{classes}<worldbody>{body}</worldbody>{unread}</mujoco>")


class Both:
    """A drawn model in MuJoCo, without limits and contacts, and as a scene that starts as drawn or as a key frame says."""

    def __init__(self, text: str, key: str | None = None) -> None:
        import mujoco

        path = Path("model.xml")
        path.write_text(text)
        self.s, self.mujoco = mb.read_mjcf(path, limits=False, keep_inertias=True, key=key), mujoco
        self.model, off = mujoco.MjModel.from_xml_path(str(path)), mujoco.mjtDisableBit
        self.model.opt.disableflags |= int(off.mjDSBL_LIMIT) | int(off.mjDSBL_CONTACT) | int(off.mjDSBL_ACTUATION)
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(self.model)

    def at(self, y: Any) -> Any:
        """The model's data at (qpos, qvel)."""
        self.data.qpos[:], self.data.qvel[:] = np.split(y, [self.model.nq])
        self.mujoco.mj_forward(self.model, self.data)
        return self.data

    def rows(self, q: Any) -> Any:
        """Rows of the equalities."""
        d = self.at(np.concatenate((q, np.zeros(self.model.nv))))
        return np.array(d.efc_J[: d.nefc * self.model.nv]).reshape(-1, self.model.nv)

    def slope(self, _: float, y: Any) -> Any:
        """Rates of (qpos, qvel), equalities held exactly: their rows, differentiated along v by differences, and MuJoCo's masses
        and forces."""
        m, h = self.model, 1e-6
        q, v = np.split(y, [m.nq])
        sides = [q.copy(), q.copy()]
        for side, step in zip(sides, (h, -h), strict=True):
            self.mujoco.mj_integratePos(m, side, v, step)
        J = self.rows(q)
        turned = (self.rows(sides[0]) - self.rows(sides[1])) / (2 * h) @ v if len(J) else np.zeros(0)
        d, M = self.at(y), np.zeros((m.nv, m.nv))
        for column, unit in zip(M, np.eye(m.nv), strict=True):
            self.mujoco.mj_mulM(m, d, column, unit)
        K = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
        a = np.linalg.lstsq(K, np.concatenate((d.qfrc_passive - d.qfrc_bias, -turned)), rcond=1e-11)[0][: m.nv]
        rates = [v[i : i + 1] if kind > 1 else turning(q[p : p + 4], v[i : i + 3]) if kind else np.concatenate(
            (v[i : i + 3], turning(q[p + 3 : p + 7], v[i + 3 : i + 6]))) for kind, p, i in zip(
                m.jnt_type, m.jnt_qposadr, m.jnt_dofadr, strict=True)]
        return np.concatenate((*rates, a))

    def run(self, start: Any) -> Found:
        """Centres of mass in a run beside SciPy."""
        from scipy.integrate import solve_ivp

        times, worst, size = np.linspace(0, CLOSED_END, 3), 0.0, 1.0
        found = solve_ivp(self.slope, (0, CLOSED_END), start, "DOP853", times, rtol=1e-10, atol=1e-10).y.T
        r, mine = self.s.simulate(CLOSED_END, accuracy=1e-8, outputs=times), {b.name for b in self.s.bodies}
        for n, y in enumerate(found):
            d = self.at(y)
            for b in (b for b in range(1, self.model.nbody) if self.model.body(b).name in mine):
                worst = max(worst, float(np.max(np.abs(r[self.model.body(b).name].position[n] - d.xipos[b]))))
                size = max(size, float(np.max(np.abs(d.xipos[b]))))
        return Found(worst / size, 1e-6, "m, over the extent")


def at_states(seed: int) -> list[Found]:
    """Accelerations for drawn forces, and poses, at random states."""
    both, rng, worst = Both(Drawn(seed).text()), np.random.default_rng(seed), np.zeros(2)
    m, tree, quat = both.model, both.s.tree(), both.mujoco.mju_mat2Quat
    drawn = both.at(np.concatenate((m.qpos0, np.zeros(m.nv)))).xmat.reshape(-1, 3, 3).copy()
    of = {c: i for i, c in enumerate(tree.coordinates)}
    for _ in range(STATES):
        y, q, T = np.concatenate((m.qpos0, np.zeros(m.nv))), tree.zero + 0.0, np.zeros((m.nv, m.nv))
        for i, kind in enumerate(map(int, m.jnt_type)):
            p, d, body = int(m.jnt_qposadr[i]), int(m.jnt_dofadr[i]), m.body(int(m.jnt_bodyid[i])).name
            names = (m.joint(i).name, f"{body} floats", f"joint {i} of {body}")
            own = [c for c in tree._coordinates if c.joint in names]
            for n, c in enumerate(c for c in own if c.nq == 1):
                q[c.q] = value = rng.normal()
                y[p + n] += value
                T[d + n, c.v] = 1.0
            for c in (c for c in own if c.nq == 4):  # axes as drawn are inertial ones, those of MuJoCo the body's
                P, R, turned = rng.normal(size=4), np.zeros(9), drawn[int(m.jnt_bodyid[i])]
                q[c.q : c.q + 4] = P / np.linalg.norm(P)
                both.mujoco.mju_quat2Mat(R, q[c.q : c.q + 4])
                first = p + 3 * (kind == 0)
                quat(y[first : first + 4], ((turned.T if kind else np.eye(3)) @ R.reshape(3, 3) @ turned).ravel())
                T[d + 3 * (kind == 0) :, c.v : c.v + 3][:3] = turned.T
        v, tau = rng.normal(size=(2, len(of)))
        y[m.nq :] = T @ v
        both.data.qfrc_applied[:] = np.linalg.solve(T.T, tau)
        d = both.at(y)
        a = tree.forward_dynamics(q, v, tau + T.T @ (d.qfrc_passive - d.qfrc_gravcomp))
        poses = [np.max(np.abs(tree.pose(m.body(b).name, q) - np.column_stack((d.xmat[b].reshape(3, 3), d.xpos[b]))))
                 for b in range(1, m.nbody)]
        worst = np.maximum(worst, (off(a, np.linalg.solve(T, d.qacc)), max(poses)))
    return [Found(worst[0], 1e-9, quantity="accelerations"), Found(worst[1], 1e-9, "m", quantity="poses")]


def run(seed: int) -> Found:
    """A run from a key frame, with springs, dampers and gravity of bodies."""
    import mujoco

    text, rng = Drawn(seed).text(), np.random.default_rng(seed)
    m = mujoco.MjModel.from_xml_string(text)
    q, v = m.qpos0.copy(), rng.normal(size=m.nv)
    for kind, p, d in zip(m.jnt_type, m.jnt_qposadr, m.jnt_dofadr, strict=True):
        q[p : p + SIZES[kind]] += 0.3 * rng.normal(size=SIZES[kind])
        if kind == 1:
            v[d : d + 3] = 0  # not read of balls, and told
    mujoco.mj_normalizeQuat(m, q)
    both = Both(text.replace("</mujoco>", f'<keyframe><key name="k" qpos="{words(q)}" qvel="{words(v)}"/></keyframe></mujoco>'),
                "k")
    return both.run(np.concatenate((q, v)))


def closed(seed: int) -> Found:
    """A run with loops and ties, which hold exactly: connect or weld of two bodies, and of a joint to another one."""
    drawn, rng = Drawn(seed), np.random.default_rng(seed)
    text, one, other = drawn.text(), drawn.names[-1], drawn.names[len(drawn.names) // 2]
    place, ties = f'body1="{one}" anchor="{words(0.3 * rng.normal(size=3))}"', ""
    if len(drawn.names) > 2:
        ties = drawn.pick([f"<connect {place}/>", f'<connect body2="{other}" {place}/>'])
    if len(drawn.scalars) > 2:
        joints = [f'joint{n}="{drawn.scalars[n]}"' for n in (1, 2)]
        ties += f'<joint {" ".join(joints)} polycoef="0 {words(rng.normal())} 0 0 0"/>'
    both = Both(text.replace("</mujoco>", f"<equality>{ties}</equality></mujoco>"))
    return both.run(np.concatenate((both.model.qpos0, np.zeros(both.model.nv))))


def urdf(seed: int) -> tuple[str, dict[str, tuple[str, float, float]]]:
    """A file of URDF: a tree of revolute, continuous, prismatic and fixed joints, in any order; and joints that mimic others."""
    drawn = Drawn(seed)
    rng, mimics, scalars = drawn.rng, dict[str, tuple[str, float, float]](), list[str]()

    def origin() -> str:
        turned = words(drawn.pick([np.zeros(3), rng.uniform(-3, 3, 3)]))
        return drawn.pick(["", f'<origin xyz="{words(0.4 * rng.normal(size=3))}" rpy="{turned}"/>'])

    def link(n: int) -> str:
        A = rng.normal(size=(3, 3))
        J = 0.05 * (np.trace(A @ A.T) * np.eye(3) - A @ A.T)
        entries = " ".join(f'i{"xyz"[i]}{"xyz"[j]}="{words(J[i, j])}"' for i in range(3) for j in range(i, 3))
        mass = words(rng.uniform(0.2, 4))
        return f'<link name="l{n}"><inertial>{origin()}<mass value="{mass}"/><inertia {entries}/></inertial></link>'

    parts = [link(0)]
    for n in range(1, int(rng.integers(4, 12))):
        kind = "revolute" if n == 1 else drawn.pick(["revolute", "continuous", "prismatic", "fixed"])
        inside = f'<parent link="l{rng.integers(max(0, n - 4), n)}"/><child link="l{n}"/>{origin()}'
        inside += drawn.pick(["", '<axis xyz="0 0 -1"/>', '<axis xyz="0 1 0"/>', f'<axis xyz="{words(rng.normal(size=3))}"/>'])
        inside += '<limit lower="-9" upper="9" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
        if kind in ("revolute", "prismatic") and scalars and drawn.chance(0.25):
            of, factor, offset = mimics[f"j{n}"] = drawn.pick(scalars), float(rng.normal()), float(0.3 * rng.normal())
            inside += f'<mimic joint="{of}" multiplier="{words(factor)}" offset="{words(offset)}"/>'
        elif kind != "fixed":
            scalars.append(f"j{n}")
        parts += [link(n), f'<joint name="j{n}" type="{kind}">{inside}</joint>']
    order = drawn.pick([range(len(parts)), rng.permutation(len(parts))])
    return f'<robot name="drawn">{"".join(parts[n] for n in order)}</robot>', mimics


def against_pinocchio(seed: int) -> list[Found]:
    """A drawn file of URDF, on the ground or floating, at random states."""
    path, (text, mimics), floats = Path("drawn.urdf"), urdf(seed), bool(seed % 2)
    path.write_text(text)
    return compared(Beside(mb.read_urdf(path, floating=floats, limits=False), path, floats, mimics), STATES)
