"""Tangent and pullback of lists of operations, against the complex step through the very operations, and against each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.derivatives.chart import Equations
from mbdae.derivatives.lists import Lists, entries, written_out
from mbdae.native.program import ADD, CALL, LOAD, MULTIPLY, POSITIVE, SET, SOLVE


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


def free() -> mb.Scene:
    """A free body with a spring, whose constant mass matrix is factorised once in a run."""
    s = mb.Scene("free", gravity=(0, 0, -9.81))
    body = s.rigid_body("body", 1.0, (0.1, 0.2, 0.3), at=(0, 0, 0))
    s.spring("S", s.ground, body, at_k=(0.3, 0.1, 1), at_l=(0.1, 0, 0.2), stiffness=30.0, length=0.7, damping=0.1)
    return s


def plain(mass: float = 1.0) -> mb.Scene:
    s = mb.Scene("plain", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (0, 0.3), mass=0.3), s.rigid_body("b", mass, 0.1 * mass, at=(0.4, 0.3))
    c = s.link("c", (0.8, 0.3), (0.8, 0), mass=0.4)
    s.revolute("A", s.ground, a, at=(0, 0), rate0=2.0, damper=0.1)
    s.revolute("B", a, b, at=(0, 0.3))
    s.revolute("C", b, c, at=(0.8, 0.3))
    s.revolute("D", s.ground, c, at=(0.8, 0))
    return s


def massless() -> mb.Scene:
    return plain(0.0)


def lists_of(scene: mb.Scene, form: Any, rates: bool = False) -> tuple[Equations, Lists]:
    system = scene.system(form)
    prepared = system._prepared
    base = Equations(prepared, system.stated, tuple(prepared.mechanics.rows), rates)
    return base, Lists(base.listed)


def by_complex_step(lists: Lists, t: float, y: np.ndarray, yp: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The change of the results along `change` of all inputs: the operations one by one in complex numbers, kernels by NumPy."""
    lists.value(t, y, yp)
    step = 1e-30
    W = lists.W[: lists.width].astype(complex)
    W[: lists.width] += 1j * step * change[: lists.width]
    at = lists.width
    for one in lists.listed.part.steps:
        f, tables, extra = one.fields, one.tables, np.zeros(0)
        if f["kind"] in (LOAD, ADD):
            extra, at = 1j * step * change[at : at + tables["weight"].size], at + tables["weight"].size
        if f["kind"] == CALL:
            W[f["first"] : f["first"] + f["times"] * f["outputs"]] = f["kernel"].oracle(W[tables["from_"]]).ravel()
        elif f["kind"] == LOAD:
            W[f["first"] : f["first"] + f["count"]] = tables["weight"] + extra
        elif f["kind"] in (SET, ADD, MULTIPLY):
            w = written_out(one)
            weight = w.weight + (extra[w.place] if f["kind"] == ADD else 0.0)
            for k, to in enumerate(w.to):
                value = W[w.from_[k]] * (1.0 if f["kind"] == SET else weight[k])
                value = value * W[w.by[k]] if f["kind"] == MULTIPLY else value
                W[to] = value if f["kind"] == SET else W[to] + value
        elif f["kind"] != POSITIVE:
            n, right = f["count"], f["outputs"]
            if f["kind"] != SOLVE:
                M = np.zeros((n, n), complex)
                cell, row, column = entries(one)
                M[row, column] = W[cell]
            W[right : right + n] = np.linalg.solve(M, W[right : right + n])
    return np.asarray(W[lists.listed.first : lists.listed.first + lists.listed.width].imag / step)


@pytest.mark.parametrize(("scene", "form", "rates"), [
    (lambda: arm().recursive(), mb.ODE(), False), (arm, mb.GGL(), False), (loop, mb.GGL(), False), (loop, mb.Index3(), False),
    (loop, mb.Index1(), False), (beam, mb.GGL(), False), (lambda: arm().recursive(), mb.ODE(), True), (free, mb.ODE(), True),
    (plain, mb.Index1(multipliers="eliminated"), True), (massless, mb.Index1(multipliers="eliminated"), True)],
    ids=["tree", "arm", "loop", "index3", "index1", "beam", "rates of a tree", "rates of a free body", "cholesky", "lu"])
def test_pullback_tangent_and_complex_step_agree(scene: Any, form: Any, rates: bool) -> None:
    base, lists = lists_of(scene(), form, rates)
    rng, n = np.random.default_rng(3), lists.n
    y, yp = 0.3 + 0.4 * rng.random((2, n))
    lists.value(0.2, y, yp)
    change, weights = rng.standard_normal(lists.inputs), rng.standard_normal(lists.listed.width)
    along, back = lists.along(change)[0], lists.back(weights)[0]
    size = np.abs(along).max()
    assert np.abs(along - by_complex_step(lists, 0.2, y, yp, change)).max() < 1e-11 * size  # round-off of sums
    assert abs(weights @ along - back @ change) < 1e-11 * np.abs(weights * along).sum()
    if not rates:
        fy, fyp = (x[0] for x in base.assembly.dense_stages(np.array([0.2]), y[None], yp[None]))
        lists.value(0.2, y, yp)
        state = np.where(np.arange(lists.inputs) < 2 * n, change, 0.0)
        found = lists.along(state)[0]
        assert np.abs(found - fy @ state[:n] - fyp @ state[n : 2 * n]).max() < 1e-11 * np.abs(found).max()


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
