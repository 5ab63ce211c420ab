"""MuJoCo on the MJCF that `Scene.write_mjcf` writes: trees exactly, loops as its soft constraints."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from mbdae.engines import INTERVALS, Case, Engine, Method, Statement, fixed_steps, script

#: what of MJCF is a soft constraint, which stays softer than the scene however short the steps are, by the text that states it
SOFT = {"<equality>": "loops", "frictionloss=": "dry friction", "limited=\"true\"": "stops", "range=": "stops"}


class MuJoCo(Engine):
    """`mujoco.mj_step` with its integrators over constant steps; of loops as they are by default, and as stiff as the step
    allows."""

    name, package = "mujoco", "mujoco"

    def state(self, case: Case) -> Statement:
        with tempfile.TemporaryDirectory(prefix="mbdae-") as folder:
            path = Path(folder) / "scene.xml"
            told = recursive(case.scene).write_mjcf(path)
            text = path.read_text(encoding="utf-8")
        start, parts = case.start()["motion"], dict.fromkeys(what for sign, what in SOFT.items() if sign in text)
        soft = f"because of its soft constraints ({', '.join(parts)})" if parts else ""
        names = [node.body.name for node in case.nodes if node.body is not None]
        drawn = [b.drawn.rotation.tolist() for b in (node.body for node in case.nodes) if b is not None]
        data = {"names": names, "drawn": drawn, "start": start.tolist(), "t": case.times[[0, -1]].tolist(),
                "intervals": INTERVALS, "h": 1e-6 * case.prepared.time, "soft": bool(soft)}
        steps = fixed_steps(case)
        orders = {"Euler": 1.0, "implicitfast": 1.0, "RK4": 4.0}
        methods = [Method(name, "step", steps, None if soft else order) for name, order in orders.items()]
        if soft:
            methods += [Method(f"{name}, stiffest", "step", steps) for name in ("implicitfast", "RK4")]
        files = {"scene.xml": text.encode(), "scene.json": json.dumps(data).encode()}
        text = script("runs = MuJoCoRuns()\nserve(runs.start, runs.solve)", MuJoCoRuns)
        return Statement(text, files, tuple(methods), soft, told)


def recursive(scene: Any) -> Any:
    """The scene with its joints as a tree, where they form one."""
    return scene.recursive() if any(c.has_models for c in scene.joints) else scene


class MuJoCoRuns:
    """The scene of `scene.xml` in MuJoCo: its start, and runs."""

    def __init__(self) -> None:
        import json

        import mujoco
        import numpy as np

        self.mj = mujoco
        with open("scene.json", encoding="utf-8") as file:
            self.s = json.load(file)
        m = self.m = mujoco.MjModel.from_xml_path("scene.xml")
        self.ids = [mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, name) for name in self.s["names"]]
        if missing := [name for name, i in zip(self.s["names"], self.ids, strict=True) if i < 0]:
            raise ValueError(f"{missing[0]} is no body of the model")
        d = self.d = mujoco.MjData(m)
        mujoco.mj_kinematics(m, d)  # as drawn
        self.turn = [d.xmat[i].reshape(3, 3).T @ np.array(R) for i, R in zip(self.ids, self.s["drawn"], strict=True)]
        self.soft = m.eq_solref.copy(), m.eq_solimp.copy()

    def motion(self, q: Any, v: Any) -> Any:
        """(nodes, 13) of a state."""
        import numpy as np

        m, d, mj = self.m, self.d, self.mj
        d.qpos[:], d.qvel[:] = q, v
        mj.mj_fwdPosition(m, d)
        mj.mj_fwdVelocity(m, d)
        out, both, P = np.zeros((len(self.ids), 13)), np.zeros(6), np.zeros(4)
        for k, i in enumerate(self.ids):
            mj.mj_objectVelocity(m, d, mj.mjtObj.mjOBJ_BODY, i, both, 0)
            mj.mju_mat2Quat(P, (d.xmat[i].reshape(3, 3) @ self.turn[k]).ravel())
            out[k] = [*d.xipos[i], *P, *both[3:], *both[:3]]
        return out

    def state(self) -> Any:
        """Coordinates of the start, and speeds that give the bodies theirs."""
        import numpy as np

        m, d, mj = self.m, self.d, self.mj
        mj.mj_resetData(m, d)
        if m.nkey:
            mj.mj_resetDataKeyframe(m, d, 0)
        q, J, part = d.qpos.copy(), [], np.zeros((2, 3, m.nv))
        mj.mj_fwdPosition(m, d)
        for i in self.ids:
            mj.mj_jacBodyCom(m, d, part[0], part[1], i)
            J.append(part.reshape(6, -1).copy())
        return q, np.linalg.lstsq(np.vstack(J), np.array(self.s["start"])[:, 7:13].ravel(), rcond=None)[0]

    def start(self) -> dict[str, Any]:
        """Motion, masses and accelerations at the start; these not where constraints are soft."""
        q, v = self.state()
        found = {"motion": self.motion(q, v), "mass": self.m.body_mass[self.ids]}
        if not self.s["soft"]:
            self.d.qpos[:], self.d.qvel[:] = q, v
            self.mj.mj_forward(self.m, self.d)
            a, ends = self.d.qacc.copy(), []
            for h in (-self.s["h"], self.s["h"]):
                at = q.copy()
                self.mj.mj_integratePos(self.m, at, v, h)
                ends.append(self.motion(at, v + h * a))
            found["acceleration"] = (ends[1] - ends[0])[:, 7:10] / (2 * self.s["h"])
        return found

    def solve(self, method: str, setting: float) -> Any:
        """A function that makes a run."""
        import numpy as np

        m, d, mj = self.m, self.d, self.mj
        (t0, t_end), (name, _, stiffest) = self.s["t"], method.partition(", ")
        steps = round((t_end - t0) / setting)
        m.opt.integrator = getattr(mj.mjtIntegrator, f"mjINT_{name.upper()}")
        m.opt.timestep, m.opt.tolerance, m.opt.iterations = (t_end - t0) / steps, 1e-12, 200
        m.eq_solref[:], m.eq_solimp[:] = self.soft
        if stiffest:
            m.eq_solref[:] = 2 * m.opt.timestep, 1.0
            m.eq_solimp[:] = 0.9999, 0.9999, 0.001, 0.5, 2.0
        outputs = min(steps, self.s["intervals"])
        q, v = self.state()
        mj.mj_resetData(m, d)
        d.qpos[:], d.qvel[:] = q, v
        found = [(q, v)]

        def run() -> Any:
            for _ in range(outputs):
                mj.mj_step(m, d, nstep=steps // outputs)
                found.append((d.qpos.copy(), d.qvel.copy()))
            return lambda: (np.array([self.motion(*one) for one in found]), {"steps": steps})

        return run
