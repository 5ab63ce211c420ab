r"""A slider-crank with play at the crank pin, at the piston pin, and at both: soft contact, which converges, and steel.

The crank (50 mm) turns at 100 rad/s, the rod is 120 mm long; each pin of radius 10 mm lies in a race 0.5 mm wider, with
Hertz contact, damping 0.5 s/m and Coulomb friction. Pins start in the middle of their races at the speeds of ideal
joints, so the run begins with a short free flight and an impact. Play alone may be at "B" (crank pin), "C" (piston pin)
or "BC"; "" is the mechanism with ideal joints.

Soft contact (1e9 N/m^1.5) is regular: after the first impacts the pins stay on their races, and over a full turn two
tolerances and two methods agree within 1e-8 m. The motion with both clearances is not the sum of the single ones.
Steel (6.6e10 N/m^1.5) bounces on, and neighbouring motions part exponentially: clearances that differ by a nanometre end
the turn somewhere else. What can be trusted there is the energy balance, the first impacts and what friction dissipates.

Run it:  mbdae run examples/slider_crank_clearance.py --out out
Draw it: python examples/slider_crank_clearance.py out   (convergence, sum of single clearances, steel: tables and figure)
"""

import sys
from pathlib import Path

import numpy as np

import mbdae as mb

CRANK, ROD, RATE = 0.05, 0.12, 100.0  # m, m, rad/s
PIN, CLEARANCE = 0.01, 5e-4  # m
SOFT, STEEL = 1e9, 6.6e10  # N/m^1.5
DAMPING, MU, V_C = 0.5, 0.1, 0.1  # s/m, 1, m/s
MASSES = {"crank": 0.3, "rod": 0.5, "slider": 1.5}  # kg
NAMES = {"B": "crank pin", "C": "piston pin", "BC": "both"}
COLOURS = {"B": "tab:blue", "C": "tab:orange", "BC": "tab:green"}
SPREAD, MEMBERS = 1e-9, 20  # m, of the clearances in the ensemble

t_end = 2 * np.pi / RATE  # s, one turn
measure = "C.angle"


def scene(play="BC", stiffness=SOFT, clearance=CLEARANCE, damping=DAMPING, friction=True, space="auto"):
    """The mechanism with play at the joints named."""
    s = mb.Scene(f"slider-crank with clearance at {NAMES.get(play, 'no joint')}", space=space)
    a, b = (CRANK, 0), (CRANK + ROD, 0)
    s.link("crank", (0, 0), a, mass=MASSES["crank"])
    s.link("rod", a, b, mass=MASSES["rod"])
    s.rigid_body("slider", MASSES["slider"], 1e-3, at=b)
    rubbing = mb.Coulomb(MU, V_C) if friction else None
    loose = mb.Clearance(PIN + clearance, PIN, mb.Hertz(stiffness, damping), rubbing)
    s.revolute("A", s.ground, "crank", at=(0, 0), angle=RATE * mb.t)
    s.revolute("B", "crank", "rod", at=a, model=loose if "B" in play else mb.Kinematic())
    s.revolute("C", "rod", "slider", at=b, model=loose if "C" in play else mb.Kinematic())
    s.prismatic("D", s.ground, "slider", at=b, axis=(1, 0, 0))
    return s


def slider(result):
    """Position of the slider, m (nt,)."""
    return result["slider"].position[:, 0]


def differences(play, turn=1.0):
    """Soft contact: largest difference of the slider's position over a part of a turn from RadauIIA(3) at rtol 1e-11, m."""
    solvers = mb.RadauIIA(3, rtol=1e-11), mb.RadauIIA(3, rtol=1e-9), mb.IDA(rtol=1e-10)
    best, *others = (slider(scene(play).simulate(turn * t_end, solver=solver)) for solver in solvers)
    return [np.max(np.abs(x - best)) for x in others]


def deviations():
    """Soft contact: by joints with play, a run and how far the slider is from where ideal joints put it, m (nt,)."""
    ideal = slider(scene("").simulate(t_end, solver=mb.RadauIIA(3, rtol=1e-10)))
    runs = {play: scene(play).simulate(t_end, solver=mb.RadauIIA(3, rtol=1e-9)) for play in NAMES}
    return {play: (r, slider(r) - ideal) for play, r in runs.items()}


def ensemble(play="BC", members=MEMBERS, rtol=1e-8):
    """Steel: runs whose clearances differ by SPREAD (standard deviation)."""
    chance = np.random.default_rng(1)
    return [scene(play, STEEL, CLEARANCE + SPREAD * x).simulate(t_end, solver=mb.RadauIIA(3, rtol=rtol))
            for x in chance.standard_normal(members)]  # fmt: skip


def statistics(runs):
    """Of every quantity of an ensemble: name with unit -> (members,)."""
    e = [r.energy for r in runs]
    found = {
        "first impact at B, s": [r["B"].contacts.first for r in runs],
        "penetration of the first impact at B, m": [r["B"].contacts.peak[0] for r in runs],
        "largest penetration at B, m": [r["B"].contacts.deepest for r in runs],
        "largest penetration at C, m": [r["C"].contacts.deepest for r in runs],
        "dissipated by friction, J": [one.friction[-1] for one in e],
        "dissipated by impacts, J": [one.impact[-1] for one in e],
        "contacts at B": [len(r["B"].contacts) for r in runs],
        "slider at the end, m": [slider(r)[-1] for r in runs],
        "rate of the rod at the end, rad/s": [r["B"].rate[-1] for r in runs],
        "largest energy error over dissipated": [np.max(np.abs(one.balance)) / one.dissipated[-1] for one in e],
    }
    return {name: np.array(values, dtype=float) for name, values in found.items()}


def report():
    """Print convergence, superposition and the statistics of steel; return the runs for the figure."""
    print("soft contact: largest difference of the slider's position over a turn, m")
    for play, name in NAMES.items():
        radau, ida = differences(play)
        print(f"  {name:11s} RadauIIA(3) 1e-9 against 1e-11: {radau:.1e}   IDA 1e-10 against it: {ida:.1e}")
    single = deviations()
    both, total = single["BC"][1], single["B"][1] + single["C"][1]
    print("soft contact: deviation of the slider from ideal joints, m: "
          + ", ".join(f"{NAMES[play]} {np.max(np.abs(d)):.2e}" for play, (_, d) in single.items())
          + f"; both less the sum of the single ones {np.max(np.abs(both - total)):.2e}")  # fmt: skip
    runs = ensemble()
    print(f"steel: {len(runs)} clearances that differ by {SPREAD:g} m: mean, standard deviation over mean")
    for name, values in statistics(runs).items():
        print(f"  {name:42s} {np.mean(values):12.6g} {np.std(values) / abs(np.mean(values)):9.1e}")
    return single, runs


def picture(single, runs, path):
    """Soft: deviations and the orbit of both pins; steel: how neighbouring motions part, and the force at B."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 8), layout="constrained")
    (a, b), (c, d) = figure.subplots(2, 2)
    turn = single["BC"][0].t / t_end
    for play, (_, deviation) in single.items():
        a.plot(turn, 1e3 * deviation, label=NAMES[play], color=COLOURS[play])
    a.plot(turn, 1e3 * (single["B"][1] + single["C"][1]), "k:", label="sum of the single ones")
    a.set(title="soft: slider against ideal joints", xlabel="turns", ylabel="deviation, mm")
    a.legend(fontsize="small")
    times = np.linspace(0, t_end, 2001)
    at = single["BC"][0](times)
    for joint in "BC":
        b.plot(*(1e3 * at[joint].orbit.T), label=NAMES[joint], color=COLOURS[joint], lw=1)
    angle = np.linspace(0, 2 * np.pi, 200)
    b.plot(1e3 * CLEARANCE * np.cos(angle), 1e3 * CLEARANCE * np.sin(angle), "k--", lw=1, label="contact begins")
    b.set(title="soft, both: centre of the pin in its race", xlabel="mm", ylabel="mm", aspect="equal", ylim=(-1.15, 0.8))
    b.legend(fontsize="small", loc="lower center", ncols=2)
    many = [slider(r(times)) for r in runs]
    for x in many[1:]:
        c.semilogy(times / t_end, np.maximum.accumulate(np.maximum(np.abs(x - many[0]), 1e-16)), color="tab:red", lw=0.8)
    c.set(title="steel: largest distance so far of neighbouring motions", xlabel="turns", ylabel="slider, m", ylim=(1e-12, 1e-3))
    fine = np.linspace(0, t_end, 8001)
    for r, colour in zip(runs[:2], ("tab:blue", "tab:red"), strict=True):
        d.plot(fine / t_end, 1e-3 * r(fine)["B"].normal_force, color=colour, lw=0.8)
    d.set(title="steel: contact force at the crank pin, two members", xlabel="turns", ylabel="kN",
          xlim=(0.33, 0.53), ylim=(0, 13))  # fmt: skip
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    folder.mkdir(parents=True, exist_ok=True)
    picture(*report(), folder / "slider_crank_clearance.png")
