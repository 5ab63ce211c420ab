"""Exported equations of all examples beside the kernels, in every language that is installed, and FMI units run by FMPy."""

from __future__ import annotations

import ctypes
import importlib
import importlib.util
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from exports.kernels import Kernels, differences, values
from exports.units import ABSENT, STEPS, Unit, has_fmpy, off
from rolling.scenes import PROBLEMS
from runner import Case, Claim, Found

import mbdae as mb
from mbdae.native import build

claim = Claim("exports", "exported functions are the kernels in C, CasADi and JAX; FMI units pass FMPy's validation, and their "
              "runs are those of mbdae to the accuracy", 1e-12, "of the largest term", "the compiled kernels; FMPy's "
              "validation; runs of mbdae at a hundredth of the accuracy, DOP853 and Radau of SciPy on y' of model exchange")
EXAMPLES = Path(__file__).parents[2] / "examples"
ACCURACY = 1e-6
#: of scenes with impacts, which units refuse by name, functions alone are compared; the wing of 516 unknowns is left out as a
#: unit; the loop that is over-constrained passes positions in which the rows in force at its start depend on each other
CONTACTS = ("ball_over_cylinder", "bouncing_ball", "clearance_rotor", "latched_door", "slider_crank_clearance",
            "slider_crank_steel")
NO_UNIT = (*CONTACTS, "flapping_wing_study", "over_constrained_loop")
STIFF = ("whirling_shaft",)  #: with beams: model exchange by an implicit method
#: JAX compiles the functions of larger scenes for minutes, CasADi has no tables and eliminates large matrices symbol by symbol
MOST = {"casadi": 100, "jax": 250}
TABLES = [("casadi", "gearbox_torques"), ("casadi", "quarter_car")]


def example(name: str) -> Any:
    """The module of an example."""
    if str(EXAMPLES) not in sys.path:
        sys.path.insert(0, str(EXAMPLES))
    return importlib.import_module(name)


def by_c(export: Any) -> Callable[..., Any]:
    """The function (name, **vectors) -> outputs of an export in C, compiled by the compiler of mbdae."""
    with tempfile.TemporaryDirectory() as folder:
        export.save(Path(folder) / "x.c")
        command = build.compiler()
        flags = [flag for flag in build.flags(command) if flag != "-fvisibility=hidden"]
        done = build.run([*command, *flags, "x.c", "-o", f"x{build.SUFFIX}", "-lm"], Path(folder))
        assert not done.returncode, done.stdout
        library = ctypes.CDLL(str(Path(folder) / f"x{build.SUFFIX}"))
    pointer = ctypes.POINTER(ctypes.c_double)

    def call(name: str, **vectors: Any) -> Any:
        out = np.full(len(export.outputs[name]), np.nan)
        given = [np.array(vectors[v], dtype=float) for v in export.arguments[name]]
        arguments = [ctypes.c_double(a) if v == "t" else a.ctypes.data_as(pointer)
                     for v, a in zip(export.arguments[name], given, strict=True)]
        assert getattr(library, export[name])(*arguments, out.ctypes.data_as(pointer)) == 0
        return out

    return call


def by_module(export: Any) -> Callable[..., Any]:
    """The function (name, **vectors) -> outputs of an export for CasADi or JAX."""
    if export.format == "jax":
        import jax

        jax.config.update("jax_enable_x64", True)
    made: dict[str, Any] = {}

    def call(name: str, **vectors: Any) -> Any:
        if name not in made:
            made[name] = jax.jit(export[name]) if export.format == "jax" else export[name]
        found = made[name](*(np.asarray(vectors[v], dtype=float) for v in export.arguments[name]))
        if name == "jacobian":
            rows, columns = export.pattern
            return np.concatenate([np.asarray(part)[rows, columns] for part in found])
        return np.asarray(found).ravel()

    return call


def of_languages(name: str, eliminated: bool = False, languages: tuple[str, ...] = ("c", "casadi", "jax")) -> list[Found]:
    """Largest difference of every function of an example from the kernels."""
    form = mb.Index1(multipliers="eliminated") if eliminated else None
    found = []
    for language in languages:
        if language != "c" and importlib.util.find_spec(language) is None:
            found.append(Found(np.nan, quantity=language, note=f"{language} is not installed: pip install 'mbdae[{language}]'"))
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            export, kernels = mb.export(example(name).scene(), language, form), Kernels(example(name).scene(), form)
            if kernels.system.n > MOST.get(language, 10**6) or (language, name) in TABLES:
                continue
            call = by_c(export) if language == "c" else by_module(export)
            errors = differences(export, call, kernels, values(export.inputs["p"]))
        worst = max(errors, key=lambda function: errors[function])
        found.append(Found(errors[worst], quantity=language, note=worst))
    if eliminated:
        own = Kernels(example(name).scene(), form)
        found.append(Found(max(own.eliminated_off(t, y) for t, y, _ in own.states()), quantity="mbdae's own elimination",
                           note="of the largest term summed"))
    return found


def scene_of(name: str) -> tuple[Any, float]:
    """A scene with the end of its run: an example or a problem of the claim `rolling`."""
    if name in PROBLEMS:
        return PROBLEMS[name](None)[0], 2.0
    module = example(name)
    return module.scene(), float(min(module.t_end, 0.02 if name == "whirling_shaft" else 6.0))


def of_unit(name: str) -> list[Found]:
    """A unit: what the validation says, its runs by both interfaces, its directional derivatives, by central differences."""
    if not has_fmpy():
        return [Found(np.nan, note=ABSENT)]
    scene, end = scene_of(name)
    times = np.linspace(0, end, STEPS + 1)
    with Unit(mb.export(scene, "fmi")) as unit:
        way = (1e-9, None, "Radau") if name in STIFF else (1e-10,)
        alone, which = off(scene, unit, times, unit.co_simulated(times, ACCURACY), ACCURACY / 100)
        outside, of = off(scene, unit, times, unit.exchanged(times, *way), ACCURACY / 100)
        return [Found(len(unit.problems), 0.0, "problems", "validation", " | ".join(unit.problems)),
                Found(alone, 3 * ACCURACY, "of the largest", "co-simulation", which),
                Found(outside, 3 * ACCURACY, "of the largest", "model exchange", of),
                Found(unit.slope_off(), 1e-5, "of the largest", "directional derivatives")]


def arm() -> Any:
    """Two links on recursive joints, moved by torques u0 and u1 that a loop sets."""
    s = mb.Scene("arm", gravity=(0, -9.81, 0))
    upper, lower = s.link("upper", (0, 0), (0.5, 0), mass=2.0), s.link("lower", (0.5, 0), (0.9, 0), mass=1.0)
    s.revolute("shoulder", s.ground, upper, at=(0, 0), model=mb.Recursive(), torque=s.signal("u0", 0.0))
    s.revolute("elbow", upper, lower, at=(0.5, 0), model=mb.Recursive(), torque=s.signal("u1", 0.0))
    return s


def controlled() -> Found:
    """A sampled controller outside of the unit (PD towards turned joints) beside the same loop around `s.stepper`."""
    if not has_fmpy():
        return Found(np.nan, note=ABSENT)
    scene, sensors, dt = arm(), ["shoulder.angle", "elbow.angle", "shoulder.rate", "elbow.rate"], 0.01

    def torques(x: Any) -> list[float]:
        return [float(120 * (0.8 - x[0]) - 20 * x[2] + 15), float(60 * (-0.5 - x[1]) - 8 * x[3] + 3)]

    steps, largest = scene.stepper(dt, accuracy=ACCURACY / 100), 0.0
    with Unit(mb.export(scene, "fmi")) as unit:
        made = unit.instance("FMU3Slave", ACCURACY)
        for i in range(200):
            own, other = [float(steps[name]) for name in sensors], unit.read(made, sensors)
            largest = max(largest, float(np.max(np.abs(np.subtract(own, other)))))
            steps.set(**dict(zip(("u0", "u1"), torques(own), strict=True)))
            made.setFloat64([unit.references[name] for name in ("u0", "u1")], torques(other))
            steps.advance()
            made.doStep(currentCommunicationPoint=i * dt, communicationStepSize=dt)
        made.freeInstance()
    return Found(largest, 3 * ACCURACY, "rad, rad/s")


def cases() -> list[Case]:
    names = sorted(p.stem for p in EXAMPLES.glob("*.py"))
    units = [*(n for n in names if n not in NO_UNIT), *PROBLEMS]
    return [Case("four-bar", "C", lambda: of_languages("four_bar", languages=("c",))),
            Case("functions", "all languages", of_languages, slow=True, parts=names, each=True),
            Case("functions without multipliers", "all languages", lambda name: of_languages(name, True), slow=True,
                 parts=[n for n in names if n not in ("flapping_wing_study", "clearance_rotor")], each=True),
            Case("a sampled controller", "FMPy", controlled, slow=True),
            Case("units", "FMPy", of_unit, slow=True, parts=units, each=True)]
