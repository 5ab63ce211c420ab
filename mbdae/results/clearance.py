"""Sensors of contacts: gap, forces, slip, contacts, wear; of a joint with clearance also its orbit."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from mbdae.notation import quantity
from mbdae.results.sensors import ConnectionSensor, judged
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array


def observed_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Quantities that the sensor of a law reads in addition to force, torque and power."""
    if not isinstance(d.law, Force):
        return []
    v = d.variation
    return [((name, i), v.resolve(v.name(e))) for name, parts in d.law.observed(*d.sides).items() for i, e in enumerate(parts)]


class ContactSensor(ConnectionSensor):
    """Sensor of two surfaces that touch: force, torque and power as of every force, and the quantities of their contact.

    Arrays (nt,) over the result's times; where they may touch at several places (nt, places).
    """

    def at_times(self, t: Array) -> dict[str, Array]:
        """All quantities of the contact at times t (nt,), by name, (nt, places): a column for each place where it may touch."""
        columns: dict[str, list[Array]] = {}
        prepared = self._result.prepared
        for g, p, values in prepared.mechanics.evaluate(observed_outputs, t, *self._result.states(t)):
            for i, instance in enumerate(prepared.model.groups[g].instances):
                if instance.item == self._item.name:
                    for o, (name, _) in enumerate(p.targets):
                        columns.setdefault(name, []).append(values[:, i, o])
        return {name: np.stack(parts, axis=1) for name, parts in columns.items()}

    @cached_property
    def on_steps(self) -> dict[str, Array]:
        """`at_times` on the steps of the run."""
        return self.at_times(self._result.solution.t)

    @cached_property
    def _seen(self) -> dict[str, Array]:
        return self.at_times(self._result.t)

    def _observed(self, name: str) -> Array:
        values = self._seen[name]
        return values[:, 0] if values.shape[1] == 1 else values

    @property
    @quantity("m")
    def gap(self) -> Array:
        """Distance of the surfaces, m; negative in contact."""
        return self._observed("gap")

    @property
    @quantity("m/s")
    def gap_rate(self) -> Array:
        """Rate of the gap, m/s."""
        return self._observed("gap_rate")

    @property
    @quantity("m")
    def penetration(self) -> Array:
        """Depth by which the surfaces overlap, m; 0 where they are apart."""
        return np.maximum(0.0, -self.gap)

    @judged
    @quantity("N", loop=True)
    def normal_force(self) -> Array:
        """Normal force, N; 0 where the surfaces are apart."""
        return self._observed("normal_force")

    @judged
    @quantity("N")
    def friction_force(self) -> Array:
        """Magnitude of the friction force, N. For a joint with clearance: the force on the pin along the vector product of the
        joint's axis and the contact normal, with its sign."""
        return self._observed("friction_force")

    @property
    @quantity("m/s")
    def slip(self) -> Array:
        """Sliding speed, m/s, also where the surfaces are apart. For a joint with clearance: the velocity of the pin's surface on
        that of the race along the vector product of the joint's axis and the contact normal, with its sign."""
        return self._observed("slip")

    @judged
    @quantity("W")
    def friction_power(self) -> Array:
        """Power lost in friction, W; negative where bristles give energy back."""
        return self._observed("friction_power")

    @judged
    @quantity("W")
    def wear_rate(self) -> Array:
        """Normal force times sliding speed, W: wear by Archard's law is proportional to it."""
        return np.asarray(self._observed("normal_force") * np.abs(self.slip))

    @cached_property
    def wear(self) -> float:
        """Normal force times sliding distance over the whole run, J (trapezoidal over its steps)."""
        from scipy.integrate import trapezoid

        seen = self.on_steps
        return float(trapezoid(np.sum(seen["normal_force"] * np.abs(seen["slip"]), axis=1), self._result.solution.t))

    def summary(self) -> dict[str, float]:
        """The contact in numbers: see `Result.contacts`."""
        return super().summary() | {"wear": self.wear}


class ClearanceSensor(ContactSensor):
    """Sensor of a revolute joint with clearance: quantities as of every joint, and the contact of its pin with its race.

    Arrays (nt,) over the result's times; for a bearing that touches at both ends (nt, 2), near and far end along the axis.
    """

    @property
    @quantity("m")
    def orbit(self) -> Array:
        """Centre of the pin relative to that of the race (nt, 2), m, in axes that turn with the race."""
        return self._seen["orbit"]

    def summary(self) -> dict[str, float]:
        """The contact in numbers: see `Result.contacts`."""
        law = self._item.laws[-1]
        return super().summary() | {"play": law.outer - law.inner}
