"""The known errors of a run: its estimate, with verify=True differences from another method and a finer mesh of beams, and a
closer run for those who read a quantity that the estimate does not cover.

The finer mesh has the same elements with one order more; measured, the estimate is 0.5 to 1.9 times the error. A comparison with
half the elements can give a thousandth of the error where a coarse mesh shifts the frequencies of vibrations (docs/beams.md).

Vibrations of stiff bodies that long steps damp away keep their amplitude in the exact solution. A short run shows them.
"""

from __future__ import annotations

import copy
import math
import warnings
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import Later, later
from mbdae.errors import AccuracyWarning, MbdaeError, OptionError, SolverError
from mbdae.formulations import Form, default_form, system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Beside, Measure, Solution, check_times
from mbdae.integrators.stored_runs import keeping_runs
from mbdae.laws.bodies import ORDERS, with_modes
from mbdae.results.accuracy import NO_RUN_BESIDE, NOT_REPEATED, WORDS, Accuracy, against_mesh, left_by_modes, second_order
from mbdae.results.clearance import OtherRun, some_of
from mbdae.results.errors import Errors
from mbdae.results.stored_parts import apart
from mbdae.run.amplification import Amplified
from mbdae.run.choice import prepared_from
from mbdae.run.control import closer, run_controlled
from mbdae.run.estimate import Controlled, Probe, cpu_of, measure_of, other_run, with_left_out
from mbdae.scene.beams import enter_more_modes
from mbdae.scene.components import Beam, Station
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.sampling import places, position_distance
from mbdae.system.scene_system import RELAXED, SceneSystem
from mbdae.threads import one_thread

if TYPE_CHECKING:
    from mbdae.integrators.sundials import IDA
    from mbdae.laws.beam import table
    from mbdae.results.beams import Fields, in_space
    from mbdae.system.model.beams import Line
else:
    IDA = Later("mbdae.integrators.sundials", "IDA")
    table = Later("mbdae.laws.beam", "table")
    Fields, in_space = later("mbdae.results.beams", "Fields", "in_space")

#: FINER: largest number of meshes tried where one with an order more does not serve; a mesh serves where the next one differs by
#: at most SERVES times the accuracy, since such a difference is 0.5 to 1.9 times the error
FINER, SERVES = 5, 0.5
TIMES = 201  #: number of times at which both meshes are compared
PLACES = np.linspace(0, 1, 5)  #: places of every element, from 0 to 1, at which both meshes are compared
#: fraction of an element by which a place at its end is moved inside it, to find the element of the other mesh on the same side
INWARDS = 1e-6


def with_finer_beams(scene: SceneData) -> SceneData:
    """A copy of the scene with beams of one order more, or with twice as many elements where there is no higher order, and with
    more modes of reduced bodies."""
    try:
        finer = copy.deepcopy(scene)
    except TypeError as error:  # a law of the user's contains what cannot be copied: an open file, a lock, ...
        raise OptionError(f"scene '{scene.name}' cannot be copied, as a finer mesh needs ({error}): keep such an object, like an "
                          "open file, out of its laws") from error
    for beam in (body for body in finer.bodies if isinstance(body, Beam)):
        if beam.order < max(ORDERS):
            vars(beam)["order"] += 1
        else:
            vars(beam)["elements"] = (2 * np.asarray(beam.elements)).tolist()
    enter_more_modes(finer)
    return finer


def mesh_error(prepared: Prepared, form: Form, solver: Solver, run: Solution, asked: Asked) -> tuple[float, float, OtherRun]:
    """Largest difference of positions (over the scene's length, rad), along the beams and of all bodies, between a run and the
    same run on a finer mesh; the largest of what the run was asked for, over its size; and that finer run, with which reactions
    are compared too. The run must begin at the start of the scene. Raises MbdaeError where the finer run fails."""
    end = float(run.t[-1])
    scene = with_finer_beams(prepared.model.scene)
    finer = (prepared_from(scene, RELAXED, end) if prepared.start.relaxed is not None else
             prepare(scene, t0=prepared.start.t, t_end=end))
    again = solver.run(system_for(finer, form, solver.highest_index), replace(asked, t_end=end))
    times = np.linspace(float(run.t[0]), end, TIMES)

    def measure(t: Array, a: Array, b: Array) -> Array:
        return np.array([distance_of_meshes((prepared, prepared.states(t, a)[0]), (finer, finer.states(t, b)[0]))])

    off, beside = Beside(again, times, measure, better=True).distance(run), OtherRun.beside(again, times, 1.0, finer, "mesh")
    return off, apart(prepared, run, beside, asked.wanted or {}), beside


def mesh_that_serves(form: Form, solver: Solver, asked: Asked, accuracy: float, finer: OtherRun
                     ) -> tuple[dict[str, Any], int]:
    """By beam the elements and order of the first mesh, from that of `finer` on, with which motion and what was asked for are
    within the accuracy of those on a finer one; nothing where FINER meshes do not serve or a run fails. And the runs made."""
    for runs in range(1, FINER + 1):
        prepared: Any = finer.prepared
        try:
            moved, off, following = mesh_error(prepared, form, solver, finer.run, asked)
        except MbdaeError:
            return {}, runs
        if max(moved, off) <= SERVES * accuracy:
            return {beam.name: {"elements": beam.elements, "order": beam.order} for beam in prepared.model.scene.bodies
                    if isinstance(beam, Beam)}, runs
        finer = following
    return {}, FINER


def distance_of_meshes(a: tuple[Prepared, Array], b: tuple[Prepared, Array]) -> float:
    """Largest difference of positions q (nt, nq) of a scene with two meshes: over the scene's length, angles in rad."""
    (coarse, q_a), (fine, q_b) = a, b
    lines = {line.beam.name: line for line in fine.model.lines}
    apart = [_along(line, q_a, lines[line.beam.name], q_b, coarse.length) for line in coarse.model.lines]
    nodes = {node.name: node for node in fine.model.nodes}
    reduced = with_modes(coarse.model.scene.connections)
    apart += [float(np.max(np.linalg.norm(places(coarse, c.name, q_a) - places(fine, c.name, q_b), axis=2))) / coarse.length
              for c in reduced]
    modal = {c.name for c in reduced} | {c.l.name for c in coarse.model.scene.connections if c.kind == "inertia"}
    for node in (n for n in coarse.model.nodes if not (isinstance(n.body, Station) or {n.name, n.joint} & modal)):
        other, size = nodes[node.name], node.kind.sizes[0]
        pair = q_a[:, node.q : node.q + size], q_b[:, other.q : other.q + size]
        apart.append(float(np.max(position_distance(coarse, node, *pair))))
    return max(apart)


def _along(line: Line, q: Array, other: Line, q_other: Array, length: float) -> float:
    """Largest difference between the sections of a beam on two meshes with positions q and q_other (nt, nq): over `length` (m),
    and of rotations in rad."""
    worst, ends = 0.0, other.mesh.places[np.r_[other.mesh.elements[:, 0], other.mesh.elements[-1, -1]]]
    for e, nodes in enumerate(line.mesh.elements):
        first, last = line.mesh.places[nodes[[0, -1]]]
        for xi in PLACES:
            place, inside = (first + x * (last - first) for x in (xi, xi + INWARDS * np.sign(0.5 - xi)))
            o = int(np.clip(np.searchsorted(ends, inside, side="right") - 1, 0, len(ends) - 2))
            there = float(np.clip((place - ends[o]) / (ends[o + 1] - ends[o]), 0, 1))
            (r, R), (r_o, R_o) = _section(line, q, e, float(xi)), _section(other, q_other, o, there)
            turned = 2 * np.arcsin(np.clip(np.linalg.norm(R - R_o, axis=(1, 2)) / np.sqrt(8), 0, 1))
            worst = max(worst, float(np.max(np.linalg.norm(r - r_o, axis=1))) / length, float(np.max(turned)))
    return worst


def _section(line: Line, q: Array, element: int, xi: float) -> tuple[Array, Array]:
    """Position (nt, 3), m, and axes (nt, 3, 3) of the section at xi of an element."""
    fields = Fields(line, table(line.mesh.order, np.array([xi])), element)
    found = fields.positions(q)
    return in_space(line, found)[:, 0, 0], fields.rotations(found)[:, 0, 0]


WINDOW = 5.0  #: length of a short run, in mean steps of the run, which itself resolves vibrations with longer periods
POINTS = 400  #: number of times at which both runs are compared
#: factor on the distance of the two runs: the largest amplitude may come after the end of the short run (observed: 1.9 times as
#: large), which is made with the tolerance of a companion (observed: 6 % of an amplitude missed, an eighth of the cost)
MARGIN = 2.1


def with_lost_vibrations(prepared: Prepared, resolving: SceneSystem, measure: Measure, run: Controlled) -> Controlled:
    """The run whose estimate includes the lost vibrations: its largest distance, in a measure such as that of positions, from
    short runs of the system `resolving`, which resolves them, from start and excitations on."""
    if run.lost:
        return run
    span = WINDOW * float(run.solution.t[-1] - run.solution.t[0]) / max(run.solution.stats.steps, 1)
    close = run.solver
    if not close.by_steps:
        close = replace(close, rtol=close.companion * close.tolerance)  # type: ignore[type-var]
    probe = Probe(close, resolving, prepared, span, POINTS, MARGIN)
    return replace(with_left_out(run, probe, measure), lost=True)


#: FORCES: accuracies up to which a run whose vibrations carry force is repeated with all of them resolved, DEEPER times as
#: accurate in positions, SMALLEST at the least. Measured at 1e-6 on drawn mechanisms: forces were off by 4e-4 to 7e-2, and by
#: 1e-8 to 4e-7 after, of 8 of 9; the whole call takes 0.8 to 2.5 times the CPU time
FORCES, DEEPER, SMALLEST = 1e-5, 1e-3, 1e-10
LOOK, LEAST, PACE = 0.05, 800, 0.5  #: after LOOK of its evaluations, and LEAST, it is given up if less than PACE times as far


def with_forces(run: Controlled, resolving: SceneSystem, prepared: Prepared, accuracy: float, asked: Asked,
                times: Array) -> Controlled:
    """The run; where vibrations that it leaves out carry more force than a tight accuracy allows, one with all of them, if each
    run for it takes at most the evaluations of this one and about half a second."""
    close = RadauIIA(5).at_accuracy(max(DEEPER * accuracy, SMALLEST), resolving.label)
    most, span = run.solution.stats.residuals + SPARE / resolving.n, asked.t_end - run.solution.t[0]
    dearer = PACE * span * _evaluations(run, close) > most
    if accuracy > FORCES or not run.others or dearer or (
            off := Errors(prepared, run.solution, run.others, accuracy)()) <= accuracy:
        return run

    def too_slow(so_far: Solution) -> bool:
        done, spent = (so_far.t[-1] - so_far.t[0]) / span, so_far.stats.residuals
        if spent > max(LOOK * most, LEAST) and done < PACE * spent / most:
            raise SolverError("the steps are too short to come to the end", float(so_far.t[-1]), solution=so_far)
        return False

    try:
        within = replace(asked, max_residuals=most, stop=too_slow)
        again = run_controlled(resolving, prepared, RadauIIA(5), max(DEEPER * accuracy, SMALLEST), within, times)
    except SolverError as error:
        return run.after(1, cpu_of(error))
    better = again.others and again.estimate <= accuracy and Errors(prepared, again.solution, again.others, accuracy)() < off
    return replace(again, waves=True).after(run.runs, run.cpu_s) if better else run.after(again.runs, again.cpu_s)


def _evaluations(run: Controlled, close: RadauIIA) -> float:
    """Evaluations in a second of motion of a run by `close` that resolves all vibrations, at least: by those of short runs of the
    same method beside the run, and steps that grow with the power 1 / (stages + 1) of the tolerance. 0: not known."""
    windows = [other.run for other in run.others if other.kind == "window" and run.solver.label == close.label]
    longer = (run.solver.companion * run.solver.tolerance / close.tolerance) ** (1 / (close.stages + 1))
    return float(longer * min((one.stats.residuals / (one.t[-1] - one.t[0]) for one in windows), default=0.0))


CLOSER = 0.03  #: tolerance of a closer run over that of the run
RESOLVED = 0.1  #: with vibrations that the run leaves out, its tolerance over that which delivers the accuracy in positions
FOLLOWS = 1e-6  #: and at most this: 6e-5 damped the vibrations of a four-bar like its run in 5 steps, whose peak is 5 % low
#: its evaluations of the residual: MORE times those of the run, and SPARE over the number of unknowns (about half a second)
MORE, SPARE = 4.0, 5e6
SHARE = 1.1  #: ratio of the error of the run to its difference from one with a CLOSER tolerance, at most
REACHED = 0.02  #: where its work ended before it had this fraction of the time, it shows nothing
ROUNDED = ("rtol = {:.1g} is the smallest that round-off allows {}, so that a smaller accuracy ends with the same run; read it "
           "over a shorter run")
CONTINUED = "not measured: the run continues another one on the same mesh, whose discretisation error it has too"


@dataclass(frozen=True)
class Verified:
    """What verify=True found. motion: largest difference from a run of another method; mesh: from a run on a finer mesh of the
    beams; meshes: elements and order that serve; reactions, finer: states of these two runs, by which reactions are compared;
    unknown: {error: why it is not known}; runs: number of runs made."""

    motion: float | None = None
    reactions: tuple[OtherRun, ...] = ()
    mesh: float | None = None
    meshes: dict[str, Any] = field(default_factory=dict)
    finer: tuple[OtherRun, ...] = ()
    unknown: dict[str, str] = field(default_factory=dict)
    runs: int = 0


def verified(prepared: Prepared, form: Form, run: Controlled, accuracy: float, asked: Asked,
             continued: bool) -> Verified:
    """Compare a run with another method at a tenth of the accuracy and, with elastic bodies, a finer mesh or more modes."""
    found = _by_another_method(prepared, run, accuracy, asked)
    if not prepared.model.elastic:
        return found
    if continued:
        return replace(found, unknown=found.unknown | {"mesh": CONTINUED})
    same = replace(form, waves=True) if run.waves else form  # type: ignore[type-var]
    try:
        mesh, of, finer = mesh_error(prepared, same, run.solver, run.solution, asked)
    except MbdaeError as error:
        return replace(found, unknown=found.unknown | {"mesh": f"not measured: the run on a finer mesh failed: {error}"})
    within = max(mesh, of) <= accuracy or not any(isinstance(body, Beam) for body in prepared.model.scene.bodies)
    meshes, runs = ({}, 0) if within else mesh_that_serves(same, run.solver, asked, accuracy, finer)
    return replace(found, mesh=mesh, meshes=meshes, finer=(finer,), runs=found.runs + 1 + runs)


def _by_another_method(prepared: Prepared, run: Controlled, accuracy: float, asked: Asked) -> Verified:
    """Differences from a run of another method at a tenth of the accuracy."""
    radau, form = isinstance(run.solver, RadauIIA), default_form(prepared)
    other: Solver = IDA() if radau else RadauIIA(3)
    if prepared.model.elastic:  # with these not IDA, whose steps would have to resolve the fastest vibrations
        other = next(method for method in (RadauIIA(5), RadauIIA(3)) if method.label != run.solver.label)
        form = replace(form, waves=True)  # type: ignore[type-var]
    system = system_for(prepared, form, other.highest_index)
    controlled = run_controlled(system, prepared, other, max(accuracy / 10, 1e-10), asked, np.array([asked.t_end]))
    times = np.linspace(controlled.solution.t[0], controlled.solution.t[-1], 2001)
    again = Beside(controlled.solution, times, measure_of(system, prepared), better=True)
    return Verified(again.error(run.solution), other_run(system, prepared, again), runs=controlled.runs)


def accuracy_of(prepared: Prepared, accuracy: float, run: Controlled, found: Verified | None) -> Accuracy:
    """The known errors of a run, and why others are not known; found: errors that verify=True has shown, or None."""
    estimate = None if math.isnan(run.estimate) else run.estimate
    if estimate is None and found is None:
        return Accuracy(None, None, has_mesh=prepared.model.elastic, found_amplification=Amplified(run.solution))
    found = found or Verified()
    in_time = found.reactions or run.others
    forces = Errors(prepared, run.solution, (*in_time, *found.finer)) if in_time else None
    asked = accuracy if any(error is not None for error in (estimate, found.motion, found.mesh)) else None
    if forces is not None:
        at_limit = any(tolerance <= run.limit * (1 + 1e-9) for tolerance, _ in run.told[-1:])
        rounded = ROUNDED.format(run.limit, run.solver.label) if at_limit else ""
        forces.asked, forces.remedy, forces.against_mesh = asked, rounded, against_mesh(found.meshes)
    t, (q, u, _) = run.solution.t, prepared.states(run.solution.t, run.solution(run.solution.t))
    statically = max((float(np.max(off)) / prepared.length for _, off in left_by_modes(prepared, t, q, u)), default=0.0)
    of_modes = f"; how weight and acceleration deform bodies, the modes kept leave out {statically:.1e}" if statically else ""
    unknown = {"reactions": NO_RUN_BESIDE, "mesh": NOT_REPEATED + of_modes} | found.unknown
    return Accuracy(asked, estimate, found.motion, found.mesh, prepared.model.elastic, unknown, forces,
                    Amplified(run.solution), meshes=found.meshes, deformation=second_order(prepared, t, q, u))


def nothing_known(prepared: Prepared, why: str) -> Accuracy:
    """The accuracy of a run that did not reach its end, for the reason `why`."""
    return Accuracy(None, None, has_mesh=prepared.model.elastic, unknown=dict.fromkeys(WORDS, f"not estimated: {why}"))


@dataclass(frozen=True, eq=False)
class CloserRun:
    """Makes, when it is called, a run far more accurate than the one returned. It is made when a quantity is read whose error,
    estimated from companions, is above the accuracy: such an estimate is a bound, and says so of many numbers that are right.

    waves: whether it is to resolve elastic vibrations that the run leaves out; accuracy: that was asked for."""

    prepared: Prepared
    form: Form
    solver: Solver
    run: Solution
    accuracy: float
    asked: Asked
    waves: bool

    def __call__(self) -> OtherRun | None:
        """The run beside the one returned, up to the time at which its work ended; None where there is none."""
        form: Any = replace(self.form, waves=True) if self.waves else self.form  # type: ignore[type-var]
        try:
            with warnings.catch_warnings(), keeping_runs(None), one_thread():
                warnings.simplefilter("ignore", AccuracyWarning)
                system = system_for(self.prepared, form, self.solver.highest_index)
                solver = self._tighter(system.label)
                if solver is None:
                    return None
                most = MORE * self.run.stats.residuals + SPARE / system.n
                asked = closer(replace(self.asked, max_residuals=most, progress=None, max_wall=None, begin=None), solver, 4, 1)
                found = solver.run(system, asked)
        except SolverError as error:
            partial = error.solution
            if not isinstance(partial, Solution) or len(partial.t) < 3:
                return None
            found = partial
        except MbdaeError:
            return None
        begin, end = float(self.run.t[0]), float(self.run.t[-1])
        if found.t[-1] < begin + REACHED * (end - begin):
            return None
        times = some_of(check_times(found), system.n, True)  # at many times: short peaks of vibrations lie between few
        return OtherRun.beside(found, times, SHARE, kind="closer")

    def _tighter(self, label: str) -> Solver | None:
        """The solver with the smaller tolerance; None where round-off allows none."""
        limit = self.solver.tightest.get(label, self.solver.tightest[""])
        wanted = CLOSER * self.solver.tolerance
        if self.waves:
            wanted = min(wanted, FOLLOWS, RESOLVED * self.solver.at_accuracy(self.accuracy, label).tolerance)
        wanted = max(wanted, limit)
        return replace(self.solver, rtol=wanted) if wanted < self.solver.tolerance / 3 else None  # type: ignore[type-var]
