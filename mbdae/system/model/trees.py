"""Trees of recursive joints and welds in a model: root, joints, the body that each joint moves, and the laws between them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.errors import SceneError
from mbdae.scene.components import Body, Connection
from mbdae.scene.models import leader, spanning_tree
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element, Force, Structure
from mbdae.symbolic.tree_motion import FRAMES, Link, Member, Numbers, Open, TreeStructure
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Instance, Node, drawn_quaternion, quaternion, quaternion_product

#: difference from 0, 1 or -1 up to which a number of a joint counts as this number; an offset is compared with 0 over the scene's
#: length
ROUND_OFF = 1e-15
Place = tuple[int, int]  #: numbers of a group and of an instance


@dataclass(frozen=True)
class Tree:
    """A tree with its nodes and laws. nodes[0] is the root (None: the ground), nodes[j] is moved by joints[j - 1].

    members: (group, instance) of the inertias and forces between nodes of the tree, which its kernels contain."""

    structure: TreeStructure
    nodes: tuple[Node | None, ...]
    coordinates: tuple[Node, ...]  #: coordinates of all joints, in the order of the joints
    joints: tuple[Place, ...]
    names: tuple[str, ...]  #: names of the joints
    members: tuple[Place, ...]
    #: per joint: its parameters, places and axes on both bodies; in space also their quaternions
    numbers: tuple[dict[str, float], ...]

    @cached_property
    def moved_nodes(self) -> tuple[Node, ...]:
        """Nodes of the tree without unknowns: all bodies but the root, and the prescribed coordinates."""
        driven = [self.node(-c) for _, c, _ in self.driven]
        return tuple(n for n in (*self.nodes[1:], *driven) if n is not None)

    @cached_property
    def driven(self) -> list[tuple[int, int, str]]:
        """Prescribed coordinates: number of the joint and of the coordinate in the tree, both from 1, and name of the parameter
        that prescribes it."""
        return [(j, link.first + n, link.law.drive_name(name)) for j, link in enumerate(self.structure.links, start=1)
                for n, (name, driven) in enumerate(zip(link.coordinates, link.prescribed, strict=True)) if driven]

    @property
    def rigid(self) -> tuple[str, ...]:
        """Names of the welds."""
        return tuple(name for name, link in zip(self.names, self.structure.links, strict=True) if not link.coordinates)

    def node(self, j: int) -> Node:
        """A node by its number in the tree: 0 is the root, j the body that joint j moves, -c the joint coordinate c."""
        found = self.nodes[j] if j >= 0 else self.coordinates[-j - 1]
        assert found is not None
        return found

    def loaded(self, nodes: set[Node]) -> Tree:
        """This tree with those of its bodies marked as loaded that are among `nodes`: laws outside of the tree act on them."""
        numbers = tuple(j for j, n in enumerate(self.nodes) if j and n in nodes)
        return replace(self, structure=replace(self.structure, loaded=numbers))

    def again(self, model: Model, last: Model) -> Tree | None:
        """This tree of `last` in a model that differs from it in numbers alone; None where its kernels contain one of these."""
        def same(place: Place) -> bool:
            (g, i), known = place, last.length == model.length
            return known and model.groups[g].instances[i] is last.groups[g].instances[i]

        numbers, of = list(self.numbers), self.structure
        for j, (place, link) in enumerate(zip(self.joints, of.links, strict=True)):
            if not same(place):
                group = model.groups[place[0]]
                numbers[j] = _with_quaternions(group.instances[place[1]], group.key[2])
                if _rounded(numbers[j], model.length) != link.numbers:
                    return None
        if any(_rounded(model.groups[g].instances[i].numbers, model.length) != member.numbers
               for (g, i), member in zip(self.members, of.members, strict=True) if not same((g, i))):
            return None
        named = {n.name: n for n in model.nodes}
        nodes = tuple(n and named[n.name] for n in self.nodes)
        return replace(self, nodes=nodes, coordinates=tuple(named[n.name] for n in self.coordinates), numbers=tuple(numbers))

    def opened(self, open: Open = Open.LAWS) -> Tree:
        """This tree with numbers of its laws as inputs of its kernels."""
        inputs, of = open.inputs, self.structure
        links = tuple(replace(link, numbers=inputs(link.numbers)) for link in of.links)
        members = tuple(replace(member, numbers=inputs(member.numbers)) for member in of.members)
        return replace(self, structure=replace(of, links=links, members=members))


Joined = tuple[Connection, Body, Body]  #: a joint with the bodies (or nodes of beams) it connects


def refused(joints: list[Joined]) -> list[str]:
    """Error messages for joints that cannot be recursive, one sentence each."""
    leads: dict[Body, Body] = {}
    via: dict[Body, str] = {}
    found = []
    for c, k, l in joints:
        for body in (k, l):
            if body.is_point and (body is k or any(c.unit(name) == "rad" for name in c.coordinates)):
                found.append(f"{c.kind} '{c.name}': model=mb.Recursive() needs an orientation of '{body.name}', a point mass has "
                             f"none; use s.rigid_body, or model=mb.Kinematic()")
        a, b = leader(k, leads), leader(l, leads)
        if a is b:
            taken = via.get(l) or via.get(k)
            found.append(f"{c.kind} '{c.name}': model=mb.Recursive() closes a loop: the motion of '{l.name}' relative to "
                         f"'{k.name}' already follows from other recursive joints (among them '{taken}'); use "
                         f"model=mb.Kinematic() for one joint of the loop, or s.recursive() which chooses it")
            continue
        leads[a] = b
        via.setdefault(l, c.name)
        via.setdefault(k, c.name)
    return found


def find_trees(model: Model) -> list[Tree]:
    """The trees of the recursive joints of a model; raises SceneError where one cannot be recursive."""
    joints = [(c, *model.ends(c)) for c in model.recursive]
    problems = refused(joints)
    if problems:
        raise SceneError(problems)
    joints += _rigid(model, joints)
    carrying = {c.name for c, _, _ in joints}
    places = {instance.item: (g, i) for g, i, instance in model.instances()
              if instance.item in carrying and isinstance(instance.law, Joint)}
    trees, seen = [], set()
    for root in _roots(joints, model.scene.ground):
        if root not in seen:
            edges = _edges(root, joints)
            seen |= {root, *(child for _, _, child in edges)}
            if edges:
                trees.append(_tree(model, root, edges, places))
    return trees


def _rigid(model: Model, joints: list[Joined]) -> list[Joined]:
    """Rigid joints that close no loop with the recursive joints: they become part of the trees."""
    leads: dict[Body, Body] = {}
    points: set[Body] = set()  # point masses in a tree: they have no orientation, so that no further weld to them can be in one
    for _, k, l in joints:
        leads[leader(k, leads)] = leader(l, leads)
        points |= {b for b in (k, l) if b.is_point}
    found = []
    for c in (c for c in model.scene.joints if c.rigid and c.name not in model.stay_kinematic):
        a, b = leader(c.k, leads), leader(c.l, leads)
        if a is not b and not points & {c.k, c.l}:
            leads[a] = b
            points |= {body for body in (c.k, c.l) if body.is_point}
            found.append((c, c.k, c.l))
    return found


def _roots(joints: list[Joined], ground: Body) -> list[Body]:
    """Bodies in the order in which they are tried as roots of trees: the ground, rigid bodies, point masses; among these first
    those that are on side l of no joint."""
    bodies = list(dict.fromkeys([b for _, *ends in joints for b in ends]))
    carried = {l for _, _, l in joints}
    return sorted(bodies, key=lambda b: (b is not ground, b.is_point, b in carried))


def _edges(root: Body, joints: list[Joined]) -> list[tuple[Body, Connection, Body]]:
    edges: list[tuple[Body, Connection, Body]] = []
    front, at, taken = deque([root]), dict[Body, list[int]](), set[int]()
    for number, (_, k, l) in enumerate(joints):
        at.setdefault(k, []).append(number)
        at.setdefault(l, []).append(number)
    while front:
        parent = front.popleft()
        for number in at.get(parent, ()):
            if number in taken:
                continue
            taken.add(number)
            c, k, l = joints[number]
            child = l if k is parent else k
            edges.append((parent, c, child))
            front.append(child)
    return edges


def _tree(model: Model, root: Body, edges: list[tuple[Body, Connection, Body]], places: dict[str, Place]) -> Tree:
    bodies = [root, *(child for _, _, child in edges)]
    nodes = tuple(model.node(b) for b in bodies)
    joints = tuple(places[c.name] for _, c, _ in edges)
    numbers = tuple(_with_quaternions(model.groups[g].instances[i], model.groups[g].key[2]) for g, i in joints)
    coordinates: list[Node] = []
    made: list[Link] = []
    number = {body: j for j, body in enumerate(bodies)}
    for (parent, c, child), place, own in zip(edges, joints, numbers, strict=True):
        made.append(_link(model, number[parent], model.node(child), place, own, len(coordinates) + 1))
        found = [model.coordinate_node(c.name, name) for name in made[-1].coordinates]
        coordinates += [node for node in found if node is not None]
    links = tuple(made)
    kind = nodes[0].kind if nodes[0] is not None else NodeKind.PLANAR_GROUND if model.planar else NodeKind.GROUND
    numbered = {n: j for j, n in enumerate(nodes) if n is not None}
    members = tuple((g, i) for g, i, instance in model.instances() if _is_member(instance, model.groups[g].key[1], numbered))
    stated = tuple(_member(model, g, i, numbered) for g, i in members)
    names = tuple(c.name for _, c, _ in edges)
    return Tree(TreeStructure(kind, links, stated), nodes, tuple(coordinates), joints, names, members, numbers)


def _link(model: Model, parent: int, child: Node | None, place: Place, numbers: dict[str, float], first: int) -> Link:
    """A joint as a link of the tree. parent: number of the carrying node in the tree; child: the node it carries; place, numbers:
    its law; first: number of its first coordinate in the tree."""
    assert child is not None
    group, instance = model.groups[place[0]], model.groups[place[0]].instances[place[1]]
    sides = group.key[2]
    outward = child is instance.nodes[1]
    axes = (sides[0][1], sides[1][1]) if outward else (sides[1][1], sides[0][1])
    law, structure, _ = group.key
    coordinates = tuple(instance.law.own_coordinates)
    prescribed = tuple(name in instance.law.prescribed for name in coordinates)
    moves = bool(coordinates) or instance.law.welds
    rounded = _rounded(numbers, model.length)
    return Link(law, structure, parent, "k" if outward else "l", child.kind, axes, rounded, moves, coordinates, prescribed, first,
                group.motion)


def _with_quaternions(instance: Instance, sides: Any) -> dict[str, float]:
    """Numbers of a joint's law; in space with the quaternions of its axes in both bodies, "k_P0" to "l_P3"."""
    stated = instance.law.params.keys() - instance.law.derived()
    own = {name: v for name, v in instance.numbers.items() if name[:2] in FRAMES or name in stated}
    for side, (kind, _) in zip("kl", sides[:2], strict=True):
        if kind in (NodeKind.SPATIAL, NodeKind.GROUND):
            Q = np.array([[own[f"{side}_Q{a}{i}"] for a in "xyz"] for i in (1, 2, 3)])
            own |= {f"{side}_P{i}": float(p) for i, p in enumerate(quaternion(Q))}
    if "k_P0" in own and "l_P0" in own:
        k, l = (drawn_quaternion(None if n is None else n.body) for n in instance.nodes[:2])
        to_joint, of_l = (np.array([own[f"{side}_P{i}"] for i in range(4)]) for side in "kl")
        # P and -P are the same rotation: choose the sign with which the joint's quaternions are equal from both sides
        if quaternion_product(k, to_joint) @ quaternion_product(l, of_l) < 0:
            own |= {f"l_P{i}": -float(p) for i, p in enumerate(of_l)}
    return own


def _rounded(numbers: dict[str, float], length: float) -> Numbers:
    """Numbers as part of the structure of a tree: those equal to 0, 1 or -1, of places and axes up to rounding, become constants
    of its kernels, all others (None) are inputs at run time. length: that of the scene, m."""
    out: list[tuple[str, int | None]] = []
    for name, value in numbers.items():
        slack = ROUND_OFF if name[:2] in FRAMES else 0.0
        small = slack * (length if "_p" in name else 1.0)
        whole = 0 if abs(value) <= small else (1 if value > 0 else -1) if abs(abs(value) - 1) <= slack else None
        out.append((name, whole))
    return tuple(out)


def _is_member(instance: Instance, structure: Structure, numbered: dict[Node, int]) -> bool:
    """Whether a law becomes part of the kernels of a tree: an inertia or a force between nodes of this tree (and the ground), at
    least one of which its joints move. numbered: node -> number in the tree. Contacts do not, because the check of their gaps
    between steps reads the motion of the bodies."""
    moving = [n for n in instance.nodes if n is not None]
    law = instance.law
    touches = isinstance(law, Force) and law.has_gaps
    return (isinstance(law, Element | Force) and not (touches or law.states or law.own_coordinates or structure.feeds)
            and all(n in numbered for n in moving) and any(numbered[n] > 0 for n in moving))


def _member(model: Model, g: int, i: int, numbered: dict[Node, int]) -> Member:
    group, instance = model.groups[g], model.groups[g].instances[i]
    nodes = tuple(None if n is None else numbered[n] for n in instance.nodes)
    return Member(group.derived, nodes, _rounded(instance.numbers, model.length))


def lumped(scene: Any) -> tuple[dict[str, Any], set[str]]:
    """Make rigid bodies that are welded together one body, with the mass, centre and inertia of all, in a scene made for that.
    Returns the body that each one is part of, by name, and the names of these welds."""
    carriers, welds, parts = {b.name: b for b in (scene.ground, *scene.bodies)}, set[str](), dict[str, list[Any]]()
    for parent, joint, child in spanning_tree(scene).edges:
        one = carriers[parent.name]
        rigid = all(b.is_ground or b.inertia is not None for b in (one, child))
        if joint.rigid and rigid and (one.is_ground or _gravity(scene, one) == _gravity(scene, child)):
            welds.add(joint.name)
            carriers[child.name] = one
            parts.setdefault(one.name, [one]).append(child)
    scene.bodies[:] = [b for b in scene.bodies if carriers[b.name] is b]
    scene.connections[:] = [c for c in scene.connections if c.name not in welds]
    vars(scene).update(_known={"ground": scene.ground}, _read=[0] * 5)  # names are looked up anew
    for c in scene.connections:
        vars(c).update(k=carriers.get(c.k.name, c.k), l=carriers.get(c.l.name, c.l),
                       others={side: carriers.get(b.name, b) for side, b in c.others.items()})
    scene.connections[:] = [c for c in scene.connections if c.k is not c.l or not c.is_joint]  # of a loop of welds
    for b in scene.bodies:
        if b.name in parts:
            _lump(b, parts[b.name])
        if b.inertia is not None:  # what rotations left of products that are 0 would cost operations
            vars(b)["inertia"] = np.where(np.abs(b.inertia) > ROUND_OFF * np.max(np.abs(b.inertia)), b.inertia, 0.0)
    return carriers, welds


def _gravity(scene: Any, body: Any) -> list[float]:
    return list(scene.gravity if body.gravity is None else body.gravity)


def _lump(body: Any, parts: list[Any]) -> None:
    """Give a body the mass, centre and inertia of its parts together."""
    mass = sum(b.mass for b in parts)
    centre = sum(b.mass * b.drawn.position for b in parts) / mass if mass else body.drawn.position
    J = np.zeros((3, 3))
    for b in parts:
        off = b.drawn.position - centre
        J += b.drawn.rotation @ b.inertia @ b.drawn.rotation.T + b.mass * (off @ off * np.eye(3) - np.outer(off, off))
    R = body.drawn.rotation
    vars(body).update(mass=mass, inertia=R.T @ J @ R, drawn=replace(body.drawn, position=centre))
