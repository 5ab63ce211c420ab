"""Equations shared by claims and integrator tests: SymPy expressions, exact Jacobians derived from them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp

from mbdae import DAE
from mbdae.system.base import System

t = sp.Symbol("t")


def unknowns(names: str) -> tuple[list[sp.Symbol], list[sp.Symbol]]:
    """Symbols of the unknowns and of their derivatives."""
    return list(sp.symbols(names, seq=True)), list(sp.symbols([name + "_p" for name in names.split()]))


def dae(y: Sequence[Any], yp: Sequence[Any], F: Sequence[Any], y0: Any, yp0: Any, index: Any, **options: Any) -> DAE:
    """A DAE from expressions, with its exact Jacobian."""
    n, F = len(y), sp.Matrix(F)
    arguments = [t, list(y), list(yp)]
    residual = sp.lambdify(arguments, list(F), "math", cse=True)
    fy = sp.lambdify(arguments, list(F.jacobian(list(y))), "math", cse=True)
    fyp = sp.lambdify(arguments, list(F.jacobian(list(yp))), "math", cse=True)

    def jacobian(time: float, y: Any, yp: Any, cj: float, out: Any) -> Any:
        parts = [np.reshape(f(time, y.tolist(), yp.tolist()), (n, n)) for f in (fy, fyp)]
        full = parts[0] + cj * parts[1]
        return full if out.ndim == 2 else full.T[np.asarray(pattern).T != 0]

    pattern = options.get("sparsity")
    return DAE(
        lambda t, y, yp, out: np.array(residual(t, y.tolist(), yp.tolist())), y0, yp0, jacobian, index, **options
    )


def numeric(q: Sequence[Any], v: Sequence[Any], part: Any) -> Callable[..., Any]:
    """A part of equations of motion as a function of t, q and, where it is called with them, velocities."""
    function = sp.lambdify([t, q, v], part.tolist() if part.shape[1] > 1 or part.shape[0] == 1 != len(q) else list(part))
    shape = part.shape if part.shape[1] > 1 else (part.shape[0],)
    still = [0.0] * len(v)
    return lambda time, at, moving=still: np.reshape(np.array(function(time, at, moving), dtype=float), shape)


def mechanism(
    q: Sequence[Any], mass: Any, force: Callable[[Any], Any], g: Any, q0: Any, v0: Any, form: str, **options: Any
) -> DAE:
    """M(q) v' + G^T lambda = force(v), g(q, t) = 0 as "index3", "ggl", "ggl_rates" (multipliers as derivatives) or "index1"
    (stabilised by Baumgarte's terms at 1/s).

    Order of the unknowns: q, v, lambda, mu.
    """
    n, m = len(q), len(g)
    v, lam, mu = sp.symbols(f"v:{n}"), sp.symbols(f"lam:{m}"), sp.symbols(f"mu:{m}")
    qp, vp, lamp, mup = (sp.symbols(f"{name}_p:{k}") for name, k in (("q", n), ("v", n), ("lam", m), ("mu", m)))
    g, mass, applied = sp.Matrix(g), sp.Matrix(mass), sp.Matrix(force(v))
    G = g.jacobian(list(q))
    rate = G * sp.Matrix(v) + g.diff(t)
    as_rates = form == "ggl_rates"
    forces = mass * sp.Matrix(vp) + G.T * sp.Matrix(lamp if as_rates else lam) - applied
    kinematics = sp.Matrix(qp) - sp.Matrix(v)
    curvature = rate.jacobian(list(q)) * sp.Matrix(v) + rate.diff(t)
    start = dict(zip([*q, *v, t], [*q0, *v0, 0], strict=True))
    M, G0, f, c = (np.array(e.subs(start).evalf(20), dtype=float) for e in (mass, G, applied, curvature))
    solved = np.linalg.solve(np.block([[M, G0.T], [G0, np.zeros((m, m))]]), np.concatenate([f, -c]).ravel())
    a, multipliers, zeros = solved[:n], solved[n:], np.zeros(m)
    parts = tuple(numeric(list(q), list(v), part) for part in (mass, applied, g, G))
    if form == "index3":
        y0, yp0 = np.concatenate([q0, v0, multipliers]), np.concatenate([v0, a, zeros])
        return dae([*q, *v, *lam], [*qp, *vp, *lamp], [*kinematics, *forces, *g], y0, yp0, 3, partition=parts, **options)
    if form == "index1":
        held = G * sp.Matrix(vp) + curvature + 2 * rate + g
        y0, yp0 = np.concatenate([q0, v0, multipliers]), np.concatenate([v0, a, zeros])
        return dae([*q, *v, *lam], [*qp, *vp, *lamp], [*kinematics, *forces, *held], y0, yp0, 1, partition=parts, **options)
    kinematics += G.T * sp.Matrix(mup if as_rates else mu)
    equations = [*kinematics, *forces, *g, *rate]
    y0 = np.concatenate([q0, v0, zeros if as_rates else multipliers, zeros])
    yp0 = np.concatenate([v0, a, multipliers if as_rates else zeros, zeros])
    index = 1 if as_rates else 2
    given = {} if as_rates else {"partition": parts}
    return dae([*q, *v, *lam, *mu], [*qp, *vp, *lamp, *mup], equations, y0, yp0, index, **given, **options)


def circle(form: str) -> DAE:
    """A point driven on the unit circle: x = cos t^2, y = sin t^2, lambda = 2 t^2."""
    q = sp.symbols("x y")
    force = [-2 * sp.sin(t**2), 2 * sp.cos(t**2)]
    return mechanism(q, sp.eye(2), lambda v: force, [q[0] ** 2 + q[1] ** 2 - 1], [1.0, 0.0], [0.0, 0.0], form)


def circle_exact(times: np.ndarray) -> np.ndarray:
    """(k, 5) x, y, u, v, lambda."""
    phi, w = times**2, 2 * times
    return np.array([np.cos(phi), np.sin(phi), -w * np.sin(phi), w * np.cos(phi), w**2 / 2]).T


def circle_ode() -> DAE:
    """The same circle as a limit cycle of an ordinary differential equation: x = cos t^2, y = sin t^2."""
    (x, y), p = unknowns("x y")
    pull = 1 - x**2 - y**2
    rates = [pull * x - 2 * t * y, pull * y + 2 * t * x]
    rhs = sp.lambdify([t, [x, y]], rates, "math")
    F = [p[0] - rates[0], p[1] - rates[1]]
    return dae([x, y], p, F, [1.0, 0.0], [0.0, 0.0], 1, rhs=lambda t, y, out: np.array(rhs(t, y)))


def jay() -> DAE:
    """Index-2 problem of Jay (1993): y1 = e^t, y2 = e^-2t, z = e^2t."""
    (a, b, z), p = unknowns("a b z")
    F = [p[0] - a * b**2 * z**2, p[1] - a**2 * b**2 + 3 * b**2 * z, a**2 * b - 1]
    return dae([a, b, z], p, F, [1, 1, 1], [1, -2, 2], 2)


def jay_exact(times: np.ndarray) -> np.ndarray:
    """(k, 3) y1, y2, z."""
    return np.exp(np.outer(times, [1, -2, 2]))


def pendulum(form: str, length: float = 1.0, pivot: float = 0.0, **options: Any) -> DAE:
    """Point mass on a massless rod, released horizontally; the pivot lies at (pivot, 0)."""
    x, y = q = sp.symbols("x y")
    g = [((x - pivot) ** 2 + y**2 - length**2) / 2]
    return mechanism(q, sp.eye(2), lambda v: [0, -9.81], g, [pivot + length, 0.0], [0.0, 0.0], form, **options)


@cache
def _pendulum_angle(t_end: float) -> Any:
    rate = lambda _, z: [z[1], -9.81 * np.sin(z[0])]  # noqa: E731
    return solve_ivp(rate, [0, t_end], [np.pi / 2, 0], method="DOP853", rtol=3e-14, atol=1e-14, dense_output=True).sol


def pendulum_exact(times: np.ndarray, t_end: float) -> np.ndarray:
    """(k, 4) x, y, u, v."""
    angle, rate = _pendulum_angle(t_end)(times)
    return np.array([np.sin(angle), -np.cos(angle), rate * np.cos(angle), rate * np.sin(angle)]).T


def car_axis(form: str) -> DAE:
    """Car axis of the test set for IVP solvers."""
    q = xl, yl, xr, yr = sp.symbols("xl yl xr yr")
    yb = sp.sin(10 * t) / 10
    xb = sp.sqrt(1 - yb**2)
    k, L0 = sp.Rational(1, 2000), sp.Rational(1, 2)
    left = (L0 / sp.sqrt(xl**2 + yl**2) - 1) * sp.Matrix([xl, yl])
    right = (L0 / sp.sqrt((xr - xb) ** 2 + (yr - yb) ** 2) - 1) * sp.Matrix([xr - xb, yr - yb])
    force = [left[0], left[1] - k, right[0], right[1] - k]
    g = [xl * xb + yl * yb, (xl - xr) ** 2 + (yl - yr) ** 2 - 1]
    return mechanism(q, k * sp.eye(4), lambda v: force, g, [0, 0.5, 1, 0.5], [-0.5, 0, -0.5, 0], form)


class Explicit(DAE):
    """F = y' - f(t, y) with its right-hand side f."""

    def rhs(self, t: float, y: Any, out: Any) -> None:
        self.residual(t, y, np.zeros(self.n), out)
        np.negative(out, out)


def decay(kind: type[DAE] = Explicit, **options: Any) -> DAE:
    """y' = -y for two unknowns."""
    return kind(
        lambda t, y, yp, out: yp + y,
        [1.0, 2.0],
        [-1.0, -2.0],
        lambda t, y, yp, cj, out: (1 + cj) * np.eye(2),
        **options,
    )


class AsInternalStates(System):
    """First-order equations as internal states of a body at rest, so that methods for equations of motion can integrate them."""

    label, sparsity = "ODE", None

    def __init__(self, inner: System) -> None:
        self.inner, self.n, self.t0 = inner, inner.n + 2, inner.t0
        self.kinds = ("q", "v", *["s"] * inner.n)
        self.names, self.equations = ("x", "v", *inner.names), ("x'", "v'", *inner.equations)
        self.index = np.ones(self.n, dtype=int)
        self.scale, self.y0, self.yp0 = np.r_[1.0, 1.0, inner.scale], np.r_[0.0, 0.0, inner.y0], np.r_[0.0, 0.0, inner.yp0]

    def residual(self, t: float, y: Any, yp: Any, out: Any) -> None:
        out[:2] = yp[0] - y[1], yp[1]
        self.inner.residual(t, y[2:], yp[2:], out[2:])

    def jacobian(self, t: float, y: Any, yp: Any, cj: float, out: Any) -> None:
        out[...] = 0.0
        out[:2, :2] = [[cj, -1.0], [0.0, cj]]
        part = np.zeros((self.inner.n, self.inner.n))
        self.inner.jacobian(t, y[2:], yp[2:], cj, part)
        out[2:, 2:] = part

    def accept(self, t: float, y: Any) -> None:
        self.inner.accept(t, y[2:])


def blow_up() -> DAE:
    """y' = y^2, infinite at t = 1."""
    return Explicit(lambda t, y, yp, out: yp - y * y, [1.0], [1.0], lambda t, y, yp, cj, out: np.array([[cj - 2 * y[0]]]))
