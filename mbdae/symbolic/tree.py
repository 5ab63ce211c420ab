"""Trees of recursive joints: the motion of every body as a function of joint coordinates, by one program.

A body is carried where its position follows from another body and the coordinates of a joint, by the motion that the joint
states (`symbolic/motion.py`): elementary motions one after the other, none for a weld. The program goes from the root outwards
(positions, velocities, accelerations) and evaluates the laws between the bodies. `symbolic/links.py` cuts it at the bodies:
forces go from the leaves to the root in the passes there, whose derivative contains the geometric stiffness (Eqs. 24-33 of
validation/paper).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from typing import Any

import symengine as se

from mbdae.process import made_once
from mbdae.symbolic.derived import Derived
from mbdae.symbolic.frames import Axes, Frame, NodeKind, axes_pattern
from mbdae.symbolic.motion import Motion, Rotation, Step, half_turn, motion_of, refuse_amounts
from mbdae.symbolic.outputs import Target, dynamics
from mbdae.symbolic.program import Program
from mbdae.symbolic.rebuild import substituted
from mbdae.symbolic.stated import changed, motion_key
from mbdae.symbolic.tree_motion import Coordinate, Link, LinkWay, Member, Moved, NodeMotion, Numbers, TreeStructure, moved, way
from mbdae.symbolic.vectors import (
    UNIT,
    ZERO,
    Expr,
    Vec,
    product,
    rotation_columns,
    rotation_per_component,
)

Wrench = tuple[Vec, Vec]  #: force and torque about the node, inertial components, left-hand side


class TreeProgram:
    """The program of a tree. Nodes: 0 the root, j the one carried by link j; -c is coordinate c of the tree.

    inputs: symbol -> its place: ("q" | "u" | "up", node, i), ("clock", c, 0 | 1 | 2) a prescribed coordinate and its
    rates, ("number", owner, name), ("timed", owner, name) parameters, ("wu" | "wq", j, i) terms of laws
    outside of the tree in the equations of motion ("wu") and in the kinematic equations ("wq") of node j.
    """

    def __init__(self, structure: TreeStructure) -> None:
        self.structure, self.program = structure, self._program()
        self.inputs: dict[Expr, tuple[Any, ...]] = {}
        self.nodes = [self._root(structure.root)]
        self._ways: list[LinkWay] = []
        for j, link in enumerate(structure.links, start=1):
            self.nodes.append(self._carried(j, link))
        self.wrenches = self._members()

    @staticmethod
    def _program() -> Program:
        return Program()

    def _input(self, *place: Any) -> Expr:
        symbol = se.Symbol("_".join(map(str, place)).replace("-", "c"))
        self.inputs[symbol] = place
        return symbol

    def _number(self, owner: str, name: str, numbers: Numbers) -> Expr:
        value = dict(numbers)[name]
        return self._input("number", owner, name) if value is None else se.Integer(value)

    # -- outwards

    def _root(self, kind: NodeKind) -> NodeMotion:
        if not kind.moves:
            return NodeMotion(kind, ZERO, UNIT, se.Integer(0), ZERO, ZERO, ZERO, ZERO, [se.Integer(i == 0) for i in range(4)])
        (nq, nu), let = kind.sizes, self.program.let
        q, u, up = ([self._input(what, 0, i) for i in range(n)] for what, n in (("q", nq), ("u", nu), ("up", nu)))
        if kind is NodeKind.PLANAR:
            bx = Vec(let(se.cos(q[2])), let(se.sin(q[2])), 0)
            R = (bx, UNIT[2].cross(bx), UNIT[2])
            moves = [Vec(part[0], part[1], 0) for part in (q, u, up)]
            return NodeMotion(kind, moves[0], R, q[2], moves[1], Vec(0, 0, u[2]), moves[2], Vec(0, 0, up[2]))
        bx, by, bz = map(self.program.vec, rotation_columns(q[3:]))
        state = NodeMotion(kind, Vec(*q[:3]), (bx, by, bz), se.Integer(0), Vec(*u[:3]), ZERO, Vec(*up[:3]), ZERO, q[3:])
        state.w, state.al = (self.program.vec(state.of_body([part[3:]])[0]) for part in (u, up))
        return state

    def _frame(self, j: int, link: Link, side: str, node: NodeMotion, axes: Axes) -> tuple[Vec, tuple[Vec, ...]]:
        """Offset of the joint's point from a node and the joint's axes, inertial."""
        offset, columns = self._in_body(j, link, side, axes)
        return self.program.vec(node.of_body([offset])[0]), tuple(map(self.program.vec, node.of_body(columns)))

    def _in_body(self, j: int, link: Link, side: str, axes: Axes) -> tuple[list[Expr], list[list[Expr]]]:
        numbers = {name: self._number(f"link{j}", name, link.numbers) for name, _ in link.numbers if name.startswith(f"{side}_")}
        offset = [numbers[f"{side}_p{i}"] for i in (1, 2, 3)]
        return offset, axes_pattern(axes, [[numbers[f"{side}_Q{a}{i}"] for i in (1, 2, 3)] for a in "xyz"])[0]

    def _motion(self, j: int, link: Link) -> list[Moved]:
        """The elementary motions from the parent to the node carried, with their rates."""
        values: dict[str, Any] = {}
        scalars: list[Coordinate] = []
        rotations: dict[Any, Moved] = {}
        for c, name, driven in zip(count(link.first), link.coordinates, link.prescribed, strict=False):
            if link.law.coordinates[name].unit == "rotation":
                values[name], found = self._rotation(c)
                rotations[values[name].P] = found
            else:
                places = [("clock", c, i) if driven else (what, -c, 0) for i, what in enumerate(("q", "u", "up"))]
                value, rate, second = (self._input(*place) for place in places)
                scalars.append(Coordinate(value, rate, second, None if driven else c))
                values[name] = scalars[-1].value
        if motion_key(link.law, link.structure) is not link.motion:
            raise changed(link.law)
        law: Any = link.law.symbolic(link.structure)
        refuse_amounts(law)
        motion = motion_of(law, values) if link.moves else Motion()
        assert motion is not None
        stated = [name for name, _ in link.numbers if name in law.params]
        motion = motion.substituted({se.Symbol(name): self._number(f"link{j}", name, link.numbers) for name in stated})
        steps = (motion if link.side == "k" else motion.inverse()).steps
        return [replace(rotations[s.rotation.P], step=s) if s.rotation else moved(s, scalars, self.program) for s in steps]

    def _rotation(self, c: int) -> tuple[Rotation, Moved]:
        """The free rotation that is coordinate c, with its rates."""
        P, spin, change = ([self._input(what, -c, i) for i in range(n)] for what, n in (("q", 4), ("u", 3), ("up", 3)))
        x, y, z = map(self.program.vec, rotation_columns(P))
        rotation = Rotation(tuple(P), (x, y, z), Vec(*spin))
        return rotation, Moved(Step(True, ZERO, se.Integer(0), rotation), number=c, spin=Vec(*spin), change=Vec(*change))

    def _carried(self, j: int, link: Link) -> NodeMotion:
        """Motion of the node that a joint carries, from that of its parent by relative kinematics."""
        vec, k = self.program.vec, self.nodes[link.parent]
        other = "l" if link.side == "k" else "k"
        s, axes = self._frame(j, link, link.side, k, link.axes[0])
        found = way(self.program, k, s, axes, self._motion(j, link), link.kind.turns)  # type: ignore[arg-type]
        self._ways.append(found)
        v, a = vec(k.v + found.v), vec(k.a + found.a)
        child = NodeMotion(link.kind, ZERO, UNIT, se.Integer(0), ZERO, ZERO, ZERO, ZERO)
        if not link.kind.turns:
            child.r, child.v, child.a = vec(k.r + found.total), v, a
            return child
        w, al = self._spins(found)
        child.w, child.al = w, al
        self._orient(child, k, (j, link, other), found)
        found.back = t = self._arm(j, link, other, child)
        wt = vec(w.cross(t))
        child.r, child.v, child.a = vec(k.r + found.total - t), vec(v - wt), vec(a - al.cross(t) - w.cross(wt))
        return child

    def _spins(self, found: LinkWay) -> tuple[Vec, Vec]:
        """Angular velocity of the node carried and its rate."""
        return found.w, found.al

    def _arm(self, j: int, link: Link, side: str, node: NodeMotion) -> Vec:
        """Vector from a node to the point of joint j on it, inertial components."""
        offset, _ = self._in_body(j, link, side, link.axes[side != link.side])
        return self.program.vec(node.of_body([offset])[0])

    def _orient(self, child: NodeMotion, k: NodeMotion, place: tuple[int, Link, str], found: LinkWay) -> None:
        """Rotation of the node carried: the joint's axes at the end of its motion, times Q^T."""
        (j, link, other), let, vec = place, self.program.let, self.program.vec
        if child.kind is NodeKind.PLANAR:
            drawn = [self._number(f"link{j}", f"{side}_theta0", link.numbers) for side in (other, link.side)]
            angle = sum((p.moved.step.amount * p.direction[2] for p in found.parts if p.moved.step.turns), se.Integer(0))
            child.heading = let(k.heading + angle + drawn[0] - drawn[1])
            bx = Vec(let(se.cos(child.heading)), let(se.sin(child.heading)), 0)
            child.R = (bx, UNIT[2].cross(bx), UNIT[2])
            return
        _, Q = self._in_body(j, link, other, link.axes[1])
        x, y, z = found.axes
        child.R = tuple(vec(x * Q[0][i] + y * Q[1][i] + z * Q[2][i]) for i in range(3))  # type: ignore[assignment]
        P = product(k.P, [self._number(f"link{j}", f"{link.side}_P{i}", link.numbers) for i in range(4)])
        for part in found.parts:
            P = product(P, half_turn(part.moved.step)) if part.moved.step.turns else P
        from_joint = [self._number(f"link{j}", f"{other}_P{i}", link.numbers) for i in range(4)]
        child.P = list(map(let, product(P, [from_joint[0], *(-x for x in from_joint[1:])])))

    # -- laws of the tree

    def _members(self) -> dict[int, Wrench]:
        """Forces of the laws of the program on every node."""
        total: dict[int, Wrench] = {}
        for m, member in enumerate(self.structure.members):
            d = member.law
            table = self._meaning(m, member, d)
            for name, value in d.variation.values.items():
                table[name] = self.program.let(substituted(d.variation.resolve(value), table))
            for f, node in zip(d.frames, member.nodes, strict=True):
                rows = {t[2]: substituted(d.variation.resolve(e), table) for t, e in dynamics(d) if t[1] == f.side}
                if node is not None and rows:
                    a = total.get(node)
                    b = self._wrench(node, rows)
                    total[node] = b if a is None else (a[0] + b[0], a[1] + b[1])
        return total

    def _meaning(self, m: int, member: Member, d: Derived) -> dict[Expr, Expr]:
        """Symbols of a law with their expressions in the program."""
        known = {name: self._number(f"member{m}", name, member.numbers) for name, _ in member.numbers}
        table: dict[Expr, Expr] = {se.Symbol(name): value for name, value in known.items()}
        for symbol in {*d.variation.clock, *d.variation.clock.values()}:
            table[symbol] = self._input("timed", f"member{m}", str(symbol))
        for f, node in zip(d.frames, member.nodes, strict=True):
            if node is None:
                table |= {symbol: substituted(value, table) for symbol, value in f.meaning.items()}
            else:
                table |= self._frame_meaning(f, self.nodes[node], known)
        return table

    def _frame_meaning(self, f: Frame, node: NodeMotion, known: dict[str, Expr]) -> dict[Expr, Expr]:
        table: dict[Expr, Expr] = {}

        def bind(symbols: Vec, value: Vec) -> None:
            table.update((s, v) for s, v in zip(symbols, value, strict=True) if isinstance(s, se.Symbol))

        bind(f.center, node.r)
        bind(f.center_velocity, node.v)
        for i in range(f.kind.translations):
            table[se.Symbol(f"{f.side}_up{i + 1}")] = node.a[i]
        if not f.kind.turns:
            return table
        vec = self.program.vec
        for column, value in zip(f.body, node.R, strict=True):
            bind(column, value)
        spin, rate = (node.w, node.al) if f.kind.flat else (vec(node.to_body(node.w)), vec(node.to_body(node.al)))
        bind(f.w, node.w)
        bind(f.spin, spin)
        for i in range(f.kind.translations, f.kind.sizes[1]):
            table[se.Symbol(f"{f.side}_up{i + 1}")] = rate[2] if f.kind.flat else rate[i - 3]
        if f"{f.side}_p1" in known:
            offset = [known[f"{f.side}_p{i}"] for i in (1, 2, 3)]
            columns = axes_pattern(f.axes, [[known[f"{f.side}_Q{a}{i}"] for i in (1, 2, 3)] for a in "xyz"])[0]
            bind(f.arm, vec(node.of_body([offset])[0]))
            for axis, value in zip((f.x, f.y, f.z), node.of_body(columns), strict=True):
                bind(axis, vec(value))
            if isinstance(f.heading, se.Symbol):
                table[f.heading] = node.heading - known.get(f"{f.side}_theta0", se.Integer(0))
        return table

    def _wrench(self, node: int, rows: dict[int, Expr]) -> Wrench:
        """Dynamics rows of a node as force and inertial torque."""
        state, zero = self.nodes[node], se.Integer(0)
        n = state.kind.translations
        force = Vec(*[rows.get(i, zero) for i in range(n)], *[0] * (3 - n))
        turning = [rows.get(i, zero) for i in range(n, state.kind.sizes[1])]
        if not turning:
            return force, ZERO
        return force, Vec(0, 0, turning[0]) if state.kind.flat else state.of_body([turning])[0]

    def _load(self, role: str, j: int) -> Wrench:
        """Force and moment on node j from the inputs that hold the terms of laws outside of the tree, of role "wu" or "wq"."""
        state = self.nodes[j]
        rows = [self._input(role, j, i) for i in range(state.kind.sizes[1 if role == "wu" else 0])]
        if role == "wu" or state.kind is not NodeKind.SPATIAL:
            return self._wrench(j, dict(enumerate(rows)))
        T = rotation_per_component(state.P)
        return Vec(*rows[:3]), Vec(*(sum((t * x for t, x in zip(line, rows[3:], strict=True)), se.Integer(0)) for line in T))

    # -- outputs

    def states(self, nodes: tuple[int, ...], accelerations: bool = True) -> list[tuple[Target, Expr]]:
        """q, u and (on request) u' of some nodes."""
        out: list[tuple[Target, Expr]] = []
        for j in nodes:
            s, n = self.nodes[j], self.nodes[j].kind.translations
            turned = {NodeKind.SPATIAL: s.P, NodeKind.PLANAR: [s.heading]}.get(s.kind, [])
            out += [(("q", j, i), e) for i, e in enumerate([*list(s.r)[:n], *turned])]
            for name, move, turn in (("u", s.v, s.w), ("up", s.a, s.al))[: 2 if accelerations else 1]:
                spin = [] if not s.kind.turns else [turn[2]] if s.kind.flat else list(s.to_body(turn))
                out += [((name, j, i), self.program.let(e)) for i, e in enumerate([*list(move)[:n], *spin])]
        return out


@made_once("derive", 64)
def tree_program(structure: TreeStructure) -> TreeProgram:
    """The program of a tree; made once per process and structure."""
    return TreeProgram(structure)
