"""The errors of a run as far as they are known, and why the others are not.

How a result was made, the events of its run, and how far its constraints are violated.

The result of equations of a user's own: their unknowns by name, over time, with the error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from mbdae.errors import ListsAttributes, OptionError, unknown_name
from mbdae.integrators.solution import Solution, Stats
from mbdae.laws.bodies import with_modes
from mbdae.notation import counted
from mbdae.process import unchanging
from mbdae.results.errors import AGAINST_MESH, Errors
from mbdae.results.quantities import named
from mbdae.system.base import Array
from mbdae.system.model.nodes import rotation_matrices
from mbdae.system.prepare import Prepared
from mbdae.values import number, option, shown, text

LEAST_ACCURACY = 1e-12  #: smallest accuracy that may be asked for
WORDS = ("motion", "reactions", "mesh", "deformation")  #: the errors of a run
#: why an error is not known where the solver had a tolerance or a step of its own
RUN_ONCE = "not estimated: the solver ran once, as it was given; leave out its rtol or step, or give verify=True"
NO_RUN_BESIDE = "not estimated: no second run for comparison was completed"
NOT_REPEATED = "not measured: simulate(..., verify=True) repeats a run on a finer mesh"
MODEL = ("how far the model itself (rigid bodies, ideal joints, laws and their numbers) differs from the real system cannot be "
         "estimated by a solver")


@dataclass(frozen=True, repr=False)
class Accuracy:
    """The largest errors of a run over its time, as far as they are known.

    asked, estimated, verified: error of the motion (positions relative to the scene's length, angles in rad, velocities relative
    to length / characteristic time; with elastic bodies positions and angles alone): asked for; estimated from a companion run of
    the same method; verified by another method; or None.
    reactions: error of the forces and torques of joints and force elements, over the largest of the run (torques are divided by
    the scene's length); from the same runs as the errors of motion and mesh.
    amplification: growth of small disturbances over the run, computed when it is read (in about the time of the run).
    of: errors of the quantities that the run was asked for (`simulate(of=...)`), by what was given, each over its largest value
    in the run, or 1e-6 of the scene's largest force or torque; None where one is not known.
    mesh: error of positions and angles, all along the beams and of all bodies, caused by the elements of beams and by the modes
    that reduced bodies leave out; None where it was not measured.
    meshes: where that error, or that of a quantity asked for, misses the accuracy: by name of a beam the elements and order of
    the first mesh with which both were measured to be within it, {"rod": {"elements": 4, "order": 3}}; else empty.
    deformation: error of positions, over the scene's length, by what reduced bodies leave out as with small deformations: about
    1.5 times the square of the largest displacement by a mode, over the body's size, and drifts over time; None without any.
    `covers` names the errors within the accuracy asked, `not_covered` the others with the reason.
    """

    asked: float | None
    estimated: float | None
    verified: float | None = None
    mesh: float | None = None
    has_mesh: bool = False  #: False in a scene without elastic bodies, where there is no error of a mesh
    unknown: Mapping[str, str] = field(default_factory=dict)  #: name of an error -> why it is not known
    #: error of the reactions, or what computes it when it is read
    found_reactions: Callable[[], float] | float | None = field(default=None, compare=False)
    #: growth of small disturbances, or what computes it when it is read
    found_amplification: Callable[[], float | None] | float | None = field(default=None, compare=False)
    of: Mapping[Any, float | None] = field(default_factory=dict)
    meshes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    deformation: float | None = None

    @property
    def motion(self) -> float | None:
        """Error of the motion in time: verified, else estimated."""
        return self.verified if self.verified is not None else self.estimated

    @cached_property
    def reactions(self) -> float | None:
        """Error of forces and torques over the largest force of the run (times the scene's length); None where not known."""
        return self.found_reactions() if callable(self.found_reactions) else self.found_reactions

    @cached_property
    def amplification(self) -> float | None:
        """Natural logarithm of the largest factor by which small disturbances grow from one time of the run to a later one; None
        where an impact or a switch leaves it unknown, and where more than 50 000 pieces of the run are needed. A disturbance is
        measured by positions and angles, and by velocities in units in which they are as large. Its error is some tenths."""
        return self.found_amplification() if callable(self.found_amplification) else self.found_amplification

    @property
    def errors(self) -> Errors | None:
        """The errors of everything that the result shows; None where no other run was made, or none was kept."""
        return self.found_reactions if isinstance(self.found_reactions, Errors) else None

    @property
    def lacks(self) -> str:
        """What the errors of motion, reactions, peaks and all that is read do not contain: "mesh" (the elements of beams, the
        modes that reduced bodies leave out) where it was not measured, by verify=True; "second order of deformations" of reduced
        bodies (see `deformation`); both; or ""."""
        of_mesh = ["mesh"] if self.has_mesh and self.mesh is None else []
        return " and the ".join([*of_mesh, *(["second order of deformations"] if self.deformation else [])])

    @property
    def met(self) -> bool | None:
        """Whether the errors of the motion, of the quantities asked for and, where measured, of the mesh are within the accuracy
        asked; None where none was asked or an error is not known. Other reactions do not count: see `covers`."""
        if self.asked is None or self.motion is None:
            return None
        known = [error for error in (self.motion, self.mesh, *self.of.values()) if error is not None]
        return False if not max(known) <= self.asked else None if None in self.of.values() else True

    @property
    def covers(self) -> frozenset[str]:
        """Which of "motion", "reactions", "mesh", "deformation" and the quantities asked for are within the accuracy asked.
        "mesh" is neither here nor in `not_covered` where a scene has no elastic bodies, "deformation" where no reduced ones."""
        return frozenset(self._errors) - frozenset(self.not_covered)

    @property
    def not_covered(self) -> dict[str, str]:
        """The errors that are not within the accuracy asked, each with its size, or with the reason why that is not known; and
        "model", whose error no run can measure."""
        found = {}
        for word, error in self._errors.items():
            if error is None or self.asked is None:
                found[word] = self.unknown.get(word, RUN_ONCE)
            elif not error <= self.asked:
                of = " of the largest" if word == "reactions" else "" if word in WORDS else " of its largest value"
                found[word] = f"error of about {error:.1e}{of}, {self.asked:g} was asked"
        return found | {"model": MODEL}

    @property
    def _errors(self) -> dict[str, float | None]:
        """The errors by name: "motion", "reactions", in a scene with elastic bodies "mesh", with reduced ones "deformation", and
        what was asked for."""
        of_bodies = ({"mesh": self.mesh} if self.has_mesh else {}) | ({} if self.deformation is None else
                                                                      {"deformation": self.deformation})
        return {"motion": self.motion, "reactions": self.reactions} | of_bodies | {
            named(key): error for key, error in self.of.items()}

    @property
    def brief(self) -> str:
        """`covers` in one line, with the known errors of what is not covered."""
        missing = [word for word in self._errors if word not in self.covers]
        left_out = [f"{word}{f' ({self._errors[word]:.1e})' if self._errors[word] is not None else ''}" for word in missing]
        return f"covers {', '.join(word for word in self._errors if word in self.covers) or 'nothing'}" + (
            f", not {', '.join(left_out)}" if missing else "")

    def as_data(self) -> dict[str, Any]:
        """Plain data; `Accuracy(**data)` is equal to this one."""
        return {"asked": self.asked, "estimated": self.estimated, "verified": self.verified, "mesh": self.mesh,
                "has_mesh": self.has_mesh, "unknown": dict(self.unknown), "found_reactions": self.reactions,
                "found_amplification": self.amplification, "of": {named(key): error for key, error in self.of.items()},
                "meshes": {name: dict(mesh) for name, mesh in self.meshes.items()}, "deformation": self.deformation}

    def __repr__(self) -> str:
        told = (f"{name}={value:.2g}" for name, value in (("asked", self.asked), ("estimated", self.estimated),
                ("verified", self.verified), *self._errors.items()) if value is not None and name != "motion")
        reasons = "".join(f"\n  {word}: not covered: {why}" for word, why in self.not_covered.items())
        return f"<Accuracy {', '.join((*told, self.brief))}>{reasons}"


def second_order(prepared: Prepared, t: Array, q: Array, u: Array) -> float | None:
    """`Accuracy.deformation` of positions q (k, nq) and velocities u (k, nu) at times t (k,); of a state at rest k = 1."""
    kept = _accelerated(prepared, t, q, u)
    free = prepared.rank.degrees_of_freedom > sum(len(c.joint.reduced.modal_mass) for c, _ in kept)
    off = [c.joint.reduced.left_out_of(prepared, c, q, (t, u, rates, free) if len(t) > 1 else None) for c, rates in kept]
    return max(off) / prepared.length if off else None


def left_by_modes(prepared: Prepared, t: Array, q: Array, u: Array) -> list[tuple[Any, Array]]:
    """The modes of every reduced body, and (k,) about how far a node is off because these leave out how its weight and the
    acceleration of its frame deform it, m. In motion twice what they do at rest: so far a load deforms that comes suddenly."""
    return [(c, (1 + (len(t) > 1)) * np.abs(rates) @ c.joint.reduced.unshown) for c, rates in _accelerated(prepared, t, q, u)]


def _accelerated(prepared: Prepared, t: Array, q: Array, u: Array) -> list[tuple[Any, Array]]:
    """The modes of every reduced body in a scene, and the accelerations (k, 6) of its frame, its weight included, in its axes."""
    found, new = [], np.r_[True, np.diff(t) > 0]
    for c in with_modes(prepared.model.scene.connections):
        node: Any = prepared.model.node(c.k)
        v = u[:, node.u : node.u + 6]
        rates = np.gradient(v[new], t[new], axis=0)[np.cumsum(new) - 1] if np.sum(new) > 2 else np.zeros((len(t), 6))
        rates[:, :3] -= prepared.model.scene.gravity
        rates[:, :3] = np.einsum("tia,ti->ta", rotation_matrices(q[:, node.q + 3 : node.q + 7]), rates[:, :3])
        found.append((c, rates))
    return found


def against_mesh(meshes: Mapping[str, Mapping[str, Any]]) -> str:
    """What helps against the error of a mesh; meshes: `Accuracy.meshes`."""
    found = ", ".join(f"{name} elements={mesh['elements']}, order={mesh['order']}" for name, mesh in meshes.items())
    return f"give {found}, measured to be within the accuracy in the motion and in what was asked for" if found else AGAINST_MESH


@dataclass(frozen=True)
class Drift:
    """Largest constraint violation at each of the result's times: g (m, rad) and G u + g_t (m/s, rad/s), (nt,)."""

    position: Array
    velocity: Array


class Event(NamedTuple):
    """A condition that was met: the time (s), the condition as it was given, and 1 where it began to hold (of an equation: where
    its left side rose through the right one), -1 where it ceased to (fell), 0 where it was only touched."""

    time: float
    name: str
    direction: int


@dataclass(frozen=True)
class RunInfo:
    """How a result was made."""

    solver: Any
    form: str
    accuracy: Accuracy
    stats: Stats
    runs: int = 1
    cpu_s: float = 0.0  #: CPU time of all runs made for this result, s: solvers tried, companions, verification, recheck
    warnings: tuple[str, ...] = ()
    choice: str = ""  #: why this solver, where mbdae chose it
    #: False where the energy balance, a damped contact, a joint that is off or a contact that steps missed speaks against it;
    #: `Result.reliable` also counts accuracy and completeness
    reliable: bool = True
    events: tuple[Event, ...] = ()


class OfRun:
    """How a run went, as its result tells it; info: how it was made."""

    info: RunInfo
    solution: Solution

    @property
    def accuracy(self) -> Accuracy:
        """Accuracy asked, estimated and verified, and what it covers."""
        return self.info.accuracy

    @property
    def stats(self) -> Stats:
        """Steps, evaluations and CPU time of the run returned."""
        return self.info.stats

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before trusting the result, one sentence per warning."""
        return self.info.warnings

    @property
    def complete(self) -> bool:
        """False where the run was stopped before its end."""
        return self.solution.complete

    @property
    def reliable(self) -> bool | None:
        """True where the run is complete, its error is estimated and within the accuracy asked (`accuracy.met`), and nothing
        speaks against it; None where its error is not known, as after a run with a tolerance or a step of its own. False where
        the accuracy is missed or the run was stopped; of a scene, where the energy balance is off by more than a tenth of what
        contact and friction dissipate (with constant steps: of the energy exchanged); where a joint is off by more than a
        thousandth of the scene's length, or rad, and by more than the accuracy allows; or where steps passed over a contact, or
        damped one that friction makes unstable."""
        return self.accuracy.met if self.info.reliable and self.complete else False


EQUATIONS = "how far the equations themselves differ from the real system cannot be estimated by a solver"


@dataclass(frozen=True, repr=False)
class UnknownsAccuracy(Accuracy):
    """The largest error of a run of equations of a user's own, as far as it is known.

    asked, estimated: error of every unknown, multipliers too, over the largest value of that unknown in the run, or over 1e-3 of
    its `scale` where that is more; the largest over the time. `covers` is {"unknowns"} where it is within the accuracy asked."""

    worst: str = ""  #: name of the unknown with the largest estimated error

    @property
    def not_covered(self) -> dict[str, str]:
        """"unknowns" with the size of the error, or the reason why it is not known, where it is not within the accuracy asked;
        and "model", whose error no run can measure."""
        return super().not_covered | {"model": EQUATIONS}

    @property
    def _errors(self) -> dict[str, float | None]:
        return {"unknowns": self.motion}


class Unknowns(OfRun, ListsAttributes):
    """The unknowns of own equations over time: `r["x"]` (nt,) by name, `r.y` (nt, n) all, at the times `r.t` (nt,), s;
    `r(t)` the result at other times.

    solution: the run with its steps; info: how it was made."""

    def __init__(self, solution: Solution, info: RunInfo, t: Array) -> None:
        self.solution, self.info, self.t = solution, info, unchanging(np.array(t))
        self.y: Array = unchanging(solution(t))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, in the order of y."""
        return self.solution.names

    def __getitem__(self, name: str) -> Array:
        wanted = option("name", name, text, f"name an unknown: {', '.join(self.names)}")
        if wanted not in self.names:
            raise OptionError(f"there is no unknown {unknown_name(wanted, self.names)} the names are {', '.join(self.names)}")
        return np.asarray(self.y[:, self.names.index(wanted)])

    def __call__(self, t: float | Sequence[float] | Array) -> Unknowns:
        """The same run at other times t (s), by its dense output; OptionError for times outside of the run."""
        times = np.atleast_1d(self.solution.times(t))
        if times.ndim > 1:
            raise OptionError(f"t = {shown(t)} has shape {times.shape}: give a time of the run in s, or a list of them")
        return Unknowns(self.solution, self.info, times)

    def __repr__(self) -> str:
        a, s, info = self.accuracy, self.stats, self.info
        known = f"{a.estimated:.1e}" if a.estimated is not None else "unknown"
        asked = f"{a.asked:g}" if a.asked is not None else "none"
        warned = (", not reliable" if self.reliable is False else "") + (
            f", {counted(len(self.warnings), 'warning')}" if self.warnings else "")
        return (f"<Unknowns {', '.join(self.names)}: t = {self.t[0]:g}..{self.t[-1]:g} s, {info.solver.label}, "
                f"{counted(s.steps, 'step')}, {info.cpu_s:.2f} s CPU, accuracy asked {asked}, estimated error {known}, "
                f"{a.brief}{warned}>")


class UnknownsDistance:
    """The distance of two trajectories (nt, n) of own equations: over time the largest difference of an unknown, over its largest
    value in the second one or, where that is more, over LEAST times its scale. worst: index of the unknown that was farthest
    apart at the last call."""

    def __init__(self, scale: Array) -> None:
        self._least, self.worst = LEAST * np.asarray(scale, dtype=float), 0

    def __call__(self, t: Any, a: Array, b: Array) -> Array:
        apart = np.abs(a - b) / np.maximum(np.max(np.abs(b), axis=0), self._least)
        self.worst = int(np.argmax(np.max(apart, axis=0)))
        return np.asarray(np.max(apart, axis=1))


LEAST = 1e-3  #: errors are relative to the largest value of an unknown in the run, but at least to this fraction of its scale


def plausible(accuracy: Any, name: str = "accuracy") -> float:
    """An accuracy as a float; OptionError outside LEAST_ACCURACY to 0.1."""
    return float(option(name, accuracy, number, "give a number from 1e-12 to 0.1 (1e-6 serves most)", least=LEAST_ACCURACY,
                        most=1e-1))
