"""The audit of published formulas: verdicts, repairs, damages, units, what it refuses, what it writes."""

from __future__ import annotations

import json
import random
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.audit import Audit, verdicts
from mbdae.audit.compare import SAME, ComparedStates, difference
from mbdae.audit.edits import Candidates, edits
from mbdae.audit.evaluate import SizeError, evaluate
from mbdae.audit.laws import wordings
from mbdae.audit.notation import AuditError, Relation, TextReader, is_zero
from mbdae.audit.phrases import understand
from mbdae.audit.reading import Printed, read
from mbdae.audit.verdicts import audit_equation
from mbdae.errors import MbdaeError
from mbdae.laws.joint_rows import same_point

FILE = Path(__file__).parents[2] / "validation" / "paper" / "paper.audit"  #: its verdicts are a claim of validation/
PAPER = FILE.read_text(encoding="utf-8")
MEANINGS = """
b3k [1]: axis 3 of k
b1l [1]: axis 1 of l
wk [rad/s]: angular velocity of k
wl [rad/s]: angular velocity of l
c [1]: row tilt_y of Revolute
cdot [1/s]: number
u [m]: position of l relative to k
F [N]: applied force of PointSpring on move l
K [N/m]: parameter stiffness of PointSpring
C [N s/m]: parameter damping of PointSpring
L [m]: parameter length of PointSpring
vk [m/s]: velocity of k
vl [m/s]: velocity of l
"""


def verdicts_of(source: Path | str) -> Audit:
    """The audit without the longer searches of repairs: those of the paper are a claim of validation/."""
    def repair(equation, states, found=verdicts.repair):
        return found(equation, states) if equation.number.lstrip("x") in ("3", "27", "34", "41", "51") else None

    with pytest.MonkeyPatch.context() as m:
        m.setattr(verdicts, "repair", repair)
        return mb.audit(source)


@pytest.fixture(scope="module")
def paper() -> Audit:
    return verdicts_of(FILE)


# -- published formulas


def test_missing_term_and_conventions(paper: Audit) -> None:
    assert "(~b3k*r)' in row 4 and columns 1 to 3" in paper["29"].repair
    assert paper["33"].remark.startswith("not defined where u = 0")
    assert paper["42"].remark.startswith("not defined where vt = 0")
    assert paper["37"].side == paper["38"].side == 1
    assert paper["43"].side == paper["44"].side == -1
    assert "leave a moment" in paper["44"].remark


def test_polynomials_are_compared_in_symbols(paper: Audit) -> None:
    symbolic = {r.equation for r in paper.equations if r.symbolic}
    assert {"1", "3", "8", "10", "11", "12", "30", "31", "32"} <= symbolic
    assert not symbolic & {"9", "16", "18", "33"}  # hold for bodies that are joined


def test_units_find_the_bracket(paper: Audit) -> None:
    assert "1/sigma0*muk has the unit m" in paper["52"].remark


def test_verdicts_come_from_the_formulas_alone(paper: Audit) -> None:
    """Other numbers, the same verdicts, of every third equation; and the file says nothing of what is right."""
    renamed = re.sub(r"(?m)^(T?\d+)( ?\(.*?\))?:", r"x\1\2:", PAPER)
    renamed = re.sub(r"\b(of|in) (34)\b", r"\1 x\2", renamed).split("claims:")[0]
    others = {row.equation for row in paper.equations if row.verdict == "AMBIGUOUS"} | {"27"}  # judged by others, by its repair
    alone = [e for e in read(renamed).equations if e.number.removeprefix("x") not in others]
    found = {e.number.removeprefix("x"): audit_equation(e, search=False).verdict for e in alone[::3]}
    assert len(set(found.values())) > 2
    assert found == {number: paper[number].verdict for number in found}
    assert not re.search(r"right|misprint|wrong|repair|incomplete|ambiguous|should", PAPER.replace("right-hand side", ""), re.I)


# -- damages


def same_side(equation: Printed, statement: Relation, i: int, new: object) -> bool:
    """Whether a damaged side has the values of the side as printed, where the text speaks of."""
    states = ComparedStates(equation, equation.inner or "l")

    def gaps(envs: list) -> tuple[float, float]:
        with np.errstate(all="ignore"):
            pairs = [(evaluate(statement.sides[i], e), evaluate(new, e)) for e in envs]
        return max(difference(a, b) for a, b in pairs), max(float(np.max(np.abs(a))) for a, _ in pairs)

    for envs in (states.free, states.joint):
        try:
            gap, size = gaps(envs)
        except SizeError:
            continue
        if gap < SAME and size > SAME:
            return True
    return False


def damaged(equation: Printed, rng: random.Random, count: int) -> list[tuple[str, Printed]]:
    """Equations with one random slip each that changes the value of a side."""
    out: list[tuple[str, Printed]] = []
    places = [(j, i) for j, s in enumerate(equation.statements) for i, side in enumerate(s.sides) if not is_zero(side)]
    for _ in range(20 * count):
        j, i = rng.choice(places)
        statement = equation.statements[j]
        candidates = Candidates(equation.scope, ComparedStates(equation, equation.inner or "l").joint[0])
        options = list(edits(statement.sides[i], candidates))
        if not options:
            continue
        edit, new = rng.choice(options)
        if same_side(equation, statement, i, new):
            continue
        worse = replace(statement, sides=(*statement.sides[:i], new, *statement.sides[i + 1 :]))
        out.append((edit.words, replace(equation, statements=(*equation.statements[:j], worse, *equation.statements[j + 1 :]))))
        if len(out) == count:
            break
    return out


def test_damages_of_right_equations_are_seen(paper: Audit) -> None:
    rng, seen = random.Random(55), 0
    for row in paper.equations:
        if row.verdict == "RIGHT":
            for words, worse in damaged(row.printed, rng, 4):
                found = audit_equation(worse, search=False)
                if words.startswith("sign of") and any(row.printed.scope.symbols[n].phrase.side == "applied" for n in worse.used):
                    assert found.verdict in ("MISPRINT", "AMBIGUOUS")  # the side of a friction force is not declared
                    continue
                assert found.verdict in ("MISPRINT", "CANNOT JUDGE"), f"{row.equation}: {words}: {worse.text}"
                assert found.verdict == "MISPRINT" or found.residual != found.residual  # sizes that do not fit have no number
                seen += found.verdict == "MISPRINT"
    assert seen > 115


def test_damages_are_repaired(paper: Audit) -> None:
    """One slip in a right equation: a repair is found that makes it right (not always the only one)."""
    rng = random.Random(7)
    for number in ("9", "16", "22", "39", "48", "53"):
        for words, worse in damaged(paper[number].printed, rng, 2):
            if "without" in words:  # what was left out altogether is not searched for, apart from a factor
                continue
            row = audit_equation(worse)
            assert row.repaired is not None, f"{number}: {words}: {worse.text}"
            assert audit_equation(row.repaired).verdict == "RIGHT"


# -- formulas of one's own


class Universal(mb.Joint):
    """Two shafts that meet in a cross."""

    def constraints(self, k, l):
        return same_point(k, l) | {"cross": k.x @ l.y}


def test_a_law_of_ones_own() -> None:
    text = """
b1k [1]: axis 1 of k
b2l [1]: axis 2 of l
b3l [1]: axis 3 of l
F [N m]: force of row cross of Universal on turn k, turn l
m [N m]: multiplier of row cross of Universal
s [1]: parameter scaling of Universal
p [N m]: parameter penalty of Universal
c [1]: row cross of Universal
1: c = b1k'*b2l
2: F = [~b1k*b2l*(s*m + 2*p*c); -~b1k*b2l*(s*m + 2*p*c)]
3: F = [~b1k*b2l*(s*m + 2*p*c); -~b1k*b3l*(s*m + 2*p*c)]
"""
    found = mb.audit(text, laws={"Universal": Universal})
    assert [r.verdict for r in found.equations] == ["RIGHT", "RIGHT", "MISPRINT"]
    assert found["3"].repair == "b3l -> b2l"


def test_rates_and_files(tmp_path) -> None:
    file = tmp_path / "rates.audit"
    file.write_text(MEANINGS + "rate: rate(c) = (wk - wl)'*~b3k*b1l\nsign: rate(c) = (wl - wk)'*~b3k*b1l\n")
    found = mb.audit(file)
    assert [r.verdict for r in found.equations] == ["RIGHT", "MISPRINT"]
    assert found["sign"].repaired is not None


def test_force_of_a_spring() -> None:
    text = MEANINGS.replace("on move l", "on move k, move l")
    good = "1: F = [u; -u]*(K*(norm(u) - L) + C*u'*(vl - vk)/norm(u))/norm(u)\n"
    found = mb.audit(text + good + good.replace("- L", "+ L").replace("1:", "2:"))
    assert [r.verdict for r in found.equations] == ["RIGHT", "MISPRINT"]
    assert found.equations[0].where == "u != 0"  # a length in a denominator, where the law of the spring is undefined too


def test_forces_that_are_not_listed() -> None:
    text = """
b3k [1]: axis 3 of k
m [N]: multiplier of row axial of ClearanceRevolute
s [1]: parameter scaling of ClearanceRevolute
p [N/m]: parameter penalty of ClearanceRevolute
c [m]: row axial of ClearanceRevolute
F [N]: force of row axial of ClearanceRevolute on move k, move l
1: F = [-b3k; b3k]*(s*m + 2*p*c)
"""
    row = mb.audit(text)["1"]
    told = "there is a force on turn k too, which the text does not list: the formula or the list is incomplete"
    assert (row.verdict, row.remark) == ("INCOMPLETE", told)


def test_units_alone_can_be_wrong() -> None:
    """A formula whose numbers agree only because the units of a symbol are not those of its meaning."""
    row = mb.audit("u [m]: position of l relative to k\nx [m]: position of l\ny [m/s]: position of k\n1: u = x - y\n")["1"]
    assert row.verdict == "MISPRINT"
    assert "in a sum x has the unit m, y the unit m s^-1" in row.remark


@pytest.mark.parametrize(("line", "told"), [
    ("1: c = b3k'*b9l", "line 15: the symbol 'b9l' has no meaning"),
    ("1: c = b3k'*(b1l", r"line 15: '\)' is missing"),
    ("1: c = b3k' ! b1l", "line 15: '!' is not in the notation"),
    ("1: c = dot(b3k, b1l)", "line 15: 'dot' is no function of the notation"),
    ("1: c = atan2(c)", "'atan2' takes 2 arguments, not 1"),
    ("1: c = sum(c, 2*c, 0, 3)", "the second argument of 'sum' must be the name of its variable"),
    ("1: c = [b3k; b3k, b1l]", "the rows of a block differ in length"),
    ("1: c", "a statement needs '='"),
    ("1: c = b3k'*", "the formula ends where a number"),
    ("x [m]: length of something", "line 15: mbdae does not know the meaning 'length of something'"),
    ("x [1]: axis 4 of k", "line 15: mbdae does not know the meaning 'axis 4 of k'"),
    ("x [furlong]: number", "line 15: the unit 'furlong' is not known"),
    ("x [N/m]: parameter stiffness of Bushing", "Bushing has no parameter 'stiffness'; it has kx, ky, kz"),
    ("x [N/m]: parameter damping of PointSpring", "has the unit N s/m in mbdae: declare it with that, not N/m"),
    ("x [N/m]: parameter stiffness of Nonsense", "an audit knows no law 'Nonsense'; give a class of your own"),
    ("let x [m] = u*y", "line 15: the symbol 'y' has no meaning"),
    ("inner race: m", "say k or l"),
    ("states: welded", "an audit knows no joint 'welded' with coordinates"),
    ("forces: upwards", "say left or applied or open"),
    ("what is this", "is neither"),
])
def test_a_bad_line_spoils_itself_alone(line: str, told: str) -> None:
    """It becomes a row that says why; an equation before it and one after it in a section of its own keep their verdicts."""
    after = "section: next\n9: c = b3k'*b1l\n" if line[0] not in "x1lw" else "9: c = b3k'*b1l\n"
    rows = mb.audit(MEANINGS + line + "\n8: u = 2*u\n" + after).equations
    assert (rows[0].verdict, bool(re.search(told, rows[0].remark))) == ("CANNOT JUDGE", True), rows[0].remark
    assert rows[-1].verdict == "RIGHT"
    assert rows[0].equation in ("1", "line 15")


def test_what_cannot_be_compared_is_said() -> None:
    row = mb.audit("q [1]: row tilt_w of Revolute\nb3k [1]: axis 3 of k\n1: q = b3k'*b3k\n")["1"]
    assert (row.verdict, "has no row 'tilt_w'" in row.remark) == ("CANNOT JUDGE", True)
    assert row.residual != row.residual  # no number
    with pytest.raises(MbdaeError, match="there is no file"):
        mb.audit("nowhere.audit")


def test_formulas_are_read_as_they_are_written() -> None:
    for equation in read(PAPER).equations:
        for statement in equation.statements:
            assert TextReader(str(statement)).statement().sides == statement.sides


# -- claimed numbers


CLAIMS = "claims:\n\nlinks: 7 = links of the wing\nhinges: 20 = hinges of the wing\n"


def test_claimed_numbers_are_counted_by_whoever_asks() -> None:
    found = mb.audit(CLAIMS, counts={"links of the wing": 7, "hinges of the wing": lambda: (19, "ten and nine")}).claims
    assert [(c.counted, c.verdict, c.remark) for c in found] == [(7, "RIGHT", ""), (19, "MISPRINT", "ten and nine")]
    found = mb.audit(CLAIMS, counts={"links of the wing": lambda: 8}).claims
    assert [(c.counted, c.verdict) for c in found] == [(8, "MISPRINT"), (None, "CANNOT JUDGE")]
    assert "give audit(..., counts={'hinges of the wing': number, or a function that counts})" in found[1].remark
    assert "hinges  CANNOT JUDGE             claimed 20, counted - (nothing counts this" in mb.audit(CLAIMS).table()


@pytest.mark.parametrize(("counts", "told"), [
    ({"links of the wing": "seven"}, "counts\\['links of the wing'\\] = 'seven' is not a whole number from 0"),
    ({"links of the wing": 7.5}, "counts\\['links of the wing'\\] = 7.5 is not"),
    ({3: 7}, "counts: the key 3 is no text; give"),
    ({"links of the wing": lambda: "seven"}, "counts\\['links of the wing'\\] = 'seven'.*give a whole number"),
])
def test_counts_that_are_none_are_refused(counts: dict, told: str) -> None:
    with pytest.raises(MbdaeError, match=told):
        mb.audit(CLAIMS, counts=counts)


# -- what is written


def test_json_and_documents(paper: Audit, tmp_path) -> None:
    data = json.loads(paper.to_json(tmp_path / "paper.json"))
    assert json.loads((tmp_path / "paper.json").read_text(encoding="utf-8")) == data
    assert {"equation", "printed", "derived", "verdict", "repair", "residual"} <= set(data["equations"][0])
    assert all(row["derived"] for row in data["equations"])
    for ending in ("html", "md", "tex"):
        text = paper.save(tmp_path / f"paper.{ending}").read_text(encoding="utf-8")
        assert "MISPRINT" in text
        assert "Contact models for revolute joints with clearance" in text
    assert paper.table().count("\n") == 57 + 4


def test_wordings_are_listed() -> None:
    assert "axis {i} of {side}" in wordings()
    assert len(wordings()) > 60
    with pytest.raises(AuditError, match=r"from mbdae\.audit import wordings"):
        understand("nonsense", ())


def test_example_of_the_documentation(tmp_path, monkeypatch) -> None:
    page = (Path(__file__).parents[2] / "docs" / "reports.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for begin in ('printed = """\n', "import mbdae as mb\n\nclass Universal"):
        exec(re.search(rf"```python\n({re.escape(begin)}.*?)```", page, re.S)[1], names)
    assert [(r.verdict, r.repair) for r in names["found"].equations] == [
        ("RIGHT", ""), ("MISPRINT", "sign of ~b1k*b2l*(s*mu + 2*p*c)")]
    assert (tmp_path / "universal.html").is_file()


def test_command_line(tmp_path, capsys, monkeypatch) -> None:
    from mbdae.cli import main

    text = "c [1]: row tilt_y of Revolute\nb3k [1]: axis 3 of k\nb1l [1]: axis 1 of l\n1: c = -b3k'*b1l\n"
    (tmp_path / "own.audit").write_text(text, encoding="utf-8")
    assert main(["report", str(tmp_path / "own.audit"), "--json"]) == 1
    (row,) = json.loads(capsys.readouterr().out)["equations"]
    assert (row["equation"], row["verdict"], row["derived"]) == ("1", "MISPRINT", "c = b3k'*b1l")
    assert main(["report", str(tmp_path / "own.audit"), "--format", "tex", "--out", str(tmp_path)]) == 1
    assert (tmp_path / "own.tex").is_file()
    assert main(["report", str(tmp_path / "own.audit"), "--format", "md", "--out", str(tmp_path / "own.tex")]) == 2
    assert main(["report", "nowhere.audit"]) == 2
    for line, code in (("c = b3k'*b1l", 0), ("c = -b3k'*b1l", 1), ("c = b3k'*(", 1), ("c = nobody'*b1l", 1)):
        (tmp_path / "one.audit").write_text(text.rpartition("1: ")[0] + f"1: {line}\n", encoding="utf-8")
        assert main(["report", str(tmp_path / "one.audit")]) == code
    capsys.readouterr()


def test_documents_on_the_command_line(paper: Audit, capsys, monkeypatch) -> None:
    from mbdae.cli import main

    monkeypatch.setattr(sys.modules["mbdae.audit"], "audit", lambda source: paper)  # once is enough
    assert main(["report", str(FILE), "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert {row["verdict"] for row in data["equations"]} == {"RIGHT", "MISPRINT", "INCOMPLETE", "AMBIGUOUS"}
    for format in ("html", "md", "tex"):
        assert main(["report", str(FILE), "--format", format]) == 1
        assert "MISPRINT" in capsys.readouterr().out


def test_no_paper_is_part_of_the_package(capsys) -> None:
    from mbdae.cli import main

    assert main(["report", "paper"]) == 2
    assert "report 'paper': this is neither a file nor one of " in capsys.readouterr().err


def test_counts_of_claims_that_the_text_does_not_make_are_refused():
    text = "claims:\nA: 3 = rows of something\n"
    assert mb.audit(text, counts={"rows of something": 3}).claims[0].verdict == "RIGHT"
    with pytest.raises(mb.OptionError, match="has no claim with the words 'nonsense'; its claims: 'rows"):
        mb.audit(text, counts={"nonsense": 3})


def test_a_text_without_equations_is_no_audit():
    with pytest.raises(mb.MbdaeError, match="there are no equations"):
        mb.audit("title: none\n")
