"""Claims a checkout proves: problems with references in validation/, measured by `mbdae validate`."""

from mbdae.validation.claim import Case, Claim, Found, Row, measure
from mbdae.validation.folder import Check, claims, find, load
from mbdae.validation.pages import Measured, text, to_dict, verdict, write

__all__ = ["Case", "Check", "Claim", "Found", "Measured", "Row", "claims", "find", "load", "measure", "text", "to_dict",
           "verdict", "write"]  # fmt: skip
