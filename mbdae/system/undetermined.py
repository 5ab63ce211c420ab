"""Checks for what the equations of motion leave undetermined: motions without inertia, and friction by a reaction that is not
unique because of redundant constraints; and for prescribed motions that contradict each other or the joints."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
import symengine as se

from mbdae.deferred import LinearOperator, as_full, eigsh, sp, splu
from mbdae.errors import SceneError, StartError
from mbdae.scene.components import Body
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.dependent_rows import smallest, unit_rows
from mbdae.system.model.model import Model
from mbdae.system.model.nodes import Node
from mbdae.system.motion import AllBodies
from mbdae.system.motion.constrained import row_lengths
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.redundancy import RankReport, null_space
from mbdae.system.start import Start, Starter

#: velocities of all bodies over the rates of a motion without inertia (norms), and over the largest derivative of a velocity by a
#: rate or 1, whichever is larger, up to which the motion is said to move no body
STILL = 1e-10
UNLIKE = 1e6  #: largest factor of a coupling, over the smallest or 1, whichever is smaller, above which rounding is blamed
#: inertia of a motion, over that of the displacements it consists of, up to which the motion counts as having none; in large
#: scenes up to about 100 times this
NOTHING = 1e-13
INERT = 1e-9  #: least moment of inertia of a body, over its largest, that is surely more than round-off


def all_inert(model: Model, known: Collection[Body] = ()) -> bool:
    """Whether every motion of every body has inertia, so that all motions of the scene have. known: bodies all of whose motions
    have."""
    bodies = [b for _, b in model.bodies if b not in known]
    J = [b.inertia for b in bodies if b.inertia is not None]
    return all(b.mass > 0 for b in bodies) and all(
        (j[2, 2] if model.planar else np.linalg.eigvalsh(j)[0]) > INERT * j.max() for j in J)


def massless_coordinates(all_bodies: AllBodies, mass: Array, t: Array, q: Array) -> list[str]:
    """Error messages, one sentence each, for coordinates of recursive joints whose motion has no inertia: the mass matrix in
    joint coordinates, scaled to a unit diagonal, has an eigenvalue 0 there. mass (nu, nu): mass matrix of all nodes."""
    T = all_bodies.velocity_map(t, all_bodies.reduced(q[None], np.zeros((1, all_bodies.model.nu)))[0])[0]
    reduced = T.T @ mass @ T
    size = np.sqrt(np.diag(reduced))
    largest = float(np.max(size, initial=0.0))
    names = all_bodies.numbering.names()[all_bodies.nq :]
    lost = [np.eye(len(size))[i] for i in np.flatnonzero(size <= 1e-12 * largest)]
    if not lost and len(size):
        values, vectors = np.linalg.eigh(reduced / np.outer(size, size))
        lost = [vectors[:, i] / size for i in np.flatnonzero(values <= 1e-13)]
    joints: dict[str, list[str]] = {}
    for node in all_bodies.model.joint_coordinates:
        joints.setdefault(node.joint, []).append(node.coordinate)
    moved = np.ones(len(T), dtype=bool)
    moved[[n.u + i for n in all_bodies.model.joint_coordinates for i in range(n.kind.sizes[1])]] = False
    return [_no_inertia(names[int(np.argmax(np.abs(motion)))], joints, _is_still(T[moved], motion)) for motion in lost]


def massless_unknowns(all_bodies: AllBodies, lost: Sequence[int]) -> list[str]:
    """Error messages, one sentence each, for the velocity unknowns with the numbers `lost`, which have no inertia."""
    names, joints = all_bodies.numbering.names()[all_bodies.nq :], dict[str, list[str]]()
    for node in all_bodies.model.joint_coordinates if lost else ():
        joints.setdefault(node.joint, []).append(node.coordinate)
    return [_no_inertia(names[k], joints, False) for k in lost]


def _is_still(T: Array, motion: Array) -> bool:
    """Whether a motion (rates of the unknowns) moves no body; T: velocities of all bodies by those rates."""
    return bool(np.linalg.norm(T @ motion) <= STILL * np.linalg.norm(motion) * max(1.0, float(np.max(np.abs(T), initial=0.0))))


def _no_inertia(rate: str, joints: dict[str, list[str]], still: bool) -> str:
    """The message on a motion without inertia. rate: name of the velocity unknown that moves most; joints: name of a joint -> its
    coordinates; still: whether the motion moves no body."""
    name, _, unknown = rate.rpartition(".")
    if name in joints and still:
        named = [c for c in joints[name] if unknown == f"{c}_rate"]
        return _undetermined(name, (named or joints[name])[0])
    if name in joints:
        return (f"joint '{name}': what it moves has no inertia about or along its axis; give the bodies "
                f"behind it mass or inertia, or prescribe its coordinate")
    return f"body '{name}' can move without any inertia: give it mass or inertia, or a joint that stops this motion"


def massless_motions(mechanics: Mechanics, report: RankReport, t: Array, q: Array) -> list[str]:
    """Error messages, one sentence each, for bodies with a motion that the constraints allow and that has no inertia."""
    kept = Mechanics(mechanics.model, report.kept)
    if mechanics.large:
        return _massless_sparse(kept, t, q)
    G = kept.constraint_jacobian(t, q[None])[0]
    own = np.ones(kept.nu, dtype=bool)
    for node in (n for line in kept.model.lines for n in line.nodes):  # nodes of beams have mass: only constrained ones count
        own[node.u : node.u + node.kind.sizes[1]] = np.any(G[:, node.u : node.u + node.kind.sizes[1]])
    at = np.flatnonzero(own)
    unit, N = kept.velocity_units[at], null_space(G[:, at] * kept.velocity_units[at])
    mass = kept.mass[at][:, at]
    M = unit[:, None] * as_full(mass) * unit
    if not N.size:
        return []
    values, vectors = _compared(N.T @ M @ N, N.T @ (_own_inertia(np.diag(M))[:, None] * N))
    motions = np.zeros((len(values), kept.nu))
    motions[:, at] = (N @ vectors).T
    return [_name_motion(kept, G, motions[i]) for i in np.flatnonzero(values <= NOTHING)]


def _massless_sparse(mechanics: Mechanics, t: Array, q: Array) -> list[str]:
    """As `massless_motions`, for many bodies: a motion without inertia that the rows allow is a null vector of M + B^T B, where
    every coordinate is scaled to inertia 1 and every row of B to length 1."""
    units, G = mechanics.velocity_units, mechanics.constraint_matrix(t, q)
    M = sp.diags(units) @ mechanics.mass @ sp.diags(units)
    scale = units / np.sqrt(_own_inertia(M.diagonal()))
    B = G @ sp.diags(scale)
    B = sp.diags(1 / row_lengths(B)[:, 0]) @ B
    K = sp.csc_matrix(sp.diags(scale) @ mechanics.mass @ sp.diags(scale) + B.T @ B)
    shifted = splu(K + NOTHING * sp.identity(len(units), format="csc"), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                   options={"SymmetricMode": True})
    inverse = LinearOperator(K.shape, matvec=shifted.solve, dtype=float)
    start = np.random.default_rng(5).normal(size=len(units))
    values, motions = eigsh(inverse, k=min(6, len(units) - 1), which="LA", v0=start, tol=1e-3)
    lost = motions[:, values > 1 / (100 * NOTHING)]
    return [_name_motion(mechanics, G.toarray() if mechanics.model.joint_coordinates else G, v * scale) for v in lost.T]


def _own_inertia(diagonal: Array) -> Array:
    """The inertia of every unit displacement alone, the diagonal of the mass matrix; where it is 0, the largest of them
    instead."""
    return np.where(diagonal > 0, diagonal, max(float(np.max(diagonal, initial=0.0)), 1e-300))


def _compared(reduced: Array, own: Array) -> tuple[Array, Array]:
    """Inertia of motions relative to the inertia of the displacements that they consist of, so that small and large bodies are
    treated alike; and these motions (columns). It solves the eigenvalue problem reduced x = value own x."""
    scale = 1 / np.sqrt(np.diag(own))
    # transformation to coordinates in which `own` is the identity
    inverse = np.linalg.inv(np.linalg.cholesky(scale[:, None] * own * scale)) * scale
    values, vectors = np.linalg.eigh(inverse @ reduced @ inverse.T)
    return values, inverse.T @ vectors


def _name_motion(mechanics: Mechanics, G: Array, motion: Array) -> str:
    worst = int(np.argmax(np.abs(motion)))
    for node in mechanics.model.nodes:
        if node.u <= worst < node.u + node.kind.sizes[1]:
            if node.kind.of_joint:
                return _undetermined_coordinate(mechanics, G, node)
            how = _motion_in_words(motion[node.u : node.u + node.kind.sizes[1]], worst - node.u, node.kind.translations)
            stated = not mechanics.model.planar and any(b.principal_plane for n, b in mechanics.model.bodies if n is node)
            flat = "; inertia that is one number counts about z alone, in space give three" if stated else ""
            return (f"body '{node.name}' can {how} without any inertia: "
                    f"give it mass or inertia, or a joint that stops this motion{flat}")
    raise SceneError(["a motion of the bodies has no inertia (the mass matrix is singular): give every body mass and inertia"])


def _undetermined_coordinate(mechanics: Mechanics, G: Array, node: Node) -> str:
    """The message on a joint coordinate that is an unknown but is determined by no equation. G: constraint Jacobian."""
    instances = [i for group in mechanics.model.groups for i in group.instances if i.item == node.joint]
    if any(n is not None and not n.kind.oriented for i in instances for n in i.nodes):
        return (f"joint '{node.joint}': its {node.coordinate} is an unknown that nothing determines: a point mass has no "
                f"orientation; use model=mb.Kinematic(), or s.rigid_body")
    coordinates = [n.u for n in mechanics.model.joint_coordinates]
    for row, entries in zip(mechanics.rows, G, strict=True):
        sizes = np.abs(entries[entries != 0])
        coupled = entries[node.u] != 0 and np.count_nonzero(entries[coordinates]) == len(sizes) > 1
        if coupled and np.max(sizes) > UNLIKE * min(1.0, np.min(sizes)):
            return (f"coupling '{row.name.rpartition('.')[0]}': its factors are from {np.min(sizes):.3g} to {np.max(sizes):.3g}: "
                    f"beside the largest a factor of 1 is lost by rounding, so that nothing determines the {node.coordinate} of "
                    f"joint '{node.joint}'; give factors near 1")
    return _undetermined(node.joint, node.coordinate)


def _undetermined(joint: str, coordinate: str) -> str:
    return (f"joint '{joint}': its {coordinate} is an unknown that nothing determines where the scene is drawn: its motion does "
            f"not change with {coordinate} there (a derivative of 0, or two coordinates that do the same); start from another "
            f"value, or state the motion otherwise")


def _motion_in_words(motion: Array, worst: int, n: int) -> str:
    """The motion of a node in words, "move along ..." or "turn about ...". motion: its velocities, the first n of them
    translations; worst: number of the largest one."""
    part = motion[:n] if worst < n else motion[n:]
    part = part * np.sign(motion[worst]) / np.linalg.norm(part)
    direction = ", ".join(f"{c:.2g}" for c in np.where(np.abs(part) < 1e-9, 0.0, part))
    if worst < n:
        return f"move along ({direction})"
    return "turn" if len(part) == 1 else f"turn about ({direction}) in body axes"


def normal_force_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """For joints whose friction follows from their reactions: magnitude of the derivative of the normal force by each
    multiplier."""
    if not d.reactive:
        return []
    v = d.variation
    if d.pressing is None:  # the friction of a user's own law may depend on any of its reactions
        return [(("counts", j), se.Integer(1)) for j in range(len(d.rows))]
    pressing = [v.name(c) for c in d.pressing]
    return [(("counts", j), v.resolve(sum(v.diff(c, s) ** 2 for c in pressing) ** 0.5)) for j, s in enumerate(d.multipliers)]


def undecided(mechanics: Mechanics, rank: RankReport, t: Array, q: Array) -> list[str]:
    """Error messages, one sentence each, for joints whose friction depends on a reaction that redundant constraints leave
    undetermined."""
    if not (mechanics.reactive and rank.not_unique):
        return []
    shared = {(r.group, r.instance, r.row): r.name for r in rank.not_unique}
    found = []
    state = t, q[None], np.zeros((1, mechanics.nu))
    for g, p, values in mechanics.evaluate(normal_force_outputs, *state, groups=mechanics.reactive):
        for i, instance in enumerate(mechanics.model.groups[g].instances):
            rows = [shared[g, i, target[1]] for o, target in enumerate(p.targets)
                    if values[0, i, o] > 1e-9 and (g, i, target[1]) in shared]
            if rows:
                found.append(f"joint '{instance.item}': its friction follows from its reaction, but redundant constraints share "
                             f"that reaction ({', '.join(rows)}), which leaves it undetermined; state a scene that is "
                             "planar in the plane z = 0, replace joints of the loop by spherical ones, or for a prismatic "
                             "joint give normal_force")
    return found


SINGULAR = "; the scene starts in a singular position, where rows depend on each other that do not elsewhere: start away from it"
#: prescribed motions that contradict each other after the start are reported only for positions in which the smallest singular
#: value of the rows in force, scaled to unit length, is above this
SOUND = 1e-3
#: the check for contradicting prescribed motions moves the scene in at most FOLLOWED steps over at most half of the run; before
#: the loops are closed again, a step may violate joints by at most NEAR (rad, or over the scene's length)
FOLLOWED, NEAR = 24, 0.2


def contradictions(all_rows: Mechanics, rank: RankReport, start: Start) -> list[str]:
    """Error messages for redundant rows whose rate or acceleration is not 0 at the start: prescribed motions contradict each
    other."""
    t, q, u = np.array([start.t]), start.q[None], start.u[None]
    if not rank.dropped:
        return []
    rate = all_rows.velocity_residual(t, q, u)[0]
    bias = all_rows.constraint_matrix(t, start.q) @ start.acceleration + all_rows.acceleration_bias(t, q, u)[0]
    size = 1.0 + float(np.max(np.abs(start.u), initial=0.0)) ** 2 + float(np.max(np.abs(start.acceleration), initial=0.0))
    dropped = {row.name for row in rank.dropped} - {row.name for row, _ in rank.doubtful}
    found, singular = [], SINGULAR if rank.singular_here else ""
    for row, v, a in zip(all_rows.rows, rate, bias, strict=True):
        if row.name in dropped and max(abs(v), abs(a)) > 1e-7 * size:
            v, a = (value if abs(value) > 1e-7 * size else 0.0 for value in (v, a))
            found.append(f"{_prescribed(all_rows, start.t, start.q)}: row {row.name} depends on the other rows, but they leave "
                         f"it a rate of {v:.4g} and an acceleration of {a:.4g} (m or rad, s) at the start{singular}")
    return found


def _prescribed(all_rows: Mechanics, time: float, q: Array) -> str:
    """That what is prescribed is not possible, by the names of the items that prescribe it, and what to do."""
    rates = all_rows.velocity_residual(np.array([time]), q[None], np.zeros((1, all_rows.nu)))[0]
    names = dict.fromkeys(row.name.rsplit(".", 1)[0] for row, rate in zip(all_rows.rows, rates, strict=True)
                          if row.prescribes or rate)
    listed = ", ".join(f"'{name}'" for name in list(names)[:4]) + ", ..." * (len(names) > 4)
    if len(names) == 1:
        return f"the joints do not allow the motion prescribed for {listed} (prescribe another one, or release a joint)"
    return f"the prescribed motions of {listed} contradict each other or the joints (release one of them)"


def later_contradictions(all_rows: Mechanics, mechanics: Mechanics, rank: RankReport, start: Start, end: float) -> list[str]:
    """As `contradictions`, for later times up to `end` (s): positions are followed in short steps; prescribed motions contradict
    each other where the rows in force can be satisfied, but not the redundant ones too."""
    timed = any(i.timed for group in all_rows.model.groups if group.derived.rows for i in group.instances)
    dropped, q, t = {row.name for row in rank.dropped} - {row.name for row, _ in rank.doubtful}, start.q, start.t
    if not (timed and dropped):
        return []
    kept = set(rank.kept)
    together = Mechanics(all_rows.model, [row for row in all_rows.rows if row in kept or row.name in dropped])
    step = 0.01 * (end - start.t)
    for _ in range(FOLLOWED):
        step = min(2 * step, 0.5 * (end - start.t) - (t - start.t))
        while step > 0 and Starter(together, t + step, holding=False).closing_error(q) > NEAR:
            step /= 2
        t += step
        try:
            q = Starter(together, t, holding=False).close(q)
            continue
        except StartError:
            pass
        try:
            q = Starter(mechanics, t, holding=False).close(q)
        except StartError:
            break  # not even the rows in force close: the step was too large for the iteration
        B = unit_rows(mechanics, mechanics.constraint_matrix(np.array([t]), q))
        off = all_rows.position_residual(np.array([t]), q[None])[0]
        for row, g in zip(all_rows.rows, off, strict=True):
            if row.name in dropped and abs(g) > 1e-7 * max(1.0, all_rows.model.length) and smallest(B, B.shape[0]) > SOUND:
                return [f"{_prescribed(all_rows, t, q)}: row {row.name} depends on the other rows, but at t = {t:.4g} s they "
                        f"leave it off by {g:.4g} (m or rad)"]
    return []
