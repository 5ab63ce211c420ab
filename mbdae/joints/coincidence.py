"""Rows several joints share."""

from __future__ import annotations

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.vectors import Expr


def same_point(k: Frame, l: Frame) -> dict[str, Expr]:
    """The points of k and l coincide; rows in inertial axes, multipliers in N."""
    d = l.r - k.r
    return {"x": d[0], "y": d[1], "z": d[2]}


def same_axis(k: Frame, l: Frame) -> dict[str, Expr]:
    """l turns about k.z only (paper Eq. 1): the torques about k.y and k.x that keep the axes together, N m."""
    return {"tilt_y": k.z @ l.x, "tilt_x": k.z @ l.y}


def same_attitude(k: Frame, l: Frame) -> dict[str, Expr]:
    """l does not turn relative to k."""
    return {**same_axis(k, l), "twist": k.x @ l.y}


def upright(k: Frame, l: Frame) -> dict[str, Expr]:
    """Positive where l is not turned by half a turn, which `same_attitude` alone would admit."""
    return {"z axes in the same sense": k.z @ l.z, "x axes in the same sense": k.x @ l.x}
