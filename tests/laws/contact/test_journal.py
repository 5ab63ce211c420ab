"""The pin in its race: balance, passivity, what is smooth, what the contracts catch."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.contracts.case import columns
from mbdae.contracts.states import RandomStates
from mbdae.formulations import ggl_outputs
from mbdae.kernels.plan import linearised_plan, plan
from mbdae.laws.journal import JournalContact
from mbdae.results.states import power_outputs
from mbdae.symbolic.derive import Derived, derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Impact
from mbdae.symbolic.vectors import Vec
from mbdae.system.prepare import prepare

selftest = import_module("mbdae.contracts")  # the package exports a function of that name
HERTZ = mb.Hertz(1e9, damping=0.3)
RADII = {"outer": 0.0501, "inner": 0.05}
SPATIAL = ((NodeKind.SPATIAL, Axes.GENERAL),) * 2
PLANAR = ((NodeKind.PLANAR, Axes.NORMAL),) * 2


def derived(sides: Any = SPATIAL, law: type[JournalContact] = JournalContact, **values: Any) -> Derived:
    stated = law("D", None, None, **(RADII | {"normal": HERTZ, "friction": mb.Coulomb(0.3, 1e-3)} | values))
    return derive(law, stated.structure(), sides)


def touching(d: Derived, count: int, seed: int, given: dict[str, float]) -> Any:
    """Random states of two bodies whose pin is near the race: gap from -1e-4 to 1e-4 m, any attitude and velocity."""
    states = RandomStates(d, given, np.random.default_rng(seed), count)
    rng, values = np.random.default_rng(seed), states.values
    gaps = plan(d, lambda d: [(("u", i), d.variation.resolve(e)) for i, e in enumerate(d.frames[1].r - d.frames[0].r)])
    u = gaps.kernel.values(columns(gaps.all_inputs.symbols, values))
    direction = rng.normal(size=u.shape)
    if d.frames[0].kind.flat:
        direction[:, 2] = 0
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    wanted = direction * (1e-4 + rng.uniform(-1e-4, 1e-4, (count, 1)))
    for i, symbol in enumerate(d.frames[1].q[: 2 if d.frames[0].kind.flat else 3]):
        values[str(symbol)] = values[str(symbol)] + (wanted - u)[:, i]
    return values


GIVEN = {"outer": 0.0501, "inner": 0.05, "length": 0.02, "normal_stiffness": 1e9, "normal_damping": 0.3, "friction_mu": 0.3,
         "friction_v_c": 1e-3}


@pytest.mark.parametrize("length", [None, 0.02], ids=["one plane", "two ends"])
@pytest.mark.parametrize("sides", [SPATIAL, PLANAR], ids=["spatial", "planar"])
def test_no_power_comes_from_impact_or_friction(sides: Any, length: float | None) -> None:
    d = derived(sides, length=length)
    values = touching(d, 200, 3, GIVEN)
    p = plan(d, power_outputs)
    powers = p.kernel.values(columns(p.all_inputs.symbols, values))
    named = {target[0]: powers[:, i] for i, target in enumerate(p.targets)}
    assert np.any(named["friction"] > 1.0)  # some of the states are in contact
    assert np.any(named["friction"] == 0.0) or length is not None  # and some apart, but a tilted pin touches at its ends
    for cause in ("impact", "friction"):
        assert np.min(named[cause]) >= -1e-12 * np.max(named[cause])
    assert np.allclose(named["impact"] + named["friction"], named["dissipated"], rtol=1e-10)


class WithoutRotation(JournalContact):
    """Forgets that the race turns: its points at the contact move with the centre of the race."""

    @staticmethod
    def sliding(k: Any, l: Any, from_l: Vec, from_k: Vec) -> Vec:
        return (l.v + l.w.cross(from_l)) - k.v


def test_slip_without_the_rotation_of_the_race_is_caught_by_the_contract(monkeypatch: pytest.MonkeyPatch) -> None:
    every = selftest.variants
    monkeypatch.setattr(selftest, "variants", lambda *given: (v for v in every(*given) if v[0].startswith("planar - planar")))
    with pytest.raises(mb.LawError, match="losses by cause"):
        mb.selftest(WithoutRotation, friction=mb.Coulomb(1, 1))


def test_slip_without_the_rotation_of_the_race_is_caught_by_the_energy(monkeypatch: pytest.MonkeyPatch) -> None:
    """What friction should have dissipated by its own slip is not what the bodies lost: `other` should be 0 here."""

    def other_over_friction() -> float:
        s = mb.Scene("turning race")
        race = s.rigid_body("race", 5.0, 0.1, at=(0, 0), angular_velocity=(0, 0, 60.0))
        s.spring("to the ground", s.ground, race, at_k=(0, 0), at_l=(0, 0), stiffness=1e5, length=0.0)
        pin = s.rigid_body("pin", 1.0, 1e-3, at=(0, 0), velocity=(0.5, 0.1, 0))
        s.revolute("J", race, pin, at=(0, 0), model=mb.Clearance(0.0501, 0.05, HERTZ, friction=mb.Coulomb(0.3, 1e-2)))
        e = s.simulate(0.01, accuracy=1e-6).energy
        assert e.friction[-1] != 0
        return float(np.abs(e.other[-1]) / np.abs(e.friction[-1]))

    assert other_over_friction() < 1e-10
    monkeypatch.setattr("mbdae.scene.joints.JournalContact", WithoutRotation)
    assert other_over_friction() > 0.1


@pytest.mark.parametrize("friction", [None, mb.Coulomb(0.3, 1e-3), mb.LuGre(0.2, 0.3, 1e-3, 1e5, 31.0)],
                         ids=["none", "Coulomb", "LuGre"])
@pytest.mark.parametrize("clearance", [1e-4, 0.0])
def test_finite_where_pin_and_race_are_concentric_at_rest_or_just_touch(friction: Any, clearance: float) -> None:
    d = derived(PLANAR, friction=friction)
    p = linearised_plan(d, ggl_outputs)
    zero = dict.fromkeys([str(s) for f in d.frames for s in (*f.q, *f.u)], 0.0)
    given = GIVEN | {"outer": 0.05 + clearance, "friction_mu_k": 0.2, "friction_mu_s": 0.3, "friction_v_s": 1e-3,
                     "friction_sigma0": 1e5, "friction_sigma1": 31.0, "state_z": 0.0, "statep_z": 0.0}
    frames = {f"{side}_{name}": 1.0 if name in ("Qx1", "Qy2", "Qz3") else 0.0 for side in "kl"
              for name in ("p1", "p2", "p3", "theta0", *(f"Q{a}{i}" for a in "xyz" for i in (1, 2, 3)))}
    for x in (0.0, 1e-300, 1e-15, clearance, clearance * (1 + 1e-12) + 1e-12):
        values = {k: np.array([v]) for k, v in (zero | frames | given | {"l_r1": x}).items()}
        for kernel, inputs in ((p.residual, p.residual_inputs), (p.jacobian, p.jacobian_inputs)):
            assert np.all(np.isfinite(kernel.values(columns(inputs.symbols, values))))


def test_friction_acts_where_pin_and_race_touch() -> None:
    """A pin displaced by d along x in a race much larger than it: friction turns the pin with the lever outer - d, which is its
    radius less the penetration, and the race with the lever outer, in the opposite sense."""
    outer, inner, d, mass, J, J_race = 0.08, 0.05, 0.0301, 2.0, 0.004, 0.03
    s = mb.Scene("loose", space="planar")
    race = s.rigid_body("race", 5.0, J_race, at=(0, 0))
    pin = s.rigid_body("pin", mass, J, at=(0, 0))
    s.revolute("J", race, pin, at=(0, 0), model=mb.Clearance(outer, inner, mb.Hertz(1e9), friction=mb.Coulomb(0.3, 1e-3)))
    m = prepare(s).mechanics
    q, u = np.zeros((1, 6)), np.zeros((1, 6))
    q[0, m.model.node(pin).q], u[0, m.model.node(pin).u + 1] = d, 0.7
    a = m.accelerations(np.zeros(1), q, u, np.zeros((1, 0)))[0][0]
    of_race, of_pin = (a[node.u : node.u + 3] for node in map(m.model.node, (race, pin)))
    along, across = mass * of_pin[:2]
    assert along == pytest.approx(-1e9 * (d - outer + inner) ** 1.5, rel=1e-9)
    assert abs(across) > 0.2 * abs(along)
    assert J * of_pin[2] == pytest.approx((outer - d) * across, rel=1e-9)
    assert J_race * of_race[2] == pytest.approx(-outer * across, rel=1e-9)


class LinearDamped(mb.Normal):
    """A spring and a damper."""

    params = mb.params(stiffness="N/m", damping="N s/m")

    def energy(self, p: Any) -> Any:
        return self.stiffness * p**2 / 2

    def damping_force(self, p: Any, rate: Any) -> Any:
        return self.damping * rate


@pytest.mark.parametrize("damping", [0.0, 4.0])
def test_growth_of_flutter_is_that_of_a_mass_with_two_freedoms(damping: float) -> None:
    """A mass in contact moves along the normal (stiffness k, damping) and across it (f / d); either force is turned by friction,
    mu times it, into the other direction. Eigenvalues to first order in growth over frequency."""
    k, mass, depth, play, mu = 1e7, 2.0, 1e-3, 2e-5, 0.02
    law = JournalContact("D", None, None, outer=0.05 + play, inner=0.05, normal=LinearDamped(stiffness=k, damping=damping),
                         friction=mb.Coulomb(mu, 1e-3))
    f = k * depth
    across = f / (play + depth)
    K, C = np.array([[k, -mu * across], [mu * k, across]]), np.diag([damping, 0.0])
    roots = np.linalg.eigvals(np.block([[np.zeros((2, 2)), np.eye(2)], [-K / mass, -C / mass]]))
    fastest = roots[np.argmax(roots.real)]
    growth, rate = law.instability(mass, np.array([depth, -depth, depth]), np.array([f, f, 0.0]), np.full(3, mu * f))
    assert growth[0] == pytest.approx(fastest.real, rel=2e-3)
    assert rate[0] == pytest.approx(abs(fastest.imag), rel=2e-3)
    assert not growth[1:].any()
    assert not rate[1:].any()


@pytest.mark.parametrize(("play", "force", "speed"), [(1e-3, 50.0, 0.0), (1e-8, 50.0, 0.0), (1e-3, 1e-9, 0.0), (1e-3, 50.0, 0.4)])
def test_expected_depth_is_that_of_a_fall_through_the_play(play: float, force: float, speed: float) -> None:
    """A speed that is known counts alone. Else a force F works F play before the first touch, and presses at rest; a hundredth of
    the play and a millionth of the pin are the least."""
    k, m, radius = 1e9, 3.0, 0.05
    law = JournalContact("D", None, None, outer=radius + play, inner=radius, normal=mb.Hertz(k))
    of_energy = lambda energy: (2.5 * energy / k) ** 0.4  # noqa: E731
    rest = (force / k) ** (2 / 3)
    expected = of_energy(m * speed**2 / 2) if speed else max(of_energy(force * play), rest, 1e-2 * play, 1e-6 * radius)
    found = law.expected_depth(Impact(mass=m, speed=speed, force=force, gap=play, size=1.0, time=1.0))
    assert found == pytest.approx(expected, rel=1e-6)
