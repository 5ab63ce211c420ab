"""Steps of a scene from a loop of the user's own: inputs are set, held over a step, and sensors read after it.

The inputs are the outputs of a sampled controller that the scene is given for this, so that a step is what a run does between two
instants of a controller, by the same method from the same numbers. Where nothing is to be watched between steps, all states go
through one native call (`integrators.batch.Together`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np

from mbdae.errors import NamesArguments, NamesAttributes, OptionError, SceneError, warn
from mbdae.files import path_of
from mbdae.formulations import Form, default_form, system_for
from mbdae.inputs.sensed import symbol
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.solution import Solution, Stats
from mbdae.results import archive
from mbdae.results.accuracy import Accuracy, RunInfo
from mbdae.results.result import Result
from mbdae.results.states import Instant
from mbdae.run.assessment import past_their_domain
from mbdae.run.batch import State, States, Window
from mbdae.run.choice import choose, prepared_from
from mbdae.run.contacts import refuse_unresolved
from mbdae.run.control import CLOSER
from mbdae.run.estimate import LOOSEST, companions, first_tolerance, measure_of, share_of, with_rtol
from mbdae.scene import sensed
from mbdae.scene.components import Connection
from mbdae.scene.record import item_name
from mbdae.scene.replay import Known, replay
from mbdae.scene.scene import SceneData
from mbdae.study.statements import call_of, restated
from mbdae.system.assembled.guards import Observer
from mbdae.system.base import Array
from mbdae.threads import single_threaded
from mbdae.values import number, option, shown, text, whole

AHEAD = 1000  #: number of steps over which inputs of time are looked at together, for breaks and for how fast they vary
LOGGED = 100_000  #: largest number of steps, since the error was read last, that can still be repeated to estimate it
NAME = "stepper"  #: name of the controller that holds the inputs, where the scene has no item of this name


class Stepper(NamesAttributes, NamesArguments):
    """Steps of `Scene.stepper`. t: the present time (s); dt: the length of a step (s); batch: number of states, None for one."""

    @single_threaded
    def __init__(self, scene: SceneData, dt: float, accuracy: float, solver: Solver | None, form: Form | None,
                 inputs: Sequence[str] | None, reads: Sequence[str], batch: int | None, start: Result | None) -> None:
        self.dt, self.accuracy, self.batch = dt, accuracy, batch
        self._given = scene, dt, accuracy, solver, form, inputs, reads, batch, start
        now: list[float] = []
        held, values, mine = with_inputs(scene, dt, inputs, reads, now)
        self._prepared = prepared = prepared_from(held, start, default=solver is None and form is None)
        asked = Asked(prepared.start.t + dt)
        if solver is None:
            choice = choose(prepared, held, accuracy, form)
            solver, form = choice.solver, choice.form
        form = form if form is not None else default_form(prepared, solver.highest_index)
        refuse_unresolved(prepared, solver)
        if solver.by_steps and not solver.fixed:
            raise OptionError(f"solver = {solver!r}: a stepper makes no runs to find its step from; give it a step or an rtol")
        system = system_for(prepared, form, solver.highest_index)
        if not solver.fixed and solver.rtol is None:
            if getattr(solver, "atol", None) is not None:
                solver = solver.at_accuracy(accuracy, system.label)
            else:  # as in the run that `simulate` returns
                solver = first_tolerance(system, prepared, solver, accuracy)[0]
                asked = replace(asked, share=CLOSER, impacts=solver.impacts)
        solver.check(system)
        if (timeline := system.timeline) is not None:
            system = copy(system)
            system.timeline = Window(prepared.model.scene, timeline, AHEAD * dt)
        self.solver, self.form, self._system, self._asked = solver, form.label, system, asked
        self._columns = {name: i for i, name in enumerate(values)}
        self._slots = np.array([system.numbering.place_of_state(name) for name in _outputs(values)], dtype=np.intp)
        self._made: Callable[[Solver, Asked], States] = lambda solver, asked: States(system, solver, asked, batch or 1, now, mine)
        self._states = self._made(solver, asked)
        self._readers: dict[str, Callable[[], Any]] = {}
        self._grid, self._inputs = (self.t, 0), np.tile(list(values.values()), (batch or 1, 1))
        self._begin(self._states.state(self._grid, self._inputs))
        self._first = self.state

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy, in this process or another, is made anew and goes on from the present state."""
        return _again, (self._given, self.state)

    def _begin(self, state: State) -> None:
        """Count errors from this state on."""
        self._log: list[tuple[float, tuple[float, int, float], Array]] | None = []
        self._began, self._told = state, False
        self._beside: States | None = None

    @property
    def t(self) -> float:
        """The present time, s."""
        return self._states.t

    @property
    def inputs(self) -> dict[str, Any]:
        """The inputs that are held from now on, by name: numbers, or (batch,)."""
        return {name: self._shown(self._inputs[:, i]) for name, i in self._columns.items()}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, in the order of `State.y`."""
        return self._system.names

    def _shown(self, values: Any) -> Any:
        return values.copy() if self.batch is not None else values[0].item() if values[0].ndim == 0 else values[0].copy()

    def set(self, values: Mapping[str, Any] | None = None, **named: Any) -> None:
        """Set inputs from now on, by name: numbers, or of a batch (batch,) too. They act in the steps that follow."""
        given = _by_name(values) | named
        changed = self._inputs.copy()
        for name, value in given.items():
            if name not in self._columns:
                raise OptionError(f"set: there is no input {shown(name)}; there are {', '.join(self._columns) or 'none'}: state "
                                  f"s.signal({shown(name)}, 0.0), or name it in s.stepper(..., inputs=[...])")
            if self.batch is None:
                changed[0, self._columns[name]] = option(name, value, number, "give a finite number")
            else:
                changed[:, self._columns[name]] = self._each(name, value)
        self._inputs = changed

    def _each(self, name: str, value: Any) -> Array:
        try:
            found = np.broadcast_to(np.asarray(value, dtype=float), (len(self._inputs),))
        except (TypeError, ValueError):
            raise OptionError(f"{name} = {shown(value)}: give a number, or {len(self._inputs)}, one for every state") from None
        if not np.isfinite(found).all():
            raise OptionError(f"{name} = {shown(value)}: give finite numbers")
        return found

    def advance(self, dt: float | None = None) -> None:
        """Take the state over one step, with the inputs held; dt: its length (s), by default that of the stepper. SolverError
        where the method cannot go on: the state is then that before the step."""
        begin, count = self._grid
        if dt is None:
            every, grid = self.dt, (begin, count + 1)
            end = begin + (count + 1) * every
        else:
            every = option("dt", dt, number, "give the length of the step, a positive number of seconds", above=0)
            begin, count, end = self.t, 0, self.t + every
            grid = end, 0
        step = end, (begin, count, every), self._inputs
        self._states.to(*step, self._slots)
        self._grid = grid
        if self._log is not None:
            self._log.append(step)
            if len(self._log) > LOGGED:
                self._log = None

    @property
    def state(self) -> State:
        """The present state, to go back to by `reset`: a copy."""
        return self._states.state(self._grid, self._inputs)

    def reset(self, state: Any = None, values: Mapping[str, Any] | None = None) -> None:
        """Go back to a `state` (or the file of one), by default the start; values: unknowns by name (`names`) that differ from
        it, such as {"J.angle": 0.1}, of scenes whose joints form a tree. Errors count from here on."""
        if state is not None and not isinstance(state, State):
            state = self._loaded(state)
        taken = self._first if state is None else state
        if taken.y.shape != self._states.y.shape or taken.inputs.shape != self._inputs.shape:
            raise OptionError(f"state has {taken.y.shape} unknowns and {taken.inputs.shape} inputs, this stepper "
                              f"{self._states.y.shape} and {self._inputs.shape}: give a state of a stepper of the same scene")
        if values := _by_name(values):
            if self._prepared.rows:
                raise OptionError("values: joints of this scene are constraints between its unknowns, which cannot be set one by "
                                  "one; state the start in the scene (angle0=, rate0=), or give a Result by start=")
            taken, wrong = replace(taken, y=taken.y.copy()), set(values) - set(self.names)
            if wrong:
                raise OptionError(f"values: there is no unknown {shown(min(wrong))}; there are {', '.join(self.names)}")
            if driven := set(values) & {self.names[place] for place in self._slots}:
                raise OptionError(f"values: {min(driven)} is an input: set it by step.set(...)")
            for name, value in values.items():
                taken.y[:, self.names.index(name)] = self._each(name, value)
        self._states.take(taken)
        self._grid, self._inputs = taken._grid, taken.inputs
        self._begin(taken)

    def _loaded(self, path: Any) -> State:
        shapes = {"t": (3,), "inputs": self._inputs.shape, **dict.fromkeys(("y", "yp"), self._states.y.shape)}
        if not isinstance(path, str | PathLike):
            raise OptionError(f"state = {shown(path)} is no state: give one of a stepper, or the file of one")
        try:
            with archive.Archive(path_of(path)) as stored:
                fits = stored.text("header") == "mbdae state" and stored.shapes == shapes
                found = {name: stored.array(name) for name in shapes} if fits else {}
        except Exception as error:  # readers of a damaged archive may raise anything
            raise OptionError(f"state = {shown(path)} is not the file of a state, or damaged: {error}") from error
        if not fits:
            raise OptionError(f"state = {shown(path)} is not the file of a state of this scene")
        t, begin, count = found["t"].tolist()
        return State(t, found["y"], found["inputs"], found["yp"], (begin, int(count)), [], [])

    @property
    def error(self) -> Any:
        """The estimated error of the present state, as `accuracy` of `Scene.simulate` measures it; (batch,) of a batch. It
        follows from the distance to the same steps at another tolerance, which are made where it is read. None: it is not
        known, with constant steps, or after more than 100000 steps between two readings."""
        if self.solver.fixed or self._log is None:
            return None
        looser = min(companions(self._system, self.solver)[-1], self.solver.companion)
        # a tolerance of the user's: between two instants there may be one step, and none longer for a looser companion
        ratio, share = (looser, 1.0) if self._asked.share is not None else (1 / looser, CLOSER)
        rtol = min(max(self.solver.tolerance * ratio, self.solver.tightest[""]), LOOSEST)
        if self._beside is None:
            self._beside = self._made(with_rtol(self.solver, rtol), replace(self._asked, share=share))
            self._beside.take(self._began)
        for step in self._log:
            self._beside.to(*step, self._slots)
        self._log = []
        times, of_it = np.full(len(self._inputs), self.t), 1.0
        if ratio > 1 and self._system.guards is None:
            of_it = share_of(self._system, self.solver, self.solver.tolerance / rtol)
        found = of_it * measure_of(self._system, self._prepared)(times, self._beside.y, self._states.y)
        worst = float(np.max(found))
        if worst > self.accuracy and self._asked.share is not None and not self._told:
            self._told = True
            warn(f"stepper of scene '{self._prepared.model.scene.name}': accuracy {self.accuracy:g} asked, estimated error "
                 f"{worst:.1e} at t = {self.t:.6g} s; give a smaller accuracy")
        return self._shown(found)

    def __getitem__(self, path: str) -> Any:
        """A sensor at the present time, as r[...] of a result reads it ("J.angle", "rod.position", "J.force"), with the inputs as
        they are set now: a number or an array; of a batch (batch, ...)."""
        path = option("sensor", path, text, "name a sensor such as 'J.angle'")
        reader = self._readers.get(path)
        if reader is None:
            reader = self._readers[path] = self._reader(path)
        return reader()

    def _reader(self, path: str) -> Callable[[], Any]:
        if path in self._columns and "." not in path:  # "S.length" is the sensor, also where the natural length is driven
            return lambda: self.inputs[path]
        (name, quantity, _), model = sensed.parsed(path), self._prepared.model
        item = model.scene._by_name.get(name)
        if (isinstance(item, Connection) and quantity in item.scalars and not model.planar and item.unit(quantity) == "rad"
                and model.coordinate_node(name, quantity) is None):
            raise OptionError(f"step[{shown(path)}]: whole turns of this angle are not counted; let the stepper count them, "
                              f"s.stepper(..., reads=[{shown(path)}])")
        try:
            observed = Observer(self._prepared.model, self._prepared.all_bodies.moved, [symbol(path)])
            if observed(np.array([self.t]), self._states.y[:1]).shape == (1, 1):
                return lambda: self._shown(observed(np.full(len(self._inputs), self.t), self._present())[:, 0])
        except SceneError:  # no sensor that a load may read: of accelerations and forces, or several components
            pass
        return lambda: self._shown(np.array([self.result(i).read(path)[0] for i in range(len(self._inputs))]))

    def _present(self) -> Array:
        """The unknowns, with the inputs as they are set now."""
        if not len(self._slots):
            return self._states.y
        y = self._states.y.copy()
        y[:, self._slots] = self._inputs
        return y

    def result(self, i: int = 0) -> Result:
        """The present state (number i of a batch) as a Result of one time, with all its sensors, whose errors are not known. Its
        warnings say where forces no longer mean what they state, such as a rope that has left a pulley."""
        i = option("i", i, whole, "give the number of a state of the batch", least=0, most=len(self._inputs) - 1)
        y = self._present()[i : i + 1]
        yp = self._system.restarted(self.t, y[0])[1][None]
        t, still = np.array([self.t]), Instant(self.solver.label, y, yp)
        solution = Solution(t, y, yp, None, Stats(), still, self.names, True, still)
        info = RunInfo(still, self.form, Accuracy(None, None), Stats())
        found = Result(self._prepared, solution, info, t)
        return Result(self._prepared, solution, replace(info, warnings=tuple(past_their_domain(found))), t)


def _again(given: tuple[Any, ...], state: State) -> Stepper:
    made = Stepper(*given)
    made.reset(state)
    return made


def _by_name(values: Any) -> dict[Any, Any]:
    """Values by name that a user gives, or none."""
    if not isinstance(values, Mapping | None):
        raise OptionError(f"values = {shown(values)} is not a dict: give values by name, such as {{'u': 0.5}}")
    return dict(values or {})


def _outputs(inputs: Mapping[str, float]) -> list[str]:
    """The names under which the scene has the inputs as outputs of a controller."""
    return [name.replace(".", " ") for name in inputs]


def with_inputs(scene: SceneData, every: float, names: Sequence[str] | None, read: Sequence[str],
                now: list[float]) -> tuple[SceneData, dict[str, float], str]:
    """A copy of a scene with a controller that returns the list `now` every so many seconds and reads the sensors `read`, inputs
    by name with the values that the scene states, and the controller's name. names: inputs; None: signals that are numbers."""
    if scene.problems:
        raise SceneError(scene.problems)
    numbers = {one.name: one.value for one in scene.signals if one.kind == "signal" and isinstance(one.value, float)}
    outputs = {one: c.name for c in scene.controllers for one in c.sets}
    statements, values, dropped = deepcopy(scene.statements), dict[str, float](), set[str]()
    for name in numbers if names is None else names:
        if name in numbers:
            values[name] = numbers[name]
            dropped.add(name)
        elif name in outputs:
            values |= {one: 0.0 for one, own in outputs.items() if own == outputs[name]}
            dropped.add(outputs[name])
        else:
            values[name] = _opened(scene, statements, name)
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space,
            "statements": [one for one in statements if item_name(one) not in dropped]}
    held = replay(data, type(scene), Known(scene.own)) if values or read else scene
    if held.problems:
        raise OptionError("inputs: name numbers that may change in time, such as loads and prescribed motions: "
                          + "; ".join(map(str, held.problems)))
    taken = {item_name(one) for one in statements}
    mine = next(f"{NAME}{'_' * n}" for n in range(len(taken) + 1) if f"{NAME}{'_' * n}" not in taken)
    for path in read:
        option("reads", path, lambda one: sensed.found(held, one), "name sensors as a controller does, such as 'J.angle'")
    if values:
        held.controller(mine, lambda *_: list(now), every, reads=list(read), sets=_outputs(values), start=list(values.values()))
    elif read:
        sensed.keep_read_coordinates(held, read)
    return held, values, mine


def _opened(scene: SceneData, statements: list[Any], name: str) -> float:
    """Put the output of a controller in the place of a number of a statement, such as "J.torque"; returns the number."""
    item, *keys = name.split(".")
    if not keys:
        raise OptionError(f"inputs: there is no signal {shown(name)} that is a number; state s.signal({shown(name)}, 0.0), or "
                          f"name a number of an item, such as '{name}.torque'")
    index, call = call_of(scene, statements, item)
    holder: Any = call
    for key in keys[:-1]:
        holder = holder[int(key)] if isinstance(holder, list) else holder.get(key) if isinstance(holder, dict) else None
    at = int(keys[-1]) if isinstance(holder, list) and keys[-1].isdigit() else keys[-1]
    try:
        value = number(holder[at])
    except Exception:  # whatever is there is no number
        raise OptionError(f"inputs: {name} is no number of the scene's statements; name a number, such as 'J.torque' of "
                          f"s.revolute('J', ..., torque=0.0)") from None
    holder[at] = {"expression": f'sensor("{_outputs({name: 0.0})[0]}")'}
    statements[index] = restated(scene, statements[index][0], call)
    return float(value)
