"""Published formulas compared with their derivation: notation, meanings, rules, search of the smallest repair, verdicts."""

from mbdae.audit.meaning import wordings
from mbdae.audit.notation import AuditError
from mbdae.audit.page import Audit, audit, audit_paper

__all__ = ["Audit", "AuditError", "audit", "audit_paper", "wordings"]
