"""Numbers of a scene from measurements (`mb.fit`), least values within bounds (`mb.design`), a scene as a function
(`mb.function`)."""

import json

import numpy as np
import pytest
import sympy
from scipy.optimize import linprog

import mbdae as mb
from mbdae.derivatives import Bound
from mbdae.fits.beside import unmoved

TO = ["J0.spring", "J0.damper", "J1.spring", "J1.damper"]
TRUE = [2.0, 0.05, 3.0, 0.1]


def arm(*numbers):
    """Two links on springs and dampers, under gravity."""
    s, carrier = mb.Scene("arm", gravity=(0, -9.81, 0)), None
    for i in range(2):
        link = s.link(f"l{i}", (0.5 * i, 0), (0.5 * i + 0.5, 0), mass=1.0)
        s.revolute(f"J{i}", carrier or s.ground, link, at=(0.5 * i, 0), spring=numbers[2 * i], damper=numbers[2 * i + 1])
        carrier = link
    return s


@pytest.fixture(scope="module")
def data():
    """Both angles at 80 times, with errors of .001 rad."""
    rng, t = np.random.default_rng(1), np.linspace(0.02, 1.5, 80)
    r = arm(*TRUE).simulate(1.5, 1e-9, outputs=np.r_[0.0, t])
    return {f"J{i}.angle": (t, r.value(f"J{i}.angle")[1:] + 1e-3 * rng.normal(size=len(t))) for i in range(2)}


@pytest.fixture(scope="module")
def fitted(data):
    return mb.fit(arm(2.6, 0.08, 2.5, 0.07), data, to=TO, sigma=1e-3)


def test_numbers_are_within_their_errors(fitted):
    pulls = [(fitted.values[name] - true) / fitted.errors[name] for name, true in zip(TO, TRUE, strict=True)]
    assert max(map(abs, pulls)) < 4  # standard deviations: 4 numbers pass by chance once in 4000
    assert 0.85 < fitted.spread < 1.15  # of 156 degrees of freedom, within 2.6 standard deviations
    assert fitted.runs <= 10
    assert not fitted.untold
    low, high = fitted.interval(0.95)["J0.spring"]
    assert high - low == pytest.approx(2 * 1.95996 * fitted.errors["J0.spring"], rel=1e-5)  # normal: sigma is given
    assert np.allclose(np.diag(fitted.correlations), 1)
    assert fitted.scene.simulate(1.5).error("J0.angle") < 1e-6
    assert "J0.spring = " in str(fitted)


@pytest.mark.slow
def test_twenty_numbers_of_an_arm():
    """Masses, springs, dampers and start speeds of five links, from five angles and one force with errors."""
    def five(p):
        s, carrier = mb.Scene("arm", gravity=(0, -9.81, 0)), None
        for i in range(5):
            link = s.link(f"l{i}", (0.3 * i, 0), (0.3 * i + 0.3, 0), mass=p[i])
            s.revolute(f"J{i}", carrier or s.ground, link, at=(0.3 * i, 0), spring=p[5 + i], damper=p[10 + i], rate0=p[15 + i])
            carrier = link
        return s

    to = [f"l{i}.mass" for i in range(5)] + [f"J{i}.{word}" for word in ("spring", "damper", "rate0") for i in range(5)]
    true = np.array([1.0, 0.8, 0.7, 0.5, 0.4, 6, 5, 4, 3, 2, 0.3, 0.25, 0.2, 0.15, 0.1, 0.5, -0.4, 0.3, -0.2, 0.6])
    rng, t = np.random.default_rng(1), np.linspace(0.02, 2.0, 100)
    sigma = {**{f"J{i}.angle": 1e-3 for i in range(5)}, "J0.force[1]": 1e-2}  # rad, N
    r = five(true).simulate(2.0, 1e-9, outputs=np.r_[0.0, t])
    seen = {name: (t, r.value(name)[1:] + error * rng.normal(size=100)) for name, error in sigma.items()}
    f = mb.fit(five(true * (1 + 0.2 * rng.uniform(-1, 1, 20))), seen, to=to, sigma=sigma)
    assert f.runs <= 30
    assert not f.untold
    assert 0.9 < f.spread < 1.1  # of 580 degrees of freedom, within 3.4 standard deviations
    assert max(abs(f.values[name] - value) / f.errors[name] for name, value in zip(to, true, strict=True)) < 4.5


def test_errors_are_those_of_repeated_measurements(data, fitted):
    """The spread of the numbers over data with other errors is what one fit says of it."""
    rng, found = np.random.default_rng(2), []
    exact = {name: (t, fitted.result.value(name)) for name, (t, _) in data.items()}
    for _ in range(12):
        noisy = {name: (t, values + 1e-3 * rng.normal(size=len(t))) for name, (t, values) in exact.items()}
        found.append(mb.fit(fitted.scene, noisy, to=["J0.spring"], sigma=1e-3).values["J0.spring"])
    alone = mb.fit(fitted.scene, exact, to=["J0.spring"], sigma=1e-3).errors["J0.spring"]
    assert 0.5 < np.std(found) / alone < 1.7  # of 12 values: 99.9 % of the chi distribution


@pytest.mark.parametrize("seed", range(3))
def test_a_line_through_few_data_is_that_of_closed_forms(seed):
    """x = F t^2 / 2 is linear in F: value and error of least squares, and Student's interval of three degrees of freedom,
    which is 1.6 times as wide as the normal one."""
    s, t = mb.Scene("push"), np.array([0.4, 0.6, 0.8, 1.0])
    s.prismatic("P", s.ground, s.rigid_body("b", 1.0, 1.0, at=(0, 0)), at=(0, 0), axis=(1, 0, 0),
                force=mb.number("F", 2.1))
    y, x = t**2 + 1e-2 * np.random.default_rng(seed).normal(size=4), t**2 / 2
    f = mb.fit(s, {"P.displacement": (t, y)}, to=["F"])
    value = x @ y / (x @ x)
    error = np.sqrt(np.sum((y - value * x) ** 2) / 3 / (x @ x))
    assert f.values["F"] == pytest.approx(value, abs=1e-6 * error)
    assert f.errors["F"] == pytest.approx(error, rel=1e-6)
    assert f.interval(0.95)["F"] == pytest.approx((value - 3.182446 * error, value + 3.182446 * error), rel=1e-6)


def test_what_the_data_do_not_tell_is_named():
    """Two torques on one joint, of which a motion shows the sum alone."""
    t = np.linspace(0.1, 1.0, 30)
    one, two = mb.number("one", 1.0), mb.number("two", 1.0)
    s = mb.Scene("two in one", gravity=(0, -9.81, 0))
    s.revolute("J", s.ground, s.link("l", (0, 0), (1, 0), mass=1.0), at=(0, 0), torque=one * 5 + two * 5, damper=0.2)
    r = s.simulate(1.0, 1e-9, outputs=np.r_[0.0, t])
    with pytest.warns(mb.AccuracyWarning, match="do not tell one, two"):
        f = mb.fit(s, {"J.angle": (t, r["J"].angle[1:])}, to=["one", "two", "J.damper"], sigma=1e-3)
    assert f.untold == ("one", "two")
    assert f.errors["one"] == f.errors["two"] == np.inf
    assert f.errors["J.damper"] < 0.01
    shares, deviation = f.weakest
    assert deviation == np.inf
    assert shares["one"] == pytest.approx(-shares["two"])
    assert "do not tell one, two apart" in str(f)


def brake(damper):
    """A body that slides 2/damper far, and strikes another one, on a spring, 0.7 m away: below a damping of 2.86 N s/m."""
    s = mb.Scene("brake")
    body, other = (s.rigid_body(name, m, 1.0, at=(x, 0), velocity=(v, 0)) for name, m, x, v in (("a", 2, 0, 1), ("b", 1, 0.8, 0)))
    s.prismatic("P", s.ground, body, at=(0, 0), axis=(1, 0, 0), damper=damper)
    s.prismatic("Q", s.ground, other, at=(0.8, 0), axis=(1, 0, 0), spring=1.0)
    s.contact("hit", body, other, mb.Sphere(radius=0.05), mb.Sphere(radius=0.05), normal=mb.Hertz(1e6))
    return s


def test_a_fit_that_begins_where_the_data_do_not_depend_on_a_number_finds_where_they_do():
    t = np.linspace(0.1, 2.0, 30)
    seen = brake(2.0).simulate(2.0, 1e-8, outputs=np.r_[0.0, t])["Q"].displacement[1:]
    f = mb.fit(brake(4.0), {"Q.displacement": (t, seen)}, to=["P.damper"], sigma=1e-3)
    assert f.values["P.damper"] == pytest.approx(2.0, abs=f.errors["P.damper"])
    still = {"Q.displacement": (t, 0 * t)}  # what all dampers above 2.86 give
    with pytest.warns(mb.AccuracyWarning, match="other values of it give the same run to its accuracy, but not P.damper = "):
        assert mb.fit(brake(4.0), still, to=["P.damper"], sigma=1e-3).errors["P.damper"] == np.inf


@pytest.mark.parametrize("begin", [0.0, 1e-9, -1e-3])
@pytest.mark.parametrize("sigma", [1e-3, None])
def test_a_fit_leaves_a_saddle(begin, sigma):
    """The square of a displacement does not tell its sign: the slope vanishes at 0, where the sum of squares is largest."""
    t = np.linspace(0.1, 1.0, 12)
    s = mb.Scene("push")
    s.prismatic("P", s.ground, s.rigid_body("b", 1.0, 1.0, at=(0, 0)), at=(0, 0), axis=(1, 0, 0), force=mb.number("F", begin))
    f = mb.fit(s, {"P.displacement**2": (t, (2.0 * t**2 / 2) ** 2 + 1e-3 * np.sin(40 * t))}, to=["F"], sigma=sigma)
    assert abs(f.values["F"]) == pytest.approx(2.0, abs=4 * f.errors["F"])


@pytest.mark.parametrize("sigma", [1e-2, None])
def test_a_fit_leaves_a_saddle_where_every_number_moves_the_run(sigma):
    """Two pushes 1 + a and 1 - a: their product says a = .5, their difference, which is not weighed as much, a = 0."""
    t, a = np.linspace(0.1, 1.0, 12), mb.number("a", 0.0)
    s = mb.Scene("two")
    for i, force in enumerate((1 + a, 1 - a)):
        s.prismatic(f"P{i}", s.ground, s.rigid_body(f"b{i}", 1.0, 1.0, at=(0, i)), at=(0, i), axis=(1, 0, 0), force=force)
    seen = {"P0.displacement*P1.displacement": (t, 0.75 * t**4 / 4), "(P0.displacement - P1.displacement)/30": (t, 0 * t)}
    f = mb.fit(s, seen, to=["a"], sigma=sigma)
    a = np.linspace(0.3, 0.6, 30001)[:, None]
    squares = np.sum(((1 - a**2) - 0.75) ** 2 * t**8 / 16 + (a * t**2 / 30) ** 2, axis=1)
    assert abs(f.values["a"]) == pytest.approx(float(a[np.argmin(squares), 0]), abs=1e-4)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_the_unit_of_the_measurements_does_not_decide_where_a_fit_ends(unit):
    t = np.linspace(0.1, 1.5, 20)
    exact = arm(*TRUE).simulate(1.5, 1e-9, outputs=np.r_[0.0, t]).value("J0.angle")[1:]
    f = mb.fit(arm(3.0, *TRUE[1:]), {f"J0.angle*{unit!r}": (t, unit * (exact + 1e-3 * np.sin(50 * t)))}, to=["J0.spring"])
    assert f.values["J0.spring"] == pytest.approx(2.0, abs=4 * f.errors["J0.spring"])
    assert f.errors["J0.spring"] < 0.02


def test_a_number_without_effect_is_named_also_alone(data):
    s = arm(*TRUE)
    s.prismatic("aside", s.ground, s.rigid_body("b", 1.0, 1.0, at=(0, 2)), at=(0, 2), axis=(1, 0, 0), damper=0.3, position0=0.1)
    for to in (["aside.damper"], ["J0.damper", "aside.damper"]):
        with pytest.warns(mb.AccuracyWarning, match="do not tell aside.damper: other values of it"):
            f = mb.fit(s, data, to=to, sigma=1e-3)
        assert f.untold == ("aside.damper",)
        assert f.errors["aside.damper"] == np.inf


def test_as_many_numbers_as_data_have_no_standard_deviations_without_sigma(data):
    two = {name: (t[[5, 40]], values[[5, 40]]) for name, (t, values) in data.items()}
    with pytest.warns(mb.AccuracyWarning, match="nothing tells how large the errors of the measurements are"):
        f = mb.fit(arm(*TRUE), {"J0.angle": two["J0.angle"]}, to=TO[:2])
    assert np.isnan([*f.errors.values()]).all()
    assert "not known" in str(f)
    known = mb.fit(arm(*TRUE), {"J0.angle": two["J0.angle"]}, to=TO[:2], sigma=1e-3)
    one, other = known.interval()["J0.spring"]
    assert other - one == pytest.approx(2 * 1.95996 * known.errors["J0.spring"], rel=1e-5)


def test_a_number_at_its_bound_is_told_and_has_no_error(data):
    """The others are those of a fit with this number at its bound."""
    with pytest.warns(mb.AccuracyWarning, match="'J0.damper' ended at its bound 0.06, beyond which the sum of squares falls"):
        f = mb.fit(arm(2.6, 0.08, 2.5, 0.07), data, to=TO, sigma=1e-3, bounds={"J0.damper": (0.06, None)})
    assert f.at_bounds == {"J0.damper": 0.06}
    assert np.isnan(f.errors["J0.damper"])
    fixed = mb.fit(arm(2.0, 0.06, 3.0, 0.1), data, to=[TO[0], *TO[2:]], sigma=1e-3)
    for name in fixed.values:
        assert f.values[name] == pytest.approx(fixed.values[name], abs=0.02 * fixed.errors[name])
        assert f.errors[name] == pytest.approx(fixed.errors[name], rel=1e-3)


def test_advice_on_accuracy_can_be_followed():
    """Data of a run itself, more exact than any accuracy that simulate takes."""
    t = np.linspace(0.1, 1.0, 20)
    r = arm(*TRUE).simulate(1.0, 1e-11, outputs=np.r_[0.0, t])
    with pytest.warns(mb.AccuracyWarning, match="no accuracy that can be asked for"):
        mb.fit(arm(*TRUE), {"J0.angle": (t, r["J0"].angle[1:])}, to=["J0.spring"], sigma=1e-13, accuracy=1e-9)


def test_a_scene_that_does_not_explain_the_data_is_said(data):
    with pytest.warns(mb.AccuracyWarning, match="does not explain the data"):
        mb.fit(arm(*TRUE), data, to=["J0.damper"], sigma=1e-5)


def test_the_error_of_the_run_is_compared_with_that_of_the_measurements(data):
    with pytest.warns(mb.AccuracyWarning, match="moves the numbers; give accuracy="):
        mb.fit(arm(*TRUE), data, to=["J0.damper"], sigma=1e-3, accuracy=1e-2)


def test_runs_are_kept(data, fitted, tmp_path):
    file = tmp_path / "fit.json"
    first = mb.fit(arm(2.6, 0.08, 2.5, 0.07), data, to=TO, sigma=1e-3, resume=file, runs=2)
    assert "as many as allowed" in first.message
    assert first.runs <= 4
    again = mb.fit(arm(2.6, 0.08, 2.5, 0.07), data, to=TO, sigma=1e-3, resume=file)
    assert again.values == fitted.values
    assert again.runs < fitted.runs
    with pytest.raises(mb.OptionError, match="holds another fit"):
        mb.fit(arm(2.6, 0.08, 2.5, 0.07), data, to=TO[:2], sigma=1e-3, resume=file)
    stored = json.loads(file.read_text())
    stored["rows"][0]["values"]["shape"] = [1, 1]
    file.write_text(json.dumps(stored))
    with pytest.warns(mb.AccuracyWarning, match="computed again"):
        mb.fit(arm(2.6, 0.08, 2.5, 0.07), data, to=TO, sigma=1e-3, resume=file)


@pytest.mark.parametrize(("given", "said"), [
    ({"to": []}, "give one or more names"), ({"sigma": -1.0}, "positive standard deviations"),
    ({"data": 3}, "mapping of sensors"),
    ({"data": {"J0.angle": ([0.1], [1.0, 2.0])}}, "as many values as times"),
    ({"data": {"J0.angle": ([0.0], [1.0])}}, "where the run begins, so that there is no run to fit"),
    ({"data": {"J0.angle": ([-0.1, 0.2], [1.0, 1.0])}}, "a time of -0.1 s: runs begin at 0 s"),
    ({"bounds": {"x": (0, 1)}}, "names in `to`"), ({"bounds": {"J0.damper": (1, 0)}}, "not below the largest"),
    ({"runs": 0}, "runs"), ({"progress": 3}, "progress"),
])
def test_mistakes_are_named(data, given, said):
    options = {"data": data, "to": ["J0.damper"]} | given
    with pytest.raises(mb.OptionError, match=said):
        mb.fit(arm(*TRUE), options.pop("data"), **options)


def test_pullback_is_the_jacobian_transposed_and_that_is_a_difference():
    f = mb.function(arm(*TRUE), 0.6, ["J0.angle", "J1.force[0]"], TO[:2], outputs=4)
    p, w = np.array([2.1, 0.06]), np.random.default_rng(0).normal(size=(4, 2))
    assert f(p).shape == (4, 2)
    J = f.jacobian()
    assert np.allclose(f.pullback(w), np.tensordot(w, J, 2), rtol=1e-9)
    assert np.all(f.pullback_errors < 1e-4 * np.abs(f.pullback(w)).max())
    by = np.array([1e-3, 0.0])
    tight = mb.function(arm(*TRUE), 0.6, ["J0.angle", "J1.force[0]"], TO[:2], outputs=4, accuracy=1e-9)
    assert np.allclose((tight(p + by) - tight(p - by)) / 2e-3, J[:, :, 0], rtol=1e-5, atol=1e-5)
    assert mb.function(arm(*TRUE), 0.6, "J0.angle", "J0.spring")([2.0]).shape == (1,)
    with pytest.raises(mb.OptionError, match="call the function with numbers first"):
        mb.function(arm(*TRUE), 0.6, "J0.angle", "J0.spring").jacobian()
    for wrong in (np.ones(3), np.ones((2, 4)), 1.0, np.ones(8)):
        with pytest.raises(mb.OptionError, match=r"give the shape of the values, \(4, 2\)"):
            f.pullback(wrong)


def test_a_scene_without_derivatives_has_values():
    """Of a sampled controller in Python it is not known what it does: refused is what needs that, with the reason."""
    s = arm(*TRUE)
    s.controller("c", lambda t, x: -x, 0.05, reads=["J0.angle"], sets=["u"])
    f = mb.function(s, 0.1, "J0.angle", "J0.spring")
    assert f([2.0]).shape == (1,)
    for read in (f.jacobian, lambda: f.pullback(np.ones(1))):
        with pytest.raises(mb.DerivativeError, match="sampled controller 'c'"):
            read()


def test_derivatives_are_never_those_of_another_call():
    """After a call that fails there are none, but for numbers that are given, which calls in between do not change."""
    f, w = mb.function(arm(*TRUE), 0.3, "J0.angle", ["l0.mass", "J0.spring"]), np.ones(1)
    f([1.0, 2.0])
    here = f.jacobian()
    with pytest.raises(mb.SceneError):
        f([-1.0, 2.0])
    assert f.result is None
    for read in (f.jacobian, lambda: f.pullback(w), lambda: f.errors):
        with pytest.raises(mb.OptionError, match="none gave values"):
            read()
    f([1.3, 2.0])
    assert np.allclose(f.pullback(w, [1.0, 2.0]), here[0], rtol=1e-6)
    assert not np.allclose(f.jacobian(p=[1.3, 2.0]), here, rtol=1e-3)
    run = f.result
    f.pullback(w, np.array([1.3, 2.0]))
    assert f.result is run  # the same numbers: no further run
    with pytest.raises(mb.OptionError, match="p has the shape"):
        f.jacobian([1.0])


def test_a_gradient_descent_in_torch():
    """Spring and damper of a joint from its motion, by the gradient of the sum of squares."""
    torch = pytest.importorskip("torch")
    f, seen = mb.function(arm(*TRUE), 0.6, ["J0.angle"], TO[:2], outputs=6), None

    class Run(torch.autograd.Function):
        @staticmethod
        def forward(context, p):
            context.save_for_backward(p)
            return torch.as_tensor(f(p.detach().numpy()))

        @staticmethod
        def backward(context, weights):
            return torch.as_tensor(f.pullback(weights.numpy(), context.saved_tensors[0].numpy()))

    seen = torch.as_tensor(f(TRUE[:2]))
    x = torch.tensor([1.2, 1.5], dtype=torch.float64, requires_grad=True)  # over the true numbers
    method = torch.optim.LBFGS([x], max_iter=12, line_search_fn="strong_wolfe", tolerance_grad=1e-12)

    def loss():
        method.zero_grad()
        off = 1e3 * torch.sum((Run.apply(x * torch.tensor(TRUE[:2], dtype=torch.float64)) - seen) ** 2)
        off.backward()
        return off

    before = loss().item()
    method.step(loss)
    assert loss().item() < 1e-6 * before
    assert np.allclose(x.detach().numpy(), 1.0, atol=1e-2)


def test_a_gradient_descent_in_jax():
    """The same spring, by steps along the gradient that jax makes of the call back."""
    jax = pytest.importorskip("jax")
    f = mb.function(arm(*TRUE), 0.6, ["J0.angle"], TO[:1], outputs=6)
    seen = f(TRUE[:1])
    with jax.enable_x64(True) if hasattr(jax, "enable_x64") else jax.experimental.enable_x64():
        shape = jax.ShapeDtypeStruct(seen.shape, np.float64)

        @jax.custom_vjp
        def run(p):
            return jax.pure_callback(f, shape, p, vmap_method="sequential")

        run.defvjp(lambda p: (run(p), p),
                   lambda p, w: (jax.pure_callback(lambda p, w: f.pullback(w, p), p, p, w, vmap_method="sequential"),))
        slope = jax.value_and_grad(lambda p: 1e3 * ((run(p) - seen) ** 2).sum())
        p, step = jax.numpy.array([2.6]), 0.0
        before, g = slope(p)
        assert np.isclose(float(g[0]), float(slope(p + 1e-4)[0] - slope(p - 1e-4)[0]) / 2e-4, rtol=1e-5)
        q = p - 1e-2 * g
        for _ in range(8):  # steps as long as the last two gradients say (Barzilai and Borwein)
            value, now = slope(q)
            step = float((q - p)[0] / (now - g)[0])
            p, g, q = q, now, q - step * now
        assert float(value) < 1e-8 * float(before)
        assert abs(float(q[0]) - TRUE[0]) < 1e-4
        rows = jax.jacrev(run)(q)  # one call for every value, by vmap
        assert np.allclose(rows, f.jacobian(np.asarray(q)), rtol=1e-8)
        assert np.allclose(jax.vmap(run)(jax.numpy.stack([p, q]))[1], f(q))


def oscillator(damper=0.3):
    s = mb.Scene("oscillator")
    body = s.rigid_body("b", 2.0, 1.0, at=(0, 0))
    s.prismatic("P", s.ground, body, at=(0, 0), axis=(1, 0, 0), spring=8.0, damper=damper, position0=1.0)
    return s


def test_the_best_damping_of_an_oscillator():
    """The integral of x^2 from x = 1 at rest is (c/k + m/c) / 2, least at c = (m k)^.5."""
    d = mb.design(oscillator(), minimize=mb.integral("P.displacement**2"), to={"P.damper": (0.1, 20.0)}, t_end=12.0)
    assert d.found
    assert d.values["P.damper"] == pytest.approx(4.0, rel=1e-3)  # flat there: 1e-8 of the value is 2e-4 of the damping
    assert d.minimum == pytest.approx(0.5, rel=1e-6)
    assert d.runs <= 15


def test_a_bound_holds_for_the_largest_value_itself():
    """The largest force of the spring's end is bounded; a larger mass raises it."""
    s = mb.Scene("driven", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("l", (0, 0), (1, 0), mass=1.0), at=(0, 0), angle=mb.t**2)
    d = mb.design(s, minimize=mb.at_end("-A.force[1]**2"), to={"l.mass": (0.5, 3.0)}, t_end=1.0,
                   bounds=[mb.largest("A.drive", smooth=1e-2) <= 8.0])
    assert d.found
    assert d.bounds[0].active
    assert d.bounds[0].kept
    assert d.result.peak("A.drive").value == pytest.approx(8.0, rel=2e-4)
    assert "decides" in str(d)


def test_mass_needs_no_run():
    d = mb.design(oscillator(), minimize=mb.mass("b"), to={"b.mass": (0.5, 3.0)}, t_end=1.0)
    assert (d.values["b.mass"], d.minimum, d.result, d.runs) == (0.5, 0.5, None, 0)


def hill(force):
    """A body pushed by a function of two numbers that begin at 0."""
    s = mb.Scene("hill")
    body = s.rigid_body("b", 1.0, 1.0, at=(0, 0))
    s.prismatic("P", s.ground, body, at=(0, 0), axis=(1, 0, 0), damper=1.0, force=force(mb.number("a", 0.0), mb.number("c", 0.0)))
    return s


def pushed(a=0.0):
    """A body of 1 kg under the force 1 + a t for 2 s on a spring: its displacement is linear in a."""
    s = mb.Scene("pushed")
    s.prismatic("P", s.ground, s.rigid_body("b", 1.0, 1.0, at=(0, 0)), at=(0, 0), axis=(1, 0, 0), spring=36.0,
                force=1.0 + mb.number("a", a) * (mb.t - 1.0))
    return s


def test_the_least_largest_value_is_where_two_maxima_are_alike(tmp_path):
    """The largest displacement over the numbers is found by looking at a grid of closed forms: x = F/k (1 - cos w t) and the
    response to a ramp. Kept runs are not made again."""
    w, t = 6.0, np.linspace(0, 2, 40001)
    one, ramp = (1 - np.cos(w * t)) / w**2, (t - 1 - np.sin(w * t) / w + np.cos(w * t)) / w**2
    sizes = {a: np.abs(one + a * ramp).max() for a in np.linspace(-1, 1, 2001)}
    best = min(sizes, key=sizes.get)
    asked = {"minimize": mb.largest("P.displacement"), "to": {"a": (-1.0, 1.0)}, "t_end": 2.0, "resume": tmp_path / "d.json"}
    d = mb.design(pushed(0.9), **asked)
    assert d.found
    assert d.values["a"] == pytest.approx(best, abs=2e-3)
    assert d.minimum == pytest.approx(sizes[best], rel=1e-3)
    again = mb.design(pushed(0.9), **asked)
    assert again.values == d.values
    assert again.runs <= 1 < d.runs
    figure = d.plot(tmp_path / "d.png")
    assert (tmp_path / "d.png").stat().st_size > 1000
    assert figure.axes[0].get_ylabel() == "P.displacement [m]"


def test_bounds_at_which_two_maxima_decide_are_kept():
    """Two numbers, and both ends of a bound on the largest value: a linear programme in closed forms."""
    s = mb.Scene("two pushes")
    a, c = mb.number("a", 0.1), mb.number("c", 0.1)
    s.prismatic("P", s.ground, s.rigid_body("b", 1.0, 1.0, at=(0, 0)), at=(0, 0), axis=(1, 0, 0), spring=36.0,
                force=1.0 + a * mb.t + c * mb.t**2)
    d = mb.design(s, minimize=mb.at_end("-P.displacement"), to={"a": (-5.0, 5.0), "c": (-5.0, 5.0)}, t_end=2.0,
                  bounds=[mb.largest("P.displacement") <= 0.06])
    w, t = 6.0, np.linspace(0, 2, 20001)
    one, ramp = (1 - np.cos(w * t)) / w**2, (t - np.sin(w * t) / w) / w**2
    square = (t**2 - 2 / w**2 * (1 - np.cos(w * t))) / w**2
    A, b = np.stack([ramp, square], axis=1), 0.06
    best = linprog(-A[-1], np.vstack([A, -A]), np.r_[b - one, b + one], bounds=[(-5, 5)] * 2).fun - one[-1]
    assert d.found
    assert d.minimum == pytest.approx(best, rel=3e-4)


@pytest.mark.parametrize(("force", "to", "least"), [
    (lambda a, _: sympy.cos(a), {"a": (-2.0, 1.0)}, np.cos(2.0)),  # begins at a maximum; the least value is at an end
    (lambda a, _: -a**2, {"a": (0.0, 2.0)}, -4.0),  # a maximum at an end
    (lambda a, c: a * c + (a**4 + c**4) / 20, {"a": (-3.0, 3.0), "c": (-3.0, 3.0)}, -2.5),  # a saddle across both numbers
])
def test_a_design_does_not_end_at_a_maximum_or_saddle(force, to, least):
    """At t = 1 the body is at (t - 1 + e^-t) times the force."""
    d = mb.design(hill(force), minimize=mb.at_end("P.displacement"), to=to, t_end=1.0)
    assert d.found
    assert d.minimum == pytest.approx(least * np.exp(-1.0), rel=1e-5)


@pytest.mark.parametrize("begin", [4.0, 8.0, 2.0])
def test_a_design_that_begins_where_nothing_depends_on_a_number_finds_where_it_does(begin):
    """The other body goes farthest where the damping is least."""
    d = mb.design(brake(begin), minimize=mb.at_end("-Q.displacement"), to={"P.damper": (0.5, 8.0)}, t_end=2.0)
    assert d.found
    assert d.values["P.damper"] == pytest.approx(0.5, abs=1e-6)
    assert not d.without_effect


def test_a_least_value_that_is_flat_is_said():
    """Above a damping of 2.86 the other body stays where it is."""
    with pytest.warns(mb.AccuracyWarning, match="depends on P.damper, but elsewhere in the range they do, as at P.damper = [12]"):
        d = mb.design(brake(6.0), minimize=mb.at_end("Q.displacement"), to={"P.damper": (0.5, 8.0)}, t_end=2.0)
    assert d.minimum == 0.0
    assert d.values["P.damper"] > 2.86
    assert not d.without_effect
    assert "near which nothing depends on P.damper" in str(d)


def test_two_numbers_of_which_each_alone_has_no_effect():
    """A push that both must be positive to give: no slope, and no end of one range, shows it."""
    s = hill(lambda a, c: -sympy.Max(a - 1, 0) * sympy.Max(c - 1, 0))
    d = mb.design(s, minimize=mb.at_end("P.displacement"), to={"a": (0.0, 3.0), "c": (0.0, 2.0)}, t_end=1.0)
    assert d.found
    assert d.minimum == pytest.approx(-2.0 * np.exp(-1.0), rel=1e-5)


def test_too_few_runs_to_know_of_an_effect_are_said():
    with pytest.warns(mb.AccuracyWarning, match="too few runs are left to know whether other values of P.damper matter"):
        d = mb.design(brake(4.0), minimize=mb.at_end("-Q.displacement"), to={"P.damper": (0.5, 8.0)}, t_end=2.0, runs=1)
    assert not d.found
    assert not d.without_effect


def test_a_number_without_effect_on_a_design_is_named():
    s = hill(lambda a, c: a**2 + 0 * c)
    s.prismatic("aside", s.ground, s.rigid_body("d", 1.0, 1.0, at=(0, 2)), at=(0, 2), axis=(1, 0, 0), damper=0.3, position0=0.1)
    with pytest.warns(mb.AccuracyWarning, match="depends on aside.damper, at other values in the range too"):
        d = mb.design(s, minimize=mb.at_end("P.displacement"), to={"a": (-1.0, 1.0), "aside.damper": (0.1, 1.0)}, t_end=1.0)
    assert d.without_effect == ("aside.damper",)  # and not `a`, whose slope vanishes where the search begins and ends
    assert "without effect: aside.damper" in str(d)


def test_a_long_expression_stands_over_its_axes(data):
    """Beside them it would cover those of the next; an expression of unknown unit is not called a pure number."""
    names = "J0.angle", "J0.angle**2 + J1.angle**2 + J0.angle*J1.angle", "J1.angle**2"
    axes = mb.fit(arm(*TRUE), dict.fromkeys(names, data["J0.angle"]), to=TO[:1]).plot().axes
    assert [axis.get_ylabel() for axis in axes] == ["J0.angle [rad]", "", "J1.angle**2"]
    assert axes[1].get_title("left") == "J0.angle**2 + J1.angle**2 + J0.angle*J1.angle"


def test_a_chained_comparison_is_refused():
    with pytest.raises(mb.OptionError, match="give two bounds"):
        -0.5 <= mb.at_end("P.displacement") <= 2.0  # noqa: B015


def test_a_bound_that_cannot_be_kept_is_said():
    with pytest.warns(mb.AccuracyWarning, match="not kept"):
        d = mb.design(oscillator(), minimize=mb.mass("b"), to={"b.mass": (1.0, 3.0)}, t_end=1.0,
                      bounds=[mb.largest("P.displacement") <= 0.5])
    assert not d.found


@pytest.mark.parametrize(("given", "said"), [
    ({"minimize": "P.displacement"}, "give mb.integral"), ({"to": {}}, "mapping of names"),
    ({"to": {"b.mass": (2, 1)}}, "mapping"), ({"bounds": [3]}, "list of bounds"),
    ({"minimize": mb.mass("nobody")}, "no body 'nobody'"),
])
def test_mistakes_of_designs_are_named(given, said):
    options = {"minimize": mb.mass("b"), "to": {"b.mass": (0.5, 3.0)}, "t_end": 1.0} | given
    with pytest.raises(mb.OptionError, match=said):
        mb.design(oscillator(), **options)


@pytest.mark.parametrize("stiffness", [-1e3, -1e7])
def test_a_motion_that_grows_without_bound_ends_with_a_refusal(stiffness):
    """An optimiser steps to a negative stiffness: angles grow by e^60 and more, in steps that become shorter and shorter."""
    f = mb.function(arm(*TRUE), 0.6, ["J0.angle"], TO[:1], outputs=6)
    with pytest.raises(mb.SolverError, match=r"grows without bound, .* unknown or equation J0\.rate"):
        f([stiffness])


def test_a_rotor_that_spins_up_does_not_grow_without_bound():
    """Its speed becomes 1e4 times that at the start, in many short steps."""
    s = mb.Scene("rotor")
    rotor = s.rigid_body("rotor", 1.0, (1.0, 1.0, 1.0), at=(0.1, 0, 0))
    s.revolute("J", s.ground, rotor, at=(0, 0, 0), axis=(0, 0, 1), torque=2e4)
    assert s.simulate(1.0, 1e-4).value("J.rate")[-1] == pytest.approx(2e4 / 1.01, rel=1e-3)


def test_a_bound_that_nothing_moves_is_named_and_not_sought():
    """A second pendulum, which no number of the first moves: no hundred runs for it, and it is named."""
    s = mb.Scene("two", gravity=(0, -9.81, 0))
    for i in range(2):
        link = s.link(f"l{i}", (0, -i), (0.5, -i), mass=1.0)
        s.revolute(f"J{i}", s.ground, link, at=(0, -i), spring=2.0, damper=0.1)
    with pytest.warns(mb.AccuracyWarning, match="nothing brings largest J1.angle <= 0.5 nearer to its limit"):
        d = mb.design(s, mb.largest("J0.angle"), {"J0.spring": (1.0, 10.0)}, 0.5, bounds=[mb.largest("J1.angle") <= 0.5])
    assert not d.found
    assert d.runs <= 10


class Stepped:
    """Numbers of a run by x: 1 below x = .7, 0 above it, with no slope anywhere."""

    felt, names = [(None, np.array([False]))], ["x"]

    def value(self, _i, x):
        return float(x[0] < 0.7)

    def slope(self, _i, _x):
        return np.zeros(1)

    def largest(self, _i):
        return False


def test_a_search_begins_where_a_bound_is_nearer_that_nothing_moves_at_the_start():
    """Slopes may be 0 at the start alone."""
    met, never = Bound("x", 1.0, 0.5), Bound("x", 1.0, -0.5)
    begin, still = unmoved(Stepped(), [met], np.array([0.2]))
    assert begin[0] > 0.7
    assert not still
    assert unmoved(Stepped(), [met], np.array([0.8]))[0] == 0.8  # it is kept
    upper = Bound("x", -1.0, 2.0)
    assert unmoved(Stepped(), [upper], np.array([0.2]))[1] == [upper]
    assert not unmoved(Stepped(), [never], np.array([0.2]))[1]
