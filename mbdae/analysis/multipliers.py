"""Floquet multipliers: growth and modes of small departures from a periodic motion.

Departures x(t) from a motion of period T, in the directions that the constraints allow, obey x(T) = Phi x(0). The
eigenvalues mu of the monodromy matrix Phi are the multipliers, log(mu) / T the exponents: growth rates, and frequencies
up to multiples of 2 pi / T.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mbdae.analysis.frame import attitude
from mbdae.analysis.linearization import start_at
from mbdae.analysis.orbit import MOST, RETURN, Departures, Orbit, Return, check_return, departures, followed, halved
from mbdae.analysis.reduced import refuse_rolling
from mbdae.analysis.shapes import Mode, Modes, OnMesh, motion, participants, repeated, scaled, shares
from mbdae.analysis.shooting import Fast, fast_motions, propagated
from mbdae.analysis.state import at_kinks, told
from mbdae.errors import MbdaeError, SolverError, naming_arguments, warn
from mbdae.formulations import system_for
from mbdae.notation import counted
from mbdae.results.stored_parts import started
from mbdae.scene.models import with_open_tree
from mbdae.scene.scene import SceneData
from mbdae.scene.sensed import refuse_sampled
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.scene_system import SceneSystem
from mbdae.system.start import Start
from mbdae.threads import single_threaded
from mbdae.values import number, option, optional, whole

Complex = NDArray[np.complex128]

#: the error of the run with half the step is taken as the difference of both runs over GAIN: Radau IIA has order 5, which gives
#: 2^5 - 1 = 31; in stiff equations the order falls towards the order 3 of its stages, about 2^3
GAIN = 8.0
#: multipliers with a smaller relative distance, and vectors with a cosine above 1 - NEAR, count as one multiple root, whose mean
#: is the most accurate
NEAR = 1e-3
CERTAIN = 1e-3  #: largest relative distance at which multipliers count as equal or reciprocal, however large their errors are
LOST = 1e-9  #: multipliers below this part of the largest count as 0
#: estimated relative errors below this that more steps do not halve count as rounding errors, and no further run is made
ROUND = 1e-6
ELASTIC = 10  #: number of multipliers that are found for a scene with beams where the user gives no `count`


@dataclass(frozen=True)
class FloquetMode(Mode):
    """One mode: its eigenvalue is the exponent log(multiplier) / period, 1/s, with the imaginary part, rad/s, between
    -pi / period and pi / period; its shape is that at the start of the period. error: estimate, 1/s, of the exponent's."""

    multiplier: complex
    error: float

    @property
    def root(self) -> complex:
        """What `gradient` differentiates: the multiplier."""
        return self.multiplier


class Floquet(OnMesh, Modes[FloquetMode]):
    """Multipliers of a periodic motion and their modes, by falling size.

    `multipliers` (k,), `exponents` (k,) 1/s and `errors` (k,) 1/s (estimated) are all of them: 2 x degrees of freedom and one
    per internal state that acts on the motion. Over the modes, one per conjugate pair, go `growth` (1/s), `frequencies`
    (Hz) and `angular_frequencies` (rad/s); these are known up to multiples of 1 / period and 2 pi / period, the principal
    ones are given. monodromy: (k, k); departure: relative distance of the motion from its start after the period;
    steps: of the period; unresolved: number of multipliers left out, of motions faster than the steps follow, which damp them.
    What the equations at each instant say of those is `fast_growth` (m,) 1/s, in the mean over the period, and its errors
    `fast_errors` (m,) 1/s; 0 where nothing damps or feeds them.
    With beams `mesh` names the mesh, and `mesh_error` (k,) is the error of the multipliers that this mesh causes.
    """

    axes = np.eye(3)
    prepared: Prepared

    def __init__(self, prepared: Prepared, period: float, found: Monodromy, basis: Array, returned: Return, fast: Fast) -> None:
        self.prepared, self.period, self.departure, self._smooth = prepared, period, returned.off, not returned.kinks
        self.t, self.steps, self.monodromy, self.unresolved = prepared.start.t, found.steps, found.matrix, found.unresolved
        self.multipliers, self.errors = found.values, found.errors / period
        self.exponents, self._fast = exponents(found.values, period), fast
        self.fast_growth, self.fast_errors = fast.growth, fast.errors
        shapes = self._frames @ basis @ found.vectors
        own = self._frames @ basis @ fast.vectors
        self._fast_modes = [Mode(complex(root), scaled(own[:, i]), self) for i, root in enumerate(fast.roots)]
        self.modes = [FloquetMode(complex(self.exponents[i]), scaled(shapes[:, i]), self, complex(mu), float(self.errors[i]))
                      for i, mu in enumerate(found.values) if mu.imag >= 0]

    @property
    def roots(self) -> Any:
        """The multipliers, which `mesh_error` compares."""
        return self.multipliers

    @property
    def root_errors(self) -> Any:
        """Estimated errors of the multipliers."""
        return self.errors * self.period * np.abs(self.multipliers)

    @property
    def stable(self) -> bool | None:
        """False where a multiplier found is larger than 1 by more than its error, or a motion too fast for the steps grows by
        more than its error; True where none does: by the numbers, or because multipliers lie in pairs mu, 1 / mu, and one alone
        on the unit circle cannot leave it, nor 1 that of a motion shifted along itself; None where the errors leave it open,
        and where the motion stays at a kink of a law."""
        return self._judged(np.ones(len(self.multipliers), dtype=bool))

    def _judged(self, which: NDArray[np.bool_]) -> bool | None:
        """`stable` as some multipliers (k,) alone, and motions too fast for the steps, show it."""
        if not self._smooth:
            return None
        growth, off = self.exponents.real, self.errors
        if np.any((growth > off)[which]) or self._fast.stable is False:
            return False
        dies = growth + np.log1p(off * self.period) / self.period <= 0
        certain = (dies | on_circle(self.multipliers, off * self.period))[which]
        return True if np.all(certain) and self._fast.stable else None

    @cached_property
    def _frames(self) -> Array:
        """(nu, nu) matrix that turns motions of all nodes into components along inertial axes; rotations of bodies in space are
        components in body axes before."""
        start, blocks = self.prepared.start, []
        for node in self.prepared.model.nodes:
            blocks.append(np.eye(node.kind.translations if node.kind is NodeKind.SPATIAL else node.kind.sizes[1]))
            if node.kind is NodeKind.SPATIAL:
                blocks.append(attitude(node, start.q))
        return np.asarray(scipy.linalg.block_diag(*blocks))

    def shares(self, vector: Array) -> dict[str, float]:
        """Share of every body in the kinetic energy of a motion (nu,), by falling share."""
        m = self.prepared.mechanics
        return shares(m, m.mass, self._frames.T @ motion(m, vector))

    def open_text(self) -> str:
        """Which motion too fast for the steps leaves open whether the motion is stable."""
        worst = int(np.argmax(self.fast_growth + self.fast_errors))
        mode = self._fast_modes[worst]
        return (f"floquet: whether the motion is stable is open (stable is None): a motion of {participants(mode)} with "
                f"{abs(mode.eigenvalue.imag):.4g} rad/s is too fast for {self.steps} steps a period, and its growth, "
                f"{self.fast_growth[worst]:.2g} 1/s in the mean of the period, is known to {self.fast_errors[worst]:.1g} 1/s")

    def __str__(self) -> str:
        name = f"'{self.prepared.model.scene.name}'{self._plane}"
        head = (f"scene {name}, period {self.period:.9g} s from t = {self.t:g} s, {self.steps} steps; errors are those of "
                f"the growth, 1/s; frequencies are known up to multiples of {2 * np.pi / self.period:.5g} rad/s")
        lines = [head, f"{'mode':>4}  {'growth 1/s':>11}  {'error':>8}  {'rad/s':>11}  {'multiplier':>24}  bodies"]
        off = [mode.error * self.period for mode in self.modes]  # relative, of the multipliers
        lost = [part >= 1 and abs(mode.multiplier) * (1 + part) < 0.5 for mode, part in zip(self.modes, off, strict=True)]
        for i, mode in enumerate(self.modes):
            if lost[i]:
                continue
            mu = f"{mode.multiplier.real:.6g}" + (f"{mode.multiplier.imag:+.6g}i" if mode.multiplier.imag else "")
            numbers = f"{i + 1:>4}  {mode.growth:>11.5g}  {mode.error:>8.1e}  {mode.angular_frequency:>11.5g}"
            lines.append(f"{numbers}  {mu:>24}  {participants(mode)}")
        if any(lost):
            lines.append(f"not listed: {counted(sum(lost), 'mode')} whose multipliers are not known, but surely below one half")
        if self.unresolved:
            lines.append(f"not listed: {counted(self.unresolved, 'multiplier')} of motions too fast for {self.steps} steps")
        if len(self.fast_growth):
            lines.append("largest growth of motions too fast for the steps, in the mean of the period: {:.5g} 1/s, error {:.1e}"
                         .format(*max(zip(self.fast_growth, self.fast_errors, strict=True))))
        return "\n".join(lines + ([self._on_mesh] if self._on_mesh else []))

    def __repr__(self) -> str:
        return (f"<Floquet of '{self.prepared.model.scene.name}'{self._plane}, period {self.period:.9g} s: "
                f"{counted(len(self.multipliers), 'multiplier')}{', ' * bool(self._on_mesh)}{self._on_mesh}>")


def on_circle(multipliers: Complex, errors: Array) -> NDArray[np.bool_]:
    """Which multipliers (k,), relative errors given, certainly have the size 1: where to each there is one of the reciprocal
    size, those that are alone there, and those that are 1."""
    mu, errors = multipliers, np.minimum(errors, CERTAIN)
    with np.errstate(divide="ignore", invalid="ignore"):
        mates = np.abs(mu[:, None] * mu.conj() - 1) <= 4 * (errors[:, None] + errors)
        beside = np.abs(mu[:, None] / mu - 1) <= 4 * (errors[:, None] + errors)
    if not np.all(mates.any(axis=1)):
        return np.zeros(len(mu), dtype=bool)
    one = np.abs(mu - 1) <= 2 * errors
    return np.asarray((np.abs(np.abs(mu) - 1) <= errors) & ((np.sum(beside, axis=1) == 1) | one))


def exponents(multipliers: Complex, period: float) -> Array:
    """log(multiplier) / period, 1/s, principal; -inf where a multiplier is zero."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.abs(multipliers)) / period + 1j * np.angle(multipliers) / period)


@dataclass(frozen=True)
class Monodromy:
    """The monodromy matrix (k, k) and its eigenvalues by falling size. change: their relative change from half as many steps,
    divided by GAIN; rounding: the part of the errors that rounding of the matrix causes, by left and right vectors; errors: the
    sum, and for multiple roots their scatter."""

    matrix: Array
    steps: int
    values: Complex
    vectors: Complex
    change: Array
    errors: Array
    rounding: Array
    orbit: Orbit
    unresolved: int = 0


@naming_arguments
@single_threaded
def floquet(scene: SceneData, period: float, at: Any = None, count: int | None = None, accuracy: float = 1e-8) -> Floquet:
    """Multipliers of small departures from a motion that repeats after `period` (s), whole turns counting as a return.

    at: a Result (its end), (Result, t), an equilibrium, or None for the start of the scene: a state on the periodic motion.
    accuracy: largest error of exponent x period. count: number of multipliers, the largest first, that have to be that
    accurate (default: all; of a scene with beams the largest 10). The rest are left out where the steps do not follow them.
    The equations of the departures are integrated along the motion with exact Jacobians, in steps that are halved until the
    multipliers are that accurate; an AccuracyWarning says where they are not. Frequencies are known up to multiples of
    2 pi / period only.
    Raises SteadyError where state or equations do not repeat, with what differs.
    """
    period = option("period", period, number, "give the time in s after which the motion repeats, such as 2 pi / rotor speed",
                    above=0)
    count = optional("count", count, whole, "give the number of largest multipliers, 1 or more, or None for all", least=1)
    accuracy = option("accuracy", accuracy, number, "give the error of exponent x period, a number from 1e-11 to 0.01",
                      least=1e-11, most=1e-2)
    refuse_sampled(scene, "floquet")
    return multipliers_of(scene, period, at, count, accuracy)


def multipliers_of(scene: SceneData, period: float, at: Any, count: int | None, accuracy: float, off: float = 0.0) -> Floquet:
    """`floquet` after its options have been read, of a motion that is off by `off` of its size, as its multipliers then are."""
    prepared = prepared_from(scene, start_at(scene, at), period)
    refuse_rolling(prepared.mechanics, "floquet", "where the motion is steady, use s.linearize; else simulate small disturbances")
    system = system_for(prepared, highest_index=3)
    returned = check_return(prepared, system, period, max(RETURN, 100 * off))
    told(started(prepared))
    directions = departures(prepared, system, returned, period)
    wanted = count if count is not None else ELASTIC if prepared.model.lines else directions.Q.shape[1]
    found = _converged(system, directions, period, returned.shares, wanted, accuracy)
    fast = fast_motions(prepared, system, found.orbit, directions, returned)
    found = _without_damped(replace(found, errors=found.errors + off), fast, period)
    made = Floquet(prepared, period, found, _of_all_nodes(prepared, system, directions), returned, fast)
    if fast.stable is None:
        warn(made.open_text())
    if returned.kinks:
        warn(at_kinks(returned.kinks, "the multipliers"))
    made._again = repeated(partial(multipliers_of, period=period, count=count, accuracy=accuracy, off=off), at)
    return made


def _without_damped(found: Monodromy, fast: Fast, period: float) -> Monodromy:
    """Leaves out multipliers that vanished in the steps and not in the motion."""
    size = np.abs(found.values)
    gone = np.flatnonzero(size <= LOST * np.max(size, initial=0.0))
    left = np.sum(fast.growth * period > np.log(LOST * np.max(size, initial=1.0)))
    return _kept(found, np.isin(np.arange(len(size)), gone[len(gone) - min(left, len(gone)):], invert=True))


def _kept(found: Monodromy, keep: NDArray[np.bool_]) -> Monodromy:
    return replace(found, values=found.values[keep], vectors=found.vectors[:, keep], errors=found.errors[keep],
                   rounding=found.rounding[keep], unresolved=found.unresolved + int(np.sum(~keep)))


def prepared_from(scene: SceneData, begin: Start | None, period: float) -> Prepared:
    """The scene at a state: as a default run, with recursive joints where their model was left open."""
    end = (begin.t if begin is not None else 0.0) + period
    variant = with_open_tree(scene)
    try:
        found = prepare(variant, begin, t_end=end) if variant is not None else None
    except MbdaeError:  # the scene as stated is prepared below, which raises the error again if the scene is wrong
        found = None
    fewer = found is not None and not found.model.stay_kinematic and not found.all_bodies.moved.ordered
    return found if found is not None and fewer else prepare(scene, begin, t_end=end)


def _of_all_nodes(prepared: Prepared, system: SceneSystem, directions: Departures) -> Array:
    """(nu of all nodes, k) displacements at the start that belong to the k directions, for all nodes, those of recursive joints
    included; in the components of velocities (rotations of bodies in space in body axes)."""
    nu, e = directions.velocities, prepared.all_bodies
    p = (directions.units[:, None] * directions.Q)[:nu].T
    t, q, u = (np.repeat(x[None], len(p) + 1, axis=0) for x in (np.array(system.t0), *np.split(system.y0[: e.nq + nu], [e.nq])))
    # accelerations of the nodes are an affine function of those of the unknowns: the linear part maps displacements as well
    a = e.accelerations(t, q, u, np.vstack([np.zeros(nu), p]))
    return np.asarray((a[1:] - a[0]).T)


def _converged(system: SceneSystem, directions: Departures, period: float, ends: Array, count: int,
               accuracy: float) -> Monodromy:
    """Double the steps until the largest multipliers are as accurate as asked, or until more steps do not help."""
    before: Monodromy | None = None
    while True:
        try:
            now = _in_steps(system, directions, period, ends)
        except SolverError:  # the motion itself needs shorter steps
            if 2 * len(ends) > MOST:
                raise
            before, ends = None, halved(ends)
            continue
        if before is not None:
            now = _compared(now, before)
            asked = (np.arange(len(now.values)) < count) & (np.abs(now.values) > LOST * np.max(np.abs(now.values), initial=0.0))
            worst, last = (float(np.max(found.change[asked], initial=0.0)) for found in (now, before))
            if worst <= accuracy or 2 * len(ends) > MOST or (worst < ROUND and worst > last / 2):
                return _judged(now, asked, worst, accuracy)
        before, ends = now, halved(ends)


def _in_steps(system: SceneSystem, directions: Departures, period: float, ends: Array) -> Monodromy:
    orbit = followed(system, period, ends)
    matrix = directions.read(propagated(system, orbit, directions.start))
    # SciPy below 1.14 finds no eigenvalues of a matrix without rows, as of a motion without freedoms
    found: Any = scipy.linalg.eig(matrix, left=True) if len(matrix) else (np.zeros(0), matrix, matrix)
    values, left, vectors = found
    overlap = np.maximum(np.abs(np.einsum("nk,nk->k", left.conj(), vectors)), np.finfo(float).eps)
    rounding = 4 * np.finfo(float).eps * np.linalg.norm(matrix) / overlap / np.maximum(np.abs(values), np.finfo(float).tiny)
    order = np.lexsort((-values.imag, -np.round(np.abs(values), 12)))
    unknown = np.full(len(values), np.inf)
    return Monodromy(matrix, len(ends) - 1, values[order] + 0j, vectors[:, order] + 0j, unknown, unknown, rounding[order],
                     orbit)


def _compared(fine: Monodromy, coarse: Monodromy) -> Monodromy:
    """The finer one of two results, with its errors from the difference to the coarser one. Nearly equal roots with nearly the
    same vector count as one multiple root: its mean is compared, which is more accurate than the single roots."""
    a, b, V = fine.values, coarse.values, fine.vectors
    b = b[linear_sum_assignment(np.abs(a[:, None] - b))[1]]
    group = (np.abs(a[:, None] - a) <= NEAR * np.abs(a)) & (np.abs(V.conj().T @ V) > 1 - NEAR)
    number = np.maximum(np.sum(group, axis=1), 1)
    size = np.maximum(np.abs(a), np.finfo(float).tiny)
    change = np.abs(group @ (a - b)) / number / size / GAIN
    return replace(fine, change=change, errors=change + np.abs(a - group @ a / number) / size + fine.rounding)


def _judged(found: Monodromy, asked: Array, worst: float, accuracy: float) -> Monodromy:
    """Leaves out inaccurate multipliers that were not asked for; warns where one that was asked for is inaccurate."""
    if worst > accuracy:
        text = (f"floquet: the multipliers have relative errors of up to {worst:.1e} with {found.steps} steps a period, and more "
                f"do not help; accuracy = {accuracy:g} was asked: ask for fewer modes (count=) or a looser accuracy")
        warn(text)
    decayed = np.abs(found.values) <= LOST * np.max(np.abs(found.values), initial=0.0)
    all_asked = bool(np.all(asked | decayed))
    keep = np.logical_or(asked, found.change <= max(worst, accuracy)) | (decayed & all_asked)
    return _kept(found, keep)
