"""Results on disk: one .npz file without pickle that holds the scene's statements, its start and the run.

A header (JSON) carries the statements and how the run was made, arrays carry the numbers. `load` replays the
statements and restores start, steps and interpolant as they were: nothing is solved again. Own law classes are stored
by name; their module must be importable, and is imported, when the file is loaded.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.errors import OptionError
from mbdae.files import replacing
from mbdae.integrators.dense import Collocation, Hermite, Joined
from mbdae.integrators.radau_tables import radau_table
from mbdae.integrators.solution import Interpolant, Solution, Stats
from mbdae.results.accuracy import Accuracy
from mbdae.results.result import Result, RunInfo
from mbdae.scene.record import encode, found, replay
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.system.contacts import expected_contacts
from mbdae.system.expansion import Expansion
from mbdae.system.numbering import constraint_rows
from mbdae.system.prepare import Prepared, mechanics_of, modelled
from mbdae.system.redundancy import RankReport
from mbdae.system.start import Start

FORMAT, VERSION = "mbdae result", 1
_START = ("q", "u", "s", "acceleration", "multipliers")


def save(result: Result, path: Any) -> None:
    """Write a result to one .npz file."""
    prepared, solution = result.prepared, result.solution
    header = {
        "format": FORMAT, "version": VERSION, "scene": _scene(prepared), "rank": _rank(prepared.rank),
        "start": {"t": prepared.start.t, "changes": prepared.start.changes}, "time": prepared.time, "info": _info(result.info),
        "run": {"names": list(solution.names), "complete": solution.complete, "dense": _dense(solution.interpolant)},
    }  # fmt: skip
    arrays = {f"start_{name}": getattr(prepared.start, name) for name in _START}
    arrays |= {"t": result.t, "steps": solution.t, "y": solution.y, "yp": solution.yp}
    arrays |= _arrays(solution.interpolant)
    with replacing(path) as part, part.open("wb") as file:
        np.savez_compressed(file, header=np.array(json.dumps(header)), **arrays)


def load(path: Any) -> Result:
    """The result stored in a file by `Result.save`."""
    header, arrays = _read(Path(path))
    start = Start(**header["start"], **{name: arrays[f"start_{name}"] for name in _START})  # type: ignore[arg-type]
    prepared = _prepared(header, start)
    prepared.model.conditions.end = float(arrays["steps"][-1])
    run, info = header["run"], header["info"]
    solver = _solver(info["solver"])
    stats = Stats(**info["stats"])
    solution = Solution(arrays["steps"], arrays["y"], arrays["yp"], None, stats, solver, tuple(run["names"]), run["complete"],
                        _interpolant(run["dense"], arrays))  # fmt: skip
    accuracy, warnings = _accuracy(info["accuracy"], prepared), tuple(info["warnings"])
    known = RunInfo(solver, info["form"], accuracy, stats, info["runs"], info["cpu_s"], warnings, info.get("choice", ""),
                    info.get("reliable", True))
    return Result(prepared, solution, known, arrays["t"])


def _accuracy(stored: dict[str, Any], prepared: Prepared) -> Accuracy:
    """What was known of the error; files of versions that looked at the motion alone say so."""
    if "found_reactions" not in stored:
        not_looked = "not measured by the version that stored this run"
        unknown = {"reactions": not_looked, "mesh": not_looked}
        stored = stored | {"has_mesh": bool(prepared.model.lines), "unknown": unknown if stored["asked"] is not None else {}}
    return Accuracy(**stored)


# ---- the scene and its start -----------------------------------------------------------------------------------------


def _scene(prepared: Prepared) -> dict[str, Any]:
    scene = prepared.model.scene
    for law in (law for c in scene.connections for law in c.laws):
        if "<locals>" in type(law).__qualname__:
            raise OptionError(f"'{law.name}': the law class {type(law).__name__} is defined inside a function and could not be "
                              f"found again; define it at the top of a module to save this result")  # fmt: skip
    for method, args, kwargs in scene.statements:
        curve = kwargs.get("curve") if method == "beam" else None
        if curve not in (None, "arc") and not ("class" in curve and "<" not in curve["class"]):
            raise OptionError(f"beam '{[*args, kwargs.get('name')][0]}': its curve is not a function at the top of a module and "
                              f"could not be found again; define it there with def to save this result")  # fmt: skip
    return {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space, "statements": scene.statements}


def _rank(rank: RankReport) -> dict[str, Any]:
    names = {what: [row.name for row in getattr(rank, what)] for what in ("kept", "dropped", "singular_here", "not_unique")}
    doubtful = [[row.name, size] for row, size in rank.doubtful]
    return names | {"doubtful": doubtful, "degrees_of_freedom": rank.degrees_of_freedom, "smallest": rank.smallest}


def _prepared(header: dict[str, Any], start: Start) -> Prepared:
    scene, unknowns = replay(header["scene"], SceneData), header["run"]["names"]
    model, carried = modelled(scene)
    if list(Expansion(model, carried).numbering.names()) != unknowns[: Expansion(model, carried).numbering.n]:
        model, carried = modelled(scene, by_rows={c.name: "stored with its rows" for c in scene.joints if c.rigid})
    rows, stored = {row.name: row for row in constraint_rows(model)}, header["rank"]
    lists = {what: [rows[name] for name in stored[what]] for what in ("kept", "dropped", "singular_here", "not_unique")}
    doubtful = [(rows[name], size) for name, size in stored["doubtful"]]
    rank = RankReport(**lists, doubtful=doubtful, degrees_of_freedom=stored["degrees_of_freedom"], smallest=stored["smallest"])
    expansion = Expansion(model, carried)
    mechanics = mechanics_of(model, rank.kept, expansion)
    contacts = expected_contacts(mechanics, start, {}) if any(c.loose for c in model.scene.joints) else []
    return Prepared(model, mechanics, rank, start, header["time"], expansion, contacts)


# ---- the run -----------------------------------------------------------------------------------------------------------


def _info(info: RunInfo) -> dict[str, Any]:
    given = [f.name for f in fields(info.solver) if f.init] if is_dataclass(info.solver) else []
    options = {name: encode(getattr(info.solver, name)) for name in given}
    cls = type(info.solver)
    solver = {"class": f"{cls.__module__}:{cls.__qualname__}", "options": options}
    parts = {"accuracy": info.accuracy.as_data(), "stats": asdict(info.stats), "warnings": list(info.warnings)}
    return {"solver": solver, "form": info.form, "runs": info.runs, "cpu_s": info.cpu_s, "choice": info.choice,
            "reliable": info.reliable, **parts}  # fmt: skip


def _solver(stored: dict[str, Any]) -> Any:
    options = {name: np.array(value) if isinstance(value, list) else value for name, value in stored["options"].items()}
    return found(stored["class"])(**options)


def _dense(interpolant: Interpolant) -> dict[str, Any]:
    if isinstance(interpolant, Collocation):
        return {"kind": "collocation", "stages": len(interpolant.table.c)}
    if isinstance(interpolant, Hermite):
        return {"kind": "hermite", "points": interpolant.points}
    if isinstance(interpolant, Joined):
        return {"kind": "joined", "points": [part.points for part in interpolant.parts],
                "steps": [len(part.t) for part in interpolant.parts]}  # fmt: skip
    kind = type(interpolant).__name__
    raise OptionError(f"the dense output {kind} of this run cannot be stored; run with mb.IDA, mb.RadauIIA or mb.CVODE to save")


def _arrays(interpolant: Interpolant) -> dict[str, Array]:
    """What an interpolant needs beside the steps: values inside them, and those before a break of an input of time."""
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


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Array]]:
    """Header and arrays of a file; OptionError where it is not a result this version reads."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header = json.loads(str(arrays.pop("header")))
        is_ours = header["format"] == FORMAT
    except FileNotFoundError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        raise OptionError(f"{path} is not a result of mbdae ({error}); give a file written by r.save(path)") from error
    if not is_ours:
        raise OptionError(f"{path} holds {header['format']!r}, not a result of mbdae; give a file written by r.save(path)")
    if header["version"] > VERSION:
        raise OptionError(f"{path} has format version {header['version']}, this mbdae reads up to {VERSION}: update mbdae")
    return header, arrays
