"""Two quantities that a drawn scene is asked for, at a drawn accuracy, against a reference: within it, told, silent."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from random_scenes import random_scene
from uncovered.draw import Drawn, drawn
from uncovered.judge import AGREE, SILENT, WALL, references

import mbdae as mb
from mbdae.results.quantities import magnitudes

ACCURACIES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
TIMES = 1001  #: at which values are compared
LITTLE = 0.03  #: an error below this part of the accuracy is smaller than what the references know
BELOW, ABOVE = 1 / 3, 100.0  #: ratios of estimate to error that count as near


@dataclass(frozen=True)
class Asked:
    """A quantity that was asked for: error and estimate over its largest value; told: by a warning, or by `reliable`."""

    seed: int
    family: str
    quantity: str
    asked: float
    error: float
    estimate: float
    told: bool
    runs: int

    @property
    def silent(self) -> bool:
        """Off by more than SILENT times the accuracy, and nobody was told."""
        return self.error > SILENT * self.asked and not self.told

    @property
    def near(self) -> bool:
        """Whether the estimate is near the error, or both are too small to tell."""
        least = LITTLE * self.asked
        return max(self.estimate, least) >= BELOW * self.error and self.estimate <= ABOVE * max(self.error, least)

    def __str__(self) -> str:
        return (f"{self.family} {self.seed} at {self.asked:.0e}: {self.quantity}: error {self.error:.1e}, estimate "
                f"{self.estimate:.1e}{', told' if self.told else ''}, {self.runs} runs")


def rigid(seed: int) -> Drawn:
    """A random scene of rigid bodies with loads, springs and inputs of time, and the forces of its joints."""
    def scene() -> mb.Scene:
        return random_scene(seed)

    joints = [f"{joint.name}.force" for joint in scene().joints]
    return Drawn("rigid", scene, 1.0, tuple(joints))


def asked(seed: int) -> list[Asked]:
    """What came of the two quantities of scene number `seed`; those of which the references are not sure are left out."""
    rng = np.random.default_rng(seed)
    make: Callable[[int], Drawn] = drawn if seed % 2 else rigid
    d, accuracy = make(seed), float(rng.choice(ACCURACIES))
    of = [str(name) for name in rng.permutation(d.read)[:2]]
    times = np.linspace(0, d.t_end, TIMES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        r = d.scene().simulate(d.t_end, accuracy, of=of, max_wall=WALL)
        try:
            exact = [one(times) for one in references(d, r)]
        except mb.MbdaeError:  # too dear with all vibrations, or at rest where no method goes on: nothing judges
            return []
        return [one for name in of if (one := _judged(seed, d, accuracy, name, r, [e.value(name) for e in exact])) is not None]


def _judged(seed: int, d: Drawn, accuracy: float, name: str, r: mb.Result, exact: list[np.ndarray]) -> Asked | None:
    size = float(np.max(magnitudes(exact[0])))
    if not size > 0 or float(np.max(magnitudes(exact[0] - exact[1]))) > AGREE * accuracy * size:
        return None
    error = float(np.max(magnitudes(r(np.linspace(0, d.t_end, TIMES)).value(name) - exact[0]))) / size
    told = r.reliable is False or any(note.startswith(f"{name} has") for note in r.warnings)
    estimate = r.accuracy.of[name]
    return Asked(seed, d.family, name, accuracy, error, np.nan if estimate is None else estimate, told, r.info.runs)
