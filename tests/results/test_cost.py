"""`info.runs` and `info.cpu_s` count every run that a result took: companions, probes, failures, what was not kept."""

from __future__ import annotations

from typing import Any

import pytest

import mbdae as mb
from mbdae.integrators.base import Solver

STEEL = mb.Section.circular(0.01, E=2e11, nu=0.3, rho=7800)


def beam() -> mb.Scene:
    s = mb.Scene("beam", gravity=(0, -9.81, 0))
    s.revolute("h", s.ground, s.beam("b", (0, 0), (1, 0), section=STEEL, elements=2), at=(0, 0))
    return s


def pendulum(**options: Any) -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("h", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), **options)
    return s


def flat_four_bar() -> mb.Scene:
    """Equally long bars: multipliers can be eliminated until all bars lie in one line, where Radau IIA takes over."""
    s = mb.Scene("rhombus", gravity=(0, -9.81, 0))
    A, B, C, D = (0, 0), (0, 1), (1, 1), (1, 0)
    for name, a, b in (("crank", A, B), ("coupler", B, C), ("rocker", C, D)):
        s.link(name, a, b, mass=1.0)
    s.revolute("A", s.ground, "crank", at=A, rate0=1.0)
    s.revolute("B", "crank", "coupler", at=B)
    s.revolute("C", "coupler", "rocker", at=C)
    s.revolute("D", s.ground, "rocker", at=D)
    return s


CASES = {
    "vibrations left out by long steps": (beam, {"t_end": 0.3, "accuracy": 1e-4}),
    "vibrations at a loose accuracy": (beam, {"t_end": 0.1, "accuracy": 1e-3}),
    "constant steps": (pendulum, {"t_end": 0.5, "accuracy": 1e-3, "solver": mb.HHT()}),
    "a second method": (pendulum, {"t_end": 0.5, "accuracy": 1e-5, "verify": True}),
    "a method that stops": (flat_four_bar, {"t_end": 1.5, "accuracy": 1e-8}),
}


@pytest.mark.parametrize("case", sorted(CASES))
@pytest.mark.filterwarnings("ignore::mbdae.AccuracyWarning")
def test_all_runs_are_counted(case: str, monkeypatch: Any) -> None:
    scene, options = CASES[case]
    spent: list[float] = []
    inside: list[None] = []  # a method may call the general one

    def counted(method: Any) -> Any:
        def run(*args: Any, **given: Any) -> Any:
            inside.append(None)
            solution = None
            try:
                solution = method(*args, **given)
            except mb.SolverError as error:
                solution = error.solution
                raise
            finally:
                inside.pop()
                if not inside:
                    spent.append(solution.stats.cpu_s if solution is not None else 0.0)
            return solution

        return run

    for cls in (Solver, next(cls for cls in mb.HHT.__mro__ if "run" in vars(cls))):
        monkeypatch.setattr(cls, "run", counted(vars(cls)["run"]))
    info = scene().simulate(**options).info
    assert len(spent) >= 3
    assert info.runs == len(spent)
    assert info.cpu_s >= sum(spent) * (1 - 1e-12)  # what runs are compared and looked at for comes on top
