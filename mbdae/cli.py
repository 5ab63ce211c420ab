"""Command line: parse, call, print. Exit 0 where what was asked holds, 1 where it does not, 2 for wrong usage."""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import sys
import traceback
import warnings
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from mbdae.errors import AccuracyWarning, MbdaeError, OptionError

FORMS = ("ggl", "index3", "index1", "ode")
REPORTS = (".html", ".md", ".tex")
SOLVERS = ("ida", "radau2", "radau3", "cvode", "hht", "genalpha")


class UsageError(Exception):
    """The command line, or the file it names, is not as it must be."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    arguments = _parser().parse_args(argv)
    arguments.stdout = sys.stdout  # JSON goes here; whatever FILE itself prints then goes to the error stream
    try:
        with warnings.catch_warnings(), redirect_stdout(sys.stderr if arguments.json else sys.stdout):
            warnings.simplefilter("ignore", AccuracyWarning)  # told below, once, as part of the result
            return int(arguments.command(arguments))
    except (UsageError, OptionError) as error:
        return _complain(error, 2)
    except MbdaeError as error:
        return _complain(error, 1)
    except KeyboardInterrupt as stop:
        return _complain(RuntimeError(f"interrupted{f': {stop}' if str(stop) else ''}"), 1)


def _complain(error: Exception, code: int) -> int:
    print(f"mbdae: {error}", file=sys.stderr)
    return code


# -- commands


def check(a: argparse.Namespace) -> int:
    """Say what the scene is before solving."""
    found = _scene(_load(a.file), a.file).check()
    if not a.json:
        print(found)
        return 0
    start = found.prepared.start
    _json(a, {"scene": found.prepared.model.scene.name, "planar": found.planar, "degrees_of_freedom": found.degrees_of_freedom,
           "unknowns": found.unknowns, "redundant": list(found.redundant), "pruned": list(found.pruned),
           "start_changes": [str(change) for change in start.changes]})  # fmt: skip
    return 0


def run(a: argparse.Namespace) -> int:
    """Simulate; 1 where the accuracy asked for is not met."""
    module = _load(a.file)
    t_end, measure, out = _t_end(a, module), getattr(module, "measure", None), _folder(a.out)
    r = _scene(module, a.file).simulate(t_end, accuracy=a.accuracy, solver=_solver(a.solver), form=_form(a.form), progress=True)
    written = _write_result(r, measure, out, Path(a.file).stem) if out else []
    final = np.asarray(r.read(measure))[-1].tolist() if measure else None
    if a.json:
        _json(a, _summary(r, measure, final, written))
    else:
        print(repr(r))
        if r.info.choice:
            print(f"solver chosen: {r.info.choice}")
        if measure:
            print(f"{measure} at t = {r.t[-1]:g} s: {final}")
        print(f"largest constraint violation {np.max(r.drift.position, initial=0.0):.1e}, "
              f"largest energy balance error {np.max(np.abs(r.energy.balance)):.1e} J")  # fmt: skip
        for joint, c in r.contacts.items():
            print(f"'{joint}': {c['contacts']:.0f} contacts, the first at t = {c['first']:.6g} s; penetration up to "
                  f"{c['deepest']:.2g} m, play {c['play']:.2g} m; force times sliding distance {c['wear']:.3g} J")  # fmt: skip
        _list(written)
    for warning in r.warnings:
        print(f"mbdae: warning: {warning}", file=sys.stderr)
    return 1 if r.accuracy.met is False or not r.complete or not r.reliable else 0


def compare(a: argparse.Namespace) -> int:
    """Solvers side by side; 1 where a run failed, an accuracy was reached by none, or the reference is not confirmed."""
    from mbdae.compare.command import compare_file

    module = _load(a.file)
    t_end, out = _t_end(a, module), _folder(a.out)
    w = compare_file(module, _scene(module, a.file), t_end, accuracies=a.accuracies, resume=a.resume)
    _tell(a, w, {".png": w.plot, ".svg": w.plot, ".json": w.to_json, ".html": w.to_html}, out, "work_precision")
    reached = all(w.cheapest(accuracy) is not None for accuracy in w.accuracies)
    return 0 if reached and not w.failures and w.reference.trusted else 1


def extremes(a: argparse.Namespace) -> int:
    """Every way at the extremes of what FILE varies; 1 where a run was silently wrong."""
    from mbdae.compare.command import map_of_file

    module = _load(a.file)
    t_end, out = _t_end(a, module), _folder(a.out)
    _scene(module, a.file)
    m = map_of_file(module, t_end, accuracy=a.accuracy, max_wall=a.max_wall, resume=a.resume)
    _tell(a, m, {".json": m.to_json, ".html": m.to_html}, out, "extremes")
    return 1 if m.silent else 0


def report(a: argparse.Namespace) -> int:
    """A report of a law, of a joint model or of a scene; 1 where one of its checks does not hold. An audit of formulas."""
    if a.what == "paper" or a.what.endswith(".audit"):
        return _report_audit(a)
    from mbdae.reports.report import names
    from mbdae.reports.report import report as make

    if a.what in names():
        document = make(a.what)
    elif Path(a.what).suffix or Path(a.what).is_file():
        document = make(_scene(_load(a.what), a.what))
    else:
        raise UsageError(f"report '{a.what}': neither a file nor one of paper, {', '.join(names())}")
    holds = "NOT EQUAL" not in document.to_markdown()
    ending = Path(a.out).suffix if a.out else ".md"
    format_ = a.format or (ending[1:] if ending in REPORTS else "html")
    text = {"html": document.to_html, "md": document.to_markdown, "tex": document.to_latex}[format_]
    if a.out is None:
        if a.json:
            _json(a, {"report": a.what, "title": document.title, "holds": holds, "format": format_, "text": text()})
        else:
            print(text())
        return 0 if holds else 1
    path = Path(a.out)
    if path.suffix not in REPORTS:
        path = path / f"{Path(a.what).stem}.{format_}"
    elif path.suffix != f".{format_}":
        raise UsageError(f"--out {a.out}: the ending says {path.suffix}, --format {format_}; give one of the two")
    _folder(str(path.parent))
    document.save(path)
    if a.json:
        _json(a, {"report": a.what, "title": document.title, "holds": holds, "format": format_, "written": [str(path)]})
    else:
        _list([str(path)])
    return 0 if holds else 1


def validate(a: argparse.Namespace) -> int:
    """Measure the claims of a checkout; 1 where one does not hold."""
    from mbdae import validation
    from mbdae.run.progress import bar

    folder, shown = validation.find(a.root), bar()
    checks = [validation.load(folder, name) for name in dict.fromkeys(a.claims or validation.claims(folder))]
    out, measured = _folder(a.out), []
    try:
        for i, found in enumerate(checks):
            shown.show(i / len(checks), "validate", found.claim.name)
            measured.append(validation.Measured(found.claim, found.run()))
            shown.close()
            if not a.json:
                print(validation.text(measured[-1]), flush=True)
    finally:
        shown.close()
    written = [str(path) for path in validation.write(measured, out)] if out else []
    if a.json:
        _json(a, validation.to_dict(measured) | {"written": written})
    else:
        print(validation.verdict(measured))
        _list(written)
    return 0 if all(m.holds for m in measured) else 1


# -- what commands share


def _summary(r: Any, measure: str | None, final: Any, written: list[str]) -> dict[str, Any]:
    s = r.stats
    return {
        "scene": r.prepared.model.scene.name, "t_end": float(r.t[-1]), "complete": r.complete, "solver": r.info.solver.label,
        "form": r.info.form, "rtol": r.info.solver.rtol, "choice": r.info.choice,
        "accuracy": {"asked": r.accuracy.asked, "estimated": r.accuracy.estimated, "covers": sorted(r.accuracy.covers),
                     "not_covered": r.accuracy.not_covered}, "measure": measure,
        "final": final, "cpu_s": r.info.cpu_s, "steps": s.steps, "rejected": s.rejected,
        "residuals": s.residuals, "jacobians": s.jacobians, "factorisations": s.factorisations,
        "drift": float(np.max(r.drift.position, initial=0.0)), "energy_balance_J": float(np.max(np.abs(r.energy.balance))),
        "reliable": r.reliable, "contacts": {joint: {k: v if math.isfinite(v) else None for k, v in c.items()}
                                             for joint, c in r.contacts.items()},
        "warnings": list(r.warnings), "written": written,
    }  # fmt: skip


def _report_audit(a: argparse.Namespace) -> int:
    """Verdicts on published formulas; 0 whatever they are."""
    from mbdae.reports.audit.command import report_audit

    if a.what != "paper" and not Path(a.what).is_file():
        raise UsageError(f"there is no file '{a.what}'; give a file of printed formulas, or paper")
    found, text, written = report_audit(a.what, a.format, a.out)
    if a.json:
        _json(a, found.to_dict() | ({"written": [written]} if written else {}))
    else:
        print(text)
        _list([written] if written else [])
    return 0


def _write_result(r: Any, measure: str | None, out: Path, stem: str) -> list[str]:
    written = [out / f"{stem}.npz"]
    r.save(written[0])
    if measure:
        written.append(out / f"{stem}.png")
        r.plot(measure, path=written[1])
    return [str(path) for path in written]


def _tell(a: argparse.Namespace, found: Any, writers: dict[str, Any], out: Path | None, name: str) -> None:
    """Write what has a folder, and print the table or the JSON."""
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


def _load(file: str) -> ModuleType:
    """The user's file as a module; it may import its neighbours."""
    path = Path(file).resolve()
    if not path.is_file():
        raise UsageError(f"there is no file '{file}'; give a Python file with a function scene()")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise UsageError(f"'{file}' is not a Python file (.py)")
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent))
    sys.modules[path.stem] = module
    try:
        spec.loader.exec_module(module)
    except MbdaeError:
        raise
    except Exception as error:
        raise UsageError(f"'{file}' cannot be read: {_where(error)}") from error
    finally:
        sys.path.remove(str(path.parent))
    if not callable(getattr(module, "scene", None)):
        raise UsageError(f"'{file}' has no function scene(); add one that returns a mb.Scene:\n\n"
                         "    def scene():\n        s = mb.Scene('name')\n        ...\n        return s\n")  # fmt: skip
    return module


def _scene(module: ModuleType, file: str) -> Any:
    """The scene FILE states; a mistake in its code is told with its line, without the way there."""
    from mbdae.api import Scene

    try:
        scene = module.scene()
    except MbdaeError:
        raise
    except Exception as error:
        raise UsageError(f"scene() of '{file}' fails: {_where(error)}") from error
    if not isinstance(scene, Scene):
        raise UsageError(f"scene() of '{file}' returns {type(scene).__name__}, not a mb.Scene; end it with `return s`")
    return scene


def _where(error: Exception) -> str:
    line = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} (line {line.lineno} of {Path(line.filename).name})"


def _t_end(a: argparse.Namespace, module: ModuleType) -> float:
    value = a.t_end if a.t_end is not None else getattr(module, "t_end", None)
    if value is None:
        raise UsageError(f"the end time is unknown: give --t-end T in s, or set t_end in '{a.file}'")
    return float(value)


def _folder(out: str | None) -> Path | None:
    if out is None:
        return None
    path = Path(out)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {out}: cannot be made a folder: {error}") from error
    return path


def _solver(name: str | None) -> Any:
    from mbdae.integrators.cvode import CVODE
    from mbdae.integrators.generalized_alpha import HHT, GeneralizedAlpha
    from mbdae.integrators.ida import IDA
    from mbdae.integrators.radau import RadauIIA

    makers: dict[str, Callable[[], Any]] = {
        "ida": IDA, "radau2": lambda: RadauIIA(2), "radau3": lambda: RadauIIA(3), "cvode": CVODE,
        "hht": HHT, "genalpha": GeneralizedAlpha
    }  # fmt: skip
    return makers[name]() if name else None


def _form(name: str | None) -> Any:
    from mbdae.formulations import GGL, ODE, Index1, Index3

    return {"ggl": GGL, "index3": Index3, "index1": Index1, "ode": ODE}[name]() if name else None


# -- the parser


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="mbdae", description="Multibody dynamics: check, run and compare a scene.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _command(commands, "check", check, "say what a scene is before solving it")
    p = _command(commands, "run", run, "simulate a scene with controlled accuracy")
    p.add_argument("--solver", choices=SOLVERS, help="default: chosen for the scene")
    p.add_argument("--form", choices=FORMS, help="default: chosen for the scene")
    p.add_argument("--accuracy", type=float, default=1e-6, help="bound of the error over the run (default 1e-6)")
    _common(p, "folder for the result (.npz) and a picture of `measure`")
    p = _command(commands, "compare", compare, "solvers side by side against a confirmed reference")
    p.add_argument("--accuracies", type=_numbers, help="comma separated (default 1e-3,1e-4,1e-5,1e-6)")
    resumed = "file that keeps every finished run; a comparison that was stopped goes on from there"
    p.add_argument("--resume", metavar="FILE.json", help=resumed)
    _common(p, "folder for the work-precision picture (.png, .svg), its data (.json) and a page with both (.html)")
    p = _command(commands, "extremes", extremes, "every way of running a scene at the extremes of its parameters")
    p.add_argument("--accuracy", type=float, help="bound of the error over the run (default: that of FILE, else 1e-5)")
    p.add_argument("--max-wall", type=float, metavar="S", help="wall time of a run in s (default 20)")
    p.add_argument("--resume", metavar="FILE.json", help="file that keeps every finished value of the map")
    _common(p, "folder for the page (.html) and its data (.json)")
    _report(commands)
    _validate(commands)
    return parser


def _report(commands: Any) -> None:
    text = "derivation of a law with its checks, the sheet of a scene, or an audit of published formulas"
    p = commands.add_parser("report", help=text, description=text[0].upper() + text[1:] + ".")
    what = ("revolute, classical, kinematic, recursive, clearance, coulomb, lugre, beam or any other law; paper: its formulas "
            "audited; a Python file with scene(); a file of formulas (.audit)")  # fmt: skip
    formats = [ending[1:] for ending in REPORTS]
    p.add_argument("what", metavar="NAME|paper|FILE", help=what)
    p.add_argument("--format", choices=formats, help="default: that of --out, else md (of an audit a table)")
    p.add_argument("--out", metavar="PATH", help="file (.html, .md, .tex) or folder; without it the text is printed")
    p.add_argument("--json", action="store_true", help="standard output carries JSON alone")
    p.set_defaults(command=report)


def _validate(commands: Any) -> None:
    text = "measure the claims of validation/ against their references"
    p = commands.add_parser("validate", help=text, description=text[0].upper() + text[1:] + ".")
    p.add_argument("claims", nargs="*", metavar="CLAIM", help="name of a folder of validation/ (default: all)")
    p.add_argument("--root", metavar="DIR", help="the checkout (default: the working directory or one above it)")
    p.add_argument("--json", action="store_true", help="standard output carries JSON alone")
    p.add_argument("--out", metavar="DIR", help="folder for validation.html and validation.md; nothing is written without it")
    p.set_defaults(command=validate)


def _command(commands: Any, name: str, action: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
    what = "Python file with scene(); optional t_end, measure (a sensor, 'C.angle'), runs, vary"
    p.add_argument("file", metavar="FILE", help=what)
    p.add_argument("--json", action="store_true", help="standard output carries JSON alone")
    p.set_defaults(command=action)
    return p


def _common(p: argparse.ArgumentParser, out: str) -> None:
    p.add_argument("--t-end", type=float, metavar="T", help="end time in s (default: t_end of FILE)")
    p.add_argument("--out", metavar="DIR", help=out + "; nothing is written without it")


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}': give numbers separated by commas, such as 1e-3,1e-6") from None
