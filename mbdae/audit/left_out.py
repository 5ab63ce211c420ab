"""Parameters of laws that a text does not declare: those without effect at zero, and those for which a law refuses zero."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from mbdae.audit.compare import States, compared, vanishing
from mbdae.audit.laws import WITH_COORDINATES, Own, law_class, part_class
from mbdae.audit.phrases import PARAMETER, Meaning
from mbdae.audit.reading import Printed
from mbdae.errors import MbdaeError
from mbdae.symbolic.line import LineLaw
from mbdae.symbolic.part import Part

#: parameters of every constraint row, with the values at which the force of the row is its multiplier lambda
OF_ROWS = {"scaling": 1.0, "penalty": 0.0}


def refuses_zero(parameter: str, of: str, own: Own = ()) -> bool:
    """Whether the law named `of` accepts 1 but not 0 as a value of a parameter. own: the user's laws."""
    cls: Any = part_class(of, own) or law_class(of, own)

    def taken(value: float) -> bool:
        head = () if issubclass(cls, Part) else ("audited", None, None)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                cls(*head, **dict.fromkeys(cls.params, 1.0) | {parameter: value})
            except (MbdaeError, TypeError):
                return False
        return True

    return cls is not None and parameter in cls.params and taken(1.0) and not taken(0.0)


def may_vanish(meaning: Meaning, own: Own) -> bool:
    """Whether a quantity may be zero in a state that the text speaks of."""
    parameter = PARAMETER.match(meaning.text)
    return meaning.phrase.vanishes and not (parameter and refuses_zero(parameter[1], parameter[2], own))


def left_out(equation: Printed, states: States, laws: set[str]) -> Mapping[str, float]:
    """The smallest set of parameters ("damping of PointSpring") that the text declares nowhere and without whose effect both
    sides agree, each with the value at which it has no effect; empty if none. A set with
    which a quantity of the text vanishes does not count, since the agreement then says nothing.

    laws: words of the meanings, among them the names of laws."""
    open_ = _open(equation, laws)

    def agree(values: Mapping[str, float]) -> bool:
        found = replace(states, neutral=tuple((n.partition(" of ")[0], v) for n, v in values.items()))
        return all(compared(s, found).same for s in equation.statements) and not vanishing(equation.used, states, found)

    if open_ and agree(open_):
        for name in list(open_):
            fewer = {n: v for n, v in open_.items() if n != name}
            open_ = fewer if fewer and agree(fewer) else open_
        return open_
    return next(({n: v} for n, v in open_.items() if agree({n: v})), {})


def _open(equation: Printed, laws: set[str]) -> dict[str, float]:
    """Parameters that the text declares for no law, each with the value at which it has no effect."""
    own = equation.scope.own
    declared = {match[1] for text in equation.scope.texts if (match := PARAMETER.match(text))}
    found: dict[str, float] = {}
    for name in sorted(laws):
        cls = part_class(name, own) or law_class(name, own)
        if cls is None or issubclass(cls, LineLaw):
            continue
        plain = name.removesuffix(WITH_COORDINATES)
        values = {p: 0.0 for p in cls.params if not refuses_zero(p, plain, own)} | ({} if issubclass(cls, Part) else OF_ROWS)
        found |= {f"{p} of {plain}": value for p, value in values.items() if p not in declared}
    return found
