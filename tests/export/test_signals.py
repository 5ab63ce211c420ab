"""Signals that are numbers stay inputs of exported equations, whatever their value."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb
from mbdae.formulations import default_form, system_for
from mbdae.system.prepare import prepare

MODELS = {"recursive": (mb.Recursive(), None), "kinematic": (mb.Kinematic(), None),
          "eliminated": (mb.Kinematic(), mb.Index1(multipliers="eliminated"))}
EXACT = 1e-12  #: round-off of a few hundred operations


def cart(model, push, twist):
    """A cart with a pole: `push` acts on the cart, a torque of both signals on the pole; one signal acts on nothing."""
    s = mb.Scene("cart", gravity=(0, -9.81, 0))
    body, pole = s.rigid_body("body", 1.0, 0.01, at=(0, 0)), s.link("pole", (0, 0), (0.3, -1.0), mass=0.3)
    u, w = s.signal("push", push), s.signal("twist", twist)
    s.signal("idle", 0.0)
    s.prismatic("rail", s.ground, body, at=(0, 0), axis=(1, 0, 0), model=model, force=u)
    s.revolute("pin", body, pole, at=(0, 0), model=model, torque=3 * w - u * s.sensor("pin.rate"))
    return s


def wanted(scene, form, t, y, yp):
    """Residual of a scene as it is integrated."""
    prepared = prepare(scene)
    system = system_for(prepared, form or default_form(prepared))
    out = np.empty(system.n)
    system.residual(t, y, yp, out)
    return out


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("value", [0.0, 2.5])
def test_signals_are_inputs_of_any_value(kind, value, compiled):
    """Both signals have one value, and other numbers put into the export give the equations of a scene with these numbers."""
    model, form = MODELS[kind]
    export = mb.export(cart(model, value, value), "c", form)
    named = [(e.name, e.unit, e.value) for e in export.inputs["signals"]]
    assert named == [("push", "N", value), ("twist", "", value), ("idle", "", 0.0)]
    assert all(names[-1] == "signals" for names in export.arguments.values())
    other = cart(model, -1.5, 0.7)
    stated = mb.export(other, "c", form)  # its parameters are taken: those of Baumgarte's terms follow from the start
    call, rng, n = compiled(export), np.random.default_rng(3), len(export.inputs["y"])
    y = np.array([e.value for e in export.inputs["y"]]) + 0.1 * rng.normal(size=n)
    given = {"t": 0.2, "y": y, "yp": rng.normal(size=n), "p": [e.value for e in stated.inputs["p"]]}
    found, right = call("residual", **given, signals=[-1.5, 0.7, 9.0]), wanted(other, form, 0.2, y, given["yp"])
    assert np.max(np.abs(found - right)) < EXACT * np.max(np.abs(right))
    forces = compiled(stated)("joint_forces", **given, signals=[e.value for e in stated.inputs["signals"]])
    changed = call("joint_forces", **given, signals=[-1.5, 0.7, 9.0])
    assert np.max(np.abs(changed - forces)) < EXACT * np.max(np.abs(forces))


def test_signals_in_symbols():
    """SymPy and LaTeX name the input; a signal that is an expression is a part of the equations."""
    s = cart(mb.Recursive(), 0.0, 0.0)
    s.signal("damping", -2.0 * s.sensor("rail.rate"))
    steps, outputs = mb.export(s)["rates"]
    free = {str(x) for e in (*(e for _, e in steps), *outputs) for x in e.free_symbols}
    assert {"signals0", "signals1"} <= free
    assert "signals2" not in free
    assert "u_{0}" in mb.export(s, "latex").text
    assert [e.name for e in mb.export(s).inputs["signals"]] == ["push", "twist", "idle"]


def test_casadi_takes_signals():
    pytest.importorskip("casadi")
    export = mb.export(cart(mb.Recursive(), 0.0, 0.0), "casadi")
    y, p = ([e.value for e in export.inputs[name]] for name in "yp")
    pushed = np.array(export["rates"](0, y, p, [2.0, 0.0, 0.0])).ravel() - np.array(export["rates"](0, y, p, [0.0] * 3)).ravel()
    assert pushed[[e.name for e in export.inputs["y"]].index("rail.rate")] > 1.0  # 2 N on 1.3 kg


def test_a_scene_without_signals_has_no_such_argument():
    s = mb.Scene("mass")
    s.point_mass("m", 1.0, at=(0, 0))
    export = mb.export(s, form=mb.ODE())
    assert export.inputs["signals"] == ()
    assert all("signals" not in names for names in export.arguments.values())
    assert "signals" not in export.text
