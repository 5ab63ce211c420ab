"""Published formulas compared with their derivation: notation, meanings, rules, search of the smallest repair, verdicts."""

from mbdae.reports.audit.meaning import wordings
from mbdae.reports.audit.notation import AuditError
from mbdae.reports.audit.page import Audit, audit, audit_paper

__all__ = ["Audit", "AuditError", "audit", "audit_paper", "wordings"]
