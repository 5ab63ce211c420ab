"""Pictures and films as methods of `Result`: entered from here, so that results know nothing of drawings.

What draws is imported by the first picture: a run without one does not pay for it."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from mbdae.results.result import ATTACHED
from mbdae.scene.appearance import READERS


def _by(module: str, name: str) -> Callable[..., Any]:
    """A function of a module of this package, which its first call imports."""
    return lambda *args, **options: getattr(import_module(f"mbdae.show.{module}"), name)(*args, **options)


ATTACHED.update(plot=_by("plots", "plot_results"), phase=_by("plots", "plot_phase"), orbit=_by("plots", "plot_orbit"),
                animate=_by("animation", "animate"))  # fmt: skip
READERS["color"] = _by("plots", "hexadecimal")
