"""The statements of a scene as data to store; OptionError with item and remedy where they cannot be stored.

The start of a stored run as plain data: coordinates of joints, and controllers that were under way.

The runs beside a run in the file of a result: their unknowns at the times of the comparison.

The start of a scene as a Result: sensors before any run.

Quantities that a run is asked for beside its motion, `simulate(of=...)`: read, compared between runs, and told.

In the measure by which runs are compared (`control`) each counts as the motion does, by its difference over its largest value. So
tolerance, method and, of beams, whether all vibrations are resolved follow from what was asked; what came of it is estimated like
everything that is read of a result (`results.errors`).
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from inspect import signature
from typing import Any

import numpy as np

from mbdae.deferred import distinct
from mbdae.errors import MbdaeError, OptionError, SceneError
from mbdae.inputs.sensed import path_of, paths
from mbdae.integrators.solution import Solution, Stats
from mbdae.results.accuracy import Accuracy, RunInfo
from mbdae.results.archive import MOST_OTHERS
from mbdae.results.clearance import KINDS, AtTimes, OtherRun, some_of
from mbdae.results.errors import Errors
from mbdae.results.quantities import NAME_A_QUANTITY, Quantity, named
from mbdae.results.result import Result
from mbdae.results.states import Instant
from mbdae.scene.changed import refuse_losses
from mbdae.scene.record import STATEMENTS, encode, item_name
from mbdae.scene.replay import Known, decoded, replay
from mbdae.scene.scene import SceneData
from mbdae.symbolic.outputs import fingerprint
from mbdae.symbolic.stated import own
from mbdae.system.base import Array
from mbdae.system.model.model import Model
from mbdae.system.prepare import Prepared
from mbdae.system.sampling import UnderWay, distance
from mbdae.system.scene_system import SceneSystem
from mbdae.system.start import Start
from mbdae.values import BadValueError, number, shown, whole


def statements(scene: SceneData) -> dict[str, Any]:
    """The data of a scene; OptionError where a scene built from it would differ."""
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space, "statements": scene.statements}
    for method, args, kwargs in scene.statements:
        item = item_name([method, args, kwargs])
        for found in _inside([args, kwargs]):
            if "unreadable" in found:
                argument = found["unreadable"]
                raise OptionError(f"{method} '{item}' was given {argument}, which cannot be stored: give numbers, "
                                  f"texts, expressions of mb.t, laws, or a function defined with def")
            _check_name(f"{method} '{item}'", found.get("class", found.get("object", found.get("law"))))
    if set(scene.own) - set(Known().own):
        _check_own(scene, data)
    return data


def by_item(data: dict[str, Any]) -> dict[str, Any]:
    """Data of a scene with statements by kind and item, and their arguments by name, to describe a difference in words."""
    said: dict[str, Any] = {}
    for method, args, kwargs in data["statements"]:
        names = list(signature(STATEMENTS[method]).parameters)[1:]
        further = {f"argument {i}": v for i, v in enumerate(args) if i >= len(names)}
        named = dict(zip(names, args, strict=False)) | further | kwargs
        said[f"{method} '{item_name([method, args, kwargs])}', number {len(said) + 1}"] = named
    return data | {"statements": said}


def _inside(value: Any) -> Iterator[dict[str, Any]]:
    """All dictionaries inside plain data."""
    if isinstance(value, dict):
        yield value
    for part in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _inside(part)


def _check_name(item: str, name: Any) -> None:
    """OptionError for the stored name of a class or function by which `mb.load` could not find it: of a lambda, or not unique."""
    if isinstance(name, str) and name.endswith("<lambda>"):
        raise OptionError(f"{item}: a lambda has no name by which it could be found again; define it with def, and pass it to "
                          f"mb.load in laws=[...]")
    if isinstance(name, str) and name.endswith(")"):
        raise OptionError(f"{item}: two classes or functions are called {name.rpartition(' ')[0]}, which the file could not tell "
                          f"apart; give each a name of its own")


def _check_own(scene: SceneData, data: dict[str, Any]) -> None:
    """OptionError where the user's own laws are not the same in a scene built again from the data."""
    try:
        refuse_losses(scene, replay(json.loads(json.dumps(data)), SceneData, Known(scene.own)))
    except MbdaeError as error:
        reason = "; ".join(error.problems) if isinstance(error, SceneError) else error
        raise OptionError(f"this scene could not be built again from what would be stored of it: {reason}; keep "
                          f"the script that states it, and its results by r.to_csv") from error


def own_laws(model: Model) -> dict[str, str]:
    """Fingerprints of the equations of the user's own laws, by name of the class and number of the group of laws with these
    equations in the model."""
    found = [group for group in model.groups if own(group.derived.law)]
    found.sort(key=lambda group: group.key[0].__module__.startswith("mbdae."))  # laws of mbdae with parts of the user's come last
    return {f"{group.key[0].__qualname__} {i}": fingerprint(group.derived) for i, group in enumerate(found)}


def check_laws(stored: dict[str, str], found: dict[str, str]) -> None:
    """BadValueError where a law given to `load` states other equations than those that were integrated. stored, found: by law the
    fingerprints in the file and those of the laws given."""
    for name in stored:
        if found.get(name) != stored[name]:
            raise BadValueError(f"the law {name.split()[0]} states other equations than when the file was written; hand over the "
                                f"class as it was: pass laws=[...]")


def start_header(start: Start) -> dict[str, Any]:
    """The plain data of a start that go into the header of a file; its arrays are stored separately."""
    controllers = {name: [c.begin, c.calls, encode(c.memory)] for name, c in start.controllers.items()}
    return {"t": start.t, "changes": start.changes, "coordinates": _by_joint(start)} | (
        {"controllers": controllers} if controllers else {})


def start_of(header: dict[str, Any], numbers: dict[str, Any], scene: SceneData, known: Known) -> Start:
    """The start from what a file holds."""
    coordinates = _coordinates(header.get("coordinates", {}), scene)
    controllers = {name: _under_way(stored, scene, known) for name, stored in header.get("controllers", {}).items()}
    return Start(**header | {"coordinates": coordinates, "controllers": controllers}, **numbers)


def _under_way(stored: Any, scene: SceneData, known: Known) -> UnderWay:
    begin, calls, memory = stored
    return UnderWay(number(begin), whole(calls), decoded(memory, scene, known))


def _by_joint(start: Start) -> dict[str, dict[str, float]]:
    """Start values of coordinates by joint and name, as a file holds them."""
    found: dict[str, dict[str, float]] = {}
    for (joint, name), value in start.coordinates.items():
        found.setdefault(joint, {})[name] = value
    return found


def _coordinates(stored: dict[str, Any], scene: SceneData) -> dict[tuple[str, str], float]:
    """Start values by joint and name from those that a file holds: tables by name, or (earlier versions) one number."""
    known = {c.name: c.coordinates for c in scene.joints}
    found: dict[tuple[str, str], float] = {}
    for joint, values in stored.items():
        names = known.get(joint, ())
        of_joint = values if isinstance(values, dict) else dict.fromkeys(names[:1], values)
        if joint not in known:
            raise BadValueError(f"the start in the file names joint {shown(joint)}, which the scene in the file does not have")
        if not of_joint or not set(of_joint) <= set(names):
            raise BadValueError(f"the start in the file gives {shown(values)} for joint {shown(joint)}, whose coordinates are "
                                f"{', '.join(names) or 'none'}")
        found |= {(joint, name): float(value) for name, value in of_joint.items()}
    return found


TIMES = 400  #: largest number of times at which each is stored


def header_of(errors: Errors | None) -> dict[str, Any]:
    """What the header says of them: names of unknowns, share and kind of each, and what was told about quantities. Runs on
    another mesh of beams are left out: their scene is not stored."""
    if errors is None:
        return {}
    kept = [{"names": list(other.run.names), "share": other.share, "kind": other.kind, "ratio": other.ratio}
            for other in _stored(errors)]
    return {"others": kept, "told": dict(errors.told)}


def arrays_of(errors: Errors | None) -> dict[str, Array]:
    """Times and unknowns of each."""
    found: dict[str, Array] = {}
    for i, other in enumerate(_stored(errors) if errors is not None else ()):
        times = other.times[distinct(np.linspace(0, len(other.times) - 1, TIMES).astype(int))]
        found |= {f"other{i}_t": times, f"other{i}_y": other.run(times)}
    return found


def _stored(errors: Errors) -> list[OtherRun]:
    return [other for other in errors.others if other.prepared is None and len(other.times)][:MOST_OTHERS]


def shapes_of(header: dict[str, Any], shapes: dict[str, tuple[int, ...]]) -> dict[str, tuple[int | None, ...]]:
    """The shapes that the arrays must have."""
    found: dict[str, tuple[int | None, ...]] = {}
    for i, other in enumerate(header.get("others", ())):
        count = (*shapes.get(f"other{i}_t", ()), 0)[0]
        found |= {f"other{i}_t": (count,), f"other{i}_y": (count, len(other["names"]))}
    return found


def with_errors(accuracy: Accuracy, header: dict[str, Any], arrays: dict[str, Array], prepared: Prepared,
                solution: Solution) -> Accuracy:
    """The accuracy of a loaded run with the errors of all quantities; with that of the reactions alone, a number, where the file
    has no runs beside it, as those of earlier versions."""
    if "others" not in header or accuracy.reactions is None:
        return accuracy
    others, least = [], prepared.all_bodies.numbering.n
    for i, other in enumerate(header["others"]):
        t, y = arrays[f"other{i}_t"], arrays[f"other{i}_y"]
        if other["kind"] not in KINDS or len(other["names"]) < least or not (t[1:] > t[:-1]).all():
            raise BadValueError(f"the file's run number {i} beside its run is none of this scene: {shown(other['kind'])}")
        run = Solution(t, y, y[:0], None, Stats(), solution.solver, tuple(other["names"]), True, AtTimes(t, y))
        others.append(OtherRun(run, t, other["share"], kind=other["kind"], ratio=other["ratio"]))
    errors = Errors(prepared, solution, tuple(others), accuracy.asked, dict(header["told"]), accuracy.reactions)
    return replace(accuracy, found_reactions=errors)


def started(prepared: Prepared) -> Result:
    """The start of a scene as a Result of one time."""
    start = prepared.start
    y = np.hstack([*prepared.all_bodies.reduced(start.q[None], start.u[None]), start.s[None]])
    t, still = np.array([start.t]), Instant("start", y, np.zeros_like(y))
    solution = Solution(t, y, still.yp, None, Stats(), still, (), True, still)
    return Result(prepared, solution, RunInfo(still, "", Accuracy(None, None), Stats()), t)


Wanted = Mapping[Any, Quantity]  #: by the text or object that the user gave, or the name of an expression
_SENSOR = re.compile(r'sensor\("(?:[^"\\]|\\.)*"\)')


def wanted_of(of: Any, prepared: Prepared) -> Wanted:
    """The quantities of `simulate(of=...)`; OptionError, before anything is solved, where one is none."""
    if of is None:
        return {}
    given = of.items() if isinstance(of, Mapping) else [(one, one) for one in (of if isinstance(of, list | tuple) else [of])]
    try:
        found = {key: _read(one, started(prepared)) for key, one in given}
    except (MbdaeError, TypeError) as error:  # what cannot be a key is no quantity either
        raise OptionError(f"of = {shown(of)}: {error}") from error
    names = [named(key) for key in found]
    if not names or len(set(names)) < len(names) or not all(isinstance(key, str) for key in found if isinstance(of, Mapping)):
        raise OptionError(f"of = {shown(of)}: give a list of quantities, each once, or a dictionary of them by name; "
                          f"{NAME_A_QUANTITY}")
    return found


def _read(one: Any, start: Result) -> Quantity:
    """A quantity as results read it: symbols of sensors and expressions of them as text."""
    quantity = _SENSOR.sub(lambda found: path_of(found[0]), str(one)) if paths(one) else one
    if not np.all(np.isfinite(start.value(quantity))):
        raise OptionError(f"{named(quantity)} is infinite or no number at the start, so that no error can be relative to its "
                          "largest value; ask for a quantity that is finite all along")
    return quantity


def apart(prepared: Prepared, run: Solution, other: OtherRun, wanted: Wanted, asked: float | None = None) -> float:
    """The largest difference of a quantity in a run and another one, over its size; 0 where it is rounding. asked: accuracy
    within which a jump may come earlier or later."""
    errors = Errors(prepared, run, (other,), asked, wanted=tuple(wanted.values()))
    view = Result(prepared, run, None, other.times)  # type: ignore[arg-type]
    estimates = [errors.of(view, quantity) for quantity in wanted.values()]
    return max((one.relative for one in estimates if one is not None), default=0.0)


class AskedToo:
    """The distance (nt,) of two trajectories a, b (nt, n) of a scene at times t (nt,): that of their motions, at its largest time
    also the differences of the quantities `wanted` over their largest values in b, where these are more.

    motion: the largest distance of the motions at the last call."""

    def __init__(self, prepared: Prepared, system: SceneSystem, wanted: Wanted, asked: float | None = None) -> None:
        self.prepared, self.names, self.wanted, self.asked = prepared, system.names, wanted, asked
        self.motion = 0.0
        self._last: tuple[tuple[object, ...], float] = (), 0.0

    def __call__(self, t: Array, a: Array, b: Array, run: Solution | None = None, ratio: float = 1.0) -> Array:
        """run: of which b is the trajectory, where it is known between the times too: jumps of its quantities are sought; ratio:
        the tolerance of a over that of b."""
        found = np.array(distance(self.prepared, t, a, b))
        self.motion = float(np.max(found, initial=0.0))
        times, first = np.unique(t, return_index=True)
        some = some_of(times, a.shape[1], bool(self.prepared.contacts))
        if len(some) > 1:
            of = first[np.searchsorted(times, some)]
            k = int(np.argmax(found))
            other, own = OtherRun(self._run(some, a[of]), some, 1.0, ratio=ratio), run or self._run(some, b[of])
            key = *(part.tobytes() for part in (some, a[of], b[of])), bool(run), ratio
            if key != self._last[0]:  # the same two runs are compared by several estimates
                self._last = key, apart(self.prepared, own, other, self.wanted, self.asked if run else None)
            found[k] = max(found[k], self._last[1])
        return found

    def between(self, t: Array, a: Solution, b: Solution, ratio: float) -> Array:
        """The same of two runs."""
        return self(t, a(t), b(t), None if isinstance(b.interpolant, AtTimes) else b, ratio)

    def _run(self, t: Array, y: Array) -> Solution:
        return Solution(t, y, y[:0], None, Stats(), Instant("", y, y), self.names, True, AtTimes(t, y))

    def of_motion(self, run: Solution, others: tuple[OtherRun, ...], estimate: float) -> float:
        """The part of an estimate, made with this measure of a run and others, that speaks of the motion."""
        motion = both = 0.0
        for other in others:
            apart = float(np.max(self.between(other.times, other.run, run, other.ratio)))
            motion, both = max(motion, other.share * self.motion), max(both, other.share * apart)
        return estimate * motion / both if both > 0 and math.isfinite(estimate) else estimate


def told(result: Result, known: Accuracy, wanted: Wanted) -> tuple[Accuracy, list[str]]:
    """The accuracy of a run with the relative errors of the quantities it was asked for, and what is to be said of those that are
    not within it."""
    errors, asked = known.errors, known.asked
    if errors is None or asked is None:
        found = dict.fromkeys(wanted)
        return replace(known, of=found), [f"of: the error of {named(key)} is not known: {known.not_covered[named(key)]}"
                                          for known in [replace(known, of=found)] for key in wanted]
    errors.wanted = tuple(wanted.values())
    relative = dict[Any, float | None]()
    for key, quantity in wanted.items():
        estimate = errors.of(result, quantity)
        relative[key] = None if estimate is None else estimate.relative
        if named(quantity) in errors.endless:  # told by the name that the user gave
            errors.endless[named(key)] = errors.endless[named(quantity)]
        errors.tell(named(key), "", estimate, asked)
    return replace(known, of=relative), []
