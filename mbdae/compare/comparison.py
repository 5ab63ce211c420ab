"""Joint models x solvers x forms x accuracies on one scene: error, CPU time and evaluations of each run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from mbdae.compare.checkpoint import Checkpoint
from mbdae.compare.data import ComparisonData
from mbdae.compare.execution import Execution
from mbdae.compare.identity import identity
from mbdae.compare.page import page
from mbdae.compare.pairwise import pairwise
from mbdae.compare.picture import work_precision
from mbdae.compare.problem import new_problem
from mbdae.compare.reference import given_reference, refuse_no_reference
from mbdae.compare.rows import with_front
from mbdae.compare.run import Run, checked_runs, default_runs, progress_of_runs
from mbdae.compare.split import Split
from mbdae.compare.table import table
from mbdae.display import picture, plain, titled
from mbdae.errors import OptionError, naming_arguments
from mbdae.integrators.base import Solver
from mbdae.notation import counted
from mbdae.run.environment import environment
from mbdae.show.plots import checked
from mbdae.sweep.resume import resume_path
from mbdae.sweep.writing import written
from mbdae.values import number, option, sequence, several, shown

ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6)
MAX_WALL = 60.0  #: default of the largest wall time of a run, s


class Comparison(ComparisonData):
    """A comparison of solvers, made by `mb.compare`, with its table, picture and page."""

    def to_html(self, path: Any = None) -> str:
        """One self-contained HTML page with picture, tables and verdict, also written to `path` where one is given."""
        return written(lambda: page(self), path)

    def table(self) -> str:
        """The rows as plain text, with reference, failures, pairwise differences and verdict."""
        return table(self)

    def plot(self, path: Any = None) -> Any:
        """Error over CPU time and over residual evaluations, as a matplotlib figure, saved where `path` (.png, .svg, .pdf)
        is given; OptionError for a path that cannot be used."""
        return work_precision(self, checked(path, what="compare") if path is not None else None)

    def __repr__(self) -> str:
        return f"<Comparison of '{self.scene}': {counted(len(self.runs), 'run')}; print it for the table>"

    def _repr_html_(self) -> str:
        return titled(f"comparison of '{self.scene}'", picture(self.plot()._repr_png_()), plain(self.table()))

    def __str__(self) -> str:
        return self.table()


@naming_arguments
def compare(scene: Any, t_end: float, runs: Sequence[Run | Solver | type[Solver] | str] | None = None,
            accuracies: Sequence[float] = ACCURACIES, measure: str | None = None, reference: Any = None,
            max_wall: float | None = MAX_WALL,
            progress: Callable[[int, int, str], None] | None = None, resume: Any = None) -> Comparison:  # fmt: skip
    """Run a scene (or a System) to t_end (s) with every run at every accuracy; returns a `Comparison`.

    runs: list of mb.Run, or of solvers (objects, classes, names); default IDA and Radau. measure: a sensor such as "C.angle";
    default the motion of the bodies. reference: a Result, or a function of the times (nt,) that returns the measure; default a
    tight Radau run that a second method confirms. max_wall: largest wall time of a run, s. progress(done, total, label): called
    before every run.
    resume: a JSON file that stores every finished run; runs that it holds already are not repeated.
    """
    begin = time.process_time()
    asked = _checked_accuracies(accuracies)
    own, tell = checked_runs(runs) if runs is not None else None, progress_of_runs(progress)
    resume = resume_path(resume)
    refuse_no_reference(reference)
    problem = new_problem(scene, t_end, measure, max_wall)
    chosen = own or default_runs(problem.constrained, problem.stated.given, problem.other_models, problem.resolving)
    given = given_reference(problem, reference) if reference is not None else None
    kept = Checkpoint(resume, identity(problem, chosen, asked, given[1] if given else None))
    state = kept.load()
    if given is not None:
        state.reference, state.reference_values = given
    queue = [(run, a) for run in chosen for a in ([None] if run.as_it_is else asked)]
    smallest = min([*asked, *(a for run in chosen if (a := run.own_accuracy(problem.system(None).label)) is not None)])
    Execution(problem, Split(problem), queue, smallest, state, kept, begin).do(tell)
    assert state.reference is not None
    differences = pairwise(list(state.tightest_runs.values()), problem.error)
    rows = with_front(state.rows, state.reference.difference or 0.0)
    return Comparison(problem.name, problem.t_end, measure, problem.what, state.reference, asked, rows,
                      differences, state.cpu_s, state.total_cpu_s, environment())  # fmt: skip


def _checked_accuracies(accuracies: Any) -> tuple[float, ...]:
    given = accuracies if several(accuracies) else [accuracies]
    remedy = "give numbers from 1e-12 to 0.1, such as [1e-3, 1e-6]"
    values = option("accuracies", given, sequence, remedy, each=number, least=1e-12, most=1e-1)
    if not values:
        raise OptionError(f"accuracies = {shown(accuracies)} is empty: {remedy}")
    return tuple(sorted(set(values), reverse=True))
