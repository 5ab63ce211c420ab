"""Force laws, one per file."""

from mbdae.laws.forces.applied import AppliedForce, AppliedTorque
from mbdae.laws.forces.bushing import Bushing
from mbdae.laws.forces.gravity import Gravity
from mbdae.laws.forces.joint_damper import JointDamper
from mbdae.laws.forces.joint_friction import JointFriction
from mbdae.laws.forces.joint_load import JointLoad
from mbdae.laws.forces.joint_spring import JointSpring
from mbdae.laws.forces.joint_stop import JointStop
from mbdae.laws.forces.point_spring import PointSpring
from mbdae.laws.forces.rotational_bushing import RotationalBushing

__all__ = [
    "AppliedForce", "AppliedTorque", "Bushing", "Gravity", "JointDamper", "JointFriction", "JointLoad", "JointSpring",
    "JointStop", "PointSpring", "RotationalBushing",
]  # fmt: skip
