"""What a run left out between the points at which its solver looked at the equations of motion.

A solver asks for the residual at a few points of a step; a load that acts between them is never seen, and neither an error
estimate nor a companion run shows it. Here the residual of the dense output, its defect, is taken at further, seeded random
points inside the accepted steps. A defect alone is no error: between its nodes a good polynomial has one too, whose integral
vanishes. So the defect is integrated from the start of its step, and what the motion would have been moved by it,
J^-1 (integral / step) with the iteration matrix J = dF/dy + dF/dy' / step, is measured against the accuracy. Steps in which that
is more are integrated again, closely (`recheck`), and only what that shows is told.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial import legendre
from scipy.sparse.linalg import splu

from mbdae.errors import SolverError
from mbdae.integrators.solution import Solution
from mbdae.integrators.sundials import as_csc
from mbdae.run.control import distance
from mbdae.run.hiding import can_hide
from mbdae.system.assembly import SceneSystem
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared

SEED = 20240229
POINTS = 12  #: points in every step of a scene in which something may act for a short time: a tenth of the step is then hit
ALONG = 400  #: points along the whole run of such a scene, so that steps which are long compared with it get more
JITTER = 0.5  #: part of its share of the step in which a point is random; 1 would leave gaps of twice that share
SHARE = 0.03  #: points of all other scenes over the residual evaluations of the run
SINGLE = 2 / 3  #: part of them that are single points; the others are left for steps that are looked at closely
FEWEST, MOST = 4, 400  #: single points
OUTSTANDING = 30.0  #: defect of a single point over the median of all at which its step is looked at closely
DEGREE = 5  #: of the polynomial that is integrated exactly; what is left by the trapezoidal rule
AT_ONCE, LARGEST = 64, 30000  #: points evaluated in one call, and unknowns of all of them
SAMPLES = 20  #: steps of the run whose speeds belong to the unit of velocities
FELT = 0.1  #: defect over the largest of its step where it is felt
ALIKE = 10.0  #: with constant steps: effect over the median of all steps that is no more than their usual error


@dataclass(frozen=True)
class Suspect:
    """A step in which the equations contradict the run.

    step: its number; effect: how far the motion would be moved (as `motion_distance`); times (k,): where it was looked at;
    felt (k,) bool: where the equations contradict; equation: the one that does most; allowed: effect of a step that is."""

    step: int
    effect: float
    times: Array
    felt: Any
    equation: str
    allowed: float = 0.0


class Defect:
    """The defect of one run; evaluations: of the residual so far."""

    def __init__(self, prepared: Prepared, system: SceneSystem, run: Solution) -> None:
        self.prepared, self.system, self.run = prepared, system, run
        self.random, self.evaluations = np.random.default_rng(SEED), 0
        self._patterns: dict[int, Array] = {}
        self._integrals: dict[int, Array] = {}
        self._algebraic = np.array([kind in ("lambda", "mu", "z") for kind in system.kinds])
        self.sample = run.t[:: len(run.t) // SAMPLES + 1]

    def suspects(self, limit: float, alike: bool) -> list[Suspect]:
        """Steps whose defect moves the motion by more than the limit, worst first; alike: and by more than constant steps do
        elsewhere."""
        steps = range(len(self.run.t) - 1) if can_hide(self.prepared) else self._outstanding(limit)
        found = self._effects([(i, self._inside(POINTS + int(ALONG * self._share(i)))) for i in steps])
        if alike and found:
            limit = max(limit, ALIKE * float(np.median([s.effect for s in found])))
        return sorted((replace(s, allowed=limit) for s in found if s.effect > limit), key=lambda s: -s.effect)

    def _share(self, i: int) -> float:
        """Length of a step over that of the run."""
        t = self.run.t
        return float((t[i + 1] - t[i]) / (t[-1] - t[0]))

    def _inside(self, count: int) -> Array:
        """So many points of (0, 1), one in the middle of every share, moved at random; the same in all steps."""
        if count not in self._patterns:
            self._patterns[count] = (np.arange(count) + 0.5 + JITTER * (self.random.random(count) - 0.5)) / count
        return self._patterns[count]

    def _outstanding(self, limit: float) -> list[int]:
        """Steps in which a single point stands out, of a scene in which hardly anything can hide: half of the points are spread
        over the time, where steps are long, half over the steps."""
        t, budget = self.run.t, SHARE * self.run.stats.residuals
        count = min(int(budget * SINGLE), MOST)
        along = self._inside(count // 2) * (t[-1] - t[0]) + t[0]
        places = self._inside(count - count // 2) * (len(t) - 1)
        times = np.concatenate([along, np.interp(places, np.arange(len(t)), t)])
        steps = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
        y, yp = self.run(times), self.run.derivative(times)
        F = np.abs(self._residual(times, y, yp)) * np.diff(t)[steps, None]
        if count < FEWEST:
            return []
        ratio = np.max(F / (np.median(F, axis=0) + np.finfo(float).tiny), axis=1)
        worst = [k for k in np.argsort(-ratio)[: max(1, int(budget * (1 - SINGLE)) // POINTS)] if ratio[k] > OUTSTANDING]
        points = [(int(steps[k]), (times[k : k + 1] - t[steps[k]]) / np.diff(t)[steps[k]]) for k in worst]
        return sorted({s.step for s in self._effects(points) if s.effect > limit})

    def _effects(self, looked_at: list[tuple[int, Array]]) -> list[Suspect]:
        """Effect of the defect in steps looked at in points of (0, 1)."""
        if not looked_at:
            return []
        t = self.run.t
        times = np.concatenate([t[i] + inside * (t[i + 1] - t[i]) for i, inside in looked_at])
        y, yp = self.run(times), self.run.derivative(times)
        ends = np.cumsum([len(inside) for _, inside in looked_at])[:-1]
        F, Y, Yp, T = (np.split(a, ends) for a in (self._residual(times, y, yp), y, yp, times))
        moved = [self._moved(*place, *of_step) for place, *of_step in zip(looked_at, F, Y, Yp, strict=True)]
        effects = np.split(self._distance(times, y, y + np.concatenate(moved)), ends)
        return [self._suspect(i, *parts) for (i, _), *parts in zip(looked_at, effects, T, F, strict=True)]

    def _suspect(self, i: int, effect: Array, times: Array, F: Array) -> Suspect:
        """What is said of one step."""
        size = np.abs(F)
        row = int(np.argmax(np.max(size, axis=0)))
        return Suspect(i, float(np.max(effect)), times, size[:, row] > FELT * np.max(size[:, row]), self.system.equations[row])

    def _residual(self, times: Array, y: Array, yp: Array) -> Array:
        """F (k, n) at points of the dense output; 0 where it is not defined."""
        out, n = np.zeros_like(y), self.system.n
        size = 1 if self.system.pattern is None else int(np.clip(LARGEST // n, 4, AT_ONCE))
        part = np.empty((size, n))
        for first in range(0, len(times), size):
            at = np.minimum(np.arange(first, first + size), len(times) - 1)
            try:
                self.system.residual_stages(times[at], y[at], yp[at], part)
            except SolverError:
                continue
            out[first : first + size] = part[: len(times) - first]
        self.evaluations += len(times)
        return np.nan_to_num(out)

    def _moved(self, i: int, inside: Array, F: Array, y: Array, yp: Array) -> Array:
        """What the unknowns (k, n) are moved by until every point."""
        h = float(self.run.t[i + 1] - self.run.t[i])
        if len(inside) not in self._integrals:
            self._integrals[len(inside)] = integrals(inside)
        right = self._integrals[len(inside)] @ F
        right[:, self._algebraic] = F[:, self._algebraic]  # rows without derivatives hold at every point
        if self.system.pattern is None:  # y' = f, eliminated multipliers, chosen where nothing is stiff
            return -h * right
        k = len(inside) // 2
        J = np.zeros((self.system.n,) * 2 if self.system.sparsity is None else self.system.sparsity.nnz)
        self.system.jacobian(float(self.run.t[i] + inside[k] * h), y[k], yp[k], 1 / h, J)
        try:
            if self.system.sparsity is None:
                return -np.linalg.solve(J, right.T).T
            return -splu(as_csc(self.system, J)).solve(np.ascontiguousarray(right.T)).T
        except (np.linalg.LinAlgError, RuntimeError):  # singular: the motion is not determined there, which others tell
            return np.zeros_like(right)

    def _distance(self, times: Array, a: Array, b: Array) -> Array:
        """(k,) distance of two motions, in units of the whole run."""
        here = self.run(self.sample)
        t = np.concatenate([times, self.sample])
        return distance(self.prepared, t, np.concatenate([b, here]), np.concatenate([a, here]))[: len(times)]


def integrals(inside: Array) -> Array:
    """(k, k) weights: from values at points of (0, 1) their integrals from 0 to the next point, of the last one to 1.

    A polynomial fitted to the values is integrated exactly, what it leaves of them by the trapezoidal rule."""
    degree = min(DEGREE, len(inside) // 2)
    basis = legendre.legvander(2 * inside - 1, degree)
    fit = np.linalg.pinv(basis)
    to = np.append(inside[1:], 1.0)
    smooth = legendre.legval(2 * to - 1, legendre.legint(np.eye(degree + 1), lbnd=-1)).T / 2
    nodes, between = np.concatenate([[0.0], inside, [1.0]]), np.eye(len(inside) + 2)[1:-1]
    rough = np.cumsum(np.diff(nodes)[:, None] * (between.T[1:] + between.T[:-1]) / 2, axis=0)[1:]
    return np.asarray(smooth @ fit + rough @ (np.eye(len(inside)) - basis @ fit))
