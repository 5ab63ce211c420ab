"""Wrong statements about beams are refused before solving: all at once, each with its item, option, value and a next step."""

# ruff: noqa: E501
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import mbdae as mb

ROUND = mb.Section.circular(0.02, 210e9, 0.3, 7850)


def beam(s: mb.Scene, name: str = "c", *points: Any, **options: Any) -> Any:
    given = points or (() if callable(options.get("curve")) else ((0, 1), (2, 1)))
    return s.beam(name, *given, **{"section": ROUND, **options})


def scene(space: str = "auto") -> mb.Scene:
    s = mb.Scene("beams", gravity=(0, -9.81, 0), space=space)
    s.beam("b", (0, 0), (1, 0), section=ROUND, elements=2)
    return s


def problems(s: mb.Scene) -> list[str]:
    with pytest.raises(mb.SceneError) as caught:
        s.check()
    return caught.value.problems


def broken(s: float) -> Any:
    raise ZeroDivisionError("no value")


@pytest.mark.parametrize(
    ("say", "finding"),
    [
        (lambda s: beam(s, section="IPE 80"), "beam 'c': section = 'IPE 80' is no cross-section; give mb.Section(...)"),
        (lambda s: beam(s, section=mb.Section(math.inf, 1, 1, 1, 1, 1, 1, 1)), "beam 'c': section.EA is infinite, and a beam needs finite stiffnesses"),
        (lambda s: beam(s, elements=0), "beam 'c': elements = 0 is not between 1 and 100000; give a whole number from 1"),
        (lambda s: beam(s, elements=2.5), "beam 'c': elements = 2.5 is not a whole number; give a whole number from 1"),
        (lambda s: beam(s, elements=(2, 2)), "beam 'c': elements = (2, 2): the beam has 1 segment; give an integer of at least 1"),
        (lambda s: beam(s, "c", (0, 1), (1, 1), (1, 2), elements=1), "beam 'c': elements = 1: the beam has 2 segments; give an integer of at least 2, or a list of 2, one positive integer for every segment"),
        (lambda s: beam(s, "c", (0, 1), (1, 1), (1, 2), elements=(2, -1)), "beam 'c': elements = (2, -1): -1 is not between 1 and 100000"),
        (lambda s: beam(s, order=5), "beam 'c': order = 5 is not between 1 and 4; give a whole number from 1 to 4"),
        (lambda s: beam(s, order=2.5), "beam 'c': order = 2.5 is not a whole number; give a whole number from 1 to 4"),
        (lambda s: beam(s, "c", (0, 1), (0, 1)), "beam 'c': needs at least two points, each different from the one before"),
        (lambda s: beam(s, "c", (0, 1)), "beam 'c': needs at least two points"),
        (lambda s: beam(s, "c", (0, 1), (0, 1, 2, 3)), "'c': point 2 = (0, 1, 2, 3) has shape (4,); give 2 or 3 numbers, m"),
        (lambda s: beam(s, axis2=(1, 0, 0)), "beam 'c': axis2 = [1.0, 0.0, 0.0] is parallel to the beam somewhere: give a direction across it"),
        (lambda s: beam(s, axis2=(0, 0, 0)), "beam 'c': axis2 = [0.0, 0.0, 0.0] has length zero; give a direction"),
        (lambda s: beam(s, velocity=(1, math.nan)), "'c': velocity = (1, nan) has a wrong entry, nan is not finite"),
        (lambda s: beam(s, "b"), "two items have the name 'b'; give each its own"),
        (lambda s: beam(s, curve="spline"), "beam 'c': curve = 'spline' is no curve; give 'arc' and three points, or a function of a parameter from 0 to 1"),
        (lambda s: beam(s, "c", (0, 1), (1, 1), (2, 1), curve="arc"), "beam 'c': the three points of an arc lie on a straight line: give a point off it, or a straight beam"),
        (lambda s: beam(s, "c", (0, 1), (1, 1), curve=lambda x: (x, x)), "with 2 points; leave the points out, the curve gives them all"),
        (lambda s: beam(s, curve=broken), "fails at the parameter 0 (ZeroDivisionError: no value); give a function of a parameter from 0 to 1 that returns 2 or 3 coordinates, m"),
        (lambda s: beam(s, curve=lambda x: x), "'c': curve(0) = np.float64(0.0) is no list; give 2 or 3 numbers, m"),
        (lambda s: beam(s, curve=lambda x: (1.0, 2.0)), "returns the same point at the parameters 0 and 0.015625; give a function that moves on"),
        (lambda s: beam(s, curve=lambda x: (x, x), elements=0), "beam 'c': elements = 0 is not between 1"),
        (lambda s: s["b"].load((0, 1), frame="body"), "load 'load on b': frame = 'body' is unknown; use 'inertial' or 'section'"),
        (lambda s: s["b"].load(5.0), "load 'load on b': per_length = 5.0 is no list; give 2 or 3 components, numbers or expressions of mb.t, N/m"),
        (lambda s: s["b"].load((1, 2, 3, 4)), "load 'load on b': per_length = (1, 2, 3, 4) has shape (4,); give 2 or 3 components"),
        (lambda s: s["b"].load((0, "w")), "'load on b': per_length[1] = 'w' is neither a number nor an expression of mb.t"),
        (lambda s: s.line_load("F", s.link("r", (0, 1), (1, 1), mass=1), (0, 1)), "load 'F': beam = 'r' is not a beam of this scene; give a beam, or use s.force for a rigid body"),
        (lambda s: s.line_load("F", "d", (0, 1)), "load 'F': beam = 'd' is no body of this scene"),
        (lambda s: s.revolute("R", s.ground, "b", at=(0.5001, 0)), "revolute 'R': its place [0.5001, 0.0, 0.0] m on beam 'b' is 0.0001 m from a node and would leave an element as short as that: attach at the node, [0.5, 0.0, 0.0] m, or move it away from there"),
        (lambda s: s.force("F", s["b"].at(0.99999), (0, 1)), "force 'F': its place [0.99999, 0.0, 0.0] m on beam 'b' is 1e-05 m from a node"),
    ],
)
def test_statement(say: Callable[[mb.Scene], Any], finding: str) -> None:
    s = scene()
    say(s)
    found = problems(s)
    assert len(found) == 1, found
    assert finding in found[0]


@pytest.mark.parametrize(
    ("make", "finding"),
    [
        (lambda: mb.Section(1, 1, 1, 1, -2, 0, 1, 1), "section: EI2 = -2 N m^2 is not positive, EI3 = 0 N m^2 is not positive: give positive numbers"),
        (lambda: mb.Section(1, 1, 1, 1, 1, 1, 0, -1), "section: mass_per_length = 0 kg/m is not positive, rotary_inertia[0] = -2 kg m is not positive, rotary_inertia[1] = -1 kg m"),
        (lambda: mb.Section.circular(-0.1, 1, 0.3, 1), "section: radius = -0.1 m is not positive: give positive numbers"),
        (lambda: mb.Section.circular(0.1, 1, 0.3, 1, damping=-1), "section: damping = -1 s is not 0 or more: give 0 or more; a negative one would feed energy"),
    ],
)
def test_section(make: Callable[[], Any], finding: str) -> None:
    with pytest.raises(mb.OptionError) as caught:
        make()
    assert finding in str(caught.value)


def test_all_problems_at_once() -> None:
    s = scene()
    c = beam(s, section=None, elements=-1, order=5, axis2=(2, 0), velocity=(1, 2, 3, 4))
    s.revolute("R", "b", c, at=(0.4999, 0), axis=(0, 0, 0))
    c.load((0, 1 / mb.t), frame="body")
    found = problems(s)
    expected = ("section = None", "elements = -1", "order = 5", "axis2 = [2.0, 0.0, 0.0]", "velocity = (1, 2, 3, 4) has shape (4,)", "axis = [0.0, 0.0, 0.0]",
                "0.0001 m from a node", "frame = 'body'", "f2 = t**(-1)")
    for words in expected:
        assert [p for p in found if words in p], words
    assert len(found) == len(expected)


def test_attachments_at_nodes_and_apart_from_them_are_accepted() -> None:
    s = scene()
    for i, x in enumerate((0.0, 0.25, 0.5, 0.3, 1.0, 0.3)):
        s.spring(f"S{i}", s.ground, "b", at_k=(x, 1), at_l=(x, 0), stiffness=1.0)
    s.spring("arm", s.ground, "b", at_k=(0.3, 1), at_l=(0.3, 0.2), stiffness=1.0)
    assert s.check().degrees_of_freedom == 3 * len(s.check().prepared.model.nodes)
    assert np.any(np.isclose(s.check().prepared.model.lines[0].mesh.positions[:, 0], 0.3))


def test_neighbouring_nodes_must_not_be_turned_by_half_a_turn() -> None:
    """A full circle in one element is ambiguous; in four it is not. A line that folds back has no rotation there."""
    def circle(s: float) -> tuple[float, float]:
        return math.cos(2 * math.pi * s), math.sin(2 * math.pi * s)

    for elements, order, found in ((1, 1, True), (1, 2, True), (4, 2, False)):
        s = mb.Scene("ring")
        s.beam("ring", section=ROUND, elements=elements, order=order, curve=circle)
        assert any("elements = 1: the curve turns by " in p and "give more elements" in p for p in s.problems) == found
    s = mb.Scene("folded")
    s.beam("hairpin", (0, 0), (1, 0), (0.2, 0), section=ROUND, elements=4)
    assert len(s.problems) == 1
    assert "'hairpin': points: the line turns back by 180 deg at (1, 0, 0) m" in s.problems[0]
