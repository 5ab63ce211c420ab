"""Seeded potentials of one coordinate with a narrow feature, stated once for symengine (the law) and SymPy (the truth)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

Expr = Any
#: library, coordinate, height (J), centre (m), width (m) -> energy (J)
Shape = Callable[[Any, Expr, Expr, Expr, Expr], Expr]


def bell(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """Barrier or well."""
    return A * lib.exp(-(((s - c) / w) ** 2))


def step(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """A rise of the energy by A."""
    return A * (1 + lib.tanh((s - c) / w)) / 2


def lorentzian(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """A barrier or well with long tails."""
    return A / (1 + ((s - c) / w) ** 2)


def sech(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """1 / cosh."""
    return A / lib.cosh((s - c) / w)


def soft_kink(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """A force that changes its sign within the width, at c and not elsewhere."""
    return A * lib.sqrt((s - c) ** 2 + w**2)


def soft_corner(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """No force before, a constant one beyond, smooth over the width."""
    return A * (s - c + lib.sqrt((s - c) ** 2 + w**2)) / 2


def stop(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """A spring from c on, that stores A over the width."""
    return lib.Piecewise((0, s < c), (A * ((s - c) / w) ** 2, True))


def hertz_stop(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """The same with a force like penetration^(3/2)."""
    deep = lib.Piecewise((0, s < c), (s - c, True))
    return A * (deep / w) ** lib.Rational(5, 2)


def box(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """A constant force inside the width alone."""
    return lib.Piecewise((0, s < c), (A * (s - c) / w, s < c + w), (A, True))


def tent(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """A triangular barrier or well, stated with nested pieces."""
    inside = lib.Piecewise((A * (s - c + w) / w, s < c), (A * (c + w - s) / w, True))
    return lib.Piecewise((0, s < c - w), (inside, s < c + w), (0, True))


def power(lib: Any, s: Expr, A: Expr, c: Expr, w: Expr) -> Expr:
    """A wall that repels like 1 / distance^6, beyond it nothing is reached."""
    return A * (w / (c + w - s)) ** 6


SHAPES: tuple[Shape, ...] = (bell, bell, step, lorentzian, sech, soft_kink, soft_corner, stop, hertz_stop, box, tent, power)
KINKED = (stop, hertz_stop, box, tent)
BOUNDED = (bell, lorentzian, sech)  #: between 0 and A: what a damping may be


@dataclass(frozen=True)
class Field:
    """A shape with its numbers; `deepest` bounds how much energy (J) it can give."""

    shape: Shape
    height: float
    centre: float
    width: float

    @property
    def deepest(self) -> float:
        """Largest energy a body can gain along its path."""
        return 4 * abs(self.height) * (1 + self.width)

    def functions(self) -> tuple[Callable[[float], float], Callable[[float], float]]:
        """Value and slope by the coordinate."""
        s = sp.Symbol("s", real=True)
        e = self.shape(sp, s, sp.Float(self.height), sp.Float(self.centre), sp.Float(self.width))
        return _number(s, e), _number(s, sp.diff(e, s))


def _number(s: Expr, e: Expr) -> Callable[[float], float]:
    f = sp.lambdify(s, e, "math")

    def value(at: float) -> float:
        try:
            return float(f(at))
        except (OverflowError, ZeroDivisionError):  # a trial step of the reference far beyond a wall; it is refused
            return 1e100

    return value


def draw(rng: np.random.Generator, energy: float, nearest: float, farthest: float) -> Field:
    """A field for a body with a kinetic energy (J) that comes from 0 towards `farthest`; no height at which a body nearly stops
    on top, where the direction it leaves in is decided by the last digit."""
    shape = SHAPES[int(rng.integers(len(SHAPES)))]
    w = float(10 ** rng.uniform(-4, 0)) * farthest
    c = float(rng.uniform(nearest, farthest))
    height = energy * float(rng.choice([0.3, 0.7, 1.5, 3.0]) * rng.uniform(0.85, 1.1)) * float(rng.choice([-1, 1, 1]))
    if shape is sech:
        w = max(w, 1e-2)  # the slope of narrower ones overflows in cosh^2
    if shape in (stop, hertz_stop):
        height = energy  # the depth reached is the width
    if shape is power:
        height, w = energy * 0.5, min(w, 0.3 * farthest)
    if shape in (tent, bell, lorentzian, sech):
        w = min(w, c)  # so that the start lies before it
    return Field(shape, height, c, w)
