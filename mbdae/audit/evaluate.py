"""Values of formulas: complex numbers and matrices, so that derivatives can be complex steps; sizes are never broadcast."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.calculus import chain, unfolded
from mbdae.audit.notation import Node
from mbdae.errors import MbdaeError
from mbdae.symbolic.rebuild import complex_atan2

STEP = 1e-30  #: size of the complex step; its error, of order STEP^2, is far below round-off, and nothing is subtracted
FINITE = 0.01  #: spacing of the finite differences for the outer one of two nested derivatives: FINITE^10 is below round-off
#: coefficients of central differences at 1 to 5 steps, of order 10 and of order 8
_CENTRAL = np.array([[5 / 6, -5 / 21, 5 / 84, -5 / 504, 1 / 1260], [4 / 5, -1 / 5, 4 / 105, -1 / 280, 0]])
#: largest relative difference of the two orders: the error of order 10 was then below 2e-10 next to edges of roots
SMOOTH = 1e-9
Value = Any  #: a complex number, or a matrix (rows, columns) of them
Source = Any  #: an `Env` (phrases.py): the values of symbols in a state, and states moved from it for derivatives


class SizeError(Exception):
    """A value that cannot be computed, mostly because sizes do not fit."""

    placed = False  #: whether the message already names the piece of the formula


class OutsideError(SizeError):
    """A function has no real value in this state, which is no test of the formula then. condition: under which it has one; empty
    where the state is too near to an edge or a corner for a derivative by differences."""

    placed = True

    def __init__(self, condition: str = "") -> None:
        self.condition = condition
        what = f"a side is real for {condition} alone" if condition else "its derivatives exist away from edges and corners alone"
        super().__init__(f"{what}, where none of the states tried is together with the other sides: say what is assumed")


class NestedError(SizeError):
    """A derivative is asked for inside of a complex step; the outer derivative is then taken by finite differences."""

    placed = True


#: messages of numerical errors, in words
_CAUSES = {ZeroDivisionError: "a quantity it divides by is 0", OverflowError: "a number in it grows beyond all bounds",
           np.linalg.LinAlgError: "its matrix has no inverse"}


def reason(error: Exception, what: object) -> str:
    """Why something has no value, in words."""
    why = next((words for kind, words in _CAUSES.items() if isinstance(error, kind)), str(error))
    return why if isinstance(error, MbdaeError) or getattr(error, "placed", False) else f"{what} has no value: {why}"


#: errors that mean that a formula has no value in a state
NO_VALUE = (SizeError, MbdaeError, ArithmeticError, np.linalg.LinAlgError)


def derivative(value_at: Callable[[complex], Value], stepped: bool = False) -> Value:
    """Derivative at h = 0 of a function of h: by a complex step, or by finite differences inside of another complex step."""
    if not stepped:
        try:
            return np.imag(value_at(1j * STEP)) / STEP + 0j
        except NestedError:
            pass
    ends = [value_at(n * FINITE) - value_at(-n * FINITE) for n in range(1, 6)]
    fine, rough = (sum(c * e for c, e in zip(row, ends, strict=True)) / FINITE for row in _CENTRAL)
    for a, b in ((np.real(fine), np.real(rough)), (np.imag(fine) / STEP, np.imag(rough) / STEP)):
        if np.max(np.abs(a - b)) > SMOOTH * max(1.0, float(np.max(np.abs(a)))):
            raise OutsideError
    return fine


def shifted(value: Value, entry: int, amount: complex) -> Value:
    """A value with a number added to one of its entries."""
    if np.ndim(value) == 0:
        return value + amount
    out = np.array(value, dtype=complex)
    out.flat[entry] += amount
    return out


def _ndim(v: Value) -> int:
    """np.ndim of a number or array; faster, because it makes no array of a number."""
    return getattr(v, "ndim", 0)


def cross(v: Value) -> Value:
    """The matrix with cross(v) c = v x c."""
    if np.shape(v) != (3, 1):
        raise SizeError(f"the matrix of a cross product is that of a 3 x 1 column, not of {size(v)}")
    x, y, z = v[0, 0], v[1, 0], v[2, 0]
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def size(v: Value) -> str:
    """Size of a value in words."""
    return "a number" if _ndim(v) == 0 else f"{v.shape[0]} x {v.shape[1]}"


def magnitude(v: Value) -> Value:
    """|v| of a number, differentiable by a complex step."""
    return v if np.real(v) >= 0 else -v


def _number(v: Value) -> Value:
    if _ndim(v):
        raise SizeError(f"the argument of a function, a divisor, an exponent or a limit must be a number, not {size(v)}")
    return v


def _square(v: Value) -> Value:
    if _ndim(v) != 2 or v.shape[0] != v.shape[1]:
        raise SizeError(f"trace, det and the power -1 take a square matrix, not {size(v)}")
    return v


def _length(v: Value) -> Value:
    if np.shape(v)[1:] != (1,):
        raise SizeError(f"norm takes a column (n x 1), not {size(v)}; of a number write abs")
    return np.sqrt(np.sum(v * v) + 0j)


_PLAIN: dict[str, Callable[..., Value]] = {
    "norm": _length, "abs": lambda v: magnitude(_number(v)), "atan2": lambda y, x: complex_atan2(_number(y), _number(x)),
    "sqrt": lambda v: np.sqrt(_number(v) + 0j), "sign": lambda v: np.sign(np.real(_number(v))) + 0j,
    "log": lambda v: np.log(_number(v) + 0j), "asin": lambda v: np.arcsin(_number(v)), "acos": lambda v: np.arccos(_number(v)),
    "atan": lambda v: np.arctan(_number(v)), "asinh": lambda v: np.arcsinh(_number(v)),
    "acosh": lambda v: np.arccosh(_number(v) + 0j), "atanh": lambda v: np.arctanh(_number(v)),
    "trace": lambda m: np.trace(_square(m)), "det": lambda m: np.linalg.det(_square(m)),
}
#: functions with real values for some arguments alone: whether the real part is one of those, and the condition in words
_REAL: dict[str, tuple[Callable[[float], bool], str]] = {
    "sqrt": (lambda x: x >= 0, "{} > 0"), "log": (lambda x: x > 0, "{} > 0"), "acosh": (lambda x: x >= 1, "{} > 1"),
    **dict.fromkeys(("asin", "acos", "atanh"), (lambda x: abs(x) <= 1, "{} in (-1, 1)")),
}
PARTIAL = (*_REAL, "power", "inverse", "tan")  #: functions and pieces that are not defined for all arguments


def evaluate(node: Node, at: Source) -> Value:
    """The value of a formula in a state; SizeError where the sizes of its pieces do not fit."""
    try:
        rule = _BY_KIND[node.kind]
        return at.kept(node, rule) if node.parts else rule(node, at)
    except (SizeError, ArithmeticError, np.linalg.LinAlgError) as error:
        if getattr(error, "placed", False):
            raise
        found = SizeError(reason(error, node))
        found.placed = True
        raise found from error


def infinite(node: Node, at: Source) -> Node | None:
    """The innermost piece of a formula whose value is not finite; None where all are."""
    inner = next(filter(None, (infinite(p, at) for p in node.parts)), None) if node.kind not in ("call", "block") else None
    value = None if inner is not None or node.kind == "row" else attempt(node, at)
    return inner or (node if value is not None and not np.all(np.isfinite(np.asarray(value, dtype=complex))) else None)


def attempt(node: Node, at: Source, outside: Any = None) -> Any:
    """The value of a formula; None where it has none, `outside` where it is not real."""
    try:
        with np.errstate(all="ignore"):
            return evaluate(node, at)
    except OutsideError:
        return outside
    except NO_VALUE:
        return None


def _sum(node: Node, at: Source) -> Value:
    total = evaluate(node.parts[0], at)
    for part in node.parts[1:]:
        term = evaluate(part, at)
        if np.shape(total) != np.shape(term):
            raise SizeError(f"sizes do not fit: {size(total)} + {size(term)}; the terms of a sum need one size")
        total = total + term
    return total


def _product(node: Node, at: Source) -> Value:
    total = evaluate(node.parts[0], at)
    for part in node.parts[1:]:
        total = _times(total, evaluate(part, at))
    return total


def _times(a: Value, b: Value) -> Value:
    if _ndim(a) == 0 or _ndim(b) == 0:
        return a * b
    if a.shape[1] != b.shape[0]:
        raise SizeError(f"sizes do not fit: {size(a)} times {size(b)}, where the left one needs as many columns as the right "
                        f"one has rows")
    c = a @ b
    return c[0, 0] if c.shape == (1, 1) else c


def _power(node: Node, at: Source) -> Value:
    base, exponent = (evaluate(p, at) for p in node.parts)
    exponent = _number(exponent)
    if _ndim(base):
        if exponent not in (-1, 2):
            raise SizeError(f"{size(base)} to the power {node.parts[1]}: of a matrix, only the powers -1 and 2 are known")
        return np.linalg.inv(_square(base)) if exponent == -1 else _times(base, base)
    if isinstance(base, se.Basic):
        return base**exponent
    if base == 0 and np.real(exponent) > 0:
        return 0j
    if exponent == 2:
        return base * base
    if np.real(base) < 0 and (np.real(exponent) % 1 or np.imag(exponent)) and at.scale is None:
        raise OutsideError(f"{node.parts[0]} > 0")
    if np.real(exponent) < 0:
        _watched(node.parts[0], at)
    return np.asarray(base, dtype=complex)[()] ** exponent


def _watched(below: Node, at: Source) -> None:
    """Note the sign of a divisor, of a magnitude or an even power that of what is in it."""
    while (below.kind == "call" and below.value == "abs") or (below.kind == "power" and below.parts[1].value in (2, 4)):
        below = below.parts[0]
    value = evaluate(below, at)
    at.watched(below, value)
    if below.kind == "call" and below.value == "norm" and _is_rate(below.parts[0], at):
        at.watched(below, -value)


def _is_rate(node: Node, at: Source) -> bool:
    """Whether a formula is the rate of a function of time, which may be zero."""
    place = chain(node)
    formula = getattr(at.scope.symbols.get(place[0]), "node", None) if place else None
    return place is not None and (place[1] > 0 or (formula is not None and _is_rate(formula, at)))


def _inverse(node: Node, at: Source) -> Value:
    below = _number(evaluate(node.parts[0], at))
    _watched(node.parts[0], at)
    return 1 / below if isinstance(below, se.Basic) else np.complex128(1) / below


_MOVES = {"delta": "virtual", "rate": "time", "slope": "line"}


def _call(node: Node, at: Source) -> Value:
    name, parts = node.value, node.parts
    if name in ("rate", "diff") and not at.motion.symbolic and (rule := at.by_rules(node)) is not None:
        return rule
    if name in _MOVES:
        how = _MOVES[name]
        return derivative(lambda h: evaluate(parts[0], at.moved(how, h)), at.stepped) / at.size_of(how)
    if name == "diff":
        return _partial(parts[0], parts[1], at)
    if name == "sum":
        ends = [float(np.real(_number(evaluate(p, at)))) for p in parts[2:]]
        if not all(map(float.is_integer, ends)):
            raise SizeError(f"the limits of a sum must be whole numbers, not {ends[0]:g} and {ends[1]:g}")
        first, last = map(int, ends)
        body = unfolded(parts[0], parts[1].value, at.scope)
        return sum(evaluate(body, at.bound(parts[1].value, complex(i))) for i in range(first, last + 1))
    if name == "integral":
        return _integral(node, at)
    values = [evaluate(p, at) for p in parts]
    if name in _REAL and at.scale is None and not isinstance(values[0], se.Basic):
        real, condition = _REAL[name]
        if not real(np.real(_number(values[0]))):
            raise OutsideError(condition.format(parts[0]))
    if name == "tan":
        at.watched(Node("call", "cos", parts), np.cos(np.real(values[0])))
    if name in _PLAIN:
        return _PLAIN[name](*values)
    v = _number(values[0])  # sin, cos, tan, sinh, cosh, tanh, exp
    return getattr(se if isinstance(v, se.Basic) else np, name)(v)


def _partial(e: Node, by: Node, at: Source) -> Value:
    """Partial derivative: by a number or the rate of one, or by a column (n, 1), which gives a matrix with one column for each
    entry."""
    order, of = 0, by
    while of.kind == "call" and of.value == "rate":
        order, of = order + 1, of.parts[0]
    if of.kind != "symbol":
        raise SizeError(f"the second argument of diff must be a symbol or its rate, not the formula {by}")

    def along(entry: int) -> Value:
        return derivative(lambda h: evaluate(e, at.shifted(of.value, h, entry, order)), at.stepped)

    wanted = np.shape(at.value(of.value))
    if not wanted:
        return along(0)
    return np.hstack([np.reshape(along(i), (-1, 1)) for i in range(wanted[0] * wanted[1])])


#: nodes and weights of the tanh-sinh rule on (-1, 1), accurate also for integrands with steep ends, as sqrt(x) at 0
_T = np.arange(-62, 63) * 0.05
_NODES = np.tanh(np.pi / 2 * np.sinh(_T))
_WEIGHTS = 0.05 * np.pi / 2 * np.cosh(_T) / np.cosh(np.pi / 2 * np.sinh(_T)) ** 2


def _integral(node: Node, at: Source) -> Value:
    low, high = (_number(evaluate(p, at)) for p in node.parts[2:])
    middle, half = (low + high) / 2, (high - low) / 2
    body = unfolded(node.parts[0], node.parts[1].value, at.scope)
    inside = [evaluate(body, at.bound(node.parts[1].value, middle + half * x)) for x in _NODES]
    return half * sum(w * v for w, v in zip(_WEIGHTS, inside, strict=True))


def _transposed(node: Node, at: Source) -> Value:
    value = evaluate(node.parts[0], at)
    return value if _ndim(value) == 0 else value.T


def _block(node: Node, at: Source) -> Value:
    grid = [[evaluate(p, at) for p in row.parts] for row in node.parts]
    fills = [[p.kind == "number" and p.value == 0 for p in row.parts] for row in node.parts]
    fill = at.fill if len(grid[0]) == 1 else 1
    heights = [_common([np.shape(v)[0] if _ndim(v) else 1 for v, f in zip(r, fs, strict=True) if not f], fill)
               for r, fs in zip(grid, fills, strict=True)]
    widths = [_common([np.shape(r[j])[1] if _ndim(r[j]) else 1 for r, fs in zip(grid, fills, strict=True) if not fs[j]])
              for j in range(len(grid[0]))]
    rows = [[np.zeros((h, w), dtype=complex) if f else np.reshape(v, (h, w)) for v, f, w in zip(r, fs, widths, strict=True)]
            for r, fs, h in zip(grid, fills, heights, strict=True)]
    out: Any = np.block(rows)
    return out[0, 0] if out.shape == (1, 1) else out


def _common(sizes: list[int], fill: int = 1) -> int:
    """The size that all entries of a row or column of blocks share; literal zeros take it (`fill` if all are zeros)."""
    if len(set(sizes)) > 1:
        other = next(s for s in sizes if s != sizes[0])
        raise SizeError(f"sizes do not fit: in the block matrix, an entry of {sizes[0]} rows or columns is beside one of {other}")
    return sizes[0] if sizes else fill


_BY_KIND: dict[str, Callable[[Node, Source], Value]] = {
    "number": lambda n, at: at.constant(n.value), "symbol": lambda n, at: at.value(n.value), "sum": _sum, "product": _product,
    "neg": lambda n, at: -evaluate(n.parts[0], at), "inverse": _inverse, "power": _power, "call": _call,
    "cross": lambda n, at: cross(evaluate(n.parts[0], at)), "transposed": _transposed, "block": _block,
}
