"""Loops drawn open start alike with every joint model and order of statements; which of the ways to close them is the start."""

from __future__ import annotations

import numpy as np
import pytest
from strangers.opened import differences, opened, start_of, stated

import mbdae as mb
from mbdae.results.stored_parts import started
from mbdae.system.changes import JointMotions
from mbdae.system.prepare import prepare
from mbdae.system.start import Starter

ROUNDING = 1e-10  #: m, rad, s


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (3, 10))])
def test_the_start_hangs_on_no_joint_model_and_no_order(seed):
    for story in opened(seed):
        found = differences(story)
        assert max(found.values()) <= ROUNDING, (found, story)


def test_a_start_that_hangs_on_the_order_would_be_seen():
    """A joint that starts a thousandth farther makes another start."""
    story = next(story for story in opened(1) if start_of(story) is not None)
    farther = story.but(statements=tuple(a.but(angle0=a.args["angle0"] + 1e-3) if "angle0" in a.args else a
                                         for a in story.statements))
    one, other = start_of(story), start_of(stated(farther, "reversed"))
    assert max(np.max(np.abs(one[name] - other[name])) for name in one) > 1e-4


def chain(*points, closing=None, **first) -> mb.Scene:
    """Links from point to point with revolute joints, the first and the last at the ground."""
    s = mb.Scene("loop", gravity=(0, -9.81, 0))
    names = [f"b{i}" for i in range(1, len(points))]
    for name, a, b in zip(names, points, points[1:], strict=False):
        s.link(name, a, b, mass=1.0)
    for i, (k, l) in enumerate(zip(["ground", *names], names, strict=False)):
        s.revolute(f"J{i}", k, l, at=points[i], **(first if i == 0 else {}))
    if closing is None:
        s.revolute("close", s.ground, names[-1], at=points[-1])
    else:
        s.rigid_body("slider", 1.0, 0.1, at=points[-1])
        s.revolute("pin", names[-1], "slider", at=points[-1])
        s.prismatic("close", s.ground, "slider", at=points[-1], axis=(1, 0, 0), position0=closing)
    return s


FIVE = ((0, 0), (0, 0.5), (0.4, 0.9), (0.8, 0.5), (0.8, 0))


@pytest.mark.parametrize("space", ["auto", "spatial"])
def test_motions_of_joints_vanish_as_drawn_and_have_the_derivatives_of_differences(space):
    """Of revolutes, of one at a point mass, and of a rod whose points are apart as drawn."""
    s = chain(*FIVE)
    s.space = space
    s.point_mass("bob", 0.5, at=(0.4, 1.4))
    s.distance("rod", "b2", "bob", (0.4, 0.9), (0.4, 1.4))
    p = prepare(s)
    joints, m = JointMotions(p.model), p.mechanics
    assert np.max(np.abs(joints.far(Starter(m).placed()))) < 1e-15
    q = m.integrate_positions(p.start.q, 0.3 * np.random.default_rng(3).normal(size=m.nu))
    far, D = joints.at(q)
    assert np.array_equal(far, joints.far(q))
    for column, one in zip(D.T, np.eye(m.nu), strict=True):
        ahead, behind = (joints.far(m.integrate_positions(q, step * one)) for step in (1e-6, -1e-6))
        assert np.max(np.abs(column - (ahead - behind) / 2e-6)) < 1e-8


@pytest.mark.parametrize("angle0", [0.3, -0.7])
def test_no_start_nearby_has_joints_nearer_to_the_drawing(angle0):
    """A five-bar keeps a freedom where its crank is held: along it the sum of the squares has its least value at the start."""
    p = prepare(chain(*FIVE, angle0=angle0))
    joints, closer, m = JointMotions(p.model), Starter(p.mechanics), p.mechanics
    A = closer._closure_jacobian(p.start.q)
    free = np.linalg.svd(A)[2][np.linalg.matrix_rank(A) :]
    assert len(free) == 1

    def far(step: float) -> float:
        q = closer.close(m.integrate_positions(p.start.q, step * free[0]))
        return float(np.sum(joints.at(q)[0] ** 2))

    least, near = far(0.0), [far(step) for step in (-1e-3, 1e-3)]
    assert min(near) > least
    assert abs(near[1] - near[0]) < 1e-2 * (sum(near) - 2 * least)  # as at a minimum: equal on both sides


@pytest.mark.parametrize("angle0", [0.3, -0.7])
def test_no_rates_that_fit_move_joints_less(angle0):
    """Where one joint has a rate, the others move least."""
    p = prepare(chain(*FIVE, angle0=angle0, rate0=2.0))
    V = JointMotions(p.model).at(p.start.q, rates=True)[1]
    A = Starter(p.mechanics)._closure_jacobian(p.start.q)
    free = np.linalg.svd(A)[2][np.linalg.matrix_rank(A) :]
    assert np.max(np.abs(free @ (V.T @ (V @ p.start.u)))) < 1e-5  # the masses have a millionth of the say


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), None])
def test_two_ways_that_are_equally_near_are_refused(model):
    """Drawn stretched, a slider-crank may fold upwards or downwards; drawn a little off, it folds there."""
    def scene(y: float) -> mb.Scene:
        s = chain((0, 0), (1, y), (2, 0), closing=-0.5)
        return s.recursive() if model is None else s.replace(model=model)

    with pytest.raises(mb.StartError, match=r"equally near to the drawing, and differ most in the place of 'b2'"):
        scene(0.0).check()
    for y in (0.1, -0.1):
        angle = float(started(prepare(scene(y)))["J0"].angle[0])
        assert angle * y > 0.05


def test_a_way_through_a_singular_position_is_told():
    """Drawn flat, a parallelogram may go on as one or crossed: as one its joints stay nearer to the drawing."""
    p = prepare(chain((0, 0), (0.5, 0), (1.5, 0), (1.0, 0), angle0=0.5))
    here = started(p)
    assert [float(here[j].angle[0]) for j in ("J0", "J1", "J2", "close")] == pytest.approx([0.5, -0.5, 0.5, 0.5], abs=1e-9)
    assert any("in two ways" in change for change in p.start.changes)


@pytest.mark.parametrize("space", ["auto", "spatial"])
def test_whole_turns_are_kept(space):
    """A parallelogram whose crank starts beyond a turn: the other joints turn as far in every model that has their angles."""
    s = chain((0, 0), (0.3, 0.4), (1.3, 0.4), (1.0, 0), angle0=7.0)
    s.space = space
    classical, recursive = prepare(s.replace(model=mb.Classical())), prepare(s.recursive())
    assert [float(started(classical)[j].angle[0]) for j in ("J0", "J1", "J2")] == pytest.approx([7.0, -7.0, 7.0], abs=1e-9)
    assert [float(started(recursive)[j].angle[0]) for j in ("J0", "J1")] == pytest.approx([7.0, -7.0], abs=1e-9)
