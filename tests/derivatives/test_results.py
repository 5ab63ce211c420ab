"""Derivatives of results against closed forms and differences of exact runs; what is refused, by name."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sympy

import mbdae as mb
from mbdae.derivatives import Refined, reading

M, K, X0, T = 1.0, 30.0, 0.2, 1.3  # the mass 1 is a number that trees write into their kernels where it is not open


def oscillator(m: float = M, k: float = K, x0: float = X0) -> mb.Scene:
    """x = x0 cos(w t), w^2 = k / m."""
    s = mb.Scene("oscillator")
    body = s.rigid_body("body", m, 0.1, at=(0, 0))
    s.prismatic("P", s.ground, body, at=(0, 0), axis=(1, 0, 0), spring=k, position0=x0)
    return s


def exact(m: float, k: float, x0: float, t: Any) -> dict[str, Any]:
    """x and its derivatives."""
    w = np.sqrt(k / m)
    slope = -x0 * t * np.sin(w * t)
    return {"x": x0 * np.cos(w * t), "body.mass": slope * -w / (2 * m), "P.spring": slope / (2 * m * w),
            "P.position0": np.cos(w * t)}


NAMES = ["body.mass", "P.spring", "P.position0"]
NUMBERS = {"oscillator": NAMES,
           "chain": ["b3.mass", "J4.spring", "b13.inertia.1", "J2.damper", "J8.at.0"],
           "four-bar": ["crank.mass", "k", "A.rate0", "amplitude", "pace"],
           "slide": ["rod.mass", "A.spring", "P.rate0", "P.friction.mu", "size", "pace"]}


@pytest.mark.parametrize("options", [{}, {"solver": mb.RadauIIA(3), "form": mb.GGL()}, {"solver": mb.IDA()}],
                         ids=["chosen", "ggl", "ida"])
def test_oscillator_has_the_derivatives_of_its_closed_form(options: dict[str, Any]) -> None:
    r = oscillator().simulate(T, outputs=7, derivatives=True, **options)
    found = r.sensitivity("P.displacement", "body.position", to=NAMES)
    true = exact(M, K, X0, r.t)
    for name in NAMES:
        one, size = found["P.displacement", name], np.abs(true[name]).max()
        off = np.abs(one.value - true[name]).max()
        assert one.value.shape == (7,)
        assert found["body.position", name].value.shape == (7, 3)
        assert off < 1e-5 * size  # ten times the accuracy
        assert off <= one.error < 1e-5 * size
        assert np.abs(found["body.position", name].value[:, 0] - true[name]).max() < 1e-5 * size


def test_objectives_of_the_oscillator() -> None:
    r = oscillator().simulate(T, derivatives=True)
    end = r.gradient(mb.at_end("P.displacement"), to="P.spring")["P.spring"]
    assert end.value == pytest.approx(exact(M, K, X0, T)["P.spring"], rel=1e-6)
    # integral of x^2 = x0^2 (t / 2 + sin(2 w t) / (4 w)), differentiated by x0
    w = np.sqrt(K / M)
    square = r.gradient(mb.integral("P.displacement**2"), to=["P.position0"])["P.position0"]
    assert square.value == pytest.approx(2 * X0 * (T / 2 + np.sin(2 * w * T) / (4 * w)), rel=1e-6)
    # the largest speed, x0 w, does not depend on when it is reached; there are two of them, so that a mean is asked for
    with pytest.raises(mb.DerivativeError, match="may change its place"):
        r.gradient(mb.largest("P.rate"), to="P.spring")
    speed = r.gradient(mb.largest("P.rate", smooth=1e-3), to="P.spring")["P.spring"]
    assert speed.value == pytest.approx(X0 / (2 * np.sqrt(K * M)), rel=2e-3)  # the mean is lower by about `smooth`


def four_bar(values: dict[str, float]) -> mb.Scene:
    p = {"mass": 1.0, "k": 2.0, "rate": 2.0, "amplitude": 0.3, "pace": 3.0} | values
    k, amplitude, pace = (mb.number(name, p[name]) for name in ("k", "amplitude", "pace"))
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    crank, coupler = s.link("crank", (0, 0), (0, 0.3), mass=p["mass"]), s.link("coupler", (0, 0.3), (0.5, 0.6), mass=0.6)
    rocker = s.link("rocker", (0.5, 0.6), (0.6, 0), mass=0.5)
    s.revolute("A", s.ground, crank, at=(0, 0), rate0=p["rate"], spring=k, torque=amplitude * sympy.sin(pace * mb.t))
    s.revolute("B", crank, coupler, at=(0, 0.3), damper=0.02)
    s.revolute("C", coupler, rocker, at=(0.5, 0.6), spring=k / 2, torque=-amplitude * s.sensor("C.rate"))
    s.revolute("D", s.ground, rocker, at=(0.6, 0))
    return s


def test_loop_with_numbers_of_every_kind() -> None:
    """Closed loop, DOP853 with eliminated multipliers: a mass of 1, a start rate that the loop closes, numbers that several laws
    share, in inputs of time and in expressions of sensors; forces of joints too."""
    names = {"crank.mass": "mass", "k": "k", "A.rate0": "rate", "amplitude": "amplitude", "pace": "pace"}
    r = four_bar({}).simulate(0.4, outputs=5, derivatives=True)
    found = r.sensitivity("C.angle", "B.force", to=[*names])
    for name, own in names.items():
        value = {"mass": 1.0, "k": 2.0, "rate": 2.0, "amplitude": 0.3, "pace": 3.0}[own]
        step = 1e-3 * value
        runs = [four_bar({own: value + i * step}).simulate(0.4, outputs=5, solver=mb.DOP853(rtol=1e-12)) for i in (1, -1, 2, -2)]
        for sensor in ("C.angle", "B.force"):
            a, b, c, d = (run.read(sensor) for run in runs)
            true = (8 * (a - b) - (c - d)) / (12 * step)  # of order 4: 1e-10 here
            one = found[sensor, name]
            assert np.abs(one.value - true).max() < 1e-6 * np.abs(true).max()
            assert np.abs(one.value - true).max() < one.error + 1e-8 * np.abs(true).max()


def with_friction() -> mb.Scene:
    """Friction by reaction: y' is found by Newton's method where the multipliers are eliminated."""
    s = mb.Scene("slide", gravity=(0, -9.81, 0))
    body, rod = s.rigid_body("body", 1.0, 0.1, at=(0, 0)), s.link("rod", (0, 0), (0.5, 0.2), mass=0.4)
    s.prismatic("P", s.ground, body, at=(0, 0), axis=(1, 0.2, 0), rate0=1.0, friction=mb.Coulomb(mu=0.1, v_c=0.05))
    s.revolute("A", body, rod, at=(0, 0), spring=2.0, torque=mb.number("size", 0.3) * sympy.sin(mb.number("pace", 3.0) * mb.t))
    return s


def chain() -> mb.Scene:
    """A tree that is evaluated joint by joint, because it is large."""
    s = mb.Scene("chain", gravity=(0, 0, -9.81))
    previous: Any = s.ground
    for i in range(14):
        body = s.rigid_body(f"b{i}", 1.0 + 0.1 * i, (0.02, 0.03, 0.025), at=(0.2 * i + 0.1, 0, 0))
        s.revolute(f"J{i}", previous, body, at=(0.2 * i, 0, 0), axis=((0, 1, 0), (0, 0, 1))[i % 2], spring=5.0, damper=0.3)
        previous = body
    return s


@pytest.mark.parametrize(("scene", "options"), [
    (oscillator, {}), (chain, {"accuracy": 1e-3}), (chain, {"solver": mb.RadauIIA(3), "accuracy": 1e-3}),
    (lambda: four_bar({}), {}), (with_friction, {"solver": mb.RadauIIA(3)}),
    (with_friction, {"solver": mb.DOP853(), "form": mb.Index1(), "accuracy": 1e-3}),
    (with_friction, {"solver": mb.RadauIIA(2), "form": mb.Index1(multipliers="eliminated"), "accuracy": 1e-3})],
    ids=["tree", "large tree", "large tree by Radau", "loop", "radau", "solved for", "eliminated"])
def test_the_adjoint_is_the_transposed_tangent(scene: Callable[[], mb.Scene], options: dict[str, Any]) -> None:
    """Weights of states and of increments inside the steps, by numbers of bodies, joints, starts and inputs of time."""
    s = scene()
    known = NUMBERS[s.name]
    derived = Refined(s.simulate(0.2, **options), known).level(0).derived
    tangent = derived.tangent()
    rng, m, n = np.random.default_rng(5), len(derived.run.t) - 1, derived.run.y.shape[1]
    ends, inner = rng.standard_normal((m + 1, n)), rng.standard_normal((m, derived.steps.stages - 1, n))
    states = tangent.y.reshape(m + 1, n, -1)
    increments = tangent.inner.reshape(m, -1, n, len(known))
    terms = ends[..., None] * states, inner[..., None] * increments
    found = derived.adjoint(ends, inner)
    true, size = (sum(np.sum(part(x), axis=tuple(range(x.ndim - 1))) for x in terms) for part in (np.asarray, np.abs))
    assert len(known) >= 3
    assert (np.abs(found - true) < 1e-9 * size).all()  # the least of the digits that Newton's method for y' leaves
    assert (size > 0).all()


def test_a_run_with_derivatives_is_the_run_without() -> None:
    a, b = oscillator().simulate(T), oscillator().simulate(T, derivatives=True)
    assert np.array_equal(a.solution.y, b.solution.y)
    assert a.stats.residuals == b.stats.residuals
    before = b.solution.y.copy()
    b.gradient(mb.at_end("P.displacement"), to="P.spring")
    assert np.array_equal(before, b.solution.y)


def pendulum(**options: Any) -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0), **options)
    return s


def controlled(**derivative: Any) -> mb.Scene:
    s = pendulum(torque="u")
    s.controller("c", lambda t, x: -x, 0.05, reads=["A.angle"], sets=["u"], **derivative)
    return s


def held(k: float = 3.0, rate: float = 0.5) -> mb.Scene:
    """A pendulum that a sampled controller holds."""
    s = pendulum(spring=k, rate0=rate, torque="u")
    s.controller("c", lambda t, x, w: -8 * np.tanh(x) - w, 0.05, reads=["A.angle", "A.rate"], sets=["u"],
                 derivative=lambda t, x, w: [[-8 / np.cosh(x) ** 2, -1.0]])
    return s


@pytest.mark.parametrize("options", [{}, {"solver": mb.RadauIIA(3), "form": mb.GGL()}], ids=["chosen", "ggl"])
def test_a_sampled_controller_passes_derivatives_on(options: dict[str, Any]) -> None:
    """Of the motion, and of the output that it holds; by the adjoint as along the tangent."""
    r = held().simulate(0.22, outputs=4, **options)
    names, steps = ("A.spring", "A.rate0"), (3e-3, 5e-4)
    found = r.sensitivity("A.angle", "u", to=names)
    of = mb.integral("A.angle**2 + u**2")
    level = Refined(r, names).level(0)
    times, weights = of.points(level.result)
    for k, (name, h) in enumerate(zip(names, steps, strict=True)):
        given = [{"k": 3.0 + i * h} if k == 0 else {"rate": 0.5 + i * h} for i in (1, -1, 2, -2)]
        runs = [held(**one).simulate(0.22, outputs=4, solver=mb.DOP853(rtol=1e-13)) for one in given]
        for sensor in ("A.angle", "u"):
            a, b, c, d = (run.read(sensor) for run in runs)
            true = (8 * (a - b) - (c - d)) / (12 * h)  # of order 4: 1e-10 here
            assert np.abs(found[sensor, name].value - true).max() < 1e-6 * np.abs(true).max()
        along = weights @ level.of(k, lambda one: of.read(one, times))[0]
        assert level.sums(of)[k][0] == pytest.approx(along, rel=1e-9)


def jumping() -> mb.Scene:
    return pendulum(torque=sympy.Piecewise((1.0, mb.Scene.sensor(mb.Scene(), "A.angle") < -0.3), (0.0, True)))


@pytest.mark.parametrize(("scene", "options", "name", "said"), [
    (lambda: pendulum(limits=(-0.3, 0.5), stop=mb.Stop(stiffness=1e4, damping=50.0)), {}, "rod.mass", "force of 'A.* jumps"),
    (controlled, {}, "rod.mass", "sampled controller 'c'"),
    (pendulum, {"until": "A.angle < -0.2"}, "rod.mass", "ends at an event"),
    (pendulum, {}, "accuracy", "but of the call of simulate"),
    (lambda: controlled(derivative=lambda t, x: [[-1.0]]), {}, "c.every", "instants at which the controller is called"),
    (lambda: controlled(derivative=lambda t, x: [[1.0]]), {}, "rod.mass", "differences of its function give"),
    (lambda: controlled(derivative=lambda t, x: [1.0, 2.0]), {}, "rod.mass", "has to return 1 x 1 numbers"),
    (pendulum, {}, "A.at.2", "other equations"),
    (pendulum, {}, "A.model", "not for a number"),
    (lambda: pendulum(torque=sympy.Piecewise((0, mb.t < 0.1), (2.0, mb.t < 0.3), (0, True))), {}, "A.torque.begin",
     "moves an instant"),
    (lambda: jumping(), {}, "rod.mass", "accelerations jump"),
    (lambda: jumping(), {"solver": mb.RadauIIA(3), "form": mb.GGL()}, "rod.mass", "accelerations jump"),
], ids=["stop", "controller", "until", "accuracy", "every", "wrong derivative", "shape",
         "out of plane", "word", "break", "jump", "jump with multipliers"])
def test_refused_by_name_and_reason(scene: Callable[[], mb.Scene], options: dict[str, Any], name: str, said: str) -> None:
    r = scene().simulate(0.5, **options)
    with pytest.raises(mb.DerivativeError, match=said):
        r.gradient(mb.at_end("A.angle"), to=name)


def test_what_a_beam_reads_for_stresses_alone_is_refused() -> None:
    """The modulus of a section stands beside its stiffnesses: the derivative of the motion by it was 0, without a word."""
    s = mb.Scene("cantilever", gravity=(0, -9.81, 0))
    section = mb.Section.tube(outer=0.03, inner=0.02, E=7e9, nu=0.3, rho=2000)
    beam = s.beam("b", (0, 0), (1, 0), section=section, elements=1)
    s.weld("w", s.ground, beam.at(0.0), at=(0, 0))
    with pytest.raises(mb.DerivativeError, match="for stresses alone"):
        s.simulate(0.002, 1e-3).gradient(mb.at_end("b.at(1.0).position[1]"), to="b.section.E")


def test_continued_runs_and_early_refusals() -> None:
    s = pendulum()
    first = s.simulate(0.2)
    with pytest.raises(mb.DerivativeError, match="begins where another one ended"):
        s.simulate(0.4, start=first).gradient(mb.at_end("A.angle"), to="rod.mass")
    with pytest.raises(mb.DerivativeError, match="begins where another one ended"):
        s.simulate(0.4, start=first, derivatives=True)
    with pytest.raises(mb.DerivativeError, match="sampled controller"):
        controlled().simulate(0.4, derivatives=True)
    with pytest.raises(mb.DerivativeError, match="state at rest has no derivatives yet"):
        pendulum(spring=20.0).equilibrium().gradient(mb.at_end("A.angle"), to="A.spring")


def test_named_numbers_are_recorded_and_have_one_value(tmp_path: Any) -> None:
    s = four_bar({})
    assert s.numbers == {"k": 2.0, "amplitude": 0.3, "pace": 3.0}
    assert not s.problems
    r = s.simulate(0.1, outputs=3)
    r.save(tmp_path / "run.npz")
    again = mb.load(tmp_path / "run.npz")
    assert again.prepared.model.scene.numbers == s.numbers
    one, other = (x.gradient(mb.at_end("A.angle"), to="k")["k"].value for x in (r, again))
    assert one == pytest.approx(other, rel=1e-7)
    s.spring("S", s.ground, "crank", at_k=(1, 1), at_l=(0, 0.3), stiffness=mb.number("k", 3.0), length=1.0)
    with pytest.raises(mb.SceneError, match="the number 'k' has two values, 2 and 3"):
        s.simulate(0.1)
    with pytest.raises(mb.OptionError, match="without dots"):
        mb.number("a.b", 1.0)


def test_wrong_questions() -> None:
    r = oscillator().simulate(0.1)
    for call, said in (
            (lambda: r.gradient("P.displacement", to="P.spring"), "give an objective"),
            (lambda: r.gradient(mb.at_end("body.position"), to="P.spring"), "has components"),
            (lambda: r.gradient(mb.at_end("P.displacement"), to=[]), "one or more names"),
            (lambda: r.sensitivity(to="P.spring"), "one or more quantities")):
        with pytest.raises(mb.OptionError, match=said):
            call()


@pytest.mark.parametrize(("form", "at"), [(lambda w, t: sympy.sin(w * t), 2.0), (lambda w, t: t**w, 2.0),
                                          (lambda w, t: t**w, 3.0)], ids=["sine", "square", "cube"])
def test_a_number_of_a_smooth_input_moves_no_instant(form: Any, at: float) -> None:
    """Beside these values inputs vary so much more that they bound the steps of a run, or are no whole power."""

    def forced(w: Any) -> mb.Scene:
        s = mb.Scene("forced")
        body = s.rigid_body("body", 1.0, 0.1, at=(0, 0))
        s.prismatic("P", s.ground, body, at=(0, 0), axis=(1, 0, 0), spring=4.0, force=form(w, mb.t))
        return s

    def end(w: float) -> float:
        return float(forced(w).simulate(1.0, solver=mb.DOP853(rtol=1e-13), outputs=2).value("P.displacement")[-1])

    one = forced(mb.number("W", at)).simulate(1.0, outputs=2).gradient(mb.at_end("P.displacement"), to="W")["W"]
    h = 1e-3
    true = (8 * (end(at + h) - end(at - h)) - end(at + 2 * h) + end(at - 2 * h)) / (12 * h)
    assert abs(one.value - true) < min(one.error, 1e-5 * abs(true)) + 1e-11


def test_the_largest_value_of_a_vector_is_that_of_its_magnitude() -> None:
    s = mb.Scene("two ways")
    body = s.rigid_body("body", 1.0, 0.1, at=(0, 0), velocity=(3.0, 4.0))
    s.spring("S", s.ground, body, at_k=(0, -1), at_l=(0, 0), stiffness=2.0, length=1.0)
    r = s.simulate(1.0, outputs=2)
    for smooth in (None, 1e-2):
        vector = r.gradient(mb.largest("body.velocity", smooth=smooth), to="S.stiffness")["S.stiffness"]
        size = r.gradient(mb.largest("norm(body.velocity)", smooth=smooth), to="S.stiffness")["S.stiffness"]
        assert vector.value == pytest.approx(size.value, rel=1e-9, abs=1e-12)


def gyroscope(across: float = 9e-4) -> mb.Scene:
    """Steady on its axis of symmetry: with another moment of inertia across it the motion would swing at 500 rad/s."""
    s = mb.Scene("gyroscope", gravity=(0, 0, -9.81))
    fork = s.rigid_body("fork", 0.0, (0, 0, 0), at=(0, 0, 0))
    arm = s.rigid_body("arm", 0.0, (0, 0, 0), at=(0.1, 0, 0))
    rotor = s.rigid_body("rotor", 1.2, (1.5e-3, 9e-4, across), at=(0.15, 0, 0))
    s.revolute("turn", s.ground, fork, at=(0, 0, 0), axis=(0, 0, 1))
    s.revolute("dip", fork, arm, at=(0, 0, 0), axis=(0, 1, 0))
    s.revolute("spin", arm, rotor, at=(0.15, 0, 0), axis=(1, 0, 0), rate0=250.0)
    return s


def ball(radius: float = 0.2) -> mb.Scene:
    """Rows of velocities: a ball rolls, pulled by a spring."""
    s = mb.Scene("ball", gravity=(0.5, 0, -9.81))
    body = s.rigid_body("body", 2.0, (0.03, 0.04, 0.02), at=(0, 0, 0.2), velocity=(1.2, -0.1, 0), angular_velocity=(0.5, 6, 0.3))
    s.rolling("R", s.ground, body, at=(0, 0, 0.2), radius=radius)
    s.spring("S", s.ground, body, (1, 1, 0.3), (0.05, 0, 0.2), stiffness=3.0)
    return s


@pytest.mark.parametrize(("scene", "at", "name", "read", "end"), [
    (gyroscope, 9e-4, "rotor.inertia.2", "turn.rate", 0.05), (ball, 0.2, "R.radius", "body.angular_velocity[0]", 0.2)])
def test_error_covers_what_the_motion_does_not_show(scene: Any, at: float, name: str, read: str, end: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mb.AccuracyWarning)  # changed radii change the start
        one = scene(at).simulate(end).gradient(mb.at_end(read), to=name)[name]
        runs = {k: scene(at * (1 + 1e-3 * k)).simulate(end, solver=mb.DOP853(rtol=1e-13)) for k in (1, -1, 2, -2)}
    ends = {k: float(r.value(read)[-1]) for k, r in runs.items()}
    true = (2 / 3 * (ends[1] - ends[-1]) - 1 / 12 * (ends[2] - ends[-2])) / (1e-3 * at)
    assert one.error < 1e-5 * abs(true)
    assert abs(one.value - true) < one.error + 1e-8 * abs(true)  # rounding of the differences


def test_derivatives_by_many_numbers_are_made_some_after_others(monkeypatch):
    """Those over time by all numbers of an elastic mechanism at once took 15 GB."""
    s = mb.Scene("two", gravity=(0, -9.81, 0))
    for i in range(2):
        link = s.link(f"l{i}", (0, -i), (0.5, -i), mass=1.0)
        s.revolute(f"J{i}", s.ground, link, at=(0, -i), spring=2.0, damper=0.1)
    r, names, counts = s.simulate(0.3, 1e-6), ["J0.spring", "J0.damper", "l1.mass"], []
    whole = r.sensitivity("J0.angle", "J1.angle", to=names)
    made = reading.Derived.tangent
    monkeypatch.setattr(reading, "HELD", 1)
    monkeypatch.setattr(reading.Derived, "tangent", lambda of: counts.append(len(of.charts)) or made(of))
    parts = r.sensitivity("J0.angle", "J1.angle", to=names)
    assert set(counts) == {1}
    assert list(parts) == list(whole)
    for key, one in whole.items():
        np.testing.assert_allclose(parts[key].value, one.value, rtol=0, atol=1e-10 * np.abs(one.value).max())
