"""Sections that reports of joints and of forces share: figure, friction and power, planar form."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Drawing, Paragraph, Picture, Section
from mbdae.reports.calculus import Pair
from mbdae.reports.law_page import LawPage, planar_of
from mbdae.reports.letters import of_name
from mbdae.reports.page import BALANCE, DERIVED, KERNEL, row_name
from mbdae.reports.statement import Statement
from mbdae.reports.states import POINTS, value
from mbdae.reports.writer import subscript
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Force
from mbdae.symbolic.motion import motion_of, no_rotation
from mbdae.symbolic.outputs import dynamics, position
from mbdae.symbolic.vectors import UNIT, Expr

#: rightward and upward direction of the drawing in inertial axes, with z up
VIEW = np.array([[0.86, 0.5, 0.0], [-0.29, 0.5, 0.82]])
ANGLE, LENGTH = 0.6, 0.9  #: values of coordinates in the drawing: angles in rad, displacements in axis lengths
COLOURS = ("#d55e00", "#009e73", "#0072b2")


def figure_of(s: Statement) -> list[Block]:
    """Figure of the two bodies of a law with their frames; empty for a law on other frames."""
    if s.sides != ("k", "l"):
        return []
    moved, axes, drawn = _pose(s)
    apart = np.array([1.0, 1.4, 0.3]) if not isinstance(s.law, Joint) or not s.law.states_motion() else moved
    found = Drawing(460, 300, "the bodies k and l with their frames")
    places = {"k": np.zeros(3), "l": apart}
    middle = VIEW @ (apart / 2)

    def at(point: Any) -> tuple[float, float]:
        x, y = VIEW @ np.asarray(point) - middle
        return 105 * x, -105 * y

    for side, out in (("k", np.array([-1.25, -0.5, -0.75])), ("l", apart + np.array([0.75, 1.3, -0.55]))):
        c, r = at(out), at(places[side])
        around = [(c[0] + 34 * np.cos(t), c[1] + 22 * np.sin(t)) for t in np.linspace(0, 2 * np.pi, 33)]
        found.line(around, "#999", 1, fill="#f2f2f2")
        found.line([c, r], "#999", 1.5, arrow=True)
        found.text((c[0] + r[0]) / 2 + 8, (c[1] + r[1]) / 2 + 14, rf"$\mathbf{{s}}_{side}$")
        found.text(c[0], c[1] + 4, f"body {side}")
    far = float(np.linalg.norm(apart)) > 1e-9
    if far:
        found.line([at(places["k"]), at(places["l"])], "#333", 1, arrow=not isinstance(s.law, Joint))
    same = {side: np.eye(3) if side == "k" else axes for side in "kl"}
    for side, size in (("k", 1.0), ("l", 0.72)):
        for axis, colour in zip(range(3), COLOURS, strict=True):
            end = at(places[side] + size * same[side][:, axis])
            found.line([at(places[side]), end], colour, 2 if side == "k" else 1.3, arrow=True)
            found.text(end[0] + 9, end[1] - (4 if side == "k" else -9), rf"$\mathbf{{{'xyz'[axis]}}}_{side}$", "middle", colour)
    caption = "The frames of k (long) and l (short), fixed to their bodies"
    given = f", drawn at {', '.join(drawn)}" if drawn else ""
    found.fit()
    return [Picture(found, f"{caption}{given}.")]


def _pose(s: Statement) -> tuple[Any, Any, list[str]]:
    """Displacement (3,) and axes (3, 3, in columns) of l, and the values of the coordinates it is drawn at, in words."""
    law, drawn = s.law, list[str]()
    if not isinstance(law, Joint) or not law.states_motion():
        return np.zeros(3), np.eye(3), drawn
    amounts: dict[str, Any] = {name: ANGLE if spec.unit == "rad" else LENGTH for name, spec in law.scalars().items()}
    drawn += [f"${of_name(n, law.coordinates[n].unit)} = {v:g}$ {law.coordinates[n].unit}" for n, v in amounts.items()]
    values = amounts | {name: no_rotation() for name in law.coordinates.keys() - amounts.keys()}
    motion = motion_of(law.symbolic(s.structure), values)
    assert motion is not None
    moved, axes = motion.pose(UNIT)

    def numbers(a: Any) -> Any:
        return np.array([float(np.real(value(c, lambda symbol: 1.0))) for c in a])

    return numbers(moved), np.stack([numbers(a) for a in axes], axis=1), drawn


# -- friction and power


def thrust_blocks(r: LawPage) -> list[Block]:
    """The generalised force of a law, the length or angle on which it acts, and where it appears; empty without one."""
    if r.s.thrust is None:
        return []
    (along, push), unit = r.s.thrust, r.unit(r.s.thrust[0])
    stated = r.d.law.thrust(*r.d.sides) if isinstance(r.d.law, Force) else r.d.rubbing
    values = [r.state.scalar(r.d.variation.resolve(r.d.variation.name(e))) for e in stated or ()]
    lines = [r.line("q", along, values[0], DERIVED, unit), r.line("Q", push, values[1], DERIVED, r.effort(along))]
    own = next((name for name, symbol in r.s.coordinates.items() if symbol == along), "")
    text = "Generalised force $Q$ (N, or N m on an angle) on $q$, with the virtual work $Q\\,\\delta q$"
    where = f"it stands in the equation of the coordinate {own}" if own else "it acts on the bodies by $\\delta q$"
    return r.told(f"{text}; {where}:", *lines)


def resistance_section(r: LawPage) -> list[Section]:
    """Section on friction: force and torque, internal states, sign of the power; empty without friction."""
    s, w, lines, blocks = r.s, r.writer, list[str](), list[Block]()
    if s.wrench is None and s.thrust is None:
        return []
    if s.wrench is not None:
        text = ("The reactions of the joint cause a force $\\mathbf{F}$ on l at its point and a torque $\\mathbf{T}$ on l; the"
                " opposite acts on k at the same point.")  # fmt: skip
        blocks += r.told(text, *(r.line(rf"\mathbf{{{letter}}}", part) for letter, part in zip("FT", s.wrench, strict=True)))
    if s.thrust is not None:
        blocks.append(Paragraph("Friction acts against a coordinate, pressed by the reaction force of the joint on l."))
        blocks += thrust_blocks(r)
    blocks += state_blocks(r)
    for (plain, side, i), (letter, _, _) in zip(r.letters(), r.letters(r"^{\text{all}}"), strict=True):
        r.want(letter, r.at_point(side, r.compiled(dynamics))[i], KERNEL)
        lines.append(f"{letter} = {plain}{plus(w.vector(r.stated_pairs[side][i]))}")
    blocks += r.told("With it the terms of the joint in the equations of motion are:", *lines)
    blocks += [Paragraph("Power on the bodies:"), *power_blocks(r, r.stated_pairs, r.stated_partials)]
    return [Section("Friction", blocks)]


def plus(text: str) -> str:
    """A further term of a sum in LaTeX, with its sign; empty for zero."""
    return "" if text in (r"\mathbf{0}", "0") else f" - {text[1:].lstrip()}" if text.startswith("-") else f" + {text}"


def state_blocks(r: LawPage) -> list[Block]:
    """Equations of the rates and initial values of internal states."""
    lines = []
    for i, name in enumerate(r.d.states):
        latex = r.known[f"state_{name}"].latex
        stated = ("rates", rf"\dot{{{latex}}}", r.d.state_rates), ("initial", rf"{latex}(0)", r.d.state_starts)
        lines += [r.line(symbol, r.s.states(what)[name], r.state.scalar(e[i]), DERIVED) for what, symbol, e in stated]
    return r.lines(*lines)


def power_blocks(r: LawPage, pairs: dict[str, Pair], partials: dict[Expr, Expr]) -> list[Block]:
    """Power of the stated forces on the bodies, which must be minus the dissipated power in the energy balance of a run."""
    record, s, total = r.s.record, r.s, se.Integer(0)
    for side, (move, turn) in pairs.items():
        total -= move @ record.atom("v", side) if side not in s.still and side in s.sides else 0
        total -= turn @ record.atom("w", side) if side not in s.still else 0
    total -= sum((e * s.clock[symbol] for symbol, e in partials.items()), se.Integer(0))
    dissipated = r.state.scalar(r.d.dissipated_power)
    sign = "never positive" if np.all(dissipated >= -1e-12) else "of either sign: internal states store energy and may release it"
    return [*r.lines(r.line("P", total, -dissipated, BALANCE)), Paragraph(f"It is {sign} at {POINTS} random states.")]


# -- planar form

PLANE = (
    "Where all points and motions lie in the plane $z = 0$ and $\\mathbf{z}_k = \\mathbf{z}_l = \\mathbf{i}_z$, rotations and"
    " moments are numbers: $\\boldsymbol{\\omega} = \\omega\\,\\mathbf{i}_z$, $\\mathbf{m} = m\\,\\mathbf{i}_z$."
)


class PlanarPage(LawPage):
    """A law in the plane, stated with the same vectors and compared with the planar kernel."""

    def __init__(self, of: LawPage) -> None:
        statement = Statement(of.s.cls, of.s.structure, planar=True)
        _ = statement.rows
        super().__init__(statement, of.what, others=of.taken)
        self.kernel = self.compiled(lambda d: [*position(d), *dynamics(d)])

    def blocks(self) -> list[Block]:
        """Rows that remain in the plane, with their forces and moments."""
        sign, lines = -1 if isinstance(self.s.law, Force) else 1, []
        for i, row in enumerate(self.d.rows):
            letter = f"c^{{\\text{{2D}}}}_{{\\text{{{row_name(row)}}}}}"
            unit = self.unit(self.s.rows[row])
            lines.append(self.line(letter, self.s.rows[row], self.kernel.get(("g", i), 0.0), KERNEL, unit))
        for side, (force, moment) in self.all_pairs().items():
            if side in self.s.sides and side not in self.s.still:
                values, turning = self.at_point(side, self.kernel), (moment * sign) @ self.s.record.axis(2)
                for letter, e, got in zip((r"\mathbf{f}", "m"), (force * sign, turning), values, strict=True):
                    lines.append(self.line(f"{letter}^{{\\text{{2D}}}}_{subscript(side)}", e, sign * got, KERNEL))
        gone = [row_name(row) for row in self.d.vanished]
        told = f" The rows {', '.join(gone)} vanish identically and are left out." if gone else ""
        return self.told(PLANE + told, *lines)

    def at_point(self, side: str, kernel: dict[Any, Any]) -> tuple[Any, Any]:
        f = self.state.frame(side)
        rows = [np.broadcast_to(kernel.get(("u", side, i), 0.0), (POINTS,)) for i in range(3)]
        force = np.stack([rows[0], rows[1], np.zeros(POINTS)], -1)
        return force, rows[2] - np.cross(self.state.vector(f.arm), force)[:, 2]


def planar_pages(r: LawPage) -> tuple[Derived | None, list[Section], list[tuple[PlanarPage, list[Block]]]]:
    """The law in the plane and its page; or a section that says that it has no planar form."""
    planar, title = planar_of(r.s), "Planar form"
    if planar is None:
        return None, [Section(title, [Paragraph("The law has no planar form.")])], []
    page = PlanarPage(r)
    return planar, [], [(page, [Section(title, page.blocks())])]
