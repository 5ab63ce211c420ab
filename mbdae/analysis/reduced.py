"""The displacements that constraints allow, and the equations on them: second order, dense, with bounds of their errors.

Also here: how a simple root changes with numbers of the scene."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from mbdae.analysis.pencil import ROUNDED, Pencil, acting_states
from mbdae.errors import AccuracyWarning, DerivativeError, MbdaeError, OptionError
from mbdae.study.statements import changed, stated_value
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics

#: a constraint row counts as dependent on others where its part independent of them is at most this times that of the most
#: independent row (rows of length 1)
DEPENDENT = 1e-9

#: nodes of differences of roots; their distance over the number, and by what they are taken closer where roots are near
SIDES, DISTANCE, CLOSER = (1, -1, 2, -2, 3, -3), 4e-3, 16.0
ALIKE = 1e-6  #: roots nearer to each other than this share of their size count as one


def refuse_rolling(mechanics: Mechanics, analysis: str, instead: str) -> None:
    """Raise OptionError where a scene has rows of velocities, which this analysis does not know; instead: what to do."""
    for row in mechanics.rows:
        if row.by_rates:
            raise OptionError(f"{analysis}: '{row.name}' is a row of velocities (rolling, a blade), which restricts motions and "
                              f"no places; {instead}")


def free_basis(G: Array, units: Array) -> Array:
    """(nu, freedoms) basis of the displacements that rows G (m, nu) allow; orthonormal after division by `units` (nu,).
    Displacements that no rows connect are not mixed."""
    if not len(G):
        return np.diag(units)
    scaled = G * units
    norms = np.linalg.norm(scaled, axis=1, keepdims=True)
    scaled = scaled / np.where(norms > 0, norms, 1.0)
    columns = []
    for at, rows in _connected(scaled):
        if not len(rows):
            columns.append((at, np.ones((1, 1))))
            continue
        Q, R, _ = scipy.linalg.qr(scaled[np.ix_(rows, at)].T, pivoting=True)
        d = np.abs(np.diag(R))
        columns.append((at, Q[:, int(np.sum(d > DEPENDENT * d[0])) :]))
    N, first = np.zeros((len(units), sum(Q.shape[1] for _, Q in columns))), 0
    for at, Q in columns:
        N[np.ix_(at, first + np.arange(Q.shape[1]))] = units[at, None] * Q
        first += Q.shape[1]
    return N


def _connected(G: Array) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Displacements that rows G connect, with the rows, in the order of the first of them."""
    nu = G.shape[1]
    joined = sp.bmat([[None, sp.csr_matrix(G.T)], [sp.csr_matrix(G), None]])
    label = connected_components(joined, directed=False)[1]
    parts = [np.flatnonzero(label == k) for k in dict.fromkeys(label[:nu])]
    return [(at[at < nu], at[at >= nu] - nu) for at in parts]


def basis_error(N: Array, units: Array) -> Array:
    """Bound of the errors of a `free_basis` N, in its shape: rounding in proportion to the longest entry of each column."""
    return np.where(N != 0, ROUNDED * units[:, None] * np.max(np.abs(N) / units[:, None], axis=0, initial=0.0), 0.0)


@dataclass(frozen=True)
class Reduced:
    """M x'' + C x' + K x + B s' + D s = 0, Es s' + As s + S2 x'' + S1 x' + S0 x = 0; displacements p = N x + Y s.

    K is symmetric where the loads are conservative. whole: basis of the displacements that constraints of positions allow. Where
    rows of velocities restrict the motion further, N are those along which they let the scene move, and the others Y are states.
    """

    whole: Array
    N: Array
    Y: Array
    M: Array
    C: Array
    K: Array
    B: Array
    D: Array
    Es: Array
    As: Array
    S2: Array
    S1: Array
    S0: Array

    def first_order(self) -> tuple[Array, Array]:
        """E, A of E X' + A X = 0 with X = (x, x', s)."""
        n, k = len(self.M), len(self.Es)
        one, zero, side = np.eye(n), np.zeros((n, n)), np.zeros((n, k))
        E = np.block([[one, zero, side], [zero, self.M, self.B], [side.T, self.S2, self.Es]])
        A = np.block([[zero, -one, side], [self.K, self.C, self.D], [self.S0, self.S1, self.As]])
        return E, A


    def displacements(self, vectors: Any) -> Any:
        """p (nu, k) of vectors (x, x', s) in columns."""
        n = len(self.M)
        return self.N @ vectors[:n] + self.Y @ vectors[2 * n :]


def reduced(p: Pencil, N: Array, Z: Array | None = None) -> Reduced:
    """The pencil on the displacements N x: constraint forces drop out, algebraic unknowns are eliminated. N: basis of those that
    constraints of positions allow; Z: of those x along which rows of velocities let the scene move, None: found here."""
    found = _reduced(p, N, N, acting_states(p), p.kinematics)
    if not len(p.places.get("r", ())):
        return found
    B1, B0 = _rates(p, p.A, N)
    Z = free_basis(B1, np.ones(N.shape[1])) if Z is None else Z
    Y = np.linalg.qr(B1.T)[0]
    return _rolling(found, Z, Y, np.linalg.solve(B1 @ Y, B0))


def _rates(p: Pencil, A: Any, N: Array) -> tuple[Array, Array]:
    """B1, B0 of the rows of velocities B1 x' + B0 x = 0; A: that of p, or its errors."""
    w = p.part(A, "r", "w")
    return np.asarray(w @ N), np.asarray(p.part(A, "r", "p") @ N + w @ (p.kinematics @ N))


def _rolling(r: Reduced, Z: Array, Y: Array, B: Array, sign: float = -1.0) -> Reduced:
    """Equations r of x = Z a + Y b with the rows b' + B x = 0, as equations of a with the further states b."""
    k, one = len(r.Es), np.eye(len(B))
    drift = sign * (Y @ B)  # x'' = Z a'' + drift x', x' = Z a' + Y b'
    C, S1 = r.C + r.M @ drift, r.S1 + r.S2 @ drift
    Es = np.block([[r.Es, S1 @ Y], [np.zeros((len(B), k)), one]])
    As = np.block([[r.As, r.S0 @ Y], [np.zeros((len(B), k)), B @ Y]])
    none = np.zeros((len(B), Z.shape[1]))
    return Reduced(r.whole, r.N @ Z, np.hstack([r.Y, r.N @ Y]), Z.T @ r.M @ Z, Z.T @ C @ Z, Z.T @ r.K @ Z,
                   Z.T @ np.hstack([r.B, C @ Y]), Z.T @ np.hstack([r.D, r.K @ Y]), Es, As,
                   np.vstack([r.S2 @ Z, none]), np.vstack([S1 @ Z, none]), np.vstack([r.S0 @ Z, B @ Z]))


def _reduced(p: Pencil, N: Array, left: Array, s: Any, kinematics: Any) -> Reduced:
    """`reduced` with the internal states s and the matrix of `Pencil.kinematics`; left: the motions along which the forces are
    resolved."""
    z = p.places["z"]
    out: dict[str, list[Array]] = {}
    for rows, at in (("w", p.places["w"]), ("s", s), ("z", z)):
        along = left.T if rows == "w" else np.eye(len(at))
        E, A = p.E[at], p.A[at]
        Ep, Ew, Ap, Aw = (m[:, p.places[k]] for m in (E, A) for k in "pw")
        second, first = Ew @ N, Ep @ N + Ew @ (kinematics @ N) + Aw @ N
        zeroth = Ap @ N + Aw @ (kinematics @ N)
        others = (m.toarray() for m in (E[:, s], A[:, s], A[:, z]))
        out[rows] = [np.asarray(along @ m) for m in (second, first, zeroth, *others)]
    if len(z):
        _eliminate(out)
    (M, C, K, B, D, _), (S2, S1, S0, Es, As, _) = out["w"], out["s"]
    return Reduced(N, N, np.zeros((len(N), len(Es))), M, C, K, B, D, Es, As, S2, S1, S0)


def errors_of(p: Pencil, r: Reduced, units: Array) -> Reduced:
    """Bounds of the errors of the matrices r of a pencil without algebraic unknowns: by those of p, and by that of the basis."""
    assert p.errors is not None
    N = r.whole
    s, size, off, sizes = acting_states(p), np.abs(N), basis_error(N, units), replace(p, E=abs(p.E), A=abs(p.A))
    turn = abs(p.kinematics)
    own = _reduced(p.errors, size, size, s, 2 * turn)  # twice: the errors of the turn itself are in proportion to it
    right, left = _reduced(sizes, off, size, s, turn), _reduced(sizes, size, off, s, turn)
    e = replace(own, M=own.M + right.M + left.M, C=own.C + right.C + left.C, K=own.K + right.K + left.K, B=own.B + left.B,
                D=own.D + left.D, S2=own.S2 + right.S2, S1=own.S1 + right.S1, S0=own.S0 + right.S0)
    return e if not len(p.places.get("r", ())) else _errors_of_rates(p, e)


def _errors_of_rates(p: Pencil, e: Reduced) -> Reduced:
    """The bounds of errors e carried on as `reduced` carries the equations to the motions that rows of velocities allow."""
    assert p.errors is not None
    N, full = e.whole, _reduced(p, e.whole, e.whole, acting_states(p), p.kinematics)
    (B1, B0), (dB1, dB0) = _rates(p, p.A, N), _rates(p, p.errors.A, np.abs(N))
    Z, Y = free_basis(B1, np.ones(N.shape[1])), np.linalg.qr(B1.T)[0]
    inverse = np.linalg.inv(B1 @ Y)
    # entries of the bases are rounded in proportion to the largest of their columns
    aslant, Y_rounded = (basis_error(basis, np.ones(len(basis))) for basis in (Z, Y))
    B, Z, Y = np.abs(inverse @ B0), aslant / ROUNDED, Y_rounded / ROUNDED
    dB = np.abs(inverse) @ (np.abs(dB0) + np.abs(dB1) @ Y @ B) + 4 * ROUNDED * B
    size = replace(full, **{f.name: np.abs(getattr(full, f.name)) for f in fields(Reduced)})
    own, rounded = _rolling(e, Z, Y, B, 1.0), _rolling(size, Z, Y, B, 1.0)
    found = {f.name: getattr(own, f.name) + ROUNDED * getattr(rounded, f.name) for f in fields(Reduced)}
    forces, states = size.M @ (Y @ dB), size.S2 @ (Y @ dB)
    k = len(full.Es)
    found["C"] += Z.T @ forces @ Z
    found["B"][:, k:] += Z.T @ forces @ Y
    found["S1"][:k] += states @ Z
    found["Es"][:k, k:] += states @ Y
    # the rows b' + B x = 0
    across = np.abs(inverse) @ (np.abs(B1) @ aslant + np.abs(dB1) @ Z)
    found["Es"][k:], found["As"][k:, :k], found["As"][k:, k:], found["S0"][k:] = 0.0, 0.0, dB @ Y, dB @ Z
    found["S1"][k:] = across
    return Reduced(**found)


def _eliminate(out: dict[str, list[Array]]) -> None:
    """Solve the rows of the algebraic unknowns z for z, and insert z into the other rows."""
    *others, own = out["z"]
    for rows in ("w", "s"):
        for i, block in enumerate(others):
            out[rows][i] = out[rows][i] - out[rows][5] @ np.linalg.solve(own, block)


# -- derivatives of roots


class TracedRoot:
    """A simple root as a number of the scene changes: of scenes with other values of it the same analysis is made, at their own
    equilibrium, and the root nearest to where those before lead is taken.

    Left and right vectors would give its derivative by that of the matrices; these are known by differences of the scene alone,
    along which the root itself is known to rounding."""

    def __init__(self, owner: Any, root: complex, number: int) -> None:
        self.owner, self.root, self.called = owner, root, f"mode {number + 1} with the root {root:.6g}"
        if at_kink(owner):
            raise DerivativeError(f"there are no derivatives of {self.called}: a law has a kink exactly at the state")
        if owner._again is None:
            raise DerivativeError(f"there are no derivatives of {self.called}: it is that of a state of a run, which changes "
                                  "with the numbers too; make the analysis at s.equilibrium() or at the start of the scene")
        self.gap, self.error = self._apart(owner, root)
        if self.gap <= max(ALIKE * abs(root), 4 * self.error):
            raise DerivativeError(f"{self.called} has no derivative: it is not simple, another root is {self.gap:.1e} away, and "
                                  f"its own error is {self.error:.1e}; roots that coincide part in directions that depend on all "
                                  "numbers: break the symmetry, or compare analyses of two values")

    @staticmethod
    def _apart(owner: Any, root: complex) -> tuple[float, float]:
        """Distance to the nearest other root, and the error of the root itself."""
        roots = np.asarray(owner.roots)
        own = int(np.argmin(np.abs(roots - root)))
        others = np.concatenate([np.delete(roots, own), roots[roots.imag > 0].conj()])
        return float(np.min(np.abs(others - root), initial=np.inf)), float(owner.root_errors[own])

    def by(self, name: str) -> Any:
        """The derivative by a number, with its error."""
        from mbdae.derivatives import Derivative
        from mbdae.derivatives.chart import refused

        stated, closer, problem = stated_value(self.owner.prepared.model.scene, name, 1.0), 1.0, ""
        for nodes in (SIDES, SIDES, SIDES, (0, 1, 2, 3, 4, 5, 6), (0, -1, -2, -3, -4, -5, -6)):
            distance = DISTANCE / closer * (abs(stated) or min(self.owner.prepared.length, 1.0))
            try:
                found = self._differenced(name, nodes, distance)
            except _LostError as error:  # roots are near to each other
                closer, problem = closer * CLOSER, str(error)
                continue
            except MbdaeError as error:  # the scene has no such analysis on this side
                problem = str(error)
                continue
            return Derivative(complex(*found.found), float(np.hypot(*found.doubt)) + 2 * self.error / distance)
        refused(name, f"{self.called} cannot be followed to other values of it ({problem})")

    def _differenced(self, name: str, nodes: Sequence[int], distance: float) -> Any:
        from mbdae.derivatives.chart import differenced

        known = {0: self.root}

        def at(node: int) -> Array:
            if node not in known:
                inner = node - int(np.sign(node))
                ahead = known[inner] - known[inner - int(np.sign(node))] if inner else 0.0
                known[node] = self._nearest(name, distance * node, known[inner] + ahead)
            return np.array([known[node].real, known[node].imag])

        return differenced(at, nodes, distance)

    def _nearest(self, name: str, off: float, expected: complex) -> complex:
        """The root of the scene whose number is larger by `off`, near the one expected."""
        kept = self.owner._with_number.setdefault((name, off), None)
        if kept is None:
            scene, _ = changed(self.owner.prepared.model.scene, name, lambda stated: stated + off)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)
                kept = self.owner._with_number[name, off] = np.asarray(self.owner._again(scene).roots)
        away = np.abs(kept - expected)
        own = int(np.argmin(away))
        if away[own] > self.gap / 4 or np.min(np.delete(away, own), initial=np.inf) < self.gap / 2:
            raise _LostError("other roots are too near")
        return complex(kept[own])


def at_kink(owner: Any) -> bool:
    """Whether a law has a kink exactly at the state, or at one of the motion, of an analysis."""
    return bool(getattr(owner, "sides", ())) or not getattr(owner, "_smooth", True)


class _LostError(Exception):
    """A root cannot be told from others."""
