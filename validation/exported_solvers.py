"""Every solver the package exports, and those of `own_methods.CONTRIBUTED`: what tests and claims hold to one contract."""

from __future__ import annotations

from dataclasses import fields, replace
from inspect import isabstract
from typing import Any

import numpy as np
from dae_problems import AsInternalStates
from own_methods import CONTRIBUTED

import mbdae as mb
from mbdae.errors import SolverError
from mbdae.integrators.base import Solver
from mbdae.integrators.solution import Outputs, Solution

_EXPORTED = [getattr(mb, name) for name in mb.__all__]
_METHODS = [found for found in _EXPORTED if isinstance(found, type) and issubclass(found, Solver) and not isabstract(found)]
VARIANTS = [variant for method in _METHODS for variant in method.variants()]
ALL = VARIANTS + CONTRIBUTED


def _ready(solver: Any) -> list[Any]:
    """A solver with a tolerance, and with a constant step where it has that option."""
    adaptive = [] if solver.by_steps else [replace(solver, rtol=1e-6)]
    return adaptive + ([replace(solver, step=0.01)] if "step" in {f.name for f in fields(solver)} else [])


READY = [solver for variant in ALL for solver in _ready(variant)]


class _Inner:
    """The interpolant of the internal states alone, without position and velocity of the body."""

    def __init__(self, interpolant: Any) -> None:
        self.value, self.derivative = (lambda t, f=f: f(t)[:, 2:] for f in (interpolant.value, interpolant.derivative))


def _trimmed(s: Any) -> Any:
    outputs = None if s.outputs is None else Outputs(s.outputs.t, s.outputs.y[:, 2:], s.outputs.yp[:, 2:])
    return replace(s, y=s.y[:, 2:], yp=s.yp[:, 2:], names=s.names[2:], outputs=outputs, interpolant=_Inner(s.interpolant))


def solve(solver: Any, system: Any, *arguments: Any, **options: Any) -> Any:
    """solver.solve of first-order equations; methods for equations of motion alone get them as internal states."""
    if not solver.by_steps or solver.highest_index == 0:
        return solver.solve(system, *arguments, **options)
    try:
        return _trimmed(solver.solve(AsInternalStates(system), *arguments, **options))
    except SolverError as error:
        if isinstance(error.solution, Solution) and np.size(error.solution.y):
            error.solution = _trimmed(error.solution)
        raise
