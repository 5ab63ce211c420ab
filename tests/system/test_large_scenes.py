"""Scenes of many bodies: sparse rank, start and accelerations against closed relations and against dense matrices."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.integrators import kept_rows
from mbdae.system.dependent_rows import smallest
from mbdae.system.many_rows import SparseRows
from mbdae.system.motion import mechanics
from mbdae.system.prepare import prepare

KEPT = mb.Kinematic()


def chain(n, step=(0.0, -1.0)):
    s = mb.Scene("chain", gravity=(0, -9.81, 0))
    before = s.ground
    for i in range(n):
        at, end = np.array(step) * i, np.array(step) * (i + 1)
        body = s.link(f"b{i}", tuple(at), tuple(end), mass=2.0)
        s.revolute(f"j{i}", before, body, at=tuple(at), model=KEPT)
        before = body
    return s


def ladder(n, space="spatial"):
    """A row of n parallelograms on the ground that share their sides; in space every loop has three rows too many."""
    s = mb.Scene("ladder", gravity=(0, -9.81, 0), space=space)
    sides = [s.link(f"side{i}", (i, 0, 0), (i, 1, 0), mass=1.0) for i in range(n + 1)]
    for i, side in enumerate(sides):
        s.revolute(f"foot{i}", s.ground, side, at=(i, 0, 0), model=KEPT)
    for i in range(n):
        bar = s.link(f"bar{i}", (i, 1, 0), (i + 1, 1, 0), mass=1.0)
        s.revolute(f"left{i}", sides[i], bar, at=(i, 1, 0), model=KEPT)
        s.revolute(f"right{i}", bar, sides[i + 1], at=(i + 1, 1, 0), model=KEPT)
    return s


@pytest.fixture
def sparse(monkeypatch):
    """Small scenes are taken as large ones."""
    monkeypatch.setattr(mechanics, "LARGE", 0)


def test_hanging_chain_carries_its_weight():
    """Joint k of a chain at rest carries the rods below it."""
    n = 300
    p = prepare(chain(n))
    assert p.mechanics.large
    names = [row.name for row in p.mechanics.rows]
    force = np.array([p.start.multipliers[names.index(f"j{k}.y")] for k in range(n)])
    assert np.allclose(np.abs(force), 2.0 * 9.81 * (n - np.arange(n)), rtol=1e-9)
    assert p.rank.degrees_of_freedom == n
    assert not p.rank.dropped


def test_smallest_singular_value_of_a_chain():
    """Of sparse rows as of dense ones."""
    p = prepare(chain(150, (1.0, 0.0)))
    here = SparseRows(p.mechanics.sparse_constraint_jacobian(np.zeros(1), p.start.q[None])[0])
    assert smallest(here.B, here.m) == pytest.approx(np.linalg.svd(here.B.toarray(), compute_uv=False)[-1], rel=1e-3)


@pytest.mark.parametrize("n", [3, 30])
def test_loops_in_space_have_three_rows_too_many(n, monkeypatch):
    """n parallelograms: one freedom each row of sides, whichever matrices count."""
    dense = prepare(ladder(n)) if n < 10 else None
    monkeypatch.setattr(mechanics, "LARGE", 0)
    found = [prepare(ladder(n)) for _ in range(2)]
    for p in found:
        assert p.rank.degrees_of_freedom == 1
        assert len(p.rank.dropped) == len(p.mechanics.rows) + len(p.rank.dropped) - (p.model.nu - 1)
        assert not p.rank.singular_here
        assert not p.rank.doubtful
    assert [r.name for r in found[0].rank.dropped] == [r.name for r in found[1].rank.dropped]
    if dense is not None:
        assert len(dense.rank.dropped) == len(found[0].rank.dropped)
        assert {r.name for r in dense.rank.not_unique} == {r.name for r in found[0].rank.not_unique}


def test_reactions_of_redundant_rows_are_those_of_least_norm(monkeypatch):
    """The same as by dense matrices."""
    first = prepare(ladder(2))
    state = np.zeros(1), first.start.q[None], first.start.u[None]
    dense = first.with_all_rows.accelerations(*state)
    monkeypatch.setattr(mechanics, "LARGE", 0)
    found = prepare(ladder(2)).with_all_rows.accelerations(*state)
    assert np.max(np.abs(dense[1])) > 1.0
    assert np.allclose(dense[0], found[0], atol=1e-7)
    assert np.allclose(dense[1], found[1], atol=1e-5 * np.max(np.abs(dense[1])))


def test_nearly_redundant_rows_are_said(sparse):
    """A parallelogram whose axes are not quite parallel, as in a small scene."""
    s = mb.Scene("skew", gravity=(0, -9.81, 0), space="spatial")
    a, b = s.link("a", (0, 0, 0), (0, 1, 0), mass=1.0), s.link("b", (1, 0, 0), (1, 1, 0), mass=1.0)
    c = s.link("c", (0, 1, 0), (1, 1, 0), mass=1.0)
    s.revolute("A", s.ground, a, at=(0, 0, 0), model=KEPT)
    s.revolute("B", a, c, at=(0, 1, 0), model=KEPT)
    s.revolute("C", c, b, at=(1, 1, 0), model=KEPT)
    s.revolute("D", s.ground, b, at=(1, 0, 0), axis=(1e-5, 0, 1), model=KEPT)
    assert prepare(s).rank.doubtful


def test_stretched_chain_between_fixed_points_is_singular(sparse):
    """Its rows depend on each other in this position alone."""
    s = mb.Scene("stretched")
    before = s.ground
    for i in range(4):
        body = s.link(f"b{i}", (i, 0), (i + 1, 0), mass=1.0)
        s.revolute(f"j{i}", before, body, at=(i, 0), model=KEPT)
        before = body
    s.revolute("end", before, s.ground, at=(4, 0), model=KEPT)
    p = prepare(s)
    assert p.rank.singular_here
    assert p.rank.degrees_of_freedom == 2
    assert not p.rank.dropped


def test_motion_without_inertia_is_named(sparse):
    s = chain(3)
    s.rigid_body("ghost", 0.0, 0.0, at=(5, 0))
    with pytest.raises(mb.SceneError, match="ghost"):
        prepare(s)


def test_stated_velocities_stay(sparse):
    """To the last digits, where the joints allow them."""
    s = mb.Scene("thrown")
    s.rigid_body("b", 1.0, 0.1, at=(0, 0), velocity=(10, 0, 0))
    s.rigid_body("c", 1.0, 0.1, at=(1, 0), velocity=(10, 0, 0))
    s.revolute("j", s["b"], s["c"], at=(0.5, 0), model=KEPT)
    p = prepare(s)
    assert p.start.u[p.model.node(s["b"]).u] == pytest.approx(10, rel=1e-12)


def test_steps_on_disk_are_those_in_memory(monkeypatch):
    s = chain(2, (1.0, 0.0))
    solver = mb.RadauIIA(2, rtol=1e-6)
    before = s.simulate(2.0, solver=solver)
    monkeypatch.setattr(kept_rows, "IN_MEMORY", 2000)
    after = s.simulate(2.0, solver=solver)
    assert np.array_equal(before.q, after.q)
    assert np.array_equal(before.solution.yp, after.solution.yp)


@pytest.mark.parametrize("at_once", [1, 5, 300])
def test_steps_are_held_once(at_once):
    """While they are made, but for some room, and where they are given out: no copy is made of all of them."""
    many, row = 20_000, 8 * 10
    tracemalloc.start()
    rows = kept_rows.Rows("y", np.zeros(10))
    for first in range(0, many, at_once):
        rows.extend(first + np.arange(at_once)[:, None] * np.ones(10))
    held, most = tracemalloc.get_traced_memory()
    count = len(rows)
    found = rows.array(count)
    after, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.array_equal(found[1:, 0], np.arange(count - 1))
    assert most < count * row * (1 + 2 / kept_rows.SPARE) + 2 * kept_rows.BLOCK * row + 100_000
    assert max(peak, after) < count * row * (1 + 2 / kept_rows.SPARE) + 2 * kept_rows.BLOCK * row + 100_000
    assert held > count * row  # it was counted


def test_memory_of_a_run_does_not_grow_with_its_steps(monkeypatch):
    """Only the times of the steps stay in memory, 8 bytes each, in the run and its companion, and what evaluates parts of bounded
    size, up to 1 MB in the long run; of values and polynomials 140 each would stay."""
    monkeypatch.setattr(kept_rows, "IN_MEMORY", 2**18)
    s, found = chain(1, (1.0, 0.0)), []
    s.simulate(1.0, accuracy=1e-4)  # what is made once
    for t_end in (20.0, 160.0):
        tracemalloc.start()
        r = s.simulate(t_end, accuracy=1e-4, outputs=5)
        found.append((len(r.solution.t), tracemalloc.get_traced_memory()[1]))
        tracemalloc.stop()
    (steps, before), (more, after) = found
    assert more > steps + 10_000
    assert after - before < 70 * (more - steps)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="tells the memory of mapped files on Linux")
def test_memory_of_steps_that_were_read_from_disk_is_given_back(monkeypatch):
    def mapped():
        return next(int(line.split()[1]) for line in Path("/proc/self/status").read_text().splitlines() if "RssFile" in line)

    monkeypatch.setattr(kept_rows, "IN_MEMORY", 2**20)
    rows = kept_rows.Rows("y", np.zeros(1000))
    for first in range(0, 4000, 100):
        rows.extend(np.full((100, 1000), float(first)))
    found = rows.array(len(rows))
    before = mapped()
    total = found.sum()
    held = mapped()
    kept_rows.leave(found, np.zeros(3))
    assert held > before + 20_000  # kB
    assert mapped() < before + 5_000
    assert found.sum() == total


def test_rows_given_out_stay_as_they_were():
    rows = kept_rows.Rows("y", np.zeros(2))
    rows.extend(np.ones((2000, 2)))
    first = rows.array(2001)
    before = first.copy()
    rows.tail[-1] = np.full(2, 7.0)  # as a run is restarted from other values
    for _ in range(3000):
        rows.append(np.full(2, 5.0))
    assert np.array_equal(first, before)
    assert np.array_equal(rows.array(5001)[[0, 1, 1999, 2000, 2001, 5000], 0], [0, 1, 1, 7, 5, 5])


@pytest.mark.parametrize("rows", [1, 2, 7])
def test_many_bodies_with_few_rows(rows):
    """Rows are sparse because of the bodies; Arnoldi's method finds fewer singular values than there are rows."""
    s = mb.Scene("cloud", gravity=(0, -9.81, 0))
    for i in range(220):
        s.rigid_body(f"b{i}", 1.0, 0.1, at=(i, 0))
    for i in range(rows):
        s.point_on_line(f"p{i}", s.ground, f"b{i}", at=(i, 0), axis=(1, 0, 0))
    r = s.simulate(0.1)
    assert r.prepared.with_all_rows.large
    np.testing.assert_allclose(r.smallest_singular_value, 1.0, rtol=1e-6)
