"""Laws of one's own on disk: found among `laws`, wherever they are defined, the same afterwards; every statement comes back."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import symengine as se
import sympy as sp

import mbdae as mb
from mbdae.results import archive, storage
from mbdae.scene.record import STATEMENTS, without_module
from mbdae.scene.replay import Known, replay
from mbdae.scene.scene import SceneData


def rod() -> mb.ReducedBody:
    """A rod of three nodes, three freedoms each, held in shape by springs to a fourth and a fifth beside it."""
    nodes = np.array([[0, 0, 0], [1 / 3, 0, 0], [1, 0, 0], [0.5, 0.3, 0], [0.5, 0, 0.3]], dtype=float)
    K = np.zeros((15, 15))
    for i, j in zip(*np.tril_indices(5, -1), strict=True):
        n = (nodes[i] - nodes[j]) / np.linalg.norm(nodes[i] - nodes[j])
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * 1e6 * np.outer(n, n)
    return mb.ReducedBody.craig_bampton(np.eye(15), K, nodes, {"left": [0, 3, 4]}, 2)


class Cubic(mb.Force):
    """At the top of a module."""

    params = mb.params(stiffness="N/m^3")

    def energy(self, k: Any, l: Any) -> Any:
        d = l.r - k.r
        return self.stiffness * (d @ d) ** 2 / 4


def local_classes() -> dict[str, Any]:
    """Classes defined inside a function, with constructors of their own."""

    class Gear(mb.Joint):
        params = mb.params(ratio="1")

        def __init__(self, name: str, k: Any, l: Any, at: Any, teeth: tuple[int, int]) -> None:
            super().__init__(name, k, l, at, ratio=teeth[0] / teeth[1])

        def constraints(self, k: Any, l: Any) -> Any:
            return {"z": k.z @ (l.r - k.r) * self.ratio}

    class Shaped(mb.Force):
        params = mb.params(c="N/m")
        options = ("mode", "shape")

        def energy(self, k: Any, l: Any) -> Any:
            d = l.r - k.r
            return self.c * (d @ d) * (self.shape[0] if self.mode == "a" else self.shape[1])

    class Smooth(mb.Friction):
        params = mb.params(mu="1")

        def __init__(self, percent: float) -> None:
            super().__init__(mu=percent / 100)

        def coefficient(self, v: Any) -> Any:
            return self.mu * se.tanh(v / 0.01)

    class Cubic(mb.Force):
        params = mb.params(stiffness="N/m^3")

        def energy(self, k: Any, l: Any) -> Any:
            return self.stiffness * (l.r - k.r) @ (l.r - k.r)

    return {"Gear": Gear, "Shaped": Shaped, "Smooth": Smooth, "Cubic": Cubic}


OWN = local_classes()


def swing() -> tuple[mb.Scene, Any]:
    s = mb.Scene("swing", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0))
    return s, rod


def stored(s: mb.Scene, path: Path) -> Any:
    r = s.simulate(0.05, accuracy=1e-3, outputs=3)
    r.save(path)
    return r


SAID = {
    "a law with options": lambda s, rod: s.add(OWN["Shaped"]("X", s.ground, rod, at=(1, 0), c=2 * sp.sin(mb.t), mode="a",
    shape=(1.0, 2))),
    "a joint with a constructor": lambda s, rod: s.add(OWN["Gear"]("X", s.ground, rod, (0, 0), (3, 2))),
    "friction with a constructor": lambda s, rod: s.revolute("X", rod, s.link("more", (1, 0), (2, 0), mass=1.0), at=(1, 0),
                                                              friction=OWN["Smooth"](10), radius=0.1),
    "a law of a module": lambda s, rod: s.add(Cubic("X", s.ground, rod.at(0.5), at=(1, 0), stiffness=0.1)),
}


@pytest.mark.parametrize("name", SAID)
def test_own_laws_come_back(name: str, tmp_path: Path) -> None:
    s, rod = swing()
    SAID[name](s, rod)
    r = stored(s, tmp_path / "r.npz")
    again = mb.load(tmp_path / "r.npz", laws=[*OWN.values(), Cubic])
    assert again.prepared.model.scene.statements == r.prepared.model.scene.statements
    for old, new in zip(s["X"].laws, again.prepared.model.scene["X"].laws, strict=True):
        assert type(old) is type(new)
        assert vars(old).keys() == vars(new).keys()
        assert all(getattr(old, p) == getattr(new, p) for p in (*old.params, *old.options))
    for values in ("q", "u", "acceleration", "multipliers"):
        np.testing.assert_array_equal(getattr(again, values), getattr(r, values))
    np.testing.assert_array_equal(again.energy.balance, r.energy.balance)
    assert repr(again) == repr(r)
    assert s.replace("hinge", model=mb.Classical())["X"].name == "X"  # other models need no laws=


def test_a_class_is_found_by_its_name_alone_where_only_one_has_it(tmp_path: Path) -> None:
    s, rod = swing()
    s.add(OWN["Shaped"]("X", s.ground, rod, at=(1, 0), c=2.0, mode="b", shape=(1.0, 2)))
    stored(s, tmp_path / "r.npz")
    shaped = local_classes()["Shaped"]
    shaped.__module__ = "__main__"
    assert type(mb.load(tmp_path / "r.npz", laws=[shaped]).prepared.model.scene["X"].laws[0]) is shaped
    another = local_classes()["Shaped"]
    another.__module__ = "elsewhere"
    with pytest.raises(mb.OptionError,
        match=r"several of `laws` are called 'Shaped': pass laws=\[...\] with the right one alone"):
        mb.load(tmp_path / "r.npz", laws=[shaped, another])
    assert type(mb.load(tmp_path / "r.npz", laws=[shaped, OWN["Shaped"]]).prepared.model.scene["X"].laws[0]) is OWN["Shaped"]


def test_a_class_that_is_missing_is_named(tmp_path: Path) -> None:
    s, rod = swing()
    s.add(Cubic("X", s.ground, rod, at=(1, 0), stiffness=0.1))
    stored(s, tmp_path / "r.npz")
    for laws in ([], [OWN["Gear"]], [np.sin.__class__]):
        with pytest.raises(mb.OptionError,
            match=r"r\.npz .*Cubic' is neither mbdae's nor in `laws`: pass laws=\[...\] with Cubic in it$"):
            mb.load(tmp_path / "r.npz", laws=laws)
    for wrong in ("Cubic", Cubic, 1, None, {"Cubic": Cubic}, ["Cubic"], [Cubic("X", None, None)]):
        with pytest.raises(mb.OptionError, match="laws"):
            mb.load(tmp_path / "r.npz", laws=wrong)


def test_a_class_of_another_kind_is_refused(tmp_path: Path) -> None:
    s, rod = swing()
    s.add(Cubic("X", s.ground, rod, at=(1, 0), stiffness=0.1))
    stored(s, tmp_path / "r.npz")
    wrong = type("Cubic", (), {"__module__": Cubic.__module__})
    with pytest.raises(mb.OptionError, match="stands where a joint or a force is expected"):
        mb.load(tmp_path / "r.npz", laws=[wrong])


def test_what_cannot_be_stored_is_refused_with_its_item(tmp_path: Path) -> None:
    s, rod = swing()
    s.add(Cubic("X", s.ground, rod, at=(1, 0), stiffness=0.1))
    s.add(local_classes()["Cubic"]("Y", s.ground, rod, at=(1, 0), stiffness=0.1))
    s.add(local_classes()["Cubic"]("Z", s.ground, rod, at=(1, 0), stiffness=0.1))
    with pytest.raises(mb.OptionError, match=r"add 'Z': two classes or functions are called .*Cubic, which"):
        stored(s, tmp_path / "r.npz")
    s, rod = swing()
    law = Cubic("X", s.ground, rod, at=(1, 0), stiffness=0.1)
    law.remark = [1]
    s.add(law)
    with pytest.raises(mb.OptionError, match=r"'X': the attribute remark of Cubic would be lost in a copy of the scene: declare"):
        stored(s, tmp_path / "r.npz")
    assert not os.listdir(tmp_path)


def test_saving_that_fails_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    s, _ = swing()
    path = tmp_path / "r.npz"
    r = stored(s, path)
    before = path.read_bytes()

    def stop(file: Any, **_: Any) -> None:
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(archive.np, "savez_compressed", stop)
    with pytest.raises(KeyboardInterrupt):
        r.save(path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["r.npz"]


def held(t: float, angle: float, memory: list[float]) -> tuple[float, list[float]]:
    """A sampled controller."""
    return memory[0] - angle, memory


def everything() -> mb.Scene:
    """All statements, joint models and laws of the package."""
    s = mb.Scene("all", gravity=(0, -9.81, 0), space="spatial")
    a = s.rigid_body("a", 1.0, np.diag([0.1, 0.2, 0.25]), at=(0.1, 0.2, 1 / 3), rotation=np.eye(3), velocity=(0.1, 0, 2e-7),
                     angular_velocity=(0, 0, 1e-3))
    b = s.link("b", (0, 0), (1, 0.1), (2, 0), mass_per_length=np.float64(0.7))
    p = s.point_mass("p", 2, (3, 0, 0), velocity=(0, 1))
    pulse = sp.Piecewise((0, mb.t < 0.1), (sp.Piecewise((sp.sin(mb.t), sp.And(mb.t < 2, sp.Not(mb.t > 1))), (1, True)), True))
    s.revolute("r1", s.ground, a, at=a.at((0, 0, 0)), axis=(1, 1, 0), model=mb.Classical(2.0, 0.5), angle0=0.1, rate0=1,
        spring=0.3, damper=1)
    s.revolute("r2", "a", b, at=(0, 0), torque=sp.Max(mb.t, sp.Mod(mb.t, sp.Rational(1, 3))) + sp.floor(7.1 * mb.t),
               friction=mb.LuGre(0.2, 0.3, 0.01, 1e3, 10.0, 0.1, 1.5, False), radius=0.1)
    s.revolute("r3", s.ground, b, at=(2, 0), model=mb.Clearance(0.0101, 0.01, mb.Hertz(1e8, 0.1), friction=mb.Coulomb(0.1,
        0.01), length=0.1))
    s.prismatic("p1", s.ground, "a", (0, 0), (0, 0, 1), position=pulse, model=mb.Recursive())
    s.prismatic("p2", s.ground, b, at=(0, 0), axis=(1, 0, 0), force=mb.t**2, friction=mb.Coulomb(0.1, 1e-3), normal_force=3)
    s.spherical("s", a, b, at=(1, 0, 0))
    s.contact("b1", "a", b.at(0.5), mb.Cylinder(at=(0, 0, 3), axis=(1, 1, 0), radius=0.2, length=0.4), mb.Sphere(radius=1 / 3),
              normal=mb.Hertz(1e8, 0.1), friction=mb.Coulomb(0.1, 0.01))
    s.weld("w", s.ground, a)
    s.distance("d", a, b, at_k=(0, 0), at_l=(1, 2))
    s.fixed_orientation("f", a, b)
    s.spring("k", a, p, at_k=(0, 0, 0), at_l=(3, 0, 0), stiffness=10**12, damping=1e-12, length=0.25)
    s.bushing("u", a, b, at=(0, 0), stiffness=(1, 2, 3, 4, 5, 6), damping=[0.1] * 6)
    s.rope("rope", a, p, at_k=(0, 0, 0), at_l=(3, 0, 0), stiffness=1e3, over=[("b", 0.1, (1, 5, 0))], radius_l=0.01)
    s.force("F", b.at(0.3), (1, pulse, 0.1), frame="body")
    s.torque("T", a, (0, 0, sp.Heaviside(mb.t - 0.3) * 1e300 * 1e-300))
    s.add(mb.Revolute("own", s.ground, b, at=(1, 0), axis=(0, 1, 0), drive=sp.tanh(mb.t)))
    s.cylindrical("c1", "a", b, at=(0, 0, 1), axis=(1, 0, 0), start={"angle": 0.3}, spring={"displacement": 2.0, "angle": 1e-3},
                  load={"angle": mb.t}, friction={"angle": mb.Coulomb(0.1, 1e-3)}, radius=0.01,
                  normal_force={"angle": 3})
    s.screw("c2", "a", b, (0, 0, 1), axis=(0, 1, 0), lead=-0.004, model=mb.Recursive(), start_rate=2)
    s.universal("c3", "a", b, at=(0, 0, 1), axis=(0, 1, 0), axis_l=(1, 1, 0), pin=(0, 0, 2), prescribed={"angle_k": pulse})
    s.generic("c41", "a", b, (0, 0, 1), (0, 1, 0), free=["x", "angle_z"], damper={"x": 0.1})
    s.rolling("c42", s.ground, "a", (0, 0, 1), axis=(0, 1, 0.1), radius=0.1, normal=(0, 0, 2))
    s.knife_edge("c43", s.ground, "a", (0, 0, 1), along=(1, 1, 0))
    s.frame("tool", "a", (0, 0, 1))
    s.planar("c4", "a", b, (0, 0, 1), (0, 1, 0), axis_x=(1, 0, 0), damper={"x": 0.1}, model=mb.Classical())
    s.point_on_line("c5", "a", b, (0, 0, 1), axis=(0, 1, 0))
    s.point_on_plane("c6", "a", b, (0, 0, 1), axis=(0, 1, 0), axis_x=(0, 0, 1))
    s.joint(mb.Prismatic, "c7", "a", b, (1, 0, 0), axis=(0, 0, 1), start=0.1)
    s.joint(mb.Revolute, "c8", "a", b, (1, 0, 0), axis=(0, 0, 1), axis_l=(0, 0.1, 1), at_l=(1, 0, 0.1), axis_x_l=(1, 0, 0))
    s.revolute("c9", "a", b, (1, 0, 0), axis=(0, 0, 1), axis_l=(0, 0.1, 1))
    s.couple("g1", {"r1": 2, "c1.angle": -1 / 3}, value=mb.t)
    s.gear("g2", "r1", s["r2"], ratio=-0.5)
    s.rack("g3", "r1", "c1.displacement", radius=0.1)
    s.differential("g4", "r1", "r2", carrier="c4")
    beam = s.beam("beam", (0, 5), (1, 6), (2, 5), section=mb.Section.tube(0.1, 0.05, 2e9, 0.3, 1000), curve="arc", elements=3,
        order=3,
                  axis2=(0, 0, 1), velocity=(0, 0, 0.1))
    beam.load((0, mb.t, 1), frame="section", name="load")
    s.reduced_body("flexible", rod(), at=(0, 1 / 3, 0), damping=0.01)
    s.state("e1", rate=1 / 3 - s.sensor("r1.angle") * s.sensor("e2"), start=0.1, size=2)
    s.signal("e2", sp.Max(s.sensor("a.position[1]"), mb.t / 7))
    s.contact("touch", "a", "p", mb.Plane(at=(0, 0, -1 / 3)), mb.Sphere(radius=1 / 7), mb.Hertz(1e8, 0.1))
    s.force("F2", b.at(0.6), (s.sensor("r1.angle") + mb.table([0, 1 / 3, 1], [0, 1 / 7, 0], "step", "periodic"), 0, mb.t))
    s.controller("pid", held, every=1 / 3, reads=["r1.angle"], sets="held", memory=[1 / 3])
    return s


def test_every_statement_comes_back_to_the_last_bit() -> None:
    s = everything()
    assert {said[0] for said in s.statements} == set(STATEMENTS)
    data = {"name": s.name, "gravity": s.gravity.tolist(), "space": s.space, "statements": json.loads(json.dumps(s.statements))}
    again = replay(data, SceneData, Known.among([held]))
    assert again.statements == s.statements
    assert again.problems == s.problems
    for old, new in zip(s.bodies, again.bodies, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(vars(old.drawn).values(), vars(new.drawn).values(), strict=True))
        assert (old.mass, getattr(old, "section", None)) == (new.mass, getattr(new, "section", None))
    for old, new in zip(s.connections, again.connections, strict=True):
        assert (old.name, old.kind, old.model, old.hold, old.hold_rate) == (new.name, new.kind, new.model, new.hold,
            new.hold_rate)
        for law, copy in zip(old.laws, new.laws, strict=True):
            assert type(law) is type(copy)
            for value in (*law.params, *law.options):
                assert repr(getattr(law, value)) == repr(getattr(copy, value))
                assert getattr(law, value) == getattr(copy, value)


@pytest.mark.parametrize("solver", [
    mb.IDA(1e-5, max_order=4), mb.IDA(atol=1e-4), mb.CVODE(method="BDF", max_order=3), mb.RadauIIA(2, 1e-4, [1e-5] * 2),
    mb.RadauIIA(3, step=0.01, newton=1e-9), mb.HHT(0.1, step=0.01), mb.GeneralizedAlpha(0.5, accuracy=1e-4),
], ids=repr)
def test_solvers_come_back(solver: Any) -> None:
    stored = storage._info_of(solver)
    options = stored["options"]
    again = storage._solver({"class": stored["class"], "options": json.loads(json.dumps(options))}, Known.among([]))
    assert repr(again) == repr(solver).replace("[1e-05, 1e-05]", repr(np.array([1e-5] * 2)))



@pytest.mark.parametrize(("old", "new"), [
    ("mbdae.joints.revolute:Revolute", "mbdae:Revolute"), ("mbdae.scene.components:Kinematic", "mbdae:Kinematic"),
    ("own.laws:Revolute", "own.laws:Revolute"), ("mbdaextra:Revolute", "mbdaextra:Revolute"),
])
def test_files_that_name_the_module_of_a_law_are_read(old: str, new: str) -> None:
    assert without_module(old) == new
    if new.startswith("mbdae:"):
        assert Known().find(old, object) is getattr(mb, new[6:])
    else:
        with pytest.raises(mb.SceneError, match="neither mbdae's nor"):
            Known().find(old, object)


def test_a_law_of_the_same_name_with_other_equations_is_refused(tmp_path):
    """What is loaded would show forces of another law beside the motion of the one that was integrated."""

    def spring(factor):
        class Spring(mb.Force):
            params = mb.params(stiffness="N/m")

            def energy(self, k, l):
                return factor * self.stiffness * ((l.r - k.r) @ (l.r - k.r)) / 2

        return Spring

    as_it_was, edited = spring(1), spring(5)
    s = mb.Scene("spring")
    body = s.point_mass("body", 1.0, at=(1, 0, 0), velocity=(0, 1, 0))
    s.add(as_it_was("spring", s.ground, body, at=(0, 0, 0), at_l=(1, 0, 0), stiffness=3.0))
    r = s.simulate(0.2)
    r.save(tmp_path / "r.npz")
    assert mb.load(tmp_path / "r.npz", laws=[as_it_was])["spring"].force[-1] == pytest.approx(r["spring"].force[-1])
    with pytest.raises(mb.OptionError, match=r"the law .*Spring states other equations than when the file was written"):
        mb.load(tmp_path / "r.npz", laws=[edited])


class Choosing(mb.Joint):
    """Holds one component of the distance of two points, chosen by a word."""

    params = mb.params(length=("m", "length"))
    options = ("direction",)

    def constraints(self, k, l):
        return {"row": (l.r - k.r)["xyz".index(self.direction)] - self.length}


def test_an_option_that_is_a_word_is_stored(tmp_path):
    s = mb.Scene("words", gravity=(0, -9.81, 0))
    s.joint(Choosing, "j", s.ground, s.link("b", (1, 0), (2, 0), mass=1.0), at=(1, 0), length=0.0, direction="y")
    r = s.simulate(0.1)
    r.save(tmp_path / "words.mbd")
    found = mb.load(tmp_path / "words.mbd", laws=[Choosing])
    np.testing.assert_array_equal(found["b"].position, r["b"].position)
