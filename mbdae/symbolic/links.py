"""The motion of a node as plain numbers, which the kernels of a tree hand from body to body.

The passes of the articulated-body recursion at one body: inwards, from the leaves to the root, inertia and forces of a body
with all that it carries; outwards the accelerations.

F = I a + p is the force on a body together with all that it carries, a its acceleration. The joint gives a = b + S q'', with
b = X a0 + c, a0 the acceleration of the body that carries it and q'' the second rates of the joint's freedoms, and S^T F = tau
with the forces tau on these. Then q'' = K0 - K b with K = (S^T I S)^-1 S^T I and K0 = (S^T I S)^-1 (tau - S^T p), and X^T F,
an expression of the same form in a0, acts on the carrying body.

Programs of the pieces of a tree: one joint with the body it carries, a root, a law between bodies, loads from outside.

Every piece is a `TreeProgram` of its own whose other bodies are given by numbers: the same statements of motion and laws as in
the program of a whole tree. What the passes need follows by derivatives: of the body's acceleration by that of its parent (X)
and by those of the joint's coordinates (S), and of the forces of its laws by its acceleration (M).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import symengine as se

from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.program import Program
from mbdae.symbolic.tree import TreeProgram
from mbdae.symbolic.tree_motion import Link, Member, NodeMotion, TreeStructure
from mbdae.symbolic.vectors import UNIT, ZERO, Expr, Vec

ONE_TWO_THREE = ("1", "2", "3")


def directions(kind: NodeKind) -> tuple[str, ...]:
    """Names of the inertial components of acceleration ("a1") and angular acceleration ("al1") that a kind of node has; forces
    and moments have the same."""
    move, turn = kind.translations, {NodeKind.PLANAR: "3", NodeKind.SPATIAL: "123"}.get(kind, "")
    return (*(f"a{i}" for i in ONE_TWO_THREE[:move]), *(f"al{i}" for i in turn)) if kind.moves else ()


def motion_names(kind: NodeKind, quaternion: bool = False) -> tuple[str, ...]:
    """Names of the numbers of a node's motion: position, axes (or heading with cosine and sine), velocity, angular velocity.
    quaternion: whether that of its rotation is wanted too."""
    if not kind.moves:
        return ()
    n = ONE_TWO_THREE[: kind.translations]
    turned = {NodeKind.PLANAR: ("theta", "cos", "sin", "w3"),
              NodeKind.SPATIAL: (*(f"{a}{i}" for a in "xyzw" for i in ONE_TWO_THREE),)}.get(kind, ())
    more = tuple(f"P{i}" for i in range(4)) if quaternion and kind is NodeKind.SPATIAL else ()
    return (*(f"r{i}" for i in n), *(f"v{i}" for i in n), *turned, *more)


def state_of(kind: NodeKind, number: Callable[[str], Expr]) -> NodeMotion:
    """The motion of a node, accelerations included. number: function that returns the expression for a name of `motion_names` or
    `directions`."""
    if not kind.moves:
        return NodeMotion(kind, ZERO, UNIT, se.Integer(0), ZERO, ZERO, ZERO, ZERO, [se.Integer(i == 0) for i in range(4)])

    def vector(name: str, components: str) -> Vec:
        return Vec(*(number(f"{name}{i}") if i in components else 0 for i in ONE_TWO_THREE))

    moves = "12" if kind.flat else "123"
    turns = {NodeKind.PLANAR: "3", NodeKind.SPATIAL: "123"}.get(kind, "")
    made = NodeMotion(kind, vector("r", moves), UNIT, se.Integer(0), vector("v", moves), vector("w", turns), vector("a", moves),
                 vector("al", turns))
    if kind is NodeKind.PLANAR:
        bx = Vec(number("cos"), number("sin"), 0)
        made.R, made.heading = (bx, UNIT[2].cross(bx), UNIT[2]), number("theta")
    elif kind is NodeKind.SPATIAL:
        made.R = (vector("x", "123"), vector("y", "123"), vector("z", "123"))
        made.P = [number(f"P{i}") for i in range(4)]
    return made


def numbers_of(state: NodeMotion, quaternion: bool = False) -> list[Expr]:
    """The numbers of a motion in the order of `motion_names`."""
    parts = {"r": state.r, "v": state.v, "x": state.R[0], "y": state.R[1], "z": state.R[2], "w": state.w}
    known = {f"{name}{i}": value for name, part in parts.items() for i, value in zip(ONE_TWO_THREE, part, strict=True)}
    known |= {"theta": state.heading, "cos": state.R[0][0], "sin": state.R[0][1]}
    known |= {f"P{i}": value for i, value in enumerate(state.P)}
    return [known[name] for name in motion_names(state.kind, quaternion)]


def along(kind: NodeKind, move: Vec, turn: Vec) -> list[Expr]:
    """Those components of a force and a moment (or of an acceleration and an angular acceleration) that `directions` names."""
    found = {**{f"a{i}": move[int(i) - 1] for i in ONE_TWO_THREE}, **{f"al{i}": turn[int(i) - 1] for i in ONE_TWO_THREE}}
    return [found[name] for name in directions(kind)]


Place = tuple[Any, ...]
_ZERO = se.Integer(0)


@dataclass(frozen=True)
class PassShape:
    """What distinguishes the passes of two bodies apart from numbers. body, parent: how many components the accelerations of the
    body and of the one that carries it have; freedoms: how many the joint has; known: entries of X, S and c, by place, with their
    values where these are constant (None: they vary); heavy: whether the freedoms have an inertia of their own."""

    body: int
    parent: int
    freedoms: int
    known: tuple[tuple[Place, int | None], ...]
    heavy: bool = False


@dataclass
class Pass:
    """A pass as a program, whose inputs and outputs are named by places; the letters are those of the module.

    inputs: ("M", i, j), ("p", i) with all that the body carries, ("X", i, j), ("S", i, k), ("c", i), ("tau", k), ("C", k, l) own
    inertia of the freedoms, ("a0", i) acceleration of the carrying body, ("K", k, i), ("K0", k) of the inward pass."""

    shape: PassShape
    program: Program = field(default_factory=Program)
    inputs: dict[Expr, Place] = field(default_factory=dict)
    outputs: list[tuple[Place, Expr]] = field(default_factory=list)

    def number(self, *place: Any) -> Expr:
        """The symbol of the input at a place, or its value where the shape knows it."""
        known = dict(self.shape.known).get(place)
        if known is not None:
            return se.Integer(known)
        symbol = se.Symbol("_".join(map(str, place)))
        self.inputs[symbol] = place
        return symbol

    def symmetric(self, name: str, n: int) -> list[list[Expr]]:
        """A symmetric matrix (n, n) whose inputs are the entries of its lower triangle."""
        return [[self.number(name, max(i, j), min(i, j)) for j in range(n)] for i in range(n)]

    def matrix(self, name: str, n: int, m: int) -> list[list[Expr]]:
        """A matrix of inputs."""
        return [[self.number(name, i, j) for j in range(m)] for i in range(n)]

    def vector(self, name: str, n: int) -> list[Expr]:
        """A vector of inputs."""
        return [self.number(name, i) for i in range(n)]


def inward(shape: PassShape) -> Pass:
    """The inward pass at a body. Outputs: what it adds to inertia ("M0", i, j) and force ("p0", i) of the carrying body; K and K0
    for the outward pass; the pivots of S^T I S, ("pivot", k), which are positive where the freedoms have inertia."""
    made = Pass(shape)
    let, n, f = made.program.let, shape.body, shape.freedoms
    A, p, S, c = made.symmetric("M", n), made.vector("p", n), made.matrix("S", n, f), made.vector("c", n)
    U = [[let(_dot(A[i], [S[j][k] for j in range(n)])) for k in range(f)] for i in range(n)]
    own = {(k, l): made.number("C", k, l) for k in range(f) for l in range(k + 1)} if shape.heavy else {}
    D = {(k, l): let(_dot([row[k] for row in S], [row[l] for row in U]) + own.get((k, l), 0))
         for k in range(f) for l in range(k + 1)}
    left = [let(made.number("tau", k) - _dot([S[i][k] for i in range(n)], p)) for k in range(f)]
    K0, pivots = made.program.solved(D, left) if f else ([], [])
    columns = [made.program.solved(D, U[i])[0] if f else [] for i in range(n)]  # of K = D^-1 U^T, one for each row of U
    I = {(i, j): let(A[i][j] - _dot(U[i], columns[j])) for i in range(n) for j in range(i + 1)}
    rest = [let(p[i] + _dot(U[i], K0) + _dot([I[max(i, j), min(i, j)] for j in range(n)], c)) for i in range(n)]
    if shape.parent:
        X = made.matrix("X", n, shape.parent)
        Y = [[let(_dot([I[max(i, k), min(i, k)] for k in range(n)], [X[k][j] for k in range(n)])) for j in range(shape.parent)]
             for i in range(n)]
        made.outputs += [(("M0", i, j), _dot([X[k][i] for k in range(n)], [Y[k][j] for k in range(n)]))
                         for i in range(shape.parent) for j in range(i + 1)]
        made.outputs += [(("p0", i), _dot([X[k][i] for k in range(n)], rest)) for i in range(shape.parent)]
    made.outputs += [(("K", k, i), columns[i][k]) for k in range(f) for i in range(n)]
    made.outputs += [*((("K0", k), e) for k, e in enumerate(K0)), *((("pivot", k), e) for k, e in enumerate(pivots))]
    return made


def outward(shape: PassShape, given: bool = False) -> Pass:
    """The outward pass at a body. Outputs: second rates of the freedoms ("up", k) and acceleration of the body ("a", i). given:
    whether these rates are inputs, not to be solved for."""
    made = Pass(shape)
    let, n, f = made.program.let, shape.body, shape.freedoms
    S, c, a0 = made.matrix("S", n, f), made.vector("c", n), made.vector("a0", shape.parent)
    X = made.matrix("X", n, shape.parent)
    b = [let(_dot(X[i], a0) + c[i]) for i in range(n)]
    if given:
        up = [made.number("up", k) for k in range(f)]
    else:
        K, K0 = made.matrix("K", f, n), made.vector("K0", f)
        up = [let(K0[k] - _dot(K[k], b)) for k in range(f)]
    made.outputs += [(("a", i), let(b[i] + _dot(S[i], up))) for i in range(n)]
    made.outputs += [] if given else [(("up", k), e) for k, e in enumerate(up)]
    return made


def projected(shape: PassShape, moving: bool = False) -> Pass:
    """What a force ("w", i) on a body does: its components along the joint's freedoms, S^T w in ("row", k), and the force on the
    carrying body, X^T w in ("w0", i). moving: w = M a + p, of inertia, acceleration and forces as in the other passes."""
    made = Pass(shape)
    n, S = shape.body, made.matrix("S", shape.body, shape.freedoms)
    if moving:
        a, M = made.vector("a", n), made.symmetric("M", n)
        w = [made.program.let(p + _dot(row, a)) for p, row in zip(made.vector("p", n), M, strict=True)]
    else:
        w = made.vector("w", n)
    X = made.matrix("X", n, shape.parent)
    made.outputs += [(("w0", j), _dot([X[i][j] for i in range(n)], w)) for j in range(shape.parent)]
    made.outputs += [(("row", k), _dot([S[i][k] for i in range(n)], w)) for k in range(shape.freedoms)]
    return made


def _dot(a: list[Expr], b: list[Expr]) -> Expr:
    return sum((x * y for x, y in zip(a, b, strict=True)), _ZERO)


Entries = list[tuple[Place, Expr]]


class PieceProgram(TreeProgram):
    """A piece of a tree. Inputs besides those of `TreeProgram`: ("x", node, name) a number of a node's motion, ("a", node, name)
    its acceleration in one of its directions."""

    def _given(self, node: int, kind: NodeKind) -> NodeMotion:
        accelerations = set(directions(kind))
        return state_of(kind, lambda name: self._input("a" if name in accelerations else "x", node, name))

    def _symbols(self, head: str, node: int | None = None) -> list[Expr]:
        return [s for s, place in self.inputs.items() if place[0] == head and node in (None, place[1])]

    def slopes(self, name: str, values: Sequence[Expr], by: Sequence[Expr], order: Any = None) -> Entries:
        """Derivatives of values i by symbols j as entries at (name, i, j), also where they are 0."""
        found = self.program.derivatives([se.sympify(v) for v in values], by)
        return [((name, i, j), row.get(symbol, se.Integer(0))) for i, row in enumerate(found) for j, symbol in enumerate(by)]

    def still(self, entries: Entries) -> tuple[Program, list[Expr]]:
        """A program of some entries with all accelerations set to 0, and the entries in it."""
        nothing = {s: se.Integer(0) for s, place in self.inputs.items() if place[0] in ("a", "up")}
        return self.program.at(nothing, [e for _, e in entries])


class LinkProgram(PieceProgram):
    """A joint (link 1) and the body that it carries (node 1) with that body's own laws; node 0 is the body that carries the
    joint."""

    def __init__(self, parent: NodeKind, link: Link, members: tuple[Member, ...]) -> None:
        super().__init__(TreeStructure(parent, (replace(link, parent=0, first=1),), members))

    def _root(self, kind: NodeKind) -> NodeMotion:
        return self._given(0, kind)

    def _carried(self, j: int, link: Link) -> NodeMotion:
        child = super()._carried(j, link)
        self.reached = along(link.kind, child.a, child.al)
        given = self._given(1, link.kind)
        child.a, child.al = given.a, given.al
        return child

    def outward(self, quaternion: bool) -> Entries:
        """Motion of the body; X, S and c of its acceleration X a0 + S q'' + c; inertia M (lower triangle) and force p of its
        laws."""
        child = self.nodes[1]
        found: Entries = [(("x", name), e) for name, e in zip(motion_names(child.kind, quaternion), numbers_of(child, quaternion),
                                                     strict=True)]
        found += self.slopes("X", self.reached, self._accelerations(0)) + self.slopes("S", self.reached, self.freedoms)
        found += [(("c", i), e) for i, e in enumerate(self.reached)]
        return found + self._inertia(child)

    def _inertia(self, child: NodeMotion) -> Entries:
        F = along(child.kind, *self.wrenches.get(1, (ZERO, ZERO)))
        slopes = [(place, e) for place, e in self.slopes("M", F, self._accelerations(1)) if place[2] <= place[1]]
        return slopes + [(("p", i), e) for i, e in enumerate(F)]

    def _accelerations(self, node: int) -> list[Expr]:
        known = {place[2]: s for s, place in self.inputs.items() if place[:2] == ("a", node)}
        return [known[name] for name in directions(self.nodes[node].kind)]

    @property
    def freedoms(self) -> list[Expr]:
        """Second rates of the joint's free coordinates, in their order."""
        return self._symbols("up")


class RootProgram(PieceProgram):
    """A body that moves by unknowns of its own (node 0), which may carry others."""

    def __init__(self, kind: NodeKind) -> None:
        super().__init__(TreeStructure(kind, (), ()))

    def outward(self, quaternion: bool) -> Entries:
        """Motion of the body; S and c of its acceleration S u' + c; zeros for inertia M and force p, which laws on it add."""
        root = self.nodes[0]
        reached = along(root.kind, root.a, root.al)
        found: Entries = [(("x", name), e) for name, e in zip(motion_names(root.kind, quaternion), numbers_of(root, quaternion),
                                                     strict=True)]
        found += self.slopes("S", reached, self._symbols("up")) + [(("c", i), e) for i, e in enumerate(reached)]
        n, zero = len(reached), se.Integer(0)
        return [*found, *((("M", i, j), zero) for i in range(n) for j in range(i + 1)), *((("p", i), zero) for i in range(n))]


class MemberProgram(PieceProgram):
    """A law between several bodies whose motions are given; `nodes` has their places in `member`."""

    def __init__(self, kinds: Sequence[NodeKind], member: Member) -> None:
        self.structure, self.program = TreeStructure(NodeKind.GROUND, (), (member,)), self._program()
        self.inputs = {}
        self.nodes = [self._given(i, kind) for i, kind in enumerate(kinds)]
        self.wrenches = self._members()

    def forces(self) -> Entries:
        """Components i of force and moment of the law on every body j, entries ("p", j, i)."""
        return [(("p", j, i), e) for j, F in self.wrenches.items() for i, e in enumerate(along(self.nodes[j].kind, *F))]


class NodeProgram(PieceProgram):
    """A body whose motion is given: its unknowns q, u, u', as laws outside of the tree read them, and the forces of these
    laws."""

    def __init__(self, kind: NodeKind) -> None:
        self.structure, self.program = TreeStructure(NodeKind.GROUND, (), ()), self._program()
        self.inputs = {}
        self.nodes = [self._given(0, kind)]

    def motion(self, heads: Sequence[str]) -> Entries:
        """q, u and u' ("up") of the body, as far as `heads` names them."""
        return [((t[0], t[2]), e) for t, e in self.states((0,)) if t[0] in heads]

    def load(self, role: str) -> Entries:
        """Force and moment from inputs (role, 0, i), what laws outside of the tree add to the body's rows: to its equations of
        motion (role "wu"), or to its kinematic equations ("wq")."""
        return [(("p", i), e) for i, e in enumerate(along(self.nodes[0].kind, *self._load(role, 0)))]
