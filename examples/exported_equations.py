r"""Equations that leave mbdae: a double pendulum integrated by SciPy from its right-hand side in SymPy.

Two links hang from each other by recursive joints, so that the angles are all the unknowns and the equations are
y' = f(t, y, p). `mb.export` gives f as the operations that mbdae integrates itself, with masses and damping as inputs p:

    export = mb.export(scene(), format="sympy")
    steps, outputs = export["rates"]          # as sympy.cse returns them

With format="c" the same functions are C99 that needs libm alone, with format="casadi" a casadi.Function. The run of
`Scene.simulate` is the check: both integrate the same f, so the angles agree to the accuracy of the two methods.

Run it:  mbdae run examples/exported_equations.py --out out
"""

import numpy as np
import sympy
from scipy.integrate import solve_ivp

import mbdae as mb

t_end = 2.0  # s
measure = "elbow.angle"


def scene(mass=1.0):
    """Two links drawn horizontally, damped in the elbow; mass: kg, of each."""
    s = mb.Scene("double pendulum", gravity=(0, -9.81, 0))
    upper = s.link("upper", (0, 0), (0.5, 0), mass=mass)
    lower = s.link("lower", (0.5, 0), (1, 0), mass=mass)
    s.revolute("shoulder", s.ground, upper, at=(0, 0), model=mb.Recursive())
    s.revolute("elbow", upper, lower, at=(0.5, 0), model=mb.Recursive(), damper=0.05)
    return s


def right_hand_side(export):
    """f(t, y, p) as a function of numbers, from the steps and outputs in SymPy."""
    steps, outputs = export["rates"]
    vectors = sympy.Symbol("t"), *(sympy.symbols(f"{name}:{len(export.inputs[name])}") for name in ("y", "p"))
    return sympy.lambdify(vectors, list(outputs), cse=lambda expressions: (steps, expressions))


def by_scipy(mass=1.0):
    """Angle of the elbow (rad) at t_end by SciPy, for another mass of the links than the exported scene has."""
    export = mb.export(scene(), format="sympy")
    f = right_hand_side(export)
    y0 = [entry.value for entry in export.inputs["y"]]
    p = [entry.value for entry in export.inputs["p"]]
    names = [entry.name for entry in export.inputs["p"]]
    for body in ("upper", "lower"):
        p[names.index(f"{body}.Jzz")] *= mass / p[names.index(f"{body}.mass")]  # the inertia of a link goes with its mass
        p[names.index(f"{body}.mass")] = mass
    run = solve_ivp(lambda t, y: f(t, y, p), (0, t_end), y0, rtol=1e-10, atol=1e-12)
    return float(run.y[[entry.name for entry in export.inputs["y"]].index("elbow.angle"), -1])


def run():
    """Two seconds by mbdae."""
    return scene().simulate(t_end, accuracy=1e-9)


def number(r):
    """Angle of the elbow after two seconds by SciPy, rad; expected by mbdae."""
    return by_scipy(), r["elbow"].angle[-1]


def picture(r):
    """Angles of shoulder and elbow."""
    return r.plot("shoulder.angle", "elbow.angle")


if __name__ == "__main__":
    for mass in (1.0, 0.2):
        own = scene(mass).simulate(t_end, accuracy=1e-9)["elbow"].angle[-1]
        other = by_scipy(mass)
        print(f"mass {mass} kg: {other:.9f} rad by SciPy, {own:.9f} rad by mbdae, apart by {np.abs(other - own):.1e}")
