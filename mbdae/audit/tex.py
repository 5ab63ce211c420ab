r"""Formulas as TeX prints them, read into the trees of the notation.

Known are fractions, roots, fences, scripts, accents, fonts, matrices, `cases`, functions with and without brackets, as in
`\sin^2 2\theta`, products without a sign, transposes, inverses, derivatives (`\frac{d}{dt}`,
`\frac{\partial L}{\partial\dot\theta}`, dots, primes), variations (`\delta r`), sums and integrals with limits, `\cdot` and
`\times` of vectors, equations counted by an index. Which letters there are the table of meanings says: of several that fit at a
place the longest is taken, so that `r_1^k` is a letter where the table has it, else a power. A dot on a letter of the table is
its rate, a tilde or hat the matrix of its cross product, unless the accented letter is in the table.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce

from mbdae.audit.calculus import Key, Letters, counted, related
from mbdae.audit.notation import Comparison, Node, Relation, is_zero, made, negated, number, symbol
from mbdae.audit.tex_factors import Factors
from mbdae.audit.tex_items import CONSTANT, MARKS, RATES, TRANSPOSED, Item, UnreadError, canonical

CONDITIONAL = ("if", "for", "when", "where", "whenever", "provided", "otherwise", "else", "ifand", "forall")
IDENTITY = {"I", "\\mathbf{I}", "\\mathbf{1}", "\\mathbf{E}", "\\mathbb{I}", "\\mathbb{1}"}
SIZE = re.compile(r"|[nmN]|[2-6]|(\w)\\times ?\1")  #: an index that may be the size of a matrix: none, n, 3, or 3 x 3
SIGNS = ("d", "t", "\\partial", "\\delta", "\\int", "\\sum")  #: letters that are more often signs
STARS = ("\\cdot", "\\star", "\\dagger")  #: superscripts of letters after which an exponent may follow
ROMAN = {"iii": 3, "iv": 4, "v": 5, "vi": 6}
#: superscripts that are the order of a derivative
ORDER = re.compile(r"\((?:(\d+)|(?:\\mathrm\{)?([ivIV]+|[a-z])\}?)\)|\\mathrm\{(III|IV|VI|iii|iv|vi)\}|(III|IV|VI|iii|iv|vi)")
SIZES = (3, 2, 4, 5, 6)  #: of an identity, in the order in which they are tried


@dataclass(frozen=True)
class Case:
    """Statements that hold together, with the conditions under which they do."""

    statements: tuple[Relation, ...]
    conditions: tuple[Comparison, ...] = ()


class Formula:
    """Reads the items of one display."""

    def __init__(self, letters: Letters, line: int = 0) -> None:
        self.letters, self.line, self.bound = letters, line, dict[Key, str]()
        self.identity: Item | None = None  #: an identity matrix as the text prints it
        self.present = frozenset[str]()  #: names of the letters of the statement that is read
        self.lists = dict[Node, list[Node]]()  #: lists in brackets, read as rows, with what else they may be

    def cases(self, items: Sequence[Item]) -> list[Case]:
        """What a display says: one case, or those of `cases`. UnreadError where it cannot be read."""
        sides, conditions, branches = list[tuple[list[list[Item]], list[str]]](), list[Comparison](), None
        for piece, condition in self.statements(items):
            parts, signs = related(piece)
            if not signs:
                raise UnreadError(f"`{canonical(piece)}` is no equation")
            if condition or set(signs) & {"<", ">", "!=", "in"}:
                conditions += self._compared(parts, signs)
            elif len(parts[-1]) == 1 and parts[-1][0].kind == "cases":
                branches = (parts[:-1], parts[-1][0])
            else:
                sides.append((parts, signs))
        if branches is not None:
            return self._branches(*branches, tuple(conditions))
        if not sides:
            raise UnreadError("it states conditions and no equation")
        return [Case(tuple(r for one in self._with_own(sides) for r in self._relations(*one)), tuple(conditions))]

    def _with_own(self, sides: list[tuple[list[list[Item]], list[str]]]) -> list[tuple[list[list[Item]], list[str]]]:
        """The statements of a display with what one of them says of a letter that the table lacks put into the others:
        `F = k x^n, n = 3/2`."""
        for i, (parts, signs) in enumerate(sides):
            for (a, *more), value in zip(parts, parts[::-1], strict=True) if signs == ["="] and all(parts) else ():
                own = a.kind == "letter" and a.text not in SIGNS and not (more or a.sup or a.primes) and not self.letter((), a)
                others = [([placed(p, a.key(), value) for p in said], s) for said, s in sides[:i] + sides[i + 1 :]]
                if own and others != sides[:i] + sides[i + 1 :]:
                    return self._with_own(others)
        return sides

    @classmethod
    def statements(cls, items: Sequence[Item]) -> list[tuple[list[Item], bool]]:
        """The statements and conditions of a display, those counted by an index one by one; with each, whether words before it
        make it a condition."""
        return counted(list(cls._pieces(_flat(items))))

    @staticmethod
    def _pieces(items: Sequence[Item]) -> Iterator[tuple[list[Item], bool]]:
        """Statements between commas, gaps and words; with each, whether the words before it make it a condition."""
        found, condition = list[tuple[list[Item], bool]](), False
        here: list[Item] = []
        items = [*items, Item("comma", ",")]
        for n, item in enumerate(items):
            if item.kind not in ("comma", "gap", "text"):
                here.append(item)
                continue
            after = next((j for j in range(n + 1, len(items)) if items[j].kind in ("comma", "gap", "text")), n)
            if item.kind == "gap" and not all(any(i.kind == "relation" for i in part) for part in (here, items[n:after])):
                continue
            found += [(here, condition)] if here else []
            here, condition = [], condition and not here
            if item.kind == "text":
                word = item.text.strip(" ,.:").lower()
                condition = word in CONDITIONAL
                before = not condition and word and not (here or found)
                if before and n + 1 < len(items) - 1 and items[n + 1].kind in ("letter", "frac", "fence"):
                    raise UnreadError(f"the word '{word}' stands before a formula: an operator is \\operatorname")
        last = len(found)
        for i, (piece, told) in enumerate(found):
            stop = i == last - 1 and piece[-1].text == "." and piece[-1].kind == "letter"
            if piece[:-1] or not stop:
                yield piece[:-1] if stop else piece, told

    def _relations(self, parts: list[list[Item]], signs: list[str]) -> Iterator[Relation]:
        if len(set(signs)) > 1:
            raise UnreadError("`=` and a bound stand in one statement: print two")
        self.present = frozenset(n for p in parts for n in self._names(p))
        if parts[-1] == [CONSTANT]:
            parts, signs, kept = parts[:-1], signs[:-1], self.sum(parts[0])
            if not any(self.letters.contains(n) & self.letters.moving for n in kept.free):
                raise UnreadError("`= const.` of what does not change with time in the table shows nothing")
            yield Relation((Node("call", "rate", (kept,)), number(0)), "=", self.line)
        if signs:
            nodes = self._sized([self.sum(p) for p in (parts if signs[0] != ">=" else parts[::-1])])
            yield Relation(nodes, "=" if signs[0] == "=" else "<=", self.line)

    def _names(self, items: Sequence[Item]) -> Iterator[str]:
        """Names of the letters of items and of what is inside of them."""
        for item in items:
            keys = (replace(item, primes=0, accents=item.accents[i:], sup=p).key() for i in (0, 1) for p in (item.sup, ()))
            yield from (self.letters.names[key,] for key in keys if item.kind == "letter" and (key,) in self.letters.names)
            for inside in (*item.parts, item.sup):
                yield from self._names(inside if not inside or isinstance(inside[0], Item) else [i for c in inside for i in c])

    def _fit(self, sides: Sequence[Node]) -> bool:
        """Whether sides have one size."""
        shapes = {self.letters.shape(side) for side in sides if not is_zero(side)}
        return len(shapes) == 1 and None not in shapes

    def _sized(self, sides: Sequence[Node]) -> tuple[Node, ...]:
        """Sides in which lists in brackets, and an identity, have the size with which they fit together."""
        sides = tuple(sides)
        for kind in (0, 1) if self.lists and not self._fit(sides) else ():
            table = {node: others[kind] for node, others in self.lists.items() if len(others) > kind}
            sides = tried if self._fit(tried := tuple(side.replaced(table) for side in sides)) else sides
        if self.identity is None or not any("I" in side.free for side in sides):
            return sides
        for n in SIZES:
            unit = made("block", *(made("row", *(number(float(i == j)) for j in range(n))) for i in range(n)))
            tried = sides if n == SIZES[0] else tuple(side.replaced({symbol("I"): unit}) for side in sides)
            if self._fit(tried):
                self.letters.written.setdefault(str(unit), r"\mathbf{I}")
                return tried
        if self.identity.accents or any(self.letters.shape(symbol(n)) for side in sides for n in side.free - {"I"}):
            return sides  # beside vectors or matrices it is one, whose size is wrong
        raise UnreadError("an identity matrix of no size fits to what stands beside it: if $I$ is another letter, it needs a "
                          "line in the table of meanings")

    def _compared(self, parts: list[list[Item]], signs: list[str]) -> list[Comparison]:
        if signs == ["in"]:
            inside = parts[1][0].parts[0] if len(parts[1]) == 1 and parts[1][0].kind == "fence" else ()
            at = next((i for i, item in enumerate(inside) if item.kind == "comma"), None)
            if at is None:
                raise UnreadError(f"`{canonical(parts[1])}` is no interval")
            low, high, x = self.sum(inside[:at]), self.sum(inside[at + 1 :]), self.sum(parts[0])
            return [(low, "<", x), (x, "<", high)]
        nodes = [self.sum(p) for p in parts]
        return [(a, sign, b) for a, sign, b in zip(nodes, signs, nodes[1:], strict=False) if sign != "="]

    def _branches(self, left: list[list[Item]], item: Item, also: tuple[Comparison, ...]) -> list[Case]:
        sides, out, before = [self.sum(p) for p in left], list[Case](), list[Comparison]()
        for row in ([[i for i in cell if (i.kind, i.text) != ("letter", ".")] for cell in cells] for cells in item.parts):
            value = [i for i in row[0] if i.kind not in ("comma", "text", "gap")]
            told = [i for cell in row[1:] for i in cell] or [i for i in row[0] if i.kind == "text"]
            parts, signs = related([i for i in told if i.kind not in ("text", "comma", "gap")])
            if signs:
                conditions = self._compared(parts, signs)
                before += conditions
            elif len(before) == 1:
                a, sign, b = before[0]
                conditions = [(a, {"<": ">=", ">": "<=", "<=": ">", ">=": "<", "!=": "="}[sign], b)]
            else:
                raise UnreadError("where none of several conditions holds is not known: print a condition in each row of `cases`")
            if any(sign == "=" for _, sign, _ in conditions):
                raise UnreadError("a row of `cases` holds at one point alone, where random states never are")
            out.append(Case((Relation(self._sized([*sides, self.sum(value)]), "=", self.line),), (*also, *conditions)))
        return out

    # -- sums and products

    def sum(self, items: Sequence[Item]) -> Node:
        """A formula without a relation."""
        if not (items := [i for i in items if i.kind != "gap"]):
            raise UnreadError("nothing stands on one side of a sign")
        terms, here, sign, inside = list[Node](), list[Item](), "+", 0
        for item, after in zip((*items, Item("sign", "end")), (*items[1:], Item(""), Item("")), strict=False):
            inside += item.text == "\\int"  # signs up to its dx are those of an integral
            inside -= bool(inside and item.key() == "d" and after.kind == "letter")
            if item.kind == "comma":
                raise UnreadError(f"a comma stands in `{canonical(items)}`")
            if item.kind == "text":
                raise UnreadError(f"the words '{item.text}' stand in a formula")
            leads = not here or (here[-1].kind == "sign" and here[-1].text not in ("+", "-"))
            if item.text == "end" or (item.kind == "sign" and item.text in ("+", "-") and not inside and not (leads and here)):
                if here:
                    term = self.product(here)
                    terms.append(negated(term) if sign == "-" else term)
                elif item.text == "end":
                    raise UnreadError(f"a term is missing after `{sign}`")
                here, sign = [], item.text
            else:
                here.append(item)
        return made("sum", *terms)

    def product(self, items: Sequence[Item]) -> Node:
        """A term: factors side by side, with `/`, `\\cdot`, `\\times` between them."""
        parts: list[list[Item]] = [[]]
        for item in items:
            if item.kind == "sign" and item.text == "\\cdot":
                parts.append([])
            else:
                parts[-1].append(item)
        return made("product", *reduce(self.letters.dotted, (Factors(self, p).all() for p in parts)))

    # -- letters

    def letter(self, before: Key, item: Item) -> Node | None:
        """A letter of the table with what its superscript says; before: keys of the pieces in front of it that belong to it. None
        where the table has no such letter."""
        high = canonical(item.sup)
        options: list[tuple[str, Callable[[Node], Node]]] = [(high, lambda node: node)] if high else []
        for mark in sorted(TRANSPOSED, key=len, reverse=True):
            if high.endswith(mark) and high != mark and not high.endswith("\\" + mark):
                options.append((high.removesuffix(mark).rstrip(","), lambda node: made("transposed", node)))
        power = item.sup[-1 - any(i.text in STARS for i in item.sup[-3:-2]) * (item.sup[-2:][0].text == "-") :] if high else ()
        if power and power[-1].kind == "number" and len(power) < len(item.sup) and item.sup[-len(power) - 1].text not in "+-/":
            options.append((canonical(item.sup[: -len(power)]), lambda node: self.raised(node, power)))  # {E^*}^2
        options.append(("", lambda node: self.raised(node, item.sup)))
        for sup, wrap in options:
            node = self._peeled(before, item, sup)
            if node is not None:
                found = wrap(node)
                if found.kind in ("transposed", "cross", "call") and found.parts[0].kind in ("symbol", "cross", "call"):
                    self.letters.written.setdefault(str(found), " ".join((*before, item.key(high))))
                return found
        return None

    def _peeled(self, before: Key, item: Item, sup: str) -> Node | None:
        key = (*before, item.key(sup))
        name = self.bound.get(key) or self.letters.names.get(key)
        if name is not None:
            return symbol(name)
        if item.primes and (inner := self._peeled(before, replace(item, primes=0), sup)) is not None:
            return self.kept(self.derived(inner, item.primes, f"the prime of ${item.key()}$"), key)
        if not before and not sup and item.key("").partition("_")[0] in IDENTITY and SIZE.fullmatch(canonical(item.sub)):
            self.identity = item
            return symbol("I")
        if not before and not sup and item.key("") in ("\\pi", "\\mathbf{0}"):
            return symbol("pi") if item.text == "\\pi" else number(0)
        for i, accent in enumerate(item.accents):
            rest = item.accents[:i] + item.accents[i + 1 :]
            if accent in RATES and (inner := self._peeled(before, replace(item, accents=rest), sup)) is not None:
                for _ in range(RATES[accent]):
                    inner = Node("call", "rate", (inner,))
                return self.kept(inner, key)
        if item.accents and item.accents[0] in ("tilde", "hat"):
            rest = item.accents[1:]
            for accents in (rest, *((mark, *rest) for mark in MARKS)):
                if (inner := self._peeled(before, replace(item, accents=accents), sup)) is not None:
                    return self.kept(made("cross", inner), key)
        return None

    def kept(self, node: Node, key: Key) -> Node:
        """A formula, whose print is remembered."""
        self.letters.written.setdefault(str(node), " ".join(key))
        return node

    def derived(self, node: Node, order: int, what: str) -> Node:
        """A derivative by the letter that the definition contains, else along the line."""
        by = self.letters.argument(node)
        if by is None and ("s",) not in self.letters.names:
            raise UnreadError(f"{what} is a derivative, and no definition in the table says by which letter: print it "
                              "as a fraction")
        for _ in range(order):
            node = Node("call", "slope", (node,)) if by is None else Node("call", "diff", (node, by))
        return node

    def raised(self, node: Node, sup: Sequence[Item]) -> Node:
        """A formula with a superscript: transposed, inverse or a power."""
        text = canonical(sup)
        if not text:
            return node
        if text.removeprefix("-") in TRANSPOSED:
            return made("transposed", made("power", node, negated(number(1))) if text.startswith("-") else node)
        if node.free and (order := ORDER.fullmatch(text)):  # w^{(4)}, w^{IV}
            n = int(order[1]) if order[1] else ROMAN.get((order[2] or order[3] or order[4]).lower(), 0)
            if n < 3:
                raise UnreadError(f"the superscript `{text}` may be an index or the order of a derivative: give the letter "
                                  "with it a line in the table of meanings, or print the derivative as a fraction")
            return self.derived(node, n, f"the superscript `{text}`")
        if text in ("*", "\\ast", "\\star", "\\dagger", "+", "-", "\\circ", "\\prime"):
            raise UnreadError(f"the superscript `{text}` has no meaning: give the letter with it a line in the table of meanings")
        if text.isdigit() and int(text) % 2 == 0 and self.letters.shape(node) in ((3, 1), (2, 1)):  # v^2 is v . v
            square = made("product", made("transposed", node), node)
            return square if text == "2" else made("power", square, number(int(text) / 2))
        return made("power", node, self.sum(sup))


def placed(items: Sequence[Item], letter: str, value: Sequence[Item]) -> list[Item]:
    """Items with a formula in brackets in place of a letter."""
    out = []
    for item in items:
        inside = tuple(tuple(tuple(placed(c, letter, value)) for c in p) if p and isinstance(p[0], tuple) else
                       type(p)(placed(p, letter, value)) for p in item.parts)
        sup = tuple(placed(item.sup, letter, value))
        own = item.kind == "letter" and not item.primes and item.key("") == letter
        out.append(Item("fence", "(", (tuple(value),), sup=sup) if own else replace(item, parts=inside, sup=sup))
    return out


def _row(cells: Sequence[Sequence[Item]], name: str) -> list[Item]:
    """A row of statements; of `aligned`, whose cells come in pairs, several side by side."""
    out: list[Item] = []
    for i, cell in enumerate(cells):
        out += [Item("gap", "\\quad")] if i and i % 2 == 0 and name.startswith("aligned") else []
        out += cell if out else [item for n, item in enumerate(cell) if any(c.kind != "gap" for c in cell[: n + 1])]
    return out


def _flat(items: Sequence[Item]) -> list[Item]:
    """Items in which stacks of statements are one after the other; a stack alone that continues a statement is joined to it."""
    items = [i.parts[0][0] if i.kind == "fence" and i.text in ("\\{", "\\lbrace") and len(i.parts[0]) == 1
             and i.parts[0][0].kind in ("matrix", "stack") and i.parts[0][0].text != "bmatrix" else i for i in items]
    out: list[Item] = []
    for item in items:
        rows = [_row(row, item.text) for row in item.parts] if item.kind in ("stack", "cases", "matrix") else []
        system = item.kind == "stack" or (item.kind in ("cases", "matrix") and len(rows) > 0 and not out
                                          and all(any(i.kind == "relation" and i.text == "=" for i in row) for row in rows))
        if not system:
            out.append(item)
            continue
        for row in rows:
            goes_on = not row or row[0].kind in ("relation", "sign") or (out and out[-1].kind in ("relation", "sign"))
            out += ([] if goes_on or not out else [Item("comma", "\\\\")]) + _flat(row)
    return out
