"""Mistakes inside a user's law class: told with class, method, value and what to write, not as an error of mbdae's own code."""

# ruff: noqa: E501
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import symengine as se
import sympy as sp

import mbdae as mb
from mbdae.symbolic.frames import NodeKind, make_frame


def joint(**methods: Any) -> type[mb.Joint]:
    return type("Bowl", (mb.Joint,), {"params": mb.params(radius=("m", "radius")), **methods})


def force(**methods: Any) -> type[mb.Force]:
    return type("Pull", (mb.Force,), {"params": mb.params(stiffness=("N/m", "stiffness")), **methods})


def told(law: type[Any], **values: Any) -> str:
    s = mb.Scene("own")
    s.rigid_body("rod", 1.0, (1.0, 1.0, 1.0))
    s.add(law("J", s.ground, "rod", at=(0, 0, 1), **({"radius": 1.0} if issubclass(law, mb.Joint) else {"stiffness": 1.0}) | values))
    with pytest.raises(mb.SceneError) as caught:
        s.check()
    (problem,) = caught.value.problems
    return problem


ROWS: list[tuple[Callable[..., Any], str]] = [
    (lambda self, k, l: [k.x @ l.y], "Bowl.constraints returns [k_x1*l_y1 + k_x2*l_y2 + k_x3*l_y3], which is no dictionary; return "
                                     "{'name': expression, ...}; it must return a dictionary of rows that vanish"),
    (lambda self, k, l: k.x @ l.y, "which is no dictionary"), (lambda self, k, l: None, "Bowl.constraints returns None"),
    (lambda self, k, l: {1: k.x @ l.y}, "Bowl.constraints returns the name 1; names are text"),
    (lambda self, k, l: {"a": "x"}, "Bowl.constraints returns 'a' = 'x', which is no expression"),
    (lambda self, k, l: {"a": l.r - k.r}, "Bowl.constraints returns 'a' = Vec("),
    (lambda self, k, l: {"a": math.nan}, "Bowl.constraints returns 'a' = nan, which is no real, finite number"),
    (lambda self, k, l: {"a": True}, "'a' = True, which is no expression"), (lambda self, k, l: {"a": 1j}, "'a' = 1j, which is no"),
    (lambda self, k, l: {"a": l.r[0] > 0}, "which is no expression"), (lambda self, k, l: {"a": np.ones(3)}, "which is no expression"),
    (lambda self, k, l: {"a": l.q @ k.x}, "Bowl.constraints fails: "),
    (lambda self, k, l: {"a": l.position @ k.x}, "'Frame' object has no attribute 'position'; a frame has r (point), v (its velocity)"),
    (lambda self, k, l: {"a": self.length * l.r[0]}, "Bowl.constraints fails: AttributeError: 'Bowl' object has no attribute 'length'; "
                                                     "its coordinates, parameters, options and states: radius; declare others"),
    (lambda self, k, l: {"a": se.Symbol("w") * l.r[0]}, "row 'a' of Bowl contains the symbol w, which it does not declare; write params "
                                                        "= mb.params(w=('unit', 'meaning')) and self.w"),
    (lambda self, k, l: {"a": math.sin(l.r[0])}, "Bowl.constraints fails: "), (lambda self, k, l: {"a": np.sin(l.r[0])}, "se.sin(x)"),
    (lambda self, k, l: {"a": 1 / 0}, "Bowl.constraints fails: ZeroDivisionError: division by zero"),
    (lambda self, k: {"a": k.x[0]}, "Bowl.constraints fails: TypeError"),
    (lambda self, k, l: {"a": mb.t * l.r[0]}, "row 'a' of Bowl contains mb.t: state a parameter"),
    (lambda self, k, l: {"a": l.r[0] if l.r[0] > 1 else 0}, "Bowl.constraints fails: "),
]


@pytest.mark.parametrize(("rows", "words"), ROWS)
def test_rows_of_a_joint(rows: Callable[..., Any], words: str) -> None:
    problem = told(joint(constraints=rows))
    assert problem.startswith("'J': ")
    assert words in problem


def test_a_parameter_left_out_is_named() -> None:
    law = joint(constraints=lambda self, k, l: {"a": self.radius * l.r[0]})
    assert "radius is left out (None) here: give a value" in told(law, radius=None)


@pytest.mark.parametrize(
    ("methods", "words"),
    [
        ({"energy": lambda self, k, l: None}, "Pull.energy returns None, which is no expression or number; it must return an expression, J"),
        ({"energy": lambda self, k, l: object()}, ", which is no expression or number; it must return an expression, J"),
        ({"energy": lambda self, k, l: 2 * se.I}, "Pull.energy returns 2*I, which is not real; it must return an expression, J"),
        ({"energy": lambda self, k, l: se.Eq(l.r[0], 1)}, ", which is no expression or number; it must return an expression, J"),
        ({"energy": lambda self, k, l: sp.Symbol("x") >= 1}, ", which is no expression or number; it must return an expression, J"),
        ({"energy": lambda self, k, l: l.r}, "Pull.energy returns Vec("),
        ({"wrench": lambda self, k, l: l.r - k.r}, "Pull.wrench returns Vec("),
        ({"wrench": lambda self, k, l: (l.r, 0)}, "Pull.wrench returns part 2 = 0, which is no vector"),
        ({"wrench": lambda self, k, l: (l.r,)}, "Pull.wrench returns 1 part, where 2 are needed"),
        ({"wrench": lambda self, k, l: (l.r, l.r, l.r)}, "3 parts, where 2 are needed"),
        ({"wrench": lambda self, k, l: ((1, 0, 0), (0, 0, 0))}, "part 1 = (1, 0, 0), which is no vector"),
        ({"dissipation": lambda self, k, l: {}}, "Pull.dissipation returns {}"),
        ({"states": mb.params(z="m"), "energy": lambda self, k, l: self.z * l.r[0]}, "states no value for the rate of its state 'z'"),
        ({"states": mb.params(z="m"), "energy": lambda self, k, l: self.z * l.r[0], "rates": lambda self, k, l: 0}, "Pull.rates returns 0"),
    ],
)
def test_statements_of_a_force(methods: dict[str, Any], words: str) -> None:
    assert words in told(force(**methods))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: joint(params=mb.params(k="m")), "Bowl: 'k' in params is taken by an attribute that every object of this kind has"),
        (lambda: joint(params=mb.params(name="m")), "Bowl: 'name' in params is taken by"),
        (lambda: joint(params=mb.params(axis="1")), "'axis' in params"), (lambda: joint(params=mb.params(at="m")), "'at' in params"),
        (lambda: joint(params=mb.params(l="m")), "'l' in params"), (lambda: force(params=mb.params(at_l="m")), "'at_l' in params"),
        (lambda: force(params=mb.params(energy="J")), "Pull: 'energy' in params is taken by Force.energy of the class; choose another"),
        (lambda: force(params=mb.params(params="J")), "'params' in params"),
        (lambda: force(states=mb.params(stiffness="m")), "'stiffness' in states is taken by its params"),
        (lambda: force(params={"stiffness": "N/m"}), "Pull: params = {'stiffness': 'N/m'}: write params = mb.params(name="),
        (lambda: force(options="friction"), "Pull: options = 'friction': give a tuple of names"),
        (lambda: joint(coordinates=mb.params(rate=("rad", "angle"))), "Bowl: the coordinate 'rate' has the name of another sensor"),
        (lambda: joint(coordinates=mb.params(tilt_rate=("rad", "angle"))), "the coordinate 'tilt_rate' has the name of another"),
        (lambda: mb.params(radius=5), "params: radius = 5 is neither a unit nor a pair (unit, meaning)"),
        (lambda: mb.params(radius=""), "params: radius = '' has no unit; give one, '1' for a pure number"),
        (lambda: mb.params(radius=("m", "a", "b")), "params: radius = ('m', 'a', 'b') is neither"),
        (lambda: mb.params(**{"pin radius": "m"}), "'pin radius' cannot be the name of an attribute"),
        (lambda: mb.params(**{"lambda": "1"}), "'lambda' cannot be the name of an attribute"),
    ],
)
def test_declarations_are_refused_where_the_class_is_made(make: Callable[[], Any], words: str) -> None:
    with pytest.raises(mb.LawError) as caught:
        make()
    assert words in str(caught.value)


@pytest.mark.parametrize("name", ["k_r1", "l_x2", "lambda_a", "mu_a", "k_h", "radius_dot"])
def test_names_of_derivations_are_refused(name: str) -> None:
    """A parameter that is the symbol of a frame or row would silently be that symbol."""
    law = joint(params=mb.params(**{name: "1", "radius": "m"}), constraints=lambda self, k, l: {"a": l.r[0] * getattr(self, name)})
    assert f"Bowl: '{name}' in params is the symbol of" in told(law, **{name: 1.0})


def test_a_frame_in_the_plane_knows_where_its_point_is_in_the_body() -> None:
    """Two places and the angle of the drawing, of which no parameter of a law may have the name."""
    own = {"k_p1", "k_p2", "k_theta0"}
    assert own == own & {str(symbol) for symbol in make_frame("k", NodeKind.PLANAR).symbols}


class Sticky(mb.Friction):
    """A friction law with a mistake of its own."""

    params = mb.params(mu=("1", "coefficient"))

    def coefficient(self, v: Any) -> Any:
        return {"mu": self.mu}


def test_parts_are_held_to_their_contract_too() -> None:
    s = mb.Scene("own")
    s.revolute("R", s.ground, s.rigid_body("rod", 1.0, (1, 1, 1)), at=(0, 0, 1), friction=Sticky(mu=0.3), radius=0.1)
    with pytest.raises(mb.SceneError, match=r"Sticky\.coefficient returns \{'mu': .*\}, which is no expression"):
        s.check()
    with pytest.raises(mb.LawError, match="Sticky: mu = 'x' is not a number; give a number"):
        Sticky(mu="x")


def test_the_own_exception_stays_the_cause() -> None:
    def rows(self: Any, k: Any, l: Any) -> Any:
        raise KeyError("my table has no entry 3")

    with pytest.raises(mb.LawError, match="fails: KeyError: 'my table has no entry 3'") as caught:
        joint(constraints=rows)("J", None, None).constraints(None, None)
    assert isinstance(caught.value.__cause__, KeyError)


def test_expressions_of_sympy_and_plain_numbers_are_taken() -> None:
    law = force(energy=lambda self, k, l: sp.Rational(1, 2) * sp.sympify(self.stiffness * ((l.r - k.r) @ (l.r - k.r))),
                dissipation=lambda self, k, l: 0, wrench=lambda self, k, l: None)
    s = mb.Scene("own")
    body = s.point_mass("m", 1.0, (1, 0, 0))
    s.add(law("S", s.ground, body, at=(0, 0, 0), at_l=(1, 0, 0), stiffness=4.0))
    assert s.simulate(math.pi / 4, accuracy=1e-8)["m"].position[-1, 0] == pytest.approx(0.0, abs=1e-7)  # a quarter of the period


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (5, "add without a name: law = 5 is no joint, force or coupling; give an object"),
        (mb.Revolute, "is no joint, force or coupling"), (mb.Kinematic(), "is no joint, force or coupling"), (None, "law = None is no joint"),
        (type("Bare", (mb.Force,), {"__init__": lambda self: None})(), "law = a Bare whose attribute name was not set; let Bare.__init__ call super()"),
        (mb.Weld(5, "ground", "rod"), "Weld: name = 5 is not text"),
        (mb.Weld("x", "ground", "rod", at="x"), "Weld 'x': at = 'x' is not"),
        (mb.Weld("x", "ground", "rod", at=(0, 1), axis=(0, 0, 0)), "Weld 'x': axis = [0.0, 0.0, 0.0] has length zero"),
        (mb.Weld("x", "ground", "bar"), "Weld 'x': l = 'bar' is no body of this scene, which has 'ground', 'rod'"),
        (force(options=("table",))("x", "ground", "rod", stiffness=1.0, table=[1, 2]), "Pull 'x': table = [1, 2] is not hashable, which options"),
    ],
)
def test_laws_that_cannot_be_added(law: Any, words: str) -> None:
    s = mb.Scene("own")
    s.rigid_body("rod", 1.0, (1, 1, 1))
    s.add(law)
    with pytest.raises(mb.SceneError) as caught:
        s.check()
    (problem,) = caught.value.problems
    assert words in problem


@pytest.mark.parametrize(("method", "words"), [
    ("constraints", "row 'a' of Moving contains a velocity"), ("energy", "the energy of Moving contains a velocity")])
def test_what_depends_on_positions_alone_reads_no_velocity(method: str, words: str) -> None:
    base = mb.Joint if method == "constraints" else mb.Force
    stated = {"a": lambda k, l: (l.v - k.v) @ k.y}
    body = {"constraints": lambda self, k, l: {n: f(k, l) for n, f in stated.items()}, "energy": lambda self, k, l: l.w @ l.w}
    law = type("Moving", (base,), {method: body[method]})
    s = mb.Scene("s")
    s.add(law("law", s.ground, s.rigid_body("b", 1.0, (1, 1, 1)), at=(0, 0, 0)))
    with pytest.raises(mb.SceneError, match=words):
        s.check()


def test_a_force_that_states_nothing_is_refused() -> None:
    spring = type("Spring", (mb.Force,), {"enrgy": lambda self, k, l: l.r @ l.r})
    s = mb.Scene("s")
    s.add(spring("law", s.ground, s.rigid_body("b", 1.0, (1, 1, 1)), at=(0, 0, 0)))
    with pytest.raises(mb.SceneError, match="states none of energy, dissipation, wrench"):
        s.check()


@pytest.mark.parametrize("coefficient", [lambda v: 0.3, lambda v: v**2, lambda v: -0.1 * v, lambda v: float("nan") * v])
def test_friction_that_drives_is_refused(coefficient: Any) -> None:
    friction = type("Odd", (mb.Friction,), {"coefficient": lambda self, v: coefficient(v)})()
    s = mb.Scene("s")
    s.prismatic("p", s.ground, s.rigid_body("b", 1.0, 1.0), at=(0, 0), axis=(1, 0), friction=friction, normal_force=10.0)
    with pytest.raises(mb.SceneError, match=r"prismatic 'p': friction = .* (does not brake at the sliding velocity v|returns nan)"):
        s.check()


def test_a_row_without_a_finite_value_is_named() -> None:
    def constraints(self: Any, k: Any, l: Any) -> Any:
        return {"a": (l.r - k.r) @ k.z / self.radius}

    law = type("Divided", (mb.Joint,), {"params": mb.params(radius="m"), "constraints": constraints})
    s = mb.Scene("s", gravity=(0, 0, -9.81))
    s.add(law("law", s.ground, s.point_mass("b", 1.0, at=(0, 0, 0)), at=(0, 0, 0), radius=0))
    with pytest.raises(mb.SceneError, match=r"row law\.a has no finite value or derivative where the scene is drawn \(nan\)"):
        s.check()
