"""Linearised equations about a steady motion: modes, frequencies, damping and growth."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from mbdae.analysis.elastic import dynamics, stresses_of
from mbdae.analysis.equilibrium import Equilibrium
from mbdae.analysis.frame import RotatingFrame, advanced, body_of, frame_at, free_shifts, motion_in_words
from mbdae.analysis.mesh import OnMesh, finer
from mbdae.analysis.modes import DEFAULT, lowest, softest_beam
from mbdae.analysis.energy import Laws
from mbdae.analysis.pencil import Pencil, basis, complete_system, pencil, with_errors
from mbdae.analysis.reduced import Reduced, errors_of, free_basis, reduced
from mbdae.analysis.shapes import Mode, Modes, motion, participants, scaled, shares
from mbdae.analysis.spectrum import Structure, spectrum
from mbdae.analysis.steady import STEADY, reason_not_steady, times_to_compare
from mbdae.errors import OptionError, SteadyError, naming_arguments
from mbdae.formulations.index3 import Index3
from mbdae.notation import counted
from mbdae.results.result import Result
from mbdae.scene.scene import SceneData
from mbdae.scene.sensed import refuse_sampled
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.right_hand_side import state_rates
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.start.start import Start
from mbdae.threads import single_threaded
from mbdae.ties import largest
from mbdae.values import optional, shown, whole

#: relative changes of the state by which the rounding of its numbers is carried to the equations, and how often
ULP, SAMPLES = float(np.finfo(float).eps), 2
#: a motion counts as one of the scene as a whole where it differs from it by at most this part
SHIFT = 1e-5


State = tuple[float, Array, Array, Array, Array]  #: t, q, u, s, z


class Linearization(OnMesh, Modes[Mode]):
    """Linear equations of small departures from a steady motion, and their modes by rising frequency.

    Arrays over the modes: `eigenvalues` (1/s), `frequencies` (Hz), `angular_frequencies` (rad/s), `damping` (ratios),
    `growth` (1/s). One mode per conjugate pair, one per real eigenvalue. `M`, `C`, `K` (freedoms, freedoms): the equations
    M x'' + C x' + K x = 0 of the displacements p = `basis` x that the constraints allow, p (nu,) along the frame's axes.
    With beams `mesh` names the mesh, and `mesh_error` (modes,) is the error of the eigenvalues that this mesh causes.
    """

    def __init__(self, prepared: Prepared, frame: RotatingFrame, t: float, pencil: Pencil, count: int | None,
                 known: Structure) -> None:  # fmt: skip
        self.prepared, self.frame, self.t, self.pencil = prepared, frame.name, t, pencil
        self.axes = frame.rotation
        model = prepared.model
        if model.lines:
            found = lowest(pencil, count or DEFAULT, softest_beam(model), known)
            shapes = found.vectors
        else:
            errors = errors_of(pencil, self.equations, prepared.mechanics.velocity_units)
            found = spectrum(self.equations, errors, count, known)
            shapes = self.basis @ found.vectors[: len(self.M)]
        self.errors, self.stable = found.errors, found.stable
        self.modes = [Mode(complex(v), scaled(x), self) for v, x in zip(found.values, shapes.T, strict=True)]

    @cached_property
    def equations(self) -> Reduced:
        """The second-order equations of the displacements that the constraints allow, dense."""
        return reduced(self.pencil, free_basis(self.pencil.constraints, self.prepared.mechanics.velocity_units))

    @property
    def M(self) -> Array:
        """Mass matrix (freedoms, freedoms)."""
        return self.equations.M

    @property
    def C(self) -> Array:
        """Damping and gyroscopic matrix (freedoms, freedoms)."""
        return self.equations.C

    @property
    def K(self) -> Array:
        """Stiffness matrix (freedoms, freedoms), symmetric where the loads are conservative."""
        return self.equations.K

    @property
    def basis(self) -> Array:
        """Basis (nu, freedoms) of the displacements that the constraints allow."""
        return self.equations.N

    @property
    def eigenvalues(self) -> Array:
        """Eigenvalues (modes,), complex, 1/s."""
        return np.array([mode.eigenvalue for mode in self.modes], dtype=complex)

    roots = eigenvalues

    @property
    def damping(self) -> Array:
        """Damping ratios (modes,)."""
        return np.array([mode.damping for mode in self.modes])

    @cached_property
    def _metric(self) -> Any:
        """(nu, nu) mass matrix in the frame's components, from M of the nodes."""
        return self.pencil.C.T @ (self.pencil.C.T @ self.prepared.mechanics.mass.T).T

    def shares(self, vector: Array) -> dict[str, float]:
        """Share of every body in the kinetic energy of a motion (nu,), by falling share."""
        m = self.prepared.mechanics
        return shares(m, self._metric, motion(m, vector))

    def __str__(self) -> str:
        head = f"scene '{self.prepared.model.scene.name}', t = {self.t:g} s, small motions in the axes of '{self.frame}'"
        lines = [head, f"{'mode':>4}  {'Hz':>11}  {'rad/s':>11}  {'damping':>10}  {'growth 1/s':>11}  bodies"]
        for i, mode in enumerate(self.modes):
            lines.append(f"{i + 1:>4}  {mode.frequency:>11.5g}  {mode.angular_frequency:>11.5g}  {mode.damping:>10.3g}  "
                         f"{mode.growth:>11.4g}  {participants(mode)}")  # fmt: skip
        return "\n".join(lines + ([self._on_mesh] if self.mesh else []))

    def __repr__(self) -> str:
        return (f"<Linearization of '{self.prepared.model.scene.name}' in the frame of '{self.frame}': "
                f"{counted(len(self.modes), 'mode')}{', ' * bool(self.mesh)}{self._on_mesh}>")  # fmt: skip


@naming_arguments
@single_threaded
def linearize(scene: SceneData, at: Any = None, frame: Any = None, count: int | None = None) -> Linearization:
    """The equations linearised about a steady motion, in a frame: s.ground (default), or a body that turns steadily.

    at: a Result (its end), (Result, t), an equilibrium, or None for the start of the scene. Departures are resolved along
    the frame's axes: the ground for a shaft in anisotropic bearings, a rotating body for blades on a hub. count: lowest
    modes only (default: all; with beams the lowest 20). Raises SteadyError, with the equations of that instant as `.frozen`,
    where they depend on time in that frame.
    """
    refuse_sampled(scene, "linearize")
    count = optional("count", count, whole, "give the number of lowest modes, 1 or more, or None for all", least=1)
    body = body_of(scene, frame if frame is not None else scene.ground)
    prepared = prepare(scene, start_at(scene, at))
    start, m = prepared.start, prepared.mechanics
    axes = frame_at(prepared.model, body, start.q, start.u)
    system = complete_system(m, Index3().spec())
    z = _stresses(at, m, start)
    state = (start.t, start.q, start.u, start.s, z)
    p = _pencil_with_errors(system, m, axes, state)
    found = Linearization(prepared, axes, start.t, p, count, _structure(system, m, axes, state))
    found._finer = finer(partial(linearize, frame=axes.name, count=count), prepared.model.scene, at)
    beams = (system, z) if m.model.lines else None
    change = reason_not_steady(prepared, axes, start.t, start.q, start.u, start.s, beams=beams) or _varies(system, found, axes, z)
    if change:
        raise SteadyError(f"the linearised equations change with time in the frame of '{axes.name}': {change}; where they are "
                          f"periodic, use s.floquet(period); otherwise give the body that turns steadily as frame=, or start "
                          f"from a steady motion, at=s.equilibrium(frame=...)", found)  # fmt: skip
    return found


def start_at(scene: SceneData, at: Any) -> Start | None:
    """The state that `at` names: a Result (its end), (Result, t), an equilibrium; None for the start of the scene."""
    if at is None:
        return None
    given, t = at if isinstance(at, tuple) and len(at) == 2 else (at, None)
    if not isinstance(given, Result):
        raise OptionError(f"at = {shown(at)} is no state: give a Result (its end), (Result, t), an equilibrium, or None for the "
                          f"start of the scene")
    result = given
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


def _state(system: Assembly, m: Mechanics, state: State) -> tuple[Array, Array]:
    """y and y' (n,) of a state (t, q, u, s, z), with its accelerations and multipliers."""
    t, q, u, s, z = state
    if m.model.lines:
        found = dynamics(system, m, t, q, u, s, z)
        return found.y, found.yp
    kinds = np.array(system.kinds)
    a, multipliers = m.accelerations(np.array([t]), q[None], u[None], s[None])
    y, yp = np.zeros(system.n), np.zeros(system.n)
    y[kinds == "q"], y[kinds == "v"], y[kinds == "s"] = q, u, s
    y[kinds == "lambda"] = multipliers[0] / system.numbering.scaling()
    yp[kinds == "q"], yp[kinds == "v"], yp[kinds == "s"] = m.rates(q, u), a[0], state_rates(m, t, q, u, s)
    return y, yp


def _pencil(system: Assembly, m: Mechanics, frame: RotatingFrame, state: State) -> Pencil:
    """The pencil at a state."""
    return pencil(system, m, frame, state[0], *_state(system, m, state))


def _pencil_with_errors(system: Assembly, m: Mechanics, frame: RotatingFrame, state: State) -> Pencil:
    """The pencil at a state with bounds of its errors, those of the state's numbers among them: positions, and the reactions that
    follow from them, are known up to rounding."""
    rng = np.random.default_rng(11)
    beside = [_pencil(system, m, frame, (state[0], *(x * (1 + ULP * rng.choice([-1.0, 1.0], len(x))) for x in state[1:])))
              for _ in range(SAMPLES)]  # fmt: skip
    return with_errors(system, m, frame, state[0], *_state(system, m, state), beside)


def _structure(system: Assembly, m: Mechanics, frame: RotatingFrame, state: State) -> Structure:
    """What the laws one by one, and the motions of the scene as a whole, say of the equations at a state."""
    t, q, u = state[:3]
    weights = np.asarray(m.weight.diagonal())

    @cache
    def laws() -> Laws:
        y, yp = _state(system, m, state)
        terms = [fy for fy, _ in system.evaluation.jacobian_by_law(t, y, yp)]
        return Laws(terms, basis(system, m, frame, q, u), m.nu, weights)

    @cache
    def shifts() -> Array:
        turned = basis(system, m, frame, q, u).C.T @ u
        return free_shifts(m.model, frame, q, turned) * np.sqrt(weights)[:, None]

    def free(p: Any) -> bool:
        p = p * np.sqrt(weights)
        moving = np.repeat(*_moving(m, p))  # what stands still, as a driven hub in its own axes, is not shifted
        some = shifts() * moving[:, None]
        off = p - some @ np.linalg.lstsq(some, p, rcond=None)[0]
        return bool(np.linalg.norm(off) <= SHIFT * np.linalg.norm(p))

    still = not frame.turns and not np.any(u) and not m.model.lines
    return Structure(lambda name, N: still and laws().surely(name, N), free, float(np.linalg.norm(frame.rate)))


def _moving(m: Mechanics, p: Any) -> tuple[Array, Array]:
    """Of every node whether it takes part in a motion p (nu,), and the number of its displacements."""
    sizes = np.array([node.kind.sizes[1] for node in m.model.nodes])
    parts = [np.max(np.abs(p[node.u : node.u + size])) for node, size in zip(m.model.nodes, sizes, strict=True)]
    return np.asarray(parts > SHIFT**2 * np.max(np.abs(p))), sizes


def _varies(system: Assembly, found: Linearization, frame: RotatingFrame, z: Array) -> str | None:
    """What in the equations differs at later times of the steady motion; None where they are constant."""
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
    """What differs between the equations a and b of a scene with beams, in words; None where nothing does. The sparse equations
    are compared: with the stresses as unknowns they do not contain the stiffness of the beams, beside which other changes would
    be too small to see."""
    row = _turned_row(m, *(p.constraints * m.velocity_units for p in (a, b)))
    if row:
        return row
    for name, matrices, column in (("inertia", (a.E, b.E), "w"), ("damping", (a.A, b.A), "w"), ("stiffness", (a.A, b.A), "p")):
        x, y = (p.part(M, "w", column) for p, M in zip((a, b), matrices, strict=True))
        off = abs(x - y).tocsc()
        if off.nnz and off.max() > STEADY * float(abs(x).max()):
            motion = np.zeros(m.nu)
            motion[largest(off.max(axis=0).toarray().ravel())] = 1.0
            return f"the {name} against {motion_in_words(m.model, motion, m.velocity_units)} changes"
    return None


def _turned_row(m: Mechanics, before: Array, after: Array) -> str | None:
    """A text about a constraint row that is no linear combination of the rows before; None where there is none."""
    if not len(after):
        return None
    span = np.linalg.qr(before.T)[0]
    left = np.linalg.norm(after.T - span @ (span.T @ after.T), axis=0) / np.linalg.norm(after, axis=1)
    worst = largest(left)
    return f"the force of constraint {m.rows[worst].name} has another direction" if left[worst] > STEADY else None


def _changed_on_basis(m: Mechanics, found: Linearization, p: Pencil, frame: RotatingFrame) -> str | None:
    before = found.equations
    G = p.constraints * m.velocity_units
    if np.abs(p.constraints @ before.N).max(initial=0.0) > STEADY * np.abs(G).max(initial=1e-300):
        worst = largest(np.max(np.abs(p.constraints @ before.N), axis=1))
        return f"the force of constraint {m.rows[worst].name} has another direction"
    return _differs(m, before, reduced(p, before.N), float(np.max(np.abs(frame.rate))))


def _differs(m: Mechanics, a: Reduced, b: Reduced, rate: float) -> str | None:
    size = np.abs(a.K).max(initial=0.0) + rate * np.abs(a.C).max(initial=0.0) + rate**2 * np.abs(a.M).max(initial=0.0)
    for coefficient, x, y, unit in (("inertia", a.M, b.M, rate**2), ("damping", a.C, b.C, rate), ("stiffness", a.K, b.K, 1.0)):
        off = np.abs(x - y)
        scale = size / unit if unit else np.abs(x).max(initial=0.0)
        if off.max(initial=0.0) > STEADY * scale and off.max() > 0:
            column = largest(off.max(axis=0))
            motion = motion_in_words(m.model, a.N[:, column], m.velocity_units)
            part = off.max() / np.abs(x).max(initial=off.max())
            return f"the {coefficient} against {motion} changes by {part:.2g} of the largest {coefficient}"
    return None
