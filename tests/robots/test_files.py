"""Robot files: what the scene says of them, and that damaged and hostile ones end in one clear error."""

from __future__ import annotations

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
