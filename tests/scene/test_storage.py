"""A result on disk is the result: sensors, energy, dense output and plot agree to round-off, nothing is solved again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.scene.replay import Known, replay
from mbdae.scene.scene import SceneData

READ = ("C.angle", "C.rate", "D.force", "D.torque", "A.power", "crank.position", "coupler.velocity", "rocker.rotation")


class Rubber(mb.Force):
    """A law of the user's own."""

    params = mb.params(stiffness=("N/m^3", "cubic stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        d = l.r - k.r
        return self.stiffness * (d @ d) ** 2 / 4


def four_bar(space: str) -> mb.Scene:
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0), space=space)
    A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)
    a, b = s.link("crank", A, B, mass=0.3), s.link("coupler", B, C, mass=0.3123456789123456)
    c = s.rigid_body("rocker", 0.5, np.diag([0.01, 0.01, 0.01]), at=(0.55, 0.3))
    s.revolute("A", s.ground, a, at=A, angle=0.1 * sp.sin(12.561234567891234 * mb.t))
    s.revolute("B", "crank", b, at=B, model=mb.Kinematic())
    s.revolute("C", b, c, at=np.array(C), spring=2.0, damper=0.01)
    s.revolute("D", c, s.ground, at=D)
    s.spring("S", a.at(0.5), c, at_k=a.at(0.5), at_l=(0.6, 0), stiffness=np.float64(3.0))
    s.force("F", b.at(0.3), (1, sp.Piecewise((0, mb.t < 0.05), (sp.cos(mb.t), True)), 0))
    s.add(Rubber("R", s.ground, b, at=(0.5, 0.6), stiffness=4.0))
    return s


RUNS = {"IDA": ("auto", mb.IDA(rtol=1e-6)), "Radau": ("spatial", mb.RadauIIA(3, rtol=1e-5))}


@pytest.fixture(scope="module", params=RUNS.values(), ids=list(RUNS))
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any, Path]:
    """A result, the same loaded, and its file."""
    space, solver = request.param
    path = tmp_path_factory.mktemp("runs") / "run.npz"
    r = four_bar(space).simulate(0.2, solver=solver, outputs=11)
    r.save(path)
    return r, mb.load(path, laws=[Rubber]), path


def test_sensors_at_the_outputs_and_between(pair: Any) -> None:
    r, again, _ = pair
    between = np.linspace(0, 0.2, 37)
    for name in READ:
        assert again.read(name) == pytest.approx(r.read(name), rel=1e-14, abs=1e-14), name
        assert again(between).read(name) == pytest.approx(r(between).read(name), rel=1e-14, abs=1e-14), name


def test_energy_drift_and_report(pair: Any) -> None:
    r, again, _ = pair
    assert again.energy.balance == pytest.approx(r.energy.balance, abs=1e-14)
    assert again.drift.position == pytest.approx(r.drift.position, abs=1e-15)
    assert (again.stats, again.info, again.start.changes) == (r.stats, r.info, r.start.changes)
    assert repr(again) == repr(r)
    assert again.multiplier_names == r.multiplier_names


def test_plot_of_a_loaded_result(pair: Any, tmp_path: Path) -> None:
    _, again, _ = pair
    again.plot("C.angle", path=tmp_path / "angle.png")
    assert (tmp_path / "angle.png").stat().st_size > 1000


def test_file_needs_no_pickle(pair: Any) -> None:
    _, _, path = pair
    with np.load(path, allow_pickle=False) as file:
        assert json.loads(str(file["header"]))["format"] == "mbdae result"
        assert all(file[name].dtype.kind in "fU" for name in file.files)


def test_replay_makes_an_equal_scene() -> None:
    s = four_bar("auto")
    data = {"name": s.name, "gravity": list(s.gravity), "space": s.space, "statements": json.loads(json.dumps(s.statements))}
    again = replay(data, SceneData, Known(s.own))
    assert [b.name for b in again.bodies] == [b.name for b in s.bodies]
    assert [(c.name, c.kind, c.k.name, c.l.name, [type(w) for w in c.laws]) for c in again.connections] == [
        (c.name, c.kind, c.k.name, c.l.name, [type(w) for w in c.laws]) for c in s.connections
    ]
    for old, new in zip(s.bodies, again.bodies, strict=True):
        assert np.array_equal(old.drawn.position, new.drawn.position)
        assert old.mass == new.mass
    drive = [float(c.laws[0].drive.subs({"t": 0.7})) for c in (s["A"], again["A"])]
    assert drive[0] == pytest.approx(drive[1], rel=2e-15, abs=0)  # text of 15 digits would give 3e-14
    assert again.statements == s.statements


def test_continued_run_can_be_stored(pair: Any, tmp_path: Path) -> None:
    r, _, _ = pair
    more = four_bar(r.prepared.model.scene.space).simulate(0.25, solver=r.info.solver, start=r, outputs=3)
    more.save(tmp_path / "more.npz")
    assert mb.load(tmp_path / "more.npz", laws=[Rubber]).read("C.angle") == pytest.approx(more.read("C.angle"), abs=1e-14)


def changed(path: Path, target: Path, **header: Any) -> Path:
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    arrays["header"] = np.array(json.dumps(json.loads(str(arrays["header"])) | header))
    np.savez(target, **arrays)
    return target


def test_other_files_are_refused(pair: Any, tmp_path: Path) -> None:
    _, _, path = pair
    text, table, broken = tmp_path / "a.txt", tmp_path / "b.npz", tmp_path / "c.npz"
    text.write_text("hello")
    np.savez(table, x=np.zeros(3))
    broken.write_bytes(path.read_bytes()[:300])
    for file in (text, table, broken):
        with pytest.raises(mb.OptionError, match=r"is not a result of mbdae, or damaged .* give a file written by r\.save"):
            mb.load(file)
    with pytest.raises(FileNotFoundError):
        mb.load(tmp_path / "missing.npz")
    with pytest.raises(mb.OptionError, match="the file's format is 'photo', not 'mbdae result'"):
        mb.load(changed(path, tmp_path / "d.npz", format="photo"))
    with pytest.raises(mb.OptionError, match="has format version 99, this mbdae reads up to 1: update mbdae"):
        mb.load(changed(path, tmp_path / "e.npz", version=99))
