"""The price of honesty: work of all runs of a call of `simulate` over that of the run it returns, on the scenes of the examples.

python benchmarks/price.py [--of] [--accuracy 1e-6] [names of examples]; --of: runs are asked for the forces of two joints.
Work is the number of evaluations of the equations, of their Jacobians, and of factorizations. The bars: 1.8 in the median and 3
at most, with `of=` 4.5 at most."""

from __future__ import annotations

import argparse
import importlib
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import mbdae as mb
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Stats

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.py"))
FORCES = 2  #: number of joint forces that a run is asked for
WALL = 300.0  #: of a call, s


def work(stats: Stats) -> int:
    """Evaluations of the equations and of their derivatives, and factorizations."""
    return stats.residuals + stats.jacobians + stats.factorisations


@dataclass
class Run:
    """One run inside a call: its method, its tolerance or step, the equations, its end (s), whether it got there, its work."""

    solver: Any
    equations: str
    end: float
    complete: bool
    work: int

    def __str__(self) -> str:
        size = self.solver.rtol if self.solver.rtol is not None else getattr(self.solver, "step", None)
        failed = "" if self.complete else " failed"
        return f"{self.solver.label} {self.equations} {size or 0.0:.1e} to {self.end:.3g} s{failed}: {self.work}"


@dataclass
class Price:
    """Work of all runs of a call over that of the run returned."""

    name: str
    accuracy: float
    of: tuple[str, ...]
    kept: int
    runs: list[Run] = field(default_factory=list)
    result: Any = None

    @property
    def ratio(self) -> float:
        """The price."""
        return sum(run.work for run in self.runs) / max(self.kept, 1)

    def __str__(self) -> str:
        asked = f" of {', '.join(self.of)}" if self.of else ""
        made = "; ".join(map(str, self.runs))
        return f"{self.name} at {self.accuracy:.0e}{asked}: {self.ratio:.2f}, kept {self.kept} of {made}"


@contextmanager
def counted() -> Iterator[list[Run]]:
    """Context that notes every run of a method made in it."""
    made: list[Run] = []
    plain = Solver.run

    def run(self: Solver, system: Any, asked: Any) -> Any:
        solution = None
        try:
            solution = plain(self, system, asked)
            return solution
        except mb.SolverError as error:
            solution = error.solution
            raise
        finally:
            if solution is not None and hasattr(solution, "stats"):
                reached = bool(solution.t[-1] >= asked.t_end)
                made.append(Run(self, system.label, float(solution.t[-1]), reached, work(solution.stats)))

    Solver.run = run  # type: ignore[method-assign]
    try:
        yield made
    finally:
        Solver.run = plain  # type: ignore[method-assign]


def price(name: str, accuracy: float, asked_too: bool) -> Price | None:
    """The price of a call on the scene of an example; None where the scene has no joint force to ask for, or the call stops."""
    if str(EXAMPLES) not in sys.path:
        sys.path.insert(0, str(EXAMPLES))
    example = importlib.import_module(name)
    try:
        scene = example.scene()
    except ImportError:  # of a package that is not there
        return None
    of = tuple(f"{joint.name}.force" for joint in scene.joints)[:FORCES] if asked_too else ()
    if asked_too and not of:
        return None
    with warnings.catch_warnings(), counted() as runs:
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        try:
            r = scene.simulate(example.t_end, accuracy, max_wall=WALL, **({"of": list(of)} if of else {}))
        except mb.MbdaeError:
            return None
        return Price(name, accuracy, of, work(r.stats), list(runs), r)


def main() -> None:
    """Print the price of every example, the median and the dearest."""
    parser = argparse.ArgumentParser(description="work of a call over that of the run it returns")
    parser.add_argument("--of", action="store_true", help="ask for the forces of two joints")
    parser.add_argument("--accuracy", type=float, default=1e-6)
    parser.add_argument("names", nargs="*", default=NAMES)
    a = parser.parse_args()
    found = []
    for name in a.names:
        if (one := price(name, a.accuracy, a.of)) is not None:
            print(one, flush=True)
            found.append(one)
    found.sort(key=lambda one: -one.ratio)
    print(f"{len(found)} scenes, median {median(one.ratio for one in found):.2f}, the dearest:")
    for one in found[:10]:
        print(f"{one.ratio:6.2f}  {one.name}")


if __name__ == "__main__":
    main()
