"""Versions of software, and the number of CPUs, of a run; nothing identifies the computer or its user."""

from __future__ import annotations

import os

PACKAGES = ("mbdae", "numpy", "scipy", "scikit-sundae", "symengine")


def environment() -> dict[str, str | int]:
    """Versions of Python and of the numerical packages, operating system, processor type, and CPUs this process may use."""
    import platform

    found: dict[str, str | int] = {"python": platform.python_version()}
    found |= {name: _version(name) for name in PACKAGES}
    return found | {"machine": f"{platform.system()} {platform.machine()}", "cpus": _cpus()}


def versions() -> dict[str, str | int]:
    """What may change the last digits of a result: `environment` without the number of CPUs."""
    return {name: value for name, value in environment().items() if name != "cpus"}


def _version(package: str) -> str:
    # imported here because it imports e-mail and sockets too, which takes 0.02 s
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"


def _cpus() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
