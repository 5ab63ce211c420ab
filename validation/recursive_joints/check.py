"""Recursive and kinematic joints give the same motion: index 3 against an ordinary differential equation."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
from recursive_scenes import four_bar
from runner import Case, Claim, Found
from runs import largest

import mbdae as mb

claim = Claim("recursive_joints", "recursive and kinematic joints give the same motion", 1e-8, "relative",
              "the kinematic model of the same scene; the closed form of a wheel after 10 000 turns")
BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "recursive_joints.py"
TURNS, LONG = 1e4, 10.0  # -, s


def benchmark() -> Any:
    """The module that makes the tables."""
    spec = importlib.util.spec_from_file_location("recursive_joints_benchmark", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rotor(free: bool) -> list[Found]:
    """Relative difference of the lag angles at equal steps and adaptively."""
    difference = benchmark().lag_difference
    return [Found(difference(free, mb.RadauIIA(3, step=1e-3)), quantity="equal steps"),
            Found(difference(free, mb.RadauIIA(3)), quantity="adaptive")]


def loop() -> Found:
    """Largest difference of the four angles from those in the plane."""
    scenes = four_bar("spatial", mb.Recursive()), four_bar("planar")
    a, b = (s.simulate(1.0, accuracy=1e-10, solver=mb.RadauIIA(3), outputs=51) for s in scenes)
    return Found(max(largest(a[joint].angle, b[joint].angle) for joint in "ABCD"), 1e-9, "rad")


def wheel(space: str, model: Any, solver: Any, driven: bool = True) -> Found:
    """Relative error of the angle after 10 000 turns, started at rest with a constant torque, or turning freely."""
    speed = 2 * np.pi * TURNS / LONG
    s = mb.Scene("wheel", space=space)
    body = s.rigid_body("wheel", 2.0, (0.3, 0.3, 0.5))
    start = {"torque": 0.5 * 2 * speed / LONG} if driven else {"rate0": speed}
    s.revolute("hub", s.ground, body, at=(0, 0, 0), model=model, **start)
    r = s.simulate(LONG, solver=solver, outputs=2)
    return Found(abs(r["hub"].angle[-1] / (speed * LONG) - 1), 1e-9)


def cases() -> list[Case]:
    rotors = {"driven": False, "free": True}
    steps, tolerance = mb.RadauIIA(3, step=LONG / TURNS / 20), mb.IDA(rtol=1e-8)
    wheels = [("spatial", mb.Recursive(), tolerance, True), ("planar", mb.Recursive(), tolerance, True),
              ("planar", mb.Kinematic(), tolerance, True), ("spatial", mb.Kinematic(), steps, False)]
    return [*(Case(f"{name} rotor", "RadauIIA(3)", lambda free=free: rotor(free), not free) for name, free in rotors.items()),
            Case("four-bar in space against the plane", "RadauIIA(3)", loop, slow=True),
            *(Case(f"10 000 turns, {type(run[1]).__name__.lower()}, {run[0]}", run[2].label, lambda run=run: wheel(*run),
                   slow=run[2] is steps) for run in wheels)]
