"""Small mistakes put into a source, each as the text with one place changed: comparisons, signs, numbers, conditions, statements
left out; of Python by its syntax tree, of C by its tokens."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

COMPARED = {ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">"), ast.Eq: ("==", "!="),
            ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"), ast.In: ("in", "not in"),
            ast.NotIn: ("not in", "in")}
COMBINED = {ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*")}
IN_C = (  # what stands there, what takes its place
    (r" < ", " <= "), (r" <= ", " < "), (r" > ", " >= "), (r" >= ", " > "), (r" == ", " != "), (r" != ", " == "),
    (r" \+ ", " - "), (r" - ", " + "), (r" \* ", " / "), (r" / ", " * "), (r" && ", " || "), (r" \|\| ", " && "),
    (r" \+= ", " -= "), (r" -= ", " += "), (r"(?<=[=(,] )-(?=\w)", ""), (r"\breturn 0;", "return 1;"),
    (r"\breturn 1;", "return 0;"),
)
LARGE = 20  #: whole numbers above it: one more of them would change next to nothing
LEFT_OUT_IN_C = re.compile(r"^( +)([\w>.\[\]*+-]+ [-+*/]?= [^;]*|\w+\([^;]*\)|continue|break);", re.MULTILINE)


@dataclass(frozen=True)
class Mutant:
    """The text from start to end of a file, and what takes its place."""

    start: int
    end: int
    old: str
    new: str

    def applied(self, text: str) -> str:
        """The file with the mistake."""
        if text[self.start : self.end] != self.old:
            raise ValueError(f"{self.old!r} does not stand at {self.start}")
        return text[: self.start] + self.new + text[self.end :]

    def line(self, text: str) -> int:
        """Number of its first line."""
        return text.count("\n", 0, self.start) + 1

    def code(self, text: str) -> tuple[str, int]:
        """Its first line without indentation, and where in it the mistake begins."""
        begin, end = text.rfind("\n", 0, self.start) + 1, text.find("\n", self.start)
        line = text[begin : end if end >= 0 else len(text)]
        return line.strip(), self.start - begin - (len(line) - len(line.lstrip()))


def mutants(text: str, name: str) -> list[Mutant]:
    """All mutants of a file, in the order of their places."""
    found = _of_python(text) if name.endswith(".py") else _of_c(text)
    return sorted(set(found), key=lambda m: (m.start, m.end, m.new))


def _of_c(text: str) -> Iterator[Mutant]:
    code = re.sub(r"/\*.*?\*/|//[^\n]*|\"[^\"\n]*\"|^#[^\n]*", lambda m: re.sub(r"[^\n]", "\0", m[0]), text, flags=re.S | re.M)
    for old, new in IN_C:
        for m in re.finditer(old, code):
            yield Mutant(m.start(), m.end(), m[0], new)
    for m in LEFT_OUT_IN_C.finditer(code):
        if "\0" not in m[0]:
            yield Mutant(m.start(2), m.end(), text[m.start(2) : m.end()], ";")
    for m in re.finditer(r"(?<![\w.\[])\d+(\.\d*)?(e[-+]?\d+)?(?![\w.])", code):
        yield Mutant(m.start(), m.end(), m[0], _more(m[0]))


def _more(number: str) -> str:
    """One more, of a large whole number twice as many."""
    if any(c in number for c in ".e"):
        return repr(float(number) + 1)
    return str(int(number) + 1 if int(number) < LARGE else 2 * int(number))


class _Places(ast.NodeVisitor):
    """Mutants of a module: not of what it says in errors, nor of annotations, decorators and texts, of how long a hash is and how
    JSON looks, of `strict` in `zip`, of bounds at which both pieces of a law are 0, of what shows an object (`__repr__`)."""

    def __init__(self, text: str) -> None:
        self.text, self.found, self.meeting = text, list[Mutant](), set[ast.AST]()
        self.lines = [0]
        for line in text.splitlines(keepends=True):
            self.lines.append(self.lines[-1] + len(line))
        self.raw = text.splitlines(keepends=True)

    def at(self, line: int, column: int) -> int:
        """Place in the text of a line (from 1) and a column in bytes."""
        return self.lines[line - 1] + len(self.raw[line - 1].encode()[:column].decode())

    def span(self, node: ast.AST) -> tuple[int, int]:
        return self.at(node.lineno, node.col_offset), self.at(node.end_lineno, node.end_col_offset)  # type: ignore[attr-defined]

    def put(self, start: int, end: int, new: str) -> None:
        self.found.append(Mutant(start, end, self.text[start:end], new))

    def between(self, left: ast.AST, right: ast.AST, pair: tuple[str, str]) -> None:
        """An operator between two operands."""
        start, end = self.span(left)[1], self.span(right)[0]
        operator = re.escape(pair[0]).replace(r"\ ", r"\s+")
        place = re.search(rf"(?<![\w<>=!*/+-]){operator}(?![\w<>=*/])", self.text[start:end])
        if place:
            self.put(start + place.start(), start + place.end(), pair[1])

    def generic_visit(self, node: ast.AST) -> None:
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.AnnAssign) and not (isinstance(node, ast.AnnAssign) and node.value):
            return
        super().generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value:
            self.visit(node.value)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        if node.name in ("__repr__", "__str__"):
            return
        for part in (*node.args.defaults, *(d for d in node.args.kw_defaults if d), *node.body):
            self.visit(part)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for part in node.body:
            self.visit(part)

    def visit_Call(self, node: ast.Call) -> None:
        self.meeting |= set(_meeting(node))
        self.generic_visit(node)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg not in ("strict", "indent"):  # lengths that are equal anyway; how JSON is laid out
            self.visit(node.value)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        if "hexdigest" not in ast.unparse(node.value):  # the length of a name
            self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        for left, op, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            if node in self.meeting:
                continue
            self.between(left, right, COMPARED[type(op)])
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        texts = any(isinstance(side, ast.JoinedStr | ast.List | ast.Tuple) or _is_text(side) for side in (node.left, node.right))
        if type(node.op) in COMBINED and not texts:
            self.between(node.left, node.right, COMBINED[type(node.op)])
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        pair = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            self.between(left, right, pair)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub | ast.Not):
            self.put(self.span(node)[0], self.span(node.operand)[0], "")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        start, end = self.span(node)
        if isinstance(node.value, bool):
            self.put(start, end, str(not node.value))
        elif isinstance(node.value, int | float):
            self.put(start, end, _more(self.text[start:end]) if re.fullmatch(r"[\d._e-]+", self.text[start:end]) else "1")

    def visit_If(self, node: ast.If) -> None:
        if "TYPE_CHECKING" not in ast.dump(node.test):
            start, end = self.span(node.test)
            self.put(start, end, f"not ({self.text[start:end]})")
            self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self.put(*self.span(node), "pass")
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self.put(*self.span(node), "pass")
        if not isinstance(node.value, ast.Constant):  # no docstrings
            self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        if all(isinstance(target, ast.Subscript) for target in node.targets):
            self.put(*self.span(node), "pass")
        self.generic_visit(node)


def _meeting(node: ast.Call) -> Iterator[ast.AST]:
    """Conditions of a Piecewise((x, x > 0), (0 or -x, True)): at the bound itself both pieces are 0."""
    pairs = [a.elts for a in node.args if isinstance(a, ast.Tuple) and len(a.elts) == 2]
    if ast.unparse(node.func).endswith("Piecewise") and len(pairs) == len(node.args) == 2:
        (value, condition), (other, _) = pairs
        x = ast.unparse(value)
        if ast.unparse(condition) == f"{x} > 0" and ast.unparse(other) in ("0", f"-{x}"):
            yield condition


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _of_python(text: str) -> list[Mutant]:
    places = _Places(text)
    places.visit(ast.parse(text))
    return places.found


def is_valid(text: str, path: Path) -> bool:
    """Whether a file with this text is a program; of C the compiler says so, where there is one."""
    if path.suffix != ".py":
        return _compiles(text, path)
    try:
        return bool(ast.parse(text))
    except SyntaxError:
        return False


def _compiles(text: str, path: Path) -> bool:
    with tempfile.TemporaryDirectory(prefix="mbdae-mutants-") as folder:
        for beside in path.parent.iterdir():
            if beside.suffix in (".c", ".h", ".inc"):
                shutil.copy(beside, folder)
        (Path(folder) / path.name).write_text(text, encoding="utf-8")
        units = [path.name] if path.suffix == ".c" else [p.name for p in Path(folder).glob("*.c")]
        command = ["cc", "-std=c11", "-fsyntax-only", '-DMBDAE_SOURCES=""', *(str(Path(folder) / unit) for unit in units)]
        return shutil.which("cc") is None or not subprocess.run(command, capture_output=True, check=False).returncode
