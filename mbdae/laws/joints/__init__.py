"""Joint laws, one per file. A new joint is a file here, an export line and a test of a physical fact."""

from mbdae.laws.joints.clearance import ClearanceRevolute
from mbdae.laws.joints.cylindrical import Cylindrical
from mbdae.laws.joints.distance import Distance
from mbdae.laws.joints.fixed_orientation import FixedOrientation
from mbdae.laws.joints.free import Free
from mbdae.laws.joints.planar import Planar
from mbdae.laws.joints.point_on_line import PointOnLine
from mbdae.laws.joints.point_on_plane import PointOnPlane
from mbdae.laws.joints.prismatic import Prismatic
from mbdae.laws.joints.revolute import Revolute
from mbdae.laws.joints.screw import Screw
from mbdae.laws.joints.spherical import Spherical
from mbdae.laws.joints.universal import Universal
from mbdae.laws.joints.weld import Weld

__all__ = [
    "ClearanceRevolute", "Cylindrical", "Distance", "FixedOrientation", "Free", "Planar", "PointOnLine", "PointOnPlane",
    "Prismatic", "Revolute", "Screw", "Spherical", "Universal", "Weld",
]  # fmt: skip
