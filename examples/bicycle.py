"""The benchmark bicycle of Meijaard, Papadopoulos, Ruina and Schwab (2007), which is stable by itself from 4.29 to 6.02 m/s.

Its tyres are thin edges that roll without slip. About straight running at a speed v the lean and the steer obey

    M x'' + v C1 x' + (g K0 + v^2 K2) x = 0,

whose four roots are published; at 5 m/s the weave is -0.77534188 +- 4.46486771 i, the capsize -0.32286643, the castering
-14.07838969 1/s. `roots` reads them from the scene. Begun with a lean rate at 4.6 m/s it rights itself.

Run it:  mbdae run examples/bicycle.py --out out
"""

import numpy as np

import mbdae as mb

SPEED, LEAN_RATE = 4.6, 0.5  # m/s, rad/s
TILT, BASE, TRAIL = np.pi / 10, 1.02, 0.08  # rad, m, m

t_end = 3.0  # s
measure = "steer.angle"


def tube(a, b):
    """The picture of a tube between two points, m."""
    way = np.subtract(b, a)
    return mb.Cylinder(at=np.add(a, b) / 2, axis=way, radius=0.02, length=np.linalg.norm(way))


def wheel(radius):
    """The picture of a wheel, m."""
    return mb.Cylinder(axis=(0, 1, 0), radius=radius, length=0.04)


def scene(speed=SPEED, lean_rate=LEAN_RATE):
    """The bicycle upright on the plane z = 0, z down, x ahead."""
    s = mb.Scene("bicycle", gravity=(0, 0, 9.81))

    def body(name, mass, inertia, at, shape, radius=None):
        return s.rigid_body(name, mass, inertia, at=at, velocity=(speed, -lean_rate * at[2], 0), shape=shape,
                            angular_velocity=(lean_rate, -speed / radius if radius else 0, 0))

    rear = body("rear_wheel", 2.0, (0.0603, 0.12, 0.0603), (0, 0, -0.3), wheel(0.3), 0.3)
    front = body("front_wheel", 3.0, (0.1405, 0.28, 0.1405), (BASE, 0, -0.35), wheel(0.35), 0.35)
    frame = body("frame", 85.0, [[9.2, 0, 2.4], [0, 11, 0], [2.4, 0, 2.8]], (0.3, 0, -0.9),
                 [tube((0, 0, -0.3), (0.8, 0, -0.75)), tube((0, 0, -0.3), (0.25, 0, -0.8)),
                  tube((0.25, 0, -0.75), (0.8, 0, -0.75)), mb.Box(at=(0.3, 0, -1.1), size=(0.2, 0.3, 0.6))])
    fork = body("fork", 4.0, [[0.05892, 0, -0.00756], [0, 0.06, 0], [-0.00756, 0, 0.00708]], (0.9, 0, -0.7),
                [tube((BASE, 0, -0.35), (0.78, 0, -0.95)), tube((0.78, -0.25, -0.95), (0.78, 0.25, -0.95))])
    s.revolute("rear_hub", frame, rear, at=(0, 0, -0.3), axis=(0, 1, 0))
    s.revolute("front_hub", fork, front, at=(BASE, 0, -0.35), axis=(0, 1, 0))
    s.revolute("steer", frame, fork, at=(BASE + TRAIL, 0, 0), axis=(np.sin(TILT), 0, np.cos(TILT)))
    s.rolling("rear_tyre", s.ground, rear, at=(0, 0, -0.3), axis=(0, 1, 0), radius=0.3, normal=(0, 0, -1))
    s.rolling("front_tyre", s.ground, front, at=(BASE, 0, -0.35), axis=(0, 1, 0), radius=0.35, normal=(0, 0, -1))
    return s


def roots(speed):
    """Roots of small motions at a speed (m/s), 1/s; those of motions that nothing resists, which are 0, left out."""
    found = scene(speed, 0.0).linearize()
    return found.eigenvalues[found.eigenvalues != 0]


def run():
    """It is hit from the side at 4.6 m/s, and rights itself."""
    return scene().simulate(t_end, accuracy=1e-6)


def number(r):
    """Growth of the weave at 5 m/s, 1/s."""
    found = scene(5.0, 0.0).linearize()
    k = found.eigenvalues.imag.argmax()
    return found.eigenvalues[k].real, -0.77534188219585, found.errors[k]


def picture(r):
    """Steer, and the lean rate."""
    return r.plot("steer.angle", "frame.angular_velocity[0]")


if __name__ == "__main__":
    print(np.round(roots(5.0), 8))
