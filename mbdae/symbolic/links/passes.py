"""The passes of the articulated-body recursion at one body: inwards, from the leaves to the root, inertia and forces of a body
with all that it carries; outwards the accelerations.

F = I a + p is the force on a body together with all that it carries, a its acceleration. The joint gives a = b + S q'', with
b = X a0 + c, a0 the acceleration of the body that carries it and q'' the second rates of the joint's freedoms, and S^T F = tau
with the forces tau on these. Then q'' = K0 - K b with K = (S^T I S)^-1 S^T I and K0 = (S^T I S)^-1 (tau - S^T p), and X^T F,
an expression of the same form in a0, acts on the carrying body.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import symengine as se

from mbdae.symbolic.program import Program
from mbdae.symbolic.vectors import Expr

Place = tuple[Any, ...]
_ZERO = se.Integer(0)


@dataclass(frozen=True)
class Shape:
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

    shape: Shape
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


def inward(shape: Shape) -> Pass:
    """The inward pass at a body. Outputs: what it adds to inertia ("M0", i, j) and force ("p0", i) of the carrying body; K and K0
    for the outward pass; the pivots of S^T I S, ("pivot", k), which are positive where the freedoms have inertia."""
    made = Pass(shape)
    let, n, f = made.program.let, shape.body, shape.freedoms
    A, p, S, c = made.symmetric("M", n), made.vector("p", n), made.matrix("S", n, f), made.vector("c", n)
    U = [[let(_dot(A[i], [S[j][k] for j in range(n)])) for k in range(f)] for i in range(n)]
    own = {(k, l): made.number("C", k, l) for k in range(f) for l in range(k + 1)} if shape.heavy else {}
    D = {(k, l): let(_dot([row[k] for row in S], [row[l] for row in U]) + own.get((k, l), 0))
         for k in range(f) for l in range(k + 1)}  # fmt: skip
    left = [let(made.number("tau", k) - _dot([S[i][k] for i in range(n)], p)) for k in range(f)]
    K0, pivots = made.program.solved(D, left) if f else ([], [])
    columns = [made.program.solved(D, U[i])[0] if f else [] for i in range(n)]  # of K = D^-1 U^T, one for each row of U
    I = {(i, j): let(A[i][j] - _dot(U[i], columns[j])) for i in range(n) for j in range(i + 1)}
    rest = [let(p[i] + _dot(U[i], K0) + _dot([I[max(i, j), min(i, j)] for j in range(n)], c)) for i in range(n)]
    if shape.parent:
        X = made.matrix("X", n, shape.parent)
        Y = [[let(_dot([I[max(i, k), min(i, k)] for k in range(n)], [X[k][j] for k in range(n)])) for j in range(shape.parent)]
             for i in range(n)]  # fmt: skip
        made.outputs += [(("M0", i, j), _dot([X[k][i] for k in range(n)], [Y[k][j] for k in range(n)]))
                         for i in range(shape.parent) for j in range(i + 1)]  # fmt: skip
        made.outputs += [(("p0", i), _dot([X[k][i] for k in range(n)], rest)) for i in range(shape.parent)]
    made.outputs += [(("K", k, i), columns[i][k]) for k in range(f) for i in range(n)]
    made.outputs += [*((("K0", k), e) for k, e in enumerate(K0)), *((("pivot", k), e) for k, e in enumerate(pivots))]
    return made


def outward(shape: Shape, given: bool = False) -> Pass:
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


def projected(shape: Shape) -> Pass:
    """What a force ("w", i) on a body does: its components along the joint's freedoms, S^T w in ("row", k), and the force on the
    carrying body, X^T w in ("w0", i)."""
    made = Pass(shape)
    n, w, S = shape.body, made.vector("w", shape.body), made.matrix("S", shape.body, shape.freedoms)
    X = made.matrix("X", n, shape.parent)
    made.outputs += [(("w0", j), _dot([X[i][j] for i in range(n)], w)) for j in range(shape.parent)]
    made.outputs += [(("row", k), _dot([S[i][k] for i in range(n)], w)) for k in range(shape.freedoms)]
    return made


def _dot(a: list[Expr], b: list[Expr]) -> Expr:
    return sum((x * y for x, y in zip(a, b, strict=True)), _ZERO)
