"""Pictures and films as methods of `Result`: entered from here, so that results know nothing of drawings.

What draws is imported by the first picture: a run without one does not pay for it."""

from __future__ import annotations

from typing import Any

from mbdae.results.result import ATTACHED


def _plot(*args: Any, **options: Any) -> Any:
    from mbdae.show.plots import plot_results

    return plot_results(*args, **options)


def _phase(*args: Any, **options: Any) -> Any:
    from mbdae.show.plots import plot_phase

    return plot_phase(*args, **options)


def _orbit(*args: Any, **options: Any) -> Any:
    from mbdae.show.plots import plot_orbit

    return plot_orbit(*args, **options)


def _animate(*args: Any, **options: Any) -> Any:
    from mbdae.show.animation import animate

    return animate(*args, **options)


ATTACHED.update(plot=_plot, phase=_phase, orbit=_orbit, animate=_animate)
