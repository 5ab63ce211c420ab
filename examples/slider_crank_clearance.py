r"""A slider-crank with play at the crank pin, at the piston pin, and at both: soft contact, which converges.

The crank (50 mm) turns at 100 rad/s, the rod is 120 mm long; each pin of radius 10 mm lies in a race 0.5 mm wider, with
Hertz contact, damping 0.5 s/m and Coulomb friction. Pins start in the middle of their races at the speeds of ideal
joints, so the run begins with a short free flight and an impact. Play alone may be at "B" (crank pin), "C" (piston pin)
or "BC"; "" is the mechanism with ideal joints.

Soft contact (1e9 N/m^1.5) is regular: after the first impacts the pins stay on their races, and over a full turn two
tolerances and two methods agree within 1e-8 m. The motion with both clearances is not the sum of the single ones.
Steel, where neighbouring motions part, is in slider_crank_steel.py.

Run it:  mbdae run examples/slider_crank_clearance.py --out out
"""

import numpy as np

import mbdae as mb

CRANK, ROD, RATE = 0.05, 0.12, 100.0  # m, m, rad/s
PIN, CLEARANCE = 0.01, 5e-4  # m
SOFT = 1e9  # N/m^1.5
DAMPING, MU, V_C = 0.5, 0.1, 0.1  # s/m, 1, m/s
MASSES = {"crank": 0.3, "rod": 0.5, "slider": 1.5}  # kg
NAMES = {"B": "crank pin", "C": "piston pin", "BC": "both"}

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


def run():
    """By joints with play, a run and how far the slider is from where ideal joints put it, m (nt,)."""
    ideal = slider(scene("").simulate(t_end, solver=mb.RadauIIA(3, rtol=1e-10)))
    runs = {play: scene(play).simulate(t_end, solver=mb.RadauIIA(3, rtol=1e-9)) for play in NAMES}
    return {play: (r, slider(r) - ideal) for play, r in runs.items()}


def number(found):
    """Largest deviation of the slider with play at both pins, mm; expected by IDA with a looser tolerance."""
    ideal, loose = (slider(scene(play).simulate(t_end, solver=mb.IDA(rtol=1e-8))) for play in ("", "BC"))
    return 1e3 * np.max(np.abs(found["BC"][1])), 1e3 * np.max(np.abs(loose - ideal))


def picture(found):
    """Deviation of the slider with play at one pin, the other, and both, beside the sum of the single ones."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4), layout="constrained")
    axes = figure.subplots()
    turns = found["BC"][0].t / t_end
    for play, (_, deviation) in found.items():
        axes.plot(turns, 1e3 * deviation, label=NAMES[play])
    axes.plot(turns, 1e3 * (found["B"][1] + found["C"][1]), "k:", label="sum of the single ones")
    axes.set(xlabel="turns", ylabel="slider against ideal joints [mm]")
    axes.legend(fontsize="small")
    return figure
