"""Whatever a file says: `mb.load` builds nothing but what mbdae and the caller define, and answers with a clear error.

Every text, number and list of the header of a rich result is replaced by hostile ones; hooks see what a load executes, opens and
imports. A file that still is a result (another name of the scene, say) may be loaded.
"""

from __future__ import annotations

import copy
import json
import os
import random
import re
import sys
import warnings
import zipfile
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.disk import store
from mbdae.integrators.named import solvers
from mbdae.results import archive

MARK = "executed-by-a-file"
ENTRY = re.compile(r"[0-9a-f]{16,64}\.(kept|part)")
OUTSIDE = ("os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "os.fork", "socket.connect", "shutil.rmtree",
    "os.remove",
           "os.rename", "os.mkdir", "pickle.find_class", "ctypes.dlopen", "exec", "import", "marshal.loads")
ALLOWED = {"mbdae", "numpy", "scipy", "sympy", "symengine", "sksundae", "mpmath"}


class Rubber(mb.Force):
    """A law of the user's own with a part."""

    params = mb.params(stiffness=("N/m^3", "cubic stiffness"))
    options = ("friction",)

    def energy(self, k: Any, l: Any) -> Any:
        d = l.r - k.r
        return self.stiffness * (d @ d) ** 2 / 4


def wave(s: float) -> Any:
    """A curve of the user's own."""
    return 2 + s, 0.1 * np.sin(2 * np.pi * s)


LAWS = [Rubber, wave]


def _writes(event: str, args: tuple[Any, ...]) -> bool:
    """Whether a file is opened to be written; a descriptor was opened by its path before."""
    if event != "open" or isinstance(args[0], int):
        return False
    return bool(set(args[1]) & set("wax+") if args[1] else args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC))


def _keeps(event: str, args: tuple[Any, ...]) -> bool:
    """Whether entries of the cache are written: their names are hashes of mbdae's, their content is what it derived."""
    paths = {"open": args[:1], "os.rename": args[:2], "os.remove": args[:1]}.get(event, ())
    folder = str(store().folder)
    return bool(paths) and all(os.path.split(os.path.realpath(path))[0] == folder and ENTRY.fullmatch(os.path.basename(path))
                               for path in map(os.fsdecode, paths))


#: how kernels are compiled and read from the cache, whose reader refuses other classes; what their code does is seen all the same
OF_KERNELS = ("pickle.find_class", "marshal.loads", "exec")


def _in_kernels() -> bool:
    """Whether equations are being compiled, or read from the cache."""
    frame = sys._getframe(2)
    while frame is not None and Path(frame.f_code.co_filename).parent.name not in ("disk", "kernels"):
        frame = frame.f_back
    return frame is not None


class Seen:
    """Events of Python's audit hooks while it is switched on; a hook cannot be removed."""

    on = False
    events: list[tuple[str, str]] = []  # noqa: RUF012

    @classmethod
    def hook(cls, event: str, args: tuple[Any, ...]) -> None:
        if not cls.on:
            return
        if event in OF_KERNELS and _in_kernels():
            return
        if (event in OUTSIDE or _writes(event, args)) and not _keeps(event, args):
            cls.events.append((event, ascii(args)[:300]))


sys.addaudithook(Seen.hook)


def test_what_is_written_outside_of_the_cache_is_seen(tmp_path: Path) -> None:
    folder = store().folder
    assert folder is not None
    entry = folder / f"{'0' * 64}.kept"
    Seen.events, Seen.on = [], True
    try:
        for path in (tmp_path / "x", tmp_path / entry.name, entry, folder / "x.py", folder / ".." / entry.name):
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT))
            os.replace(path, path)
            path.unlink()
    finally:
        Seen.on = False
    assert [event for event, _ in Seen.events] == ["open", "os.rename", "os.remove"] * 4
    assert not any(ascii(str(entry)) in args for _, args in Seen.events)


def rich() -> mb.Scene:
    s = mb.Scene("rich", gravity=(0, -9.81, 0))
    a = s.link("crank", (0, 0), (0, 0.3), mass=0.3)
    b = s.rigid_body("block", 0.5, 0.01, at=(0.3, 0.3))
    s.point_mass("ball", 0.1, (0.3, 0.6), velocity=(0.1, 0))
    s.revolute("A", s.ground, a, at=(0, 0), torque=sp.Piecewise((0.1, mb.t < 0.01), (sp.sin(7.1 * mb.t), True)))
    s.revolute("B", a, b, at=(0, 0.3), friction=mb.Coulomb(0.1, 0.01), radius=0.01, model=mb.Kinematic())
    s.spring("S", b.at((0.3, 0.3)), "ball", at_k=(0.3, 0.3), at_l=(0.3, 0.6), stiffness=20.0, damping=0.5)
    pin = s.rigid_body("pin", 0.2, 0.001, at=(1.0, 0))
    s.revolute("C", s.ground, pin, at=(1.0, 0), model=mb.Clearance(0.0101, 0.01, mb.Hertz(1e6, 0.1), friction=mb.Coulomb(0.1,
        0.01)))
    s.add(Rubber("R", s.ground, b, at=(0.3, 0.3), stiffness=4.0, friction=mb.Coulomb(0.2, 0.1)))
    beam = s.beam("beam", curve=wave, section=mb.Section.circular(0.01, 2e9, 0.3, 1000, damping=1e-3), elements=2)
    s.weld("W", s.ground, beam, at=(2, 0))
    s.force("F", beam.at(1.0), (0, 0.1 * mb.t))
    beam.load((0, 2 * mb.t + 1), frame="section")
    return s


class Stored:
    """A stored result as header and arrays."""

    def __init__(self, folder: Path) -> None:
        self.good, self.evil = folder / "good.npz", folder / "evil.npz"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rich().simulate(0.002, solver=mb.RadauIIA(2, rtol=1e-6), outputs=4).save(self.good)
        with np.load(self.good) as file:
            self.arrays = {name: file[name] for name in file.files}
        self.header = json.loads(str(self.arrays.pop("header")))

    def attempt(self, path: Path | None = None) -> str | None:
        """Load a file; the message of its refusal, None where it is a result. Fails where anything else happens."""
        path = path or self.evil
        solvers("")  # all of mbdae's modules that an unknown name is sought in
        before = set(sys.modules)
        Seen.events, Seen.on = [], True
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                mb.load(path, laws=LAWS)
            told = None
        except mb.OptionError as error:
            told = str(error)
        finally:
            Seen.on = False
        assert not Seen.events
        assert not {name.split(".")[0] for name in set(sys.modules) - before} - ALLOWED
        assert not list(Path.cwd().glob(f"{MARK}*"))
        if told is not None:
            assert str(path) in told
            assert len(told) < 2000
            assert "Traceback" not in told
        return told

    def write(self, header: Any, **arrays: Any) -> None:
        """A file with another header, or other arrays."""
        text = header if isinstance(header, str) else json.dumps(header)
        np.savez(self.evil, header=np.array(text), **(self.arrays | arrays))


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stored]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("work"))
        made = Stored(tmp_path_factory.mktemp("files"))
        mb.load(made.good, laws=LAWS)
        assert made.attempt(made.good) is None
        yield made


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where every value of a header stands."""
    yield path
    for key, part in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(part, (*path, key))


def at(value: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        value = value[key]
    return value


def put(header: Any, path: tuple[Any, ...], new: Any) -> Any:
    """A copy of the header with another value, or another key, at a place."""
    if not path:
        return new
    changed = copy.deepcopy(header)
    at(changed, path[:-1])[path[-1]] = new
    return changed


def renamed(header: Any, path: tuple[Any, ...], key: str) -> Any:
    changed = copy.deepcopy(header)
    holder = at(changed, path[:-1])
    holder[key] = holder.pop(path[-1])
    return changed


RUN = f"__import__('os').system('touch {MARK}')"
TEXTS = ["os:system", "subprocess:check_output", RUN, "../../x", "", "x" * 100_000, "mbdae.cli:main",
    "mbdae.results.storage:save",
         "builtins:eval", "nan", "ground", "\ud800", "__class__", "t.__class__", "9**9**9**9", "A",
         "mbdae:Revolute",
         "__init__", "draw", "simulate", "<lambda>", "\x00", "mbdae:Coulomb", "sin(t)"]
NUMBERS = [-1, 0, 1, 3, 10**400, 2**63, -(2**63), 1e308, -1e308, 5e-324, float("nan"), float("inf"), -float("inf"), True, None,
    "1",
           [], {}, [1.0], 1e9, {"object": "os:system", "fields": {"command": f"touch {MARK}"}}, {"expression": RUN},
           {"class": "os:system"}, {"law": "os:system"}, {"body": "ground"}, {"unreadable": "x"}, 0.5, 10**6]
BODIES = ("crank", "block", "ball", "pin", "beam")  #: the ground may stand for them
TOLD = ("scene.name", "info.choice", "info.warnings", "start.changes", "accuracy.unknown")  #: free texts


def test_texts_replaced_by_hostile_ones(stored: Stored) -> None:
    """Refused, or a text that is free, or a name that only its own statement says: never executed."""
    _texts(stored, 1)


@pytest.mark.slow
def test_every_text_replaced_by_every_hostile_one(stored: Stored) -> None:
    _texts(stored, len(TEXTS))


def _texts(stored: Stored, each: int) -> None:
    found = [p for p in places(stored.header) if isinstance(at(stored.header, p), str)]
    assert len(found) > 100
    for path, new in _each(stored, found, TEXTS, each, lambda p, new: put(stored.header, p, new)):
        free = ".".join(map(str, path)).startswith(TOLD)
        named = path[:2] == ("scene", "statements") and path[3:] in ((1, 0), (2, "name"), (1, 0, "name"))
        before = at(stored.header, path)
        fits = before == new or (path[-1] == "expression" and new == "sin(t)") or (before in BODIES and new == "ground")
        assert free or named or fits, (path, new)


@pytest.mark.parametrize("each", [1, pytest.param(len(TEXTS), marks=pytest.mark.slow)])
def test_keys_replaced_by_hostile_ones(stored: Stored, each: int) -> None:
    keys = [p for p in places(stored.header) if p and isinstance(p[-1], str)]
    for path, new in _each(stored, keys, TEXTS, each, lambda p, new: renamed(stored.header, p, new)):
        assert path[:2] in (("info", "stats"), ("info", "accuracy")) or path[-1] == new, (path, new)


@pytest.mark.parametrize("each", [1, pytest.param(len(NUMBERS), marks=pytest.mark.slow)])
def test_numbers_replaced_by_hostile_ones(stored: Stored, each: int) -> None:
    numbers = [p for p in places(stored.header) if isinstance(at(stored.header, p), int | float)]
    assert len(numbers) > 100
    for path, new in _each(stored, numbers, NUMBERS, each, lambda p, new: put(stored.header, p, new)):
        assert new is None or isinstance(new, int | float) or "section" in path or "model" in path, (path, new)
        assert path[0] == "scene" or new is None or new >= 0 or path[-1] in ("t", "degrees_of_freedom"), (path, new)


@pytest.mark.parametrize("each", [1, pytest.param(len(NUMBERS), marks=pytest.mark.slow)])
def test_lists_and_tables_replaced_by_hostile_values(stored: Stored, each: int) -> None:
    inner = [p for p in places(stored.header) if isinstance(at(stored.header, p), list | dict)]
    _each(stored, inner, [*NUMBERS, *TEXTS[:4]], each, lambda p, new: put(stored.header, p, new))


def _each(stored: Stored, paths: list[Any], values: list[Any], each: int, made: Callable[[Any, Any], Any]) -> list[Any]:
    """Every place with so many of the values, in turn; those that were accepted."""
    accepted = []
    for i, path in enumerate(paths):
        for k in range(each):
            new = values[(i + k) % len(values)]
            stored.write(made(path, new))
            if stored.attempt() is None:
                accepted.append((path, new))
    return accepted


# ---- damaged archives ------------------------------------------------------------------------------------------------------


class Boom:
    def __reduce__(self) -> Any:
        import os

        return os.system, (f"touch {MARK}",)


def _raw(members: dict[str, bytes], compress: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = BytesIO()
    with zipfile.ZipFile(out, "w", compress) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return out.getvalue()


def _npy(shape: str, descr: str = "'<f8'", body: bytes = b"") -> bytes:
    head = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + body


def damaged(stored: Stored) -> Iterator[tuple[str, bytes]]:
    """Files that are no results, by what is wrong with them."""
    good = stored.good.read_bytes()
    for share in (0.0, 0.01, 0.2, 0.5, 0.9, 0.99, 0.9999):
        yield f"cut at {share:.2%}", good[: int(share * len(good))]
    yield "begins late", good[100:]
    yield "text", b"hello"
    yield "zeros", bytes(1000)
    with zipfile.ZipFile(stored.good) as file:
        members = {name: file.read(name) for name in file.namelist()}
    yield "no members", _raw({})
    for name in ("header.npy", "y.npy", "steps.npy", "inner.npy"):
        yield f"without {name}", _raw({k: v for k, v in members.items() if k != name})
    yield "a member of another name", _raw({**members, "../../x.npy": members["t.npy"]})
    yield "a member that is no array", _raw({**members, "x.txt": b"x"})
    yield "an unknown array", _raw({**members, "extra.npy": members["t.npy"]})
    yield "a folder", _raw({**members, "folder/": b""})
    pickled = BytesIO()
    np.save(pickled, np.array([Boom()], dtype=object), allow_pickle=True)
    yield "a pickled array", _raw({**members, "y.npy": pickled.getvalue()})
    yield "a pickled header", _raw({**members, "header.npy": pickled.getvalue()})
    yield "a dtype with objects", _raw({**members, "y.npy": _npy("(1,)", "'|O'", bytes(8))})
    yield "a structured dtype", _raw({**members, "y.npy": _npy("(1,)", "[('a', '<f8')]", bytes(8))})
    yield "an expression for a dtype", _raw({**members, "y.npy": _npy("(1,)", RUN)})
    yield "a shape beyond the file", _raw({**members, "y.npy": _npy("(1000000000000, 9)")})
    yield "a negative shape", _raw({**members, "y.npy": _npy("(-1,)")})
    yield "an enormous shape", _raw({**members, "y.npy": _npy(f"({'9' * 50},)")})
    yield "a bomb", _raw({**members, "y.npy": _npy("(500000,)", body=bytes(4_000_000))})
    yield "a bomb of a header", _raw({**members, "header.npy": _npy("()", "'<U900000'", bytes(3_600_000))})
    yield "another check sum", good.replace(members["t.npy"][-8:],
        bytes(8)) if members["t.npy"][-8:] in good else good[:-30] + bytes(30)


def test_damaged_archives(stored: Stored, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "FREE", 1_000_000)  # bombs are smaller than the ones it is meant for
    assert stored.attempt(stored.good) is None
    names = []
    for name, content in damaged(stored):
        stored.evil.write_bytes(content)
        told = stored.attempt()
        assert told is not None, name
        assert "bomb" not in name or "would become" in told  # before anything is unpacked
        names.append(name)
    assert len(set(names)) > 25


def test_flipped_bits(stored: Stored) -> None:
    """Refused wherever the numbers would be others: in what a check sum covers, or what the header and the shapes decide."""
    good, rng, refused = stored.good.read_bytes(), random.Random(3), 0
    for _ in range(200):
        content = bytearray(good)
        content[rng.randrange(len(good))] ^= 1 << rng.randrange(8)
        stored.evil.write_bytes(bytes(content))
        refused += stored.attempt() is not None
    assert refused > 150  # the rest are dates and the like in the directory of the archive


ARRAYS: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "nan": lambda a: {"y": np.where(np.arange(a["y"].size).reshape(a["y"].shape) == 5, np.nan, a["y"])},
    "infinite": lambda a: {"start_q": a["start_q"] + np.inf}, "nan in times": lambda a: {"t": a["t"] * np.nan},
    "falling steps": lambda a: {"steps": a["steps"][::-1]}, "equal steps": lambda a: {"steps": np.zeros_like(a["steps"])},
    "outputs outside": lambda a: {"t": a["t"] + 1}, "one step less": lambda a: {"steps": a["steps"][:-1]},
    "turned": lambda a: {"y": a["y"].T}, "flat": lambda a: {"y": a["y"].ravel()}, "no steps": lambda a: {"steps": a["steps"][:0]},
    "integers": lambda a: {"y": a["y"].astype(int)}, "single precision": lambda a: {"y": a["y"].astype(np.float32)},
    "complex": lambda a: {"y": a["y"].astype(complex)}, "texts": lambda a: {"t": np.array(["a"] * len(a["t"]))},
    "a start of another size": lambda a: {"start_q": a["start_q"][:-1]}, "a number": lambda a: {"start_u": np.array(1.0)},
    "multipliers": lambda a: {"start_multipliers": np.r_[a["start_multipliers"], 1.0]},
    "inner": lambda a: {"inner": a["inner"][:, :, :-1]},
    "a later start": lambda a: {"steps": a["steps"] + 0.001}, "extra": lambda a: {"more": a["t"]},
}


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_that_do_not_fit(stored: Stored, name: str) -> None:
    stored.write(stored.header, **ARRAYS[name](stored.arrays))
    assert stored.attempt() is not None


HEADERS: dict[str, Callable[[str], str]] = {
    "empty": lambda text: "", "no table": lambda text: "[1]", "null": lambda text: "null", "a number": lambda text: "1" * 10_000,
    "nested": lambda text: "[" * 100_000, "nested inside": lambda text: text.replace('"changes": [',
    '"changes": [' + "[" * 900 + "]" * 900 + ", ", 1),
    "twice": lambda text: text.replace('"version": 1', '"version": 1, "version": 1', 1), "no JSON": lambda text: text[:-1],
    "a huge number": lambda text: text.replace('"version": 1', '"version": ' + "9" * 5000, 1),
    "a version of text": lambda text: text.replace('"version": 1', '"version": "1"', 1),
    "a negative version": lambda text: text.replace('"version": 1', '"version": -1', 1),
    "one more entry": lambda text: text.replace('"version": 1', '"version": 1, "os": "system"', 1),
    "NaN": lambda text: text.replace('"version": 1', '"version": NaN', 1), "a format": lambda text: text.replace("mbdae result",
    "other", 1),
}


@pytest.mark.parametrize("name", HEADERS)
def test_headers_that_do_not_fit(stored: Stored, name: str) -> None:
    changed = HEADERS[name](json.dumps(stored.header))
    assert changed != json.dumps(stored.header)
    stored.write(changed)
    assert stored.attempt() is not None


STATEMENTS: dict[str, Any] = {
    "a constructor": ["__init__", ["x"], {}], "a picture": ["draw", [MARK], {}], "a run": ["simulate", [1.0], {}],
    "inside": ["__class__", [], {}], "a private method": ["_add_body", [{"body": "crank"}], {}], "no method": [1, [], {}],
    "short": ["link"], "no arguments": ["link", {}, []], "a law that is a function": ["add", [{"class": f"{__name__}:wave"}], {}],
    "a class for a law": ["add", [{"class": "mbdae:Weld"}], {}], "nothing": ["add", [None], {}],
    "a law without places": ["add", [{"law": f"{__name__}:Rubber"}], {}],
    "a part for a law": ["add", [{"object": "mbdae:Coulomb", "fields": {"mu": 1.0, "v_c": 1.0}}], {}],
    "half a part": ["revolute", ["X", "crank", "block"], {"at": [0, 0], "radius": 1.0, "friction":
                    {"object": "mbdae:Coulomb", "fields": {"mu": 1.0}}}],
    "fields of a part": ["revolute", ["X", "crank", "block"], {"at": [0, 0], "radius": 1.0, "friction":
                         {"object": "mbdae:Coulomb", "fields": {"__class__": "x", "mu": 1.0, "v_c": 1.0}}}],
    "a method for a value": ["add", [{"law": f"{__name__}:Rubber", "name": "X", "k": "ground", "l": "block", "at": None,
    "axis": [0, 0, 1],
                                      "at_l": None, "values": {"energy": 1.0, "stiffness": 1.0}}], {}],
    "many elements": ["beam", ["X", [0, 0], [1, 0]], {"section": None, "elements": 10**9}],
    "itself": ["link", ["X", [0, 0], [1, 0]], {"self": 1, "mass": 1.0}], "a truth value": ["link", ["X", [0, 0], [1, 0]],
    {"mass": True}],
    "a body for a number": ["link", ["X", [0, 0], [1, 0]], {"mass": {"body": "ground"}}],
    "a text for a number": ["link", ["X", [0, 0], [1, 0]], {"mass": "1"}],
    "a number for a name": ["link", [1, [0, 0], [1, 0]], {"mass": 1.0}], "twice the name": ["link", ["crank", [0, 0], [1, 0]],
    {"mass": 1.0}],
}


@pytest.mark.parametrize("name", STATEMENTS)
def test_statements_that_are_none(stored: Stored, name: str) -> None:
    header = copy.deepcopy(stored.header)
    header["scene"]["statements"].append(STATEMENTS[name])
    stored.write(header)
    assert stored.attempt() is not None
