"""Rules of motion: axes, angles, velocities and their changes; reduction of l's equations to unknowns of k and the angle.

What a text assumes of its quantities (`x in (-1, 1)`, `l > r`, `u != 0`), which states of a comparison satisfy; what its
equations define, and whether they restrict a motion instead of holding for all.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from mbdae.audit.calculus import MOVING, NoRuleError, chain, exact, expanded
from mbdae.audit.evaluate import STEP, SizeError, Value, attempt
from mbdae.audit.laws import Rule, register
from mbdae.audit.motion import RandomMotion, axial
from mbdae.audit.notation import AuditError, Comparison, Node, TextReader, is_zero, symbol
from mbdae.audit.phrases import Env, Scope
from mbdae.symbolic.rebuild import complex_atan2

#: quantities that are never zero, mostly rotations, by their wording, with the rule that computes them
ROTATIONS: dict[str, Rule] = {
    "axis {i} of {side}": lambda env, i, side: env.motion.rotation(side)[:, [int(i) - 1]],
    "attitude of {side}": lambda env, side: env.motion.rotation(side),
    "Euler parameters of {side}": lambda env, side: env.motion.euler_parameters(side),
    "quaternion of {side}": lambda env, side: env.motion.euler_parameters(side),
    "rotation vector of {side}": lambda env, side: _rotation_vector(env.motion.euler_parameters(side)),
    "reference rotation of {side}": lambda env, side: env.motion.R0 + 0j,
    "rotation of {side} from its reference": lambda env, side: env.motion.rotation(side) @ env.motion.R0.T,
    "rotation of l relative to k": lambda env: env.motion.rotation("k").T @ env.motion.rotation("l"),
}
#: quantities that may be zero, by their wording, with the rule that computes them
QUANTITIES: dict[str, Rule] = {
    "relative angle": lambda env: env.motion.relative_angle(),
    "rate of the relative angle": lambda env: _angle_rate(env, 1),
    "second derivative of the relative angle": lambda env: _angle_rate(env, 2),
    "increment of the relative angle": lambda env: env.number("increment of the relative angle"),
    "relative angle before the increment": lambda env: (
        env.motion.relative_angle() - env.number("increment of the relative angle")),
    "angular velocity of {side}": lambda env, side: env.motion.of("w", side),
    "angular acceleration of {side}": lambda env, side: env.motion.of("alpha", side),
    "reference position of {side}": lambda env, side: env.motion.x0[side] + 0j,
    "position of {side}": lambda env, side: env.motion.of("x", side),
    "displacement of {side}": lambda env, side: env.motion.of("x", side) - env.motion.x0[side],
    "position of l relative to k": lambda env: env.motion.of("x", "l") - env.motion.of("x", "k"),
    "velocity of {side}": lambda env, side: env.motion.of("v", side),
    "acceleration of {side}": lambda env, side: env.motion.of("a", side),
    "virtual displacement of {side}": lambda env, side: env.changes("virtual", lambda e: e.motion.of("x", side)),
    "virtual rotation of {side}": lambda env, side: env.motion.turn_between(env.motion.moved("virtual"), side),
    "change of attitude of {side}": lambda env, side: env.motion.turn_between(env.motion.moved("linear"), side),
    "variation of the {quantity}": lambda env, quantity: env.changes("virtual", lambda e: e.of(quantity)),
    "change of the {quantity}": lambda env, quantity: env.changes("linear", lambda e: e.of(quantity)),
    "position of the section": lambda env: env.motion.section()[0],
    "attitude of the section": lambda env: env.motion.section()[1],
    "angular velocity of the section": lambda env: _spin(env, "time"),
    "curvature of the section": lambda env: _spin(env, "line"),
    "virtual displacement of the section": lambda env: env.changes("virtual", lambda e: e.motion.section()[0]),
    "virtual rotation of the section": lambda env: _spin(env, "virtual"),
}
#: quantities that the text alone defines, drawn at random by the name of their symbol
GIVEN: dict[str, Rule] = {
    "number": lambda env, name: env.number(f"number {name}"),
    "positive number": lambda env, name: env.positive(f"positive number {name}"),
    "angle": lambda env, name: env.number(f"angle {name}"),
    "time": lambda env, name: env.positive(f"time {name}") + env.motion.clock * env.size_of("time"),
    "vector": lambda env, name: env.drawn(f"vector {name}", env.motion.vector),
    "matrix": lambda env, name: env.drawn(f"matrix {name}", env.motion.matrix),
    "symmetric matrix": lambda env, name: env.motion.matrix(f"symmetric matrix {name}", symmetric=True) + 0j,
    "function of time": lambda env, name: env.drawn(f"function of time {name}", lambda key: _in_time(env, key)),
    "vector function of time": lambda env, name: (
        env.drawn(f"vector function of time {name}", lambda key: _in_time(env, key, (3, 1)))),
    "vector fixed in {side}": lambda env, name, side: env.motion.rotation(side) @ env.motion.vector(f"arm {name}"),
    "point fixed in {side}": lambda env, name, side: (
        env.motion.of("x", side) + env.motion.rotation(side) @ env.motion.vector(f"arm {name}")),
}


def _in_time(env: Env, key: str, shape: tuple[int, ...] = ()) -> Value:
    return env.motion.polynomial(key, env.motion.clock, shape)


def _angle_rate(env: Env, order: int) -> Value:
    """First or second time derivative of the relative angle: that of the coordinate, or of free bodies by complex steps."""
    if env.motion.joined and "angle" in env.motion.coordinates:
        return env.motion.coordinates["angle"][order]
    return env.changes("time", lambda e: e.motion.relative_angle() if order == 1 else _angle_rate(e, 1))


def _spin(env: Env, how: str) -> Value:
    """Axial vector of (dQ) Q^T, dQ the change of the section's attitude Q by the step `how`: angular velocity ("time"), curvature
    in inertial components ("line") or virtual rotation ("virtual")."""
    return axial(env.changes(how, lambda e: e.motion.section()[1]) @ env.motion.section()[1].T)


def _rotation_vector(P: Value) -> Value:
    sine = np.sqrt(np.sum(P[1:] * P[1:]))
    return P[1:] / sine * 2 * complex_atan2(sine, P[0, 0])


# -- the equations of motion of l in the unknowns of k and the relative angle

#: matrices of the equations of motion of l, in its own rotation or in that of k and the angle, by wording
MATRICES: dict[str, Rule] = {
    "inertia of l": lambda env: env.motion.matrix("inertia", symmetric=True) + 0j,
    "stiffness of l": lambda env: env.motion.matrix("stiffness") + 0j,
    "damping of l": lambda env: env.motion.matrix("damping") + 0j,
    "mass matrix of l in the unknowns of k and the angle": lambda env: _tangent(env, "alpha", "phiddot"),
    "damping matrix of l in the unknowns of k and the angle": lambda env: _tangent(env, "w", "phidot"),
}
FORCES: dict[str, Rule] = {
    "residual of l": lambda env: env.motion.ingredient("residual of l") + 0j,
    "right-hand side of l in motion": lambda env: MATRICES["inertia of l"](env) @ env.motion.of("alpha", "l"),
}


def _map(m: RandomMotion) -> Value:
    """B (3, 4) with w_l = B (w_k, dphi/dt): from the angular velocity of k and the rate of the angle to that of l. Virtual
    rotations obey the same map."""
    return np.hstack([m.still(rates[:3, None] + 0j, rates[3] + 0j).of("w", "l") for rates in np.eye(4)])


def _reduced(env: Env, m: RandomMotion) -> Value:
    """B^T r in a state m near that of env (B: `_map`); r is the residual of l in the state of env plus M, C and K times the
    changes of its angular acceleration, angular velocity and rotation from there to m."""
    base = env.motion
    M, C, K = (MATRICES[f"{name} of l"](env) for name in ("inertia", "damping", "stiffness"))
    r = FORCES["residual of l"](env) + M @ (m.of("alpha", "l") - base.of("alpha", "l")) + C @ (m.of("w", "l") - base.of("w", "l"))
    r = r + K @ base.turn_between(m, "l") * 1j * STEP
    return _map(m).T @ r


def _tangent(env: Env, of_k: str, of_angle: str) -> Value:
    """Derivative (4, 4) of the reduced residual by 3 components of k and one of the angle, by complex steps. of_k: "turn", "w" or
    "alpha"; of_angle: the same of the angle, "phi", "phidot" or "phiddot"."""
    stepped = [env.motion.stepped_by({f"{of_k} k": unit[:3, None], of_angle: unit[3]}) for unit in np.eye(4)]
    return np.hstack([np.imag(_reduced(env, m)) / STEP for m in stepped]) + 0j


register(ROTATIONS | MATRICES, vanishes=False)
register({"stiffness matrix of l in the unknowns of k and the angle": lambda env: _tangent(env, "turn", "phi")},
         vanishes=False, needs=(("r", "N m", "residual of l"),))
register(QUANTITIES | FORCES)
register({wording: rule for wording, rule in GIVEN.items() if "positive" not in wording}, given=True)
register({wording: rule for wording, rule in GIVEN.items() if "positive" in wording}, vanishes=False, given=True)


SAID = re.compile(r"<|>|!=|\bin\s*[(\[]")  #: what every assumption contains
TURN = 3.1  #: largest angle that is drawn, rad
_ENDLESS = symbol("inf")


@dataclass(frozen=True)
class Assumption:
    """One assumption: its text, and the comparisons that it consists of."""

    text: str
    parts: tuple[Comparison, ...]

    @property
    def names(self) -> frozenset[str]:
        """Names that appear."""
        return frozenset().union(*(n.free for a, _, b in self.parts for n in (a, b)))

    def holds(self, env: Env) -> bool:
        """Whether it holds in a state; False where one of its sides has no value."""
        return all(_holds(attempt(a, env), sign, attempt(b, env)) for a, sign, b in self.parts)

    def bounds(self, scope: Scope) -> dict[str, list[float]]:
        """Bounds, low and high, of numbers that are drawn at random, by the words of their meaning."""
        found: dict[str, list[float]] = {}
        for a, sign, b in self.parts:
            for side, other, end in ((a, b, 1 if "<" in sign else 0), (b, a, 0 if "<" in sign else 1)):
                meaning = scope.symbols.get(str(side))
                value = constant(other)
                if meaning is not None and meaning.phrase.given and value is not None and sign != "!=":
                    found.setdefault(meaning.text, [-np.inf, np.inf])[end] = value
        return found


def assumptions(text: str, line: int) -> list[Assumption]:
    """The assumptions of a text, separated by commas, semicolons or `and`; AuditError where one cannot be read."""
    pieces, depth, start = [], 0, 0
    for match in re.finditer(r"[(\[]|[)\]]|[,;]|\band\b", text + ";"):
        depth += (match[0] in "([") - (match[0] in ")]")
        if match[0] in (",", ";", "and") and not depth:
            pieces.append(text[start : match.start()].strip())
            start = match.end()
    if depth:
        raise AuditError(f"line {line}: a bracket of '{text}' is not closed")
    read = [(piece, TextReader(piece, line, relations=True).assumption()) for piece in filter(None, pieces)]
    return [Assumption(piece, tuple(c for c in parts if _ENDLESS.value not in c[0].free | c[2].free)) for piece, parts in read]


def bounds(assumed: Iterable[Assumption], scope: Scope, names: Iterable[str]) -> dict[str, tuple[float, float]]:
    """The bounds of several assumptions together; those of positive numbers begin at 0. Angles of either sign among the named
    quantities turn by nearly half a turn either way, so that a branch of an inverse function is not taken for all of it."""
    known = [m for n in sorted(names) if (m := scope.symbols[n]).phrase.given and "rad" in map(str, m.units)]
    found = {m.text: (-TURN, TURN) for m in known if m.phrase.wording in ("number", "angle", "function of time")}
    for one in assumed:
        for words, (low, high) in one.bounds(scope).items():
            old = found.get(words, (0.0 if words.startswith("positive") else -np.inf, np.inf))
            found[words] = max(old[0], low), min(old[1], high)
    return found


def _holds(a: Any, sign: str, b: Any) -> bool:
    if a is None or b is None:
        return False
    if sign == "!=":
        return bool(np.max(np.abs(np.asarray(a) - np.asarray(b))) > 0)
    if np.ndim(a) or np.ndim(b):
        raise SizeError(f"an assumption with '{sign}' compares numbers, not vectors or matrices: write norm(u) > 0, or u != 0")
    gap = float(np.real(np.asarray(b)) - np.real(np.asarray(a))) * (1 if "<" in sign else -1)
    return gap >= 0 if "=" in sign else gap > 0


def constant(node: Node) -> float | None:
    """The value of a formula of numbers alone; None where it has symbols."""
    if node.free - {"pi"}:
        return None
    value = attempt(node, _anywhere())
    return None if value is None or np.ndim(value) else float(np.real(value))


@lru_cache(maxsize=1)
def _anywhere() -> Env:
    return Env(RandomMotion(0), Scope({}))


# -- what an equation defines or restricts


def _given_numbers(names: Iterable[str], scope: Any) -> set[str]:
    known = {n: scope.symbols[n] for n in names if n in scope.symbols}
    return {n for n, m in known.items() if m.phrase.given and m.text.removesuffix(f" {n}") in ("number", "positive number")}


def defined_by(statement: Any, scope: Any) -> list[str]:
    """Symbols declared as mere numbers that are one side of the statement and appear on no other side: it defines them."""
    out = []
    for i, side in enumerate(statement.sides):
        others = scope.reached(set().union(*(s.free for j, s in enumerate(statement.sides) if j != i)))
        if side.kind == "symbol" and _given_numbers([side.value], scope) - others:
            out.append(side.value)
    return out


def law_of_motion(equation: Any) -> str:
    """Why an equation that does not hold for every motion may be right all the same: it says how free quantities move, and no
    side of it is a quantity that something else defines; empty where it has to hold for every motion, as all formulas that are
    not from a paper in TeX."""
    scope = equation.scope
    given = {n for n in equation.used if scope.symbols[n].phrase.given}
    if not equation.place or equation.quantity is not None or any(scope.symbols[n].letter == "0" for n in equation.used):
        return ""
    for statement in equation.statements:
        rates = [piece for side in statement.sides for piece in side.walk() if piece.kind == "call" and piece.value == "rate"]
        reached = scope.reached(set().union(*(r.free for r in rates)))
        moving = sorted(n for n in reached if scope.symbols[n].phrase.wording in MOVING)
        defined = [s for s in statement.sides if s.free & set(scope.symbols) and (
            not s.free & given or (s.kind in _WHOLE and s.free - given - {"pi", "I"}))]
        changes = [s for s in statement.sides if any(_changes(term, given, scope) for term in _terms(s))]
        named = any(s.kind == "symbol" and s in defined for s in statement.sides)  # M = ..., where the table says what M is
        if moving and not named and (changes or not defined) and not _worked_out(statement, changes, scope):
            return (f"it says how {moving[0]} moves, and nothing else does: tell in the table what its left-hand side less its "
                    f"right-hand side is, as `equation {equation.number} [unit]: formula`")
    return ""


def _terms(node: Node) -> list[Node]:
    return [t for p in node.parts for t in _terms(p)] if node.kind in ("sum", "neg") else [node]


def _changes(term: Node, given: set[str], scope: Any) -> bool:
    """Whether a term is the rate of a momentum or an energy."""
    names = term.free & set(scope.symbols)
    return term.kind == "call" and term.value == "rate" and bool(names - given) and any(
        u.powers[1] for n in names for u in scope.symbols[n].units)


def _worked_out(statement: Any, changes: list[Node], scope: Any) -> bool:
    """Whether a statement works out the rate of a quantity instead of saying how it changes: nothing stands on its other sides
    that does not appear in that rate, as a force would, and no accelerations are missing there, which a law of motion gives."""
    def known(node: Node) -> tuple[set[str], int]:
        chains = filter(None, (chain(n) for n in node.walk()))
        return set(node.free) - {"pi", "I"}, max((order for _, order in chains), default=0)

    for side in changes:
        worked = not any(n.kind == "call" and n.value == "diff" for n in side.walk())
        whole = exact(side, scope) if worked else None
        with suppress(NoRuleError, RecursionError):
            others = [expanded(s, scope) for s in statement.sides if s is not side]
            if whole is None or any(is_zero(o) or o.kind == "number" for o in others):
                continue
            names, order = known(whole)
            if all(n <= names and o == order for n, o in map(known, others)):
                return True
    return False


_WHOLE = ("call", "power", "symbol", "transposed", "cross")  #: sides that are one quantity, if something else defines it


def may_define(statement: Any, scope: Any) -> list[tuple[str, list[Any]]]:
    """Symbols declared as mere numbers that a statement may define, as f in w = 2 pi f: some sides contain them, by nothing else
    that the side prints, and others do not. With each, the statements that have to hold then: of those, and of the others."""
    out = dict[str, list[Any]]()
    if any(map(is_zero, statement.sides)) or any(m.letter == "0" for n, m in scope.symbols.items() if n in statement.symbols()):
        return []
    for side in statement.sides:
        for name in _given_numbers(side.free, scope):
            parts = [tuple(s for s in statement.sides if (name in scope.reached(s.free)) == own) for own in (True, False)]
            if all(parts) and name not in scope.reached(side.free - {name}):
                out[name] = [replace(statement, sides=part) for part in parts]
    return sorted(out.items(), key=lambda found: (len(found[1][0].sides), found[0]))
