"""Where a formula holds: conditions under which its sides are real and finite, and where it says nothing although it should."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mbdae.audit.assumptions import constant
from mbdae.audit.compare import SAME, States, difference
from mbdae.audit.evaluate import NO_VALUE, PARTIAL, OutsideError, attempt, evaluate
from mbdae.audit.laws import derived
from mbdae.audit.left_out import may_vanish
from mbdae.audit.notation import Node, is_zero, symbol
from mbdae.audit.phrases import PARAMETER, Definition, Env
from mbdae.audit.reading import Printed
from mbdae.errors import MbdaeError

SCANNED = 24  #: random states that are tried for a condition which some of them violate
FEW = 4  #: violations of a condition up to which it is by accident that they are violations of another one too
#: functions with several inverses, of which a formula takes one: it then holds on a part of the states only
BRANCHES = ("sqrt", "asin", "acos", "atan", "atan2", "acosh", "norm")
LEAST = 3  #: number of states, of 16, in which a formula holds, or does not, so that it holds on a part of them


@dataclass(frozen=True)
class Domain:
    """Where a formula that is right holds. said: conditions in words, those of the text first; gap: a quantity at whose zero the
    formula is undefined, although what it stands for is not; both "" where there is none."""

    said: str
    gap: str = ""


def domain(equation: Printed, states: States) -> Domain:
    """The domain of an equation: conditions that every state satisfies are not said."""
    violated, signs = dict[str, set[int]](), dict[str, set[bool]]()
    for seed in range(SCANNED) if any(_partial(n) for n in _pieces(equation)) else ():
        conditions, here = set[str](), dict[str, set[bool]]()
        real = states.real(replace(states.env(equation.states, seed), watch=here), conditions)
        for text in conditions:
            violated.setdefault(text, set()).add(seed)
        for text in here if all(real) else ():
            signs[text] = signs.get(text, set()) | here[text]
    found = [*(one.text for one in equation.assumed), *_apart(violated)]
    zeros, env = {text for text, both in signs.items() if len(both) > 1}, states.joint[0]
    for name in sorted(equation.scope.reached(equation.used)):
        undefined = _at_zero(equation, env, name)
        if undefined == "gap":
            return Domain("", name)
        zeros |= {name} if undefined and f"{name} > 0" not in found else set()
    return Domain(" and ".join(dict.fromkeys([*found, *(f"{text} != 0" for text in sorted(zeros))])))


def _apart(violated: dict[str, set[int]]) -> list[str]:
    """The conditions without those that follow from another one in the states tried, intervals and short ones first."""
    kept: list[str] = []
    for text in sorted(violated, key=lambda t: (-len(violated[t]), " in (" not in t, len(t))):
        few, seeds = len(violated[text]) < FEW, violated[text]
        if not any(seeds == violated[o] or (not few and seeds <= violated[o]) for o in kept):
            kept.append(text)
    return kept


def _partial(node: Node) -> bool:
    return node.kind in PARTIAL or (node.kind == "call" and node.value in PARTIAL)


def _branched(node: Node) -> bool:
    """Whether a piece is one of several branches: such a function, or a power whose exponent is a fraction."""
    exponent = constant(node.parts[1]) if node.kind == "power" else None
    return (exponent is not None and not exponent.is_integer()) or (node.kind == "call" and node.value in BRANCHES)


def _pieces(equation: Printed) -> Iterator[Node]:
    """All pieces of the formulas and of the definitions that they need."""
    symbols = equation.scope.symbols
    known = (symbols[n] for n in sorted(equation.scope.reached(equation.used)))
    for node in (*(side for s in equation.statements for side in s.sides), *(m.node for m in known if isinstance(m, Definition))):
        yield from node.walk()


def _at_zero(equation: Printed, env: Env, name: str) -> str:
    """What is undefined where a quantity is zero: "" nothing, or the text excludes it; "formula" the formula; "gap" the formula,
    while what it stands for has a value there."""
    symbols = equation.scope.symbols
    meaning, zero = symbols[name], replace(env, zero=name, store={})
    if isinstance(meaning, Definition) or not may_vanish(meaning, equation.scope.own):
        return ""
    if not all(one.holds(zero) for one in equation.assumed):
        return ""
    undefined = False
    for statement in equation.statements:
        finite = [is_zero(side) or _finite(side, zero) for side in statement.sides]
        if None in finite:
            return ""  # said by the condition of a function
        if all(finite):
            continue
        undefined = True
        # a quantity that the laws or the motion of bodies define has a value, unless its law says that it has none there
        if name in statement.symbols() and any(f and _valued(equation, side.free - {name} if side.parts else side.free)
                                               for f, side in zip(finite, statement.sides, strict=True)):  # fmt: skip
            return "gap"
    return "formula" if undefined else ""


def _valued(equation: Printed, names: frozenset[str]) -> bool:
    """Whether one of the named quantities has a value in all positions: a parameter, or one whose law says nothing else."""
    found = [m for n in names if (m := equation.scope.symbols.get(n)) and not (isinstance(m, Definition) or m.phrase.given)]
    laws = [{w for w in m.words if isinstance(w, str)} if not PARAMETER.match(m.text) else set() for m in found]
    return bool(found) and not any(_undefined(law, equation) for words in laws for law in words)


def _undefined(law: str, equation: Printed) -> bool:
    """Whether the law of this name says that it is undefined in some positions."""
    try:
        return bool(derived(law, equation.scope.own).law.undefined_at())
    except (*NO_VALUE, MbdaeError, AttributeError, KeyError, TypeError):
        return False


def _finite(side: Node, env: Env) -> bool | None:
    """Whether a side is finite in a state; None where it is not real."""
    try:
        with np.errstate(all="ignore"):
            return bool(np.all(np.isfinite(np.asarray(evaluate(side, env), dtype=complex))))
    except OutsideError:
        return None
    except NO_VALUE:
        return False


def in_part(equation: Printed, states: States) -> str:
    """The condition under which a formula with functions of several branches holds, where that is a part of the states tried; ""
    where it holds in none, or in all."""
    if not any(map(_branched, _pieces(equation))) or len(equation.statements) > 1:
        return ""
    envs = states.many if equation.states == "free" else states.many_joint
    values = [[attempt(side, env) for side in equation.statements[0].sides] for env in envs]
    if any(v is None for row in values for v in row):
        return ""
    holds = np.array([all(difference(row[0], v) < SAME for v in row[1:]) for row in values])
    if not LEAST <= np.sum(holds) <= len(envs) - LEAST:
        return ""
    pieces = {*_pieces(equation)}
    pieces |= {Node("call", name, n.parts) for n in pieces if n.value in ("sin", "cos", "tan") for name in ("sin", "cos")}
    other = [symbol(name) for name in equation.scope.symbols]
    for node in (*equation.statements[0].sides, *sorted(pieces, key=lambda n: (len(str(n)), str(n))), *other):
        found = [attempt(node, env) for env in envs] if node.kind != "row" else [None]
        if all(v is not None and np.ndim(v) == 0 for v in found):
            above = np.real(np.array(found, dtype=complex)) > 0
            if np.all(above == holds) or np.all(above != holds):
                return f"{node} {'>' if above[np.argmax(holds)] else '<'} 0"
    return "some states only"
