"""Rules of friction laws: coefficients, forces, rates of their states; LuGre by the trapezoidal rule over a stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.evaluate import Value
from mbdae.audit.phrases import Env, phrase, random_number, random_positive
from mbdae.audit.rules_contact import _normal_force, number_of, part, rubbing_sense
from mbdae.integrators.runge_kutta.tables import radau_table
from mbdae.laws.friction import Friction

_speed = random_number("sliding speed")
_deflection = random_number("deflection")
#: names of one quantity in several laws
_SAME = {"mu": "mu_k"}


def _options(env: Env) -> dict[str, Any]:
    """Exponent of the Stribeck curve, and bristle damping that does not fall with the speed, as texts have it."""
    return {"gamma": 1 + env.motion.positive("friction gamma"), "damping_decay": False}


def _friction(env: Env, name: str, z: Value = 0.0) -> Any:
    """The law with all of its states at z."""
    law = part(env, name, Friction, _options(env))
    for p in law.params:
        setattr(law, p, friction_parameter(env, p).real)
    for state in law.states:
        setattr(law, state, se.sympify(complex(z)))
    return law


@phrase("friction parameter {name}")
def friction_parameter(env: Env, name: str) -> Value:
    """Value of a parameter of the friction law; mu_s is above mu_k, whatever was drawn."""
    if name == "gamma":
        return complex(_options(env)["gamma"])
    above = env.motion.positive("parameter mu_k") if name == "mu_s" else 0.0
    return complex(above + env.motion.positive(f"parameter {_SAME.get(name, name)}"))


@phrase("coefficient of {name}", vanishes=True)
def _coefficient(env: Env, name: str) -> Value:
    return number_of(_friction(env, name, _deflection(env)).coefficient, _speed(env))


@phrase("friction force of {name}", vanishes=True)
def _force(env: Env, name: str) -> Value:
    """On l along t, by the contact law's sense of a positive coefficient."""
    return _sense(env) * _coefficient(env, name) * _normal_force(env)


def _sense(env: Env) -> float:
    """Sense of the contact law for a positive coefficient."""
    return rubbing_sense(env.touching())


@phrase("friction force of sliding", vanishes=True)
def _saturated(env: Env) -> Value:
    speed = 1e3 * friction_parameter(env, "v_c")
    return _sense(env) * number_of(_friction(env, "Coulomb").coefficient, speed) * _normal_force(env)


@phrase("steady deflection of {name}")
def _steady(env: Env, name: str) -> Value:
    return abs(_start(env, name))


def _start(env: Env, name: str) -> Value:
    """Steady value of the first state at the sliding speed."""
    law = _friction(env, name)
    return number_of(law.initial, _speed(env), state=next(iter(law.states)))


def _rate_at(env: Env, name: str, z: Value) -> Value:
    law = _friction(env, name, z)
    return number_of(law.rate, _speed(env), state=next(iter(law.states)))


@phrase("rate of deflection of {name}", vanishes=True)
def _rate(env: Env, name: str) -> Value:
    return _rate_at(env, name, _deflection(env))


@phrase("bristle energy of {name}", vanishes=True)
def _stored(env: Env, name: str) -> Value:
    """Energy stored in the states, over the normal force, m."""
    return number_of(_friction(env, name, _deflection(env)).stored, _speed(env))


def energy_fed(env: Env, name: str) -> float | None:
    """The lowest of some sliding speeds (m/s) at which a law with a state feeds energy, at a deflection that it may have.

    0.0 where none does; None of a law without states."""
    law = _friction(env, name)
    if not law.states:
        return None
    state = next(iter(law.states))
    most = abs(number_of(law.initial, 1e-12, state=state))
    for v in np.logspace(-3, 4, 71):
        for z in most * np.linspace(-1, 1, 41):
            law, dz = _friction(env, name, z), 1e-6 * most
            stored = [number_of(_friction(env, name, z + d).stored, v) for d in (-dz, dz)]
            slope = (stored[1] - stored[0]) / (2 * dz)
            if np.real(number_of(law.coefficient, v) * v - slope * number_of(law.rate, v, state=state)) < -1e-6:
                return float(v)
    return 0.0


@phrase("steady coefficient of {name}", vanishes=True)
def _steady_coefficient(env: Env, name: str) -> Value:
    z = _start(env, name) if _friction(env, name).states else 0.0
    return number_of(_friction(env, name, z).coefficient, _speed(env))


@phrase("friction force of sticking", vanishes=True)
def _sticking(env: Env) -> Value:
    """Force of bristles at rest, deflected up to break-away; half of the states are at break-away, in both directions."""
    breaking = abs(number_of(_friction(env, "LuGre").initial, 1e-12, state="z"))
    share = (1.0, -1.0)[env.motion.seed % 2] if env.motion.seed % 4 < 2 else env.motion.number("share") / 1.5
    return _sense(env) * number_of(_friction(env, "LuGre", share * breaking).coefficient, 0.0) * _normal_force(env)


# -- a law with a state over one stage of Radau IIA by the trapezoidal rule

_step = random_positive("time step")


@phrase("length of the stage")
def _stage(env: Env) -> Value:
    """(c_i - c_(i-1)) times the step, of one of the stages of Radau IIA with 2 or 3 stages."""
    spacings = [d for s in (2, 3) for d in np.diff(radau_table(s).c, prepend=0.0)]
    return _step(env) * spacings[env.motion.seed % len(spacings)]


_before = random_number("deflection at the stage before")
_before_rate = random_number("rate of deflection at the stage before")


@phrase("deflection at the stage by the trapezoidal rule", vanishes=True, needs=(("hi", "s", "length of the stage"),))
def _trapezoidal(env: Env) -> Value:
    """z of (z' + z'_before)/2 = (z - z_before)/length with LuGre's z', which is linear in z."""
    length = _stage(env)
    at0, at1 = (_rate_at(env, "LuGre", z) for z in (0.0, 1.0))
    return (_before(env) + length / 2 * (_before_rate(env) + at0)) / (1 - length / 2 * (at1 - at0))


@phrase("rate of deflection at the stage", vanishes=True)
def _stage_rate(env: Env) -> Value:
    return _rate_at(env, "LuGre", _trapezoidal(env))
