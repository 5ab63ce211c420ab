"""Statements of feedback: sensors as symbols, internal states, named signals."""

from __future__ import annotations

from typing import Any

from mbdae.inputs import sensed as symbols
from mbdae.laws.control import InternalState
from mbdae.scene import reading
from mbdae.scene.components import Signal
from mbdae.scene.connections import ConnectionStatements
from mbdae.scene.reading import reads
from mbdae.scene.record import statement
from mbdae.values import option, text

FED = reading.driven("1", sensors=True)


class ControlStatements(ConnectionStatements):
    """`sensor`, `state`, `signal`: what loads, drives and controllers depend on beside the time."""

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

    def _add_signal(self, signal: Signal) -> None:
        self._claim(signal.name)
        self.signals.append(signal)
        self._keep_read_coordinates()


def _symbol(path: str) -> Any:
    """As SymPy sees it."""
    import sympy

    return sympy.Symbol(symbols.symbol_name(path), real=True)
