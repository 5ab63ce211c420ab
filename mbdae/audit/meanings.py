r"""Audits of TeX and Markdown: displayed equations with the table of what their letters mean.

The table is a text file beside the paper, in the notation of `reading`, with every letter as the paper prints it:

    NAME [UNIT] $TEX$: MEANING       a letter, from here on; let NAME [UNIT] $TEX$ = FORMULA
    NAME [UNIT] $TEX$: defined by 4  a letter that equation 4 of the paper defines: later equations use its right-hand side
    ? ...                            a guess: what contains the letter is not judged until the mark is taken away
    from 10: / from eq:drive:        what follows holds from that equation on (its printed number or its label)
    equation 4: MEANING              what the sides of equation 4 are, where no letter stands for it
    equation 4 [N m]: FORMULA        what the left-hand side less the right-hand side of equation 4 is, up to its sign
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from mbdae.audit import carried
from mbdae.audit.calculus import MOVING, TIME, Key, Letters, expanded_or_none
from mbdae.audit.edits import PLAIN, powers
from mbdae.audit.evaluate import NO_VALUE, attempt
from mbdae.audit.laws import Own
from mbdae.audit.motion import RandomMotion
from mbdae.audit.notation import AuditError, Node, Relation, is_zero, made, negated, symbol
from mbdae.audit.phrases import OWN, Definition, Env, Scope, understand
from mbdae.audit.reading import Printed, TextFile
from mbdae.audit.rules_motion import Assumption
from mbdae.audit.tex import Case, Formula
from mbdae.audit.tex_items import FUNCTIONS, RATES, TRANSPOSED, Item, Items, UnreadError, canonical
from mbdae.documents.blocks import tokens
from mbdae.documents.displays import Display
from mbdae.documents.macros import switched

RESERVED = {*FUNCTIONS.values(), "I", "pi", "rate", "diff", "delta", "integral", "sum", "slope", "sqrt", "norm"}
_FROM = re.compile(r"from\s+(\S+)\s*:\s*(.*)$", re.S)
_OF_EQUATION = re.compile(r"equation\s+(\S+?)\s*(?:\[([^\]]*)\])?\s*:\s+(.+)$", re.S)
_TOLD = re.compile(r"\$([^$]{1,40})\$,?\s+(?:is|are|denotes?|represents?|means|be|being)\s+((?:[^,.;:$\\\n]|\n(?!\n)){3,60})")
_DEFINED = re.compile(r"(\w+)\s*\[([^\]]*)\]\s*(?:\$([^$]*)\$)?\s*:\s*defined (?:by|in) (\S+)$")



@lru_cache(maxsize=4096)
def keys_of(letter: str, name: str) -> tuple[Key, str]:
    """The keys of the pieces of a letter given as TeX, and its arguments where it is given with them, as g(v); "": the letter
    that the name looks like. UnreadError where what is given is no letter."""
    items = Items(tokens(letter or carried.name(name))).all()
    called = len(items) > 1 and items[-1].kind == "fence" and not items[-1].sup
    pieces = items[:-1] if called else items
    if not 0 < len(pieces) < 4 or any(
            i.kind != "letter" or i.key()[1:] in FUNCTIONS or i.text in ")]" for i in pieces):
        if not letter:  # a name that the paper does not print
            return (name,), ""
        raise UnreadError(f"`${letter}$` is no letter with its index and accents: of an expression the letters alone have lines")
    return tuple(i.key() for i in pieces), canonical(items[-1:]) if called else ""


def other_form(key: Key) -> Key:
    """The letter with its Greek letters in their other form."""
    swap = {f"\\{v}{g}": f"\\{'' if v else 'var'}{g}" for g in ("phi", "theta", "epsilon", "rho", "kappa") for v in ("", "var")}
    return tuple(re.sub(r"\\[a-z]+", lambda m: swap.get(m[0], m[0]), piece) for piece in key)


class Paper(TextFile):
    """Reads the displays of a paper with its table of meanings."""

    def __init__(self, shown: Sequence[Display], paper: str, table: str, name: str, own: Own = (),
                 quantities: Mapping[str, Any] = MappingProxyType({})) -> None:
        super().__init__(table, own, quantities)
        self.shown, self.paper, self.name = shown, paper, name
        self.doubtful: set[str] = set()
        self.said: dict[str, tuple[int, str | None, str]] = {}
        self.definitions: dict[str, list[tuple[str, str, str, int]]] = {}
        self.written: dict[str, str] = {}
        self.known = {n for d in shown for n in (d.number, d.label)}
        self.stated: dict[Any, tuple[int, str]] = {}  #: line and name of the names and letters declared since the last `from`

    def read_paper(self) -> Any:
        """The text of all displays, in their order."""
        parts: dict[str, list[tuple[int, str]]] = {"": []}
        here = ""
        for at, joined in self._items():
            if match := _FROM.match(joined):
                here, joined = match[1], match[2]
                parts.setdefault(here, [])
            if joined:
                parts[here].append((at, joined))
        for place in [p for p in parts if p not in self.known | {""}]:
            self._spoilt(parts[place][0][0] if parts[place] else 0, f"from {place}:", f"{self.paper} has no equation {place}")
        self._declare(parts[""])
        for display in self.shown:
            for place in {display.number: None, display.label: None}:
                self._declare(parts[place] if place and place in parts else [])
            self._display(display)
        return self.found

    def _declare(self, items: Sequence[tuple[int, str]]) -> None:
        self.stated = {}
        for at, joined in items:
            try:
                doubtful = joined.startswith("?")
                line = joined[1:].strip() if doubtful else joined
                name = re.match(r"(?:let\s+)?([^\W\d]\w*)\s*\[", line)
                if name:  # what was printed of another letter with this name is no longer how it is printed
                    self.written = {f: tex for f, tex in self.written.items() if not re.search(rf"\b{name[1]}\b", f)}
                    (self.doubtful.add if doubtful else self.doubtful.discard)(name[1])
                of, match = _OF_EQUATION.match(line), _DEFINED.match(line)
                if (of or match) and (place := of[1] if of else match[4]) not in self.known:  # type: ignore[index]
                    raise AuditError(f"{self.paper} has no equation {place}")
                if of:
                    self.said[of[1]] = (at, of[2], " ".join(of[3].split()))
                elif match:
                    self._symbol(at, match[1], match[2], match[3], "number")
                    self.definitions.setdefault(match[4], []).append((match[1], match[2], match[3] or "", at))
                else:
                    self._item(at, line)
            except (AuditError, RecursionError) as error:
                self._spoilt(at, joined, said_of(error))

    def _symbol(self, at: int, name: str, units: str, letter: str | None, meaning: str, defined: bool = False) -> None:
        letter = letter and switched(letter)
        keys = () if letter == "0" else (name, keys_of(letter or "", name))
        for line, other in (self.stated[key] for key in keys if key in self.stated):
            raise AuditError(f"line {line} declares {other}, the same name or letter: anew it is declared after `from EQUATION:`")
        super()._symbol(at, name, units, letter, meaning, defined)
        self.stated |= dict.fromkeys(keys, (at, name))

    def _spoilt(self, at: int, line: str, why: str) -> None:
        why = f"{self.name}:{at}: " + re.sub(r"^line \d+: ", "", why)
        self._add(Printed(f"{self.name}.{at}", (), self._scope(), self.section, trouble=why, raw=" ".join(line.split())))

    def _scope(self) -> Scope:
        return replace(super()._scope(), written=dict(self.written))

    # -- one display

    def _display(self, display: Display) -> None:
        number = re.sub(r"[\\${}\s]+", "_", display.number) or f"L{display.line}"
        while number in self.places:
            number += "_"
        self.places[number] = display.line
        place = f"{self.paper}:{display.line}"
        base = Printed(number, (), self._scope(), self.section or display.section, self.states, self.only, None, self.found.inner,
                       self.doubt, before=dict(self.before), tex=display.latex, place=place, label=display.label)
        try:
            if display.trouble:
                raise UnreadError(display.trouble)
            cases = Formula(self._letters(), display.line).cases(Items(tokens(display.latex)).all())
            for i, case in enumerate(cases, 1):
                self._case(base, number if len(cases) == 1 else f"{number}.{i}", case, display)
        except (AuditError, RecursionError, *NO_VALUE) as error:
            self._add(replace(base, trouble=f"{place}: {said_of(error)}", raw=display.latex))

    def _case(self, base: Printed, number: str, case: Case, display: Display) -> None:
        statements, quantity, scope = case.statements, None, self._scope()
        said = next((self.said[n] for n in (display.number, display.label) if n and n in self.said), None)
        if said is not None and said[1] is None:
            quantity = understand(said[2], (), said[0])
        elif said is not None:
            formulas = _split(said[2])
            stands = [re.sub(r"\W", "_", f"E{number}") + (f"_{i}" if i else "") for i in range(len(formulas))]
            for name, formula in zip(stands, formulas, strict=True):
                self._symbol(said[0], name, said[1] or "1", "0", formula, defined=True)
            scope = self._scope()
            statements = (*(self._signed(s, name, scope) for s, name in zip(statements, stands, strict=False)),
                          *statements[len(stands) :])
        defines = [d for n in (display.number, display.label) if n for d in self.definitions.get(n, [])]
        for name, _, letter, at in defines:
            node = next((b for s in statements for a, b in (s.sides[:2], s.sides[1::-1]) if a == symbol(name)), None)
            if node is None:
                raise UnreadError(f"{self.name}:{at} says that it defines {name}, which is no side of it")
            self.symbols[name] = Definition(f"defined as {node}", self.symbols[name].units, OWN, (), letter, node, scope)
        used = scope.reached(set().union(*(s.symbols() for s in statements)))
        guessed = sorted(used & self.doubtful)
        undecided = f"it defines {' and '.join(d[0] for d in defines)}: nothing else says what that is" if defines else ""
        if guessed:
            letters = ", ".join(f"{n} (${scope.symbols[n].letter or n}$)" for n in guessed)
            undecided = f"{self.name} does not yet confirm {letters}: correct the lines and take their `?` away"
        words = " and ".join(f"{a} {sign} {b}" for a, sign, b in case.conditions)
        assumed = [Assumption(words, case.conditions)] if case.conditions else []
        self.printed[number] = statements
        scope = self._scope() if defines else scope
        self._add(replace(base, number=number, statements=statements, scope=scope, quantity=quantity,
                          stated=(*self.assumed, *assumed), undecided=undecided, guessed=bool(guessed)))

    def _signed(self, statement: Relation, name: str, scope: Scope) -> Relation:
        """A statement A = B that stands for a quantity E as A = B + E, or A = B - E where that is nearer."""
        if len(statement.sides) != 2 or statement.relation != "=":
            raise UnreadError("only of an equation with two sides the table can say what it is")
        (a, b), e = statement.sides, symbol(name)
        first = next((i for i, side in enumerate((b, a)) if not is_zero(side)), 0)
        a, b = (a, b) if first == 0 or is_zero(b) else (b, a)

        def gap(sign: int) -> float:
            left = made("sum", a, negated(b), negated(e) if sign > 0 else e)
            values = [attempt(left, env) for env in self._envs(scope)]
            return max((float(np.max(np.abs(v))) for v in values if v is not None), default=0.0)

        term = e if gap(1) <= gap(-1) else negated(e)
        right = term if is_zero(b) else made("sum", *(b.parts if b.kind == "sum" else (b,)), term)
        return replace(statement, sides=(a, right))

    def _envs(self, scope: Scope) -> list[Env]:
        kind = self.states if self.only else "free"
        motions = [RandomMotion(seed, kind, self.own, self.states) for seed in range(3)]
        return [Env(motion, scope, self.found.inner or "l", scale=PLAIN) for motion in motions]

    def _letters(self) -> Letters:
        scope = self._scope()
        names, functions = dict[Key, str](), set[str]()
        for name, meaning in scope.symbols.items():
            if meaning.letter != "0":
                key, called = keys_of(meaning.letter, name)
                if called:
                    names[*key, called] = name
                    functions |= {name} if names.setdefault(key, name) == name else set()
                else:
                    functions.discard(names.get(key, ""))
                    names[key] = name
        for key, name in tuple(names.items()):  # a letter whose TeX the table leaves open may be printed in either form
            for other in (other_form(key), (name,)) if not scope.symbols[name].letter else ():
                names.setdefault(other, name)
        envs = self._envs(scope)

        def shape(node: Node) -> tuple[int, ...] | None:
            return next((np.shape(v) for env in envs if (v := attempt(node, env)) is not None), None)

        def angle(node: Node) -> bool | None:
            try:
                found = powers(node, envs[:1])
            except NO_VALUE:
                return None
            return found is not None and not np.any(np.nan_to_num(found))

        def radian(node: Node) -> bool:
            return any("rad" in map(str, scope.symbols[n].units) for n in node.free if n in scope.symbols)

        moving, time = (frozenset(n for n, meaning in scope.symbols.items() if meaning.phrase.wording in words)
                        for words in ((*MOVING, TIME), (TIME,)))
        return Letters(names, shape, angle, radian, lambda name: frozenset(scope.reached({name})), moving, time,
                       frozenset(functions), lambda node: expanded_or_none(node, scope), self.written)


def said_of(error: Exception) -> str:
    """Why something could not be read."""
    return "its formulas stand too deep in each other" if isinstance(error, RecursionError) else str(error)


def _split(formulas: str) -> list[str]:
    """Formulas between semicolons outside of brackets."""
    parts, depth = [""], 0
    for c in formulas:
        depth += (c in "([") - (c in ")]")
        parts += [""] if c == ";" and not depth else []
        parts[-1] += c if c != ";" or depth else ""
    return parts


# -- a table begun


def begun(shown: Sequence[Display], source: str, paper: str) -> str:
    """A table of meanings with every letter found, its meaning and unit guessed by what the text says of it and by the letter."""
    found, alone = dict[str, bool](), set[str]()
    for display in shown:
        try:
            items = [i for piece, _ in Formula.statements(Items(tokens(display.latex)).all()) for i in piece]
        except AuditError:
            continue
        letters = list(_letters_in(items))
        alone |= {i.key("") for i in letters}
        for item in letters:
            moving = bool(item.accents and item.accents[0] in RATES)
            plain = replace(item, accents=item.accents[1:]) if moving else item
            high = canonical(plain.sup)
            for mark in TRANSPOSED:
                high = high.removesuffix(mark) if high.endswith(mark) else high
            power = not high or re.fullmatch(r"[-\d/.+]*|\\frac.*", high) or high in alone or "+" in high
            key = plain.key("" if power else high)
            found[key] = found.get(key, False) or moving
    lines = [f"# Meanings of the letters of {paper}, for mb.audit. A line that begins with ? is a guess: correct its unit and",
             "# its meaning and take the ? away. What contains a guess is not judged. Words for meanings: docs/reports.md.",
             ""]
    names = set(RESERVED)
    for key, moving in found.items():
        name = _name(key, names)
        names.add(name)
        words = _words(key, source)
        unit, meaning = carried.guessed(key, words, moving)
        lines.append(f"? {name} [{unit}] ${key}$: {meaning}" + (f"   # {words}" if words else ""))
    return "\n".join(lines) + "\n"


_OPERATORS = ("\\int", "\\sum", "\\partial", "\\delta", "\\pi", "\\max", "\\min", ".", "t")


def _letters_in(items: Sequence[Any], inside: bool = False) -> list[Item]:
    out: list[Item] = []
    skip = False
    for i, item in enumerate(items):
        if not isinstance(item, Item):
            out += _letters_in(item, inside)
            continue
        if item.kind == "letter" and not skip:
            plain, follows = item.text, items[i + 1] if i + 1 < len(items) else None
            operator = plain[1:] in FUNCTIONS or plain in _OPERATORS
            differential = plain == "d" and not item.sub and not item.accents and (inside or (
                isinstance(follows, Item) and follows.kind == "letter"))
            exponential = plain == "e" and item.sup and not item.sub
            if not (operator and not item.sub and not item.accents) and not differential and not exponential:
                out.append(item)
        out += _letters_in(item.parts, item.kind == "frac") if item.kind != "letter" else []
        if canonical(item.sup) not in TRANSPOSED:
            single = item.kind == "letter" and item.text != "e" and len(item.sup) == 1 and item.sup[0].kind == "letter"
            out += [] if single else _letters_in(item.sup)
    return out


def _name(key: str, taken: set[str]) -> str:
    """A name for a letter, of its letters and figures."""
    text = re.sub(r"\\(mathbf|mathrm|mathcal|mathsf|vec|underline|mathbb)\b", "", key).replace("\\", "")
    text = re.sub(r"\W+", "", text)
    text = text if text[:1].isalpha() else f"x{text}"
    while text in taken:
        text += "_"
    return text


def _words(key: str, source: str) -> str:
    """What the text says of a letter: "where $m_1$ is the mass of the bob" gives "the mass of the bob"."""
    for match in _TOLD.finditer(source):
        try:
            if canonical(Items(tokens(match[1])).all()) == key:
                return " ".join(match[2].split())
        except AuditError:
            continue
    return ""
