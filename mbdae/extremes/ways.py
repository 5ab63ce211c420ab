"""The ways in which a scene is run: joint model x form x solver, and the choice that mbdae makes by itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from mbdae.compare.problem import Problem
from mbdae.compare.run import Run, checked_runs
from mbdae.formulations import GGL, ODE, Index1, Index3
from mbdae.integrators.alpha.generalized_alpha import HHT, GeneralizedAlpha
from mbdae.integrators.runge_kutta.dop853 import DOP853
from mbdae.integrators.runge_kutta.radau import RadauIIA
from mbdae.integrators.sundials.cvode import CVODE
from mbdae.integrators.sundials.ida import IDA
from mbdae.scene.components import Classical, JointModel, Recursive

#: runs of scenes with constraints; a new form or solver of the package needs a line here
CONSTRAINED = (
    Run(IDA(), GGL()),
    Run(RadauIIA(2), GGL()), Run(RadauIIA(3), GGL()),
    Run(RadauIIA(2), Index3()), Run(RadauIIA(3), Index3()),
    Run(IDA(), Index1()), Run(CVODE(), Index1()), Run(DOP853(), Index1()), Run(RadauIIA(3), Index1()),
    Run(GeneralizedAlpha(), GGL()), Run(HHT(), GGL()),
)  # fmt: skip
FREE = (
    Run(IDA(), ODE()), Run(CVODE(), ODE()), Run(DOP853(), ODE()),
    Run(RadauIIA(2), ODE()), Run(RadauIIA(3), ODE()),
    Run(GeneralizedAlpha(), ODE()), Run(HHT(), ODE()),
)  # fmt: skip
#: methods of low order: run only with the joint models that the scene states, not with others
LOW_ORDER = (GeneralizedAlpha, HHT)
#: runs with a constant step (s)
STEPPED: tuple[Callable[[float], Run], ...] = (
    lambda h: Run(RadauIIA(2, step=h), GGL()), lambda h: Run(RadauIIA(3, step=h), GGL()),
    lambda h: Run(RadauIIA(2, step=h), Index3()), lambda h: Run(RadauIIA(3, step=h), Index3()),
    lambda h: Run(GeneralizedAlpha(step=h), GGL()), lambda h: Run(HHT(step=h), GGL()),
    lambda h: Run(GeneralizedAlpha(step=h), Index3()), lambda h: Run(HHT(step=h), Index3()),
)  # fmt: skip
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


def ways(problem: Problem, runs: Sequence[Run] | None) -> list[Way]:
    """The given runs, or all that apply to the scene, followed by mbdae's own choice."""
    if runs is not None:
        chosen = checked_runs(runs)
        return [Way(_label(run), run) for run in chosen] + [Way(CHOICE, None)]
    found: list[Way] = []
    for name, models, free in _models(problem):
        listed = [replace(run, model=models) for run in (FREE if free else CONSTRAINED)]
        listed = [replace(run, label=" ".join([_label(replace(run, model=None)), name]).strip()) for run in listed]
        found += [Way(_label(run), run) for run in listed if not (models and isinstance(run.solver, LOW_ORDER))]
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
    """Runs with the constant step h (s), one for every method that has such a step; in the form ODE without constraints."""
    found: list[Way] = []
    for make in STEPPED:
        run = make(h)
        if not problem.constrained:
            run = replace(run, form=ODE())
        way = Way(_label(replace(run, solver=replace(run.solver, step=None))), run)  # type: ignore[type-var]
        if way.label not in [w.label for w in found]:
            found.append(way)
    return found


def _label(run: Run) -> str:
    return run.name(run.form.label if run.form is not None else "")
