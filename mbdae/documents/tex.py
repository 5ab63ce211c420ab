r"""Text as TeX sets it: characters that are commands of TeX, Greek letters and signs, substitutes for what it has not."""

from __future__ import annotations

from unicodedata import combining, normalize

from mbdae.documents.mathml import GREEK, SIGNS

#: packages that set what this module writes
PACKAGES = r"""\usepackage[T1]{fontenc}
\usepackage[utf8]{inputenc}
\usepackage{lmodern}
"""
_SPECIAL = {"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}", "$": r"\$",
            "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\ensuremath{<}", ">": r"\ensuremath{>}"}  # fmt: skip
_NAMES = {sign: name for name, sign in reversed((GREEK | SIGNS).items()) if not sign.isascii() and name.isalpha()}
_LATIN = dict(zip("ΑΒΕΖΗΙΚΜΝΟΡΤΧο", "ABEZHIKMNOPTXo", strict=True))  #: Greek letters that TeX has as Latin ones
_SIGNS = {sign: rf"\ensuremath{{\{name}}}" for sign, name in _NAMES.items()} | {
    greek: rf"\ensuremath{{\mathrm{{{latin}}}}}" for greek, latin in _LATIN.items()} | {
    "²": r"\ensuremath{^2}", "³": r"\ensuremath{^3}", "°": r"\ensuremath{^\circ}", "–": "--", "…": r"\ldots{}",
    "−": r"\ensuremath{-}", "\xa0": "~"}  # fmt: skip
_NOT_SET = "ĦħĸĿŀŉŦŧſ"  #: of the accented Latin letters


def plain(text: str) -> str:
    """Text that TeX prints as it is, in text and in `\\text` of formulas."""
    return "".join(_SPECIAL.get(c) or _sign(c, _SIGNS) for c in text)


def signs(latex: str) -> str:
    """LaTeX with commands instead of the characters that TeX does not read, in text or formulas."""
    return "".join(_sign(c, _SIGNS) for c in latex)


def verbatim(text: str) -> str:
    """Text without the characters that TeX does not read: Greek letters by their names, others by their numbers."""
    return "".join(_sign(c, _NAMES | _LATIN) for c in text)


def _sign(c: str, known: dict[str, str]) -> str:
    """One character; accents that are not known fall away, and what is left is written as U+ and its number."""
    if c in known:
        return known[c]
    if (c.isascii() and (c.isprintable() or c in "\n\t")) or ("À" <= c <= "ž" and c not in _NOT_SET):
        return c
    base = "".join(part for part in normalize("NFKD", c) if not combining(part))
    return "".join(_sign(part, known) for part in base) if base not in ("", c) else "" if combining(c) else f"U+{ord(c):04X}"
