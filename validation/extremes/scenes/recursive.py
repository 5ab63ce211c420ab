"""A chain of three bodies in space on recursive joints, one of them sprung: leaf masses down to none, stiffness, speed."""

import mbdae as mb

t_end = 0.5  # s
accuracy = 1e-5
vary = {
    "leaf.mass": [0.0, 1e-9, 1e-3, 1.0, 1e3, 1e9],
    "middle.mass": [1e-9, 1e9],
    "knee.spring": (1e2, 1e14),
    "hip.speed": [1e0, 1e4],
    "accuracy": [1e-3, 1e-5, 1e-7],
    "step": (1e-1, 1e-9),
    "t_end": [5.0],
}


def scene():
    """Three bodies from the ground, axes that are not parallel."""
    s = mb.Scene("chain", gravity=(0, 0, -9.81))
    for i, name in enumerate(("root", "middle", "leaf")):
        s.rigid_body(name, 1.0, (0.02, 0.03, 0.04), at=(0.5 + i, 0, 0))
    s.revolute("hip", s.ground, "root", at=(0, 0, 0), axis=(0, 1, 0), model=mb.Recursive(), rate0=1.0)
    s.revolute("knee", "root", "middle", at=(1, 0, 0), axis=(0, 1, 1), model=mb.Recursive(), spring=1e2)
    s.revolute("ankle", "middle", "leaf", at=(2, 0, 0), axis=(0, 1, 0), model=mb.Recursive())
    return s
