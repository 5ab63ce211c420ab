"""The workspace of a numbering as an array of a native program: unknowns, values prescribed in time, motion of loaded nodes."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded

from mbdae.kernels.tree_plan import Piece
from mbdae.native.program import Operations, Part, Scene, core
from mbdae.system.base import Array
from mbdae.system.model.numbering import Numbering

Index = NDArray[np.intp]
BANDED_FROM = 64  #: rows from which an order with a narrow band is looked for
Loaded = Sequence[tuple[Piece, Index, Index]]  #: kernels of trees, the slots they read, the places of their values


class Workspace:
    """The workspace of a numbering with its clock (values prescribed in time) and the motion of loaded nodes, by kernels of
    trees."""

    def __init__(self, numbering: Numbering, motion: Loaded = ()) -> None:
        self.numbering, self.n = numbering, numbering.n
        self.operations = Operations(numbering.width)
        self.at = self.operations.slots(2)
        self.clock = self.operations.part()
        if numbering.clock.expressions:
            numbering.clock.emit(self.clock, np.array([[self.at, self.at + 1]]), numbering.first_input)
        self.motion = self.operations.part()
        for piece, gather, places in motion:
            values = piece.kernel.emit(self.motion, gather)
            self.motion.set(places, values + np.arange(places.size))

    def finish(self, residual: Operations | None = None, jacobian: Operations | None = None, rates: Operations | None = None,
               unknowns: int | None = None, rates_at: int = 0, **slots: int) -> None:
        """Make the tables of C and the workspace. unknowns: how many of them are given, by default all; rates_at: slot of y';
        slots: `rows`, `fy` and `fyp`, as in `Scene`."""
        size, nb = self.operations.size, self.numbering
        self.W = np.zeros(size)
        self.W[: nb.width] = nb.workspace(1)[0]
        parts = {"clock": self.clock, "residual": residual, "jacobian": jacobian, "of_rates": rates}
        self.of_rates = rates
        self._x = np.zeros(max((p.widest for p in parts.values() if p is not None), default=0) + 1)
        self._kept: list[Any] = [nb]
        tables = {name: self.table(part) for name, part in parts.items() if part is not None}
        self.scene = Scene(W=self.W.ctypes.data, x=self._x.ctypes.data, n=self.n if unknowns is None else unknowns,
                           dotted=self.n, at=self.at, rates=rates_at, bad=-1, read=nb.model.conditions.read.ctypes.data,
                           t=np.nan, side=np.nan, **tables, **slots)  # fmt: skip
        self.address = ctypes.addressof(self.scene)

    def table(self, part: Operations) -> Part:
        """The operations of a part as C reads them."""
        if part.widest >= len(self._x):
            raise ValueError(f"a kernel reads {part.widest} numbers, room is for {len(self._x)}")
        made, kept = part.table(len(self.W))
        self._kept.append(kept)
        return made

    def check(self, code: int) -> None:
        """Raise what a function of Python raised in a native call."""
        if code < 0 and self.operations.errors:
            error = self.operations.errors[0]
            self.operations.errors.clear()
            raise error


class Values(Workspace):
    """Values of kernels at states, such as the gaps of contacts: at(t, y) of every state in rows."""

    def __init__(self, numbering: Numbering, motion: Loaded, gathers: Sequence[Index], kernels: Sequence[Any]) -> None:
        super().__init__(numbering, motion)
        self._made_of = numbering, motion, gathers, kernels
        part = self.operations.part(self.motion)
        pieces = [kernel.emit(part, gather) + np.arange(gather.shape[0] * kernel.width)
                  for gather, kernel in zip(gathers, kernels, strict=True)]  # fmt: skip
        at = np.concatenate([np.zeros(0, dtype=np.intp), *pieces])
        self.width, first = len(at), self.operations.slots(len(at))
        part.set(first + np.arange(len(at)), at)
        self.finish(part)
        self._first, self._call = first, core().scene_values
        self._part = ctypes.addressof(self.scene) + Scene.residual.offset

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy makes its own tables: addresses are those of this object's arrays."""
        return Values, self._made_of

    def at_states(self, t: Array, y: Array) -> Array:
        """(k, values) at times (k,) and unknowns y (k, n or more)."""
        t, y = np.ascontiguousarray(t, dtype=float), np.ascontiguousarray(y, dtype=float)
        if y.shape != (len(t), max(self.n, y.shape[1])):
            raise ValueError(f"states {y.shape} at {len(t)} times, of {self.n} unknowns or more")
        out = np.empty((len(t), self.width))
        self.check(self._call(self.address, self._part, len(t), t.ctypes.data, y.ctypes.data, y.shape[1], self._first, self.width,
                              out.ctypes.data))  # fmt: skip
        return out


def narrow_order(graph: sp.csr_matrix) -> tuple[Index, Index]:
    """An order of rows in which a symmetric pattern has a narrow band, and the place of each row in it."""
    n = graph.shape[0]
    order = np.arange(n)
    if n >= BANDED_FROM:
        from scipy.sparse.csgraph import reverse_cuthill_mckee  # not needed by small scenes

        order = reverse_cuthill_mckee(graph.tocsr(), symmetric_mode=True).astype(np.intp)
    place = np.empty(n, dtype=np.intp)
    place[order] = np.arange(n)
    return order, place


def band_factors(band: Array) -> Array:
    """Cholesky factor of a symmetric matrix whose row i holds the entries (i, i - width + 1) to (i, i) of its band; NaN where it
    is not positive definite."""
    n, width = band.shape
    lower = np.zeros((width, n))
    for k in range(width):  # entries (i + k, i), as LAPACK has them
        lower[k, : n - k] = band[k:, width - 1 - k]
    try:
        factors = cholesky_banded(lower, lower=True)
    except np.linalg.LinAlgError:
        return np.full_like(band, np.nan)
    found = np.zeros_like(band)
    for k in range(width):
        found[k:, width - 1 - k] = factors[k, : n - k]
    return found
