"""Placeholder."""
from __future__ import annotations
from typing import Any
from mbdae.reports.document import Document
def scene_sheet(scene: Any) -> Document:
    """Nothing yet."""
    return Document("scene")
