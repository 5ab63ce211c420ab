"""Other programs as columns of a comparison: what they converge to, what they cannot state, exporters that state another one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy

import mbdae as mb
from mbdae.compare.problem import new_problem
from mbdae.engines import Case, Engine, Method, Statement, converged, engines_of, fixed_steps
from mbdae.engines.scipy import SciPy

SWING = 0.4  # s


def pendulum(mass: float = 1.0, **more: Any) -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0), **more)
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=mass), at=(0, 0), rate0=1.0)
    return s


def compared(s: Any, engine: Any, t_end: float = SWING, **options: Any) -> Any:
    return mb.compare(s, t_end, [mb.RadauIIA(3)], [1e-6], engines=engine, **options)


def of_engine(w: Any, method: str = "") -> list[Any]:
    return [row for row in w.runs if row.engine and method in row.label]


def test_scipy_converges_on_the_exported_equations() -> None:
    w = compared(pendulum(), ["scipy"])
    assert {row.solver for row in of_engine(w)} == {"DOP853", "Radau", "LSODA"}
    for one in w.converged:
        assert (one.error or 1.0) < 1e-7, one
        assert ("converges" in one.text, one.text in w.decision) == (True, True)
    errors = [row.error for row in of_engine(w, "DOP853") if row.error is not None]
    assert errors[0] > 100 * errors[-1]
    assert all(row.errors["energy"] < 1.0 for row in of_engine(w) if row.errors)
    assert "joint forces" not in of_engine(w)[0].errors  # a program gives its motion


def test_a_sensor_is_read_from_the_motion_of_an_engine() -> None:
    w = compared(pendulum(), ["scipy"], measure=["hinge.angle", "hinge.force"])
    assert min(row.error for row in of_engine(w) if row.error is not None) < 1e-7
    assert {name for row in of_engine(w) for name in row.errors} == {"hinge.angle"}


@pytest.mark.slow
@pytest.mark.parametrize("scene", [
    lambda: loop(), lambda: mixed(), lambda: beam()], ids=["four-bar", "spatial with a ball and a slider", "beam"])
def test_scenes_that_scipy_states(scene: Any) -> None:
    w = compared(scene(), ["scipy"], 0.1)
    assert not [row for row in of_engine(w) if row.failure]
    assert all((one.error or 1.0) < 1e-6 for one in w.converged), w.decision


def loop() -> mb.Scene:
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    points = [(0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)]
    links = [s.link(f"link{i}", points[i], points[i + 1], mass=0.5) for i in range(3)]
    for name, k, l, at in zip("ABCD", (s.ground, *links), (*links, s.ground), points, strict=True):
        s.revolute(name, k, l, at=at)
    return s


def mixed() -> mb.Scene:
    s = mb.Scene("mixed", gravity=(0, 0, -9.81))
    one = s.rigid_body("one", 2.0, (0.1, 0.2, 0.15), at=(0, 0, -0.5), angular_velocity=(1, 0.5, 0.2), velocity=(-0.25, 0.5, 0))
    s.spherical("ball", s.ground, one, at=(0, 0, 0))
    two = s.rigid_body("two", 1.0, (0.1, 0.1, 0.1), at=(0.5, 0, -1))
    s.prismatic("slide", one, two, at=(0, 0, -1), axis=(1, 0, 0), spring=50.0)
    return s


def beam(order: int = 1) -> mb.Scene:
    s = mb.Scene("beam", gravity=(0, -9.81, 0))
    one = s.beam("beam", (0, 0), (1, 0), section=mb.Section(EA=1e4, GA2=1e4, GA3=1e4, GJ=50, EI2=50, EI3=50, mass_per_length=1.0,
                                                      rotary_inertia=0.1), elements=2, order=order)
    s.revolute("root", s.ground, one, at=(0, 0), rate0=1.0)
    return s


@pytest.mark.parametrize("angle", [3 * mb.t, 3 * mb.t + mb.t**2, sympy.Piecewise((0, mb.t < 0), (mb.t, True))], ids=str)
def test_prescribed_joints_of_trees_are_part_of_the_start_of_scipy(angle: Any) -> None:
    s = mb.Scene("carousel", gravity=(0, -9.81, 0))
    a, b = s.rigid_body("a", 2.0, 0.05, at=(0.05, 0)), s.rigid_body("b", 1.0, 0.02, at=(0.6, 0.1))
    s.revolute("A", s.ground, a, at=(0, 0), angle=angle)
    s.revolute("B", a, b, at=(0.5, 0))
    assert not [row.failure for row in of_engine(compared(s, ["scipy"], 0.1)) if row.failure]


def test_engines_are_asked_once_and_an_interpreter_is_a_python() -> None:
    assert len(engines_of(["scipy", "scipy"])) == 1
    with pytest.raises(mb.OptionError, match="does not run"):
        engines_of({"scipy": "true"})


class Refuses(Engine):
    name, package = "refuses", "numpy"

    def state(self, case: Case) -> Statement:
        raise mb.SceneError(["joint 'hinge': a hinge is not known here"])


class Fails(Engine):
    """Its process ends when it is asked anything."""

    name, package = "fails", "numpy"

    def state(self, case: Case) -> Statement:
        return Statement("raise SystemExit('no licence')", {}, (Method("method", "step", fixed_steps(case)),))


@pytest.mark.parametrize(("engine", "said"), [
    (Refuses, "cannot state: joint 'hinge': a hinge is not known here"), (Fails, "its process ended with code 1: no licence")])
def test_what_an_engine_cannot_do_stands_in_its_row(engine: type[Engine], said: str) -> None:
    w = compared(pendulum(), [engine])
    assert of_engine(w)[0].failure == said
    assert said in w.decision
    assert said in str(w)


HANGS = """
import json, sys, time
for line in sys.stdin:
    if json.loads(line)["do"] == "run":
        time.sleep(60)
    print("{}", flush=True)
"""


class Hangs(Engine):
    """It runs, and does not end."""

    name, package = "hangs", "numpy"

    def state(self, case: Case) -> Statement:
        return Statement(HANGS, {}, (Method("method", "step", fixed_steps(case)),))


@pytest.mark.slow
def test_a_ladder_ends_behind_a_run_that_does_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["mbdae.compare.engines"], "STARTS", 3.0)
    first, *others = of_engine(compared(pendulum(), [Hangs], max_wall=0.5))
    assert first.failure == "gave up after 0.5 s of wall time"
    assert others
    assert all(row.skipped == "not run: a run before gave up after 0.5 s of wall time" for row in others)


class Short(SciPy):
    """It leaves out the velocities."""

    name = "short"

    def motion(self, case: Case, values: Any) -> Any:
        return super().motion(case, values)[..., :7]

    def start(self, case: Case, told: Any) -> Any:
        return {"mass": told["mass"]}


def test_a_motion_of_another_shape_fails() -> None:
    (first, *_) = of_engine(compared(pendulum(), [Short]))
    assert first.failure == "its motion is an array (1025, 1, 7), not (1 + 1024 / k, 1, 13)"


def test_contacts_are_no_exported_equations() -> None:
    s = mb.Scene("stopped", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0), limits=(-1.0, 1.0), stop=mb.Stop(1e4))
    assert "cannot state: contacts" in of_engine(compared(s, ["scipy"]))[0].failure


# -- exporters that state another scene: found by what is compared, which knows nothing of what is wrong


class Mutant(SciPy):
    """States the scene that `make` returns for it."""

    make: Any

    def state(self, case: Case) -> Statement:
        return super().state(self.other(case))

    def motion(self, case: Case, values: Any) -> Any:
        return super().motion(self.other(case), values)

    def other(self, case: Case) -> Case:
        return Case(type(self).make(), case.prepared, case.times)


def arm(mass: float = 1.0, axis: Any = (0, 0, 1), rate: float = 1.0, damper: float = 0.1, at: float = 0.7) -> mb.Scene:
    s = mb.Scene("arm", gravity=(0, -9.81, 0), space="spatial")
    one = s.link("one", (0, 0, 0), (0.5, 0, 0), mass=1.0)
    two = s.rigid_body("two", mass, (0.05, 0.05, 0.05), at=(at, 0, 0.1))
    s.revolute("A", s.ground, one, at=(0, 0, 0), axis=(0, 0, 1), rate0=rate)
    s.revolute("B", one, two, at=(0.5, 0, 0), axis=axis, damper=damper)
    return s


@pytest.mark.parametrize(("wrong", "said"), [
    ({"mass": 1.1}, "mass of 'two'"), ({"rate": 1.01}, "velocity of 'two'"), ({"axis": (0, 0.02, 1)}, "acceleration of 'two'"),
    ({"damper": 0.11}, "does not converge")], ids=["mass", "start", "axis", "damper"])
def test_a_wrong_exporter_is_found(wrong: dict[str, Any], said: str) -> None:
    engine = type("Wrong", (Mutant,), {"name": "wrong", "make": staticmethod(lambda: arm(**wrong))})
    for one in compared(arm(), [engine]).converged:
        assert said in one.text
        assert said == "does not converge" or "states another scene" in one.text


def test_the_same_exporter_without_a_mistake_is_not() -> None:
    right = type("Right", (Mutant,), {"name": "right", "make": staticmethod(arm)})
    assert all("converges" in one.text for one in compared(arm(), [right]).converged)


# -- programs that may be missing

#: interpreters of environments that have the programs
PYTHONS = {name: os.environ.get(f"{name.upper()}_PYTHON") or (sys.executable if find_spec(name) else None)
           for name in ("exudyn", "mujoco")}


def needs(name: str) -> Any:
    return pytest.mark.skipif(PYTHONS[name] is None, reason=f"{name} is not installed: name an interpreter that has it in "
                              f"{name.upper()}_PYTHON")


def sliding() -> mb.Scene:
    s = mb.Scene("slider", gravity=(0, -9.81, 0))
    crank, rod = s.link("crank", (0, 0), (0.1, 0.2), mass=1.0), s.link("rod", (0.1, 0.2), (0.6, 0.1), mass=1.0)
    block = s.rigid_body("block", 2.0, 0.1, at=(0.6, 0.1))
    s.revolute("A", s.ground, crank, at=(0, 0), spring=3.0, damper=0.2, torque=sympy.cos(5 * mb.t))
    s.revolute("B", crank, rod, at=(0.1, 0.2))
    s.revolute("C", rod, block, at=(0.6, 0.1))
    s.prismatic("D", s.ground, block, at=(0.6, 0.1), axis=(1, 0, 0), spring=20.0, damper=0.5)
    s.spring("S", s.ground, rod, (0, 1), (0.3, 0.16), stiffness=30.0, damping=1.0, length=0.5)
    return s


def driven() -> mb.Scene:
    s = mb.Scene("driven", gravity=(0, 0, -9.81))
    one, two = s.link("one", (0, 0, 0), (0.5, 0, 0), mass=1.0), s.link("two", (0.5, 0, 0), (0.5, 0, 0.4), mass=0.5)
    s.revolute("A", s.ground, one, at=(0, 0, 0), axis=(0, 0, 1), angle=2 * mb.t + mb.t**3)
    s.revolute("B", one, two, at=(0.5, 0, 0), axis=(1, 0, 0), damper=0.02, spring=0.3)
    s.force("F", two, (0.5, sympy.sin(3 * mb.t), 0), at=(0.5, 0, 0.4))
    return s


@needs("exudyn")
@pytest.mark.slow
@pytest.mark.parametrize("scene", [pendulum, loop, sliding, mixed, driven, beam], ids=lambda make: make.__name__)
def test_exudyn_converges_with_its_orders(scene: Any) -> None:
    w = compared(scene(), {"exudyn": PYTHONS["exudyn"]}, 0.2)
    found = {one.label.split(" ", 2)[2]: one for one in w.converged}
    assert "generalised-alpha, radius 0.8" in found
    for method, one in found.items():
        assert one.error is not None, one.text
        assert one.floor is None or one.floor < 1e-7, one.text
        if method.endswith(("alpha", "0.8", "2", "group")):
            assert one.order == pytest.approx(2.0, abs=0.3), one.text
        else:
            assert one.error < 1e-6, one.text


@needs("exudyn")
@pytest.mark.slow
@pytest.mark.parametrize(("wrong", "said"), [
    ({"mass": 1.1}, "mass of 'two'"), ({"rate": 1.01}, "velocity of 'two'"), ({"axis": (0, 0.02, 1)}, "does not converge"),
    ({"damper": 0.11}, "does not converge")], ids=["mass", "start", "axis", "damper"])
def test_a_wrong_exporter_to_exudyn_is_found(wrong: dict[str, Any], said: str) -> None:
    from mbdae.engines.exudyn import Exudyn

    class Wrong(Exudyn):
        def state(self, case: Case) -> Statement:
            other = arm(**wrong)
            return super().state(Case(other, new_problem(other, SWING, None, None).yardstick.prepared, case.times))

    found = compared(arm(), {Wrong: PYTHONS["exudyn"]}).converged
    assert found
    assert all(said in one.text for one in found), [one.text for one in found]


@needs("exudyn")
def test_what_exudyn_cannot_state() -> None:
    s = mb.Scene("screw", gravity=(0, 0, -9.81))
    s.screw("thread", s.ground, s.rigid_body("nut", 1.0, (1, 1, 1), at=(0, 0, 0)), at=(0, 0, 0), axis=(0, 0, 1), lead=0.1)
    (row,) = of_engine(compared(s, {"exudyn": PYTHONS["exudyn"]}))
    assert row.failure == "cannot state: joint 'thread': Screw"


def top() -> mb.Scene:
    s = mb.Scene("top", gravity=(0, 0, -9.81))
    s.spherical("tip", s.ground, s.rigid_body("top", 1.0, (0.1, 0.1, 0.05), at=(0, 0.3, 0), angular_velocity=(0, 20, 1),
                                              velocity=(-0.3, 0, 0)), at=(0, 0, 0))
    return s


@needs("mujoco")
@pytest.mark.slow
@pytest.mark.parametrize("scene", [pendulum, mixed, top], ids=lambda make: make.__name__)
def test_mujoco_converges_on_trees_with_its_orders(scene: Any) -> None:
    w = compared(scene(), {"mujoco": PYTHONS["mujoco"]}, 0.2)
    found = {one.label.split(" ", 2)[2]: one for one in w.converged}
    for method, order in {"Euler": 1.0, "implicitfast": 1.0, "RK4": 4.0}.items():
        measured = found[method].order  # None: one run only is above what is known of the reference
        assert measured == pytest.approx(order, abs=0.3) or (measured is None and method == "RK4"), found[method].text
    assert found["RK4"].error < 1e-7


@needs("mujoco")
@pytest.mark.slow
def test_what_keeps_mujoco_off_a_loop_is_named_with_the_error_that_stays() -> None:
    found = {one.label.split(" ", 2)[2]: one for one in compared(loop(), {"mujoco": PYTHONS["mujoco"]}).converged}
    assert "does not converge, because of its soft constraints (loops); its error stays at" in found["RK4"].text
    assert found["RK4"].floor > 1e-4


@needs("mujoco")
def test_dry_friction_of_mujoco_is_softer_than_that_of_the_scene_which_is_said() -> None:
    s = mb.Scene("rubbed", gravity=(0, -9.81, 0))
    a = s.rigid_body("a", 2.0, 0.05, at=(0.3, 0))
    s.revolute("A", s.ground, a, at=(0, 0), friction=mb.Coulomb(0.3, v_c=0.01), radius=0.05, normal_force=20.0, rate0=-1.0)
    rows = of_engine(compared(s, {"mujoco": PYTHONS["mujoco"]}, 0.2))
    assert not [row.failure for row in rows if row.failure]
    assert {row.soft for row in rows} == {"because of its soft constraints (dry friction)"}


@needs("mujoco")
def test_what_mjcf_does_not_say_is_no_row_of_mujoco() -> None:
    (row,) = of_engine(compared(driven(), {"mujoco": PYTHONS["mujoco"]}))
    assert "cannot state: joint 'A': a prescribed motion is not said by MJCF" in row.failure


@needs("mujoco")
@pytest.mark.slow
@pytest.mark.parametrize(("wrong", "said"), [
    ({"mass": 1.1}, "mass of 'two'"), ({"axis": (0, 0.02, 1)}, "acceleration of 'two'"), ({"damper": 0.11}, "does not converge"),
    ({"at": 0.72}, "position of 'two'")], ids=["mass", "axis", "damper", "start"])
def test_a_wrong_exporter_to_mujoco_is_found(wrong: dict[str, Any], said: str) -> None:
    from mbdae.engines.mujoco import MuJoCo

    class Wrong(MuJoCo):
        def state(self, case: Case) -> Statement:
            return super().state(Case(arm(**wrong), case.prepared, case.times))

    found = {one.label.split(" ", 2)[2]: one for one in compared(arm(), {Wrong: PYTHONS["mujoco"]}).converged}
    assert said in found["RK4"].text, found["RK4"].text


# -- what is asked for


@pytest.mark.parametrize(("given", "said"), [
    ({"absent": None}, "there is no engine 'absent'"), ([3], "neither the name of an engine"), (3, "give {"),
    ({"scipy": "/absent/python"}, "'scipy=/absent/python' does not run"), ({"scipy": 3}, "is no interpreter"),
    ([Engine], "neither the name")])
def test_wrong_engines_are_refused_before_anything_is_computed(given: Any, said: str) -> None:
    with pytest.raises(mb.OptionError, match="engines") as error:
        mb.compare(pendulum(), SWING, engines=given)
    assert said in str(error.value)


def test_versions_are_recorded() -> None:
    (one,) = engines_of(["scipy"])
    assert one.python == sys.executable
    assert set(one.versions) == {"scipy", "Python"}
    w = compared(pendulum(), ["scipy"])
    assert all(row.engine == one.label for row in of_engine(w))
    assert json.loads(w.to_json())["runs"][-1]["engine"] == one.label


def test_finished_runs_of_engines_are_not_repeated(tmp_path: Path) -> None:
    path, seen = tmp_path / "kept.json", list[str]()
    first = compared(pendulum(), ["scipy"], resume=path)
    again = compared(pendulum(), ["scipy"], resume=path, progress=lambda done, total, label: seen.append(label))
    assert not seen
    assert again.runs == first.runs
    with pytest.raises(mb.OptionError, match="holds another comparison"):
        compared(pendulum(), [Refuses], resume=path)


def test_a_script_runs_by_itself(tmp_path: Path) -> None:
    """What an exporter writes needs no mbdae: it answers in a folder of its own."""
    from mbdae.compare.engines import write

    problem = new_problem(pendulum(), SWING, None, 60.0)
    assert problem.yardstick.prepared is not None
    write(SciPy().state(Case(problem.scene, problem.yardstick.prepared, problem.times)), tmp_path)
    question = json.dumps({"do": "run", "method": "DOP853", "setting": 1e-8, "out": "y.npy"})
    done = subprocess.run([sys.executable, "-S", "-c", "import runpy, sys; sys.modules['mbdae'] = None\n"
                           f"sys.path += {sys.path!r}\nrunpy.run_path('script.py', run_name='__main__')"],
                          cwd=tmp_path, input=question + "\n", capture_output=True, text=True, check=True)
    assert "seconds" in json.loads(done.stdout)
    assert np.load(tmp_path / "y.npy").shape[0] == 1025


# -- what a ladder comes to


class Made:
    """A row of a ladder."""

    def __init__(self, setting: float, error: float, order: float | None = None, soft: str = "") -> None:
        self.rtol, self.error, self.order, self.soft, self.failure = setting, error, order, soft, None
        self.measured = (error, 1.0)


def test_the_order_of_a_ladder_is_measured() -> None:
    one = converged("x", [Made(2.0**-k, 4.0**-k, 2.0) for k in range(6)], 1e-9)
    assert one.order == pytest.approx(2.0)
    assert "order 2.0 (2 in theory)" in one.text


def test_an_error_that_stays_is_named_with_its_reason() -> None:
    ladder = [Made(2.0**-k, max(4.0**-k, 1e-2), 2.0, "its loops are soft") for k in range(8)]
    plain = [Made(row.rtol, row.error, 2.0) for row in ladder]
    assert "does not converge, though it should: it moves another scene" in converged("x", plain, 1e-9).text
    assert "where its rounding begins" in converged("x", [Made(row.rtol, row.error * 1e-6) for row in plain], 1e-12).text
    assert "other methods of the program reach 1.0e-04" in converged("x", plain, 1e-9, others=1e-4).text
    assert "it moves another scene" in converged("x", plain, 1e-9, others=0.9 * min(row.error for row in plain)).text
    one = converged("x", ladder, 1e-9)
    assert one.floor == 1e-2
    assert "does not converge, its loops are soft; its error stays at 1.0e-02" in one.text
    assert converged("x", ladder, 1e-2).floor is None  # it may be the reference that is off
