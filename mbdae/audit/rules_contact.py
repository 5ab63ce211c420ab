"""Rules of contact and friction: geometry of a pin in its race, material points, Hertz, Coulomb, LuGre, trapezoidal rule."""

from __future__ import annotations

import warnings

import numpy as np
import symengine as se

from mbdae.audit.evaluate import STEP, Value, cross
from mbdae.audit.laws import gap, journal, outward
from mbdae.audit.phrases import Env, phrase, random_number, random_positive
from mbdae.integrators.runge_kutta.tables import radau_table
from mbdae.laws.contact import Hertz
from mbdae.laws.friction import Coulomb, LuGre

# -- the pin in its race: `env.inner` is the body with the pin


def _sides(env: Env) -> str:
    """The bodies with the race and with the pin."""
    return "kl" if env.inner == "l" else "lk"


def _radii(env: Env) -> tuple[float, float]:
    """Radii of race and pin, m."""
    inner = env.motion.positive("radius of the pin")
    return inner + 0.1 * env.motion.positive("clearance"), inner


@phrase("radius on {side}")
def _radius(env: Env, side: str) -> Value:
    return complex(_radii(env)[side == env.inner])


@phrase("distance of race and pin", vanishes=True)
def _gap(env: Env) -> Value:
    return gap(journal(env.motion, _radii(env), _sides(env)))


def _outward(env: Env) -> Value:
    return outward(journal(env.motion, _radii(env), _sides(env)))


@phrase("normal direction from k to l")
def _normal(env: Env) -> Value:
    return _outward(env) * (1 if env.inner == "l" else -1)


@phrase("point of contact on {side}", vanishes=True)
def _contact_point(env: Env, side: str) -> Value:
    return env.motion.vectors["x"][side] + _radius(env, side) * _outward(env)


@phrase("{name} as printed in {number}", vanishes=True)
def _as_printed(env: Env, name: str, number: str) -> Value:
    return env.printed(name, number)


# -- material points at the points a text prints


@phrase("material point of {side} at {name} of {number}", vanishes=True)
def _material_point(env: Env, side: str, name: str, number: str) -> Value:
    m, base = env.motion, env.motion.base
    arm = np.real(_printed_at_base(env, name, number)) - np.real(base.vectors["x"][side])
    return m.vectors["x"][side] + m.rotation(side) @ np.real(base.rotation(side)).T @ arm


def _printed_at_base(env: Env, name: str, number: str) -> Value:
    return env.at_base().printed(name, number)


@phrase("velocity of {side} at {name} of {number}", vanishes=True)
def _point_velocity(env: Env, side: str, name: str, number: str) -> Value:
    m, point = env.motion, _printed_at_base(env, name, number)
    return m.vectors["v"][side] + cross(m.angular_velocity(side)) @ (point - m.vectors["x"][side])


@phrase("velocity of l relative to k at {name}, {name2} of {number}", vanishes=True)
def _relative_velocity(env: Env, k: str, l: str, number: str) -> Value:
    return _point_velocity(env, "l", l, number) - _point_velocity(env, "k", k, number)


@phrase("sliding velocity at {name}, {name2} of {number}", vanishes=True)
def _sliding(env: Env, k: str, l: str, number: str) -> Value:
    v, n = _relative_velocity(env, k, l, number), _normal(env)
    return v - n * (n.T @ v)[0, 0]


@phrase("direction of sliding at {name}, {name2} of {number}")
def _direction(env: Env, k: str, l: str, number: str) -> Value:
    v = _sliding(env, k, l, number)
    return v / np.sqrt(np.sum(v * v))


# -- forces of contact: normal force f_n pushes the bodies apart, friction opposes the sliding of l over k

_normal_force = random_positive("normal force")
_mu = random_positive("coefficient of friction")


@phrase("friction force along the sliding", vanishes=True)
def _friction(env: Env) -> Value:
    return -_mu(env) * _normal_force(env)


@phrase("contact force of the normal force on {side}", vanishes=True, signed=True)
def _normal_on(env: Env, side: str) -> Value:
    return _normal(env) * _normal_force(env) * (1 if side == "k" else -1)


@phrase("contact force and moment of friction on {side} at {name}, {name2} of {number}", vanishes=True, signed=True)
def _friction_on(env: Env, side: str, k: str, l: str, number: str) -> Value:
    force = _direction(env, k, l, number) * _friction(env) * (1 if side == "l" else -1)
    arm = _printed_at_base(env, {"k": k, "l": l}[side], number) - env.motion.vectors["x"][side]
    return np.vstack([force, np.cross(arm, force, axis=0)])


def _virtual(env: Env, side: str, name: str, number: str) -> Value:
    moved = env.moved("virtual")
    return np.imag(_material_point(moved, side, name, number)) / STEP + 0j


@phrase("contact work of the normal force at {name}, {name2} of {number}", vanishes=True, signed=True)
def _normal_work(env: Env, k: str, l: str, number: str) -> Value:
    n = _normal(env) * _normal_force(env)
    return (n.T @ (_virtual(env, "k", k, number) - _virtual(env, "l", l, number)))[0, 0]


@phrase("contact work of friction at {name}, {name2} of {number}", vanishes=True, signed=True)
def _friction_work(env: Env, k: str, l: str, number: str) -> Value:
    t = _direction(env, k, l, number) * _friction(env)
    return (t.T @ (_virtual(env, "l", l, number) - _virtual(env, "k", k, number)))[0, 0]


# -- Hertz

_penetration = random_positive("penetration")


@phrase("rate of penetration", vanishes=True)
def _penetration_rate(env: Env) -> Value:
    return 0.5 * env.number("rate of penetration") + 0j


def _hertz(env: Env) -> Hertz:
    return Hertz(env.motion.positive("parameter stiffness"), 0.5 * env.motion.positive("contact damping"))


def _complex(e: object) -> Value:
    return complex(se.sympify(e).n())


def _se(value: Value) -> object:
    return se.sympify(complex(value)) if np.imag(value) else se.RealDouble(float(np.real(value)))


@phrase("damping of Hertz")
def _hertz_damping(env: Env) -> Value:
    return complex(_hertz(env).damping or 0.0)


@phrase("energy of Hertz")
def _hertz_energy(env: Env) -> Value:
    return _complex(_hertz(env).energy(_se(_penetration(env))))


@phrase("elastic force of Hertz")
def _elastic(env: Env) -> Value:
    return _complex(_hertz(env).elastic_force(_se(_penetration(env))))


@phrase("damping force of Hertz", vanishes=True)
def _damping_force(env: Env) -> Value:
    return _complex(_hertz(env).damping_force(_se(_penetration(env)), _se(_penetration_rate(env))))


@phrase("damping factor of Hertz", vanishes=True)
def _damping_factor(env: Env) -> Value:
    return _damping_force(env) / _elastic(env)


@phrase("normal force of Hertz")
def _hertz_force(env: Env) -> Value:
    return _elastic(env) + _damping_force(env)


# -- Coulomb and LuGre


def _friction_parameters(env: Env) -> dict[str, float]:
    p = {n: env.motion.positive(f"friction {n}") for n in ("mu_k", "v_s", "sigma0", "sigma1", "sigma2", "v_c")}
    return p | {"mu_s": p["mu_k"] + env.motion.positive("friction mu_s"), "gamma": 1 + env.motion.positive("friction gamma")}


@phrase("friction parameter {name}")
def _friction_parameter(env: Env, name: str) -> Value:
    return complex(_friction_parameters(env)[name])


_speed = random_number("sliding speed")
_deflection = random_number("deflection")


def _coulomb(env: Env, v: Value) -> Value:
    p = _friction_parameters(env)
    return _complex(Coulomb(p["mu_k"], p["v_c"]).coefficient(_se(v))) * _normal_force(env)


@phrase("friction force of Coulomb", vanishes=True)
def _coulomb_force(env: Env) -> Value:
    return -_coulomb(env, _speed(env))


@phrase("friction force of sliding", vanishes=True)
def _saturated(env: Env) -> Value:
    return -_coulomb(env, 1e3 * _friction_parameters(env)["v_c"])


def lugre(env: Env, z: Value) -> LuGre:
    """The law with constant bristle damping (`damping_decay=False`), its bristles deflected by z."""
    p = {n: v for n, v in _friction_parameters(env).items() if n != "v_c"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        law: LuGre = LuGre(**p, damping_decay=False).with_states(z=_se(z))
    return law


@phrase("steady deflection of LuGre")
def _steady(env: Env) -> Value:
    v = _speed(env)
    return abs(_complex(lugre(env, 0.0).initial(_se(v))["z"]))


@phrase("rate of deflection of LuGre", vanishes=True)
def _lugre_rate(env: Env) -> Value:
    return _complex(lugre(env, _deflection(env)).rate(_se(_speed(env)))["z"])


@phrase("coefficient of LuGre", vanishes=True)
def _lugre_coefficient(env: Env) -> Value:
    return _complex(lugre(env, _deflection(env)).coefficient(_se(_speed(env))))


@phrase("friction force of LuGre", vanishes=True)
def _lugre_force(env: Env) -> Value:
    return -_lugre_coefficient(env) * _normal_force(env)


@phrase("friction force of sticking", vanishes=True)
def _sticking(env: Env) -> Value:
    """Force of bristles at rest, deflected up to break-away; half of the states are at break-away, in both directions."""
    breaking = abs(_complex(lugre(env, 0.0).initial(se.RealDouble(1e-12))["z"]))
    share = (1.0, -1.0)[env.motion.seed % 2] if env.motion.seed % 4 < 2 else env.motion.number("share") / 1.5
    return -_complex(lugre(env, share * breaking).coefficient(se.RealDouble(0.0))) * _normal_force(env)


# -- LuGre over one stage of Radau IIA by the trapezoidal rule

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
    length, v = _stage(env), _se(_speed(env))
    at0, at1 = (_complex(lugre(env, z).rate(v)["z"]) for z in (0.0, 1.0))
    return (_before(env) + length / 2 * (_before_rate(env) + at0)) / (1 - length / 2 * (at1 - at0))


@phrase("rate of deflection at the stage", vanishes=True)
def _stage_rate(env: Env) -> Value:
    return _complex(lugre(env, _trapezoidal(env)).rate(_se(_speed(env)))["z"])
