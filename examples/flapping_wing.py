r"""A flapping wing: two mirrored chains of three four-bars each, rigid or elastic, driven by two cranks.

Per half a crank A (1-2) turns by phi(t) = omega t, and the four-bars 1-2-4-12, 3-4-6-7 and 6-7-9-8 hand its motion on
to the inner wing D and the outer wing H. Seven bodies

    A: 1-2   B: 2-3-4   D: 4-5-6-8, on a rigid bracket 5-12   E: 6-7   F: 3-7   G: 7-9   H: 9-8-10-11

on ten hinges 1, 2, 3, 4, 12, 6, 7a (E-F), 7b (E-G), 8, 9 leave 3 * 7 - 2 * 10 = 1 freedom, which the crank prescribes.
Elastic links have the mass per length 0.1032 kg/m, EI = 29.856 N m^2 and GJ = 23.303 N m^2; their axial and shear
stiffness are those of the steel tube (nu = EI/GJ - 1 = 0.28) with that mass and that EI. There is no gravity. The
cranks start at full speed with the links undeformed, which leaves an elastic vibration in the wings.

Options: `flexible` links instead of rigid ones; `case` "I" (all hinges kinematic), "II" (2 and 4 recursive), "III" (4 with
clearance), "recursive" (all of elastic links, of rigid ones those that close no loop) or "classical"; `damping` of the contact;
`elements` divides every beam finer; `frame` makes 16-1-14-15-12-13 of beams, clamped in 16, instead of ground; `bracket` makes
5-12 a beam too (then all hinges lie on nodes, and the model in space has 42 multipliers); `stiffness` scales the
section; `sense` -1 turns back.

The closed form of the rigid wing, `tip` in flapping_wing_study.py, takes one circle after the other: point 4 is at its distances
from 2 and 12, then 7 from 3 and 6, then 9 from 7 and 8; bodies B, D and H carry the other points along.

Run it:  mbdae run examples/flapping_wing.py --out out          (with --solver hht: HHT, its step found from the accuracy)
"""

import numpy as np

import mbdae as mb

POINTS = {1: (-4.91071, 0), 2: (-2.25663, 2.38975), 3: (-2.22156, 9.08609), 4: (-0.76893, 12.3488), 5: (-11.4767, 12.7227),
          6: (-44.0461, 13.86), 7: (-45.4988, 10.5974), 8: (-47.5828, 13.363), 9: (-48.0479, 10.7251), 10: (-52.9394, 13.4378),
          11: (-100.256, 14.0985), 12: (-11.539, 10.938), 13: (0, 8.75726), 14: (-4.91071, 4.3957), 15: (-7.36607, 4.3957),
          16: (0, 0)}  # cm, left half
BODIES = {"A": (1, 2), "B": (2, 3, 4), "D": (4, 5, 6, 8), "E": (6, 7), "F": (3, 7), "G": (7, 9), "H": (9, 8, 10, 11)}
HINGES = {"2": "AB", "3": "BF", "4": "BD", "6": "DE", "7a": "EF", "7b": "EG", "8": "DH", "9": "GH"}  # bodies k, l
OMEGA, DENSITY, EI, GJ = 12.56, 0.1032, 29.856, 23.303  # rad/s, kg/m, N m^2, N m^2
OUTER, INNER, CONTACT, MU, V_C = 0.0501, 0.05, 1e9, 0.6, 2.0  # m, m, N/m^1.5, 1, m/s
TUBE = mb.Section.tube(4.87043354e-3, 4.42000712e-3, E=210e9, nu=EI / GJ - 1, rho=7850.0)
LONGEST = 0.11  # m, element where elements = 1

t_end = 0.5  # s, one turn of the cranks
measure = "L8.angle"


def scene(flexible=False, case="I", elements=1, frame=False, stiffness=1.0, sense=1, space="auto",
          bracket=False, damping=0.1):
    """Both halves as drawn; bodies and hinges of the left one are named L..., of the right one R...."""
    s = mb.Scene(f"flapping wing, {'flexible' if flexible else 'rigid'}, case {case}", space=space)
    model = mb.Classical() if case == "classical" else mb.Kinematic()
    play = mb.Clearance(OUTER, INNER, mb.Hertz(CONTACT, damping), mb.Coulomb(MU, V_C))
    values = stiffness * np.array([TUBE.EA, TUBE.GA2, TUBE.GA3, GJ, EI, EI])
    section = mb.Section(*values, mass_per_length=DENSITY, rotary_inertia=TUBE.rotary_inertia)

    def body(name, points):
        if not flexible:
            return s.link(name, *points, mass_per_length=DENSITY)
        counts = np.ceil(np.linalg.norm(np.diff(points, axis=0), axis=1) / LONGEST).astype(int) * elements
        return s.beam(name, *points, section=section, elements=counts)

    frames = {}
    for half, mirror in (("L", 1), ("R", -1)):
        at = {n: 0.01 * np.array([mirror * x, y]) for n, (x, y) in POINTS.items()}
        b = {name: body(half + name, [at[n] for n in numbers]) for name, numbers in BODIES.items()}
        frames[half] = body(half + "frame", [at[n] for n in (16, 1, 14, 15, 12, 13)]) if frame else s.ground
        if frame:
            s.weld(half + "16", s.ground, frames[half], at=at[16])
        s.revolute(half + "1", frames[half], b["A"], at=at[1], angle=mirror * sense * OMEGA * mb.t, model=model)
        arm = body(half + "bracket", [at[5], at[12]]) if bracket else b["D"].at(at[5])
        if bracket:
            s.weld(half + "5", b["D"], arm, at=at[5])
        s.revolute(half + "12", frames[half], arm, at=at[12], model=model)
        for name, (k, l) in HINGES.items():
            chosen = {"II2": mb.Recursive(), "II4": mb.Recursive(), "III4": play}.get(case + name, model)
            s.revolute(half + name, b[k], b[l], at=at[int(name[0])], model=chosen)
    if frame:
        s.weld("13", *frames.values(), at=at[13])
    if case == "recursive":
        return s.replace(model=mb.Recursive()) if flexible else s.recursive()
    return s


def run():
    """One turn of the cranks, rigid links."""
    return scene().simulate(t_end, accuracy=1e-7, outputs=501)


def number(r):
    """Stroke of the tip, m; expected in closed form."""
    from flapping_wing_study import tip

    return np.ptp(r["LH"].at(1.0).position[:, 1]), np.ptp(tip(r.t))


def picture(r):
    """The wing as drawn, with the hinges of the left half."""
    s = scene()
    return s.draw(hide=[joint.name for joint in s.joints if joint.name[0] == "R"])
