"""The files of a release: a source archive, and a wheel for every platform of mbdae/native/build.py, compiled here by zig.

    python3 .ci/release.py dist               make, check and try all, print a table
    python3 .ci/release.py dist win-amd64     the archive and this wheel alone

The archive is made twice, the second time from a copy with other times of its files: both must be the same to the last byte. A
wheel must hold a library for its platform, compiled from these sources, and what the archive has of the package besides C.
`twine` reads the description. Each wheel is then tried as far as this machine can: that of this platform by a user's first work
(versions.py --smoke); of another one a program of a few lines is compiled, which calls the library, and run by the loader of
musl, by qemu or by Wine where it is there. What was not run is named so.

The exit code is 0 where all that could be tried here works.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import venv
import zipfile
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parent.parent
sys.dont_write_bytecode = True


def module(path: Path) -> ModuleType:
    """A Python file of this checkout that belongs to no installed package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = made
    spec.loader.exec_module(made)
    return made


build, versions = module(ROOT / "mbdae" / "native" / "build.py"), module(ROOT / ".ci" / "versions.py")
#: how the file of a library begins: the format, and the processor at some byte of it
BEGINS = {"linux-x86_64": (b"\x7fELF", 18, b"\x3e\x00"), "linux-aarch64": (b"\x7fELF", 18, b"\xb7\x00"),
          "musl-x86_64": (b"\x7fELF", 18, b"\x3e\x00"), "musl-aarch64": (b"\x7fELF", 18, b"\xb7\x00"),
          "win-amd64": (b"MZ", None, b"PE\0\0\x64\x86"), "win-arm64": (b"MZ", None, b"PE\0\0\x64\xaa"),
          "macosx-x86_64": (b"\xcf\xfa\xed\xfe", 4, b"\x07\0\0\x01"), "macosx-arm64": (b"\xcf\xfa\xed\xfe", 4, b"\x0c\0\0\x01")}
#: commands that run a program of another platform here, and folders with its C library, of which one must exist
RUNNERS = {"linux-aarch64": (["qemu-aarch64-static", "qemu-aarch64"], ["-L", "/usr/aarch64-linux-gnu"]),
           "musl-x86_64": (["/lib/ld-musl-x86_64.so.1"], []), "musl-aarch64": (["/lib/ld-musl-aarch64.so.1"], []),
           "win-amd64": (["wine", "wine64", "/usr/lib/wine/wine64"], [])}
#: calls functions of the library: the values 7, 5.75 and 4.5 of a straight line between 8 and 4 at three places
PROGRAM = """
#include <stdio.h>
#include <string.h>
int mbdae_interface(void);
const char *mbdae_sources(void);
void interpolated(long long k, long long n, long long s, const long long *steps, const double *w, long long from, const double *y,
                  const double *ends, const double *inner, double *out);
int main(void) {
  long long steps[3] = {0, 0, 0};
  double w[3] = {0.25, 0.5625, 0.875}, y = 8, end = 4, inner = 0, out[3];
  interpolated(3, 1, 1, steps, w, 1, &y, &end, &inner, out);
  return !(out[0] == 7 && out[1] == 5.75 && out[2] == 4.5 && mbdae_interface() > 0 && !strcmp(mbdae_sources(), SOURCES));
}
"""


class WrongError(Exception):
    """Something of a release that is not as it must be."""


def run(*command: str | Path, cwd: Path | None = None, **further: str) -> str:
    """What a command prints; WrongError where it fails."""
    env = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "CC", "MBDAE_CFLAGS")}
    done = subprocess.run([str(c) for c in command], cwd=cwd, env=env | further, stdin=subprocess.DEVNULL, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, errors="replace")
    if done.returncode:
        raise WrongError(f"{' '.join(map(str, command[:6]))} ...:\n{done.stdout[-2000:]}")
    return done.stdout


def environment(folder: Path, *packages: str | Path) -> Path:
    """Python of a new environment with these packages."""
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages)
    return python


def archive(python: Path, folder: Path, dist: Path) -> Path:
    """The source archive, made of two copies of this tree that must give the same bytes."""
    found = []
    for name in ("first", "second"):
        tree, out = folder / name, folder / f"{name}-out"
        shutil.copytree(ROOT, tree, ignore=versions.LEFT_OUT)
        for path in tree.rglob("*") if found else []:
            os.utime(path, (1e9, 1e9))
        run(python, "-c", versions.BUILD, out, cwd=tree, SOURCE_DATE_EPOCH="1577836800")
        found.append(next(out.glob("*.tar.gz")))
    if len({path.read_bytes() for path in found}) != 1:
        raise WrongError("two source archives of the same tree differ")
    return Path(shutil.copy(found[0], dist))


def wheel(python: Path, source: Path, folder: Path, dist: Path, target: str) -> Path:
    """The wheel of a platform, made from the source archive and looked into."""
    with tarfile.open(source) as packed:
        packed.extractall(folder, filter="data")
    tree = folder / source.name.removesuffix(".tar.gz")
    run(python, "-c", "import sys; from hatchling import build; build.build_wheel(sys.argv[1])", dist, cwd=tree,
        MBDAE_TARGET=target, SOURCE_DATE_EPOCH="1577836800")
    tag, suffix = build.TARGETS[target].wheel, build.TARGETS[target].suffix
    made = next(dist.glob(f"*-py3-none-{tag}.whl"))
    with zipfile.ZipFile(made) as z:
        names, library = set(z.namelist()), z.read(f"mbdae/native/mbdae.core{suffix}")
    magic, at, processor = BEGINS[target]
    if not library.startswith(magic) or not (processor in library if at is None else library[at:].startswith(processor)):
        raise WrongError(f"{made.name}: its library is none of {target}")
    if build.digest().encode() not in library:
        raise WrongError(f"{made.name}: its library is not compiled from these sources")
    files = [p for p in (tree / "mbdae").rglob("*") if p.is_file() and p.suffix not in (".c", ".h")]
    if lacking := {p.relative_to(tree).as_posix() for p in files} - names:
        raise WrongError(f"{made.name} lacks {sorted(lacking)[:5]}")
    return made


def tried(python: Path, made: Path, folder: Path, target: str) -> str:
    """What became of a wheel that was run; why it was not."""
    if target == build.platform_name():
        return first_work(made, folder)
    commands, options = RUNNERS.get(target, ([], []))
    runner = next((found for name in commands if (found := shutil.which(name))), None)
    folders = [Path(option) for option in options if option.startswith("/")]
    if runner is None or not all(path.exists() for path in folders):
        return f"not run: no {commands[0] if runner is None else folders[0]} here" if commands else "not run on this machine"
    folder.mkdir(exist_ok=True)
    with zipfile.ZipFile(made) as z:
        library = f"mbdae.core{build.TARGETS[target].suffix}"
        (folder / library).write_bytes(z.read(f"mbdae/native/{library}"))
    (folder / "program.c").write_text(PROGRAM, encoding="utf-8")
    program = "program.exe" if target.startswith("win") else "program"
    run(python, "-m", "ziglang", "cc", "-O2", "-target", build.TARGETS[target].zig, f'-DSOURCES="{build.digest()}"', "program.c",
        library, "-Wl,-rpath,$ORIGIN", "-o", program, cwd=folder)
    begin = time.monotonic()
    settings = {"WINEDEBUG": "-all", "WINEPREFIX": str(folder / "wine"), "LD_LIBRARY_PATH": str(folder)}
    run(runner, *options, f"./{program}", cwd=folder, **settings)
    return f"its library answers ({Path(runner).name}, {time.monotonic() - begin:.1f} s)"


def first_work(made: Path, folder: Path) -> str:
    """A user's first work with the wheel, in an environment with nothing else."""
    python = environment(folder / "env", made)
    place = folder / "elsewhere"
    place.mkdir()
    shutil.copy(ROOT / "examples" / "ground_resonance.py", place)
    return "first work: " + run(python, "-c", versions.SMOKE, cwd=place, MPLBACKEND="Agg").split(" from ")[0].splitlines()[-1]


def main() -> int:
    """Make the files asked for in a folder, print what became of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dist", type=Path, metavar="FOLDER", help="for the files; must be empty or not exist")
    parser.add_argument("targets", nargs="*", metavar="PLATFORM", help=f"{', '.join(build.TARGETS)}; all where none is given")
    a = parser.parse_args()
    if wrong := [name for name in a.targets if name not in build.TARGETS]:
        parser.error(f"there is no platform {wrong[0]!r}: choose from {', '.join(build.TARGETS)}")
    dist = a.dist.resolve()
    dist.mkdir(parents=True, exist_ok=True)
    if any(dist.iterdir()):
        parser.error(f"{dist} is not empty")
    rows: list[tuple[str, str]] = []
    failed = False
    with tempfile.TemporaryDirectory(prefix="mbdae-release-") as scratch:
        python = environment(Path(scratch, "tools"), "hatchling>=1.27", "twine>=6.1", build.ZIGLANG)
        source = archive(python, Path(scratch), dist)
        rows.append((source.name, "the same bytes twice"))
        for target in a.targets or build.TARGETS:
            try:
                made = wheel(python, source, Path(scratch, f"of-{target}"), dist, target)
                rows.append((made.name, tried(python, made, Path(scratch, f"try-{target}"), target)))
            except WrongError as wrong:
                failed = True
                rows.append((target, f"FAILED: {wrong}"))
            print(": ".join(rows[-1]), flush=True)
        run(python, "-m", "twine", "check", "--strict", *sorted(dist.iterdir()))
    width = max(len(name) for name, _ in rows)
    print()
    for name, said in rows:
        size = f"{(dist / name).stat().st_size / 1e6:6.2f} MB" if (dist / name).is_file() else ""
        mark = hashlib.sha256((dist / name).read_bytes()).hexdigest()[:12] if size else ""
        print(f"{name:{width}}  {size:9}  {mark:12}  {said}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
