"""Contacts between steps in C against the rules in Python."""

from __future__ import annotations

import ctypes
from math import inf
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.integrators.contact_steps import ContactSteps
from mbdae.integrators.solution import Stats
from mbdae.native import address, declared
from mbdae.native.collocation import SPEEDS, durations_at
from mbdae.native.equations import Number, Pointer
from mbdae.system.assembled.guards import ContactGuards
from mbdae.system.base import Array, System
from mbdae.system.prepare import prepare

functions = declared(
    ("contacts_bound", Number, (Pointer, Number)), ("contacts_calm", ctypes.c_int, (Pointer, Number, Number, Pointer))
)


def pendulum(play: float = 1e-3) -> System:
    """A rod that swings on a loose pin."""
    s = mb.Scene("loose pendulum", gravity=(0, -9.81, 0))
    s.rigid_body("rod", 1.0, 0.1, at=(0.5, 0))
    loose = mb.Clearance(0.01 + play, 0.01, mb.Hertz(1e8, 0.5))
    s.revolute("pin", s.ground, "rod", at=(0, 0), model=loose)
    return system_for(prepare(s))


def gaps(rng: Any) -> Array:
    """One gap at one time, of any size: gap, its rate, duration of an impact."""
    sign = rng.choice([-1.0, 1.0], 2)
    gap, rate, duration = 10 ** rng.uniform((-7, -4, -5), (-3, 1, -2))
    return np.array([[sign[0] * gap, sign[1] * rate, duration]])


def watched() -> tuple[ContactSteps, Any]:
    steps = ContactSteps(pendulum(), Stats())
    native = steps.given()
    assert native is not None
    return steps, native


def test_steps_are_bounded_as_in_python() -> None:
    steps, native = watched()
    rng, seen = np.random.default_rng(0), set()
    for _ in range(500):
        steps._here, steps._before, steps._t = gaps(rng), gaps(rng), float(rng.uniform(0, 1))
        steps._lasting = steps._t + rng.choice([-1.0, 1.0], 1)
        native = steps.given()
        assert native is not None
        expected = steps.bound()
        assert functions().contacts_bound(ctypes.addressof(native.table), steps._t) == pytest.approx(expected, rel=1e-12)
        seen.add(expected < inf)
    assert seen == {True, False}


def test_what_needs_a_closer_look_is_what_python_looks_at() -> None:
    """From any last step to the state of the system: whatever Python would repeat or count, C gives to it."""
    steps, native = watched()
    system, rng, found = steps.system, np.random.default_rng(1), []
    y = system.y0
    end = steps._contacts(system.t0, y)
    for _ in range(1000):
        h = 10 ** float(rng.uniform(-6, 0))
        steps._here, steps._t = gaps(rng), system.t0 - h
        steps._t_end, steps._end, steps._retries = system.t0, end, 0
        native = steps.given()
        assert native is not None
        looked = steps.hidden() is not None or bool((steps._here[0, 0] < 0) != (end[0, 0] < 0))
        calm = functions().contacts_calm(ctypes.addressof(native.table), system.t0, h, address(y))
        assert not (looked and calm)
        found.append((looked, calm))
    assert {(True, 0), (False, 1)} <= set(found)
    assert sum(not looked and not calm for looked, calm in found) < 200  # few needless looks


def test_durations_are_those_of_the_law() -> None:
    steps, native = watched()
    guards = steps.system.guards
    assert guards is not None
    law, mass = guards.places[0].law, guards.places[0].mass  # type: ignore[attr-defined]
    assert np.exp(native._logarithms[0]) == pytest.approx(law.contact_duration(mass, SPEEDS), rel=1e-12)


def test_runs_are_those_with_a_look_at_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    together = mb.RadauIIA(3, rtol=1e-8).solve(pendulum(), 0.5)
    monkeypatch.setattr(ContactSteps, "native", None)
    each = mb.RadauIIA(3, rtol=1e-8).solve(pendulum(), 0.5)
    assert together.stats.contacts == each.stats.contacts > 3
    assert together.stats.missed_dips == each.stats.missed_dips == 0
    assert together.stats.shortest_contact == pytest.approx(each.stats.shortest_contact, abs=3)
    assert together.stats.residuals == pytest.approx(each.stats.residuals, rel=0.1)
    assert together.y[-1] == pytest.approx(each.y[-1], rel=1e-4, abs=1e-4)


def test_tables_of_other_sizes_are_refused() -> None:
    steps, native = watched()
    guards = steps.system.guards
    assert guards is not None
    with pytest.raises(ValueError, match="contacts"):
        guards.native({})  # type: ignore[attr-defined]
    durations = np.ones((1, len(SPEEDS)))
    for wrong, known, at in ((np.ones((2, 3)), np.ones(2), np.zeros(0)), (durations, np.ones(2), np.zeros(0)),
                             (durations, np.ones(1), np.zeros(1000))):
        with pytest.raises(ValueError, match="positions"):
            native.hold(wrong, known, at, 0.1)


def discs(place: float = 0.0) -> mb.Scene:
    """Two discs over a floor; place: how far the centre of each circle that touches is from its body's centre, m."""
    s = mb.Scene("discs", gravity=(0, -9.81, 0))
    law = mb.Hertz(1e6, 0.1)
    for n, name in enumerate("ab"):
        s.rigid_body(name, 1.0 + n, 0.02, at=(0, 0.3 + 0.5 * n))
        circle = mb.Sphere(at=(place, 0.3 + 0.5 * n, 0), radius=0.2)
        s.contact(f"floor {name}", s.ground, name, mb.Plane(normal=(0, 1, 0)), circle, normal=law)
    s.contact("between", "a", "b", mb.Sphere(radius=0.2), mb.Sphere(radius=0.2), normal=law)
    return s


def test_masses_that_do_not_depend_on_the_position_are_found_once() -> None:
    """Centred spheres always carry the masses of their bodies; what is off the centre, or tied, does not."""
    for place, equal in ((0.0, {"floor a", "floor b", "between"}), (0.1, {"between"})):
        guards = system_for(prepare(discs(place))).guards
        assert isinstance(guards, ContactGuards)
        assert {p.name for p, varies in zip(guards.places, guards._varying, strict=True) if not varies} == equal
    s = discs()
    s.revolute("hinge", s.ground, "b", at=(1, 0.8))
    guards = system_for(prepare(s)).guards
    assert isinstance(guards, ContactGuards)
    assert {p.name for p, varies in zip(guards.places, guards._varying, strict=True) if not varies} == {"floor a"}


def test_no_effective_mass_is_computed_again_while_spheres_bounce(monkeypatch: pytest.MonkeyPatch) -> None:
    system, asked = system_for(prepare(discs())), []
    monkeypatch.setattr("mbdae.system.assembled.guards.effective_masses", lambda *args: asked.append(args))
    run = mb.RadauIIA(3, rtol=1e-6).solve(system, 0.6)
    assert run.stats.contacts > 2
    assert not asked


def test_durations_in_python_are_those_in_c() -> None:
    steps, native = watched()
    guards = steps.system.guards
    assert isinstance(guards, ContactGuards)
    law, mass = guards.places[0].law, guards.places[0].mass
    speeds = np.array([0.0, 1e-14, 3e-5, -0.7, 12.0])
    found = durations_at(np.repeat(native._logarithms, len(speeds), axis=0), speeds)
    assert found[1:] == pytest.approx(law.contact_duration(mass, np.abs(speeds[1:])), rel=1e-3)
    assert found[0] == 0.0
