"""Runs of collocation methods, their steps and the control of these: the table of `Run` in radau.c."""

from __future__ import annotations

import ctypes
from math import inf
from typing import Any, NamedTuple

import numpy as np

from mbdae.native.contacts import Contacts
from mbdae.native.equations import RAISED, SLICE, Equations, Number, Pointer, Stepping, Stretches, Whole
from mbdae.native.radau import Stages, functions
from mbdae.native.sparse import Array, address

#: results of a call beside 0 and RAISED, as in radau.c
DONE, DIVERGED, ORDER, NO_WIDTH, VANISHED, NO_RATES, LOOK = 0, 3, 4, 5, 6, 7, 8
FIRST, AGAIN = 1, 2  #: of `rejected`: a first step, or one after a rejection
ARRAYS = ("y", "yp", "last", "weights", "power")


class Table(ctypes.Structure):
    """`Run` of radau.c."""

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
    """Steps made: times (m,), values and slopes (m, n), increments at inner nodes (m, s - 1, n), errors (m,) of the controller,
    and what ended them."""

    t: Array
    y: Array
    yp: Array
    inner: Array
    errors: Array
    code: int

    def then(self, more: Made) -> Made:
        """These steps and those made after them."""
        t, y, yp, inner, errors = (np.concatenate(both) for both in zip(self[:-1], more[:-1], strict=True))
        return Made(t, y, yp, inner, errors, more.code)


class Run(Stepping):
    """A run at the state y, yp (n,); table: the present step and its control.

    rates: y' = f(t, y) of a method whose last stage is not the end of the step; atol, order (n,): tolerance and index - 1 of the
    unknowns; time: typical time of the motion, s; target: part of the tolerance that Newton's method leaves; limit: iterations.
    """

    def __init__(self, stages: Stages, rates: Equations | None, atol: Array, order: Array, rtol: float, time: float,
                 target: float, limit: int) -> None:  # fmt: skip
        super().__init__(stages.equations)
        s, n = stages.s, stages.n
        entries, given = stages.matrix.entries.nnz, int(stages.equations.table.nnz)
        self._kept = stages, rates, np.array(atol, dtype=float), np.array(order, dtype=float)
        if any(array.shape != (n,) for array in self._kept[2:]):
            raise ValueError(f"atol {np.shape(atol)}, order {np.shape(order)} for {n} unknowns")
        if given != entries or not stages.equations.table.jacobian:
            raise ValueError(f"a Jacobian of {given} entries for a matrix of {entries}")
        if rates is not None and (rates.table.n != n or not rates.table.rates):
            raise ValueError(f"{rates.table.n} rates for {n} unknowns")
        self.y, self.yp, self._weights, self._power = np.zeros((4, n))
        self.last = np.zeros((s, n))
        arrays = (self.y, self.yp, self.last, self._weights, self._power)
        self.table = Table(
            ctypes.addressof(stages.table), stages.matrix.address, None if rates is None else rates.address,
            *map(address, self._kept[2:]), rtol, time, target, limit, *map(address, arrays), stale=1, exponent=1 / (s + 1),
            accepted_error=1.0, bound=inf, landing=inf, rejected=FIRST)  # fmt: skip
        self._at, self._c, self._shape = ctypes.addressof(self.table), functions(), (s - 1, n)

    def watch(self, contacts: Contacts | None) -> None:
        """Look at contacts after every step, up to one that needs a closer look (LOOK); None: do not."""
        self._contacts = contacts
        self.table.contacts = None if contacts is None else ctypes.addressof(contacts.table)

    def predict(self, h: float) -> None:
        """Starting increments of a step of h."""
        self._c.run_predict(self._at, h)

    def factored(self, h: float) -> None:
        """The factors of the matrix are those of a step of h now."""
        self._c.run_factored(self._at, h)

    def solve(self, t: float, h: float) -> int:
        """Solve the stages of a step of h from t."""
        return self._checked(self.native(self._c.run_solve, self._at, t, h))

    def advance(self, t: float, h: float) -> int:
        """Move to the end of the step of h from t that is solved; NO_RATES where there are none there."""
        return self._checked(self.native(self._c.run_advance, self._at, t, h))

    def steps(self, t: float, end: float, solved: bool, most: float, rows: int) -> Made:
        """Steps from t towards end, at most so many rows, until more than `most` residuals were evaluated, for a slice of time.
        solved: the stages of the first one are."""
        n = self._shape[1]
        times, y, yp, errors = np.empty(rows), np.empty((rows, n)), np.empty((rows, n)), np.empty(rows)
        inner, made = np.empty((rows, *self._shape)), Whole()
        code = self.native(self._c.run_steps, self._at, t, end, solved, most, SLICE, rows,
                        *map(address, (times, y, yp, inner, errors)), ctypes.addressof(made))  # fmt: skip
        m = made.value
        return Made(times[:m], y[:m], yp[:m], inner[:m], errors[:m], code)

    def control(self) -> tuple[Any, ...]:
        """What `back` needs to repeat the next step."""
        table = self.table
        return self.last.copy(), table.last_h, table.accepted, table.accepted_error

    def back(self, y: Array, yp: Array, control: tuple[Any, ...]) -> None:
        """Go back to a state and what `control` told there; the length of the next step stays."""
        self.y[:], self.yp[:] = y, yp
        table = self.table
        self.last[:], table.last_h, table.accepted, table.accepted_error = control
        table.fresh = False

    def _checked(self, code: int) -> int:
        if code == RAISED:
            self.raise_error()
        return code

    def raise_error(self) -> None:
        """Raise what a call back raised, if one did."""
        for equations in (self.equations, self._kept[1]):
            if equations is not None:
                equations.raise_error()
