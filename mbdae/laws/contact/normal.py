"""Base of normal contact laws: a repulsive force between two bodies that overlap."""

from __future__ import annotations

from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.part import Part
from mbdae.symbolic.vectors import Expr


class Normal(Part):
    """Normal force f_n = max(0, dV/dp + damping_force(p, rate)) of the penetration p > 0, m, and its rate, m/s.

    A law of one's own states `energy(p)`, and `damping_force(p, rate)` where it loses energy.
    """

    def energy(self, p: Expr) -> Expr:
        """Elastic energy of a penetration p >= 0, J."""
        raise LawError(f"normal law {type(self).__name__} does not state `energy(self, p)`: add it; it returns the "
                       f"elastic energy (J) of a penetration p (m)")

    def damping_force(self, p: Expr, rate: Expr) -> Expr:
        """Damping force, which is added to the elastic one, N."""
        return se.Integer(0)

    def elastic_force(self, p: Expr) -> Expr:
        """dV/dp, N."""
        x = se.Symbol("penetration")
        return se.diff(self.energy(x), x).subs({x: p})

    def penetration(self, force: float) -> float:
        """Static penetration under a force (N), m."""
        raise LawError(f"normal law {type(self).__name__} does not state `penetration(self, force)`: add it; it returns the "
                       f"penetration (m) at rest under a force (N)")

    def impact(self, mass: float, speed: Any) -> tuple[Any, Any]:
        """Largest penetration (m) and duration (s) of an elastic impact of an effective mass (kg) at a speed (m/s)."""
        raise LawError(f"normal law {type(self).__name__} does not state `impact(self, mass, speed)`: add it; it returns the "
                       f"largest penetration (m) and the duration (s) of an elastic impact")
