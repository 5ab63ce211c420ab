"""What recursive joints cost beside kinematic ones: the rotor in ground resonance, and chains of 1 to 64 rods.

    rotor     CPU at a measured error of 1e-6 (against the reference of validation/ground_resonance), by solver and model
    kernels   residual, Jacobian and right-hand side of the rotor's equations, one call
    chains    CPU at a measured error of 1e-6 m, how it grows, how many joints stay recursive

    python benchmarks/recursive_joints.py [rotor] [kernels] [chains]

One thread, process time, best of two or more. Equations are compiled before the clock starts; what that takes is a column of its
own. A busy machine makes every number larger: repeat before believing it.
"""

# ruff: noqa: E402

from __future__ import annotations

import os

for library in ("OPENBLAS", "OMP", "MKL"):
    os.environ[f"{library}_NUM_THREADS"] = "1"  # read once, when numpy is imported

import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.compare.run import Equations
from mbdae.formulations import system_for
from mbdae.results.accuracy import Accuracy, RunInfo
from mbdae.results.result import Result
from mbdae.system.prepare import Prepared, prepare

sys.path.insert(0, str(Path(__file__).parent.parent / "validation"))
from scenes import data, ground_resonance

GOAL, T_END = 1e-6, 2.0  # rad or m; s
CASES = {"A1": "A1_prescribed_1axis", "A2": "A2_prescribed_2axis_iso", "B1": "B1_free_1axis", "B2": "B2_free_2axis_iso"}
Run = tuple[Prepared, Any]


# -- errors and costs


def read(prepared: Prepared, solution: Any, times: Any) -> Result:
    """The result of a solver's run at `times`."""
    return Result(prepared, solution, RunInfo(solution.solver, "", Accuracy(None, None), solution.stats), times)


def known(case: str) -> tuple[np.ndarray, dict[str, Any]]:
    """Times (nt,) up to `T_END` and the entry of the reference."""
    entry = data("ground_resonance")["nonlinear"][CASES[case]]
    t = np.array(entry["t"])
    return t[t <= T_END], entry


def rotor_error(result: Result, case: str) -> float:
    """Largest error of lag angles (rad) and hub position (m) over the reference's times."""
    t, entry = known(case)
    lag = np.array([result[f"lag{i + 1}"].angle for i in range(4)]).T - np.array(entry["lag_angles"])[: len(t)]
    axes = entry["settings"]["axes"]
    hub = result["block"].position[:, :axes] - np.array(entry["hub"])[: len(t)]
    return float(max(np.max(np.abs(lag)), np.max(np.abs(hub))))


def cost(run: Callable[[], Any]) -> tuple[Any, float]:
    """What a run returns and its CPU seconds, best of two, of seven where it takes less than 0.1 s."""
    seconds: list[float] = []
    while len(seconds) < (2 if not seconds or min(seconds) > 0.1 else 7):
        begin = time.process_time()
        solution = run()
        seconds.append(time.process_time() - begin)
    return solution, min(seconds)


def at_goal(solve: Callable[[float], tuple[float, float]], ladder: Sequence[float]) -> tuple[float, str]:
    """CPU s at the error `GOAL`, between the two neighbouring runs of a ladder of tolerances or steps (log-log), and what
    was run: from loose to tight until the error is below."""
    before: tuple[float, float] | None = None
    for value in ladder:
        try:
            error, seconds = solve(value)
        except mb.SolverError:
            before = None
            continue
        if error <= GOAL:
            if before is None or before[0] <= error:
                return seconds, f"{value:.3g}: {error:.0e}"
            share = np.log(before[0] / GOAL) / np.log(before[0] / error)
            return float(before[1] * (seconds / before[1]) ** share), f"{value:.3g}: {error:.0e}"
        before = error, seconds
    return float("nan"), "not reached"


def tolerances(first: int, last: int) -> list[float]:
    """10^-first ... 10^-last in steps of 10^(1/2)."""
    return [10.0 ** (-k / 2) for k in range(2 * first, 2 * last + 1)]


# -- the rotor

MODELS: dict[str, tuple[str, Any]] = {
    "recursive, spatial": ("spatial", mb.Recursive()),
    "kinematic, spatial": ("spatial", mb.Kinematic()),
    "kinematic, spatial, lean": ("spatial", None),
    "recursive, planar": ("planar", mb.Recursive()),
    "kinematic, planar": ("planar", mb.Kinematic()),
    "kinematic, planar, lean": ("planar", None),
}


def methods(recursive: bool) -> dict[str, tuple[Callable[[float], Any], Any, list[float]]]:
    """Solver of a tolerance or step, form, ladder."""
    steps = [8e-3 * 2.0 ** (-k / 2) for k in range(13)]
    form = None if recursive else mb.Index3()
    table: dict[str, tuple[Callable[[float], Any], Any, list[float]]] = {
        "IDA": (lambda v: mb.IDA(rtol=v), None, tolerances(6, 12)),
        "RadauIIA(2), steps": (lambda h: mb.RadauIIA(2, step=h), form, steps),
        "RadauIIA(3)": (lambda v: mb.RadauIIA(3, rtol=v), form, tolerances(4, 10)),
    }
    if recursive:
        table["CVODE (Adams)"] = (lambda v: mb.CVODE(rtol=v), None, tolerances(6, 11))
    return table


def rotor(case: str) -> Iterator[dict[str, Any]]:
    """One row per joint model: CPU s at the error `GOAL` by method."""
    times, entry = known(case)
    axes, free = entry["settings"]["axes"], entry["settings"]["free"]
    for name, (space, model) in MODELS.items():
        equations = Equations(prepare(ground_resonance(axes, free, space, model)))
        row: dict[str, Any] = {"model": name, "unknowns": equations.system(None).n}
        for label, (make, form, ladder) in methods(isinstance(model, mb.Recursive)).items():

            def solve(value: float, make: Any = make, form: Any = form, equations: Any = equations) -> tuple[float, float]:
                solver = make(value)
                system = equations.for_solver(form, solver)
                solution, seconds = cost(lambda: solver.solve(system, T_END))
                return rotor_error(read(equations.prepared, solution, times), case), seconds

            row[label] = at_goal(solve, ladder)
        yield row


def lag_difference(free: bool, solver: Any, axes: int = 2) -> float:
    """max|a - b| / max|b| of the lag angles of recursive (a) and kinematic (b) joints over 1 s at 501 times."""
    times, angles = np.linspace(0.0, 1.0, 501), []
    for model in (mb.Recursive(), mb.Kinematic()):
        scene = ground_resonance(axes, free, "auto", model)
        r = scene.simulate(1.0, accuracy=1e-10, solver=solver, outputs=times)
        angles.append(np.array([r[f"lag{i + 1}"].angle for i in range(4)]))
    return float(np.max(np.abs(angles[0] - angles[1])) / np.max(np.abs(angles[1])))


# -- kernels


def microseconds(call: Callable[[], Any], repeats: int = 1000) -> float:
    """CPU of one call, best of five blocks."""
    best = float("inf")
    for _ in range(5):
        begin = time.process_time()
        for _ in range(repeats):
            call()
        best = min(best, time.process_time() - begin)
    return best / repeats * 1e6


def kernels(space: str, case: str, model: Any) -> dict[str, float]:
    """CPU us of one residual, Jacobian and right-hand side of the rotor's equations."""
    _, entry = known(case)
    system = system_for(prepare(ground_resonance(entry["settings"]["axes"], entry["settings"]["free"], space, model)))
    y, yp, out, t = system.y0, system.yp0, np.empty(system.n), system.t0
    J = np.zeros((system.n, system.n) if system.sparsity is None else system.sparsity.nnz)
    row = {"unknowns": float(system.n), "residual": microseconds(lambda: system.residual(t, y, yp, out)),
           "Jacobian": microseconds(lambda: system.jacobian(t, y, yp, 100.0, J), 300)}
    if system.rhs is not None:
        row["right-hand side"] = microseconds(lambda: system.rhs(t, y, out))
    return row


# -- chains

SIZES = {"planar": (1, 4, 16, 64), "spatial": (1, 4, 10, 16, 64)}  #: 10 is the longest in space that stays recursive


def chain(bodies: int, space: str, model: Any) -> mb.Scene:
    """Rods of 1 m and 1 kg released from the horizontal; in space hinged about y and (0, 1, 1) in turn."""
    spatial = space == "spatial"
    s = mb.Scene("chain", gravity=(0, 0, -9.81) if spatial else (0, -9.81, 0), space=space)
    before = s.ground
    for i in range(bodies):
        rod = s.rigid_body(f"rod{i + 1}", 1.0, (1e-3, 1 / 12, 1 / 12), at=(i + 0.5, 0, 0))
        axis = (0, 0, 1) if not spatial else (0, 1, 0) if i % 2 == 0 else (0, 1, 1)
        s.revolute(f"J{i + 1}", before, rod, at=(i, 0, 0), axis=axis, model=model)
        before = rod
    return s


def motion(prepared: Prepared, solution: Any) -> np.ndarray:
    """(bodies, 101, 3) m, the centres of mass over the run."""
    r = read(prepared, solution, np.linspace(0.0, 1.0, 101))
    return np.array([r[body.name].position for body in prepared.model.scene.bodies])


def chains(space: str, bodies: int) -> Iterator[dict[str, Any]]:
    """Both models of a chain: joints that stayed recursive, seconds to prepare and compile, CPU s at the error `GOAL`."""
    exact: np.ndarray | None = None
    for name, model in {"recursive": mb.Recursive(), "kinematic": mb.Kinematic()}.items():
        Equations(prepare(chain(2, space, model))).system(None)  # the laws are derived before the clock starts
        begin = time.process_time()
        equations = Equations(prepare(chain(bodies, space, model)))
        system = equations.system(None)
        row: dict[str, Any] = {"space": space, "bodies": bodies, "model": name, "unknowns": system.n,
                               "recursive": equations.recursive[0], "to compile": time.process_time() - begin}
        if name == "recursive" and not equations.recursive[0]:
            yield row  # the equations are those of the kinematic joints
            continue
        if exact is None:
            best = mb.CVODE(rtol=1e-12) if system.rhs is not None else mb.IDA(rtol=1e-11)
            exact = motion(equations.prepared, best.solve(system, 1.0))  # type: ignore[arg-type]
        for label, make in {"IDA": mb.IDA, "CVODE (Adams)": mb.CVODE}.items():
            if label == "IDA" or system.rhs is not None:

                def solve(value: float, make: Any = make, equations: Any = equations, exact: Any = exact) -> tuple[float, float]:
                    solution, seconds = cost(lambda: make(rtol=value).solve(equations.system(None), 1.0))
                    return float(np.max(np.abs(motion(equations.prepared, solution) - exact))), seconds

                row[label] = at_goal(solve, tolerances(4, 10))
        yield row


# -- tables


def table(rows: Iterator[dict[str, Any]] | list[dict[str, Any]], head: Sequence[str]) -> None:
    """A table, line by line as it is measured."""
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for row in rows:
        print("| " + " | ".join(_cell(row.get(column, "")) for column in head) + " |", flush=True)


def _cell(value: Any) -> str:
    if isinstance(value, tuple):
        return f"{value[0]:.3f} ({value[1]})"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def main(wanted: Sequence[str]) -> None:
    """Print the tables asked for, all without a name."""
    warnings.simplefilter("ignore", mb.AccuracyWarning)
    if not wanted or "kernels" in wanted:
        rows = [{"case": case, "model": f"{name}, {space}", **kernels(space, case, model)}
                for case in ("A2", "B2") for space in ("spatial", "planar")
                for name, model in (("recursive", mb.Recursive()), ("kinematic", mb.Kinematic()))]
        table(rows, ("case", "model", "unknowns", "residual", "Jacobian", "right-hand side"))
    if not wanted or "rotor" in wanted:
        for case in ("A2", "B2"):
            print(f"\n{case}: CPU s at an error of {GOAL:g} (tightest tolerance or step tried: its error)\n")
            table(rotor(case), ("model", "unknowns", "IDA", "RadauIIA(2), steps", "RadauIIA(3)", "CVODE (Adams)"))
    if not wanted or "chains" in wanted:
        print(f"\nchains: CPU s at an error of {GOAL:g} m, any rod\n")
        rows = (row for space in ("planar", "spatial") for n in SIZES[space] for row in chains(space, n))
        table(rows, ("space", "bodies", "model", "recursive", "unknowns", "to compile", "IDA", "CVODE (Adams)"))


if __name__ == "__main__":
    main(sys.argv[1:])
