"""A periodic motion: one period of a scene in equal steps, and whether state and equations repeat after it.

Small departures from a motion over one period, by the exact derivatives of its Radau steps.

With the stages Y_i of a step, F_y dY_i + F_y' sum_j A^-1_ij (dY_j - dy_0) / h = 0: the exact derivative of the step. The
departures are those that the constraints allow, of positions (as virtual displacements), velocities and internal states.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import symengine as se
from numpy.typing import NDArray

from mbdae.analysis.frame import attitude, position
from mbdae.analysis.pencil import acting, derivatives
from mbdae.analysis.reduced import free_basis
from mbdae.analysis.state import kinks
from mbdae.errors import OptionError, SteadyError
from mbdae.inputs import time_symbol
from mbdae.inputs.resolution import LongestStep
from mbdae.integrators import CollocationTable
from mbdae.integrators.dense import Collocation
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Solution, systems_at
from mbdae.symbolic.frames import NodeKind
from mbdae.system.base import Array
from mbdae.system.model.nodes import Node
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.system.start_with_contacts import state_scale
from mbdae.values import largest

Indices = NDArray[np.intp]

SOLVER = RadauIIA(3)
FIRST = 1e-8  #: rtol of the run that shows whether the motion repeats
#: where a period has at most WHOLE steps, a step may cover a whole stretch of an input (`inputs.resolution`); with more steps it
#: may cover the part WHOLE / steps of one, so that all steps shrink alike, as the estimate of their error assumes
WHOLE = 16
#: largest relative difference of the state after a period from the start, and of the equations from those a period before, with
#: which a motion counts as periodic; exponents change by about as much
RETURN = 1e-4
FEWEST, MOST = 16, 8192  #: smallest and largest number of steps over a period
EQUAL = 1e-9  #: relative difference of steps that count as equal
GRADED = 10.0  #: ratio of the longest to the shortest step of a run from which an orbit is followed in unequal steps
CLOSINGS = 3  #: number of corrections by which a state near a motion comes to satisfy the constraints
SAMPLES = 24  #: largest number of times at which the equations are compared with those of a period later


@dataclass(frozen=True)
class Orbit:
    """One period in steps of h (steps,) s, shorter at breaks of inputs: t (steps, s), y and y' (steps, s, n) at all stages, and
    the system (steps,) that holds in every step; run: the same as a solution; smooth: whether no input jumps or has a kink."""

    h: Array
    systems: list[SceneSystem]
    table: CollocationTable
    t: Array
    y: Array
    yp: Array
    run: Solution
    smooth: bool


def followed(system: SceneSystem, period: float, shares: Array) -> Orbit:
    """The motion over a period from the system's start, in steps that end at shares (steps + 1,) of the period, from 0 to 1;
    raises SolverError where the steps are too long."""
    count, widths = len(shares) - 1, np.diff(shares)
    step, share = period / count, min(1.0, WHOLE / count)
    if np.ptp(widths) > EQUAL * widths[0]:
        edges = system.t0 + period * shares
        system, step = system.starting(system.t0, system.y0, system.yp0, LongestStep(edges, 1.0, edges)), period
    solution = RadauIIA(SOLVER.stages, step=step).solve(system, system.t0 + period, share=share)
    dense = solution.interpolant
    assert isinstance(dense, Collocation)
    table, widths = dense.table, np.diff(solution.t)
    Z = np.concatenate([dense.inner, (dense.ends - solution.y[:-1])[:, None]], axis=1)
    yp = np.einsum("ij,kjn->kin", table.A_inv, Z) / widths[:, None, None]
    systems = _systems(solution, system, solution.t[:-1])
    line = None if system.timeline is None else system.timeline(system.t0, system.t0 + period)
    smooth = line is None or not (len(line.breaks) or len(line.stretches.kinks))
    return Orbit(widths, systems, table, solution.t[:-1, None] + widths[:, None] * table.c, solution.y[:-1, None] + Z, yp,
                 solution, smooth)


def shares_of(run: Solution, free: bool) -> Array:
    """Shares (steps + 1,) of the period at which the first steps end, half as many as an adaptive run over it took: equal
    ones, but every second of that run where nothing depends on time (`free`), so that jumps between slow parts are followed."""
    count = max(FEWEST, run.stats.steps // 2)
    shares = (run.t - run.t[0]) / (run.t[-1] - run.t[0])
    widths = np.diff(shares)
    if not free or len(widths) < FEWEST or np.max(widths[1:-1]) < GRADED * np.min(widths[1:-1]):
        return np.linspace(0, 1, count + 1)
    inner = shares[2:-1:2]
    return np.concatenate([[0.0], inner[inner < 1 - widths.min()], [1.0]])


def halved(shares: Array) -> Array:
    """Shares of steps of half the length."""
    return np.sort(np.concatenate([shares, (shares[1:] + shares[:-1]) / 2]))


def timed_item(prepared: Prepared) -> str | None:
    """Name of the first item that depends on the time; None where none does: the motion repeats by itself, where it repeats."""
    model, clock = prepared.model, se.Symbol(str(time_symbol()))
    items = [(instance.item, instance.timed) for _, _, instance in model.instances()]
    items += [(line.beam.name, line.timed) for line in model.lines]
    return next((name for name, timed in items if any(clock in se.sympify(e).free_symbols for e in timed.values())), None)


def _systems(run: Solution, system: SceneSystem, t: Array) -> list[SceneSystem]:
    """The system (k,) at every time of a run."""
    return systems_at(run, t, system)  # type: ignore[return-value]


LATER = 0.37  #: part of the period after which a motion that is at a kink at its start is looked at again


@dataclass(frozen=True)
class Return:
    """A motion that repeats: its largest relative distance from the start after the period, the numbers of the internal
    states that act on it, shares of the period at which the first steps end, -1 for unknowns (n,) of quaternions that
    changed their sign, and the items at whose kinks the motion stays: at its start and later."""

    off: float
    acting: Indices
    shares: Array
    sign: Array
    kinks: list[tuple[str, Array]]


def check_return(prepared: Prepared, system: SceneSystem, period: float, most: float = RETURN) -> Return:
    """Raises SteadyError where state or equations do not repeat after the period, the state but for `most`. Whole turns are a
    return."""
    run = RadauIIA(SOLVER.stages, rtol=FIRST).solve(system, system.t0 + period)
    ends = prepared.states(run.t[[0, -1]], run.y[[0, -1]])
    acting = acting_states(system, run)
    off, difference = _difference(prepared, period, *ends, acting - system.numbering.nq - system.numbering.nu)
    if off > most:
        raise SteadyError(f"after period = {period:.9g} s {difference}: give a whole period of the motion, and start on that "
                          f"motion: pass at=(result, t) of a run whose transients have died out, or "
                          f"at=s.equilibrium(frame=...)")
    sign, turns = later(prepared, system, run.y[[0, -1]], acting)
    changed_equation = changed(prepared, system, run, period, (sign, turns))
    if changed_equation:
        raise SteadyError(f"the equations do not repeat after period = {period:.9g} s, although the motion does: "
                          f"{changed_equation}; give a period after which loads and prescribed motions repeat too (a force "
                          f"that grows with every turn never does)")
    return Return(off, acting, shares_of(run, timed_item(prepared) is None), sign, _stays_at(prepared, run, period))


def _stays_at(prepared: Prepared, run: Solution, period: float) -> list[tuple[str, Array]]:
    """The items at whose kinks a motion is at its start and at a time inside the period: what crosses a kink does no harm."""
    times = run.t[0] + period * np.array([0.0, LATER])
    found: list[tuple[str, Array]] = []
    for t, *state in zip(times, *prepared.states(times, run(times)), strict=True):
        found = kinks(prepared.mechanics, (float(t), *state))
        if not found:
            break
    return found


def acting_states(system: SceneSystem, run: Solution) -> Indices:
    """Indices of the internal states that other equations depend on along a motion; the others have no multiplier."""
    states = system.numbering.nq + system.numbering.nu + np.arange(len(system.numbering.states))
    if not len(states):
        return states
    some = _some(len(run.t))
    size = sum(abs(derivatives(of, run.t[i], run.y[i], run.yp[i])[0])
               for i, of in zip(some, _systems(run, system, run.t[some]), strict=True))
    return acting(size, np.setdiff1d(np.arange(system.n), states), states)


def _some(count: int) -> Indices:
    """Indices below `count`, at most SAMPLES, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(count, SAMPLES)).astype(int))


def _difference(prepared: Prepared, period: float, q: Array, u: Array, s: Array, acting: Indices) -> tuple[float, str]:
    """Largest relative difference of two states (2, ...), and which it is, in words."""
    m = prepared.mechanics
    found = [_moved(node, q[0], q[1], prepared.length) for node in m.model.nodes]
    speed = np.maximum(np.max(np.abs(u[0]) / m.velocity_units, initial=0.0), 1 / period) * m.velocity_units
    off = np.abs(u[1] - u[0]) / speed
    for node in m.model.nodes:
        own = slice(node.u, node.u + node.kind.sizes[1])
        worst = float(np.max(off[own], initial=0.0))
        found.append((worst, f"the velocity of '{node.name}' differs from that at the start by {worst:.2g} of the largest"))
    size, names = np.maximum(np.abs(s[0]), state_scale(m)), list(m.numbering.states.values())
    for i in acting:
        off_s = abs(float(s[1, i] - s[0, i]))
        found.append((off_s / size[i], f"the state {names[i]} differs from its start by {off_s:.3g}"))
    return found[largest([off for off, _ in found])]


def _moved(node: Node, before: Array, after: Array, length: float) -> tuple[float, str]:
    """Largest distance of a node from where it was (relative to `length` of the scene; rotations in rad without whole turns), and
    what moved, in words."""
    if node.kind is NodeKind.COORDINATE:
        off = float(after[node.q] - before[node.q])
        off = abs(off - 2 * np.pi * round(off / (2 * np.pi))) if node.unit == "rad" else abs(off)
        return off / (1.0 if node.unit == "rad" else length), f"joint '{node.name}' is {off:.3g} {node.unit} from its start"
    shift = float(np.linalg.norm(position(node, after) - position(node, before)))
    turn = attitude(node, after).T @ attitude(node, before)
    spin = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    angle = float(np.arctan2(np.linalg.norm(spin), (np.trace(turn) - 1) / 2))
    if angle > shift / length:
        return angle, f"'{node.name}' is turned by {angle:.3g} rad from its start"
    return shift / length, f"'{node.name}' is {shift:.3g} m from its start"


def changed(prepared: Prepared, system: SceneSystem, run: Solution, period: float,
             later: tuple[Array, Array]) -> str | None:
    """Which equation differs a period later on the same motion; None where all repeat."""
    sign, turns = later
    scale = np.maximum(system.scale, np.max(np.abs(run.y), axis=0))
    rates, F = scale * (2 * np.pi / period), np.empty(system.n)
    some, (rows, columns) = _some(len(run.t)), _entries(system)
    for i, system in zip(some, _systems(run, system, run.t[some]), strict=True):  # noqa: B020
        there = run.t[i] + period, sign * run.y[i] + turns, sign * run.yp[i]
        step = min(i, len(run.t) - 2)
        inside = float(run.t[step] + run.t[step + 1]) / 2  # an input may jump at the ends of the step
        with system.within(inside):
            before = [np.abs(part).ravel() for part in system.jacobian_parts(run.t[i], run.y[i], run.yp[i])]
        with system.within(inside + period):
            after = [np.abs(part).ravel() for part in system.jacobian_parts(*there)]
            system.residual(*there, F)
        size, off = np.zeros(system.n), np.abs(F)
        for a, b, weights in zip(before, after, (scale, rates), strict=True):
            np.maximum.at(size, rows, a * weights[columns])
            np.maximum.at(off, rows, np.abs(a - b) * weights[columns])
        worst = largest(off / size)
        if off[worst] > RETURN * size[worst]:
            return (f"{system.equations[worst]} at t = {there[0]:.6g} s differs from that a period before by "
                    f"{off[worst] / size[worst]:.2g} of its largest term")
    return None


def _entries(system: SceneSystem) -> tuple[Indices, Indices]:
    """Rows and columns of the entries of dF/dy and dF/dy' in the order in which `jacobian_parts` has them."""
    if (pattern := system.sparsity) is None:
        rows, columns = np.indices((system.n, system.n))
        return rows.ravel(), columns.ravel()
    return pattern.indices, np.repeat(np.arange(system.n), np.diff(pattern.indptr))


def later(prepared: Prepared, system: SceneSystem, ends: Array, acting: Indices) -> tuple[Array, Array]:
    """Signs of quaternions and whole turns of angles (n,) by which unknowns differ after a period; ends (2, n): unknowns before
    and after it."""
    nb, sign = system.numbering, np.ones(system.n)
    for node in prepared.model.nodes:
        if node.kind is NodeKind.SPATIAL:
            own = np.flatnonzero((nb.of_positions >= node.q + 3) & (nb.of_positions < node.q + 7))
            sign[own] = -1.0 if ends[1][own] @ ends[0][own] < 0 else 1.0
    shift, turns = ends[1] - sign * ends[0], np.zeros(system.n)
    own = np.flatnonzero(np.isin(nb.of_positions, angles(prepared)))
    turns[own] = 2 * np.pi * np.round(shift[own] / (2 * np.pi))
    following = np.setdiff1d(np.flatnonzero(np.array(system.kinds) == "s"), acting)
    turns[following] = shift[following]
    return sign, turns


def angles(prepared: Prepared) -> list[int]:
    """Numbers of the positions of all nodes that are angles."""
    nodes = prepared.model.nodes
    return [n.q + 2 for n in nodes if n.kind is NodeKind.PLANAR] + [
        n.q for n in nodes if n.kind is NodeKind.COORDINATE and n.unit == "rad"]


@dataclass(frozen=True)
class Departures:
    """Departures of the unknowns that the constraints allow at the start: dy = map x, x = units * Q a.

    map (n, nx): unknowns from p (virtual displacements), w (velocities), s (internal states); back (nx, n): those from the
    unknowns after the period, where quaternions may have changed sign; units (nx,): size of each; Q (nx, k)
    orthonormal; velocities: number of entries of p, and of w; rows, C: the equations that are constraints of positions and
    velocities, and what x changes them by.
    """

    map: Array
    back: Array
    units: Array
    Q: Array
    velocities: int
    rows: Any
    C: Array

    def closed(self, system: SceneSystem, y: Array) -> Array:
        """Unknowns y (n,) near the start changed as little as possible so that the constraints hold."""
        inverse, F = np.linalg.pinv(self.C * self.units) if self.rows else np.zeros((len(self.units), 0)), np.empty(system.n)
        for _ in range(CLOSINGS):
            system.residual(system.t0, y, system.yp0, F)
            y = y - self.map @ (self.units * (inverse @ F[self.rows]))
        return y

    @property
    def start(self) -> Array:
        """dy (n, k): column i is the departure of the unknowns for the i-th unit vector a."""
        return np.asarray(self.map @ (self.units[:, None] * self.Q))

    def read(self, dy: Array) -> Array:
        """a (k, columns): the coordinates of departures dy (n, columns) after the period."""
        return np.asarray(self.Q.T @ ((self.back @ dy) / self.units[:, None]))


def departures(prepared: Prepared, system: SceneSystem, returned: Return, period: float, size: float = 1.0) -> Departures:
    """The departures at the start of a system, a state of a motion that returns; size: of one, in lengths of the scene, rad."""
    m, nb, y = prepared.mechanics, system.numbering, system.y0
    nq, nu, acting = nb.nq, nb.nu, returned.acting
    Fy = derivatives(system, system.t0, y, system.yp0)[0].tocsr()
    _refuse_rigid(system, Fy)
    q = prepared.states(np.array([system.t0]), y[None])[0][0]
    H = np.array([m.rates(q, e)[nb.of_positions] for e in np.eye(m.nu)[nb.of_velocities]]).T
    length = size * m.velocity_units[nb.of_velocities]
    nx = 2 * nu + len(acting)
    T, back = np.zeros((system.n, nx)), np.zeros((nx, system.n))
    T[:nq, :nu], back[:nu, :nq] = H, H.T / np.sum(H * H, axis=0)[:, None]
    for first, at in ((nu, np.arange(nq, nq + nu)), (2 * nu, acting)):
        own = first + np.arange(len(at))
        T[at, own] = back[own, at] = 1.0
    units = np.concatenate([length, length * (2 * np.pi / period), system.scale[acting]])
    rows = [nb.start[block] + i for block in ("mu", "lambda") if "mu" in system.kinds for i in range(nb.m)]
    C = Fy[rows] @ T if rows else np.zeros((0, nx))
    Q = free_basis(C, units) / units[:, None]
    expected = nx - 2 * nb.m
    if Q.shape[1] != expected:
        raise OptionError(f"floquet: the constraints allow {Q.shape[1]} independent changes of positions, velocities and states "
                          f"at the start, where {expected} are expected: the position is singular; start at another instant "
                          f"of the motion (at=(result, t))")
    return Departures(T, back * returned.sign, units, Q, nu, rows, C)


def _refuse_rigid(system: SceneSystem, Fy: sp.csr_matrix) -> None:
    z = np.flatnonzero(np.array(system.kinds) == "z")
    rigid = z[np.asarray(abs(Fy[z][:, z]).sum(axis=1)).ravel() == 0] if len(z) else z
    if len(rigid):
        raise OptionError(f"floquet needs finite stiffnesses of all beams, and the one that belongs to {system.names[rigid[0]]} "
                          f"is infinite; give that beam a section with finite ones")
