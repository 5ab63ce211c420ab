"""Analyses of a scene: static and relative equilibrium, linearisation about steady and periodic motions."""

from mbdae.analysis.equilibrium import Equilibrium, equilibrium
from mbdae.analysis.linearization import Linearization, linearize
from mbdae.analysis.multipliers import Floquet, floquet
from mbdae.analysis.periodic import Periodic, periodic
from mbdae.analysis.shapes import Mode

__all__ = ["Equilibrium", "Floquet", "Linearization", "Mode", "Periodic", "equilibrium", "floquet", "linearize", "periodic"]
