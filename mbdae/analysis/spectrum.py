"""The roots of the second-order equations of a scene, the bounds of their errors, and what their signs say.

The signs of real parts are taken from the roots where these are larger than their errors, and from the structure of the equations
where it decides more: energy (mass positive, stiffness not negative, damping not negative: nothing grows), and the symmetry of
conservative and gyroscopic equations, whose roots lie in pairs beside the imaginary axis or alone on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from mbdae.analysis.reduced import Reduced
from mbdae.analysis.roots import EPS, Roots, parts, roots, scales, sign, solved
from mbdae.errors import OptionError
from mbdae.system.base import Array

Complex = NDArray[np.complex128]

#: largest number of states for which all eigenvalues are computed; with more, `count` has to be given, and only the lowest are
LARGEST = 1600


#: a root 0 of a motion that no force can resist counts as exact where its error is below this part of the smallest other root
NEXT = 1e-3
#: what is smaller than this part of a motion is rounding
SLIGHT = 1e-9


@dataclass(frozen=True)
class Structure:
    """What is known of the equations beside their numbers.

    surely(name, N): whether x^T S x >= 0 on the motions N x, for S = "K" or "C", is known law by law; asked where the sum of the
    laws does not show it. free(p): whether a motion p (nu,) is one that the whole scene, or its steady motion, may be shifted
    along; shifted(p): the same of turns of the scene about any axis too, and of bodies about the axes about which they turn.
    rate: of the frame's axes, rad/s."""

    surely: Callable[[str, Array], bool]
    free: Callable[[Complex], bool]
    shifted: Callable[[Array], bool] = lambda p: False
    rate: float = 0.0


UNKNOWN = Structure(lambda name, N: False, lambda p: False)  #: nothing is known


@dataclass(frozen=True)
class Spectrum:
    """Roots (k,) with imaginary part >= 0 by rising frequency, vectors (states, k), bounds of the errors of the roots (k,), and
    whether the motion is stable; None where the errors leave it open."""

    values: Complex
    vectors: Complex
    errors: Array
    stable: bool | None


def spectrum(r: Reduced, e: Reduced, count: int | None, known: Structure = UNKNOWN) -> Spectrum:
    """The spectrum of equations r with bounds e of the errors of their entries."""
    n, k = len(r.M), len(r.Es)
    if 2 * n + k > LARGEST and count is None:
        raise OptionError(f"the linearised scene has {2 * n + k} states, and all modes are computed up to {LARGEST} states only; "
                          f"ask for the lowest ones, such as s.linearize(count=20)")
    r, e = _without_noise(r, e)
    if 2 * n + k > LARGEST:
        return _lowest(r, e, int(count or 1))
    values, vectors = np.zeros(2 * n + k, dtype=complex), np.zeros((2 * n + k,) * 2, dtype=complex)
    errors, verdicts, at = np.zeros(2 * n + k), list[bool | None](), 0
    size = np.block([[np.abs(r.M) + np.abs(r.C) + np.abs(r.K), np.abs(r.B) + np.abs(r.D)],
                     [np.abs(r.S2) + np.abs(r.S1) + np.abs(r.S0), np.abs(r.Es) + np.abs(r.As)]])
    for part in parts(size):
        x, s = part[part < n], part[part >= n] - n
        found, verdict = _of_part(_cut(r, x, s), _cut(e, x, s), known)
        own = slice(at, at + len(found.values))
        values[own], errors[own] = found.values, found.errors
        vectors[np.r_[x, n + x, 2 * n + s], own] = found.vectors
        verdicts.append(verdict)
        at = own.stop
    keep = np.flatnonzero(values.imag >= 0)
    keep = keep[np.lexsort((values[keep].real, digits(values[keep].imag)))][:count]
    return Spectrum(values[keep], vectors[:, keep], errors[keep], together(verdicts))


def together(verdicts: list[bool | None]) -> bool | None:
    """The verdict on motions that do not influence each other."""
    return False if False in verdicts else None if None in verdicts else True


def digits(x: Array) -> Array:
    """x to twelve digits, so that rounding does not decide an order."""
    size = 10.0 ** np.floor(np.log10(np.maximum(np.abs(x), 1e-300)))
    return np.asarray(np.round(x / size, 12) * size)


def _without_noise(r: Reduced, e: Reduced) -> tuple[Reduced, Reduced]:
    """The equations with entries that are not larger than their errors set to 0, which adds to the errors."""
    values, errors = {}, {}
    for f in fields(Reduced):
        values[f.name], errors[f.name] = pair = getattr(r, f.name), getattr(e, f.name)
        if f.name not in ("whole", "N", "Y"):
            values[f.name], errors[f.name] = _beyond_errors(*pair)
    return Reduced(**values), Reduced(**errors)


def _beyond_errors(a: Array, d: Array) -> tuple[Array, Array]:
    noise = np.abs(a) <= d
    return np.where(noise, 0.0, a), np.where(noise, d + np.abs(a), d)


def _cut(r: Reduced, x: NDArray[np.intp], s: NDArray[np.intp]) -> Reduced:
    """The equations of some displacements x and internal states s."""
    rows = {"M": (x, x), "C": (x, x), "K": (x, x), "B": (x, s), "D": (x, s), "Es": (s, s), "As": (s, s), "S2": (s, x),
            "S1": (s, x), "S0": (s, x)}
    return replace(r, N=r.N[:, x], Y=r.Y[:, s], **{name: getattr(r, name)[np.ix_(*at)] for name, at in rows.items()})


def _of_part(r: Reduced, e: Reduced, known: Structure) -> tuple[Roots, bool | None]:
    """All roots of motions that are coupled, and the verdict on them. Motions that nothing resists or drives have two roots 0
    each, without error, and spoil no other root: the others are M-orthogonal to them."""
    n, Z = len(r.M), _unresisted(r, e, known)
    k = Z.shape[1]
    if 0 < k < n:
        W = scipy.linalg.null_space((r.M @ Z / np.linalg.norm(r.M @ Z, axis=0)).T)
        size = Reduced(**{f.name: np.abs(getattr(r, f.name)) for f in fields(Reduced)})
        off = {f.name: getattr(e, f.name) + 2 * n * EPS * getattr(size, f.name) for f in fields(Reduced)}
        rest, verdict = _of_part(_on(r, W), _on(Reduced(**off), np.abs(W)), known)
        vectors = np.zeros((2 * n, 2 * n), dtype=complex)
        vectors[:n, : 2 * k], vectors[:, 2 * k :] = np.hstack([Z, Z]), np.kron(np.eye(2), W) @ rest.vectors
        values, errors, alone = (np.r_[x, y] for x, y in ((np.zeros(2 * k), rest.values), (np.zeros(2 * k), rest.errors),
                                                          (np.ones(2 * k, dtype=bool), rest.alone)))
        return Roots(values, vectors, errors, alone), verdict
    (E, A), (dE, dA) = r.first_order(), e.first_order()
    dE[:n, :n], dA[:n, n : 2 * n] = 0.0, 0.0  # x' is x', without error
    held = np.flatnonzero(~np.any(r.Y, axis=0)) + 2 * n  # states that are no displacements

    def exact(X: Array) -> bool:
        motions = np.hstack([r.displacements(x) for x in (X, np.linalg.lstsq(E, -A @ X, rcond=None)[0])])
        size = np.max(np.abs(motions), axis=0)
        return not np.any(np.abs(X[held]) > SLIGHT) and all(known.shifted(p) for p in motions[:, size > SLIGHT * np.max(size)].T)

    found, mirrored = _beside_shifts(E, A, dE, dA, exact)
    still = np.flatnonzero(~np.any(found.vectors[:n], axis=0) & ~np.any(found.vectors[2 * n :], axis=0))
    found.vectors[:n, still] = found.vectors[n : 2 * n, still]  # of a drift the way it goes
    verdict, undamped, paired = _by_energy(r, e, known)
    paired |= not len(r.Es) and bool(np.all(np.abs(r.C) <= e.C))
    values, errors = found.values.copy(), found.errors
    if undamped:
        values.real = 0.0
    elif verdict:
        values.real = np.minimum(values.real, 0.0)
    mirrored = (mirrored | paired) & found.alone
    values.real[mirrored & (np.abs(values.real) <= errors)] = 0.0
    zero = (np.abs(values) <= errors) & (values != 0)
    errors = np.where(zero, errors + np.abs(values), errors)
    settled = (values.real + errors <= 0) | mirrored & (values.real == 0) | (errors == 0) & (values == 0)
    values = np.where(zero, 0.0, values)
    if paired and verdict is None:
        shifts = exact_zeros(values, errors, r.displacements(found.vectors), known)
        settled |= shifts
        values.real[shifts] = 0.0
    if verdict is None:
        verdict = False if np.any(values.real > errors) else True if np.all(settled) else None
    return replace(found, values=values, errors=errors), verdict


def _unresisted(r: Reduced, e: Reduced, known: Structure) -> Array:
    """Z (n, k): exact shifts that neither stiffness nor damping resists, and into which neither drives, K Z = C Z = 0 and
    Z^T K = Z^T C = 0 within the errors; none where there are internal states."""
    n, (Z, off) = len(r.M), (np.zeros((len(r.M), 0)), 0.0) if len(r.Es) or not np.any(r.K) else _null(r.M, r.K, e.K)
    for S, dS in ((r.K, e.K), (r.K.T, e.K.T), (r.C, e.C), (r.C.T, e.C.T)) if Z.shape[1] else ():
        bound = (dS + 2 * n * EPS * np.abs(S)) @ np.abs(Z) + np.abs(S) @ off
        if np.any(np.abs(S @ Z) > bound):  # along some of them
            _, sizes, along = np.linalg.svd(S @ Z)
            free = along[np.pad(sizes, (0, len(along) - len(sizes))) <= np.linalg.norm(bound)].T
            Z, off = Z @ free, off @ np.abs(free)
    massive = Z.shape[1] > 0 and np.linalg.cond(Z.T @ r.M @ Z) < 1 / NEXT**4
    return Z if massive and all(known.shifted(p) for p in (r.N @ Z).T) else Z[:, :0]


def _on(r: Reduced, W: Array) -> Reduced:
    """The equations, without internal states, on the motions x = W y."""
    N, Y = r.N @ W, r.Y
    return replace(r, N=N, Y=Y, **{name: W.T @ getattr(r, name) @ W for name in "MCK"}, **{
        name: np.zeros((W.shape[1], 0)) for name in "BD"}, **{name: np.zeros((0, W.shape[1])) for name in ("S2", "S1", "S0")})


def exact_zeros(values: Complex, errors: Array, motions: Complex, known: Structure) -> NDArray[np.bool_]:
    """Which roots 0 of equations with pairs of roots z, -z are exact: those of motions (nu, k) that no force can resist. In axes
    that turn with `known.rate` shifts along fixed directions have the root i rate."""
    turning = np.abs(np.abs(values.imag) - known.rate) + np.abs(values.real) <= errors
    least = float(np.min(np.abs(values), where=values != 0, initial=np.inf))
    small = ((values == 0) | (turning & (known.rate > 0))) & (errors <= NEXT * least)
    return np.array([bool(small[i]) and known.free(motions[:, i]) for i in range(len(values))], dtype=bool)


def _beside_shifts(E: Array, A: Array, dE: Array, dA: Array,
                   exact: Callable[[Array], bool]) -> tuple[Roots, NDArray[np.bool_]]:
    """`roots` with roots that are 0 exactly split off first, so that they spoil no other one: those of unknowns that nothing
    depends on, and of X with A X = 0 within the errors that are `exact`; then those that only these depend on (a heading turns
    the way of a wheel), and so on. With X = Z a + W b and P^T E Z = 0 the rest is P^T E W b' + P^T A W b = 0. With it (n,) of
    which roots z it is certain that -z is one too."""
    n, kept, Z, (e, a, de, da) = len(E), np.arange(len(E)), np.zeros((len(E), 0)), (E, A, dE, dA)
    while len(kept):
        null = ~np.any(a, axis=0) & ~np.any(da, axis=0)
        V, off = (np.eye(len(kept))[:, null], 0.0) if np.any(null) else _null(e, a, da)
        whole = np.zeros((n, V.shape[1]))
        whole[kept] = V
        if not V.shape[1] or not (np.any(null) or exact(whole)):
            break
        split = _without(V, off, e, a, de, da)
        if split is None:
            break
        rest, (e, a, de, da) = split
        kept, Z = kept[rest], np.hstack([Z, whole])
    (e, de), (a, da) = (_beyond_errors(x, dx) for x, dx in ((e, de), (a, da)))
    some, k = roots(e, a, de, da), Z.shape[1]
    mirrored = np.r_[np.zeros(k, dtype=bool), _mirrored(e, a)]
    if not k:
        return some, mirrored
    vectors = np.zeros((n, n), dtype=complex)
    vectors[:, :k], vectors[np.ix_(kept, k + np.arange(n - k))] = Z, some.vectors
    for i in np.flatnonzero(some.values):
        P, X = some.values[i] * E + A, vectors[:, k + i]
        X += Z @ np.linalg.lstsq(P @ Z, -P @ X, rcond=None)[0]
    values, errors = (np.r_[np.zeros(k), x] for x in (some.values, some.errors))
    return Roots(values, vectors, errors, np.r_[np.ones(k, dtype=bool), some.alone]), mirrored


def _mirrored(E: Array, A: Array) -> NDArray[np.bool_]:
    """Of which unknowns (n,) the roots come in pairs z, -z, as those of a motion whose mirror image is its reverse (a coin that
    rolls straight ahead): with signs of rows and unknowns that leave E as it is and turn A into -A."""
    n, ((ei, ej), (ai, aj)) = len(E), (np.nonzero(x) for x in (E, A))
    rows, columns = np.r_[ei, ei + n, ai, ai + n], 2 * n + np.r_[ej, ej + n, aj + n, aj]
    label = connected_components(csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(4 * n, 4 * n)), directed=False)[1]
    return np.asarray(label[2 * n : 3 * n] != label[3 * n :])


def _null(E: Array, A: Array, dA: Array) -> tuple[Array, Any]:
    """V (n, k) with A V = 0 within errors dA of the entries, 1 in a row of each column alone, and a bound of its own errors; none
    where the other directions are not clearly apart from these."""
    rows, columns = scales(np.abs(E) + np.abs(A))
    scaled, off = A * rows[:, None] * columns, dA * rows[:, None] * columns
    least = float(np.linalg.norm(off)) + len(A) * EPS * float(np.linalg.norm(scaled))
    x = solved(scaled, np.random.default_rng(13).normal(size=(len(A), 1)))
    if np.max(np.abs(x)) * least <= NEXT / len(A):  # far from singular: no decomposition is needed
        return np.zeros((len(A), 0)), 0.0
    _, sizes, directions = np.linalg.svd(scaled)
    V = directions[sizes <= least].T
    if not V.shape[1] or np.any((sizes > least) & (sizes * NEXT <= least)):
        return V[:, :0], 0.0
    pivots = scipy.linalg.qr(V.T, mode="r", pivoting=True)[1][: V.shape[1]]
    V = V @ np.linalg.inv(V[pivots])
    V[pivots] = np.eye(len(pivots))
    V = np.where(np.abs(V) <= len(A) * EPS * np.max(np.abs(V), axis=0), 0.0, V)
    rest = np.setdiff1d(np.arange(len(A)), pivots)
    left = off @ np.abs(V) + np.abs(scaled @ V)
    error = np.zeros(V.shape)
    error[rest] = np.abs(np.linalg.pinv(scaled[:, rest])) @ left
    V, error = (columns[:, None] * x / columns[pivots] for x in (V, error))
    return V, error


def _without(V: Array, off: Any, E: Array, A: Array, dE: Array, dA: Array) -> tuple[NDArray[np.intp], tuple[Array, ...]] | None:
    """The unknowns beside V (n, k), which has the identity in k rows and errors up to `off`, and E, A, dE, dA of these; None
    where the rates of V are not determined."""
    k = V.shape[1]
    place = np.argmax((np.abs(V) == 1) & (np.count_nonzero(V, axis=1) == 1)[:, None], axis=0)
    rest = np.setdiff1d(np.arange(len(V)), place)
    moved = E @ V
    size = np.max(np.abs(E), axis=1, initial=1e-300)[:, None]
    rows = scipy.linalg.qr((moved / size).T, mode="r", pivoting=True)[1][:k]
    others = np.setdiff1d(np.arange(len(V)), rows)
    if np.linalg.cond(moved[rows]) > 1 / NEXT**2:
        return None
    inverse = np.linalg.inv(moved[rows])
    L = moved[others] @ inverse
    error = dE @ np.abs(V) + np.abs(E) @ np.broadcast_to(off, V.shape) + EPS * np.abs(E) @ np.abs(V) * np.any(L)
    dL = (error[others] + np.abs(L) @ error[rows]) @ np.abs(inverse)
    found = [M[np.ix_(others, rest)] - L @ M[np.ix_(rows, rest)] for M in (E, A)]
    errors = [dM[np.ix_(others, rest)] + np.abs(L) @ dM[np.ix_(rows, rest)] + dL @ np.abs(M[np.ix_(rows, rest)])
              + EPS * np.abs(L) @ np.abs(M[np.ix_(rows, rest)]) for M, dM in ((E, dE), (A, dA))]
    return rest, (*found, *errors)


def _by_energy(r: Reduced, e: Reduced, known: Structure) -> tuple[bool | None, bool, bool]:
    """What the energy of coupled motions without internal states says of their growth (None: nothing), whether they neither grow
    nor decay, and whether their roots lie in pairs z, -z (conservative and gyroscopic forces)."""
    if len(r.Es) or not (_symmetric(r.M, e.M) and _symmetric(r.K, e.K) and sign(r.M, e.M) > 0):
        return None, False, False
    damping, error = (r.C + r.C.T) / 2, (e.C + e.C.T) / 2
    undamped, turning = bool(np.all(np.abs(damping) <= error)), not _symmetric(r.C, e.C)
    passive = undamped or sign(damping, error) > 0 or known.surely("C", r.N)
    stiff = sign(r.K, e.K) if passive else 0
    if passive and (stiff > 0 or (stiff == 0 and (known.surely("K", r.N) or _but_for_shifts(r, e, known)))):
        return True, undamped, undamped
    # without gyroscopic forces nothing holds a motion that lowers the potential energy
    return False if passive and stiff < 0 and not turning else None, False, undamped


def _but_for_shifts(r: Reduced, e: Reduced, known: Structure) -> bool:
    """Whether the stiffness is positive but for motions that no force can resist."""
    squares, X = scipy.linalg.eigh((r.K + r.K.T) / 2, (r.M + r.M.T) / 2)
    size = np.abs(X)
    off = 2 * np.einsum("nk,nk->k", size, e.K @ size + (e.M @ size) * np.abs(squares))
    off += EPS * np.max(np.abs(squares)) * len(squares)
    zero = np.abs(squares) <= off
    exact = exact_zeros(np.where(zero, 0.0, np.sqrt(np.abs(squares)) + 0j), np.sqrt(2 * off), r.N @ X, known)
    return bool(np.all((squares > off) | exact))


def _symmetric(S: Array, dS: Array) -> bool:
    return bool(np.all(np.abs(S - S.T) <= dS + dS.T))


def _lowest(r: Reduced, e: Reduced, count: int) -> Spectrum:
    """The roots nearest to zero by inverse iteration (Arnoldi), from both sides."""
    from scipy.sparse.linalg import LinearOperator, eigs

    (E, A), (dE, dA) = r.first_order(), e.first_order()
    shift = 1e-6 * (float(np.linalg.norm(A) / np.linalg.norm(E)) or 1.0)
    factors = scipy.linalg.lu_factor(A + shift * E)
    begin, k = np.random.default_rng(3).normal(size=len(A)), min(2 * count + 2, len(A) - 2)
    found = []
    for transposed in (0, 1):
        matrix = E.T if transposed else E
        inverse = LinearOperator(A.shape, matvec=lambda x, m=matrix, t=transposed: scipy.linalg.lu_solve(factors, m @ x, trans=t))
        found.append(eigs(inverse, k=k, which="LM", v0=begin))
    (values, V), (others, W) = found
    W = W[:, np.argmin(np.abs(values[:, None] - others), axis=1)]
    values = shift - 1 / values
    left = np.abs(W).T
    below = np.abs(np.einsum("nk,nk->k", W, E @ V))
    bound = np.einsum("kn,nk->k", left, dA @ np.abs(V) + dE @ (np.abs(V) * np.abs(values)))
    off = np.abs(np.einsum("nk,nk->k", W, A @ V + (E @ V) * values))
    errors = (bound + off) / np.maximum(below, 1e-300)
    values = np.where(np.abs(values.imag) <= np.minimum(errors, 1e-9 * np.abs(values)), values.real + 0j, values)
    keep = np.flatnonzero(values.imag >= 0)
    keep = keep[np.lexsort((values[keep].real, digits(values[keep].imag)))][:count]
    grows = bool(np.any(values.real > errors))
    return Spectrum(values[keep], V[:, keep], errors[keep],
                    False if grows else True if np.all(values.real + errors <= 0) else None)
