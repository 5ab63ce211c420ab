"""Formulas of TeX as pieces with their scripts: letters, numbers, fences, fractions, roots, matrices, signs and relations.

What the pieces mean, `tex` says: here is only how TeX is written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from mbdae.audit.notation import AuditError
from mbdae.documents.mathml import GREEK

ANGLES = {"\\degree": True, "^\\circ": True, "\\radian": False, "rad": False, "": False}  #: units of siunitx: whether degrees
FONTS = {"mathbf": "mathbf", "boldsymbol": "mathbf", "bm": "mathbf", "pmb": "mathbf", "mathsf": "mathsf", "mathcal": "mathcal",
         "mathbb": "mathbb", "mathfrak": "mathfrak", "underline": "underline", "vec": "vec"}
UPRIGHT = {"mathrm", "mathit", "mathnormal", "text", "textrm", "textit", "mbox", "operatorname", "operatorname*"}
ACCENTS = {"dot": "dot", "ddot": "ddot", "dddot": "dddot", "tilde": "tilde", "widetilde": "tilde", "hat": "hat", "widehat": "hat",
           "bar": "bar", "overline": "bar", "check": "check", "breve": "breve"}
RATES = {"dot": 1, "ddot": 2, "dddot": 3}
MARKS = ("bar", "mathbf", "vec", "underline", "mathsf")  #: accents that a vector may have and its matrix with a tilde lacks
FUNCTIONS = {"sin": "sin", "cos": "cos", "tan": "tan", "sinh": "sinh", "cosh": "cosh", "tanh": "tanh", "exp": "exp", "ln": "log",
             "log": "log", "arcsin": "asin", "arccos": "acos", "arctan": "atan", "asin": "asin", "acos": "acos", "atan": "atan",
             "sgn": "sign", "sign": "sign", "signum": "sign", "det": "det", "tr": "trace", "trace": "trace", "atan2": "atan2",
             "arctan2": "atan2", "abs": "abs", "arsinh": "asinh", "arcosh": "acosh", "artanh": "atanh"}
INVERSES = {"sin": "asin", "cos": "acos", "tan": "atan", "sinh": "asinh", "cosh": "acosh", "tanh": "atanh"}
RELATIONS = {"=": "=", ":=": "=", "=:": "=", "<": "<", ">": ">"} | {f"\\{name}": sign for name, sign in (
    ("equiv", "="), ("triangleq", "="), ("coloneqq", "="), ("eqqcolon", "="),
    ("le", "<="), ("leq", "<="), ("leqslant", "<="), ("ge", ">="), ("geq", ">="),
    ("geqslant", ">="), ("ne", "!="), ("neq", "!="), ("in", "in"))}
_READ_NOT = {
    "an approximation, which is not judged": "approx simeq cong", "an order of magnitude, which is not judged": "sim ll gg",
    "a proportion, which is not judged": "propto", "a limit or a map, which is not judged": "to rightarrow mapsto",
    "two formulas in one, with either sign: print them one by one": "pm mp",
    "a conclusion, not an equation": "Rightarrow Leftrightarrow implies iff"}
NOT_READ = {f"\\{name}": why for why, names in _READ_NOT.items() for name in names.split()}
DOTS = {"\\ldots", "\\dots", "\\cdots"}
_SIZES = [f"\\{size}{side}" for size in ("big", "Big", "bigg", "Bigg") for side in ("", "l", "r", "m")]
_SPACING = "thinspace limits nolimits displaystyle textstyle mathstrut relax allowbreak strut"
SPACES = {"~", *(f"\\{c}" for c in ",;:! "), *_SIZES, *(f"\\{name}" for name in _SPACING.split(" "))}
GAPS = {"\\quad", "\\qquad"}
FENCES = {"(": ")", "[": "]", "|": "|"} | {f"\\{a}": f"\\{b}" for a, b in (
    "{}", "||", ("lbrace", "rbrace"), ("lbrack", "rbrack"), ("lvert", "rvert"), ("lVert", "rVert"), ("Vert", "Vert"),
    ("vert", "vert"), ("langle", "rangle"))}
BARS = {"|": "abs", "\\vert": "abs", "\\lvert": "abs", "\\|": "norm", "\\Vert": "norm", "\\lVert": "norm"}
MATRICES = {"matrix", "bmatrix", "pmatrix", "Bmatrix", "vmatrix", "smallmatrix", "array"}
STACKS = {"split", "aligned", "gathered", "alignedat"}
_NAMED = "partial ell int sum nabla top intercal prime max min hbar imath jmath infty circ Re Im iint oint star"
NAMED = {*_NAMED.split(" ")}
TRANSPOSED = {"T", "\\top", "\\intercal", "\\mathsf{T}", "\\mathsf{t}", "\\mathsf{\\top}", "t"}
_ALONE = ("letter", "fence", "sign", "relation")  #: items between braces that are what they are without them
DEEPEST = 40  #: brackets, fractions and scripts within each other that are read


class UnreadError(AuditError):
    """A piece of TeX that cannot be read; the message says which and why."""


@dataclass(frozen=True)
class Item:
    """A piece of a formula with its scripts. kinds: letter, number, fence, frac, root, matrix, cases, stack, sign, relation,
    comma, gap, text, group."""

    kind: str
    text: str = ""
    parts: tuple[Any, ...] = ()  #: lists of items: what is inside, or rows of cells of a matrix
    accents: tuple[str, ...] = ()
    sub: tuple[Item, ...] = ()
    sup: tuple[Item, ...] = ()
    primes: int = 0

    def with_script(self, sign: str, script: tuple[Item, ...]) -> Item:
        """This item with a script more, after `_` or `^`."""
        return replace(self, sub=self.sub + script) if sign == "_" else replace(self, sup=self.sup + script)

    def key(self, sup: str | None = None) -> str:
        """The letter as one canonical TeX; sup: another superscript."""
        text = self.text
        for accent in reversed(self.accents):
            text = f"\\{accent}{{{text}}}"
        low, high = canonical(self.sub), canonical(self.sup) if sup is None else sup
        low = re.sub(r"\\mathrm\{(\w+)\}", r"\1", low)  # v_{\mathrm{rel}} and v_{\text{rel}} are v_{rel}
        return text + "'" * self.primes + (f"_{{{low}}}" if low else "") + (f"^{{{high}}}" if high else "")


CONSTANT = Item("letter", "\\mathrm{const}")  #: a side that says that the other is a constant of the motion


def canonical(items: Sequence[Item]) -> str:
    """Items as TeX in one form whatever the braces and spaces they were written with."""
    out = ""
    for item in items:
        if item.kind in ("gap", "text") and not item.text.strip():
            continue
        inside = [canonical(p) for p in item.parts] if item.kind in ("fence", "frac", "root", "group") else []
        if item.kind == "fence":
            text = item.text + inside[0] + FENCES.get(item.text, "")
        elif item.kind in ("frac", "root"):
            text = "\\" + ("frac" if item.kind == "frac" else "sqrt") + "".join(f"{{{p}}}" for p in inside)
        else:
            text = inside[0] if item.kind == "group" else item.text
        made_ = replace(item, text=text).key()
        out += (" " if re.search(r"\\[A-Za-z]+$", out) and made_[:1].isalpha() else "") + made_
    return out


class Items:
    """Tokens of TeX, with macros replaced, read into items."""

    def __init__(self, tokens: Sequence[str]) -> None:
        self.tokens, self.at, self.depth, depth = list[str](), 0, 0, 0
        for token in tokens:
            depth += (token == "\\begin") - (token == "\\end")
            if not token.isspace() and token not in SPACES and (token != "&" or depth):
                self.tokens.append(token)

    def all(self) -> tuple[Item, ...]:
        """All items; UnreadError where brackets do not match."""
        found = self.row(())
        if self.at < len(self.tokens):
            raise UnreadError(f"`{self.tokens[self.at]}` closes nothing that is open")
        return found

    def row(self, stop: Sequence[str]) -> tuple[Item, ...]:
        """Items up to a token of `stop`, which is not consumed."""
        out: list[Item] = []
        ends = {*stop, "}", "\\right", "\\end"}
        while self.at < len(self.tokens) and self.tokens[self.at] not in ends:
            if self.tokens[self.at] == "\\over":  # {a \over b}
                self.at += 1
                return (Item("frac", "over", (tuple(out), self.row(stop))),)
            item = self.scripted(self.one())
            out += item.parts[0] if item.kind == "group" and item.text == "over" else [item] if item.kind != "nothing" else []
        return tuple(out)

    def take(self) -> str:
        """The next token, which is consumed."""
        if self.at >= len(self.tokens):
            raise UnreadError("the formula ends where a letter or a bracket should follow")
        self.at += 1
        return self.tokens[self.at - 1]

    def argument(self) -> tuple[Item, ...]:
        """What a command or a script applies to: a group or one token, of a number its first figure."""
        if self.at < len(self.tokens) and self.tokens[self.at].isdigit():
            return (Item("number", self.take()),)
        if self.at < len(self.tokens) and self.tokens[self.at] == "{":
            self.at += 1
            found = self.row(())
            self.close("}")
            return found
        found_ = self.one()
        return (found_,) if found_.kind != "group" else found_.parts[0]

    def close(self, wanted: str) -> None:
        """Consume a token that has to follow."""
        found = self.take() if self.at < len(self.tokens) else "the end"
        if found != wanted:
            raise UnreadError(f"`{wanted}` is missing before `{found}`")

    def scripted(self, item: Item) -> Item:
        """An item with the primes, indices and exponents after it."""
        while self.at < len(self.tokens) and self.tokens[self.at] in ("_", "^", "'", "\\prime"):
            sign = self.take()
            if sign in ("'", "\\prime"):
                item = replace(item, primes=item.primes + 1)
                continue
            script = self.argument()
            if item.kind == "group" and item.text == "over" and item.parts[0][-1].kind == "letter":  # scripts of the last letter
                *first, last = item.parts[0]
                item = replace(item, parts=((*first, last.with_script(sign, script)),))
                continue
            if sign == "^" and script and all(i.text == "\\prime" for i in script):
                item = replace(item, primes=item.primes + sum(1 + i.primes for i in script))
            elif item.kind == "group" and not item.parts[0]:  # {}_I r
                after = self.scripted(self.one()) if sign == "_" and self.at < len(self.tokens) else item
                if after.kind != "letter":
                    raise UnreadError("an index stands at no letter")
                return replace(after, text=f"{{}}_{{{canonical(script)}}}{after.text}")
            else:
                item = item.with_script(sign, script)
        return item

    def one(self) -> Item:
        """The next item without its scripts."""
        self.depth += 1
        if self.depth > DEEPEST:
            raise UnreadError(f"brackets, fractions or scripts stand more than {DEEPEST} deep in each other")
        found = self._one()
        self.depth -= 1
        return found

    def _one(self) -> Item:
        token = self.take()
        name = token[1:] if token.startswith("\\") else ""
        if token == "{":
            self.at -= 1
            inside = self.argument()
            if not inside and self.tokens[self.at : self.at + 1] not in (["_"], ["^"]):
                return Item("nothing")  # space around a sign
            return inside[0] if len(inside) == 1 and inside[0].kind in _ALONE else Item("group", "", (inside,))
        if token.isdigit() or (token == "." and self.at < len(self.tokens) and self.tokens[self.at].isdigit()):
            while self.at < len(self.tokens):
                comma = self.tokens[self.at : self.at + 3] == ["{", ",", "}"]  # 0{,}5
                point = comma or self.tokens[self.at] == "."
                if not "".join(self.tokens[self.at + 2 * comma + point :][:1]).isdigit():
                    break
                self.at += 2 * comma
                token += "." if self.take() in ("}", ".") else self.tokens[self.at - 1]
            return Item("number", token)
        if token + "".join(self.tokens[self.at : self.at + 1]) in (":=", "=:"):
            return Item("relation", token + self.take())
        if token in RELATIONS or token in NOT_READ:
            return Item("relation", token)
        if token in "+-/*" or token in ("\\cdot", "\\times", "\\div", "\\ast"):
            return Item("sign", {"*": "\\cdot", "\\ast": "\\cdot", "\\div": "/"}.get(token, token))
        if token in (",", ";"):
            return Item("comma", token)
        if token in GAPS:
            return Item("gap", token)
        if token == "\\left":
            return self.fence(self.take(), left=True)
        if token in FENCES:
            return self.fence(token)
        return self.command(name) if name else Item("letter", token)

    def fence(self, opening: str, left: bool = False) -> Item:
        r"""What stands between two brackets; left: after `\left`."""
        closing = "\\right" if left else FENCES[opening]
        inside = self.row((closing,))
        self.close(closing)
        end = self.take() if left else closing
        if left and opening == "." and end in BARS:
            raise UnreadError("a value at a point, `\\left. ... \\right|`, is not read: print it as a formula of its own")
        return Item("fence", opening, (inside,))

    def command(self, name: str) -> Item:
        """An item that begins with a command."""
        if name in UPRIGHT:
            return self.upright(name)
        if name in FONTS or name in ACCENTS:
            return self.accented(FONTS.get(name) or ACCENTS[name])
        if name in ("frac", "dfrac", "tfrac", "cfrac", "sfrac"):
            return Item("frac", name, (self.argument(), self.argument()))
        if name == "sqrt":
            index = tuple[Item, ...]()
            if self.tokens[self.at : self.at + 1] == ["["]:
                self.at += 1
                index = self.row(("]",))
                self.close("]")
            return Item("root", name, (self.argument(), index) if index else (self.argument(),))
        if name == "begin":
            return self.environment()
        if name in GREEK or name in FUNCTIONS or name in NAMED or f"\\{name}" in DOTS:
            return Item("letter", "\\" + name)
        if name == "\\":
            return Item("comma", "\\\\")
        if name in ("overset", "underset", "stackrel"):
            _, marked = self.argument(), self.argument()
            if [i.kind for i in marked] == ["relation"]:
                return marked[0]
        if name in ("boxed", "underbrace", "overbrace"):
            inside = self.argument()
            if name != "boxed" and self.tokens[self.at : self.at + 1] in (["_"], ["^"]):  # what is said of it
                _ = self.take(), self.argument()
            return Item("group", "over", (inside,))
        if name in ("phantom", "hspace", "vspace", "label", "color", "footnote"):
            self.argument()
            return Item("nothing")
        if name in ("num", "ang", "SI", "qty", "si", "unit"):
            value, unit = "" if name in ("si", "unit") else self.raw(), "" if name in ("num", "ang") else self.raw()
            if not value or unit not in ANGLES:
                raise UnreadError(f"`\\{name}` gives the value {value or 1} with the unit `{unit}`, which is not judged")
            return Item("number", number(value, name == "ang" or ANGLES[unit]))
        raise UnreadError(f"the command `\\{name}` is not known")

    def raw(self) -> str:
        """The text of a group, unchanged."""
        start = self.at
        self.close("{")
        depth = 1
        while depth:
            depth += {"{": 1, "}": -1}.get(self.take(), 0)
        return "".join(self.tokens[start + 1 : self.at - 1])

    def upright(self, name: str) -> Item:
        """A word or a letter in upright type."""
        word = self.raw() if self.tokens[self.at : self.at + 1] == ["{"] else self.take()
        if word.strip(" .,") in ("const", "constant", "konst"):
            return CONSTANT
        if name in ("text", "textrm", "textit", "mbox") and not re.fullmatch(r"\w", word):
            if re.fullmatch(r"\s*\[.*\]\s*", word):  # a unit
                return Item("nothing")
            return Item("text", word)
        if word.lstrip("\\") in FUNCTIONS:
            return Item("letter", "\\" + word.lstrip("\\"))
        return Item("letter", word) if re.fullmatch(r"\\?\w", word) else Item("letter", f"\\mathrm{{{word}}}")

    def accented(self, accent: str) -> Item:
        """What stands under an accent or in a font."""
        inside = self.argument()
        if len(inside) == 1 and inside[0].kind == "letter" and not (inside[0].primes or inside[0].sup):
            return replace(inside[0], accents=(accent, *inside[0].accents))
        if accent in FONTS.values() and len(inside) == 1 and inside[0].kind == "number":
            return Item("letter", "1", accents=(accent,)) if inside[0].text == "1" else inside[0]  # an identity
        if accent not in RATES and accent not in ("tilde", "hat", "bar"):
            operators = {"\\delta", "\\partial", "d", "\\Delta"}
            return Item("group", "over", (tuple(replace(i, accents=(accent, *i.accents)) if i.kind == "letter" and not (
                i.text in operators and i is not inside[-1]) else i for i in inside),))
        return Item("group", accent, (inside,))

    def environment(self) -> Item:
        """A matrix, cases, or statements one below the other."""
        name = self.raw().rstrip("*")
        if name in ("array", "alignedat") and self.tokens[self.at : self.at + 1] == ["{"]:
            self.raw()
        if name not in MATRICES | STACKS | {"cases", "dcases", "rcases"}:
            raise UnreadError(f"the environment `{name}` is not known")
        rows: list[list[tuple[Item, ...]]] = [[]]
        while True:
            rows[-1].append(self.row(("&", "\\\\")))
            token = self.take()
            if token == "\\end":
                self.raw()
                break
            if token == "\\\\":
                rows.append([])
                if self.tokens[self.at : self.at + 1] == ["["] and "]" in self.tokens[self.at :]:  # a distance
                    end = self.tokens.index("]", self.at)
                    skip = re.fullmatch(r"\[[\d.]+[a-z]{2}", "".join(self.tokens[self.at : end]))
                    self.at = end + 1 if skip else self.at
            elif token != "&":
                raise UnreadError(f"`{token}` stands in {name} where a row should end")
        kept = tuple(tuple(row) for row in rows if any(row))
        return Item("cases" if "cases" in name else "stack" if name in STACKS else "matrix", name, kept)


def number(text: str, degrees: bool = False) -> str:
    """The number that siunitx prints, `2e-3` or `1 000,5`; degrees: those of an angle, as rad."""
    found = re.fullmatch(r"([-+]?\d*[.,]?\d+)\.?(?:[eEdD]([-+]?\d+))?", re.sub(r"\s|~|\\,", "", text))
    value = float(f"{found[1].replace(',', '.')}e{found[2] or 0}") if found else math.inf
    if not math.isfinite(value):
        raise UnreadError(f"the number `{text}` is not read")
    return repr(value * (math.pi / 180 if degrees else 1))
