"""Checks a scene and prepares it for the forms: its model, the rank of its constraint rows, its consistent start."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np

from mbdae.errors import SceneError, StartError
from mbdae.inputs.timed import after
from mbdae.process import building
from mbdae.scene import control, sensed
from mbdae.scene.record import models_of
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array, Kept
from mbdae.system.dependent_rows import smallest, unit_rows
from mbdae.system.model.feedback import Renewed
from mbdae.system.model.model import Model, build
from mbdae.system.model.moved_bodies import MovedBodies, acted_on_while_prescribed, too_large
from mbdae.system.model.numbering import Row, constraint_rows
from mbdae.system.model.trees import find_trees
from mbdae.system.motion import AllBodies
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.motion.tree_mechanics import TreeMechanics
from mbdae.system.nearest import start_positions
from mbdae.system.redundancy import RankReport, analyse
from mbdae.system.start import Start, Starter, continued
from mbdae.system.start_with_contacts import (
    ExpectedContact,
    characteristic_time,
    expected_contacts,
    ideal_start,
    sizes_of_rows,
)
from mbdae.system.undetermined import (
    SOUND,
    all_inert,
    contradictions,
    later_contradictions,
    massless_coordinates,
    massless_motions,
    massless_unknowns,
    undecided,
)
from mbdae.threads import single_threaded

#: largest violation of the joints' rows (m or rad), over the scene's length or 1, whichever is larger, up to which positions
#: computed along trees count as closed
PLACED = 1e-11
#: what was prepared last, of scenes of at most KEPT nodes (100 kB each): others are made again from it
KEPT, _latest = 100, deque[Any](maxlen=8)
#: what mechanics compute once, by what it depends on besides the rows in force: the nodes alone, the length of the scene, masses
OF_NODES, OF_LENGTH = ("rotational", "_kinds", "sparse", "reactive", "closing"), ("velocity_units", "position_units")
OF_MASSES = ("mass", "weight", "_entries_of_mass", "_inverse_weight", "inertia")
FORESIGHT = 10.0  #: time (s) over which prescribed values and inputs are checked where no later end of the run is known


@dataclass
class Prepared:
    """A checked scene: its model, the constraint rows in force, its start and the characteristic time, from which forms make
    Systems."""

    model: Model
    mechanics: Mechanics  #: of all nodes, with the rows in force (without redundant ones), those of recursive joints included
    rank: RankReport
    start: Start
    time: float  #: characteristic time, s
    all_bodies: AllBodies
    contacts: list[ExpectedContact] = field(default_factory=list)  #: the contacts, with the penetration expected before the run
    kept: Kept = field(default_factory=Kept, init=False, repr=False, compare=False)  #: what is made once from it

    def __reduce__(self) -> tuple[Any, ...]:
        """For copies and pickles, which contain the scene: the model and its kernels are made from it again."""
        for group in self.model.groups:
            group.derived.stated.refuse_change()
        of_model = self.model.scene, self.model.stay_kinematic, self.model.conditions.end
        return _made_again, (*of_model, self.rank, self.start, self.time, self.contacts)

    @cached_property
    def with_all_rows(self) -> Mechanics:
        """The mechanics with all rows, redundant ones included; it checks the joints over a run and gives their reactions."""
        if not self.rank.dropped:
            return self.mechanics
        return mechanics_of(self.model, constraint_rows(self.model), self.all_bodies, len(self.rank.dropped))

    @cached_property
    def sizes_of_rows(self) -> tuple[Any, Array, Array]:
        """Sizes of the constraint rows at the start, see `sizes_of_rows`."""
        return sizes_of_rows(self.mechanics, self.start)

    def mechanics_with(self, rows: list[Row]) -> Mechanics:
        """The mechanics of all nodes with other rows in force."""
        return mechanics_of(self.model, rows, self.all_bodies)

    def with_rows(self, rows: list[Row], start: Start) -> Prepared:
        """A copy of this prepared scene with another start and other rows in force; the rows left out become redundant ones."""
        kept = set(rows)
        dropped = [row for row in (*self.rank.kept, *self.rank.dropped) if row not in kept]
        rank = replace(self.rank, kept=rows, dropped=dropped)
        return replace(self, mechanics=self.mechanics_with(rows), rank=rank, start=start)

    def begun(self, start: Start) -> Prepared:
        """The prepared scene continued from a state, with the same rows in force."""
        return _begun(replace(self, start=continued(self.mechanics, start)), {}, True)

    def states(self, t: Array, y: Array) -> tuple[Array, Array, Array]:
        """q (nt, nq), u (nt, nu) of all nodes and s (nt, ns) from the unknowns y (nt, n) of any form."""
        first = self.all_bodies.nq + self.all_bodies.nu
        return *self.all_bodies.states(t, y), y[:, first : first + len(self.mechanics.numbering.states)]

    @property
    def rows(self) -> list[Row]:
        """The constraint rows that a form integrates: those in force without rows of recursive joints and of shared
        displacements, which are satisfied by construction."""
        return [row for row in self.mechanics.rows if self.all_bodies.moved.keeps(row)]

    @property
    def length(self) -> float:
        """Size of the scene, m."""
        return self.model.length


def _made_again(scene: SceneData, stay: Mapping[str, str], end: float, rank: RankReport, start: Start, time: float,
                contacts: list[ExpectedContact]) -> Prepared:
    model, moved = modelled(scene, stay)
    model.conditions.end = end
    all_bodies = AllBodies(model, moved)
    return Prepared(model, mechanics_of(model, rank.kept, all_bodies), rank, start, time, all_bodies, contacts)


@single_threaded
@building
def prepare(scene: SceneData, start: Start | None = None, t0: float = 0.0, t_end: float | None = None) -> Prepared:
    """Check a scene and find its start; raises SceneError with every problem found.

    start: state from which a run is continued, None: the start is found at t0 (s). Prescribed values are checked up to t_end (s),
    or for `FORESIGHT` seconds where it is None."""
    if start is None and (again := _renewed(scene, t0, t_end)) is not None:
        return again
    begin_time = start.t if start is not None else t0
    end = t_end if t_end is not None and t_end > begin_time else begin_time + FORESIGHT
    problems = scene.problems + sensed.problems(scene) + control.problems(scene, begin_time, end, start is not None)
    if problems:
        raise SceneError(problems)
    if not scene.bodies:
        raise SceneError([f"scene '{scene.name}' has no bodies; add s.link, s.rigid_body or s.point_mass"])
    model, moved = modelled(scene)
    if start is not None and (len(start.q), len(start.u)) != (model.nq, model.nu):
        raise SceneError([f"start: the run given has {len(start.q)} positions and {len(start.u)} velocities, but this scene has "
                          f"{model.nq} and {model.nu}; continue it with the same bodies and joint models"])
    model.conditions.time = after(begin_time)  # at the start, conditions of inputs such as t < 1 are evaluated just after it
    model.conditions.end = t_end if t_end is not None else inf
    all_bodies = AllBodies(model, moved)
    if not all_bodies.numbering.free:
        raise SceneError([f"scene '{scene.name}': recursive joints hold or prescribe all bodies, so nothing is left to solve "
                          f"for; use model=mb.Kinematic() for one of them"])
    rows = constraint_rows(model)
    all_rows = mechanics_of(model, rows, all_bodies) if moved.alone else Mechanics(model, rows)
    loose = start is None and any(c.loose for c in scene.joints)
    ideal = ideal_start(scene, model.stay_kinematic, t0) if loose else None
    starter = Starter(all_rows, start.t if start is not None else t0, changes=ideal.changes if ideal else None)
    q = start.q if start is not None else ideal.q if ideal else starter.placed()
    if problems := _not_finite(all_rows, starter.t, q):
        raise SceneError(problems)
    if start is None and not ideal and not (moved.alone and _closed(all_rows, starter.t, q)):
        q = start_positions(starter)
    rank = (RankReport(list(all_rows.rows), degrees_of_freedom=all_rows.nu - all_rows.m) if moved.alone else
            analyse(all_rows, starter, q, {row for row in all_rows.rows if not moved.keeps(row)}))
    if problems := _massless(all_rows, all_bodies, rank, starter, q) + undecided(all_rows, rank, starter.t, q):
        raise SceneError(problems)
    mechanics = all_rows if moved.alone else mechanics_of(model, rank.kept, all_bodies)
    try:
        moving = Starter(mechanics, t0, changes=starter.changes)
        begin = continued(mechanics, start) if start is not None else moving.run(q, ideal.u if ideal else None)
    except StartError as error:
        raise StartError([*error.problems, *rank.locking]) from None
    problems, model.conditions.time = contradictions(all_rows, rank, begin), None
    if problems := problems or later_contradictions(all_rows, mechanics, rank, begin, end):
        raise StartError(problems)
    found = _begun(Prepared(model, mechanics, rank, begin, 0.0, all_bodies), ideal.reactions if ideal else {}, start is not None)
    if start is None and not loose:
        found.kept.update(placed=starter.drawn, projected=moving.projected, along=moving.along)
        _keep(scene, found, (t0, t_end))
    return found


def _begun(prepared: Prepared, reactions: Any, continued: bool) -> Prepared:
    """The scene with the characteristic time and the contacts of its start; reactions: of joints without their play."""
    T = characteristic_time(prepared.mechanics, prepared.start)
    touching = expected_contacts(prepared.mechanics, prepared.start, reactions, T)
    problems = [problem for contact in touching for problem in contact.problems(continued)]
    if problems:
        raise StartError(problems)
    prepared.start.changes += [change for contact in touching for change in contact.changes()]
    return replace(prepared, time=T, contacts=touching)


def _keep(scene: SceneData, made: Prepared, times: tuple[float, float | None]) -> None:
    """Have scenes that differ from this one in numbers made again from what was prepared of it, for runs of the same times."""
    if len(made.model.nodes) <= KEPT:
        models_of(scene)[Prepared, times] = made
        _latest.append(made)


def _renewed(scene: SceneData, t0: float, t_end: float | None) -> Prepared | None:
    """A scene that differs in numbers alone from another one, whose items it shares and which was prepared last, with its start;
    None where it has to be prepared as a whole."""
    last = models_of(scene).get((Prepared, (t0, t_end)))
    if scene.problems or last is None or last.model.scene is scene or last.model.lines:
        return None
    model = build(scene, last.model.kept["by_rows"])
    how: Renewed | None = model.kept.pop(Renewed, None)
    all_bodies = last.all_bodies.again(model) if how is not None and how.last is last.model and not how.timed else None
    if how is None or all_bodies is None:
        return None
    again, r = how.placed or (how.inertia and not last.kept["placed"]) or bool(last.start.changes), last.rank
    if again and (r.dropped or r.doubtful or r.singular_here):
        return None
    model.conditions.time, model.conditions.end = after(last.start.t), t_end if t_end is not None else inf
    alone, mechanics = all_bodies.moved.alone, mechanics_of(model, last.rank.kept, all_bodies)
    as_long, known = model.length == last.model.length, vars(last.mechanics)
    untouched = OF_NODES + as_long * OF_LENGTH + (as_long and not how.inertia) * OF_MASSES
    vars(mechanics).update({name: known[name] for name in untouched if name in known})
    starter = Starter(mechanics, last.start.t)
    with suppress(StartError):  # which is told by the whole preparation
        t, q, u = starter.t, last.start.q, last.start.u
        if again:
            bare = starter if alone or type(mechanics) is Mechanics else Starter(
                Mechanics(model, r.kept), last.start.t, changes=starter.changes)
            if not (alone and _closed(mechanics, t, q := starter.placed())):
                q = start_positions(bare)
            m = bare.mechanics
            if not alone and smallest(unit_rows(m, m.constraint_matrix(t, q)), m.m) < SOUND:
                return None
            starter.drawn = bare.drawn
        inert = all_inert(model, last.kept.get("inert", ()))
        if (again or how.inertia) and not inert and _massless(mechanics, all_bodies, r, starter, q):
            return None
        if q is not last.start.q or (how.inertia and u.any() and r.degrees_of_freedom and last.kept["projected"]):
            starter.along = None if again else last.kept["along"]
            begin = starter.run(q)
        else:
            s = starter.states(q, u)
            a, multipliers = mechanics.accelerations(t, q[None], u[None], s[None])
            begin = Start(last.start.t, q, u, s, a[0], multipliers[0], [])
        model.conditions.time = None
        if not all(np.isfinite(x).all() for x in (begin.q, begin.u, begin.s, begin.acceleration, begin.multipliers)):
            return None
        made = _begun(Prepared(model, mechanics, r, begin, 0.0, all_bodies), {}, False)
        placed, projected = (starter.drawn if how.placed else last.kept["placed"]), starter.projected or last.kept["projected"]
        along = last.kept["along"] if starter.along is None else starter.along
        made.kept.update(placed=placed, projected=projected, along=along, inert={b for _, b in model.bodies} if inert else ())
        if as_long and begin.q is last.start.q and not how.placed and "sizes_of_rows" in vars(last):
            vars(made)["sizes_of_rows"] = last.sizes_of_rows
        _keep(scene, made, (t0, t_end))
        return made
    return None


def _closed(all_rows: Mechanics, t: Array, q: Array) -> bool:
    """Whether positions q (nq,) satisfy all constraint rows up to round-off (PLACED)."""
    return bool(np.max(np.abs(all_rows.position_residual(t, q[None])), initial=0.0) <= PLACED * max(1.0, all_rows.model.length))


def _not_finite(all_rows: Mechanics, t: Array, q: Array) -> list[str]:
    """Error messages, one sentence each, for constraint rows without a finite value or derivative at q (nq,), as drawn."""
    g, wrong = all_rows.position_residual(t, q[None])[0], all_rows.rows_without_slope(t, q)
    wrong |= ~np.isfinite(g)
    return [f"row {row.name} has no finite value or derivative where the scene is drawn ({value:g}): check the numbers of that "
            f"joint, and what its law divides by"
            for row, value, off in zip(all_rows.rows, g, wrong, strict=True) if off]


def _massless(all_rows: Mechanics, all_bodies: AllBodies, rank: RankReport, starter: Starter, q: Array) -> list[str]:
    """Error messages, one sentence each, for motions without inertia: of joint coordinates where no rows besides those of the
    trees are kept, else of bodies."""
    inside = all_bodies.moved.replaced
    if isinstance(all_rows, TreeMechanics):
        return massless_unknowns(all_bodies, all_rows.without_inertia(starter.t, q))
    if all_bodies.moved.trees and not all_bodies.model.lines and all((row.group, row.instance) in inside for row in rank.kept):
        return massless_coordinates(all_bodies, all_rows.mass, starter.t, q)
    return massless_motions(all_rows, rank, starter.t, q)


def mechanics_of(model: Model, rows: list[Row], all_bodies: AllBodies, redundant: int = 0) -> Mechanics:
    """The mechanics of all nodes with these rows, of which `redundant` follow from the others."""
    # with beams the sparse equations with constraint rows cost less than joint coordinates here; runs integrate the latter anyway
    reduced = all_bodies.moved.trees and not model.lines
    return TreeMechanics(model, rows, all_bodies, redundant) if reduced else Mechanics(model, rows, redundant)


def modelled(scene: SceneData, by_rows: Mapping[str, str] | None = None) -> tuple[Model, MovedBodies]:
    """The model of a scene, and the trees of its recursive joints. Joints of trees that cannot be evaluated are treated as
    kinematic. by_rows: recursive joints that are treated as kinematic anyway -> why."""
    model = build(scene, by_rows)
    moved = MovedBodies(model, find_trees(model))
    kept = too_large(model, moved) | acted_on_while_prescribed(moved)
    if not kept and not AllBodies(model, moved).numbering.free:  # every coordinate of the trees is prescribed
        kept = {c.name: "without these equations the scene would have no unknowns" for c in scene.joints if c.rigid}
    if kept:
        model = build(scene, {**(by_rows or {}), **kept})
        moved = MovedBodies(model, find_trees(model))
    return model, moved
