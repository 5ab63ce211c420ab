"""Analyses of a scene: static and relative equilibrium, linearisation about steady and periodic motions, branches of these."""

from mbdae.analysis.continuation import Branch, Located, continuation
from mbdae.analysis.equilibrium import Equilibrium, equilibrium
from mbdae.analysis.linearization import Linearization, linearize
from mbdae.analysis.multipliers import Floquet, floquet
from mbdae.analysis.periodic import Periodic, periodic
from mbdae.analysis.shapes import Mode

__all__ = ["Branch", "Equilibrium", "Floquet", "Linearization", "Located", "Mode", "Periodic", "continuation", "equilibrium",
           "floquet", "linearize", "periodic"]
