"""Displacements of a body besides those of Craig and Bampton: of the second order of its modes, from which loads stiffen or
soften it, and those of the body with free interfaces.

A beam that bends becomes shorter. Where a force or a turning frame pulls at it, this shortening does work, which is the geometric
stiffness. A body moves by u = sum c_i shape_i + 1/2 sum c_i c_k second_ik, and its elastic energy in the coordinates c of the
modes keeps no terms of the third order where

    K second_ik = -(force of the second order by the modes i and k)

in all directions but those of the modes. Of three directions of the modes one may take up what the other two force on it, or each
a part, as far as the third order goes; but where a direction of stretching does not take up all of the shortening by two of
bending, the fourth order is as large as the stretching is stiff. Stiffness does not tell them apart, for a bend near an interface
alone is as stiff; `_taken` does. Energy, momentum and all derivatives follow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mbdae.deferred import eigsh, sp
from mbdae.errors import OptionError
from mbdae.inputs.matrices import DENSE, refuse_soft
from mbdae.inputs.reduction import MANY, SHOWN, FiniteElements, rigid_motions
from mbdae.values import Array, array, option

#: (f k,) and (f k,) displacements u and v -> (f k,) N: the internal force of the second order, symmetric in u and v; with both
#: equal it is twice that by u
SecondForce = Callable[[Array, Array], Array]
EXACT = 1e-6  #: relative size of what two-node elements may leave of K
WRONG = 1e-5  #: relative size of what a function of the user may leave of the properties of a force of the second order
KEPT = 1e-6  #: displacements of the second order, over the largest, below which they are left out


def second_displacements(body: FiniteElements, found: dict[str, Any], solve: Callable[[Array], Array], static: Array,
                         force: SecondForce | None) -> dict[str, Any]:
    """Fields `bends`, `stretches` and `interface_bends` of `ReducedBody`. found: its other fields; solve: displacement of the
    inner freedoms by forces on them with held interfaces; static: (f k, 6 interfaces) static deformations; force: None takes K as
    that of two-node elements."""
    shapes, stiffness = found["shapes"].reshape(body.K.shape[0], -1), found["modal_stiffness"]
    n, pairs = len(stiffness), np.array(np.triu_indices(len(stiffness)))
    if not n:
        return {}
    by_pairs = _TwoNodes(body)(shapes, *pairs) if force is None else np.column_stack(
        [_forces(force, shapes[:, i], shapes[:, k]) for i, k in pairs.T])
    if force is not None:
        _refuse_wrong(body, force)
    turned, more = _turned_interfaces(body, found, shapes, pairs)
    by_pairs = by_pairs + body.K @ turned + more
    inertia = body.M @ body.rigid
    of_modes = shapes.T @ by_pairs
    relieved = by_pairs - inertia @ np.linalg.solve(body.rigid.T @ inertia, body.rigid.T @ by_pairs)
    second = body.inner @ solve(body.inner.T @ relieved)
    second += static @ np.linalg.lstsq(static.T @ (body.K @ static), static.T @ relieved, rcond=1e-10)[0]
    second -= shapes @ (of_modes / stiffness[:, None])
    second += shapes @ _taken(body, found, of_modes, pairs)
    second += body.rigid @ np.linalg.solve(body.rigid.T @ inertia, inertia.T @ (turned - second))
    return _coordinates(body, found, -second, turned, pairs)


def _forces(force: SecondForce, u: Array, v: Array) -> Array:
    """The forces (f k,), N, that a function of the user returns."""
    return option("stiffening", force(u, v), lambda x: array(x, (len(u),)), f"give a function that returns {len(u)} forces, N")


def _refuse_wrong(body: FiniteElements, force: SecondForce) -> None:
    """Raise OptionError for a function that is not linear in each of its displacements, not symmetric in them, or, of three
    freedoms a node, no force of the second order of K. A body that is deformed by u and then turned by r, v = r x nodes, has its
    internal force turned with it: force(u, v) = r x (K u) - K (r x u). A wrong sign or factor does not hold that."""
    (u, w), turn = np.random.default_rng(5).normal(size=(2, body.K.shape[0])) * body.size, np.array([0.3, -0.5, 0.7])

    def turned(x: Array) -> Array:
        return np.cross(turn, x.reshape(-1, 3)).ravel()

    rigid = turned(body.nodes.ravel()) if body.freedoms == 3 else w
    found, other = _forces(force, u, rigid), _forces(force, w, rigid)
    size = max(float(np.max(np.abs(found))), float(np.max(np.abs(body.K @ rigid))), 1e-300)
    wrong = {"not symmetric in its two displacements": _forces(force, rigid, u) - found,
             "not linear in its displacements": _forces(force, u + 2 * w, rigid) - found - 2 * other}
    if body.freedoms == 3:
        exact = turned(body.K @ u) - body.K @ turned(u)
        size = max(size, float(np.max(np.abs(exact))))
        wrong["not that of K, or has another sign or factor: of a deformed body that turns"] = found - exact
    for what, off in wrong.items():
        if (most := float(np.max(np.abs(off)))) > WRONG * size:
            raise OptionError(f"stiffening: the force of the second order is {what}, {most / size:.2g} of its size off; give the "
                              "change of K by a small displacement u, times v, which is symmetric in u and v")


def _taken(body: FiniteElements, found: dict[str, Any], of_modes: Array, pairs: Any) -> Array:
    """Coordinates (n, pairs) of the modes in the displacements of the second order, by forces of the second order (n, pairs).

    In coordinates by which the elastic energy is half the sum of squares, loads at interfaces cause deformations y of the
    covariance C, and these the forces T(y, y). Eigenvectors of the covariance of these forces order the directions, those of
    stretching first. Of three of them each takes up the part of T that its eigenvalue is of the sum of the three."""
    root, (i, k) = np.sqrt(found["modal_stiffness"]), pairs
    T = np.zeros((len(root), len(root), len(root)))
    T[:, i, k] = T[:, k, i] = of_modes / root[:, None] / (root[i] * root[k])
    units = np.repeat([1.0, 1 / body.size], 3)[:, None]
    loads = np.vstack([units * found["interface_shapes"][name] for name in body.names]) / root
    C = loads.T @ loads / np.sum(loads**2)
    forces = np.einsum("lik,ij,km->ljm", T, C, C, optimize=True)
    values, turn = np.linalg.eigh(np.einsum("ljm,pjm->lp", forces, T, optimize=True))
    size = np.maximum(values / max(values[-1], 1e-300), 1e-30)
    T = np.einsum("lik,la,ib,kc->abc", T, turn, turn, turn, optimize=True)
    T *= size[:, None, None] / (size[:, None, None] + size[:, None] + size)
    T = np.einsum("abc,la,ib,kc->lik", T, turn, turn, turn, optimize=True)
    return np.asarray(T[:, i, k] * (root[i] * root[k]) / root[:, None])


def _turned_interfaces(body: FiniteElements, found: dict[str, Any], shapes: Array, pairs: Any) -> tuple[Array, Array]:
    """(f k, pairs) displacements of the second order of the nodes of interfaces, which keep their distances as these turn; and
    the forces of the second order by what further turns of the interfaces move these nodes."""
    i, k = pairs
    moved = np.zeros((len(body.nodes), body.freedoms, len(i)))
    forces = (body.K @ shapes).reshape(len(body.nodes), body.freedoms, -1)
    inverse = np.linalg.inv((body.held.T @ body.held).toarray())
    torques = np.zeros((len(body.names), 6, len(i)))
    for number, (name, nodes, place) in enumerate(zip(body.names, body.members, body.places, strict=True)):
        turns = found["interface_shapes"][name][3:].T
        arms = (body.nodes[nodes] - place)[:, None]
        one, other = turns[i], turns[k]
        moved[nodes, :3] = _both(one, other, arms).transpose(0, 2, 1)
        for turn, f in ((one, forces[nodes, :3][:, :, k]), (other, forces[nodes, :3][:, :, i])):
            F = f.transpose(0, 2, 1)
            torques[number, 3:] += np.sum(np.cross(arms, np.cross(F, turn)) + np.cross(np.cross(turn, arms), F), axis=0).T / 2
    return moved.reshape(-1, len(i)), body.held @ (inverse @ torques.reshape(-1, len(i)))


def _both(a: Array, b: Array, arms: Array) -> Array:
    """Displacement of the second order, symmetric in two rotations."""
    return np.asarray(np.cross(a, np.cross(b, arms)) + np.cross(b, np.cross(a, arms))) / 2


def _coordinates(body: FiniteElements, found: dict[str, Any], second: Array, turned: Array, pairs: Any) -> dict[str, Any]:
    """The displacements (f k, pairs) of the second order as few coordinates: what moves the inertia (six sums of mass times place
    times displacement) and the interfaces. turned: what is added by turns of the interfaces."""
    fields, n, whole = _stretches(body), len(found["modal_stiffness"]), second + turned
    moments = np.stack([fields[a, b].T @ (body.M @ whole) for a in range(3) for b in range(3)]) / (body.mass * body.size)
    held = np.linalg.lstsq((body.held.T @ body.held).toarray(), body.held.T @ second, rcond=None)[0]
    units = np.tile(np.repeat([1.0, body.size], 3), len(body.names))
    left, sigma, right = np.linalg.svd(np.vstack([moments, held * units[:, None]]), full_matrices=False)
    kept = sigma > KEPT * max(sigma[0], 1e-300)
    left, right = left[:, kept] * sigma[kept], right[kept]
    bends = np.zeros((len(right), n, n))
    bends[:, pairs[0], pairs[1]] = bends[:, pairs[1], pairs[0]] = right
    there = np.trace(found["inertia"]) / 2 * np.eye(3) - found["inertia"]
    values, axes = np.linalg.eigh(there)
    inverse = (axes / np.where(values > 1e-9 * np.max(values), values, np.inf)) @ axes.T
    stretches = np.moveaxis(left[:9].reshape(3, 3, -1), 2, 0) * body.mass * body.size @ inverse
    at = left[9:] / units[:, None]
    return {"bends": bends, "stretches": stretches,
            "interface_bends": {name: at[6 * i : 6 * i + 6] for i, name in enumerate(body.names)}}


def _stretches(body: FiniteElements) -> Array:
    """(3, 3, f k) displacements e_a x_b, symmetric in a and b, of the nodes, x from the centre of mass."""
    out = np.zeros((3, 3, len(body.nodes), body.freedoms))
    for a in range(3):
        for b in range(3):
            out[a, b, :, a] += (body.nodes - body.center)[:, b] / 2
            out[a, b, :, b] += (body.nodes - body.center)[:, a] / 2
    return out.reshape(3, 3, -1)


class _TwoNodes:
    """The elements between two nodes that K consists of, six freedoms a node, and their forces of the second order.

    In the axes of the line between its nodes, which turn with it, an element is stretched by e and its ends are turned by a and
    b: V = (e, a, b) k (e, a, b) / 2, and the normal force N acts on the slopes along a cubic line between the ends, by
    N h (2 a^2 - a b + 2 b^2) / 30 in either plane."""

    def __init__(self, body: FiniteElements) -> None:
        if body.freedoms != 6:
            raise OptionError("stiffening = True reads two-node elements, with six freedoms a node, from K: give the function of "
                              "two displacements (u, v) that returns the internal force of the second order, N")
        blocks = sp.triu(sp.bsr_matrix(body.K, blocksize=(6, 6)).tocoo(), 1)
        pairs = np.unique(np.stack([blocks.row // 6, blocks.col // 6], axis=1), axis=0)
        self.pairs = pairs[pairs[:, 0] != pairs[:, 1]]
        self.rows = (6 * self.pairs[:, :, None] + np.arange(6)).reshape(-1, 12)
        line = np.diff(body.nodes[self.pairs], axis=1)[:, 0]
        self.h = np.linalg.norm(line, axis=1)
        if not np.all(self.h > 0):
            raise OptionError("stiffening = True: two nodes that K connects are at the same place: give the function of two "
                              "displacements (u, v) that returns the internal force of the second order, N")
        k = np.zeros((len(self.pairs), 12, 12))
        K = body.K.tocsr()
        for e, (i, j) in enumerate(self.pairs):  # rigid motions of an element need no force
            block, turn = K[6 * i : 6 * i + 6, 6 * j : 6 * j + 6].toarray(), rigid_motions(line[e : e + 1], np.zeros(3), 6)
            k[e, :6, 6:], k[e, 6:, :6] = block, block.T
            k[e, :6, :6], k[e, 6:, 6:] = -block @ turn, -block.T @ np.linalg.inv(turn)
        at = np.broadcast_to(self.rows[:, :, None], k.shape), np.broadcast_to(self.rows[:, None], k.shape)
        missing = sp.csc_matrix((k.ravel(), (at[0].ravel(), at[1].ravel())), shape=K.shape) - body.K
        if abs(missing).max() > EXACT * abs(body.K).max():
            raise OptionError("stiffening = True: K is not that of elements between two nodes: give the function of two "
                              "displacements (u, v) that returns the internal force of the second order, N")
        self.axes = np.kron(np.eye(4), np.ones((3, 3))) * np.tile(np.stack([_axes(x) for x in line]), (1, 4, 4))
        self.k = self.axes @ k @ self.axes.transpose(0, 2, 1)
        unit = np.eye(12)
        alone = [self._bent(x) for x in unit]
        #: (elements, 7, 12, 12) second derivatives of stretch and turns of the ends
        self.second = np.stack([np.stack([self._bent(x + y) - alone[a] - alone[b] for b, y in enumerate(unit)], axis=2)
                                for a, x in enumerate(unit)], axis=2)
        self.turned = np.stack([self._turns(x) for x in unit], axis=2)  #: (elements, 4, 12): of the ends about y, y, z, z
        self.slopes = self.h[:, None, None] / 30 * np.kron(np.eye(2), [[4.0, -1.0], [-1.0, 4.0]])

    def _bent(self, x: Array) -> Array:
        """(elements, 7) terms of the second order of stretch and turns of both ends, by displacements x (12,) in its axes."""
        d, first, last = x[6:9] - x[:3], x[3:6], x[9:]
        h = self.h
        phi = np.stack([0 * h + (first[0] + last[0]) / 2, -d[2] / h, d[1] / h], axis=1)
        more = np.stack([0 * h, d[0] * d[2] / h**2 + phi[:, 0] * phi[:, 2] / 2,
                         -d[0] * d[1] / h**2 - phi[:, 0] * phi[:, 1] / 2], axis=1)
        return np.column_stack([(d[1] ** 2 + d[2] ** 2) / (2 * h), *(-more - np.cross(phi, end) / 2 for end in (first, last))])

    def _turns(self, x: Array) -> Array:
        d = x[6:9] - x[:3]
        along = np.stack([-d[2] / self.h, d[1] / self.h], axis=1)
        return np.stack([x[4] - along[:, 0], x[10] - along[:, 0], x[5] - along[:, 1], x[11] - along[:, 1]], axis=1)

    def __call__(self, shapes: Array, i: Array, k: Array) -> Array:
        """(f k, pairs) forces of the second order by the pairs (i, k) of shapes (f k, n)."""
        W = np.einsum("eab,ebn->ean", self.axes, shapes[self.rows])
        forces = self.k @ W
        G, N = forces[:, [6, 3, 4, 5, 9, 10, 11]], forces[:, 6]
        turned = np.einsum("eab,ebn->ean", self.turned, W)
        by_turns = np.einsum("eab,ean->ebn", self.turned, self.slopes @ turned)  # of Q(., w)
        T = np.einsum("eoab,eon->enab", self.second, G)  # n: the mode whose forces act
        found = np.zeros((len(shapes), len(i)))
        pull = self.k[:, 6]  # (elements, 12): N of a displacement
        for p, (a, b) in enumerate(zip(i, k, strict=True)):
            own = (T[:, a] @ W[:, :, b, None] + T[:, b] @ W[:, :, a, None])[:, :, 0]
            bent = np.einsum("eoab,ea,eb->eo", self.second, W[:, :, a], W[:, :, b])
            d = np.zeros((len(self.h), 12))
            d[:, [6, 3, 4, 5, 9, 10, 11]] = bent
            own += (self.k @ d[:, :, None])[:, :, 0]
            both = np.einsum("ea,ea->e", turned[:, :, a], (self.slopes @ turned[:, :, b, None])[:, :, 0])
            own += N[:, a, None] * by_turns[:, :, b] + N[:, b, None] * by_turns[:, :, a] + pull * both[:, None]
            np.add.at(found[:, p], self.rows, np.einsum("eba,eb->ea", self.axes, own))
        return found


def _axes(line: Array) -> Array:
    """(3, 3) unit vectors along a line and across it."""
    x = line / np.linalg.norm(line)
    y = np.cross(np.eye(3)[np.argmin(np.abs(x))], x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def free_basis(body: FiniteElements, solve: Callable[[Array], Array], statics: Array, modes: int | None,
               enough: tuple[float, float]) -> tuple[Array, Array, Array, Array]:
    """Rigid motions, modes of the free body, and what these leave out of its deformation by forces at the interfaces: residual
    flexibility, by which static deformations are complete. Inertia forces of uniform accelerations balance these forces, so that
    weight and slow motion are shown too.

    solve, statics: as in `second_displacements`; modes: number of modes, None: all below enough[1] Hz over the root of enough[0],
    since loads shake the first mode left out by the square of their frequency over its own. Returns the basis (f k, n), the
    motions of the interfaces by it (6 interfaces, n), the coordinates of the rigid motions (n, 6), the frequencies kept, Hz."""
    T, b, static = sp.hstack([body.held, body.inner]).tocsc(), body.held.shape[1], statics[body.kept]
    K, M = (sp.csc_matrix(T.T @ A @ T) for A in (body.K, body.M))
    rigid = np.vstack([body.rigid_interfaces, body.rigid[body.kept]])
    inertia, stiffness = M @ rigid, (statics.T @ (body.K @ statics))[6:, 6:]
    relief = np.linalg.inv(rigid.T @ inertia)
    units = np.tile(np.repeat([1.0, body.size], 3), len(body.names))
    if b > 6:
        terms = np.einsum("ia,ia->a", abs(statics), abs(body.K) @ abs(statics))
        refuse_soft(np.linalg.eigvalsh(stiffness / np.outer(units[6:], units[6:])), float(np.max(terms / units**2)))

    def deformed(forces: Array) -> Array:
        """Deformation, without rigid motion, by forces and the inertia forces of the rigid motion that they cause."""
        f = forces - inertia @ (relief @ (rigid.T @ forces))
        moved = np.zeros((b, *f.shape[1:]))
        moved[6:] = np.linalg.solve(stiffness, (f[:b] + static.T @ f[b:])[6:])  # the first interface is held
        x = np.concatenate([moved, solve(f[b:]) + static @ moved])
        return np.asarray(x - rigid @ (relief @ (inertia.T @ x)))

    values, vectors = _modes_of_free(K, M, inertia, deformed, modes, enough[1] / np.sqrt(enough[0]))
    unit = np.eye(K.shape[0], b) / units
    whole = deformed(unit)
    residual = whole - vectors @ (vectors.T @ unit / values[:, None])
    energy, turned = np.linalg.eigh(residual.T @ (K @ residual))
    kept = energy > SHOWN * np.max(np.einsum("ia,ia->a", unit, whole))
    basis = np.hstack([rigid, vectors, residual @ turned[:, kept] / np.sqrt(energy[kept])])
    return T @ basis, basis[:b], np.eye(basis.shape[1], 6), np.sqrt(values) / (2 * np.pi)


def _modes_of_free(K: Any, M: Any, inertia: Array, deformed: Callable[[Array], Array], modes: int | None,
                   below: float) -> tuple[Array, Array]:
    """Squared angular frequencies (m,) and modes (n, m), of modal mass 1, of a free body, lowest first: `modes` of them, or with
    None those below a frequency, Hz. inertia: M times the rigid motions; deformed: see `free_basis`."""
    from scipy.linalg import eigh, null_space
    from scipy.sparse.linalg import LinearOperator

    n, count = K.shape[0], 12 if modes is None else modes
    most = n - 6
    if modes is None and not np.isfinite(below):
        raise OptionError("modes = None: give up_to=, the highest frequency of the loads (Hz), or the number of modes")
    while True:
        if not count:
            return np.zeros(0), np.zeros((n, 0))
        if n <= DENSE or count >= most:
            elastic = null_space((inertia / np.linalg.norm(inertia, axis=0)).T)
            inverse, vectors = eigh(elastic.T @ M @ elastic, elastic.T @ K @ elastic)
            order = np.argsort(-inverse)[: min(count, most)]
            order = order[inverse[order] > 1e-14 * np.max(inverse)]
            values, vectors = 1 / inverse[order], elastic @ vectors[:, order] / np.sqrt(inverse[order])
        else:
            start = deformed(np.random.default_rng(0).standard_normal(n))
            values, vectors = eigsh(K, count, M, sigma=0.0, OPinv=LinearOperator((n, n), matvec=deformed), v0=start)
        if modes is not None:
            return values, vectors
        kept = int(np.sum(values < (2 * np.pi * below) ** 2))
        if kept < len(values) or len(values) < count:
            if kept > MANY:
                raise OptionError(f"modes = None: {kept} modes are below {below:g} Hz, more than {MANY}: give a larger accuracy, "
                                  f"a smaller up_to, or the number of modes")
            return values[:kept], vectors[:, :kept]
        count *= 2
