"""Sensors of a joint with clearance: gap, forces, orbit, slip, contacts, wear."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mbdae.results.sensors import ConnectionSensor
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array

if TYPE_CHECKING:
    from mbdae.results.result import Result


def observed_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """What a law shows beside force, torque and power."""
    if not isinstance(d.law, Force):
        return []
    v = d.variation
    return [((name, i), v.resolve(v.name(e))) for name, parts in d.law.observed(*d.sides).items() for i, e in enumerate(parts)]


@dataclass(frozen=True)
class Contacts:
    """Every contact of a run in order of time, whatever times the result shows: begin, end (s), peak penetration (m), (n,).

    A contact that lasts at the end of the run ends there; where the bearing touches at both ends, both are counted."""

    begin: Array
    end: Array
    peak: Array

    def __len__(self) -> int:
        return len(self.begin)

    @property
    def first(self) -> float:
        """Time of the first contact, s; nan where there is none."""
        return float(self.begin[0]) if len(self.begin) else float("nan")

    @property
    def deepest(self) -> float:
        """Largest penetration, m; 0 where there is none."""
        return float(np.max(self.peak, initial=0.0))


class ClearanceSensor(ConnectionSensor):
    """A revolute joint with clearance: what every joint shows, and the contact of its pin with its race.

    Arrays (nt,) over the result's times; for a bearing that touches at both ends (nt, 2), near and far end along the axis.
    """

    def at_times(self, t: Array) -> dict[str, Array]:
        """Everything the contact shows at times t (nt,): (nt, parts) by name."""
        return observed(self._result, self._item.name, t)

    def _observed(self, name: str) -> Array:
        values = self.at_times(self._result.t)[name]
        return values[:, 0] if values.shape[1] == 1 else values

    @property
    def gap(self) -> Array:
        """Distance between pin and race, m; negative in contact."""
        return self._observed("gap")

    @property
    def gap_rate(self) -> Array:
        """Rate of the gap, m/s."""
        return self._observed("gap_rate")

    @property
    def penetration(self) -> Array:
        """How far pin and race overlap, m; 0 apart."""
        return np.maximum(0.0, -self.gap)

    @property
    def normal_force(self) -> Array:
        """N, 0 apart."""
        return self._observed("normal_force")

    @property
    def friction_force(self) -> Array:
        """N on the pin, along axis x normal."""
        return self._observed("friction_force")

    @property
    def slip(self) -> Array:
        """Sliding velocity of the pin on the race along axis x normal, m/s; also where they are apart."""
        return self._observed("slip")

    @property
    def orbit(self) -> Array:
        """Centre of the pin relative to that of the race (nt, 2), m, in axes that turn with the race."""
        return self.at_times(self._result.t)["orbit"]

    @property
    def friction_power(self) -> Array:
        """Power lost in friction, W; negative where bristles give energy back."""
        return self._observed("friction_power")

    @property
    def wear_rate(self) -> Array:
        """Normal force times sliding speed, W: wear by Archard's law is proportional to it."""
        return np.asarray(self.normal_force * np.abs(self.slip))

    @cached_property
    def wear(self) -> float:
        """Normal force times sliding distance over the whole run, J (trapezoidal over its steps)."""
        t = self._result.solution.t
        seen = self.at_times(t)
        return float(np.trapezoid(np.sum(seen["normal_force"] * np.abs(seen["slip"]), axis=1), t))

    @cached_property
    def contacts(self) -> Contacts:
        """Begin, end and peak penetration of every contact, found on the steps of the run."""
        t = self._result.solution.t
        seen = self.at_times(t)
        found = [contacts_of(t, gap, rate) for gap, rate in zip(seen["gap"].T, seen["gap_rate"].T, strict=True)]
        begin, end, peak = (np.concatenate(parts) for parts in zip(*found, strict=True))
        order = np.argsort(begin, kind="stable")
        return Contacts(begin[order], end[order], peak[order])


def observed(result: Result, item: str, t: Array) -> dict[str, Array]:
    """What the laws of an item show at times t (nt,): (nt, parts) by name."""
    columns: dict[str, list[Array]] = {}
    model = result.prepared.model
    for g, p, values in result.prepared.mechanics.evaluate(observed_outputs, t, *result.states(t)):
        for i, instance in enumerate(model.groups[g].instances):
            if instance.item == item:
                for o, (name, _) in enumerate(p.targets):
                    columns.setdefault(name, []).append(values[:, i, o])
    return {name: np.stack(parts, axis=1) for name, parts in columns.items()}


def contacts_of(t: Array, gap: Array, rate: Array) -> tuple[Array, Array, Array]:
    """Begin, end and peak penetration (n,) of the contacts of one place, by cubic interpolation of gap and rate on steps."""
    touching = gap < 0
    change = np.flatnonzero(np.diff(touching.astype(int)))
    times = np.array([_zero(t[i : i + 2], gap[i : i + 2], rate[i : i + 2]) for i in change])
    begin = np.r_[t[:1] if touching[0] else [], times[touching[change + 1]]] if len(change) else t[:1] if touching[0] else t[:0]
    end = times[~touching[change + 1]] if len(change) else t[:0]
    end = np.r_[end, t[-1:]] if touching[-1] else end
    depth = _deepest(t, gap, rate)
    peak = [np.max(depth[max(np.searchsorted(t, a, "right") - 1, 0) : max(np.searchsorted(t, b, "left"), 1)], initial=0.0)
            for a, b in zip(begin, end, strict=True)]  # fmt: skip
    return begin, end, np.array(peak)


def _hermite(t: Array, g: Array, r: Array) -> Array:
    """Coefficients (4,) of the cubic through values and rates at both ends, highest power first, over 0..1."""
    h = t[1] - t[0]
    a, b = r[0] * h, r[1] * h
    return np.array([2 * (g[0] - g[1]) + a + b, 3 * (g[1] - g[0]) - 2 * a - b, a, g[0]])


def _zero(t: Array, g: Array, r: Array) -> float:
    """Where the gap changes sign between two steps, s."""
    roots = np.roots(_hermite(t, g, r))
    real = roots[np.abs(roots.imag) < 1e-9].real
    inside = real[(real >= 0) & (real <= 1)]
    share = float(inside[0]) if len(inside) else float(g[0] / (g[0] - g[1]))
    return float(t[0] + share * (t[1] - t[0]))


def _deepest(t: Array, gap: Array, rate: Array) -> Array:
    """(steps,) largest penetration inside every step."""
    depth = np.maximum(-gap[:-1], -gap[1:])
    for i in np.flatnonzero((rate[:-1] < 0) & (rate[1:] > 0) & (np.minimum(gap[:-1], gap[1:]) < 0)):
        c = _hermite(t[i : i + 2], gap[i : i + 2], rate[i : i + 2])
        turning = np.roots(np.polyder(c))
        inside = turning[(np.abs(turning.imag) < 1e-9) & (turning.real > 0) & (turning.real < 1)].real
        depth[i] = max(depth[i], -float(np.min(np.polyval(c, inside), initial=0.0)))
    return np.maximum(depth, 0.0)
