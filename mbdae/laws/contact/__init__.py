"""Contact laws, one per file: normal laws, and the pairs of surfaces that use them."""

from mbdae.laws.contact.ball_on_ball import BallOnBall
from mbdae.laws.contact.ball_on_cylinder import BallOnCylinder
from mbdae.laws.contact.ball_on_plane import BallOnPlane
from mbdae.laws.contact.base import Contact
from mbdae.laws.contact.cylinder_on_plane import CylinderOnPlane
from mbdae.laws.contact.hertz import Hertz
from mbdae.laws.contact.journal import JournalContact
from mbdae.laws.contact.normal import Normal

__all__ = ["BallOnBall", "BallOnCylinder", "BallOnPlane", "Contact", "CylinderOnPlane", "Hertz", "JournalContact", "Normal"]
