"""Rules of laws between two bodies: constraint rows c and their forces, which follow from the potential s lambda c + p c^2
(s scaling, p penalty), springs and dampers; strains, stress resultants and energy of laws on a line.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.carried import expression_value
from mbdae.audit.evaluate import STEP, Value
from mbdae.audit.laws import WITH_COORDINATES, LawState, Own, Rule, derived, law_class, part_class, phrase, register
from mbdae.audit.motion import quaternion
from mbdae.audit.notation import GIVE_OWN_CLASS, AuditError
from mbdae.audit.phrases import Env
from mbdae.audit.rules_contact import friction_parameter, potential
from mbdae.errors import MbdaeError
from mbdae.laws.friction import Friction
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.line import LENGTH, WEIGHT, LineDerived, LineLaw, derive_line, make_point
from mbdae.symbolic.part import Part

_ZERO = ("rest",)  #: parameters that are zero unless the text declares them
PARTS = ("move k", "turn k", "move l", "turn l")


def law(env: Env, name: str) -> LawState:
    """The law in the state of env. Where the bodies are joined, a prescribed coordinate has the value it has in the state."""
    cls = law_class(name, env.scope.own)
    part = part_class(name, env.scope.own)
    if cls is None and part is not None:
        kind = "friction" if issubclass(part, Friction) else "normal"
        raise AuditError(f"{name} is a {kind} law, which acts in a contact or a joint: write `{kind} force of {name}` as the "
                         f"meaning")
    if cls is None:
        plain = name.removesuffix(WITH_COORDINATES)
        raise AuditError(f"an audit knows no law '{name}'; {GIVE_OWN_CLASS.format(plain)}")
    if issubclass(cls, LineLaw):
        raise AuditError(f"{name} is a law on a line, as of beams: write the meaning `strains NAMES of {name}` or `energy of "
                         f"{name} per length`")
    if cls.frames != ("k", "l"):
        raise AuditError(f"{name} acts on {', '.join(cls.frames) or 'coordinates alone'}; an audit takes only laws between two "
                         f"bodies, k and l: leave it out")
    declared = env.parameters(name)

    def made() -> LawState:
        given = {p: 0.0 for p in _ZERO if p not in declared}
        given |= {"drive": float(np.real(env.motion.first[0]))} if env.motion.joined else {}
        return LawState(name, env.motion, given, env.scope.own, declared=declared)

    return env.motion.once(("law", name, declared), made)


def names(words: str) -> list[str]:
    """Words that are separated by commas."""
    return [word.strip() for word in words.split(",")]


def _stack(values: list[Value]) -> Value:
    return values[0] if len(values) == 1 else np.vstack([np.reshape(v, (-1, 1)) for v in values])


def _rows(env: Env, of: str, rows: str) -> tuple[LawState, list[str]]:
    """A law and the names of its wanted rows; AuditError for a row that it does not have."""
    state, wanted = law(env, of), names(rows)
    for row in wanted:
        if row not in state.d.rows:
            raise AuditError(f"{of} has no row '{row}'; it has {', '.join(state.d.rows) or 'none'}")
    return state, wanted


@phrase("rows {rows} of {name}", "row {rows} of {name}")
def _row(env: Env, rows: str, of: str) -> Value:
    state, wanted = _rows(env, of, rows)
    return _stack([state.row(row) for row in wanted])


@phrase("multipliers of rows {rows} of {name}", "multiplier of row {rows} of {name}")
def _multiplier(env: Env, rows: str, of: str) -> Value:
    return _stack([env.motion.number(f"multiplier {row}") + 0j for row in _rows(env, of, rows)[1]])


@phrase("parameter {name} of {name2}")
def _parameter(env: Env, parameter: str, of: str) -> Value:
    if parameter == "drive" and env.motion.joined:
        return np.real(env.motion.first[0]) + 0j
    cls = part_class(of, env.scope.own)
    if cls is not None and issubclass(cls, Friction):
        return friction_parameter(env, parameter)
    return env.positive(f"parameter {parameter}")


def unit_of_parameter(parameter: str, of: str, own: Own) -> str:
    """Unit of a parameter of a law, empty where the law leaves it open; AuditError where there is no such law or parameter."""
    cls = part_class(of, own) or law_class(of, own)
    if cls is None:
        raise AuditError(f"an audit knows no law '{of}'; {GIVE_OWN_CLASS.format(of)}")
    if parameter in ("scaling", "penalty") and not issubclass(cls, Part) and derived(of, own).rows:
        return ""
    if parameter in cls.options and isinstance(cls, type) and issubclass(cls, Friction):
        return ""
    if parameter not in cls.params:
        raise AuditError(f"{of} has no parameter '{parameter}'; it has {', '.join(cls.params) or 'none'}")
    return str(cls.params[parameter].unit)


@phrase("coordinate of {name}")
def _coordinate(env: Env, of: str) -> Value:
    cls = law_class(of, env.scope.own)
    if cls is None:
        raise AuditError(f"an audit knows no law '{of}'; {GIVE_OWN_CLASS.format(of)}")
    stated = getattr(cls, "coordinates", {})
    if not stated:
        raise AuditError(f"{of} has no coordinates: name a joint with one angle, such as Revolute")
    if [spec.unit for spec in stated.values()] != ["rad"]:
        has = ", ".join(f"{name} ({spec.unit})" for name, spec in stated.items())
        raise AuditError(f"{of} has not one angle as coordinate, but {has}; write `coordinate NAME of the joint` under `states: "
                         f"{of.lower()}`")
    return env.motion.first[0]


@phrase("coordinate {name} of the joint")
def _coordinate_of_states(env: Env, name: str) -> Value:
    if name not in env.motion.coordinates:
        raise AuditError(f"the states of this section have no coordinate '{name}'; they have "
                         f"{', '.join(env.motion.coordinates) or 'none'}")
    return env.motion.coordinates[name][0]


@phrase("energy of {name}", vanishes=False)
def _energy(env: Env, of: str) -> Value:
    """Potential energy of a law between the bodies, or of a normal law at the penetration of the state, J."""
    return potential(env, of) if part_class(of, env.scope.own) else law(env, of).number(law(env, of).d.energy)


@phrase("force of rows {rows} of {name} on {parts}", "force of row {rows} of {name} on {parts}", side="left")
def _row_force(env: Env, rows: str, of: str, parts: str) -> Value:
    """Generalised force G' (s lambda + 2 p c) on the listed parts; on parts the text does not list it must vanish."""
    state, wanted = _rows(env, of, rows)

    def on(part: str) -> Value:
        what, side = part.split()
        return sum(state.row_gradient(row, what, side) * state.row_force(row) for row in wanted)

    return _listed(env, parts, on)


@phrase("force of {name} on {parts}", side="left")
def _law_force(env: Env, of: str, parts: str) -> Value:
    """Generalised force of a law on the listed parts: the gradient of its energy or Rayleigh function, which stands on the
    left-hand side of the equations of motion."""
    state = law(env, of)
    return _listed(env, parts, lambda part: state.force(*part.split()))


class UnlistedError(MbdaeError):
    """A force acts on a part of a body that the text does not list."""

    def __init__(self, part: str) -> None:
        self.part = part
        super().__init__(f"there is a force on {part} too, which the text does not list: the formula or the list is incomplete")


def _listed(env: Env, parts: str, on: Callable[[str], Value]) -> Value:
    wanted = names(parts)
    for part in sorted(set(wanted) - set(PARTS)):
        raise AuditError(f"'{part}' is nothing that a force acts on: write some of {', '.join(PARTS)}")
    for part in PARTS if env.complete is not None else ():
        if part not in {*wanted, *(env.complete or ())} and np.max(np.abs(on(part))) > 1e-12:
            raise UnlistedError(part)
    return _stack([on(part) for part in wanted])


@phrase("virtual work of rows {rows} of {name}")
def _row_work(env: Env, rows: str, of: str) -> Value:
    """Sum over the rows of generalised force times virtual change of the row."""
    state, wanted = _rows(env, of, rows)
    moved = env.motion.moved("virtual")
    displacements = {(what, side): np.imag(moved.of("x", side)) / STEP if what == "move" else env.motion.turn_between(moved, side)
                     for what in ("move", "turn") for side in "kl"}
    return sum(state.row_force(row) * (state.row_gradient(row, *at).T @ displacement)[0, 0]
               for row in wanted for at, displacement in displacements.items())


register({
    "opposite of row {rows} of {name}": lambda env, rows, of: -_row(env, rows, of),  # its multiplier changes sign too
    "dissipated power of {name}": lambda env, of: law(env, of).number(law(env, of).d.dissipated_power),
    "applied force of {name} on {parts}": lambda env, of, parts: -_law_force(env, of, parts),
})


# -- laws on a line (beams), evaluated at the section


def _numbers(env: Env, of: str, stated: Callable[[LineDerived, Any], dict[str, Any]], wanted: str) -> Value:
    """Values of named quantities that a law on a line states at the section."""
    cls: Any = law_class(of, env.scope.own)
    if cls is None or not issubclass(cls, LineLaw):
        raise AuditError(f"an audit knows no law on a line, as of beams, with the name '{of}'; {GIVE_OWN_CLASS.format(of)}")
    structure = Structure(absent=frozenset({"damping"} & set(cls.params)))
    line, stated_law = derive_line(cls, structure, NodeKind.SPATIAL), cls.symbolic(structure)
    values = env.motion.once(("line", cls), lambda: _point(env, stated_law))
    known = stated(line, stated_law)
    for name in names(wanted):
        if name not in known:
            raise AuditError(f"{of} has no strain or force '{name}' at its section; it has {', '.join(known)}")
    return _stack([expression_value(se.sympify(known[n]), values) for n in names(wanted)])


def _point(env: Env, law: Any) -> dict[Any, Any]:
    """Values of the symbols at a point of a line in the state of the section, with ds/dxi = 1 and random positive parameters."""
    r, Q = env.motion.section()
    r_s = env.changes("line", lambda e: e.motion.section()[0])
    P, K = quaternion(Q), env.of("curvature of the section")
    slope = np.vstack([-K.T @ P[1:], P[0, 0] * K + np.cross(K, P[1:], axis=0)]) / 2
    places = ["r1", "r2", "r3", "P1", "P2", "P3", "P4"]
    numbers = dict(zip(places, np.vstack([r, P])[:, 0], strict=True))
    numbers |= dict(zip([n + "_xi" for n in places], np.vstack([r_s, slope])[:, 0], strict=True))
    v, spin = (env.changes("time", lambda e: e.motion.section()[0]), Q.T @ env.of("angular velocity of the section"))
    numbers |= {f"u{i + 1}": x for i, x in enumerate(np.vstack([v, spin])[:, 0])}
    numbers |= {p: env.motion.positive(f"parameter {p}") for p in law.params}
    return {se.Symbol(n): complex(x) for n, x in numbers.items()} | {LENGTH: 1 + 0j, WEIGHT: 1 + 0j}


STRAINS: dict[str, Rule] = dict.fromkeys(["strains {names} of {name2}", "strain {names} of {name2}"], lambda env, wanted, of: (
    _numbers(env, of, lambda _, law: law.strains(make_point(NodeKind.SPATIAL)), wanted)))
register(STRAINS | {
    "stress resultants {names} of {name2}": lambda env, wanted, of: (
        _numbers(env, of, lambda line, _: dict(line.resultants), wanted))})
register({
    "energy of {name} per length": lambda env, of: _numbers(env, of, lambda line, _: {"energy": line.energy}, "energy"),
    "kinetic energy of {name} per length": lambda env, of: (
        _numbers(env, of, lambda _, law: {"energy": law.kinetic_energy(make_point(NodeKind.SPATIAL))}, "energy")),
}, vanishes=False)
