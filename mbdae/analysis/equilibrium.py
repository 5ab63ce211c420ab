"""Static equilibrium, and relative equilibrium in a frame that turns steadily."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from mbdae.analysis.frame import body_of, motion_in_words
from mbdae.analysis.plane import LOOK, DenseStiffness, Tangent, looked_at
from mbdae.analysis.state import at_kinks, kinks, told
from mbdae.analysis.statics import CONVERGED, Point, Statics
from mbdae.analysis.steady import Rest, acceleration_scale, reason_not_steady
from mbdae.errors import EquilibriumError, OptionError, StartError, naming_arguments, warn
from mbdae.integrators.solution import Solution, Stats
from mbdae.laws.bodies import with_modes
from mbdae.notation import counted
from mbdae.results.accuracy import Accuracy, RunInfo, second_order
from mbdae.results.result import Result
from mbdae.results.states import Instant
from mbdae.scene.components import Connection
from mbdae.scene.scene import SceneData
from mbdae.scene.sensed import refuse_sampled
from mbdae.system.base import Array
from mbdae.system.motion.constrained import least_norm
from mbdae.system.prepare import prepare
from mbdae.system.start import Start
from mbdae.threads import single_threaded
from mbdae.values import array, flag, function, option, optional, shown

#: smallest step of the load factor, relative to the load factor reached (or to 1e-4 where that is larger); where a shorter one
#: would be needed, raising the loads ends with an EquilibriumError
SMALLEST_STEP = 1e-6
#: largest displacement that the tangent predicts for a load step, in the scene's length and rad, without and with beams; longer
#: steps, which may skip a limit point, are shortened. With beams they are checked by the tangents at both ends
REACH, BENT = 0.1, 0.7
#: largest distance of a load step from the step that a tangent predicts, relative to the latter; beyond it the step is halved
NEAR = 0.3
TRUST = 0.5  #: first and largest step of the search for a stable state, in the scene's length and rad
STOP_IT = "stop that motion with a joint, or give it a spring"
ASIDE = 0.02  #: displacement from an unstable state, in the scene's length and rad, at which the search for a stable one begins
FAR = 30.0  #: sum of all steps of that search, in the scene's length and rad, beyond which it is given up
SEARCHES = 200  #: largest number of corrections of the search for a stable state, which is given up after them
#: a state at rest is refused where a redundant row is violated (m or rad) by more than this times the scene's length (m), or
#: times 1 where that length is below 1
OFF = 1e-6
SOLVED = "not estimated: the equations are solved until `residual` of the state at rest remains"
Progress = Callable[[float, int], None]  #: called with the load factor reached and the corrections so far


class Equilibrium(Result):
    """A state at rest in a frame: a Result with one instant, its sensors have the shape (1, ...).

    It starts a run (`s.simulate(..., start=e)`) and is a state to linearise about (`s.linearize(at=e)`).
    frame: name of the frame's body; load_factor: 1 for the scene as stated; residual: largest unbalanced force over the
    largest force; iterations: Newton corrections in all; unstable: number of directions in which the stiffness is
    negative (a rotating state may be stable all the same: `s.linearize` decides); out_of_plane: "stable" or "unstable" for
    motions that leave the plane of a planar scene, None where these were not looked at.
    """

    frame: str
    point: Point  #: all unknowns: stresses and multipliers too
    kinds: Any  #: kinds of the unknowns in `point`, such as "q" and "lambda"
    load_factor: float
    residual: float
    iterations: int
    unstable: int
    out_of_plane: str | None = None

    def __call__(self, t: Any) -> Equilibrium:
        """The state itself, which is the same at any time."""
        option("t", t, array, "give a time in s, or a list of them")
        return self

    def states(self, t: Array) -> tuple[Array, Array, Array]:
        """q, u, s at rest, (nt, ...)."""
        start, nt = self.prepared.start, np.size(option("t", t, array, "give a time in s, or a list of them"))
        return tuple(np.repeat(part[None], nt, axis=0) for part in (start.q, start.u, start.s))  # type: ignore[return-value]

    @cached_property
    def _dynamics(self) -> tuple[Array, Array]:
        """u' and multipliers under the loads times their load factor, not under the full ones."""
        p, q, t = self.prepared, self.prepared.start.q[None], np.array([self.prepared.start.t])
        multipliers, units = p.start.multipliers, p.mechanics.velocity_units
        if p.rank.dropped:
            force = p.mechanics.constraint_jacobian(t, q)[0].T @ multipliers
            multipliers = least_norm(p.with_all_rows.constraint_jacobian(t, q) * units, (force * units)[None])[0]
        return p.start.acceleration[None], multipliers[None]

    def _start_value(self, item: Connection, name: str) -> float:
        """Angle (rad) of a joint with its whole turns: the angle that a spring of the joint followed while the loads were raised,
        or, without a spring, the angle at the start."""
        followed = self.prepared.mechanics.followed.get((item.name, name))
        return super()._start_value(item, name) if followed is None else float(self._states[2][0, followed])

    def _between(self, t: Any, instant: bool = False) -> Result:
        raise OptionError("an equilibrium has one state, no peak or mean over a time: read its value, e.value(...)")

    def save(self, path: Any) -> None:
        raise OptionError(f"an equilibrium has one instant and is not stored: save a run that starts from it "
                          f"(s.simulate(..., start=e).save({shown(path)}))")

    def __repr__(self) -> str:
        return (f"<Equilibrium of '{self.prepared.model.scene.name}' in the frame of '{self.frame}': load factor "
                f"{self.load_factor:.6g}, residual {self.residual:.1e}, {counted(self.iterations, 'iteration')}"
                f"{f', stiffness negative in {self.unstable} direction(s)' if self.unstable else ''}"
                f"{self._plane}{', motions out of the plane grow' if self.out_of_plane == 'unstable' else ''}"
                f"{', mesh: not covered' if self.accuracy.has_mesh else ''}"
                f"{f', deformation: {size:.1e}' if (size := self.accuracy.deformation) else ''}>")


@naming_arguments
@single_threaded
def equilibrium(scene: SceneData, frame: Any = None, progress: Progress | None = None,
                out_of_plane: bool = True) -> Equilibrium:
    """A state at rest in a frame: s.ground (default), or a body that turns steadily about a fixed axis.

    The frame's rate is the one the scene's start or its prescribed angle gives that body; prescribed motions keep their
    values and rates at the start, other joints are at rest. Loads are raised from 0 to their values in steps found on the
    way. Where the scene has no stiffness without its loads, or they lead to a state whose stiffness is negative, a stable
    state is searched under the full loads.
    progress(load_factor, iterations) is called after every step. out_of_plane: whether the stability of a planar scene with beams
    or free bodies against motions out of its plane is looked at; an AccuracyWarning tells where these grow, and where a law has a
    kink exactly there. Raises EquilibriumError where there is no such state.
    """
    refuse_sampled(scene, "equilibrium")
    body = body_of(scene, frame if frame is not None else scene.ground)
    report = optional("progress", progress, function, "give a function, or None", takes="load_factor, iterations")
    look = option("out_of_plane", out_of_plane, flag, LOOK)
    statics = Statics(Rest(prepare(scene), body))
    statics.check_steady(statics.begin)
    found = _Path(statics, report or (lambda factor, iterations: None)).run()
    if kinked := kinks(statics.mechanics, (found.prepared.start.t, *(part[0] for part in found._states)), resting=True):
        warn(at_kinks(kinked, "the stiffness and the number of unstable directions"))
    found.info = replace(found.info, warnings=told(found))
    if look:
        found.out_of_plane = looked_at(found.prepared, found.frame)
    return found


def confirmed(statics: Statics, point: Point) -> Equilibrium:
    """The Result of a point at rest; EquilibriumError where it is not the only one nearby, or does not stay at rest."""
    # Newton's method ends when the motion has converged; multipliers converge later
    if statics.mechanics.reactive and not statics.elastic:
        point = statics.with_reactions(point)
    result = as_result(statics, point)
    unresisted = statics.soft_motions(statics.tangent(point))
    if unresisted:
        raise EquilibriumError(f"the state at rest is not the only one: nothing resists {unresisted[0]}; {STOP_IT}", result)
    _refuse_other_branch(result)
    statics.check_steady(point)
    axes = statics.rest.axes(statics.q(point))
    beams = (statics.system, point.y[statics.kinds == "z"]) if statics.elastic else None
    motion = reason_not_steady(result.prepared, axes, statics.t, result.q[0], result.u[0], statics.s(point), 1e-6, beams)
    if motion:
        raise EquilibriumError(f"no state stays at rest in the frame of '{axes.name}': {motion}; loads or joints change with "
                               f"time as seen in that frame; give another frame=", result)
    return result


def _refuse_other_branch(found: Equilibrium) -> None:
    """Raises where a redundant row is not satisfied: the rows that are used allow motions that all rows together do not."""
    m, q, t = found.prepared.with_all_rows, found.prepared.start.q[None], np.array([found.prepared.start.t])
    off = np.abs(m.position_residual(t, q)[0])
    if m.redundant and np.max(off) > OFF * max(1.0, found.prepared.length):
        row = m.rows[int(np.argmax(off))].name
        raise EquilibriumError(f"the search for a state at rest ended where the redundant constraint {row} is violated by "
                               f"{np.max(off):.2g} (m or rad): start the scene nearer to its state at rest", found)


def as_result(statics: Statics, point: Point) -> Equilibrium:
    """The Result of a point at rest."""
    prepared, m = statics.rest.prepared, statics.mechanics
    t, q, u, s = statics.rest.t, statics.q(point), statics.u(point), statics.s(point)
    up, multipliers = point.yp[m.nq : m.nq + m.nu], point.y[statics.kinds == "lambda"] * statics.system.numbering.scaling()
    start = Start(float(t[0]), q, u, s, up, multipliers)
    stats = Stats(steps=0, newton_iterations=point.iterations)
    rest = Instant("Newton", point.y[None], point.yp[None])
    solution = Solution(t, rest.y, rest.yp, None, stats, rest, statics.system.names, True, rest)
    modes = bool(with_modes(prepared.model.scene.connections))
    finer = " and ".join(["beams of one order more"] * bool(prepared.model.lines) + ["more modes of reduced bodies"] * modes)
    unknown = {"motion": SOLVED, "reactions": SOLVED, "mesh": f"not measured: compare with {finer}"}
    known = Accuracy(None, None, has_mesh=prepared.model.elastic, unknown=unknown,
                     deformation=second_order(prepared, t[:1], q[None], u[None]))
    info = RunInfo(rest, statics.system.label, known, stats)
    result = Equilibrium(replace(prepared, start=start), solution, info, t)
    result.point, result.kinds = point, statics.kinds
    result.frame, result.load_factor, result.iterations = statics.rest.frame.name, point.load_factor, point.iterations
    result.residual, result.unstable = statics.balance(point), statics.unstable(statics.tangent(point))
    return result


class _Path:
    """The sequence of states from the start without loads to rest under the loads."""

    def __init__(self, statics: Statics, progress: Progress) -> None:
        self.statics, self.progress = statics, progress

    def run(self) -> Equilibrium:
        """The state at rest: found by raising the loads where the scene has stiffness without them; by a search under the full
        loads otherwise, and where the state found is unstable."""
        s, begin = self.statics, self.statics.begin
        if s.soft_motions(s.tangent(begin)):
            self._refuse_free_motions(begin)
            return confirmed(s, self._search(replace(begin, load_factor=1.0)))
        found = confirmed(s, self._step_loads(begin))
        if found.unstable and s.stiffness(s.tangent(found.point)).symmetric:
            try:
                stable = confirmed(s, self._search(self._beside(found.point) if s.elastic else replace(begin, load_factor=1.0)))
                return found if stable.unstable else stable
            except (EquilibriumError, OptionError):
                return found  # none is stable, as for a rotor above its critical speed, which only its spin keeps in place
        return found

    def _beside(self, point: Point) -> Point:
        """A point near an unstable state, displaced along its softest motion. From the unstable state itself a search would not
        leave its symmetry, and so find no stable state (a straight column would stay straight)."""
        s, T = self.statics, self.statics.tangent(point)
        motion = s.stiffness(T).softest()[1][:, 0]
        aside = np.r_[ASIDE * motion / s.size(motion), np.zeros(T.K.shape[0] - len(motion))]
        return s.moved(point, T.p, aside)

    def _refuse_free_motions(self, begin: Point) -> None:
        """Refuse a motion that has no stiffness under the full loads either, at the start and at a random point near it."""
        s, full = self.statics, self.statics.with_reactions(replace(begin, load_factor=1.0))
        T = s.tangent(full)
        aside = np.zeros(T.K.shape[0])
        free = s.free_motions(T) if s.elastic else T.N
        aside[: s.mechanics.nu] = free @ np.random.default_rng(5).uniform(0.03, 0.1, free.shape[1])
        unresisted = s.soft_motions(T) and s.soft_motions(s.tangent(s.with_reactions(s.moved(full, T.p, aside))))
        if unresisted:
            raise EquilibriumError(f"the scene has no single state at rest: nothing resists {unresisted[0]}; {STOP_IT}")

    # -- raising the loads

    def _step_loads(self, point: Point) -> Point:
        """Follow the state at rest from load factor 0 to 1; a step is accepted where its result is near its tangent."""
        step = 1.0
        while point.load_factor < 1:
            step = min(step, 1 - point.load_factor)
            tried = self._one_step(point, step)
            if tried is None:
                step *= self.shorter
                if step < SMALLEST_STEP * max(point.load_factor, 1e-4):
                    raise self._stopped(point)
                continue
            point, quality = tried
            self.progress(point.load_factor, point.iterations)
            step *= 2.0 if quality < 0.05 else 1.3 if quality < 0.15 else 1.0
        return point

    def _one_step(self, point: Point, step: float) -> tuple[Point, float] | None:
        s, factor, self.shorter = self.statics, point.load_factor + step, 0.5
        raised = replace(point, load_factor=1.0 if 1 - factor < 1e-12 else factor)
        T = s.tangent(raised)
        predicted = s.solve(T.K, T.right)[: s.mechanics.nu]
        size, reach = s.size(predicted), BENT if s.elastic else REACH
        if not size <= reach:
            self.shorter = min(0.5, 0.9 * reach / size) if np.isfinite(size) else 0.5
            return None
        found = s.newton(raised, T)
        if found is None:
            return None
        quality = self._apart(found[1], predicted)
        if s.elastic and quality <= NEAR:
            T = s.tangent(replace(found[0], load_factor=point.load_factor))
            quality = max(quality, self._apart(-found[1], s.solve(T.K, T.right)[: s.mechanics.nu]))
        return (found[0], quality) if quality <= NEAR else None

    def _apart(self, way: Array, predicted: Array) -> float:
        """Distance of a step `way` (nu,) from the step that a tangent predicts, relative to the predicted one."""
        off, size = self.statics.size(way - predicted), self.statics.size(predicted)
        return off / size if size > 1e-7 else 0.0

    def _stopped(self, point: Point) -> EquilibriumError:
        s = self.statics
        where = as_result(s, point)
        T = s.tangent(point)
        sizes, motions, _ = s.stiffness(T).softest()
        before = s.stiffness(s.tangent(s.begin)).softest()[0]
        motion = motion_in_words(s.mechanics.model, motions[:, 0], s.units)
        met = (f"at this limit point the stiffness against {motion} nearly vanishes" if sizes[0] < 0.1 * before[0] else
               f"no state at rest was found for slightly larger loads; the motion of least stiffness is {motion}")
        return EquilibriumError(f"the loads cannot be raised beyond {point.load_factor:.6g} of their values: {met}; lower "
                                f"the loads, stiffen the scene, or simulate what follows from the state reached, which this "
                                f"error holds as `.equilibrium`",
                                where, point.load_factor)

    # -- scenes without stiffness of their own

    def _search(self, point: Point) -> Point:
        """A stable state under the full loads, by Newton's method on the stiffness plus a multiple of the mass, as large as makes
        the sum positive definite."""
        s, radius, last, far = self.statics, TRUST, np.zeros(self.statics.mechanics.nu), 0.0
        for _ in range(SEARCHES):
            T = s.tangent(point)
            x = self._downhill(T, point, radius)
            way, size = x[: s.mechanics.nu], s.size(x)
            if not np.isfinite(size) or far > FAR:
                break
            far += size
            turned = float(way @ (last / s.units**2)) < 0
            radius = max(radius / 2, 1e-3) if turned else min(1.5 * radius, TRUST)
            try:
                point, last = s.closed(s.moved(point, T.p, x)), way
            except StartError:
                radius /= 4
                continue
            self.progress(point.load_factor, point.iterations)
            if size <= CONVERGED:
                return point
        unheld_motion = self._unheld(point)
        raise EquilibriumError(f"no state at rest was found in {counted(point.iterations, 'iteration')}: {unheld_motion}; "
                               f"{STOP_IT}, or start the scene nearer to its state at rest")

    def _downhill(self, T: Tangent, point: Point, radius: float) -> Array:
        """A correction no larger than `radius` (scene's length, rad); it lowers the potential energy, where there is one."""
        s, nu = self.statics, self.statics.mechanics.nu
        W = T.p.C.T @ (T.p.C.T @ sp.csc_matrix(s.mechanics.weight)).T
        found = s.stiffness(T)
        pull = float(np.max(acceleration_scale(s.mechanics, s.rest.t, s.q(point), s.u(point), s.s(point))))
        if isinstance(found, DenseStiffness):
            both = (found.reduced + found.reduced.T) / 2, T.N.T @ W @ T.N
            values = scipy.linalg.eigh(*both, eigvals_only=True) if T.N.shape[1] else np.zeros(1)
            shift = max(0.0, -1.5 * values[0]) if values[0] < -1e-9 * abs(values[-1]) else 0.0
            unit = max(abs(values[0]), abs(values[-1]), pull)
        else:
            shift, unit = 0.0, 1e3 * pull
        while found.negative(shift * W):
            shift = max(4 * shift, 1e-4 * pull)
        inertia = sp.block_diag([W, sp.csr_matrix((T.K.shape[0] - nu,) * 2)], format="csr")
        for _ in range(40):
            x = s.solve(T.K + shift * inertia if shift else T.K, T.right)
            if np.all(np.isfinite(x)) and s.size(x) <= radius:
                return x
            shift = max(3 * shift, 1e-8 * unit)
        return np.full(T.K.shape[0], np.nan)

    def _unheld(self, point: Point) -> str:
        s = self.statics
        T = s.tangent(point)
        force = T.right[: s.mechanics.nu] if s.elastic else T.N @ (T.N.T @ T.right[: s.mechanics.nu])
        soft = s.soft_motions(T)
        return f"nothing resists {soft[0]}" if soft else (
            f"the forces have no balance along this motion: {motion_in_words(s.mechanics.model, force, s.units)}")
