"""The tree of a scene: the joint from which the position of each body follows, and the joints that close loops."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TypeVar

from mbdae.scene.components import Body, Connection
from mbdae.scene.items import SceneItems

T = TypeVar("T")


@dataclass(frozen=True)
class Tree:
    """Spanning forest: (parent, joint, child) from the roots outwards, the roots, and the joints that close loops."""

    edges: list[tuple[Body, Connection, Body]]
    roots: list[Body]
    closing: list[Connection]

    def loop(self, joint: Connection) -> list[Connection]:
        """The joints of the loop that a joint closes, this one first."""
        carrier = {child: (parent, tree_joint) for parent, tree_joint, child in self.edges}

        def ways(body: Body) -> list[Connection]:
            """The joints from a body to its root."""
            found = []
            while body in carrier:
                body, tree_joint = carrier[body]
                found.append(tree_joint)
            return found

        one, other = ways(joint.k), ways(joint.l)
        return [joint, *(j for j in one if j not in other), *(j for j in other if j not in one)]


def leader(item: T, leads: dict[T, T]) -> T:
    """The representative of the group of `item`; leads: item -> an item of its group nearer to the representative; the way to it
    is shortened for later calls."""
    while item in leads:
        before, item = item, leads[item]
        leads[before] = leads.get(item, item)
    return item


def spanning_tree(scene: SceneItems, joints: Collection[Connection] | None = None) -> Tree:
    """Spanning forest in which recursive joints come first, then rigid ones, then those whose start is prescribed or held, then
    the order of the scene; joints with clearance come last. Where bodies float freely, a root is one that is l of no joint, if
    there is one: values held at the start then move l relative to k, whichever body was stated first.

    joints: those that count; all by default."""
    leads: dict[Body, Body] = {}
    chosen: list[Connection] = []
    closing: list[Connection] = []
    first = sorted(scene.joints if joints is None else joints, key=_rank)
    for joint in first:
        a, b = leader(joint.k, leads), leader(joint.l, leads)
        if a is b or joint.others:
            closing.append(joint)
        else:
            leads[a] = b
            chosen.append(joint)
    edges: list[tuple[Body, Connection, Body]] = []
    roots: list[Body] = []
    seen: set[Body] = set()
    joined: dict[Body, list[tuple[Connection, Body]]] = {}  #: body -> its joints, each with the body on its other side
    for joint in chosen:
        for a, b in ((joint.k, joint.l), (joint.l, joint.k)):
            joined.setdefault(a, []).append((joint, b))
    carried = {joint.l for joint in chosen}
    for root in [scene.ground, *sorted(scene.bodies, key=carried.__contains__)]:
        if root not in seen:
            roots.append(root)
            seen.add(root)
            _grow(root, joined, seen, edges)
    return Tree(edges, roots, closing)


def _grow(root: Body, joined: dict[Body, list[tuple[Connection, Body]]], seen: set[Body],
          edges: list[tuple[Body, Connection, Body]]) -> None:  # fmt: skip
    front = [root]
    for parent in front:
        for joint, child in joined.get(parent, ()):
            if child not in seen:
                seen.add(child)
                edges.append((parent, joint, child))
                front.append(child)


def _rank(c: Connection) -> tuple[bool, ...]:
    return c.loose, not c.recursive, not c.rigid, not is_held(c)


def is_held(joint: Connection) -> bool:
    """Whether the start of the joint's coordinate is fixed by the user."""
    return bool(joint.prescribed or joint.hold or joint.hold_rate)


def not_joined(scene: SceneItems) -> tuple[str, ...]:
    """Names of bodies that no chain of joints connects with the ground: free bodies, or ones whose joint was forgotten."""
    pairs = [{side.name for side in (c.k, c.l, *c.others.values())} for c in scene.joints]
    joined, size = {scene.ground.name}, 0
    while size < len(joined):
        size = len(joined)
        joined.update(*(pair for pair in pairs if pair & joined))
    return tuple(b.name for b in scene.bodies if b.name not in joined and b is not scene.ground)
