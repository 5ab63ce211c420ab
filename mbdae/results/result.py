"""What a simulation returns: states, sensors, energy, drift, accuracy, statistics and warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mbdae.errors import OptionError, SceneError, Told
from mbdae.inputs import timed
from mbdae.integrators.solution import Solution, Stats
from mbdae.kernels.plan import Outputs
from mbdae.results.accuracy import Accuracy
from mbdae.results.energy import Energy, energy
from mbdae.results.reactions import stresses
from mbdae.results.sensors import ConnectionSensor, body_sensor, placed, split
from mbdae.scene.beams import BeamLoad
from mbdae.scene.components import Body, Connection, Place
from mbdae.scene.scene import SceneData
from mbdae.symbolic.outputs import coordinate
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.rank.rows import smallest, unit_rows
from mbdae.system.start.start import Start
from mbdae.values import file_to_write, number, of_class, option, optional, shown, text


@dataclass(frozen=True)
class Drift:
    """Largest constraint violation at each of the result's times: g (m, rad) and G u + g_t (m/s, rad/s), (nt,)."""

    position: Array
    velocity: Array


@dataclass(frozen=True)
class RunInfo:
    """How a result was made."""

    solver: Any
    form: str
    accuracy: Accuracy
    stats: Stats
    runs: int = 1
    cpu_s: float = 0.0  #: of all runs together
    warnings: tuple[str, ...] = ()
    choice: str = ""  #: why this solver, where mbdae chose it
    reliable: bool = True  #: False where energy was made or lost beside contacts: see `Result.reliable`


class Result(Told):
    """A simulated scene. `r["name"]` gives the sensors of a body, joint or force, `r["beam.at(0.5)"]` those of a place on a
    body or beam; `r(t)` the result at other times."""

    def __init__(self, prepared: Prepared, solution: Solution, info: RunInfo, t: Array) -> None:
        self.prepared, self.solution, self.info = prepared, solution, info
        self.t = np.asarray(t, dtype=float)
        self._sensors: dict[str, Any] = {}

    # -- how it went

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
        """What the user should know before trusting the result."""
        return self.info.warnings

    @property
    def reliable(self) -> bool:
        """False where contact or friction went wrong: the energy balance is off by more than a tenth of what they dissipate, or
        a contact that friction makes unstable was damped away by the steps."""
        return self.info.reliable

    @property
    def contacts(self) -> dict[str, dict[str, float]]:
        """By joint with clearance: number of `contacts`, `first` (s), `deepest` penetration (m), `play` (m), `wear` (J)."""
        return {c.name: self[c.name].summary() for c in self.prepared.model.scene.joints if c.loose}

    @property
    def start(self) -> Start:
        """The consistent start; `start.changes` tells what had to be moved."""
        return self.prepared.start

    @property
    def complete(self) -> bool:
        """False where the run was stopped before its end."""
        return self.solution.complete

    # -- states

    @cached_property
    def _states(self) -> tuple[Array, Array, Array]:
        return self.states(self.t)

    def states(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions q (nt, nq), velocities u (nt, nu) and internal states s (nt, ns) at times t (nt,)."""
        y = self.solution(t)
        return self.prepared.states(np.ravel(np.asarray(t, dtype=float)), y.reshape(-1, y.shape[-1]))

    def stresses(self, t: Array) -> Array | None:
        """Stresses z (nt, nz) of the beams at times t (nt,), where they were unknowns of the run (Radau IIA); None elsewhere."""
        return stresses(self.prepared, self.solution, np.atleast_1d(self.solution.times(t)))

    def state_for(self, scene: SceneData, t: float | None = None) -> Start:
        """The state at t (default: the end) as the start of a run of `scene`, which may have fewer joints whose coordinate is an
        unknown."""
        option("scene", scene, of_class, "give the scene that goes on from this state", base=SceneData)
        optional("t", t, number, "give a time of the run in s, or None for its end")
        when = self.solution.t[-1:] if t is None else self.solution.times(t)[None]
        said, meant = ([b.name for b in known.bodies] for known in (self.prepared.model.scene, scene))
        if said != meant:
            raise OptionError(f"start: a state of scene '{self.prepared.model.scene.name}', which has other bodies than "
                              f"'{scene.name}', cannot start it: give a state of a scene with the same bodies")  # fmt: skip
        (q,), (u,), (s,) = self.states(when)
        known = {c.name for c in scene.joints if c.joint.own_coordinates}
        here = self(when)
        found = {c.name: here.coordinate(c) for c in self.prepared.model.scene.joints}
        coordinates = {name: float(of[0][0]) for name, of in found.items() if of is not None}
        nodes = [n for n in self.prepared.model.nodes if n.body is not None or n.name in known]
        q = np.concatenate([q[n.q : n.q + n.kind.sizes[0]] for n in nodes])
        u = np.concatenate([u[n.u : n.u + n.kind.sizes[1]] for n in nodes])
        names = tuple(self.prepared.mechanics.numbering.states.values())
        return Start(float(when[0]), q, u, s, np.zeros_like(u), np.zeros(0), names=names, coordinates=coordinates)

    @property
    def q(self) -> Array:
        """Positions of all nodes (nt, nq)."""
        return self._states[0]

    @property
    def u(self) -> Array:
        """Velocities of all nodes (nt, nu)."""
        return self._states[1]

    @cached_property
    def _dynamics(self) -> tuple[Array, Array]:
        return self.prepared.with_all_rows.accelerations(self.t, *self._states, stresses(self.prepared, self.solution, self.t))

    @property
    def acceleration(self) -> Array:
        """u' of all nodes (nt, nu), from the equations of motion at q, u."""
        return self._dynamics[0]

    @property
    def multipliers(self) -> Array:
        """Constraint multipliers (nt, m), from the equations of motion at q, u; names in `multiplier_names`. Where redundant rows
        leave them open, those of least norm (`Mechanics.accelerations`)."""
        return self._dynamics[1]

    @property
    def multiplier_names(self) -> tuple[str, ...]:
        """"joint.row" of every multiplier."""
        return tuple(row.name for row in self.prepared.with_all_rows.rows)

    def __call__(self, t: float | Sequence[float] | Array) -> Result:
        """The same run read at other times (dense output)."""
        times = np.atleast_1d(self.solution.times(t))
        if times.ndim > 1:
            raise OptionError(f"t = {shown(t)} has shape {times.shape}: give a time of the run in s, or a list of them")
        return Result(self.prepared, self.solution, self.info, times)

    # -- sensors

    def __getitem__(self, name: str | Body | Connection | Place) -> Any:
        if isinstance(name, Place):
            return body_sensor(self, self.prepared.model.scene[name.body.name], name.point)
        if not isinstance(name, str | Body | Connection | BeamLoad):
            scene = self.prepared.model.scene
            raise OptionError(f"r[{shown(name)}]: name an item of scene '{scene.name}', such as {scene._names()}")
        key = name if isinstance(name, str) else name.name
        if key not in self._sensors:
            item, where = placed(self.prepared.model.scene, key)
            if isinstance(item, BeamLoad):
                raise OptionError(f"'{key}' is a distributed load: it has no sensors; read its beam '{item.beam.name}'")
            sensor = body_sensor(self, item) if isinstance(item, Body) else _connection_sensor(self, item)
            self._sensors[key] = sensor if where is None else sensor.at(where)  # type: ignore[union-attr]
        return self._sensors[key]

    def read(self, path: str) -> Array:
        """A sensor by its path, e.g. "C.angle", "crank.position" or "beam.at(0.5).position" (nt, ...)."""
        name, quantity = split(option("sensor", path, text, "name a sensor such as 'C.angle' or 'crank.position'"))
        try:
            sensor = self[name] if name and quantity else None
        except SceneError as error:
            raise SceneError([f"there is no sensor {shown(path)}: {'; '.join(error.problems)}"]) from error
        if sensor is None or quantity.startswith("_") or not hasattr(type(sensor), quantity):
            known = ", ".join(sorted(a for a in dir(type(sensor)) if not a.startswith("_"))) if sensor is not None else ""
            items = self.prepared.model.scene._names()
            told = f"'{name}' has {known}" if known else f"give item.quantity of an item, such as {items}"
            raise SceneError([f"there is no sensor '{path}'; {told}"])
        return np.asarray(getattr(sensor, quantity))

    def sum_over_laws(self, outputs: Outputs, item: Connection, width: int) -> Array:
        """(nt, width) outputs summed over the laws of one item; multipliers included."""
        total = np.zeros((len(self.t), width))
        q, u, s = self._states
        for g, _, values in self.prepared.with_all_rows.evaluate(outputs, self.t, q, u, s, self.multipliers):
            for i, instance in enumerate(self.prepared.model.groups[g].instances):
                if instance.item == item.name:
                    total += values[:, i]
        return total

    def coordinate(self, item: Connection) -> tuple[Array, Array] | None:
        """Coordinate and rate (nt,) of a joint; whole turns counted along the run's steps; None if it has none."""
        if self._one_coordinate(item, self.t[:1]) is None:
            return None
        value, rate = self._one_coordinate(item, self.t)  # type: ignore[misc]
        unwrapped = self.prepared.model.planar or item.name in {n.name for n in self.prepared.model.joint_coordinates}
        if unwrapped or getattr(item.joint, "coordinate_unit", "") != "rad":
            return value, rate
        steps = self.solution.t
        grid, fine_rate = self._one_coordinate(item, steps)  # type: ignore[misc]
        followed = _unwrapped(steps, grid, fine_rate, self._start_value(item))
        near = np.interp(self.t, steps, followed)
        return value + 2 * np.pi * np.round((near - value) / (2 * np.pi)), rate

    def _start_value(self, item: Connection) -> float:
        if item.prescribed is not None:
            return timed.value_at(item.prescribed, float(self.solution.t[0]))
        return self.prepared.start.coordinates.get(item.name, item.hold or 0.0)

    def coordinate_at(self, item: str, t: Array) -> tuple[Array, Array] | None:
        """Coordinate (turns not counted) and rate (nt,) of a joint at times t (nt,)."""
        return self._one_coordinate(self.prepared.model.scene[item], t)

    def _one_coordinate(self, item: Connection, t: Array) -> tuple[Array, Array] | None:
        for g, _, values in self.prepared.mechanics.evaluate(coordinate, t, *self.states(t)):
            for i, instance in enumerate(self.prepared.model.groups[g].instances):
                if instance.item == item.name:
                    return values[:, i, 0], values[:, i, 1]
        return None

    # -- guards

    @cached_property
    def energy(self) -> Energy:
        """Kinetic, potential, dissipated energy, work, and their balance over the result's times."""
        return energy(self.prepared.mechanics, self.solution.t, self.t, lambda t: (*self.states(t), self.stresses(t)))

    @cached_property
    def drift(self) -> Drift:
        """Constraint violation over the result's times, of all rows: also of those left out as redundant."""
        m, (q, u, _) = self.prepared.with_all_rows, self._states
        g, gd = m.position_residual(self.t, q), m.velocity_residual(self.t, q, u)
        return Drift(np.max(np.abs(g), axis=1, initial=0.0), np.max(np.abs(gd), axis=1, initial=0.0))

    @cached_property
    def smallest_singular_value(self) -> Array:
        """(nt,) of all constraint rows, each of unit length, those that redundant rows make zero left out: near zero, positions
        are singular and reactions uncertain."""
        m, rank = self.prepared.with_all_rows, len(self.prepared.rank.kept)
        return np.array([smallest(unit_rows(m, g), rank) for g in m.constraint_jacobian(self.t, self.q)])

    # -- output

    def plot(self, *sensors: str, against: Any = None, labels: Sequence[str] | None = None, path: Any = None) -> Any:
        """Draw sensors ("C.angle", "D.force") over time, one panel per quantity; returns the matplotlib figure.

        against: a Result or a list of them drawn along; labels: one per result, this one first; path: .png, .svg, .pdf."""
        from mbdae.show.plots import compared, plot_results

        return plot_results(compared(self, against, labels), sensors, path)

    def phase(self, x: str, y: str, against: Any = None, labels: Sequence[str] | None = None, path: Any = None) -> Any:
        """Draw one sensor over another ("C.angle", "C.rate"), start and end marked; options as for `plot`."""
        from mbdae.show.plots import compared, plot_phase

        return plot_phase(compared(self, against, labels), x, y, path)

    def orbit(self, place: Any, axes: str = "xy", against: Any = None, labels: Sequence[str] | None = None,
              path: Any = None) -> Any:  # fmt: skip
        """Draw the path (m) of a place in a plane of the inertial frame, equal scales, start and end marked.

        place: a body, a joint or their name, "hub.position", body.at(point) or "beam.at(0.5)"; other options as for `plot`."""
        from mbdae.show.plots import compared, plot_orbit

        return plot_orbit(compared(self, against, labels), place, axes, path)

    def animate(self, path: Any, sensors: Sequence[str] = (), fps: float = 30.0, speed: float | None = None,
                trail: Any = None) -> None:  # fmt: skip
        """Write the motion as a .gif, or as an .html player that needs nothing but a browser.

        sensors: drawn over time below the motion. fps: frames per s on the screen. speed: simulated s per s on the screen
        (default: 1, where that takes 1 to 60 s, else what takes about 8 s). trail: places whose path is drawn, as `orbit`
        takes them, one or a list."""
        from mbdae.show.animation import animate

        animate(self, path, sensors, fps, speed, trail)

    def save(self, path: Any) -> None:
        """Write scene and run to one .npz file; `mb.load(path, laws=[...])` reads it, with one's own classes in `laws`."""
        from mbdae.results.storage import save

        save(self, option("path", path, file_to_write, "give the path of a file, such as 'run.npz', in a folder that exists"))

    def __repr__(self) -> str:
        a, s = self.accuracy, self.stats
        known = f"{a.estimated:.1e}" if a.estimated is not None else "unknown"
        asked = f"{a.asked:g}" if a.asked is not None else "none"
        shorter = f" ({s.shortened} shortened for inputs of time)" if s.shortened else ""
        return (f"<Result '{self.prepared.model.scene.name}': t = {self.t[0]:g}..{self.t[-1]:g} s, {self.info.solver.label} "
                f"{self.info.form}, {s.steps} steps{shorter}, {self.info.cpu_s:.2f} s CPU, accuracy asked {asked}, "
                f"estimated error {known}, {a.brief}{f', {len(self.warnings)} warning(s)' if self.warnings else ''}>")


def _connection_sensor(result: Result, item: Connection) -> ConnectionSensor:
    from mbdae.results.clearance import ClearanceSensor

    return ClearanceSensor(result, item) if item.loose else ConnectionSensor(result, item)


def _unwrapped(t: Array, principal: Array, rate: Array, start: float) -> Array:
    """Continuous angle along steps: every step takes the turn nearest to the angle its rates predict."""
    out = np.empty_like(principal)
    previous = start
    for i, value in enumerate(principal):
        guess = previous if i == 0 else previous + (t[i] - t[i - 1]) * (rate[i] + rate[i - 1]) / 2
        out[i] = value + 2 * np.pi * np.round((guess - value) / (2 * np.pi))
        previous = out[i]
    return out
