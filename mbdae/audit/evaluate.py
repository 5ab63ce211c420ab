"""Values of formulas: complex numbers and matrices, so that derivatives are complex steps; no broadcasting of sizes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import symengine as se

from mbdae.audit.notation import Node
from mbdae.symbolic.functions import complex_atan2

STEP = 1e-30  #: of the complex step
Value = Any  #: a complex number, or a matrix (rows, columns) of them


class SizeError(Exception):
    """A value that cannot be computed, mostly because sizes do not fit."""


class Source(Protocol):
    """Where the values of symbols come from: a state of motion of two bodies."""

    @property
    def second(self) -> float:
        """The size of the unit of time."""

    def constant(self, number: float) -> Value:
        """A number of a formula."""

    def value(self, name: str) -> Value:
        """The value of a symbol."""

    def moved(self, how: str) -> Source:
        """The same state moved by an imaginary step: "virtual" or "time"."""

    def shifted(self, name: str) -> Source:
        """The same state with one symbol moved by an imaginary step."""


def cross(v: Value) -> Value:
    """The matrix with cross(v) c = v x c."""
    if np.shape(v) != (3, 1):
        raise SizeError(f"~ of {size(v)}")
    x, y, z = v[0, 0], v[1, 0], v[2, 0]
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def size(v: Value) -> str:
    """Size of a value in words."""
    return "a number" if np.ndim(v) == 0 else f"{v.shape[0]} x {v.shape[1]}"


def magnitude(v: Value) -> Value:
    """|v| of a number, differentiable by a complex step."""
    return v if np.real(v) >= 0 else -v


def _number(v: Value) -> Value:
    if np.ndim(v):
        raise SizeError(f"a number is wanted, not {size(v)}")
    return v


def _length(v: Value) -> Value:
    if np.shape(v)[1:] != (1,):
        raise SizeError(f"norm of {size(v)}")
    return np.sqrt(np.sum(v * v) + 0j)


_PLAIN: dict[str, Callable[..., Value]] = {
    "norm": _length, "abs": lambda v: magnitude(_number(v)), "atan2": lambda y, x: complex_atan2(_number(y), _number(x)),
    "sqrt": lambda v: np.sqrt(_number(v) + 0j),
}  # fmt: skip


def evaluate(node: Node, at: Source) -> Value:
    """The value of a formula in a state; SizeError where the sizes of its pieces do not fit."""
    return _BY_KIND[node.kind](node, at)


def _sum(node: Node, at: Source) -> Value:
    total = evaluate(node.parts[0], at)
    for part in node.parts[1:]:
        term = evaluate(part, at)
        a, b = np.shape(total), np.shape(term)
        if a != b:
            raise SizeError(f"{size(total)} + {size(term)}")
        total = total + term
    return total


def _product(node: Node, at: Source) -> Value:
    total = evaluate(node.parts[0], at)
    for part in node.parts[1:]:
        total = _times(total, evaluate(part, at))
    return total


def _times(a: Value, b: Value) -> Value:
    if np.ndim(a) == 0 or np.ndim(b) == 0:
        return a * b
    if a.shape[1] != b.shape[0]:
        raise SizeError(f"{size(a)} times {size(b)}")
    c = a @ b
    return c[0, 0] if c.shape == (1, 1) else c


def _power(node: Node, at: Source) -> Value:
    base, exponent = (_number(evaluate(p, at)) for p in node.parts)
    if isinstance(base, se.Basic):
        return base**exponent
    return np.asarray(base, dtype=complex)[()] ** exponent


def _inverse(node: Node, at: Source) -> Value:
    below = _number(evaluate(node.parts[0], at))
    return 1 / below if isinstance(below, se.Basic) else np.complex128(1) / below


def _call(node: Node, at: Source) -> Value:
    name = node.value
    if name in ("delta", "rate"):
        change = np.imag(evaluate(node.parts[0], at.moved("virtual" if name == "delta" else "time"))) / STEP + 0j
        return change if name == "delta" else change / at.second
    if name == "diff":
        if node.parts[1].kind != "symbol":
            raise SizeError("diff by something that is no symbol")
        return np.imag(evaluate(node.parts[0], at.shifted(node.parts[1].value))) / STEP + 0j
    if name not in _PLAIN:  # sin, cos, tan, tanh, exp
        v = _number(evaluate(node.parts[0], at))
        return getattr(se if isinstance(v, se.Basic) else np, name)(v)
    return _PLAIN[name](*(evaluate(p, at) for p in node.parts))


def _transposed(node: Node, at: Source) -> Value:
    value = evaluate(node.parts[0], at)
    return value if np.ndim(value) == 0 else value.T


def _block(node: Node, at: Source) -> Value:
    grid = [[evaluate(p, at) for p in row.parts] for row in node.parts]
    fills = [[p.kind == "number" and p.value == 0 for p in row.parts] for row in node.parts]
    heights = [_common([np.shape(v)[0] if np.ndim(v) else 1 for v, f in zip(r, fs, strict=True) if not f])
               for r, fs in zip(grid, fills, strict=True)]  # fmt: skip
    widths = [_common([np.shape(r[j])[1] if np.ndim(r[j]) else 1 for r, fs in zip(grid, fills, strict=True) if not fs[j]])
              for j in range(len(grid[0]))]  # fmt: skip
    rows = [[np.zeros((h, w), dtype=complex) if f else np.reshape(v, (h, w)) for v, f, w in zip(r, fs, widths, strict=True)]
            for r, fs, h in zip(grid, fills, heights, strict=True)]  # fmt: skip
    out: Any = np.block(rows)
    return out[0, 0] if out.shape == (1, 1) else out


def _common(sizes: list[int]) -> int:
    """The size that all entries of a row or column share; literal zeros take it (1 where there is nothing else)."""
    if len(set(sizes)) > 1:
        raise SizeError(f"a block of {sizes[0]} beside a block of {next(s for s in sizes if s != sizes[0])}")
    return sizes[0] if sizes else 1


_BY_KIND: dict[str, Callable[[Node, Source], Value]] = {
    "number": lambda n, at: at.constant(n.value), "symbol": lambda n, at: at.value(n.value), "sum": _sum, "product": _product,
    "neg": lambda n, at: -evaluate(n.parts[0], at), "inverse": _inverse, "power": _power, "call": _call,
    "cross": lambda n, at: cross(evaluate(n.parts[0], at)), "transposed": _transposed, "block": _block,
}  # fmt: skip
