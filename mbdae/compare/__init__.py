"""Methods side by side on one scene: errors against a confirmed reference, CPU time and evaluations; sweeps of any job."""

from mbdae.compare.comparison import Comparison, compare
from mbdae.compare.extremes import extremes
from mbdae.compare.extremes_map import Extremes
from mbdae.compare.rows import Row
from mbdae.compare.run import Run
from mbdae.compare.sweep import Sweep, SweepRow, sweep

__all__ = ["Comparison", "Extremes", "Row", "Run", "Sweep", "SweepRow", "compare", "extremes", "sweep"]
