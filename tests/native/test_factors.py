"""LU factors in a fixed pattern against NumPy, and tables that do not fit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from mbdae.integrators.matrices import searches
from mbdae.native import MANY, Entries, Order, Orders, by_counts, largest_pivots
from mbdae.native.sparse import Factors, Matrix, SingularMatrixError

RNG = np.random.default_rng


def pattern(n: int, density: float, rng: Any) -> Entries:
    """Some entries, and those of a permutation: the matrix is not singular by its pattern."""
    found = sp.random(n, n, density, random_state=rng, format="coo")
    rows, columns = np.concatenate([found.row, rng.permutation(n)]), np.concatenate([found.col, np.arange(n)])
    ones = sp.csc_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    ones.sort_indices()
    return Entries(n, ones.indptr, ones.indices)


def values(entries: Entries, kind: Any, rng: Any) -> Any:
    found = rng.normal(size=entries.nnz)
    return found + 1j * rng.normal(size=entries.nnz) if kind is complex else found


def factorised(entries: Entries, a: Any, kind: Any, sought: Any = None) -> Factors:
    factors = Factors(Orders(entries, searches(()) if sought is None else sought), kind)
    factors.values[:] = a
    factors.factor()
    return factors


def defect(factors: Factors, rng: Any) -> float:
    """Largest residual of a solution beside the terms of its row."""
    A = factors.orders.entries.matrix(factors.values)
    b = rng.normal(size=A.shape[0])
    x = factors.solve(b)
    return float(np.max(np.abs(A @ x - b) / (abs(A) @ np.abs(x) + np.abs(b))))


@pytest.mark.parametrize("kind", [float, complex])
@pytest.mark.parametrize("density", [0.0, 0.02, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("n", [1, 2, 5, 30, 130])
def test_solutions_are_those_of_numpy(n: int, density: float, kind: Any) -> None:
    rng = RNG(n)
    for _ in range(3):
        entries = pattern(n, density, rng)
        a = values(entries, kind, rng)
        factors = factorised(entries, a, kind)
        assert defect(factors, rng) < 1e-11
        b = rng.normal(size=n)
        dense = entries.matrix(a).toarray()
        exact = np.linalg.solve(dense, b)
        assert np.abs(factors.solve(b) - exact).max() <= 1e-13 * np.linalg.cond(dense) * np.abs(exact).max() + 1e-13


@pytest.mark.parametrize("kind", [float, complex])
def test_dense_factors_without_a_search(kind: Any) -> None:
    rng = RNG(3)
    factors = factorised(Entries.full(40), values(Entries.full(40), kind, rng), kind, ())
    assert not factors.table.order
    assert defect(factors, rng) < 1e-13


@pytest.mark.parametrize("kind", [float, complex])
@pytest.mark.parametrize("small", [0.0, 1e-12, 1e-7])
def test_an_order_whose_pivots_became_small_is_replaced(small: float, kind: Any) -> None:
    """Random magnitudes over many decades, another time than the order was found for; or the solution keeps its digits in it."""
    rng = RNG(5)
    for _ in range(100):
        entries = pattern(40, 0.1, rng)
        factors = factorised(entries, values(entries, kind, rng), kind)
        shrunk = values(entries, kind, rng) * np.where(rng.random(entries.nnz) < 0.3, max(small, 1e-300), 1.0)
        shrunk /= abs(entries.matrix(shrunk)).max(axis=1).toarray().ravel()[entries.row_of]
        factors.values[:] = shrunk
        dense, b = entries.matrix(shrunk).toarray(), rng.normal(size=40)
        regular = np.linalg.cond(dense) < 1e12
        try:
            factors.factor()
        except SingularMatrixError:
            assert not regular
            continue
        x = factors.solve(b)
        assert not regular or np.abs(dense @ x - b).max() < 1e-9 * (np.abs(x).max() + np.abs(b).max())


def test_orders_are_shared_and_kept() -> None:
    rng = RNG(2)
    entries = pattern(30, 0.1, rng)
    orders = Orders(entries, searches(()))
    first, second = Factors(orders, float), Factors(orders, complex)
    for factors in (first, second, first):
        factors.values[:] = np.linspace(1, 2, entries.nnz) + 10 * (entries.row_of == entries.column_of)
        factors.factor()
    assert first.order is second.order is orders.present


@pytest.mark.parametrize("n", [6, 700])
@pytest.mark.parametrize("kind", [float, complex])
def test_a_singular_matrix_is_refused(kind: Any, n: int) -> None:
    entries = Entries(n, np.arange(n + 1), np.arange(n))
    factors = factorised(entries, np.ones(n), kind)
    factors.values[4] = 0.0
    with pytest.raises(SingularMatrixError) as raised:
        factors.factor()
    assert raised.value.unknown in ((4,) if n == 6 else (4, -1))
    with pytest.raises(ValueError, match="nothing is factorised"):
        factors.solve(np.ones(n))
    factors.values[4] = 1.0
    factors.factor()
    assert factors.solve(np.arange(n)) == pytest.approx(np.arange(n))


@pytest.mark.parametrize("bad", [np.nan, np.inf, complex(0, np.nan)])
def test_what_is_not_finite_is_refused(bad: complex) -> None:
    rng = RNG(0)
    entries = pattern(20, 0.2, rng)
    kind = complex if isinstance(bad, complex) else float
    factors = factorised(entries, values(entries, kind, rng), kind)
    for k in range(0, entries.nnz, 3):
        kept = factors.values[k]
        factors.values[k] = bad
        with pytest.raises(SingularMatrixError):
            factors.factor()
        factors.values[k] = kept


def test_random_tables_are_right_or_refused() -> None:
    """Nothing that is wrong reaches C: not the shape, not the range, not an entry twice, not an order that is no permutation."""
    rng, refused = RNG(1), 0
    for _ in range(400):
        n = int(rng.integers(1, 6))
        good = pattern(n, 0.4, rng)
        indptr, indices, rows = good.indptr.copy(), good.row_of.copy(), rng.permutation(n)
        for array in (indptr, indices, rows):
            if rng.random() < 0.3:
                array[rng.integers(len(array))] += rng.integers(-2, 3)
        if rng.random() < 0.1:
            indices = indices[:-1]
        try:
            entries = Entries(n, indptr, indices)
            Order(entries, rows, rng.permutation(n + (rng.random() < 0.1)))
        except ValueError:
            refused += 1
            continue
        assert entries.matrix(np.ones(entries.nnz)).has_canonical_format or n > 0
        try:
            factors = factorised(entries, values(entries, float, rng), float)
        except SingularMatrixError:
            continue
        assert defect(factors, rng) < 1e-9
    assert 100 < refused < 390


def test_matrices_of_another_size_are_refused() -> None:
    entries = Entries.full(3)
    for scale, power, real, pairs in ((np.ones(2), np.ones(3), [1.0], []), (np.ones(3), np.ones(4), [1.0], []),
                                      (np.ones(3), np.ones(3), [], []), (np.ones(3), np.ones(3), [[1.0]], [])):
        with pytest.raises(ValueError, match=r"powers of the step|eigenvalue lambda"):
            Matrix(entries, scale, power, real, pairs, ())
    matrix = Matrix(entries, np.ones(3), np.zeros(3), [1.0], [1j], ())
    with pytest.raises(ValueError, match="3 unknowns"):
        matrix.noise(np.ones(3), np.ones(2))
    assert not matrix.noise(np.ones(3), np.ones(3)).any()  # nothing is known before it is factorised


def test_fill_is_found_once_for_any_values() -> None:
    """The rows of L + U hold those of a factorisation by hand."""
    rng = RNG(8)
    entries = pattern(25, 0.1, rng)
    rows = columns = rng.permutation(25)
    order = Order(entries, rows, columns)
    filled = entries.matrix(np.ones(entries.nnz)).toarray()[rows][:, columns] != 0
    np.fill_diagonal(filled, True)
    for k in range(25):
        filled[k + 1 :, k + 1 :] |= np.outer(filled[k + 1 :, k], filled[k, k + 1 :])
    lower = [np.flatnonzero(row[:i]) for i, row in enumerate(filled)]
    upper = [i + np.flatnonzero(row[i:]) for i, row in enumerate(filled)]
    assert np.array_equal(np.concatenate([*lower, *upper[::-1]]), order.col)
    assert np.array_equal(order.low, np.cumsum([0, *map(len, lower)]))
    assert np.array_equal(order.up, order.size - np.cumsum([0, *map(len, upper)]))
    assert np.array_equal(order.col[order.up[1:]], np.arange(25))
    assert all((np.diff(order.col[a:b]) == 1).all() for a, b in zip(order.run, order.up, strict=False) if b > a)


@pytest.mark.parametrize("share", [1.0, 0.1])
@pytest.mark.parametrize("kind", [float, complex])
@pytest.mark.parametrize("density", [0.1, 1.0])
def test_pivots_by_counts_are_large_in_what_is_left_of_the_matrix(density: float, kind: Any, share: float) -> None:
    """Eliminated by hand in the order found, every pivot is at least a share of the largest in its column, and none that is has
    fewer others in its row and column."""
    rng = RNG(4)
    entries = pattern(30, density, rng)
    a = values(entries, kind, rng)
    order = by_counts(entries, a, share)
    assert order is not None
    left, at = entries.matrix(a).toarray(), entries.matrix(np.ones(entries.nnz)).toarray() != 0
    left, at = left[order.rows][:, order.columns], at[order.rows][:, order.columns]
    for _ in range(30):
        cost = np.outer(at.sum(1) - 1, at.sum(0) - 1)
        size = abs(left.real) + abs(left.imag)
        is_large = at & (size >= share * size.max(axis=0) * (1 - 1e-9))
        assert is_large[0, 0]
        assert cost[0, 0] == cost[is_large].min()
        left = left[1:, 1:] - np.outer(left[1:, 0], left[0, 1:]) / left[0, 0]
        at = at[1:, 1:] | np.outer(at[1:, 0], at[0, 1:])


def test_an_order_by_counts_is_that_of_a_small_matrix() -> None:
    entries = Entries(MANY + 1, np.arange(MANY + 2), np.arange(MANY + 1))
    with pytest.raises(ValueError, match="1001 unknowns"):
        by_counts(entries, np.ones(MANY + 1))
    order = largest_pivots(entries, np.ones(MANY + 1))  # by SuperLU
    assert order is not None
    assert np.array_equal(order.rows, order.columns)


def test_solutions_of_an_iteration_matrix_are_those_of_the_full_one() -> None:
    """Equations and unknowns are scaled for the factors; solutions are not."""
    rng = RNG(9)
    entries = pattern(40, 0.1, rng)
    matrix = Matrix(entries, 10.0 ** rng.integers(-3, 3, 40), np.zeros(40), [1.0], [], searches(()))
    matrix.fy[:], matrix.fyp[:] = values(entries, float, rng), values(entries, float, rng)
    with pytest.raises(ValueError, match="nothing is factorised"):
        matrix.solved(np.ones((3, 40)))
    matrix.factor(0.1)
    right, full = rng.normal(size=(3, 40)), entries.matrix(matrix.fy + matrix.fyp / 0.1).toarray()
    np.testing.assert_allclose(matrix.solved(right), np.linalg.solve(full, right.T).T, rtol=1e-8, atol=1e-8)
