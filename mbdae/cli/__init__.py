"""Command line: `main` parses the words, runs a command and turns any error that ends it into one message and an exit code.

Exit codes: 0 where what was asked holds, 1 where it does not, 2 for wrong usage and for mistakes in FILE; 130 after Ctrl-C, 143
after SIGTERM (128 plus the number of the signal); 141 where the reader of the output has closed it.

Parser of the command line: commands, their options, and the values that each takes.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import sys
import time
import traceback
import warnings
from argparse import Namespace
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from mbdae.cli.streams import READER_GONE, REPORTS, OutputLostError, Stops, UsageError, json_alone, usable_streams
from mbdae.errors import AccuracyWarning, MbdaeError, OptionError, unknown_name

SIGINT = 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code. Words that the parser refuses raise SystemExit(2), as usual with argparse."""
    words = [str(word) for word in (sys.argv[1:] if argv is None else argv)]
    try:
        with usable_streams():
            return _parsed_and_run(words)
    except OutputLostError as error:
        if error.reader_gone:
            return READER_GONE
        print(f"mbdae: {error}", file=sys.stderr)
        return 1


def _parsed_and_run(words: list[str]) -> int:
    with Stops() as stops:
        a = Namespace(json="--json" in words, debug="--debug" in words, file=None, written=[], stdout=sys.stdout)
        try:
            make_parser().parse_args(words, a)
            with json_alone(a), contextlib.ExitStack() as a.stack, warnings.catch_warnings():
                warnings.simplefilter("ignore", AccuracyWarning)  # the printed result contains these warnings
                return int(a.command(a))
        except UsageError as error:
            _complain(a, error, 2, usage=error.usage)
            if error.usage:
                raise SystemExit(2) from None
            return 2
        except KeyboardInterrupt as stop:
            name = "" if stops.number == SIGINT else f"{stops.name}: "
            said = (str(stop) or "interrupted").replace("resume=FILE", "--resume FILE")
            return _complain(a, stop, 128 + stops.number, f"{name}{said}")
        except OutputLostError:
            raise
        except Exception as error:
            return _complain(a, error, *_judged(a, error))


def _judged(a: Namespace, error: Exception) -> tuple[int, str]:
    """Exit code and message for an error."""
    from mbdae.cli.userfile import place_in

    place = place_in(error, a.file)
    if isinstance(error, MbdaeError):
        return (2 if isinstance(error, OptionError) else 1), f"{error}{f' ({place})' if place else ''}"
    if place:
        return 2, f"'{a.file}' fails: {type(error).__name__}: {error} ({place})"
    if isinstance(error, OSError) and error.strerror:
        return 1, f"{f'{error.filename}: ' if error.filename is not None else ''}{error.strerror}"
    if isinstance(error, MemoryError):
        return 1, "the memory of this machine is used up; ask for a shorter run or a looser accuracy"
    line = traceback.extract_tb(error.__traceback__)[-1]
    return 1, (f"this is an error in mbdae, {type(error).__name__}: {error} (line {line.lineno} of {line.filename}); "
               f"please report it with your file and what the option --debug prints")


def _complain(a: Namespace, error: BaseException, code: int, text: str | None = None, usage: str = "") -> int:
    """Print an error message on the error stream; with --json also as the JSON that replaces the result."""
    import json

    if a.debug:
        traceback.print_exception(error)
    said = str(error) if text is None else text
    print(f"{usage}mbdae: {said}", file=sys.stderr)
    if a.json:
        with contextlib.suppress(OutputLostError):
            print(json.dumps({"error": said, "exit_code": code, "written": a.written}, indent=1), file=a.stdout, flush=True)
    return code


# -- The command `mbdae cache`, and the words of all


def cache(a: argparse.Namespace) -> int:
    """Print where derived and compiled laws are stored on disk and how much there is, or remove all of it."""
    from mbdae.disk import store

    kept = store()
    removed = kept.clear() if a.what == "clear" else None
    found = kept.content()
    if a.json:
        data = {"path": str(kept.folder) if kept.folder else None, "used": kept.used, "why_not": kept.why or None,
                "limit": kept.limit, "files": found.entries, "bytes": found.size, "hits": found.hits, "misses": found.misses,
                "removed": removed}
        print(json.dumps(data, indent=1), file=a.stdout)
        return 0
    print(f"{kept.folder or 'nothing is kept on disk'}{'' if kept.used else f', not used: {kept.why}'}")
    if removed is not None:
        print(f"{removed} files removed")
    if kept.used:
        print(f"{found.entries} files, {found.size / 1e6:.1f} MB of at most {kept.limit / 1e6:.0f} MB; "
              f"{found.hits} hits, {found.misses} misses")
    return 0


class _Parser(argparse.ArgumentParser):
    """Parser that accepts no abbreviated options and raises UsageError for wrong ones."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, **options)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As in argparse, but `--option=--` is refused, which argparse would read as an option without a value; and an unknown
        option is refused by the command that was given it."""
        for word in args or ():
            if word == "--":
                break
            if word.startswith("--") and word.endswith("=--"):
                self.error(f"argument {word[:-3]}: '--' is no value of it")
        found, left = super().parse_known_args(args, namespace)
        for word in (word.partition("=")[0] for word in left if word.startswith("--")):
            self.error(f"unknown option {unknown_name(word, self._option_string_actions)} {self.prog} --help lists the options")
        return found, left

    def error(self, message: str) -> NoReturn:
        raise UsageError(message, self.format_usage())


def make_parser() -> argparse.ArgumentParser:
    """The parser; its result has the function of the command as `command`."""
    from mbdae import __version__
    from mbdae.cli import commands as do

    parser = _Parser(prog="mbdae", description="Multibody dynamics: check, run and compare a scene.")
    parser.add_argument("--version", action="version", version=f"mbdae {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _command(commands, "check", do.check, "say what a scene is before solving it")
    p = _command(commands, "run", do.run, "simulate a scene with controlled accuracy")
    p.add_argument("--solver", metavar="NAME", help="as in simulate: ida, cvode, radau3, hht, ...; default: chosen for the scene")
    p.add_argument("--form", metavar="NAME", help="as in simulate: ggl, index1, index3, ode; default: chosen for the scene")
    p.add_argument("--accuracy", type=_positive, help="bound of the error over the run (default: that of FILE, else 1e-6)")
    _common(p, "folder for the result (.npz) and a picture of `measure`; a run that is stopped leaves what it computed there")
    p = _command(commands, "compare", do.compare, "solvers side by side against a confirmed reference")
    p.add_argument("--accuracies", type=_accuracies, help="comma separated (default 1e-3,1e-4,1e-5,1e-6)")
    resumed = "file that keeps every finished run; a comparison that was stopped goes on from there"
    p.add_argument("--resume", type=_name, metavar="FILE.json", help=resumed)
    p.add_argument("--engines", type=_engines, metavar="NAME[=PYTHON],...", help=ENGINES)
    _common(p, "folder for the work-precision picture (.png, .svg), its data (.json) and a page with both (.html)")
    p = _command(commands, "extremes", do.extremes, "all joint models, forms and solvers at extreme parameters")
    p.add_argument("--accuracy", type=_positive, help="bound of the error over the run (default: that of FILE, else 1e-5)")
    p.add_argument("--max-wall", type=_positive, metavar="S", help="wall time of a run in s (default 20)")
    p.add_argument("--resume", type=_name, metavar="FILE.json", help="file that keeps every finished value of the map")
    p.add_argument("--budget", type=_positive, metavar="S", help="wall time in s after which no further value is begun")
    _common(p, "folder for the page (.html) and its data (.json)")
    _report(commands, do.report)
    _audit(commands, do.audit)
    _validate(commands, do.validate)
    _cache(commands, cache)
    return parser


ENGINES = ("other programs that run the same scene: scipy, exudyn, mujoco, each with the interpreter of an environment that has "
           "it (default: the running one)")


def _cache(commands: Any, action: Any) -> None:
    text = "show what is kept on disk of derived and compiled laws, or remove it"
    p = commands.add_parser("cache", help=text, description=text[0].upper() + text[1:] + ".")
    p.add_argument("what", nargs="?", choices=("show", "clear"), default="show", help="default: show")
    _always(p, action)


def _report(commands: Any, action: Any) -> None:
    text = "derivation of a law with its checks, the sheet of a scene, or an audit of published formulas"
    p = commands.add_parser("report", help=text, description=text[0].upper() + text[1:] + ".")
    what = ("revolute, classical, kinematic, recursive, clearance, coulomb, lugre, beam or any other law; a Python file with "
            "scene(); a file of printed formulas (.audit), which are compared with their derivation")
    formats = [ending[1:] for ending in REPORTS]
    p.add_argument("what", metavar="NAME|FILE", help=what)
    p.add_argument("--format", choices=formats, help="default: that of --out, else md (of an audit a table)")
    p.add_argument("--out", type=_name, metavar="PATH", help="file (.html, .md, .tex) or folder; without it the text is printed")
    _always(p, action)


def _audit(commands: Any, action: Any) -> None:
    text = "compare the equations of a paper with their derivation"
    p = commands.add_parser("audit", help=text, description=text[0].upper() + text[1:] + ".")
    p.add_argument("what", type=_name, metavar="FILE", help="a paper in TeX (.tex) or Markdown (.md), or formulas (.audit)")
    told = "table of what the letters of the paper mean, begun where there is none (default: FILE with the ending .meanings)"
    p.add_argument("--meanings", type=_name, metavar="FILE", help=told)
    formats = [ending[1:] for ending in REPORTS]
    p.add_argument("--format", choices=formats, help="default: that of --out, else a table")
    p.add_argument("--out", type=_name, metavar="PATH", help="file (.html, .md, .tex) or folder; without it the text is printed")
    _always(p, action)


def _validate(commands: Any, action: Any) -> None:
    text = "measure the claims of validation/ against their references"
    p = commands.add_parser("validate", help=text, description=text[0].upper() + text[1:] + ".")
    p.add_argument("claims", nargs="*", metavar="CLAIM", help="name of a folder of validation/ (default: all)")
    p.add_argument("--root", type=_name, metavar="DIR", help="the checkout (default: the working directory or one above it)")
    p.add_argument("--full", action="store_true", help="all parts of suites, instead of a tenth; recorded as by --record")
    seed = "draws the tenth of every suite (default: another one each time, which is printed)"
    p.add_argument("--seed", type=_count, metavar="N", default=time.time_ns() // 1000 % 10**6, help=seed)
    p.add_argument("--parts", nargs="+", metavar="PART", default=(), help="parts of a claim's suites (seeds, names) alone")
    jobs = "claims measured side by side (default: as many as processors)"
    p.add_argument("--jobs", type=_jobs, metavar="N", default=os.cpu_count() or 1, help=jobs)
    p.add_argument("--record", action="store_true", help="keep what is found in validation/record.json, with the commit")
    p.add_argument("--list", action="store_true", help="show that record, and measure nothing")
    hours = "how long a claim without end of its own, such as strangers, may take; its seeds go on where --out left them"
    p.add_argument("--hours", type=_positive, metavar="H", help=hours)
    out = "folder for validation.html and validation.md; nothing is written without it"
    p.add_argument("--out", type=_name, metavar="DIR", help=out)
    _always(p, action)


def _command(commands: Any, name: str, action: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
    what = "Python file with scene(); optional t_end, measure (a sensor, 'C.angle'), runs, vary"
    p.add_argument("file", metavar="FILE", help=what)
    _always(p, action)
    return p


def _always(p: argparse.ArgumentParser, action: Callable[[argparse.Namespace], int]) -> None:
    """Add the options that every command has."""
    p.add_argument("--json", action="store_true", help="standard output carries JSON alone, {\"error\": ...} where it fails")
    p.add_argument("--debug", action="store_true", help="show the traceback of an error")
    p.set_defaults(command=action)


def _common(p: argparse.ArgumentParser, out: str) -> None:
    p.add_argument("--t-end", type=_positive, metavar="T", help="end time in s (default: t_end of FILE)")
    p.add_argument("--out", type=_name, metavar="DIR", help=out + "; nothing is written without it")


# -- values of options


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{_shown(text)} is not a number: give one such as 1e-6") from None
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{_shown(text)}: give a finite number above 0")
    return value


def _count(text: str) -> int:
    if not text.isascii() or not text.isdigit() or len(text) > 9:
        raise argparse.ArgumentTypeError(f"{_shown(text)}: give a whole number such as 17")
    return int(text)


def _jobs(text: str) -> int:
    if not (count := _count(text)):
        raise argparse.ArgumentTypeError("0: give at least one")
    return count


def _accuracies(text: str) -> list[float]:
    try:
        return [_positive(part) for part in text.split(",")]
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"{_shown(text)}: give numbers above 0 separated by commas, such as 1e-3,1e-6") from None


def _engines(text: str) -> dict[str, str | None]:
    pairs = [part.partition("=") for part in text.split(",")]
    if not all(name.strip() and (python.strip() or not sign) and "\0" not in python for name, sign, python in pairs):
        raise argparse.ArgumentTypeError(f"{_shown(text)}: give names with interpreters, separated by commas, such as "
                                         f"scipy,exudyn=/path/to/python")
    return {name.strip(): python.strip() or None for name, _, python in pairs}


def _name(text: str) -> str:
    """The checked name of a file or folder."""
    if not text.strip() or "\0" in text:
        raise argparse.ArgumentTypeError(f"{_shown(text)} is empty or holds the character of code 0: name a file or folder")
    return text


def _shown(text: str) -> str:
    from mbdae.values import shown  # imports NumPy, which takes time and is needed for wrong values only

    return shown(text)
