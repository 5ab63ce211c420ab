r"""LaTeX formulas taken apart: tokens, and the places where a long one may be broken."""

from __future__ import annotations

import re
from collections.abc import Iterator

_TOKEN = re.compile(r"\\[A-Za-z]+\*?|\\.|[^\\]", re.DOTALL)
_OPEN, _CLOSE = {"{", r"\left", r"\begin", "(", "[", r"\{", r"\lbrack"}, {"}", r"\right", r"\end", ")", "]", r"\}", r"\rbrack"}
#: a line may end before these, outside all brackets
RELATIONS = {"=", "<", ">", r"\le", r"\ge", r"\ne", r"\approx", r"\equiv", r"\Leftrightarrow", r"\Rightarrow", r"\in"}
BINARY = {"+", "-", r"\pm"}
SPACES = {r"\quad", r"\qquad"}


def tokens(latex: str) -> list[str]:
    """Commands and characters in their order."""
    return _TOKEN.findall(latex)


def split_text(text: str) -> Iterator[tuple[bool, str]]:
    r"""Parts of a text with `$...$` in it, as (whether it is mathematics, the part); `\$` is a dollar sign."""
    for i, part in enumerate(re.split(r"(?<!\\)\$", text)):
        if part:
            yield (True, part) if i % 2 else (False, part.replace(r"\$", "$"))


def escaped(text: str) -> str:
    """Text whose dollar signs start no mathematics."""
    return text.replace("$", r"\$")


def pieces(latex: str) -> list[list[str]]:
    r"""Lines (parted by `\\` outside braces) of pieces that belong together: a line may be broken between two."""
    lines: list[list[str]] = [[""]]
    depth, before = 0, ""
    for token in tokens(latex):
        if depth == 0 and token == r"\\":
            lines.append([""])
            before = ""
            continue
        if depth == 0 and token in RELATIONS | BINARY and before not in RELATIONS | BINARY | {"", ",", "^", "_", "/", r"\,"}:
            lines[-1].append("")
        lines[-1][-1] += token
        fence = before in (r"\left", r"\right")  # counted with the command before it
        depth += 0 if fence else (token in _OPEN) - (token in _CLOSE)
        if depth == 0 and token in SPACES:
            lines[-1].append("")
        if token.strip():
            before = "" if token in SPACES else token
    return [[piece for piece in line if piece.strip()] for line in lines if any(piece.strip() for piece in line)]


def width(latex: str) -> float:
    """About how wide a formula is, in letters."""
    total, depth = 0.0, 0
    for token in tokens(re.sub(r"\\(mathbf|boldsymbol|mathrm|mathsf|text|left|right|begin|end|dot|tilde|hat|bar)\b", "", latex)):
        if token == "{":
            depth += 1
        elif token == "}":
            depth -= 1
        elif token.strip() and token not in {"^", "_", r"\,", r"\!", r"\;"}:
            total += 1.6 if token in RELATIONS | BINARY | {r"\times", r"\cdot"} else 0.8
    return total


def folded(latex: str, letters: float = 78.0) -> list[str]:
    """Lines of a formula, each no wider than about `letters` where it can be broken."""
    lines: list[str] = []
    for parts in pieces(latex):
        line, used = "", 0.0
        for part in parts:
            size = width(part)
            if line and used + size > letters and line.strip() != parts[0].strip():
                lines.append(line)
                line, used = r"\quad " + part, size + 2
            else:
                line, used = line + part, used + size
        lines.append(line)
    return lines
