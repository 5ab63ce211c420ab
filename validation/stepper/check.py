"""Steps of a loop of one's own against runs with a sampled controller: equal to the last bit."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from runner import Case, Claim, Found
from runs import few_and_all

import mbdae as mb

claim = Claim("stepper", "steps of s.stepper(dt) put bodies where a run whose controller sets the same values every dt puts "
              "them, to the last bit", 0.0, "bits differ in runs",
              "runs of s.controller with the solver and tolerance of the stepper")
QUICK, WHOLE = range(4), range(48)


def pendulum(s: mb.Scene, rng: np.random.Generator) -> None:
    """A driven pendulum with a damper."""
    rod = s.link("rod", (0, 0), (rng.uniform(0.5, 1.5), 0), mass=rng.uniform(0.5, 2))
    s.revolute("A", s.ground, rod, at=(0, 0), torque="u", damper=rng.uniform(0, 0.2))


def chain(s: mb.Scene, rng: np.random.Generator) -> None:
    """Three links, the second driven, with a spring."""
    bodies = [s.ground, *(s.link(f"l{n}", (n, 0), (n + 1, 0), mass=rng.uniform(0.5, 2)) for n in range(3))]
    for n in range(3):
        s.revolute(f"J{n}", bodies[n], bodies[n + 1], at=(n, 0), torque="u" if n == 1 else 0.0, spring=2.0 if n else None)


def four_bar(s: mb.Scene, rng: np.random.Generator) -> None:
    """A closed loop driven at the crank."""
    a = rng.uniform(0.2, 0.4)
    one, two, three = (s.link(name, *ends, mass=1.0) for name, ends in (
        ("a", ((0, 0), (0, a))), ("b", ((0, a), (1, 0.7))), ("c", ((1, 0.7), (1, 0)))))
    s.revolute("A", s.ground, one, at=(0, 0), torque="u")
    s.revolute("B", one, two, at=(0, a))
    s.revolute("C", two, three, at=(1, 0.7))
    s.revolute("D", three, s.ground, at=(1, 0))


def stop(s: mb.Scene, rng: np.random.Generator) -> None:
    """A pendulum between elastic stops."""
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, rod, at=(0, 0), torque="u", limits=(-rng.uniform(0.2, 0.5), 1.0), stop=mb.Stop(1e5, 20.0))


def rubbing(s: mb.Scene, rng: np.random.Generator) -> None:
    """A slider with friction."""
    body = s.rigid_body("body", 1.0, 0.1)
    s.prismatic("A", s.ground, body, at=(0, 0), axis=(1, 0, 0), force="u", friction=mb.Coulomb(rng.uniform(0.1, 0.4), 1e-2))


def top(s: mb.Scene, rng: np.random.Generator) -> None:
    """A body in space on a ball joint, pushed."""
    body = s.rigid_body("body", 1.0, (0.1, 0.2, 0.25), at=(0, 0, 1), angular_velocity=(0, 0, 10))
    s.spherical("A", s.ground, body, at=(0, 0, 0))
    s.force("push", body, (s.sensor("u"), 0, 0))


MAKE: tuple[Callable[[mb.Scene, np.random.Generator], None], ...] = (pendulum, chain, four_bar, stop, rubbing, top)
SOLVERS: tuple[Any, ...] = (mb.DOP853(rtol=1e-8), mb.RadauIIA(3, rtol=1e-7), mb.IDA(rtol=1e-7), mb.RadauIIA(2, rtol=1e-6))


def differ(seed: int) -> str:
    """How a stepper differs from the run, in words; "" where it does not."""
    make, solver, dt = MAKE[seed % len(MAKE)], SOLVERS[seed // len(MAKE) % len(SOLVERS)], (0.01, 0.003)[seed % 2]
    if isinstance(solver, mb.DOP853) and make in (rubbing, stop):
        solver = mb.RadauIIA(3, rtol=1e-7)
    values = np.random.default_rng(seed).normal(size=101) * 3
    count = 100

    def value(t: float) -> float:
        return float(values[round(t / dt)])

    def scene(controlled: bool) -> mb.Scene:
        s = mb.Scene("stepped", gravity=(0, -9.81, 0))
        make(s, np.random.default_rng(seed + 100))
        if controlled:
            s.controller("values", value, every=dt, sets=["u"])
        else:
            s.signal("u", 0.0)
        return s

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = scene(True).simulate(count * dt, solver=solver, outputs=2).solution
        step = scene(False).stepper(dt, solver=solver)
        state = None
        for n in range(count):
            step.set(u=value(step.t))
            step.advance()
            state = step.state if n == count // 2 else state
        end = step.state
        step.reset(state)
        for _ in range(count - count // 2 - 1):
            step.set(u=value(step.t))
            step.advance()
    wrong = [name for name, a in zip(step.names, end.y[0], strict=True)
             if name in run.names and not (name.startswith("u.") or a == run.y[-1, run.names.index(name)])]
    again = not np.array_equal(step.state.y, end.y)
    return f"seed {seed}: {make.__name__}, {solver}: {wrong or 'after a reset'}" if wrong or again else ""


def judge(seeds: Sequence[int]) -> Found:
    """Number of runs that differ, and which."""
    wrong = list(filter(None, map(differ, seeds)))
    return Found(len(wrong), note=" | ".join(wrong))


def cases() -> list[Case]:
    """A few seeds, and all."""
    return few_and_all(judge, QUICK, WHOLE)
