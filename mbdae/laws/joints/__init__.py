"""Joint laws, one per file. A new joint is a file here, an export line and a test of a physical fact."""

from mbdae.laws.joints.classical import ClassicalRevolute
from mbdae.laws.joints.classical_prismatic import ClassicalPrismatic
from mbdae.laws.joints.clearance import ClearanceRevolute
from mbdae.laws.joints.distance import Distance
from mbdae.laws.joints.fixed_orientation import FixedOrientation
from mbdae.laws.joints.friction import (
    RubbingClassicalPrismatic,
    RubbingClassicalRevolute,
    RubbingPrismatic,
    RubbingRevolute,
)
from mbdae.laws.joints.prismatic import Prismatic
from mbdae.laws.joints.revolute import Revolute
from mbdae.laws.joints.spherical import Spherical
from mbdae.laws.joints.weld import Weld

__all__ = [
    "ClassicalPrismatic", "ClassicalRevolute", "ClearanceRevolute", "Distance", "FixedOrientation", "Prismatic", "Revolute",
    "RubbingClassicalPrismatic", "RubbingClassicalRevolute", "RubbingPrismatic", "RubbingRevolute", "Spherical", "Weld",
]  # fmt: skip
