"""Joint-space dynamics: mass matrix, bias, inverse and forward dynamics, Jacobians of a scene at given states.

The recursion is that of runs (`kernels/tree_passes.py`), carried out once on expressions (`Inline`) with the numbers of the scene
written in; every quantity asked for is one compiled function of (q, v, a), evaluated over batches of states. Coordinates that a
coupling makes multiples of others are folded in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.kernels.links import pass_kernel
from mbdae.kernels.tree_passes import Place, TreePasses
from mbdae.kernels.tree_plan import Inline
from mbdae.laws.bodies import RigidBody
from mbdae.laws.forces import Gravity
from mbdae.robots.couplings import Coordinate, Folded, rounding
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Element
from mbdae.symbolic.links import directions
from mbdae.symbolic.rebuild import substituted
from mbdae.symbolic.tree_motion import Open
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Instance
from mbdae.system.model.trees import Tree as ModelTree
from mbdae.system.model.trees import find_trees

Array = NDArray[np.float64]
#: numbers of joints and bodies up to which they count as 0: round-off of rotations, which would cost operations
NOTHING = 1e-15
#: largest departure of the length of a quaternion from 1
UNIT = 1e-6
AXES = ("a1", "a2", "a3", "al1", "al2", "al3")
Entry = tuple[int, Place]  #: number of a tree, and a place in it


class Passed(NamedTuple):
    """The passes over a tree, and its bodies by name, with their numbers in it."""
    passes: TreePasses
    tree: ModelTree
    bodies: dict[str, int]


class JointSpaceProgram:
    """The trees of a scene as one straight-line program of q, v and a. scene: recursive, every body in a tree."""

    def __init__(self, model: Model, coordinates: Sequence[Coordinate], folded: Mapping[tuple[str, str], Folded]) -> None:
        self.made, self.model, self._folded = Inline(), model, folded
        self._place = {(c.joint, c.name): c for c in coordinates}
        nq, nv = sum(c.nq for c in coordinates), sum(c.nv for c in coordinates)
        self.q, self.v, self.a, self.tau, self.at = ([se.Symbol(f"{head}{i}") for i in range(n)] for head, n in (
            ("q", nq), ("u", nv), ("up", nv), ("tau", nv), ("at", 3)))
        self._slots: dict[Entry, int] = {}
        self.trees = [self._passed(n, tree) for n, tree in enumerate(find_trees(model))]
        for one in self.trees:
            one.passes.outwards(self.made)  # type: ignore[arg-type]
            self._turning(one)
        self._before = dict(self.made.values)
        self.least, self.weak = np.zeros(nv), se.Integer(0)
        for n, (_, tree, _) in enumerate(self.trees):
            for place, (k, f) in self._rates(n):
                self.least[k] += float(f) ** 2 * rounding(model.scene, tree, *self._owner(tree, -place[1]))

    def _turning(self, one: Passed) -> None:
        """Gyroscopic moments w x J w of rigid bodies with J along inertial axes, which the passes have anyway."""
        values, let = self.made.values, self.made.program.let
        for j, own in one.passes.bodies.items():
            laws = [self._law(one.tree.members[m]) for m in own.members]
            if own.kernels.kind is NodeKind.SPATIAL and laws and all(isinstance(law, RigidBody | Gravity) for law in laws):
                w = Vec(*(values[one.passes.at(j, ("x", f"w{i}"))] for i in "123"))
                spin = Vec(*(let(Vec(*(values[s] for s in row[3:])) @ w) for row in self._inertia(one.passes, j)[3:]))
                values |= {one.passes.at(j, ("p", i)): let(e) for i, e in enumerate(w.cross(spin), start=3)}

    @staticmethod
    def _inertia(passes: TreePasses, j: int) -> list[list[int]]:
        """Slots of the inertia of body j."""
        n = range(passes.bodies[j].kernels.shape.body)
        return [[passes.at(j, ("M", max(i, k), min(i, k))) for k in n] for i in n]

    # -- places

    def _passed(self, n: int, tree: ModelTree) -> Passed:
        law = self._law
        kept = [i for i, m in enumerate(tree.members) if isinstance(law(m), Element | Gravity)]
        of = tree.structure
        links = tuple(replace(link, prescribed=(False,) * len(link.prescribed)) for link in of.links)
        made = replace(of, links=links, members=tuple(of.members[i] for i in kept), loaded=())
        tree = replace(tree, structure=made, members=tuple(tree.members[i] for i in kept))
        bodies = {node.name: j for j, node in enumerate(tree.nodes) if node is not None}
        return Passed(TreePasses(made, lambda place: self._slot(n, tree, place), Open.ALL), tree, bodies)

    def _law(self, place: tuple[int, int]) -> Any:
        return self._instance(place).law

    def _instance(self, place: tuple[int, int]) -> Instance:
        return self.model.groups[place[0]].instances[place[1]]

    def _slot(self, n: int, tree: ModelTree, place: Place) -> int:
        if (n, place) not in self._slots:
            self._slots[n, place] = self._new(tree, place)
        return self._slots[n, place]

    def _new(self, tree: ModelTree, place: Place) -> int:
        head, owner, name = place
        if head in ("q", "u", "up"):
            return self._holding(self.coordinate(tree, place))
        j = int(owner.removeprefix("link").removeprefix("member"))
        of, place = ((tree.structure.links[j - 1], tree.joints[j - 1]) if owner.startswith("link") else
                     (tree.structure.members[j], tree.members[j]))
        whole = dict(of.numbers)[name]  # 0, 1 or -1, up to round-off of rotations
        value = tree.numbers[j - 1][name] if "_P" in name else float(self._instance(place).numbers[name])
        return self.made.constant([value if whole is None else whole])

    def _holding(self, e: Expr) -> int:
        first = self.made.slots(1)
        self.made.values[first] = self.made.program.let(e)
        return first

    def _owner(self, tree: ModelTree, c: int) -> tuple[str, str]:
        j = next(j for j, link in enumerate(tree.structure.links) if link.first <= c < link.first + len(link.coordinates))
        return tree.names[j], tree.structure.links[j].coordinates[c - tree.structure.links[j].first]

    def coordinate(self, tree: ModelTree, place: Place) -> Expr:
        """Expression of a coordinate of a tree, of its rate or its second rate, in q, v and a."""
        (head, _, i), key = place, self._owner(tree, -place[1])
        values = {"q": self.q, "u": self.v, "up": self.a}[head]
        if (found := self._folded.get(key)) is not None:
            of = self._place[found.of]
            return found.factor * values[(of.q if head == "q" else of.v)] + (found.offset if head == "q" else 0)
        of = self._place[key]
        return values[(of.q if head == "q" else of.v) + i]

    def _rates(self, n: int) -> list[tuple[Place, tuple[int, Expr]]]:
        """Of every velocity of tree n: its place, its number in v, and its factor there."""
        one, found = self.trees[n], []
        for place in one.passes.unknowns:
            key = self._owner(one.tree, -place[1])
            folded = self._folded.get(key)
            found.append((place, (self._place[key].v + place[2], se.Integer(1)) if folded is None else
                          (self._place[folded.of].v, se.RealDouble(folded.factor))))
        return found

    def armature(self, n: int) -> dict[Place, float]:
        """Inertia of rotors on the velocities of tree n."""
        one, scene = self.trees[n], self.model.scene
        owners = {place: self._owner(one.tree, -place[1]) for place in one.passes.unknowns}
        return {place: float(m) for place, (joint, c) in owners.items() if (m := getattr(scene[joint], "rotor", {}).get(c))}

    def _told(self, pivots: Mapping[int, Expr]) -> None:
        """Set `weak`, which is at least (2 UNIT)^2 where a pivot is rounding. pivots: by the number of the velocity."""
        parts = [(2 * UNIT * self.least[k]) ** 2 * (1 / d) ** 2 for k, d in pivots.items() if self.least[k]]
        self.weak = sum(parts, se.Integer(0))

    # -- quantities

    def inverse(self) -> list[Expr]:
        """Forces on the velocities for accelerations a."""
        made = self._begin()
        rows: list[Expr] = [se.Integer(0)] * len(self.v)
        for n, one in enumerate(self.trees):
            to: dict[Place, int] = {}
            one.passes.accelerations(made, lambda place, n=n, one=one: self._slot(n, one.tree, ("up", *place[1:])), given=True)  # type: ignore[misc,arg-type]
            one.passes.balance(made, lambda place, to=to: to.setdefault(place, made.zeros(1)))  # type: ignore[misc,arg-type]
            rotors = self.armature(n)
            for place, (k, factor) in self._rates(n):
                own = rotors.get(place, 0.0) * self.coordinate(one.tree, ("up", *place[1:]))
                rows[k] = rows[k] + factor * (made.values[to[place]] + own)
        return [made.program.let(e) for e in rows]

    def _begin(self) -> Inline:
        self.made.values |= self._before  # passes inwards add to these
        self.weak = se.Integer(0)
        return self.made

    def mass(self) -> list[list[Expr]]:
        """The mass matrix, by the inertia of every body with all that it carries."""
        made, size = self._begin(), len(self.v)
        M: list[list[Expr]] = [[se.Integer(0)] * size for _ in range(size)]
        for n in range(len(self.trees)):
            entries, of, rotors = self._composite(n), dict(self._rates(n)), self.armature(n)
            for (a, b), e in entries.items():
                (i, f), (j, g) = of[a], of[b]
                for row, column in ((i, j), (j, i)) if a != b else ((i, j),):
                    M[row][column] = M[row][column] + f * g * (e + (rotors.get(a, 0.0) if a == b else 0))
        lower = [[made.program.let(M[i][j]) for j in range(i + 1)] for i in range(size)]
        return [[lower[max(i, j)][min(i, j)] for j in range(size)] for i in range(size)]

    def _composite(self, n: int) -> dict[tuple[Place, Place], Expr]:
        made, passes = self.made, self.trees[n].passes
        order = [j for run in passes._runs for j in run]
        for j in reversed(order):
            shape = replace(passes.bodies[j].kernels.shape, freedoms=0)
            kernel, parent = pass_kernel(shape, "inward"), passes.bodies[j].parent
            sums = [passes.at(parent, (t[0][0], *t[1:])) for t in kernel.targets if t[0] in ("M0", "p0")]
            if sums:
                made.hand_on(kernel, np.array([[passes.at(j, place) for place in kernel.inputs]]), np.array([sums]))
        zero, entries = made.zeros(1), dict[tuple[Place, Place], Expr]()
        for j in order:
            for k, freedom in enumerate(passes.bodies[j].kernels.freedoms):
                self._column(passes, j, k, passes.unknown(j, freedom), zero, entries)
        return entries

    def _column(self, passes: TreePasses, j: int, k: int, own: Place, zero: int,
                entries: dict[tuple[Place, Place], Expr]) -> None:
        """Entries of one column of the mass matrix: from its body to the root."""
        made, name, w, turn = self.made, "balance", list[int](), self._freedom(passes, j, k)
        while j >= 0:
            body = passes.bodies[j].kernels
            kernel = pass_kernel(body.shape, name)
            if not kernel.targets:
                return

            def read(place: Place, j: int = j, w: list[int] = w) -> int:
                if place[0] in ("w", "a"):
                    return w[place[1]] if place[0] == "w" else turn[place[1]]
                return zero if place[0] == "p" else passes.at(j, place)

            found = made.call(kernel, np.array([[read(place) for place in kernel.inputs]], dtype=np.intp))[0].tolist()
            for place, freedom in enumerate(body.freedoms):
                a = passes.unknown(j, freedom)
                if (own, a) not in entries:
                    entries[a, own] = made.values[found[body.shape.parent + place]]
            w, name, j = found[: body.shape.parent], "projected", passes.bodies[j].parent

    def _freedom(self, passes: TreePasses, j: int, k: int) -> list[int]:
        """Slots of the column of S of freedom k of body j."""
        shape = passes.bodies[j].kernels.shape
        known = dict(shape.known)
        return [self.made.constant([known["S", i, k]]) if known.get(("S", i, k)) is not None else passes.at(j, ("S", i, k))
                for i in range(shape.body)]

    def forward(self) -> list[Expr]:
        """Accelerations for forces tau."""
        if self._folded:
            return self._forward_by_mass()
        made, a, pivots = self._begin(), list(self.a), dict[int, Expr]()
        for n, one in enumerate(self.trees):
            of, rotors, to = dict(self._rates(n)), self.armature(n), dict[Place, int]()
            force = {place: self._holding(self.tau[k]) for place, (k, _) in of.items()}
            passes = one.passes.copied({(p, p): made.constant([m]) for p, m in rotors.items()})
            self._at_rest(passes)
            pivots |= {of[place][0]: made.values[slot] for slot, place in passes.inwards(made, force.__getitem__)}  # type: ignore[arg-type]
            passes.accelerations(made, lambda place, to=to: to.setdefault(place, made.slots(1)))  # type: ignore[misc,arg-type]
            for place, (k, _) in of.items():
                a[k] = made.values[to[place]]
        self._told(pivots)
        return a

    def _at_rest(self, passes: TreePasses) -> None:
        """Turn accelerations of bodies that coordinates without second rates cause into forces of inertia: those that are left
        need no product with the inertia that a body carries."""
        values, nothing = self.made.values, self.made.zeros(1)
        passes.accelerations(self.made, lambda _: nothing, given=True)  # type: ignore[arg-type]
        for j, (first, kernel) in passes._accelerations.items():
            for i, row in enumerate(self._inertia(passes, j)):
                to, a = passes.at(j, ("p", i)), [values[first + kernel.column["a", k]] for k in range(len(row))]
                values[to] = self.made.program.let(sum((values[s] * e for s, e in zip(row, a, strict=True)), values[to]))
                if ("c", i) in passes.bodies[j].kernels.outward.column:
                    values[passes.at(j, ("c", i))] = se.Integer(0)

    def _forward_by_mass(self) -> list[Expr]:
        bias, program = self.at_rest(self.inverse(), self.a), self.made.program
        M, n = self.mass(), len(self.v)  # from the leaves inwards, so that what is 0 stays 0
        lower = {(i, j): M[n - 1 - i][n - 1 - j] for i in range(n) for j in range(i + 1)}
        left = [program.let(t - b) for t, b in zip(self.tau, bias, strict=True)]
        a, pivots = program.solved(lower, left[::-1])
        self._told(dict(enumerate(reversed(pivots))))
        return a[::-1]

    def at_rest(self, rows: Sequence[Expr], nothing: Sequence[Expr]) -> list[Expr]:
        """Outputs where some inputs are 0, in the same program."""
        table: dict[Expr, Expr] = {s: se.Integer(0) for s in nothing}
        for name in self.made.program.needed(rows):
            table[name] = self.made.program.let(substituted(self.made.program.steps[name], table))
        return [substituted(se.sympify(e), table) for e in rows]

    # -- frames

    def find(self, body: str) -> tuple[int, int] | None:
        """Number of the tree of a body, and its number there; None: the ground."""
        return next(((n, one.bodies[body]) for n, one in enumerate(self.trees) if body in one.bodies), None)

    def motion(self, body: str, offset: Array, turned: Array) -> tuple[list[Expr], list[list[Expr]], list[Expr]]:
        """Of a frame on a body: the vector from its centre to the point `at`, its axes (rows of R), and that point."""
        values, let, place = self.made.values, self.made.program.let, self.find(body)
        flat, at = False, dict[str, int]()  # slots of what moves
        if place is not None:
            passes, j = self.trees[place[0]].passes, place[1]
            flat = passes.bodies[j].kernels.kind.flat
            at = {key[1]: passes.at(j, key) for key in passes.bodies[j].kernels.outward.column if key[0] == "x"}

        def number(name: str, otherwise: int = 0) -> Expr:
            return values[at[name]] if name in at else se.Integer(otherwise)

        if flat:
            c, s = number("cos", 1), number("sin")
            R = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
        else:
            R = [[number(f"{a}{i}", int("xyz"[int(i) - 1] == a)) for a in "xyz"] for i in "123"]
        inside = [sum((float(turned[i, k]) * self.at[k] for k in range(3) if abs(turned[i, k]) > NOTHING),
                      se.sympify(float(offset[i]))) for i in range(3)]
        arm = [let(sum((R[i][k] * inside[k] for k in range(3)), se.Integer(0))) for i in range(3)]
        axes = [[let(sum((R[i][m] * float(turned[m, k]) for m in range(3)), se.Integer(0))) for k in range(3)] for i in range(3)]
        return arm, axes, [let(number(f"r{i + 1}") + arm[i]) for i in range(3)]

    def jacobian(self, body: str, offset: Array, turned: Array) -> list[list[Expr]]:
        """(6, n) rows: velocity of the point, angular velocity."""
        self._begin()
        J: list[list[Expr]] = [[se.Integer(0)] * len(self.v) for _ in AXES]
        if (place := self.find(body)) is None:
            return J
        (n, j), arm = place, Vec(*self.motion(body, offset, turned)[0])
        passes, let, values = self.trees[n].passes, self.made.program.let, self.made.values
        rates, columns, chain = dict(self._rates(n)), dict[Place, list[Expr]](), [j]
        while passes.bodies[chain[-1]].parent >= 0:
            chain.append(passes.bodies[chain[-1]].parent)
        for b in reversed(chain):
            own = passes.bodies[b].kernels
            known = dict(own.shape.known)

            def X(i: int, k: int, b: int = b, known: Any = known) -> Expr:
                value = known.get(("X", i, k))
                return values[passes.at(b, ("X", i, k))] if value is None else se.Integer(value)

            columns = {place: [let(sum((X(i, k) * e[k] for k in range(own.shape.parent)), se.Integer(0)))
                               for i in range(own.shape.body)] for place, e in columns.items()}
            columns |= {passes.unknown(b, f): [values[s] for s in self._freedom(passes, b, k)]
                        for k, f in enumerate(own.freedoms)}
        names = directions(passes.bodies[j].kernels.kind)
        for place, e in columns.items():
            of = dict(zip(names, e, strict=True))
            move, turn = (Vec(*(of.get(f"{a}{i}", 0) for i in (1, 2, 3))) for a in ("a", "al"))
            k, factor = rates[place]
            for i, entry in enumerate((*(move + turn.cross(arm)), *turn)):
                J[i][k] = let(J[i][k] + factor * entry)
        return J
