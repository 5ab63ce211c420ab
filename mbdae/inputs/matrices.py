"""Matrices of finite elements: whether they are symmetric and positive, and those of solids of linear elastic material, from
meshes of tetrahedra and hexahedra, with stresses at nodes and the force of the second order, by scikit-fem's shape functions."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from mbdae.deferred import eigsh, issparse, sp, splu
from mbdae.errors import OptionError
from mbdae.values import Array, array, option, shown

#: cells of meshio -> mesh and elements of scikit-fem of order 1 and 2
SOLIDS = {"tetra": ("MeshTet", ("ElementTetP1", "ElementTetP2")), "hexahedron": ("MeshHex", ("ElementHex1", "ElementHex2"))}
QUADRATIC = {"tetra10": ("tetra", 4), "hexahedron20": ("hexahedron", 8), "hexahedron27": ("hexahedron", 8)}
SIX = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  #: xx, yy, zz, yz, xz, xy


#: relative size up to which entries and forces that ought to vanish count as rounding: matrices of FE programs are written with
#: 6 to 16 digits
ROUNDED = 1e-6
INDEFINITE = 1e-9  #: negative eigenvalue of a stiffness, over the largest one, up to which it counts as rounding
DENSE = 400  #: number of inner freedoms up to which all modes are computed by a dense method


def package(name: str) -> Any:
    """A module of the extra `fe`."""
    try:
        return import_module(name)
    except ImportError:
        raise OptionError(f"{name} cannot be imported: pip install 'mbdae[fe]'") from None


@dataclass(frozen=True, eq=False)
class Solid:
    """Shape functions of a mesh. gradients: (local, 3, elements, points) of them; weights: (elements, points), m^3;
    numbers: (local, elements) of nodes; lame: Pa; at_nodes: three matrices (k, k) that take values at nodes to their derivatives
    along x, y, z there, the mean over the elements of the node."""

    gradients: Array
    weights: Array
    numbers: Any
    lame: tuple[float, float]
    at_nodes: tuple[Any, Any, Any]
    edges: Any  #: (e, 2) numbers of the nodes at the ends of edges on its surface

    def _stress(self, strain: Array) -> Array:
        """(3, 3, ...) stress, Pa, by a strain (3, 3, ...)."""
        return np.asarray(self.lame[0] * np.einsum("aa...->...", strain) * np.eye(3).reshape(3, 3, *(1,) * (strain.ndim - 2))
                          + 2 * self.lame[1] * strain)

    def stress(self, u: Array) -> Array:
        """(k, 6) stress at the nodes, Pa, xx yy zz yz xz xy, by displacements (3 k,), m."""
        moved = u.reshape(-1, 3)
        gradient = np.stack([D @ moved for D in self.at_nodes], axis=0)  # (derivative, k, component)
        found = self._stress(np.moveaxis(gradient + gradient.transpose(2, 1, 0), 1, 2) / 2)
        return np.stack([found[a, b] for a, b in SIX], axis=1)

    def _gradient(self, u: Array) -> Array:
        """(component, derivative, elements, points) of a displacement (3 k,)."""
        return np.asarray(np.einsum("iec,iaeq->caeq", u.reshape(-1, 3)[self.numbers], self.gradients))

    def second_force(self, u: Array, v: Array) -> Array:
        """(3 k,) internal force of the second order by displacements u and v (3 k,), N, by Green's strain."""
        du, dv = self._gradient(u), self._gradient(v)
        both = np.einsum("caeq,cbeq->abeq", du, dv)
        P = self._stress((both + both.transpose(1, 0, 2, 3)) / 2)
        for one, other in ((du, dv), (dv, du)):
            P = P + np.einsum("caeq,abeq->cbeq", one, self._stress((other + other.transpose(1, 0, 2, 3)) / 2))
        by_elements = np.einsum("cbeq,ibeq,eq->iec", P, self.gradients, self.weights)
        out = np.zeros((self.at_nodes[0].shape[0], 3))
        np.add.at(out, self.numbers, by_elements)
        return out.ravel()


MOST_EDGES = 1500  #: largest number of lines by which a body of matrices alone is drawn


def drawn_edges(K: Any, nodes: Array) -> Array:
    """(e, 2) pairs of nodes that a stiffness connects, of many the shortest."""
    f = K.shape[0] // len(nodes)
    blocks = sp.triu(sp.coo_matrix(K)).tocoo()
    pairs = np.unique(np.stack([blocks.row // f, blocks.col // f], axis=1)[blocks.data != 0], axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    order = np.argsort(np.linalg.norm(nodes[pairs[:, 0]] - nodes[pairs[:, 1]], axis=1), kind="stable")
    return np.asarray(pairs[np.sort(order[:MOST_EDGES])], dtype=float)


def stresses_by_modes(stress: Any, shapes: Array) -> Array:
    """(k, 6, n) stresses by the modes, by a function of displacements."""
    if not callable(stress):
        raise OptionError(f"stress = {shown(stress)}: give a function of displacements ({shapes[:, :, 0].size},), or None")
    return np.stack([option("stress", stress(shapes[:, :, i].ravel()), lambda x: array(x, (len(shapes), 6)),
                            f"give a function that returns the stresses ({len(shapes)}, 6), Pa") for i in range(shapes.shape[2])],
                    axis=2) if shapes.shape[2] else np.zeros((len(shapes), 6, 0))


def assembled(read: Any, E: float, nu: float, density: float, unit: float, order: int, called: str) -> Any:
    """M, K, nodes, sets and the `Solid` of a mesh that meshio has read."""
    fem = package("skfem")
    kind, corners = _solid_cells(read, called)
    if twice := len(corners) - len(np.unique(np.sort(corners, axis=1), axis=0)):
        raise OptionError(f"{called}: {twice} of its elements are in it twice, and would count twice in M and K: leave them out")
    used, inverse = np.unique(corners, return_inverse=True)
    mesh_class, elements = SOLIDS[kind]
    points = np.asarray(read.points, dtype=float)[used] * unit
    cells = inverse.reshape(corners.shape)
    if kind == "hexahedron":  # corners as scikit-fem counts them
        cells = cells[:, [0, 1, 3, 4, 2, 5, 7, 6]]
    element = getattr(fem, elements[order - 1])()
    try:
        mesh = getattr(fem, mesh_class)(points.T.copy(), cells.T.copy())
        basis = fem.Basis(mesh, element)
    except Exception as error:  # it raises plain ones at elements whose corners are tangled
        raise OptionError(f"{called}: scikit-fem cannot assemble it ({error}): are corners of elements out of their order, or "
                          f"elements folded?") from None
    k, numbers = basis.N, np.asarray(basis.element_dofs)
    gradients = np.stack([np.asarray(one[0].grad) for one in basis.basis])
    values = np.stack([np.broadcast_to(np.asarray(one[0]), basis.dx.shape) for one in basis.basis])
    weights = np.asarray(basis.dx)
    volumes = np.broadcast_to(np.asarray(basis.mapping.detDF(basis.X)), weights.shape)
    if (bad := ~(np.min(volumes, axis=1) * np.max(volumes, axis=1) > 0)).any():
        raise OptionError(f"{called}: {int(np.sum(bad))} of its elements are folded or have no volume: give a valid mesh")
    lame = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    A = [[_scattered(np.einsum("ieq,jeq,eq->ije", gradients[:, a], gradients[:, b], weights), numbers, k)
          for b in range(3)] for a in range(3)]
    trace = A[0][0] + A[1][1] + A[2][2]
    blocks = [[lame[0] * A[a][b] + lame[1] * A[b][a] + (lame[1] * trace if a == b else 0 * trace) for b in range(3)]
              for a in range(3)]
    by_nodes = np.arange(3 * k).reshape(3, k).T.ravel()
    K = sp.csr_matrix(sp.bmat(blocks))[by_nodes][:, by_nodes]
    M = sp.kron(density * _scattered(np.einsum("ieq,jeq,eq->ije", values, values, weights), numbers, k), sp.identity(3))
    places = np.asarray(basis.doflocs).T.copy()
    solid = Solid(gradients, weights, numbers, lame, _derivatives(fem, mesh, element, numbers, k),
                  np.asarray(basis.nodal_dofs)[0][mesh.edges[:, mesh.boundary_edges()]].T)
    return sp.csc_matrix(M), sp.csc_matrix(K), places, _sets(read, used, mesh, basis), solid


def _solid_cells(read: Any, called: str) -> tuple[str, Any]:
    """Kind and corners (elements, 4 or 8) of the solid cells of a mesh, which are of one kind."""
    found: dict[str, list[Any]] = {}
    for block in read.cells:
        kind, corners = QUADRATIC.get(block.type, (block.type, None))
        if kind in SOLIDS and len(block.data):
            found.setdefault(kind, []).append(np.asarray(block.data)[:, :corners])
    if len(found) != 1:
        other = ", ".join(sorted({block.type for block in read.cells})) or "no cells"
        raise OptionError(f"{called}: {'tetrahedra and hexahedra are mixed' if found else 'it has no solid cells'} ({other}): "
                          f"give a mesh of tetrahedra or of hexahedra")
    kind, blocks = next(iter(found.items()))
    return kind, np.concatenate(blocks)


def _scattered(local: Array, numbers: Any, k: int) -> Any:
    """The sparse matrix (k, k) of element matrices (local, local, elements)."""
    rows, columns = (np.broadcast_to(x, local.shape) for x in (numbers[:, None], numbers[None]))
    return sp.csr_matrix((local.ravel(), (rows.ravel(), columns.ravel())), shape=(k, k))


def _derivatives(fem: Any, mesh: Any, element: Any, numbers: Any, k: int) -> tuple[Any, Any, Any]:
    """Three matrices (k, k): derivatives at nodes along x, y, z, the mean over the elements that meet there."""
    places = np.asarray(element.doflocs).T
    basis = fem.Basis(mesh, element, quadrature=(places, np.ones(places.shape[1])))
    gradients = np.stack([np.asarray(one[0].grad) for one in basis.basis])  # (shape function, 3, elements, local node)
    count = np.bincount(numbers.ravel(), minlength=k)
    found = [_scattered((gradients[:, a] / count[numbers.T]).transpose(2, 0, 1), numbers, k) for a in range(3)]
    return found[0], found[1], found[2]


def _sets(read: Any, used: Any, mesh: Any, basis: Any) -> dict[str, Array]:
    """Sets of nodes by name: those of the mesh, and of its named groups of faces, edges and points; nodes on edges, faces and
    in cells belong where all corners do."""
    corners: dict[str, Any] = {str(name): np.asarray(members, dtype=int) for name, members in read.point_sets.items()}
    for name, blocks in read.cell_sets.items():
        if ":" not in str(name):
            parts = [np.asarray(block.data)[np.asarray(members, dtype=int)].ravel() for block, members in
                     zip(read.cells, blocks, strict=False) if members is not None and len(members)]
            corners.setdefault(str(name), np.concatenate(parts) if parts else np.zeros(0, dtype=int))
    for name, (tag, dimension) in ((n, np.ravel(x)[:2]) for n, x in read.field_data.items()):
        tags = read.cell_data.get("gmsh:physical", [])
        parts = [np.asarray(block.data)[np.asarray(t) == tag].ravel() for block, t in zip(read.cells, tags, strict=False)
                 if block.dim == dimension]
        if parts:
            corners.setdefault(str(name), np.concatenate(parts))
    found = {}
    for name, members in corners.items():
        inside = np.isin(used, members)
        mine = [np.asarray(basis.nodal_dofs)[:, inside].ravel()]
        for dofs, ends in ((basis.edge_dofs, mesh.edges), (basis.facet_dofs, mesh.facets), (basis.interior_dofs, mesh.t)):
            if np.size(dofs):
                mine.append(np.asarray(dofs)[:, np.all(inside[ends], axis=0)].ravel())
        found[name] = np.unique(np.concatenate(mine)).astype(int)
    return {name: members for name, members in found.items() if len(members)}


@dataclass(frozen=True)
class Scaled:
    """Factors of D A D, which solve with A."""

    factors: Any
    D: Array

    def solve(self, b: Array) -> Array:
        """A^-1 b, for b (n,) or (n, k)."""
        D = self.D if b.ndim == 1 else self.D[:, None]
        return np.asarray(D * self.factors.solve(np.ascontiguousarray(D * b)))


def symmetric(name: str, given: Any) -> Any:
    """The matrix as CSC, symmetric and finite."""
    if not issparse(given):
        given = option(name, given, array, "give a square matrix, full or SciPy sparse")
        if given.ndim != 2:
            raise OptionError(f"{name} has {given.ndim} dimensions: give a square matrix, full or SciPy sparse")
    found = sp.csc_matrix(given, dtype=float)
    if found.shape[0] != found.shape[1] or not found.shape[0]:
        raise OptionError(f"{name} is {' by '.join(map(str, found.shape))}: give a square matrix, full or SciPy sparse")
    if not np.all(np.isfinite(found.data)):
        raise OptionError(f"{name} has entries that are not finite")
    off, size = abs(found - found.T), float(abs(found).max())
    if size == 0 or off.max() > ROUNDED * size:
        raise OptionError(f"{name} is {'zero: all its entries are 0' if size == 0 else f'not symmetric: {one_sided(found)}'}")
    return sp.csc_matrix((found + found.T) / 2)


def one_sided(matrix: Any) -> str:
    """Where a matrix is least symmetric, in words."""
    if not (sp.triu(matrix, 1).nnz and sp.tril(matrix, -1).nnz):
        return "give the whole symmetric matrix, not a half"
    i, j = sorted(divmod(int(abs(matrix - matrix.T).argmax()), matrix.shape[0]))
    return f"its entries [{i}, {j}] and [{j}, {i}], counted from 0, are {matrix[i, j]:g} and {matrix[j, i]:g}"


def signed_factors(matrix: Any) -> Any:
    """LU factors with a symmetric order and pivots on the diagonal, whose signs are those of the eigenvalues."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def pivots_of(factors: Any) -> Array:
    """The pivots; 0 where one had to be taken off the diagonal, as in an indefinite matrix alone."""
    return np.asarray(factors.U.diagonal()) if np.array_equal(factors.perm_r, factors.perm_c) else -np.ones(1)


def refuse_negative(name: str, matrix: Any, freedom: Any) -> None:
    """Refuse a matrix with a negative eigenvalue; freedoms may have none of it."""
    size = matrix.diagonal()
    scale = 1 / np.sqrt(np.where(size > 0, size, 1.0))
    if np.any(size == 0) and abs(matrix).sum(axis=0).A1[size == 0].max(initial=0) > 0:
        raise OptionError(f"{name} is indefinite: {freedom(np.flatnonzero(size == 0)[0])} has no mass but couples")
    D = sp.diags(scale)
    scaled = sp.csc_matrix(D @ matrix @ D + ROUNDED * sp.identity(len(size)))
    if len(size) <= DENSE:
        least = np.linalg.eigvalsh(scaled.toarray())[0]
    else:  # Lanczos takes a twentieth of the time of factors; a rough value has the right sign
        start = np.random.default_rng(0).standard_normal(len(size))
        least = eigsh(scaled, 1, which="SA", tol=1e-2, v0=start, maxiter=100 * len(size),
                      return_eigenvectors=False)[0]
    if least < 0:
        raise OptionError(f"{name} is indefinite: some motion has a negative kinetic energy")


def refuse_soft(values: Array, terms: float = 0.0) -> None:
    """Refuse a stiffness of motions that are not rigid by its eigenvalues, lowest first, where these are not positive. terms: the
    size of those of which these are the small differences."""
    if values[0] < -max(INDEFINITE * values[-1], 1e-13 * terms):
        raise OptionError(f"K is indefinite: some deformation has a negative stiffness, of {-values[0] / values[-1]:.1g} of the "
                          f"largest one")
    if free := int(np.sum(values <= max(1e-13 * values[-1], 1e-16 * terms))):
        raise OptionError(f"K lets the body deform without force (a mechanism): {free} motions that are not rigid have no "
                          f"stiffness")


def inertia_points(M: Any, nodes: Array, shapes: Array, inertia: Array, modal_mass: Array, mass: float, center: Array,
                   **_: Any) -> Array:
    """Points by which the body moves in space, see `ReducedBody.points`: as few as have the inertia of all its nodes.

    Kinetic energy about the centre of mass, where the sum of points s is 0, is a sum of (omega x s + s')^2, linear in the modes,
    in which products of components of s count alone. These are those of the nodes' masses (sums of rows of M; rotary inertia as
    masses beside the node), corrected so that inertia tensor, modal masses and orthogonality to rigid motions are exactly those
    of M."""
    k, f, n = shapes.shape
    along = np.tile(np.eye(f)[:, :3], (k, 1))
    lumped = np.einsum("kaa->k", (M @ along).reshape(k, f, 3)[:, :3]) / 3
    rows = np.concatenate([(nodes - center)[:, :, None], shapes[:, :3]], axis=2) * np.sqrt(np.maximum(lumped, 0))[:, None, None]
    if f == 6:
        at = (6 * np.arange(k)[:, None] + np.arange(3, 6))[:, :, None] + np.zeros((1, 1, 3), dtype=int)
        own = np.asarray(sp.csr_matrix(M)[at.ravel(), at.swapaxes(1, 2).ravel()]).reshape(k, 3, 3)
        second, axes = np.linalg.eigh(np.einsum("kaa->k", own)[:, None, None] / 2 * np.eye(3) - own)
        arms = np.sqrt(np.maximum(second, 0))[:, None] * axes  # masses on these; they turn with the node
        turned = np.cross(shapes[:, None, 3:], arms.transpose(0, 2, 1)[..., None], axis=2)
        beside = np.concatenate([arms.transpose(0, 2, 1)[..., None], turned], axis=3)
        rows = np.concatenate([rows, beside.reshape(-1, 3, 1 + n)])
    found = _balanced(_fewest(_corrected(_fewest(rows), inertia, modal_mass)))
    return np.asarray(found * np.sqrt(len(found) / mass))


def _fewest(points: Array) -> Array:
    """As few points (p, 3, 1 + n) as have the same sums of products of their components."""
    size = np.sqrt(np.sum(points**2, axis=(0, 1)))
    size = np.where(size > 0, size, 1.0)
    factor = np.linalg.qr((points / size).reshape(len(points), -1), mode="r")
    _, sigma, V = np.linalg.svd(factor, full_matrices=False)
    kept = sigma > 1e-9 * sigma[0]
    return np.asarray((sigma[:, None] * V)[kept].reshape(-1, 3, points.shape[2]) * size)


def _balanced(points: Array) -> Array:
    """One point more, with the same sums of products of components, and sums of components that are 0: a reflection of them that
    takes the direction of the new point, which is 0, into that of equal numbers."""
    count = len(points) + 1
    normal = np.full(count, 1 / np.sqrt(count))
    normal[-1] -= 1
    found = np.concatenate([points, np.zeros((1, *points.shape[1:]))])
    return np.asarray(found - np.multiply.outer(normal * 2 / (normal @ normal), np.tensordot(normal, found, 1)))


def _root(matrix: Array, power: float) -> Array:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.maximum(values, 1e-300) ** power) @ vectors.T)


def _corrected(points: Array, inertia: Array, modal_mass: Array) -> Array:
    """The points with small changes of their places and of their displacements by the modes, for exact sums."""
    n = len(modal_mass)
    wanted = np.trace(inertia) / 2 * np.eye(3) - inertia
    size = np.trace(wanted)
    second, axes = np.linalg.eigh(np.einsum("pa,pb->ab", points[:, :, 0], points[:, :, 0]))
    for s, axis in zip(second, axes.T, strict=True):  # a direction in which no node lies beside the others
        if s <= 1e-9 * size and (more := axis @ wanted @ axis) > 0:
            points = np.concatenate([points, np.r_[np.sqrt(more), np.zeros(n)] * axis[None, :, None]])
    x, moved = points[:, :, 0], points[:, :, 1:]
    there, goal = np.einsum("pa,pb->ab", x, x) / size + 1e-14 * np.eye(3), _root(wanted / size + 1e-14 * np.eye(3), 0.5)
    x = x @ (goal @ _root(goal @ there @ goal, -0.5) @ goal)
    if n:
        turning = np.linalg.pinv(np.trace(x.T @ x) * np.eye(3) - x.T @ x, rcond=1e-12) @ np.sum(
            np.cross(x[:, :, None], moved, axis=1), axis=0)
        moved = moved - np.cross(turning[None], x[:, :, None], axis=1)
        unit = moved / np.sqrt(modal_mass)
        products = np.einsum("pca,pcb->ab", unit, unit)
        if np.min(np.linalg.eigvalsh(products)) < 0.1:
            raise OptionError("M has modes whose inertia is not in the masses and rotary inertias of its nodes: keep fewer "
                              "modes, or give a finer mesh")
        moved = unit @ _root(products, -0.5) * np.sqrt(modal_mass)
    return np.concatenate([x[:, :, None], moved], axis=2)
