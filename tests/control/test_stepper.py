"""Steps from outside: equal to runs with a sampled controller, bit for bit; states, batches, inputs, errors."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
import sympy

import mbdae as mb
from mbdae.errors import AccuracyWarning, OptionError, SceneError, SolverError

DT = 0.01


def wave(t):
    return 3 * np.sin(5 * t)


def held(s, controlled):
    if controlled:
        s.controller("C", wave, every=DT, sets=["u"])
    else:
        s.signal("u", 0.0)
    return s


def pendulum(controlled=False, torque="u", **options):
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("J", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), torque=torque, **options)
    return held(s, controlled)


def four_bar(controlled=False):
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    a, b, c = (s.link(name, *ends, mass=m) for name, ends, m in (
        ("a", ((0, 0), (0, 0.3)), 1.0), ("b", ((0, 0.3), (1, 0.6)), 2.0), ("c", ((1, 0.6), (1, 0)), 1.0)))
    s.revolute("A", s.ground, a, at=(0, 0), torque="u")
    s.revolute("B", a, b, at=(0, 0.3))
    s.revolute("C1", b, c, at=(1, 0.6))
    s.revolute("D", c, s.ground, at=(1, 0))
    return held(s, controlled)


def ball(controlled=False):
    s = mb.Scene("ball", gravity=(0, 0, -9.81))
    body = s.rigid_body("ball", 1.0, (0.004,) * 3, at=(0, 0, 0.15))
    s.contact("floor", s.ground, body, mb.Plane(), mb.Sphere(radius=0.1), normal=mb.Hertz(1e8, damping=0.05))
    s.force("push", body, (s.sensor("u"), 0, 0))
    return held(s, controlled)


def stepped(step, count, u=wave):
    for _ in range(count):
        step.set(u=u(step.t))
        step.advance()
    return step


@pytest.mark.parametrize(("make", "options", "count"), [
    (pendulum, {}, 1000), (pendulum, {"solver": mb.DOP853(rtol=1e-9)}, 100), (four_bar, {}, 50),
    (four_bar, {"solver": mb.IDA(rtol=2e-9)}, 20), (four_bar, {"solver": mb.RadauIIA(3, rtol=1e-7)}, 20),
    (ball, {"solver": mb.RadauIIA(3, rtol=1e-8)}, 20),
], ids=["native", "kinematic", "loop", "ida", "radau", "impacts"])
def test_steps_are_those_of_a_controller_to_the_last_bit(make, options, count):
    """The method begins anew at every instant in both, from the same numbers. Positions and velocities are compared at every
    instant: forces of the run jump there."""
    run = make(controlled=True).simulate(count * DT, outputs=2, **options).solution
    step = make().stepper(DT, **options)
    own = np.array([kind in "qv" for kind in step._system.kinds])
    columns = [run.names.index(name) for name, moves in zip(step.names, own, strict=True) if moves]
    for row in run(DT * np.arange(1, count))[:, columns]:
        np.testing.assert_array_equal(stepped(step, 1).state.y[0, own], row)


def test_states_are_gone_back_to_and_go_on_the_same():
    for make in (pendulum, ball):
        step = make().stepper(DT)
        copied = copy.deepcopy(stepped(step, 3))
        np.testing.assert_array_equal(stepped(copied, 5).state.y, stepped(step, 5).state.y)
        step.reset()
        middle = stepped(step, 20).state
        end = stepped(step, 20).state
        for state in (middle, pickle.loads(pickle.dumps(middle))):
            step.reset(state)
            assert step.t == middle.t
            np.testing.assert_array_equal(stepped(step, 20).state.y, end.y)
        step.reset()
        assert step.t == 0.0
        np.testing.assert_array_equal(stepped(step, 40).state.y, end.y)


def test_a_stored_state_is_read_and_others_are_refused(tmp_path):
    step = stepped(pendulum().stepper(DT), 5)
    state, end = step.state, stepped(pendulum().stepper(DT), 10).state
    state.save(tmp_path / "a.npz")
    other = pendulum().stepper(DT)
    other.reset(tmp_path / "a.npz")
    np.testing.assert_array_equal(stepped(other, 5).state.y, end.y)
    with pytest.raises(OptionError, match="not the file of a state"):
        four_bar().stepper(DT).reset(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_bytes(b"none")
    with pytest.raises(OptionError, match="damaged"):
        other.reset(tmp_path / "b.npz")
    with pytest.raises(OptionError, match="of the same scene"):
        four_bar().stepper(DT).reset(state)


@pytest.mark.parametrize("make", [pendulum, ball])
def test_states_of_a_batch_go_as_each_alone(make):
    """Natively, and through the loop of runs where contacts are watched."""
    many, one = make().stepper(DT, batch=3), make().stepper(DT)
    for _ in range(25):
        many.set(u=wave(many.t) * np.arange(3))
        many.advance()
    stepped(one, 25, lambda t: 2 * wave(t))
    np.testing.assert_array_equal(many.state.y[2], one.state.y[0])
    path = "J.angle" if make is pendulum else "ball.position"
    assert many[path].shape == ((3,) if make is pendulum else (3, 3))
    np.testing.assert_array_equal(many[path][2], one[path])


def test_steps_have_any_length_and_pass_breaks():
    """A torque that jumps within a step, steps of 1 to 300 ms: the motion is that of one run."""
    torque = mb.Scene("x").sensor("u") + sympy.Piecewise((5, mb.t < 0.1234), (-5, True))
    step, s = pendulum(torque=torque).stepper(DT), pendulum(torque=torque)
    for length in (0.001, 0.3, 0.099, 0.1):
        step.advance(length)
    r = s.simulate(0.5, accuracy=1e-9)
    assert step.t == pytest.approx(0.5, abs=1e-15)
    assert step["J.angle"] == pytest.approx(r["J"].angle[-1], abs=1e-7)
    assert step["J.force"] == pytest.approx(r["J"].force[-1], abs=1e-5)
    assert step.error < 1e-6


def test_the_scenes_own_controllers_go_on_between_and_within_steps():
    def lag(t, angle, memory):
        return -2 * angle - memory, memory + 0.007 * angle

    def make(controlled):
        s = pendulum(controlled, torque=mb.Scene("x").sensor("u") + mb.Scene("x").sensor("v"))
        s.controller("own", lag, every=0.007, reads=["J.angle"], sets=["v"], memory=0.0)
        return s

    step = make(False).stepper(DT)
    middle = stepped(step, 13).state
    end = stepped(step, 17).state.y
    assert step["J.angle"] == pytest.approx(make(True).simulate(0.3, outputs=2)["J"].angle[-1], abs=1e-13)
    step.reset(middle)
    np.testing.assert_array_equal(stepped(step, 17).state.y, end)
    with pytest.raises(OptionError, match="keep the state in this process"):
        step.state.save("a.npz")
    taken = make(False).stepper(DT, inputs=["u", "v"])  # the stepper sets what the controller did
    assert taken.inputs == {"u": 0.0, "v": 0.0}


def test_numbers_of_items_are_inputs_by_name():
    s = pendulum(torque=0.0, damper=0.2)
    s.force("F", s["rod"], (0, 0, 0), at=(1, 0))
    step = s.stepper(DT, inputs=["J.torque", "J.damper", "F.value.1"])
    assert step.inputs == {"J.torque": 0.0, "J.damper": 0.2, "F.value.1": 0.0}
    step.set({"J.torque": 5.0, "F.value.1": 1.0})
    step.advance(0.5)
    other = pendulum(torque=5.0, damper=0.2)
    other.force("F", other["rod"], (0, 1, 0), at=(1, 0))
    hung = mb.Scene("winch", gravity=(0, -9.81, 0))
    hung.prismatic("P", hung.ground, hung.rigid_body("b", 2.0, 0.1, at=(0, -1)), at=(0, -1), axis=(0, 1, 0), damper=200.0)
    hung.rope("rope", hung.ground, hung["b"], at_k=(0, 0), at_l=(0, -1), stiffness=2e4, length=0.99)
    winch = hung.stepper(0.5, inputs=["rope.length"])  # made ready with the length as stated: at 0 there is no rope
    winch.set({"rope.length": 0.9})
    for _ in range(4):
        winch.advance()
    assert winch["P.displacement"] == pytest.approx(0.1 - 2 * 9.81 * 0.9 / 2e4, abs=1e-6)
    assert step["J.angle"] == pytest.approx(other.simulate(0.5)["J"].angle[-1], abs=1e-7)


def test_angles_that_a_loop_reads_count_whole_turns():
    """In space, of a joint as rows: named by reads=, as a controller names them, and then with the controller's very bits."""
    options = {"model": mb.Kinematic(), "rate0": 10.0}
    solver = mb.RadauIIA(3, rtol=1e-7)

    def spun(controlled):
        s = mb.Scene("spun", space="spatial")
        s.revolute("J", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), torque="u", **options)
        if controlled:
            s.controller("C", lambda t, angle: 3 - angle, every=DT, reads=["J.angle"], sets=["u"])
        else:
            s.signal("u", 0.0)
        return s

    step = spun(False).stepper(DT, solver=solver, reads=["J.angle"])
    for _ in range(120):
        step.set(u=3 - step["J.angle"])
        step.advance()
    run = spun(True).simulate(120 * DT, solver=solver)
    assert step["J.angle"] == run["J"].angle[-1] > 2 * np.pi
    with pytest.raises(OptionError, match=r"whole turns .* reads=\['J.angle'\]"):
        spun(False).stepper(DT, solver=solver)["J.angle"]
    for inputs in (["u"], []):
        with pytest.raises(OptionError, match=r"reads = there is no sensor 'K\.angle'"):
            spun(False).stepper(DT, inputs=inputs, reads=["K.angle"])


def test_the_error_of_a_state_is_that_of_its_steps():
    """Against a run of far smaller tolerance; the estimate is not below a third of the error."""
    step = stepped(pendulum().stepper(0.1, accuracy=1e-3, solver=mb.RadauIIA(2)), 30)
    exact = stepped(pendulum().stepper(0.1, accuracy=1e-9, solver=mb.RadauIIA(3, rtol=1e-12)), 30)
    off = abs(step["J.angle"] - exact["J.angle"])
    assert off / 3 < step.error < 1e-1
    assert stepped(pendulum().stepper(0.1, solver=mb.HHT(step=0.01)), 3).error is None
    with pytest.warns(AccuracyWarning, match="estimated error"):
        stepped(ball().stepper(DT, accuracy=1e-9), 40).error  # noqa: B018
    given = stepped(pendulum().stepper(0.1, solver=mb.DOP853(rtol=1e-5)), 30)  # one step between two instants
    assert abs(given["J.angle"] - exact["J.angle"]) / 3 < given.error


def test_a_step_that_stops_leaves_the_state_as_it_was():
    """A force that grows without bound: the error says where, the state is that before the step, and another input goes on."""
    for batch in (None, 2):
        s = pendulum(torque=mb.Scene("x").sensor("u") * (1 + mb.Scene("x").sensor("J.rate") ** 2))
        step = s.stepper(0.5, batch=batch, solver=mb.DOP853(rtol=1e-8))
        step.advance()
        before = step.state
        step.set(u=100.0)
        with pytest.raises(SolverError, match=r"stopped at t = 0\.5"):
            step.advance()
        assert step.t == before.t
        np.testing.assert_array_equal(step.state.y, before.y)
        step.set(u=0.0)
        step.advance()
        assert step.t == 1.0


def test_mistakes_are_named():
    step = pendulum().stepper(DT)
    for wrong, said in (({"v": 1.0}, "no input 'v'"), ({"u": np.nan}, "finite"), ({"u": [1, 2]}, "u ="), ({"u": "a"}, "u =")):
        with pytest.raises(OptionError, match=said):
            step.set(wrong)
    assert step.inputs == {"u": 0.0}
    with pytest.raises(OptionError, match="dt ="):
        step.advance(-1.0)
    with pytest.raises(SceneError, match="no sensor"):
        step["J.angel"]
    with pytest.raises(OptionError, match="no unknown"):
        step.reset(values={"K.angle": 1.0})
    with pytest.raises(OptionError, match="constraints between"):
        four_bar().stepper(DT).reset(values={"A.angle": 1.0})
    with pytest.raises(OptionError, match="no number of the scene"):
        pendulum().stepper(DT, inputs=["J.at"])
    with pytest.raises(OptionError, match=r"state s.signal"):
        pendulum().stepper(DT, inputs=["w"])
    with pytest.raises(OptionError, match="give it a step or an rtol"):
        pendulum().stepper(DT, solver=mb.HHT())
    with pytest.raises(SceneError, match="jumps"):
        held(_prescribed(), False).stepper(DT).advance()


def _prescribed():
    s = mb.Scene("driven")
    s.revolute("J", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0),
               angle=sympy.Piecewise((0, mb.t < 0.001), (1, True)))
    return s


def test_values_begin_an_episode_elsewhere():
    step = pendulum().stepper(DT, batch=2)
    step.reset(values={"J.angle": [0.1, -np.pi / 2]})
    for _ in range(10):
        step.advance()
    assert step["J.angle"][1] == pytest.approx(-np.pi / 2, abs=1e-12)  # it hangs at rest
    assert step["J.angle"][0] < 0.1
