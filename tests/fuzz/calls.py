"""The public callables outside a scene's statements: a good value of every option, and what hostile values are legitimate."""

from __future__ import annotations

import functools
import inspect
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import mbdae as mb
from mbdae.analysis import Equilibrium, Floquet, Linearization
from mbdae.analysis.shapes import Mode
from mbdae.compare.page import Comparison
from mbdae.compare.run import Run
from mbdae.documents import Document
from mbdae.extremes.page import Block, Extremes
from mbdae.integrators.solution import Solution
from mbdae.results.result import Result
from mbdae.run.batch import State
from mbdae.run.stepper import Stepper
from mbdae.scene.components import JointModel, Stop
from mbdae.scene.scene import SceneData
from mbdae.scene.shapes import Section
from mbdae.sweep import Sweep
from mbdae.symbolic.law import Law
from mbdae.symbolic.part import Part

EXPORTED = [getattr(mb, name) for name in mb.__all__]
FUNCTIONS = [f for f in EXPORTED if inspect.isfunction(f)]
#: laws, their parts and joint models are statements of a scene
STATED = (SceneData, Law, Part, JointModel, Section, Stop, BaseException)
CLASSES = [c for c in EXPORTED if isinstance(c, type) and not issubclass(c, STATED) and c not in (mb.Audit, mb.Export)]
#: classes whose objects users get from others: their methods alone
GIVEN = [mb.Scene, Solution, Result, Equilibrium, Linearization, Floquet, Mode, Comparison, Extremes, Block, Sweep, mb.Audit,
         mb.Export, Document, Stepper, State]
#: what other tests fuzz, or who writes a solver, a form or a system of his own provides
ELSEWHERE = {
    **dict.fromkeys(("Box", "Cylinder", "Plane", "Point", "Sphere"), "statements of a scene"),
    **dict.fromkeys(("Result.gradient", "Result.sensitivity", "Mode.gradient", "integral", "at_end", "largest",
                     "number"), "tests/derivatives"),
    **dict.fromkeys(("fit", "design", "mass", "function"), "tests/test_fits"),
    **dict.fromkeys(("Result.to_csv", "Result.to_dataframe", "Result.to_xarray", "Result.value", "Result.peak",
                     "Result.mean", "Result.rms", "Result.error"),
                    "tests/results"),
    "Solver.aimed": "interface", "System.remember": "interface", "table": "tests/inputs", "curve": "tests/inputs",
    **dict.fromkeys(("ReducedBody", "ReducedBody.doubts", "ReducedBody.displacement", "ReducedBody.drawn",
                     "ReducedBody.stress", "ReducedBody.von_mises", "read_fe"), "tests/inputs"),
    "read_table": "tests/inputs", "read_urdf": "tests/robots", "read_mjcf": "tests/robots",
    "Scene.write_mjcf": "tests/robots",
    "SceneData.__getitem__": "statements of a scene", "load": "files",
    **dict.fromkeys(("params", "rate"), "statements of a law"),
    "Solver.dense": "interface", "Solver.integrate": "interface", "Solver.run": "between modules",
    "Solver.between_breaks": "between modules", "State.save": "files",
    "Solver.check": "interface", "Solver.factor": "interface", "_Alpha.run": "between modules",
    "Form.for_index": "interface", "Form.for_time": "interface", "Form.refusal": "interface", "Form.within": "interface",
    "System.accept": "interface", "System.read_at": "interface", "System.jacobian": "interface", "System.residual": "interface",
    "System.jacobian_parts": "interface", "System.jacobian_values": "interface", "System.residual_stages": "interface",
    "System.starting": "interface", "System.accept_many": "interface", "System.sampling": "interface",
    "System.renewed": "interface",
    "System.restarted": "interface", "System.numbers": "interface", "System.dense_parts": "between modules",
    "System.linear_stages": "between modules",
    "System.doubt": "between modules", "ReducedBody.by_modes": "between modules", "ReducedBody.coordinates": "between modules",
    "ReducedBody.left_out_of": "between modules",
    "_Alpha.doubts": "interface", "OneStep.advance": "interface", "Stepped.with_step": "between modules",
    "RunStates.coordinate": "between modules", "RunStates.coordinates": "between modules",
    "RunStates.coordinate_at": "between modules", "RunStates.observed": "between modules",
    "ControlStatements.sensor": "statements of a scene",
    "RunStates.over_laws": "between modules", "RunStates.sum_over_laws": "between modules",
    "Run.name": "between modules", "Run.own_accuracy": "between modules",
    "Solution.times": "as Solution.__call__",
}


def public() -> set[str]:
    """Names of all public callables with options: functions, constructors, and methods where they are defined."""
    found = {f.__name__ for f in FUNCTIONS} | {c.__name__ for c in CLASSES}
    for owner in (*CLASSES, *GIVEN):
        for name in dir(owner):
            method = inspect.getattr_static(owner, name)
            named = not name.startswith("_") or name in ("__call__", "__getitem__")
            if not inspect.isfunction(method):
                continue
            own = inspect.unwrap(method, stop=lambda f: not hasattr(f, "names_arguments"))
            statement = hasattr(own, "__wrapped__") and own.__module__.startswith("mbdae.scene")
            stated = statement or _elsewhere(owner, name)
            if named and not stated and len(inspect.signature(method).parameters) > 1:
                found.add(method.__qualname__)
    return found - set(ELSEWHERE)


def _elsewhere(owner: type, name: str) -> bool:
    """Whether `ELSEWHERE` names the method, or that of a base which it redefines."""
    return any(f"{base.__name__}.{name}" in ELSEWHERE for base in owner.__mro__)


@dataclass(frozen=True)
class Call:
    """A callable with a good value of every option, in its order; stop: a function it calls when all of them are read."""

    make: Callable[[], Callable[..., Any]]
    good: Callable[[], dict[str, Any]]
    stop: str = ""


@functools.cache
def scene() -> Any:
    """A pendulum."""
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), damper=0.5)
    return s


@functools.cache
def stepper() -> Any:
    return scene().stepper(0.01, inputs=["hinge.damper"])


@functools.cache
def result() -> Any:
    """A short run of it."""
    return scene().simulate(0.5, solver=mb.RadauIIA(3, rtol=1e-4), outputs=3)


@functools.cache
def hanging() -> Any:
    """The pendulum at rest."""
    return scene().equilibrium()


@functools.cache
def linear() -> Any:
    """Its modes there."""
    return scene().linearize(hanging())


@functools.cache
def floquet() -> Any:
    """Its multipliers there."""
    return scene().floquet(1.0, hanging(), accuracy=1e-3)


@functools.cache
def dae() -> Any:
    """Three unknowns that decay."""
    return mb.DAE(lambda t, y, yp, out: yp + y, [1.0, 2.0, 3.0], [-1.0, -2.0, -3.0])


@functools.cache
def comparison() -> Any:
    """Two runs of the pendulum."""
    return mb.compare(dae(), 0.1, [mb.RadauIIA(3)], [1e-3])


@functools.cache
def folder() -> Path:
    """Where pictures and files go."""
    return Path(tempfile.mkdtemp())


def job(a: float) -> dict[str, float]:
    """A job of a sweep."""
    return {"b": a}


def tell(*_: Any) -> None:
    """A progress function."""


def residual(t: float, y: Any, yp: Any, out: Any) -> Any:
    """Three unknowns that decay."""
    return yp + y


def jacobian(t: float, y: Any, yp: Any, cj: float, out: Any) -> Any:
    """Of the same."""
    return (1 + cj) * np.eye(3)


def guards(t: float, y: Any) -> Any:
    """A contact far away."""
    return np.array([1.0]), np.array([0.0]), np.array([np.inf])


def _parts() -> Any:
    return mb.Switches(lambda t, y: np.ones((len(t), 0)), (), np.zeros(0), ())


def _block() -> Block:
    return Block("a", (1.0,), ("none",), ())


def _sweep() -> Sweep:
    return mb.sweep(job, [{"a": 1.0}], executor=_Now())


class _Now:
    """An executor that does what it is given at once."""

    def submit(self, function: Any, *args: Any) -> Any:
        """A finished future."""
        from concurrent.futures import Future

        done: Any = Future()
        done.set_result(function(*args))
        return done


class Euler(mb.OneStep):
    """A solver of a user's own."""

    order = 1

    def advance(self, f: Any, t: float, y: Any, h: float) -> Any:
        return y + h * f(t, y)


TOLERANCES: dict[str, Any] = {"rtol": 1e-6, "atol": None}
SOLVE = {"system": dae(), "t_end": 0.1, "outputs": 3, "max_wall": 60.0, "progress": tell, "h0": 0.01, "max_residuals": 1e5,
         "begin": 0.0, "share": 1.0}
RUNS: dict[str, Any] = {"max_wall": 60.0, "progress": tell, "resume": None}
PICTURE: dict[str, Any] = {"against": None, "labels": None, "path": None, "ax": None}
FILE = {"path": None}
INTEGRATE = "mbdae.integrators.base.StepLoop"

CALLS: dict[str, Call] = {
    "IDA": Call(lambda: mb.IDA, lambda: TOLERANCES | {"max_order": 5}),
    "DOP853": Call(lambda: mb.DOP853, lambda: TOLERANCES),
    "CVODE": Call(lambda: mb.CVODE, lambda: TOLERANCES | {"method": "Adams", "max_order": None}),
    "RadauIIA": Call(lambda: mb.RadauIIA, lambda: {"stages": 3, **TOLERANCES, "step": 0.1, "newton": 1e-6}),
    "GeneralizedAlpha": Call(lambda: mb.GeneralizedAlpha, lambda: {"rho": 0.7, "step": None, "accuracy": None}),
    "HHT": Call(lambda: mb.HHT, lambda: {"alpha": 0.1, "step": None, "accuracy": None}),
    "OneStep": Call(lambda: Euler, lambda: {"step": None, "accuracy": None}),
    "measure_order": Call(lambda: mb.measure_order, lambda: {
        "solver": mb.HHT(), "what": scene(), "t_end": 0.1, "form": mb.GGL(), "steps": (4, 6, 8), "exact": None},
        "mbdae.integrators.named._reference"),
    "GGL": Call(lambda: mb.GGL, lambda: {"algebraic": None, "waves": False}),
    "Index1": Call(lambda: mb.Index1, lambda: {"baumgarte": 1.0, "multipliers": None, "waves": False}),
    "Index3": Call(lambda: mb.Index3, lambda: {"waves": False}),
    "ODE": Call(lambda: mb.ODE, lambda: {"mixed": False, "waves": False}),
    "Run": Call(lambda: Run, lambda: {"solver": mb.IDA(), "form": None, "model": None, "label": None, "scene": None}),
    "Solver.solve": Call(lambda: mb.RadauIIA(3).solve, lambda: SOLVE, INTEGRATE),
    "Solver.at_accuracy": Call(lambda: mb.IDA().at_accuracy, lambda: {"accuracy": 1e-6, "form_label": "GGL"}),
    "Stepped.at_accuracy": Call(lambda: mb.HHT().at_accuracy, lambda: {"accuracy": 1e-6, "form_label": "GGL"}),
    "DAE": Call(lambda: mb.DAE, lambda: {
        "residual": residual, "y0": [1.0, 2.0, 3.0], "yp0": [-1.0, -2.0, -3.0], "jacobian": jacobian, "index": 1,
        "names": ["a", "b", "c"], "t0": 0.0, "scale": 1.0, "sparsity": None, "guards": guards, "guard_names": ["gap"],
        "switches": _parts(), "partition": None, "rhs": None}),
    "DAE.simulate": Call(lambda: dae().simulate, lambda: {
        "t_end": 0.1, "accuracy": 1e-6, "solver": mb.IDA(), "outputs": 3, "max_wall": 60.0, "progress": None},
        "mbdae.run.own_equations.OwnRun"),
    "Switches": Call(lambda: mb.Switches, lambda: {"arguments": tell, "kinds": ("kink",), "weights": [1.0], "names": ("a",)}),
    "Scene.check": Call(lambda: scene().check, lambda: {"accuracy": 1e-6}, "mbdae.api.check_scene"),
    "Scene.system": Call(lambda: scene().system, lambda: {"form": None, "start": None}, "mbdae.api.system_for"),
    "Scene.draw": Call(lambda: scene().draw, lambda: FILE | {"hide": (), "ax": None}, "mbdae.show.drawing.draw"),
    "Scene.equilibrium": Call(lambda: scene().equilibrium, lambda: {"frame": None, "progress": tell, "out_of_plane": False},
                              "mbdae.analysis.equilibrium.Statics"),
    "Scene.linearize": Call(lambda: scene().linearize,
                            lambda: {"at": hanging(), "frame": None, "count": None, "out_of_plane": False},
                            "mbdae.analysis.linearization.complete_system"),
    "Scene.floquet": Call(lambda: scene().floquet, lambda: {"period": 1.0, "at": hanging(), "count": 1, "accuracy": 1e-6},
                          "mbdae.analysis.multipliers.prepare"),
    "Scene.periodic": Call(lambda: scene().periodic,
                           lambda: {"period": 1.0, "accuracy": 1e-6, "start": None, "of": ["hinge.angle"]},
                           "mbdae.analysis.periodic._Search"),
    "Scene.continuation": Call(lambda: scene().continuation,
                               lambda: {"name": "rod.mass", "over": (0.5, 2.0), "of": hanging(), "steps": 3},
                               "mbdae.analysis.continuation._branch"),
    "Scene.simulate": Call(lambda: scene().simulate, lambda: {
        "t_end": 0.1, "accuracy": 1e-6, "solver": mb.IDA(), "form": None, "outputs": 3, "start": None, "verify": False,
        "max_wall": 60.0, "progress": None, "checkpoint": None, "every": None, "until": None, "record": None,
        "derivatives": False, "of": ["hinge.angle"]}, "mbdae.api.Job"),
    "Scene.stepper": Call(lambda: scene().stepper, lambda: {
        "dt": 0.01, "accuracy": 1e-6, "solver": mb.IDA(), "form": None, "inputs": ["hinge.damper"], "reads": ["hinge.angle"],
        "batch": None, "start": None},
        "mbdae.api.Stepper"),
    "Stepper.set": Call(lambda: stepper().set, lambda: {"values": {"hinge.damper": 0.5}}),
    "Stepper.advance": Call(lambda: stepper().advance, lambda: {"dt": 0.01}, "mbdae.run.batch.States.to"),
    "Stepper.reset": Call(lambda: stepper().reset, lambda: {"state": None, "values": {"hinge.angle": 0.1}}),
    "Stepper.result": Call(lambda: stepper().result, lambda: {"i": 0}),
    "Stepper.__getitem__": Call(lambda: stepper().__getitem__, lambda: {"path": "hinge.angle"}),
    "SceneData.replace": Call(lambda: scene().replace, lambda: {"names": "hinge", "model": mb.Recursive()}),
    "audit": Call(lambda: mb.audit, lambda: {
        "source": "claims:\nA: 3 = rows\n", "laws": None, "counts": None, "quantities": None, "meanings": None}),
    "arena": Call(lambda: mb.arena, lambda: {
        "scenes": [(scene(), 0.1)], "engines": None, "accuracies": [1e-3], "runs": [mb.IDA()], "count": 1, "seed": 0,
        "workers": 1, **RUNS}, "mbdae.arena._compared"),
    "compare": Call(lambda: mb.compare, lambda: {
        "scene": scene(), "t_end": 0.1, "runs": [mb.IDA()], "accuracies": [1e-3], "measure": "hinge.angle",
        "reference": None, **RUNS, "engines": None, "of": ["hinge.force"], "start": None}, "mbdae.compare.identity"),
    "extremes": Call(lambda: mb.extremes, lambda: {
        "scene": scene(), "t_end": 0.1, "vary": {"rod.mass": [1.0]}, "runs": [mb.IDA()], "accuracy": 1e-3,
        "measure": "hinge.angle", **RUNS, "budget": 60.0}, "mbdae.extremes._Execution"),
    "export": Call(lambda: mb.export, lambda: {"what": mb.FixedOrientation, "format": "sympy", "form": None, "frames": None}),
    "Export.save": Call(lambda: mb.export(mb.FixedOrientation).save, lambda: {"path": folder() / "a.py"}),
    "Export.__getitem__": Call(lambda: mb.export(mb.FixedOrientation, "sympy").__getitem__, lambda: {"name": "G"}),
    "report": Call(lambda: mb.report, lambda: {"what": mb.FixedOrientation, "level": "lecture"}),
    "selftest": Call(lambda: mb.selftest, lambda: {"law": mb.FixedOrientation}, "mbdae.contracts._of_law"),
    "sweep": Call(lambda: mb.sweep, lambda: {
        "job": job, "grid": {"a": [1.0]}, "executor": None, "workers": 1, "resume": None, "again": False, "progress": None,
        "t_end": None, "accuracy": 1e-6, "outputs": None, "of": None, "derivatives": None, "start": None},
        "mbdae.sweep.with_processes"),
    "Solution.__call__": Call(lambda: result().solution, lambda: {"t": 0.1}),
    "Solution.derivative": Call(lambda: result().solution.derivative, lambda: {"t": 0.1}),
    "Result.__call__": Call(lambda: result().__call__, lambda: {"t": 0.1}),
    "Result.__getitem__": Call(lambda: result().__getitem__, lambda: {"name": "hinge"}),
    "Result.read": Call(lambda: result().read, lambda: {"path": "hinge.angle"}),
    "RunStates.states": Call(lambda: result().states, lambda: {"t": [0.1]}),
    "RunStates.stresses": Call(lambda: result().stresses, lambda: {"t": [0.1]}),
    "Result.state_for": Call(lambda: result().state_for, lambda: {"scene": scene(), "t": 0.1}),
    "Result.plot": Call(lambda: result().plot, lambda: {"sensors": "hinge.angle", **PICTURE}, "mbdae.show.plots.dress"),
    "Result.phase": Call(lambda: result().phase, lambda: {"x": "hinge.angle", "y": "hinge.rate", **PICTURE}),
    "Result.orbit": Call(lambda: result().orbit, lambda: {"place": "rod", "axes": "xy", **PICTURE}),
    "Result.animate": Call(lambda: result().animate, lambda: {
        "path": folder() / "a.html", "sensors": (), "fps": 30.0, "speed": None, "trail": None, "hide": ()},
        "mbdae.show.animation.filmed"),
    "Result.save": Call(lambda: result().save, lambda: {"path": folder() / "a.npz"}, "mbdae.results.archive.write"),
    "Equilibrium.__call__": Call(lambda: hanging().__call__, lambda: {"t": 0.1}),
    "Equilibrium.states": Call(lambda: hanging().states, lambda: {"t": [0.1]}),
    "Equilibrium.save": Call(lambda: hanging().save, lambda: {"path": "a.npz"}),
    "Linearization.shares": Call(lambda: linear().shares, lambda: {"vector": [1.0, 0.0, 0.0]}),
    "Floquet.shares": Call(lambda: floquet().shares, lambda: {"vector": [1.0, 0.0, 0.0]}),
    "Mode.__getitem__": Call(lambda: linear().modes[0].__getitem__, lambda: {"body": "rod"}),
    "ComparisonData.cheapest": Call(lambda: comparison().cheapest, lambda: {"accuracy": 1e-3}),
    "ComparisonData.table": Call(lambda: comparison().table, lambda: {"all_columns": False}),
    "Study.to_json": Call(lambda: comparison().to_json, lambda: FILE, "mbdae.study.write_file"),
    "Study.to_html": Call(lambda: Extremes("a", 1.0, 1e-3, None, "", (), 0.0).to_html, lambda: FILE,
                          "mbdae.study.write_file"),
    "Comparison.plot": Call(lambda: comparison().plot, lambda: FILE | {"ax": None}, "mbdae.compare.page._line"),
    "Block.at": Call(lambda: _block().at, lambda: {"label": "a", "value": 1.0}),
    "Sweep.array": Call(lambda: _sweep().array, lambda: {"key": "b"}),
    "Sweep.to_json": Call(lambda: _sweep().to_json, lambda: FILE, "mbdae.study.write_file"),
    "Audit.__getitem__": Call(lambda: mb.Audit("none", ()).__getitem__, lambda: {"number": "1"}),
    "Audit.to_json": Call(lambda: mb.Audit("none", ()).to_json, lambda: FILE, "mbdae.study.write_file"),
    "Audit.save": Call(lambda: mb.Audit("none", ()).save, lambda: {"path": folder() / "a.md"},
                       "mbdae.documents.write_file"),
    **{f"Document.{name}": Call(lambda name=name: getattr(Document("none"), name), lambda: FILE, "mbdae.documents.write_file")  # type: ignore[misc]
       for name in ("to_html", "to_markdown", "to_latex")},
    "Document.fragments": Call(lambda: Document("none").fragments, lambda: {"folder": folder(), "name": None}),
    "Document.save": Call(lambda: Document("none").save, lambda: {"path": folder() / "a.md"},
                          "mbdae.documents.write_file"),
}

FLAGS = {"a truth value", "numpy's"}
TEXT = {"text", "digits as text"}
LISTS = {"a list", "a nested list", "a range", "an array", "one entry", "a matrix"}
ANY = "any text may be a name"
#: (callable, option) -> hostile values that are legitimate there, and why
LEGITIMATE: dict[tuple[str, str], tuple[set[str], str]] = {
    ("Scene.continuation", "over"): ({"a list"}, "two numbers"),
    ("Scene.stepper", "inputs"): ({"a tuple of text"}, "names"),
    ("Scene.stepper", "reads"): ({"a tuple of text"}, "names"),
    **{(c, "atol"): ({"a list", "one entry", "a matrix"}, "one number per unknown")
       for c in ("IDA", "CVODE", "DOP853", "RadauIIA")},
    **{(c, "waves"): (FLAGS, "a switch") for c in ("GGL", "Index1", "Index3", "ODE")},
    ("GGL", "algebraic"): (FLAGS, "a switch"), ("ODE", "mixed"): (FLAGS, "a switch"), ("sweep", "again"): (FLAGS, "a switch"),
    **{(f"Scene.{name}", "out_of_plane"): (FLAGS, "a switch") for name in ("equilibrium", "linearize")},
    **{("Scene.simulate", o): (FLAGS, why) for o, why in (("verify", "a switch"), ("derivatives", "a switch"))},
    ("Scene.simulate", "progress"): (FLAGS, "a bar, or none"),
    ("DAE.simulate", "progress"): (FLAGS, "a bar, or none"),
    ("audit", "quantities"): ({"a dict"}, "quantities that are numbers"),
    ("Index1", "baumgarte"): ({"a list"}, "a pair"), ("compare", "reference"): ({"a lambda"}, "a function of time"),
    ("compare", "max_wall"): ({"none"}, "no bound"), ("extremes", "max_wall"): ({"none"}, "no bound"),
    ("arena", "max_wall"): ({"none"}, "no bound"),
    ("ComparisonData.table", "all_columns"): (FLAGS, "a switch"),
    ("Switches", "weights"): ({"one entry"}, "one per argument"),
    ("Run", "label"): (TEXT, ANY),
    ("Solver.at_accuracy", "form_label"): (TEXT, ANY), ("Stepped.at_accuracy", "form_label"): (TEXT, ANY),
    ("Block.at", "label"): (TEXT, ANY),
    ("sweep", "job"): ({"a class", "a function"}, "what can be called"),
    **{(c, "path"): (TEXT, "a file may have any ending") for c in (
        "Result.save", "State.save", "Study.to_json", "Study.to_html", "Sweep.to_json", "Audit.to_json",
        "Document.to_html", "Document.to_markdown", "Document.to_latex")},
    **{(c, "hide"): ({*TEXT, "a tuple of text"}, "names, looked for where the picture is made") for c in (
        "Scene.draw", "Result.animate")},
    ("Scene.simulate", "checkpoint"): (TEXT, "a folder may have any name"),
    **{("Document.fragments", o): (TEXT, "a folder and its files may have any name") for o in ("folder", "name")},
    **{(c, "resume"): (TEXT, "a file may have any ending") for c in ("arena", "compare", "extremes", "sweep")},
    ("Equilibrium.__call__", "t"): (LISTS, "rest goes on for ever"), ("Equilibrium.states", "t"): (LISTS, "the same"),
    **{(c, "vector"): ({"a range"}, "three numbers") for c in ("Linearization.shares", "Floquet.shares")},
}
NUMBERS = {"zero", "minus one", "numpy's minus one", "a half", "much"}
#: values of `hostile.SIGNS` -> options that take them
SIZES: list[tuple[set[str], str]] = [
    ({"a half", "much"},
     "IDA.atol CVODE.atol DOP853.atol RadauIIA.atol RadauIIA.step GeneralizedAlpha.step HHT.step OneStep.step "
     "Solver.solve.t_end Solver.solve.max_wall measure_order.t_end "
     "Solver.solve.h0 Solver.solve.max_residuals DAE.scale Scene.floquet.period Scene.periodic.period Scene.simulate.t_end "
     "Scene.simulate.max_wall DAE.simulate.t_end DAE.simulate.max_wall arena.max_wall compare.t_end compare.max_wall "
     "extremes.t_end extremes.max_wall extremes.budget Result.animate.speed "
     "ComparisonData.cheapest.accuracy Scene.stepper.dt Stepper.advance.dt"),
    ({"zero", "a half"}, "GeneralizedAlpha.rho Solution.__call__.t Solution.derivative.t Result.__call__.t RunStates.states.t "
                         "RunStates.stresses.t Result.state_for.t"),
    ({"zero", "a half", "much"}, "Index1.baumgarte"),
    ({"a half"}, "Solver.solve.share Solver.at_accuracy.accuracy Stepped.at_accuracy.accuracy GeneralizedAlpha.accuracy "
                 "HHT.accuracy OneStep.accuracy Result.animate.fps"),
    ({"zero", "much"}, "arena.seed"), ({"much"}, "arena.count arena.workers"),
    ({"zero"}, "HHT.alpha Stepper.result.i"),
    ({"much"}, "Scene.linearize.count Scene.floquet.count Scene.continuation.steps"),
    (NUMBERS, "Solver.solve.begin DAE.t0 Equilibrium.__call__.t Equilibrium.states.t Block.at.value"),
]


def legitimate(name: str, option: str) -> set[str]:
    """Hostile values that an option takes."""
    sizes: set[str] = set().union(*(values for values, takers in SIZES if f"{name}.{option}" in takers.split()))
    taken = sizes | LEGITIMATE.get((name, option), (set(), ""))[0]
    return taken | ({"a matrix"} if "a nested list" in taken else set())  # of one row and column


#: (callable, option) -> values that are refused in other words, and what those name
OTHERWISE: dict[tuple[str, str], tuple[set[str], str]] = {
    ("Switches", "weights"): ({"a list", "a nested list", "a matrix", "a range", *NUMBERS}, "the numbers of each"),
    ("DAE", "y0"): ({"a list", "one entry", "a range"}, "yp0, which no longer fits"),
    ("DAE", "yp0"): ({"a range"}, "the equation that the start does not satisfy"),
    **{(f"Stepper.{name}", "values"): ({"a dict"}, "the entry") for name in ("set", "reset")},
    ("audit", "laws"): ({"a dict"}, "the entry"), ("extremes", "vary"): ({"a dict"}, "the entry"),
    ("sweep", "grid"): ({"a dict", "a generator"}, "the entry"),
    ("Result.animate", "sensors"): ({"a tuple of text"}, "the entry"),
    ("Result.animate", "trail"): ({"a tuple of text"}, "the entry"),
    ("measure_order", "exact"): ({"a function", "a lambda"}, "what the function does"),
    ("compare", "reference"): ({"a function"}, "the error of the function itself"),
}
