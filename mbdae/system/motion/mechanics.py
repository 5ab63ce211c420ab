"""The mechanics behind every form: masses, forces, accelerations and multipliers at any states, many at once."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from mbdae.deferred import sp, splu
from mbdae.kernels import linearised_plan
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import dynamics, loads
from mbdae.system.base import Array
from mbdae.system.model.beams import ElementBatch, batches, nodal_inputs, sparse_mass
from mbdae.system.motion.constrained import solve_constrained, unique_multipliers
from mbdae.system.motion.reaction_friction import Solve, solve_with_friction
from mbdae.system.motion.states import States
from mbdae.threads import one_thread


def _inertia(d: Derived) -> Any:
    return dynamics(d) if isinstance(d.law, Element) else []


class Mechanics(States):
    """Masses, forces, accelerations and multipliers of a model at states."""

    carries_bodies = False  #: whether all rows are those of joints that carry bodies along

    @cached_property
    def mass(self) -> Any:
        """(nu, nu), constant: bodies carry their node at the centre of mass, spin in the body frame; sparse with beams."""
        M = np.zeros((self.nu, self.nu))
        for (a, b), value in self.inertia.items():
            M[a, b] = value
        return M if not self.model.lines else sp.csc_matrix(M) + sparse_mass(self.model.lines, self.nu)

    @cached_property
    def inertia(self) -> dict[tuple[int, int], float]:
        """Entries of the mass matrix of all but beams, by row and column."""
        found: dict[tuple[int, int], float] = {}
        for g, group in enumerate(self.model.groups):
            p = linearised_plan(group.derived, _inertia)
            values = p.constants.once(self.numbering.numbers(g, p.constant_inputs))
            for i in range(len(group.instances)):
                for (row, target), value in zip(p.constant_places, values[i], strict=False):
                    if target[0] == "up":
                        place = self.numbering.velocity(p.targets[row], g, i), self.numbering.velocity(target, g, i)
                        found[place] = found.get(place, 0.0) + float(value)
        return found

    @cached_property
    def weight(self) -> Any:
        """The mass matrix made positive definite by a millionth of its largest entries: the metric of projections."""
        M, rotational = self.mass, self.rotational
        if sp.issparse(M) and not self.model.lines:
            M = M.toarray()
        d = M.diagonal()
        floor = np.where(rotational, _largest(d[rotational], self.model.length**2), _largest(d[~rotational], 1.0))
        return M + (sp.diags(1e-6 * floor, format="csc") if self.model.lines else np.diag(1e-6 * floor))

    def mobility(self, G: Array) -> Array:
        """(m,) velocity of every row per impulse on it, by the metric of projections."""
        moved = splu(self.weight).solve(G.T.copy()) if self.model.lines else np.linalg.solve(self.weight, G.T)
        return np.asarray(np.einsum("ij,ji->i", G, moved))

    def mobility_with_joints(self, t: float, q: Array, rows: Array) -> Array:
        """(k,) velocity along every row (k, nu) per impulse on it at positions q (nq,), with the constraints in force."""
        impulses = np.vstack([rows, np.zeros((1, self.nu))])  # the last one: what moves without
        with one_thread():
            solve = self._constrained(np.full(len(impulses), t), np.tile(q, (len(impulses), 1)), np.zeros(impulses.shape))
            moved = solve(impulses, None)[0]
        return np.asarray(np.einsum("ij,ij->i", rows, moved[:-1] - moved[-1]))

    def load(self, t: Array, q: Array, u: Array, s: Array | None = None, z: Array | None = None) -> Array:
        """f (nt, nu): all forces but those of constraints and their friction; M u' + G^T lambda = f. z (nt, nz): stresses of
        the beams, by default those of their strains (where a beam is stiff, they magnify the error of the positions)."""
        f = np.zeros((len(t), self.nu))
        for g, p, values in self.evaluate(loads, t, q, u, s):
            for i in range(values.shape[1]):
                for o, target in enumerate(p.targets):
                    f[:, self.numbering.velocity(target, g, i)] -= values[:, i, o]
        return f + self._of_beams(t, q, u, z) if self.model.lines else f

    @cached_property
    def _batches(self) -> dict[bool, list[ElementBatch]]:
        return {mixed: batches(self.model.lines, mixed) for mixed in (False, True)}

    def prescribed(self, t: Array, slots: tuple[tuple[int, str], ...]) -> Array:
        """(nt, slots) prescribed inputs of loads on beams."""
        W = self.numbering.workspace(len(t))
        self.numbering.fill_clock(W, t)
        return W[:, [self.numbering.slot(-1, *place) for place in slots]]

    def _of_beams(self, t: Array, q: Array, u: Array, z: Array | None) -> Array:
        """Forces of beams (nt, nu) by their stresses, those by the compliance of their strains."""
        f = np.zeros((len(t), self.nu))
        for line in self.model.lines:
            np.add.at(f.T, line.places("u").ravel(), line.dead.ravel()[:, None])
        for batch in self._batches[z is not None]:
            self._add_batch(f, batch, t, q, u, z)
        return f

    def _add_batch(self, f: Array, batch: ElementBatch, t: Array, q: Array, u: Array, z: Array | None = None) -> None:
        x = nodal_inputs(batch.kernel, batch.lines, q, u, self.prescribed(t, batch.timed))
        if z is not None and batch.stresses.size:
            x = np.hstack([x, z[:, batch.stresses].reshape(len(x), -1)])
        momentum = [(o, a, i) for o, (head, a, i) in enumerate((*t, 0)[:3] for t in batch.kernel.targets) if head == "u"]
        at = np.array([[e[a].u + i for _, a, i in momentum] for e in batch.nodes], dtype=np.intp).ravel()
        values = batch.kernel.values(x)[:, [o for o, _, _ in momentum]]
        np.add.at(f.T, at, -values.reshape(len(t), -1).T)

    def elastic_force(self, q: Array) -> Array:
        """Forces (nu,) by which the beams resist their deformation at positions q (nq,)."""
        return np.asarray(self._of_elements(False, np.zeros(1), q[None], np.zeros((1, self.nu)))[0])

    def power_of_loads(self, t: Array, q: Array, u: Array) -> Array:
        """Power (nt,) of following and timed loads on beams, W."""
        return np.asarray(np.einsum("ti,ti->t", self._of_elements(True, t, q, u), u))

    def _of_elements(self, loads: bool, t: Array, q: Array, u: Array) -> Array:
        """Forces (nt, nu) of the loads on beams, or of the elements themselves."""
        f = np.zeros((len(t), self.nu))
        for batch in self._batches[False]:
            if batch.is_load is loads:
                self._add_batch(f, batch, t, q, u)
        return f

    def accelerations(self, t: Array, q: Array, u: Array, s: Array | None = None,
                      z: Array | None = None) -> tuple[Array, Array]:  # fmt: skip
        """u' (nt, nu) and lambda (nt, m) from M u' + G^T lambda = f, G u' = -gamma; where lambda is not unique the one of least
        norm, every row in the unit of its work in a unit displacement (the scene's length, 1 rad).

        With friction that follows from reactions f depends on lambda: see `reaction_friction.py`."""
        f = self.load(t, q, u, s, z)
        with one_thread():
            solve = self._constrained(t, q, u)
            return solve_with_friction(self, (t, q, u, s), f, solve) if self.reactive and self.m else solve(f, None)

    def _constrained(self, t: Array, q: Array, u: Array) -> Solve:
        """The linear equations for u' and lambda at given states."""
        if self.model.lines:
            return lambda f, slope: self._sparse_accelerations(t, q, u, f, slope)
        if not self.m:
            return lambda f, _: (np.linalg.lstsq(self.mass, f.T, rcond=1e-13)[0].T, np.zeros((len(t), 0)))
        G, gamma = self.constraint_jacobian(t, q), self.acceleration_bias(t, q, u)
        E = self.unique(G)
        return lambda f, slope: solve_constrained(self.mass, f, G, gamma, 1 / self.velocity_units, slope, E)

    def unique(self, G: Array, rows: Array | None = None, units: Any = 1.0) -> Array | None:
        """E (nt, m, m), see `unique_multipliers`, where rows of G (nt, m, nu) follow from others; None where all are needed.
        rows (nt, m, n): what is left of these rows over joint coordinates, whose units are (n,)."""
        if not self.redundant:
            return None
        mass = float(np.max(self.mass.diagonal() * self.velocity_units**2))
        B = G * self.velocity_units
        return unique_multipliers(B if rows is None else rows * units, self.redundant, mass, np.linalg.norm(B, axis=2))

    def _sparse_accelerations(self, t: Array, q: Array, u: Array, f: Array, slope: Array | None) -> tuple[Array, Array]:
        out = np.empty((len(t), self.nu + self.m))
        G, gamma, M = self.constraint_jacobian(t, q), self.acceleration_bias(t, q, u), sp.coo_matrix(self.mass)
        E = self.unique(G)
        a, b = np.indices((self.m, self.m)).reshape(2, -1) if E is not None else np.zeros((2, 0), dtype=int)
        columns = G.transpose(0, 2, 1) if slope is None else G.transpose(0, 2, 1) - slope
        r, c = np.nonzero(np.any(G != 0, axis=0))
        d, e = np.nonzero(np.any(columns != 0, axis=0))
        places = np.r_[M.row, self.nu + r, d, self.nu + a], np.r_[M.col, c, self.nu + e, self.nu + b]
        for i in range(len(t)):
            values = np.r_[M.data, G[i, r, c], columns[i, d, e], () if E is None else -E[i].ravel()]
            out[i] = splu(sp.csc_matrix((values, places), shape=(out.shape[1],) * 2)).solve(np.r_[f[i], -gamma[i]])
        return out[:, : self.nu], out[:, self.nu :]


def _largest(values: Array, otherwise: float) -> float:
    largest = float(np.max(values, initial=0.0))
    return largest if largest > 0 else otherwise
