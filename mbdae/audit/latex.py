"""Formulas of the notation in LaTeX; names such as b3k or zkdot become letters with indices and dots."""

from __future__ import annotations

import re

from mbdae.audit.notation import Node, Statement
from mbdae.documents.mathml import GREEK

_LETTERS = {name: "\\" + name for name in GREEK} | {"phi": r"\varphi", "w": r"\omega"}
_WORDS = "|".join(sorted(GREEK, key=len, reverse=True))
_NAME = re.compile(
    rf"(?P<change>delta(?=.)|d(?=(?:{_WORDS})|[wW]))?(?P<letter>{_WORDS}|[A-Za-z])(?P<bar>bar)?"
    r"(?P<figure>\d*)(?P<index>phi|[a-z]*?)(?P<last>\d*)(?P<body>k|l)?(?P<dots>ddot|dot)?_*$"
)
_CALLS = {"sin", "cos", "tan", "tanh", "exp"}


def name(text: str, transposed: bool = False, tilde: bool = False) -> str:
    """A name in LaTeX."""
    match = _NAME.match(text)
    mark = "^{T}" if transposed else ""
    if match is None or text == "I":
        return (rf"\tilde{{{text}}}" if tilde else text if text == "I" else rf"\mathrm{{{text}}}") + mark
    body, index = match["body"] or "", match["index"]
    if match["letter"] == "mu":
        body, index = "", index + body  # coefficients of friction
    letter = _LETTERS.get(match["letter"], match["letter"])
    for accent, given in (("tilde", tilde), ("bar", match["bar"]), (match["dots"] or "", match["dots"])):
        letter = rf"\{accent}{{{letter}}}" if given else letter
    low = match["figure"] + _LETTERS.get(index, index) + match["last"]
    high = body + ("T" if transposed else "")
    change = {"delta": r"\delta ", "d": r"d"}.get(match["change"] or "", "")
    return change + letter + (f"_{{{low}}}" if low else "") + (f"^{{{high}}}" if high else "")


def statement(s: Statement) -> str:
    """A statement in LaTeX."""
    relation = " = " if s.relation == "=" else r" \le "
    return relation.join(formula(side) for side in s.sides)


def formula(node: Node, level: int = 0) -> str:
    """A formula in LaTeX; level as in the notation: 0 in a sum, 1 in a product, 2 under a mark."""
    kind, parts = node.kind, node.parts
    if kind == "number":
        return f"{node.value:g}"
    if kind == "symbol":
        return name(node.value)
    if kind == "call":
        return _call(node)
    if kind == "block":
        rows = r" \\ ".join(" & ".join(formula(p) for p in row.parts) for row in parts)
        return rf"\begin{{bmatrix}} {rows} \end{{bmatrix}}"
    if kind in ("cross", "transposed"):
        return _marked(node)
    if kind == "power":
        return f"{{{formula(parts[0], 2)}}}^{{{formula(parts[1])}}}"
    if kind == "inverse":
        return rf"\frac{{1}}{{{formula(parts[0])}}}"
    text = _sum(node) if kind in ("sum", "neg") else _product(node)
    return rf"\left({text}\right)" if level > (0 if kind in ("sum", "neg") else 1) else text


def _marked(node: Node) -> str:
    transposed = node.kind == "transposed"
    inner = node.parts[0] if transposed else node
    tilde = inner.kind == "cross"
    base = inner.parts[0] if tilde else inner
    if base.kind == "symbol":
        return name(base.value, transposed, tilde)
    text = rf"\widetilde{{{formula(base, 2)}}}" if tilde else formula(base, 2)
    return text + ("^{T}" if transposed else "")


def _sum(node: Node) -> str:
    terms = node.parts if node.kind == "sum" else (node,)
    text = ""
    for term in terms:
        if term.kind == "neg":
            text += ("" if not text else " ") + "- " + formula(term.parts[0], 1)
        else:
            text += (" + " if text else "") + formula(term, 1)
    return text


def _product(node: Node) -> str:
    above = [formula(p, 1) for p in node.parts if p.kind != "inverse"]
    below = [formula(p.parts[0], 1) for p in node.parts if p.kind == "inverse"]
    text = r" \, ".join(above) or "1"
    if not below:
        return text
    bottom = below[0] if len(below) == 1 else r" \, ".join(below)
    if len(above) > 1:  # a/b c: the quotient stands where its inverse stands
        return r" \, ".join(_factors(node))
    return rf"\frac{{{text}}}{{{bottom}}}"


def _factors(node: Node) -> list[str]:
    """Factors with every inverse put below the one before it."""
    out: list[str] = []
    for part in node.parts:
        if part.kind == "inverse" and out:
            out[-1] = rf"\frac{{{out[-1]}}}{{{formula(part.parts[0])}}}"
        else:
            out.append(formula(part, 1))
    return out


def _call(node: Node) -> str:
    inner = [formula(p) for p in node.parts]
    if node.value == "norm":
        return rf"\left\|{inner[0]}\right\|"
    if node.value == "abs":
        return rf"\left|{inner[0]}\right|"
    if node.value == "sqrt":
        return rf"\sqrt{{{inner[0]}}}"
    if node.value == "diff":
        return rf"\frac{{\partial {inner[0]}}}{{\partial {inner[1]}}}"
    if node.value in ("delta", "rate"):
        sign = r"\delta" if node.value == "delta" else r"\frac{d}{dt}"
        return rf"{sign} \left({inner[0]}\right)" if node.parts[0].parts else f"{sign} {inner[0]}"
    head = rf"\{node.value}" if node.value in _CALLS else rf"\operatorname{{{node.value}}}"
    return rf"{head}\left({', '.join(inner)}\right)"
