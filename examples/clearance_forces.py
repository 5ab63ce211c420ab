r"""Joint forces by clearance: what a wider race does to the force at the crank pin of slider_crank_clearance.py.

The pin flies through its play and hits the race; the wider the race of radius R, the later and the faster. The derivative of the
force over time, dF/dR, is large in every impact, because the instant of the impact moves; that of the mean square of the force
over the first quarter of a turn, with six contacts, says what play costs.

Steps end where pin and race touch and part, and move with these instants. Expected are differences of order 6 of runs with
other races, by the other method, which know nothing of that.

Run it:  mbdae run examples/clearance_forces.py --out out
"""

import slider_crank_clearance as crank

import mbdae as mb

RADIUS = "B.model.outer"  # of the race
SQUARE = mb.integral("B.force[0]**2 + B.force[1]**2")
APART = 1e-6  # m, of races in differences

t_end, measure = 0.25 * crank.t_end, crank.measure


def scene(clearance=crank.CLEARANCE):
    """Play at the crank pin alone."""
    return crank.scene("B", clearance=clearance)


def run():
    """A quarter of a turn."""
    return scene().simulate(t_end, accuracy=1e-7, derivatives=True)


def expected(solver=None):
    """Derivative of the mean square, N^2 per mm of radius, by differences."""
    runs = {k: scene(crank.CLEARANCE + k * APART).simulate(t_end, solver=solver or mb.DOP853(rtol=1e-12))
            for k in (-3, -2, -1, 1, 2, 3)}
    square = {k: SQUARE.value(r) / t_end for k, r in runs.items()}
    return 1e-3 / (60 * APART) * sum(w * (square[k] - square[-k]) for k, w in {1: 45, 2: -9, 3: 1}.items())


def number(r):
    """Derivative of the mean square of the force, N^2 per mm of radius."""
    found = r.gradient(SQUARE, to=RADIUS)[RADIUS]
    return 1e-3 * found.value / t_end, expected(), 1e-3 * found.error / t_end


def picture(r):
    """The force at the pin, and its derivative by the radius of the race."""
    from matplotlib.figure import Figure

    upper, lower = (figure := Figure(figsize=(6.4, 5), layout="constrained")).subplots(2, sharex=True)
    by = r.sensitivity("B.force", to=RADIUS)["B.force", RADIUS]
    upper.plot(1e3 * r.t, r["B"].force[:, :2], label=["$F_x$", "$F_y$"])
    lower.plot(1e3 * r.t, 1e-6 * by.value[:, :2])
    upper.set(ylabel="force at the pin [N]")
    lower.set(xlabel="t [ms]", ylabel=f"dF/d(race) [N/um], ±{1e-6 * by.error:.1g}")
    upper.legend(loc="lower right")
    return figure
