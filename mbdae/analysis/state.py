"""Stiffness and damping law by law: whether their sum is positive, where rounding hides the small ones beside the large ones.

The equations linearised at a state, with the errors that the rounding of its numbers causes, and what is known of them beside
their numbers; and kinks there: a contact that just touches, play that just closes, a corner of a curve, |x| at 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.analysis.frame import RotatingFrame, dynamics, free_shifts, spins, stresses_of
from mbdae.analysis.pencil import ROUNDED, Basis, Pencil, basis, pencil, with_errors
from mbdae.analysis.reduced import free_basis
from mbdae.analysis.roots import EPS, sign
from mbdae.analysis.spectrum import Structure
from mbdae.errors import warn
from mbdae.results.result import Result
from mbdae.run.assessment import past_their_domain
from mbdae.scene.models import not_joined
from mbdae.symbolic.outputs import loads, position
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.right_hand_side import state_rate_outputs, state_rates
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics

NOISE = 8 * EPS  #: eigenvalues of the matrix of one law up to this part of its largest count as 0, and asymmetry as none
LEVELS = 6  #: number of sizes above which stiff parts are left out, one after the other


@dataclass(frozen=True)
class Laws:
    """The equations of momentum law by law, at rest in axes that do not turn.

    terms: dF/dy of every instance of a law; basis: that of the pencil; nu: number of velocities; weights (nu,):
    masses and inertias, which make stiffnesses of displacements and of rotations comparable."""

    terms: list[Any]
    basis: Basis
    nu: int
    weights: Array

    @cached_property
    def _split(self) -> dict[str, list[tuple[Array, Array]]]:
        """For "K" and "C", of every instance with an influence: its displacements (k,), and its matrix (k, k) divided by the
        roots of the weights."""
        found: dict[str, list[tuple[Array, Array]]] = {"K": [], "C": []}
        at, root = slice(self.nu, 2 * self.nu), np.sqrt(self.weights)
        for term in self.terms:
            for name, columns in (("K", slice(0, self.nu)), ("C", at)):
                S = (self.basis.L[at] @ term @ self.basis.T[:, columns]).tocoo()
                own = np.unique(np.r_[S.row[S.data != 0], S.col[S.data != 0]])
                if len(own):
                    S = S.tocsr()[own][:, own].toarray() / root[own, None] / root[own]
                    found[name].append((own, S))
        return found

    def none_resists(self, p: Any) -> bool:
        """Whether no law has a stiffness against the motion p (nu,), divided by the roots of the weights."""
        return all(np.max(np.abs(S @ p[own])) <= NOISE * np.max(np.abs(S)) * np.max(np.abs(p[own]))
                   for own, S in self._split["K"])

    def surely(self, name: str, N: Array) -> bool:
        """Whether x^T S x >= 0 is certain for S = "K" or "C" on the motions N x.

        The parts of laws that are positive and stiffer than some size are left out: the rest is positive by itself, or the sum is
        not known to be."""
        parts = []
        for own, S in self._split[name]:
            if np.max(np.abs(S - S.T)) > NOISE * np.max(np.abs(S)):
                return False
            values, V = np.linalg.eigh((S + S.T) / 2)
            values = np.where(np.abs(values) <= NOISE * np.max(np.abs(values)), 0.0, values)
            parts.append((own, values, V, NOISE * np.max(np.abs(values))))
        sizes = np.array([np.max(values) for _, values, _, _ in parts if np.max(values, initial=0.0) > 0])
        least = -min((float(np.min(values)) for _, values, _, _ in parts), default=0.0)
        if not len(sizes):
            return least <= 0
        if least <= 0:
            return True
        scaled = np.sqrt(self.weights)[:, None] * N
        for level in np.geomspace(max(least, float(np.min(sizes))), float(np.max(sizes)), LEVELS):
            S, dS = np.zeros((N.shape[1],) * 2), np.zeros((N.shape[1],) * 2)
            for own, values, V, noise in parts:
                kept = values <= level
                U = V[:, kept].T @ scaled[own]
                S += U.T @ (values[kept, None] * U)
                size = np.abs(V[:, kept]).T @ np.abs(scaled[own])
                rounding = ROUNDED * size.T @ (np.abs(values[kept])[:, None] * size)
                if np.any(values[kept] != 0) and not np.all(kept):
                    rounding = rounding + noise * size.T @ size
                dS += rounding
            if sign(S, dS) > 0:
                return True
        return False


#: relative changes of the state by which the rounding of its numbers is carried to the equations, and how often
ULP, SAMPLES = float(np.finfo(float).eps), 2
SHIFT = 1e-5  #: a motion counts as one of the scene as a whole where it differs from it by at most this part
STILL = 1e-10  #: a node that moves by at most this part of the largest motion stands still

WholeState = tuple[float, Array, Array, Array, Array]  #: t, q, u, s and the stresses z of beams


def unknowns_at(system: Assembly, m: Mechanics, state: WholeState) -> tuple[Array, Array]:
    """y and y' (n,) of a complete index-3 system at a state, with its accelerations and multipliers."""
    t, q, u, s, z = state
    if m.model.lines:
        found = dynamics(system, m, t, q, u, s, z)
        return found.y, found.yp
    kinds = np.array(system.kinds)
    a, multipliers = m.accelerations(np.array([t]), q[None], u[None], s[None])
    y, yp = np.zeros(system.n), np.zeros(system.n)
    y[kinds == "q"], y[kinds == "v"], y[kinds == "s"] = q, u, s
    y[kinds == "lambda"] = multipliers[0] / system.numbering.scaling()
    yp[kinds == "q"], yp[kinds == "v"], yp[kinds == "s"] = m.rates(q, u), a[0], state_rates(m, t, q, u, s)
    return y, yp


def pencil_at(system: Assembly, m: Mechanics, frame: RotatingFrame, state: WholeState) -> Pencil:
    """The pencil at a state."""
    return pencil(system, m, frame, state[0], *unknowns_at(system, m, state))


def pencil_with_errors(system: Assembly, m: Mechanics, frame: RotatingFrame, state: WholeState, strained: bool) -> Pencil:
    """The pencil at a state with bounds of its errors, those of the state's numbers among them: positions, and the reactions that
    follow from them, are known up to rounding. strained: whether the stresses follow from the positions too."""
    rng, beside = np.random.default_rng(11), []
    for _ in range(SAMPLES):
        q, u, s, z = (x * (1 + ULP * rng.choice([-1.0, 1.0], len(x))) for x in state[1:])
        beside.append(pencil_at(system, m, frame, (state[0], q, u, s, stresses_of(m, q, u) if strained else z)))
    return with_errors(system, m, frame, state[0], *unknowns_at(system, m, state), beside)


def structure(system: Assembly, m: Mechanics, frame: RotatingFrame, state: WholeState,
              some: NDArray[np.intp] | None = None) -> Structure:
    """What the laws one by one, and the motions of the scene as a whole, say of the equations at a state; some: the displacements
    that these equations have (default: all)."""
    t, q, u = state[:3]
    weights, at = np.asarray(m.weight.diagonal()), np.arange(m.nu) if some is None else some

    @cache
    def laws() -> Laws:
        terms = system.evaluation.jacobian_by_law(t, *unknowns_at(system, m, state))
        return Laws(terms, basis(system, m, frame, q, u), m.nu, weights)

    @cache
    def shifts() -> Array:
        turned = basis(system, m, frame, q, u).C.T @ u
        free = free_shifts(m.model, frame, q, turned)
        if frame.turns or np.any(u):  # rotations about the axis alone, with which the whole scene turns
            free[:, 3] = free[:, 3:6] @ (frame.rotation.T @ frame.rate)
            free[:, 4:6] = 0.0
        return np.asarray(free * np.sqrt(weights)[:, None])

    def whole(x: Any) -> Any:
        found = np.zeros((m.nu, *x.shape[1:]), dtype=x.dtype)
        found[at] = x
        return found

    def free(p: Any) -> bool:
        p = whole(p) * np.sqrt(weights)
        if (still and not laws().none_resists(p)) or (resting and not still and not not_joined(m.model.scene)):
            return False
        moves = shifts() * _moving(m, p)[:, None]  # what stands still, as a driven hub in its own axes, is not shifted
        off = p - moves @ np.linalg.lstsq(moves, p, rcond=None)[0]
        return bool(np.linalg.norm(off) <= SHIFT * np.linalg.norm(p))

    def shifted(p: Any) -> bool:
        p = whole(p) * np.sqrt(weights)
        if still:
            return laws().none_resists(np.where(np.abs(p) <= STILL * np.max(np.abs(p)), 0.0, p))
        turned = basis(system, m, frame, q, u).C.T @ u
        moves = np.hstack([free_shifts(m.model, frame, q, turned), *spins(m.model, frame, turned)]) * np.sqrt(weights)[:, None]
        off = p - moves @ np.linalg.lstsq(moves, p, rcond=None)[0]
        return bool(np.linalg.norm(off) <= SHIFT * np.linalg.norm(p))

    resting = not frame.turns and not np.any(u)
    still = resting and not m.model.lines
    return Structure(lambda name, N: still and laws().surely(name, whole(N)), free, shifted, float(np.linalg.norm(frame.rate)))


def _moving(m: Mechanics, p: Any) -> NDArray[np.bool_]:
    """Of every displacement (nu,) whether its node takes part in a motion p (nu,)."""
    found, least = np.zeros(m.nu, dtype=bool), STILL * np.max(np.abs(p))
    for node in m.model.nodes:
        own = slice(node.u, node.u + node.kind.sizes[1])
        found[own] = np.max(np.abs(p[own]), initial=0.0) > least
    return found


#: displacements to both sides of a state, in the scene's length or rad (velocities: per second), between which slopes are
#: compared, and how many directions
BESIDE, DIRECTIONS = (1e-8, 1e-9), 2
#: a law has a kink where its slopes on both sides differ by more than this part of the larger one, at both distances: the second
#: is the smallest ratio of the differences to what they are at a kink, where smooth laws have 0.1 and those of Hertz 0.3
KINK, LASTS = 1e-3, 0.6
#: a difference is rounding up to this many times what changes of all numbers of the state by ULP make
ROUNDING = 1e4


def kinks(m: Mechanics, state: tuple[float, Array, Array, Array], resting: bool = False) -> list[tuple[str, Array]]:
    """The items whose laws have a kink or a jump exactly at a state (t, q, u, s), in motions that the constraints allow, each
    with a direction (nq + nu + ns,) that leads across it. resting: velocities stay as they are."""
    t, q, u, s = state
    units, rng, found = m.velocity_units, np.random.default_rng(17), dict[str, Array]()
    free = np.diag(units) if m.model.lines else free_basis(m.constraint_jacobian(np.array([t]), q[None])[0], units)
    for _ in range(DIRECTIONS if free.shape[1] else 0):
        moved, faster = free @ rng.uniform(-1, 1, free.shape[1]), free @ rng.uniform(-1, 1, free.shape[1])
        along = [m.rates(q, moved), faster * (not resting), state_rates(m, t, q, moved, s)]
        parts = np.array([0.0, *(side * step for step in BESIDE for side in (1, -1)), *np.zeros(SAMPLES + 1)])
        states = [x + parts[:, None] * d for x, d in zip((q, u, s), along, strict=True)]
        for x in states:
            any_way = rng.uniform(-1, 1, (SAMPLES + 1, x.shape[1])) * (1 + np.abs(x[0]))
            x[5:] += np.array([[ULP]] * SAMPLES + [[BESIDE[0]]]) * any_way
        read = [(g, values) for outputs in (loads, position, *(() if resting else (state_rate_outputs,)))
                for g, _, values in m.evaluate(outputs, np.full(len(parts), t), states[0], states[1], states[2])]
        least = EPS * max((float(np.max(np.abs(values), initial=0.0)) for _, values in read), default=0.0)
        for g, values in read:
            for i, instance in enumerate(m.model.groups[g].instances):
                if _bent(values[:, i], least):
                    found.setdefault(instance.item, np.concatenate(along))
    return list(found.items())


def _bent(values: Array, least: float) -> bool:
    """Whether values (n, k), whose changes below `least` are rounding, at a state, at both `BESIDE` distances from it on either
    side, at SAMPLES states that rounding makes of it, and at one as far from it as the former whatever constraints allow, have a
    kink or a jump there."""
    apart = values[1:] - values[0]
    *size, noise, wide = np.max(np.abs(apart), axis=1, initial=0.0)[[0, 1, 2, 3, -2, -1]]
    if max(size) <= least:
        return False
    if noise > KINK * wide:
        return bool(max(size[2:]) > LASTS * max(size[:2]))
    noise = ROUNDING * noise
    far, near = (float(np.max(np.abs(apart[k] + apart[k + 1]), initial=0.0)) for k in (0, 2))
    part = BESIDE[1] / BESIDE[0]
    return far > max(KINK * max(size[:2]), noise) and near > LASTS * part * far


def sides(state: tuple[float, Array, Array, Array], across: Array) -> list[list[Array]]:
    """q, u, s on both sides of a state, along a direction of `kinks`."""
    at = np.cumsum([len(x) for x in state[1:3]])
    return [[x + side * BESIDE[0] * d for x, d in zip(state[1:], np.split(across, at), strict=True)] for side in (1, -1)]


def told(at: Result, where: str = "") -> tuple[str, ...]:
    """Warn, as runs do, of what the laws leave out at a state or in a motion, such as the change of a reduced body's stiffness by
    loads; where: a text on where on a branch it is. Returns the warnings."""
    found = tuple(where + text for text in past_their_domain(at))
    for text in found:
        warn(text)
    return found


def at_kinks(found: list[tuple[str, Array]], what: str) -> str:
    """A warning of kinks at a state; what: which numbers are those of one side."""
    names = " and ".join(f"'{name}'" for name, _ in found[:3]) + " and others" * (len(found) > 3)
    return (f"{names} {'has' if len(found) == 1 else 'have'} a kink exactly at this state (as a contact that just touches, play "
            f"that just closes, a corner of a curve): {what} are those of one side of it, and do not tell what grows")
