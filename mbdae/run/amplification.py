"""How much small disturbances grow over a run: the linearised equations, carried along its steps.

In every piece of the run E x' + A x = 0, with E = dF/dy' and A = dF/dy, is solved by one step of Radau IIA(3) for some
disturbances at once; with many unknowns E and A are those in the middle of the piece. Pieces are some steps together, as far as
that changes nothing, or parts of steps in which positions change much. `growing` sees to it that the steps of a run follow what
grows.

What rings because the beams of a scene start unstrained under load.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from mbdae.deferred import later
from mbdae.errors import MbdaeError, internal
from mbdae.integrators import radau_table
from mbdae.integrators.matrices import searches
from mbdae.integrators.solution import Solution, systems_at
from mbdae.native import Entries, Index, address, declared, whole
from mbdae.native.equations import Number, Pointer, Whole
from mbdae.native.sparse import Matrix, SingularMatrixError
from mbdae.run.choice import prepared_from
from mbdae.system.base import Array, System
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import RELAXED
from mbdae.threads import check, single_threaded
from mbdae.values import largest

if TYPE_CHECKING:
    from mbdae.system.start_of_beams import Ringing, allowed_by, ringing
else:
    allowed_by, ringing = later("mbdae.system.start_of_beams", "allowed_by", "ringing")

T = TypeVar("T")
State = tuple[Array, float, float]
ROUNDED = 1e-16  #: relative round-off of a coordinate
#: words are said where round-off, as it grows over the run, may make more than this fraction of the accuracy asked: that of many
#: steps adds up. Measured with CVODE 2e-9 off a rest at 1: an error of 4 times the accuracy where this was .6
DECIDES = 0.3
LEAST = 10.0  #: growth with frozen coefficients below which round-off decides nothing that can be asked
#: largest number of unknowns for which all stages of a step are solved together, and for which all roots are computed at once:
#: with 54 to 58 unknowns of beams the first took .7 ms a piece, and equations of its middle .2
STAGED, SMALL = 24, 60
LARGEST_KEPT = 300  #: number of unknowns up to which matrices are kept with a system, because they take little memory
COPIES = 2  #: number of disturbances, drawn at random, that are carried along
MOST = 50_000  #: largest number of pieces of a run along which disturbances are carried
#: largest numbers of steps of the run in one piece that are tried one after the other, each where the pieces are FEWER times more
#: than before and less than the finest, until the largest rise (natural logarithm) changes by less than SURE, or by less than
#: CLEAR of its distance from the value on which a decision depends
TOGETHER, FEWER, SURE, CLEAR = (32, 16, 8, 4, 2, 1), 1.5, 0.5, 0.3
#: largest number of velocities of a scene of which it is looked at what rings after its start, and smallest amplitude that is
#: told, over the scene's length
LOOKED, SEEN = 300, 1e-9
#: the same for equations that do not tell when they vary: longer pieces pass over what the steps of the run follow
UNKNOWN = (4, 2, 1)
DIGITS = 3  #: decimals with which a growth (natural logarithm) is told: it is sure to SURE
BLOCK = 2**13  #: number of pieces whose states are computed together, times the number of unknowns
SLACK = 3.0  #: growth (natural logarithm) beyond that asked for after which it is not carried on
#: disturbances of positions and other slow unknowns, of velocities, and those that follow from them; that nothing of them is left
SLOW, FAST, OTHER, NOTHING = 0, 1, 2, 2
VANISHED = 1e-150  #: size of a disturbance, after a step from size 1, below which nothing is left of it: no motion is free
#: largest change of a position in a piece, in pieces of several steps up to WIDER times as large; largest number of parts of a
#: step
TURNED, WIDER, PARTS = 0.1, 8, 16
PLACES = 50  #: number of times at which the largest coordinate is sought


class Disturbances:
    """Small disturbances of a run of a system, as they grow along its steps."""

    def __init__(self, system: System, run: Solution, longest: Array | float = math.inf) -> None:
        """longest: of the pieces of the run along which they are carried, s, in every step (k,), or one for all."""
        self._system, self._run, self._longest = system, run, longest
        kinds = np.array(system.kinds)
        self._kind = np.select([kinds == "v", np.isin(kinds, ("lambda", "mu", "z"))], [FAST, OTHER], SLOW)

    def growth(self, enough: float = math.inf) -> tuple[float, float] | None:
        """(natural logarithm of the largest factor by which a disturbance grows from one time of the run to a later one, time of
        the largest, s). It ends early where the logarithm exceeds `enough`. None where `course` is None."""
        course = self.course(enough)
        return None if course is None else rise(course)

    @single_threaded
    def course(self, enough: float = math.inf, least: float = 0.0) -> tuple[Array, Array] | None:
        """Times (k,), s, at the ends of pieces of the run, and there the natural logarithm of the size (k,) of the disturbances
        that grow most. Velocities are measured in units in which they are as large as the positions in the median, so that a
        vibration rises by nothing. The pieces are halved until the largest rise stays, is surely below `least`, or above or below
        `enough`. None where an impact leaves it unknown, equations are singular, or there are more than MOST pieces."""
        if self._run.stats.contacts or len(self._run.t) < 2:
            return None
        finest, found, fewest = self._pieces(1), None, 0.0
        for together in TOGETHER if self._system.timeline is not None else UNKNOWN:
            ends = self._pieces(together) if together > 1 else finest
            if together > 1 and not fewest <= len(ends) <= len(finest) / FEWER:
                continue
            before, found, fewest = found, self._along(ends, enough) if len(ends) <= MOST else None, FEWER * len(ends)
            if found is None or (before is not None and _settled(rise(before)[0], rise(found)[0], enough, least)):
                break
        return found

    def _along(self, ends: Array, enough: float) -> tuple[Array, Array] | None:
        """`course` by the pieces of the run between `ends` (s)."""
        h, run, n = np.diff(ends), self._run, self._system.n
        systems = systems_at(run, (ends[1:] + ends[:-1]) / 2, self._system)
        c = radau_table(3).c if n <= STAGED else np.array([0.5])
        x = np.where(self._kind[:, None] == OTHER, 0.0, spread((COPIES, n)).T)
        sizes, state, done, ended = np.empty((len(h), 2)), (x, 0.0, math.inf), 0, False
        try:
            while done < len(h) and not ended:
                check("the growth of small disturbances was computed")
                system, last = systems[done], done + 1
                while last < min(len(h), done + BLOCK // n + 1) and systems[last] is system:
                    last += 1
                times = np.minimum((ends[done:last, None] + c * h[done:last, None]).ravel(), run.t[-1])
                equations, *values = system.linear_stages(times, run(times), run.derivative(times))
                carrier = kept(system, "carrier", partial(Carrier, system, equations, self._kind))
                count, ended, state = system.owner.waiting(
                    carrier.carry, state, enough + SLACK, h[done:last], values, sizes[done:last])
                done += count
        except SingularMatrixError:
            return None
        slow, fast = sizes[:done].T
        return ends[1 : 1 + done], np.logaddexp(2 * slow, 2 * (fast + np.median(slow - fast))) / 2

    def _pieces(self, together: int) -> Array:
        """Times (s) that divide the run into pieces in which no position changes by more than TURNED (over its scale): of at most
        so many steps `together`, or parts of a step."""
        run, here = self._run, np.array(self._system.kinds) == "q"
        moved = np.max(np.abs(np.diff(run.y[:, here] / self._system.scale[here], axis=0)), axis=1, initial=0.0)
        moved, long = moved / (TURNED * min(together, WIDER)), np.diff(run.t) / self._longest
        count = np.maximum(np.clip(np.ceil(moved), 1, PARTS), np.ceil(long)).astype(int)
        moved = np.maximum(moved, long)
        filled = np.floor(np.cumsum(np.clip(moved, 1 / together, 1.0)) + 1e-9)
        last = np.append(filled[1:] != filled[:-1], True) if len(filled) else np.zeros(0, dtype=bool)
        last |= count > 1
        last[:-1] |= count[1:] > 1
        last[np.minimum(np.searchsorted(run.t[1:], self._edges), len(last) - 1)] = True
        count[~last] = 0
        step = np.repeat(np.arange(len(count)), count)
        part = np.arange(len(step)) + 1 - (np.cumsum(count) - count)[step]
        inside = run.t[step] + np.diff(run.t)[step] * part / count[step]
        return np.concatenate([run.t[:1], np.where(part < count[step], inside, run.t[1:][step])])

    @cached_property
    def _edges(self) -> Array:
        """Times (s) between which inputs of time are smooth and vary little, as far as the equations know them."""
        t0, t1 = float(self._run.t[0]), float(self._run.t[-1])
        line = None if self._system.timeline is None else self._system.timeline(t0, t1)
        return np.zeros(0) if line is None else np.concatenate([line.edges, line.stretches.edges, line.stretches.kinks])


class CarryTable(ctypes.Structure):
    """The C struct `Carry` of adjoint.c, with the same members in the same order."""

    _fields_ = (("matrix", Pointer), *((name, Whole) for name in ("n", "nnz", "stages")),
                *((name, Pointer) for name in ("first", "row_of", "column_of", "kind", "scale", "A", "b", "weights", "x", "r",
                                               "w")),
                *((name, Number) for name in ("size", "least", "most", "vanished")), ("bad", Whole), ("ended", Whole))


#: function that opens the library and states the type of the function that carries disturbances, for ctypes
carrying = declared(("stages_carry", Whole, (Pointer, Whole, Whole, Whole, *[Pointer] * 4)))


class Carrier:
    """One step of Radau IIA(3) after the other of the linearised equations of a system, for COPIES disturbances."""

    def __init__(self, system: System, equations: Any, kind: Index) -> None:
        """kind: of every unknown of the system whether its disturbance moves SLOW or FAST or is an OTHER one."""
        table, n, self._own = radau_table(3), equations.n, system.n
        stages = len(table.c) if system.n <= STAGED else 1
        real, pairs, weights = _weights()
        self._matrix = matrix_of(system, equations, *((np.ones(1), pairs[:0], stages) if stages > 1 else (real, pairs)))
        self._entries = entries = entries_of(equations)
        kinds, scale = np.full(n, OTHER), np.ones(n)
        kinds[: system.n], scale[: system.n] = kind, system.scale
        self._x, r, w = np.zeros((n, COPIES)), np.empty(stages * n * COPIES), np.empty(4 * stages * n * COPIES)
        kept = [entries.indptr, entries.row_of, entries.column_of, whole(kinds), scale,
                *(np.ascontiguousarray(part) for part in (table.A, table.b, weights)), self._x, r, w]
        self._kept = kept
        self._table = CarryTable(self._matrix.address, n, entries.nnz, stages, *map(address, kept), 0.0, 0.0, 0.0, VANISHED)

    def carry(self, state: State, most: float, h: Array, values: list[Array], sizes: Array) -> tuple[int, bool, State]:
        """Along pieces of lengths h (k,), s, with the derivatives `values` at their stages. state: disturbances (n, COPIES), the
        natural logarithm of their growth so far, and the least of it; most: growth beyond the least after which it is not carried
        on; sizes (k, 2) takes those of the slow and the fast ones. Returns the number of pieces, whether it ended, and the new
        state; SingularMatrixError where equations are singular, or nothing is left."""
        table, matrix, at = self._table, self._matrix, ctypes.addressof(self._table)
        self._x[: self._own], table.size, table.least = state
        table.most, table.ended = most, 0
        given = [np.ascontiguousarray(h), *in_pattern(values, len(h) * table.stages, self._entries)]
        rest = *map(address, given), address(sizes)
        done = carrying().stages_carry(at, len(h), 0, False, *rest)
        while done < len(h) and not table.ended:
            matrix.renewed(table.bad, float(h[done]))
            done = carrying().stages_carry(at, len(h), done, True, *rest)
        if table.ended == NOTHING:
            raise SingularMatrixError
        return done, bool(table.ended), (self._x[: self._own].copy(), table.size, table.least)


@dataclass(frozen=True, eq=False)
class Amplified:
    """The growth of disturbances over a run (natural logarithm of the factor), None where not known; computed when it is called.
    A copy in another process does not have the equations and returns None."""

    run: Solution

    def __call__(self) -> float | None:
        found = Disturbances(self.run.systems[0][1], self.run).growth() if self.run.systems else None
        return None if found is None else round(found[0], DIGITS)


def decided_by_round_off(prepared: Prepared | None, run: Solution, frozen: float, accuracy: float) -> list[str]:
    """Words about a run in which small disturbances grow so much that round-off decides digits of the accuracy asked. prepared:
    None for own equations; frozen: the sum of the growth with frozen coefficients; where it is too small for that, the growth
    along the run is not computed."""
    system = run.systems[0][1]
    if frozen < LEAST:
        return []
    enough = math.log(DECIDES * accuracy / (ROUNDED * (1.0 if prepared is None else _farthest(prepared, run))))
    found = Disturbances(system, run).growth(enough) if frozen > enough else None
    if found is None or found[0] < enough:
        return []
    factor = f"e^{found[0]:.0f} (1e{found[0] / math.log(10):.0f})"
    decisive = accuracy * math.exp(-min(found[0], 300.0))
    measure = "the scene's length (or rad)" if prepared is not None else "the scale of an unknown"
    return [f"small disturbances grow by a factor of {factor} up to t = {found[1]:.4g} s: what is below {decisive:.0e} of "
            f"{measure} at the start, round-off too, decides whether an accuracy of {accuracy:g} is kept; a shorter run, or a "
            "start farther from the unstable rest, can be predicted"]


def _farthest(prepared: Prepared, run: Solution) -> float:
    """Largest coordinate of a place of a body in a run over the scene's length, 1 where that is less (angles in rad)."""
    some = slice(None, None, len(run.t) // PLACES + 1)
    q = prepared.states(run.t[some], run.y[some])[0]
    places = [np.max(np.abs(q[:, node.q : node.q + node.kind.translations])) for node in prepared.model.nodes
              if node.unit == "m" and node.kind.translations]
    return max(1.0, float(max(places, default=0.0)) / prepared.length)


def spread(shape: tuple[int, int]) -> Array:
    """Numbers from -1 to 1 without any pattern that equations could have, for disturbances in all directions."""
    return np.cos(np.arange(1.0, shape[0] * shape[1] + 1) ** 2 * math.sqrt(2)).reshape(shape)


def _settled(before: float, now: float, enough: float, least: float) -> bool:
    """Whether the largest rise, which was `before` with pieces twice as long, is known as `Disturbances.course` needs it."""
    left = abs(now - enough) if math.isfinite(enough) else least - now
    return abs(now - before) < max(SURE, CLEAR * left)


def rise(course: tuple[Array, Array]) -> tuple[float, float]:
    """The largest rise of a course, and the time (s) of its end."""
    t, size = course
    rises = size - np.minimum.accumulate(size)
    i = largest(rises)
    return float(rises[i]), float(t[i])


def pattern_of(equations: Any) -> Any:
    """The pattern of the derivatives of equations (a System, or an Assembly) by columns, None where they are full."""
    return equations.sparsity if equations.pattern is None else equations.pattern


def entries_of(equations: Any) -> Entries:
    """The entries of the derivatives of equations."""
    pattern = pattern_of(equations)
    return Entries.full(equations.n) if pattern is None else Entries(equations.n, pattern.indptr, pattern.indices)


def in_pattern(values: list[Array], states: int, entries: Entries) -> list[Array]:
    """Derivatives at states as C reads them: entry after entry, state after state."""
    given = [np.ascontiguousarray(part, dtype=float) for part in values]
    if any(part.shape != (states, entries.nnz) for part in given):
        raise internal(f"derivatives of shapes {[part.shape for part in given]} were given at {states} states in a pattern of "
                       f"{entries.nnz} entries")
    return given


def matrix_of(system: System, equations: Any, real: Array, pairs: NDArray[np.complex128], stages: int = 1) -> Matrix:
    """Iteration matrices of the linearised equations of a system (`System.linear_stages`); stages: the unknowns of so many states
    together, each of which depends on all of them."""
    n, scale, entries = equations.n, np.ones(equations.n), entries_of(equations)
    scale[: system.n] = system.scale
    if stages > 1:
        rows = [entries.row_of[a:b] + i * n for a, b in pairwise(entries.indptr.tolist()) for i in range(stages)]
        counts = np.tile(np.diff(entries.indptr) * stages, stages)
        entries = Entries(n * stages, np.concatenate([[0], np.cumsum(counts)]), np.concatenate(rows * stages))
    searched = () if pattern_of(equations) is None else searches(tuple(equations.kinds) * stages)
    power = np.tile(np.asarray(equations.index) - 1.0, stages)
    made = Matrix(entries, np.tile(scale, stages), power, real, pairs, searched)
    if searched and stages == 1 and n == system.n and system.kept is not None:
        made.orders.present = system.kept.get("order")
    return made


def kept(system: System, name: str, make: Callable[[], T]) -> T:
    """What was made for a system before, unless it is large."""
    if system.kept is None or system.n > LARGEST_KEPT:
        return make()
    if name not in system.kept:
        system.kept[name] = make()
    return cast(T, system.kept[name])


@cache
def _weights() -> tuple[Array, NDArray[np.complex128], Array]:
    """The real and the complex eigenvalue m of A^-1 of Radau IIA(3), and the weights w with which one of its steps of h is the
    sum of w (m E / h + A)^-1 E / h, of the complex one, given by its parts, twice the real part."""
    table = radau_table(3)
    values, vectors = np.linalg.eig(table.A_inv)
    start = np.linalg.solve(vectors.astype(complex), np.ones(len(values), complex))
    weights = vectors[-1] * values * start
    real, pair = (weights[[int(np.argmin(np.abs(values - value))) for value in some]] for some in (table.real, table.pairs))
    return table.real, table.pairs, np.concatenate([real.real, np.ascontiguousarray(pair).view(float)])


def ringing_of(prepared: Prepared) -> Ringing | None:
    """What rings because the beams of a scene start unstrained under load; None where nothing does, where it is not known what a
    start without ringing is, and with more than LOOKED velocities."""
    m, start = prepared.mechanics, prepared.start
    if not m.model.lines or m.nu > LOOKED or start.relaxed is not None:
        return None
    try:
        relaxed = prepared_from(m.model.scene, RELAXED).start
    except (MbdaeError, np.linalg.LinAlgError):
        return None
    time, units = np.array([start.t]), m.velocity_units[prepared.all_bodies.numbering.of_velocities]
    moved = prepared.all_bodies.velocity_map(time, prepared.all_bodies.reduced(start.q[None], start.u[None])[0])[0]
    x = np.linalg.lstsq(np.array([m.rates(start.q, e) for e in np.eye(m.nu)]).T, start.q - relaxed.q, rcond=None)[0]
    free = allowed_by(m.constraint_jacobian(time, start.q[None])[0] @ moved, units)
    found = ringing(m, start.q, x, start.u - relaxed.u, moved, free)
    return found if found.amplitude > max(SEEN, relaxed.relaxed or 0.0) * prepared.length else None
