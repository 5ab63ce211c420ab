"""The motion of a node as plain numbers, which the kernels of a tree hand from body to body."""

from __future__ import annotations

from collections.abc import Callable

import symengine as se

from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.tree_motion import State
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
              NodeKind.SPATIAL: (*(f"{a}{i}" for a in "xyzw" for i in ONE_TWO_THREE),)}.get(kind, ())  # fmt: skip
    more = tuple(f"P{i}" for i in range(4)) if quaternion and kind is NodeKind.SPATIAL else ()
    return (*(f"r{i}" for i in n), *(f"v{i}" for i in n), *turned, *more)


def state_of(kind: NodeKind, number: Callable[[str], Expr]) -> State:
    """The motion of a node, accelerations included. number: function that returns the expression for a name of `motion_names` or
    `directions`."""
    if not kind.moves:
        return State(kind, ZERO, UNIT, se.Integer(0), ZERO, ZERO, ZERO, ZERO, [se.Integer(i == 0) for i in range(4)])

    def vector(name: str, components: str) -> Vec:
        return Vec(*(number(f"{name}{i}") if i in components else 0 for i in ONE_TWO_THREE))

    moves = "12" if kind.flat else "123"
    turns = {NodeKind.PLANAR: "3", NodeKind.SPATIAL: "123"}.get(kind, "")
    made = State(kind, vector("r", moves), UNIT, se.Integer(0), vector("v", moves), vector("w", turns), vector("a", moves),
                 vector("al", turns))  # fmt: skip
    if kind is NodeKind.PLANAR:
        bx = Vec(number("cos"), number("sin"), 0)
        made.R, made.heading = (bx, UNIT[2].cross(bx), UNIT[2]), number("theta")
    elif kind is NodeKind.SPATIAL:
        made.R = (vector("x", "123"), vector("y", "123"), vector("z", "123"))
        made.P = [number(f"P{i}") for i in range(4)]
    return made


def numbers_of(state: State, quaternion: bool = False) -> list[Expr]:
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
