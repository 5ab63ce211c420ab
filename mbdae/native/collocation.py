"""Newton's iteration for the stages of a collocation step, with starting values and local error: the Python side of radau.c.

Contacts that C checks after every step, until one needs a closer check in Python: the table of contacts.h.

Integration by collocation methods with step size control: the Python side of `CollocationRun` in radau.c.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import internal
from mbdae.native import Array, address, declared
from mbdae.native.equations import RAISED, SLICE, Equations, Number, Pointer, Stepping, Stretches, Whole
from mbdae.native.program import address_of
from mbdae.native.sparse import Matrix

#: Newton's iteration in Python also counts as converged where a correction is more than half of the one before and at most this
#: share of the tolerance: round-off keeps it from shrinking. STAGNATION in radau.c has the same value
STAGNATION = 0.03
NAMES = ("c", "A_inv", "T", "T_inv", "V_inv", "end", "e")


class NewtonTable(ctypes.Structure):
    """The C struct `Radau` of radau.c, with the same members in the same order."""

    _fields_ = (("equations", Pointer), ("matrix", Pointer), ("s", Whole), ("n", Whole), ("reals", Whole), ("pairs", Whole),
                *((name, Pointer) for name in NAMES), ("gamma0", Number),
                *((name, Pointer) for name in ("Z", "Y", "Yp", "R", "D", "correction", "w", "error", "scaled")),
                ("rate", Number), ("iterations", Whole), ("theta", Number), ("norm", Number), ("estimate", Number),
                ("residuals", Whole))


#: function that opens the library and states the types of the functions of radau.c for ctypes
functions = declared(
    ("radau_slopes", None, (Pointer, Number)),
    ("radau_predict", None, (Pointer, Pointer, Number, Number, Pointer)),
    ("radau_noise", Number, (Pointer, Pointer)),
    ("radau_solve", ctypes.c_int, (Pointer, Number, Pointer, Number, Pointer, Number, Whole)),
    ("radau_error", ctypes.c_int, (Pointer, Number, Pointer, Pointer, Number, Pointer, Whole)),
    ("run_predict", None, (Pointer, Number)),
    ("run_factored", None, (Pointer, Number)),
    ("run_solve", ctypes.c_int, (Pointer, Number, Number)),
    ("run_advance", ctypes.c_int, (Pointer, Number, Number)),
    ("run_steps", ctypes.c_int, (Pointer, Number, Number, Whole, Number, Number, Whole, *[Pointer] * 6)),
)


class Stages:
    """Solves F(t0 + c_i h, y0 + Z_i, sum_j A_inv[i, j] Z_j / h) = 0 for the increments Z (s, n) of the s stages.

    Z, Y, Yp, R, correction (s, n): increments y - y0, values y and y', residuals and last correction of the stages; Z holds the
    starting values on entry to `solve`. error, scaled (n,): the last estimate of the local error, absolute and in units of the
    tolerance. coefficients: a `CollocationTable`; matrix: the iteration matrices, whose lambda are the eigenvalues of A_inv
    (further ones may follow); `estimate` needs a real eigenvalue.
    """

    def __init__(self, equations: Equations, coefficients: Any, matrix: Matrix) -> None:
        s, n = len(coefficients.c), matrix.entries.n
        reals, pairs = len(coefficients.real), len(coefficients.pairs)
        kept = {name: np.array(getattr(coefficients, name), dtype=float, order="C") for name in NAMES}
        square = {"A_inv", "T", "T_inv", "V_inv"}
        if any(array.shape != ((s, s) if name in square else (s,)) for name, array in kept.items()) or s < 1:
            raise internal(f"the coefficients of a collocation method of {s} stages need the shape ({s},) or ({s}, {s}): "
                           f"{({name: array.shape for name, array in kept.items()})}")
        if reals + 2 * pairs != s or len(matrix.real) < reals or len(matrix.pairs) != pairs:
            raise internal(f"a collocation method of {s} stages needs {s} eigenvalues, a complex pair counts as two, and a "
                           f"factorised matrix for each: there are {reals} real ones, {pairs} pairs and "
                           f"{len(matrix.factors)} factorised matrices")
        if not (np.array_equal(matrix.real[:reals], coefficients.real) and np.array_equal(matrix.pairs, coefficients.pairs)):
            raise internal("the factorised matrices of a collocation method were made for other eigenvalues than those of its "
                           "coefficients")
        if equations.table.n != n or not equations.table.residual:
            raise internal(f"a collocation method was given {equations.table.n} equations, or none as a residual, and an "
                           f"iteration matrix of {n} unknowns: it needs equations as a residual, as many as unknowns")
        self.s, self.n, self.equations, self.matrix = s, n, equations, matrix
        self.Z, self.Y, self.Yp, self.R, self._D, self.correction = (np.zeros((s, n)) for _ in range(6))
        self._w, (self.error, self.scaled) = np.zeros((2, n)), np.zeros((2, n))
        self._last = np.zeros((s, n))
        self._y, self._yp, self._weights = np.zeros((3, n))
        self._inputs = address(self._y), address(self._yp), address(self._weights)
        arrays = (self.Z, self.Y, self.Yp, self.R, self._D, self.correction, self._w, self.error, self.scaled)
        self._kept = kept
        self.table = NewtonTable(equations.address, matrix.address, s, n, reals, pairs, *map(address, kept.values()),
                           coefficients.gamma0, *map(address, arrays), inf)
        self._at, self._c = ctypes.addressof(self.table), functions()

    def predict(self, yp: Array, h: float, last_h: float, last: Array | None) -> None:
        """Compute starting values of the increments for a step of h (s): by extrapolation of the collocation polynomial of the
        last step, of length last_h (s) with increments last (s, n), or along the slope yp (n,) where last_h is 0."""
        self._yp[:] = yp
        if last_h:
            self._last[:] = last
        self._c.radau_predict(self._at, self._inputs[1], h, last_h, address(self._last))

    def slopes(self, h: float) -> None:
        """Compute the slopes y' of the stages, Yp, from the increments Z."""
        self._c.radau_slopes(self._at, h)

    def solve(self, t0: float, y0: Array, h: float, weights: Array, target: float, limit: int) -> bool:
        """Newton's iteration with the present LU factors, until its remaining error, estimated from the rate of convergence, is
        below target. Returns whether it has converged.

        weights (n,): those of the norm, in which 1 is the tolerance; limit: largest number of iterations. Afterwards `table` has
        the number of `iterations`, the last rate of convergence `theta` and the `norm` of the last correction.
        """
        self._y[:], self._weights[:] = y0, weights
        code = self._c.radau_solve(self._at, t0, self._inputs[0], h, self._inputs[2], target, limit)
        if code < 0:
            self.equations.raise_error()
        return bool(code > 0)

    def noise(self, weights: Array) -> float:
        """Norm of the Newton correction that round-off of the residual alone can cause."""
        self._weights[:] = weights
        return float(self._c.radau_noise(self._at, self._inputs[2]))

    def estimate(self, t: float, y: Array, yp: Array, h: float, weights: Array, careful: bool) -> float:
        """Embedded estimate of the local error of the step from (t, y, yp), in units of the tolerance; a solution with the
        iteration matrix filters out stiff components. careful: filter once more where the estimate is 1 or larger."""
        if not len(self.matrix.real):
            raise internal("the error estimate of a collocation method needs a real eigenvalue of its coefficients, these have "
                           "none")
        self._y[:], self._yp[:], self._weights[:] = y, yp, weights
        if self._c.radau_error(self._at, t, *self._inputs[:2], h, self._inputs[2], careful) < 0:
            self.equations.raise_error()
        return float(self.table.estimate)


#: impact speeds (m/s, rad/s) at which the durations of impacts are tabulated for C, from 1e-14 to 1e6, eight in a decade; in
#: between log(duration) is interpolated linearly over log(speed), beyond them the duration is that at the nearest end
SPEEDS = 10.0 ** (np.arange(161) / 8 - 14)
NUMBERS = ("impact", "approach", "rest", "margin", "slope", "change", "near", "round")


def durations_at(logarithms: Array, speeds: Array) -> Array:
    """Durations (k,) of impacts at speeds (k,), by the rule of contacts.c. logarithms (k, speeds): of the durations at SPEEDS."""
    size, width = np.abs(speeds), len(SPEEDS)
    place = np.minimum(np.maximum(8 * (np.log10(np.maximum(size, 1e-300)) + 14), 0.0), width - 1.001)
    i = place.astype(np.intp)
    at = i + np.arange(0, width * len(i), width)
    low = logarithms.take(at)
    return np.asarray(np.exp(low + (place - i) * (logarithms.take(at + 1) - low)) * (size > 0))


class ContactTable(ctypes.Structure):
    """The C struct `Contacts` of contacts.h, with the same members in the same order."""

    _fields_ = (("values", Pointer), ("scene", Pointer), ("count", Whole), ("positions", Whole),
                *((name, Pointer) for name in ("logarithms", "by_joints", "known", "at")), ("reach", Number),
                *((name, Pointer) for name in ("here", "before", "end", "lasting", "stiff", "pairs", "inside")),
                *((name, Number) for name in NUMBERS))


class Contacts:
    """Contacts whose gaps and gap rates are evaluated in C.

    here, before (count, 3): gap (m or rad), its rate, and the duration (s) of an impact at this rate, at the end of the last step
    and of the one before; lasting (count,): times (s) from which on a contact that is still closed counts as resting, no longer
    as an impact; stiff (count,): gaps at which the Jacobian in use was evaluated; inside (count,): number of steps since the
    contact closed."""

    def __init__(self, scene: Any, by_joints: Any, numbers: Mapping[str, float]) -> None:
        """scene: `Evaluator` of gap and gap rate of every contact; by_joints: of every contact, whether its effective mass
        contains bodies that joints tie to those in contact; numbers: the constants `NUMBERS` of the checks."""
        count = len(by_joints)
        if count < 1 or scene.width != 2 * count or set(numbers) != set(NUMBERS):
            raise internal(f"the watch over contacts in C has {count} contacts, which need {2 * count} values (gap and gap rate "
                           f"of each) and the numbers {sorted(NUMBERS)}: it was given {scene.width} values and the numbers "
                           f"{sorted(numbers)}")
        self._scene, self._by_joints, self._known = scene, np.array(by_joints, dtype=np.int64), np.zeros(count, dtype=np.int64)
        self._logarithms, self._pairs = np.zeros((count, len(SPEEDS))), np.zeros((count, 2))
        self.here, self.before, self._end = (np.zeros((count, 3)) for _ in range(3))
        self.lasting, self.stiff, self.inside = np.zeros(count), np.zeros(count), np.zeros(count, dtype=np.int64)
        self.table = ContactTable(address_of("scene_values"), scene.address, count, 0,
                           *map(address, (self._logarithms, self._by_joints, self._known)), None, 0.0,
                           *map(address, (self.here, self.before, self._end, self.lasting, self.stiff, self._pairs, self.inside)),
                           **numbers)

    def hold(self, logarithms: Array, known: NDArray[Any], at: Array, reach: float) -> None:
        """Set the logarithms (count, speeds) of the durations (s) of impacts at SPEEDS. known (count,): whether the effective
        mass of a contact was computed at the positions `at` (k,); reach: change of any of these up to which that mass is used."""
        self._at = np.array(at, dtype=float)
        if logarithms.shape != self._logarithms.shape or len(known) != len(logarithms) or len(self._at) > self._scene.n:
            raise internal(f"the watch over contacts in C was given durations of impacts of shape {logarithms.shape} instead of "
                           f"{self._logarithms.shape}, {len(known)} marks for {len(self._known)} contacts, or "
                           f"{len(self._at)} positions where there are {self._scene.n} unknowns")
        self._logarithms[:], self._known[:] = logarithms, known
        self.table.at, self.table.positions, self.table.reach = address(self._at), len(self._at), reach


#: return codes of the functions of radau.c, where their meaning is stated; besides RAISED: a callback raised an exception
DONE, DIVERGED, ORDER, NO_WIDTH, VANISHED, NO_RATES, LOOK = 0, 3, 4, 5, 6, 7, 8
FIRST, AGAIN = 1, 2  #: values of `StepTable.rejected`: the next step is the first one of the run, or repeats a rejected one
ARRAYS = ("y", "yp", "last", "weights", "power")


class StepTable(ctypes.Structure):
    """The C struct `CollocationRun` of radau.c, with the same members in the same order."""

    _fields_ = (*((name, Pointer) for name in ("stages", "matrix", "rates", "atol", "order")),
                *((name, Number) for name in ("rtol", "time", "target")), ("limit", Whole),
                *((name, Pointer) for name in ARRAYS), *((name, Number) for name in ("last_h", "factored", "power_h")),
                *((name, Whole) for name in ("stale", "fresh", "at_start", "here")),
                *((name, Number) for name in ("h", "exponent", "accepted", "accepted_error")), ("stretches", Stretches),
                ("contacts", Pointer),
                *((name, Number) for name in ("bound", "landing", "smallest", "width", "error", "noise", "noise_t", "noise_h",
                                              "tried", "failed")),
                *((name, Whole) for name in ("careful", "rejected", "held", "rejections", "jacobians", "factorisations",
                                             "iterations", "residuals")))


class AcceptedSteps(NamedTuple):
    """Accepted steps: times t (m,) at their ends, y and y' there (m, n), increments of y from the begin of the step to its inner
    collocation nodes (m, s - 1, n), local error estimates (m,) in units of the tolerance; code: why the call ended."""

    t: Array
    y: Array
    yp: Array
    inner: Array
    errors: Array
    code: int

    def then(self, more: AcceptedSteps) -> AcceptedSteps:
        """These steps followed by those in `more`, as one object."""
        t, y, yp, inner, errors = (np.concatenate(both) for both in zip(self[:-1], more[:-1], strict=True))
        return AcceptedSteps(t, y, yp, inner, errors, more.code)


class CollocationRun(Stepping):
    """An integration under way, which has reached y, yp (n,); table: the present step and the step size control.

    rates: y' = f(t, y), needed by a method whose last stage is not the end of the step, None: not needed; atol, order (n,):
    absolute tolerance and (differentiation index - 1) of each unknown; time: characteristic time of the motion, s; target: error
    of Newton's iteration, over the tolerance, at which it stops; limit: largest number of its iterations.
    """

    def __init__(self, stages: Stages, rates: Equations | None, atol: Array, order: Array, rtol: float, time: float,
                 target: float, limit: int) -> None:
        super().__init__(stages.equations)
        s, n = stages.s, stages.n
        entries, given = stages.matrix.entries.nnz, int(stages.equations.table.nnz)
        self._kept = stages, rates, np.array(atol, dtype=float), np.array(order, dtype=float)
        if any(array.shape != (n,) for array in self._kept[2:]):
            raise internal(f"Radau IIA in C was given absolute tolerances of shape {np.shape(atol)} and indices of shape "
                           f"{np.shape(order)}, it needs one for each of {n} unknowns")
        if given != entries or not stages.equations.table.jacobian:
            raise internal(f"Radau IIA in C was given equations whose Jacobian has {given} entries, and an iteration matrix that "
                           f"has {entries}: it needs as many, and a Jacobian")
        if rates is not None and (rates.table.n != n or not rates.table.rates):
            raise internal(f"Radau IIA in C needs y' as a function of {n} unknowns, and was given one of {rates.table.n}, or "
                           "none")
        self.y, self.yp, self._weights, self._power = np.zeros((4, n))
        self.last = np.zeros((s, n))
        arrays = (self.y, self.yp, self.last, self._weights, self._power)
        self.table = StepTable(
            ctypes.addressof(stages.table), stages.matrix.address, None if rates is None else rates.address,
            *map(address, self._kept[2:]), rtol, time, target, limit, *map(address, arrays), stale=1, exponent=1 / (s + 1),
            accepted_error=1.0, bound=inf, landing=inf, rejected=FIRST)
        self._at, self._c, self._shape = ctypes.addressof(self.table), functions(), (s - 1, n)
        self._room: tuple[NDArray[Any], ...] = (np.empty(0),)  # for accepted steps
        self._begun = [(part, bytes(part)) for part in (self.table, stages.table, stages.matrix.table)]

    def anew(self) -> None:
        """Forget the steps before, as a new object."""
        for part, at_first in self._begun:
            ctypes.memmove(ctypes.addressof(part), at_first, len(at_first))

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

    def steps(self, t: float, end: float, solved: bool, most: float, rows: int) -> AcceptedSteps:
        """Steps from t towards end: at most `rows`, until more than `most` residuals were evaluated or SLICE seconds have passed.
        solved: whether the stages of the first step are solved already."""
        if rows > len(self._room[0]):
            s, n = self._shape
            self._room = tuple(np.empty((rows, *shape)) for shape in ((), (n,), (n,), (s, n), ()))
            self._room_at = [address(part) for part in self._room]
        made = Whole()
        code = self.native(self._c.run_steps, self._at, t, end, solved, most, SLICE, rows, *self._room_at,
                           ctypes.addressof(made))
        times, y, yp, inner, errors = (part[: made.value].copy() for part in self._room)
        return AcceptedSteps(times, y, yp, inner, errors, code)

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
