"""Geometrically exact beam (Reissner 1972, Simo 1985): shear deformable, any displacement and rotation."""

from __future__ import annotations

from mbdae.symbolic.law import params
from mbdae.symbolic.line import LineLaw, LinePoint
from mbdae.symbolic.vectors import Expr, Vec

_FORCES = {"N1": "axial force", "N2": "shear force along axis 2", "N3": "shear force along axis 3"}
_MOMENTS = {"M1": "torque", "M2": "bending moment about axis 2", "M3": "bending moment about axis 3"}


class Beam(LineLaw):
    """Strains Gamma = R^T dr/ds and K = axial(R^T dR/ds) in section axes, less those of the reference curve.

    T = mass_per_length v.v / 2 + Omega.J Omega / 2 per length. In the plane N1, N2 and M3 remain.
    """

    params = params(
        mass_per_length=("kg/m", "mass per reference length"),
        J1=("kg m", "rotary inertia per length about axis 1"), J2=("kg m", "about axis 2"), J3=("kg m", "about axis 3"),
        damping=("s", "stress = C (strain + damping * strain rate)"),
        **{f"compliance_{name}": ("1/N", f"strain per {meaning}; 0 is rigid") for name, meaning in _FORCES.items()},
        **{f"compliance_{name}": ("1/(N m^2)", f"curvature per {meaning}; 0 is rigid") for name, meaning in _MOMENTS.items()},
        **{f"reference_{name}": ("1", f"strain {name} works on, without stress") for name in _FORCES},
        **{f"reference_{name}": ("1/m", f"curvature {name} works on, without stress") for name in _MOMENTS},
    )  # fmt: skip

    def strains(self, x: LinePoint) -> dict[str, Expr]:
        Gamma, K = Vec(*(axis @ x.r_s for axis in x.axes)), x.curvature
        return dict(zip((*_FORCES, *_MOMENTS), (*Gamma, *K), strict=True))

    def kinetic_energy(self, x: LinePoint) -> Expr:
        p, q, r = x.spin
        return self.mass_per_length * (x.v @ x.v) / 2 + (self.J1 * p * p + self.J2 * q * q + self.J3 * r * r) / 2
