"""Laws on three bodies in a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb


class Rope(mb.Joint):
    """A rope from k over a pulley on l to m."""

    frames = ("k", "l", "m")
    params = mb.params(length=("m", "length of the rope"))

    def constraints(self, k: Any, l: Any, m: Any) -> Any:
        return {"length": (l.r - k.r).norm() + (m.r - l.r).norm() - self.length}


class Bend(mb.Force):
    """V = stiffness |r_k - 2 r_m + r_l|^2 / 2."""

    frames = ("k", "l", "m")
    params = mb.params(stiffness=("N/m", "stiffness"))

    def energy(self, k: Any, l: Any, m: Any) -> Any:
        d = k.r + l.r - 2 * m.r
        return self.stiffness * (d @ d) / 2


def test_weights_on_a_rope(tmp_path: Path) -> None:
    """Atwood's machine: the points of all three frames differ; a = g (M - m) / (M + m)."""
    s = mb.Scene("rope", gravity=(0, -9.81, 0))
    light, heavy = s.rigid_body("light", 1.0, 0.01, at=(0, -1)), s.rigid_body("heavy", 3.0, 0.05, at=(0.2, -2))
    s.prismatic("A", s.ground, light, at=(0, -1), axis=(0, 1, 0))
    s.prismatic("B", s.ground, heavy, at=(0.2, -2), axis=(0, 1, 0))
    s.rigid_body("pulley", 1.0, 0.01, at=(0, 10))
    s.weld("fixed", s.ground, "pulley")
    s.add(Rope("left", light, "pulley", at=(0, -1), at_l=(0, 10), m=heavy, at_m=(0.2, -2),
               length=11 + np.hypot(0.2, 12)))
    r = s.simulate(0.5, accuracy=1e-8)
    straight = 9.81 * 2 / 4 * 0.5**2 / 2
    assert r["A"].displacement[-1] == pytest.approx(straight, rel=2e-3)  # the other side hangs at a slight angle
    assert np.max(np.abs(r.energy.balance)) < 1e-6
    r.save(tmp_path / "r.npz")
    assert np.array_equal(mb.load(tmp_path / "r.npz", laws=[Rope])["A"].displacement, r["A"].displacement)


def test_the_same_in_a_tree_of_recursive_joints() -> None:
    found = []
    for model in (mb.Kinematic(), mb.Recursive()):
        s = mb.Scene("tree", gravity=(0, -9, 0))
        for name, p, q in (("p", (0, 0), (1, 0)), ("q", (1, 0), (2, 0)), ("w", (0, 1), (1, 1))):
            s.link(name, p, q, mass=1.0)
        s.revolute("A", s.ground, "p", at=(0, 0), model=model)
        s.revolute("B", "p", "q", at=(1, 0), model=model)
        s.revolute("C", s.ground, "w", at=(0, 1), model=model)
        s.add(Bend("bend", "p", "q", at=(1, 0.5), m="w", stiffness=10.0))
        r = s.simulate(0.7, accuracy=1e-8)
        assert np.max(np.abs(r.energy.balance)) < 1e-6
        found.append(np.r_[r["q"].position[-1], r["w"].velocity[-1]])
    assert np.max(np.abs(found[0] - found[1])) < 1e-7


def test_a_missing_body_is_named() -> None:
    s = mb.Scene("s")
    a, b = s.rigid_body("a", 1.0, 0.1), s.rigid_body("b", 1.0, 0.1, at=(1, 0))
    with pytest.raises(mb.LawError, match="the body of its frame 'm' is missing; add m= with a body or a place"):
        Bend("bend", a, b, stiffness=1.0)
