"""What carries unknowns: elements with one node (point mass, rigid body, node of a beam, the coordinate of a joint as an unknown
of its own), states of control that are integrated with the motion, outputs of sampled controllers held between two instants; and
expressions of sensors that controllers, events and loads read.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar

import symengine as se

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element, Force, TwoBodyLaw, params
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.part import Parameter
from mbdae.symbolic.variation import rate
from mbdae.symbolic.vectors import Expr

__all__ = ["BeamNode", "JointCoordinate", "PointMass", "RigidBody"]

ORDERS = (1, 2, 3, 4)  #: of the interpolation along elements of beams


class PointMass(Element):
    """Point mass: position only.

    T = m v.v / 2."""

    params = params(mass=("kg", "mass"))

    def kinetic_energy(self, b: Frame) -> Expr:
        return self.mass * (b.center_velocity @ b.center_velocity) / 2


class RigidBody(Element):
    """Rigid body with its node at the centre of mass.

    T = m v.v / 2 + Omega.J Omega / 2 with J about the centre of mass in body axes."""

    params = params(
        mass=("kg", "mass"),
        Jxx=("kg m^2", "moment of inertia about body x"), Jyy=("kg m^2", "about body y"), Jzz=("kg m^2", "about body z"),
        Jxy=("kg m^2", "product of inertia, element xy of the matrix"),
        Jxz=("kg m^2", "element xz"), Jyz=("kg m^2", "element yz"),
    )

    def kinetic_energy(self, b: Frame) -> Expr:
        v, (p, q, r) = b.center_velocity, b.spin
        energy = self.mass * (v @ v) / 2 + (self.Jxx * p * p + self.Jyy * q * q + self.Jzz * r * r) / 2
        if self.Jxy is not None:
            energy += self.Jxy * p * q + self.Jxz * p * r + self.Jyz * q * r
        return energy


class JointCoordinate(Element):
    """An unknown of its own: its equation of motion says that the forces on it add to zero, or to what a rotor needs that moves
    with it alone.

    T = rotor c'^2 / 2 of a coordinate c."""

    params = params(rotor=("kg m^2 or kg", "inertia of the coordinate's own, such as a motor's times its gear ratio squared"))

    def kinetic_energy(self, b: Frame) -> Expr:
        return se.Integer(0) if self.rotor is None else self.rotor * b.center_velocity[0] ** 2 / 2


class BeamNode(Element):
    """A node without inertia of its own: the mass of a beam is consistent, spread over the nodes of its elements."""

    def kinetic_energy(self, b: Frame) -> Expr:
        return se.Integer(0)


class InternalState(TwoBodyLaw):
    """A state of a controller, filter or actuator, integrated with the motion.

    d value / dt = rate. The law acts on no bodies; its rate is an expression of sensors."""

    frames = ()
    params = params(rate=("1/s", "time derivative"), start=("1", "value at the start"), size=("1", "typical magnitude"))
    states = {"value": Parameter("1", "value")}  # noqa: RUF012
    keeps_states = True
    sticks = False

    def __init__(self, name: str, **values: Any) -> None:
        super().__init__(name, None, None, **values)

    def rates(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": self.rate}

    def initial(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": self.start}

    def state_scales(self) -> dict[str, float]:
        return {"value": float(self.size)}


class HeldOutput(InternalState):
    """A state that is constant between the instants at which a sampled controller sets it."""

    def rates(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {"value": se.Integer(0)}


class Observed(TwoBodyLaw):
    """A value that is computed and exerts no force."""

    frames = ()
    params = params(value=("1", "what is observed"))

    def __init__(self, name: str, **values: Any) -> None:
        super().__init__(name, None, None, **values)


def observed_value(d: Derived) -> list[tuple[Target, Expr]]:
    """The value as an output of the law's kernel; none for other laws."""
    return [(("observed",), se.Symbol("value"))] if isinstance(d.law, Observed) else []


class _ByModes(TwoBodyLaw):
    """A law by the coordinates of the modes of a reduced body, and of its displacements of the second order, unknowns of the
    joint `of`: c1, c2, ..., m. options: their numbers, count and bends."""

    options: ClassVar[tuple[str, ...]] = ("count", "bends")
    #: names and units of its vectors by modes: parameters "<name>_<axis>_<mode>"
    vectors: ClassVar[Mapping[str, str]] = MappingProxyType({})

    def __init__(self, name: str, of: str, numbers: Mapping[str, float], **values: Any) -> None:
        super().__init__(name, **values)
        self.of = of
        vars(self).update(numbers)

    def compose(self) -> None:
        self.params = {**type(self).params, **self.by_numbers()}
        vars(self).update({p: se.Symbol(p) for p in self.params})
        super().compose()

    def by_numbers(self) -> dict[str, Parameter]:
        """The parameters whose number is that of modes."""
        return {f"{v}_{a}_{n + 1}": Parameter(unit, f"{v} of a mode along {a}") for v, unit in self.vectors.items()
                for a in "xyz" for n in range(self.count + self.bends)}

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return tuple(f"c{n + 1}" for n in range(self.count + self.bends))

    def coordinates_in(self, item: str) -> list[tuple[str, str]]:
        return [(self.of, name) for name in _names(self.count, self.bends)]

    def by_modes(self, vector: str) -> list[Expr]:
        """Sum (3) over the modes of coordinate times shape, in axes of the floating frame."""
        return [sum((getattr(self, f"{vector}_{a}_{n + 1}") * getattr(self, c) for n, c in enumerate(self.own_coordinates)),
                    se.Integer(0)) for a in "xyz"]


class InertiaPoint(_ByModes):
    """A point mass l that moves with the floating frame k and as the body deforms."""

    vectors: ClassVar[Mapping[str, str]] = MappingProxyType({"shape": "1"})

    def rows(self, *frames: Frame) -> dict[str, Expr]:
        k, l = frames[:2]
        x, y, z = self.by_modes("shape")
        off = l.r - k.r - k.x * x - k.y * y - k.z * z
        return dict(zip("xyz", off, strict=True))


class InterfaceOfBody(InertiaPoint):
    """An interface l of a reduced body: it moves with the floating frame k and by the displacement and rotation of the modes."""

    vectors: ClassVar[Mapping[str, str]] = MappingProxyType({"shape": "1", "turn": "rad/m"})

    def rows(self, *frames: Frame) -> dict[str, Expr]:
        k, l = frames[:2]
        turned = self.by_modes("turn")
        sine = [(l.y @ k.z - l.z @ k.y) / 2, (l.z @ k.x - l.x @ k.z) / 2, (l.x @ k.y - l.y @ k.x) / 2]
        return super().rows(k, l) | {f"turn_{a}": s - t for a, s, t in zip("xyz", sine, turned, strict=True)}


class SecondDisplacement(_ByModes):
    """The displacement of the second order by the modes, the coordinate `bend` of the joint `of`: b = sum bend_ik c_i c_k / 2."""

    options = ("count",)

    def __init__(self, name: str, of: str, bend: str, numbers: Mapping[str, float], **values: Any) -> None:
        super().__init__(name, of, numbers, **values)
        self.bend = bend

    def by_numbers(self) -> dict[str, Parameter]:
        return {f"bend_{i + 1}_{k + 1}": Parameter("1/m", "second derivative of the displacement")
                for i in range(self.count) for k in range(i + 1)}

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return (*_names(self.count, 0, "c"), "b")

    def coordinates_in(self, item: str) -> list[tuple[str, str]]:
        return [(self.of, name) for name in (*_names(self.count, 0), self.bend)]

    def rows(self, *frames: Frame) -> dict[str, Expr]:
        c = [getattr(self, name) for name in self.own_coordinates]
        both = [c[i] * c[k] / (1 + (i == k)) * getattr(self, f"bend_{i + 1}_{k + 1}")
                for i in range(self.count) for k in range(i + 1)]
        return {"bend": sum(both, se.Integer(0)) - c[-1]}


class ModalElasticity(Force):
    """V = stiffness c^2 / 2, and half the dissipated power damping c'^2 / 2, of the coordinate c of a mode."""

    params = params(stiffness=("N/m", "modal stiffness"), damping=("N s/m", "modal damping"))
    frames = ()
    elastic = True

    def __init__(self, name: str, of: tuple[str, str], **values: Any) -> None:
        super().__init__(name, **values)
        self.of = of

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return ("c",)

    def coordinates_in(self, item: str) -> list[tuple[str, str]]:
        return [self.of]

    def energy(self, *frames: Any, **_: Any) -> Expr:
        return self.stiffness * self.c**2 / 2

    def dissipation(self, *frames: Any, **_: Any) -> Expr:
        return se.Integer(0) if self.damping is None else self.damping * rate(self.c) ** 2 / 2


class Modes(Joint):
    """Coordinates of the modes of a reduced body, which its further laws tie to its interfaces and to its inertia. `reduced`: the
    body; `ratio`: of the damping of its modes to critical damping, or a tuple of them."""

    reduced: Any = None
    ratio: Any = 0.0

    def constraints(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {}

    @classmethod
    def freedoms(cls) -> int:
        """As of a joint that constrains nothing."""
        return 6

    def remarks(self) -> list[str]:
        return [self.reduced.summary]


def with_modes(connections: Iterable[Any]) -> list[Any]:
    """Those connections of a scene that keep the modes of its reduced bodies."""
    return [c for c in connections if isinstance(c.joint, Modes)]


def _names(count: int, bends: int, mode: str = "mode") -> list[str]:
    return [f"{mode}{n + 1}" for n in range(count)] + [f"bend{n + 1}" for n in range(bends)]


@cache
def modes_of_body(count: int, bends: int = 0) -> type[Modes]:
    """The class of items that have the coordinates of `count` modes, and of `bends` displacements of the second order."""
    meaning = ("coordinate of a mode", "displacement of the second order by the modes")
    named = params(**{name: ("m", meaning[n >= count]) for n, name in enumerate(_names(count, bends))})
    return type(f"Modes__{count}_{bends}", (Modes,), {"coordinates": named, "__module__": __name__, "__doc__": Modes.__doc__})


def __getattr__(name: str) -> Any:
    """Classes of modes by their names, as pickles ask for them."""
    head, _, numbers = name.partition("__")
    counts = numbers.split("_")
    if head != "Modes" or len(counts) != 2 or not all(n.isdigit() for n in counts):
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return modes_of_body(*map(int, counts))
