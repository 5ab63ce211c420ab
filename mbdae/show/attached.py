"""Adds plots and animations as methods of `Result`, so that the results package need not import the drawing code.

The drawing code is imported by the first picture, so that a run without pictures does not wait for it."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from mbdae.results.result import ATTACHED
from mbdae.scene.appearance import READERS


def _by(module: str, name: str) -> Callable[..., Any]:
    """A function that imports its module of this package at the first call."""
    return lambda *args, **options: getattr(import_module(f"mbdae.show.{module}"), name)(*args, **options)


ATTACHED.update(plot=_by("plots", "plot_results"), phase=_by("plots", "plot_phase"), orbit=_by("plots", "plot_orbit"),
                animate=_by("animation", "animate"))  # fmt: skip
READERS["color"] = _by("plots", "hexadecimal")
