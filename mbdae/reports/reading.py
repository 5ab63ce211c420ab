r"""Evaluation of formulas as they are printed: LaTeX is parsed and evaluated at many states at once.

Supported: sums, products (juxtaposed, `\cdot`, `\times`), fractions, roots, powers, moduli, functions, cases, matrices,
transposes, the matrix of the vector product (a tilde). Arrays (points,) are numbers, (points, 3) vectors, (points, m, n)
matrices. At each place the longest known symbol is taken, so that symbols need no grammar of their own.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.documents.blocks import tokens
from mbdae.errors import MbdaeError, internal
from mbdae.symbolic.rebuild import complex_atan2

Key = tuple[str, ...]
Array = NDArray[Any]
RELATIONS = {"=": "=", r"\approx": "=", "<": "<", ">": "<", r"\le": "<", r"\ge": "<", r"\ne": "<"}
_SPACES = {r"\,", r"\;", r"\:", r"\!", r"\ ", r"\quad", r"\qquad", "~"}
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{f"\\{name}": getattr(np, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp")}, r"\ln": np.log,
    **{f"\\arc{name}": getattr(np, f"arc{name}") for name in ("sin", "cos", "tan")}, "sgn": np.sign, "atan2": complex_atan2,
    r"\max": np.maximum, r"\min": np.minimum,
}
_COMPARED: dict[str, Callable[..., Any]] = {"<": np.less, ">": np.greater, r"\le": np.less_equal, r"\ge": np.greater_equal,
                                            "=": np.equal, r"\ne": np.not_equal}
_TRANSPOSED = ("{", r"\mathsf", "{", "T", "}", "}")
_STOP = {"", "+", "-", ")", "}", "]", ",", "&", r"\\", r"\right", r"\rVert", r"\rvert", r"\end", *RELATIONS}


class UnreadError(MbdaeError):
    """A printed formula that cannot be read; the message gives the place and the reason."""


def key_of(latex: str) -> Key:
    r"""A formula as tokens without spaces; `\text{...}`, with its spaces, is one token."""
    parts = re.split(r"(\\text\{[^{}]*\})", latex)
    split = (tokens(part) if i % 2 == 0 else [part] for i, part in enumerate(parts))
    return tuple(t for found in split for t in found if not t.isspace() and t not in _SPACES)


def members(line: Key) -> list[tuple[str, Key]]:
    """The members of a chain of relations, each with the relation in front of it."""
    found: list[tuple[str, list[str]]] = [("", [])]
    depth = 0
    for token in line:
        depth += (token in ("{", "(", r"\left", r"\begin")) - (token in ("}", ")", r"\right", r"\end"))
        if token in RELATIONS and depth == 0:
            found.append((token, []))
        else:
            found[-1][1].append(token)
    return [(relation, tuple(part)) for relation, part in found]


class Symbols:
    """Known symbols with their values, or with functions that return them."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._by_first: dict[str, dict[Key, Any]] = {}
        for latex, value in values.items():
            self.add(key_of(latex), value)

    def add(self, key: Key, value: Any) -> None:
        """Add a symbol."""
        self._by_first.setdefault(key[0], {})[key] = value

    def __contains__(self, key: Key) -> bool:
        return bool(key) and key in self._by_first.get(key[0], {})

    def value(self, key: Key) -> Any:
        """Value of a symbol; a function is called once and its result kept."""
        table = self._by_first[key[0]]
        if callable(table[key]):
            table[key] = table[key]()
        return table[key]

    def at(self, line: Sequence[str], i: int) -> Key | None:
        """The longest known symbol at a place; None where there is none."""
        found = [key for key in self._by_first.get(line[i], {}) if tuple(line[i : i + len(key)]) == key]
        return max(found, key=len) if found else None


class Summed(NamedTuple):
    r"""The value of a sign such as `\sum_i`: states, points and nodes of arrays of this shape are summed along an axis."""

    shape: tuple[int, int, int]
    axis: int

    def of(self, values: Array) -> Array:
        """The sum of what follows the sign, at every state, point and node."""
        each = values.reshape(*self.shape, *values.shape[1:])
        return np.asarray(np.broadcast_to(each.sum(axis=self.axis, keepdims=True), each.shape).reshape(values.shape))


_KINDS = ("a number", "a number", "a vector", "a matrix")  #: what a value is, by its number of dimensions, the first of states


class LatexReader:
    """Evaluates one formula."""

    def __init__(self, line: Sequence[str], symbols: Symbols, points: int) -> None:
        self.line, self.symbols, self.points, self.i = tuple(line), symbols, points, 0
        self.largest = self.outer = 0.0  #: largest absolute value of all terms read, and of those of the sum read last

    def whole(self) -> Array:
        """The value of the whole formula; UnreadError where something is left over."""
        found: Array = self.sum()
        if self.i < len(self.line):
            raise self._fault_of_mbdae(f"'{self.peek()}' is left over")
        return found

    def peek(self) -> str:
        """The next token without consuming it; empty at the end."""
        return self.line[self.i] if self.i < len(self.line) else ""

    def take(self, wanted: str = "") -> str:
        """Consume the next token; UnreadError where it is not the wanted one."""
        token = self.peek()
        if wanted and token != wanted:
            raise self._fault_of_mbdae(f"'{wanted}' is missing" + (f" before '{token}'" if token else " at the end"))
        self.i += 1
        return token

    def _fault_of_mbdae(self, problem: str) -> Exception:
        return internal(f"'{' '.join(self.line)}', as the report prints it, has no value from symbol {self.i + 1} on: {problem}",
                        UnreadError)

    def sum(self) -> Any:
        """Value of a sum of signed terms."""
        total, outer = None, 0.0
        while total is None or self.peek() in ("+", "-"):
            sign = self.take() if self.peek() in ("+", "-") else "+"
            term = self.product() if sign == "+" else -self.product()
            self.largest = max(self.largest, outer := max(outer, float(np.max(abs(term), where=np.isfinite(term), initial=0.0))))
            if total is not None and np.ndim(total) != np.ndim(term) and not (isinstance(total, int) or isinstance(term, int)):
                raise self._fault_of_mbdae("two terms of a sum are not both numbers, both vectors or both matrices")
            total = term if total is None else total + term
        self.outer = outer
        return total

    def product(self) -> Any:
        """Value of a product, multiplied from left to right."""
        found = self.power()
        while self.peek() not in _STOP:
            sign = self.take() if self.peek() in (r"\cdot", r"\times", "/") else ""
            found = self._times(found, self.power(), sign)
        return found

    def _times(self, a: Any, b: Any, sign: str) -> Any:
        m, n = np.ndim(a), np.ndim(b)
        if sign == r"\times" and (m, n) == (2, 2):
            return np.cross(a, b)
        if sign == r"\cdot" and (m, n) == (2, 2):
            return np.sum(a * b, axis=-1)
        if sign == "/" and n == 1:
            return a / _wide(b, m)
        if sign in ("", r"\cdot") and min(m, n) <= 1:
            return _wide(a, n) * _wide(b, m)
        if sign == "" and m == 3:
            found = np.einsum("pij,pj->pi", a, b) if n == 2 else np.einsum("pij,pjk->pik", a, b)
            return found.reshape(self.points) if found[0].size == 1 else found
        raise self._fault_of_mbdae(f"{sign or 'a product without sign'} stands between {_KINDS[m]} and {_KINDS[n]}")

    def power(self) -> Any:
        """Value of a factor with its exponents."""
        found = self.atom()
        while self.peek() == "^":
            self.take()
            if self.line[self.i : self.i + len(_TRANSPOSED)] == _TRANSPOSED:
                self.i += len(_TRANSPOSED)
                found = found[:, None, :] if np.ndim(found) == 2 else np.swapaxes(found, 1, 2)
                continue
            exponent = np.real(self.group())
            whole = np.all(exponent == np.round(exponent)) and exponent.flat[0] >= 0
            found = found ** int(exponent.flat[0]) if whole else found**exponent
        return found

    def group(self) -> Any:
        """Value of a formula in braces."""
        self.take("{")
        found = self.sum()
        self.take("}")
        return found

    def atom(self) -> Any:
        """Value of a number, a symbol or a bracket."""
        if self.peek() == "":
            raise self._fault_of_mbdae("the formula ends where a term should follow")
        key = self.symbols.at(self.line, self.i)
        if key is not None:
            self.i += len(key)
            if self.peek() in ("_", "'"):
                index = "".join(self.line[self.i : self.i + 6])
                raise self._fault_of_mbdae(f"{''.join(key)} has a value, but not with the index or accent after it: {index}")
            found = self.symbols.value(key)
            return found.of(self.product()) if isinstance(found, Summed) else found
        token = self.take()
        if token.isdigit() or token == ".":
            return self._number(token)
        if token == r"\pi":
            return np.full(self.points, np.pi)
        if token in ("frac", r"\frac", r"\tfrac"):
            above = self.group()
            return self._times(above, self.group(), "/")
        if token == r"\sqrt":
            return np.sqrt(self.group())
        if token == r"\mathbf" and self.line[self.i : self.i + 3] in (("{", "0", "}"), ("{", "1", "}")):
            one = self.line[self.i + 1] == "1"
            self.i += 3
            return _Filled(one, self.points)
        if token == r"\tilde":
            return skewed(self.group())
        if token in _FUNCTIONS or token == r"\operatorname":
            return self._function(token)
        return self._bracket(token)

    def _number(self, text: str) -> Array:
        while self.peek().isdigit() or self.peek() == ".":
            text += self.take()
        return np.full(self.points, float(text))

    def _function(self, token: str) -> Any:
        name = token
        if token == r"\operatorname":
            name = "".join(self.line[self.i + 1 : self.line.index("}", self.i)])
            self.i += len(name) + 2
        if name not in _FUNCTIONS:
            raise self._fault_of_mbdae(f"the function {name} is not known")
        if self.peek() != r"\left":
            return _FUNCTIONS[name](self.atom())
        self.take()
        self.take("(")
        arguments = [self.sum()]
        while self.peek() == ",":
            self.take()
            arguments.append(self.sum())
        self.take(r"\right")
        self.take(")")
        return _FUNCTIONS[name](*arguments)

    def _bracket(self, token: str) -> Any:
        if token == "(":
            found = self.sum()
            self.take(")")
            return found
        if token == "{":
            self.i -= 1
            return self.group()
        if token == r"\lVert":
            found = self.sum()
            self.take(r"\rVert")
            return np.sqrt(np.sum(found * found, axis=-1))
        if token == r"\lvert":
            found = self.sum()
            self.take(r"\rvert")
            return np.where(np.real(found) < 0, -found, found)
        if token == r"\left":
            opening, found = self.take(), self.sum()
            self.take(r"\right")
            self.take({"(": ")", r"\lfloor": r"\rfloor", "[": "]"}[opening])
            return np.floor(np.real(found)) if opening == r"\lfloor" else found
        if token == r"\begin":
            kind = "".join(self.line[self.i + 1 : self.line.index("}", self.i)])
            self.i += len(kind) + 2
            return self._cases() if kind == "cases" else self._matrix()
        raise self._fault_of_mbdae(f"the symbol '{token}' has no value: the page does not define it")

    def _end(self) -> None:
        self.take(r"\end")
        self.i = self.line.index("}", self.i) + 1

    def _cases(self) -> Any:
        values, conditions = [], []
        with np.errstate(all="ignore"):
            while True:
                values.append(np.broadcast_to(self.sum(), (self.points,)))
                self.take("&")
                conditions.append(self._condition())
                if self.peek() != r"\\":
                    break
                self.take()
        self._end()
        return np.select(conditions, values)

    def _condition(self) -> Array:
        if self.peek().startswith(r"\text{"):
            self.take()
            return np.ones(self.points, dtype=bool)
        left = np.real(self.sum())
        relation = self.take()
        if relation not in _COMPARED:
            raise self._fault_of_mbdae(f"'{relation}' stands where a relation such as = or < should stand")
        found: Array = _COMPARED[relation](left, np.real(self.sum()))
        return found

    def _matrix(self) -> Any:
        rows: list[list[Any]] = [[]]
        while True:
            rows[-1].append(self.sum())
            token = self.peek()
            if token == r"\end":
                self._end()
                break
            self.take()
            if token == r"\\":
                rows.append([])
            elif token != "&":
                raise self._fault_of_mbdae("a matrix has no end")
        found = assembled(rows, self.points)
        return found[:, 0, 0] if found[0].size == 1 else found


class _Filled(np.ndarray):
    """A zero vector or unit that becomes, inside a matrix, a zero or unit block of fitting size, times its first entry."""

    def __new__(cls, one: bool, points: int) -> _Filled:
        return np.full((points, 3), float(one)).view(cls)


def assembled(rows: list[list[Any]], points: int) -> Array:
    """A matrix (points, m, n) of blocks; vectors are columns. Zero and unit blocks take the size of their row and column."""
    blocks = [[None if isinstance(c, _Filled) else np.asarray(c)[:, None, None] if np.ndim(c) == 1 else np.asarray(c)[..., None]
               if np.ndim(c) == 2 else np.asarray(c) for c in row] for row in rows]
    high = [next((b.shape[1] for b in row if b is not None), 1 if np.ndim(given[0]) == 3 else 3)
            for row, given in zip(blocks, rows, strict=True)]
    wide = [next((b.shape[2] for b in column if b is not None), 3) for column in zip(*blocks, strict=True)]
    out = []
    for i, row in enumerate(blocks):
        cells = []
        for j, block in enumerate(row):
            filled = np.eye(high[i], wide[j]) * rows[i][j][0, 0] if block is None else block
            cells.append(np.broadcast_to(filled, (points, high[i], wide[j])))
        out.append(np.concatenate(cells, axis=2))
    return np.concatenate(out, axis=1)


def skewed(a: Array) -> Array:
    """The matrix of the vector product with a, (points, 3, 3)."""
    return np.stack([np.cross(a, np.broadcast_to(e, a.shape)) for e in np.eye(3)], axis=-1)


def _wide(a: Any, kind: int) -> Any:
    """A number (points,) with further axes of length 1, so that it can be multiplied by an array of `kind` axes; other values
    unchanged."""
    return a[(..., *[None] * (kind - 1))] if np.ndim(a) == 1 and kind > 1 else a
