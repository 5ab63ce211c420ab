"""Linearised equations about a steady motion: modes, frequencies, damping and growth."""

from __future__ import annotations

from functools import cached_property, partial
from typing import Any

import numpy as np

from mbdae.analysis.equilibrium import Equilibrium
from mbdae.analysis.frame import RotatingFrame, advanced, body_of, frame_at, motion_in_words, stresses_of
from mbdae.analysis.modes import DEFAULT, lowest, softest_beam
from mbdae.analysis.pencil import Pencil, complete_system
from mbdae.analysis.plane import LOOK, OUT_OF_PLANE, looked_at
from mbdae.analysis.reduced import Reduced, errors_of, free_basis, reduced, refuse_rolling
from mbdae.analysis.shapes import Mode, Modes, OnMesh, motion, participants, repeated, scaled, shares
from mbdae.analysis.spectrum import Structure, spectrum
from mbdae.analysis.state import at_kinks, kinks, pencil_at, pencil_with_errors, sides, structure, told
from mbdae.analysis.steady import STEADY, reason_not_steady, times_to_compare
from mbdae.errors import OptionError, SteadyError, naming_arguments, warn
from mbdae.formulations import Index3
from mbdae.notation import counted
from mbdae.results.result import Result
from mbdae.results.stored_parts import started
from mbdae.scene.scene import SceneData
from mbdae.scene.sensed import refuse_sampled
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.right_hand_side import state_rates
from mbdae.system.base import Array
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import Prepared, prepare
from mbdae.system.start import Start
from mbdae.threads import single_threaded
from mbdae.values import flag, largest, option, optional, shown, whole


class Linearization(OnMesh, Modes[Mode]):
    """Linear equations of small departures from a steady motion, and their modes by rising frequency.

    Arrays over the modes: `eigenvalues` (1/s), `frequencies` (Hz), `angular_frequencies` (rad/s), `damping` (ratios),
    `growth` (1/s). One mode per conjugate pair, one per real eigenvalue. `M`, `C`, `K` (freedoms, freedoms): the equations
    M x'' + C x' + K x = 0 of the displacements p = `basis` x that the constraints allow, p (nu,) along the frame's axes and
    named by `basis_names`; columns of `basis` are orthonormal, no coordinates of joints (`Scene.tree` has M of these).
    With beams `mesh` names the mesh; `mesh_error` (modes,): error of the eigenvalues by it and by modes of reduced bodies.

    errors (modes,): bounds of the errors of the eigenvalues that rounding causes, 1/s. stable: False where a real part exceeds
    its error, or a motion lowers the energy; True where all are at most 0, by their numbers or by the structure of the
    equations (energy, pairs of roots on the imaginary axis, free motions); None where rounding leaves it open. It speaks of the
    motions that the scene has: of a planar one, those in its plane. out_of_plane: "stable" or "unstable" for those that leave
    the plane, None where these were not looked at.
    sides: () where laws are smooth at the state. Where some have a kink exactly there (a contact that just touches, a corner of a
    curve), the linear equations on either side of it, of all kinks that one motion crosses together, are two linearizations;
    `stable` is None then, as the roots of one side do not tell what grows.
    """

    errors: Array
    stable: bool | None
    out_of_plane: str | None = None
    sides: tuple[Linearization, ...] = ()

    def __init__(self, prepared: Prepared, frame: RotatingFrame, t: float, pencil: Pencil, count: int | None,
                 known: Structure) -> None:
        self.prepared, self.frame, self.t, self.pencil = prepared, frame.name, t, pencil
        self.axes = frame.rotation
        model = prepared.model
        if model.lines:
            found = lowest(pencil, count or DEFAULT, softest_beam(model), known)
            shapes = found.vectors
        else:
            errors = errors_of(pencil, self.equations, prepared.mechanics.velocity_units)
            found = spectrum(self.equations, errors, count, known)
            shapes = self.equations.displacements(found.vectors)
        self.errors, self.stable = found.errors, found.stable
        self.modes = [Mode(complex(v), scaled(x), self) for v, x in zip(found.values, shapes.T, strict=True)]

    @cached_property
    def equations(self) -> Reduced:
        """The second-order equations of the displacements that the constraints allow, dense."""
        return reduced(self.pencil, free_basis(self.pencil.closing, self.prepared.mechanics.velocity_units))

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
    def basis_names(self) -> tuple[str, ...]:
        """Names (nu,) of the velocities whose small displacements the rows of `basis` are, such as "J.rate". Rows of joints, N
        (freedoms, freedoms), turn M into that of their coordinates: inv(N).T @ M @ inv(N)."""
        nb = self.prepared.mechanics.numbering
        first = nb.start["u"]
        return nb.names()[first : first + self.prepared.mechanics.nu]

    @property
    def eigenvalues(self) -> Array:
        """Eigenvalues (modes,), complex, 1/s."""
        return np.array([mode.eigenvalue for mode in self.modes], dtype=complex)

    roots = eigenvalues

    @property
    def root_errors(self) -> Array:
        """The `errors`."""
        return self.errors

    @property
    def damping(self) -> Array:
        """Damping ratios (modes,)."""
        return np.array([mode.damping for mode in self.modes])

    def shares(self, vector: Array) -> dict[str, float]:
        """Share of every body in the kinetic energy of a motion (nu,), by falling share."""
        m = self.prepared.mechanics
        return shares(m, self.pencil.C.T @ (self.pencil.C.T @ self.prepared.mechanics.mass.T).T, motion(m, vector))

    def __str__(self) -> str:
        name = f"'{self.prepared.model.scene.name}'{self._plane}"
        head = f"scene {name}, t = {self.t:g} s, small motions in the axes of '{self.frame}'"
        lines = [head, f"{'mode':>4}  {'Hz':>11}  {'rad/s':>11}  {'damping':>10}  {'growth 1/s':>11}  {'error':>8}  bodies"]
        for i, mode in enumerate(self.modes):
            lines.append(f"{i + 1:>4}  {mode.frequency:>11.5g}  {mode.angular_frequency:>11.5g}  {mode.damping:>10.3g}  "
                         f"{mode.growth:>11.4g}  {self.errors[i]:>8.1e}  {participants(mode)}")
        lines.append(f"errors: of the roots, 1/s, by rounding; stable: {'not decided' if self.stable is None else self.stable}")
        lines += [OUT_OF_PLANE[self.out_of_plane]] if self._plane else []
        return "\n".join(lines + ([self._on_mesh] if self._on_mesh else []))

    def __repr__(self) -> str:
        return (f"<Linearization of '{self.prepared.model.scene.name}'{self._plane}, in the frame of '{self.frame}': "
                f"{counted(len(self.modes), 'mode')}{', ' * bool(self._on_mesh)}{self._on_mesh}>")


@naming_arguments
@single_threaded
def linearize(scene: SceneData, at: Any = None, frame: Any = None, count: int | None = None,
              out_of_plane: bool = True) -> Linearization:
    """The equations linearised about a steady motion, in a frame: s.ground (default), or a body that turns steadily.

    at: a Result (its end), (Result, t), an equilibrium, or None for the start of the scene. Departures are resolved along
    the frame's axes: the ground for a shaft in anisotropic bearings, a rotating body for blades on a hub. count: lowest
    modes only (default: all; with beams the lowest 20). out_of_plane: whether the stability of a planar scene with beams or
    free bodies against motions out of its plane is looked at, once; an AccuracyWarning tells where these grow, and where laws
    have a kink exactly at the state. Raises SteadyError, with the equations of that instant as `.frozen`, where they depend on
    time in that frame.
    """
    found = linearized(scene, at, frame, count, out_of_plane)
    told(started(found.prepared))
    return found


def linearized(scene: SceneData, at: Any = None, frame: Any = None, count: int | None = None,
               out_of_plane: bool = True) -> Linearization:
    """`linearize`, without warnings of what the laws leave out at the state."""
    refuse_sampled(scene, "linearize")
    count = optional("count", count, whole, "give the number of lowest modes, 1 or more, or None for all", least=1)
    look = option("out_of_plane", out_of_plane, flag, LOOK)
    body = body_of(scene, frame if frame is not None else scene.ground)
    prepared = prepare(scene, start_at(scene, at))
    start, m = prepared.start, prepared.mechanics
    if prepared.model.lines:
        refuse_rolling(m, "linearize beside beams", "state rigid bodies with springs for the beams, or simulate disturbances")
    axes = frame_at(prepared.model, body, start.q, start.u)
    system = complete_system(m, Index3().spec())
    z = _stresses(at, m, start)
    state = (start.t, start.q, start.u, start.s, z)

    def made(*state: Any) -> Linearization:
        p = pencil_with_errors(system, m, axes, state, not isinstance(at, Equilibrium))
        return Linearization(prepared, axes, start.t, p, count, structure(system, m, axes, state))

    found = made(*state)
    if kinked := kinks(m, state[:4]):
        found.sides, found.stable = tuple(made(start.t, *beside, z) for beside in sides(state[:4], kinked[0][1])), None
        warn(at_kinks(kinked, "the roots"))
    found._again = repeated(partial(linearize, frame=axes.name, count=count, out_of_plane=False), at)
    beams = (system, z) if m.model.lines else None
    change = reason_not_steady(prepared, axes, start.t, start.q, start.u, start.s, beams=beams) or _varies(system, found, axes, z)
    if change:
        raise SteadyError(f"the linearised equations change with time in the frame of '{axes.name}': {change}; where they are "
                          f"periodic, use s.floquet(period); otherwise give the body that turns steadily as frame=, or start "
                          f"from a steady motion, at=s.equilibrium(frame=...)", found)
    if look:
        known = at.out_of_plane if isinstance(at, Equilibrium) and at.frame == axes.name else None
        found.out_of_plane = known or looked_at(prepared, axes.name)
    return found


def start_at(scene: SceneData, at: Any, name: str = "at") -> Start | None:
    """The state that `at` names: a Result (its end), (Result, t), an equilibrium; None for the start of the scene."""
    if at is None:
        return None
    given, t = at if isinstance(at, tuple) and len(at) == 2 else (at, None)
    if not isinstance(given, Result):
        raise OptionError(f"{name} = {shown(at)} is no state: give a Result (its end), (Result, t), an equilibrium, or None for "
                          f"the start of the scene")
    result = given
    said, meant = ([item.name for item in known._items] for known in (result.prepared.model.scene, scene))
    if said != meant:
        raise OptionError(f"{name} is a state of scene '{result.prepared.model.scene.name}', which has other items than "
                          f"'{scene.name}': give a state of this scene")
    return result.state_for(scene, t)


def _stresses(at: Any, m: Mechanics, start: Start) -> Array:
    """Stress unknowns of all beams: those of an equilibrium, else from the positions."""
    if isinstance(at, Equilibrium):
        return np.asarray(at.point.y[at.kinds == "z"])
    return stresses_of(m, start.q, start.u)


def _varies(system: Assembly, found: Linearization, frame: RotatingFrame, z: Array) -> str | None:
    """What in the equations differs at later times of the steady motion; None where they are constant."""
    m, start = found.prepared.mechanics, found.prepared.start
    rates = state_rates(m, start.t, start.q, start.u, start.s) if len(start.s) else start.s
    for tau in times_to_compare(m, frame, start.t, start.q, start.u, start.s):
        q, u = advanced(m, frame, start.q, start.u, tau)
        later = frame_at(m.model, frame.name, q, u) if frame.node is not None else frame
        p = pencil_at(system, m, later, (start.t + tau, q, u, start.s + tau * rates, z))
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
    off = p.constraints @ before.N
    if np.abs(off).max(initial=0.0) > STEADY * np.abs(G).max(initial=1e-300):
        return f"the force of constraint {m.rows[largest(np.max(np.abs(off), axis=1))].name} has another direction"
    Z = np.asarray(np.linalg.lstsq(before.whole, before.N, rcond=None)[0], dtype=float)
    errors = errors_of(found.pencil, before, m.velocity_units)
    return _differs(m, before, reduced(p, before.whole, Z), errors, float(np.max(np.abs(frame.rate))))


def _differs(m: Mechanics, a: Reduced, b: Reduced, e: Reduced, rate: float) -> str | None:
    size = np.abs(a.K).max(initial=0.0) + rate * np.abs(a.C).max(initial=0.0) + rate**2 * np.abs(a.M).max(initial=0.0)
    for coefficient, name, unit in (("inertia", "M", rate**2), ("damping", "C", rate), ("stiffness", "K", 1.0)):
        x, y, error = (getattr(matrices, name) for matrices in (a, b, e))
        off = np.maximum(np.abs(x - y) - error, 0.0)
        scale = size / unit if unit else np.abs(x).max(initial=0.0)
        if off.max(initial=0.0) > STEADY * scale and off.max() > 0:
            column = largest(off.max(axis=0))
            motion = motion_in_words(m.model, a.N[:, column], m.velocity_units)
            part = off.max() / np.abs(x).max(initial=off.max())
            return f"the {coefficient} against {motion} changes by {part:.2g} of the largest {coefficient}"
    return None
