"""Functions of time drawn from a seed: the expression that a scene gets, and the same function as smooth pieces between breaks,
which are known because the function was made here. Nothing of mbdae is used: `said` is an expression of SymPy's symbol t."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf, pi
from typing import Any

import numpy as np
import sympy as sp

t = sp.Symbol("t")
PER_WIDTH, REACH = 4, 20  #: largest step of the reference over the width inside a narrow feature, and widths it extends to
RINGS = 6  #: intervals around a feature with slow tails, each four times wider than the one inside

Expr = Any
Piece = tuple[float, Expr]  #: where it starts (s), a smooth expression of t


@lru_cache(maxsize=4096)
def numeric(e: Expr, order: int = 0) -> Callable[[float], float]:
    """A smooth expression, or its derivative of an order, as a function of a number."""
    f = sp.lambdify(t, sp.diff(e, t, order) if order else e, "numpy")

    def value(at: float) -> float:
        with np.errstate(all="ignore"):
            return float(f(np.float64(at)))

    return value


@dataclass(frozen=True)
class Input:
    """kind; width (s) of its narrowest feature; said, the expression the scene gets; pieces, the same function for the reference;
    fine: (from, to, largest step of the reference) of narrow features, s; lasts: how long it acts, s."""

    kind: str
    width: float
    said: Expr
    pieces: tuple[Piece, ...]
    fine: tuple[tuple[float, float, float], ...] = ()
    lasts: float = 1.0

    @property
    def breaks(self) -> list[float]:
        """Instants at which it or a derivative jumps, s."""
        return [start for start, _ in self.pieces if start > -inf]

    def piece(self, when: float) -> Expr:
        """The smooth expression that holds at a time which is no break."""
        return [e for start, e in self.pieces if start < when][-1]

    def _from(self, start: float) -> Expr:
        return [e for a, e in self.pieces if a <= start][-1]

    def times(self, factor: float) -> Input:
        """The input times a number."""
        c = sp.Float(factor)
        return Input(self.kind, self.width, c * self.said, tuple((a, c * e) for a, e in self.pieces), self.fine, self.lasts)

    def __add__(self, other: Input) -> Input:
        starts = sorted({start for start, _ in (*self.pieces, *other.pieces)})
        pieces = tuple((a, self._from(a) + other._from(a)) for a in starts)
        return Input("sum", min(self.width, other.width), self.said + other.said, pieces, self.fine + other.fine,
                     max(self.lasts, other.lasts))


def _near(a: float, w: float) -> tuple[tuple[float, float, float], ...]:
    return ((a - REACH * w, a + REACH * w, w / PER_WIDTH),)


def _tails(a: float, w: float) -> tuple[tuple[float, float, float], ...]:
    """Narrow inside, wider outside, for what decays like a power."""
    rings = [(_near(a, w * 4**k)[0]) for k in range(RINGS)]
    parts = [rings[0]]
    for inner, outer in itertools.pairwise(rings):
        parts += [(outer[0], inner[0], outer[2]), (inner[1], outer[1], outer[2])]
    return tuple(parts)


def _pick(rng: np.random.Generator, options: Sequence[Any]) -> Any:
    return options[int(rng.integers(len(options)))]


def box(rng: np.random.Generator, T: float, w: float) -> Input:
    """1 for a time and 0 otherwise, in one of the forms in which users write it."""
    a = T * float(rng.uniform(0.1, 0.8))
    b = a + min(w, T)
    c, one, zero = (a + b) / 2, sp.Integer(1), sp.Integer(0)
    said = _pick(rng, [
        lambda: sp.Piecewise((0, t < a), (1, t < b), (0, True)),
        lambda: sp.Heaviside(t - a) - sp.Heaviside(t - b),
        lambda: sp.Piecewise((1, (t > a) & (t < b)), (0, True)),
        lambda: sp.Piecewise((0, sp.Or(t < a, t >= b)), (1, True)),
        lambda: sp.Piecewise((1, sp.Not(sp.Or(t <= a, t > b))), (0, True)),
        lambda: sp.Piecewise((sp.Piecewise((1, t < b), (0, True), evaluate=False), t > a), (0, True), evaluate=False),
        lambda: (sp.sign(t - a) - sp.sign(t - b)) / 2,
        lambda: (1 + sp.sign((b - a) / 2 - sp.Abs(t - c))) / 2,
        lambda: sp.Piecewise((0, t < a), (1, True)) * sp.Piecewise((1, t < b), (0, True)),
        lambda: sp.Heaviside(t - a) * sp.Heaviside(b - t),
    ])()
    return Input("box", b - a, said, ((-inf, zero), (a, one), (b, zero)), lasts=b - a)


def stairs(rng: np.random.Generator, T: float, w: float) -> Input:
    """Three or four levels, each as long as the width."""
    n = int(rng.integers(3, 5))
    w = min(w, T / n)
    a = float(rng.uniform(0.1, max(0.11, 0.8 - n * w / T))) * T
    levels = [sp.Float(round(float(x), 2)) for x in rng.uniform(-0.5, 1, n)]
    edges = [a + i * w for i in range(n + 1)]
    said = sp.Piecewise((0, t < a), *((level, t < edge) for level, edge in zip(levels, edges[1:], strict=True)), (0, True))
    pieces = ((-inf, sp.Integer(0)), *zip(edges, [*levels, sp.Integer(0)], strict=True))
    return Input("stairs", w, said, pieces, lasts=w)


def ramp(rng: np.random.Generator, T: float, w: float) -> Input:
    """From 0 to 1 in the width, then a drop; or a triangle."""
    a = T * float(rng.uniform(0.1, 0.7))
    x, zero, one = (t - a) / w, sp.Integer(0), sp.Integer(1)
    up = ((-inf, zero), (a, x), (a + w, one))
    if rng.random() < 0.4:
        return Input("ramp", w, _pick(rng, [sp.Min(1, sp.Max(0, x)), (1 + sp.Abs(x) - sp.Abs(x - 1)) / 2]), up, lasts=T)
    said = _pick(rng, [sp.Max(0, 1 - sp.Abs(x - 1)), sp.Max(0, sp.Min(x, 2 - x))])
    return Input("triangle", w, said, ((-inf, zero), (a, x), (a + w, 2 - x), (a + 2 * w, zero)), lasts=w)


def bump(rng: np.random.Generator, T: float, w: float) -> Input:
    """(1 - cos) / 2 for the width: value and rate are continuous."""
    a = T * float(rng.uniform(0.1, 0.8))
    b, e = a + w, (1 - sp.cos(2 * sp.pi * (t - a) / w)) / 2
    said = _pick(rng, [sp.Piecewise((0, t < a), (e, t < b), (0, True)), sp.Piecewise((e, (t > a) & (t < b)), (0, True)),
                       sp.Piecewise((0, t < a), (sp.sin(sp.pi * (t - a) / w) ** 2, t < b), (0, True))])
    return Input("bump", w, said, ((-inf, sp.Integer(0)), (a, e), (b, sp.Integer(0))), lasts=w)


def smoothstep(rng: np.random.Generator, T: float, w: float) -> Input:
    """3 x^2 - 2 x^3 from 0 to 1."""
    a = T * float(rng.uniform(0.05, 0.7))
    x = (t - a) / w
    e = 3 * x**2 - 2 * x**3
    said = sp.Piecewise((0, t < a), (e, t < a + w), (1, True))
    return Input("smooth step", w, said, ((-inf, sp.Integer(0)), (a, e), (a + w, sp.Integer(1))), lasts=T)


def bell(rng: np.random.Generator, T: float, w: float) -> Input:
    """exp(-x^2), as such, with its square expanded, or around a wave."""
    a = T * float(rng.uniform(0.1, 0.85))
    e = sp.exp(-(((t - a) / w) ** 2))
    said = _pick(rng, [e, sp.exp(-((t - a) ** 2) / w**2), sp.exp(sp.expand(-((t - a) ** 2)) / w**2) if w > 1e-3 * T else e])
    return Input("bell", w, said, ((-inf, e),), _near(a, w), lasts=w)


def burst(rng: np.random.Generator, T: float, w: float) -> Input:
    """A few waves under a bell."""
    a = T * float(rng.uniform(0.1, 0.85))
    e = sp.exp(-(((t - a) / w) ** 2)) * sp.cos(5 * (t - a) / w + 1)
    return Input("burst", w / 5, e, ((-inf, e),), ((a - 8 * w, a + 8 * w, w / 20),), lasts=w / 3)


def sech(rng: np.random.Generator, T: float, w: float) -> Input:
    """1 / cosh."""
    a = T * float(rng.uniform(0.1, 0.85))
    w = max(w, 1e-2 * T)  # the derivatives of narrower ones overflow in cosh and exp
    x = (t - a) / w
    e = 1 / sp.cosh(x)
    return Input("sech", w, _pick(rng, [e, 2 / (sp.exp(x) + sp.exp(-x))]), ((-inf, e),), _near(a, w), lasts=w)


def lorentzian(rng: np.random.Generator, T: float, w: float) -> Input:
    """1 / (1 + x^2)."""
    a = T * float(rng.uniform(0.1, 0.85))
    e = 1 / (1 + ((t - a) / w) ** 2)
    return Input("lorentzian", w, _pick(rng, [e, w**2 / (w**2 + (t - a) ** 2)]), ((-inf, e),), _tails(a, w), lasts=2 * w)


def tanh_step(rng: np.random.Generator, T: float, w: float) -> Input:
    """A smooth switch."""
    a = T * float(rng.uniform(0.1, 0.7))
    e = (1 + sp.tanh((t - a) / w)) / 2
    return Input("tanh step", w, e, ((-inf, e),), _near(a, w), lasts=T)


def tanh_window(rng: np.random.Generator, T: float, w: float) -> Input:
    """A switch on and off, edges of the width or narrower."""
    a = T * float(rng.uniform(0.1, 0.7))
    b = a + w
    d = max(w * float(10 ** rng.uniform(-2, -0.7)), 1e-6 * T)
    e = (sp.tanh((t - a) / d) - sp.tanh((t - b) / d)) / 2
    logistic = 1 / (1 + sp.exp(-2 * (t - a) / d)) - 1 / (1 + sp.exp(-2 * (t - b) / d))
    fine = (*_near(a, d), *_near(b, d), (a, b, w / 10))
    return Input("tanh window", d, _pick(rng, [e, logistic if d > 1e-2 * T else e]), ((-inf, e),), fine, lasts=w)


def chirp(rng: np.random.Generator, T: float, w: float) -> Input:
    """A sine that becomes faster."""
    last = float(np.clip(T / w, 1, 40)) / T  # Hz
    e = sp.sin(2 * sp.pi * last * t**2 / (2 * T) + float(rng.uniform(0, pi)))
    return Input("chirp", 1 / last, e, ((-inf, e),), ((0.0, T, 0.1 / last),), lasts=T / 2)


def _periodic(kind: str, T: float, p: float, said: Expr, parts: list[tuple[float, Callable[[float], Expr]]],
              lasts: float) -> Input:
    """Pieces that repeat with p: of every period, (share of it at which a part starts, part of the period's start)."""
    pieces = [(n * p + share * p, part(n * p)) for n in range(-1, int(T / p) + 1) for share, part in parts]
    return Input(kind, p, said, ((-inf, pieces[0][1]), *pieces), lasts=lasts)


def sawtooth(rng: np.random.Generator, T: float, w: float) -> Input:
    """Rises and drops, with Mod or floor."""
    p = max(w, T / 12) * float(rng.uniform(0.8, 1))
    said = _pick(rng, [sp.Mod(t, p) / p, t / p - sp.floor(t / p)])
    return _periodic("sawtooth", T, p, said, [(0.0, lambda at: (t - at) / p)], T / 2)


def square(rng: np.random.Generator, T: float, w: float) -> Input:
    """1 and -1, or 1 and 0, in turns."""
    p = max(w, T / 10) * float(rng.uniform(0.8, 1))
    wave, low = sp.sin(2 * sp.pi * t / p), int(rng.integers(-1, 1))
    said = sp.sign(wave) if low else _pick(rng, [sp.Heaviside(wave), sp.Piecewise((1, sp.Mod(t, p) < p / 2), (0, True))])
    parts = [(0.0, lambda at: sp.Integer(1)), (0.5, lambda at: sp.Integer(low))]
    return _periodic("square", T, p, said, parts, T / 3)


def train(rng: np.random.Generator, T: float, w: float) -> Input:
    """Short boxes at equal distances."""
    p = T * float(rng.uniform(0.15, 0.5))
    share = min(w / p, 0.5)
    said = _pick(rng, [sp.Piecewise((1, sp.Mod(t, p) < share * p), (0, True)),
                       sp.Piecewise((1, t / p - sp.floor(t / p) < share), (0, True))])
    found = _periodic("train", T, p, said, [(0.0, lambda at: sp.Integer(1)), (share, lambda at: sp.Integer(0))], 2 * share * p)
    return Input("train", share * p, said, found.pieces, lasts=found.lasts)


def rectified(rng: np.random.Generator, T: float, w: float) -> Input:
    """|sin| or max(0, sin)."""
    p = max(w, T / 8) * float(rng.uniform(0.8, 1))
    wave = sp.sin(2 * sp.pi * t / p)
    if rng.random() < 0.5:
        return _periodic("rectified", T, p, sp.Abs(wave), [(0.0, lambda at: wave), (0.5, lambda at: -wave)], T)
    return _periodic("rectified", T, p, sp.Max(0, wave), [(0.0, lambda at: wave), (0.5, lambda at: sp.Integer(0))], T)


LOADS = (box, box, stairs, ramp, bump, bell, bell, burst, sech, lorentzian, tanh_step, tanh_window, chirp, sawtooth, square,
         train, rectified)
MOTIONS = (bump, smoothstep, bell, bell, burst, sech, lorentzian, tanh_step, tanh_window, chirp)  #: value and rate continuous


def width(rng: np.random.Generator, T: float, narrowest: float = 1e-6) -> float:
    """From `narrowest` to 1 of the run, log-uniform, s."""
    return T * float(10 ** rng.uniform(np.log10(narrowest), 0))


def load(rng: np.random.Generator, T: float) -> Input:
    """One input of about 1, or a sum."""
    if rng.random() < 0.15:
        parts = [_pick(rng, LOADS)(rng, T, width(rng, T)).times(float(rng.uniform(0.3, 1))) for _ in range(2)]
        lasts = [p.lasts for p in parts]  # the shorter one pushes as hard as the longer one
        return parts[0].times(max(lasts) / lasts[0]) + parts[1].times(max(lasts) / lasts[1])
    return _pick(rng, LOADS)(rng, T, width(rng, T))  # type: ignore[no-any-return]


def motion(rng: np.random.Generator, T: float) -> Input:
    """One input of about 1 whose value and rate are continuous."""
    return _pick(rng, MOTIONS)(rng, T, width(rng, T))  # type: ignore[no-any-return]


def pushing(rng: np.random.Generator, T: float, reach: float, mass: float = 1.0) -> Input:
    """A load that moves a mass at rest by up to `reach` m by the end of the run."""
    found = load(rng, T)
    return found.times(reach * mass * float(rng.uniform(0.1, 1)) / (min(found.lasts, T) * T / 2))
