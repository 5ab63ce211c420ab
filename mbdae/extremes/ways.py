"""The ways in which a scene is run: joint model x form x solver, and the choice that mbdae makes by itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from mbdae.compare.problem import Problem
from mbdae.compare.run import Run, checked_runs
from mbdae.formulations.named import form_words
from mbdae.integrators.named import solvers
from mbdae.scene.components import Classical, JointModel, Recursive

CHOICE = "chosen by mbdae"


@dataclass(frozen=True)
class Way:
    """A way to run a scene: a stated run; or, where `run` is None, the form and solver that mbdae chooses by itself, and also its
    choice of joint models where `models` is None too."""

    label: str
    run: Run | None
    models: Run | None = None  #: where `run` is None, a run whose joint models are used with mbdae's choice of form and solver

    def with_step(self, h: float) -> Run | None:
        """The run at a constant step h (s); None where its solver has no such option."""
        if self.run is None or not hasattr(self.run.solver, "step"):
            return None
        return replace(self.run, solver=replace(self.run.solver, step=h))  # type: ignore[type-var]


def shipped_runs(free: bool, step: float | None = None) -> Iterator[Run]:
    """The solvers and forms of the package in pairs that say something of their own; free: of scenes without constraints; step:
    those with a constant step (s), not in forms whose joints drift.

    A form whose joints drift is run by the last of the `mapped` variants of a method alone, and the methods of low order, which
    reach an accuracy by shorter constant steps, in the first form alone."""
    taken = [form for form in form_words().values() if bool(form.spec().blocks) is not free]
    for form in taken:
        drifts = form.spec().drifts
        for made in solvers():
            for solver in made.mapped()[-1 if drifts else 0 :]:
                if not form.within(solver.highest_index):
                    continue
                if step is None and (form is taken[0] or not solver.by_steps):
                    yield Run(solver, form)
                elif step is not None and not drifts and hasattr(solver, "step"):
                    yield Run(replace(solver, step=step), form)  # type: ignore[type-var]


def ways(problem: Problem, runs: Sequence[Run] | None) -> list[Way]:
    """The given runs, or all that apply to the scene, followed by mbdae's own choice."""
    if runs is not None:
        chosen = checked_runs(runs)
        return [Way(_label(run), run) for run in chosen] + [Way(CHOICE, None)]
    found: list[Way] = []
    for name, models, free in _models(problem):
        listed = [replace(run, model=models) for run in shipped_runs(free)]
        listed = [replace(run, label=" ".join([_label(replace(run, model=None)), name]).strip()) for run in listed]
        found += [Way(_label(run), run) for run in listed if not (models and run.solver.by_steps)]
        found.append(Way(f"{CHOICE} {name}".strip(), None, listed[0] if models else None))
    return found


def _models(problem: Problem) -> list[tuple[str, JointModel | dict[str, JointModel] | None, bool]]:
    """Name, joint models, and whether they give an ODE: first as stated, then others. Joints with clearance are not changed."""
    joints = [c for c in problem.scene.joints if c.has_models] if problem.scene is not None else []
    ideal = [c for c in joints if not c.loose]
    if len(ideal) == len(joints):
        others = problem.other_models.items()
        return [("", None, not problem.constrained), *((type(m).__name__, m, free) for m, free in others)]
    loose: tuple[JointModel, ...] = (Classical(), Recursive()) if ideal else ()
    return [("", None, not problem.constrained), *((type(m).__name__, {c.name: m for c in ideal}, False) for m in loose)]


def stepped_ways(problem: Problem, h: float) -> list[Way]:
    """Runs with the constant step h (s), one for every method that has such a step."""
    return [Way(_label(replace(run, solver=replace(run.solver, step=None))), run)  # type: ignore[type-var]
            for run in shipped_runs(not problem.constrained, h)]  # fmt: skip


def _label(run: Run) -> str:
    return run.name(run.form.label if run.form is not None else "")
