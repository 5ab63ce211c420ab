"""Quaternions along a beam keep their sign where its heading passes half a turn: interpolation needs neighbours that agree."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb

SECTION = mb.Section(2.76e6, 5.7e5, 5.7e5, 23.3, 29.9, 29.9, 0.1, 1.1e-6)
BEND = (-0.326, 0.011), (-0.361, 0.006)  # m: headings of 178 and 188 degrees, then an arm hinged at its end


def chain(model, space: str) -> mb.Scene:
    """A beam with a corner turned by its drive, a straight one hinged to its tip."""
    s = mb.Scene("bent arm", space=space)
    arm = s.beam("arm", (0, 0), *BEND, section=SECTION, elements=[3, 1])
    tip = s.beam("tip", BEND[1], (-0.9, 0.02), section=SECTION, elements=3)
    s.revolute("root", s.ground, arm, at=(0, 0), angle=12.56 * mb.t)
    s.revolute("hinge", arm, tip, at=BEND[1], model=model)
    return s


@pytest.mark.parametrize("model", [mb.Kinematic(), mb.Recursive()], ids=["kinematic", "recursive"])
def test_a_bent_beam_moves_in_space_as_in_the_plane(model) -> None:
    flat, spatial = (chain(model, space).simulate(0.02, solver=mb.RadauIIA(3, step=1e-3)) for space in ("planar", "spatial"))
    np.testing.assert_allclose(spatial["tip"].at(1.0).position, flat["tip"].at(1.0).position, atol=1e-11)
    assert spatial.energy.total[-1] == pytest.approx(flat.energy.total[-1], rel=1e-10)


def test_neighbours_along_a_beam_agree_at_the_start() -> None:
    s = chain(mb.Recursive(), "spatial")
    for joint in ("root", "hinge"):
        s = s.replace(joint, model=mb.Recursive())
    r = s.simulate(1e-3, solver=mb.RadauIIA(3, step=1e-3))
    for line in r.prepared.model.lines:
        P = np.array([r.q[0, n.q + 3 : n.q + 7] for n in line.nodes])
        assert np.all(np.einsum("ni,ni->n", P[1:], P[:-1]) > 0)


@pytest.mark.parametrize("frame", ["inertial", "section"])
def test_a_load_acts_on_its_own_beam_alone(frame: str) -> None:
    """Two free beams side by side: 12 N/m on 0.1 kg/m accelerate the one by 120 m/s^2."""
    s = mb.Scene("two beams")
    loaded, _ = (s.beam(name, (0, y), (1, y), section=SECTION, elements=2) for name, y in (("loaded", 0), ("other", 1)))
    loaded.load((0, 12.0), frame=frame)
    r = s.simulate(1e-7)
    at = [r["loaded"].at(0.5), r["other"].at(0.5)]
    np.testing.assert_allclose([beam.acceleration[0] for beam in at], [[0, 120, 0], [0, 0, 0]], atol=1e-6)
