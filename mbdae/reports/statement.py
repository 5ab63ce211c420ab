"""A law evaluated with recorded vectors, and the same law derived in components as it is integrated."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import symengine as se

from mbdae.errors import LawError, OptionError
from mbdae.laws.contact import Hertz
from mbdae.laws.friction import LuGre
from mbdae.laws.joints import Revolute
from mbdae.reports.calculus import Motion, actual, virtual
from mbdae.reports.vectors import Record, Vector
from mbdae.symbolic.derive import Derived, Side, derive
from mbdae.symbolic.frames import Axes, Frame, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import AUGMENTED, Force, Law, Structure
from mbdae.symbolic.part import Part, PartStructure
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.values import flag, option, shown

#: options of laws in a report of the class, where none are given
OPTIONS: dict[str, Any] = {
    "joint": Revolute,
    "following": False,
    "tilting": False,
    "normal": Hertz(1, damping=1).structure(),
    "friction": LuGre(0.3, 0.5, 1e-3, 1e5, 300.0, 0.1).structure(),
}


def check_kind(name: str, value: Any, typical: Any) -> None:
    """Refuse an option of a law that is of another kind than a typical one: a switch, a class of laws, a part."""
    if isinstance(typical, bool):
        option(name, value, flag, "give True or False")
    elif isinstance(typical, type) and not (isinstance(value, type) and issubclass(value, Law)):
        raise OptionError(f"{name} = {shown(value)} is not a class of a law: give one such as mb.{typical.__name__}")
    elif isinstance(typical, PartStructure) and not isinstance(value, Part | PartStructure | None):
        raise OptionError(f"{name} = {shown(value)} is no {name} law: give one such as mb.{typical.cls.__name__}(...)")


def structure_of(law: type[Law], options: Mapping[str, Any]) -> Structure:
    """Structure of a law class in a report: all parameters but scaling and penalty, a prescribed motion as a function of time."""
    missing = [name for name in law.options if name not in options and name not in OPTIONS]
    if missing:
        raise LawError(f"{law.__name__} has the option '{missing[0]}': say mb.report({law.__name__}, {missing[0]}=...)")
    given = {name: v for name, v in options.items() if name in law.params}
    if wrong := [name for name, v in given.items() if v is not None]:
        raise LawError(f"{law.__name__}: parameter '{wrong[0]}' is a symbol in a report of the class; say None to leave it out")
    options = {name: v for name, v in options.items() if name not in given}
    unknown = sorted(set(options) - set(law.options))
    if unknown:
        raise LawError(f"{law.__name__} has no option '{unknown[0]}'; it has {sorted(law.options)}")
    for name, value in options.items():
        check_kind(name, value, OPTIONS.get(name))
    chosen = {name: options.get(name, OPTIONS.get(name)) for name in law.options}
    fixed = tuple((name, v.structure() if isinstance(v, Part) else v) for name, v in chosen.items())
    absent = frozenset(AUGMENTED) & frozenset(law.params) if issubclass(law, Joint) else frozenset()
    timed = frozenset({"drive"} & set(law.params)) if issubclass(law, Joint) else frozenset()
    return Structure(absent | frozenset(given), timed - frozenset(given), fixed)


def sides_of(law: type[Law], planar: bool = False) -> tuple[Side, ...]:
    """The frames of a law: those of two bodies, or of the ground and a body for an external load."""
    kind, axes = (NodeKind.PLANAR, Axes.NORMAL) if planar else (NodeKind.SPATIAL, Axes.GENERAL)
    outside = issubclass(law, Force) and law.external
    ground = NodeKind.PLANAR_GROUND if planar else NodeKind.GROUND
    return ((ground if outside else kind, axes), (kind, axes))


def derived(law: type[Law], structure: Structure, planar: bool = False) -> Derived:
    """The law as it is integrated."""
    sides = sides_of(law, planar)
    instance = law.symbolic(structure)
    if instance.own_coordinates:
        sides = (*sides, (NodeKind.COORDINATE, Axes.GENERAL))
    return derive(law, structure, sides)  # type: ignore[arg-type]


class Statement:
    """A law evaluated with recorded vectors; `derived` is the same law as it is integrated, `still` names fixed sides."""

    def __init__(self, law: type[Law], structure: Structure) -> None:
        self.cls, self.structure = law, structure
        self.record = Record()
        self.record.resolve = self.names
        self.derived = derived(law, structure)
        sides = sides_of(law)
        self.k, self.l = (self._frame(side, *kind) for side, kind in zip("kl", sides, strict=True))
        self.still = tuple(f.side for f in (self.k, self.l) if not f.kind.moves)
        self.law = law.symbolic(structure)
        self.coordinates: dict[str, Expr] = {}
        for name in self.law.own_coordinates:
            self.coordinates[name] = self.derived.frames[2].q[0]
            setattr(self.law, name, self.coordinates[name])
        self.clock = dict(self.derived.variation.clock)
        if self.coordinates:
            c = self.derived.frames[2]
            self.clock |= {c.q[0]: c.u[0]}

    def _frame(self, side: str, kind: NodeKind, axes: Axes) -> Frame:
        a = self.record.atom
        zero = self.record.zero()
        r, s, v, w = (a(n, side) for n in "rsvw") if kind.moves else (a("r", side), zero, zero, zero)
        center = a("c", side) if kind.moves else r
        own, fixed = [a(b, side) for b in ("bx", "by", "bz")], [self.record.axis(i) for i in range(3)]
        body = (own[0], own[1], own[2]) if kind.moves else (fixed[0], fixed[1], fixed[2])
        spin = Vec(*(se.Symbol(f"{side}_W{i + 1}") for i in range(3)))
        return Frame(
            side,
            kind,
            axes,
            r,
            v,
            a("x", side),
            a("y", side),
            a("z", side),
            w,
            center,
            v - w.cross(s),
            s,
            body,
            se.Symbol(f"{side}_h"),
            spin,
            [],
            [],
            [],
            {},
            {},
        )

    # -- what the law states, with names for intermediate quantities

    def names(self, e: Any) -> Expr:
        """A scalar with `let`, `rate`, angles and turn counts replaced by names."""
        e = se.sympify(e)
        if not e.args or e.is_Number:
            return e
        if isinstance(e, se.Piecewise):
            args = [self.names(a) for a in e.args]
            return se.Piecewise(*zip(args[::2], args[1::2], strict=True))
        if not hasattr(e, "func"):  # a comparison
            return e.subs({a: self.names(a) for a in e.args})
        name = e.get_name() if isinstance(e, se.FunctionSymbol) else type(e).__name__
        args = [self.names(a) for a in e.args]
        if name == "let":
            return self.record.name_scalar(args[0], str(args[1]) if len(args) > 1 else "")
        if name == "rate":
            inner = Motion(self.record, actual(self.record, self.still), self.clock, r"\dot")
            return self.record.name_scalar(inner.scalar(args[0]))
        if name == "atan2":
            args = [self.record.name_scalar(a) for a in args]
        function = se.Function(e.get_name()) if isinstance(e, se.FunctionSymbol) else e.func
        inner_e = function(*args)
        return self.record.name_scalar(inner_e) if isinstance(inner_e, se.floor | se.atan2) else inner_e

    def vector(self, a: Vec) -> Vector:
        """A vector with its scalars named."""
        lifted = self.record.lift(a)
        self.settle()
        return Vector(self.record, {atom: self.names(c) for atom, c in lifted.terms.items()})

    def scalar(self, e: Any) -> Expr:
        """A scalar with names; those inside named vectors too."""
        found = self.names(e)
        self.settle()
        return found

    def settle(self) -> None:
        """Replace intermediates inside the named vectors by their names."""
        for number, value in list(self.record.vectors.items()):
            self.record.vectors[number] = Vector(self.record, {a: self.names(c) for a, c in value.terms.items()})

    @cached_property
    def rows(self) -> dict[str, Expr]:
        """Constraint rows by name."""
        stated = self.law.constraints(self.k, self.l) if isinstance(self.law, Joint) else {}
        return {name: self.scalar(e) for name, e in stated.items()}

    @cached_property
    def branches(self) -> dict[str, Expr]:
        """Expressions that are positive on the wanted branch, by name."""
        stated = self.law.branches(self.k, self.l) if isinstance(self.law, Joint) else {}
        return {name: self.scalar(e) for name, e in stated.items()}

    @cached_property
    def coordinate(self) -> Expr | None:
        """The free relative motion, if one is stated."""
        stated = self.law.coordinate(self.k, self.l) if isinstance(self.law, Joint) else None
        return None if stated is None else self.scalar(stated)

    @cached_property
    def energy(self) -> Expr:
        """Potential energy, J."""
        return self.scalar(self.law.energy(self.k, self.l)) if isinstance(self.law, Force) else se.Integer(0)

    @cached_property
    def dissipation(self) -> Expr:
        """Rayleigh function, W."""
        return self.scalar(self.law.dissipation(self.k, self.l)) if isinstance(self.law, Force) else se.Integer(0)

    @cached_property
    def wrench(self) -> tuple[Vector, Vector] | None:
        """Force on l at its point, and torque."""
        if isinstance(self.law, Joint):
            stated = self.law.resistance(self.k, self.l, self.derived.reactions)
        else:
            stated = self.law.wrench(self.k, self.l)
        if stated is None:
            return None
        force, torque = (self.vector(part) for part in stated)
        return (force, torque) if force.terms or torque.terms else None

    def states(self, what: str) -> dict[str, Expr]:
        """`rates` or `initial` of the states the derived law uses."""
        if not self.derived.states:
            return {}
        stated = getattr(self.law, what)(self.k, self.l)
        return {name: self.scalar(stated[name]) for name in self.derived.states}

    # -- motions

    def motion(self) -> Motion:
        """Time derivative, without the terms of nodal accelerations."""
        return Motion(self.record, actual(self.record, self.still), self.clock, r"\dot")

    def variation(self) -> Motion:
        """Derivative along a virtual displacement."""
        return Motion(self.record, virtual(self.record), {}, r"\delta")
