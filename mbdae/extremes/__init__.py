"""Limits of methods: a scene run by every method at extreme values of its parameters."""

from mbdae.extremes.extremes import Extremes, extremes

__all__ = ["Extremes", "extremes"]
