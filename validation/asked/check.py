"""Forces that a run is asked for: within the accuracy, or told."""

from __future__ import annotations

from collections.abc import Sequence

from asked.judge import asked
from runner import Case, Claim, Found, allowed

claim = Claim("asked", "no force, torque or stress that a run of a drawn scene was asked for is more than three times the "
              "accuracy off without being told; the estimate is between a third and a hundred times the error in four fifths",
              0.0, "quantities", "the same scenes with all vibrations resolved, by two methods at 1e-8 and 1e-7")
FAR = 0.2  #: share of the estimates that may be farther from the error
MISSED = 0.2  #: share that may miss the accuracy, told
UNJUDGED = 0.4  #: share of the scenes that may have no reference


def judged(seeds: Sequence[int]) -> list[Found]:
    """Silent quantities, those whose estimate is far from the error, and those that miss the accuracy."""
    found = [one for seed in seeds for one in asked(seed)]
    silent, far = [one for one in found if one.silent], [one for one in found if not one.near]
    missed = [one for one in found if one.told]
    count = max(len(found), 1)
    left = len(set(seeds)) - len({one.seed for one in found})
    return [Found(len(silent), 0, quantity="asked, silent", note=f"{len(found)} quantities; {'; '.join(map(str, silent[:5]))}"),
            Found(len(far) / count, allowed(FAR, seeds), "share", "estimates far from the error", "; ".join(map(str, far[:5]))),
            Found(len(missed) / count, allowed(MISSED, seeds), "share", "told to miss", "; ".join(map(str, missed[:5]))),
            Found(left / len(seeds), allowed(UNJUDGED, seeds), "share", "scenes without a reference")]


def cases() -> list[Case]:
    return [Case("scenes", "of=", judged, slow=True, parts=range(200))]
