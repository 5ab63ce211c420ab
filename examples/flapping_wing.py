r"""A flapping wing: two mirrored chains of three four-bars each, rigid or elastic, driven by two cranks.

Per half a crank A (1-2) turns by phi(t) = omega t, and the four-bars 1-2-4-12, 3-4-6-7 and 6-7-9-8 hand its motion on
to the inner wing D and the outer wing H. Seven bodies

    A: 1-2   B: 2-3-4   D: 4-5-6-8, on a rigid bracket 5-12   E: 6-7   F: 3-7   G: 7-9   H: 9-8-10-11

on ten hinges 1, 2, 3, 4, 12, 6, 7a (E-F), 7b (E-G), 8, 9 leave 3 * 7 - 2 * 10 = 1 freedom, which the crank prescribes.
Elastic links have the mass per length 0.1032 kg/m, EI = 29.856 N m^2 and GJ = 23.303 N m^2; their axial and shear
stiffness are those of the steel tube (nu = EI/GJ - 1 = 0.28) with that mass and that EI. There is no gravity. The
cranks start at full speed with the links undeformed, which leaves an elastic vibration in the wings.

Case III leaves both hinges 4 their clearance: races of 50.1 mm around pins of 50 mm, as the paper prints them, although the
links that meet there are 36 and 107 mm long; only their difference, 0.1 mm, and where friction acts depend on the radii.
Hertz contact of 1e9 N/m^1.5 and Coulomb friction with mu = 0.6 and v_c = 2 m/s are the paper's too. Pin and race slide at
up to 0.3 m/s, where tanh(v / v_c) is 0.15: the friction is viscous rather than dry, a sixth of what mu says. Contact damping
is not given; `damping` (s/m) is small, 0.1, and hardly matters: friction dissipates hundreds of times what impacts do.

Options: `flexible` links instead of rigid ones; `case` "I" (all hinges kinematic), "II" (2 and 4 recursive), "III" (4 with
clearance), "recursive" (all of elastic links, of rigid ones those that close no loop) or "classical"; `damping` of the contact;
`elements` divides every beam finer; `frame` makes 16-1-14-15-12-13 of beams, clamped in 16, instead of ground; `bracket` makes
5-12 a beam too (then all hinges lie on nodes, and the model in space has the paper's 42 multipliers); `stiffness` scales the
section; `sense` -1 turns back.

Radau IIA and HHT, the paper's two integrators, bend the elastic wing by the same angle: 0.0118 rad in hinge 9 (`bending`), the
one with stresses as unknowns over steps of 1 ms, the other with the same steps.

Run it:  mbdae run examples/flapping_wing.py --out out          (with --solver hht: HHT, its step found from the accuracy)
Draw it: python examples/flapping_wing.py out   (configuration, path of the tip, hinge angles, torque, case III against I)
"""

import sys
from pathlib import Path

import numpy as np

import mbdae as mb

POINTS = {1: (-4.91071, 0), 2: (-2.25663, 2.38975), 3: (-2.22156, 9.08609), 4: (-0.76893, 12.3488), 5: (-11.4767, 12.7227),
          6: (-44.0461, 13.86), 7: (-45.4988, 10.5974), 8: (-47.5828, 13.363), 9: (-48.0479, 10.7251), 10: (-52.9394, 13.4378),
          11: (-100.256, 14.0985), 12: (-11.539, 10.938), 13: (0, 8.75726), 14: (-4.91071, 4.3957), 15: (-7.36607, 4.3957),
          16: (0, 0)}  # cm, left half  # fmt: skip
BODIES = {"A": (1, 2), "B": (2, 3, 4), "D": (4, 5, 6, 8), "E": (6, 7), "F": (3, 7), "G": (7, 9), "H": (9, 8, 10, 11)}
HINGES = {"2": "AB", "3": "BF", "4": "BD", "6": "DE", "7a": "EF", "7b": "EG", "8": "DH", "9": "GH"}  # bodies k, l
OMEGA, DENSITY, EI, GJ = 12.56, 0.1032, 29.856, 23.303  # rad/s, kg/m, N m^2, N m^2
OUTER, INNER, CONTACT, MU, V_C = 0.0501, 0.05, 1e9, 0.6, 2.0  # m, m, N/m^1.5, 1, m/s
TUBE = mb.Section.tube(4.87043354e-3, 4.42000712e-3, E=210e9, nu=EI / GJ - 1, rho=7850.0)
LONGEST = 0.11  # m, element where elements = 1

t_end = 0.5  # s, one turn of the cranks
measure = "L8.angle"


def scene(flexible=False, case="I", elements=1, frame=False, stiffness=1.0, sense=1, space="auto",
          bracket=False, damping=0.1):  # fmt: skip
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


def pictures(out, accuracy=1e-4, **options):
    """Our own versions of the paper's Figs. 3-6 and the torque of the drive, as .png files in a folder."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    s = scene(**{"flexible": True} | options)
    s.draw(folder / "wing.png")
    r = s.simulate(t_end, accuracy=accuracy)
    r.orbit(s["LH"].at(1.0), path=folder / "tip.png")
    r.plot("L4.angle", "L8.angle", "L9.angle", path=folder / "angles.png")
    r.plot("L1.torque", path=folder / "torque.png")
    return r


def bending(solver, end=0.1, **options):
    """Largest angle (rad) by which hinge 9 of the elastic wing departs from that of the rigid one until `end` (s)."""
    elastic = scene(flexible=True, **options).simulate(end, solver=solver)
    rigid = scene(**options).simulate(end, accuracy=1e-8, solver=mb.RadauIIA(3))
    return float(np.max(np.abs(elastic["L9"].angle - rigid(elastic.t)["L9"].angle)))


def compared(flexible=True, rtol=1e-7, **options):
    """Runs of case I and case III at the same times."""
    solver = mb.RadauIIA(3, rtol=rtol)
    return [scene(flexible, case, **options).simulate(t_end, solver=solver, outputs=4001) for case in ("I", "III")]


def summary(one, three):
    """What clearance changes, as text."""
    e, contacts = three.energy, three["L4"].contacts
    tips = [r["LH"].at(1.0).position for r in (one, three)]
    angles = ", ".join(f"{n} {np.max(np.abs(one['L' + n].angle - three['L' + n].angle)):.2e}" for n in ("4", "8", "9", "12"))
    return (f"case III: {len(contacts)} contacts in hinge L4, penetration at most {contacts.deepest:.2e} m; friction dissipates "
            f"{e.friction[-1]:.3g} J, impacts {e.impact[-1]:.2g} J; energy error {np.max(np.abs(e.balance)):.1e} of "
            f"{np.max(e.kinetic):.2g} J\nagainst case I: tip {np.max(np.linalg.norm(tips[0] - tips[1], axis=1)):.2e} m, angles "
            f"{angles} rad; {three.stats.steps} steps and {three.stats.cpu_s:.1f} s CPU for {one.stats.steps} and "
            f"{one.stats.cpu_s:.1f}")  # fmt: skip


def clearance_picture(one, three, path):
    """Case III beside case I: the tip, as in the paper's Fig. 7, angles, and pin and force of hinge 4."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 8), layout="constrained")
    (a, b), (c, d) = figure.subplots(2, 2)
    tips = [r["LH"].at(1.0).position for r in (one, three)]
    for axis, name in ((0, "x"), (1, "y")):
        a.plot(one.t, 1e2 * tips[0][:, axis], label=f"{name}, case I")
        a.plot(three.t[::100], 1e2 * tips[1][::100, axis], "ko", mfc="none", ms=4, label=f"{name}, case III")
    a.set(title="tip of the left wing (point 11)", xlabel="s", ylabel="cm")
    a.legend(fontsize="small")
    b.plot(one.t, 1e3 * (tips[1] - tips[0])[:, :2], label=["tip x, mm", "tip y, mm"])
    for name in ("4", "8", "9"):
        b.plot(one.t, 1e3 * (three["L" + name].angle - one["L" + name].angle), lw=1, label=f"angle in {name}, mrad")
    b.set(title="case III less case I", xlabel="s")
    b.legend(fontsize="small")
    c.plot(*(1e3 * three["L4"].orbit.T), lw=1)
    angle, play = np.linspace(0, 2 * np.pi, 200), 1e3 * (OUTER - INNER)
    c.plot(play * np.cos(angle), play * np.sin(angle), "k--", lw=1, label="contact begins")
    c.set(title="hinge 4: centre of the pin in its race", xlabel="mm", ylabel="mm", aspect="equal")
    c.legend(fontsize="small")
    d.plot(three.t, np.hypot(three["L4"].normal_force, three["L4"].friction_force), lw=0.8, label="case III, contact")
    d.plot(one.t, np.linalg.norm(one["L4"].force, axis=1), label="case I, reaction")
    d.set(title="force in hinge 4", xlabel="s", ylabel="N")
    d.legend(fontsize="small")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    print(pictures(out))
    for method in (mb.RadauIIA(3, step=1e-3), mb.HHT(step=1e-3)):
        print(f"{method.label}: the wing bends hinge 9 by {bending(method):.4f} rad")
    runs = compared()
    print(summary(*runs))
    clearance_picture(*runs, out / "clearance.png")
