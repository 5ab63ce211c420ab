"""Other programs on the same scenes: what their ladders come to, and whether exporters that state another scene are found."""

from __future__ import annotations

import copy
import importlib
import importlib.util
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from runner import Case, Claim, Found
from scenes import heavy_top, n_four_bar, physical_pendulum

import mbdae as mb
from mbdae.arena import SUITES
from mbdae.compare.problem import new_problem
from mbdae.engines import CANNOT, OTHER, Engine, known
from mbdae.engines import Case as Stated
from mbdae.scene.replay import Known, replay

claim = Claim("arena", "every ladder of another program converges to the confirmed reference with the order of its method, or "
              "its rows say what keeps it off; an exporter with a mistake in a mass, an axis, a start or a force is found", 0.0,
              "ladders, mistakes", "SciPy on exported equations; exudyn and MuJoCo where an environment has them")
EXAMPLES = Path(__file__).parents[2] / "examples"
SMALL = 1e-4  #: error to which a ladder has to come where its method and the time of its runs allow
ORDER = 0.35  #: how far a measured order may be from that of theory
#: how failures begin that are words of an exporter, or of a solver that does not come through; anything else, such as another
#: scene or an error of a script, is none
SAID = (CANNOT, "SolverError", "ArithmeticError")
MISTAKES = 40
END = 0.5  #: end of the runs of mistaken exporters, s


def pythons() -> dict[str, str | None]:
    """Interpreters of programs: those named in EXUDYN_PYTHON and MUJOCO_PYTHON, else the running one where it has the program."""
    named = {name: os.environ.get(f"{name.upper()}_PYTHON") for name in ("exudyn", "mujoco")}
    return {"scipy": None} | {name: python for name, python in named.items() if python or importlib.util.find_spec(name)}


def example(name: str) -> Any:
    """The scene of an example."""
    if str(EXAMPLES) not in sys.path:
        sys.path.insert(0, str(EXAMPLES))
    return importlib.import_module(name).scene()


def drawn(kind: str, seed: int = 5) -> Any:
    """A scene of a suite."""
    return SUITES[kind](np.random.default_rng(seed))[1]


#: scenes with the end of their run, s
SCENES: dict[str, tuple[Callable[[], Any], float]] = {
    "pendulum": (lambda: physical_pendulum(90.0), 1.0), "four-bar": (lambda: example("four_bar"), 0.5),
    "six-bar": (lambda: n_four_bar(2), 1.0), "Andrews": (lambda: example("andrews_squeezer"), 0.03),
    "arm": (lambda: example("robot_arm"), 1.0), "heavy top": (heavy_top, 0.3), "spatial chain": (lambda: drawn("spatial"), 0.5),
    "flying beam": (lambda: drawn("beam"), 1.0)}


def ladders(name: str) -> list[Found]:
    """Ladders of one scene that neither converge nor say why, and orders that are not those of theory."""
    make, t_end = SCENES[name]
    w = mb.compare(make(), t_end, [mb.RadauIIA(3)], [1e-6], engines=pythons())
    wrong, orders = list[str](), list[str]()
    for one in w.converged:
        rows = [row for row in w.runs if row.label == one.label]
        said = all((row.failure or "").startswith(SAID) for row in rows) or bool(rows[0].soft)
        first = rows[0].order == 1.0  # of first order: its ladder ends before
        if not said and (one.why or one.error is None or one.error > (1e-2 if first else SMALL)):
            wrong.append(one.text)
        if one.order is not None and rows[0].order is not None and one.order < rows[0].order - ORDER:
            orders.append(one.text)
    return [Found(len(wrong), 0, "ladders", "that do not converge and do not say why", note="; ".join(wrong)),
            Found(len(orders), 0, "ladders", "with a lower order than theory", note="; ".join(orders))]


# -- mistakes of an exporter, drawn


def mistaken(scene: Any, rng: np.random.Generator) -> tuple[str, Any] | None:
    """A scene with a mistake in one of its statements, and the mistake in words; None where this draw changes nothing."""
    statements = copy.deepcopy(scene.statements)
    n = int(rng.integers(len(statements)))
    method, args, kwargs = statements[n]
    kind = str(rng.choice(["mass", "axis", "rate0", "spring", "damper", "at"]))
    if kind == "mass" and method == "rigid_body":
        args[1] = args[1] * 1.05
    elif kind == "axis" and method == "revolute" and "axis" in kwargs and scene.space != "planar":
        turned = np.array(kwargs["axis"], dtype=float) + 0.02 * rng.normal(size=3)
        kwargs["axis"] = (turned / np.linalg.norm(turned)).tolist()
    elif kind in kwargs and kind in ("mass", "spring", "damper", "rate0") and isinstance(kwargs[kind], float) and kwargs[kind]:
        kwargs[kind] = kwargs[kind] * 1.05
    elif kind == "at" and method == "rigid_body" and "at" in kwargs:
        kwargs["at"] = (np.array(kwargs["at"], dtype=float) + 0.01 * (np.array(kwargs["at"]) != 0)).tolist()
        if kwargs["at"] == scene.statements[n][2]["at"]:
            return None
    else:
        return None
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space, "statements": statements}
    try:
        other = replay(data, type(scene), Known(dict(scene.own)))
        other.check()
    except mb.MbdaeError:
        return None
    return f"{kind} of {args[0]} in {scene.name}", other


def exactly(engine: type[Engine], scene: Any) -> Stated | None:
    """The scene as a case of an engine; None where this cannot state it, or states it softly."""
    problem = new_problem(scene, END, None, None)
    assert problem.yardstick.prepared is not None
    case = Stated(scene, problem.yardstick.prepared, problem.times)
    try:
        return None if engine().state(case).soft else case
    except mb.SceneError:
        return None


def mistakes(numbers: Sequence[int]) -> list[Found]:
    """Mistakes that no row shows, the programs in turn."""
    unseen, made, programs = list[str](), 0, pythons()
    for number in numbers:
        rng, name = np.random.default_rng([11, number]), list(programs)[number % len(programs)]
        engine, case, what = known()[name](), None, ""
        while case is None:
            scene = SUITES[str(rng.choice(["chain", "spatial", "free arm", "slider", "stiff", "top", "linkage"]))](rng)[1]
            found = mistaken(scene, rng)
            if found is not None and exactly(engine, scene) is not None:
                what, case = found[0], exactly(engine, found[1])
        made += 1

        class Wrong(engine):  # type: ignore[valid-type,misc]
            def state(self, given: Stated, case: Stated = case) -> Any:
                return super().state(case)

            def motion(self, given: Stated, values: Any, case: Stated = case) -> Any:
                return super().motion(case, values)

        w = mb.compare(scene, END, [mb.RadauIIA(3)], [1e-6], engines={Wrong: programs[name]})
        if not all(OTHER in one.text or one.why for one in w.converged):
            unseen.append(f"{what}: " + "; ".join(one.text for one in w.converged))
    return [Found(len(unseen), 0, "mistakes", f"of {made} that no row shows", note=" | ".join(unseen))]


def cases() -> list[Case]:
    """Every scene, and mistakes of exporters."""
    return [*(Case(name, "all", lambda name=name: ladders(name), slow=name not in ("pendulum", "four-bar")) for name in SCENES),
            Case("mistakes", "all", mistakes, slow=True, parts=range(MISTAKES))]
