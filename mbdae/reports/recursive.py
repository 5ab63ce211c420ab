"""Recursive joints: the coordinates are the only unknowns of the outer body l; reduction map and transformed matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mbdae.documents.blocks import Block, Equation, Paragraph, Section, Table
from mbdae.documents.document import Document
from mbdae.errors import LawError
from mbdae.laws.joints import Prismatic, Revolute
from mbdae.reports.common import Check, checks_table, joined, title_of
from mbdae.reports.coordinates import chain
from mbdae.reports.joint_checks import JointChecks
from mbdae.reports.recursive_checks import reduction_checks
from mbdae.reports.reduction import Reduction
from mbdae.reports.statement import derived, structure_of
from mbdae.reports.states import POINTS
from mbdae.symbolic.fingerprint import fingerprint
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Structure

FURTHER = [
    [r"$\mathbf{d}$", "m", "from the centre of k to the centre of l"],
    [r"$\mathbf{b},\ \mathbf{t}$", "", "rotation of l and displacement of its centre per unit of a coordinate"],
    [r"$\delta c$", "", "virtual changes of all coordinates"],
    [r"$\mathbf{r} = (\mathbf{f}, \mathbf{m})$", "N, N m", "total residual assembled at the centre of l, left-hand side"],
    [r"$\mathbf{w}$", "", r"velocities $(\dot{\mathbf{c}}_k, \boldsymbol{\omega}_k, \dot c)$ of the unknowns"],
    [r"$\mathbf{M}, \mathbf{C}, \mathbf{K}$", "", "its derivatives by accelerations, velocities and virtual displacements"],
    [r"$\tilde{\mathbf{a}}$", "", r"matrix of the vector product: $\tilde{\mathbf{a}}\,\mathbf{b} = \mathbf{a}\times\mathbf{b}$"],
]
TRANSFORMED = (
    r"\bar{\mathbf{C}} = \mathbf{B}^{\mathsf{T}}\left(\mathbf{C}\,\mathbf{B} +"
    r" \mathbf{M}\,\frac{\partial}{\partial\mathbf{w}}"
    r"\begin{bmatrix} \mathbf{a}_0 \\ \boldsymbol{\alpha}_0 \end{bmatrix}\right) \\ "
    r"\bar{\mathbf{K}}\,\delta\mathbf{q} = \mathbf{B}^{\mathsf{T}}\left(\mathbf{K}\,\mathbf{B}\,\delta\mathbf{q} +"
    r" \mathbf{C}\,\delta(\mathbf{B}\mathbf{w}) "
    r"+ \mathbf{M}\,\delta(\mathbf{B}\dot{\mathbf{w}} + \mathbf{a}_0, \boldsymbol{\alpha}_0)\right) +"
    r" \delta\mathbf{B}^{\mathsf{T}}\,\mathbf{r}"
)


def recursive_sections(r: JointChecks) -> list[Section]:
    """The section on a joint as a recursive one; none for a joint that states no motion of l relative to k."""
    if not (isinstance(r.s.law, Joint) and r.s.law.states_motion() and r.s.sides == ("k", "l")):
        return []
    found = sections(type(r.s.law), r.s.structure, r.formulas.checks)
    return [Section("As a recursive joint", found)]


def recursive_report(laws: tuple[type[Joint], ...] = (Revolute, Prismatic), options: Mapping[str, Any] | None = None) -> Document:
    """The report of recursive joints, each with its own sections. options: those of the laws."""
    checks: list[Check] = []
    blocks: list[Block] = [
        Paragraph(
            "A recursive joint has no rows and no multipliers: its coordinates are the only unknowns of body l, whose state"
            " follows from that of k by the motion that the joint states; the rows of the joint with its coordinates as unknowns"
            " name the reactions. Elements, forces and contacts on l stay what they are: their residual is transformed. The same"
            " section of any other joint: `mb.report(MyJoint, model=mb.Recursive())`."
        )
    ]
    shapes = {law: structure_of(law, dict(options or {}) | {"kept": True}) for law in laws}
    for law, shape in shapes.items():
        if not law.states_motion() or law.frames != ("k", "l"):
            raise LawError(f"{law.__name__} states no motion of l relative to k: without motion(self, from_k) no recursion")
        blocks.append(Section(f"{title_of(law)} joint", sections(law, shape, checks)))
    title = "Recursive joint" if len(laws) > 1 else f"{title_of(laws[0])} joint, recursive"
    return Document(title, [*blocks, Section("Numeric check", checks_table(checks, POINTS)), _origin(shapes)])


def _origin(shapes: Mapping[type[Joint], Structure]) -> Section:
    rows = [[f"`{law.__name__}`", f"`{fingerprint(derived(law, shape))[:32]}…`"] for law, shape in shapes.items()]
    text = "Motions are read from the laws that are integrated; the sha256 is that of their rows, which name the reactions."
    return Section("Origin", [Paragraph(text), Table(["law", "sha256"], rows)])


def sections(law: type[Joint], structure: Structure, checks: list[Check]) -> list[Block]:
    """Motion, map, transformed residual and matrices of one joint."""
    r = Reduction(law, structure)
    checks += reduction_checks(r)
    blocks = [
        *chain(r.motion, r.formulas, list(law.coordinates)),
        Paragraph("Reduction map, displacement and velocity of the centre of l from those of k and of the coordinates:"),
        Equation(_map(len(r.columns))),
        *_columns(r),
        Paragraph("Accelerations follow with the rate of the map:"),
        *_bias(r),
        Paragraph(
            "The residual assembled at l, and its mass, are transformed to k and to the equations of the coordinates by the"
            " transpose; a spring, damper or load of a coordinate adds to its equation:"
        ),
        Equation(
            r"\bar{\mathbf{r}} = \mathbf{B}^{\mathsf{T}}\mathbf{r} \\ "
            r"\bar{\mathbf{M}} = \mathbf{B}^{\mathsf{T}}\mathbf{M}\,\mathbf{B}"
        ),
        Paragraph("Damping and stiffness, $\\delta\\mathbf{w} = \\mathbf{0}$ in the stiffness:"),
        Equation(TRANSFORMED),
        Paragraph("The last term is the geometric stiffness; it needs the total residual, not a part of it. Its rows:"),
        *_geometric(r),
    ]
    stated = r.formulas.symbols()
    return [Table(stated.head, [*stated.rows, *FURTHER]), *blocks]


def _map(columns: int) -> str:
    each = [[rf"\mathbf{{{letter}}}" + (f"_{{{i + 1}}}" if columns > 1 else "") for i in range(columns)] for letter in "tb"]
    last = [f" & {' & '.join(row)}" if row else "" for row in each]
    unknowns = r"\delta\mathbf{c}_k \\ \delta\boldsymbol{\psi}_k" + (r" \\ \delta c" if columns else "")
    return (
        r"\begin{bmatrix} \delta\mathbf{c}_l \\ \delta\boldsymbol{\psi}_l \end{bmatrix} = \mathbf{B} \begin{bmatrix} "
        rf"{unknowns} \end{{bmatrix}} \\ \mathbf{{B}} = \begin{{bmatrix}} \mathbf{{1}} & -\tilde{{\mathbf{{d}}}}{last[0]} \\ "
        rf"\mathbf{{0}} & \mathbf{{1}}{last[1]} \end{{bmatrix}}"
    )


def _columns(r: Reduction) -> list[Block]:
    """d and the columns of the coordinates, with the angular velocity of l they give."""
    w, mark, record = r.formulas.writer, r.formulas.mark(), r.s.record
    lines = [rf"\mathbf{{d}} = {w.vector(record.defined(r.d))}"]
    for i, c in enumerate(r.columns):
        below = f"_{{{i + 1}}}" if len(r.columns) > 1 else ""
        for letter, a in (("b", c.turn), ("t", c.move)):
            lines.append(rf"\mathbf{{{letter}}}{below} = {w.vector(record.defined(a))}")
    total = sum((c.turn * c.rate for c in r.columns), record.atom("w", "k"))
    lines.append(rf"\boldsymbol{{\omega}}_l = {w.vector(total)}")
    own = {number for a in (r.d, *(a for c in r.columns for a in c.vectors)) for number in record.numbers(a)}
    named = r.formulas.explained((mark[0], mark[1] | own))
    w.vectors |= own
    return [Equation(joined(lines)), *named]


def _bias(r: Reduction) -> list[Block]:
    """The accelerations of l where those of the unknowns are zero."""
    w, mark = r.formulas.writer, r.formulas.mark()
    a0, alpha0 = r.bias
    r.formulas.refresh()
    unknowns = r"\ddot{\mathbf{c}}_k \\ \dot{\boldsymbol{\omega}}_k" + (r" \\ \ddot c" if r.columns else "")
    text = (
        r"\begin{bmatrix} \ddot{\mathbf{c}}_l \\ \dot{\boldsymbol{\omega}}_l \end{bmatrix} = \mathbf{B} \begin{bmatrix} "
        rf"{unknowns} \end{{bmatrix}} + \begin{{bmatrix}} \mathbf{{a}}_0 \\ \boldsymbol{{\alpha}}_0 \end{{bmatrix}}"
    )
    lines = [text, rf"\boldsymbol{{\alpha}}_0 = {w.vector(alpha0)}", rf"\mathbf{{a}}_0 = {w.vector(a0)}"]
    return [Equation(joined(lines)), *r.formulas.explained(mark)]


def _geometric(r: Reduction) -> list[Block]:
    """The change of B^T r at constant r, row by row."""
    w, mark = r.formulas.writer, r.formulas.mark()
    change, columns = r.changes
    r.formulas.refresh()
    lines = [r"\delta\mathbf{c}_k:\quad \mathbf{0}", r"\delta\boldsymbol{\psi}_k:\quad \delta\mathbf{d}\times\mathbf{f}"]
    for c, (move, turn) in zip(r.columns, columns, strict=True):
        parts = [rf"\mathbf{{{letter}}}\cdot\left({w.vector(a)}\right)" for letter, a in (("f", move), ("m", turn)) if a.terms]
        lines.append(f"{w.scalar(c.change)}:\\quad {' + '.join(parts) or '0'}")
    lines.append(rf"\delta\mathbf{{d}} = {w.vector(r.s.record.defined(change))}")
    turned = sum((c.turn * c.change for c in r.columns), r.s.record.atom("dpsi", "k"))
    lines.append(rf"\delta\boldsymbol{{\psi}}_l = {w.vector(turned)}")
    own = r.s.record.numbers(change)
    named = r.formulas.explained((mark[0], mark[1] | own))
    return [Equation(joined(lines)), *named]
