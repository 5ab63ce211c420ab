"""An element of a beam on paper: read back in elements of every order beside the compiled kernel, and facts of the print."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.documents.blocks import Equation, every, numbered
from mbdae.laws.beam import mass_points, node_positions
from mbdae.reports import line_element, page
from mbdae.reports.states import interpolation
from mbdae.system.prepare import prepare

sys.path.insert(0, str(Path(__file__).parent))

from reading import holds_and_defines
from test_edits import KINDS, edited


@pytest.mark.parametrize(("name", "options"), [("beam", {}), ("lineload", {}), ("lineload", {"following": True})])
def test_an_element_holds(name, options):
    for level in ("full", "lecture"):
        document = mb.report(name, level=level, **options)
        holds_and_defines(document, name)
        text = document.to_markdown()
        assert "## The element" in text
        assert ("## Tangent of the element" in text) == (name == "beam" and level == "full")
    assert r"\mathbf{f}_i = \sum_g w\,L_i'\,\mathbf{n}" in text or name == "lineload"
    assert r"\mathbf{f}_{i,\text{load}} = -\sum_g w\,L_i\,\left(" in text or name == "beam"


def test_the_page_interpolates_by_polynomials_of_its_own():
    for order in (1, 2, 3, 4):
        weights, L, slopes = interpolation(order, order + 1)
        at, nodes = mass_points(order), node_positions(order)
        for power in range(order + 1):  # polynomials up to the order are exact
            np.testing.assert_allclose(L @ nodes**power, at.xi**power, atol=1e-13)
            np.testing.assert_allclose(slopes @ nodes**power, power * at.xi ** max(power - 1, 0), atol=1e-12)
        for power in range(2 * order + 2):
            np.testing.assert_allclose(weights @ at.xi**power, 1 / (power + 1), rtol=1e-13)


def lines(kind):
    """Of every section of the element the first equation in which an edit is possible, with the edited line."""
    pattern, place = KINDS[kind]
    for section in mb.report("beam").blocks:
        if getattr(section, "title", "").startswith(("The element", "Tangent of the element")):
            for e in every(Equation, [section]):
                if (at := re.search(pattern, e.latex)) and r"\hat" not in e.latex:
                    rest = re.sub(pattern, place, at[0]) + e.latex[at.end() :] if kind != "a dropped term" else ""
                    yield e.number, e.latex[: at.start()] + rest
                    break


@pytest.mark.parametrize("kind", [*KINDS])
def test_a_single_edit_of_the_print_of_an_element_is_told(kind, monkeypatch):
    found = [*lines(kind)]
    if not found:
        pytest.skip("no such place in an element")
    number, line = found[list(KINDS).index(kind) % len(found)]
    monkeypatch.setattr(page, "numbered", lambda blocks: edited(numbered(blocks), number, line))
    assert "NOT EQUAL" in mb.report("beam").to_markdown(), f"{kind}: ({number}) {line}"


@pytest.mark.slow
def test_edits_of_every_section_of_an_element_are_told(monkeypatch):
    missed = []
    for kind in KINDS:
        for number, line in lines(kind):
            with monkeypatch.context() as patch:
                patch.setattr(page, "numbered", lambda blocks, n=number, line=line: edited(numbered(blocks), n, line))
                missed += [] if "NOT EQUAL" in mb.report("beam").to_markdown() else [f"{kind}: ({number}) {line}"]
    assert missed == []


def test_a_motion_that_is_not_rigid_is_told(monkeypatch):
    """Rows after a motion of the nodes that stretches them differ: the line on objectivity can fail."""
    plain = line_element.columns
    monkeypatch.setattr(line_element, "columns", lambda P: plain(P) * (1.0 + 1e-6 * (len(P) == 20)))
    assert re.search(r"NOT EQUAL: \(\d+\) both sides", mb.report("beam").to_markdown())


@pytest.mark.slow
def test_laws_and_scenes_of_reduced_bodies_are_reported():
    """Masses in space on springs: the modes, their elasticity, the interfaces and the points of inertia, each read back."""
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1]])
    K = np.zeros((18, 18))
    for i in range(6):
        for j in range(i):
            e = (nodes[i] - nodes[j]) / np.linalg.norm(nodes[i] - nodes[j])
            g = np.zeros(18)
            g[3 * i : 3 * i + 3], g[3 * j : 3 * j + 3] = e, -e
            K += 1e5 * np.outer(g, g)
    frame = mb.ReducedBody.craig_bampton(np.eye(18), K, nodes, interfaces={"foot": [0, 1, 2]}, modes=1)
    s = mb.Scene("frame on a hinge", gravity=(0, -9.81, 0))
    s.reduced_body("frame", frame, at=(0, 0, 0), damping=0.01)
    s.revolute("hinge", s.ground, "frame.foot", at=(0, 0, 0))
    laws = {type(group.instances[0].law).__name__: group.instances[0].law for group in prepare(s).model.groups}
    assert {"InterfaceOfBody", "InertiaPoint", "ModalElasticity"} <= laws.keys()
    for name, law in laws.items():
        holds_and_defines(mb.report(law), name)
    text = mb.report(s).to_markdown()
    assert "frame.foot" in text
    assert "NOT EQUAL" not in text
