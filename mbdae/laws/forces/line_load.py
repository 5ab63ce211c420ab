"""Load distributed along a line element."""

from __future__ import annotations

from mbdae.symbolic.law import params
from mbdae.symbolic.line import LineLaw, LinePoint
from mbdae.symbolic.vectors import ZERO, Vec, components


class LineLoad(LineLaw):
    """A force per reference length on a beam's axis: dead (inertial components), or following the section (its axes 1, 2, 3)."""

    params = params(f1=("N/m", "along x, or axis 1 of the section"), f2=("N/m", "along y, or axis 2"),
                    f3=("N/m", "along z, or axis 3"))  # fmt: skip
    options = ("following",)

    def load(self, x: LinePoint) -> Vec:
        f = components(self.f1, self.f2, self.f3)
        return sum((axis * c for axis, c in zip(x.axes, f, strict=True)), ZERO) if self.following else f
