"""What is known of a law's switches from its statement alone."""

import numpy as np
import pytest
import symengine as se

import mbdae as mb
from mbdae.symbolic.switches import known_switches
from mbdae.symbolic.variation import let
from mbdae.system.prepare import prepare


def derived(statement):
    """A law with an energy statement(law, x, v), x the displacement of l along k.z, in a prepared scene with its derivation."""

    class Stated(mb.Force):
        params = mb.params(w=("m", "width"), c=("m", "centre"))

        def energy(self, k, l):
            return statement(self, (l.r - k.r) @ k.z)

    s = mb.Scene("line")
    body = s.rigid_body("body", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.prismatic("guide", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0), rate0=1.0)
    s.add(Stated("law", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0), at_l=(0, 0, 0), w=0.1, c=0.5))
    return next(group.derived for group in prepare(s).model.groups if group.key[0] is Stated)


@pytest.mark.parametrize(
    ("statement", "kinds"),
    [
        (lambda f, x: se.exp(-((x - f.c) ** 2) / f.w**2), ["decaying"]),
        (lambda f, x: se.tanh(x / f.w) + se.atan(x / f.w), ["arc", "saturating"]),
        (lambda f, x: 1 / (1 + (x / f.w) ** 2), ["power"]),
        (lambda f, x: se.sqrt(x**2 + f.w**2), ["power"]),
        (lambda f, x: 1 / se.cosh(x / f.w), ["growing", "power"]),
        (lambda f, x: se.Piecewise((x, se.And(x > f.c, x < 2 * f.c)), (0, True)), ["kink", "kink"]),
        (lambda f, x: se.exp(-(se.tanh(x / f.w) ** 2)), ["decaying", "saturating"]),
        (lambda f, x: let(se.exp(-(let(x / f.w) ** 2))), ["decaying"]),
        (lambda f, x: x**2 / f.w + x**4, []),  # polynomials
        (lambda f, x: se.exp(f.w) * x**2, []),  # of parameters alone
        (lambda f, x: se.sqrt(x**2), []),  # a length has no scale of its own
        (lambda f, x: se.Piecewise((1, x > 20 * f.w), (se.tanh(x / f.w), True)), ["saturating"]),  # equal to round-off beyond 20
        (lambda f, x: se.Piecewise((x**2, x > 0), (0, True)), ["kink"]),
    ],
)
def test_arguments_of_a_statement(statement, kinds):
    assert sorted(s.kind for s in known_switches(derived(statement))) == kinds


def test_arguments_are_those_of_the_functions():
    """Of exp(x / w) and of tanh(x / w) it is the same; a power alone has an exponent that counts."""
    (decaying,), (saturating,) = (known_switches(derived(lambda f, x, of=of: of(x / f.w))) for of in (se.exp, se.tanh))
    assert decaying.argument == saturating.argument
    assert decaying.exponent == saturating.exponent == 1
    (power,) = known_switches(derived(lambda f, x: 1 / (1 + (x / f.w) ** 2) ** 2))
    assert power.exponent == -2


@pytest.mark.parametrize(("angle", "kinds"), [
    (lambda law, k, l: let(l.heading - k.heading), []), (lambda law, k, l: let(let(l.heading) - k.heading + 0.3), []),
    (lambda law, k, l: let((l.r - k.r) @ k.x / law.w), ["periodic"]),
    (lambda law, k, l: let(let(l.heading) * 7), ["periodic"])])
def test_the_sine_of_an_angle_between_bodies_has_no_scale_of_its_own(angle, kinds):
    """However its parts are named; that of a length over a width has."""

    class Waves(mb.Force):
        params = mb.params(w=("m", "width"))

        def energy(self, k, l):
            return se.cos(angle(self, k, l))

    s = mb.Scene("plane", space="planar")
    body = s.rigid_body("body", 1.0, 1.0, at=(0, 0))
    s.add(Waves("law", s.ground, body, at=(0, 0, 0), at_l=(0, 0, 0), w=0.1))
    found = [w.kind for g in prepare(s).model.groups if g.key[0] is Waves for w in known_switches(g.derived)]
    assert found == kinds


def test_built_in_laws_without_scales_have_none():
    """Springs, bushings, loads and joints without friction: nothing is looked at in their scenes."""
    s = mb.Scene("plain", gravity=(0, 0, -9.81))
    a, b = s.rigid_body("a", 1.0, (1, 1, 1), at=(0, 0, 0)), s.rigid_body("b", 1.0, (1, 1, 1), at=(1, 0, 0))
    s.revolute("J", s.ground, a, at=(0, 0, 0), axis=(0, 1, 0), spring=2.0, damper=0.1)
    s.prismatic("P", a, b, at=(1, 0, 0), axis=(1, 0, 0), spring=10.0)
    s.spring("k", s.ground, b, at_k=(0, 0, 1), at_l=(1, 0, 0), stiffness=10.0, damping=0.2)
    for scene in (s, s.recursive()):
        assert scene.system(mb.GGL()).switches is None


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical(), mb.Recursive()], ids=lambda m: type(m).__name__)
def test_values_on_carried_bodies(model):
    """The argument tanh((x - c) / w) of a body on a slide on a turning arm, in any joint model."""

    class Far(mb.Force):
        params = mb.params(w=("m", "width"))

        def energy(self, k, l):
            return 1e-6 * se.tanh((l.r - k.r) @ k.x / self.w)

    s = mb.Scene("arm")
    arm = s.rigid_body("arm", 1.0, (1, 1, 1), at=(0, 0, 0))
    block = s.rigid_body("block", 1.0, (1, 1, 1), at=(0.5, 0, 0))
    s.revolute("turn", s.ground, arm, at=(0, 0, 0), axis=(0, 0, 1), rate0=1.0, model=model)
    s.prismatic("slide", arm, block, at=(0.5, 0, 0), axis=(1, 0, 0), rate0=0.5, model=model)
    s.add(Far("far", s.ground, block, at=(0, 0, 0), at_l=(0.5, 0, 0), w=0.1))
    switches = s.system(mb.GGL()).switches
    r = mb.RadauIIA(3, rtol=1e-9).solve(s.system(mb.GGL()), 1.0)
    values = switches.arguments(r.t, r.y)
    distance = 10 * np.cos(r.t) * (0.5 + 0.5 * r.t)  # the law is weak: at first the block slides and turns with what it started
    assert switches.names == ("far",)
    assert values.shape == (len(r.t), 1)
    np.testing.assert_allclose(values[:2, 0], distance[:2], rtol=1e-3)


def test_a_row_of_a_joint_is_searched_too():
    """A pin in a slot whose height follows a steep step."""

    class Slot(mb.Joint):
        params = mb.params(w=("m", "width of the step"), h=("m", "its height"))

        def constraints(self, k, l):
            return {"height": (l.r - k.r) @ k.y - self.h * se.tanh((l.r - k.r) @ k.x / self.w)}

    s = mb.Scene("slot")
    pin = s.rigid_body("pin", 1.0, (1, 1, 1), at=(0, 0, 0), velocity=(1.0, 0, 0))
    s.add(Slot("slot", s.ground, pin, at=(0, 0, 0), at_l=(0, 0, 0), w=1e-3, h=0.1))
    kinds = [w.kind for g in prepare(s).model.groups if g.key[0] is Slot for w in known_switches(g.derived)]
    assert kinds == ["saturating"]
