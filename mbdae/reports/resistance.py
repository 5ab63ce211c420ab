"""Forces of a joint that its own reactions cause, such as friction; generalised forces on coordinates."""

from __future__ import annotations

import numpy as np

from mbdae.documents.blocks import Block, Equation, Paragraph, Section
from mbdae.reports.joint_checks import JointChecks, LawChecks
from mbdae.reports.states import POINTS
from mbdae.reports.vectors import Base


def thrust_blocks(r: LawChecks) -> list[Block]:
    """The generalised force of a law, on the length or angle along which it works, and where it appears; none without one."""
    if r.s.thrust is None:
        return []
    (along, push), w = r.s.thrust, r.formulas.writer
    r.formulas.refresh()
    own = next((name for name, symbol in r.s.coordinates.items() if symbol == along), "")
    text = "Generalised force $Q$ (N, or N m on an angle) on $q$, with the virtual work $Q\\,\\delta q$"
    where = f"it stands in the equation of the coordinate {own}" if own else "it acts on the bodies by $\\delta q$"
    return [Paragraph(f"{text}; {where}:"), Equation(f"q = {w.scalar(along)} \\\\ Q = {w.scalar(push)}")]


def resistance_section(r: JointChecks) -> Section | None:
    """The section on friction: force and torque, internal states, sign of the power; None without friction."""
    s, w = r.s, r.formulas.writer
    if s.wrench is None and s.thrust is None:
        return None
    rates = s.states("rates")
    pairs = r.stated_pairs or {}
    r.formulas.refresh()
    mark = r.formulas.mark()
    blocks: list[Block] = []
    if s.wrench is not None:
        force, torque = s.wrench
        blocks += [
            Paragraph(
                "The reactions of the joint cause a force $\\mathbf{F}$ on l at its point and a torque $\\mathbf{T}$ on l; the"
                " opposite acts on k at the same point."
            ),
            Equation(f"\\mathbf{{F}} = {w.vector(force)} \\\\ \\mathbf{{T}} = {w.vector(torque)}"),
        ]
    if s.thrust is not None:
        text = "Friction acts against a coordinate, pressed by the reaction force of the joint on l."
        blocks += [Paragraph(text), *thrust_blocks(r)]
    for name, rate in rates.items():
        blocks.append(
            Equation(f"\\dot {r.formulas.known[f'state_{name}'].latex} = {w.scalar(rate)}", note="rate of the internal state")
        )
    blocks += r.formulas.explained(mark)
    n, st = r.formulas.numbers(r.state), r.state
    power = sum(
        (-np.sum(n.vector(move) * st.atom(Base("v", side)) + n.vector(turn) * st.atom(Base("w", side)), -1)
         for side, (move, turn) in pairs.items()),
        start=-sum(n.scalar(e) * n.scalar(s.clock[symbol]) for symbol, e in r.stated_partials.items()) + np.zeros(POINTS),
    )  # fmt: skip
    r.check("dissipated power, with the energy balance that is integrated", -power, st.scalar(r.d.dissipated_power))
    sign = "never positive" if np.all(power <= 1e-12) else "of either sign: internal states store energy and may release it"
    works = ["\\mathbf{F}\\cdot(\\mathbf{v}_l - \\mathbf{v}_k - \\boldsymbol{\\omega}_k\\times(\\mathbf{r}_l - \\mathbf{r}_k)) +"
             " \\mathbf{T}\\cdot(\\boldsymbol{\\omega}_l - \\boldsymbol{\\omega}_k)"] * (s.wrench is not None)  # fmt: skip
    works += ["Q\\,\\dot q"] * (s.thrust is not None)
    blocks.append(Paragraph(f"Power on the bodies ${' + '.join(works)}$: {sign} at {POINTS} random states."))
    return Section("Friction", blocks)
