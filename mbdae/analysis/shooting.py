"""Shooting: Newton's method for the state, and where it is free the period, to which a motion returns.

The exact derivative of one period in Radau steps: with the stages Y_i of a step, F_y dY_i + F_y' sum_j A^-1_ij (dY_j - dy_0) / h
= 0. Its columns are the departures, which the corrections of the start and the multipliers come from.

Radau steps damp what they do not follow. Motions that are fast beside the steps, and beside the changes of the equations, grow as
those of the equations held at each instant (the method of Wentzel, Kramers and Brillouin): x = r a exp(int lambda dt), where
(F_y + lambda F_y') r = 0, and l F_y' (r a)' = 0 with the left vector l.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.optimize import linear_sum_assignment
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
#: number of times of a period at which fast motions are looked at; size of a root, over 1 / step, above which steps do not follow
#: it; growth below ROUNDED of the root counts as none
LOOKS, FOLLOWED, ROUNDED = 32, 1.5, 1e-9
DAMPED = 0.5  #: damping ratio from which on a motion dies out in a step, followed or not: the multipliers know of it
SLOW = 0.1  #: where three instants have roots below this part of FOLLOWED alone, no others are looked at
TINY = 1e-12  #: smallest size of a motion, in lengths of the scene and rad
SMALLEST = 1e-14  #: eigenvalue over the largest that counts as 0
SHRINKS = 0.9  #: part of its size that a motion which nearly returns keeps in a correction


@dataclass(frozen=True)
class Shot:
    """A motion over `period` (s) from the start of `system`, with its departures: residual (k,), where it ends off its start;
    shares (steps + 1,): of the period, at which steps end; extent: its length at its largest velocity, lengths of the scene."""

    system: SceneSystem
    period: float
    shares: Array
    orbit: Orbit
    directions: Departures
    residual: Array
    returned: Return
    extent: float

    @property
    def size(self) -> float:
        """The size of the motion, to which departures refer, in lengths of the scene and rad."""
        return _size(self.extent)

    @property
    def off(self) -> float:
        """The length of the residual, of the size of the motion."""
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
        u = self.prepared.states(orbit.t[:, -1], orbit.y[:, -1])[1]
        extent = float(np.max(np.abs(u) / self.prepared.mechanics.velocity_units, initial=0.0)) * period
        directions = departures(self.prepared, system, returned, period, _size(extent))
        off = end - sign * system.y0 - turns
        return Shot(system, period, shares, orbit, directions, directions.read(off[:, None])[:, 0], returned, extent)

    def corrected(self, shot: Shot) -> Shot:
        """The shot that returns to its start, by Newton's method with corrections that are halved where they do not help."""
        least = 0.0  # a small residual alone leaves much open near a resonance
        for _ in range(ITERATIONS):
            if shot.off <= min(FOUND, LAST * least):
                return shot
            x, period, least = self.correction(shot)
            last = float(np.linalg.norm(x)) <= LAST
            if last and shot.off <= FOUND:
                return shot
            for tried in self._tried(shot, x, period):
                if tried.off * tried.size < shot.off * shot.size * (1 if last else 0.9):
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

    def correction(self, shot: Shot) -> tuple[Array, float, float]:
        """The change of the start, in the directions, and of the period (s), after which the motion returns; and by how much the
        smallest one of such changes changes the end."""
        k = len(shot.residual)
        x, _, _, sizes = np.linalg.lstsq(*self.matrix(shot), rcond=SINGULAR)
        least = float(np.min(sizes, where=sizes > SINGULAR * np.max(sizes, initial=0.0), initial=np.inf))
        return np.asarray(x[:k]), float(x[k] * shot.period) if self.free else 0.0, least

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
            if not self.autonomous or shot.off > STALLED or tried.extent > SHRINKS * shot.extent:
                yield tried
            else:
                self.shrinks = True


def _size(extent: float) -> float:
    return min(max(extent / (2 * np.pi), TINY), 1.0)


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


@dataclass(frozen=True)
class Fast:
    """Motions that are too fast for the steps of a period: their growth (k,) 1/s in the mean over it, its errors (k,) 1/s, both 0
    where nothing damps or feeds them, their roots (k,) 1/s and vectors (departures, k) at the start."""

    growth: Array
    errors: Array
    roots: Array
    vectors: Array

    @property
    def stable(self) -> bool | None:
        """False where one grows by more than its error; None where the errors leave it open."""
        return False if np.any(self.growth > self.errors) else None if np.any(self.growth + self.errors > 0) else True


def fast_motions(prepared: Prepared, system: SceneSystem, orbit: Orbit, directions: Departures, returned: Return) -> Fast:
    """The motions near an orbit that its steps do not follow, with the growth that the equations at each instant give them.

    Its error: how much it changes with half as many instants, and the part of second order in the changes of the vectors."""
    period, count = float(np.sum(orbit.h)), len(orbit.h)
    begin = _look(system, directions, float(orbit.h[0]))

    def look(i: int) -> _Look | None:
        t, y, yp, own = orbit.t[i, -1], orbit.y[i, -1], orbit.yp[i, -1], orbit.systems[i]
        with own.within(float(np.mean(orbit.t[i]))):
            at = own.starting(t, y, yp)
            try:
                return _look(at, departures(prepared, at, returned, period), float(orbit.h[i]))
            except OptionError:  # a singular position, which the motion passes
                return None

    some = [begin, *(one for i in (count // 3, 2 * count // 3) if (one := look(i)))]
    if max(float(np.max(one.size, initial=0.0)) for one in some) < SLOW * FOLLOWED:
        return Fast(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((len(begin.vectors), 0)))
    found = [(float(orbit.t[i, -1]), one) for i in np.unique(np.linspace(0, count - 1, LOOKS).astype(int))[:-1]
             if (one := look(int(i)))]
    times, looks = [system.t0, *(t for t, _ in found)], [begin, *(one for _, one in found)]
    first, closed = looks[0], replace(looks[0], right=returned.sign[:, None] * looks[0].right)
    spans = np.diff(np.append(times, system.t0 + period))
    fine = _tracked([*looks, closed], spans)
    half = _tracked([*looks[::2], closed], np.add.reduceat(spans, np.arange(0, len(spans), 2)))
    fast = np.flatnonzero(fine.size > FOLLOWED)
    growth = fine.growth[fast] / period
    rounding = 8 * np.finfo(float).eps * fine.size[fast] * np.abs(first.roots[fast])
    errors = (np.abs(fine.growth - half.growth)[fast] + fine.second[fast]) / period + rounding
    felt = fine.scatter[fast] > ROUNDED
    return Fast(felt * growth, felt * errors, first.roots[fast], first.vectors[:, fast])


@dataclass(frozen=True)
class _Look:
    """The equations held at an instant: roots (k,) 1/s, vectors (departures, k) and as unknowns right (n, k), left (k, n) with
    left right = 1; size (k,): of the roots times the step."""

    roots: Array
    vectors: Array
    right: Array
    left: Array
    size: Array

    @property
    def lasting(self) -> Array:
        """size (k,), 0 of those that are DAMPED."""
        return np.where(self.roots.real < -DAMPED * np.abs(self.roots), 0.0, self.size)


def _look(system: SceneSystem, d: Departures, h: float) -> _Look:
    """S = (F_y' + h F_y)^-1 F_y' has the eigenvalues 1 / (1 - h lambda), and 0 for what constraints determine: S S removes it."""
    fy, fyp = (part.tocsc() for part in derivatives(system, system.t0, system.y0, system.yp0))
    K = (fyp + h * fy).tocsc()
    columns = 1 / np.maximum(abs(K).max(axis=0).toarray().ravel(), 1e-300)
    K = K @ sp.diags(columns)
    rows = 1 / np.maximum(abs(K).max(axis=1).toarray().ravel(), 1e-300)
    solver = splu((sp.diags(rows) @ K).tocsc())

    def once(x: Array) -> Array:
        return np.asarray(columns[:, None] * solver.solve(rows[:, None] * (fyp @ x)))

    def back(x: Array) -> Array:
        return np.asarray(fyp.T @ (rows[:, None] * solver.solve(columns[:, None] * x, trans="T")))

    values, left, right = scipy.linalg.eig(d.read(once(d.start)), left=True)
    overlap = np.einsum("nk,nk->k", left.conj(), right)
    overlap = np.where(np.abs(overlap) < np.finfo(float).eps, np.finfo(float).eps, overlap)
    reading = d.read(np.eye(system.n)) if system.n else np.zeros((0, 0))
    reading = back(back(reading.T)).T
    values = np.where(np.abs(values) < SMALLEST, SMALLEST, values)  # motions that die out at once
    roots = (1 - 1 / values) / h
    functional = (left.conj().T @ reading) / (overlap * values**2)[:, None]
    return _Look(roots, right, d.start @ right, functional, np.abs(h * roots))


@dataclass(frozen=True)
class _Tracked:
    """Roots followed over a period: growth (k,) over it, its part of second order, the largest size of a root times the step but
    for those that are DAMPED, and the largest growth at an instant over the root."""

    growth: Array
    second: Array
    size: Array
    scatter: Array


def _tracked(looks: list[_Look], spans: Array) -> _Tracked:
    k = len(looks[0].roots)
    own, growth, second, size, scatter = np.arange(k), *np.zeros((4, k))
    for a, b, span in zip(looks, looks[1:], spans, strict=False):
        there, again = a.left @ b.right, b.left @ a.right
        follower = linear_sum_assignment(-np.abs(there * again.T))[1]
        there, again, roots = there[:, follower], again[follower], (a.roots + b.roots[follower]) / 2
        # l F_y' r' from both sides; a vector that turns with another root takes part in that root's growth
        kept, back = (np.maximum(np.abs(np.diag(x)), SMALLEST) for x in (there, again))
        step = span * roots.real - (np.log(kept) - np.log(back)) / 2
        turned = np.abs(there * there.T) / np.outer(kept, kept)
        gap = span * np.abs(roots[:, None] - roots)
        with np.errstate(divide="ignore", invalid="ignore"):
            order = np.where(gap**2 > turned, turned / gap, 0.0)
        growth += step[own]
        second += np.sum(order - np.diag(np.diag(order)), axis=1)[own]
        size = np.maximum(size, np.maximum(a.lasting, b.lasting[follower])[own])
        scatter = np.maximum(scatter, (np.abs(roots.real) / np.maximum(np.abs(roots), SMALLEST))[own])
        own = follower[own]
    return _Tracked(growth, second, size, scatter)
