"""Numbering of unknowns and of everything a kernel reads: y, y', prescribed values, parameters, a zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.kernels import Kernel
from mbdae.kernels.plan import Inputs
from mbdae.scene import timed
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.outputs import Target
from mbdae.system.base import Array
from mbdae.system.model import Model

COORDINATES = {
    NodeKind.SPATIAL: (("x", "y", "z", "P0", "P1", "P2", "P3"), ("vx", "vy", "vz", "Omega_x", "Omega_y", "Omega_z")),
    NodeKind.PLANAR: (("x", "y", "theta"), ("vx", "vy", "omega")),
    NodeKind.POINT: (("x", "y", "z"), ("vx", "vy", "vz")),
    NodeKind.PLANAR_POINT: (("x", "y"), ("vx", "vy")),
    NodeKind.COORDINATE: (("angle",), ("rate",)),
}
_SIDES = {"b": 0, "k": 0, "l": 1, "c": 2}  #: place of a frame's node in an instance


@dataclass(frozen=True)
class Row:
    """A constraint row: group and instance numbers, row number in the law, name "joint.row"."""

    group: int
    instance: int
    row: int
    name: str


def constraint_rows(model: Model) -> list[Row]:
    """All constraint rows of a model, in the order of the scene's items."""
    rows = [
        Row(g, i, r, f"{instance.item}.{name}")
        for g, group in enumerate(model.groups) if group.derived.rows
        for i, instance in enumerate(group.instances)
        for r, name in enumerate(group.derived.rows)
    ]  # fmt: skip
    order = {c.name: n for n, c in enumerate(model.scene.connections)}
    return sorted(rows, key=lambda row: order[model.groups[row.group].instances[row.instance].item])


class Numbering:
    """y = (q, u, s, lambda, mu); blocks a form does not have are empty. Dropped rows read a zero and write nowhere."""

    def __init__(self, model: Model, rows: list[Row], blocks: tuple[str, ...] = ("lambda", "mu"),
                 derivatives: bool = False) -> None:  # fmt: skip
        self.model, self.rows, self.derivatives = model, rows, derivatives
        self.nq, self.nu, self.m = model.nq, model.nu, len(rows)
        self.states = {
            (g, i, j): f"{instance.item}.{name}"
            for g, group in enumerate(model.groups)
            for i, instance in enumerate(group.instances)
            for j, name in enumerate(group.derived.states)
        }
        self._state = {key: n for n, key in enumerate(self.states)}
        self._row = {(r.group, r.instance, r.row): n for n, r in enumerate(rows)}
        self.start = {"q": 0, "u": self.nq, "s": self.nq + self.nu}
        n = self.nq + self.nu + len(self.states)
        for block in ("lambda", "mu"):
            self.start[block] = n
            n += self.m if block in blocks else 0
        self.n = n
        self._clock_values: list[Any] = []
        self._constants: list[float] = []
        self._gathers: dict[Any, NDArray[np.intp]] = {}
        self._slots: dict[tuple[int, int, str], int] = {}
        self._collect()
        self.clock = Kernel([timed.TIME], self._clock_values)
        self.width = 2 * n + len(self._clock_values) + len(self._constants) + 1

    def _collect(self) -> None:
        """Give every number and every prescribed value a slot."""
        for g, group in enumerate(self.model.groups):
            for i, instance in enumerate(group.instances):
                for name, value in instance.timed.items():
                    for suffix, derivative in zip(("", "_dot", "_ddot"), timed.derivatives(se.sympify(value)), strict=True):
                        self._slots[g, i, name + suffix] = 2 * self.n + len(self._clock_values)
                        self._clock_values.append(derivative)
        for g, group in enumerate(self.model.groups):
            for i, instance in enumerate(group.instances):
                for name, number in instance.numbers.items():
                    self._slots[g, i, name] = 2 * self.n + len(self._clock_values) + len(self._constants)
                    self._constants.append(number)

    def workspace(self, count: int) -> Array:
        """(count, width) rows [y, y', prescribed values, parameters, 0] with the constants filled in."""
        W = np.zeros((count, self.width))
        first = 2 * self.n + len(self._clock_values)
        W[:, first : first + len(self._constants)] = self._constants
        return W

    def fill_clock(self, W: Array, t: Array) -> None:
        """Prescribed values at times t (count,)."""
        if self._clock_values:
            W[:, 2 * self.n : 2 * self.n + len(self._clock_values)] = self.clock.values(np.reshape(t, (-1, 1)))

    def unknown(self, target: Target, g: int, i: int) -> tuple[int, bool]:
        """(index in y, whether it is read from y') of a target of instance i in group g; index -1 if dropped."""
        head, instance = target[0], self.model.groups[g].instances[i]
        if head in ("q", "u", "qp", "up"):
            node = instance.nodes[_SIDES[target[1]]]
            assert node is not None
            base = node.q if head[0] == "q" else self.nq + node.u
            return base + target[2], head.endswith("p")
        if head in ("s", "sp"):
            return self.start["s"] + self._state[g, i, target[1]], head == "sp"
        row = self._row.get((g, i, target[1]))
        return (-1, False) if row is None else (self.start[head] + row, self.derivatives)

    def row(self, g: int, i: int, r: int) -> int | None:
        """Number of a constraint row, None where it is dropped."""
        return self._row.get((g, i, r))

    def gather(self, g: int, inputs: Inputs) -> NDArray[np.intp]:
        """(instances, inputs) positions in the workspace."""
        key = (g, inputs.symbols)
        if key not in self._gathers:
            self._gathers[key] = self._gathered(g, inputs)
        return self._gathers[key]

    def _gathered(self, g: int, inputs: Inputs) -> NDArray[np.intp]:
        group = self.model.groups[g]
        table = np.empty((len(group.instances), len(inputs.symbols)), dtype=np.intp)
        for i in range(len(group.instances)):
            for j, target in enumerate(inputs.unknowns):
                index, dotted = self.unknown(target, g, i)
                table[i, j] = self.width - 1 if index < 0 else index + (self.n if dotted else 0)
            for j, name in enumerate(inputs.parameters, start=len(inputs.unknowns)):
                table[i, j] = self._slots[g, i, name]
        return table

    def numbers(self, g: int, inputs: Inputs) -> Array:
        """(instances, parameters) values of constant parameters."""
        instances = self.model.groups[g].instances
        values = np.array([[instance.numbers[name] for name in inputs.parameters] for instance in instances])
        return values.reshape(len(instances), len(inputs.parameters))

    def scaling(self) -> Array:
        """(m,) scaling of every constraint row (paper Eq. 2), 1 where its joint has none."""
        return np.array([self.model.groups[r.group].instances[r.instance].numbers.get("scaling", 1.0) for r in self.rows])

    def names(self) -> tuple[str, ...]:
        """Name of every unknown."""
        names = ["?"] * self.n
        for node in self.model.nodes:
            qs, us = COORDINATES[node.kind]
            for i, c in enumerate(qs):
                names[node.q + i] = f"{node.name}.{c}"
            for i, c in enumerate(us):
                names[self.nq + node.u + i] = f"{node.name}.{c}"
        for key, position in self._state.items():
            names[self.start["s"] + position] = self.states[key]
        for block in ("lambda", "mu"):
            for i, row in enumerate(self.rows):
                if self.start[block] + i < self.n:
                    names[self.start[block] + i] = f"{block}({row.name})"
        return tuple(names)
