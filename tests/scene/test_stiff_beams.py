"""Beams that vibrate far faster than they move: no solver ends with a wrong answer and no word about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from beam_scenes import slider_crank, steel_pendulum

import mbdae as mb
from mbdae.formulations import default_form, system_for
from mbdae.system.prepare import prepare
from mbdae.system.sampling import motion_distance


def soft(space: str = "auto") -> mb.Scene:
    """A free beam, one element, in which extension is the fastest motion."""
    s = mb.Scene("soft", space=space)
    section = mb.Section(EA=3.0, GA2=0.1, GA3=0.1, GJ=0.1, EI2=0.1, EI3=0.1, mass_per_length=0.5, rotary_inertia=1.0)
    s.beam("rope", (0, 0), (2, 0), section=section, elements=1, order=1)
    return s


@pytest.mark.parametrize("space", ["planar", "spatial"])
def test_fastest_vibration_of_an_element_is_known(space):
    p = prepare(soft(space))
    assert p.model.lines[0].fastest_vibration(p.start.q) == pytest.approx(np.sqrt(12 * 3.0 / 0.5) / 2, rel=1e-12)


def test_no_mode_of_a_mesh_is_faster_than_its_fastest_element():
    s = steel_pendulum(20)
    p = prepare(s)
    modes = s.linearize(s.equilibrium()).modes
    highest = max(mode.angular_frequency for mode in modes)
    assert highest <= p.model.lines[0].fastest_vibration(p.start.q) * (1 + 1e-9)


@pytest.mark.parametrize("scene", [slider_crank(8, 1), steel_pendulum(100)], ids=["slider-crank", "pendulum"])
def test_ida_refuses_loose_tolerances_on_stiff_beams(scene):
    with pytest.raises(mb.OptionError, match=r"beam 'rod' vibrates by .* rtol = 0.0001 and max_order = 5, .* mb.RadauIIA"):
        scene.simulate(0.01, solver=mb.IDA(rtol=1e-4))


def test_ida_takes_loose_tolerances_on_soft_beams_and_with_order_2():
    assert soft().simulate(0.1, solver=mb.IDA(rtol=1e-4)).t[-1] == 0.1
    assert steel_pendulum(1000).simulate(0.01, solver=mb.IDA(rtol=1e-4, max_order=2)).t[-1] == 0.01


@pytest.mark.parametrize(("scene", "t_end"), [(slider_crank(8, 1), 0.05), (steel_pendulum(1000), 0.3)],
                         ids=["slider-crank", "pendulum"])
@pytest.mark.parametrize("accuracy", [1e-3, 1e-4])
def test_stiff_scenes_are_as_accurate_as_asked_or_warn(scene, t_end, accuracy):
    r, times = scene.simulate(t_end, accuracy), np.linspace(0, t_end, 1001)
    p = prepare(scene)
    form = replace(default_form(p), waves=True)
    exact = mb.RadauIIA(3, rtol=1e-6).solve(system_for(p, form, 3), t_end)
    motions = [q.states(times, y)[:2] for q, y in ((r.prepared, r.solution(times)), (p, exact(times)))]
    assert r.warnings or np.max(motion_distance(p, *motions)) < 3 * accuracy


def test_a_stiff_beam_is_verified_by_a_method_that_can():
    found = steel_pendulum(1000).simulate(0.1, 1e-3, verify=True).accuracy
    assert 0 < found.verified < 1e-3
