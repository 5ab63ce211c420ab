"""Conditions on sensors, "J.angle > 1.0", as text or symbols: the functions that change their sign, and how they are joined."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.errors import OptionError
from mbdae.inputs import tables, text, timed
from mbdae.inputs.sensed import paths, symbol_name
from mbdae.run import pieces as signals
from mbdae.scene.control import stated_values
from mbdae.scene.sensed import spelled
from mbdae.symbolic.rebuild import CONDITIONS, is_condition
from mbdae.symbolic.vectors import Expr
from mbdae.values import BadValueError, shown

EXAMPLE = "write one such as 'J.angle > 0.5', 'b.position[1] == 0', or sympy.And(...) of such"
_NAME = re.compile(r'sensor\("(?:[^"\\]|\\.)*"\)|(?<![\w.])[A-Za-z_]\w*(?:\.at\([^()]*\)|\.[A-Za-z_]\w*)*(?:\[[\d\s,]*\])*')
_SENSOR = re.compile(r'sensor\("((?:[^"\\]|\\.)*)"\)')
_NORM = re.compile(r"\b(?:norm|magnitude)\(\s*([A-Za-z_]\w*(?:\.at\([^()]*\)|\.[A-Za-z_]\w*)+)\s*\)")
Truth = NDArray[np.bool_]


@dataclass(frozen=True)
class Condition:
    """A condition on sensors, made of k comparisons of functions g with 0.

    name: its text; functions (k,): g of every comparison; equations (k,): whether it is g = 0, else it is g > 0; meeting (k,):
    whether it holds also where g = 0; tree: how comparisons are joined: the index of one, or ("and", "or" or "not", list of
    trees)."""

    name: str
    functions: tuple[Expr, ...]
    equations: tuple[bool, ...]
    meeting: tuple[bool, ...]
    tree: Any

    @property
    def is_equation(self) -> bool:
        """Whether the condition is a single equation."""
        return len(self.functions) == 1 and self.equations[0]

    def holds(self, atoms: Truth) -> bool:
        """Whether the condition holds; atoms (k,): whether each of its comparisons holds."""
        return _joined(self.tree, atoms)


def _joined(tree: Any, atoms: Truth) -> bool:
    if isinstance(tree, int):
        return bool(atoms[tree])
    kind, parts = tree
    found = [_joined(part, atoms) for part in parts]
    return all(found) if kind == "and" else any(found) if kind == "or" else not found[0]


def conditions(scene: Any, option: str, given: Any) -> list[Condition]:
    """The conditions `given` for an option (one or a list), which is named in messages; OptionError where one is no condition or
    reads an unknown sensor."""
    if given is None:
        return []
    if not isinstance(given, list | tuple):
        return [_read(scene, f"{option} = {shown(given)}", given)]
    head = f"{option} = {shown(given)}: {option}"
    return [_read(scene, f"{head}[{i}] = {shown(one)}", one) for i, one in enumerate(given)]


def ends_of_curves(scene: Any) -> list[Condition]:
    """Conditions under which a curve with outside="error", of a law or signal of a scene, is left; their names say which."""
    found = []
    for kind, item, value in stated_values(scene.connections, scene.signals):
        for table, x in timed.curves(value) if paths(value) else ():
            if table.outside == "error":
                low, high = float(table.t[0]), float(table.t[-1])
                at = signals.in_sensors(scene, x)
                over = _SENSOR.sub(lambda found: found[1], tables.readable(str(x)))
                name = f"{kind} '{item}' reads its curve over {over} beyond the points from {low:.6g} to {high:.6g}"
                found.append(Condition(name, (low - at, at - high), (False, False), (False, False), ("or", [0, 1])))
    return list({one.name: one for one in found}.values())


def _read(scene: Any, option_and_value: str, given: Any) -> Condition:
    """The condition `given`; option_and_value: with which messages begin."""
    try:
        e = _condition_of(scene, given)
        name = given if isinstance(given, str) else str(given)
        made = _Atoms()
        sides = _sides(scene, given)
        tree = made.tree(e) if sides is None else made.equation(*sides)
        for path in sorted({path for g in made.functions for path in paths(g)}):
            signals.check(scene, path)
    except (BadValueError, ValueError) as what_is_wrong:
        raise OptionError(f"{option_and_value}: {what_is_wrong}") from None
    functions = tuple(signals.in_sensors(scene, g) for g in made.functions)
    return Condition(name, functions, tuple(made.equations), tuple(made.meeting), tree)


def _condition_of(scene: Any, given: Any) -> Expr:
    """A condition as an expression of symengine."""
    if isinstance(given, bool | np.bool_):
        raise BadValueError(f"{given} is no condition (== of symbols is Python's own, which is {given} at once); write an "
                            f"equation as text, 'J.angle == 0', or as sympy.Eq(...)")
    if isinstance(given, str):
        e = text.whole(_with_symbols(scene, given))
    else:
        try:
            e = se.sympify(given)
        except Exception:  # SymPy and symengine raise errors of many types
            e = None
    if e is None or not is_condition(e):
        raise BadValueError(f"it is no comparison, nor And, Or or Not of comparisons; {EXAMPLE}")
    if e in (se.true, se.false):
        raise BadValueError(f"it does not depend on the motion or on time; {EXAMPLE}")
    return e


def _sides(scene: Any, given: Any) -> tuple[Any, Any] | None:
    """Left and right side of an equation in the order in which the user stated them, since symengine may exchange them; None
    where the condition is not a single equation."""
    if isinstance(given, str):
        try:
            left, right = (text.read(_with_symbols(scene, part)) for part in given.split("=="))
        except ValueError:  # the text is not of the form left == right
            return None
        return left, right
    return (given.lhs, given.rhs) if type(given).__name__ == "Equality" and hasattr(given, "lhs") else None


def _with_symbols(scene: Any, given: str) -> str:
    """The text with symbols of sensors in place of their paths."""
    known = {one.name for one in scene.signals}
    given, names = spelled(scene, given)
    given = _NORM.sub(lambda match: f"sqrt({' + '.join(f'{match[1]}[{i}]**2' for i in range(3))})", given)

    def name(match: re.Match[str]) -> str:
        head, dot, rest = match[0].partition(".")
        found = names.get(head, head) + dot + rest if not head.startswith("sensor(") else match[0]
        called = given[match.end() :].lstrip().startswith("(")
        is_path = "." in found or found in known
        return symbol_name(found) if is_path and not called and not found.startswith("sensor(") else found

    return _NAME.sub(name, given)


class _Atoms:
    """The comparisons of one condition, collected while it is read: functions, equations and meeting as in `Condition`."""

    def __init__(self) -> None:
        self.functions: list[Expr] = []
        self.equations: list[bool] = []
        self.meeting: list[bool] = []

    def tree(self, e: Expr) -> Any:
        """The tree of a condition as in `Condition`."""
        kind = type(e).__name__
        if kind in ("And", "Or", "Not"):
            return kind.lower(), [self.tree(part) for part in e.args]
        if kind not in CONDITIONS or kind == "Xor" or len(e.args) != 2:
            raise BadValueError(f"it contains {e}, which is no comparison; {EXAMPLE}")
        less, more = e.args
        if kind == "Unequality":
            return "not", [self._atom(more - less, True)]
        return self._atom(more - less, kind == "Equality", kind == "LessThan")  # symengine stores a > b as b < a

    def equation(self, left: Any, right: Any) -> int:
        """Add the equation left = right, whose function left - right rises where the left side does; returns its index."""
        return self._atom(left - right, True)

    def _atom(self, g: Expr, equation: bool, meeting: bool = True) -> int:
        self.functions.append(se.sympify(timed.expression(g, sensors=True)))
        self.equations.append(equation)
        self.meeting.append(equation or meeting)
        if not self.functions[-1].free_symbols:
            raise BadValueError(f"it does not depend on the motion or on time; {EXAMPLE}")
        return len(self.functions) - 1
