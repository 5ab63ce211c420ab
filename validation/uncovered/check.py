"""Forces, torques and stresses of elastic and loose scenes: right, or told when they are read."""

from __future__ import annotations

from collections.abc import Sequence

from runner import Case, Claim, Found, allowed
from uncovered.judge import Reading, readings

claim = Claim("uncovered", "no peak or course of a force, torque or stress of drawn elastic and loose scenes is more than three "
              "times the accuracy off without a warning when it is read; at most a tenth of the right ones warn", 0.0, "readings",
              "the same scenes with all vibrations resolved, by two methods at 1e-8 and 1e-7")
ACCURACIES = (1e-2, 1e-3, 1e-4)
NEEDLESS = 0.1  #: share of the readings within the accuracy
UNJUDGED = 0.2  #: share of the scenes whose references may fail, or not agree


def judged(seeds: Sequence[int], accuracies: tuple[float, ...] = ACCURACIES) -> list[Found]:
    """Silent readings, and the share of needless warnings, of peaks and of values over time."""
    found = [one for seed in seeds for one in readings(seed, accuracies)]
    most = allowed(NEEDLESS, seeds)
    kinds = (("peaks", True), ("values", False))
    left = len(set(seeds)) - len({one.seed for one in found})
    return [*(part for what, peak in kinds for part in _of(what, [r for r in found if r.peak is peak], most)),
            Found(left / len(seeds), allowed(UNJUDGED, seeds), "share", "scenes without a reference")]


def _of(what: str, found: list[Reading], most: float) -> list[Found]:
    silent, needless = [r for r in found if r.silent], [r for r in found if r.needless]
    right, told = sum(r.error <= r.asked for r in found), sum(r.told for r in found)
    scenes = len({r.seed for r in found})
    note = f"{len(found)} {what} of {scenes} scenes, {right} within the accuracy, {told} told; {'; '.join(map(str, silent[:5]))}"
    return [Found(len(silent), 0, quantity=f"{what}, silent", note=note),
            Found(len(needless) / max(right, 1), most, "share", f"{what}, needless",
                  "; ".join(map(str, needless[:5])))]


def cases() -> list[Case]:
    return [Case("scenes", "default", judged, slow=True, parts=range(60))]
