"""Pictures of sensors over time: readable in grey and by the colour-blind, a unit on every axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mbdae.notation import axis_label

#: Okabe and Ito's colours, ordered by falling contrast; the line style changes with the colour for grey prints
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 1)))


def new_figure(rows: int, width: float = 7.0, height: float = 2.4) -> tuple[Any, list[Any]]:
    """A figure with `rows` axes under each other, without touching the user's backend."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, 0.6 + height * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for a in axes:
        a.grid(True, color="0.9")
        a.spines[["top", "right"]].set_visible(False)
    return figure, list(axes)


def style(i: int) -> dict[str, Any]:
    """Colour and dash of the i-th line."""
    return {"color": COLOURS[i % len(COLOURS)], "linestyle": STYLES[i % len(STYLES)], "linewidth": 1.4}


def plot_results(results: Sequence[Any], sensors: Sequence[str], path: Any = None, labels: Sequence[str] = ()) -> Any:
    """One panel per quantity; sensors of the same quantity share it, vectors show their components."""
    by_quantity: dict[str, list[str]] = {}
    for sensor in sensors:
        by_quantity.setdefault(sensor.rpartition(".")[2], []).append(sensor)
    figure, axes = new_figure(len(by_quantity))
    for axis, (quantity, paths) in zip(axes, by_quantity.items(), strict=True):
        _draw(axis, results, paths, labels)
        axis.set_ylabel(axis_label(quantity.replace("_", " "), quantity))
        if len(axis.lines) > 1:
            axis.legend(frameon=False, fontsize="small", ncols=2)
        elif paths:
            axis.set_title(paths[0], fontsize="medium", loc="left")
    axes[-1].set_xlabel(axis_label("time", "time"))
    if path is not None:
        figure.savefig(path, dpi=150)
    return figure


def _draw(axis: Any, results: Sequence[Any], paths: Sequence[str], labels: Sequence[str]) -> None:
    line = 0
    for path in paths:
        for n, result in enumerate(results):
            values = result.read(path)
            columns = values[:, None] if values.ndim == 1 else values.reshape(len(values), -1)
            for j in range(columns.shape[1]):
                if columns.shape[1] > 1 and not np.any(columns[:, j]):
                    continue  # a planar model has no such component
                name = path + (f" {'xyz'[j]}" if columns.shape[1] == 3 else "") + (f" ({labels[n]})" if labels else "")
                axis.plot(result.t, columns[:, j], label=name, **style(line))
                line += 1


