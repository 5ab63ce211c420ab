"""A scene in which a number was changed is made again by what the number touches: equal to the same scene made from nothing."""

import copy
import runpy
from pathlib import Path

import numpy as np
import pytest
import symengine as se

import mbdae as mb
from mbdae.formulations import system_for
from mbdae.run.choice import choose, prepared_from
from mbdae.scene import replay
from mbdae.study.statements import changed
from mbdae.system import prepare
from mbdae.system.model import nodes

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SAME = 1e-12  #: difference of two starts, over the largest unknown: velocities are projected with other round-off


def loop() -> mb.Scene:
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    crank = s.link("crank", (0, 0), (0.1, 0.2), mass=1.0)
    coupler = s.link("coupler", (0.1, 0.2), (0.6, 0.4), mass=2.0)
    rocker = s.link("rocker", (0.6, 0.4), (0.5, 0), mass=1.5)
    s.revolute("A", s.ground, crank, at=(0, 0), damper=0.3, rate0=2.0)
    s.revolute("B", crank, coupler, at=(0.1, 0.2), spring=4.0)
    s.revolute("C", coupler, rocker, at=(0.6, 0.4))
    s.revolute("D", s.ground, rocker, at=(0.5, 0), torque=0.2 * mb.t**2 - 0.1 * s.sensor("A.rate"))
    s.spring("S", s.ground, coupler, (0.2, 0.8), (0.3, 0.28), stiffness=50.0, damping=1.0)
    return s


def body() -> mb.Scene:
    s = mb.Scene("thrown", gravity=(0, 0, -9.81))
    b = s.rigid_body("b", 2.0, (0.1, 0.2, 0.25), at=(0, 0, 1), velocity=(1, 0, 2), angular_velocity=(1, 2, 3))
    s.spring("S", s.ground, b, (0, 0, 0), (0.1, 0, 1.1), stiffness=20.0, length=1.0)
    return s


def chain() -> mb.Scene:
    """Two links on hinges whose model is left open, so that a run takes them as recursive; a frame, shapes, friction."""
    s = mb.Scene("chain", gravity=(0, 0, -9.81))
    one = s.rigid_body("one", 1.2, (0.1, 0.2, 0.15), at=(0.3, 0, 0), shape=mb.Box((0.6, 0.1, 0.1)))
    two = s.rigid_body("two", 0.7, (0.05, 0.04, 0.06), at=(0.8, 0.1, 0), velocity=(0, 0.2, 0))
    s.revolute("A", s.ground, one, at=(0, 0, 0), axis=(0, 1, 0), damper=0.3, rate0=2.0)
    s.revolute("B", one, two, at=(0.6, 0, 0), axis=(0, 0.6, 0.8), spring=4.0)
    s.frame("tip", two, at=(1.1, 0.1, 0))
    s.spring("S", s.ground, two, (0.2, 0.8, 0), (1.1, 0.1, 0), stiffness=50.0, damping=1.5)
    return s


def rubbing() -> mb.Scene:
    s = mb.Scene("rubbing", gravity=(0, -9.81, 0))
    door = s.rigid_body("door", 3.0, 0.4, at=(0.5, 0), shape=mb.Box((1, 0.1, 0.1)))
    s.revolute("hinge", s.ground, door, at=(0, 0), friction=mb.Coulomb(mu=0.2, v_c=0.05), radius=0.02, damper=0.3)
    return s


CHAIN = ("one.mass", "one.inertia.1", "two.velocity.1", "A.damper", "A.rate0", "B.spring", "B.at.0", "B.axis.2", "tip.at.0",
         "S.damping")
RUBBING = ("door.mass", "hinge.damper", "hinge.friction.mu")
LOOP = ("crank.mass", "C.at.1", "A.at.0", "A.damper", "A.rate0", "B.spring", "B.at.1", "S.stiffness", "S.at_l.0",
        "rocker.mass", "D.at.0")
BODY = ("b.mass", "b.inertia.1", "b.at.2", "b.velocity.0", "b.angular_velocity.2", "S.length", "S.at_k.1")


def made(scene: mb.Scene, choice: object) -> list[np.ndarray]:
    """Unknowns, rates, scales, what the tables give at the start, F and its Jacobian, and the motion of all bodies beside it, as
    a run makes them; unknowns, rates and scales where multipliers are unknowns too."""
    prepared = prepared_from(scene, None, 1.0, True)
    system = system_for(prepared, choice.form, choice.solver.highest_index)  # type: ignore[attr-defined]
    F = np.empty(system.n)
    system.residual(system.t0, system.y0, system.yp0, F)
    moved = prepared.states(np.array([system.t0]), system.y0[None] + 0.1)[:2]
    parts = map(np.asarray, system.jacobian_parts(system.t0, system.y0, system.yp0))
    whole = system_for(prepared)
    return [system.y0, system.yp0, system.scale, F, *moved, *parts, whole.y0, whole.yp0, whole.scale]


def from_nothing(monkeypatch: pytest.MonkeyPatch, scene: mb.Scene, choice: object) -> list[np.ndarray]:
    """The same of a copy, of which nothing is known from before."""
    from mbdae.system.model import model

    with monkeypatch.context() as patch:
        patch.setattr(model, "shape_of", lambda key: nodes.Shape())
        return made(scene._copied(), choice)


def compared(monkeypatch: pytest.MonkeyPatch, base: mb.Scene, names: tuple[str, ...]) -> None:
    choice, again, whole = choose(prepared_from(base, None, 1.0, True), base, 1e-6), [], prepare._renewed
    made(base, choice)
    monkeypatch.setattr(prepare, "_renewed", lambda *stated: again.append(whole(*stated)) or again[-1])
    for name in names:
        one = changed(base, name, lambda x: x * 1.01 + 1e-3)[0]
        for a, b in zip(made(one, choice), from_nothing(monkeypatch, one, choice), strict=True):
            assert a.shape == b.shape, name
            assert np.max(np.abs(a - b), initial=0.0) <= SAME * max(1.0, np.max(np.abs(b), initial=0.0)), name
    assert sum(one is not None for one in again) == len(names)


@pytest.mark.parametrize(("scene", "names"), [(loop, LOOP), (body, BODY), (chain, CHAIN), (rubbing, RUBBING)])
def test_a_changed_number_changes_what_it_touches(monkeypatch, scene, names):
    compared(monkeypatch, scene(), names)


def test_numbers_change_back_and_forth(monkeypatch):
    """Each time from the scene that was made last, and from one that others were made of."""
    s = loop()
    choice = choose(prepared_from(s, None, 1.0, True), s, 1e-6)
    first = made(s, choice)
    there = changed(s, "crank.mass", 1.7)[0]
    made(changed(there, "A.at.0", 0.01)[0], choice)
    back = changed(there, "crank.mass", 1.0)[0]
    for a, b in zip(made(back, choice), first, strict=True):
        assert np.max(np.abs(a - b), initial=0.0) <= SAME * max(1.0, np.max(np.abs(b), initial=0.0))


def test_a_statement_that_makes_several_items_is_repeated_with_all_others():
    """A reduced body has one body at every interface."""
    s = runpy.run_path(str(EXAMPLES / "turbine_blade.py"))["scene"]()
    for name in ("hub.mass", "blade.body.mass"):
        other = changed(s, name, lambda x: 1.01 * x)[0]
        assert not other.problems
        assert [b.name for b in other.bodies] == [b.name for b in s.bodies]


def test_further_statements_of_either_scene_are_its_own():
    s = loop()
    other = changed(s, "B.spring", 5.0)[0]
    other.force("push", "coupler", (1, 0, 0))
    s.torque("turn", "crank", (0, 0, 1))
    assert "push" in [c.name for c in other.connections]
    assert "push" not in [c.name for c in s.connections]
    assert "turn" not in [c.name for c in other.connections]
    made(other, choose(prepared_from(other, None, 1.0), other, 1e-6))


def test_another_mass_of_a_body_with_a_shape_keeps_the_start(monkeypatch):
    base = rubbing()
    prepared_from(base, None, 1.0, True)
    monkeypatch.setattr(prepare.Starter, "placed", lambda self: pytest.fail("the start was sought again"))
    heavier = prepared_from(changed(base, "door.mass", lambda x: 2 * x)[0], None, 1.0, True)
    assert heavier.mechanics.mass.diagonal()[0] == 6.0


def driven() -> mb.Scene:
    """Numbers inside of objects, lists, values by coordinate and pulses."""
    s = mb.Scene("driven", gravity=(0, -9.81, 0))
    a = s.rigid_body("a", 3.0, (0.1, 0.2, 0.3), at=(0.5, 0, 0), shape=[mb.Box(size=(1, 0.1, 0.1)), mb.Sphere(radius=0.1)])
    b = s.rigid_body("b", 1.0, (0.1, 0.1, 0.1), at=(1.5, 0, 0))
    s.cylindrical("J", s.ground, a, at=(0, 0, 0), axis=(0, 0, 1), spring={"angle": 3.0})
    s.revolute("K", a, b, at=(1, 0, 0), friction=mb.Coulomb(mu=0.2, v_c=0.05), radius=0.02)
    s.torque("push", b, (0, 0, se.Piecewise((2.0, (mb.t > 0.1) & (mb.t < 0.2)), (0.0, True))))
    return s


DRIVEN = ("a.mass", "a.inertia.1", "a.shape.0.size.1", "J.spring.angle", "J.stiffness", "J.axis.2", "K.friction.mu",
          "K.radius", "push.width", "push.strength")


@pytest.mark.parametrize(("scene", "names"), [(loop, LOOP), (chain, CHAIN), (rubbing, RUBBING), (driven, DRIVEN)])
def test_the_statements_of_the_scene_itself_stay(scene, names):
    s = scene()
    before = copy.deepcopy(s.statements)
    for name in names:
        assert changed(s, name, lambda x: 1.01 * x + 1e-3)[0].statements != before
        assert s.statements == before, name


def test_only_arguments_that_are_others_are_read_again(monkeypatch):
    s = driven()
    first = changed(s, "a.mass", 3.5)[0]
    monkeypatch.setitem(replay._READERS, frozenset({"object", "fields"}), lambda *_: pytest.fail("a shape was read again"))
    again = changed(s, "a.mass", 4.0)[0]
    assert (first["a"].mass, again["a"].mass, s["a"].mass) == (3.5, 4.0, 3.0)
    assert again["a"].shapes is s["a"].shapes
    monkeypatch.undo()
    other = changed(s, "a.shape.0.size.1", 0.2)[0]
    assert [one["a"].shapes[0].size[1] for one in (other, changed(other, "a.mass", 5.0)[0], s)] == [0.2, 0.2, 0.1]
