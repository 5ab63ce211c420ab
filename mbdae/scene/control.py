"""Checks of the inputs of a scene over a run: finite, and without jumps of value or rate where a joint is prescribed.

Statements of feedback: sensors as symbols, internal states, named signals.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.inputs import sensed as symbols
from mbdae.inputs import timed
from mbdae.inputs.breaks import TooManyError, beyond, jumps, unresolved
from mbdae.inputs.resolution import resolved
from mbdae.inputs.sensed import paths
from mbdae.inputs.tables import lookup_of, readable
from mbdae.laws.bodies import HeldOutput, InternalState
from mbdae.notation import counted
from mbdae.scene import reading
from mbdae.scene.components import AsGiven, BeamLoad, Connection, Controller, Signal
from mbdae.scene.connections import ConnectionStatements
from mbdae.scene.reading import Argument, reads
from mbdae.scene.record import statement
from mbdae.symbolic.frames import NodeKind, make_frame
from mbdae.symbolic.joint import Coupling, Joint
from mbdae.symbolic.law import Law
from mbdae.symbolic.rebuild import is_condition, nodes
from mbdae.symbolic.vectors import Expr
from mbdae.values import BadValueError, number, option, sequence, several, shown, text

SMOOTH_RAMP = "join the pieces by a smooth ramp such as h*(3*x**2 - 2*x**3), x = (mb.t - t1)/T from 0 to 1"
CUBIC_TABLE = "give kind=\"cubic\", and a table that ends without slope where it is held beyond its ends"
#: what the user calls a value, where the statement has a word of its own for it
_ARGUMENTS = {("revolute", "load"): "torque", ("prismatic", "load"): "force", ("prismatic", "displacement"): "position"}
#: jumps of a prescribed motion, or of its rate, up to this part of its largest magnitude in the run count as rounding errors; so
#: does what the round-off of the time changes
JUMP = 1e-7
MOST = 20_000  #: largest number of time intervals at whose ends and middles the values of an input are checked to be finite


class Input(NamedTuple):
    """One expression of time in a scene: its description, its unit, whether it prescribes the motion of a joint, and whether it
    prescribes velocities alone, whose kinks are jumps of accelerations."""

    what: str
    expression: Expr
    unit: str
    moves: bool
    may_bend: bool = False


def inputs(connections: list[Connection], loads: list[BeamLoad]) -> Iterator[Input]:
    """Every expression of time of a scene."""
    stated: list[tuple[str, str, Any]] = [(item.kind, item.name, law) for item in connections for law in item.laws]
    for kind, name, law in stated + [("load", load.name, load.law) for load in loads]:
        for key, parameter in law.params.items():
            value = getattr(law, key)
            if value is not None and getattr(se.sympify(value), "free_symbols", None) and not paths(value):
                drives = law.drives() if isinstance(law, Joint) else {}
                said = _ARGUMENTS.get((kind, drives.get(key, key)), drives.get(key, key))
                what = readable(f"{kind} '{name}': {said} = {value}")
                yield Input(what, se.sympify(value), parameter.unit, isinstance(law, Joint | Coupling), _is_speed(law, key))


def _is_speed(law: Any, key: str) -> bool:
    """Whether a parameter of a joint or coupling stands in rows of velocities alone."""
    if type(law).velocity_constraints is Law.velocity_constraints or key in law.drives() or (
            isinstance(law, Joint) and law.states_motion()):
        return False
    stated = law.symbolic(law.structure())
    vars(stated).update({name: se.Symbol(name) for name in law.own_coordinates})
    rows = stated.constraints(*(make_frame(side, NodeKind.SPATIAL) for side in law.frames))
    return not any(se.Symbol(key) in se.sympify(e).free_symbols for e in rows.values())


def stated_values(connections: list[Connection], signals: list[Signal]) -> list[tuple[str, str, Any]]:
    """Kind and name of every law, signal and state with each of its values: numbers, expressions, None."""
    found = [(c.kind, c.name, getattr(law, key)) for c in connections for law in c.laws for key in law.params]
    return found + [(one.kind, one.name, one.value if one.law is None else getattr(one.law, "rate", None)) for one in signals]


def _fed(connections: list[Connection], signals: list[Signal]) -> Iterator[Input]:
    """Parts that depend on time alone in expressions that read sensors, of laws, signals and states."""
    for kind, name, value in stated_values(connections, signals):
        if paths(value) or (kind in ("signal", "state") and getattr(value, "free_symbols", None)):
            yield from (Input(readable(f"{kind} '{name}': {e}"), e, "1", False)
                        for e in dict.fromkeys(of_time(se.sympify(value))))


def of_time(e: Expr) -> Iterator[Expr]:
    """The largest parts of an expression that depend on time alone. Of the cases of a Piecewise only parts with tables: the
    others need not be finite at times at which their case does not hold."""
    if e.free_symbols == {timed.TIME} and not is_condition(e):
        yield e
        return
    for part in e.args:
        yield from (one for one in of_time(part) if not isinstance(e, se.Piecewise) or any(map(lookup_of, nodes(one))))


def problems(scene: Any, t0: float, t_end: float, continued: bool = False) -> list[str]:
    """Mistakes in the inputs of a scene in [t0, t_end], one sentence each; continued: an earlier run ended at t0."""
    found = [*inputs(scene.connections, scene.line_loads), *_fed(scene.connections, scene.signals)]
    return [text for one in found for text in _of_one(one, t0, t_end, continued)]


def _of_one(one: Input, t0: float, t_end: float, continued: bool) -> list[str]:
    try:
        short = beyond(one.expression, t0, t_end)
    except TooManyError:
        short = ""  # `resolved` raises the same error below, where it is reported
    if short:
        return [f"{one.what}: {short}"]
    parts = list(timed.derivatives(one.expression)) if one.moves else [timed.sided(one.expression)]
    for part, value_or_rate in zip(parts, ("value", "rate", "second derivative"), strict=False):
        start = float(timed.values(part, np.array([t0]))[0])
        if not np.isfinite(start):
            return [f"{one.what}: its {value_or_rate} is {start} at the start t = {t0:g} s; give an input that is finite there"]
    try:
        edges, found = resolved(timed.used(one.expression, one.moves), t0, t_end)
    except TooManyError as too_many_steps_with_remedy:
        return [f"{one.what} cannot be followed by a run: {too_many_steps_with_remedy}"]
    twice = unresolved(one.expression, t0, t_end)
    if twice is not None:
        return [f"{one.what} changes at t = {twice[0]:.9g} s and again {twice[1]:.1e} s later, which is shorter than any step "
                f"there: let more time pass between both, count the time from an instant near them, or give their effect as a "
                f"start value"]
    step = len(found.edges) // MOST + 1
    low, high = found.edges[:-1][::step], found.edges[1:][::step]
    middle = (low + high) / 2
    stretch = np.clip(np.searchsorted(edges, middle) - 1, 0, len(edges) - 2)
    side = ((edges[1:] + edges[:-1]) / 2)[stretch]
    times, sides = np.r_[low, middle, high], np.r_[side, side, side]
    values = [timed.values(part, times, sides) for part in parts]
    poles = np.concatenate([times[~np.isfinite(values[0])], found.poles])
    if len(poles):
        first = f"t = {float(np.min(poles)):.6g} s"
        if one.moves:
            return [f"{one.what}: its value, rate or second derivative is not finite near {first}; the bodies cannot follow; "
                    f"give a motion for which all three stay finite"]
        return [f"{one.what} is not finite near {first}; give an input that stays finite"]
    before = [2 * t0 - timed.after(t0)] if continued else []
    return _jumps(one, parts, values, edges, before) if one.moves else []


def _jumps(one: Input, parts: list[Expr], values: list[Any], edges: Any, before: list[float]) -> list[str]:
    """Messages about breaks at which a prescribed motion or its rate jumps. parts: the motion and its derivatives; values: theirs
    at many times; edges: start, breaks and end, s; before: for a continued run, a time just before its start."""
    middle = np.r_[before, (edges[1:] + edges[:-1]) / 2]
    at = (edges if before else edges[1:])[:-1]
    if not len(at):
        return []
    smooth_ramp_or_cubic_table = CUBIC_TABLE if timed.split(tuple(parts[:1])).readings else SMOOTH_RAMP
    for order in (0,) if one.may_bend else (0, 1):
        size, steep = (float(np.max(np.abs(v[np.isfinite(v)]), initial=0.0)) for v in values[order : order + 2])
        by = jumps(parts[order], at, middle[:-1], middle[1:])
        found = np.flatnonzero(np.abs(by) > max(JUMP * size, 1e-300) + 8 * np.spacing(at) * steep)
        if len(found):
            i = int(found[0])
            if order:
                return [f"{one.what}: its rate jumps by {by[i]:.4g} {one.unit}/s at t = {at[i]:.6g} s; that takes "
                        f"an infinite force; {smooth_ramp_or_cubic_table}"]
            return [f"{one.what} jumps by {by[i]:.4g} {one.unit} at t = {at[i]:.6g} s; the bodies cannot follow; "
                    f"{smooth_ramp_or_cubic_table}"]
    return []


def _words(arg: Argument, value: Any) -> list[str]:
    """Reader of a list of texts; a text alone stands for a list of one."""
    given = [value] if isinstance(value, str) else value
    if not (isinstance(given, list | tuple) and all(isinstance(one, str) and one.strip() for one in given)):
        arg.wrong(shown(value), "give a list of names, texts that are not empty")
        return []
    if len(set(given)) < len(given):
        arg.wrong(shown(value), "give every name once")
    return list(given)


def _function(arg: Argument, value: Any) -> AsGiven:
    """Reader of a function."""
    given = value.value if isinstance(value, AsGiven) else value
    if callable(given) and not isinstance(given, type):
        return AsGiven(given)
    arg.wrong(f"{shown(given)} is no function",
              "give a function of the time and of the values of the sensors `reads`: f(t, *values)")
    return AsGiven(lambda *_: 0.0)


def _numbers(arg: Argument, value: Any) -> list[float]:
    """Reader of a number or a list of numbers."""
    try:
        return sequence(value, number) if several(value) else [number(value)]
    except BadValueError as value_and_reason:
        arg.wrong(value_and_reason, "give a list of numbers, one for each output")
        return []


def _memory(arg: Argument, value: Any) -> AsGiven:
    """Reader of the memory of a controller: any object, kept as it is."""
    return value if isinstance(value, AsGiven) else AsGiven(value)


def _not_called(f: Any, values: int, remembers: bool) -> str:
    """Why f cannot be called with the time, so many values and its memory; "" where it can or where that is unknown."""
    try:
        inspect.signature(f).bind(*range(1 + values + remembers))
    except TypeError as error:
        takes = ", ".join(["t", *(f"value {n + 1}" for n in range(values)), *(["memory"] if remembers else [])])
        return f"f cannot be called with ({takes}): {error}"
    except ValueError:  # functions written in C may have no signature to check
        pass
    return ""


FED = reading.driven("1", sensors=True)


class ControlStatements(ConnectionStatements):
    """`sensor`, `state`, `signal`, `controller`: what loads and drives can depend on in addition to the time."""

    def sensor(self, path: str) -> Any:
        """The symbol of a sensor, for expressions of loads, torques, forces and states: a coordinate of a joint ("J.angle",
        "J.displacement") or its rate ("J.rate", "J.angle_rate"), a component of the motion of a body or place ("b.position[1]",
        "b.at(0.5).velocity[0]", "b.angular_velocity[2]", "b.rotation[0, 1]"), or a state, signal or output of a controller by its
        name. Items may be stated later; what does not exist is named by `check`."""
        return _symbol(option("sensor", path, text, "name a sensor such as 'J.angle' or 'b.position[1]'"))

    @reads(name=reading.name, rate=FED, start=reading.quantity("1"), size=reading.quantity("1", "positive"))
    @statement
    def state(self, name: str, rate: Any, start: float = 0.0, size: float = 1.0) -> Any:
        """An internal state of a controller, filter or actuator: d state / dt = `rate`, an expression of sensors and mb.t, from
        `start`. Returns its symbol; results show it as r[name]. `size`: typical magnitude, to which its tolerance is relative."""
        self._add_signal(Signal(name, "state", InternalState(name, rate=rate, start=start, size=size)))
        return _symbol(name)

    @reads(name=reading.name, value=FED)
    @statement
    def signal(self, name: str, value: Any) -> Any:
        """A name for an expression of sensors and mb.t, for control laws that use it more than once. Returns its symbol; results
        show it as r[name]."""
        self._add_signal(Signal(name, "signal", value=value))
        return _symbol(name)

    @reads(name=reading.name, f=_function, every=reading.quantity("s", "positive"), reads=_words, sets=_words, memory=_memory,
           start=_numbers, derivative=_function)
    @statement
    def controller(self, name: str, f: Any, every: float, reads: Any = (), sets: Any = (), memory: Any = None,
                   start: Any = None, derivative: Any = None) -> None:
        """A sampled controller: f(t, *values) is called at the start and every `every` s with the values of the sensors `reads`;
        it returns the outputs `sets` (a number where that is one name), which act from that instant on and are held until the
        next: torque="u", s.sensor("u"). With `memory` it is f(t, *values, memory) and returns (outputs, memory); `memory` is what
        it gets at the start. `start`: values of the outputs with which the scene is made ready for its first call, 0 by default.
        Values are those before any output changes. f must be pure: runs are repeated to measure errors.

        derivative(t, *values): the derivatives of the outputs by the values, (outputs, values), for `r.gradient` and
        `r.sensitivity`; a controller with `memory` has none."""
        item = f"controller '{name}'"
        if not sets:
            self.problems.append(f"{item}: sets names no output that can be used; give one or more, as in sets=['u']")
        for function in (f, *([] if derivative is None else [derivative])):
            if wrong := _not_called(function.value, len(reads), memory is not None):
                self.problems.append(f"{item}: {wrong}")
        self._claim(name)
        self.controllers.append(Controller(name, f.value, memory, every, tuple(reads), tuple(sets),
                                           None if derivative is None else derivative.value))
        self._keep_read_coordinates(self.controllers[-1])
        starts = [0.0] * len(sets) if start is None else start
        if starts and len(starts) != len(sets):
            self.problems.append(f"{item}: start = {shown(starts)} has {len(starts)} numbers for {counted(len(sets), 'output')}; "
                                 f"give one for each")
        for output, value in zip(sets, starts or [0.0] * len(sets), strict=False):
            self._add_signal(Signal(output, "output", HeldOutput(output, rate=0.0, start=value, size=1.0)))

    def _add_signal(self, signal: Signal) -> None:
        self._claim(signal.name)
        self.signals.append(signal)
        self._keep_read_coordinates(signal)


def _symbol(path: str) -> Any:
    """The SymPy symbol of a sensor's path."""
    import sympy

    return sympy.Symbol(symbols.symbol_name(path), real=True)
