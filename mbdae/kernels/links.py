"""Kernels of the joints of a tree, one by one: compiled once for every kind of joint with the body it carries.

Their number does not grow with the tree; `system/assembled/ordered_tree.py` says in which order they run, on which numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import Any

import symengine as se

from mbdae.kernels.compile import Kernel
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.links.passes import Pass, Shape, inward, outward, projected
from mbdae.symbolic.links.programs import LinkProgram, MemberProgram, NodeProgram, RootProgram
from mbdae.symbolic.links.state import directions
from mbdae.symbolic.program import Program
from mbdae.symbolic.quaternions import rate_from_body_spin
from mbdae.symbolic.tree_motion import Link, Member
from mbdae.symbolic.vectors import Expr, Vec

Place = tuple[Any, ...]
OPTIMISED = 1500  #: steps up to which LLVM optimises a kernel: it runs for every body, and is compiled once


class ProgramKernel(Kernel):
    """The kernel of a straight-line program; inputs and targets: the meaning of its inputs and values."""

    def __init__(self, program: Program, known: Mapping[Expr, Place], entries: Sequence[tuple[Place, Expr]]) -> None:
        stated = [se.sympify(e) for _, e in entries]
        closed = program.closed(stated)
        used = set().union(*(e.free_symbols for e in closed))
        symbols = [s for s in known if s in used]
        super().__init__(symbols, closed, 2 if len(program.needed(stated)) < OPTIMISED else 0)
        self._program = program, stated
        self.inputs, self.targets = [known[s] for s in symbols], [target for target, _ in entries]

    def straight(self) -> tuple[Program, list[Expr]]:
        return self._program

    @cached_property
    def column(self) -> dict[Place, int]:
        """Where the value of a target stands among the values."""
        return {target: i for i, target in enumerate(self.targets)}


class BodyKernels:
    """The kernels of a body with what carries it. outward: its motion from that of the carrying body, see `LinkProgram.outward`;
    shape: of the passes; freedoms: places of the unknowns of the joint (or of a root), ("up", node, i)."""

    def __init__(self, found: LinkProgram | RootProgram, parent: NodeKind, quaternion: bool, heavy: bool) -> None:
        entries = found.outward(quaternion)
        program, values = found.still(entries)
        varying = [(place, e) for (place, _), e in zip(entries, values, strict=True)
                   if place[0] not in ("X", "S", "c") or not isinstance(e, se.Integer)]  # fmt: skip
        known = tuple((place, int(e)) for (place, _), e in zip(entries, values, strict=True)
                      if place[0] in ("X", "S", "c") and isinstance(e, se.Integer))  # fmt: skip
        self.outward = ProgramKernel(program, found.inputs, varying)
        self.freedoms = [found.inputs[s] for s in found.inputs if found.inputs[s][0] == "up"]
        body = found.nodes[-1].kind
        self.kind = body
        self.shape = Shape(len(directions(body)), len(directions(parent)), len(self.freedoms), known, heavy)

    @cached_property
    def passes(self) -> tuple[ProgramKernel, ProgramKernel, ProgramKernel]:
        """Inward, outward, and outward with given second rates."""
        return _passes(self.shape)


@lru_cache(maxsize=256)
def projection(shape: Shape) -> ProgramKernel:
    """Of forces on the freedoms of a body, and on the body that carries it."""
    return _kernel(projected(shape))


@lru_cache(maxsize=1)
def quaternion_rate() -> Kernel:
    """P' of a quaternion P and an angular velocity in body components."""
    symbols = se.symbols("P0:4 w1:4")
    return Kernel(list(symbols), rate_from_body_spin(symbols[:4], Vec(*symbols[4:])))


@lru_cache(maxsize=256)
def _passes(shape: Shape) -> tuple[ProgramKernel, ProgramKernel, ProgramKernel]:
    made = inward(shape), outward(shape), outward(shape, True)
    return _kernel(made[0]), _kernel(made[1]), _kernel(made[2])


def _kernel(made: Pass) -> ProgramKernel:
    return ProgramKernel(made.program, made.inputs, made.outputs)


@lru_cache(maxsize=512)
def link_kernels(parent: NodeKind, link: Link, members: tuple[Member, ...], quaternion: bool, heavy: bool) -> BodyKernels:
    """Of a joint: link and members with parent 0, the body that is carried 1."""
    return BodyKernels(LinkProgram(parent, link, members), parent, quaternion, heavy)


@lru_cache(maxsize=8)
def root_kernels(kind: NodeKind, quaternion: bool) -> BodyKernels:
    """Of a body that moves by unknowns of its own."""
    return BodyKernels(RootProgram(kind), NodeKind.GROUND, quaternion, True)


@lru_cache(maxsize=128)
def member_kernel(kinds: tuple[NodeKind, ...], member: Member) -> ProgramKernel:
    """Forces of a law between bodies of these kinds, which its nodes count from 0."""
    found = MemberProgram(kinds, member)
    entries = found.forces()
    program, values = found.still(entries)
    return ProgramKernel(program, found.inputs, [(place, e) for (place, _), e in zip(entries, values, strict=True)])


@lru_cache(maxsize=16)
def node_motion(kind: NodeKind, heads: tuple[str, ...]) -> ProgramKernel:
    """Those of q, u and u' ("up") of a body that are asked for, from the numbers of its motion."""
    found = NodeProgram(kind)
    entries = found.motion(heads)
    return ProgramKernel(found.program, found.inputs, entries)


@lru_cache(maxsize=8)
def node_load(kind: NodeKind, role: str) -> ProgramKernel:
    """Force and moment on a body from its rows of laws outside of the tree."""
    found = NodeProgram(kind)
    entries = found.load(role)
    return ProgramKernel(found.program, found.inputs, entries)


def alone(link: Link, general: bool) -> Link:
    """A joint as its kernels see it. general: its numbers are given at run time, also where they are 0, 1 or -1."""
    numbers = tuple((name, None if general else value) for name, value in link.numbers)
    return replace(link, parent=0, first=1, numbers=numbers)


def between(member: Member, nodes: Mapping[int, int], general: bool) -> Member:
    """A law with other numbers of its nodes."""
    numbers = tuple((name, None if general else value) for name, value in member.numbers)
    return Member(member.law, tuple(None if n is None else nodes[n] for n in member.nodes), numbers)
