"""Search for the smallest repair of a printed formula: one change, else two, or a missing term, after which its sides agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from mbdae.audit import notation
from mbdae.audit.compare import SAME, STATES, ComparedStates, compared, difference
from mbdae.audit.edits import BELOW, Candidates, Edit, applied, edits, everywhere, faults, supplements, united
from mbdae.audit.evaluate import SizeError, Value, attempt, evaluate
from mbdae.audit.fits import Fit, factors, terms, wrapped
from mbdae.audit.notation import BINDING, Node, Relation, made, symbol
from mbdae.audit.phrases import Env, Scope
from mbdae.audit.reading import Printed

COLUMNS = 12  #: largest number of vectors and matrices of which products are tried as missing terms
LEVELS = (0, 1, 2)  #: stages of the search: single small changes; missing factors and terms; two changes
PLAIN = 1.6  #: a single change of at most this rank (`Edit.size`) is the repair; above it missing factors are tried too
#: where units do not fit: a side that is a single symbol is not changed if another side is repaired by a change of at most this
#: rank
NEAR = 1.85
LARGEST = 20_000  #: the search for two changes of a formula gives up after this many formulas


@dataclass(frozen=True)
class Repair:
    """A repair: the changes in words, and the equation after them."""

    words: tuple[str, ...]
    equation: Printed
    tex: str = ""  #: the changes in TeX, in the letters of the text
    accents: bool = False  #: whether all changes are tildes and transpositions
    below: bool = False  #: whether all that changes is how much of a product a fraction has below its line

    def __str__(self) -> str:
        return "; ".join(self.words)


def repair(equation: Printed, states: ComparedStates) -> Repair | None:
    """The smallest change after which an equation is right: exchanged roles of the races, else a change of its formulas."""
    other = _other_roles(equation, states)
    if other is not None:
        return other
    wide = replace(equation, scope=equation.scope.widened(equation.used))
    states = replace(states, equation=wide)
    done: list[Edit] = []
    statements, known = [], list[Edit]()
    for statement in equation.statements:
        found = (statement, []) if compared(statement, states).same else _statement(statement, states, known)
        if found is None:
            return None
        statements.append(found[0])
        known += found[1]
        done += [e for e in found[1] if e.words not in [d.words for d in done]]
    tex = "; ".join(e.tex(wide.scope.letters) for e in done)
    return Repair(tuple(e.words for e in done), replace(wide, statements=tuple(statements)), tex, all(e.accent for e in done),
                  all(e.form == BELOW for e in done))


def _other_roles(equation: Printed, states: ComparedStates) -> Repair | None:
    """The equation with the other body in the role of the inner race, if it is right then; None otherwise."""
    if equation.inner is None:
        return None
    inner = "l" if equation.inner == "k" else "k"
    other = replace(equation, inner=inner)
    turned = replace(states, equation=other, inner=inner)
    if not all(compared(s, turned).same for s in equation.statements):
        return None
    return Repair((f"the roles of the races exchanged: {equation.inner} is the outer, {inner} the inner one",), other)


Corrected = tuple[Relation, list[Edit]]
Changed = tuple[Node, list[Edit]]


@dataclass(frozen=True)
class _Goal:
    """Values that a formula must have in some states, without becoming equal to another side (a = a shows nothing)."""

    envs: Sequence[Env]
    values: Sequence[Value]
    banned: frozenset[Node] = frozenset()

    def met(self, node: Node) -> bool:
        """Whether a formula has the values in all states in which it is real."""
        if notation.is_zero(node):
            return max(float(np.max(np.abs(v))) for v in self.values) < SAME
        if node in self.banned:
            return False
        inside = 0
        for env, wanted in zip(self.envs, self.values, strict=True):
            found = attempt(node, env, outside=self)
            if found is None or (found is not self and difference(found, wanted) >= SAME):
                return False
            inside += found is not self
        return inside >= min(STATES, len(self.envs))

    def sized(self, node: Node) -> bool:
        """Whether a formula has the size (rows, columns) of the values."""
        found = attempt(node, self.envs[0])
        return found is not None and np.shape(found) == np.shape(self.values[0])

    def mended(self, node: Node, new: Node) -> bool:
        """Whether a changed formula that has the values can be what was meant.

        Its sums must have units wherever those of the original have, and no new piece may be without effect."""
        if self._idle(new) - self._idle(node):
            return False
        return united(new, self.envs[:2]) or not united(node, self.envs[:2])

    def _idle(self, node: Node) -> set[Node]:
        """Function calls with the same value in all states, such as derivatives of constants, and inner sums that are 0."""
        return {n for n in node.walk() if (n.kind == "call" and n.value not in BINDING and self._same(n, 1))
                or (n.kind == "sum" and n is not node and self._same(n, 0))}

    def _same(self, node: Node, factor: int) -> bool:
        """Whether a formula has in all states its value in the first one (factor 1), or is 0 in all (factor 0)."""
        values = [attempt(node, e) for e in self.envs]
        return all(v is not None and values[0] is not None and difference(v, factor * values[0]) < SAME for v in values)

    def rows(self, count: int) -> list[_Goal]:
        """Goals for the rows of a column made of `count` equal blocks; empty where the values are no such column."""
        shape = np.shape(self.values[0])
        height = shape[0] // count if len(shape) == 2 and shape[1] == 1 else 0
        if not height or shape[0] != height * count:
            return []
        parts = [[v[i * height : (i + 1) * height] for v in self.values] for i in range(count)]
        return [_Goal(self.envs, [v[0, 0] for v in p] if height == 1 else p) for p in parts]


def _statement(statement: Relation, states: ComparedStates, known: Sequence[Edit]) -> Corrected | None:
    return next(filter(None, (_at_level(statement, states, known, level) for level in LEVELS)), None)


def _at_level(statement: Relation, states: ComparedStates, known: Sequence[Edit], level: int) -> Corrected | None:
    best: Corrected | None = None
    envs: Sequence[Env] = ()
    misfit = bool(faults(statement, states.free[:2]))
    for i, goal in _places(statement, states):
        least = (1, PLAIN) if statement.sides[i].kind != "symbol" else (1, NEAR) if misfit else (3, 0)
        if best is not None and (_extent(best[1]) <= least or goal.envs is not envs):
            break  # the repair ranks low enough, or only the states of the joint are left to try
        envs = goal.envs
        candidates = Candidates(states.equation.scope, goal.envs[0])
        candidates.any_unit = misfit and level == 1
        found = _side(statement.sides[i], goal, candidates, known, level)
        if found is not None and (best is None or _extent(found[1]) < _extent(best[1])):
            tried = replace(statement, sides=(*statement.sides[:i], found[0], *statement.sides[i + 1 :]))
            if compared(tried, states).same and not faults(tried, states.free[:2]):
                best = tried, found[1]
    return best


def _extent(done: Sequence[Edit]) -> tuple[int, float]:
    return len(done), round(sum(e.size for e in done), 6)


def _places(statement: Relation, states: ComparedStates) -> Iterator[tuple[int, _Goal]]:
    """Sides that may be changed, each with its goal: the values of another side, or of the quantity that they should equal."""
    said = states.equation.quantity if statement is states.equation.statements[0] else None
    sides = statement.sides
    # the last side, which a misprint is likeliest in, first; sides that are a single symbol at the end
    order = sorted(range(len(sides)), key=lambda i: (sides[i].kind == "symbol", -i))
    for envs in [states.many] if states.equation.only or states.equation.states == "free" else [states.many, states.many_joint]:
        for i in order:
            if sides[i].kind == "number":
                continue
            other = sides[0 if i else 1] if len(sides) > 1 else None
            try:
                with np.errstate(all="ignore"):
                    values = [said.value(e) if said else evaluate(other, e) for e in envs]  # type: ignore[arg-type]
            except SizeError:
                continue
            if other is not None and notation.is_zero(other) and not said:
                values = [0 * v for v in (evaluate(sides[i], e) for e in envs)]
            goal = _Goal(envs, values, frozenset(sides[:i] + sides[i + 1 :]))
            shows = (other is not None and notation.is_zero(other)) or max(float(np.max(np.abs(t))) for t in values) > 1e-9
            if shows and not (goal.met(sides[i]) and not said):
                yield i, goal


def _side(side: Node, goal: _Goal, candidates: Candidates, known: Sequence[Edit], level: int) -> Changed | None:
    """A side changed so that it meets its goal; a column of blocks is treated row by row."""
    rows = side.parts
    goals = goal.rows(len(rows)) if side.kind == "block" and len(rows) > 1 and all(len(r.parts) == 1 for r in rows) else []
    if not goals:
        return _node(side, goal, candidates, known, level)
    new, done = [], list[Edit]()
    for row, its in zip(rows, goals, strict=True):
        found = _node(row.parts[0], its, candidates, [*known, *done], level)
        if found is None:
            return None
        new.append(row.with_parts((found[0],)))
        done += [e for e in found[1] if e not in done]
    return side.with_parts(tuple(new)), done


def _node(node: Node, goal: _Goal, candidates: Candidates, known: Sequence[Edit], level: int) -> Changed | None:
    """A formula that meets its goal: unchanged, after the changes made elsewhere in the equation, after one change, after two."""
    if goal.met(node):
        return node, []
    again = node
    for edit in known:
        again = applied(edit, again)
    if again != node and goal.met(again):
        return again, list(known)
    candidates.any_size = not goal.sized(node)
    once = dict[Node, Edit]()
    for edit, new in edits(node, candidates):
        if new != node:
            once.setdefault(new, edit)
    plain = _smallest(node, ((e, n) for n, e in once.items()), goal)
    if level == 0 or (plain is not None and plain[1][0].size <= PLAIN):
        return plain if plain is not None and plain[1][0].size <= PLAIN else None
    found = (_smallest(node, chain(((plain[1][0], plain[0]),) if plain else (), lacking(node, goal, candidates)), goal)
             or _smallest(node, missing(node, goal, candidates), goal))
    if found or level == 1:
        return found
    return _twice(node, once, goal, candidates) or _smallest(node, supplements(node, candidates), goal)


def _smallest(node: Node, tried: Iterator[tuple[Edit, Node]], goal: _Goal) -> Changed | None:
    """The lowest-ranked change of a formula after which it meets its goal."""
    found = [(edit, new) for edit, new in tried if goal.met(new)]
    best = next(((new, edit) for edit, new in sorted(found, key=lambda pair: pair[0].size) if goal.mended(node, new)), None)
    return None if best is None else (best[0], [best[1]])


def _fit(node: Node, goal: _Goal, candidates: Candidates) -> tuple[Fit, list[Node]]:
    """Fit by powers of the quantities of a formula and its text, and the vectors and matrices among them. Other sides of the
    statement are no candidates: a = a would be no repair."""
    used = [symbol(n) for n in sorted(candidates.scope.reached(node.free))]
    others = [symbol(n) for n in reversed(candidates.known()) if symbol(n) not in used]  # the last declared first
    numbers = set(candidates.numbers())
    columns = [n for n in used if n.value not in numbers]
    columns += [n for n in others if n.value not in numbers] if columns or np.shape(goal.values[0]) else []
    inside = [n for n in dict.fromkeys(node.walk()) if n != node and n.kind in ("product", "sum", "call")]
    here, there = ([Node("call", "norm", (n,)) for n in names if n.value not in numbers] for names in (used, others))
    pieces = [n for n in (*used, *inside, *here, *others, *there) if n not in goal.banned]
    return Fit(goal.envs, goal.values, pieces), columns[:COLUMNS]


def lacking(node: Node, goal: _Goal, candidates: Candidates) -> Iterator[tuple[Edit, Node]]:
    """The formula with a missing factor, exponent or function added."""
    fit, _ = _fit(node, goal, candidates)
    for piece, monomial, new in factors(node, fit):
        sign = monomial.c == -1 and not monomial.powers
        size = 1.0 if sign else 1.3 + 0.5 * len(monomial.powers) + 0.02 * (abs(monomial.c.numerator) + monomial.c.denominator)
        size -= 0.05 * (piece.kind == "number" and not monomial.powers)  # a number for another is likelier than one left out
        edit = Edit("sign of {}", (piece,)) if sign else Edit("the factor {} at {}", (monomial.times(), piece))
        yield replace(edit, size=size), new
    for piece, wrap, new in wrapped(node, goal.envs[0]):
        yield Edit("{} -> {}", (piece, wrap), size=1.7), new


def missing(node: Node, goal: _Goal, candidates: Candidates) -> Iterator[tuple[Edit, Node]]:
    """The formula with a missing term added."""
    fit, vectors = _fit(node, goal, candidates)
    for term, new in terms(node, fit, vectors):
        yield Edit("the missing term {}", (term,), size=sum(1 for _ in term.walk())), new


def _twice(node: Node, once: dict[Node, Edit], goal: _Goal, candidates: Candidates) -> Changed | None:
    """The formula after two changes: first pairs that act at all places of a piece, then pairs of any kind."""
    order = sorted(once, key=lambda n: (not once[n].table, not goal.sized(n)))
    if not goal.sized(node):  # one of the two changes must alter the size: try those first
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
                if goal.met(new) and goal.mended(node, new):
                    return new, [once[first], edit]
    return None


# -- a missing term


def missing_term(equation: Printed, states: ComparedStates, scope: Scope, name: str) -> Repair | None:
    """The missing term, linear in the vector `name`, which the text does not name, and its rows and columns in the last side;
    None where no single term fits. scope: the symbols of the text with this vector."""
    (statement,) = equation.statements
    envs = replace(states, equation=replace(equation, scope=scope)).joint
    gaps = [evaluate(statement.sides[0], e) - evaluate(statement.sides[-1], e) for e in envs]
    if np.ndim(gaps[0]) == 0:
        return None
    where = np.argwhere(np.max([np.abs(g) for g in gaps], axis=0) > 1e-9)
    (top, left), (bottom, right) = where.min(axis=0), where.max(axis=0) + 1
    blocks = [g[top:bottom, left:right] for g in gaps]
    for term in _terms(name, scope, envs[0]):
        if _Goal(envs, blocks).met(term):
            place = f"{_range('row', top, bottom)} and {_range('column', left, right)}"
            return Repair((f"the term {term} in {place} is missing",), equation)
    return None


def _range(what: str, first: int, last: int) -> str:
    return f"{what} {last}" if last == first + 1 else f"{what}s {first + 1} to {last}"


def _terms(name: str, scope: Scope, env: Env) -> Iterator[Node]:
    """Terms linear in a vector: the vector, its cross products with others, their transposes, with both signs."""
    r = symbol(name)
    crossed = [made("product", made("cross", symbol(other)), r) for other in scope.symbols
               if np.shape(env.value(other)) == (3, 1)]
    for term in [r, *crossed]:
        for shown in (term, made("transposed", term)):
            yield from (shown, made("neg", shown))
