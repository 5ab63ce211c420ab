"""Axes along and about which a joint lets l move, from its motion: its reactions do no work along and about them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import symengine as se

from mbdae.errors import LawError
from mbdae.notation import counted
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.motion import Motion, Step, Triad, symbolic_motion
from mbdae.symbolic.vectors import ZERO, Vec


def free_axes(law: Any, k: Frame, l: Frame, coordinate: str) -> list[Vec]:
    """Unit vectors, inertial, along which reactions do not press the rubbing surfaces together: the axis of the coordinate with
    friction, and the directions in which any coordinate slides l, each once. An axis of rotation is left out where all of them
    together would span space."""
    motion = symbolic_motion(law)
    assert motion is not None
    own = [i for i, step in enumerate(motion.steps) if se.Symbol(coordinate) in step.amount.free_symbols]
    if len(own) != 1:
        raise LawError(f"friction on '{coordinate}' of a {type(law).__name__}: {counted(len(own), 'step')} of its motion "
                       f"{'contains' if len(own) == 1 else 'contain'} this coordinate, where one is needed to tell which part of "
                       f"the joint's force presses the surfaces together: state `pressing(self, k, l, force)` in its class, or "
                       f"give normal_force=... (N)")  # fmt: skip
    slides = [i for i, step in enumerate(motion.steps) if not step.turns and step.amount.free_symbols & _names(law)]
    found: list[Vec] = []
    for i in (own[0], *slides):
        axis = _axis(law, k, l, motion.steps, i)
        if not any(all(a == b for a, b in zip(axis, other, strict=True)) for other in found):
            found.append(axis)
    # a planar joint is pressed by the reaction along its axis of rotation
    return found[1:] if len(found) > 2 and motion.steps[own[0]].turns else found


def _names(law: Any) -> set[Any]:
    return {se.Symbol(c) for c in law.scalars()}


def _axis(law: Any, k: Frame, l: Frame, steps: Sequence[Step], i: int) -> Vec:
    """Axis of elementary motion i, inertial: from the axes of k where no motion before it turns, from those of l where no motion
    after it turns, else from the joint's coordinates, which must then be unknowns."""

    def turn(some: Sequence[Step]) -> bool:
        return any(s.rotation is not None or (s.turns and s.amount.free_symbols & _names(law)) for s in some)

    if not turn(steps[:i]):
        return steps[i].direction(_axes(steps[:i], k))
    if not turn(steps[i + 1 :]):
        return steps[i].direction(_axes(Motion(steps[i + 1 :]).inverse().steps, l))
    if not law.kept:
        raise LawError(f"{type(law).__name__}: friction needs the force that presses the joint together, across each of its "
                       f"axes of motion; one of them lies between two rotations whose angles are no unknowns of this joint "
                       f"model: use model=mb.Classical(), or give normal_force=... (N)")  # fmt: skip
    own: tuple[Step, ...] = law.motion(Motion()).steps
    return own[i].direction(_axes(own[:i], k))


def _axes(steps: Sequence[Step], f: Frame) -> Triad:
    """The axes of a frame after some elementary motions."""
    axes: Triad = Motion(steps).pose((f.x, f.y, f.z))[1]
    return axes


def across(force: Vec, axes: Sequence[Vec]) -> Vec:
    """The part of a vector that is normal to one or two axes; for three axes 0."""
    if len(axes) == 1:
        along: Vec = axes[0] * (axes[0] @ force)
        return force - along
    if len(axes) > 2:
        return ZERO
    normal: Vec = axes[0].cross(axes[1])
    part: Vec = normal * ((normal @ force) / (normal @ normal))
    return part
