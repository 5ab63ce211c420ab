"""Joint forces of scenes in closed form: what is printed, evaluated with the motion of a run, is what its sensors show."""

from __future__ import annotations

import re
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.documents.blocks import Equation, Section, numbered
from mbdae.reports.page import Printed
from mbdae.reports.reading import key_of
from mbdae.reports.scene_forces import ClosedForms
from mbdae.system.prepare import prepare

EXAMPLES = Path(__file__).parents[2] / "examples"


def four_bar():
    return runpy.run_path(str(EXAMPLES / "four_bar.py"))["scene"]()


def rotor():
    return runpy.run_path(str(EXAMPLES / "ground_resonance.py"))["scene"]()


def undriven():
    """A four-bar that turns freely: every two of its moments have positions in which they do not give the forces."""
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    at = [(0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)]
    links = [s.link(name, a, b, mass=0.5) for name, a, b in zip(("crank", "coupler", "rocker"), at, at[1:], strict=False)]
    for i, name in enumerate("ABCD"):
        ends = [s.ground, *links, s.ground][i : i + 2]
        s.revolute(name, *ends, at=at[i], **({"rate0": 12.0} if name == "A" else {}))
    return s


def gearbox():
    s = mb.Scene("gearbox", gravity=(0, -9.81, 0))
    at = {"A": (0, 0), "B": (0.3, 0), "C": (0.6, 0.1)}
    for i, (name, point) in enumerate(at.items()):
        wheel = s.rigid_body(f"wheel {name}", 1.0 + i, 0.01 * (1 + i), at=(point[0], point[1] + 0.01))
        s.revolute(name, s.ground, wheel, at=point, damper=0.02 * i, **({"torque": 1.0, "rate0": 3.0} if name == "A" else {}))
    s.gear("AB", "A", "B", ratio=-2.0)
    s.gear("BC", "B", "C", ratio=-1.5)
    return s


def slider_crank():
    s = mb.Scene("slider-crank", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (0.1, 0.1), mass=0.4)
    rod = s.link("rod", (0.1, 0.1), (0.5, 0), mass=0.7)
    piston = s.rigid_body("piston", 0.3, (0.01, 0.01, 0.01), at=(0.5, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), torque=0.5)
    s.revolute("B", crank, rod, at=(0.1, 0.1), damper=0.01)
    s.revolute("C", rod, piston, at=(0.5, 0))
    s.prismatic("D", s.ground, piston, at=(0.5, 0), axis=(1, 0, 0))
    return s


def tree():
    s = mb.Scene("tree", gravity=(0, -9.81, 0))
    rods = [s.link(f"rod {i}", (i, 0), (i + 1, 0), mass=1.0 + i) for i in range(3)]
    for i, rod in enumerate(rods):
        s.revolute(f"J{i}", s.ground if i == 0 else rods[i - 1], rod, at=(i, 0))
    return s


def spatial():
    s = mb.Scene("arm", gravity=(0, 0, -9.81), space="spatial")
    base = s.rigid_body("base", 2.0, (0.1, 0.2, 0.3), at=(0, 0, 0.2))
    arm = s.rigid_body("arm", 1.0, (0.02, 0.05, 0.04), at=(0.3, 0, 0.4))
    s.revolute("turn", s.ground, base, at=(0, 0, 0), axis=(0, 0, 1))
    s.revolute("lift", base, arm, at=(0, 0, 0.4), axis=(0, 1, 0))
    return s


def flexible():
    """A slider-crank whose rod is a beam: joints hold its end nodes."""
    s = mb.Scene("flexible slider-crank", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (0.1, 0.1), mass=0.4)
    rod = s.beam("rod", (0.1, 0.1), (0.5, 0), section=mb.Section.tube(0.01, 0.0, E=2e9, nu=0.3, rho=7800.0), elements=2)
    piston = s.rigid_body("piston", 0.3, (0.01, 0.01, 0.01), at=(0.5, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=6 * mb.t)
    s.revolute("B", crank, rod, at=(0.1, 0.1))
    s.revolute("C", rod, piston, at=(0.5, 0))
    s.prismatic("D", s.ground, piston, at=(0.5, 0), axis=(1, 0, 0))
    return s


def blade():
    """A beam in space on a driven hub, with a mass at its tip."""
    s = mb.Scene("blade", gravity=(0, 0, -9.81))
    hub = s.rigid_body("hub", 1.0, (0.01, 0.01, 0.02), at=(0, 0, 0))
    beam = s.beam("beam", (0.1, 0, 0), (0.6, 0, 0.05), section=mb.Section.tube(0.008, 0.0, E=3e9, nu=0.3, rho=1500.0), elements=2)
    tip = s.rigid_body("tip", 0.2, (1e-3, 1e-3, 1e-3), at=(0.65, 0, 0.05))
    s.revolute("drive", s.ground, hub, at=(0, 0, 0), axis=(0, 0, 1), angle=5 * mb.t)
    s.revolute("flap", hub, beam, at=(0.1, 0, 0), axis=(0, 1, 0))
    s.spherical("ball", beam, tip, at=(0.6, 0, 0.05))
    return s


def rod_between_balls():
    """A four-bar in space whose rod may turn about its line: its three moments do not give the forces of its end."""
    s = mb.Scene("RSSR", gravity=(0, 0, -9.81))
    crank = s.rigid_body("crank", 1.0, (0.02, 0.03, 0.04), at=(0.1, 0.05, 0.2))
    rod = s.rigid_body("rod", 0.8, (0.1, 0.1, 0.01), at=(0.9, 0.65, 0.5))
    rocker = s.rigid_body("rocker", 1.2, (0.05, 0.06, 0.07), at=(1.5, 0.7, 0.2))
    s.revolute("A", s.ground, crank, at=(0, 0, 0), axis=(0.2, 1, 0.1), angle=mb.t)
    s.spherical("B", crank, rod, at=(0.3, 0.1, 0.4))
    s.spherical("C", rod, rocker, at=(1.5, 1.2, 0.6))
    s.revolute("D", s.ground, rocker, at=(1.5, 0.2, -0.5), axis=(1, 0.2, 0.3))
    return s


@pytest.mark.parametrize("scene", [rotor, four_bar, undriven, slider_crank, tree, spatial, gearbox, flexible, blade,
                                   rod_between_balls])
def test_printed_forces_are_those_of_a_run(scene):
    """At 100 positions, all joints; the accuracy of a run is that of its motion, which both share. No position is left out."""
    s = scene()
    r = s.simulate(1.0, accuracy=1e-7 if scene not in (flexible, blade) else 1e-4, outputs=np.linspace(0, 1, 101)[1:])
    page = ClosedForms(r.prepared)
    q, u, internal = r._states
    known, multipliers = page.values(r.t, q, u, internal, r.stresses(r.t))
    assert len(multipliers) == 100
    blocks = numbered(page.blocks())
    assert all(check.holds for check in page.read(blocks, known, multipliers))
    printed = Printed(known, {}, 100)
    printed.read(blocks)
    for c in s.joints:
        shown = r[c.name].force
        assert printed.stated.all()
        for i in range(3):
            key = key_of(f"F_{{\\text{{{c.name}}},{'xyz'[i]}}}")
            found = printed.symbols.value(key) if key in printed.symbols else np.zeros(100)
            np.testing.assert_allclose(found, shown[:, i], rtol=1e-9, atol=1e-9 * np.abs(shown).max())


def test_the_sheet_names_the_laws_that_are_integrated():
    text, law = mb.report(four_bar()).to_markdown(), mb.report(mb.Revolute, drive=None).to_markdown()
    assert "comparisons hold" in text
    assert r"\Delta^{(1)}" in text
    assert "`mb.report(mb.Revolute, drive=None)`" in text
    shared = [short for short in re.findall(r"`([0-9a-f]{32})…`", text) if f"`{short}" in law]
    assert shared  # of the joints between two bodies that move, in the plane


def test_a_scene_without_closed_form_says_why():
    s = mb.Scene("free")
    s.rigid_body("body", 1.0, (1, 1, 1))
    assert "There is none: the scene has no joints" in mb.report(s).to_markdown()


def unconditioned(block):
    """Blocks whose equations do not say what differs from 0."""
    if isinstance(block, Section):
        return replace(block, blocks=[unconditioned(b) for b in block.blocks])
    return replace(block, latex=block.latex.replace(r" \ne 0", "")) if isinstance(block, Equation) else block


@pytest.mark.parametrize("scene", [rotor, four_bar, gearbox])
def test_a_divisor_without_its_condition_is_seen_where_it_vanishes(scene):
    """By the print alone, and by states next to its zero, where the formulas are off. (In the rotor and the gearbox they are
    not: the multipliers of a run grow there as the formulas do.)"""
    page = ClosedForms(prepare(scene()))
    blocks = numbered(page.blocks())
    assert all(check.holds for check in page.printed(blocks))
    failed = [check.what for check in page.printed([unconditioned(b) for b in blocks]) if not check.holds]
    assert any("does not say that its divisor" in what for what in failed)
    assert scene is not four_bar or any("next to zeros" in what for what in failed)


def test_the_rotor_divides_by_directions_of_its_slides_alone():
    """Force balances give all forces but those across the slides: no arm of a blade is a divisor."""
    page = ClosedForms(prepare(rotor()))
    conditions = [e.latex for e in page.solution() if isinstance(e, Equation) and r"\ne 0" in e.latex]
    assert conditions
    assert not any("blade" in latex for latex in conditions)


def test_a_law_that_divides_states_its_condition():
    """The force of a rod of fixed length has the direction of the line between its points."""
    s = mb.Scene("rod", gravity=(0, -9.81, 0))
    bob = s.point_mass("bob", 1.0, at=(0.6, -0.8))
    s.distance("D", s.ground, bob, at_k=(0, 0), at_l=(0.6, -0.8))
    page = ClosedForms(prepare(s))
    blocks = numbered(page.blocks())
    assert all(check.holds for check in page.printed(blocks)), [c for c in page.printed(blocks) if not c.holds]
