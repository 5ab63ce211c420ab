"""Couplings of joint coordinates, one per file."""

from mbdae.laws.couplings.differential import Differential
from mbdae.laws.couplings.gear import Gear
from mbdae.laws.couplings.rack import Rack
from mbdae.laws.couplings.weighted_sum import WeightedSum

__all__ = ["Differential", "Gear", "Rack", "WeightedSum"]
