"""The equations solved for what a method wants: the right-hand side of an ODE, or M, f, g and G apart."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.mechanics import Mechanics


class Partition(NamedTuple):
    """M u' + G^T lambda = f, g = 0 as functions: M(t, q) (nu, nu), f(t, q, u, s) (nu,), g(t, q) (m,), G(t, q) (m, nu)."""

    M: Callable[[float, Array], Array]
    f: Callable[..., Array]
    g: Callable[[float, Array], Array]
    G: Callable[[float, Array], Array]


def partition_of(mechanics: Mechanics) -> Partition:
    """The parts of a scene's equations of motion, for methods of second order."""

    def at(t: float) -> Array:
        return np.array([t])

    def load(t: float, q: Array, u: Array, s: Array | None = None) -> Array:
        return np.asarray(mechanics.load(at(t), q[None], u[None], None if s is None else s[None])[0])

    return Partition(
        lambda t, q: mechanics.mass, load,
        lambda t, q: mechanics.position_residual(at(t), q[None])[0],
        lambda t, q: mechanics.constraint_jacobian(at(t), q[None])[0],
    )  # fmt: skip


def state_rate_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Rates of internal states."""
    return [] if isinstance(d.law, Element) else [(("s", j), e) for j, e in enumerate(d.state_rates)]


def state_rates(mechanics: Mechanics, t: float, q: Array, u: Array, s: Array) -> Array:
    """s' (ns,) of the internal states."""
    return np.asarray(mechanics.of_states(state_rate_outputs, np.array([t]), q[None], u[None], s[None])[0])


def rhs_of(mechanics: Mechanics) -> Callable[[float, Array, Array], None]:
    """y' = rhs of a scene without constraints: (t, y, out) -> None, y = (q, u, s)."""
    inverse, nq, nu = np.linalg.inv(mechanics.mass), mechanics.nq, mechanics.nu

    def rhs(t: float, y: Array, out: Array) -> None:
        q, u, s = y[:nq], y[nq : nq + nu], y[nq + nu :]
        out[:nq] = mechanics.rates(q, u)
        out[nq : nq + nu] = inverse @ mechanics.load(np.array([t]), q[None], u[None], s[None])[0]
        out[nq + nu :] = state_rates(mechanics, t, q, u, s)

    return rhs
