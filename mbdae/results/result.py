"""What a simulation returns: states, sensors, energy, drift, accuracy, statistics and warnings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import Later
from mbdae.errors import ListsAttributes, OptionError, SceneError, unknown_name
from mbdae.inputs.sensed import symbol
from mbdae.integrators.solution import Solution
from mbdae.notation import counted, rows, titled
from mbdae.results.accuracy import Drift, Event, OfRun, RunInfo
from mbdae.results.clearance import ClearanceSensor, ContactSensor, RopeSensor
from mbdae.results.contacts import Mean, Peak, mean, peak
from mbdae.results.quantities import Quantity, to_csv, to_dataframe, to_xarray, value
from mbdae.results.sensors import BodySensor, ConnectionSensor
from mbdae.results.states import Energy, RunStates, energy
from mbdae.scene.components import Beam, BeamLoad, Body, Connection, Controller, Place, Signal
from mbdae.scene.scene import SceneData
from mbdae.scene.sensed import parsed, placed
from mbdae.system.base import Array
from mbdae.system.dependent_rows import smallest_at
from mbdae.system.prepare import Prepared
from mbdae.system.sampling import Sampling, UnderWay
from mbdae.system.start import Start
from mbdae.values import file_to_write, number, of_class, option, optional, sequence, shown, text

if TYPE_CHECKING:
    from mbdae.laws.contact import Contact
    from mbdae.results.beams import BeamSensor
else:
    Contact = Later("mbdae.laws.contact", "Contact")
    BeamSensor = Later("mbdae.results.beams", "BeamSensor")

#: name of a method of Result -> function that draws or stores it; entered by the modules that have these functions
#: (`show.attached`, `storage`), on which this one must not depend
ATTACHED: dict[str, Callable[..., Any]] = {}


class Result(OfRun, RunStates, ListsAttributes):
    """A simulated scene. `r["name"]` gives the sensors of a body, joint or force, `r["beam.at(0.5)"]` those of a place on a
    body or beam; `r(t)` the result at other times."""

    def __init__(self, prepared: Prepared, solution: Solution, info: RunInfo, t: Array) -> None:
        super().__init__(prepared, solution, t)
        self.info = info
        self._sensors: dict[str, Any] = {}
        self._peaks: dict[str, tuple[float, float]] = {}
        self._silent = info is None

    def __getstate__(self) -> dict[str, Any]:
        """What `pickle` and `copy` keep: the run; computed sensors are left out, and computed again when they are read."""
        kind = type(self)
        own = {name: value for name, value in vars(self).items() if not isinstance(getattr(kind, name, None), cached_property)}
        return own | {"_sensors": {}, "_peaks": {}}

    # -- how it went

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before trusting the result, one sentence per warning; also about quantities that were read and whose error
        is above the accuracy."""
        errors = self.info.accuracy.errors
        return (*self.info.warnings, *(errors.told.values() if errors is not None else ()))

    @property
    def events(self) -> tuple[Event, ...]:
        """The conditions of `record=` that were met, and the one of `until=` that ended the run, in the order of time."""
        return self.info.events

    @property
    def contacts(self) -> dict[str, dict[str, float]]:
        """By joint with clearance or limits: number of `contacts`, `first` (s), `deepest` penetration (m, or rad at limits of an
        angle); with clearance also `play` (m), `wear` (J)."""
        return {item: self[item].summary() for item in dict.fromkeys(contact.item for contact in self.prepared.contacts)}

    @property
    def start(self) -> Start:
        """The consistent start; `start.changes` names what had to be moved for it."""
        return self.prepared.start

    def state_for(self, scene: SceneData, t: float | None = None) -> Start:
        """The state at t (s; default: the end) as the start of a run of `scene`: the same bodies, with the same or fewer joints
        whose coordinate is an unknown. Raises OptionError where the bodies differ, or t is outside of the run."""
        option("scene", scene, of_class, "give the scene that goes on from this state", base=SceneData)
        optional("t", t, number, "give a time of the run in s, or None for its end")
        when = self.solution.t[-1:] if t is None else self.solution.times(t)[None]
        if [b.name for b in self.prepared.model.scene.bodies] != [b.name for b in scene.bodies]:
            raise OptionError(f"start: a state of scene '{self.prepared.model.scene.name}', which has other bodies than "
                              f"'{scene.name}', cannot start it: "
                              "give one of a scene with the same names of bodies in the same order")
        (q,), (u,), (s,) = self.states(when)
        known = {c.name for c in scene.joints if c.kept}
        here = self(when)
        coordinates = {(c.name, name): float(value[0]) for c in self.prepared.model.scene.joints
                       for name, (value, _) in here.coordinates(c).items()}
        nodes = [n for n in self.prepared.model.nodes if n.body is not None or n.joint in known]
        q = np.concatenate([q[n.q : n.q + n.kind.sizes[0]] for n in nodes])
        u = np.concatenate([u[n.u : n.u + n.kind.sizes[1]] for n in nodes])
        names = tuple(self.prepared.mechanics.numbering.states.values())
        return Start(float(when[0]), q, u, s, np.zeros_like(u), np.zeros(0), names=names, coordinates=coordinates,
                     controllers=self._controllers_for(scene, float(when[0])))

    def _controllers_for(self, scene: SceneData, t: float) -> dict[str, UnderWay]:
        """The states, by name, of the controllers that `scene` shares with this run, at the time t (s) of the run: in a run of
        `scene` they go on from these."""
        prepared, run = self.prepared, self.solution
        mine = {c.name: (c.every, c.sets, c.memory is None) for c in prepared.model.scene.controllers}
        same = [c.name for c in scene.controllers if mine.get(c.name) == (c.every, c.sets, c.memory is None)]
        if not same:
            return {}
        found = Sampling(prepared, prepared.all_bodies.numbering).until(t, run.t, run.y)
        return {name: found[name] for name in same}

    def __call__(self, t: float | Sequence[float] | Array) -> Result:
        """The same run at other times t (s), by its dense output; OptionError for times outside of the run."""
        times = np.atleast_1d(self.solution.times(t))
        if times.ndim > 1:
            raise OptionError(f"t = {shown(t)} has shape {times.shape}: give a time of the run in s, or a list of them")
        made = Result(self.prepared, self.solution, self.info, times)
        made._silent = self._silent
        return made

    # -- sensors

    def __getitem__(self, name: str | Body | Connection | Place) -> Any:
        if isinstance(name, Place):
            return _sensor(self, self.prepared.model.scene[name.body.name]).at(name.point)
        if not isinstance(name, str | Body | Connection | BeamLoad):
            scene = self.prepared.model.scene
            raise OptionError(f"r[{shown(name)}]: name an item of scene '{scene.name}', such as {scene._names()}")
        key = name if isinstance(name, str) else name.name
        if key not in self._sensors:
            item, where = placed(self.prepared.model.scene, key)
            if isinstance(item, BeamLoad):
                raise OptionError(f"'{key}' is a distributed load: it has no sensors; read its beam '{item.beam.name}'")
            if isinstance(item, Signal):
                return self.observed(symbol(key))[:, 0]
            if isinstance(item, Controller):
                raise OptionError(f"'{key}' is a controller: it has no sensors; read its outputs: {', '.join(item.sets)}")
            sensor = _sensor(self, item)
            self._sensors[key] = sensor if where is None else sensor.at(where)
        return self._sensors[key]

    def read(self, path: str) -> Array:
        """A sensor by its path, e.g. "C.angle", "crank.position" or "beam.at(0.5).position" (nt, ...), one component of it,
        "crank.position[1]" (nt,), or a state, signal or output of a controller by its name (nt,)."""
        path = option("sensor", path, text, "name a sensor such as 'C.angle' or 'crank.position'")
        with self._silently():
            found = self._read(path)
        self._judge(path)
        return found

    def _read(self, path: str) -> Array:
        if isinstance(self.prepared.model.scene._by_name.get(path), Signal):
            return np.asarray(self[path])
        name, quantity, entry = parsed(path)
        try:
            sensor = self[name] if name and quantity else None
        except SceneError as error:
            raise SceneError([f"there is no sensor {shown(path)}: {'; '.join(error.problems)}"]) from error
        if sensor is None or quantity.startswith("_") or quantity not in dir(sensor):
            known = sorted(a for a in dir(sensor) if not a.startswith("_")) if sensor is not None else []
            unknown = unknown_name(path, [f"{name}.{one}" for one in known])
            if known:
                raise SceneError([f"there is no sensor {unknown} '{name}' has {', '.join(known)}"])
            items = self.prepared.model.scene._names()
            raise SceneError([f"there is no sensor {unknown} give item.quantity of an item, such as {items}"])
        values = np.asarray(getattr(sensor, quantity))
        if not entry:
            return values
        if len(entry) >= values.ndim or any(n >= size for n, size in zip(entry, values.shape[1:], strict=False)):
            if not (shape := " x ".join(map(str, values.shape[1:]))):
                raise SceneError([f"there is no sensor {shown(path)}: '{name}.{quantity}' has no components; omit the index"])
            raise SceneError([f"there is no sensor {shown(path)}: '{name}.{quantity}' has {shape} components, counted from 0"])
        where: Any = (slice(None), *entry)
        return np.asarray(values[where])

    def value(self, quantity: Quantity) -> Array:
        """A quantity at the result's times, (nt,) or (nt, n): a sensor, an expression of sensors such as "J.torque[2]*J.rate" or
        "norm(b.velocity)", or a function of the result."""
        with self._silently():
            found = value(self, quantity)
        self._judge(quantity)
        return found

    def error(self, quantity: Quantity) -> float | None:
        """Estimated error of a quantity (see `value`) over the run, in its unit, from the runs made beside this one; None where
        there were none, as with a solver's own tolerance or step."""
        errors = self.accuracy.errors
        with self._silently():
            value(self(self.t[:1]), quantity)  # raises the error of a quantity that is none
        found = None if errors is None else errors.of(self, quantity)
        return None if found is None else found.error

    def _judge(self, quantity: Quantity) -> None:
        """Warn where the error of a quantity that was read is above the accuracy asked."""
        if not self._silent and (errors := self.info.accuracy.errors) is not None:
            errors.judge(self, quantity)

    def _judge_part(self, quantity: Quantity, read: str, kind: str, *found: Any) -> float | None:
        """The error of what was read of a quantity, by a method of `Errors`; a warning where it is above the accuracy."""
        if self.info is None or (errors := self.info.accuracy.errors) is None:
            return None
        return errors.judge_part(self, quantity, getattr(errors, kind)(self, quantity, *found), read)

    def peak(self, quantity: Quantity, t: Any = None) -> Peak:
        """The largest magnitude of a quantity (see `value`), between the result's times too, with its time: `.value`, `.t`, and
        the error of the value, `.error`. t: (begin, end), s, between which it is sought; by default the result's times."""
        return peak(self._between(t, True), quantity)

    def mean(self, quantity: Quantity, t: Any = None) -> Mean:
        """The mean of a quantity (see `value`) over the times t = (begin, end), s, by default the result's: `.value`, of a vector
        by component, and its `.error`, which is judged over the largest value of the quantity in that time: a mean near 0 of what
        swings is as exact as what swings."""
        return mean(self._between(t), quantity, 1)

    def rms(self, quantity: Quantity, t: Any = None) -> Mean:
        """The root of the mean square of the magnitude of a quantity over the times t = (begin, end), s; see `mean`."""
        return mean(self._between(t), quantity, 2)

    def _between(self, t: Any, instant: bool = False) -> Result:
        """The run at two times (begin, end), s; for None at the least and the largest of the result's. instant: or at one."""
        whole = np.unique(self.t)[[0, -1]].tolist() if t is None and len(self.t) else t
        ends = option("t", whole, sequence, "give two times of the run in s, (begin, end)", each=number)
        if len(ends) != 2 or not (ends[0] < ends[1] or (t is None and instant)):
            raise OptionError(f"t = {shown(whole)} is no interval: give two times of the run in s, (begin, end), begin < end")
        return self if t is None and ends == self.t[[0, -1]].tolist() else self(ends)

    def to_dataframe(self, *sensors: Quantity, **further: Quantity) -> Any:
        """Quantities (see `value`) as a pandas.DataFrame over the time in s, vectors by component; every sensor where none is
        named. further: quantities with names of their own. `attrs["units"]` has the units."""
        return to_dataframe(self, sensors, further)

    def to_xarray(self, *sensors: Quantity, **further: Quantity) -> Any:
        """Quantities as in `to_dataframe`, as an xarray.Dataset: vectors have the dimension "axis", units are attributes."""
        return to_xarray(self, sensors, further)

    def to_csv(self, path: Any, *sensors: Quantity, **further: Quantity) -> None:
        """Quantities as in `to_dataframe`, in a file: columns divided by commas, units in the first line; see `mb.read_table`."""
        to_csv(self, path, sensors, further)

    # -- derivatives (see `ATTACHED`)

    def gradient(self, of: Any, to: Any) -> Any:
        """Derivatives of an objective, mb.integral(...), mb.at_end(...) or mb.largest(...), by numbers of the scene.

        to: names as in `mb.sweep`, "strut.stiffness", one or a list. Returns them by these names, each with `.value`, a number in
        units of the objective over those of the number, and `.error`, its estimated error. The end of the run does not move with
        the numbers. DerivativeError where there is no derivative, with the reason."""
        return ATTACHED["gradient"](self, of, to)

    def sensitivity(self, *of: Quantity, to: Any) -> Any:
        """Derivatives of quantities (see `value`) over the result's times by numbers of the scene, by (quantity, name): `.value`
        (outputs,), of vectors (outputs, components), and `.error`, the estimated largest error of these; see `gradient`."""
        return ATTACHED["sensitivity"](self, of, to)

    # -- energy, drift and rank

    @cached_property
    def energy(self) -> Energy:
        """Kinetic, potential and dissipated energy, work, and their balance over the result's times (nt,), J."""
        return energy(self.prepared.mechanics, self.solution.t, self.t, lambda t: (*self.states(t), self.stresses(t)))

    @cached_property
    def drift(self) -> Drift:
        """Constraint violation over the result's times, of all rows, redundant ones included."""
        m, (q, u, _) = self.prepared.with_all_rows, self._states
        g, gd = m.position_residual(self.t, q), m.velocity_residual(self.t, q, u)
        return Drift(np.max(np.abs(g), axis=1, initial=0.0), np.max(np.abs(gd), axis=1, initial=0.0))

    @cached_property
    def smallest_singular_value(self) -> Array:
        """(nt,) smallest singular value of all constraint rows, each scaled to unit length; the zeros that redundant rows cause
        do not count. Near zero, the position is singular and reactions are uncertain."""
        return smallest_at(self.prepared.with_all_rows, len(self.prepared.rank.kept), self.t, self.q)

    # -- pictures and files (see `ATTACHED`)

    def plot(self, *sensors: str, against: Any = None, labels: Any = None, path: Any = None, ax: Any = None) -> Any:
        """Draw sensors ("C.angle", "D.force") over time, one panel per quantity; returns the matplotlib figure.

        against: Results drawn along; labels: one per result, this one first; path: .png, .svg, .pdf; ax: axes, one per panel."""
        return ATTACHED["plot"](self, sensors, against, labels, path, ax)

    def phase(self, x: str, y: str, against: Any = None, labels: Any = None, path: Any = None, ax: Any = None) -> Any:
        """Draw one sensor over another ("C.angle", "C.rate"), start and end marked; options as for `plot`."""
        return ATTACHED["phase"](self, x, y, against, labels, path, ax)

    def orbit(self, place: Any, axes: str = "xy", against: Any = None, labels: Any = None,
              path: Any = None, ax: Any = None) -> Any:
        """Draw the path (m) of a place in a plane of the inertial frame, equal scales, start and end marked.

        place: a body, a joint or their name, "hub.position", body.at(point) or "beam.at(0.5)"; other options as for `plot`."""
        return ATTACHED["orbit"](self, place, axes, against, labels, path, ax)

    def animate(self, path: Any = None, sensors: Sequence[str] = (), fps: float = 30.0, speed: float | None = None,
                trail: Any = None, hide: Any = ()) -> Any:
        """The motion as a film, which a notebook plays; path: of a .gif, of an .html player for any browser, or of a .glb
        (glTF for renderers, without the deformed meshes of reduced bodies).
        sensors: drawn over time beside the motion. fps: frames per s on the screen. speed: simulated s per s on the screen
        (default: 1, where that takes 1 to 60 s, else what takes about 8 s). trail: places whose path is drawn, as `orbit`
        takes them, one or a list. hide: names of items that are left out, one or a list."""
        return ATTACHED["animate"](self, path, sensors, fps, speed, trail, hide)

    def save(self, path: Any) -> None:
        """Write scene and run to one .npz file; `mb.load(path, laws=[...])` reads it, with your own classes in `laws`."""
        place = option("path", path, file_to_write, "give the path of a file, such as 'run.npz', in a folder that exists")
        ATTACHED["save"](self, place)

    def _repr_html_(self) -> str:
        a, s, scene = self.accuracy, self.stats, self.prepared.model.scene
        said = [("time", f"{self.t[0]:g} to {self.t[-1]:g} s, {counted(len(self.t), 'output')}"),
                ("solver", f"{self.info.solver.label}, {self.info.form}: {counted(s.steps, 'step')}{self._plane}, "
                           f"{self.info.cpu_s:.2f} s CPU"),
                ("accuracy", f"asked {a.asked if a.asked is not None else 'none'}, estimated error "
                             f"{'unknown' if a.estimated is None else f'{a.estimated:.1e}'}; {a.brief}"),
                ("sensors", ", ".join(item.name for item in scene._items))]
        return titled(f"result of '{scene.name}'", rows(said + [("warning", w) for w in self.warnings]))

    @property
    def _plane(self) -> str:
        """What a print says of a planar scene, whose equations have no motion out of the plane; "" in space."""
        return ", planar" if self.prepared.model.planar else ""

    def __repr__(self) -> str:
        a, s = self.accuracy, self.stats
        known = f"{a.estimated:.1e}" if a.estimated is not None else "unknown"
        asked = f"{a.asked:g}" if a.asked is not None else "none"
        shorter = f" ({s.shortened} shortened for inputs of time)" if s.shortened else ""
        told = f", reactions not unique: {', '.join(shared)}" if (shared := self.prepared.rank.sharing) else ""
        warned = (", not reliable" if self.reliable is False else "") + (
            f", {counted(len(self.warnings), 'warning')}" if self.warnings else "")
        return (f"<Result '{self.prepared.model.scene.name}': t = {self.t[0]:g}..{self.t[-1]:g} s, {self.info.solver.label} "
                f"{self.info.form}, {counted(s.steps, 'step')}{shorter}{self._plane}, {self.info.cpu_s:.2f} s CPU, "
                f"accuracy asked {asked}, estimated error {known}, {a.brief}{told}{warned}>")


def _sensor(run: RunStates, item: Body | Connection) -> Any:
    """The sensor of a body, beam, joint or force element."""
    if isinstance(item, Connection):
        if item.loose or any(isinstance(law, Contact) for law in item.laws):
            return (ClearanceSensor if item.loose else ContactSensor)(run, item)
        return (RopeSensor if any(getattr(law, "must_stay", None) for law in item.laws) else ConnectionSensor)(run, item)
    return BeamSensor(run, item) if isinstance(item, Beam) else BodySensor(run, item)
