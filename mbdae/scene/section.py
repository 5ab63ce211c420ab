"""Cross-sections of beams. Axis 1 runs along the beam; in a planar scene axis 2 lies in the plane, axis 3 is its normal.

Shear correction factors: G.R. Cowper, The Shear Coefficient in Timoshenko's Beam Theory, J. Appl. Mech. 33 (1966) 335.
Torsion of rectangles: Saint-Venant's series, S.P. Timoshenko and J.N. Goodier, Theory of Elasticity, section 109.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbdae.errors import OptionError

_STIFFNESSES = {"EA": "N1", "GA2": "N2", "GA3": "N3", "GJ": "M1", "EI2": "M2", "EI3": "M3"}
_UNITS = {**dict.fromkeys(("EA", "GA2", "GA3"), "N"), **dict.fromkeys(("GJ", "EI2", "EI3"), "N m^2")}


@dataclass(frozen=True)
class Section:
    """A cross-section of a beam about its centroid, axes 2 and 3 principal.

    EA axial, GA2 and GA3 shear stiffness along axes 2 and 3 (shear correction included), N; GJ torsional, EI2 and EI3
    bending stiffness about axes 2 and 3, N m^2; math.inf is a rigid strain. mass_per_length kg/m. rotary_inertia about axes
    1, 2, 3, kg m; one number j for equal axes 2 and 3 is (2 j, j, j). damping: stress = C (strain + damping * strain
    rate), s.
    """

    EA: float
    GA2: float
    GA3: float
    GJ: float
    EI2: float
    EI3: float
    mass_per_length: float
    rotary_inertia: Any
    damping: float = 0.0

    def __post_init__(self) -> None:
        inertia = self.rotary_inertia
        if np.shape(inertia) == ():
            inertia = (2 * _number("rotary_inertia", inertia), inertia, inertia)
        if np.shape(inertia) != (3,):
            raise OptionError(f"section: rotary_inertia has shape {np.shape(inertia)}; give one number or three (kg m)")
        object.__setattr__(self, "rotary_inertia", tuple(float(_number("rotary_inertia", j)) for j in inertia))
        for name, unit in (*_UNITS.items(), ("mass_per_length", "kg/m"), ("damping", "s")):
            object.__setattr__(self, name, _number(name, getattr(self, name), unit))
        wrong = [f"{name} = {getattr(self, name):g} {unit}" for name, unit in _UNITS.items() if not getattr(self, name) > 0]
        wrong += [f"{name} = {value:g} {unit}" for name, value, unit in self._inertias() if not 0 < value < math.inf]
        if wrong:
            raise OptionError(f"section: {', '.join(wrong)}: give positive numbers")
        if not 0 <= self.damping < math.inf:
            raise OptionError(f"section: damping = {self.damping:g} s: give 0 or more; a negative one would feed energy")

    def _inertias(self) -> list[tuple[str, float, str]]:
        rotary = [(f"rotary_inertia[{i}]", j, "kg m") for i, j in enumerate(self.rotary_inertia)]
        return [("mass_per_length", self.mass_per_length, "kg/m"), *rotary]

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of the beam law: compliances instead of stiffnesses, so that a rigid strain is 0."""
        compliances = {f"compliance_{stress}": 1 / getattr(self, name) for name, stress in _STIFFNESSES.items()}
        J1, J2, J3 = self.rotary_inertia
        return {"mass_per_length": self.mass_per_length, "J1": J1, "J2": J2, "J3": J3, "damping": self.damping, **compliances}

    @property
    def rigid(self) -> tuple[str, ...]:
        """Names of the stiffnesses that are infinite: their strains are constraints, only the mixed form has them."""
        return tuple(name for name in _STIFFNESSES if math.isinf(getattr(self, name)))

    @property
    def swapped(self) -> Section:
        """The section with axes 2 and 3 exchanged: what a planar scene sees where axis 2 is the normal."""
        J1, J2, J3 = self.rotary_inertia
        return replace(self, GA2=self.GA3, GA3=self.GA2, EI2=self.EI3, EI3=self.EI2, rotary_inertia=(J1, J3, J2))

    @classmethod
    def circular(cls, radius: float, E: float, nu: float, rho: float, damping: float = 0.0) -> Section:
        """Solid circle of `radius` m; E Pa, nu Poisson's ratio, rho kg/m^3."""
        _positive(radius=(radius, "m"))
        return cls.tube(radius, 0.0, E, nu, rho, damping)

    @classmethod
    def tube(cls, outer: float, inner: float, E: float, nu: float, rho: float, damping: float = 0.0) -> Section:
        """Circular tube of radii `outer` > `inner` >= 0, m; E Pa, nu Poisson's ratio, rho kg/m^3."""
        _positive(outer=(outer, "m"))
        if not 0 <= _number("inner", inner, "m") < outer:
            raise OptionError(f"section: inner = {inner:g} m: give 0 or more and less than outer = {outer:g} m")
        m = (inner / outer) ** 2
        k = 6 * (1 + nu) * (1 + m) ** 2 / ((7 + 6 * nu) * (1 + m) ** 2 + (20 + 12 * nu) * m)
        A, I = math.pi * (outer**2 - inner**2), math.pi / 4 * (outer**4 - inner**4)
        return cls._of_shape(A, (2 * I, I, I), k, 2 * I, E, nu, rho, damping)

    @classmethod
    def rectangular(cls, width: float, height: float, E: float, nu: float, rho: float, damping: float = 0.0) -> Section:
        """Rectangle, `height` m along axis 2 (in the plane of a planar beam) and `width` m along axis 3: EI3 = E width
        height^3 / 12. E Pa, nu Poisson's ratio, rho kg/m^3."""
        _positive(width=(width, "m"), height=(height, "m"))
        A, I2, I3 = width * height, height * width**3 / 12, width * height**3 / 12
        k = 10 * (1 + nu) / (12 + 11 * nu)
        return cls._of_shape(A, (I2 + I3, I2, I3), k, _torsion_of_rectangle(width, height), E, nu, rho, damping)

    @classmethod
    def _of_shape(cls, A: float, I: tuple[float, float, float], k: float, J: float, E: float, nu: float, rho: float,
                  damping: float) -> Section:  # fmt: skip
        """From area, polar and second moments, shear correction factor and torsion constant."""
        _positive(E=(E, "Pa"), rho=(rho, "kg/m^3"))
        if not -1 < _number("nu", nu) <= 0.5:
            raise OptionError(f"section: nu = {nu:g}: Poisson's ratio lies above -1 and not above 0.5")
        G = E / (2 * (1 + nu))
        inertia = tuple(rho * i for i in I)
        return cls(E * A, k * G * A, k * G * A, G * J, E * I[1], E * I[2], rho * A, inertia, damping)


def _torsion_of_rectangle(width: float, height: float) -> float:
    """Saint-Venant's torsion constant, m^4; the odd terms of the series up to 99 leave less than 1e-10 of it."""
    a, b = max(width, height), min(width, height)
    series = sum(math.tanh(n * math.pi * a / (2 * b)) / n**5 for n in range(1, 100, 2))
    return a * b**3 * (1 / 3 - 64 * b / (math.pi**5 * a) * series)


def _number(name: str, value: Any, unit: str = "") -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise OptionError(f"section: {name} = {value!r} is not a number{f' ({unit})' if unit else ''}") from None
    if math.isnan(number):
        raise OptionError(f"section: {name} = {number} {unit}: give a number")
    return number


def _positive(**values: tuple[Any, str]) -> None:
    """Refuse values that are not positive and finite, all at once."""
    wrong = [f"{name} = {value:g} {unit}" for name, (value, unit) in values.items()
             if not 0 < _number(name, value, unit) < math.inf]  # fmt: skip
    if wrong:
        raise OptionError(f"section: {', '.join(wrong)}: give positive numbers")
