"""Pictures and films as methods of `Result`: entered from here, so that results know nothing of drawings."""

from __future__ import annotations

from mbdae.results.result import ATTACHED
from mbdae.show.animation import animate
from mbdae.show.plots import plot_orbit, plot_phase, plot_results

ATTACHED.update(plot=plot_results, phase=plot_phase, orbit=plot_orbit, animate=animate)
