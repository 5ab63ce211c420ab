"""What follows from a comparison, in sentences: which method for which accuracy at what cost, which runs tie, what the joint
models change, and which methods lose digits of some quantity. Rows and comparisons are those of `table`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

NEAR = 2.0  #: runs compete for an accuracy where their CPU times are within this factor of the least
LOST = 10.0  #: a method loses digits of a quantity where its error is this times that of the middle one, asked for the same


def rivals(rows: Sequence[Any], accuracy: float) -> list[int]:
    """Indices of the runs that reach an accuracy in a CPU time within `NEAR` times the least."""
    known = [(row.cpu_s or 0.0, i) for i, row in enumerate(rows) if reaches(row, accuracy)]
    return [i for cpu, i in known if cpu <= NEAR * min(known)[0]]


def reaches(row: Any, accuracy: float) -> bool:
    """Whether a run that models what the scene states has at most this error."""
    return row.measured is not None and not row.loose and row.measured[0] <= accuracy


def tied(row: Any, best: Any) -> bool:
    """Whether the clock does not tell the CPU times of two runs apart."""
    return (row.cpu_s or 0.0) - (best.cpu_s or 0.0) <= (row.cpu_spread_s or 0.0) + (best.cpu_spread_s or 0.0)


def quartiles(times: Sequence[float]) -> tuple[float, float]:
    """The median of some times and the distance of their quartiles, s."""
    low, middle, high = np.quantile(times, (0.25, 0.5, 0.75))
    return float(middle), float(high - low)


def seconds(value: float | None) -> str:
    """A time in the unit in which it is read: us, ms or s."""
    if value is None:
        return "-"
    for unit, size in (("us", 1e-6), ("ms", 1e-3)):
        if value < 999.5 * size:
            return f"{value / size:.3g} {unit}"
    return f"{value:.3g} s"


def decision(w: Any) -> str:
    """The decision as a paragraph of a few sentences."""
    return " ".join([*_choices(w), *_of_simulate(w), *_models(w), *_digits(w)])


def _choices(w: Any) -> Iterable[str]:
    """For each accuracy the cheapest run; accuracies with the same answer are named together."""
    found: list[tuple[list[float], Any, list[str]]] = []
    for wanted in w.accuracies:
        best = w.cheapest(wanted)
        ties = [] if best is None else list(dict.fromkeys(
            row.label for row in w.runs if reaches(row, wanted) and row.label != best.label and not row.chosen
            and tied(row, best)))
        if found and (found[-1][1] is best if best is None or found[-1][1] is None else found[-1][1].label == best.label):
            found[-1] = ([*found[-1][0], wanted], best, ties)
        else:
            found.append(([wanted], best, ties))
    for many, best, ties in found:
        span = f"{many[0]:.0e}" + (f" to {many[-1]:.0e}" if len(many) > 1 else "")
        if best is None:
            yield f"{span} was reached by no run."
            continue
        cost = f"{seconds(best.cpu_s)} in the solver"
        cost += f", {seconds(best.call_s)} a call" if best.call_s is not None else ""
        last = f" for {many[-1]:.0e}" if len(many) > 1 else ""
        last += f" (asked for {best.accuracy:.0e})" if best.accuracy not in (None, many[-1]) else ""
        yield f"For {span} take {best.label}: {cost}{last}."
        if ties:
            named = ", ".join(ties[:3]) + (f" and {len(ties) - 3} more" if len(ties) > 3 else "")
            clock = f" (it ticks in {seconds(w.tick)})" if w.tick > 1e-4 else ""
            yield f"The clock{clock} does not tell {'it' if len(ties) == 1 else 'them'} from {named}."


def _of_simulate(w: Any) -> Iterable[str]:
    own = [row for row in w.runs if row.chosen and row.measured is not None]
    if own:
        last = own[-1]
        yield f"`simulate` takes {last.solver} {last.form}, {seconds(last.call_s)} a call for {last.accuracy:.0e}."


def _models(w: Any) -> Iterable[str]:
    """What the joint models change, by measure in its unit."""
    others = {row.loose for row in w.runs if row.loose}
    alike = {name: w.models[name] for name in w.models if name not in others}
    if alike:
        worst = {m: max(found.get(m, 0.0) for found in alike.values()) for m in w.units}
        yield f"{_listed(list(alike))} joints agree with the scene as stated to {_amounts(w, worst)}."
    for name in sorted(others & w.models.keys()):
        yield f"{name} changes {_amounts(w, w.models[name], 'the ')}." if w.models[name] else f"What {name} changes is not known."


def _digits(w: Any) -> Iterable[str]:
    """Methods that lose digits of a measure beside the others that were asked for the same, smallest, accuracy."""
    for name in w.units:
        rows = [row for row in w.runs if row.accuracy == min(w.accuracies) and row.errors.get(name) and not row.loose]
        known = w.reference.differences.get(name, 0.0)
        if len(rows) < 3:
            continue
        middle = float(np.median([row.errors[name] for row in rows]))
        lost = [row for row in rows if row.errors[name] > LOST * max(middle, known)]
        for row in sorted(lost, key=lambda row: -row.errors[name])[:1]:
            yield (f"{row.label} loses digits of {name}: {amount(row.errors[name], w.units[name])}, where others have "
                   f"{amount(middle, w.units[name])}.")


def amount(value: float, unit: str) -> str:
    """An error with its unit."""
    return f"{value:.1e}" + (f" {unit}" if unit else "")


def _amounts(w: Any, errors: dict[str, float], article: str = "") -> str:
    by = " by " if article else " in "
    return _listed([f"{article * ('.' not in name)}{name}{by}{amount(errors[name], w.units[name])}" if article else
                    f"{amount(errors[name], w.units[name])}{by}{name}" for name in w.units if name in errors])


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
