"""A law evaluated with recorded vectors, together with the same law derived in components as it is integrated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import symengine as se

from mbdae.errors import LawError, OptionError, unknown_name
from mbdae.laws.contact import Hertz
from mbdae.laws.friction import Coulomb, LuGre
from mbdae.laws.joints import Revolute
from mbdae.laws.surfaces import SurfaceContact
from mbdae.reports.calculus import Dual, ForwardDerivative, Pair, actual, virtual
from mbdae.reports.letters import specs_of_coordinates
from mbdae.reports.vectors import NamedQuantities, Vector
from mbdae.symbolic.derive import Derived, Side, derive
from mbdae.symbolic.frames import Axes, Frame, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import AUGMENTED, Force, Law, Structure
from mbdae.symbolic.motion import Rotation
from mbdae.symbolic.part import Part, PartStructure
from mbdae.symbolic.rebuild import rebuilt
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.values import flag, option, shown

#: default options of laws in a report of a class
OPTIONS: dict[str, Any] = {
    "joint": Revolute,
    "coordinate": None,
    "kept": False,
    "rubs": None,
    "count": 2,
    "following": False,
    "tilting": False,
    "normal": Hertz(1, damping=1).structure(),
    "friction": LuGre(0.3, 0.5, 1e-3, 1e5, 300.0, 0.1).structure(),
}
DRY = Coulomb(0.3, 1e-3).structure()


def check_kind(name: str, value: Any, typical: Any) -> None:
    """OptionError for an option of another kind than its typical value: a switch, a class of laws, a friction or normal law."""
    if isinstance(typical, bool):
        option(name, value, flag, "give True or False")
    elif isinstance(typical, type) and not (isinstance(value, type) and issubclass(value, Law)):
        raise OptionError(f"{name} = {shown(value)} is not a class of a law: give one such as mb.{typical.__name__}")
    elif isinstance(typical, PartStructure) and not isinstance(value, Part | PartStructure | None):
        raise OptionError(f"{name} = {shown(value)} is no {name} law: give one such as mb.{typical.cls.__name__}(...)")


def structure_of(law: type[Law], options: Mapping[str, Any]) -> Structure:
    """Structure of a law class in a report: all parameters but scaling and penalty; a prescribed motion is a function of time."""
    missing = [name for name in law.options if name not in options and name not in OPTIONS]
    if missing:
        name = missing[0]
        raise LawError(f"{law.__name__} needs a value of its option '{name}': say mb.report({law.__name__}, {name}=...)")
    given = {name: v for name, v in options.items() if name in law.params}
    for name in (name for name, v in given.items() if v is not None):
        raise LawError(f"{law.__name__}: {name} = {shown(given[name])}: the report of a class shows letters, no values; leave "
                       f"{name} out, or give None for a law without it")
    options = {name: v for name, v in options.items() if name not in given}
    unknown = sorted(set(options) - set(law.options))
    if unknown:
        name_and_closest = unknown_name(unknown[0], [*law.options, *law.params])
        raise LawError(f"{law.__name__} has no option or parameter {name_and_closest} options: "
                       f"{', '.join(sorted(law.options)) or 'none'}; parameters, None for a law "
                       f"without one: {', '.join(law.params) or 'none'}")
    for name, value in options.items():
        check_kind(name, value, OPTIONS.get(name))
    chosen = {name: options.get(name, _default(law, name, options)) for name in law.options}
    _check_coordinates(law, chosen)
    fixed = tuple((name, v.structure() if isinstance(v, Part) else v) for name, v in chosen.items())
    absent = frozenset(AUGMENTED) & frozenset(law.params) if issubclass(law, Joint) else frozenset()
    return Structure(absent | frozenset(given), frozenset(law.drives()) - frozenset(given), fixed)


def _default(law: type[Law], name: str, options: Mapping[str, Any]) -> Any:
    """Default of an option in a report: no friction in a joint, coordinates as unknowns only where the joint needs them."""
    if name == "kept":
        return _joint_of(law, options).must_keep()
    if name == "friction" and issubclass(law, SurfaceContact):
        return DRY  # bristle models exist only for sliding along one direction
    return None if name == "friction" and issubclass(law, Joint) else OPTIONS.get(name)


def _joint_of(law: type[Law], options: Mapping[str, Any]) -> type[Joint]:
    """The joint itself, or the joint on whose coordinate a force acts."""
    joint: type[Joint] = law if issubclass(law, Joint) else options.get("joint", OPTIONS["joint"])
    return joint


def _check_coordinates(law: type[Law], chosen: Mapping[str, Any]) -> None:
    """OptionError for options naming coordinates that the joint lacks, and for a joint without the coordinates they need."""
    if "kept" not in chosen:
        return
    joint = _joint_of(law, chosen)
    if not chosen["kept"] and joint.must_keep():
        raise OptionError(f"kept = {shown(chosen['kept'])}: {joint.__name__} is stated by its coordinates alone, so that they "
                          f"are unknowns in every joint model; give kept=True")
    for name in ("coordinate", "rubs"):
        if chosen.get(name) is not None and chosen[name] not in joint.scalars():
            if not joint.scalars():
                raise OptionError(f"{name} = {shown(chosen[name])}: {joint.__name__} has no angle or displacement; leave "
                                  f"{name} out")
            raise OptionError(f"{name} = {shown(chosen[name])}: {joint.__name__} has no such coordinate; give one of "
                              f"{', '.join(sorted(joint.scalars()))}")
    if joint.scalars():
        return
    if not issubclass(law, Joint):
        raise OptionError(f"joint = {shown(chosen['joint'])}: {joint.__name__} has no angle or displacement on which "
                          f"{law.__name__} could act; give a joint with one, such as joint=mb.Revolute")
    if chosen["friction"] is not None:
        raise OptionError(f"friction = {shown(chosen['friction'])}: {joint.__name__} has no angle or displacement against which "
                          f"friction could act; leave friction out")


def sides_of(law: type[Law], planar: bool = False) -> tuple[Side, ...]:
    """Kind and axes of each frame of a law; the first frame of an external load is on the ground."""
    kind, axes = (NodeKind.PLANAR, Axes.NORMAL) if planar else (NodeKind.SPATIAL, Axes.GENERAL)
    outside = issubclass(law, Force) and law.external
    ground = NodeKind.PLANAR_GROUND if planar else NodeKind.GROUND
    return tuple((ground if outside and not i else kind, axes) for i in range(len(law.frames)))


def derived(law: type[Law], structure: Structure, planar: bool = False) -> Derived:
    """The law derived in components, as it is integrated."""
    instance = law.symbolic(structure)
    units = specs_of_coordinates(instance)
    kinds = [NodeKind.ROTATION if units[name].unit == "rotation" else NodeKind.COORDINATE for name in instance.own_coordinates]
    sides: tuple[Side, ...] = (*sides_of(law, planar), *((kind, Axes.GENERAL) for kind in kinds))
    return derive(law, structure, sides)


class ReportedLaw:
    """A law evaluated with recorded vectors; `derived`: the law as it is integrated, `still`: names of fixed frames.

    planar: all vectors lie in the plane and rotations are angles."""

    def __init__(self, law: type[Law], structure: Structure, planar: bool = False) -> None:
        self.cls, self.structure, self.planar = law, structure, planar
        self.derived = derived(law, structure, planar)
        self.law = law.symbolic(structure)
        own = dict(zip(self.law.own_coordinates, self.derived.frames[len(law.frames) :], strict=True))
        self.places = {name: c.side for name, c in own.items()}  #: frames of the coordinates that are unknowns, by coordinate
        scalars = {name: c for name, c in own.items() if c.kind is NodeKind.COORDINATE}
        #: frames of the free rotations that are unknowns, by coordinate
        self.turning = {name: c.side for name, c in own.items() if name not in scalars}
        self.record = NamedQuantities((*law.frames, *self.turning.values()))
        self.record.resolve, self.record.flat = self.names, planar
        self.frames = tuple(self._frame(side, *kind) for side, kind in zip(law.frames, sides_of(law, planar), strict=True))
        #: names of the frames on which the law is stated, without those of free rotations that are unknowns
        self.sides = law.frames
        self.still = tuple(f.side for f in self.frames if not f.kind.moves)
        #: symbol of every coordinate of the law (an angle or displacement) that is an unknown itself, by name
        self.coordinates: dict[str, Expr] = {name: c.q[0] for name, c in scalars.items()}
        rotations = {name: self._rotation(own[name]) for name in self.turning}
        self.values = self.coordinates | rotations  #: symbols of every coordinate that is an unknown, by name
        vars(self.law).update(self.values)
        self.clock = self.derived.variation.clock | {c.q[0]: c.u[0] for c in scalars.values()}
        self.virtual = {c.q[0]: se.Symbol(f"d{c.q[0]}") for c in scalars.values()}  #: virtual changes of the coordinates
        #: rotation angles of the moving frames in the plane
        self.headings = {f.side: f.heading for f in self.frames if planar and f.kind.moves}
        self.clock |= {h: se.Symbol(f"{side}_w3") for side, h in self.headings.items()}
        self.virtual |= {h: se.Symbol(f"dpsi_{side}") for side, h in self.headings.items()}

    def _frame(self, side: str, kind: NodeKind, axes: Axes) -> Frame:
        a = self.record.atom
        zero = self.record.zero()
        r, s, v, w = (a(n, side) for n in "rsvw") if kind.moves else (a("r", side), zero, zero, zero)
        center = a("c", side) if kind.moves else r
        z, normal = a("z", side), self.record.axis(2)
        if self.planar:
            z, w = normal, normal * se.Symbol(f"{side}_w3") if kind.moves else zero
        own, fixed = [a(b, side) for b in ("bx", "by", "bz")], [self.record.axis(i) for i in range(3)]
        body = (own[0], own[1], own[2]) if kind.moves else (fixed[0], fixed[1], fixed[2])
        spin = Vec(*(se.Symbol(f"{side}_W{i + 1}") for i in range(3)))
        heading = se.Symbol(f"{side}_h") if kind.moves else se.Integer(0)
        return Frame(side, kind, axes, r, v, a("x", side), a("y", side), z, w, center, v - w.cross(s), s, body, heading, spin,
                     [], [], [], {}, {})

    def _rotation(self, c: Frame) -> Rotation:
        """A free rotation whose turned axes are recorded vectors."""
        x, y, z = (self.record.atom(axis, c.side) for axis in ("bx", "by", "bz"))
        return Rotation(tuple(c.q), (x, y, z), c.spin)

    @staticmethod
    def symbol(name: str) -> Expr:
        """The symbol of a coordinate that is not an unknown."""
        return se.Symbol(name)

    # -- quantities that the law states, with names for intermediate results

    def names(self, e: Any) -> Expr:
        """A scalar with `let`, `rate`, angles and turn counts replaced by names."""
        name = self.record.name_scalar

        def rule(node: Expr, args: list[Expr]) -> Expr | None:
            kind = node.get_name() if isinstance(node, se.FunctionSymbol) else ""
            if kind == "let":
                return name(args[0], str(args[1]) if len(args) > 1 else "")
            if kind == "rate":
                return name(self.motion.scalar(args[0]))
            if isinstance(node, se.atan2):
                return name(se.atan2(*map(name, args)))
            return name(node.func(*args)) if isinstance(node, se.floor) else None

        return rebuilt(se.sympify(e), rule)

    def vector(self, a: Vec) -> Vector:
        """A vector whose intermediate scalars are replaced by names."""
        lifted = self.record.lift(a)
        self.settle()
        return Vector(self.record, {atom: self.names(c) for atom, c in lifted.terms.items()})

    def scalar(self, e: Any) -> Expr:
        """A scalar whose intermediates are replaced by names, inside named vectors too."""
        found = self.names(e)
        self.settle()
        return found

    def settle(self) -> None:
        """Replace intermediate scalars inside the named vectors by their names."""
        for number, value in list(self.record.vectors.items()):
            self.record.vectors[number] = Vector(self.record, {a: self.names(c) for a, c in value.terms.items()})

    @cached_property
    def rows(self) -> dict[str, Expr]:
        """Constraint rows by name."""
        return {name: self.scalar(e) for name, e in self.law.rows(*self.frames).items()}

    @cached_property
    def speeds(self) -> dict[str, Expr]:
        """Rows of velocities by name."""
        return {name: self.scalar(e) for name, e in self.law.velocity_constraints(*self.frames).items()}

    @cached_property
    def prescribed(self) -> dict[str, Expr]:
        """What stands in the rows of velocities without them, by name."""
        zero, none = self.record.zero(), {self.clock[c]: 0 for c in self.coordinates.values()}
        still = [replace(f, v=zero, w=zero, center_velocity=zero) for f in self.frames]
        return {name: self.scalar(e).subs(none) for name, e in self.law.velocity_constraints(*still).items()}

    @cached_property
    def branches(self) -> dict[str, Expr]:
        """Expressions that are positive on the wanted solution branch, by name."""
        return {name: self.scalar(e) for name, e in self.law.positives(*self.frames).items()}

    @cached_property
    def read(self) -> dict[str, Expr]:
        """Coordinates of a joint that are not unknowns, as functions of its frames, by name."""
        return {} if self.places else {name: self.scalar(e) for name, e in self.law.read(*self.frames).items()}

    @cached_property
    def gradients(self) -> dict[str, tuple[dict[str, Pair], dict[Expr, Expr]]]:
        """Force and moment of every row on every body and on the coordinates, per unit of its multiplier."""
        found = {name: self.gradient(e) for name, e in self.rows.items()}
        for name, e in self.speeds.items():
            pairs, partial = self.by_velocities(e)
            found[name] = pairs, {c: partial[self.clock[c]] for c in self.coordinates.values()}
        return found

    def gradient(self, e: Expr) -> tuple[dict[str, Pair], dict[Expr, Expr]]:
        """Derivatives of a scalar by displacement and rotation of every body, and by the coordinates that are unknowns."""
        pairs, partial = Dual(self.record, symbols=(*self.coordinates.values(), *self.headings.values())).of(e)
        for side, h in self.headings.items():
            pairs[side] = (pairs[side][0], pairs[side][1] + self.record.axis(2) * partial.pop(h))
        return pairs, partial

    @cached_property
    def drag(self) -> tuple[dict[str, Pair], dict[Expr, Expr]]:
        """Derivatives of the dissipation function by the velocities of every body and of the coordinates that are unknowns."""
        return self.by_velocities(self.dissipation)

    def by_velocities(self, e: Expr) -> tuple[dict[str, Pair], dict[Expr, Expr]]:
        """Derivatives of a scalar by the velocities of every body, and by the rates of the coordinates that are unknowns."""
        speeds = {self.clock[h]: side for side, h in self.headings.items()}
        own = tuple(self.clock[c] for c in self.coordinates.values())
        pairs, partial = Dual(self.record, velocities=True, symbols=(*own, *speeds)).of(e)
        for speed, side in speeds.items():
            pairs[side] = (pairs[side][0], pairs[side][1] + self.record.axis(2) * partial.pop(speed))
        return pairs, partial

    @cached_property
    def energy(self) -> Expr:
        """Potential energy, J."""
        return self.scalar(self.law.energy(*self.frames)) if isinstance(self.law, Force) else se.Integer(0)

    @cached_property
    def dissipation(self) -> Expr:
        """Rayleigh function, W."""
        return self.scalar(self.law.dissipation(*self.frames)) if isinstance(self.law, Force) else se.Integer(0)

    @cached_property
    def wrench(self) -> tuple[Vector, Vector] | None:
        """Stated force on l at its point (N) and torque on l (N m); None where the law states none."""
        if isinstance(self.law, Joint):
            stated = self.law.resistance(*self.frames, self.derived.reactions)
        else:
            stated = self.law.wrench(*self.frames) if isinstance(self.law, Force) else None
        if stated is None:
            return None
        force, torque = (self.vector(part) for part in stated)
        return (force, torque) if force.terms or torque.terms else None

    @cached_property
    def thrust(self) -> tuple[Expr, Expr] | None:
        """Length or angle, and the generalised force that does work on it: friction in a joint, or a load; None without one."""
        if isinstance(self.law, Joint):
            stated = self.law.rubbing(self._reaction(), *self.frames) if self.law.friction is not None else None
        else:
            stated = self.law.thrust(*self.frames) if isinstance(self.law, Force) else None
        return None if stated is None else (self.scalar(stated[0]), self.scalar(stated[1]))

    def _reaction(self) -> Vector:
        """Reaction force of a joint on l, N."""
        forces = [pairs["l"][0] * -self.derived.scaled(se.Symbol(f"lambda_{row}")) for row, (pairs, _) in self.gradients.items()]
        return sum(forces, self.record.zero()).named("R")

    def states(self, what: str) -> dict[str, Expr]:
        """`rates` or `initial` values of the internal states that the derived law uses."""
        if not self.derived.states:
            return {}
        stated = getattr(self.law, what)(*self.frames)
        return {name: self.scalar(stated[name]) for name in self.derived.states}

    # -- derivatives

    @cached_property
    def motion(self) -> ForwardDerivative:
        """Time derivative without the terms of nodal accelerations."""
        return ForwardDerivative(self.record, actual(self.record, self.still), self.clock, r"\dot", "w")

    @cached_property
    def variation(self) -> ForwardDerivative:
        """Derivative along a virtual displacement."""
        return ForwardDerivative(self.record, virtual(self.record), self.virtual, r"\delta", "dpsi")

    def of_time(self) -> ForwardDerivative:
        """Partial time derivative, with bodies and coordinates held fixed."""
        return ForwardDerivative(self.record, lambda _: None, dict(self.derived.variation.clock), r"\partial_t")
