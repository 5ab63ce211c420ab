"""The explicit method of order 8 of Dormand and Prince: its estimates of order 5 and 3, and its interpolant of order 7.

Numbers: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed., II.5 and II.6 (method DOP853). Zeros are
left out. `tests/integrators/test_dop853.py` compares them with those of SciPy and measures the orders.

The explicit method of order 8 of Dormand and Prince (DOP853), for smooth systems with a right-hand side.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar

import numpy as np

from mbdae.integrators import radau_table
from mbdae.integrators.base import Solver, absolute_tolerance, set_tolerances
from mbdae.integrators.constant import ROWS, Blocks, check_rates, not_finite
from mbdae.integrators.dense import Collocation, increments_of, inside_of
from mbdae.integrators.loop import StepLoop
from mbdae.integrators.solution import Interpolant
from mbdae.integrators.watch import StepWatch
from mbdae.native.equations import rates_of
from mbdae.native.explicit import Explicit, Method, Steps
from mbdae.system.base import Array, System
from mbdae.values import largest

#: (i, j, a_ij): stage i at y + h sum a_ij k_j; stage 12 is the end of the step, 13 to 15 are for the interpolant
STAGES = (
    (1, 0, 0.05260015195876773), (2, 0, 0.0197250569845379), (2, 1, 0.0591751709536137), (3, 0, 0.02958758547680685),
    (3, 2, 0.08876275643042054), (4, 0, 0.2413651341592667), (4, 2, -0.8845494793282861), (4, 3, 0.924834003261792),
    (5, 0, 0.037037037037037035), (5, 3, 0.17082860872947386), (5, 4, 0.12546768756682242), (6, 0, 0.037109375),
    (6, 3, 0.17025221101954405), (6, 4, 0.06021653898045596), (6, 5, -0.017578125), (7, 0, 0.03709200011850479),
    (7, 3, 0.17038392571223998), (7, 4, 0.10726203044637328), (7, 5, -0.015319437748624402), (7, 6, 0.008273789163814023),
    (8, 0, 0.6241109587160757), (8, 3, -3.3608926294469414), (8, 4, -0.868219346841726), (8, 5, 27.59209969944671),
    (8, 6, 20.154067550477894), (8, 7, -43.48988418106996), (9, 0, 0.47766253643826434), (9, 3, -2.4881146199716677),
    (9, 4, -0.590290826836843), (9, 5, 21.230051448181193), (9, 6, 15.279233632882423), (9, 7, -33.28821096898486),
    (9, 8, -0.020331201708508627), (10, 0, -0.9371424300859873), (10, 3, 5.186372428844064), (10, 4, 1.0914373489967295),
    (10, 5, -8.149787010746927), (10, 6, -18.52006565999696), (10, 7, 22.739487099350505), (10, 8, 2.4936055526796523),
    (10, 9, -3.0467644718982196), (11, 0, 2.273310147516538), (11, 3, -10.53449546673725), (11, 4, -2.0008720582248625),
    (11, 5, -17.9589318631188), (11, 6, 27.94888452941996), (11, 7, -2.8589982771350235), (11, 8, -8.87285693353063),
    (11, 9, 12.360567175794303), (11, 10, 0.6433927460157636), (12, 0, 0.054293734116568765), (12, 5, 4.450312892752409),
    (12, 6, 1.8915178993145003), (12, 7, -5.801203960010585), (12, 8, 0.3111643669578199), (12, 9, -0.1521609496625161),
    (12, 10, 0.20136540080403034), (12, 11, 0.04471061572777259), (13, 0, 0.056167502283047954), (13, 6, 0.25350021021662483),
    (13, 7, -0.2462390374708025), (13, 8, -0.12419142326381637), (13, 9, 0.15329179827876568), (13, 10, 0.00820105229563469),
    (13, 11, 0.007567897660545699), (13, 12, -0.008298), (14, 0, 0.03183464816350214), (14, 5, 0.028300909672366776),
    (14, 6, 0.053541988307438566), (14, 7, -0.05492374857139099), (14, 10, -0.00010834732869724932),
    (14, 11, 0.0003825710908356584), (14, 12, -0.00034046500868740456), (14, 13, 0.1413124436746325),
    (15, 0, -0.42889630158379194), (15, 5, -4.697621415361164), (15, 6, 7.683421196062599), (15, 7, 4.06898981839711),
    (15, 8, 0.3567271874552811), (15, 12, -0.0013990241651590145), (15, 13, 2.9475147891527724), (15, 14, -9.15095847217987),
)
#: (j, e_j): weights of the error estimate by the embedded method of order 3
THIRD = (
    (0, -0.18980075407240762), (5, 4.450312892752409), (6, 1.8915178993145003), (7, -5.801203960010585),
    (8, -0.4226823213237919), (9, -0.1521609496625161), (10, 0.20136540080403034), (11, 0.02265179219836082),
)
#: (j, e_j): weights of the error estimate by the embedded method of order 5
FIFTH = (
    (0, 0.01312004499419488), (5, -1.2251564463762044), (6, -0.4957589496572502), (7, 1.6643771824549864),
    (8, -0.35032884874997366), (9, 0.3341791187130175), (10, 0.08192320648511571), (11, -0.022355307863886294),
)
#: (i, j, d_ij): coefficient 3 + i of the interpolant is h sum d_ij k_j
DENSE = (
    (0, 0, -8.428938276109013), (0, 5, 0.5667149535193777), (0, 6, -3.0689499459498917), (0, 7, 2.38466765651207),
    (0, 8, 2.117034582445028), (0, 9, -0.871391583777973), (0, 10, 2.2404374302607883), (0, 11, 0.6315787787694688),
    (0, 12, -0.08899033645133331), (0, 13, 18.148505520854727), (0, 14, -9.194632392478356), (0, 15, -4.436036387594894),
    (1, 0, 10.427508642579134), (1, 5, 242.28349177525817), (1, 6, 165.20045171727028), (1, 7, -374.5467547226902),
    (1, 8, -22.113666853125306), (1, 9, 7.733432668472264), (1, 10, -30.674084731089398), (1, 11, -9.332130526430229),
    (1, 12, 15.697238121770845), (1, 13, -31.139403219565178), (1, 14, -9.35292435884448), (1, 15, 35.81684148639408),
    (2, 0, 19.985053242002433), (2, 5, -387.0373087493518), (2, 6, -189.17813819516758), (2, 7, 527.8081592054236),
    (2, 8, -11.57390253995963), (2, 9, 6.8812326946963), (2, 10, -1.0006050966910838), (2, 11, 0.7777137798053443),
    (2, 12, -2.778205752353508), (2, 13, -60.19669523126412), (2, 14, 84.32040550667716), (2, 15, 11.99229113618279),
    (3, 0, -25.69393346270375), (3, 5, -154.18974869023643), (3, 6, -231.5293791760455), (3, 7, 357.6391179106141),
    (3, 8, 93.40532418362432), (3, 9, -37.45832313645163), (3, 10, 104.0996495089623), (3, 11, 29.8402934266605),
    (3, 12, -43.53345659001114), (3, 13, 96.32455395918828), (3, 14, -39.17726167561544), (3, 15, -149.72683625798564),
)


METHOD = Method(STAGES, tuple((0, *entry) for entry in FIFTH) + tuple((1, *entry) for entry in THIRD), DENSE)
#: stages of Radau IIA at whose nodes the interpolant is stored: with the start they determine its polynomial of degree 7
NODES = 7


@dataclass(frozen=True)
class DOP853(Solver):
    """Explicit Runge-Kutta method of order 8 with a dense output of order 7, for y' = f(t, y) that is smooth and not stiff.

    rtol  tolerance of the local error relative to each unknown (and to its scale, unless atol is given)
    atol  None, one number, or (n,)
    """

    rtol: float | None = None
    atol: Any = None

    factors: ClassVar[dict[str, dict[str, float]]] = {"DOP853": {"ODE": 3e-3, "Index1": 3e-3, "DAE": 3e-3}}
    error_fall: ClassVar[float] = 0.6
    #: factor on the longest step during an impact. At the begin of an impact forces grow with the power 1.5 of time. No
    #: polynomial describes that well, and the error estimate does not see it: with longer steps errors would hardly fall with the
    #: tolerance, and runs that are equally wrong would agree
    impacts: ClassVar[float] = 0.25
    tightest: ClassVar[dict[str, float]] = {"": 1e-14}
    #: names of methods in other programs -> the name of their counterpart here
    counterparts: ClassVar[dict[str, str]] = dict.fromkeys(
        ("rk45", "rk23", "rk4", "dopri5", "dopri853", "ode45", "ode23", "ode78", "ode89", "tsit5", "rungekutta"), "dop853")
    highest_index: ClassVar[int] = 0
    restarts: ClassVar[bool] = False

    def __post_init__(self) -> None:
        set_tolerances(self)

    def check(self, system: System) -> None:
        """Raise OptionError for a system without a right-hand side."""
        check_rates(self.label, system)

    def integrate(self, system: System, loop: StepLoop, h0: float | None) -> None:
        """Step from system.t0 to loop.t_end."""
        run = _Run(self, loop, h0)
        with run.method:
            run.steps()

    def dense(self, t: Array, y: Array, yp: Array, pieces: list[Any]) -> Interpolant:
        """Interpolant: polynomials of degree 7."""
        return Collocation.of(NODES, t, y, pieces)


class _Run:
    """A run with DOP853, in blocks of steps; where a block passed over a contact or switch, in single steps."""

    def __init__(self, solver: DOP853, loop: StepLoop, h0: float | None) -> None:
        self.loop, self.system, rtol = loop, loop.system, solver.tolerance
        self.atol = absolute_tolerance(self.system, rtol, solver.atol)
        atol = self.atol
        self.rtol, self.watch = rtol, StepWatch.of(loop, lambda y: rtol * np.abs(y) + atol)
        self.equations = rates_of(self.system)
        before = loop.method  # of the part of the run before this one
        if isinstance(before, Explicit) and before.equations is self.equations and before.fits(rtol, atol):
            self.method = before.anew()
        else:
            self.method = Explicit(self.equations, METHOD, radau_table(NODES).c[:-1], rtol, self.atol)
        loop.method = self.method
        self.h0 = h0
        contacts = self.watch is not None and self.watch.contacts is not None
        # largest length (s) of the steps in the next call where a step had passed over a contact or switch
        self.blocks, self.landing = Blocks(1 if self.system.one_by_one or contacts else ROWS, self.watch is not None), inf

    def _start(self) -> None:
        loop = self.loop
        code = self.method.start(loop.t, loop.state[0], loop.t_end - loop.t, self.h0)
        loop.stats.residuals += 2
        self.equations.raise_error()
        if code:  # y' does not exist or is not finite at the start: the call of rhs raises the error that says why
            self.system.rhs(loop.t, loop.state[0], np.empty(self.system.n))

    def steps(self) -> None:
        """Step to the end, in blocks of steps. Of a block only the steps before one that may hide a contact or switch are stored;
        the steps after these are made one by one."""
        self._start()
        loop, watch = self.loop, self.watch
        if self.system.longest_step is not None:
            self.method.bound(*self.system.longest_step[:3])
        going = True
        loop.goes_on(self)
        while going:
            rows = self.blocks.rows
            made = self._made(rows, self.landing if watch is None else min(watch.bound(), self.landing))
            kept = count = len(made.t)
            if watch is not None and count:
                kept, self.landing = self._looked_at(watch, made, closely=rows == 1)
                self.blocks.made(count, kept)
            if kept == 1:
                going = loop.accept(float(made.t[0]), made.y[0], made.yp[0], made.inner[0])
            elif kept:
                going = loop.accept_many(made.t[:kept], made.y[:kept], made.yp[:kept], list(made.inner[:kept]))
            else:
                loop.guard()
            self.equations.raise_error()
            if made.code and going:
                raise self._failed()
            if kept < count:
                self.method.begin(*loop.state, float(made.t[kept] - loop.t))
            if going:
                loop.keep(self)

    def _made(self, rows: int, longest: float) -> Steps:
        """Make up to `rows` steps of at most `longest` (s). A native call may return earlier, after some time. Where contacts or
        switches are watched it is then repeated until all steps are made: bounds of the step are renewed between blocks, and must
        not depend on the clock."""
        loop = self.loop
        made = self._advanced(loop.t, rows, longest)
        while self.watch is not None and not made.code and len(made.t) < rows and made.t[-1] < loop.t_end \
                and loop.evaluations_left >= 0:
            loop.guard()
            more = self._advanced(float(made.t[-1]), rows - len(made.t), longest)
            made = made.then(more)
        return made

    def _advanced(self, t: float, rows: int, longest: float) -> Steps:
        """Make up to `rows` steps, not longer than `longest` (s), in one call of the native method."""
        table, stats = self.method.table, self.loop.stats
        before = table.evaluations, table.rejected
        made = self.method.advance(t, self.loop.t_end, self.loop.evaluations_left, rows, longest)
        stats.residuals += table.evaluations - before[0]
        stats.rejected += table.rejected - before[1]
        return made

    def _looked_at(self, watch: StepWatch, made: Steps, closely: bool) -> tuple[int, float]:
        """Number of steps before the first that may hide a contact or switch, and the largest length (s) of the next step,
        finite only where a single step hides one. closely: whether it is a single step, in which contacts are sought too."""
        times = np.concatenate([[self.loop.t], made.t])
        states = np.concatenate([self.loop.state[0][None], made.y])
        inside = inside_of(radau_table(NODES), states[:-1], increments_of(states, made.inner))
        kept, landing = watch.kept(times, made.y, inside, closely)
        self.loop.stats.rejected += closely and not kept
        return kept, landing

    def _failed(self) -> Exception:
        """The error for a step that became as small as the round-off of the time."""
        loop, (y, yp) = self.loop, self.loop.state
        nearest_contact, F = "" if self.watch is None else self.watch.nearest(), np.empty(self.system.n)
        text = ("the step became smaller than the round-off of the time t: see whether a force jumps or grows without bound "
                f"there, or, where the motion is stiff, use mb.RadauIIA(3){nearest_contact}")
        for h in (0.0, 1e-9 * (loop.run_end - float(loop.system.t0))):  # F at the last state, and just after it
            self.system.residual(loop.t + h, y + h * yp, yp, F)  # raises an error where accelerations are not determined
            if not np.isfinite(F).all():
                culprit = self.system.equations[int(np.argmax(~np.isfinite(F)))]
                return loop.failure(f"{text}; {not_finite(culprit, loop.t + h)}", culprit)
        return loop.failure(text, self.system.names[largest(np.abs(yp) / (self.rtol * np.abs(y) + self.atol))])
