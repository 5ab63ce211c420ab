"""Laws on coordinates of joints: couplings (gear pair or belt, rack and pinion, differential, a sum of multiples that has a
value), spring, damper, load of a motor, friction under a given normal force, and stops at limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import symengine as se

from mbdae.symbolic.frames import Frame, NodeKind
from mbdae.symbolic.joint import Coupling, Reference
from mbdae.symbolic.law import Force, Impact, Structure, params
from mbdae.symbolic.law import params as declared
from mbdae.symbolic.part import Parameter
from mbdae.symbolic.variation import let, nearest_turn, rate
from mbdae.symbolic.vectors import Expr

__all__ = ["Differential", "Gear", "JointDamper", "JointFriction", "JointLoad", "JointSpring", "JointStop", "Rack",
           "WeightedSum"]


class Gear(Coupling):
    """The driven angle is `ratio` times the driving one. The ratio is negative for two wheels with external teeth, positive with
    internal teeth or a belt. Both angles are relative to the bodies k of their joints, which may be a carrier that moves. The
    multiplier is the torque on the driven coordinate, N m."""

    params = declared(ratio=("1", "driven angle over driving angle"))
    coordinates = declared(driving=("rad", "angle of the driving wheel"), driven=("rad", "angle of the driven wheel"))

    def constraints(self) -> dict[str, Expr]:
        return {"mesh": self.ratio * self.driving - self.driven}


class Rack(Coupling):
    """The rack moves by `radius` times the angle of the pinion. The multiplier is the force on the rack's displacement, N."""

    params = declared(radius=("m", "pitch radius of the pinion, negative where the rack moves backwards"))
    coordinates = declared(angle=("rad", "angle of the pinion"), displacement=("m", "displacement of the rack"))

    def constraints(self) -> dict[str, Expr]:
        return {"mesh": self.radius * self.angle - self.displacement}


class Differential(Coupling):
    """The angles of both outputs add to twice that of the carrier. The multiplier is half the torque on the carrier's coordinate,
    N m; the torque on each output is the opposite of the multiplier."""

    coordinates = declared(first=("rad", "angle of an output"), second=("rad", "angle of the other output"),
                           carrier=("rad", "angle of the carrier"))

    def constraints(self) -> dict[str, Expr]:
        return {"sum": self.first + self.second - 2 * self.carrier}


class WeightedSum(Coupling):
    """The sum of coordinates of joints, each times a factor, has a value that may depend on time. The multiplier times a factor
    is the force on the coordinate of that factor, N or N m. options: count, the number of terms."""

    params = declared(value=("rad or m", "value of the sum"))
    options = ("count",)

    def __init__(self, name: str, of: Sequence[Reference], factors: Sequence[float], value: Any = 0.0) -> None:
        super().__init__(name, {f"c{n + 1}": at for n, at in enumerate(of)}, count=len(of), value=value)
        vars(self).update({f"factor{n + 1}": float(factor) for n, factor in enumerate(factors)})

    def compose(self) -> None:
        names = [f"factor{n + 1}" for n in range(self.count)]
        self.params = {**type(self).params, **{name: Parameter("1", "factor of a coordinate") for name in names}}
        vars(self).update({name: se.Symbol(name) for name in names})
        super().compose()

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return tuple(f"c{n + 1}" for n in range(self.count))

    def constraints(self) -> dict[str, Expr]:
        terms = [getattr(self, f"factor{n + 1}") * getattr(self, name) for n, name in enumerate(self.own_coordinates)]
        return {"sum": sum(terms, se.Integer(0)) - self.value}


class OnCoordinate(Force):
    """A law on one coordinate of the joint it belongs to: computed from the frames, or an unknown of its own (kept).

    options: joint (its class), coordinate (its name), kept (whether the coordinate is an unknown of its own)."""

    options: ClassVar[tuple[str, ...]] = ("joint", "coordinate", "kept")

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return (self.name_of_coordinate,) if self.kept else ()

    @property
    def name_of_coordinate(self) -> str:
        """Name of the coordinate on which it acts: the option `coordinate`, by default the first of the joint."""
        return str(self.coordinate or next(iter(self.joint.coordinates)))

    @property
    def unit(self) -> str:
        """Unit of the coordinate, rad or m."""
        return str(self.joint.coordinates[self.name_of_coordinate].unit)

    def value(self, k: Frame, l: Frame) -> Expr:
        """Expression of the coordinate, rad or m."""
        if self.kept:
            return getattr(self, self.name_of_coordinate)
        plain = Structure(options=tuple((option, None) for option in self.joint.options))
        return self.joint.symbolic(plain).read(k, l)[self.name_of_coordinate]


class JointDamper(OnCoordinate):
    """Damping against the rate of a joint's coordinate c, with Rayleigh's function damping (dc/dt)^2 / 2; paper Eq. 19, at any
    attitude of the bodies."""

    params = params(damping=("N m s/rad or N s/m", "damping"))

    def dissipation(self, k: Frame, l: Frame) -> Expr:
        return self.damping * rate(self.value(k, l)) ** 2 / 2


class JointFriction(OnCoordinate):
    """Friction against the sliding of a joint: a coefficient times a normal force. The sliding velocity is the rate of a
    displacement, or that of an angle times `radius`, which is the lever of the force."""

    params = params(normal_force=("N", "force that presses l on k"), radius=("m", "radius at which friction acts"))
    options = (*OnCoordinate.options, "friction")
    dissipative = True

    def _lever(self) -> Expr:
        return self.radius if self.unit == "rad" else 1

    def _sliding(self, k: Frame, l: Frame) -> Expr:
        return let(self._lever() * rate(self.value(k, l)))

    def _force(self, k: Frame, l: Frame) -> Expr:
        """Friction force on l at the rubbing surface, N."""
        return let(-self.friction.coefficient(self._sliding(k, l)) * self.normal_force)

    def thrust(self, k: Frame, l: Frame) -> tuple[Expr, Expr] | None:
        return None if self.friction is None else (self.value(k, l), self._force(k, l) * self._lever())

    def losses(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {} if self.friction is None else {"friction": -self._force(k, l) * self._sliding(k, l)}

    def rates(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return dict(self.friction.rate(self._sliding(k, l)))

    def initial(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return dict(self.friction.initial(self._sliding(k, l)))


class JointLoad(OnCoordinate):
    """A torque or force on l that does work as the joint's coordinate grows, and its opposite on k."""

    params = params(load=("N m or N", "torque or force on the coordinate"))
    loads = True

    def thrust(self, k: Frame, l: Frame) -> tuple[Expr, Expr]:
        return self.value(k, l), self.load


class JointSpring(OnCoordinate):
    """Spring on a coordinate of a joint, turn after turn.

    V = stiffness (c - rest)^2 / 2 of the joint's coordinate c (angle or displacement); paper Eq. 18, at any attitude.

    In space the angle is known modulo a turn only, unless the joint keeps it as an unknown. One differential state
    follows it (its rate is the rate of the angle), its value selects the turn: no history, safe under rejected steps.
    In the plane no state is needed.
    """

    params = params(
        stiffness=("N m/rad or N/m", "stiffness"), rest=("rad or m", "coordinate without force"),
        turns=("rad", "whole turns of the start angle"),
    )
    follows = "followed"
    states = {"followed": Parameter("rad", "angle followed through all turns")}  # noqa: RUF012

    def energy(self, k: Frame, l: Frame) -> Expr:
        c = self.value(k, l)
        # Whether the frames show an angle in (-pi, pi] only.
        if self.unit == "rad" and not self.kept and NodeKind.PLANAR not in (k.kind, l.kind):
            c = nearest_turn(c, self.followed)
        return self.stiffness * (c - self.rest) ** 2 / 2

    def rates(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"followed": rate(self.value(k, l))}

    def initial(self, k: Frame, l: Frame) -> dict[str, Expr]:
        return {"followed": self.value(k, l) + self.turns}


#: excess over a limit (rad, or over the scene's length) up to which a start is accepted; a continued run may begin with more
ALLOWED = 1e-6


class _Limit(NamedTuple):
    """A limit of the coordinate. way: how far the coordinate is past it, m or rad, > 0 in contact; rate: time derivative of way;
    overlap: way where it is positive, else 0; sense: 1 for an upper, -1 for a lower limit."""

    way: Expr
    rate: Expr
    overlap: Expr
    sense: int


class JointStop(OnCoordinate):
    """Elastic stops at the limits of the joint's coordinate: one-sided springs with dampers.

    The coordinate c is past a limit by p = c - upper, or p = lower - c. Where p > 0, the force max(0, stiffness p + damping
    dp/dt) pushes it back; nothing acts elsewhere. V = stiffness p^2 / 2. As the coordinate returns, the force ends before p =
    0, since the damper would then make the stop pull; the energy V left at that instant is lost.

    An impact of an effective mass or inertia m under this force alone lasts 2 a / w, and the speed at its end is exp(-2 z a)
    times that of entry; w = sqrt(stiffness / m), z = damping / (2 m w), a = arccos(z) / sqrt(1 - z^2), or
    arcosh(z) / sqrt(z^2 - 1) where z > 1."""

    params = params(
        stiffness=("N m/rad or N/m", "stiffness"), damping=("N m s/rad or N s/m", "damping"),
        lower=("rad or m", "lower limit of the coordinate; None: there is none"),
        upper=("rad or m", "upper limit of the coordinate; None: there is none"),
    )
    dissipative = True
    timeless = True
    with_joints = True

    def _limits(self, k: Frame, l: Frame) -> list[_Limit]:
        """The limits there are, the lower one first."""
        c = let(self.value(k, l), "c")
        speed = rate(self.value(k, l))
        found = []
        for limit, sense in ((self.lower, -1), (self.upper, 1)):
            if limit is not None:
                way = let(sense * (c - limit), "p")
                overlap = let(se.Piecewise((way, way > 0), (0, True)), "a")
                found.append(_Limit(way, let(sense * speed, r"\dot p"), overlap, sense))
        return found

    def _damped(self, at: _Limit) -> Expr:
        """Force of a stop less its elastic part, N or N m, positive where it pushes the coordinate back."""
        total = let(self.stiffness * at.overlap + self.damping * at.rate)
        pressing = se.Piecewise((total, total > 0), (0, True))
        return let(se.Piecewise((pressing - self.stiffness * at.overlap, at.way > 0), (0, True)))

    def energy(self, k: Frame, l: Frame) -> Expr:
        return sum((self.stiffness * at.overlap**2 / 2 for at in self._limits(k, l)), se.Integer(0))

    def thrust(self, k: Frame, l: Frame) -> tuple[Expr, Expr] | None:
        if self.damping is None:
            return None
        return self.value(k, l), sum((-at.sense * self._damped(at) for at in self._limits(k, l)), se.Integer(0))

    def losses(self, k: Frame, l: Frame) -> dict[str, Expr]:
        if self.damping is None:
            return {}
        return {"impact": sum((self._damped(at) * at.rate for at in self._limits(k, l)), se.Integer(0))}

    # -- as a one-sided law

    def gaps(self, k: Frame, l: Frame) -> list[tuple[Expr, Expr]]:
        return [(-at.way, -at.rate) for at in self._limits(k, l)]

    def approach(self, k: Frame, l: Frame) -> list[Expr]:
        return [self.value(k, l)]

    @property
    def jumps(self) -> bool:
        return bool(self.damping)

    @property
    def gap_unit(self) -> str:
        return self.unit

    def gap_names(self) -> list[str]:
        named = (("lower", self.lower), ("upper", self.upper))
        return [f"{which} limit of {self.name_of_coordinate}" for which, limit in named if limit is not None]

    def contact_duration(self, mass: float, speed: Any) -> Any:
        if math.isinf(mass):
            return math.inf + 0 * speed
        w, _, a = self._impact(mass)
        return 2 * a / w + 0 * speed

    def restitution(self, mass: float) -> float:
        """Speed after an impact of an effective mass or inertia (kg, kg m^2) over that before."""
        _, z, a = self._impact(mass)
        return math.exp(-2 * z * a)

    def _impact(self, mass: float) -> tuple[float, float, float]:
        """w, z and a of an impact (see the class)."""
        w = math.sqrt(self.stiffness / mass)
        z = (self.damping or 0.0) / (2 * mass * w)
        if abs(z - 1) < 1e-6:
            return w, z, 1.0
        return w, z, math.acos(z) / math.sqrt(1 - z * z) if z < 1 else math.acosh(z) / math.sqrt(z * z - 1)

    def expected_depth(self, impact: Impact) -> float:
        if math.isinf(impact.mass):
            return math.inf
        w, z, a = self._impact(impact.mass)
        return impact.likely_speed / w * math.exp(-z * a)

    def elastic_load(self, depth: float) -> tuple[float, float]:
        return self.stiffness * depth, self.stiffness * depth**2 / 2

    def summary_of_contact(self) -> str:
        low, high = ("none" if limit is None else f"{limit:.6g}" for limit in (self.lower, self.upper))
        unit = "N m/rad" if self.unit == "rad" else "N/m"
        turns = ", an unknown of its own so that whole turns count" if self.unit == "rad" else ""
        return f"limits ({low}, {high}) {self.unit} of {self.name_of_coordinate}{turns}, stop of {self.stiffness:.3g} {unit}"

    def refuses_start(self, depth: float, size: float, continued: bool) -> str:
        if continued or depth <= ALLOWED * size:
            return ""
        low, high = ("none" if limit is None else f"{limit:.6g}" for limit in (self.lower, self.upper))
        return (f"its {self.name_of_coordinate} is outside its limits ({low}, {high}) {self.unit}: start it inside them, or "
                f"draw the scene so")
