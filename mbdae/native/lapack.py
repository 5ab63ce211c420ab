"""Functions of LAPACK, for C."""

from __future__ import annotations

import ctypes
from functools import cache

from mbdae.deferred import cython_lapack
from mbdae.native.equations import Pointer


@cache
def lapack(name: str) -> int:
    """Address of a function of LAPACK in the library that SciPy brings."""
    capsule, api = cython_lapack.__pyx_capi__[name], ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = ctypes.c_char_p, [ctypes.py_object]
    api.PyCapsule_GetPointer.restype, api.PyCapsule_GetPointer.argtypes = Pointer, [ctypes.py_object, ctypes.c_char_p]
    return int(api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule)))
