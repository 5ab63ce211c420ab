"""Which constraint rows say nothing new, which motions have no inertia: by rank, in several consistent positions."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mbdae.errors import SceneError, StartError
from mbdae.system.base import Array
from mbdae.system.expansion import Expansion
from mbdae.system.mechanics import Mechanics
from mbdae.system.numbering import Row
from mbdae.system.start import Starter

DEPENDENT = 2e-6  #: residual of a row of unit length against the rows before it: redundant below
CERTAIN, DOUBTFUL = 1e-8, 1e-3  #: between the two: nearly redundant, reported whether kept or left out
SAMPLES = 3


@dataclass
class RankReport:
    """kept and dropped rows, rows nearly redundant (among either), rows dependent at the start only, and the freedoms."""

    kept: list[Row]
    dropped: list[Row] = field(default_factory=list)
    doubtful: list[tuple[Row, float]] = field(default_factory=list)
    singular_here: list[Row] = field(default_factory=list)
    not_unique: list[Row] = field(default_factory=list)  #: rows whose reactions the redundant ones could share
    degrees_of_freedom: int = 0
    smallest: float = 1.0  #: smallest singular value of the kept rows, of unit length


def unit_rows(mechanics: Mechanics, G: Array) -> Array:
    """G over unit displacements (the scene's length, 1 rad), with rows of unit length."""
    B = G * mechanics.velocity_units
    norms = np.linalg.norm(B, axis=1, keepdims=True)
    return np.asarray(B / np.where(norms > 0, norms, 1.0))


def novelty(B: Array) -> Array:
    """(m,) distance of every row (unit length) from the span of the rows before it that are new themselves."""
    basis = np.zeros((0, B.shape[1]))
    out = np.zeros(len(B))
    for i, row in enumerate(B):
        left = row
        for _ in range(2):
            left = left - basis.T @ (basis @ left)
        out[i] = np.linalg.norm(left)
        if out[i] > DEPENDENT:
            basis = np.vstack([basis, left / out[i]])
    return out


def analyse(mechanics: Mechanics, starter: Starter, q: Array) -> RankReport:
    """Rank of the constraints at the start and in `SAMPLES` other consistent positions."""
    if not mechanics.m:
        return RankReport([], degrees_of_freedom=mechanics.nu)
    closing = {c.name for c in starter.tree.closing}
    order = sorted(range(mechanics.m), key=lambda i: mechanics.rows[i].name.rsplit(".", 1)[0] in closing)
    here = novelty(_rows_at(mechanics, starter.t, q)[order])
    dependent = {mechanics.rows[i].name for i, new in zip(order, here, strict=True) if new <= DEPENDENT}
    places = _other_positions(mechanics, starter, q, dependent) if closing else []  # a tree has no dependent rows anywhere
    best = np.max([here, *(novelty(_rows_at(mechanics, starter.t, p)[order]) for p in places)], axis=0)
    report = RankReport([])
    for place, i in enumerate(order):
        row = mechanics.rows[i]
        if best[place] <= DEPENDENT:
            report.dropped.append(row)
            if best[place] > CERTAIN:
                report.doubtful.append((row, float(best[place])))
            continue
        report.kept.append(row)
        if here[place] <= DEPENDENT:
            report.singular_here.append(row)
        elif here[place] < DOUBTFUL:
            report.doubtful.append((row, float(here[place])))
    kept = {row.name for row in report.kept}
    report.kept = [row for row in mechanics.rows if row.name in kept]
    report.degrees_of_freedom = mechanics.nu - len(report.kept)
    rows = [i for i, row in enumerate(mechanics.rows) if row.name in kept]
    here_rows = _rows_at(mechanics, starter.t, q)
    report.smallest = float(np.linalg.svd(here_rows[rows], compute_uv=False)[-1]) if rows else 1.0
    report.not_unique = [mechanics.rows[i] for i in _dependent_on_others(here_rows)] if report.dropped else []
    return report


def _dependent_on_others(B: Array) -> list[int]:
    """Rows whose multiplier can change without any effect: they take part in a dependency."""
    left, sizes, _ = np.linalg.svd(B)
    null = left[:, int(np.sum(sizes > DEPENDENT)) :]
    return [int(i) for i in np.flatnonzero(np.max(np.abs(null), axis=1, initial=0.0) > 1e-6)]


def _rows_at(mechanics: Mechanics, t: Array, q: Array) -> Array:
    return unit_rows(mechanics, mechanics.constraint_jacobian(t, q[None])[0])


def _other_positions(mechanics: Mechanics, starter: Starter, q: Array, dependent: set[str]) -> list[Array]:
    """Consistent positions reached by moving along the freedoms (drives released) and closing the loops again; where
    nearly dependent rows lock the loops, they are released too."""
    free = [row for row in mechanics.rows if not row.name.endswith(".drive")]
    found: list[Array] = []
    for rows in (free, [row for row in free if row.name not in dependent]):
        released = Mechanics(mechanics.model, rows)
        closer = Starter(released, float(starter.t[0]), holding=False)
        freedoms, rng = free_motions(released, closer.t, q, closer), np.random.default_rng(11)
        for _ in range(SAMPLES if freedoms.size else 0):
            direction = freedoms @ rng.normal(size=freedoms.shape[1])
            step = 0.3 * direction / np.max(np.abs(direction)) * closer.units(q)
            try:
                found.append(closer.close(closer.moved(q, step)))
            except StartError:
                continue
        if found or not dependent:
            break
    return found


def free_motions(mechanics: Mechanics, t: Array, q: Array, starter: Starter) -> Array:
    """(coordinates, freedoms) basis of the motions the constraints leave to rigid beams, over unit displacements."""
    G = mechanics.constraint_jacobian(t, q[None])[0]
    return _null_space((G @ starter.rigid.basis(q) if mechanics.model.lines else G) * starter.units(q))


def _null_space(A: Array) -> Array:
    if not len(A):
        return np.eye(A.shape[1])
    _, sizes, V = np.linalg.svd(A, full_matrices=True)
    return np.asarray(V[int(np.sum(sizes > 1e-9 * sizes[0])) :].T)


def massless_coordinates(expansion: Expansion, mass: Array, t: Array, q: Array) -> list[str]:
    """Unknowns of trees of recursive joints whose motion has no inertia, by the condition of the reduced mass matrix with
    a unit diagonal, one sentence each."""
    u = np.zeros((1, expansion.model.nu))
    T = expansion.velocity_map(expansion.workspace(t, *expansion.reduced(q[None], u)))[0]
    reduced = T.T @ mass @ T
    size = np.sqrt(np.diag(reduced))
    largest = float(np.max(size, initial=0.0))
    names = expansion.numbering.names()[expansion.nq :]
    lost = [int(i) for i in np.flatnonzero(size <= 1e-12 * largest)]
    if not lost and len(size):
        values, vectors = np.linalg.eigh(reduced / np.outer(size, size))
        lost = [int(np.argmax(np.abs(vectors[:, i]))) for i in np.flatnonzero(values <= 1e-13)]
    joints = {n.name for n in expansion.model.joint_coordinates}
    return [_no_inertia(names[i].rsplit(".", 1)[0], joints) for i in lost]


def _no_inertia(name: str, joints: set[str]) -> str:
    if name in joints:
        return (f"joint '{name}' cannot be recursive: what it moves has no inertia about or along its axis; give the bodies "
                f"behind it mass or inertia, or prescribe its coordinate")  # fmt: skip
    return f"body '{name}' can move without any inertia: give it mass or inertia, or a joint that stops this motion"


def massless_motions(mechanics: Mechanics, report: RankReport, t: Array, q: Array) -> list[str]:
    """Names of the bodies with a free motion that has no inertia, one sentence each."""
    kept = Mechanics(mechanics.model, report.kept)
    G = kept.constraint_jacobian(t, q[None])[0]
    own = np.ones(kept.nu, dtype=bool)
    for node in (n for line in kept.model.lines for n in line.nodes):  # nodes of beams that nothing holds have mass
        own[node.u : node.u + node.kind.sizes[1]] = np.any(G[:, node.u : node.u + node.kind.sizes[1]])
    at = np.flatnonzero(own)
    unit, N = kept.velocity_units[at], _null_space(G[:, at] * kept.velocity_units[at])
    mass = kept.mass[at][:, at]
    M = unit[:, None] * (mass.toarray() if kept.model.lines else mass) * unit
    reduced = N.T @ M @ N
    if not reduced.size:
        return []
    values, vectors = np.linalg.eigh(reduced)
    largest = max(float(np.max(np.diag(M), initial=0.0)), 1e-300)
    motions = np.zeros((len(values), kept.nu))
    motions[:, at] = (N @ vectors).T
    return [_name_motion(kept, motions[i]) for i in np.flatnonzero(values <= 1e-14 * largest)]


def _name_motion(mechanics: Mechanics, motion: Array) -> str:
    worst = int(np.argmax(np.abs(motion)))
    for node in mechanics.model.nodes:
        if node.u <= worst < node.u + node.kind.sizes[1]:
            how = _motion_in_words(motion[node.u : node.u + node.kind.sizes[1]], worst - node.u, node.kind.translations)
            return (f"body '{node.name}' can {how} without any inertia: "
                    f"give it mass or inertia, or a joint that stops this motion")  # fmt: skip
    raise SceneError(["a motion without inertia could not be named"])


def _motion_in_words(motion: Array, worst: int, n: int) -> str:
    """"move along ..." or "turn about ..." for velocities of one node with n translations, the entry `worst` the largest."""
    part = motion[:n] if worst < n else motion[n:]
    part = part * np.sign(motion[worst]) / np.linalg.norm(part)
    direction = ", ".join(f"{c:.2g}" for c in np.where(np.abs(part) < 1e-9, 0.0, part))
    if worst < n:
        return f"move along ({direction})"
    return "turn" if len(part) == 1 else f"turn about ({direction}) in body axes"
