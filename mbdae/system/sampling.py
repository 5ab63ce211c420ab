"""The distance between two motions of a scene, a number without unit in which every error of a run is measured.

Sampled controllers in a run: user's functions that are called at sampling instants with values of sensors; their outputs stay
constant in between.

The outputs are internal states with the rate 0, so that they are part of every solution. A run ends a step at every sampling
instant and continues from the state with the new outputs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import ControllerError, DerivativeError
from mbdae.inputs.breaks import SAME as ROUND_OFF
from mbdae.inputs.sensed import symbol
from mbdae.notation import counted
from mbdae.scene.components import Controller
from mbdae.system.assembled.guards import Observer
from mbdae.system.base import Array
from mbdae.system.model.nodes import Node, rotation_matrices
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.motion.states import gaps_of
from mbdae.system.prepare import Prepared
from mbdae.values import shown

MotionRows = tuple[Array, Array]  #: q (nt, nq), u (nt, nu) of all nodes


def motion_distance(prepared: Prepared, a: MotionRows, b: MotionRows) -> Array:
    """(nt,) distance of two motions at the same times: the largest difference of a position over the scene's length, or of an
    angle in rad. In scenes without elastic bodies (their velocities contain vibrations) also of velocities, over the larger of
    length / characteristic time and the speed reached; but not while one of the motions is in contact, because an impact that is
    slightly later would count as a large error of velocity."""
    m, (q_a, u_a), (q_b, u_b) = prepared.mechanics, a, b
    worst = np.zeros(len(q_a))
    apart = np.ones(len(q_a), dtype=bool)
    if prepared.contacts:
        apart = ~np.logical_or(touching(m, *a), touching(m, *b))
    for mask, unit in ((~m.rotational, prepared.length), (m.rotational, 1.0)):
        if mask.any() and not m.model.elastic:
            reference = max(unit / prepared.time, float(np.max(np.abs(u_b[:, mask]))))
            worst = np.maximum(worst, apart * np.max(np.abs(u_a - u_b)[:, mask], axis=1) / reference)
    if "alike" not in prepared.kept:
        prepared.kept["alike"] = alike = dict[Any, list[Node]]()
        for node in m.model.nodes:
            alike.setdefault((node.kind, node.unit), []).append(node)
    for nodes in prepared.kept["alike"].values():
        at = np.array([node.q for node in nodes])[:, None] + np.arange(nodes[0].kind.sizes[0])
        worst = np.maximum(worst, np.max(position_distance(prepared, nodes[0], q_a[:, at], q_b[:, at]), axis=1))
    return worst


def position_distance(prepared: Prepared, node: Node, a: Array, b: Array) -> Array:
    """(...) distance of positions a, b (..., size) of nodes like the given one: displacement over the scene's length, or angle
    in rad."""
    n, unit, size = node.kind.translations, prepared.length if node.unit == "m" else 1.0, a.shape[-1]
    apart = np.linalg.norm(a[..., :n] - b[..., :n], axis=-1) / unit
    if size == 3 and node.kind.turns:
        apart = np.maximum(apart, np.abs(a[..., 2] - b[..., 2]))
    elif size == 7:
        apart = np.maximum(apart, _angle_between(a[..., 3:], b[..., 3:]))
    return np.asarray(apart)


def places(prepared: Prepared, modes: str, q: Array) -> Array:
    """(nt, k, 3) places of the nodes of the reduced body with the given modes, at positions q (nt, nq), m."""
    item = prepared.model.scene[modes]
    body, frame = item.laws[0].reduced, prepared.model.node(item.k)
    assert frame is not None
    moved = body.nodes - body.center + body.displacement(body.coordinates(prepared, item, q))[..., :3]
    turned = rotation_matrices(q[:, frame.q + 3 : frame.q + 7])
    return np.asarray(q[:, None, frame.q : frame.q + 3] + np.einsum("tab,tkb->tka", turned, moved))


def touching(mechanics: Mechanics, q: Array, u: Array) -> Array:
    """(nt,) bool: whether any contact of a scene is closed."""
    gaps = gaps_of(mechanics, np.zeros(len(q)), q, u)
    return np.asarray(np.any(np.hstack([gap for gap, _ in gaps.values()]) < 0, axis=1))


def distance(prepared: Prepared, t: Array, a: Array, b: Array) -> Array:
    """(nt,) `motion_distance` of two solutions a, b (nt, n) in the unknowns of any form at times t (nt,)."""
    return motion_distance(prepared, prepared.states(t, a)[:2], prepared.states(t, b)[:2])


def _angle_between(P: Array, Q: Array) -> Array:
    """Angle (...) of the rotation between quaternions (..., 4) of any length."""
    p, q = P / np.linalg.norm(P, axis=-1, keepdims=True), Q / np.linalg.norm(Q, axis=-1, keepdims=True)
    gap = np.minimum(np.linalg.norm(p - q, axis=-1), np.linalg.norm(p + q, axis=-1))
    return np.asarray(4 * np.arcsin(np.clip(gap / 2, 0, 1)))


#: difference of two instants, over the sampling period, up to which they count as one, if round-off of the time is not larger;
#: also difference (absolute plus relative) up to which outputs count as those stored
SAME = 1e-9
#: differences of a controller's outputs over this share of its values, and how well the derivative stated has to agree with them
SLIGHT, ALIKE = 1e-5, 1e-3
#: the first FIRST calls of a controller and then every THEN-th are made twice, to check that it is a pure function: its outputs
#: depend on its arguments alone
FIRST, THEN = 4, 64


class UnderWay(NamedTuple):
    """The state of a controller between two parts of a run: its first sampling instant (s), the number of its calls so far, and
    its memory, the value that a user's function returns to be given to its next call."""

    begin: float
    calls: int
    memory: Any


@dataclass
class _Called:
    """A controller in one run. inputs: where its sensors are among the values of the `Observer`; outputs: numbers of its outputs
    among the unknowns; begin: first sampling instant (s); count: number of its calls; held: outputs of the last call."""

    controller: Controller
    inputs: slice
    outputs: list[int]
    begin: float
    memory: Any
    count: int = 0
    held: list[float] = field(default_factory=list)

    @property
    def next(self) -> float:
        """The next sampling instant, s."""
        return self.instant(self.count)

    def instant(self, n: int) -> float:
        """The sampling instant (s) of call n, counted from 0."""
        return self.begin + n * self.controller.every

    def near(self, t: float) -> float:
        """Difference (s) of two instants near time t up to which they count as one."""
        return max(SAME * self.controller.every, ROUND_OFF * abs(t))

    def call(self, t: float, values: Sequence[float]) -> list[float]:
        """Call the function at the sampling instant t (s) with the values of its sensors; returns its outputs. Raises
        ControllerError with time and inputs where the function fails, or returns other outputs when called twice."""
        self.count += 1
        again = self.count <= FIRST or self.count % THEN == 0
        before = deepcopy(self.memory) if again else None
        self.held, self.memory = found, self.memory = self._outputs(t, values, self.memory)
        if again:
            twice, memory = self._outputs(t, values, before)
            returned = (found, twice) if not _same(twice, found) else (self.memory, memory)
            if not _same(*returned):
                kind = "" if returned[0] is found else "the memory "
                raise self._error(t, values, f"is not pure: called twice with the same values it returned {kind}{returned[0]} "
                                             f"and then {returned[1]}; a run is repeated to measure its error, so its function "
                                             "may remember things in `memory` only, and use no random numbers or "
                                             "clock")
        return found

    def derivative(self, t: float, values: Array) -> Array:
        """Derivatives (outputs, values) of the outputs by the values of the sensors, as the user states them, compared with
        differences; DerivativeError where they are not."""
        of, shape = self.controller, (len(self.controller.sets), len(values))
        try:
            stated: Any = of.derivative(t, *values.tolist())  # type: ignore[misc]
            found: Array = np.array(stated, dtype=np.float64).reshape(shape)
        except (TypeError, ValueError) as error:
            raise DerivativeError(f"derivative= of the controller '{of.name}' has to return {shape[0]} x {shape[1]} numbers, the "
                                  f"derivatives of {', '.join(of.sets)} by its values: {error}") from error
        steps = np.diag(SLIGHT * (1 + np.abs(values)))
        sides = [[np.array(self._outputs(t, (values + side * h).tolist(), None)[0]) for side in (1, -1)] for h in steps]
        true = np.array([(a - b) / (2 * h.max()) for (a, b), h in zip(sides, steps, strict=True)]).reshape(shape[::-1]).T
        if not np.allclose(found, true, rtol=ALIKE, atol=ALIKE * float(np.abs(true).max(initial=SLIGHT))):
            raise DerivativeError(f"derivative= of the controller '{of.name}' returns {found.tolist()} at t = {t:.9g} s, but "
                                  f"differences of its function give {true.tolist()}: correct it")
        return found

    def check_held(self, t: float, values: Sequence[float], there: list[float]) -> None:
        """Raise ControllerError where the outputs `there` in the stored state differ from those that the function returned last.
        When a run is continued from a folder, its steps are read from there and the controllers are called again only to restore
        their memories; the function may have been edited since."""
        if self.held and not all(abs(a - b) <= SAME * (1 + abs(b)) for a, b in zip(there, self.held, strict=True)):
            raise self._error(t, values, f"returned {shown(self.held)} at its last sampling instant, but {shown(there)} "
                                         f"when the steps were made: a stored run continues only with the function it began "
                                         f"with and the numbers this uses; name another folder by checkpoint= for a new "
                                         f"run")

    def _outputs(self, t: float, values: Sequence[float], memory: Any) -> tuple[list[float], Any]:
        names, function, remembers = self.controller.sets, self.controller.function, self.controller.memory is not None
        try:
            found = function(t, *values, memory) if remembers else function(t, *values)
        except Exception as error:
            raise self._error(t, values, f"cannot go on: its function raised {type(error).__name__}: {error}; correct it for "
                                         "these inputs") from error
        if remembers:
            if not (isinstance(found, tuple) and len(found) == 2):
                raise self._error(t, values, f"returned {shown(found)}: with memory= it has to return (outputs, memory)")
            found, memory = found
        given = [found] if len(names) == 1 and np.ndim(found) == 0 else found
        try:
            outputs = [_number(value) for value in given]
        except (TypeError, ValueError):
            raise self._error(t, values, f"returned {shown(found)}, which is not {self._wanted()}") from None
        if len(outputs) != len(names):
            raise self._error(t, values, f"returned {counted(len(outputs), 'output')}, {shown(found)}, but has to return "
                              f"{self._wanted()}")
        not_finite = [f"{name} = {value}" for name, value in zip(names, outputs, strict=True) if not math.isfinite(value)]
        if not_finite:
            raise self._error(t, values, f"returned {', '.join(not_finite)}, but has to return finite numbers")
        return outputs, memory

    def _wanted(self) -> str:
        names = self.controller.sets
        return f"a number for {names[0]}" if len(names) == 1 else f"{len(names)} numbers for {', '.join(names)}"

    def _error(self, t: float, values: Sequence[float], fault: str) -> ControllerError:
        inputs = dict(zip(self.controller.reads, values, strict=True))
        seen = ", ".join(f"{name} = {value:.9g}" for name, value in inputs.items()) or "none"
        return ControllerError(f"controller '{self.controller.name}' {fault} (at t = {t:.9g} s; its inputs: {seen})", t, inputs)


def _number(value: Any) -> float:
    """The value as a float; raises TypeError for texts, also those that float() would read."""
    if isinstance(value, str | bytes):
        raise TypeError
    return float(value)


def _same(a: Any, b: Any) -> bool:
    """Whether two outputs or memories are exactly equal, NaN to NaN too; objects of unknown classes count as equal."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=True)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    plain = (int, float, str, bool, type(None), complex)
    return not isinstance(a, plain) or bool(a == b) or (a != a and b != b)


@dataclass
class Sampler:
    """The controllers of one run, with their memories. due: those that are called at the begin of the present part."""

    observer: Observer
    called: list[_Called]
    due: list[_Called] = field(default_factory=list)

    def instants(self, end: float) -> Array:
        """Sampling instants (k,), s, from the begin of the run on, and `end`; not sorted where there are several controllers."""
        return np.concatenate([*[np.arange(c.next, end, c.controller.every) for c in self.called], [end]])

    def parts(self, begin: float, end: float) -> Iterator[tuple[float, float]]:
        """Begin and end (s) of the parts into which sampling instants divide an interval; sets `due` before each part."""
        while begin < end:
            self.due = [c for c in self.called if c.next - begin <= c.near(begin)]
            coming = [(c.instant(c.count + 1) if c in self.due else c.next, c) for c in self.called]
            later = min((t for t, c in coming if end - t > c.near(end)), default=end)
            yield begin, later
            begin = later

    def at(self, t: float, y: Array) -> Array:
        """Call the controllers that are due at t with sensors at the state y (n,): y with their new outputs; y itself where none
        changes."""
        if not self.due:
            return y
        values = self.observer(np.array([t]), y[None])[0].tolist()
        new = y
        for c in self.due:
            there = y[c.outputs].tolist()
            c.check_held(t, values[c.inputs], there)
            if (found := c.call(t, values[c.inputs])) != there:
                new = y.copy() if new is y else new
                new[c.outputs] = found
        return new


class Sampling:
    """The controllers of a scene, for equations with this numbering of unknowns; a call with the begin of a run (s) returns its
    `Sampler`. under_way: name -> state of controllers that an earlier part of the run has called already."""

    def __init__(self, prepared: Prepared, numbering: Numbering, under_way: Mapping[str, UnderWay] | None = None) -> None:
        self._given = prepared, numbering
        self._under_way = prepared.start.controllers if under_way is None else under_way
        self._controllers: list[Controller] = prepared.model.scene.controllers
        read = [symbol(path) for c in self._controllers for path in c.reads]
        self._observer = Observer(prepared.model, prepared.all_bodies.moved, read)
        self._slots = {name: numbering.place_of_state(name) for c in self._controllers for name in c.sets}

    def __call__(self, begin: float) -> Sampler:
        called, first = [], 0
        for c in self._controllers:
            inputs = slice(first, first := first + len(c.reads))
            anew = UnderWay(begin, 0, None if c.memory is None else c.memory.value)
            at = self._under_way.get(c.name, anew)
            called.append(_Called(c, inputs, [self._slots[name] for name in c.sets], at.begin, deepcopy(at.memory), at.calls))
        return Sampler(self._observer, called)

    def until(self, end: float, t: Array, y: Array) -> dict[str, UnderWay]:
        """name -> state of every controller just before the instant `end` (s) of a run whose steps ended at t (m,), y (m, n). To
        restore their memories the controllers are called again at all instants; ControllerError where they return other outputs
        than those in y."""
        (prepared, numbering), columns = self._given, list(self._slots.values())
        sampler, held = self(float(t[0])), prepared.start.s[np.array(columns) - numbering.start["s"]]
        for begin, _ in sampler.parts(float(t[0]), end):
            k = int(np.argmin(np.abs(t - begin)))
            before = y[k].copy()
            before[columns] = y[k - 1, columns] if k else held
            sampler.at(float(t[k]), before)
        return {c.controller.name: UnderWay(c.begin, c.count, c.memory) for c in sampler.called}

    def going_on(self, end: float, t: Array, y: Array) -> Sampling:
        """The controllers for a part of the run that begins at `end` (s), after the steps t (m,), y (m, n); see `until`."""
        return Sampling(*self._given, under_way=self.until(end, t, y))
