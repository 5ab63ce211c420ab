"""Integration by collocation methods with step size control: the Python side of `Run` in radau.c."""

from __future__ import annotations

import ctypes
from math import inf
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import internal
from mbdae.native.contacts import Contacts
from mbdae.native.elimination import Array, address
from mbdae.native.equations import RAISED, SLICE, Equations, Number, Pointer, Stepping, Stretches, Whole
from mbdae.native.radau import Stages, functions

#: return codes of the functions of radau.c, where their meaning is stated; besides RAISED: a callback raised an exception
DONE, DIVERGED, ORDER, NO_WIDTH, VANISHED, NO_RATES, LOOK = 0, 3, 4, 5, 6, 7, 8
FIRST, AGAIN = 1, 2  #: values of `Table.rejected`: the next step is the first one of the run, or repeats a rejected one
ARRAYS = ("y", "yp", "last", "weights", "power")


class Table(ctypes.Structure):
    """The C struct `Run` of radau.c, with the same members in the same order."""

    _fields_ = (*((name, Pointer) for name in ("stages", "matrix", "rates", "atol", "order")),
                *((name, Number) for name in ("rtol", "time", "target")), ("limit", Whole),
                *((name, Pointer) for name in ARRAYS), *((name, Number) for name in ("last_h", "factored", "power_h")),
                *((name, Whole) for name in ("stale", "fresh", "at_start", "here")),
                *((name, Number) for name in ("h", "exponent", "accepted", "accepted_error")), ("stretches", Stretches),
                ("contacts", Pointer),
                *((name, Number) for name in ("bound", "landing", "smallest", "width", "error", "noise", "noise_t", "noise_h",
                                              "tried")),
                *((name, Whole) for name in ("careful", "rejected", "rejections", "jacobians", "factorisations", "iterations",
                                             "residuals")))  # fmt: skip


class Made(NamedTuple):
    """Accepted steps: times t (m,) at their ends, y and y' there (m, n), increments of y from the begin of the step to its inner
    collocation nodes (m, s - 1, n), local error estimates (m,) in units of the tolerance; code: why the call ended."""

    t: Array
    y: Array
    yp: Array
    inner: Array
    errors: Array
    code: int

    def then(self, more: Made) -> Made:
        """These steps followed by those in `more`, as one object."""
        t, y, yp, inner, errors = (np.concatenate(both) for both in zip(self[:-1], more[:-1], strict=True))
        return Made(t, y, yp, inner, errors, more.code)


class Run(Stepping):
    """An integration under way, which has reached y, yp (n,); table: the present step and the step size control.

    rates: y' = f(t, y), needed by a method whose last stage is not the end of the step, None: not needed; atol, order (n,):
    absolute tolerance and (differentiation index - 1) of each unknown; time: characteristic time of the motion, s; target: error
    of Newton's iteration, over the tolerance, at which it stops; limit: largest number of its iterations.
    """

    def __init__(self, stages: Stages, rates: Equations | None, atol: Array, order: Array, rtol: float, time: float,
                 target: float, limit: int) -> None:  # fmt: skip
        super().__init__(stages.equations)
        s, n = stages.s, stages.n
        entries, given = stages.matrix.entries.nnz, int(stages.equations.table.nnz)
        self._kept = stages, rates, np.array(atol, dtype=float), np.array(order, dtype=float)
        if any(array.shape != (n,) for array in self._kept[2:]):
            raise internal(f"Radau IIA in C was given absolute tolerances of shape {np.shape(atol)} and indices of shape "
                           f"{np.shape(order)}, it needs one for each of {n} unknowns")  # fmt: skip
        if given != entries or not stages.equations.table.jacobian:
            raise internal(f"Radau IIA in C was given equations whose Jacobian has {given} entries, and an iteration matrix that "
                           f"has {entries}: it needs as many, and a Jacobian")  # fmt: skip
        if rates is not None and (rates.table.n != n or not rates.table.rates):
            raise internal(f"Radau IIA in C needs y' as a function of {n} unknowns, and was given one of {rates.table.n}, or "
                           "none")  # fmt: skip
        self.y, self.yp, self._weights, self._power = np.zeros((4, n))
        self.last = np.zeros((s, n))
        arrays = (self.y, self.yp, self.last, self._weights, self._power)
        self.table = Table(
            ctypes.addressof(stages.table), stages.matrix.address, None if rates is None else rates.address,
            *map(address, self._kept[2:]), rtol, time, target, limit, *map(address, arrays), stale=1, exponent=1 / (s + 1),
            accepted_error=1.0, bound=inf, landing=inf, rejected=FIRST)  # fmt: skip
        self._at, self._c, self._shape = ctypes.addressof(self.table), functions(), (s - 1, n)

    def watch(self, contacts: Contacts | None) -> None:
        """Have `steps` check these contacts after every step and return LOOK where one needs a closer check in Python; None: no
        contacts are checked."""
        self._contacts = contacts
        self.table.contacts = None if contacts is None else ctypes.addressof(contacts.table)

    def predict(self, h: float) -> None:
        """Compute the starting values of Newton's iteration for a step of h (s)."""
        self._c.run_predict(self._at, h)

    def factored(self, h: float) -> None:
        """Tell C that the iteration matrix is now factorised for a step of h (s)."""
        self._c.run_factored(self._at, h)

    def solve(self, t: float, h: float) -> int:
        """Solve the stages of a step of h (s) from t."""
        return self._checked(self.native(self._c.run_solve, self._at, t, h))

    def advance(self, t: float, h: float) -> int:
        """Move to the end of the step of h (s) from t, whose stages are solved; NO_RATES where f(t, y) has no value there."""
        return self._checked(self.native(self._c.run_advance, self._at, t, h))

    def steps(self, t: float, end: float, solved: bool, most: float, rows: int) -> Made:
        """Steps from t towards end: at most `rows`, until more than `most` residuals were evaluated or SLICE seconds have passed.
        solved: whether the stages of the first step are solved already."""
        n = self._shape[1]
        times, y, yp, errors = np.empty(rows), np.empty((rows, n)), np.empty((rows, n)), np.empty(rows)
        inner, made = np.empty((rows, *self._shape)), Whole()
        code = self.native(self._c.run_steps, self._at, t, end, solved, most, SLICE, rows,
                        *map(address, (times, y, yp, inner, errors)), ctypes.addressof(made))  # fmt: skip
        m = made.value
        return Made(times[:m], y[:m], yp[:m], inner[:m], errors[:m], code)

    def control(self) -> tuple[Any, ...]:
        """State of the step size control, with which `back` can return to this point to make the next step once more."""
        table = self.table
        return self.last.copy(), table.last_h, table.accepted, table.accepted_error

    def back(self, y: Array, yp: Array, control: tuple[Any, ...]) -> None:
        """Go back to an earlier point: its y and yp, and what `control` returned there. The length of the next step stays as it
        is."""
        self.y[:], self.yp[:] = y, yp
        table = self.table
        self.last[:], table.last_h, table.accepted, table.accepted_error = control
        table.fresh = False

    def _checked(self, code: int) -> int:
        if code == RAISED:
            self.raise_error()
        return code

    def raise_error(self) -> None:
        """Raise the exception of a callback, if one was raised."""
        for equations in (self.equations, self._kept[1]):
            if equations is not None:
                equations.raise_error()
