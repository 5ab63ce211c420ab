"""A law means what it states now: what was derived of it before, in a process, on disk, in a worker or a file, does not count."""

from __future__ import annotations

import copy
import itertools
import os
import pickle
import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import mbdae as mb
from mbdae.laws.joints import Revolute
from mbdae.symbolic.derive import digest_of

sys.path.insert(0, str(Path(__file__).parent))
import changing

ORDERS = (changing.FACTORS, changing.FACTORS[::-1])


@pytest.mark.parametrize("name", changing.WAYS)
def test_the_motion_follows(name: str) -> None:
    """In both orders, and back again."""
    for first, second in ORDERS:
        found = [changing.pulled(name, f)["acceleration"] for f in (first, second, first)]
        np.testing.assert_allclose(found, [-first, -second, -first], rtol=1e-12)


EVERY_TENTH = random.Random(37).sample([*changing.WAYS], len(changing.WAYS) // 10)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in EVERY_TENTH else pytest.mark.slow) for n in changing.WAYS])
def test_digests_exports_and_reports_follow(name: str) -> None:
    for order in ORDERS:
        told = [_told(changing.scene(name, f)) for f in (*order, order[0])]
        assert told[0] == told[2]
        assert [a != b for a, b in zip(told[0], told[1], strict=True)] == [True] * 3


def _told(s: mb.Scene) -> tuple[str, str, str]:
    return digest_of(s.connections[0].laws[0]), mb.export(s, format="c").text, _page(s)


def _page(s: mb.Scene) -> str:
    law = s.connections[0].laws[0]
    chosen = {option: getattr(law, option) for option in law.options}
    return mb.report(type(law)(law.name, law.k, law.l, at=law.at, at_l=law.at_l, c=1.0, **chosen)).to_markdown()


def test_a_result_keeps_the_equations_that_were_integrated() -> None:
    r = changing.scene("list in place", 3.0).simulate(0.01)
    changing.scene("list in place", 6.0).simulate(0.01)
    np.testing.assert_allclose(r["pull"].force[0], [0, -3.0, 0], rtol=1e-12)  # read after the change
    with pytest.raises(mb.LawError, match=r"^ByList: it states something else now"):
        copy.deepcopy(r)
    changing.scene("list in place", 3.0)
    np.testing.assert_array_equal(copy.deepcopy(r)["pull"].force, r["pull"].force)


#: ways whose option is stored with the statement, so that a file gives it back, or cannot be stored; those in use are quick
STORED, NOT_STORED = "tuples of 1 and 1.0", {"option equal to another", "option changed", "function as an option"}
QUICK = {"list in place", "JSON file", "wrench", STORED, *NOT_STORED}


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in changing.WAYS])
def test_files_know_the_equations(name: str, tmp_path) -> None:
    for first, second in ORDERS:
        s = changing.scene(name, first)
        if name in NOT_STORED:
            with pytest.raises(mb.OptionError, match=r"'pull'.*(cannot be stored|has no name by which it could be found again)"):
                s.simulate(0.01).save(tmp_path / "run.npz")
            continue
        s.simulate(0.01).save(tmp_path / "run.npz")
        law = type(s.connections[0].laws[0])
        changing.scene(name, second)
        if name != STORED:
            with pytest.raises(mb.OptionError, match=rf"the law {law.__name__} states other equations than when the file was"):
                mb.load(tmp_path / "run.npz", laws=[law])
            changing.scene(name, first)
        assert mb.load(tmp_path / "run.npz", laws=[law])["pull"].force[0, 1] == pytest.approx(-first, rel=1e-12)


def test_a_checkpoint_knows_the_equations(tmp_path) -> None:
    changing.scene("list in place", 3.0).simulate(0.01, checkpoint=tmp_path)
    with pytest.raises(mb.OptionError, match="holds another run"):
        changing.scene("list in place", 6.0).simulate(0.01, checkpoint=tmp_path)


def test_threads_of_a_sweep_follow() -> None:
    """The scene prepared for batches is not that of an earlier sweep."""
    from concurrent.futures import ThreadPoolExecutor

    ends = []
    with ThreadPoolExecutor(1) as executor:
        for f in (3.0, 6.0, 3.0):
            s = changing.scene("list in place", f)
            ends.append(mb.sweep(s, {"b.mass": [1.0, 2.0]}, executor, t_end=1.0).array("b.y")[:, -1])
    np.testing.assert_array_equal(ends[0], ends[2])
    np.testing.assert_allclose(ends[0], np.cos(np.sqrt([3.0, 1.5])) - 1 + 1, atol=1e-5)
    np.testing.assert_allclose(ends[1], np.cos(np.sqrt([6.0, 3.0])), atol=1e-5)


# ---- joints ------------------------------------------------------------------------------------------------------------------

PITCH = 0.5  # m/rad


class Thread(mb.Joint):
    """l turns about and moves along k.z by a constant of this module."""

    coordinates = mb.params(angle=("rad", "rotation about k.z"))

    def motion(self, from_k):
        return from_k.about("z", self.angle).along("z", PITCH * self.angle)


class Rubbed(Revolute):
    """Friction by a constant of this module."""

    def normal_force(self, k, l, force, coefficient):
        return PITCH


def falling(model: mb.JointModel) -> float:
    s = mb.Scene("nut", gravity=(0, 0, -9.81))
    nut = s.rigid_body("nut", 2.0, (0.3, 0.3, 0.3), at=(0, 0, 0))
    s.joint(Thread, "thread", s.ground, nut, at=(0, 0, 0), model=model)
    return float(s.simulate(0.01)["nut"].acceleration[-1, 2])


@pytest.mark.parametrize("model", [mb.Recursive(), mb.Classical()])
def test_motions_of_joints_follow(model: mb.JointModel, monkeypatch) -> None:
    """m g p^2 / (J + m p^2) along the axis, p the pitch."""
    for pitch in (0.5, 0.2, 0.5):
        monkeypatch.setattr(sys.modules[__name__], "PITCH", pitch)
        assert falling(model) == pytest.approx(-9.81 * 2.0 * pitch**2 / (0.3 + 2.0 * pitch**2), rel=1e-6)


def test_friction_by_reactions_follows(monkeypatch) -> None:
    """A wheel that turns: the torque of friction is mu r N, N a constant of this module."""
    for force in (0.5, 2.0, 0.5):
        monkeypatch.setattr(sys.modules[__name__], "PITCH", force)
        s = mb.Scene("wheel")
        wheel = s.rigid_body("wheel", 1.0, (1.0, 1.0, 1.0), angular_velocity=(0, 0, 100.0))
        s.joint(Rubbed, "hinge", s.ground, wheel, at=(0, 0, 0), friction=mb.Coulomb(0.1, 1e-3), radius=0.2)
        r = s.simulate(0.01)
        assert r["wheel"].angular_acceleration[-1, 2] == pytest.approx(-0.1 * 0.2 * force, rel=1e-6)


def test_a_replaced_method_of_mbdae_is_seen(monkeypatch) -> None:
    from mbdae.laws.forces import PointSpring

    def frequency() -> float:
        s = mb.Scene("spring")
        b = s.point_mass("b", 1.0, at=(0, 2.0, 0))
        s.spring("spring", s.ground, b, (0, 0, 0), (0, 2.0, 0), stiffness=4.0, length=1.0)
        return float(s.simulate(0.01)["b"].acceleration[0, 1])

    assert frequency() == pytest.approx(-4.0)
    doubled = PointSpring.energy
    monkeypatch.setattr(PointSpring, "energy", lambda self, k, l: 2 * doubled(self, k, l))
    assert frequency() == pytest.approx(-8.0)


# ---- what cannot be told -------------------------------------------------------------------------------------------------------

RANDOM, COUNTED, CHOICES = random.Random(1), itertools.count(1), np.random.default_rng(1)
UNSTEADY = {
    "random number": lambda self: RANDOM.random(), "normal number": lambda self: float(CHOICES.normal()),
    "clock": lambda self: time.perf_counter(), "counter": lambda self: next(COUNTED),
    "system's random bytes": lambda self: int.from_bytes(os.urandom(4)),
    "changed by itself": lambda self: changing.NAMED.update(n=changing.NAMED.get("n", 0) + 1) or changing.NAMED["n"],
}


@pytest.mark.parametrize("name", UNSTEADY)
def test_what_changes_by_itself_is_refused(name: str) -> None:
    law = type("Unsteady", (changing.Pull,), {"factor": UNSTEADY[name]})
    s = mb.Scene("pulled")
    s.add(law("pull", s.ground, s.point_mass("b", 1.0, at=(0, 1.0, 0)), at=(0, 0, 0), at_l=(0, 1.0, 0), c=1.0))
    with pytest.raises(mb.SceneError, match="'pull': Unsteady states something else each time it is asked"):
        s.simulate(0.01)


# ---- other processes -----------------------------------------------------------------------------------------------------------

ARRIVES = """
import pickle, sys
import mbdae as mb
s = pickle.loads(sys.stdin.buffer.read())
try:
    print(s.simulate(0.01)["b"].acceleration[0, 1])
except mb.LawError as error:
    print(error)
"""


def test_a_scene_sent_to_another_process_means_the_same_there() -> None:
    """The other process reads the module, where the factor is 3."""
    for factor, answer in ((3.0, "-3.0"), (6.0, "'pull' states something else in this process")):
        sent = pickle.dumps(changing.scene("list in place", factor))
        there = os.environ | {"PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path])}
        found = subprocess.run([sys.executable, "-c", ARRIVES], input=sent, capture_output=True, env=there, check=False)
        assert found.stdout.decode().startswith(answer), found.stderr.decode()
    changing.scene("list in place", 3.0)


@pytest.mark.slow
def test_workers_follow() -> None:
    """All ways in two processes, each factor after the other and back."""
    points = [{"name": name, "factor": f} for order in (*ORDERS, ORDERS[0]) for f in order for name in changing.WAYS]
    found = mb.sweep(changing.pulled, points, workers=2)
    assert found.failures == []
    np.testing.assert_allclose(found.array("acceleration"), [-p["factor"] for p in points], rtol=1e-12)


@pytest.mark.slow
def test_what_was_changed_before_a_sweep_is_not_lost_in_its_workers() -> None:
    """Worker processes read the file of the law again: the scene that was changed here is swept as it is, or refused by name."""
    for name in EVERY_TENTH:
        s = changing.scene(name, 6.0)
        found = mb.sweep(s, {"b.mass": [1.0, 2.0]}, t_end=0.5, workers=2)
        if found.failures:
            assert all("states something else" in text for text in found.failures.values()), (name, found.failures)
        else:
            np.testing.assert_allclose(found.array("b.y")[:, -1], np.cos(0.5 * np.sqrt([6.0, 3.0])), atol=1e-5)
