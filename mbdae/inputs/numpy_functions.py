"""NumPy's functions of expressions of time: `np.sin(2*mb.t)` is `sympy.sin(2*mb.t)`.

NumPy calls a method of the function's name on the object, and an expression such as 2*mb.t is an object of SymPy. So SymPy's
class of expressions gets these methods, where it has none, as soon as `mb.t` is used. Functions that need the value of mb.t
(math.sin, float, if, np.where, np.maximum) cannot work before a run: the TypeError of SymPy then says what to write.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any

from mbdae.errors import ExpressionError
from mbdae.values import shown

_NUMBER = "SymPy's functions, such as sympy.sin(mb.t) for math.sin(mb.t)"
_CONDITION = ("sympy.Piecewise((a, condition), (b, True)), or sympy.Max, sympy.Min, sympy.sign, sympy.Heaviside, for what "
              "switches")  # fmt: skip


@lru_cache(maxsize=1)
def teach() -> None:
    """Give SymPy's expressions the methods by which NumPy calls its functions; once."""
    import sympy as sp
    from sympy.core.relational import Relational

    known: dict[str, Callable[..., Any]] = {name: getattr(sp, name) for name in (
        "sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "sqrt")}  # fmt: skip
    known |= {"arc" + name: getattr(sp, "a" + name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")}
    known |= {
        "log2": lambda x: sp.log(x) / sp.log(2), "log10": lambda x: sp.log(x) / sp.log(10), "log1p": lambda x: sp.log(1 + x),
        "exp2": lambda x: sp.Integer(2) ** x, "expm1": lambda x: sp.exp(x) - 1, "hypot": lambda x, y: sp.sqrt(x**2 + y**2),
        "deg2rad": lambda x: x * sp.pi / 180, "rad2deg": lambda x: x * 180 / sp.pi,
        "radians": lambda x: x * sp.pi / 180, "degrees": lambda x: x * 180 / sp.pi,
        "__floor__": sp.floor, "__ceil__": sp.ceiling,
        "rint": _refusal("np.rint and np.round", "sympy.floor(x + sympy.Rational(1, 2))"),
        "arctan2": _refusal("np.arctan2", "sympy.atan(y/x), which is the same where x > 0"),
        "cbrt": _refusal("np.cbrt", "x**sympy.Rational(1, 3), which is the same where x >= 0"),
    }  # fmt: skip
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
                                      f"write {with_sympy}") from reason  # fmt: skip
            raise

    return explained
