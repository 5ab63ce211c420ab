"""Friction laws, one per file. A new one is a file here, an export line and a test of a physical fact."""

from mbdae.friction.base import Friction
from mbdae.friction.coulomb import Coulomb
from mbdae.friction.lugre import LuGre

__all__ = ["Coulomb", "Friction", "LuGre"]
