"""Modes and their shapes: the motion of bodies and of places on them.

The mesh of beams on which modes were found, and the error it causes, measured by the same analysis on a finer mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from scipy.optimize import linear_sum_assignment

from mbdae.analysis.equilibrium import Equilibrium, equilibrium
from mbdae.analysis.frame import attitude
from mbdae.errors import ListsAttributes, OptionError
from mbdae.laws.beam import table
from mbdae.laws.bodies import with_modes
from mbdae.notation import counted
from mbdae.results.beams import foot
from mbdae.run.verification import with_finer_beams
from mbdae.scene.components import Body, Place
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.system.model.nodes import Node
from mbdae.system.motion.mechanics import Mechanics
from mbdae.system.prepare import Prepared
from mbdae.values import largest, nearest, shown


class Owner(Protocol):
    """The analysis a mode belongs to: the scene, and the axes (3, 3) its components are along."""

    prepared: Prepared
    axes: Array

    def shares(self, vector: Array) -> dict[str, float]:
        """Share of every body in the energy of a motion (nu,)."""


@dataclass(frozen=True)
class ModeShape:
    """Motion of a node or a place in a mode, complex: displacement (3,) m and rotation (3,) rad along the frame's axes; of
    a beam (nodes, 3) each, at the lengths `stations` (nodes,) along it, m."""

    displacement: Array
    rotation: Array
    stations: Array | None = None


@dataclass(frozen=True)
class Mode(ListsAttributes):
    """One mode: eigenvalue, 1/s (of a conjugate pair the one with the positive imaginary part), and its shape.

    `mode["body"]` is the motion of a body's node: virtual displacement and rotation along the frame's axes, scaled so
    that the largest component (m, rad) is 1; of a beam that of all its nodes. `mode[body.at(...)]` is that of a place.
    """

    eigenvalue: complex
    vector: Array  #: shape of the mode over all nodes (nu,), complex
    owner: Owner

    @property
    def frequency(self) -> float:
        """Frequency of the (damped) oscillation, Hz."""
        return self.eigenvalue.imag / (2 * np.pi)

    @property
    def angular_frequency(self) -> float:
        """Angular frequency of the (damped) oscillation, rad/s."""
        return self.eigenvalue.imag

    @property
    def growth(self) -> float:
        """Rate of growth, 1/s; negative: the mode decays."""
        return self.eigenvalue.real

    @property
    def damping(self) -> float:
        """Damping ratio: 1 and more without oscillation, negative where the mode grows, 0 for an eigenvalue 0."""
        size = abs(self.eigenvalue)
        return 0.0 - self.eigenvalue.real / size if size else 0.0

    def __getitem__(self, body: str | Body | Place) -> ModeShape:
        if isinstance(body, Place):
            return self._at(body)
        model = self.owner.prepared.model
        name, known = body.name if isinstance(body, Body) else body, [b.name for b in (model.scene.ground, *model.scene.bodies)]
        if not isinstance(name, str) or name not in known:
            bodies = ", ".join(map(repr, known[:12]))
            raise OptionError(f"mode[{shown(name)}]: name a body, or a place on it such as body.at(point); there is {bodies}")
        line = model.line(model.scene[name])
        if line is not None:
            shapes = [self._of(node) for node in line.nodes]
            move, turn = (np.array([getattr(s, k) for s in shapes]) for k in ("displacement", "rotation"))
            return ModeShape(move, turn, line.mesh.stations)
        return self._of(model.node(model.scene[name]))

    def _of(self, node: Node | None) -> ModeShape:
        move, turn = np.zeros(3, dtype=complex), np.zeros(3, dtype=complex)
        if node is not None:
            n, part = node.kind.translations, self.vector[node.u : node.u + node.kind.sizes[1]]
            move[:n] = part[:n]
            if len(part) > n:
                turn[2 if len(part) == 3 else slice(None)] = part[2] if len(part) == 3 else part[3:]
        return ModeShape(move, turn)

    def _at(self, place: Place) -> ModeShape:
        """Motion of a place: that of its rigid body, or of a beam by its shape functions, plus rotation x arm."""
        model, start = self.owner.prepared.model, self.owner.prepared.start
        body = model.scene[place.body.name]
        line, node = model.line(body), model.node(body)
        if line is not None:
            e, xi = foot(line.mesh, place.point)
            at, whole = table(line.mesh.order, np.array([xi])).values[0], self[body]
            move, turn = (at @ a[line.mesh.elements[e]] for a in (whole.displacement, whole.rotation))
            bodies = [n.body for n in line.nodes if n.body]
            apart = [np.linalg.norm(body.drawn.position - place.point) for body in bodies]
            body = bodies[nearest(apart, line.mesh.length)]
            node, origin = model.node(body), at @ line.mesh.curve[e]
        else:
            shape, origin = self._of(node), body.drawn.position
            move, turn = shape.displacement, shape.rotation
        if node is None or not node.kind.turns:
            return ModeShape(move, turn)
        arm = attitude(node, start.q) @ body.drawn.rotation.T @ (place.point - origin)
        return ModeShape(move + np.cross(turn, self.owner.axes.T @ arm), turn)

    def gradient(self, to: Any) -> Any:
        """Derivatives of the `root` by numbers of the scene, by their names (one or a list): of a value, complex, in the unit of
        the root over that of the number, and of an estimated error. The equilibrium moves with the numbers.

        Raises DerivativeError where the root is not simple, cannot be followed, or is that of a state of a run."""
        from mbdae.analysis.reduced import TracedRoot
        from mbdae.derivatives import Derivatives, names_of, refuse_number

        traced, found = TracedRoot(self.owner, self.root, self.owner.modes.index(self)), Derivatives()  # type: ignore[attr-defined]
        for name in names_of(to):
            refuse_number(name, self.owner.prepared.model.scene)
            found[name] = traced.by(name)
        return found

    @property
    def root(self) -> complex:
        """What `gradient` differentiates: the eigenvalue, 1/s."""
        return self.eigenvalue

    @property
    def participation(self) -> dict[str, float]:
        """Share of every body in the kinetic energy of the mode (of its displacements, where nothing moves has mass)."""
        return self.owner.shares(self.vector)


M = TypeVar("M", bound=Mode)


class Modes(ListsAttributes, Generic[M]):
    """The modes that an analysis found, and arrays over them."""

    modes: list[M]

    @property
    def frequencies(self) -> Array:
        """Frequencies (modes,), Hz."""
        return np.array([mode.frequency for mode in self.modes])

    @property
    def angular_frequencies(self) -> Array:
        """Angular frequencies (modes,), rad/s."""
        return np.array([mode.angular_frequency for mode in self.modes])

    @property
    def growth(self) -> Array:
        """Rates of growth (modes,), 1/s, positive where a mode grows."""
        return np.array([mode.growth for mode in self.modes])

    def __iter__(self) -> Iterator[M]:
        return iter(self.modes)

    def __len__(self) -> int:
        return len(self.modes)


def participants(mode: Mode) -> str:
    """The bodies with the largest shares in a mode, in words."""
    return ", ".join(f"{name} {share:.0%}" for name, share in list(mode.participation.items())[:4] if share >= 0.05)


def motion(m: Mechanics, vector: Any) -> Array:
    """A motion (nu,), real or complex, as an array; OptionError for any other value."""
    try:
        found = np.asarray(vector)
    except ValueError:  # lists of different lengths
        found = np.zeros(0)
    if found.shape != (m.nu,) or found.dtype.kind not in "fiuc" or not np.isfinite(found).all():
        raise OptionError(f"vector = {shown(vector)} is no motion of this scene: give {m.nu} finite numbers, such as mode.vector")
    return found


def shares(m: Mechanics, metric: Any, vector: Array) -> dict[str, float]:
    """Share of every body in the energy of a motion (nu,), whose quadratic form is `metric` (nu, nu), such as the mass matrix;
    where that energy is zero, its share in the sum of squared displacements."""
    energy = np.abs(np.conj(vector) * (metric @ vector))
    if not np.max(energy, initial=0.0):
        energy = np.abs(vector / m.velocity_units) ** 2
    total = float(np.sum(energy)) or 1.0
    found: dict[str, float] = {}
    for node, body in m.model.bodies:
        part = float(np.sum(energy[node.u : node.u + node.kind.sizes[1]])) / total
        found[body.owner.name] = found.get(body.owner.name, 0.0) + part
    return dict(sorted(found.items(), key=lambda item: -round(item[1], 9)))  # equal shares in the order of the scene


def scaled(vector: Any) -> Any:
    """The vector divided by its largest component, by the first of them where several are equally large."""
    component = vector[largest(np.abs(vector))] if len(vector) else 1.0
    return np.asarray(vector / component) if component else vector


class OnMesh:
    """Base of analyses of a scene: whether it is planar; with beams their mesh, and the error that it causes."""

    prepared: Prepared
    #: makes the same analysis of another scene; None where the state analysed is one of a run, which exists on its mesh only
    _again: Callable[[SceneData], Any] | None = None

    @cached_property
    def _with_number(self) -> dict[tuple[str, float], Any]:
        """Roots of the scene by (name of a number, what it is larger by)."""
        return {}

    @property
    def _plane(self) -> str:
        """What a print says of a planar scene, whose equations have no motion out of the plane; "" in space."""
        return ", planar" if self.prepared.model.planar else ""

    @property
    def mesh(self) -> dict[str, tuple[tuple[int, ...], int]]:
        """The mesh of every beam by its name: the elements of each of its segments, and their order. Empty without beams."""
        beams = [line.beam for line in self.prepared.model.lines]
        return {beam.name: (tuple(int(n) for n in np.atleast_1d(beam.elements)), beam.order) for beam in beams}

    @property
    def _reduced(self) -> dict[str, int]:
        """Number of modes of every reduced body by its name."""
        return {c.k.name: len(c.joint.reduced.modal_mass) for c in with_modes(self.prepared.model.scene.connections)}

    @cached_property
    def mesh_error(self) -> Array | None:
        """The error that the mesh of beams, and modes that reduced bodies leave out, cause in each of `roots`, relative to the
        root: its difference from the same analysis with elements of one order more (twice as many elements where the order is the
        highest) and more than twice as many modes, which is made when this is read. NaN for a root without counterpart there;
        None without such bodies. Raises OptionError for the state of a run, which exists on the run's mesh only."""
        if not (self.mesh or self._reduced):
            return None
        if self._again is None:
            raise OptionError("mesh_error: the state of a run has no counterpart on a finer mesh: linearise about "
                              "s.equilibrium() or the start, or repeat run and analysis with beams of one order "
                              "more")
        here, there = self.roots, self._again(with_finer_beams(self.prepared.model.scene)).roots
        # pairs of roots with the least sum of squared distances: with squares, real roots are paired in rising order
        mine, others = linear_sum_assignment(np.abs(here[:, None] - there) ** 2)
        error, size = np.full(len(here), np.nan), np.maximum(np.abs(there[others]), np.finfo(float).tiny)
        error[mine] = np.abs(here[mine] - there[others]) / size
        return error

    @property
    def roots(self) -> Any:
        """What `mesh_error` compares: the eigenvalues of the modes, or the multipliers."""
        raise NotImplementedError

    @property
    def root_errors(self) -> Any:
        """Errors of the `roots`, in their unit."""
        raise NotImplementedError

    @property
    def _on_mesh(self) -> str:
        """The mesh, and modes of reduced bodies, with their error in words; "" without either."""
        beams = ", ".join(f"'{name}' {counted(sum(elements), 'element')} of order {order}"
                          for name, (elements, order) in self.mesh.items())
        kept = [f"{counted(count, 'mode')} kept of '{name}'" for name, count in self._reduced.items()]
        whose = ", ".join([*([f"mesh of {beams}"] if beams else []), *kept])
        if not whose:
            return ""
        if "mesh_error" in vars(self):
            return f"{whose}: relative error of at most {np.nanmax(vars(self)['mesh_error'], initial=0.0):.1e}"
        measures = " (.mesh_error measures it)" if self._again is not None else ""
        return f"{whose}: {'their' if kept else 'its'} error is not covered{measures}"


def repeated(again: Callable[..., Any], at: Any) -> Callable[[SceneData], Any] | None:
    """A function that makes the analysis again(scene, at=...) of another scene, at its own equilibrium where `at` is one; None
    where the state `at` is one of a run, which exists for the scene and the mesh of the run only."""
    if at is not None and not isinstance(at, Equilibrium):
        return None
    return partial(_repeated, again, None if at is None else at.frame)


def _repeated(again: Callable[..., Any], frame: str | None, scene: SceneData) -> Any:
    """The analysis of a scene, at the equilibrium in `frame`, or at the start of the scene where frame is None."""
    return again(scene, at=None if frame is None else equilibrium(scene, frame, out_of_plane=False))
