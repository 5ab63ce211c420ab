"""Derivatives through contacts beside those of the same mechanism by its own equations."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from derivatives_contact.scenes import MECHANISMS, Mechanism
from runner import Found

import mbdae as mb

ACCURACIES, SOLVERS, TIMES, IMPACTS = (1e-6, 1e-8), (None, mb.DOP853()), 15, 5
SAID = re.compile("grazed|sequence of contacts")


@dataclass
class Counts:
    """Derivatives by verdict, and errors over what is off."""

    right: int = 0
    wrong: list[str] = field(default_factory=list)
    uncovered: list[str] = field(default_factory=list)
    told: list[str] = field(default_factory=list)
    wide: list[float] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    worst: float = 0.0


def times_of(one: Mechanism, p: Any) -> Any:
    """Output times (k,), up to the middle between the fifth impact and the sixth."""
    end = one.end(p)
    closes = [t for t, closed in one.own.run(p, [next(iter(one.names))], [end], 1e-9)[2] if closed]
    if len(closes) > IMPACTS:
        end = (closes[IMPACTS - 1] + closes[IMPACTS]) / 2
    return np.linspace(0.0, end, TIMES + 1)


def compare(one: Mechanism, seed: int, counts: Counts) -> None:
    """One drawn mechanism, at one accuracy and by one method."""
    p = one.drawn(np.random.default_rng([seed, 48]))
    accuracy, solver, times = ACCURACIES[seed % 2], SOLVERS[seed // 2 % 2], times_of(one, p)
    (y, S, _), *others = (one.own.run(p, list(one.names), times[1:], rtol) for rtol in (1e-13, 1e-12, 1e-11))
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        run = one.build(p).simulate(float(times[-1]), accuracy, outputs=times, solver=solver)
        found = run.sensitivity(*one.read, to=list(one.names.values()))
    if said := [str(warning.message) for warning in heard if SAID.search(str(warning.message))]:
        counts.told.append(f"{seed}: {said[0]}")
        return
    for sensor, place in one.read.items():
        for k, (own, name) in enumerate(one.names.items()):
            exact, derivative = S[:, place, k], found[sensor, name]
            size, noise = float(np.abs(exact).max()), max(float(np.abs(exact - at[1][:, place, k]).max()) for at in others)
            if size * p[own] <= 1e-9 * np.abs(y[:, place]).max():
                continue  # nothing of the motion changes with this number
            off = max(float(np.abs(derivative.value[1:] - exact).max()) - noise, 0.0)
            text = (f"{seed} {sensor} by {name} (off {off / size:.1e}, error {derivative.error / size:.1e}, "
                    f"noise {noise / size:.0e})")
            bar = one.most * (accuracy / ACCURACIES[-1])
            counts.worst = max(counts.worst, off / size)
            if off > 3 * derivative.error or off > bar * size:
                counts.wrong.append(text)
            else:
                counts.right += 1
            if off > derivative.error:
                counts.uncovered.append(text)
            elif off > noise:
                counts.wide.append(derivative.error / off)


def judge(drawn: Sequence[str]) -> list[Found]:
    """Drawn mechanisms, each its kind and its seed ("two balls 7"). The width of errors is their median over all of them: of the
    derivatives of one it is anything from 1 to 200."""
    counts = Counts()
    for name in drawn:
        which, seed = name.rsplit(" ", 1)
        try:
            compare(MECHANISMS[which], int(seed), counts)
        except Exception as error:  # whatever it is: the others are judged
            counts.failed.append(f"{name}: {type(error).__name__}: {error}")
    compared = counts.right + len(counts.wrong)
    return [Found(len(counts.wrong), 0, "derivatives", "wrong", note=f"{counts.right} right, the least exact within "
                  f"{counts.worst:.1e}; {len(counts.told)} mechanisms told: {' | '.join(counts.told)}; wrong: "
                  f"{', '.join(counts.wrong) or 'none'}"),
            Found(len(counts.uncovered), max(0.01 * compared, 1), "derivatives", "errors that do not cover",
                  note=", ".join(counts.uncovered)),
            Found(len(counts.failed), 0, "mechanisms", "failed", note=" | ".join(counts.failed)),
            Found(float(np.median(counts.wide)) if counts.wide else 0.0, 50, "errors", "median of errors over what is off")]
