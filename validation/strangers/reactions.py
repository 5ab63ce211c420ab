"""Forces and torques of joints, springs and contacts by the reference: multipliers times their rows, and loads on coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
from strangers.bodies import JOINTS, Array
from strangers.dense import Reference
from strangers.story import Said, Story

FACTOR = 10.0  #: an error up to so many times the accuracy counts as right, as between two runs
#: errors of the reference, over the force that moves the scene by its length in its characteristic time, or in the run
NO_FORCE = 1e-6
NEAR = 1e-9  #: part of the run beside jumps that is not looked at


def error_of_reactions(reference: Reference, times: Array, states: list[Array], result: Any) -> float:
    """Largest error of force and torque on l of everything between two bodies, over the largest force, torques over the length,
    as accuracy counts them; 0 where the run does not cover them. Left out: what redundant rows share, scenes with controllers."""
    story, ends = reference.story, np.array(reference.instants())
    if "reactions" not in result.accuracy.covers or story.of("controller"):
        return 0.0
    inside = np.min(np.abs(times[:, None] - ends), axis=1) > NEAR * story.t_end
    apart, sizes, shown, length = [0.0], [0.0], result(times[inside]), result.prepared.length
    sensors = [(a, shown[a.name]) for a in between(story)]
    unique = [bool(np.all(getattr(sensor, "reaction_is_unique", True))) for _, sensor in sensors]
    read = [(sensor.force, sensor.torque) for _, sensor in sensors]
    for i, j in enumerate(np.flatnonzero(inside)):
        k = int(np.searchsorted(ends, times[j])) - 1
        reference.between(ends[k], ends[k + 1])
        exact = wrenches(reference, float(times[j]), states[j], [a for a, _ in sensors])
        for (a, _), (F, M), (f, m), sure in zip(sensors, read, exact, unique, strict=True):
            sizes.append(max(float(np.linalg.norm(F[i])), float(np.linalg.norm(M[i])) / length))
            turned = (M[i] - m)[2:] if result.prepared.model.planar else M[i] - m
            gap = [float(np.linalg.norm(F[i] - f))] + [float(np.linalg.norm(turned)) / length] * (a.verb in JOINTS)
            apart += gap if sure else []
    least = NO_FORCE * float(np.max(reference.w.mass)) * length / min(result.prepared.time, story.t_end) ** 2
    return max(apart) / max(*sizes, least)


def between(story: Story) -> list[Said]:
    """Statements whose force is known: those between bodies but joints that couplings act on."""
    couplings = story.of("gear", "rack", "couple")
    coupled = {str(v).split(".")[0] for a in couplings for v in [*a.args.values(), *a.args.get("of", ())]}
    return [a for a in story.statements if "k" in a.args and "l" in a.args and a.name not in coupled]


def wrenches(reference: Reference, t: float, y: Array, asked: list[Said]) -> list[tuple[Array, Array]]:
    """Force and torque (3,) on l about l's point of every statement asked for."""
    w, n = reference.w, reference.n
    m, c, found = reference.moved(y), y[13 * n :], []
    multipliers = reference.accelerations(t, m, c)[1]
    kept = reference.kept if reference.kept is not None else np.zeros(0, dtype=int)
    for a in asked:
        total = np.zeros((n + 1, 6))
        own = [i for i, row in enumerate(kept) if w.owners[row] == a.name]
        if own:
            total += (multipliers[own] @ reference.A[kept[own]] @ m.J).reshape(total.shape)
        for owner, force in zip(reference.loads.owners, reference.loads.all, strict=True):
            if owner == a.name:
                force(t, m, c, total)
        l = w.number(a.args["l"])
        at = a.args.get("at_l", a.args.get("at"))
        r = m.R[l] @ (np.zeros(3) if at is None else w.inside(l, at))
        found.append((total[l, :3], total[l, 3:] - np.cross(r, total[l, :3])))
    return found
