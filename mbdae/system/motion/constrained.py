"""Accelerations and multipliers of constrained equations of motion, many states at once, also where some rows are redundant or
matrices sparse, of one pattern.

The workspace of a numbering as the array of a native program, with the operations that fill it: values prescribed in time, and
the motion of loaded nodes.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import entries_of, issparse
from mbdae.errors import internal
from mbdae.native import Entries, Orders, address, largest_pivots
from mbdae.native.program import Operations, Part, Scene, core
from mbdae.native.sparse import Factors, SingularMatrixError
from mbdae.system.base import Array
from mbdae.system.model.numbering import Numbering
from mbdae.threads import Owner

MAKING = Owner("equations")  #: of the thread that makes lists of operations, which several models share
AT_ONCE = 1_000_000  #: number of entries of the matrices of states that are solved together, which bounds the memory
#: length of a constraint row in joint coordinates, over its length in the coordinates of all nodes, up to which it counts as 0
ROUND_OFF = 1e-12


def row_lengths(B: Any) -> Array:
    """Euclidean lengths (..., m, 1) of rows (..., m, n), sparse or not; 1 where a row is zero, so that one can divide by them."""
    if issparse(B):
        lengths = np.sqrt(np.asarray(B.multiply(B).sum(axis=1))).reshape(-1, 1)
    else:
        lengths = np.linalg.norm(B, axis=-1, keepdims=True)
    return np.where(lengths > 0, lengths, 1.0)


def largest_entries(B: Any) -> Array:
    """(m,) magnitude of the largest entry of every row of B (m, n), sparse or not."""
    if issparse(B) and B.shape[1]:
        return np.asarray(abs(B).max(axis=1).toarray())[:, 0]
    return np.zeros(B.shape[0]) if issparse(B) else np.asarray(np.max(np.abs(B), axis=1, initial=0.0))


def unique_multipliers(B: Array, redundant: int, mass: float, whole: Array) -> Array:
    """E (nt, m, m) of G u' - E lambda = -gamma, which makes the multipliers unique although `redundant` rows of G follow from
    others.

    Accelerations are the same as without E, and lambda is the one of least norm; in the norm each multiplier counts by its work
    in a unit displacement (the scene's length or 1 rad), so that forces and moments can be compared. B (nt, m, nu): columns of G
    times unit displacements; mass: typical mass of a unit displacement; whole (nt, m): lengths of the rows in the coordinates of
    all nodes, used for rows that joint coordinates satisfy by themselves, whose length in B is 0."""
    lengths = np.linalg.norm(B, axis=2)
    lengths = np.where(lengths > ROUND_OFF * whole, lengths, whole)[:, :, None]
    lengths[lengths == 0] = 1.0
    null = np.linalg.svd(B / lengths)[0][:, :, B.shape[1] - redundant :] * lengths
    return np.asarray(null @ null.transpose(0, 2, 1) / mass)


def least_norm(B: Array, force: Array) -> Array:
    """Multipliers lambda (nt, m) with B^T lambda = force, of least norm as in `unique_multipliers`. B (nt, m, nu): columns of G
    times unit displacements; force (nt, nu): generalised forces times unit displacements."""
    lengths = row_lengths(B)
    found = np.array([np.linalg.lstsq(b.T, f, rcond=1e-9)[0] for b, f in zip(B / lengths, force, strict=True)])
    return np.asarray(found.reshape(lengths.shape[:2]) / lengths[:, :, 0])


def solve_constrained(M: Array, f: Array, G: Array, gamma: Array, units: Array, slope: Array | None = None,
                      E: Array | None = None) -> tuple[Array, Array]:
    """u' (nt, nu), lambda (nt, m) of M u' + (G^T - slope) lambda = f (nt, nu), G u' - E lambda = -gamma (nt, m).

    M (nu, nu) or (nt, nu, nu); slope (nt, nu, m): derivative of friction by lambda; E: see `unique_multipliers`; units (nu,):
    scale of u' in the norm that chooses a solution where the matrix is singular."""
    nu, n = f.shape[1], f.shape[1] + gamma.shape[1]
    scale, right, out = np.append(units, np.ones(n - nu)), np.concatenate([f, -gamma], axis=1), np.empty((len(f), n))
    size = max(1, AT_ONCE // n**2)
    for part in (slice(i, i + size) for i in range(0, len(f), size)):
        K = np.zeros((len(f[part]), n, n))
        K[:, :nu, :nu], K[:, :nu, nu:], K[:, nu:, :nu] = M if M.ndim == 2 else M[part], G[part].transpose(0, 2, 1), G[part]
        if slope is not None:
            K[:, :nu, nu:] -= slope[part]
        if E is not None:
            K[:, nu:, nu:] = -E[part]
        out[part] = _solved(K, right[part], scale)
    return out[:, :nu], out[:, nu:]


def _solved(K: Array, right: Array, scale: Array) -> Array:
    """Solutions (nt, n) of K x = right for many states: all at once, and one by one where a K is singular, see `_solve`."""
    if len(K) == 1:  # once more for what is left, as equations are linearised there: 2e-13 of a force where masses differ much
        one, left = _solve(K[0], right[0], scale)
        return np.asarray(one if left is None else one + np.linalg.solve(K[0], left))[None]
    try:
        x = np.linalg.solve(K, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        return np.array([_solve(k, b, scale)[0] for k, b in zip(K, right, strict=True)]).reshape(right.shape)
    off = np.linalg.norm(np.einsum("tij,tj->ti", K, x) - right, axis=1)  # nan where x is not finite
    for i in np.flatnonzero(~(off <= CLOSE * (np.linalg.norm(right, axis=1) + 1e-300))):
        x[i] = _solve(K[i], right[i], scale)[0]
    return np.asarray(x)


def _solve(K: Array, right: Array, scale: Array) -> tuple[Array, Array | None]:
    """Solution of K x = right, and what it leaves; of a singular K the one with the smallest norm of x / scale, and None."""
    try:
        x = np.linalg.solve(K, right)
        left = right - K @ x
        if np.linalg.norm(left) <= CLOSE * (np.linalg.norm(right) + 1e-300):
            return np.asarray(x), left
    except np.linalg.LinAlgError:
        pass
    return np.asarray(scale * np.linalg.lstsq(K * scale, right, rcond=1e-12)[0], dtype=float), None


#: where rows are redundant or K is singular, constraints get this small compliance, which makes K regular; relative to 1 / mass
#: in unit displacements
GIVE = 1e-10
#: number of solutions with this compliance: every one after the first corrects the error that the compliance causes and reduces
#: it by about the factor GIVE
CORRECTIONS = 4
CLOSE = 1e-8  #: K counts as singular where the norm of the residual over that of the right-hand side is larger


class FixedPattern:
    """Solves K x = right with K = [[M, G^T - slope], [G, 0]] at many states, whose K have the same sparsity pattern.

    M (nu, nu): sparse, equal in all states; m: number of constraint rows; rows, columns (k,): of the entries of G (m, nu); slope
    (nt, nu, m): derivative of friction by lambda, or None. The order of elimination is found once, and again where pivots become
    too small."""

    def __init__(self, M: Any, m: int, rows: Any, columns: Any, slope: Array | None) -> None:
        nu, (of_mass, by_mass, self._mass) = M.shape[0], entries_of(M)
        self.n, self.m = nu + m, m
        self._slope = None if slope is None else np.nonzero(np.any(slope != 0, axis=0))
        of_slope = self._slope or (np.zeros(0, dtype=np.intp),) * 2
        own = nu + np.arange(m)
        i = np.concatenate([of_mass, columns, nu + rows, of_slope[0], own]).astype(np.int64)
        j = np.concatenate([by_mass, nu + rows, columns, nu + of_slope[1], own]).astype(np.int64)
        places, where = np.unique(j * self.n + i, return_inverse=True)
        self.entries = Entries(self.n, np.searchsorted(places, np.arange(self.n + 1) * self.n), places % self.n)
        self._order = np.argsort(where, kind="stable")
        self._first = np.searchsorted(where[self._order], np.arange(len(places)))
        self._own = where[len(where) - m :]
        self._exact, self._near = (Factors(Orders(self.entries, (largest_pivots,)), float) for _ in range(2))

    def values(self, G: Array, slope: Array | None) -> Array:
        """Entries (nt, nnz) of K, from entries (nt, k) of G."""
        parts = [np.broadcast_to(self._mass, (len(G), len(self._mass))), G, G]
        if slope is not None and self._slope is not None:
            parts.append(-slope[:, self._slope[0], self._slope[1]])
        together = np.hstack([*parts, np.zeros((len(G), self.m))])
        return np.asarray(np.add.reduceat(together[:, self._order], self._first, axis=1))

    def at(self, values: NDArray[np.float64], give: Array, redundant: bool) -> Callable[[Array], Array]:
        """The function right-hand side (n,) -> x (n,) at one state with entries of K `values` (nnz,); valid until `at` is called
        for another state.

        redundant: whether some rows follow from others. Then, and where K is singular, the multipliers are those of least norm as
        in `unique_multipliers`. give (m,): the compliance of a row in units of `GIVE`: its squared length in unit displacements,
        over the mass of a unit displacement."""
        begun = [not redundant and self._factored(values), False]

        def solve(right: Array) -> Array:
            x = self._solved(values, right) if begun[0] else None
            if x is not None:
                return x
            if not begun[1]:
                self._factor_near(values, give)
                begun[:] = False, True
            return self._nearest(values, right)

        return solve

    def _product(self, values: Array, x: Array) -> Array:
        return np.asarray(np.bincount(self.entries.row_of, values * x[self.entries.column_of], self.n), dtype=float)

    def _factored(self, values: Array) -> bool:
        """Factorise K; returns whether it is regular."""
        self._exact.values[:] = values
        try:
            self._exact.factor()
        except SingularMatrixError:
            return False
        return True

    def _solved(self, values: Array, right: Array) -> Array | None:
        """x with K x = right by the LU factors of K; None where the residual is too large because K is nearly singular."""
        x = self._exact.solve(right)
        left = np.linalg.norm(self._product(values, x) - right)
        return x if left <= CLOSE * (np.linalg.norm(right) + 1e-300) else None

    def _factor_near(self, values: Array, give: Array) -> None:
        self._near.values[:] = values
        self._near.values[self._own] -= GIVE * give
        self._near.factor()

    def _nearest(self, values: Array, right: Array) -> Array:
        """The solution with multipliers of least norm, by the LU factors of K with compliant constraints. Corrections with the
        same factors remove the error that the compliance causes."""
        x = np.zeros(self.n)
        for _ in range(CORRECTIONS):
            x = x + self._near.solve(right - self._product(values, x))
        return x


Index = NDArray[np.intp]
Emitted = Callable[[Operations], None]  #: appends operations, such as those of the motion of bodies that trees carry


class Workspace:
    """A native program on the workspace of a numbering. Its first operations evaluate the values prescribed in time (`clock`),
    and the motion of loaded nodes by kernels of trees (`motion`); subclasses append others."""

    def __init__(self, numbering: Numbering, motion: Emitted | None = None, source: Any = None) -> None:
        self.numbering, self.n = numbering, numbering.n
        self.operations = Operations(numbering.width, source=source)
        self.at = self.operations.slots(2)
        self.clock = self.operations.part()
        if numbering.clock.expressions:
            numbering.clock.emit(self.clock, self.at, numbering.first_input)
        self.motion = self.operations.part()
        if motion is not None:
            motion(self.motion)

    def finish(self, residual: Operations | None = None, jacobian: Operations | None = None, rates: Operations | None = None,
               changes: Any = None, unknowns: int | None = None, rates_at: int = 0, **slots: int) -> None:
        """Allocate the array and make the table that C reads, after which no operations can be added.

        residual, jacobian, rates: lists of operations; changes: `Tangent` of the residual, or of y', where the Jacobian is full;
        unknowns: length of the y that C is given, by default n; rates_at: slot of y'; slots: first slots of the other results, as
        in `Scene`."""
        self.of_rates = rates
        parts = {"clock": self.clock, "residual": residual, "jacobian": jacobian, "rates": rates}
        self._parts = {name: part for name, part in parts.items() if part is not None and (part.steps or name != "rates")}
        self._all_parts = dict(self._parts)
        self._changes, slots["distance"] = changes, 0 if changes is None else changes.distance
        self._kept: list[Any] = [self.numbering]
        self.scene = Scene(n=self.n if unknowns is None else unknowns, dotted=self.n, at=self.at, rates=rates_at, **slots)
        self._widest = 2 * max(part.widest for part in self._parts.values()) + 1
        self._call_rates = core().scene_rates
        self._placed()
        self.make("clock")

    def _placed(self) -> None:
        """Give the operations an array of their own, with the numbers of `numbering`."""
        nb, scene = self.numbering, self.scene
        self.W, self._x = np.zeros(self.operations.size), np.zeros(self._widest)
        self.W[: nb.width] = nb.workspace()
        self.operations.fill(self.W)
        scene.W, scene.x, scene.read = self.W.ctypes.data, self._x.ctypes.data, nb.model.conditions.read.ctypes.data
        scene.t, scene.side, scene.bad, self.address = np.nan, np.nan, -1, ctypes.addressof(scene)
        (self._y, self._at_y), (self._yp, self._at_yp) = self.view(0, scene.n), self.view(self.n, scene.n)
        self._rates, self._at_rates = self.view(scene.rates, scene.n)

    def again(self, numbering: Numbering, source: Any = None) -> Self:
        """The same operations with the numbers of another model of the same shape."""
        made = object.__new__(type(self))  # `copy` makes its lists anew
        vars(made).update({name: value for name, value in vars(self).items() if name != "_entries"})
        made.numbering, made._kept = numbering, [*self._kept, numbering]
        made.scene = Scene.from_buffer_copy(self.scene)
        if source is not None:
            made.operations = self.operations.again(source)
            made._all_parts = {name: part.again(source) for name, part in self._all_parts.items()}
            made._parts = dict(made._all_parts)
            made.of_rates = made._parts.get("rates")
            made.scene.residual = made.scene.jacobian = made.scene.of_rates = Part()
        made._placed()
        if source is not None:
            made.make("clock")
        return made

    def make(self, *parts: str) -> None:
        """Compile those of the parts "residual", "jacobian" and "rates" that are not compiled yet; called before they run."""
        if "jacobian" in parts and self._changes is not None:
            self.make("residual", "rates")
            (self.scene.changes, kept), self._changes = self._changes.part.table(len(self.W)), None
            self._kept.append(kept)
        for name in self._parts.keys() & {*parts}:
            table, kept = self._parts.pop(name).table(len(self.W))
            setattr(self.scene, "of_rates" if name == "rates" else name, table)
            self._kept.append(kept)

    def view(self, first: int, count: int) -> tuple[Array, int]:
        """View of `count` numbers from slot `first` on, and its address, which callers store: NumPy takes long to tell it."""
        found = self.W[first : first + count]
        return found, found.ctypes.data

    def solved(self, t: float, y: Array, out: Array) -> int:
        """out[:] = y'. Returns the number of the row at which a factorisation failed, because it depends on those before it, or
        -1."""
        self.make("rates")
        self._y[:] = y
        code = self._call_rates(self.address, t, self._at_y, self._at_rates)
        out[:] = self._rates
        return int(self.scene.bad) if code > 0 else -1


class Evaluator(Workspace):
    """Evaluates named lists of operations at many states in C. A list is made when it is first asked for; `emitted` appends its
    operations and returns the slots of its results. Copies have no lists: tables contain addresses of arrays."""

    def __init__(self, numbering: Numbering, motion: Emitted | None = None) -> None:
        super().__init__(numbering, motion)
        self._made_of, self._owner = (numbering, motion), Owner("an evaluation")
        self._lists: dict[Any, tuple[Part, Any, int, int, int]] = {}
        self.finish()

    def __reduce__(self) -> tuple[Any, ...]:
        return Evaluator, self._made_of

    def again(self, numbering: Numbering, source: Any = None) -> Self:
        made = super().again(numbering, source)
        made._made_of, made._owner = (numbering, self._made_of[1]), Owner("an evaluation")
        return made

    def choose(self, name: Any, emitted: Callable[[Operations], Any]) -> None:
        """From now on `scene_values` of C evaluates this list, whose `width` numbers are the results."""
        if name not in self._lists:
            MAKING.waiting(self._list, name, emitted)
        table, _, widest, self.scene.rows, self.width = self._lists[name]
        if len(self.W) < self.operations.size or len(self._x) < widest:  # by this list, or by one of another model
            self._widest = max(self._widest, widest)
            self._placed()
        self.scene.residual = table

    def _list(self, name: Any, emitted: Callable[[Operations], Any]) -> None:
        part = self.operations.part(self.motion)
        found = np.asarray(emitted(part), dtype=np.intp).ravel()
        first = int(found[0]) if len(found) else 0
        if np.any(np.diff(found) != 1):
            first = self.operations.slots(len(found))
            part.set(first + np.arange(len(found)), found)
        self._lists[name] = *part.table(self.operations.size), part.widest, first, len(found)

    def at_states(self, name: Any, emitted: Callable[[Operations], Any], t: Array, y: Array, yp: Array | None = None) -> Array:
        """The results (k, width) of a list at times (k,), unknowns y (k, n or more) and their rates, 0 unless given."""
        return self._owner.waiting(self._evaluated, name, emitted, t, y, yp)

    def _evaluated(self, name: Any, emitted: Callable[[Operations], Any], t: Array, y: Array, yp: Array | None) -> Array:
        t, y = np.ascontiguousarray(t, dtype=float), np.ascontiguousarray(y, dtype=float)
        yp = None if yp is None else np.ascontiguousarray(yp, dtype=float)
        if y.shape != (len(t), max(self.n, y.shape[1])) or (yp is not None and yp.shape != y.shape):
            raise internal(f"states of shape {y.shape} were given at {len(t)} times: ({len(t)}, {self.n} or more) is needed")
        self.choose(name, emitted)
        out, states = np.empty((len(t), self.width)), [None if one is None else address(one) for one in (t, y, yp)]
        core().scene_values(self.address, len(t), *states, y.shape[1], self.width, address(out))
        return out
