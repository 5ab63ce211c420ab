"""Methods side by side on one scene: errors against a confirmed reference, CPU time and evaluations."""

from mbdae.compare.comparison import Comparison, compare
from mbdae.compare.rows import Row
from mbdae.compare.run import Run

__all__ = ["Comparison", "Row", "Run", "compare"]
