"""Beams at rest, loaded, buckled and turning, and their modes: closed forms, and the same states by other means."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
from scipy.special import ellipk

import mbdae as mb
from mbdae.analysis.statics import Statics
from mbdae.analysis.steady import Rest
from mbdae.system.prepare import prepare

STIFF = mb.Section(1e6, 4e5, 4e5, 1.0, 1.0, 1.0, 1.0, 1e-6)
SPACES = ("auto", "spatial")


def cantilever(section: mb.Section = STIFF, elements: int = 8, order: int = 2, space: str = "auto", **scene: Any) -> mb.Scene:
    s = mb.Scene("cantilever", space=space, **scene)
    beam = s.beam("beam", (0, 0), (1, 0), section=section, elements=elements, order=order)
    s.weld("clamp", s.ground, beam.at(0.0))
    return s


@pytest.mark.parametrize("space", SPACES)
def test_small_loads_bend_as_in_linear_theory(space: str) -> None:
    """Tip load: P L^3 / 3 EI + P L / GA and P L / EA; the clamp carries the force and its moment."""
    s = cantilever(mb.Section(50.0, 20.0, 20.0, 1.0, 2.0, 2.0, 1.0, 1e-4), space=space)
    s.force("load", s["beam"].at(1.0), (1e-5, 2e-5, 0))
    e = s.equilibrium()
    moved = e["beam"].at(1.0).position[0] - [1, 0, 0]
    assert moved == pytest.approx([1e-5 / 50, 2e-5 * (1 / 6 + 1 / 20), 0], abs=2e-9)
    assert e["clamp"].force[0] == pytest.approx([-1e-5, -2e-5, 0])
    assert e["clamp"].torque[0] == pytest.approx([0, 0, -2e-5], rel=1e-4)
    assert (e.load_factor, e.unstable) == (1, 0)
    assert e.residual < 1e-12


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("kind", ["gravity", "dead", "section", "timed"])
def test_distributed_loads_bend_as_in_linear_theory(space: str, kind: str) -> None:
    """q L^4 / 8 EI; a prescribed load counts with its value at the start."""
    q = -1e-4
    s = cantilever(space=space, gravity=(0, q, 0) if kind == "gravity" else (0, 0, 0))
    if kind != "gravity":
        s["beam"].load((0, q * (1 + mb.t) if kind == "timed" else q, 0), frame="section" if kind == "section" else "inertial")
    e = s.equilibrium()
    assert e["beam"].at(1.0).position[0, 1] == pytest.approx(q / 8, rel=1e-4)
    assert e["clamp"].force[0, 1] == pytest.approx(-q, rel=1e-6)


@pytest.mark.parametrize("space", SPACES)
def test_run_from_a_loaded_state_stays_there(space: str) -> None:
    s = cantilever(space=space, elements=4)
    s.force("load", s["beam"].at(1.0), (0, 4, 0))
    e = s.equilibrium()
    r = s.simulate(0.5, start=e, solver=mb.RadauIIA(3, rtol=1e-7))
    tip = e["beam"].at(1.0).position[0]
    assert tip[1] > 0.6
    assert np.abs(r["beam"].at(1.0).position - tip).max() < 1e-7


@pytest.mark.parametrize("space", ["auto", pytest.param("spatial", marks=pytest.mark.slow)])
def test_column_beyond_its_critical_load_bends_aside(space: str) -> None:
    """Euler's elastica: P / P_c = (2 K(k) / pi)^2 with k = sin(half the angle of the tip); it stands below P_c."""
    angle = 1.2
    k = np.sin(angle / 2)
    load = float(ellipk(k * k) ** 2)
    slender = mb.Section(1e7, 1e7, 1e7, 1.0, 1.2, 1.0, 1.0, 1e-6)
    for factor in (0.9 * (np.pi / 2) ** 2 / load, 1.0):
        s = cantilever(slender, order=3, space=space)
        s.force("load", s["beam"].at(1.0), (-factor * load, 0, 0))
        e = s.equilibrium()
        assert e.unstable == 0
        bent = abs(e["beam"].at(1.0).position[0, 1])
        assert bent == pytest.approx(2 * k / ellipk(k * k), rel=1e-4) if factor == 1 else bent < 1e-9


def arch(force: float) -> mb.Scene:
    """A shallow arch between two clamps under a force at its crown."""
    s = mb.Scene("arch")
    beam = s.beam("arch", section=mb.Section(1e4, 1e4, 1e4, 1.0, 1.0, 1.0, 1.0, 1e-4), elements=6,
                  curve=lambda x: (x, 0.1 * np.sin(np.pi * x), 0))
    for i in (0, 1):
        s.weld(f"clamp{i}", s.ground, beam.at((i, 0, 0)))
    s.force("load", beam.at((0.5, 0.1, 0)), (0, -force, 0))
    return s


def test_arch_stops_at_its_limit_load_and_keeps_that_state() -> None:
    reached = []
    for force in (40.0, 800.0):
        with pytest.raises(mb.EquilibriumError, match=r"limit point the stiffness against 'arch.* nearly vanishes") as caught:
            arch(force).equilibrium()
        kept = caught.value.equilibrium
        assert kept.load_factor == caught.value.load_factor
        assert kept.residual < 1e-9
        reached.append(kept.load_factor * force)
    assert reached[0] == pytest.approx(reached[1], rel=1e-4)
    below = arch(0.999 * reached[0])
    e = below.equilibrium()
    assert e.unstable == 0
    lowest = [np.min(np.abs(a.linearize(at=a.equilibrium(), count=2).eigenvalues)) for a in (below, arch(1.0))]
    assert lowest[0] < 0.3 * lowest[1]


@pytest.mark.parametrize("space", SPACES)
def test_hinged_beam_falls_until_it_hangs(space: str) -> None:
    s = mb.Scene("hanging", space=space, gravity=(0, -9.81, 0))
    beam = s.beam("beam", (0, 0), (1, 0), section=mb.Section(1e4, 1e4, 1e4, 1.0, 1.0, 1.0, 1.0, 1e-4), elements=4)
    s.revolute("hinge", s.ground, beam, at=(0, 0))
    e = s.equilibrium()
    assert e["beam"].at(1.0).position[0] == pytest.approx([0, -1 - 9.81 / 2e4, 0], abs=1e-8)
    assert e.unstable == 0


def test_joint_models_agree() -> None:
    """A crank and a beam on torsion springs: recursive joints keep absolute coordinates and all rows in an analysis."""
    found = []
    for model in (mb.Kinematic(), mb.Classical(), mb.Recursive()):
        s = mb.Scene("arm", gravity=(0, -9.81, 0))
        crank = s.link("crank", (0, 0), (0.5, 0), mass=0.1)
        beam = s.beam("beam", (0.5, 0), (1, 0), section=mb.Section(1e4, 1e4, 1e4, 1.0, 1.0, 1.0, 0.1, 1e-4), elements=4)
        s.revolute("A", s.ground, crank, at=(0, 0), spring=3.0, model=model)
        s.revolute("B", crank, beam, at=(0.5, 0), spring=2.0, model=model)
        e = s.equilibrium()
        found.append(np.r_[e["A"].angle, e["B"].angle, e["beam"].at(1.0).position[0], s.linearize(at=e, count=4).frequencies])
        r = s.simulate(0.05, start=e, accuracy=1e-5)
        assert r["A"].angle == pytest.approx(np.full(len(r.t), e["A"].angle[0]), abs=1e-7)
    assert found[1] == pytest.approx(found[0], rel=1e-7, abs=1e-9)
    assert found[2] == pytest.approx(found[0], rel=1e-7, abs=1e-9)


@pytest.mark.parametrize(("frame", "symmetric"), [("inertial", True), ("body", False)])
def test_tangent_is_symmetric_for_dead_loads_alone(frame: str, symmetric: bool) -> None:
    s = cantilever(space="spatial", elements=4)
    s.force("load", s["beam"].at(1.0), (0.3, 1.0, 0.5), frame=frame)
    e = s.equilibrium()
    statics = Statics(Rest(prepare(s), s.ground))
    T = statics.tangent(e.point)
    assert statics.stiffness(T).symmetric is symmetric
    if symmetric:
        K = T.N.T @ T.condensed @ T.N
        assert np.abs(K - K.T).max() < 1e-9 * np.abs(K).max()
    lines = s.linearize(at=e, count=3)
    assert lines.stable


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("elements", [4, 12])
def test_modes_of_a_damped_cantilever(space: str, elements: int) -> None:
    """Stress = C (strain + d rate) damps every mode by d w / 2; shape of the first by Euler and Bernoulli."""
    d, root = 2e-3, 1.8751040687119611
    s = cantilever(mb.Section(1e7, 1e7, 1e7, 1.0, 1.7, 1.0, 1.0, 1e-9, damping=d), elements=elements, order=3, space=space)
    modes = s.linearize(count=4)
    mode = modes.modes[0]
    assert abs(mode.eigenvalue) == pytest.approx(root**2, rel=1e-4)
    assert modes.damping == pytest.approx(d / 2 * np.abs(modes.eigenvalues), rel=1e-5)
    x = mode["beam"].stations
    ratio = (np.sinh(root) - np.sin(root)) / (np.cosh(root) + np.cos(root))
    exact = np.cosh(root * x) - np.cos(root * x) - ratio * (np.sinh(root * x) - np.sin(root * x))
    shape = mode["beam"].displacement[:, 1]
    assert shape / shape[-1] == pytest.approx(exact / exact[-1], abs=1e-4)
    assert mode[s["beam"].at(1.0)].displacement == pytest.approx(mode["beam"].displacement[-1], abs=1e-9)
    middle = mode[s["beam"].at(0.41)]
    above = mode[s["beam"].at((0.41, 0.1, 0))]
    assert above.displacement - middle.displacement == pytest.approx(np.cross(middle.rotation, [0, 0.1, 0]), abs=1e-9)
    assert mode.participation == {"beam": pytest.approx(1.0)}


def test_few_and_all_modes_are_those_of_the_reduced_equations() -> None:
    """Sparse and dense ways, with and without gyroscopic terms."""
    s = mb.Scene("turning", space="spatial")
    hub = s.rigid_body("hub", 1.0, (1, 1, 1), at=(0, 0))
    s.revolute("shaft", s.ground, hub, at=(0, 0), angle=3 * mb.t)
    beam = s.beam("beam", (0.1, 0), (1, 0), section=mb.Section(1e4, 5e3, 5e3, 1.0, 1.0, 2.0, 1.0, 1e-2), elements=6)
    s.weld("root", hub, beam.at(0.0))
    modes = s.linearize(at=s.equilibrium(frame=hub), frame=hub, count=6)
    E, A = modes.equations.first_order()
    values = np.linalg.eigvals(np.linalg.solve(E, -A))
    expected = np.sort(values[values.imag > 0].imag)[:6]
    assert modes.angular_frequencies == pytest.approx(expected, rel=1e-7)
    assert np.abs(modes.growth).max() < 1e-6 * expected[-1]
    assert modes.stable


def test_floating_beam_has_its_rigid_motions() -> None:
    s = mb.Scene("floating", space="spatial")
    s.beam("beam", (0, 0), (1, 0), section=mb.Section(1e7, 1e7, 1e7, 1.0, 1.0, 1.0, 1.0, 1e-9), elements=10, order=3)
    modes = s.linearize(count=14)
    assert np.sum(modes.eigenvalues == 0) == 12
    assert modes.angular_frequencies[12:] == pytest.approx(np.full(2, 4.730040744862704**2), rel=1e-4)
    with pytest.raises(mb.EquilibriumError, match="nothing resists '"):
        s.equilibrium()


def test_refusals() -> None:
    s = cantilever(gravity=(0, -9.81, 0))
    with pytest.raises(mb.OptionError, match="frame = 'beam': a beam bends"):
        s.equilibrium(frame="beam")
    with pytest.raises(mb.SteadyError, match=r"a force that is not balanced, .* of the largest, accelerates"):
        s.linearize()
    assert s.linearize(at=s.equilibrium(), count=2).stable


def test_progress_tells_load_factor_and_corrections() -> None:
    s, seen = cantilever(), []
    s.force("load", s["beam"].at(1.0), (0, 6, 0))
    e = s.equilibrium(progress=lambda factor, iterations: seen.append((factor, iterations)))
    assert seen == sorted(seen)
    assert seen[-1] == (1.0, e.iterations)


def test_hinged_blade_on_a_driven_hub_stands_out() -> None:
    """Lag frequency of a stiff uniform blade from e to R: Omega sqrt(3 e / 2 (R - e)); it starts off its radius."""
    s = mb.Scene("blade")
    hub = s.rigid_body("hub", 1.0, 1.0, at=(0, 0))
    s.revolute("shaft", s.ground, hub, at=(0, 0), angle=10 * mb.t)
    blade = s.beam("blade", (0.25, 0), (4.5, 0), section=mb.Section(1e8, 1e8, 1e8, 1e6, 1e6, 1e6, 3.0, 1e-4), elements=3)
    s.revolute("lag", hub, blade, at=(0.25, 0), angle0=0.05)
    e = s.equilibrium(frame=hub)
    assert e["lag"].angle == pytest.approx([0.0], abs=1e-9)
    assert e["blade"].at(1.0).position[0, 0] > 4.5
    lowest = s.linearize(at=e, frame=hub, count=2).angular_frequencies[0]
    assert lowest == pytest.approx(10 * np.sqrt(1.5 * 0.25 / 4.25), rel=1e-3)


def test_rotor_that_turns_freely_is_its_own_frame() -> None:
    s = mb.Scene("free rotor", space="spatial")
    hub = s.rigid_body("hub", 1.0, (1, 1, 1), at=(0, 0), angular_velocity=(0, 0, 5.0))
    s.revolute("shaft", s.ground, hub, at=(0, 0), rate0=5.0)
    for i, x in enumerate((1, -1)):
        blade = s.beam(f"blade{i}", (0.1 * x, 0), (x, 0), section=mb.Section(1e5, 4e4, 4e4, 1.0, 1.0, 2.0, 1.0, 1e-3), elements=4)
        s.weld(f"root{i}", hub, blade.at((0.1 * x, 0)))
    e = s.equilibrium(frame=hub)
    assert e["blade0"].at(1.0).position[0, 0] - 1 == pytest.approx(-1 - e["blade1"].at(1.0).position[0, 0], rel=1e-6)
    modes = s.linearize(at=e, frame=hub, count=8)
    assert np.sum(modes.eigenvalues == 0) == 2
    assert modes.stable


def test_slides_under_a_rotor_of_beams_stand_out() -> None:
    """Seen from the hub the slides of its support turn: the equations are periodic, whatever the stiffness of the blades."""
    s = mb.Scene("rotor")
    carriage, block = (s.rigid_body(name, mass, 0.0, at=(0, 0)) for name, mass in (("carriage", 0.0), ("block", 3.0)))
    hub = s.rigid_body("hub", 0.0, 0.0, at=(0, 0))
    s.prismatic("x", s.ground, carriage, at=(0, 0), axis=(1, 0, 0), spring=1e3)
    s.prismatic("y", carriage, block, at=(0, 0), axis=(0, 1, 0), spring=1e3)
    s.revolute("shaft", block, hub, at=(0, 0), angle=5 * mb.t)
    for side in (1, -1):
        tube = mb.Section.circular(0.02, 7e10, 0.3, 2700)
        blade = s.beam(f"blade {side}", (0.1 * side, 0), (side, 0), section=tube, elements=1)
        s.weld(f"root {side}", hub, blade.at((0.1 * side, 0)))
    with pytest.raises(mb.SteadyError, match="has another direction"):
        s.linearize(at=s.equilibrium("hub"), frame="hub")


@pytest.mark.parametrize(("elements", "order"), [(3, 1), (2, 2), (3, 3), (2, 4)])
def test_modes_name_their_mesh_and_what_it_is_off(elements: int, order: int) -> None:
    """Against 16 elements of order 4, whose frequencies are those of linear theory to more digits than are compared."""
    def modes(elements: int, order: int) -> Any:
        s = cantilever(elements=elements, order=order, space="planar")
        return s.linearize(at=s.equilibrium(), count=3)

    found, exact = modes(elements, order), modes(16, 4)
    words = f"mesh of 'beam' {elements} elements of order {order}"
    assert found.mesh == {"beam": ((elements,), order)}
    assert f"{words}: its error is not covered (.mesh_error measures it)" in repr(found)
    ratio = found.mesh_error / np.abs(found.frequencies / exact.frequencies - 1)
    assert 0.5 < ratio.min() <= ratio.max() < 2.0
    for text in (repr(found), str(found)):
        assert f"{words}: relative error of at most {found.mesh_error.max():.1e}" in text


def test_multipliers_name_their_mesh_and_the_state_of_a_run_has_none_to_compare() -> None:
    s = cantilever(elements=2)
    found = s.floquet(1e-3, s.equilibrium(), count=2, accuracy=1e-4)
    assert found.mesh_error.shape == found.multipliers.shape
    fine = cantilever(elements=2, order=3)
    again = fine.floquet(1e-3, fine.equilibrium(), count=2, accuracy=1e-4)
    nearest = np.abs(found.multipliers[:, None] / again.multipliers - 1).min(axis=1)
    assert np.all(found.mesh_error >= nearest * (1 - 1e-9))
    slow = np.argmin(np.abs(found.exponents))
    assert found.mesh_error[slow] == pytest.approx(nearest[slow], rel=1e-3)
    assert "mesh of 'beam' 2 elements of order 2: relative error of at most" in repr(found)
    of_run = s.linearize(at=s.simulate(1e-3, accuracy=1e-3, outputs=2), count=2)
    assert repr(of_run).endswith("of order 2: its error is not covered>")
    with pytest.raises(mb.OptionError, match="the state of a run has no counterpart on a finer mesh"):
        of_run.mesh_error  # noqa: B018
    rigid = mb.Scene("rigid")
    rigid.revolute("hinge", rigid.ground, rigid.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), spring=1.0)
    assert (rigid.linearize().mesh, rigid.linearize().mesh_error) == ({}, None)
    assert "mesh" not in repr(rigid.linearize()) + str(rigid.linearize())


@pytest.mark.parametrize("elements", [1, 2, 3])
@pytest.mark.parametrize("damping", [0.0, 10.0])
def test_a_column_under_a_load_that_follows_it_has_finite_roots_alone(elements: int, damping: float) -> None:
    """Stiffness that is not symmetric: unknowns without inertia have no roots, however few freedoms there are. The roots are
    those of the dense equations on the displacements that the clamp allows."""
    s = mb.Scene("column")
    c = s.beam("c", (0, 0), (1, 0), section=mb.Section.rectangular(0.01, 0.01, E=12e8, nu=0.3, rho=1e4), elements=elements)
    s.weld("w", s.ground, c, at=(0, 0))
    s.force("F", c, (-2.0, 0), at=(1, 0), frame="body")
    s.spring("D", s.ground, c, at_k=(1, 1), at_l=(1, 0), stiffness=0.0, damping=damping, length=1.0)
    found = s.linearize(at=s.equilibrium())
    E, A = found.equations.first_order()
    dense = scipy.linalg.eigvals(-A, E)
    dense = dense[dense.imag >= 0]
    lowest = np.sort(np.abs(found.eigenvalues))
    assert lowest[:4] == pytest.approx(np.sort(np.abs(dense))[:4], rel=1e-4)
    assert lowest[-1] < 1e6
    assert found.stable is True
