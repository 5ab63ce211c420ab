"""The reduction of mass and stiffness matrices by Craig and Bampton, and checks that they are those of a free body."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from mbdae.deferred import eigsh, later, sp
from mbdae.errors import OptionError, warn
from mbdae.inputs.matrices import (
    DENSE,
    ROUNDED,
    Scaled,
    one_sided,
    pivots_of,
    refuse_negative,
    refuse_soft,
    signed_factors,
    symmetric,
)
from mbdae.values import Array, BadValueError, array, option, sequence, shown, whole

second_displacements, free_basis = later("mbdae.inputs.stiffening", "second_displacements", "free_basis")
AXES = ("ux", "uy", "uz", "rx", "ry", "rz")  #: freedoms of a node, in their order
#: m/s; waves in solids travel at up to 1.8e4 m/s (diamond), so that no body has a lowest frequency times its size above that
FASTEST = 1e5
#: m/s, of waves of stretching, outside which units are asked for, and below a 20th of which they are refused: foams have 20
SLOWEST, DIAMOND = 200.0, 2e4
#: stiffness against rigid motions, over the softest one with an interface held, above which K is not that of a free body
SPRINGS = 1e-4
THIN = 1e-13  #: smallest principal moment of inertia over the largest one
#: pivot of the stiffness of held interfaces, over the diagonal entry, below which it counts as 0: a mechanism
NO_STIFFNESS = 1e-11


def cross_matrix(a: Array) -> Array:
    """Matrix (3, 3) of a x b, for b (3,)."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rigid_motions(nodes: Array, about: Array, freedoms: int) -> Array:
    """(freedoms k, 6) displacements of the nodes (k, 3) by unit translations and rotations about a point (3,)."""
    out = np.zeros((len(nodes), freedoms, 6))
    out[:, :3, :3] = np.eye(3)
    out[:, :3, 3:] = [-cross_matrix(x - about) for x in nodes]
    out[:, 3:, 3:] = np.eye(3)[: freedoms - 3]
    return out.reshape(-1, 6)


def sizes_of(matrix: Any) -> str:
    """Its rows and columns in words."""
    return f"{matrix.shape[0]} by {matrix.shape[1]}"


class FiniteElements:
    """The matrices as given, checked; inner: (all, inner) the freedoms of nodes of no interface; held: (all, 6 interfaces) the
    rigid motions of the interfaces."""

    def __init__(self, M: Any, K: Any, nodes: Any, interfaces: Any) -> None:
        self.nodes = option("nodes", nodes, array, "give the places of the nodes (k, 3), m")
        if self.nodes.ndim != 2 or self.nodes.shape[1] != 3 or len(self.nodes) < 2:
            raise OptionError(f"nodes have shape {self.nodes.shape}: give two nodes or more, (k, 3), m")
        self.M, self.K = symmetric("M", M), symmetric("K", K)
        n, k = self.K.shape[0], len(self.nodes)
        if self.M.shape != self.K.shape or n not in (3 * k, 6 * k):
            raise OptionError(f"M is {sizes_of(self.M)}, K is {sizes_of(self.K)}, for {k} nodes: give both with 6 freedoms a "
                              f"node ({6 * k}) or 3 ({3 * k})")
        self.freedoms = n // k
        self.size = float(np.linalg.norm(np.ptp(self.nodes, axis=0)))
        self.names, self.members = self._interfaces(interfaces)
        self.places = [self.nodes[m].mean(axis=0) for m in self.members]
        self._check_rigid(sp.csc_matrix(K, dtype=float))
        self.held, self.inner = self._split()

    def _interfaces(self, given: Any) -> tuple[list[str], list[Any]]:
        if not isinstance(given, Mapping) or not given or not all(isinstance(name, str) and name for name in given):
            raise OptionError(f"interfaces = {shown(given)}: give a dict with one interface or more, "
                              f"{{'root': [numbers of its nodes, from 0]}}")
        members: list[Any] = []
        seen: dict[int, str] = {}
        for name, numbers in given.items():
            of = f"interfaces[{name!r}]"
            if name == "modes" or name.split(" ")[0] in ("inertia", "rows", "interface"):
                raise OptionError(f"{of}: '<body>.{name}' is an item of reduced bodies, as 'modes', 'inertia 1', 'rows 1' and "
                                  f"'interface ...' are: give another name")
            try:
                mask = np.ndim(numbers) == 1 and np.asarray(numbers).dtype == bool and len(numbers) == len(self.nodes)
                found = sequence(np.flatnonzero(numbers) if mask else numbers, whole, least=0, most=len(self.nodes) - 1)
            except BadValueError as reason:
                raise OptionError(f"{of} = {reason}; give numbers of nodes, 0 to {len(self.nodes) - 1}, or True or False for "
                                  f"each of the {len(self.nodes)} nodes") from None
            if not found:
                raise OptionError(f"{of} has no nodes: give the numbers of its nodes, from 0")
            for node in found:
                if node in seen:
                    raise OptionError(f"{of} has the node {node} twice: name it once" if seen[node] == name else
                                      f"{of} has the node {node}, which interface '{seen[node]}' has too: a node moves with one "
                                      f"interface")
                seen[node] = name
            if self.freedoms == 3:
                spread = np.linalg.svd(self.nodes[found] - self.nodes[found].mean(axis=0), compute_uv=False)
                if len(found) < 3 or spread[1] <= ROUNDED * self.size:
                    raise OptionError(f"{of} has {len(found)} nodes with three freedoms each on one line, which do not say how "
                                      f"it turns: give three nodes or more that are not on a line")
            members.append(np.array(found))
        return list(given), members

    def _check_rigid(self, given: Any) -> None:
        """Refuse matrices that are not those of a free body whose nodes are where they are said to be. given: K as it was."""
        center = self.nodes.mean(axis=0)
        R = rigid_motions(self.nodes, center, self.freedoms)
        for name, matrix in (("M", self.M), ("K", self.K)):
            if (negative := np.flatnonzero(matrix.diagonal() < 0)).size:
                raise OptionError(f"{name} is indefinite: its diagonal entry of {self._freedom(negative[0])} is "
                                  f"{matrix.diagonal()[negative[0]]:g}")
        order = " ".join(AXES[:self.freedoms])
        masses = R[:, :3].T @ (self.M @ R[:, :3])
        mass = np.trace(masses) / 3
        if not mass > 0 or np.max(np.abs(masses - mass * np.eye(3))) > ROUNDED * mass:
            found = ", ".join(f"{m:g}" for m in masses.diagonal())
            raise OptionError(f"M gives the translations along x, y, z the masses {found} kg, or couples them: its rows are not "
                              f"in the order {order}, node by node, or freedoms were left out")
        forces, sizes = abs(self.K @ R), abs(self.K) @ abs(R)
        wrong = forces > ROUNDED * np.max(sizes, axis=0)
        if np.any(wrong & (forces <= (1 + ROUNDED) * (abs(given - given.T) @ abs(R)) / 2)):
            raise OptionError(f"K is not symmetric: {one_sided(given)}")
        if wrong[:, :3].any():
            where = self._freedom(int(np.argmax(wrong[:, :3].any(axis=1))))
            raise OptionError(f"K resists rigid translations, first at {where}: give K without supports, with rows in the order "
                              f"{order}, node by node")
        if wrong.any():
            raise OptionError(f"K resists rigid rotations, first at {self._freedom(int(np.argmax(wrong.any(axis=1))))}, but no "
                              f"translations: nodes are in another order or unit than the rows of K, or the freedoms of a node "
                              f"are not {order}")
        self.mass, self.center = float(mass), (R[:, 3:].T @ (self.M @ R[:, :3]) / mass)
        twist = (self.center - self.center.T) / 2  # of -m [c x]: the centre from the mean of the nodes
        self.center = center + np.array([twist[2, 1], twist[0, 2], twist[1, 0]])
        self.rigid = rigid_motions(self.nodes, self.center, self.freedoms)
        self.inertia = self.rigid[:, 3:].T @ (self.M @ self.rigid[:, 3:])
        moments, axes = np.linalg.eigh(self.inertia)
        if not moments[0] > THIN * moments[-1]:
            kind = "is indefinite: it gives" if moments[0] < -ROUNDED * moments[-1] else "gives"
            raise OptionError(f"M {kind} a rotation of the body about the axis {np.round(axes[:, 0], 3).tolist()} no positive "
                              f"inertia: give its nodes rotary inertia, or consistent masses")

    def judge(self, lowest: float) -> None:
        """Refuse springs to ground in K, which a free body has not and a reduction leaves out, and units by which it is softer
        or lighter than any solid; lowest: of its frequencies with an interface held, Hz."""
        K, M = (self.rigid.T @ (A @ self.rigid) for A in (self.K, self.M))
        held = float(np.max(np.abs(np.linalg.eigvalsh(K / np.sqrt(np.outer(M.diagonal(), M.diagonal()))))))
        if held > (share := SPRINGS * (2 * np.pi * lowest) ** 2):
            a = int(np.argmax(np.abs(K.diagonal() / M.diagonal())))
            where = f"{K[a, a]:.3g} {'N/m along' if a < 3 else 'N m/rad about'} {'xyz'[a % 3]}"
            raise OptionError(f"K resists rigid motions by {where}, which is {100 * SPRINGS * held / share:.2g} % of its softest "
                              f"stiffness with an interface held: give K without supports and springs to ground, which the "
                              f"scene states (s.spring), or with more digits")
        stretched = np.einsum("ka,ab->kab", self.nodes - self.center, np.eye(3, self.freedoms)).transpose(0, 2, 1).reshape(-1, 3)
        speed = float(np.sqrt(np.max(np.sum(stretched * (self.K @ stretched), axis=0)) / self.mass))
        if not SLOWEST <= speed <= DIAMOND:
            words = (f"waves of stretching travel through the body at about {speed:.2g} m/s, which is 5000 in metals, 50 in "
                     f"rubber and 18000 in diamond: are M in kg (not in t or g), K in N/m, nodes in m?")
            if speed < SLOWEST / 20:
                raise OptionError(words)
            warn(words)

    def _freedom(self, row: int) -> str:
        return f"{AXES[int(row) % self.freedoms]} of node {int(row) // self.freedoms}"

    def _split(self) -> tuple[Any, Any]:
        f, n = self.freedoms, self.K.shape[0]
        blocks = [rigid_motions(self.nodes[m], place, f) for m, place in zip(self.members, self.places, strict=True)]
        rows = [(m[:, None] * f + np.arange(f)).ravel() for m in self.members]
        held = sp.lil_matrix((n, 6 * len(blocks)))
        for i, (at, block) in enumerate(zip(rows, blocks, strict=True)):
            held[at, 6 * i : 6 * i + 6] = block
        self.kept = np.setdiff1d(np.arange(n), np.concatenate(rows))
        inner = sp.csc_matrix((np.ones(len(self.kept)), (self.kept, np.arange(len(self.kept)))), shape=(n, len(self.kept)))
        return sp.csc_matrix(held), inner

    def reduced(self, modes: int | None, accelerations: bool = False, stiffening: Any = False,
                enough: tuple[float, float] = (1e-3, np.inf), free: bool = False) -> dict[str, Any]:
        """The fields of `ReducedBody` with a number of modes with held interfaces; accelerations: with the static deformations by
        uniform accelerations too; stiffening: with displacements of the second order, by this function, or with True by K;
        enough: share that modes=None may leave out, and the highest frequency (Hz) of the loads; free: with modes of the free
        body and residual flexibility, see `free_basis`, in place of modes with held interfaces."""
        held, inner = self.held, self.inner
        solve: Any = lambda forces: forces  # noqa: E731 - of no inner freedoms
        refuse_negative("M", self.M, self._freedom)
        statics, frequencies, left_out, unshown = held.toarray(), np.zeros(0), 0.0, np.zeros(6)
        basis, moved, rigid = statics, np.eye(held.shape[1]), self.rigid_interfaces
        if inner.shape[1]:
            K, M = (sp.csc_matrix(inner.T @ A @ inner) for A in (self.K, self.M))
            factors = self._stiffness(K)
            solve = factors.solve
            statics[self.kept] -= solve((inner.T @ (self.K @ held)).toarray())
        if inner.shape[1] and free:
            basis, moved, rigid, frequencies = free_basis(self, solve, statics, modes, enough)
        elif inner.shape[1]:
            values, vectors, left_out = self._held_modes(K, M, factors, modes, enough if accelerations else (enough[0], np.inf))
            frequencies = np.sqrt(values) / (2 * np.pi)
            if accelerations:
                vectors, left_out = self._with_accelerations(M, factors, vectors), 0.0
            else:
                loads, _ = self._accelerated(factors)
                unshown = self._largest(inner @ (solve(loads) - vectors @ (vectors.T @ loads / values[:, None])), False)
            basis = np.hstack([statics, inner @ vectors])
            moved, rigid = (np.pad(a, ((0, rows), (0, columns))) for a, rows, columns in (
                (moved, 0, vectors.shape[1]), (rigid, vectors.shape[1], 0)))
        M, K = (basis.T @ (A @ basis) for A in (self.M, self.K))
        values, turned = self._free_modes(M, K, rigid)
        shapes = (basis @ turned).reshape(len(self.nodes), self.freedoms, -1)
        largest = self._largest(shapes)
        # the sign of a mode is that in which the largest of its components is positive
        flat = turned / largest
        signs = np.sign(flat[[int(np.argmax(np.abs(c) > 0.999 * np.max(np.abs(c)))) for c in flat.T], np.arange(len(values))])
        shapes, turned, mass = shapes * signs / largest, moved @ (turned * signs / largest), 1 / largest**2
        at = {name: turned[6 * i : 6 * i + 6] for i, name in enumerate(self.names)}
        found = {"mass": self.mass, "center": self.center, "inertia": self.inertia, "nodes": self.nodes,
                 "interfaces": dict(zip(self.names, self.places, strict=True)), "shapes": shapes, "modal_mass": mass,
                 "modal_stiffness": values * mass, "interface_shapes": at, "held_frequencies": frequencies, "left_out": left_out,
                 "unshown": unshown}
        if stiffening is not False:
            force = None if stiffening is True else stiffening
            found |= second_displacements(self, found, solve, statics, force)
        return found

    def _largest(self, moved: Array, turns: bool = True) -> Array:
        """(n,) largest displacement of a node by each of n, m; turns: rotations count too, times the size of the body."""
        shapes = moved.reshape(len(self.nodes), self.freedoms, -1)
        found = np.max(np.linalg.norm(shapes[:, :3], axis=1), axis=0, initial=0)
        rotated = np.max(np.linalg.norm(shapes[:, 3:], axis=1), axis=0, initial=0)
        return np.asarray(np.maximum(found, turns * self.size * rotated))

    @property
    def rigid_interfaces(self) -> Array:
        """(6 interfaces, 6) motions of the interfaces as the body moves as a rigid one."""
        return np.vstack([rigid_motions(place[None], self.center, 6) for place in self.places])

    def _stiffness(self, K: Any) -> Any:
        """LU factors of the stiffness with held interfaces, which is positive definite."""
        size = K.diagonal()
        if (free := np.flatnonzero(size <= NO_STIFFNESS * np.max(size, initial=1e-300))).size:
            raise OptionError(f"K is that of a mechanism: {self._freedom(self.kept[free[0]])} has no stiffness; leave such "
                              f"freedoms out (three a node), or give them some")
        root = sp.diags(1 / np.sqrt(size))
        try:
            factors = signed_factors(sp.csc_matrix(root @ K @ root))
        except RuntimeError:  # "Factor is exactly singular"
            factors = None
        pivots = np.zeros(1) if factors is None else pivots_of(factors)
        if np.min(pivots) < -NO_STIFFNESS:
            raise OptionError("K is indefinite: with the interfaces held it has a negative stiffness")
        if factors is None or np.min(pivots) <= NO_STIFFNESS:
            where = "" if factors is None else f", near {self._freedom(self.kept[factors.perm_c.argsort()[np.argmin(pivots)]])}"
            raise OptionError(f"K is that of a mechanism{where}: a part moves without force while all interfaces are held; "
                              f"connect it, or give it an interface")
        return Scaled(factors, 1 / np.sqrt(size))

    def _held_modes(self, K: Any, M: Any, factors: Any, modes: int | None,
                    enough: tuple[float, float]) -> tuple[Array, Array, float]:
        """Squared angular frequencies (m,) and modes (inner, m) with held interfaces, lowest first, and the share left out.
        enough: with modes=None as few as leave out at most this share; where the highest frequency of loads (Hz) is finite, the
        static share is kept otherwise, and loads shake the first mode left out by the square of their frequency over its own."""
        n, count = K.shape[0], 12 if modes is None else modes
        loads, whole_ = self._accelerated(factors)
        seen = whole_ > 0  # a rotation about the line of a beam may have no inertia
        while True:
            values, vectors = self._modes(K, M, factors, min(count, n))
            shown_ = np.cumsum((vectors.T @ loads[:, seen]) ** 2 / values[:, None] / whole_[seen], axis=0)
            left = np.max(1 - np.vstack([np.zeros(shown_.shape[1]), shown_]), axis=1, initial=0)
            if modes is not None:
                return values, vectors, float(left[-1])
            if np.isfinite(enough[1]):
                left *= np.minimum(1, (2 * np.pi * enough[1]) ** 2 / np.r_[values, values[-1:]])
            few = np.flatnonzero(left <= enough[0])
            if few.size or len(values) >= n or len(values) < count:
                kept = int(few[0]) if few.size else len(values)
                if kept > MANY:
                    raise OptionError(f"modes = None: {kept} modes are needed to leave out {enough[0]:g}, more than {MANY}: give "
                                      f"accelerations=True and up_to=, a larger accuracy, or the number of modes")
                return values[:kept], vectors[:, :kept], float(left[kept])
            count *= 2

    def _accelerated(self, factors: Any) -> tuple[Array, Array]:
        """Inertia forces (inner, 6) of uniform accelerations along and about axes, with held interfaces, and what each puts into
        the elastic energy, twice (6,)."""
        loads = self.inner.T @ (self.M @ self.rigid)
        return loads, np.einsum("ia,ia->a", loads, factors.solve(loads))

    def _with_accelerations(self, M: Any, factors: Any, vectors: Array) -> Array:
        """The modes with held interfaces and, orthogonal to them by M and K, what they leave out of the deformations by uniform
        accelerations along and about axes: of six those that do not follow from the others."""
        loads, whole_ = self._accelerated(factors)
        loads = loads[:, whole_ > 0] / np.sqrt(whole_[whole_ > 0])
        loads = loads - M @ (vectors @ (vectors.T @ loads))
        found = factors.solve(loads)
        energy, turned = np.linalg.eigh(found.T @ loads)
        turned = turned[:, energy > SHOWN]
        return np.hstack([vectors, found @ turned / np.sqrt(energy[energy > SHOWN])])

    def _modes(self, K: Any, M: Any, factors: Any, count: int) -> tuple[Array, Array]:
        from scipy.linalg import eigh
        from scipy.sparse.linalg import LinearOperator

        n = K.shape[0]
        if count == 0:
            return np.zeros(0), np.zeros((n, 0))
        if n <= DENSE or count >= n - 1:
            # 1 / omega^2 of K^-1 M: M may be singular, as lumped ones are
            inverse, vectors = eigh(M.toarray(), K.toarray())
            order = np.argsort(-inverse)[:count]
            order = order[inverse[order] > 1e-14 * np.max(inverse)]
            return 1 / inverse[order], vectors[:, order] / np.sqrt(inverse[order])
        start = np.random.default_rng(0).standard_normal(n)
        solve = LinearOperator((n, n), matvec=factors.solve)
        values, vectors = eigsh(K, count, M, sigma=0.0, OPinv=solve, v0=start)
        return values, vectors

    def _free_modes(self, M: Array, K: Array, rigid: Array) -> tuple[Array, Array]:
        """Squared angular frequencies (n,) and modes (reduced, n), of modal mass 1, of the reduced free body without its six
        rigid motions (reduced, 6), to which the modes are orthogonal exactly."""
        from scipy.linalg import eigh, null_space

        size = np.sqrt(np.maximum(M.diagonal(), 0))
        if not np.min(size) > 0:
            raise OptionError("M gives a motion of an interface no inertia: give consistent masses, or its nodes rotary inertia")
        M, K = (A / np.outer(size, size) for A in (M, K))
        given = M @ (rigid * size[:, None])
        elastic = null_space((given / np.linalg.norm(given, axis=0)).T)
        if not elastic.shape[1]:
            return np.zeros(0), np.zeros((len(M), 0))
        try:
            values, vectors = eigh(elastic.T @ K @ elastic, elastic.T @ M @ elastic)
        except np.linalg.LinAlgError:
            raise OptionError("M gives a motion of the reduced body no inertia: give consistent masses, or its nodes rotary "
                              "inertia") from None
        speed = np.sqrt(abs(values[0])) / (2 * np.pi) * self.size
        refuse_soft(values)
        if speed > FASTEST:
            raise OptionError(f"the lowest frequency of the free body is {speed / self.size:.3g} Hz, at a size of {self.size:g} "
                              f"m, more than waves in solids allow: are M in kg, K in N/m, nodes in m?")
        return values, elastic @ vectors / size[:, None]


MANY = 100  #: largest number of modes that modes=None takes: a scene with 166 ran out of memory (23 GB)
#: share of the elastic energy by a uniform acceleration below which no shape is added for what the modes leave out of it
SHOWN = 1e-9
