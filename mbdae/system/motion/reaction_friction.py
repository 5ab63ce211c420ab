"""Forces that depend on multipliers: friction of joints, which grows with their own reaction forces.

M u' + G^T lambda = f + R(lambda), G u' = -gamma, where R is the friction, is solved by Newton's method with the exact dR/dlambda,
starting from the multipliers without friction. Where that fails, the friction is increased from 0 to R in steps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import SolverError
from mbdae.symbolic.outputs import slopes
from mbdae.system.base import Array
from mbdae.system.motion.states import States

ITERATIONS = 30
SETTLED = 1e-10  #: change of the multipliers at which Newton's method stops, relative to the largest multiplier or load
SMALLEST = 1e-6  #: lower bound (N or N m) of the largest multiplier or load in SETTLED, for scenes without any force
STEPS = 8  #: number of equal steps in which friction is increased from 0 where Newton's method fails at once

State = tuple[Array, Array, Array, Array | None]  #: times, q, u, s of many states
#: function (f (nt, nu), dR/dlambda (nt, nu, m) or None) that returns u' (nt, nu) and lambda (nt, m) of the linear equations
#: M u' + (G^T - dR/dlambda) lambda = f, G u' = -gamma
Solve = Callable[[Array, Array | None], tuple[Array, Array]]


def friction_of(mechanics: States, state: State, multipliers: Array) -> tuple[Array, Array]:
    """The friction R (nt, nu) and its derivative dR/dlambda (nt, nu, m) at multipliers lambda (nt, m)."""
    nb, scaling = mechanics.numbering, mechanics.numbering.scaling()
    R, slope = np.zeros((len(multipliers), mechanics.nu)), np.zeros((len(multipliers), mechanics.nu, mechanics.m))
    for g, p, values in mechanics.evaluate(slopes, *state, multipliers, groups=mechanics.reactive):
        for i in range(values.shape[1]):
            for o, target in enumerate(p.targets):
                at = nb.velocity(target, g, i)
                if target[0] != "slope":
                    R[:, at] -= values[:, i, o]
                    continue
                row = nb.row(g, i, target[3])
                if row is not None:
                    slope[:, at, row] -= values[:, i, o] / scaling[row]
    return R, slope


def solve_with_friction(mechanics: States, state: State, f: Array, solve: Solve) -> tuple[Array, Array]:
    """u' (nt, nu) and lambda (nt, m) with friction. f (nt, nu): all forces, with the friction at lambda = 0; solve: solves the
    linear equations. Raises SolverError where no solution is found."""
    f = f - friction_of(mechanics, state, np.zeros((len(f), mechanics.m)))[0]
    _, start = solve(f, None)
    acceleration, multipliers, left = _newton(mechanics, state, f, solve, start, 1.0)
    if np.any(left):
        multipliers = start
        for step in range(1, STEPS + 1):
            acceleration, multipliers, left = _newton(mechanics, state, f, solve, multipliers, step / STEPS)
    if np.any(left):
        raise SolverError(_refusal(mechanics, left), float(state[0][int(np.argmax(np.any(left, axis=1)))]))
    return acceleration, multipliers


def _newton(mechanics: States, state: State, f: Array, solve: Solve, multipliers: Array,
            share: float) -> tuple[Array, Array, NDArray[np.bool_]]:  # fmt: skip
    """Newton's method from the given multipliers for `share` times the friction: u', lambda, and which multipliers (nt, m) have
    not converged."""
    for _ in range(ITERATIONS):
        R, slope = friction_of(mechanics, state, multipliers)
        acceleration, new = solve(f + share * (R - np.einsum("tij,tj->ti", slope, multipliers)), share * slope)
        size = np.maximum(np.max(np.abs(new), axis=1, keepdims=True, initial=SMALLEST), np.max(np.abs(f), axis=1, keepdims=True))
        left, multipliers = ~(np.abs(new - multipliers) <= SETTLED * size), new
        if not np.any(left):
            break
    return acceleration, multipliers, left


def _refusal(mechanics: States, left: NDArray[np.bool_]) -> str:
    """The error message that names the joints whose reactions have not converged."""
    places = {(g, i): mechanics.model.groups[g].instances[i].item
              for g in mechanics.reactive for i in range(len(mechanics.model.groups[g].instances))}  # fmt: skip
    unsettled = [(r.group, r.instance) for r, found in zip(mechanics.rows, np.any(left, axis=0), strict=True) if found]
    names = dict.fromkeys([places[p] for p in unsettled if p in places] or list(places.values()))
    listed = ", ".join(f"'{name}'" for name in list(names)[:4])
    return (f"friction and reaction of joint {listed} find no balance: friction raises the reaction that presses it by more than "
            f"itself (self-locking); take a smaller friction coefficient or radius, another place of the joint, or for a "
            f"prismatic joint a given normal_force")  # fmt: skip
