"""Numerical solution set of the rows of a joint: rank, free motions, and solutions on an unwanted branch."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.documents.blocks import Block, Paragraph
from mbdae.reports.states import State, random_state

STARTS = 60  #: random attitudes from which the rows are solved


def jacobian(r: Any, state: State) -> NDArray[Any]:
    """Derivatives (points, rows, 6) of the rows by displacement and rotation of l."""
    n, out = r.formulas.numbers(state), []
    for pairs, _ in r.duals.values():
        parts = [np.broadcast_to(n.vector(part), (state.points, 3)) for part in pairs[r.s.sides[1]]]
        out.append(np.concatenate(parts, axis=-1))
    return np.stack(out, axis=1)


def solved(r: Any, state: State) -> State:
    """The states with l moved until the rows vanish (Gauss-Newton, steps up to 0.7 rad); where a row is not defined l stays."""
    for _ in range(60):
        n = r.formulas.numbers(state)
        c = np.stack([np.broadcast_to(n.scalar(e), (state.points,)) for e in r.s.rows.values()], axis=-1)
        if np.max(np.abs(c)) < 1e-13:
            break
        with np.errstate(all="ignore"):
            J = jacobian(r, state)
        J[~np.isfinite(J).all(axis=(1, 2))] = 0.0
        step = -np.einsum("pij,pj->pi", np.linalg.pinv(J, rcond=1e-9), c)
        turn = step[:, 3:]
        turn = turn * np.minimum(1.0, 0.7 / np.maximum(np.linalg.norm(turn, axis=1, keepdims=True), 1e-300))
        state = state.changed(1.0, {r.s.sides[1]: (step[:, :3], turn)})
    return state


def solution_set(r: Any) -> list[Block]:
    """Rank and degrees of freedom on the solution set, and the unwanted solutions of the rows."""
    state = solved(r, random_state(r.d, seed=11, points=STARTS, spread=3.0))
    n = r.formulas.numbers(state)
    c = np.max([np.abs(np.broadcast_to(n.scalar(e), (STARTS,))) for e in r.s.rows.values()], axis=0)
    reached = c < 1e-9
    with np.errstate(all="ignore"):
        J = jacobian(r, state)
    reached &= np.isfinite(J).all(axis=(1, 2))
    J = J[reached]
    blocks, wrong = _told(r, J), np.zeros(STARTS, dtype=bool)
    if not r.s.branches:
        return [*blocks, Paragraph("The rows have no unwanted branch.")]
    blocks.append(Paragraph("The rows alone allow the opposite too; required is:"))
    for i, (name, e) in enumerate(r.s.branches.items()):
        wrong |= np.broadcast_to(n.scalar(e), (STARTS,)) <= 0
        blocks += r.formulas.lines(f"b_{{{i + 1}}} = {r.formulas.writer.scalar(e)} > 0", note=name)
    if not len(J):
        return blocks
    count = int((wrong & reached).sum())
    return [*blocks, Paragraph(f"{count} of the {len(J)} solutions lie on an unwanted branch; a start refuses them.")]


def _told(r: Any, J: NDArray[Any]) -> list[Block]:
    """The rank of the Jacobians at the solutions, and the motions that are left."""
    if not len(J):
        return [Paragraph(f"From none of {STARTS} random attitudes were the rows solved by moving l alone.")]
    rank = int(np.linalg.matrix_rank(J, tol=1e-7).max())
    count = len(r.s.rows) - sum(not np.any(np.abs(J[:, i]) > 1e-12) for i in range(J.shape[1]))
    free, motions = 6 - rank, ("motion", "motions")
    text = (
        f"The rows were solved from {STARTS} random attitudes of l by moving l alone; {len(J)} reached a solution."
        f" There the {count} rows that depend on the motion of l have rank {rank}: {free} relative {motions[free != 1]} of the"
        f" bodies {'is' if free == 1 else 'are'} left."
    )
    return [Paragraph(text)]
