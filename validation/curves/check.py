"""Parameters and loads over curves, time and sensors: every run equals SciPy's to the accuracy, or says that not."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import sympy as sp
from runner import Case, Claim, Found
from runs import counted, few_and_all, verdict_of
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import mbdae as mb

claim = Claim("curves", "stiffness, damping, free length and loads as functions of time, curves over sensors and angles by atan2 "
              "give the motion within three times the accuracy asked, or the run says that it does not", 0.0, "runs",
              "equations of motion by hand, DOP853 of SciPy at rtol 1e-11 in 2000 or more steps, its own reading of the points")
QUICK, WHOLE = range(6), range(60)
T_END, STEPS = 2.0, 2000
Law = Callable[[float, float, float], float]  #: of time, coordinate and its rate


class Stated(NamedTuple):
    """A quantity as mbdae and as the reference take it."""

    expression: Any
    value: Law


class Drawn(NamedTuple):
    """A scene, the accelerations of its coordinates f(t, y), its start y, sensors of its coordinates, how it is solved."""

    scene: Any
    rates: Callable[[float, Any], Any]
    start: list[float]
    sensors: list[str]
    options: dict[str, Any]
    said: str


def quantity(rng: np.random.Generator, s: Any, joint: str, base: float, jumps: bool = True) -> Stated:
    """base times a function near 1 of the time, the coordinate of a joint or its rate. jumps: whether it may jump."""
    angle = joint == "A"
    x = s.sensor(f"{joint}.{'angle' if angle else 'displacement'}")
    arguments: list[tuple[Any, Law, float]] = [
        (mb.t, lambda t, q, v: t, T_END), (x, lambda t, q, v: q, 1.0), (s.sensor(f"{joint}.rate"), lambda t, q, v: v, 3.0),
        (x + sp.sin(3 * mb.t) / 2, lambda t, q, v: q + np.sin(3 * t) / 2, 1.0)]
    which = int(rng.integers(len(arguments)))
    u, of, span = arguments[which]
    way = str(rng.choice(["curve", "curve", "sine", "angle"]))
    if way == "sine":
        w, b = 2 / span, rng.uniform(0.1, 0.6)
        return Stated(base * (1 + b * sp.sin(w * u)), lambda t, q, v: base * (1 + b * np.sin(w * of(t, q, v))))
    if way == "angle":
        b = rng.uniform(0.1, 0.5)
        return Stated(base * (1 + b * sp.atan2(u, sp.cos(u) + 2)),
                      lambda t, q, v: base * (1 + b * np.arctan2(of(t, q, v), np.cos(of(t, q, v)) + 2)))
    kinds = ["linear", "cubic"] + ["step"] * (jumps and which != 2)  # a force that jumps with a rate may have no solution
    kind, outside = str(rng.choice(kinds)), str(rng.choice(["hold", "periodic"]))
    n = int(rng.integers(2, 12))
    points = np.cumsum(rng.uniform(0.3, 1.0, n))
    points = span * (2 * (points - points[0]) / (points[-1] - points[0]) - 1)
    values = 1 + rng.uniform(-0.6, 0.6, n)
    if outside == "periodic":
        values[-1] = values[0]
        if kind == "cubic":  # whose slope at the end is a matter of convention
            kind = "linear"
    read = interpolated(kind, points, values)

    def value(t: float, q: float, v: float) -> float:
        at = of(t, q, v)
        at = points[0] + (at - points[0]) % (points[-1] - points[0]) if outside == "periodic" else np.clip(at, *points[[0, -1]])
        return base * float(read(at))

    return Stated(base * mb.curve(points, values, kind, outside)(u), value)


def interpolated(kind: str, x: Any, y: Any) -> Callable[[float], Any]:
    """The reference's own reading of points."""
    if kind == "linear":
        return lambda at: np.interp(at, x, y)
    if kind == "cubic":
        return PchipInterpolator(x, y) if len(x) > 2 else lambda at: np.interp(at, x, y)
    return lambda at: y[np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 1)]


def slider(rng: np.random.Generator, model: Any) -> Drawn:
    """A mass on a guide, held by a spring between two points and pushed."""
    s, m, length = mb.Scene(gravity=(0, 0, 0)), 2.0, 1.3
    b = s.rigid_body("b", m, (0.1, 0.1, 0.1), at=(length, 0, 0))
    k, c, free, F = (quantity(rng, s, "P", *about) for about in ((100.0, True), (3.0, False), (1.0, True), (8.0, False)))
    s.prismatic("P", s.ground, b, (length, 0, 0), (1, 0, 0), rate0=2.0, force=F.expression, model=model)
    s.spring("S", s.ground, b, (0, 0, 0), (length, 0, 0), k.expression, c.expression, free.expression)

    def rates(t: float, y: Any) -> Any:
        at = (t, *y)
        return [y[1], (F.value(*at) - k.value(*at) * (length + y[0] - free.value(*at)) - c.value(*at) * y[1]) / m]

    return Drawn(s, rates, [0.0, 2.0], ["P.displacement"], {}, "slider")


def pendulum(rng: np.random.Generator, model: Any) -> Drawn:
    """A body that turns under gravity with spring, damper and motor."""
    s, m, a, J = mb.Scene(gravity=(0, -9.81, 0)), 1.5, 0.4, 0.05
    b = s.rigid_body("b", m, (J, J, J), at=(a, 0, 0))
    k, c, T = (quantity(rng, s, "A", *about) for about in ((5.0, True), (0.4, False), (4.0, False)))
    s.revolute("A", s.ground, b, (0, 0, 0), spring=k.expression, damper=c.expression, torque=T.expression, rate0=1.0, model=model)

    def rates(t: float, y: Any) -> Any:
        at = (t, *y)
        torque = T.value(*at) - k.value(*at) * y[0] - c.value(*at) * y[1] - m * 9.81 * a * np.cos(y[0])
        return [y[1], torque / (J + m * a * a)]

    return Drawn(s, rates, [0.0, 1.0], ["A.angle"], {}, "pendulum")


def pair(rng: np.random.Generator, model: Any) -> Drawn:
    """Two masses in a row on guides with springs and dampers, the second in a bushing to the ground."""
    s, m, n = mb.Scene(gravity=(0, 0, 0)), 2.0, 1.0
    a, b = (s.rigid_body(name, mass, (0.1, 0.1, 0.1), at=(x, 0, 0)) for name, mass, x in (("a", m, 0.5), ("b", n, 1.2)))
    k, c, d, kx = (quantity(rng, s, *about) for about in (("P", 60.0), ("P", 1.0, False), ("Q", 2.0, False), ("Q", 40.0)))
    s.prismatic("P", s.ground, a, (0.5, 0, 0), (1, 0, 0), spring=k.expression, damper=c.expression, rate0=1.5, model=model)
    s.prismatic("Q", a, b, (1.2, 0, 0), (1, 0, 0), spring=80.0, damper=d.expression, model=model)
    s.bushing("B", s.ground, b, (1.2, 0, 0), (kx.expression, 10.0, 10.0), (0.5, 0.0, 0.0))

    def rates(t: float, y: Any) -> Any:
        p, q, vp, vq = y
        first = -k.value(t, p, vp) * p - c.value(t, p, vp) * vp
        between = -80.0 * q - d.value(t, q, vq) * vq
        second = between - kx.value(t, q, vq) * (p + q) - 0.5 * (vp + vq)
        ap = (first - between) / m
        return [vp, vq, ap, second / n - ap]

    return Drawn(s, rates, [0.0, 0.0, 1.5, 0.0], ["P.displacement", "Q.displacement"], {}, "pair")


def drawn(seed: int) -> Drawn:
    """The scene of a seed, with solver, form, joint model and accuracy."""
    rng = np.random.default_rng(seed)
    model = [None, mb.Kinematic(), mb.Classical(), mb.Recursive()][seed % 4]
    made = (slider, pendulum, pair)[seed % 3](rng, model)
    free = isinstance(model, mb.Recursive)
    ways = [{}, {"solver": mb.RadauIIA(3)}, {"solver": mb.IDA()}, {"solver": mb.RadauIIA(2)}, {"solver": mb.HHT()},
            {"solver": mb.CVODE(), "form": mb.ODE() if free else mb.Index1()}, {"solver": mb.GeneralizedAlpha()},
            {"solver": mb.DOP853(), "form": mb.ODE() if free else mb.Index1()}]
    if not free:
        ways += [{"solver": mb.RadauIIA(3), "form": mb.Index3()}, {"solver": mb.IDA(), "form": mb.Index1()}, {"form": mb.GGL()}]
    options = dict(ways[seed % len(ways)])
    alpha = isinstance(options.get("solver"), mb.GeneralizedAlpha)
    low = -3.5 if alpha else -5.0 if isinstance(options.get("form"), mb.Index3) else -7.0
    options["accuracy"] = float(f"{10 ** rng.uniform(low, -3):.1e}")
    return made._replace(options=options, said=f"seed {seed}: {made.said}, {model}, {options}")


def verdict(seed: int) -> tuple[str, str]:
    """"right", "told", "silent" or "needless" for a seed, with a remark."""
    one = drawn(seed)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        r = one.scene.simulate(T_END, **one.options)
    reference = solve_ivp(one.rates, (0, T_END), one.start, "DOP853", r.t, rtol=1e-11, atol=1e-12, max_step=T_END / STEPS)
    found = np.array([r.read(name) for name in one.sensors])
    ratio = float(np.max(np.abs(found - reference.y[: len(found)]))) / one.options["accuracy"]
    said = bool(told) or r.reliable is False
    return verdict_of(ratio, said), f"{one.said}: error {ratio:.2g} x asked{''.join(f'; {w.message}' for w in told)}"


def judge(seeds: Sequence[int]) -> list[Found]:
    """Counts of verdicts, with what is wrong."""
    return counted([verdict(seed) for seed in seeds])


def cases() -> list[Case]:
    """A few seeds, and all."""
    return few_and_all(judge, QUICK, WHOLE)
