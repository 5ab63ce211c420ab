"""The equations solved for y', or as their parts M, f, g and G, for methods of integration that need these instead of F.

Numbers of laws (masses, stiffnesses ...) that can be varied between runs without compiling the equations again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mbdae.deferred import as_full, sp, splu
from mbdae.errors import NotReadError, OptionError, SolverError
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.acceleration_kernel import row_shares
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.base import Array, Numbers
from mbdae.system.motion import AllBodies
from mbdae.system.motion.constrained import Workspace
from mbdae.system.motion.mechanics import Mechanics

ITERATIONS = 30
Matrix = Any  #: an array, or a csc_matrix
SETTLED = 1e-10  #: largest change of a rate or multiplier, over the largest of all of them, at which Newton's method stops


class Partition(NamedTuple):
    """M u' + G^T lambda = f, g = 0 as functions: M(t, q) (nu, nu), f(t, q, u, s) (nu,), g(t, q) (m,), G(t, q) (m, nu)."""

    M: Callable[[float, Array], Array]
    f: Callable[..., Array]
    g: Callable[[float, Array], Array]
    G: Callable[[float, Array], Array]


def partition_of(mechanics: Mechanics, all_bodies: AllBodies) -> Partition:
    """The parts of a scene's equations of motion, for methods that integrate equations of second order, such as
    generalised-alpha."""
    if all_bodies.moved.trees and not mechanics.model.lines:
        return _reduced_partition(mechanics, all_bodies)

    def at(t: float) -> Array:
        return np.array([t])

    def load(t: float, q: Array, u: Array, s: Array | None = None) -> Array:
        return np.asarray(mechanics.load(at(t), q[None], u[None], None if s is None else s[None])[0])

    return Partition(
        lambda t, q: mechanics.mass, load,
        lambda t, q: mechanics.position_residual(at(t), q[None])[0],
        lambda t, q: mechanics.constraint_jacobian(at(t), q[None])[0],
    )


def _reduced_partition(mechanics: Mechanics, all_bodies: AllBodies) -> Partition:
    """The parts in joint coordinates: T^T M T, T^T (f - M T' u), and the rows of the joints that are not recursive."""
    left = [row for row in mechanics.rows if (row.group, row.instance) not in all_bodies.moved.replaced]
    full = Mechanics(mechanics.model, left)

    def at(t: float, q: Array, u: Array | None = None) -> tuple[Array, Array, Array, Array]:
        """t (1,), q and u of all nodes, and T, the derivatives of all velocities by those of the unknowns."""
        times, u = np.array([t]), np.zeros(all_bodies.nu) if u is None else u
        all_q, all_u = all_bodies.states(times, np.r_[q, u][None])
        return times, all_q, all_u, all_bodies.velocity_map(times, q[None])[0]

    def mass(t: float, q: Array) -> Array:
        T = at(t, q)[3]
        return np.asarray(T.T @ full.mass @ T)

    def load(t: float, q: Array, u: Array, s: Array | None = None) -> Array:
        times, all_q, all_u, T = at(t, q, u)
        f = full.load(times, all_q, all_u, None if s is None else s[None])
        bias = all_bodies.accelerations(times, q[None], u[None], np.zeros((1, all_bodies.nu)))
        return np.asarray(T.T @ (f - bias @ full.mass)[0])

    def rows(t: float, q: Array) -> Array:
        times, all_q, _, _ = at(t, q)
        return np.asarray(full.position_residual(times, all_q)[0])

    def gradient(t: float, q: Array) -> Array:
        times, all_q, _, T = at(t, q)
        return np.asarray(full.constraint_jacobian(times, all_q)[0] @ T)

    return Partition(mass, load, rows, gradient)


def state_rate_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """Outputs of a law that are rates of its internal states."""
    return [] if isinstance(d.law, Element) else [(("s", j), e) for j, e in enumerate(d.state_rates)]


def state_rates(mechanics: Mechanics, t: float, q: Array, u: Array, s: Array) -> Array:
    """The rates s' (ns,) of the internal states of laws, at one state t, q (nq,), u (nu,), s (ns,)."""
    return np.asarray(mechanics.of_states(state_rate_outputs, np.array([t]), q[None], u[None], s[None])[0])


class Rates:
    """y' and multipliers from F(t, (y, lambda), (y', 0)) = 0, linear or nearly linear in both, by Newton's method.

    full: equations whose first unknowns are y, the others algebraic multipliers. linear: whether y' and lambda occur linearly."""

    def __init__(self, full: Assembly, differential: int, linear: bool) -> None:
        self.full, self.n, self.linear = full, differential, linear
        self.multipliers = np.zeros(full.n - differential)
        columns = np.repeat(np.arange(full.n), np.diff(full.columns.first)) if full.sparse else np.arange(full.n)
        self._rate = columns < differential
        self._Y, self._Yp, self._R = np.zeros((3, full.n))

    def point(self, y: Array, yp: Array) -> None:
        """Set the state at which the full equations are evaluated next: y, y' (yp), and the multipliers found last."""
        self._Y[: self.n], self._Y[self.n :], self._Yp[: self.n] = y, self.multipliers, yp

    def matrices(self, t: float, y: Array, yp: Array) -> tuple[Matrix, Matrix]:
        """Derivatives of F by (y', lambda) and by y, at the multipliers found last; sparse where the full equations are."""
        self.point(y, yp)
        fy, fyp = self.full.jacobian_parts(t, self._Y, self._Yp)
        by_rates = np.where(self._rate, fyp, fy)
        if not self.full.sparse:
            return by_rates, fy[:, : self.n]
        places = self.full.sparsity
        by_rates, fy = (sp.csc_matrix((data, places.indices, places.indptr), shape=places.shape) for data in (by_rates, fy))
        return by_rates, fy[:, : self.n]

    def shares(self, t: Array, y: Array) -> Array:
        """(k, m) at states t (k,), y (k, n), of every constraint row: the squared part that is independent of the other rows,
        over the row's squared length."""
        nb, still = self.full.numbering, np.zeros(self.n)
        by_rates = [self.matrices(time, state, still)[0] for time, state in zip(t.tolist(), y, strict=True)]
        return row_shares(np.array([as_full(one[self.n :, nb.nq : nb.nq + nb.nu]) for one in by_rates]))

    def solve(self, t: float, y: Array, out: Array) -> None:
        """out[:] = y'. Where the equations are not linear in the multipliers, those found last are the starting values; after a
        failed solution they are set to 0, because starting values far too large would spoil the next solutions by round-off."""
        if self.linear:
            self.multipliers[:] = 0.0
        try:
            self._settle(t, y, out)
        except SolverError:
            self.multipliers[:] = 0.0
            raise

    def _settle(self, t: float, y: Array, out: Array) -> None:
        out[:] = 0.0
        for _ in range(1 if self.linear else ITERATIONS):
            matrix, _ = self.matrices(t, y, out)
            solve = factorised(matrix, self.full, t)
            step = self._corrected(t, out, solve)
            if self.linear:  # a second correction with the same factors is an iterative refinement of the first one
                self.point(y, out)
                self._corrected(t, out, solve)
                return
            if np.max(np.abs(step)) <= SETTLED * max(np.max(np.abs(out)), np.max(np.abs(self.multipliers))):
                return
        raise SolverError(f"friction and reactions find no balance at t = {t:.9g} s: self-locking; take a smaller friction "
                          f"coefficient in a joint whose friction follows from its reaction", t)

    def _corrected(self, t: float, out: Array, solve: Callable[[Array], Array]) -> Array:
        """One step of Newton's method from the point set by `point`: subtracts the step from y' (out) and the multipliers, and
        returns it."""
        self.full.residual(t, self._Y, self._Yp, self._R)
        step = solve(self._R)
        out -= step[: self.n]
        self.multipliers -= step[self.n :]
        return step

    def jacobian(self, t: float, y: Array, yp: Array) -> Array:
        """dy'/dy (n, n) at y' and the multipliers of the same point, by the implicit function theorem."""
        by_rates, by_state = self.matrices(t, y, yp)
        return -factorised(by_rates, self.full, t)(as_full(by_state))[: self.n]


def factorised(matrix: Matrix, full: Assembly, t: float) -> Callable[[Array], Array]:
    """The function right -> solution x of matrix x = right; it raises a SolverError where the matrix is singular."""
    try:
        solve = splu(matrix).solve if full.sparse else partial(np.linalg.solve, matrix)
    except RuntimeError:
        raise singular(t, "") from None

    def solution(right: Array) -> Array:
        with suppress(np.linalg.LinAlgError):
            x = np.asarray(solve(right))
            if np.isfinite(x).all():
                return x
        raise singular(t, "")

    return solution


def singular(t: float, row: str, kind: type[SolverError] = SolverError) -> SolverError:
    """The error, of a `kind`, where constraints depend on each other, or a motion has no inertia; row: name of a dependent row,
    or ""."""
    cause = (f"constraint {row} depends on the others there (singular position)" if row else
             "constraints depend on each other there (singular position), or a motion has no inertia")
    return kind(f"accelerations and reactions are not determined at t = {t:.9g} s: {cause}; form=mb.GGL() with "
                "mb.RadauIIA(3) may pass a singular position", t, row)


def right_hand_side(system: Assembly, t: float, y: Array, out: Array) -> None:
    """out[:] = y' of a scene without constraints, y = (q, u, s): a residual at y' = 0, then the mass matrix. SolverError where
    that is not positive definite."""
    velocity = system.evaluation.right_hand_side(t, y, out)
    if velocity >= 0:
        raise _massless(system, system.numbering.nq + velocity, t)


def _massless(system: Assembly, unknown: int, t: float) -> SolverError:
    return SolverError(f"the mass matrix is singular at t = {t:.9g} s: the motion of {system.names[unknown]} has no inertia; "
                       f"give the bodies that it moves mass or inertia", t)


REMEDY = "build a scene for every value, and solve them one by one"


def numbers_of(workspace: Workspace, equations: Assembly, names: Sequence[str]) -> Numbers:
    """Slots of the numbers of laws by these names; "elbow.mass" stands for that number of all laws of the item elbow.

    workspace: evaluates y' = f(t, y) of `equations`. Raises OptionError where a number is not an input of every kernel that
    depends on it, because it is compiled in: a number of a tree that is 0, 1 or -1, or one that is part of a constant."""
    reads = frozenset[int]() if workspace.of_rates is None else workspace.of_rates.reads
    slots, of = list[int](), list[int]()
    for k, name in enumerate(names):
        found = _slots(equations, name)
        fixed = [slot for slot in found if slot not in reads]
        if fixed:
            raise NotReadError(f"numbers: {name} cannot vary in a batch: it has no effect on y', or is compiled in as a constant "
                               f"(as a number that is 0, 1 or -1 in the scene): {REMEDY}")
        slots += found
        of += [k] * len(found)
    return Numbers(workspace.W, np.array(slots, dtype=np.int64), np.array(of, dtype=np.int64))


def _slots(equations: Assembly, name: str) -> list[int]:
    """Slots of a number by its name "item.number", one for every law of the item that has it."""
    found = [(why, slot) for known, why, slot in _numbers(equations) if known == name]
    if not found:
        offered = sorted({known for known, why, _ in _numbers(equations) if not why})
        raise OptionError(f"numbers: {name} is no number of a law; those that may vary: {', '.join(offered) or 'none'}")
    for why, _ in found:
        if why:
            raise OptionError(f"numbers: {name} cannot be varied alone ({why}): {REMEDY}")
    return [slot for _, slot in found]


def _numbers(equations: Assembly) -> Iterator[tuple[str, str, int]]:
    """For every number of every law: its name, the reason why it cannot be varied alone ("" where it can), and its slot."""
    model = equations.model
    for g, i, instance in model.instances():
        law, derived = instance.law, model.groups[g].derived
        in_tree = any((g, i) in (*tree.members, *tree.joints) for tree in equations.moved.trees)
        constants = () if in_tree else equations.plan(derived).constant_inputs.parameters
        for number in instance.numbers:
            if number in law.params:
                part = number in constants or (derived.rows and not in_tree)
                why = "the equations contain constants computed from it" if part else ""
                why = "other numbers of its law are computed from it" if law.derived() else why
                yield f"{instance.item}.{number}", why, equations.numbering.slot(g, i, number)
