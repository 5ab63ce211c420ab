"""Jobs of the tests of sweeps; processes of their own import them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

LAG = 0.0  #: a constant that jobs of other files read


def product(a: float, b: float) -> dict[str, Any]:
    """A value and a list; refuses a = 2."""
    if a == 2:
        raise ValueError(f"a = {a} is not wanted")
    return {"product": a * b, "pair": [a, b], "pid": os.getpid()}


def threads(number: int) -> dict[str, Any]:
    """BLAS threads of a worker, and those of a library loaded later."""
    import scipy.linalg  # noqa: F401
    from threadpoolctl import threadpool_info

    return {"threads": max(entry["num_threads"] for entry in threadpool_info() if entry["user_api"] == "blas")}


def deadly(number: int, folder: str, always: int, wait: float = 0.05) -> dict[str, Any]:
    """Notes that it was called; number 3 kills its worker, the first time or always."""
    mark = Path(folder) / f"{number}.{time.time_ns()}"
    mark.touch()
    time.sleep(wait)
    if number == 3 and (always or len(list(Path(folder).glob("3.*"))) == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    return {"square": number * number}


def calls(folder: Path) -> list[int]:
    """Numbers `deadly` was called with."""
    return sorted(int(path.name.split(".")[0]) for path in folder.iterdir())


def largest_force(mass: float) -> dict[str, Any]:
    """The largest pin force of an engine with an elastic rod that rings, at an accuracy that suffices for its motion alone."""
    import mbdae as mb

    s = mb.Scene("engine")
    crank, ram = s.link("crank", (0, 0), (0.05, 0), mass=2.0), s.rigid_body("ram", mass, 1e-3, at=(0.25, 0))
    section = mb.Section.rectangular(0.02, 0.01, E=210e9, nu=0.3, rho=7850.0)
    rod = s.beam("rod", (0.05, 0), (0.25, 0), section=section, elements=2)
    s.revolute("A", s.ground, crank, at=(0, 0), angle=314.0 * mb.t)
    s.revolute("B", crank, rod, at=(0.05, 0))
    s.revolute("C", rod, ram, at=(0.25, 0))
    s.prismatic("D", s.ground, ram, at=(0.25, 0), axis=(1, 0, 0))
    return {"force": s.simulate(0.005, accuracy=1e-3).peak("B.force")}
