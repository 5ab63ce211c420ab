"""Friction laws, one per file. A new one is a file here, an export line and a test of a physical fact."""

from mbdae.laws.friction.base import Friction
from mbdae.laws.friction.coulomb import Coulomb
from mbdae.laws.friction.lugre import LuGre

__all__ = ["Coulomb", "Friction", "LuGre"]
