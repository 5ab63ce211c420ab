"""Numbers of unknowns, equations and operations of a scene, from the naive formulation to the one integrated by default.

The naive formulation: in space, classical joints with their coordinates, all rows of all joints, no shared unknowns.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace

from mbdae.errors import MbdaeError
from mbdae.formulations import GGL, system_for
from mbdae.kernels.plan import linearised_plan
from mbdae.kernels.tree_plan import tree_plan
from mbdae.run.choice import Choice
from mbdae.scene.components import Classical
from mbdae.scene.models import refusal
from mbdae.scene.scene import SceneData
from mbdae.scene.variants import may_be_recursive, replaced
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.model.model import Model, build
from mbdae.system.model.moved_bodies import MovedBodies
from mbdae.system.model.numbering import Row, constraint_rows
from mbdae.system.model.trees import find_trees
from mbdae.system.motion.ordered_tree import ordered_size
from mbdae.system.prepare import Prepared
from mbdae.system.without_multipliers import WithoutMultipliers


@dataclass(frozen=True)
class Size:
    """Size of a system: numbers of unknowns, of equations, of multipliers (lambda and mu), of kernels (compiled functions of
    laws), and of the arithmetic operations of all kernels for one residual with its derivatives."""

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
                  if (g, i) not in system.moved.replaced and not (idle and (g, i) not in live)]  # fmt: skip
        if active:
            p = linearised_plan(d, system.spec.outputs)
            own = (p.residual.operations if p.nonlinear else 0) + (p.jacobian.operations if p.jacobian_places else 0)
            kernels += bool(p.nonlinear) + bool(p.jacobian_places)
            operations += own * len(active)
    trees = system.moved.trees
    if system.moved.ordered:
        sizes = [ordered_size(system.moved, system.numbering, tree) for tree in trees]
        kernels, operations = kernels + sum(k for k, _ in sizes), operations + sum(o for _, o in sizes)
    else:
        kernels += 2 * len({tree.structure for tree in trees})
        operations += sum(tree_plan(tree.structure).operations for tree in trees)
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
    has = {"gravity": bool(scene.gravity.any()), "friction": rubbing, "contact": any(c.loose for c in scene.joints),
           "values prescribed in time": timed}  # fmt: skip
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
                              ("without unknowns for joint coordinates", ())):  # fmt: skip
        try:
            of = build(replaced(spatial, classical, Classical()) if classical else spatial, by_rows)
            yield reason, whole(of, constraint_rows(of))
        except MbdaeError:  # this reduction is left out: some laws of the scene exist only in the plane
            continue
    of = build(scene, by_rows)
    rows = constraint_rows(of)
    yield f"planar: {model.why}" if of.planar else "as stated", whole(of, rows)
    redundant = {row.name for row in prepared.rank.dropped}
    rows = [row for row in rows if row.name not in redundant]
    yield "redundant constraint equations left out", whole(of, rows)
    rigid = build(scene, {c.name: "" for c in scene.joints if c.recursive} | model.stay_kinematic)
    rows = [row for row in constraint_rows(rigid) if row.name not in redundant]
    trees = find_trees(rigid)
    yield "welded bodies, and points held by a joint, move with the other body", Assembly(
        rigid, rows, spec, moved=MovedBodies(rigid, trees, share=False))  # fmt: skip
    yield "nodes that meet share unknowns, or are fixed to the ground", Assembly(
        rigid, rows, spec, moved=MovedBodies(rigid, trees))  # fmt: skip
    yield "recursive joints: their coordinates are the only unknowns", Assembly(
        model, prepared.mechanics.rows, spec, moved=prepared.all_bodies.moved)  # fmt: skip
