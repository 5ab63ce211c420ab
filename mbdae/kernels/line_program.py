"""A law on a line (a beam) as operations of a native program, in the same steps as `LineKernel` in Python.

In every element the positions of the sections follow from those of the nodes (at corners by constant matrices T), their rates by
P' = H Omega P with the constant tensor H of `kinematic_tensor`, and the variables of the law at the integration points by the
table of shape functions. The forces of the law are brought back to the nodes by the transposes of these maps, and its derivatives
by the maps on the right and their transposes on the left.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.kernels import Kernel
from mbdae.kernels.line_nodes import kinematic_tensor
from mbdae.native.program import Operations, block

Index = NDArray[np.intp]
Array = NDArray[Any]
Entries = Sequence[tuple[Any, ...]]  #: terms of sums: index of the sum, then indices or values of the factors of the term


class LineProgram:
    """Appends the elements of a line kernel to the native program `part`. Slots are given for the first element: those of the
    following elements lie a constant number of slots, the step, further on.

    kernel: a `LineKernel`; gather: slots of its inputs (elements, inputs)."""

    def __init__(self, kernel: Any, part: Operations, gather: Index) -> None:
        self.kernel, self.part, self.nodes = kernel, part, kernel.nodes
        n = kernel.nodes
        self.a, self.nu = n.count * n.nq, n.count * n.nu
        self.elements, self.inputs = gather.shape
        #: (a, c, b, H_acb) of all nonzero entries of the kinematic tensor: P'_a = sum of H_acb w_c P_b; empty in the plane
        H = kinematic_tensor()
        self.spin: Entries = [] if n.flat else [(*at, float(H[at])) for at in zip(*np.nonzero(H), strict=True)]
        self.e = part.slots(gather.size)
        part.set(self.e + np.arange(gather.size), gather)

    # -- steps that values and derivatives share

    def move(self, to: Any, from_: Any, to_step: int, from_step: int) -> None:
        """W[to] = W[from_] for slots of the first element, likewise in all others, to_step and from_step slots further on
        each."""
        self.part.set(to, from_, self.elements, to_step, from_step)

    def products(self, to: int, from_: int, by: int, entries: Entries, steps: tuple[int, int, int]) -> None:
        """W[to + i] += w W[from_ + j] W[by + k] for entries (i, j, k, w), in every element; steps: of to, from_ and by."""
        if entries:
            i, j, k, w = zip(*entries, strict=True)
            self.part.multiply(to + np.array(i), from_ + np.array(j), by + np.array(k), np.array(w, dtype=float), self.elements,
                               *steps)

    def turned(self, first: int, step: int) -> tuple[int, int]:
        """Convert positions or rates (count, nq) of nodes to those of the sections. Returns slot and step of the result."""
        n = self.nodes
        if n.T is None:
            return first, step
        found = self.part.zeros(self.elements * self.a)
        translations = np.array([node * n.nq + i for node in range(n.count) for i in range(3)])
        self.move(found + translations, first + translations, self.a, step)
        self._turn(found, first, [(node * n.nq + 3 + a, node * n.nq + 3 + b, node, a, b) for node in range(n.count)
                                  for a in range(4) for b in range(4)], self.a, step)
        return found, self.a

    def _turn(self, to: int, from_: int, entries: Entries, to_step: int, from_step: int) -> None:
        """W[to + i] += T[node, a, b] W[from_ + j] for entries (i, j, node, a, b), in every element."""
        i, j, node, a, b = np.array(entries).T
        assert self.nodes.T is not None
        self.part.add(to + i, from_ + j, self.nodes.T[:, node, a, b], self.elements, to_step, from_step)

    def points(self, point: Kernel) -> int:
        """Evaluate `point`, the kernel of the law at one integration point, at all points. Returns the slot of its values
        (elements, points, width)."""
        kernel, points, width = self.kernel, self.kernel.points, len(point.symbols)
        X, size = self.part.slots(self.elements * points * width), points * width
        self.part.load(X, self._constants(width))
        fields, stresses = len(kernel.derived.fields), len(kernel.derived.stresses)
        variables = [(self.turned(self.e, self.inputs), 0)]
        if kernel.derived.damped:
            variables.append((self.turned(*self._rates()), fields))
        for (first, step), column in variables:
            table = kernel.fields.reshape(self.a, points, fields)
            rows, g, f = np.nonzero(table)
            self.part.add(X + g * width + column + f, first + rows, table[rows, g, f], self.elements, size, step)
        column, own = len(variables) * fields, int(kernel._splits[1])
        place = [(g * width + column + j, own + g * stresses + j) for g in range(points) for j in range(stresses)]
        column, own = column + stresses, own + points * stresses
        place += [(g * width + column + j, own + j) for g in range(points) for j in range(len(kernel.given))]
        if place:
            to, from_ = np.array(place).T
            self.move(X + to, self.e + from_, size, self.inputs)
        return int(point.emit(self.part, block(X, self.elements * points, width))[0, 0])

    def _constants(self, width: int) -> Array:
        """Constant part (elements, points, width) of the law's inputs: its parameters, and in the plane what the constant
        rotations of the nodes add to its variables."""
        kernel, n = self.kernel, self.nodes
        X = np.zeros((self.elements, kernel.points, width))
        X[:, :, width - kernel.numbers.shape[2] :] = kernel.numbers
        if n.offset is not None:
            shift = n.sections(np.zeros((self.elements, n.count, n.nq))).reshape(self.elements, -1) @ kernel.fields
            X[:, :, : len(kernel.derived.fields)] += shift.reshape(self.elements, kernel.points, -1)
        return X

    def _rates(self) -> tuple[int, int]:
        """Compute q' (count, nq) of the nodes. Returns slot and step of the result."""
        n, velocities = self.nodes, self.e + self.a
        if n.flat:
            return velocities, self.inputs
        found = self.part.zeros(self.elements * self.a)
        pairs = np.array([(node * n.nq + i, node * n.nu + i) for node in range(n.count) for i in range(3)]).T
        self.move(found + pairs[0], velocities + pairs[1], self.a, self.inputs)
        entries = [(node * n.nq + 3 + a, node * n.nu + 3 + c, node * n.nq + 3 + b, w) for node in range(n.count)
                   for a, c, b, w in self.spin]
        self.products(found, velocities, self.e, entries, (self.a, self.inputs, self.inputs))
        return found, self.a

    def covector(self, values: int, width: int) -> int:
        """Slot of the generalised forces (count, nq) on the nodes' positions, from those on the interpolated fields (duals),
        which are the first of the `width` numbers of every integration point in the slots from `values` on."""
        kernel, n, found = self.kernel, self.nodes, self.part.zeros(self.elements * self.a)
        table = kernel.duals.reshape(self.a, kernel.points, -1)
        rows, g, d = np.nonzero(table)
        self.part.add(found + rows, values + g * width + d, table[rows, g, d], self.elements, self.a, kernel.points * width)
        if n.T is None:
            return found
        back = self.part.zeros(self.elements * self.a)
        translations = np.array([node * n.nq + i for node in range(n.count) for i in range(3)])
        self.move(back + translations, found + translations, self.a, self.a)
        self._turn(back, found, [(node * n.nq + 3 + b, node * n.nq + 3 + a, node, a, b) for node in range(n.count)
                                 for a in range(4) for b in range(4)], self.a, self.a)
        return back

    # -- values

    def values(self) -> int:
        """Append all steps of the values. Returns the slot of the outputs (elements, targets)."""
        kernel, n = self.kernel, self.nodes
        point, out = kernel.point, len(kernel.targets)
        values, width, duals = self.points(point), point.width, len(kernel.derived.duals)
        covector, found = self.covector(values, width), self.part.zeros(self.elements * out)
        if n.flat:
            self.move(found + np.arange(self.a), covector + np.arange(self.a), out, self.a)
        else:
            pairs = np.array([(node * n.nu + i, node * n.nq + i) for node in range(n.count) for i in range(3)]).T
            self.move(found + pairs[0], covector + pairs[1], out, self.a)
            entries = [(node * n.nu + 3 + c, node * n.nq + 3 + a, node * n.nq + 3 + b, w) for node in range(n.count)
                       for a, c, b, w in self.spin]
            self.products(found, covector, self.e, entries, (out, self.a, self.inputs))
        rows = len(kernel.derived.rows)
        if rows:
            at = [(g, j) for g in range(kernel.points) for j in range(rows)]
            place = np.array([(self.nu + g * rows + j, g * width + duals + j) for g, j in at]).T
            self.move(found + place[0], values + place[1], out, kernel.points * width)
        return found

    # -- derivatives

    def jacobian(self) -> int:
        """Append all steps of the derivatives. Returns their slot (elements, len(jacobian_places))."""
        kernel, a = self.kernel, self.a
        point = kernel.point_jacobian
        values, width, duals = self.points(point), point.width, len(kernel.derived.duals)
        spread, (rows, columns) = kernel._spread, kernel._spread.shape
        if self.nodes.flat:
            return self._in_the_plane(values, width, duals, spread, columns)
        K, size = self.part.zeros(self.elements * rows * columns), rows * columns
        each = width - duals
        at = values + spread.columns // each * width + duals + spread.columns % each
        self.part.add(K + spread.rows, at, spread.factors, self.elements, size, kernel.points * width)
        if self.nodes.T is not None:
            blocks = [0, a] if kernel.derived.damped else [0]
            K = self._turned_derivatives(K, rows, columns, blocks)
        if not self.nodes.flat and kernel.derived.damped:
            K, columns = self._by_velocities(K, rows, columns)
        return self._placed(K, rows, columns, self.covector(values, width))

    def _in_the_plane(self, values: int, width: int, duals: int, spread: Any, columns: int) -> int:
        """Slot of the derivatives in the plane: there rotations are angles, so that the derivatives of an element are one
        constant matrix times those at the points."""
        outputs, inputs = self.kernel._places
        place = np.full(spread.size, -1)
        place[(outputs + self.a - self.nu) * columns + inputs] = np.arange(len(outputs))
        chosen = place[spread.rows] >= 0
        found, by, each = self.part.zeros(self.elements * len(outputs)), spread.columns[chosen], width - duals
        at = by // each * width + duals + by % each
        self.part.add(found + place[spread.rows[chosen]], values + at, spread.factors[chosen], self.elements, len(outputs),
                      self.kernel.points * width)
        return found

    def _turned_derivatives(self, K: int, rows: int, columns: int, blocks: list[int]) -> int:
        """Derivatives K of forces on sections by positions of sections, converted to those of forces on nodes by positions of
        nodes: T^T K T. blocks: first columns of the positions and of their rates."""
        n, a, size = self.nodes, self.a, rows * columns
        rotations = [(node, node * n.nq + 3) for node in range(n.count)]
        by_nodes = self.part.zeros(self.elements * size)
        turned = {block + first + i for block in blocks for _, first in rotations for i in range(4)}
        plain = [r * columns + c for r in range(rows) for c in range(columns) if c not in turned]
        self.move(by_nodes + np.array(plain), K + np.array(plain), size, size)
        pairs = [(i, j) for i in range(4) for j in range(4)]
        at = [(r * columns + block + first, node) for r in range(rows) for block in blocks for node, first in rotations]
        self._turn(by_nodes, K, [(start + j, start + i, node, i, j) for start, node in at for i, j in pairs], size, size)
        found = self.part.zeros(self.elements * size)
        turned = {first + i for _, first in rotations for i in range(4)}
        plain = [r * columns + c for r in range(rows) if r not in turned or r >= a for c in range(columns)]
        self.move(found + np.array(plain), by_nodes + np.array(plain), size, size)
        at = [(first * columns + c, node) for node, first in rotations for c in range(columns)]
        turned_rows = [(start + j * columns, start + i * columns, node, i, j) for start, node in at for i, j in pairs]
        self._turn(found, by_nodes, turned_rows, size, size)
        return found

    def _by_velocities(self, K: int, rows: int, columns: int) -> tuple[int, int]:
        """Derivatives by q and q', converted to those by q and u with q' = H(q) u. Returns their slot and number of columns."""
        n, a, nu = self.nodes, self.a, self.nu
        wide, size = columns - a + nu, rows * (columns - a + nu)
        found = self.part.zeros(self.elements * size)
        copies, by_position, by_velocity = [], [], []
        for r in range(rows):
            to, from_ = r * wide, r * columns
            copies += [(to + c, from_ + c) for c in range(a)]
            copies += [(to + a + nu + c, from_ + 2 * a + c) for c in range(columns - 2 * a)]
            for node in range(n.count):
                q, u = node * n.nq, node * n.nu
                copies += [(to + a + u + i, from_ + a + q + i) for i in range(3)]
                by_position += [(to + q + 3 + b, from_ + a + q + 3 + i, u + 3 + c, w) for i, c, b, w in self.spin]
                by_velocity += [(to + a + u + 3 + c, from_ + a + q + 3 + i, q + 3 + b, w) for i, c, b, w in self.spin]
        at = np.array(copies).T
        self.move(found + at[0], K + at[1], size, rows * columns)
        steps = (size, rows * columns, self.inputs)
        self.products(found, K, self.e + a, by_position, steps)
        self.products(found, K, self.e, by_velocity, steps)
        return found, wide

    def _placed(self, K: int, rows: int, columns: int, covector: int) -> int:
        """Derivatives of the generalised forces on q, converted to those of forces and moments; with what the change of this
        conversion with q adds at constant generalised forces `covector`. Returns the slot of the entries `jacobian_places`."""
        kernel, n = self.kernel, self.nodes
        places = kernel._places
        count, a = len(places[0]), self.a
        found = self.part.zeros(self.elements * count)
        copies, moments, geometric = [], [], []
        for k, (o, i) in enumerate(zip(*(p.tolist() for p in places), strict=True)):
            node, r = divmod(o, n.nu)
            if o >= self.nu:
                copies.append((k, (o - self.nu + a) * columns + i))
            elif r < 3:
                copies.append((k, (node * n.nq + r) * columns + i))
            else:
                first = node * n.nq + 3
                moments += [(k, (first + x) * columns + i, first + b, w) for x, c, b, w in self.spin if c == r - 3]
                if i < a and i // n.nq == node and i % n.nq >= 3:
                    geometric += [(k, first + x, w) for x, c, b, w in self.spin if c == r - 3 and b == i % n.nq - 3]
        if copies:
            to, from_ = np.array(copies).T
            self.move(found + to, K + from_, count, rows * columns)
        self.products(found, K, self.e, moments, (count, rows * columns, self.inputs))
        if geometric:
            at, by, weight = zip(*geometric, strict=True)
            self.part.add(found + np.array(at), covector + np.array(by), np.array(weight), self.elements, count, a)
        return found
