"""Where methods break: a scene run every way at the extremes of its parameters."""

from mbdae.extremes.extremes import extremes
from mbdae.extremes.map import Extremes

__all__ = ["Extremes", "extremes"]
