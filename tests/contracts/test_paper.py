"""The paper's printed equations against the derivation: what is right is reproduced, every misprint is detected.

Vectors as in the paper: b1, b2, b3 the joint axes of bodies k and l, all in inertial components, at random attitudes
off the constraint manifold unless stated. Rows act on (psi_k, psi_l).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.linalg import norm

from mbdae.contracts.case import Case
from mbdae.contracts.checks import covector
from mbdae.contracts.states import columns, rotation
from mbdae.kernels import Kernel
from mbdae.laws.joints import Revolute
from mbdae.laws.on_coordinates import JointDamper, JointSpring
from mbdae.reports.statement import structure_of
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.outputs import acceleration, position, velocity, weighted

SPATIAL = ((NodeKind.SPATIAL, Axes.GENERAL), (NodeKind.SPATIAL, Axes.GENERAL))
FREE, DRIVEN = structure_of(Revolute, {"drive": None}), structure_of(Revolute, {})
TIGHT = 1e-12


def tilde(a: Any) -> Any:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


@dataclass
class Point:
    """One random state in the paper's letters."""

    bk: Any  #: columns b1k, b2k, b3k
    bl: Any
    wk: Any
    wl: Any
    value: dict[str, float]
    force: dict[str, Any]  #: covector on psi_k, psi_l, inertial components


def points(law: Any, structure: Structure, zero: str = "", on_manifold: bool = False) -> tuple[Case, list[Point]]:
    """States of a law; multipliers whose name starts with `zero` are set to 0."""
    case = Case(law, structure, SPATIAL, {})
    values = dict(case.on_manifold if on_manifold else case.values)
    values |= {n: 0 * v for n, v in values.items() if zero and n.startswith(zero) and not n.endswith(("tilt_x", "tilt_y"))}
    case.values = values
    F, found = covector(case, values), []
    k, l = case.d.frames
    R, w = {f.side: rotation(f, values) for f in (k, l)}, {f.side: columns(f.u, values) for f in (k, l)}
    for i in range(len(values["k_v1"])):
        b = {s: R[s][i] @ np.array([[values[f"{s}_Q{a}{j}"][i] for a in "xyz"] for j in (1, 2, 3)]) for s in "kl"}
        psi = {s: R[s][i] @ np.array([F[s, c][i] if (s, c) in F else 0.0 for c in (3, 4, 5)]) for s in "kl"}
        spin = {s: R[s][i] @ w[s][i, 3:] for s in "kl"}
        found.append(Point(b["k"], b["l"], spin["k"], spin["l"], {n: v[i] for n, v in values.items()}, psi))
    return case, found


def off(a: Any, b: Any) -> float:
    return float(norm(np.asarray(a) - np.asarray(b)) / max(1.0, norm(b)))


def test_eq_1_rows_and_the_second_branch() -> None:
    case, states = points(Revolute, FREE)
    g = case.evaluate(position, case.values).real[:, 3:]
    assert case.d.rows[3:] == ("tilt_y", "tilt_x")
    for row, p in zip(g, states, strict=True):
        assert off(row, [p.bk[:, 2] @ p.bl[:, 0], p.bk[:, 2] @ p.bl[:, 1]]) < TIGHT
        assert off(row, [p.bk[:, 2] @ p.bk[:, 0], p.bk[:, 2] @ p.bk[:, 1]]) > 1e-2  # the text says b1k, b2k: always zero


def test_eq_3_row_2_is_misprinted() -> None:
    _, states = points(Revolute, FREE, zero="lambda")
    for p in states:
        f1, f2 = p.value["lambda_tilt_y"], p.value["lambda_tilt_x"]
        b3, b1, b2 = tilde(p.bk[:, 2]), p.bl[:, 0], p.bl[:, 1]
        assert off(b3 @ b1 * f1 + b3 @ b2 * f2, p.force["k"]) < TIGHT
        assert off(-b3 @ b1 * f1 - b3 @ b2 * f2, p.force["l"]) < TIGHT
        assert off(-b3 @ b2 * f1 - b3 @ b1 * f2, p.force["l"]) > 1e-2  # as printed


def test_eq_12_and_13_driven_row() -> None:
    case, states = points(Revolute, DRIVEN, zero="lambda")
    case.values["lambda_drive"] = np.array([0.7, -1.3, 2.1, 0.4])
    F, g = covector(case, case.values), case.evaluate(position, case.values).real[:, 5]
    R = {f.side: rotation(f, case.values) for f in case.d.frames}
    tilts = np.stack([case.values["lambda_tilt_y"], case.values["lambda_tilt_x"]])
    for i, p in enumerate(states):
        phi, f3 = p.value["drive"], case.values["lambda_drive"][i]
        v = p.bl[:, 0] * np.sin(phi) + p.bl[:, 1] * np.cos(phi)
        axes = tilde(p.bk[:, 2]) @ (p.bl[:, 0] * tilts[0, i] + p.bl[:, 1] * tilts[1, i])
        on_k, on_l = (R[s][i] @ [F[s, c][i] for c in (3, 4, 5)] for s in "kl")
        assert off(g[i], p.bk[:, 0] @ v) < TIGHT
        assert off(on_k - axes, tilde(p.bk[:, 0]) @ v * f3) < TIGHT
        assert off(on_l + axes, -tilde(p.bk[:, 0]) @ v * f3) < TIGHT
        printed = tilde(p.bk[:, 0]) @ (tilde(p.bl[:, 0]) * np.sin(phi) + tilde(p.bl[:, 1]) * np.cos(phi)) * f3
        assert printed.shape == (3, 3)  # a second tilde makes a matrix of what must be a covector
        assert min(off(column, on_k - axes) for column in printed.T) > 1e-3


def test_eq_12_angle_on_the_manifold_is_sine_of_the_difference() -> None:
    case = Case(Revolute, DRIVEN, SPATIAL, {})
    for angle in (-2.0, 0.3, 1.4):
        values = case.states.special(angle, True)
        g = case.evaluate(position, values).real[0]
        assert abs(g[5] - np.sin(values["drive"][0] - angle)) < TIGHT
        assert np.max(np.abs(g[:5])) < TIGHT


def mean_axis(p: Point) -> Any:
    return (p.bk[:, 2] + p.bl[:, 2]) / (1 + p.bk[:, 2] @ p.bl[:, 2])


def rate_of_angle(case: Case) -> Any:
    d = case.d
    rate = d.variation.resolve(d.variation.rate(d.coordinates["angle"])).subs(d.variation.insertion())
    symbols = sorted(rate.free_symbols, key=str)
    return Kernel(symbols, [rate]).values(np.stack([case.values[str(s)] for s in symbols], axis=-1))[:, 0]


def test_eq_16_17_rate_of_the_angle() -> None:
    """m.(wl - wk) at any attitude; b3k.(wl - wk), as printed, on the manifold only."""
    case, states = points(Revolute, FREE)
    for rate, p in zip(rate_of_angle(case), states, strict=True):
        assert off(rate, mean_axis(p) @ (p.wl - p.wk)) < TIGHT
        assert abs(rate - p.bk[:, 2] @ (p.wl - p.wk)) > 1e-2
    case, states = points(Revolute, FREE, on_manifold=True)
    for rate, p in zip(rate_of_angle(case), states, strict=True):
        assert off(rate, p.bk[:, 2] @ (p.wl - p.wk)) < TIGHT


@pytest.mark.parametrize(("law", "equation"), [(JointSpring, 18), (JointDamper, 19)])
def test_eq_18_19_spring_and_damper(law: Any, equation: int) -> None:
    """-+ k phi m on both bodies; b3k and b3l, as printed, do not balance off the manifold."""
    _, states = points(law, structure_of(law, {"joint": Revolute}))
    for p in states:
        if equation == 18:
            A = p.bk.T @ p.bl
            principal = np.arctan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1])
            turns = 2 * np.pi * np.round((p.value["state_followed"] - principal) / (2 * np.pi))
            moment = p.value["stiffness"] * (principal + turns - p.value["rest"])
        else:
            moment = p.value["damping"] * (mean_axis(p) @ (p.wl - p.wk))
        assert off(-moment * mean_axis(p), p.force["k"]) < TIGHT
        assert off(moment * mean_axis(p), p.force["l"]) < TIGHT
        printed = -moment * p.bk[:, 2], moment * p.bl[:, 2]
        assert norm(printed[0] + printed[1]) > 1e-2 * abs(moment)
        assert off(printed[1], p.force["l"]) > 1e-2


def test_closed_form_of_gamma() -> None:
    """(wk - wl).[(wk x a) x b + a x (wl x b)] for a row a.b."""
    case, states = points(Revolute, FREE)
    gamma = case.evaluate(acceleration, case.values).real[:, 3:]
    for row, p in zip(gamma, states, strict=True):
        a = p.bk[:, 2]
        closed = [(p.wk - p.wl) @ (np.cross(np.cross(p.wk, a), b) + np.cross(a, np.cross(p.wl, b))) for b in p.bl.T[:2]]
        assert off(row, closed) < TIGHT


def test_closed_form_of_the_driven_row() -> None:
    case, states = points(Revolute, DRIVEN)
    gd, gamma = (case.evaluate(o, case.values).real[:, 5] for o in (velocity, acceleration))
    for got, got_rate, p in zip(gamma, gd, states, strict=True):
        phi, d, dd, a = p.value["drive"], p.value["drive_dot"], p.value["drive_ddot"], p.bk[:, 0]
        v = p.bl[:, 0] * np.sin(phi) + p.bl[:, 1] * np.cos(phi)
        v1 = p.bl[:, 0] * np.cos(phi) - p.bl[:, 1] * np.sin(phi)
        ak, cross = np.cross(p.wk, a), np.cross
        closed = cross(p.wk, ak) @ v + 2 * ak @ cross(p.wl, v) + a @ cross(p.wl, cross(p.wl, v))
        closed += 2 * d * (ak @ v1 + a @ cross(p.wl, v1)) + dd * a @ v1 - d**2 * a @ v
        assert off(got, closed) < TIGHT
        assert off(got_rate, (p.wk - p.wl) @ cross(a, v) + d * a @ v1) < TIGHT


def test_closed_form_of_the_tangent() -> None:
    """d(G^T f)/d(psi_k, psi_l) = [[f b~a~, -f a~b~], [-f b~a~, f a~b~]] for a row a.b."""
    case, states = points(Revolute, FREE, zero="lambda")
    v, table = case.d.variation, case.d.variation.insertion()
    entries = []
    for side in "kl":
        _, psi = weighted(case.d, case.d.multipliers, side)
        entries += [c for f in case.d.frames for e in psi for c in v.gradient(f, e)[1]]
    inserted = [v.resolve(e).subs(table) for e in entries]
    symbols = sorted(set().union(*(e.free_symbols for e in inserted)), key=str)
    values = Kernel(symbols, inserted).values(np.stack([case.values[str(s)] for s in symbols], axis=-1))
    for p, block in zip(states, values.reshape(-1, 2, 2, 3, 3), strict=True):
        expected = np.zeros((2, 2, 3, 3))
        for name, b in zip(("lambda_tilt_y", "lambda_tilt_x"), p.bl.T[:2], strict=False):
            ba, ab, f = tilde(b) @ tilde(p.bk[:, 2]), tilde(p.bk[:, 2]) @ tilde(b), p.value[name]
            expected += f * np.array([[ba, -ab], [-ba, ab]])
        assert off(block, expected) < TIGHT
