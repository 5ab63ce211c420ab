"""Finds the folder validation/ of a checkout, with the claims and the runner that measures them; the package has neither."""

from __future__ import annotations

import importlib
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from mbdae.errors import OptionError


def find(root: str | Path | None = None) -> Path:
    """The folder validation/ of `root`, or of the working directory or one above it; OptionError where there is none."""
    here = Path.cwd() if root is None else Path(root).resolve()
    for folder in [here] if root is not None else [here, *here.parents]:
        with suppress(OSError):  # a name that is too long, or a folder that may not be read
            if any((folder / "validation").glob("*/check.py")):
                return folder / "validation"
    raise OptionError(f"there is no folder validation/ with claims in {here}{'' if root else ' or above'}: "
                      "run this in a clone of mbdae's repository, or name one by --root")  # fmt: skip


def runner_of(folder: Path) -> Any:
    """The package `runner` in a folder validation/, made importable by that name because its checks import it so."""
    if not (folder / "runner" / "__init__.py").is_file():
        raise OptionError(f"{folder} has claims, but no folder runner/ that measures them: give --root of a whole clone")
    if sys.path[:1] != [str(folder)]:
        sys.path.insert(0, str(folder))
    return importlib.import_module("runner")
