r"""The slider-crank with clearance, of steel: what can be trusted where neighbouring motions part.

Steel (6.6e10 N/m^1.5) bounces on, and neighbouring motions part exponentially: clearances that differ by a nanometre end
the turn somewhere else. What can be trusted there is the energy balance, the first impacts and what friction dissipates.

Run it:  mbdae run examples/slider_crank_steel.py --out out
Draw it: python examples/slider_crank_steel.py out   (convergence, sum of single clearances, steel: tables and figure)
"""

import sys
from functools import partial
from pathlib import Path

import numpy as np
from slider_crank_clearance import CLEARANCE, NAMES, measure, run, slider, t_end
from slider_crank_clearance import scene as soft

import mbdae as mb

__all__ = ["measure", "scene", "t_end"]
STEEL = 6.6e10  # N/m^1.5
COLOURS = {"B": "tab:blue", "C": "tab:orange", "BC": "tab:green"}
SPREAD, MEMBERS = 1e-9, 20  # m, of the clearances in the ensemble
scene = partial(soft, stiffness=STEEL)


def differences(play, turn=1.0):
    """Soft contact: largest difference of the slider's position over a part of a turn from RadauIIA(3) at rtol 1e-11, m."""
    solvers = mb.RadauIIA(3, rtol=1e-11), mb.RadauIIA(3, rtol=1e-9), mb.IDA(rtol=1e-10)
    best, *others = (slider(soft(play).simulate(turn * t_end, solver=solver)) for solver in solvers)
    return [np.max(np.abs(x - best)) for x in others]


def ensemble(play="BC", members=MEMBERS, rtol=1e-8):
    """Steel: runs whose clearances differ by SPREAD (standard deviation)."""
    chance = np.random.default_rng(1)
    return [soft(play, STEEL, CLEARANCE + SPREAD * x).simulate(t_end, solver=mb.RadauIIA(3, rtol=rtol))
            for x in chance.standard_normal(members)]


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
    single = run()
    both, total = single["BC"][1], single["B"][1] + single["C"][1]
    print("soft contact: deviation of the slider from ideal joints, m: "
          + ", ".join(f"{NAMES[play]} {np.max(np.abs(d)):.2e}" for play, (_, d) in single.items())
          + f"; both less the sum of the single ones {np.max(np.abs(both - total)):.2e}")
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
          xlim=(0.33, 0.53), ylim=(0, 13))
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
    folder.mkdir(parents=True, exist_ok=True)
    picture(*report(), folder / "slider_crank_steel.png")
