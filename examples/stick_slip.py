r"""Stick and slip: what Coulomb's law, made continuous, cannot show and LuGre's can.

A mass of 1 kg is pressed on a rail by N = 1 N and pulled by a spring, k = 2 N/m, whose other end moves at v_0 = 0.1 m/s; the
parameters are those of Canudas de Wit, Olsson, Astrom and Lischinsky (1995). With mu = tanh(v / v_c) friction never exceeds N:
once the spring pulls with 1 N, at 5 s, the mass slides and swings about the spring's speed for ever,

    m x'' = k (v_0 t - x) - N,    x' = v_0 (1 - cos sqrt(k/m) (t - 5 s)),    largest pull N + v_0 sqrt(k m) = 1.141 N.

The bristles of LuGre's law hold up to mu_s N = 1.5 N, which the spring reaches at 7.5 s, and let go down to mu_k N = 1 N as
soon as the mass moves faster than the Stribeck velocity of 1 mm/s: it jumps ahead by 0.64 m, stops, and sticks until the spring
pulls with 1.5 N again. Before each jump it has moved by no more than micrometres; the jumps come every 6 s.

Options: `friction` "lugre", "coulomb", None or a law. LuGre's damping falls with the speed here (`damping_decay`), so that it
cannot feed energy; the claim lugre_stick_slip of validation/ has constant damping, as in
"Modified models for revolute joints coupling flexibility of links in multibody systems".

Run it:  mbdae run examples/stick_slip.py --out out
"""

import numpy as np

import mbdae as mb

MASS, SPRING, PULL, PRESS = 1.0, 2.0, 0.1, 1.0  # kg, N/m, m/s, N
LAWS = {"lugre": mb.LuGre(mu_k=1.0, mu_s=1.5, v_s=1e-3, sigma0=1e5, sigma1=316.22776601683796, sigma2=0.4),
        "coulomb": mb.Coulomb(mu=1.0, v_c=1e-3)}

t_end = 25.0  # s
measure = "rail.displacement"
WITHIN = 1e-2  # relative, of the number: the mass creeps before it breaks away


def scene(friction="lugre"):
    """Mass, spring and the hand that pulls, along x; the spring has no natural length."""
    s = mb.Scene(f"stick-slip, friction {friction}")
    law = LAWS[friction] if isinstance(friction, str) else friction
    mass, hand = s.rigid_body("mass", MASS, 0.1, at=(0, 0)), s.rigid_body("hand", 1.0, 0.1, at=(1, 0))
    pressed = {"friction": law, "normal_force": PRESS} if law is not None else {}
    s.prismatic("rail", s.ground, mass, at=(0, 0), axis=(1, 0, 0), **pressed)
    s.prismatic("guide", s.ground, hand, at=(1, 0), axis=(1, 0, 0), position=PULL * mb.t)
    s.spring("spring", mass, hand, at_k=(0, 0), at_l=(1, 0), stiffness=SPRING)
    return s


def pull(r):
    """Force of the spring (nt,), N."""
    return SPRING * (r["guide"].displacement - r["rail"].displacement)


def slips(r, faster=0.01):
    """Times (s) at which the mass breaks away: where it gets faster than 0.01 m/s."""
    fast = r["rail"].rate > faster
    return r.t[1:][fast[1:] & ~fast[:-1]]


def largest_pull_coulomb():
    """N + v_0 sqrt(k m), N."""
    return PRESS + PULL * np.sqrt(SPRING * MASS)


def runs(accuracy=1e-5, outputs=5001):
    """Both laws by name."""
    return {name: scene(name).simulate(t_end, accuracy=accuracy, outputs=outputs) for name in LAWS}


run = runs


def number(both):
    """Largest pull of the spring with LuGre's law, N: the force of static friction."""
    return pull(both["lugre"]).max(), LAWS["lugre"].mu_s * PRESS


def picture(both):
    """Motion with both laws."""
    return both["lugre"].plot("rail.displacement", "rail.rate", against=both["coulomb"], labels=["LuGre", "Coulomb"])
