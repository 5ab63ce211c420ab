"""Exported C, compiled by every compiler at hand with all warnings as errors, and called."""

from __future__ import annotations

import ctypes
import importlib.util
import shutil
import subprocess
import sys

import numpy as np
import pytest

FLAGS = ["-std=c99", "-O1", "-Wall", "-Wextra", "-pedantic", "-Werror"]
COMPILERS = [[name] for name in ("gcc", "clang") if shutil.which(name)]
if importlib.util.find_spec("ziglang"):  # clang in a wheel
    COMPILERS.append([sys.executable, "-m", "ziglang", "cc", "-fno-sanitize=undefined"])


@pytest.fixture
def compiled(tmp_path):
    """Export of format "c" -> function (name, **vectors) -> outputs."""
    if not COMPILERS:
        pytest.skip("no gcc or clang")

    def load(export):
        export.save(tmp_path / "code.c")
        (tmp_path / "use.c").write_text('#include "code.h"\n#include "code.c"\n', encoding="utf-8")
        made = tmp_path / "made.so"
        for number, compiler in enumerate(COMPILERS):  # the code alone, and with its own declarations; code is made once
            subprocess.run([*compiler, *FLAGS, "-fsyntax-only", "code.c"], cwd=tmp_path, check=True)
            make = ["-fsyntax-only"] if number else ["-shared", "-fPIC", "-o", made, "-lm"]
            subprocess.run([*compiler, *FLAGS, "use.c", *make], cwd=tmp_path, check=True)
        library = ctypes.CDLL(str(made))

        def call(name, **vectors):
            out = np.full(len(export.outputs[name]), np.nan)
            arrays = {v: np.array(vectors[v], dtype=float) for v in export.arguments[name]}
            pointer = ctypes.POINTER(ctypes.c_double)
            given = [ctypes.c_double(a) if v == "t" else a.ctypes.data_as(pointer) for v, a in arrays.items()]
            assert getattr(library, export[name])(*given, out.ctypes.data_as(pointer)) == 0
            return out

        return call

    return load
