"""Trees that are evaluated joint by joint: every joint, option, root and kind of load."""

import numpy as np
import symengine as se

import mbdae as mb

R = mb.Recursive()


class Crooked(mb.Joint):
    """A user's joint: l turns about z and climbs by the sine of twice the angle, then slides along a slanted axis."""

    params = mb.params(height=("m", "height of the climb"))
    coordinates = mb.params(angle=("rad", "turn"), slide=("m", "slide"))

    def motion(self, from_k):
        return from_k.about("z", self.angle).along("z", self.height * se.sin(2 * self.angle)).along((1, 2, 2), self.slide)


class Cubic(mb.Force):
    """A user's force: a cubic spring between two points."""

    params = mb.params(stiffness=("N/m^3", "stiffness"))

    def energy(self, k, l):
        d = l.r - k.r
        return self.stiffness * (d @ d) ** 2 / 4


def body(s, name, rng):
    return s.rigid_body(name, rng.uniform(0.5, 2), rng.uniform(0.2, 0.3, 3), at=rng.normal(size=3))


def of_every_joint(root_free=False):
    """Every joint of the library with its options and a user's own, some with the moving body as k."""
    rng = np.random.default_rng(3)
    s = mb.Scene("every joint", gravity=(0.3, -1, -9.81))
    bodies = [body(s, "root", rng)] if root_free else [s.ground]

    def add(name, make, reverse=False, parent=None):
        child, k = body(s, name, rng), bodies[-1 if parent is None else parent]
        make(f"J{name}", *((child, k) if reverse else (k, child)), rng.normal(size=3), rng.normal(size=3))
        bodies.append(child)
        return child

    add("a", lambda n, k, l, at, z: s.revolute(n, k, l, at, z, model=R, damper=0.3, spring=2.0, torque=se.sin(3 * mb.t) * 1))
    add("b", lambda n, k, l, at, z: s.spherical(n, k, l, at, model=R))
    add("c", lambda n, k, l, at, z: s.prismatic(n, k, l, at, z, model=R, spring=30.0, damper=1.3), True)
    add("d", lambda n, k, l, at, z: s.cylindrical(n, k, l, at, z, model=R, damper={"angle": 0.2, "displacement": 1.0}))
    add("e", lambda n, k, l, at, z: s.screw(n, k, l, at, z, 0.2, model=R, load=0.4), True)
    add("f", lambda n, k, l, at, z: s.universal(n, k, l, at, z, model=R), parent=2)
    add("g", lambda n, k, l, at, z: s.planar(n, k, l, at, z, model=R, spring={"x": 5.0}))
    add("h", lambda n, k, l, at, z: s.revolute(n, k, l, at, z, model=R, angle=mb.t**2))
    add("i", lambda n, k, l, at, z: s.weld(n, k, l, at))
    last = add("j", lambda n, k, l, at, z: s.joint(Crooked, n, k, l, at=at, axis=z, model=R, height=0.1))
    add("k", lambda n, k, l, at, z: s.revolute(n, k, l, at, z, model=R, limits=(-0.2, 0.4), stop=mb.Stop(3e2, 0.1)), parent=4)
    rubbing = mb.LuGre(mu_k=0.2, mu_s=0.3, v_s=0.1, sigma0=100.0, sigma1=1.0, sigma2=0.1)
    add("l", lambda n, k, l, at, z: s.revolute(n, k, l, at, z, model=R, normal_force=3.0, radius=0.1, friction=rubbing), parent=4)
    at = rng.normal(size=3)
    s.prismatic("Jp", last, s.point_mass("p", 0.7, at=at), at, rng.normal(size=3), model=R)
    s.add(Cubic("between", bodies[3], last, rng.normal(size=3), stiffness=2.0))
    s.add(Cubic("to ground", s.ground, bodies[5], rng.normal(size=3), stiffness=1.0))
    return s


def planar(count=20):
    """A planar tree with springs between bodies that no joint connects, a slider, a free root and a body on its own."""
    rng = np.random.default_rng(5)
    s = mb.Scene("planar", gravity=(0, -9.81, 0))
    root = s.link("root", (0, 0), (1, 0), mass=1.3)
    s.link("alone", (5, 0), (6, 0.5), mass=0.7)
    bodies = [root]
    for i in range(count):
        a = rng.normal(size=2)
        rod = s.link(f"r{i}", a, a + rng.normal(size=2), mass=rng.uniform(0.5, 2))
        parent = bodies[(i + 1) // 2]
        if i % 5 == 4:
            s.prismatic(f"J{i}", parent, rod, a, (*rng.normal(size=2), 0), model=R, spring=40.0)
        else:
            s.revolute(f"J{i}", *((parent, rod) if i % 3 else (rod, parent)), a, model=R, damper=0.1)
        bodies.append(rod)
    s.add(Cubic("between", bodies[3], bodies[-1], (0, 0, 0), stiffness=0.3))
    return s


def chain(count, space="spatial", model=R):
    """A chain of equal bodies on hinges, the odd ones about another axis in space."""
    s = mb.Scene("chain", gravity=(0, -9.81, 0))
    last, flat = s.ground, space == "planar"
    for i in range(count):
        x = 0.1 * i
        if flat:
            rod = s.link(f"b{i}", (x, 0), (x + 0.1, 0), mass=1.0)
        else:
            rod = s.rigid_body(f"b{i}", 1.0, (0.01, 0.02, 0.03), at=(x + 0.05, 0, 0))
        s.revolute(f"j{i}", last, rod, at=(x, 0, 0), axis=(0, 0, 1) if i % 2 or flat else (0, 1, 0.3), model=model)
        last = rod
    return s
