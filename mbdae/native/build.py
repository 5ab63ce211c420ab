"""Compilation of the native core into a shared library: at installation (hatch_build.py), and again in a clone whose C files
have changed since (library.py).

This module imports nothing but Python's standard library, so that it runs before anything is installed. This command compiles
by hand and shows the warnings of the compiler::

    python -m mbdae.native.build

The compiler is the one of the system, or where there is none, zig from the package index (`ziglang`, a compiler in a wheel).
`CC` names another one, such as `CC="ccache gcc"`; `MBDAE_CFLAGS` holds further flags, such as `-O0 -g`. `MBDAE_TARGET` names
another platform of TARGETS, for which zig compiles on this one.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent


class Target(NamedTuple):
    """A platform. zig: what zig compiles for; wheel: tag of a wheel with a library compiled so; suffix: of the library's file."""

    zig: str
    wheel: str
    suffix: str = ".so"


#: glibc 2.17 (manylinux2014) is old enough that the library can be loaded on every Linux with glibc for which NumPy and SciPy
#: have wheels
TARGETS = {"linux-x86_64": Target("x86_64-linux-gnu.2.17", "manylinux2014_x86_64"),
           "linux-aarch64": Target("aarch64-linux-gnu.2.17", "manylinux2014_aarch64"),
           "musl-x86_64": Target("x86_64-linux-musl", "musllinux_1_2_x86_64"),
           "musl-aarch64": Target("aarch64-linux-musl", "musllinux_1_2_aarch64"),
           "win-amd64": Target("x86_64-windows-gnu", "win_amd64", ".dll"),
           "win-arm64": Target("aarch64-windows-gnu", "win_arm64", ".dll"),
           "macosx-x86_64": Target("x86_64-macos.11.0", "macosx_11_0_x86_64", ".dylib"),
           "macosx-arm64": Target("aarch64-macos.11.0", "macosx_11_0_arm64", ".dylib")}
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
if "MBDAE_TARGET" in os.environ:
    SUFFIX = TARGETS[os.environ["MBDAE_TARGET"]].suffix
#: the shared library. It is no extension module and does not depend on the version of Python; the dot in its name keeps Python
#: from importing it as one
LIBRARY = HERE / f"mbdae.core{SUFFIX}"
#: the compiler that an installation requires from the package index where no compiler of the system works and CC names none
ZIGLANG = "ziglang==0.17.1"
#: flags with which sums, products, quotients and roots are the same to the last bit whatever the compiler: no fused multiply-add
#: (-ffp-contract=off), no -ffast-math. Instructions beyond those of the oldest supported processors are used only in second
#: versions of some functions (WIDE in core.h), which run where the processor has these instructions
FLAGS = ["-std=c11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden", "-Wall", "-Wextra", "-shared"]
TRIAL = "#include <math.h>\n#include <string.h>\ndouble trial(double x) { return sin(x); }\n"
REMEDY = ("Install a C compiler (Debian, Ubuntu: apt install gcc libc6-dev; Fedora: dnf install gcc;\n"
          f"macOS: xcode-select --install; anywhere: pip install '{ZIGLANG}'),\n"
          "or set CC to the command of a compiler that takes the flags of gcc.")


class BuildError(Exception):
    """The library could not be compiled; the text gives the commands tried, their output, and what to do."""


# -- the sources


def sources() -> list[Path]:
    """The C files; none in an installed wheel, which has only the library."""
    return sorted(HERE.glob("*.c"))


def digest() -> str:
    """Hash of all that the library depends on: C files, the files they include, this file and MBDAE_CFLAGS."""
    read = hashlib.sha256(os.environ.get("MBDAE_CFLAGS", "").encode())
    for path in [*sources(), *sorted(HERE.glob("*.h")), *sorted(HERE.glob("*.inc")), HERE / "build.py"]:
        read.update(path.name.encode() + b"\0" + path.read_bytes())
    return f"mbdae-sources:{read.hexdigest()}"


def is_current() -> bool:
    """Whether the library was compiled from the sources beside it."""
    return LIBRARY.is_file() and digest().encode() in LIBRARY.read_bytes()


# -- the compiler


def platform_name() -> str:
    """System and processor, such as linux-x86_64, musl-x86_64, win-amd64, macosx-arm64: MBDAE_TARGET, else of this Python."""
    if stated := os.environ.get("MBDAE_TARGET"):
        return stated
    name = f"macosx-{platform.machine()}" if sys.platform == "darwin" else sysconfig.get_platform()
    return name.replace("linux-", "musl-") if has_musl() else name


def has_musl() -> bool:
    """Whether this Python uses the C library musl (Alpine Linux) instead of glibc."""
    return "musl" in str(sysconfig.get_config_var("SOABI"))


def is_zig(command: list[str]) -> bool:
    """Whether a compiler command is zig, which needs the target to compile for as a flag."""
    return any(Path(part).stem in ("zig", "ziglang") for part in command)


def flags(command: list[str]) -> list[str]:
    """Flags with which a compiler command makes a shared library for this platform."""
    chosen = [*FLAGS, *([] if SUFFIX == ".dll" else ["-fPIC"])]
    if is_zig(command):
        return [*chosen, "-target", TARGETS[platform_name()].zig, "-mcpu=baseline"]
    return [*chosen, *(["-mmacosx-version-min=11.0"] if sys.platform == "darwin" else [])]


def refusal(command: list[str]) -> str:
    """Why a compiler command does not work, "" where it does: it compiles three lines of C in a temporary folder as a trial."""
    if shutil.which(command[0]) is None:
        return "not found"
    with tempfile.TemporaryDirectory(prefix="mbdae-") as folder:  # readable by this user only
        (Path(folder) / "trial.c").write_text(TRIAL, encoding="utf-8")
        done = run([*command, *flags(command), "trial.c", "-o", f"trial{SUFFIX}", "-lm"], Path(folder))
    return "" if done.returncode == 0 else f"does not compile:\n{done.stdout.strip()}"


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder and capture its output. Libraries that are preloaded into this process (those of a sanitizer) are
    not preloaded into the compiler too."""
    env = {name: value for name, value in os.environ.items() if name not in ("LD_PRELOAD", "DYLD_INSERT_LIBRARIES")}
    return subprocess.run(command, cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, encoding="utf-8", errors="replace")


def system_compilers() -> list[list[str]]:
    """Compiler commands to try: only that of CC where it is set, else those of the system, of which Windows has none."""
    if "MBDAE_TARGET" in os.environ:  # zig alone compiles for other platforms
        return []
    if stated := os.environ.get("CC", "").strip():
        return [shlex.split(stated, posix=sys.platform != "win32")]
    return [] if sys.platform == "win32" else [["cc"], ["gcc"], ["clang"]]


def compiler() -> list[str]:
    """The command of a compiler that works: one of the system, else zig where `ziglang` is installed."""
    tried = []
    for command in system_compilers():
        if not (said := refusal(command)):
            return command
        tried.append(f"{shlex.join(command)}: {said}")
    if "MBDAE_TARGET" in os.environ or not os.environ.get("CC", "").strip():
        if platform_name() not in TARGETS:
            tried.append(f"ziglang: builds nothing for {platform_name()}")
        elif importlib.util.find_spec("ziglang") is not None:
            return [sys.executable, "-m", "ziglang", "cc"]
        else:
            tried.append("ziglang: not installed")
    raise BuildError("No C compiler works for the native core of mbdae. Tried:\n  " + "\n  ".join(tried) + f"\n{REMEDY}")


def needs_ziglang() -> bool:
    """Whether an installation has to fetch a compiler: none of the system works, and CC names none."""
    stated = os.environ.get("CC", "").strip() and "MBDAE_TARGET" not in os.environ
    return not stated and platform_name() in TARGETS and all(refusal(command) for command in system_compilers())


# -- the compilation


def compile_library(command: list[str]) -> str:
    """Compile the library in place; returns the output of the compiler: its warnings.

    Several processes may do so at the same time: each compiles in a temporary folder of its own, which only this user can read,
    and moves the finished library to its place.
    """
    if not sources():
        raise BuildError(f"There are no C files in {HERE}: compile in a clone or source archive of mbdae, or install it by pip.")
    try:
        with tempfile.TemporaryDirectory(prefix=f"{LIBRARY.stem}.", dir=HERE) as folder:
            part = Path(folder, LIBRARY.name)
            done = compiled(command, part.relative_to(HERE))
            os.replace(part, LIBRARY)
    except OSError as error:
        raise BuildError(f"The library of mbdae cannot be written: {error}.\nLet this user write to the folder, and "
                         "end other Pythons that have the library open (Windows keeps an open one)") from error
    return done.stdout


def compiled(command: list[str], part: Path) -> subprocess.CompletedProcess[str]:
    """Run the compiler. part: file for the library, relative to this folder."""
    defined = f'-DMBDAE_SOURCES="{digest()}"'  # hashed first: a file changed during compilation is seen at the next use
    further = shlex.split(os.environ.get("MBDAE_CFLAGS", ""))
    names = [path.name for path in sources()]  # without folders: no path of this machine gets into the library
    whole = [*command, *flags(command), defined, *further, *names, "-o", str(part), "-lm"]
    done = run(whole, HERE)
    if done.returncode:
        said = done.stdout.strip()
        raise BuildError("\n".join([f"The native core of mbdae does not compile in {HERE}:", shlex.join(whole), said,
                                    "Correct the C file or MBDAE_CFLAGS. Where this compiler alone refuses the file, name "
                                    "another one in CC."]))
    return done


def wheel_platform(command: list[str]) -> str:
    """Platform tag of a wheel: the systems on which the library runs.

    A library compiled by zig needs glibc 2.17 or musl 1.2 or later, whatever this machine has, as the tags demand. One compiled
    by the system's compiler may need the glibc of this machine: such a wheel is tagged linux_x86_64, which the package index
    refuses.
    """
    name = platform_name()
    if name in TARGETS and (is_zig(command) or sys.platform == "darwin"):
        return TARGETS[name].wheel
    return sysconfig.get_platform().replace("-", "_").replace(".", "_")


def main() -> int:
    """Compile the library and print what was done."""
    try:
        command = compiler()
        said = compile_library(command)
    except BuildError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{said}{LIBRARY}: compiled with {shlex.join(command)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
