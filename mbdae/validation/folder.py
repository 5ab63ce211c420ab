"""The folder validation/ of a checkout: one claim per folder, each with README.md and check.py."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mbdae.errors import OptionError
from mbdae.validation.claim import Case, Claim, Row


@dataclass(frozen=True)
class Check:
    """A claim as its check.py states it: `run` measures all of its cases."""

    claim: Claim
    cases: Callable[[], list[Case]]
    run: Callable[[], list[Row]]


def find(root: str | Path | None = None) -> Path:
    """The folder validation/ of `root`, or of the working directory and those above it."""
    here = Path.cwd() if root is None else Path(root).resolve()
    for folder in [here] if root is not None else [here, *here.parents]:
        with suppress(OSError):  # a name too long, a folder that may not be read
            if any((folder / "validation").glob("*/check.py")):
                return folder / "validation"
    raise OptionError(f"there is no validation/ with claims in {here}{'' if root else ' or above'}: "
                      "run it from a checkout, or give --root")  # fmt: skip


def claims(folder: Path) -> list[str]:
    """Names of all claims, sorted."""
    return sorted(path.parent.name for path in folder.glob("*/check.py"))


def load(folder: Path, name: str) -> Check:
    """The check of one claim; checks import what they share from `folder`."""
    known = claims(folder)
    if name not in known:
        raise OptionError(f"there is no claim '{name}': choose from {', '.join(known)}")
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    spec = importlib.util.spec_from_file_location(f"validation_{name}", folder / name / "check.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if module.claim.name != name:
        raise OptionError(f"validation/{name}/check.py states the claim '{module.claim.name}': give it the folder's name")
    return Check(module.claim, module.cases, module.run)
