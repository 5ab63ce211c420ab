"""Runs that come to a singular position: the loop is named that loses rank, and the prescribed value that it cannot follow."""

from __future__ import annotations

import math
import warnings

import pytest
import sympy as sp

import mbdae as mb
from mbdae.run.assessment import singular_stop


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
                                   {"solver": mb.RadauIIA(3, step=0.01)}], ids=str)
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


def driven_slider(cranks, stop, **couple):
    """A piston driven beyond the reach of one or more cranks, each at its height (m); stop: time (s) when they are stretched."""
    s = mb.Scene("cranks", gravity=(0, -9.81, 0))
    a = math.radians(60)
    B = (0.3 * math.cos(a), 0.3 * math.sin(a))
    x = B[0] + math.sqrt(0.25 - B[1] ** 2)
    speed = (0.8 - x) / stop
    piston = s.rigid_body("piston", 1.0, 1e-3, at=(x, 0))
    s.prismatic("D", s.ground, piston, at=(x, 0), axis=(1, 0, 0), position=None if couple else speed * mb.t)
    for n, y in cranks.items():
        crank = s.link("crank" + n, (0, y), (B[0], B[1] + y), mass=1.0)
        rod = s.link("rod" + n, (B[0], B[1] + y), (x, y), mass=1.0)
        s.revolute("A" + n, s.ground, crank, at=(0, y))
        s.revolute("B" + n, crank, rod, at=(B[0], B[1] + y))
        s.revolute("C" + n, rod, piston, at=(x, y))
    if couple:
        s.couple("cam", {"D.displacement": 1.0}, value=speed * mb.t)
    return s


@pytest.mark.parametrize("given", [{}, {"solver": mb.RadauIIA(3, step=0.01)}], ids=str)
def test_loops_that_come_to_their_limit_together(given):
    with pytest.raises(mb.SolverError, match=r"loops closed by '\S+' and '\S+' come .* what is prescribed for 'D'"):
        driven_slider({"1": 0.0, "2": -1.0}, 1.0).simulate(2.0, **given)


def test_motion_prescribed_by_a_coupling():
    with pytest.raises(mb.SolverError, match="cannot follow what is prescribed for 'cam'"):
        driven_slider({"": 0.0}, 1.0, couple=True).simulate(2.0)


class Jack(mb.Joint):
    """A rod whose length is a parameter."""

    params = mb.params(length=("m", "length"))

    def constraints(self, k, l):
        d = l.r - k.r
        return {"rod": (d @ d - self.length**2) / 2}


def test_motion_prescribed_by_a_parameter_of_an_own_joint():
    """An arm of 1 m from (0, 0) and a rod from (0, -1) that grows beyond 2 m."""
    s = mb.Scene("jack", gravity=(0, -9.81, 0))
    arm = s.link("arm", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, arm, at=(0, 0))
    s.add(Jack("jack", s.ground, arm, at=(0, -1), at_l=(1, 0), length=math.sqrt(2) + 0.3 * mb.t))
    with pytest.raises(mb.SolverError, match="cannot follow what is prescribed for 'jack'") as stopped:
        s.simulate(3.0)
    assert stopped.value.time == pytest.approx((2 - math.sqrt(2)) / 0.3, abs=1e-5)


def test_branches_far_apart_are_no_singular_position():
    """A parallelogram that stays 33 degrees from flat: its branches are 0.3 m apart, far more than an accuracy of 1e-2."""
    s = mb.Scene("parallelogram", gravity=(0, -9.81, 0))
    linkage(s, "", 0.3, 0.3, 1.0, 0.0, angle=1.0 * sp.sin(3 * mb.t))
    assert not s.simulate(1.0, accuracy=1e-2).warnings


def test_drift_is_not_blamed_on_what_is_prescribed():
    """A crank that can turn all the way stops where a loose run without position constraints has drifted to."""
    s = mb.Scene("drift", gravity=(0, -9.81, 0))
    links = [s.link(n, p, q, mass=1.0) for n, p, q in (("crank", (0, 0), (0, 0.297)), ("coupler", (0, 0.297), (1, 0.3)),
                                                        ("rocker", (1, 0.3), (1, 0)))]
    s.revolute("A", s.ground, links[0], at=(0, 0), angle=5 * mb.t)
    s.revolute("B", *links[:2], at=(0, 0.297))
    s.revolute("C", *links[1:], at=(1, 0.3))
    s.revolute("D", s.ground, links[2], at=(1, 0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        try:
            run = s.simulate(2.0, solver=mb.CVODE(rtol=1e-2), form="index1")
        except mb.SolverError as stopped:
            assert "drifted by" in str(stopped)  # noqa: PT017
        else:
            assert not run.reliable
