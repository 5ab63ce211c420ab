"""The joint as a recursive one: placeholder of the sections a joint with a twist has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbdae.reports.document import Section

if TYPE_CHECKING:
    from mbdae.reports.joint import JointReport


def recursive_sections(r: JointReport) -> list[Section]:
    """Nothing yet."""
    return []


def recursive_report() -> object:
    """Nothing yet."""
    raise NotImplementedError
