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
COLOURS = {"B": "tab:blue", "C": "tab:orange", "BC": "tab:green"}

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


def run():
    """Deviations with play at one pin, the other, and both."""
    return deviations()


def number(found):
    """Largest deviation of the slider with play at both pins, mm; expected by IDA with a looser tolerance."""
    ideal, loose = (slider(scene(play).simulate(t_end, solver=mb.IDA(rtol=1e-8))) for play in ("", "BC"))
    return 1e3 * np.max(np.abs(found["BC"][1])), 1e3 * np.max(np.abs(loose - ideal))


def picture(found):
    """Deviation of the slider with play at one pin, the other, and both, and the path of the crank pin in its race."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 4), layout="constrained")
    a, b = figure.subplots(1, 2)
    for play, (r, deviation) in found.items():
        a.plot(r.t / t_end, 1e3 * deviation, label=NAMES[play], color=COLOURS[play])
    a.set(title="slider against ideal joints", xlabel="turns", ylabel="deviation [mm]")
    a.legend(fontsize="small")
    at, angle = found["BC"][0](np.linspace(0, t_end, 2001)), np.linspace(0, 2 * np.pi, 200)
    for joint in "BC":
        b.plot(*(1e3 * at[joint].orbit.T), label=NAMES[joint], color=COLOURS[joint], lw=1)
    b.plot(1e3 * CLEARANCE * np.cos(angle), 1e3 * CLEARANCE * np.sin(angle), "k--", lw=1, label="contact begins")
    b.set(title="both: centre of the pin in its race", xlabel="[mm]", ylabel="[mm]", aspect="equal", ylim=(-1.15, 0.8))
    b.legend(fontsize="small", loc="lower center", ncols=2)
    return figure
