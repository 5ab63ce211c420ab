"""Single edits of the formulas of a report are caught by its own checks."""

from __future__ import annotations

import random

import numpy as np
import pytest
import symengine as se

from mbdae.reports.force import ForceReport
from mbdae.reports.joint import JointReport
from mbdae.reports.report import exported
from mbdae.reports.statement import structure_of
from mbdae.reports.states import random_state
from mbdae.reports.vectors import Base, Product, Vector
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Force

EDITS = 20
LAWS = sorted((law for law in exported().values() if issubclass(law, Joint | Force)), key=lambda law: law.__name__)
OTHER_AXIS = {"x": "y", "y": "z", "z": "x", "r": "c", "v": "w", "w": "v", "s": "r"}


def edited_atom(atom, kind, rng):
    """The atom with another axis, or of the other body."""
    if isinstance(atom, Product):
        left = rng.random() < 0.5
        inner = edited_atom(atom.left if left else atom.right, kind, rng)
        return None if inner is None else Product(inner, atom.right) if left else Product(atom.left, inner)
    if not isinstance(atom, Base):
        return None
    if kind == "body":
        return Base(atom.kind, {"k": "l", "l": "k"}[atom.side]) if atom.side in "kl" else None
    if atom.kind == "E":
        return Base("E", OTHER_AXIS[atom.side])
    return Base(OTHER_AXIS[atom.kind], atom.side) if atom.kind in OTHER_AXIS else None


def edited(vector, kind, rng):
    """The vector after one edit; None where it has no place for it."""
    atom = rng.choice(list(vector.terms))
    terms = dict(vector.terms)
    c = terms.pop(atom)
    if kind == "sign":
        return Vector(vector.record, {**terms, atom: -c})
    if kind == "factor":
        return Vector(vector.record, {**terms, atom: 2 * c})
    if kind == "dropped term":
        return Vector(vector.record, terms)
    other = edited_atom(atom, kind, rng)
    return None if other is None else Vector(vector.record, terms) + Vector(vector.record, {other: c})


def places(r):
    """Vectors the report displays: (get, set)."""
    found = []
    record, written = r.s.record, r.formulas.writer.vectors
    shown = [n for n in written if n not in record.changes]
    found += [(lambda n=n: record.vectors[n], lambda v, n=n: record.vectors.__setitem__(n, v)) for n in shown]
    tables = [*([r.stated_pairs] if isinstance(r, ForceReport) and r.stated_pairs else [])]
    tables += [pairs for pairs, _ in r.duals.values()] if isinstance(r, JointReport) else [r.elastic[0], r.drag[0]]
    for pairs in tables:
        for side in [side for side in r.s.sides if side not in r.s.still]:
            for i in range(2):
                def put(v, pairs=pairs, side=side, i=i):
                    pairs[side] = tuple(v if j == i else pairs[side][j] for j in range(2))

                found.append((lambda pairs=pairs, side=side, i=i: pairs[side][i], put))
    return [(get, put) for get, put in found if get().terms]


def checked(r):
    """The report's checks, run again."""
    r.formulas.checks.clear()
    if isinstance(r, JointReport):
        rate = r.s.motion()
        rates = {row: rate.scalar(e) for row, e in r.s.rows.items()}
        r.rates(rate, rates)
        r.run_checks(rate, rates)
    else:
        r.power()
        r.run_checks()
    return [c for c in r.formulas.checks if not c.holds]


def report_of(law):
    shape = structure_of(law, {})
    r = JointReport(law, shape) if issubclass(law, Joint) else ForceReport(law, shape)
    r.document()
    return r


def one_edit(seed):
    """(law, edit, whether it was caught) of one edit that changes the formula; None where the choice has none."""
    rng = random.Random(seed)
    law, kind = rng.choice(LAWS), rng.choice(["sign", "index", "body", "factor", "dropped term"])
    r = report_of(law)
    assert checked(r) == []
    open_places = places(r)
    if not open_places:
        return None
    get, put = rng.choice(open_places)
    before, after = get(), edited(get(), kind, rng)
    if after is None:
        return None
    state = random_state(r.d, seed=1000 + seed)
    n = r.formulas.numbers(state)
    try:
        if np.max(np.abs(n.vector(before) - n.vector(after))) < 1e-9:
            return None  # says the same
    except (KeyError, StopIteration):
        return None  # a vector the ground does not have
    put(after)
    return law.__name__, kind, bool(checked(r))


def test_single_edits_are_caught():
    found, seed = [], 0
    while len(found) < EDITS:
        edit = one_edit(seed)
        seed += 1
        found += [edit] if edit is not None else []
    missed = [(law, kind) for law, kind, caught in found if not caught]
    assert missed == []
    assert len({law for law, _, _ in found}) >= 8
    assert {kind for _, kind, _ in found} == {"sign", "index", "body", "factor", "dropped term"}


@pytest.mark.parametrize("edit", ["-", "2", "other axis", "other body"])
def test_edits_of_a_row_are_caught(edit):
    r = report_of(exported()["revolute"])
    e = r.s.rows["tilt_y"]
    (symbol,) = e.free_symbols
    z, x = r.s.record.dots[symbol]
    dot = r.s.record.dot
    change = {"-": -e, "2": 2 * e, "other axis": dot(z, Base("y", "l")), "other body": dot(Base("z", "l"), x)}
    r.s.rows["tilt_y"] = se.sympify(change[edit])
    assert checked(r)
