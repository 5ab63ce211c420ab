"""Statements of feedback: sensors as symbols, internal states, named signals."""

from __future__ import annotations

import inspect
from typing import Any

from mbdae.inputs import sensed as symbols
from mbdae.laws.control import HeldOutput, InternalState
from mbdae.scene import reading
from mbdae.scene.components import AsGiven, Controller, Signal
from mbdae.scene.connections import ConnectionStatements
from mbdae.scene.reading import Argument, reads
from mbdae.scene.record import statement
from mbdae.values import option, shown, text


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
              "give a function of the time and of the values of the sensors `reads`: f(t, *values)")  # fmt: skip
    return AsGiven(lambda *_: 0.0)


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

    @reads(name=reading.name, f=_function, every=reading.quantity("s", "positive"), reads=_words, sets=_words, memory=_memory)
    @statement
    def controller(self, name: str, f: Any, every: float, reads: Any = (), sets: Any = (), memory: Any = None) -> None:
        """A sampled controller: f(t, *values) is called at the start and every `every` s with the values of the sensors `reads`;
        it returns the outputs `sets` (a number where that is one name), which act from that instant on and are held until the
        next: torque="u", s.sensor("u"). With `memory` it is f(t, *values, memory) and returns (outputs, memory); `memory` is what
        it gets at the start. Values are those before any output changes. f must be pure: runs are repeated to measure errors."""
        item = f"controller '{name}'"
        if not sets:
            self.problems.append(f"{item}: sets names no output that can be used; give one or more, as in sets=['u']")
        wrong = _not_called(f.value, len(reads), memory is not None)
        if wrong:
            self.problems.append(f"{item}: {wrong}")
        self._claim(name)
        self.controllers.append(Controller(name, f.value, memory, every, tuple(reads), tuple(sets)))
        self._keep_read_coordinates(self.controllers[-1])
        for output in sets:
            self._add_signal(Signal(output, "output", HeldOutput(output, rate=0.0, start=0.0, size=1.0)))

    def _add_signal(self, signal: Signal) -> None:
        self._claim(signal.name)
        self.signals.append(signal)
        self._keep_read_coordinates(signal)


def _symbol(path: str) -> Any:
    """The SymPy symbol of a sensor's path."""
    import sympy

    return sympy.Symbol(symbols.symbol_name(path), real=True)
