"""A mechanism that is quiet and then kicked: by a force that is switched on and off, by a bell of a torque, by a motion.

Nothing happens for long, so that steps become long; what happens then is over within a part of the run, down to a millionth.
"""

import sympy as sp

import mbdae as mb

BEGIN, WIDTH = 0.5, 0.05  # s
FORCE, TORQUE, ANGLE = 20.0, 5.0, 1e-3  # N, N m, rad

t_end = 2.0  # s
accuracy = 1e-6
widths = (2e-6, 2.0)  # s, of the run a millionth to the whole
vary = {
    "kick.width": widths,
    "kick.begin": [1e-3, 0.1, 1.0, 1.94, 1.9999],
    "kick.strength": (1e-4, 1e2),
    "scene(bell=1).kick.width": widths,
    "scene(bump=1).A.width": widths,
    "scene(bump=1).A.strength": (1e-6, 1.0),
    "scene(rate=1).kick.width": widths,
    "accuracy": [1e-3, 1e-8],
    "step": [1e-1, 3e-2],
}


def scene(bell=0, bump=0, rate=0.0):
    """A four-bar with a link that hangs from its coupler, without gravity. bell: the kick is a torque on the crank, smooth at
    every time; bump: the crank is held, and then moved there and back; otherwise a force on the coupler. rate: of the crank
    at the start, rad/s, at which it coasts."""
    s = mb.Scene("quiet, then kicked")
    crank = s.link("crank", (0, 0), (0, 0.3), mass=0.3)
    coupler = s.link("coupler", (0, 0.3), (0.5, 0.6), mass=0.6)
    rocker = s.link("rocker", (0.5, 0.6), (0.6, 0), mass=0.5)
    arm = s.link("arm", (0.25, 0.45), (0.25, 0.1), mass=0.2)
    x = (mb.t - BEGIN) / WIDTH
    there_and_back = sp.Piecewise((0, mb.t < BEGIN), (ANGLE * (4 * x * (1 - x)) ** 3, mb.t < BEGIN + WIDTH), (0, True))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=there_and_back if bump else None, rate0=None if bump else rate)
    s.revolute("B", crank, coupler, at=(0, 0.3))
    s.revolute("C", coupler, rocker, at=(0.5, 0.6))
    s.revolute("D", s.ground, rocker, at=(0.6, 0))
    s.revolute("E", coupler, arm, at=(0.25, 0.45))
    if bell:
        s.torque("kick", crank, (0, 0, TORQUE * sp.exp(-((10 * x - 5) ** 2))))
    elif not bump:
        s.force("kick", coupler, (sp.Piecewise((0, mb.t < BEGIN), (FORCE, mb.t < BEGIN + WIDTH), (0, True)), 0, 0))
    return s
