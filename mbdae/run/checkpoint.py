"""Versions of software, and the number of CPUs, of a run; nothing identifies the computer or its user.

Progress of a run as a bar on the error stream, if that is a terminal.

Prepared scenes kept for the next call of the same statement.

Calls of `Scene.simulate` stored in a folder while they run: recognition of the same call, and its end by SIGTERM.

`integrators.checkpoints` stores the runs of a call; here the folder gets a statement of scene and options by which an equal call
recognises it, and SIGTERM ends the call after the current step.
"""

from __future__ import annotations

import hashlib
import json
import os
import signal
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from mbdae.errors import OptionError, StoppedError, Stopping, interrupted
from mbdae.files import first_difference, read_file, write_file
from mbdae.formulations import Form
from mbdae.integrators.base import Solver
from mbdae.integrators.stored_runs import DamagedError, Keeper, active, keeping_runs
from mbdae.results.reads import own_classes, own_of
from mbdae.results.result import Result
from mbdae.results.stored_parts import by_item, own_laws, statements
from mbdae.scene.scene import SceneData
from mbdae.system.prepare import Prepared, modelled
from mbdae.values import function, option, optional, path, shown, whole

PACKAGES = ("mbdae", "numpy", "scipy", "scikit-sundae", "symengine")


def environment() -> dict[str, str | int]:
    """Versions of Python and of the numerical packages, operating system, processor type, and CPUs this process may use."""
    import platform

    found: dict[str, str | int] = {"python": platform.python_version()}
    found |= {name: _version(name) for name in PACKAGES}
    return found | {"machine": f"{platform.system()} {platform.machine()}", "cpus": _cpus()}


def versions() -> dict[str, str | int]:
    """What may change the last digits of a result: `environment` without the number of CPUs."""
    return {name: value for name, value in environment().items() if name != "cpus"}


def _version(package: str) -> str:
    # imported here because it imports e-mail and sockets too, which takes 0.02 s
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"


def _cpus() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Bar:
    """Callback (t, t_end, stats) of a run that draws a progress bar; the bar disappears when the run ends."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        console = Console(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[note]}"))
        self._bar = Progress(*columns, console=console, transient=True, auto_refresh=False, redirect_stdout=False,
                             redirect_stderr=False, disable=not console.is_terminal)
        self._task = self._bar.add_task("", total=1.0, note="")
        self._running = False

    def __call__(self, t: float, t_end: float, stats: Any) -> None:
        self.show(t / t_end, "run", f"t = {t:.4g} of {t_end:g} s, {stats.steps} steps, {stats.cpu_s:.1f} s CPU")

    def show(self, share: float, what: str, note: str) -> None:
        """Draw the bar at `share` (0 to 1) of the whole run."""
        if not self._running:
            self._bar.start()
            self._running = True
        self._bar.update(self._task, completed=share, description=what, note=note, refresh=True)

    def close(self) -> None:
        """Remove the bar; the next call of `show` draws it again."""
        if self._running:
            self._bar.stop()
            self._running = False

    def __del__(self) -> None:
        if getattr(self, "_running", False):
            self.close()


def bar() -> Bar:
    """A new progress bar."""
    return Bar()


def progress_of(progress: Any) -> Any:
    """The callback for a progress option: a bar for True, None for False; OptionError for what is no function."""
    if isinstance(progress, bool | np.bool_):
        return bar() if progress else None
    return optional("progress", progress, function, "give True for a bar, a function progress(t, t_end, stats), or None",
                    takes="t, t_end, stats")


T = TypeVar("T")
#: default of `every`: number of accepted steps after which a checkpoint is due, if PAUSE (`checkpoints.keeper`) has passed since
#: the last one. Methods that restart at checkpoints restart after every so many steps, with and without a checkpoint there
EVERY = 1000
FEW = 1000  #: an option (such as output times) with more values than this is stored as a hash in the statement of the call
FORMAT = "mbdae run in progress 3"
STATEMENT = "statement.json"
FOLDER = "give the name of a folder, new or one that such a call made, or None"


def keeper_of(checkpoint: Any, every: Any) -> Keeper | None:
    """The keeper of a call, with its folder made; None without a checkpoint, OptionError for a folder that cannot be used."""
    steps = optional("every", every, whole, "give a number of steps, 1 or more, or None", least=1)
    if checkpoint is None:
        if every is not None:
            raise OptionError(f"every = {shown(every)} without a checkpoint: name its folder by checkpoint=")
        return None
    folder: Path = option("checkpoint", checkpoint, path, FOLDER)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        strange = not (folder / STATEMENT).exists() and any(not name.name.startswith(".") for name in folder.iterdir())
    except OSError as error:
        raise OptionError(f"checkpoint = '{folder}' is no folder to read and write ({error.strerror}): {FOLDER}") from error
    if strange:
        raise OptionError(f"checkpoint = '{folder}' holds other files: {FOLDER}")
    return Keeper(folder, steps or EVERY)


#: number of prepared scenes that wait for their next call, at most; with more NODES a scene waits as long as a result of it is in
#: use, since it takes 100 kB a node
MOST, NODES = 8, 500
_waiting: dict[tuple[Any, ...], Callable[[], Prepared | None]] = {}


def taken(scene: SceneData, options: tuple[Any, ...] | None, prepare: Callable[[Any], Prepared]) -> tuple[Prepared, Any]:
    """The scene as `prepare` makes it, or as it was made for an earlier call with the same statement and options, and a key with
    which `give_back` keeps it for the next one: nobody else uses it until then. options: None where the call cannot be told from
    others.

    In the main thread alone, beside none but daemons: elsewhere an earlier result may be read while the next run uses what it is
    read from."""
    others = any(not one.daemon for one in threading.enumerate() if one is not threading.main_thread())
    alone = threading.current_thread() is threading.main_thread() and not others and active() is None
    said = scene._said() if options is not None and alone else None
    if said is None or options is None:
        return prepare(scene), None
    key = said, *options
    found = _waiting.pop(key, lambda: None)()
    if found is None:
        found = prepare(scene)
        found.kept["shared"] = found.model.scene is scene
    elif found.kept["shared"] and found.model.scene is not scene:  # another scene, which may be given further statements
        found = prepare(scene._copied())
        found.kept["shared"] = False
    return found, key


def give_back(prepared: Prepared, key: Any) -> None:
    """Keep what `taken` gave for the next call; a call that ends with an error does not."""
    if key is not None:
        large = len(prepared.model.nodes) > NODES
        _waiting[key] = weakref.ref(prepared, lambda _: _waiting.pop(key, None)) if large else lambda: prepared
        while len(_waiting) > MOST:
            _waiting.pop(next(iter(_waiting)))


@contextmanager
def kept(keeper: Keeper | None, statement: Callable[[], dict[str, Any]]) -> Iterator[None]:
    """Context in which all runs are stored by the keeper. statement: function that returns plain data of the call; OptionError
    for the folder of another call."""
    if keeper is None:
        yield
        return
    _check(keeper.folder, json.loads(json.dumps(statement())))
    for left in keeper.folder.glob(".*.npz"):  # files that a process had not finished when it was killed
        left.unlink(missing_ok=True)
    try:
        with _ended_by_sigterm(keeper), keeping_runs(keeper):
            yield
    except DamagedError as error:
        raise OptionError(f"checkpoint: {error}") from error
    except Stopping as stop:
        ended = StoppedError(f"stopped by SIGTERM: what was computed is kept in '{keeper.folder}'; the same call goes on from "
                             f"there")
        interrupted(ended, "", getattr(stop, "solution", None))
        raise ended from None


def statement_of(scene: SceneData, every: int, solver: Solver | None, form: Form | None, start: Result | str | None,
                 **options: Any) -> dict[str, Any]:
    """Plain data of a call: scene, options and versions. OptionError where its runs cannot be stored."""
    try:
        stated = statements(scene)
    except OptionError as error:
        raise OptionError(f"checkpoint: the folder has to hold the scene, and this scene cannot be stored: "
                          f"{error}; or run it without checkpoint=") from error
    return {"scene": by_item(stated), "laws": own_laws(modelled(scene)[0]),
            "solver": repr(solver), "form": repr(form), "every": every,
            "start": _digest(start.solution.t[-1:], start.solution.y[-1], start.solution.yp[-1])
                     if isinstance(start, Result) else start,
            "own": own_of(scene) | own_classes(solver, form), "versions": versions(),
            **{name: _told(value) for name, value in options.items()}}


def _told(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    return value.tolist() if value.size <= FEW else _digest(value)


def _digest(*arrays: Any) -> str:
    content = b"".join(np.ascontiguousarray(array, dtype="<f8").tobytes() for array in arrays)
    return hashlib.sha256(content).hexdigest()[:16]


def _check(folder: Path, here: dict[str, Any]) -> None:
    place = folder / STATEMENT
    if not place.exists():
        write_file(place, json.dumps({"format": FORMAT, "call": here}, indent=1) + "\n")
        return
    try:
        there = json.loads(read_file(place))
        call = there["call"] if there["format"] == FORMAT else None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OptionError(f"checkpoint: '{place}' cannot be read ({error}): delete the folder, or name another one") from error
    difference = "it has another format" if call is None else first_difference(call, here)
    if difference:
        raise OptionError(f"checkpoint = '{folder}' holds another run: {difference}; make the same call with the same versions, "
                          f"or name another folder")


@contextmanager
def _ended_by_sigterm(keeper: Keeper) -> Iterator[None]:
    """Context in which SIGTERM ends the process after the present step of a run has been stored; between two runs at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, frame: Any) -> None:
        keeper.stop = True
        if not keeper.inside:
            raise Stopping

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before if before is not None else signal.SIG_DFL)


def kept_value(make: Callable[[], T], plain: Callable[[T], Any], back: Callable[[Any], T]) -> T:
    """The result of the long evaluation `make`, read from the folder where it was stored before. plain, back: functions that turn
    the result into plain data and plain data into the result."""
    keeper = active()
    if keeper is None:
        return make()
    known, found = keeper.next_value()
    if known:
        return back(found)
    made = make()
    keeper.keep_value(plain(made))
    return made
