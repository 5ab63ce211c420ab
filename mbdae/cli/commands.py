"""The commands. Each returns the exit code: 0 where what was asked holds, 1 where it does not."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

from mbdae.cli.streams import REPORTS, UsageError
from mbdae.cli.userfile import arena_of, compare_file, map_of_file, scene_of, user_file
from mbdae.errors import MbdaeError, OptionError, SolverError, meant

# -- commands


def check(a: argparse.Namespace) -> int:
    """Print what `check()` finds in the scene, without solving it."""
    found = _scene(a, _load(a)).check()
    if not a.json:
        print(found)
        return 0
    start = found.prepared.start
    _json(a, {"scene": found.prepared.model.scene.name, "planar": found.planar, "degrees_of_freedom": found.degrees_of_freedom,
           "unknowns": found.unknowns, "redundant": list(found.redundant), "pruned": list(found.pruned),
           "start_changes": [str(change) for change in start.changes]})
    return 0


def run(a: argparse.Namespace) -> int:
    """Simulate the scene; 1 where the accuracy asked for is not met."""
    from mbdae.run.checkpoint import bar

    out, module = _folder(a.out), _load(a)
    t_end, scene = _t_end(a, module), _scene(a, module)
    measure = _measure(a, module, scene)
    accuracy = getattr(module, "accuracy", 1e-6) if a.accuracy is None else a.accuracy
    options = {"accuracy": accuracy, "solver": a.solver, "form": a.form}
    with closing(bar()) as shown, _partial_kept(a, out, t_end):
        r = scene.simulate(t_end, **options, progress=shown)
    try:
        # write the result and a plot of the measure to the folder, if given; returns the last value of the measure
        if out is not None:
            stem = Path(a.file).stem
            r.save(out / f"{stem}.npz")
            a.written.append(str(out / f"{stem}.npz"))
            if measure:
                r.plot(measure, path=out / f"{stem}.png")
                a.written.append(str(out / f"{stem}.png"))
        final = r.read(measure)[-1].tolist() if measure else None
    except OptionError:  # nothing could be written: print the result before the error
        if not a.json:
            print(repr(r))
        raise
    if a.json:
        _json(a, _summary(r, measure, final, a.written))
    else:
        print(repr(r))
        if r.info.choice:
            print(f"solver chosen: {r.info.choice}")
        if measure:
            print(f"{measure} at t = {r.t[-1]:g} s: {final}")
        print(f"largest constraint violation {r.drift.position.max(initial=0.0):.1e}, "
              f"largest energy balance error {abs(r.energy.balance).max():.1e} J")
        for joint, c in r.contacts.items():
            loose = f" m, play {c['play']:.2g} m; normal force times sliding distance {c['wear']:.3g} J" if "play" in c else ""
            print(f"'{joint}': {c['contacts']:.0f} contacts, the first at t = {c['first']:.6g} s; penetration up to "
                  f"{c['deepest']:.2g}{loose or ' (m or rad) past its limits'}")
        _list(a.written)
    for warning in r.warnings:
        print(f"mbdae: warning: {warning}", file=sys.stderr)
    return 1 if r.reliable is False else 0


def compare(a: argparse.Namespace) -> int:
    """Compare solvers; 1 where a run failed, an accuracy was reached by none, or the reference is not confirmed."""
    out, module = _folder(a.out), _load(a)
    t_end, scene = _t_end(a, module), _scene(a, module)
    w = compare_file(module, scene, t_end, accuracies=a.accuracies, resume=_resume(a), engines=a.engines)
    _write_and_print(a, w, {".png": w.plot, ".svg": w.plot, ".json": w.to_json, ".html": w.to_html}, out, "work_precision")
    reached = all(w.cheapest(accuracy) is not None for accuracy in w.accuracies)
    failed = any(not row.engine for row in w.failures)
    return 0 if reached and not failed and w.reference.trusted else 1


def arena(a: argparse.Namespace) -> int:
    """Compare many scenes by several programs; 1 where one could not be compared."""
    out = _folder(a.out)
    found = arena_of(a, out / "kept" if out else None)
    _json(a, found.to_dict()) if a.json else print(found.table())
    if out:
        found.save(out)
    return 1 if any(entry.error for entry in found.entries) else 0


def extremes(a: argparse.Namespace) -> int:
    """Run every joint model, form and solver at the extreme values in `vary` of FILE; 1 where a run was silently wrong."""
    out, module = _folder(a.out), _load(a)
    t_end = _t_end(a, module)
    _scene(a, module)
    m = map_of_file(module, t_end, accuracy=a.accuracy, max_wall=a.max_wall, resume=_resume(a), budget=a.budget)
    _write_and_print(a, m, {".json": m.to_json, ".html": m.to_html}, out, "extremes")
    return 1 if m.silent else 0


def report(a: argparse.Namespace) -> int:
    """Report of a law, joint model or scene, 1 where a check in it fails; audit of a file of formulas, 1 unless all are right."""
    if Path(a.what).suffix == ".audit":
        return audit(a)
    from mbdae.reports import names
    from mbdae.reports import report as make

    if a.what in names():
        document = make(a.what)
    elif Path(a.what).suffix or _is_file(a.what):
        a.file = a.what
        document = make(_scene(a, _load(a)))
    else:
        closest = f"; {meant(a.what, names())}".rstrip("; ")
        raise UsageError(f"report '{a.what}': this is neither a file nor one of {', '.join(names())}{closest}")
    holds = "NOT EQUAL" not in document.to_markdown()
    format_ = _report_format(a, "md")
    facts = {"report": a.what, "title": document.title, "holds": holds, "format": format_}
    path = _saved(a, document, format_)
    text = "" if path else _report_text(document, format_)
    if a.json:
        _json(a, facts | ({"written": [path]} if path else {"text": text}))
    else:
        print(f"wrote {path}" if path else text)
    return 0 if holds else 1


def validate(a: argparse.Namespace) -> int:
    """Measure the claims of a checkout; 1 where one does not hold."""
    from mbdae.cli.userfile import find, runner_of

    out, folder = _folder(a.out), find(a.root)
    runner = runner_of(folder)
    names = tuple(dict.fromkeys(a.claims or runner.claims(folder)))
    if a.list:
        record = runner.Record(folder)
        _json(a, record.results) if a.json else print(record.text(names))
        return 0
    asked = runner.Asked(folder, names, a.seed, a.full, tuple(a.parts), a.jobs, a.hours, out, a.full or a.record)
    measured = runner.measured(asked, (lambda text: None) if a.json else partial(print, flush=True))
    a.written += [str(path) for path in runner.write(measured, out)] if out else []
    if a.json:
        _json(a, runner.to_dict(measured) | {"drawn": asked.text, "written": a.written})
    else:
        print(runner.verdict(measured))
        _list(a.written)
    return 0 if all(m.holds for m in measured) else 1


# -- helpers of the commands


def _load(a: argparse.Namespace) -> ModuleType:
    """FILE as a module for as long as the command works."""
    module: ModuleType = a.stack.enter_context(user_file(a.file))
    return module


def _scene(a: argparse.Namespace, module: ModuleType) -> Any:
    return scene_of(module, a.file)


@contextmanager
def _partial_kept(a: argparse.Namespace, out: Path | None, t_end: float) -> Iterator[None]:
    """Where a run is stopped or fails, save the part that was computed, and add to the error where it is."""
    try:
        yield
    except (SolverError, KeyboardInterrupt) as error:
        r: Any = getattr(error, "solution", None)
        if r is None:
            raise
        until = float(r.solution.t[-1])
        what = "the whole run, its error not known," if r.complete else f"what was computed until t = {until:.6g} s"
        kept = f"{what} is lost; with --out DIR it would be kept"
        if out is not None:
            kept = f"{what} is {_saved_partly(a, r, out / f'{Path(a.file).stem}.npz')}"
        if isinstance(error, KeyboardInterrupt):
            where = "while its error was measured" if r.complete else f"at t = {until:.6g} of {t_end:.6g} s"
            error.args = (f"interrupted {where}: {kept}",)
        else:
            print(f"mbdae: {kept}", file=sys.stderr)
        raise


def _saved_partly(a: argparse.Namespace, r: Any, path: Path) -> str:
    """Save a part of a run, and say before that this is done: it may take some seconds. Returns what became of it, in words."""
    print(f"mbdae: saving what was computed in {path} (Ctrl-C again ends without)", file=sys.stderr, flush=True)
    try:
        r.save(path)
    except KeyboardInterrupt:
        return "lost, since saving it was interrupted too"
    except OptionError as error:
        return f"lost: {error}"
    a.written.append(str(path))
    return f"in {path}"


def _summary(r: Any, measure: str | None, final: Any, written: list[str]) -> dict[str, Any]:
    s = r.stats
    return {
        "scene": r.prepared.model.scene.name, "t_end": float(r.t[-1]), "complete": r.complete, "solver": r.info.solver.label,
        "form": r.info.form, "rtol": r.info.solver.rtol, "choice": r.info.choice,
        "accuracy": {"asked": r.accuracy.asked, "estimated": r.accuracy.estimated, "covers": sorted(r.accuracy.covers),
                     "not_covered": r.accuracy.not_covered}, "measure": measure,
        "final": final, "cpu_s": r.info.cpu_s, "steps": s.steps, "rejected": s.rejected,
        "residuals": s.residuals, "jacobians": s.jacobians, "factorisations": s.factorisations,
        "drift": float(r.drift.position.max(initial=0.0)), "energy_balance_J": float(abs(r.energy.balance).max()),
        "reliable": r.reliable, "contacts": {joint: {k: v if math.isfinite(v) else None for k, v in c.items()}
                                             for joint, c in r.contacts.items()},
        "warnings": list(r.warnings), "written": written,
    }


def audit(a: argparse.Namespace) -> int:
    """Audit a paper, or a file of formulas and claimed numbers; 1 unless all are right."""
    from mbdae.audit import audit as audited

    if not _is_file(a.what):
        raise UsageError(f"there is no file '{a.what}'; give an .audit file, with printed formulas and their claimed numbers, "
                         f"or a paper (.tex, .md)")
    table = getattr(a, "meanings", None)
    found = audited(Path(a.what), meanings=table) if table else audited(Path(a.what))
    path = _saved(a, found.document(), _report_format(a, "html"))
    if a.json:
        _json(a, found.to_dict() | ({"written": [path]} if path else {}))
    else:
        print(_report_text(found.document(), a.format) if a.format and not path else found.table())
        _list([path] if path else [])
    return 0 if found.holds else 1


def _report_format(a: argparse.Namespace, printed: str) -> str:
    """The format of --format, or of the suffix of --out; else html for a folder, and `printed` for the terminal."""
    ending = Path(a.out).suffix if a.out else ""
    return str(a.format or (ending[1:] if ending in REPORTS else "html" if a.out else printed))


def _report_text(document: Any, format_: str) -> str:
    return str({"html": document.to_html, "md": document.to_markdown, "tex": document.to_latex}[format_]())


def _saved(a: argparse.Namespace, document: Any, format_: str) -> str | None:
    """Write a document where --out names a place; returns the name of its file, else None."""
    return None if a.out is None else str(document.save(_report_path(a, format_)))


def _write_and_print(a: argparse.Namespace, found: Any, writers: dict[str, Any], out: Path | None, name: str) -> None:
    """Write the files to the folder, if given, and print the table or the JSON."""
    stem = f"{Path(a.file).stem}_{name}"
    for ending, write in writers.items() if out else ():
        write(out / (stem + ending))  # type: ignore[operator]
    if a.json:
        _json(a, found.to_dict())
    else:
        print(found.table())
        _list([str(out / (stem + ending)) for ending in writers] if out else [])


def _list(written: Sequence[str]) -> None:
    for path in written:
        print(f"wrote {path}")


def _json(a: argparse.Namespace, data: dict[str, Any]) -> None:
    print(json.dumps(data, indent=1, allow_nan=False), file=a.stdout)


def _t_end(a: argparse.Namespace, module: ModuleType) -> float:
    from mbdae.values import number, option

    if a.t_end is not None:
        return float(a.t_end)
    value = getattr(module, "t_end", None)
    if value is None:
        raise UsageError(f"the end time is unknown: give --t-end T in s, or set t_end in '{a.file}'")
    return option(f"t_end of '{a.file}'", value, number, "give the end time in s", above=0.0)


def _measure(a: argparse.Namespace, module: ModuleType, scene: Any) -> str | None:
    """The sensor named by `measure` in FILE; one of an item that is not in the scene is refused before the run."""
    from mbdae.scene.sensed import placed, split

    measure = getattr(module, "measure", None)
    if measure is None:
        return None
    if not (isinstance(measure, str) and all(split(measure))):
        raise UsageError(f"measure = {measure!r} in '{a.file}' is no sensor: give item.quantity, such as \"C.angle\"")
    try:
        placed(scene, split(measure)[0])
    except MbdaeError as error:
        raise UsageError(f"measure = {measure!r} in '{a.file}': {error}") from None
    return measure


def _folder(out: str | None) -> Path | None:
    if out is None:
        return None
    path = Path(out)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise UsageError(f"--out {out}: that is a file; give a folder") from None
    except OSError as error:
        raise UsageError(f"--out {out}: cannot be made a folder: {error.strerror}; give another one") from None
    if not os.access(path, os.W_OK | os.X_OK):
        raise UsageError(f"--out {out}: nothing may be written there; give another folder")
    return path


def _report_path(a: argparse.Namespace, format_: str) -> Path:
    """Path of the file of a report, in a folder that is made where it is missing."""
    path = Path(a.out)
    if path.suffix not in REPORTS:
        _folder(a.out)
        return path / f"{Path(a.what).stem}.{format_}"
    if a.format is not None and path.suffix != f".{a.format}":
        raise UsageError(f"--out {a.out}: its ending says {path.suffix}, and --format says {a.format}; give one of the two")
    if path.is_dir():
        raise UsageError(f"--out {a.out}: that is a folder; give a file, or a folder whose name does not end in {path.suffix}")
    _folder(str(path.parent))
    return path


def _resume(a: argparse.Namespace) -> str | None:
    """The file name given to --resume; UsageError where the system does not accept it."""
    try:
        Path(a.resume or ".").exists()
    except OSError as error:
        raise UsageError(f"--resume {a.resume}: the system refuses this file name ({error.strerror}); give another") from None
    return a.resume  # type: ignore[no-any-return]


def _is_file(name: str) -> bool:
    """Whether there is a file of this name; False for a name that the system refuses."""
    try:
        return Path(name).is_file()
    except (OSError, ValueError):
        return False
