"""Recorded formulas as LaTeX."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import symengine as se

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, every, pieces, tokens, width
from mbdae.errors import LawError, internal
from mbdae.reports.vectors import Atom, Base, NamedQuantities, NamedVector, Vector
from mbdae.symbolic.vectors import Expr

_SUM, _PRODUCT, _POWER, _ATOM = 0, 1, 2, 3  #: precedence of formulas, from loosest to tightest
_VECTORS = {"r": r"\mathbf{r}", "s": r"\mathbf{s}", "c": r"\mathbf{c}", "x": r"\mathbf{x}", "y": r"\mathbf{y}",
            "z": r"\mathbf{z}",
            "v": r"\mathbf{v}", "w": r"\boldsymbol{\omega}", "du": r"\delta\mathbf{r}", "dpsi": r"\delta\boldsymbol{\psi}",
            "vc": r"\dot{\mathbf{c}}", "ac": r"\ddot{\mathbf{c}}", "al": r"\dot{\boldsymbol{\omega}}", "F": r"\mathbf{F}",
            "M": r"\mathbf{M}", "dc": r"\delta\mathbf{c}",
            "bx": r"\mathbf{b}^x", "by": r"\mathbf{b}^y", "bz": r"\mathbf{b}^z"}
_FUNCTIONS = {"sin": r"\sin", "cos": r"\cos", "tan": r"\tan", "tanh": r"\tanh", "exp": r"\exp", "log": r"\ln",
              "atan2": r"\operatorname{atan2}", "asin": r"\arcsin", "acos": r"\arccos", "atan": r"\arctan", "sinh": r"\sinh",
              "cosh": r"\cosh", "sign": r"\operatorname{sgn}", "Max": r"\max", "Min": r"\min"}
_RELATIONS = {"LessThan": r"\le", "StrictLessThan": "<", "Equality": "=", "Unequality": r"\ne"}


class Writer:
    """LaTeX of the formulas of one record; remembers the symbols, frame vectors and named vectors it wrote."""

    def __init__(self, record: NamedQuantities, letters: Mapping[str, str], names: Mapping[int, str] | None = None) -> None:
        self.record, self.letters, self.names = record, letters, dict(names or {})
        self.used: set[str] = set()  #: names of the scalar symbols written so far
        self.bases: set[Base] = set()
        self.vectors: set[int] = set()
        #: called before a formula is written; gives letters to newly named quantities
        self.renew: Callable[[], None] = lambda: None

    def plain(self, base: Base) -> str:
        """LaTeX of a frame vector."""
        return f"\\mathbf{{i}}_{base.side}" if base.kind == "E" else f"{_VECTORS[base.kind]}_{subscript(base.side)}"

    def of(self, e: Expr | Vector) -> str:
        """LaTeX of a scalar or a vector."""
        return self.vector(e) if isinstance(e, Vector) else self.scalar(e)

    # -- scalars

    def scalar(self, e: Expr) -> str:
        """LaTeX of a scalar."""
        return self._scalar(se.sympify(e))[0]

    def factor(self, e: Expr, level: int = _PRODUCT) -> str:
        """LaTeX of a scalar, in brackets where it binds more loosely than `level`."""
        text, tight = self._scalar(se.sympify(e))
        return text if tight >= level else f"\\left({text}\\right)"

    def _scalar(self, e: Expr) -> tuple[str, int]:
        if isinstance(e, se.Symbol):
            return self._symbol(e)
        if e.is_Number or e == se.pi:
            return self._number(e)
        if isinstance(e, se.Add):
            return self._sum(sorted(e.args, key=self._place)), _SUM
        if isinstance(e, se.Mul):
            return self._product(e)
        if isinstance(e, se.Pow):
            return self._power(e)
        if isinstance(e, se.Piecewise):
            return self._cases(e), _ATOM
        if isinstance(e, se.floor):
            return f"\\left\\lfloor {self.scalar(e.args[0])}\\right\\rfloor", _ATOM
        name = e.get_name() if isinstance(e, se.FunctionSymbol) else type(e).__name__
        if name in ("let", "rate", "UnevaluatedExpr"):
            return self._scalar(e.args[0])
        if name in _RELATIONS:
            return self._comparison(e, name), _SUM
        if name == "Abs":
            return f"\\lvert {self.scalar(e.args[0])}\\rvert", _ATOM
        if name in ("sin", "cos", "tanh") and len(e.args) == 1:
            argument, tight = self._scalar(e.args[0])
            if tight == _ATOM and "\\left" not in argument:
                return f"{_FUNCTIONS[name]} {argument}", _POWER
        arguments = ",\\, ".join(self.scalar(a) for a in e.args)
        return f"{_FUNCTIONS.get(name, f'{chr(92)}operatorname{{{name}}}')}\\left({arguments}\\right)", _ATOM

    def _symbol(self, e: Expr) -> tuple[str, int]:
        if e in self.record.dots:
            a, b = self.record.dots[e]
            return f"{self.atom(a, True)}\\cdot {self.atom(b, True)}", _PRODUCT
        name = str(e)
        self.used.add(name)
        if name not in self.letters:
            self.renew()
        if name not in self.letters:
            raise internal(f"the report has no letter to print for the symbol '{name}'", LawError)
        return self.letters[name], _ATOM

    def _number(self, e: Expr) -> tuple[str, int]:
        if e == se.pi:
            return r"\pi", _ATOM
        if isinstance(e, se.Rational) and not isinstance(e, se.Integer):
            p, q = abs(int(e.p)), int(e.q)
            return f"{'-' if e < 0 else ''}\\tfrac{{{p}}}{{{q}}}", _ATOM if e > 0 else _SUM
        value = float(e)
        simple = Fraction(value).limit_denominator(100)
        if float(simple) == value and simple.denominator > 1:
            return self._number(se.Rational(simple.numerator, simple.denominator))
        if value != int(value) or abs(value) > 1e6:
            text = repr(value)
            if "e" in text:
                mantissa, exponent = text.split("e")
                power = f"10^{{{int(exponent)}}}"
                text = power if mantissa == "1" else f"{mantissa}\\cdot {power}"
        else:
            text = str(int(value))
        return text, _ATOM if value >= 0 else _SUM

    @staticmethod
    def _place(term: Expr) -> tuple[bool, bool, str]:
        """Sort key for the terms of a sum: positive ones first, numbers last."""
        negative = bool(isinstance(term, se.Mul) and term.args[0].is_Number and term.args[0] < 0)
        return (negative, bool(term.is_Number), f"{len(str(term)):4d}{term}")

    def _sum(self, terms: list[Expr]) -> str:
        out = ""
        for term in terms:
            text = self._scalar(term)[0]
            out += text if not out else f" - {text[1:].lstrip()}" if text.startswith("-") else f" + {text}"
        return out

    def _product(self, e: Expr) -> tuple[str, int]:
        sign, above, below = "", [], []
        for factor in e.args:
            if factor.is_Number:
                if factor < 0:
                    sign, factor = "-", -factor
                p, q = (int(factor.p), int(factor.q)) if isinstance(factor, se.Rational) else (factor, 1)
                above += [se.sympify(p)] if p != 1 else []
                below += [se.sympify(q)] if q != 1 else []
            elif isinstance(factor, se.Pow) and factor.args[1].is_Number and factor.args[1] < 0:
                below.append(factor.args[0] ** (-factor.args[1]))
            else:
                above.append(factor)
        # a numerical divisor is written in front, as part of the coefficient
        if below and not any(not f.is_Number for f in below):
            number = [f for f in above if f.is_Number]
            rest = [f for f in above if not f.is_Number]
            front = f"\\tfrac{{{self._joined(number) or '1'}}}{{{self._joined(below)}}}"
            return f"{sign}{front}{self._joined(rest)}", _SUM if sign else _PRODUCT
        if below:
            return f"{sign}\\frac{{{self._joined(above, True) or '1'}}}{{{self._joined(below, True)}}}", (
                _SUM if sign else _PRODUCT
            )
        return f"{sign}{self._joined(above)}", _SUM if sign else _PRODUCT

    def _joined(self, factors: list[Expr], alone: bool = False) -> str:
        if alone and len(factors) == 1:
            return self.scalar(factors[0])
        ordered = sorted(
            factors, key=lambda f: (not f.is_Number, f in self.record.dots, isinstance(f, se.Add | se.Function), str(f))
        )
        if len(ordered) == 1 and ordered[0] in self.record.dots:
            return self.scalar(ordered[0])
        return "\\,".join(self.factor(f, _POWER) for f in ordered)

    def _power(self, e: Expr) -> tuple[str, int]:
        base, exponent = e.args
        if base == se.E:
            return f"\\exp\\left({self.scalar(exponent)}\\right)", _ATOM
        if exponent == se.Rational(1, 2):
            dot = self.record.dots.get(base)
            if dot is not None and dot[0] == dot[1]:
                return f"\\lVert {self.atom(dot[0])}\\rVert", _ATOM
            return f"\\sqrt{{{self.scalar(base)}}}", _ATOM
        if exponent.is_Number and exponent < 0:
            return f"\\frac{{1}}{{{self.scalar(base ** (-exponent))}}}", _PRODUCT
        if isinstance(exponent, se.Rational) and not isinstance(exponent, se.Integer):
            dot = self.record.dots.get(base)
            if dot is not None and dot[0] == dot[1] and int(exponent.q) == 2:
                return f"\\lVert {self.atom(dot[0])}\\rVert^{{{int(exponent.p)}}}", _POWER
            return f"{self.factor(base, _ATOM)}^{{{int(exponent.p)}/{int(exponent.q)}}}", _POWER
        text = self.factor(base, _ATOM)
        if isinstance(base, se.Symbol) and "^" in text:  # TeX takes one superscript alone
            text = f"\\left({text}\\right)"
        return f"{text}^{{{self.scalar(exponent)}}}", _POWER

    def _comparison(self, e: Expr, name: str) -> str:
        left, right = e.args
        if left.is_Number and not right.is_Number and name in ("StrictLessThan", "LessThan"):  # write the unknown on the left
            return f"{self.scalar(right)} {'>' if name[0] == 'S' else chr(92) + 'ge'} {self.scalar(left)}"
        return f"{self.scalar(left)} {_RELATIONS[name]} {self.scalar(right)}"

    def _cases(self, e: Expr) -> str:
        first, condition, second, _ = (*e.args, None, None)[:4]
        if len(e.args) == 4 and condition == se.Lt(0, first) and second == -first:
            return f"\\lvert {self.scalar(first)}\\rvert"
        rows = []
        for value, condition in zip(e.args[::2], e.args[1::2], strict=True):
            said = r"\text{otherwise}" if str(condition) == "True" else self.scalar(condition)
            rows.append(f"{self.scalar(value)} & {said}")
        return r"\begin{cases} " + r" \\ ".join(rows) + r" \end{cases}"

    # -- vectors

    def atom(self, atom: Atom, nested: bool = False) -> str:
        """LaTeX of a single atom."""
        if isinstance(atom, Base):
            self.bases.add(atom)
            return self.plain(atom)
        if isinstance(atom, NamedVector):
            self.vectors.add(atom.number)
            if atom.number not in self.names:
                self.renew()
            return self.names[atom.number]
        text = f"{self.atom(atom.left, True)}\\times {self.atom(atom.right, True)}"
        return f"({text})" if nested else text

    def vector(self, a: Vector) -> str:
        """LaTeX of a sum of vectors."""
        out = ""
        for atom, c in a.terms.items():
            text = self._term(c, atom)
            out += text if not out else f" - {text[1:].lstrip()}" if text.startswith("-") else f" + {text}"
        return out or r"\mathbf{0}"

    def signed(self, a: Vector) -> tuple[str, str]:
        """A sum of vectors as a sign and a factor, in brackets unless it is a single vector."""
        ((atom, c),) = a.terms.items() if len(a.terms) == 1 else ((None, 0),)
        if atom is not None and c in (1, -1):
            return "-" if c == -1 else "", self.atom(atom, True)
        return "", f"\\left({self.vector(a)}\\right)" if a.terms else r"\mathbf{0}"

    def _term(self, c: Expr, atom: Atom) -> str:
        if c in self.record.dots or -c in self.record.dots:
            sign, c = ("", c) if c in self.record.dots else ("-", -c)
            return f"{sign}({self.scalar(c)})\\,{self.atom(atom, True)}"
        vector = self.atom(atom, not bool(c == 1 or c == -1))
        if c == 1:
            return self.atom(atom)
        if c == -1:
            return "-" + self.atom(atom)
        text, tight = self._scalar(c)
        if text.startswith(r"\frac{1}{"):
            return f"\\frac{{{self.atom(atom)}}}{text[len(chr(92) + 'frac{1}') :]}"
        if text.startswith(r"-\frac{1}{"):
            return f"-\\frac{{{self.atom(atom)}}}{text[len(chr(92) + '-frac{1}') :]}"
        if tight == _SUM and isinstance(c, se.Add):
            text = f"\\left({text}\\right)"
        return f"{text}\\,{vector}"


def subscript(side: str) -> str:
    """LaTeX of the name of a frame as an index."""
    return side if len(side) == 1 else f"{{\\text{{{side}}}}}"


# -- quantities that one formula uses are written where they are used

LONGEST = 48.0  #: width in letters above which a formula keeps a line of its own
#: tokens before and after a term that may stand without brackets
_BEFORE = {"", "=", "+", "-", "{", "&", ",", "(", r"\\"}
_AFTER = {"", "=", "+", "-", "}", "&", ",", ")", r"\right", r"\\", r"\end"}
_MARKED = {r"\dot", r"\ddot", r"\tilde", r"\hat", r"\bar", r"\delta", "t"}  #: before a brace: a symbol made of another


def inlined(blocks: Sequence[Block], names: Collection[str], shared: float = 0.0) -> list[Block]:
    """The blocks with every definition of a name that is used once written at its place.

    names: LaTeX of quantities with a definition in the blocks; shared: width in letters up to which a definition is also
    written at several places."""
    lines = {id(e): tokens(e.latex) for e in every(Equation, blocks)}
    told = " ".join(b.text for b in every(Paragraph, blocks))
    todo = [tokens(name) for name in names if len(tokens(name)) > 1 and name not in told]
    gone, again = set[int](), True
    while again:
        again = False
        for key in todo:
            at = [(i, places_of(key, line)) for i, line in lines.items() if i not in gone]
            defined = [i for i, places in at if places == [0] and _body(key, lines[i])]
            uses = [(i, places) for i, places in at if places and i not in defined]
            if len(defined) != 1 or not uses or any(place is None for _, places in uses for place in places):
                continue
            body = _body(key, lines[defined[0]])
            wide, count = width("".join(body)), sum(len(places) for _, places in uses)
            if wide > (LONGEST if count == 1 else shared):
                continue
            for i, places in uses:
                for place in reversed(places):
                    lines[i] = _with(lines[i], place, len(key), body)  # type: ignore[arg-type]
            gone.add(defined[0])
            again = True
    return _rewritten(blocks, lines, gone, [tokens(name) for name in names])


def places_of(key: list[str], line: list[str]) -> list[int | None]:
    """Where a symbol stands in a line of tokens; None where it is a part of another symbol."""
    found: list[int | None] = []
    for i in range(len(line) - len(key) + 1):
        if line[i] == key[0] and line[i : i + len(key)] == key:
            after = line[i + len(key) : i + len(key) + 1]
            if after not in (["_"], ["'"]):
                found.append(None if i > 1 and line[i - 1] == "{" and line[i - 2] in _MARKED else i)
    return found


def _body(key: list[str], line: list[str]) -> list[str]:
    """What a line defines a symbol as; empty where it is no such definition of one line."""
    rest = line[len(key) :]
    while rest and rest[0].isspace():
        rest.pop(0)
    ends = {"=", r"\begin", r"\\", "<", ">", r"\approx", r"\ne"}
    return rest[2:] if rest[:1] == ["="] and not ends & {*rest[1:]} and line[: len(key)] == key else []


def _with(line: list[str], i: int, count: int, body: list[str]) -> list[str]:
    """A line with a formula in place of the tokens of a symbol, in brackets where it would bind otherwise."""
    def near(part: list[str]) -> str:
        return next((t for t in part if not t.isspace() and t != r"\,"), "")

    before, after = near(line[:i][::-1]), near(line[i + count :])
    text = "".join(body)
    terms, factors = len(pieces(text)[0]) > 1 or body[0] == "-", {r"\cdot", r"\times", r"\,"} & {*body}
    loose = before in _BEFORE and after in _AFTER and not (before in ("+", "-") and (body[0] == "-" or (before == "-" and terms)))
    plain = loose or not (terms or factors or after == "^" or body[0] in _FUNCTIONS.values())
    put = body if plain else [r"\left", "(", *body, r"\right", ")"]
    return [*line[:i], *put, *line[i + count :]]


def _rewritten(blocks: Sequence[Block], lines: dict[int, list[str]], gone: set[int], keys: Sequence[list[str]]) -> list[Block]:
    """The blocks with their equations' new lines, without the equations in `gone` and without a "with" before no definition of
    one of the keys."""
    out: list[Block] = []
    for block in blocks:
        if isinstance(block, Section):
            block = replace(block, blocks=_rewritten(block.blocks, lines, gone, keys))
        elif isinstance(block, Equation):
            if id(block) in gone:
                continue
            block = replace(block, latex="".join(lines[id(block)]))
        out.append(block)
    leads = Paragraph("with")
    return [b for b, after in zip(out, [*out[1:], None], strict=False) if b != leads or (
        isinstance(after, Equation) and any(_body(key, tokens(after.latex)) for key in keys))]
