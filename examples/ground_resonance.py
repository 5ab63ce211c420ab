r"""Ground resonance: a rotor with lagging blades on an elastic support shakes itself to pieces.

Four rigid blades (uniform rods of length L and mass m) hang on lag hinges at the distance e from the centre of a hub,
which turns at the speed Omega on a block on springs and dampers. In the frame of the ground, with the position
r_h of the hub and the azimuth psi_i = Omega t + i pi/2 + zeta_i of blade i, the centre of mass of a blade is

    r_i = r_h + e (cos, sin)(Omega t + i pi/2) + L/2 (cos, sin)(psi_i),

and the lag angles zeta_i are coupled to the hub by the centrifugal forces alone. No spring holds the blades: they swing
as pendulums in the centrifugal field, at w = Omega sqrt(S e / I) = 5.94 rad/s with S = m L/2 and I = m L^2/3. Seen from
the ground, the regressive lag mode Omega - w comes close to the mode of the support, and the two feed on the rotation:
small motions grow as exp(2.10 t) with support along x and exp(2.64 t) with support along x and y.

Options: `axes` 1 or 2 of the support; `free` leaves the speed of a hub with inertia free instead of prescribing it;
`model` is the model of all joints, such as mb.Recursive(): the slides of the support carry the block, the block the hub and
the hub its blades, so that 6 (driven) or 7 coordinates of joints are all there is to solve for, without a constraint.

With `flexible=True` every blade is a beam of three cubic elements, as in
"Modified models for revolute joints coupling flexibility of links in multibody systems". This paper calls its bending stiffness
soft and gives no number; here it is 1e4 N m^2, a third more than the centrifugal force itself would give
(m Omega^2 L^2/12 = 7.7e3 N m^2). Bending hardly changes the instability: it grows as exp(2.095 t) and exp(2.633 t). The
blades start unstretched; they stretch by a few mm, whereby all of them lag by some 0.004 rad, an oscillation that does not
grow.

Run it:  mbdae compare examples/ground_resonance.py --out out
"""

import math

import numpy as np

import mbdae as mb

BLADES, L, M, HINGE = 4, 4.25, 12.75, 0.25  # -, m, kg, m
BLOCK, STIFFNESS, DAMPING = 30.0, 12000.0, 150.0  # kg, N/m, N s/m
OMEGA, HUB_INERTIA, LAG0 = 20.01, 1.0, 0.01  # rad/s, kg m^2 (free rotor), rad (blade 1)
EI = 1e4  # N m^2, not given by the paper
SECTION = mb.Section(EA=1e7, GA2=4e6, GA3=4e6, GJ=EI, EI2=EI, EI3=EI, mass_per_length=M / L, rotary_inertia=1e-4 * M / L)
ELEMENTS, ORDER = 3, 3  # of every flexible blade

t_end = 2.0  # s
measure = "lag 1.angle"


def scene(axes=2, free=False, model=None, flexible=False, space="auto", lag0=LAG0):
    """Block, hub and blades, drawn with blade 1 along x; the block never turns, so it needs no inertia, and the carriage
    between its two slides neither mass nor inertia. lag0: rad, how far blade 1 lags at the start."""
    name = f"ground resonance, {axes} ax{'is' if axes == 1 else 'es'}, rotor speed {'free' if free else 'prescribed'}"
    s = mb.Scene(name + (", flexible blades" if flexible else ""), space=space)
    block = s.rigid_body("block", BLOCK, 0.0, at=(0, 0))
    support = {"spring": STIFFNESS, "damper": DAMPING, "model": model}
    if axes == 1:
        s.prismatic("support", s.ground, block, at=(0, 0), axis=(1, 0, 0), **support)
    else:
        carriage = s.rigid_body("carriage", 0.0, 0.0, at=(0, 0))
        s.prismatic("support x", s.ground, carriage, at=(0, 0), axis=(1, 0, 0), **support)
        s.prismatic("support y", carriage, block, at=(0, 0), axis=(0, 1, 0), **support)
    hub = s.rigid_body("hub", 0.0, HUB_INERTIA if free else 0.0, at=(0, 0))
    s.revolute("shaft", block, hub, at=(0, 0), model=model, **({"rate0": OMEGA} if free else {"angle": OMEGA * mb.t}))
    for i in range(BLADES):
        direction = np.array([math.cos(i * math.pi / 2), math.sin(i * math.pi / 2)])
        hinge, tip = HINGE * direction, (HINGE + L) * direction
        if flexible:
            blade = s.beam(f"blade {i + 1}", hinge, tip, section=SECTION, elements=ELEMENTS, order=ORDER)
        else:
            blade = s.link(f"blade {i + 1}", hinge, tip, mass=M)
        s.revolute(f"lag {i + 1}", hub, blade, at=hinge, angle0=lag0 if i == 0 else 0.0, model=model)
    return s


def growth():
    """Largest growth rate (1/s) by Coleman's transformation, both axes: hub z = x + i y, lag eta = sum of zeta_i exp(i psi_i)."""
    S, inertia, total = M * L / 2, M * L**2 / 3, BLOCK + BLADES * M
    mass = np.array([[total, 1j * S], [-0.5j * BLADES * S, inertia]])
    damping = np.diag([DAMPING, -2j * OMEGA * inertia])
    stiffness = np.diag([STIFFNESS, OMEGA**2 * (S * HINGE - inertia)])
    state = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]])
    return np.linalg.eigvals(state).real.max()


def run():
    """Two seconds, both axes free to move."""
    return scene().simulate(t_end, accuracy=1e-6)


def number(r):
    """Growth rate of the unstable motion, 1/s."""
    return scene(lag0=0.0).floquet(2 * math.pi / OMEGA).growth.max(), growth()


def picture(r):
    """Lag angles, and the path of the hub."""
    return r.plot(*(f"lag {i + 1}.angle" for i in range(BLADES)), "hub.position")
