"""Comparisons and maps of extremes for a FILE with scene() and, where it states them, runs, measure, vary and accuracy."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from mbdae.compare import compare
from mbdae.compare.page import Comparison
from mbdae.extremes import extremes
from mbdae.extremes.page import Extremes
from mbdae.run.checkpoint import bar


def compare_file(module: ModuleType, scene: Any, t_end: float, **options: Any) -> Comparison:
    """The comparison, with a progress bar on a terminal; for options that are None the file's or the default values are used."""
    stated = _stated(module, ("runs", "measure"))
    found: Comparison = _with_bar(compare, "compare", scene, t_end, stated | _given(options))
    return found


def map_of_file(module: ModuleType, t_end: float, **options: Any) -> Extremes:
    """The map of extremes, with a progress bar and options as in `compare_file`."""
    stated = _stated(module, ("vary", "runs", "measure", "accuracy"))
    found: Extremes = _with_bar(extremes, "extremes", module.scene, t_end, stated | _given(options))
    return found


def _stated(module: ModuleType, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(module, name) for name in names if hasattr(module, name)}


def _given(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _with_bar(work: Any, name: str, scene: Any, t_end: float, options: dict[str, Any]) -> Any:
    shown = bar()
    try:
        return work(scene, t_end, progress=lambda done, total, label: shown.show(done / total, name, label), **options)
    finally:
        shown.close()
