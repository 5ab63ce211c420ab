"""Friction in revolute and prismatic joints whose normal force is the joint's own reaction."""

from __future__ import annotations

from collections.abc import Mapping

import symengine as se

from mbdae.errors import LawError
from mbdae.laws.joints.classical import ClassicalRevolute
from mbdae.laws.joints.classical_prismatic import ClassicalPrismatic
from mbdae.laws.joints.prismatic import Prismatic
from mbdae.laws.joints.revolute import Revolute
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.law import Joint, params
from mbdae.symbolic.variation import let
from mbdae.symbolic.vectors import ZERO, Expr, Vec

SLIGHT = 1e-9  #: N, a reaction below which the normal force is smoothed: sqrt(F.F + SLIGHT^2)
RADIUS = params(radius=("m", "radius of the pin: lever of the friction force"))


class _Rubbing(Joint):
    """Both joints: a friction law (None: no friction), its states, and the normal force."""

    options = ("friction",)

    def pressing(self, k: Frame, l: Frame, reactions: Mapping[str, Expr]) -> Vec:
        """The part of the joint's reaction that presses the surfaces together, N; its magnitude is the normal force."""
        raise NotImplementedError

    def sliding(self, k: Frame, l: Frame) -> Expr:
        """Velocity of l relative to k where they rub, m/s."""
        raise NotImplementedError

    def _friction_force(self, k: Frame, l: Frame, reactions: Mapping[str, Expr]) -> Expr:
        """Friction force on l against the sliding, N."""
        pressing = self.pressing(k, l, reactions)
        normal = let(se.sqrt(let(pressing @ pressing) + SLIGHT**2))
        return let(-self.friction.coefficient(let(self.sliding(k, l))) * normal)

    def rates(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return dict(self.friction.rate(let(self.sliding(k, l))))

    def initial(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return dict(self.friction.initial(let(self.sliding(k, l))))


class _Bearing(_Rubbing):
    """Torque -coefficient(v) N radius on l about k.z, v = radius times the rate of the angle.

    N is the magnitude of the joint's reaction normal to k.z; the force along the axis and the moments about axes normal to it do
    not count.
    """

    def pressing(self, k: Frame, l: Frame, reactions: Mapping[str, Expr]) -> Vec:
        reaction = Vec(*(reactions[row] for row in ("x", "y", "z")))
        along: Vec = k.z * (k.z @ reaction)
        return reaction - along

    def sliding(self, k: Frame, l: Frame) -> Expr:
        return self.radius * (k.z @ (l.w - k.w))

    def resistance(self, k: Frame, l: Frame, reactions: Mapping[str, Expr]) -> tuple[Vec, Vec] | None:
        if self.friction is None:
            return None
        if not (k.kind.oriented and l.kind.oriented):
            raise LawError("friction in a bearing needs axes on both sides; a point mass has none")
        return ZERO, k.z * (self.radius * self._friction_force(k, l, reactions))


class _Slide(_Rubbing):
    """Force -coefficient(v) N on l along k.z, v the rate of the displacement.

    N is the magnitude of the joint's reaction normal to k.z, of the rows offset_x and offset_y; the moments that keep l
    upright do not count: a slide that jams needs its two guides stated.
    """

    def pressing(self, k: Frame, l: Frame, reactions: Mapping[str, Expr]) -> Vec:
        return Vec(reactions["offset_x"], reactions["offset_y"], 0)  # along k.x and k.y

    def sliding(self, k: Frame, l: Frame) -> Expr:
        return k.z @ (l.v - k.v - k.w.cross(l.r - k.r))

    def resistance(self, k: Frame, l: Frame, reactions: Mapping[str, Expr]) -> tuple[Vec, Vec] | None:
        if self.friction is None:
            return None
        return k.z * self._friction_force(k, l, reactions), ZERO


class RubbingRevolute(_Bearing, Revolute):
    """The kinematic revolute joint with friction in its bearing (see `_Bearing`)."""

    params = Revolute.params | RADIUS


class RubbingClassicalRevolute(_Bearing, ClassicalRevolute):
    """The classical revolute joint with friction in its bearing (see `_Bearing`)."""

    params = ClassicalRevolute.params | RADIUS


class RubbingPrismatic(_Slide, Prismatic):
    """The kinematic prismatic joint with friction in its guide (see `_Slide`)."""


class RubbingClassicalPrismatic(_Slide, ClassicalPrismatic):
    """The classical prismatic joint with friction in its guide (see `_Slide`)."""
