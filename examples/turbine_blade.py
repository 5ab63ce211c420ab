r"""A blade from finite elements on a rotor: the mesh becomes a body of a few modes, which stiffen as it turns.

`mb.read_fe` assembles a mesh of solid elements (here a bar of hexahedra, written by meshio), `craig_bampton` keeps its modes
and the deformations by forces at the root. At rest the first frequency is that of a cantilever, f = 1.8751^2 / (2 pi) sqrt(E I
/ (rho A L^4)). Spun up, the blade bends back, and rings about its new shape.

Needs the extra fe. Run it:  mbdae run examples/turbine_blade.py --out out
"""

import math
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import sympy

import mbdae as mb

LENGTH, WIDTH, THICK, E, NU, RHO, HUB = 0.4, 0.1, 0.008, 3e9, 0.0, 1200.0, 0.05  # m, m, m, Pa, as in theories of beams, kg/m^3, m

t_end = 1.0  # s
measure = "blade.position"
WITHIN = 2e-3  # relative: beams of the theory are infinitely slender


@cache
def blade():
    """The bar with 24 x 2 x 1 elements of order 2, thick along y, reduced to its root and three modes."""
    import meshio

    counts, sizes = np.array([24, 1, 2]), np.array([LENGTH, THICK, WIDTH])
    corners = np.array([(i, j, k) for i in range(25) for j in range(2) for k in range(3)]) / counts * sizes
    corners -= [0, THICK / 2, WIDTH / 2]
    at = lambda i, j, k: (i * 2 + j) * 3 + k  # noqa: E731
    cube = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    cells = [[at(i + a, b, k + c) for a, b, c in cube] for i in range(24) for k in range(2)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "blade.vtk"
        meshio.Mesh(corners, [("hexahedron", np.array(cells))]).write(file)
        solid = mb.read_fe(file, E=E, nu=NU, density=RHO)
    return solid.reduced({"root": lambda x: x[:, 0] < 1e-9}, modes=3, stiffening=True)


def scene(rate=40.0):
    """The hub comes to its rate, rad/s, within 0.2 s."""
    s = mb.Scene("blade on a rotor")
    hub = s.rigid_body("hub", 5.0, (0.1, 0.1, 0.1), at=(0, 0, 0), shape=mb.Cylinder(axis=(0, 0, 1), radius=HUB, length=0.05))
    s.revolute("shaft", s.ground, hub, at=(0, 0, 0), axis=(0, 0, 1), angle=rate * (mb.t - 0.05 * (1 - sympy.exp(-20 * mb.t))))
    s.reduced_body("blade", blade(), at=(HUB, 0, 0), damping=0.01)
    s.weld("root", hub, "blade.root", at=(HUB, 0, 0))
    return s


def run():
    """The rotor comes up."""
    return scene().simulate(t_end, accuracy=1e-4)


def number(r):
    """First frequency of the blade at rest, Hz."""
    found = scene(0.0).linearize().frequencies[0]
    return found, 1.87510407**2 / (2 * math.pi * LENGTH**2) * math.sqrt(E * THICK**2 / 12 / RHO)


def picture(r):
    """Coordinates of the first modes, m."""
    return r.plot("blade.modes.mode1", "blade.modes.mode2")
