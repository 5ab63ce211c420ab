"""Friction laws as scalars: shape, passivity, what constructors say; a law of one's own."""

from __future__ import annotations

import math
import re
import warnings
from typing import Any

import numpy as np
import pytest
import symengine as se
from scipy.integrate import solve_ivp, trapezoid

import mbdae as mb

V = se.Symbol("v")


def numeric(law: Any, e: Any) -> Any:
    """A statement of a law as a function of v and z."""
    return se.Lambdify([V, se.Symbol("state_z")], [e.subs({se.Symbol(f"f_{p}"): value for p, value in law.values().items()
                                                          if isinstance(value, float)})])


def stated(law: Any) -> Any:
    return law.structure().symbolic("f")


def test_coulomb_is_odd_saturates_and_never_drives() -> None:
    law = mb.Coulomb(0.3, 1e-3)
    mu = numeric(law, stated(law).coefficient(V))
    v = np.array([1e-9, 1e-4, 1e-3, 0.019, 0.0201, 1.0, 1e6])
    values = np.array([float(mu([x, 0.0])[0]) for x in v])
    assert np.allclose(values, 0.3 * np.tanh(v / 1e-3), rtol=1e-15)
    assert np.array_equal(values, [-float(mu([-x, 0.0])[0]) for x in v])
    assert np.all(values * v > 0)


def test_lugre_slides_steadily_on_the_stribeck_curve_and_is_continuous_at_reversal() -> None:
    law = mb.LuGre(0.2, 0.3, 1e-2, 1e5, 31.0, sigma2=0.1)
    part = stated(law)
    mu, g = numeric(law, part.coefficient(V)), numeric(law, part.initial(V)["z"])
    for v in (1e-4, 1e-2, 1.0, -1.0):
        z = float(g([v, 0.0])[0])
        curve = 0.2 + 0.1 * math.exp(-((v / 1e-2) ** 2))
        assert float(mu([v, z])[0]) == pytest.approx(math.copysign(curve, v) + 0.1 * v, rel=1e-12)
    z = 2e-6
    assert abs(float(mu([1e-9, z])[0]) - float(mu([-1e-9, z])[0])) < 1e-6  # no jump, unlike with |v|


def test_lugre_gives_back_no_more_than_its_bristles_hold() -> None:
    """Work done on it is never less than the change of sigma0 z^2 / 2, for normal force 1 and any motion."""
    law = mb.LuGre(0.3, 0.3, 0.01, 1e5, 316.0)  # sigma1 v_s = 3.16 < 4 sqrt(2 e) 0.3 fails: said by a warning
    (doubt,) = law.doubts()
    assert f"exceeds 4 sqrt(2 e) mu_k = {4 * math.sqrt(2 * math.e) * 0.3:.2g}" in doubt
    law = mb.LuGre(0.3, 0.45, 1e-3, 1e5, 316.0)
    assert not law.doubts()
    part = stated(law)
    mu, rate = numeric(law, part.coefficient(V)), numeric(law, part.rate(V)["z"])
    rng = np.random.default_rng(1)
    amplitude, frequency, phase = rng.uniform(1e-4, 0.05, 5), rng.uniform(1, 60, 5), rng.uniform(0, 6, 5)

    def velocity(t: float) -> float:
        return float(np.sum(amplitude * np.sin(frequency * t + phase)))

    def right(t: float, y: Any) -> list[float]:
        v = velocity(t)
        return [float(rate([v, y[0]])[0]), v * float(mu([v, y[0]])[0])]

    run = solve_ivp(right, (0, 1.0), [0.0, 0.0], method="LSODA", rtol=1e-8, atol=1e-14)
    supplied = run.y[1] - 1e5 * run.y[0] ** 2 / 2
    assert np.min(np.diff(supplied)) > -1e-9 * np.max(run.y[1])  # what is not stored is lost, at all times


def test_bristles_store_the_work_that_bends_them() -> None:
    """At rest the force over the normal force is sigma0 z: bent from 0 to z without slip they take its integral."""
    law = mb.LuGre(0.2, 0.3, 1e-2, 1e5, 0.0)
    part, z = stated(law), np.linspace(0.0, 3e-6, 201)
    mu, held = numeric(law, part.coefficient(V)), numeric(law, part.stored(V))
    force = [float(mu([0.0, x])[0]) for x in z]
    assert float(held([0.0, z[-1]])[0]) == pytest.approx(trapezoid(force, z), rel=1e-12)
    assert law.state_scales() == {"z": pytest.approx(float(numeric(law, part.initial(V)["z"])([1e3, 0.0])[0]))}  # sliding fast


@pytest.mark.parametrize("gamma", [0.5, 1.0, 2, 3.0])
def test_stribeck_curve_of_any_exponent(gamma: float) -> None:
    law = mb.LuGre(0.2, 0.3, 1e-2, 1e5, 0.0, gamma=gamma)
    part, v = stated(law), 7e-3
    z = float(numeric(law, part.initial(V)["z"])([v, 0.0])[0])
    assert float(numeric(law, part.coefficient(V))([v, z])[0]) == pytest.approx(0.2 + 0.1 * math.exp(-(0.7**gamma)), rel=1e-12)


def test_damping_of_bristles_fades_with_the_speed() -> None:
    """What a deflection z adds at speed v: sigma1 exp(-(v/v_s)^2) z' for either sense of sliding, sigma1 z' without decay."""
    for decays in (True, False):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mb.AccuracyWarning)  # without decay the law says that it may create energy
            law = mb.LuGre(0.2, 0.3, 1e-2, 1e5, 31.0, damping_decay=decays)
        part = stated(law)
        mu, rate = numeric(law, part.coefficient(V)), numeric(law, part.rate(V)["z"])
        for v in (5e-3, -5e-3, 2e-2):
            fading = math.exp(-((v / 1e-2) ** 2)) if decays else 1.0
            expected = 1e5 * 1e-6 + 31.0 * fading * float(rate([v, 1e-6])[0])
            assert float(mu([v, 1e-6])[0]) == pytest.approx(expected, rel=1e-12)


def test_speed_from_which_constant_damping_creates_energy() -> None:
    """The speed that the doubt names is the one from which some deflection gives back more than the bristles hold."""
    with pytest.warns(mb.AccuracyWarning, match="creates energy above") as told:
        law = mb.LuGre(0.2, 0.2, 1e-2, 1e5, 31.0, sigma2=20.0, damping_decay=False)
    limit = float(re.search(r"above ([\d.e+-]+) m/s", str(told[0].message)).group(1))  # type: ignore[union-attr]
    part = stated(law)
    mu, rate = numeric(law, part.coefficient(V)), numeric(law, part.rate(V)["z"])

    def least(v: float) -> float:
        deflections = np.linspace(0, 1e-3, 4001)
        return min(v * float(mu([v, z])[0]) - 1e5 * z * float(rate([v, z])[0]) for z in deflections)

    assert least(0.9 * limit) > 0 > least(1.1 * limit)


def test_elastic_impact_and_rest_of_a_hertz_contact() -> None:
    """Against m p'' = - stiffness p^1.5 from the first touch to the last, and a weight at rest."""
    law, mass, speed = mb.Hertz(3e8), 2.0, 0.7

    def leaves(t: float, y: Any) -> float:
        return float(y[0])

    leaves.terminal, leaves.direction = True, -1  # type: ignore[attr-defined]
    run = solve_ivp(lambda t, y: [y[1], -3e8 * max(y[0], 0.0) ** 1.5 / mass], (0, 1), [0.0, speed], events=leaves,
                    rtol=1e-10, atol=1e-14, max_step=1e-5)
    depth, duration = law.impact(mass, speed)
    assert depth == pytest.approx(run.y[0].max(), rel=1e-4)  # the largest of the steps
    assert duration == pytest.approx(run.t[-1], rel=1e-6)
    assert 3e8 * law.penetration(50.0) ** 1.5 == pytest.approx(50.0)


@pytest.mark.parametrize(("make", "words"), [
    (lambda: mb.Coulomb(-0.1, 1e-3), "mu = -0.1 is negative"),
    (lambda: mb.Coulomb(0.1, 0.0), "v_c = 0 m/s is not positive"),
    (lambda: mb.Coulomb(0.1, float("nan")), "v_c = nan is not finite; give a number in m/s"),
    (lambda: mb.LuGre(0.3, 0.2, 1e-3, 1e5, 300.0), "mu_s = 0.2 is below mu_k = 0.3"),
    (lambda: mb.LuGre(0.3, 0.4, 0.0, 1e5, 300.0), "v_s = 0 m/s is not positive"),
    (lambda: mb.LuGre(0.3, 0.4, 1e-3, -1e5, 300.0), "sigma0 = -100000 1/m is negative"),
    (lambda: mb.LuGre(0.3, 0.4, 1e-3, 1e5, -3.0), "sigma1 = -3 s/m is negative"),
    (lambda: mb.LuGre(0.3, 0.4, 1e-3, 1e5, 3.0, gamma=9), "gamma = 9"),
    (lambda: mb.Hertz(0.0), "stiffness = 0 N/m^1.5 is not positive"),
    (lambda: mb.Hertz(1e9, -1.0), "damping = -1 s/m is negative"),
    (lambda: mb.Hertz.restitution(1e9, 1.2, 1.0), "e = 1.2"),
    (lambda: mb.Hertz.restitution(1e9, 0.5, 0.0), "v = 0.0 is not positive"),
])
def test_values_that_cannot_be_meant_are_refused_by_name(make: Any, words: str) -> None:
    with pytest.raises(mb.LawError) as caught:
        make()
    assert words in str(caught.value)


@pytest.mark.parametrize(("values", "words"), [
    ({"damping_decay": False}, "creates energy above 0.0038 m/s"),
    ({"v_s": 0.03}, "exceeds 4 sqrt(2 e) mu_k"),
    ({"sigma0": 100.0}, "a stiffness over the normal force"),
])
def test_values_that_can_create_energy_or_have_odd_units_are_told(values: dict[str, Any], words: str) -> None:
    given = {"mu_k": 0.3, "mu_s": 0.4, "v_s": 1e-3, "sigma0": 1e5, "sigma1": 316.2}
    with warnings.catch_warnings():
        warnings.simplefilter("error", mb.AccuracyWarning)
        mb.LuGre(**given)
    with pytest.warns(mb.AccuracyWarning, match=words.replace("(", r"\(").replace(")", r"\)")):
        mb.LuGre(**(given | values))


def test_restitution_is_exact() -> None:
    for e in (0.05, 0.2, 0.5, 0.9, 0.999, 1.0):
        law = mb.Hertz.restitution(1e9, e, v=0.7)
        assert law.coefficient_of_restitution(0.7) == pytest.approx(e, abs=1e-12)
    d = mb.Hertz(1e9, 0.3).damping
    e = mb.Hertz(1e9, 0.3).coefficient_of_restitution(1.0)
    assert (1 - d * e) * math.exp(d * e) == pytest.approx((1 + d) * math.exp(-d), rel=1e-14)
    assert e == pytest.approx(0.8328697922656014, rel=1e-13)


class Stribeck(mb.Friction):
    """Coulomb friction that falls with speed."""

    params = mb.params(mu_k="1", mu_s="1", v_s="m/s", v_c="m/s")

    def coefficient(self, v: Any) -> Any:
        return (self.mu_k + (self.mu_s - self.mu_k) * se.exp(-((v / self.v_s) ** 2))) * se.tanh(v / self.v_c)


class Peaked(mb.Friction):
    """Largest, mu / 2, at v_s."""

    params = mb.params(mu="1", v_s="m/s")

    def coefficient(self, v: Any) -> Any:
        return self.mu * v / (self.v_s + v**2 / self.v_s)


def test_the_largest_coefficient_of_a_law_is_sought_over_nine_decades_of_speed() -> None:
    """From 1e-6 m/s to 1 km/s; with states nothing is known but what the law states."""
    assert Peaked(mu=0.4, v_s=1e-6).largest() == pytest.approx(0.2)
    assert Peaked(mu=0.4, v_s=1e3).largest() == pytest.approx(0.2)
    assert mb.LuGre(0.2, 0.3, 1e-2, 1e5, 31.0).largest() == 0.3


class Bristles(mb.Friction):
    """Dahl's law: bristles that bend, and slip at mu."""

    params, states = mb.params(mu="1", stiffness="1/m"), mb.params(z="m")

    def rate(self, v: Any) -> dict[str, Any]:
        return {"z": v - mb.laws.friction.magnitude(v) * self.z * self.stiffness / self.mu}

    def coefficient(self, v: Any) -> Any:
        return self.stiffness * self.z


def test_a_nut_with_bristles_of_ones_own_is_held_by_them() -> None:
    """Their largest coefficient is not known, so nothing is said of locking. The weight of the nut bends them, no more."""
    law = Bristles(mu=0.3, stiffness=1e4)
    assert law.largest() is None
    s = mb.Scene("nut", gravity=(0, 0, -9.81))
    nut = s.rigid_body("nut", 1.0, (1e-3,) * 3, at=(0, 0, 0))
    s.screw("thread", s.ground, nut, at=(0, 0, 0), axis=(0, 0, 1), lead=2e-3, friction=law, radius=0.01)
    r = s.simulate(0.5)
    assert abs(r["thread"].angle).max() < 2 * 0.3 / 1e4 / 0.01


def test_a_law_of_ones_own_rubs_in_a_scene() -> None:
    def scene(friction: Any) -> Any:
        s = mb.Scene("pressed pin")
        pin = s.rigid_body("pin", 1.0, 1e-3, at=(0, 0), angular_velocity=(0, 0, 30.0))
        s.force("load", pin, (0, -50.0, 0))
        s.revolute("J", s.ground, pin, at=(0, 0), model=mb.Clearance(0.0201, 0.02, mb.Hertz(1e9, 3.0), friction=friction))
        return s.simulate(0.05, accuracy=1e-5)

    own = scene(Stribeck(mu_k=0.2, mu_s=0.2, v_s=0.05, v_c=1e-2))
    same = scene(mb.Coulomb(0.2, 1e-2))
    assert own["pin"].angular_velocity[-1, 2] == pytest.approx(same["pin"].angular_velocity[-1, 2], abs=1e-4)
    assert own.energy.friction[-1] > 0
    assert repr(Stribeck(mu_k=0.2, mu_s=0.2, v_s=0.05, v_c=1e-2)) == "Stribeck(mu_k=0.2, mu_s=0.2, v_s=0.05, v_c=0.01)"
    assert mb.Coulomb(0.2, 1e-2) == mb.Coulomb(0.2, 0.01) != mb.Coulomb(0.2, 0.02)
    with pytest.raises(mb.LawError, match="unknown parameter 'mu'"):
        Stribeck(mu=1)
