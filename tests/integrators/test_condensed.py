"""The condensed iteration matrix solves what the dense one solves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from beam_scenes import slider_crank, steel_pendulum, steel_rod

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.integrators.matrices import condensed as module
from mbdae.integrators.matrices.condensed import CondensedMatrix, plan_of
from mbdae.integrators.matrices.factors import DenseMatrix, iteration_matrix
from mbdae.integrators.runge_kutta.tables import radau_table
from mbdae.system.prepare import prepare

TABLE = radau_table(3)


def spatial_rod(section: Any = None) -> mb.Scene:
    s = mb.Scene("rod", gravity=(0, -9.81, 0), space="spatial")
    s.revolute("A", s.ground, s.beam("rod", (0, 0), (1, 0), section=section or steel_rod(), elements=6, order=1), at=(0, 0))
    return s


def matrices(scene: mb.Scene, h: float) -> tuple[Any, Any]:
    """The condensed and the dense matrix at the start, with all velocities doubled."""
    system = system_for(prepare(scene), None, 3)
    both = iteration_matrix(system, TABLE.real, TABLE.pairs), DenseMatrix(system, TABLE.real, TABLE.pairs)
    for matrix in both:
        parts = system.jacobian_values(0.0, system.y0, 2 * system.yp0)
        dense = np.zeros((2, system.n, system.n))
        at = system.pattern.indices, np.repeat(np.arange(system.n), np.diff(system.pattern.indptr))
        dense[0][at], dense[1][at] = parts
        matrix._fy, matrix._fyp = parts if isinstance(matrix, CondensedMatrix) else dense
        matrix.factor(h)
    return both


@pytest.mark.parametrize("h", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("make", [lambda: slider_crank(8, 1), lambda: slider_crank(8, 2), spatial_rod])
@pytest.mark.parametrize("product", [module.product, module.checked_product], ids=["fast", "public"])
def test_solutions_are_those_of_the_dense_matrix(make: Any, h: float, product: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "product", product)
    condensed, dense = matrices(make(), h)
    assert isinstance(condensed, CondensedMatrix)
    assert condensed._plan is not None
    assert condensed.row == pytest.approx(dense.row, rel=1e-12)
    b = np.random.default_rng(1).normal(size=condensed.system.n)
    for solved, exact in (
        (condensed.solve_real(0, b.copy()), dense.solve_real(0, b.copy())),
        (condensed.solve_pair(0, b * (1 + 2j)), dense.solve_pair(0, b * (1 + 2j))),
    ):
        assert np.abs(solved - exact).max() < 1e-6 * np.abs(exact).max()
    assert condensed.mass(b) == pytest.approx(dense.mass(b), rel=1e-12, abs=1e-12)
    assert condensed.magnitudes(b, b) == pytest.approx(dense.magnitudes(b, b), rel=1e-12, abs=1e-12)


def test_both_jacobian_parts_are_the_same_dense_and_by_entries() -> None:
    system = system_for(prepare(slider_crank(8, 1)), None, 3)
    assert system.sparsity is None
    at = system.pattern.indices, np.repeat(np.arange(system.n), np.diff(system.pattern.indptr))
    y, yp = system.y0, system.yp0
    values, parts = system.jacobian_values(0.0, y, yp), system.jacobian_parts(0.0, y, yp)
    for data, dense in zip(values, parts, strict=True):
        assert np.array_equal(dense[at], data)
        assert np.count_nonzero(dense) == np.count_nonzero(data)
    whole = np.ones((system.n, system.n))
    system.jacobian(0.0, y, yp, 7.0, whole)
    assert whole == pytest.approx(parts[0] + 7 * parts[1])


def test_a_rigid_strain_is_no_pivot() -> None:
    """Its compliance is 0: the whole matrix is factorised instead, and the solver does not notice."""
    section = replace(steel_rod(), EA=1e20, GA2=1e20, GA3=1e20)
    condensed, dense = matrices(spatial_rod(section), 1e-3)
    assert condensed._plan is None
    b = np.random.default_rng(1).normal(size=condensed.system.n)
    assert condensed.solve_real(0, b.copy()) == pytest.approx(dense.solve_real(0, b.copy()), rel=1e-6)


def test_few_unknowns_are_not_condensed() -> None:
    assert plan_of(system_for(prepare(steel_pendulum(20, elements=1, order=1)), None, 3)) is None
