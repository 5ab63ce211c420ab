"""Limits of a joint's coordinates with their stops, read from what users give."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from mbdae.scene.components import Clearance, JointModel, Stop
from mbdae.scene.reading import FEEDS, Argument, Reader, quantity
from mbdae.symbolic.joint import Joint
from mbdae.values import BadValueError, entries, number, shown

GIVE_A_STOP = "give stop=mb.Stop(stiffness, damping)"
Limits = tuple[float | None, float | None]  #: lowest and highest value, None where there is none


def limits(unit: str) -> Reader:
    """Reader of a pair (lowest, highest); None or an infinite number: no limit on that side. Returns None for a wrong value."""
    give_a_pair = f"give a pair (lowest, highest), {unit}; None for a side without limit"

    def read(arg: Argument, value: Any) -> Limits | None:
        try:
            found = entries(value)
            if found.shape != (2,):
                raise BadValueError(f"{shown(value)} is no pair of limits")
            low, high = _one(found[0], -math.inf), _one(found[1], math.inf)
        except BadValueError as reason:
            names_value = str(reason).startswith(shown(value))
            arg.wrong(reason if names_value else f"{shown(value)} has a wrong entry, {reason}", give_a_pair)
            return None
        if low is None and high is None:
            arg.wrong(shown(value), "it limits nothing; give a number, or omit limits and stop")
            return None
        if low is not None and high is not None and low >= high:
            arg.wrong(f"{shown(value)}: the lower limit is not below the upper one", give_a_pair)
            return None
        return low, high

    return read


def _one(value: Any, without: float) -> float | None:
    """A limit as a number; None for no limit, which the user states by None or by the infinite number `without`."""
    if value is None:
        return None
    try:
        if value == without:
            return None
    except Exception:  # a comparison of the user's own may raise anything; `number` says what is wrong with the value
        pass
    return number(value)


def stop(stiffness: str, damping: str) -> Reader:
    """Reader of an mb.Stop with numbers in these units; returns None for a wrong value."""

    def read(arg: Argument, value: Any) -> Stop | None:
        if not isinstance(value, Stop):
            arg.wrong(f"{shown(value)} is no stop", GIVE_A_STOP)
            return None
        before = len(arg.scene.problems)
        quantity(stiffness, "positive")(arg.part(f"{arg.option}.stiffness"), value.stiffness)
        quantity(damping, "not negative", FEEDS)(arg.part(f"{arg.option}.damping"), value.damping)
        return value if len(arg.scene.problems) == before else None

    return read


def for_each_limit(law: type[Joint], given: Any, limited: Any) -> Any:
    """One stop given once becomes that of every coordinate with limits, by coordinate; anything else is returned unchanged."""
    if isinstance(given, Mapping) or given is None or not isinstance(limited, Mapping):
        return given
    return {c: given for c, value in limited.items() if c in law.coordinates and value is not None} or given


def pairs_of(found: Mapping[str, Mapping[str, Any]], law: type[Joint]) -> dict[str, tuple[Limits, Stop]]:
    """Limits and stop by coordinate, where both can be used."""
    both = ((c, found.get("limits", {}).get(c), found.get("stop", {}).get(c)) for c in law.coordinates)
    return {c: (pair, stop) for c, pair, stop in both if pair is not None and stop is not None}


def mistakes(found: Mapping[str, Mapping[str, Any]], law: type[Joint], words: Mapping[str, str],
             model: JointModel | None) -> list[str]:  # fmt: skip
    """Mistakes in the combination of limits, stops and joint model, one sentence each; single values are checked by `limits` and
    `stop`. found: values by option and coordinate; words: name of an option in the statement, where it differs."""
    limited, stops = found.get("limits", {}), found.get("stop", {})
    wrong = [f"limits = {_written(limited[c], law, c)} have no stop; {GIVE_A_STOP}" for c in limited if c not in stops]
    wrong += [f"stop = {shown(stops[c])} does nothing without limits of its {c}; give limits=(lowest, highest), or omit it"
              for c in stops if c not in limited]  # fmt: skip
    for c in limited:
        if limited[c] is None:
            continue
        if c in found.get("prescribed", {}):
            wrong.append(f"limits = {_written(limited[c], law, c)}: its {c} is prescribed, so that no stop can hold it; omit "
                         f"limits and stop")  # fmt: skip
            continue
        start = found.get("start", {}).get(c)
        if start is not None and not _inside(start, limited[c]):
            wrong.append(f"{words.get('start', 'start')} = {start:g} {law.coordinates[c].unit} is outside limits = "
                         f"{_written(limited[c], law, c)}; start between them")  # fmt: skip
    if limited and isinstance(model, Clearance):
        wrong.append("limits of a joint with clearance are not modelled; omit them, or use model=mb.Kinematic()")
    return wrong


def _inside(value: float, pair: Limits) -> bool:
    low, high = pair
    return (low is None or value >= low) and (high is None or value <= high)


def _written(pair: Limits | None, law: type[Joint], c: str) -> str:
    if pair is None:
        return "those given"
    low, high = ("none" if value is None else f"{value:g}" for value in pair)
    return f"({low}, {high}) {law.coordinates[c].unit}"
