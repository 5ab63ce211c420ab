"""Pointwise kernels between constant operators: residual and Jacobian of a whole scene in a given form.

Residual = constants + linear terms + kernel values, summed by one bincount. Jacobian data = c0 + cj c1 + kernel
values, those taken with respect to y' weighted by cj. All instances of a law, and all stages of a Radau step, are
evaluated in one kernel call.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from mbdae.kernels import LinearisedPlan, linearised_plan
from mbdae.kernels.plan import Outputs
from mbdae.symbolic.outputs import Target
from mbdae.system.base import Array, System
from mbdae.system.model import Model
from mbdae.system.numbering import Numbering, Row

SPARSE_FROM = 150  #: unknowns; below, dense linear algebra is faster (measured 150-200)


@dataclass(frozen=True)
class FormSpec:
    """What a form asks of the assembly.

    outputs: which outputs of every law; rows: to which block of rows each kind of output belongs; blocks:
    multiplier blocks of y; derivatives: multipliers are read from y'; index: index of each kind of unknown.
    """

    label: str
    outputs: Outputs
    rows: Mapping[str, str]
    blocks: tuple[str, ...]
    derivatives: bool
    index: Mapping[str, int]


@dataclass
class _Terms:
    """Scatter of residual terms: kernels (gather -> values), linear weights, constants."""

    gathers: list[NDArray[np.intp]] = field(default_factory=list)
    places: list[NDArray[np.intp]] = field(default_factory=list)
    kernels: list[Any] = field(default_factory=list)


class SceneSystem(System):
    """A scene in a form: F(t, y, y') = 0 with its exact Jacobian."""

    def __init__(self, model: Model, rows: list[Row], spec: FormSpec, sparse: bool | None = None) -> None:
        self.model, self.spec, self.label = model, spec, spec.label
        self.numbering = Numbering(model, rows, spec.blocks, spec.derivatives)
        nb = self.numbering
        self.n, self.names = nb.n, nb.names()
        self.kinds = self._kinds()
        self.index = np.array([spec.index[k] for k in self.kinds], dtype=int)
        self.equations = self._equations()
        self._linear_rows: list[NDArray[np.intp]] = []
        self._linear_columns: list[NDArray[np.intp]] = []
        self._linear_weights: list[Array] = []
        self._offset = np.zeros(self.n + 1)
        self._residual, self._jacobian = _Terms(), _Terms()
        self._entries: list[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_], Array | None]] = []
        for g, group in enumerate(model.groups):
            self._add(g, linearised_plan(group.derived, spec.outputs))
        self._finish(sparse if sparse is not None else self.n > SPARSE_FROM)
        self.scale, self.y0, self.yp0, self.t0 = np.ones(self.n), np.zeros(self.n), np.zeros(self.n), 0.0

    # -- construction

    def _kinds(self) -> tuple[str, ...]:
        nb = self.numbering
        sizes = {"q": nb.nq, "v": nb.nu, "s": len(nb.states)} | dict.fromkeys(self.spec.blocks, nb.m)
        return tuple(kind for kind, size in sizes.items() for _ in range(size))

    def _equations(self) -> tuple[str, ...]:
        """Name of every row of F."""
        nb, meaning = self.numbering, {"g": "position", "gd": "velocity"}
        names = [f"kinematics of {n}" for n in self.names[: nb.nq]]
        names += [f"momentum of {n}" for n in self.names[nb.nq : nb.nq + nb.nu]]
        names += [f"state {n}" for n in nb.states.values()]
        by_block = {block: head for head, block in self.spec.rows.items()}
        for block in self.spec.blocks:
            names += [f"{row.name} ({meaning[by_block[block]]} constraint)" for row in nb.rows]
        return tuple(names)

    def _row_of(self, target: Target, g: int, i: int) -> int:
        """Row of F a target belongs to; n (a spare row) for what is dropped."""
        block = self.spec.rows[target[0]]
        if block in ("q", "u", "s"):
            return self.numbering.unknown((block, *target[1:]), g, i)[0]
        row = self.numbering.row(g, i, target[1])
        return self.n if row is None else self.numbering.start[block] + row

    def _add(self, g: int, plan: LinearisedPlan) -> None:
        nb, count = self.numbering, len(self.model.groups[g].instances)
        rows = np.array([[self._row_of(t, g, i) for t in plan.targets] for i in range(count)], dtype=np.intp).reshape(count, -1)
        constants = plan.constants.once(nb.numbers(g, plan.constant_inputs))
        split = len(plan.constant_places)
        np.add.at(self._offset, rows[:, plan.offset_places], constants[:, split:])
        linear = set(plan.offset_places)
        at = [(j, *place) for j, place in enumerate(plan.constant_places)]
        columns, dotted = self._columns(g, [p[2] for p in at])
        out = rows[:, [p[1] for p in at]] if at else np.zeros((count, 0), dtype=np.intp)
        self._entries.append((out, columns, dotted, constants[:, :split]))
        keep = [j for j, o, _ in at if o in linear]
        live = columns[:, keep] >= 0
        self._linear_rows.append(out[:, keep][live])
        self._linear_columns.append((columns + nb.n * dotted)[:, keep][live])
        self._linear_weights.append(constants[:, keep][live])
        if plan.nonlinear:
            self._residual.gathers.append(nb.gather(g, plan.residual_inputs))
            self._residual.places.append(rows[:, plan.nonlinear])
            self._residual.kernels.append(plan.residual)
        if plan.jacobian_places:
            columns, dotted = self._columns(g, [t for _, t in plan.jacobian_places])
            self._jacobian.gathers.append(nb.gather(g, plan.jacobian_inputs))
            self._jacobian.kernels.append(plan.jacobian)
            self._entries.append((rows[:, [o for o, _ in plan.jacobian_places]], columns, dotted, None))

    def _columns(self, g: int, targets: list[Target]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """(instances, targets) columns of F_y, and whether they are columns of F_y'."""
        found = [[self.numbering.unknown(t, g, i) for t in targets] for i in range(len(self.model.groups[g].instances))]
        table = np.array(found, dtype=np.intp).reshape(len(found), len(targets), 2)
        return table[..., 0], table[..., 1].astype(bool)

    def _finish(self, sparse: bool) -> None:
        n, spare = self.n, self.n
        cells = [np.where((c < 0) | (r == spare), n * n, c * n + r) for r, c, _, _ in self._entries]
        used = np.unique(np.concatenate([c.ravel() for c in cells])) if cells else np.zeros(0, dtype=np.intp)
        used = used[used < n * n]
        if sparse:
            indptr = np.searchsorted(used, np.arange(n + 1) * n)
            self.sparsity: Any = sp.csc_matrix((np.ones(used.size), used % n, indptr), shape=(n, n))
            self._size = used.size
            position = [np.where(c < n * n, np.searchsorted(used, c), used.size) for c in cells]
        else:
            self.sparsity, self._size = None, n * n
            position = [np.where(c < n * n, (c % n) * n + c // n, n * n) if n else c for c in cells]
        self._c = [np.zeros(self._size + 1), np.zeros(self._size + 1)]
        varying, dots = [], []
        for place, (_, _, dotted, values) in zip(position, self._entries, strict=True):
            if values is None:
                varying.append(place.ravel())
                dots.append(dotted.ravel())
            else:
                for part, mask in ((0, ~dotted), (1, dotted)):
                    np.add.at(self._c[part], place[mask], values[mask])
        self._jacobian_place = np.concatenate([*varying, np.zeros(0, dtype=np.intp)])
        self._jacobian_dotted = np.concatenate([*dots, np.zeros(0, dtype=bool)])
        del self._entries

    # -- evaluation

    @cached_property
    def _batches(self) -> dict[int, _Batch]:
        return {}

    def _batch(self, count: int) -> _Batch:
        if count not in self._batches:
            self._batches[count] = _Batch(self, count)
        return self._batches[count]

    @cached_property
    def _derivative(self) -> _Evaluation:
        return _Evaluation(self.numbering, self._jacobian.gathers, self._jacobian.kernels, 1)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        out[:] = self._batch(1).residual(np.array([t]), y, yp)

    def residual_stages(self, t: Array, y: Array, yp: Array, out: Array) -> None:
        out[:] = self._batch(len(t)).residual(t, y, yp)

    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        values = self._derivative.values(np.array([t]), y, yp)
        weighted = values * np.where(self._jacobian_dotted, cj, 1.0)
        data: Any = np.bincount(self._jacobian_place, weighted, self._size + 1)
        data += self._c[0]
        data += cj * self._c[1]
        out.reshape(-1)[:] = data[:-1]

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        values = self._derivative.values(np.array([t]), y, yp)
        parts = []
        for constant, mask in zip(self._c, (~self._jacobian_dotted, self._jacobian_dotted), strict=True):
            data = np.bincount(self._jacobian_place[mask], values[mask], self._size + 1) + constant
            parts.append(data[:-1] if self.sparsity is not None else data[:-1].reshape(self.n, self.n))
        return parts[0], parts[1]


class _Evaluation:
    """Gather, then one kernel call per law, for `count` points at once."""

    def __init__(self, numbering: Numbering, gathers: list[NDArray[np.intp]], kernels: list[Any], count: int,
                 columns: NDArray[np.intp] | None = None) -> None:  # fmt: skip
        self.n, self.numbering, self.count = numbering.n, numbering, count
        self.W = numbering.workspace(count)
        shift = np.arange(count)[:, None, None] * numbering.width
        pieces = [(shift + g[None]).ravel() for g in gathers]
        if columns is not None:
            pieces.append((shift[:, :, 0] + columns[None]).ravel())
        self.index = np.concatenate([*pieces, np.zeros(0, dtype=np.intp)])
        self.x = np.empty(self.index.size)
        self.v = np.empty(sum(g.shape[0] * len(k.expressions) for g, k in zip(gathers, kernels, strict=True)) * count
                          + (pieces[-1].size if columns is not None else 0))  # fmt: skip
        self.calls, a, b = [], 0, 0
        for g, kernel in zip(gathers, kernels, strict=True):
            points, outputs = count * g.shape[0], len(kernel.expressions)
            x, v = self.x[a : a + g.size * count], self.v[b : b + points * outputs]
            self.calls.append((kernel, x.reshape(points, -1), v.reshape(points, outputs)))
            a, b = a + g.size * count, b + points * outputs
        self.tail = (self.x[a:], self.v[b:])
        self._has_clock = numbering.clock.expressions != []

    def values(self, t: Array, y: Array, yp: Array) -> Array:
        """All kernel values in one flat array, law by law."""
        self.W[:, : self.n] = y
        self.W[:, self.n : 2 * self.n] = yp
        if self._has_clock:
            self.numbering.fill_clock(self.W, t)
        self.W.take(self.index, out=self.x, mode="clip")
        for kernel, x, v in self.calls:
            kernel(x, v)
        return self.v


class _Batch(_Evaluation):
    """Residuals at `count` points."""

    def __init__(self, system: SceneSystem, count: int) -> None:
        columns = np.concatenate([*system._linear_columns, np.zeros(0, dtype=np.intp)])
        super().__init__(system.numbering, system._residual.gathers, system._residual.kernels, count, columns)
        self.weights = np.tile(np.concatenate([*system._linear_weights, np.zeros(0)]), count)
        self.rows, self.offset = system.n + 1, system._offset[:-1]
        shift = np.arange(count)[:, None, None] * self.rows
        pieces = [(shift + p[None]).ravel() for p in system._residual.places]
        linear = np.concatenate([*system._linear_rows, np.zeros(0, dtype=np.intp)])
        self.place = np.concatenate([*pieces, (shift[:, :, 0] + linear[None]).ravel()])

    def residual(self, t: Array, y: Array, yp: Array) -> Array:
        """(count, n)."""
        values = self.values(t, y, yp)
        np.multiply(self.tail[0], self.weights, out=self.tail[1])
        total = np.bincount(self.place, values, self.count * self.rows).reshape(self.count, self.rows)
        return total[:, :-1] + self.offset
