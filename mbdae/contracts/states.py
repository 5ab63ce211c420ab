"""Random states of a law for `mb.selftest`: its sides as drawn, a state of motion, values of all symbols by name; the
values of a joint's coordinates for which its motion is defined."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.errors import OptionError
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Axes, Frame, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.motion import real_value, symbolic_motion
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.nodes import quaternion, quaternion_product, rotation_matrices, turned

# -- Values of the coordinates of a joint for which its motion is defined


DRAWS = 200  #: number of random values of the coordinates that are tried before a motion is refused as nowhere defined
#: a motion counts as defined where its rotations (rad) and displacements (m) and their first and second derivatives by the
#: coordinates are below this: beyond it rounding errors are larger than the errors that the contracts allow
LARGEST = 1e6


def value(e: Expr, numbers: Mapping[str, float]) -> float:
    """An expression at values of its symbols by name; NaN where it is not real or not finite."""
    found = real_value(e.subs({se.Symbol(name): number for name, number in numbers.items()}))
    return found if np.isfinite(found) else np.nan


class Domain:
    """Where the motion of a joint and its first two derivatives by the coordinates are finite and real."""

    def __init__(self, law: Any) -> None:
        motion = symbolic_motion(law) if isinstance(law, Joint) else None
        self.law, self.needed = law, list[Expr]()
        for step in motion.steps if motion is not None else ():
            self.needed.append(step.amount)
            for c in law.scalars():
                slope = step.amount.diff(se.Symbol(c))
                self.needed += [slope, *(slope.diff(se.Symbol(other)) for other in law.scalars())]
        self.needed = [e for e in dict.fromkeys(self.needed) if e.free_symbols]

    def holds(self, numbers: Mapping[str, float]) -> bool:
        """Whether the motion is defined at values of coordinates and parameters by name."""
        return all(abs(value(e, numbers)) < LARGEST for e in self.needed)

    def inside(self, numbers: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
        """Random coordinates for which the motion is defined, to replace those in `numbers`; empty where the motion is defined
        for those already. Raises OptionError where none are found."""
        if self.holds(numbers):
            return {}
        for n in range(DRAWS):
            reach = 3.0 * 0.97**n
            drawn = {c: float(rng.uniform(-reach, reach)) for c in self.law.scalars()}
            if self.holds({**numbers, **drawn}):
                return drawn
        name = type(self.law).__name__
        given = ", ".join(f"{p} = {numbers[p]:.3g}" for p in self.law.params if p in numbers and p not in self.law.derived())
        if given:
            raise OptionError(f"the motion of {name} cannot be evaluated: it is finite and real at none of {DRAWS} random values "
                              f"of its coordinates with {given}; give values of its parameters, as in mb.selftest({name}, "
                              f"parameter=value)")
        raise OptionError(f"the motion of {name} cannot be evaluated: it is finite and real at none of {DRAWS} random values of "
                          f"its coordinates; state it by functions that are defined near 0")


Values = dict[str, NDArray[Any]]  #: symbol name -> (points,) real or complex


def turn(vector: Any) -> Array:
    """Rotation matrix (3, 3) of a rotation vector, rad."""
    return rotation_matrices(turned(np.array([1.0, 0, 0, 0]), np.asarray(vector, dtype=float)))


def joint_axes(axes: Axes, rng: np.random.Generator) -> Array:
    """Random joint axes (3, 3), columns: any for Axes.GENERAL; for frames in the plane with z along its normal, against it
    (REVERSED) or in the plane (IN_PLANE)."""
    a = rng.uniform(-3, 3)
    x, z = np.array([np.cos(a), np.sin(a), 0.0]), np.array([0.0, 0.0, 1.0])
    if axes is Axes.GENERAL:
        return turn(rng.uniform(-1.5, 1.5, 3))
    if axes is Axes.IN_PLANE:
        x, z = z, x
    elif axes is Axes.REVERSED:
        z = -z
    return np.column_stack([x, np.cross(z, x), z])


class RandomStates:
    """Random states of a law: its sides as drawn and displaced from there. `values`: all symbols by name in `count` states."""

    def __init__(self, d: Derived, given: dict[str, float], rng: np.random.Generator, count: int,
                 defined: Callable[[Values], bool] = lambda _: True) -> None:
        """defined: whether the law has finite values in a state; of others none is drawn."""
        self.d, self.given, self.rng = d, given, rng
        self._domain, self._defined = Domain(d.law), defined
        self.values = _stack([self._drawn(rng.uniform(-1.2, 1.2, 3), False) for _ in range(count)])
        self._count = count

    @cached_property
    def near(self) -> Values:
        """States near the drawn position (rotations up to 0.4 rad), four times as many as `values` has."""
        return _stack([self._drawn(self.rng.uniform(-0.4, 0.4, 3), False) for _ in range(4 * self._count)])

    def special(self, rotation: float, together: bool) -> Values:
        """One state with l (and further sides) turned by `rotation` (rad) about the joint axis; together: whether the points of
        all sides coincide."""
        return _stack([self._drawn(rotation, together)])

    def _drawn(self, relative: Any, together: bool) -> dict[str, float]:
        """A state in which the law is defined, or the last of DRAWS."""
        for _ in range(DRAWS):
            point = self._point(relative, together)
            if self._defined(_stack([point])):
                break
        return point

    def _point(self, relative: Any, together: bool) -> dict[str, float]:
        d, rng = self.d, self.rng
        flat = any(f.kind.flat for f in d.frames)
        J = joint_axes(d.frames[0].axes if d.frames[0].kind.oriented else d.sides[-1].axes, rng)
        values = {str(s): float(rng.normal()) for s in [*d.multipliers, *d.stabilisers]}
        values |= {f"{prefix}_{n}": float(rng.normal()) for n in d.law.states for prefix in ("state", "statep")}
        for name in d.law.params:
            values[name] = self.given.get(name, float(rng.uniform(0.5, 1.5)))
            values |= {f"{name}_dot": float(rng.normal()), f"{name}_ddot": float(rng.normal())}
        free = np.array([0.0, 0.0, 1.0]) if flat else np.ones(3)
        abouts = [relative * J[:, 2] if np.ndim(relative) == 0 else np.roll(relative, i) for i, _ in enumerate(d.sides[1:])]
        turns = [np.eye(3), *(turn(free * about) for about in abouts)]  # rotation of every side relative to the first
        common = turn(rng.uniform(-1.5, 1.5, 3) * free)
        for f, R in zip(d.sides, turns, strict=False):
            if not f.kind.moves:
                common = R.T
        at: Array | None = None
        for f in d.frames[len(d.sides) :]:
            upright = np.eye(4)[0] * 2 if f.kind.by_quaternion else np.zeros(len(f.q))
            values |= {str(s): float(c) for s, c in zip(f.q, upright + 0.7 * rng.normal(size=len(f.q)), strict=True)}
            values |= {str(s): float(rng.normal()) for s in f.u}
            values |= {f"{f.side}_up{i + 1}": float(rng.normal()) for i in range(len(f.u))}
        named = dict(zip(d.law.own_coordinates, d.frames[len(d.sides) :], strict=True)) if self._domain.needed else {}
        numbers = values | {c: values[str(f.q[0])] for c, f in named.items()}
        if named:
            values |= {str(named[c].q[0]): number for c, number in self._domain.inside(numbers, rng).items()}
        for f, R in zip(d.sides, turns, strict=False):
            at = self._side(values, f, J, common @ R, at if together else None)
        return values

    def _side(self, values: dict[str, float], f: Frame, J: Array, motion: Array, at: Array | None) -> Array:
        """Add the values of the symbols of one side, whose body is turned from the drawing by `motion` (3, 3), to `values`.
        J: joint axes (3, 3), columns; at: position (3,) of its point, random where None. Returns the position of its point."""
        rng, flat = self.rng, f.kind.flat
        heading = float(rng.uniform(-3, 3)) if f.kind.turns and flat else 0.0
        drawn = turn([0, 0, heading]) if flat else turn(rng.uniform(-1, 1, 3)) if f.kind.turns else np.eye(3)
        plane = np.array([1.0, 1.0, 0.0]) if flat else np.ones(3)
        arm, R = rng.normal(size=3) * plane, motion @ drawn
        if not f.kind.turns and f.kind.moves:
            arm = np.zeros(3)
        center = rng.normal(size=3) * plane if at is None else at - R @ arm
        if not f.kind.moves:
            arm, center = center + arm if at is None else at, np.zeros(3)
            R = drawn = np.eye(3)
        Q, (nq, nu) = drawn.T @ J, f.kind.sizes
        values |= {f"{f.side}_p{i + 1}": float(c) for i, c in enumerate(arm)}
        values |= {f"{f.side}_Q{a}{i + 1}": float(Q[i, j]) for j, a in enumerate("xyz") for i in range(3)}
        values[f"{f.side}_theta0"] = heading
        turned_by = float(np.arctan2(motion[1, 0], motion[0, 0]))
        P = quaternion(R) * rng.uniform(0.5, 2.0) * rng.choice([-1.0, 1.0])
        third = heading + turned_by if f.kind.turns else center[2]
        q = [*center[: f.kind.translations], *P] if f.kind.by_quaternion else [center[0], center[1], third]
        values |= {str(s): float(c) for s, c in zip(f.q, q, strict=False)}
        values |= {str(s): float(c) for s, c in zip(f.u, rng.normal(size=nu), strict=True)}
        values |= {f"{f.side}_qp{i + 1}": float(c) for i, c in enumerate(rng.normal(size=nq))}
        values |= {f"{f.side}_up{i + 1}": float(c) for i, c in enumerate(rng.normal(size=nu))}
        return np.asarray(center + R @ arm)


def _stack(points: list[dict[str, float]]) -> Values:
    return {name: np.array([p[name] for p in points]) for name in points[0]}


def columns(symbols: Any, values: Values) -> NDArray[Any]:
    """(points, symbols) values of symbols, such as f.q and f.u of a side f."""
    count = len(next(iter(values.values())))
    return np.stack([values[str(s)] for s in symbols], axis=-1) if len(symbols) else np.zeros((count, 0))


def rotation(f: Frame, values: Values) -> Array:
    """R (points, 3, 3) of a side."""
    q = columns(f.q, values)
    if f.kind.by_quaternion:
        return rotation_matrices(q[:, f.kind.translations :])
    headings = q[:, 2] if f.kind is NodeKind.PLANAR else np.zeros(len(q))
    return np.array([turn([0, 0, h]) for h in headings])


def rates(f: Frame, values: Values, u: NDArray[Any]) -> NDArray[Any]:
    """q' (points, nq) for velocities u (points, nu)."""
    if not f.kind.by_quaternion:
        return u
    n = f.kind.translations
    P = columns(f.q, values)[:, n:]
    turning = [quaternion_product(p, np.r_[0.0, w]) / 2 for p, w in zip(P, u[:, n:], strict=True)]
    return np.hstack([u[:, :n], np.array(turning)])


def moved(d: Derived, values: Values, step: complex, u: dict[str, NDArray[Any]], clock: bool = False) -> Values:
    """Values after a small motion: q + step q'(u); clock: parameters that depend on time change by step times their rate too."""
    out = dict(values)
    for f in d.frames:
        change = rates(f, values, u[f.side])
        out |= {str(s): values[str(s)] + step * change[:, i] for i, s in enumerate(f.q)}
    if clock:
        out |= {str(p): values[str(p)] + step * values[str(dp)] for p, dp in d.variation.clock.items() if str(dp) in values}
    return out


def rigidly_moved(d: Derived, values: Values, rng: np.random.Generator) -> Values:
    """All sides turned and shifted together as one rigid body, velocities with them."""
    flat = any(f.kind.flat for f in d.frames)
    P = quaternion(turn(rng.uniform(-2, 2, 3) * ([0, 0, 1] if flat else [1, 1, 1])))
    A, c = rotation_matrices(P), rng.normal(size=3) * ([1, 1, 0] if flat else [1, 1, 1])
    out = dict(values)
    for f in d.frames:
        if f.kind.of_joint:
            continue
        n = 2 if flat else 3
        q, u = columns(f.q, values).copy(), columns(f.u, values).copy()
        q[:, :n], u[:, :n] = q[:, :n] @ A[:n, :n].T + c[:n], u[:, :n] @ A[:n, :n].T
        if f.kind is NodeKind.SPATIAL:
            q[:, 3:] = [quaternion_product(P, p) for p in q[:, 3:]]
        elif f.kind is NodeKind.PLANAR:
            q[:, 2] += 2 * np.arctan2(P[3], P[0])
        out |= {str(s): q[:, i] for i, s in enumerate(f.q)} | {str(s): u[:, i] for i, s in enumerate(f.u)}
    return out


def rigid_velocities(d: Derived, values: Values, direction: int) -> dict[str, Array]:
    """u of every side in a common rigid motion: translation 0..2 or rotation 3..5 about the origin."""
    e = np.eye(3)[direction % 3]
    out = {}
    for f in d.frames:
        q, n = columns(f.q, values), f.kind.translations
        if f.kind.of_joint:
            out[f.side] = np.zeros((len(q), len(f.u)))
            continue
        center = np.zeros((len(q), 3))
        center[:, :n] = q[:, :n]
        u = np.zeros((len(q), f.kind.sizes[1]))
        u[:, :n] = (np.cross(e, center) if direction > 2 else e + 0 * center)[:, :n]
        if direction > 2 and f.kind.turns:
            u[:, n:] = e[2] if f.kind.flat else np.einsum("pji,j->pi", rotation(f, values), e)
        out[f.side] = u
    return out


def embedded(d: Derived, values: Values, spatial: Derived) -> Values:
    """A planar state as a state of the spatial variant of the same law."""
    out = dict(values)
    zero = np.zeros(len(next(iter(values.values()))))
    out |= {str(s): zero for s in [*spatial.multipliers, *spatial.stabilisers] if str(s) not in values}
    for f, s in zip(d.sides, spatial.sides, strict=True):
        q, u = columns(f.q, values), columns(f.u, values)
        if s.kind is NodeKind.SPATIAL:
            c, h = np.cos(q[:, 2] / 2), np.sin(q[:, 2] / 2)
            full, speed = [q[:, 0], q[:, 1], zero, c, zero, zero, h], [u[:, 0], u[:, 1], zero, zero, zero, u[:, 2]]
        elif s.kind is NodeKind.POINT:
            full, speed = [q[:, 0], q[:, 1], zero], [u[:, 0], u[:, 1], zero]
        else:
            full, speed = [], []
        out |= {str(a): b for a, b in zip(s.q, full, strict=True)} | {str(a): b for a, b in zip(s.u, speed, strict=True)}
        up = [values[f"{f.side}_up{i + 1}"] for i in range(f.kind.sizes[1])]
        accelerations = [*up[:2], *[zero] * (s.kind.sizes[1] - 2)]
        accelerations[5:] = up[2:]
        out |= {f"{f.side}_up{i + 1}": a for i, a in enumerate(accelerations)}
        out |= {f"{f.side}_qp{i + 1}": zero for i in range(s.kind.sizes[0])}
    return out
