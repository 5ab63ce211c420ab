"""The torques that an arm needs along a path, by inverse dynamics of its tree and by a run with drives.

Every joint turns from 0 to its goal within T by the quintic of least jerk, q = goal (10 x^3 - 15 x^4 + 6 x^5), x = t / T, which
begins and ends without rate and acceleration. At both ends the torques therefore hold the weight alone. `torques` asks the tree
for all times in one call; the run, with the joints driven along the path, finds the same as the moments of its drives.

A file of a robot gives such a scene by mb.read_urdf("robot.urdf"); `s.write_mjcf("arm.xml")` writes it for MuJoCo (extra robots).

Run it:  mbdae run examples/robot_arm.py --out out
"""

import numpy as np

import mbdae as mb

NAMES, GOALS = ("base", "shoulder", "elbow"), np.array([1.2, 0.8, -1.5])  # rad
T = 1.5  # s

t_end = T
measure = "shoulder.drive"


def scene(driven=True):
    """Base about the vertical, shoulder and elbow about horizontal axes; a tool at the end."""
    s = mb.Scene("robot arm", gravity=(0, 0, -9.81))
    x = mb.t / T
    column = s.rigid_body("column", 4.0, (0.02, 0.02, 0.012), at=(0, 0, 0.15), shape=mb.Cylinder(radius=0.06, length=0.3))
    upper = s.rigid_body("upper", 3.0, (0.004, 0.05, 0.05), at=(0.2, 0, 0.3), shape=mb.Box(size=(0.4, 0.07, 0.07)))
    lower = s.rigid_body("lower", 1.5, (0.002, 0.02, 0.02), at=(0.58, 0, 0.3), shape=mb.Box(size=(0.36, 0.05, 0.05)))
    bodies, axes = (s.ground, column, upper, lower), ((0, 0, 1), (0, 1, 0), (0, 1, 0))
    for i, at in enumerate([(0, 0, 0), (0, 0, 0.3), (0.4, 0, 0.3)]):
        path = GOALS[i] * (10 * x**3 - 15 * x**4 + 6 * x**5) if driven else None
        s.revolute(NAMES[i], bodies[i], bodies[i + 1], at=at, axis=axes[i], angle=path)
    s.frame("tool", lower, at=(0.76, 0, 0.3))
    return s


def path(t):
    """Angles, rates and second rates (n, 3) at times t (n,)."""
    x = np.asarray(t)[:, None] / T
    return (GOALS * (10 * x**3 - 15 * x**4 + 6 * x**5), GOALS * (30 * x**2 - 60 * x**3 + 30 * x**4) / T,
            GOALS * (60 * x - 180 * x**2 + 120 * x**3) / T**2)


def torques(t):
    """Torques of the joints (n, 3), N m, at times t (n,)."""
    return scene(driven=False).tree().inverse_dynamics(*path(t))


def run():
    """The arm driven along its path."""
    return scene().simulate(t_end, accuracy=1e-8)


def number(r):
    """Largest torque of the shoulder by the tree, N m; expected by the drive of the run."""
    return np.max(np.abs(torques(r.t)[:, 1])), np.max(np.abs(r["shoulder"].drive))


def picture(r):
    """Torques of the drives."""
    return r.plot(*(f"{name}.drive" for name in NAMES))


if __name__ == "__main__":
    r = scene().simulate(t_end, accuracy=1e-8)
    tree, wanted = scene(driven=False).tree(), torques(r.t)
    for name, column in zip(NAMES, wanted.T, strict=True):
        off = np.max(np.abs(r[name].drive - column))
        print(f"{name}: at most {np.max(np.abs(column)):.3f} N m; the run differs by {off:.1e} N m")
    q, v, _ = path(r.t)
    speed = np.linalg.norm(np.einsum("nij,nj->ni", tree.jacobian("tool", q)[:, :3], v), axis=1)
    print(f"tool: at most {np.max(speed):.3f} m/s")
