"""What a named number of a scene changes: the numbers in its equations, its inputs of time and its start (the chart).

The scene is stated again with the number a little smaller and larger, eight times; what assembly makes of it is differentiated by
differences of order 8. Nothing is integrated for this, and nothing is left out: whatever a number changes is among the slots
and data of the lists of operations, the values of the clock and the start, or it changes the equations themselves and is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.deferred import as_full
from mbdae.derivatives.lists import Listed, Lists, structure_of
from mbdae.errors import DerivativeError, MbdaeError, OptionError
from mbdae.inputs import timed
from mbdae.results.result import Result
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

#: nodes of the differences of order 8: on both sides, or on one side only where a scene cannot have smaller (larger) numbers
BOTH, ABOVE, BELOW = (1, -1, 2, -2, 3, -3, 4, -4), (0, 1, 2, 3, 4, 5, 6, 7, 8), (0, -1, -2, -3, -4, -5, -6, -7, -8)
#: distance of the nodes, relative to the number, or to the scene's length where that is smaller than 1 and the number is 0
DISTANCE, CLOSER, ATTEMPTS = 4e-3, 8.0, 4
#: the difference of the differences of order 8 and 6, relative to the derivative, up to which they are taken; rounding of what is
#: differentiated counts ROUNDING times its size, over the distance
AGREED, ROUNDING = 1e-8, 3e-15
KEPT = 64  #: charts that a scene keeps, each with the scenes of eight other values: 5 MB for ten bodies
SAME = 1e-9  #: largest difference of two starts, relative to the largest unknown, that count as the same


def difference_weights(nodes: Sequence[int]) -> Array:
    """Weights of values at whole nodes by which their sum is the derivative at 0 (of the polynomial through them)."""
    x, found = [*nodes] if 0 in nodes else [0, *nodes], []
    for node in x:
        others = [other for other in x if other != node]
        scale = np.prod([float(node - other) for other in others])
        slope = sum(np.prod([float(-b) for b in others if b != a]) for a in others)
        found.append(slope / scale)
    return np.array(found if 0 in nodes else found[1:])


def differenced(function: Callable[[int], Array], nodes: Sequence[int], distance: float) -> tuple[Array, Array]:
    """The derivative at 0 of a function of values at whole nodes that are `distance` apart, and its estimated error: the
    difference to that of the order that is lower by two."""
    values = np.array([function(node) for node in nodes])
    weights, count = difference_weights(nodes), len(nodes) - 2
    less = np.zeros(len(weights))
    less[:count] = difference_weights(nodes[:count])
    # the middle value is subtracted where it is known, so that rounding is that of the changes
    values -= values[0] if 0 in nodes else values[:2].mean(axis=0)
    found = np.tensordot(weights, values, 1) / distance
    return found, np.abs(found - np.tensordot(less, values, 1) / distance)


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
        """Residual form, with all numbers of laws as inputs of kernels, trees as one function each."""
        moved = self.prepared.all_bodies.moved.opened(self.prepared.model, Open.ALL, ordered=False)
        return Assembly(self.prepared.model, list(self.rows), replace(self.spec, eliminated=False), None, moved)

    @cached_property
    def listed(self) -> Listed:
        """The list of operations that is differentiated: of y' where `rates` says so, else of F."""
        return self.fresh()

    def fresh(self) -> Listed:
        """The same list on an array of its own, to which operations may be appended."""
        if self.rates:
            found = self._without_constraints() if not self.assembly.numbering.m else self._with_constraints()
            assert found is not None
            return found
        ev = self.assembly.operations()
        return Listed.with_matrices(ev, ev.residual_part, ev.rows, self.assembly.n, self.assembly.n)

    @property
    def has_rates(self) -> bool:
        """Whether there is a list for y'."""
        if self.prepared.model.lines:
            return False
        return not self.assembly.numbering.m or self._with_constraints() is not None

    def _without_constraints(self) -> Listed:
        """y' of trees and of free bodies, whose constant mass matrix is factorised anew in the list."""
        model = self.prepared.model
        trees = [tree.opened(Open.ALL) for tree in self.prepared.all_bodies.moved.trees]
        moved = MovedBodies(model, trees, ordered=False)
        assembly = Assembly(model, list(self.rows), replace(self.spec, eliminated=False), None, moved)
        ev = assembly.operations()
        if assembly._inert:
            return Listed.with_matrices(ev, ev.rates_part, ev.rates, assembly.n, assembly.n)
        ev.with_rates(assembly._inertia, assembly.columns)
        once = [] if ev._steady is None else [ev._steady[0]]
        return Listed.with_matrices(ev, ev.operations.part(*once, ev.rates_part), ev.rates, assembly.n, assembly.n)

    def _with_constraints(self) -> Listed | None:
        """y' of constrained bodies, where the multipliers are eliminated by a compiled function."""
        model, start = self.prepared.model, self.prepared.start
        if any(group.derived.reactive for group in model.groups) or not self.spec.eliminated:
            return None
        full = Assembly(model, list(self.rows), replace(self.spec, eliminated=False), None, self.prepared.all_bodies.moved)
        kernel = acceleration_kernel(full, as_full(full.constant_mass), full.row_of, (start.t, self.start))
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
    nodes: tuple[int, ...] = BOTH
    value: float = field(init=False)
    _known: dict[float, Equations] = field(default_factory=dict)

    def __post_init__(self) -> None:
        seen: list[float] = []
        self._stated(lambda stated: seen.append(stated) or stated)  # type: ignore[func-returns-value]
        self.value = seen[0]
        length = min(self.base.prepared.length, 1.0)
        self.distance = DISTANCE * (abs(self.value) if self.value else length)

    def _stated(self, value: Any) -> Any:
        return changed(self.base.prepared.model.scene, self.name, value, self.t_end)[0]

    def at(self, node: int) -> Equations:
        """The equations with the number `node` distances away from its value."""
        if node not in self._known:
            scene = self._stated(lambda stated: stated + node * self.distance)
            self._known[node] = self.base.at(prepared_from(scene, None, self.t_end))
        return self._known[node]

    def closer(self, times: float) -> Varied:
        """The same number with values that are nearer to its own, by the factor `times`."""
        other = Varied(self.name, self.base, self.t_end, self.nodes)
        other.distance = self.distance / times
        return other

    def sum_of(self, function: Callable[[Equations, int], Array]) -> tuple[Array, Array]:
        """The derivative by the number of what a function makes of the equations at a node, and its estimated error."""
        return differenced(lambda node: function(self.at(node), node), self.nodes, self.distance)


@dataclass(frozen=True, eq=False)
class Chart:
    """Derivatives by a number: of the inputs of the lists, and of the start; of the clock see `prescribed`."""

    varied: Varied
    inputs: Array
    start: Array

    @property
    def name(self) -> str:
        """Name of the number."""
        return self.varied.name

    @cached_property
    def _moves(self) -> bool:
        base, other = self.varied.base, self.varied.at(self.varied.nodes[1])
        return base.assembly.numbering.clock.expressions != other.assembly.numbering.clock.expressions

    def prescribed(self, t: Array, sides: Array) -> Array:
        """Derivative (k, values) of the prescribed values at times (k,), conditions being read at the times `sides` (k,)."""
        if not self._moves:
            return np.zeros((len(t), len(self.varied.base.assembly.numbering.clock.expressions)))

        def values(one: Equations, _: int) -> Array:
            return np.column_stack([timed.values(se.sympify(e), t, sides) for e in one.assembly.numbering.clock.expressions])

        return self.varied.sum_of(values)[0]

    def refuse_moving_breaks(self, t0: float) -> None:
        """Raise DerivativeError where the number moves an instant at which an input of time jumps or has a kink."""
        if not self._moves:
            return
        lines = [timeline(one.prepared.model, t0, self.varied.t_end)
                 for one in (self.varied.base, self.varied.at(1), self.varied.at(self.varied.nodes[1]))]
        edges = [None if line is None else np.concatenate([line.edges, line.stretches.kinks]) for line in lines]
        if any((a is None) != (edges[0] is None) or (a is not None and not np.array_equal(a, edges[0])) for a in edges):  # type: ignore[arg-type]
            refused(self.name, "it moves an instant at which an input of time jumps or has a kink, and steps do not move with "
                               "such instants yet; give the input a smooth form, or compare runs")


def refused(name: str, why: str) -> None:
    """Raise the error that says why there is no derivative by a number."""
    raise DerivativeError(f"there is no derivative by '{name}': {why}")


def chart_of(name: str, base: Equations, t_end: float) -> Chart:
    """The chart of a number by its name, made once for a scene; DerivativeError where it has none."""
    if (name, t_end) not in base.charts:
        made = _chart_of(name, base, t_end)
        if len(base.charts) >= KEPT:
            del base.charts[next(iter(base.charts))]
        base.charts[name, t_end] = made
    return base.charts[name, t_end]


def _chart_of(name: str, base: Equations, t_end: float) -> Chart:
    try:
        varied = Varied(name, base, t_end)
    except OptionError as error:
        raise DerivativeError(str(error).replace("vary:", "derivatives:")) from error
    for _ in range(ATTEMPTS):
        _reach(varied)
        if not all(varied.at(node).same_as(base) for node in varied.nodes):
            refused(name, "with another value the scene has other equations, not only other numbers in them")
        size = np.abs(base.inputs), np.abs(base.start)
        (inputs, doubt), (start, other) = varied.sum_of(lambda one, _: one.inputs), varied.sum_of(lambda one, _: one.start)
        off = max(_off(inputs, doubt, size[0], varied.distance), _off(start, other, size[1], varied.distance))
        if off <= 1:
            return Chart(varied, inputs, start)
        varied._known.clear()
        varied.distance /= CLOSER
    refused(name, "what the scene makes of it is not smooth at its value")
    raise AssertionError


def _off(found: Array, doubt: Array, size: Array, distance: float) -> float:
    return float(np.max(doubt / (AGREED * np.abs(found) + ROUNDING / distance * (1 + size)), initial=0.0))


def _reach(varied: Varied) -> None:
    """Choose nodes on one side where the scene cannot be made on both; DerivativeError where it can on none."""
    problem: Exception | None = None
    for nodes in (BOTH, ABOVE, BELOW):
        try:
            for node in nodes:
                varied.at(node)
            varied.nodes = nodes
            return
        except MbdaeError as error:
            problem = problem or error
    refused(varied.name, f"the scene cannot be made with a value near its own ({problem})")


def refuse_scene(prepared: Prepared, continued: Any = None, ends: bool = False) -> None:
    """Raise DerivativeError for a scene whose runs have no derivatives; for runs that begin where another ended (`continued`), or
    that end at an event."""
    if continued is not None:
        raise DerivativeError("there are no derivatives of a run that begins where another one ended (start=): what that state "
                              "depends on is not known; run the scene from its own start")
    if ends:
        raise DerivativeError("there are no derivatives of a run that ends at an event (until=), whose time would move with the "
                              "numbers; run to a fixed time, and record= the event")
    scene = prepared.model.scene
    if prepared.contacts:
        names = ", ".join(f"'{name}'" for name in dict.fromkeys(contact.item for contact in prepared.contacts))
        raise DerivativeError(f"there are no derivatives of runs with contacts ({names}): steps do not move with the instants "
                              "at which bodies touch yet, and derivatives would be wrong by per cents; take the contact or stop "
                              "away where it does not touch, or compare runs")
    if scene.controllers:
        raise DerivativeError(f"there are no derivatives of runs with the sampled controller '{scene.controllers[0].name}': what "
                              "its function does is not known; state the control law by expressions (s.state, s.signal), or "
                              "compare runs")


def refuse_run(result: Result) -> None:
    """Raise DerivativeError for a run without derivatives."""
    prepared, run = result.prepared, result.solution
    refuse_scene(prepared)
    if len(run.t) < 2:
        raise DerivativeError("a state at rest has no derivatives yet; compare states at rest of two values")
    if len(run.systems) > 1:
        raise DerivativeError(f"there are no derivatives of this run: the constraint rows in force change at t = "
                              f"{run.systems[1][0]:.6g} s; leave redundant joints out, or compare runs")
    end = float(run.t[-1])
    ended = [event.name for event in result.events if abs(event.time - end) <= 1e-12 * max(abs(end), 1.0)]
    if ended:
        refuse_scene(prepared, ends=True)
    fresh = prepared_from(prepared.model.scene, None, end).start
    for a, b in ((prepared.start.q, fresh.q), (prepared.start.u, fresh.u), (prepared.start.s, fresh.s)):
        if prepared.start.t != fresh.t or np.any(np.abs(a - b) > SAME * np.max(np.abs(b), initial=1.0)):
            refuse_scene(prepared, continued=True)
    if not run.complete:
        raise DerivativeError("there are no derivatives of a run that was stopped before its end: let it end")
