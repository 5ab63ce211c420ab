"""The defect of a run: the residual of the equations of motion between the points at which its solver evaluated them.

A solver evaluates the residual at a few points of a step; it misses a load that acts between them, and neither an error estimate
nor a companion run shows that. Here the residual of the dense output, its defect, is evaluated at further, seeded random points
inside the accepted steps. A defect alone is no error: between its nodes an accurate polynomial has one too, but its integral
vanishes. So the defect is integrated from the start of its step, and its effect is the resulting change of the motion,
J^-1 (integral / step) with the iteration matrix J = dF/dy + dF/dy' / step. Steps whose effect is above the accuracy are suspects;
`recheck` integrates them again with short steps, and warns where the motion differs.
All steps are examined where something may act for a time, or over a distance, short compared with a step: a short event.

Forces of contacts and force elements may be far stiffer than the motion, so that they miss the accuracy that it has: a run is
repeated for them.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from random import Random
from typing import Any

import numpy as np
import symengine as se
from numpy.polynomial import legendre

from mbdae.deferred import distinct, median
from mbdae.errors import AccuracyWarning, SolverError
from mbdae.inputs.timed import TIME
from mbdae.integrators.base import Asked
from mbdae.integrators.matrices import IterationMatrix
from mbdae.integrators.solution import Solution, systems_at
from mbdae.kernels.plan import plan
from mbdae.native.sparse import SingularMatrixError
from mbdae.results.clearance import AtTimes
from mbdae.results.errors import Errors
from mbdae.run.contacts import hidden_contacts
from mbdae.run.control import Search
from mbdae.run.estimate import FALL, Controlled, companions, cpu_of, with_rtol
from mbdae.run.growing import growing, is_explicit, unseen
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.outputs import loads, position
from mbdae.system.assembled.right_hand_side import state_rate_outputs
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.system.sampling import MotionRows, motion_distance
from mbdae.system.scene_system import SceneSystem
from mbdae.values import largest

SEED = 20240229
#: number of points in every step examined, so that an event lasting a tenth of it is almost always hit (an eighth: always)
POINTS = 12
#: most further points in all steps examined together, shared in proportion to the lengths of the steps; for scenes with possible
#: short events, whose steps are all examined
ALONG = 400
JITTER = 0.5  #: fraction of its interval in which a point is placed at random; with 1, two points could be two intervals apart
#: in scenes without possible short events: largest ratio of the number of points to the residual evaluations of the run
SHARE = 0.03
#: fraction of the points by SHARE that are spread singly over the run; the others examine steps whose defect stands out
SINGLE = 2 / 3
#: smallest and largest number of single points; where SHARE allows fewer than the smallest, no step is examined
FEWEST, MOST = 4, 400
#: ratio of the defect at a single point, times the length of its step, to the median of all single points, above which its step
#: stands out
OUTSTANDING = 30.0
#: largest degree of the polynomial, fitted to the defect in a step, that is integrated exactly; the remainder by trapezoids
DEGREE = 5
#: BLOCK: number of neighbouring steps for which one iteration matrix J is used; DOUBTFUL: ratio of the effect to its limit above
#: which a step gets a J of its own
BLOCK, DOUBTFUL = 8, 0.25
LARGE = 0.1  #: a defect of at least this fraction of the largest in its step is large: `recheck` ends a short step at that point
#: with constant steps a step is suspect if its effect is above ALIKE times the quantile QUARTER of the effects of all steps
ALIKE, QUARTER = 30.0, 0.25
#: bounds of memory: at most AT_ONCE points in one call, and, if these are more than 4, at most LARGEST unknowns at all of them
#: together; about STORED values of unknowns at a time
AT_ONCE, LARGEST, STORED = 64, 30000, 2_000_000
SAMPLES = 20  #: largest number of steps of the run whose speeds determine the unit of velocities


@dataclass(frozen=True)
class Suspect:
    """A step in which the equations contradict the run.

    step: its number; effect: change of the motion (as `motion_distance`); times (k,), s: where the defect was evaluated;
    large (k,) bool: at which of them it is large; equation: name of the equation with the largest defect; allowed: largest effect
    of a step that is not suspect."""

    step: int
    effect: float
    times: Array
    large: Any
    equation: str
    allowed: float = 0.0


class Defect:
    """The defect of one run; evaluations: number of residual evaluations so far.

    rough: whether only what remains of the defect after the fit of a polynomial (DEGREE) over a step counts; used for constant
    steps, whose smooth error no tolerance controls."""

    def __init__(self, prepared: Prepared, system: SceneSystem, run: Solution, rough: bool = False) -> None:
        self.prepared, self.system, self.run, self.rough = prepared, system, run, rough
        self.random, self.evaluations, self.widths = Random(SEED), 0, np.diff(run.t)
        self._matrix: IterationMatrix | None = None
        self._algebraic = np.array([kind in ("lambda", "mu", "z") for kind in system.kinds])

    def suspects(self, limit: float) -> list[Suspect]:
        """Steps in which the effect of the defect is above the limit, worst first; of constant steps only those whose effect is
        also far above that of most steps."""
        steps = np.arange(len(self.widths)) if may_have_short_events(self.prepared, self.system) else self._outstanding(limit)
        found = [s for part in self._parts(steps) for s in self._effects(*part, limit)]
        if self.rough and found:
            limit = max(limit, ALIKE * float(np.quantile([s.effect for s in found], QUARTER, method="lower")))
        return sorted((replace(s, allowed=limit) for s in found if s.effect > limit), key=lambda s: -s.effect)

    def _parts(self, steps: Any) -> Iterator[tuple[Any, Array]]:
        """Groups of steps, as large as memory allows, each with the fractions of a step at which the defect is evaluated."""
        counts = POINTS + (ALONG * self.widths[steps] / np.sum(self.widths)).astype(int)
        for count in distinct(counts):
            inside, alike = self._inside(int(count)), steps[counts == count]
            size = max(BLOCK, STORED // (count * self.system.n))
            for first in range(0, len(alike), size):
                yield alike[first : first + size], inside

    def _inside(self, count: int) -> Array:
        """Fractions of a step, one in each of `count` equal intervals of (0, 1), shifted at random inside it."""
        by = np.array([self.random.random() for _ in range(count)])
        return (np.arange(count) + 0.5 + JITTER * (by - 0.5)) / count

    def _outstanding(self, limit: float) -> Any:
        """Numbers of the steps in which the defect at a single point is far larger than elsewhere (OUTSTANDING) and its effect is
        above the limit; for scenes without possible short events. Half of the points are spread evenly over time, so that long
        steps get more, the other half evenly over the steps."""
        t, budget = self.run.t, SHARE * self.run.stats.residuals
        count = min(int(budget * SINGLE), MOST)
        if count < FEWEST:
            return np.zeros(0, dtype=int)
        along = self._inside(count // 2) * (t[-1] - t[0]) + t[0]
        places = self._inside(count - count // 2) * (len(t) - 1)
        times = np.concatenate([along, np.interp(places, np.arange(len(t)), t)])
        steps = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
        F = np.abs(self._residual(times)[0]) * self.widths[steps, None]
        ratio = np.max(F / (median(F, axis=0) + np.finfo(float).tiny), axis=1)
        most = max(1, int(budget * (1 - SINGLE)) // POINTS)
        worst = [k for k in np.argsort(-ratio, kind="stable")[:most] if ratio[k] > OUTSTANDING]
        inside = (times - t[steps]) / self.widths[steps]
        return distinct([steps[k] for k in worst for s in self._effects(steps[k : k + 1], inside[k : k + 1], limit)
                          if s.effect > limit]).astype(int)

    def _residual(self, times: Array) -> tuple[Array, Array, Array]:
        """F, y, y' (k, n) at points of the dense output; F is set to 0 where it is not defined."""
        y, yp, n = self.run(times), self.run.derivative(times), self.system.n
        out, size = np.zeros_like(y), 1 if not self.system.has_pattern else int(np.clip(LARGEST // n, 4, AT_ONCE))
        part = np.empty((size, n))
        for first in range(0, len(times), size):
            at = np.minimum(np.arange(first, first + size), len(times) - 1)
            systems = systems_at(self.run, times[at], self.system)
            for system in dict.fromkeys(systems):
                try:
                    system.residual_stages(times[at], y[at], yp[at], part)
                except SolverError:
                    continue
                own = np.array([other is system for other in systems])
                out[at[own]] = part[own]
        self.evaluations += len(times)
        return np.nan_to_num(out), y, yp

    def _effects(self, steps: Any, inside: Array, limit: float) -> list[Suspect]:
        """Steps (m,) as suspects, with the effect of the defect, from its values at fractions `inside` (m, k) or (k,) of each."""
        times = self.run.t[steps, None] + inside * self.widths[steps, None]
        F, y, yp = (a.reshape(*times.shape, -1) for a in self._residual(times.ravel()))
        smooth, rest = integrals(inside)
        right = (rest if self.rough else smooth + rest) @ F
        # rows without derivatives must hold at every point: their defect itself counts, not its integral
        if not self.rough or len(inside) == 1:
            right[..., self._algebraic] = F[..., self._algebraic]
        moved = np.empty_like(y)
        for first in range(0, len(steps), BLOCK):
            some = np.arange(first, min(first + BLOCK, len(steps)))
            longest = some[np.argmax(self.widths[steps[some]])]
            share = self.widths[steps[some]] / self.widths[steps[longest]]
            moved[some] = self._moved(int(steps[longest]), times[longest], y[longest], yp[longest],
                                      share[:, None, None] * right[some])
        effect = self._distance(times, y, moved)
        doubtful = np.flatnonzero(effect > DOUBTFUL * limit)
        for i in doubtful:
            moved[i] = self._moved(int(steps[i]), times[i], y[i], yp[i], right[i : i + 1])[0]
        if len(doubtful):
            effect[doubtful] = self._distance(times[doubtful], y[doubtful], moved[doubtful])
        worst = [largest(np.max(np.abs(part), axis=0)) for part in F]
        size = [np.abs(part[:, row]) for part, row in zip(F, worst, strict=True)]
        return [Suspect(int(steps[i]), float(effect[i]), times[i], size[i] >= LARGE * np.max(size[i]), self.system.equations[row])
                for i, row in enumerate(worst)]

    def _moved(self, step: int, times: Array, y: Array, yp: Array, given: Array) -> Array:
        """Change of the unknowns -J^-1 given (m, k, n), with the iteration matrix J in the middle of step number `step`. times
        (k,), y, yp (k, n): points in this step; given (m, k, n): mean defect up to each point of m steps."""
        k, h = len(times) // 2, float(self.widths[step])
        system = systems_at(self.run, times[k : k + 1], self.system)[0]
        # y' = f with eliminated multipliers is used only where nothing is stiff, so that J is close to the unit matrix over h
        if not system.has_pattern and system.rhs is not None:
            return -h * given
        right = given.reshape(-1, system.n)
        try:
            if system.sparse:
                matrix = self._matrix_of(system)
                matrix.refresh(float(times[k]), y[k], yp[k])
                matrix.factor(h)
                moved = matrix.solved(right)
            else:
                J = np.zeros(system.jacobian_shape)
                system.jacobian(float(times[k]), y[k], yp[k], 1 / h, J)
                moved = np.asarray(np.linalg.solve(J, right.T).T)
        # a singular J: the motion is not determined there, and `singular_positions` warns about it
        except (np.linalg.LinAlgError, SingularMatrixError):
            return np.zeros_like(given)
        return -moved.reshape(given.shape)

    def _matrix_of(self, system: System) -> IterationMatrix:
        """The iteration matrix of a system; its pattern and order of elimination are used for all steps with the same system."""
        if self._matrix is None or self._matrix.system is not system:
            self._matrix = IterationMatrix(system, np.ones(1), np.zeros(0, complex))
        return self._matrix

    def _distance(self, times: Array, y: Array, moved: Array) -> Array:
        """Largest distance (m,), in every step, between the motion y (m, k, n) at times (m, k) and that changed by `moved`."""
        t, before, after = times.ravel(), y.reshape(-1, self.system.n), (y + moved).reshape(-1, self.system.n)
        motions = self.prepared.states(t, after)[:2], self.prepared.states(t, before)[:2]
        return np.asarray(np.max(apart(self.prepared, self.run, *motions).reshape(times.shape), axis=1))


def apart(prepared: Prepared, run: Solution, a: MotionRows, b: MotionRows) -> Array:
    """`motion_distance` (k,) of two motions a and b in some steps of a run; differences of velocities are relative to the speeds
    of the whole run."""
    some = run.t[:: len(run.t) // SAMPLES + 1]
    here = prepared.states(some, run(some))[:2]
    q_a, u_a, q_b, u_b = (np.concatenate(pair) for pair in zip((*a, *b), (*here, *here), strict=True))
    return motion_distance(prepared, (q_a, u_a), (q_b, u_b))[: len(a[0])]


def integrals(inside: Array) -> tuple[Array, Array]:
    """Two matrices (k, k) that turn values at k points of (0, 1) into integrals from 0 to the next point (for the last point, to
    1). The sum of both is the integral: the first integrates a polynomial fitted to the values, exactly; the second the
    remainder, by the trapezoidal rule."""
    degree = min(DEGREE, len(inside) // 2)
    basis = legendre.legvander(2 * inside - 1, degree)
    fit, to, one = np.linalg.pinv(basis), np.append(inside[1:], 1.0), np.eye(len(inside))
    smooth = legendre.legval(2 * to - 1, legendre.legint(np.eye(degree + 1), lbnd=-1)).T / 2
    nodes, between = np.concatenate([[0.0], inside, [1.0]]), np.pad(one, ((1, 1), (0, 0)))
    rough = np.cumsum(np.diff(nodes)[:, None] * (between[1:] + between[:-1]) / 2, axis=0)[1:]
    return np.asarray(smooth @ fit), np.asarray(rough @ (one - basis @ fit))


#: outputs of laws whose expressions are searched for steep functions: forces, constraint rows, rates of internal states
STATED = (loads, position, state_rate_outputs)
#: functions that are not steep: those of angles, which are in nearly every law; UnevaluatedExpr only marks a bracket
OF_ROTATIONS = ("sin", "cos", "UnevaluatedExpr")


def may_have_short_events(prepared: Prepared, system: SceneSystem) -> bool:
    """Whether a scene has inputs of time that do not bound the steps (other than constant, uniform and uniformly accelerated
    ones), or laws with functions that switch or are steep somewhere (other than contacts, whose gaps solvers watch)."""
    return _inputs(prepared, system) or _laws(prepared)


def _inputs(prepared: Prepared, system: SceneSystem) -> bool:
    if system.timeline is not None:
        return False  # no step is longer than the time scale of an input, and steps end at all breaks
    inputs = prepared.mechanics.numbering.clock.expressions
    return any(se.diff(se.diff(se.diff(se.sympify(e), TIME), TIME), TIME) != 0 for e in inputs)


def _laws(prepared: Prepared) -> bool:
    watched = {contact.place[0] for contact in prepared.contacts}
    return any(_switches(group.derived) for g, group in enumerate(prepared.model.groups) if g not in watched)


@lru_cache(maxsize=512)
def _switches(derived: Derived) -> bool:
    """Whether a law contains a steep function."""
    return bool(derived.noted("short_events.steep", lambda: any(
        _steep(e) for outputs in STATED for e in _subexpressions(plan(derived, outputs).kernel.expressions))))


def _subexpressions(expressions: Sequence[Any]) -> Iterator[Any]:
    """Every subexpression that is not a symbol or a number, once."""
    left, seen = [se.sympify(e) for e in expressions], set()
    while left:
        e = left.pop()
        if e.args and e not in seen:
            seen.add(e)
            left.extend(e.args)
            yield e


def _steep(e: Any) -> bool:
    """Whether a subexpression may be steep: a function other than sine and cosine, a power with a symbol in the exponent
    (symengine's exp is a power of e), or a negative power of a sum with a constant, such as 1 / (1 + x^2). Powers
    of distances are not steep in this sense."""
    if isinstance(e, se.Function):
        return type(e).__name__ not in OF_ROTATIONS
    if not isinstance(e, se.Pow):
        return False
    base, exponent = e.args
    falls = exponent.is_Integer and exponent.is_negative and base.is_Add
    return bool(exponent.free_symbols or (falls and any(term.is_Number for term in base.args)))


#: a run is repeated for forces down from an accuracy of TIGHT, where a tolerance with which AIMED of the accuracy is expected
#: takes at most WORTH times its work, which rises with POWERS of the inverse of the tolerance, of implicit and explicit methods;
#: at most DEARER times is spent: companions far looser than the run show its forces up to 50 times too far off
TIGHT, AIMED, WORTH, DEARER, POWERS = 1e-5, 0.5, 3.3, 2.0, (0.2, 0.125)


def with_stiff_forces(run: Controlled, system: SceneSystem, prepared: Prepared, accuracy: float, asked: Asked,
                      times: Array) -> Controlled:
    """The run; where its forces miss a tight accuracy that the motion has, one with a smaller tolerance, if theirs is better.
    Where growth bounds its steps, or vibrations are left out, forces miss it for other reasons."""
    solver, stiff = run.solver, prepared.contacts or any(not c.is_joint for c in prepared.model.scene.connections)
    if accuracy > TIGHT or not stiff or not run.others or unseen(run.growth) or run.vibrations:
        return run
    off, before = Errors(prepared, run.solution, run.others, accuracy)(), run.others[-1]
    if off <= accuracy or isinstance(before.run.interpolant, AtTimes):
        return run
    least, power = solver.companion if prepared.contacts else companions(system, solver)[0], POWERS[is_explicit(run.solution)]
    needed = max((off / (AIMED * accuracy)) ** (1 / FALL), least)
    closer = min(needed, DEARER ** (1 / power))
    rtol, dearer = solver.tolerance / closer, closer**power
    if needed**power > WORTH or closer < least or rtol < run.limit:
        return run
    known = [(before.ratio * solver.tolerance, before.run), (solver.tolerance, run.solution)][-1 - bool(prepared.contacts) :]
    most = replace(asked, max_residuals=int(2 * dearer * run.solution.stats.residuals))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)
            made = Search(system, prepared, with_rtol(solver, None), accuracy, most, times, False, known=(known, rtol)).run()
    except SolverError as error:
        return run.after(1, cpu_of(error))
    better = made.estimate <= accuracy and made.others and Errors(prepared, made.solution, made.others, accuracy)() < off
    if not better or hidden_contacts(system, made.solution, 0.0):
        return run.after(made.runs, made.cpu_s)
    return replace(made, growth=tuple(growing(system, made.solution)), notes=run.notes).after(run.runs, run.cpu_s)
