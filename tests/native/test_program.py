"""Native programs: random tables are refused, or do what the same operations do in NumPy."""

import copy
import os

import numpy as np
import pytest
import symengine as se

import mbdae as mb
from mbdae.kernels import Kernel
from mbdae.native.program import Operations, core
from mbdae.system.motion.constrained import Workspace

from .running import run

COUNT = int(os.environ.get("MBDAE_RANDOM_TABLES", "3000"))


def slots(rng, size, count):
    """Mostly slots of the array, now and then one outside."""
    found = rng.integers(0, size, count)
    if count and rng.random() < 0.05:
        found[rng.integers(count)] = rng.choice([-1, -(10**12), size, size + 7, 10**12])
    return found


def steps_of(rng, *names):
    return {name: int(rng.integers(0, 4)) if rng.random() < 0.9 else int(rng.choice([-1, 10**9])) for name in names}


def random_map(rng, size):
    """An operation on slots: how it is stated, and what it does to an array."""
    count, times = int(rng.integers(0, 6)), int(rng.integers(0, 4))
    to, from_, by = (slots(rng, size, count) for _ in range(3))
    kind = rng.choice(["load", "set", "add", "multiply"])
    if kind == "load":
        first, values = int(slots(rng, size, 1)[0]), rng.normal(size=count)
        return lambda ops: ops.load(first, values), lambda W: W.__setitem__(slice(first, first + count), values)
    names = ("to_step", "from_step", "by_step")[: 3 if kind == "multiply" else 2]
    stated = steps_of(rng, *(name for name in names if rng.random() < 0.9))
    steps = dict.fromkeys(names, 0) | stated
    weight = rng.normal(size=(times, count) if kind == "add" and rng.random() < 0.3 else count)
    if rng.random() < 0.02:
        weight = weight[..., :-1]

    def applied(W):
        for r in range(times):
            for k in range(count):
                t, f = to[k] + r * steps["to_step"], from_[k] + r * steps["from_step"]
                if kind == "set":
                    W[t] = W[f]
                    continue
                w = weight[r, k] if weight.ndim == 2 else weight[k]
                if kind == "add":
                    W[t] += w * W[f]
                else:
                    W[t] += w * W[f] * W[by[k] + r * steps["by_step"]]

    if kind == "set":
        return lambda ops: ops.set(to, from_, times, **stated), applied
    if kind == "add":
        return lambda ops: ops.add(to, from_, weight, times, **stated), applied
    return lambda ops: ops.multiply(to, from_, by, weight, times, **stated), applied


def random_solution(rng, size):
    """A matrix and its right-hand side, of a full one several, somewhere in the array."""
    n = int(rng.integers(1, 5))
    width = int(rng.integers(1, n + 1))
    lower = np.tril(rng.normal(size=(n, n))) * (np.subtract.outer(np.arange(n), np.arange(n)) < width) + 3 * np.eye(n)
    kind = rng.choice(["cholesky", "lu"])
    times = 1 if kind == "cholesky" else int(rng.integers(1, 4))
    A, b = lower @ lower.T, rng.normal(size=(times, n))
    full = rng.normal(size=(n, n))
    matrix = int(slots(rng, size, 1)[0])
    right = matrix + n * (width if kind == "cholesky" else n)
    band = np.array([[A[i, i - width + 1 + j] if i - width + 1 + j >= 0 else 0.0 for j in range(width)] for i in range(n)])

    def state(ops):
        ops.load(matrix, band if kind == "cholesky" else full)
        ops.load(right, b)
        if kind == "cholesky":
            ops.cholesky(n, width, matrix, right)
        else:
            ops.lu(n, matrix, right, times)

    return state, matrix, right, n * times, np.linalg.solve(A if kind == "cholesky" else full, b.T).T.ravel()


def random_pass(rng, size):
    """A kernel whose instances may read what those before them have handed on."""
    inputs, width, points = (int(rng.integers(1, 4)) for _ in range(3))
    count = int(rng.integers(0, width + (rng.random() < 0.95)))
    symbols = [se.Symbol(f"x{i}") for i in range(inputs)]
    factors = rng.normal(size=(width, inputs))
    kernel = Kernel(symbols, [se.Add(*(float(f) * s for f, s in zip(row, symbols, strict=True))) for row in factors])
    gather, to = slots(rng, size, points * inputs).reshape(points, inputs), slots(rng, size, points * count)
    to, first = to.reshape(points, count), int(slots(rng, size, 1)[0])
    if rng.random() < 0.05:
        to = to[: points - 1] if rng.random() < 0.5 else np.zeros((points, width + 1), dtype=int)

    def applied(W):
        for r in range(points):
            at = first + r * width
            W[at : at + width] = factors @ W[gather[r]]
            for k in range(count):
                W[to[r, k]] += W[at + k]

    return lambda ops: ops.hand_on(kernel, gather, to, first), applied


def test_random_passes_are_refused_or_right():
    rng = np.random.default_rng(8)
    refused = right = 0
    for _ in range(max(COUNT // 10, 20)):
        size = int(rng.integers(1, 60))
        operations, expected = Operations(size), rng.normal(size=size)
        W, made = expected.copy(), [random_pass(rng, size), random_map(rng, size)]
        try:
            for state, _ in made:
                state(operations)
            assert run(operations, W) == (0, -1)
        except ValueError:
            refused += 1
            continue
        for _, applied in made:
            applied(expected)
        assert pytest.approx(expected, rel=1e-9, abs=1e-12) == W
        right += 1
    assert min(refused, right) > 5


def test_random_tables_are_refused_or_right():
    rng = np.random.default_rng(5)
    refused = right = 0
    for _ in range(COUNT):
        size = int(rng.integers(1, 60))
        operations, expected = Operations(size), rng.normal(size=size)
        W = expected.copy()
        made = [random_map(rng, size) for _ in range(int(rng.integers(1, 5)))]
        solution = random_solution(rng, size) if rng.random() < 0.3 else None
        looked_at = slots(rng, size, int(rng.integers(1, 4))) if rng.random() < 0.2 else np.zeros(0, dtype=int)
        try:
            for state, _ in made:
                state(operations)
            if solution is not None:
                solution[0](operations)
            operations.positive(looked_at)
            code = run(operations, W)
        except ValueError:
            refused += 1
            continue
        negative = np.flatnonzero(~(W[looked_at] > 0))
        assert code == ((2, negative[0]) if len(negative) else (0, -1))
        for _, applied in made:
            applied(expected)
        changed = np.ones(size, dtype=bool)
        if solution is not None:
            _, matrix, at, n, x = solution
            changed[matrix : at + n] = False
            assert W[at : at + n] == pytest.approx(x, rel=1e-6, abs=1e-6)
        assert W[changed] == pytest.approx(expected[changed], rel=1e-9, abs=1e-12)
        right += 1
    assert min(refused, right) > COUNT // 10


def test_a_singular_matrix_is_told_with_its_row():
    operations = Operations(0)
    first, b = operations.slots(9), operations.slots(3)
    operations.load(first, np.diag([2.0, 0.0, 1.0]))
    operations.lu(3, first, b)
    assert run(operations, np.zeros(operations.size)) == (2, 1)
    operations = Operations(0)
    first, b = operations.slots(3), operations.slots(3)
    operations.load(first, [1.0, 4.0, -1.0])
    operations.cholesky(3, 1, first, b)
    assert run(operations, np.zeros(operations.size)) == (2, 2)


def test_a_part_is_compiled_when_it_is_asked_for(monkeypatch):
    compiled, compile_part = [], Workspace.make
    monkeypatch.setattr(Workspace, "make", lambda self, *parts: (compiled.extend(parts), compile_part(self, *parts))[1])
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), model=mb.Recursive())
    system = s.system(mb.ODE())
    mb.DOP853(rtol=1e-6).solve(system, 0.1)
    assert "rates" in compiled
    assert "jacobian" not in compiled
    e = s.system(mb.ODE()).assembly.evaluation
    y, out = np.zeros(e.n), np.zeros(e.n)
    at = [a.ctypes.data for a in (y, y, out)]
    assert core().scene_residual(e.address, 0.0, *at) == 1  # a part that was not made says so
    e.make("residual")
    assert core().scene_residual(e.address, 0.0, *at) == 0


def test_a_copy_of_a_system_has_tables_of_its_own():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), torque=mb.t)
    system = s.system("ggl")
    expected = mb.RadauIIA(3, rtol=1e-6).solve(system, 0.5).y
    other = copy.deepcopy(system)
    assert other.native.address != system.native.address
    assert np.array_equal(mb.RadauIIA(3, rtol=1e-6).solve(other, 0.5).y, expected)
    r = s.simulate(0.2)
    assert np.array_equal(copy.deepcopy(r).q, r.q)


def test_a_velocity_without_inertia_is_named():
    """In a mass matrix that does not vary, which is factorised once."""
    s = mb.Scene("falling")
    s.point_mass("p", 1.0, at=(0, 0, 0))
    s.rigid_body("b", 1.0, (1.0, 1.0, 1.0), at=(1, 0, 0))
    system = s.system(mb.ODE())
    (rows, columns, values), out = system.assembly._constants_of_mass, np.zeros(system.n)
    values[(rows == 4) & (columns == 4)] = 0.0
    with pytest.raises(mb.SolverError, match=r"the motion of b\.omega has no inertia"):
        system.rhs(0.0, system.y0, out)
    with pytest.raises(mb.SolverError, match=r"the motion of b\.omega has no inertia"):
        mb.DOP853(rtol=1e-6).solve(system, 0.1)
