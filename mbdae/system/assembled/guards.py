"""The contacts of assembled equations, as solvers watch them: gap, gap rate and duration of an impact.

Arguments u of functions in laws that switch where u changes its sign, or that vary only within a narrow range of u, as
functions of the unknowns of any form: solvers watch them so that no step passes such a change unnoticed.

Values of expressions of sensors at given states, evaluated by the same code by which loads read sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, partial
from random import Random
from typing import Any

import numpy as np

from mbdae.kernels.plan import plan
from mbdae.laws.bodies import Observed, observed_value
from mbdae.native.collocation import SPEEDS, Contacts, durations_at
from mbdae.native.program import Operations
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.switches import switch_kinds, switch_outputs
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.base import Array, Switches
from mbdae.system.model.feedback import entry_of
from mbdae.system.model.model import Model
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.nodes import Groups, Instance
from mbdae.system.model.numbering import Numbering
from mbdae.system.motion.constrained import Evaluator
from mbdae.system.motion.mechanics import InstanceNumber, Mechanics, approaches, effective_masses
from mbdae.system.motion.states import gap_outputs
from mbdae.system.start_with_contacts import ExpectedContact

#: an effective mass that contains bodies tied by joints is calculated at the present position where the impact is under way or is
#: to begin within this many of its durations; else the effective mass at the start of the run is used
NEAR = 10.0
#: largest change of a number among the positions (m, rad or component of a quaternion), over the scene's length in m or 1,
#: whichever is smaller, up to which effective masses are not calculated again
SAME = 0.01
#: a mass that differs by at most this fraction in so many positions that are drawn does not depend on the positions
EQUAL, DRAWN = 1e-9, 3

StateReader = Callable[[Array, Array], tuple[Array, Array, Array]]  #: times (nt,) and unknowns (nt, n) -> q, u, s of all nodes


@dataclass(frozen=True)
class ContactPlace:
    """One contact of a scene. place: numbers of its law's group and instance; law: the law with its numbers; mass: effective mass
    of an impact at the start of the run (kg, or kg m^2)."""

    place: InstanceNumber
    name: str
    law: Any
    mass: float


class ContactGuards:
    """The contacts of assembled equations as `System.guards`: a call returns gap, gap rate and duration of an impact of each.

    contacts: those expected before the run, with their effective masses; states: q, u, s of all nodes from the unknowns."""

    def __init__(self, system: Assembly, contacts: Sequence[ExpectedContact], mechanics: Mechanics, states: StateReader) -> None:
        gathers, kernels = [], []
        self._mechanics, self._states = mechanics, states
        masses = {contact.place: contact.mass for contact in contacts}
        self.places: list[ContactPlace] = []
        for g, group in enumerate(system.model.groups):
            p = plan(group.derived, gap_outputs)
            if not p.targets:
                continue
            gathers.append(system.numbering.gather(g, p.all_inputs))
            kernels.append(p.kernel)
            for i, instance in enumerate(group.instances):
                named = [f"{instance.item}, {name}" for name in instance.law.gap_names()] or [instance.item] * len(p.targets[::2])
                self.places += [ContactPlace((g, i), name, instance.law, masses[g, i]) for name in named]
        self._evaluator = Evaluator(system.numbering, system.motion())
        self._emitted = partial(emitted, list(zip(kernels, gathers, strict=True)))
        self._positions = system.numbering.nq
        # effective masses by the number of the contact, the positions (nq,) at which they were calculated, and the logarithms
        # (contacts, speeds) of the durations of impacts with the masses known now
        self._masses, self._at = dict[int, float](), np.zeros(0)
        equal = constant_masses(mechanics, list({p.place: None for p in self.places if p.law.with_joints}))
        self._varying = np.array([p.law.with_joints and p.place not in equal for p in self.places], dtype=bool)
        self._kept: dict[tuple[Any, float], Array] = {}
        self._at_start = np.array([self._durations(n, p.mass) for n, p in enumerate(self.places)])
        self._logarithms = self._at_start.copy()
        # the last state and its result, because solvers evaluate the same state twice in a row
        self._last: tuple[float, Array, tuple[Array, Array, Array]] | None = None

    def native(self, numbers: Mapping[str, float]) -> Contacts:
        """The contacts as a table that the native methods read. numbers: constants of the checks, see `Contacts`."""
        self._evaluator.choose("gaps", self._emitted)
        return Contacts(self._evaluator, self._varying, {**numbers, "near": NEAR})

    def hold(self, contacts: Contacts) -> None:
        """Update the table of the native methods: the durations of impacts with the effective masses known now."""
        known = np.zeros(len(self.places), dtype=bool)
        known[list(self._masses)] = True
        contacts.hold(self._logarithms, known, self._at, SAME * min(1.0, self._mechanics.model.length))

    def _durations(self, n: int, mass: float) -> Array:
        """Logarithms of the durations (s) at SPEEDS of impacts of contact n with an effective mass (kg or kg m^2); infinite where
        nothing can move, so that there is no impact."""
        law = self.places[n].law
        if (law, mass) not in self._kept:
            found = law.contact_duration(mass, SPEEDS) if mass < np.inf else np.inf
            self._kept[law, mass] = np.broadcast_to(np.log(np.clip(found, 1e-300, 1e300)), SPEEDS.shape)
        return self._kept[law, mass]

    def memory(self) -> dict[str, Any]:
        """The effective masses known now and the positions at which they were calculated, for a run that is continued."""
        return {"at": self._at.copy(), "places": list(self._masses), "masses": list(self._masses.values())}

    def remember(self, memory: dict[str, Any]) -> None:
        """Restore the effective masses that `memory` returned."""
        self._last = None
        self._forget(memory["at"])
        self._learn(memory["places"], memory["masses"])

    def _forget(self, at: Array) -> None:
        """Go back to the effective masses at the start; those that are found next are those at the positions `at` (nq,)."""
        self._at, self._masses = at, {}
        self._logarithms[:] = self._at_start

    def _learn(self, contacts: Sequence[int], masses: Sequence[float]) -> None:
        """Take effective masses of contacts, and the durations of their impacts."""
        self._masses |= dict(zip(contacts, masses, strict=True))
        for n, mass in zip(contacts, masses, strict=True):
            self._logarithms[n] = self._durations(n, mass)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the contacts."""
        return tuple(place.name for place in self.places)

    @property
    def jumps(self) -> bool:
        """Whether the force of a contact jumps from zero when the bodies touch."""
        return any(place.law.jumps for place in self.places)

    @property
    def units(self) -> tuple[str, ...]:
        """The unit of every gap, m or rad."""
        return tuple(place.law.gap_unit for place in self.places)

    def __call__(self, t: float, y: Array) -> tuple[Array, Array, Array]:
        """Gap (m or rad), its rate and the duration (s) of an impact at that rate, (contacts,) each."""
        if self._last is None or self._last[0] != t or not np.array_equal(self._last[1], y):
            self._last = t, y.copy(), self._evaluated(t, y)
        return self._last[2]

    def gaps(self, t: float, y: Array) -> Array:
        """Gaps (contacts,) alone, without the durations of impacts, whose evaluation takes ten times as long."""
        return self.pairs(np.array([t]), y[None])[0, :, 0]

    def pairs(self, t: Array, y: Array) -> Array:
        """Gaps and their rates (k, contacts, 2) at times (k,) and unknowns y (k, n)."""
        return self._evaluator.at_states("gaps", self._emitted, t, y).reshape(len(t), -1, 2)

    def _evaluated(self, t: float, y: Array) -> tuple[Array, Array, Array]:
        pairs = self.pairs(np.array([t]), y[None])[0]
        gap, rate = pairs[:, 0].copy(), pairs[:, 1].copy()
        duration = durations_at(self._logarithms, rate)
        near = self._varying & ((gap < 0) | ((rate < 0) & (gap < -NEAR * rate * duration)))
        if near.any():
            self._with_present_masses(duration, rate, np.flatnonzero(near), t, y)
        return gap, rate, duration

    def _with_present_masses(self, duration: Array, rate: Array, near: Any, t: float, y: Array) -> None:
        """Replace the durations of the impacts `near` (numbers of contacts), which are about to begin or under way, by those with
        effective masses at the present positions."""
        moved = np.abs(y[: len(self._at)] - self._at) if len(self._at) else np.array([np.inf])
        if np.max(moved) > SAME * min(1.0, self._mechanics.model.length):
            self._forget(y[: self._positions].copy())
        missing = [n for n in near.tolist() if n not in self._masses]
        if missing:
            q = self._states(np.array([t]), y[None])[0][0]
            rows = approaches(self._mechanics, t, q, {self.places[n].place for n in missing})
            found = effective_masses(self._mechanics, t, q, True, [rows[self.places[n].place] for n in missing])
            self._learn(missing, found)
            duration[near] = durations_at(self._logarithms[near], rate[near])


def constant_masses(mechanics: Mechanics, contacts: Sequence[InstanceNumber]) -> set[InstanceNumber]:
    """Those contacts between bodies that no joint and no beam ties whose effective mass is equal, to round-off, in positions that
    are drawn: it is the same everywhere then, as that of spheres. A joint ties all bodies that it is between."""
    model = mechanics.model
    tied = {node for group in model.groups if group.derived.rows or isinstance(group.derived.law, Joint)
            for one in group.instances for node in one.nodes} | {node for line in model.lines for node in line.nodes}
    found = [(g, i) for g, i in contacts if not {*model.groups[g].instances[i].nodes} & (tied - {None})]
    masses, rng = [], Random(len(found))  # NumPy's generators take longer to be imported than most runs
    for _ in range(DRAWN if found else 0):
        q = model.length * np.array([rng.gauss(0, 1) for _ in range(model.nq)])
        for turned in (q[node.q : node.q + 4] for node in model.nodes if node.kind.sizes[0] - node.kind.translations == 4):
            turned /= np.linalg.norm(turned)
        rows = approaches(mechanics, 0.0, q, set(found))
        masses.append(effective_masses(mechanics, 0.0, q, False, [rows[place] for place in found]))
    return {place for place, of in zip(found, np.transpose(masses), strict=True) if np.ptp(of) <= EQUAL * np.max(of)}


def switches_of_model(model: Model, moved: MovedBodies) -> Switches | None:
    """The arguments of a model that solvers have to watch; None where there are none."""
    if (known := model.shape.kept.get((Switches, moved.shape))) is not None:
        made: Switches = copy(known[0])
        watched, found = known[1]
        numbers = [(model.groups[g].instances[i], s) for (g, i), s in found]
        vars(made).update(arguments=_Arguments(model, moved, watched),
                          weights=np.array([_weight(instance, exponent) for instance, (_, exponent) in numbers]))
        return made
    members = {place for tree in moved.trees for place in tree.members}
    watched = [(g, [i for i in range(len(group.instances)) if (g, i) not in moved.replaced or (g, i) in members])
               for g, group in enumerate(model.groups) if switch_kinds(group.derived)]
    watched = [(g, active) for g, active in watched if active]
    if not watched:
        return None
    places = [((g, i), s) for g, active in watched for i in active for s in switch_kinds(model.groups[g].derived)]
    found = [(model.groups[g].instances[i], s) for (g, i), s in places]
    kinds, names = tuple(kind for _, (kind, _) in found), tuple(instance.item for instance, _ in found)
    weights = np.array([_weight(instance, exponent) for instance, (_, exponent) in found])
    first = Switches(_Arguments(model, moved, watched), kinds, weights, names)
    model.shape.kept[Switches, moved.shape] = first, (watched, places)
    return first


def _weight(instance: Instance, stated: Expr) -> float:
    """Weight of an argument, see `Switches`: |exponent| of a power, with the numbers of this instance inserted; 1 for an exponent
    that varies, and for all other functions, where `stated` is 1."""
    exponent = stated.subs(dict(instance.numbers)) if stated.free_symbols else stated
    return 1.0 if exponent.free_symbols else abs(float(exponent))


class _Arguments:
    """The function (t (k,), y (k, n)) -> arguments (k, na) of all watched laws. watched: numbers of groups, each with the numbers
    of its instances."""

    def __init__(self, model: Model, moved: MovedBodies, watched: list[tuple[int, list[int]]]) -> None:
        self.model, self.moved, self.watched = model, moved, watched

    @cached_property
    def _values(self) -> Callable[[Array, Array], Array]:
        """The function that evaluates all arguments; its kernels are compiled when it is first needed."""
        return values_at_states(self.model, self.moved, self.watched, switch_outputs)

    def __call__(self, t: Array, y: Array) -> Array:
        return self._values(t, y)


def values_at_states(model: Model, moved: MovedBodies, watched: list[tuple[int, list[int]]],
                     outputs: Any) -> Callable[[Array, Array], Array]:
    """The function (t (k,), y (k, n) of any form) -> outputs (k, no) of the watched laws. watched: numbers of groups, each with
    the numbers of its instances; outputs: selects outputs of a law. Where the laws read bodies that recursive joints move, the
    motion of these is evaluated first."""
    needed = {node for g, active in watched for i in active for node in model.groups[g].instances[i].nodes if node}
    carried = bool(needed & set(moved.nodes))
    loaded = moved.nodes if carried else ()
    nb = Numbering(model, [], (), False, moved.nodes, loaded, moved.replaced, moved.constants, moved.sharing)
    plans = [plan(model.groups[g].derived, outputs) for g, _ in watched]
    gathers = [nb.gather(g, p.all_inputs, active) for p, (g, active) in zip(plans, watched, strict=True)]
    motion = partial(moved.motion, numbering=nb, to=lambda node, head, i: nb.node_place(head, node, i)) if carried else None
    kernels = [(p.kernel, gather) for p, gather in zip(plans, gathers, strict=True)]
    return partial(Evaluator(nb, motion).at_states, "values", partial(emitted, kernels))


def emitted(kernels: Sequence[tuple[Any, Any]], part: Operations) -> Any:
    """Append kernels with the slots that they read; returns the slots of all values."""
    return np.concatenate([kernel.emit(part, gather).ravel() for kernel, gather in kernels] or [np.empty(0, dtype=np.intp)])


class Observer:
    """Evaluates expressions of sensors and of time: a call with times t (k,) and unknowns y (k, n) of any form returns their
    values (k, number of expressions)."""

    def __init__(self, model: Model, moved: MovedBodies, expressions: Sequence[Expr]) -> None:
        self.model, self.moved = model, moved
        groups = Groups()
        self._at: list[tuple[Any, int]] = []
        for n, e in enumerate(expressions):
            law = Observed(f"observed {n + 1}", value=e)
            key, instance = entry_of(model.scenery, law, (), (), law.name)
            groups.of(key).instances.append(instance)
            self._at.append((key, len(groups[key].instances) - 1))
        first = len(model.groups)
        self._numbers = {key: first + n for n, key in enumerate(groups)}
        self._extended = replace(model, groups=[*model.groups, *groups.values()])

    @cached_property
    def _values(self) -> tuple[Callable[[Array, Array], Array], Any]:
        """The function that evaluates all expressions, compiled when it is first needed, and the column of every expression in
        its result, which is in the order of kernels."""
        model = self._extended
        chosen = [(g, list(range(len(model.groups[g].instances)))) for g in self._numbers.values()]
        counts = dict(zip(self._numbers, np.cumsum([0, *(len(active) for _, active in chosen)])[:-1], strict=True))
        order = np.array([counts[key] + i for key, i in self._at], dtype=np.intp)
        return values_at_states(model, self.moved, chosen, observed_value), order

    def __call__(self, t: Array, y: Array) -> Array:
        values, order = self._values
        found: Array = values(np.asarray(t, dtype=float), y)[:, order]
        return found
