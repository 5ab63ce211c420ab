"""Shapes of bodies: what touches, and what is drawn.

Cross-sections of beams. Axis 1 runs along the beam; in a planar scene axis 2 lies in the plane, axis 3 is its normal.

Shear correction factors: G.R. Cowper, The Shear Coefficient in Timoshenko's Beam Theory, J. Appl. Mech. 33 (1966) 335.
Torsion of rectangles: Saint-Venant's series, S.P. Timoshenko and J.N. Goodier, Theory of Elasticity, section 109.

Axes of the frames of joints and forces as drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.values import BadValueError, array, number, option, shown


@dataclass(frozen=True)
class Shape:
    """A shape that is fixed to a body. `at`: a point (m) as drawn; None: the body's centre of mass."""

    at: Any = None


@dataclass(frozen=True)
class Plane(Shape):
    """A half space; `normal`, as drawn, points out of it, to the free side."""

    normal: Any = (0, 0, 1)


@dataclass(frozen=True)
class Sphere(Shape):
    """A ball of `radius` (m) about `at`; a disc in a planar scene."""

    radius: float = 1.0


@dataclass(frozen=True)
class Point(Shape):
    """A point of a body."""


@dataclass(frozen=True)
class Cylinder(Shape):
    """A cylinder about `axis`, as drawn, of `radius` and `length` (m), its middle at `at`; without a length it has no ends."""

    axis: Any = (0, 0, 1)
    radius: float = 1.0
    length: float | None = None


@dataclass(frozen=True)
class Box(Shape):
    """A box with its middle at `at` and edges of `size` (three lengths, m) along the columns of `rotation` (3, 3) as drawn; None:
    along the inertial axes."""

    size: Any = (1, 1, 1)
    rotation: Any = None


_STIFFNESSES = {"EA": "N1", "GA2": "N2", "GA3": "N3", "GJ": "M1", "EI2": "M2", "EI3": "M3"}
_UNITS = {**dict.fromkeys(("EA", "GA2", "GA3"), "N"), **dict.fromkeys(("GJ", "EI2", "EI3"), "N m^2")}


@dataclass(frozen=True)
class Section:
    """A cross-section of a beam about its centroid, axes 2 and 3 principal.

    EA axial, GA2 and GA3 shear stiffness along axes 2 and 3 (shear correction included), N; GJ torsional, EI2 and EI3
    bending stiffness about axes 2 and 3, N m^2; `s.beam` wants finite ones (1e4 times the real one is nearly rigid).
    mass_per_length kg/m. rotary_inertia about axes 1, 2, 3, kg m; one number j for equal axes 2 and 3 is (2 j, j, j).
    damping: stress = C (strain + damping * strain rate), s.
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
    E: float | None = None  #: Pa, for stresses at fibres; None: the section is not made from a shape
    shape: tuple[Any, ...] = ()  #: ("tube", radii outer, inner) or ("rectangle", width along axis 3, height along axis 2), m

    def __post_init__(self) -> None:
        given = self.rotary_inertia
        try:
            inertia = array(given, (), (3,))
        except BadValueError as value_and_reason:
            raise OptionError(f"section: rotary_inertia = {value_and_reason}; give one number or three, kg m") from None
        about = inertia.tolist()
        object.__setattr__(self, "rotary_inertia", tuple(about) if inertia.ndim else (2 * about, about, about))
        refused: list[str] = []
        for name, unit in _UNITS.items():
            value = getattr(self, name)
            refused += [] if isinstance(value, float) and value == math.inf else self._read(name, unit, above=0)
        refused += self._read("mass_per_length", "kg/m", above=0)
        refused += [f"rotary_inertia[{i}] = {j:g} kg m is not positive" for i, j in enumerate(self.rotary_inertia) if j <= 0]
        if refused:
            raise OptionError(f"section: {', '.join(refused)}: give positive numbers")
        for damping_and_reason in self._read("damping", "s", least=0):
            raise OptionError(f"section: {damping_and_reason}: give 0 or more; a negative one would feed energy")

        self._read_shape()

    def _read_shape(self) -> None:
        """Refuse a wrong shape; drop one that does not belong to the stiffnesses, such as after `dataclasses.replace`."""
        if self.E is None and not self.shape:
            return
        try:
            kind, first, second = self.shape
            E, a, b = (number(x, least=0) for x in (self.E, first, second))
            A, I2, I3 = {"tube": _of_tube, "rectangle": _of_rectangle}[kind](a, b)
        except (BadValueError, ValueError, TypeError, KeyError):
            raise OptionError(f"section: shape = {shown(self.shape)}, E = {shown(self.E)}: a section made by hand has neither; "
                              f"leave both out, or use mb.Section.circular, tube or rectangular") from None
        stated = (self.EA, self.EI2, self.EI3)
        if not all(math.isclose(x, E * y, rel_tol=1e-9) for x, y in zip(stated, (A, I2, I3), strict=True)):
            object.__setattr__(self, "E", None)
            object.__setattr__(self, "shape", ())

    def _read(self, name: str, unit: str, **bounds: float) -> list[str]:
        """Replace the value of a field by a plain number; returns the message where it is no number within the bounds, in a list,
        else an empty list."""
        try:
            object.__setattr__(self, name, number(getattr(self, name), **bounds))
        except BadValueError as refused:
            return [_described(name, getattr(self, name), unit, refused)]
        return []

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of the beam law: compliances instead of stiffnesses, so that a rigid strain is 0."""
        compliances = {f"compliance_{stress}": 1 / getattr(self, name) for name, stress in _STIFFNESSES.items()}
        J1, J2, J3 = self.rotary_inertia
        return {"mass_per_length": self.mass_per_length, "J1": J1, "J2": J2, "J3": J3, "damping": self.damping, **compliances}

    @property
    def rigid(self) -> tuple[str, ...]:
        """Names of the infinite stiffnesses: their strains are constraints, which need the mixed form (stresses as unknowns)."""
        return tuple(name for name in _STIFFNESSES if math.isinf(getattr(self, name)))

    @property
    def swapped(self) -> Section:
        """The section with axes 2 and 3 exchanged: what a planar scene sees where axis 2 is the normal."""
        J1, J2, J3 = self.rotary_inertia
        return replace(self, GA2=self.GA3, GA3=self.GA2, EI2=self.EI3, EI3=self.EI2, rotary_inertia=(J1, J3, J2),
                       shape=(self.shape[0], *self.shape[:0:-1]) if self.shape[:1] == ("rectangle",) else self.shape)

    @classmethod
    def circular(cls, radius: float, E: float, nu: float, rho: float, damping: float = 0.0) -> Section:
        """Solid circle of `radius` m; E Pa, nu Poisson's ratio, rho kg/m^3."""
        (radius,) = _positive(radius=(radius, "m"))
        return cls.tube(radius, 0.0, E, nu, rho, damping)

    @classmethod
    def tube(cls, outer: float, inner: float, E: float, nu: float, rho: float, damping: float = 0.0) -> Section:
        """Circular tube of radii `outer` > `inner` >= 0, m; E Pa, nu Poisson's ratio, rho kg/m^3."""
        (outer,), nu = _positive(outer=(outer, "m")), _poisson(nu)
        inner = option("section: inner", inner, number, "give the inner radius in m, 0 or more", least=0)
        if not inner < outer:
            raise OptionError(f"section: inner = {inner:g} m: give 0 or more and less than outer = {outer:g} m")
        m, (A, I, _) = (inner / outer) ** 2, _of_tube(outer, inner)
        k = 6 * (1 + nu) * (1 + m) ** 2 / ((7 + 6 * nu) * (1 + m) ** 2 + (20 + 12 * nu) * m)
        return cls._of_shape(A, (2 * I, I, I), k, 2 * I, E, nu, rho, damping, ("tube", outer, inner))

    @classmethod
    def rectangular(cls, width: float, height: float, E: float, nu: float, rho: float, damping: float = 0.0) -> Section:
        """Rectangle, `height` m along axis 2 (in the plane of a planar beam) and `width` m along axis 3: EI3 = E width
        height^3 / 12. E Pa, nu Poisson's ratio, rho kg/m^3."""
        (width, height), nu = _positive(width=(width, "m"), height=(height, "m")), _poisson(nu)
        A, I2, I3 = _of_rectangle(width, height)
        k = 10 * (1 + nu) / (12 + 11 * nu)
        return cls._of_shape(A, (I2 + I3, I2, I3), k, _torsion_of_rectangle(width, height), E, nu, rho, damping,
                             ("rectangle", width, height))

    @classmethod
    def _of_shape(cls, A: float, I: tuple[float, float, float], k: float, J: float, E: float, nu: float, rho: float,
                  damping: float, shape: tuple[Any, ...]) -> Section:
        """From area A, m^2, second moments I about axes 1, 2, 3, m^4, shear correction factor k and torsion constant J, m^4."""
        E, rho = _positive(E=(E, "Pa"), rho=(rho, "kg/m^3"))
        G = E / (2 * (1 + nu))
        inertia = tuple(rho * i for i in I)
        return cls(E * A, k * G * A, k * G * A, G * J, E * I[1], E * I[2], rho * A, inertia, damping, E, shape)


def _of_tube(outer: float, inner: float) -> tuple[float, float, float]:
    """Area, m^2, and second moments about axes 2 and 3, m^4."""
    I = math.pi / 4 * (outer**4 - inner**4)
    return math.pi * (outer**2 - inner**2), I, I


def _of_rectangle(width: float, height: float) -> tuple[float, float, float]:
    """Area, m^2, and second moments about axes 2 and 3, m^4."""
    return width * height, height * width**3 / 12, width * height**3 / 12


def _torsion_of_rectangle(width: float, height: float) -> float:
    """Saint-Venant's torsion constant, m^4; the odd terms of the series up to 99 leave less than 1e-10 of it."""
    a, b = max(width, height), min(width, height)
    series = sum(math.tanh(n * math.pi * a / (2 * b)) / n**5 for n in range(1, 100, 2))
    return a * b**3 * (1 / 3 - 64 * b / (math.pi**5 * a) * series)


def _described(name: str, value: Any, unit: str, refused: BadValueError) -> str:
    """Why a value is refused, with its unit."""
    head, text = shown(value), str(refused)
    return f"{name} = {head} {unit}{text[len(head):]}" if type(value) in (int, float) else f"{name} = {text} ({unit})"


def _poisson(nu: Any) -> float:
    return option("section: nu", nu, number, "Poisson's ratio lies above -1 and not above 0.5", above=-1, most=0.5)


def _positive(**values: tuple[Any, str]) -> list[float]:
    """Plain numbers; refuses values that are not positive and finite, all at once."""
    found, refused_values = [], []
    for name, (value, unit) in values.items():
        try:
            found.append(number(value, above=0))
        except BadValueError as refused:
            refused_values.append(_described(name, value, unit, refused))
    if refused_values:
        raise OptionError(f"section: {', '.join(refused_values)}: give positive numbers")
    return found


# -- axes of frames


def joint_axes(law: Any, k: Any, side: str = "k") -> Any:
    """Axes of a law's frame on a body as drawn, columns of a matrix (3, 3) in inertial components: z along the axis. A law with
    `axes_of` uses the axes of that body instead. k: the body of its first frame; side: of the frame. The axes of l, where other
    ones are stated, are those of k turned the shortest way, or about its z to the x that is stated."""
    if law.axes_of == "k":
        return k.drawn.rotation
    if law.axes_of == "l":
        return law.l.drawn.rotation
    z, x, z_l, x_l = (None if a is None else tuple(map(float, a)) for a in (law.axis, law.axis_x, law.axis_l, law.axis_x_l))
    if side != "l" or (z_l is None and x_l is None):
        return _axes(z, x)
    return _axes(z_l or z, x_l) if x_l is not None else _turned(z, x, z_l)


@lru_cache(maxsize=1024)
def _axes(axis: Any, axis_x: Any) -> Any:
    z = np.array(axis)
    if axis_x is not None:
        x = np.array(axis_x) - (np.array(axis_x) @ z) * z
        x /= np.linalg.norm(x)
    elif abs(z[2]) < 1e-14:
        x = np.array([0.0, 0.0, 1.0])
    else:
        helper = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
        x = helper - (helper @ z) * z
        x /= np.linalg.norm(x)
    y = [z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]]
    found = np.array([x, y, z]).T
    found.flags.writeable = False  # read-only, because all joints with these axes share the array
    return found


@lru_cache(maxsize=1024)
def _turned(axis: Any, axis_x: Any, axis_l: Any) -> Any:
    J, n = _axes(axis, axis_x), np.cross(axis, axis_l)
    across = np.cross(n, J, axisb=0, axisc=0)
    found = J + across + np.cross(n, across, axisb=0, axisc=0) / (1 + np.dot(axis, axis_l))
    found.flags.writeable = False
    return found
