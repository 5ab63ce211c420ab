"""The smallest repair of a printed formula: one change, else two, after which its sides agree; or the term it lacks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbdae.reports.audit.compare import SAME, States, compared, difference
from mbdae.reports.audit.edits import Candidates, Edit, additions, applied, edits, everywhere, supplements
from mbdae.reports.audit.evaluate import SizeError, Value, evaluate
from mbdae.reports.audit.meaning import Env, Scope
from mbdae.reports.audit.notation import Node, Statement, symbol
from mbdae.reports.audit.reading import Printed

LARGEST = 20_000  #: formulas tried for one place with two changes


@dataclass(frozen=True)
class Repair:
    """What to change, in words, and the equation afterwards."""

    words: tuple[str, ...]
    equation: Printed

    def __str__(self) -> str:
        return "; ".join(self.words)


def repair(equation: Printed, states: States) -> Repair | None:
    """The smallest change that makes an equation right: of the printed roles, else of its formulas."""
    other = _other_roles(equation, states)
    if other is not None:
        return other
    used = set().union(*(s.symbols() for s in equation.statements)) - {"I"}
    scope = equation.scope.widened(used)
    wide = replace(equation, scope=scope)
    states = States(wide, states.inner, states.side, shared=states.shared)
    words: list[str] = []
    statements, known = [], list[Edit]()
    for statement in equation.statements:
        found = (statement, []) if compared(statement, states).same else _statement(statement, states, known)
        if found is None:
            return None
        statements.append(found[0])
        known += found[1]
        words += [e.words for e in found[1] if e.words not in words]
    return Repair(tuple(words), replace(wide, statements=tuple(statements)))


def _other_roles(equation: Printed, states: States) -> Repair | None:
    """The same formulas with the other body in the role of the inner race."""
    if equation.inner is None:
        return None
    inner = "l" if equation.inner == "k" else "k"
    other = replace(equation, inner=inner)
    turned = States(other, inner, states.side, shared=states.shared)
    if not all(compared(s, turned).same for s in equation.statements):
        return None
    return Repair((f"the roles of the races exchanged: {equation.inner} is the outer, {inner} the inner one",), other)


Found = tuple[Statement, list[Edit]]
Changed = tuple[Node, list[Edit]]


def _statement(statement: Statement, states: States, known: Sequence[Edit]) -> Found | None:
    """The repair with the fewest changes of one statement."""
    best: Found | None = None
    for i, envs, targets in _places(statement, states):
        found = _side(statement.sides[i], envs, targets, states, known)
        if found is not None and (best is None or len(found[1]) < len(best[1])):
            sides = (*statement.sides[:i], found[0], *statement.sides[i + 1 :])
            tried = replace(statement, sides=sides)
            if len(set(sides)) == len(sides) and compared(tried, states).same:
                best = tried, found[1]
    return best


def _places(statement: Statement, states: States) -> Iterator[tuple[int, list[Env], list[Value]]]:
    """Sides that may be changed, with the states and the values they must take."""
    said = states.equation.said if statement is states.equation.statements[0] else None
    order = sorted(range(len(statement.sides)), key=lambda i: statement.sides[i].kind == "symbol")  # bare symbols last
    for envs in [states.free] if states.equation.only else [states.free, states.joint]:
        for i in order:
            if statement.sides[i].kind == "number":
                continue
            try:
                targets = [said.value(e) if said else evaluate(statement.sides[0 if i else 1], e) for e in envs]
            except SizeError:
                continue
            if max(float(np.max(np.abs(t))) for t in targets) > 1e-9:
                yield i, envs, targets


def _side(side: Node, envs: list[Env], targets: list[Value], states: States, known: Sequence[Edit]) -> Changed | None:
    """A side changed so that it takes its values; a column of blocks row by row."""
    rows = side.parts
    height = len(rows) and targets[0].shape[0] // len(rows) if side.kind == "block" and np.ndim(targets[0]) else 0
    if not (height and len(rows) > 1 and all(len(r.parts) == 1 for r in rows) and targets[0].shape == (height * len(rows), 1)):
        return _node(side, envs, targets, states, known)
    new, done = [], list[Edit]()
    for i, row in enumerate(rows):
        parts = [t[i * height : (i + 1) * height] for t in targets]
        if height == 1:
            parts = [p[0, 0] for p in parts]
        found = _node(row.parts[0], envs, parts, states, [*known, *done])
        if found is None:
            return None
        new.append(row.with_parts((found[0],)))
        done += [e for e in found[1] if e not in done]
    return side.with_parts(tuple(new)), done


def _fits(node: Node, envs: list[Env], targets: list[Value]) -> bool:
    try:
        with np.errstate(all="ignore"):
            return all(difference(evaluate(node, env), target) < SAME for env, target in zip(envs, targets, strict=True))
    except SizeError:
        return False


def _sized(node: Node, env: Env, target: Value) -> bool:
    try:
        with np.errstate(all="ignore"):
            return np.shape(evaluate(node, env)) == np.shape(target)
    except SizeError:
        return False


def _node(node: Node, envs: list[Env], targets: list[Value], states: States, known: Sequence[Edit]) -> Changed | None:
    """A formula changed so that it takes its values: not, as elsewhere in the equation, once, twice."""
    if _fits(node, envs, targets):
        return node, []
    if known:
        again = node
        for edit in known:
            again = applied(edit, again)
        if again != node and _fits(again, envs, targets):
            return again, list(known)
    candidates = Candidates(states.equation.scope, envs[0])
    once = dict[Node, Edit]()
    for edit, new in edits(node, candidates):
        if new not in once and new != node:
            once[new] = edit
            if _fits(new, envs, targets):
                return new, [edit]
    for edit, new in additions(node, candidates):
        if _fits(new, envs, targets):
            return new, [edit]
    found = _twice(node, once, envs, targets, candidates)
    if found is not None:
        return found
    for edit, new in supplements(node, candidates):
        if _fits(new, envs, targets):
            return new, [edit]
    return None


def _twice(node: Node, once: dict[Node, Edit], envs: list[Env], targets: list[Value],
           candidates: Candidates) -> Changed | None:  # fmt: skip
    """Two changes; both of all places alike, then those whose first one is such or leaves sizes that fit."""
    order = sorted(once, key=lambda n: (not once[n].table, not _sized(n, envs[0], targets[0])))
    if not _sized(node, envs[0], targets[0]):  # one of the two changes is one of sizes: take it first
        order = [n for n in order if once[n].resizes]
    tried: set[Node] = set(once)
    for alike in (True, False):
        for first in order:
            if alike and not once[first].table:
                break
            for edit, new in (everywhere if alike else edits)(first, candidates):
                if new in tried:
                    continue
                tried.add(new)
                if len(tried) > LARGEST:
                    return None
                if _fits(new, envs, targets):
                    return new, [once[first], edit]
    return None


# -- a term that is missing


def missing_term(equation: Printed, states: States, scope: Scope, name: str) -> Repair | None:
    """The block, linear in a symbol the text lacks, that the last side of an equation has to be completed by."""
    (statement,) = equation.statements
    wide = replace(equation, scope=scope)
    envs = States(wide, states.inner, states.side, shared=states.shared).joint
    gaps = [evaluate(statement.sides[0], e) - evaluate(statement.sides[-1], e) for e in envs]
    if np.ndim(gaps[0]) == 0:
        return None
    where = np.argwhere(np.max([np.abs(g) for g in gaps], axis=0) > 1e-9)
    (top, left), (bottom, right) = where.min(axis=0), where.max(axis=0) + 1
    blocks = [g[top:bottom, left:right] for g in gaps]
    for term in _terms(name, scope, envs[0]):
        if _fits(term, envs, blocks):
            place = f"{_range('row', top, bottom)} and {_range('column', left, right)}"
            return Repair((f"the term {term} in {place} is missing",), equation)
    return None


def _range(what: str, first: int, last: int) -> str:
    return f"{what} {last}" if last == first + 1 else f"{what}s {first + 1} to {last}"


def _terms(name: str, scope: Scope, env: Env) -> Iterator[Node]:
    """Terms linear in a vector: itself, its product with a vector, both transposed, both signs."""
    r = symbol(name)
    crossed = [Node("product", None, (Node("cross", None, (symbol(other),)), r)) for other in scope.symbols
               if np.shape(env.value(other)) == (3, 1)]  # fmt: skip
    for term in [r, *crossed]:
        for shown in (term, Node("transposed", None, (term,))):
            yield from (shown, Node("neg", None, (shown,)))
