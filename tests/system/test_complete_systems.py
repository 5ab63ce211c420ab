"""A System is complete when its constructor returns: no part of a run assigns its attributes."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
import pytest
import sympy as sp
from overconstrained_scenes import MECHANISMS

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.inputs.resolution import LongestStep
from mbdae.system.base import Array, System
from mbdae.system.prepare import prepare

#: methods that assign the attributes of a System that they make
MAKING = {"__init__", "starting", "strictly", "taking_over", "sampling"}


@pytest.fixture
def wrong(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """What is assigned to a System by functions that are no methods of its class, or to a part of its interface later on."""
    found: list[str] = []

    def assigned(system: System, name: str, value: object) -> None:
        code = sys._getframe(1).f_code
        owner, _, method = code.co_qualname.rpartition(".")
        classes = {(c.__qualname__, sys.modules[c.__module__].__file__) for c in type(system).__mro__ if c is not object}
        own = (owner, code.co_filename) in classes
        if not own or not (name.startswith("_") or method in MAKING):
            found.append(f"{code.co_qualname} sets {name} of a {type(system).__name__}")
        object.__setattr__(system, name, value)

    monkeypatch.setattr(System, "__setattr__", assigned, raising=False)
    yield found
    assert found == []


def driven(load: sp.Expr) -> mb.Scene:
    s = mb.Scene("driven pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), torque=load)
    return s


BROKEN = sp.Piecewise((3.0, mb.t < 0.1), (-2.0, True)) + sp.exp(-(((mb.t - 0.15) / 0.01) ** 2))
RUNS = {
    "GGL, IDA": (mb.GGL(), mb.IDA()), "GGL, Radau": (mb.GGL(), mb.RadauIIA(3)), "Index3": (mb.Index3(), mb.RadauIIA(2)),
    "Index1, CVODE": (mb.Index1(), mb.CVODE()), "constant steps": (mb.Index1(), mb.RadauIIA(3, step=5e-3)),
    "HHT": (mb.GGL(), mb.HHT()), "GeneralizedAlpha": (mb.Index3(), mb.GeneralizedAlpha(step=5e-3)),
}


@pytest.mark.usefixtures("wrong")
@pytest.mark.parametrize("name", RUNS)
def test_breaks_of_inputs_leave_systems_as_they_are(name: str) -> None:
    form, solver = RUNS[name]
    assert driven(BROKEN).simulate(0.2, accuracy=1e-4, form=form, solver=solver).solution.complete


@pytest.mark.usefixtures("wrong")
def test_contacts_default_runs_and_rechecks_leave_systems_as_they_are() -> None:
    driven(BROKEN).simulate(0.2, accuracy=1e-5)
    s = mb.Scene("pin", gravity=(0, -9.81, 0))
    loose = mb.Clearance(0.051, 0.05, mb.Hertz(1e7))
    s.revolute("J", s.ground, s.point_mass("m", 1.0, at=(0, 0)), at=(0, 0), model=loose)
    assert len(s.simulate(0.03, accuracy=1e-3)["J"].contacts) > 0


@pytest.mark.usefixtures("wrong")
@pytest.mark.filterwarnings("ignore::mbdae.errors.AccuracyWarning")
def test_steps_integrated_again_leave_systems_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thrust that no step looks at is found between the points of the run."""
    monkeypatch.setattr("mbdae.system.scene_system.WATCH_INPUTS_AND_SWITCHES", False)
    s = mb.Scene("body")
    thrust = sp.Piecewise((0, mb.t < 6.3), (1, mb.t < 7.3), (0, True))
    s.force("F", s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 0)), (thrust, 0, 0))
    assert any("was not evaluated there" in note for note in s.simulate(20.0, solver=mb.CVODE()).warnings)


@pytest.mark.usefixtures("wrong")
@pytest.mark.parametrize(("form", "solver"), [(mb.GGL(), mb.RadauIIA(2)), (mb.Index1(), mb.CVODE())], ids=["GGL", "Index1"])
def test_other_rows_in_force_leave_systems_as_they_are(form: object, solver: object) -> None:
    r = MECHANISMS["Bennett"].scene(5).simulate(3.0, accuracy=1e-4, form=form, solver=solver)
    assert len(r.solution.systems) > 1


def test_an_attribute_set_from_outside_is_seen(wrong: list[str]) -> None:
    system = driven(BROKEN).system()
    system.t0 = 1.0
    assert [line.rpartition(".")[2] for line in wrong] == ["test_an_attribute_set_from_outside_is_seen sets t0 of a SceneSystem"]
    wrong.clear()


def test_another_start_is_a_system_of_its_own() -> None:
    """It shares the equations; the first one keeps its start, whatever parts a run had."""
    system = system_for(prepare(driven(BROKEN)))
    begun = system.t0, system.y0.copy(), system.yp0.copy()
    other = system.starting(0.5, system.y0 + 0.1, system.yp0, LongestStep(np.array([0.0, 0.01])))
    out = np.zeros((2, system.n))
    for one, row in zip((system, other), out, strict=True):
        one.residual(0.3, system.y0, system.yp0, row)
    assert np.array_equal(*out)
    assert other.longest_step is not None
    assert (other.t0, other.longest_step(0.0)) == (0.5, 0.01)
    mb.RadauIIA(3, rtol=1e-5).solve(system, 0.2)
    assert (system.t0, system.longest_step) == (begun[0], None)
    assert np.array_equal([system.y0, system.yp0], begun[1:])


def test_solvers_read_the_start_of_their_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every part begins at a break, with values that satisfy the equations there."""
    seen: list[tuple[float, Array]] = []
    plain = mb.RadauIIA.integrate

    def integrate(self: mb.RadauIIA, system: System, loop: object, h0: float | None) -> None:
        out = np.empty(system.n)
        system.residual(system.t0, system.y0, system.yp0, out)
        seen.append((system.t0, out))
        plain(self, system, loop, h0)  # type: ignore[arg-type]

    monkeypatch.setattr(mb.RadauIIA, "integrate", integrate)
    mb.RadauIIA(3, rtol=1e-6).solve(driven(BROKEN).system(), 0.2)
    assert [t for t, _ in seen] == pytest.approx([0.0, 0.1], abs=1e-12)
    assert np.max(np.abs([off for _, off in seen])) < 1e-8  # the joints hold to the tolerance of the run before
