"""Trees of joints from 16 to 2000 bodies: cost of the start, of a right-hand side and of a step; beside pinocchio and MuJoCo.

    python benchmarks/trees.py [--sizes 16 64 100 500 2000] [--pinocchio PYTHON] [--mujoco PYTHON]

PYTHON: an interpreter in whose environment pinocchio (package `pin`) or MuJoCo (package `mujoco`) is installed. CPU time of one
thread, the smallest of several repeats; loops over evaluations are those of Python on all sides, a call costs 0.1 to 0.6 us.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.system.prepare import prepare

R = mb.Recursive()
LENGTH, INERTIA, SLANTED = 0.1, (0.01, 0.02, 0.03), (0, 1, 0.3)


def planar_chain(n: int) -> mb.Scene:
    """Rods on hinges, drawn horizontally."""
    s = mb.Scene("planar chain", gravity=(0, -9.81, 0))
    last = s.ground
    for i in range(n):
        rod = s.link(f"b{i}", (LENGTH * i, 0), (LENGTH * (i + 1), 0), mass=1.0)
        s.revolute(f"j{i}", last, rod, at=(LENGTH * i, 0), model=R)
        last = rod
    return s


def tree(n: int, branching: int, name: str) -> mb.Scene:
    """Bodies on hinges whose axes alternate; every body carries `branching` others."""
    s = mb.Scene(name, gravity=(0, -9.81, 0))
    made: list[tuple[Any, np.ndarray]] = [(s.ground, np.zeros(3))]
    for i in range(n):
        parent, at = made[(i - 1) // branching + 1 if i else 0]
        side = (i % branching - (branching - 1) / 2) * 0.03
        end = at + np.array([LENGTH, side, 0])
        body = s.rigid_body(f"b{i}", 1.0, INERTIA, at=(at + end) / 2)
        s.revolute(f"j{i}", parent, body, at=at, axis=(0, 0, 1) if i % 2 else SLANTED, model=R)
        made.append((body, end))
    return s


def humanoid() -> mb.Scene:
    """40 hinges: a spine of 4 on the ground, two arms of 9, two legs of 9."""
    rng, s = np.random.default_rng(4), mb.Scene("humanoid", gravity=(0, 0, -9.81))

    def limb(parent: Any, at: np.ndarray, way: np.ndarray, count: int, name: str) -> tuple[Any, np.ndarray]:
        for i in range(count):
            end = at + way
            body = s.rigid_body(f"{name}{i}", float(rng.uniform(0.5, 2)), rng.uniform(0.005, 0.008, 3), at=(at + end) / 2)
            s.revolute(f"j{name}{i}", parent, body, at=at, axis=np.eye(3)[i % 3], model=R)
            parent, at = body, end
        return parent, at

    chest, top = limb(s.ground, np.zeros(3), np.array([0, 0, 0.15]), 4, "spine")
    for side in (-1, 1):
        limb(chest, top + np.array([0, 0.2 * side, 0]), np.array([0, 0.08 * side, -0.02]), 9, f"arm{side}")
        limb(_body(s, "spine0"), np.array([0, 0.1 * side, 0.0]), np.array([0, 0, -0.1]), 9,
             f"leg{side}")
    return s


def _body(s: mb.Scene, name: str) -> Any:
    return next(b for b in s.bodies if b.name == name)


SCENES: dict[str, Callable[[int], mb.Scene]] = {
    "planar chain": planar_chain,
    "spatial chain": lambda n: tree(n, 1, "spatial chain"),
    "tree, branching 3": lambda n: tree(n, 3, "tree"),
}


def least(f: Callable[[], Any], count: int, repeats: int = 7) -> float:
    """CPU time of a call, s: the least of several repeats."""
    best = np.inf
    for _ in range(repeats):
        begin = time.process_time()
        for _ in range(count):
            f()
        best = min(best, (time.process_time() - begin) / count)
    return best


def rates(scene: mb.Scene) -> tuple[float, Callable[[np.ndarray, np.ndarray], None], Any]:
    """us of a right-hand side, the right-hand side itself, and the system."""
    system = scene.system(mb.ODE())
    y, out = system.y0 + 0.1, np.empty(system.n)
    system.rhs(0.0, y, out)
    equations = system.assembly.evaluation
    call = equations._call_rates, (equations.address, 0.0, equations._at_y, equations._at_rates)
    return 1e6 * least(lambda: call[0](*call[1]), max(5, 20000 // system.n)), lambda y, out: system.rhs(0.0, y, out), system


def row(name: str, n: int) -> str:
    """A line of the table, measured in this process."""
    begin = time.process_time()
    scene = SCENES[name](n)
    drawn = time.process_time()
    prepare(scene)
    ready = time.process_time()
    us, _, system = rates(scene)
    jacobian = least(lambda: system.jacobian_parts(0.0, system.y0, system.yp0), 1, 2) if n <= 500 else np.nan
    r = SCENES[name](n).simulate(0.05, accuracy=1e-3, outputs=201)
    steps = r.stats.steps + r.stats.rejected
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    dense = f"{1e3 * jacobian:.1f}" if n <= 500 else "-"
    return (f"| {name} | {n} | {drawn - begin:.2f} | {ready - drawn:.2f} | {us:.1f} | {1e3 * us / n:.0f} | {dense} | "
            f"{1e6 * r.stats.cpu_s / steps / n:.2f} | {memory:.0f} |")


PINOCCHIO = """
import json, sys, time, numpy as np, pinocchio as pin
links = json.load(sys.stdin)
m = pin.Model(); m.gravity.linear = np.array(links["gravity"])
for parent, axis, at, com, mass, J in links["links"]:
    j = m.addJoint(parent, pin.JointModelRevoluteUnaligned(np.array(axis)), pin.SE3(np.eye(3), np.array(at)), str(m.njoints))
    m.appendBodyToJoint(j, pin.Inertia(mass, np.array(com), np.diag(J)), pin.SE3.Identity())
d = m.createData(); q, v = map(np.array, links["state"]); tau = 0 * v
count, best = max(10, 40000 // len(q)), 1e9
for _ in range(9):
    t = time.process_time()
    for _ in range(count): pin.aba(m, d, q, v, tau)
    best = min(best, (time.process_time() - t) / count)
print(json.dumps([1e6 * best, pin.aba(m, d, q, v, tau).tolist(), pin.__version__]))
"""

MUJOCO = """
import json, sys, time, numpy as np, mujoco as mj
data = json.load(sys.stdin)
m = mj.MjModel.from_xml_string(data["xml"]); d = mj.MjData(m)
def set(state):
    mj.mj_resetData(m, d); d.qpos[:], d.qvel[:] = state
set(data["state"]); mj.mj_forward(m, d); a = d.qacc.tolist(); best = 1e9
for _ in range(9):
    t = time.process_time()
    for _ in range(2000): mj.mj_forward(m, d)
    best = min(best, (time.process_time() - t) / 2000)
runs = []
m.opt.integrator = mj.mjtIntegrator.mjINT_RK4
for steps in data["steps"]:
    m.opt.timestep = data["end"] / steps; set(data["start"]); t = time.process_time()
    for _ in range(steps): mj.mj_step(m, d)
    runs.append([steps, time.process_time() - t, d.qpos.tolist()])
print(json.dumps([1e6 * best, a, mj.__version__, runs]))
"""


def other(python: str, script: str, given: Any) -> Any:
    """What a script prints as JSON in another interpreter."""
    found = subprocess.run([python, "-c", script], input=json.dumps(given), capture_output=True, text=True, check=True)
    return json.loads(found.stdout)


def links(scene: mb.Scene) -> list[tuple[int, list[float], list[float], list[float], float, list[float]]]:
    """Joints of a scene: number of the parent (0: the ground), axis, place of the joint from that of the parent, centre of mass
    from the joint, mass, moments of inertia."""
    number, at = {scene.ground: 0}, {scene.ground: np.zeros(3)}
    found = []
    for joint in scene.joints:
        law: Any = joint.joint
        place, axis = np.asarray(law.at, dtype=float), np.asarray(law.axis, dtype=float)
        number[joint.l], at[joint.l] = len(number), place
        J = np.diag(joint.l.inertia)
        found.append((number[joint.k], (axis / np.linalg.norm(axis)).tolist(), (place - at[joint.k]).tolist(),
                      (joint.l.drawn.position - place).tolist(), float(joint.l.mass), J.tolist()))
    return found


def beside_pinocchio(python: str, n: int) -> str:
    """The forward dynamics of the spatial chain."""
    scene = SCENES["spatial chain"](n)
    us, rhs, system = rates(scene)
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=(2, n))
    out = np.empty(system.n)
    rhs(np.r_[q, v], out)
    given = {"gravity": [0, -9.81, 0], "links": links(scene), "state": [q.tolist(), v.tolist()]}
    theirs, a, version = other(python, PINOCCHIO, given)
    apart = np.max(np.abs(out[n:] - a)) / np.max(np.abs(a))
    return f"| {n} | {us:.1f} | {theirs:.1f} ({version}) | {us / theirs:.2f} | {apart:.1e} |"


def xml(scene: mb.Scene) -> str:
    """A scene of hinges as MuJoCo reads it, without contacts."""
    children: dict[int, list[int]] = {}
    every = links(scene)
    for i, link in enumerate(every, start=1):
        children.setdefault(link[0], []).append(i)

    def words(values: list[float]) -> str:
        return " ".join(f"{x:.17g}" for x in values)

    def body(i: int) -> str:
        _, axis, at, com, mass, J = every[i - 1]
        inner = "".join(map(body, children.get(i, [])))
        return (f'<body pos="{words(at)}"><joint type="hinge" axis="{words(axis)}" name="j{i}"/><inertial pos="{words(com)}" '
                f'mass="{mass:.17g}" diaginertia="{words(J)}"/>{inner}</body>')

    return ('<mujoco><compiler angle="radian" inertiafromgeom="false"/>'
            '<option gravity="0 0 -9.81"><flag contact="disable"/></option>'
            f'<worldbody>{"".join(map(body, children[0]))}</worldbody></mujoco>')


def depth_first(scene: mb.Scene) -> list[int]:
    """Numbers of the joints in the order in which MuJoCo counts them."""
    parents = [link[0] for link in links(scene)]
    found: list[int] = []

    def visit(i: int) -> None:
        found.append(i - 1)
        for j, parent in enumerate(parents, start=1):
            if parent == i:
                visit(j)

    for j, parent in enumerate(parents, start=1):
        if parent == 0:
            visit(j)
    return found


def beside_mujoco(python: str, end: float = 1.0) -> list[str]:
    """The humanoid: accelerations, and runs at equal error of the joint angles at the end."""
    scene = humanoid()
    us, rhs, system = rates(scene)
    n, order = system.n // 2, depth_first(scene)
    q, v = 0.3 * np.random.default_rng(0).normal(size=(2, n))
    out = np.empty(system.n)
    rhs(np.r_[q, v], out)
    begin = np.r_[0.05 * np.ones(n), np.zeros(n)]
    given = {"xml": xml(scene), "state": [q[order].tolist(), v[order].tolist()], "end": end,
             "start": [begin[:n].tolist(), begin[n:].tolist()], "steps": [500, 1000, 2000, 4000, 8000]}
    theirs, a, version, runs = other(python, MUJOCO, given)
    apart = np.max(np.abs(out[n:][order] - a)) / np.max(np.abs(a))
    lines = [f"| mj_forward ({version}), right-hand side | {theirs:.1f} us | {us:.1f} us | {us / theirs:.2f} | {apart:.1e} |"]
    started = system.starting(0.0, begin, np.zeros(system.n))
    exact = mb.DOP853(rtol=1e-12).solve(started, end).y[-1][:n]
    own = []
    for rtol in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10):
        begin_cpu = time.process_time()
        mb.DOP853(rtol=rtol).solve(started, end)
        cpu = min(time.process_time() - begin_cpu, least(lambda r=rtol: mb.DOP853(rtol=r).solve(started, end), 1, 3))
        own.append((float(np.max(np.abs(mb.DOP853(rtol=rtol).solve(started, end).y[-1][:n] - exact))), cpu))
    for steps, cpu, angles in runs:
        error = float(np.max(np.abs(np.array(angles) - exact[order])))
        at = float(np.exp(np.interp(np.log(error), *np.log(np.array(sorted(own)).T))))
        lines.append(f"| run of {end:g} s, error {error:.1e} rad (RK4, {steps} steps) | {1e3 * cpu:.1f} ms | {1e3 * at:.1f} ms | "
                     f"{at / cpu:.3f} | |")
    return lines


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sizes", type=int, nargs="*", default=[16, 64, 100, 500, 2000])
    parser.add_argument("--row", nargs=2)
    parser.add_argument("--pinocchio")
    parser.add_argument("--mujoco")
    given = parser.parse_args()
    if given.row:
        print(row(given.row[0], int(given.row[1])))
        return
    print("| scene | bodies | scene, s | prepare, s | right-hand side, us | ns a body | Jacobian, ms | us a step and body | MB |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in SCENES:
        for n in given.sizes:  # each in a process of its own, whose memory is its own
            command = [sys.executable, __file__, "--row", name, str(n)]
            line = subprocess.run(command, capture_output=True, text=True, check=True)
            print(line.stdout.strip().splitlines()[-1], flush=True)
    if given.pinocchio:
        print("\n| spatial chain | right-hand side, us | aba of pinocchio, us | ratio | apart |\n|---|---|---|---|---|")
        for n in (16, 64, 500):
            print(beside_pinocchio(given.pinocchio, n), flush=True)
    if given.mujoco:
        print("\n| humanoid, 40 hinges | MuJoCo | mbdae | ratio | apart |\n|---|---|---|---|---|")
        print("\n".join(beside_mujoco(given.mujoco)))


if __name__ == "__main__":
    main()
