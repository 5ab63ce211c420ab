"""Limits of methods: a scene run by every method at extreme values of its parameters."""

from mbdae.extremes.extremes import extremes
from mbdae.extremes.page import Extremes

__all__ = ["Extremes", "extremes"]
