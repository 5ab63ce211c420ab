"""Numbering of the unknowns, and of all numbers that kernels read: y, y', motion of loaded nodes, prescribed values,
parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.inputs import timed
from mbdae.kernels.plan import Inputs
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.outputs import Target
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node
from mbdae.system.model.shared_nodes import Sharing, clock

COORDINATES = {
    NodeKind.SPATIAL: (("x", "y", "z", "P0", "P1", "P2", "P3"), ("vx", "vy", "vz", "Omega_x", "Omega_y", "Omega_z")),
    NodeKind.PLANAR: (("x", "y", "theta"), ("vx", "vy", "omega")),
    NodeKind.POINT: (("x", "y", "z"), ("vx", "vy", "vz")),
    NodeKind.PLANAR_POINT: (("x", "y"), ("vx", "vy")),
    NodeKind.ROTATION: (("P0", "P1", "P2", "P3"), ("Omega_x", "Omega_y", "Omega_z")),
}


def _names(node: Node) -> tuple[list[str], list[str]]:
    """Names of the position and of the velocity unknowns of a node."""
    if node.kind is NodeKind.COORDINATE:
        alone = node.name == node.joint
        return [f"{node.joint}.{node.coordinate}"], [f"{node.joint}.{'rate' if alone else f'{node.coordinate}_rate'}"]
    name = node.name if node.body is not None else f"{node.joint}.{node.coordinate}"
    q, u = ([f"{name}.{c}" for c in part] for part in COORDINATES[node.kind])
    return q, u


@dataclass(frozen=True)
class Row:
    """A constraint row: numbers of its group and instance, its number in the law, its name "joint.row". prescribes: whether it
    prescribes a coordinate; by_rates: whether it is stated by velocities, so that it restricts no positions."""

    group: int
    instance: int
    row: int
    name: str
    prescribes: bool = False
    by_rates: bool = False


def constraint_rows(model: Model) -> list[Row]:
    """All constraint rows of a model, in the order of the scene's items."""
    rows = [
        Row(g, i, r, f"{instance.item}.{name}", name in group.derived.law.drives(), name in group.derived.by_rates)
        for g, group in enumerate(model.groups) if group.derived.rows
        for i, instance in enumerate(group.instances)
        for r, name in enumerate(group.derived.rows)
    ]
    order = {c.name: n for n, c in enumerate(model.scene.connections)}
    return sorted(rows, key=lambda row: order[model.groups[row.group].instances[row.instance].item])


class Numbering:
    """The order of the unknowns y = (q, u, s, z, lambda, mu), without the blocks that a form does not have, and of the workspace.

    The workspace is an array of all numbers that kernels read; a slot is a column of it. Its slots are y, y', the motion of
    loaded nodes, prescribed values, constants (numbers of the laws and the like), and a 0, which inputs without an unknown read.

    rows: constraint rows in force; blocks: those of multipliers and stresses in y; derivatives: the multipliers are the
    derivatives of these unknowns. moved: nodes whose motion follows from joint coordinates, so that they have no unknowns.
    loaded: those of them on which laws act; their slots are q, u and u', and the terms "wq", "wu" that laws add to their rows.
    replaced: groups and instances of laws that are evaluated with a tree. constants: further constants after those of the laws.
    sharing: nodes with displacement of another node, or a constant one. numbers: parameters of the form, which every law can
    read."""

    def __init__(self, model: Model, rows: list[Row], blocks: tuple[str, ...] = ("lambda", "mu"), derivatives: bool = False,
                 moved: Iterable[Node] = (), loaded: Iterable[Node] = (),
                 replaced: frozenset[tuple[int, int]] = frozenset(), constants: Sequence[float] = (),
                 sharing: Sharing | None = None, numbers: Mapping[str, float] | None = None) -> None:
        self.model, self.rows, self.derivatives, self.m = model, rows, derivatives, len(rows)
        carried = set(moved)
        self.free = [node for node in model.nodes if node not in carried]
        self._place: dict[str, tuple[int, int]] = {}
        self.nq = self.nu = 0
        self._sharing = sharing or Sharing()
        for node in self.free:
            self._place[node.name] = self.nq, self.nu
            self.nq += node.kind.sizes[0] - self._own(node, "q")
            self.nu += node.kind.sizes[1] - self._own(node, "u")
        with_states = [(g, group, group.derived.states) for g, group in enumerate(model.groups) if group.derived.states]
        self.states = {(g, i, j): f"{instance.item}.{name}" for g, group, states in with_states
                       for i, instance in enumerate(group.instances) if (g, i) not in replaced
                       for j, name in enumerate(states)}
        self._state = {key: n for n, key in enumerate(self.states)}
        self._kept_state = {model.groups[g].instances[i].item: n for (g, i, _), n in self._state.items()
                            if model.groups[g].instances[i].law.keeps_states}
        self._row = {(r.group, r.instance, r.row): n for n, r in enumerate(rows)}
        self.stresses = [name for line in model.lines for name in line.stresses] if "z" in blocks else []
        sizes = {"q": self.nq, "u": self.nu, "s": len(self.states), "z": len(self.stresses)}
        sizes |= {block: self.m if block in blocks else 0 for block in ("lambda", "mu")}
        self.start = dict(zip(sizes, accumulate(sizes.values(), initial=0), strict=False))
        self.n = sum(sizes.values())
        self._loaded: dict[str, int] = {}
        self.first_input = 2 * self.n
        for node in loaded:
            self._loaded[node.name] = self.first_input
            self.first_input += 2 * node.kind.sizes[0] + 3 * node.kind.sizes[1]
        self._gathers: dict[Any, NDArray[np.intp]] = {}
        self._places: dict[tuple[int, Target], NDArray[np.intp]] = {}
        self._slots: dict[tuple[int, int, str], int] = {}
        self.form_numbers = dict(numbers or {})
        self._clock_values = self._collect_prescribed()
        self._first_constant = self.first_input + len(self._clock_values)
        self._constants: Any = []  # a list, of which others of the same shape have an array
        self._collect_numbers()
        self.further = self._add(constants)
        self._at = {name: self._add(position) for name, position in self._sharing.fixed_position.items()}
        self._turned = {name: self._add(rotation) for name, rotation in self._sharing.fixed_rotation.items()}
        self.clock = clock(tuple(self._clock_values))
        self.width = self._first_constant + len(self._constants) + 1

    def _collect_prescribed(self) -> list[Any]:
        """Expressions of every prescribed value and of its first two time derivatives, each of which gets a slot."""
        values: list[Any] = []

        def add(key: tuple[int, int, str], value: Any) -> None:
            self._slots[key] = self.first_input + len(values)
            values.append(value)

        for g, i, instance in self.model.instances():
            for name, value in instance.timed.items():
                for suffix, derivative in zip(("", "_dot", "_ddot"), timed.derivatives(se.sympify(value)), strict=True):
                    add((g, i, name + suffix), derivative)
        for k, line in enumerate(self.model.lines):
            for name, value in line.timed.items():
                add((-1, k, name), timed.sided(se.sympify(value)))
        return values

    def _collect_numbers(self) -> None:
        """Give every number of the laws and of the form a slot; the numbers of a law are consecutive."""
        self._numbers_at = [self._add(group.numbers.ravel().tolist()) for group in self.model.groups]
        self._slots |= {(-2, 0, name): self._add([number]) for name, number in self.form_numbers.items()}

    def _add(self, numbers: Iterable[float]) -> int:
        """Append constants to the workspace; returns the slot of the first."""
        first = self._first_constant + len(self._constants)
        self._constants.extend(numbers)
        return first

    def again(self, model: Model, constants: Sequence[float] = (), numbers: Mapping[str, float] | None = None) -> Numbering:
        """The same for another model of the same shape, without beams; arguments as of `Numbering`."""
        made = object.__new__(type(self))
        vars(made).update(vars(self), model=model, form_numbers=dict(numbers or {}))
        vars(made).pop("_scaling", None)
        made._constants = np.concatenate([model.listed, [*made.form_numbers.values()], constants])
        return made

    def workspace(self) -> Array:
        """A workspace (width,) with the constants filled in and 0 elsewhere."""
        return np.concatenate([np.zeros(self._first_constant), self._constants, [0.0]])

    def node_place(self, head: str, node: Node, component: int) -> int:
        """Slot of a component of a node. head: "q", "u", their rates "qp", "up"; for loaded nodes also "wq", "wu", the terms that
        laws add to their rows."""
        name = node.name
        if name not in self._loaded and not self._sharing.has(name):  # the usual case in large scenes
            q, u = self._place[name]
            return (q if head[0] == "q" else self.nq + u) + component + (self.n if head[-1] == "p" else 0)
        nq, nu = node.kind.sizes
        if node.name in self._loaded:
            parts = {"q": 0, "u": nq, "up": nq + nu, "wq": nq + 2 * nu, "wu": 2 * (nq + nu)}
            return self._loaded[node.name] + parts[head] + component
        if self.shares(node, component, head):
            n = node.kind.translations
            leader, at = (self._sharing.displacement_of, self._at) if component < n else (self._sharing.rotation_of, self._turned)
            if node.name in leader:
                return self.node_place(head, leader[node.name], component)
            return at[node.name] + (component if component < n else component - n) if head == "q" else self.width - 1
        (q, u), first = self._place[node.name], self._own(node, head)
        return (q if head[0] == "q" else self.nq + u) + component - first + (self.n if head.endswith("p") else 0)

    def shares(self, node: Node, component: int, head: str) -> bool:
        """Whether a component of the node's q or u (head "q" or "u") is that of another node or fixed, so that it is no unknown
        of this node."""
        return component < self._own(node, head)

    def _own(self, node: Node, head: str) -> int:
        """Number of the first components of q or u (head) that the node shares with another one: none, displacements, or all."""
        if node.name in self._sharing.turned:
            return node.kind.sizes[0 if head[0] == "q" else 1]
        return node.kind.translations if node.name in self._sharing.nodes else 0

    @cached_property
    def loaded_rows(self) -> NDArray[np.intp]:
        """Slots of the terms "wq" and "wu" of all loaded nodes."""
        return np.array([self.node_place(head, node, i) for node in self.model.nodes if node.name in self._loaded
                         for head, size in zip(("wq", "wu"), node.kind.sizes, strict=True) for i in range(size)],
                        dtype=np.intp)

    @cached_property
    def rate_slots(self) -> NDArray[np.intp]:
        """Slots of y', and of u' of all loaded nodes."""
        loaded = [self.node_place("up", node, i) for node in self.model.nodes if node.name in self._loaded
                  for i in range(node.kind.sizes[1])]
        return np.concatenate([np.arange(self.n, 2 * self.n), np.array(loaded, dtype=np.intp)])

    def node_of(self, target: Target, g: int, i: int) -> Node:
        """The node of a target (head such as "q", name of a frame, component) of instance i in group g."""
        group = self.model.groups[g]
        node = group.instances[i].nodes[group.side_numbers[target[1]]]
        assert node is not None
        return node

    def place(self, target: Target, g: int, i: int) -> int:
        """Slot of a target of instance i in group g: below n in y, below 2 n in y', then loaded nodes; -1 for the multiplier of a
        row that is not in force."""
        head = target[0]
        if head in ("q", "u", "qp", "up"):
            return self.node_place(head, self.node_of(target, g, i), target[2])
        if head in ("s", "sp"):
            return self.start["s"] + self._state[g, i, target[1]] + (self.n if head == "sp" else 0)
        if head == "foreign":
            return self.place_of_state(self.model.groups[g].instances[i].states[target[1]])
        row = self._row.get((g, i, target[1]))
        return -1 if row is None else self.start[head] + row + (self.n if self.derivatives else 0)

    def place_of_state(self, item: str) -> int:
        """Number among the unknowns of the internal state of an item, such as a controller, that other laws read."""
        return self.start["s"] + self._kept_state[item]

    def places(self, target: Target, g: int, active: Sequence[int] | None = None) -> NDArray[np.intp]:
        """(instances,) slots of a target of many instances of a group, by default all; see `place`."""
        key, group = (g, target), self.model.groups[g]
        if active is not None and len(active) < len(group.instances):
            return np.array([self.place(target, g, i) for i in active], dtype=np.intp)
        if key not in self._places:
            if target[0] in ("q", "u", "qp", "up"):
                head, side, component = target
                found = [self.node_place(head, node, component) for node in group.side(side)]
            else:
                found = [self.place(target, g, i) for i in range(len(group.instances))]
            self._places[key] = np.array(found, dtype=np.intp)
        return self._places[key]

    def velocities(self, target: Target, g: int) -> NDArray[np.intp]:
        """(instances,) numbers among the velocity unknowns of the velocity of a target (any head, name of a frame, component)."""
        return self.places(("u", *target[1:3]), g) - self.nq

    def row_numbers(self, g: int, r: int) -> NDArray[np.intp]:
        """(instances,) numbers, among the rows in force, of row r of the laws of group g; -1 where it is not in force."""
        return np.array([self._row.get((g, i, r), -1) for i in range(len(self.model.groups[g].instances))], dtype=np.intp)

    def velocity(self, target: Target, g: int, i: int) -> int:
        """Number among the velocity unknowns of the velocity of a target of instance i in group g; see `velocities`."""
        return self.place(("u", *target[1:]), g, i) - self.nq

    def slot(self, g: int, i: int, name: str) -> int:
        """Slot of a parameter of instance i in group g, or of the rate of a prescribed one; g = -1: a load on beam number i."""
        at = self.model.groups[g].names_of_numbers if g >= 0 else {}
        return self._numbers_at[g] + i * len(at) + at[name] if name in at else self._slots[g, i, name]

    def row(self, g: int, i: int, r: int) -> int | None:
        """Number among the rows in force of row r of instance i in group g; None where it is not in force."""
        return self._row.get((g, i, r))

    def gather(self, g: int, inputs: Inputs, active: Sequence[int] | None = None) -> NDArray[np.intp]:
        """(instances, inputs) slots that a kernel of group g reads; active: numbers of the instances, by default all."""
        chosen = tuple(active) if active is not None else tuple(range(len(self.model.groups[g].instances)))
        key = (g, inputs.symbols, chosen)
        if key not in self._gathers:
            self._gathers[key] = self._gathered(g, inputs, chosen)
        return self._gathers[key]

    def _gathered(self, g: int, inputs: Inputs, chosen: tuple[int, ...]) -> NDArray[np.intp]:
        at = np.array(chosen, dtype=np.intp)
        columns = [self.places(target, g, chosen) % self.width for target in inputs.unknowns]  # -1: the last slot, which is 0
        for name in inputs.parameters:
            if name in self.form_numbers:
                columns.append(np.full(len(at), self._slots[-2, 0, name]))
            elif name in self.model.groups[g].names_of_numbers:
                columns.append(self.slot(g, 0, name) + at * len(self.model.groups[g].names_of_numbers))
            else:
                columns.append(np.array([self._slots[g, i, name] for i in chosen], dtype=np.intp))
        return np.stack(columns, axis=1) if columns else np.empty((len(at), 0), dtype=np.intp)

    def numbers(self, g: int, inputs: Inputs) -> Array:
        """(instances, parameters) values of the parameters among `inputs`, which have to be constant."""
        group, known = self.model.groups[g], self.form_numbers
        columns = [group.numbers[:, group.names_of_numbers[name]] if name in group.names_of_numbers
                   else np.full(len(group.instances), known[name]) for name in inputs.parameters]
        return np.stack(columns, axis=1) if columns else np.empty((len(group.instances), 0))

    def constants(self, g: int, p: Any) -> Array:
        """(instances, outputs) the constant outputs of a `LinearisedPlan` of group g; models that share the group share them."""
        known = [self.form_numbers.get(name) for name in p.constant_inputs.parameters]
        kept = self.model.groups[g].constants
        if id(p) not in kept or kept[id(p)][1] != known:
            kept[id(p)] = p, known, p.constants.once(self.numbers(g, p.constant_inputs))
        return kept[id(p)][2]  # type: ignore[no-any-return]

    def scaling(self) -> Array:
        """(m,) scaling factor of every constraint row (`symbolic.law.AUGMENTED`), 1 where its joint has none."""
        return self._scaling

    @cached_property
    def _scaling(self) -> Array:
        return np.array([self.model.groups[r.group].instances[r.instance].numbers.get("scaling", 1.0) for r in self.rows])

    def rows_among(self, rows: list[Row]) -> NDArray[np.intp]:
        """(m,) for every row in force: its position in the list `rows`."""
        if rows == self.rows:
            return np.arange(self.m)
        at = {(r.group, r.instance, r.row): n for n, r in enumerate(rows)}
        return np.array([at[r.group, r.instance, r.row] for r in self.rows], dtype=np.intp)

    @cached_property
    def of_positions(self) -> NDArray[np.intp]:
        """(nq,) of every position unknown its number among the positions q of all nodes, some of which are no unknowns."""
        return np.concatenate([np.arange(n.q + self._own(n, "q"), n.q + n.kind.sizes[0]) for n in self.free]).astype(np.intp)

    @cached_property
    def of_velocities(self) -> NDArray[np.intp]:
        """(nu,) of every velocity unknown its number among the velocities u of all nodes, some of which are no unknowns."""
        return np.concatenate([np.arange(n.u + self._own(n, "u"), n.u + n.kind.sizes[1]) for n in self.free]).astype(np.intp)

    def names(self) -> tuple[str, ...]:
        """Name of every unknown."""
        names = ["?"] * self.n
        for node in self.free:
            for head, entries in zip("qu", _names(node), strict=True):
                for i, name in enumerate(entries):
                    if not self.shares(node, i, head):
                        names[self.node_place(head, node, i)] = name
        names[self.start["z"] : self.start["z"] + len(self.stresses)] = self.stresses
        for key, position in self._state.items():
            names[self.start["s"] + position] = self.states[key]
        for block in ("lambda", "mu"):
            for i, row in enumerate(self.rows):
                if self.start[block] + i < self.n:
                    names[self.start[block] + i] = f"{block}({row.name})"
        return tuple(names)
