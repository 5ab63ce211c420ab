"""Recursive joints: the coordinate is the only unknown of the outer body l; reduction map and transformed matrices."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.analysis.frame import skew
from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.documents.document import Document
from mbdae.laws.joints import ClassicalPrismatic, ClassicalRevolute
from mbdae.reports.common import Check, checks_table
from mbdae.reports.joint_checks import JointChecks
from mbdae.reports.statement import derived, structure_of
from mbdae.reports.states import POINTS, STEP
from mbdae.scene.components import Recursive
from mbdae.scene.scene import SceneData
from mbdae.symbolic.fingerprint import fingerprint
from mbdae.symbolic.joint import Joint
from mbdae.system.model.rotations import rotation_matrices
from mbdae.system.prepare import prepare

_MAP = (r"\mathbf{B} = \begin{bmatrix} \mathbf{1} & -\tilde{\mathbf{d}} & \mathbf{t} \\ "
        r"\mathbf{0} & \mathbf{1} & \mathbf{b} \end{bmatrix}")  # fmt: skip

SYMBOLS = Table(
    ["symbol", "unit", "meaning"],
    [
        ["$c$", "rad or m", "coordinate of the joint, 0 as drawn, l relative to k"],
        [r"$\mathbf{z}_k$", "1", "axis of the joint, fixed to k"],
        [r"$\mathbf{d}$", "m", "from the centre of k to the centre of l"],
        [r"$\mathbf{s}$", "m", "from the point of the joint to the centre of l"],
        [r"$\mathbf{b},\ \mathbf{t}$", "1, m", "rotation and translation of l per unit of the coordinate"],
        [r"$\mathbf{r}$", "N, N m", "total residual assembled at l, forces over moments, left-hand side"],
        [r"$\mathbf{M}, \mathbf{C}, \mathbf{K}$", "", "its derivatives by accelerations, velocities and virtual displacements"],
        [
            r"$\tilde{\mathbf{a}}$",
            "",
            r"matrix of the vector product: $\tilde{\mathbf{a}}\,\mathbf{b} = \mathbf{a}\times\mathbf{b}$",
        ],
    ],
)


def recursive_sections(r: JointChecks) -> list[Section]:
    """The section on a joint as a recursive one; none for a joint without a twist."""
    law = type(r.s.law)
    if law.twist is None:
        return []
    checks: list[Check] = []
    found = sections(law.twist, law, checks)
    r.formulas.checks += checks
    return [Section("As a recursive joint", [SYMBOLS, *found])]


def recursive_report() -> Document:
    """The report of recursive revolute and prismatic joints."""
    checks: list[Check] = []
    blocks: list[Block] = [
        Paragraph(
            "A recursive joint has no rows and no multipliers: its coordinate $c$ is the only unknown of body l, whose state"
            " follows from that of k. The joint states one twist, (travel, turn) about $\\mathbf{z}_k$ per unit of the"
            " coordinate; the rows of the classical model name the reactions. Elements, forces and contacts on l stay what they"
            " are: their residual is transformed."
        )
    ]
    laws: tuple[type[Joint], ...] = (ClassicalRevolute, ClassicalPrismatic)
    for law, name in zip(laws, ("Revolute", "Prismatic"), strict=True):
        assert law.twist is not None
        blocks.append(Section(f"{name} joint", sections(law.twist, law, checks)))
    return Document(
        "Recursive joint",
        [Section("Symbols", [SYMBOLS]), *blocks, Section("Numeric check", checks_table(checks, POINTS)), _origin(laws)],
    )


def _origin(laws: tuple[type[Joint], ...]) -> Section:
    rows = [
        [f"`{law.__name__}`", f"({law.twist[0]}, {law.twist[1]})", f"`{fingerprint(derived(law, structure_of(law, {})))[:32]}…`"]
        for law in laws
        if law.twist
    ]
    return Section(
        "Origin",
        [
            Paragraph(
                "Twists are read from the laws that are integrated; the sha256 is that of their rows, which name the reactions."
            ),
            Table(["law", "(travel, turn)", "sha256"], rows),
        ],
    )


def sections(twist: tuple[int, int], law: type[Joint], checks: list[Check]) -> list[Block]:
    """Map, transformed residual and matrices of one twist."""
    travel, turn = twist
    b = r"\mathbf{z}_k" if turn == 1 else r"\mathbf{0}" if turn == 0 else f"{turn}\\,\\mathbf{{z}}_k"
    along = "" if travel == 0 else r"\mathbf{z}_k" if travel == 1 else f"{travel}\\,\\mathbf{{z}}_k"
    t = " + ".join(part for part in (along, r"\mathbf{b}\times\mathbf{s}" if turn else "") if part)
    turning = r"\mathbf{R}_l = \mathbf{R}_k\,\exp(c\,\tilde{\mathbf{e}}_z)" if turn else r"\mathbf{R}_l = \mathbf{R}_k"
    checks += _against_tree(law, twist) + _transformed(twist)
    return [
        Paragraph(
            f"Twist (travel {travel}, turn {turn}): l = k exp(c (travel, turn)) about the joint's axis; $\\mathbf{{e}}_z$ is the"
            " axis in the body."
        ),
        Equation(f"{turning} \\\\ \\mathbf{{b}} = {b} \\\\ \\mathbf{{t}} = {t or chr(92) + 'mathbf{0}'}"),
        Paragraph(
            "Reduction map, virtual displacements and velocities of the centre of l from those of k and of the coordinate:"
        ),
        Equation(
            r"\begin{bmatrix} \delta\mathbf{r}_l \\ \delta\boldsymbol{\psi}_l \end{bmatrix} = \mathbf{B} "
            r"\begin{bmatrix} \delta\mathbf{r}_k \\ \delta\boldsymbol{\psi}_k \\ \delta c \end{bmatrix} \\ " + _MAP
        ),
        Paragraph("Accelerations follow with the rate of the map:"),
        Equation(
            r"\begin{bmatrix} \ddot{\mathbf{r}}_l \\ \dot{\boldsymbol{\omega}}_l \end{bmatrix} = \mathbf{B} \begin{bmatrix}"
            r" \ddot{\mathbf{r}}_k \\ "
            r"\dot{\boldsymbol{\omega}}_k \\ \ddot c \end{bmatrix} + \begin{bmatrix} \mathbf{a}_0 \\ \boldsymbol{\alpha}_0"
            r" \end{bmatrix} \\ " + _bias(travel, turn)
        ),
        Paragraph(
            "The residual assembled at l, and its mass, are transformed to k and the equation of the coordinate by the transpose;"
            " a spring, damper or torque of the joint adds to that equation:"
        ),
        Equation(
            r"\bar{\mathbf{r}} = \mathbf{B}^{\mathsf{T}}\mathbf{r} \\ \bar{\mathbf{M}} ="
            r" \mathbf{B}^{\mathsf{T}}\mathbf{M}\,\mathbf{B}"
        ),
        Paragraph(
            "Damping and stiffness, with $\\mathbf{r} = (\\mathbf{f}, \\mathbf{m})$ the total residual at l and $\\mathbf{w}$ the"
            " velocities $(\\dot{\\mathbf{r}}_k, \\boldsymbol{\\omega}_k, \\dot c)$ of the unknowns, $\\delta\\mathbf{w} ="
            " \\mathbf{0}$ in the stiffness:"
        ),
        Equation(
            r"\bar{\mathbf{C}} = \mathbf{B}^{\mathsf{T}}\left(\mathbf{C}\,\mathbf{B} +"
            r" \mathbf{M}\,\frac{\partial}{\partial\mathbf{w}}"
            r"\begin{bmatrix} \mathbf{a}_0 \\ \boldsymbol{\alpha}_0 \end{bmatrix}\right) \\ "
            r"\bar{\mathbf{K}}\,\delta\mathbf{q} = \mathbf{B}^{\mathsf{T}}\left(\mathbf{K}\,\mathbf{B}\,\delta\mathbf{q} +"
            r" \mathbf{C}\,\delta(\mathbf{B}\mathbf{w}) "
            r"+ \mathbf{M}\,\delta(\mathbf{B}\dot{\mathbf{w}} + \mathbf{a}_0, \boldsymbol{\alpha}_0)\right) +"
            r" \delta\mathbf{B}^{\mathsf{T}}\,\mathbf{r}"
        ),
        Paragraph("The last term is the geometric stiffness; it needs the total residual, not a part of it. Its rows:"),
        Equation(_geometric(travel, turn)),
    ]


def _bias(travel: int, turn: int) -> str:
    """LaTeX of a0 and alpha0, the accelerations of l where those of the unknowns are zero."""
    alpha = r"\dot c\,\boldsymbol{\omega}_k\times\mathbf{b}" if turn else r"\mathbf{0}"
    slide = (
        r" + 2\,\dot c\,\boldsymbol{\omega}_k\times\mathbf{z}_k"
        if travel == 1
        else f" + 2\\cdot {travel}\\,\\dot c\\,\\boldsymbol{{\\omega}}_k\\times\\mathbf{{z}}_k" if travel else ""
    )
    own = (
        r" + \boldsymbol{\alpha}_0\times\mathbf{s} + \boldsymbol{\omega}_l\times(\boldsymbol{\omega}_l\times\mathbf{s})"
        if turn
        else r" + \boldsymbol{\omega}_k\times(\boldsymbol{\omega}_k\times\mathbf{s})"
    )
    return (
        f"\\boldsymbol{{\\alpha}}_0 = {alpha} \\\\ \\mathbf{{a}}_0 ="
        f" \\boldsymbol{{\\omega}}_k\\times(\\boldsymbol{{\\omega}}_k\\times(\\mathbf{{d}} - \\mathbf{{s}})){slide}{own} \\\\"
        " \\boldsymbol{\\omega}_l ="
        f" \\boldsymbol{{\\omega}}_k{' + ' + chr(92) + 'dot c' + chr(92) + ',' + chr(92) + 'mathbf{b}' if turn else ''}"
    )


def _geometric(travel: int, turn: int) -> str:
    """LaTeX of the change of B^T r at constant r, row by row."""
    moment = r"\mathbf{m}\cdot(\delta\boldsymbol{\psi}_k\times\mathbf{b})" if turn else ""
    force = r"\mathbf{f}\cdot\delta\mathbf{t}"
    row = " + ".join(part for part in (force, moment) if part)
    parts = []
    if travel:
        parts.append(
            r"\delta\boldsymbol{\psi}_k\times\mathbf{z}_k"
            if travel == 1
            else f"{travel}\\,\\delta\\boldsymbol{{\\psi}}_k\\times\\mathbf{{z}}_k"
        )
    if turn:
        parts.append(
            r"(\delta\boldsymbol{\psi}_k\times\mathbf{b})\times\mathbf{s} +"
            r" \mathbf{b}\times(\delta\boldsymbol{\psi}_l\times\mathbf{s})"
        )
    change = r"\delta\mathbf{d} = \delta\mathbf{r}_l - \delta\mathbf{r}_k"
    return (
        "\\delta\\mathbf{r}_k:\\quad \\mathbf{0} \\\\ \\delta\\boldsymbol{\\psi}_k:\\quad"
        f" \\delta\\mathbf{{d}}\\times\\mathbf{{f}} \\\\ \\delta c:\\quad {row} \\\\ {change} \\\\ \\delta\\mathbf{{t}} ="
        f" {' + '.join(parts) or chr(92) + 'mathbf{0}'}"
    )


# ---- checks ------------------------------------------------------------------------------------------------------------


def reduction(twist: tuple[int, int], z: Any, d: Any, s: Any) -> Any:
    """B (6, 7) as displayed."""
    b = twist[1] * z
    B = np.zeros((6, 7), dtype=np.result_type(z, d, s))
    B[:3, :3] = B[3:, 3:6] = np.eye(3)
    B[:3, 3:6] = -skew(d)
    B[:3, 6], B[3:, 6] = twist[0] * z + np.cross(b, s), b
    return B


def bias(twist: tuple[int, int], z: Any, d: Any, s: Any, w: Any, rate: Any) -> Any:
    """(a0, alpha0) as displayed."""
    travel, turn = twist
    alpha = turn * rate * np.cross(w, z)
    wl = w + turn * rate * z
    a = np.cross(w, np.cross(w, d - s)) + 2 * travel * rate * np.cross(w, z) + np.cross(alpha, s) + np.cross(wl, np.cross(wl, s))
    return np.concatenate([a, alpha])


def _transformed(twist: tuple[int, int]) -> list[Check]:
    """Stiffness and damping of a random residual at l, by complex step through the finite motion, against the formulas."""
    rng, worst = np.random.default_rng(5), np.zeros(3)
    for _ in range(POINTS):
        case = _Case(rng, twist)
        worst = np.maximum(worst, case.errors())
    names = ("transformed damping", "transformed stiffness with its geometric row", "transformed mass")
    kind = "turning" if twist[1] else "sliding"
    return [
        Check(f"{name} of a {kind} joint, with a complex step through the motion", float(e))
        for name, e in zip(names, worst, strict=True)
    ]


class _Case:
    """A linear residual r = M a + C v + K x + r0 at l, transformed by the joint."""

    def __init__(self, rng: Any, twist: tuple[int, int]) -> None:
        self.twist = twist
        self.M, self.C, self.K = (rng.normal(size=(6, 6)) for _ in range(3))
        self.r0, self.w, self.wp = rng.normal(size=6), rng.normal(size=7), rng.normal(size=7)
        self.z = rng.normal(size=3)
        self.z /= np.linalg.norm(self.z)
        self.arm, self.s = rng.normal(size=(2, 3))

    def residual(self, dq: Any, w: Any, wp: Any) -> tuple[Any, Any]:
        """(B^T r, r) after virtual displacements dq (to first order) at velocities and accelerations of the unknowns."""
        travel, turn = self.twist
        psi, c = dq[3:6], dq[6]
        z = self.z + np.cross(psi, self.z)
        psi_l = psi + turn * c * self.z
        s = self.s + np.cross(psi_l, self.s)
        d = self.arm + np.cross(psi, self.arm) + travel * c * self.z + s
        B = reduction(self.twist, z, d, s)
        x = np.concatenate([dq[:3] + d - self.arm - self.s, psi_l])
        r = self.M @ (B @ wp + bias(self.twist, z, d, s, w[3:6], w[6])) + self.C @ (B @ w) + self.K @ x + self.r0
        return B.T @ r, r

    def errors(self) -> Any:
        """Relative errors of damping, stiffness and mass."""
        zero = np.zeros(7)
        B = reduction(self.twist, self.z, self.arm + self.s, self.s)
        _, r = self.residual(zero, self.w, self.wp)
        steps = 1j * STEP * np.eye(7)
        C = np.array([self.residual(zero, self.w + e, self.wp)[0].imag for e in steps]).T / STEP
        K = np.array([self.residual(e, self.w, self.wp)[0].imag for e in steps]).T / STEP
        M = np.array([self.residual(zero, self.w, self.wp + e)[0].imag for e in steps]).T / STEP
        formulas = [np.array(column).T for column in zip(*(self.columns(B, r, e) for e in np.eye(7)), strict=True)]
        return np.array([np.max(np.abs(a - b)) / max(1.0, np.max(np.abs(b))) for a, b in zip(formulas, (C, K, M), strict=True)])

    def columns(self, B: Any, r: Any, e: Any) -> tuple[Any, Any, Any]:
        """Columns of the displayed damping, stiffness and mass along a unit displacement e."""
        travel, turn = self.twist
        w, rate, z, s, d = self.w[3:6], self.w[6], self.z, self.s, self.arm + self.s
        da0 = np.imag(bias(self.twist, z, d, s, w + 1j * STEP * e[3:6], rate + 1j * STEP * e[6])) / STEP
        C = B.T @ (self.C @ B @ e + self.M @ da0)
        psi, psi_l = e[3:6], e[3:6] + turn * e[6] * z
        dz, ds = np.cross(psi, z), np.cross(psi_l, s)
        dd = np.cross(psi, self.arm) + travel * e[6] * z + ds
        dt = travel * dz + turn * (np.cross(dz, s) + np.cross(z, ds))
        dB = np.zeros((6, 7))
        dB[:3, 3:6], dB[:3, 6], dB[3:, 6] = -skew(dd), dt, turn * dz
        changed = 1j * STEP
        dbias = np.imag(bias(self.twist, z + changed * dz, d + changed * dd, s + changed * ds, w, rate)) / STEP
        geometric = np.concatenate([np.zeros(3), np.cross(dd, r[:3]), [r[:3] @ dt + r[3:] @ (turn * dz)]])
        K = B.T @ (self.K @ B @ e + self.C @ (dB @ self.w) + self.M @ (dB @ self.wp + dbias)) + geometric
        return C, K, B.T @ self.M @ B @ e


def _against_tree(law: type[Joint], twist: tuple[int, int]) -> list[Check]:
    """B against the velocity map of the compiled program of a tree of two bodies, the first free."""
    at, axis, centre = np.array([0.3, -0.2, 0.5]), np.array([0.36, 0.48, 0.8]), np.array([0.7, 0.4, 1.1])
    scene = SceneData("pair", space="spatial")
    first = scene.rigid_body("k", 1.0, (1.0, 1.2, 1.4), at=(0, 0, 0))
    second = scene.rigid_body("l", 1.0, (1.0, 1.2, 1.4), at=centre)
    (scene.revolute if twist[1] else scene.prismatic)("joint", first, second, at=at, axis=axis, model=Recursive())
    p = prepare(scene)
    rng, worst = np.random.default_rng(4), 0.0
    k, l = (p.model.node(b) for b in (first, second))
    assert k is not None
    assert l is not None
    for _ in range(5):
        q = np.zeros((1, p.all_bodies.nq))
        full = p.start.q.copy()
        full[k.q : k.q + 3] = rng.normal(size=3)
        full[k.q + 3 : k.q + 7] = rng.normal(size=4)
        q, u = p.all_bodies.reduced(full[None], np.zeros((1, p.model.nu)))
        q[:, -1] = c = rng.uniform(-1, 1)
        W = p.all_bodies.workspace(np.zeros(1), q, u)
        T = p.all_bodies.velocity_map(W)[0]
        states, _ = p.all_bodies.states(np.zeros(1), np.hstack([q, u]))
        Rk, Rl = (rotation_matrices(states[0, n.q + 3 : n.q + 7]) for n in (k, l))
        z = Rk @ axis
        d = states[0, l.q : l.q + 3] - states[0, k.q : k.q + 3]
        s = Rl @ (centre - at) if twist[1] else d - Rk @ at - c * z
        B = reduction(twist, z, d, s)
        J = T[l.u : l.u + 6]
        J[3:] = Rl @ J[3:]
        J[:, 3:6] = J[:, 3:6] @ Rk.T
        worst = max(worst, float(np.max(np.abs(J - B))))
    return [Check(f"reduction map of {law.__name__}, with the compiled program of a tree", worst)]
