"""Scenes with recursive joints as users meet them: refusals by name, limits told, the automatic choice."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from recursive_scenes import four_bar, prescribed, spring_chain, tree_on_ground

import mbdae as mb

R = mb.Recursive()


def arm_with_tip(mass: float, inertia: float) -> mb.Scene:
    """An arm of 1 kg, and a leaf on its end."""
    s = mb.Scene("arm with tip", gravity=(0, 0, -9.81))
    arm = s.rigid_body("arm", 1.0, (0.1, 0.1, 0.1), at=(0.5, 0, 0))
    tip = s.rigid_body("tip", mass, (inertia, inertia, inertia), at=(1, 0, 0))
    s.revolute("shoulder", s.ground, arm, at=(0, 0, 0), axis=(0, 1, 0), model=R)
    s.revolute("wrist", arm, tip, at=(1, 0, 0), axis=(0, 1, 0), model=R)
    return s


@pytest.mark.parametrize("mass", [0.0, 1.0])
def test_a_leaf_without_inertia_is_refused_by_name(mass: float) -> None:
    """IDA would report success on such equations and return garbage: they are refused before."""
    with pytest.raises(mb.SceneError, match="joint 'wrist': what it moves has no inertia about or along"):
        arm_with_tip(mass, 0.0).check()


def test_a_leaf_of_a_billionth_runs() -> None:
    """The scaled mass matrix is as regular as any: mass alone decides nothing."""
    times = np.linspace(0, 1, 11)
    runs = [arm_with_tip(m, m).simulate(1.0, accuracy=1e-8, outputs=times) for m in (1e-9, 1e-6)]
    alone = mb.Scene("arm", gravity=(0, 0, -9.81))
    arm = alone.rigid_body("arm", 1.0, (0.1, 0.1, 0.1), at=(0.5, 0, 0))
    alone.revolute("shoulder", alone.ground, arm, at=(0, 0, 0), axis=(0, 1, 0), model=R)
    exact = alone.simulate(1.0, accuracy=1e-8, outputs=times)["shoulder"].angle
    for r, bound in zip(runs, (1e-7, 1e-4), strict=True):
        assert np.max(np.abs(r["shoulder"].angle - exact)) < bound


def test_massless_bodies_between_masses_are_legal() -> None:
    """The carriage between two slides has no mass: what counts is what each joint moves."""
    s = mb.Scene("cross slide")
    carriage, block = s.rigid_body("carriage", 0.0, 0.0), s.rigid_body("block", 2.0, 1.0)
    s.prismatic("x", s.ground, carriage, at=(0, 0), axis=(1, 0, 0), force=4.0, model=R)
    s.prismatic("y", carriage, block, at=(0, 0), axis=(0, 1, 0), force=2.0, model=R)
    r = s.simulate(1.0, outputs=3)
    np.testing.assert_allclose(r["block"].position[-1], (1.0, 0.5, 0), atol=1e-7)


def recursive_loop() -> mb.Scene:
    return four_bar("spatial", R).replace("D", model=R)


def on_point_mass() -> mb.Scene:
    s = mb.Scene("point", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.point_mass("bob", 1.0, at=(1, 0)), at=(1, 0), model=R)
    return s


def not_a_model() -> mb.Scene:
    s = mb.Scene("word")
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), model="recursive")
    return s


def wholly_prescribed() -> mb.Scene:
    s = mb.Scene("robot")
    s.revolute("motor", s.ground, s.link("arm", (0, 0), (1, 0), mass=1.0), at=(0, 0), model=R, angle=2 * mb.t)
    return s


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (wholly_prescribed, ("scene 'robot'", "nothing is left to solve for", "model=mb.Kinematic()")),
        (recursive_loop, ("'D'", "closes a loop", "among them 'A'", "model=mb.Kinematic() for one joint", "s.recursive()")),
        (on_point_mass, ("revolute 'hinge'", "needs an orientation of 'bob'", "s.rigid_body", "model=mb.Kinematic()")),
        (not_a_model, ("revolute 'hinge'", "model = 'recursive' is not a joint model", "mb.Recursive()")),
        (lambda: spring_chain().replace("J1", model=mb.Recursive), ("is not a joint "
                                                                    "model", "mb.Recursive()")),  # type: ignore[arg-type]
    ],
)
def test_refusals_name_the_joint_and_a_way_out(scene: Callable[[], mb.Scene], words: tuple[str, ...]) -> None:
    with pytest.raises(mb.SceneError) as caught:
        scene().check()
    for word in words:
        assert word in str(caught.value)


def test_recursive_makes_a_spanning_tree_and_keeps_what_closes_it() -> None:
    found = recursive_loop().recursive().check()
    assert found.recursive == ("A", "B", "C")
    assert found.unknowns == {"positions": 3, "velocities": 3, "states": 0, "multipliers": 2}
    mixed = on_point_mass().replace(model=mb.Kinematic())
    assert mixed.recursive().check().recursive == ()


def test_ode_form_names_the_row_that_is_left() -> None:
    with pytest.raises(mb.OptionError, match=r"has 2 constraint rows \(such as D\.x\): use mb\.GGL\(\)$"):
        four_bar("auto", R).simulate(0.1, form=mb.ODE())
    with pytest.raises(mb.OptionError, match=r"use mb\.GGL\(\), or s\.recursive\(\) if its joints form a tree"):
        four_bar("auto", mb.Classical()).simulate(0.1, form=mb.ODE())
    with pytest.raises(mb.OptionError, match=r"this system \(GGL\) has multipliers of constraints"):
        four_bar("auto", R).simulate(0.1, solver=mb.CVODE(), form=mb.GGL())
    assert four_bar("auto", R).simulate(0.1, solver=mb.CVODE()).info.form == "Index1"


def test_a_long_chain_is_recursive_and_says_how() -> None:
    """64 spatial joints are far more than one program can hold: kernels of single joints serve them all."""
    found = spring_chain(64).check()
    assert len(found.recursive) == 64
    assert not found.kept_kinematic
    assert found.unknowns["multipliers"] == 0
    assert "functions of single joints)" in str(found)


def test_compare_labels_what_really_ran() -> None:
    """A row asked for recursive joints says that they were."""
    runs = [mb.Run(mb.IDA(), model=mb.Recursive()), mb.Run(mb.IDA())]
    long = mb.compare(spring_chain(12).replace(model=mb.Kinematic()), 0.01, runs, [1e-3])
    assert [row.label for row in long.runs] == ["IDA ODE Recursive", "IDA GGL"]
    short = mb.compare(spring_chain(2).replace(model=mb.Kinematic()), 0.01, runs[:1], [1e-3])
    assert [row.label for row in short.runs] == ["IDA ODE Recursive"]


def test_default_comparison_has_the_models_side_by_side() -> None:
    """Index 3 against an ordinary differential equation, without being asked for."""
    w = mb.compare(spring_chain(2).replace(model=mb.Kinematic()), 0.1, accuracies=[1e-5])
    labels = {row.label for row in w.runs}
    assert {"RadauIIA(3) Index3", "RadauIIA(3) ODE Recursive", "IDA ODE Recursive", "CVODE (Adams) ODE Recursive",
            "RadauIIA(3) GGL Classical"} <= labels
    assert w.pairwise.largest[0] < 1e-3


def pendulum(damper: float) -> mb.Scene:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), model=R, damper=damper)
    return s


@pytest.mark.parametrize(
    ("damper", "label", "why"),
    [
        (0.1, "DOP853", "an ordinary differential equation that is not stiff"),
        (1e5, "RadauIIA(3)", "stiff: small disturbances decay at up to 3e+05 1/s, the motion changes in 0.261 s"),
    ],
)
def test_the_choice_of_a_solver_is_told(damper: float, label: str, why: str, tmp_path: Any, capsys: Any) -> None:
    """By the damper's decay rate c / J; the result, the file it is saved in and the command line all tell."""
    from mbdae.cli import main

    r = pendulum(damper).simulate(0.5, 1e-7)
    why = f"{label}, ODE, planar, 2 unknowns, dense: {why}"
    assert (r.info.solver.label, r.info.choice) == (label, why)
    assert r.accuracy.met
    r.save(tmp_path / "run.npz")
    assert mb.load(tmp_path / "run.npz").info.choice == why
    file = tmp_path / "chosen_by_default.py"
    file.write_text(f"import mbdae as mb\nt_end = 0.5\n\n\ndef scene():\n    s = mb.Scene('p', gravity=(0, -9.81, 0))\n"
                    f"    rod = s.link('rod', (0, 0), (1, 0), mass=1.0)\n    s.revolute('hinge', s.ground, rod, at=(0, 0), "
                    f"damper={damper}, model=mb.Recursive())\n    return s\n")
    assert main(["run", str(file), "--accuracy", "1e-7"]) == 0
    assert f"solver chosen: {why}" in capsys.readouterr().out


@pytest.mark.parametrize("scene", [tree_on_ground, prescribed])
def test_unknowns_are_those_of_the_joints(scene: Callable[[], mb.Scene]) -> None:
    s = scene()
    free = [c for c in s.joints if not c.prescribed]
    found = s.check()
    assert found.unknowns == {"positions": len(free), "velocities": len(free), "states": 0, "multipliers": 0}
    assert found.degrees_of_freedom == len(free)


def test_a_model_is_replaced_wherever_it_was_given() -> None:
    """By position, by name or not at all: the statement of the new scene has one model, the other arguments stay."""
    s = mb.Scene("three slides")
    a, b, c = (s.rigid_body(name, 1.0, (1, 1, 1)) for name in "abc")
    s.revolute("by position", s.ground, a, (0, 0), (0, 0, 1), R, None, 0.25)
    s.prismatic("by position too", s.ground, b, (0, 0), (1, 0), None, 0.5, None, 2.0, None, None, R)
    s.prismatic("by name", b, c, (0, 0), (1, 0), model=R, spring=3.0)
    for item in s.replace(model=mb.Classical()).joints:
        assert item.model == mb.Classical()
        assert item.hold == {"by position": {"angle": 0.25}, "by position too": {"displacement": 0.5}, "by name": {}}[item.name]
        assert len(item.laws) == (1 if item.name == "by position" else 2)
