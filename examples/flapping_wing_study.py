r"""The flapping wing with elastic links and with clearance, as studied in a paper.

The paper is "Modified models for revolute joints coupling flexibility of links in multibody systems".

Radau IIA and HHT, the paper's two integrators, bend the elastic wing by the same angle: 0.0118 rad in hinge 9 (`bending`), the
one with stresses as unknowns over steps of 1 ms, the other with the same steps.

Case III leaves both hinges 4 their clearance: races of 50.1 mm around pins of 50 mm, as the paper prints them, although the
links that meet there are 36 and 107 mm long; only their difference, 0.1 mm, and where friction acts depend on the radii.
Hertz contact of 1e9 N/m^1.5 and Coulomb friction with mu = 0.6 and v_c = 2 m/s are the paper's too. Pin and race slide at
up to 0.3 m/s, where tanh(v / v_c) is 0.15: the friction is viscous rather than dry, a sixth of what mu says. Contact damping
is not given; `damping` (s/m) is small, 0.1, and hardly matters: friction dissipates hundreds of times what impacts do.

Run it:  mbdae run examples/flapping_wing_study.py --out out     (the elastic wing)
Draw it: python examples/flapping_wing_study.py out   (configuration, path of the tip, hinge angles, torque, case III against I)
"""

import sys
from functools import partial
from pathlib import Path

import numpy as np
from flapping_wing import INNER, OMEGA, OUTER, POINTS, measure, t_end
from flapping_wing import scene as wing

import mbdae as mb

__all__ = ["measure", "scene", "t_end"]
scene = partial(wing, flexible=True)


def carried(p, q, drawn_p, drawn_q, drawn):
    """Where a point of a body is whose points p and q have moved; points in the plane as complex numbers."""
    return p + (q - p) * (drawn - drawn_p) / (drawn_q - drawn_p)


def corner(p, q, drawn_p, drawn_q, drawn):
    """The point at its drawn distances from p and q, on the side of p-q on which it is drawn."""
    a, b, d = abs(drawn - drawn_p), abs(drawn - drawn_q), abs(q - p)
    along = (a**2 - b**2 + d**2) / (2 * d)
    side = np.sign(((drawn - drawn_p) / (drawn_q - drawn_p)).imag)
    return p + (q - p) / d * (along + 1j * side * np.sqrt(a**2 - along**2))


def tip(t):
    """Height of the left tip (nt,), m, at times t (nt,) s: the rigid wing in closed form."""
    z = {n: 0.01 * complex(*xy) for n, xy in POINTS.items()}
    p2 = z[1] + (z[2] - z[1]) * np.exp(1j * OMEGA * t)
    p4 = corner(p2, z[12], z[2], z[12], z[4])
    p3 = carried(p2, p4, z[2], z[4], z[3])
    p6, p8 = (carried(p4, z[12], z[4], z[12], z[n]) for n in (6, 8))
    p7 = corner(p3, p6, z[3], z[6], z[7])
    p9 = corner(p7, p8, z[7], z[8], z[9])
    return carried(p8, p9, z[8], z[9], z[11]).imag


def pictures(out, accuracy=1e-4, **options):
    """Our own versions of the paper's Figs. 3-6 and the torque of the drive, as .png files in a folder."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    s = wing(**{"flexible": True} | options)
    s.draw(folder / "wing.png")
    r = s.simulate(t_end, accuracy=accuracy)
    r.orbit(s["LH"].at(1.0), path=folder / "tip.png")
    r.plot("L4.angle", "L8.angle", "L9.angle", path=folder / "angles.png")
    r.plot("L1.torque", path=folder / "torque.png")
    return r


def bending(solver, end=0.1, **options):
    """Largest angle (rad) by which hinge 9 of the elastic wing departs from that of the rigid one until `end` (s)."""
    elastic = wing(flexible=True, **options).simulate(end, solver=solver)
    rigid = wing(**options).simulate(end, accuracy=1e-8, solver=mb.RadauIIA(3))
    return float(np.max(np.abs(elastic["L9"].angle - rigid(elastic.t)["L9"].angle)))


def compared(flexible=True, rtol=1e-7, **options):
    """Runs of case I and case III at the same times."""
    solver = mb.RadauIIA(3, rtol=rtol)
    return [wing(flexible, case, **options).simulate(t_end, solver=solver, outputs=4001) for case in ("I", "III")]


def summary(one, three):
    """What clearance changes, as text."""
    e, contacts = three.energy, three["L4"].contacts
    tips = [r["LH"].at(1.0).position for r in (one, three)]
    angles = ", ".join(f"{n} {np.max(np.abs(one['L' + n].angle - three['L' + n].angle)):.2e}" for n in ("4", "8", "9", "12"))
    return (f"case III: {len(contacts)} contacts in hinge L4, penetration at most {contacts.deepest:.2e} m; friction dissipates "
            f"{e.friction[-1]:.3g} J, impacts {e.impact[-1]:.2g} J; energy error {np.max(np.abs(e.balance)):.1e} of "
            f"{np.max(e.kinetic):.2g} J\nagainst case I: tip {np.max(np.linalg.norm(tips[0] - tips[1], axis=1)):.2e} m, angles "
            f"{angles} rad; {three.stats.steps} steps and {three.stats.cpu_s:.1f} s CPU for {one.stats.steps} and "
            f"{one.stats.cpu_s:.1f}")


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
