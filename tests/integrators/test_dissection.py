"""Nested dissection: what divides a graph, and orders of elimination of scenes with many loops."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.integrators import matrices, radau_table
from mbdae.integrators.matrices import IterationMatrix
from mbdae.native import Orders, largest_pivots
from mbdae.native.sparse import Factors
from mbdae.system.prepare import prepare

TABLE = radau_table(3)


def net(n: int, spherical: bool = False) -> mb.Scene:
    """n x n squares of bars that hang from a corner."""
    s = mb.Scene("net", gravity=(0, -9.81, 0))
    ends: dict[tuple[int, int], list[mb.Body]] = {(0, 0): [s.ground]}
    for i in range(n + 1):
        for j in range(n + 1):
            for k, l in ((i + 1, j), (i, j + 1)):
                if max(k, l) > n:
                    continue
                middle = (i + k) / 2, -(j + l) / 2
                name = f"{i},{j} to {k},{l}"
                if spherical:
                    bar = s.rigid_body(name, 1.0, (0.01, 0.02, 0.02), at=(*middle, 0))
                else:
                    bar = s.link(name, (i, -j), (k, -l), mass=1.0)
                for end in ((i, j), (k, l)):
                    ends.setdefault(end, []).append(bar)
    for (i, j), (first, *others) in ends.items():
        for other in others:
            if spherical:
                s.spherical(f"{first.name} and {other.name}", first, other, at=(i, -j, 0), model=mb.Kinematic())
            else:
                s.revolute(f"{first.name} and {other.name}", first, other, at=(i, -j), model=mb.Kinematic())
    return s


def square(n: int, weights: np.ndarray | None = None) -> tuple[csr_matrix, np.ndarray]:
    """n x n vertices, each beside four others, and their weights."""
    number = np.arange(n * n).reshape(n, n)
    one, other = np.r_[number[:-1].ravel(), number[:, :-1].ravel()], np.r_[number[1:].ravel(), number[:, 1:].ravel()]
    graph = csr_matrix((np.ones(2 * len(one)), (np.r_[one, other], np.r_[other, one])), shape=(n * n, n * n))
    return graph, np.ones(n * n, dtype=int) if weights is None else weights


def test_a_square_is_divided_by_one_line() -> None:
    graph, weight = square(15)
    found = matrices._separator(graph, weight)
    assert found is not None
    one, other, between = found
    assert np.array_equal(np.sort(np.concatenate(found)), np.arange(225))
    assert not graph[one][:, other].nnz
    assert len(between) <= 15
    assert min(len(one), len(other)) >= 60


def test_the_lightest_vertices_divide_a_graph() -> None:
    """A line of light vertices beside the middle of a square of heavy ones."""
    weight = np.full((15, 15), 5)
    weight[6] = 1
    graph, weight = square(15, weight.ravel())
    parts = matrices._cut(graph, weight, np.arange(15), np.arange(210, 225))
    assert parts is not None
    assert np.array_equal(parts[2], np.arange(90, 105))
    assert np.array_equal(parts[0], np.arange(90))
    assert matrices._cut(graph, weight, np.arange(15), np.arange(15, 30)) is None  # neighbours


def test_what_is_divided_is_eliminated_with_less_fill_in() -> None:
    """An order of a square by halves against its natural one: some 31 n^2 log n entries against 2 n^3 (George)."""
    graph, weight = square(40)
    entries = matrices.Entries(1600, graph.indptr, graph.indices)
    order = matrices._divided(graph, weight)
    assert np.array_equal(np.sort(order), np.arange(1600))
    assert matrices.Order(entries, order, order).work < 0.4 * matrices.Order(entries, np.arange(1600), np.arange(1600)).work


@pytest.mark.parametrize(("scene", "saved", "form"), [
    pytest.param((16, False), 0.9, mb.GGL(), id="plane, GGL"), pytest.param((12, True), 0.6, mb.Index3(), id="space, Index3"),
    pytest.param((16, False), 0.9, mb.Index3(), id="plane, Index3", marks=pytest.mark.slow),
    pytest.param((12, True), 0.6, mb.GGL(), id="space, GGL", marks=pytest.mark.slow),
])
def test_nets_are_dissected(scene: tuple[int, bool], saved: float, form: mb.GGL) -> None:
    """Multiplications against the largest pivots in an order by COLAMD, and the solution of a known right-hand side."""
    system = system_for(prepare(net(*scene)), form)
    matrix = IterationMatrix(system, TABLE.real, TABLE.pairs)
    matrix.refresh(0.0, system.y0, system.yp0)
    matrix.factor(1e-3)
    entries, values = matrix.entries, matrix.factors[0].values
    order, pivots = matrices.dissected(system.kinds, entries), largest_pivots(entries, values)
    assert order is not None
    assert pivots is not None
    assert order.work < saved * pivots.work
    assert matrix.orders.present is not None
    assert matrix.orders.present.work <= order.work
    factors = Factors(Orders(entries, (lambda *_: order,)), float)
    factors.values[:] = values
    factors.factor()
    x = np.random.default_rng(3).normal(size=system.n)
    assert factors.order is order
    assert np.abs(factors.solve(entries.matrix(values) @ x) - x).max() < 1e-7 * np.abs(x).max()


def test_no_order_tried_for_a_net_fills_in_more_than_the_largest_pivots() -> None:
    """Pivots on the diagonal alone take ten times the work here: multipliers have none."""
    system = system_for(prepare(net(8)), mb.GGL())
    matrix = IterationMatrix(system, TABLE.real, TABLE.pairs)
    entries, values = matrix.entries, matrix.factors[0].values
    pivots = largest_pivots(entries, values)
    found = [search(entries, values) for search in matrices.searches(system.kinds)]
    assert pivots is not None
    assert found[-1] is not None
    assert max(order.work for order in found if order is not None) <= pivots.work


def test_without_multipliers_nothing_is_dissected() -> None:
    entries = matrices.Entries.full(3)
    assert matrices.dissected(["q", "v", "v"], entries) is None


def test_an_order_that_loses_digits_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the pivots of the dissected order are too small, the matrix is factorised in one that was compared with it."""
    system = system_for(prepare(net(8)), mb.GGL())
    monkeypatch.setattr(matrices, "LOOPS", 0)  # compared in every scene
    wrong = []

    def multipliers_first(kinds, entries):
        order = np.argsort(~np.isin(kinds, matrices.MULTIPLIERS), kind="stable")
        wrong.append(matrices.Order(entries, order, order))
        wrong[0].work = 0
        return wrong[0]

    monkeypatch.setattr(matrices, "dissected", multipliers_first)
    matrix = IterationMatrix(system, TABLE.real, TABLE.pairs)
    assert wrong
    assert matrix.orders.present not in (None, wrong[0])
    assert matrix.orders.present.work < 5e6
