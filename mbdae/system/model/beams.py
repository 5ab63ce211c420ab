"""Flexible beams in a model: their nodes (as bodies called stations), and the kernels of their elements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.errors import OptionError, SceneError
from mbdae.kernels.line import LineKernel, load_kernel, mass_blocks, merged, strain_kernel
from mbdae.kernels.line_nodes import ElementJacobian, ElementKernel, GyroscopicKernel
from mbdae.laws.line_mesh import LineMesh
from mbdae.scene.beams import mesh_of, nearest_place
from mbdae.scene.components import Beam, BeamLoad, Body, Station
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.line import WEIGHT
from mbdae.system.model.nodes import Node, rotation_matrices
from mbdae.values import Array, nearest

if TYPE_CHECKING:
    from mbdae.scene.scene import SceneData


class Meshed(NamedTuple):
    """A beam's mesh and its nodes as bodies (stations), to which items of the scene can be attached."""

    mesh: LineMesh
    stations: list[Station]


def meshed(scene: SceneData, planar: bool = False) -> tuple[dict[Beam, Meshed], dict[tuple[str, str], Body]]:
    """Meshes of all beams, with nodes where items of the scene attach; and (item, side) on a beam -> the station (node as a body)
    to which it is attached."""
    wanted: dict[Beam, list[tuple[str, str, float, Array]]] = {b: [] for b in scene.bodies if isinstance(b, Beam)}
    for c in scene.connections:
        for side, body in (("k", c.k), ("l", c.l)):
            if isinstance(body, Beam):
                point = c.places.get(side, c.joint.point_on(side))
                wanted[body].append((c.name, side, nearest_place(body, point), point))
    meshes: dict[Beam, LineMesh] = {}
    nodes: dict[tuple[str, str], int] = {}
    for beam, places in wanted.items():
        try:
            meshes[beam] = mesh = mesh_of(beam, tuple(place for _, _, place, _ in places))
        except OptionError as error:
            raise SceneError([f"beam '{beam.name}': {error}"]) from error
        for item, side, _, point in places:
            nodes[item, side] = nearest(np.linalg.norm(mesh.positions - point, axis=1), mesh.length)
    _give_welded_nodes_equal_axes(scene, meshes, nodes)
    found = {beam: Meshed(mesh, _stations(beam, mesh, planar)) for beam, mesh in meshes.items()}
    on = {(c.name, side): body for c in scene.connections for side, body in (("k", c.k), ("l", c.l))}
    return found, {key: found[on[key]].stations[node] for key, node in nodes.items()}


def _give_welded_nodes_equal_axes(scene: SceneData, meshes: dict[Beam, LineMesh], nodes: dict[tuple[str, str], int]) -> None:
    """Give nodes of two beams that are welded to each other the same axes, so that they can share their rotation."""
    settled: set[tuple[Beam, int]] = set()
    for c in (c for c in scene.connections if c.is_joint and c.joint.welds):
        if not (isinstance(c.k, Beam) and isinstance(c.l, Beam)):
            continue
        k, l = (c.k, nodes[c.name, "k"]), (c.l, nodes[c.name, "l"])
        if l in settled:
            k, l = l, k
        if l not in settled:
            of_k = meshes[k[0]]
            meshes[l[0]] = meshes[l[0]].with_axes(l[1], of_k.quaternions[k[1]], float(of_k.headings[k[1]]))
        settled |= {k, l}


def _stations(beam: Beam, mesh: LineMesh, planar: bool) -> list[Station]:
    """The nodes of a mesh as bodies, in their order. In a planar model their x axis is along the beam and z normal to the plane,
    whichever axis of the section is normal to it."""
    half, none = mesh.headings / 2, np.zeros(len(mesh.headings))
    P = np.column_stack([np.cos(half), none, none, np.sin(half)]) if planar else mesh.quaternions
    zero, R = np.zeros((3, 3)), rotation_matrices(P)
    rest = beam.drawn.velocity, beam.drawn.angular_velocity
    return [Station(f"{beam.name}[{i}]", 0.0, zero, r, R[i], *rest, beam=beam, turned=float(mesh.headings[i]),
                    quaternion=P[i])
            for i, r in enumerate(mesh.positions)]


class Line:
    """A beam in a model, as a line of nodes with elements between them."""

    def __init__(self, beam: Beam, mesh: LineMesh, nodes: list[Node], kind: NodeKind, scene: SceneData) -> None:
        self.beam, self.mesh, self.nodes, self.kind = beam, mesh, nodes, kind
        section = beam.section.swapped if kind is NodeKind.PLANAR and mesh.normal_axis == 2 else beam.section
        self.numbers: dict[str, float] = section.numbers
        self.gravity = scene.gravity * section.mass_per_length
        self._loads: list[BeamLoad] = [load for load in scene.line_loads if load.beam is beam]

    @cached_property
    def mixed(self) -> LineKernel:
        """Kernel of the internal forces with the stresses as unknowns."""
        return strain_kernel(self.mesh, self.numbers, self.kind)

    @cached_property
    def displacement(self) -> LineKernel:
        """Kernel of the internal forces with the stresses eliminated by their compliance."""
        return strain_kernel(self.mesh, self.numbers, self.kind, mixed=False)

    @cached_property
    def blocks(self) -> Array:
        """Consistent mass matrices (elements, (p + 1) nu, (p + 1) nu) of all elements, see `mass_blocks`."""
        return mass_blocks(self.mesh, self.numbers, self.kind)

    @cached_property
    def loads(self) -> list[tuple[ElementKernel, dict[str, Any]]]:
        """Kernels of the follower loads and of the loads that depend on time, each with its components that do: name -> function
        of time."""
        out: list[tuple[ElementKernel, dict[str, Any]]] = []
        for load in self._loads:
            values = {name: getattr(load.law, name) for name in load.law.params if getattr(load.law, name) is not None}
            timed = {name: v for name, v in values.items() if not isinstance(v, float)}
            if values and (load.law.following or timed):
                out.append((load_kernel(self.mesh, load.law, self.kind, tuple(timed)), timed))
        return out

    @cached_property
    def dead(self) -> Array:
        """Constant forces (elements, p + 1, nu) on the nodes of every element: gravity and dead loads (of constant direction and
        value)."""
        per_length = self.gravity.copy()
        for load in self._loads:
            values = [getattr(load.law, f"f{i}") or 0.0 for i in (1, 2, 3)]
            if not load.law.following and all(isinstance(v, float) for v in values):
                per_length += values
        n = self.kind.translations
        out = np.zeros((*self.mesh.elements.shape, self.kind.sizes[1]))
        out[..., :n] = self.mesh.lumped[:, :, None] * per_length[:n]
        return out

    @property
    def timed(self) -> dict[str, Any]:
        """Functions of time in the loads, by keys such as "0.f2": number of the kernel in `loads`, name of the component."""
        return {f"{n}.{name}": v for n, (_, timed) in enumerate(self.loads) for name, v in timed.items()}

    @property
    def stresses(self) -> list[str]:
        """Names of the stress unknowns of all elements, in order."""
        names = self.mixed.names
        return [f"{self.beam.name}.{name} in element {e + 1}" for e in range(len(self.mesh.elements)) for name in names]

    def places(self, head: str) -> NDArray[np.intp]:
        """(elements, p + 1, size) positions of the q (head "q") or u ("u") of every element's nodes among all q or u of the
        model."""
        first = np.array([n.q if head == "q" else n.u for n in self.nodes], dtype=np.intp)
        return np.asarray(first[self.mesh.elements][:, :, None] + np.arange(self.kind.sizes[0 if head == "q" else 1]))

    @property
    def mass(self) -> tuple[Array, NDArray[np.intp], NDArray[np.intp]]:
        """Values, rows and columns of the mass matrices of all elements, in the numbering of all u. Entries of shared nodes occur
        several times and have to be summed."""
        at = self.places("u").reshape(len(self.blocks), -1)
        rows, columns = np.broadcast_arrays(at[:, :, None], at[:, None, :])
        return self.blocks.ravel(), rows.ravel(), columns.ravel()

    def stiffness(self, q: Array) -> Array:
        """Stiffness matrices (elements, (p + 1) nu, (p + 1) nu) at q (nq,): derivatives of every element's internal forces by
        virtual displacements of its nodes."""
        kernel, u = self.displacement, np.zeros((1, 1 + max(node.u + node.kind.sizes[1] for node in self.nodes)))
        x = nodal_inputs(kernel, [self], q[None], u, np.zeros((1, 0)))
        nodes, count = kernel.nodes, kernel.nodes.count
        by_position = kernel.full_jacobian(x)[:, : count * nodes.nu, : count * nodes.nq].transpose(1, 2, 0)
        at = x[:, : count * nodes.nq].reshape(len(x), count, nodes.nq)
        return np.asarray(nodes.velocity_columns(by_position, at).transpose(2, 0, 1))

    def fastest_vibration(self, q: Array) -> float:
        """Upper bound of the angular frequencies of all modes of the beam at q (nq,), rad/s: the largest one of its elements,
        each taken alone and free. Infinite where the section has a rigid strain."""
        if self.beam.section.rigid:
            return float("inf")
        return float(np.sqrt(np.max(np.abs(np.linalg.eigvals(np.linalg.solve(self.blocks, self.stiffness(q)))))))

    def energy(self, q: Array, u: Array) -> tuple[Array, Array]:
        """Elastic energy (nt,), J, and dissipated power (nt,), W, from the strains at q (nt, nq), u (nt, nu) of all nodes."""
        kernel = self.displacement
        x = nodal_inputs(kernel, [self], q, u, np.zeros((len(q), 0)))
        found = kernel.at_points(x, [kernel.derived.energy, kernel.derived.dissipated])
        return tuple(found.reshape(len(q), -1, 2).sum(axis=1).T)

    def stored(self, q: Array, u: Array, z: Array) -> Array:
        """Elastic energy (nt,), J, from the stress unknowns z (nt, nz): integral of compliance stress^2 / 2 along the beam."""
        kernel = self.mixed
        terms = [se.Symbol(f"compliance_{n}") * se.Symbol(n) ** 2 / 2 for n in kernel.derived.stresses]
        x = nodal_inputs(kernel, [self], q, u, np.zeros((len(q), 0)))
        x = np.hstack([x, z.reshape(len(x), -1)])
        return np.asarray(kernel.at_points(x, [WEIGHT * sum(terms)]).reshape(len(q), -1).sum(axis=1))

    def stress(self, q: Array, u: Array) -> Array:
        """Stress unknowns of all elements from positions (nq,) and velocities (nu,); 0 for rigid strains."""
        kernel = self.mixed
        x = nodal_inputs(kernel, [self], q[None], u[None], np.zeros((1, 0)))
        x = np.hstack([x, np.zeros((len(x), len(kernel.names)))])
        return np.asarray(kernel.at_points(x, [e for _, e in kernel.derived.resultants]).ravel())

    def potential(self, q: Array) -> Array:
        """Potential energy of gravity and dead loads (nt,), J."""
        n = self.kind.translations
        return np.asarray(-np.einsum("teai,eai->t", q[:, self.places("q")[..., :n]], self.dead[..., :n]))

    def kinetic(self, u: Array) -> Array:
        """Kinetic energy (nt,), J."""
        v = u[:, self.places("u").reshape(len(self.blocks), -1)]
        return np.asarray(np.einsum("tei,eij,tej->t", v, self.blocks, v, optimize=True) / 2)


def nodal_inputs(kernel: ElementKernel, lines: list[Line], q: Array, u: Array, timed: Array) -> Array:
    """Inputs (nt * elements, inputs) of an element kernel over some beams, from q (nt, nq), u (nt, nu) of all nodes and its
    inputs that are prescribed in time, timed (nt, number of these); without stresses."""
    at = {head: np.concatenate([line.places(head) for line in lines]) for head in ("q", "u")}
    columns = [(q if t[0] == "q" else u)[:, at[t[0]][:, t[1], t[2]]] for t in kernel.inputs if t[0] in "qu"]
    columns += [np.repeat(column[:, None], len(at["q"]), axis=1) for column in timed.T]
    x = np.stack(columns, axis=-1)
    return x.reshape(-1, x.shape[-1])


@dataclass(frozen=True, eq=False)
class ElementBatch:
    """A kernel for the elements of one or several beams, with the nodes of every element.

    stresses: (elements, stresses per element) numbers of its stresses among all stress unknowns; timed: of every input that is
    prescribed in time, the number of the beam and its key in `Line.timed`."""

    kernel: ElementKernel
    lines: list[Line]
    stresses: NDArray[np.intp]
    timed: tuple[tuple[int, str], ...] = ()
    is_load: bool = False

    @cached_property
    def nodes(self) -> list[list[Node]]:
        """Nodes of every element."""
        return [[line.nodes[a] for a in element] for line in self.lines for element in line.mesh.elements]


def batches(lines: list[Line], mixed: bool) -> list[ElementBatch]:
    """The kernels of all beams: internal forces (of beams with equal laws in one kernel), gyroscopic moments, and loads. mixed:
    whether stresses are unknowns."""
    groups: dict[Any, list[tuple[Line, LineKernel, NDArray[np.intp]]]] = {}
    first = 0
    for line in lines:
        kernel = line.mixed if mixed else line.displacement
        count = len(line.mesh.elements), len(kernel.names)
        z = first + np.arange(count[0] * count[1]).reshape(count)
        first += z.size
        groups.setdefault((kernel.derived, line.mesh.order, kernel.turns is None), []).append((line, kernel, z))
    out: list[ElementBatch] = []
    for members in groups.values():
        of_group = [line for line, _, _ in members]
        out.append(ElementBatch(merged([kernel for _, kernel, _ in members]), of_group, np.concatenate([z for *_, z in members])))
        if of_group[0].kind is NodeKind.SPATIAL:
            gyroscopic = GyroscopicKernel(np.concatenate([line.blocks for line in of_group]), of_group[0].mesh.order + 1)
            out.append(ElementBatch(gyroscopic, of_group, _none(gyroscopic)))
    for k, line in enumerate(lines):
        for n, (load, timed) in enumerate(line.loads):
            out.append(ElementBatch(load, [line], _none(load), tuple((k, f"{n}.{name}") for name in timed), True))
    return out


def _none(kernel: ElementKernel) -> NDArray[np.intp]:
    return np.zeros((kernel.elements, 0), dtype=np.intp)


# -- in the equations of a form (`of`, an `Assembly`)


def _row_on(of: Any, nodes: list[list[Node]], target: Any) -> Any:
    """(elements,) of every element the row of F of the equation of motion ("u", node of the element, i)."""
    return np.array([of.row_at("u", e[target[1]], target[2]) for e in nodes], dtype=np.intp)


def add_elements(of: Any, batch: ElementBatch, gather: Any, entries: Any) -> None:
    """Add a kernel over the elements of beams. gather (elements, inputs): slots that it reads; entries: of the Jacobian."""
    kernel, nodes, z = batch.kernel, batch.nodes, of.numbering.start["z"] + batch.stresses
    rows = np.stack([z[:, t[1]] if t[0] == "z" else _row_on(of, nodes, t) for t in kernel.targets], axis=1)
    of._residual.kernel(gather, rows, kernel)
    if kernel.jacobian_places:
        at = rows[:, [o for o, _ in kernel.jacobian_places]]
        of._jacobian.kernel(gather, at, ElementJacobian(kernel))
        number = {t: i for i, t in enumerate(kernel.inputs)}
        entries.varying(at, gather[:, [number[t] for _, t in kernel.jacobian_places]])


def add_inertia(of: Any, line: Line, entries: Any) -> None:
    """Add the consistent mass and the dead loads of a beam; entries: of the Jacobian."""
    nodes = [[line.nodes[a] for a in element] for element in line.mesh.elements]
    entries_of = [(a, i) for a in range(line.mesh.order + 1) for i in range(line.kind.sizes[1])]
    rows = np.stack([_row_on(of, nodes, ("u", *e)) for e in entries_of], axis=1)
    np.add.at(of.offset, rows, -line.dead.reshape(rows.shape))
    if of.spec.loads_only:
        return
    columns = np.array([[of.numbering.node_place("up", e[a], i) for a, i in entries_of] for e in nodes], dtype=np.intp)
    at, by = (np.array(p).reshape(len(rows), -1) for p in np.broadcast_arrays(rows[:, :, None], columns[:, None, :]))
    values = line.blocks.reshape(at.shape)
    entries.constant(at, by, values)
    wide = int(by.max(initial=0)) + 1
    cells, where = np.unique(at * wide + by, return_inverse=True)
    sums = np.bincount(where.ravel(), values.ravel(), len(cells))
    kept = (sums != 0) & (cells // wide != of.n)
    of._residual.linear(cells[kept] // wide, cells[kept] % wide, sums[kept])
