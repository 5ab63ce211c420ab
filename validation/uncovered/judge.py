"""What is read of a drawn run against a reference: right, told, silent, needless."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from uncovered.draw import Drawn, drawn

import mbdae as mb
from mbdae.results.quantities import magnitudes

SILENT = 3.0  #: a number that is more than so many times the accuracy off has to be told
WALL = 300.0  #: of a run, s; ten times what the dearest took alone on a processor
AGREE = 0.3  #: references that differ by more than this part of the accuracy do not judge
TIMES = 1001  #: at which values over time are compared


@dataclass(frozen=True)
class Reading:
    """A quantity that was read of a run: error and estimate over its size, what was asked, and whether the reader was told;
    peak: the largest magnitude alone, else its values over time; doubted: whether the run says of itself that its motion is not
    within the accuracy, or not reliable."""

    seed: int
    family: str
    quantity: str
    peak: bool
    asked: float
    error: float
    estimate: float
    told: bool
    doubted: bool

    @property
    def silent(self) -> bool:
        """Off by more than SILENT times the accuracy, and nobody was told."""
        return self.error > SILENT * self.asked and not (self.told or self.doubted)

    @property
    def needless(self) -> bool:
        """Told, and right."""
        return self.told and self.error <= self.asked

    def __str__(self) -> str:
        what = "peak of" if self.peak else "values of"
        return (f"{self.family} {self.seed} at {self.asked:.0e}: {what} {self.quantity}: error {self.error:.1e}, estimate "
                f"{self.estimate:.1e}{', told' if self.told else ''}")


def run(d: Drawn, accuracy: float, **options: Any) -> mb.Result:
    """A run of a drawn scene."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        return d.scene().simulate(d.t_end, accuracy=accuracy, max_wall=WALL, **options)


def references(d: Drawn, run_: mb.Result) -> list[mb.Result]:
    """Two of them, that differ in method and tolerance, with all vibrations of beams resolved."""
    own: dict[str, Any] = {}
    if run_.prepared.model.lines:
        own["form"] = {"GGL": mb.GGL, "ODE": mb.ODE}[run_.info.form](waves=True)
    return [run(d, 1e-8, solver=mb.RadauIIA(3), **own), run(d, 1e-7, solver=mb.RadauIIA(5), **own)]


def readings(seed: int, accuracies: tuple[float, ...]) -> list[Reading]:
    """All readings of scene number `seed`; those of which the references are not sure are left out, and scenes that have none."""
    d, exact, found = drawn(seed), [], []
    times = np.linspace(0, d.t_end, TIMES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        for accuracy in accuracies:
            r = run(d, accuracy)
            if not exact:
                try:
                    exact = [_read(one, d, times) for one in references(d, r)]
                except mb.MbdaeError:  # too dear with all vibrations, or at rest where no method goes on: nothing judges
                    return []
            for quantity in d.read:
                (values, peak), (again, peak_again) = (one[quantity] for one in exact)
                size = float(np.max(magnitudes(values)))
                if abs(peak - peak_again) <= AGREE * accuracy * size:
                    mine = r.peak(quantity)
                    told = any(note.startswith(f"{quantity} has") for note in r.warnings)
                    estimate = np.nan if mine.error is None else mine.error / mine.value
                    error = abs(mine.value - peak) / peak
                    found.append(Reading(seed, d.family, quantity, True, accuracy, error, estimate, told, r.reliable is False))
                if float(np.max(magnitudes(values - again))) <= AGREE * accuracy * size:
                    error = float(np.max(magnitudes(r(times).value(quantity) - values))) / size
                    estimate = (r.error(quantity) or np.nan) / size
                    told = estimate > accuracy
                    found.append(Reading(seed, d.family, quantity, False, accuracy, error, estimate, told, r.reliable is False))
    return found


def _read(r: mb.Result, d: Drawn, times: Any) -> dict[str, tuple[Any, float]]:
    """Values at some times and the peak of every quantity."""
    return {quantity: (r(times).value(quantity), r.peak(quantity).value) for quantity in d.read}
