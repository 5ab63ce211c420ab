"""Equations of motion given as their parts: mass matrix M, forces f, constraints g and constraint Jacobian G, by a user's
functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.system.base import System
from mbdae.values import BadValueError, option, sequence, shown

#: largest residual at the start that is accepted: of M u' + G^T lambda = f over the sum of the largest magnitudes of M u' and f,
#: of g = 0 over 1 plus the largest magnitude of q
TOLERANCE = 1e-6

Parts = tuple[Callable[..., Any], ...]


def checked_partition(system: System, parts: Sequence[Callable[..., Any]]) -> tuple[Parts, tuple[str, ...]]:
    """The parts (M, f, g, G), and the kind of every unknown of the system, which follows from their shapes; OptionError where
    they do not fit the unknowns or the start."""
    remedy = "give four functions (M, f, g, G): M(t, q), f(t, q, u), g(t, q), G(t, q)"
    given = option("partition", parts, sequence, remedy, each=_function)
    if len(given) != 4:
        raise OptionError(f"partition = {shown(parts)}: {remedy}")
    M, f, g, G = given
    failure: Exception | None = None
    for nu in range(system.n // 2, 0, -1):
        left = system.n - 2 * nu
        try:
            q, u = system.y0[:nu], system.y0[nu : 2 * nu]
            shapes = [np.shape(value) for value in (M(system.t0, q), f(system.t0, q, u), g(system.t0, q), G(system.t0, q))]
        except (IndexError, ValueError, TypeError) as error:  # try the next division of the unknowns into q, u and multipliers
            failure = error
            continue
        m = shapes[2][0] if shapes[2] else 0
        if shapes == [(nu, nu), (nu,), (m,), (m, nu)] and left in (m, 2 * m):
            _check_start(system, (M, f, g, G), nu, m)
            kinds = ("q",) * nu + ("v",) * nu + ("lambda",) * m + ("mu",) * (left - m)
            return (M, f, g, G), kinds
    raise OptionError(f"partition: no division of the {system.n} unknowns into y = (q, u, lambda) or (q, u, lambda, mu) fits; "
                      "with nu numbers in q and in u, and m in lambda and in mu, the functions have to return M (nu, nu), "
                      "f (nu,), g (m,) and G (m, nu): correct what they return, or y0") from failure  # fmt: skip


def _function(value: Any) -> Callable[..., Any]:
    """The value if it is a function, of any arguments; else raises an error."""
    if not callable(value):
        raise BadValueError(f"{shown(value)} is not a function")
    return value  # type: ignore[no-any-return]


def _check_start(system: System, parts: Sequence[Callable[..., Any]], nu: int, m: int) -> None:
    """Raise OptionError where the parts are not satisfied at the start."""
    M, f, g, G = parts
    t, q, u, multipliers = system.t0, system.y0[:nu], system.y0[nu : 2 * nu], system.y0[2 * nu : 2 * nu + m]
    inertia, force, rows = np.asarray(M(t, q)) @ system.yp0[nu : 2 * nu], np.asarray(f(t, q, u)), np.asarray(G(t, q))
    left, size = inertia + rows.T @ multipliers - force, np.max(np.abs(inertia)) + np.max(np.abs(force)) + 1e-300
    if np.max(np.abs(left)) > TOLERANCE * size:
        raise OptionError(f"partition: M u' + G^T lambda - f = {left} at the start instead of 0: M, f or G state other equations "
                          "than the residual, or lambda has the other sign there; correct them")  # fmt: skip
    if np.max(np.abs(g(t, q)), initial=0.0) > TOLERANCE * (1 + np.max(np.abs(q))):
        raise OptionError(f"partition: g = {g(t, q)} at the start, where it has to vanish; correct g or y0")
