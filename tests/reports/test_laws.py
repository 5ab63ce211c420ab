"""Reports of all laws: they hold, they define what they write, they come from what is integrated."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mbdae as mb
from mbdae.laws.joint_rows import ClearanceRevolute
from mbdae.laws.journal import JournalContact
from mbdae.laws.on_coordinates import JointSpring
from mbdae.reports import exported, names
from mbdae.reports.law_page import LawPage
from mbdae.reports.statement import derived, structure_of
from mbdae.symbolic.law import Law
from mbdae.symbolic.outputs import fingerprint

sys.path.insert(0, str(Path(__file__).parent))

from reading import holds_and_defines

#: contacts, joints and a force whose pages are made as those of others are
LONG = ("journalcontact", "cylinderonplane", "balloncylinder", "ballonball", "fixedorientation", "pointonline", "free",
        "rotationalbushing")


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in names()])
def test_report_holds_and_defines_its_symbols(name):
    """Its checks hold, its hash is that of the equations derived anew, every symbol it uses is defined in it, and has one unit
    where the coordinate is known; only sums of coordinates of any kind and coordinates without their joint leave it open."""
    document = mb.report(name)
    holds_and_defines(document, name)
    law = exported().get(name)
    if law is not None and issubclass(law, mb.Joint | mb.Force):
        assert fingerprint(derived(law, structure_of(law, {}))) in document.to_markdown()
    if name != "clearance":  # which consists of two others
        rows = [row for b in document.blocks if getattr(b, "title", "") == "Symbols" for row in b.blocks[0].rows]
        assert rows or name == "beamnode"  # whose page has no formula, and thus no check
        assert [row for row in rows if not row[1]] == []
        assert name in ("weightedsum", "jointcoordinate") or [row for row in rows if " or " in row[1]] == []


@pytest.mark.parametrize("level", ["lecture", "full"])
def test_a_page_without_formulas_has_no_check(level):
    text = mb.report("beamnode", level=level).to_markdown()
    assert "hold" not in text
    assert "read back" not in text


def test_pages_speak_of_what_their_laws_have():
    """A derivative at fixed multipliers of a law without rows, forces of a potential alone, a body k of gravity."""
    gravity, spring = (mb.report(name).to_markdown() for name in ("gravity", "pointspring"))
    assert r"from $-\delta V$; about" in gravity
    assert "body k" not in gravity
    assert r"from $-\delta V$ and $-\partial D" in spring
    assert "Coordinates are those" not in spring
    assert "At the same motion; what it adds" in gravity
    assert "At the same motion and internal states; what these add" in mb.report("jointfriction").to_markdown()
    assert "At the same motion and multipliers; what these add" in mb.report("screw").to_markdown()
    assert "Derivatives by the parameters" not in mb.report("pointspring", level="lecture").to_markdown()


def test_letters_of_two_places_have_the_primes_of_what_they_follow_from():
    """And names without a letter are numbered from 1."""
    text = mb.report("cylinderonplane", level="lecture").to_markdown()
    for mark in ("", "'"):
        assert f"\na{mark} = \\begin{{cases}} p{mark} & p{mark} > 0" in text
        assert re.search(rf"\nf_n{mark} = \\begin{{cases}} (\\eta_{{\d}}) & \1 > 0", text)
        force = re.search(rf"\n\\mathbf{{f}}{mark} = (.*)", text)[1]
        assert f"f_n{mark}" in force
        assert f"a{mark}^{{3/2}}" in force
        assert ("'" in force) == bool(mark)
    hertz = mb.report("hertz").to_markdown()
    assert set(re.findall(r"\\eta_{(\d+)}", hertz)) == {"1"}


def test_forces_have_their_derivatives_by_the_parameters():
    """In all formats; those of a spring are what the law says: f = -k (|d| - L) d/|d| - c (d.a) d/(d.d)."""
    document = mb.report("pointspring")
    for text in (document.to_markdown(), document.to_html(), document.to_latex()):
        assert "Derivatives by the parameters" in text
    lines = [line.partition(" \\tag")[0] for line in document.to_markdown().splitlines() if line.startswith(r"\frac{\partial")]
    assert lines == [r"\frac{\partial \mathbf{f}_l}{\partial k} = \left(\frac{L}{\lVert \mathbf{d}\rVert} - 1\right)\,\mathbf{d}",
                     r"\frac{\partial \mathbf{f}_l}{\partial c} = "
                     r"-\frac{\mathbf{d}\cdot \mathbf{a}}{\mathbf{d}\cdot \mathbf{d}}\,\mathbf{d}",
                     r"\frac{\partial \mathbf{f}_l}{\partial L} = \frac{k}{\lVert \mathbf{d}\rVert}\,\mathbf{d}"]
    for name, printed in (("screw", r"\frac{\partial \mathbf{m}_k}{\partial \text{lead}} = "),
                          ("hertz", r"\frac{\partial f_n}{\partial k_h} = "),
                          ("coulomb", r"\frac{\partial \mu}{\partial v_{c}} = "),
                          ("jointspring", r"\frac{\partial \mathbf{m}_l}{\partial c_0} = ")):
        assert printed in mb.report(name).to_markdown()


@pytest.mark.parametrize("name", ["bushing", "screw", "hertz", "lugre"])
def test_a_wrong_derivative_by_a_parameter_is_told(name, monkeypatch):
    """The print is compared with the derived equations, of which nothing was changed here."""
    right = LawPage.changing
    monkeypatch.setattr(LawPage, "changing", lambda page, *given: replace_clock(right(page, *given), 1.01))
    assert "NOT EQUAL" in mb.report(name).to_markdown()


def replace_clock(by, rate):
    """A derivative by a parameter that counts `rate` times."""
    by.clock = dict.fromkeys(by.clock, rate)
    return by


def test_units_follow_the_coordinate():
    for joint, unit in ((mb.Revolute, "N m/rad"), (mb.Prismatic, "N/m")):
        document = mb.report(JointSpring, joint=joint)
        rows = next(b for b in document.blocks if getattr(b, "title", "") == "Symbols").blocks[0].rows
        assert next(row[1] for row in rows if row[2] == "stiffness") == unit
    rows = next(b for b in mb.report(mb.Prismatic).blocks if getattr(b, "title", "") == "Symbols").blocks[0].rows
    units = {symbol: row[1] for row in rows for symbol in row[0].split(", ")}
    assert units[r"$c_{\text{offset x}}$"] == "m"
    assert units[r"$\dot c_{\text{offset x}}$"] == "m/s"
    assert units[r"$\gamma_{\text{tilt y}}$"] == "1/s²"


def test_hash_follows_the_equations():
    shape = structure_of(mb.Revolute, {})

    class Revolute(mb.Revolute):
        def constraints(self, k, l):
            return super().constraints(k, l) | {"tilt_x": -(k.z @ l.y)}

    assert fingerprint(derived(Revolute, shape)) != fingerprint(derived(mb.Revolute, shape))


@pytest.mark.parametrize("seed", ["0", pytest.param("1", marks=pytest.mark.slow)])
def test_reports_are_the_same_in_every_process(seed):
    """Neither hash nor tables hang on the order of sets, which is another in every process."""
    code = "import mbdae as mb; print(mb.report('revolute').to_markdown(), end='')"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True,
                         env=os.environ | {"PYTHONHASHSEED": seed, "PYTHONIOENCODING": "utf-8"})
    assert run.stdout.splitlines() == mb.report("revolute").to_markdown().splitlines()


def test_hash_of_a_scene_is_that_of_the_report():
    s = mb.Scene("two bodies", space="spatial")
    a, b = s.rigid_body("a", 1.0, (1, 1, 1)), s.rigid_body("b", 1.0, (1, 1, 1), at=(1, 0, 0))
    s.spherical("joint", a, b, at=(0.5, 0, 0))
    known = fingerprint(derived(mb.Spherical, structure_of(mb.Spherical, {})))
    assert known in mb.report(mb.Spherical).to_markdown()
    assert known[:32] in mb.report(s).to_markdown()


class Screw(mb.Joint):
    """A nut on a thread: one turn moves it by 2 pi pitch."""

    params = mb.params(pitch=("m/rad", "travel per angle"))

    def constraints(self, k, l):
        d = l.r - k.r
        thread = k.z @ d - self.pitch * self.relative_angle(k, l)
        return {"x": k.x @ d, "y": k.y @ d, "tilt_y": k.z @ l.x, "tilt_x": k.z @ l.y, "thread": thread}


class QuarticSpring(mb.Force):
    """Spring between two points that stiffens with its length."""

    params = mb.params(stiffness=("N/m^3", "stiffness"))

    def energy(self, k, l):
        d = l.r - k.r
        return self.stiffness * (d @ d) ** 2 / 4


@pytest.mark.parametrize("law", [Screw, QuarticSpring])
def test_a_new_law_has_its_report(law):
    text = mb.report(law).to_markdown()
    assert "comparisons hold" in text
    assert law.__doc__.split(":")[0] in text
    assert next(iter(law.params.values())).meaning in text


def test_of_values_models_and_joints():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0))
    assert mb.report(s["hinge"]).title == "Revolute joint"
    assert mb.report(mb.Classical()).title == mb.report("classical").title == "Revolute joint, its coordinate an unknown"
    assert mb.report(mb.Recursive).title == "Recursive joint"
    clearance = mb.Clearance(0.0501, 0.05, mb.Hertz(1e9, damping=0.3), mb.Coulomb(0.3, 1e-3))
    assert "f_n" in mb.report(clearance).to_markdown()
    assert mb.report(mb.Coulomb(0.2, 0.01)).title == "Coulomb friction"
    with pytest.raises(mb.OptionError, match="give a law"):
        mb.report(3)
    for name in ("revolut", "Revolute"):
        with pytest.raises(mb.OptionError, match=f"what = '{name}' is not known: did you mean 'revolute'\\? give one of"):
            mb.report(name)
    assert issubclass(exported()["revolute"], Law)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["revolute", "classical", "recursive", "clearance", "coulomb", "lugre", "beam", "weld"])
def test_cold_report_takes_less_than_five_seconds(name, tmp_path):
    """Of the processor: the clock counts what else the machine does."""
    for ending in ("html", "md", "tex"):
        before = os.times()
        subprocess.run([sys.executable, "-m", "mbdae", "report", name, "--out", str(tmp_path / f"{name}.{ending}")], check=True,
                       capture_output=True)
        after = os.times()
        assert after.children_user + after.children_system - before.children_user - before.children_system < 5


@pytest.mark.parametrize("read", [mb.report, mb.selftest])
def test_options_of_another_kind_are_refused(read):
    for law, options, said in (
        (JournalContact, {"normal": 3}, r"normal = 3 is no normal law: give one such as mb\.Hertz"),
        (ClearanceRevolute, {"tilting": "yes"}, "tilting = 'yes' is neither True nor False"),
        (JointSpring, {"joint": 3}, "joint = 3 is not a class of a law: give one such as mb.Revolute"),
        (mb.Revolute, {"tilt": True}, "tilt"),
    ):
        with pytest.raises(mb.MbdaeError, match=said):
            read(law, **options)
