"""IDA of SUNDIALS (variable-order BDF) for systems of index at most 1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mbdae.errors import OptionError, SolverError
from mbdae.integrators.base import Solver, set_tolerances
from mbdae.integrators.constant import SINGULAR
from mbdae.integrators.dense import Hermite
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.matrices.iteration import as_csc
from mbdae.integrators.solution import Interpolant
from mbdae.integrators.sundials.shared import SundialsRun
from mbdae.native import sundials as native
from mbdae.native.equations import equations_of
from mbdae.system.base import Array, System
from mbdae.ties import largest
from mbdae.values import set_option, whole

#: number of neighbouring ends of steps that a polynomial of the interpolant goes through. With 4 it has no correct digit where
#: the length of the step jumps (at the start, in the last step); 2 have no advantage
POINTS = 3
#: IDA with an order above 2 and rtol of LOOSE or more is refused where the fastest vibration of a beam passes through more than
#: FAST (rad) in the motion's characteristic time: orders above 2 excite faster vibrations, which they do not resolve. Measured
#: without the refusal: errors of 0.1 to 0.5 without a warning at rtol 1e-3; an error of 2e-3, or a run that does not end, at
#: 1e-4; a run that does not end at 1e-5
FAST, LOOSE = 2000.0, 1e-5


@dataclass(frozen=True)
class IDA(Solver):
    """Variable-order, variable-step BDF; every step is stored, outputs come from the interpolant.

    rtol       tolerance of the local error relative to each unknown (and to its scale, unless atol is given);
               the global error is typically 5 to 400 times larger
    atol       None, one number, or (n,)
    max_order  1 to 5; orders above 2 feed energy into lightly damped modes
    """

    rtol: float | None = None
    atol: Any = None
    max_order: int = 5

    #: names of methods in other programs -> the name of their counterpart here
    counterparts: ClassVar[dict[str, str]] = dict.fromkeys(("bdf", "dassl", "daspk", "ddaspk", "ode15i"), "ida")
    factors: ClassVar[dict[str, dict[str, float]]] = {"IDA": {"GGL": 2e-3, "ODE": 5e-3, "DAE": 2e-3}}
    error_fall: ClassVar[float] = 0.4  # small, since errors of variable-order runs at similar rtol differ by a factor of 5
    companion: ClassVar[float] = 30.0
    tightest: ClassVar[dict[str, float]] = {"": 1e-13}

    def __post_init__(self) -> None:
        set_tolerances(self)
        set_option(self, "max_order", whole, "BDF has orders 1 to 5", least=1, most=5)

    @property
    def bdf_order(self) -> int:
        """Highest order of its formulas."""
        return self.max_order

    def check(self, system: System) -> None:
        """Raise OptionError for an index above 1, and for loose tolerances with stiff beams."""
        highest = int(np.max(system.index))
        if highest > 1:
            worst = system.names[int(np.argmax(system.index))]
            raise OptionError(f"unknown {worst} has index {highest}: IDA takes index 1, above it its error test fails, or "
                              "passes silently with a wrong answer; use mb.RadauIIA(3) or, for a scene, "
                              "form=mb.GGL(algebraic=False)")  # fmt: skip
        if self.max_order > 2 and self.tolerance >= LOOSE and system.vibration is not None:
            name, angle = system.vibration()
            if angle > FAST:
                raise OptionError(f"beam '{name}' vibrates by {angle:.1e} rad of phase in the characteristic time of the motion, "
                                  f"too fast for IDA with rtol = {self.tolerance:g} and max_order = {self.max_order}, which ends "
                                  "silently with a wrong answer; use mb.RadauIIA(3), or max_order=2 and compare with a smaller "
                                  "rtol")  # fmt: skip

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0 to loop.t_end."""
        _Run(self, loop, h0).steps()

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Dense output: Hermite interpolation over neighbouring steps."""
        return Hermite(t, y, yp, POINTS)


class _Run(SundialsRun):
    """A run with IDA, which calls the residual and its Jacobian."""

    def create(self) -> native.Method:
        system, order, start = self.system, self.solver.max_order, (self.loop.t, *self.loop.state)
        sparse = system.sparse
        return native.Ida(equations_of(system), self.settings(order), start, sparse=sparse,
                          pattern=system.sparsity if sparse else system.pattern, differences=system.differences,
                          relaxing=self.watch is None)  # fmt: skip

    def diagnosis(self, reason: str) -> SolverError:
        last, correction = self.last, self._newton_correction()
        weights = 1 / self.tolerance(last.y)
        if correction is None:
            worst = largest(np.abs(last.values))
            return self.loop.failure(f"{reason}; {SINGULAR}", self.system.equations[worst])
        if np.max(np.abs(correction) * weights) < 1.0:  # Newton's method converges, so the error test failed
            y, yp = self.loop.state
            correction = last.y - y - (last.t - self.loop.t) * yp
        text = f"{reason}; see whether a force jumps or grows without bound there, or use mb.RadauIIA(3)"
        return self.loop.failure(text, self.system.names[largest(np.abs(correction) * weights)])

    def _newton_correction(self) -> Array | None:
        """Correction (n,) of one more Newton iteration at the last point that IDA evaluated; None where the iteration matrix is
        singular."""
        system, last = self.system, self.last
        data = np.zeros(system.jacobian_shape)
        system.jacobian(last.t, last.y, last.yp, last.cj, data)
        matrix = data if not system.sparse else as_csc(system, data).toarray()
        if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < system.n:
            return None
        return np.asarray(np.linalg.solve(matrix, last.values))
