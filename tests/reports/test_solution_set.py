"""What a report says of the solutions of rows, and why there are none."""

from __future__ import annotations

import pytest

import mbdae as mb


class Never(mb.Joint):
    """A cosine that would have to be 2."""

    def constraints(self, k, l):
        return {"x": (l.r - k.r) @ k.x, "far": k.x @ l.x - 2}


@pytest.mark.parametrize(("law", "rows"), [
    (mb.Universal, "rows drive angle k, drive angle l contain"), (mb.Screw, "row drive contains")])
def test_rows_of_coordinates_that_are_unknowns_are_told_apart(law, rows):
    text = mb.report(law, kept=True).to_markdown()
    assert "60 reached a solution. There the 6 rows that depend on the motion of l have rank 6" in text
    assert f"The {rows} no motion of l but coordinates that are unknowns" in text


def test_rows_without_solution_are_named_with_the_reason():
    text = mb.report(Never).to_markdown()
    assert "were the rows solved by moving l alone: nowhere does far vanish" in text
