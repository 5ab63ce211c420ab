"""Joint forces of scenes in closed form: what is printed, evaluated with the motion of a run, is what its sensors show."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.documents.blocks import numbered
from mbdae.reports.page import Printed
from mbdae.reports.reading import key_of
from mbdae.reports.scenes.forces import ClosedForms

EXAMPLES = Path(__file__).parents[2] / "examples"


def four_bar():
    return runpy.run_path(str(EXAMPLES / "four_bar.py"))["scene"]()


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


@pytest.mark.parametrize("scene", [four_bar, slider_crank, tree, spatial])
def test_printed_forces_are_those_of_a_run(scene):
    """At 100 positions, all joints; the accuracy of a run is that of its motion, which both share."""
    s = scene()
    r = s.simulate(1.0, accuracy=1e-7, outputs=np.linspace(0, 1, 101)[1:])
    page = ClosedForms(r.prepared)
    q, u, internal = r._states
    known, multipliers = page.values(r.t, q, u, internal)
    assert len(multipliers) == 100
    blocks = numbered(page.blocks())
    assert all(check.holds for check in page.read(blocks, known, multipliers))
    printed = Printed(known, {}, 100)
    printed.read(blocks)
    for c in s.joints:
        shown = r[c.name].force
        for i in range(3):
            key = key_of(f"F_{{\\text{{{c.name}}},{'xyz'[i]}}}")
            found = printed.symbols.value(key) if key in printed.symbols else np.zeros(100)
            np.testing.assert_allclose(found, shown[:, i], rtol=1e-9, atol=1e-9 * np.abs(shown).max())


def test_the_sheet_names_the_laws_that_are_integrated():
    text, law = mb.report(four_bar()).to_markdown(), mb.report(mb.Revolute, drive=None).to_markdown()
    assert "comparisons hold" in text
    assert r"\Delta^{(1)}" in text
    assert "`mb.report(mb.Revolute, drive=None)`" in text
    shared = set(re.findall(r"`[0-9a-f]{32}…`", text)) & set(re.findall(r"`[0-9a-f]{32}…`", law))
    assert shared  # of the joints between two bodies that move, in the plane


def test_a_scene_without_closed_form_says_why():
    s = mb.Scene("free")
    s.rigid_body("body", 1.0, (1, 1, 1))
    assert "There is none: the scene has no joints" in mb.report(s).to_markdown()
