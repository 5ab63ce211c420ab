"""The result of equations of a user's own: their unknowns by name, over time, with the error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.errors import ListsAttributes, OptionError, unknown_name
from mbdae.integrators.solution import Solution, Stats
from mbdae.notation import counted
from mbdae.results.accuracy import Accuracy
from mbdae.results.run_info import RunInfo
from mbdae.system.base import Array
from mbdae.values import option, shown, text

EQUATIONS = "how far the equations themselves differ from the real system cannot be estimated by a solver"


@dataclass(frozen=True, repr=False)
class UnknownsAccuracy(Accuracy):
    """The largest error of a run of equations of a user's own, as far as it is known.

    asked, estimated: error of every unknown, multipliers too, over the largest value of that unknown in the run, or over 1e-3 of
    its `scale` where that is more; the largest over the time. `covers` is {"unknowns"} where it is within the accuracy asked."""

    worst: str = ""  #: name of the unknown with the largest estimated error

    @property
    def not_covered(self) -> dict[str, str]:
        """"unknowns" with the size of the error, or the reason why it is not known, where it is not within the accuracy asked;
        and "model", whose error no run can measure."""
        return super().not_covered | {"model": EQUATIONS}

    @property
    def _errors(self) -> dict[str, float | None]:
        return {"unknowns": self.motion}


class Unknowns(ListsAttributes):
    """The unknowns of own equations over time: `r["x"]` (nt,) by name, `r.y` (nt, n) all, at the times `r.t` (nt,), s;
    `r(t)` the result at other times.

    solution: the run with its steps; info: how it was made."""

    def __init__(self, solution: Solution, info: RunInfo, t: Array) -> None:
        self.solution, self.info, self.t = solution, info, t
        self.y: Array = solution(t)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, in the order of y."""
        return self.solution.names

    @property
    def accuracy(self) -> Accuracy:
        """Accuracy asked and estimated, and whether the run covers it."""
        return self.info.accuracy

    @property
    def stats(self) -> Stats:
        """Steps, evaluations and CPU time of the run returned."""
        return self.info.stats

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before trusting the result, one sentence per warning."""
        return self.info.warnings

    @property
    def complete(self) -> bool:
        """False where the run was stopped before its end."""
        return self.solution.complete

    @property
    def reliable(self) -> bool | None:
        """True where the run is complete, its error is estimated and within the accuracy asked, and nothing speaks against it;
        None where its error is not known, as after a run with a tolerance or a step of its own; else False."""
        return self.accuracy.met if self.info.reliable and self.complete else False

    def __getitem__(self, name: str) -> Array:
        wanted = option("name", name, text, f"name an unknown: {', '.join(self.names)}")
        if wanted not in self.names:
            raise OptionError(f"there is no unknown {unknown_name(wanted, self.names)} the names are {', '.join(self.names)}")
        return np.asarray(self.y[:, self.names.index(wanted)])

    def __call__(self, t: float | Sequence[float] | Array) -> Unknowns:
        """The same run at other times t (s), by its dense output; OptionError for times outside of the run."""
        times = np.atleast_1d(self.solution.times(t))
        if times.ndim > 1:
            raise OptionError(f"t = {shown(t)} has shape {times.shape}: give a time of the run in s, or a list of them")
        return Unknowns(self.solution, self.info, times)

    def __repr__(self) -> str:
        a, s, info = self.accuracy, self.stats, self.info
        known = f"{a.estimated:.1e}" if a.estimated is not None else "unknown"
        asked = f"{a.asked:g}" if a.asked is not None else "none"
        warned = (", not reliable" if self.reliable is False else "") + (
            f", {counted(len(self.warnings), 'warning')}" if self.warnings else "")  # fmt: skip
        return (f"<Unknowns {', '.join(self.names)}: t = {self.t[0]:g}..{self.t[-1]:g} s, {info.solver.label}, "
                f"{counted(s.steps, 'step')}, {info.cpu_s:.2f} s CPU, accuracy asked {asked}, estimated error {known}, "
                f"{a.brief}{warned}>")


class UnknownsDistance:
    """The distance of two trajectories (nt, n) of own equations: over time the largest difference of an unknown, over its largest
    value in the second one or, where that is more, over LEAST times its scale. worst: index of the unknown that was farthest
    apart at the last call."""

    def __init__(self, scale: Array) -> None:
        self._least, self.worst = LEAST * np.asarray(scale, dtype=float), 0

    def __call__(self, t: Any, a: Array, b: Array) -> Array:
        apart = np.abs(a - b) / np.maximum(np.max(np.abs(b), axis=0), self._least)
        self.worst = int(np.argmax(np.max(apart, axis=0)))
        return np.asarray(np.max(apart, axis=1))


LEAST = 1e-3  #: errors are relative to the largest value of an unknown in the run, but at least to this fraction of its scale
