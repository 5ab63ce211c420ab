"""The contract "motion": what a joint states besides its motion agrees with it; every kind of disagreement is found and named."""

from __future__ import annotations

from typing import Any

import pytest
import symengine as se

import mbdae as mb
from mbdae import contracts
from mbdae.contracts import _Run
from mbdae.contracts.motion import stated_motion
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.motion import Motion

SPATIAL = (NodeKind.SPATIAL, Axes.GENERAL)
COORDINATE = (NodeKind.COORDINATE, Axes.GENERAL)


class Sleeve(mb.Joint):
    """l slides along k.x and turns about it. All that can be stated is stated."""

    coordinates = mb.params(slide=("m", "displacement along k.x"), roll=("rad", "rotation about k.x"))

    def motion(self, from_k: Any) -> Any:
        return from_k.along("x", self.slide).about("x", self.roll)

    def constraints(self, k: Any, l: Any) -> Any:
        d = l.r - k.r
        return {"off_y": k.y @ d, "off_z": k.z @ d, "bend_y": k.x @ l.y, "bend_z": k.x @ l.z}

    def coordinate(self, k: Any, l: Any) -> Any:
        return {"slide": k.x @ (l.r - k.r), "roll": se.atan2(k.z @ l.y, k.y @ l.y)}

    def ties(self, k: Any, l: Any) -> Any:
        c, s = se.cos(self.roll), se.sin(self.roll)
        return {"slide": self.slide - k.x @ (l.r - k.r), "roll": (l.y @ (k.y * s - k.z * c), l.y @ (k.y * c + k.z * s))}

    def branches(self, k: Any, l: Any) -> Any:
        return {"ahead": k.x @ l.x}


class Bent(mb.Joint):
    """Stated by its motion alone: two turns that do not commute, and a way between them."""

    params = mb.params(arm=("m", "length between the axes"))
    coordinates = mb.params(first=("rad", "rotation about k.z"), second=("rad", "rotation about an oblique axis"))

    def motion(self, from_k: Any) -> Any:
        return from_k.about("z", self.first).along("x", self.arm).about((1, 2, 2), self.second)


class Unread(Sleeve):
    """Its coordinates cannot be read from the frames."""

    def coordinate(self, k: Any, l: Any) -> Any:
        return None


@pytest.fixture(autouse=True)
def of_motions_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contracts, "CONTRACTS", {"motion": stated_motion})


def changed(**methods: Any) -> type[Sleeve]:
    return type("Sleeve", (Sleeve,), methods)


def without(name: str) -> Any:
    return lambda self, k, l: {row: e for row, e in Sleeve.constraints(self, k, l).items() if row != name}


def tied(**ties: Any) -> Any:
    return lambda self, k, l: Sleeve.ties(self, k, l) | {name: tie(self, k, l) for name, tie in ties.items()}


def told(law: type[mb.Joint], driven: bool = False, kept: bool = False) -> str:
    """Violations between two bodies in space."""
    absent = frozenset(["friction_radius"]) if driven else frozenset({"friction_radius", *law.drives()})
    structure = Structure(absent, options=(("kept", kept), ("friction", None), ("rubs", None)))
    own = [COORDINATE] * len(law.coordinates) if kept else []
    return "\n".join(_Run(law, {}).check("here", structure, (SPATIAL, SPATIAL, *own)))


@pytest.mark.parametrize("law", [Sleeve, Unread, Bent])
def test_joints_of_ones_own(law: Any) -> None:
    for kept in (False, True) if law is not Bent else (True,):
        for driven in (False, True):
            assert told(law, driven, kept) == ""


ALWAYS: list[tuple[type[mb.Joint], list[str]]] = [
    (changed(constraints=lambda self, k, l: Sleeve.constraints(self, k, l) | {"stop": k.x @ (l.r - k.r)}),
     ["row 'stop', where the motion puts l, is off by",
      "number of independent rows, 5 where 4 leave just the motion free (too many)",
      "rate of row 'stop' at the rates of the motion"]),
    (changed(constraints=lambda self, k, l: Sleeve.constraints(self, k, l) | {"again": 2 * (k.x @ l.y)}),
     ["number of rows, 5 of which 4 are independent (leave out what follows from other rows), is off by 1"]),
    (changed(constraints=without("bend_z")),
     ["number of independent rows, 3 where 4 leave just the motion free (too few), is off by 1",
      "second solution of the rows, which no expression of `branches` refuses (found from a random place)"]),
    (changed(motion=lambda self, from_k: from_k.along("x", self.slide).about("y", self.roll)),
     ["row 'bend_z', where the motion puts l,", "coordinate 'roll' as read, against the value of the motion,"]),
    (changed(motion=lambda self, from_k: from_k.along("y", self.slide).about("x", self.roll)),
     ["row 'off_y', where the motion puts l,", "coordinate 'slide' as read"]),
    (changed(coordinate=lambda self, k, l: Sleeve.coordinate(self, k, l) | {"slide": k.x @ (k.r - l.r)}),
     ["coordinate 'slide' as read, against the value of the motion,", "rate of coordinate 'slide' as read"]),
    (changed(coordinate=lambda self, k, l: {"slide": k.x @ (l.r - k.r)}),
     ["coordinate 'roll', which `coordinate` does not return,"]),
    (changed(branches=lambda self, k, l: {}),
     ["second solution of the rows, which no expression of `branches` refuses (half a turn about its y axis), is off by",
      "second solution of the rows, which no expression of `branches` refuses (half a turn about its z axis), is off by"]),
    (changed(branches=lambda self, k, l: {"ahead": k.x @ l.x, "behind": -(k.x @ l.x)}),
     ["expression 'behind' of `branches`, which must be positive where the motion puts l, is off by 2"]),
    (type("Unread", (Unread,), {"branches": lambda self, k, l: {}}),
     ["which no expression of `branches` refuses (half a turn about its z axis), is off by"]),
]


@pytest.mark.parametrize(("law", "words"), ALWAYS)
def test_disagreements_are_named(law: Any, words: list[str]) -> None:
    found = told(law)
    for word in words:
        assert word in found
    assert found.startswith("motion, here: ")


@pytest.mark.parametrize(("kept", "row"), [(False, "drive_"), (True, "")])
def test_ties_that_are_wrong(kept: bool, row: str) -> None:
    """The row of a prescribed coordinate; the same where the coordinate is an unknown."""
    sine = Sleeve.ties
    backwards = changed(ties=tied(slide=lambda self, k, l: k.x @ (l.r - k.r) - self.slide))
    slope = f"slope of row '{row}slide' over the coordinate that it ties, which must be positive, is off by 1 "
    assert slope in told(backwards, True, kept)
    deaf = changed(ties=tied(slide=lambda self, k, l: 0 * self.slide - k.x @ (l.r - k.r)))
    found = told(deaf, True, kept)
    assert f"row '{row}slide', where the motion puts l, is off by" in found
    assert f"row '{row}slide', which does not depend on the coordinate that it ties, is off by 1" in found
    half_turn = changed(ties=tied(roll=lambda self, k, l: sine(self, k, l)["roll"][0]))
    assert "no expression of `branches` refuses (half a turn about its x axis)" in told(half_turn, True, kept)


def test_a_way_back_that_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """Turns undone in the order in which they were made."""
    right = Motion.inverse
    monkeypatch.setattr(Motion, "inverse", lambda self: Motion(right(self).steps[::-1]))
    assert "motion, here: place of k by the inverse motion is off by" in told(Bent, kept=True)


def test_coordinates_that_no_row_ties_are_refused() -> None:
    """As unknowns they would be in no equation."""
    stated = {name: vars(Sleeve)[name] for name in ("constraints", "coordinate", "branches")}
    loose = type("Loose", (mb.Joint,), {"coordinates": Sleeve.coordinates, **stated})
    s = mb.Scene("loose")
    s.joint(loose, "J", s.ground, s.rigid_body("b", 1.0, (1, 1, 1)), at=(0, 0, 0), model=mb.Classical())
    with pytest.raises(mb.SceneError, match="Loose states neither its motion nor rows that tie slide, roll to the bodies"):
        s.check()


def test_options_that_a_joint_cannot_have() -> None:
    with pytest.raises(mb.OptionError, match="rubs = 'height': friction acts on one of the coordinates of Sleeve, slide or roll"):
        mb.selftest(Sleeve, rubs="height")
    with pytest.raises(mb.OptionError, match="kept = True: Distance has no coordinates; leave it out"):
        mb.selftest(mb.Distance, kept=True)
    with pytest.raises(mb.OptionError, match=r"friction = .*: Spherical has no angles and displacements; leave it out"):
        mb.selftest(mb.Spherical, friction=mb.Coulomb(0.3, 1e-3))
