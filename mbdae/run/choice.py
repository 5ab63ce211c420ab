"""The choice of joints, form and solver for a run in which the user names none, with the reason; benchmarks/choice.py measures
the rules and their bounds, docs/accuracy.md has the table.

Numbers of unknowns, equations and operations, from the naive formulation (in space, classical joints with their coordinates, all
rows, no shared unknowns) to the one integrated by default.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mbdae.deferred import Later, eigvals
from mbdae.errors import MbdaeError, OptionError
from mbdae.formulations import GGL, ODE, Form, Index1, default_form, shared_system, system_for
from mbdae.integrators.base import Solver
from mbdae.integrators.dop853 import DOP853
from mbdae.integrators.radau import RadauIIA
from mbdae.kernels.plan import linearised_plan
from mbdae.laws.bodies import with_modes
from mbdae.notation import counted
from mbdae.results.result import Result
from mbdae.scene.components import Classical
from mbdae.scene.models import may_be_recursive, refusal, replaced, with_open_tree
from mbdae.scene.scene import SceneData
from mbdae.system.assembled.assembly import SPARSE_FROM, Assembly
from mbdae.system.base import Array, System
from mbdae.system.model.model import Model, build
from mbdae.system.model.moved_bodies import MOST_FULL, MovedBodies
from mbdae.system.model.numbering import Row, constraint_rows
from mbdae.system.model.trees import find_trees
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.scene_system import RELAXED, relaxed
from mbdae.system.without_multipliers import WithoutMultipliers

if TYPE_CHECKING:
    from mbdae.integrators.sundials import IDA
else:
    IDA = Later("mbdae.integrators.sundials", "IDA")

#: accuracy below which DOP853 with eliminated multipliers (index 1) may be chosen; joints then drift, as far as the accuracy
#: allows. Where every motion is prescribed it may be chosen at any accuracy
TIGHT = 3e-6
#: bounds of rates of small disturbances times the motion's characteristic time. With a rate above STIFF an explicit method needs
#: tiny steps; with an angular frequency above SMOOTH multipliers are not eliminated: evaluations without them cost more
STIFF, SMOOTH = 100.0, 0.3
#: accuracy up to which Radau IIA has 5 stages, not 3, with reduced bodies, whose modes vibrate all the time, slowly enough for
#: its steps to follow them. Measured with 20 modes: half of the CPU time at 2e-5, a fifth at 3e-6, 1.2 times at 1e-4
MODAL = 2e-5
SMALL = 30  #: number of unknowns, with multipliers, up to which Radau IIA is cheaper if every motion is prescribed
NOT_STIFF = "an ordinary differential equation that is not stiff"
FRICTION = "friction, which is stiff where bodies stick"
UNSAID = "internal states of '{}' may let bodies stick, as friction, unless the class {} says sticks = False"
LARGEST = 8  #: number of largest eigenvalues that are computed of more than EIGENVALUES unknowns without multipliers
#: largest number of unknowns for which all eigenvalues are computed; with more and with multipliers the scene counts as stiff
EIGENVALUES = 300
ROUGH = 1e-3  #: tolerance of the run from which a relaxed start is found
WELL_CONDITIONED = 1e8  #: condition number of a mass matrix up to which it is inverted, not taken into the eigenvalue problem


@dataclass(frozen=True)
class Choice:
    """Joints, form and solver for a scene, with the reason in words; print it to read them."""

    prepared: Prepared
    stated: SceneData
    form: Form
    solver: Solver
    why: str

    @property
    def recursive(self) -> tuple[str, ...]:
        """Names of joints that become recursive although the scene does not state it."""
        return tuple(c.name for c in self.prepared.model.recursive if not self.stated[c.name].recursive)

    def __str__(self) -> str:
        n, eliminated = unknowns(self.prepared, self.form, self.solver.highest_index), self.solver.highest_index == 0
        linear = "sparse" if n > SPARSE_FROM and not (eliminated and self.prepared.rows) else "dense"
        plane = "planar" if self.prepared.model.planar else "spatial"
        joints = f", {counted(len(self.recursive), 'joint')} made recursive" if self.recursive else ""
        return f"{self.solver.label}, {self.form.label}, {plane}, {counted(n, 'unknown')}, {linear}{joints}: {self.why}"


def prepared_from(scene: SceneData, start: Result | str | None = None, t_end: float | None = None,
                  default: bool = False) -> Prepared:
    """The scene prepared with its own start, from the end of a Result, or RELAXED, by default with recursive joints where these
    are taken; raises SceneError with every problem found."""
    if start == RELAXED:
        system = system_for(own := prepared_from(scene, None, t_end, default), highest_index=3)
        begin = relaxed(system, lambda length: RadauIIA(3, rtol=ROUGH).solve(system, system.t0 + length))
        return prepare(own.model.scene, begin, t_end=t_end)
    assert not isinstance(start, str)
    found = with_recursive_joints(scene, start, t_end) if default else None
    return found or prepare(scene, start.state_for(scene) if start is not None else None, t_end=t_end)


def with_recursive_joints(scene: SceneData, start: Result | None = None, t_end: float | None = None) -> Prepared | None:
    """The scene with recursive joints, where its joints form a tree and the user has chosen no joint model. None elsewhere, and
    for a large stiff tree: implicit methods would factorise its Jacobian, which is full, so that the scene is taken as stated."""
    variant = with_open_tree(scene)
    try:
        found = prepared_from(variant, start, t_end) if variant is not None else None
    except MbdaeError:  # an error of the scene itself is raised later, when the scene is prepared as the user stated it
        return None
    if found is None or found.model.stay_kinematic:
        return None
    full = found.all_bodies.moved.ordered and unknowns(found, ODE(), 0) > MOST_FULL
    rates = found.kept.setdefault(Rates, Rates(found))
    return None if full and max(rates.decay, rates.oscillation) > STIFF else found


def choose(prepared: Prepared, stated: SceneData, accuracy: float, form: Form | None = None) -> Choice:
    """Form and solver of a default run, from the equations at the start and the accuracy, before anything is solved."""
    return Choice(prepared, stated, *_chosen(prepared, accuracy, form))


def unknowns(p: Prepared, form: Form, highest_index: int) -> int:
    """Number of unknowns of a form for a solver that takes unknowns up to index `highest_index`."""
    spec = form.for_index(highest_index).spec()
    stresses = sum(len(line.stresses) for line in p.model.lines) if spec.mixed else 0
    return p.all_bodies.nq + p.all_bodies.nu + len(p.mechanics.numbering.states) + stresses + spec.multipliers * len(p.rows)


def alternatives(choice: Choice, given: Form | None) -> Iterator[tuple[Solver, Form]]:
    """The chosen solver and form, then those to try where it stops or misses the accuracy; given: form asked by the user."""
    yield choice.solver, choice.form
    prepared = choice.prepared
    form = given if given is not None else default_form(prepared)
    if choice.solver != RadauIIA(3):
        yield RadauIIA(3), form
    if not prepared.model.elastic and not prepared.contacts and form.within(IDA.highest_index):
        yield IDA(), form


def _chosen(prepared: Prepared, accuracy: float, given: Form | None) -> tuple[Form, Solver, str]:
    form = given if given is not None else default_form(prepared)
    hard = _hard(prepared) or ("" if form.within(Solver.highest_index) else f"only Radau takes the index of form {form.label}")
    if hard:
        return form, RadauIIA(5 if accuracy <= MODAL and with_modes(prepared.model.scene.connections) else 3), hard
    rates = prepared.kept.setdefault(Rates, Rates(prepared))
    if not form.spec().blocks:
        stiff = max(rates.decay, rates.oscillation) > STIFF
        return form, RadauIIA(3) if stiff else DOP853(), f"stiff: {rates}" if stiff else NOT_STIFF
    if given is None or given.within(DOP853.highest_index):
        eliminated = given or Index1()
        if not prepared.rank.degrees_of_freedom and (given or unknowns(prepared, GGL(), 2) > SMALL):
            return eliminated, DOP853(), "every motion is prescribed, so nothing can vibrate"
        if accuracy < TIGHT and rates.decay <= STIFF and rates.oscillation <= SMOOTH:
            return eliminated, DOP853(), "rigid bodies that neither vibrate nor decay fast, to a tight accuracy"
    return form, RadauIIA(3), "long steps of order 5 are enough for this accuracy" if accuracy >= TIGHT else f"{rates}"


def _hard(prepared: Prepared) -> str:
    """Why a scene needs Radau IIA at every accuracy; "" where it does not."""
    if prepared.model.elastic:
        return "elastic bodies: BDF adds energy to their fast modes, or takes very many steps to follow them"
    if prepared.contacts:
        return "contacts: its steps end where they begin, and BDF gains or loses more energy in them"
    if prepared.rank.singular_here:
        return "it starts in a singular position, where accelerations alone do not tell the motion"
    for instance, states in ((one, group.derived.states) for group in prepared.model.groups for one in group.instances):
        if instance.law.may_stick(states):
            unsaid = instance.law.sticks is None and not any(part.may_stick() for part in instance.law.parts)
            return UNSAID.format(instance.item, type(instance.law).__name__) if unsaid else FRICTION
    return FRICTION if prepared.mechanics.reactive else ""


def _largest_eigenvalues(system: System) -> np.ndarray:
    """Eigenvalues of dy'/dy at the start: all for a small system, the largest for a large one by an iteration."""
    if system.n <= EIGENVALUES:
        return np.linalg.eigvals(system.rate_jacobian(system.t0, system.y0))
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs  # imported here because small scenes do not need it

    operator = LinearOperator((system.n, system.n), dtype=float, matvec=lambda v: np.asarray(
        system.rate_products(system.t0, system.y0, v.reshape(1, -1))[0]))
    try:
        v = np.random.default_rng(7).normal(size=system.n)
        return np.asarray(eigs(operator, LARGEST, which="LM", v0=v, tol=0.05, return_eigenvectors=False))
    except ArpackNoConvergence as stopped:
        return np.asarray(stopped.eigenvalues if len(stopped.eigenvalues) else [complex(-np.inf, np.inf)])


def finite_eigenvalues(fy: Array, fyp: Array) -> Array:
    """The finite eigenvalues of small disturbances, fy x + fyp x' = 0 with matrices (n, n). Rows without a derivative
    (constraints) hold at all times: x = N y with their null space N, and the other rows are an ordinary problem for y. Where they
    leave rates undetermined (bodies without mass), all eigenvalues of the pair of matrices are returned, infinite ones too."""
    rates = np.any(fyp != 0, axis=1)
    held = fy[~rates]
    lengths = np.linalg.norm(held, axis=1, keepdims=True)
    if np.all(lengths > 0):
        N = np.linalg.svd(held / lengths)[2][len(held) :].T if len(held) else np.eye(len(fy))
        moving = fyp[rates] @ N
        if np.linalg.cond(moving) < WELL_CONDITIONED:
            return np.linalg.eigvals(np.linalg.solve(moving, -fy[rates] @ N))
    return np.asarray(eigvals(-fy, fyp))


class Rates:
    """Rates of the fastest decay and oscillation of small disturbances at the start, multiplied by the characteristic time of the
    motion, so that they have no unit."""

    def __init__(self, prepared: Prepared) -> None:
        self._prepared = prepared

    @cached_property
    def _eigenvalues(self) -> np.ndarray:
        """Eigenvalues of small disturbances at the start, 1/s; infinite where there are too many unknowns to compute them."""
        system = shared_system(self._prepared, GGL() if self._prepared.rows else ODE())
        if system.rate_products is not None:
            return _largest_eigenvalues(system)
        if system.n > EIGENVALUES:
            return np.array([complex(-np.inf, np.inf)])
        fy, fyp = system.dense_parts(system.t0, system.y0, system.yp0)
        finite = np.isfinite(fy).all(axis=1) & np.isfinite(fyp).all(axis=1)
        if not finite.all():
            raise OptionError(f"the derivatives of equation {system.equations[int(np.argmin(finite))]} are not finite at the "
                              f"start t = {system.t0:g} s: check the laws and parameters it contains")
        return finite_eigenvalues(fy, fyp)

    @property
    def time(self) -> float:
        """The time in which the motion changes, s: the shortest of its characteristic time, the length of the run, and the time
        in which the fastest disturbance grows by the factor e. (What leaves an unstable rest at a rate would decay backwards in
        time at the same rate, which is not stiff.)"""
        p, growth = self._prepared, np.max(self._eigenvalues.real[np.isfinite(self._eigenvalues)], initial=0.0)
        return min(p.time, p.model.conditions.end - p.start.t, 1 / float(growth) if growth > 0 else np.inf)

    @property
    def decay(self) -> float:
        """Largest decay rate times the characteristic time."""
        return float(-np.min(self._eigenvalues.real, initial=0.0)) * self.time

    @property
    def oscillation(self) -> float:
        """Largest angular frequency times the characteristic time."""
        return float(np.max(np.abs(self._eigenvalues.imag), initial=0.0)) * self.time

    def __str__(self) -> str:
        if not np.isfinite(self.decay):
            return f"more than {EIGENVALUES} unknowns, too many to compute the fastest vibrations"
        T = self.time
        what = (f"decay at up to {self.decay / T:.3g} 1/s" if self.decay > self.oscillation else
                f"oscillate at up to {self.oscillation / T:.3g} rad/s")
        return f"small disturbances {what}, the motion changes in {T:.3g} s"


@dataclass(frozen=True)
class Size:
    """Numbers of unknowns, equations, multipliers (lambda and mu), kernels (compiled functions of laws), and of the arithmetic
    operations of all kernels for one residual with its derivatives."""

    unknowns: int
    equations: int
    multipliers: int
    kernels: int
    operations: int


@dataclass(frozen=True)
class Reduction:
    """A step by which the equations become fewer: the size of the system after it, and why it is possible."""

    reason: str
    size: Size


def size_of(system: Assembly) -> Size:
    """The size of a system; kernels of beams are not counted."""
    kernels, operations = 0, 0
    live = {(row.group, row.instance) for row in system.numbering.rows}
    for g, group in enumerate(system.model.groups):
        d = group.derived
        idle = d.rows and not (d.forced or getattr(d.law, "penalty", None))
        active = [i for i in range(len(group.instances))
                  if (g, i) not in system.moved.replaced and not (idle and (g, i) not in live)]
        if active:
            p = linearised_plan(d, system.spec.outputs)
            kernels += bool(p.nonlinear) + bool(p.jacobian_places)
            operations += len(active) * ((p.residual.operations if p.nonlinear else 0)
                                         + (p.jacobian.operations if p.jacobian_places else 0))
    sizes = [system.moved.passes(system.numbering, tree).size for tree in system.moved.trees]
    kernels += sum(k for k, _ in sizes) if system.moved.ordered else 2 * len({tree.structure for tree in system.moved.trees})
    operations += sum(o for _, o in sizes)
    multipliers = sum(kind in ("lambda", "mu") for kind in system.kinds)
    return Size(system.n, len(system.equations), multipliers, kernels, operations)


def reductions(scene: SceneData, prepared: Prepared, choice: Choice) -> list[Reduction]:
    """The reductions from the naive formulation to the default run, in order; those without effect are left out."""
    found: list[Reduction] = []
    for reason, assembly in _ladder(scene, prepared):
        size = size_of(assembly)
        if not found or size != found[-1].size:
            found.append(Reduction(reason, size))
    system = system_for(choice.prepared, choice.form, choice.solver.highest_index)
    size = size_of(system.full if isinstance(system, WithoutMultipliers) else system.assembly)
    if isinstance(system, WithoutMultipliers):
        size = replace(size, unknowns=system.n, equations=system.n, multipliers=0)
    made = " with recursive joints" if choice.recursive else ""
    found.append(Reduction(f"as solved by default{made}, {choice.form.label} for {choice.solver.label}", size))
    return found


def absent(scene: SceneData) -> list[str]:
    """Effects that the scene does not have, such as gravity, in words."""
    laws = [law for c in scene.connections for law in c.laws]
    rubbing = any(getattr(law, "friction", None) is not None for law in laws)
    timed = any(not isinstance(getattr(law, p), float | int | None) for law in laws for p in law.params)
    fields = [scene.gravity, *(b.gravity for b in scene.bodies if b.gravity is not None)]
    has = {"gravity": bool(np.any(fields)), "friction": rubbing, "contact": any(c.loose for c in scene.joints),
           "values prescribed in time": timed}
    return [term for term, needed in has.items() if not needed]


def _ladder(scene: SceneData, prepared: Prepared) -> Iterator[tuple[str, Assembly]]:
    """(reason of a reduction, system after it) in order; every system includes the reductions before it."""
    spec, model = GGL().for_index(1).spec(), prepared.model
    by_rows = {c.name: "" for c in scene.joints if c.recursive or c.rigid}

    def whole(of: Model, rows: list[Row]) -> Assembly:
        return Assembly(of, rows, spec, moved=MovedBodies(of, [], share=False))

    spatial = copy.copy(scene)
    spatial.space = "spatial"
    joints = [c.name for c in scene.joints if may_be_recursive(c) and refusal(type(c.joint), Classical()) is None]  # type: ignore[arg-type]
    for reason, classical in (("all equations in space, with classical joints", tuple(joints)),
                              ("without unknowns for joint coordinates", ())):
        try:
            of = build(replaced(spatial, classical, Classical()) if classical else spatial, by_rows)
            yield reason, whole(of, constraint_rows(of))
        except MbdaeError:  # left out: some laws of the scene exist only in the plane
            continue
    of = build(scene, by_rows)
    rows = constraint_rows(of)
    yield f"planar: {model.why}" if of.planar else "as stated", whole(of, rows)
    redundant = {row.name for row in prepared.rank.dropped}
    rows = [row for row in rows if row.name not in redundant]
    yield "redundant constraint equations left out", whole(of, rows)
    rigid = build(scene, {c.name: "" for c in scene.joints if c.recursive} | model.stay_kinematic)
    rows, trees = [row for row in constraint_rows(rigid) if row.name not in redundant], find_trees(rigid)
    for reason, share in (("welded bodies, and points held by a joint, move with the other body", False),
                          ("nodes that meet share unknowns, or are fixed to the ground", True)):
        yield reason, Assembly(rigid, rows, spec, moved=MovedBodies(rigid, trees, share=share))
    yield "recursive joints: their coordinates are the only unknowns", Assembly(
        model, prepared.mechanics.rows, spec, moved=prepared.all_bodies.moved)
