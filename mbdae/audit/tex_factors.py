"""Factors of a term as TeX prints them: letters, fractions, fences, functions, derivatives, sums and integrals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from mbdae.audit.calculus import Letters, factors_of, related
from mbdae.audit.notation import Node, made, number, symbol
from mbdae.audit.tex_items import BARS, FUNCTIONS, INVERSES, RATES, TRANSPOSED, Item, UnreadError, canonical

DIFFERENTIALS = {"d", "\\partial"}


class Reader(Protocol):
    """What reads the formula that a term belongs to, see `tex.Formula`."""
    letters: Letters
    bound: dict[tuple[str, ...], str]
    lists: dict[Node, list[Node]]
    present: frozenset[str]

    def sum(self, items: Sequence[Item]) -> Node: """A formula without a relation."""
    def product(self, items: Sequence[Item]) -> Node: """A term."""
    def letter(self, before: tuple[str, ...], item: Item) -> Node | None: """A letter of the table."""
    def derived(self, node: Node, order: int, what: str) -> Node: """A derivative that primes print."""
    def raised(self, node: Node, sup: Sequence[Item]) -> Node: """A formula with a superscript."""
    def kept(self, node: Node, key: tuple[str, ...]) -> Node: """A formula whose print is remembered."""


class Factors:
    """Reads the factors of one term, from left to right."""

    def __init__(self, formula: Reader, items: Sequence[Item]) -> None:
        self.formula, self.items, self.at = formula, items, 0
        self.letters = formula.letters

    def all(self) -> list[Node]:
        """The factors; a divisor is an inverse, a factor before a cross product its matrix."""
        out, crossed, below = list[Node](), False, False
        while self.at < len(self.items):
            item = self.items[self.at]
            if item.kind == "sign":
                self.at += 1
                if not out or crossed or below:
                    raise UnreadError(f"a factor is missing before `{item.text}`")
                crossed, below = item.text == "\\times", item.text == "/"
                continue
            node = self.one()
            if crossed and self.letters.shape(out[-1]) == (3, 1):
                out[-1] = made("cross", out[-1])
            crossed = False
            parts = node.parts if node.kind == "product" and item.kind != "fence" and not below else (node,)
            out += [made("inverse", node)] if below else parts
            below = False
        if crossed or below or not out:
            raise UnreadError("a factor is missing at the end of a term")
        return out

    def rest(self) -> Node:
        """All that follows in the term, as one formula."""
        found = self.formula.product(self.items[self.at :]) if self.at < len(self.items) else None
        self.at = len(self.items)
        if found is None:
            raise UnreadError("nothing follows an operator")
        return found

    def one(self) -> Node:
        """The next factor."""
        for length in (3, 2):
            pieces = self.items[self.at : self.at + length]
            if len(pieces) == length and all(p.kind == "letter" for p in pieces) and not any(p.sup for p in pieces[:-1]):
                found = self.formula.letter(tuple(p.key() for p in pieces[:-1]), pieces[-1])
                if found is not None:
                    self.at += length
                    return found
        item = self.items[self.at]
        self.at += 1
        if item.kind == "letter":
            return self.letter(item)
        found = self.plain(item)
        found = self.formula.derived(found, item.primes, "the prime of a bracket") if item.primes else found
        return self.formula.raised(found, item.sup)

    def plain(self, item: Item) -> Node:
        """The factor of an item that is no letter, without its superscript."""
        formula = self.formula
        if item.kind == "number":
            return number(float(item.text))
        if item.kind == "frac":
            return self.derivative(item) or made("product", *factors_of(formula.sum(item.parts[0])),
                                                 made("inverse", formula.sum(item.parts[1])))
        if item.kind == "root":
            inside = formula.sum(item.parts[0])
            return made("power", inside, made("product", number(1), made("inverse", formula.sum(item.parts[1])))) if (
                len(item.parts) > 1) else Node("call", "sqrt", (inside,))
        if item.kind == "matrix":
            return self.matrix(item)
        if item.kind == "fence":
            return self.fence(item)
        if item.kind == "group":
            return accented(formula.sum(item.parts[0]), item.text)
        if item.kind in ("cases", "stack"):
            raise UnreadError(f"`{item.text}` stands inside of a formula: print it as a side of its own")
        raise UnreadError(f"`{item.text}` stands where a letter or a number should")

    def matrix(self, item: Item) -> Node:
        """A matrix, or the determinant of one between bars."""
        rows = [[self.formula.sum(cell) if cell or len(row) == 1 else number(0) for cell in row] for row in item.parts]
        if len({len(row) for row in rows}) != 1:
            raise UnreadError("the rows of a matrix differ in length")
        found = made("block", *(made("row", *self.letters.filled(row)) for row in rows))
        square = len(rows) == len(rows[0])
        return Node("call", "det", (found,)) if item.text == "vmatrix" and square else found

    def fence(self, item: Item) -> Node:
        """What stands between brackets or bars."""
        inside = item.parts[0]
        if len(inside) == 1 and inside[0].kind == "matrix" and inside[0].text in ("array", "matrix", "smallmatrix"):
            found = self.matrix(inside[0])
            square = len(found.parts) == len(found.parts[0].parts)
            return Node("call", "det", (found,)) if item.text in BARS and square else found
        if any(i.kind == "comma" for i in inside) and item.text not in BARS:
            return self.listed(item)
        found = self.formula.sum(inside)
        if item.text in BARS:
            shape = self.letters.shape(found)
            if shape is not None and len(shape) == 2 and shape[0] == shape[1] and BARS[item.text] == "abs":
                return Node("call", "det", (found,))
            column = BARS[item.text] == "norm" or (shape is not None and len(shape) == 2)
            return Node("call", "norm" if column else "abs", (found,))
        if item.text == "\\langle":
            raise UnreadError("angle brackets around one formula (a mean) are not known")
        if item.sub and canonical(item.sub) != "\\times":
            raise UnreadError(f"the index `{canonical(item.sub)}` stands at a bracket")
        return made("cross", found) if item.sub else found

    def listed(self, item: Item) -> Node:
        """Formulas between commas: a row, unless as a column or, of two vectors, as their inner product it fits."""
        cells = [self.formula.sum(c) for c in between(item.parts[0])]
        found = made("block", made("row", *self.letters.filled(cells)))
        inner = self.letters.inner(cells)
        if item.text == "\\langle":
            if not inner:
                raise UnreadError(f"`{canonical([item])}` is no inner product of two vectors")
            return inner[0]
        if item.text == "(" and canonical(item.sup) not in TRANSPOSED:
            self.formula.lists[found] = [made("block", *(made("row", c) for c in cells)), *inner]
        return found

    # -- letters, functions and operators

    def letter(self, item: Item) -> Node:
        """A letter of the table, a function or an operator that begins with a letter."""
        follows = self.items[self.at] if self.at < len(self.items) else item
        if follows.kind == "fence" and (item.key(), canonical([replace(follows, sup=())])) in self.letters.names:
            self.at += 1
            name = self.letters.names[item.key(), canonical([replace(follows, sup=())])]
            return self.formula.raised(symbol(name), follows.sup)
        found = self.formula.letter((), item)
        if found is not None:
            self.arguments(found)
            return found
        if item.key() == "\\mathrm{diag}" and follows.kind == "fence":
            self.at += 1
            cells = list(enumerate(self.formula.sum(c) for c in between(follows.parts[0])))
            rows = (made("row", *(c if i == j else number(0) for j, _ in cells)) for i, c in cells)
            return self.formula.raised(made("block", *rows), follows.sup)
        plain = item.text if not item.accents else ""
        if plain in ("\\delta", "\\int", "\\sum") or plain[1:] in FUNCTIONS:
            return {"\\delta": self.variation, "\\int": self.integral, "\\sum": self.summed}.get(plain, self.called)(item)
        if item.key("") == "e" and item.sup:
            return Node("call", "exp", (self.formula.sum(item.sup),))
        raise UnreadError(f"`{plain}` is not known: print its cases" if plain in ("\\max", "\\min") else
                          f"the letter ${item.key()}$ has no line in the table of meanings{self.letters.near(item.key())}")

    def arguments(self, found: Node) -> None:
        """Skip the arguments printed after a letter, as in x(t), w(x, t)."""
        if self.at >= len(self.items) or (item := self.items[self.at]).kind != "fence" or item.text != "(" or item.sup:
            return
        inside = item.parts[0]
        if found.value == "diff" and len(inside) == 1 and self.formula.letter((), inside[0]) == found.parts[1]:  # w''(x)
            self.at += 1
            return
        listed = all(i.kind in ("letter", "comma") for i in inside) and inside
        name = next((n.value for n in found.walk() if n.kind == "symbol"), "")
        stated = {key[-1] for key, value in self.letters.names.items() if value == name and key[-1].startswith("(")}
        if stated and f"({canonical(inside)})" not in stated:
            raise UnreadError(f"`({canonical(inside)})` at a letter stated with {' or '.join(sorted(stated))} needs its own line")
        of = self.formula.letter((), inside[0]) if listed and len(inside) == 1 and not stated else None
        inner = of.value if of is not None and of.kind == "symbol" else None
        own, doubt = self.letters.contains(name), ""
        arrays = any(i.kind == "letter" and (n := self.formula.letter((), i)) and self.letters.shape(n) != () for i in inside)
        argument = inner != name and inner in own
        if argument and inner not in self.letters.moving and not self.letters.whole(name, inner, self.formula.present):
            doubt = f"give the letter of the table its argument, as ${canonical(self.items[self.at - 1 : self.at + 1])}$"
        elif len(own) > 1 and inner not in (None, *own):
            doubt = f"the definition of {name} does not contain {inner}"
        elif not (stated or listed or arrays or any(i.text in ("+", "-") for i in inside)) and (
                len(own) > 1 or name in self.letters.moving or all(i.kind == "number" for i in inside)):  # w(L/2), x(0)
            doubt = f"${canonical(self.items[self.at - 1 : self.at + 1])}$ needs a line of its own in the table"
        if doubt:
            raise UnreadError(f"`{name}({canonical(inside)})` may be a product or a value at a place: {doubt}")
        pair = [n for i in inside[::2] if (n := self.formula.letter((), i))] if listed and len(inside) == 3 else []
        if self.letters.inner(pair) and not any(node.free & own for node in pair):  # m(v, v)
            if pair[0] != pair[1]:
                raise UnreadError(f"`{name}({canonical(inside)})` may be an inner product or a value: print `\\cdot`")
            return
        if argument or (listed and ("," in canonical(inside) or canonical(inside) == "t" or name in self.letters.functions)):
            self.at += 1

    def variation(self, item: Item) -> Node:
        """A variation: that of the letter or the bracket after the delta."""
        if self.at >= len(self.items):
            raise UnreadError("nothing follows \\delta")
        inner = self.items[self.at]
        self.at += 1
        if inner.kind == "letter":
            for sup in (inner.sup, ()):
                base = self.formula.letter((), replace(inner, sup=sup)) if canonical(sup) not in TRANSPOSED else None
                if base is not None:
                    call = self.formula.kept(Node("call", "delta", (base,)), ("\\delta", inner.key(canonical(sup))))
                    return self.formula.raised(call, () if sup == inner.sup else inner.sup)
            raise UnreadError(f"the letter $\\delta {inner.key()}$ has no line in the table of meanings")
        return self.formula.raised(Node("call", "delta", (self.plain(inner),)), inner.sup)

    def called(self, item: Item) -> Node:
        """A function with its argument: what stands in brackets, or the factors that together have no unit."""
        name, power = FUNCTIONS[item.text[1:]], canonical(item.sup)
        if item.sub:
            raise UnreadError(f"a function with the index `{canonical(item.sub)}` is not known")
        if power == "-1" and name in INVERSES:
            name, power = INVERSES[name], ""
        if self.at >= len(self.items):
            raise UnreadError(f"`{item.text}` has no argument")
        follows = self.items[self.at]
        if follows.kind == "fence" and follows.text in ("(", "[", "\\{", "\\lbrack"):
            self.at += 1
            found = Node("call", name, tuple(map(self.formula.sum, between(follows.parts[0]))))
            return self.formula.raised(self.formula.raised(found, item.sup if power else ()), follows.sup)
        found = Node("call", name, (self.argument(),))
        return self.formula.raised(found, item.sup if power else ())

    def argument(self) -> Node:
        """The factors after a function that together have no unit, of several such the shortest with a letter in rad."""
        factors, best, tried = list[Node](), 0, self.at
        while self.at < len(self.items):
            item = self.items[self.at]
            head = item.text[1:] if item.kind == "letter" else ""
            if item.kind == "sign" or (factors and (head in FUNCTIONS or item.kind in ("fence", "matrix"))):
                break
            factors.append(self.one())
            here = made("product", *factors)
            if factors[-1].kind == "number" and len(factors) == 1 and self.at < len(self.items) and (
                    self.items[self.at].kind in ("letter", "frac")) and self.items[self.at].text[1:] not in FUNCTIONS:
                continue
            fits = self.letters.angle(here)
            if fits is None or fits:
                best, tried = len(factors), self.at
                if fits is None or self.letters.radian(here):
                    break
        if not best:
            best, tried = len(factors), self.at
        self.at = tried
        if not best:
            raise UnreadError("a function has no argument")
        return made("product", *factors[:best])

    def derivative(self, item: Item) -> Node | None:
        """A fraction of differentials as a derivative, applied to what stands in it or follows it; None for other fractions."""
        above, below = item.parts
        pairs = [below[i : i + 2] for i in range(0, len(below), 2)]
        if not above or above[0].key("") not in DIFFERENTIALS or not all(
                len(p) == 2 and p[0].key() == above[0].key("") and p[1].kind == "letter" for p in pairs):
            return None
        inside = above[1:]
        if inside:
            node = self.formula.sum(inside)
        else:
            fenced = self.at < len(self.items) and self.items[self.at].kind in ("fence", "frac")
            node = self.one() if fenced else self.rest()
        for _, by in pairs:
            order = canonical(by.sup)
            for _ in range(int(order) if order.isdigit() else 1):
                node = self.by(node, by if not order.isdigit() else replace(by, sup=()), above[0].text == "\\partial")
        return node

    def by(self, node: Node, item: Item, partial: bool) -> Node:
        """The derivative of a formula by a letter, see `Letters.derived`."""
        found = self.formula.letter((), item)
        if found is None and (move := {"t": "rate", "s": "slope"}.get(item.key())):
            return Node("call", move, (node,))
        if found is None:
            raise UnreadError(f"the letter ${item.key()}$ has no line in the table of meanings")
        return self.letters.derived(node, found, partial)

    def integral(self, item: Item) -> Node:
        """An integral between limits, up to its dx."""
        if not item.sub or not item.sup:
            raise UnreadError("an integral without limits is not read")
        items, depth, end = self.items[self.at :], 1, -1
        for i in range(len(items) - 1):  # integrals within it end first
            depth += items[i].text == "\\int"
            depth -= items[i].key() == "d" and items[i + 1].kind == "letter"
            end = i if not depth and end < 0 else end
        if end < 0:
            raise UnreadError("an integral ends with no `dx`")
        self.at += end + 2
        low, high = self.formula.sum(item.sub), self.formula.sum(item.sup)
        body = items[:end] or [Item("number", "1")]
        return self.over("integral", items[end + 1], lambda: self.formula.sum(body), low, high)

    def summed(self, item: Item) -> Node:
        """A sum between limits, of all that follows in the term."""
        parts, signs = related(item.sub)
        if signs != ["="] or len(parts[0]) != 1 or not item.sup:
            raise UnreadError("a sum has no limits such as `\\sum_{i=1}^{n}`")
        return self.over("sum", parts[0][0], self.rest, self.formula.sum(parts[1]), self.formula.sum(item.sup))

    def over(self, name: str, letter: Item, body: Callable[[], Node], low: Node, high: Node) -> Node:
        """A sum or an integral over a letter of its own."""
        key, bound = (letter.key(),), self.formula.bound
        own = self.letters.names.get(key) or "".join(c for c in letter.key() if c.isalnum())
        self.formula.bound = {**bound, key: own}
        inside = body()
        self.formula.bound = bound
        if own not in inside.free and high.free & self.letters.time & set().union(*map(self.letters.contains, inside.free)):
            raise UnreadError(f"what is integrated to ${high}$ contains {high} and not ${letter.key()}$")
        return Node("call", name, (inside, symbol(own), low, high))


def between(items: Sequence[Item]) -> list[list[Item]]:
    """Items between commas."""
    out = [list[Item]()]
    for item in items:
        out.append([]) if item.kind == "comma" else out[-1].append(item)
    return out


def accented(node: Node, accent: str) -> Node:
    """A formula under an accent."""
    if accent in RATES:
        for _ in range(RATES[accent]):
            node = Node("call", "rate", (node,))
    elif accent in ("tilde", "hat"):
        node = made("cross", node)
    elif accent:
        raise UnreadError(f"the accent `\\{accent}` stands over a formula")
    return node
