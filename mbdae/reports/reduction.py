"""The map from the velocities of body k and of a joint's coordinates to those of body l, from the motion that the joint states.

Everything is derived from the chain of elementary motions: the columns of the map, the accelerations it leaves where those of the
unknowns are zero, its change in a virtual displacement.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.analysis.frame import skew
from mbdae.reports.common import LawFormulas
from mbdae.reports.coordinates import motion_in
from mbdae.reports.evaluate import Numbers
from mbdae.reports.letters import Letter
from mbdae.reports.statement import Statement
from mbdae.reports.states import State
from mbdae.reports.vectors import Base, Vector
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Structure
from mbdae.symbolic.motion import turned
from mbdae.symbolic.vectors import Expr


@dataclass
class Column:
    """Rotation and displacement of l per unit of the rate of a coordinate, or of a component of the rate of a free rotation."""

    name: str
    rate: Expr  #: symbol of that rate
    change: Expr  #: symbol of its virtual change
    turn: Vector
    move: Vector

    @property
    def vectors(self) -> tuple[Vector, Vector]:
        """Displacement and rotation."""
        return self.move, self.turn


class Reduction:
    """The map B of a joint, in recorded vectors of its two bodies."""

    def __init__(self, law: type[Joint], structure: Structure) -> None:
        plain = {"kept": True, "friction": None, "rubs": None}
        options = tuple((name, plain.get(name, value)) for name, value in structure.options)
        self.s = Statement(law, replace(structure, options=options))
        self.formulas = LawFormulas(self.s, rows=False)
        motion = motion_in(self.s)
        assert motion is not None
        self.motion = motion
        self._letter_rotations()
        atom = self.s.record.atom
        self.way, columns = self._walk()
        self.d = (atom("s", "k") + self.way - atom("s", "l")).named("d")  #: from the centre of k to that of l
        self.columns = [self._at_centre(c, i if len(columns) > 1 else None) for i, c in enumerate(columns)]
        self.formulas.refresh()

    def _letter_rotations(self) -> None:
        for name, side in self.s.turning.items():
            for i in "123":
                rate = Letter(f"\\Omega_{i}", "rad/s", f"angular velocity of {name} along its axis {i}")
                change = Letter(f"\\delta\\psi_{i}", "rad", f"virtual rotation of {name} about its axis {i}")
                self.formulas.known |= {f"{side}_W{i}": rate, f"d{side}_W{i}": change}

    def _walk(self) -> tuple[Vector, list[tuple[str, Expr, Expr, Vector, Vector]]]:
        """The way from the point of k to that of l; per rate its name, symbols, rotation, and displacement of the point of l."""
        s, record = self.s, self.s.record
        (k, l), places = s.frames, {tuple(s.values[name].P): (name, side) for name, side in s.turning.items()}
        axes: Any = (k.x, k.y, k.z)
        way, turns, slides = record.zero(), list[Any](), list[Any]()
        symbols = [(name, s.clock[c], s.virtual[c], c) for name, c in s.coordinates.items()]
        last = max((i for i, step in enumerate(self.motion.steps) if step.turns), default=None)
        for i, step in enumerate(self.motion.steps):
            if step.rotation is not None:
                after = (l.x, l.y, l.z) if i == last else turned(axes, step)
                own = [-a for a in axes] if step.rotation.inverse else after
                name, side = places[tuple(step.rotation.P)]
                rates = [(se.Symbol(f"{side}_W{j + 1}"), se.Symbol(f"d{side}_W{j + 1}")) for j in range(3)]
                turns += [(name, *rates[j], record.lift(own[j]), way) for j in range(3)]
                axes = after
                continue
            e = record.lift(step.direction(axes))
            slopes = [(name, rate, change, e * p) for name, rate, change, c in symbols if (p := se.diff(step.amount, c)) != 0]
            if step.turns:
                turns += [(*slope, way) for slope in slopes]
                axes = turned(axes, step)
            else:
                slides += slopes
                way = way + e * step.amount
        columns: dict[Expr, Any] = {}
        order = list(s.places)
        turns, slides = (sorted(found, key=lambda slope: order.index(slope[0])) for found in (turns, slides))
        for name, rate, change, turn, before in turns:
            add(columns, (name, rate, change), turn, turn.cross(way - before))
        for name, rate, change, move in slides:
            add(columns, (name, rate, change), record.zero(), move)
        return way, sorted(columns.values(), key=lambda column: order.index(column[0]))

    def _at_centre(self, column: Any, i: int | None) -> Column:
        """A column with the displacement of the centre of l, its vectors under names."""
        name, rate, change, turn, move = column
        below = "" if i is None else f"_{{{i + 1}}}"
        turn = turn.named(rf"\mathbf{{b}}{below}")
        return Column(name, rate, change, turn, (move - turn.cross(self.s.record.atom("s", "l"))).named(rf"\mathbf{{t}}{below}"))

    @cached_property
    def bias(self) -> tuple[Vector, Vector]:
        """Acceleration of the centre of l and angular acceleration of l where the accelerations of the unknowns are zero."""
        rate, total = self.s.motion(), [self.s.record.zero()] * 2
        for c in self.columns:
            total = [old + rate.vector(a) * c.rate for old, a in zip(total, c.vectors, strict=True)]
        return self.s.record.atom("w", "k").cross(rate.vector(self.d)) + total[0], total[1]

    @cached_property
    def changes(self) -> tuple[Vector, list[tuple[Vector, Vector]]]:
        """Changes of d, and of displacement and rotation of every column, in a virtual displacement."""
        rule = self.s.variation()
        return rule.vector(self.d), [(rule.vector(c.move), rule.vector(c.turn)) for c in self.columns]

    def at(self, state: State, known: Mapping[Base, Any] | None = None) -> ReductionValues:
        """Its values at many states; known: values of frame vectors in place of those of the states."""
        return ReductionValues(self, state, Numbers(self.s.record, state.atom, state.symbol, known))


def add(columns: dict[Expr, Any], key: tuple[str, Expr, Expr], turn: Vector, move: Vector) -> None:
    """Add rotation and displacement to the column of a rate."""
    old = columns.get(key[1], (*key, turn.record.zero(), turn.record.zero()))
    columns[key[1]] = (*key, old[3] + turn, old[4] + move)


class ReductionValues:
    """Values of a map at many states."""

    def __init__(self, of: Reduction, state: State, numbers: Numbers) -> None:
        self.of, self.state, self.numbers = of, state, numbers

    def vector(self, a: Vector) -> Any:
        """Components (points, 3)."""
        return np.broadcast_to(self.numbers.vector(a), (self.state.points, 3))

    def assembled(self, d: Any, columns: list[tuple[Any, Any]], unit: float = 1.0) -> Any:
        """(points, 6, 6 + columns): the displayed matrix; its change for unit = 0."""
        kind = np.result_type(d, float, *(c for pair in columns for c in pair))
        B = np.zeros((self.state.points, 6, 6 + len(columns)), dtype=kind)
        B[:, range(6), range(6)] = unit
        B[:, :3, 3:6] = np.array([-skew(v) for v in d])
        for i, (move, turn) in enumerate(columns):
            B[:, :3, 6 + i], B[:, 3:, 6 + i] = move, turn
        return B

    @property
    def B(self) -> Any:
        """The map."""
        return self.assembled(self.vector(self.of.d), [(self.vector(c.move), self.vector(c.turn)) for c in self.of.columns])

    @property
    def bias(self) -> Any:
        """(points, 6)."""
        return np.concatenate([self.vector(a) for a in self.of.bias], axis=1)

    @property
    def changes(self) -> Any:
        """Change of the map (points, 6, 6 + columns)."""
        d, columns = self.of.changes
        return self.assembled(self.vector(d), [(self.vector(move), self.vector(turn)) for move, turn in columns], unit=0.0)
