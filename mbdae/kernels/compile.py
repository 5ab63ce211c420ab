"""Symbolic expressions to numeric kernels: symengine with LLVM, and NumPy as reference in tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.costs import spends
from mbdae.kernels.oracle import numpy_function
from mbdae.native.program import Operations, block
from mbdae.symbolic.vectors import Expr

#: LLVM optimises small kernels in milliseconds, large ones in seconds for a few per cent of speed.
_OPTIMISE_BELOW = 400


class Kernel:
    """Evaluates `expressions` of `symbols` at N points at once: x (N, inputs) -> out (N, outputs), both C-contiguous."""

    def __init__(self, symbols: Sequence[Expr], expressions: Sequence[Expr], level: int | None = None) -> None:
        self.symbols, self.expressions, self.level = list(symbols), list(expressions), level

    @property
    def width(self) -> int:
        """Number of outputs."""
        return len(self.expressions)

    @cached_property
    @spends("compile")
    def compiled(self) -> Any:
        """The LLVM function, compiled on first use; without inputs (a tree that is prescribed throughout) the constants."""
        if not self.symbols:
            constants = np.array([float(e) for e in self.expressions])
            return lambda x, out: np.copyto(out, constants)
        level = self.level
        if level is None:
            level = 2 if len(self.expressions) < 60 and self.operations < _OPTIMISE_BELOW else 0
        return se.Lambdify(self.symbols, self.expressions, backend="llvm", cse=True, opt_level=level)

    @cached_property
    def operations(self) -> int:
        """Number of distinct subexpressions: the length of the compiled kernel."""
        return len(se.cse(self.expressions)[0]) + len(self.expressions)

    def __call__(self, x: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        if self.symbols:
            self.compiled(x, out=out)
        else:  # LLVM takes no function without arguments
            out[...] = self.once(x)

    def emit(self, part: Operations, gather: NDArray[np.intp], first: int | None = None) -> NDArray[np.intp]:
        """Append the kernel to a native program, at points with inputs at slots gather (points, inputs); the slots of its values
        (points, outputs), which begin at `first` where they have a place."""
        if gather.shape[1:] != (len(self.symbols),):
            raise ValueError(f"slots {gather.shape} of {len(self.symbols)} symbols")
        if self.symbols:
            return part.call(self, gather, first)
        first = part.slots(len(gather) * self.width) if first is None else first
        part.load(first, np.tile([float(e) for e in self.expressions], len(gather)))  # LLVM takes no function without arguments
        return block(first, len(gather), self.width)

    def values(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Outputs (..., outputs) for inputs (..., inputs)."""
        if not self.symbols:
            return self.once(x)
        x = np.ascontiguousarray(x, dtype=float)
        out = np.empty((*x.shape[:-1], len(self.expressions)))
        if out.size:
            self(x.reshape(-1, x.shape[-1]), out.reshape(-1, out.shape[-1]))
        return out

    def once(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Like `values`, interpreted: for constants that are evaluated once."""
        if not self.expressions:
            return np.empty((*x.shape[:-1], 0))
        if not self.symbols:
            return np.broadcast_to([float(e) for e in self.expressions], (*x.shape[:-1], len(self.expressions)))
        interpreted = se.Lambdify(self.symbols, self.expressions, backend="lambda", cse=True)
        return np.asarray(interpreted(np.ascontiguousarray(x, dtype=float))).reshape(*x.shape[:-1], -1)

    @cached_property
    def oracle(self) -> Callable[[NDArray[Any]], NDArray[Any]]:
        """The same kernel in NumPy, in complex numbers too (complex step): slow, for tests and `selftest`."""
        return numpy_function(self.symbols, self.expressions)
