"""Published formulas compared with their derivation: notation, meanings, rules, search of the smallest repair, verdicts."""

from mbdae.audit.notation import AuditError
from mbdae.audit.page import Audit, audit
from mbdae.audit.phrases import wordings

__all__ = ["Audit", "AuditError", "audit", "wordings"]
