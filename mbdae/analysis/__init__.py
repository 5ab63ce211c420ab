"""Analyses of a scene: static and relative equilibrium, linearisation about steady motions."""

from mbdae.analysis.equilibrium import Equilibrium, equilibrium
from mbdae.analysis.linearization import Linearization, Mode, linearize

__all__ = ["Equilibrium", "Linearization", "Mode", "equilibrium", "linearize"]
