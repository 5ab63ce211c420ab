"""Where methods break: a scene run every way at the extremes of its parameters."""

from mbdae.extremes.extremes import Extremes, extremes

__all__ = ["Extremes", "extremes"]
