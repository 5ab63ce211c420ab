"""The shared libraries of SUNDIALS that the package scikit-sundae brings, or was built with. They are opened without importing
this package, because it imports scipy.optimize, which takes up to half a second.

Arguments and results of the loop over the steps of SUNDIALS, which is in sundials.c.
"""

from __future__ import annotations

import ctypes
import re
from ctypes import c_char_p, c_double, c_int, c_int64, c_long, c_void_p
from dataclasses import dataclass
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError
from mbdae.native.equations import Number, Pointer, Stretches, Whole

MAJOR = 7  #: major release of SUNDIALS whose functions are declared here
#: folder of the libraries in the wheels of scikit-sundae: beside the package (Linux, Windows), or inside of it (macOS)
BESIDE, WITHIN = "scikit_sundae.libs", ".dylibs"

_P, _I, _N, _D = c_void_p, c_int, c_int64, c_double  # c_int64 serves for 32-bit indices too: C reads the lower half
_OWN = {
    "SUNDIALSGetVersionNumber": (_I, _P, _P, _P, c_char_p, _I), "SUNContext_Create": (_I, _I, _P), "SUNContext_Free": (_I, _P),
    "SUNContext_ClearErrHandlers": (_I, _P), "SUNContext_GetLogger": (_I, _P, _P), "N_VGetArrayPointer": (_P, _P),
    "SUNLogger_SetErrorFilename": (_I, _P, c_char_p), "SUNLogger_SetWarningFilename": (_I, _P, c_char_p),
    "N_VDestroy": (None, _P), "SUNMatDestroy": (None, _P), "SUNLinSolFree": (_I, _P),
}
#: functions called in the library of IDA: vectors, matrices and the dense linear solver too, which each method's library contains
_IDA = {
    "N_VNew_Serial": (_P, _N, _P), "SUNDenseMatrix": (_P, _N, _N, _P), "SUNDenseMatrix_Data": (_P, _P),
    "SUNLinSol_Dense": (_P, _P, _P, _P), "SUNSparseMatrix": (_P, _N, _N, _N, _I, _P), "SUNSparseMatrix_Data": (_P, _P),
    "SUNSparseMatrix_IndexPointers": (_P, _P), "SUNSparseMatrix_IndexValues": (_P, _P),
    "SUNSparseFromDenseMatrix": (_P, _P, _D, _I), "IDACreate": (_P, _P), "IDAInit": (_I, _P, _P, _D, _P, _P),
    "IDAReInit": (_I, _P, _D, _P, _P), "IDASolve": (_I, _P, _D, _P, _P, _P, _I),
    "IDAGetLastOrder": (_I, _P, _P), "IDASetNonlinearSolver": (_I, _P, _P), "SUNNonlinSol_Newton": (_P, _P, _P),
    "SUNNonlinSolFree": (_I, _P), "SUNNonlinSolSetConvTestFn": (_I, _P, _P, _P), "SUNNonlinSolGetCurIter": (_I, _P, _P),
}
_CVODE = {
    "CVodeCreate": (_P, _I, _P), "CVodeInit": (_I, _P, _P, _D, _P), "CVodeReInit": (_I, _P, _D, _P),
    "CVode": (_I, _P, _D, _P, _P, _I), "CVodeGetDky": (_I, _P, _D, _I, _P),
}
_BOTH = {
    "WFtolerances": (_I, _P, _P), "GetEstLocalErrors": (_I, _P, _P), "SetUserData": (_I, _P, _P),
    "SetLinearSolver": (_I, _P, _P, _P), "SetJacFn": (_I, _P, _P),
    "SetMaxOrd": (_I, _P, _I), "SetInitStep": (_I, _P, _D), "SetMaxNumSteps": (_I, _P, c_long), "SetStopTime": (_I, _P, _D),
    "GetReturnFlagName": (c_char_p, c_long), "Free": (None, _P), "SetMaxStep": (_I, _P, _D),
    "GetCurrentStep": (_I, _P, _P),
}
_SPARSE = {"SUNLinSol_SuperLUMT": (_P, _P, _P, _I, _P)}
FUNCTIONS: dict[str, dict[str, tuple[Any, ...]]] = {
    "core": _OWN, "ida": _IDA | {"IDA" + name: kind for name, kind in _BOTH.items()},
    "cvode": _CVODE | {"CVode" + name: kind for name, kind in _BOTH.items()}, "sunlinsolsuperlumt": _SPARSE,
}

#: modules of scikit-sundae that are linked to these libraries, wherever they are (conda, a build from source): through a module
#: that is opened, the functions of its libraries are found too, but not on Windows
LINKED = {"core": "_cy_ida", "ida": "_cy_ida", "cvode": "_cy_cvode", "sunlinsolsuperlumt": "_cy_ida"}


def unavailable(why: str) -> OptionError:
    """The error of a run that needs SUNDIALS where it cannot be used."""
    return OptionError(f"IDA and CVODE cannot be used here: {why}; mb.RadauIIA(3) and mb.DOP853() do without")


class Functions:
    """The functions of SUNDIALS as attributes. files: paths of its libraries; index: integer type of matrix indices. The library
    of the sparse solver is opened only when its function is first used, because it loads a BLAS library of its own."""

    def __init__(self, files: dict[str, Path]) -> None:
        self._files = files
        for name in ("core", "ida", "cvode"):
            self._open(name)
        major, minor, patch = c_int(), c_int(), c_int()
        label = ctypes.create_string_buffer(64)
        self.SUNDIALSGetVersionNumber(*map(ctypes.byref, (major, minor, patch)), label, len(label))
        if major.value != MAJOR:
            raise unavailable(f"scikit-sundae brings SUNDIALS {major.value}.{minor.value}.{patch.value}, mbdae needs "
                              f"{MAJOR}.x: install a scikit-sundae that brings it")
        self.index = self._index()

    def __getattr__(self, name: str) -> Any:
        """A function by its name; Python calls this only for functions of a library that is not open yet, and it opens that."""
        for library, functions in FUNCTIONS.items():
            if name in functions:
                self._open(library)
                return self.__dict__[name]
        raise AttributeError(name)

    def _open(self, name: str) -> None:
        if name not in self._files:
            raise unavailable(f"the installed scikit-sundae lacks the library {name} of SUNDIALS: install a newer scikit-sundae")
        try:
            opened = ctypes.CDLL(str(self._files[name]))
            for key, (result, *arguments) in FUNCTIONS[name].items():
                function = getattr(opened, key)
                function.restype, function.argtypes = result, arguments
                self.__dict__[key] = function
        except (OSError, AttributeError) as error:
            raise unavailable(f"the file {self._files[name].name} of scikit-sundae cannot be used: {error}; install "
                              "scikit-sundae again") from error

    def _index(self) -> type[np.signedinteger[Any]]:
        """Integer type of matrix indices in this build of SUNDIALS. It is found from the column pointers 0, 1, 2 of a sparse
        identity matrix (2, 2): if they are int64, the first three numbers read as int32 are 0, 0, 1."""
        context = c_void_p()
        self.SUNContext_Create(0, ctypes.byref(context))
        dense = self.SUNDenseMatrix(2, 2, context)
        entries = np.ctypeslib.as_array((c_double * 4).from_address(self.SUNDenseMatrix_Data(dense)))
        entries[:] = 1.0, 0.0, 0.0, 1.0
        sparse = self.SUNSparseFromDenseMatrix(dense, 0.0, 0)
        found = list((ctypes.c_int32 * 3).from_address(self.SUNSparseMatrix_IndexPointers(sparse)))
        self.SUNMatDestroy(sparse)
        self.SUNMatDestroy(dense)
        self.SUNContext_Free(ctypes.byref(context))
        kinds: dict[tuple[int, ...], type[np.signedinteger[Any]]] = {(0, 1, 2): np.int32, (0, 0, 1): np.int64}
        if tuple(found) not in kinds:
            raise unavailable("the SUNDIALS of scikit-sundae takes indices that are neither int32 nor int64 (a test gave "
                              f"{found}): install the scikit-sundae of the package index")
        return kinds[tuple(found)]


@cache
def sundials() -> Functions:
    """The functions of SUNDIALS; raises OptionError where there are none to use."""
    return Functions(files())


def files() -> dict[str, Path]:
    """Name of a library of SUNDIALS, such as "core" or "ida" -> its file, or a module that is linked to it."""
    spec = find_spec("sksundae")
    if spec is None or spec.origin is None:
        raise unavailable("scikit-sundae, which brings SUNDIALS, is not installed: pip install scikit-sundae")
    package = Path(spec.origin).parent
    paths = ((name, package / (module + suffix)) for name, module in LINKED.items() for suffix in EXTENSION_SUFFIXES)
    found = {name: path for name, path in paths if path.is_file()}
    for folder in (package.parent / BESIDE, package / WITHIN):
        for path in sorted(folder.glob("*sundials_*")):
            name = re.match(r"(?:lib)?sundials_([a-z]+)", path.name)
            if name is not None:
                found[name[1]] = path
    return found


Array = NDArray[np.float64]

#: largest number of steps in a `Block`, and largest size in bytes of their y, y' and dense output, of which one step always fits
MOST_ROWS, BLOCK_BYTES = 4096, 2**22


class RunStruct(ctypes.Structure):
    """The C struct `RunStruct` of sundials.c, with the same members in the same order."""

    _fields_ = (
        ("e", Pointer), ("array", Pointer), ("data", Pointer), ("columns", Pointer), ("rows", Pointer), ("ida", Pointer),
        ("cvode", Pointer), ("until", Pointer), ("interpolant", Pointer), ("memory", Pointer), ("y_vector", Pointer),
        ("yp_vector", Pointer), ("inner_vector", Pointer), ("own_columns", Pointer), ("own_rows", Pointer),
        ("columns_bytes", Whole), ("rows_bytes", Whole), ("place", Pointer), ("fy", Pointer), ("fyp", Pointer),
        ("nodes", Pointer), ("atol", Pointer), ("rtol", Number), ("tame", Number), ("smooth", Whole), ("most", Number),
        ("toward", Number), ("evaluations", Whole), ("rejected", Whole), ("jacobians", Whole), ("choosing", Whole),
        ("renew", Whole), ("renewing", Whole), ("begun", Whole), ("fresh", Whole), ("t", Number), ("cj", Number),
        ("y", Pointer), ("yp", Pointer),
        ("values", Pointer), ("jacobian_t", Number), ("jacobian_y", Pointer), ("from_t", Number), ("last_step", Number),
        ("from_y", Pointer), ("from_yp", Pointer), ("inner", Pointer), ("pieces", Whole),
        ("iteration", Pointer), ("correction", Number), ("longest", Pointer), ("planned", Pointer), ("errors", Pointer),
        ("order", Pointer), ("wider", Pointer), ("unseen", Number), ("narrow", Number),
        ("low", Whole), ("before", Whole), ("held", Whole), ("cap", Number),
        ("stretches", Stretches),
    )


@dataclass(frozen=True)
class Settings:
    """Settings of IDA and CVODE: tolerances (atol (n,)), highest order, first step (s; 0: chosen by the solver)."""

    rtol: float
    atol: Array
    order: int
    first_step: float = 0.0


@dataclass(frozen=True)
class Steps:
    """Steps made in one call: times t (m,) at their ends, y and yp (m, n) there; pieces: of each step the dense output inside it
    (inner, n), or None where none is stored.

    code: negative, or STUCK, where the method could not continue after the last step."""

    t: Array
    y: Array
    yp: Array
    pieces: list[Any]
    code: int


class Block:
    """Arrays that C fills with steps of n unknowns, each with `inner` points of dense output; the arrays in `Steps` are views of
    them."""

    def __init__(self, n: int, inner: int) -> None:
        self.room = max(1, min(MOST_ROWS, BLOCK_BYTES // (8 * n * (2 + inner))))
        self.t, self.y, self.yp = np.empty(self.room), np.empty((self.room, n)), np.empty((self.room, n))
        self.stored = np.zeros(self.room, dtype=np.int64)
        self.inner = np.empty((self.room, inner, n))
        self.made = 0
        self._addresses = [(a.ctypes.data, a.strides[0]) for a in (self.t, self.y, self.yp, self.stored)]

    def addresses(self) -> list[int]:
        """Addresses of the first rows of t, y, yp and stored that have no step yet, where C writes the next ones."""
        return [first + self.made * stride for first, stride in self._addresses]
