"""Where the CPU of a row goes, what the front claims, and what the uncertainty of a reference is."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

import mbdae as mb
from mbdae.compare.measures import Reference
from mbdae.compare.page import own_look
from mbdae.compare.problem import _of_the_nearest
from mbdae.compare.table import Row, with_front
from mbdae.process import cold, made_once, measured, spends

PARTS = ("derive_s", "compile_s", "start_s", "companions_s", "judgement_s")


def four_bar():
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    a, b = s.link("crank", (0, 0), (0, 0.5), mass=1.0), s.link("coupler", (0, 0.5), (1.2, 0.9), mass=1.5)
    c = s.link("rocker", (1.2, 0.9), (1.2, 0), mass=1.2)
    s.revolute("A", s.ground, a, at=(0, 0), rate0=4.0)
    s.revolute("B", a, b, at=(0, 0.5))
    s.revolute("C", b, c, at=(1.2, 0.9))
    s.revolute("D", s.ground, c, at=(1.2, 0))
    return s


def test_every_row_of_a_scene_is_split():
    """By index 3, GGL, index 1 and recursive joints; a form costs the same at every accuracy, because it is made once."""
    runs = [mb.Run(mb.RadauIIA(3), form) for form in (mb.Index3(), mb.GGL(), mb.Index1())]
    runs += [mb.Run(mb.RadauIIA(3), model=mb.Recursive()), mb.Run(mb.HHT(step=1e-2))]
    w = mb.compare(four_bar(), 0.3, runs, [1e-3, 1e-4])
    for row in w.runs:
        parts = [getattr(row, name) for name in PARTS]
        assert (parts[3] is None) == (row.solver == "HHT")  # constant steps have no companion
        assert all(part > 0 for part in parts if part is not None)
    assert {row.derive_s for row in w.runs if row.label.endswith("Index1")} == {w.runs[4].derive_s}
    lines = w.table(all_columns=True).splitlines()
    head = next(line for line in lines if line.startswith("run"))
    assert all(name in head for name in ("derive", "compile", "start", "compan.", "judge"))


def test_a_system_has_no_scene_to_be_made():
    w = mb.compare(four_bar().system("ggl"), 0.1, [mb.RadauIIA(3)], [1e-3])
    assert all(getattr(w.runs[0], name) is None for name in PARTS)


CLOCK = [0]  #: s, in place of that of the processor


@made_once("inner", 8)
def inner(x):
    CLOCK[0] += 20
    return object()


@spends("outer")
def outer():
    CLOCK[0] += 3
    return inner(1)


def test_kinds_are_told_apart_and_a_cold_measurement_changes_nothing(monkeypatch):
    monkeypatch.setattr("mbdae.process.time", SimpleNamespace(process_time=lambda: CLOCK[0]))
    first = inner(1)
    with cold(), measured() as spent:
        CLOCK[0] += 100
        again = outer()
        assert outer() is again is not first
    assert spent == {"inner": 20, "outer": 6, "other": 100}
    assert inner(1) is first


def test_errors_within_the_uncertainty_are_not_on_the_front():
    rows = [Row("a", "A", "GGL", None, 1e-3, error=e, cpu_s=c) for e, c in ((1e-4, 1.0), (1e-6, 2.0), (1e-9, 3.0), (1e-5, 2.5))]
    assert [row.pareto for row in with_front(rows, 0.0)] == [True, True, True, False]
    assert [row.pareto for row in with_front(rows, 1e-6)] == [True, False, False, False]


def test_the_uncertainty_is_of_the_nearer_pair():
    """A reference that no other method confirms is replaced where two others agree with each other."""

    class Apart:
        def error(self, a, b):
            return abs(a - b)

        def errors(self, a, b):
            return {"motion": abs(a[0] - b[0])}

    made = [("radau", 1, 0.1, [1.0]), ("ida", 2, 0.2, [1.5]), ("radau2", 3, 0.3, [1.51])]
    found, values = _of_the_nearest(Apart(), Reference("radau", 1e-8, None, None), made)
    assert (found.label, found.confirmed_by, values) == ("ida", "radau2", [1.5])
    assert found.difference == pytest.approx(0.01)
    assert not found.trusted
    near, values = _of_the_nearest(Apart(), Reference("radau", 1e-8, None, None), [*made[:2], ("radau2", 3, 0.3, [1.001])])
    assert (near.label, near.accuracy, near.confirmed_by, values) == ("radau", 1e-8, "radau2", [1.0])


def test_no_two_methods_share_a_colour_or_a_marker():
    looks = [own_look(i) for i in range(14)]
    assert len({look["color"] for look, _ in looks}) == len({marker for _, marker in looks}) == 14
    assert len({(look["color"], marker) for look, marker in map(own_look, range(60))}) == 60
