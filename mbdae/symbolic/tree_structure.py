"""What distinguishes two trees of joints apart from numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from mbdae.symbolic.derive import Side
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Structure

Numbers = tuple[tuple[str, int | None], ...]  #: parameter -> its value where that is 0, 1 or -1, None: a symbol


@dataclass(frozen=True)
class Link:
    """The joint that carries node `j` (its place in the tree, from 1) from node `parent` (0: the root)."""

    law: type[Joint]
    structure: Structure
    parent: int
    side: str  #: of the joint on which the parent is, "k" or "l"
    kind: NodeKind  #: of the node carried
    axes: tuple[Axes, Axes]  #: of the joint on its parent and on the node carried
    numbers: Numbers
    moves: bool  #: False of a joint that only holds a point where it is
    coordinates: tuple[str, ...]
    prescribed: tuple[bool, ...]  #: coordinate by coordinate
    first: int  #: number of its first coordinate among those of the tree, from 1


@dataclass(frozen=True)
class Member:
    """A law between nodes of the tree (None: the ground) that is part of its program."""

    law: tuple[Any, Structure, tuple[Side, ...]]
    nodes: tuple[int | None, ...]
    numbers: Numbers


@dataclass(frozen=True)
class TreeStructure:
    """What distinguishes two trees apart from numbers. loaded: nodes on which laws outside the program act."""

    root: NodeKind
    links: tuple[Link, ...]
    members: tuple[Member, ...]
    loaded: tuple[int, ...] = ()
