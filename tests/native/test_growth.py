"""Looks for growth in C: roots and disturbances at a state, and disturbances carried along a run, beside dense linear algebra."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from scipy.sparse import csc_matrix

import mbdae as mb
from mbdae.integrators import radau_table
from mbdae.run import amplification, growth_roots
from mbdae.run.amplification import Disturbances
from mbdae.run.growth_roots import Looks, positions, roots_at


def linkage() -> Any:
    """Three rods that are hinged to each other and to the ground, in a plane."""
    s = mb.Scene("linkage", gravity=(0, -9.81, 0))
    crank, coupler, rocker = (s.link(name, a, b, mass=1.0) for name, a, b in (
        ("crank", (0, 0), (0, 0.3)), ("coupler", (0, 0.3), (0.9, 0.7)), ("rocker", (0.9, 0.7), (0.8, 0))))
    for name, k, l, at in (("A", s.ground, crank, (0, 0)), ("B", crank, coupler, (0, 0.3)), ("C", coupler, rocker, (0.9, 0.7)),
                           ("D", s.ground, rocker, (0.8, 0))):
        s.revolute(name, k, l, at=at, **({"rate0": 3.0} if name == "A" else {}))
    return s


def flying() -> Any:
    """A body in space that turns about its middle axis and is pushed along an axis of its own: nothing depends on its place."""
    s = mb.Scene("flying", gravity=(0, 0, -9.81))
    body = s.rigid_body("free", 1.0, (0.1, 0.2, 0.3), at=(0, 0, 2), velocity=(1, 0, 0), angular_velocity=(1e-5, 4, 2e-5))
    s.force("thrust", body, (0, 30, 0), frame="body")
    return s


def tree() -> Any:
    """Rods that stand on each other."""
    s, below = mb.Scene("tree", gravity=(0, 0, -9.81)), None
    for i in range(3):
        rod = s.rigid_body(f"rod {i}", 1.0, (0.1, 0.1, 0.01), at=(0, 0, i + 0.5))
        s.revolute(f"J{i}", s.ground if below is None else below, rod, at=(0, 0, i), axis=(1, i % 2, 0), angle0=1e-6 * (i + 1),
                   spring=4.0)
        below = rod
    return s


def column() -> Any:
    """An elastic column that its load buckles."""
    s = mb.Scene("column", gravity=(0, 0, 0))
    beam = s.beam("beam", (0, 0), (0, 1), section=mb.Section.tube(0.01, 0.008, E=210e9, nu=0.3, rho=7850.0), elements=2)
    s.weld("root", s.ground, beam, at=(0, 0))
    s.force("load", beam, (1e-3, -3000.0, 0), at=(0, 1))
    return s


CASES: dict[str, Any] = {"linkage": (linkage, {"solver": mb.DOP853()}), "flying": (flying, {}), "column": (column, {}),
                         "linkage, GGL": (linkage, {"solver": mb.RadauIIA(3), "form": mb.GGL()}),
                         "tree": (tree, {"solver": mb.DOP853()})}


def looks_of(name: str) -> tuple[Looks, Any]:
    """Six states of a run."""
    scene, options = CASES[name]
    run = scene().simulate(4.0 if name == "tree" else 0.2, accuracy=1e-4, **options).solution
    system, steps = run.systems[0][1], np.linspace(1, len(run.t) - 2, 6).astype(int)
    h = run.t[steps + 1] - run.t[steps]
    return Looks([system] * 6, run.t[steps], run.y[steps], run.yp[steps], h, float(run.t[-1])), run


def dense(looks: Looks, i: int) -> tuple[Any, Any, Any]:
    """Roots of look i that are near its step, with right and left eigenvectors over the scales of the unknowns, one a column."""
    system, h = looks.systems[i], looks.h[i] / growth_roots.SHIFT
    A, E = (part * system.scale for part in system.dense_parts(looks.t[i], looks.y[i], looks.yp[i]))
    size = np.abs(E + h * A).max(axis=1, keepdims=True)
    S = np.linalg.solve((E + h * A) / size, E / size)
    value, left, right = scipy.linalg.eig(S, left=True)
    near = np.abs(value) * growth_roots.RESOLVED > 1
    return (1 - 1 / value[near]) / h, right[:, near], left[:, near].conj()


@pytest.mark.parametrize("name", list(CASES))
def test_rates_are_those_of_dense_equations(name: str) -> None:
    looks, _ = looks_of(name)
    found = roots_at(looks).rates
    known = [max(float(np.max(dense(looks, i)[0].real)), 0.0) for i in range(6)]
    np.testing.assert_allclose(found, known, rtol=1e-6, atol=1e-3 / looks.span)
    assert max(found) > 0


@pytest.mark.parametrize("name", list(CASES))
def test_disturbances_are_those_of_dense_equations(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of all roots that grow by more than a tenth: their shares of the motion, also in positions on which nothing depends."""
    monkeypatch.setattr(growth_roots, "HARMLESS", 0.1)
    looks, _ = looks_of(name)
    seen = 0
    for i, one in enumerate(roots_at(looks).found(np.inf)):
        system = looks.systems[i]
        here, motion = positions(system), looks.yp[i] / system.scale
        roots, right, left = dense(looks, i)
        apart = np.array([np.min(np.abs(np.delete(roots, j) - root)) > 1e-3 * abs(root) for j, root in enumerate(roots)])
        some = apart & (roots.real * looks.span > 0.1 * (1 + 1e-6))  # of equal roots only the sum of the shares is known
        roots, right, left = roots[some], right[:, some], left[:, some]
        apiece = right[here] / np.sum(left * right, axis=0) / np.abs(roots)
        known, rounded = apiece * (left.T @ motion), 1e-10 * np.abs(apiece).max(axis=0) * (np.abs(left.T) @ np.abs(motion))
        for j, root in enumerate(roots):
            at = int(np.argmin(np.abs(one.roots - root)))
            assert abs(one.roots[at] - root) < 1e-6 * abs(root)
            np.testing.assert_allclose(one.parts[:, at], known[:, j], rtol=0, atol=1e-6 * np.max(np.abs(known)) + rounded[j])
            seen += 1
    assert seen > 2


def test_equations_that_are_singular_have_no_roots() -> None:
    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        out[:] = yp[0] - y[0], y[1] * 0.0

    dae = mb.DAE(residual, [1.0, 0.0], [1.0, 0.0])
    two = np.ones((2, 2))
    looks = Looks([dae] * 2, np.zeros(2), two, two, np.full(2, 0.1), 10.0)
    assert not roots_at(looks).rates.any()


def test_an_unknown_whose_rate_stands_in_two_equations_takes_none() -> None:
    """x1, on which nothing depends, has its rate in the equation of x2 too: x2' = x2 - x3 grows."""
    def residual(t: float, y: Any, yp: Any, out: Any) -> None:
        out[:] = yp[0] + yp[1] - y[2], yp[0] + 2 * yp[1] - y[1], yp[2] + y[2]

    dae = mb.DAE(residual, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    still = np.zeros((1, 3))
    found = roots_at(Looks([dae], np.zeros(1), still, still, np.full(1, 0.1), 10.0)).rates
    assert found[0] == pytest.approx(1.0, rel=1e-6)


def test_own_equations_with_a_pattern() -> None:
    """A chain of growing unknowns, each with its own Jacobian entries by columns."""
    n = 12
    J = np.diag(np.linspace(-1, 2, n)) + np.diag(np.ones(n - 1), 1)
    pattern = csc_matrix(np.eye(n) + np.abs(J))

    def jacobian(t: float, y: Any, yp: Any, cj: float, out: Any) -> None:
        out[:] = (cj * np.eye(n) - J)[pattern.indices, np.repeat(np.arange(n), np.diff(pattern.indptr))]

    dae = mb.DAE(lambda t, y, yp, out: np.subtract(yp, J @ y, out=out), np.zeros(n), np.zeros(n), jacobian=jacobian,
                 sparsity=pattern)
    still = np.zeros((3, n))
    found = roots_at(Looks([dae] * 3, np.zeros(3), still, still, np.array([0.1, 0.2, 0.3]), 10.0)).rates
    np.testing.assert_allclose(found, 2.0, rtol=1e-6)


@pytest.mark.parametrize("stages", [1, 3])
def test_a_piece_is_carried_as_radau_does(stages: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(amplification, "STAGED", 24 if stages > 1 else 0)
    J, h = np.array([[0.0, 1.0], [2.0, -0.3]]), 0.6
    dae = mb.DAE(lambda t, y, yp, out: np.subtract(yp, J @ y, out=out), [0.0, 0.0], [0.0, 0.0])
    carrier = amplification.Carrier(dae, dae, np.zeros(2, dtype=int))
    x = np.array([[1.0, 0.0], [0.0, 1.0]])
    values = dae.linear_stages(np.zeros(stages), np.zeros((stages, 2)), np.zeros((stages, 2)))[1:]
    count, ended, (found, size, _) = carrier.carry((x, 0.0, np.inf), np.inf, np.array([h]), list(values), np.empty((1, 2)))
    assert (count, ended) == (1, False)
    table = radau_table(3)
    rates = np.linalg.solve(np.eye(6) - np.kron(h * table.A, J), np.tile(J, (3, 1)))
    np.testing.assert_allclose(found * np.exp(size), np.eye(2) + h * np.kron(table.b, np.eye(2)) @ rates, rtol=1e-9)


@pytest.mark.parametrize("staged", [0, 100])
def test_carried_disturbances_grow_as_the_equations_do(staged: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With equations at all stages, and with those in the middle: rods that hardly move have one matrix all the way."""
    monkeypatch.setattr(amplification, "STAGED", staged)
    monkeypatch.setattr(amplification, "LARGEST_KEPT", 0)
    run = tree().simulate(4.0, accuracy=1e-4, solver=mb.DOP853()).solution
    system = run.systems[0][1]
    t, size = Disturbances(system, run).course() or (np.zeros(2), np.zeros(2))
    looks = Looks([system], run.t[1:2], run.y[1:2], run.yp[1:2], run.t[2:3] - run.t[1:2], 4.0)
    rate, half = float(np.max(dense(looks, 0)[0].real)), len(t) // 2
    assert (size[-1] - size[half]) / (t[-1] - t[half]) == pytest.approx(rate, rel=0.01)


def test_threads_that_ask_about_one_scene_wait_for_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each waits a little before C is called, after its disturbances are put where C reads them."""
    run = linkage().simulate(0.5, accuracy=1e-4, solver=mb.DOP853()).solution
    asked = Disturbances(run.systems[0][1], run)
    known, carry = asked.growth(), amplification.carrying().stages_carry
    monkeypatch.setattr(amplification, "carrying", lambda: SimpleNamespace(
        stages_carry=lambda *args: (time.sleep(2e-3), carry(*args))[1]))
    with ThreadPoolExecutor(4) as threads:
        assert set(threads.map(lambda _: asked.growth(), range(8))) == {known}
