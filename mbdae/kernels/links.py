"""Kernels of single joints for the articulated-body recursion over large trees, see `symbolic/links`. They are compiled once for
every kind of joint with the body it carries, so that their number does not grow with the tree; `kernels/tree_passes.py`
calls them in order and chooses the slots that they read.

Trees of any size run joint by joint (`symbolic/links.py`, `kernels/links.py`, `kernels/tree_passes.py`). A joint with the body
it carries and the laws on that body is a `TreeProgram` of one link whose parent is given, so the statements of motion and laws
are those of the whole program. By derivatives of it follow what the articulated-body recursion needs: of the body's
acceleration by that of its parent (X) and by the joint's rates (S), of the forces by the acceleration (M). Joints that differ
in numbers alone share their kernels; where more than 12 kinds differ in numbers 0, 1 and -1 only, these become inputs. Three
passes run over the bodies:

outwards: motion of its parent, coordinates, numbers; its motion, X, S, the rest of its acceleration, M and forces of its own
    laws
inwards: M and forces with all it carries, force on its coordinates; what is added to M and forces of its parent; gains K, K0
outwards: acceleration of its parent, K, K0; its acceleration, second rates of its coordinates

Bodies of one kind behind each other are one operation (`PASS` inwards, which adds what an instance hands on before the next one
reads). Laws between other bodies, outside loads, free roots and prescribed coordinates enter between the passes. The derivative
of a list of operations is a list again (`native/program.py`: changes stand a fixed distance behind the numbers), so dy'/dy
comes column by column and its product with one direction at linear cost, by which the choice of the solver finds the largest
eigenvalues. Beside constraints the rows of a tree's velocities are inertia and forces along the freedoms at given
accelerations, by one more pass inwards. Of a small tree (`FUSED` in `system/model/moved_bodies.py`) the same passes are one
function: `kernels/tree_plan.py` runs their operations on expressions instead of numbers, and differentiates the result, whose
Jacobian has a pattern. Reactions follow joint by joint. A scene whose trees are all its constraints is prepared without a
matrix of all rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple

import symengine as se

from mbdae.disk import store
from mbdae.disk.entries import Digests, keep, key_of, part_key, recall
from mbdae.kernels import Kernel
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.links import (
    LinkProgram,
    MemberProgram,
    NodeProgram,
    Pass,
    PassShape,
    RootProgram,
    directions,
    inward,
    outward,
    projected,
)
from mbdae.symbolic.motion import symbolic_steps
from mbdae.symbolic.program import Program
from mbdae.symbolic.rebuild import symbols_of
from mbdae.symbolic.tree_motion import Link, Member, Open, TreeStructure
from mbdae.symbolic.vectors import Expr, Vec, rate_from_body_spin

Place = tuple[Any, ...]
#: number of operations below which LLVM optimises a kernel; more than elsewhere, because one such kernel is run for many bodies
OPTIMISED = 1500


class Stated(NamedTuple):
    """A straight-line program, the meaning of its input symbols, and its outputs, each with the place that it belongs to."""

    program: Program
    known: Mapping[Expr, Place]
    entries: Sequence[tuple[Place, Expr]]


class ProgramKernel(Kernel):
    """The kernel of a straight-line program; the program is derived only where the kernel is not on disk. inputs, targets: the
    meaning of its inputs and of its values."""

    def __init__(self, stated: Callable[[], Stated], key: str | None) -> None:
        self._find = stated
        tables = recall(part_key(key, "tables"))
        if tables is None:
            keep(part_key(key, "tables"), tables := self._tables())
        symbols, level, self.inputs, self.targets = tables
        super().__init__([se.Symbol(s) for s in symbols], lambda: self._closed, level, len(self.targets), key)

    def _tables(self) -> tuple[list[str], int, list[Place], list[Place]]:
        made = self._made
        used = symbols_of(self._closed)
        symbols = [s for s in made.known if s in used]
        level = 2 if len(made.program.needed(self._outputs)) < OPTIMISED else 0
        return [str(s) for s in symbols], level, [made.known[s] for s in symbols], [target for target, _ in made.entries]

    @cached_property
    def _made(self) -> Stated:
        return self._find()

    @cached_property
    def _outputs(self) -> list[Expr]:
        return [se.sympify(e) for _, e in self._made.entries]

    @cached_property
    def _closed(self) -> list[Expr]:
        return self._made.program.closed(self._outputs)

    def straight(self) -> tuple[Program, list[Expr]]:
        return self._made.program, self._outputs

    @cached_property
    def column(self) -> dict[Place, int]:
        """Target (what an output belongs to) -> number of the output."""
        return {target: i for i, target in enumerate(self.targets)}


class BodyKernels:
    """The kernels of a body and of the joint by which another body (its parent) carries it, or of a root.

    find: derives the program; kinds: kinds of nodes of parent and body; quaternion: whether rotations are evaluated as
    quaternions. outward: kernel of the motion of the body from that of its parent, see `LinkProgram.outward`; shape: the
    structure that selects the kernels of the passes; freedoms: places ("up", node, i) of the second rates of the joint's
    coordinates (of a root: of its own unknowns)."""

    def __init__(self, find: Callable[[], LinkProgram | RootProgram], kinds: tuple[NodeKind, NodeKind], quaternion: bool,
                 key: str | None) -> None:
        self._find, self._quaternion, (parent, self.kind) = find, quaternion, kinds
        key = part_key(key, f"quaternion {quaternion}")
        tables = recall(key)
        if tables is None:
            keep(key, tables := self._tables())
        known, self.freedoms = tables
        self.outward = ProgramKernel(self._outward, part_key(key, "outward"))
        self.shape = PassShape(len(directions(self.kind)), len(directions(parent)), len(self.freedoms), known)

    @cached_property
    def _made(self) -> tuple[LinkProgram | RootProgram, Program, list[tuple[Place, Expr]]]:
        """The program as found; the same with all accelerations set to 0, on which the outputs depend linearly; and the outputs
        of the latter with their places."""
        found = self._find()
        entries = found.outward(self._quaternion)
        program, values = found.still(entries)
        return found, program, [(place, e) for (place, _), e in zip(entries, values, strict=True)]

    def _tables(self) -> tuple[tuple[tuple[Place, int], ...], list[Place]]:
        found, _, entries = self._made
        known = tuple((place, int(e)) for place, e in entries if _is_known(place, e))
        return known, [place for place in found.inputs.values() if place[0] == "up"]

    def _outward(self) -> Stated:
        found, program, entries = self._made
        return Stated(program, found.inputs, [(place, e) for place, e in entries if not _is_known(place, e)])


def _is_known(place: Place, e: Expr) -> bool:
    """Whether an entry of X, S or c (see `LinkProgram.outward`) is an integer constant, so that the passes contain it."""
    return place[0] in ("X", "S", "c") and isinstance(e, se.Integer)


@lru_cache(maxsize=1)
def quaternion_rate() -> Kernel:
    """Kernel of the rate P' of a quaternion P from the angular velocity in body components."""
    symbols = se.symbols("P0:4 w1:4")
    return Kernel(list(symbols), rate_from_body_spin(symbols[:4], Vec(*symbols[4:])))


_PASSES: dict[str, Callable[[PassShape], Pass]] = {
    "inward": inward, "outward": outward, "outward, given": partial(outward, given=True), "projected": projected,
    "balance": partial(projected, moving=True),
}


@lru_cache(maxsize=512)
def pass_kernel(shape: PassShape, name: str) -> ProgramKernel:
    """A pass over bodies of a shape: "inward"; "outward", and "outward, given" with given second rates of the coordinates;
    "projected" projects forces on a body on the freedoms of its joint and transfers them to the body that carries it, "balance"
    does so with its inertia and forces at given accelerations."""

    def stated() -> Stated:
        made = _PASSES[name](shape)
        return Stated(made.program, made.inputs, made.outputs)

    return ProgramKernel(stated, key_of("pass", name, Digests().of(shape)))


@lru_cache(maxsize=512)
def link_kernels(parent: NodeKind, link: Link, members: tuple[Member, ...], quaternion: bool) -> BodyKernels:
    """The kernels of a joint and its body: in link and members the carrying body is node 0, the carried body node 1."""
    key = structure_key(TreeStructure(parent, (link,), members))
    return BodyKernels(lambda: LinkProgram(parent, link, members), (parent, link.kind), quaternion, part_key(key, "link"))


@lru_cache(maxsize=8)
def root_kernels(kind: NodeKind, quaternion: bool) -> BodyKernels:
    """The kernels of the root of a tree: a body that no joint carries, whose unknowns are its own q and u."""
    return BodyKernels(lambda: RootProgram(kind), (NodeKind.GROUND, kind), quaternion, key_of("root", kind.name))


@lru_cache(maxsize=128)
def member_kernel(kinds: tuple[NodeKind, ...], member: Member) -> ProgramKernel:
    """Kernel of the forces of a law between several bodies of a tree. kinds: kinds of these nodes; member: the law, whose node
    numbers are positions in `kinds`."""

    def stated() -> Stated:
        found = MemberProgram(kinds, member)
        entries = found.forces()
        program, values = found.still(entries)
        return Stated(program, found.inputs, [(place, e) for (place, _), e in zip(entries, values, strict=True)])

    key = structure_key(TreeStructure(NodeKind.GROUND, (), (member,)))
    return ProgramKernel(stated, part_key(key, "member", *(kind.name for kind in kinds)))


@lru_cache(maxsize=16)
def node_motion(kind: NodeKind, heads: tuple[str, ...]) -> ProgramKernel:
    """Kernel of q, u and u' of a body from its motion as the outward pass leaves it. heads: which of "q", "u", "up" to return."""
    return _node_kernel(kind, lambda found: found.motion(heads), "motion", *heads)


@lru_cache(maxsize=8)
def node_load(kind: NodeKind, role: str) -> ProgramKernel:
    """Kernel of the force and the moment on a body from what laws outside of the tree added to its rows. role: "wu" for equations
    of motion, "wq" for corrections of the rates of positions."""
    return _node_kernel(kind, lambda found: found.load(role), "load", role)


def _node_kernel(kind: NodeKind, entries: Callable[[NodeProgram], Sequence[tuple[Place, Expr]]], *names: str) -> ProgramKernel:
    def stated() -> Stated:
        found = NodeProgram(kind)
        made = entries(found)  # which adds to the program and its inputs
        return Stated(found.program, found.inputs, made)

    return ProgramKernel(stated, key_of("node", kind.name, *names))


def alone(link: Link, open: Open) -> Link:
    """A joint taken out of its tree: it carries node 1 on node 0. open: which of its numbers are inputs."""
    return replace(link, parent=0, first=1, numbers=open.inputs(link.numbers))


def between(member: Member, nodes: Mapping[int, int], open: Open) -> Member:
    """A law with its nodes renumbered: `nodes` maps the old numbers to the new ones. open: which of its numbers are inputs."""
    return Member(member.law, tuple(None if n is None else nodes[n] for n in member.nodes), open.inputs(member.numbers))


def structure_key(structure: TreeStructure) -> str | None:
    """The key of a tree on disk, from its shape, the motions of its joints and the statements of its laws; None where a law has
    no key."""
    if not store().used:
        return None
    try:
        laws = [member.law.key for member in structure.members]
        if None in laws:
            return None
        shape = [structure.root, structure.loaded, [(m.nodes, m.numbers) for m in structure.members]]
        return key_of("tree", Digests().of([shape, laws, list(map(_link, structure.links))]))
    except Exception:  # a law that cannot be derived (derivation reports it), or one that has no key
        return None


def _link(link: Link) -> list[Any]:
    law = link.law.symbolic(link.structure)
    stated = {f.name: getattr(link, f.name) for f in fields(link) if f.name not in ("law", "structure", "motion")}
    units = [(name, entry.unit) for name, entry in link.law.coordinates.items()]
    return [stated, units, list(link.law.params), symbolic_steps(law)]
