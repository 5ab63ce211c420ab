"""Evaluation of kernels: inputs gathered from the workspace, one call per law, values added to rows by one bincount."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.kernels.tree_plan import Piece
from mbdae.system.base import Array
from mbdae.system.model.numbering import Numbering

Index = NDArray[np.intp]


class Evaluation:
    """One kernel call per law for all rows of the workspace W (count, width); `further` constants follow the values."""

    def __init__(self, W: Array, gathers: list[Index], kernels: list[Any], columns: Index | None = None,
                 further: Array | None = None) -> None:  # fmt: skip
        self.W, (count, width) = W, W.shape
        shift = np.arange(count)[:, None, None] * width
        pieces = [(shift + g[None]).ravel() for g in gathers]
        if columns is not None:
            pieces.append((shift[:, :, 0] + columns[None]).ravel())
        self.index = np.concatenate([*pieces, np.zeros(0, dtype=np.intp)])
        self.x = np.empty(self.index.size)
        size = sum(g.shape[0] * k.width for g, k in zip(gathers, kernels, strict=True)) * count
        size += pieces[-1].size if columns is not None else 0
        self.v = np.concatenate([np.zeros(size), further if further is not None else np.zeros(0)])
        self.calls, a, b = [], 0, 0
        for g, kernel in zip(gathers, kernels, strict=True):
            points, outputs = count * g.shape[0], kernel.width
            x, v = self.x[a : a + g.size * count], self.v[b : b + points * outputs]
            self.calls.append(kernel.bound(x.reshape(points, -1), v.reshape(points, outputs)))
            a, b = a + g.size * count, b + points * outputs
        self.tail = (self.x[a:], self.v[b:size])

    def values(self) -> Array:
        """All kernel values in one flat array, law by law."""
        self.W.take(self.index, out=self.x, mode="clip")
        for call in self.calls:
            call()
        return self.v


class Scatter:
    """Terms of the residual: kernels with the rows of their values, and linear terms."""

    def __init__(self) -> None:
        self.gathers: list[Index] = []
        self.places: list[Index] = []
        self.kernels: list[Any] = []
        self._linear: list[tuple[Index, Index, Array]] = [(np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0))]

    def kernel(self, gather: Index, places: Index, kernel: Any) -> None:
        """A kernel for all instances of a law: slots it reads, rows it adds to (instances, ...)."""
        self.gathers.append(gather)
        self.places.append(places)
        self.kernels.append(kernel)

    def linear(self, rows: Index, columns: Index, weights: Array) -> None:
        """Terms weight * unknown."""
        self._linear.append((rows, columns, weights))

    @property
    def linear_terms(self) -> tuple[Index, Index, Array]:
        """Rows, columns and weights."""
        rows, columns, weights = (np.concatenate(parts) for parts in zip(*self._linear, strict=True))
        return rows, columns, weights


class TreeStage:
    """Kernels of trees that other laws act on: the motion of their bodies before, their rows after those laws."""

    def __init__(self, W: Array, pieces: list[tuple[Piece, Index, Index]], width: int) -> None:
        """pieces: kernel, slots it reads, places of its outputs in rows of an array of `width`."""
        self.evaluation = Evaluation(W, [g for _, g, _ in pieces], [p.kernel for p, _, _ in pieces])
        shift = np.arange(len(W))[:, None, None] * width
        self.at = np.concatenate([(shift + places[None]).ravel() for _, _, places in pieces])

    def write(self, out: Array) -> None:
        """Write the outputs to their places in the rows of `out`."""
        out.reshape(-1)[self.at] = self.evaluation.values()

    def add(self, out: Array) -> None:
        """Add the outputs there; no place occurs twice in a row."""
        out.reshape(-1)[self.at] += self.evaluation.values()


class ResidualBatch:
    """Residuals at `count` points. stages: kernels of trees with loaded nodes, for the motion of these
    and for the forces on them, with the slots they read and the places they write."""

    def __init__(self, numbering: Numbering, terms: Scatter, offset: Array, count: int,
                 stages: tuple[list[Any], list[Any]]) -> None:  # fmt: skip
        self.numbering, self.n = numbering, numbering.n
        self.W = numbering.workspace(count)
        rows, columns, weights = terms.linear_terms
        steady = np.flatnonzero(offset)
        self.laws = Evaluation(self.W, terms.gathers, terms.kernels, columns, np.tile(offset[steady], count))
        self.weights, self.rows = np.tile(weights, count), len(offset)
        shift = np.arange(count)[:, None, None] * self.rows
        pieces = [(shift + p[None]).ravel() for p in terms.places]
        at = [(shift[:, :, 0] + r[None]).ravel() for r in (rows, steady)]
        self.place = np.concatenate([*pieces, *at])
        self._has_clock = numbering.clock.expressions != []
        self._asked: tuple[bytes, float | None] = b"", None
        self.staged = bool(stages[0])
        if self.staged:
            widths = self.W.shape[1], self.rows
            self.forward, self.backward = (TreeStage(self.W, p, width) for p, width in zip(stages, widths, strict=True))

    def fill(self, t: Array, y: Array, yp: Array) -> None:
        """Unknowns, prescribed values and the motion of loaded nodes into the workspace."""
        self.W[:, : self.n] = y
        self.W[:, self.n : 2 * self.n] = yp
        if self._has_clock and (asked := (t.tobytes(), self.numbering.side)) != self._asked:  # a Newton iteration asks again
            self.numbering.fill_clock(self.W, t)
            self._asked = asked
        if self.staged:
            self.forward.write(self.W)

    def residual(self, t: Array, y: Array, yp: Array) -> Array:
        """(count, n)."""
        self.fill(t, y, yp)
        values = self.laws.values()
        np.multiply(self.laws.tail[0], self.weights, out=self.laws.tail[1])
        total: Any = np.bincount(self.place, values, len(self.W) * self.rows).reshape(-1, self.rows)
        if self.staged:
            self._pull(total)
        return np.asarray(total[:, : self.n])

    def _pull(self, total: Array) -> None:
        """Project the forces on loaded nodes on the coordinates that move them."""
        rows = self.numbering.loaded_rows
        self.W[:, rows] = total[:, rows - self.n + 1]
        self.backward.add(total)
