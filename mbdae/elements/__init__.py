"""Element laws (bodies), one per file."""

from mbdae.elements.beam_node import BeamNode
from mbdae.elements.joint_coordinate import JointCoordinate
from mbdae.elements.point_mass import PointMass
from mbdae.elements.rigid_body import RigidBody

__all__ = ["BeamNode", "JointCoordinate", "PointMass", "RigidBody"]
