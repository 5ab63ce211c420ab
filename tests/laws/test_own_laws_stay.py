"""What a user hands over stays as it is: no call of mbdae hangs anything onto a law, a part, their classes or a curve."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import symengine as se

import mbdae as mb


class Smooth(mb.Friction):
    params = mb.params(mu="1")

    def coefficient(self, v: Any) -> Any:
        return self.mu * se.tanh(v / 0.1)


class Drag(mb.Force):
    params = mb.params(c="N s/m")
    options = ("friction",)

    def wrench(self, k: Any, l: Any) -> Any:
        v = l.v - k.v
        return v * (-self.c - self.friction.coefficient(v[0])), 0 * v


class Pin(mb.Joint):
    params = mb.params(length="m")

    def constraints(self, k: Any, l: Any) -> Any:
        return {"length": (l.r - k.r).norm() - self.length}

    def undefined_at(self) -> Any:
        return ("points together",)


def arch(s: float) -> Any:
    return s, 0.1 * np.sin(np.pi * s)


def contents(things: list[Any]) -> list[dict[str, Any]]:
    """Attributes of all objects; arrays as lists, so that values are compared; names of Python's own left out."""

    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray) else dict(value) if isinstance(value, dict) else value

    return [{name: plain(value) for name, value in vars(thing).items() if name[:2] != "__"} for thing in things]


def test_no_call_changes_what_is_handed_over(tmp_path: Path) -> None:
    s = mb.Scene("swing", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.rigid_body("bob", 0.1, 0.01, at=(1.5, 0))
    strip = s.beam("strip", section=mb.Section.circular(0.01, 1e9, 0.3, 1e3), curve=arch, elements=2, order=1)
    s.weld("foot", s.ground, strip, at=(0, 0))
    s.revolute("hinge", s.ground, rod, at=(0, 0))
    part, at = Smooth(mu=0.1), np.array([1.0, 0.0])
    drag = Drag("drag", s.ground, rod.at(1.0), at=at, axis=(0, 0, 2), c=0.3, friction=part)
    pin = Pin("pin", rod, "bob", at=at, at_l=[1.5, 0], length=0.5)
    given = [drag, pin, part, Drag, Pin, Smooth, arch, mb.Force, mb.Joint]
    before = contents(given)

    s.add(drag)
    s.add(pin)
    assert contents(given) == before
    s.check()
    r = s.simulate(0.01, accuracy=1e-3)
    s.replace("hinge", model=mb.Classical()).check()
    s.recursive().check()
    r.save(tmp_path / "run.mbdae")
    mb.load(tmp_path / "run.mbdae", laws=[Drag, Pin, Smooth, arch])
    mb.report(Pin)
    mb.report(s)
    mb.selftest(Pin)
    assert contents(given) == before
