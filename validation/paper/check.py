"""The formulas (1) to (55) of the paper and the numbers it claims: the audit finds what an audit by hand found."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from runner import Case, Claim, Found, module_of

import mbdae as mb
from mbdae.audit import Audit
from mbdae.audit.notation import TextReader
from mbdae.audit.verdicts import audit_equation

claim = Claim("paper", "published formulas of revolute joints: verdicts, repairs and counted numbers are those found by hand", 0,
              "differences", "the 55 formulas and two of the text compared with their derivation by hand")
#: from the audit by hand; the others are right
BY_HAND = {
    "MISPRINT": ("T1", "3", "13", "24", "25", "27", "28", "34", "35", "36", "41", "51", "52", "T52", "55"),
    "INCOMPLETE": ("29", "33", "42"),
    "AMBIGUOUS": ("37", "38", "43", "44"),
}
#: the formulas it gives for misprints; where none is given here, the roles of the races are exchanged
CORRECTED = {
    "T1": "[b3k'*b1l; b3k'*b2l]",
    "3": "-~b3k*b1l*(s*lambda1 + 2*p*c1) - ~b3k*b2l*(s*lambda2 + 2*p*c2)",
    "13": "(~b1k*b1l*sin(phit) + ~b1k*b2l*cos(phit))*(s*lambda3 + 2*p*c3)",
    "24": "[I; b3k']*(Fe - Me*~b3k'*wk*phidot)",
    "25": "[I; b3k']*Me*[I, b3k]",
    "27": "[~b3k'*phiddot + phidot*~wk*~b3k', 0]",
    "28": "[I; b3k']*(Ce*[I, b3k] + Me*~b3k'*[phidot*I, wk])",
    "41": "vt = (I - n*n')*vr",
    "51": "ft = -muk*fn*tanh(vt/vc)",
    "52": "g = 1/sigma0*(muk + (mus - muk)*exp(-abs(v/vs)^gamma))",
    "T52": "v = vt",
    "55": "zi = (vi + zpdot + 2/hi*zp)/(2/hi + abs(vi)/g)",
}
#: what the audit by hand says beside the verdicts: other roots, balance, clamped force, energy, accents
REMARKS = {
    "1": "half a turn about its axis 1, 2", "10": "half a turn about its axis 3", "12": "half a turn about its axis 3",
    "13": "accents alone", "18": "leave a resultant", "19": "leave a resultant", "24": "accents alone", "25": "accents alone",
    "28": "accents alone", "44": "leave a moment", "46": "pulls where", "48": "pulls where", "53": "feeds energy",
    "54": "dissipative only for a constant one",
}
WING, ROTOR = (module_of(Path(__file__).parents[1], name) for name in ("flapping_wing", "flexible_ground_resonance"))
ROLES = "the roles of the races exchanged: k is the outer, l the inner one"


def clearance() -> tuple[int, str]:
    """Rows of a revolute with clearance, in space."""
    s = mb.Scene("pin in its race", space="spatial")
    pin = s.rigid_body("pin", 1.0, (1e-3, 1e-3, 1e-3), at=(0, 0, 0))
    s.revolute("C", s.ground, pin, at=(0, 0, 0), model=mb.Clearance(0.0501, 0.05, mb.Hertz(1e9)))
    rows = [name for name in s.system(mb.Index3()).names if name.startswith("lambda")]
    return len(rows), ", ".join(rows)


def rotations() -> tuple[int, str]:
    """Rows of a revolute in space, driven by nothing, beside those of its point."""
    s = mb.Scene("hinge", space="spatial")
    body = s.rigid_body("door", 1.0, (1e-3, 1e-3, 1e-3), at=(0, 0, 0))
    s.revolute("H", s.ground, body, at=(0, 0, 0))
    names = [name for name in s.system(mb.Index3()).names if name.startswith("lambda")]
    rows = [name for name in names if name.split(".")[-1].rstrip(")") not in "xyz"]
    return len(rows), ", ".join(rows)


#: by the words of the paper: what counts it, the number found by hand, the verdict on that of the paper
COUNTS = {
    "unknowns fewer when the five revolutes of the rotor become recursive": (ROTOR.fewer_unknowns, 20, "RIGHT"),
    "multipliers of the flapping wing with kinematic revolutes": (WING.multipliers, 42, "RIGHT"),
    "rotational constraints of a kinematic revolute that nothing drives": (rotations, 2, "MISPRINT"),
    "constraints of the revolute joint with clearance": (clearance, 3, "MISPRINT"),
}


@lru_cache(maxsize=1)
def audited() -> Audit:
    """The audit, its numbers counted."""
    return mb.audit(Path(__file__).with_name("paper.audit"), counts={words: c for words, (c, *_) in COUNTS.items()})


def by_hand(number: str) -> str:
    """The verdict of the audit by hand."""
    return next((verdict for verdict, numbers in BY_HAND.items() if number in numbers), "RIGHT")


def verdicts() -> list[Found]:
    """Equations whose verdict differs, by the verdict of the audit by hand."""
    rows = audited().equations
    missing = {*map(str, range(1, 56)), "T1", "T52"} ^ {r.equation for r in rows}
    found = [Found(len(missing), quantity="equations", note=", ".join(sorted(missing)))]
    for verdict in ("RIGHT", *BY_HAND):
        other = [f"({r.equation}) {r.verdict}" for r in rows if by_hand(r.equation) == verdict != r.verdict]
        found.append(Found(len(other), quantity=verdict, note=", ".join(other)))
    return found


def repairs() -> list[Found]:
    """Misprints whose repair is not that found by hand; repairs that, written down and read again, are not right."""
    other, wrong = [], []
    for number in BY_HAND["MISPRINT"]:
        row = audited()[number]
        if row.repaired is None:
            other.append(number)
            continue
        same = CORRECTED[number] in row.repaired.text if number in CORRECTED else row.repair == ROLES
        other += [] if same else [number]
        again = replace(row.repaired, statements=tuple(TextReader(str(s)).statement() for s in row.repaired.statements))
        wrong += [] if audit_equation(again, search=False).verdict == "RIGHT" else [number]
    return [Found(len(other), quantity="not those found by hand", note=", ".join(other)),
            Found(len(wrong), quantity="not right themselves", note=", ".join(wrong))]


def said() -> Found:
    """Remarks of the audit by hand that the audit does not make."""
    lacking = [number for number, words in REMARKS.items() if words not in audited()[number].remark]
    return Found(len(lacking), quantity="remarks not made", note=", ".join(lacking))


def numbers() -> list[Found]:
    """The claimed numbers against those counted in scenes, and the verdicts."""
    found = []
    for c in audited().claims:
        _, expected, verdict = COUNTS[c.claimed.words]
        said = f"claimed {c.claimed.count}, counted {c.counted}{f' ({c.remark})' if c.remark else ''}: {c.verdict}"
        found.append(Found(abs((c.counted or 0) - expected) + (c.verdict != verdict), quantity=c.claimed.name, note=said))
    return found


def cases() -> list[Case]:
    return [Case("verdicts", "none", verdicts), Case("repairs", "none", repairs), Case("remarks", "none", said),
            Case("claimed numbers", "none", numbers)]
