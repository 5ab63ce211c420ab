"""Accelerations and multipliers of constrained bodies with a constant mass matrix, in a few microseconds per state.

One kernel call per law gives q', -f, the right-hand side c of the constraints and G. Then S lambda = G M^-1 f + c with
S = G M^-1 G^T is solved by Cholesky in a band, in an order of the rows that makes the band of chains of bodies narrow. Where the
mass matrix is singular, or masses differ so much that S loses digits, the equations of u' and lambda are factorised together by
LU instead. M is inverted once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, Self

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.deferred import as_full, distinct
from mbdae.kernels.plan import plan
from mbdae.native.equations import CEquations, Equations
from mbdae.native.program import Operations, address_of, narrow_order
from mbdae.symbolic import outputs
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.constrained import Workspace

#: names of two parameters of a form, Baumgarte's factors in the constraint rows: of G u + g_t (1/s), and of g (1/s^2)
VELOCITY, POSITION = "baumgarte_velocity", "baumgarte_position"
#: the squared part of a row of G M^-1/2 that is independent of the rows before it, over the squared length of the row: if one is
#: at most this value at the start, Cholesky factors of S lose too many digits, and LU of the whole or `Assembly` is used instead
SPREAD = 1e-5
#: number of velocities and multipliers together below which, where Cholesky does not suit, the equations of u' and lambda are
#: factorised as one full matrix; with more, those of `Assembly` are solved
WHOLE_BELOW = 150

Index = NDArray[np.intp]
RowOf = Callable[[Target, int, int], int]


def _with_drift(d: Derived, rates: list[Expr]) -> list[tuple[Target, Expr]]:
    weights = se.Symbol(VELOCITY), se.Symbol(POSITION)
    off = zip(rates, outputs.velocity(d), outputs.position(d), strict=True)
    return [(("gdd", i), d.scaled(a + weights[0] * v + weights[1] * g)) for i, (a, (_, v), (_, g)) in enumerate(off)]


def stabilised(d: Derived) -> list[tuple[Target, Expr]]:
    """Rows G u' + gamma + 2 alpha (G u + g_t) + beta^2 g: accelerations with Baumgarte's stabilisation."""
    return _with_drift(d, outputs.second_rate(d))


def equations_of_motion(d: Derived) -> list[tuple[Target, Expr]]:
    """Outputs of a law from which u' and lambda follow: its rows of F at zero rates and multipliers, and its entries of G."""
    if isinstance(d.law, Element):
        still = {se.Symbol(f"{d.frames[0].side}_qp{i + 1}"): 0 for i in range(d.frames[0].kind.sizes[0])}
        return [*((t, e.subs(still)) for t, e in outputs.kinematics(d)), *outputs.loads(d)]
    penalty = getattr(d.law, "penalty", None)
    forces = [se.Integer(0) if penalty is None else 2 * penalty * c for c in d.g]
    stated = [entry for f in d.frames for entry in outputs.scatter_pair(f, outputs.covector(d, f, forces))]
    rates = [(t, e.subs({se.Symbol(f"statep_{d.states[t[1]]}"): 0})) for t, e in outputs.state_rows(d)]
    gamma = [e for _, e in outputs.acceleration(d)]
    return [*stated, *_with_drift(d, gamma), *rates, *((t, d.scaled(e)) for t, e in outputs.jacobian_G(d))]


class AccelerationKernel(Workspace):
    """q', u', s' and multipliers of a system of constrained bodies; `multipliers` (m,): those of the last evaluation."""

    def __init__(self, full: Any, mass: Array, row_of: RowOf, whole: bool) -> None:
        """full: the `Assembly` of the equations with multipliers; mass (nu, nu); row_of: row of F that an output of a law belongs
        to; whole: True to factorise the equations of u' and lambda together by LU, False for Cholesky factors of S."""
        super().__init__(full.numbering, source=full)
        nb, operations = full.numbering, self.operations
        self.m, self.nu, self.nq, self.whole = nb.m, nb.nu, nb.nq, whole
        self.differential = nb.start["lambda"]
        self.part = part = operations.part()
        self._F = part.zeros(full.n + 1)
        cells = np.array(list(self._laws(part, full, row_of)), dtype=np.intp).reshape(-1, 2)
        self._rows, self._columns = cells[:, 0], cells[:, 1]
        self.rates, self._multipliers = part.zeros(self.differential), operations.slots(self.m)
        kept = np.r_[np.arange(self.nq), np.arange(self.nq + self.nu, self.differential)]
        part.add(self.rates + kept, self._F + kept, -1.0)
        (self._by_lu if whole else self._by_cholesky)(part, mass)
        self.finish(rates=part, unknowns=self.differential, rates_at=self.rates)
        self._completed()

    def again(self, numbering: Numbering, source: Any = None) -> Self:
        made = super().again(numbering, source)
        made.part = made._parts["rates"]
        made._completed()
        return made

    def _completed(self) -> None:
        self.multipliers, _ = self.view(self._multipliers, self.m)
        table = CEquations(self.address, self.differential, 0, None, None, address_of("scene_rates"), None)
        self.equations = Equations(table, self, make=self.make)

    def _laws(self, part: Operations, full: Any, row_of: RowOf) -> dict[tuple[int, int], int]:
        """Append the evaluation of the laws: of their rows of F, and of the entries of G. Returns (row, column) -> number of each
        entry of G."""
        nb, found, to = full.numbering, list[Index](), list[tuple[int, int]]()
        entries: dict[tuple[int, int], int] = {}
        for g, group in enumerate(full.model.groups):
            p = plan(group.derived, equations_of_motion)
            active = [i for i in range(len(group.instances)) if (g, i) not in full.moved.replaced]
            if p.targets and active:
                found.append(p.kernel.emit(part, nb.gather(g, p.all_inputs, active)).ravel())
                to += [(0, row_of(t, g, i)) if t[0] != "G" else (1, _entry(full, t, g, i, entries))
                       for i in active for t in p.targets]
        self._G = part.zeros(len(entries))
        kind, number = np.array(to, dtype=np.intp).reshape(-1, 2).T
        values, kept = np.concatenate([np.zeros(0, np.intp), *found]), number >= 0
        at = np.where(kind == 0, self._F, self._G) + number
        part.add(at[kept], values[kept])
        return entries

    def _by_cholesky(self, part: Operations, mass: Array) -> None:
        """Append the solution of S lambda = G M^-1 f + c by Cholesky, then u' = M^-1 (f - G^T lambda)."""
        m, nu, rows, columns = self.m, self.nu, self._rows, self._columns
        inverse = inverse_of(mass)
        h = part.zeros(nu)  # first slot of M^-1 f
        i, j = np.nonzero(inverse)
        part.add(h + i, self._F + self.nq + j, lambda of: -of.inverse_mass[i, j])
        along = {int(k): np.flatnonzero(inverse[k]).tolist() for k in distinct(columns)}
        # entries (row, column) of G M^-1 that are not zero
        cells = sorted({(r, c) for r, k in zip(rows.tolist(), columns.tolist(), strict=True) for c in along[k]})
        row, column = np.array(cells, dtype=np.intp).reshape(-1, 2).T
        weighted, place_of = part.zeros(len(cells)), {cell: k for k, cell in enumerate(cells)}
        terms = [(place_of[r, c], e, k, c) for e, (r, k) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True))
                 for c in along[k]]
        to, entry, *at = (np.array(x) for x in zip(*terms, strict=True))
        part.add(weighted + to, self._G + entry, lambda of: of.inverse_mass[tuple(at)])
        by_column: dict[int, list[int]] = {}
        for e, c in enumerate(columns.tolist()):
            by_column.setdefault(c, []).append(e)
        pairs = np.array([(k, e) for k, (_, c) in enumerate(cells) for e in by_column.get(c, [])], dtype=np.intp)
        self._order, place = narrow_order(m, row[pairs[:, 0]], rows[pairs[:, 1]])
        left, right = pairs[place[row[pairs[:, 0]]] >= place[rows[pairs[:, 1]]]].T
        a, b = place[row[left]], place[rows[right]]
        width = int((a - b).max(initial=0)) + 1
        S, x, self._diagonal = part.zeros(m * width), part.slots(m), part.slots(m)
        self._factor = S + np.arange(m) * width + width - 1
        part.multiply(S + a * width + b - a + width - 1, weighted + left, self._G + right)
        part.set(x + place, self._F + self.differential + np.arange(m))
        part.multiply(x + place[rows], self._G + np.arange(len(rows)), h + columns)
        part.set(self._diagonal + np.arange(m), self._factor)
        part.cholesky(m, width, S, x)
        part.set(self._multipliers + np.arange(m), x + place)
        u = self.rates + self.nq
        part.set(u + np.arange(nu), h + np.arange(nu))
        part.multiply(u + column, weighted + np.arange(len(cells)), x + place[row], -1.0)

    def _by_lu(self, part: Operations, _mass: Array) -> None:
        """Solve the equations of u' and lambda together by LU: for masses that are zero or differ too much."""
        m, nu = self.m, self.nu
        n = nu + m
        K = part.slots(n * n)
        part.load(K, lambda of: np.pad(as_full(of.constant_mass), (0, m)))
        entries = self._G + np.arange(len(self._rows))
        part.set(K + (nu + self._rows) * n + self._columns, entries)
        part.set(K + self._columns * n + nu + self._rows, entries)
        x = part.zeros(n)
        part.add(x + np.arange(nu), self._F + self.nq + np.arange(nu), -1.0)
        part.add(x + nu + np.arange(m), self._F + self.differential + np.arange(m), -1.0)
        part.lu(n, K, x)
        part.set(self.rates + self.nq + np.arange(nu), x + np.arange(nu))
        part.set(self._multipliers + np.arange(m), x + nu + np.arange(m))

    def y_rates(self, t: float, y: Array, out: Array) -> int:
        """out[:] = y', (n,). Returns the number of a constraint row that depends on the others, so that y' is not determined; -1
        where there is none."""
        bad = self.solved(t, y, out)
        if bad < 0:
            return -1
        return max(bad - self.nu, 0) if self.whole else int(self._order[bad])

    def shares(self, t: Array, y: Array) -> Array:
        """(k, m) at states t (k,), y (k, n), of every constraint row: the squared part that is independent of other rows, over
        the squared length of the row. With Cholesky factors: independent of the rows eliminated before it, in the metric of
        M^-1; else as in `row_shares`."""
        out, read = np.empty(self.differential), self._G + np.arange(len(self._rows)) if self.whole else np.concatenate(
            [self._factor, self._diagonal + np.arange(self.m)])
        seen, dependent = np.empty((len(t), len(read))), list[tuple[int, int]]()
        for i, time in enumerate(t.tolist()):
            if (row := self.y_rates(time, y[i], out)) >= 0:  # the factorisation stopped at this row
                dependent.append((i, row))
            seen[i] = self.W[read]
        if self.whole:
            G = np.zeros((len(t), self.m, self.nu))
            G[:, self._rows, self._columns] = seen
            return row_shares(G)
        share = np.empty((len(t), self.m))
        share[:, self._order] = seen[:, : self.m] ** 2 / seen[:, self.m :]
        for i, row in dependent:
            share[i, row] = 0.0
        return share


def inverse_of(mass: Array) -> Array:
    """Inverse of a mass matrix, block by block, so that its entries outside of the diagonal blocks are exactly 0."""
    inverse = np.zeros_like(mass)
    for at in _blocks((mass != 0).tobytes(), len(mass)):
        rows, columns = at[:, :, None], at[:, None, :]
        inverse[rows, columns] = np.linalg.inv(mass[rows, columns])
    return inverse


@lru_cache(maxsize=64)
def _blocks(places: bytes, n: int) -> list[Index]:
    """The diagonal blocks of a symmetric matrix (n, n), those of a size together: (blocks, size) numbers of their rows, which
    need not be consecutive. places: where its entries are not 0."""
    label, found = np.arange(n), dict[int, list[Index]]()
    for i, j in np.argwhere(np.triu(np.frombuffer(places, dtype=bool).reshape(n, n), 1)).tolist():
        if label[i] != label[j]:
            label[label == label[j]] = label[i]
    for one in dict.fromkeys(label.tolist()):
        at = np.flatnonzero(label == one)
        found.setdefault(len(at), []).append(at)
    return [np.array(of_size) for of_size in found.values()]


def _entry(full: Any, target: Target, g: int, i: int, entries: dict[tuple[int, int], int]) -> int:
    """Number of the entry of G that an output of instance i in group g belongs to, a new one where it is new in `entries`; -1 for
    entries whose row is not in force or whose velocity is no unknown."""
    nb = full.numbering
    row, column = nb.row(g, i, target[1]), nb.velocity(("u", *target[2:]), g, i)
    return -1 if row is None or not 0 <= column < nb.nu else entries.setdefault((row, column), len(entries))


def acceleration_kernel(full: Any, M: Array, row_of: RowOf, start: tuple[float, Array],
                        own: bool = False) -> AccelerationKernel | None:
    """The kernel for scenes of bodies; None where the full equations have to be solved instead: with trees, with beams, and with
    many bodies some of which are massless. M (nu, nu): mass matrix; row_of: see `AccelerationKernel`; start: a state (t, y), at
    which the kernel checks whether masses differ too much for Cholesky; own: operations may be appended to it."""
    nb = full.numbering
    if full.moved.nodes or full.model.lines or not nb.m:
        return None

    def made(whole: bool) -> AccelerationKernel:
        known, key = {} if own else full.model.shape.kept, (AccelerationKernel, full.key, whole, (M != 0).tobytes())
        first: AccelerationKernel | None = known.get(key)
        return first.again(nb, full) if first else known.setdefault(key, AccelerationKernel(full, M, row_of, whole))

    if np.all(M.diagonal() > 0) and np.all(np.linalg.eigvalsh(M) > 0):
        found = made(False)
        if np.min(found.shares(np.array(start[:1]), start[1][None])) > SPREAD:
            return found
    return made(True) if nb.nu + nb.m < WHOLE_BELOW else None


def row_shares(G: Array) -> Array:
    """(..., m) part of every row of G (..., m, nu) that is independent of the other rows, squared, over the squared length of the
    row."""
    unit = G / np.linalg.norm(G, axis=-1, keepdims=True)
    _, sigma, V = np.linalg.svd(unit.swapaxes(-1, -2), full_matrices=False)
    return np.asarray(1 / np.sum((V / np.maximum(sigma[..., None], 1e-150)) ** 2, axis=-2))
