"""Element laws (bodies), one per file."""

from mbdae.laws.elements.beam_node import BeamNode
from mbdae.laws.elements.joint_coordinate import JointCoordinate
from mbdae.laws.elements.point_mass import PointMass
from mbdae.laws.elements.rigid_body import RigidBody

__all__ = ["BeamNode", "JointCoordinate", "PointMass", "RigidBody"]
