"""Runs that come to a singular position: the loop is named that loses rank, and the prescribed value that it cannot follow."""

from __future__ import annotations

import math

import pytest

import mbdae as mb
from mbdae.run.singular_positions import singular_stop


def linkage(s, name, crank, rocker, base, at, **driven):
    """Crank AB, coupler BC and rocker CD with upright crank and rocker at the start; base: distance of A and D (m)."""
    A, D = (0, at), (base, at)
    B, C = (0, at + crank), (base, at + rocker)
    links = [s.link(name + n, p, q, mass=1.0) for n, p, q in (("crank", A, B), ("coupler", B, C), ("rocker", C, D))]
    s.revolute(name + "A", s.ground, links[0], at=A, **driven)
    s.revolute(name + "B", *links[:2], at=B)
    s.revolute(name + "C", *links[1:], at=C)
    s.revolute(name + "D", s.ground, links[2], at=D)


def two(order, **driven):
    """A linkage that is nowhere singular beside a parallelogram that is flat at pi/2, stated in either order."""
    s = mb.Scene("two linkages")
    stated = [("regular ", 1.0, 1.3, 2.0, 0.0, {}), ("flat ", 1.0, 1.0, 2.0, 5.0, driven or {"rate0": 1.5})]
    for name, crank, rocker, base, at, own in stated[::order]:
        linkage(s, name, crank, rocker, base, at, **own)
    return s


@pytest.mark.parametrize("order", [1, -1])
def test_the_loop_that_loses_rank_is_named(order):
    with pytest.warns(mb.AccuracyWarning, match=r"passes a singular position of the loop closed by 'flat D' at t = 1\.04"):
        two(order).simulate(1.2, 1e-4, solver=mb.RadauIIA(3))


def test_no_value_is_blamed_for_two_branches():
    r = two(1, angle=1.5 * mb.t).simulate(math.pi / 3, solver=mb.RadauIIA(3, rtol=1e-6))
    said = singular_stop(r)
    assert "the loop closed by 'flat D'" in said
    assert "two branches" in said
    assert "prescribed" not in said


def test_a_regular_end_says_nothing():
    assert singular_stop(two(1).simulate(0.5, 1e-4, solver=mb.RadauIIA(3))) == ""


def toggle():
    """A crank that is turned away from the rocker: the coupler is stretched with the rocker before the crank lies flat."""
    s = mb.Scene("toggle")
    linkage(s, "", 1.5, 1.2, 2.0, 0.0, angle=mb.t)
    return s


#: the angle (rad) at which coupler and rocker are one straight line of their lengths, from the law of cosines
COUPLER = math.hypot(2.0, 0.3)
REACH = math.acos((1.5**2 + 2.0**2 - (COUPLER + 1.2) ** 2) / (2 * 1.5 * 2.0)) - math.pi / 2


@pytest.mark.parametrize("given", [{}, {"solver": mb.RadauIIA(3)}, {"solver": mb.IDA()}, {"solver": mb.HHT()},
                                   {"solver": mb.RadauIIA(3, step=0.01)}], ids=str)  # fmt: skip
@pytest.mark.parametrize("recursive", [False, True])
def test_a_value_beyond_the_reach_of_a_loop_is_named(given, recursive):
    scene = toggle().recursive() if recursive else toggle()
    with pytest.raises(mb.SolverError, match="cannot follow what is prescribed for 'A'") as stopped:
        scene.simulate(3.0, **given)
    assert "the loop closed by 'D'" in str(stopped.value)
    assert stopped.value.solution.t[-1] <= stopped.value.time == pytest.approx(REACH, abs=0.015)


@pytest.mark.parametrize("count", [3, 60])
def test_a_value_beyond_reach_in_a_large_scene(count):
    """Whatever the scene's length is, in which displacements are measured against angles; with 60 linkages rows are sparse."""
    s = mb.Scene("many", gravity=(0, -9.81, 0))
    for i in range(count):
        linkage(s, f"L{i} ", 1.0, 1.3, 2.0, 5.0 * i)
    linkage(s, "T ", 1.5, 1.2, 2.0, -5.0, angle=mb.t)
    with pytest.raises(mb.SolverError, match=r"the loop closed by 'T D' .* cannot follow what is prescribed for 'T A'"):
        s.simulate(2.0, 1e-4, solver=mb.RadauIIA(3))
