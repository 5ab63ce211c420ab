"""The compiled kernels against their oracle (NumPy, node by node): laws, trees of recursive joints, laws on lines."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import symengine as se
from recursive_scenes import planar_tree, prescribed

import mbdae as mb
from mbdae.contracts.case import Case, columns
from mbdae.contracts.variants import variants
from mbdae.kernels import Kernel
from mbdae.kernels.tree_plan import tree_plan
from mbdae.laws import bodies, forces, joints
from mbdae.laws.beam import Beam, LineLoad
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.line import derive_line
from mbdae.system.base import Array
from mbdae.system.prepare import prepare

LAWS = [(joints.Revolute, {"kept": False}), (joints.Revolute, {"kept": True}), (forces.Bushing, {}), (forces.PointSpring, {}),
        (bodies.RigidBody, {})]


def compare(kernel: Kernel, x: Array) -> None:
    """Two orders of summing the same terms: they differ by the rounding of the largest outputs."""
    compiled, oracle = kernel.values(x), kernel.oracle(x)
    assert compiled.shape == oracle.shape == (*x.shape[:-1], kernel.width)
    assert np.isfinite(oracle).all()
    off = np.abs(compiled - oracle).max(axis=0, initial=0.0) / (1 + np.abs(compiled).max(initial=0.0))
    assert off.max(initial=0.0) < 1e-11, f"{np.sum(off >= 1e-11)} of {kernel.width} outputs"


def random_inputs(kernel: Kernel) -> Array:
    return np.random.default_rng(3).uniform(0.2, 1.0, (4, len(kernel.symbols)))


@pytest.mark.parametrize(("law", "options"), LAWS)
def test_laws(law: Any, options: dict[str, Any]) -> None:
    """Jacobian and nonlinear rows; the outputs of all laws in all variants are held by the contract "compiled kernel"."""
    _, structure, sides = next(iter(variants(law, options, {})))
    case = Case(law, structure, sides, {})
    for kernel in (case.linearised.jacobian, case.linearised.residual):
        compare(kernel, columns(kernel.symbols, case.values))


@pytest.mark.parametrize("scene", [prescribed, planar_tree])
def test_trees(scene: Callable[[], mb.Scene]) -> None:
    for tree in prepare(scene()).all_bodies.moved.trees:
        plan = tree_plan(tree.structure)
        for piece in (plan.residual, plan.motion_of_all, *plan.jacobian):
            compare(piece.kernel, random_inputs(piece.kernel))


@pytest.mark.parametrize("kind", [NodeKind.PLANAR, NodeKind.SPATIAL])
@pytest.mark.parametrize(("law", "mixed"), [(Beam, True), (Beam, False), (LineLoad, False)])
def test_laws_on_lines(law: Any, mixed: bool, kind: NodeKind) -> None:
    d = derive_line(law, Structure() if law is Beam else LineLoad("wind", f2=1.0).structure(frozenset()), kind, mixed)
    symbols = [*d.variables, *map(se.Symbol, d.parameters)]
    for expressions in (d.outputs, [*d.derivatives.values()]):
        kernel = Kernel(symbols, expressions)
        compare(kernel, random_inputs(kernel))


def test_no_outputs_and_no_inputs() -> None:
    assert Kernel([se.Symbol("x")], []).oracle(np.zeros((3, 1))).shape == (3, 0)
    constant = Kernel([], [se.Integer(2), se.Rational(1, 4)])
    assert constant.oracle(np.zeros((3, 0))).tolist() == [[2.0, 0.25]] * 3


def test_every_function_a_law_may_use() -> None:
    """Values, and slopes by the complex step, of every function in which laws are stated."""
    x, y = se.symbols("x y")
    switched = se.Piecewise((x * y, se.And(x < y, y < 0.9)), (x**3, se.Or(x > 0.8, se.Ne(x, y))), (0, True))
    plain = [se.sin, se.cos, se.tan, se.asin, se.acos, se.atan, se.sinh, se.cosh, se.tanh, se.asinh, se.atanh, se.log, se.erf]
    e = [*(f(x) for f in plain), se.acosh(1 + x), se.atan2(y, -x), se.exp(-x) + se.E, se.sqrt(x) / se.sqrt(y), se.pi * x + 0.1,
         x**-3 + 2**y + y ** se.Rational(2, 3), se.Abs(x - y) * se.sign(x - y), se.Max(x, y, 0.5) - se.Min(x, y, 0.5), switched,
         se.UnevaluatedExpr(x + y) * se.UnevaluatedExpr(x - y), se.floor(3 * x)]
    kernel, points = Kernel([x, y], e), random_inputs(Kernel([x, y], e))
    compare(kernel, points)
    h = 1e-6
    for i, step in enumerate(np.eye(2)):
        central = (kernel.values(points + h * step) - kernel.values(points - h * step)) / (2 * h)
        exact = np.imag(kernel.oracle(points + 1e-30j * step)) / 1e-30
        np.testing.assert_allclose(exact, central, rtol=1e-7, atol=1e-7, err_msg=f"input {i}")
    with pytest.raises(mb.LawError, match="lambertw"):
        _ = Kernel([x, y], [se.LambertW(x)]).oracle
