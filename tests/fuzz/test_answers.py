"""Laws whose answers contain every function of symengine and SymPy, numbers that are none and conditions: each is derived and
runs, or is refused by a LawError with the law, the answer and what it contains; nothing else is raised."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import symengine as se
import sympy as sp

import mbdae as mb
from mbdae.symbolic.vectors import ZERO, Vec

NOT_FUNCTIONS = ("Function", "UndefFunction", "FunctionClass", "AppliedUndef", "PyFunction", "FunctionSymbol")


def functions() -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """Name of every function of one or two arguments, and the same as a function of x."""
    for module in (se, sp):
        names = sorted(n for n in dir(module) if not n.startswith("_") and n not in NOT_FUNCTIONS)
        for name in names:
            made = getattr(module, name)
            if isinstance(made, type) and _is_function(made):
                yield f"{module.__name__}.{name}", lambda x, made=made: _called(made, x)


def _is_function(made: type) -> bool:
    return issubclass(made, (se.Function, sp.Function, sp.Integral)) or made.__name__ in ("Max", "Min", "atan2", "Mod")


def _called(made: Any, x: Any) -> Any:
    x = sp.sympify(x) if made.__module__.startswith("sympy") else x
    for args in ((x,), (x, 2), (2, x), (x, 2, 3), ((x, x > 0), (1, True))):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return made(*args)
        except Exception:
            continue
    return sp.Function("unknown")(x)


VALUES: dict[str, Callable[[Any], Any]] = {
    "True": lambda x: True * x, "a condition": lambda x: (x > 0) * x if hasattr(x > 0, "__mul__") else se.Integer(1) * True,
    "zoo": lambda x: x / se.Integer(0), "infinity": lambda x: x * se.oo, "nan": lambda x: x * float("nan"),
    "inf": lambda x: x * float("inf"), "imaginary": lambda x: 1j * x, "I": lambda x: se.I * x, "large": lambda x: x * 10**400,
    "root of minus one": lambda x: se.sqrt(se.Integer(-1)) * x, "f(x)": lambda x: se.Function("f")(x),
    "derivative": lambda x: se.Derivative(se.Function("f")(se.Symbol("c")), se.Symbol("c")),
    "Heaviside": lambda x: sp.Heaviside(sp.sympify(x)), "delta": lambda x: sp.DiracDelta(sp.sympify(x)),
    "Mod": lambda x: sp.Mod(sp.sympify(x), 2), "bracket": lambda x: sp.UnevaluatedExpr(sp.sympify(x)),
    "Sum": lambda x: sp.Sum(sp.Symbol("i") * sp.sympify(x), (sp.Symbol("i"), 1, 3)),
    "Integral": lambda x: sp.Integral(sp.Symbol("z"), (sp.Symbol("z"), 0, sp.sympify(x))),
    "of a parameter": lambda x: x * sp.besselj(0, sp.Symbol("c")), "text": lambda x: "x", "None": lambda x: None,
    "a set": lambda x: {x}, "sympy's order": lambda x: sp.O(sp.sympify(x)), "a matrix": lambda x: sp.Matrix([sp.sympify(x)]),
    "an interval": lambda x: sp.Interval(0, 1), "an error": lambda x: 1 / 0, "recursion": lambda x: VALUES["recursion"](x),
    "float of x": lambda x: float(x), "stopped": lambda x: next(iter(())),
}
BAD = dict(functions()) | VALUES


def answers(f: Callable[[Any], Any]) -> dict[str, dict[str, Any]]:
    """The members of a law that contains f of something that varies, by the answer that contains it."""
    def x(k, l):
        return (l.r - k.r).norm()

    still = {"wrench": lambda self, k, l: (ZERO, ZERO)}
    state = {"states": mb.params(z="m"), "keeps_states": True, "initial": lambda self, k, l: {"z": 0}} | still
    return {
        "energy": {"energy": lambda self, k, l: self.c * f(x(k, l))},
        "dissipation": {"dissipation": lambda self, k, l: self.c * f(l.v @ l.v)},
        "wrench": {"wrench": lambda self, k, l: (Vec(self.c * f(x(k, l)), 0, 0), ZERO)},
        "thrust": {"thrust": lambda self, k, l: (x(k, l), self.c * f(x(k, l)))},
        "rates": state | {"rates": lambda self, k, l: {"z": self.c * f(x(k, l))}},
        "observed": still | {"observed": lambda self, k, l: {"size": [self.c * f(x(k, l))]}},
        "losses": still | {"losses": lambda self, k, l: {"friction": self.c * f(x(k, l))}},
        "gaps": still | {"gaps": lambda self, k, l: [(self.c * f(x(k, l)), (l.v @ l.v))]},
        "rows": {"constraints": lambda self, k, l: {"row": self.c * f(x(k, l)) - self.c * f(se.sqrt(1.09))}},
        "motion": {"coordinates": mb.params(angle=("rad", "of l")),
                   "motion": lambda self, from_k: from_k.about("z", self.c * f(self.angle))},
    }


def said(members: dict[str, Any], run: bool) -> str:
    """What was refused; "" where the law ran."""
    base = mb.Joint if {"constraints", "motion"} & members.keys() else mb.Force
    s = mb.Scene("odd")
    b = s.rigid_body("b", 1.0, (1.0, 1.0, 1.0), at=(0.3, 1.0, 0))
    try:
        law = type("Odd", (base,), {"params": mb.params(c=("N", "size"))} | members)
        s.add(law("p", s.ground, b, at=(0, 0, 0), at_l=(0, 0, 0) if "motion" in members else (0.3, 1.0, 0), c=1.0))
        if run:
            s.simulate(1e-3, accuracy=1e-3)
        else:
            s.system()
    except mb.MbdaeError as error:
        return str(error)
    return ""


def _judged(name: str, answer: str, run: bool = True) -> None:
    found = said(answers(BAD[name])[answer], run)
    assert not found or "p" in found, f"{name}: {found}"


@pytest.mark.parametrize("name", BAD)
def test_none_is_raw(name: str) -> None:
    """Every function in one of the answers, in turn."""
    kinds = list(answers(BAD[name]))
    _judged(name, kinds[list(BAD).index(name) % len(kinds)], run=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD)
def test_none_is_raw_in_any_answer(name: str) -> None:
    for answer in answers(BAD[name]):
        _judged(name, answer)


def test_these_are_all() -> None:
    assert len(BAD) > 100
    assert all(inspect.isfunction(f) for f in BAD.values())
