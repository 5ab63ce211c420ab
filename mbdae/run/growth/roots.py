"""Small disturbances that grow: how fast, where along a run, and steps short enough to follow them.

A motion that begins nearer to an unstable rest than its tolerance leaves the steps free, and a step that is long beside the
growth takes it for decay: Radau IIA(3) multiplies a disturbance that grows by e^z in a step by less than 1 from z = 12 on. A
companion run does the same, so that the two agree. Therefore the equations are asked: their linearisation at some states of a
run, with frozen coefficients, has roots, and a root with a positive real part bounds the steps there (`growing`), if the
disturbance is too small for the error test of the solver to see it. Steps of FOLLOWED divided by the root's magnitude and less
follow the growth to a relative accuracy that does not depend on how small the disturbance is, and runs with other bounds show
the error.

These roots bound steps and nothing else: a pendulum that turns over the top has roots whose growth adds up to e^43, while a small
disturbance grows by e^5. How much disturbances grow is computed along the run (`amplification`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import distinct, eig
from mbdae.inputs.resolution import Bound
from mbdae.integrators.base import Solver
from mbdae.integrators.matrices.iteration import IterationMatrix, as_csc
from mbdae.integrators.solution import Solution, systems_at
from mbdae.native.sparse import SingularMatrixError
from mbdae.system.base import Array, System

#: a step follows a growing disturbance if step times magnitude of its root is at most FOLLOWED
FOLLOWED = 0.4
#: growth (natural logarithm of the factor) over the whole run below which steps are not bounded: a disturbance that the tolerance
#: hides, which is a third of the accuracy at most, does not reach three times the accuracy by it
HARMLESS = 1.0
#: a disturbance counts as seen by the error test where it is above SEEN times the tolerance, or above VISIBLE, relative to the
#: scale. Measured on an upright rod at 40 times the tolerance: two runs took the same long step, with the same error of 2e-5 of
#: the growth, because only the largest ratio of two steps bounded it
SEEN, VISIBLE = 1e3, 0.03
#: a disturbance that is not seen is behind where the logarithm of its growth from one state to the next is below KEEPS times that
#: of its root less SPARE: methods of low order damp what oscillates and grows slowly, at steps that follow the oscillation
KEEPS, SPARE = 0.8, 0.5
CLOSER = 2.0  #: a part of a run in which one is behind gets a bound of this fraction of its step
#: where bounds by growth are in force, the error is at least this many times the difference of a run from its companion: methods
#: of varying order follow an unseen disturbance at a low one (measured with IDA, 2.4 times)
AT_LEAST = 2.0
#: number of states of a run at which roots are sought: FEW, or SOME with more than SMALL unknowns
FEW, SOME, SMALL = 8, 3, 60
MOST = 300  #: largest number of unknowns for which all roots are computed
#: roots are found best near SHIFT over the step; those beyond RESOLVED times that are left out: constraints have infinite roots,
#: which are inexact in a computer
SHIFT, RESOLVED = 3.0, 1e3
#: number of multiplications by which growth is sought among many roots, and the ratio by which it then shows from their middle to
#: their end: the largest that vibrations alone gave was 1.1
ROUNDS, GROWS = 24, 1.5


class Growth(NamedTuple):
    """Growth in a part of a run, from `begin` to `end` (s): rate, 1/s, the largest real part of a root there; unseen: the largest
    magnitude (1/s) of a root whose disturbance grows without being seen by the solver; behind: the inverse of the steps (s) asked
    for because they do not follow it; 0 where there is none."""

    begin: float
    end: float
    rate: float
    unseen: float
    behind: float


def growing(system: System, run: Solution, solver: Solver, accuracy: float) -> list[Growth]:
    """The growth of small disturbances along a run, in parts that cover it."""
    t0, t1 = float(run.t[0]), float(run.t[-1])
    if len(run.t) < 2 or not t1 > t0:
        return []
    tolerance = accuracy if solver.by_steps or solver.rtol is None else solver.rtol
    count = FEW if system.n <= SMALL else SOME
    wanted = t0 + (t1 - t0) * (np.arange(count) + 0.5) / count
    steps = distinct(np.clip(np.searchsorted(run.t, wanted, side="right") - 1, 0, len(run.t) - 2))
    times, h = (run.t[steps] + run.t[steps + 1]) / 2, run.t[steps + 1] - run.t[steps]
    edges = np.concatenate([[t0], (times[1:] + times[:-1]) / 2, [t1]])
    y, yp = run(times), run.derivative(times)
    looks = [Look(at, float(times[i]), y[i], yp[i], float(h[i]), t1 - t0) for i, at in enumerate(systems_at(run, times, system))]
    found = _at(looks, min(SEEN * tolerance, VISIBLE))
    behind = [max(late, one.unseen if one.unseen * look.h > FOLLOWED else 0.0)
              for look, one, late in zip(looks, found, _behind(looks, found), strict=True)]  # fmt: skip
    return [Growth(float(a), float(b), one.rate, one.unseen, asked)
            for a, b, one, asked in zip(edges[:-1], edges[1:], found, behind, strict=True)]  # fmt: skip


def total(parts: Sequence[Growth]) -> float:
    """The sum over a run of rate times duration: the growth that a disturbance would have with frozen coefficients."""
    return sum(part.rate * (part.end - part.begin) for part in parts)


class Look(NamedTuple):
    """A state of a run at which roots are sought: the equations there, time (s), y and y' (n,), the step of the run (s), and the
    length of the run (s)."""

    system: System
    t: float
    y: Array
    yp: Array
    h: float
    span: float


class Found(NamedTuple):
    """What a look finds. rate: the largest real part of a root, 1/s; unseen: the largest magnitude (1/s) of one that grows and
    whose disturbance is not seen, 0: there is none; size: that of the disturbance that grows fastest, over the scales, where it
    is not seen, else 0."""

    rate: float = 0.0
    unseen: float = 0.0
    size: float = 0.0


def _at(looks: list[Look], seen: float) -> list[Found]:
    """What is found at every state; seen: size of a disturbance that is seen, over the scales."""
    n = looks[0].system.n
    if n > MOST:
        return [Found(1 / look.h, 1 / look.h) if _grows_sparse(look) else Found() for look in looks]
    shifted = np.array([_shifted(look) for look in looks])
    if n <= SMALL:
        return [_roots(look, S, values, seen) for look, S, values in zip(looks, shifted, np.linalg.eigvals(shifted), strict=True)]
    return [_roots(look, S, np.linalg.eigvals(S), seen) if _grows(S) else Found()
            for look, S in zip(looks, shifted, strict=True)]  # fmt: skip


def _roots(look: Look, S: Array, values: NDArray[np.complex128], seen: float) -> Found:
    """What is found at a state, from the matrix of `_shifted` and its eigenvalues."""
    rate = float(np.max(_back(values, look.h).real, initial=0.0))
    if rate * look.span < HARMLESS:
        return Found(rate)
    values, left, right = eig(S, left=True)
    roots = _back(values, look.h)
    growing = np.flatnonzero(roots.real * look.span > HARMLESS)
    sizes = np.array([_size(left[:, j], right[:, j], look, abs(roots[j])) for j in growing])
    roots, unseen = roots[growing], sizes < seen
    fastest = int(np.argmax(roots.real)) if len(roots) else 0
    size = float(sizes[fastest]) if len(roots) and unseen[fastest] else 0.0
    return Found(rate, float(np.max(np.abs(roots[unseen]), initial=0.0)), size)


def _behind(looks: list[Look], found: list[Found]) -> list[float]:
    """For every state the inverse of the step (1/s) that is asked for because the disturbance that grows fastest, not seen by the
    solver, has grown by less until the next state than its roots say; 0 where it has not."""
    asked = [0.0] * len(looks)
    for i, (a, b) in enumerate(pairwise(found)):
        if a.size > 0 and b.size > 0:
            expected = (a.rate + b.rate) / 2 * (looks[i + 1].t - looks[i].t)
            if log(b.size / a.size) < KEEPS * expected - SPARE:
                for k in (i, i + 1):
                    asked[k] = CLOSER / min(looks[i].h, looks[i + 1].h)
    return asked


def _shifted(look: Look) -> Array:
    """The matrix (E + h A / SHIFT)^-1 E of the linearised equations E x' + A x = 0 at a state, in scaled unknowns. A root r of
    the equations is an eigenvalue 1 / (1 - h r / SHIFT) of it; infinite roots, of constraints, are 0. It is 0 where the
    equations are singular."""
    system, zero = look.system, np.zeros((look.system.n, look.system.n))
    fy, fyp = system.jacobian_parts(look.t, look.y, look.yp)
    if fy.ndim == 1:
        fy, fyp = as_csc(system, fy).toarray(), as_csc(system, fyp).toarray()
    E = fyp * system.scale
    both = fy * (system.scale * (look.h / SHIFT)) + E
    size = np.max(np.abs(both), axis=1, keepdims=True)
    if not np.isfinite(both).all() or not np.all(size > 0):
        return zero
    try:
        return np.asarray(np.linalg.solve(both / size, E / size))
    except np.linalg.LinAlgError:
        return zero


def _back(values: NDArray[np.complex128], h: float) -> NDArray[np.complex128]:
    """The roots (1/s) that belong to eigenvalues of the matrix of `_shifted`; -inf beyond RESOLVED times SHIFT / h."""
    finite = np.abs(values) * RESOLVED > 1
    return np.where(finite, (SHIFT / h) * (1 - 1 / np.where(finite, values, 1.0)), -np.inf)


def _size(left: Array, right: Array, look: Look, magnitude: float) -> float:
    """Size of a disturbance that grows in a motion, over the scales of the unknowns: the part of its rate along the disturbance
    over the magnitude of the root (1/s)."""
    system = look.system
    counts = np.array([kind not in ("lambda", "mu", "z") for kind in system.kinds])
    overlap = abs(np.vdot(left, right))
    if not overlap > 0:
        return 0.0
    part = abs(np.vdot(left, look.yp / system.scale)) / overlap
    return float(part * np.max(np.abs(right[counts]), initial=0.0) / magnitude)


def _grows(S: Array) -> bool:
    """Whether one of many roots r has a positive real part, from the matrix S of `_shifted`: three disturbances are multiplied
    ROUNDS times by 2 S - 1, that is (1 + z) / (1 - z) with z = h r / SHIFT, whose magnitude is 1 for undamped vibrations."""
    return _rises(lambda x: np.asarray(S @ x), np.random.default_rng(3).normal(size=(len(S), 3)))


def _grows_sparse(look: Look) -> bool:
    """As `_grows`, for a system with too many unknowns for full matrices."""
    system = look.system
    matrix = IterationMatrix(system, np.ones(1), np.zeros(0, complex))
    try:
        matrix.refresh(look.t, look.y, look.yp)
        matrix.factor(look.h / SHIFT)
    except SingularMatrixError:
        return False
    scale = system.scale[:, None]

    def product(x: Array) -> Array:
        right = np.array([matrix.mass(one) for one in (x * scale).T])
        return np.asarray(matrix.solved(right).T / scale * (SHIFT / look.h))

    return _rises(product, np.random.default_rng(3).normal(size=(system.n, 3)))


def _rises(product: Callable[[Array], Array], x: Array) -> bool:
    """Whether repeated multiplication of x (n, k) by 2 S - 1 makes it grow, S: the matrix whose `product` is given. The first
    products, with S alone, remove what constraints do not allow."""
    for _ in range(3):
        x = product(x)
    sizes = []
    for _ in range(ROUNDS):
        x = 2 * product(x) - x
        sizes.append(float(np.linalg.norm(x)))
    half = ROUNDS // 2
    return max(sizes[-2:]) > GROWS * max(sizes[half - 2 : half])


def unfollowed(parts: Sequence[Growth]) -> tuple[Bound, ...]:
    """The bounds of the steps in the parts of a run in which they do not follow a disturbance that is not seen. A run and its
    companions keep different shares of them."""
    return tuple(Bound(part.begin, part.end, 1 / part.behind) for part in parts if part.behind > 0)


def unseen(parts: Sequence[Growth]) -> tuple[Bound, ...]:
    """The bounds of the steps in the parts of a run in which a disturbance grows that is not seen, followed or not."""
    return tuple(Bound(part.begin, part.end, 1 / part.unseen) for part in parts if part.unseen > 0)


def left_behind(parts: Sequence[Growth]) -> list[str]:
    """Words about disturbances that the steps of a run do not follow."""
    slow = [part for part in parts if part.behind > 0]
    if not slow:
        return []
    fastest = max(part.behind for part in slow)
    return [f"from about t = {slow[0].begin:.4g} to {slow[-1].end:.4g} s small disturbances grow at {fastest:.3g} 1/s, which the "
            "steps do not follow, so that a disturbance may fade in the run although it grows in the equations; take steps of "
            f"{FOLLOWED / fastest:.2g} s or less, or a solver with error control"]
