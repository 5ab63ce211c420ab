"""Remarks to a verdict: other solutions, resultants away from the joint, tensile contact, energy gain, redefined letters; what a
text leaves out, and where a formula holds."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mbdae.audit.compare import SAME, ComparedStates, compared, difference, vanishing
from mbdae.audit.evaluate import NO_VALUE, PARTIAL, OutsideError, Value, attempt, evaluate
from mbdae.audit.laws import PARAMETER, WITH_COORDINATES, Own, derived, law_class, part_class
from mbdae.audit.motion import turned
from mbdae.audit.notation import Node, Relation, is_zero, symbol
from mbdae.audit.phrases import Definition, Env, Meaning
from mbdae.audit.reading import Printed
from mbdae.audit.rules_contact import energy_fed
from mbdae.audit.rules_laws import names
from mbdae.audit.rules_motion import constant
from mbdae.errors import MbdaeError
from mbdae.symbolic.line import LineLaw
from mbdae.symbolic.part import Part

# -- Parameters of laws that a text does not declare: those without effect at zero, and those for which a law refuses zero


#: parameters of every constraint row, with the values at which the force of the row is its multiplier lambda
OF_ROWS = {"scaling": 1.0, "penalty": 0.0}


def refuses_zero(parameter: str, of: str, own: Own = ()) -> bool:
    """Whether the law named `of` accepts 1 but not 0 as a value of a parameter. own: the user's laws."""
    cls: Any = part_class(of, own) or law_class(of, own)

    def taken(value: float) -> bool:
        head = () if issubclass(cls, Part) else ("audited", None, None)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                cls(*head, **dict.fromkeys(cls.params, 1.0) | {parameter: value})
            except (MbdaeError, TypeError):
                return False
        return True

    return cls is not None and parameter in cls.params and taken(1.0) and not taken(0.0)


def may_vanish(meaning: Meaning, own: Own) -> bool:
    """Whether a quantity may be zero in a state that the text speaks of."""
    parameter = PARAMETER.match(meaning.text)
    return meaning.phrase.vanishes and not (parameter and refuses_zero(parameter[1], parameter[2], own))


def left_out(equation: Printed, states: ComparedStates, laws: set[str]) -> Mapping[str, float]:
    """The smallest set of parameters ("damping of PointSpring") that the text declares nowhere and without whose effect both
    sides agree, each with the value at which it has no effect; empty if none. A set with
    which a quantity of the text vanishes does not count, since the agreement then says nothing.

    laws: words of the meanings, among them the names of laws."""
    open_ = _open(equation, laws)

    def agree(values: Mapping[str, float]) -> bool:
        found = replace(states, neutral=tuple((n.partition(" of ")[0], v) for n, v in values.items()))
        return all(compared(s, found).same for s in equation.statements) and not vanishing(equation.used, states, found)

    if open_ and agree(open_):
        for name in list(open_):
            fewer = {n: v for n, v in open_.items() if n != name}
            open_ = fewer if fewer and agree(fewer) else open_
        return open_
    return next(({n: v} for n, v in open_.items() if agree({n: v})), {})


def _open(equation: Printed, laws: set[str]) -> dict[str, float]:
    """Parameters that the text declares for no law, each with the value at which it has no effect."""
    own = equation.scope.own
    declared = {match[1] for text in equation.scope.texts if (match := PARAMETER.match(text))}
    found: dict[str, float] = {}
    for name in sorted(laws):
        cls = part_class(name, own) or law_class(name, own)
        if cls is None or issubclass(cls, LineLaw):
            continue
        plain = name.removesuffix(WITH_COORDINATES)
        values = {p: 0.0 for p in cls.params if not refuses_zero(p, plain, own)} | ({} if issubclass(cls, Part) else OF_ROWS)
        found |= {f"{p} of {plain}": value for p, value in values.items() if p not in declared}
    return found


# -- Where a formula holds: conditions under which its sides are real and finite, and where it says nothing although it should


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


def domain(equation: Printed, states: ComparedStates) -> Domain:
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
                                               for f, side in zip(finite, statement.sides, strict=True)):
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


def in_part(equation: Printed, states: ComparedStates) -> str:
    """The condition under which a formula with functions of several branches holds, where that is a part of the states tried; ""
    where it holds in none, or in all."""
    if not any(map(_branched, _pieces(equation))):
        return ""
    envs = states.many if equation.states == "free" else states.many_joint
    values = [[[attempt(side, env) for side in s.sides] for s in equation.statements] for env in envs]
    if any(v is None for rows in values for row in rows for v in row):
        return ""
    holds = np.array([all(difference(row[0], v) < SAME for row in rows for v in row[1:]) for rows in values])
    if not LEAST <= np.sum(holds) <= len(envs) - LEAST:
        return ""
    pieces = {*_pieces(equation)}
    pieces |= {Node("call", name, n.parts) for n in pieces if n.value in ("sin", "cos", "tan") for name in ("sin", "cos")}
    other = [symbol(name) for name in equation.scope.symbols]
    sides = [side for s in equation.statements for side in s.sides]
    for node in (*sides, *sorted(pieces, key=lambda n: (len(str(n)), str(n))), *other):
        found = [attempt(node, env) for env in envs] if node.kind != "row" else [None]
        if all(v is not None and np.ndim(v) == 0 for v in found):
            above = np.real(np.array(found, dtype=complex)) > 0
            if np.all(above == holds) or np.all(above != holds):
                return f"{node} {'>' if above[np.argmax(holds)] else '<'} 0"
    return "some states only"


#: rad; a constraint has a second solution if it still holds after l is turned about one of its axes by HALF, but not by SOME
HALF, SOME = np.pi, 0.4
FAST = -100.0  #: rate of penetration of bodies that separate fast, m/s


def remarks(equation: Printed, states: ComparedStates) -> list[str]:
    """Remarks on a formula that is right as it is printed."""
    try:
        found = [r for rule in (_solutions, _balance, _pull, _energy) for r in rule(equation, states)]
    except NO_VALUE:
        found = []
    return found + [f"{n} meant something else before: {was}" for n, was in sorted(equation.before.items())
                    if n in equation.used]


# -- other solutions of a constraint


def _solutions(equation: Printed, states: ComparedStates) -> Iterator[str]:
    """Remark on a constraint that also holds where l is turned by half a turn about one of its axes, but not by less."""
    sides = [s.subject for s in equation.statements if s.ends_at_zero]
    if not sides or equation.states == "free":
        return
    meaning = equation.scope.symbols.get(str(sides[0]))
    stated = equation.statements[0].compared
    judged = stated[1] if meaning and len(stated) > 1 else sides[0]
    axes = [i + 1 for i in range(3) if _size(judged, states, i, HALF) < SAME < _size(judged, states, i, SOME)]
    if axes:
        about = ", ".join(map(str, axes))
        yield f"vanishes too where l is turned by half a turn about its axis {about}, which the text does not exclude"


def _size(side: Node, states: ComparedStates, axis: int, angle: float) -> float:
    """Largest value of a side in states of the joint after a turn of l about one of its axes."""
    worst = 0.0
    for env in states.joint[:2]:
        motion = copy(env.motion)
        motion.memory = {"l": {**env.motion._l(), "Q": env.motion.rotation("l") @ turned(angle * np.eye(3)[:, [axis]])}}
        worst = max(worst, float(np.max(np.abs(evaluate(side, replace(env, motion=motion, store={}))))))
    return worst


# -- forces


def _balance(equation: Printed, states: ComparedStates) -> Iterator[str]:
    """Remark on forces on both bodies whose resultant is zero only where the joint connects the bodies."""
    for statement in equation.statements:
        meaning = equation.scope.symbols.get(str(statement.sides[0]))
        if meaning and meaning.phrase.side == "left" and not equation.only:
            parts = names(meaning.words[-1])
            if {p.split()[1] for p in parts} == {"k", "l"} and _resultant(statement, parts, states.free[0]) > 1e-6:
                yield "action and reaction leave a resultant where the bodies are not joined exactly"


def _resultant(statement: Relation, parts: list[str], env: Env) -> float:
    values = np.split(np.real(evaluate(statement.sides[-1], env)), len(parts))
    on = dict(zip(parts, values, strict=True))
    force = sum((v for p, v in on.items() if p.startswith("move")), np.zeros((3, 1)))
    arms = {p: np.real(env.motion.of("x", p.split()[1])) for p in on}
    moment = sum((v if p.startswith("turn") else np.cross(arms[p], v, axis=0) for p, v in on.items()), np.zeros((3, 1)))
    return float(max(np.max(np.abs(force)), np.max(np.abs(moment))))


def _of(equation: Printed, wording: str) -> Iterator[tuple[Relation, Meaning]]:
    """Statements whose first side is a symbol with that kind of meaning, and the meaning."""
    for statement in equation.statements:
        meaning = equation.scope.symbols.get(str(statement.sides[0]))
        if meaning and meaning.phrase.wording == wording:
            yield statement, meaning


def _pull(equation: Printed, states: ComparedStates) -> Iterator[str]:
    """Remark on a normal force that becomes tensile where bodies separate fast."""
    for wording in ("normal force of {name}", "damping force of {name}"):
        for statement, meaning in _of(equation, wording):
            fast = replace(states.free[0], shifts=(("rate of penetration", 0, FAST, 0, 0j),), store={})
            elastic: Value = fast.of(f"elastic force of {meaning.words[0]}") if wording.startswith("damping") else 0.0
            if np.real(evaluate(statement.sides[1], fast) + elastic) < 0:
                yield "pulls where the bodies separate fast: contact has to end where the force falls to 0"


def _energy(equation: Printed, states: ComparedStates) -> Iterator[str]:
    """Remark on a friction law with an internal state that may supply energy."""
    for wording, varying in (("coefficient of {name}", False), ("friction force of {name}", True)):
        for _, meaning in _of(equation, wording):
            found: Any = energy_fed(states.free[0], meaning.words[0])
            if found is None:
                continue
            if varying:
                yield "the energy stored in the deflection grows with the normal force: dissipative only for a constant one"
            elif found > 0:
                yield f"feeds energy above a sliding speed, here {found:.3g} m/s"
