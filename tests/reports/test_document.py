"""Documents in three formats."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

import mbdae as mb
from mbdae.documents.blocks import Code, Equation, Paragraph, Picture, Section, Table
from mbdae.documents.document import Document
from mbdae.documents.formulas import folded, pieces
from mbdae.documents.mathml import FormulaError, inline

PNG = b"\x89PNG\r\n\x1a\n"
SAMPLE = Document("A & B", [
    Paragraph("Text with $\\mathbf{a}_k < 1$, 5 \\$ and `code`."),
    Section("Part", [
        Equation(r"\mathbf{a} = \frac{1}{2}\,\mathbf{b} + "
                 r"\begin{cases} 0 & x \le 0 \\ x & \text{otherwise} \end{cases} \\ = c", 3, "note $x$"),
        Table(["one", "$y^2$"], [["a | b", "$|x|$"], ["100 %", "m/s$^{2}$"]], "caption"), Code("x_1 = {2}"),
        Picture("<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 1 1'/>", "a picture"), Picture(PNG, "a photo")]),
])  # fmt: skip


def test_html_is_well_formed_and_needs_nothing_else(read_html):
    html = SAMPLE.to_html()
    page = read_html(html)
    assert page.open == []
    links = [value for key, value in page.attributes if key in ("src", "href")]
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "<title>A &amp; B</title>" in html
    assert page.tags.count("mtable") == 1
    assert "note <math>" in html
    assert "5 $ and <code>code</code>" in html


def test_markdown_and_latex_hold_the_same():
    md, tex = SAMPLE.to_markdown(), SAMPLE.to_latex()
    assert r"\tag{3}" in md
    assert r"\tag{3}" in tex
    assert r"| a \| b |" in md
    assert r"100 \%" in tex
    assert tex.count(r"\begin{") == tex.count(r"\end{")
    assert r"\section*{Part}" in tex


def test_save_writes_pictures_beside_the_text(tmp_path):
    assert SAMPLE.save(tmp_path / "a.md") == tmp_path / "a.md"
    assert (tmp_path / "a-2.png").read_bytes() == PNG
    assert "![a photo](a-2.png)" in (tmp_path / "a.md").read_text(encoding="utf-8")
    SAMPLE.save(tmp_path / "a.tex")
    assert r"{a-2.png}" in (tmp_path / "a.tex").read_text(encoding="utf-8")
    with pytest.raises(mb.OptionError, match=r"does not end in \.html or \.md or \.tex"):
        SAMPLE.save(tmp_path / "a.pdf")


def test_formulas_break_between_terms_only():
    assert pieces(r"a = -b + (c + d) \\ e") == [["a ", "= -b ", "+ (c + d) "], [" e"]]
    assert pieces(r"\left\{ a + b \right. + c") == [[r"\left\{ a + b \right. ", "+ c"]]
    long = " + ".join(f"a_{{{i}}}" for i in range(60))
    assert len(folded(long)) > 1
    assert "".join(line.replace(r"\quad ", "") for line in folded(long)) == long


def test_unknown_commands_are_told():
    with pytest.raises(FormulaError, match=r"unknown command '\\foo'"):
        inline(r"\foo + 1")
    with pytest.raises(FormulaError, match="closes nothing"):
        inline("a } b")


def test_latex_compiles(tmp_path):
    """Once, where there is TeX."""
    compiler = next((found for found in map(shutil.which, ("lualatex", "pdflatex", "tectonic")) if found), None)
    if compiler is None:
        pytest.skip("no TeX here: install texlive-latex-recommended to compile the reports")
    mb.report(mb.Revolute).save(tmp_path / "revolute.tex")
    flags = [] if "tectonic" in compiler else ["-interaction=nonstopmode", "-halt-on-error"]
    done = subprocess.run([compiler, *flags, "revolute.tex"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    assert not re.search(r"Overfull .hbox \((\d{3,})", done.stdout)
