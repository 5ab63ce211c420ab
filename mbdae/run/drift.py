"""Drift of a run: energy gained or lost without a cause, and violation of joints where constraints are imposed on accelerations
only (index 1).

BDF of order above 2 changes the energy of undamped motion: measured, a pendulum loses a tenth of its energy in 1e4 periods at
rtol = 1e-6, and a damped oscillator can be made to grow. Neither constraints nor local errors show that; the energy balance does.

Warnings about runs with contact or friction, and about constant steps.

Measured: every run that left the true motion, although its solver reported success, had an energy error above a tenth of the
energy it dissipated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mbdae.deferred import median
from mbdae.integrators.solution import rejecting
from mbdae.notation import counted
from mbdae.results.accuracy import Accuracy
from mbdae.results.clearance import ClearanceSensor
from mbdae.results.contacts import Contacts, contacts_of_each
from mbdae.results.result import Result
from mbdae.results.states import Energy, has_power
from mbdae.run.contacts import RESOLVED, reversing, slowest_velocities, stepped_over, typical_speed
from mbdae.run.estimate import Controlled
from mbdae.run.growth_roots import held_by_stability
from mbdae.system.motion.mechanics import InstanceNumber, row_sizes
from mbdae.system.prepare import Prepared
from mbdae.system.start_with_contacts import ExpectedContact
from mbdae.values import largest

#: a warning is given where the energy error, relative to the energy exchanged, is above this times the accuracy, above SHARE and
#: above round-off
ALLOWED = 10.0
SHARE = 1e-3  #: energy error, relative to the energy exchanged, up to which there is no warning at any accuracy
POINTS = 1000  #: largest number of steps of a run at which energies are compared
#: round-off, relative: of energies to the largest or a typical energy of the run (`round_off`), of penetrations to the size of
#: the contact
ROUNDED = 100 * float(np.finfo(float).eps)
SAMPLES = 200  #: largest number of steps of a run at which constraint rows are evaluated


def energy_drift(result: Result, run: Controlled, asked: float | None) -> list[str]:
    """A warning where the energy balance drifts; none if the run met its accuracy and energy is dissipated or supplied.

    Constant steps, contacts and friction have a check of their own (`reliability`). Elastic bodies lose the energy of vibrations
    that long steps damp away (`lost_vibrations`), so that with them only BDF is checked."""
    prepared, order = result.prepared, run.solver.bdf_order
    supplied = has_power(prepared.mechanics)
    met = asked is not None and run.estimate <= asked
    elsewhere = prepared.contacts or prepared.mechanics.reactive or (prepared.model.elastic and order <= 2)
    if run.solver.fixed or elsewhere or (met and supplied):
        return []
    t = result.solution.t
    if len(t) < 3:
        return []
    e = result(t[:: len(t) // POINTS + 1]).energy
    exchanged = max(float(x) for x in (np.max(e.kinetic), np.ptp(e.potential), np.ptp(e.dissipated), np.ptp(e.work)))
    off = float(e.balance[np.argmax(np.abs(e.balance))])
    tolerance = asked if asked is not None else run.solver.rtol or 0.0
    if not abs(off) > max(max(SHARE, ALLOWED * tolerance) * exchanged, _at_rest(prepared, tolerance), round_off(prepared, e)):
        return []
    remedy = "BDF of order above 2 changes the energy of undamped motion: use mb.RadauIIA(3), or" if order > 2 else "use"
    return [f"the energy balance drifts: {abs(off):.2g} J {'gained' if off > 0 else 'lost'} without a cause, while "
            f"{exchanged:.2g} J are exchanged; {remedy} a smaller rtol or step"]


def round_off(prepared: Prepared, e: Energy) -> float:
    """Energy (J) below which differences of the energies of a run are round-off: the fraction ROUNDED of the largest energy of
    the run, or of a typical one (weight of all bodies times the scene's length, plus their m v^2 at the typical speed v)."""
    scene = prepared.model.scene
    mass = sum(body.mass for body in scene.bodies)
    typical = mass * (float(np.linalg.norm(scene.gravity)) + prepared.length / prepared.time**2) * prepared.length
    parts = (e.kinetic, e.potential, e.dissipated, e.work)
    return ROUNDED * max(typical, *(float(np.max(np.abs(part), initial=0.0)) for part in parts))


def _at_rest(prepared: Prepared, tolerance: float) -> float:
    """Kinetic energy (J) of the lightest body at the speed that is as large as the tolerance of velocities, so that the body may
    as well be at rest."""
    masses = [b.mass for b in prepared.model.scene.bodies if b.mass > 0]
    return min(masses, default=0.0) * (tolerance * prepared.length / prepared.time) ** 2 / 2


def joint_drift(prepared: Prepared, run: Controlled, asked: float | None) -> list[str]:
    """A warning where the violation g of a constraint row, relative to its size, or its rate G u + g_t, relative to its size and
    the scene's speed, exceeds the accuracy asked; where none was asked, the accuracy expected of the tolerance."""
    m, solver = prepared.mechanics, run.solver
    if not m.m:
        return []
    if asked is None:
        asked = solver.at_best or 1e-6
    t = run.solution.t[:: len(run.solution.t) // SAMPLES + 1]
    q, u, _ = prepared.states(t, run.solution(t))
    speed = max(prepared.length / prepared.time, m.speed(u))
    sizes = row_sizes(m, prepared.start.t, prepared.start.q)
    off = [np.abs(m.position_residual(t, q)) / sizes, np.abs(m.velocity_residual(t, q, u)) / (sizes * speed / prepared.length)]
    for values, what, size in zip(off, ("position", "velocity"), ("length, or rad", "speed"), strict=True):
        worst = largest(np.max(values, axis=0))
        if np.max(values) > asked:
            return [f"joint row {m.rows[worst].name} is violated in {what}, by {np.max(values):.1e} of the scene's {size}: the "
                    "form satisfies constraints for accelerations only; raise its baumgarte, ask for a smaller accuracy, or use "
                    "mb.GGL()"]
    return []


#: a result is doubtful where the ratio of position tolerance to median penetration is above this or, if that is more, above
#: three times the solver's `penetration_share`
COARSE = 0.1
#: ratio of energy error to dissipated energy (with constant steps: to the energy exchanged) above which a result is not reliable
ALARM = 0.1
#: before the energy error is compared with ALARM times the dissipated energy, the latter is taken as at least this fraction of
#: the largest kinetic energy
MOVING = 1e-3
#: before the energy error is compared with ALARM times the dissipated energy, the latter is taken as at least this fraction of
#: the largest energy stored in a contact
STORED = 0.1
FEW_STEPS = 3  #: impacts count as not resolved where the shortest contact took fewer steps than this
#: a motion against the spin is reported as a backward whirl where all of these are reached: ratio of whirl rate to spin rate,
#: fraction of the time in contact, number of turns of the pin around the race
WHIRL_RATE, WHIRL_CONTACT, WHIRL_TURNS = 5.0, 0.9, 2.0
#: a step resolves an unstable oscillation, so that it grows in the run as in the equations, where step times angular frequency
#: is at most this; longer steps damp it away
RESOLVED_STEP = 1.0
GROWN = 5.0  #: smallest logarithm of the growth that steps have damped away, summed over the run, for which there is a warning


class Assessment(NamedTuple):
    """Warnings about a run, and whether the run is reliable."""

    notes: tuple[str, ...] = ()
    reliable: bool = True
    singular: bool = False  #: whether the run passes a singular position, where two branches of the motion meet
    #: largest violation of a constraint row (over the scene's length, or in rad), where it caused a warning; else 0
    off: float = 0.0

    def within(self, known: Accuracy) -> Accuracy:
        """The accuracy with the violation of constraint rows included in its estimate."""
        if not self.off:
            return known
        unknown = dict(known.unknown) | {"reactions": "the joints are not kept closed"}
        motion = None if known.motion is None else max(known.motion, self.off)
        return replace(known, estimated=motion, verified=None, unknown=unknown, found_reactions=None)


def reliability(result: Result, run: Controlled) -> Assessment:
    """Warnings about contact, friction and constant steps; not reliable where energy is gained or lost without a cause, or where
    the steps damp an unstable contact."""
    prepared = result.prepared
    if run.solver.fixed and (made := _of_constant_steps(result)):
        return Assessment(tuple(made), False)
    if not prepared.contacts and not any(True for _ in slowest_velocities(prepared)):
        return Assessment()
    touched = contacts_of_each(prepared, result.solution, prepared.contacts)
    energy = _of_energy(result, run, _stored(prepared, touched))
    notes, reliable = list(energy), not energy
    told = [one for contact in prepared.contacts for one in _of_contact(result, run, contact, touched[contact.place])]
    notes += [_worst([one for one in told if one.kind == kind]) for kind in dict.fromkeys(one.kind for one in told)]
    for contact in prepared.contacts:
        sensor = result[contact.item]
        if isinstance(sensor, ClearanceSensor):
            whirl = _whirl(result, sensor, contact.item)
            unstable = [] if whirl else _flutter(result, sensor, contact)
            notes += whirl + unstable
            reliable &= not unstable
    return Assessment((*notes, *_of_friction(result, run)), reliable)


def _of_energy(result: Result, run: Controlled, stored: float) -> list[str]:
    """A warning where the energy balance is off by more than a tenth of what contact and friction dissipate, or by more than a
    hundredth of what a contact stores, where that is larger; nor is there one where the error that was estimated explains it: a
    speed that is off by the fraction a changes a kinetic energy by 2 a of it. stored: the largest energy of a contact, J."""
    e = result.energy
    off = float(np.max(np.abs(e.balance), initial=0.0))
    lost, moving = float(e.impact[-1] + e.friction[-1]), float(np.max(e.kinetic, initial=0.0))
    explained = 2 * run.estimate * moving if compared(run, result.info.accuracy.asked) else 0.0
    allowed = ALARM * max(lost, MOVING * moving, STORED * stored)
    if off <= max(allowed, explained, round_off(result.prepared, e)):
        return []
    return [f"not reliable: the energy balance is off by {off:.2g} J, where contact and friction dissipate {lost:.2g} J: ask for "
            f"a smaller accuracy, or rtol"]


def _stored(prepared: Prepared, made: Mapping[InstanceNumber, Contacts]) -> float:
    """The largest energy (J) stored by a contact of a run. made: the contacts of every law."""
    found = [0.0]
    for contact in prepared.contacts:
        deepest = made[contact.place].deepest
        load = contact.law.elastic_load(deepest) if deepest > 0 else None
        found.append(load[1] if load is not None else 0.0)
    return max(found)


def _of_constant_steps(result: Result) -> list[str]:
    """A warning where, with constant steps, the energy balance is off by more than a tenth of the energy exchanged."""
    e = result.energy
    off = np.abs(e.balance)
    moved = max(float(np.max(e.kinetic)), float(np.ptp(e.potential)), float(np.max(np.abs(e.work))), float(np.max(e.dissipated)))
    if np.isfinite(off).all() and np.max(off) <= max(ALARM * moved, round_off(result.prepared, e)):
        return []
    return [f"not reliable: with steps of {result.stats.h_max:.2g} s the energy balance is off by {np.max(off):.2g} J, where "
            f"{moved:.2g} J were exchanged: take a smaller step, or error control (mb.RadauIIA(3), mb.IDA())"]


ALSO = 3  #: number of further contacts whose names a warning gives that is the same for all


class _Told(NamedTuple):
    """A warning of one contact: what it is of, how far it is exceeded, the contact's name, and the words after it."""

    kind: str
    excess: float
    item: str
    words: str


def _worst(told: list[_Told]) -> str:
    """The warning of the contact that exceeds most, with the names of the others of which the same is to be said."""
    first, *others = sorted(told, key=lambda one: -one.excess)
    names = ", ".join(f"'{one.item}'" for one in others[:ALSO]) + (", ..." if len(others) > ALSO else "")
    return f"'{first.item}' {first.words}" + (f" (the same of {counted(len(others), 'other')}: {names})" if others else "")


def _of_contact(result: Result, run: Controlled, expected: ExpectedContact, contacts: Contacts) -> list[_Told]:
    """Warnings where penetrations are small compared with the tolerance, or beyond the range of validity of the contact law."""
    law, item, unit = expected.law, expected.item, expected.unit
    if not len(contacts):
        return []
    found = []
    typical, deepest = float(median(contacts.peak)), contacts.deepest
    tolerance = (run.solver.rtol or 0.0) * expected.size
    coarse = tolerance > max(COARSE, 3 * run.solver.penetration_share) * typical and typical > ROUNDED * expected.size
    if coarse and not compared(run, result.info.accuracy.asked):
        wanted = run.solver.penetration_share * typical / expected.size
        found.append(_Told("resolved", tolerance / typical, item,
                           f"penetrates by {typical:.2g} {unit} (median of its contacts), {run.solver.label} with its rtol "
                           f"resolves only {tolerance:.2g} {unit}: "
                           f"{_finer(run, result.info.form, wanted, 'take a softer contact law')}"))
    limit, limit_in_words, likely_cause = law.doubtful_depth()
    if deepest > limit:
        found.append(_Told(limit_in_words, deepest / limit, item, f"penetrates by up to {deepest:.2g} {unit}, more than "
                           f"{limit:.2g} {unit} ({limit_in_words}): {likely_cause}"))
    return found


def _finer(run: Controlled, form: str, wanted: float, other_remedy: str) -> str:
    """Advice in words to take the rtol `wanted`, or, where round-off does not allow so small a one, the smallest allowed or
    `other_remedy`."""
    least = run.solver.tightest.get(form, run.solver.tightest[""])
    if least <= 3 * wanted:  # with a tolerance of up to three times the wanted one the warning does not come again
        return f"give that solver rtol = {max(wanted, least):.1g}"
    return f"rtol = {least:.1g}, the smallest it takes in this form, does not resolve that either; {other_remedy}"


def _whirl(result: Result, sensor: ClearanceSensor, item: str) -> list[str]:
    """A warning where dry friction drives the pin backwards around the race (backward whirl)."""
    t = result.solution.t
    late = t[t >= t[0] + 0.5 * (t[-1] - t[0])]
    if len(late) < 20:
        return []
    times = late[:: len(late) // 2000 + 1]
    seen = sensor.at_times(times)
    found = result.coordinate_at(item, result.prepared.model.scene[item].coordinates[0], times)
    if found is None:
        return []
    spin = float(median(found[1]))
    in_contact = float(np.mean(seen["gap"].min(axis=1) < 0))
    x, y = seen["orbit"].T
    angle = np.unwrap(np.arctan2(y, x))
    turning, turns = float(median(np.diff(angle) / np.diff(times))), abs(float(angle[-1] - angle[0])) / (2 * np.pi)
    if in_contact < WHIRL_CONTACT or turning * spin >= 0 or abs(turning) < WHIRL_RATE * abs(spin) or turns < WHIRL_TURNS:
        return []
    return [f"backward whirl in '{item}': the contact runs around the race at {turning:.4g} rad/s against a spin of {spin:.4g} "
            "rad/s, driven by dry friction, so the pin does not run as in an ideal joint: less friction or more contact damping "
            "ends it"]


def _flutter(result: Result, sensor: ClearanceSensor, expected: ExpectedContact) -> list[str]:
    """A warning where dry friction makes a contact unstable (flutter) and the steps are so long that an implicit method damps
    this; see `instability` of its law."""
    law, t = expected.law, result.solution.t
    if law.friction is None or len(t) < 3:
        return []
    seen = sensor.on_steps
    step, grown, fast = np.diff(t, append=t[-1]), 0.0, 0.0
    for gap, force, rub in zip(seen["gap"].T, seen["normal_force"].T, seen["friction_force"].T, strict=True):
        growth, rate = law.instability(expected.mass, -gap, force, np.abs(rub))
        damped = (growth > 0) & (step * rate > RESOLVED_STEP)
        grown += float(np.sum((growth * step)[damped]))
        fast = max(fast, float(np.max(rate[damped], initial=0.0)))
    if grown < GROWN:
        return []
    return [f"not reliable: friction makes the contact in '{expected.item}' unstable: it oscillates at about {fast:.2g} rad/s "
            f"and grows, which steps of {float(np.max(step)):.1g} s damp away; follow it with a smaller rtol or steps below "
            f"{RESOLVED_STEP / fast:.1g} s, or take less friction or more contact damping"]


def _of_friction(result: Result, run: Controlled) -> list[str]:
    speed, form = typical_speed(result.prepared), result.info.form
    resolved = (run.solver.rtol or 0.0) * speed
    return [f"friction of '{item}' changes within {velocity:.2g} m/s of sliding, {run.solver.label} with its rtol resolves only "
            f"{resolved:.2g} m/s: {_finer(run, form, RESOLVED * velocity / speed, 'raise that velocity of the friction law')}"
            for item, velocity in reversing(result.prepared, run.solution) if resolved > 10 * RESOLVED * velocity]


def compared(run: Controlled, asked: float | None) -> bool:
    """Whether runs with longer steps during impacts show that a run is as accurate as asked, at a tolerance that round-off does
    not bound, so that its contacts are resolved, also those that hardly touch and take two steps. Measured on such grazes: with a
    tolerance of up to 70 times the penetration the error was a tenth of the accuracy."""
    return (asked is not None and run.solver.rtol is not None and len(run.told) > 0 and run.estimate <= asked
            and run.told[-1][0] > run.limit * (1 + 1e-9))


def doubts_of_steps(run: Controlled, asked: float | None = None) -> list[str]:
    """Warnings about contacts and laws that the steps did not resolve. asked: the accuracy; None where none was asked."""
    stats, found = run.solution.stats, []
    if run.hidden:
        found.append(stepped_over(run.hidden))
    elif stats.missed_dips:
        found.append(f"{counted(stats.missed_dips, 'contact')} may have been stepped over (begun and ended within a step): "
                     "use error control, or a smaller step")
    for item, count in stats.unresolved.items():
        found.append(f"{counted(count, 'step')} did not resolve the law of '{item}', which jumps, bends or acts for a part of a "
                     f"step only: use error control or steps of at most {stats.resolving_step:.1g} s")
    if 0 < stats.shortest_contact < FEW_STEPS and not compared(run, asked):
        found.append(f"the shortest contact took {counted(stats.shortest_contact, 'step')}: impacts are not resolved; use a "
                     f"smaller rtol or step")
    return [*found, *(text for text in (rejecting(run.solution), held_by_stability(run.solver, run.solution)) if text)]
