"""Rules of contact: geometry of a pin in its race, material points, forces of the contact law that runs, normal laws."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.evaluate import STEP, Value, cross, expression_value
from mbdae.audit.laws import LawState, journal, observed, outward, part_class
from mbdae.audit.notation import AuditError
from mbdae.audit.phrases import Env, phrase, random_positive
from mbdae.laws.contact import Normal

# -- the pin in its race: `env.inner` is the body with the pin


def _sides(env: Env) -> str:
    """The bodies with the race and with the pin."""
    return "kl" if env.inner == "l" else "lk"


def _radii(env: Env) -> tuple[float, float]:
    """Radii of race and pin, m."""
    inner = env.motion.positive("radius of the pin")
    return inner + 0.1 * env.motion.positive("clearance"), inner


def _contact(env: Env, rubbing: bool = True) -> LawState:
    return journal(env.motion, _radii(env), _sides(env), rubbing)


@phrase("radius on {side}")
def _radius(env: Env, side: str) -> Value:
    return complex(_radii(env)[side == env.inner])


@phrase("distance of race and pin", vanishes=True)
def _gap(env: Env) -> Value:
    return observed(_contact(env), "gap")


def _outward(env: Env) -> Value:
    return outward(_contact(env))


@phrase("normal direction from k to l")
def _normal(env: Env) -> Value:
    return _outward(env) * (1 if env.inner == "l" else -1)


@phrase("point of contact on {side}", vanishes=True)
def _contact_point(env: Env, side: str) -> Value:
    return env.motion.of("x", side) + _radius(env, side) * _outward(env)


@phrase("{name} as printed in {number}", vanishes=True)
def _as_printed(env: Env, name: str, number: str) -> Value:
    return env.printed(name, number)


# -- material points at the points a text prints


@phrase("material point of {side} at {name} of {number}", vanishes=True)
def _material_point(env: Env, side: str, name: str, number: str) -> Value:
    m, base = env.motion, env.motion.base
    arm = np.real(_printed_at_base(env, name, number)) - np.real(base.of("x", side))
    return m.of("x", side) + m.rotation(side) @ np.real(base.rotation(side)).T @ arm


def _printed_at_base(env: Env, name: str, number: str) -> Value:
    return env.at_base().printed(name, number)


@phrase("velocity of {side} at {name} of {number}", vanishes=True)
def _point_velocity(env: Env, side: str, name: str, number: str) -> Value:
    m, point = env.motion, _printed_at_base(env, name, number)
    return m.of("v", side) + cross(m.of("w", side)) @ (point - m.of("x", side))


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


# -- forces of contact: directions and senses are those of the contact law, points and speeds those of the text

_normal_force = random_positive("normal force")
_mu = random_positive("coefficient of friction")


def rubbing_sense(env: Env) -> float:
    """Sense of the law's friction force on l along the sliding of l over k: -1 if it brakes."""
    at = _contact(env)
    return -float(np.sign(np.real(observed(at, "friction_power")))) or _no_contact()


def _no_contact() -> float:
    raise AuditError("race and pin do not touch in this state")


@phrase("friction force along the sliding", vanishes=True)
def _friction(env: Env) -> Value:
    return rubbing_sense(env) * _mu(env) * _normal_force(env)


def _applied(env: Env, side: str, rubbing: bool) -> Value:
    """Force that the law applies to a body."""
    return -_contact(env, rubbing).force("move", "kl"[_sides(env).index(side)])


def _unit(v: Value) -> Value:
    length = np.sqrt(np.sum(v * v))
    return v / length if np.real(length) > 0 else _no_contact()


@phrase("contact force of the normal force on {side}", vanishes=True, side="open")
def _normal_on(env: Env, side: str) -> Value:
    return _unit(_applied(env, side, rubbing=False)) * _normal_force(env)


@phrase("contact force and moment of friction on {side} at {name}, {name2} of {number}", vanishes=True, side="open")
def _friction_on(env: Env, side: str, k: str, l: str, number: str) -> Value:
    t = _direction(env, k, l, number)
    rubbing = _applied(env, side, rubbing=True) - _applied(env, side, rubbing=False)
    on_l = _applied(env, "l", rubbing=True) - _applied(env, "l", rubbing=False)
    force = t * _friction(env) * np.sign(np.real((rubbing.T @ on_l)[0, 0]))  # action or reaction, as the law has it
    arm = _printed_at_base(env, {"k": k, "l": l}[side], number) - env.motion.of("x", side)
    return np.vstack([force, np.cross(arm, force, axis=0)])


def _virtual(env: Env, side: str, name: str, number: str) -> Value:
    moved = env.moved("virtual")
    return np.imag(_material_point(moved, side, name, number)) / STEP + 0j


@phrase("contact work of the normal force at {name}, {name2} of {number}", vanishes=True, side="open")
def _normal_work(env: Env, k: str, l: str, number: str) -> Value:
    return sum((_normal_on(env, s).T @ _virtual(env, s, p, number))[0, 0] for s, p in (("k", k), ("l", l)))


@phrase("contact work of friction at {name}, {name2} of {number}", vanishes=True, side="open")
def _friction_work(env: Env, k: str, l: str, number: str) -> Value:
    on = {s: _friction_on(env, s, k, l, number)[:3] for s in "kl"}
    return sum((on[s].T @ _virtual(env, s, p, number))[0, 0] for s, p in (("k", k), ("l", l)))


# -- parts of laws: normal laws here, friction laws in `rules_friction`


def part(env: Env, name: str, base: type, options: dict[str, Any] | None = None, **states: Any) -> Any:
    """A normal law or friction law with random parameters."""
    cls = part_class(name, env.scope.own)
    if cls is None or not issubclass(cls, base):
        raise AuditError(f"there is no {base.__name__.lower()} law '{name}'; give your own class with audit(..., laws=...)")
    made = object.__new__(cls)
    for p in cls.params:
        setattr(made, p, env.motion.positive(f"parameter {p}"))
    for key in (*cls.options, *states):
        setattr(made, key, (options or {}).get(key, states.get(key)))
    return made


_X, _Y = se.symbols("x y")


def number_of(law: Callable[..., Any], *arguments: Value, state: str = "") -> Value:
    """A function of a law at some arguments; the entry `state` of what it returns."""
    stated = law(*(_X, _Y)[: len(arguments)])
    known = dict(zip((_X, _Y), map(complex, arguments), strict=False))
    return expression_value(se.sympify(stated[state] if state else stated), known)


_penetration = random_positive("penetration")
_impact_speed = random_positive("impact speed")


@phrase("rate of penetration", vanishes=True)
def _penetration_rate(env: Env) -> Value:
    return 0.5 * env.number("rate of penetration") + 0j


@phrase("damping of {name}")
def _damping(env: Env, name: str) -> Value:
    return complex(part(env, name, Normal).damping or 0.0)


@phrase("elastic force of {name}")
def _elastic(env: Env, name: str) -> Value:
    return number_of(part(env, name, Normal).elastic_force, _penetration(env))


@phrase("damping force of {name}", vanishes=True)
def _damping_force(env: Env, name: str) -> Value:
    return number_of(part(env, name, Normal).damping_force, _penetration(env), _penetration_rate(env))


@phrase("damping factor of {name}", vanishes=True)
def _damping_factor(env: Env, name: str) -> Value:
    return _damping_force(env, name) / _elastic(env, name)


@phrase("normal force of {name}")
def _normal_of(env: Env, name: str) -> Value:
    return _elastic(env, name) + _damping_force(env, name)


@phrase("coefficient of restitution of {name}")
def _restitution(env: Env, name: str) -> Value:
    return complex(part(env, name, Normal).coefficient_of_restitution(float(np.real(_impact_speed(env)))))


def potential(env: Env, name: str) -> Value:
    """Energy of a normal law at the penetration."""
    return number_of(part(env, name, Normal).energy, _penetration(env))
