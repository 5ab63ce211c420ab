"""Rules of motion: axes, angles, velocities, their changes; the recursive reduction of l's equations to k and the angle."""

from __future__ import annotations

import numpy as np

from mbdae.audit.evaluate import STEP, Value, cross
from mbdae.audit.motion import Motion
from mbdae.audit.phrases import Env, phrase

phrase("number", vanishes=True)(lambda env: env.number("number"))


@phrase("axis {i} of {side}")
def _axis(env: Env, i: str, side: str) -> Value:
    return env.motion.rotation(side)[:, [int(i) - 1]]


@phrase("reference rotation of {side}")
def _reference(env: Env, side: str) -> Value:
    return env.motion.R0 + 0j


@phrase("rotation of {side} from its reference")
def _rotation(env: Env, side: str) -> Value:
    return env.motion.rotation(side) @ env.motion.R0.T


@phrase("rotation of l relative to k")
def _relative_rotation(env: Env) -> Value:
    return env.motion.rotation("k").T @ env.motion.rotation("l")


# -- the relative angle


@phrase("relative angle", vanishes=True)
def _angle(env: Env) -> Value:
    return env.motion.relative_angle()


@phrase("rate of the relative angle", vanishes=True)
def _angle_rate(env: Env) -> Value:
    return env.motion.relative_rate()


@phrase("second derivative of the relative angle", vanishes=True)
def _angle_acceleration(env: Env) -> Value:
    return env.motion.phiddot


@phrase("increment of the relative angle", vanishes=True)
def _increment(env: Env) -> Value:
    return env.number("increment of the relative angle")


@phrase("relative angle before the increment", vanishes=True)
def _before(env: Env) -> Value:
    return env.motion.relative_angle() - _increment(env)


# -- bodies


@phrase("angular velocity of {side}", vanishes=True)
def _angular_velocity(env: Env, side: str) -> Value:
    return env.motion.angular_velocity(side)


@phrase("angular acceleration of {side}", vanishes=True)
def _angular_acceleration(env: Env, side: str) -> Value:
    return env.motion.angular_acceleration(side)


@phrase("reference position of {side}", vanishes=True)
def _reference_position(env: Env, side: str) -> Value:
    return env.motion.x0[side] + 0j


@phrase("position of {side}", vanishes=True)
def _position(env: Env, side: str) -> Value:
    return env.motion.vectors["x"][side]


@phrase("displacement of {side}", vanishes=True)
def _displacement(env: Env, side: str) -> Value:
    return env.motion.vectors["x"][side] - env.motion.x0[side]


@phrase("position of l relative to k", vanishes=True)
def _relative_position(env: Env) -> Value:
    return env.motion.vectors["x"]["l"] - env.motion.vectors["x"]["k"]


@phrase("velocity of {side}", vanishes=True)
def _velocity(env: Env, side: str) -> Value:
    return env.motion.vectors["v"][side]


# -- changes


@phrase("virtual rotation of {side}", vanishes=True)
def _virtual_rotation(env: Env, side: str) -> Value:
    return env.motion.turn_between(env.motion.moved("virtual"), side)


@phrase("change of attitude of {side}", vanishes=True)
def _change_of_attitude(env: Env, side: str) -> Value:
    return env.motion.turn_between(env.motion.moved("linear"), side)


@phrase("variation of the {quantity}", vanishes=True)
def _variation(env: Env, quantity: str) -> Value:
    return np.imag(env.moved("virtual").of(quantity)) / STEP + 0j


@phrase("change of the {quantity}", vanishes=True)
def _change(env: Env, quantity: str) -> Value:
    return np.imag(env.moved("linear").of(quantity)) / STEP + 0j


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


def moving_point(m: Motion, base: Motion, side: str, p: Value) -> Value:
    """Position, in a state m after a complex step, of the point of a body that is at p in the base state."""
    arm = np.real(p) - np.real(base.vectors["x"][side])
    return m.vectors["x"][side] + m.rotation(side) @ np.real(base.rotation(side)).T @ arm


def velocity_of_point(m: Motion, side: str, p: Value) -> Value:
    """Velocity of the point of a body that is at p."""
    return m.vectors["v"][side] + cross(m.angular_velocity(side)) @ (p - m.vectors["x"][side])
