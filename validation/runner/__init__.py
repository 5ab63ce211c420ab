"""What measures the claims beside it for `mbdae validate`: checks import from here what they state a claim with."""

from runner.claim import Case, Claim, Found, Row, measure
from runner.draw import Draw, Parts, allowed
from runner.folder import Check, claims, load, module_of
from runner.pages import Measured, text, to_dict, verdict, write
from runner.record import Record
from runner.session import Asked, measured

__all__ = ["Asked", "Case", "Check", "Claim", "Draw", "Found", "Measured", "Parts", "Record", "Row", "allowed", "claims", "load",
           "measure", "measured", "module_of", "text", "to_dict", "verdict", "write"]
