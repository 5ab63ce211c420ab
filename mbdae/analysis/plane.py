"""Stiffness of the motions that constraints allow: which have none, and in how many directions it is negative.

Scenes of rigid bodies are small: their stiffness is reduced to the free motions and decomposed. Beams have many nodes:
the tangent stays sparse, inverse iteration finds motions without stiffness, a factorisation the number of negative directions.

Stability of a planar scene against motions that leave its plane, which its own equations do not have.

The same scene in space, at the same state, is linearised; motions in the plane and out of it do not influence each other there,
and those out of it are looked at alone.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu, spsolve

from mbdae.analysis.frame import IDENTITY, attitude, body_of, frame_at, stresses_of
from mbdae.analysis.modes import growth, softest_beam
from mbdae.analysis.pencil import ROUNDED, Pencil, complete_system
from mbdae.analysis.reduced import errors_of, free_basis, reduced
from mbdae.analysis.spectrum import Spectrum, spectrum
from mbdae.analysis.state import pencil_with_errors, structure
from mbdae.errors import EquilibriumError, MbdaeError, warn
from mbdae.formulations import Index3
from mbdae.scene.components import Beam
from mbdae.scene.models import not_joined
from mbdae.scene.scene import SceneData
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.model.nodes import Node, drawn_quaternion, quaternion_product, turned
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import Prepared, modelled, prepare
from mbdae.system.start import Start

#: a stiffness of at most this part of the sizes of its terms counts as none in scenes with dense matrices; a negative one beyond
#: it counts as a direction in which the state is unstable
SOFT = 1e-11
#: rounding error of a stiffness, relative to the largest entry of the tangent; a stiffness up to it counts as none
ROUND_OFF = 1e-14
#: stiffness against violations of the constraint rows, relative to the largest entry of the scene's stiffness matrix: it makes
#: all motions that the constraints forbid stiff, so that negative directions are counted among the allowed ones only
CLAMP = 3.0
#: asymmetry that counts as rounding, relative to the largest entry; loads with a larger one count as not conservative
SYMMETRIC = 1e-6
PROBES = 6  #: largest number of vectors of the inverse iteration that finds the softest motions


@dataclass(frozen=True)
class Tangent:
    """The linearised equations at a point, K x = right: of forces, internal states, algebraic unknowns and constraints.

    x = (p, s, z, c, torque): displacements p (nu,), internal states s, algebraic unknowns z and multipliers c as in `Pencil`, and
    the torque (N m) that holds the angle of a freely turning frame, where there is one. p: the linearisation with its places of
    those kinds; hold (1 or 0, nu): the row of that angle, a constraint too; units (nu,): sizes of the displacements."""

    p: Pencil
    K: Any
    right: Array
    hold: Array
    units: Array

    @property
    def nu(self) -> int:
        """Number of displacements."""
        return len(self.units)

    @property
    def inner(self) -> int:
        """Number of internal states and algebraic unknowns."""
        return len(self.p.places["s"]) + len(self.p.places["z"])

    @cached_property
    def N(self) -> Array:
        """(nu, freedoms) displacements that constraints allow."""
        return free_basis(np.vstack([self.p.constraints, self.hold]), self.units)

    @cached_property
    def condensed(self) -> Any:
        """(nu, nu) sparse: the tangent of the displacements, with internal states and algebraic unknowns eliminated."""
        nu, inner = self.nu, slice(self.nu, self.nu + self.inner)
        K = self.K[:nu, :nu]
        if not self.inner:
            return K.tocsc()
        own, below, beside = self.K[inner, inner].tocsc(), self.K[inner, :nu].tocsc(), self.K[:nu, inner]
        diagonal = own.diagonal()
        if own.nnz == np.count_nonzero(diagonal) == len(diagonal):
            return (K - beside @ sp.diags(1 / diagonal) @ below).tocsc()
        try:
            return (K - beside @ sp.csc_matrix(spsolve(own, below)).reshape(below.shape)).tocsc()
        except RuntimeError:  # which SciPy raises for a singular matrix
            raise EquilibriumError("no single state at rest: an internal state of the scene, or a combination of some, is an "
                                   "integrator: its rate does not depend on its own value, and it stays where a run has brought "
                                   "it; simulate until it rests, and linearize there, s.linearize(at=r)") from None


class DenseStiffness:
    """The stiffness of small scenes, by singular values and eigenvalues."""

    def __init__(self, T: Tangent) -> None:
        size = np.abs(T.N) / T.units[:, None]
        self.T, self.full = T, T.condensed.toarray()
        self.N = np.where(size <= ROUNDED * np.max(size, axis=0, initial=0.0), 0.0, T.N)  # nothing moves by rounding
        self.reduced = self.N.T @ self.full @ self.N

    @cached_property
    def scales(self) -> Array:
        """(freedoms,) roots of the sizes of the stiffnesses, so that one spring does not hide another; where one has none, the
        root of what rounding of the largest leaves."""
        size = np.abs(self.N).T @ np.abs(self.full) @ np.abs(self.N)
        largest = float(np.max(size, initial=0.0))
        return np.sqrt(np.maximum(np.diagonal(size), ROUND_OFF**2 * largest)) if largest else np.ones(len(size))

    def softest(self) -> tuple[Array, Array, float]:
        """Stiffnesses in rising order, their motions (nu, k), and the size up to which a stiffness counts as none."""
        if not len(self.reduced):
            return np.zeros(0), np.zeros((self.T.nu, 0)), 0.0
        _, sizes, right = np.linalg.svd(self.reduced / self.scales / self.scales[:, None])
        if sizes[-1] <= SOFT:
            return sizes[::-1], self.T.N @ (right[::-1] / self.scales).T, SOFT
        _, sizes, right = np.linalg.svd(self.reduced)
        return sizes[::-1], self.T.N @ right[::-1].T, 0.0

    @property
    def symmetric(self) -> bool:
        """True without a test: it only decides whether a stable state is searched for, which costs little for small scenes."""
        return True

    def negative(self, inertia: Any = None) -> int:
        """Number of directions in which the symmetric part, or that of K + inertia, is negative."""
        K = self.reduced if inertia is None else self.reduced + self.T.N.T @ inertia @ self.T.N
        scaled = (K + K.T) / 2 / self.scales / self.scales[:, None]
        return int(np.sum(np.linalg.eigvalsh(scaled) < -SOFT)) if len(scaled) else 0


class SparseStiffness:
    """The stiffness of scenes with beams."""

    def __init__(self, T: Tangent) -> None:
        D = sp.diags(T.units)
        self.T, self.scaled = T, (D @ T.condensed @ D).tocsc()
        self.largest = float(np.max(np.abs(self.scaled.data), initial=0.0))

    def softest(self) -> tuple[Array, Array, float]:
        """Estimates of a few of the lowest stiffnesses, their motions (nu, k), and the size up to which one counts as none."""
        T, nu = self.T, self.T.nu
        floor = max(ROUND_OFF * self.largest, 1e-300)
        metric = 1 / T.units**2
        try:
            factors = splu((T.K + sp.diags(np.r_[0.1 * floor * metric, np.zeros(T.K.shape[0] - nu)])).tocsc())
        except RuntimeError:
            return np.zeros(1), T.units[:, None], floor
        X = np.random.default_rng(5).normal(size=(nu, min(PROBES, nu))) * T.units[:, None]
        sizes = np.zeros(X.shape[1])
        for _ in range(4):
            right = np.vstack([metric[:, None] * X, np.zeros((T.K.shape[0] - nu, X.shape[1]))])
            Y = np.asarray(factors.solve(right))[:nu]
            if not np.all(np.isfinite(Y)):
                return np.zeros(1), X[:, :1], floor
            left, grown, _ = np.linalg.svd(Y / T.units[:, None], full_matrices=False)
            X, sizes = left * T.units[:, None], 1 / np.maximum(grown, 1e-300)
        return sizes, X, floor

    @property
    def symmetric(self) -> bool:
        """Whether the loads are conservative: only then does a negative direction mean that the state is unstable."""
        K = self.T.K[: self.T.nu, : self.T.nu].tocsr()
        scaled = sp.diags(self.T.units) @ K @ sp.diags(self.T.units)
        return bool(abs(scaled - scaled.T).max() <= SYMMETRIC * abs(scaled).max())

    def negative(self, inertia: Any = None) -> int:
        """Number of directions in which the symmetric part, or that of K + inertia, is negative."""
        S = self.scaled if inertia is None else self.scaled + sp.diags(self.T.units) @ inertia @ sp.diags(self.T.units)
        S = (S + S.T) / 2
        if len(self.rows.indptr) > 1:
            S = S + CLAMP * float(np.max(np.abs(S.data))) * self.rows.T @ self.rows
        return _negatives((S + sp.identity(len(self.T.units)) * 1e-15 * self.largest).tocsc())

    @cached_property
    def rows(self) -> Any:
        """Constraint rows (m, nu), sparse, for displacements in multiples of the scene's length and rad, each of unit length."""
        T = self.T
        G = (T.K[T.nu + T.inner :, : T.nu] @ sp.diags(T.units)).tocsr()
        norms = np.sqrt(np.asarray(G.multiply(G).sum(axis=1)).ravel())
        return (sp.diags(1 / np.where(norms > 0, norms, 1.0)) @ G).tocsr()


def _negatives(S: Any) -> int:
    """Negative eigenvalues of a symmetric matrix (Sylvester): negative pivots of a factorisation without exchanges."""
    try:
        factors = splu(S, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        if np.array_equal(factors.perm_r, factors.perm_c):
            return int(np.sum(factors.U.diagonal() < 0))
    except RuntimeError:
        pass
    return int(np.sum(np.linalg.eigvalsh(S.toarray()) < 0))


def stiffness(T: Tangent, sparse: bool) -> DenseStiffness | SparseStiffness:
    """The stiffness of a tangent."""
    return SparseStiffness(T) if sparse else DenseStiffness(T)


LEAST = 1e-9  #: a moment of inertia of at most this part of the largest of a body counts as none
LOOK = "give True to have the stability of a planar scene against motions out of its plane looked at, or False"
#: what a print of a planar scene says, by what was found
OUT_OF_PLANE = {"stable": "planar: motions out of the plane are stable", "unstable": "planar: motions out of the plane grow",
                None: "planar: motions out of the plane are not looked at"}


def looked_at(prepared: Prepared, frame: str) -> str | None:
    """"stable" or "unstable": whether small motions out of the plane of a planar scene grow at the state of `prepared`, which
    rests or moves steadily in the frame of that name; None where there are none, or nothing is known. Growth is told by a
    warning."""
    model = prepared.model
    if not model.planar or not (model.lines or not_joined(model.scene)):
        return None
    try:
        found = _spectrum(prepared, frame)
    except (MbdaeError, ArithmeticError, RuntimeError, TypeError, ValueError):
        return None  # in space the scene lacks what the plane does not ask for, or it contains what cannot be copied
    if found is None or found.stable is None:
        return None
    if not found.stable:
        worst = int(np.argmax(found.values.real))
        rate = f" by {found.values[worst].real:.4g}/s" if found.values[worst].real > found.errors[worst] else ""
        warn(f"scene '{model.scene.name}' is planar, and small motions out of its plane grow{rate} here: what it says of this "
             "state holds while something keeps it in the plane; Scene(..., space='spatial') has these motions")
    return "stable" if found.stable else "unstable"


def _spectrum(planar: Prepared, frame: str) -> Spectrum | None:
    """The spectrum of the motions out of the plane; None where there are none, or an inertia that counts is not stated."""
    scene, unknown = _in_space(planar.model.scene)
    start = _state_in_space(planar, scene)
    prepared = prepare(scene, start)
    m, (t, q, u, s) = prepared.mechanics, (start.t, start.q, start.u, prepared.start.s)
    if len(s) != len(prepared.mechanics.numbering.states):
        return None
    axes = frame_at(prepared.model, body_of(scene, frame), q, u)
    system = complete_system(m, Index3().spec())
    state = (t, q, u, s, stresses_of(m, q, u))
    whole = pencil_with_errors(system, m, axes, state, True)
    p, places = _cut(whole, _across(m, whole))
    if not len(places):
        return None
    moving = [n.name for n in prepared.model.nodes if n.kind is NodeKind.SPATIAL and n.name in unknown
              and np.isin(np.arange(n.u + 3, n.u + 5), places).any()]
    known = structure(system, m, axes, state, places)
    if m.model.lines:
        found = growth(p, softest_beam(m.model), known)
    else:
        units = m.velocity_units[places]
        equations = reduced(p, free_basis(p.constraints, units))
        if not len(equations.M):
            return None
        found = spectrum(equations, errors_of(p, equations, units), None, known)
    at_rest = not axes.turns and not np.any(u)
    return found if at_rest or not moving else replace(found, stable=None)


def _in_space(scene: SceneData) -> tuple[SceneData, set[str]]:
    """A copy of the scene in space, and the bodies that have no inertia about some axis, because one about z alone is stated or
    they are slender: there they are given that of their largest. At rest it does not decide what is stable."""
    found, unknown = copy.deepcopy(scene), set()
    found.space = "spatial"
    for body in (b for b in found.bodies if b.inertia is not None and not b.is_point and not isinstance(b, Beam)):
        moments, axes = np.linalg.eigh(np.asarray(body.inertia))
        if moments[-1] > 0 and moments[0] <= LEAST * moments[-1]:
            vars(body)["inertia"] = (axes * np.where(moments <= LEAST * moments[-1], moments[-1], moments)) @ axes.T
            unknown.add(body.name)
    return found, unknown


def _state_in_space(planar: Prepared, scene: SceneData) -> Start:
    """The state of a planar scene as one of the same scene in space."""
    here, start, model = planar.model, planar.start, modelled(scene)[0]
    q, u = np.zeros(model.nq), np.zeros(model.nu)
    flat = {node.name: node for node in here.nodes}
    for node in model.nodes:
        if node.name not in flat:
            continue
        other = flat[node.name]
        own, old = (slice(n.q, n.q + n.kind.sizes[0]) for n in (node, other))
        speed, slow = (slice(n.u, n.u + n.kind.sizes[1]) for n in (node, other))
        q[own], u[speed] = _node_in_space(node, other, start.q[old], start.u[slow])
    names = tuple(planar.mechanics.numbering.states.values())
    return Start(start.t, q, u, start.s, np.zeros_like(u), np.zeros(0), names=names)


def _node_in_space(node: Node, flat: Node, q: Array, u: Array) -> tuple[Array, Array]:
    """Positions and velocities of a node in space from those of the same node in the plane."""
    if node.kind is NodeKind.COORDINATE:
        return q, u
    n = node.kind.translations
    found, speed = np.zeros(node.kind.sizes[0]), np.zeros(node.kind.sizes[1])
    found[: min(n, 2)], speed[: min(n, 2)] = q[:2], u[:2]
    if node.kind is NodeKind.SPATIAL:
        assert flat.body is not None
        angle = np.arctan2(*attitude(replace(flat, q=0), q)[1::-1, 0]) - np.arctan2(*flat.body.drawn.rotation[1::-1, 0])
        found[3:] = quaternion_product(turned(IDENTITY, np.array([0.0, 0.0, angle])), drawn_quaternion(node.body))
        speed[3:] = attitude(replace(node, q=0), found).T @ np.array([0.0, 0.0, u[2]])
    return found, speed


def _across(m: Mechanics, p: Pencil) -> NDArray[np.bool_]:
    """Which unknowns of the pencil take part in motions out of the plane: z and rotations about x and y of all nodes, and what is
    coupled with them."""
    first = np.zeros(p.A.shape[0], dtype=bool)
    for node in m.model.nodes:
        if node.kind is not NodeKind.COORDINATE:
            size, n = node.kind.sizes[1], node.kind.translations
            first[node.u + np.array([2, *range(n, size - 1)] if n == 3 else [], dtype=int)] = True
    assert p.errors is not None
    joined = (abs(p.A) > p.errors.A) + (abs(p.E) > p.errors.E)
    label = connected_components(joined, directed=False)[1]
    return np.isin(label, np.unique(label[first]))


def _cut(p: Pencil, keep: NDArray[np.bool_]) -> tuple[Pencil, NDArray[np.intp]]:
    """The pencil of some of its unknowns, and the displacements (of all) among them."""
    assert p.errors is not None
    at = np.flatnonzero(keep)
    new = np.cumsum(keep) - 1
    places = {kind: new[own[keep[own]]] for kind, own in p.places.items()}
    displaced = p.places["p"][keep[p.places["p"]]]
    cut: list[Any] = [Pencil(x.E[at][:, at], x.A[at][:, at], places, p.C[displaced][:, displaced]) for x in (p, p.errors)]
    return replace(cut[0], errors=cut[1]), displaced
