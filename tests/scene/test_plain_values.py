"""What is stated is plain: numbers of every library give the same run, nothing of the user's is kept, mistakes stay."""

# ruff: noqa: E501
from __future__ import annotations

import concurrent.futures as futures
import math
import pickle
import re
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
import symengine as se
import sympy as sp

import mbdae as mb

t = mb.t
KINDS = {"fraction": Fraction, "decimal": Decimal, "float32": np.float32, "int64": np.int64, "0-d array": np.array,
         "SymPy's": sp.Integer, "symengine's": se.Integer, "longdouble": np.longdouble, "float16": np.float16}


class Bowl(mb.Joint):
    """A point on a paraboloid."""

    params = mb.params(radius=("m", "radius at the bottom"))

    def constraints(self, k: Any, l: Any) -> Any:
        d = l.r - k.r
        return {"surface": k.z @ d - ((k.x @ d) ** 2 + (k.y @ d) ** 2) / (2 * self.radius)}


def machine(n: Any) -> mb.Scene:
    """Every number in it is a small whole one, written by n."""
    s = mb.Scene("machine", gravity=(n(0), n(0), n(-9)))
    rod = s.link("rod", (n(0), n(0), n(0)), (n(2), n(0), n(0)), mass=n(2))
    ball = s.rigid_body("ball", n(1), (n(1), n(1), n(1)), at=[n(3), n(0), n(0)], velocity=(n(0), n(0), n(1)))
    bead = s.point_mass("bead", n(1), (n(5), n(0), n(0)), velocity=(n(0), n(1), n(0)))
    s.revolute("R", s.ground, rod, at=(n(0), n(0), n(0)), axis=(n(0), n(2), n(0)), spring=n(3), damper=n(1), torque=n(2) * t,
               angle0=n(0), model=mb.Kinematic(scaling=n(2)))
    s.spherical("S", rod, ball, at=(n(2), n(0), n(0)))
    s.add(Bowl("bowl", s.ground, bead, at=(n(5), n(0), n(0)), axis=(n(0), n(0), n(3)), radius=n(2)))
    s.force("F", ball, (n(1), t, n(0)), at=(n(4), n(0), n(0)))
    s.bushing("B", s.ground, ball, (n(3), n(0), n(0)), np.array([n(1), n(2), n(3)]))
    return s


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_run_bit_by_bit(kind: str) -> None:
    other, plain = machine(KINDS[kind]), machine(float)
    said = [repr(s.statements).replace("'(2*t)'", "'(2.0*t)'") for s in (other, plain)]  # in expressions whole numbers stay whole
    assert said[0] == said[1]
    if kind in ("fraction", "decimal", "float32"):  # one run for each way in: exact, decimal, binary
        a, b = (s.simulate(0.2, accuracy=1e-4) for s in (other, plain))
        assert a.solution.y.tobytes() == b.solution.y.tobytes()


def test_sections_contacts_and_friction_of_fractions() -> None:
    """Values that are calculated with before they are stated are converted first."""
    third, exact = Fraction(1, 3), 1 / 3
    assert mb.Section.tube(third, Fraction(1, 7), third, third, third) == mb.Section.tube(exact, 1 / 7, exact, exact, exact)
    assert mb.Section.circular(np.float32(0.1), 1, 0, 1) == mb.Section.circular(float(np.float32(0.1)), 1, 0, 1)
    assert mb.Hertz.restitution(third, third, third) == mb.Hertz.restitution(exact, exact, exact)
    assert mb.LuGre(third, 1, third, 1e5, third) == mb.LuGre(exact, 1.0, exact, 1e5, exact)
    assert mb.Clearance(third, third, mb.Hertz(1)) == mb.Clearance(exact, exact, mb.Hertz(1.0))


def test_numbers_of_many_digits_in_expressions() -> None:
    s = mb.Scene("s")
    s.link("rod", (0, 0), (1, 0), mass=1)
    s.revolute("R", s.ground, "rod", at=(0, 0), angle=sp.Float("0.1", 50) * t + Fraction(1, 3) * t**2 + Decimal("0.5"))
    assert s.check().degrees_of_freedom == 0
    assert float(s["R"].prescribed["angle"].subs({se.Symbol("t"): 2.0})) == pytest.approx(0.2 + 4 / 3 + 0.5, abs=1e-15)


def test_nothing_of_the_users_is_kept() -> None:
    """Arrays and laws may be used again and changed after a statement."""
    at, axis, R, speed = np.zeros(3), np.array([0.0, 0.0, 2.0]), np.eye(3), np.array([0.0, 1.0, 0.0])
    s = mb.Scene("s", gravity=speed)
    body = s.rigid_body("body", 1.0, R, at=at, rotation=R, velocity=speed)
    place = body.at(at)
    law = Bowl("bowl", s.ground, body, at=at, axis=axis, radius=2.0)
    s.add(law)
    s.weld("W", s.ground, place)
    before = pickle.dumps([s.statements, s.gravity, [(vars(b.drawn), b.inertia) for b in s.bodies],
                           [(c.laws[0].at, c.laws[0].axis) for c in s.connections], s["bowl"].laws[0].radius])
    for a in (at, axis, R, speed, place.point):
        a += 7
    law.radius, law.name, law.l = 9.0, "other", None
    assert before == pickle.dumps([s.statements, s.gravity, [(vars(b.drawn), b.inertia) for b in s.bodies],
                                   [(c.laws[0].at, c.laws[0].axis) for c in s.connections], s["bowl"].laws[0].radius])


def test_one_law_may_be_added_to_two_scenes() -> None:
    law = Bowl("bowl", "ground", "bead", at=(0, 0), radius=1.0)
    scenes = [mb.Scene("a"), mb.Scene("b")]
    for s in scenes:
        s.point_mass("bead", 1.0, (0, 0))
        s.add(law)
    assert [s["bowl"].l is s.bodies[0] for s in scenes] == [True, True]
    assert law.k == "ground"


def test_a_law_takes_two_coordinates_for_its_place_on_l() -> None:
    class Pull(mb.Force):
        params = mb.params(c=("N/m", "stiffness"))

        def energy(self, k: Any, l: Any) -> Any:
            return self.c * ((l.r - k.r) @ (l.r - k.r)) / 2

    s = mb.Scene("s")
    s.add(Pull("P", s.ground, s.link("rod", (0, 0), (1, 0), mass=1), at=(0, 0), at_l=(1, 0), c=1))
    assert s["P"].laws[0].at_l.tolist() == [1, 0, 0]
    assert s.check().degrees_of_freedom == 3


def wrong() -> mb.Scene:
    s = mb.Scene("s")
    s.link("rod", (0, 0), (1, 0), mass="heavy")
    s.revolute("R", s.ground, "rod", at=(0, 0), spring=None)
    return s


@pytest.mark.parametrize("use", [
    lambda s: s.check(), lambda s: s.simulate(1.0), lambda s: s.draw(), lambda s: s.system(), lambda s: s.equilibrium(),
    lambda s: s.linearize(), lambda s: s.replace(model=mb.Classical()), lambda s: s.recursive(), lambda s: mb.report(s),
])
def test_what_was_wrong_stays(use: Any) -> None:
    with pytest.raises(mb.SceneError, match="link 'rod': mass = 'heavy' is not a number; give a number from 0 in kg"):
        use(wrong())


def test_a_statement_that_python_refuses_leaves_nothing_behind() -> None:
    s = mb.Scene("s")
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    for said, words in ((lambda: s.revolute("R", s.ground, rod, at=(0, 0), sping=1.0), "Scene.revolute() has no argument 'sping': "
                         "did you mean 'spring'? its arguments are name, k, l, at, axis"),
                        (lambda: s.revolute("R", s.ground, rod), "Scene.revolute(): missing a required argument: 'at'"),
                        (lambda: s.weld("R", s.ground, rod, (0, 0), (1, 1), 3), "Scene.weld(): too many positional arguments"),
                        ):
        with pytest.raises(TypeError, match=re.escape(words)):
            said()
    assert (len(s.statements), len(s.connections), s.problems) == (1, 0, [])


def test_bodies_of_another_scene_are_named_as_such() -> None:
    other = mb.Scene("other")
    bar = other.link("bar", (0, 0), (1, 0), mass=1)
    s = mb.Scene("s")
    rod = s.link("rod", (0, 0), (1, 0), mass=1)
    s.revolute("R", other.ground, rod, at=(0, 0))
    s.spring("S", rod, bar.at(0.5), (0, 0), (0, 0), 1.0)
    variant = mb.Scene("s")
    s.force("F", variant.ground, (1, 0))
    s.weld("W", bar, "rod")
    assert s.problems == [
        "revolute 'R': k = the ground of scene 'other', not of this scene; use s.ground",
        "spring 'S': l = body 'bar' of scene 'other', not of this scene; this one has 'ground', 'rod'",
        "force 'F': body = the ground of another scene 's', not of this scene; use s.ground",
        "weld 'W': k = body 'bar' of scene 'other', not of this scene; this one has 'ground', 'rod'",
    ]


# ---- NumPy's and Python's functions of mb.t ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("by_numpy", "by_sympy"),
    [
        (lambda: np.sin(t), sp.sin(t)), (lambda: np.sin(2 * t + 1), sp.sin(2 * t + 1)), (lambda: 2 * np.exp(-t), 2 * sp.exp(-t)),
        (lambda: np.tanh(np.cos(3 * t)), sp.tanh(sp.cos(3 * t))), (lambda: np.abs(t - 1), sp.Abs(t - 1)), (lambda: abs(t), sp.Abs(t)),
        (lambda: np.sqrt(t**2 + 1), sp.sqrt(t**2 + 1)), (lambda: np.arctan(t), sp.atan(t)), (lambda: np.log10(t), sp.log(t) / sp.log(10)),
        (lambda: np.floor(2 * t), sp.floor(2 * t)), (lambda: math.ceil(t), sp.ceiling(t)), (lambda: np.mod(t, 2), sp.Mod(t, 2)),
        (lambda: np.float64(2) * t, 2.0 * t), (lambda: np.square(t), t**2), (lambda: np.hypot(t, 1), sp.sqrt(t**2 + 1)),
    ],
)
def test_numpys_functions_work(by_numpy: Any, by_sympy: Any) -> None:
    assert by_numpy() == by_sympy


@pytest.mark.parametrize("use", [
    lambda: math.sin(t), lambda: math.sin(2 * t), lambda: float(t), lambda: np.maximum(t, 0), lambda: np.where(t > 1, 1, 0),
    lambda: 1 if 2 * t > 1 else 0, lambda: max(t, 1), lambda: np.sign(t - 1), lambda: np.clip(t, 0, 1), lambda: np.round(t),
    lambda: np.asarray([t, 0], dtype=float), lambda: np.interp(t, [0, 1], [0, 1]),
])
def test_what_needs_a_value_says_what_to_write(use: Any) -> None:
    with pytest.raises(mb.OptionError, match=r"write .*sympy\.") as caught:
        use()
    assert isinstance(caught.value, TypeError)  # as SymPy has it


def test_the_time_stays_the_symbol_t() -> None:
    assert t == sp.Symbol("t")
    assert pickle.loads(pickle.dumps(t)) == t
    assert sp.diff(np.sin(2 * t), t) == 2 * sp.cos(2 * t)
    assert np.sin(t).subs(t, 0) == 0
    with pytest.raises(TypeError, match="Cannot convert expression to float") as caught:
        float(sp.Symbol("w"))
    assert not isinstance(caught.value, mb.MbdaeError)


def test_arrays_of_expressions_and_functions_of_python() -> None:
    s = mb.Scene("s")
    s.rigid_body("rod", 1, (1, 1, 1))
    s.force("F", "rod", np.array([np.sin(t), 0, 1]))
    assert s.check().degrees_of_freedom == 6
    s.revolute("R", s.ground, "rod", at=(0, 0), angle=lambda t: 2 * t)
    s.force("G", "rod", [0, math.sin])
    found = s.problems
    assert "revolute 'R': angle = <function" in found[0]
    for problem in found:
        assert "is a function of Python: write what it returns as an expression of mb.t" in problem
    s = mb.Scene("s")
    s.rigid_body("rod", 1, (1, 1, 1))
    values = {"P": sp.Piecewise((1, t < 1)), "Q": t > 1, "R": 10**400 * t, "S": sp.Integral(sp.sin(t), t), "T": sp.Matrix([t]),
              "U": sp.Symbol("w") * t, "V": sp.I * t, "W": sp.zoo * t, "X": sp.Function("f")(t)}
    for name, value in values.items():
        s.torque(name, "rod", (0, 0, value))
        assert s.problems.pop().startswith(f"torque '{name}': value[2] = "), name
        assert not s.problems


def test_what_is_set_after_a_statement_is_refused_or_followed():
    """A body's number or a joint's would be ignored; gravity and name of a scene are read whenever it is used."""
    s = mb.Scene("late", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), damper=0.1)
    for item, name in (("rod", "mass"), ("rod", "inertia"), ("hinge", "damper"), ("hinge", "model"), ("ground", "anything")):
        with pytest.raises(AttributeError, match=rf"'{item}': {name} = 5.0 comes after its statement, .* mb.sweep\(scene, "):
            setattr(s[item], name, 5.0)
    for array in (s["rod"].inertia, s["rod"].drawn.position, s.gravity):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(AttributeError, match=r"^scene 'late': did you mean 'gravity'\? gravty = 5 would have no effect"):
        s.gravty = 5
    for name, value in (("gravity", "down"), ("gravity", (1, 2, 3, 4)), ("space", "curved"), ("name", 3)):
        with pytest.raises(mb.SceneError, match=rf"^1 problem in the scene:\n  - scene 'late': {name} = "):
            setattr(s, name, value)
    s.gravity = 0, 0
    assert abs(s.simulate(0.1)["hinge"].angle[-1]) < 1e-12
    assert mb.sweep(s, {"rod.mass": [2.0]}, futures.ThreadPoolExecutor(1), t_end=0.1).array("hinge.angle")[0, -1] == 0
