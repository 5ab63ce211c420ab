"""Linearised equations about a steady motion: modes, frequencies, damping and growth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg

from mbdae.analysis.elastic import dynamics, stresses_of
from mbdae.analysis.equilibrium import Equilibrium
from mbdae.analysis.frame import RotatingFrame, advanced, attitude, frame_at, motion_in_words
from mbdae.analysis.modes import DEFAULT, lowest, softest_beam
from mbdae.analysis.pencil import Pencil, Reduced, complete_system, free_basis, pencil, reduced
from mbdae.analysis.steady import STEADY, departure, times_to_compare
from mbdae.elements.line_shape import table
from mbdae.errors import OptionError, SteadyError
from mbdae.formulations.index3 import Index3
from mbdae.results.beams import foot
from mbdae.results.result import Result
from mbdae.scene.components import Body, Place
from mbdae.scene.scene import SceneData
from mbdae.system.assembly import SceneSystem
from mbdae.system.base import Array
from mbdae.system.explicit import state_rates
from mbdae.system.mechanics import Mechanics
from mbdae.system.nodes import Node
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.start import Start
from mbdae.threads import single_threaded

LARGEST = 1600  #: states up to which all eigenvalues are found
RESOLVED = 1e-7  #: eigenvalues below this part of the largest are rounding of a double zero


@dataclass(frozen=True)
class Shape:
    """Motion of a node or a place in a mode, complex: displacement (3,) m and rotation (3,) rad along the frame's axes; of
    a beam (nodes, 3) each, at the lengths `stations` (nodes,) along it, m."""

    displacement: Array
    rotation: Array
    stations: Array | None = None


@dataclass(frozen=True)
class Mode:
    """One mode: eigenvalue, 1/s (of a conjugate pair the one with the positive imaginary part), and its shape.

    `mode["body"]` is the motion of a body's node: virtual displacement and rotation along the frame's axes, scaled so
    that the largest component (m, rad) is 1; of a beam that of all its nodes. `mode[body.at(...)]` is that of a place.
    """

    eigenvalue: complex
    vector: Array  #: (nu,) complex
    owner: Linearization

    @property
    def frequency(self) -> float:
        """Hz, of the (damped) oscillation."""
        return self.eigenvalue.imag / (2 * np.pi)

    @property
    def angular_frequency(self) -> float:
        """rad/s, of the (damped) oscillation."""
        return self.eigenvalue.imag

    @property
    def growth(self) -> float:
        """1/s; negative: the mode decays."""
        return self.eigenvalue.real

    @property
    def damping(self) -> float:
        """Damping ratio: 1 and more without oscillation, negative where the mode grows, 0 for an eigenvalue 0."""
        size = abs(self.eigenvalue)
        return 0.0 - self.eigenvalue.real / size if size else 0.0

    def __getitem__(self, body: str | Body | Place) -> Shape:
        if isinstance(body, Place):
            return self._at(body)
        name = body if isinstance(body, str) else body.name
        model = self.owner.prepared.model
        line = model.line(model.scene[name])
        if line is not None:
            shapes = [self._of(node) for node in line.nodes]
            move, turn = (np.array([getattr(s, k) for s in shapes]) for k in ("displacement", "rotation"))
            return Shape(move, turn, line.mesh.stations)
        return self._of(model.node(model.scene[name]))

    def _of(self, node: Node | None) -> Shape:
        move, turn = np.zeros(3, dtype=complex), np.zeros(3, dtype=complex)
        if node is not None:
            n, part = node.kind.translations, self.vector[node.u : node.u + node.kind.sizes[1]]
            move[:n] = part[:n]
            if len(part) > n:
                turn[2 if len(part) == 3 else slice(None)] = part[2] if len(part) == 3 else part[3:]
        return Shape(move, turn)

    def _at(self, place: Place) -> Shape:
        """On a rigid body with its arm, on a beam by its shape functions and with the arm to its axis."""
        model, start = self.owner.prepared.model, self.owner.prepared.start
        body = model.scene[place.body.name]
        line, node = model.line(body), model.node(body)
        if line is not None:
            e, xi = foot(line.mesh, place.point)
            at, whole = table(line.mesh.order, np.array([xi])).values[0], self[body]
            move, turn = (at @ a[line.mesh.elements[e]] for a in (whole.displacement, whole.rotation))
            body = min((n.body for n in line.nodes if n.body), key=lambda b: float(np.linalg.norm(b.position - place.point)))
            node, origin = model.node(body), at @ line.mesh.curve[e]
        else:
            shape, origin = self._of(node), body.position
            move, turn = shape.displacement, shape.rotation
        if node is None or not node.kind.turns:
            return Shape(move, turn)
        arm = attitude(node, start.q) @ body.rotation.T @ (place.point - origin)
        return Shape(move + np.cross(turn, self.owner.axes.T @ arm), turn)

    @property
    def participation(self) -> dict[str, float]:
        """Share of every body in the kinetic energy of the mode (of its displacements, where nothing moves has mass)."""
        return self.owner._shares(self.vector)


class Linearization:
    """Linear equations of small departures from a steady motion, and their modes by rising frequency.

    Arrays over the modes: `eigenvalues` (1/s), `frequencies` (Hz), `angular_frequencies` (rad/s), `damping` (ratios),
    `growth` (1/s). One mode per conjugate pair, one per real eigenvalue. `M`, `C`, `K`: the second-order equations
    M x'' + C x' + K x = 0 of the displacements p = `basis` x the constraints leave, p (nu,) along the frame's axes.
    """

    def __init__(self, prepared: Prepared, frame: RotatingFrame, t: float, pencil: Pencil, count: int | None) -> None:
        self.prepared, self.frame, self.t, self.pencil = prepared, frame.name, t, pencil
        self.axes = frame.rotation
        model = prepared.model
        if model.lines:
            values, shapes = lowest(pencil, count or DEFAULT, softest_beam(model))
        else:
            values, vectors = eigenpairs(self.equations, count)
            shapes = self.basis @ vectors[: len(self.M)]
        self.modes = [Mode(complex(v), _scaled(x), self) for v, x in zip(values, shapes.T, strict=True)]

    @cached_property
    def equations(self) -> Reduced:
        """The second-order equations on the displacements the constraints leave, dense."""
        return reduced(self.pencil, free_basis(self.pencil.constraints, self.prepared.mechanics.velocity_units))

    @property
    def M(self) -> Array:
        """Mass matrix."""
        return self.equations.M

    @property
    def C(self) -> Array:
        """Damping and gyroscopic matrix."""
        return self.equations.C

    @property
    def K(self) -> Array:
        """Stiffness matrix."""
        return self.equations.K

    @property
    def basis(self) -> Array:
        """(nu, freedoms)."""
        return self.equations.N

    @property
    def eigenvalues(self) -> Array:
        """(modes,) complex, 1/s."""
        return np.array([mode.eigenvalue for mode in self.modes], dtype=complex)

    @property
    def frequencies(self) -> Array:
        """(modes,) Hz."""
        return np.array([mode.frequency for mode in self.modes])

    @property
    def angular_frequencies(self) -> Array:
        """(modes,) rad/s."""
        return np.array([mode.angular_frequency for mode in self.modes])

    @property
    def damping(self) -> Array:
        """(modes,) damping ratios."""
        return np.array([mode.damping for mode in self.modes])

    @property
    def growth(self) -> Array:
        """(modes,) 1/s, positive where a mode grows."""
        return np.array([mode.growth for mode in self.modes])

    @property
    def stable(self) -> bool:
        """Whether no mode grows (by more than rounding)."""
        size = np.max(np.abs(self.eigenvalues), initial=0.0)
        return bool(np.all(self.growth <= 1e-9 * size))

    def __iter__(self) -> Iterator[Mode]:
        return iter(self.modes)

    def __len__(self) -> int:
        return len(self.modes)

    @cached_property
    def _metric(self) -> Any:
        """(nu, nu) mass matrix in the frame's components, from M of the nodes."""
        return self.pencil.C.T @ (self.pencil.C.T @ self.prepared.mechanics.mass.T).T

    def _shares(self, vector: Array) -> dict[str, float]:
        m, energy = self.prepared.mechanics, np.abs(np.conj(vector) * (self._metric @ vector))
        if not np.max(energy, initial=0.0):
            energy = np.abs(vector / m.velocity_units) ** 2
        total = float(np.sum(energy)) or 1.0
        shares: dict[str, float] = {}
        for node, body in m.model.bodies:
            part = float(np.sum(energy[node.u : node.u + node.kind.sizes[1]])) / total
            shares[body.owner.name] = shares.get(body.owner.name, 0.0) + part
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    def __str__(self) -> str:
        head = f"scene '{self.prepared.model.scene.name}', t = {self.t:g} s, departures resolved in the frame of '{self.frame}'"
        lines = [head, f"{'mode':>4}  {'Hz':>11}  {'rad/s':>11}  {'damping':>10}  {'growth 1/s':>11}  bodies"]
        for i, mode in enumerate(self.modes):
            who = ", ".join(f"{name} {share:.0%}" for name, share in list(mode.participation.items())[:4] if share >= 0.05)
            lines.append(f"{i + 1:>4}  {mode.frequency:>11.5g}  {mode.angular_frequency:>11.5g}  {mode.damping:>10.3g}  "
                         f"{mode.growth:>11.4g}  {who}")  # fmt: skip
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<Linearization of '{self.prepared.model.scene.name}' in the frame of '{self.frame}': {len(self.modes)} modes>"


def _scaled(vector: Array) -> Array:
    """The vector with its largest component 1."""
    largest = vector[np.argmax(np.abs(vector))] if len(vector) else 1.0
    return np.asarray(vector / largest) if largest else vector


def eigenpairs(equations: Reduced, count: int | None) -> tuple[Array, Array]:
    """Eigenvalues with imaginary part >= 0 by rising frequency, and the vectors (states, modes)."""
    E, A = equations.first_order()
    size = len(E)
    if size == 0:
        return np.zeros(0, dtype=complex), np.zeros((0, 0), dtype=complex)
    if size > LARGEST and count is None:
        raise OptionError(f"the linearised scene has {size} states; above {LARGEST} ask for the lowest modes: count=20")
    if size <= LARGEST:
        S = np.linalg.solve(E, -A)
        values, vectors = np.linalg.eig(S)
        largest = float(np.max(np.abs(values)))
    else:
        values, vectors, largest = _lowest(E, A, int(count or 1))
    values = np.where(np.abs(values) <= RESOLVED * largest, 0.0, values)
    values = np.where(np.abs(values.imag) <= 1e-9 * np.abs(values), values.real + 0j, values)
    keep = np.flatnonzero(values.imag >= 0)
    keep = keep[np.lexsort((values[keep].real, np.round(values[keep].imag / max(largest, 1e-300), 12)))][:count]
    return values[keep], vectors[:, keep]


def _lowest(E: Array, A: Array, count: int) -> tuple[Array, Array, float]:
    """The eigenpairs nearest to zero by inverse iteration (Arnoldi), and a size to compare them with."""
    from scipy.sparse.linalg import LinearOperator, eigs

    size = float(np.linalg.norm(A) / np.linalg.norm(E)) or 1.0
    shift = 1e-6 * size
    factors = scipy.linalg.lu_factor(A + shift * E)
    inverse = LinearOperator(A.shape, matvec=lambda x: scipy.linalg.lu_solve(factors, E @ x))
    values, vectors = eigs(inverse, k=min(2 * count + 2, len(A) - 2), which="LM")
    values = shift - 1 / values
    return values, vectors, float(np.max(np.abs(values)))


@single_threaded
def linearize(scene: SceneData, at: Any = None, frame: Any = None, count: int | None = None) -> Linearization:
    """The equations linearised about a steady motion, in a frame: s.ground (default), or a body that turns steadily.

    at: a Result (its end), (Result, t), an equilibrium, or None for the start of the scene. Departures are resolved along
    the frame's axes: the ground for a shaft in anisotropic bearings, a rotating body for blades on a hub. count: lowest
    modes only (default: all; with beams the lowest 20). Raises SteadyError, with the equations of that instant as `.frozen`,
    where they depend on time in that frame.
    """
    if count is not None and not count >= 1:
        raise OptionError(f"count = {count}: give the number of lowest modes, 1 or more, or None for all")
    prepared = prepare(scene, _start(scene, at))
    start, m = prepared.start, prepared.mechanics
    axes = frame_at(prepared.model, frame if frame is not None else prepared.model.scene.ground, start.q, start.u)
    system = complete_system(m, Index3().spec())
    z = _stresses(at, m, start)
    p = _pencil(system, m, axes, (start.t, start.q, start.u, start.s, z))
    found = Linearization(prepared, axes, start.t, p, count)
    beams = (system, z) if m.model.lines else None
    reason = departure(prepared, axes, start.t, start.q, start.u, start.s, beams=beams) or _varies(system, found, axes, z)
    if reason:
        raise SteadyError(f"the linearised equations depend on t in the frame of '{axes.name}': {reason}; periodic, use floquet, "
                          f"where the motion or its equations repeat; otherwise resolve in the frame of a body that turns "
                          f"steadily (frame=...), or start from s.equilibrium(frame=...)", found)  # fmt: skip
    return found


def _start(scene: SceneData, at: Any) -> Start | None:
    if at is None:
        return None
    result, t = at if isinstance(at, tuple) and len(at) == 2 else (at, None)
    if not isinstance(result, Result):
        raise OptionError(f"at = {at!r}: give a Result, (Result, t), an equilibrium, or None for the start of the scene")
    said, meant = ([item.name for item in known._items] for known in (result.prepared.model.scene, scene))
    if said != meant:
        raise OptionError(f"at is a state of scene '{result.prepared.model.scene.name}', which has other items than "
                          f"'{scene.name}': give a state of this scene")  # fmt: skip
    return result.state_for(scene, t)


def _stresses(at: Any, m: Mechanics, start: Start) -> Array:
    """Stress unknowns of all beams: those of an equilibrium, else from the positions."""
    if isinstance(at, Equilibrium):
        return np.asarray(at.point.y[at.kinds == "z"])
    return stresses_of(m, start.q, start.u)


def _pencil(system: SceneSystem, m: Mechanics, frame: RotatingFrame, state: tuple[float, Array, Array, Array, Array]) -> Pencil:
    """The pencil at a state (t, q, u, s, z), with its accelerations and multipliers."""
    t, q, u, s, z = state
    if m.model.lines:
        found = dynamics(system, m, t, q, u, s, z)
        return pencil(system, m, frame, t, found.y, found.yp)
    kinds = np.array(system.kinds)
    a, multipliers = m.accelerations(np.array([t]), q[None], u[None], s[None])
    y, yp = np.zeros(system.n), np.zeros(system.n)
    y[kinds == "q"], y[kinds == "v"], y[kinds == "s"] = q, u, s
    y[kinds == "lambda"] = multipliers[0] / system.numbering.scaling()
    yp[kinds == "q"], yp[kinds == "v"], yp[kinds == "s"] = m.rates(q, u), a[0], state_rates(m, t, q, u, s)
    return pencil(system, m, frame, t, y, yp)


def _varies(system: SceneSystem, found: Linearization, frame: RotatingFrame, z: Array) -> str | None:
    """What in the equations has changed a while later on the steady motion; None where they are constant."""
    m, start = found.prepared.mechanics, found.prepared.start
    rates = state_rates(m, start.t, start.q, start.u, start.s) if len(start.s) else start.s
    for tau in times_to_compare(m, frame, start.t, start.q, start.u, start.s):
        q, u = advanced(m, frame, start.q, start.u, tau)
        later = frame_at(m.model, frame.name, q, u) if frame.node is not None else frame
        p = _pencil(system, m, later, (start.t + tau, q, u, start.s + tau * rates, z))
        change = _changed(m, found.pencil, p) if m.model.lines else _changed_on_basis(m, found, p, frame)
        if change:
            return f"{change} after {tau:.3g} s"
    return None


def _changed(m: Mechanics, a: Pencil, b: Pencil) -> str | None:
    """With beams the equations are compared as they stand, sparse; in the mixed form their stiffness is not among them, so that
    it does not hide what else changes."""
    row = _turned_row(m, *(p.constraints * m.velocity_units for p in (a, b)))
    if row:
        return row
    for name, matrices, column in (("inertia", (a.E, b.E), "w"), ("damping", (a.A, b.A), "w"), ("stiffness", (a.A, b.A), "p")):
        x, y = (p.part(M, "w", column) for p, M in zip((a, b), matrices, strict=True))
        off = abs(x - y).tocsc()
        if off.nnz and off.max() > STEADY * float(abs(x).max()):
            motion = np.zeros(m.nu)
            motion[int(np.argmax(off.max(axis=0).toarray()))] = 1.0
            return f"the {name} against {motion_in_words(m.model, motion, m.velocity_units)} changes"
    return None


def _turned_row(m: Mechanics, before: Array, after: Array) -> str | None:
    """A constraint row that leaves the span the rows had before."""
    if not len(after):
        return None
    span = np.linalg.qr(before.T)[0]
    left = np.linalg.norm(after.T - span @ (span.T @ after.T), axis=0) / np.linalg.norm(after, axis=1)
    worst = int(np.argmax(left))
    return f"row {m.rows[worst].name} acts along another direction" if left[worst] > STEADY else None


def _changed_on_basis(m: Mechanics, found: Linearization, p: Pencil, frame: RotatingFrame) -> str | None:
    before = found.equations
    G = p.constraints * m.velocity_units
    if np.abs(p.constraints @ before.N).max(initial=0.0) > STEADY * np.abs(G).max(initial=1e-300):
        worst = int(np.argmax(np.max(np.abs(p.constraints @ before.N), axis=1)))
        return f"row {m.rows[worst].name} acts along another direction"
    return _differs(m, before, reduced(p, before.N), float(np.max(np.abs(frame.rate))))


def _differs(m: Mechanics, a: Reduced, b: Reduced, rate: float) -> str | None:
    size = np.abs(a.K).max(initial=0.0) + rate * np.abs(a.C).max(initial=0.0) + rate**2 * np.abs(a.M).max(initial=0.0)
    for name, x, y, unit in (("inertia", a.M, b.M, rate**2), ("damping", a.C, b.C, rate), ("stiffness", a.K, b.K, 1.0)):
        off = np.abs(x - y)
        scale = size / unit if unit else np.abs(x).max(initial=0.0)
        if off.max(initial=0.0) > STEADY * scale and off.max() > 0:
            column = int(np.argmax(off.max(axis=0)))
            motion = motion_in_words(m.model, a.N[:, column], m.velocity_units)
            return f"the {name} against {motion} changes by {off.max() / np.abs(x).max(initial=off.max()):.2g} of the largest"
    return None
