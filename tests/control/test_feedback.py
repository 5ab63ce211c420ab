"""Feedback: loads, states and signals that follow from sensors, in every form and joint model."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

import mbdae as mb
from mbdae.errors import SceneError
from mbdae.formulations import system_for
from mbdae.inputs.sensed import symbol
from mbdae.system.assembled.guards import Observer
from mbdae.system.prepare import prepare

MODELS = [mb.Kinematic(), mb.Classical(), mb.Recursive()]
G, KP, KD, KI, LIMIT = 9.81, 30.0, 4.0, 5.0, 6.0


def pid_pendulum(model=None, space="auto"):
    """A rod under a PID with saturation that follows a path."""
    s = mb.Scene("pid", gravity=(0, -G, 0), space=space)
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    path = 0.7 * sp.sin(2 * mb.t)
    integral = s.state("e", rate=path - s.sensor("J.angle"), start=0.1)
    torque = KP * (path - s.sensor("J.angle")) - KD * s.sensor("J.rate") + KI * integral
    s.revolute("J", s.ground, rod, at=(0, 0), torque=sp.Max(sp.Min(torque, LIMIT), -LIMIT), model=model)
    return s


@pytest.fixture(scope="module")
def reference():
    """The same by SciPy, in small steps because of the saturation."""

    def rates(t, y):
        angle, rate, e = y
        path = 0.7 * np.sin(2 * t)
        torque = np.clip(KP * (path - angle) - KD * rate + KI * e, -LIMIT, LIMIT)
        return [rate, (torque - 0.5 * G * np.cos(angle)) * 3, path - angle]

    return solve_ivp(rates, (0, 3), [0, 0, 0.1], rtol=1e-10, atol=1e-12, max_step=1e-3, dense_output=True).sol


@pytest.mark.parametrize(("space", "form", "model"), [
    pytest.param(*given, marks=[pytest.mark.slow] * (sum(at) % 2)) for *at, given in (
        (i, j, k, (space, form, model)) for i, space in enumerate(["auto", "spatial"])
        for j, form in enumerate([mb.GGL(), mb.Index3(), mb.Index1(), mb.ODE()]) for k, model in enumerate(MODELS))])
def test_pid_with_saturation(reference, model, form, space):
    if isinstance(form, mb.ODE) and not isinstance(model, mb.Recursive):
        pytest.skip("joints with rows are no ordinary differential equation")
    r = pid_pendulum(model, space).simulate(3.0, form=form, accuracy=1e-7)
    np.testing.assert_allclose(r["J"].angle, reference(r.t)[0], atol=1e-7)
    np.testing.assert_allclose(r["e"], reference(r.t)[2], atol=1e-7)
    assert np.max(np.abs(r.energy.balance)) < 1e-6
    assert not r.warnings
    assert r.stats.retaken  # steps end where the limit is reached


def double(model, space):
    """Two links whose torques and forces depend on all kinds of sensors."""
    s = mb.Scene("double", gravity=(0, -G, 0), space=space)
    a = s.link("a", (0, 0), (1, 0), mass=1.0)
    b = s.link("b", (1, 0), (1.5, 0.7), mass=0.5)
    q = s.sensor
    s.revolute("J", s.ground, a, at=(0, 0), model=model,
               torque=-3 * q("K.rate") - 2 * q("b.velocity[0]") - q("J.angle") * q("a.angular_velocity[2]"))
    s.revolute("K", a, b, at=(1, 0), model=model, torque=-3 * q("K.angle") * sp.cos(mb.t) - q("b.position[1]") - q("x"))
    s.force("F", b, (q("b.rotation[0, 1]"), 0.3 * q("K.angle_rate"), 0), at=(1.5, 0.7))
    s.force("D", b, (-0.4 * q("a.velocity[0]") * q("e"), 0, 0), at=(1, 0))  # between bodies of one tree, and a state
    s.state("e", rate=q("b.at(1.0).position[0]") - q("e"))
    s.signal("x", q("e") * q("J.rate") + sp.tanh(q("J.angle")))
    return s


PATHS = ["J.angle", "K.rate", "K.angle_rate", "b.position[1]", "b.velocity[0]", "a.angular_velocity[2]", "b.rotation[0, 1]",
         "b.at(1.0).velocity[1]", "b.at(0.2).position[0]", "e"]


@pytest.mark.parametrize("space", ["planar", "spatial"])
@pytest.mark.parametrize("model", MODELS)
def test_what_a_load_reads_is_what_the_result_shows(model, space):
    r = double(model, space).simulate(0.7, accuracy=1e-7)
    observer = Observer(r.prepared.model, r.prepared.all_bodies.moved, [symbol(path) for path in PATHS])
    read = observer(r.t, r.solution(r.t))
    for n, path in enumerate(PATHS):
        np.testing.assert_allclose(read[:, n], r.read(path), atol=1e-12, err_msg=path)
    np.testing.assert_allclose(r["x"], r["e"] * r["J"].rate + np.tanh(r["J"].angle), atol=1e-12)


def test_models_and_spaces_move_alike():
    ends = [double(model, space).simulate(0.7, accuracy=1e-8)["K"].angle[-1]
            for model in MODELS for space in ("planar", "spatial")]
    np.testing.assert_allclose(ends, ends[0], atol=1e-8)


def _differences(f, x, i, h):
    """Sixth-order central difference by x[i]."""
    total = np.zeros(len(f(x)))
    for k, weight in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60)):
        up, down = x.copy(), x.copy()
        up[i], down[i] = x[i] + k * h, x[i] - k * h
        total += weight * (f(up) - f(down)) / h
    return total


@pytest.mark.parametrize("form", [mb.GGL(), mb.Index3(), mb.Index1()])
@pytest.mark.parametrize("space", ["planar", "spatial"])
@pytest.mark.parametrize("model", MODELS)
def test_jacobian_is_that_of_differences(model, space, form):
    prepared = prepare(double(model, space))
    system = system_for(prepared, form, 3)
    rng = np.random.default_rng(5)
    y, yp = system.y0 + 0.1 * rng.standard_normal(system.n), system.yp0 + 0.1 * rng.standard_normal(system.n)

    def residual(y, yp):
        out = np.empty(system.n)
        system.residual(0.3, y, yp, out)
        return out

    for state, by in ((y, 0), (yp, 1)):
        exact = system.jacobian_parts(0.3, y, yp)[by]
        exact = exact if system.sparsity is None else _dense(system, exact)
        for i in range(system.n):
            found = _differences((lambda v: residual(v, yp)) if by == 0 else (lambda v: residual(y, v)), state, i, 3e-3)
            np.testing.assert_allclose(exact[:, i], found, atol=1e-10 * (1 + np.max(np.abs(exact))))


def _dense(system, data):
    pattern = system.sparsity.copy()
    pattern.data[:] = data
    return pattern.toarray()


def test_rest_of_a_spring_follows_a_state():
    """A rotational spring whose rest angle an actuator shifts, d rest / dt = (0.3 - rest) / 0.2."""
    from mbdae.laws.on_coordinates import JointSpring

    s = mb.Scene("actuator")
    rod = s.link("rod", (0, 0), (1, 0), mass=3.0)
    s.revolute("J", s.ground, rod, at=(0, 0))
    rest = s.state("rest", rate=(0.3 - s.sensor("rest")) / 0.2)
    s.add(JointSpring("spring", "ground", rod, at=(0, 0), joint=mb.Revolute, coordinate="angle", kept=False, stiffness=4.0,
                      rest=rest, turns=0.0))
    r = s.simulate(2.0, accuracy=1e-8)
    # phi'' = 4 (rest - phi), rest = 0.3 (1 - exp(-5 t)): w = 2, a = -0.3 * 4 / (25 + 4)
    w, p = 2.0, -0.3 * 4 / 29
    exact = 0.3 + p * np.exp(-5 * r.t) - (0.3 + p) * np.cos(w * r.t) + 5 * p / w * np.sin(w * r.t)
    np.testing.assert_allclose(r["J"].angle, exact, atol=1e-7)
    assert np.max(np.abs(r.energy.balance)) < 1e-7


def test_linearised_feedback_has_its_own_eigenvalues():
    s = pid_free()
    r = s.simulate(60.0)
    stiffness = -KP + 0.5 * G * np.sin(0.2)
    A = np.array([[0, 1, 0], [3 * stiffness, -3 * KD, 3 * KI], [-1, 0, 0]])
    found = s.linearize(at=r).eigenvalues
    wanted = np.linalg.eigvals(A)
    for value in wanted[wanted.imag >= 0]:
        assert np.min(np.abs(found - value)) < 1e-5


def pid_free():
    s = mb.Scene("pid", gravity=(0, -G, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    e = s.state("e", rate=0.2 - s.sensor("J.angle"))
    s.revolute("J", s.ground, rod, at=(0, 0), torque=KP * (0.2 - s.sensor("J.angle")) - KD * s.sensor("J.rate") + KI * e)
    return s


def test_feedback_is_stored_with_its_states(tmp_path):
    r = pid_pendulum().simulate(0.5)
    r.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz")
    np.testing.assert_array_equal(again["e"], r["e"])
    whole, parts = pid_pendulum().simulate(1.0, accuracy=1e-9), pid_pendulum().simulate(1.0, start=again, accuracy=1e-9)
    assert parts["J"].angle[-1] == pytest.approx(whole["J"].angle[-1], abs=1e-5)


def test_signals_that_lead_to_one_by_many_ways_are_followed_once():
    """2^40 ways, and at their end a circle or none."""
    for last in (0.0, 1.0):
        s = mb.Scene("ladder", gravity=(0, -9.81, 0))
        s.revolute("J", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
        a = b = s.signal("first", s.sensor("J.angle") + last * s.sensor("a39"))
        for i in range(40):
            a, b = s.signal(f"a{i}", a + b), s.signal(f"b{i}", a - b)
        if last:
            with pytest.raises(mb.SceneError, match=r"'first' depends on itself .* algebraic loop"):
                s.check()
        else:
            assert s.check().degrees_of_freedom == 1


@pytest.mark.parametrize(("path", "said"), [
    ("J.angl", "did you mean 'J.angle'?"),
    ("rod.positon[0]", "did you mean 'rod.position[0]'?"),
    ("J.torque", "algebraic loop"),
    ("rod.acceleration[0]", "algebraic loop"),
    ("rod.position", "names no component"),
    ("rod.position[5]", "names no component"),
    ("nothing", "there is no sensor 'nothing'"),
])
def test_sensors_that_cannot_be_read_are_named_before_solving(path, said):
    s = mb.Scene("bad", gravity=(0, -G, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("J", s.ground, rod, at=(0, 0), torque=-s.sensor(path))
    with pytest.raises(SceneError, match="revolute 'J'") as refused:
        s.check()
    assert said in str(refused.value)
    assert path in str(refused.value)


def test_circles_of_signals_and_prescribed_values_by_sensors_are_refused():
    s = mb.Scene("bad", gravity=(0, -G, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.signal("a", s.sensor("b") + 1)
    s.signal("b", 2 * s.sensor("a"))
    s.revolute("J", s.ground, rod, at=(0, 0), angle=s.sensor("a"))
    with pytest.raises(SceneError) as refused:
        s.check()
    assert "a -> b -> a" in str(refused.value)
    assert "depends on the signal 'a': it may depend on the time mb.t alone" in str(refused.value)


@pytest.mark.parametrize("what", ["position", "rotation", "velocity", "angular_velocity"])
def test_what_moves_is_no_number_of_a_body(what):
    """`s["b"].position` in a load would stay as drawn."""
    s = mb.Scene("drawn")
    s.link("b", (0, 0), (1, 0), mass=1.0)
    with pytest.raises(AttributeError, match=rf"s\.sensor\('b\.{what}\["):
        getattr(s["b"], what)
    assert getattr(s["b"].drawn, what).shape == ((3, 3) if what == "rotation" else (3,))


def test_foreign_symbols_are_no_loads():
    s = mb.Scene("bad", gravity=(0, -G, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.force("F", rod, (sp.Symbol("x"), 0, 0))
    with pytest.raises(SceneError, match="contains the symbol x"):
        s.check()


def test_tables_in_feedback_are_followed_and_come_back_from_files(tmp_path):
    s, rod = pendulum_alone()
    table = mb.table([0, 0.5, 1, 2], [0, 3, -1, 0])
    s.signal("w", table + s.sensor("J.angle"))
    s.revolute("J", s.ground, rod, at=(0, 0), torque=s.sensor("w") * table - s.sensor("J.rate"))
    r = s.simulate(1.5, accuracy=1e-8)
    assert {0.5, 1.0} <= set(r.solution.t.tolist())
    w = np.interp(r.t, [0, 0.5, 1, 2], [0, 3, -1, 0]) + r["J"].angle
    np.testing.assert_allclose(r["w"], w, atol=1e-9)
    r.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz")
    assert again["w"].tobytes() == r["w"].tobytes()
    np.testing.assert_array_equal(r.value("2*w - J.angle"), 2 * r["w"] - r["J"].angle)
    assert r.to_dataframe("w", "J.angle").columns.tolist() == ["w", "J.angle"]
    assert "w" in r.to_dataframe().columns


def test_what_depends_on_time_in_feedback_is_checked():
    s, rod = pendulum_alone()
    table = mb.table([0, 1], [0, 1], outside="error")
    s.signal("w", sp.Min(table, s.sensor("J.angle")))
    s.revolute("J", s.ground, rod, at=(0, 0), torque=s.sensor("w") / (mb.t - 0.7))
    with pytest.raises(mb.SceneError, match=r"not finite near t = 0.7 s(.|\n)*signal 'w': .*the table goes from 0 to 1 s"):
        s.simulate(1.5)


def pendulum_alone():
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    return s, s.link("rod", (0, 0), (1, 0), mass=1.0)
