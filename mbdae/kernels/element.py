"""Kernels of elements with several nodes: values and derivatives of all elements at once."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.native.program import Operations
from mbdae.symbolic.outputs import Target

Array = NDArray[Any]

GOLDEN = (5**0.5 - 1) / 2  #: its multiples, without their whole parts, have no regular distances


class ElementKernel(ABC):
    """A law over m elements of the same kind; emitted like a `Kernel` whose points are the elements.

    inputs   columns of x: ("q", node, i), ("u", node, i), ("z", j) algebraic unknowns, ("p", name) prescribed values
    targets  columns of the outputs: ("u", node, i) momentum rows, left-hand side, ("z", j) rows of the algebraic unknowns

    Nodes are numbered within the element. x is (N, inputs), N a multiple of m: several states of all elements in order.
    """

    elements: int
    inputs: list[Target]
    targets: list[Target]

    @abstractmethod
    def values(self, x: Array) -> Array:
        """Outputs (N, outputs)."""

    @abstractmethod
    def full_jacobian(self, x: Array) -> Array:
        """(N, outputs, inputs) derivatives of `values` by unknowns; ("p", name), the last inputs, are left out."""

    @abstractmethod
    def emit(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        """Append the kernel to a native program. Returns the slots of its values (elements, outputs)."""

    @abstractmethod
    def emit_jacobian(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        """Append the derivatives to a native program. Returns their slots (elements, places)."""

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """Entries (outputs, inputs) of the Jacobian that do not vanish in an irregular state."""
        x = 0.3 + 0.6 * (np.arange(1.0, self.elements * len(self.inputs) + 1) * GOLDEN % 1).reshape(self.elements, -1)
        outputs, inputs = np.nonzero(np.any(self.full_jacobian(x) != 0, axis=0))
        return outputs, inputs

    @cached_property
    def jacobian_places(self) -> list[tuple[int, Target]]:
        """(output, input) of every derivative `jacobian` returns."""
        return [(int(o), self.inputs[i]) for o, i in zip(*self._places, strict=True)]

    def jacobian(self, x: Array) -> Array:
        """(N, places) derivatives, those that do not vanish."""
        return self.full_jacobian(x)[:, *self._places]


class ElementJacobian:
    """The derivatives of an element kernel, emitted like a kernel."""

    def __init__(self, kernel: ElementKernel) -> None:
        self.kernel = kernel

    def emit(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        """Append the derivatives to a native program. Returns their slots (elements, places)."""
        return self.kernel.emit_jacobian(part, gather)
