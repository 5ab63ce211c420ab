"""Rules of joints: rows of a law, their forces by the virtual work of s lambda c + p c^2, springs and dampers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbdae.audit.evaluate import STEP, Value
from mbdae.audit.laws import WITH_COORDINATES, LawState, Own, derived, law_class, part_class
from mbdae.audit.notation import AuditError
from mbdae.audit.phrases import Env, phrase
from mbdae.audit.rules_contact import potential
from mbdae.audit.rules_friction import friction_parameter
from mbdae.errors import MbdaeError
from mbdae.laws.friction import Friction
from mbdae.symbolic.line import LineLaw
from mbdae.symbolic.part import Part

_ZERO = ("rest",)  #: parameters that are zero where the text does not declare them
PARTS = ("move k", "turn k", "move l", "turn l")


def law(env: Env, name: str) -> LawState:
    """A law in the state of env; where the bodies are joined, a prescribed angle is the relative angle of the state."""
    cls = law_class(name, env.scope.own)
    if cls is None:
        plain = name.removesuffix(WITH_COORDINATES)
        raise AuditError(f"there is no law '{name}'; give your own class with audit(..., laws={{'{plain}': {plain}}})")
    if issubclass(cls, LineLaw):
        raise AuditError(f"{name} is a law on a line: say `strains NAMES of {name}` or `energy of {name} per length`")
    if cls.frames != ("k", "l"):
        raise AuditError(f"{name} acts on {', '.join(cls.frames) or 'coordinates alone'}; an audit knows two bodies, k and l")
    declared = env.parameters(name)
    key = ("law", name, declared)
    if key not in env.motion.memory:
        given = {p: 0.0 for p in _ZERO if p not in declared}
        given |= {"drive": float(np.real(env.motion.phi))} if env.motion.joined else {}
        env.motion.memory[key] = LawState(name, env.motion, given, env.scope.own, declared=declared)
    found: LawState = env.motion.memory[key]
    return found


def names(words: str) -> list[str]:
    """Words that are separated by commas."""
    return [word.strip() for word in words.split(",")]


def _stack(values: list[Value]) -> Value:
    return values[0] if len(values) == 1 else np.vstack([np.reshape(v, (-1, 1)) for v in values])


def _rows(env: Env, of: str, rows: str) -> tuple[LawState, list[str]]:
    """A law and its rows by name; AuditError for a row that it does not have."""
    state, wanted = law(env, of), names(rows)
    for row in wanted:
        if row not in state.d.rows:
            raise AuditError(f"{of} has no row '{row}'; it has {', '.join(state.d.rows)}")
    return state, wanted


@phrase("rows {rows} of {name}", vanishes=True)
@phrase("row {rows} of {name}", vanishes=True)
def _row(env: Env, rows: str, of: str) -> Value:
    state, wanted = _rows(env, of, rows)
    return _stack([state.row(row) for row in wanted])


@phrase("opposite of row {rows} of {name}", vanishes=True)
def _opposite_row(env: Env, rows: str, of: str) -> Value:
    """The same constraint with the other sign, and so with the opposite multiplier."""
    return -_row(env, rows, of)


@phrase("multipliers of rows {rows} of {name}", vanishes=True)
@phrase("multiplier of row {rows} of {name}", vanishes=True)
def _multiplier(env: Env, rows: str, of: str) -> Value:
    wanted = _rows(env, of, rows)[1]
    return _stack([env.motion.number(f"multiplier {row}") + 0j for row in wanted])


@phrase("parameter {name} of {name2}", vanishes=True)
def _parameter(env: Env, parameter: str, of: str) -> Value:
    if parameter == "drive" and env.motion.joined:
        return np.real(env.motion.phi) + 0j
    cls = part_class(of, env.scope.own)
    if cls is not None and issubclass(cls, Friction):
        return friction_parameter(env, parameter)
    return env.positive(f"parameter {parameter}") + 0j


def unit_of_parameter(parameter: str, of: str, own: Own) -> str:
    """The unit of a parameter of a law or part, empty where the law leaves it open; AuditError where there is none."""
    cls = part_class(of, own) or law_class(of, own)
    if cls is None:
        raise AuditError(f"there is no law '{of}'; give your own class with audit(..., laws={{'{of}': {of}}})")
    if parameter in ("scaling", "penalty") and not issubclass(cls, Part) and derived(of, own).rows:
        return ""
    if parameter not in cls.params:
        raise AuditError(f"{of} has no parameter '{parameter}'; it has {', '.join(cls.params) or 'none'}")
    return str(cls.params[parameter].unit)


@phrase("coordinate of {name}", vanishes=True)
def _coordinate(env: Env, of: str) -> Value:
    cls = law_class(of, env.scope.own)
    stated = getattr(cls, "coordinates", {})
    if [spec.unit for spec in stated.values()] != ["rad"]:
        has = ", ".join(f"{name} ({spec.unit})" for name, spec in stated.items()) or "none"
        raise AuditError(f"the coordinates of {of}: {has}; say `coordinate NAME of the joint` in states of that joint")
    return env.motion.phi


@phrase("coordinate {name} of the joint", vanishes=True)
def _coordinate_of_states(env: Env, name: str) -> Value:
    """A coordinate of the joint that the states of the section are those of."""
    if name not in env.motion.coordinates:
        raise AuditError(f"the states have no coordinate '{name}' but {', '.join(env.motion.coordinates)}")
    return env.motion.coordinates[name][0]


@phrase("energy of {name}")
def _energy(env: Env, of: str) -> Value:
    """Potential energy of a law between the bodies, or of a normal law at the penetration."""
    if part_class(of, env.scope.own):
        return potential(env, of)
    return law(env, of).number(law(env, of).d.energy)


@phrase("dissipated power of {name}", vanishes=True)
def _dissipated(env: Env, of: str) -> Value:
    return law(env, of).number(law(env, of).d.dissipated_power)


@phrase("force of rows {rows} of {name} on {parts}", vanishes=True, side="left")
@phrase("force of row {rows} of {name} on {parts}", vanishes=True, side="left")
def _row_force(env: Env, rows: str, of: str, parts: str) -> Value:
    """G' (s lambda + 2 p c); on parts the text does not list it must vanish."""
    state, wanted = _rows(env, of, rows)

    def on(part: str) -> Value:
        what, side = part.split()
        return sum(state.row_gradient(row, what, side) * state.row_force(row) for row in wanted)

    return _listed(env, parts, on)


@phrase("force of {name} on {parts}", vanishes=True, side="left")
def _law_force(env: Env, of: str, parts: str) -> Value:
    """Gradient of a law's energy or of its Rayleigh function, as it stands on the left-hand side."""
    state = law(env, of)
    return _listed(env, parts, lambda part: state.force(*part.split()))


@phrase("applied force of {name} on {parts}", vanishes=True)
def _applied_force(env: Env, of: str, parts: str) -> Value:
    return -_law_force(env, of, parts)


class UnlistedError(MbdaeError):
    """A force acts where the text lists none."""


def _listed(env: Env, parts: str, on: Callable[[str], Value]) -> Value:
    wanted = names(parts)
    unknown = sorted(set(wanted) - set(PARTS))
    if unknown:
        raise AuditError(f"a force acts on {', '.join(PARTS)}, not on '{unknown[0]}'")
    for part in PARTS if env.complete else ():
        if part not in wanted and np.max(np.abs(on(part))) > 1e-12:
            raise UnlistedError(f"there is a force on {part} too")
    return _stack([on(part) for part in wanted])


@phrase("virtual work of rows {rows} of {name}", vanishes=True)
def _row_work(env: Env, rows: str, of: str) -> Value:
    """Sum over the rows: force times virtual change of the row."""
    state, wanted = _rows(env, of, rows)
    moved = env.motion.moved("virtual")
    total = 0j
    for row in wanted:
        change = 0j
        for side in "kl":
            move = np.imag(moved.of("x", side)) / STEP
            turn = env.motion.turn_between(moved, side)
            for what, displacement in (("move", move), ("turn", turn)):
                change += (state.row_gradient(row, what, side).T @ displacement)[0, 0]
        total += state.row_force(row) * change
    return total
