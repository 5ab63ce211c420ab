"""Work-precision picture: error over CPU time and over residual evaluations, readable in grey."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mbdae.compare.rows import Row
from mbdae.results.plots import style

if TYPE_CHECKING:
    from mbdae.compare.comparison import Comparison

MARKERS = ("o", "s", "^", "D", "v", "P", "X")
PANELS = (("cpu_s", "CPU time [s]"), ("residuals", "residual evaluations"))


def work_precision(w: Comparison, path: Any = None) -> Any:
    """Two panels, one line per run; filled markers lie on the Pareto front of error and CPU time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    labels = list(dict.fromkeys(row.label for row in w.runs))
    for axis, (work, title) in zip(axes, PANELS, strict=True):
        for i, label in enumerate(labels):
            _line(axis, [row for row in w.runs if row.label == label], work, i, label)
        _dress(axis, w, title)
    axes[0].set_ylabel(_error_label(w))
    figure.suptitle(f"{w.scene}, t = 0 .. {w.t_end:g} s", fontsize="medium")
    handles, names = axes[0].get_legend_handles_labels()
    legend = {"loc": "outside lower center", "ncols": min(len(names), 4), "frameon": False, "fontsize": "small"}
    told = "filled: no other run is both cheaper in CPU time and more accurate"
    figure.legend(handles, names, title=told, title_fontsize="small", **legend)
    if path is not None:
        figure.savefig(path, dpi=150)
    return figure


def _line(axis: Any, rows: list[Row], work: str, i: int, label: str) -> None:
    points = sorted((getattr(row, work), row.error, row.pareto) for row in rows if row.measured is not None and row.error)
    failed = sum(row.failure is not None for row in rows)
    name = label + (f" ({failed} of {len(rows)} failed)" if failed else "")
    x, y = [p[0] for p in points], [p[1] for p in points]
    look = style(i)
    axis.loglog(x, y, label=name, marker=MARKERS[i % len(MARKERS)], markerfacecolor="white", markersize=6, **look)
    best = [p for p in points if p[2]]
    axis.loglog([p[0] for p in best], [p[1] for p in best], MARKERS[i % len(MARKERS)], color=look["color"], markersize=6)


def _dress(axis: Any, w: Comparison, title: str) -> None:
    _ticks(axis)
    axis.set_xlabel(title)
    axis.grid(True, which="major", color="0.9")
    axis.spines[["top", "right"]].set_visible(False)
    if w.reference.difference:
        low = axis.get_ylim()[0]
        if w.reference.difference > low:
            axis.axhspan(low, w.reference.difference, color="0.94", zorder=0, label="below the reference's own uncertainty")
            axis.set_ylim(bottom=low)


def _ticks(axis: Any) -> None:
    """Plain numbers at 1, 2, 5 of every decade, or at the decades alone where there are many."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_xlim()
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 200 * low else (1.0,)))
    axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())


def _error_label(w: Comparison) -> str:
    return f"error: {w.what}" if w.measure is not None else "error of the whole state"
