"""The native core becomes a library: compiled in place, again where its sources changed, with errors that say what to do."""

from __future__ import annotations

import ctypes
import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from mbdae import native as module
from mbdae.errors import LibraryError
from mbdae.native import build as installed

ROOT = Path(__file__).resolve().parents[2]


def loaded(folder):
    """build.py of a folder, as hatch_build.py loads it."""
    spec = importlib.util.spec_from_file_location("native_build", folder / "build.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


@pytest.fixture
def copy(tmp_path, monkeypatch):
    """A copy of build.py and of a C file, without a library."""
    for name in ("build.py", "version.c", "core.h"):
        shutil.copy(ROOT / "mbdae" / "native" / name, tmp_path)
    for name in ("CC", "MBDAE_CFLAGS"):
        monkeypatch.delenv(name, raising=False)
    return loaded(tmp_path)


@pytest.fixture
def command(copy):
    """A compiler that works."""
    try:
        return copy.compiler()
    except copy.BuildError:
        pytest.skip("no C compiler")


def test_the_library_opens_and_fits_its_python_files():
    opened = module.library()
    assert opened.mbdae_interface() == module.INTERFACE
    assert not installed.sources() or installed.is_current()


def test_a_library_is_compiled_in_place_and_knows_its_sources(copy, command, monkeypatch):
    assert not copy.is_current()
    assert copy.compile_library(command) == ""
    assert copy.is_current()
    opened = ctypes.CDLL(str(copy.LIBRARY))
    opened.mbdae_sources.restype = ctypes.c_char_p
    assert opened.mbdae_sources().decode() == copy.digest()
    assert str(copy.HERE).encode() not in copy.LIBRARY.read_bytes()
    assert {path.name for path in copy.HERE.iterdir()} >= {"build.py", "core.h", "version.c", copy.LIBRARY.name}
    assert not [path for path in copy.HERE.iterdir() if path.is_dir() and path.name != "__pycache__"]
    monkeypatch.setenv("MBDAE_CFLAGS", "-g")
    assert not copy.is_current()
    monkeypatch.delenv("MBDAE_CFLAGS")
    with (copy.HERE / "core.h").open("a", encoding="utf-8") as header:
        header.write("/* changed */\n")
    assert not copy.is_current()


def test_processes_that_compile_at_once_do_not_disturb_each_other(copy, command):
    started = [subprocess.Popen([sys.executable, str(copy.HERE / "build.py")], stdout=subprocess.PIPE) for _ in range(2)]
    assert all(process.communicate()[0] and process.returncode == 0 for process in started)
    assert copy.is_current()


def test_an_error_of_the_compiler_is_shown_and_the_library_stays(copy, command):
    copy.compile_library(command)
    before = copy.LIBRARY.read_bytes()
    (copy.HERE / "wrong.c").write_text("int wrong(\n", encoding="utf-8")
    with pytest.raises(copy.BuildError, match=r"(?s)does not compile in.*wrong\.c:1.*Correct the C file"):
        copy.compile_library(command)
    assert copy.LIBRARY.read_bytes() == before


def test_a_compiler_named_in_cc_is_not_passed_over(copy, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler -m64")
    assert not copy.needs_ziglang()
    with pytest.raises(copy.BuildError, match=r"(?s)Tried:\n  no-such-compiler -m64: not found\n.*set CC"):
        copy.compiler()


@pytest.mark.skipif(installed.platform_name() not in installed.TARGETS, reason="zig is not set up for this platform")
def test_zig_is_asked_for_where_no_compiler_works(copy, monkeypatch):
    monkeypatch.setattr(copy.shutil, "which", lambda name: None)
    monkeypatch.setattr(copy.importlib.util, "find_spec", lambda name: None)
    assert copy.needs_ziglang()
    with pytest.raises(copy.BuildError, match=r"(?s)ziglang: not installed\nInstall a C compiler.*pip install 'ziglang==[\d.]+'"):
        copy.compiler()
    monkeypatch.setattr(copy.importlib.util, "find_spec", lambda name: object())
    assert copy.compiler() == [sys.executable, "-m", "ziglang", "cc"]


def test_a_compiler_without_headers_of_c_does_not_count(copy, tmp_path, monkeypatch):
    broken = tmp_path / "broken.py"
    broken.write_text("import sys\nsys.exit('math.h: No such file')\n", encoding="utf-8")
    assert re.match(r"does not compile:\nmath\.h", copy.refusal([sys.executable, str(broken)]))


def test_the_name_of_a_wheel_says_where_it_runs(copy, monkeypatch):
    monkeypatch.delenv("MBDAE_TARGET", raising=False)
    monkeypatch.setattr(copy.sys, "platform", "linux")
    monkeypatch.setattr(copy.sysconfig, "get_platform", lambda: "linux-x86_64")
    monkeypatch.setattr(copy, "has_musl", lambda: False)
    zig = [sys.executable, "-m", "ziglang", "cc"]
    assert copy.wheel_platform(["cc"]) == "linux_x86_64"
    assert copy.wheel_platform(zig) == "manylinux2014_x86_64"
    monkeypatch.setattr(copy, "has_musl", lambda: True)
    assert copy.wheel_platform(zig) == "musllinux_1_2_x86_64"
    assert "x86_64-linux-musl" in copy.flags(zig)
    assert copy.wheel_platform(["cc"]) == "linux_x86_64"


def test_zig_alone_compiles_for_another_platform(copy, monkeypatch):
    monkeypatch.setenv("MBDAE_TARGET", "win-amd64")
    monkeypatch.setenv("CC", "cc")
    there = loaded(copy.HERE)
    assert there.LIBRARY.name == "mbdae.core.dll"
    assert there.system_compilers() == []
    assert there.needs_ziglang()
    zig = [sys.executable, "-m", "ziglang", "cc"]
    assert there.wheel_platform(zig) == "win_amd64"
    assert there.flags(zig)[-3:] == ["-target", "x86_64-windows-gnu", "-mcpu=baseline"]
    assert "-fPIC" not in there.flags(zig)


def test_a_library_that_cannot_be_had_is_an_error_of_mbdae(copy, monkeypatch, tmp_path):
    monkeypatch.setattr(module, "build", copy)
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(LibraryError, match=r"(?s)was not compiled yet.*no-such-compiler: not found"):
        module.library.__wrapped__()
    monkeypatch.setattr(copy, "sources", list)  # as in an installed wheel
    with pytest.raises(LibraryError, match=r"cannot be opened.*Install mbdae again"):
        module.library.__wrapped__()


def test_a_library_of_another_version_is_refused(monkeypatch):
    monkeypatch.setattr(module, "INTERFACE", -1)
    with pytest.raises(LibraryError, match="of different versions"):
        module.library.__wrapped__()
