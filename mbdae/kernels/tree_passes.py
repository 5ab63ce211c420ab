"""A tree of joints evaluated body by body (articulated-body recursion): operations that call kernels of single joints in order,
outwards from the root, inwards from the leaves, and outwards again.

Consecutive bodies with the same kernels are one operation, whose instances read results of the instances before them. Only the
tables of slots grow with the tree.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.kernels import links
from mbdae.kernels.links import BodyKernels, ProgramKernel
from mbdae.native.program import Operations
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.links import directions
from mbdae.symbolic.tree_motion import Member, Open, TreeStructure

Index = NDArray[np.intp]
Place = tuple[Any, ...]
Slot = Callable[[Place], int]  #: slot of what stands at a place of a tree, see `TreeProgram.inputs`
#: number of different joint kernels in a tree above which parameters equal to 0, 1 or -1, otherwise constants of the kernels,
#: become inputs at run time, so that more joints share a kernel
MOST_KINDS = 12


class Own(NamedTuple):
    """A body of a tree. parent: number of the body that carries it, -1 for none; members: numbers, among the laws of the tree, of
    those that act on this body alone, which its kernels contain."""

    kernels: BodyKernels
    parent: int
    members: tuple[int, ...]


class TreePasses:
    """Appends the evaluation of a tree, body by body, to a list of operations.

    slot: where the list finds unknowns, rates, prescribed coordinates and numbers of laws, by their places in the tree;
    quaternion: whether the rotations of its bodies are evaluated as quaternions (else as rotation matrices only); inertia: pairs
    of velocities ("u", node, i) -> slot of the entry of the mass matrix by laws outside of the tree."""

    def __init__(self, structure: TreeStructure, slot: Slot, open: Open = Open.FEWEST, quaternion: bool = False,
                 inertia: Mapping[tuple[Place, Place], int] | None = None) -> None:
        self.structure, self.slot, self.quaternion, self._open = structure, slot, quaternion, open
        self.inertia = inertia or {}
        self._base: dict[int, int] = {}
        self._kept: dict[int, tuple[int, ProgramKernel]] = {}
        self._accelerations: dict[int, tuple[int, ProgramKernel]] = {}
        self.bodies = self._bodies()
        if len({id(own.kernels) for own in self.bodies.values()}) > MOST_KINDS:
            self._open = Open.ALL
            self.bodies = self._bodies()
        self._runs = self._ordered()

    def copied(self, inertia: Mapping[tuple[Place, Place], int]) -> TreePasses:
        """A copy with another inertia by laws outside, to be continued on its own after what has been appended so far."""
        made = copy(self)
        made.inertia, made._kept, made._accelerations = inertia, {}, {}
        return made

    @property
    def size(self) -> tuple[int, int]:
        """Number of different kernels of the joints, and number of arithmetic operations of one evaluation of all joints."""
        every = [kernel for own in self.bodies.values() for kernel in (
            own.kernels.outward, *(links.pass_kernel(own.kernels.shape, name) for name in ("inward", "outward")))]
        sizes = {id(kernel): kernel.operations for kernel in {id(k): k for k in every}.values()}
        return len(sizes), sum(sizes[id(kernel)] for kernel in every)

    # -- bodies

    def _bodies(self) -> dict[int, Own]:
        structure = self.structure
        alone: dict[int, list[int]] = {}
        self._between: list[tuple[int, tuple[int, ...]]] = []
        for m, member in enumerate(structure.members):
            nodes = tuple(dict.fromkeys(n for n in member.nodes if n is not None))
            if len(nodes) == 1 and nodes[0] > 0:
                alone.setdefault(nodes[0], []).append(m)
            else:
                self._between.append((m, nodes))
        found: dict[int, Own] = {}
        if structure.root.moves:
            found[0] = Own(links.root_kernels(structure.root, self.quaternion), -1, ())
        kinds = [structure.root, *(link.kind for link in structure.links)]
        for j, link in enumerate(structure.links, start=1):
            members = tuple(alone.get(j, ()))
            stated = tuple(links.between(structure.members[m], {j: 1}, self._open) for m in members)
            kernels = links.link_kernels(kinds[link.parent], links.alone(link, self._open), stated, self.quaternion)
            found[j] = Own(kernels, link.parent if link.parent in found else -1, members)
        return found

    def _ordered(self) -> list[list[int]]:
        """The bodies in runs, each of bodies with the same kernels; a body comes after the one that carries it."""
        depth: dict[int, int] = {}
        for j, own in self.bodies.items():  # in this dictionary a body comes after the one that carries it
            depth[j] = depth[own.parent] + 1 if own.parent >= 0 else 0
        number = {k: i for i, k in enumerate(dict.fromkeys(id(own.kernels) for own in self.bodies.values()))}
        runs: list[list[int]] = []
        for j in sorted(self.bodies, key=lambda j: (depth[j], number[id(self.bodies[j].kernels)], j)):
            if runs and self.bodies[runs[-1][-1]].kernels is self.bodies[j].kernels:
                runs[-1].append(j)
            else:
                runs.append([j])
        return runs

    def at(self, j: int, place: Place) -> int:
        """Slot of a result of the outward pass for body j: its motion ("x", name), inertia ("M", i, j), forces ("p", i), or an
        entry of X, S and c, by which its acceleration follows from that of its parent, see `LinkProgram.outward`."""
        return self._base[j] + self.bodies[j].kernels.outward.column[place]

    def unknown(self, j: int, place: Place) -> Place:
        """The velocity ("u", node, i) that is a freedom of body j, which its kernels call ("up", node, i)."""
        _, node, i = place
        return "u", node - self.structure.links[j - 1].first + 1 if j else 0, i

    @property
    def unknowns(self) -> list[Place]:
        """The velocities that are freedoms of the tree, body by body."""
        return [self.unknown(j, place) for run in self._runs for j in run for place in self.bodies[j].kernels.freedoms]

    # -- from the root outwards

    def outwards(self, part: Operations) -> None:
        """Append the outward pass: the motion of the bodies, and the inertia and forces of the laws on them."""
        for run in self._runs:
            kernel = self.bodies[run[0]].kernels.outward
            first = part.slots(len(run) * kernel.width)
            self._base |= {j: first + r * kernel.width for r, j in enumerate(run)}
            kernel.emit(part, self._table(run, kernel, self._read), first)
        kinds: dict[int, list[tuple[int, tuple[int, ...]]]] = {}
        kernels: dict[int, ProgramKernel] = {}
        for m, nodes in self._between:
            kernel = self._kernel_between(m, nodes)
            kinds.setdefault(id(kernel), []).append((m, nodes))
            kernels[id(kernel)] = kernel
        for key, places in kinds.items():
            self._laws(part, kernels[key], places)

    def _kernel_between(self, m: int, nodes: tuple[int, ...]) -> ProgramKernel:
        kinds = tuple(self._kind(j) for j in nodes)
        member: Member = links.between(self.structure.members[m], {n: i for i, n in enumerate(nodes)}, self._open)
        return links.member_kernel(kinds, member)

    def _kind(self, j: int) -> NodeKind:
        return self.bodies[j].kernels.kind

    def _laws(self, part: Operations, kernel: ProgramKernel, places: list[tuple[int, tuple[int, ...]]]) -> None:
        """Append laws between several bodies with one kernel, whose forces are added to those of the bodies. places: of each law
        its number in the tree and those of its bodies."""
        gather = [[self._read_between(m, nodes, place) for place in kernel.inputs] for m, nodes in places]
        values = kernel.emit(part, np.array(gather, dtype=np.intp).reshape(len(places), len(kernel.inputs)))
        to = [[self.at(nodes[j], ("p", i)) for _, j, i in kernel.targets] for _, nodes in places]
        part.add(np.array(to, dtype=np.intp), values)

    def _read_between(self, m: int, nodes: tuple[int, ...], place: Place) -> int:
        head, owner, name = place
        return self.at(nodes[owner], ("x", name)) if head == "x" else self.slot((head, f"member{m}", name))

    def _read(self, j: int, place: Place) -> int:
        """Slot of the input `place` of body j's outward kernel, see `TreeProgram.inputs`."""
        (head, owner, name), own = place, self.bodies[j]
        if head == "x":
            return self.at(own.parent, ("x", name))
        if head in ("number", "timed"):
            owner = f"link{j}" if owner == "link1" else f"member{own.members[int(owner[6:])]}"
        elif j:
            first = self.structure.links[j - 1].first
            owner = first + owner - 1 if head == "clock" else owner - first + 1
        return self.slot((head, owner, name))

    def _table(self, run: Sequence[int], kernel: ProgramKernel, read: Callable[[int, Place], int]) -> Index:
        table = [[read(j, place) for place in kernel.inputs] for j in run]
        return np.array(table, dtype=np.intp).reshape(len(run), len(kernel.inputs))

    def write_motion(self, part: Operations, nodes: Sequence[int], to: Callable[[int, str, int], int],
                     heads: tuple[str, ...] = ("q", "u", "up")) -> None:
        """Append operations that write q, u and u' of the bodies `nodes` to the slots to(body, head, i). heads: which of "q",
        "u", "up"."""
        for kind in dict.fromkeys(map(self._kind, nodes)):
            alike, kernel = [j for j in nodes if self._kind(j) is kind], links.node_motion(kind, heads)
            values = kernel.emit(part, self._table(alike, kernel, self._moved_at))
            part.set([[to(j, head, i) for head, i in kernel.targets] for j in alike], values)

    def _moved_at(self, j: int, place: Place) -> int:
        head, _, name = place
        if head == "x":
            return self.at(j, ("x", name))
        first, kernel = self._accelerations[j]
        return first + kernel.column["a", directions(self._kind(j)).index(name)]

    def loads(self, part: Operations, nodes: Sequence[int], row: Callable[[int, int], int], role: str = "wu",
              to: Callable[[int, int], int] | None = None) -> None:
        """Append operations that add what laws outside of the tree added to the rows of the bodies `nodes`, in slots row(body,
        i), to the forces on the bodies, or to the slots to(body, i). role: "wu" for rows of the equations of motion, "wq" for
        those of q'."""
        for kind in dict.fromkeys(map(self._kind, nodes)):
            alike, kernel = [j for j in nodes if self._kind(j) is kind], links.node_load(kind, role)

            def read(j: int, place: Place) -> int:
                return row(j, place[2]) if place[0] == role else self.at(j, ("x", place[2]))

            values = kernel.emit(part, self._table(alike, kernel, read))
            part.add([[self.at(j, t) if to is None else to(j, t[1]) for t in kernel.targets] for j in alike], values)

    def corrections(self, part: Operations, nodes: Sequence[int], row: Callable[[int, int], int], F: Slot) -> None:
        """Append corrections of q' (the term G^T mu of the form GGL) that laws cause on the bodies `nodes`, in slots row(body,
        i): they are projected on the freedoms of all bodies that carry these and added to the slots F of ("q", node, i)."""
        first: dict[int, int] = {j: part.zeros(own.kernels.shape.body) for j, own in self.bodies.items()}
        self.loads(part, nodes, row, "wq", lambda j, i: first[j] + i)

        def read(j: int, place: Place) -> int:
            return first[j] + place[1] if place[0] == "w" else self.at(j, place)

        along: dict[int, list[int]] = {}
        for (_, node, _), slot in self._projected(part, "projected", read, lambda j, i: first[j] + i):
            along.setdefault(node, []).append(slot)
        for node, slots in along.items():
            plain = len(slots) - 3 if self._by_quaternion(node) else len(slots)
            part.add([F(("q", node, i)) for i in range(plain)], slots[:plain])
            if plain < len(slots):
                P = [plain + i for i in range(4)]
                gather = [*(self.slot(("q", node, i)) for i in P), *slots[plain:]]
                part.add([F(("q", node, i)) for i in P], links.quaternion_rate().emit(part, np.array([gather], dtype=np.intp))[0])

    def _by_quaternion(self, node: int) -> bool:
        """Whether the rotation of a node with unknowns of its own is a quaternion: of the root, or of a joint's coordinate."""
        if node == 0:
            return self.structure.root is NodeKind.SPATIAL
        link = next(link for link in self.structure.links if link.first <= -node < link.first + len(link.coordinates))
        return link.law.coordinates[link.coordinates[-node - link.first]].unit == "rotation"

    def balance(self, part: Operations, row: Slot) -> None:
        """Append the equations of motion at given accelerations, which `accelerations` has found: inertia and forces of every
        body, together with all that it carries, along the freedoms of its joint, added to the slots row(("u", node, i))."""

        def read(j: int, place: Place) -> int:
            if place[0] == "a":
                first, kernel = self._accelerations[j]
                return first + kernel.column[place]
            return self.at(j, place)

        found = self._projected(part, "balance", read, lambda j, i: self.at(j, ("p", i)))
        part.add([row(place) for place, _ in found], [slot for _, slot in found])

    def _projected(self, part: Operations, name: str, read: Callable[[int, Place], int],
                   force: Callable[[int, int], int]) -> list[tuple[Place, int]]:
        """Append the projection of forces, from the leaves to the root: on every body those on it, in slots force(body, i), and
        those of what it carries. Returns every velocity with the slot of the force along it."""
        rows: list[tuple[Place, int]] = []
        for run in reversed(self._runs):
            own, back = self.bodies[run[0]].kernels, run[::-1]
            kernel, parent = links.pass_kernel(own.shape, name), own.shape.parent
            if kernel.targets:
                to = [[force(self.bodies[j].parent, i) for i in range(parent)] for j in back]
                sums = np.array(to, dtype=np.intp).reshape(len(back), -1)
                found = part.hand_on(kernel, self._table(back, kernel, read), sums)[:, parent:].tolist()
                rows += [(self.unknown(j, place), slot) for j, slots in zip(back, found, strict=True)
                         for place, slot in zip(own.freedoms, slots, strict=True)]
        return rows

    # -- inwards, and the accelerations outwards again

    def inwards(self, part: Operations, force: Slot) -> list[tuple[int, Place]]:
        """Append the inward pass: the inertia and forces of every body together with all that it carries. force: slot of the
        force on a velocity ("u", node, i). Returns the slot of every pivot of the mass matrix with its velocity."""
        pivots: list[tuple[int, Place]] = []
        for run in reversed(self._runs):
            own, back = self.bodies[run[0]].kernels, run[::-1]
            freedoms = [self.unknown(j, place) for j in run for place in own.freedoms]
            kernel = links.pass_kernel(replace(own.shape, heavy=any((a, a) in self.inertia for a in freedoms)), "inward")
            if not kernel.targets:
                continue
            first = part.slots(len(run) * kernel.width)
            self._kept |= {j: (first + r * kernel.width, kernel) for r, j in enumerate(back)}
            read = self._inner(part, force)
            sums = [t for t in kernel.targets if t[0] in ("M0", "p0")]
            to = [[self.at(self.bodies[j].parent, (t[0][0], *t[1:])) for t in sums] for j in back]
            sums_of = np.array(to, dtype=np.intp).reshape(len(back), len(sums))
            part.hand_on(kernel, self._table(back, kernel, read), sums_of, first)
            pivots += [(self._kept[j][0] + kernel.column["pivot", k], self.unknown(j, place)) for j in back
                       for k, place in enumerate(own.freedoms)]
        return pivots

    def _inner(self, part: Operations, force: Slot) -> Callable[[int, Place], int]:
        def read(j: int, place: Place) -> int:
            freedoms = self.bodies[j].kernels.freedoms
            if place[0] == "tau":
                return force(self.unknown(j, freedoms[place[1]]))
            if place[0] == "C":
                a, b = (self.unknown(j, freedoms[k]) for k in place[1:])
                found = self.inertia.get((a, b))
                return part.constant([0.0]) if found is None else found
            return self.at(j, place)

        return read

    def accelerations(self, part: Operations, rate: Slot, given: bool = False) -> None:
        """Append the second outward pass: the accelerations of the bodies. rate: slot of the rate of a velocity; given:
        True reads these rates, False computes and writes them."""
        to: list[int] = []
        found: list[int] = []
        for run in self._runs:
            own = self.bodies[run[0]].kernels
            kernel = links.pass_kernel(own.shape, "outward, given" if given else "outward")
            first = part.slots(len(run) * kernel.width)
            self._accelerations |= {j: (first + r * kernel.width, kernel) for r, j in enumerate(run)}
            kernel.emit(part, self._table(run, kernel, self._outer(rate)), first)
            for k, place in enumerate(() if given else own.freedoms):
                to += [rate(self.unknown(j, place)) for j in run]
                found += [self._accelerations[j][0] + kernel.column["up", k] for j in run]
        part.set(to, found)

    def _outer(self, rate: Slot) -> Callable[[int, Place], int]:
        def read(j: int, place: Place) -> int:
            own = self.bodies[j]
            if place[0] == "a0":
                first, kernel = self._accelerations[own.parent]
                return first + kernel.column["a", place[1]]
            if place[0] in ("K", "K0"):
                first, kernel = self._kept[j]
                return first + kernel.column[place]
            return rate(self.unknown(j, own.kernels.freedoms[place[1]])) if place[0] == "up" else self.at(j, place)

        return read
