"""Flexible bodies from the mass and stiffness matrices of a finite-element program, reduced to their interfaces and some modes.

Craig and Bampton: an interface is a set of nodes that moves as a rigid body, by six freedoms. The body moves by the static
deformations of unit displacements of its interfaces and by the modes of vibration with all interfaces held. Of these motions six
are rigid; the others are turned into the modes of the free reduced body, which are orthogonal to all rigid motions: in the frame
that they leave, centre of mass and angular momentum of small deformations stay 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from hashlib import sha256
from itertools import chain
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

import numpy as np

from mbdae.deferred import later
from mbdae.errors import NamesAttributes, OptionError
from mbdae.notation import counted
from mbdae.values import Array, array, flag, number, option, optional, shown, whole

if TYPE_CHECKING:
    from mbdae.inputs.matrices import drawn_edges, inertia_points, stresses_by_modes
    from mbdae.inputs.reduction import FiniteElements, rigid_motions
else:
    FiniteElements, rigid_motions = later("mbdae.inputs.reduction", "FiniteElements", "rigid_motions")
    drawn_edges, inertia_points, stresses_by_modes = later("mbdae.inputs.matrices", "drawn_edges", "inertia_points",
                                                           "stresses_by_modes")

#: largest displacement by a mode, over the size of a body, that is not told: where a cantilever's end deflects by 14 % of its
#: length, its mode displaces by 5.4 % and the deflection is 1.4 % off; at a tenth of that load by 0.54 % and 0.013 %. What is
#: left out of positions is SQUARE times the square of that, or less (cantilevers under loads at the end: .6 to 1.1 times)
SMALL, SQUARE = 0.04, 1.5
#: share by which frequencies are off, over the square of the largest displacement over the size: 5 to 16 beside exact motions
DRIFT = 16.0  #: of a lattice that swings (.25 s, 1 s) and of cantilevers under sudden loads (5 and 20 periods)
#: angular velocity of a body, over its lowest angular frequency with an interface held, that is not told: by the square of this,
#: 1 %, centrifugal forces stiffen a rotating blade, which its matrices do not say
SLOW = 0.1
#: force at an interface towards the centre, over the stiffness of the lowest vibration with an interface held and its size, that
#: is not told: a cantilever buckles at 0.8
LIGHT = 0.008
MOST = 0.05  #: share of the elastic energy by a uniform acceleration, left out by the modes, from which on advice is given
ROUGH, NEARLY = 1e-3, 0.3  #: accuracy where none is asked for; from which part of it on what modes leave out is told
MORE_MODES = "keep more modes, reduce it with accelerations=True, or give it an interface where it is loaded"
ADVICE = "reduce it with stiffening=True, or use s.beam"
STEPS = 1000  #: largest number of steps of a run at which forces at interfaces are looked at
MORE = 6  #: further modes, beside twice as many, of the body by which the error of its modes is measured
#: what reduces the matrices again, with more modes, by the content of a body: an equal one, as of a copied scene, finds it here
_AGAIN: WeakValueDictionary[bytes, Callable[[], ReducedBody]] = WeakValueDictionary()


@dataclass(frozen=True, eq=False, repr=False)
class ReducedBody(NamesAttributes):
    """A flexible body by its modes, made by `craig_bampton` or `free_interface`; lengths m, masses kg, in the axes of the
    finite-element model.

    Modes are scaled so that the largest displacement of a node is 1 (rotations count times the size of the body): their
    coordinates are in m."""

    mass: float  #: kg
    center: Array  #: (3,) centre of mass, m
    inertia: Array  #: (3, 3) about the centre of mass, kg m^2
    nodes: Array  #: (k, 3) m
    interfaces: dict[str, Array]  #: name -> place (3,) of the interface: mean of its nodes, m
    shapes: Array  #: (k, 6 or 3, n) displacements (and rotations) of the nodes by the n modes of the free body
    modal_mass: Array  #: (n,) kg
    modal_stiffness: Array  #: (n,) N/m
    interface_shapes: dict[str, Array]  #: name -> (6, n) displacement and rotation of the interface by the modes
    held_frequencies: Array  #: (m,) of the modes with held interfaces that were kept, Hz
    #: largest share of the elastic energy by the inertia forces of a uniform acceleration, with the interfaces held, that the
    #: modes kept cannot show: of the six accelerations along and about axes the one with the largest share, 0 to 1
    left_out: float
    points: Array  #: (p, 3, 1 + n) places, from the centre of mass, of p points of mass `mass / p`, and their change by the modes
    #: (s, n, n) s displacements of the second order b_i = c^T bends[i] c / 2, m, c the coordinates of the modes (m): shortenings,
    #: by which loads stiffen the body; by b_i a place x, m, from the centre of mass moves by b_i stretches[i] x, (s, 3, 3), 1/m,
    #: and an interface by b_i interface_bends[name][:, i], (6, s)
    bends: Array = field(default_factory=lambda: np.zeros((0, 0, 0)))
    stretches: Array = field(default_factory=lambda: np.zeros((0, 3, 3)))
    interface_bends: dict[str, Array] = field(default_factory=dict)
    #: (k, 6, n) stresses at the nodes by the modes, Pa/m, xx yy zz yz xz xy; none where they are not known
    stresses: Array = field(default_factory=lambda: np.zeros((0, 6, 0)))
    edges: Array = field(default_factory=lambda: np.zeros((0, 2)))  #: (e, 2) numbers of nodes between which lines are drawn
    #: (6,) largest displacement of a node by a uniform acceleration of 1 m/s^2 along x y z and of 1 rad/s^2 about them, with the
    #: interfaces held, that the modes kept do not show, m
    unshown: Array = field(default_factory=lambda: np.zeros(6))
    free: bool = False  #: made by `free_interface`: the modes kept, and `held_frequencies`, are those with free interfaces

    def __post_init__(self) -> None:
        n, k, s = np.size(self.modal_mass), len(self.nodes), len(self.bends)
        wanted = {"mass": (), "left_out": (), "center": (3,), "inertia": (3, 3), "nodes": (k, 3), "modal_mass": (n,),
                  "shapes": (k, 3 if len(self.shapes) and np.shape(self.shapes)[1] == 3 else 6, n), "modal_stiffness": (n,),
                  "held_frequencies": (np.size(self.held_frequencies),), "points": (len(self.points), 3, 1 + n),
                  "bends": (s, n, n) if s else (0, 0, 0), "stretches": (s, 3, 3), "unshown": (6,),
                  "stresses": (k, 6, n) if len(self.stresses) else (0, 6, 0), "edges": (len(self.edges), 2)}
        found = {name: np.asarray(getattr(self, name), dtype=float) for name in wanted}
        found |= {name: x.reshape(wanted[name]) for name, x in found.items() if not x.size and not np.prod(wanted[name])}
        places = {name: np.asarray(x, dtype=float) for name, x in dict(self.interfaces).items()}
        at = {name: np.asarray(x, dtype=float).reshape(6, n) for name, x in dict(self.interface_shapes).items()}
        bent = {name: np.asarray(self.interface_bends.get(name, np.zeros((6, s))), dtype=float).reshape(6, s) for name in at}
        if np.any((found["edges"] < 0) | (found["edges"] >= k)):
            raise OptionError(f"ReducedBody: its edges name nodes that it does not have, 0 to {k - 1}")
        if wrong := [n for n, shape in wanted.items() if found[n].shape != shape or not np.all(np.isfinite(found[n]))]:
            raise OptionError(f"ReducedBody: {wrong[0]} has the shape {found[wrong[0]].shape}, not {wanted[wrong[0]]}, or is not "
                              f"finite: make it by mb.ReducedBody.craig_bampton")
        for name, value in found.items():
            object.__setattr__(self, name, value if value.ndim else float(value))
        object.__setattr__(self, "interfaces", places)
        object.__setattr__(self, "interface_shapes", at)
        object.__setattr__(self, "interface_bends", bent)

    @property
    def size(self) -> float:
        """Diagonal of the box about its nodes, m."""
        return float(np.linalg.norm(np.ptp(self.nodes, axis=0)))

    @property
    def frequencies(self) -> Array:
        """(n,) frequencies of the free body that is reduced, Hz, without the six rigid motions."""
        return np.asarray(np.sqrt(self.modal_stiffness / self.modal_mass) / (2 * np.pi))

    @property
    def lowest_held(self) -> float:
        """Lowest frequency with one of its interfaces held and the others free, of all of them the least, Hz."""
        return self._lowest_held[0]

    @cached_property
    def _lowest_held(self) -> tuple[float, float]:
        """`lowest_held` and the stiffness of that vibration to its largest displacement, N/m."""
        from scipy.linalg import eigh, null_space

        n, found = len(self.modal_mass), [(np.inf, np.inf)]
        M, K = np.zeros((6 + n, 6 + n)), np.diag(np.r_[np.zeros(6), self.modal_stiffness])
        M[:3, :3], M[3:6, 3:6], M[6:, 6:] = self.mass * np.eye(3), self.inertia, np.diag(self.modal_mass)
        for name, place in self.interfaces.items() if n else ():
            free = null_space(np.hstack([rigid_motions(place[None], self.center, 6), self.interface_shapes[name]]))
            if free.shape[1]:
                values, vectors = eigh(free.T @ K @ free, free.T @ M @ free, subset_by_index=(0, 0))
                c = free @ vectors[:, 0]
                moved = self.shapes[:, :3] @ c[6:] + rigid_motions(self.nodes, self.center, 3).reshape(-1, 3, 6) @ c[:6]
                stiffness = c @ K @ c / np.max(np.sum(moved**2, axis=1))
                found.append((float(np.sqrt(max(values[0], 0)) / (2 * np.pi)), float(stiffness)))
        return min(found)

    def left_out_of(self, prepared: Any, item: Any, q: Array, moving: Any = None) -> float:
        """About the largest displacement that small deformations leave out at positions q (k, nq), their second order, m. moving:
        times (k,) of a run, velocities (k, nu), accelerations (k, 6) of its frame, its weight included, in its axes, and whether
        its frame is free to move: with what adds up over time, as frequencies, of pendulums too, are off by DRIFT and by half the
        share by which loads would stiffen it."""
        largest, size, (lowest, stiffness) = self.by_modes(prepared, item, q), self.size, self._lowest_held
        found = SQUARE * (largest := np.maximum.accumulate(largest)) ** 2 / size
        if moving is not None and len(self.modal_mass):
            t, u, pulled, free = moving
            turning = np.linalg.norm(u[:, prepared.model.node(item.k).u + 3 :][:, :3], axis=1)
            off, rates = DRIFT * (largest / size) ** 2, u[:, self._numbers(prepared, item, "u")]
            arms = [arm / max(float(np.linalg.norm(arm)), 1e-300) for arm in [*self.interfaces.values()] - self.center]
            pull = self.mass * np.max(np.abs(pulled[:, :3] @ np.transpose(arms)), axis=1)
            loads = (turning / (SLOW * 2 * np.pi * lowest)) ** 2 + pull / (LIGHT * stiffness * size)  # %
            stiffer = 0.0 if len(self.bends) else np.maximum.accumulate(loads) / 200
            found += np.minimum((t - t[0]) * (off + stiffer) * np.max(np.abs(rates), axis=1), 2 * largest)
            found += (t - t[0]) * off * turning * size * free
        return float(np.max(found))

    def by_modes(self, prepared: Any, item: Any, q: Array) -> Array:
        """(k,) largest displacements by a mode at positions q (k, nq), m; item: that of its modes in the scene."""
        return np.asarray(np.max(np.abs(self.coordinates(prepared, item, q)), axis=1, initial=0))

    def coordinates(self, prepared: Any, item: Any, q: Array) -> Array:
        """(k, n) coordinates of the modes at positions q (k, nq), m; item: that of its modes in the scene."""
        return np.asarray(q[:, self._numbers(prepared, item, "q")])

    def _numbers(self, prepared: Any, item: Any, of: str) -> list[int]:
        """Numbers of its modes among the positions ("q") or velocities ("u")."""
        return [getattr(prepared.model.coordinate_node(item.name, mode), of) for mode in item.scalars[: len(self.modal_mass)]]

    def doubts(self, result: Any, item: Any, unshown: Array) -> list[str]:
        """What a run, or a state, may have left out; item: that of its modes; unshown: (nt,) what `left_by_modes` found, m."""
        run, found = result.solution, []

        def above(sizes: Array, bound: float) -> list[tuple[str, float, float]]:  # when first, the largest, and over the bound
            first = np.flatnonzero(sizes > bound)[:1]
            when = "at t = {:.6g} s: " if len(run.t) > 1 else ""
            return [(when.format(result.t[i]), float(np.max(sizes)), float(np.max(sizes)) / bound) for i in first]

        sizes, bound = self.by_modes(result.prepared, item, result.q), SMALL * self.size
        known = result.info and result.info.accuracy
        if known and known.asked is not None and known.mesh is not None:  # verified: what was measured is within the accuracy
            part = 0.1 if (known.deformation or 0.0) > known.asked else 1.0  # the rest is what adds up over time
            bound = min(bound, part * float(np.sqrt(known.asked * result.prepared.length * self.size / SQUARE)))
        found += [f"{when}a mode displaces by up to {most:.3g} m, more than {bound:.3g} m: the body moves as with small "
                  f"deformations, which leaves out about {SQUARE * most**2 / self.size:.1g} m, more over time, and grows with "
                  f"their square; use s.beam, or several bodies" for when, most, _ in above(sizes, bound)]
        if not (known and known.mesh is not None):  # else it is measured
            bound = NEARLY * ((known and known.asked) or ROUGH) * result.prepared.length
            found += [f"{when}its modes leave out up to {most:.2g} m of how its weight and acceleration deform it between its "
                      f"interfaces, {NEARLY * part:.2g} times the accuracy: {MORE_MODES}; verify=True measures it"
                      for when, most, part in above(unshown, bound)]
        if len(self.bends):
            return found
        speed, bound = np.linalg.norm(result[item.k.name].angular_velocity, axis=1), SLOW * 2 * np.pi * self.lowest_held
        found += [f"{when}it turns at up to {most:.3g} rad/s, more than {bound:.3g} rad/s, a tenth of its lowest angular "
                  f"frequency with an interface held: stiffening by centrifugal forces, about {part**2:.2g} % of its stiffness, "
                  f"is left out; {ADVICE}" for when, most, part in above(speed, bound)]
        rows = {name: [f"lambda({item.k.name}.interface {name}.{a})" for a in "xyz"] for name in self.interfaces}
        if by_run := run.names is not None and {*chain(*rows.values())} <= {*run.names}:  # its forces are unknowns of the run
            result = result(run.t[:: len(run.t) // STEPS + 1])
            y = run(result.t)
        turned, bound = result[item.k.name].rotation, LIGHT * self._lowest_held[1] * self.size
        for name, arm in ((name, place - self.center) for name, place in self.interfaces.items()):
            along = turned @ (arm / max(float(np.linalg.norm(arm)), 1e-300))
            force = y[:, [run.names.index(row) for row in rows[name]]] if by_run else result[rows[name][0][7:-3]].force
            found += [f"{when}a force of up to {most:.3g} N pulls or presses at its interface '{name}' towards its centre, more "
                      f"than {bound:.3g} N: what this changes of its stiffness, about {part:.2g} %, is left out; {ADVICE}"
                      for when, most, part in above(np.abs(np.sum(force * along, axis=-1)), bound)]
        return found

    @property
    def summary(self) -> str:
        """Its modes in a sentence."""
        f = self.frequencies
        lost = (f", by 9.81 m/s^2 up to {9.81 * np.max(self.unshown[:3]):.2g} m of its displacements between interfaces"
                if np.any(self.unshown[:3]) else "") + (f": {MORE_MODES}" if self.left_out > MOST else "")
        if not len(f):
            return f"no modes: it is rigid{lost and ', which leaves out its deformation'}{lost}"
        held = ("free; with these static deformations are complete" if self.free else
                f"held; these leave out {100 * self.left_out:.3g} % of the elastic energy by a uniform acceleration{lost}")
        return (f"{counted(len(f), 'mode')} of the free body, {f[0]:.4g} to {f[-1]:.4g} Hz, from static deformations of "
                f"{counted(len(self.interfaces), 'interface')} and {counted(len(self.held_frequencies), 'mode')} with these "
                f"{held}; loads {'stiffen and soften it' if len(self.bends) else 'do not change its stiffness'}")

    def displacement(self, coordinates: Any, nodes: Any = slice(None)) -> Array:
        """(..., k, 6 or 3) displacements of all nodes, or of some by number, in the body's frame, m and rad, from coordinates
        (..., n), m, or from r["<name>.modes"] of a result."""
        body, modes = self._moved(coordinates)
        return np.asarray(np.einsum("kfn,...n->...kf", body.shapes[nodes], modes))

    @classmethod
    def craig_bampton(cls, M: Any, K: Any, nodes: Any, interfaces: Mapping[str, Any], modes: int | None = None,
                       accelerations: bool = False, stiffening: Any = False, stress: Any = None,
                       accuracy: float = 1e-3, up_to: float | None = None) -> ReducedBody:
        """Reduce a free body with mass matrix M and stiffness K (both (f k, f k), kg and N/m, full or SciPy sparse) of k nodes,
        f = 6 freedoms each (ux uy uz rx ry rz, node by node) or 3 (ux uy uz).

        nodes (k, 3), m; interfaces: {name: numbers of its nodes, from 0}, each of which moves as a rigid body; modes: number of
        modes with held interfaces that are kept, None: as few as make `left_out` at most `accuracy`, or, with accelerations=True
        and up_to, the highest frequency of the loads (Hz), `left_out` times the square of up_to over the frequency of the first
        mode left out; accelerations: whether the static deformations by uniform accelerations along and about axes, with held
        interfaces, are kept too, as far as the modes do not show them, so that nothing of these is left out; stiffening: whether
        loads stiffen and soften it (geometric stiffness by centrifugal forces, weight and forces at interfaces): True where K is
        of elements between two nodes with six freedoms, else a function of two displacements u and v (f k,) that returns the
        internal force of the second order (f k,), N, symmetric in both: K of the body strained by a small u, times v, is K v +
        that; stress: function of displacements (f k,) that returns the stresses at the nodes (k, 6), Pa, xx yy zz yz xz xy, or
        None. OptionError where the matrices are not those of such a body, with the reason."""
        return cls._reduced(False, (M, K, nodes, interfaces), modes, accelerations, stiffening, stress, accuracy, up_to)

    @classmethod
    def free_interface(cls, M: Any, K: Any, nodes: Any, interfaces: Mapping[str, Any], modes: int | None = None,
                       stiffening: Any = False, stress: Any = None, accuracy: float = 1e-3,
                       up_to: float | None = None) -> ReducedBody:
        """Reduce a free body to modes of vibration of the free body and, for every interface, what these leave out of the
        deformations by its forces and torques (residual flexibility): forces at interfaces and weight deform it statically as all
        of its freedoms would. The right modes where interfaces are held softly or not at all.

        M, K, nodes, interfaces, stiffening, stress: as in `craig_bampton`; modes: number of modes of the free body, None: those
        below up_to (Hz, the highest frequency of the loads) over the root of accuracy."""
        return cls._reduced(True, (M, K, nodes, interfaces), modes, False, stiffening, stress, accuracy, up_to)

    @classmethod
    def _reduced(cls, free: bool, given: tuple[Any, ...], modes: Any, accelerations: Any, stiffening: Any, stress: Any,
                 accuracy: Any, up_to: Any, edges: Any = None) -> ReducedBody:
        """edges: (e, 2) numbers of nodes between which lines are drawn, None: between all that K connects."""
        body = FiniteElements(*given)
        count = optional("modes", modes, whole, "give the number of modes to be kept, or None", least=0, most=body.inner.shape[1])
        if not callable(stiffening):
            stiffening = option("stiffening", stiffening, flag, "give True, False, or a function of two displacements")
        least = option("accuracy", accuracy, number, "give the largest share to be left out, such as 1e-3", above=0, most=1)
        highest = optional("up_to", up_to, number, "give the highest frequency of the loads, Hz, or None", above=0)
        found = body.reduced(count, option("accelerations", accelerations, flag, "give True or False"), stiffening,
                             (least, np.inf if highest is None else highest), free)
        if stress is not None:
            found["stresses"] = stresses_by_modes(stress, found["shapes"])
        found["edges"] = lines = drawn_edges(body.K, body.nodes) if edges is None else edges
        made = cls(**found, points=inertia_points(body.M, **found), free=free)
        body.judge(made.lowest_held)
        most = min(2 * len(made.held_frequencies) + MORE, body.inner.shape[1])
        vars(made)["again"] = _AGAIN.setdefault(
            made._content, lambda: cls._reduced(free, given, most, not free, stiffening, stress, accuracy, up_to, lines))
        return made

    def finer(self) -> ReducedBody:
        """The body with at least twice as many modes with held interfaces, by which the error of those kept is measured."""
        again = _AGAIN.get(self._content)
        if again is None:
            raise OptionError("the reduced body was not made from its matrices in this process: reduce it again")
        return again()

    @cached_property
    def _content(self) -> bytes:
        """Equal for bodies that move alike."""
        found = sha256()
        for name in (f.name for f in fields(self) if f.name != "edges"):
            value = getattr(self, name)
            for key, part in (value if isinstance(value, dict) else {name: value}).items():
                found.update(key.encode() + np.asarray(part, dtype=float).tobytes())
        return found.digest()

    def drawn(self, edges: Any) -> ReducedBody:
        """The same body, drawn by lines between nodes, (e, 2) by their numbers."""
        made = replace(self, edges=edges)
        vars(made).update({name: value for name, value in vars(self).items() if name == "again"})
        return made

    def __deepcopy__(self, memo: Any) -> ReducedBody:
        return self

    def __getstate__(self) -> dict[str, Any]:
        """Without the matrices."""
        return {name: value for name, value in vars(self).items() if name != "again"}

    def stress(self, coordinates: Any) -> Array:
        """(..., k, 6) stresses at the nodes, Pa, xx yy zz yz xz xy in the body's axes, from coordinates of the modes (..., n), m,
        or r["<name>.modes"] of a result; those by the modes: what the reduction leaves out has stresses too."""
        if not len(self.stresses):
            raise OptionError("the stresses of this body are not known: give craig_bampton(stress=...), or a mesh to mb.read_fe")
        body, modes = self._moved(coordinates)
        return np.asarray(np.einsum("ksn,...n->...ks", body.stresses, modes))

    def von_mises(self, coordinates: Any) -> Array:
        """(..., k) von Mises stress at the nodes, Pa; coordinates as in `stress`."""
        xx, yy, zz, yz, xz, xy = np.moveaxis(self.stress(coordinates), -1, 0)
        return np.asarray(np.sqrt(((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) / 2 + 3 * (yz**2 + xz**2 + xy**2)))

    def _moved(self, coordinates: Any) -> tuple[ReducedBody, Array]:
        """The body and the coordinates of its modes; of a sensor its own body, which has more modes in the run by which the error
        of those kept is measured."""
        if not hasattr(coordinates, "mode1"):
            body = self
        elif np.shape((body := coordinates._item.laws[0].reduced).nodes) != self.nodes.shape or np.any(body.nodes != self.nodes):
            raise OptionError(f"coordinates = {shown(coordinates)}: they are those of a body with other nodes; give its own")
        else:
            names = coordinates._item.scalars[: len(body.modal_mass)]
            coordinates = np.stack([getattr(coordinates, name) for name in names], axis=-1)
        n = len(body.modal_mass)
        found = option("coordinates", coordinates, array, f"give {n} coordinates, m")
        if found.ndim == 0 or found.shape[-1] != n:
            raise OptionError(f"coordinates = {shown(coordinates)}: give {n} in the last dimension, one for each mode, m")
        return body, found
