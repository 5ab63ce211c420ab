"""Methods side by side on one scene: errors against a confirmed reference, CPU time and evaluations."""

from mbdae.compare.comparison import compare
from mbdae.compare.page import Comparison
from mbdae.compare.run import Run
from mbdae.compare.table import Row

__all__ = ["Comparison", "Row", "Run", "compare"]
