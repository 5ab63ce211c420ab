"""What a named number of a scene changes: the numbers in its equations, its inputs of time and its start (the chart).

The scene is stated again with the number a little smaller and larger, twice where what assembly makes of it is a straight line,
else eight times; that is differentiated by differences of order 8. Nothing is integrated for this, and nothing is left out:
whatever a number changes is among the slots and data of the lists of operations, the values of the clock and the start, or it
changes the equations themselves and is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.deferred import as_full
from mbdae.derivatives.lists import Listed, Lists, structure_of
from mbdae.errors import DerivativeError, MbdaeError
from mbdae.inputs import timed
from mbdae.run.choice import prepared_from
from mbdae.study.statements import changed
from mbdae.symbolic.tree_motion import Open
from mbdae.system.assembled.acceleration_kernel import acceleration_kernel
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.jacobian_entries import FormSpec
from mbdae.system.base import Array
from mbdae.system.model.moved_bodies import MovedBodies, timeline
from mbdae.system.model.numbering import Row
from mbdae.system.prepare import Prepared

#: nodes of the differences: three where what the scene makes of a number is a straight line, as of most; else for order 8, on
#: both sides, or on one side only where a scene cannot have smaller (larger) numbers
LINE = (0, 1, -2)
BOTH, ABOVE, BELOW = (1, -1, 2, -2, 3, -3, 4, -4), (0, 1, 2, 3, 4, 5, 6, 7, 8), (0, -1, -2, -3, -4, -5, -6, -7, -8)
#: distance of the nodes, relative to the number, or to the scene's length where that is smaller than 1 and the number is 0
DISTANCE, CLOSER, ATTEMPTS = 4e-3, 8.0, 4
#: the difference of the differences of order 8 and 6, relative to the derivative, up to which they are taken; rounding of what is
#: differentiated counts ROUNDING times its size, over the distance
AGREED, ROUNDING = 1e-8, 3e-15
#: share of a derivative of what is read up to which the orders have to agree, else nodes are taken closer; rounding of what is
#: read, of its size
ALIKE, SLIGHT = 1e-7, 1e-13


def difference_weights(nodes: Sequence[int]) -> Array:
    """Weights of values at whole nodes by which their sum is the derivative at 0 (of the polynomial through them)."""
    x, found = [*nodes] if 0 in nodes else [0, *nodes], []
    for node in x:
        others = [other for other in x if other != node]
        scale = np.prod([float(node - other) for other in others])
        slope = sum(np.prod([float(-b) for b in others if b != a]) for a in others)
        found.append(slope / scale)
    return np.array(found if 0 in nodes else found[1:])


class Differenced(NamedTuple):
    """A derivative by differences, its estimated error, and how large an error is rounding."""

    found: Array
    doubt: Array
    rounding: float

    def agrees(self, share: float = ALIKE) -> bool:
        """Whether differences of two orders agree within this share of the derivative, where they are finite."""
        finite = np.isfinite(self.doubt)
        return size_of(self.doubt[finite]) <= max(share * size_of(self.found[finite]), self.rounding)

    def excess(self, size: Array, distance: float, slight: float = 0.0) -> float:
        """Largest error over the one allowed for values of this size; slight: derivatives that are smaller need no digits."""
        return size_of(self.doubt / (AGREED * (np.abs(self.found) + slight) + ROUNDING / distance * (1 + np.abs(size))))


def differenced(function: Callable[[int], Array], nodes: Sequence[int], distance: float) -> Differenced:
    """The derivative at 0 of a function of values at whole nodes that are `distance` apart, and its estimated error: the
    difference to that of the order that is lower by two."""
    values = np.array([function(node) for node in nodes])
    weights, count = difference_weights(nodes), max(len(nodes) - 2, 2)
    less = np.zeros(len(weights))
    less[:count] = difference_weights(nodes[:count])
    # the middle value is subtracted where it is known, so that rounding is that of the changes
    size = size_of(values[np.isfinite(values)])
    with np.errstate(invalid="ignore"):  # the third derivative of t**w beside w = 2 is infinite at t = 0, and seldom needed
        values -= values[0] if 0 in nodes else values[:2].mean(axis=0)
        found, lower = (np.tensordot(w, values, 1) / distance for w in (weights, less))
        doubt = np.abs(found - lower)
    return Differenced(found, doubt, SLIGHT * size / distance)


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations of a prepared scene in the form of a run, with every number open: spec and rows are those of the run; rates:
    those of y' are differentiated (`has_rates`), not F."""

    prepared: Prepared
    spec: FormSpec
    rows: tuple[Row, ...]
    rates: bool = False
    charts: dict[tuple[str, float], Chart] = field(default_factory=dict)
    _lists: dict[bytes, Lists] = field(default_factory=dict)

    @classmethod
    def of(cls, prepared: Prepared, spec: FormSpec, explicit: bool) -> Equations:
        """The equations of a scene, made once, with the charts that are known; explicit: for a method that takes y' = f(t, y)."""
        made: dict[Any, Equations] = prepared.__dict__.setdefault("derivatives", {})  # a copy or pickle of the scene has none
        if (key := (repr(spec), explicit)) not in made:
            found = cls(prepared, spec, tuple(prepared.mechanics.rows))
            made[key] = replace(found, rates=True) if explicit and found.has_rates else found
        return made[key]

    def at(self, prepared: Prepared) -> Equations:
        """The same equations of another scene."""
        return Equations(prepared, self.spec, self.rows, self.rates)

    def lists(self, active: Any) -> Lists:
        """The list with its tangent and pullback, by the data that are `active` (inputs,)."""
        if (key := active.tobytes()) not in self._lists:
            self._lists[key] = Lists(self.fresh(), active)
        return self._lists[key]

    @cached_property
    def assembly(self) -> Assembly:
        """Residual form, with all numbers of laws as inputs of kernels."""
        return self._assembled(lambda ordered: self.prepared.all_bodies.moved.opened(self.prepared.model, Open.ALL, ordered))

    def _assembled(self, moved: Callable[[bool | None], MovedBodies]) -> Assembly:
        """Large trees joint by joint, whose kernels are small; by kernels of whole trees where laws outside add inertia."""
        spec = replace(self.spec, eliminated=False)
        made = Assembly(self.prepared.model, list(self.rows), spec, None, moved(None))
        if made.has_pattern or not made._inert:
            return made
        return Assembly(self.prepared.model, list(self.rows), spec, None, moved(False))

    @cached_property
    def listed(self) -> Listed:
        """The list of operations that is differentiated: of y' where `rates` says so, else of F."""
        return self._eliminated if self.rates and self._eliminated is not None else self.fresh()

    def fresh(self) -> Listed:
        """The same list on an array of its own, to which operations may be appended."""
        if self.rates:
            found = self._without_constraints() if not self.assembly.numbering.m else self._with_constraints()
            assert found is not None
            return found
        ev, n = self.assembly.operations(), self.assembly.n
        if ev.explicit:  # F = y' - f
            part, rows = ev.operations.part(ev.rates_part), ev.operations.slots(n) + np.arange(n)
            part.load(rows[0], np.zeros(n))
            part.add(np.r_[rows, rows], np.r_[n + np.arange(n), ev.rates + np.arange(n)], np.repeat((1.0, -1.0), n))
            return Listed.with_matrices(ev, part, int(rows[0]), n, n)
        return Listed.with_matrices(ev, ev.residual_part, ev.rows, self.assembly.n, self.assembly.n)

    @cached_property
    def _eliminated(self) -> Listed | None:
        """The list for y' without multipliers, made once because that takes as long as the scene."""
        return None if self.prepared.model.lines or not self.assembly.numbering.m else self._with_constraints()

    @property
    def has_rates(self) -> bool:
        """Whether there is a list for y'."""
        return not self.prepared.model.lines and (not self.assembly.numbering.m or self._eliminated is not None)

    def _without_constraints(self) -> Listed:
        """y' of trees and of free bodies, whose constant mass matrix is factorised anew in the list."""
        model = self.prepared.model
        trees = [tree.opened(Open.ALL) for tree in self.prepared.all_bodies.moved.trees]
        assembly = self._assembled(lambda ordered: MovedBodies(model, trees, ordered=ordered))
        ev = assembly.operations()
        if not (assembly._inert or ev.explicit):
            ev.with_rates(assembly.inertia, assembly.columns)
        once = [] if ev._steady is None else [ev._steady[0]]
        return Listed.with_matrices(ev, ev.operations.part(*once, ev.rates_part), ev.rates, assembly.n, assembly.n)

    def _with_constraints(self) -> Listed | None:
        """y' of constrained bodies, where the multipliers are eliminated by a compiled function."""
        model, start = self.prepared.model, self.prepared.start
        if any(group.derived.reactive for group in model.groups) or not self.spec.eliminated:
            return None
        full = Assembly(model, list(self.rows), replace(self.spec, eliminated=False), None, self.prepared.all_bodies.moved)
        kernel = acceleration_kernel(full, as_full(full.constant_mass), full.row_of, (start.t, self.start), own=True)
        n = full.numbering.start["lambda"]
        return None if kernel is None else Listed.with_matrices(kernel, kernel.part, kernel.rates, n, n)

    @cached_property
    def inputs(self) -> Array:
        """The numbers in all slots, and the data, in the order of `lists.Lists`."""
        return self.listed.inputs()

    @cached_property
    def start(self) -> Array:
        """The unknowns q, u, s and stresses at the start."""
        start, nb = self.prepared.start, self.assembly.numbering
        z = [line.stress(start.q, start.u) for line in self.prepared.model.lines if nb.stresses]
        return np.concatenate([start.q[nb.of_positions], start.u[nb.of_velocities], start.s, *z])

    def same_as(self, other: Equations) -> bool:
        """Whether both have equations that differ in numbers alone."""
        if (other.rates and not other.has_rates) or (self.rates and not self.has_rates):
            return False
        a, b = self.listed, other.listed
        if (a.n, a.of.numbering.names(), a.of.numbering.width) != (b.n, b.of.numbering.names(), b.of.numbering.width):
            return False
        return structure_of(a.part) == structure_of(b.part)


@dataclass(eq=False)
class Varied:
    """A number of a scene, by its name, and the scene with other values of it. t_end: end of the run, s."""

    name: str
    base: Equations
    t_end: float
    nodes: tuple[int, ...] = LINE
    value: float | None = None  # known when a scene has been made
    share: float = DISTANCE
    _known: dict[float, Equations] = field(default_factory=dict)

    @property
    def distance(self) -> float:
        """Distance of the nodes, in the unit of the number."""
        return self.share * (abs(self.value or 0.0) or min(self.base.prepared.length, 1.0))

    def at(self, node: int) -> Equations:
        """The equations with the number `node` distances away from its value."""
        if not node:
            return self.base
        if node not in self._known:
            scene, _ = changed(self.base.prepared.model.scene, self.name, lambda stated: self._near(stated, node), self.t_end)
            self._known[node] = self.base.at(prepared_from(scene, None, self.t_end))
        return self._known[node]

    def _near(self, stated: float, node: int) -> float:
        self.value = stated
        return stated + node * self.distance

    def with_nodes(self, nodes: tuple[int, ...], closer: float = 1.0) -> Varied:
        """The same number at other nodes, nearer to its value by the factor `closer`."""
        return replace(self, nodes=nodes, share=self.share / closer, _known=self._known if closer == 1.0 else {})

    @cached_property
    def finer(self) -> Varied:
        """The same number for differences of a higher order, or nearer to its value."""
        return reached(self.with_nodes(BOTH)) if self.nodes == LINE else self.with_nodes(self.nodes, CLOSER)

    def sum_of(self, function: Callable[[Equations, int], Array]) -> Differenced:
        """The derivative by the number of what a function makes of the equations at a node, and its estimated error."""
        for node in self.nodes:
            self.at(node)  # the distance is known from here on
        return differenced(lambda node: function(self.at(node), node), self.nodes, self.distance)

    def explicit(self, function: Callable[[Equations], Array]) -> tuple[Array, Array]:
        """As `sum_of`, with nodes at which orders agree, where there are such."""
        varied = self
        for _ in range(ATTEMPTS):
            one = varied.sum_of(lambda at, _node: function(at))
            if one.agrees():
                break
            varied = varied.finer
        return one.found, one.doubt

    def with_jump(self, function: Callable[[Equations], Array]) -> Differenced:
        """As `sum_of`; the error contains how far the value is from the polynomial through those beside it: some numbers of
        exactly 0 stand for none."""
        found = self.sum_of(lambda one, _: function(one))
        if 0 in self.nodes:
            return found
        sides = [np.prod([b / (b - a) for b in self.nodes if b != a]) for a in self.nodes]
        beside = np.tensordot(sides, np.array([function(self.at(node)) for node in self.nodes]), 1)
        return found._replace(doubt=found.doubt + np.abs(function(self.base) - beside) / self.distance)


@dataclass(frozen=True, eq=False)
class Chart:
    """Derivatives by a number: of the inputs of the lists, and of the start; of the clock see `prescribed`. open: largest share
    of one that differences leave open."""

    varied: Varied
    inputs: Array
    start: Array
    open: float

    @property
    def name(self) -> str:
        """Name of the number."""
        return self.varied.name

    @cached_property
    def _moves(self) -> bool:
        base, other = self.varied.base, self.varied.at(self.varied.nodes[-1])
        return base.assembly.numbering.clock.expressions != other.assembly.numbering.clock.expressions

    def prescribed(self, t: Array, sides: Array) -> Array:
        """Derivative (k, values) of the prescribed values at times (k,), conditions being read at the times `sides` (k,)."""
        if not self._moves:
            return np.zeros((len(t), len(self.varied.base.assembly.numbering.clock.expressions)))

        def values(one: Equations) -> Array:
            return np.column_stack([timed.values(se.sympify(e), t, sides) for e in one.assembly.numbering.clock.expressions])

        return self.varied.explicit(values)[0]

    def refuse_moving_breaks(self, t0: float) -> None:
        """Raise DerivativeError where the number moves an instant at which an input of time jumps or has a kink."""
        if not self._moves:
            return
        lines = [timeline(one.prepared.model, t0, self.varied.t_end)
                 for one in (self.varied.base, *(self.varied.at(node) for node in self.varied.nodes[-2:]))]
        # without a timeline the input is smooth; whether its speed asks for one may change with the number, and moves no instant
        edges = [np.zeros(0) if line is None else np.concatenate([line.edges[1:-1], line.stretches.kinks]) for line in lines]
        if not all(np.array_equal(a, edges[0]) for a in edges):
            refused(self.name, "it moves an instant at which an input of time jumps or has a kink, and steps do not move with "
                               "such instants yet; give the input a smooth form, or compare runs")


def refused(name: str, why: str) -> None:
    """Raise the error that says why there is no derivative by a number."""
    raise DerivativeError(f"there is no derivative by '{name}': {why}")


def size_of(values: Array) -> float:
    """The largest magnitude, 0 of none."""
    return float(np.max(np.abs(values), initial=0.0))


def reached(varied: Varied) -> Varied:
    """The same with nodes on one side where the scene cannot be made on both; DerivativeError where it can on none."""
    problem: MbdaeError | None = None
    for nodes in (varied.nodes, ABOVE, BELOW):
        one = varied.with_nodes(nodes)
        try:
            for node in nodes:
                one.at(node)
        except MbdaeError as error:
            if one.value is None:  # there is no such number
                raise DerivativeError(str(error).replace("vary:", "derivatives:")) from error
            problem = problem or error
        else:
            return one
    refused(varied.name, f"the scene cannot be made with a value near its own ({problem})")
    raise AssertionError
