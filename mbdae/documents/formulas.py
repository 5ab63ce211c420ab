r"""Splitting of LaTeX formulas: tokens, and the places where a long formula may be broken."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

_TOKEN = re.compile(r"\\[A-Za-z]+\*?|\\.|[^\\]", re.DOTALL)
_OPEN, _CLOSE = {"{", r"\left", r"\begin", "(", "[", r"\{", r"\lbrack"}, {"}", r"\right", r"\end", ")", "]", r"\}", r"\rbrack"}
#: relations; a line may be broken before them and before the signs of BINARY, outside of all brackets
RELATIONS = {"=", "<", ">", r"\le", r"\ge", r"\ne", r"\approx", r"\equiv", r"\Leftrightarrow", r"\Rightarrow", r"\in"}
BINARY = {"+", "-", r"\pm"}
#: commands that are as wide as their argument
AROUND = {rf"\{name}" for name in ["mathbf", "boldsymbol", "mathsf", "mathrm", "text", "dot", "ddot", "tilde", "bar", "sqrt"]}
SPACES = {r"\quad", r"\qquad"}


def tokens(latex: str) -> list[str]:
    """Commands and characters of a formula, in order."""
    return _TOKEN.findall(latex)


def split_text(text: str) -> Iterator[tuple[bool, str]]:
    r"""Parts of a text with `$...$`, as (whether the part is mathematics, the part); `\$` is a dollar sign."""
    for i, part in enumerate(re.split(r"(?<!\\)\$", text)):
        if part:
            yield (True, part) if i % 2 else (False, part.replace(r"\$", "$"))


def escaped(text: str) -> str:
    """Text whose dollar signs do not start mathematics."""
    return text.replace("$", r"\$")


def pieces(latex: str) -> list[list[str]]:
    r"""Lines (separated by `\\` outside braces), each as a list of pieces between which it may be broken."""
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
        fence = before in (r"\left", r"\right")  # \left and \right are counted, so that brackets after them are not
        depth += 0 if fence else (token in _OPEN) - (token in _CLOSE)
        if depth == 0 and token in SPACES:
            lines[-1].append("")
        if token.strip():
            before = "" if token in SPACES else token
    return [[piece for piece in line if piece.strip()] for line in lines if any(piece.strip() for piece in line)]


def width(latex: str) -> float:
    """Estimated width of a formula in letters."""
    total, depth = 0.0, 0
    for token in tokens(re.sub(r"\\(mathbf|boldsymbol|mathrm|mathsf|text|left|right|begin|end|dot|tilde|hat|bar)\b", "", latex)):
        if token == "{":
            depth += 1
        elif token == "}":
            depth -= 1
        elif token.strip() and token not in {"^", "_", r"\,", r"\!", r"\;"}:
            total += 1.6 if token in RELATIONS | BINARY | {r"\times", r"\cdot"} else 0.8
    return total


def folded(latex: str, letters: float = 78.0, measure: Callable[[str], float] = width) -> list[str]:
    """A formula broken into lines of at most about `letters` where possible. measure: width of a part in letters."""
    lines: list[str] = []
    for parts in pieces(latex):
        line, used = "", 0.0
        for part in parts:
            size = measure(part)
            if line and used + size > letters and line.strip() != parts[0].strip():
                lines.append(line)
                line, used = r"\quad " + part, size + 2
            else:
                line, used = line + part, used + size
        lines.append(line)
    return lines


def extent(latex: str) -> float:
    """Estimated width of a formula in em: fractions by their longer part, matrices by their widest row, scripts small."""
    return _Extent(tokens(latex)).row(set())


class _Extent:
    """Estimates the widths (em) of the parts of a formula."""

    def __init__(self, parts: list[str]) -> None:
        self.parts, self.i = [t for t in parts if not t.isspace()], 0

    def row(self, stop: set[str]) -> float:
        """Width up to a token of `stop`, which is consumed."""
        total = 0.0
        while self.i < len(self.parts):
            token = self.parts[self.i]
            if token in stop:
                self.i += 1
                break
            total += self.atom()
        return total

    def atom(self) -> float:
        """Width of one symbol, group, fraction or matrix."""
        token = self.parts[self.i] if self.i < len(self.parts) else ""
        self.i += 1
        if token == "{":
            return self.row({"}"})
        if token in ("^", "_"):
            both = 0.62 * self.atom()
            other = self.i < len(self.parts) and self.parts[self.i] in ("^", "_")
            return max(both, self.atom()) if other else both
        if token in (r"\frac", r"\tfrac"):
            return max(self.atom(), self.atom()) + 0.3
        if token == r"\begin":
            return self.matrix()
        if token in (r"\left", r"\right"):
            self.i += 1
            return 0.5
        if token in AROUND:
            return self.atom()
        if token in RELATIONS | BINARY | {r"\times", r"\cdot"}:
            return 1.25
        return 0.2 if token in (r"\,", "(", ")", ",") else 0.17 * len(token) if token in (r"\quad",) else 0.56

    def matrix(self) -> float:
        """Width of a matrix: sum of the widest cells of its columns."""
        cases = "".join(self.parts[self.i : self.i + 6]) == "{cases"
        self.atom()
        rows: list[list[float]] = [[0.0]]
        while self.i < len(self.parts) and self.parts[self.i] != r"\end":
            token = self.parts[self.i]
            if token in ("&", r"\\"):
                self.i += 1
                rows[-1].append(0.0) if token == "&" else rows.append([0.0])
            else:
                rows[-1][-1] += self.atom()
        self.i += 1
        self.atom()
        count = max(map(len, rows))
        wide = sum(max((r[j] for r in rows if j < len(r)), default=0.0) for j in range(count))
        return wide + 0.9 * count + (0.0 if cases else 0.4)
