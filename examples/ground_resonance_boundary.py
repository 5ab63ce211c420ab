r"""The damping that moves the boundary of ground resonance: gradients of one root, against Coleman's equations.

The rotor of ground_resonance_map.py has a least stable root s. Newton's method finds the boundary Re s = 0 along the speed Omega;
the lag dampers c move it by -Re(ds/dc) / Re(ds/dOmega). Of hub z = x + i y and eta = sum of zeta_i exp(i psi_i), Coleman says
    (M + N m) z'' + d z' + k z + i S eta'' = 0,    S = m L/2,    I = m L^2/3,
    I (eta'' - 2 i Omega eta' - Omega^2 eta) + c (eta' - i Omega eta) + Omega^2 S e eta - i N S z''/2 = 0.

Run it:  mbdae run examples/ground_resonance_boundary.py --out out
"""

import ground_resonance_map as rotor
import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

import mbdae as mb

DAMPERS, START = {"lag damper": 600.0, "support damper": rotor.DAMPING}, 28.0  # N m s, N s/m, rad/s
t_end, measure = rotor.t_end, rotor.measure


def scene(speed=START):
    """The rotor, with names for its speed and its two dampers."""
    speed, lag, support = (mb.number(*one) for one in ({"speed": speed} | DAMPERS).items())
    return rotor.scene(speed, (lag,) * rotor.BLADES, damping=support)


def run(speed=START, steps=5):
    """The boundary, rad/s, and by damper what a unit more of it moves the boundary by, with its error."""
    for _ in range(steps):
        mode = max(scene(speed).linearize(frame="hub"), key=lambda mode: mode.growth)
        by = mode.gradient(["speed", *DAMPERS])
        speed -= mode.growth / (slope := by["speed"].value.real)
    rates = {name: -by[name].value.real / slope for name in DAMPERS}
    return speed, {name: (rate, (by[name].error + abs(rate) * by["speed"].error) / abs(slope)) for name, rate in rates.items()}


def boundary(lag=DAMPERS["lag damper"], support=rotor.DAMPING):
    """The speed, rad/s, at which the growth by Coleman's equations vanishes."""
    def growth(speed, S=rotor.M * rotor.L / 2, I=rotor.M * rotor.L**2 / 3, N=rotor.BLADES):
        mass = np.array([[rotor.BLOCK + N * rotor.M, 1j * S], [-0.5j * N * S, I]])
        stiffness = np.diag([rotor.STIFFNESS, speed**2 * (S * rotor.HINGE - I) - 1j * speed * lag])
        rates = -np.linalg.solve(mass, np.hstack([stiffness, np.diag([support, lag - 2j * speed * I])]))
        return np.linalg.eigvals(np.vstack([np.eye(4)[2:], rates])).real.max()
    return brentq(growth, START - 6, START + 6, xtol=1e-13)


def number(found):
    """What a unit more of lag damping moves the boundary by, rad/s over N m s; expected by differences of Coleman's boundary."""
    value, error = found[1]["lag damper"]
    return value, (8 * (boundary(601.0) - boundary(599.0)) - boundary(602.0) + boundary(598.0)) / 12, error


def picture(found, lags=range(300, 1201, 50)):
    """The boundary by Coleman's equations, and the tangent that the gradients give."""
    axes = Figure(layout="constrained").subplots()
    axes.plot(lags, [*map(boundary, lags)])
    axes.axline((DAMPERS["lag damper"], found[0]), slope=found[1]["lag damper"][0], color="k", ls=":")
    axes.set(xlabel="lag damper [N m s]", ylabel="rotor speed on the boundary [rad/s]")
    return axes.figure
