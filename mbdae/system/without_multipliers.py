"""Equations with their multipliers eliminated: y' = f(t, y), y = (q, u, s), of a scene with constraints.

At every state M u' + G^T lambda = f and the constraints on the level of accelerations are solved for u' and lambda. Where the
mass matrix is constant and the forces do not depend on lambda, one kernel call per law gives f, G and the right-hand side of the
constraints (`assembled/acceleration_kernel.py`). Otherwise the full equations are solved by Newton's method, which needs one step
where they are linear (`assembled/right_hand_side.py`).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from math import inf
from typing import Any, Self

import numpy as np

from mbdae.deferred import as_full
from mbdae.errors import AccuracyWarning, OptionError, SolverError
from mbdae.native.equations import Equations
from mbdae.system.assembled.acceleration_kernel import AccelerationKernel, acceleration_kernel
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.jacobian_entries import FormSpec
from mbdae.system.assembled.right_hand_side import REMEDY, Rates, numbers_of, singular
from mbdae.system.base import Array, Numbers, System
from mbdae.system.dependent_rows import Rows
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.threads import alone
from mbdae.values import shown

#: the independent part of a row is what other rows do not contain, over the row's length. Below this value of its square, near a
#: singular position, reactions and accelerations are inaccurate
NEAR = 1e-7
#: the smallest independent part falls to 0 and rises again where a step passes a singular position. Such a step is assumed where
#: the extrapolation from earlier steps, with opposite sign, agrees with the new value up to this relative difference
PASSED = 0.3
SOUND = 0.3  #: smallest singular value of all rows, over that at the start, above which a position does not count as singular
UNSEEN = ((-inf, 1.0),) * 3


class Accelerations(Rates):
    """y' and multipliers of constrained bodies, by `AccelerationKernel` where that is possible, else as in `Rates`. start: a
    state (t, y), see `acceleration_kernel`."""

    def __init__(self, full: Assembly, differential: int, linear: bool, start: tuple[float, Array]) -> None:
        super().__init__(full, differential, linear)
        self._start = start

    def __getstate__(self) -> dict[str, Any]:
        """State for copies and pickles, without the kernel: its tables contain addresses of arrays, so that a copy makes its
        own."""
        return {name: value for name, value in self.__dict__.items() if name != "kernel"}

    @cached_property
    def kernel(self) -> AccelerationKernel | None:
        """The kernel of the accelerations; None where the full equations are solved instead."""
        if not self.linear:
            return None
        return acceleration_kernel(self.full, as_full(self.full.constant_mass), self.full.row_of, self._start)


class BranchingError(SolverError):
    """A run that is to stop at singular positions came to one: another method may help, another tolerance does not."""


class WithoutMultipliers(SceneSystem):
    """A scene with constraints as y' = f(t, y), y = (q, u, s)."""

    strict = False  #: whether a run stops with an error at singular positions; False: it only warns
    pattern = None  #: dy'/dy is full
    has_pattern = False

    def __init__(self, prepared: Prepared, spec: FormSpec, sparse: bool | None = None,
                 others: dict[Rows, SceneSystem] | None = None) -> None:
        model, moved, bare = prepared.model, prepared.all_bodies.moved, replace(spec, eliminated=False)
        self.full = Assembly(model, prepared.mechanics.rows, bare, sparse, moved)
        super().__init__(prepared, spec, sparse, others, Assembly(model, [], replace(bare, blocks=()), False, moved))
        linear = not any(group.derived.reactive for group in model.groups)
        self._rates = Accelerations(self.full, self.n, linear, (self.t0, self.y0))
        self._rate = np.zeros(self.n)
        self._seen, self._warned = UNSEEN, False

    def strictly(self, strict: bool) -> Self:
        """A copy of these equations with another value of `strict`."""
        other = copy(self)
        other.strict = strict
        return other

    def taking_over(self, other: SceneSystem, t: float, y: Array) -> SceneSystem:
        assert isinstance(other, WithoutMultipliers)
        begun = self.strictly(other.strict).starting(t, *self.restarted(t, y), other.longest_step)
        begun._warned, begun._seen = other._warned, UNSEEN
        return begun

    @property
    def native(self) -> Equations | None:
        """The table by which native methods evaluate y' = f(t, y); None where Python solves for y'."""
        kernel = self._rates.kernel
        return None if kernel is None else kernel.equations

    def numbers(self, names: Sequence[str]) -> Numbers:
        kernel = self._rates.kernel
        if kernel is None:
            raise OptionError(f"numbers = {shown(list(names))}: they cannot vary in a batch of this scene, whose accelerations "
                              f"and joint forces are solved for without a compiled function of them: {REMEDY}")
        return numbers_of(kernel, self.full, names)

    @property
    def multipliers(self) -> Array:
        """lambda (m,) of the last evaluation."""
        return (self._rates.kernel or self._rates).multipliers

    @alone
    def rhs(self, t: float, y: Array, out: Array) -> None:
        """out[:] = y'."""
        kernel = self._rates.kernel
        if kernel is None:
            self._rates.solve(t, y, out)
            return
        row = kernel.y_rates(t, y, out)
        if row >= 0:
            raise singular(t, self.full.numbering.rows[row].name)

    @alone
    def rate_jacobian(self, t: float, y: Array) -> Array:
        """dy'/dy (n, n)."""
        self.rhs(t, y, self._rate)
        self._rates.multipliers = self.multipliers
        return self._rates.jacobian(t, y, self._rate)

    def accept(self, t: float, y: Array) -> None:
        self.accept_many(np.array([t]), y[None])

    def accept_many(self, t: Array, y: Array) -> None:
        """Warn once per run, or raise SolverError if `strict`, where a singular position is near or was passed within the last
        step."""
        shares = (self._rates.kernel or self._rates).shares(t, y)
        least = np.sqrt(np.min(shares, axis=1))  # falls to 0 and rises again where a step passes a singular position
        for time, state, here in zip(t.tolist(), y, least.tolist(), strict=True):
            self._pass(time, state, here)

    def _pass(self, t: float, y: Array, here: float) -> None:
        """Look at one step, which ends at t, y (n,) with the smallest independent part `here`."""
        if t <= self._seen[-1][0]:  # another run has begun
            self._warned, self._seen = False, ((-inf, here),) * 3
        expected = _continued(self._seen, t)
        self._seen = *self._seen[1:], (t, here)
        if self._warned or (here**2 > NEAR and abs(here + expected) > PASSED * abs(expected)):
            return
        # unlike those of the kernel, these depend on the geometry alone, not on the masses
        shares = self._rates.shares(np.array([t]), y[None])[0]
        weakest = int(np.argmin(shares))
        if (expected < 0 or shares[weakest] < NEAR) and not self._determined(t, y):
            if self.strict:
                raise singular(t, self.full.numbering.rows[weakest].name, BranchingError)
            self._warned = True
            name = self.full.numbering.rows[weakest].name
            text = (f"a singular position is near or passed at t = {t:.6g} s: constraint {name} depends on the others there; "
                    f"form {self.label} may continue on another branch of the motion unnoticed; compare with a run by "
                    "form=mb.GGL() and mb.RadauIIA(3)")
            warnings.warn(text, AccuracyWarning, stacklevel=4)

    def _own_memory(self) -> dict[str, Any]:
        own = {"shares": self._seen, "warned": self._warned, "multipliers": self._rates.multipliers.copy()}
        return super()._own_memory() | own

    def _remember_own(self, memory: dict[str, Any]) -> None:
        super()._remember_own(memory)
        self._seen, self._warned = memory["shares"], memory["warned"]
        self._rates.multipliers = memory["multipliers"].copy()

    def _determined(self, t: float, y: Array) -> bool:
        """Whether all rows, redundant ones included, still determine the motion where the rows in force nearly fail to."""
        here, at_start = self.smallest(t, y), self.smallest(self.t0, self.y0)
        return here is not None and at_start is not None and here > SOUND * at_start

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        self.rhs(t, y, out)
        np.subtract(yp, out, out=out)

    def residual_stages(self, t: Array, y: Array, yp: Array, out: Array) -> None:
        System.residual_stages(self, t, y, yp, out)

    @alone
    def linear_stages(self, t: Array, y: Array, yp: Array) -> tuple[Any, Array, Array]:
        Y, Yp = np.zeros((2, len(t), self.full.n))
        Y[:, : self.n] = y
        for i, time in enumerate(t.tolist()):
            self.rhs(time, y[i], Yp[i, : self.n])
            Y[i, self.n :] = self.multipliers
        return self.full, *self.full.evaluation.jacobians(t, Y, Yp)

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        return -self.rate_jacobian(t, y), np.eye(self.n)

    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        out[...] = cj * np.eye(self.n) - self.rate_jacobian(t, y)


def _continued(seen: tuple[tuple[float, float], ...], t: float) -> float:
    """Value at t of the parabola through three points (time, value). Points at time -inf do not count: with two points the line
    through them, with one its value."""
    (t0, a), (t1, b), (t2, c) = seen
    if t1 == -inf:
        return c
    slope = (c - b) / (t2 - t1)
    bend = (slope - (b - a) / (t1 - t0)) / (t2 - t0) if t0 > -inf else 0.0
    return c + (t - t2) * (slope + (t - t1) * bend)
