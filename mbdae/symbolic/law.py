"""The Law contract: one symbolic statement per joint, force or element.

A law declares its parameters with units and states one or more of

    motion(from_k)     -> chain of motions         joints (`symbolic/joint.py`): what their coordinates leave free
    constraints(k, l)  -> {row name: expression}   rows g = 0; reactions follow by virtual work
    energy(k, l)       -> expression               potential energy, J
    dissipation(k, l)  -> expression               Rayleigh function (half the dissipated power), W
    wrench(k, l)       -> (force, torque)          applied on l at l.r, the opposite on k at the same point
    thrust(k, l)       -> (expression, force)      a generalised force on what the expression measures
    resistance(k, l, reactions) -> (force, torque) joints only: as `wrench`, by the joint's own reactions; it dissipates
    observed(k, l)     -> {name: expressions}      sensor values in addition to force, torque and power
    losses(k, l)       -> {cause: power}           its dissipated power by cause, W
    gaps(k, l)         -> [(gap, rate)]            one-sided laws: distances (m or rad) that act where negative, and rates
    kinetic_energy(b)  -> expression               elements only, J

on abstract frames (`symbolic/frames.py`), of k and l or of as many bodies as `frames` names. Everything else is derived: forces,
Jacobians, planar and grounded variants, kernels. A parameter is a number, a function of time, or None: absent from the statement.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from inspect import signature
from math import inf, pi
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import symengine as se

from mbdae.errors import LawError, unknown_name
from mbdae.symbolic.class_checks import PLACES, check_class
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.part import Exactly, Parameter, Part, PartStructure, exact, params
from mbdae.symbolic.statement import NO_FEEDS, Feeds
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.values import shown

__all__ = ["AUGMENTED", "Element", "Force", "Law", "Parameter", "Structure", "TwoBodyLaw", "params"]

#: V = scaling lambda.c + penalty c.c of constraint rows c (Eq. 2 of validation/paper); force: scaling lambda + 2 penalty c
AUGMENTED = params(scaling=("1", "factor of the rows and their multipliers"), penalty=("N m", "factor of the squared rows"))


@dataclass(frozen=True, eq=False)
class Structure(Exactly):
    """What tells two statements of one class apart but for numbers: options, absent or timed parameters, feedback."""

    absent: frozenset[str] = frozenset()
    timed: frozenset[str] = frozenset()
    options: tuple[tuple[str, Any], ...] = ()
    feeds: Feeds = NO_FEEDS

    @cached_property
    def key(self) -> tuple[Any, ...]:
        """Absent and timed parameters, options, feedback."""
        return self.absent, self.timed, exact(self.options), self.feeds


class Law:
    """A law with its parameter values. Attributes named in `params` and `options` hold them."""

    params: Mapping[str, Parameter] = MappingProxyType({})
    options: ClassVar[tuple[str, ...]] = ()  #: attributes that change the statement itself (classes, flags, parts)
    states: Mapping[str, Parameter] = MappingProxyType({})
    frames: ClassVar[tuple[str, ...]] = ()  #: names of the bodies' frames on which the law is stated
    axes_of: ClassVar[str] = "axis"  #: source of the frames' axes: z along the item's "axis", or the axes of body "k" or "l"
    timeless: ClassVar[bool] = False  #: whether its parameters have to be numbers, not expressions of time, sensors, controllers
    at_nodes: ClassVar[bool] = False  #: whether the law acts at its bodies' nodes along inertial axes, so that `axis` is not used
    loads: ClassVar[bool] = False  #: whether it is a load: an equilibrium applies it step by step, a joint has a sensor of it
    dissipative: ClassVar[bool] = False  #: whether the power of the law's `wrench` counts as dissipated rather than as work
    #: whether bodies may stick by the law, as by friction (the equations are then stiff); None: they may if it has internal
    #: states of its own in use, other than `follows`. Its parts are asked in any case
    sticks: ClassVar[bool | None] = None
    follows: ClassVar[str] = ""  #: name of the internal state that follows the joint's angle to count whole turns, if any
    keeps_states: ClassVar[bool] = False  #: whether its states are unknowns although nothing that it states depends on them
    elastic: ClassVar[bool] = False  #: whether its stiffness is a body's own, over whose fast vibrations steps may pass

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        check_class(cls, ("name", "k", "l", *PLACES))

    def __init__(self, name: str, **values: Any) -> None:
        self.name = name
        known = {*self.params, *self.options}
        unknown = sorted(set(values) - known)
        if unknown:
            name_and_closest = unknown_name(unknown[0], {*known, *signature(type(self)).parameters})
            own = sorted(known - self.derived())
            raise LawError(f"{type(self).__name__} {shown(name)}: unknown parameter {name_and_closest} it has "
                           f"{', '.join(own) or 'none'}")
        for key in known:
            setattr(self, key, values.get(key))
        self.compose()

    def compose(self) -> None:
        """Add the parameters of the law's parts, named "<option>_<parameter>", and the states of law and parts."""
        for key in self.options:
            part = getattr(self, key)
            if isinstance(part, Part):
                self.params = {**self.params, **{f"{key}_{p}": spec for p, spec in part.params.items()}}
                for p in part.params:
                    setattr(self, f"{key}_{p}", getattr(part, p))
        self.states = self.own_states()

    def own_states(self) -> Mapping[str, Parameter]:
        """Internal states of this law and of its parts."""
        return {**self.states, **{name: spec for part in self.parts for name, spec in part.states.items()}}

    @property
    def parts(self) -> list[Part]:
        """The exchangeable parts among the options: friction laws, normal laws."""
        return [part for part in (getattr(self, key) for key in self.options) if isinstance(part, Part)]

    def may_stick(self, states: Collection[str]) -> bool:
        """Whether bodies may stick by this law or a part of it. states: names of the internal states in use."""
        own = any(name in type(self).states and name != self.follows for name in states) if self.sticks is None else self.sticks
        return own or any(part.may_stick() for part in self.parts)

    def state_scales(self) -> Mapping[str, float]:
        """Typical magnitude of an internal state in its unit, where it is not 1; tolerances are relative to it."""
        return {name: scale for part in self.parts for name, scale in part.state_scales().items()}

    if TYPE_CHECKING:
        def __getattr__(self, name: str) -> Any:
            """Parameters, options and states are attributes by name."""

    def structure(self, timed: frozenset[str] = frozenset()) -> Structure:
        """Which of the parameters are absent, which depend on time, and the options."""
        absent = frozenset(key for key in self.params if getattr(self, key) is None)
        chosen = {key: getattr(self, key) for key in self.options}
        return Structure(absent, timed, tuple((k, v.structure() if isinstance(v, Part) else v) for k, v in chosen.items()))

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        """Names of the joint coordinates that are unknowns of this law; attributes of those names hold them in a derivation."""
        return ()

    def coordinates_in(self, item: str) -> list[tuple[str, str]]:
        """(joint, name) of every coordinate that is an unknown of this law. item: name of the joint to which the law belongs."""
        return [(item, name) for name in self.own_coordinates]

    @classmethod
    def symbolic(cls, structure: Structure) -> Any:
        """The law with symbols for values, from which everything is derived."""
        law = object.__new__(cls)
        law.name = cls.__name__
        for key in cls.params:
            setattr(law, key, None if key in structure.absent else se.Symbol(key))
        for key, value in structure.options:
            setattr(law, key, value.symbolic(key) if isinstance(value, PartStructure) else value)
        law.compose()
        for key in law.states:
            setattr(law, key, se.Symbol(f"state_{key}"))
        return law

    def undefined_at(self) -> tuple[str, ...]:
        """States in which the law has no value: of "half turn", "points together", "some places" (`mb.selftest` draws none)."""
        return ()

    def rows(self, *frames: Frame) -> dict[str, Expr]:
        """All constraint rows of the law, expressions that vanish, by name."""
        return {}

    def velocity_constraints(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        """Expressions that are linear in the velocities of the frames and vanish, by name: rows of velocities."""
        return {}

    @classmethod
    def derived(cls) -> frozenset[str]:
        """Parameters and options that the law has without declaring them."""
        return frozenset()

    @classmethod
    def drives(cls) -> dict[str, str]:
        """{name of the row that prescribes a coordinate: the coordinate}."""
        return {}

    def read(self, *frames: Frame) -> dict[str, Expr]:
        """The coordinates of a joint as expressions of its frames, by name."""
        return {}

    def positives(self, *frames: Frame) -> dict[str, Expr]:
        """Expressions that must be positive, where the rows alone admit a second solution, by name."""
        return {}

    def rates(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        """Time derivative of every internal state."""
        return {}

    def initial(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        """Start value of every internal state."""
        return {}


class TwoBodyLaw(Law):
    """A law between two bodies, or as many as `frames` names.

    k, l: bodies or places. at: point (3,) at which it acts on all bodies, m; at_l: its point on l, where that is another one.
    axis, axis_x: directions (3,) of the frames' z and x (None: any normal to z); axis_l, axis_x_l: those of l, where others. As
    drawn. Bodies of further frames are given by their names, points other than `at` by `at_<name>`."""

    frames: ClassVar[tuple[str, ...]] = ("k", "l")

    def __init__(self, name: str, k: Any, l: Any, at: Any = None, axis: Any = (0, 0, 1), at_l: Any = None, axis_x: Any = None,
                 axis_l: Any = None, axis_x_l: Any = None, **values: Any) -> None:
        for side in self.frames[2:]:
            if side not in values:
                raise LawError(f"{type(self).__name__} {shown(name)}: the body of its frame '{side}' is missing; add {side}= "
                               f"with a body or a place")
            setattr(self, side, values.pop(side))
        self.points = {side: values.pop(f"at_{side}") for side in self.frames[2:] if values.get(f"at_{side}") is not None}
        super().__init__(name, **values)
        self.k, self.l, self.at, self.axis, self.axis_x = k, l, at, axis, axis_x
        self.at_l, self.axis_l, self.axis_x_l = at_l, axis_l, axis_x_l

    def point_on(self, side: str) -> Any:
        """The point (3,), m, as drawn, at which the law acts on the body of a frame."""
        found = self.at_l if side == "l" else self.points.get(side)
        return self.at if found is None else found


SLOW = 1e-2  #: bodies are expected to move in the characteristic time by at least this fraction of the scene's size


class Impact(NamedTuple):
    """What is known of a contact before the run, in m and kg, or in rad and kg m^2.

    mass: smallest effective mass of an impact; speed: of the two sides relative to each other, m/s or rad/s; force: of the
    ideal joint in its place, N or N m, 0 where it is not known; gap: the smallest; size: the scene's length, or 1 rad; time:
    characteristic time of the motion, s."""

    mass: float
    speed: float
    force: float
    gap: float
    size: float
    time: float

    @property
    def likely_speed(self) -> float:
        """The largest of the speed at the start, the speed that closes the gap in `time`, and the part `SLOW` of the speed that
        crosses the whole scene in `time`."""
        return max(self.speed, self.gap / self.time, SLOW * self.size / self.time)


class Force(TwoBodyLaw):
    """A law between bodies stated by `energy`, `dissipation`, `wrench` or `thrust`."""

    external: ClassVar[bool] = False  #: whether the force acts on l from outside: k is then the ground

    def energy(self, *frames: Any, **_: Any) -> Expr:
        """Potential energy, J."""
        return se.Integer(0)

    def dissipation(self, *frames: Any, **_: Any) -> Expr:
        """Rayleigh dissipation function: half the dissipated power, W."""
        return se.Integer(0)

    def wrench(self, *frames: Any, **_: Any) -> tuple[Vec, Vec] | None:
        """Force (N) on l at l.r and torque (N m) on l, inertial frame."""
        return None

    def thrust(self, *frames: Any, **_: Any) -> tuple[Expr, Expr] | None:
        """An expression of the motion, a length or an angle, and the generalised force (N or N m) that does work as it grows."""
        return None

    def observed(self, *frames: Any, **_: Any) -> dict[str, list[Expr]]:
        """Quantities that sensors show in addition to force, torque and power, by name."""
        return {}

    must_stay: ClassVar[Mapping[str, str]] = MappingProxyType({})  #: observed quantities -> warning where one is negative

    def losses(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        """Its dissipated power by cause ("impact", "friction"), W; the rest counts as "other"."""
        return {}

    # -- of a one-sided law
    with_joints: ClassVar[bool] = False  #: whether bodies that joints tie to its bodies count in the effective mass of an impact

    @property
    def has_gaps(self) -> bool:
        """Whether the law states `gaps`."""
        return type(self).gaps is not Force.gaps

    def gaps(self, *frames: Any, **_: Any) -> Sequence[tuple[Expr, Expr]]:
        """Gaps (m or rad, it acts where one is negative) and their rates."""
        return ()

    def approach(self, *frames: Any, **_: Any) -> Sequence[Expr]:
        """Relative displacements (m), or the angle (rad), along which the law may act: its effective mass in an impact is the
        smallest along these."""
        return ()

    @property
    def jumps(self) -> bool:
        """Whether its force jumps where a gap closes."""
        return False

    @property
    def gap_unit(self) -> str:
        """Unit of its gaps: m, or rad, where masses are inertias (kg m^2) and speeds in rad/s."""
        return "m"

    def gap_names(self) -> Sequence[str]:
        """Words for each gap that messages add to the name of the item; empty where that name suffices."""
        return ()

    def contact_duration(self, mass: float, speed: Any) -> Any:
        """How long an impact of an effective mass (kg or kg m^2) at a speed (m/s or rad/s, array) lasts, s."""
        return float("inf") + 0 * speed

    def expected_depth(self, impact: Impact) -> float:
        """Penetration (m or rad) expected before the run; by default that of a linear spring with its `contact_duration`."""
        duration, speed = float(self.contact_duration(impact.mass, impact.likely_speed)), impact.likely_speed
        return speed * duration / pi if speed > 0 else inf

    def elastic_load(self, depth: float) -> tuple[float, float] | None:
        """Elastic force (N or N m) and energy (J) of a penetration; None: not known."""
        return None

    def summary_of_contact(self) -> str:
        """The contact in a few words, for `check()` and reports."""
        return type(self).__name__

    def refuses_start(self, depth: float, size: float, continued: bool) -> str:
        """Why a start that penetrates by a depth (m or rad) is refused, and the remedy; "" where it is not. size: the scene's
        length (m), or 1 rad; continued: whether the start is the end of another run."""
        return ""

    def doubtful_depth(self) -> tuple[float, str, str]:
        """Penetration (m or rad) beyond which the law is no model of the contact, what that depth is, and what may be wrong."""
        return inf, "", ""

    def instability(self, mass: float, depth: Any, force: Any, rub: Any) -> tuple[Any, Any] | None:
        """Growth rate (1/s, at most 0 where stable) and frequency (rad/s) of small motions across the contact, (nt,) each, for an
        effective mass (kg), penetrations (m), normal and friction forces (N) (nt,); None: it cannot become unstable."""
        return None


class Element(Law):
    """A body: its node's frame carries a kinetic energy."""

    frames: ClassVar[tuple[str, ...]] = ("b",)

    def kinetic_energy(self, b: Frame) -> Expr:
        """Kinetic energy in `b.center_velocity` and `b.spin` (body components), J."""
        raise LawError(f"element law {type(self).__name__} does not state `kinetic_energy(self, b)`: return its energy, J")
