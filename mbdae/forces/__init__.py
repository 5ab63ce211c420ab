"""Force laws, one per file."""

from mbdae.forces.applied import AppliedForce, AppliedTorque
from mbdae.forces.bushing import Bushing
from mbdae.forces.gravity import Gravity
from mbdae.forces.joint_drive import JointForce, JointTorque
from mbdae.forces.joint_spring import JointDamper, JointSpring
from mbdae.forces.point_spring import PointSpring
from mbdae.forces.rotational_bushing import RotationalBushing
from mbdae.forces.slide_friction import SlideFriction

__all__ = [
    "AppliedForce", "AppliedTorque", "Bushing", "Gravity", "JointDamper", "JointForce", "JointSpring", "JointTorque",
    "PointSpring", "RotationalBushing", "SlideFriction",
]  # fmt: skip
