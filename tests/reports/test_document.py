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
from mbdae.documents.blocks import Code, Equation, Paragraph, Picture, Section, Table, every, folded, inside, pieces, tokens
from mbdae.documents.mathml import FormulaError, display, inline
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


def test_pages_are_dark_where_the_reader_asks_for_it_and_figures_stay_on_white():
    dark = SAMPLE.to_html().partition("@media screen and (prefers-color-scheme: dark)")[2].partition("@media")[0]
    assert "color: #e4e4e4; background: #16181b" in dark
    assert "figure svg, figure img { background: #fff" in dark


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


@pytest.mark.parametrize(("whole", "parts"), [
    (r"- x (-a + b)(c - (d + e))", ["- x (-a ", "+ b)(c ", "- (d + e))"]),
    (r"\left( f\left(a + b\right) \right)^{2}", [r"( f(a ", r"+ b) )^{2}"]),
    (r"\left(\frac{a + b}{c} + d\right)", [r"\biggl(\frac{a + b}{c} ", r"+ d\biggr)"]),
    (r"\left\{ a + b \right.", [r"\bigl\{ a ", r"+ b \bigr."]),
    (r"+ \left(a + \left[b - c\right]\right)", ["+ (a ", "+ [b - c])"])])
def test_a_wide_term_breaks_within_its_brackets(whole, parts):
    """At the outermost sums; what holds a break grows no longer by itself, what holds none still does."""
    found = inside(whole)
    assert [re.sub(r"\\left|\\right", "", part) for part in found] == parts
    assert all(part.count(r"\left") == part.count(r"\right") for part in found)


@pytest.mark.parametrize("whole", [
    r"\frac{a + b}{c}", r"x^{a + b}", "a", r"+ a \cdot b", "(-a)", r"\begin{cases} a + b \\ c - d \end{cases}",
    r"\left( a + b \middle| c \right)"])
def test_other_terms_do_not(whole):
    assert inside(whole) == [whole]


@pytest.mark.parametrize("name", ["rolling", "jointfriction", "cylinderonplane"])
def test_broken_formulas_say_what_they_said(name):
    """Every token in its place, but for the sizes of brackets; with lines so short that most brackets are broken."""
    def plain(latex):
        return [t for t in tokens(re.sub(r"\\quad ", "", latex)) if not re.match(r"\\(left|right|[bB]ig+[lr]|quad)$| |\.$", t)]

    formulas = [e.latex for e in every(Equation, mb.report(name).blocks) if r"\\" not in e.latex]
    assert len(formulas) > 20
    for latex in formulas:
        assert plain("".join(folded(latex, 12.0))) == plain(latex)
    assert any(r"\biggl(" in line for latex in formulas for line in folded(latex, 12.0))


def test_products_of_wide_brackets_are_broken_in_every_format_and_scaled_in_none():
    terms = " + ".join(rf"\left(a_{{{i}}} - \frac{{b_{{{i}}}}}{{c_{{{i}}}}}\right)" for i in range(30))
    product = rf"x = \left({terms}\right)\,\left(d - {terms}\right)"
    document = Document("a", [Equation(product, 1)])
    tex, md = document.to_latex(), document.to_markdown()
    assert r"\resizebox" not in tex
    assert tex.count(r"\\") > 5
    assert md.count(r"\\") > 5
    for line in (line for text in (tex, md) for line in text.splitlines()):
        assert line.count(r"\left") == line.count(r"\right")
        assert len(line) < 400
    shown = display(product)
    assert max(map(len, re.findall(r"<math.*?</math>", shown))) < 900
    assert shown.count("<span") == 0  # what follows the sign keeps its line
    assert display(f"{product} + {product[4:]}").count('<span class="term">') == 1
    assert '<mo minsize="2.4em" maxsize="2.4em" stretchy="true" fence="true">(</mo>' in shown


def test_no_line_begins_with_the_comma_behind_a_formula():
    html = Document("a", [Paragraph("Here $x_k$, the place; `code`: none.")]).to_html()
    assert re.search(r'<span class="kept"><math>(?:(?!<math>).)*</math>,</span> the place', html)
    assert ".kept { white-space: nowrap; }" in html


def test_wide_formulas_are_scaled_where_they_are_wider_than_the_text_and_rows_with_two_scripts_are_higher():
    cells = " & ".join(9 * [r"\mathbf{a}\times \mathbf{b}\times \mathbf{c}\times \mathbf{d}"])
    wide = rf"\begin{{bmatrix}} {cells} \end{{bmatrix}}"
    tex = Document("a", [Equation(f"G = {wide}", 1), Table(["a", "b"], [["$x_{A}^{B}$", "$y$"], ["$x^2$", "$y_1$"]])]).to_latex()
    assert r"\resizebox{\ifdim\width>0.9\linewidth 0.9\linewidth\else\width\fi}{!}" in tex
    assert tex.count(r"\rule[-1.2ex]{0pt}{3.8ex}") == 1


def test_tables_of_long_words_are_set_in_smaller_type():
    long = f"`{'a0' * 16}…`"
    wider = ["blade.modes", "`mb.report(mb.SecondDisplacement)`", "some rows", long]
    for cells, size in ((["shaft", "x", long], "small"), (wider, "scriptsize")):
        assert rf"{{\{size}\begin{{longtable}}" in Document("a", [Table(cells, [cells])]).to_latex()


def test_unknown_commands_are_told():
    with pytest.raises(FormulaError, match=r"unknown command '\\foo'"):
        inline(r"\foo + 1")
    with pytest.raises(FormulaError, match="closes no bracket or group"):
        inline("a } b")


TEX = next((found for found in map(shutil.which, COMPILERS) if found), None)


WIDE = 20  #: pt, about two letters, by which a line may leave the text


def typeset(folder, name):
    """The log of a real TeX; no line leaves the text, all letters are there."""
    if TEX is None:
        pytest.skip("no TeX here: install texlive-latex-recommended, texlive-pictures and lmodern to typeset the reports")
    for _ in range(2):  # the second run knows the widths of the tables
        flags = ["-interaction=nonstopmode", "-halt-on-error"]
        done = subprocess.run([TEX, *flags, f"{name}.tex"], cwd=folder, capture_output=True, check=False)
        log = done.stdout.decode(errors="replace")
        assert done.returncode == 0, log[-2000:]
    assert [w for w in re.findall(r"Overfull .hbox \(([0-9.]+)pt", log) if float(w) > WIDE] == []
    assert "Missing character" not in log
    assert "multiply defined" not in log
    return log


@pytest.mark.parametrize(("name", "level"), [("revolute", "lecture"), ("lineload", "full")])
def test_a_report_is_typeset(name, level, tmp_path):
    mb.report(name, level=level).save(tmp_path / "report.tex")
    typeset(tmp_path, "report")


SCENES = sorted(path.stem for path in EXAMPLES.glob("*.py") if "\ndef scene(" in path.read_text(encoding="utf-8"))


@pytest.mark.slow
@pytest.mark.parametrize("level", ["full", "lecture"])
@pytest.mark.parametrize("name", [*names(), *SCENES])
def test_reports_are_typeset(name, level, tmp_path, monkeypatch):
    """Whole, and in pieces by another document; all fonts are outlines."""
    if TEX is None:
        pytest.skip("no TeX here")
    monkeypatch.syspath_prepend(str(EXAMPLES))
    what = runpy.run_path(str(EXAMPLES / f"{name}.py"))["scene"]() if name in SCENES else name
    document = mb.report(what, level=level)
    document.save(tmp_path / "report.tex")
    typeset(tmp_path, "report")
    if shutil.which("pdffonts"):
        fonts = subprocess.run(["pdffonts", "report.pdf"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        assert "Type 3" not in fonts
    if name not in SCENES:
        files = document.fragments(tmp_path, name="piece")
        taken = "\n".join(f"\\input{{{file.name}}}" for file in files if file.suffix == ".tex")
        packages = "amsmath,amssymb,bm,graphicx,longtable,array,tikz"
        (tmp_path / "other.tex").write_text(
            f"\\documentclass{{article}}\\usepackage[T1]{{fontenc}}\\usepackage{{{packages}}}\\begin{{document}}{taken}"
            "\\end{document}", encoding="utf-8")
        typeset(tmp_path, "other")


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
