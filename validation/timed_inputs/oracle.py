"""The reference: equations of motion by hand, integrated by SciPy piece by piece between the breaks of the inputs."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from timed_inputs.inputs import Input, numeric

Array = NDArray[np.float64]
States = tuple[list[Array], Array]  #: at the output times, and the last one
RTOL, ATOL = 1e-12, 1e-14
CHUNK = 40  #: steps made at once near a feature that is narrow in space


class Truth:
    """One input on one piece: its value, rate and second derivative at a time."""

    def __init__(self, e: Any) -> None:
        self.e = e

    def __call__(self, at: float) -> float:
        return numeric(self.e)(at)

    def rate(self, at: float) -> float:
        """First derivative."""
        return numeric(self.e, 1)(at)

    def second(self, at: float) -> float:
        """Second derivative."""
        return numeric(self.e, 2)(at)


@dataclass
class Problem:
    """A scene as mbdae gets it, and its equations by hand.

    build: expressions of the inputs -> scene. rhs(t, y, u): y' with the inputs u (Truth). read(t, y, u): sensors by name.
    constrained: joints are equations beside those of motion. clear(y): time (s) before which nothing local in space can be
    reached, 0 inside; there the reference takes steps of at most `largest_step`.
    """

    name: str
    build: Callable[[list[Any]], Any]
    inputs: list[Input]
    t_end: float
    start: Array
    rhs: Callable[[float, Array, list[Truth]], Any]
    read: Callable[[float, Array, list[Truth]], dict[str, Any]]
    constrained: bool = False
    clear: Callable[[Array], float] | None = None
    largest_step: float = np.inf  #: of the reference, s
    rtol: float = RTOL
    tightest: float = 1e-8  #: accuracy its reference can judge
    narrow: float = 1.0  #: width of a feature that is narrow in space, relative to the path
    kind: str = ""  #: of its inputs or of its law
    positions_only: bool = False  #: whether the accuracy covers positions alone: beams, contact

    @property
    def width(self) -> float:
        """Width of the narrowest feature, relative to the length of the run or of the path."""
        return min((i.width / self.t_end for i in self.inputs), default=self.narrow)


def segments(problem: Problem) -> list[tuple[float, float, float]]:
    """(from, to, largest step) between all breaks and edges of narrow features."""
    T = problem.t_end
    fine = [piece for i in problem.inputs for piece in i.fine]
    edges = {0.0, T, *(b for i in problem.inputs for b in i.breaks), *(e for piece in fine for e in piece[:2])}
    inside = sorted(e for e in edges if 0 <= e <= T)
    kept = [inside[0]]
    for e in inside[1:]:
        if e - kept[-1] > 4e-16 * max(1.0, T):
            kept.append(e)
    found = []
    for a, b in itertools.pairwise(kept):
        steps = [step for low, high, step in fine if low < (a + b) / 2 < high]
        found.append((a, b, min([problem.largest_step, *steps])))
    return found


def instants(problem: Problem, uniform: int = 201, inner: int = 7, most: int = 150) -> Array:
    """Times at which results are judged: equally spaced ones, and some inside every piece and narrow feature."""
    pieces = segments(problem)
    narrow = sorted(pieces, key=lambda s: s[1] - s[0])[:most]
    own = [np.linspace(a, b, inner) for a, b, _ in narrow]
    centres = [np.linspace((a + b) / 2 - 3 * step * 4, (a + b) / 2 + 3 * step * 4, 13)
               for i in problem.inputs for a, b, step in i.fine if b - a < problem.t_end]
    times = np.unique(np.concatenate([np.linspace(0, problem.t_end, uniform), *own, *centres]))
    return times[(times >= 0) & (times <= problem.t_end)]


def solve(problem: Problem, times: Array) -> dict[str, Array]:
    """Sensors at times (nt,), which include the start and the end: (nt,) or (nt, ...) by name."""
    y, rows = np.array(problem.start, dtype=float), []
    for a, b, step in segments(problem):
        u = [Truth(i.piece((a + b) / 2)) for i in problem.inputs]
        wanted = times[(times >= a) & (times < b)]
        states, y = _piece(problem, a, b, step, u, y, wanted)
        rows += [problem.read(float(at), state, u) for at, state in zip(wanted, states, strict=True)]
    rows += [problem.read(problem.t_end, y, u) for _ in times[times >= problem.t_end]]
    return {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}


def _piece(problem: Problem, a: float, b: float, step: float, u: list[Truth], y: Array, wanted: Array) -> States:
    """States at the wanted times of one smooth piece, and at its end; it is divided where something local in space comes near."""
    if not len(y):
        return [y] * len(wanted), y
    if problem.clear is None:
        return _integrated(problem, a, b, step, u, y, wanted)
    states: list[Array] = []
    while a < b:
        free, near = problem.clear(y), CHUNK * step
        end = min(b, a + max(free, near))
        inside = wanted[(wanted >= a) & (wanted < end)]
        more, y = _integrated(problem, a, end, np.inf if free > near else step, u, y, inside)
        states, a = states + more, end
    return states, y


def _integrated(problem: Problem, a: float, b: float, step: float, u: list[Truth], y: Array, wanted: Array) -> States:
    """The same by one call of SciPy."""

    def rates(t: float, y: Array) -> Array:
        found = np.asarray(problem.rhs(t, y, u), dtype=float)
        if not np.isfinite(found).all():  # SciPy would try ever shorter steps without end
            raise ArithmeticError(f"the equations of {problem.name} are not finite at t = {t:.6g} s")
        return found

    found = solve_ivp(rates, (a, b), y, "DOP853", dense_output=True, rtol=problem.rtol, atol=ATOL,
                      max_step=step)
    if not found.success:
        raise ArithmeticError(f"the reference of {problem.name} failed: {found.message}")
    return [found.sol(at) for at in wanted], found.y[:, -1]
