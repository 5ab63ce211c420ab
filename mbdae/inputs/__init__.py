"""Functions of time: their language, where they jump, how fast they vary.

NumPy's functions of expressions of time: `np.sin(2*mb.t)` is `sympy.sin(2*mb.t)`.

NumPy calls a method of the function's name on the object, and an expression such as 2*mb.t is an object of SymPy. So SymPy's
class of expressions gets these methods, where it has none, as soon as `mb.t` is used. Functions that need the value of mb.t
(math.sin, float, if, np.where, np.maximum) cannot work before a run: the TypeError of SymPy then says what to write.

The time `mb.t` without importing SymPy, as long as expressions of it have only numbers, + - * / ** and NumPy's functions.

SymPy takes longer to import than a small scene to run, and most drives need no more than these. Where SymPy has been imported
already, `mb.t` is its symbol. Else it is an object of `Timed`, which keeps the operations. symengine carries them out for the
core; SymPy does as soon as a user asks for anything that is not defined here (an attribute, a comparison, an operation with an
object of SymPy), and gives the very expression that it would have made from the beginning.
"""

from __future__ import annotations

import math
import operator
import sys
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any

import symengine as se

from mbdae.errors import ExpressionError
from mbdae.inputs.text import TIME
from mbdae.symbolic.vectors import Expr
from mbdae.values import shown

_NUMBER = "SymPy's functions, such as sympy.sin(mb.t) for math.sin(mb.t)"
_CONDITION = ("sympy.Piecewise((a, condition), (b, True)), or sympy.Max, sympy.Min, sympy.sign, sympy.Heaviside, for what "
              "switches")


@lru_cache(maxsize=1)
def teach() -> None:
    """Give SymPy's expressions the methods by which NumPy calls its functions; once."""
    import sympy as sp
    from sympy.core.relational import Relational

    known: dict[str, Callable[..., Any]] = {name: getattr(sp, name) for name in (
        "sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt")}
    known |= {"arc" + name: getattr(sp, "a" + name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")}
    known |= {
        "log2": lambda x: sp.log(x) / sp.log(2), "log10": lambda x: sp.log(x) / sp.log(10), "log1p": lambda x: sp.log(1 + x),
        "exp2": lambda x: sp.Integer(2) ** x, "expm1": lambda x: sp.exp(x) - 1,
        "hypot": lambda x, y: sp.sqrt(x**2 + y**2), "arctan2": sp.atan2,
        "deg2rad": lambda x: x * sp.pi / 180, "rad2deg": lambda x: x * 180 / sp.pi,
        "radians": lambda x: x * sp.pi / 180, "degrees": lambda x: x * 180 / sp.pi,
        "__floor__": sp.floor, "__ceil__": sp.ceiling,
        "rint": _refusal("np.rint and np.round", "sympy.floor(x + sympy.Rational(1, 2))"),
        "cbrt": _refusal("np.cbrt", "x**sympy.Rational(1, 3), which is the same where x >= 0"),
    }
    for name, function in known.items():
        if not hasattr(sp.Expr, name):
            setattr(sp.Expr, name, _method(function))
    sp.Expr.__float__ = _with_remedy(sp.Expr.__float__, _NUMBER)
    Relational.__bool__ = _with_remedy(Relational.__bool__, _CONDITION)


def _method(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *args: function(*args)


def _refusal(numpy_function: str, with_sympy: str) -> Callable[..., Any]:
    def refuse(*args: Any) -> Any:
        raise ExpressionError(f"{numpy_function} cannot take {shown(args[0])}, an expression of mb.t: write {with_sympy}")

    return refuse


def _with_remedy(method: Callable[[Any], Any], with_sympy: str) -> Any:
    """The method, with what to write added to the text of its TypeError for expressions of mb.t."""

    @wraps(method)
    def explained(self: Any) -> Any:
        try:
            return method(self)
        except TypeError as reason:
            if any(s.name == "t" for s in self.free_symbols if hasattr(s, "name")):
                raise ExpressionError(f"{shown(self)} depends on mb.t and has no value before a run ({reason}): "
                                      f"write {with_sympy}") from reason
            raise

    return explained


#: most operations in one object, the time t counted as one wherever it occurs; longer expressions become SymPy's, in which a sum
#: is one node instead of a chain
MOST = 60
FUNCTIONS = ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log")
_OPERATORS: dict[str, Callable[..., Any]] = {
    name: getattr(operator, name) for name in ("add", "sub", "mul", "truediv", "pow", "neg", "pos")}


@lru_cache(maxsize=1)
def sympy_time() -> Any:
    """SymPy's symbol t, which `mb.t` is; its expressions take NumPy's functions."""
    import sympy

    teach()
    return sympy.Symbol("t")


def _made(operation: str, *args: Any) -> Any:
    """The result of an operation: an object of `Timed` where all arguments are such objects or Python's numbers, else SymPy's."""
    if not all(type(a) is Timed or (isinstance(a, int | float) and not isinstance(a, bool)) for a in args):
        return _carried_out(operation, [a._sympy_() if type(a) is Timed else a for a in args], _sympy_function)
    found = Timed(operation, *args)
    return found if found._size <= MOST else found._sympy_()


def _carried_out(operation: str, args: list[Any], function: Callable[[str], Any]) -> Any:
    return (_OPERATORS.get(operation) or function(operation))(*args)


def _sympy_function(name: str) -> Any:
    import sympy

    return getattr(sympy, name)


class Timed:
    """An operation with its arguments; operation "": the time itself."""

    __slots__ = ("_args", "_found", "_operation", "_size")

    def __init__(self, operation: str = "", *args: Any) -> None:
        self._operation, self._args, self._found = operation, args, None
        self._size: int = 1 + sum(a._size for a in args if type(a) is Timed)

    def _sympy_(self) -> Any:
        """The expression of SymPy; sympy.sympify calls this method."""
        if self._found is None:
            args = [a._sympy_() if type(a) is Timed else a for a in self._args]
            self._found = _carried_out(self._operation, args, _sympy_function) if self._operation else sympy_time()
        return self._found

    def _symengine_(self) -> Expr:
        """The expression of symengine; symengine.sympify calls this method."""
        if not self._operation:
            return TIME
        args = [a._symengine_() if type(a) is Timed else se.sympify(a) for a in self._args]
        return _carried_out(self._operation, args, lambda name: getattr(se, name))

    def __getattr__(self, name: str) -> Any:
        if name in FUNCTIONS:  # np.sin(x) of an object x calls x.sin()
            return lambda: _made(name, self)
        if name.startswith("_") and not name.startswith("_repr_"):
            raise AttributeError(name)
        return getattr(self._sympy_(), name)

    def __reduce__(self) -> Any:
        return Timed, (self._operation, *self._args)

    def __dir__(self) -> list[str]:
        return dir(self._sympy_())

    def __hash__(self) -> int:
        return hash(self._sympy_())

    def __eq__(self, other: object) -> bool:
        return self is other or bool(self._sympy_() == other)

    def __bool__(self) -> bool:
        return bool(self._sympy_())


def _forward(name: str) -> Any:
    return lambda self, *args: _made(name, self, *args)


def _reflected(name: str) -> Any:
    return lambda self, other: _made(name, other, self)


def _asked(function: Callable[..., Any]) -> Any:
    """A method that is carried out on the expression of SymPy."""
    return lambda self, *args: function(self._sympy_(), *args)


for _name in _OPERATORS:
    setattr(Timed, f"__{_name}__", _forward(_name))
for _name in ("add", "sub", "mul", "truediv", "pow"):
    setattr(Timed, f"__r{_name}__", _reflected(_name))
_ASKED: dict[str, Callable[..., Any]] = {
    "lt": operator.lt, "le": operator.le, "gt": operator.gt, "ge": operator.ge, "abs": abs, "mod": operator.mod,
    "floordiv": operator.floordiv, "rmod": lambda a, b: b % a, "rfloordiv": lambda a, b: b // a, "divmod": divmod,
    "rdivmod": lambda a, b: divmod(b, a), "str": str, "repr": repr, "format": format, "float": float, "int": int,
    "complex": complex, "round": round, "floor": math.floor, "ceil": math.ceil, "trunc": math.trunc,
}
for _name, _function in _ASKED.items():
    setattr(Timed, f"__{_name}__", _asked(_function))
_TIME = Timed()


def time_symbol() -> Any:
    """The object `mb.t`: SymPy's symbol as soon as SymPy has been imported, before that one of `Timed`."""
    return sympy_time() if "sympy" in sys.modules else _TIME
