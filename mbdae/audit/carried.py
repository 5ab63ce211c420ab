"""Motion of a body that a joint connects to another, computed by the compiled recursion of a tree, as simulations use it."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.evaluate import SizeError, Value
from mbdae.audit.expressions import expression_function
from mbdae.audit.notation import GIVE_OWN_CLASS
from mbdae.laws import joints
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.tree import tree_program
from mbdae.symbolic.tree_motion import Link, TreeStructure

_AXES = (Axes.GENERAL, Axes.GENERAL)


def joint_class(word: str, own: Any = ()) -> Any:
    """The class of a joint with coordinates by its name, in upper or lower case; None where there is none. own: the user's
    laws."""
    known = {name.lower(): getattr(joints, name) for name in joints.__all__} | {name.lower(): cls for name, cls in own}
    cls = known.get(word.lower().replace(" ", ""))
    return cls if isinstance(cls, type) and issubclass(cls, Joint) and cls.coordinates else None


@lru_cache(maxsize=16)
def _program(cls: Any) -> tuple[list[tuple[Any, ...]], Callable[..., list[Any]]]:
    """The recursion that moves l by the joint from a free body k, as a compiled function: the inputs it takes, each by its place
    (see `TreeProgram`), and the function from their values to the 19 numbers q, u, u' of l."""
    law = cls("audited", None, None, **dict.fromkeys(cls.params, 1.0))
    of_side = [*("p1", "p2", "p3"), *(f"Q{a}{i}" for a in "xyz" for i in (1, 2, 3)), *(f"P{i}" for i in range(4))]
    structure, names = law.structure(), tuple(cls.coordinates)
    numbers = [f"{side}_{n}" for side in "kl" for n in of_side] + [n for n in cls.params if n not in law.derived()]
    stated = tuple((n, None) for n in numbers if n not in structure.absent)
    link = Link(cls, structure, 0, "k", NodeKind.SPATIAL, _AXES, stated, True, names, (False,) * len(names), 1)
    tree = tree_program(TreeStructure(NodeKind.SPATIAL, (link,), (), (1,)))
    found = {(name, i): se.sympify(e) for (name, _, i), e in tree.states((1,))}
    outputs = [found[name, i] for name, size in (("q", 7), ("u", 6), ("up", 6)) for i in range(size)]
    steps = {name: tree.program.steps[name] for name in tree.program.needed(outputs)}
    return list(tree.inputs.values()), expression_function(list(tree.inputs), steps, outputs)


class Carried:
    """Motion of l connected to k by a joint whose points and axes coincide with those of the bodies."""

    def __init__(self, word: str, own: Any = ()) -> None:
        cls = joint_class(word, own)
        if cls is None:
            give_own_class = GIVE_OWN_CLASS.format(word.capitalize())
            raise SizeError(f"an audit knows no joint '{word}' with coordinates; {give_own_class}")
        if any(spec.unit == "rotation" for spec in cls.coordinates.values()):
            raise SizeError(f"the joint '{word}' turns freely, which an audit cannot use: name one whose coordinates are "
                            f"angles and displacements")  # fmt: skip
        self.coordinates = tuple(cls.coordinates)
        self.inputs, self.function = _program(cls)

    def motion(self, k: dict[str, Value], state: Any) -> dict[str, Value]:
        """Attitude "Q", Euler parameters "P" and motion vectors of l, from those of k and the coordinates of the state."""
        found = np.array(self.function([complex(self._input(place, k, state)) for place in self.inputs]), dtype=complex)
        q, u, up = found[:7, None], found[7:13, None], found[13:, None]
        Q = _rotation(q[3:])
        return {"Q": Q, "P": q[3:], "x": q[:3], "v": u[:3], "w": Q @ u[3:], "a": up[:3], "alpha": Q @ up[3:]}

    def _input(self, place: tuple[Any, ...], k: dict[str, Value], state: Any) -> Value:
        head, j, i = place
        if head == "number":
            return _number(i, state)
        if j < 0:
            return state.coordinates[self.coordinates[-j - 1]][("q", "u", "up").index(head)]
        if head in ("wu", "wq"):
            return 0.0
        moves, turns = {"q": ("x", k["P"]), "u": ("v", k["Q"].T @ k["w"]), "up": ("a", k["Q"].T @ k["alpha"])}[head]
        return k[moves][i, 0] if i < 3 else turns[i - 3, 0]


def _number(name: str, state: Any) -> float:
    """Value of a parameter of the joint; parameters of its points and axes make them coincide with those of the bodies."""
    side, _, what = name.partition("_")
    if side not in ("k", "l") or not what:
        return float(state.positive(f"parameter {name}"))
    return float(what in ("Qx1", "Qy2", "Qz3", "P0"))


def _rotation(P: Value) -> Value:
    """Rotation matrix (3, 3) of Euler parameters (4, 1) of unit length."""
    w, e = P[0, 0], P[1:]
    x, y, z = e[:, 0]
    return (2 * w * w - 1) * np.eye(3) + 2 * e @ e.T + 2 * w * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
