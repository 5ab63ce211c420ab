"""All meanings a symbol of a text may have: the phrases of motion, joints, contact and friction."""

from __future__ import annotations

import re

from mbdae.audit import rules_contact, rules_friction, rules_joints, rules_line, rules_motion
from mbdae.audit.phrases import PHRASES, understand

RULES = (rules_motion, rules_joints, rules_contact, rules_friction, rules_line)  #: the modules whose import registers the phrases
__all__ = ["understand", "wordings"]


def wordings() -> list[str]:
    """The wordings a meaning may have; {side} is k or l, {i} a figure, the rest names or lists."""
    return sorted(re.sub(r"\d+\}", "}", p.wording) for p in PHRASES)
