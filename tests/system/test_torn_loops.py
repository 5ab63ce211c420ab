"""Loops drawn inexactly: rows left out as nearly redundant may be off by their misalignment, not by more."""

import warnings

import numpy as np
import pytest

import mbdae as mb
from mbdae.system.prepare import prepare

DRAWN_OFF = 1e-6  #: m, by which the third crank of the parallelogram is drawn beside its pin
ENDS = 0.5  #: s, after the position in which all cranks lie on a line (0.36 s), where the row left out is needed
BEFORE = 0.25  #: s, before that position


def three_cranks(off=DRAWN_OFF, size=1.0, order=(0, 1, 2), rate=2.0):
    """A parallelogram with three cranks, one more than it needs; size: m for every metre of the drawing."""
    s = mb.Scene("three cranks", gravity=(0, -9.81 * size, 0))
    arm = 0.3 * np.array([np.cos(np.deg2rad(50)), np.sin(np.deg2rad(50))])
    feet = size * np.array([(0.0, 0.0), (0.4, 0.0), (0.9, 0.0)])
    tips = feet + size * arm
    tips[2] += size * off * np.array([1.0, -0.3])
    for i in range(3):
        s.link(f"c{i}", tuple(feet[i]), tuple(tips[i]), mass=1.0)
    s.link("top", tuple(tips[0]), tuple(tips[2]), mass=2.0)
    for i in order:
        s.revolute(f"A{i}", s.ground, f"c{i}", at=tuple(feet[i]), **({"rate0": rate} if i == 0 else {}))
    for i in order:
        s.revolute(f"B{i}", f"c{i}", "top", at=tuple(tips[i]))
    return s


def run(scene, t_end, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return scene.simulate(t_end, **options)


def violated(r):
    return [text for text in r.warnings if "is violated by" in text]


@pytest.mark.parametrize("off", [1e-9, 1e-7, 1e-6])
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_a_loop_that_comes_apart_is_told(off, order):
    r = run(three_cranks(off, order=order), ENDS, accuracy=1e-6)
    (left_out,) = r.prepared.rank.dropped
    assert r.drift.position.max() > 0.1
    assert [text for text in violated(r) if left_out.name in text]
    assert r.reliable is False
    assert "motion" not in r.accuracy.covers


@pytest.mark.parametrize("size", [1e-4, 1e-2, 1e2])
def test_it_is_told_at_every_size(size):
    """Violations are parts of the scene's length, of small scenes too."""
    r = run(three_cranks(size=size), ENDS, accuracy=1e-3)
    assert r.drift.position.max() > 0.1 * size
    assert violated(r)
    assert r.reliable is False


OWN = {"IDA": {"solver": mb.IDA(rtol=1e-7)}, "Radau": {"solver": mb.RadauIIA(3, rtol=1e-8)},
       "accelerations only": {"form": mb.Index1(), "solver": mb.CVODE(rtol=1e-8)}}


@pytest.mark.parametrize("options", OWN.values(), ids=list(OWN))
@pytest.mark.parametrize("recursive", [False, True])
def test_every_solver_and_form_tells_it(options, recursive):
    """With tolerances of their own too, where the error of the run is not known."""
    scene = three_cranks()
    r = run(scene.recursive() if recursive else scene, ENDS, **options)
    assert r.drift.position.max() > 0.1
    assert r.reliable is False
    assert "motion" not in r.accuracy.covers


def test_a_misalignment_alone_is_no_violation():
    """Before the singular position the row left out is off by its misalignment."""
    r = run(three_cranks(), BEFORE, accuracy=1e-8)
    assert r.drift.position.max() > 1e-8
    assert r.reliable
    assert not violated(r)
    assert any("is nearly redundant" in text for text in r.warnings)


def test_a_loop_that_its_misalignment_locks_is_told_with_the_cause():
    """Drawn off by more, the row is kept: the cranks cannot turn, and the reason is no rate."""
    with pytest.raises(mb.StartError, match=r"(?s)contradict the joints.*B2\.y is nearly redundant .* misaligned .*calculated"):
        three_cranks(1e-5).check()
    r = run(three_cranks(1e-5, rate=0.0), 0.1)
    assert r.prepared.rank.degrees_of_freedom == 0
    assert any("B2.y is nearly redundant" in text and "takes a freedom" in text for text in r.warnings)


@pytest.mark.parametrize("n", [20, 150])
def test_a_chain_stretched_between_two_pins_starts_in_a_singular_position(n):
    """As many rows are kept as the rank near the start counts, however long the chain."""
    s = mb.Scene("held", gravity=(0, -9.81, 0))
    x, before = np.linspace(0, 1, n + 1).tolist(), s.ground
    for i in range(n):
        link = s.link(f"l{i}", (x[i], 0), (x[i + 1], 0), mass=1 / n)
        s.revolute(f"J{i}", before, link, at=(x[i], 0), model=mb.Kinematic())
        before = link
    s.revolute("E", s.ground, before, at=(1, 0), model=mb.Kinematic())
    rank = prepare(s).rank
    assert len(rank.singular_here) == 1
    assert not rank.dropped
    assert rank.degrees_of_freedom == 3 * n - len(rank.kept)
