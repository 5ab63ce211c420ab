"""How much small disturbances grow over a run: the linearised equations, carried along its steps.

In every step E x' + A x = 0, with E = dF/dy' and A = dF/dy, is solved by one step of Radau IIA(3) for some disturbances at once;
with many unknowns E and A are those in the middle of the step. Steps in which positions change much are divided. `growing` sees
to it that the steps of a run follow what grows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from mbdae.integrators.collocation_tables import radau_table
from mbdae.integrators.matrices import IterationMatrix, as_csc
from mbdae.integrators.solution import Solution, systems_at
from mbdae.native.sparse import SingularMatrixError
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.threads import single_threaded
from mbdae.values import largest

ROUNDED = 1e-16  #: relative round-off of a coordinate
#: words are said where round-off, as it grows over the run, may make more than this fraction of the accuracy asked
DECIDES = 1.0
LEAST = 10.0  #: growth with frozen coefficients below which round-off decides nothing that can be asked
SMALL = 60  #: largest number of unknowns for which all stages of a step are solved together
COPIES = 2  #: number of disturbances, drawn at random, that are carried along
MOST = 50_000  #: largest number of steps along which disturbances are carried
SLACK = 3.0  #: growth (natural logarithm) beyond that asked for after which it is not carried on
TINY = 1e-300
VANISHED = 1e-150  #: size of a disturbance, after a step from size 1, below which nothing is left of it: no motion is free
TURNED, PARTS = 0.1, 16  #: largest change of a position in one part of a step, and largest number of parts
PLACES = 50  #: number of times at which the largest coordinate is sought


class Disturbances:
    """Small disturbances of a run of a system, as they grow along its steps."""

    def __init__(self, system: System, run: Solution) -> None:
        self._system, self._run = system, run
        self._matrix: IterationMatrix | None = None
        kinds = np.array(system.kinds)
        self._fast = kinds == "v"
        self._slow = ~np.isin(kinds, ("v", "lambda", "mu", "z"))
        self._kept = ~np.isin(kinds, ("lambda", "mu"))  # multipliers follow from the others

    def growth(self, enough: float = math.inf) -> tuple[float, float] | None:
        """(natural logarithm of the largest factor by which a disturbance grows from one time of the run to a later one, time of
        the largest, s). It ends early where the logarithm exceeds `enough`. None where `course` is None."""
        course = self.course(enough)
        if course is None:
            return None
        t, size = course
        rises = size - np.minimum.accumulate(size)
        i = largest(rises)
        return float(rises[i]), float(t[i])

    @single_threaded
    def course(self, enough: float = math.inf) -> tuple[Array, Array] | None:
        """Times (k,), s, at the ends of steps, and there the natural logarithm of the size (k,) of the disturbances that grow
        most. Velocities are measured in units in which they are as large as the positions in the median, so that a vibration
        rises by nothing. None where an impact leaves it unknown, equations are singular, or there are more than MOST steps."""
        run = self._run
        if run.stats.contacts or len(run.t) < 2 or len(run.t) > MOST:
            return None
        x = spread((COPIES, self._system.n)) * self._system.scale
        ends = self._divided()
        middle, h = (ends[1:] + ends[:-1]) / 2, np.diff(ends)
        states = run(middle), run.derivative(middle)
        sizes: list[tuple[float, float]] = []
        size = least = 0.0
        for i, system in enumerate(systems_at(run, middle, self._system)):
            try:
                if system.n <= SMALL:
                    x = self._exactly(system, float(ends[i]), float(h[i]), x)
                else:
                    x = self._carried(system, float(middle[i]), states[0][i], states[1][i], float(h[i]), x)
            except (SingularMatrixError, np.linalg.LinAlgError):
                return None
            scaled = x / self._system.scale
            both = [float(np.linalg.norm(scaled[:, kind])) for kind in (self._slow, self._fast)]
            now = math.hypot(*both)
            if not (math.isfinite(now) and now > VANISHED):
                return None
            sizes.append((size + math.log(max(both[0], TINY)), size + math.log(max(both[1], TINY))))
            size, x = size + math.log(now), np.where(self._kept, x, 0.0) / now
            least = min(least, size) if i else size
            if size - least > enough + SLACK:
                break
        slow, fast = np.array(sizes).T
        return ends[1 : 1 + len(slow)], np.logaddexp(2 * slow, 2 * (fast + np.median(slow - fast))) / 2

    def _divided(self) -> Array:
        """Times (s) between which the equations count as frozen: the steps of the run, divided where positions change by more
        than TURNED (over their scales) in one."""
        run, here = self._run, np.array(self._system.kinds) == "q"
        y = run.y[:, here] / self._system.scale[here]
        moved = np.max(np.abs(np.diff(y, axis=0)), axis=1, initial=0.0)
        count = np.clip(np.ceil(moved / TURNED), 1, PARTS).astype(int)
        parts = [np.linspace(a, b, k + 1)[1:] for a, b, k in zip(run.t[:-1], run.t[1:], count, strict=True)]
        return np.concatenate([run.t[:1], *parts])

    def _exactly(self, system: System, t: float, h: float, x: Array) -> Array:
        """As `_carried` from a time t (s), with the equations at all stages of Radau IIA(3): where a motion passes an unstable
        rest several times, what grew there fades before the next, which frozen equations do not reproduce."""
        table, n = radau_table(3), system.n
        times = t + table.c * h
        y, yp = self._run(np.minimum(times, self._run.t[-1])), self._run.derivative(np.minimum(times, self._run.t[-1]))
        parts = [full_jacobians(system, *one) for one in zip(times, y, yp, strict=True)]
        M = np.block([[h * table.A[i, j] * A + (E if i == j else 0.0) for j in range(3)] for i, (A, E) in enumerate(parts)])
        right = -np.concatenate([A @ x.T for A, _ in parts])
        rates = _solved(M, right, np.tile(system.scale, 3)).reshape(3, n, len(x))
        return np.asarray(x + h * np.einsum("j,jnk->kn", table.b, rates))

    def _carried(self, system: System, t: float, y: Array, yp: Array, h: float, x: Array) -> Array:
        """Disturbances (k, n) at the end of a step h (s), from those at its begin; t, y, yp: time (s) and state in its middle."""
        real, pair, weights = _weights()
        if self._matrix is None or self._matrix.system is not system:
            self._matrix = IterationMatrix(system, real, pair)
        matrix = self._matrix
        matrix.refresh(t, y, yp)
        matrix.factor(h)
        out = np.empty_like(x)
        for k, one in enumerate(x):
            right = matrix.row * matrix.mass(one) / h
            parts = [weight * factors.solve(right) for weight, factors in zip(weights, matrix.factors, strict=True)]
            out[k] = matrix.column * sum(part if part.dtype.kind == "f" else 2 * part.real for part in parts)
        return out


@dataclass(frozen=True, eq=False)
class Amplified:
    """The growth of disturbances over a run (natural logarithm of the factor), None where not known; computed when it is called.
    A copy in another process does not have the equations and returns None."""

    run: Solution

    def __call__(self) -> float | None:
        found = Disturbances(self.run.systems[0][1], self.run).growth() if self.run.systems else None
        return None if found is None else found[0]


def decided_by_round_off(prepared: Prepared | None, run: Solution, frozen: float, accuracy: float) -> list[str]:
    """Words about a run in which small disturbances grow so much that round-off decides digits of the accuracy asked. prepared:
    None for own equations; frozen: the sum of the growth with frozen coefficients; where it is too small for that, the growth
    along the run is not computed."""
    system = run.systems[0][1]
    if frozen < LEAST:
        return []
    enough = math.log(DECIDES * accuracy / (ROUNDED * (1.0 if prepared is None else _farthest(prepared, run))))
    found = Disturbances(system, run).growth(enough) if frozen > enough else None
    if found is None or found[0] < enough:
        return []
    factor = f"e^{found[0]:.0f} (1e{found[0] / math.log(10):.0f})"
    decisive = accuracy * math.exp(-min(found[0], 300.0))
    measure = "the scene's length (or rad)" if prepared is not None else "the scale of an unknown"
    return [f"small disturbances grow by a factor of {factor} up to t = {found[1]:.4g} s: what is below {decisive:.0e} of "
            f"{measure} at the start, round-off too, decides whether an accuracy of {accuracy:g} is kept; a shorter run, or a "
            "start farther from the unstable rest, can be predicted"]


def _farthest(prepared: Prepared, run: Solution) -> float:
    """Largest coordinate of a place of a body in a run over the scene's length, 1 where that is less (angles in rad)."""
    some = run.t[:: len(run.t) // PLACES + 1]
    q = prepared.states(some, run(some))[0]
    places = [np.max(np.abs(q[:, node.q : node.q + node.kind.translations])) for node in prepared.model.nodes
              if node.unit == "m" and node.kind.translations]
    return max(1.0, float(max(places, default=0.0)) / prepared.length)


def spread(shape: tuple[int, int]) -> Array:
    """Numbers from -1 to 1 without any pattern that equations could have, for disturbances in all directions."""
    return np.cos(np.arange(1.0, shape[0] * shape[1] + 1) ** 2 * math.sqrt(2)).reshape(shape)


def full_jacobians(system: System, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
    """dF/dy and dF/dy' (n, n) at a state."""
    parts = system.jacobian_parts(t, y, yp)
    if parts[0].ndim == 2:
        return parts
    return np.asarray(as_csc(system, parts[0]).toarray()), np.asarray(as_csc(system, parts[1]).toarray())


def _solved(M: Array, right: Array, scale: Array) -> Array:
    """The solution (n, k) of M x = right with columns in the scales (n,) of the unknowns and rows of largest entry 1."""
    scaled = M * scale
    size = np.max(np.abs(scaled), axis=1, keepdims=True)
    return np.asarray(np.linalg.solve(scaled / size, right / size) * scale[:, None])


@cache
def _weights() -> tuple[Array, NDArray[np.complex128], tuple[complex, ...]]:
    """The real and the complex eigenvalue m of A^-1 of Radau IIA(3), and the weights w with which one of its steps of h is the
    sum of w (m E / h + A)^-1 E / h, of the complex one twice the real part."""
    table = radau_table(3)
    values, vectors = np.linalg.eig(table.A_inv)
    start = np.linalg.solve(vectors.astype(complex), np.ones(len(values), complex))
    weights = vectors[-1] * values * start
    found = []
    for value in (*table.real, *table.pairs):
        j = int(np.argmin(np.abs(values - value)))
        found.append(weights[j].real if abs(values[j].imag) < 1e-9 else weights[j])
    return table.real, table.pairs, tuple(found)
