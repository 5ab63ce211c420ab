"""Scenes with tables leave as C and JAX, with their points; other formats say that a table is no formula."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb


def scene() -> mb.Scene:
    s = mb.Scene("tables")
    body = s.rigid_body("m", 1.0, (1, 1, 1), at=(0, 0, 0))
    force = mb.table([0, 1, 2, 4], [0, 3, -1, 0], kind="cubic", outside="periodic") + 2 * mb.table([0, 1, 2], [0, 1, 3]).subs(
        mb.t, 2 * mb.t)
    s.prismatic("p", s.ground, body, at=(0, 0, 0), axis=(1, 0, 0), spring=25.0, damper=0.5, force=force)
    return s


def test_c_looks_up_as_the_native_core_does(compiled):
    system = scene().system()
    export = mb.export(scene(), format="c")
    call = compiled(export)
    out = np.empty(system.n)
    for t in (0.0, 0.3, 0.5, 1.7, 9.25):
        y = system.y0 + 0.1
        system.residual(t, y, system.yp0, out)
        p = [e.value for e in export.inputs["p"]]
        np.testing.assert_allclose(call("residual", t=t, y=y, yp=system.yp0, p=p), out, rtol=1e-13, atol=1e-13)


def test_sympy_says_that_a_table_is_no_formula():
    with pytest.raises(mb.OptionError, match=r"the scene has a table .*export format='c'"):
        mb.export(scene(), format="sympy")["residual"]


def test_jax_looks_up_too():
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    system, export, out = scene().system(), mb.export(scene(), format="jax"), np.empty(scene().system().n)
    y, p, function = system.y0 + 0.1, np.array([e.value for e in export.inputs["p"]]), jax.jit(export["residual"])
    for t in (0.0, 0.3, 0.5, 1.7, 9.25):
        system.residual(t, y, system.yp0, out)
        np.testing.assert_allclose(function(t, y, system.yp0, p), out, rtol=1e-12, atol=1e-12)
