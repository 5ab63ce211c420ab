"""Tangent and pullback of lists of operations, against the complex step through the very operations, and against each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mbdae as mb
from mbdae.derivatives.chart import Equations
from mbdae.derivatives.lists import Lists, written_out
from mbdae.native.program import ADD, CALL, LOAD, MULTIPLY, SET


def arm() -> mb.Scene:
    """A tree with a massless turn, a force on two of its bodies, and friction."""
    s = mb.Scene("arm", gravity=(0, -9.81, 0))
    a = s.rigid_body("a", 1.0, (0.1, 0.2, 0.3), at=(0.5, 0, 0))
    b = s.rigid_body("b", 0.7, (0.2, 0.1, 0.1), at=(1.0, 0.3, 0.1))
    s.revolute("A", s.ground, a, at=(0, 0, 0), axis=(0, 1, 1), spring=2.0, damper=0.05)
    s.universal("B", a, b, at=(1, 0, 0), axis=(0, 1, 0), axis_l=(0, 0, 1))
    s.spring("S", a, b, at_k=(0, 0.1, 0), at_l=(1, 0.4, 0), stiffness=30.0, length=0.7, damping=0.1)
    return s


def loop() -> mb.Scene:
    s = mb.Scene("loop", gravity=(0, -9.81, 0))
    crank, rod = s.link("crank", (0, 0), (0, 0.3), mass=0.3), s.link("rod", (0, 0.3), (1, 0), mass=1.0)
    slide = s.rigid_body("slide", 2.0, 0.1, at=(1, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), rate0=2.0)
    s.revolute("B", crank, rod, at=(0, 0.3), friction=mb.Coulomb(mu=0.1, v_c=0.01), radius=0.02)
    s.revolute("C", rod, slide, at=(1, 0))
    s.prismatic("D", s.ground, slide, at=(1, 0), axis=(1, 0, 0), damper=3.0)
    return s


def beam() -> mb.Scene:
    s = mb.Scene("beam", gravity=(0, 0, -9.81))
    rod = s.beam("rod", (0, 0, 0), (1, 0.2, 0), elements=2, section=mb.Section.circular(radius=0.02, E=1e7, nu=0.3, rho=1000.0))
    s.weld("W", s.ground, rod, at=(0, 0, 0))
    tip = s.point_mass("tip", 0.05, at=(1, 0.2, 0))
    s.spherical("T", rod, tip, at=(1, 0.2, 0))
    return s


def lists_of(scene: mb.Scene, form: mb.GGL | mb.ODE | mb.Index1 | mb.Index3) -> Lists:
    system = scene.system(form)
    prepared = system._prepared
    return Lists(Equations(prepared, system.stated, tuple(prepared.mechanics.rows)).assembly)


def by_complex_step(lists: Lists, t: float, y: np.ndarray, yp: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The change of F along `change` of all inputs: the operations one by one in complex numbers, kernels by NumPy."""
    lists.residual(t, y, yp)
    step = 1e-30
    W = lists.ev.W[: lists.width].astype(complex)
    W[: lists.width] += 1j * step * change[: lists.width]
    data = {i: (first, size) for i, (first, size) in lists._data.items()}
    at = lists.width
    for i, one in enumerate(lists._of.steps):
        f, tables, extra = one.fields, one.tables, 0.0
        if i in data:
            extra, at = 1j * step * change[at : at + data[i][1]], at + data[i][1]
        if f["kind"] == CALL:
            W[f["first"] : f["first"] + f["times"] * f["outputs"]] = f["kernel"].oracle(W[tables["from_"]]).ravel()
        elif f["kind"] == LOAD:
            W[f["first"] : f["first"] + f["count"]] = tables["weight"] + extra
        else:
            w = written_out(one)
            weight = w.weight + (extra[w.place] if i in data and f["kind"] == ADD else 0.0)
            for k, to in enumerate(w.to):
                value = W[w.from_[k]] * (1.0 if f["kind"] == SET else weight[k])
                value = value * W[w.by[k]] if f["kind"] == MULTIPLY else value
                W[to] = value if f["kind"] == SET else W[to] + value
    return np.asarray(W[lists._first : lists._first + lists.n].imag / step)


@pytest.mark.parametrize(("scene", "form"), [
    (lambda: arm().recursive(), mb.ODE()), (arm, mb.GGL()), (loop, mb.GGL()), (loop, mb.Index3()), (loop, mb.Index1()),
    (beam, mb.GGL())], ids=["tree", "arm", "loop", "index3", "index1", "beam"])
def test_pullback_tangent_and_complex_step_agree(scene: object, form: mb.GGL) -> None:
    lists = lists_of(scene(), form)  # type: ignore[operator]
    rng = np.random.default_rng(3)
    y, yp = 0.3 + 0.4 * rng.random((2, lists.n))
    lists.residual(0.2, y, yp)
    change, weights = rng.standard_normal(lists.inputs), rng.standard_normal(lists.n)
    along, back = lists.along(change)[0], lists.back(weights)[0]
    size = np.abs(along).max()
    assert np.abs(along - by_complex_step(lists, 0.2, y, yp, change)).max() < 1e-11 * size  # round-off of sums
    assert abs(weights @ along - back @ change) < 1e-11 * np.abs(weights * along).sum()
    fy, fyp = lists.jacobian(0.2, y, yp)
    lists.residual(0.2, y, yp)
    state = np.where(np.arange(lists.inputs) < 2 * lists.n, change, 0.0)
    found = lists.along(state)[0]
    assert np.abs(found - fy @ state[: lists.n] - fyp @ state[lists.n : 2 * lists.n]).max() < 1e-11 * np.abs(found).max()


def test_structure_of_equal_lists_differs_in_numbers_alone() -> None:
    def of(mass: float, damper: float | None) -> Equations:
        s = mb.Scene("p")
        s.revolute("A", s.ground, s.link("a", (0, 0), (1, 0), mass=mass), at=(0, 0), damper=damper)
        system = s.recursive().system(mb.ODE())
        return Equations(system._prepared, system.stated, tuple(system._prepared.mechanics.rows))

    one = of(1.0, 0.5)
    assert one.same_as(of(1.7, 0.2))
    assert not one.same_as(of(1.0, None))
    assert replace(one) is not one
