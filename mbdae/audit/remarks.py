"""Remarks to a verdict: other solutions, resultants away from the joint, tensile contact, energy gain, redefined letters."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from mbdae.audit.compare import SAME, States
from mbdae.audit.evaluate import NO_VALUE, Value, evaluate
from mbdae.audit.motion import turned
from mbdae.audit.notation import Node, Statement
from mbdae.audit.phrases import Env, Meaning
from mbdae.audit.reading import Printed
from mbdae.audit.rules_contact import energy_fed
from mbdae.audit.rules_laws import names

#: rad; a constraint has a second solution if it still holds after l is turned about one of its axes by HALF, but not by SOME
HALF, SOME = np.pi, 0.4
FAST = -100.0  #: rate of penetration of bodies that separate fast, m/s


def remarks(equation: Printed, states: States) -> list[str]:
    """Remarks on a formula that is right as it is printed."""
    try:
        found = [r for rule in (_solutions, _balance, _pull, _energy) for r in rule(equation, states)]
    except NO_VALUE:
        found = []
    return found + [f"{n} meant something else before: {was}" for n, was in sorted(equation.before.items())
                    if n in equation.used]  # fmt: skip


# -- other solutions of a constraint


def _solutions(equation: Printed, states: States) -> Iterator[str]:
    """Remark on a constraint that also holds where l is turned by half a turn about one of its axes, but not by less."""
    sides = [s.subject for s in equation.statements if s.ends_at_zero]
    if not sides or equation.states == "free":
        return
    meaning = equation.scope.symbols.get(str(sides[0]))
    stated = equation.statements[0].compared
    judged = stated[1] if meaning and len(stated) > 1 else sides[0]
    axes = [i + 1 for i in range(3) if _size(judged, states, i, HALF) < SAME < _size(judged, states, i, SOME)]
    if axes:
        about = ", ".join(map(str, axes))
        yield f"vanishes too where l is turned by half a turn about its axis {about}, which the text does not exclude"


def _size(side: Node, states: States, axis: int, angle: float) -> float:
    """Largest value of a side in states of the joint after a turn of l about one of its axes."""
    worst = 0.0
    for env in states.joint[:2]:
        motion = copy(env.motion)
        motion.memory = {"l": {**env.motion._l(), "Q": env.motion.rotation("l") @ turned(angle * np.eye(3)[:, [axis]])}}
        worst = max(worst, float(np.max(np.abs(evaluate(side, replace(env, motion=motion, store={}))))))
    return worst


# -- forces


def _balance(equation: Printed, states: States) -> Iterator[str]:
    """Remark on forces on both bodies whose resultant is zero only where the joint connects the bodies."""
    for statement in equation.statements:
        meaning = equation.scope.symbols.get(str(statement.sides[0]))
        if meaning and meaning.phrase.side == "left" and not equation.only:
            parts = names(meaning.words[-1])
            if {p.split()[1] for p in parts} == {"k", "l"} and _resultant(statement, parts, states.free[0]) > 1e-6:
                yield "action and reaction leave a resultant where the bodies are not joined exactly"


def _resultant(statement: Statement, parts: list[str], env: Env) -> float:
    values = np.split(np.real(evaluate(statement.sides[-1], env)), len(parts))
    on = dict(zip(parts, values, strict=True))
    force = sum((v for p, v in on.items() if p.startswith("move")), np.zeros((3, 1)))
    arms = {p: np.real(env.motion.of("x", p.split()[1])) for p in on}
    moment = sum((v if p.startswith("turn") else np.cross(arms[p], v, axis=0) for p, v in on.items()), np.zeros((3, 1)))
    return float(max(np.max(np.abs(force)), np.max(np.abs(moment))))


def _of(equation: Printed, wording: str) -> Iterator[tuple[Statement, Meaning]]:
    """Statements whose first side is a symbol with that kind of meaning, and the meaning."""
    for statement in equation.statements:
        meaning = equation.scope.symbols.get(str(statement.sides[0]))
        if meaning and meaning.phrase.wording == wording:
            yield statement, meaning


def _pull(equation: Printed, states: States) -> Iterator[str]:
    """Remark on a normal force that becomes tensile where bodies separate fast."""
    for wording in ("normal force of {name}", "damping force of {name}"):
        for statement, meaning in _of(equation, wording):
            fast = replace(states.free[0], shifts=(("rate of penetration", 0, FAST),), store={})
            elastic: Value = fast.of(f"elastic force of {meaning.words[0]}") if wording.startswith("damping") else 0.0
            if np.real(evaluate(statement.sides[1], fast) + elastic) < 0:
                yield "pulls where the bodies separate fast: contact has to end where the force falls to 0"


def _energy(equation: Printed, states: States) -> Iterator[str]:
    """Remark on a friction law with an internal state that may supply energy."""
    for wording, varying in (("coefficient of {name}", False), ("friction force of {name}", True)):
        for _, meaning in _of(equation, wording):
            found: Any = energy_fed(states.free[0], meaning.words[0])
            if found is None:
                continue
            if varying:
                yield "the energy stored in the deflection grows with the normal force: dissipative only for a constant one"
            elif found > 0:
                yield f"feeds energy above a sliding speed, here {found:.3g} m/s"
