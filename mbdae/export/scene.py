"""The equations of a scene as a program of functions of (t, y, y', p), made of the operations that integrate it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError
from mbdae.export.program import (
    Entry,
    Program,
    filled,
    parameter_entries,
    rate_of,
    row_units,
    shifted,
    signal_entries,
    unknown_units,
)
from mbdae.formulations import Form, Index1, default_form, system_for
from mbdae.kernels.plan import plan
from mbdae.native.program import Operations, Step
from mbdae.results.sensors import reaction_outputs, shared_reactions
from mbdae.scene.components import Kinematic
from mbdae.scene.sensed import rates_of
from mbdae.symbolic.outputs import coordinate
from mbdae.symbolic.tree_motion import Open
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.model.model import Model
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.nodes import Node
from mbdae.system.model.numbering import Numbering, Row
from mbdae.system.prepare import Prepared, prepare

Index = NDArray[np.intp]
SHARED = "not unique: redundant constraints can carry a part of it"
STATE = ("t", "y", "p")
ALL = ("t", "y", "yp", "p")


def scene_program(scene: Any, form: Form | None) -> tuple[Program, Made]:
    """residual, jacobian, mass matrix and the like, sensors and joint_forces of a scene, rates too where the form has
    y' = f(t, y); with the operations from which they are made. Parameters that no function reads are still there."""
    prepared = prepare(scene)
    # trees that are evaluated joint by joint have no function to export: their joints are exported as kinematic ones
    if prepared.all_bodies.moved.ordered:
        prepared = prepare(scene.replace(*(c.name for c in prepared.model.recursive), model=Kinematic()))
    system = system_for(prepared, form if form is not None else default_form(prepared))
    full = getattr(system, "full", system.assembly)  # the formulation with multipliers, where they are eliminated
    assembly = Assembly(full.model, full.numbering.rows, full.spec, False, prepared.all_bodies.moved.opened(prepared.model))
    made = Made(assembly, system.n, assembly.moved.written(assembly.model))
    program = made.program(f"{scene.name}, form {system.label}", system)
    program.nominal, program.span = system.scale, prepared.time
    if full is system.assembly:
        e, rows = made.e, list(map(Entry, system.equations, row_units(made.assembly)))
        program.add("residual", "F(t, y, y') = 0", ALL, rows, e.rows + np.arange(made.n), made.part(e.residual_part))
        made._jacobian(program, made.rows, made.columns, e.fy + np.arange(2 * e.nnz), made.part(e.jacobian_part))
        if e.rates_part.steps:
            made._rates(program, e.rates, made.part(e.rates_part))
    else:
        made.eliminated(program)
    _mechanics(made, program)
    if prepared.model.scene.connections or prepared.model.scene.bodies:
        every = _of_all(made, program, prepared, full is not system.assembly)
        _sensors(every, program, prepared)
        _joint_forces(every, program, prepared)
    return program, made


class Made:
    """The operations of a scene with slots for its inputs. n: number of unknowns of the exported equations; fixed: see
    `MovedBodies.written`."""

    def __init__(self, assembly: Assembly, n: int, fixed: set[tuple[str, str]]) -> None:
        self.assembly, self.n, self.fixed = assembly, n, fixed
        self.numbering, self.e = assembly.numbering, assembly.operations()
        self.operations = self.e.operations
        # where multipliers are eliminated, u' in the array is what is solved for: the exported y' has slots of its own
        self.dotted = assembly.n if n == assembly.n else self.operations.slots(n)
        self.parameters, self.pairs = parameter_entries(self.numbering, fixed)
        self.signals, self.signal_pairs = signal_entries(self.numbering)
        self.numbers, pattern = self.numbering.workspace(), assembly.pattern
        assert pattern is not None  # trees that are evaluated joint by joint were replaced above
        self.rows, self.columns = pattern.indices, np.repeat(np.arange(assembly.n), np.diff(pattern.indptr))

    def part(self, *others: Operations) -> Operations:
        """A list of operations: first those that evaluate prescribed motions at t, then `others`."""
        return self.operations.part(self.e.clock, *others)

    def program(self, title: str, system: Any) -> Program:
        """The program with its inputs, whose values are those at the system's start."""
        units, n = unknown_units(self.numbering)[: self.n], self.n
        y = tuple(map(Entry, system.names, units, system.y0.tolist()))
        rates = [Entry(f"d/dt {e.name}", rate_of(e.unit), v) for e, v in zip(y, system.yp0.tolist(), strict=True)]
        slots = {"t": [(0, self.e.at), (0, self.e.at + 1)], "y": [(i, i) for i in range(n)],
                 "yp": [(i, self.dotted + i) for i in range(n)], "p": self.pairs, "signals": self.signal_pairs}
        vectors = {"t": (Entry("t", "s", 0.0),), "y": y, "yp": tuple(rates), "p": tuple(self.parameters)}
        vectors |= {"signals": tuple(self.signals)} if self.signals else {}
        return Program(title, self.operations, vectors, slots, self.numbers)

    def _jacobian(self, program: Program, rows: Any, columns: Any, at: Any, part: Operations) -> None:
        entries = [Entry(f"d F[{r}] / d {of}[{c}]", "") for of in ("y", "y'") for r, c in zip(rows, columns, strict=True)]
        program.pattern = np.asarray(rows, dtype=np.int64), np.asarray(columns, dtype=np.int64)
        program.add("jacobian", "entries of dF/dy, then of dF/dy'", ALL, entries, at, part)

    def _rates(self, program: Program, first: int, part: Operations) -> None:
        entries = [Entry(e.name, e.unit) for e in program.inputs["yp"]]
        program.add("rates", "y' of y' = f(t, y)", STATE, entries, first + np.arange(self.n), part)

    def reactive(self) -> list[str]:
        """Names of the items whose friction depends on the reactions."""
        groups = [group for group in self.assembly.model.groups if group.derived.reactive]
        return list(dict.fromkeys(instance.item for group in groups for instance in group.instances))

    # -- multipliers eliminated from the equations

    def solved(self) -> Operations:
        """Operations that compute u', the other rates and the multipliers: the equations are linear in them, so that one Newton
        step from 0 is exact. Raises OptionError where they are not linear."""
        if self.reactive():
            raise OptionError("form: one without multipliers solves for the joint forces by a formula, and there is none where "
                              "friction follows from these forces; export with form=mb.GGL() or "
                              "mb.Index1(multipliers='derivatives')")
        nb, e, n = self.numbering, self.e, self.assembly.n
        first = nb.start["lambda"]
        loaded = bool(self.assembly.motion())  # then the operations of the Jacobian contain the residual's
        part = self.part(*(() if loaded else (e.residual_part,)), e.jacobian_part)
        unknown, place, x = self.matrix(part, 1)
        part.add(x + place[unknown], e.rows + unknown, -1.0)
        part.lu(len(unknown), x - len(unknown) ** 2, x)
        plain = np.r_[np.arange(nb.nq), np.arange(nb.nq + nb.nu, first)]
        part.add(n + plain, e.rows + plain, -1.0)
        part.set(np.where(unknown < first, n, 0) + unknown, x + place[unknown])
        return part

    def matrix(self, part: Operations, times: int) -> tuple[Index, Index, int]:
        """Add the operations that fill the matrix of the linear equations for u' and lambda. Returns the numbers of u and lambda
        in y, the inverse table (-1 for other unknowns), and the slot after the matrix, where `times` right-hand sides have
        room."""
        nb, rows, columns = self.numbering, self.rows, self.columns
        unknown = np.r_[nb.nq + np.arange(nb.nu), nb.start["lambda"] + np.arange(nb.m)]
        size, place = len(unknown), np.full(self.assembly.n, -1)
        place[unknown] = np.arange(size)
        K, chosen = part.zeros(size * (size + times)), np.flatnonzero((place[rows] >= 0) & (place[columns] >= 0))
        entry = self.e.fy + chosen + np.where(columns[chosen] < nb.start["lambda"], self.e.nnz, 0)
        part.set(K + place[rows[chosen]] * size + place[columns[chosen]], entry)
        return unknown, place, K + size * size

    def eliminated(self, program: Program) -> None:
        """Add y' = f(t, y), y' - f(t, y), and its Jacobian by the implicit function theorem."""
        n, full, e, i, j = self.n, self.assembly.n, self.e, self.rows, self.columns
        states, rates = np.arange(n), self.solved()
        self._rates(program, full, rates)
        part, out = self.operations.part(rates), self.operations.slots(n)
        part.set(out + states, self.dotted + states)
        part.add(out + states, full + states, -1.0)
        rows = [Entry(f"rate of {of.name}", e.unit) for of, e in zip(program.inputs["y"], program.inputs["yp"], strict=True)]
        program.add("residual", "F(t, y, y') = y' - f(t, y)", ALL, rows, out + states, part)
        part = self.operations.part(rates, e.jacobian_part)
        unknown, place, x = self.matrix(part, n)
        size, J = len(unknown), self.operations.slots(2 * n * n)  # Jacobian of y' - f(t, y), column by column
        part.load(J, np.r_[np.zeros(n * n), np.eye(n).ravel()])
        inside, plain = (np.flatnonzero(found & (j < n)) for found in (place[i] >= 0, (place[i] < 0) & (i < n)))
        part.set(x + j[inside] * size + place[i[inside]], e.fy + inside)
        part.lu(size, x - size * size, x, n)
        part.set(J + j[plain] * n + i[plain], e.fy + plain)
        velocities = unknown[unknown < n]
        column, row = np.repeat(states, len(velocities)), np.tile(velocities, n)
        part.set(J + column * n + row, x + column * size + place[row])
        self._jacobian(program, np.tile(states, n), np.repeat(states, n), J + np.arange(2 * n * n), part)


# -- mass matrix, bias, constraint matrix, gamma


def loose(made: Made, model: Model, rows: list[Row], moved: MovedBodies) -> Made:
    """Operations of the equations with multipliers and constraints on the level of accelerations, without Baumgarte's terms."""
    assembly = Assembly(model, rows, replace(Index1(0.0, "eliminated").spec(), eliminated=False), False, moved)
    fixed = made.fixed | {("", name) for name in assembly.numbering.form_numbers}
    return Made(assembly, assembly.numbering.start["lambda"], fixed)


def beside(made: Made, program: Program, other: Made) -> tuple[Operations, int]:
    """Give the operations of `other` slots of their own, with the same time, parameters and signals. Returns operations that hand
    the time on, and the first of these slots."""
    base, part = made.operations.constant(filled(other.operations, other.numbers)), made.part()
    part.set([base + other.e.at, base + other.e.at + 1], [made.e.at, made.e.at + 1])
    for vector, found in (("p", other.pairs), ("signals", other.signal_pairs)):
        pairs = np.array(found, dtype=np.int64).reshape(-1, 2) + np.array([0, base])
        program.slots[vector] = np.concatenate([program.slots.get(vector, np.zeros((0, 2), dtype=np.int64)), pairs])
    return part, base


def _mechanics(made: Made, program: Program) -> None:
    """Add M, h, G and gamma of M u' + h + G^T lambda = 0, G u' + gamma = 0, u' and lambda being numbered as in the equations."""
    main, other = made.assembly, loose(made, made.assembly.model, made.assembly.numbering.rows, made.assembly.moved)
    part, base = beside(made, program, other)
    nb, e = other.numbering, other.e
    same = np.arange(nb.start["lambda"])
    assert (nb.nq, nb.nu, len(nb.states)) == (main.numbering.nq, main.numbering.nu, len(main.numbering.states))
    part.set(base + same, same)
    loaded = bool(other.assembly.motion())
    steps = other.part(*(() if loaded else (e.residual_part,)), e.jacobian_part).steps
    part.steps += [shifted(step, base) for step in steps]
    u, first = nb.nq + np.arange(nb.nu), nb.start["lambda"]
    names = [name.removeprefix("momentum of ") for name in other.assembly.equations[nb.nq : nb.nq + nb.nu]]
    units = row_units(other.assembly)
    forces = [Entry(f"momentum of {name}", units[i]) for name, i in zip(names, u.tolist(), strict=True)]
    rows = [Entry(name, units[first + i]) for i, name in enumerate(other.assembly.equations[first:])]

    def matrix(name: str, meaning: str, first_row: int, labels: Sequence[str]) -> None:
        cells = np.flatnonzero((other.rows >= first_row) & (other.rows < first_row + len(labels))
                               & (other.columns >= nb.nq) & (other.columns < nb.nq + nb.nu))
        own = part.part(part)
        K = own.zeros(len(labels) * nb.nu)
        own.set(K + (other.rows[cells] - first_row) * nb.nu + other.columns[cells] - nb.nq, base + e.fy + e.nnz + cells)
        entries = [Entry(f"{row} by {column}", "") for row in labels for column in names]
        program.add(name, meaning, STATE, entries, K + np.arange(len(entries)), own, (len(labels), nb.nu))

    matrix("mass_matrix", "M of M u' + h + G^T lambda = 0, row by row", nb.nq, names)
    if rubbing := made.reactive():
        program.missing["bias"] = (f"the friction of {', '.join(map(repr, rubbing))} follows from the multipliers, in which the "
                                   "equations of motion are not linear: residual has it")
    else:
        program.add("bias", "h of M u' + h + G^T lambda = 0: gravity, springs, loads and velocity terms", STATE, forces,
                    base + e.rows + u, part)
    if nb.m:
        matrix("constraint_matrix", "G of G u' + gamma = 0, row by row", first, [row.name for row in nb.rows])
        program.add("gamma", "gamma of G u' + gamma = 0", STATE, rows, base + e.rows + first + np.arange(nb.m), part)


# -- sensors and joint forces


class _Every(NamedTuple):
    """All bodies. part: operations that put their motion into slots, numbered by `numbering` from `base` on; solved: those that
    compute accelerations and multipliers, a text where there are none; arguments: what these depend on."""

    part: Operations
    numbering: Numbering
    base: int
    solved: tuple[Step, ...] | str
    arguments: tuple[str, ...]


def _of_all(made: Made, program: Program, prepared: Prepared, eliminated: bool) -> _Every:
    """All bodies in the equations exported; where not all multipliers are unknowns (recursive joints, nodes that share
    displacements) in equations of their own."""
    moved, model = made.assembly.moved, prepared.model
    if not (moved.trees or moved.sharing.nodes):
        solved = made.solved() if eliminated else made.part()
        return _Every(made.part(), made.numbering, 0, tuple(solved.steps), ALL if made.numbering.m and not eliminated else STATE)
    other = loose(made, model, prepared.mechanics.rows, MovedBodies(model, [], False, open=Open.LAWS))
    steps: list[Step] | str
    if rubbing := made.reactive():
        steps = ("the forces of recursive joints, and of joints that hold beams at their nodes, follow from the accelerations of "
                 f"all bodies, in which the friction of {', '.join(map(repr, rubbing))} by the joint's own force is nonlinear: "
                 "no formula gives them. This is no mistake: residual and jacobian are exported without them")
    else:
        steps = other.solved().steps
    part, base = beside(made, program, other)
    to, from_ = np.array(_motion(made, part, other.numbering), dtype=np.intp).reshape(-1, 2).T
    part.set(base + to, from_)
    solved_steps = steps if isinstance(steps, str) else tuple(shifted(step, base) for step in steps)
    return _Every(part, other.numbering, base, solved_steps, STATE)


def _sensors(every: _Every, program: Program, prepared: Prepared) -> None:
    """Add coordinates of joints with their rates, and motions of bodies, as their sensors show them."""
    part, nb, base, model = every.part.part(every.part), every.numbering, every.base, prepared.model
    names, at = list[Entry](), list[int]()
    for item in model.scene.connections:
        for g, group in enumerate(model.groups):
            p, active = plan(group.derived, coordinate), [i for i, one in enumerate(group.instances) if one.item == item.name]
            if not (p.targets and active):
                continue
            values = p.kernel.emit(part, nb.gather(g, p.all_inputs, active[:1]) + base).ravel()
            rates = {of: name for name, of in rates_of(item).items()}
            for (head, name), slot in zip(p.targets, values.tolist(), strict=True):
                if name in rates:
                    own, unit = (name, item.unit(name)) if head == "c" else (rates[name], rate_of(item.unit(name)))
                    names.append(Entry(f"{item.name}.{own}", unit))
                    at.append(slot)
    for body in model.scene.bodies:
        if (node := model.node(body)) is None:
            continue
        for quantity, head, unit in ("position", "q", "m"), ("velocity", "u", "m/s"):
            for i in range(node.kind.translations):
                names.append(Entry(f"{body.name}.{quantity}[{i}]", unit))
                at.append(base + nb.node_place(head, node, i))
    if names:
        program.add("sensors", "coordinates of joints, motions of bodies (centre of mass, inertial axes)", STATE, names, at, part)


def _joint_forces(every: _Every, program: Program, prepared: Prepared) -> None:
    """Add force and torque on l of every joint and force element."""
    items = [c.name for c in prepared.model.scene.connections]
    if isinstance(every.solved, str):
        program.missing["joint_forces"] = every.solved
    elif items:
        part = every.part.part(every.part)
        part.steps += every.solved
        out = part.zeros(6 * len(items))
        _emit_reactions(part, every.numbering, every.base, out, items)
        shared = shared_reactions(prepared)
        names = [Entry(f"{item}.{'torque' if i > 2 else 'force'}[{i % 3}]", "N m" if i > 2 else "N",
                       note=SHARED if (item, i) in shared else "") for item in items for i in range(6)]
        program.add("joint_forces", "force and torque (about the joint) on body l, inertial components", every.arguments, names,
                    out + np.arange(6 * len(items)), part)


def _motion(made: Made, part: Operations, every: Numbering) -> list[tuple[int, int]]:
    """Pairs of slots (to, from): positions, velocities and states in the numbering of all nodes (`every`), and what they are
    copied from, unknowns of the exported equations or values that follow from joint coordinates."""
    nb, moved, model = made.numbering, made.assembly.moved, made.assembly.model
    found = [(every.node_place(head, node, i), nb.node_place(head, node, i))
             for node in model.nodes if node not in moved.nodes
             for head, size in zip("qu", node.kind.sizes, strict=True) for i in range(size)]

    def to(node: Node, head: str, i: int) -> int:
        slot = part.slots(1)
        if head != "up":
            found.append((every.node_place(head, node, i), slot))
        return slot

    moved.motion(part, nb, to)
    place = {name: nb.start["s"] + i for i, name in enumerate(nb.states.values())}
    return [*found, *((every.start["s"] + i, place[name]) for i, name in enumerate(every.states.values()))]


def _emit_reactions(part: Operations, nb: Numbering, base: int, out: int, items: list[str]) -> None:
    """Add the reactions of all laws to the outputs of their items. base: the first slot of the numbering `nb` in the work array;
    out: the first slot of the outputs, six per item."""
    for g, group in enumerate(nb.model.groups):
        p, active = plan(group.derived, reaction_outputs), [i for i, one in enumerate(group.instances) if one.item in items]
        if p.targets and active:
            values = p.kernel.emit(part, nb.gather(g, p.all_inputs, active) + base)
            to = [[out + 6 * items.index(group.instances[i].item) + t[1] for t in p.targets] for i in active]
            part.add(to, values)
