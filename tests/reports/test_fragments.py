r"""Sections of reports as pieces for `\input`: labels, numbers of the document that takes them in, origin in BibTeX."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

import mbdae as mb
from mbdae.documents import COMPILERS
from mbdae.documents.blocks import Equation, every

TEX = next((found for found in map(shutil.which, COMPILERS) if found), None)
LABEL, REFERENCE = r"\\label\{([^}]*)\}", r"\\eqref\{([^}]*)\}"


@pytest.mark.parametrize(("law", "level"), [("revolute", "lecture"), ("universal", "full"), ("beam", "full")])
def test_pieces_have_labels_and_no_numbers(law, level, tmp_path):
    document = mb.report(law, level=level)
    files = document.fragments(tmp_path / "pieces", name=law)
    text = {file.name: file.read_text(encoding="utf-8") for file in files}
    tex = "".join(body for name, body in text.items() if name.endswith(".tex"))
    labels = re.findall(LABEL, tex)
    assert len(labels) == len(set(labels)) == document.to_latex().count(r"\tag{")
    assert {*re.findall(REFERENCE, tex)} <= {*labels}
    assert r"\tag" not in tex
    assert tex.count(r"\begin{") == tex.count(r"\end{")
    assert f"eq:{law}:f-l" in labels or law == "beam"
    bib = text[f"{law}.bib"]
    assert bib.startswith(f"@misc{{{law},")
    assert f"mbdae {mb.__version__}" in bib
    digest = re.search("begins with ([0-9a-f]{32})", bib)[1]
    assert digest in document.to_markdown()


def test_pieces_of_any_document_have_a_name(tmp_path):
    files = mb.report("gear").fragments(tmp_path)
    assert "gear-forces-on-the-bodies.tex" in [f.name for f in files] or "gear-constraint.tex" in [f.name for f in files]
    (tmp_path / "file").write_text("")
    with pytest.raises(mb.OptionError, match="folder = "):
        mb.report("gear").fragments(tmp_path / "file" / "pieces")


@pytest.mark.skipif(TEX is None, reason="no TeX here")
def test_pieces_are_numbered_by_the_document_that_takes_them_in(tmp_path):
    document = mb.report("revolute", level="lecture")
    files = document.fragments(tmp_path, name="revolute")
    after = 1 + next(e.number for e in every(Equation, document.blocks) if e.latex.startswith(r"\mathbf{m}_l ="))
    taken = "\n".join(f"\\input{{{file.name}}}" for file in files if file.suffix == ".tex")
    packages = "amsmath,amssymb,bm,graphicx,longtable,array,tikz"
    (tmp_path / "all.tex").write_text(
        f"\\documentclass{{article}}\\usepackage{{{packages}}}\\begin{{document}}"
        f"\\begin{{equation}}1\\end{{equation}}{taken} See \\eqref{{eq:revolute:m-l}}. \\end{{document}}", encoding="utf-8")
    for _ in range(2):
        done = subprocess.run([TEX, "-interaction=nonstopmode", "-halt-on-error", "all.tex"], cwd=tmp_path, capture_output=True,
                              check=False)
        assert done.returncode == 0, done.stdout.decode(errors="replace")[-2000:]
    assert "undefined" not in (tmp_path / "all.log").read_text(encoding="utf-8", errors="replace")
    assert re.search(rf"\\newlabel\{{eq:revolute:m-l\}}\{{\{{{after}\}}", (tmp_path / "all.aux").read_text(encoding="utf-8"))
