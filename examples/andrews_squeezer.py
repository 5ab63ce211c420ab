r"""Andrews' squeezing mechanism, the seven-body benchmark of the test set for initial value problems.

A constant torque turns the crank K1 against a spring; seven planar bodies and four loops leave one freedom. The
accelerations reach 1e8 rad/s^2 within 30 ms. Every body is drawn from the published angles

    beta, beta + Theta, gamma, Phi + delta, delta, Omega + epsilon, epsilon

of K1 ... K7 and the published positions of the centres of mass; ten hinges of two equations each (three of them in E,
where four bodies meet) replace the six loop equations of the original.

Test set: Mazzia and Magherini, problem "Andrews' squeezing mechanism"; data after Hairer and Wanner, VII.7.

Run it:  mbdae compare examples/andrews_squeezer.py
"""

import numpy as np

import mbdae as mb

BETA, THETA, GAMMA, PHI, DELTA, OMEGA, EPSILON = START = (
    -0.06171389001427645, 0.0, 0.45527981916307037, 0.22266839016588588, 0.48736497954384256, -0.22266839016588588,
    1.2305474445498212)  # rad
A, B, C = np.array([-0.06934, -0.00227]), np.array([-0.03635, 0.03273]), np.array([0.014, 0.072])  # m, fixed points
MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.0705, 0.00706, 0.05498)  # kg
INERTIAS = (2.194e-6, 4.41e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)  # kg m^2
STIFFNESS, NATURAL, TORQUE = 4530.0, 0.07785, 0.033  # N/m, m, N m

t_end = 0.03  # s
measure = "O.angle"


def turned(angle, x, y):
    """(x, y) turned by an angle in rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * x - s * y, s * x + c * y])


def scene():
    """Seven rigid bodies at rest, hinged in O, F, E (four bodies), G, H, A and B."""
    s = mb.Scene("Andrews' squeezer")
    b, bt, pd, oe = BETA, BETA + THETA, PHI + DELTA, OMEGA + EPSILON
    F = turned(b, 0.007, 0)
    E = F - turned(bt, 0.028, 0)
    G, H = A + turned(DELTA, 0.04, 0), A + turned(EPSILON, 0, -0.04)
    centres = (turned(b, 0.00092, 0), F - turned(bt, 0.0115, 0), B + turned(GAMMA, 0.01043, -0.01874),
               G + turned(pd, 0, -(0.02 - 0.01421)), A + turned(DELTA, 0.02308, 0.00916),
               H + turned(oe, 0.02 - 0.01421, 0), A + turned(EPSILON, -0.00449, -0.01228))
    K = [s.rigid_body(f"K{i + 1}", m, J, at=c) for i, (m, J, c) in enumerate(zip(MASSES, INERTIAS, centres, strict=True))]
    s.revolute("O", s.ground, K[0], at=(0, 0), torque=TORQUE)
    s.revolute("F", K[0], K[1], at=F)
    for i in (2, 3, 5):
        s.revolute(f"E{i + 1}", K[1], K[i], at=E)
    s.revolute("G", K[3], K[4], at=G)
    s.revolute("H", K[5], K[6], at=H)
    s.revolute("A5", s.ground, K[4], at=A)
    s.revolute("A7", s.ground, K[6], at=A)
    s.revolute("B", s.ground, K[2], at=B)
    s.spring("spring", s.ground, K[2], at_k=C, at_l=B + turned(GAMMA, 0.02, -0.018),
             stiffness=STIFFNESS, length=NATURAL)
    return s


def published_angles(result):
    """(nt, 7) beta, Theta, gamma, Phi, delta, Omega, epsilon in rad."""
    a = {name: result[name].angle for name in ("O", "F", "B", "G", "A5", "H", "A7")}
    changes = (a["O"], a["F"], a["B"], -a["G"], a["A5"], -a["H"], a["A7"])
    return np.stack(changes, axis=1) + START


def run():
    """The 30 ms of the test set."""
    return scene().simulate(t_end, accuracy=1e-7)


def number(r):
    """Angle beta of the crank at the end, rad."""
    return published_angles(r)[-1, 0], 15.81077119629904


def picture(r):
    """Angle of the crank, and the force in its bearing."""
    return r.plot("O.angle", "O.force")
