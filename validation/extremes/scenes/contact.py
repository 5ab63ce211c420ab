"""A slider-crank with play in its crank pin: clearance to 1e-8 m, contact stiffness, speed, friction that changes ever faster."""

import mbdae as mb

CRANK, ROD, PIN = 0.05, 0.12, 0.01  # m
RATE = 20.0  # rad/s

t_end = 0.08  # s, a quarter of a turn
accuracy = 1e-4
vary = {
    "B.clearance": (1e-8, 1e-3),
    "B.stiffness": (1e6, 1e14),
    "A.speed": [1e1, 1e4],
    "v_c": [1e-1, 1e-3, 1e-6, 1e-8],
    "accuracy": [1e-3, 1e-5],
    "step": [1e-3, 1e-5, 1e-7, 1e-9],
}


def scene(v_c=None):
    """Crank driven, soft contact; v_c: velocity (m/s) within which Coulomb friction changes its sense, None for none."""
    s = mb.Scene("slider-crank with play")
    a, b = (CRANK, 0), (CRANK + ROD, 0)
    s.link("crank", (0, 0), a, mass=0.3)
    s.link("rod", a, b, mass=0.5)
    s.rigid_body("slider", 1.5, 1e-3, at=b)
    friction = mb.Coulomb(0.1, v_c) if v_c is not None else None
    s.revolute("A", s.ground, "crank", at=(0, 0), angle=RATE * mb.t)
    s.revolute("B", "crank", "rod", at=a, model=mb.Clearance(PIN + 1e-4, PIN, mb.Hertz(1e9, 0.3), friction))
    s.revolute("C", "rod", "slider", at=b)
    s.prismatic("D", s.ground, "slider", at=b, axis=(1, 0, 0))
    return s
