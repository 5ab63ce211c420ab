"""Robot files: what the scene says of them, and that damaged and hostile ones end in one clear error."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb

pytest.importorskip("yourdfpy", reason="the extra `robots` is not installed: yourdfpy reads URDF")
mujoco = pytest.importorskip("mujoco", reason="the extra `robots` is not installed: MuJoCo compiles MJCF")

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0.1" rpy="0.3 0 0.1"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.025"/></inertial>
    <visual><geometry><box size="0.4 0.1 0.1"/></geometry></visual></link>
  <link name="lower"><inertial><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <link name="finger"><inertial><mass value="0.1"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.5" rpy="0 0.2 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="1"/><dynamics damping="0.5" friction="0.1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/>
    <axis xyz="1 2 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="lower"/><child link="finger"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="5" velocity="1"/><mimic joint="elbow" multiplier="0.1" offset="0.02"/></joint>
  <joint name="flange" type="fixed"><parent link="lower"/><child link="tool"/><origin xyz="0.3 0 0"/></joint>
  <gazebo/>
</robot>
"""
MODEL = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="base" pos="0 0 1"><freejoint/><inertial pos="0.1 0 0" mass="3" diaginertia="0.1 0.2 0.25"/>
    <body name="leg" pos="0 0.2 0"><joint name="hip x" axis="1 0 0" armature="0.02"/>
      <joint name="hip y" axis="0 1 0" pos="0 0 0.1"/>
      <inertial pos="0 0 -0.2" mass="1" diaginertia="0.02 0.02 0.01"/></body></body>
</worldbody></mujoco>"""


def written(folder: Path, text: str, name: str = "robot.urdf") -> Path:
    """A file with a text."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_urdf_says_what_it_says(tmp_path: Path) -> None:
    s = mb.read_urdf(written(tmp_path, ARM))
    tree = s.tree()
    assert tree.names == ("shoulder", "elbow")
    assert tree.follows == ("grip.displacement",)
    assert tree.pose("tool", tree.zero)[:, 3] == pytest.approx([0.7 * np.cos(0.2), 0, 0.5 - 0.7 * np.sin(0.2)])
    assert any("Gazebo" in text for text in s.told)
    assert any("friction" in text for text in s.told)
    r = s.simulate(0.05, accuracy=1e-5)
    assert r["grip"].displacement == pytest.approx(0.1 * r["elbow"].angle + 0.02, abs=1e-6)


def test_urdf_beside_pinocchio(tmp_path: Path) -> None:
    pin = pytest.importorskip("pinocchio", reason="the extra `oracle` is not installed")
    text = ARM[: ARM.index('  <joint name="grip"')] + ARM[ARM.index('  <joint name="flange"') :]
    limit = '<limit lower="-9" upper="9" effort="1" velocity="1"/>'  # Pinocchio's continuous joints have a cosine and a sine
    text = text.replace('type="continuous"', 'type="prismatic"').replace('<axis xyz="1 2 0"/>', f'<axis xyz="1 2 0"/>{limit}')
    start, end = text.index('  <link name="finger">'), text.index('  <link name="tool"/>')
    path = written(tmp_path, text[:start] + text[end:])
    model = pin.buildModelFromUrdf(str(path))
    tree, data, rng = mb.read_urdf(path).tree(), model.createData(), np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 2))
    assert tree.inverse_dynamics(q, v, a) == pytest.approx(pin.rnea(model, data, q, v, a), abs=1e-11)


def test_mjcf_beside_mujoco(tmp_path: Path) -> None:
    path = written(tmp_path, MODEL, "model.xml")
    s = mb.read_mjcf(path)
    tree, model = s.tree(), mujoco.MjModel.from_xml_path(str(path))
    assert tree.names == ("base", "hip x", "hip y")
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
    data.qvel[:], data.qfrc_applied[:] = rng.normal(size=(2, model.nv))
    mujoco.mj_forward(model, data)
    q = data.qpos - model.qpos0 + tree.zero
    assert tree.forward_dynamics(q, data.qvel, data.qfrc_applied) == pytest.approx(data.qacc, abs=1e-9)


@pytest.mark.parametrize(("old", "new", "said"), [
    ("<robot", '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><robot', "entities"),
    ('izz="0.025"', "", "izz"), ('mass value="2"', 'mass value="nan"', "finite"), ('izz="0.025"', 'izz="0.25"', "sum"),
    ('child link="upper"', 'child link="nobody"', "nobody"), ('parent link="base"', 'parent link="lower"', "circle"),
    ("</robot>", "", "XML"), ('type="continuous"', 'type="ball"', "ball"), ('mimic joint="elbow"', 'mimic joint="none"', "none"),
])
def test_damaged_urdf_is_one_clear_error(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises((mb.SceneError, mb.OptionError), match=said):
        mb.read_urdf(written(tmp_path, ARM.replace(old, new, 1)))


@pytest.mark.parametrize("extension", ["urdf", "xml"])
def test_files_damaged_at_random_end_in_errors_of_the_package(tmp_path: Path, extension: str) -> None:
    rng = np.random.default_rng(1)
    text = ARM if extension == "urdf" else MODEL
    for _ in range(12):
        at, count = int(rng.integers(60, len(text))), int(rng.integers(1, 30))
        path = written(tmp_path, text[:at] + text[at + count :], f"robot.{extension}")
        try:
            (mb.read_urdf if extension == "urdf" else mb.read_mjcf)(path)
        except (mb.SceneError, mb.OptionError):
            continue


def test_what_mjcf_cannot_have_is_refused(tmp_path: Path) -> None:
    plugin = MODEL.replace("<compiler", '<extension><plugin plugin="x"/></extension><compiler')
    with pytest.raises(mb.OptionError, match="not run"):
        mb.read_mjcf(written(tmp_path, plugin, "plugin.xml"))
    with pytest.raises(mb.OptionError, match="includes"):
        mb.read_mjcf(written(tmp_path, MODEL.replace("<compiler", '<include file="/etc/passwd"/><compiler'), "include.xml"))
    with pytest.raises(mb.OptionError, match="fetched"):
        mb.read_mjcf(written(tmp_path, MODEL.replace("<compiler", '<include file="http://x.y/z"/><compiler'), "net.xml"))


def test_what_is_written_moves_as_the_scene(tmp_path: Path) -> None:
    """URDF with a mimic joint, a floating base with two joints on one body: written, read back, and MuJoCo's own mass matrix."""
    for s in (mb.read_urdf(written(tmp_path, ARM)), mb.read_mjcf(written(tmp_path, MODEL, "model.xml"))):
        told = s.write_mjcf(tmp_path / "out.xml")
        assert not [text for text in told if "not drawn" in text]
        again = mb.read_mjcf(tmp_path / "out.xml")
        one, other, rng = s.tree(), again.tree(), np.random.default_rng(1)
        assert one.names == other.names
        assert one.follows == other.follows
        q, v = one.zero + 0.0, rng.normal(size=one.nv)
        q[-2:] = rng.normal(size=2)
        # MuJoCo 3.3 finds principal axes to 1e-11, later ones to round-off
        assert other.mass_matrix(q) == pytest.approx(one.mass_matrix(q), abs=1e-10)
        assert other.bias(q, v) == pytest.approx(one.bias(q, v), abs=1e-10)
        assert set(s.frames) <= set(again.frames)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[-2:] = q[-2:]
    mujoco.mj_forward(model, data)
    for column, unit in zip(M, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    assert pytest.approx(one.mass_matrix(q), abs=1e-10) == M.T


def test_forces_limits_loops_and_starts_are_written(tmp_path: Path) -> None:
    s = mb.Scene("bars", gravity=(0, 0, -9.81))
    left = s.rigid_body("left", 1.0, (0.1, 0.1, 0.01), at=(0, 0, 0.5), shape=mb.Box(size=(0.1, 0.1, 1)))
    top = s.rigid_body("top", 2.0, (0.01, 0.2, 0.2), at=(0.5, 0, 1), gravity=(0, 0, -4.905))
    right = s.rigid_body("right", 1.0, (0.1, 0.1, 0.01), at=(1, 0, 0.5))
    s.joint(mb.Revolute, "A", s.ground, left, at=(0, 0, 0), axis=(0, 1, 0), spring=3.0, load=0.6, damper=0.7, rotor=0.4,
            start=0.1, limits=(-1, 2), stop=mb.Stop(1e4), friction=mb.Coulomb(0.5, 1e-3), radius=0.1, normal_force=20.0)
    s.revolute("B", top, left, at=(0, 0, 1), axis=(0, 1, 0))  # from outside inwards: MJCF counts the other way
    s.revolute("C", top, right, at=(1, 0, 1), axis=(0, 1, 0))
    s.spherical("D", s.ground, right, at=(1, 0, 0))
    told = s.write_mjcf(tmp_path / "bars.xml")
    assert [text for text in told if "'D' closes a loop" in text]
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "bars.xml"))
    joint = model.joint("A")
    assert (joint.stiffness[0], joint.armature[0], joint.frictionloss[0]) == pytest.approx((3.0, 0.4, 1.0))
    assert model.qpos_spring[joint.qposadr[0]] == pytest.approx(0.2)
    assert joint.range == pytest.approx([-1, 2])
    assert model.key("start").qpos[joint.qposadr[0]] == pytest.approx(0.1)
    assert model.body_gravcomp[model.body("top").id] == pytest.approx(0.5)
    assert mb.read_mjcf(tmp_path / "bars.xml").tree().closing == ("D",)


def test_joints_of_several_coordinates_and_hinges_that_close_loops_are_written(tmp_path: Path) -> None:
    """Planar, universal and cylindrical joints, stated from both sides, as chains of hinges and slides; starts as a key frame."""
    s = mb.Scene("chains", gravity=(0, 0, -9.81))
    bodies = [s.ground, *(s.rigid_body(f"b{i}", 1.0 + i, (0.1, 0.2, 0.25), at=(i, 0.2, 0)) for i in range(4))]
    s.joint(mb.Planar, "P", s.ground, bodies[1], at=(0, 0, 0), axis=(0, 0, 1), start={"x": 0.1}, start_rate={"angle": 2.0},
            damper={"x": 0.3}, rotor={"y": 0.2})
    s.joint(mb.Cylindrical, "C", bodies[2], bodies[1], at=(1, 0, 0), axis=(1, 2, 0), start={"angle": 0.3})
    s.universal("U", bodies[3], bodies[2], at=(2, 0, 0), axis=(1, 0, 0))
    s.revolute("A", bodies[3], bodies[4], at=(2, 1, 0), axis=(0, 0, 1))
    s.write_mjcf(tmp_path / "chains.xml")  # compares inverse dynamics
    again = mb.read_mjcf(tmp_path / "chains.xml", key="start")
    assert again.tree().nv == s.tree().nv
    times = [0.0, 0.1]
    one, other = s.simulate(0.1, accuracy=1e-8, outputs=times), again.simulate(0.1, accuracy=1e-8, outputs=times)
    assert other["P x"].displacement == pytest.approx(one["P"].x, abs=1e-7)
    assert other["C angle"].angle == pytest.approx(one["C"].angle, abs=1e-7)
    assert other["b3"].position == pytest.approx(one["b3"].position, abs=1e-7)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "chains.xml"))
    assert model.joint("P y").armature[0] == pytest.approx(0.2)


def test_a_hinge_that_closes_a_loop_comes_back(tmp_path: Path) -> None:
    s = mb.Scene("bars", gravity=(0, 0, -9.81))
    left, top, right = (s.rigid_body(name, 1.0, (0.1, 0.1, 0.1), at=at) for name, at in (
        ("left", (0, 0, 0.5)), ("top", (0.5, 0, 1)), ("right", (1, 0, 0.5))))
    s.revolute("A", s.ground, left, at=(0, 0, 0), axis=(0, 1, 0), rate0=0.5)
    s.revolute("B", left, top, at=(0, 0, 1), axis=(0, 1, 0))
    s.revolute("C", top, right, at=(1, 0, 1), axis=(0, 1, 0))
    s.revolute("D", s.ground, right, at=(1, 0, 0), axis=(0, 1, 0), model=mb.Kinematic())
    s.write_mjcf(tmp_path / "bars.xml")
    again = mb.read_mjcf(tmp_path / "bars.xml")
    assert type(again["D"].laws[0]) is mb.Revolute
    assert again["D"].laws[0].axis == pytest.approx([0, 1, 0])


def test_switches_and_keys_of_mjcf_are_read(tmp_path: Path) -> None:
    keys = '<keyframe><key name="up" qpos="1 2 3 0.6 0 0.8 0 0.5 0.2" qvel="1 0 0 0 0 2 0.3 0.4"/></keyframe>'
    text = MODEL.replace("<worldbody>", '<option><flag gravity="disable"/></option><worldbody>')
    path = written(tmp_path, text.replace("</mujoco>", f"{keys}</mujoco>"), "model.xml")
    assert any("'up'" in said for said in mb.read_mjcf(path).told)
    s = mb.read_mjcf(path, key="up")
    assert not np.any(s.tree().gravity(s.tree().zero))
    r = s.simulate(1e-3, accuracy=1e-6, outputs=[0.0, 1e-3])
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert r["leg"].position[0] == pytest.approx(data.xipos[2], abs=1e-9)
    assert r["hip y"].rate[0] == pytest.approx(0.4)
    velocity = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, 2, velocity, 0)
    assert r["leg"].angular_velocity[0] == pytest.approx(velocity[:3], abs=1e-9)
    with pytest.raises(mb.OptionError, match="key"):
        mb.read_mjcf(path, key="down")


def test_links_on_the_ground_have_frames(tmp_path: Path) -> None:
    tree = mb.read_urdf(written(tmp_path, ARM)).tree()
    assert not np.any(tree.jacobian("base", tree.zero))
    assert tree.pose("base", np.zeros((3, 2)), at=(1, 0, 0))[:, :, 3] == pytest.approx(np.array([[1.0, 0, 0]] * 3))


def test_copies_beyond_reason_and_mimics_in_a_circle_are_refused(tmp_path: Path) -> None:
    copies = '<replicate count="3000"><replicate count="3000"><geom size="1"/></replicate></replicate>'
    with pytest.raises(mb.OptionError, match="copies"):
        mb.read_mjcf(written(tmp_path, MODEL.replace("<worldbody>", f"<worldbody>{copies}"), "model.xml"))
    text = ARM.replace('<axis xyz="1 2 0"/></joint>', '<axis xyz="1 2 0"/><mimic joint="grip"/></joint>')
    with pytest.raises(mb.SceneError, match="circle"):
        mb.read_urdf(written(tmp_path, text))


def test_what_mjcf_cannot_say_is_refused_by_name(tmp_path: Path) -> None:
    s = mb.Scene("many", gravity=(0, 0, -9.81))
    a, b = (s.rigid_body(name, 1.0, (1, 1, 1), at=(x, 0, 0)) for name, x in (("a", 0), ("b", 1)))
    s.screw("hook", s.ground, a, at=(0, 0, 0), axis=(1, 0, 0), lead=0.1)
    s.revolute("drive", a, b, at=(0.5, 0, 0), axis=(0, 0, 1), angle=mb.t)
    s.spring("rubber", a, b, at_k=(0, 0, 0), at_l=(1, 0, 0), stiffness=3.0)
    with pytest.raises(mb.SceneError) as caught:
        s.write_mjcf(tmp_path / "many.xml")
    assert all(name in str(caught.value) for name in ("'hook'", "'drive'", "'rubber'"))
    assert not (tmp_path / "many.xml").exists()


def test_sites_are_frames(tmp_path: Path) -> None:
    text = MODEL.replace("<freejoint/>", '<freejoint/><site name="eye" pos="0.1 0.2 0.3"/>')
    s = mb.read_mjcf(written(tmp_path, text, "model.xml"))
    tree = s.tree()
    assert tree.pose("eye", tree.zero)[:, 3] == pytest.approx([0.1, 0.2, 1.3])


def test_a_joint_may_have_the_name_of_a_link(tmp_path: Path) -> None:
    text = ARM.replace('"elbow"', '"lower"').replace('"shoulder"', '"upper"')
    s = mb.read_urdf(written(tmp_path, text))
    assert s.tree().names == ("upper joint", "lower joint")
    assert any("joint 'lower' is 'lower joint'" in said for said in s.told)


@pytest.mark.parametrize(("old", "floating", "renamed"), [
    ("base", False, ""), ("base", True, "link"), ("upper", False, "link"), ("tool", False, "link"), ("elbow", False, "joint")])
def test_an_item_of_urdf_may_have_the_name_of_the_ground(tmp_path: Path, old: str, floating: bool, renamed: str) -> None:
    """It is read by a name of its own, which is told, and moves as before; `ground` stays the inertial frame."""
    text = ARM
    if floating:  # a floating link needs a mass
        lower = ARM[ARM.index('<link name="lower">') : ARM.index('  <link name="finger">')]
        text = ARM.replace('<link name="base"/>', lower.replace("lower", "base"))
    trees = []
    for name in (old, "ground"):
        s = mb.read_urdf(written(tmp_path, re.sub(f'(name|link|joint)="{old}"', rf'\1="{name}"', text)), floating=floating)
        trees.append(s.tree())
        if name == "ground":
            assert any(f"{renamed} 'ground' is 'ground {renamed}'" in said for said in s.told) is bool(renamed)
    tree, rng = trees[1], np.random.default_rng(0)
    q, (v, a) = tree.zero + 0.0, rng.normal(size=(2, tree.nv))
    assert tree.names == tuple(f"ground {renamed}" if name == old else name for name in trees[0].names)
    assert tree.inverse_dynamics(q, v, a) == pytest.approx(trees[0].inverse_dynamics(q, v, a))
    assert tree.pose("ground", q, at=(1, 2, 3)) == pytest.approx(np.column_stack([np.eye(3), (1, 2, 3)]))
    assert not np.any(tree.jacobian("ground", q))
    assert not np.any(tree.jacobian_rate(s.ground, q, v))


@pytest.mark.parametrize(("old", "renamed"), [("leg", "body"), ("hip x", "joint"), ("eye", "site")])
def test_an_item_of_mjcf_may_have_the_name_of_the_ground(tmp_path: Path, old: str, renamed: str) -> None:
    text = MODEL.replace("<freejoint/>", '<freejoint/><site name="eye" pos="0.1 0.2 0.3"/>').replace(f'"{old}"', '"ground"')
    s = mb.read_mjcf(written(tmp_path, text, "model.xml"))
    tree, model = s.tree(), mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    assert any(f"{renamed} 'ground' is 'ground {renamed}'" in said for said in s.told)
    assert f"ground {renamed}" in {*tree.links, *tree.names}
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert tree.forward_dynamics(tree.zero, np.zeros(8), np.zeros(8)) == pytest.approx(data.qacc)
    assert tree.pose("ground", tree.zero) == pytest.approx(np.eye(3, 4))


def test_a_body_with_mujocos_name_of_the_ground_is_refused_when_written(tmp_path: Path) -> None:
    s = mb.Scene("one", gravity=(0, 0, -9.81))
    s.revolute("J", s.ground, s.rigid_body("world", 1.0, (0.1, 0.1, 0.1), at=(1, 0, 0)), at=(0, 0, 0), axis=(0, 1, 0))
    with pytest.raises(mb.SceneError, match="body 'world': MuJoCo calls the ground so"):
        s.write_mjcf(tmp_path / "one.xml")


ACTED = """<mujoco><option gravity="0 0 0"/><worldbody><body name="arm"><joint name="j" {joint}/><geom size=".1" pos="1 0 0"/>
  </body></worldbody><actuator>{actuator}</actuator></mujoco>"""


def acted(folder: Path, joint: str = "", actuator: str = "") -> mb.Scene:
    """The scene of an arm on a hinge with an actuator."""
    text = ACTED.format(joint=joint, actuator=actuator)
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        pytest.skip(f"this version of MuJoCo does not know of it: {error}")
    return mb.read_mjcf(written(folder, text, "arm.xml"))


def test_armature_and_damping_of_actuators_are_those_of_the_joint(tmp_path: Path) -> None:
    bare = acted(tmp_path).tree().mass_matrix([0.0])
    s = acted(tmp_path, 'armature="0.5"', '<motor joint="j" armature="3" damping="2" gear="2"/>')
    assert s.tree().mass_matrix([0.0]) == pytest.approx(bare + 0.5 + 4 * 3)
    damper = next(law for law in s["j"].laws if hasattr(law, "damping"))
    assert float(damper.damping) == pytest.approx(4 * 2)


@pytest.mark.parametrize(("joint", "actuator", "said"), [
    ('stiffness="1" springyield="0.2"', "", "yields"), ('damping="1 2"', "", "polynomial of its damping"),
    ('stiffness="1 2"', "", "polynomial of its stiffness"),
    ("", '<motor joint="j" damping="1 2"/>', "'j': its damping in MuJoCo"),
])
def test_what_acts_on_joints_and_is_not_modelled_is_refused(tmp_path: Path, joint: str, actuator: str, said: str) -> None:
    with pytest.raises(mb.SceneError, match=said):
        acted(tmp_path, joint, actuator)


def test_damping_of_balls_and_floating_bases_is_that_of_mujoco(tmp_path: Path) -> None:
    text = """<mujoco><option gravity="0 0 0"/><worldbody><body name="base"><joint name="f" type="free" damping="0.7"/>
      <inertial pos="0.1 0 0.2" mass="2" diaginertia="0.3 0.2 0.25"/><body name="arm" pos="1 0 0"><joint name="b" type="ball"
      damping="0.4"/><inertial pos="0 0.3 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></body></worldbody>
      <keyframe><key name="k" qpos="0 0 0 1 0 0 0 1 0 0 0" qvel="1 2 3 0.4 -0.5 0.6 0 0 0"/></keyframe></mujoco>"""
    path = written(tmp_path, text, "model.xml")
    s, model = mb.read_mjcf(path, key="k"), mujoco.MjModel.from_xml_path(str(path))
    assert not [said for said in s.told if "left out" in said]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    found = np.zeros(6)
    mujoco.mj_rnePostConstraint(model, data)
    mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_BODY, 2, found, 0)
    r = s.simulate(1e-3, accuracy=1e-7, outputs=[0.0, 1e-3])
    assert r["arm"].angular_acceleration[0] == pytest.approx(found[:3], abs=1e-8)
    assert r["arm"].acceleration[0] == pytest.approx(found[3:], abs=1e-8)
    s.write_mjcf(tmp_path / "again.xml")
    again = mujoco.MjModel.from_xml_path(str(tmp_path / "again.xml"))
    assert again.dof_damping == pytest.approx(model.dof_damping)


@pytest.mark.parametrize(("old", "new", "said"), [
    ('<limit lower="-2"', '<limts/><limit lower="-2"', "<limts> of <joint>"),
    ('<dynamics damping="0.5"', '<dynamics dampin="0.5"', "dampin of <dynamics>"),
    ('<link name="tool"/>', '<link name="tool"><self_collide/></link>', "<self_collide> of <link>"),
    ("<visual>", '<visual shade="1">', "shade of <visual>"), ("<box size", "<box edge='1' size", "edge of <box>"),
    ("</inertial>", "<added_mass/></inertial>", "<added_mass> of <inertial>"), ("<gazebo/>", "<unheard/>", "<unheard>"),
    ('upper="2" effort', 'upper="2" jerk="1" effort', "jerk of <limit>"),
    ('mimic joint="elbow"', 'mimic joint="elbow" lag="1"', "lag of <mimic>"),
    ("<origin xyz", '<origin frame="1" xyz', "frame of <origin>"), ("x", "x", "limits of a mimic joint"),
    ('<axis xyz="1 2 0"/>', '<axis xyz="1 2 0"/><limit lower="0" upper="1"/>', "limits of a continuous joint"),
])
def test_what_urdf_says_and_is_not_read_is_told(tmp_path: Path, old: str, new: str, said: str) -> None:
    told = mb.read_urdf(written(tmp_path, ARM.replace(old, new, 1))).told
    assert any(said in text for text in told), told


def test_damping_of_planar_and_floating_joints_acts(tmp_path: Path) -> None:
    for kind in ("planar", "floating"):
        text = ARM[: ARM.index('  <joint name="grip"')] + ARM[ARM.index('  <joint name="flange"') :]
        start, end = text.index('  <link name="finger">'), text.index('  <link name="tool"/>')
        text = (text[:start] + text[end:]).replace('type="continuous"', f'type="{kind}"')
        text = text.replace('<axis xyz="1 2 0"/>', '<axis xyz="1 2 0"/><dynamics damping="3"/>')
        s = mb.read_urdf(written(tmp_path, text), gravity=(0, 0, 0))
        assert any("alike" in said for said in s.told)
        assert any("damp" in c.name or any("damping" in law.params for law in c.laws) for c in s.connections if "elbow" in c.name)


def test_what_mjcf_says_and_is_not_read_is_told_or_refused(tmp_path: Path) -> None:
    text = MODEL.replace("<worldbody>", '<worldbody><light pos="0 0 3"/><camera name="eye" pos="0 0 3"/><geom name="floor" '
                         'type="plane" size="1 1 1" contype="0" conaffinity="0"/>').replace("</mujoco>", """
      <contact><pair geom1="floor" geom2="ball"/></contact><sensor><jointpos joint="hip x"/></sensor>
      <custom><numeric name="n" data="1"/><text name="t" data="x"/></custom>
      <actuator><motor joint="hip x"/></actuator><keyframe><key name="up"/></keyframe></mujoco>""")
    text = text.replace("<freejoint/>", '<freejoint/><geom name="ball" size="0.1" mass="0" contype="0" conaffinity="0"/>')
    told = " ".join(mb.read_mjcf(written(tmp_path, text, "model.xml")).told)
    for word in ("contacts", "sensors (1)", "cameras (1)", "lights (1)", "custom numbers, texts and tuples (2)",
                 "pictures of planes (1)", "actuators (1", "'up'"):
        assert word in told
    for old, new in (("armature=", "armatur="), ("<freejoint/>", "<freejoint/><unheard/>")):
        with pytest.raises(mb.OptionError, match="does not compile"):
            mb.read_mjcf(written(tmp_path, MODEL.replace(old, new), "model.xml"))


def test_equalities_of_links_without_mass_hold_the_bodies_that_carry_them(tmp_path: Path) -> None:
    frame = '<body name="tip" pos="0 0 -0.5"><site name="end"/></body></body>'
    ground = '<body name="post" pos="0 0.2 0.5"><geom size="0.1"/></body>'
    equality = '<equality><connect body1="tip" body2="post" anchor="0 0 0"/><weld body1="post" body2="world"/></equality>'
    text = MODEL.replace("</body></body>", f"{frame}</body>{ground}").replace("</mujoco>", f"{equality}</mujoco>")
    s = mb.read_mjcf(written(tmp_path, text, "model.xml"))
    assert {s["equality 0"].k.name, s["equality 0"].l.name} == {"leg", "ground"}
    assert any("always holds" in said for said in s.told)


def test_robots_of_any_size_keep_their_inertia(tmp_path: Path) -> None:
    """The arm a million times smaller: masses by 1e-9, inertias by 1e-21 where lengths are by 1e-6."""
    text = ARM.replace('friction="0.1"', "").replace('damping="0.5"', "")
    inertia = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1e-21)
    scale = {"mass value": 1e-9, "offset": 1e-6, "multiplier": 1e-6, **inertia}
    for word, by in scale.items():
        text = re.sub(rf'({word}=")([^"]*)"', lambda m, by=by: f'{m[1]}{float(m[2]) * by!r}"', text)
    text = re.sub(r'(<origin xyz=")([^"]*)"', lambda m: f'{m[1]}{" ".join(repr(float(x) * 1e-6) for x in m[2].split())}"', text)
    whole, small = (mb.read_urdf(written(tmp_path, one)).tree() for one in (ARM, text))
    q, v, a = np.random.default_rng(0).normal(size=(3, 2))
    assert small.mass_matrix(q) * 1e21 == pytest.approx(whole.mass_matrix(q), rel=1e-9)
    rest = np.zeros(2)
    assert small.inverse_dynamics(q, v, a) - small.gravity(q) == pytest.approx(
        1e-21 * (whole.inverse_dynamics(q, v, a) - whole.gravity(q)), rel=1e-4)
    assert small.forward_dynamics(q, rest, small.gravity(q)) == pytest.approx(rest, abs=1e-3)


@pytest.mark.parametrize(("key", "told"), [('qpos="0.5 0" qvel="1 1"', True), ('qpos="0.5 1" qvel="1 7"', True),
                                           ('qpos="0.5 1" qvel="0.5 1"', False)])
def test_a_key_frame_that_contradicts_a_tie_of_joints_is_told(tmp_path: Path, key: str, told: bool) -> None:
    ball = '<geom size=".1" mass="1" pos=".2 0 0"/>'
    bodies = "".join(f'<body name="b{i}" pos="0 0 {i}"><joint name="j{i}" axis="0 1 0"/>{ball}</body>' for i in (1, 2))
    file = written(tmp_path, f'<mujoco><worldbody>{bodies}</worldbody><equality><joint name="tie" joint1="j1" joint2="j2" '
                             f'polycoef="0 0.5 0 0 0"/></equality><keyframe><key name="k" {key}/></keyframe></mujoco>', "tie.xml")
    s = mb.read_mjcf(file, key="k")
    assert any("contradicts" in line for line in s.told) is told


TIED = ('<mujoco><worldbody>' + "".join(
    f'<body name="b{i}" pos="0 0 {i}"><joint name="j{i}" axis="0 1 0"/><geom size=".1" mass="1" pos=".2 0 0"/></body>'
    for i in (1, 2, 3)) + '</worldbody><equality>{}</equality><keyframe><key name="k" qpos="{}"/></keyframe></mujoco>')


def tie(name: str, one: int, other: int, offset: float, factor: float = 1.0) -> str:
    """An equality of joints: one is offset and factor times the other."""
    second = f'joint2="j{other}"' if other else ""
    return f'<joint name="{name}" joint1="j{one}" {second} polycoef="{offset} {factor} 0 0 0"/>'


@pytest.mark.parametrize(("ties", "named"), [
    ((("a", 1, 2, 0), ("b", 1, 2, 0.3)), "'a', 'b'"), ((("a", 1, 2, 0), ("b", 2, 3, 0), ("c", 3, 1, 0.2)), "'a', 'b', 'c'"),
    ((("a", 1, 0, 0.1), ("b", 1, 0, 0.2)), "'a', 'b'"), ((("a", 1, 2, 0), ("b", 1, 2, 0, 2), ("c", 2, 0, 0.1)), "'a', 'b', 'c'"),
    ((("t1", 1, 2, 0.1), ("same", 2, 1, -0.1)), ""), ((("t1", 1, 2, 0.1, 2), ("t2", 2, 3, 0.2, -3), ("t3", 1, 3, 0.5, -6)), "")])
def test_ties_that_contradict_each_other_are_refused_by_name(tmp_path: Path, ties: tuple, named: str) -> None:
    """And no others: those that follow from others are read."""
    file = written(tmp_path, TIED.format("".join(tie(*one) for one in ties), "0 0 0"), "tied.xml")
    if named:
        with pytest.raises(mb.SceneError, match=f"equalities {named}: they contradict each other"):
            mb.read_mjcf(file)
    else:
        assert len(mb.read_mjcf(file).tree().follows) == len(ties) - 1


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize("key", [None, "k"])
def test_chains_of_ties_start_closed_and_are_folded_in(tmp_path: Path, order: tuple, key: str | None) -> None:
    """Whatever their order in the file, with the start that the last joint has in the key frame."""
    ties = [tie("t1", 1, 2, 0.1, 2), tie("t2", 2, 3, 0.2, -1)]
    s = mb.read_mjcf(written(tmp_path, TIED.format("".join(ties[i] for i in order), "0.5 0.2 0.4"), "tied.xml"), key=key)
    assert any("'t1'" in said and "'t2'" in said and "'j1'" in said and "'j2'" in said for said in s.told) is (key is None)
    assert any("contradicts ties of joints ('t2')" in said for said in s.told) is (key is not None)
    r, last = s.simulate(1e-3, outputs=[0.0, 1e-3]), 0.4 if key else 0.0
    assert [r[f"j{i}"].angle[0] for i in (1, 2, 3)] == pytest.approx([0.1 + 2 * (0.2 - last), 0.2 - last, last], abs=1e-9)
    tree = s.tree()
    assert (tree.names, set(tree.follows), tree.closing) == (("j3",), {"j1.angle", "j2.angle"}, ())
    assert tree.mass_matrix([0.3]) == pytest.approx(np.array([[6 * (0.004 + 0.04)]]))


def test_a_key_frame_may_be_rounded(tmp_path: Path) -> None:
    file = written(tmp_path, TIED.format(tie("t", 1, 2, 0.1), "0.30000001 0.2 0"), "tied.xml")
    assert not any("contradicts" in said for said in mb.read_mjcf(file, key="k").told)


def test_bodies_may_be_named_as_links_that_are_made_for_joints(tmp_path: Path) -> None:
    ball = '<geom size=".1" pos=".1 0 0"/>'
    hips = f'<body name="a"><joint name="x" axis="0 1 0"/><joint name="y" axis="1 0 0"/>{ball}</body>'
    other = f'<body name="a after x" pos="1 1 1"><joint name="z" type="slide"/>{ball}</body>'
    for bodies in (hips + other, other + hips):
        tree = mb.read_mjcf(written(tmp_path, f"<mujoco><worldbody>{bodies}</worldbody></mujoco>", "q.xml")).tree()
        assert set(tree.names) == {"x", "y", "z"}
        assert tree.pose("a", tree.zero)[:, 3] == pytest.approx([0, 0, 0])
        assert tree.pose("a after x", tree.zero)[:, 3] == pytest.approx([1, 1, 1])


@pytest.mark.parametrize(("key", "told"), [('qpos="0 0 0"', False), ('qpos=".1 0 0"', True), ('qpos="0 0 0" qvel="1 0 0"', True)])
def test_a_key_frame_that_contradicts_a_loop_warns(tmp_path: Path, key: str, told: bool) -> None:
    links = "".join(f'<body name="b{i}" pos="{x} 0 {z}"><joint name="j{i}" axis="0 1 0"/><geom size=".1" pos=".02 0 0"/>'
                    for i, (x, z) in enumerate(((0, 1), (0.2, 0.3), (0.2, 0))))
    loop = '<equality><connect name="closed" body1="b2" body2="world" anchor="0.1 0 0"/></equality>'
    file = written(tmp_path, f'<mujoco><worldbody>{links}</body></body></body></worldbody>{loop}<keyframe><key name="h" {key}/>'
                             f'</keyframe></mujoco>', "loop.xml")
    if told:
        with pytest.warns(mb.AccuracyWarning, match="the key frame contradicts 'closed'"):
            mb.read_mjcf(file, key="h")
    else:
        assert not any("contradicts" in said for said in mb.read_mjcf(file, key="h").told)


@pytest.mark.parametrize(("actuator", "told"), [
    ('<motor joint="j"/>', False), ('<position joint="j" kp="3"/>', True), ('<velocity joint="j" kv="3"/>', True),
    ('<general joint="j" biastype="affine" biasprm="0 -2 0"/>', True), ('<motor joint="j" damping="2"/>', False)])
def test_actuators_that_act_without_control_warn(tmp_path: Path, actuator: str, told: bool) -> None:
    if told:
        with pytest.warns(mb.AccuracyWarning, match="act without control too"):
            acted(tmp_path, actuator=actuator)
    else:
        assert not any("without control" in said for said in acted(tmp_path, actuator=actuator).told)


def test_bodies_asleep_at_the_start_warn(tmp_path: Path) -> None:
    text = ('<mujoco><option><flag sleep="{}"/></option><worldbody><body sleep="init"><freejoint/><geom size=".1"/></body>'
            '</worldbody></mujoco>')
    try:
        mujoco.MjModel.from_xml_string(text.format("enable"))
    except ValueError as error:
        pytest.skip(f"this version of MuJoCo does not know of it: {error}")
    assert not any("sleep" in said for said in mb.read_mjcf(written(tmp_path, text.format("disable"), "off.xml")).told)
    with pytest.warns(mb.AccuracyWarning, match="sleep at the start"):
        mb.read_mjcf(written(tmp_path, text.format("enable"), "on.xml"))


def stiffness_of(scene: mb.Scene, joint: str) -> float:
    """Of the stop of a joint."""
    return next(float(law.stiffness) for law in scene[joint].laws if hasattr(law, "lower"))


@pytest.mark.parametrize(("effort", "force"), [('effort="50"', 50.0), ('effort="0"', 0.0), ("", 0.0), ('effort="1e-3"', 0.0)])
def test_stops_of_urdf_carry_effort_and_weight(tmp_path: Path, effort: str, force: float) -> None:
    """Whichever is more; an effort of 0 is not stated, which is told."""
    s = mb.read_urdf(written(tmp_path, ARM.replace('effort="50"', effort)))
    tree = s.tree()
    angles = np.linspace(0, 2 * np.pi, 721)[:, None] * [1, 0]
    weight = np.max(np.abs(tree.gravity(angles)[:, 0]))  # the arm as drawn, turned about its horizontal shoulder
    assert stiffness_of(s, "shoulder") == pytest.approx(max(force, weight) / 1e-3, rel=0.05)
    assert any("'shoulder': effort=\"0\"" in said for said in s.told) is (effort == 'effort="0"')


@pytest.mark.parametrize(("joint", "actuator", "force"), [
    ("", "", 0.0), ('actuatorfrcrange="-2000 3000"', "", 3000.0),
    ("", '<motor joint="j" gear="3" forcerange="-2e3 1e3"/>', 6000.0),
    ("", '<motor joint="j"/>', 0.0), ('actuatorfrcrange="-2000 3000"', '<motor joint="j" forcerange="-9e3 1"/>', 3000.0)])
def test_stops_of_mjcf_carry_effort_and_weight(tmp_path: Path, joint: str, actuator: str, force: float) -> None:
    """A slide of 100 kg sinks by 1 mm where no effort is stated."""
    text = ('<mujoco><worldbody><body><joint name="j" type="slide" axis="0 0 1" limited="true" range="-.05 .3" {}/>'
            '<geom size=".1" mass="100"/></body></worldbody><actuator>{}</actuator></mujoco>')
    s = mb.read_mjcf(written(tmp_path, text.format(joint, actuator), "heavy.xml"))
    assert stiffness_of(s, "j") == pytest.approx(max(force, 981.0) / 1e-3)


@pytest.mark.parametrize("offset", [0.0, 0.7])
def test_followers_start_by_ties_of_joints_that_start_within_limits(tmp_path: Path, offset: float) -> None:
    text = ARM.replace('type="continuous"', 'type="revolute"').replace('offset="0.02"', f'offset="{offset}"')
    text = text.replace('<axis xyz="1 2 0"/>', '<axis xyz="1 2 0"/><limit lower="0.5" upper="1" effort="5" velocity="1"/>')
    with pytest.warns(mb.AccuracyWarning, match="its start 0 rad is outside of its limits; it starts at 0.5"):
        s = mb.read_urdf(written(tmp_path, text))
    r = s.simulate(1e-3, outputs=[0.0, 1e-3])
    assert (r["elbow"].angle[0], r["grip"].displacement[0]) == pytest.approx((0.5, 0.05 + offset), abs=1e-9)
    limited = TIED.replace('name="j2"', 'name="j2" limited="true" range="30 60"')
    s = mb.read_mjcf(written(tmp_path, limited.format(tie("t", 1, 2, offset), "0 0 0"), "tied.xml"))
    r = s.simulate(1e-3, outputs=[0.0, 1e-3])
    assert (r["j1"].angle[0], r["j2"].angle[0]) == pytest.approx((np.pi / 6 + offset, np.pi / 6), abs=1e-9)


def test_chains_of_mimics_start_closed_whatever_their_order(tmp_path: Path) -> None:
    """The finger follows the elbow, which follows the shoulder, stated after it."""
    text = ARM.replace('<axis xyz="1 2 0"/>', '<axis xyz="1 2 0"/><mimic joint="shoulder" multiplier="2" offset="0.3"/>')
    start, end = text.index('  <joint name="grip"'), text.index('  <joint name="flange"')
    grip = text[start:end]
    text = (text[:start] + text[end:]).replace('  <joint name="shoulder"', f'{grip}  <joint name="shoulder"')
    s = mb.read_urdf(written(tmp_path, text))
    assert s.tree().names == ("shoulder",)
    r = s.simulate(1e-3, outputs=[0.0, 1e-3])
    assert (r["elbow"].angle[0], r["grip"].displacement[0]) == pytest.approx((0.3, 0.05), abs=1e-9)


def test_sites_keep_a_name_each(tmp_path: Path) -> None:
    text = MODEL.replace("<freejoint/>", '<freejoint/><site name="leg" pos="0.1 0 0"/><site name="leg site" pos="0.2 0 0"/>')
    tree = mb.read_mjcf(written(tmp_path, text, "model.xml")).tree()
    assert [tree.pose(name, tree.zero)[0, 3] for name in ("leg site", "leg site site")] == pytest.approx([0.1, 0.2])


def test_compensation_by_actuators_is_told_and_empty_models_are_read(tmp_path: Path) -> None:
    body = ('<body name="b" gravcomp="1"><joint axis="0 1 0" actuatorgravcomp="true"/>'
            '<geom size=".1" mass="1" pos=".2 0 0"/></body>')
    with pytest.warns(mb.AccuracyWarning, match="compensated in full"):
        mb.read_mjcf(written(tmp_path, f"<mujoco><worldbody>{body}</worldbody></mujoco>", "comp.xml"))
    assert not mb.read_mjcf(written(tmp_path, "<mujoco/>", "empty.xml")).bodies


def test_a_shape_that_urdf_does_not_have_is_told_and_not_drawn(tmp_path):
    (tmp_path / "a.urdf").write_text(
        '<robot name="r"><link name="base"/><link name="a"><inertial><origin xyz="0 0 0.5"/><mass value="1"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<visual><geometry><capsule radius="0.1" length="1"/></geometry></visual>'
        '<collision><geometry><capsule radius="0.1" length="1"/></geometry></collision></link>'
        '<joint name="j" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint></robot>')
    s = mb.read_urdf(tmp_path / "a.urdf")
    assert s.tree().mass_matrix([0.0]) == pytest.approx(np.array([[0.35]]))
    assert "<capsule> of <geometry>" in " ".join(s.told)


def test_a_tendon_whose_springs_are_switched_off_is_left_out(tmp_path):
    text = ('<mujoco><option>{}</option><worldbody><site name="s0"/><body name="a"><joint name="j" axis="0 1 0"/>'
            '<geom size="0.1" pos="0 0 0.5" mass="1"/><site name="s1"/></body></worldbody>'
            '<tendon><spatial name="T" stiffness="5"><site site="s0"/><site site="s1"/></spatial></tendon></mujoco>')
    (tmp_path / "off.xml").write_text(text.format('<flag spring="disable"/>'))
    assert "tendon 'T' is not read" in " ".join(mb.read_mjcf(tmp_path / "off.xml").told)
    (tmp_path / "on.xml").write_text(text.format(""))
    with pytest.raises(mb.SceneError, match="tendon 'T'"):
        mb.read_mjcf(tmp_path / "on.xml")


def test_what_a_key_frame_contradicts_and_its_time_are_told(tmp_path):
    """A tie with an offset that the key frame keeps is no contradiction; another one is, offset or not."""
    text = ('<mujoco><worldbody><body name="a"><joint name="i" axis="0 1 0"/><geom size="0.1" pos="0 0 0.5" mass="1"/></body>'
            '<body name="b" pos="1 0 0"><joint name="j" axis="0 1 0"/><geom size="0.1" pos="0 0 0.5" mass="1"/></body>'
            '</worldbody><equality><joint name="tie" joint1="j" joint2="i" polycoef="{} 1 0 0 0"/></equality>'
            '<keyframe><key name="K" qpos="0.2 {}" time="{}"/></keyframe></mujoco>')
    for offset, place, contradicts in ((0.3, 0.5, False), (0.3, 0.1, True), (0.0, 0.1, True)):
        (tmp_path / "k.xml").write_text(text.format(offset, place, 2.5))
        said = " ".join(mb.read_mjcf(tmp_path / "k.xml", key="K").told)
        assert ("contradicts" in said) is contradicts
        assert "the time 2.5 s of key frame 'K' is not read" in said


def test_a_loop_that_starts_flat_ends_at_once_and_says_so(tmp_path: Path) -> None:
    """Three hinges in a line: methods without multipliers crawl there without end."""
    box = '<geom type="box" size="0.1 0.05 0.02" pos="0.02 0.01 0.03"/>'
    (tmp_path / "flat.xml").write_text(
        f'<mujoco><worldbody><body name="a" pos="0 0 1"><joint name="j1" axis="0 1 0"/>{box}<body name="b" pos="0.2 0 0.3">'
        f'<joint name="j2" axis="0 1 0"/>{box}<body name="c" pos="0.2 0 0"><joint name="j3" axis="0 1 0"/>{box}</body></body>'
        '</body></worldbody><equality><connect body1="c" body2="a" anchor="0.1 0 0"/>'
        '<connect body1="a" body2="c" anchor="0.5 0.3 0.3"/></equality></mujoco>', encoding="utf-8")
    s = mb.read_mjcf(tmp_path / "flat.xml")
    assert "starts in a singular position" in str(s.check())
    with pytest.raises(mb.SolverError, match="singular position"):
        s.simulate(0.3, max_wall=30.0)
