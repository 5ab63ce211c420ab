"""Published formulas compared with their derivation: notation, meanings, rules, search of the smallest repair, verdicts."""

from mbdae.audit.meaning import wordings
from mbdae.audit.notation import AuditError
from mbdae.audit.page import Audit, audit

__all__ = ["Audit", "AuditError", "audit", "wordings"]
