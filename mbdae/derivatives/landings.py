r"""Touches in a run, at which steps end, and how these instants move with the numbers of the scene.

A gap g(t, y; p) that closes or opens at the end tau of a step stays 0 there as a number p changes:

    grad g . (S + y' dtau) + dg/dp + dg/dt dtau = 0,    dtau/dp = -(grad g . S + dg/dp) / (dg/dt + grad g . y'),

S = dy/dp at a fixed time. The steps behind move with tau, and keep their lengths, so that the derivative along them is that of
states which move, D = S + y' dtau/dp; at fixed times it is S = D - y' dtau/dp again. In a force that begins with the power 1.5 of
the penetration a stage that moves with the touch has a derivative which begins with that power too; that of one at a fixed time
begins with the power 0.5, which polynomials describe badly: per cents of the derivative of a bounce.

Also here: y' where F = 0 states it together with the multipliers, as an implicit function.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.derivatives.chart import ATTEMPTS, BOTH, CLOSER, DISTANCE, Chart, differenced
from mbdae.errors import DerivativeError, warn
from mbdae.integrators import radau_table
from mbdae.integrators.contact_steps import Cubic
from mbdae.integrators.solution import Solution
from mbdae.integrators.watched_arguments import ROUND
from mbdae.native.explicit import ALL
from mbdae.system.base import Array
from mbdae.system.motion.states import gaps_of
from mbdae.system.prepare import Prepared

BALANCED, ITERATIONS = 1e-13, 30  #: largest relative step of Newton's method for y' and the multipliers at which it stops
EXACT = 1e-9  #: share of a slope of gaps up to which differences of order 6 and 8 have to agree: that of order 8 is within 1e-12
#: a touch nearer to the beginning of a step, or to its end, than this share of the step counts as being there, in runs with
#: derivatives: the end exactly, because it may be that of the run, where what the touch has changed by then is all that there is
MEETS = 1e-6, 0.0
OFF = 1e-3  #: the same, for a derivative that is given: 1.5 powers of it are the share of a derivative that is lost
#: a contact that closes at less than this share of its largest closing speed, or a gap that passes its minimum at less than the
#: square of it, of the largest gap, counts as grazing
GRAZING = 1e-2
#: y' is compared on both sides of an instant, this share of the run away from it; a difference of more than JUMP times the
#: largest y' of the run counts as a jump
BESIDE, JUMP = 1e-9, 1e-5
BISECTIONS, TINY, ROUNDED = 60, 1e-300, 1e-15
#: steps become shorter towards touches: on the side on which the contact is closed they halve for this error, and by less for a
#: smaller one, with the power 1/6 of it, between the orders 5 and 8 of the methods; on the other side, which is there for a touch
#: that is a little earlier or later than in the run before, each is an eighth of the one before
HALVING, BETWEEN, OUTSIDE = 1e-6, 6, 8.0
#: what a step at a touch lacks falls with this power of its length over the time to the next touch, and is about this share of
#: the error; but the step is not bounded below the length at which the rounding of rates, of which this share counts, is as much
BESIDE_TOUCHES, LACKING, COUNTS = 1.5, 0.1, 1e-5


@dataclass(frozen=True, eq=False)
class Landing:
    """The end of a step at which a contact (its number) closes or opens. by_state (n,), by_numbers (P,): derivatives of its gap;
    rate: of the gap, m/s or rad/s; by_time: that without the motion of the unknowns; yp (n,): y' there;
    off: s, from the touch."""

    contact: int
    closes: bool
    by_state: Array
    by_numbers: Array
    rate: float
    by_time: float
    yp: Array
    off: float

    def moves(self, D: Array, shift: Array) -> Array:
        """(P,) how much later the touch is; D (n, P): derivatives of the state at the end of the step, which is later by `shift`
        (P,)."""
        return np.asarray(-(self.by_state @ D + self.by_numbers + self.by_time * shift) / self.rate)


def gaps(prepared: Prepared, t: Array, y: Array) -> Array:
    """Gaps and their rates (k, contacts, 2) at times (k,) and unknowns (k, n)."""
    q, u, _ = prepared.states(t, y)
    found = gaps_of(prepared.mechanics, t, q, u)
    return np.concatenate([np.stack(found[place], axis=2) for place in sorted(found)], axis=1)


def landings(run: Solution, charts: Sequence[Chart], scale: Array) -> dict[int, Landing]:
    """Number of a step -> the touch at its beginning, for a run whose steps end on touches."""
    prepared = charts[0].varied.base.prepared
    if not prepared.contacts:
        return {}
    values = gaps(prepared, run.t, run.y)
    closed, size = values[:, :, 0] < 0, np.maximum(np.abs(run.y).max(axis=0), scale)
    touches: dict[int, tuple[int, bool]] = {}
    for m, i in np.argwhere(closed[1:] != closed[:-1]):
        off = np.abs(values[[m, m + 1], i, 0]) / np.maximum(np.abs(values[[m, m + 1], i, 1]), TINY)
        at, h = m + int(off[1] < off[0]), run.t[m + 1] - run.t[m]
        if off.min() > max(OFF * h, ROUND * run.t[m + 1]) and min(m, 1):
            raise DerivativeError(f"no step of the run ends where contact {contact_name(run, i)} closes or opens near t = "
                                  f"{run.t[m + 1]:.6g} s, so that it has no derivative; ask for a smaller accuracy")
        if at:
            touches.setdefault(int(at), (int(i), bool(closed[m + 1, i])))
    if not touches:
        return {}
    places = np.array([*touches])
    of = np.array([contact for contact, _ in touches.values()])
    t, y, count = run.t[places], run.y[places], np.arange(len(places))

    def read(one: Prepared, states: Array) -> Array:
        return np.asarray(gaps(one, t, states)[count, of, 0])

    by_states = slopes(lambda states: read(prepared, states), y, size)
    by_numbers = np.stack([chart.varied.explicit(lambda one: read(one.prepared, y))[0] for chart in charts], axis=1)
    rates = values[places, of, 1]
    offs = np.abs(values[places, of, 0]) / np.maximum(np.abs(rates), TINY)
    return {int(m): Landing(contact, closes, by_states[k], by_numbers[k], float(rates[k]),
                            float(rates[k] - by_states[k] @ run.yp[m]), run.yp[m], float(offs[k]))
            for k, (m, (contact, closes)) in enumerate(touches.items())}


def slopes(read: Callable[[Array], Array], y: Array, size: Array) -> Array:
    """Derivatives (k, ..., n) of what is read of states y (k, n) by each of their unknowns, which have the sizes `size` (n,)."""
    found = []
    for e, by in zip(np.eye(len(size)), DISTANCE * size, strict=True):
        for _ in range(ATTEMPTS):
            one = differenced(lambda node, e=e, by=by: read(y + node * by * e), BOTH, by)  # type: ignore[misc]
            if one.agrees(EXACT):
                break
            by /= CLOSER
        found.append(one.found)
    return np.stack(found, axis=-1)


def towards_touches(run: Solution, prepared: Prepared, error: float) -> list[Array]:
    """For every instant at which a contact of a run closes or opens, times (s) between which steps become shorter towards it, for
    a run with a relative error.

    The force begins with the power 1.5 of the time from the one; steps before the other move with the touch before it, so that
    the derivative of the force ends there with the power 0.5 of the time that is left. Polynomials over long steps describe
    neither: without such times the derivatives of a bounce are 100 times less exact, at four fifths of the steps."""
    values, t = gaps(prepared, run.t, run.y), run.t
    closed, touches = values[:, :, 0] < 0, list[tuple[float, bool]]()
    for m, i in np.argwhere(closed[1:] != closed[:-1]):
        sign = 1.0 if closed[m + 1, i] else -1.0
        part = Cubic(t[m + 1] - t[m], *(sign * values[m : m + 2, i].T.ravel())).zero(1.0)
        touches.append((float(t[m] + part * (t[m + 1] - t[m])), sign > 0))
    touches.sort()
    found, instants = list[Array](), [t[0], *(instant for instant, _ in touches), t[-1]]
    inside = min(1 + (error / HALVING) ** (1 / BETWEEN), OUTSIDE)
    for (instant, closes), spans in zip(touches, np.diff(instants)[np.arange(len(touches))[:, None] + [0, 1]], strict=True):
        sides = []
        for way, span, ratio in zip((-1, 1), spans, (OUTSIDE, inside) if closes else (inside, OUTSIDE), strict=True):
            rounded = (COUNTS * np.finfo(float).eps * np.ptp(t) * span**BESIDE_TOUCHES) ** (1 / (1 + BESIDE_TOUCHES))
            least = max(rounded, (LACKING * error) ** (1 / BESIDE_TOUCHES) * span)
            count = int(np.ceil(np.log(span / least) / np.log(ratio))) if span > least else 0
            sides.append(instant + way * span / ratio ** np.arange(count + 1))
        found.append(np.unique(np.concatenate(sides)))
    return found


def shorter(parts: Sequence[Array], shares: Sequence[float]) -> Array:
    """Times between which there are shorter steps than between the times of every part (k,), by its share, where it has any."""
    times = np.unique(np.concatenate(parts))
    density = np.zeros(len(times) - 1)
    for part, share in zip(parts, shares, strict=True):
        first, last = np.searchsorted(times, part[[0, -1]])
        within = np.searchsorted(part, times[first:last], side="right") - 1
        density[first:last] = np.maximum(density[first:last], 1 / (share * np.diff(part)[within]))
    count = np.concatenate([[0.0], np.cumsum(density * np.diff(times))])
    return np.asarray(np.interp(np.linspace(0, count[-1], int(np.ceil(count[-1])) + 1), count, times))


def rates_at_nodes(run: Solution, stages: int, some: slice) -> Array:
    """y' (m, s + 1, n) of some steps at their beginnings and at all nodes, of the polynomials over them. Of very short steps the
    change up to the end is a difference of rounded states: where y' at the end says the same within rounding, it is taken."""
    table, interpolant = radau_table(stages), run.interpolant
    ends, inner = interpolant.ends[some], interpolant.inner[some]  # type: ignore[attr-defined]
    h, slopes = np.diff(run.t)[some, None], table.slopes(np.r_[0.0, table.c])
    change = ends - run.y[some]
    exact = (h * run.yp[1:][some] - np.einsum("k,mkn->mn", slopes[-1, :-1], inner)) / slopes[-1, -1]
    same = np.abs(exact - change) <= ROUNDED * (np.abs(ends) + np.abs(run.y[some]))
    increments = np.concatenate([inner, np.where(same, exact, change)[:, None]], axis=1)
    return np.asarray(np.einsum("jk,mkn->mjn", slopes, increments) / h[:, None])


def contact_name(run: Solution, contact: int) -> str:
    """Name of a contact of a run, in quotes."""
    names = run.systems[0][1].guard_names if run.systems else ()
    return f"'{names[contact]}'" if contact < len(names) else f"number {contact}"


def refuse_forces_that_jump(of: Any, beside: float, jump: float) -> None:
    """Raise DerivativeError where y' of a run (`steps.Derived`) jumps at a touch, by more than this share: the derivatives
    of speeds jump there. beside: distance from the touch at which y' is taken, over the length of the run. At a tenth of that
    a jump is as large; what is smaller there grows from the touch on, and may be the largest of a run that ends soon after. It is
    as large at ten times that too; what is smaller there is the rounding of rates in a step that is hardly longer."""
    run = of.run
    for m, one in of.landings.items():
        t, span = float(run.t[m]), max(beside * (run.t[-1] - run.t[0]), 100 * one.off)
        with of.within(t):
            wide, far, near = (of.jump(t + part * span * np.array([-1, 1])) for part in (10.0, 1.0, 0.1))
            if np.any((wide > jump) & (far > jump) & (near > far / 2)):
                raise DerivativeError(f"there are no derivatives of this run: the force of {contact_name(run, one.contact)} "
                                      f"jumps at t = {run.t[m]:.6g} s as bodies touch or part, and derivatives do not pass such "
                                      "jumps yet; state a normal law that begins at zero, such as mb.Hertz, or compare runs")


def tell_grazing(run: Solution, prepared: Prepared, found: dict[int, Landing]) -> None:
    """Warn of contacts that are hardly made, or missed: with slightly other numbers the sequence of contacts is another one, and
    the derivative holds for much smaller changes only."""
    values = gaps(prepared, run.t, run.y)
    fastest, widest = np.abs(values[:, :, 1]).max(axis=0), np.abs(values[:, :, 0]).max(axis=0)
    slow = [(float(run.t[m]), one.contact) for m, one in found.items()
            if one.closes and -one.rate < GRAZING * fastest[one.contact]]
    g, v, h = values[:, :, 0], values[:, :, 1], np.diff(run.t)
    for m, i in np.argwhere((v[:-1] < 0) & (v[1:] > 0) & (np.minimum(g[:-1], g[1:]) > 0)):
        part, least = Cubic(h[m], g[m, i], g[m + 1, i], v[m, i], v[m + 1, i]).minimum()
        if least < GRAZING**2 * widest[i]:
            slow.append((float(run.t[m] + part * h[m]), int(i)))
    if slow:
        t, contact = min(slow)
        warn(f"derivatives: contact {contact_name(run, contact)} is grazed near t = {t:.6g} s: it is made or missed with "
             "slightly other numbers, and the derivative holds for smaller changes only")


def tell_another_sequence(run: Solution, coarser: dict[int, Landing], found: dict[int, Landing]) -> None:
    """Warn where a run at a larger tolerance has other contacts, or in another order (coarser), than a run (found)."""
    one, other = ([(landing.contact, landing.closes) for landing in some.values()] for some in (coarser, found))
    if one != other:
        k = next((k for k, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), min(len(one), len(other)))
        at = [*found][min(k, len(other) - 1)] if other else 0
        warn(f"derivatives: the sequence of contacts is another one with a smaller tolerance from t = {run.t[at]:.6g} s on: "
             "their errors are not known; ask for a smaller accuracy")


# -- y' and multipliers


class Balance:
    """y' = f(t, y) by F(t, (y, lambda), (y', 0)) = 0, with the derivatives of this implicit function."""

    def __init__(self, of: Any) -> None:
        self.of, self.lists, self.n = of, of.lists, of.n
        self._rate = np.arange(of.assembly.n) < of.n
        self._multipliers = np.zeros(of.assembly.n - of.n)
        self._at: dict[int, Any] = {}
        self.prescribed: Array = np.zeros(0)
        self.of_clock: Array = np.zeros(0)

    def at(self, t: float, y: Array) -> tuple[Array, Array, Array, Array]:
        """Unknowns and rates of F at which it vanishes, dF/d(y', lambda) and dF/dy."""
        rates, zeros = np.zeros(self.n), np.zeros(len(self._multipliers))
        for _ in range(ITERATIONS):
            Y, Yp = np.concatenate([y, self._multipliers]), np.concatenate([rates, zeros])
            fy, fyp = (x[0] for x in self.of.assembly.dense_stages(np.array([t]), Y[None], Yp[None]))
            matrix = np.where(self._rate, fyp, fy)
            step = np.linalg.solve(matrix, self.lists.value(t, Y, Yp))
            rates, self._multipliers = rates - step[: self.n], self._multipliers - step[self.n :]
            size = max(np.abs(rates).max(initial=0.0), np.abs(self._multipliers).max(initial=0.0))
            if np.abs(step).max(initial=0.0) <= BALANCED * size:
                break
        return np.concatenate([y, self._multipliers]), np.concatenate([rates, zeros]), np.asarray(matrix), np.asarray(fy)

    def value(self, at: int, t: float, y: Array) -> Array:
        """y' at stage `at`."""
        self._at[at % ALL] = t, *self.at(t, y.copy())
        return np.asarray(self._at[at % ALL][2][: self.n])

    def along(self, at: int, dy: Array) -> Array:
        """Changes (n, P) of y' for those of y (n, P) and those of the numbers."""
        t, Y, Yp, matrix, fy = self._at[at % ALL]
        self.lists.twins.at(prescribed=np.ascontiguousarray(self.prescribed[at : at + 1]))
        by_numbers = self.lists.twins.states(np.array([t]), Y[None], Yp[None])[0]
        return np.asarray(-np.linalg.solve(matrix, by_numbers + fy[:, : self.n] @ dy)[: self.n])

    def back(self, at: int, weight: Array) -> Array:
        """Weights (n,) of y for weights (n,) of y'."""
        t, Y, Yp, matrix, _ = self._at[at % ALL]
        v = -np.linalg.solve(matrix.T, np.concatenate([weight, np.zeros(len(self._multipliers))]))
        self.lists.twins.at(of_clock=self.of_clock[at : at + 1])
        return np.asarray(self.lists.twins.states(np.array([t]), Y[None], Yp[None], v[None])[0, : self.n])


def refuse_jumps(of: Any) -> None:
    """Raise DerivativeError where y' jumps at an instant that depends on the motion, at which the derivative would jump too."""
    run = of.run
    system = run.systems[0][1] if run.systems else None
    switches: Any = None if system is None else system.switches
    if switches is None or not len(run.t) > 1:
        return
    kinks = np.array([kind == "kink" for kind in switches.kinds], dtype=bool)
    if not kinks.any():
        return
    values = switches.arguments(run.t, run.y)[:, kinks]
    names = [name for name, kink in zip(switches.names, kinks, strict=True) if kink]
    for i, a in np.argwhere(values[1:] * values[:-1] < 0):
        low, high = run.t[i], run.t[i + 1]
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            at = switches.arguments(np.array([middle]), run(np.array([middle])))[0, kinks][a]
            low, high = (middle, high) if at * values[i, a] > 0 else (low, middle)
        span = BESIDE * (run.t[-1] - run.t[0])
        sides = [max(low - span, run.t[0]), min(high + span, run.t[-1])]
        with of.within((run.t[i] + run.t[i + 1]) / 2):
            jump = of.jump(np.array(sides))
        if np.any(jump > JUMP):
            raise DerivativeError(f"there are no derivatives of this run: '{names[a]}' makes accelerations jump at t = "
                                  f"{high:.6g} s, at an instant that depends on the motion, and derivatives do not pass such "
                                  "jumps yet; state it by a function without jumps, such as tanh")
