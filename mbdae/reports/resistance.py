"""Forces of a joint that its own reactions cause: friction."""

from __future__ import annotations

import numpy as np

from mbdae.documents.blocks import Block, Equation, Paragraph, Section
from mbdae.reports.joint_checks import JointChecks
from mbdae.reports.states import POINTS
from mbdae.reports.vectors import Base


def resistance_section(r: JointChecks) -> Section | None:
    """The section on friction: force and torque, internal states, sign of the power; None without friction."""
    s, w = r.s, r.formulas.writer
    if s.wrench is None:
        return None
    force, torque = s.wrench
    rates = s.states("rates")
    r.formulas.refresh()
    mark = r.formulas.mark()
    blocks: list[Block] = [
        Paragraph(
            "The reactions of the joint cause a force $\\mathbf{F}$ on l at its point and a torque $\\mathbf{T}$ on l; the"
            " opposite acts on k at the same point."
        ),
        Equation(f"\\mathbf{{F}} = {w.vector(force)} \\\\ \\mathbf{{T}} = {w.vector(torque)}"),
    ]
    for name, rate in rates.items():
        blocks.append(
            Equation(f"\\dot {r.formulas.known[f'state_{name}'].latex} = {w.scalar(rate)}", note="rate of the internal state")
        )
    blocks += r.formulas.explained(mark)
    n, st = r.formulas.numbers(r.state), r.state
    relative = (
        st.atom(Base("v", "l"))
        - st.atom(Base("v", "k"))
        - np.cross(st.atom(Base("w", "k")), st.atom(Base("r", "l")) - st.atom(Base("r", "k")))
    )
    power = np.sum(n.vector(force) * relative + n.vector(torque) * (st.atom(Base("w", "l")) - st.atom(Base("w", "k"))), axis=-1)
    r.check(
        "dissipated power, with the energy balance that is integrated",
        -np.broadcast_to(power, (POINTS,)),
        st.scalar(r.d.dissipated_power),
    )
    sign = "never positive" if np.all(power <= 1e-12) else "of either sign: internal states store energy and may release it"
    blocks.append(
        Paragraph(
            "Power on the bodies $\\mathbf{F}\\cdot(\\mathbf{v}_l - \\mathbf{v}_k -"
            " \\boldsymbol{\\omega}_k\\times(\\mathbf{r}_l - \\mathbf{r}_k)) +"
            f" \\mathbf{{T}}\\cdot(\\boldsymbol{{\\omega}}_l - \\boldsymbol{{\\omega}}_k)$: {sign} at {POINTS} random states."
        )
    )
    return Section("Friction", blocks)
