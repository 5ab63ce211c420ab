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

#: golden ratio less 1: the fractional parts of its multiples are spread irregularly over 0 to 1. From them the inputs are made at
#: which the entries of the Jacobian that are not 0 are found, so that none of them is 0 by chance
GOLDEN = (5**0.5 - 1) / 2


class ElementKernel(ABC):
    """A law over m elements of the same kind, for example the strains of beam elements. In native programs it is used like a
    `Kernel` that is evaluated once per element.

    inputs   columns of x: ("q", node, i), ("u", node, i), ("z", j) algebraic unknowns, ("p", name) prescribed values
    targets  columns of the outputs: ("u", node, i) terms on the left-hand side of the equations of motion, ("z", j) rows of the
             algebraic unknowns

    Nodes are numbered within the element. x is (N, inputs), where N is a multiple of m: the inputs of all elements in order for
    the first state, then for the second one, ...
    """

    elements: int
    inputs: list[Target]
    targets: list[Target]

    @abstractmethod
    def values(self, x: Array) -> Array:
        """Outputs (N, outputs) for inputs x (N, inputs)."""

    @abstractmethod
    def full_jacobian(self, x: Array) -> Array:
        """(N, outputs, inputs) derivatives of `values` by unknowns; ("p", name), the last inputs, are left out."""

    @abstractmethod
    def emit(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        """Append the evaluation of all elements to a native program, see `Kernel.emit`. gather: slots of the inputs (elements,
        inputs). Returns the slots of the values (elements, outputs)."""

    @abstractmethod
    def emit_jacobian(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        """Append the derivatives to a native program. Returns their slots (elements, len(jacobian_places))."""

    @cached_property
    def _places(self) -> tuple[Array, Array]:
        """Row and column numbers (outputs, inputs) of the entries of the Jacobian that are not identically zero, found at a state
        of irregular numbers."""
        x = 0.3 + 0.6 * (np.arange(1.0, self.elements * len(self.inputs) + 1) * GOLDEN % 1).reshape(self.elements, -1)
        outputs, inputs = np.nonzero(np.any(self.full_jacobian(x) != 0, axis=0))
        return outputs, inputs

    @cached_property
    def jacobian_places(self) -> list[tuple[int, Target]]:
        """Of every derivative that `jacobian` returns the number of the output and the input by which it is differentiated."""
        return [(int(o), self.inputs[i]) for o, i in zip(*self._places, strict=True)]

    def jacobian(self, x: Array) -> Array:
        """(N, len(jacobian_places)) derivatives: the entries of `full_jacobian` that are not identically zero."""
        return self.full_jacobian(x)[:, *self._places]


class ElementJacobian:
    """The derivatives of an element kernel, with the method `emit` of a kernel, so that both are used alike."""

    def __init__(self, kernel: ElementKernel) -> None:
        self.kernel = kernel

    def emit(self, part: Operations, gather: NDArray[np.intp]) -> NDArray[np.intp]:
        """Append the derivatives of all elements to a native program, by `ElementKernel.emit_jacobian`; returns their slots."""
        return self.kernel.emit_jacobian(part, gather)
