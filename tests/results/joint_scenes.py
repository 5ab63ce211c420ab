"""Joints of a user's own, and scenes with every joint that has coordinates."""

from __future__ import annotations

import mbdae as mb

MODELS = [mb.Kinematic(), mb.Classical(), mb.Recursive()]


class Slot(mb.Joint):
    """A pin that slides along x and turns about z."""

    coordinates = mb.params(travel="m", angle="rad")

    def motion(self, from_k):
        return from_k.along("x", self.travel).about("z", self.angle)


class Dial(mb.Joint):
    """A revolute joint that states rows and motion, but does not read its angle from the bodies."""

    coordinates = mb.params(angle="rad")

    def motion(self, from_k):
        return from_k.about("z", self.angle)

    def constraints(self, k, l):
        d = l.r - k.r
        return {"x": d[0], "y": d[1], "z": d[2], "tilt_y": k.z @ l.x, "tilt_x": k.z @ l.y}


def every_joint(model: mb.JointModel | None = None) -> mb.Scene:
    """One body on the ground by every joint with coordinates, with options by coordinate."""
    s = mb.Scene("every joint", gravity=(0, 1.0, -9.81))
    at = [(2.0 * i, 0.0, 0.3) for i in range(8)]
    b = [s.rigid_body(f"b{i}", 1.0, (0.02, 0.05, 0.04), at=(x + 0.5, y, z)) for i, (x, y, z) in enumerate(at)]
    s.revolute("R", s.ground, b[0], at=at[0], axis=(0, 1, 0), spring=2.0, rate0=8.0, model=model)
    s.prismatic("P", s.ground, b[1], at=at[1], axis=(1, 0, 0), position=0.1 * mb.t**2, model=model)
    s.cylindrical("C", s.ground, b[2], at=at[2], axis=(1, 0, 0), spring={"displacement": 50.0, "angle": 2.0}, model=model,
                  start={"angle": 7.0}, prescribed={"displacement": 0.1 * mb.t})
    s.screw("H", s.ground, b[3], at=at[3], axis=(1, 0, 0), lead=0.2, damper=0.1, start_rate=9.0, model=model)
    s.universal("U", s.ground, b[4], at=at[4], axis=(1, 0, 0), axis_l=(1, 0, 0.2), pin=(0, 1, 0),
                damper={"angle_l": 0.1}, model=model)
    s.planar("E", s.ground, b[5], at=at[5], axis=(0, 0, 1), axis_x=(0, 1, 0), load={"x": 1.0, "angle": 0.3}, model=model)
    s.joint(Slot, "S", s.ground, b[6], at=at[6], axis=(0, 1, 0), axis_x=(1, 0, 0), spring={"travel": 20.0},
            start_rate={"angle": 3.0}, model=model)
    s.add(mb.Revolute("A", s.ground, b[7], at=at[7], axis=(0, 1, 0)), model=model)
    return s
