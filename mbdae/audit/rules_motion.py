"""Rules of motion: axes, angles, velocities, their changes; the recursive reduction of l's equations to k and the angle."""

from __future__ import annotations

import numpy as np

from mbdae.audit.evaluate import STEP, Value
from mbdae.audit.motion import Motion
from mbdae.audit.phrases import Env, Rule, phrase

#: rotations by their wording, and how a state gives them
ROTATIONS: dict[str, Rule] = {
    "axis {i} of {side}": lambda env, i, side: env.motion.rotation(side)[:, [int(i) - 1]],
    "reference rotation of {side}": lambda env, side: env.motion.R0 + 0j,
    "rotation of {side} from its reference": lambda env, side: env.motion.rotation(side) @ env.motion.R0.T,
    "rotation of l relative to k": lambda env: env.motion.rotation("k").T @ env.motion.rotation("l"),
}
#: the same of quantities that may be zero
QUANTITIES: dict[str, Rule] = {
    "number": lambda env: env.number("number"),
    "relative angle": lambda env: env.motion.relative_angle(),
    "rate of the relative angle": lambda env: env.motion.relative_rate(),
    "second derivative of the relative angle": lambda env: env.motion.phiddot,
    "increment of the relative angle": lambda env: env.number("increment of the relative angle"),
    "relative angle before the increment": lambda env: (
        env.motion.relative_angle() - env.number("increment of the relative angle")),
    "angular velocity of {side}": lambda env, side: env.motion.angular_velocity(side),
    "angular acceleration of {side}": lambda env, side: env.motion.angular_acceleration(side),
    "reference position of {side}": lambda env, side: env.motion.x0[side] + 0j,
    "position of {side}": lambda env, side: env.motion.vectors["x"][side],
    "displacement of {side}": lambda env, side: env.motion.vectors["x"][side] - env.motion.x0[side],
    "position of l relative to k": lambda env: env.motion.vectors["x"]["l"] - env.motion.vectors["x"]["k"],
    "velocity of {side}": lambda env, side: env.motion.vectors["v"][side],
    "virtual rotation of {side}": lambda env, side: env.motion.turn_between(env.motion.moved("virtual"), side),
    "change of attitude of {side}": lambda env, side: env.motion.turn_between(env.motion.moved("linear"), side),
    "variation of the {quantity}": lambda env, quantity: np.imag(env.moved("virtual").of(quantity)) / STEP + 0j,
    "change of the {quantity}": lambda env, quantity: np.imag(env.moved("linear").of(quantity)) / STEP + 0j,
}  # fmt: skip
for _rules, _vanishes in ((ROTATIONS, False), (QUANTITIES, True)):
    for _wording, _rule in _rules.items():
        phrase(_wording, _vanishes)(_rule)


# -- the equations of l in the unknowns of k and the relative angle


@phrase("inertia of l")
def _inertia(env: Env) -> Value:
    return env.motion.matrix("inertia", symmetric=True) + 0j


@phrase("stiffness of l")
def _stiffness(env: Env) -> Value:
    return env.motion.matrix("stiffness") + 0j


@phrase("damping of l")
def _damping(env: Env) -> Value:
    return env.motion.matrix("damping") + 0j


@phrase("residual of l", vanishes=True)
def _residual(env: Env) -> Value:
    return env.motion.ingredient("residual of l") + 0j


@phrase("right-hand side of l in motion", vanishes=True)
def _right_hand_side(env: Env) -> Value:
    return _inertia(env) @ env.motion.angular_acceleration("l")


def _map(m: Motion) -> Value:
    """B (3, 4) of angular velocity l = B (angular velocity k, rate of the angle); virtual rotations follow the same map."""
    none = {**m.vectors, "w": {**m.vectors["w"], "k": np.zeros((3, 1)) + 0j}}
    columns = []
    for rates in np.eye(4):
        still = m.without("")
        still.vectors = {**none, "w": {**none["w"], "k": rates[:3, None] + 0j}}
        still.phidot = rates[3] + 0j
        columns.append(still.angular_velocity("l"))
    return np.hstack(columns)


def _reduced(env: Env, m: Motion) -> Value:
    """B' r in a state m, r the residual of l, linearised about the state of env: M w' + C w + K psi."""
    base = env.motion
    r = _residual(env) + _inertia(env) @ (m.angular_acceleration("l") - base.angular_acceleration("l"))
    r = r + _damping(env) @ (m.angular_velocity("l") - base.angular_velocity("l"))
    if m is not base:
        r = r + _stiffness(env) @ base.turn_between(m, "l") * 1j * STEP
    return _map(m).T @ r


def _tangent(env: Env, of_k: str, of_angle: str) -> Value:
    """Derivative of the reduced residual by unknowns of k and of the angle, by complex steps."""
    columns = []
    for unit in np.eye(4):
        m = env.motion.stepped_by({f"{of_k} k": unit[:3, None], of_angle: unit[3]})
        columns.append(np.imag(_reduced(env, m)) / STEP)
    return np.hstack(columns) + 0j


@phrase("mass matrix of l in the unknowns of k and the angle")
def _reduced_mass(env: Env) -> Value:
    return _tangent(env, "alpha", "phiddot")


@phrase("damping matrix of l in the unknowns of k and the angle")
def _reduced_damping(env: Env) -> Value:
    return _tangent(env, "w", "phidot")


@phrase("stiffness matrix of l in the unknowns of k and the angle", needs=(("r", "N m", "residual of l"),))
def _reduced_stiffness(env: Env) -> Value:
    return _tangent(env, "turn", "phi")
