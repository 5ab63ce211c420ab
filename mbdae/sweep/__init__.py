"""Sweeps: one job at every point of a grid, in processes, in a cluster or in any executor."""

from mbdae.study.kept import SweepRow
from mbdae.sweep.sweep import Sweep, sweep

__all__ = ["Sweep", "SweepRow", "sweep"]
