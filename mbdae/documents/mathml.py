r"""LaTeX mathematics to MathML: the subset that reports use, without characters that need a special font.

Known: letters, numbers, Greek, `\mathbf \boldsymbol \mathrm \mathsf \mathit \mathcal \text \operatorname`, `^ _`, `\frac \tfrac
\sqrt`, `\over`, accents, `\underbrace`, `\overset`, `\left \right` and the larger brackets,
`\begin{aligned|cases|bmatrix|pmatrix|matrix}`, the signs of `SIGNS`.
"""

from __future__ import annotations

from html import escape
from unicodedata import combining, normalize

from mbdae.documents.blocks import BINARY, RELATIONS, extent, inside, pieces, tokens
from mbdae.errors import MbdaeError

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ϵ", "varepsilon": "ε", "zeta": "ζ", "eta": "η",
    "theta": "θ", "vartheta": "ϑ", "iota": "ι", "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π",
    "rho": "ρ", "varrho": "ϱ", "varpi": "ϖ", "varsigma": "ς",
    "sigma": "σ", "tau": "τ", "upsilon": "υ", "phi": "ϕ", "varphi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω",
    "Gamma": "Γ", "Delta": "Δ", "Theta": "Θ", "Lambda": "Λ", "Xi": "Ξ", "Pi": "Π", "Sigma": "Σ", "Phi": "Φ", "Psi": "Ψ",
    "Omega": "Ω", "Upsilon": "Υ",
}
SIGNS = {
    "cdot": "·", "times": "×", "otimes": "⊗", "oplus": "⊕", "circ": "∘", "pm": "±", "le": "≤", "leq": "≤", "ge": "≥", "geq": "≥",
    "ne": "≠", "neq": "≠", "approx": "≈", "equiv": "≡", "to": "→", "rightarrow": "→", "mapsto": "↦", "Rightarrow": "⇒",
    "Leftrightarrow": "⇔", "in": "∈", "sum": "∑", "int": "∫",
    "partial": "∂", "nabla": "∇", "infty": "∞", "top": "⊤", "perp": "⊥",
    "parallel": "∥", "mid": "|", "ldots": "…", "cdots": "⋯", "dots": "…", "prime": "′", "ll": "≪", "gg": "≫",
    "leqslant": "≤", "geqslant": "≥", "simeq": "≃", "intercal": "⊺", "oint": "∮",
    "langle": "⟨", "rangle": "⟩", "sim": "∼", "propto": "∝", "forall": "∀", "exists": "∃", "vert": "|",
    "lvert": "|", "rvert": "|",
    "lVert": "‖", "rVert": "‖", "Vert": "‖", "|": "‖", "{": "{", "}": "}", "lfloor": "⌊", "rfloor": "⌋", "lbrace": "{",
    "rbrace": "}", "lbrack": "[", "rbrack": "]", "ast": "∗", "star": "⋆", "wedge": "∧", "vee": "∨", "neg": "¬", "ell": "ℓ",
    "coloneqq": ":=", "eqqcolon": "=:",
    "colon": ":", "div": "÷", "mp": "∓", "subset": "⊂", "cup": "∪", "cap": "∩", "setminus": "∖", "longrightarrow": "⟶",
    "%": "%", "$": "$", "#": "#", "&": "&", "_": "_",
}
FENCES = {"lvert", "rvert", "lVert", "rVert", "vert", "Vert", "|", "langle", "rangle", "{", "}", "lfloor", "rfloor",
          "lbrace", "rbrace", "lbrack", "rbrack"}
FUNCTIONS = ("sin", "cos", "tan", "tanh", "sinh", "cosh", "exp", "log", "ln", "max", "min", "arctan", "det", "ker", "lim",
             "arcsin", "arccos", "dim")
GAPS = {",": "0.167em", ":": "0.222em", ";": "0.278em", " ": "0.25em", "quad": "1em", "qquad": "2em", "!": "0em"}
ACCENTS = {"dot": "˙", "ddot": "¨", "tilde": "~", "widetilde": "~", "hat": "^", "widehat": "^", "bar": "¯", "overline": "¯",
           "vec": "→", "check": "ˇ", "breve": "˘", "dddot": "⃛"}
FONTS = {"mathbf": "b", "boldsymbol": "bi", "bm": "bi", "mathrm": "n", "mathsf": "n", "mathit": "", "mathcal": "",
         "operatorname": "n", "pmb": "b", "mathbb": "b", "mathfrak": ""}
_MATRICES = {"matrix": ("", ""), "bmatrix": ("[", "]"), "pmatrix": ("(", ")"), "cases": ("{", ""), "aligned": ("", ""),
             "array": ("", ""), "gathered": ("", ""), "split": ("", ""), "alignedat": ("", ""), "dcases": ("{", ""),
             "Bmatrix": ("{", "}"), "vmatrix": ("|", "|"), "smallmatrix": ("", "")}

_SIZES = {"middle": 1.0, "big": 1.2, "Big": 1.8, "bigg": 2.4, "Bigg": 3.0}  #: heights of brackets, em

LEAST = 0.8  #: smallest font size of a formula, em of the text of the page (12.8 px)
#: NARROW: a formula narrower than this (em) fits any window; MARGIN: factor by which fonts may be wider than estimated
NARROW, MARGIN = 14.0, 1.3
_DISPLAY = '<math displaystyle="true">'
_FENCE, _FIXED = ' stretchy="true" fence="true"', ' stretchy="false"'


class FormulaError(MbdaeError):
    """A formula with a command that this module does not support; the message names the command."""


def inline(latex: str) -> str:
    """Pieces of a formula as `<math>` elements, between which the browser may break the line."""
    return "<br>".join(_line(line, "<math>") for line in pieces(latex))


def display(latex: str) -> str:
    """A formula in display style as HTML, each of its lines in an element of its own, in which it breaks between its terms, and
    within the brackets of a term where it is wider than the window."""
    return "".join(f'<div class="line">{_terms(line)}</div>' for line in pieces(latex))


def _line(line: list[str], opening: str) -> str:
    return " ".join(f"{_sized(opening, piece)}{_Reader(piece, i > 0).formula()}</math>" for i, piece in enumerate(line))


def _terms(terms: list[str], first: bool = True) -> str:
    """MathML of terms between which a line may be broken. A term that is wide and has sums in its brackets goes to a line of its
    own before it is broken; only the first terms of a formula, what stands left of a sign and right of it, keep their line."""
    out = []
    for i, term in enumerate(terms):
        parts = inside(term) if MARGIN * extent(term) >= NARROW else [term]
        if len(parts) == 1:
            out.append(f"{_sized(_DISPLAY, term)}{_Reader(term, i > 0 or not first).formula()}</math>")
        else:
            within = _terms(parts, first and i == 0)
            out.append(within if first and i < 2 else f'<span class="term">{within}</span>')
    return " ".join(out)


def _sized(opening: str, piece: str) -> str:
    """Opening tag of the <math> element of a piece, which browsers cannot break: its font shrinks with a window that is narrower
    than the piece, down to LEAST em; in narrower windows its box scrolls."""
    wide = MARGIN * extent(piece)
    if wide < NARROW:
        return opening
    return f'{opening[:-1]} style="font-size:max({LEAST}em,min(1.06em,calc((min(100vw, 54rem) - 7.4rem)/{wide:.1f})))">'


def _sign(text: str, attributes: str = "") -> str:
    return f"<mo{attributes}>{escape(text, quote=False)}</mo>"


def _letter(text: str, font: str) -> str:
    upper_greek = len(text) == 1 and text in "ΓΔΘΛΞΠΣΦΨΩ"
    name = font or ("n" if upper_greek or len(text) > 1 else "")
    return f'<mi class="{name}">{escape(text)}</mi>' if name else f"<mi>{escape(text)}</mi>"


class _Reader:
    """Parser of one formula, or of one line of it."""

    def __init__(self, latex: str, continued: bool = False) -> None:
        self.latex, self.tokens, self.i, self.continued = latex, tokens(latex), 0, continued

    def _error(self, problem: str) -> FormulaError:
        return FormulaError(f"the formula '{self.latex}' cannot be printed in HTML: {problem}")

    def formula(self) -> str:
        """MathML of the whole formula."""
        found = self.row("", set())
        if self.i < len(self.tokens):
            raise self._error(f"'{self.tokens[self.i]}' closes no bracket or group that is open; leave it out")
        return found

    def peek(self) -> str:
        while self.i < len(self.tokens) and self.tokens[self.i].isspace():
            self.i += 1
        return self.tokens[self.i] if self.i < len(self.tokens) else ""

    def take(self) -> str:
        token = self.peek()
        self.i += 1
        return token

    def row(self, font: str, stop: set[str]) -> str:
        """MathML of the formula up to a token of `stop`, which is not consumed. font: font of its letters, "" for the default."""
        out: list[str] = []
        while (token := self.peek()) and token not in stop and token not in ("}", r"\right", r"\end"):
            if token == r"\over":
                self.take()
                return f"<mfrac><mrow>{''.join(out)}</mrow><mrow>{self.row(font, stop)}</mrow></mfrac>"
            base = "<mrow></mrow>" if token in ("^", "_") else self.atom(font, first=not out)
            out.append(self.scripts(base, font))
        return out[0] if len(out) == 1 else f"<mrow>{''.join(out)}</mrow>"

    def scripts(self, base: str, font: str) -> str:
        """MathML of the base with the subscript and superscript that follow it; base: its MathML."""
        found: dict[str, str] = {}
        while self.peek() in ("_", "^", "'"):
            sign = self.take()
            if sign == "'":
                found["^"] = found.get("^", "") + "<mo>′</mo>"
            else:
                found[sign] = found.get(sign, "") + self.argument(font)
        marks = {sign: f"<mrow>{text}</mrow>" for sign, text in found.items()}
        if len(marks) == 2:
            return f"<msubsup>{base}{marks['_']}{marks['^']}</msubsup>"
        if marks:
            tag = "msub" if "_" in marks else "msup"
            return f"<{tag}>{base}{''.join(marks.values())}</{tag}>"
        return base

    def argument(self, font: str) -> str:
        """MathML of what a script or a fraction takes: a group or one token, of a number its first figure, as in \\frac12."""
        mark = ' class="b"' if font == "b" else ""
        return f"<mn{mark}>{self.take()}</mn>" if self.peek().isdigit() else self.atom(font, first=True)

    def atom(self, font: str, first: bool = False) -> str:
        token = self.take()
        if token == "{":
            inner = self.row(font, {"}"})
            self._close("}")
            return inner
        if token.startswith("\\"):
            return self.command(token[1:].rstrip("*"), font, first)
        if token.isdigit() or token == ".":
            while self.i < len(self.tokens) and (self.tokens[self.i].isdigit() or self.tokens[self.i] == "."):
                token += self.tokens[self.i]
                self.i += 1
            return f'<mn class="b">{token}</mn>' if font == "b" else f"<mn>{token}</mn>"
        if token.isalpha():
            return self._letters(token, font)
        if token in "()[]|":
            return _sign(token, _FIXED)
        if token == "&":
            return ""
        if token == "~":
            return '<mspace width="0.25em"></mspace>'
        return self._operator("−" if token == "-" else "∗" if token == "*" else token, token, first)

    def _operator(self, text: str, token: str, first: bool) -> str:
        """MathML of an operator. First in its row it is a sign of what follows, or, where the row continues a broken line, it
        keeps the spacing of an operator between terms."""
        continues = first and token in RELATIONS | BINARY and self.latex.strip() != token
        prefix = first and token in BINARY and not (self.continued and self.latex.lstrip().startswith(token) and self.i <= 2)
        return _sign(text, ' form="infix" lspace="0.05em" rspace="0.28em"' if continues and not prefix else "")

    def _letters(self, token: str, font: str) -> str:
        while font == "n" and self.i < len(self.tokens) and self.tokens[self.i].isalnum():
            token += self.tokens[self.i]
            self.i += 1
        return _letter(token, font)

    def command(self, name: str, font: str, first: bool) -> str:
        if name in GREEK:
            return _letter(GREEK[name], "" if font == "n" else font)
        if name in FONTS:
            return self.atom(FONTS[name], first)
        if name in ("text", "textit", "mbox"):
            return f"<mtext>{escape(self.raw())}</mtext>"
        if name in GAPS:
            return f'<mspace width="{GAPS[name]}"></mspace>'
        if name in FUNCTIONS:
            return _letter(name, "n") + ("" if self.peek() in ("(", "^", "_", r"\left") else '<mspace width="0.17em"></mspace>')
        if name in ACCENTS:
            return f'<mover accent="true">{self.atom(font)}{_sign(ACCENTS[name], _FIXED)}</mover>'
        if name in ("frac", "tfrac", "dfrac"):
            fraction = f"<mfrac><mrow>{self.argument(font)}</mrow><mrow>{self.argument(font)}</mrow></mfrac>"
            return fraction if name != "tfrac" else f'<mstyle displaystyle="false">{fraction}</mstyle>'
        if name == "underline":
            return f"<munder>{self.atom(font)}<mo>_</mo></munder>"
        if name in ("underbrace", "overbrace"):
            inner, place = f"<munder>{self.atom(font)}<mo>_</mo></munder>", self.peek()
            said = self.argument(font) if place in ("_", "^") and self.take() else ""
            return f"<m{'under' if place == '_' else 'over'}>{inner}<mrow>{said}</mrow></m{'under' if place == '_' else 'over'}>"
        if name in ("overset", "stackrel", "underset"):
            mark, tag = self.argument(font), "munder" if name == "underset" else "mover"
            return f"<{tag}><mrow>{self.argument(font)}</mrow><mrow>{mark}</mrow></{tag}>"
        if name == "sqrt":
            return f"<msqrt>{self.atom(font)}</msqrt>"
        if name == "left":
            return self.fenced(font)
        if (size := name if name == "middle" else name.rstrip("lrm")) in _SIZES:
            return _sign(self.fence(), f' minsize="{_SIZES[size]}em" maxsize="{_SIZES[size]}em"{_FENCE}')
        if name == "begin":
            return self.matrix(font)
        if name in SIGNS:
            form = f' form="{"prefix" if name[0] == "l" else "postfix"}"' if name[0] in "lr" else ""
            return _sign(SIGNS[name], _FIXED + form) if name in FENCES else self._operator(SIGNS[name], "\\" + name, first)
        raise self._error(f"unknown command '\\{name}'; write it by other commands, a word as \\mathrm{{...}}")

    def raw(self) -> str:
        """The text of a group, unchanged."""
        if self.take() != "{":
            raise self._error("a command such as \\text or \\begin needs a text or name in braces after it, {...}")
        start, depth = self.i, 1
        while self.i < len(self.tokens) and depth:
            depth += (self.tokens[self.i] == "{") - (self.tokens[self.i] == "}")
            self.i += 1
        inside = "".join(self.tokens[start : self.i - 1]).replace("\\_", "_").replace("\\,", " ")
        return inside.replace(" ", "\u00a0")

    def fence(self) -> str:
        """The bracket after `\\left` and similar commands."""
        token = self.take()
        return "" if token == "." else SIGNS[token[1:]] if token.startswith("\\") else token

    def fenced(self, font: str) -> str:
        opening = self.fence()
        inner = self.row(font, set())
        self._close(r"\right")
        closing = self.fence()
        return f"<mrow>{_sign(opening, _FENCE) if opening else ''}{inner}{_sign(closing, _FENCE) if closing else ''}</mrow>"

    def matrix(self, font: str) -> str:
        kind = self.raw()
        if kind not in _MATRICES:
            raise self._error(f"unknown environment '{kind}'; use one of {', '.join(_MATRICES)}")
        if kind in ("array", "alignedat"):
            self.raw()
        rows: list[list[str]] = [[]]
        while True:
            rows[-1].append(self.row(font, {"&", r"\\"}))
            token = self.take()
            if token == r"\end":
                self.raw()
                break
            if token == r"\\":
                rows.append([])
            elif token != "&":
                raise self._error(f"\\begin{{{kind}}} has no \\end{{{kind}}} after its last row")
        cells = "".join(f"<mtr>{''.join(f'<mtd>{cell}</mtd>' for cell in row)}</mtr>" for row in rows)
        opening, closing = _MATRICES[kind]
        style = {"split": "aligned", "alignedat": "aligned", "dcases": "cases"}.get(kind, kind)
        table = f'<mtable class="{style}">{cells}</mtable>'
        return f"<mrow>{_sign(opening, _FENCE) if opening else ''}{table}{_sign(closing, _FENCE) if closing else ''}</mrow>"

    def _close(self, wanted: str) -> None:
        token = self.take()
        if token != wanted:
            raise self._error(f"'{wanted}' is missing " + (f"before '{token}'" if token else "at the end"))


# -- Text for TeX: escapes of special characters, Greek letters and signs, substitutes for characters that TeX lacks


_SPECIAL = {"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}", "$": r"\$",
            "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\ensuremath{<}", ">": r"\ensuremath{>}"}
_NAMES = {sign: name for name, sign in reversed((GREEK | SIGNS).items()) if not sign.isascii() and name.isalpha()}
#: Greek letters for which TeX has no command because they look like Latin ones
_LATIN = dict(zip("ΑΒΕΖΗΙΚΜΝΟΡΤΧο", "ABEZHIKMNOPTXo", strict=True))
_SIGNS = {sign: rf"\ensuremath{{\{name}}}" for sign, name in _NAMES.items()} | {
    greek: rf"\ensuremath{{\mathrm{{{latin}}}}}" for greek, latin in _LATIN.items()} | {
    "²": r"\ensuremath{^2}", "³": r"\ensuremath{^3}", "°": r"\ensuremath{^\circ}", "–": "--", "…": r"\ldots{}",
    "−": r"\ensuremath{-}", "\xa0": "~"}
_NOT_SET = "ĦħĸĿŀŉŦŧſ"  #: accented Latin letters that TeX does not set


def plain(text: str) -> str:
    """Text escaped so that TeX prints it as it is, in text and in `\\text` of formulas."""
    return "".join(_SPECIAL.get(c) or _tex_sign(c, _SIGNS) for c in text)


def signs(latex: str) -> str:
    """LaTeX with commands in place of characters that TeX does not read, in text or formulas."""
    return "".join(_tex_sign(c, _SIGNS) for c in latex)


def verbatim(text: str) -> str:
    """Text without characters that TeX does not read: Greek letters by their names, others by their code points."""
    return "".join(_tex_sign(c, _NAMES | _LATIN) for c in text)


def _tex_sign(c: str, known: dict[str, str]) -> str:
    """One character as TeX reads it; unknown accents are dropped, other unknown characters written as U+ and their code point."""
    if c in known:
        return known[c]
    if (c.isascii() and (c.isprintable() or c in "\n\t")) or ("À" <= c <= "ž" and c not in _NOT_SET):
        return c
    base = "".join(part for part in normalize("NFKD", c) if not combining(part))
    return "".join(_tex_sign(part, known) for part in base) if base not in ("", c) else "" if combining(c) else f"U+{ord(c):04X}"
