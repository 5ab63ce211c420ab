"""Force laws, one per file."""

from mbdae.laws.forces.applied import AppliedForce, AppliedTorque
from mbdae.laws.forces.bushing import Bushing
from mbdae.laws.forces.gravity import Gravity
from mbdae.laws.forces.joint_drive import JointForce, JointTorque
from mbdae.laws.forces.joint_spring import JointDamper, JointSpring
from mbdae.laws.forces.point_spring import PointSpring
from mbdae.laws.forces.rotational_bushing import RotationalBushing
from mbdae.laws.forces.slide_friction import SlideFriction

__all__ = [
    "AppliedForce", "AppliedTorque", "Bushing", "Gravity", "JointDamper", "JointForce", "JointSpring", "JointTorque",
    "PointSpring", "RotationalBushing", "SlideFriction",
]  # fmt: skip
