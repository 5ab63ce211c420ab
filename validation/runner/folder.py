"""The claims of a folder validation/: one folder each, with README.md and check.py."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from mbdae.errors import OptionError
from runner.claim import Case, Claim, Row, measure
from runner.draw import Draw


@dataclass(frozen=True)
class Check:
    """A claim as its check.py states it; `during`, where it has one, measures for so many hours, see `load`."""

    claim: Claim
    cases: Callable[[], list[Case]]
    during: Callable[[], list[Row]] | None = None

    def run(self, draw: Draw | None = None) -> list[Row]:
        """Measure all cases, of suites what `draw` takes; OptionError where it names parts that there are not."""
        if self.during is not None:
            return self.during()
        cases = self.cases()
        unknown = set(draw.only if draw else ()).difference(str(part) for case in cases for part in case.parts)
        if unknown:
            some = ", ".join(str(part) for case in cases for part in case.parts[:3])
            raise OptionError(f"claim '{self.claim.name}' has no part {', '.join(sorted(unknown))}: "
                              + (f"its parts are {some}, ..." if some else "it has no suites"))
        return measure(self.claim, cases, draw)


def claims(folder: Path) -> list[str]:
    """Names of all claims, sorted."""
    return sorted(path.parent.name for path in folder.glob("*/check.py"))


def check_name(folder: Path, name: str) -> None:
    """OptionError where there is no claim of that name."""
    known = claims(folder)
    if name not in known:
        raise OptionError(f"there is no claim '{name}': choose from {', '.join(known)}")


def module_of(folder: Path, name: str) -> Any:
    """The module check.py of one claim; OptionError where there is none of that name."""
    check_name(folder, name)
    spec = importlib.util.spec_from_file_location(f"validation_{name}", folder / name / "check.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def load(folder: Path, name: str, hours: float | None = None, out: Path | None = None) -> Check:
    """What check.py of one claim states. With `hours`, its `during(hours, out)` measures: for so long, going on from what a
    folder `out` has of it; OptionError where the claim has an end of its own."""
    module = module_of(folder, name)
    if module.claim.name != name:
        raise OptionError(f"validation/{name}/check.py states the claim '{module.claim.name}': give it the folder's name")
    if hours is not None and not hasattr(module, "during"):
        raise OptionError(f"claim '{name}' has an end of its own: --hours is for claims that draw scenes, such as strangers")
    return Check(module.claim, module.cases, None if hours is None else partial(module.during, hours, out))
