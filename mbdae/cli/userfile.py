"""FILE: a user's Python file with a function scene(); it may have any name. Also the messages for mistakes in it.

It is run as the module `__mp_main__`, as multiprocessing runs the main file of a program in its workers. So its name replaces no
module, its classes and functions can be sent to worker processes, which run the file again, and its code under
`if __name__ == "__main__":` is not run.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import inspect
import linecache
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from mbdae.cli.streams import OutputLostError, UsageError
from mbdae.errors import MbdaeError, OptionError

# -- Finds the folder validation/ of a checkout, with the claims and the runner that measures them; the package has neither


def find(root: str | Path | None = None) -> Path:
    """The folder validation/ of `root`, or of the working directory or one above it; OptionError where there is none."""
    here = Path.cwd() if root is None else Path(root).resolve()
    for folder in [here] if root is not None else [here, *here.parents]:
        with suppress(OSError):  # a name that is too long, or a folder that may not be read
            if any((folder / "validation").glob("*/check.py")):
                return folder / "validation"
    raise OptionError(f"there is no folder validation/ with claims in {here}{'' if root else ' or above'}: "
                      "run this in a clone of mbdae's repository, or name one by --root")


def runner_of(folder: Path) -> Any:
    """The package `runner` in a folder validation/, made importable by that name because its checks import it so."""
    if not (folder / "runner" / "__init__.py").is_file():
        raise OptionError(f"{folder} has claims, but no folder runner/ that measures them: give --root of a whole clone")
    if sys.path[:1] != [str(folder)]:
        sys.path.insert(0, str(folder))
    return importlib.import_module("runner")


NAME = "__mp_main__"
RUN_AS = ("__main__", NAME)
EXAMPLE = ("add one that returns a mb.Scene:\n\n    def scene():\n        s = mb.Scene('name')\n        ...\n"
           "        return s\n")


@contextmanager
def user_file(file: str) -> Iterator[ModuleType]:
    """FILE as a module that is the main file of this program while a command works; it may import files beside it."""
    path, code = _compiled(file)
    module = ModuleType(NAME)
    module.__file__ = str(path)
    before, folder = dict(sys.modules), str(path.parent)
    sys.modules.update(dict.fromkeys(RUN_AS, module))
    sys.path.append(folder)  # at the end, so that a random.py there replaces no module that others need
    try:
        with _mistakes_as_usage(file, path, f"'{file}' fails"):
            exec(code, module.__dict__)
        _check_function(module, file)
        yield module
    finally:
        sys.path.remove(folder)
        for name in [name for name, found in sys.modules.items() if name not in before and _is_beside(found, path.parent)]:
            del sys.modules[name]
        for name in RUN_AS:
            sys.modules.pop(name, None)
            if name in before:
                sys.modules[name] = before[name]


def scene_of(module: ModuleType, file: str) -> Any:
    """The scene of FILE; a mistake in its code becomes a UsageError that names the line."""
    from mbdae.api import Scene

    with _mistakes_as_usage(file, Path(str(module.__file__)), f"scene() of '{file}' fails"):
        scene = module.scene()
    if hasattr(scene, "cr_await"):
        scene.close()
        raise UsageError(f"scene() of '{file}' is stated by `async def`, so that it returns no scene; state it by `def`")
    if not isinstance(scene, Scene):
        raise UsageError(f"scene() of '{file}' returns {_a(scene)}, not a mb.Scene; end it with `return s`")
    return scene


def place_in(error: BaseException, file: str | None) -> str:
    """ "line 3 of swing.py": the last line of FILE, or of a file beside it, that led to an error; empty where none did."""
    if not file:
        return ""
    try:
        folder = Path(file).resolve().parent
    except (OSError, ValueError):
        return ""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        lines = [(error.filename, error.lineno)] if isinstance(error, SyntaxError) else []
        lines += [(frame.filename, frame.lineno) for frame in reversed(traceback.extract_tb(error.__traceback__))]
        for name, number in lines:
            if name and number and _is_own(Path(name), folder):
                return f"line {number} of {Path(name).name}"
        error = error.__cause__ or error.__context__  # type: ignore[assignment]
    return ""


def _compiled(file: str) -> tuple[Path, Any]:
    """Path and compiled code of FILE; UsageError where it cannot be read or compiled."""
    try:
        path = Path(file).resolve()
        if path.is_dir():
            raise UsageError(f"'{file}' is a folder; give a Python file with a function scene()")
        if not path.exists():
            raise UsageError(f"there is no file '{file}'; give a Python file with a function scene()")
        source = path.read_bytes()
    except (OSError, ValueError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"'{file}' cannot be read: {reason}; give a Python file with a function scene()") from None
    with _mistakes_as_usage(file, path, f"'{file}' is not a Python file"):
        tree = ast.parse(source, str(path))
        code = compile(source, str(path), "exec", dont_inherit=True)
    linecache.checkcache(str(path))
    _warn_of_hidden(tree, path, file)
    return path, code


@contextmanager
def _mistakes_as_usage(file: str, path: Path, failure: str) -> Iterator[None]:
    """Turn an error in the code of FILE into a UsageError that names the line. failure: what fails, in words."""
    try:
        yield
    except (MbdaeError, OutputLostError):
        raise
    except SystemExit as error:
        in_line = f" ({place})" if (place := place_in(error, str(path))) else ""
        raise UsageError(f"{failure}: it ends the program by sys.exit({error.code!r}){in_line}; leave that out") from error
    except Exception as error:
        in_line = f" ({place})" if (place := place_in(error, str(path))) else ""
        said = error.msg if isinstance(error, SyntaxError) else str(error)
        raise UsageError(f"{failure}: {type(error).__name__}: {said}{in_line}; correct the file") from error


def _check_function(module: ModuleType, file: str) -> None:
    """UsageError unless FILE has a function scene() that needs no arguments."""
    found = getattr(module, "scene", None)
    if found is None:
        raise UsageError(f"'{file}' has no function scene(); {EXAMPLE}")
    if not callable(found):
        raise UsageError(f"scene of '{file}' is {_a(found)}, no function scene(); {EXAMPLE}")
    try:
        inspect.signature(found).bind()
    except TypeError as error:
        raise UsageError(f"scene() of '{file}' cannot be called without arguments: {error}; give them defaults") from None
    except ValueError:  # scene has no signature that Python can inspect
        pass


def _warn_of_hidden(tree: ast.Module, path: Path, file: str) -> None:
    """Warn where `import x` in FILE imports another module than the x.py beside it."""
    named = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    named |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module and not node.level}
    for name in sorted({name.split(".")[0] for name in named}):
        beside = next((p for p in (path.parent / f"{name}.py", path.parent / name / "__init__.py") if p.is_file()), None)
        if beside is None or beside == path:
            continue
        try:
            found = importlib.util.find_spec(name)
        except (ImportError, ValueError):
            found = None
        if found is not None and (found.origin is None or Path(found.origin).resolve() != beside.resolve()):
            print(f"mbdae: warning: `import {name}` in '{file}' takes the module that is installed, not '{beside.name}' beside "
                  f"it; rename that where it is meant", file=sys.stderr)


def _is_beside(module: Any, folder: Path) -> bool:
    name = getattr(module, "__file__", None)
    return isinstance(name, str) and _is_own(Path(name), folder)


def _is_own(path: Path, folder: Path) -> bool:
    """Whether a file belongs to the user: it is in the folder of FILE or below, and neither in mbdae nor installed."""
    own = Path(__file__).resolve().parents[1]
    inside = path.is_relative_to(folder) and not path.is_relative_to(own)
    return inside and not any(part in ("site-packages", "dist-packages") for part in path.parts)


def _a(value: Any) -> str:
    return "nothing" if value is None else type(value).__name__


def compare_file(module: ModuleType, scene: Any, t_end: float, **options: Any) -> Any:
    """The comparison, with a progress bar on a terminal; for options that are None the file's or the default values are used."""
    from mbdae.compare import compare

    stated = _stated(module, ("runs", "measure"))
    return _with_bar(compare, "compare", stated | _given(options), scene, t_end)


def arena_of(a: Any, kept: Path | None) -> Any:
    """The arena that a command asks for, with a progress bar. kept: folder of finished runs."""
    from mbdae.arena import arena

    options = {"engines": a.engines, "accuracies": a.accuracies, "count": a.count, "seed": a.seed, "workers": a.jobs}
    return _with_bar(arena, "arena", _given(options | {"resume": kept}), a.scenes)


def map_of_file(module: ModuleType, t_end: float, **options: Any) -> Any:
    """The map of extremes, with a progress bar and options as in `compare_file`."""
    from mbdae.extremes import extremes

    stated = _stated(module, ("vary", "runs", "measure", "accuracy"))
    return _with_bar(extremes, "extremes", stated | _given(options), module.scene, t_end)


def _stated(module: ModuleType, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(module, name) for name in names if hasattr(module, name)}


def _given(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _with_bar(work: Any, name: str, options: dict[str, Any], *given: Any) -> Any:
    from mbdae.run.checkpoint import bar

    shown = bar()
    try:
        return work(*given, progress=lambda done, total, label: shown.show(done / total, name, label), **options)
    finally:
        shown.close()
