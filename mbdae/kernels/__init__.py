"""Expressions as NumPy source: the reference for compiled kernels, and for derivatives by the complex step.

Every operation of an expression is written in parentheses of its own, so that NumPy evaluates it exactly as stated, in real or
complex numbers and without LLVM.

Symbolic expressions to numeric kernels: symengine with LLVM, and NumPy as reference in tests.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, reduce
from importlib import import_module
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.disk.entries import code_key, keep, part_key, recall
from mbdae.errors import LawError, internal
from mbdae.native.program import Operations, block
from mbdae.process import spends
from mbdae.symbolic.program import Program, python_function
from mbdae.symbolic.rebuild import complex_atan2, substituted
from mbdae.symbolic.vectors import Expr
from mbdae.threads import check

__all__ = ["Kernel"]


def _larger(*values: Any) -> Any:
    return reduce(lambda a, b: np.where(np.real(a) >= np.real(b), a, b), values)


def _smaller(*values: Any) -> Any:
    return reduce(lambda a, b: np.where(np.real(a) <= np.real(b), a, b), values)


def _piecewise(*parts: Any) -> Any:
    """The value that stands before the first true condition; NaN where none is true. parts: value, condition, value, ..."""
    found: Any = np.nan
    for value, condition in zip(parts[-2::-2], parts[::-2], strict=True):
        found = np.where(condition, value, found)
    return found


def _special(name: str) -> Callable[[Any], Any]:
    return lambda a: getattr(import_module("scipy.special"), name)(a)


#: function of NumPy or SciPy for every function of symengine, by the name of its class. Comparisons use real parts, so that the
#: imaginary parts of the complex step do not disturb them
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "log")},
    **{name: getattr(np, "arc" + name[1:]) for name in ("asin", "acos", "atan", "asinh", "acosh", "atanh")},
    "atan2": complex_atan2, "UnevaluatedExpr": lambda a: a, "Piecewise": _piecewise, "Max": _larger, "Min": _smaller,
    "Abs": lambda a: np.where(np.real(a) < 0, -a, a), "sign": lambda a: np.sign(np.real(a)),
    "floor": lambda a: np.floor(np.real(a)), "ceiling": lambda a: np.ceil(np.real(a)),
    "StrictLessThan": lambda a, b: np.real(a) < np.real(b), "LessThan": lambda a, b: np.real(a) <= np.real(b),
    "Equality": lambda a, b: np.real(a) == np.real(b), "Unequality": lambda a, b: np.real(a) != np.real(b),
    "And": lambda *a: reduce(np.logical_and, a), "Or": lambda *a: reduce(np.logical_or, a), "Not": np.logical_not,
    **{name: _special(name) for name in ("erf", "erfc", "gamma", "loggamma")},
    "BooleanTrue": lambda: True, "BooleanFalse": lambda: False, "_sqrt": np.sqrt, "_exp": np.exp,
}


def numpy_function(symbols: Sequence[Expr], expressions: Sequence[Expr]) -> Callable[[NDArray[Any]], NDArray[Any]]:
    """The function x (..., inputs) -> (..., outputs), real or complex; raises LawError for an unknown function."""
    function = python_function(symbols, expressions, _FUNCTIONS)

    def evaluate(x: NDArray[Any]) -> NDArray[Any]:
        out = np.empty((len(expressions), *x.shape[:-1]), dtype=x.dtype)
        for i, column in enumerate(function(np.moveaxis(x, -1, 0))):
            out[i] = column
        return np.moveaxis(out, 0, -1)

    return evaluate


#: number of operations below which LLVM optimises a kernel for which no level is stated, if it has fewer than 60 outputs: this
#: takes milliseconds for small kernels, but seconds for large ones, which then run only a few per cent faster
_OPTIMISE_BELOW = 400


class Kernel:
    """Evaluates `expressions` of `symbols` at N points at once: x (N, inputs) -> out (N, outputs), both C-contiguous.

    expressions may be a function that returns them, which is called when they are first needed; then width, their number, has to
    be given. level: LLVM's level of optimisation, None: by size. key: key of the machine code on disk, None: a hash of the
    expressions."""

    def __init__(self, symbols: Sequence[Expr], expressions: Sequence[Expr] | Callable[[], Sequence[Expr]],
                 level: int | None = None, width: int | None = None, key: str | None = None) -> None:
        self.symbols, self._stated, self.level, self.key = list(symbols), expressions, level, key
        self.width = len(self.expressions) if width is None else width  #: number of outputs

    @cached_property
    def expressions(self) -> list[Expr]:
        """The expressions that the kernel evaluates."""
        return list(self._stated() if callable(self._stated) else self._stated)

    @cached_property
    @spends("compile")
    def compiled(self) -> Any:
        """The LLVM function, from disk or compiled on first use; a kernel without inputs (of a tree whose motion is prescribed
        throughout) returns its constants."""
        if not self.symbols:
            return lambda x, out: np.copyto(out, self._fixed)
        key = self.key or code_key(self.symbols, self.expressions, self.level)
        found = recall(key)
        if found is None:
            check("equations were compiled")
            keep(key, found := self._compiled_now())
        return found

    @cached_property
    def _fixed(self) -> NDArray[np.float64]:
        """The constant outputs of a kernel without inputs, (outputs,)."""
        found = recall(self.key)
        if found is None:
            keep(self.key, found := tuple(float(e) for e in self.expressions))
        return np.array(found, dtype=float)

    def _compiled_now(self) -> Any:
        level = self.level
        if level is None:
            level = 2 if len(self.expressions) < 60 and self._counted < _OPTIMISE_BELOW else 0
        try:
            return se.Lambdify(self.symbols, self.expressions, backend="llvm", cse=True, opt_level=level)
        except RuntimeError as error:  # of symengine, for complex and infinite numbers that derivatives bring
            raise LawError(f"a law cannot be compiled ({error}): look for a division by 0, powers of numbers that are not "
                           "positive, and cases without (value, True) at their end") from error

    @cached_property
    def tangent(self) -> Kernel:
        """The kernel of the derivative along a direction: it returns the changes of the outputs for changes of the inputs, which
        it reads after the inputs themselves."""
        changes = {s: se.Symbol(f"change_{s}") for s in self.symbols}

        def expressions() -> list[Expr]:
            program, outputs = self.straight()
            return program.closed(program.along(outputs, changes))

        return Kernel([*self.symbols, *changes.values()], expressions, self.level, self.width, part_key(self.key, "tangent"))

    @cached_property
    def pullback(self) -> Kernel:
        """The kernel of the transposed derivative: it returns weights of the inputs for weights of the outputs, which it reads
        after the inputs."""
        weights = [se.Symbol(f"weight_{i}") for i in range(self.width)]

        def expressions() -> list[Expr]:
            program, table = Program(), dict[Expr, Expr]()
            shared, outputs = se.cse(self.expressions)  # each of the shared parts gets one weight
            for name, e in shared:
                table[name] = program.let(substituted(e, table))
            found = program.back([program.let(substituted(e, table)) for e in outputs], weights, self.symbols)
            return program.closed(found)

        return Kernel([*self.symbols, *weights], expressions, self.level, len(self.symbols), part_key(self.key, "pullback"))

    def straight(self) -> tuple[Program, list[Expr]]:
        """The kernel as a straight-line program (assignments one after the other, without branches), and its outputs."""
        program = Program()
        return program, [program.let(e) for e in self.expressions]

    @cached_property
    def operations(self) -> int:
        """Number of distinct subexpressions: the length of the compiled kernel."""
        key = part_key(self.key, "operations")
        found = recall(key)
        if found is None:
            keep(key, found := self._counted)
        return int(found)

    @cached_property
    def _counted(self) -> int:
        return len(se.cse(self.expressions)[0]) + len(self.expressions)

    def __call__(self, x: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        if self.symbols:
            self.compiled(x, out=out)
        else:  # LLVM cannot compile a function without arguments
            out[...] = self.once(x)

    def emit(self, part: Operations, gather: NDArray[np.intp], first: int | None = None) -> NDArray[np.intp]:
        """Append the evaluation of this kernel at points to a native program, whose numbers are in one array. gather (points,
        inputs): slots, indices of the inputs in that array. Returns the slots (points, outputs) of the values, which begin at
        `first` where that is given."""
        if gather.shape[1:] != (len(self.symbols),):
            raise internal(f"a compiled function of {len(self.symbols)} arguments was given places of arguments of shape "
                           f"{gather.shape}, whose last number should be {len(self.symbols)}")
        if self.symbols:
            return part.call(self, gather, first)
        first = part.slots(len(gather) * self.width) if first is None else first
        part.load(first, np.tile(self._fixed, len(gather)))  # LLVM cannot compile a function without arguments
        return block(first, len(gather), self.width)

    def values(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Outputs (..., outputs) for inputs x (..., inputs), by the compiled kernel."""
        if not self.symbols:
            return self.once(x)
        x = np.ascontiguousarray(x, dtype=float)
        out = np.empty((*x.shape[:-1], self.width))
        if out.size:
            self(x.reshape(-1, x.shape[-1]), out.reshape(-1, out.shape[-1]))
        return out

    def once(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Outputs as by `values`, without compiling: for constants that are evaluated once."""
        if not self.width:
            return np.empty((*x.shape[:-1], 0))
        if not self.symbols:
            return np.broadcast_to(self._fixed, (*x.shape[:-1], self.width))
        return np.asarray(self._interpreted(np.ascontiguousarray(x, dtype=float))).reshape(*x.shape[:-1], -1)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_interpreted"}

    @cached_property
    def _interpreted(self) -> Any:
        return se.Lambdify(self.symbols, self.expressions, backend="lambda", cse=True)

    @cached_property
    def oracle(self) -> Callable[[NDArray[Any]], NDArray[Any]]:
        """The same expressions evaluated by NumPy, in complex numbers too (complex step): slow, for tests and `selftest`."""
        return numpy_function(self.symbols, self.expressions)
