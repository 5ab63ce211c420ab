"""Rules of contact: geometry of a pin in its race, forces of the implemented contact law, normal and friction laws.

Directions and signs of forces are those of the contact law; points, speeds and the normal force those of the text.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.carried import expression_value
from mbdae.audit.evaluate import STEP, Value, cross
from mbdae.audit.laws import (
    LawState,
    Rule,
    journal,
    observed,
    outward,
    part_class,
    phrase,
    random_number,
    random_positive,
    register,
)
from mbdae.audit.notation import GIVE_OWN_CLASS, AuditError
from mbdae.audit.phrases import Env
from mbdae.integrators import radau_table
from mbdae.laws.contact import Normal
from mbdae.laws.friction import Coulomb, Friction, LuGre

_normal_force = random_positive("normal force")
_mu = random_positive("coefficient of friction")
_penetration = random_positive("penetration")
_impact_speed = random_positive("impact speed")
_speed = random_number("sliding speed")
_deflection = random_number("deflection")
_step = random_positive("time step")
_before = random_number("deflection at the stage before")
_before_rate = random_number("rate of deflection at the stage before")
AT = " at {name}, {name2} of {number}"  #: suffix of wordings: symbols of the contact points on k and l, and their equation


# -- a pin in its race; `env.inner` is the body of the pin


def _sides(env: Env) -> str:
    """Letters of the bodies in the order race, pin."""
    return "kl" if env.inner == "l" else "lk"


def _radii(env: Env) -> tuple[float, float]:
    """Radii of race and pin, m."""
    inner = env.motion.positive("radius of the pin")
    return inner + 0.1 * env.motion.positive("clearance"), inner


def _contact(env: Env, rubbing: bool = True) -> LawState:
    return journal(env.motion, _radii(env), _sides(env), rubbing)


def _radius(env: Env, side: str) -> Value:
    return complex(_radii(env)[side == env.inner])


def _normal(env: Env) -> Value:
    """Unit vector (3, 1) from the centre on k to that on l, inertial."""
    return outward(_contact(env)) * (1 if env.inner == "l" else -1)


# -- material points of the bodies at the contact points that a text prints


def _printed_at_base(env: Env, name: str, number: str) -> Value:
    return env.at_base().printed(name, number)


def _material_point(env: Env, side: str, name: str, number: str) -> Value:
    m, base = env.motion, env.motion.base
    arm = np.real(_printed_at_base(env, name, number)) - np.real(base.of("x", side))
    return m.of("x", side) + m.rotation(side) @ np.real(base.rotation(side)).T @ arm


def _point_velocity(env: Env, side: str, name: str, number: str) -> Value:
    m, point = env.motion, _printed_at_base(env, name, number)
    return m.of("v", side) + cross(m.of("w", side)) @ (point - m.of("x", side))


def _relative_velocity(env: Env, k: str, l: str, number: str) -> Value:
    return _point_velocity(env, "l", l, number) - _point_velocity(env, "k", k, number)


def _sliding(env: Env, k: str, l: str, number: str) -> Value:
    v, n = _relative_velocity(env, k, l, number), _normal(env)
    return v - n * (n.T @ v)[0, 0]


def _unit(v: Value) -> Value:
    length = np.sqrt(np.sum(v * v))
    return v / length if np.real(length) > 0 else _no_contact()


# -- forces of contact


def _sense(env: Env) -> float:
    """Sign of the law's friction force on l along the sliding velocity of l over k: -1 where it brakes."""
    return -float(np.sign(np.real(observed(_contact(env), "friction_power")))) or _no_contact()


def _no_contact() -> float:
    raise AuditError("race and pin do not touch or do not slide in a random state of motion, where this direction or force has "
                     "no value: leave the equation out, or name a normal law with force at every penetration")


def _friction_force(env: Env) -> Value:
    return _sense(env) * _mu(env) * _normal_force(env)


def _applied(env: Env, side: str, rubbing: bool) -> Value:
    return -_contact(env, rubbing).force("move", "kl"[_sides(env).index(side)])


def _normal_on(env: Env, side: str) -> Value:
    return _unit(_applied(env, side, rubbing=False)) * _normal_force(env)


def _friction_on(env: Env, side: str, k: str, l: str, number: str) -> Value:
    """Force and moment about the body's centre (6, 1) of friction on the body `side`. k, l, number: as in `AT`."""
    rubbing = _applied(env, side, rubbing=True) - _applied(env, side, rubbing=False)
    on_l = _applied(env, "l", rubbing=True) - _applied(env, "l", rubbing=False)
    action = np.sign(np.real((rubbing.T @ on_l)[0, 0]))  # 1 for the force on l, -1 for the reaction on k
    force = _unit(_sliding(env, k, l, number)) * _friction_force(env) * action
    arm = _printed_at_base(env, {"k": k, "l": l}[side], number) - env.motion.of("x", side)
    return np.vstack([force, np.cross(arm, force, axis=0)])


def _work(env: Env, force_on: Callable[[str], Value], points: dict[str, str], number: str) -> Value:
    """Virtual work of the contact forces, each at the material point of its body. points: {body: symbol of the contact point}."""
    moved = env.moved("virtual")
    change = {s: np.imag(_material_point(moved, s, name, number)) / STEP for s, name in points.items()}
    return sum((force_on(s)[:3].T @ change[s])[0, 0] for s in points)


register({
    "distance of race and pin": lambda env: observed(_contact(env), "gap"),
    "point of contact on {side}": lambda env, side: env.motion.of("x", side) + _radius(env, side) * outward(_contact(env)),
    "{name} as printed in {number}": lambda env, name, number: env.printed(name, number),
    "material point of {side} at {name} of {number}": _material_point,
    "velocity of {side} at {name} of {number}": _point_velocity,
    "velocity of l relative to k" + AT: _relative_velocity,
    "sliding velocity" + AT: _sliding,
    "friction force along the sliding": _friction_force,
})
register({
    "radius on {side}": _radius,
    "normal direction from k to l": _normal,
    "direction of sliding" + AT: lambda env, k, l, number: _unit(_sliding(env, k, l, number)),
}, vanishes=False)
register({
    "contact force of the normal force on {side}": _normal_on,
    "contact force and moment of friction on {side}" + AT: _friction_on,
    "contact work of the normal force" + AT: lambda env, k, l, number: (
        _work(env, lambda side: _normal_on(env, side), {"k": k, "l": l}, number)),
    "contact work of friction" + AT: lambda env, k, l, number: (
        _work(env, lambda side: _friction_on(env, side, k, l, number), {"k": k, "l": l}, number)),
}, side="open")


# -- normal laws and friction laws


def part(env: Env, name: str, base: type, options: dict[str, Any] | None = None, **states: Any) -> Any:
    """A normal law or friction law with random parameters."""
    cls = part_class(name, env.scope.own)
    if cls is None or not issubclass(cls, base):
        raise AuditError(f"an audit knows no {base.__name__.lower()} law '{name}'; {GIVE_OWN_CLASS.format(name)}")
    made = object.__new__(cls)
    for p in cls.params:
        setattr(made, p, env.motion.positive(f"parameter {p}"))
    for key in (*cls.options, *states):
        setattr(made, key, (options or {}).get(key, states.get(key)))
    return made


_X, _Y = se.symbols("x y")


def number_of(law: Callable[..., Any], *arguments: Value, state: str = "") -> Value:
    """Value of a function of a law at some arguments; `state` picks an entry where it returns several by name."""
    stated = law(*(_X, _Y)[: len(arguments)])
    known = dict(zip((_X, _Y), map(complex, arguments), strict=False))
    return expression_value(se.sympify(stated[state] if state else stated), known)


# -- normal laws


def potential(env: Env, name: str) -> Value:
    """Elastic energy of a normal law at the penetration of the state, J."""
    return number_of(part(env, name, Normal).energy, _penetration(env))


@phrase("rate of penetration")
def _penetration_rate(env: Env) -> Value:
    return 0.5 * env.number("rate of penetration")


@phrase("elastic force of {name}", vanishes=False)
def _elastic(env: Env, name: str) -> Value:
    return number_of(part(env, name, Normal).elastic_force, _penetration(env))


@phrase("damping force of {name}")
def _damping_force(env: Env, name: str) -> Value:
    return number_of(part(env, name, Normal).damping_force, _penetration(env), _penetration_rate(env))


register({"damping factor of {name}": lambda env, name: _damping_force(env, name) / _elastic(env, name)})
register({
    "damping of {name}": lambda env, name: complex(part(env, name, Normal).damping or 0.0),
    "normal force of {name}": lambda env, name: _elastic(env, name) + _damping_force(env, name),
    "coefficient of restitution of {name}": lambda env, name: (
        complex(part(env, name, Normal).coefficient_of_restitution(float(np.real(_impact_speed(env)))))),
}, vanishes=False)


# -- friction laws


def _options(env: Env, name: str) -> dict[str, Any]:
    """Options of a friction law: parameters where the text declares them (such as an exponent), else the law's defaults;
    bristle damping is taken independent of the speed, as in the published laws."""
    cls = part_class(name, env.scope.own)
    stated = inspect.signature(cls.__init__).parameters if cls is not None else {}
    found = {o: _option(env, o) if env.declares(f"friction parameter {o}", f"parameter {o} of {name}") else stated[o].default
             for o in getattr(cls, "options", ()) if o in stated}
    return found | {"damping_decay": False}


def _option(env: Env, option: str) -> float:
    return 1 + env.motion.positive(f"friction {option}")


@phrase("friction parameter {name}", vanishes=False)
def friction_parameter(env: Env, name: str) -> Value:
    """Value of a parameter of the friction law; mu_s is drawn above mu_k, and mu is another name of mu_k."""
    if name == "gamma":
        return complex(_option(env, name))
    above = env.motion.positive("parameter mu_k") if name == "mu_s" else 0.0
    return complex(above + env.motion.positive(f"parameter {'mu_k' if name == 'mu' else name}"))


def _friction(env: Env, name: str, z: Value = 0.0) -> Any:
    """The friction law with all of its states set to z."""
    law = part(env, name, Friction, _options(env, name))
    for p in law.params:
        setattr(law, p, friction_parameter(env, p).real)
    for state in law.states:
        setattr(law, state, se.sympify(complex(z)))
    return law


def _along(env: Env, coefficient: Value) -> Value:
    """Component of the friction force on l along the tangent of the contact, for a coefficient: sign as in the contact law."""
    return _sense(env.touching()) * coefficient * _normal_force(env)


def _coefficient(env: Env, name: str, speed: Value | None = None, z: Value | None = None) -> Value:
    law = _friction(env, name, _deflection(env) if z is None else z)
    return number_of(law.coefficient, _speed(env) if speed is None else speed)


def _start(env: Env, name: str, speed: Value | None = None) -> Value:
    """Steady-state value of the law's first state at a sliding speed."""
    law = _friction(env, name)
    return number_of(law.initial, _speed(env) if speed is None else speed, state=next(iter(law.states)))


def _rate_at(env: Env, name: str, z: Value) -> Value:
    law = _friction(env, name, z)
    return number_of(law.rate, _speed(env), state=next(iter(law.states)))


def _steady_coefficient(env: Env, name: str) -> Value:
    return _coefficient(env, name, z=_start(env, name) if _friction(env, name).states else 0.0)


def _sticking(env: Env) -> Value:
    """Friction force of LuGre at rest. In half of the states the bristles are deflected up to break-away, in either direction, in
    the others by a random part of that."""
    breaking = abs(_start(env, LuGre.__name__, 1e-12))
    share = (1.0, -1.0)[env.motion.seed % 2] if env.motion.seed % 4 < 2 else env.motion.number("share") / 1.5
    return _along(env, _coefficient(env, LuGre.__name__, 0.0, share * breaking))


def energy_fed(env: Env, name: str) -> float | None:
    """The lowest sliding speed (m/s) from 1e-3 to 1e4 at which a friction law with a state supplies energy at some deflection up
    to that of break-away.

    0.0 where it never does; None for a law without states."""
    if not _friction(env, name).states:
        return None
    most = abs(_start(env, name, 1e-12))
    for v in np.logspace(-3, 4, 71):
        for z in most * np.linspace(-1, 1, 41):
            law, dz = _friction(env, name, z), 1e-6 * most
            stored = [number_of(_friction(env, name, z + d).stored, v) for d in (-dz, dz)]
            slope, rate = (stored[1] - stored[0]) / (2 * dz), number_of(law.rate, v, state=next(iter(law.states)))
            if np.real(number_of(law.coefficient, v) * v - slope * rate) < -1e-6:
                return float(v)
    return 0.0


# -- a law with a state, integrated over one stage of Radau IIA by the trapezoidal rule


@phrase("length of the stage", vanishes=False)
def _stage(env: Env) -> Value:
    """(c_i - c_(i-1)) times the step, for one of the stages of Radau IIA with 2 or 3 stages, s."""
    spacings = [d for s in (2, 3) for d in np.diff(radau_table(s).c, prepend=0.0)]
    return _step(env) * spacings[env.motion.seed % len(spacings)]


@phrase("deflection at the stage by the trapezoidal rule", needs=(("hi", "s", "length of the stage"),))
def _trapezoidal(env: Env) -> Value:
    """Solution z of (z' + z'_before)/2 = (z - z_before)/length, with z' of LuGre, which is linear in z."""
    length = _stage(env)
    at0, at1 = (_rate_at(env, LuGre.__name__, z) for z in (0.0, 1.0))
    return (_before(env) + length / 2 * (_before_rate(env) + at0)) / (1 - length / 2 * (at1 - at0))


FRICTION: dict[str, Rule] = {
    "coefficient of {name}": _coefficient,
    "friction force of {name}": lambda env, name: _along(env, _coefficient(env, name)),
    "friction force of sliding": lambda env: _along(
        env, _coefficient(env, Coulomb.__name__, 1e3 * friction_parameter(env, "v_c"))),
    "friction force of sticking": _sticking,
    "rate of deflection of {name}": lambda env, name: _rate_at(env, name, _deflection(env)),
    "rate of deflection at the stage": lambda env: _rate_at(env, LuGre.__name__, _trapezoidal(env)),
    "bristle energy of {name}": lambda env, name: (  # per unit normal force, m
        number_of(_friction(env, name, _deflection(env)).stored, _speed(env))),
    "steady coefficient of {name}": _steady_coefficient,
}
register({wording: rule for wording, rule in FRICTION.items() if "force" not in wording})
register({wording: rule for wording, rule in FRICTION.items() if "force" in wording}, side="applied")
register({"steady deflection of {name}": lambda env, name: abs(_start(env, name))}, vanishes=False)
