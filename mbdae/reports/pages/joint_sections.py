"""Sections of a joint's report: coordinates and their motion; solution set of the rows, found from random attitudes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.documents.blocks import Block, Paragraph, Section, Table
from mbdae.notation import counted
from mbdae.reports.law_page import LawPage
from mbdae.reports.letters import specs_of_coordinates, unit_text, worded
from mbdae.reports.page import DERIVED, row_name, title_of
from mbdae.reports.statement import Statement
from mbdae.reports.states import State, random_state
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.motion import AXES, Motion, Step, motion_of, no_rotation


def title_of_joint(s: Statement) -> str:
    """The name of the joint, and whether its coordinates are unknowns."""
    cls = s.cls
    title = title_of(cls) if "oint" in cls.__name__ or not issubclass(cls, Joint) else f"{title_of(cls)} joint"
    if issubclass(cls, Joint) and s.places and not cls.must_keep():
        title += f", {'its coordinate an unknown' if len(s.places) == 1 else 'its coordinates unknowns'}"
    return title


def other_statements(s: Statement) -> list[Block]:
    """Sentence on how to get reports of the joint with other options."""
    cls = s.cls
    if not issubclass(cls, Joint) or not cls.coordinates:
        return []
    call, said = f"mb.report({cls.__name__}", []
    if not cls.must_keep():
        word = "without" if s.places else "with"
        said.append(f"`{call}, kept={not s.places})` reports the joint {word} its coordinates as unknowns")
        call += ", kept=True" * bool(s.places)
    if s.law.friction is None and cls.scalars():
        said.append(f"`{call}, friction=mb.Coulomb(...))` with friction by its own reaction")
    if any(name in s.rows for name in cls.drives()):
        said.append(f"`{call}, {next(iter(cls.drives()))}=None)` without that prescribed motion")
    return [Paragraph(f"Other statements: {'; '.join(said)}.")] if said else []


def motion_in(s: Statement) -> Motion | None:
    """Motion of a joint in a statement's symbols; None if the joint states none, or has a free rotation that is no unknown."""
    if not isinstance(s.law, Joint):
        return None
    symbols: dict[str, Any] = {name: s.values.get(name, s.symbol(name)) for name in s.law.coordinates}
    symbols |= {name: s.values.get(name, no_rotation()) for name in s.law.coordinates.keys() - s.law.scalars().keys()}
    return motion_of(s.law, symbols)


def coordinates_section(r: LawPage) -> list[Section]:
    """Section with table of coordinates, elementary motions, and coordinates as functions of the frames; empty without them."""
    specs, motion, blocks = specs_of_coordinates(r.s.law), motion_in(r.s), list[Block]()
    if not specs and motion is None:
        return []
    if specs:
        rows = [[f"`{name}`", f"${r.known[name].latex}$", _unit(spec.unit), worded(spec.meaning)] for name, spec in specs.items()]
        if not isinstance(r.s.law, Joint):
            said = "The coordinates are those of joints."
        elif r.s.places:
            said = "The coordinates are unknowns of the equations."
        else:
            said = "The coordinates are no unknowns of the equations: they are read from the frames."
        blocks += [Paragraph(said), Table(["name", "symbol", "unit", "meaning"], rows)]
        r.writer.used |= {str(r.s.coordinates.get(name, name)) for name in specs}
    if motion is not None:
        blocks += chain(motion, r, list(specs))
    if r.s.read:
        lines = [r.line(r.known[name].latex, e, r.state.scalar(r.d.coordinates[name]), DERIVED) for name, e in r.s.read.items()]
        blocks += r.told("The coordinates as the frames show them, whether the rows vanish or not:", *lines)
    return [Section("Coordinates and motion", blocks)]


def _unit(unit: str) -> str:
    return "a quaternion; its rates an angular velocity, rad/s" if unit == "rotation" else unit_text(unit)


def chain(motion: Motion, page: LawPage, names: list[str]) -> list[Block]:
    """Table of the elementary motions of a joint, in order."""
    if not motion.steps:
        return [Paragraph("Motion: none, l moves with k.")]
    free, rows = [name for name in names if page.s.law.coordinates[name].unit == "rotation"], []
    for i, step in enumerate(motion.steps, 1):
        if step.rotation is not None:
            rows.append([str(i), "free rotation", "", f"${page.known[free.pop(0)].latex}$"])
        else:
            kind = "rotation about" if step.turns else "displacement along"
            rows.append([str(i), kind, _axis(step), f"${page.writer.scalar(step.amount)}$"])
    text = ("Motion, from the frame of k to that of l: elementary motions one after the other, each along or about an axis of the"
            " frame reached by those before it.")  # fmt: skip
    return [Paragraph(text), Table(["", "motion", "axis", "amount"], rows)]


def _axis(step: Step) -> str:
    named = next((name for name, unit in AXES.items() if list(unit) == list(step.axis)), None)
    return named or f"({', '.join(f'{float(c):.6g}' for c in step.axis)})"


# -- solution set of the rows

STARTS = 60  #: number of random attitudes from which the rows are solved


def _moved(r: LawPage) -> list[str]:
    """Rows that depend on the motion of l; the other rows prescribe coordinates that are unknowns."""
    return [row for row, (pairs, _) in r.s.gradients.items() if any(part.terms for part in pairs[r.s.sides[1]])]


def _rows(r: LawPage, state: State, rows: list[str]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Values (points, rows) of some rows and derivatives (points, rows, 6) by displacement and rotation of l."""
    n, shape, side = r.numbers(state), (state.points, 3), r.s.sides[1]
    c = [np.broadcast_to(n.scalar(r.s.rows[row]), shape[:1]) for row in rows]
    with np.errstate(all="ignore"):
        J = [[np.broadcast_to(n.vector(part), shape) for part in r.s.gradients[row][0][side]] for row in rows]
    return np.stack(c, axis=-1), np.stack([np.concatenate(parts, axis=-1) for parts in J], axis=1)


def solved(r: LawPage, rows: list[str]) -> tuple[State, NDArray[Any], NDArray[Any], NDArray[np.bool_]]:
    """Random states with l moved by Gauss-Newton (steps up to 0.7 rad) until some rows vanish: states, rows, derivatives, and
    whether the rows vanish; where a row is undefined l is not moved."""
    state = random_state(r.d, seed=11, points=STARTS, spread=3.0)
    for _ in range(60):
        c, J = _rows(r, state, rows)
        if np.max(np.abs(c)) < 1e-13:
            break
        J[~np.isfinite(J).all(axis=(1, 2))] = 0.0
        step = -np.einsum("pij,pj->pi", np.linalg.pinv(J, rcond=1e-9), c)
        turn = step[:, 3:]
        turn = turn * np.minimum(1.0, 0.7 / np.maximum(np.linalg.norm(turn, axis=1, keepdims=True), 1e-300))
        state = state.changed(1.0, {r.s.sides[1]: (step[:, :3], turn)})
    c, J = _rows(r, state, rows)
    return state, c, J, (np.abs(c) < 1e-9).all(axis=1) & np.isfinite(J).all(axis=(1, 2))


def solution_set(r: LawPage) -> list[Block]:
    """Rank and degrees of freedom on the solution set, and the unwanted solutions of the rows."""
    if not _moved(r):
        return [Paragraph("No row depends on the motion of l.")]
    state, _, J, reached = solved(r, _moved(r))
    blocks, wrong, n = _told(r, J[reached]), np.zeros(STARTS, dtype=bool), r.numbers(state)
    if not r.s.branches:
        return [*blocks, Paragraph("The rows have no unwanted branch.")]
    blocks.append(Paragraph("The rows alone allow the opposite orientation too; on the wanted branch:"))
    for i, (name, e) in enumerate(r.s.branches.items()):
        wrong |= np.broadcast_to(n.scalar(e), (STARTS,)) <= 0
        blocks += r.lines(f"b_{{{i + 1}}} = {r.writer.scalar(e)} > 0", note=name)
    text = f"{int((wrong & reached).sum())} of the {reached.sum()} solutions lie on an unwanted branch; no run starts there."
    return [*blocks, *([Paragraph(text)] if np.any(reached) else [])]


def _told(r: LawPage, J: NDArray[Any]) -> list[Block]:
    """Rank of the Jacobians at the solutions and the remaining motions; or which rows have no solution."""
    moved = _moved(r)
    fixed = [row_name(row) for row in r.s.rows if row not in moved]
    rows = f"The row {fixed[0]} contains" if len(fixed) == 1 else f"The rows {', '.join(fixed)} contain"
    given = f" {rows} no motion of l but coordinates that are unknowns, which keep random values here." if fixed else ""
    if not len(J):
        never = [row_name(row) for row in moved if not np.any(solved(r, [row])[-1])]
        why = f"nowhere does {' or '.join(never)} vanish" if never else "they never vanish together"
        return [Paragraph(f"From none of {STARTS} random attitudes were the rows solved by moving l alone: {why}.{given}")]
    rank = int(np.linalg.matrix_rank(J, tol=1e-7).max())
    count = sum(bool(np.any(np.abs(J[:, i]) > 1e-12)) for i in range(J.shape[1]))
    free, (depend, have) = 6 - rank, ("depends", "has") if count == 1 else ("depend", "have")
    text = (f"The rows were solved from {STARTS} random attitudes of l by moving l alone; {len(J)} reached a solution."
            f" There the {counted(count, 'row')} that {depend} on the motion of l {have} rank {rank}:"
            f" {counted(free, 'relative motion')} of the bodies {'is' if free == 1 else 'are'} left.{given}")  # fmt: skip
    return [Paragraph(text)]
