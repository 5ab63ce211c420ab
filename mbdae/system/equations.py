"""The System of a prepared scene in a form: its start and scales, where it restarts, and which rows it goes on with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mbdae.system.assembled.right_hand_side import partition_of, rhs_of, state_rates
from mbdae.system.assembled.scene_system import FormSpec, SceneSystem
from mbdae.system.assembled.switches import switches_of_model
from mbdae.system.assembled.vibrations import fastest_vibration
from mbdae.system.assembled.without_multipliers import Eliminated
from mbdae.system.base import Array
from mbdae.system.model.inputs import timeline
from mbdae.system.motion.contacts import Contacts
from mbdae.system.motion.displacements import Displacements
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import Prepared
from mbdae.system.rank.rows import Rows, RowsInForce
from mbdae.system.rank.scaling import multiplier_scales, position_scale, state_scale, stress_scale
from mbdae.system.start.start import Start
from mbdae.threads import single_threaded

#: False: runs look neither at inputs of time nor at laws that switch; to measure what is found between their points alone
RESOLVING = True


@single_threaded
def make_system(prepared: Prepared, spec: FormSpec, sparse: bool | None = None,
                made: dict[Rows, SceneSystem] | None = None) -> SceneSystem:  # fmt: skip
    """The System of a prepared scene in a form, with start and scales; made: see `Renewed`."""
    mechanics, start, T = prepared.mechanics, prepared.start, prepared.time
    kind = Eliminated if spec.eliminated and prepared.rows else SceneSystem
    system = kind(prepared.model, mechanics.rows, spec, sparse, prepared.expansion.carried)
    nb = system.numbering
    system.partition = None if mechanics.reactive else partition_of(mechanics, prepared.expansion)
    system.displaced = Displacements(nb)
    system.rhs = system.rhs or (None if nb.m else rhs_of(system))
    z = np.concatenate([np.zeros(0), *(line.stress(start.q, start.u) for line in prepared.model.lines if nb.stresses)])
    system.y0, system.yp0 = _values(prepared, system, start, z)
    system.scale = _scales(prepared, system)
    system.t0 = start.t
    if not prepared.model.lines:  # of beams the step over a second was measured
        system.time = T
    if prepared.contacts:
        system.guards = Contacts(system, {contact.item: contact.mass for contact in prepared.contacts})
        system.guard_names = system.guards.names
    if RESOLVING:
        system.switches = switches_of_model(prepared.model, prepared.expansion.carried)
        system.timeline = lambda t_end: timeline(prepared.model, system.t0, t_end)
    if prepared.model.lines:
        system.vibration = lambda: _vibration(prepared)
    system.restarted = lambda t, y: _restarted(prepared, system, t, y)
    if prepared.rank.dropped and prepared.rows:
        made = made if made is not None else {}
        renewed = Renewed(prepared, system, lambda again: make_system(again, spec, sparse, made), made)
        system.renewed, system.determined = renewed, renewed.determined
    assert len(system.y0) == nb.n
    return system


def _values(prepared: Prepared, system: SceneSystem, state: Start, z: Array) -> tuple[Array, Array]:
    """y and y' (n,) of a form at a consistent state, with stresses z of beams; multipliers that are derivatives start at 0."""
    mechanics, nb, spec = prepared.mechanics, system.numbering, system.spec
    q, u = nb.of_positions, nb.of_velocities
    rate = state_rates(mechanics, state.t, state.q, state.u, state.s)
    blocks = {
        "q": (state.q[q], mechanics.rates(state.q, state.u)[q]), "v": (state.u[u], state.acceleration[u]),
        "s": (state.s, rate), "z": (z, np.zeros_like(z)),
    }  # fmt: skip
    if "lambda" in spec.blocks:
        zero, multipliers = np.zeros(nb.m), state.multipliers[nb.rows_among(mechanics.rows)] / nb.scaling()
        blocks["lambda"] = (zero, multipliers) if spec.derivatives else (multipliers, zero)
        blocks["mu"] = (zero, zero)
    parts = [blocks[kind] for kind in ("q", "v", "s", "z", *spec.blocks)]
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def _scales(prepared: Prepared, system: SceneSystem) -> Array:
    """(n,) typical magnitude of every unknown."""
    mechanics, T, nb, spec = prepared.mechanics, prepared.time, system.numbering, system.spec
    q, u = nb.of_positions, nb.of_velocities
    blocks = {
        "q": position_scale(mechanics)[q], "v": mechanics.velocity_units[u] / T, "s": state_scale(mechanics),
        "z": np.full(len(nb.stresses), stress_scale(mechanics, T)),
    }  # fmt: skip
    if "lambda" in spec.blocks:
        kept = nb.rows_among(mechanics.rows)
        force, reach = (scale[kept] for scale in multiplier_scales(mechanics, prepared.start, T))
        force = force / nb.scaling()  # a scaled row reads scaling c = 0, its force is scaling lambda
        blocks |= {"lambda": force * T, "mu": reach} if spec.derivatives else {"lambda": force, "mu": reach / T}
    return np.concatenate([blocks[kind] for kind in ("q", "v", "s", "z", *spec.blocks)])


def _restarted(prepared: Prepared, system: SceneSystem, t: float, y: Array) -> tuple[Array, Array]:
    """y and y' (n,) to go on with from y: accelerations, rates and multipliers anew; multipliers that are derivatives go on."""
    nb = system.numbering
    fresh, rates = _values(prepared, system, _state(prepared.mechanics, prepared, system, t, y), _stresses(system, y))
    kept = system.n if system.spec.derivatives else nb.start["lambda"]
    return np.concatenate([y[:kept], fresh[kept:]]), rates


def _state(mechanics: Mechanics, prepared: Prepared, system: SceneSystem, t: float, y: Array) -> Start:
    """The state y (n,) of a system with accelerations and multipliers of the rows that a mechanics has in force."""
    times, z = np.array([t]), _stresses(system, y)
    (q,), (u,), (s,) = prepared.states(times, y[None])
    a, multipliers = mechanics.accelerations(times, q[None], u[None], s[None], z[None] if len(z) else None)
    return Start(t, q, u, s, a[0], multipliers[0])


def _stresses(system: SceneSystem, y: Array) -> Array:
    """Stresses z (nz,) of the beams among the unknowns y (n,)."""
    nb = system.numbering
    return y[nb.start["z"] : nb.start["z"] + len(nb.stresses)]


class Renewed:
    """(t, y) -> the same equations with other constraint rows in force, to go on with from there; None while those in force are
    good enough. make: equations of a prepared scene; made: those for choices of rows that a run had before."""

    def __init__(self, prepared: Prepared, system: SceneSystem, make: Callable[[Prepared], SceneSystem],
                 made: dict[Rows, SceneSystem]) -> None:  # fmt: skip
        self._prepared, self._system, self._make, self._made = prepared, system, make, made
        always = [i for i, row in enumerate(prepared.everything.rows) if not prepared.expansion.carried.keeps(row)]
        self._choice = RowsInForce(prepared.everything, len(prepared.rank.kept), always,
                                   tuple(prepared.rank.kept), made)  # fmt: skip

    def determined(self, t: float, y: Array) -> float:
        """Smallest singular value that counts of all rows of unit length: 0 in a singular position."""
        return self._choice.smallest(t, self._prepared.states(np.array([t]), y[None])[0][0])

    def __call__(self, t: float, y: Array) -> SceneSystem | None:
        rows = self._choice.better(t, self._prepared.states(np.array([t]), y[None])[0][0])
        if rows is None:
            return None
        if rows not in self._made:
            state = _state(self._prepared.mechanics_with(list(rows)), self._prepared, self._system, t, y)
            self._made[rows] = self._make(self._prepared.with_rows(list(rows), state))
        other = self._made[rows]
        other.go_on_from(self._system, t, y)
        return other


def _vibration(prepared: Prepared) -> tuple[str, float]:
    """The beam that vibrates fastest, and how far in the characteristic time (rad)."""
    name, frequency = fastest_vibration(prepared.model.lines, prepared.start.q)
    return name, frequency * prepared.time
