"""Mechanisms with more rows than their motion needs: freedoms, energy, and rows that are chosen again along the motion."""

from __future__ import annotations

import numpy as np
import pytest
from overconstrained_scenes import MECHANISMS, SPEED

import mbdae as mb
from mbdae.system.dependent_rows import best_rows, chosen_rows, rows_in_order, smallest, unit_rows
from mbdae.system.prepare import prepare

PERIOD = 2 * np.pi / SPEED


@pytest.mark.parametrize("name", MECHANISMS)
def test_freedoms_in_many_poses(name):
    mechanism = MECHANISMS[name]
    for seed in range(8):
        found = mechanism.scene(seed).check()
        assert found.degrees_of_freedom == mechanism.freedoms, seed
        assert len(found.redundant) == mechanism.redundant, seed
        assert seed or "singular position" not in str(found)
        assert not found.prepared.rank.singular_here, seed


@pytest.mark.parametrize("name", [name for name in MECHANISMS if "four cranks" not in name])
def test_energy_is_kept_over_a_turn(name):
    mechanism = MECHANISMS[name]
    r = mechanism.scene(1).simulate(mechanism.turn / SPEED, accuracy=1e-6)
    assert r.warnings == ()
    assert np.max(np.abs(r.energy.balance)) < 1e-5 * np.max(r.energy.kinetic)  # ten times the accuracy
    assert np.max(r.drift.position) < 1e-5 * r.prepared.length


@pytest.mark.parametrize("solver", [mb.IDA(), mb.RadauIIA(2), mb.RadauIIA(3, step=0.02), mb.GeneralizedAlpha(step=2e-3)],
                         ids=lambda solver: solver.label)
def test_every_solver_changes_the_rows_of_bennetts_linkage(solver):
    """The rows that hold at the start lose their rank within a turn, all rows together never do."""
    s = MECHANISMS["Bennett"].scene(5)
    r = s.simulate(PERIOD, accuracy=1e-5, solver=solver)
    assert len(r.solution.systems) > 1
    assert r.warnings == ()
    assert np.max(r.drift.position) < 1e-4
    assert np.min(r.smallest_singular_value) > 0.01
    own = prepare(s).mechanics
    G = own.constraint_jacobian(r.t, r.q)
    alone = [np.linalg.svd(unit_rows(own, g), compute_uv=False)[-1] for g in G]
    assert min(alone) < 0.1 * alone[0]


@pytest.mark.parametrize("name", ["Bennett", "platform on three cranks", "shaft with two universal joints, held"])
def test_joint_models_and_forms_agree(name):
    scene = MECHANISMS[name].scene(3)
    hinges = [c.name for c in scene.joints if c.kind == "revolute"]
    runs = [scene.simulate(0.6, accuracy=1e-8, solver=mb.RadauIIA(3)),
            scene.recursive().simulate(0.6, accuracy=1e-8, solver=mb.RadauIIA(3)),
            scene.replace(*hinges, model=mb.Classical()).simulate(0.6, accuracy=1e-8, solver=mb.RadauIIA(3)),
            scene.simulate(0.6, accuracy=1e-8, form=mb.Index1(), solver=mb.CVODE())]
    for body in scene.bodies:
        for r in runs[1:]:
            np.testing.assert_allclose(r[body.name].velocity, runs[0][body.name].velocity, atol=1e-6)


def test_a_drive_turns_both_ends_of_a_cardan_shaft_alike():
    """Two joints with equal angles, in phase, in one plane: the shafts turn alike (driven through a full turn)."""
    from overconstrained_scenes import Universal

    s, bend, shafts = mb.Scene("cardan"), 0.5, []
    axes = [np.array([np.sin(b), 0, np.cos(b)]) for b in (0.0, bend, 0.0)]
    points = np.cumsum([np.zeros(3), *axes], axis=0)
    for i, axis in enumerate(axes):
        across = np.cross([0, 1.0, 0], axis)
        shafts.append(s.rigid_body(f"shaft {i}", 1.0, (0.01, 0.01, 0.002), at=(points[i] + points[i + 1]) / 2,
                                   rotation=np.column_stack([across, [0, 1, 0], axis])))
    s.revolute("in", s.ground, shafts[0], at=points[0], axis=axes[0], angle=4 * mb.t)
    s.add(Universal("first", shafts[0], shafts[1], at=points[1], axis=axes[0]))
    s.add(Universal("second", shafts[2], shafts[1], at=points[2], axis=axes[2]))
    s.revolute("out", s.ground, shafts[2], at=points[3], axis=axes[2])
    assert s.check().degrees_of_freedom == 0
    r = s.simulate(1.6, accuracy=1e-7)
    np.testing.assert_allclose(r["out"].angle, r["in"].angle, atol=1e-5)
    turning = 4 * np.cos(bend) / (1 - (np.sin(bend) * np.cos(r["in"].angle)) ** 2)  # of the shaft between, after Cardan
    along = np.einsum("ti,i->t", r["shaft 1"].angular_velocity, axes[1])
    phase = 4 * np.cos(bend) / (1 - (np.sin(bend) * np.sin(r["in"].angle)) ** 2)
    assert min(np.abs(along - turning).max(), np.abs(along - phase).max()) < 1e-4


def test_reactions_of_redundant_rows_are_those_of_least_norm():
    """Three hinges of a door share its weight, whichever rows are integrated: forces balance, and no share can be smaller."""
    s = mb.Scene("door", gravity=(0, 0, -9.81))
    leaf = s.rigid_body("leaf", 20.0, (6.7, 1.1, 7.8), at=(0.4, 0, 1))
    for i, z in enumerate((0.2, 1.0, 1.8)):
        s.revolute(f"h{i}", s.ground, leaf, at=(0, 0, z))
    runs = [s.simulate(0.2), s.recursive().simulate(0.2)]
    for r in runs:
        assert not r["h0"].reaction_is_unique
        total = sum(r[f"h{i}"].force for i in range(3))
        np.testing.assert_allclose(total[:, 2], 20 * 9.81, rtol=1e-9)
    np.testing.assert_allclose([runs[0][f"h{i}"].force[-1, 2] for i in range(3)], 20 * 9.81 / 3, rtol=1e-6)


def test_true_singular_positions_are_told():
    for end in (1.5, 2.0, 4.5):  # folded; folded with equal pairs of links; stretched, so that it is locked
        flat = mb.Scene("flat four-bar")
        a, b, c = (flat.link(name, (x, 0), (to, 0), mass=1.0) for name, x, to in (("a", 0, 1), ("b", 1, 3), ("c", 3, end)))
        flat.revolute("A", flat.ground, a, at=(0, 0))
        flat.revolute("B", a, b, at=(1, 0))
        flat.revolute("C", b, c, at=(3, 0))
        flat.revolute("D", flat.ground, c, at=(end, 0))
        found = flat.check()
        assert "starts in a singular position" in str(found), end
        assert found.degrees_of_freedom == 1
        assert found.redundant == ()
    crank = mb.Scene("slider-crank in line")
    a, b = crank.link("crank", (0, 0), (1, 0), mass=1.0), crank.link("rod", (1, 0), (3, 0), mass=1.0)
    block = crank.rigid_body("block", 1.0, 0.1, at=(3, 0))
    crank.revolute("A", crank.ground, a, at=(0, 0))
    crank.revolute("B", a, b, at=(1, 0))
    crank.revolute("C", b, block, at=(3, 0))
    crank.prismatic("slide", crank.ground, block, at=(3, 0), axis=(1, 0), position=0)
    assert "starts in a singular position" in str(crank.check())
    crossed = MECHANISMS["parallelogram"].scene(1)
    with pytest.warns(mb.AccuracyWarning, match="singular position"):
        r = crossed.simulate(PERIOD, solver=mb.RadauIIA(3))
    assert min(r.smallest_singular_value) < 0.1


def test_choices_of_rows_span_what_all_rows_span():
    rng = np.random.default_rng(4)
    for rank, m, n in ((3, 5, 6), (7, 10, 8), (1, 4, 3)):
        B = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
        B[1] = 1e-3 * B[0] / np.linalg.norm(B[0]) + B[1] * 1e-9
        B /= np.linalg.norm(B, axis=1, keepdims=True)
        for pick in (rows_in_order(B, rank, []), best_rows(B, rank, []), chosen_rows(B, rank, []), best_rows(B, rank, [2])):
            assert len(set(pick)) == rank
            assert smallest(B[pick], rank) > 1e-3
        assert rows_in_order(B, rank, [3])[0] == best_rows(B, rank, [3])[0] == 3


def test_a_shaft_that_stays_the_same_keeps_its_names():
    """Of parallel hinges in order the last ones are redundant."""
    assert all(row.startswith(("hinge 1.", "hinge 2.")) for row in MECHANISMS["door on three hinges"].scene(0).check().redundant)


def tightrope():
    s = mb.Scene("two bars in line between fixed pins", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (1, 0), mass=1.0), s.link("b", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, a, at=(0, 0))
    s.revolute("B", a, b, at=(1, 0))
    s.revolute("C", b, s.ground, at=(2, 0))
    return s


def three_cranks(third):
    s = mb.Scene("three cranks", gravity=(0, -9.81, 0))
    bar = s.link("bar", (0, 0.3), (1, 0.3), (2, 0.3), mass=1.0)
    for i, length in enumerate((0.3, 0.3, third)):
        crank = s.link(f"crank {i}", (i, 0.3 - length), (i, 0.3), mass=1.0)
        s.revolute(f"foot {i}", s.ground, crank, at=(i, 0.3 - length))
        s.revolute(f"pin {i}", crank, bar, at=(i, 0.3))
    return s


def plate_on_rods():
    s = mb.Scene("a plate on six equal upright rods", gravity=(0, 0, -9.81))
    plate = s.rigid_body("plate", 5.0, (1, 1, 2))
    for i, (x, y) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1))):
        s.distance(f"rod {i}", s.ground, plate, at_k=(x, y, 1), at_l=(x, y, 0))
    return s


@pytest.mark.parametrize(("make", "freedoms", "redundant"), [
    (tightrope, 0, 0), (lambda: three_cranks(0.3), 1, 1), (lambda: three_cranks(0.31), 0, 0), (lambda: three_cranks(0.301), 0, 0),
    (plate_on_rods, 2, 2),
])
@pytest.mark.parametrize("beside", [False, True])
def test_what_moves_to_first_order_only_is_no_freedom(make, freedoms, redundant, beside):
    """Locked structures stay locked, also where a body beside them moves: a position from which loops cannot move is singular."""
    s = make()
    if beside:
        s.point_mass("beside", 1.0, at=(7, 0, 0))
    found = s.check()
    assert found.degrees_of_freedom == freedoms + (3 if "plate" in s.name else 2) * beside
    assert len(found.redundant) == redundant
    assert ("singular position" in str(found)) == (make is tightrope or freedoms == 0 or redundant == 2)
