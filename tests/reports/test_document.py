"""Documents in three formats."""

from __future__ import annotations

import re
import runpy
import shutil
import subprocess
from pathlib import Path

import pytest

import mbdae as mb
from mbdae.documents import COMPILERS, Document
from mbdae.documents.blocks import Code, Equation, Paragraph, Picture, Section, Table, folded, pieces
from mbdae.documents.mathml import FormulaError, inline
from mbdae.reports import names

EXAMPLES = Path(__file__).parents[2] / "examples"

PNG = b"\x89PNG\r\n\x1a\n"
SAMPLE = Document("A & B", [
    Paragraph("Text with $\\mathbf{a}_k < 1$, 5 \\$ and `code`."),
    Section("Part", [
        Equation(r"\mathbf{a} = \frac{1}{2}\,\mathbf{b} + "
                 r"\begin{cases} 0 & x \le 0 \\ x & \text{otherwise} \end{cases} \\ = c", 3, "note $x$"),
        Table(["one", "$y^2$"], [["a | b", "$|x|$"], ["100 %", "m/s$^{2}$"]], "caption"), Code("x_1 = {2}"),
        Picture("<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 1 1'/>", "a picture"), Picture(PNG, "a photo")]),
])


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
    with pytest.raises(mb.OptionError, match=r"does not end in \.html or \.md or \.tex or \.pdf"):
        SAMPLE.save(tmp_path / "a.doc")


def test_formulas_break_between_terms_only():
    assert pieces(r"a = -b + (c + d) \\ e") == [["a ", "= -b ", "+ (c + d) "], [" e"]]
    assert pieces(r"\left\{ a + b \right. + c") == [[r"\left\{ a + b \right. ", "+ c"]]
    long = " + ".join(f"a_{{{i}}}" for i in range(60))
    assert len(folded(long)) > 1
    assert "".join(line.replace(r"\quad ", "") for line in folded(long)) == long


def test_unknown_commands_are_told():
    with pytest.raises(FormulaError, match=r"unknown command '\\foo'"):
        inline(r"\foo + 1")
    with pytest.raises(FormulaError, match="closes no bracket or group"):
        inline("a } b")


TEX = next((found for found in map(shutil.which, COMPILERS) if found), None)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*names(), "four_bar", "heavy_top"])
def test_reports_are_typeset(name, tmp_path):
    """By a real TeX: no line leaves the page by more than two letters, all fonts are outlines."""
    if TEX is None:
        pytest.skip("no TeX here: install texlive-latex-recommended, texlive-pictures and lmodern to typeset the reports")
    example = EXAMPLES / f"{name}.py"
    what = runpy.run_path(str(example))["scene"]() if example.exists() else name
    mb.report(what).save(tmp_path / "report.tex")
    flags = ["-interaction=nonstopmode", "-halt-on-error"]
    done = subprocess.run([TEX, *flags, "report.tex"], cwd=tmp_path, capture_output=True, check=False)
    log = done.stdout.decode(errors="replace")
    assert done.returncode == 0, log[-2000:]
    assert [w for w in re.findall(r"Overfull .hbox \((\d+)\.", log) if int(w) > 90] == []
    if shutil.which("pdffonts"):
        fonts = subprocess.run(["pdffonts", "report.pdf"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        assert "Type 3" not in fonts


def test_a_pdf_without_tex_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("mbdae.documents.COMPILERS", ("no-such-tex",))
    with pytest.raises(mb.OptionError, match="install TeX"):
        SAMPLE.save(tmp_path / "a.pdf")


@pytest.mark.skipif(TEX is None, reason="no TeX here")
def test_a_pdf_is_written(tmp_path):
    found = mb.report("gear").save(tmp_path / "a.pdf")
    assert found.read_bytes().startswith(b"%PDF")


def test_equations_explain_their_symbols_and_give_their_tex():
    html = mb.report("gear").to_html()
    assert 'class="equation" title="' in html
    assert "<summary>TeX</summary><code>" in html
    assert "<details><summary>The " in html
