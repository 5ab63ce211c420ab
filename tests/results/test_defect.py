"""What acts between the points at which a solver looks at the equations is told: the defect of a run and its closer look."""

from __future__ import annotations

import numpy as np
import pytest
import symengine as se
import sympy as sp

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.run.defect import POINTS, Defect, Suspect, integrals, may_have_short_events
from mbdae.system.prepare import prepare

pytestmark = pytest.mark.filterwarnings("ignore::mbdae.errors.AccuracyWarning")


@pytest.fixture(autouse=True)
def unresolved(monkeypatch):
    """Nothing is known before a run: what is stepped over can be found between its points alone."""
    monkeypatch.setattr("mbdae.system.scene_system.WATCH_INPUTS_AND_SWITCHES", False)


SOLVERS = [mb.CVODE(), mb.RadauIIA(3), mb.RadauIIA(2), mb.IDA(), mb.CVODE(method="BDF"), mb.RadauIIA(3, step=5.0),
           mb.HHT(step=10.0)]
TOLD = "was not evaluated there"


def box(centre, width, t=mb.t):
    return sp.Piecewise((0, t < centre - width / 2), (1, t < centre + width / 2), (0, True))


def pushed(load, velocity=0.0):
    """A free body of 1 kg."""
    s = mb.Scene("body")
    s.force("F", s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 0), velocity=(velocity, 0, 0)), (load, 0, 0))
    return s


def told(r):
    return [note for note in r.warnings if TOLD in note]


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: s.label)
def test_a_thrust_that_every_solver_steps_over_is_told(solver):
    """A thrust of 1 N s leaves 1 m/s; the run stays at rest, and both of its runs agree on that."""
    r = pushed(box(6.8, 1.0)).simulate(20.0, solver=solver)
    assert r["b"].velocity[-1, 0] < 0.1
    (note,) = told(r)
    assert "momentum of b.vx" in note
    begin, end = (float(word) for word in note.split("about t = ")[1].split(" s ")[0].split(" to "))
    assert 6.3 <= begin < end <= 7.3
    size = float(note.split("differs by ")[1].split()[0])
    assert size > 0.1


def test_what_the_solver_saw_is_not_told():
    """The same thrust in a run whose steps are shorter than it."""
    r = pushed(box(6.8, 1.0)).simulate(20.0, solver=mb.RadauIIA(3, step=0.1))
    assert r["b"].velocity[-1, 0] == pytest.approx(1.0, rel=0.05)
    assert not told(r)


def test_a_drive_that_returns_is_told_although_the_run_ends_where_it_should():
    s = mb.Scene("rod", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), angle=0.1 * sp.exp(-(((mb.t - 5) / 0.02) ** 2)))
    r = s.simulate(10.0, outputs=np.linspace(0, 10, 2001))
    assert np.abs(r["A"].angle).max() < 0.01
    assert told(r)


def test_a_load_of_a_joint_is_told_in_motion():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0), torque=100 * box(0.7003, 0.004))
    plain = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    plain.revolute("A", plain.ground, plain.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    r, without = (scene.simulate(2.0, 1e-4, solver=mb.RadauIIA(3)) for scene in (s, plain))
    assert abs(r["A"].angle[-1] - without["A"].angle[-1]) < 1e-3
    assert told(r)
    assert not told(without)


class Wall(mb.Force):
    """A potential of 10 J ahead of a body that has half a joule."""

    params = mb.params(width=("m", "width"))

    def energy(self, k, l):
        return 10 * se.exp(-((((l.r - k.r) @ k.x - 1) / self.width) ** 2))


def test_a_law_in_space_that_is_passed_through_is_told():
    s = mb.Scene("wall")
    b = s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.prismatic("P", s.ground, b, at=(0, 0, 0), axis=(1, 0, 0), rate0=1.0)
    s.add(Wall("W", s.ground, b, at=(0, 0, 0), at_l=(0, 0, 0), width=0.05))
    r = s.simulate(3.0, solver=mb.CVODE())
    assert r["P"].displacement[-1] > 1
    assert told(r)


def test_a_load_along_a_beam_is_told():
    s = mb.Scene("beam")
    b = s.beam("b", (0, 0), (1, 0), section=mb.Section.rectangular(0.02, 0.02, E=1e7, nu=0.3, rho=1000), elements=2)
    s.weld("A", s.ground, b, at=(0, 0))
    s.line_load("q", b, (0, 5 * box(3.1, 0.5), 0))
    r = s.simulate(10.0, 1e-4)
    assert np.abs(r["b.at(1)"].position[-1] - [1, 0, 0]).max() < 1e-6
    assert told(r)


@pytest.mark.parametrize("load", [sp.sin(5 * mb.t), sp.tanh(3 * (mb.t - 2)), mb.t**4 / 100, sp.exp(-((mb.t - 2) ** 2))],
                         ids=str)
def test_inputs_that_steps_resolve_need_no_word(load):
    for solver in (None, mb.IDA(), mb.RadauIIA(2), mb.RadauIIA(3, step=0.05)):
        assert not told(pushed(load, 0.5).simulate(4.0, 1e-5, solver=solver))


def test_a_suspect_that_a_closer_run_clears_is_not_told(monkeypatch):
    """Every step of a good run is called a suspect."""

    def all_of_them(self, limit):
        t, inside = self.run.t, (np.arange(4) + 0.5) / 4
        steps = range(3, len(t) - 1)
        return [Suspect(i, 1.0, t[i] + inside * (t[i + 1] - t[i]), np.ones(4, dtype=bool), "all", limit) for i in steps]

    monkeypatch.setattr(Defect, "suspects", all_of_them)
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), damper=0.1)
    for solver in (None, mb.RadauIIA(3), mb.IDA()):
        assert not told(s.simulate(2.0, solver=solver))


def test_the_same_run_is_judged_alike():
    first, second = (pushed(box(6.8, 1.0)).simulate(20.0) for _ in range(2))
    assert first.warnings == second.warnings


def looked_at(scene, t_end):
    """The defect of a run after it was looked at, and its solution."""
    prepared = prepare(scene)
    system = system_for(prepared, None, 3)
    run = mb.RadauIIA(3, rtol=1e-7).solve(system, t_end)
    defect = Defect(prepared, system, run)
    assert not defect.suspects(1e-5)
    return defect, run


def test_scenes_in_which_nothing_can_hide_pay_three_per_cent():
    s = mb.Scene("chain", gravity=(0, -9.81, 0))
    previous = s.ground
    for i in range(3):
        link = s.link(f"l{i}", (i, 0), (i + 1, 0), mass=1.0)
        s.revolute(f"J{i}", previous, link, at=(i, 0), spring=3.0, damper=0.1, angle=3 * mb.t if i == 0 else None)
        previous = link
    defect, run = looked_at(s, 2.0)
    assert not may_have_short_events(defect.prepared, defect.system)
    assert 0 < defect.evaluations <= 0.03 * run.stats.residuals
    defect, run = looked_at(pushed(sp.sin(mb.t)), 5.0)
    assert may_have_short_events(defect.prepared, defect.system)
    assert defect.evaluations >= POINTS * run.stats.steps


def test_what_is_resolved_before_the_run_hides_nothing(monkeypatch):
    """Then the same scenes pay three per cent too, and are right."""
    monkeypatch.setattr("mbdae.system.scene_system.WATCH_INPUTS_AND_SWITCHES", True)
    defect, run = looked_at(pushed(sp.sin(mb.t)), 5.0)
    assert defect.evaluations <= 0.03 * run.stats.residuals
    r = pushed(box(6.8, 1.0)).simulate(20.0)
    assert r["b"].velocity[-1, 0] == pytest.approx(1.0, abs=1e-6)
    assert not r.warnings


def test_weights_integrate_polynomials_and_what_acts_in_one_point():
    """Exactly to degree 5; a value in one of 12 points is worth about a twelfth."""
    inside = (np.arange(12) + 0.5 + 0.4 * np.sin(np.arange(12.0))) / 12
    smooth, rough = integrals(inside)
    to = np.append(inside[1:], 1.0)
    for degree in range(6):
        np.testing.assert_allclose((smooth + rough) @ inside**degree, to ** (degree + 1) / (degree + 1), atol=1e-13)
    spike = np.eye(12)[4]
    assert ((smooth + rough) @ spike)[-1] == pytest.approx(1 / 12, rel=0.5)
    np.testing.assert_allclose(rough @ inside**3, 0, atol=1e-13)


def test_its_cost_is_counted(monkeypatch):
    import mbdae.run.job as job

    spent = []
    real = job.rechecked
    monkeypatch.setattr(job, "rechecked", lambda *given: spent.append(real(*given)) or spent[-1])
    r = pushed(box(6.8, 1.0)).simulate(20.0, solver=mb.CVODE())
    (missed,) = spent
    assert missed.cpu_s > 0
    assert r.info.cpu_s >= missed.cpu_s + r.stats.cpu_s
    (found,) = missed.contradictions
    assert found.step > 2 * found.longest
