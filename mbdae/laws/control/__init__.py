"""Laws of control: states that are integrated with the motion, and values held between sampled instants."""

from mbdae.laws.control.held_output import HeldOutput
from mbdae.laws.control.internal_state import InternalState

__all__ = ["HeldOutput", "InternalState"]
