"""Modules that take longer to import than a pendulum to simulate. SciPy's are imported when they are first used, because most
scenes need none of them, and so is what mbdae has for beams, contacts and SUNDIALS; NumPy's masked arrays are never imported:
functions here replace those of NumPy that would do so. Folders of classes that say everything of themselves (solvers, forms) are
imported whole where their names are asked for."""

from __future__ import annotations

import re
import sys
from functools import cache
from importlib import import_module
from inspect import isabstract
from pathlib import Path
from pkgutil import ModuleInfo, walk_packages
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import say
from mbdae.threads import limit_what_was_loaded

__all__ = ["Later", "LinearOperator", "as_full", "bmat", "classes_in", "connected_components", "csc_matrix", "csr_matrix",
           "cython_lapack", "dijkstra", "distinct", "eigh", "eigs", "eigsh", "eigvals", "entered", "entries_of",
           "group_columns", "identity", "issparse", "later", "maximum_flow", "median", "qr", "sp", "splu"]


class Later:
    """A module, or a function or class in it, that is imported at its first use. No object is an instance of a class whose module
    has not been imported."""

    def __init__(self, module: str, name: str = "") -> None:
        self._place = module, name

    def _found(self) -> Any:
        module, name = self._place
        known = "scipy.linalg" in sys.modules
        found = import_module(module)
        if not known and "scipy.linalg" in sys.modules:
            limit_what_was_loaded()
        return getattr(found, name) if name else found

    def __getattr__(self, name: str) -> Any:
        return getattr(self._found(), name)

    def __call__(self, *args: Any, **options: Any) -> Any:
        return self._found()(*args, **options)

    def __instancecheck__(self, value: Any) -> bool:
        return self._place[0] in sys.modules and isinstance(value, self._found())


def later(module: str, *names: str) -> tuple[Later, ...]:
    """Several functions or classes of one module, each imported at its first use."""
    return tuple(Later(module, name) for name in names)


if TYPE_CHECKING:
    import scipy.sparse as sp
    from scipy.linalg import cython_lapack, eigh, eigvals, qr
    from scipy.optimize._numdiff import group_columns
    from scipy.sparse import bmat, csc_matrix, csr_matrix, identity, issparse
    from scipy.sparse.csgraph import connected_components, dijkstra, maximum_flow
    from scipy.sparse.linalg import LinearOperator, eigs, eigsh, splu
else:

    sp, cython_lapack = Later("scipy.sparse"), Later("scipy.linalg.cython_lapack")
    bmat, csc_matrix, csr_matrix, identity = later("scipy.sparse", "bmat", "csc_matrix", "csr_matrix", "identity")
    eigh, eigvals, qr = later("scipy.linalg", "eigh", "eigvals", "qr")
    group_columns = Later("scipy.optimize._numdiff", "group_columns")
    connected_components, dijkstra, maximum_flow = later(
        "scipy.sparse.csgraph", "connected_components", "dijkstra", "maximum_flow")
    LinearOperator, eigs, eigsh, splu = later("scipy.sparse.linalg", "LinearOperator", "eigs", "eigsh", "splu")

    def issparse(matrix: Any) -> bool:
        """Whether a matrix is sparse; False where SciPy's module of sparse matrices has not been imported yet."""
        return "scipy.sparse" in sys.modules and sp.issparse(matrix)


T = TypeVar("T")


@cache
def classes_in(folder: str, base: type[T], called: str = "") -> tuple[type[T], ...]:
    """The classes of a folder ("mbdae.integrators") that derive from `base` and leave nothing abstract, by name, without those
    whose name begins with an underscore. A new one needs no more than its file there. called: a word; files that have not been
    imported are where their text has a class, or its `word`, with which the word begins, in small letters and digits."""
    top = import_module(folder)
    modules = [import_module(found.name) for found in walk_packages(getattr(top, "__path__", ()), f"{folder}.")
               if not called or found.name in sys.modules or called.startswith(tuple(_words_of(found)))]
    found = {made.__name__: made for module in (top, *modules) for name, made in vars(module).items()
             if name[0] != "_" and isinstance(made, type) and issubclass(made, base) and not isabstract(made)}
    return tuple(made for _, made in sorted(found.items()))


@cache
def entered(group: str, *bases: type) -> dict[str, type[Any]]:
    """The classes, derived from one of `bases`, that installed packages enter in a group of entry points, by the names of the
    entries. What cannot be imported, or is no such class, is told and left out."""
    from importlib.metadata import entry_points

    found, kinds = {}, " or ".join(base.__name__ for base in bases)
    for entry in entry_points(group=group):
        left_out = f"'{entry.value}', which an installed package enters in {group}, is left out"
        try:
            made = entry.load()
        except Exception as error:
            say(f"{left_out}: {type(error).__name__}: {error}")
            continue
        if isinstance(made, type) and issubclass(made, bases) and not isabstract(made):
            found[entry.name] = made
        else:
            say(f"{left_out}: it is no class derived from {kinds}")
    return found


def _words_of(module: ModuleInfo) -> list[str]:
    """Names and words of the classes that the file of a module states, in small letters."""
    found = module.module_finder.find_spec(module.name, None)
    text = Path(found.origin).read_text(encoding="utf-8") if found is not None and found.origin else ""
    return [word.lower() for word in re.findall(r'^(?:class |    word: ClassVar\[str\] = ")([A-Za-z]\w*)', text, re.M)]


def as_full(matrix: Any) -> Any:
    """A matrix as a full array, whether it is sparse or not."""
    return matrix.toarray() if issparse(matrix) else matrix


def entries_of(matrix: Any) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Rows, columns and values (k,) of the entries of a matrix, sparse or full; of a full one those that are not zero."""
    if issparse(matrix):
        found = matrix.tocoo()
        return found.row, found.col, found.data
    at = np.nonzero(matrix)
    return *at, matrix[at]


def distinct(values: Any) -> NDArray[Any]:
    """Numbers without repetitions, rising, in place of np.unique, which imports masked arrays first (15 ms)."""
    return np.asarray(np.unique(values, return_index=True)[0])


def median(values: Any, axis: int | None = None) -> Any:
    """Median of finite numbers, in place of np.median, which imports masked arrays too."""
    ordered = np.sort(values, axis)
    count = ordered.shape[axis or 0]
    return (np.take(ordered, (count - 1) // 2, axis) + np.take(ordered, count // 2, axis)) / 2
