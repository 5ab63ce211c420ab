"""The ways in which a scene is run: joint model x form x solver, and the choice that mbdae makes by itself; the parameters that
are varied, with their values."""

from __future__ import annotations

import copy
import functools
import inspect
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mbdae.compare.problem import Problem
from mbdae.compare.run import Run, checked_runs, shipped_runs
from mbdae.errors import OptionError
from mbdae.inputs.breaks import Pulse
from mbdae.scene.components import Classical, JointModel, Recursive
from mbdae.scene.record import item_name
from mbdae.scene.scene import SceneData
from mbdae.study.statements import call_of, changed, items_of, pulses, stated_number, varying
from mbdae.values import number, option, sequence, shown

CHOICE = "chosen by mbdae"


@dataclass(frozen=True)
class Way:
    """A way to run a scene: a stated run; or, where `run` is None, the form and solver that mbdae chooses by itself, and also its
    choice of joint models where `models` is None too."""

    label: str
    run: Run | None
    models: Run | None = None  #: where `run` is None, a run whose joint models are used with mbdae's choice of form and solver

    def with_step(self, h: float) -> Run | None:
        """The run at a constant step h (s); None where its solver has no such option."""
        if self.run is None or not hasattr(self.run.solver, "step"):
            return None
        return replace(self.run, solver=replace(self.run.solver, step=h))  # type: ignore[type-var]


def ways(problem: Problem, runs: Sequence[Run] | None) -> list[Way]:
    """The given runs, or all that apply to the scene, followed by mbdae's own choice."""
    if runs is not None:
        return [Way(_label(run), run) for run in checked_runs(runs)] + [Way(CHOICE, None)]
    found: list[Way] = []
    for name, models, free in _models(problem):
        listed = [replace(run, model=models) for run in shipped_runs(free)]
        listed = [replace(run, label=" ".join([_label(replace(run, model=None)), name]).strip()) for run in listed]
        found += [Way(_label(run), run) for run in listed if not (models and run.solver.by_steps)]
        found.append(Way(f"{CHOICE} {name}".strip(), None, listed[0] if models else None))
    return found


def _models(problem: Problem) -> list[tuple[str, JointModel | dict[str, JointModel] | None, bool]]:
    """Name, joint models, and whether they give an ODE: first as stated, then others. Joints with clearance are not changed."""
    joints = [c for c in problem.scene.joints if c.has_models] if problem.scene is not None else []
    ideal = [c for c in joints if not c.loose]
    if len(ideal) == len(joints):
        others = problem.other_models.items()
        return [("", None, not problem.constrained), *((type(m).__name__, m, free) for m, free in others)]
    loose: tuple[JointModel, ...] = (Classical(), Recursive()) if ideal else ()
    return [("", None, not problem.constrained), *((type(m).__name__, {c.name: m for c in ideal}, False) for m in loose)]


def stepped_ways(problem: Problem, h: float) -> list[Way]:
    """Runs with the constant step h (s), one for every method that has such a step."""
    return [Way(_label(replace(run, solver=replace(run.solver, step=None))), run)  # type: ignore[type-var]
            for run in shipped_runs(not problem.constrained, h)]


def _label(run: Run) -> str:
    return run.name(run.form.label if run.form is not None else "")


# -- The values that a user wants for a parameter: a list, or decades between two bounds


OPTIONS = {"accuracy": "accuracy asked", "step": "constant step, s", "t_end": "end of the run, s"}
RUNGS = 7  #: largest number of values from one bound to the other, both included


def asked_values(vary: Any) -> dict[str, tuple[float, ...]]:
    """The values by parameter; OptionError where `vary` is no such mapping, or a value is no number."""
    if not isinstance(vary, Mapping) or not vary or not all(isinstance(name, str) for name in vary):
        raise OptionError(f"vary = {shown(vary)}: give {{parameter: (low, high) or [values]}}, such as "
                          "{'coupler.mass': (1e-3, 1e3)}")
    return {name: _values(name, asked) for name, asked in vary.items()}


def _values(name: str, asked: Any) -> tuple[float, ...]:
    parameter, remedy = f"vary: '{name}'", "give (low, high) for a ladder of decades, or a list of values"
    each, bounds = remedy, dict[str, float]()
    if name == "accuracy":
        each, bounds = f"{remedy}, each from 1e-12 to 0.1", {"least": 1e-12, "most": 1e-1}
    elif name in OPTIONS:
        each, bounds = f"{remedy}, each positive, in s", {"above": 0}
    given: tuple[float, ...] = tuple(option(parameter, asked, sequence, each, each=number, **bounds))
    if not given:
        raise OptionError(f"{parameter} = {shown(asked)} is empty: give (low, high) for a ladder of decades, or a list of values")
    if not isinstance(asked, tuple) or len(given) != 2:
        return given
    if given[0] * given[1] <= 0:
        raise OptionError(f"{parameter} = {shown(asked)}: a tuple means (low, high) with values by decades between, so that both "
                          f"need the same sign and neither may be 0; give a list for single values: [..., ...]")
    return ladder(*given)


def ladder(low: float, high: float) -> tuple[float, ...]:
    """Both bounds and values between them, equal numbers of whole decades apart where possible; at most `RUNGS` values."""
    decades = abs(math.log10(high / low))
    steps = max(1, math.ceil(decades - 1e-9)) if decades <= RUNGS - 1 else 0
    if not steps:  # prefer steps of whole decades, as many as are allowed
        whole = [n for n in range(RUNGS - 1, 0, -1) if abs(decades / n - round(decades / n)) < 1e-9]
        steps = whole[0] if whole else RUNGS - 1
    return tuple(float(f"{low * (high / low) ** (i / steps):.6g}") for i in range(steps + 1))


# -- Parameters that a map of extremes varies: an argument of a statement of the scene, of scene(), or an option of the run


FEW = 4  #: largest number of items of a kind that are varied by default


@dataclass(frozen=True)
class Varied:
    """A parameter with its values. scene(value): the scene at that value; t_end(value): end of its run, s; stops(value): times
    (s) at which a reference restarts, so that it steps over no pulse of the inputs."""

    name: str
    values: tuple[float, ...]
    scene: Callable[[float], SceneData]
    t_end: Callable[[float], float]
    stops: Callable[[float], list[float]] = lambda value: []


def varied(scene: Any, t_end: float, values: Mapping[str, Sequence[float]]) -> list[Varied]:
    """The parameters with their values, each checked at all of them."""
    return [_one(scene, t_end, name, tuple(asked)) for name, asked in values.items()]


def stated(scene: Any) -> SceneData:
    """The scene without variation; `scene` is a scene, or a function that returns one."""
    made = scene
    if callable(scene) and not isinstance(scene, SceneData | type):
        try:
            inspect.signature(scene).bind()
        except (TypeError, ValueError) as error:
            raise OptionError(f"scene = {shown(scene)} cannot be called without arguments ({error}): give a function "
                              f"whose parameters have defaults") from error
        made = scene()
    if not isinstance(made, SceneData):
        if made is not scene:
            raise OptionError(f"scene = {shown(scene)} returns {shown(made)}: let it return a mb.Scene")
        raise OptionError(f"scene = {shown(scene)}: give a mb.Scene, or a function scene(**parameters) with defaults "
                          f"that returns one")
    return made


def _one(scene: Any, t_end: float, name: str, values: tuple[float, ...]) -> Varied:
    inside = re.fullmatch(r"scene\((\w+)=([^)]+)\)\.(.+)", name)
    if inside:
        own, value, rest = inside.groups()
        _refuse_unknown_argument(scene, own)
        there = functools.partial(scene, **{own: _number_in(name, value)})
        return replace(_one(there, t_end, rest, values), name=name)
    if name in OPTIONS:
        base = stated(scene)
        found = Varied(name, values, lambda value: base, lambda value: value if name == "t_end" else t_end)
    elif "." not in name:
        _refuse_unknown_argument(scene, name)
        found = Varied(name, values, lambda value: stated(scene(**{name: value})), lambda value: t_end)
    else:
        return _of_item(stated(scene), t_end, name, values)
    return replace(found, stops=lambda value: _stops(pulses(found.scene(value).statements, found.t_end(value))))


def _of_item(base: SceneData, t_end: float, name: str, values: tuple[float, ...]) -> Varied:
    """A parameter named item.argument: an argument of the statement, or a number (begin, width, strength) of a pulse in that
    statement's inputs."""
    for value in values:
        changed(base, name, value, t_end)  # refuses a parameter that cannot be varied before any run starts

    def stops(value: float) -> list[float]:
        s, factor = changed(base, name, value, t_end)
        item, *keys = name.split(".")
        index, call = call_of(base, copy.deepcopy(base.statements), item)
        pulse = varying(call, keys, t_end, name)
        if pulse is None:
            return _stops(pulses(s.statements, t_end * factor))
        others = [statement for i, statement in enumerate(s.statements) if i != index]
        return _stops([pulse.at(value), *pulses(others, t_end)])

    return Varied(name, values, lambda value: changed(base, name, value, t_end)[0],
                  lambda value: t_end * changed(base, name, value, t_end)[1], stops)


def _stops(found: list[Pulse]) -> list[float]:
    return sorted({t for pulse in found for t in pulse.stops})


def _number_in(name: str, value: str) -> float:
    """The number that `value` states, the text "3" in a name such as "scene(n=3).coupler.mass"; OptionError for other text."""
    try:
        return number(float(value))
    except ValueError:
        raise OptionError(f"vary: '{name}': the argument {value} of scene(...) is not a finite number; give one, as in "
                          f"'scene(n=3).A.spring'") from None


def _refuse_unknown_argument(scene: Any, name: str) -> None:
    own = list(inspect.signature(scene).parameters) if callable(scene) and not isinstance(scene, SceneData) else []
    if name not in own:
        arguments = f"arguments of scene(): {', '.join(own)}; " if own else "scene() has no arguments; "
        raise OptionError(f"vary: there is nothing named '{name}'; {arguments}options of the run: {', '.join(OPTIONS)}; "
                          f"or 'item.argument' of an item of the scene: {items_of(stated(scene))}")


def default_vary(scene: SceneData) -> dict[str, list[float]]:
    """Default values: accuracies and constant steps; masses, stiffnesses and speeds stated in the scene, times fixed factors."""
    found: dict[str, list[float]] = {"accuracy": [1e-3, 1e-5, 1e-7], "step": [1e-2, 1e-4, 1e-6, 1e-8]}
    for kind, factors in (("mass", (1e-6, 1e-3, 1.0, 1e3, 1e6)), ("stiffness", (1.0, 1e3, 1e6)), ("speed", (1.0, 10.0, 100.0))):
        items = [name for name in (item_name(s) for s in scene.statements) if isinstance(name, str)]
        of_kind = [(name, now) for name in items if (now := stated_number(scene, name, kind))]
        for name, now in of_kind[:FEW]:
            found[f"{name}.{kind}"] = [now * f for f in factors]
    return found
