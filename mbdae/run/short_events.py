"""Whether something in a scene may act for a time, or over a distance, that is short compared with a step: a short event."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import symengine as se

from mbdae.inputs.timed import TIME
from mbdae.kernels import plan
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.outputs import loads, position
from mbdae.system.assembled.right_hand_side import state_rate_outputs
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem

#: outputs of laws whose expressions are searched for steep functions: forces, constraint rows, rates of internal states
STATED = (loads, position, state_rate_outputs)
#: functions that are not steep: those of angles, which are in nearly every law; UnevaluatedExpr only marks a bracket
OF_ROTATIONS = ("sin", "cos", "UnevaluatedExpr")


def may_have_short_events(prepared: Prepared, system: SceneSystem) -> bool:
    """Whether a scene has inputs of time that do not bound the steps (other than constant, uniform and uniformly accelerated
    ones), or laws with functions that switch or are steep somewhere (other than contacts, whose gaps solvers watch)."""
    return _inputs(prepared, system) or _laws(prepared)


def _inputs(prepared: Prepared, system: SceneSystem) -> bool:
    if system.timeline is not None:
        return False  # no step is longer than the time scale of an input, and steps end at all breaks
    inputs = prepared.mechanics.numbering.clock.expressions
    return any(se.diff(se.diff(se.diff(se.sympify(e), TIME), TIME), TIME) != 0 for e in inputs)


def _laws(prepared: Prepared) -> bool:
    watched = {contact.place[0] for contact in prepared.contacts}
    return any(_switches(group.derived) for g, group in enumerate(prepared.model.groups) if g not in watched)


@lru_cache(maxsize=512)
def _switches(derived: Derived) -> bool:
    """Whether a law contains a steep function."""
    return bool(derived.noted("short_events.steep", lambda: any(
        _steep(e) for outputs in STATED for e in _subexpressions(plan(derived, outputs).kernel.expressions))))  # fmt: skip


def _subexpressions(expressions: Sequence[Any]) -> Iterator[Any]:
    """Every subexpression that is not a symbol or a number, once."""
    left, seen = [se.sympify(e) for e in expressions], set()
    while left:
        e = left.pop()
        if e.args and e not in seen:
            seen.add(e)
            left.extend(e.args)
            yield e


def _steep(e: Any) -> bool:
    """Whether a subexpression may be steep: a function other than sine and cosine, a power with a symbol in the exponent
    (symengine's exp is a power of e), or a negative power of a sum with a constant, such as 1 / (1 + x^2). Powers
    of distances are not steep in this sense."""
    if isinstance(e, se.Function):
        return type(e).__name__ not in OF_ROTATIONS
    if not isinstance(e, se.Pow):
        return False
    base, exponent = e.args
    falls = exponent.is_Integer and exponent.is_negative and base.is_Add
    return bool(exponent.free_symbols or (falls and any(term.is_Number for term in base.args)))
