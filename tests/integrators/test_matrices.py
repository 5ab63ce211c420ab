"""Iteration matrices of scenes: their factors solve what those of LAPACK solve."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from beam_scenes import slider_crank, steel_rod

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.integrators import radau_table
from mbdae.integrators.matrices import IterationMatrix
from mbdae.system.prepare import prepare

TABLE = radau_table(3)


def spatial_rod(section: Any = None) -> mb.Scene:
    s = mb.Scene("rod", gravity=(0, -9.81, 0), space="spatial")
    s.revolute("A", s.ground, s.beam("rod", (0, 0), (1, 0), section=section or steel_rod(), elements=6, order=1), at=(0, 0))
    return s


def four_bar() -> mb.Scene:
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    points = [(0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)]
    links = [s.link(name, a, b, mass=0.5) for name, a, b in zip("abc", points, points[1:], strict=False)]
    for name, k, l, at in zip("ABCD", [s.ground, *links], [*links, s.ground], points, strict=True):
        s.revolute(name, k, l, at=at)
    return s


@pytest.mark.parametrize("h", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("form", [None, mb.GGL(), mb.Index3()], ids=["chosen", "GGL", "Index3"])
@pytest.mark.parametrize("make", [lambda: slider_crank(8, 1), lambda: slider_crank(8, 2), spatial_rod, four_bar,
                                  lambda: spatial_rod(replace(steel_rod(), EA=1e20, GA2=1e20, GA3=1e20))])
def test_solutions_are_those_of_a_dense_matrix(make: Any, form: Any, h: float) -> None:
    """With the speeds of the start doubled; in the last scene strains are rigid, so that no stress can be the first pivot."""
    system = system_for(prepare(make()), form, 3)
    matrix = IterationMatrix(system, TABLE.real, TABLE.pairs)
    matrix.refresh(0.0, system.y0, 2 * system.yp0)
    matrix.factor(h)
    dense = np.zeros((2, system.n, system.n))
    at = system.pattern.indices, np.repeat(np.arange(system.n), np.diff(system.pattern.indptr))
    dense[0][at], dense[1][at] = system.jacobian_values(0.0, system.y0, 2 * system.yp0)
    column = system.scale * h ** (1.0 - np.asarray(system.index))
    fy, fyp = dense[0] * column, dense[1] * column / h
    row = 1 / (np.abs(fy) + np.abs(fyp)).max(axis=1)
    assert matrix.row == pytest.approx(row, rel=1e-12)
    b = np.random.default_rng(1).normal(size=system.n)
    for factors, value, right in zip(matrix.factors, (TABLE.real[0], TABLE.pairs[0]), (b, b * (1 + 2j)), strict=True):
        exact = np.linalg.solve((fy + value * fyp) * row[:, None], right)
        assert np.abs(factors.solve(right) - exact).max() < 1e-6 * np.abs(exact).max()
    assert matrix.entries.matrix(matrix.fyp) @ b == pytest.approx(dense[1] @ b, rel=1e-12, abs=1e-12 * np.abs(dense[1]).max())
    terms = np.finfo(float).eps * (np.abs(dense[0]) @ np.abs(b) + np.abs(dense[1]) @ np.abs(b)) * row
    first = (fy + TABLE.real[0] * fyp) * row[:, None]
    signs = np.where(np.arange(system.n) % 2, -1.0, 1.0)
    noise = np.max([np.abs(np.linalg.solve(first, terms * sign)) for sign in (1.0, signs)], axis=0) * column
    assert matrix.noise(b, b) == pytest.approx(noise, rel=1e-5, abs=1e-6 * noise.max())


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
