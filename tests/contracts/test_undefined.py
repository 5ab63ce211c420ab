"""What a node cannot give is refused by name; only rows on point masses fall away, and a joint keeps at least one."""

from __future__ import annotations

from typing import Any

import pytest

import mbdae as mb


class RowByHeading(mb.Joint):
    """l keeps its heading relative to k: in the plane alone."""

    def constraints(self, k: Any, l: Any) -> dict[str, Any]:
        return {"mesh": l.heading - k.heading}


class CoordinateByHeading(mb.Joint):
    coordinates = mb.params(heading=("rad", "heading of l relative to k"))

    def constraints(self, k: Any, l: Any) -> dict[str, Any]:
        return {"x": (l.r - k.r)[0]}

    def coordinate(self, k: Any, l: Any) -> Any:
        return l.heading - k.heading


class BranchByHeading(mb.Joint):
    def constraints(self, k: Any, l: Any) -> dict[str, Any]:
        return {"x": (l.r - k.r)[0]}

    def branches(self, k: Any, l: Any) -> dict[str, Any]:
        return {"near": 1 - l.heading**2}


class EnergyByHeading(mb.Force):
    def energy(self, k: Any, l: Any) -> Any:
        return l.heading**2


class TorqueByHeading(mb.Force):
    def wrench(self, k: Any, l: Any) -> Any:
        return k.x * 0, k.z * (-(l.heading - k.heading))


class StateByHeading(mb.Force):
    states = mb.params(h=("rad", "heading that lags"))

    def wrench(self, k: Any, l: Any) -> Any:
        return k.x * self.h, k.x * 0

    def rates(self, k: Any, l: Any) -> dict[str, Any]:
        return {"h": l.heading - self.h}

    def initial(self, k: Any, l: Any) -> dict[str, Any]:
        return {"h": 0 * self.h}


LAWS = {RowByHeading: "row 'mesh'", CoordinateByHeading: "the coordinate 'heading'", BranchByHeading: "the branch 'near'",
        EnergyByHeading: "the energy", TorqueByHeading: "the torque", StateByHeading: "the rate of state 'h'"}


def scene(law: Any, space: str) -> mb.Scene:
    s = mb.Scene("lock", space=space)
    b = s.rigid_body("b", 1.0, (0.1, 0.1, 0.1), at=(0, 0, 0))
    s.revolute("A", s.ground, b, at=(0, 0, 0), torque=1.0)
    s.add(law("lock", s.ground, b, at=(0, 0, 0)))
    return s


@pytest.mark.parametrize("law", LAWS)
def test_a_heading_in_space_is_refused_by_name(law: Any) -> None:
    with pytest.raises(mb.SceneError) as refused:
        scene(law, "spatial").check()
    (problem,) = refused.value.problems
    for word in ("'lock'", LAWS[law], law.__name__, "heading of", "space='planar'", "self.relative_angle(k, l)"):
        assert word in problem
    scene(law, "planar").check()


def test_in_the_plane_the_row_holds() -> None:
    assert abs(scene(RowByHeading, "planar").simulate(0.5)["b"].rotation[-1, 1, 0]) < 1e-9


def test_selftest_says_so() -> None:
    """A law of the plane keeps its contract there; what it refuses in space is listed with the reason."""
    found = mb.selftest(RowByHeading)
    assert found.variants
    assert not any(name.startswith(("spatial", "ground")) for name in found.variants)
    assert "needs the heading of k, which exists in the plane only" in found.refused["spatial - spatial"]
    assert "exists in the plane only" in str(found)


def test_rows_of_point_masses_fall_away_and_are_told() -> None:
    s = mb.Scene("bead", gravity=(0, 0, -9.81))
    s.weld("W", s.ground, s.point_mass("p", 1.0, at=(1, 0, 0)))
    s.spherical("S", s.rigid_body("b", 1.0, (0.1, 0.1, 0.1), at=(0, 0, 0)), s.ground, at=(1, 0, 0))
    found = s.check()
    assert {"W.tilt_x", "W.tilt_y", "W.twist"} <= set(found.pruned)
    assert "a point mass has no axes: W (tilt_y, tilt_x, twist)" in str(found)
    assert "they hold in every position" not in str(found)


@pytest.mark.parametrize("space", ["planar", "spatial"])
def test_a_joint_without_rows_is_refused(space: str) -> None:
    class Nothing(mb.Joint):
        def constraints(self, k: Any, l: Any) -> dict[str, Any]:
            return {}

    s = mb.Scene("points", space=space)
    p = s.point_mass("p", 1.0, at=(1, 0))
    s.fixed_orientation("F", s.ground, p)
    with pytest.raises(mb.SceneError, match=r"'F': no row is left of this joint: tilt_y, tilt_x, twist need an orientation"):
        s.check()
    s = mb.Scene("nothing", space=space)
    s.add(Nothing("N", s.ground, s.point_mass("p", 1.0, at=(1, 0)), at=(1, 0, 0)))
    with pytest.raises(mb.SceneError, match="'N': Nothing states no row"):
        s.check()
