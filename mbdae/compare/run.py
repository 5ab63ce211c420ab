"""A run of a comparison: a solver with a form and a joint model; the equations it solves, and the memory it takes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.compare.measures import quartiles
from mbdae.errors import OptionError
from mbdae.formulations import Form, Index1, Index3, default_form, form_of, form_words, system_for
from mbdae.integrators.base import Solver
from mbdae.integrators.named import solver_of, solvers
from mbdae.integrators.solution import Solution
from mbdae.results.accuracy import Accuracy, RunInfo
from mbdae.results.result import Result
from mbdae.scene.components import JointModel
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.values import function, option, optional, sequence, set_option, shown, text

#: options that a label omits, because they have a column of the table or are part of the solver's name
TOLD_ELSEWHERE = ("rtol", "stages", "method")


@dataclass(frozen=True)
class Run:
    """A solver with a form (None: the scene's default) and a joint model (None: as the scene states it).

    model: one joint model for all joints that have models (mb.Recursive(): for a spanning tree of them, as
    `Scene.recursive` chooses it, the rest kinematic), or {name of a joint: its model}. A solver without a tolerance or
    step of its own is run once for every accuracy, one with such a setting once. Solver and form may be given as a class or
    by name, such as mb.IDA, "radau3", "ggl". scene: another scene that models the same mechanism otherwise, with flexible
    links, friction, another section: it is compared as a model, and needs a label. Raises OptionError for anything else."""

    solver: Solver
    form: Form | None = None
    model: JointModel | Mapping[str, JointModel] | None = None
    label: str | None = None
    scene: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "solver", solver_of(self.solver))
        object.__setattr__(self, "form", form_of(self.form) if self.form is not None else None)
        set_option(self, "label", text, "give a text, or None to have it made")
        if self.scene is not None and not (isinstance(self.scene, SceneData) and self.label and self.model is None):
            raise OptionError(f"scene = {shown(self.scene)}: give a mb.Scene with label=, by which its model is called, and "
                              f"without model=")
        if not _is_model(self.model):
            raise OptionError(f"model = {shown(self.model)} is not a joint model: give one such as mb.Kinematic(), "
                              f"{{name of a joint: model}}, or None")

    @property
    def models(self) -> dict[str, JointModel]:
        """Joint model by name of a joint; the name "" stands for all joints."""
        if self.model is None:
            return {}
        return {"": self.model} if isinstance(self.model, JointModel) else dict(self.model)

    @property
    def model_label(self) -> str | None:
        """The joint models in words, or the label of another scene; None where those of the scene are used."""
        if self.scene:
            return self.label
        told = {name: described(m, type(m).__name__) for name, m in self.models.items()}
        return ", ".join(f"{name}: {m}" if name else m for name, m in told.items()) or None

    @property
    def as_it_is(self) -> bool:
        """Whether the solver has a tolerance or step of its own."""
        return self.solver.fixed or self.solver.rtol is not None

    def own_accuracy(self, form_label: str) -> float | None:
        """The accuracy that corresponds to the solver's own tolerance; None where it has none."""
        if self.solver.fixed or self.solver.rtol is None:
            return None
        return self.solver.rtol / self.solver.factor(self.form.label if self.form else form_label)

    def name(self, form_label: str) -> str:
        """Label for tables: the user's, or solver, form, model and every option that differs from its default."""
        own = [described(self.solver, self.solver.label), described(self.form, form_label), self.model_label]
        return (self.label if self.scene is None else None) or " ".join(part for part in own if part)


def _is_model(model: Any) -> bool:
    if isinstance(model, Mapping):
        return bool(model) and all(isinstance(m, JointModel) and isinstance(name, str) for name, m in model.items())
    return model is None or isinstance(model, JointModel)


def described(choice: Any, name: str) -> str:
    """`name` followed by the options of `choice`, a frozen dataclass such as a solver, that differ from their defaults."""
    if choice is None:
        return name
    told = [(f, getattr(choice, f.name)) for f in fields(choice) if f.name not in TOLD_ELSEWHERE]
    changed = [f"{f.name}={value}" for f, value in told if value is not f.default and value != f.default]
    return f"{name}[{', '.join(changed)}]" if changed else name


def default_runs(constrained: bool, system: System | None = None, others: Mapping[JointModel, bool] | None = None,
                 resolving: Form | None = None) -> list[Run]:
    """The runs of a comparison where the user names none: IDA (up to index 1) and Radau IIA; with constraints Radau IIA in index
    3 and 1 too; CVODE and DOP853 where there is a right-hand side.

    others: joint models to compare in addition to those of the scene, each with whether its equations are an ODE. resolving: for
    a scene with beams, the form that resolves their vibrations; BDF and Adams, which take very many steps for them, are left
    out."""
    from mbdae.integrators.dop853 import DOP853
    from mbdae.integrators.radau import RadauIIA
    from mbdae.integrators.sundials import CVODE, IDA

    runs = [Run(IDA()), Run(RadauIIA(2)), Run(RadauIIA(3))]
    if system is not None and int(np.max(system.index)) > 1:
        runs = runs[1:]
    if resolving is not None:
        runs = [*runs[1:], Run(RadauIIA(3), resolving)]
    if constrained:
        runs += [Run(RadauIIA(3), Index3()), Run(RadauIIA(3), Index1())]
    elif resolving is None and (system is None or system.rhs is not None):
        runs += [Run(CVODE()), Run(DOP853())]
    for model, ordinary in (others or {}).items():
        others_too = [IDA(), CVODE(), DOP853()] if ordinary and resolving is None else []
        runs += [Run(solver, model=model) for solver in (RadauIIA(3), *others_too)]
    return runs


CHOICE = "simulate"  #: label of the row that shows what `simulate` does where no solver is named


def is_all(runs: Any) -> bool:
    """Whether every solver and form that admits the scene is asked for."""
    if isinstance(runs, str) and runs != "all":
        raise OptionError(f"runs = {shown(runs)}: give a list of mb.Run, 'all', or None for usual ones")
    return isinstance(runs, str)


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


def checked_runs(runs: Any) -> list[Run]:
    """The runs that a user gave, checked, as a list; a solver becomes a run with the default form."""
    remedy = "give a list of mb.Run, such as [mb.Run(mb.IDA()), mb.Run(mb.RadauIIA(3))]"
    given = option("runs", runs, sequence, remedy, each=lambda run: run)
    if not given:
        raise OptionError(f"runs = {shown(runs)} is empty: give one or more, such as [mb.Run(mb.IDA())], or None for usual ones")
    return [run if isinstance(run, Run) else Run(solver_of(run, f"runs = {shown(runs)}: entry {i}", remedy))
            for i, run in enumerate(given, 1)]


def progress_of_runs(progress: Any) -> Callable[[int, int, str], None]:
    """The function that the user gave to be called before every run; where none is given, one without effect."""
    remedy = "give a function progress(done, total, label), or None"
    given = optional("progress", progress, function, remedy, takes="done, total, label")
    return given or (lambda done, total, label: None)


# -- The equations of a comparison: a scene prepared once per joint model (or a given System), assembled once per form


@dataclass
class Equations:
    """The equations of a comparison: of a prepared scene, with the systems assembled from it by form, or a given System."""

    prepared: Prepared | None
    given: System | None = None
    systems: dict[Form | None, System] = field(default_factory=dict)

    def system(self, form: Form | None) -> System:
        """The equations in a form, assembled and evaluated once, so that the CPU time of runs includes no compilation."""
        if form not in self.systems:
            self.systems[form] = self._assemble(form)
            warm(self.systems[form])
        return self.systems[form]

    def _assemble(self, form: Form | None) -> System:
        if self.prepared is not None:
            return system_for(self.prepared, form)
        assert self.given is not None
        if form is not None:
            raise OptionError(f"form {form.label}: the equations of a System are given, so that a run cannot choose their form; "
                              f"give runs without one, such as mb.Run(mb.IDA())")
        return self.given

    def for_solver(self, form: Form | None, solver: Solver) -> System:
        """The equations in the form, with a lower index where the solver needs it."""
        if self.prepared is None:
            return self.system(form)
        own = form if form is not None else default_form(self.prepared, solver.highest_index)
        return self.system(own.for_index(solver.highest_index))

    def label_of(self, form: Form | None, solver: Solver) -> str:
        """Label of the form that a solver uses; where `form` is None, of the default form for this solver."""
        takes_rates_alone = form is None and not solver.highest_index
        return (self.for_solver(form, solver) if takes_rates_alone else self.system(form)).label

    def result(self, solution: Solution, times: Array) -> Result:
        """The result of a run at times (nt,), s."""
        assert self.prepared is not None
        return Result(self.prepared, solution, RunInfo(solution.solver, "", Accuracy(None, None), solution.stats), times)

    @property
    def recursive(self) -> tuple[int, int]:
        """Number of joints that are recursive, and number of joints that the user asked to be recursive."""
        if self.prepared is None:
            return 0, 0
        model = self.prepared.model
        return len(model.recursive), len(model.recursive) + len(model.stay_kinematic)

    def motion_as_in(self, other: Equations, t: Array, y: Array) -> Array:
        """Positions and velocities (nt, nq + nu) of the bodies from unknowns y (nt, n) at t, in the order of `other`; 0 in
        place of joint coordinates, which not all joint models have."""
        assert self.prepared is not None
        assert other.prepared is not None
        q, u, _ = self.prepared.states(t, y)
        return np.hstack([q, u, np.zeros((len(q), 1))])[:, _columns(self.prepared, other.prepared)]


def _columns(own: Prepared, wanted: Prepared) -> list[int]:
    """Indices, in the unknowns of `own`, of the body unknowns of `wanted`; -1 in place of joint coordinates."""
    twins = {node.body.name: node for node in own.model.nodes if node.body is not None}
    positions: list[int] = []
    velocities: list[int] = []
    for node in wanted.model.nodes:
        if node.body is None:
            positions += [-1] * node.kind.sizes[0]
            velocities += [-1] * node.kind.sizes[1]
            continue
        twin = twins.get(node.body.name)
        if twin is None or twin.kind is not node.kind:
            raise OptionError(f"body '{node.body.name}' is missing in this run or has other unknowns than in the reference: "
                              f"motions cannot be compared; name a sensor to compare by, such as measure='C.angle'")
        positions += range(twin.q, twin.q + node.kind.sizes[0])
        velocities += range(own.mechanics.nq + twin.u, own.mechanics.nq + twin.u + node.kind.sizes[1])
    return positions + velocities


def warm(system: System) -> None:
    """Call every function of a system once, because kernels are compiled and caches filled at the first call."""
    y, yp, out = system.y0, system.yp0, np.empty(system.n)
    shape: Any = system.jacobian_shape
    system.residual(system.t0, y, yp, out)
    system.jacobian(system.t0, y, yp, 1.0, np.zeros(shape))
    system.jacobian_parts(system.t0, y, yp)
    if system.rhs is not None:
        system.rhs(system.t0, y, out)
    for stages in (2, 3):
        t, many = np.full(stages, system.t0), (stages, system.n)
        system.residual_stages(t, np.broadcast_to(y, many).copy(), np.broadcast_to(yp, many).copy(), np.empty(many))


# -- CPU time of a run: repeated until its spread is known

#: a run of this CPU time (s) or more is timed once; shorter ones are repeated for up to REPEATED s, LEAST to MOST times
LONG, REPEATED, LEAST, MOST = 0.2, 0.06, 3, 15
TICKS = 5  #: so many ticks of the clock at least lie in one measurement, for which short runs are repeated within it


@dataclass(frozen=True)
class Timed:
    """A finished run. cpu_s: median of its repeats, s; first_s: of the first one; spread_s: distance of their quartiles and what
    the clock does not resolve, s, None where it was made once; peak_bytes: of the process."""

    solution: Solution
    cpu_s: float
    first_s: float
    spread_s: float | None
    peak_bytes: int | None = None


def timed(solve: Callable[[], Solution], tick: float | None, spend: Callable[[float], None]) -> Timed:
    """Execute a run and measure its CPU time. tick: resolution of the clock, s; None: once. spend: called with CPU times, s."""
    begin = time.process_time()
    try:
        solution = solve()
    finally:
        spend(first := time.process_time() - begin)
    if tick is None or first >= LONG:
        return Timed(solution, first, first, None)
    seconds, within, used = list[float](), 1, first
    while len(seconds) < LEAST or (used < REPEATED and len(seconds) < MOST):
        begin = time.process_time()
        for _ in range(within):
            solve()
        took = time.process_time() - begin
        used += took
        spend(took)
        if took < TICKS * tick and used < REPEATED:  # too short for this clock: repeat it within one measurement
            within *= max(2, math.ceil(TICKS * tick / took)) if took else 8
            continue
        seconds.append(took / within)
        if used > 2 * REPEATED:
            break
    middle, spread = quartiles(seconds)
    return Timed(solution, middle, first, spread + tick / within)


def resolution() -> float:
    """The smallest difference of two times of the clock of CPU time, s."""
    found, begin = list[float](), time.process_time()
    while len(found) < LEAST:
        if (now := time.process_time()) != begin:
            found.append(now - begin)
            begin = now
    return min(found)


# -- Peak memory of the process during a run, where the operating system measures it (Linux)

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def reset_peak() -> bool:
    """Start a new measurement; False where the system does not offer one."""
    try:
        _RESET.write_text("5")  # Linux then measures the peak anew, beginning with the present size of the process
    except OSError:
        return False
    return True


def peak_bytes() -> int | None:
    """Largest resident size of the process since the last `reset_peak`, bytes; None where it is not measured."""
    try:
        lines = _STATUS.read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    kilobytes = next((line.split()[1] for line in lines if line.startswith("VmHWM:")), None)
    return None if kilobytes is None else 1024 * int(kilobytes)
