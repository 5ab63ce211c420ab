"""What the guard between the points of a run finds, and how often it calls without need.

    python benchmarks/defect.py [--cases N]     (default 400, about five minutes)

Wrong runs: seeded scenes at rest and in motion, in which a load, torque, drive, line load or a user's law in space acts for a
short time, placed at random into the steps of a run; widths of 0.01 to 1 of the step. A run counts as wrong where it is off a
closely followed reference by more than ten times its accuracy. Printed: the share of wrong runs that were told, by width over
the step that missed it, by kind of input and by solver.
"""

from __future__ import annotations

import argparse
import warnings
from collections import defaultdict
from itertools import pairwise
from typing import Any

import numpy as np
import symengine as se
import sympy as sp

import mbdae as mb
from mbdae.system import scene_system

WRONG = 10.0  #: error over accuracy
EDGES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
NAMED = "was not evaluated there"  #: words of the guard's warning
t = mb.t


def box(c, w):
    return sp.Piecewise((0, t < c - w / 2), (1, t < c + w / 2), (0, True))


def squared_sine(c, w):
    return sp.Piecewise((0, t < c - w / 2), (sp.cos(sp.pi * (t - c) / w) ** 2, t < c + w / 2), (0, True))


def bell(c, w):
    """Half as high at c - w/2 and c + w/2."""
    return sp.exp(-(((t - c) / (0.6 * w)) ** 2))


def window(c, w):
    return (sp.tanh(20 * (t - c + w / 2) / w) - sp.tanh(20 * (t - c - w / 2) / w)) / 2


def ramps(c, w):
    return sp.Piecewise((0, t < c - w / 2), (1 + 2 * (t - c) / w, t < c), (1 - 2 * (t - c) / w, t < c + w / 2), (0, True))


def chirp(c, w):
    return squared_sine(c, w) * sp.cos(6 * (t - c) / w + 20 * ((t - c) / w) ** 2)


INPUTS = {f.__name__: f for f in (box, squared_sine, bell, window, ramps, chirp)}


class Barrier(mb.Force):
    """A bell-shaped potential ahead of a body."""

    params = mb.params(height=("J", "height"), at_x=("m", "place"), width=("m", "width"))

    def energy(self, k: Any, l: Any) -> Any:
        return self.height * se.exp(-(((((l.r - k.r) @ k.x) - self.at_x) / self.width) ** 2))


def free(f, size, rest):
    """A free body that is pushed."""
    s, velocity = mb.Scene("free"), (0, 0, 0) if rest else (1.0, 0.5, 0)
    b = s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 0), velocity=velocity, angular_velocity=(0, 0, 0.3))
    s.force("F", b, (size * f, 0, 0.5 * size * f))
    return s, 10.0


def slide(f, size, rest):
    """A mass on a spring along a slide."""
    s = mb.Scene("slide")
    b = s.rigid_body("b", 1.0, 1.0, at=(0, 0))
    s.prismatic("P", s.ground, b, at=(0, 0), axis=(1, 0, 0), spring=2.0, damper=0.1, rate0=0.0 if rest else 1.0)
    s.force("F", b, (size * f, 0, 0))
    return s, 20.0


def pendulum(f, size, rest):
    """A rod with a torque at its hinge."""
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    b = s.link("b", (0, 0), (0, -1) if rest else (1, 0), mass=1.0)
    s.revolute("A", s.ground, b, at=(0, 0), torque=5 * size * f)
    return s, 6.0


def double(f, size, rest):
    """Two rods in space, pushed sideways."""
    s = mb.Scene("double", gravity=(0, 0, -9.81))
    ends = [(0, 0, 0), (0, 0, -1), (0, 0, -2)] if rest else [(0, 0, 0), (1, 0, 0), (1.5, 0.5, 0)]
    a = s.rigid_body("a", 1.0, (0.1, 0.1, 0.02), at=np.mean(ends[:2], axis=0))
    b = s.rigid_body("b", 0.7, (0.1, 0.1, 0.1), at=np.mean(ends[1:], axis=0))
    s.revolute("A", s.ground, a, at=ends[0], axis=(0, 1, 0))
    s.spherical("B", a, b, at=ends[1])
    s.force("F", b, (0, 10 * size * f, 5 * size * f), at=ends[2])
    return s, 3.0


def car(f, size, rest):
    """A body on a spring over a road that rises (smoothly: the input squared)."""
    s = mb.Scene("car", gravity=(0, -9.81, 0))
    road, b = s.rigid_body("road", 1.0, 1.0, at=(0, 0)), s.rigid_body("b", 300.0, 1.0, at=(0, 0.5))
    s.prismatic("R", s.ground, road, at=(0, 0), axis=(0, 1, 0), position=0.1 * size * f**2)
    s.prismatic("B", s.ground, b, at=(0, 0.5), axis=(0, 1, 0), rate0=0.0 if rest else 0.5)
    s.spring("k", road, b, at_k=(0, 0), at_l=(0, 0.5), stiffness=18e3, damping=1500.0, length=0.5 + 300 * 9.81 / 18e3)
    return s, 10.0


def four_bar(f, size, rest):
    """A four-bar with a torque on its rocker."""
    s = mb.Scene("four-bar", gravity=(0, 0, 0) if rest else (0, -9.81, 0))
    A, B, C, D = (0, 0), (0.1, 0.17320508), (0.5, 0.4), (0.6, 0)
    parts = [s.link(n, p, q, mass=m) for n, p, q, m in (("a", A, B, 0.3), ("b", B, C, 0.6), ("c", C, D, 0.5))]
    s.revolute("A", s.ground, parts[0], at=A)
    s.revolute("B", *parts[:2], at=B)
    s.revolute("C", *parts[1:], at=C)
    s.revolute("D", parts[2], s.ground, at=D, torque=size * f)
    return s, 2.0


def beam(f, size, rest):
    """A cantilever with a load along it."""
    s = mb.Scene("beam", gravity=(0, 0, 0) if rest else (0, -9.81, 0))
    b = s.beam("b", (0, 0), (1, 0), section=mb.Section.rectangular(0.02, 0.02, E=1e7, nu=0.3, rho=1000, damping=1e-2), elements=2)
    s.weld("A", s.ground, b, at=(0, 0))
    s.line_load("q", b, (0, 3 * size * f, 0))
    return s, 2.0


def barrier(f, size, rest):
    """A body that meets a barrier at the place f[0] of width f[1]; always moving."""
    s = mb.Scene("barrier")
    b = s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.prismatic("P", s.ground, b, at=(0, 0, 0), axis=(1, 0, 0), rate0=1.0)
    place, width = f if isinstance(f, tuple) else (1.0, 1.0)
    s.add(Barrier("W", s.ground, b, at=(0, 0, 0), at_l=(0, 0, 0), height=size, at_x=place, width=0.6 * width))
    return s, 10.0


SCENES = (free, slide, pendulum, double, car, four_bar, beam, barrier)


def solvers(make, end):
    """Solvers that take a scene."""
    steps = [mb.RadauIIA(3, step=end / 40), mb.HHT(step=end / 150)]
    every = [None, None, mb.RadauIIA(3), mb.RadauIIA(2), mb.RadauIIA(3, rtol=1e-5), *steps]
    return every if make is beam else [*every, mb.IDA(), mb.IDA(rtol=1e-7), mb.CVODE(), mb.CVODE(method="BDF")]


def reference(s, end, c, w):
    """The run in three parts: up to the input, through it in steps of a fortieth of its width, and on."""
    r, parts, fine = None, [], mb.RadauIIA(3, rtol=1e-9)
    for until, solver in ((c - 3 * w, fine), (c + 3 * w, mb.RadauIIA(3, step=w / 40)), (end, fine)):
        if until > (r.t[-1] if r else 0.0) + 1e-9 and (r is None or r.t[-1] < end):
            r = s.simulate(min(until, end), solver=solver, start=r)
            parts.append(r)
    return parts


def error(run, parts):
    """Largest difference of positions (over the length) and velocities (over length / characteristic time)."""
    p, worst = run.prepared, 0.0
    for part in parts:
        times = np.linspace(max(part.t[0], run.t[0]), part.t[-1], 60)
        a, b = run(times), part(times)
        speed = max(p.length / p.time, float(np.max([np.abs(run[n].velocity).max() for n in names(run)])))
        for n in names(run):
            worst = max(worst, float(np.abs(a[n].position - b[n].position).max()) / p.length)
            if not p.model.lines:
                worst = max(worst, float(np.abs(a[n].velocity - b[n].velocity).max()) / speed)
    return worst


def names(run):
    return ["b.at(1)"] if run.prepared.model.lines else [body.name for body in run.prepared.model.scene.bodies]


def case(seed):
    """One run with an input in one of its steps: (scene, input, solver, width over step, error over accuracy, told); told is
    None where the run is not reliable by its energy, which is told already."""
    rng = np.random.default_rng(seed)
    make = SCENES[seed % len(SCENES)]
    kind = str(rng.choice(["squared_sine", "bell", "chirp"] if make is car else list(INPUTS)))  # drives must not jump
    rest, accuracy = bool(rng.integers(2)), float(10.0 ** -rng.integers(4, 8))
    silent, end = make(0.0 * t, 1.0, rest) if make is not barrier else make(None, 0.0, rest)
    choice = solvers(make, end)
    solver = choice[int(rng.integers(len(choice)))]
    options = {"solver": solver, "accuracy": accuracy}
    if isinstance(solver, mb.CVODE) and silent.check().unknowns["multipliers"]:
        options["form"] = mb.Index1()
    plain = silent.simulate(end, **options).solution.t
    c = float(rng.uniform(0.1, 0.9)) * end
    h = float(np.diff(plain)[np.searchsorted(plain, c) - 1])
    w, size = h * float(10 ** rng.uniform(-2, -0.1)), float(10 ** rng.uniform(-0.5, 0.7))
    s, _ = make((c, w) if make is barrier else INPUTS[kind](c, w), size, rest)
    r = s.simulate(end, **options)
    asked = accuracy if solver is None or (solver.rtol is None and not solver.fixed) else 10 * (solver.rtol or 1e-6)
    off = error(r, reference(s, end, c, w)) / asked
    if solver is not None and solver.fixed:  # what the method itself is off
        off -= error(silent.simulate(end, **options), [silent.simulate(end, 1e-8, solver=mb.RadauIIA(3))]) / asked
    steps = r.solution.t
    here = float(np.diff(steps)[min(np.searchsorted(steps, c) - 1, len(steps) - 2)])
    told = any(NAMED in note for note in r.warnings) if r.info.reliable else None
    return make.__name__, "law" if make is barrier else kind, solver.label if solver else "default", w / here, off, told


def table(title, rows, key, order=None):
    found = defaultdict(list)
    for row in rows:
        found[key(row)].append(row[5])
    print(f"\n| {title} | wrong runs | told |\n|---|---|---|")
    for k in order or sorted(found):
        if found[k]:
            print(f"| {k} | {len(found[k])} | {100 * np.mean(found[k]):.1f} % |")


def between(row):
    i = int(np.clip(np.searchsorted(EDGES, row[3]) - 1, 0, len(EDGES) - 2))
    return f"{EDGES[i]:g} to {EDGES[i + 1]:g}"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--verbose", action="store_true")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    scene_system.WATCH_INPUTS_AND_SWITCHES = False  # what the look between the points finds alone
    rows, refused, right, others = [], 0, 0, 0
    for seed in range(given.first, given.first + given.cases):
        try:
            row = case(seed)
        except mb.MbdaeError as e:
            refused += 1
            if given.verbose:
                print(seed, "refused", str(e)[:150].replace("\n", " "))
            continue
        if given.verbose:
            print(seed, *row, flush=True)
        if row[5] is None or row[3] > 1:
            others += 1
        elif row[4] > WRONG:
            rows.append(row)
        else:
            right += 1
            if row[5]:
                print("told although the error is", f"{row[4]:.2g}", "times the accuracy:", seed, row)
    told = f"{others} told by their energy or with steps shorter than the input"
    print(f"{given.cases} runs: {refused} refused, {right} not wrong, {told}, {len(rows)} wrong")
    table("width over step", rows, between, [f"{a:g} to {b:g}" for a, b in pairwise(EDGES)])
    wide = [row for row in rows if row[3] > 0.1]
    table("input wider than a tenth of the step", wide, lambda row: row[1])
    table("solver, the same", wide, lambda row: row[2])
    table("scene, the same", wide, lambda row: row[0])
    print(f"\nwider than a tenth: {100 * np.mean([row[5] for row in wide]):.1f} % of {len(wide)}")


if __name__ == "__main__":
    main()
