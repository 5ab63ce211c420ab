"""Formulas of the notation in LaTeX. Names such as b3k or zkdot become letters with indices and dots, others stay as written;
a text overrides this by `NAME [UNIT] $TEX$: MEANING`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

from mbdae.audit.notation import Node, Statement, bare
from mbdae.documents.mathml import GREEK

_LETTERS = {name: "\\" + name for name in GREEK} | {"phi": r"\varphi", "w": r"\omega"}
_WORDS = "|".join(sorted(GREEK, key=len, reverse=True))
_NAME = re.compile(
    rf"(?P<change>delta(?=.)|d(?=(?:{_WORDS})|[wW]))?(?P<letter>{_WORDS}|[A-Za-z])(?P<bar>bar)?"
    r"(?P<figure>\d*)(?P<index>phi|)(?P<last>\d*)(?P<body>k|l)?(?P<dots>ddot|dot)?$"
)
_SIGNS = {"delta": r"\delta", "rate": r"\frac{d}{dt}", "slope": r"\frac{d}{ds}"}
#: functions with a LaTeX form of their own; the others are written as name and brackets
_CALLS = {"norm": r"\left\|{0}\right\|", "abs": r"\left|{0}\right|", "sqrt": r"\sqrt{{{0}}}",
          "sum": r"\sum_{{{1}={2}}}^{{{3}}} {0}", "integral": r"\int_{{{2}}}^{{{3}}} {0} \, d{1}",
          "diff": r"\frac{{\partial {0}}}{{\partial {1}}}"}  # fmt: skip
_LONG = {*_SIGNS, "sum", "integral", "diff"}  #: functions that need brackets before an exponent or a transposition sign
_KNOWN = {"sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "log", "det"}  #: names of LaTeX commands
Letters = Mapping[str, str]  #: names of symbols with the TeX that the text gives for them
_NONE: Letters = MappingProxyType({})


def name(text: str, letters: Letters = _NONE, transposed: bool = False, tilde: bool = False) -> str:
    """A name in LaTeX: the TeX given by the text, else its parts as letter, index and dots."""
    match = _NAME.match(text)
    mark = "^{T}" if transposed else ""
    if text in letters:
        inner = rf"\tilde{{{letters[text]}}}" if tilde else letters[text]
        return f"{{{inner}}}{mark}" if mark else inner
    if text == "pi":
        return r"\pi"
    text = text.replace("_", r"\_")
    if match is None or text == "I":
        return (rf"\tilde{{{text}}}" if tilde else text if text == "I" else rf"\mathrm{{{text}}}") + mark
    body, index = match["body"] or "", match["index"]
    if match["letter"] == "mu":
        body, index = "", index + body  # the k of muk stands for kinetic friction, not for body k: it is an index
    letter = _LETTERS.get(match["letter"], match["letter"])
    for accent, given in (("tilde", tilde), ("bar", match["bar"]), (match["dots"] or "", match["dots"])):
        letter = rf"\{accent}{{{letter}}}" if given else letter
    low = match["figure"] + _LETTERS.get(index, index) + match["last"]
    high = body + ("T" if transposed else "")
    change = {"delta": r"\delta ", "d": r"d"}.get(match["change"] or "", "")
    return change + letter + (f"_{{{low}}}" if low else "") + (f"^{{{high}}}" if high else "")


def statement(s: Statement, letters: Letters = _NONE) -> str:
    """A statement in LaTeX."""
    relation = " = " if s.relation == "=" else r" \le "
    return relation.join(formula(side, letters) for side in s.sides)


def formula(node: Node, letters: Letters = _NONE, level: int = 0) -> str:
    """A formula in LaTeX; level 0: in a sum, 1: in a product, 2: under a tilde, prime or power."""
    kind, parts = node.kind, node.parts
    if kind == "number":
        return f"{node.value:g}"
    if kind == "symbol":
        return name(node.value, letters)
    if kind == "call":
        text = _call(node, letters)
        return rf"\left({text}\right)" if level == 2 and node.value in _LONG else text
    if kind == "block":
        rows = r" \\ ".join(" & ".join(formula(p, letters) for p in row.parts) for row in parts)
        return rf"\begin{{bmatrix}} {rows} \end{{bmatrix}}"
    if kind in ("cross", "transposed"):
        return _marked(node, letters)
    if kind == "power":
        return f"{{{formula(parts[0], letters, 2)}}}^{{{formula(parts[1], letters)}}}"
    if kind == "inverse":
        return rf"\frac{{1}}{{{formula(parts[0], letters)}}}"
    text = _sum(node, letters) if kind in ("sum", "neg") else _product(node, letters)
    return rf"\left({text}\right)" if level > (0 if kind in ("sum", "neg") else 1) else text


def _marked(node: Node, letters: Letters) -> str:
    transposed = node.kind == "transposed"
    inner = node.parts[0] if transposed else node
    tilde = inner.kind == "cross"
    base = inner.parts[0] if tilde else inner
    if base.kind == "symbol":
        return name(base.value, letters, transposed, tilde)
    text = rf"\widetilde{{{formula(base, letters, 2)}}}" if tilde else formula(base, letters, 2)
    return f"{{{text}}}^{{T}}" if transposed else text


def _sum(node: Node, letters: Letters) -> str:
    terms = node.parts if node.kind == "sum" else (node,)
    text = "".join((" - " if t.kind == "neg" else " + ") + formula(bare(t), letters, 1) for t in terms)
    return text.removeprefix(" + ").lstrip()


def _product(node: Node, letters: Letters) -> str:
    """A product in LaTeX. A product with one factor becomes one fraction over all divisors; with several factors, each divisor
    goes under the factor before it, so that the order of matrices stays."""
    above = [formula(p, letters, 1) for p in node.parts if p.kind != "inverse"]
    below = [p.parts[0] for p in node.parts if p.kind == "inverse"]
    if below and len(above) < 2:
        bottom = r" \, ".join(formula(p, letters, 1) for p in below)
        return rf"\frac{{{above[0] if above else 1}}}{{{bottom}}}"
    out: list[str] = []
    for part in node.parts:
        if part.kind == "inverse" and out:
            out[-1] = rf"\frac{{{out[-1]}}}{{{formula(part.parts[0], letters)}}}"
        else:
            out.append(formula(part, letters, 1))
    return r" \, ".join(out)


def _call(node: Node, letters: Letters) -> str:
    level = 1 if node.value in ("sum", "integral") else 0
    inner = [formula(p, letters, level if i == 0 else 0) for i, p in enumerate(node.parts)]
    if node.value in _CALLS:
        return _CALLS[node.value].format(*inner)
    if node.value in _SIGNS:
        sign = _SIGNS[node.value]
        return rf"{sign} \left({inner[0]}\right)" if node.parts[0].parts else f"{sign} {inner[0]}"
    head = rf"\{node.value}" if node.value in _KNOWN else rf"\operatorname{{{node.value}}}"
    return rf"{head}\left({', '.join(inner)}\right)"
