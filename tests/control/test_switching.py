"""Feedback that jumps: every jump is located, by every solver; motions that switch without end are named."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy as sp

import mbdae as mb
from mbdae.errors import ChatteringError

EVERY = [(None, None, mb.Recursive()), ("dop853", None, mb.Recursive()), ("cvode", None, mb.Recursive()),
         ("ida", "index1", mb.Kinematic()), ("radau3", "ggl", mb.Kinematic()), ("radau2", None, mb.Recursive())]


def slide(force, model=None, rate0=0.9, sampled=False):
    """A block of 1 kg with a force of time, displacement and rate."""
    s = mb.Scene("block")
    block = s.rigid_body("block", 1.0, 1.0, at=(0, 0))
    F = force(mb.t, s.sensor("P.displacement"), s.sensor("P.rate"))
    if sampled:
        s.controller("c", lambda t: 0.1 * t, every=0.01, sets=["u"])
        F = F + s.sensor("u")
    s.prismatic("P", s.ground, block, at=(0, 0), axis=(1, 0, 0), force=F, rate0=rate0, model=model)
    return s


@pytest.mark.parametrize(("solver", "form", "model"), EVERY)
def test_jumps_of_floors_of_the_motion_are_located(solver, form, model):
    """Force -floor(3 x): 0 until x = 1/3, then -1 until x = 2/3, then -2; Mod, frac and ceiling are made of it."""
    t1, v1 = (1 / 3) / 0.9, 0.9
    v2 = math.sqrt(v1**2 - 2 / 3)
    t2 = t1 + (v1 - v2)
    r = slide(lambda t, x, v: -sp.floor(3 * x), model).simulate(t2 + 0.1, solver=solver, form=form, accuracy=1e-8)
    assert r["P"].rate[-1] == pytest.approx(v2 - 0.2, abs=2e-8)
    ends = r.solution.t
    assert min(abs(ends - t1)) < 5e-8
    assert min(abs(ends - t2)) < 5e-8


@pytest.mark.parametrize("name", ["Mod", "frac", "ceiling"])
def test_what_is_made_of_floors_moves_alike(name):
    x_of = {"Mod": lambda x: sp.Mod(x, sp.Rational(1, 4)), "frac": lambda x: sp.frac(4 * x) / 4,
            "ceiling": lambda x: x - (sp.ceiling(4 * x) - 1) / 4}
    given = slide(lambda t, x, v: -20 * x_of[name](x)).simulate(2.0, accuracy=1e-8)
    floors = slide(lambda t, x, v: -20 * (x - sp.floor(4 * x) / 4)).simulate(2.0, accuracy=1e-8)
    assert given["P"].displacement[-1] == pytest.approx(floors["P"].displacement[-1], abs=2e-8)


FORCES = {
    "sign": lambda t, x, v: -2 * sp.sign(x + v), "piecewise": lambda t, x, v: sp.Piecewise((-2, x + v > 0), (2, True)),
    "floor": lambda t, x, v: -2 * sp.floor(x + v) - 1, "dry": lambda t, x, v: -2 * sp.sign(v) + sp.sin(t),
    "stopping": lambda t, x, v: -2 * sp.sign(v), "twisting": lambda t, x, v: -2 * sp.sign(x) - sp.sign(v),
}


@pytest.mark.parametrize(("force", "solver", "form", "model"), [
    (force, *how) for force in FORCES for how in (EVERY if force in ("sign", "dry") else EVERY[:1])])
def test_motions_that_switch_without_end_are_named(force, solver, form, model):
    # by the law that switches, or, where each switch is as small as round-off, by the steps that stay there
    named = r"'P' switches without end: \d+ times|steps took .* where the equations jump"
    with pytest.raises(ChatteringError, match=named) as stopped:
        slide(FORCES[force], model).simulate(5.0, solver=solver, form=form, max_wall=60)
    assert stopped.value.time < 2.0
    assert stopped.value.solution.solution.t[-1] == pytest.approx(stopped.value.time)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-9])
def test_they_are_named_at_every_accuracy_and_beside_controllers(accuracy):
    with pytest.raises(ChatteringError):
        slide(FORCES["sign"], sampled=True).simulate(5.0, accuracy=accuracy, max_wall=60)


@pytest.mark.parametrize(("solver", "form", "model"), [how for how in EVERY if how[0] != "cvode"])  # CVODE takes 13 s to be told
@pytest.mark.parametrize(("quantity", "rate0"), [("x", 0.0), ("v", 0.9)])
def test_runs_that_begin_exactly_where_a_law_jumps(quantity, rate0, solver, form, model):
    """At rest where x = 0, and with the very rate 0.9 m/s: the values there are round-off, on whose side the law need not be."""
    def force(t, x, v):
        return sp.Piecewise((-2, (x if quantity == "x" else v) >= rate0), (1, True))

    with pytest.raises(ChatteringError) as stopped:
        slide(force, model, rate0).simulate(1.0, solver=solver, form=form, max_wall=60)
    assert stopped.value.time < 0.05


@pytest.mark.parametrize("solver", ["ida", "radau3", "dop853", "cvode"])
def test_own_equations_that_jump_without_saying_where(solver):
    """u' = -2 where u >= 0.9, else 1, from u = 0.9: no solver is told of the jump; a force that jumps with time alone passes."""
    def dae(force):
        def residual(t, y, yp, out):
            out[:] = yp[0] - y[1], yp[1] - force(t, y[1])

        def rhs(t, y, out):
            out[:] = y[1], force(t, y[1])

        return mb.DAE(residual, [0, 0.9], [0.9, force(0.0, 0.9)], names=["x", "u"], rhs=rhs)

    with pytest.raises(ChatteringError, match="where the equations jump") as stopped:
        dae(lambda t, u: -2.0 if u >= 0.9 else 1.0).simulate(1.0, solver=solver, max_wall=60)
    assert stopped.value.time < 0.01
    assert dae(lambda t, u: math.copysign(1, math.sin(40 * t)) - u).simulate(1.0, 1e-3, solver=solver).complete


def test_a_run_ends_at_an_event_before():
    r = slide(FORCES["sign"]).simulate(5.0, until="P.displacement > 0.19", accuracy=1e-8)
    assert r["P"].displacement[-1] == pytest.approx(0.19, abs=1e-9)


@pytest.mark.parametrize("force", [
    lambda t, x, v: -2 * sp.sign(x),  # a relay that swings
    lambda t, x, v: -1e4 * sp.Max(x, 0) - 1e4 * sp.Min(x, 0) - 300 * v,  # comes to rest where it switches without a jump
    lambda t, x, v: sp.Piecewise((-1e4 * x - 300 * v, x > 0), (0, True)) - 5 * x - 8 * v,  # rests on a damped stop
    lambda t, x, v: sp.floor(50 * x) / 50,  # passes many jumps
])
def test_others_are_not(force):
    r = slide(force).simulate(2.0)
    assert r.complete
    assert np.isfinite(r["P"].displacement).all()


@pytest.mark.parametrize("solver", [None, "ida", "radau3", "cvode"])
def test_instants_that_differ_by_round_off_are_one(solver):
    """A table, a Piecewise, a sign and a controller switch at 0.3 s, some of them one bit later."""
    late = float(np.nextafter(0.3, 1))
    table = mb.table([0, 0.1, 0.2, late, 1], [0, 1, 0, 1, 0], kind="step")
    force = table + sp.Piecewise((0, mb.t < 0.3), (1, True)) + sp.sign(sp.sin(10 * sp.pi * mb.t))
    r = slide(lambda t, x, v: force, rate0=0, sampled=True).simulate(1.0, solver=solver)
    sampled = sum(0.1 * 0.01 * k * 0.01 for k in range(100))
    assert r["P"].rate[-1] == pytest.approx(0.8 + 0.7 + 0.0 + sampled, abs=1e-6)  # of the table, the Piecewise, the sign
    assert not r.warnings


def test_fast_vibrations_held_by_a_constraint_are_no_jumps():
    """A welded tube that falls with a mass at its end, all of whose vibrations are followed: its first 2000 steps take 2 % of the
    run, and what changes in the rows of its weld beside them is round-off alone."""
    s = mb.Scene("falling", gravity=(0, -9.81, 0))
    tube = mb.Section.tube(outer=0.015, inner=0.012, E=70e9, nu=0.33, rho=2700.0)
    b = s.beam("b", (0, 0), (0.8, 0.2), section=tube, elements=2)
    m = s.rigid_body("m", 0.4, (0.01, 0.01, 0.01), at=(0.8, 0.2))
    s.weld("W", b, m, at=(0.8, 0.2))
    s.revolute("A", s.ground, b, at=(0, 0))
    assert s.simulate(0.3, solver=mb.RadauIIA(3, rtol=2e-8), form=mb.GGL(waves=True)).complete
