"""Trees of any size at given states, evaluated body by body by the articulated-body recursion: the motion of all bodies, and the
accelerations that given forces cause."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.kernels.tree_passes import TreePasses
from mbdae.native.program import Operations, core
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import jacobian_G
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.moved_bodies import MovedBodies, slot_of
from mbdae.system.model.nodes import Node
from mbdae.system.model.numbering import Numbering
from mbdae.system.model.trees import Tree
from mbdae.system.motion.all_bodies import AllBodies, TreeMechanics
from mbdae.system.motion.constrained import Workspace
from mbdae.system.motion.states import Solve, blocks

#: pivot of the mass matrix over the largest pivot, up to which a motion counts as having no inertia
NOTHING = 1e-13


class _AtStates(Workspace):
    """Operations that are run for one state after the other. A state is a workspace: unknowns and all values prescribed in
    time."""

    def __init__(self, numbering: Numbering) -> None:
        super().__init__(numbering)
        self.clock = self.operations.part()  # empty, because a state already contains the values prescribed in time
        self.part = self.operations.part()

    def ready(self, result: int, count: int) -> None:
        """Compile the operations, whose results are the `count` numbers from slot `result` on."""
        self.finish(self.part)
        self.make("residual")
        self._found, _ = self.view(result, count)
        self._at_yp = self.view(self.n, self.n)[1]

    def values(self, W: Array, more: tuple[int, Array] | None = None) -> Array:
        """Results (nt, count) at workspaces W (nt, width). more: a slot and further numbers (nt, k) to be written from there
        on."""
        out = np.empty((len(W), len(self._found)))
        for i, row in enumerate(W):
            self.W[: row.size] = row
            if more is not None:
                self.W[more[0] : more[0] + more[1].shape[1]] = more[1][i]
            self.code = core().scene_part(self.address, ctypes.byref(self.scene.residual), np.nan, self._at_y, self._at_yp)
            out[i] = self._found
        return out


class OrderedMotion(_AtStates):
    """Computes q, u and u' of all nodes, one after the other, from workspaces of a numbering."""

    def __init__(self, model: Model, moved: MovedBodies, numbering: Numbering) -> None:
        super().__init__(numbering)
        self.sizes, part = (model.nq, model.nu, model.nu), self.part
        starts = dict(zip(("q", "u", "up"), (0, model.nq, model.nq + model.nu), strict=True))
        result = self.operations.slots(sum(self.sizes))
        part.load(result, np.zeros(sum(self.sizes)))

        def place(node: Node, head: str, i: int) -> int:
            return result + starts[head] + (node.q if head == "q" else node.u) + i

        for head, unknown in (("q", 0), ("u", numbering.nq), ("up", numbering.n + numbering.nq)):
            own = numbering.of_positions if head == "q" else numbering.of_velocities
            part.set(result + starts[head] + own, unknown + np.arange(len(own)))
        for tree in moved.trees:
            ordered = moved.passes(numbering, tree, quaternion=True)
            ordered.outwards(part)
            ordered.accelerations(part, lambda place: slot_of(numbering, tree, ("up", *place[1:])), given=True)  # noqa: B023
            ordered.write_motion(part, [j for j in ordered.bodies if j], _to(tree, place), tuple(starts))
            driven = [(place(tree.node(-c), head, 0), moved.slot(numbering, tree, ("clock", c, order)))
                      for _, c, _ in tree.driven for order, head in enumerate(starts)]
            part.set([to for to, _ in driven], [slot for _, slot in driven])
        self.ready(result, sum(self.sizes))

    def of_all(self, W: Array) -> tuple[Array, Array, Array]:
        """q (nt, nq), u and u' (nt, nu) of all nodes at workspaces W (nt, width)."""
        found = self.values(W)
        nq, nu, _ = self.sizes
        return found[:, :nq], found[:, nq : nq + nu], found[:, nq + nu :]


def _to(tree: Tree, place: Callable[[Node, str, int], int]) -> Callable[[int, str, int], int]:
    return lambda j, head, i: place(tree.node(j), head, i)


class OrderedBodies(AllBodies):
    """The motion of all bodies where trees are evaluated joint by joint."""

    @cached_property
    def _by_order(self) -> OrderedMotion:
        return OrderedMotion(self.model, self.moved, self.numbering)

    def states(self, t: Array, y: Array) -> tuple[Array, Array]:
        parts = blocks(len(t), self.numbering.width)
        found = [AllBodies.states(self, t[part], y[part]) for part in parts]
        return np.concatenate([q for q, _ in found]), np.concatenate([u for _, u in found])

    def accelerations(self, t: Array, q: Array, u: Array, up: Array) -> Array:
        parts = blocks(len(t), self.numbering.width)
        return np.concatenate([AllBodies.accelerations(self, t[part], q[part], u[part], up[part]) for part in parts])

    def _motion(self, W: Array, up: Array | None) -> tuple[Array, Array, Array]:
        return self._by_order.of_all(W)

    def velocity_map(self, W: Array) -> Array:
        """As `AllBodies.velocity_map`, column by column: velocities for one velocity unknown equal to 1 and the others 0, less
        those for all 0, because velocities depend on the unknowns linearly."""
        first, columns = self.nq, np.zeros((len(W), self.model.nu, self.nu))
        still = W.copy()
        still[:, first : first + self.nu] = 0.0
        rest = self._motion(still, None)[1]
        for k in range(self.nu):
            still[:, first + k] = 1.0
            columns[:, :, k] = self._motion(still, None)[1] - rest
            still[:, first + k] = 0.0
        return columns


def bodies_of(model: Model, moved: MovedBodies) -> AllBodies:
    """The object that evaluates the motion of all bodies of a model: by kernels of whole trees, or joint by joint."""
    return (OrderedBodies if moved.ordered else AllBodies)(model, moved)


class _Accelerations(_AtStates):
    """Computes u' of all nodes from forces on them, which are given in the slots from `force` on. mass: (row, column) -> entry of
    the mass matrix among the velocity unknowns."""

    def __init__(self, model: Model, moved: MovedBodies, numbering: Numbering, mass: dict[tuple[int, int], float]) -> None:
        super().__init__(numbering)
        nb, part = numbering, self.part
        self.force = self.operations.slots(model.nu)
        rates, own, every = part.slots(nb.nu), nb.of_velocities, part.zeros(model.nu)
        left = part.zeros(model.nu)
        part.add(left + np.arange(model.nu), self.force + np.arange(model.nu), -1.0)
        part.set(rates + np.arange(nb.nu), self.force + own)
        self.pivots: list[tuple[int, int]] = []
        for tree in moved.trees:
            ordered = moved.passes(nb, _bare(model, tree), inertia=own_inertia(nb, part, tree, mass))
            self.pivots += self._solve(part, ordered, tree, left, rates)
            ordered.write_motion(part, [j for j in ordered.bodies if j], _to(tree, lambda n, _, i: every + n.u + i), ("up",))
            driven = [(every + tree.node(-c).u, moved.slot(nb, tree, ("clock", c, 2))) for _, c, _ in tree.driven]
            part.set([to for to, _ in driven], [slot for _, slot in driven])
        self._alone(part, mass, rates, {k for _, k in self.pivots})
        part.set(every + own, rates + np.arange(nb.nu))
        self.ready(every, model.nu)

    def _solve(self, part: Operations, ordered: TreePasses, tree: Tree, left: int, rates: int) -> list[tuple[int, int]]:
        ordered.outwards(part)
        nodes = [j for j in ordered.bodies if j]
        forces = [ordered.at(j, place) for j in nodes for place in ordered.bodies[j].kernels.outward.column if place[0] == "p"]
        # the given forces contain the gyroscopic forces already, so that those which the outward pass computes are set to 0
        part.set(forces, np.full(len(forces), part.zeros(1)))
        ordered.loads(part, nodes, lambda j, i: left + tree.node(j).u + i)
        first = rates - self.numbering.nq

        def rate(place: tuple[object, ...]) -> int:
            return first + slot_of(self.numbering, tree, place)

        pivots = [(slot, rate(place) - rates) for slot, place in ordered.inwards(part, rate)]
        ordered.accelerations(part, rate)
        return pivots

    def _alone(self, part: Operations, mass: dict[tuple[int, int], float], rates: int, solved: set[int]) -> None:
        solve_alone(part, mass, lambda k: rates + k, sorted(set(range(self.numbering.nu)) - solved))


def own_inertia(nb: Numbering, part: Operations, tree: Tree, mass: dict[tuple[int, int], float]) -> dict[Any, int]:
    """Entries of the mass matrix by laws outside of a tree, by pairs of its velocities: slots of constants.

    mass: (row, column) among the velocity unknowns -> entry."""
    nodes = [*([(0, tree.nodes[0])] if tree.structure.root.moves else []), *((-c, n) for c, n in enumerate(tree.coordinates, 1))]
    places = {nb.node_place("u", n, i) - nb.nq: ("u", j, i) for j, n in nodes if n not in tree.moved_nodes
              for i in range(n.kind.sizes[1])}
    return {(places[a], places[b]): part.constant([m]) for (a, b), m in mass.items() if a in places and b in places}


def solve_alone(part: Operations, mass: dict[tuple[int, int], float], rate: Callable[[int], int], rest: Sequence[int]) -> None:
    """Append the accelerations of the velocity unknowns `rest`, which belong to no tree, by Cholesky of their constant mass
    matrix.

    mass: (row, column) -> its entries; rate: slot of unknown k, which holds the force on it before and its acceleration after."""
    if not rest:
        return
    place, n = {k: i for i, k in enumerate(rest)}, len(rest)
    found = [(place[a], place[b], m) for (a, b), m in mass.items() if a in place and b in place]
    width = max((abs(i - j) for i, j, _ in found), default=0) + 1
    band = np.zeros((n, width))
    for i, j, m in found:
        if i >= j:
            band[i, j - i + width - 1] = m
    matrix, right = part.slots(n * width), part.slots(n)
    part.load(matrix, band)
    slots = [rate(k) for k in rest]
    part.set(right + np.arange(n), slots)
    part.cholesky(n, width, matrix, right)
    part.set(slots, right + np.arange(n))


def _bare(model: Model, tree: Tree) -> Tree:
    """A tree whose only laws are the inertias of its bodies, without forces between them."""
    kept = [k for k, (g, i) in enumerate(tree.members) if isinstance(model.groups[g].instances[i].law, Element)]
    structure = replace(tree.structure, members=tuple(tree.structure.members[k] for k in kept), loaded=())
    return replace(tree, structure=structure, members=tuple(tree.members[k] for k in kept))


class OrderedMechanics(TreeMechanics):
    """Mechanics of a model whose trees are evaluated joint by joint and whose constraint rows all belong to joints of these
    trees."""

    carries_bodies = True

    def _constrained(self, t: Array, q: Array, u: Array) -> Solve:
        e = self.all_bodies
        qr, ur = e.reduced(q, u)

        def solve(f: Array, slope: Array | None) -> tuple[Array, Array]:
            acceleration = np.concatenate([
                self._by_order.values(e.workspace(t[part], qr[part], ur[part]), (self._by_order.force, f[part]))
                for part in blocks(len(t), e.numbering.width)])
            multipliers = np.zeros((len(t), self.m))
            self._joint_by_joint(t, q, f - acceleration @ self.mass, multipliers)
            return acceleration, multipliers

        return solve

    @cached_property
    def _by_order(self) -> _Accelerations:
        e = self.all_bodies
        number = {int(k): i for i, k in enumerate(e.numbering.of_velocities)}
        mass = {(number[a], number[b]): m for (a, b), m in self.inertia.items() if a in number and b in number}
        return _Accelerations(self.model, e.moved, e.numbering, mass)

    def without_inertia(self, t: Array, q: Array) -> list[int]:
        """Numbers, among the velocity unknowns, of those that have no inertia at positions q (nq,)."""
        e, solver = self.all_bodies, self._by_order
        W = e.workspace(t, *e.reduced(q[None], np.zeros((1, self.nu))))
        solver.values(W, (solver.force, np.zeros((1, self.nu))))
        pivots = np.array([solver.W[slot] for slot, _ in solver.pivots])
        lost = np.flatnonzero(~(pivots > NOTHING * float(np.max(pivots, initial=0.0))))
        return [solver.pivots[i][1] for i in lost]

    def _joint_by_joint(self, t: Array, q: Array, left: Array, multipliers: Array) -> None:
        """As `TreeMechanics._leaf_to_root`, but with the entries of G of one joint at a time, never the whole matrix."""
        entries = {g: (p.targets, values) for g, p, values in self.evaluate(jacobian_G, t, q, np.zeros((len(t), self.nu)))}
        numbers = {(r.group, r.instance, r.row): n for n, r in enumerate(self.rows)}
        for tree in self.all_bodies.moved.trees:
            drives = {(at, name): c for at, c, name in tree.driven}
            for j in range(len(tree.joints), 0, -1):
                g, i = tree.joints[j - 1]
                names = self.model.groups[g].derived.rows
                if not names:
                    continue
                targets, values = entries[g]
                columns = [self.numbering.velocity(("u", *target[2:]), g, i) for target in targets]
                G = {(target[1], columns[o]): values[:, i, o] for o, target in enumerate(targets)}
                rows, driven = {r: numbers[g, i, r] for r in range(len(names))}, {r: (j, name) for r, name in enumerate(names)}
                self._one(tree, j, rows, G, {r: drives[key] for r, key in driven.items() if key in drives}, left, multipliers)

    def _one(self, tree: Tree, j: int, rows: dict[int, int], G: dict[tuple[int, int], Array], drives: dict[int, int],
             left: Array, multipliers: Array) -> None:
        """Compute the multipliers of joint j of a tree. rows: row of the law -> number of its multiplier; G: (row of the law,
        velocity) -> entries (nt,); drives: row of the law that prescribes a coordinate -> number of this coordinate in the
        tree."""
        node, own = tree.node(j), [r for r in rows if r not in drives]
        at, zero = range(node.u, node.u + node.kind.sizes[1]), np.zeros(len(left))
        on_body = np.array([[G.get((r, k), zero) for r in own] for k in at]).transpose(2, 0, 1)
        found = np.linalg.solve(on_body, left[:, at.start : at.stop, None])[..., 0] if own else np.zeros((len(left), 0))
        multipliers[:, [rows[r] for r in own]] = found
        force = dict(zip(own, found.T, strict=True))
        for (r, k), value in G.items():
            if r in force:
                left[:, k] -= value * force[r]
        for r, c in drives.items():  # the multiplier of a row that prescribes a coordinate is the force left on it
            u = tree.node(-c).u
            multipliers[:, rows[r]] = left[:, u] / G[r, u]
