"""Reports for a lecture: every joint holds and is short, and single edits of its print are told."""

from __future__ import annotations

import random
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.documents.blocks import Equation, every, numbered
from mbdae.laws import joints
from mbdae.reports import page

sys.path.insert(0, str(Path(__file__).parent))

from reading import holds_and_defines
from test_edits import KINDS, edited

TAUGHT = [law for law in (getattr(joints, name) for name in joints.__all__)
          if law.states_motion() and law.velocity_constraints is mb.Joint.velocity_constraints]


@pytest.mark.parametrize("law", TAUGHT, ids=lambda law: law.__name__)
def test_a_joint_as_it_is_taught(law):
    document = mb.report(law, level="lecture")
    holds_and_defines(document, law.__name__)
    text = document.to_markdown()
    assert "\n| symbol |" not in text
    assert "\nwith\n" not in text  # no name but those of the statement
    assert len(list(every(Equation, document.blocks))) <= 20
    assert text.count("Here ") >= 2


def test_what_a_revolute_holds_is_written_with_its_axes():
    text = mb.report(mb.Revolute, level="lecture").to_markdown()
    assert r"\mathbf{m}_l = -\lambda_{\text{tilt y}}\,\mathbf{y}_l + \lambda_{\text{tilt x}}\,\mathbf{x}_l" in text
    assert r"\mathbf{m}_l\cdot \mathbf{z}_k = 0" in text
    # 10 N at 0.5 m along x_l, turned by 0.6 rad: moment about z 0.5 cos(0.6) 8 N
    assert "| held about $\\varphi$ | 3.301 | N m |" in text
    assert "drive" not in text.split("## Forces")[1].split("It does no work")[0]


@pytest.mark.parametrize("seed", range(len(KINDS)))
def test_single_edits_of_the_print_are_told(seed, monkeypatch):
    rng, (pattern, place) = random.Random(seed), list(KINDS.values())[seed]
    kind = list(KINDS)[seed]
    found = []
    for law in (mb.Revolute, mb.Screw, mb.Cylindrical):
        with monkeypatch.context() as patch:
            patch.setattr(page, "numbered", lambda blocks, law=law: _kept(numbered(blocks), law, found))
            mb.report(law, level="lecture")
    open_ = [(law, e) for law, e in found if re.search(pattern, e.latex)]
    if not open_:
        pytest.skip("no such place in a lecture")
    law, e = rng.choice(open_)
    at = rng.choice(list(re.finditer(pattern, e.latex)))
    inside = re.sub(pattern, place, at[0]) + e.latex[at.end() :] if kind != "a dropped term" else ""
    line = e.latex[: at.start()] + inside
    monkeypatch.setattr(page, "numbered", lambda blocks: edited(numbered(blocks), e.number, line))
    assert "NOT EQUAL" in mb.report(law, level="lecture").to_markdown(), f"{kind} in {law.__name__}: {e.latex} -> {line}"


def _kept(blocks, law, found):
    found += [(law, e) for e in every(Equation, blocks)]
    return blocks


@pytest.mark.parametrize("name", ["rolling", "classical", "rollingball"])
def test_other_joints_are_taught_with_all_that_they_use(name):
    """Virtual displacements and multipliers are introduced before forces are written with them."""
    document = mb.report(name, level="lecture")
    holds_and_defines(document, name)
    text = document.to_markdown()
    assert r"$\lambda" in text[: text.index("## Generalised forces")]


def test_other_laws_keep_their_derivation_without_tables():
    for name in ("pointspring", "gear", "lugre", "rigidbody", "jointstop", "clearancerevolute"):
        text = mb.report(name, level="lecture").to_markdown()
        assert "All " in text
        assert "sha256" not in text
        assert "\n| symbol |" not in text
        assert "None" not in text
        assert "Other statements" not in text
        numbers = [e.number for e in every(Equation, mb.report(name, level="lecture").blocks)]
        assert numbers == [*range(1, len(numbers) + 1)]  # what is left out leaves no gaps
        assert name != "gear" or r"\mathbf{x}_k" not in text  # it has no frames, and no words on them
    with pytest.raises(mb.OptionError, match="level = 'short' is not one of 'full', 'lecture'"):
        mb.report("gear", level="short")


class BentPin(mb.Joint):
    """l turns about k.z and slides along a pin inclined to it: a force along the pin turns l, too."""

    coordinates = mb.params(angle=("rad", "rotation"), displacement=("m", "displacement along the pin"))
    params = mb.params(bend=("rad", "angle between hinge and pin"))

    def motion(self, from_k):
        return from_k.about("z", self.angle).about("x", self.bend).along("z", self.displacement).about("x", -self.bend)


@pytest.mark.parametrize(("law", "wanted"), [("screw", {"varphi": 4 * np.cos(0.6) + 6 / (2 * np.pi)}),
                                             (BentPin, {"varphi": 4 * np.cos(0.6) + 0.9 * 8 * np.sin(1) * np.sin(0.6),
                                                        "s": 6 * np.cos(1) - 8 * np.sin(1) * np.cos(0.6)})])
def test_example_where_freedoms_are_not_orthogonal(law, wanted):
    """By hand: minus the power of the load at rate 1 of each coordinate; the rows carry the whole load."""
    text = mb.report(law, level="lecture").to_markdown()
    assert r"| $\boldsymbol{\lambda}_{\text{xyz}}$ | (0, -8, -6) | N |" in text
    found = {name: float(v) for name, v in re.findall(r"held (?:along|about) \$\\?(\w+)\$ \| ([-\d.]+)", text)}
    assert found == pytest.approx(wanted, rel=2e-3)
