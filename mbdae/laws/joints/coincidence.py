"""Rows of several joints."""

from __future__ import annotations

import symengine as se

from mbdae.symbolic.frames import Frame
from mbdae.symbolic.vectors import Expr


def same_point(k: Frame, l: Frame) -> dict[str, Expr]:
    """Rows that vanish where the points of k and l coincide, in inertial axes. Multipliers: minus the components of the force on
    l, N."""
    d = l.r - k.r
    return {"x": d[0], "y": d[1], "z": d[2]}


def same_axis(k: Frame, l: Frame) -> dict[str, Expr]:
    """Rows that let l turn about k.z only (paper Eq. 1). Multipliers: the torques about k.y and k.x that keep the axes parallel,
    N m."""
    return {"tilt_y": k.z @ l.x, "tilt_x": k.z @ l.y}


def turned_by(k: Frame, l: Frame, angle: Expr) -> Expr:
    """sin(angle - theta), theta the angle of l about k.z (paper Eqs. 10 and 12): zero where both agree, and half a turn off."""
    return k.x @ (l.x * se.sin(angle) + l.y * se.cos(angle))


def near_angle(k: Frame, l: Frame, angle: Expr) -> Expr:
    """cos(angle - theta): positive where theta is the angle, negative half a turn off, where `turned_by` vanishes too."""
    return k.x @ (l.x * se.cos(angle) - l.y * se.sin(angle))


def tied_angle(k: Frame, l: Frame, angle: Expr) -> tuple[Expr, Expr]:
    """The row that vanishes where l is turned about k.z by `angle`, and an expression that is positive there and negative half a
    turn off, where the row vanishes too."""
    return turned_by(k, l, angle), near_angle(k, l, angle)


def on_axis(k: Frame, l: Frame) -> dict[str, Expr]:
    """Rows that keep the point of l on the axis k.z. Multipliers: forces along k.x and k.y, N."""
    d = l.r - k.r
    return {"offset_x": k.x @ d, "offset_y": k.y @ d}


def same_attitude(k: Frame, l: Frame) -> dict[str, Expr]:
    """Rows that keep l from turning relative to k."""
    return {**same_axis(k, l), "twist": k.x @ l.y}


def upright(k: Frame, l: Frame) -> dict[str, Expr]:
    """Expressions that are positive where l has the attitude of k; one is negative half a turn off, where the rows of
    `same_attitude` vanish too."""
    return {"z axes in the same sense": k.z @ l.z, "x axes in the same sense": k.x @ l.x}
