r"""Text for TeX: escapes of special characters, Greek letters and signs, substitutes for characters that TeX lacks."""

from __future__ import annotations

from unicodedata import combining, normalize

from mbdae.documents.mathml import GREEK, SIGNS

#: packages needed for the text that this module writes
PACKAGES = r"""\usepackage[T1]{fontenc}
\usepackage[utf8]{inputenc}
\usepackage{lmodern}
"""
_SPECIAL = {"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}", "$": r"\$",
            "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\ensuremath{<}", ">": r"\ensuremath{>}"}  # fmt: skip
_NAMES = {sign: name for name, sign in reversed((GREEK | SIGNS).items()) if not sign.isascii() and name.isalpha()}
#: Greek letters for which TeX has no command because they look like Latin ones
_LATIN = dict(zip("ΑΒΕΖΗΙΚΜΝΟΡΤΧο", "ABEZHIKMNOPTXo", strict=True))
_SIGNS = {sign: rf"\ensuremath{{\{name}}}" for sign, name in _NAMES.items()} | {
    greek: rf"\ensuremath{{\mathrm{{{latin}}}}}" for greek, latin in _LATIN.items()} | {
    "²": r"\ensuremath{^2}", "³": r"\ensuremath{^3}", "°": r"\ensuremath{^\circ}", "–": "--", "…": r"\ldots{}",
    "−": r"\ensuremath{-}", "\xa0": "~"}  # fmt: skip
_NOT_SET = "ĦħĸĿŀŉŦŧſ"  #: accented Latin letters that TeX does not set


def plain(text: str) -> str:
    """Text escaped so that TeX prints it as it is, in text and in `\\text` of formulas."""
    return "".join(_SPECIAL.get(c) or _sign(c, _SIGNS) for c in text)


def signs(latex: str) -> str:
    """LaTeX with commands in place of characters that TeX does not read, in text or formulas."""
    return "".join(_sign(c, _SIGNS) for c in latex)


def verbatim(text: str) -> str:
    """Text without characters that TeX does not read: Greek letters by their names, others by their code points."""
    return "".join(_sign(c, _NAMES | _LATIN) for c in text)


def _sign(c: str, known: dict[str, str]) -> str:
    """One character as TeX reads it; unknown accents are dropped, other unknown characters written as U+ and their code point."""
    if c in known:
        return known[c]
    if (c.isascii() and (c.isprintable() or c in "\n\t")) or ("À" <= c <= "ž" and c not in _NOT_SET):
        return c
    base = "".join(part for part in normalize("NFKD", c) if not combining(part))
    return "".join(_sign(part, known) for part in base) if base not in ("", c) else "" if combining(c) else f"U+{ord(c):04X}"
