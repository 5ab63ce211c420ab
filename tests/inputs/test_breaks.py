"""Where inputs of time switch, and how fast they vary: known beforehand, whatever the width."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.inputs import timed
from mbdae.inputs.breaks import TooManyError, breaks, distinct, jump
from mbdae.inputs.enclosure import Enclosure
from mbdae.inputs.resolution import stretches

t = mb.t


def found(value: object, end: float = 10.0) -> np.ndarray:
    return breaks([timed.expression(value)], 0.0, end)


@pytest.mark.parametrize(
    ("value", "instants"),
    [
        (sp.Piecewise((0, t < 6.3), (1, t < 7.3), (0, True)), [6.3, 7.3]),
        (sp.Piecewise((1, (t > 2) & (t < 3)), (0, True)), [2, 3]),
        (sp.Piecewise((1, (t < 2) | (t > 2 + 1e-6)), (0, True)), [2, 2 + 1e-6]),
        (sp.Piecewise((1, ~((t > 2) & (t < 3))), (0, True)), [2, 3]),
        (sp.Heaviside(t - 2) - sp.Heaviside(t - 5), [2, 5]),
        (sp.sign(sp.Max(t - 5, 0)) + sp.Abs(t - 7), [5, 7]),
        (sp.Mod(t, 3), [3, 6, 9]),
        (sp.floor(sp.sqrt(t)), [1, 4, 9]),
        (sp.Abs(sp.sin(t)), [np.pi, 2 * np.pi, 3 * np.pi]),
        (sp.Max(0, sp.exp(-t) - sp.Rational(1, 2)), [np.log(2)]),
        (sp.Piecewise((1, t**3 - 6 * t**2 + 11 * t - 6 < 0), (0, True)), [1, 2, 3]),
        (sp.Abs(sp.Abs(t - 4) - 1), [3, 4, 5]),
        (sp.Piecewise((sp.Mod(t, 2), sp.Mod(t, 4) < 2), (0, True)), [2, 4, 6, 8]),
        (sp.Piecewise((1, sp.sin(1000 * t) > 2), (t, True)), []),
    ],
)
def test_instants_of_switching(value: object, instants: list[float]) -> None:
    """Every instant stated is found to round-off; those in between, if any, change nothing."""
    edges = found(value)
    for instant in instants:
        assert np.min(np.abs(edges - instant), initial=np.inf) < 1e-13 * 10
    e = timed.sided(timed.expression(value))
    middle = np.r_[0.0, edges, 10.0]
    middle = (middle[1:] + middle[:-1]) / 2
    sides, parts = zip(edges, middle, middle[1:], strict=False), timed.derivatives(e)
    jumps = [abs(jump(part, at, a, b)) for at, a, b in sides for part in parts]
    others = [at for at in edges if np.min(np.abs(np.array(instants) - at), initial=np.inf) > 1e-12]
    for at in others:
        i = int(np.flatnonzero(edges == at)[0])
        assert max(jumps[3 * i : 3 * i + 3]) < 1e-12


def test_random_trigonometric_conditions_against_samples() -> None:
    """Zeros of sums of sines isolated by interval arithmetic: as many changes of sign as a fine grid shows, and none missed."""
    random = np.random.default_rng(5)
    for _ in range(10):
        a, b, c = [*random.uniform(1, 9, 2).tolist(), float(random.uniform(-0.5, 0.5))]
        u = sp.sin(a * t) + sp.cos(b * t) + c
        edges = found(sp.Piecewise((1, u > 0), (0, True)))
        grid = np.linspace(0, 10, 200_001)
        values = np.sin(a * grid) + np.cos(b * grid) + c
        crossings = grid[:-1][np.signbit(values[1:]) != np.signbit(values[:-1])]
        assert len(edges) == len(crossings)
        assert np.allclose(edges, crossings, atol=6e-5)


@pytest.mark.parametrize("width", [1e-6, 1e-4, 1e-2, 1.0])
@pytest.mark.parametrize(
    "pulse",
    [
        lambda x: sp.exp(-(x**2)), lambda x: 1 / (1 + x**2), lambda x: 1 / sp.cosh(x), lambda x: sp.tanh(x) - sp.tanh(x - 3),
        lambda x: 1e6 + sp.exp(-(x**2)), lambda x: sp.sqrt(1 + x**2) - x, lambda x: sp.sin(t) * sp.exp(-(x**4)),
        lambda x: sp.atan(x),
    ],
)
def test_a_pulse_of_any_width_is_found(pulse: object, width: float) -> None:
    """Stretches at the centre are about as long as the pulse, however narrow; there are few of them."""
    e = timed.expression(pulse((t - sp.Rational(37, 8)) / sp.Float(width)))  # type: ignore[operator]
    line = stretches([e], np.r_[0.0, breaks([e], 0.0, 10.0), 10.0])
    i = int(np.searchsorted(line.edges, 37 / 8, side="right")) - 1
    assert np.diff(line.edges)[i] <= 6 * width
    assert len(line.edges) < 1000
    assert not line.poles


def test_bounds_hold() -> None:
    """Values at random times lie within the bounds of intervals around them, for every function of the language."""
    random = np.random.default_rng(3)
    inner = sp.sin(3 * t) / 2
    texts = [sp.tan(inner), sp.asin(inner), sp.acos(inner), sp.atan(t), sp.sinh(inner), sp.cosh(inner), sp.tanh(t), sp.asinh(t),
             sp.acosh(1 + t), sp.atanh(inner), sp.exp(-t), sp.log(1 + t), sp.sqrt(t), (inner - 1) ** 3, inner**4, 1 / (2 + inner),
             (1 + t) ** sp.Rational(-3, 2), sp.Mod(t, 0.7), sp.Max(inner, sp.cos(t)), t**2 - t * inner]
    low = random.uniform(0, 10, 300)
    high = low + 10.0 ** random.uniform(-6, 0, 300)
    for text in texts:
        e = timed.sided(timed.expression(text))
        side = (low + high) / 2
        ((below, above),) = Enclosure(e)(low, high, side)
        for share in random.uniform(0, 1, 5):
            values = timed.values(e, low + share * (high - low), side)
            slack = 1e-12 * (1 + np.abs(values))
            assert np.all(values >= below - slack), text
            assert np.all(values <= above + slack), text


def test_what_cannot_be_followed_is_refused() -> None:
    with pytest.raises(TooManyError, match="more than"):
        found(sp.Mod(t, sp.Float(1e-7)))
    with pytest.raises(TooManyError, match="the input varies so fast that more than"):
        stretches([timed.expression(sp.sin(sp.Float(1e9) * t))], np.array([0.0, 10.0]))


@pytest.mark.parametrize(("value", "text"), [
    (sp.Piecewise((1, t < 1)), "has no value where none of its conditions holds"), (sp.gamma(t), "contains the function gamma"),
])
def test_inputs_without_a_value_are_refused(value: object, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        timed.expression(value)


@pytest.mark.parametrize(("end", "width"), [(1e6, 1e-7), (1e4, 1e-9), (2.0, 3e-13)])
def test_a_pulse_is_resolved_beside_its_time_not_beside_the_run(end: float, width: float) -> None:
    pulse = sp.Piecewise((1, (t > 1) & (t < 1 + width)), (0, True))
    assert found(pulse, end) == pytest.approx([1, 1 + width], abs=width / 10)


def test_a_pulse_that_no_step_resolves_is_refused() -> None:
    def scene(width: float) -> mb.Scene:
        s = mb.Scene("pulse", gravity=(0, 0, 0))
        force = sp.Piecewise((0.1 / width, (t > 1) & (t < 1 + width)), (0, True))
        s.prismatic("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), axis=(1, 0, 0), force=force)
        return s

    with pytest.raises(mb.SceneError, match=r"changes at t = 1 s and again 1.0e-13 s later"):
        scene(1e-13).simulate(2.0)
    assert scene(1e-6).simulate(2.0)["A"].rate[-1] == pytest.approx(0.1, rel=1e-5)


def test_edges_that_differ_by_round_off_are_one():
    times = np.array([0.0, 0.3, np.nextafter(0.3, 1), 1.0 - 1e-15, 1.0, 1e-300])
    np.testing.assert_array_equal(distinct(times), [0.0, 0.3, 1.0])
    two = mb.table([0, 0.3, 1], [0, 1, 0]) + mb.table([0, float(np.nextafter(0.3, 1)), 1], [0, 1, 0])
    made = stretches((timed.expression(two),), np.array([0.0, 1.0]))
    assert np.diff(made.edges).min() > 1e-12
    assert len(made.kinks) == 1
