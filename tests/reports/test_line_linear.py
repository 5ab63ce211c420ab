"""The linearised strains of a beam, their value at rest included."""

from __future__ import annotations

import mbdae as mb
from mbdae.reports import line_page


def test_linearised_strains_begin_with_their_value_at_rest() -> None:
    text = mb.report("beam").to_markdown()
    assert r"\gamma_{N1} \approx 1 + u_1'" in text
    assert r"\gamma_{N2} \approx u_2'" in text
    assert "NOT EQUAL" not in text


def test_a_value_at_rest_that_is_missing_is_told(monkeypatch) -> None:
    monkeypatch.setattr(line_page, "_straight", lambda base: 0 * line_page.np.eye(3)[0] if base.kind == "rs" else STRAIGHT(base))
    assert "NOT EQUAL" in mb.report("beam").to_markdown()


STRAIGHT = line_page._straight
