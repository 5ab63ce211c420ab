"""Bodies that come to a law of a user's own which is narrow in space, each with its equations of motion by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se
from local_laws import shapes
from local_laws.shapes import Field
from timed_inputs.inputs import PER_WIDTH
from timed_inputs.oracle import Array, Problem
from timed_inputs.scenes import cross, model, rotation

import mbdae as mb

Rng = np.random.Generator
TAILS = 8  #: widths from the centre within which the reference takes short steps


def user_law(field: Field, coordinate: Any, rate: Any, stated: str) -> type[mb.Force]:
    """A new class whose energy, wrench or dissipation is a shape of coordinate(k, l); rate(k, l) is its time derivative."""

    class Own(mb.Force):
        params = mb.params(height=("J", "height"), centre=("m", "place"), width=("m", "width"))

        def value(self, k: Any, l: Any) -> Any:
            return field.shape(se, coordinate(k, l), self.height, self.centre, self.width)

    def energy(self: Any, k: Any, l: Any) -> Any:
        return self.value(k, l)

    def dissipation(self: Any, k: Any, l: Any) -> Any:
        return self.value(k, l) * rate(k, l) ** 2 / 2

    def wrench(self: Any, k: Any, l: Any) -> Any:
        s = se.Symbol("place_of_l")
        slope = se.diff(field.shape(se, s, self.height, self.centre, self.width), s).subs({s: coordinate(k, l)})
        return k.x * (-slope), k.x * 0

    name = {"energy": energy, "dissipation": dissipation, "wrench": wrench}[stated]
    return type(f"Own{stated.capitalize()}", (Own,), {stated: name})


def along(k: Any, l: Any) -> Any:
    """How far l is along k's x axis."""
    return (l.r - k.r) @ k.x


def along_rate(k: Any, l: Any) -> Any:
    """Its rate, where k is the ground."""
    return (l.v - k.v) @ k.x


def apart(k: Any, l: Any) -> Any:
    """Distance of the points."""
    d = l.r - k.r
    return se.sqrt(d @ d)


def numbers(field: Field) -> dict[str, float]:
    """Parameters of the law."""
    return {"height": field.height, "centre": field.centre, "width": field.width}


def slide(rng: Rng) -> Problem:
    """A body on a slide comes to the law; sometimes a spring brings it back."""
    m, v = float(rng.uniform(0.5, 3)), float(rng.uniform(0.5, 2))
    k = float(rng.choice([0.0, 0.3])) * m * v**2
    braking = bool(rng.random() < 0.25)
    field = shapes.draw(rng, m * v**2 / 2, 0.2, 0.8)
    if braking:
        shape = shapes.BOUNDED[int(rng.integers(len(shapes.BOUNDED)))]
        width = max(field.width, 1e-2) if shape is shapes.sech else field.width
        width = min(width, field.centre)
        field = Field(shape, m * v / width * float(rng.uniform(0.1, 0.5)), field.centre, width)
    stated = "dissipation" if braking else str(rng.choice(["energy", "wrench"]))
    chosen, constrained = model(rng)
    T = float(rng.uniform(1.2, 2.5)) / v
    law = user_law(field, along, along_rate, stated)
    value, slope = field.functions()

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("slide and a law")
        b = s.rigid_body("b", m, m, at=(0, 0))
        s.prismatic("p", s.ground, b, at=(0, 0), axis=(1, 0, 0), rate0=v, spring=k or None, model=chosen)
        s.add(law("own", s.ground, b, at=(0, 0), **numbers(field)))
        return s

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        force = -value(y[0]) * y[1] if braking else -slope(y[0])
        return [y[1], (force - k * y[0]) / m]

    fastest = 1.2 * np.sqrt(v**2 + (0 if braking else 2 * field.deepest / m))
    problem = Problem(f"slide, {stated}", build, [], T, np.array([0, v]), rhs,
                      lambda t, y, u: {"p.displacement": y[0], "p.rate": y[1]}, constrained)
    return local(problem, field, fastest, lambda y: y[0])


def pendulum(rng: Rng) -> Problem:
    """A rod whose tip swings to the law, which acts on the tip along x, or about the hinge by the sine of the angle."""
    m, L, g, w0 = 1.0, 1.0, 9.81, float(rng.uniform(1.5, 3))
    J = m * L**2 / 3
    tip = bool(rng.integers(2))
    field = shapes.draw(rng, J * w0**2 / 2, 0.1, 0.35)
    chosen, constrained = model(rng)
    T = float(rng.uniform(0.5, 1.5))
    law = user_law(field, along if tip else (lambda k, l: k.y @ l.x), along_rate, "energy")
    _, slope = field.functions()

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("pendulum and a law", gravity=(0, -g, 0))
        b = s.link("b", (0, 0), (0, -L), mass=m)
        s.revolute("h", s.ground, b, at=(0, 0), rate0=w0, model=chosen)
        end = (0, -L, 0) if tip else (0, 0, 0)
        s.add(law("own", s.ground, b, at=end, at_l=end, **numbers(field)))
        return s

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        return [y[1], (-m * g * L / 2 * np.sin(y[0]) - slope(L * np.sin(y[0])) * L * np.cos(y[0])) / J]

    fastest = 1.2 * np.sqrt(w0**2 + 2 * field.deepest / J)
    problem = Problem("pendulum, tip" if tip else "pendulum, angle", build, [], T, np.array([0, w0]), rhs,
                      lambda t, y, u: {"h.angle": y[0], "h.rate": y[1]}, constrained)
    return local(problem, field, fastest, lambda y: np.sin(y[0]))


def point(rng: Rng) -> Problem:
    """A mass point that passes a ground point from which the law measures its distance."""
    m, v, off = float(rng.uniform(0.5, 3)), float(rng.uniform(0.5, 2)), float(rng.uniform(0.02, 0.1))
    field = _around(rng, m * v**2 / 2)
    T = float(rng.uniform(0.6, 1.6)) / v
    law = user_law(field, apart, along_rate, "energy")
    _, slope = field.functions()

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("mass point and a law")
        b = s.point_mass("b", m, at=(-1, off), velocity=(v, 0))
        s.add(law("own", s.ground, b, at=(0, 0), at_l=(-1, off, 0), **numbers(field)))
        return s

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        r = np.hypot(y[0], y[1])
        pull = -slope(r) / r / m
        return [y[2], y[3], pull * y[0], pull * y[1]]

    fastest = 1.2 * np.sqrt(v**2 + 2 * field.deepest / m)
    problem = Problem("mass point", build, [], T, np.array([-1, off, v, 0]), rhs,
                      lambda t, y, u: {"b.position": [y[0], y[1], 0], "b.velocity": [y[2], y[3], 0]})
    return local(problem, field, fastest, lambda y: np.hypot(y[0], y[1]))


def _around(rng: Rng, energy: float) -> Field:
    """A field of the distance from a point, for a body that comes from 1 m; one-sided laws and walls act outside of a ring."""
    field = shapes.draw(rng, energy, 0.2, 0.6)
    if field.shape is shapes.power:
        field = Field(shapes.bell, field.height, field.centre, field.width)
    if field.shape in (shapes.stop, shapes.hertz_stop):
        return Field(shapes.tent, 1.5 * energy, field.centre, min(field.width, field.centre / 2))
    return Field(field.shape, field.height, field.centre, min(field.width, 0.3))


def body(rng: Rng) -> Problem:
    """A spinning body in space; the law measures the distance of a point off its centre of mass from a ground point."""
    m, J, v = 1.0, np.array([0.02, 0.03, 0.04]), float(rng.uniform(0.5, 2))
    w0, arm, off = rng.normal(size=3), rng.normal(size=3) * 0.05, rng.uniform(0.02, 0.1, 2)
    field = _around(rng, m * v**2 / 2)
    T = float(rng.uniform(0.6, 1.4)) / v
    law = user_law(field, apart, along_rate, "energy")
    _, slope = field.functions()
    start = np.array([-1, *off])

    def build(said: list[Any]) -> mb.Scene:
        s = mb.Scene("body and a law", space="spatial")
        b = s.rigid_body("b", m, J, at=start, velocity=(v, 0, 0), angular_velocity=w0)
        s.add(law("own", s.ground, b, at=(0, 0, 0), at_l=start + arm, **numbers(field)))
        return s

    def place(y: Array) -> Array:
        return np.asarray(y[7:10] + rotation(y[:4]) @ arm)

    def rhs(t: float, y: Array, u: Any) -> list[float]:
        P, w, R = y[:4], y[4:7], rotation(y[:4])
        d = y[7:10] + R @ arm
        r = np.sqrt(d @ d)
        F = -slope(r) / r * d
        Pt = 0.5 * np.array([-P[1:] @ w, *(P[0] * w + cross(P[1:], w))])
        return [*Pt, *((cross(arm, R.T @ F) - cross(w, J * w)) / J), *y[10:13], *(F / m)]

    def read(t: float, y: Array, u: Any) -> dict[str, Any]:
        R = rotation(y[:4])
        return {"b.rotation": R, "b.angular_velocity": R @ y[4:7], "b.position": y[7:10], "b.velocity": y[10:13]}

    fastest = 1.5 * (np.sqrt(v**2 + 2 * field.deepest / m) + np.linalg.norm(w0) * np.linalg.norm(arm))
    y0 = np.array([1, 0, 0, 0, *w0, *start, v, 0, 0])
    return local(Problem("body in space", build, [], T, y0, rhs, read), field, fastest, lambda y: float(np.linalg.norm(place(y))))


def local(problem: Problem, field: Field, fastest: float, coordinate: Any) -> Problem:
    """The problem with what is known of its narrow place: `fastest` bounds the coordinate's rate."""
    reach = TAILS * field.width
    problem.clear = lambda y: max(0.0, abs(coordinate(y) - field.centre) - reach) / fastest * 0.9
    problem.largest_step = field.width / PER_WIDTH / fastest
    problem.tightest = 1e-7
    problem.narrow = field.width
    problem.kind = field.shape.__name__.replace("_", " ")
    return problem


SCENES = (slide, slide, slide, pendulum, pendulum, point, point, body)
