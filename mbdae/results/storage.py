"""Results on disk: one .npz file without pickle that holds the scene's statements, its start and the run.

A header (JSON) has the statements and how the run was made, arrays have the numbers. `load` builds the scene from its statements
and restores start, steps and interpolant as they were: nothing is solved again. The user's own classes are stored by name; `load`
builds those that are given to it, and nothing else that a file names (see `scene/replay.py`).
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, fields, is_dataclass
from typing import Any

import numpy as np

from mbdae.errors import MbdaeError, OptionError, SceneError, naming_arguments
from mbdae.files import path_of
from mbdae.formulations import Form, forms
from mbdae.integrators import radau_table
from mbdae.integrators.base import Solver
from mbdae.integrators.dense import Collocation, Hermite, Joined
from mbdae.integrators.named import solvers
from mbdae.integrators.solution import Interpolant, Solution, Stats
from mbdae.results import archive, stored_parts
from mbdae.results.accuracy import Accuracy, Event, RunInfo
from mbdae.results.archive import FORMAT, VERSION, OtherFormatError, parsed
from mbdae.results.result import ATTACHED, Result
from mbdae.results.stored_parts import start_header, start_of
from mbdae.scene.record import encode, stored_name, without_module
from mbdae.scene.replay import Known, replay
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.system.model.numbering import constraint_rows
from mbdae.system.motion import AllBodies
from mbdae.system.prepare import Prepared, mechanics_of, modelled
from mbdae.system.redundancy import RankReport
from mbdae.system.start import Start
from mbdae.system.start_with_contacts import expected_contacts
from mbdae.values import BadValueError, plain, shown

_START = ("q", "u", "s", "acceleration", "multipliers")
_RANK = ("kept", "dropped", "singular_here", "not_unique")
LONGEST = 700  #: largest number of characters of an error that the message of `load` repeats
_AGAIN = "give a file written by r.save(path)"


def save(result: Result, path: Any) -> None:
    """Write a result to one .npz file; OptionError where something in it cannot be stored."""
    prepared, solution = result.prepared, result.solution
    header = {
        "format": FORMAT, "version": VERSION, "scene": stored_parts.statements(prepared.model.scene),
        "rank": _rank(prepared.rank),
        "start": start_header(prepared.start), "laws": stored_parts.own_laws(prepared.model), "time": prepared.time,
        "info": _info(result.info), **stored_parts.header_of(result.accuracy.errors),
        "run": {"names": list(solution.names), "complete": solution.complete, "dense": _dense(solution.interpolant)},
    }
    arrays = {f"start_{name}": getattr(prepared.start, name) for name in _START} | _arrays(solution.interpolant)
    arrays |= {"t": result.t, "steps": solution.t, "y": solution.y, "yp": solution.yp}
    arrays |= stored_parts.arrays_of(result.accuracy.errors)
    text = json.dumps(header)
    try:
        parsed(text)
        _check_shapes(header, {name: values.shape for name, values in arrays.items()})
    except BadValueError as error:
        raise OptionError(f"this result cannot be stored: {error}; keep the script that states its scene, and its results by "
                          f"r.to_csv") from error
    archive.write(path, text, arrays)


ATTACHED["save"] = save


@naming_arguments
def load(path: Any, laws: Iterable[Any] = ()) -> Result:
    """The result stored in a file by `Result.save`.

    laws: your own classes (joints, forces, friction, normal laws, solvers) and functions (curves of beams) that the file names.
    Nothing else that a file names is built or called. OptionError where the file is damaged, is no result, or names a class that
    is neither mbdae's nor among `laws`; OSError where it cannot be opened."""
    place, known = path_of(path), Known.among(laws)
    try:
        with archive.Archive(place) as stored:
            header = parsed(stored.text("header"))
            _check_shapes(header, stored.shapes)
            arrays = {name: stored.array(name) for name in stored.shapes}
    except OtherFormatError as error:
        raise OptionError(f"{place} is no result that can be loaded: {error}") from error
    except (FileNotFoundError, PermissionError, IsADirectoryError):
        raise
    except Exception as error:  # readers of a damaged archive may raise anything
        raise OptionError(f"{place} is not a result of mbdae, or damaged ({_reason(error)}); {_AGAIN}") from error
    try:
        return _result(header, arrays, known)
    except Exception as error:  # a statement is wrong, in a way that its own checks may not have foreseen
        reason = _reason(error)
        remedy = "" if "pass laws=" in reason else f"; {_AGAIN}"
        raise OptionError(f"{place} cannot be loaded: {reason}{remedy}") from error


def _reason(error: Exception) -> str:
    """The message of an error on one line, shortened."""
    plain = isinstance(error, MbdaeError | BadValueError)
    why = "; ".join(error.problems) if isinstance(error, SceneError) else str(error)
    why = " ".join(why.split()) if plain else f"{type(error).__name__}: {' '.join(why.split())}"
    return why if len(why) <= LONGEST else f"{why[:LONGEST]}..."


def _result(header: dict[str, Any], arrays: dict[str, Array], known: Known) -> Result:
    _check_times(header, arrays)
    scene = _scene(header, known)
    numbers: dict[str, Any] = {name: arrays[f"start_{name}"] for name in _START}
    start = start_of(header["start"], numbers, scene, known)
    prepared = _prepared(header, scene, start)
    prepared.model.conditions.end = float(arrays["steps"][-1])
    run, info = header["run"], header["info"]
    solver = _solver(info["solver"], known)
    stats = Stats(**info["stats"])
    solution = Solution(arrays["steps"], arrays["y"], arrays["yp"], None, stats, solver, tuple(run["names"]), run["complete"],
                        _interpolant(run["dense"], arrays))
    accuracy, warnings = _accuracy(info["accuracy"], prepared), tuple(info["warnings"])
    accuracy = stored_parts.with_errors(accuracy, header, arrays, prepared, solution)
    made = RunInfo(solver, _form(info["form"], known), accuracy, stats, info["runs"], info["cpu_s"], warnings,
                   info.get("choice", ""), info.get("reliable", True),
                   tuple(Event(float(t), str(name), int(sense)) for t, name, sense in info.get("events", [])))
    return Result(prepared, solution, made, arrays["t"])


def _accuracy(stored: dict[str, Any], prepared: Prepared) -> Accuracy:
    """The stored accuracy; files of earlier versions have the error of the motion alone, and the others are not known."""
    if "found_reactions" not in stored:
        not_looked = "not measured by the version that stored this run"
        unknown = {"reactions": not_looked, "mesh": not_looked}
        stored = stored | {"has_mesh": prepared.model.elastic, "unknown": unknown if stored["asked"] is not None else {}}
    return Accuracy(**stored)


def _rank(rank: RankReport) -> dict[str, Any]:
    names = {what: [row.name for row in getattr(rank, what)] for what in _RANK}
    doubtful = [[row.name, size] for row, size in rank.doubtful]
    return names | {"doubtful": doubtful, "degrees_of_freedom": rank.degrees_of_freedom, "smallest": rank.smallest}


def _scene(header: dict[str, Any], known: Known) -> SceneData:
    _check_elements(header["scene"]["statements"], len(header["run"]["names"]))
    scene: SceneData = replay(header["scene"], SceneData, known)
    if scene.problems or not scene.bodies:
        problem = scene.problems[0] if scene.problems else "it has no bodies"
        raise BadValueError(f"the scene in the file cannot be built: {problem}")
    return scene


def _prepared(header: dict[str, Any], scene: SceneData, start: Start) -> Prepared:
    unknowns = header["run"]["names"]
    model, moved = modelled(scene)
    stored_parts.check_laws(header.get("laws", {}), stored_parts.own_laws(model))
    if list(AllBodies(model, moved).numbering.names()) != unknowns[: AllBodies(model, moved).numbering.n]:
        model, moved = modelled(scene, by_rows={c.name: "stored with its rows" for c in scene.joints if c.rigid})
    rows, stored = {row.name: row for row in constraint_rows(model)}, header["rank"]
    named_rows = [*(name for what in _RANK for name in stored[what]), *(name for name, _ in stored["doubtful"])]
    unknown = sorted({*named_rows} - set(rows))
    if unknown:
        raise BadValueError(f"the scene in the file has no constraint {shown(unknown[0])}, which the file's run has")
    if sorted(stored["kept"] + stored["dropped"]) != sorted(rows):
        raise BadValueError("the constraints that the file's run kept and dropped are not those of the scene in the file: it "
                            "was changed or damaged")
    lists: dict[str, Any] = {what: [rows[name] for name in stored[what]] for what in _RANK}
    doubtful = [(rows[name], size) for name, size in stored["doubtful"]]
    rank = RankReport(**lists, doubtful=doubtful, degrees_of_freedom=stored["degrees_of_freedom"], smallest=stored["smallest"])
    all_bodies = AllBodies(model, moved)
    mechanics = mechanics_of(model, rank.kept, all_bodies)
    prepared = Prepared(model, mechanics, rank, start, header["time"], all_bodies)
    _check_unknowns(prepared, unknowns)
    prepared.contacts += expected_contacts(mechanics, start, {}, prepared.time)
    return prepared


def _check_elements(statements: list[Any], unknowns: int) -> None:
    """Refuse a beam with more elements than the run has unknowns before its mesh is made: it could take all memory."""
    for method, args, kwargs in statements:
        given = kwargs.get("elements", 1) if method == "beam" else 1
        for count in given if isinstance(given, list) else [given]:
            if not isinstance(count, int) or count > unknowns:
                name = args[0] if args else kwargs.get("name")
                raise BadValueError(f"the beam {shown(name)} in the file has elements = {shown(count)}, where a whole number of "
                                    f"at most {unknowns}, the number of unknowns of its run, is expected")


def _check_unknowns(prepared: Prepared, names: list[str]) -> None:
    """BadValueError unless the names of the run's unknowns are those of the scene: the unknowns of its motion, then stresses of
    beams where they were unknowns, then multipliers."""
    nb, mechanics, start = prepared.all_bodies.numbering, prepared.mechanics, prepared.start
    stresses = [name for line in prepared.model.lines for name in line.stresses]
    rest = [name for name in names[nb.n :] if name not in set(stresses)]
    multipliers = {f"{block}({row.name})" for block in ("lambda", "mu") for row in mechanics.rows}
    in_order = [*nb.names(), *(stresses if len(rest) < len(names) - nb.n else []), *rest]
    if names != in_order or not multipliers >= {*rest} or len({*rest}) < len(rest):
        raise BadValueError("the unknowns of the file's run are not those of its scene: changed, or written by another mbdae")
    sizes = {"q": prepared.model.nq, "u": prepared.model.nu, "s": len(mechanics.numbering.states),
             "acceleration": prepared.model.nu, "multipliers": len(mechanics.rows)}
    for name, size in sizes.items():
        if getattr(start, name).shape != (size,):
            shape = getattr(start, name).shape
            raise BadValueError(f"the file's start has {name} of shape {shape}, where its scene needs ({size},)")


def _info(info: RunInfo) -> dict[str, Any]:
    parts = {"accuracy": info.accuracy.as_data(), "stats": asdict(info.stats), "warnings": list(info.warnings)}
    return {"solver": _info_of(info.solver), "form": info.form, "runs": info.runs, "cpu_s": info.cpu_s, "choice": info.choice,
            "reliable": info.reliable, "events": [list(event) for event in info.events], **parts}


def _info_of(solver: Any) -> dict[str, Any]:
    """The name of a solver's class and its options."""
    given = [f.name for f in fields(solver) if f.init] if is_dataclass(solver) else []
    return {"class": stored_name(type(solver)), "options": {name: encode(getattr(solver, name)) for name in given}}


def _solver(stored: dict[str, Any], known: Known) -> Any:
    """The solver made from its options, which it checks itself."""
    name = without_module(stored["class"])
    words = (plain(name.rpartition(":")[2]), "")  # the files that have the name alone, then all, those of other packages too
    cls = next((own for word in words for own in solvers(word) if stored_name(own) == name), None) or known.find(name, Solver)
    given = [f.name for f in fields(cls) if f.init] if is_dataclass(cls) else []
    unknown = sorted(set(stored["options"]) - set(given))
    if unknown:
        raise BadValueError(f"the solver {cls.__name__} has no option {shown(unknown[0])}, which the file states")
    options = {}
    for key, value in stored["options"].items():
        several = isinstance(value, list)
        if not all(isinstance(v, int | float | str | None) for v in (value if several else [value])):
            raise BadValueError(f"the solver in the file has {key} = {shown(value)}, where a number, a text or a list of numbers "
                                f"is expected")
        options[key] = np.array(value, dtype=float) if several else value
    return cls(**options)


def _form(label: str, known: Known) -> str:
    """The stored label of a form; BadValueError where it is that of no form of mbdae and of none among the caller's classes."""
    own: list[type[Form]] = [form for form in known.own.values() if isinstance(form, type) and issubclass(form, Form)]
    if label not in {form.label for form in (*forms(), *own)}:
        raise BadValueError(f"the form {shown(label)} of the run's equations is not mbdae's: pass laws=[...] with its class")
    return label


def _dense(interpolant: Interpolant) -> dict[str, Any]:
    if isinstance(interpolant, Collocation):
        return {"kind": "collocation", "stages": len(interpolant.table.c)}
    if isinstance(interpolant, Hermite):
        return {"kind": "hermite", "points": interpolant.points}
    if isinstance(interpolant, Joined):
        return {"kind": "joined", "points": [part.points for part in interpolant.parts],
                "steps": [len(part.t) for part in interpolant.parts]}
    kind = type(interpolant).__name__
    raise OptionError(f"runs of a solver that interpolates between its steps by {kind} cannot be stored; run with mb.IDA, "
                      f"mb.RadauIIA, mb.CVODE or mb.DOP853 to save")


def _arrays(interpolant: Interpolant) -> dict[str, Array]:
    """The arrays of an interpolant in addition to the steps: values inside of the steps, and the values at the end of a step that
    are used before a jump or kink of an input of time."""
    if isinstance(interpolant, Collocation):
        return {"inner": interpolant.inner, "ends": interpolant.ends}
    if isinstance(interpolant, Joined):
        return {f"part_{name}": np.concatenate([getattr(part, name) for part in interpolant.parts]) for name in ("t", "y", "yp")}
    return {}


def _interpolant(stored: dict[str, Any], arrays: dict[str, Array]) -> Interpolant:
    if stored["kind"] == "collocation":
        inner, ends = arrays["inner"], arrays.get("ends")
        return Collocation(radau_table(stored["stages"]), arrays["steps"], arrays["y"], inner, ends)
    if stored["kind"] == "joined":
        cuts = np.cumsum(stored["steps"])[:-1]
        t, y, yp = (np.split(arrays[f"part_{name}"], cuts) for name in ("t", "y", "yp"))
        return Joined([Hermite(t[i], y[i], yp[i], points) for i, points in enumerate(stored["points"])])
    return Hermite(arrays["steps"], arrays["y"], arrays["yp"], stored["points"])


def _check_shapes(header: dict[str, Any], shapes: dict[str, tuple[int, ...]]) -> None:
    """BadValueError unless the arrays are those that the header describes, with their shapes; their numbers are not read yet."""
    dense, n = header["run"]["dense"], len(header["run"]["names"])
    steps = (*shapes.get("steps", ()), 0)[0]
    meant: dict[str, tuple[int | None, ...]] = {f"start_{name}": (None,) for name in _START}
    meant |= {"t": (None,), "steps": (steps,), "y": (steps, n), "yp": (steps, n)}
    if dense["kind"] == "collocation":
        meant |= {"inner": (steps - 1, dense["stages"] - 1, n)}
        meant |= {"ends": (steps - 1, n)} if "ends" in shapes else {}  # files of earlier versions have none
    if dense["kind"] == "joined":
        inside = sum(dense["steps"])
        meant |= {"part_t": (inside,), "part_y": (inside, n), "part_yp": (inside, n)}
    meant |= stored_parts.shapes_of(header, shapes)
    if set(shapes) != set(meant):
        name = min(set(shapes) ^ set(meant))
        raise BadValueError(f"the file {'has an unknown' if name in shapes else 'lacks the'} array {shown(name)}")
    if not steps:
        raise BadValueError("the file's run has no steps")
    for name, shape in shapes.items():
        fits = len(shape) == len(meant[name]) and all(m in (None, k) for m, k in zip(meant[name], shape, strict=True))
        if not fits:
            wanted = str(meant[name]).replace("None", "any")
            raise BadValueError(f"the file's array {name} has shape {shape}, not {wanted}; steps: {steps}, unknowns: {n}")


def _check_times(header: dict[str, Any], arrays: dict[str, Array]) -> None:
    """BadValueError unless the times of the steps rise and the times of the outputs lie between the first and the last."""
    t, steps = arrays["t"], arrays["steps"]
    parts = np.split(arrays["part_t"], np.cumsum(header["run"]["dense"]["steps"])[:-1]) if "part_t" in arrays else []
    if not all(np.all(np.diff(times) > 0) for times in [steps, *parts]):
        raise BadValueError("the times of the steps in the file do not increase: it was changed or damaged")
    if not len(t):
        raise BadValueError("the file has no output times")
    slack = 1e-12 * float(np.max(np.abs(steps[[0, -1]])))
    outside = (t < steps[0] - slack) | (t > steps[-1] + slack)
    if np.any(outside):
        raise BadValueError(f"the file's output time {t[outside][0]:g} s is outside of its run, {steps[0]:g} to {steps[-1]:g} s")
    if abs(header["start"]["t"] - steps[0]) > slack:
        raise BadValueError(f"the start in the file is at {header['start']['t']:g} s, but its run begins at {steps[0]:g} s")
