"""Shooting: Newton's method for the state, and where it is free the period, to which a motion returns.

The exact derivative of one period in Radau steps: with the stages Y_i of a step, F_y dY_i + F_y' sum_j A^-1_ij (dY_j - dy_0) / h
= 0. Its columns are the departures, which the corrections of the start and the multipliers come from.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from mbdae.analysis.orbit import SOLVER, Departures, Indices, Orbit, Return, departures, followed, later, timed_item
from mbdae.analysis.pencil import derivatives
from mbdae.errors import OptionError, SolverError, SteadyError
from mbdae.integrators.solution import Solution
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem

LOOSE = 1e-6  #: rtol of the runs that show the number of steps, and that go on where Newton's method finds no way
ITERATIONS, HALVINGS = 25, 5  #: largest number of corrections with one number of steps, and of halvings of one
#: a correction that is this part of the state's scale is the last; a residual below FOUND counts as none; one below STALLED is
#: taken, because few steps damp a motion without losses, which then returns with more steps alone
LAST, FOUND, STALLED = 1e-6, 1e-12, 1e-3
NOT_FOUND = ("no periodic motion was found from this start: after {:.6g} s the motion is {:.2g} of its size off where it began, "
             "and no change of the start brings it nearer; give a start nearer to it, start=(result, t)")
#: singular values of the corrections' matrix below this, over the largest, count as 0: of families of periodic motions the next
#: one is taken
SINGULAR = 1e-8
TOGETHER = 32  #: number of steps whose dense equations are solved in one call
SHRINKS = 0.9  #: part of its size that a motion which nearly returns keeps in a correction


@dataclass(frozen=True)
class Shot:
    """A motion over `period` (s) from the start of `system`, with its departures: residual (k,), where it ends off its start;
    shares (steps + 1,): of the period, at which steps end."""

    system: SceneSystem
    period: float
    shares: Array
    orbit: Orbit
    directions: Departures
    residual: Array

    @property
    def off(self) -> float:
        """The length of the residual."""
        return float(np.linalg.norm(self.residual))

    @property
    def end(self) -> Array:
        """Unknowns (n,) after the period."""
        return np.asarray(self.orbit.y[-1, -1])


class Shooting:
    """Newton's method for motions of one system. free: whether the period is corrected too; acting: indices of the internal
    states that act on the motion."""

    acting: Indices

    def __init__(self, prepared: Prepared, system: SceneSystem, free: bool) -> None:
        self.prepared, self.system, self.free = prepared, system, free
        self.autonomous = timed_item(prepared) is None
        self.shrinks = False  #: whether a correction was left out that would lead to rest

    def followed_from(self, system: SceneSystem, span: float) -> Solution:
        """An adaptive run from the start of a system over a span (s)."""
        return replace(SOLVER, rtol=LOOSE).solve(system, system.t0 + span)

    def begun_at(self, t: float, y: Array) -> SceneSystem:
        """The system started with unknowns y at the time of its start, with the stresses that its strains cause; with a found
        period any time is the same."""
        begin = self.system.t0 if self.free else t
        return self.system.starting(begin, *self.system.restarted(begin, self.system.strained(y)))

    def shot(self, system: SceneSystem, period: float, shares: Array) -> Shot:
        """The motion over one period (s), in steps that end at shares (steps + 1,) of it."""
        orbit = followed(system, period, shares)
        end = orbit.y[-1, -1]
        sign, turns = later(self.prepared, system, np.stack([system.y0, end]), self.acting)
        returned = Return(0.0, self.acting, shares, sign, [])
        directions = departures(self.prepared, system, returned, period)
        off = end - sign * system.y0 - turns
        return Shot(system, period, shares, orbit, directions, directions.read(off[:, None])[:, 0])

    def corrected(self, shot: Shot) -> Shot:
        """The shot that returns to its start, by Newton's method with corrections that are halved where they do not help."""
        for _ in range(ITERATIONS):
            if shot.off <= FOUND:
                return shot
            x, period = self.correction(shot)
            last = float(np.linalg.norm(x)) <= LAST
            for tried in self._tried(shot, x, period):
                if tried.off < shot.off * (1 if last else 0.9):
                    shot = tried
                    break
            else:
                if last or shot.off < STALLED:
                    return shot
                raise SteadyError(NOT_FOUND.format(shot.period, shot.off))
            if last:
                return shot
        raise SteadyError(NOT_FOUND.format(shot.period, shot.off))

    def matrix(self, shot: Shot) -> tuple[Array, Array]:
        """The matrix of the corrections of the start, in the directions, and where it is found of the share of the period; and
        the right-hand side."""
        d, k = shot.directions, len(shot.residual)
        M = d.read(propagated(shot.system, shot.orbit, d.start)) - np.eye(k)
        if not self.free:
            return M, -shot.residual
        along = d.read((shot.orbit.yp[-1, -1])[:, None])[:, 0] * shot.period
        way = along / max(float(np.linalg.norm(along)), 1e-300)
        return np.block([[M, along[:, None]], [way[None], np.zeros((1, 1))]]), np.append(-shot.residual, 0.0)

    def correction(self, shot: Shot) -> tuple[Array, float]:
        """The change of the start, in the directions, and of the period (s), after which the motion returns."""
        k = len(shot.residual)
        x = np.linalg.lstsq(*self.matrix(shot), rcond=SINGULAR)[0]
        return np.asarray(x[:k]), float(x[k] * shot.period) if self.free else 0.0

    def _tried(self, shot: Shot, x: Array, period: float) -> Iterator[Shot]:
        """Shots with the whole correction, with half of it and so on, those that can be followed."""
        for i in range(HALVINGS):
            share = 0.5**i
            length = shot.period + share * period
            if length <= 0.2 * shot.period:
                continue
            try:
                y = shot.directions.closed(shot.system, shot.system.y0 + shot.directions.start @ (share * x))
                tried = self.shot(self.begun_at(shot.system.t0, y), length, shot.shares)
            except (SolverError, OptionError):
                continue
            # steps damp a motion without losses a little, which is no reason to go to rest
            if not self.autonomous or shot.off > STALLED or self.extent(tried) > SHRINKS * self.extent(shot):
                yield tried
            else:
                self.shrinks = True

    def extent(self, shot: Shot) -> float:
        """How far the motion goes at its largest velocity in a period, in lengths of the scene and rad."""
        u = self.prepared.states(shot.orbit.t[:, -1], shot.orbit.y[:, -1])[1]
        return float(np.max(np.abs(u) / self.prepared.mechanics.velocity_units)) * shot.period


def propagated(system: SceneSystem, orbit: Orbit, dy: Array) -> Array:
    """dy (n, k) at the end of the orbit, from that at its start."""
    if not system.sparse:
        for first in range(0, len(orbit.h), TOGETHER):
            for change in _dense_steps(orbit, slice(first, first + TOGETHER), system.n):
                dy = dy + change @ dy
        return dy
    for i, (stages, own) in enumerate(zip(orbit.t, orbit.systems, strict=True)):
        with own.within(float(np.mean(stages))):
            dy = dy + _sparse_step(own, orbit, i, dy)
    return dy


def _dense_steps(orbit: Orbit, part: slice, n: int) -> Array:
    """(steps, n, n) changes of the departures over the steps of a part of the orbit, by those at their begin; dense."""
    (m, s), A = orbit.t[part].shape, orbit.table.A_inv
    t, y, yp, systems = orbit.t[part], orbit.y[part], orbit.yp[part], orbit.systems[part]
    if orbit.smooth and all(own is systems[0] for own in systems):
        fy, fyp = (x.reshape(m, s, n, n) for x in systems[0].dense_stages(t.ravel(), y.reshape(-1, n), yp.reshape(-1, n)))
    else:
        fy, fyp = np.empty((2, m, s, n, n))
        for k, own in enumerate(systems):
            with own.within(float(np.mean(t[k]))):
                fy[k], fyp[k] = own.dense_stages(t[k], y[k], yp[k])
    K = np.einsum("k,jl,kjab->kjalb", 1 / orbit.h[part], A, fyp)
    for j in range(s):
        K[:, j, :, j] += fy[:, j]
    M = K.reshape(m, s * n, s * n)
    columns = 1 / np.max(np.abs(M), axis=1)
    M *= columns[:, None]
    rows = 1 / np.max(np.abs(M), axis=2)
    M *= rows[:, :, None]
    Z = np.linalg.solve(M, -rows[:, :, None] * fy.reshape(m, s * n, n))
    return np.asarray(columns[:, -n:, None] * Z[:, -n:])


def _sparse_step(system: SceneSystem, orbit: Orbit, i: int, dy: Array) -> Array:
    """Change of dy over step i, with sparse matrices."""
    s, A = orbit.t.shape[1], orbit.table.A_inv / orbit.h[i]
    parts = [derivatives(system, orbit.t[i, j], orbit.y[i, j], orbit.yp[i, j]) for j in range(s)]
    K = sp.bmat([[A[j, l] * parts[j][1] + (parts[j][0] if j == l else 0 * parts[j][0]) for l in range(s)] for j in range(s)])
    columns = 1 / abs(K).max(axis=0).toarray().ravel()
    K = K @ sp.diags(columns)
    rows = 1 / abs(K).max(axis=1).toarray().ravel()
    right = -np.concatenate([fy @ dy for fy, _ in parts]) * rows[:, None]
    Z = splu((sp.diags(rows) @ K).tocsc()).solve(right)
    return np.asarray(columns[-system.n :, None] * Z[-system.n :])
