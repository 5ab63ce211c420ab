"""The sheet of a scene: every number is one of the system that would be integrated."""

from __future__ import annotations

import json
import re
import runpy
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.cli import main
from mbdae.documents.blocks import Equation, Section, Table, every
from mbdae.kernels.plan import linearised_plan
from mbdae.reports.scene_sheet import KINDS, Sheet
from mbdae.run.choice import size_of

EXAMPLES = Path(__file__).parents[2] / "examples"


def four_bar():
    return runpy.run_path(str(EXAMPLES / "four_bar.py"))["scene"]()


def pendulum():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (0, -1), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0), damper=0.1)
    return s


def table(document, title):
    section = next(b for b in document.blocks if isinstance(b, Section) and b.title == title)
    return next(b for b in section.blocks if isinstance(b, Table))


def test_numbers_are_those_of_the_system():
    s = four_bar()
    system, document = s.system(), mb.report(s)
    counted = {row[0]: int(row[1]) for row in table(document, "Unknowns and equations").rows}
    assert counted == {KINDS[kind]: n for kind, n in Counter(system.kinds).items()}
    named = {row[0]: row[3].split(", ") for row in table(document, "Unknowns and equations").rows}
    assert [name for names in named.values() for name in names] == list(system.names)
    first, classical, planar, last = ([int(cell) for cell in row[1:]] for row in table(document, "Pruned").rows)
    multipliers = sum(kind in ("lambda", "mu") for kind in system.kinds)
    assert planar[:3] == [system.n, len(system.equations), multipliers]
    assert classical[:3] == [3 * 13 + 42 + 1, 82, 42]  # bodies of 7 + 6, rows, the turns of a spring
    assert first[2] == classical[2] + 2 * 4  # a row more for the coordinate of each hinge
    assert last[:3] == [18, 18, 0]
    plans = [(linearised_plan(g.derived, system.spec.outputs), len(g.instances)) for g in system.model.groups]
    operations = sum(n * p.residual.operations for p, n in plans if p.nonlinear)
    operations += sum(n * p.jacobian.operations for p, n in plans if p.jacobian_places)
    assert planar[4] == operations
    assert first[4] > 10 * operations
    assert planar[3] == sum(bool(p.nonlinear) + bool(p.jacobian_places) for p, _ in plans)
    text = document.to_markdown()
    assert f"{system.n} x {system.n}, {system.pattern.nnz} entries" in text
    check = s.check()
    assert f"{check.degrees_of_freedom} degrees of freedom" in text
    assert all(row in text for row in check.pruned)
    used = {row.name for row in system.numbering.rows}
    stated = {f"{row[0]}.{name}" for row in table(document, "Joints").rows for name in row[5].split(", ")}
    assert stated == used


def test_joints_are_told_in_words():
    """No joint shows an empty table of Python, one of a thing is not many, names of any script stay."""
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rods = [s.link(name, (x, 0), (x, -1), mass=1.0) for x, name in enumerate(("ä_1", "ξ"))]
    s.revolute("Gelenk ß", s.ground, rods[0], at=(0, 0))
    s.revolute("driven", s.ground, rods[1], at=(1, 0), angle=2 * mb.t)
    document = mb.report(s)
    assert [row[6] for row in table(document, "Joints").rows] == ["", "angle = 2*t"]
    text = document.to_markdown()
    assert "1 degree of freedom;" in text
    assert r"\text{Gelenk ß.x}" in text
    assert r"\text{ä 1}" in text
    assert r"\text{ξ}" in text
    assert len(repr(document)) < 400
    assert repr(document).startswith("Document('Scene pendulum': Scene, Bodies, Joints")


def test_eigenvalues_are_those_of_the_linearisation():
    s = pendulum()
    found = [complex(float(row[0]), float(row[1])) for row in table(mb.report(s), "Eigenvalues at the start").rows]
    wanted = [value for value in s.linearize().eigenvalues if value.imag >= 0]
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
    inertia, stiffness = 1 / 3, 9.81 / 2  # of a rod about its end: I phi'' + c phi' + m g l/2 phi = 0
    np.testing.assert_allclose(found[0], (-0.1 + 1j * np.sqrt(4 * inertia * stiffness - 0.01)) / (2 * inertia), rtol=1e-5)


def test_redundant_rows_and_drawing():
    s = mb.Scene("door", space="spatial")
    door = s.rigid_body("door", 1.0, (1, 1, 1), at=(0.5, 0, 0))
    s.revolute("low", s.ground, door, at=(0, 0, -1))
    s.revolute("high", s.ground, door, at=(0, 0, 1))
    document = mb.report(s)
    text = document.to_markdown()
    assert all(row in text for row in s.check().redundant)
    picture = next(document.pictures())
    assert picture.content.startswith(b"\x89PNG")


def test_recursive_and_flexible_scenes_have_sheets():
    tree = pendulum().recursive()
    sheet = Sheet(tree)
    assert sheet.system.label == "ODE"
    sizes = [step.size.unknowns for step in sheet.check.reductions]
    assert sizes[-1] == size_of(sheet.system.assembly).unknowns == 2 < sizes[0]
    assert sizes == sorted(sizes, reverse=True)
    s = mb.Scene("cantilever", gravity=(0, -9.81, 0))
    beam = s.beam("beam", (0, 0), (1, 0), section=mb.Section.circular(5e-3, E=210e9, nu=0.3, rho=7850), elements=2)
    s.weld("clamp", s.ground, beam, at=(0, 0))
    text = mb.report(s).to_markdown()
    assert "beam, 2 elements" in text
    assert "clamp.x" in text


# ---- command line ----------------------------------------------------------------------------------------------------------


def test_command_line_writes_the_format_of_the_ending(tmp_path, capsys):
    assert main(["report", "revolute", "--out", str(tmp_path / "r.html")]) == 0
    assert "<math" in (tmp_path / "r.html").read_text(encoding="utf-8")
    assert main(["report", str(EXAMPLES / "pendulum.py"), "--format", "tex", "--out", str(tmp_path)]) == 0
    assert r"\section*{Bodies}" in (tmp_path / "pendulum.tex").read_text(encoding="utf-8")
    capsys.readouterr()
    assert main(["report", "coulomb"]) == 0
    assert capsys.readouterr().out.startswith("# Coulomb friction")
    assert main(["report", "lugre", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["holds"] is True
    assert re.search("z_", data["text"])


@pytest.mark.parametrize(("words", "message"), [
    (["report", "revolut"], "neither a file nor one of"), (["report", "nowhere.py"], "there is no file 'nowhere.py'"),
    (["report", "weld", "--format", "md", "--out", "w.html"], "give one of the two"),
])
def test_command_line_tells_what_is_wrong(words, message, capsys):
    assert main(words) == 2
    assert message in capsys.readouterr().err


def test_every_letter_of_the_equations_is_defined_once_with_its_unit():
    for scene in (four_bar(), pendulum()):
        document = mb.report(scene)
        rows = table(document, "Symbols and their values at the start").rows
        letters = [row[0] for row in rows]
        assert len(letters) == len(set(letters))
        assert [row for row in rows if not row[2] or not row[3]] == []
        text = document.to_markdown().split("## Equations of the bodies")[1]
        used = set(re.findall(r"[fpFT](?:\^[\\a-z]+)?_\{\\text\{[^{}]*\}(?:,[xyz])?\}", text))
        assert len(used) > 6
        assert {f"${symbol}$" for symbol in used} <= {*letters}


def slid(space):
    """A slide and a rod between masses, a distance of 1 m, which no number 1 stands for."""
    s = mb.Scene("slid", gravity=(0, -9.81, 0), space=space)
    a, b, c = (s.rigid_body(n, 1.0, (0.1, 0.1, 0.1), at=at) for n, at in (("a", (1, 0, 0)), ("b", (1, 1, 0)), ("c", (2, 0, 0))))
    s.prismatic("P", s.ground, a, at=(0, 0, 0), axis=(1, 0.2, 0), damper=3.0)
    s.distance("D", a, b, at_k=(1, 0, 0), at_l=(1, 1, 0))
    s.revolute("R", s.ground, c, at=(1, 0, 0))
    return s


def crank():
    """Lengths of exactly 1 m."""
    s = mb.Scene("crank", gravity=(0, -9.81, 0))
    crank, rod = s.link("crank", (0, 0), (0, 2), mass=1.0), s.link("rod", (0, 2), (2, 3), mass=1.0)
    slider = s.rigid_body("slider", 1.0, (1, 1, 1), at=(2, 3))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=3 * mb.t)
    s.revolute("B", crank, rod, at=(0, 2))
    s.revolute("C", rod, slider, at=(2, 3))
    s.prismatic("S", s.ground, slider, at=(2, 2), axis=(1, 0, 0))
    return s


LETTER = (r"(?:\\d?dot\{\{?\\?\w+\}?\}|\\bar\{\w\}|\\[a-zA-Z]+|\{\w+\}|[a-zA-Z])(?:\^(?:\{(?:[^{}]|\{[^{}]*\})*\}|\\[a-z]+|\w))?"
          r"_\{(?:[^{}]|\{[^{}]*\})*\}")


@pytest.mark.parametrize("scene", [lambda: slid("planar"), lambda: slid("spatial"), crank], ids=["plane", "space", "crank"])
def test_letters_of_scenes_have_units_and_meanings(scene):
    document = mb.report(scene())
    rows = {row[0]: row for row in table(document, "Symbols and their values at the start").rows}
    assert [row for row in rows.values() if not row[2] or not row[3] or row[1].startswith("-0 ")] == []
    units = {row[2] for name, row in rows.items() if re.match(r"\$(c|\{s\}|d)[_^]", name)}
    assert units == {"m"}
    assert scene is not crank or {r"$d^{\text{crank}}_{\text{A},y}$", r"$d^{\text{rod}}_{\text{B},x}$"} <= {*rows}
    text = "".join(e.latex for e in every(Equation, document.blocks))
    assert {f"${letter}$" for letter in re.findall(LETTER, text)} - {*rows} == set()


def test_moments_of_joints_are_shown_and_read_back():
    text = mb.report(four_bar()).to_markdown()
    assert r"T_{\text{A},z} =" in text
    assert "NOT EQUAL" not in text
    assert ["C", "JointSpring", "2", "N m/rad", "stiffness"] in table(mb.report(four_bar()), "Forces").rows


def test_roots_at_a_kink_have_a_note_and_random_states_warn_of_nothing(monkeypatch, recwarn):
    """A mass that just touches a stop; a rope, points within its sheaves among the states; a gyroscope of scales 1e21 apart."""
    s = mb.Scene("touching")
    body = s.rigid_body("b", 2.0, 1.0, at=(0, 0))
    s.prismatic("P", s.ground, body, at=(0, 0), axis=(1, 0, 0), spring=20.0, limits=(None, 0.0), stop=mb.Stop(180.0))
    text = mb.report(s).to_markdown()
    assert "Note: 'P' has a kink exactly at this state" in text
    monkeypatch.syspath_prepend(str(EXAMPLES))
    hoist, gyroscope = (runpy.run_path(str(EXAMPLES / f"{name}.py"))["scene"]() for name in ("hook_block", "gyroscope"))
    assert "The units do not fit" not in mb.report(hoist).to_markdown()
    Sheet(gyroscope).eigenvalues()
    assert [str(w.message) for w in recwarn] == []
