"""Joint laws, one per file. A new joint is a file here, an export line and a test of a physical fact."""

from mbdae.joints.classical import ClassicalRevolute
from mbdae.joints.classical_prismatic import ClassicalPrismatic
from mbdae.joints.clearance import ClearanceRevolute
from mbdae.joints.distance import Distance
from mbdae.joints.fixed_orientation import FixedOrientation
from mbdae.joints.friction import (
    RubbingClassicalPrismatic,
    RubbingClassicalRevolute,
    RubbingPrismatic,
    RubbingRevolute,
)
from mbdae.joints.prismatic import Prismatic
from mbdae.joints.revolute import Revolute
from mbdae.joints.spherical import Spherical
from mbdae.joints.weld import Weld

__all__ = [
    "ClassicalPrismatic", "ClassicalRevolute", "ClearanceRevolute", "Distance", "FixedOrientation", "Prismatic", "Revolute",
    "RubbingClassicalPrismatic", "RubbingClassicalRevolute", "RubbingPrismatic", "RubbingRevolute", "Spherical", "Weld",
]  # fmt: skip
