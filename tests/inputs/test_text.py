"""Expressions of time as text: every digit comes back, and nothing but the language of inputs is read."""

from __future__ import annotations

import random
import time
from typing import Any

import numpy as np
import pytest
import symengine as se
import sympy as sp

import mbdae as mb
from mbdae.inputs import text, timed

t = mb.t
NAMED = {
    "nested": sp.Piecewise((0, t < 0.05), (sp.Piecewise((sp.cos(t), sp.And(t > 1, sp.Or(t < 2, sp.Not(t < 3)))), (t, True)),
    t < 4),
                           (2, True)),
    "no condition that always holds": sp.Piecewise((1, t < 1), (t, t >= 1)), "xor": sp.Piecewise((1, sp.Xor(t > 1, t > 2)), (2,
    True)),
    "largest": sp.Max(t, 1, sp.sin(t)), "modulo": sp.Mod(t, 0.3), "floor": sp.floor(t / 3),
    "steps": sp.Heaviside(t - 1) * sp.sign(t),
    "constants": sp.pi * t + sp.E**2 + sp.GoldenRatio, "fractions": t / 3 + sp.Rational(22, 7), "powers": t**-2.5 + 2.0**t + t**7,
    "roots": sp.sqrt(t + 1) / (t + 2) ** sp.Rational(3, 2), "large": 10**30 * t + 1e300, "small": 1e-320 * t + 5e-324,
    "equal": sp.Piecewise((1, sp.Ne(t, 1)), (2, True)), "bell": sp.exp(-((t - 3) ** 2) * 5000), "all digits": 0.1 * t + 2 / 3,
}


def _random(rng: random.Random, depth: int) -> Any:
    """An expression of mb.t, as deep as asked."""
    if depth == 0:
        return rng.choice([t, t, rng.randint(-9, 9), sp.Rational(rng.randint(-9, 9), 7), rng.uniform(-3, 3),
            1e-5 * rng.random(), sp.pi])
    part = [_random(rng, depth - 1) for _ in range(3)]
    when = sp.And(t > rng.uniform(0, 1), sp.Not(t > rng.uniform(1, 3)))
    return rng.choice([
        lambda: sp.Add(*part), lambda: sp.Mul(*part), lambda: sp.sin(part[0]), lambda: sp.Max(*part[:2]),
        lambda: sp.tanh(part[0]),
        lambda: part[0] ** 2, lambda: 1 / (1 + part[1] ** 2), lambda: sp.Piecewise((part[0], when), (part[1], True)),
        lambda: sp.floor(part[2]), lambda: sp.Abs(part[0]), lambda: sp.exp(-part[0] ** 2), lambda: sp.Mod(part[1], 0.3),
    ])()


@pytest.mark.parametrize("value", NAMED.values(), ids=list(NAMED))
def test_an_input_is_restored_with_every_digit(value: Any) -> None:
    _restored(timed.expression(value))


@pytest.mark.parametrize("seed", range(60))
def test_random_inputs_are_restored_with_every_digit(seed: int) -> None:
    try:
        e = timed.expression(_random(random.Random(seed), 3))
    except ValueError:
        pytest.skip("not real")
    _restored(e)


def _restored(e: Any) -> None:
    """The text gives the same expression, whose terms have the same order: the same values to the last bit."""
    again = timed.expression(text.read(text.written(e)))
    assert again == e
    assert repr(again) == repr(e)
    times = np.linspace(0.01, 4, 41)
    for f in (timed.values, lambda x, at: timed.values(timed.derivatives(x)[1], at)):
        values = []
        for one in (e, again):
            for known in (timed.sided, timed.derivatives, timed._compiled):
                known.cache_clear()  # equal expressions are one there
            values.append(f(one, times))
        assert np.array_equal(*values, equal_nan=True)


@pytest.mark.parametrize("seed", range(20))
def test_equal_inputs_have_one_text_and_one_order_of_their_terms(seed: int) -> None:
    """However they were made: a sum of many terms has them in the order of how it grew."""
    rng = random.Random(seed)
    terms = [se.RealDouble(rng.uniform(-3, 3)) * se.sin(k * timed.TIME) ** rng.randint(1, 3) for k in range(1, 30)]
    made = []
    for _ in range(2):
        rng.shuffle(terms)
        grown = terms[0]
        for term in terms[1:]:
            grown = grown + term
        made.append(timed.expression(grown))
    assert text.written(made[0]) == text.written(made[1])
    assert made[0].args == made[1].args


OLD = {
    "Piecewise((0, t < 1/20), (cos(t), And(1 < t, t < 2)), (1, Or(4 != t, t < 3)), (2, True))":
        sp.Piecewise((0, t < sp.Rational(1, 20)), (sp.cos(t), sp.And(t > 1, t < 2)), (1, sp.Or(sp.Ne(t, 4), t < 3)), (2, True)),
    "exp((-1/3)*t)*sqrt(1 + t)/(2 + t)**(3/2)": sp.exp(-t / 3) * sp.sqrt(t + 1) / (t + 2) ** sp.Rational(3, 2),
    "-1 - t": -1 - t, "2**-t**2": 2 ** (-(t**2)), "t**(-1)": 1 / t, "2 - 3*-t - t": 2 + 2 * t, "Max(t, 2, Mod(t, 3))": sp.Max(t,
    2, t % 3),
    "t*pi + exp(2) - abs(t)": t * sp.pi + sp.exp(2) - sp.Abs(t), "1.5e3*t - .5 + 0.5": 1500 * t, "frac(t) + Heaviside(t)":
        sp.frac(t) + sp.Heaviside(t),
}


@pytest.mark.parametrize("written", OLD, ids=list(OLD))
def test_the_notation_of_python_is_read(written: str) -> None:
    times = np.linspace(0.1, 5, 50)
    read, meant = (timed.values(timed.expression(e), times) for e in (text.read(written), OLD[written]))
    np.testing.assert_allclose(read, meant, rtol=1e-14, atol=1e-14)


HOSTILE = [
    "", " ", "x", "nan", "oo", "zoo", "I", "1/0", "0**-1", "log(-1)", "(-1)**(1/2)", "1e999", "1e400*t", "t.real", "t.__class__",
    "__import__('os').system('touch X')", "os.system('touch X')", "eval('1')", "lambda: 1", "[1, 2]", "{1}", "t[0]",
    "t if t else 1",
    "t; t", "t = 1", "t == ", "t <", "t < 1", "And(t < 1, t > 2)", "Piecewise((1, 2))", "Piecewise(1)", "Piecewise()",
    "Piecewise",
    "sin()", "sin(t, t)", "sin", "gamma(t)", "Function('f')(t)", "Symbol('x')", "9**9**9**9", "(9*t)**9**9", "2**(10**9)",
    "t**10**10",
    "(((9*t)**999)**999)**999", "9**(1/3)**-40 ** 99999", "(2/3)**1000000", "10**-99999999", "(t", "t)", "t t", "2t", "t**",
    "*t", "t,t",
    "(" * 5000 + "t" + ")" * 5000, "-" * 100000 + "t", "sin(" * 500 + "t" + ")" * 500, "9" * 200000, "t+" * 60000 + "t", "1 < I",
    "True", "True + 1", "Not(t)", "Not(t < 1, t < 2)", "t\x00", "\ud800", "ţ", "٣*t", "t¹", "1_000", "0x10", "1j", "'t'", '"t"',
    "t#", "t.5", "1.5.5", ".", "1..5.", ".t", ".e5",
    None, 1, 1.0, ["t"], {"t": 1}, b"t",
]


@pytest.mark.parametrize("written", HOSTILE, ids=[ascii(x)[:40] for x in HOSTILE])
def test_nothing_else_is_read(written: Any) -> None:
    begin = time.process_time()
    with pytest.raises(ValueError, match=r"\w"):
        text.read(written)
    assert time.process_time() - begin < 2  # a power tower would take for ever


def test_an_input_that_cannot_be_written_is_refused_when_it_is_stated() -> None:
    s = mb.Scene("p")
    s.point_mass("p", 1.0, (0, 0))
    s.force("F", "p", (se.Max(*(se.sin(k * timed.TIME) for k in range(1, 21))), 0))
    with pytest.raises(mb.SceneError, match=r"cannot be used as an expression of mb.t: written out it takes more than 100000 "):
        s.check()
