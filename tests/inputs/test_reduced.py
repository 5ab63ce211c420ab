"""Reduced bodies: modes against closed forms and the whole matrices, motion against rigid bodies and beams, errors."""

from __future__ import annotations

import re
import warnings
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
import sympy
from reduced_bodies.beam import AREA, DENSITY, LENGTH, PER_LENGTH, SECOND, beam_matrices, on_a_hub
from reduced_bodies.cost import pendulum
from scipy.integrate import solve_bvp
from scipy.linalg import eigh

import mbdae as mb
from mbdae.documents.blocks import Picture, Table
from mbdae.reports.scene_sheet import VIEW
from mbdae.system.sampling import motion_distance

ENDS = {"root": [0], "tip": [10]}
TIP = (0.958541919, -0.285008145)  #: m, of the soft pendulum after 0.2 s, by a run to an accuracy of 1e-7


def reduced(modes: int | None, E: float = 2.1e11, interfaces: Any = ENDS) -> mb.ReducedBody:
    return mb.ReducedBody.craig_bampton(*beam_matrices(10, E), interfaces, modes)


def test_rigid_motions_are_exact_and_free_frequencies_those_of_the_whole_matrices() -> None:
    M, K, _ = beam_matrices(10)
    whole = np.sqrt(eigh(K.toarray(), M.toarray(), eigvals_only=True)[6:14]) / (2 * np.pi)
    body = reduced(None)
    np.testing.assert_allclose(body.frequencies[:8], whole, rtol=1e-4)
    assert 0 < body.left_out <= 1e-3
    # rotary inertia lowers the first free frequency of Bernoulli's beam by 4e-4 in each of the first two modes
    np.testing.assert_allclose(2 * np.pi * body.frequencies[0], 22.3733 * np.sqrt(2.1e11 * SECOND / PER_LENGTH), rtol=1e-3)
    assert (body.mass, body.center[0]) == pytest.approx((PER_LENGTH, LENGTH / 2), rel=1e-12)
    across = PER_LENGTH / 12 + DENSITY * SECOND * LENGTH
    np.testing.assert_allclose(body.inertia, np.diag([2 * DENSITY * SECOND, across, across]), rtol=1e-9, atol=1e-12)


def test_points_have_the_inertia_of_the_body_and_of_its_modes() -> None:
    body = reduced(4)
    place, moved, mass = body.points[:, :, 0], body.points[:, :, 1:], body.mass / len(body.points)
    np.testing.assert_allclose(mass * (np.trace(place.T @ place) * np.eye(3) - place.T @ place), body.inertia, atol=1e-12)
    size = np.sqrt(body.modal_mass)
    found = mass * np.einsum("pca,pcb->ab", moved, moved) / size / size[:, None]
    np.testing.assert_allclose(found, np.eye(len(size)), atol=1e-12)
    assert np.max(np.abs(np.cross(place[:, :, None], moved, axis=1).sum(axis=0))) < 1e-12
    assert np.max(np.abs(body.points.sum(axis=0))) < 1e-12


def test_a_block_of_three_freedoms_a_node_has_its_interfaces_at_faces() -> None:
    """A rod of cubes, springs along edges and diagonals: its faces are held plane, which stiffens it a little."""
    grid = np.array([[x, y, z] for x in range(4) for y in range(2) for z in range(2)], dtype=float)
    K = np.zeros((48, 48))
    for i, j in zip(*np.tril_indices(16, -1), strict=True):
        n = (grid[i] - grid[j]) / np.linalg.norm(grid[i] - grid[j])
        near = 1e6 if np.linalg.norm(grid[i] - grid[j]) < 1.8 else 0.0
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * near * np.outer(n, n)
    body = mb.ReducedBody.craig_bampton(sp.identity(48), K, grid, {"left": [0, 1, 2, 3], "right": [12, 13, 14, 15]}, 6)
    held = np.linalg.solve(K[12:, 12:], np.repeat([0, 1.0], [24, 12]) * np.tile([1.0, 0, 0], 12))
    stretch = float(np.sum((body.interface_shapes["right"] - body.interface_shapes["left"])[0] ** 2 / body.modal_stiffness))
    assert 0.8 * held[24::3].mean() / 4 < stretch < held[24::3].mean() / 4


def springs() -> Any:
    """K of four nodes at a corner, three freedoms each, springs between all."""
    K, at = np.zeros((12, 12)), np.eye(4, 3)
    for i, j in zip(*np.tril_indices(4, -1), strict=True):
        line = np.zeros(12)
        line[3 * i : 3 * i + 3], line[3 * j : 3 * j + 3] = (n := at[i] - at[j]), -n
        K += 1e6 * np.outer(line, line)
    return K


M, K, NODES = beam_matrices(4)
APART = sp.block_diag([beam_matrices(2)[0]] * 2), sp.block_diag([beam_matrices(2)[1]] * 2), np.vstack(
    [beam_matrices(2)[2], beam_matrices(2)[2] + [2, 0, 0]])
ORDER = np.arange(30).reshape(5, 6).T.ravel()
NEGATIVE = sp.csc_matrix(M + sp.csc_matrix(([-5e-3, -5e-3], ([9, 15], [15, 9])), shape=(30, 30)))


@pytest.mark.parametrize(("given", "words"), [
    ((M, -K, NODES, {"a": [0]}), "K is indefinite"), ((NEGATIVE, K, NODES, {"a": [0]}), "M is indefinite"),
    ((M[ORDER][:, ORDER], K[ORDER][:, ORDER], NODES, {"a": [0]}), "not in the order ux uy uz rx ry rz, node by node"),
    ((M, K, 1e3 * NODES, {"a": [0]}), "nodes are in another order or unit"),
    ((M * 1e-14, K, NODES, {"a": [0]}), "M in kg, K in N/m"),
    ((M, K + sp.diags([1e9] * 3 + [0.0] * 27), NODES, {"a": [0]}), "ux of node 0: give K without supports"),
    ((*APART, {"a": [0]}), "mechanism"), ((*APART, {"a": [0], "b": [3]}), "motions that are not rigid have no stiffness"),
    ((M, K, NODES, {"a": []}), "interfaces['a'] has no nodes"), ((M, K, NODES, {"a": [5]}), "0 to 4"),
    ((M, K, NODES, {"a": [0], "b": [0]}), "which interface 'a' has too"), ((M, K, NODES, None), "interfaces = None"),
    ((M, sp.triu(K), NODES, {"a": [0]}), "K is not symmetric: give the whole symmetric matrix, not a half"),
    ((M, K + sp.csc_matrix(([1e-3 * K[2, 2]], ([2], [8])), K.shape), NODES, {"a": [0]}),
     "K is not symmetric: its entries [2, 8] and [8, 2]"),
    ((M, K + sp.csc_matrix(([2e-5 * K[2, 2]], ([2], [8])), K.shape), NODES, {"a": [0]}),
     "K is not symmetric: its entries [2, 8] and [8, 2]"),
    ((0 * M, K, NODES, {"a": [0]}), "M is zero: all its entries are 0"),
    ((M, K, NODES, {"a": [0, 0]}), "interfaces['a'] has the node 0 twice: name it once"),
    ((M, K, NODES, {"a": [True, False]}), "or True or False for each of the 5 nodes"),
    ((M, K, NODES, {"a": [0]}, 99), "modes = 99"),
    ((*beam_matrices(40), {"a": [0]}, None, False, False, None, 1e-15), "give accelerations=True and up_to=, a larger accuracy"),
    ((M, K, NODES, {"a": [0]}, 2, "all"), "accelerations = 'all'"), ((M, K, NODES, {"a": [0]}, 2, False, 3), "stiffening = 3"),
    ((M, K, NODES, {"a": [0]}, 1, False, lambda u, v: u[:3]), "give a function that returns 30 forces"),
    ((sp.identity(12), springs(), np.eye(4, 3), {"a": [0, 1, 2]}, 1, False, True), "reads two-node elements"),
    ((M, K, NODES[:4], {"a": [0]}), "for 4 nodes"), ((M, K, "nodes", {"a": [0]}), "nodes = 'nodes'"),
], ids=lambda part: part if isinstance(part, str) else "")
def test_what_is_no_free_body_is_refused_with_the_reason(given: Any, words: str) -> None:
    with pytest.raises(mb.OptionError) as refused:
        mb.ReducedBody.craig_bampton(*given)
    assert words in str(refused.value)


def between(a: int, b: int, k: float) -> Any:
    """A spring (30, 30) between two freedoms."""
    return sp.csc_matrix(([k, k, -k, -k], ([a, b, a, b], [a, b, b, a])), shape=(30, 30))


LUMPED = sp.diags(np.tile([1.0, 1.0, 1.0, 0, 0, 0], 5))


@pytest.mark.parametrize("kind", ["craig_bampton", "free_interface"])
@pytest.mark.parametrize(("given", "words"), [
    ((LUMPED, K, NODES, {"a": [0], "b": [4]}), "[1.0, 0.0, 0.0] no positive inertia"),
    ((M, K - 1.15 * between(9, 15, -float(K[9, 15])), NODES, {"a": [0], "b": [4]}), "K is indefinite: some deformation"),
    ((*APART, {"a": [0], "b": [5]}), "mechanism"),
    ((M, K * 1e-7, NODES, {"a": [0], "b": [4]}), "travel through the body at about 1.6 m/s"),
    *(((M, K, NODES, {name: [0], "b": [4]}), f"'<body>.{name}' is an item") for name in ("modes", "inertia 1", "interface b"))])
def test_what_either_reduction_cannot_take_is_named(kind: str, given: Any, words: str) -> None:
    with pytest.raises(mb.OptionError) as refused:
        getattr(mb.ReducedBody, kind)(*given, modes=4)
    assert words in str(refused.value)


@pytest.mark.parametrize(("at", "stiffness", "words"), [
    (0, 10.0, "10 N/m along x"), (1, 1.0, "N m/rad about z"), (24, 10.0, "N/m along x"), (26, 1.0, "N m/rad about y")])
def test_springs_to_ground_that_a_reduction_would_leave_out_are_found(at: int, stiffness: float, words: str) -> None:
    """A hundred-millionth of the entries of K, a ten-thousandth of the softest stiffness; and no springs where there are none."""
    grounded = sp.csc_matrix(([stiffness], ([at], [at])), shape=(30, 30))
    with pytest.raises(mb.OptionError, match=f"K resists rigid motions by .*{words}.*s.spring"):
        mb.ReducedBody.craig_bampton(M, K + grounded, NODES, {"a": [0]}, 2)
    mb.ReducedBody.craig_bampton(*beam_matrices(200), {"a": [0]}, 2)


@pytest.mark.parametrize(("mass", "stiffness", "speed"), [(1.0, 1e-3, r"1\.6e\+02"), (1e-3, 1.0, r"1\.6e\+05")])
def test_a_body_softer_than_rubber_or_lighter_than_diamond_is_asked_for_units(mass: float, stiffness: float, speed: str) -> None:
    """The lighter one: M in t."""
    with pytest.warns(mb.AccuracyWarning, match=rf"at about {speed} m/s, .* are M in kg"):
        mb.ReducedBody.craig_bampton(mass * M, stiffness * K, NODES, {"a": [0]}, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mb.ReducedBody.craig_bampton(M, K / 100, NODES, {"a": [0]}, 2)


def test_a_cantilever_bends_as_bernoulli_says() -> None:
    s = mb.Scene("cantilever")
    s.reduced_body("beam", reduced(0), at=(0.3, 0.2, 0.1))
    s.weld("wall", s.ground, "beam.root", at=(0.3, 0.2, 0.1))
    s.force("F", "beam.tip", (0, 1e-3 * 2.1e11 * SECOND, 0))  # so small that the square of the deflection does not count
    deflection = s.equilibrium()["beam.tip"].position[0, 1] - 0.2
    assert deflection == pytest.approx(1e-3 / 3, rel=1e-6)
    held = s.simulate(0.02, 1e-4, start="relaxed")["beam.tip"].position[:, 1] - 0.2
    np.testing.assert_allclose(held, deflection, rtol=1e-6)
    s = mb.Scene("cantilever")
    s.reduced_body("beam", reduced(8))
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    M, K, _ = beam_matrices(10)
    whole = np.sqrt(eigh(K.toarray()[6:, 6:], M.toarray()[6:, 6:], eigvals_only=True))
    found = np.unique(np.round(np.abs(s.linearize().eigenvalues.imag), 3))
    np.testing.assert_allclose(found[:2], whole[[0, 2]], rtol=2e-4)


@pytest.mark.parametrize("load", [0.06, 0.24])
def test_the_second_order_of_deformations_is_told_beside_every_number(load: float) -> None:
    """The end of a cantilever against the elastica: no other run of the same body shows what it leaves out."""
    def bent(s: Any, y: Any) -> Any:
        return np.array([y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    exact = solve_bvp(bent, lambda a, b: np.array([a[0], b[1], a[2], a[3]]), np.linspace(0, 1, 9), np.zeros((4, 9)), tol=1e-9)
    s = mb.Scene("cantilever")
    s.reduced_body("beam", reduced(0), damping=1.0)
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    x = mb.t / 0.5
    s.force("F", "beam.tip", (0, load * 2.1e11 * SECOND / LENGTH**2 * x**3 * (10 - 15 * x + 6 * x**2), 0))
    r = s.simulate(0.5, 1e-5)
    off = float(np.linalg.norm(r["beam.tip"].position[-1, :2] / LENGTH - exact.y[2:, -1]))
    assert off <= r.accuracy.deformation <= 10 * off
    assert "deformation" not in r.accuracy.covers
    assert f"{r.accuracy.deformation:.1e}" in r.accuracy.not_covered["deformation"]
    assert r.accuracy.lacks == r.peak("beam.tip.position[0]").lacks == "mesh and the second order of deformations"
    s = mb.Scene("at rest")
    s.reduced_body("beam", reduced(0))
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", (0, load * 2.1e11 * SECOND / LENGTH**2, 0))
    rest = s.equilibrium()
    assert off <= rest.accuracy.deformation <= r.accuracy.deformation  # the run may have drifted, which its end does not show
    assert f"deformation: {rest.accuracy.deformation:.1e}" in repr(rest)
    assert rest.accuracy.lacks == r.accuracy.lacks


def test_what_frequencies_that_are_off_add_up_to_is_part_of_what_deformations_leave_out() -> None:
    """A cantilever swings five times under a sudden load, beside beams: four times the second order."""
    load, times = 0.05 * 2.1e11 * SECOND, np.linspace(0, 0.3, 201)
    s, exact = mb.Scene("reduced"), mb.Scene("beam")
    body = mb.ReducedBody.craig_bampton(*beam_matrices(6), {"root": [0], "tip": [6]}, 2)
    s.reduced_body("beam", body)
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", (0, load, 0))
    stiff = 2.1e11 * SECOND
    beam = exact.beam("beam", (0, 0), (1, 0), elements=3, order=3, section=mb.Section(
        2.1e11 * AREA, 1e3 * stiff, 1e3 * stiff, 1.6e11 * SECOND, stiff, stiff, mass_per_length=PER_LENGTH,
        rotary_inertia=2 * DENSITY * SECOND))
    exact.weld("wall", exact.ground, beam.at((0, 0)), at=(0, 0, 0))
    exact.force("F", beam.at((1, 0)), (0, load, 0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        r, right = (x.simulate(0.3, 1e-4, outputs=times) for x in (s, exact))
    apart = r["beam.tip"].position[:, :2] - right["beam"].at((1, 0)).position[:, :2]
    off = float(np.max(np.linalg.norm(apart, axis=1))) / r.prepared.length
    assert off < r.accuracy.deformation < 3 * off


def test_damping_may_be_given_mode_by_mode_and_the_last_one_holds_for_further_modes(tmp_path: Path) -> None:
    s = mb.Scene("free")
    s.reduced_body("beam", reduced(4), damping=[0.01, 0.02, 0.05])
    critical = 2 * np.sqrt(reduced(4).modal_stiffness * reduced(4).modal_mass)
    laws = next(c.laws for c in s.connections if c.name == "beam.modes")
    np.testing.assert_allclose([law.damping for law in laws[1:]] / critical, [0.01, 0.02, *[0.05] * 8], rtol=1e-12)
    s.simulate(0.001, 1e-3).save(tmp_path / "r.npz")
    again = mb.load(tmp_path / "r.npz").prepared.model.scene
    assert [c.laws[0].ratio for c in again.connections if c.name == "beam.modes"] == [(0.01, 0.02, 0.05)]
    for wrong, words in (([0.1] * 99, "99 ratios for 10 modes"), ([], "0 ratios"), ([0.1, -1], "negative"), ("x", "a number")):
        s = mb.Scene("wrong")
        s.reduced_body("beam", reduced(4), damping=wrong)
        with pytest.raises(mb.MbdaeError, match=words):
            s.linearize()


@pytest.mark.parametrize("modes", [2, 6])
def test_errors_of_frequencies_by_modes_left_out_are_measured(modes: int) -> None:
    s = mb.Scene("cantilever")
    s.reduced_body("beam", reduced(modes))
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    found = s.linearize()
    kept = f"{len(reduced(modes).modal_mass)} modes kept of 'beam'"
    assert f"{kept}: their error is not covered (.mesh_error measures it)" in str(found)
    M, K, _ = beam_matrices(10)
    whole = np.sqrt(eigh(K.toarray()[6:, 6:], M.toarray()[6:, 6:], eigvals_only=True))[[0, 1, 2, 3]]
    off = found.angular_frequencies[:4] / whole - 1
    np.testing.assert_allclose(found.mesh_error[:4], off, rtol=0.1)
    assert "modes kept of 'beam': relative error of at most" in repr(found)


@pytest.mark.parametrize("held", [True, False])
def test_forces_on_interfaces_alone_leave_it_at_rest_where_it_is_held_and_nowhere_else(held: bool) -> None:
    """Interfaces and modes have no mass: what remains of their forces by rounding is compared with what joints pass on."""
    s = mb.Scene("cantilever")
    s.reduced_body("beam", reduced(8))
    if held:
        s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", (0, 0.1 * 2.1e11 * SECOND, 0))
    if held:
        assert s.equilibrium()["beam.tip"].position[0, 1] == pytest.approx(0.1 / 3, rel=2e-4)  # its tip turns by 0.05 rad
    else:
        with pytest.raises(mb.EquilibriumError):
            s.equilibrium()


def clamped(accelerations: bool, modes: int) -> tuple[mb.ReducedBody, float]:
    """The body between two walls under gravity across it, and how far its middle sags over w L^4 / (384 E I)."""
    body = mb.ReducedBody.craig_bampton(*beam_matrices(10), ENDS, modes, accelerations)
    s = mb.Scene("clamped", gravity=(0, -9.81, 0))
    s.reduced_body("beam", body)
    for end, at in (("root", 0.0), ("tip", LENGTH)):
        s.weld(end, s.ground, f"beam.{end}", at=(at, 0, 0))
    r = s.equilibrium()
    moved = body.displacement([getattr(r["beam.modes"], f"mode{i + 1}")[0] for i in range(len(body.modal_mass))])
    middle = r["beam"].position[0] + body.nodes[5] + moved[5, :3] - body.center
    return body, -float(middle[1]) / (9.81 * PER_LENGTH * LENGTH**4 / (384 * 2.1e11 * SECOND))


@pytest.mark.parametrize("modes", [0, 3, 8])
def test_with_accelerations_nothing_is_left_out_of_what_a_weight_does(modes: int) -> None:
    body, sag = clamped(True, modes)
    assert body.left_out == 0.0
    assert sag == pytest.approx(1, rel=1e-5)
    # the modes kept stay those with held interfaces, and free frequencies fall towards those of the whole matrices, not below
    M, K, _ = beam_matrices(10)
    whole = np.sqrt(eigh(K.toarray(), M.toarray(), eigvals_only=True)[6:]) / (2 * np.pi)
    without = reduced(modes)
    assert len(body.held_frequencies) == modes
    assert len(without.frequencies) < len(body.frequencies) <= len(without.frequencies) + 6
    assert np.all(body.frequencies >= whole[: len(body.frequencies)] * (1 - 1e-9))
    assert np.all(body.frequencies[: len(without.frequencies)] <= without.frequencies * (1 + 1e-9))


def test_modes_are_as_few_as_the_accuracy_and_the_frequency_of_the_loads_need() -> None:
    few = {accuracy: mb.ReducedBody.craig_bampton(*beam_matrices(10), ENDS, accuracy=accuracy) for accuracy in (0.1, 1e-3)}
    assert len(few[0.1].held_frequencies) < len(few[1e-3].held_frequencies)
    for accuracy, body in few.items():
        count = len(body.held_frequencies)
        assert body.left_out <= accuracy < reduced(count - 1).left_out
    slow, fast = (len(mb.ReducedBody.craig_bampton(*beam_matrices(10), ENDS, None, True, up_to=f).held_frequencies)
                  for f in (5.0, 500.0))
    assert slow < fast


def test_what_the_modes_leave_out_is_told_by_a_verified_run() -> None:
    s = mb.Scene("shaken")
    s.reduced_body("beam", reduced(0), damping=0.05)
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", (0, 20.0 * sympy.sin(300 * mb.t), 0))
    with pytest.warns(mb.AccuracyWarning, match="reduced bodies more modes"):
        r = s.simulate(0.02, accuracy=1e-4, verify=True)
    t, fine = np.linspace(0, 0.02, 101), mb.Scene("fine")
    fine.reduced_body("beam", reduced(30), damping=0.05)
    fine.weld("wall", fine.ground, "beam.root", at=(0, 0, 0))
    fine.force("F", "beam.tip", (0, 20.0 * sympy.sin(300 * mb.t), 0))
    q = fine.simulate(0.02, accuracy=1e-5)
    off = np.max(np.linalg.norm(r(t)["beam.tip"].position - q(t)["beam.tip"].position, axis=1)) / r.prepared.length
    assert off / 3 < r.accuracy.mesh < 10 * off  # of all nodes and angles, not of the tip alone
    force, torque = ([np.linalg.norm(getattr(x, of), axis=1) for x in (r(t)["wall"], q(t)["wall"])] for of in ("force", "torque"))
    off = max(np.max(abs(a - b)) for a, b in (force, torque)) / np.max(force)  # the torque over 1 m, the scene's length
    assert off / 3 < r.accuracy.reactions < 10 * off


@pytest.mark.parametrize(("kept", "told"), [({}, True), ({"accelerations": True}, False)])
def test_a_run_says_what_its_modes_leave_out_of_the_deformation_by_weight(kept: dict[str, bool], told: bool) -> None:
    """A beam held at both ends: statically 1 / 384 of m g L^3 / (E I) in the middle, and twice that in motion."""
    body = mb.ReducedBody.craig_bampton(*beam_matrices(10, 2.1e9), ENDS, 0, **kept)
    sag = 9.81 * PER_LENGTH * LENGTH**4 / (384 * 2.1e9 * SECOND)
    s = mb.Scene("held", gravity=(0, -9.81, 0))
    s.reduced_body("beam", body, damping=0.05)
    s.weld("root", s.ground, "beam.root", at=(0, 0, 0))
    s.weld("tip", s.ground, "beam.tip", at=(1, 0, 0))
    words = f"its modes leave out up to {2 * sag:.2g} m"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        r, rest = s.simulate(0.05, 1e-3), s.equilibrium()
    assert any(words in w for w in r.warnings) == told
    assert any(f"its modes leave out up to {sag:.2g} m" in str(w.message) for w in caught) == told
    assert ("the modes kept leave out" in r.accuracy.not_covered["mesh"]) == told
    assert (f"up to {sag:.2g} m of its displacements between interfaces: keep more modes" in str(s.check())) == told
    assert rest.accuracy.deformation < 1e-2
    if told:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            measured = s.simulate(0.05, 1e-3, verify=True)
        assert sag < measured.accuracy.mesh * r.prepared.length < 3 * sag
        assert not any(words in w for w in measured.warnings)


def test_without_accelerations_a_weight_is_shown_by_the_modes_alone() -> None:
    assert clamped(False, 0)[1] == pytest.approx(0, abs=1e-6)


def test_what_is_left_out_is_the_share_of_whole_accelerations_that_the_modes_do_not_show() -> None:
    """Loads by accelerations act on inner nodes through the mass between them and the interfaces, too."""
    M, K, nodes = (np.asarray(A.todense()) if sp.issparse(A) else A for A in beam_matrices(10))
    R, inner = np.zeros((66, 6)), slice(6, 60)
    for i, x in enumerate(nodes - reduced(0).center):
        R[6 * i : 6 * i + 6] = np.block([[np.eye(3), np.cross(np.eye(3), x)], [np.zeros((3, 3)), np.eye(3)]])
    loads = (M @ R)[inner]
    energy = np.einsum("ia,ia->a", loads, np.linalg.solve(K[inner, inner], loads))
    for modes in (4, 16, 30):
        values, vectors = eigh(K[inner, inner], M[inner, inner], subset_by_index=(0, modes - 1))
        shown = np.sum((vectors.T @ loads) ** 2 / values[:, None], axis=0)
        assert reduced(modes).left_out == pytest.approx(np.max(1 - shown / energy), rel=1e-6)


@pytest.mark.parametrize("share", [0.5, -0.5])
def test_a_column_softens_under_a_load_and_stiffens_when_pulled(share: float) -> None:
    """Deflection by a force across a cantilever that is pressed by a share of Euler's load."""
    EI, F = 2.1e11 * SECOND, 1e-3 * 2.1e11 * SECOND
    body = mb.ReducedBody.craig_bampton(*beam_matrices(10), ENDS, 4, stiffening=True)
    s = mb.Scene("column")
    s.reduced_body("beam", body)
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", (-(P := share * np.pi**2 / 4 * EI), F, F))
    k = np.sqrt(abs(P) / EI)
    deflection = F * ((np.tan if P > 0 else np.tanh)(k) - k) / (P * k)
    np.testing.assert_allclose(s.equilibrium()["beam.tip"].position[0, 1:], deflection, rtol=5e-4)
    assert "loads stiffen and soften it" in str(s.check())


def pressed(load: float, stiffening: bool = False) -> mb.Scene:
    s = mb.Scene("column")
    s.reduced_body("beam", mb.ReducedBody.craig_bampton(*beam_matrices(10), ENDS, 2, stiffening=stiffening))
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", (0.0, 5.0, 0.0))
    s.force("P", "beam.tip", (-mb.number("load", load), 0, 0))
    return s


def still(s: mb.Scene) -> mb.Equilibrium:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        return s.equilibrium()


@pytest.mark.parametrize("ask", [
    lambda s: s.simulate(0.01, accuracy=1e-3), lambda s: s.equilibrium(), lambda s: s.linearize(at=still(s), count=3),
    lambda s: s.floquet(0.01, at=still(s), count=2, accuracy=1e-4),
    lambda s: s.continuation("load", (99, 101), of=still(s), steps=1)])
def test_a_load_that_changes_the_stiffness_of_a_body_without_stiffening_is_told(ask: Any) -> None:
    """By every question whose answer it changes, and by none below the bound or with stiffening."""
    euler = np.pi**2 / 4 * 2.1e11 * SECOND
    share = 100 * 100 / euler
    words = r"pulls or presses at its interface 'tip' towards its centre.* about ([\d.]+) %"
    with pytest.warns(mb.AccuracyWarning, match=words) as caught:
        ask(pressed(100.0))
    told = next(found for one in caught if (found := re.search(words, str(one.message))))
    assert float(told[1]) == pytest.approx(share, rel=0.1)


@pytest.mark.parametrize(("load", "stiffening"), [(60.0, False), (100.0, True)])
def test_a_light_load_and_one_that_is_reckoned_with_are_not_told(load: float, stiffening: bool) -> None:
    s = pressed(load, stiffening)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        e = s.equilibrium()
        s.linearize(at=e)
    assert not e.warnings


def test_a_turning_beam_stiffens_as_wright_says() -> None:
    """Clamped to a hub that turns at 6 sqrt(EI / (m L^4)): flap and lag by Galerkin's method (rotating_beam_frequencies)."""
    found = on_a_hub(16, 8, 6)
    for flap in (7.3604, 26.8091, 66.6839):
        assert np.min(np.abs(found / flap - 1)) < 2e-3


def thrown(s: mb.Scene, add: Any) -> Any:
    add(velocity=(1, 2, 3), angular_velocity=(5.0, 3.0, 20.0))
    return s.simulate(0.1, accuracy=1e-5)


def test_a_stiff_one_flies_as_the_rigid_body_and_keeps_momentum_and_energy() -> None:
    s, rigid = mb.Scene("flexible", gravity=(0, 0, -9.81)), mb.Scene("rigid", gravity=(0, 0, -9.81))
    body = mb.ReducedBody.craig_bampton(*beam_matrices(2, 2.1e13), {"root": [0]}, 2)
    r = thrown(s, lambda **k: s.reduced_body("rod", body, damping=1.0, **k))
    q = thrown(rigid, lambda **k: rigid.rigid_body("rod", body.mass, body.inertia, at=body.center, **k))
    np.testing.assert_allclose(r["rod"].position, q["rod"].position, atol=1e-6)
    np.testing.assert_allclose(r["rod"].angular_velocity, q["rod"].angular_velocity, rtol=1e-4, atol=1e-3)
    # about the centre of mass all angular momentum is that of the points
    names = [f"rod.inertia {i + 1}" for i in range(len(body.points))]
    mass = body.mass / len(names)
    about = sum(mass * np.cross(r[n].position - r["rod"].position, r[n].velocity) for n in names)
    assert np.max(np.abs(about - about[0])) < 1e-5 * np.linalg.norm(about[0])
    assert np.max(np.abs(r.energy.total - r.energy.total[0])) < 1e-3 * r.energy.kinetic[0]


def test_vibrations_left_out_are_met_by_as_few_steps_as_the_accuracy_needs() -> None:
    """A pendulum of undamped modes: at 108 steps of five stages its tip is 4e-6 rad off, at 48 it is 1.8e-5; with three stages it
    is 5e-6 rad off at 261 steps."""
    s = pendulum()
    r = s.simulate(0.2, accuracy=1e-5)
    right = s.simulate(0.2, accuracy=1e-5, form=mb.GGL(waves=True), solver=mb.RadauIIA(5, rtol=1e-4))
    times = np.linspace(0, 0.2, 101)
    off = motion_distance(r.prepared, *(x.prepared.states(times, x.solution(times))[:2] for x in (r, right)))
    assert np.max(off) < 1e-5


def test_a_further_run_for_forces_is_not_begun_where_it_would_not_come_to_its_end() -> None:
    """Two runs and a short one, of which those with many modes take half of the steps that three stages need."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        r = pendulum().simulate(0.2, 1e-5)
    assert (r.info.runs, r.info.solver.stages) == (3, 5)
    assert r.info.stats.steps < 160


@pytest.mark.parametrize("solver", [None, "ida", "dop853", "generalizedalpha"])
def test_a_soft_pendulum_keeps_its_energy_with_every_solver_and_is_told(solver: str | None) -> None:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.reduced_body("rod", reduced(0, E=2.1e9))
    s.revolute("hinge", s.ground, "rod.root", at=(0, 0, 0))
    with pytest.warns(mb.AccuracyWarning, match=r"stiffening by centrifugal forces"):
        r = s.simulate(0.2, accuracy=1e-4, solver=solver) if solver else s.simulate(0.2, accuracy=1e-4)
    np.testing.assert_allclose(r["rod.tip"].position[-1, :2], TIP, atol=3e-4)
    assert np.max(np.abs(r.energy.total - r.energy.total[0])) < 3e-3 * np.max(r.energy.kinetic)



@pytest.mark.parametrize("modes", [0, 4, 20])
def test_a_body_of_free_modes_is_statically_complete_and_has_the_free_frequencies(modes: int) -> None:
    M, K, nodes = beam_matrices(10)
    whole = np.sqrt(eigh(K.toarray(), M.toarray(), eigvals_only=True)[6:14]) / (2 * np.pi)
    body, EI = mb.ReducedBody.free_interface(M, K, nodes, ENDS, modes), 2.1e11 * SECOND
    assert "free; with these static deformations are complete" in body.summary
    np.testing.assert_allclose(body.frequencies[: min(modes, 8)], whole[: min(modes, 8)], rtol=1e-9)
    for load, gravity, want in ((1e-3 * EI, 0.0, 1e-3 / 3), (0.0, 1e-3, -1e-3 * PER_LENGTH / (8 * EI))):
        s = mb.Scene("cantilever", gravity=(0, -gravity, 0))
        s.reduced_body("beam", body)
        s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
        s.force("F", "beam.tip", (0, load, 0))
        assert s.equilibrium()["beam.tip"].position[0, 1] == pytest.approx(want, rel=1e-7)


def test_free_modes_of_many_freedoms_are_those_of_few_and_are_as_many_as_loads_need() -> None:
    """Above DENSE freedoms the modes come by Lanczos' method; below up_to over the root of accuracy lie 316 Hz."""
    found = {n: mb.ReducedBody.free_interface(*beam_matrices(n), {"root": [0], "tip": [n]}, up_to=10.0) for n in (20, 80)}
    assert [len(body.held_frequencies) for body in found.values()] == [4, 4]
    np.testing.assert_allclose(*(body.held_frequencies for body in found.values()), rtol=1e-4)
    with pytest.raises(mb.OptionError, match="up_to="):
        mb.ReducedBody.free_interface(*beam_matrices(10), ENDS)


@cache
def frame_of_beams(load: float) -> tuple[Any, Any]:
    """Displacement (2,) of the end of an L of beams under a force along y, m, and its two lowest frequencies, Hz."""
    EI, rotary = 2.1e11 * SECOND, DENSITY * SECOND
    s = mb.Scene("frame")
    s.beam("frame", (0, 0, 0), (0.6, 0, 0), (0.6, 0.4, 0), elements=[3, 3], section=mb.Section(
        2.1e11 * AREA, 1e10, 1e10, 8e10 * 2 * SECOND, EI, EI, PER_LENGTH, (2 * rotary, rotary, rotary)))
    s.weld("wall", s.ground, "frame", at=(0, 0, 0))
    s.force("F", "frame", (0, load, 0), at=(0.6, 0.4, 0))
    e = s.equilibrium()
    return e["frame.at(1.0)"].position[0, :2] - (0.6, 0.4), s.linearize(at=e, count=3).frequencies[:2]


def frame(n: int, legs: tuple[float, float] = (0.6, 0.4)) -> Any:
    """M, K and nodes of a beam along x that goes on along y."""
    turn = np.kron(np.eye(2 * n + 2), [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    M, K = np.zeros((12 * n + 6, 12 * n + 6)), np.zeros((12 * n + 6, 12 * n + 6))
    for at, length, R in zip((slice(0, 6 * n + 6), slice(6 * n, None)), legs, (np.eye(6 * n + 6), turn), strict=True):
        m, k, _ = beam_matrices(n, length=length)
        M[at, at] += R @ m @ R.T
        K[at, at] += R @ k @ R.T
    x, y = (np.linspace(0, length, n + 1) for length in legs)
    return M, K, np.vstack([np.column_stack([x, 0 * x, 0 * x]), np.column_stack([0 * y + legs[0], y, 0 * y])[1:]])


@pytest.mark.parametrize(("kind", "modes"), [("craig_bampton", 2), ("free_interface", 2), *(
    pytest.param(kind, 10, marks=pytest.mark.slow) for kind in ("craig_bampton", "free_interface"))])
def test_a_bent_frame_softens_under_a_load_as_beams_do_whatever_modes_show_it(kind: str, modes: int) -> None:
    """Deflection and lowest frequencies of an L; by the stiffness of modes alone they came out up to 24 % wrong."""
    EI = 2.1e11 * SECOND
    s = mb.Scene("frame")
    s.reduced_body("frame", getattr(mb.ReducedBody, kind)(*frame(5), {"root": [0], "tip": [10]}, modes=modes, stiffening=True))
    s.weld("wall", s.ground, "frame.root", at=(0, 0, 0))
    s.force("F", "frame.tip", (0, -0.16 * EI, 0))
    e = s.equilibrium()
    bent, frequencies = frame_of_beams(-0.16 * EI)
    np.testing.assert_allclose(e["frame.tip"].position[0, :2] - (0.6, 0.4), bent, rtol=3e-3)
    found = s.linearize(at=e).frequencies  # those out of its plane too
    assert [np.min(np.abs(found / f - 1)) < 3e-3 for f in frequencies] == [True, True], (found[:6], frequencies)


def test_the_error_of_free_modes_is_measured_too() -> None:
    s = mb.Scene("thrown", gravity=(0, -9.81, 0))
    body = mb.ReducedBody.free_interface(*beam_matrices(6, 2e9), {"root": [0], "tip": [6]}, 0)
    s.reduced_body("beam", body, damping=0.02)
    s.force("F", "beam.tip", (0, 5 * sympy.sin(200 * mb.t), 0))
    r = s.simulate(0.02, 1e-4, verify=True)
    assert r.accuracy.mesh is not None
    assert 0 < r.accuracy.mesh < 1e-2


def test_a_loop_through_an_elastic_body_closes_from_interface_to_interface_and_a_pendulum_closes_none() -> None:
    """Singular positions are looked for in loops alone; the modes of a body connect nothing."""
    from mbdae.run.assessment import _loops

    def hung(slider: bool) -> mb.Scene:
        s = mb.Scene("crank" if slider else "pendulum", gravity=(0, -9.81, 0))
        s.reduced_body("rod", reduced(1))
        s.revolute("hinge", s.ground, "rod.root", at=(0, 0, 0), axis=(0, 0, 1))
        if slider:
            block = s.rigid_body("block", 1.0, (0.1, 0.1, 0.1), at=(1, 0, 0))
            s.revolute("pin", "rod.tip", block, at=(1, 0, 0), axis=(0, 0, 1))
            s.prismatic("guide", s.ground, block, at=(1, 0, 0), axis=(1, 0, 0))
        return s

    for slider in (False, True):
        found = _loops(hung(slider).simulate(1e-3, 1e-3))
        assert len(found) == slider, found


def test_a_pull_between_two_times_of_the_result_is_told() -> None:
    """Forces at interfaces are looked at in the steps of the run, not where the result shows it."""
    s = mb.Scene("column")
    s.reduced_body("beam", reduced(1), damping=0.1)
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", (-200 * sympy.exp(-(((mb.t - 0.05) / 5e-3) ** 2)), 0, 0))
    with pytest.warns(mb.AccuracyWarning, match="pulls or presses at its interface"):
        assert len(s.simulate(0.1, 1e-3, outputs=2).t) == 2


def test_pictures_show_the_deformed_mesh_and_nothing_that_is_no_part_of_the_machine() -> None:
    from mbdae.show.shapes import geometry

    s = mb.Scene("cantilever")
    s.reduced_body("beam", reduced(2, 2e9))
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", (0, 2.0, 0))
    r = s.simulate(0.05, 1e-4)
    seen = geometry(r)
    lines = [o.points for o in seen.shapes if o.item == "beam"]
    assert [line.shape for line in lines] == [(len(r.t), 11, 3)]
    ends = np.stack([r["beam.root"].position, r["beam.tip"].position], axis=1)
    np.testing.assert_allclose(lines[0][:, [0, -1]], ends, atol=1e-9)
    assert np.ptp(lines[0][:, -1, 1]) > 1e-3
    drawn = {o.item for o in seen.shapes} | {label.text for label in seen.labels}
    assert not [name for name in drawn if "inertia" in name or "rows" in name or "modes" in name]


def test_lines_of_a_drawing_pass_every_edge_once() -> None:
    from mbdae.show.geometry import _trails

    edges = np.array([(i, j) for i in range(6) for j in range(i)])
    passed = [tuple(sorted(pair)) for trail in _trails(edges) for pair in pairwise(trail)]
    assert sorted(passed) == sorted(tuple(sorted(pair)) for pair in edges.tolist())


def test_peaks_at_nodes_contain_the_error_of_the_modes_and_other_bodies_are_refused() -> None:
    """Displacement and von Mises stress at nodes between the interfaces, against a body with nearly all modes."""
    M, K, nodes = beam_matrices(6)

    def run(modes: int, accuracy: float, verify: bool) -> list[Any]:
        def stress(u: Any) -> Any:
            bent = np.gradient(np.reshape(u, (-1, 6))[:, 5], nodes[:, 0])
            return 2.1e9 * bent[:, None] * np.eye(6)[0]

        body = mb.ReducedBody.craig_bampton(M, K, nodes, {"root": [0], "tip": [6]}, modes, stress=stress)
        s = mb.Scene("shaken")
        s.reduced_body("beam", body, damping=0.05)
        s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
        s.force("F", "beam.tip", (0, 20.0 * sympy.sin(300 * mb.t), 0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mb.AccuracyWarning)
            r = s.simulate(0.01, accuracy, verify=verify)
            with pytest.raises(mb.OptionError, match="body with other nodes"):
                reduced(0).displacement(r["beam.modes"])
            return [r.peak(lambda r: body.von_mises(r["beam.modes"])[:, 2]),
                    r.peak(lambda r: body.displacement(r["beam.modes"])[:, 3, :3])]

    for told, true in zip(run(0, 1e-4, True), run(20, 1e-5, False), strict=True):
        off = abs(told.value - true.value)
        assert off > 1e-3 * true.value
        assert told.error is not None
        assert off / 3 < told.error < 10 * off


def test_a_page_shows_every_mode_how_it_moves_and_why_there_are_so_many() -> None:
    """The first bent mode is drawn as its shape says; nodes of a beam that twists stay and turn; a rigid body has no picture."""
    body = reduced(6)
    page = mb.report(body)
    html = page.to_html()
    assert all(f"mode {i + 1}: {f:.4g} Hz" in html for i, f in enumerate(body.frequencies))
    (table, picture) = (block for block in page.blocks if isinstance(block, Table | Picture))
    assert [row[2] for row in table.rows].count("turns about x") == 1
    assert [row[2] for row in table.rows].count("100 / 0 / 0") == 1
    assert f"{100 * body.left_out:.3g} % of the elastic energy" in page.blocks[0].text
    lines = [mark[1] for mark in picture.content.marks if mark[0] == "line" and len(mark[1]) == 2]
    count = len(body.edges)
    rest, bent = (np.array(lines[k * count : (k + 1) * count]) for k in (0, 1))
    shape = body.shapes[body.edges.astype(int), :3, 0] @ VIEW.T
    drawn = bent - rest
    np.testing.assert_allclose(drawn / np.max(np.abs(drawn)), shape / np.max(np.abs(shape)), atol=1e-9)
    free = next(block for block in mb.report(mb.ReducedBody.free_interface(*beam_matrices(10), ENDS, 4)).blocks
                if isinstance(block, Table))
    assert [row[1].endswith("*") for row in free.rows] == [False] * 4 + [True] * 12  # the others are none of the body's own
    assert not any(row[1].endswith("*") for row in table.rows)
    alone = mb.ReducedBody.craig_bampton(*beam_matrices(2), {"whole": [0, 1, 2]}, 0)
    assert not any(isinstance(block, Picture) for block in mb.report(alone).blocks)
    with pytest.raises(mb.OptionError, match="takes no options"):
        mb.report(body, kept=True)


def test_a_peak_that_the_modes_leave_wrong_asks_for_more_modes() -> None:
    """The motion is within the accuracy, as it is over the beam's length; nearly the whole error of the deflection is that of
    the modes, and a smaller accuracy would leave it."""
    s = mb.Scene("struck")
    s.reduced_body("beam", reduced(0), damping=0.05)
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", (0, 20.0 * sympy.sin(300 * mb.t), 0))
    r = s.simulate(0.01, accuracy=1e-3, verify=True)

    def deflection(r: Any) -> Any:
        return r["beam.tip"].position[:, 1]

    with pytest.warns(mb.AccuracyWarning, match="deflection has an error .* reduced bodies more modes$"):
        peak = r.peak(deflection)
    estimate = r.accuracy.errors.of_peak(r, deflection, peak.value, peak.t)
    assert 0.9 * peak.error < estimate.mesh <= peak.error
    assert r.accuracy.met


@pytest.mark.parametrize(("damping", "resisted"), [(0.0, 0.0), (0.02, 0.0), (0.02, 5.0)])
def test_shifts_of_a_free_body_spoil_no_root_of_its_vibrations(damping: float, resisted: float) -> None:
    """Two roots 0 for every shift; along the axis a damper leaves one of them, and -c/m, but for what the body is elastic."""
    s, body = mb.Scene("free", gravity=(0, 0, 0)), reduced(8)
    s.reduced_body("beam", body, damping=damping)
    if resisted:
        s.bushing("resisted", s.ground, "beam.root", at=(0, 0, 0), stiffness=(0, 0, 0), damping=(resisted, 0, 0))
    found = s.linearize()
    shifts = np.abs(found.eigenvalues) < 10
    assert np.sum(shifts) == 12
    assert found.stable
    np.testing.assert_allclose(np.min(found.eigenvalues[shifts].real), -resisted / body.mass, rtol=1e-6, atol=0)
    assert np.all(found.errors < 1e-7 * np.where(shifts, 1, np.abs(found.eigenvalues)))
    np.testing.assert_allclose(np.abs(found.eigenvalues[~shifts])[:8], 2 * np.pi * body.frequencies[:8], rtol=1e-9)
    np.testing.assert_allclose(found.damping[~shifts][:8], damping, atol=1e-9)


def test_a_state_of_reduced_bodies_alone_is_compared_with_more_modes() -> None:
    s = mb.Scene("held")
    s.reduced_body("beam", reduced(0))
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    assert s.equilibrium().accuracy.unknown["mesh"] == "not measured: compare with more modes of reduced bodies"


def test_an_interface_is_given_by_numbers_or_by_a_mask_of_all_nodes() -> None:
    M, K, nodes = beam_matrices(4)
    for mask in (nodes[:, 0] == 0, (nodes[:, 0] == 0).tolist()):
        body = mb.ReducedBody.craig_bampton(M, K, nodes, {"root": mask}, 2)
        np.testing.assert_array_equal(body.interfaces["root"], nodes[0])


def test_a_recursive_scene_is_not_told_to_be_made_recursive() -> None:
    s = mb.Scene("held")
    s.reduced_body("beam", reduced(0))
    s.revolute("hinge", s.ground, "beam.root", at=(0, 0, 0), axis=(0, 0, 1))
    with pytest.raises(mb.OptionError, match=r"use mb.GGL\(\), or s.recursive\(\)"):
        s.simulate(0.01, form=mb.ODE())
    with pytest.raises(mb.OptionError, match=r"use mb.GGL\(\)$"):
        s.recursive().simulate(0.01, form=mb.ODE())


def test_a_page_shows_no_round_off_as_a_place() -> None:
    M, K, nodes = beam_matrices(4)
    body = mb.ReducedBody.craig_bampton(M, K, nodes + np.array([0.0, -5.6e-19, 0.0]), {"root": [0], "tip": [4]}, 0)
    assert "e-19" not in mb.report(body).to_markdown()


def lattice() -> tuple[Any, Any, Any, Any]:
    """M, K and nodes of springs between all nodes of two cubes, and their force of the second order."""
    nodes = np.array([(x, y, z) for x in range(3) for y in range(2) for z in range(2)], dtype=float)
    i, k = np.triu_indices(len(nodes), 1)
    along = nodes[k] - nodes[i]
    length = np.linalg.norm(along, axis=1)
    n = along / length[:, None]

    def summed(f: Any) -> Any:
        total = np.zeros(nodes.shape)
        np.add.at(total, k, f)
        np.add.at(total, i, -f)
        return total.ravel()

    def apart(u: Any) -> tuple[Any, Any, Any]:
        d = u.reshape(-1, 3)
        d = d[k] - d[i]
        stretch = np.sum(n * d, axis=1)[:, None]
        return d, stretch, d - n * stretch

    def second(u: Any, v: Any) -> Any:
        (d, stretch, across), (_, other, beside) = apart(u), apart(v)
        return summed(1e6 / length[:, None] * (stretch * beside + other * across + n * np.sum(d * beside, axis=1)[:, None]))

    K = np.array([summed(1e6 * n * apart(e)[1]) for e in np.eye(nodes.size)]).T
    return np.eye(nodes.size), K, nodes, second


@pytest.mark.parametrize(("wrong", "words"), [
    (None, ""), (lambda f, K: lambda u, v: -f(u, v), "another sign or factor"),
    (lambda f, K: lambda u, v: 2 * f(u, v), "another sign or factor"), (lambda f, K: lambda u, v: 0 * u, "not that of K"),
    (lambda f, K: lambda u, v: K @ v, "not symmetric"), (lambda f, K: lambda u, v: 1e6 * u, "not symmetric"),
    (lambda f, K: lambda u, v: f(u, v) + 1e6 * u * v * abs(u * v).sum(), "not linear"),
])
def test_a_force_of_the_second_order_is_that_of_the_matrix(wrong: Any, words: str) -> None:
    M, K, nodes, second = lattice()

    def made(force: Any) -> Any:
        return mb.ReducedBody.craig_bampton(M, K, nodes, {"a": [0, 1, 2, 3], "b": [8, 9, 10, 11]}, 2, stiffening=force)

    if wrong is None:
        assert len(made(second).bends)
    else:
        with pytest.raises(mb.OptionError, match=words):
            made(wrong(second, K))
