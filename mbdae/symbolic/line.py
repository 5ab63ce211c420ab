"""Laws on a line (beams): stated at one point of interpolated fields, everything else derived.

A line element interpolates the positions of its nodes (spatial: r and the quaternion P, any length; planar: x, y and
theta) over xi in [0, 1]. A law on it states, at a point,

    strains(x)         -> {stress: expression}   strains; each has a stress resultant as its unknown
    load(x)            -> force per length       applied on the axis, inertial, N/m
    kinetic_energy(x)  -> expression             per length, quadratic in x.v and x.spin, J/m

and the rest follows from one functional per point,

    Pi = weight sum( stress (strain - reference) - compliance stress^2 / 2 ):

the force dual to a field is dPi/dfield, the row of a stress is dPi/dstress = 0, which reads
stress = C (strain - reference + damping strain rate) where damping is added. Compliance 0 is legal: that strain is
then a constraint and its stress the multiplier. Because the forces are derivatives of an energy by the interpolated
fields, the elements keep energy and angular momentum.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.process import made_once, spends
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Law, Structure
from mbdae.symbolic.rebuild import symbols_of
from mbdae.symbolic.stated import frozen, unsteady
from mbdae.symbolic.vectors import UNIT, ZERO, Expr, Vec, body_spin, rotation_columns

_ZERO = se.Integer(0)
LENGTH, WEIGHT = se.Symbol("ds"), se.Symbol("weight")  #: ds/dxi of the reference curve, m; weight of the point in integrals, m


@dataclass(frozen=True)
class Field:
    """An interpolated field: a component of the nodes' positions q, or (slope) its derivative by xi."""

    symbol: Expr
    component: int
    slope: bool

    @property
    def rate(self) -> Expr:
        """Symbol of the time derivative of the field."""
        return se.Symbol(f"{self.symbol}_t")


@dataclass(frozen=True)
class LinePoint:
    """A point of a line, from which a law is stated; s is the length along the reference curve, the section has axes 1, 2, 3."""

    kind: NodeKind
    r: Vec  #: position, m
    r_s: Vec  #: dr/ds, s: length along the reference curve
    axes: tuple[Vec, Vec, Vec]  #: axes of the section, axis 1 along the line; inertial
    curvature: Vec  #: twist and curvatures in section axes: d(axis)/ds = curvature x axis, 1/m
    v: Vec  #: velocity, inertial, m/s
    spin: Vec  #: angular velocity in section axes, rad/s
    fields: tuple[Field, ...]


@lru_cache(maxsize=8)
def make_point(kind: NodeKind) -> LinePoint:
    """The point of a line between nodes of one kind, SPATIAL or PLANAR."""
    if not kind.turns:
        raise LawError(f"a law on a line, as of a beam, needs nodes that turn, 'spatial' or 'planar', not '{kind.value}'")
    names = ["r1", "r2", "theta"] if kind is NodeKind.PLANAR else ["r1", "r2", "r3", "P1", "P2", "P3", "P4"]
    q, slope = ([se.Symbol(name + end) for name in names] for end in ("", "_xi"))
    u = [se.Symbol(f"u{i + 1}") for i in range(kind.sizes[1])]
    fields = [Field(symbol, i, part == 1) for part, symbols in enumerate((q, slope)) for i, symbol in enumerate(symbols)]
    if kind is NodeKind.PLANAR:
        first = Vec(se.cos(q[2]), se.sin(q[2]), 0)
        axes, curvature = (first, UNIT[2].cross(first), UNIT[2]), Vec(0, 0, slope[2])
        r, r_s, v, spin = Vec(q[0], q[1], 0), Vec(slope[0], slope[1], 0), Vec(u[0], u[1], 0), Vec(0, 0, u[2])
    else:
        axes, curvature = rotation_columns(q[3:]), body_spin(q[3:], slope[3:])
        r, r_s, v, spin = Vec(*q[:3]), Vec(*slope[:3]), Vec(*u[:3]), Vec(*u[3:])
    return LinePoint(kind, r, r_s / LENGTH, axes, curvature / LENGTH, v, spin, tuple(fields))


class LineLaw(Law):
    """A law on a line. Parameters of a strain named N: `compliance_N` and, where it has one, `reference_N`."""

    def strains(self, x: LinePoint) -> dict[str, Expr]:
        """Strains by the name of their stress resultant."""
        return {}

    def load(self, x: LinePoint) -> Vec:
        """Force per reference length, inertial, N/m."""
        return ZERO

    def kinetic_energy(self, x: LinePoint) -> Expr:
        """Kinetic energy per reference length, J/m."""
        return _ZERO


@dataclass(frozen=True, eq=False)
class LineDerived:
    """A law on a line, derived at a point. Expressions are in `variables` and the symbols named in `parameters`."""

    kind: NodeKind
    fields: tuple[Field, ...]  #: fields the law reads
    damped: bool  #: whether the law reads the time derivatives of `fields` too
    stresses: tuple[str, ...]  #: stress unknowns; none in the displacement form
    vanished: tuple[str, ...]  #: strains that are zero for this kind of node
    duals: tuple[tuple[Field, Expr], ...]  #: generalised force dual to each field, left-hand side
    rows: tuple[Expr, ...]  #: compatibility row of every stress
    #: name and value of every stress resultant as a function of its strain, for a compliance that is not 0
    resultants: tuple[tuple[str, Expr], ...]
    energy: Expr  #: elastic energy of the point, J
    dissipated: Expr  #: dissipated power of the point, W
    mass: dict[tuple[int, int], Expr]  #: inertia per length between velocity components

    @cached_property
    def variables(self) -> list[Expr]:
        """Fields, their time derivatives where damped, stresses."""
        fields = [f.symbol for f in self.fields]
        return fields + [f.rate for f in self.fields if self.damped] + [se.Symbol(n) for n in self.stresses]

    @cached_property
    def outputs(self) -> list[Expr]:
        """Dual forces, then rows."""
        return [e for _, e in self.duals] + list(self.rows)

    @cached_property
    def parameters(self) -> list[str]:
        """Names of the parameters read."""
        return sorted(str(s) for s in symbols_of([*self.outputs, self.energy, self.dissipated]) - set(self.variables))

    @cached_property
    def derivatives(self) -> dict[tuple[int, int], Expr]:
        """Derivative of output o by variable i, where it does not vanish."""
        found = {(o, i): se.diff(e, s) for o, e in enumerate(self.outputs) for i, s in enumerate(self.variables)}
        return {place: e for place, e in found.items() if e != 0}


@spends("derive")
def derive_line(cls: type[LineLaw], structure: Structure, kind: NodeKind, mixed: bool = True) -> LineDerived:
    """Derive a law on a line, or find what was derived by what it states now; `mixed` keeps the stresses as unknowns, otherwise
    their compliance eliminates them."""
    return _derived(cls, structure, kind, mixed, _stated(cls, structure, kind))


def _stated(cls: type[LineLaw], structure: Structure, kind: NodeKind) -> Any:
    law, x = cls.symbolic(structure), make_point(kind)
    return frozen([law.strains(x), law.load(x), law.kinetic_energy(x)])


@made_once("derive", 64)
def _derived(cls: type[LineLaw], structure: Structure, kind: NodeKind, mixed: bool, known: Any) -> LineDerived:
    if _stated(cls, structure, kind) != known:
        raise unsteady(cls)
    law, x = cls.symbolic(structure), make_point(kind)
    stated = {name: se.sympify(e) for name, e in law.strains(x).items()}
    s = _Strains(law, x, {name: e for name, e in stated.items() if e != 0})
    duals, rows = _with_load(s.forces(), law.load(x), kind), s.rows()
    if not mixed:
        inserted = {se.Symbol(name): e for name, e in s.solved.items()}
        duals, rows = [(f, se.sympify(e).subs(inserted)) for f, e in duals], []
    duals = [(f, e) for f, e in duals if e != 0]
    read = symbols_of([*(e for _, e in duals), *rows])
    return LineDerived(
        kind, tuple(f for f in x.fields if f.symbol in read or f.rate in read), s.damping is not None,
        tuple(s.strains) if mixed else (), tuple(n for n in stated if n not in s.strains), tuple(duals), tuple(rows),
        tuple(s.solved.items()), s.energy(), s.dissipated(), _mass(law, x),
    )


class _Strains:
    """The strains of a law, their stresses, and the derivatives of the functional Pi of the module's text."""

    def __init__(self, law: Any, x: LinePoint, strains: dict[str, Expr]) -> None:
        self.x, self.strains = x, strains
        self.damping = law.damping if strains and "damping" in law.params else None
        self.compliance = {name: getattr(law, f"compliance_{name}") for name in strains}
        self.elastic = {name: e - (getattr(law, f"reference_{name}") or 0) for name, e in strains.items()}
        self.viscous = {name: _ZERO if self.damping is None else self.damping * self._rate(e) for name, e in strains.items()}
        self.solved = {name: (self.elastic[name] + self.viscous[name]) / c for name, c in self.compliance.items()}

    def _rate(self, strain: Expr) -> Expr:
        """Strain rate by the rates of the fields."""
        return sum((se.diff(strain, f.symbol) * f.rate for f in self.x.fields), _ZERO)

    def forces(self) -> list[tuple[Field, Expr]]:
        """dPi/dfield."""
        work = WEIGHT * sum((se.Symbol(name) * e for name, e in self.strains.items()), _ZERO)
        return [(f, se.diff(work, f.symbol)) for f in self.x.fields]

    def rows(self) -> list[Expr]:
        """dPi/dstress, with damping."""
        return [WEIGHT * (self.elastic[n] + self.viscous[n] - self.compliance[n] * se.Symbol(n)) for n in self.strains]

    def energy(self) -> Expr:
        """Elastic energy of the strains. A strain with compliance 0 stores none: for the energy its compliance is set to inf."""
        return WEIGHT * sum((self.elastic[n] ** 2 / (2 * c) for n, c in self.compliance.items()), _ZERO)

    def dissipated(self) -> Expr:
        """Dissipated power: strain rates times the damping part of the stresses."""
        if self.damping is None:
            return _ZERO
        return WEIGHT * sum((self.viscous[n] ** 2 / (self.damping * c) for n, c in self.compliance.items()), _ZERO)


def _with_load(duals: list[tuple[Field, Expr]], load: Vec, kind: NodeKind) -> list[tuple[Field, Expr]]:
    """The generalised forces less the load in those of the position r, since the virtual work of the load is load . delta r."""
    n = kind.translations
    return [(f, e if f.slope or f.component >= n else e - WEIGHT * load[f.component]) for f, e in duals]


def _mass(law: Any, x: LinePoint) -> dict[tuple[int, int], Expr]:
    """Second derivatives of the kinetic energy: constant, because velocities are inertial and spins in section axes."""
    u = [se.Symbol(f"u{i + 1}") for i in range(x.kind.sizes[1])]
    energy = se.sympify(law.kinetic_energy(x))
    found = {(i, j): se.diff(se.diff(energy, a), b) for i, a in enumerate(u) for j, b in enumerate(u)}
    return {place: e for place, e in found.items() if e != 0}
