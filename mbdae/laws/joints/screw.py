"""Screw joint."""

from __future__ import annotations

import math

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import SLIGHT, Joint
from mbdae.symbolic.law import params
from mbdae.symbolic.motion import Motion
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.values import BadValueError, number


class Screw(Joint):
    """l turns about k.z and travels along it by `lead` a turn, right-handed where that is positive.

    Its angle counts whole turns, which the frames do not show, so that it is an unknown in every model.

    Friction acts along the helix of a square thread at its mean radius r (`friction_radius`). With the travel a radian
    p = lead / (2 pi), the lead angle phi, tan phi = p / r, and a sliding velocity sqrt(r^2 + p^2) angle', the axial force F of
    the joint on l is that of the normal force N and of the friction c N (c: signed coefficient of friction) along the helix,

        F = +-N cos phi - c N sin phi,   N = sqrt(r^2 + p^2) (r |F| + c p F) / (r^2 - c^2 p^2)

    (+ or -: which flank of the thread carries).

    A load F is lifted by a torque F r tan(phi + rho) and lowered by F r tan(phi - rho), tan rho = c. Forces normal to the axis
    and tilting torques do not press the thread."""

    coordinates = params(angle=("rad", "rotation of l about k.z"))
    params = params(lead=("m", "travel a turn"))

    def compose(self) -> None:
        super().compose()
        steepness = self._steepness()
        if steepness and steepness * (self._coefficient() or 0.0) >= 1:
            raise LawError(f"screw '{self.name}': friction coefficient {self._coefficient():g} at a lead angle of "
                           f"{math.degrees(math.atan(self._steepness())):.3g} degrees: no torque turns it against an axial "
                           f"force; give a smaller friction coefficient or lead, or a larger radius")  # fmt: skip

    def motion(self, from_k: Motion) -> Motion:
        return from_k.along("z", self._travel() * self.angle).about("z", self.angle)

    def pressing(self, k: Frame, l: Frame, force: Vec) -> Vec:
        along: Vec = k.z * (k.z @ force)
        return along

    def lever(self) -> Expr:
        return se.sqrt(self.friction_radius**2 + self._travel() ** 2)

    def normal_force(self, k: Frame, l: Frame, force: Vec, coefficient: Expr) -> Expr:
        r, p, F = self.friction_radius, self._travel(), let(k.z @ force)
        return let(self.lever() * (r * let(se.sqrt(F**2 + SLIGHT**2)) + coefficient * p * F) / (r**2 - (coefficient * p) ** 2))

    def remarks(self) -> list[str]:
        mu, steepness = self._coefficient(), self._steepness()
        if mu is None or not mu > steepness > 0:
            return []
        return [f"self-locking: its friction coefficient {mu:g} is above tan(lead angle) = {steepness:.4g}; an axial force alone "
                f"does not turn it, and with smoothed friction it creeps"]  # fmt: skip

    def _travel(self) -> Expr:
        """Travel along k.z per radian of the angle, m."""
        return self.lead / (2 * se.pi)

    def _steepness(self) -> float:
        """Tangent of the lead angle at the radius of friction, without sign; 0 where it is not known."""
        try:
            lead, radius = number(self.lead), number(self.friction_radius)
        except BadValueError:
            return 0.0
        return abs(lead) / (2 * math.pi * radius) if radius > 0 else 0.0

    def _coefficient(self) -> float | None:
        """The largest coefficient of friction; None where it is not known."""
        found: float | None = None if self.friction is None else self.friction.largest()
        return found
