"""What a function of the user's depends on, as plain data: its code, and all constants, functions, classes, objects it reads.

A stored sweep, comparison or map is continued only where this is the same: a job whose constant was changed would otherwise mix
old rows with new ones. Numbers and texts are given as they are, so that a message can show both; everything else by a hash.
Of libraries only the name counts (their versions are compared beside), of code neither comments nor line numbers.
"""

from __future__ import annotations

import dis
import hashlib
import pickle
import sys
import sysconfig
from dataclasses import is_dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from mbdae.integrators.solution import Solution
from mbdae.scene.scene import SceneData
from mbdae.symbolic.law import Law
from mbdae.symbolic.part import Part

SHORT = 60  #: longest text of a value that is given as it is
PACKAGE = __name__.partition(".")[0]
_LIBRARIES = tuple(str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "platstdlib", "purelib", "platlib"))


def own_of(scene: SceneData) -> dict[str, dict[str, str]]:
    """What the user's own functions and classes in a scene depend on, by name. Of laws and parts of laws their equations count,
    which are compared beside."""
    return {name: reads(thing) for name, thing in scene.own.items()
            if not (isinstance(thing, type) and issubclass(thing, Law | Part)) and not name.startswith("kept ")}


def own_classes(*things: Any) -> dict[str, dict[str, str]]:
    """What the user's own classes of some objects, such as solvers and forms, depend on, by name."""
    return {type(thing).__qualname__: reads(type(thing)) for thing in things
            if thing is not None and _module(type(thing)).partition(".")[0] != PACKAGE}


def reads(thing: Any) -> dict[str, str]:
    """What a function, class or callable object depends on: by names such as "job", "job: G" (a global that it reads) and
    "job: helper: tolerance"."""
    found = _Reads(_module(thing.func if isinstance(thing, partial) else thing).partition(".")[0])
    found.of(thing, _name(thing))
    return found.told


class _Reads:
    def __init__(self, package: str, seen: dict[int, Any] | None = None) -> None:
        """package: that of the function, which is the user's even where it is installed."""
        self.told: dict[str, str] = {}
        self._package = package
        self._seen = {} if seen is None else seen  # by id; the objects are held, so that ids stay theirs

    def of(self, thing: Any, name: str) -> None:
        """Add a thing that is read under a name."""
        if isinstance(thing, partial):
            self.of(thing.func, name)
            self._values(name, {**{str(i): value for i, value in enumerate(thing.args)}, **thing.keywords})
        elif not isinstance(thing, FunctionType | type) and isinstance(getattr(thing, "__wrapped__", None), FunctionType):
            self.of(thing.__wrapped__, name)  # a function with functools.cache, for example
        elif isinstance(thing, MethodType):
            self.of(thing.__func__, name)
            self.of(thing.__self__, f"{name}: self")
        elif isinstance(thing, FunctionType | type | ModuleType | BuiltinFunctionType):
            self._of_definition(thing, name)
        elif (plain := _plain(thing)) is not None:
            self.told[name] = plain
        elif id(thing) not in self._seen:
            self._seen[id(thing)] = thing
            self._of_object(thing, name)

    def _of_definition(self, thing: Any, name: str) -> None:
        if self._of_library(thing):
            self.told[name] = f"{_module(thing)} {_name(thing)}"
        elif id(thing) not in self._seen:
            self._seen[id(thing)] = thing
            if isinstance(thing, FunctionType):
                self._of_function(thing, name)
            elif isinstance(thing, type):
                self._of_class(thing, name)
            else:
                self.told[name] = _hash(_content(thing))

    def _of_function(self, function: FunctionType, name: str) -> None:
        self.told[name] = _hash(*_code(function.__code__))
        closed = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
        cells = {cell_name: cell.cell_contents for cell_name, cell in closed if _filled(cell)}
        defaults = {f"argument {i}": value for i, value in enumerate(function.__defaults__ or ())}
        names = sorted(_names(function.__code__))
        known = {n: function.__globals__[n] for n in names if n in function.__globals__}
        for module_name, module in list(known.items()):
            if isinstance(module, ModuleType) and not self._of_library(module):
                del known[module_name]  # of a module of the user's what the function takes from it
                known |= {f"{module_name}.{n}": vars(module)[n] for n in names if n in vars(module)}
        self._values(name, defaults | (function.__kwdefaults__ or {}) | known | cells)
        for imported in sorted(_imported(function.__code__)):
            if (file := self._own_file(imported)) is not None:
                self.told[f"{name}: import {imported}"] = _hash(file.read_bytes())

    def _of_class(self, cls: type, name: str) -> None:
        hidden = ("__dict__", "__weakref__", "__doc__", "__module__", "__qualname__", "__annotations__", "__firstlineno__",
                  "__static_attributes__", "_abc_impl", "__abstractmethods__")
        own = {n: value for n, value in vars(cls).items() if n not in hidden}
        self._values(name, {n: _bare(value) for n, value in own.items()} | {f"base {b.__name__}": b for b in cls.__bases__})

    def _of_object(self, thing: Any, name: str) -> None:
        inside = _Reads(self._package, self._seen)
        if isinstance(thing, SceneData):
            inside.told[""] = repr((thing.name, thing.gravity.tolist(), thing.space, thing.statements))
            inside._values("", thing.own)
        elif isinstance(thing, dict):
            inside._values("", {str(key): value for key, value in thing.items()})
        elif isinstance(thing, list | tuple):
            inside._values("", {str(i): value for i, value in enumerate(thing)})
        elif isinstance(thing, property):
            inside._values("", {n: f for n in ("fget", "fset") if (f := getattr(thing, n)) is not None})
        elif self._of_library(type(thing)):
            inside.told[""] = f"{_name(type(thing))} {_pickled(thing)}"
            inside._values("", {n: v for n, v in getattr(thing, "__dict__", {}).items() if isinstance(v, FunctionType)})
        else:
            inside.of(type(thing), "class")
            inside._values("", {n: v for n, v in getattr(thing, "__dict__", {}).items() if not n.startswith("__")})
        self.told[name] = _hash(repr(sorted(inside.told.items())).encode())

    def _values(self, name: str, values: dict[str, Any]) -> None:
        for key, value in values.items():
            self.of(value, f"{name}: {key}")


    def _of_library(self, thing: Any) -> bool:
        """Whether something is defined in Python, in an installed package or in this one."""
        module = thing if isinstance(thing, ModuleType) else sys.modules.get(_module(thing))
        if module is None or module.__name__ == "__main__":
            return False
        return self._library_file(module.__name__, getattr(module, "__file__", None))

    def _own_file(self, name: str) -> Path | None:
        """The file of a module of the user's that a function imports itself; None for others."""
        try:
            found = find_spec(name)
        except (ImportError, ValueError, AttributeError):
            return None
        file = None if found is None else found.origin
        return None if self._library_file(name, file) or file is None or not Path(file).is_file() else Path(file)

    def _library_file(self, name: str, file: str | None) -> bool:
        top = name.partition(".")[0]
        if top == PACKAGE or file is None:
            return True
        place = Path(file).resolve()
        installed = str(place).startswith(_LIBRARIES) or not {"site-packages", "dist-packages"}.isdisjoint(place.parts)
        return installed and top != self._package


def _plain(value: Any) -> str | None:
    """A value without functions or objects as text; None for others."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufcSU":
        text = f"array {value.shape} {value.dtype.str} {_hash(np.ascontiguousarray(value).tobytes())}"
    elif value is None or isinstance(value, bool | int | float | complex | str | bytes | np.generic):
        text = repr(value)
    elif isinstance(value, set | frozenset) and all(_plain(v) is not None for v in value):
        text = repr(sorted(str(_plain(v)) for v in value))
    elif isinstance(value, list | tuple) and all(_plain(v) is not None for v in value):
        text = repr([_plain(v) for v in value])
    else:
        return None
    return text if len(text) <= SHORT else f"{text[: SHORT // 2]}... {_hash(text.encode())}"


def _code(code: CodeType) -> list[bytes]:
    """What a code object does: its instructions, names and constants, those of functions inside of it too."""
    parts = [code.co_code, repr((code.co_names, code.co_varnames, code.co_freevars, code.co_argcount, code.co_kwonlyargcount,
                                 code.co_flags)).encode()]
    for constant in code.co_consts:
        parts += _code(constant) if isinstance(constant, CodeType) else [(_plain(constant) or repr(constant)).encode()]
    return parts


def _names(code: CodeType) -> set[str]:
    return set(code.co_names).union(*(_names(c) for c in code.co_consts if isinstance(c, CodeType)))


def _imported(code: CodeType) -> set[str]:
    """Names of the modules that code imports when it runs."""
    own = {str(one.argval) for one in dis.get_instructions(code) if one.opname == "IMPORT_NAME"}
    return own.union(*(_imported(c) for c in code.co_consts if isinstance(c, CodeType)))


def _bare(member: Any) -> Any:
    return member.__func__ if isinstance(member, staticmethod | classmethod) else member


def _filled(cell: Any) -> bool:
    try:
        cell.cell_contents  # noqa: B018 - a cell that is empty raises
    except ValueError:
        return False
    return True


def _content(module: ModuleType) -> bytes:
    try:
        return Path(module.__file__ or "").read_bytes()
    except OSError:
        return module.__name__.encode()


def _pickled(thing: Any) -> str:
    """An object of a library by its state; "" for one that has none to be told, such as a lock or an open file."""
    if isinstance(found := getattr(thing, "solution", None), Solution):
        return _hash(found.t.tobytes(), np.ascontiguousarray(found.y).tobytes())
    if _module(type(thing)).partition(".")[0] == PACKAGE:
        return repr(thing) if is_dataclass(thing) else ""
    try:
        return _hash(pickle.dumps(thing, protocol=4))
    except Exception:
        return ""


def _module(thing: Any) -> str:
    return str(getattr(thing, "__module__", None) or "builtins")


def _name(thing: Any) -> str:
    return str(getattr(thing, "__qualname__", getattr(thing, "__name__", type(thing).__qualname__)))


def _hash(*parts: bytes) -> str:
    found = hashlib.sha256()
    for part in parts:
        found.update(len(part).to_bytes(8, "little") + part)
    return found.hexdigest()[:16]
