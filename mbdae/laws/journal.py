"""Contact between a pin and the race around it: the force law of a revolute joint with clearance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import symengine as se

from mbdae.laws.contact import CENTRED, DEEP, Contact, Station, station
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Impact
from mbdae.symbolic.part import params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import ZERO, Expr, Vec

__all__ = ["JournalContact"]


CORE = 1e-12  #: m, the direction of contact is smoothed within half the clearance plus this distance of the race's centre
#: without play, or without speed at the start, the penetration that is expected before the run is at least PLAY times the play
#: (outer - inner) and PIN times the radius of the pin
PLAY, PIN = 1e-2, 1e-6
DIFFERENCE = 1e-4  #: relative change of the penetration in the central difference for the stiffness of a contact


def _tilts(k: Frame, l: Frame) -> bool:
    """Whether the pin may tilt in the race: in space, and not where l is a mass point."""
    return l.kind.oriented and not k.kind.flat


class JournalContact(Contact):
    """A pin on l (radius `inner`) inside a race on k (radius `outer`); Eqs. 33-44 of "Modified models
    for revolute joints coupling flexibility of links in multibody systems", with k the outer race.

    u = l.r - k.r, d its length normal to k.z, n = u / d, penetration d - (outer - inner). Normal force f_n along -n on l,
    friction force -coefficient(v) f_n along t = k.z x n; both act at one point, outer n from the centre of the race, so that
    moments balance (a mass point takes no moment: there they act at the mass point). v is the sliding velocity of the
    material points there: leaving out the rotation of the race creates energy. With `length` the pin touches at both ends of a
    bearing of that length and may tilt; a friction law with states then acts along t only.
    """

    params = params(
        outer=("m", "radius of the race on k"), inner=("m", "radius of the pin on l"),
        length=("m", "distance of the two planes of contact; None: one plane"),
    )

    @property
    def ends(self) -> tuple[str, ...]:
        return ("",) if self.length is None else ("_near", "_far")

    @property
    def one_direction(self) -> bool:
        return self.length is None

    # -- geometry

    def stations(self, k: Frame, l: Frame) -> list[tuple[Station, str]]:
        """The planes of contact with the suffix of their states; one plane stands for both ends of a pin that cannot tilt."""
        if self.length is None or not _tilts(k, l):
            return [(self._station(k, l, ZERO), self.ends[0])]
        return [(self._station(k, l, l.z * (sign * self.length / 2)), end) for sign, end in zip((-1, 1), self.ends, strict=True)]

    def equal(self, k: Frame, l: Frame) -> int:
        return 2 if self.length is not None and not _tilts(k, l) else 1

    def _station(self, k: Frame, l: Frame, shift: Vec) -> Station:
        """The contact in the plane normal to k.z through l.r + shift."""
        clearance = self.outer - self.inner
        u = l.r + shift - k.r
        along = k.z @ u
        radial = (u - k.z * along).named("u")
        distance = let(se.sqrt(radial @ radial + CENTRED), "d")
        normal = (radial * self._inverse(radial, distance, clearance / 2)).named("n")
        tangent = k.z.cross(normal)
        from_k = k.z * along + normal * self.outer if l.kind.oriented else u
        arm = (k.r + from_k - l.r).named("h") if l.kind.oriented else ZERO
        velocity = self.sliding(k, l, arm, from_k).named("v")
        return station(let(distance - clearance, "p"), normal, tangent, velocity, arm)

    @staticmethod
    def _inverse(radial: Vec, distance: Expr, core: Expr) -> Expr:
        """1 / distance; inside the core, where nothing touches, a parabola that continues it with the same value and slope."""
        square = radial @ radial
        inside = core + CORE
        return let(se.Piecewise((1 / distance, distance > inside), ((3 - square / inside**2) / (2 * inside), True)), r"\beta")

    # -- before and after a run

    def approach(self, k: Frame, l: Frame) -> list[Expr]:
        u = l.r - k.r
        return [u[0], u[1], u[2]]

    def expected_depth(self, impact: Impact) -> float:
        """Penetration (m) of an impact at the speed of the start. Without speed: the larger of that at rest under the force of
        the ideal joint and that of an impact after the play was crossed under this force; at least a small part of the play."""
        normal, play, mass, force = self.normal, self.outer - self.inner, impact.mass, impact.force
        if impact.speed * play > 0:
            return float(normal.impact(mass, impact.speed)[0])
        fall = float(normal.impact(mass, math.sqrt(2 * force * play / mass))[0]) if force * play > 0 else 0.0
        return max(float(normal.penetration(force)), fall, float(PLAY * play), float(PIN * self.inner))

    def summary_of_contact(self) -> str:
        friction = "without friction" if self.friction is None else f"{type(self.friction).__name__} friction"
        ends = "" if self.length is None else f", at both ends of {self.length:.3g} m"
        return f"{self.outer - self.inner:.3g} m play, {type(self.normal).__name__}, {friction}{ends}"

    def refuses_start(self, depth: float, size: float, continued: bool) -> str:
        if depth <= self.inner / DEEP:
            return ""
        return (f"more than {1 / DEEP:g} of the pin's radius of {self.inner:g} m: draw the pin inside the race, or give a "
                f"larger clearance")

    def doubtful_depth(self) -> tuple[float, str, str]:
        play, part = self.outer - self.inner, self.inner / DEEP
        return (part if play == 0 else min(play, part), "the clearance, or a tenth of the pin's radius",
                "a stiffer normal law is meant, or what is prescribed, or the parts' weight, is too much for it")

    def instability(self, mass: float, depth: Any, force: Any, rub: Any) -> tuple[Any, Any] | None:
        """k = df/da is the stiffness along the normal, f/d the one across it (f contact force, a penetration, d distance of the
        centres of pin and race). Friction with coefficient mu couples both directions; without damping, the pin flutters where
        (k - f/d)^2 < 4 mu^2 k f/d."""
        if self.friction is None:
            return None
        growth, rate = np.zeros(len(depth)), np.zeros(len(depth))
        for i in np.flatnonzero((depth > 0) & (force > 0)):
            a, f = float(depth[i]), float(force[i])
            elastic = [float(self.normal.elastic_force(a * (1 + e))) for e in (-DIFFERENCE, DIFFERENCE)]
            normal, across = (elastic[1] - elastic[0]) / (2 * DIFFERENCE * a), f / (self.outer - self.inner + a)
            coupled = (float(rub[i]) / f) ** 2 * normal * across - (normal - across) ** 2 / 4
            if coupled > 0:
                slow = 1e-3 * a * np.sqrt(normal / mass)
                damping = float(self.normal.damping_force(a, slow)) / slow
                rate[i] = np.sqrt((normal + across) / (2 * mass))
                growth[i] = np.sqrt(coupled) / (2 * mass * rate[i]) - damping / (4 * mass)
        return growth, rate

    def observed(self, k: Frame, l: Frame) -> dict[str, list[Expr]]:
        u = l.r - k.r
        return {"orbit": [k.x @ u, k.y @ u], **super().observed(k, l)}
