r"""A flapping wing: two mirrored chains of three four-bars each, rigid or elastic, driven by two cranks.

Per half a crank A (1-2) turns by phi(t) = omega t; the four-bars 1-2-4-12, 3-4-6-7 and 6-7-9-8 hand its motion on to
the inner wing D (4-5-6-8, hinged to the frame in 12 by the bracket 5-12) and the outer wing H (9-8-10-11):

    A: 1-2   B: 2-3-4   D: 4-5-6-8   E: 6-7   F: 3-7   G: 7-9   H: 9-8-10-11,

seven bodies on ten hinges 1, 2, 3, 4, 12, 6, 7a (E-F), 7b (E-G), 8, 9: one freedom, the crank's. Elastic links are
beams of mass per length 0.1032 kg/m, EI = 29.856 N m^2 and GJ = 23.303 N m^2; axial and shear stiffness are those of
the steel tube (nu = EI/GJ - 1 = 0.28) with that mass and EI. No gravity.

Options: `flexible` links instead of rigid ones; `case` "I" (all hinges kinematic), "II" (2 and 4 recursive), "tree" (all
but those that close loops recursive) or "classical"; `elements` refines all beams; `frame` an elastic one 16-1-14-15-12-13
clamped in 16 instead of the ground; `stiffness` a factor of the section, `sense` -1 of the cranks, `damping` of the material.

Run it:  mbdae run examples/flapping_wing.py --out out
"""

import numpy as np

import mbdae as mb

POINTS = {1: (-4.91071, 0.0), 2: (-2.25663, 2.38975), 3: (-2.22156, 9.08609), 4: (-0.76893, 12.3488),
          5: (-11.4767, 12.7227), 6: (-44.0461, 13.86), 7: (-45.4988, 10.5974), 8: (-47.5828, 13.363),
          9: (-48.0479, 10.7251), 10: (-52.9394, 13.4378), 11: (-100.256, 14.0985), 12: (-11.539, 10.938),
          13: (0.0, 8.75726), 14: (-4.91071, 4.3957), 15: (-7.36607, 4.3957), 16: (0.0, 0.0)}  # cm, left half  # fmt: skip
BODIES = {"A": (1, 2), "B": (2, 3, 4), "D": (4, 5, 6, 8), "E": (6, 7), "F": (3, 7), "G": (7, 9), "H": (9, 8, 10, 11)}
JOINTS = {"2": "AB", "3": "BF", "4": "BD", "6": "DE", "7a": "EF", "7b": "EG", "8": "DH", "9": "GH"}  # by bodies k, l
FRAME = (16, 1, 14, 15, 12, 13)
OMEGA, DENSITY, EI, GJ, RADII = 12.56, 0.1032, 29.856, 23.303, (0.00487043354, 0.00442000712)  # rad/s, kg/m, N m^2, m
PER_ELEMENT = 0.16  # m, longest element where elements = 1

t_end = 0.5  # s, one turn of the cranks
measure = "L8.angle"


def section(stiffness=1.0, damping=0.0):
    """The beams' section: the paper's EI and GJ, the rest of the tube with the same mass."""
    tube = mb.Section.tube(*RADII, E=210e9, nu=EI / GJ - 1, rho=7850.0)
    c = np.array([tube.EA, tube.GA2, tube.GA3, GJ, EI, EI]) * stiffness
    return mb.Section(*c, mass_per_length=DENSITY, rotary_inertia=tube.rotary_inertia[1], damping=damping)


def scene(flexible=False, case="I", elements=1, frame=False, stiffness=1.0, damping=0.0, sense=1, space="auto"):
    """Both halves as drawn, the left one with the names L..., the right one mirrored."""
    s = mb.Scene(f"flapping wing, {'flexible' if flexible else 'rigid'}, case {case}", space=space)
    clamped, model = {"L": s.ground, "R": s.ground}, mb.Classical() if case == "classical" else mb.Kinematic()
    for half, mirror in (("L", 1), ("R", -1)):
        at = {n: 0.01 * np.array([mirror * x, y]) for n, (x, y) in POINTS.items()}

        def body(name, numbers, half=half, at=at, flexible=flexible):
            points = [at[n] for n in numbers]
            if not flexible:
                return s.link(half + name, *points, mass_per_length=DENSITY)
            counts = [elements * int(np.ceil(np.linalg.norm(b - a) / PER_ELEMENT)) for a, b in zip(points, points[1:])]
            return s.beam(half + name, *points, section=section(stiffness, damping), elements=counts)

        b = {name: body(name, numbers) for name, numbers in BODIES.items()}
        if frame:
            clamped[half] = body("frame", FRAME, flexible=True)
            s.weld(half + "16", s.ground, clamped[half], at=at[16])
        s.revolute(half + "1", clamped[half], b["A"], at=at[1], angle=mirror * sense * OMEGA * mb.t, model=model)
        for name, (k, l) in JOINTS.items():
            s.revolute(half + name, b[k], b[l], at=at[int(name[0])], model=mb.Recursive() if case == "II" and name in "24" else model)
        s.revolute(half + "12", clamped[half], b["D"].at(at[5]), at=at[12], model=model)
    if frame:
        s.weld("13", clamped["L"], clamped["R"], at=(0, 0.01 * POINTS[13][1]))
    return s.recursive() if case == "tree" else s
