"""A start with bent beams, where no rigid motion of the beams closes the loops or follows the prescribed motions, and one whose
elastic bodies are strained as in a motion without ringing (`Slow`).

Loops of beams may be drawn or driven so that they close only if beams bend, such as a four-bar with one hinge that is not
parallel to the others. Positions are then those of least elastic energy, and velocities minimise the same quadratic form of the
stiffness, as in a quasi-static motion. Rigid motions cost no elastic energy: a small weight on the inertia makes them unique.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mbdae.deferred import eigh, sp, splu
from mbdae.laws.bodies import with_modes
from mbdae.system.base import Array
from mbdae.system.changes import cheapest, largest_violation
from mbdae.system.model.nodes import rotation_of
from mbdae.system.motion.mechanics import Mechanics, in_units

#: assumed ratio of the motion's frequency to the lowest bending frequency. Its square weighs the inertia against the stiffness
SLOW = 0.01
STEPS = 50
#: size of a step of Newton's method (rad, or over the scene's length) up to which it has converged, if the loops are closed too
CONVERGED = 1e-9
#: numbers of points of the polynomial that a motion without ringing is, and times over which it is one, in radians or lengths of
#: the scene at its largest velocity: few points for elastic bodies that vibrate fast, many for those that vibrate hardly faster
POLYNOMIALS = ((7, 1.0), (9, 1.5), (11, 2.0), (13, 2.5), (17, 4.0), (21, 6.0))
#: the times are divided by these numbers in turn, until the error of the velocities over the largest one is below GOOD; one
#: below ENOUGH ends the search at once
SHORTER, GOOD, ENOUGH = (1, 4, 16), 1e-5, 1e-7
#: singular value, over the largest, of velocities that count as allowed by joints and free of strain
FREE = 1e-9
FADED = 0.01  #: part of a vibration's amplitude from which it counts as over
STILL = 1e-9  #: square of a frequency over that of the largest, of motions that strain nothing
BALANCED = 8  #: number of times that rows and columns of the linear equations are divided by the roots of their largest entries
#: largest number of corrections; size of the last one relative to the first, and up to which it may be round-off, relative to
#: the first or to the sizes of the unknowns
NEWTON, SMALL, ROUND = 8, 1e-10, 1e-4


def can_bend(mechanics: Mechanics) -> bool:
    """Whether a scene has beams and none of their strains is rigid."""
    lines = mechanics.model.lines
    return bool(lines) and not any(line.beam.section.rigid for line in lines)


class Bending:
    """Of a scene with beams at positions q (nq,): stiffness matrix, elastic forces, and mass matrix times a small weight."""

    def __init__(self, mechanics: Mechanics, q: Array) -> None:
        self.units = mechanics.velocity_units
        self.inertia = SLOW**2 * _lowest(mechanics) * sp.csc_matrix(mechanics.weight)
        self.weight = stiffness(mechanics, q) + self.inertia
        self.force = mechanics.elastic_force(q)

    def least(self, A: Array, right: Array, pull: Array) -> Array:
        """Displacement x (nu,) with A x = right (m,) that minimises x^T W x / 2 - pull^T x, where W is stiffness plus weighted
        inertia; A (m, nu) may have redundant rows."""
        return cheapest(self.weight, self.units, A, right, pull)


def stiffness(mechanics: Mechanics, q: Array) -> sp.csc_matrix:
    """Stiffness matrix (nu, nu) of all beams at positions q (nq,), per virtual displacement."""
    parts: list[Any] = []
    for line in mechanics.model.lines:
        K = line.stiffness(q)
        at = line.places("u").reshape(len(K), -1)
        a, b = np.broadcast_arrays(at[:, :, None], at[:, None, :])
        parts.append((((K + K.transpose(0, 2, 1)) / 2).ravel(), a.ravel(), b.ravel()))
    values, rows, columns = (np.concatenate(of) for of in zip(*parts, strict=True))
    return sp.csc_matrix((values, (rows, columns)), shape=(mechanics.nu,) * 2)


def closed_by_bending(mechanics: Mechanics, q: Array, closure: Callable[[Array], Array], jacobian: Callable[[Array], Array],
           within: float) -> Array | None:
    """Positions (nq,) of least elastic energy that satisfy closure(q) = 0 (m,), found by Newton's method from q; None where it
    fails. jacobian(q) (m, nu): derivative of closure by displacements; within: largest violation, over the scene's length or
    rad."""
    for _ in range(STEPS):
        bending, A, g = Bending(mechanics, q), jacobian(q), closure(q)
        off = largest_violation(g, in_units(mechanics, A))
        x = bending.least(A, -g, bending.force)
        step = float(np.max(np.abs(x) / mechanics.velocity_units))
        if off <= within and step <= CONVERGED:
            return q
        factor = min(1.0, 0.5 / max(step, 1e-300))
        while factor > 1e-4:
            moved = mechanics.integrate_positions(q, factor * x)
            if largest_violation(closure(moved), in_units(mechanics, A)) < max(off, within) * (1 + 1e-9) or off <= 1e-6:
                break
            factor /= 2
        else:
            return None
        q = moved
    return None


def _lowest(mechanics: Mechanics) -> float:
    """Square of the lowest bending frequency of all beams, (rad/s)^2, estimated as EI / (mass per length * length^4)."""
    beams = [line.beam for line in mechanics.model.lines]
    lengths = [float(np.sum(np.linalg.norm(np.diff(beam.outline, axis=0), axis=1))) for beam in beams]
    sections = [beam.section for beam in beams]
    return float(min(min(s.EI2, s.EI3) / s.mass_per_length / l**4 for s, l in zip(sections, lengths, strict=True)))


def slowest(mechanics: Mechanics) -> float:
    """Rate, 1/s, of motions so slow beside the vibrations of all beams that they are not told from rest; 0 without beams."""
    return SLOW * float(np.sqrt(_lowest(mechanics))) if mechanics.model.lines else 0.0


@dataclass(frozen=True)
class Slow:
    """The motion of a system that is a polynomial in time from its start: the vibrations of elastic bodies, which are none over
    times longer than their periods, are not in it (the principle of bounded derivatives of Kreiss).

    The equations hold at all points of the polynomial, also at the start, and no start value of an elastic body is given. What is
    kept of the start are the rigid motions: rows (k, n) times the unknowns have their values there, and forces (n, k) are the
    directions in which the equations need not hold at the start, since a start decides."""

    system: Any  #: of a scene
    rows: Array
    forces: Array
    unit: Callable[[Array], tuple[Array, Array]]  #: y (n,) -> lengths of quaternions less 1 (m,), and their derivatives (m, n)
    turns: Array  #: (n, m) as forces: along the quaternions
    #: length of a motion with long steps, s -> times (k,) -> y (k, n), from which corrections begin
    near: Callable[[float], Callable[[Array], Array]]

    def start(self, rate: float) -> tuple[Array, float]:
        """y (n,) at the start, and the estimated error of its velocities over the largest one. rate: largest velocity, 1/s."""
        best, error, moving = self.system.y0, np.inf, np.array(self.system.kinds) == "v"
        scale, near = self.system.scale[moving], self.near(POLYNOMIALS[-1][1] / rate)
        for shorter in SHORTER:
            before = None
            for points, length in POLYNOMIALS:
                try:
                    found = self.over(length / rate / shorter, points, near)
                except (np.linalg.LinAlgError, RuntimeError):
                    continue
                size = max(1.0, float(np.max(np.abs(found[moving]) / scale)))
                apart = np.inf if before is None else float(np.max(np.abs(found - before)[moving] / scale)) / size
                if apart < error:
                    best, error = found, apart
                if error <= ENOUGH:
                    return best, error
                before = found
            if error <= GOOD:
                break
        return best, error

    def over(self, length: float, points: int, near: Callable[[Array], Array]) -> Array:
        """y (n,) at the start of the polynomial through `points` points over a time, s; near: where corrections begin."""
        system, n = self.system, self.system.n
        told = np.isin(system.kinds, ("q", "v", "s"))  # round-off of forces is large where stiff bodies move slowly
        t, D = _differentiation(points - 1, length)
        t = system.t0 + t
        Y = near(t)
        loose = np.hstack([self.forces, self.turns])
        begin, first, before = np.zeros(loose.shape[1]), 0.0, np.inf
        with system.within(system.t0 + length / 2):
            for _ in range(NEWTON):
                away, slopes = self.unit(Y[0])
                F, Yp = np.empty((points, n)), D @ Y
                for i in range(points):
                    system.residual(t[i], Y[i], Yp[i], F[i])
                F[0] += loose @ begin
                parts = zip(*map(system.dense_parts, t, Y, Yp), strict=True)
                by_y, by_yp = (sp.block_diag(part, format="csc") for part in parts)
                K = by_y + by_yp @ sp.kron(D, sp.identity(n), format="csc")
                kept = np.vstack([self.rows, slopes])
                beside, below = (sp.csc_matrix((a, b)) for a, b in (((points - 1) * n, len(kept)), (len(kept), (points - 1) * n)))
                K = sp.bmat([[K, sp.vstack([sp.csc_matrix(loose), beside])], [sp.hstack([sp.csc_matrix(kept), below]), None]],
                            format="csc") if len(kept) else K
                x = _solved(K, -np.concatenate([F.ravel(), self.rows @ (Y[0] - system.y0), away]))
                change = x[: points * n].reshape(points, n)
                Y, begin = Y + change, begin + x[points * n :]
                size = float(np.max(np.abs(change)[:, told] / system.scale[told]))
                first = max(first, size)
                if not np.isfinite(size):
                    break
                if size <= SMALL * first or ROUND * max(first, 1.0) > size > before / 2:  # later ones are round-off
                    return np.asarray(Y[0])
                before = size
        raise np.linalg.LinAlgError  # the corrections do not converge


class Ringing(NamedTuple):
    """The vibrations that an unstrained start excites: largest displacement, m, and the time, s, at which the damping of the
    beams has left FADED of their amplitude, inf without damping."""

    amplitude: float
    over: float

    def __str__(self) -> str:
        damped = f"until about t = {self.over:.2g} s, by the damping of the beams"
        until = damped if np.isfinite(self.over) else "for the whole run"
        return (f"beams start unstrained: expect ringing {until} ({self.amplitude:.1e} m at first, and its forces); "
                f'simulate(..., start="relaxed") begins without')


def ringing(m: Mechanics, q: Array, x: Array, v: Array, moved: Array, allowed: Array) -> Ringing:
    """What rings after a start at q (nq,) that is x (nu,) and v (nu,) away from positions and velocities without ringing: the
    decay of the energy of all modes. moved (all nodes, nu): velocities of all nodes from those of the unknowns; allowed (nu, k):
    those that the joints allow."""
    B, K, M = moved @ allowed, stiffness(m, q), m.mass
    squares, modes = eigh(B.T @ (K @ B), B.T @ (M @ B))
    modes = (B @ modes)[:, squares > STILL * squares[-1]]
    squares = squares[squares > STILL * squares[-1]]
    energy = squares * (modes.T @ (M @ x)) ** 2 + (modes.T @ (M @ v)) ** 2
    lost = sum(line.energy(np.repeat(q[None], len(modes.T), axis=0), modes.T)[1] for line in m.model.lines)
    amplitude = float(np.max(np.abs((modes @ (modes.T @ (M @ x)))[~m.rotational])))
    low, high = 0.0, float(np.log(1 / FADED**2) / np.min(lost)) if np.min(lost) > 0 else np.inf
    while np.isfinite(high) and high - low > 0.01 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if energy @ np.exp(-lost * middle) > FADED**2 * np.sum(energy) else (low, middle)
    return Ringing(amplitude, high)


def strainless(m: Mechanics, time: Array, q: Array, moved: Array, units: Array) -> Array:
    """(nu, k) velocities of the unknowns that strain no elastic body and that the joints allow, at positions q (nq,). moved (all
    nodes, nu): velocities of all nodes from those of the unknowns, of sizes `units` (nu,)."""
    rows = [m.constraint_jacobian(time, q[None])[0] @ moved]
    for line in m.model.lines:
        at = np.unique(line.places("u"))
        rigid = np.zeros((m.nu, 6))
        for node in line.nodes:
            n, arm = node.kind.translations, node.position(q) - line.nodes[0].position(q)
            rigid[node.u : node.u + n, :3] = np.eye(3)[:n]
            rigid[node.u : node.u + n, 3:] = np.cross(np.eye(3), arm).T[:n]
            turning = node.kind.sizes[1] - n
            R = rotation_of(node.kind, q[node.q : node.q + node.kind.sizes[0]]).T
            rigid[node.u + n : node.u + n + turning, 3:] = R[3 - turning :]
        own = rigid[at]
        rows.append(moved[at] - own @ (np.linalg.pinv(own) @ moved[at]))
    modes = {c.name for c in with_modes(m.model.scene.connections)}
    rows += [moved[n.u][None] for n in m.model.nodes if n.joint in modes]
    return allowed_by(np.vstack(rows), units)


def allowed_by(A: Array, units: Array) -> Array:
    """(nu, k) velocities x with A x = 0, of sizes `units` (nu,)."""
    A = A * units
    A = A / np.maximum(np.linalg.norm(A, axis=1, keepdims=True), 1e-300)
    _, sizes, V = np.linalg.svd(A)
    return np.asarray(V[int(np.sum(sizes > FREE * np.max(sizes, initial=0.0))) :].T * units[:, None])


def _differentiation(degree: int, length: float) -> tuple[Array, Array]:
    """Chebyshev's points over a time (degree + 1,), s, and the matrix that differentiates polynomials through values there."""
    x = -np.cos(np.pi * np.arange(degree + 1) / degree)
    c = np.r_[2.0, np.ones(degree - 1), 2.0] * (-1.0) ** np.arange(degree + 1)
    D = np.outer(c, 1 / c) / (x[:, None] - x + np.eye(degree + 1))
    D -= np.diag(D.sum(axis=1))
    return (x + 1) * length / 2, D * 2 / length


def _solved(K: Any, right: Array) -> Array:
    """x with K x = right, of a sparse matrix whose entries have very different sizes."""
    r, c, A = np.ones(K.shape[0]), np.ones(K.shape[0]), sp.coo_matrix(K)
    size = abs(A.data)
    for _ in range(BALANCED):
        for factor, at in ((r, A.row), (c, A.col)):
            most = np.zeros(len(factor))
            np.maximum.at(most, at, size)
            factor /= np.sqrt(most)
            size = size / np.sqrt(most)[at]
    return np.asarray(c * splu((sp.diags(r) @ K @ sp.diags(c)).tocsc()).solve(r * right))
