"""Values required of the equations of a recursive joint, from its compiled recursion at states that satisfy the joint, and its
formulas: the recursion of a tree executed with vectors instead of components.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block
from mbdae.kernels.plan import plan
from mbdae.kernels.tree_plan import Piece, tree_plan
from mbdae.reports.law_page import LawPage
from mbdae.reports.letters import INERTIA, Letter, second_rate_of
from mbdae.reports.page import Check
from mbdae.reports.statement import ReportedLaw
from mbdae.reports.states import POINTS, STEP, SymbolValues, random_state, residual
from mbdae.reports.vectors import Base, NamedQuantities
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Structure
from mbdae.symbolic.motion import Step
from mbdae.symbolic.outputs import acceleration, jacobian_G, position, program_fingerprint, velocity
from mbdae.symbolic.program import Program
from mbdae.symbolic.tree import TreeProgram, Wrench
from mbdae.symbolic.tree_motion import Link, LinkWay, Moved, NodeMotion, TreeStructure
from mbdae.symbolic.vectors import UNIT, ZERO, Expr, Vec

TREE, ORACLE = "the compiled program of a tree", "a complex step along a motion through the program of a tree"
MATRIX = Letter(r"\mathbf{M}", INERTIA, "derivatives of $\\mathbf{F}_l, \\mathbf{M}_l$ by the accelerations of l: of a rigid body"
                " its mass and inertia")


class RecursiveValues(LawPage):
    """One joint as a tree of two bodies, and the values required of its equations at states that satisfy the joint."""

    def __init__(self, law: type[Joint], structure: Structure, others: frozenset[str] = frozenset()) -> None:
        plain = {"kept": True, "friction": None, "rubs": None}
        options = tuple((name, plain.get(name, value)) for name, value in structure.options)
        s = ReportedLaw(law, replace(structure, options=options, timed=frozenset()))
        super().__init__(s, rows=False, others=others, state=random_state(s.derived, seed=4))
        link = link_of(law, s.structure, s.law.derived())
        self.tree, self.plan = VectorTree(s, link), tree_plan(tree_of(link))
        self.further: dict[str, Any] = {}  #: values of symbols that single sections use
        self._letters()
        self._on_motion()

    def _letters(self) -> None:
        known = self.known
        for name, symbol in self.s.coordinates.items():
            known[str(self.tree.second(name))] = second_rate_of(known[str(symbol)])
        for name, side in self.s.turning.items():
            for i in "123":
                known |= {
                    f"{side}_W{i}": Letter(rf"\Omega_{i}", "rad/s", f"angular velocity of {name} along its axis {i}"),
                    f"{side}_Wp{i}": Letter(rf"\dot\Omega_{i}", "rad/s^2", f"angular acceleration of {name} along its axis {i}"),
                    f"d{side}_W{i}": Letter(rf"\delta\psi_{i}", "rad", f"virtual rotation of {name} about its axis {i}"),
                }

    @property
    def hash(self) -> str:
        """sha256 of the recursion program that is integrated."""
        made = self.plan.programmed
        return program_fingerprint(made.program, [e for _, e in [*made.rows, *made.motion]])

    # -- values from the compiled recursion

    def _on_motion(self) -> None:
        """Random states of k and of the coordinates, with l moved by the compiled recursion."""
        free, rng = self.state, np.random.default_rng(5)
        sides = [f.side for f in free.d.frames[2:]]
        self.starts = np.cumsum([0, *(3 if side in self.s.turning.values() else 1 for side in sides)])
        self.up, self.load = rng.normal(size=(POINTS, 6 + self.starts[-1])), rng.normal(size=(POINTS, 6))
        found = self.run(self.plan.forward)
        q, u, self.upl = (np.stack([found[head, 1, i] for i in range(n)], -1) for head, n in (("q", 7), ("u", 6), ("up", 6)))
        names = [f"l_{n}" for n in ("r1", "r2", "r3", "P1", "P2", "P3", "P4", "v1", "v2", "v3", "W1", "W2", "W3")]
        self.state = SymbolValues(free.d, free.given | dict(zip(names, np.concatenate([q, u], 1).T, strict=True)))
        self.Rk, self.Rl = (np.stack([self.state.vector(c) for c in self.state.frame(side).body], -1) for side in "kl")

    def run(self, piece: Piece, load: Any = None, up: Any = None, state: SymbolValues | None = None,
            stepped: bool = False) -> dict[Any, Any]:
        """Values of a kernel of the tree by target. load: force and moment on l (points, 6); up: accelerations; both, and the
        states, by default those of the page; stepped: evaluated with NumPy, for complex inputs of a complex step."""
        columns = [self._place(place, load, up, state or self.state) for place in piece.inputs]
        x = np.stack([np.broadcast_to(column, (POINTS,)) for column in columns], -1)
        values = piece.kernel.oracle(x.astype(complex)) if stepped else piece.kernel.values(x)
        return dict(zip(piece.targets, values.T, strict=True))

    def _place(self, place: tuple[Any, ...], load: Any, up: Any, st: SymbolValues) -> Any:
        head, j, i = place
        load, up = self.load if load is None else load, self.up if up is None else up
        if head == "number":
            quaternions = {f"{side}_P{n}" for side in "kl" for n in range(4)}
            return st.axes_quaternion(i[0])[:, int(i[3])] if i in quaternions else st.given[i]
        if head in ("wu", "wq"):
            return load[:, i] if head == "wu" else 0.0
        f = st.d.frames[0 if j == 0 else 1 - j]
        if head == "up":
            return up[:, i if j == 0 else 6 + self.starts[-j - 1] + i]
        return st.given[str((f.q if head == "q" else f.u)[i])]

    def _rows(self, found: dict[Any, Any]) -> tuple[Any, Any]:
        """Rows of k (force, moment) and of the coordinates, (points, n), and the moment in inertial axes, (points, 3)."""
        rows = np.stack([np.broadcast_to(found.get(("u", *place), 0.0), (POINTS,)) for place in self._targets()], -1)
        return rows, np.einsum("pij,pj->pi", self.Rk, rows[:, 3:6])

    def rows(self, load: Any = None) -> Any:
        """Rows of k and of the coordinates (points, n) as in `_rows`, with the moment on k about its centre in inertial axes.
        load: force and moment on l (points, 6), by default that of the page."""
        rows, moment = self._rows(self.run(self.plan.residual, load))
        return np.concatenate([rows[:, :3], moment, rows[:, 6:]], axis=1)

    def _targets(self) -> list[tuple[int, int]]:
        counts = np.diff(self.starts)
        return [(0, i) for i in range(6)] + [(-1 - n, i) for n, count in enumerate(counts) for i in range(count)]

    def given(self) -> dict[str, Any]:
        found, st, up = super().given(), self.state, self.up
        inertial = np.einsum("pij,pj->pi", self.Rk, up[:, 3:6])
        moment = np.einsum("pij,pj->pi", self.Rl, self.load[:, 3:])
        found |= {r"\ddot{\mathbf{c}}_k": up[:, :3], r"\dot{\boldsymbol{\omega}}_k": inertial}
        found |= {r"\mathbf{F}_l": self.load[:, :3], r"\mathbf{M}_l": moment}
        found |= {rf"\dot{{\mathbf{{c}}}}_{side}": st.vector(st.frame(side).center_velocity) for side in "kl"}
        for start, side in zip(self.starts, [f.side for f in st.d.frames[2:]], strict=False):
            turns = side in self.s.turning.values()
            for i in range(3 if turns else 1):
                symbol = f"{side}_Wp{i + 1}" if turns else str(self.tree.second(_name(self.s, side)))
                found[self.known[symbol].latex] = up[:, 6 + start + i]
        return found | self.further

    def want(self, latex: str, values: Any, source: str = TREE, unit: str = "") -> None:
        super().want(latex, values, source, unit)

    def printed(self, blocks: list[Block]) -> list[Check]:
        """Checks of the equations in numbered blocks, and of the joint's own rows at the states."""
        return [*super().printed(blocks), *self.on_rows()]

    def on_rows(self) -> list[Check]:
        """Checks that the joint's rows and their first and second rates vanish for the motion of l from the recursion."""
        d, st = self.s.derived, self.state
        if not d.rows:
            return []
        p = plan(d, lambda d: [*position(d), *velocity(d), *acceleration(d), *jacobian_G(d)])
        x = np.stack([st.given[str(symbol)] for symbol in p.all_inputs.symbols], axis=-1)
        found = dict(zip(p.targets, p.kernel.values(x).T, strict=True))
        return [Check(f"{what} of the joint vanish where {TREE} takes l", max(
            residual(self._row(found, head, i), np.zeros(POINTS)) for i in range(len(d.rows)) if d.rows[i] not in d.law.drives()))
            for head, what in (("g", "rows"), ("gd", "rates of the rows"), ("gdd", "second rates of the rows"))]

    def _row(self, found: dict[Any, Any], head: str, i: int) -> Any:
        value = found.get((head, i), np.zeros(POINTS))
        if head != "gdd":
            return value
        ends = {"k": self.up[:, :6], "l": self.upl}
        for side, f in zip([g.side for g in self.s.derived.frames[2:]], self.starts, strict=False):
            ends[side] = self.up[:, 6 + f :]
        return value + sum(G * ends[t[2]][:, t[3]] for t, G in found.items() if t[:2] == ("G", i))

    def _want_mass(self) -> None:
        """Require the passed-on part of a random mass at l: compiled forces for unit accelerations minus those for zero."""
        rng, n = np.random.default_rng(6), 6 + self.starts[-1]
        M = rng.normal(size=(POINTS, 6, 6))
        out = np.zeros((POINTS, n, n))
        for j in range(n):
            at = [self._accelerations(np.broadcast_to(e, (POINTS, n))) for e in (np.eye(n)[j], np.zeros(n))]
            force = np.einsum("pij,pj->pi", M, at[0] - at[1])
            force[:, 3:] = np.einsum("pji,pj->pi", self.Rl, force[:, 3:])
            out[:, :, j] = self.rows(force)
        self.further[MATRIX.latex] = M
        self.want(r"\bar{\mathbf{M}}", out)

    def _accelerations(self, e: Any) -> Any:
        """Inertial accelerations of l (points, 6) for given inertial accelerations of the unknowns."""
        up = np.concatenate([e[:, :3], np.einsum("pji,pj->pi", self.Rk, e[:, 3:6]), e[:, 6:]], axis=1)
        found = self.run(self.plan.forward, up=up)
        a = np.stack([found["up", 1, i] for i in range(6)], -1)
        return np.concatenate([a[:, :3], np.einsum("pij,pj->pi", self.Rl, a[:, 3:])], axis=1)

    def _varied(self) -> Any:
        """Change of the rows of k and of the coordinates by a complex step, with constant inertial force on l."""
        st, s = self.state, self.s
        turns = {side: st.atom(Base("dpsi", side)) for side in ("k", *s.turning.values())}
        symbols = {str(c): st.given[str(dc)] for c, dc in s.virtual.items()}
        motion = {side: (0 * turn, turn) for side, turn in turns.items()}
        motion["k"] = (np.cross(turns["k"], st.vector(st.frame("k").arm)), turns["k"])
        moved = st.changed(1j * STEP, motion, symbols)
        for side in s.turning.values():
            spin = np.einsum("pji,pj->pi", np.stack([st.vector(c) for c in st.frame(side).body], -1), turns[side])
            for i in range(3):
                symbols[f"d{side}_W{i + 1}"] = spin[:, i]
                self.further[self.known[f"d{side}_W{i + 1}"].latex] = spin[:, i]
        turn_l = self._turn(turns["k"], symbols)
        self.further[r"\delta\boldsymbol{\psi}_l"] = turn_l
        body = self.load.astype(complex)
        inertial = np.einsum("pij,pj->pi", self.Rl, self.load[:, 3:])
        body[:, 3:] -= 1j * STEP * np.einsum("pji,pj->pi", self.Rl, np.cross(turn_l, inertial))
        rows, moment = self._rows(self.run(self.plan.residual, body, state=moved, stepped=True))
        change = np.imag(rows) / STEP
        change[:, 3:6] = np.imag(moment) / STEP + np.cross(turns["k"], np.real(moment))
        return change

    def _turn(self, turn_k: Any, symbols: dict[str, Any]) -> Any:
        """Virtual rotation of l (points, 3), inertial axes, from that of k and the virtual changes of the coordinates: the
        compiled map of the tree from velocities of k and rates to velocities of l, with the virtual ones as its input."""
        st, s = self.state, self.s
        given = dict(st.given) | {f"k_v{i + 1}": np.zeros(POINTS) for i in range(3)}
        spin = np.einsum("pji,pj->pi", self.Rk, turn_k)
        given |= {f"k_W{i + 1}": spin[:, i] for i in range(3)} | {str(s.clock[c]): symbols[str(c)] for c in s.virtual}
        given |= {f"{side}_W{i + 1}": symbols[f"d{side}_W{i + 1}"] for side in s.turning.values() for i in range(3)}
        found = self.run(self.plan.forward, state=SymbolValues(st.d, given))
        return np.einsum("pij,pj->pi", self.Rl, np.stack([found["u", 1, i] for i in (3, 4, 5)], -1))


def _name(s: ReportedLaw, side: str) -> str:
    found: str = next(name for name, place in s.places.items() if place == side)
    return found




def link_of(law: Any, structure: Structure, derived: frozenset[str]) -> Link:
    """The joint as the only link of a tree of two bodies in space with root k."""
    of_side = [*("p1", "p2", "p3"), *(f"Q{a}{i}" for a in "xyz" for i in (1, 2, 3)), *(f"P{i}" for i in range(4))]
    numbers = [f"{side}_{name}" for side in "kl" for name in of_side]
    numbers += [name for name in law.params if name not in derived and name not in structure.absent]
    names = tuple(law.coordinates)
    return Link(law, structure, 0, "k", NodeKind.SPATIAL, (Axes.GENERAL, Axes.GENERAL), tuple((n, None) for n in numbers), True,
                names, (False,) * len(names), 1)


def tree_of(link: Link) -> TreeStructure:
    """The tree of that link, with loads on body l."""
    return TreeStructure(NodeKind.SPATIAL, (link,), (), (1,))


class _Vectors(Program):
    """A recursion program that keeps results as formulas, without symbols for intermediate results. Axes after the last rotation
    are replaced by the axes of l; those after earlier rotations get letters."""

    def __init__(self) -> None:
        super().__init__()
        self.turns, self.last, self.record = 0, 0, NamedQuantities()
        self.reached: tuple[Vec, ...] = ()

    def let(self, e: Any) -> Expr:
        return se.sympify(e)

    def vec(self, v: Vec) -> Vec:
        return v

    def axes(self, axes: tuple[Vec, Vec, Vec]) -> tuple[Vec, Vec, Vec]:
        self.turns += 1
        if self.turns < self.last:
            x, y, z = (a.named() for a in axes)
            return x, y, z
        self.reached = axes
        x, y, z = (self.record.atom(name, "l") for name in "xyz")
        return x, y, z


class VectorTree(TreeProgram):
    """Motion and forces of a joint from k to l, as vectors of its statement's record.

    reached: axes of l; spins: angular velocity and acceleration of l by those of k and the coordinates; l: its motion;
    root: force and moment that the joint passes on to k."""

    def __init__(self, s: ReportedLaw, link: Link) -> None:
        self.s, self.link = s, link
        self.atom = s.record.atom
        super().__init__(tree_of(link))
        assert isinstance(self.program, _Vectors)
        self.reached: Any = self.program.reached
        self.way: Any = self._ways[0]
        self.l: Any = self.nodes[1]
        self.force = self._along((self.atom("F", "l"), self.atom("M", "l")))
        self._label()

    def _label(self) -> None:
        """Give letters to angular velocities and accelerations between k and l."""
        for number, value in self.s.record.vectors.items():
            for kind, letter in (("w", r"\boldsymbol{\omega}"), ("al", r"\dot{\boldsymbol{\omega}}")):
                if Base(kind, "k") in value.terms and number not in self.s.record.labels:
                    count = sum(label.startswith(letter) for label in self.s.record.labels.values())
                    self.s.record.labels[number] = f"{letter}_{{{count + 1}}}"

    @staticmethod
    def _program() -> Program:
        return _Vectors()

    def second(self, name: str) -> Expr:
        """The symbol of the second time derivative of a coordinate."""
        return se.Symbol(f"{name}_second")

    def _input(self, *place: Any) -> Expr:
        head, owner, i = place
        if head == "number":
            return se.Symbol(i)
        name = self.link.coordinates[-owner - self.link.first]
        q = self.s.coordinates[name]
        return {"q": q, "u": self.s.clock[q], "up": self.second(name)}[head]

    def _root(self, kind: NodeKind) -> NodeMotion:
        r, v, w, a, al = (self.atom(name, "k") for name in ("c", "vc", "w", "ac", "al"))
        return NodeMotion(kind, r, UNIT, se.Integer(0), v, w, a, al)

    def _frame(self, j: int, link: Link, side: str, node: NodeMotion, axes: Axes) -> tuple[Vec, tuple[Vec, ...]]:
        return self.atom("s", side), tuple(self.atom(name, side) for name in "xyz")

    def _motion(self, j: int, link: Link) -> list[Moved]:
        found = super()._motion(j, link)
        assert isinstance(self.program, _Vectors)
        self.program.last, self.program.record = sum(m.step.turns for m in found), self.s.record
        return found

    def _rotation(self, c: int) -> Any:
        name = self.link.coordinates[c - self.link.first]
        side = self.s.turning[name]
        spin, change = (Vec(*(se.Symbol(f"{side}_{letter}{i}") for i in "123")) for letter in ("W", "Wp"))
        rotation = self.s.values[name]
        return rotation, Moved(Step(True, ZERO, se.Integer(0), rotation), number=c, spin=spin, change=change)

    def _spins(self, found: LinkWay) -> tuple[Vec, Vec]:
        self.spins: Any = (found.w, found.al)
        return self.atom("w", "l"), self.atom("al", "l")

    def _orient(self, child: NodeMotion, k: NodeMotion, place: tuple[int, Link, str], found: LinkWay) -> None:
        pass

    def _arm(self, j: int, link: Link, side: str, node: NodeMotion) -> Vec:
        return self.atom("s", side)

    def _along(self, wrench: Wrench) -> dict[tuple[int, int], Expr]:
        """Rows of the joint's coordinates for a force and a moment on l, by virtual power; they pass on `root` to k."""
        found, F = self.way, wrench[0]
        M = wrench[1] - found.back.cross(F)  # about the end of the joint's motion
        self.root: Any = (F, M + found.total.cross(F))
        rows, left = dict[tuple[int, int], Expr](), found.total  # from the parent's node to the place of the motion
        for part in reversed(found.parts):
            m = part.moved
            moment = M if left is found.total else M + (found.total - left).cross(F)
            for c, slope in m.slopes.items():
                work = part.direction @ (moment if m.step.turns else F)
                rows[-c, 0] = rows.get((-c, 0), se.Integer(0)) + slope * work
            if m.step.rotation is not None:
                rows |= {(-m.number, i): axis @ moment for i, axis in enumerate(part.axes)}
            left = left if part.displacement is ZERO else left - part.displacement
        return rows
