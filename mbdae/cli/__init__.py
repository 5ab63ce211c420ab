"""Command line: `main` parses the words, runs a command and turns any error that ends it into one message and an exit code.

Exit codes: 0 where what was asked holds, 1 where it does not, 2 for wrong usage and for mistakes in FILE; 130 after Ctrl-C, 143
after SIGTERM (128 plus the number of the signal); 141 where the reader of the output has closed it.
"""

from __future__ import annotations

import contextlib
import sys
import traceback
import warnings
from argparse import Namespace
from collections.abc import Sequence

from mbdae.cli.streams import READER_GONE, OutputLostError, Stops, UsageError, json_alone, usable_streams
from mbdae.errors import AccuracyWarning, MbdaeError, OptionError

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
            from mbdae.cli.parser import make_parser  # here, where a signal is answered

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
