"""What measures the claims beside it for `mbdae validate`: checks import from here what they state a claim with."""

from runner.claim import Case, Claim, Found, Row, measure
from runner.folder import Check, claims, load, module_of
from runner.pages import Measured, text, to_dict, verdict, write

__all__ = ["Case", "Check", "Claim", "Found", "Measured", "Row", "claims", "load", "measure", "module_of", "text", "to_dict",
           "verdict", "write"]  # fmt: skip
