"""Functions of time that hypothesis draws: smooth ones, and hostile ones: jumps, kinks, pulses shorter than any step, tables."""

from __future__ import annotations

from math import ceil, inf
from typing import Any

import numpy as np
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator
from strangers.story import Input

Draw = Any


def tenths(low: int, high: int) -> st.SearchStrategy[float]:
    """Numbers with one digit behind the point; they shrink to the one nearest to 0."""
    return st.integers(low, high).map(lambda n: n / 10)


def wave(draw: Draw, T: float) -> Input:
    """A sine."""
    w, phase = draw(st.sampled_from([2, 5, 11, 20])), draw(st.sampled_from([0, 0.7]))
    return Input("wave", f"sp.sin({w} * {{t}} + {phase})", ((-inf, f"sin({w} * t + {phase})"),))


def polynomial(draw: Draw, T: float) -> Input:
    """A line or a parabola from 0."""
    a, b = draw(tenths(-10, 10)), draw(tenths(-10, 10))
    return Input("polynomial", f"({a} * {{t}} + {b} * {{t}}**2)", ((-inf, f"{a} * t + {b} * t**2"),))


def constant(draw: Draw, T: float) -> Input:
    """A number."""
    return Input("constant", "1", ((-inf, "1"),))


def _window(draw: Draw, T: float) -> tuple[float, float]:
    share = draw(st.sampled_from([0.3, 0.5, 0.1, 0.7, 0.051, 0.333]))
    width = draw(st.sampled_from([0.2, 0.05, 1e-2, 1e-3, 1e-4]))
    return round(share * T, 6), round(share * T + width * T, 8)


def box(draw: Draw, T: float) -> Input:
    """1 for a time, as users write it; short ones are scaled up to an impulse of a tenth."""
    a, b = _window(draw, T)
    said = draw(st.sampled_from([
        f"sp.Piecewise((0, {{t}} < {a!r}), (1, {{t}} < {b!r}), (0, True))",
        f"sp.Piecewise((1, ({{t}} > {a!r}) & ({{t}} < {b!r})), (0, True))",
        f"(sp.Heaviside({{t}} - {a!r}) - sp.Heaviside({{t}} - {b!r}))",
        f"(sp.sign({{t}} - {a!r}) - sp.sign({{t}} - {b!r})) / 2"]))
    return Input("box", said, ((-inf, "0"), (a, "1"), (b, "0")), scale=_impulse(T, b - a))


def _impulse(T: float, width: float) -> float:
    return float(f"{max(1.0, 0.1 * T / width):.3g}")


def bump(draw: Draw, T: float) -> Input:
    """sin^2 for a time: value and rate are continuous."""
    a, b = _window(draw, T)
    x = f"({{t}} - {a!r}) * {np.pi / (b - a)!r}"
    said = f"sp.Piecewise((0, {{t}} < {a!r}), (sp.sin({x})**2, {{t}} < {b!r}), (0, True))"
    return Input("bump", said, ((-inf, "0"), (a, f"sin({x.replace('{t}', 't')})**2"), (b, "0")), scale=_impulse(T, b - a))


def bell(draw: Draw, T: float) -> Input:
    """exp(-x^2)."""
    a, b = _window(draw, T)
    w = float(f"{b - a:.4g}")
    e = f"exp(-(({{t}} - {a!r}) / {w!r})**2)"
    return Input("bell", f"sp.{e}", ((-inf, e.replace("{t}", "t")),), ((a - 8 * w, a + 8 * w, w / 4),), scale=_impulse(T, w))


def step(draw: Draw, T: float) -> Input:
    """A smooth step by tanh."""
    a, b = _window(draw, T)
    w = float(f"{b - a:.4g}")
    e = f"(1 + tanh(({{t}} - {a!r}) / {w!r})) / 2"
    return Input("step", e.replace("tanh", "sp.tanh"), ((-inf, e.replace("{t}", "t")),), ((a - 20 * w, a + 20 * w, w / 4),))


def smoothstep(draw: Draw, T: float) -> Input:
    """3 x^2 - 2 x^3: its second derivative jumps."""
    a = round(draw(st.sampled_from([0.1, 0.4])) * T, 6)
    w = round(draw(st.sampled_from([0.5, 0.1, 0.02])) * T, 6)
    x = f"(({{t}} - {a!r}) / {w!r})"
    e = f"(3 * {x}**2 - 2 * {x}**3)"
    said = f"sp.Piecewise((0, {{t}} < {a!r}), ({e}, {{t}} < {a + w!r}), (1, True))"
    return Input("smoothstep", said, ((-inf, "0"), (a, e.replace("{t}", "t")), (a + w, "1")))


def square(draw: Draw, T: float) -> Input:
    """1 and -1, or 1 and 0 in turns."""
    p = round(T * draw(st.sampled_from([0.4, 0.15])), 6)
    low = draw(st.sampled_from([0, -1]))
    said = f"sp.Piecewise((1, sp.Mod({{t}}, {p!r}) < {p / 2!r}), ({low}, True))"
    pieces = [(n * p / 2, "1" if n % 2 == 0 else str(low)) for n in range(-2, ceil(2 * T / p) + 2)]
    return Input("square", said, ((-inf, "1"), *pieces))


def sawtooth(draw: Draw, T: float) -> Input:
    """Rises and drops."""
    p = round(T * draw(st.sampled_from([0.4, 0.17])), 6)
    pieces = [(n * p, f"(t - {n * p!r}) / {p!r}") for n in range(-1, ceil(T / p) + 2)]
    return Input("sawtooth", f"sp.Mod({{t}}, {p!r}) / {p!r}", ((-inf, "0"), *pieces))


def rectified(draw: Draw, T: float) -> Input:
    """|sin|: kinks."""
    p = round(T * draw(st.sampled_from([0.35, 0.6])), 6)
    w = 2 * np.pi / p
    said = draw(st.sampled_from([f"sp.Abs(sp.sin({w!r} * {{t}}))", f"sp.Max(0, sp.sin({w!r} * {{t}}))"]))
    other = f"-sin({w!r} * t)" if "Abs" in said else "0"
    pieces = [(n * p / 2, f"sin({w!r} * t)" if n % 2 == 0 else other) for n in range(-2, ceil(2 * T / p) + 2)]
    return Input("rectified", said, ((-inf, "0"), *pieces))


def _points(draw: Draw, T: float) -> tuple[list[float], list[float]]:
    n = draw(st.integers(2, 6))
    gaps = draw(st.lists(st.sampled_from([0.25, 0.1, 0.01]), min_size=n, max_size=n))
    times = np.round(0.05 * T + T * np.concatenate([[0.0], np.cumsum(gaps)]), 6)
    values = draw(st.lists(tenths(-10, 10), min_size=n + 1, max_size=n + 1))
    return times.tolist(), values


def table(draw: Draw, T: float) -> Input:
    """Measured points with straight lines between them, or steps; held outside."""
    t, y = _points(draw, T)
    kind = draw(st.sampled_from(["linear", "step"]))
    lines = [(a, f"{p!r} + {(q - p) / (b - a)!r} * (t - {a!r})" if kind == "linear" else f"{p!r}")
             for a, b, p, q in zip(t, t[1:], y, y[1:], strict=False)]
    said = f"mb.table({t}, {y}, kind={kind!r})"
    return Input(f"table {kind}", said, ((-inf, f"{y[0]!r}"), *lines, (t[-1], f"{y[-1]!r}")))


def periodic_table(draw: Draw, T: float) -> Input:
    """A table of straight lines that repeats."""
    p = round(T * draw(st.sampled_from([0.3, 0.45])), 6)
    t, y = [0.0, round(p / 3, 7), p], [0.0, draw(tenths(-10, 10)), 0.0]
    pieces = []
    for n in range(-1, ceil(T / p) + 2):
        for a, b, v, u in zip(t, t[1:], y, y[1:], strict=False):
            pieces.append((n * p + a, f"{v!r} + {(u - v) / (b - a)!r} * (t - {n * p + a!r})"))
    said = f"mb.table({t}, {y}, outside='periodic')"
    return Input("table periodic", said, ((-inf, "0"), *pieces))


def cubic_table(draw: Draw, T: float) -> Input:
    """A monotone cubic through points; its second derivative jumps."""
    t, y = _points(draw, T)
    c = PchipInterpolator(t, y).c
    cubics = [(a, " + ".join(f"{float(c[3 - k, i])!r} * (t - {a!r})**{k}" for k in range(4))) for i, a in enumerate(t[:-1])]
    said = f"mb.table({t}, {y}, kind='cubic')"
    return Input("table cubic", said, ((-inf, f"{y[0]!r}"), *cubics, (t[-1], f"{y[-1]!r}")))


SMOOTH = (constant, wave, polynomial)
HOSTILE = (box, box, bump, bell, step, square, sawtooth, rectified, table, table, periodic_table, cubic_table)
MOTIONS = (polynomial, wave, bump, bell, step, smoothstep)  #: what may prescribe a motion: value and rate continuous


@st.composite
def loads(draw: Draw, T: float, size: float) -> Input:
    """A load of about `size` in the unit of what takes it."""
    made = draw(st.sampled_from([*SMOOTH, *HOSTILE]))(draw, T)
    scale = draw(st.sampled_from([1.0, 0.3, 3.0])) * draw(st.sampled_from([1, -1]))
    return Input(made.kind, made.said, made.pieces, made.fine, float(f"{made.scale * scale * size:.4g}"))


@st.composite
def motions(draw: Draw, T: float, size: float) -> Input:
    """A prescribed value of about `size` (rad or m) with continuous rate; narrow ones are as much smaller as they are short."""
    made = draw(st.sampled_from(MOTIONS))(draw, T)
    return Input(made.kind, made.said, made.pieces, made.fine, float(f"{size / max(1.0, made.scale):.3g}"))
