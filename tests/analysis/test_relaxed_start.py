"""A start in which elastic bodies are strained by their loads: no ringing, beside equilibria, and what is kept."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
import sympy

import mbdae as mb
from mbdae.run.choice import prepared_from

STEEL = mb.Section.rectangular(0.02, 0.01, E=210e9, nu=0.3, rho=7850.0, damping=1e-6)


def engine(**drive: Any) -> mb.Scene:
    """A slider-crank with an elastic rod."""
    R, L = 0.05, 0.2
    s = mb.Scene("engine")
    crank, rod = s.link("crank", (0, 0), (R, 0), mass=2.0), s.beam("rod", (R, 0), (R + L, 0), section=STEEL, elements=2)
    ram = s.rigid_body("ram", 0.5, 1e-3, at=(R + L, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), **drive)
    s.revolute("B", crank, rod, at=(R, 0))
    s.revolute("C", rod, ram, at=(R + L, 0))
    s.prismatic("D", s.ground, ram, at=(R + L, 0), axis=(1, 0, 0))
    return s


def rotor(angle: Any) -> mb.Scene:
    """A beam on a hub; its first frequency is 580 rad/s."""
    s = mb.Scene("rotor")
    hub, blade = s.rigid_body("hub", 1.0, 1e-3, at=(0, 0)), s.beam("blade", (0.02, 0), (0.32, 0), section=STEEL, elements=3)
    s.revolute("A", s.ground, hub, at=(0, 0), angle=angle)
    s.weld("F", hub, blade, at=(0.02, 0))
    return s


def test_the_first_peak_of_a_flexible_rod_is_that_of_its_steady_running() -> None:
    """3000 1/min; the steady peak is that of `test_periodic`."""
    s = engine(angle=100 * np.pi * mb.t)
    first = s.simulate(0.02, 1e-3, start="relaxed", of=["B.force"])
    assert first.peak("B.force").value == pytest.approx(4826.0, rel=1e-3)
    assert not first.warnings
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert s.simulate(0.02, 1e-3).peak("B.force").value > 1.8 * 4826.0


def test_energy_of_a_relaxed_start_is_that_of_steady_running() -> None:
    """The rod's strain counts from the start on; after a turn the energy is the same again, and what the drive did is damped."""
    r = engine(angle=100 * np.pi * mb.t).simulate(0.02, 1e-3, start="relaxed", of=["B.force"])
    e = r.energy
    total = e.kinetic + e.potential
    assert e.potential[0] > 1e-4 * total[0]
    assert np.max(np.abs(e.balance)) < 1e-7 * np.max(total)
    assert total[-1] == pytest.approx(total[0], rel=1e-6)
    assert 0 < e.work[-1] < 1e-5 * total[0]


@pytest.mark.parametrize("rate", [100, 300, pytest.param(700, marks=pytest.mark.slow)])
def test_a_turning_beam_begins_in_its_relative_equilibrium(rate: float) -> None:
    """Also above the first frequency of the beam, where only long polynomials find it."""
    s = rotor(rate * mb.t)
    found, rest = prepared_from(s, "relaxed").start, s.equilibrium(frame="hub").prepared.start
    assert found.relaxed < 1e-4
    assert np.linalg.norm(found.u - rest.u) <= max(found.relaxed, 1e-8) * np.linalg.norm(rest.u)
    np.testing.assert_allclose(found.q, rest.q, atol=max(found.relaxed, 1e-8))


@pytest.mark.parametrize("rate", [0.0, 1e-9, 1e-6])
def test_a_beam_that_hardly_turns_begins_relaxed(rate: float) -> None:
    """Its corrections are round-off from the first on."""
    start = prepared_from(rotor(rate * mb.t), "relaxed").start
    assert start.relaxed < 1e-6
    assert not start.changes
    blade = np.hypot(*start.u.reshape(-1, 3)[:, :2].T)
    assert np.max(blade) == pytest.approx(0.32 * rate, rel=1e-6, abs=1e-13)


@pytest.mark.parametrize("rate", [1e-8, 1e-6])
def test_a_beam_without_a_hub_that_hardly_turns_begins_relaxed(rate: float) -> None:
    """Its forces are round-off of its stiffness; its corrections end all the same."""
    s = mb.Scene("rod")
    beam = s.beam("b", (0, 0), (1, 0), section=mb.Section.rectangular(0.01, 0.01, E=2e11, nu=0.3, rho=7800.0), elements=3)
    s.revolute("R", s.ground, beam.at(0), at=(0, 0), angle=rate * mb.t)
    assert prepared_from(s, "relaxed").start.relaxed < 1e-6


def test_a_shaken_beam_has_the_peak_of_its_periodic_motion() -> None:
    s, T = rotor(0.1 * sympy.sin(50 * mb.t)), 2 * np.pi / 50
    first = s.simulate(T, 1e-3, start="relaxed", of=["F.torque"]).peak("F.torque")
    assert first.value == pytest.approx(3.91452, rel=1e-3)  # that of s.periodic(T, 1e-4, of=["F.torque"])


def test_momentum_of_what_is_free_is_kept() -> None:
    """A beam that flies and turns: nothing acts, so that it is stretched, and its momentum is the one that was stated."""
    s = mb.Scene("flight", gravity=(0, 0, 0), space="spatial")
    s.beam("b", (0, 0, 0), (1, 0, 0), section=STEEL, elements=2, angular_velocity=(3, 100, 2), velocity=(1, 2, 3))
    unstrained, relaxed = (prepared_from(s, start) for start in (None, "relaxed"))
    M = unstrained.mechanics.mass
    kept = [float(sum((M @ p.start.u)[n.u + i] for n in p.model.nodes)) for p in (unstrained, relaxed) for i in range(3)]
    np.testing.assert_allclose(kept[3:], kept[:3], rtol=1e-10)
    ends = [[n.position(p.start.q) for n in (p.model.nodes[0], p.model.nodes[-1])] for p in (unstrained, relaxed)]
    length = [float(np.linalg.norm(b - a)) for a, b in ends]
    assert length[1] - length[0] == pytest.approx(7850 * 1e4 / 12 / 210e9, rel=2e-3)  # rho w^2 L^3 / (12 E)


def test_a_crank_under_a_torque_begins_without_ringing() -> None:
    s = engine(torque=10.0)
    prepared = prepared_from(s, "relaxed")
    assert prepared.start.relaxed < 1e-4
    run = s.simulate(0.01, 1e-3, start="relaxed", of=["B.force"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shock = s.simulate(0.01, 1e-3, of=["B.force"])
    early = [float(np.ptp(np.linalg.norm(r["B"].force[:20], axis=1))) for r in (run, shock)]
    assert early[0] < 0.1 * early[1]


def cantilever(load: float, damping: float = 1e-6) -> mb.Scene:
    section = mb.Section.rectangular(0.02, 0.01, E=210e9, nu=0.3, rho=7850.0, damping=damping)
    s = mb.Scene("cantilever", gravity=(0, -load, 0))
    s.weld("wall", s.ground, s.beam("beam", (0, 0), (1, 0), section=section, elements=3), at=(0, 0))
    return s


def test_checks_say_where_a_start_rings_and_for_how_long() -> None:
    """A cantilever under its weight, m g L^3 / (8 EI) at first; damping eta leaves exp(-eta w^2 t / 2) of the first mode."""
    found, EI, per_length = cantilever(9.81).check().ringing, 210e9 * 0.02 * 0.01**3 / 12, 7850 * 0.02 * 0.01
    rate = 1.8751**4 * EI / per_length * 1e-6 / 2
    assert found.over == pytest.approx(np.log(100) / rate, rel=0.06)  # 3 % of the energy is in further modes
    assert found.amplitude == pytest.approx(per_length * 9.81 / (8 * EI), rel=0.01)
    assert "start unstrained: expect ringing until" in str(cantilever(9.81).check())
    assert "ringing for the whole run" in str(cantilever(9.81, 0.0).check())
    for still in (cantilever(0.0), rotor((1 - sympy.cos(50 * mb.t)) ** 2)):
        assert still.check().ringing is None
        assert "ringing" not in str(still.check())


def test_what_it_cannot_do_is_refused_and_rigid_scenes_start_as_drawn() -> None:
    s = engine(angle=100 * mb.t)
    with pytest.raises(mb.OptionError, match="'strained' is not one of 'relaxed'"):
        s.simulate(0.01, start="strained")
    with pytest.raises(mb.DerivativeError, match="relaxed"):
        s.simulate(0.01, 1e-3, start="relaxed", derivatives=True)
    with pytest.raises(mb.StartError, match="elastic bodies vibrate as slowly as the scene moves"):
        rotor(3000 * mb.t).simulate(0.01, start="relaxed")
    rigid = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rigid.revolute("A", rigid.ground, rigid.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    a, b = (rigid.simulate(0.1, start=start) for start in (None, "relaxed"))
    np.testing.assert_array_equal(a["A"].angle, b["A"].angle)


def test_runs_of_a_comparison_begin_relaxed_with_every_joint_model() -> None:
    """Unstrained the rod's force is off by nearly its size at first; a pin with play is refused in its row, by name."""
    s = engine(angle=100 * np.pi * mb.t)
    waves = mb.GGL(waves=True)
    runs = [mb.Run(mb.RadauIIA(3), form=waves), mb.Run(mb.RadauIIA(3), form=waves, model=mb.Recursive()),
            mb.Run(mb.RadauIIA(3), model={"B": mb.Clearance(0.0101, 0.01, mb.Hertz(1e9))})]
    found = mb.compare(s, 0.002, runs, accuracies=[1e-4], measure="B.force", start="relaxed")
    size = np.linalg.norm(s.simulate(0.002, 1e-3, start="relaxed", outputs=5)["B"].force, axis=1).max()
    assert [run.failure is None for run in found.runs] == [True, True, False]
    assert all(run.error < 1e-2 * size for run in found.runs[:2])
    assert "where the pin of B would touch is not known" in found.runs[2].failure


def test_comparisons_refuse_starts_that_other_programs_and_equations_do_not_take() -> None:
    s = engine(angle=100 * np.pi * mb.t)
    with pytest.raises(mb.OptionError, match="other programs begin as stated"):
        mb.compare(s, 0.01, start="relaxed", engines=["scipy"])
    with pytest.raises(mb.OptionError, match="'strained' is not one of 'relaxed'"):
        mb.compare(s, 0.01, start="strained")
    with pytest.raises(mb.OptionError, match="a System begins as stated"):
        mb.compare(s.system(), 0.01, start="relaxed")


def test_every_point_of_a_sweep_begins_relaxed() -> None:
    """As a call of its own, to the error that it tells: the first peak of the rod's force follows the mass of the ram."""
    s = engine(angle=100 * np.pi * mb.t)
    w = mb.sweep(s, {"ram.mass": [0.4, 0.5]}, t_end=0.002, accuracy=1e-3, of=["B.force"], start="relaxed", workers=1)
    alone = s.simulate(0.002, 1e-3, start="relaxed", of=["B.force"]).peak("B.force")
    assert w.peaks("B.force").value[1] == pytest.approx(alone.value, rel=0, abs=alone.error)
    assert alone.error < 1e-8 * alone.value
    assert w.peaks("B.force").value[0] < 0.95 * alone.value
    plain = mb.sweep(s, {"ram.mass": [0.5]}, t_end=0.002, accuracy=1e-3, start="relaxed", workers=1)
    assert "relaxed start" in plain.why
    with pytest.raises(mb.OptionError, match="begin relaxed have no derivatives"):
        mb.sweep(s, {"ram.mass": [0.5]}, t_end=0.002, of=["B.force"], derivatives=["ram.mass"], start="relaxed")
