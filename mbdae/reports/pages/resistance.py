"""Forces of a joint that its own reactions cause, such as friction; generalised forces on coordinates."""

from __future__ import annotations

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Paragraph, Section
from mbdae.reports.calculus import Pair
from mbdae.reports.page import DERIVED, KERNEL, LawPage
from mbdae.reports.states import POINTS
from mbdae.symbolic.law import Force
from mbdae.symbolic.outputs import dynamics
from mbdae.symbolic.vectors import Expr


def thrust_blocks(r: LawPage) -> list[Block]:
    """The generalised force of a law, on the length or angle along which it works, and where it appears; none without one."""
    if r.s.thrust is None:
        return []
    (along, push), w = r.s.thrust, r.formulas.writer
    stated = r.d.law.thrust(*r.d.sides) if isinstance(r.d.law, Force) else r.d.rubbing
    for letter, e in zip("qQ", stated or (), strict=False):
        r.want(letter, r.state.scalar(r.d.variation.resolve(r.d.variation.name(e))), DERIVED)
    own = next((name for name, symbol in r.s.coordinates.items() if symbol == along), "")
    text = "Generalised force $Q$ (N, or N m on an angle) on $q$, with the virtual work $Q\\,\\delta q$"
    where = f"it stands in the equation of the coordinate {own}" if own else "it acts on the bodies by $\\delta q$"
    return [Paragraph(f"{text}; {where}:"), *r.formulas.lines(f"q = {w.scalar(along)}", f"Q = {w.scalar(push)}")]


def resistance_section(r: LawPage) -> Section | None:
    """The section on friction: force and torque, internal states, sign of the power; None without friction."""
    s, w = r.s, r.formulas.writer
    if s.wrench is None and s.thrust is None:
        return None
    pairs = r.stated_pairs or {}
    blocks: list[Block] = []
    if s.wrench is not None:
        force, torque = s.wrench
        text = ("The reactions of the joint cause a force $\\mathbf{F}$ on l at its point and a torque $\\mathbf{T}$ on l; the"
                " opposite acts on k at the same point.")  # fmt: skip
        lines = [f"\\mathbf{{F}} = {w.vector(force)}", f"\\mathbf{{T}} = {w.vector(torque)}"]
        blocks += [Paragraph(text), *r.formulas.lines(*lines)]
    if s.thrust is not None:
        text = "Friction acts against a coordinate, pressed by the reaction force of the joint on l."
        blocks += [Paragraph(text), *thrust_blocks(r)]
    blocks += state_blocks(r)
    lines = []
    for letter, side, i in r.letters(r"^{\text{all}}"):
        plain = letter.replace(r"^{\text{all}}", "")
        r.want(letter, r.at_point(side, r.compiled(dynamics))[i], KERNEL)
        lines.append(f"{letter} = {plain}{plus(w.vector(pairs[side][i]))}")
    blocks += [Paragraph("With it the terms of the joint in the equations of motion are:"), *r.formulas.lines(*lines)]
    blocks += [Paragraph("Power on the bodies:"), *power_blocks(r, pairs, r.stated_partials)]
    return Section("Friction", blocks)


def plus(text: str) -> str:
    """A further term of a sum."""
    return "" if text in (r"\mathbf{0}", "0") else f" - {text[1:].lstrip()}" if text.startswith("-") else f" + {text}"


def state_blocks(r: LawPage) -> list[Block]:
    """Rates and start values of internal states."""
    lines = []
    for i, name in enumerate(r.d.states):
        latex = r.formulas.known[f"state_{name}"].latex
        stated = ("rates", rf"\dot{{{latex}}}", r.d.state_rates), ("initial", rf"{latex}(0)", r.d.state_starts)
        for what, symbol, derived in stated:
            r.want(symbol, r.state.scalar(derived[i]), DERIVED)
            lines.append(f"{symbol} = {r.formulas.writer.scalar(r.s.states(what)[name])}")
    return r.formulas.lines(*lines)


def power_blocks(r: LawPage, pairs: dict[str, Pair], partials: dict[Expr, Expr]) -> list[Block]:
    """The power of the stated forces on the bodies, minus what the energy balance of a run counts as dissipated."""
    record, s, total = r.s.record, r.s, se.Integer(0)
    for side, (move, turn) in pairs.items():
        total -= move @ record.atom("v", side) if side not in s.still and side in s.sides else 0
        total -= turn @ record.atom("w", side) if side not in s.still else 0
    total -= sum((e * s.clock[symbol] for symbol, e in partials.items()), se.Integer(0))
    dissipated = np.broadcast_to(r.state.scalar(r.d.dissipated_power), (POINTS,))
    r.want("P", -dissipated, "the energy balance of a run")
    sign = "never positive" if np.all(dissipated >= -1e-12) else "of either sign: internal states store energy and may release it"
    return [*r.formulas.lines(f"P = {r.formulas.writer.scalar(total)}"), Paragraph(f"It is {sign} at {POINTS} random states.")]
