"""Events: none missed, located to 1e-9 of the run, named where they cannot be."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.errors import OptionError, StartError
from mbdae.run.event_roots import roots

G, END = 9.81, 3.0


def thrown(seed):
    """Three thrown points with conditions whose instants are known: {condition: times}."""
    rng = np.random.default_rng(seed)
    s, wanted = mb.Scene("thrown", gravity=(0, -G, 0)), {}
    bodies = []
    for i, v in enumerate(rng.uniform(6, 14, 3).tolist()):
        bodies.append(s.point_mass(f"b{i}", 1.0, at=(i, 0), velocity=(0.3, v)))
        top, height = v / G, v**2 / (2 * G)
        level, near = float(rng.uniform(0.05, 0.95)) * height, float(10 ** rng.uniform(-5, -3))
        apart = float(np.sqrt(2 * (height - level) / G))
        wanted[f"b{i}.position[1] == {level!r}"] = [top - apart, top + apart]
        wanted[f"b{i}.position[1] == {height!r}"] = [top]  # grazing
        wanted[f"b{i}.position[1] > {height - G * near**2 / 2!r}"] = [top - near, top + near]
        wanted[f"b{i}.position[1] == 0"] = [0.0, 2 * top]  # at the start
    at, step, w = (float(x) for x in (*rng.uniform(0.3, 2.7, 2), rng.uniform(20, 60)))
    wanted |= {sp.Eq(mb.t, at): [at], sp.Gt(mb.t**2, at**2): [at], sp.Eq((mb.t - at) ** 3, 0): [at]}  # several at once
    s.force("F", bodies[0], (sp.Piecewise((0, mb.t < step), (1.0, True)), 0, 0))
    s.signal("step", sp.Piecewise((-1, mb.t < step), (1, True)))
    s.signal("fast", sp.sin(w * mb.t))
    wanted["step > 0"] = [step]  # at a break
    wanted["fast == 0"] = [k * np.pi / w for k in range(100)]
    return s, {condition: [t for t in times if t <= END] for condition, times in wanted.items()}


@pytest.mark.parametrize("seed", range(4))
def test_no_event_is_missed(seed):
    s, wanted = thrown(seed)
    r = s.simulate(END, record=list(wanted), accuracy=1e-10)
    for condition, times in wanted.items():
        found = [event.time for event in r.events if event.name == str(condition)]
        np.testing.assert_allclose(found, times, atol=1e-9 * END, err_msg=str(condition))


def test_zeros_of_any_function():
    edges = np.linspace(0, 1, 4)
    assert [root.time for root in roots(lambda t: np.abs(t - 0.4) - 0.1, edges)] == pytest.approx([0.3, 0.5], abs=1e-12)
    assert [root.time for root in roots(lambda t: np.where(t < 0.7, -1.0, 2.0), edges)] == pytest.approx([0.7], abs=1e-12)
    close = roots(lambda t: (t - 0.5) * (t - 0.5 - 1e-6) * (t - 0.9), edges)
    assert [root.time for root in close] == pytest.approx([0.5, 0.5 + 1e-6, 0.9], abs=1e-9)
    assert [(root.before, root.after) for root in close] == [(-1, 1), (1, -1), (-1, 1)]
    (touched,) = roots(lambda t: (t - 1 / 3) ** 2, edges)  # between two steps
    assert (touched.time, touched.before, touched.after) == (pytest.approx(1 / 3, abs=1e-7), 1, 1)
    assert roots(lambda t: (t - 0.5) ** 2 + 1e-6, edges) == []
    assert len(roots(lambda t: (t - 0.5) ** 2 + 1e-6, edges, touch=1e-5)) == 1


def pendulum(angle=None):
    s = mb.Scene("pendulum", gravity=(0, -G, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("J", s.ground, rod, at=(0, 0), angle=angle)
    return s


@pytest.mark.parametrize("solver", [None, "radau3", "ida", "cvode", "dop853"])
def test_runs_end_at_the_event(solver, tmp_path):
    s = pendulum() if solver is None else pendulum().recursive()
    r = s.simulate(3.0, until="J.angle < -1.0", record=["J.angle == -0.5"], solver=solver, accuracy=1e-8)
    assert r["J"].angle[-1] == pytest.approx(-1.0, abs=1e-9)
    assert [(event.name, event.direction) for event in r.events] == [("J.angle == -0.5", -1), ("J.angle < -1.0", 1)]
    assert r.complete
    assert r.t[-1] == r.solution.t[-1] == r.events[-1].time
    assert r.accuracy.estimated < 1e-8
    r.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz")
    assert again.events == r.events
    np.testing.assert_array_equal(again["J"].angle, r["J"].angle)


@pytest.mark.parametrize("solver", ["radau3", "ida", "cvode", "dop853"])
def test_runs_end_at_an_event_shortly_after_which_the_motion_ends(solver):
    """The force is a root that has no value from 5 mm behind the event on: with c = limit - x, c' = -v and v' = root(c) / 10, so
    that v^2 = 1 + (limit^1.5 - c^1.5) 2 / 15."""
    limit = 1.005
    s = mb.Scene("pulled")
    s.force("F", s.point_mass("b", 1.0, at=(0, 0), velocity=(1, 0)), (sp.sqrt(limit - s.sensor("b.position[0]")) / 10, 0, 0))
    r = s.simulate(3.0, until="b.position[0] > 1", solver=solver, accuracy=1e-7)
    assert [event.time for event in r.events] == [r.t[-1]]
    assert r.complete
    assert r["b"].position[-1, 0] == pytest.approx(1.0, abs=1e-9)
    assert r["b"].velocity[-1, 0] ** 2 == pytest.approx(1 + (limit**1.5 - (limit - 1) ** 1.5) * 2 / 15, abs=1e-6)


def test_symbols_and_joined_conditions():
    s = pendulum()
    q, w = s.sensor("J.angle"), s.sensor("J.rate")
    r = s.simulate(3.0, record=[sp.Eq(w, 0), sp.And(q < -1, w > 0)], until=sp.Or(q < -3, w > 100), accuracy=1e-8)
    assert r["J"].angle[-1] == pytest.approx(-3, abs=1e-9)
    assert [event.direction for event in r.events] == [-1, 1]
    turned = s.simulate(1.8, record="And(J.angle < -1, J.rate > 0)", accuracy=1e-8).events
    assert [event.direction for event in turned] == [1, -1]


def test_whole_turns_of_spatial_angles_count():
    s = mb.Scene("spin", space="spatial")
    rotor = s.rigid_body("rotor", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.revolute("J", s.ground, rotor, at=(0, 0, 0), rate0=10.0, model=mb.Kinematic())
    r = s.simulate(3.0, until="J.angle > 20", record="J.angle == 0", accuracy=1e-8)
    assert r.t[-1] == pytest.approx(2.0, abs=1e-8)
    assert [event.time for event in r.events] == [0.0, r.t[-1]]


@pytest.mark.parametrize("large", [False, True])
def test_a_lock_stops_motions_by_an_impact_without_rebound(large, monkeypatch):
    """The rod of a pendulum on a trolley that is locked keeps its angular momentum about the pivot."""
    if large:  # by sparse matrices
        monkeypatch.setattr("mbdae.system.motion.mechanics.LARGE", 3)

    def scene(held=None):
        s = mb.Scene("crane", gravity=(0, -G, 0))
        trolley = s.rigid_body("trolley", 2.0, 1.0, at=(0, 0), velocity=(1, 0) if held is None else (0, 0))
        rod = s.link("rod", (0, 0), (0, -1), mass=1.0)
        s.prismatic("rail", s.ground, trolley, at=(0, 0), axis=(1, 0, 0), **({} if held is None else {"position": held}))
        s.revolute("pivot", trolley, rod, at=(0, 0))
        return s.replace("rail", "pivot", model=mb.Kinematic()) if large else s

    first = scene().simulate(2.0, until="rail.displacement > 0.5", accuracy=1e-9)
    before = first["rod"]
    arm = before.position[-1] - first["trolley"].position[-1]
    spin = np.cross(arm, before.velocity[-1])[2] + before.angular_velocity[-1, 2] / 12
    for form in (None, "ggl"):
        second = scene(held=0.5).simulate(3.0, start=first, accuracy=1e-9, form=form)
        assert second["pivot"].rate[0] == pytest.approx(3 * spin, abs=1e-9)
        assert "impact without rebound" in second.start.changes[0]
        assert np.max(np.abs(second.energy.balance)) < 1e-7
    with pytest.raises(StartError, match=r"row rail.drive is off"):
        scene(held=0.6).simulate(3.0, start=first)


@pytest.mark.parametrize(("option", "given", "said"), [
    ("until", "J.angle", "it is no comparison"), ("until", 3, "it is no comparison"), ("until", "J.angle > ", "is expected"),
    ("until", "J.angl > 1", "did you mean 'J.angle'?"), ("until", False, "Python's own"),
    ("record", ["1 > 0"], "does not depend"),
    ("until", "J.angle < 1", "holds already at the start"), ("record", "rod.acceleration > 1", "which component"),
])
def test_conditions_that_are_none_are_named(option, given, said):
    with pytest.raises(OptionError, match=option) as refused:
        pendulum().simulate(1.0, **{option: given})
    assert said in str(refused.value)


def test_what_accuracy_leaves_undecided_is_said():
    s = mb.Scene("thrown", gravity=(0, -G, 0))
    s.point_mass("b", 1.0, at=(0, 0), velocity=(1, 10))
    limit = 100 / (2 * G) + 1e-9
    with pytest.warns(mb.errors.AccuracyWarning, match="comes so near to its limit"):
        r = s.simulate(2.0, until=f"b.position[1] > {limit!r}")
    assert r.t[-1] == 2.0
    assert not r.events


def rolling():
    """A block that goes at 1 m/s."""
    s = mb.Scene("rolling")
    block = s.rigid_body("block", 1.0, 1.0, at=(0, 0))
    s.prismatic("P", s.ground, block, at=(0, 0), axis=(1, 0, 0), rate0=1.0)
    return s


WIDE = 1e-6 * float(np.sqrt(np.log(2)))


@pytest.mark.parametrize(("condition", "wanted"), [
    ("And(P.displacement > 3.3, P.displacement < 3.30001)", [3.3, 3.30001]),
    ("exp(-((P.displacement - 3.3)/1e-6)**2) > 0.5", [3.3 - WIDE, 3.3 + WIDE]),
    ("exp(-((t - 3.3)/1e-6)**2) > 0.5", [3.3 - WIDE, 3.3 + WIDE]),
    ("frac(P.displacement/7 + 3.7/7) < 1e-6", [3.3, 3.3 + 7e-6]),
    *[(mb.table([0, 3.3, 3.30001, 3.30002, 10], [0, 0, 1, 0, 0], kind=kind) > 0.5, wanted) for kind, wanted in (
        ("linear", [3.300005, 3.300015]), ("cubic", [3.300005, 3.300015]), ("step", [3.30001, 3.30002]))],
    (mb.table([0, 3.3, 3.30001, 3.30002, 10], [0, 0, 1, 0, 0]).subs(mb.t, 2 * mb.t - 1) > 0.5, [2.1500025, 2.1500075]),
])
def test_conditions_that_hold_for_a_millionth_of_the_run_are_found(condition, wanted):
    found = [(event.time, event.direction) for event in rolling().simulate(10.0, record=[condition]).events]
    assert [time for time, _ in found] == pytest.approx(wanted, abs=1e-8)
    assert [direction for _, direction in found] == [1, -1]


def test_ten_thousand_events_are_found_at_once():
    r = rolling().simulate(10.0, record=["sin(1000*pi*P.displacement) == 0"])
    np.testing.assert_allclose([event.time for event in r.events], np.arange(10001) / 1000, atol=1e-8)


def test_what_is_recorded_shortly_before_the_end_of_a_short_run_stays_there():
    """At 100 km/s, 1 m is reached after 10 us, 0.9 m before: instants are told apart by the length of the run."""
    s = mb.Scene("fast")
    s.point_mass("b", 1.0, at=(0, 0), velocity=(1e5, 0))
    r = s.simulate(1.0, until="b.position[0] > 1", record=["b.position[0] > 0.9", "b.position[0] > 1"])
    assert [event.time for event in r.events] == pytest.approx([0.9e-5, 1e-5], rel=1e-8)
