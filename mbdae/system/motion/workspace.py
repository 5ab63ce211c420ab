"""The workspace of a numbering as the array of a native program, with the operations that fill it: values prescribed in time, and
the motion of loaded nodes."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import sp
from mbdae.errors import internal
from mbdae.kernels.tree_plan import Piece
from mbdae.native.program import Operations, Scene, core
from mbdae.system.base import Array
from mbdae.system.model.numbering import Numbering

Index = NDArray[np.intp]
BANDED_FROM = 64  #: number of rows from which `narrow_order` reorders them; with fewer it does not pay
Loaded = Sequence[tuple[Piece, Index, Index]]  #: kernels of trees, each with the slots it reads and those of its values


class Workspace:
    """A native program on the workspace of a numbering. Its first operations evaluate the values prescribed in time (`clock`),
    and the motion of loaded nodes by kernels of trees (`motion`); subclasses append others."""

    def __init__(self, numbering: Numbering, motion: Loaded = ()) -> None:
        self.numbering, self.n = numbering, numbering.n
        self.operations = Operations(numbering.width)
        self.at = self.operations.slots(2)
        self.clock = self.operations.part()
        if numbering.clock.expressions:
            numbering.clock.emit(self.clock, self.at, numbering.first_input)
        self.motion = self.operations.part()
        for piece, gather, places in motion:
            self.motion.set(places, piece.kernel.emit(self.motion, gather))

    def finish(self, residual: Operations | None = None, jacobian: Operations | None = None, rates: Operations | None = None,
               unknowns: int | None = None, rates_at: int = 0, **slots: int) -> None:
        """Allocate the array and make the table that C reads, after which no operations can be added.

        residual, jacobian, rates: lists of operations; unknowns: length of the y that C is given, by default n; rates_at: slot of
        the result y'; slots: first slots `rows`, `fy` and `fyp` of the other results, as in `Scene`."""
        nb = self.numbering
        self.W = np.zeros(self.operations.size)
        self.W[: nb.width] = nb.workspace(1)[0]
        self.operations.fill(self.W)
        self.of_rates = rates
        parts = {"clock": self.clock, "residual": residual, "jacobian": jacobian, "rates": rates}
        self._parts = {name: part for name, part in parts.items() if part is not None}
        self._x = np.zeros(max(part.widest for part in self._parts.values()) + 1)
        self._kept: list[Any] = [nb]
        self.scene = Scene(W=self.W.ctypes.data, x=self._x.ctypes.data, n=self.n if unknowns is None else unknowns,
                           dotted=self.n, at=self.at, rates=rates_at, bad=-1, read=nb.model.conditions.read.ctypes.data,
                           t=np.nan, side=np.nan, **slots)  # fmt: skip
        self.make("clock")
        self.address = ctypes.addressof(self.scene)
        (self._y, self._at_y), (self._yp, self._at_yp) = self.view(0, self.scene.n), self.view(self.n, self.scene.n)
        self._rates, self._at_rates = self.view(rates_at, self.scene.n)
        self._call_rates = core().scene_rates

    def make(self, *parts: str) -> None:
        """Compile those of the parts "residual", "jacobian" and "rates" that are not compiled yet; to be called before they
        run."""
        for name in parts:
            if name in self._parts:
                table, kept = self._parts[name].table(len(self.W))
                setattr(self.scene, "of_rates" if name == "rates" else name, table)
                self._kept.append(kept)
                del self._parts[name]

    def view(self, first: int, count: int) -> tuple[Array, int]:
        """View of `count` numbers from slot `first` on, and its address, which callers store because asking NumPy for it takes
        long."""
        found = self.W[first : first + count]
        return found, found.ctypes.data

    def solved(self, t: float, y: Array, out: Array) -> int:
        """out[:] = y'. Returns the number of the row at which a factorisation failed, because it depends on those before it, or
        -1."""
        self.make("rates")
        self._y[:] = y
        code = self._call_rates(self.address, t, self._at_y, self._at_rates)
        out[:] = self._rates
        return int(self.scene.bad) if code > 0 else -1


class Values(Workspace):
    """Evaluates kernels at given states, such as that of the gaps of contacts."""

    def __init__(self, numbering: Numbering, motion: Loaded, gathers: Sequence[Index], kernels: Sequence[Any]) -> None:
        super().__init__(numbering, motion)
        self._made_of = numbering, motion, gathers, kernels
        part = self.operations.part(self.motion)
        pieces = [kernel.emit(part, gather).ravel() for gather, kernel in zip(gathers, kernels, strict=True)]
        at = np.concatenate([np.zeros(0, dtype=np.intp), *pieces])
        self.width, first = len(at), self.operations.slots(len(at))
        part.set(first + np.arange(len(at)), at)
        self.finish(part, rows=first)
        self.make("residual")
        self._call = core().scene_values

    def __reduce__(self) -> tuple[Any, ...]:
        """For copies: a copy makes its own tables, because they contain addresses of arrays."""
        return Values, self._made_of

    def at_states(self, t: Array, y: Array) -> Array:
        """(k, values) at times (k,) and unknowns y (k, n or more)."""
        t, y = np.ascontiguousarray(t, dtype=float), np.ascontiguousarray(y, dtype=float)
        if y.shape != (len(t), max(self.n, y.shape[1])):
            raise internal(f"states of shape {y.shape} were given at {len(t)} times: ({len(t)}, {self.n} or more) is needed")
        out = np.empty((len(t), self.width))
        self._call(self.address, len(t), t.ctypes.data, y.ctypes.data, y.shape[1], self.width, out.ctypes.data)
        return out


class Columns(NamedTuple):
    """Sparsity pattern of a matrix (n, n), column by column: first (n + 1,) where each column begins, rows (nnz,) of the
    entries."""

    first: Index
    rows: Index


def narrow_order(n: int, i: Index, j: Index) -> tuple[Index, Index]:
    """An order of n rows and columns in which a symmetric matrix with entries at (i, j) has a narrow band, and the position of
    each row in it."""
    order = np.arange(n)
    if n >= BANDED_FROM:
        from scipy.sparse.csgraph import reverse_cuthill_mckee  # imported here because small scenes do not need it

        graph = sp.csr_matrix((np.ones(len(i)), (i, j)), shape=(n, n))
        order = reverse_cuthill_mckee(graph, symmetric_mode=True).astype(np.intp)
    place = np.empty(n, dtype=np.intp)
    place[order] = np.arange(n)
    return order, place
