"""Tables of time: values and derivatives, where runs land, bad input, storage, and what 1e5 points cost."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from oracles.runs import between_breaks
from scipy.interpolate import PchipInterpolator

import mbdae as mb
from mbdae.export.program import run
from mbdae.inputs import tables, timed
from mbdae.inputs.breaks import breaks
from mbdae.inputs.enclosure import enclosure
from mbdae.inputs.measured import pieces
from mbdae.inputs.tables import Table
from mbdae.native.program import LOOKUP, Operations
from mbdae.run.batch import run_batch
from mbdae.scene.record import read, stored
from mbdae.symbolic.variation import rate

t = mb.t
RANDOM = np.random.default_rng(3)
AT, VALUES = np.sort(np.r_[0, RANDOM.uniform(0, 5, 40), 5]), 10 * RANDOM.normal(size=42)
PCHIP = PchipInterpolator(AT, VALUES)
KINDS = {"linear": lambda x, side: np.interp(x, AT, VALUES), "cubic": lambda x, side: PCHIP(x),
         "step": lambda x, side: VALUES[np.searchsorted(AT, side) - 1]}


def oscillator(force: Any) -> mb.Scene:
    """Mass 1 kg, spring 25 N/m, damper 0.5 N s/m."""
    s = mb.Scene("oscillator")
    body = s.rigid_body("m", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.prismatic("p", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0), spring=25.0, damper=0.5, force=force)
    return s


def reference(force: Any, edges: Any) -> float:
    """The last displacement by SciPy, which stops at every edge; force(t, a time inside the segment)."""
    rates = lambda x, y, m: [y[1], force(x, m) - 25 * y[0] - 0.5 * y[1]]  # noqa: E731
    return float(between_breaks(rates, [0.0, 0.0], edges)[-1, 0])


@pytest.mark.parametrize("kind", KINDS)
def test_values_and_derivatives(kind: str) -> None:
    """Against NumPy and SciPy, alone and inside of a larger expression, at another pace."""
    x = np.linspace(0.05, 4.95, 501)
    e = timed.expression(2 * mb.table(AT, VALUES, kind=kind).subs(t, 3 - t / 2) + sp.sin(t))
    value, rate, second = timed.derivatives(e)
    inner = 3 - x / 2
    np.testing.assert_allclose(timed.values(value, x), 2 * KINDS[kind](inner, inner) + np.sin(x), atol=1e-12)
    d, dd = {"linear": (Table(AT, VALUES).lookup(inner, inner, 1), 0 * x), "cubic": (PCHIP(inner, 1), PCHIP(inner, 2)),
             "step": (0 * x, 0 * x)}[kind]
    np.testing.assert_allclose(timed.values(rate, x), -d + np.cos(x), atol=1e-10)
    np.testing.assert_allclose(timed.values(second, x), dd / 2 - np.sin(x), atol=1e-8)


def test_sympy_sees_a_function_with_derivatives_and_values() -> None:
    f = mb.table(AT, VALUES, kind="cubic")
    assert float((1 + f).subs(t, 2.3)) == pytest.approx(1 + PCHIP(2.3), rel=1e-14)
    assert float((f * t).diff(t).subs(t, 2.3)) == pytest.approx(PCHIP(2.3) + 2.3 * PCHIP(2.3, 1), rel=1e-13)
    assert float(timed.expression(2 * f.subs(t, 2.3))) == pytest.approx(2 * PCHIP(2.3), rel=1e-14)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("outside", ["hold", "periodic", "error"])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_native_lookup_is_that_of_numpy(kind: str, outside: str, order: int) -> None:
    """At and between points, on both sides of each, before and beyond the table, in any order of times."""
    values = np.r_[VALUES[:-1], VALUES[0]]
    table = Table(AT, values, kind, outside)
    x = RANDOM.permutation(np.r_[AT, AT, RANDOM.uniform(-7, 12, 200), 5 + AT, AT - 5])
    side = x + RANDOM.choice([-1e-3, 1e-3], len(x))
    operations = Operations(2)
    first = operations.lookup(table.packed, 0, 1, 1.0, 0.0)
    W = np.zeros(operations.size)
    operations.fill(W)
    found = []
    for W[0], W[1] in zip(x, side, strict=True):
        run(operations.steps, W)
        found.append(W[first + order])
    np.testing.assert_allclose(found, table.lookup(x, side, order), rtol=1e-13, atol=1e-9)
    assert operations.steps[0].fields["kind"] == LOOKUP


def test_a_short_array_is_no_table_for_the_native_core() -> None:
    with pytest.raises(ValueError, match="was stored in 20 numbers: 9, and 6 for each"):
        Operations(2).lookup(np.zeros(20), 0, 1, 1.0, 0.0)


@pytest.mark.parametrize("outside", ["hold", "periodic"])
@pytest.mark.parametrize("kind", KINDS)
def test_bounds_hold_and_are_tight(kind: str, outside: str) -> None:
    e = timed.expression(mb.table(AT, np.r_[VALUES[:-1], VALUES[0]], kind=kind, outside=outside))
    low = RANDOM.uniform(-6, 11, 100)
    high = low + RANDOM.choice([0.01, 0.3, 4.0, 9.0], 100)
    ((least, most),) = enclosure(e)(low, high, (low + high) / 2)
    for a, b, least_, most_ in zip(low, high, least, most, strict=True):
        points = (AT + 5 * np.arange(-3, 4)[:, None]).ravel() if outside == "periodic" else AT
        x = np.sort(np.r_[np.linspace(a, b, 4001), points[(points > a) & (points < b)]])
        seen = timed.values(e, x)
        assert least_ <= seen.min() + 1e-9
        assert most_ >= seen.max() - 1e-9
        if kind != "step":
            assert least_ >= seen.min() - 0.3
            assert most_ <= seen.max() + 0.3


SOLVERS = [(None, 3e-8), (mb.RadauIIA(3), 1e-7), (mb.IDA(), 1e-6), (mb.CVODE(), 1e-6), (mb.RadauIIA(2), 1e-6)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("solver", "error"), SOLVERS)
def test_a_force_by_a_table_against_scipy(kind: str, solver: Any, error: float) -> None:
    r = oscillator(mb.table(AT, VALUES, kind=kind)).simulate(5.0, accuracy=1e-6, solver=solver)
    assert abs(r["m"].position[-1, 0] - reference(KINDS[kind], AT)) < error
    steps = r.solution.t
    inside = AT[1:-1]
    if kind != "cubic":
        assert np.max(np.min(np.abs(inside[:, None] - steps), axis=1)) < 1e-12  # every point ends a step


def test_constant_steps_end_at_the_points_too() -> None:
    r = oscillator(mb.table(AT, VALUES)).simulate(5.0, solver=mb.HHT(step=0.01))
    assert np.max(np.min(np.abs(AT[1:-1, None] - r.solution.t), axis=1)) < 1e-12
    assert r.stats.shortened > 40


def test_outside_of_the_table() -> None:
    """Held, repeated, or refused before the run."""
    ramp = lambda outside, values=(0, 1, 0): mb.table([0, 0.5, 1], values, outside=outside)  # noqa: E731
    r = oscillator(ramp("periodic")).simulate(4.3, accuracy=1e-7)
    saw = lambda x, m: np.interp(x - np.floor(m), [0, 0.5, 1], [0, 1, 0])  # noqa: E731
    assert abs(r["m"].position[-1, 0] - reference(saw, np.r_[np.arange(0, 4.3, 0.5), 4.3])) < 3e-9
    held = oscillator(ramp("hold", (0, 1, 2))).simulate(40.0, accuracy=1e-7)
    assert abs(held["m"].position[-1, 0] - 2 / 25) < 1e-5
    with pytest.raises(mb.SceneError, match=r"goes from 0 to 1 s, and the run reads it from 0 to 2 s"):
        oscillator(ramp("error")).simulate(2.0)
    with pytest.raises(mb.SceneError, match=r"reads it from 0 to 1.5 s"):
        oscillator(ramp("error").subs(t, t / 2)).simulate(3.0)
    oscillator(ramp("error")).simulate(1.0)


@pytest.mark.parametrize("solver", [None, mb.IDA(), mb.RadauIIA(3), mb.CVODE()])
def test_a_spike_between_two_coarse_points(solver: Any) -> None:
    """1000 N for 2 ms in a rest of 10 s: an impulse of 1 N s."""
    s = mb.Scene("rest")
    body = s.rigid_body("m", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.prismatic("p", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0), force=mb.table([0, 5, 5.001, 5.002, 10], [0, 0, 1000, 0, 0]))
    r = s.simulate(8.0, accuracy=1e-6, solver=solver)
    assert abs(r["m"].velocity[-1, 0] - 1.0) < 1e-7


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Classical()])
def test_a_prescribed_table(model: Any) -> None:
    """A monotone cubic prescribes rates and accelerations; linear ones jump, and the message says where."""
    s = mb.Scene("driven")
    body = s.rigid_body("m", 2.0, (1, 1, 1), at=(0, 0, 0))
    at, values = [0, 1, 2, 3], [0, 0.1, 0.3, 0.3]
    s.prismatic("p", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0), position=mb.table(at, values, kind="cubic"), model=model)
    r = s.simulate(3.0, outputs=np.linspace(0, 3, 200))
    exact = PchipInterpolator(at, values)
    np.testing.assert_allclose(r["m"].position[:, 0], exact(r.t), atol=1e-7)
    np.testing.assert_allclose(r["p"].force[:, 0], 2 * exact(r.t, 2), atol=1e-6)
    np.testing.assert_array_equal(s.system().timeline(0.0, 3.0, 1e-6).breaks, [1.0, 2.0])  # the acceleration jumps
    for kind, words in (("linear", r"its rate jumps by 0.1 m/s at t = 1 s"), ("step", r"jumps by 0.1 m at t = 1 s")):
        other = mb.Scene("driven")
        body = other.rigid_body("m", 2.0, (1, 1, 1), at=(0, 0, 0))
        other.prismatic("p", other.ground, body, at=(0, 0, 0), axis=(1, 0, 0), position=mb.table(at, values, kind=kind))
        with pytest.raises(mb.SceneError, match=words + '.*kind="cubic"'):
            other.simulate(3.0)


def test_points_without_significance_are_stepped_over() -> None:
    """1e5 points of a sine: none is a kink at 1e-8 of its range, some at 1e-12; noise has one at every point; steps see the sine
    often enough."""
    x = np.linspace(0, 10, 100_001)
    fine = Table(x, np.sin(2 * x))
    found = pieces(fine, 0, 0.0, 10.0, 1e-8)
    assert len(found.kinks) == len(found.jumps) == 0
    assert 20 < len(found.edges) < 200
    assert np.max(np.diff(found.edges)) < 1.0  # rad/2 of the sine
    assert len(pieces(fine, 0, 0.0, 10.0, 1e-11).kinks) > 1000
    assert len(pieces(Table(x, RANDOM.normal(size=len(x))), 0, 0.0, 10.0, 1e-8).kinks) == 99_999
    spike = np.sin(2 * x)
    spike[[40_000, 70_000]] += [1e-6, 1e-3]
    assert {4.0, 7.0} <= set(np.round(pieces(Table(x, spike), 0, 0.0, 10.0, 1e-7).kinks, 4))


def test_what_is_left_out_is_within_the_accuracy() -> None:
    """A table fine against the motion: kinks that are stepped over cost less than the accuracy."""
    x = np.linspace(0, 10, 3001)
    exact = reference(lambda at, m: np.interp(at, x, np.sin(2 * x)), np.linspace(0, 10, 3001)[::1])
    for accuracy in (1e-3, 1e-5):
        r = oscillator(mb.table(x, np.sin(2 * x))).simulate(10.0, accuracy=accuracy)
        assert abs(r["m"].position[-1, 0] - exact) < accuracy * 0.1  # the length of the scene is 1 m


def test_cost_does_not_grow_with_points() -> None:
    """A constant number of operations, of expressions and of steps, whether the same straight lines have 10 points or 1e5."""
    counts, lengths = [], []
    for n in (10, 100_000):
        x = np.linspace(0, 10, n)
        s = oscillator(mb.table(x, 3 * x))
        r = s.simulate(10.0, accuracy=1e-6)
        counts.append((r.stats.steps, r.stats.residuals))
        workspace = s.system().assembly.evaluation
        lengths.append((len(workspace.W), len(workspace.clock.steps)))
    assert counts[0] == counts[1]
    assert lengths[0] == lengths[1]


def test_scenes_keep_their_tables(tmp_path: Path) -> None:
    """Saved and loaded where no other table is known; damaged points are refused."""
    force = 2 * mb.table(AT, VALUES, kind="cubic") + sp.cos(t)
    r = oscillator(force).simulate(1.0)
    r.save(tmp_path / "run.npz")
    known, tables._KNOWN = tables._KNOWN, {}
    try:
        again = mb.load(tmp_path / "run.npz")
        np.testing.assert_array_equal(again["p"].force, r["p"].force)
        assert len(tables._KNOWN) == 1
    finally:
        tables._KNOWN = known
    data = json.loads(json.dumps(stored(timed.expression(force))))
    (name,) = data["tables"]
    assert read(data) == timed.expression(force)
    data["tables"][name]["kind"] = "step"
    with pytest.raises(ValueError, match="are not those with which it was stored"):
        read(data)
    data["tables"][name]["t"] = "####"
    with pytest.raises(ValueError, match="cannot be read"):
        read(data)


def test_a_scene_in_another_process(tmp_path: Path) -> None:
    """Scenes that are handed to another process bring their tables."""
    r = oscillator(mb.table(AT, VALUES, kind="cubic")).simulate(1.0, accuracy=1e-6)
    (tmp_path / "scene").write_bytes(pickle.dumps(r.prepared.model.scene))
    code = ("import pickle, sys; s = pickle.load(open(sys.argv[1], 'rb')); "
            "print(float(s.simulate(1.0, accuracy=1e-6)['p'].displacement[-1]))")
    found = subprocess.run([sys.executable, "-c", code, str(tmp_path / "scene")], capture_output=True, text=True, check=True)
    assert float(found.stdout) == pytest.approx(r["p"].displacement[-1], rel=1e-12)


def test_many_runs_in_one_call() -> None:
    """A batch of starts lands on the points as single runs do."""
    s = oscillator(mb.table(AT, VALUES)).recursive()
    y0 = s.system().y0
    found = run_batch(s, 5.0, starts=np.stack([y0, y0 + 0.1]), outputs=3)
    alone = oscillator(mb.table(AT, VALUES)).simulate(5.0, accuracy=1e-9)
    assert abs(found.batch.y[0, -1, 0] - alone["p"].displacement[-1]) < 1e-5


BAD = [
    (([0, 2, 1], [0, 1, 2]), "t\\[1\\] = 2.0 and t\\[2\\] = 1.0 are not in rising order"),
    (([0, 1, 1], [0, 1, 2]), "t\\[1\\] = 1.0 and t\\[2\\] = 1.0 are equal"),
    (([0, 1, np.nan], [0, 1, 2]), "t\\[2\\] is not a finite number"),
    (([0, 1, 2], [0, np.inf, 2]), "values\\[1\\] is not a finite number"),
    (([0], [1]), "a table of 1 point"), (([], []), "a table of 0 points"),
    (([0, 1], [0, 1, 2]), "2 numbers t and 3 numbers values"), (([[0, 1]], [0, 1]), "shape \\(1, 2\\)"),
    (("ab", [0, 1]), "t = 'ab'"), (([0, "x"], [0, 1]), "'x'"), (([0, 1], [0, 1], "spline"), "'spline' is not one of"),
    (([0, 1], [0, 1], "linear", "wrap"), "'wrap' is not one of"),
    (([0, 1], [0, 1], "linear", "periodic"), "ends with the value with which it begins"),
    (([0, 1e-13, 1], [0, 1, 2]), "closer than any time step"),
]


@pytest.mark.parametrize(("given", "words"), BAD)
def test_bad_tables(given: Any, words: str) -> None:
    with pytest.raises(mb.OptionError, match=f"mb.table: .*{words}"):
        mb.table(*given)


@pytest.mark.parametrize(("at", "outside"), [(mb.table([0, 1], [0, 1]), "hold"), (sp.sin(t), "error")])
def test_a_table_of_anything_but_the_time(at: Any, outside: str) -> None:
    with pytest.raises(mb.SceneError, match=r"of time it may be read at a\*mb.t \+ b"):
        oscillator(mb.table([0, 1], [0, 1], outside=outside).subs(t, at)).check()


def test_breaks_of_conditions_on_a_table() -> None:
    f = mb.table([0, 1, 2, 3], [0, 1, 0, 1])
    e = timed.expression(sp.Piecewise((1, f > sp.Rational(1, 2)), (0, True)) + sp.Abs(f - 0.25))
    np.testing.assert_allclose(sorted(set(np.round(breaks([e], 0.0, 3.0), 9))), [0.25, 0.5, 1.5, 1.75, 2.25, 2.5], atol=1e-9)


def test_a_damper_whose_end_an_input_moves() -> None:
    """Where a law takes the rate of its input, a kink of the table is a jump of its force: the run begins anew there."""

    class Moved(mb.Force):
        """A damper along x between k and an end that moves on l."""

        params = mb.params(damping=("N s/m", "damping"), end=("m", "place of the end"))

        def dissipation(self, k: Any, l: Any) -> Any:
            return self.damping * (l.v @ k.x - rate(self.end)) ** 2 / 2

    end = mb.table([0, 1, 3], [0, 1, -1])
    s = mb.Scene("moved")
    body = s.rigid_body("m", 2.0, (1, 1, 1), at=(0, 0, 0))
    s.prismatic("p", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0))
    s.add(Moved("d", s.ground, body, at=(0, 0, 0), damping=4.0, end=end))
    line = s.system().timeline(0.0, 3.0, 1e-4)
    np.testing.assert_array_equal(line.breaks, [1.0])
    r = s.simulate(3.0, accuracy=1e-7)
    v = 1 - np.exp(-2.0)
    assert abs(r["m"].velocity[-1, 0] - (-1 + (v + 1) * np.exp(-4.0))) < 1e-6


# ---- files -----------------------------------------------------------------------------------------------------------------


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("sign", [",", ";", "\t", "  "])
def test_a_file_with_names_and_units(sign: str, tmp_path: Path) -> None:
    rows = [["t [s]", "F [N]", "M"], *([str(x), str(x * x), "0"] for x in range(4))]
    text = "# measured\n" + "\n".join(sign.join(row) for row in rows)
    file = written(tmp_path / "load.csv", text)
    for name in ("F", "F [N]"):
        e = timed.expression(mb.read_table(file, "t", name, kind="linear"))
        np.testing.assert_allclose(timed.values(e, np.array([0.5, 2.5])), [0.5, 6.5])
    assert mb.read_table(str(file), "t", "F", unit="N") == mb.read_table(file, "t", "F")
    assert timed.values(timed.expression(mb.read_table(file, "t", "F", kind="step")), np.array([2.5]))[0] == 4.0


def test_units_that_are_known_are_converted(tmp_path: Path) -> None:
    """Times to s, values to the unit that is asked for; a unit that is asked for as it is stated changes nothing."""
    file = written(tmp_path / "road.csv", "t [ms],z [mm],phi [deg],F [kN]\n0,0,0,1\n500,40,180,3\n")
    for name, unit, wanted in (("z", "m", 0.02), ("phi", "rad", np.pi / 2), ("F", "N", 2000.0), ("z", "mm", 20.0)):
        e = timed.expression(mb.read_table(file, "t", name, unit=unit))
        assert timed.values(e, np.array([0.25]))[0] == pytest.approx(wanted, rel=1e-12)


BAD_FILES = [
    ("t,F\n0,1\n1,2\n", ("t", "G"), {}, "has no column 'G'; give one of its columns 't', 'F'"),
    ("t,F,F [N]\n0,1,2\n1,2,3\n", ("t", "F"), {}, "has several columns 'F'"),
    ("t [days],F\n0,1\n1,2\n", ("t", "F"), {}, "t \\[days\\]'.* is in 'days', .*; give times in s, ms, us, min, h"),
    ("t,F [mm]\n0,1\n1,2\n", ("t", "F"), {"unit": "N"}, "F \\[mm\\]'.* is in 'mm', which cannot be converted to unit='N'"),
    ("t,F [kN]\n0,1\n1,2\n", ("t", "F"), {}, "is in 'kN'; give unit='N' to have it converted, or unit='kN' to take"),
    ("t,F\n0,1\n1,2\n", ("t", "F"), {"unit": "N"}, "column 'F'.* states no unit"),
    ("t,F\n0,1\n1,x\n", ("t", "F"), {}, "line 3, column 'F': 'x' is no number"),
    ("t,F\n0,1\n1\n", ("t", "F"), {}, "line 3, column 'F': the entry is missing"),
    ("t,F\n0,1\n1,nan\n", ("t", "F"), {}, "columns 't' \\(t\\) and 'F' \\(values\\): values\\[1\\] is not a finite number"),
    ("t,F\n0,1\n-1,2\n", ("t", "F"), {}, "not in rising order"), ("t,F\n0,1\n", ("t", "F"), {}, "a table of 1 point"),
    ("", ("t", "F"), {}, "is empty"), ("t,F\n0,1\n1,2\n", ("t", "F"), {"kind": "quintic"}, "'quintic' is not one of"),
]


@pytest.mark.parametrize(("text", "names", "options", "words"), BAD_FILES)
def test_bad_files(text: str, names: Any, options: Any, words: str, tmp_path: Path) -> None:
    file = written(tmp_path / "load.csv", text)
    with pytest.raises(mb.OptionError, match=words) as refused:
        mb.read_table(file, *names, **options)
    assert "load.csv" in str(refused.value)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(mb.OptionError, match=r"no.csv' cannot be read: No such file"):
        mb.read_table(tmp_path / "no.csv", "t", "F")
    with pytest.raises(mb.OptionError, match="file = 3 is not a path"):
        mb.read_table(3, "t", "F")


UNTIL_1 = mb.table([0, 1], [0, 1], outside="error")


@pytest.mark.parametrize(("force", "way"), [
    (sp.Piecewise((UNTIL_1, mb.t < 1), (2, True)), 1 / 6 + 0.5 + 1),
    (sp.Piecewise((UNTIL_1, mb.t <= 1), (2, True)), 1 / 6 + 0.5 + 1),
    (sp.Piecewise((0, mb.t < 1), (UNTIL_1.subs(mb.t, mb.t - 1), True)), 1 / 6),
    (sp.Piecewise((UNTIL_1.subs(mb.t, mb.t - 0.5), sp.And(mb.t > 0.5, mb.t < 1.5)), (0, True)), 1 / 6 + 0.25),
    (sp.Piecewise((sp.Piecewise((UNTIL_1, mb.t < 0.5), (1, True)), mb.t < 1.5), (0, True)), None),
])
def test_a_table_with_an_end_is_read_where_its_case_holds(force, way):
    s = mb.Scene("block")
    block = s.point_mass("b", 1.0, at=(0, 0))
    s.force("F", block, (force, 0, 0))
    end = s.simulate(2.0, accuracy=1e-9)["b"].position[-1, 0]
    v, x = 0.125, 0.125 / 6  # of the last: 0.5 t^2 until 0.5 s, then 1 N until 1.5 s
    assert end == pytest.approx(way if way is not None else x + v + 0.5 + (v + 1) * 0.5, abs=1e-9)


@pytest.mark.parametrize(("force", "read"), [
    (UNTIL_1, "from 0 to 2 s"), (sp.Piecewise((UNTIL_1, mb.t < 1.2), (2, True)), "from 0 to 1.2 s"),
    (sp.Piecewise((0, mb.t < 0.5), (UNTIL_1, True)), "from 0.5 to 2 s"), (sp.Max(UNTIL_1, 3), "from 0 to 2 s"),
])
def test_a_table_with_an_end_is_refused_where_it_is_read_beyond(force, read):
    s = mb.Scene("block")
    block = s.point_mass("b", 1.0, at=(0, 0))
    with pytest.raises(mb.OptionError, match=f"reads it {read}"):
        s.simulate(2.0, record=[force > 0.5])
    s.force("F", block, (force, 0, 0))
    with pytest.raises(mb.SceneError, match=f"reads it {read}"):
        s.simulate(2.0)
