"""The contract "motion": constraint rows, coordinates, ties (rows that equate a coordinate to a value) and branches (expressions
that are positive on the wanted solution only) of a joint against the motion it states.

l is placed by the motion at random values of the coordinates, k moves at random; the motion is followed in numbers here, step by
step, not by the expressions from which the rows with coordinates are derived.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mbdae.contracts.case import STEP, Case, Measured, branches
from mbdae.contracts.states import Domain, Values, columns, rotation, turn, value
from mbdae.kernels.plan import Plan
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Axes, Frame, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.motion import Motion, Rotation, motion_of
from mbdae.symbolic.outputs import Target, coordinate, position, velocity
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.system.base import Array
from mbdae.system.model.nodes import quaternion, rotation_matrices, turned

SOLVED = 1e-11  #: a pose of l whose rows all have smaller magnitudes than this (m or 1) counts as a solution of the rows
#: a solution of the rows counts as one to which the motion does not lead if its distance from all poses to which it leads is
#: larger: the root of the sum of squares of the differences of the position (m) and of the entries of the rotation matrix
APART = 1e-6
#: a branch counts as positive above this value; a row counts as dependent on a coordinate if its largest slope over that
#: coordinate in the random states is at least this
CLEAR = 1e-3
FAR = 1e3  #: replaces the entries of a residual that are not finite, where the motion is not defined
STARTS = 12  #: number of random poses of l, besides three half turns, from which solutions of the rows are searched
TRIES = 6  #: largest number of random starts of the search for coordinates that cannot be computed from the frames of k and l


@dataclass
class Pose:
    """Place of l's joint point and axes (columns) relative to those of k, in k's axes, with velocity and angular velocity."""

    d: Array
    A: Array
    v: Array
    w: Array


def followed(motion: Motion, values: dict[str, float], rates: dict[str, float]) -> Pose:
    """The pose of l to which a motion leads, step by step. values: coordinates, parameters and angular velocities of free
    rotations, by name; rates: of the coordinates, by name. For an inverse motion the velocities are wrong; they are not used."""
    d, v, w, A = np.zeros(3), np.zeros(3), np.zeros(3), np.eye(3)
    for step in motion.steps:
        if step.rotation is not None:
            P, spin = (np.array([values[str(c)] for c in part]) for part in (step.rotation.P, step.rotation.spin))
            R = rotation_matrices(P)
            w, A = w + A @ R @ spin, A @ (R.T if step.rotation.inverse else R)
            continue
        amount = value(step.amount, values)
        speed = sum(value(step.amount.diff(se.Symbol(c)), values) * rate for c, rate in rates.items())
        axis = np.array([float(c) for c in step.axis])
        if step.turns:
            w, A = w + speed * (A @ axis), A @ turn(amount * axis)
        else:
            way = amount * (A @ axis)
            d, v = d + way, v + speed * (A @ axis) + np.cross(w, way)
    return Pose(d, A, v, w)


def symbols(law: Joint) -> dict[str, Any]:
    """A symbol for every coordinate, of a free rotation those of its quaternion and its angular velocity."""
    free = {c: Rotation.of([se.Symbol(f"{c}_P{i}") for i in range(4)], Vec(*(se.Symbol(f"{c}_w{i}") for i in range(3))))
            for c in law.coordinates.keys() - law.scalars().keys()}
    return {c: free.get(c, se.Symbol(c)) for c in law.coordinates}


def stated_motion(case: Case) -> Iterator[Measured]:
    """All checks of what a joint states against its motion, for a joint between two bodies in space."""
    d = case.d
    free = (NodeKind.SPATIAL, Axes.GENERAL)
    if isinstance(d.law, Joint) and d.law.states_motion() and all((f.kind, f.axes) == free for f in d.sides):
        moving = _Moving(case)
        yield from moving.rows()
        yield from moving.read_back()
        yield from moving.inverse()
        if not d.law.friction and not case.structure.timed:
            yield from moving.count()
            yield from moving.ties()
            yield from moving.branches()
            if len(moving.prescribed) in (0, len(d.law.drives())):
                yield from moving.second_solutions()


def _stated(d: Derived) -> list[tuple[Target, Expr]]:
    return [*position(d), *velocity(d), *coordinate(d), *branches(d)]


class _Moving:
    """A joint between two bodies whose l is placed by the motion; `values` are the states, `c` and `cd` coordinates and rates."""

    def __init__(self, case: Case) -> None:
        self.case, self.d, self.law = case, case.d, case.d.law
        motion = motion_of(self.law, symbols(self.law))
        assert motion is not None
        self.motion, self.rng = motion, np.random.default_rng(40)
        self.plan = Plan(self.d, _stated)
        self.points = len(next(iter(case.values.values())))
        reach = {name: (9.0 if self.law.kept else 2.6) if p.unit == "rad" else 1.5 for name, p in self.law.scalars().items()}
        self.c = {name: self.rng.uniform(-r, r, self.points) for name, r in reach.items()}
        domain = Domain(self.law)
        for i in range(self.points):
            numbers = self.numbers(case.values, self.c, i)
            for name, number in domain.inside(numbers, self.rng).items():
                self.c[name][i] = number
        self.cd = {name: self.rng.normal(size=self.points) for name in self.c}
        parts = [f"{part}{i}" for part, count in (("P", 4), ("w", 3)) for i in range(count)]
        free = [f"{name}_{part}" for name in self.law.coordinates if name not in self.c for part in parts]
        self.free = {name: self.rng.normal(size=self.points) for name in free}
        self.values = self.placed(case.values)

    # -- placing and evaluating

    def numbers(self, values: Values, c: dict[str, Any], i: int) -> dict[str, float]:
        """Parameters and coordinates in state number i, by name."""
        return {p: float(values[p][i].real) for p in self.law.params if p in values} | {n: float(a[i]) for n, a in c.items()}

    def axes(self, f: Frame, values: Values) -> tuple[Array, Array]:
        """Joint points (points, 3) and axes (points, 3, 3) of a side, inertial."""
        R = rotation(f, values)
        Q = np.stack([np.stack([values[f"{f.side}_Q{a}{j}"] for j in (1, 2, 3)], axis=-1) for a in "xyz"], axis=-1)
        arm = np.stack([values[f"{f.side}_p{j}"] for j in (1, 2, 3)], axis=-1)
        return columns(f.q, values)[:, :3] + np.einsum("pij,pj->pi", R, arm), R @ Q

    def pose(self, values: Values, i: int) -> Pose:
        """Pose of l relative to k in state number i."""
        (rk, K), (rl, L) = (self.axes(f, values) for f in self.d.sides)
        return Pose(K[i].T @ (rl[i] - rk[i]), K[i].T @ L[i], np.zeros(3), np.zeros(3))

    def placed(self, values: Values) -> Values:
        """The states with position and velocity of l replaced by those to which the motion leads, and the coordinates that are
        unknowns or prescribed replaced by the values used for it."""
        there = self.c | self.free
        points = range(self.points)
        led = [followed(self.motion, self.numbers(values, there, i), {n: r[i] for n, r in self.cd.items()}) for i in points]
        out = self.put(values, led)
        for f, name in zip(self.d.frames[2:], self.law.own_coordinates, strict=True):
            if name in self.c:
                out |= {str(f.q[0]): self.c[name], str(f.u[0]): self.cd[name]}
            else:
                out |= {str(s): self.free[f"{name}_P{i}"] for i, s in enumerate(f.q)}
                out |= {str(s): self.free[f"{name}_w{i}"] for i, s in enumerate(f.u)}
        out |= {f"{name}_dot": np.zeros(self.points) for name in self.law.params}
        for drive, name in self.law.drives().items():
            out |= {drive: self.c[name], f"{drive}_dot": self.cd[name]}
        return out

    def put(self, values: Values, poses: list[Pose]) -> Values:
        """The states with l moved to the given pose relative to k (one pose for each state), with the velocity of the pose."""
        k, l = self.d.sides
        out, (rk, K), Rk = dict(values), self.axes(k, values), rotation(k, values)
        _, L = self.axes(l, values)
        uk, centre = columns(k.u, values), columns(k.q, values)[:, :3]
        q, u = [], []
        for i, at in enumerate(poses):
            Ql = rotation(l, values)[i].T @ L[i]
            R = K[i] @ at.A @ Ql.T
            arm = R @ np.array([values[f"{l.side}_p{j}"][i] for j in (1, 2, 3)])
            wk, way = Rk[i] @ uk[i, 3:], K[i] @ at.d
            w = wk + K[i] @ at.w
            v = uk[i, :3] + np.cross(wk, rk[i] + way - centre[i]) + K[i] @ at.v
            q.append([*(rk[i] + way - arm), *quaternion(R)])
            u.append([*(v - np.cross(w, arm)), *(R.T @ w)])
        out |= {str(s): a for s, a in zip(l.q, np.transpose(q), strict=True)}
        return out | {str(s): a for s, a in zip(l.u, np.transpose(u), strict=True)}

    def evaluate(self, values: Values) -> dict[Target, NDArray[Any]]:
        if not self.plan.targets:
            return {}
        found = self.plan.kernel.oracle(columns(self.plan.all_inputs.symbols, values))
        return dict(zip(self.plan.targets, found.T, strict=True))

    @cached_property
    def found(self) -> dict[Target, NDArray[Any]]:
        """All outputs of the joint at the states to which the motion leads."""
        return self.evaluate(self.values)

    def slope(self, symbol: str) -> dict[Target, Array]:
        """Derivatives of all outputs by a coordinate or by its prescribed value, the symbol given."""
        stepped = self.values | {symbol: self.values[symbol] + 1j * STEP}
        return {target: e.imag / STEP for target, e in self.evaluate(stepped).items()}

    # -- what must hold

    def rows(self) -> Iterator[Measured]:
        """The constraint rows and their rates vanish for position and velocity of l from the motion."""
        timed = {str(dp) for dp in self.d.variation.clock.values()}
        drift = {n: np.zeros(self.points) for n in range(len(self.d.rows))}
        for drive, name in self.law.drives().items():
            if getattr(self.law, drive) is not None and f"{drive}_dot" not in timed:
                by = self.slope(drive)
                drift = {n: drift[n] + by["g", n] * self.cd[name] for n in drift}
        for n, row in enumerate(self.d.rows):
            yield f"row '{row}', where the motion puts l,", _largest(self.found["g", n])
            yield f"rate of row '{row}' at the rates of the motion", _largest(self.found["gd", n] + drift[n])

    def read_back(self) -> Iterator[Measured]:
        """The coordinates and rates that the joint computes from its frames equal those from which l was placed; angles that are
        no unknowns only up to whole turns."""
        for name in self.c if self.d.coordinates else ():
            if ("c", name) not in self.found:
                yield f"coordinate '{name}', which `coordinate` does not return,", 1.0
                continue
            off = self.found["c", name] - self.c[name]
            if self.law.coordinates[name].unit == "rad" and not self.law.kept:
                off = np.exp(1j * off) - 1
            yield f"coordinate '{name}' as read, against the value of the motion,", _largest(off)
            yield f"rate of coordinate '{name}' as read", _largest(self.found["cd", name] - self.cd[name])

    def inverse(self) -> Iterator[Measured]:
        """The inverse motion leads from l back to k."""
        for i in range(self.points):
            there = self.pose(self.values, i)
            back = followed(self.motion.inverse(), self.numbers(self.values, self.c | self.free, i), {})
            off = max(_largest(there.A @ back.A - np.eye(3)), _largest(there.d + there.A @ back.d))
            yield "place of k by the inverse motion", off

    @property
    def prescribed(self) -> dict[str, str]:
        """Prescribed coordinates, each with the name of the parameter that is its prescribed value."""
        return dict(self.law.prescribed)

    def count(self) -> Iterator[Measured]:
        """The number of independent rows is right: six less the degrees of freedom of the motion (six where the coordinates are
        unknowns), and one for every prescribed coordinate; and no row depends on the others."""
        wanted = 6 + len(self.prescribed) - (0 if self.law.kept else self.law.freedoms())
        for G in self.case.rows(self.values)[1]:
            sizes = np.linalg.svd(G, compute_uv=False)
            rank = int(np.sum(sizes > 1e-9 * np.max(sizes, initial=1.0)))
            which = "too many" if rank > wanted else "too few"
            if rank != wanted:
                yield (f"number of independent rows, {rank} where {wanted} leave just the motion free ({which}),",
                       abs(rank - wanted))
            if len(G) > rank:
                yield (f"number of rows, {len(G)} of which {rank} are independent (leave out what follows from other rows),",
                       len(G) - rank)

    def ties(self) -> Iterator[Measured]:
        """A row that equates a coordinate to a value has a positive derivative by that value: this is the sign convention."""
        ties = set(self.law.ties(*self.d.sides)) if self.law.kept and self.law.states_rows() else set()
        tied = ties if ties == self.law.coordinates.keys() else set()
        by = {name: str(f.q[0]) for f, name in zip(self.d.frames[2:], self.law.own_coordinates, strict=True) if name in tied}
        by |= {drive: drive for drive in self.prescribed.values()}
        for row, symbol in by.items():
            slope = self.slope(symbol)["g", self.d.rows.index(row)]
            if _largest(slope) < CLEAR:
                yield f"row '{row}', which does not depend on the coordinate that it ties,", 1.0
            else:
                yield (f"slope of row '{row}' over the coordinate that it ties, which must be positive,",
                       float(max(0.0, -np.min(slope))))

    def branches(self) -> Iterator[Measured]:
        """The branches, expressions that must be positive, are positive where the motion leads."""
        for target, e in self.found.items():
            if target[0] == "positive":
                least = float(np.min(e.real))
                yield (f"expression '{target[1]}' of `branches`, which must be positive where the motion puts l,",
                       0.0 if least > 0 else 1 - least)

    # -- solutions of the rows that are not meant

    def second_solutions(self) -> Iterator[Measured]:
        """No pose of l satisfies rows and branches unless the motion leads to it for some values of the coordinates."""
        starts, names = self._starts()
        solved = self.case.solved(starts, fixed=self.d.sides[0].side)
        with np.errstate(all="ignore"):  # relative angles are not defined for some poses half a turn away
            found = self.evaluate(solved)
        meant = np.full(len(names), True)
        for target, e in found.items():
            meant &= (e.real > CLEAR) if target[0] == "positive" else np.abs(e) < SOLVED if target[0] == "g" else True
        for i in np.flatnonzero(meant):
            off = self._off(solved, found, int(i))
            yield (f"second solution of the rows, which no expression of `branches` refuses ({names[i]}),",
                   off if off > APART else 0.0)

    def _starts(self) -> tuple[Values, list[str]]:
        """States from which solutions are searched, and their names: l turned by half a turn about each of its axes, then l at
        random places, with random values of the coordinates that are unknowns."""
        offs = [("half a turn about its x axis", turn([np.pi, 0, 0])), ("half a turn about its y axis", turn([0, np.pi, 0])),
                ("half a turn about its z axis", turn([0, 0, np.pi]))]
        names = [name for name, _ in offs] + ["found from a random place"] * STARTS
        picked = np.arange(len(names)) % self.points
        values = {name: e[picked] for name, e in self.values.items()}
        poses = [self.pose(values, i) for i in range(len(names))]
        for i, (_, R) in enumerate(offs):
            poses[i].A = poses[i].A @ R
        for at in poses[len(offs) :]:
            at.d, at.A = self.rng.normal(size=3), turn(self.rng.uniform(-3, 3, 3))
        for symbol in (str(c) for f in self.d.frames[2:] for c in f.q):
            values[symbol] = values[symbol] + np.r_[[0.0] * len(offs), self.rng.uniform(-3, 3, STARTS)]
        return self.put(values, poses), names

    def _off(self, values: Values, found: dict[Target, NDArray[Any]], i: int) -> float:
        """Distance of l in state number i from the pose to which the motion leads with the coordinates that the frames show in
        that state; the least over the values of all other coordinates."""
        at = self.pose(values, i)
        known = {name: found["c", name].real for name in self.c if ("c", name) in found}
        known |= {name: values[drive].real for name, drive in self.prescribed.items() if not self.law.kept}
        for f, name in zip(self.d.frames[2:], self.law.own_coordinates, strict=True):
            known |= {} if name in self.c else {f"{name}_P{n}": values[str(s)].real for n, s in enumerate(f.q)}
        numbers = dict.fromkeys(self.free, 0.0) | self.numbers(values, known, i)
        unknown = {name: 1 if name in self.c else 3 for name in self.law.coordinates if not {name, f"{name}_P0"} & known.keys()}

        def off(c: Array) -> Array:
            led = followed(self.motion, numbers | self._stated_by(unknown, c), {})
            apart = np.concatenate([led.d - at.d, (led.A - at.A).ravel()])
            return np.where(np.isfinite(apart), apart, FAR)  # coordinates for which the motion is not defined

        least = float(np.linalg.norm(off(np.zeros(sum(unknown.values())))))
        for _ in range(TRIES if unknown else 0):
            if least > APART:
                fit = least_squares(off, self.rng.uniform(-2, 2, sum(unknown.values())), xtol=1e-14, ftol=1e-14, gtol=1e-14)
                least = min(least, float(np.linalg.norm(fit.fun)))
        return least

    @staticmethod
    def _stated_by(sizes: dict[str, int], c: Array) -> dict[str, float]:
        """Values of coordinates by name from numbers in a row c: one number for an angle or displacement, a rotation vector (3,)
        for a free rotation; sizes: how many numbers each coordinate has."""
        stated: dict[str, float] = {}
        left = c
        for name, size in sizes.items():
            own, left = left[:size], left[size:]
            P = turned(np.eye(4)[0], own) if size == 3 else own
            stated |= {f"{name}_P{n}": float(e) for n, e in enumerate(P)} if size == 3 else {name: float(own[0])}
        return stated


def _largest(e: NDArray[Any]) -> float:
    return float(np.max(np.abs(e), initial=0.0))
