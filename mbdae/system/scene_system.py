"""The System of a prepared scene in a form: start and scales, restarts at breaks, and the choice of integrated rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import as_full, later
from mbdae.errors import StartError
from mbdae.native.equations import Equations
from mbdae.symbolic.frames import NodeKind
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.guards import ContactGuards, switches_of_model
from mbdae.system.assembled.jacobian_entries import FormSpec
from mbdae.system.assembled.right_hand_side import Partition, numbers_of, partition_of, right_hand_side, state_rates
from mbdae.system.base import Array, Kept, Numbers, System
from mbdae.system.dependent_rows import Rows
from mbdae.system.model.moved_bodies import timeline
from mbdae.system.motion import Displacements
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import Prepared
from mbdae.system.redundancy import RowsInForce
from mbdae.system.sampling import Sampling
from mbdae.system.start import ChangedVelocity, Start
from mbdae.system.start_with_contacts import scales
from mbdae.threads import alone, single_threaded
from mbdae.values import largest, option, word

if TYPE_CHECKING:
    from mbdae.system.start_of_beams import Slow, slowest, strainless
else:
    Slow, slowest, strainless = later("mbdae.system.start_of_beams", "Slow", "slowest", "strainless")

#: tests set this to False, so that solvers step over inputs of time and switching laws, which checks after a run have to find
WATCH_INPUTS_AND_SWITCHES = True
RELAXED = "relaxed"  #: word of a start that `relaxed` finds
#: estimated error of the velocities, over the largest one, from which a relaxed start is told, and refused
TOLD, UNFOUND = 1e-4, 0.01


class SceneSystem(System):
    """A prepared scene in a form: F(t, y, y') = 0 with its exact Jacobian, start and scales.

    sparse: whether the Jacobian is, None: by the number of unknowns; others: rows in force -> equations with these rows, made
    earlier in a run and used again where these rows are well conditioned; assembly: the equations, None: they are made."""

    guards: ContactGuards | None = None

    @single_threaded
    def __init__(self, prepared: Prepared, spec: FormSpec, sparse: bool | None = None,
                 others: dict[Rows, SceneSystem] | None = None, assembly: Assembly | None = None) -> None:
        self.kept = Kept()
        self._prepared, self._asked, self._others = prepared, (spec, sparse), others if others is not None else {}
        mechanics, start, all_bodies = prepared.mechanics, prepared.start, prepared.all_bodies
        made = assembly or Assembly(prepared.model, mechanics.rows, spec, sparse, all_bodies.moved)
        self.assembly, self.model, self.numbering, self.spec = made, made.model, made.numbering, made.spec
        self.n, self.names, self.equations, self.kinds, self.index = made.n, made.names, made.equations, made.kinds, made.index
        self.label = made.label
        if made.explicit:
            self.rate_products = partial(self.owner.alone, lambda *args: made.evaluation.products(*args))
            self.rate_jacobian = lambda t, y: self.rate_products(t, y, np.eye(self.n)).T
        z = _stresses(prepared, made, start.q, start.u)
        self.t0, (self.y0, self.yp0), self.scale = start.t, _values(prepared, made, start, z), scales(prepared, made)
        if not prepared.model.lines:  # with beams `time` stays 1 s, with which the accuracy and cost of beams were measured
            self.time = prepared.time
        else:
            self.vibration = partial(_vibration, prepared)
        if self.rhs is None and not self.numbering.m:
            self.rhs = partial(self.owner.alone, partial(right_hand_side, made))
        if prepared.contacts:
            self.guards = guards = ContactGuards(made, prepared.contacts, mechanics, prepared.states)
            self.guard_names, self.guard_units, self.guard_jumps = guards.names, guards.units, guards.jumps
        if prepared.model.scene.controllers:
            self.sampled = Sampling(prepared, made.numbering)
        if WATCH_INPUTS_AND_SWITCHES:
            self.switches = switches_of_model(prepared.model, all_bodies.moved)
            self.timeline = partial(timeline, prepared.model)
        self._choice = _rows_in_force(prepared, self._others) if prepared.rank.dropped and prepared.rows else None

    @cached_property
    def partition(self) -> Partition | None:
        """The parts of the equations of motion; None where friction depends on reactions."""
        of = self._prepared
        return None if of.mechanics.reactive else partition_of(of.mechanics, of.all_bodies)

    @cached_property
    def displaced(self) -> Displacements:  # type: ignore[override]
        """The function that adds virtual displacements to positions."""
        return Displacements(self.numbering)

    @property
    def stated(self) -> FormSpec:
        """What the form prescribes, with the multipliers that these equations may have eliminated."""
        return self._asked[0]

    @property
    def has_pattern(self) -> bool:
        return self.assembly.has_pattern

    @property
    def sparse(self) -> bool:
        return self.assembly.sparse

    @cached_property
    def sparsity(self) -> Any:
        return self.assembly.sparsity

    @cached_property
    def pattern(self) -> Any:
        """CSC pattern of the Jacobian."""
        return self.assembly.pattern

    @alone
    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        self.assembly.residual(t, y, yp, out)

    @alone
    def residual_stages(self, t: Array, y: Array, yp: Array, out: Array) -> None:
        self.assembly.residual_stages(t, y, yp, out)

    @alone
    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        self.assembly.jacobian(t, y, yp, cj, out)

    @alone
    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        return self.assembly.jacobian_parts(t, y, yp)

    @alone
    def linear_stages(self, t: Array, y: Array, yp: Array) -> tuple[Any, Array, Array]:
        return self.assembly, *self.assembly.evaluation.jacobians(t, y, yp)

    @alone
    def jacobian_values(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        return self.assembly.jacobian_values(t, y, yp)

    @alone
    def dense_stages(self, t: Array, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy' as full matrices (k, n, n) at k states, t (k,), y and yp (k, n)."""
        return self.assembly.dense_stages(t, y, yp)

    @property
    def native(self) -> Equations | None:
        """The table by which native methods evaluate these equations."""
        return self.assembly.evaluation.equations

    def numbers(self, names: Sequence[str]) -> Numbers:
        return numbers_of(self.assembly.evaluation, self.assembly, names)

    # -- breaks of inputs of time

    def read_at(self, time: float | None) -> None:
        self.model.conditions.time = time

    @contextmanager
    def within(self, time: float) -> Iterator[None]:
        """Context manager in which conditions of inputs, such as t < 1, are evaluated at a time (s) inside a step, also where the
        equations are evaluated at the end of the step."""
        self.read_at(time)
        try:
            yield
        finally:
            self.read_at(None)

    @cached_property
    def _of_rates(self) -> bool:
        """Whether no unknown is a multiplier."""
        return bool(np.all(self.index < 2))

    def restarted(self, t: float, y: Array) -> tuple[Array, Array]:
        """y and y' (n,) just after an instant t at which an input jumps: accelerations, rates and multipliers are computed anew.
        Unknowns whose derivatives are multipliers keep their values."""
        if self.rhs is not None and self._of_rates:
            rates = np.empty(self.n)
            self.rhs(t, y, rates)
            return y.copy(), rates
        fresh, rates = _values(self._prepared, self.assembly, self._state(self._prepared.mechanics, t, y), self._stresses(y))
        kept = self.n if self.spec.derivatives else self.numbering.start["lambda"]
        return np.concatenate([y[:kept], fresh[kept:]]), rates

    def strained(self, y: Array) -> Array:
        """Unknowns y (n,) with the stresses of beams that their strains cause."""
        (q,), (u,), _ = self._prepared.states(np.array([self.t0]), y[None])
        y, first = y.copy(), self.numbering.start["z"]
        y[first : first + len(self.numbering.stresses)] = _stresses(self._prepared, self.assembly, q, u)
        return y

    def _state(self, mechanics: Mechanics, t: float, y: Array) -> Start:
        """The state at t, y (n,), with the accelerations and multipliers that `mechanics` gives, whose rows in force may be
        others."""
        times, z = np.array([t]), self._stresses(y)
        (q,), (u,), (s,) = self._prepared.states(times, y[None])
        a, multipliers = mechanics.accelerations(times, q[None], u[None], s[None], z[None] if len(z) else None)
        return Start(t, q, u, s, a[0], multipliers[0])

    def _stresses(self, y: Array) -> Array:
        first = self.numbering.start["z"]
        return y[first : first + len(self.numbering.stresses)]

    # -- other rows in force

    def renewed(self, t: float, y: Array) -> SceneSystem | None:
        rows = None if self._choice is None else self._choice.better(t, self._positions(t, y))
        if rows is None:
            return None
        if rows not in self._others:
            state = self._state(self._prepared.mechanics_with(list(rows)), t, y)
            self._others[rows] = type(self)(self._prepared.with_rows(list(rows), state), *self._asked, self._others)
        return self._others[rows].taking_over(self, t, y)

    def memory(self) -> dict[str, Any]:
        return {"systems": [system._own_memory() for system in (self, *self._others.values())]}

    def remember(self, memory: dict[str, Any]) -> None:
        for system, own in zip((self, *self._others.values()), memory["systems"], strict=False):
            system._remember_own(own)

    def forget(self) -> None:
        if self._choice is not None:
            self._choice.seen = None

    def _own_memory(self) -> dict[str, Any]:
        """Memory of these equations alone, without that of the equations with other rows in force."""
        return {"seen": None if self._choice is None else self._choice.seen,
                "masses": None if self.guards is None else self.guards.memory()}

    def _remember_own(self, memory: dict[str, Any]) -> None:
        if self._choice is not None:
            self._choice.seen = memory["seen"]
        if self.guards is not None:
            self.guards.remember(memory["masses"])

    @property
    def one_by_one(self) -> bool:
        return self._choice is not None or (type(self).accept is not System.accept and not self._accepts_many)

    def taking_over(self, other: SceneSystem, t: float, y: Array) -> SceneSystem:
        """These equations, starting at t from the state y (n,) of `other`, a system of the same scene and form with other
        rows."""
        return self.starting(t, *self.restarted(t, y), other.longest_step)

    def smallest(self, t: float, y: Array) -> float | None:
        """Smallest singular value that is not 0 by redundancy of all rows scaled to unit length; near 0 in singular positions.
        None where no row is redundant."""
        return None if self._choice is None else self._choice.smallest(t, self._positions(t, y))

    def _positions(self, t: float, y: Array) -> Array:
        """Positions q (nq,) of all nodes."""
        return np.asarray(self._prepared.states(np.array([t]), y[None])[0][0])


def begun(start: Any) -> str | None:
    """The option `start` of what makes several runs: RELAXED or None; OptionError for anything else."""
    return None if start is None else option("start", start, word, f"give '{RELAXED}' (elastic bodies strained by the loads of "
                                             "the start), or None for the start of the scene", words=(RELAXED,))


def relaxed(system: SceneSystem, near: Callable[[float], Callable[[Array], Array]]) -> Start:
    """The start of a scene in which elastic bodies are strained as in a motion without ringing: prescribed motions are kept, and
    of the others the part that would be there if elastic bodies were rigid, in the mean over the masses.
    near: length of a run with long steps, s -> times (k,) -> its unknowns (k, n)."""
    prepared, nb = system._prepared, system.numbering
    m, start, time = prepared.mechanics, prepared.start, np.array([prepared.start.t])
    nq, nu = nb.nq, nb.nu
    if not prepared.model.elastic:
        return start
    if loose := [c.name for c in prepared.model.scene.joints if c.loose]:
        raise StartError([f'start="relaxed": where the pin of {loose[0]} would touch is not known; start without it'])
    H = np.array([m.rates(start.q, e)[nb.of_positions] for e in np.eye(m.nu)[nb.of_velocities]]).T
    moved = prepared.all_bodies.velocity_map(time, system.y0[None, :nq])[0]
    rigid = strainless(m, time, start.q, moved, m.velocity_units[nb.of_velocities])
    weight = rigid.T @ moved.T @ as_full(m.mass) @ moved
    rows, forces = np.zeros((2, 2 * rigid.shape[1], system.n))
    count = rigid.shape[1]
    rows[:count, :nq], rows[count:, nq : nq + nu] = weight @ (H / np.sum(H * H, axis=0)).T, weight
    forces[:count, :nq], forces[count:, nq : nq + nu] = (H @ rigid).T, weight
    kept = np.eye(system.n)[np.array(system.kinds) == "s"]
    quaternions = [np.flatnonzero((nb.of_positions >= n.q + 3) & (nb.of_positions < n.q + 7))
                   for n in prepared.model.nodes if n.kind is NodeKind.SPATIAL]
    quaternions = [own for own in quaternions if len(own)]

    def lengths(y: Array) -> tuple[Array, Array]:
        slopes = np.zeros((len(quaternions), system.n))
        for slope, own in zip(slopes, quaternions, strict=True):
            slope[own] = y[own]
        return (slopes @ y - 1) / 2, slopes

    rate = max(m.speed(start.u) / prepared.length, 1 / prepared.time, slowest(m))
    slow = Slow(system, np.vstack([rows, kept]), np.vstack([forces, kept]).T, lengths, lengths(system.y0)[1].T, near)
    y, error = slow.start(rate)
    if error > UNFOUND:
        why = (f" (its velocities are known to {error:.1g} of the largest one): elastic bodies vibrate as slowly as the scene "
               "moves" if error < np.inf else "; corrections towards one did not converge, as where elastic bodies vibrate as "
               "slowly as the scene moves: begin from the end of a run")
        raise StartError([f'start="relaxed": no motion without ringing was found near the start of the scene{why}'])
    (q,), (u,), (s,) = prepared.states(time, y[None])
    told = [ChangedVelocity(f'start="relaxed": velocities are known to {error:.1g} of the largest alone')] if error > TOLD else []
    return replace(start, q=q, u=u, s=s, relaxed=error, changes=[*start.changes, *told])


def _stresses(prepared: Prepared, system: Assembly, q: Array, u: Array) -> Array:
    """(nz,) stresses of all beams that are unknowns of a system, from the strains of a state."""
    lines = prepared.model.lines if system.numbering.stresses else []
    return np.concatenate([np.zeros(0), *(line.stress(q, u) for line in lines)])


def _values(prepared: Prepared, system: Assembly, state: Start, z: Array) -> tuple[Array, Array]:
    """y and y' (n,) of a form at a consistent state, with stresses z of beams. Unknowns whose derivatives are multipliers start
    at 0."""
    mechanics, nb, spec = prepared.mechanics, system.numbering, system.spec
    q, u = nb.of_positions, nb.of_velocities
    rate = state_rates(mechanics, state.t, state.q, state.u, state.s)
    blocks = {
        "q": (state.q[q], mechanics.rates(state.q, state.u)[q]), "v": (state.u[u], state.acceleration[u]),
        "s": (state.s, rate), "z": (z, np.zeros(len(z))),
    }
    if "lambda" in spec.blocks:
        zero, multipliers = np.zeros(nb.m), state.multipliers[nb.rows_among(mechanics.rows)] / nb.scaling()
        blocks["lambda"] = (zero, multipliers) if spec.derivatives else (multipliers, zero)
        blocks["mu"] = (zero, zero)
    parts = [blocks[kind] for kind in ("q", "v", "s", "z", *spec.blocks)]
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _rows_in_force(prepared: Prepared, others: dict[Rows, SceneSystem]) -> RowsInForce:
    """The object that chooses the integrated rows of an over-constrained mechanism during a run; others: rows of earlier choices
    -> their equations."""
    always = [i for i, row in enumerate(prepared.with_all_rows.rows) if not prepared.all_bodies.moved.keeps(row)]
    return RowsInForce(prepared.with_all_rows, len(prepared.rank.kept), always, tuple(prepared.rank.kept), others)


def _vibration(prepared: Prepared) -> tuple[str, float]:
    """Name of the beam that vibrates fastest, and its angular frequency times the characteristic time (rad)."""
    found = {line.beam.name: line.fastest_vibration(prepared.start.q) for line in prepared.model.lines}
    name = list(found)[largest(list(found.values()))]
    return name, found[name] * prepared.time
