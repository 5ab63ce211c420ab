"""The mechanics behind every form: M, f, G, g and their rates at any states, many at once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from mbdae.kernels import linearised_plan, plan
from mbdae.kernels.plan import Outputs
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import acceleration, dynamics, jacobian_G, loads, position, velocity
from mbdae.system.base import Array
from mbdae.system.model.beams import Batch, batches, nodal_inputs, sparse_mass
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node
from mbdae.system.model.numbering import Numbering, Row
from mbdae.system.model.rotations import quaternion_product, turned
from mbdae.system.motion import reaction_forces as pressed
from mbdae.system.motion.constrained import solve_constrained, unique_multipliers
from mbdae.threads import one_thread

Index = NDArray[np.intp]


def _inertia(d: Derived) -> Any:
    return dynamics(d) if isinstance(d.law, Element) else []


def _loads(d: Derived) -> Any:
    return loads(d)


class Mechanics:
    """Evaluates a model at states t (nt,), q (nt, nq), u (nt, nu), s (nt, ns); rows: the constraint rows that count; redundant:
    how many of them follow from the others (which ones differs from position to position)."""

    def __init__(self, model: Model, rows: list[Row], redundant: int = 0) -> None:
        self.model, self.rows, self.redundant = model, rows, redundant
        self.numbering = Numbering(model, rows, ("lambda",))
        self.nq, self.nu, self.m = model.nq, model.nu, len(rows)
        self._places: dict[int, tuple[Index, Index, Index]] = {}

    @cached_property
    def reactive(self) -> list[int]:
        """Groups of joints whose friction follows from their own reactions."""
        return [g for g, group in enumerate(self.model.groups) if group.derived.reactive]

    @cached_property
    def followed(self) -> dict[str, int]:
        """Number of the internal state that follows a joint's coordinate through whole turns, by the joint's name."""
        found = {}
        for n, (g, i, j) in enumerate(self.numbering.states):
            group = self.model.groups[g]
            if group.derived.states[j] == group.instances[i].law.follows:
                found[group.instances[i].item] = n
        return found

    def evaluate(self, outputs: Outputs, t: Array, q: Array, u: Array, s: Array | None = None,
                 multipliers: Array | None = None, groups: Sequence[int] | None = None,
                 ) -> list[tuple[int, Any, Array]]:  # fmt: skip
        """(group, plan, values (nt, instances, outputs)) of every group, or of those named, that has such outputs."""
        W = self.workspace(t, q, u, s, multipliers)
        out = []
        for g in range(len(self.model.groups)) if groups is None else groups:
            p = plan(self.model.groups[g].derived, outputs)
            if p.targets:
                out.append((g, p, p.kernel.values(W[:, self.numbering.gather(g, p.all_inputs)])))
        return out

    def workspace(self, t: Array, q: Array, u: Array, s: Array | None, multipliers: Array | None) -> Array:
        """(nt, width) rows every kernel reads from."""
        nb = self.numbering
        W = nb.workspace(len(t))
        W[:, : self.nq], W[:, self.nq : self.nq + self.nu] = q, u
        if s is not None:
            W[:, nb.start["s"] : nb.start["s"] + len(nb.states)] = s
        if multipliers is not None:
            W[:, nb.start["lambda"] : nb.start["lambda"] + self.m] = multipliers / nb.scaling()  # a form's unknowns
        nb.fill_clock(W, t)
        return W

    @cached_property
    def mass(self) -> Any:
        """(nu, nu), constant: bodies carry their node at the centre of mass, spin in the body frame; sparse with beams."""
        M = np.zeros((self.nu, self.nu))
        for g, group in enumerate(self.model.groups):
            p = linearised_plan(group.derived, _inertia)
            values = p.constants.once(self.numbering.numbers(g, p.constant_inputs))
            for i in range(len(group.instances)):
                for (row, target), value in zip(p.constant_places, values[i], strict=False):
                    if target[0] == "up":
                        a = self.numbering.velocity(p.targets[row], g, i)
                        M[a, self.numbering.velocity(target, g, i)] += value
        return M if not self.model.lines else sp.csc_matrix(M) + sparse_mass(self.model.lines, self.nu)

    @cached_property
    def weight(self) -> Any:
        """The mass matrix made positive definite by a millionth of its largest entries: the metric of projections."""
        M, rotational = self.mass, self.rotational
        d = M.diagonal()
        floor = np.where(rotational, _largest(d[rotational], self.model.length**2), _largest(d[~rotational], 1.0))
        return M + (sp.diags(1e-6 * floor, format="csc") if self.model.lines else np.diag(1e-6 * floor))

    def mobility(self, G: Array) -> Array:
        """(m,) velocity of every row per impulse on it, by the metric of projections."""
        moved = splu(self.weight).solve(G.T.copy()) if self.model.lines else np.linalg.solve(self.weight, G.T)
        return np.asarray(np.einsum("ij,ji->i", G, moved))

    @cached_property
    def rotational(self) -> Any:
        """(nu,) bool: which velocities are angular."""
        mask = np.zeros(self.nu, dtype=bool)
        for node in self.model.nodes:
            if node.kind is NodeKind.COORDINATE:
                mask[node.u] = node.unit == "rad"
            elif node.kind.turns:
                mask[node.u + (2 if node.kind is NodeKind.PLANAR else 3) : node.u + node.kind.sizes[1]] = True
        return mask

    @cached_property
    def velocity_units(self) -> Array:
        """(nu,) size of each virtual displacement: the scene's length, or 1 rad."""
        return np.where(self.rotational, 1.0, self.model.length)

    def load(self, t: Array, q: Array, u: Array, s: Array | None = None, z: Array | None = None) -> Array:
        """f (nt, nu): all forces but those of constraints and their friction; M u' + G^T lambda = f. z (nt, nz): stresses of
        the beams, by default those of their strains (where a beam is stiff, they magnify the error of the positions)."""
        f = np.zeros((len(t), self.nu))
        for g, p, values in self.evaluate(_loads, t, q, u, s):
            for i in range(values.shape[1]):
                for o, target in enumerate(p.targets):
                    f[:, self.numbering.velocity(target, g, i)] -= values[:, i, o]
        return f + self._of_beams(t, q, u, z) if self.model.lines else f

    @cached_property
    def _batches(self) -> dict[bool, list[Batch]]:
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

    def _add_batch(self, f: Array, batch: Batch, t: Array, q: Array, u: Array, z: Array | None = None) -> None:
        x = nodal_inputs(batch.kernel, batch.lines, q, u, self.prescribed(t, batch.timed))
        if z is not None and batch.stresses.size:
            x = np.hstack([x, z[:, batch.stresses].reshape(len(x), -1)])
        momentum = [(o, a, i) for o, (head, a, i) in enumerate((*t, 0)[:3] for t in batch.kernel.targets) if head == "u"]
        at = np.array([[e[a].u + i for _, a, i in momentum] for e in batch.nodes], dtype=np.intp).ravel()
        values = batch.kernel.values(x)[:, [o for o, _, _ in momentum]]
        np.add.at(f.T, at, -values.reshape(len(t), -1).T)

    def elastic_force(self, q: Array) -> Array:
        """Forces (nu,) by which the beams resist their deformation at positions q (nq,)."""
        f = np.zeros((1, self.nu))
        for batch in self._batches[False]:
            if not batch.is_load:
                self._add_batch(f, batch, np.zeros(1), q[None], np.zeros((1, self.nu)))
        return np.asarray(f[0])

    def power_of_loads(self, t: Array, q: Array, u: Array) -> Array:
        """Power (nt,) of following and timed loads on beams, W."""
        f = np.zeros((len(t), self.nu))
        for batch in self._batches[False]:
            if batch.is_load:
                self._add_batch(f, batch, t, q, u)
        return np.asarray(np.einsum("ti,ti->t", f, u))

    def constraint_jacobian(self, t: Array, q: Array) -> Array:
        """G (nt, m, nu)."""
        G = np.zeros((len(t), self.m, self.nu))
        for g, p, values in self.evaluate(jacobian_G, t, q, np.zeros((len(t), self.nu))):
            taken, rows, columns = self._places_in_G(g, p)
            places: Any = slice(None), rows, columns
            np.add.at(G, places, values.reshape(len(t), -1)[:, taken])
        return G

    def _places_in_G(self, g: int, p: Any) -> tuple[Index, Index, Index]:
        """Numbers of the values of a group (instances times outputs) that belong to rows in force, their rows and columns."""
        if g not in self._places:
            found = []
            for n, (i, (_, r, side, column)) in enumerate(product(range(len(self.model.groups[g].instances)), p.targets)):
                row = self.numbering.row(g, i, r)
                if row is not None:
                    found.append((n, row, self.numbering.velocity(("u", side, column), g, i)))
            self._places[g] = tuple(np.array(found, dtype=np.intp).reshape(-1, 3).T)  # type: ignore[assignment]
        return self._places[g]

    def _rows(self, outputs: Outputs, t: Array, q: Array, u: Array) -> Array:
        out = np.zeros((len(t), self.m))
        for g, p, values in self.evaluate(outputs, t, q, u):
            for i in range(values.shape[1]):
                for o, target in enumerate(p.targets):
                    row = self.numbering.row(g, i, target[1])
                    if row is not None:
                        out[:, row] = values[:, i, o]
        return out

    def of_states(self, outputs: Outputs, t: Array, q: Array, u: Array, s: Array | None = None) -> Array:
        """(nt, ns) outputs that belong to internal states: their start values, or their rates."""
        nb = self.numbering
        out = np.zeros((len(t), len(nb.states)))
        for g, p, values in self.evaluate(outputs, t, q, u, s):
            for i in range(values.shape[1]):
                for o, target in enumerate(p.targets):
                    out[:, nb.place(target, g, i) - nb.start["s"]] = values[:, i, o]
        return out

    def position_residual(self, t: Array, q: Array) -> Array:
        """g (nt, m)."""
        return self._rows(position, t, q, np.zeros((len(t), self.nu)))

    def velocity_residual(self, t: Array, q: Array, u: Array) -> Array:
        """G u + g_t (nt, m)."""
        return self._rows(velocity, t, q, u)

    def acceleration_bias(self, t: Array, q: Array, u: Array) -> Array:
        """gamma (nt, m): d2g/dt2 = G u' + gamma."""
        return self._rows(acceleration, t, q, u)

    def accelerations(self, t: Array, q: Array, u: Array, s: Array | None = None,
                      z: Array | None = None) -> tuple[Array, Array]:  # fmt: skip
        """u' (nt, nu) and lambda (nt, m) from M u' + G^T lambda = f, G u' = -gamma; where lambda is not unique the one of least
        norm, every row in the unit of its work in a unit displacement (the scene's length, 1 rad).

        With friction that follows from reactions f depends on lambda: see `pressed.py`."""
        f = self.load(t, q, u, s, z)
        with one_thread():
            solve = self._constrained(t, q, u)
            return pressed.solved(self, (t, q, u, s), f, solve) if self.reactive and self.m else solve(f, None)

    def _constrained(self, t: Array, q: Array, u: Array) -> pressed.Solve:
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

    @cached_property
    def _kinds(self) -> list[tuple[NodeKind, Any, Any]]:
        """Kinds of nodes with the places in q and u of all their nodes, (k, nq) and (k, nu)."""
        found: dict[NodeKind, list[Node]] = {}
        for node in self.model.nodes:
            found.setdefault(node.kind, []).append(node)
        first = {kind: np.array([(n.q, n.u) for n in nodes]) for kind, nodes in found.items()}
        return [(kind, at[:, :1] + np.arange(kind.sizes[0]), at[:, 1:] + np.arange(kind.sizes[1])) for kind, at in first.items()]

    def integrate_positions(self, q: Array, displacement: Array) -> Array:
        """q (nq,) moved by virtual displacements (nu,): translations add, rotations in body axes compose."""
        q = q.copy()
        for kind, at, by in self._kinds:
            d = displacement[by]
            if kind is NodeKind.SPATIAL:
                q[at[:, :3]] += d[:, :3]
                q[at[:, 3:]] = turned(q[at[:, 3:]], d[:, 3:])
            else:
                q[at] += d
        return q

    def rates(self, q: Array, u: Array) -> Array:
        """q' (nq,) of velocities u (nu,)."""
        qp = np.zeros(self.nq)
        for kind, at, by in self._kinds:
            d = u[by]
            if kind is NodeKind.SPATIAL:
                qp[at[:, :3]] = d[:, :3]
                qp[at[:, 3:]] = quaternion_product(q[at[:, 3:]], np.hstack([np.zeros((len(d), 1)), d[:, 3:]])) / 2
            else:
                qp[at] = d
        return qp


def _largest(values: Array, otherwise: float) -> float:
    largest = float(np.max(values, initial=0.0))
    return largest if largest > 0 else otherwise
