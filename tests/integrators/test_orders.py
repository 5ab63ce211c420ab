"""The order of a method, measured by one call, and where it gives no number."""

from __future__ import annotations

import numpy as np
import pytest
from dae_problems import Explicit, circle, circle_exact, circle_ode
from own_methods import RK4, Dormand8, Euler, Midpoint
from scenes import physical_pendulum

import mbdae as mb
import mbdae.integrators.named as orders
from mbdae.errors import OptionError

SOME = (16, 24, 32, 48, 64)


@pytest.mark.parametrize(("solver", "form", "orders"), [
    (mb.HHT(), None, (2, 2, 2)), (mb.RadauIIA(3), None, (5, 5, 3)), (mb.RadauIIA(2), mb.Index3(), (3, 2, 1)),
    (Midpoint(), None, (2, 2, None)), (RK4(), mb.Index1(), (4, 4, None)),
])
def test_orders_on_a_scene(solver, form, orders):
    found = mb.measure_order(solver, physical_pendulum(60), 1.0, form, steps=(*SOME, 96, 128))
    for part, order in zip(("positions", "velocities", "multipliers"), orders, strict=True):
        if order is None:
            assert part not in found.orders or found.orders[part] is None
        else:
            assert found.orders[part] == pytest.approx(order, abs=0.25), str(found)
    assert str(found).count("\n") >= len(found.steps)


@pytest.mark.parametrize("stages", [2, 3, 5])
def test_the_reference_and_the_closed_form_tell_the_same(stages):
    known = mb.measure_order(mb.RadauIIA(stages), circle("ggl"), 1.0, exact=circle_exact)
    found = mb.measure_order(mb.RadauIIA(stages), circle("ggl"), 1.0)
    assert found.orders["multipliers"] == pytest.approx(known.orders["multipliers"], abs=0.1)
    seen, close = (5, 5e-2) if stages == 5 else (None, 1e-4)  # 3 stages are the reference of 5, 5 stages that of all others
    assert found.errors["multipliers"][:seen] == pytest.approx(known.errors["multipliers"][:seen], rel=close)


def test_round_off_is_no_order():
    found = mb.measure_order(Dormand8(), circle_ode(), 1.0, steps=SOME, exact=lambda t: circle_exact(t)[:, :2])
    assert found.orders["unknowns"] is None
    assert "round-off" in found.why["unknowns"]
    assert "no order to be seen" in str(found)


def test_kinks_leave_no_order():
    """y' = |sin 7t| + y |cos 5t|: a method of order 4 falls by 0 to 4 from one step to the next."""
    def rate(t, y):
        return np.abs(np.sin(7 * t)) + y * np.abs(np.cos(5 * t))

    system = Explicit(lambda t, y, yp, out: yp - rate(t, y), [1.0], [1.0])
    found = mb.measure_order(RK4(), system, 2.0)
    assert found.orders["unknowns"] is None
    assert "kinks" in found.why["unknowns"]


def test_steps_that_are_too_long_show_no_order():
    found = mb.measure_order(Euler(), circle_ode(), 3.0, steps=(4, 5, 6), exact=lambda t: circle_exact(t)[:, :2])
    assert found.orders["unknowns"] is None


@pytest.mark.parametrize(("call", "message"), [
    (lambda: mb.measure_order(mb.IDA(), circle("ggl"), 1.0), "has no constant step, so its error has no order"),
    (lambda: mb.measure_order(mb.HHT(), 3.0, 1.0), r"what = 3\.0 is neither a scene"),
    (lambda: mb.measure_order(mb.HHT(), circle("ggl"), 1.0, steps=(4, 4, 8)), "three or more rising numbers of steps"),
    (lambda: mb.measure_order(Midpoint(), circle("ggl"), 1.0), "Midpoint needs y' = f"),
    (lambda: mb.measure_order(mb.HHT(), circle("ggl"), 1.0, exact=lambda t: t), r"exact = .* shape \(1,\) for 1 times"),
])
def test_what_cannot_be_measured_is_refused(call, message):
    with pytest.raises(OptionError, match=message):
        call()


def test_a_closed_form_may_give_the_first_unknowns_alone():
    found = mb.measure_order(RK4(), circle_ode(), 1.0, exact=lambda t: circle_exact(t)[:, :1])
    assert found.orders["unknowns"] == pytest.approx(4, abs=0.2)


@pytest.mark.parametrize(("steps", "many"), [((2, 3, 4), 12), ((5, 7, 9), 36)])
def test_the_reference_takes_a_multiple_of_all_steps_or_four_times_the_most(steps, many, monkeypatch):
    taken, shortened = [], orders._with_steps
    monkeypatch.setattr(orders, "_with_steps", lambda solver, span, count: taken.append(count) or shortened(solver, span, count))
    mb.measure_order(mb.HHT(), circle("ggl"), 0.1, steps=steps)
    assert taken == [many, many, *steps]
