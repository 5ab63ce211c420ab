"""A notebook, executed: every object shows itself as a picture or a table, once."""

from __future__ import annotations

from typing import Any

import pytest

SCENE = """
import mbdae as mb
s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
s.revolute("hinge", s.ground, rod, at=(0, 0))
s"""
#: cells, and what each shows
CELLS = [
    (SCENE, "picture and table"), ("s.check()", "table"), ("r = s.simulate(1.0)\nr", "table"), ("s.draw()", "picture"),
    ("r.plot('hinge.angle')", "picture"), ("r.phase('hinge.angle', 'hinge.rate')", "picture"),
    ("%matplotlib inline\nr.orbit('rod')", "picture"), ("r.animate(sensors=['hinge.angle'])", "page"),
    ("r.to_dataframe('hinge.angle')", "table"), ("mb.compare(s, 0.2, accuracies=(1e-3,))", "picture and table"),
    ("mb.extremes(s, 0.2, vary={'rod.mass': [1.0]}, runs=[mb.Run(solver=mb.RadauIIA(3))])", "table"),
    ("mb.export(s, format='c')", "table"), ("mb.report(mb.Revolute)", "page"),
]
MARKS = {"picture": ("<img", "image/png"), "table": ("<table", "<pre"), "page": ("<iframe",), "and": ("",)}


def run(cells: list[str]) -> Any:
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    nbclient.NotebookClient(book, timeout=120, kernel_name="python3").execute()
    return book


@pytest.fixture(scope="module")
def book() -> Any:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the client and its event loop
        return run([cell for cell, _ in CELLS])


@pytest.mark.parametrize("number", range(len(CELLS)))
def test_every_display_is_a_picture_or_a_table(number: int, book: Any) -> None:
    shown = [o for o in book.cells[number].outputs if o.output_type in ("execute_result", "display_data")]
    assert len(shown) == 1, f"{CELLS[number][0]} shows {len(shown)} outputs"
    data = shown[0].data
    text = " ".join(data) + "".join(data.get("text/html", ""))
    for what in CELLS[number][1].split():
        assert any(mark in text for mark in MARKS[what]), (CELLS[number][0], list(data))
    assert text.count("image/png") <= 1
    assert "\n" not in "".join(data["text/plain"]) or "dataframe" in CELLS[number][0]
