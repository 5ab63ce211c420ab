"""Times at which vibrations begin in a run: its start, and inputs of time that excite them by a jump or by a change shorter than
a mean step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbdae.integrators.solution import Solution
from mbdae.system.base import Array, System

MOST = 4  #: largest number of excitations considered besides the start: those that change velocities and accelerations most
#: short changes and breaks of inputs that follow each other within a mean step count as one excitation; one that lasts this many
#: mean steps or longer does not count
LONG = 50.0


def windows(system: System, run: Solution, span: float) -> Iterator[tuple[float, float]]:
    """(begin, end), s, of the parts of a run to be compared, each `span` (s) long, after its start and after its excitations."""
    for a, b in _beginnings(system, run):
        yield a, min(b + span, float(run.t[-1]))


def _beginnings(system: System, run: Solution) -> list[tuple[float, float]]:
    """(begin, end), s, of the start of a run and of its excitations."""
    t0, t1 = float(run.t[0]), float(run.t[-1])
    line = None if system.timeline is None or not t1 > t0 else system.timeline(system.t0, t1)
    if line is None:
        return [(t0, t0)]
    h = (t1 - t0) / max(run.stats.steps, 1)
    edges = line.stretches.edges
    short = np.flatnonzero(np.diff(edges) < h)
    found = np.concatenate([np.stack([edges[short], edges[short + 1]], axis=1), np.stack([line.breaks, line.breaks], axis=1)])
    found = found[(found[:, 0] > t0) & (found[:, 1] < t1)]
    clusters = _merged(found[np.argsort(found[:, 0], kind="stable")], h)
    clusters = [(a, b) for a, b in clusters if b - a < LONG * h]
    worst = sorted(clusters, key=lambda c: -_change(system, run, c, h))[:MOST]
    return [(t0, t0), *sorted(worst)]


def _merged(found: Array, near: float) -> list[tuple[float, float]]:
    """Intervals (k, 2) in order, with those closer to each other than `near` joined."""
    clusters: list[list[float]] = []
    for a, b in found.tolist():
        if clusters and a - clusters[-1][1] < near:
            clusters[-1][1] = max(b, clusters[-1][1])
        else:
            clusters.append([a, b])
    return [(a, b) for a, b in clusters]


def _change(system: System, run: Solution, excitation: tuple[float, float], h: float) -> float:
    """Largest change of a velocity, relative to its scale, during an `excitation` (begin, end), s, plus the change that the jump
    of its acceleration causes within one step h (s)."""
    velocities = np.array([kind == "v" for kind in system.kinds])
    a, b = excitation
    aside = 1e-9 * max(abs(a), abs(b), h)
    times = np.array([a - aside, b + aside])
    y, yp = run(times), run.derivative(times)
    moved = np.abs(y[1] - y[0]) + h * np.abs(yp[1] - yp[0])
    return float(np.max((moved / system.scale)[velocities], initial=0.0))


def beginning_at(system: System, run: Solution, t: float) -> System:
    """The system started at a time t (s) inside a run, with consistent values."""
    if t <= system.t0:
        return system
    system.read_at(t)
    values = system.restarted(t, run(t))
    system.read_at(None)
    other = system.starting(t, *values)
    return other if system.sampled is None else other.sampling(system.sampled.going_on(t, run.t, run.y))
