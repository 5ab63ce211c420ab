"""IDA and CVODE of SUNDIALS, in the shared libraries that scikit-sundae brings, for equations given as an `Equations` table.

Only functions of SUNDIALS are called and no members of its structures are read: the layout of structures differs between
releases, the functions are the same in all of 7.x. Linear systems are solved by solvers of the same libraries: dense LU, or
SuperLU_MT for matrices with a sparsity pattern.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from contextlib import ExitStack
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mbdae.native import declared
from mbdae.native.equations import Equations, Number, Pointer, Stretches, Whole, seen
from mbdae.native.sundials_library import MOST_ROWS, Array, Block, RunStruct, Settings, Steps, sundials
from mbdae.process import Signals

#: wall time (s) after which a call of the step loop in C returns, so that Python handles Ctrl-C, limits and progress
SLICE = 0.05
STUCK = 1000
CSC = 0  #: argument of SUNSparseMatrix for matrices stored by columns (CSC)
ADAMS, BDF = 1, 2
SAID = {
    "ERR_FAIL": "the error test failed too many times", "CONV_FAIL": "Newton's iteration failed too many times",
    "TOO_MUCH_ACC": "the tolerance is below the round-off", "REP_RES_ERR": "the equations are not finite wherever it was tried",
    "REPTD_RHSFUNC_ERR": "the equations are not finite wherever it was tried",
}


class Method:
    """A solver of SUNDIALS (IDA or CVODE) and the memory that SUNDIALS allocated for it, which `close` frees; a context manager.

    y, yp, values (n,): the state at which SUNDIALS last evaluated the equations, and the residual (IDA) or y' (CVODE) there; t:
    its time, s; cj: the factor in the Jacobian dF/dy + cj dF/dy' evaluated last.
    """

    inner = 0  #: number of points inside a step at which dense output is stored, see `Steps.pieces`
    prefix: str  #: prefix of the names of the solver's functions in SUNDIALS: IDA or CVode
    jacobian: str  #: function of sundials.c that makes the Jacobian

    def __init__(self, equations: Equations, settings: Settings, start: tuple[float, Array, Array]) -> None:
        self.equations, self.settings, self.signals = equations, settings, Signals()
        self.S, self.C, self.run = sundials(), core(), RunStruct()
        self.n = n = int(equations.table.n)
        t, y, yp = start
        self.y, self.yp, self.values, self._jacobian_y = np.array(y), np.array(yp), np.zeros(n), np.zeros(n)
        self._atol = np.array(settings.atol, dtype=float)
        self._kept: list[Any] = []
        self._block: Block | None = None
        self._before: Block | None = None
        self._start = [self.y]
        self._free = ExitStack()
        with ExitStack() as failed:
            failed.callback(self.close)
            self._context = self._silent_context()
            self._y, self._yp, self._own = self._vector(y), self._vector(yp), self._vector(y)
            self._fill(equations)
            matrix, solver = self._linear_solver()
            self.memory = self._create()
            self.run.memory = self.memory
            free = Pointer(self.memory)
            self._free.callback(lambda: self._call("Free", ctypes.byref(free), checked=False))
            self._set_up(t, matrix, solver)
            failed.pop_all()

    def __enter__(self) -> Self:
        self.equations.caught.signals = self.signals.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self.equations.caught.signals = None
        self.close()
        self.signals.__exit__(*error)

    def close(self) -> None:
        """Free what SUNDIALS allocated."""
        self._free.close()

    def _create(self) -> int:
        """Allocate the memory of the solver; returns its address."""
        raise NotImplementedError

    def _initialise(self, t: float) -> None:
        """Give SUNDIALS the initial values at t (s), and the functions by which it evaluates the equations."""
        raise NotImplementedError

    # -- counts and the last point

    @property
    def t(self) -> float:
        """Time of the last evaluation, s."""
        return float(self.run.t)

    @property
    def cj(self) -> float:
        """Factor of dF/dy' in the newest Jacobian."""
        return float(self.run.cj)

    @property
    def counts(self) -> tuple[int, int, int]:
        """Numbers of evaluations of the equations, of rejected steps and of Jacobians so far."""
        return self.run.evaluations, self.run.rejected, self.run.jacobians

    def newest(self) -> tuple[float, Array] | None:
        """Time and state of the Jacobian evaluated last, None if none was evaluated since the last call of this function."""
        fresh, self.run.fresh = self.run.fresh, 0
        return (self.run.jacobian_t, self._jacobian_y.copy()) if fresh else None

    def renew(self) -> None:
        """Let SUNDIALS evaluate a new Jacobian at the begin of the next step."""
        self.run.renew = 1

    # -- steps

    def bound(self, edges: Any, share: float, kinks: Any = (), unseen: float = -np.inf) -> None:
        """Limit the length of steps, see `Stretches.of`; unseen: time (s) until which something grows that error tests do not
        see."""
        found = Stretches.of(edges, share, kinks)
        self._limits, self.run.stretches, self.run.unseen = found.kept, found, unseen

    def begin(self, t: float, y: Array, yp: Array) -> None:
        """Restart at time t (s) from y, yp (n,)."""
        self._view(self._y)[:], self._view(self._yp)[:] = y, yp
        self.run.from_y, self.run.begun, self.run.narrow = None, 0, 1.0
        self.run.choosing = int(self.prefix == "CVode")
        self._call("ReInit", t, *self._start_vectors())

    def advance(self, start: tuple[float, Array, Array], last_step: float, stop: float, toward: float, rows: int = MOST_ROWS,
                left: float = np.inf) -> Steps:
        """Make steps from the last accepted point, `start` (t, y, y'), up to the time `stop`; end after `rows` steps, `left`
        evaluations, or SLICE seconds of wall time. last_step: length of the step before (s); toward: end of the run (s).
        `raise_error` afterwards raises exceptions of callbacks."""
        block, run = self._block, self.run
        if block is None or block.made == block.room:
            self._before, self._block = block, Block(self.n, self.inner)  # C still reads the last step in the old block
            block = self._block
            run.inner, run.pieces = block.inner.ctypes.data, 0
        if self.inner and (run.from_y is None or start[0] != run.from_t):  # where not, C still has this start itself
            y, yp = self._start = [np.ascontiguousarray(a, dtype=float) for a in start[1:]]
            run.from_y, run.from_yp = y.ctypes.data, yp.ctypes.data
        run.from_t, run.last_step, run.toward, first_piece = start[0], last_step, toward, run.pieces
        run.most = run.evaluations + left
        made, room = Whole(0), min(rows, block.room - block.made)
        self.signals.inside = True
        try:
            code = self.C.sundials_steps(ctypes.byref(run), stop, SLICE, room, *block.addresses(), ctypes.byref(made))
        finally:
            self.signals.inside = False
        part = slice(block.made, block.made + made.value)
        block.made = part.stop
        pieces: list[Any] = [None] * made.value
        if run.pieces > first_piece:
            stored = np.flatnonzero(block.stored[part]).tolist() if len(pieces) > 1 else [0]
            for step, piece in zip(stored, block.inner[first_piece : first_piece + len(stored)], strict=True):
                pieces[step] = piece
        return Steps(block.t[part], block.y[part], block.yp[part], pieces, code)

    def raise_error(self) -> None:
        """Raise the exception of a callback, if one was raised; else call the handlers of signals that arrived while C ran."""
        self.equations.raise_error()
        self.signals.deliver()

    def reason(self, code: int) -> str:
        """Meaning of a return code, for messages."""
        if code == STUCK:
            return "the step became smaller than the round-off of the time t"
        name = _flag_name(self.prefix, code)
        word = name.partition("_")[2].replace("FAILURE", "FAIL")
        return f"{SAID[word]} ({name})" if word in SAID else name

    # -- vectors, matrices and linear solvers

    def _call(self, name: str, *args: Any, checked: bool = True) -> Any:
        """Call the function of the solver with this name, without prefix, on its memory. checked: RuntimeError where it returns a
        negative code."""
        function = getattr(self.S, self.prefix + name)
        code = function(*args) if name == "Free" else function(self.memory, *args)
        if checked and code < 0:
            raise RuntimeError(f"SUNDIALS refused a call of its function {self.prefix}{name}: {self.reason(code)}. This is an "
                               "error in mbdae, not in what you stated: please report it with the scene; mb.RadauIIA(3) does "
                               "without")
        return code

    def _owned(self, made: int | None, free: Callable[..., Any]) -> int:
        """Register the object at the address `made`, which SUNDIALS allocated, to be freed by `close`; returns the address."""
        if not made:
            raise MemoryError(f"no memory is left for {self.prefix} of SUNDIALS: end other programs, or take fewer unknowns")
        self._free.callback(free, made)
        return made

    def _silent_context(self) -> int:
        """A SUNContext that prints neither errors nor warnings."""
        S, context, logger = self.S, Pointer(), Pointer()
        S.SUNContext_Create(0, ctypes.byref(context))
        self._free.callback(lambda: S.SUNContext_Free(ctypes.byref(context)))
        S.SUNContext_ClearErrHandlers(context)
        S.SUNContext_GetLogger(context, ctypes.byref(logger))
        for name in ("Error", "Warning"):
            getattr(S, f"SUNLogger_Set{name}Filename")(logger, os.devnull.encode())
        return context.value or 0

    def _vector(self, values: Array) -> int:
        made = self._owned(self.S.N_VNew_Serial(self.n, self._context), self.S.N_VDestroy)
        self._view(made)[:] = values
        return made

    def _view(self, vector: int) -> Array:
        return seen(self.S.N_VGetArrayPointer(vector), self.n)

    def _address(self, array: NDArray[Any]) -> int:
        """Address of an array; a reference to the array is stored, so that Python does not free it while C uses it."""
        self._kept.append(array)
        return array.ctypes.data

    def _fill(self, equations: Equations) -> None:
        run, S, at, nnz = self.run, self.S, self._address, int(equations.table.nnz)
        run.e, run.array, run.data = equations.address, _pointer(S.N_VGetArrayPointer), _pointer(S.SUNDenseMatrix_Data)
        run.y_vector, run.yp_vector, run.inner_vector = self._y, self._yp, self._own
        run.fy, run.fyp = at(np.zeros(nnz)), at(np.zeros(nnz))
        names = "SetStopTime", "SetMaxStep", "GetCurrentStep", "GetEstLocalErrors"
        run.until, run.longest, run.planned, run.errors = (_pointer(getattr(S, self.prefix + name)) for name in names)
        run.unseen, run.narrow, run.wider = -np.inf, 1.0, at(np.ones(self.n))
        run.atol, run.rtol = at(self._atol), self.settings.rtol
        run.y, run.yp, run.values, run.jacobian_y = map(at, (self.y, self.yp, self.values, self._jacobian_y))
        run.t, run.cj, run.most = -np.inf, 1.0, np.inf

    def _set_up(self, t: float, matrix: int, solver: int) -> None:
        settings, user = self.settings, ctypes.addressof(self.run)
        self._initialise(t)
        self._call("WFtolerances", self.C.sundials_weights)
        self._call("SetUserData", user)
        self._call("SetLinearSolver", solver, matrix)
        self._call("SetJacFn", getattr(self.C, self.jacobian))
        self._call("SetMaxOrd", settings.order)
        self._call("SetInitStep", settings.first_step)
        self._call("SetMaxNumSteps", -1)  # a negative number: steps are not limited

    def _start_vectors(self) -> tuple[int, ...]:
        return (self._y,)

    def _linear_solver(self) -> tuple[int, int]:
        """Make a dense matrix and its linear solver; returns their addresses."""
        S, n = self.S, self.n
        matrix = self._owned(S.SUNDenseMatrix(n, n, self._context), S.SUNMatDestroy)
        return matrix, self._owned(S.SUNLinSol_Dense(self._y, matrix, self._context), S.SUNLinSolFree)


class Ida(Method):
    """IDA: variable-order BDF for F(t, y, y') = 0.

    pattern: sparsity pattern of the Jacobian (CSC), None: full; sparse: whether linear systems are solved by SuperLU_MT;
    differences: whether the (full) Jacobian is made by differences of the residual; raising: whether it
    is led out of low orders where it stays there (`raise_order` of sundials.c)."""

    prefix = "IDA"

    def __init__(self, *args: Any, pattern: Any = None, sparse: bool = False, differences: bool = False,
                 raising: bool = False) -> None:
        self._raising = raising
        self._pattern, self._sparse, self.jacobian = pattern, sparse, "ida_differences" if differences else "ida_jacobian"
        super().__init__(*args)

    def _linear_solver(self) -> tuple[int, int]:
        """Make a dense matrix and its linear solver, or a sparse matrix of the pattern and SuperLU_MT; returns their
        addresses."""
        S, n, run, pattern, nnz = self.S, self.n, self.run, self._pattern, int(self.equations.table.nnz)
        if not self._sparse:
            if nnz != n * n:  # the Jacobian has a pattern: where each of its entries is in the dense matrix, stored by columns
                run.place = self._address(pattern.indices + n * np.repeat(np.arange(n, dtype=np.int64), np.diff(pattern.indptr)))
            return super()._linear_solver()
        matrix = self._owned(S.SUNSparseMatrix(n, n, nnz, CSC, self._context), S.SUNMatDestroy)
        columns, rows = (np.array(a, dtype=S.index) for a in (pattern.indptr, pattern.indices))
        run.own_columns, run.columns_bytes, run.own_rows, run.rows_bytes = (
            self._address(columns), columns.nbytes, self._address(rows), rows.nbytes)
        run.data = _pointer(S.SUNSparseMatrix_Data)
        run.columns, run.rows = _pointer(S.SUNSparseMatrix_IndexPointers), _pointer(S.SUNSparseMatrix_IndexValues)
        made = S.SUNLinSol_SuperLUMT(self._y, matrix, 1, self._context)
        return matrix, self._owned(made, S.SUNLinSolFree)

    def _create(self) -> int:
        return int(self.S.IDACreate(self._context))

    def _initialise(self, t: float) -> None:
        run, S = self.run, self.S
        run.ida = _pointer(S.IDASolve)
        run.iteration = _pointer(S.SUNNonlinSolGetCurIter)
        if self._raising:
            run.order = _pointer(S.IDAGetLastOrder)
        self._call("Init", self.C.ida_residual, t, self._y, self._yp)
        newton = self._owned(S.SUNNonlinSol_Newton(self._y, self._context), S.SUNNonlinSolFree)
        self._call("SetNonlinearSolver", newton)
        S.SUNNonlinSolSetConvTestFn(newton, self.C.ida_converged, ctypes.addressof(run))

    def _start_vectors(self) -> tuple[int, ...]:
        return self._y, self._yp


class Cvode(Method):
    """CVODE: variable-order Adams or BDF for y' = f(t, y).

    multistep: ADAMS or BDF; nodes: fractions of a step at which dense output of CVODE is stored in `Steps.pieces`. tame: where it
    is above 0, dense output is stored only for steps longer than `tame` times the step before."""

    prefix, jacobian, inner = "CVode", "cvode_jacobian", 4

    def __init__(self, *args: Any, multistep: int, nodes: Array, tame: float = 0.0) -> None:
        self._multistep, self._nodes, self._tame = multistep, np.array(nodes), tame
        super().__init__(*args)

    def _create(self) -> int:
        return int(self.S.CVodeCreate(self._multistep, self._context))

    def _initialise(self, t: float) -> None:
        run, S = self.run, self.S
        run.cvode, run.interpolant = _pointer(S.CVode), _pointer(S.CVodeGetDky)
        run.nodes, run.tame, run.smooth, run.choosing = self._address(self._nodes), self._tame, int(self._tame > 0), 1
        self._call("Init", self.C.cvode_rates, t, self._y)


#: function that opens the library and states the types of the functions of sundials.c for ctypes
core = declared(("sundials_steps", ctypes.c_int, (Pointer, Number, Number, Whole, *[Pointer] * 5)))


@cache
def _flag_name(prefix: str, code: int) -> str:
    """Name of a return code, such as IDA_ERR_FAIL; cached, because SUNDIALS allocates the text at every call and never frees
    it."""
    name = getattr(sundials(), f"{prefix}GetReturnFlagName")(code)
    return name.decode() if name else str(code)


def _pointer(function: Any) -> int:
    """Address of a function of a shared library."""
    return ctypes.cast(function, Pointer).value or 0
