"""Scenes with one contact: a ball in a round hole."""

from __future__ import annotations

from typing import Any

import numpy as np

import mbdae as mb


def ball(v0: float, law: Any, play: float = 1e-3, friction: Any = None) -> mb.Scene:
    """A mass point (1 kg) that flies with v0 (m/s) from the centre of a hole against its wall, `play` m away."""
    s = mb.Scene("ball in a hole")
    m = s.point_mass("m", 1.0, (0, 0), velocity=(v0, 0))
    s.revolute("J", s.ground, m, at=(0, 0), model=mb.Clearance(outer=0.05 + play, inner=0.05, normal=law, friction=friction))
    return s


def grazing(depth: float, stiffness: float, phase: float) -> mb.Scene:
    """An oscillator of amplitude 1 m and 1 rad/s between walls at 1 - depth; it starts at sin(phase)."""
    s = mb.Scene("grazing oscillator", space="planar")
    x, v = float(np.sin(phase)), float(np.cos(phase))
    m = s.point_mass("m", 1.0, (x, 0), velocity=(v, 0))
    s.spring("spring", s.ground, m, at_k=(0, 0), at_l=(x, 0), stiffness=1.0, length=0.0)
    s.revolute("J", s.ground, m, at=(0, 0), model=mb.Clearance(outer=1.1 - depth, inner=0.1, normal=mb.Hertz(stiffness)))
    return s
