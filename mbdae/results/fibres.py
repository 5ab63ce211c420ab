"""Stresses at a point of the section of a beam, from its stress resultants.

Normal stress by Bernoulli, shear of shear forces by Jourawski (V Q / (I b)), of a torque in round sections by Saint-Venant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.errors import NamesArguments, OptionError
from mbdae.scene.section import Section
from mbdae.system.base import Array

OUTSIDE = 1e-6  #: distance beyond the boundary of a section, relative to its size, that counts as rounding


@dataclass(frozen=True)
class Fibre(NamesArguments):
    """A point of a section, x2 and x3 in m along its axes 2 and 3 from the centroid; called: name of the beam in messages."""

    section: Section
    x2: float
    x3: float
    called: str

    def normal(self, resultants: Array) -> Array:
        """Normal stress (nt,), Pa, of N1, M2, M3 among the resultants (nt, 6), N and N m."""
        s, E = self.section, self._modulus()
        N1, M2, M3 = resultants[:, 0], resultants[:, 4], resultants[:, 5]
        return np.asarray(E * (N1 / s.EA + M2 * self.x3 / s.EI2 - M3 * self.x2 / s.EI3))

    def shear(self, resultants: Array) -> Array:
        """Shear stress (nt, 2), Pa, along axes 2 and 3; OptionError for a torque on a section that is not round."""
        s, E = self.section, self._modulus()
        N2, N3, M1 = resultants[:, 1], resultants[:, 2], resultants[:, 3]
        along2 = N2 * self._first_over_width(2, abs(self.x2)) * E / s.EI3
        along3 = N3 * self._first_over_width(3, abs(self.x3)) * E / s.EI2
        if np.any(M1) and not self._round:
            raise OptionError(f"{self.called}: the shear stress of a torque is known for circles and tubes alone; read "
                              f"fibre_stress and stress_resultants")  # fmt: skip
        polar = M1 * E / (s.EI2 + s.EI3) if self._round else 0 * M1
        return np.stack([along2 - polar * self.x3, along3 + polar * self.x2], axis=1)

    def von_mises(self, resultants: Array) -> Array:
        """Von Mises stress (nt,), Pa, of the resultants (nt, 6), N and N m."""
        return np.asarray(np.sqrt(self.normal(resultants) ** 2 + 3 * np.sum(self.shear(resultants) ** 2, axis=1)))

    @property
    def _round(self) -> bool:
        return bool(self.section.shape) and self.section.shape[0] == "tube"

    def _modulus(self) -> float:
        """Young's modulus, Pa; refuses a section without a shape, and a point outside of it."""
        shape: Any = self.section.shape
        if not shape or not self.section.E:
            raise OptionError(f"{self.called}: its section has stiffnesses and no shape, so that stresses are not known: make it "
                              f"by mb.Section.circular, tube or rectangular")  # fmt: skip
        kind, a, b = shape
        slack = 1 + OUTSIDE
        inside = b / slack <= np.hypot(self.x2, self.x3) <= a * slack if kind == "tube" else (
            abs(self.x3) <= a / 2 * slack and abs(self.x2) <= b / 2 * slack)  # fmt: skip
        if not inside:
            section = f"a tube of radii {a:g} and {b:g} m" if kind == "tube" else f"a rectangle of {a:g} m by {b:g} m"
            where = f"x2 = {self.x2:g} m, x3 = {self.x3:g} m"
            raise OptionError(f"{self.called}: the point {where} is outside of its section, {section}: "
                              f"name a point of it, such as beam.at((x, y, z))")  # fmt: skip
        return float(self.section.E)

    def _first_over_width(self, axis: int, x: float) -> float:
        """First moment of the part of the section beyond x along an axis, over the width there, m^2."""
        kind, a, b = self.section.shape
        if kind == "rectangle":
            h = b if axis == 2 else a
            return float(max((h / 2) ** 2 - x**2, 0.0) / 2)
        outer, inner = max(a**2 - x**2, 0.0), max(b**2 - x**2, 0.0)
        return float((outer + np.sqrt(outer * inner) + inner) / 3)
