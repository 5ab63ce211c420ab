"""Sections that reports of joints and of forces share: figure, friction and power, planar form."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.documents.blocks import Block, Drawing, Paragraph, Picture, Section, Table
from mbdae.notation import counted
from mbdae.reports.calculus import Pair
from mbdae.reports.law_page import LawPage, planar_of
from mbdae.reports.letters import of_name, specs_of_coordinates, unit_text, worded
from mbdae.reports.page import BALANCE, DERIVED, KERNEL, row_name, title_of
from mbdae.reports.statement import ReportedLaw
from mbdae.reports.states import POINTS, SymbolValues, random_state, value
from mbdae.reports.writer import subscript
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Force
from mbdae.symbolic.motion import AXES, Motion, motion_of, no_rotation
from mbdae.symbolic.outputs import dynamics, lowest
from mbdae.symbolic.vectors import UNIT, Expr

#: rightward and upward direction of the drawing in inertial axes, with z up
VIEW = np.array([[0.86, 0.5, 0.0], [-0.29, 0.5, 0.82]])
ANGLE, LENGTH = 0.6, 0.9  #: values of coordinates in the drawing: angles in rad, displacements in axis lengths
COLOURS = ("#bf5400", "#008060", "#0072b2")


def figure_of(s: ReportedLaw) -> list[Block]:
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


def _pose(s: ReportedLaw) -> tuple[Any, Any, list[str]]:
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
                " opposite acts on k at the same point.")
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
        statement = ReportedLaw(of.s.cls, of.s.structure, planar=True)
        _ = statement.rows
        super().__init__(statement, of.what, others=of.taken)
        self.kernel = self.compiled(lambda d: [*lowest(d), *dynamics(d)])

    def blocks(self) -> list[Block]:
        """Rows that remain in the plane, with their forces and moments."""
        sign, lines = -1 if isinstance(self.s.law, Force) else 1, []
        for i, row in enumerate(self.d.rows):
            letter, e = f"c^{{\\text{{2D}}}}_{{\\text{{{row_name(row)}}}}}", (self.s.rows | self.s.speeds)[row]
            letter = f"\\dot {letter}" if row in self.s.speeds else letter
            lines.append(self.line(letter, e, self.kernel.get(("g", i), 0.0), KERNEL, self.unit(e)))
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


# -- a joint: coordinates and their motion; solution set of the rows, found from random attitudes


def title_of_joint(s: ReportedLaw) -> str:
    """The name of the joint, and whether its coordinates are unknowns."""
    cls = s.cls
    title = title_of(cls) if "oint" in cls.__name__ or not issubclass(cls, Joint) else f"{title_of(cls)} joint"
    if issubclass(cls, Joint) and s.places and not cls.must_keep():
        title += f", {'its coordinate an unknown' if len(s.places) == 1 else 'its coordinates unknowns'}"
    return title


def other_statements(s: ReportedLaw) -> list[Block]:
    """Sentence on how to get reports of the joint with other options."""
    cls = s.cls
    if not issubclass(cls, Joint) or not cls.coordinates:
        return []
    call, said = f"mb.report({cls.__name__}", []
    if not cls.must_keep():
        word = "without" if s.places else "with"
        said.append(f"`{call}, kept={not s.places})` reports the joint {word} its coordinates as unknowns")
        call += ", kept=True" * bool(s.places)
    if s.law.friction is None and cls.scalars():
        said.append(f"`{call}, friction=mb.Coulomb(...))` with friction by its own reaction")
    if any(name in s.rows for name in cls.drives()):
        said.append(f"`{call}, {next(iter(cls.drives()))}=None)` without that prescribed motion")
    return [Paragraph(f"Other statements: {'; '.join(said)}.")] if said else []


def motion_in(s: ReportedLaw) -> Motion | None:
    """Motion of a joint in a statement's symbols; None if the joint states none, or has a free rotation that is no unknown."""
    if not isinstance(s.law, Joint):
        return None
    symbols: dict[str, Any] = {name: s.values.get(name, s.symbol(name)) for name in s.law.coordinates}
    symbols |= {name: s.values.get(name, no_rotation()) for name in s.law.coordinates.keys() - s.law.scalars().keys()}
    return motion_of(s.law, symbols)


def coordinates_section(r: LawPage) -> list[Section]:
    """Section with table of coordinates, elementary motions, and coordinates as functions of the frames; empty without them."""
    specs, motion, blocks = specs_of_coordinates(r.s.law), motion_in(r.s), list[Block]()
    if not specs and motion is None:
        return []
    if specs:
        units = {"rotation": "a quaternion; its rates an angular velocity, rad/s"}
        rows = [[f"`{name}`", f"${r.known[name].latex}$", units.get(spec.unit) or unit_text(spec.unit), worded(spec.meaning)]
                for name, spec in specs.items()]
        if not isinstance(r.s.law, Joint):
            said = "The coordinates are those of joints."
        elif r.s.places:
            said = "The coordinates are unknowns of the equations."
        else:
            said = "The coordinates are no unknowns of the equations: they are read from the frames."
        blocks += [Paragraph(said), Table(["name", "symbol", "unit", "meaning"], rows)]
        r.writer.used |= {str(r.s.coordinates.get(name, name)) for name in specs}
    if motion is not None:
        blocks += chain(motion, r, list(specs))
    if r.s.read:
        lines = [r.line(r.known[name].latex, e, r.state.scalar(r.d.coordinates[name]), DERIVED) for name, e in r.s.read.items()]
        blocks += r.told("The coordinates as the frames show them, whether the rows vanish or not:", *lines)
    return [Section("Coordinates and motion", blocks)]


def chain(motion: Motion, page: LawPage, names: list[str]) -> list[Block]:
    """Table of the elementary motions of a joint, in order."""
    if not motion.steps:
        return [Paragraph("Motion: none, l moves with k.")]
    free, rows = [name for name in names if page.s.law.coordinates[name].unit == "rotation"], []
    for i, step in enumerate(motion.steps, 1):
        if step.rotation is not None:
            rows.append([str(i), "free rotation", "", f"${page.known[free.pop(0)].latex}$"])
        else:
            kind = "rotation about" if step.turns else "displacement along"
            axis = next((name for name, unit in AXES.items() if list(unit) == list(step.axis)), None)
            axis = axis or f"({', '.join(f'{float(c):.6g}' for c in step.axis)})"
            rows.append([str(i), kind, axis, f"${page.writer.scalar(step.amount)}$"])
    text = ("Motion, from the frame of k to that of l: elementary motions one after the other, each along or about an axis of the"
            " frame reached by those before it.")
    return [Paragraph(text), Table(["", "motion", "axis", "amount"], rows)]


# -- solution set of the rows

STARTS = 60  #: number of random attitudes from which the rows are solved


def _moved(r: LawPage) -> list[str]:
    """Rows that depend on the motion of l; the other rows prescribe coordinates that are unknowns."""
    return [row for row in r.s.rows if any(part.terms for part in r.s.gradients[row][0][r.s.sides[1]])]


def _rows(r: LawPage, state: SymbolValues, rows: list[str]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Values (points, rows) of some rows and derivatives (points, rows, 6) by displacement and rotation of l."""
    n, shape, side = r.numbers(state), (state.points, 3), r.s.sides[1]
    c = [np.broadcast_to(n.scalar(r.s.rows[row]), shape[:1]) for row in rows]
    with np.errstate(all="ignore"):
        J = [[np.broadcast_to(n.vector(part), shape) for part in r.s.gradients[row][0][side]] for row in rows]
    return np.stack(c, axis=-1), np.stack([np.concatenate(parts, axis=-1) for parts in J], axis=1)


def solved(r: LawPage, rows: list[str]) -> tuple[SymbolValues, NDArray[Any], NDArray[Any], NDArray[np.bool_]]:
    """Random states with l moved by Gauss-Newton (steps up to 0.7 rad) until some rows vanish: states, rows, derivatives, and
    whether the rows vanish; where a row is undefined l is not moved."""
    state = random_state(r.d, seed=11, points=STARTS, spread=3.0)
    for _ in range(60):
        c, J = _rows(r, state, rows)
        if np.max(np.abs(c)) < 1e-13:
            break
        J[~np.isfinite(J).all(axis=(1, 2))] = 0.0
        step = -np.einsum("pij,pj->pi", np.linalg.pinv(J, rcond=1e-9), c)
        turn = step[:, 3:]
        turn = turn * np.minimum(1.0, 0.7 / np.maximum(np.linalg.norm(turn, axis=1, keepdims=True), 1e-300))
        state = state.changed(1.0, {r.s.sides[1]: (step[:, :3], turn)})
    c, J = _rows(r, state, rows)
    return state, c, J, (np.abs(c) < 1e-9).all(axis=1) & np.isfinite(J).all(axis=(1, 2))


def solution_set(r: LawPage) -> list[Block]:
    """Rank and degrees of freedom on the solution set, and the unwanted solutions of the rows."""
    if not _moved(r):
        return [Paragraph("No row depends on the motion of l.")]
    state, _, J, reached = solved(r, _moved(r))
    blocks, wrong, n = _told(r, J[reached]), np.zeros(STARTS, dtype=bool), r.numbers(state)
    if not r.s.branches:
        return [*blocks, Paragraph("The rows have no unwanted branch.")]
    blocks.append(Paragraph("The rows alone allow the opposite orientation too; on the wanted branch:"))
    for i, (name, e) in enumerate(r.s.branches.items()):
        wrong |= np.broadcast_to(n.scalar(e), (STARTS,)) <= 0
        blocks += r.lines(f"b_{{{i + 1}}} = {r.writer.scalar(e)} > 0", note=name)
    text = f"{int((wrong & reached).sum())} of the {reached.sum()} solutions lie on an unwanted branch; no run starts there."
    return [*blocks, *([Paragraph(text)] if np.any(reached) else [])]


def _told(r: LawPage, J: NDArray[Any]) -> list[Block]:
    """Rank of the Jacobians at the solutions and the remaining motions; or which rows have no solution."""
    moved = _moved(r)
    fixed = [row_name(row) for row in r.s.rows if row not in moved]
    rows = f"The row {fixed[0]} contains" if len(fixed) == 1 else f"The rows {', '.join(fixed)} contain"
    given = f" {rows} no motion of l but coordinates that are unknowns, which keep random values here." if fixed else ""
    if not len(J):
        never = [row_name(row) for row in moved if not np.any(solved(r, [row])[-1])]
        why = f"nowhere does {' or '.join(never)} vanish" if never else "they never vanish together"
        return [Paragraph(f"From none of {STARTS} random attitudes were the rows solved by moving l alone: {why}.{given}")]
    rank = int(np.linalg.matrix_rank(J, tol=1e-7).max())
    count = sum(bool(np.any(np.abs(J[:, i]) > 1e-12)) for i in range(J.shape[1]))
    free, (depend, have) = 6 - rank, ("depends", "has") if count == 1 else ("depend", "have")
    text = (f"The rows were solved from {STARTS} random attitudes of l by moving l alone; {len(J)} reached a solution."
            f" There the {counted(count, 'row')} that {depend} on the motion of l {have} rank {rank}:"
            f" {counted(free, 'relative motion')} of the bodies {'is' if free == 1 else 'are'} left.{given}")
    return [Paragraph(text)]
