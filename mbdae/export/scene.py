"""The equations of a scene as a program of functions of (t, y, y', p), made of the operations that integrate it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

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
from mbdae.native.program import Operations
from mbdae.results.sensors import reaction_outputs
from mbdae.scene.components import Kinematic
from mbdae.symbolic.tree_motion import Open
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.nodes import Node
from mbdae.system.model.numbering import Numbering
from mbdae.system.prepare import Prepared, prepare

Index = NDArray[np.intp]
STATE = ("t", "y", "p")
ALL = ("t", "y", "yp", "p")


def scene_program(scene: Any, form: Form | None) -> Program:
    """residual, jacobian and joint_forces of a scene; rates too where the formulation has y' = f(t, y)."""
    prepared = prepare(scene)
    # trees that are evaluated joint by joint have no function to export: their joints are exported as kinematic ones
    if prepared.all_bodies.moved.ordered:
        prepared = prepare(scene.replace(*(c.name for c in prepared.model.recursive), model=Kinematic()))
    system = system_for(prepared, form if form is not None else default_form(prepared))
    full = getattr(system, "full", system.assembly)  # the formulation with multipliers, where they are eliminated
    assembly = Assembly(full.model, full.numbering.rows, full.spec, False, prepared.all_bodies.moved.opened(prepared.model))
    made = _Made(assembly, system.n, assembly.moved.written(assembly.model))
    program = made.program(f"{scene.name}, form {system.label}", system)
    if full is system.assembly:
        e, rows = made.e, list(map(Entry, system.equations, row_units(made.assembly)))
        program.add("residual", "F(t, y, y') = 0", ALL, rows, e.rows + np.arange(made.n), made.part(e.residual_part))
        made._jacobian(program, made.rows, made.columns, e.fy + np.arange(2 * e.nnz), made.part(e.jacobian_part))
        if e.rates_part.steps:
            made._rates(program, e.rates, made.part(e.rates_part))
    else:
        made.eliminated(program)
    _joint_forces(made, program, prepared, full is not system.assembly)
    program.drop_parameters()
    return program


class _Made:
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
        unknown, place, x = self._matrix(part, 1)
        part.add(x + place[unknown], e.rows + unknown, -1.0)
        part.lu(len(unknown), x - len(unknown) ** 2, x)
        plain = np.r_[np.arange(nb.nq), np.arange(nb.nq + nb.nu, first)]
        part.add(n + plain, e.rows + plain, -1.0)
        part.set(np.where(unknown < first, n, 0) + unknown, x + place[unknown])
        return part

    def _matrix(self, part: Operations, times: int) -> tuple[Index, Index, int]:
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
        unknown, place, x = self._matrix(part, n)
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


# -- joint forces


def _joint_forces(made: _Made, program: Program, prepared: Prepared, eliminated: bool) -> None:
    """Add force and torque on l of every joint and force element. Where not all multipliers are unknowns (recursive joints, nodes
    that share displacements) they follow from the accelerations of all bodies."""
    moved = made.assembly.moved
    items = [c.name for c in prepared.model.scene.connections]
    if not items:
        return
    base, arguments, nb = 0, STATE if eliminated else ALL, made.numbering
    try:
        if moved.trees or moved.sharing.nodes:
            part, nb, base = _of_all_bodies(made, program, prepared)
            arguments = STATE
        else:
            part = made.solved() if eliminated else made.part()
    except OptionError as error:
        program.missing["joint_forces"] = str(error)
        return
    out = part.zeros(6 * len(items))
    _emit_reactions(part, nb, base, out, items)
    names = [Entry(f"{item}.{what}[{i}]", unit) for item in items for what, unit in (("force", "N"), ("torque", "N m"))
             for i in range(3)]
    program.add("joint_forces", "force and torque (about the joint) on body l, inertial components", arguments, names,
                out + np.arange(6 * len(items)), part)


def _of_all_bodies(made: _Made, program: Program, prepared: Prepared) -> tuple[Operations, Numbering, int]:
    """Operations that compute accelerations of all bodies and multipliers of all rows, those of recursive joints included; with
    the numbering of these unknowns and its first slot in the work array."""
    model = prepared.model
    if rubbing := made.reactive():
        raise OptionError("the forces of recursive joints, and of joints that hold beams at their nodes, follow from the "
                          f"accelerations of all bodies, in which the friction of {', '.join(map(repr, rubbing))} by the joint's "
                          "own force is nonlinear: no formula gives them. This is no mistake: residual and jacobian are "
                          "exported without them")
    spec = replace(Index1(0.0, "eliminated").spec(), eliminated=False)
    assembly = Assembly(model, prepared.mechanics.rows, spec, False, MovedBodies(model, [], False, open=Open.LAWS))
    fixed = made.fixed | {("", name) for name in assembly.numbering.form_numbers}
    other = _Made(assembly, assembly.numbering.start["lambda"], fixed)
    solved = other.solved()
    base, part = made.operations.constant(filled(other.operations, other.numbers)), made.part()
    part.set([base + other.e.at, base + other.e.at + 1], [made.e.at, made.e.at + 1])
    to, from_ = np.array(_motion(made, part, other.numbering), dtype=np.intp).reshape(-1, 2).T
    part.set(base + to, from_)
    part.steps += [shifted(step, base) for step in solved.steps]
    for vector, found in (("p", other.pairs), ("signals", other.signal_pairs)):
        pairs = np.array(found, dtype=np.int64).reshape(-1, 2) + np.array([0, base])
        program.slots[vector] = np.concatenate([program.slots[vector], pairs])
    return part, other.numbering, base


def _motion(made: _Made, part: Operations, every: Numbering) -> list[tuple[int, int]]:
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
