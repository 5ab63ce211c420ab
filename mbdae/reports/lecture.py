"""A joint as it is taught: one statement with its names inline, what follows where the joint holds, and an example in numbers.

The formulas are those of the full report. Relations of the joint make them short: a vector that is one of the axes wherever the
joint holds is written as that axis. They are read back at states on the joint, whose velocities are free, so that the Jacobian
is compared with rates that do not vanish."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.documents import Document
from mbdae.documents.blocks import Block, Paragraph, Section, Table, numbered
from mbdae.reports.law_page import LawPage
from mbdae.reports.letters import effort_unit, unit_text, worded
from mbdae.reports.page import BOTH, DERIVED, KERNEL, below, described, document, effort, made_from
from mbdae.reports.recursive_page import matrix
from mbdae.reports.recursive_values import TREE, RecursiveValues
from mbdae.reports.sections import ANGLE, LENGTH, figure_of, plus, title_of_joint
from mbdae.reports.statement import ReportedLaw
from mbdae.reports.states import POINTS, FormulaValues, SymbolValues, random_state
from mbdae.reports.vectors import Base, Vector
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Structure
from mbdae.symbolic.motion import symbolic_motion
from mbdae.symbolic.outputs import dynamics, fingerprint, position, velocity

ALL = r"{\text{xyz}}"  #: subscript of three rows along the inertial axes, written as one vector
LOAD, ARM = (0.0, -8.0, -6.0), 0.5  #: of the example: a force, N, and its distance from the point of the joint, m
ROUND = 1e-12


class Stated(LawPage):
    """The rows of a joint, three along the inertial axes as one vector. vector: that vector, None where there is none."""

    def __init__(self, s: ReportedLaw, **options: Any) -> None:
        super().__init__(s, **options)
        self.kernel = self.compiled(lambda d: [*position(d), *velocity(d), *dynamics(d)])
        found = [self.s.record.dots.get(e, (None, None)) for e in list(self.s.rows.values())[:3]]
        along = [Base("E", axis) for axis in "xyz"] == [b for _, b in found] and len({a for a, _ in found}) == 1
        self.vector = self.s.record.zero() + Vector(s.record, {found[0][0]: se.Integer(1)}) if along else None  # type: ignore[dict-item]
        self.single = [row for row in s.rows if not along or row not in list(s.rows)[:3]]

    def rows(self, head: str, together: bool = True) -> list[tuple[str, Any]]:
        """Letters and values of the rows (head "g") or of their rates ("gd"); together: three along inertial axes as one."""
        values = {row: np.broadcast_to(self.kernel.get((head, i), 0.0), (POINTS,)) for i, row in enumerate(self.d.rows)}
        dot, vector = (r"\dot ", r"\dot{\mathbf{c}}") if head == "gd" else ("", r"\mathbf{c}")
        three = [values[row] for row in self.s.rows if row not in self.single] if together else []
        first = [(f"{vector}_{ALL}", np.stack(three, -1))] if three else []
        return [*first, *((f"{dot}c_{below(row)}", values[row]) for row in (self.single if together else self.s.rows))]

    def constraint(self) -> list[Block]:
        """The coordinates as the frames show them, and the rows."""
        specs, out = self.s.law.coordinates, list[Block]()
        lines = [self.line(self.known[name].latex, e, self.state.scalar(self.d.coordinates[name]), DERIVED)
                 for name, e in self.s.read.items()]
        if lines:
            out.append(self.section("Coordinates", "They are read from the axes of the bodies:", *lines))
        elif specs:
            said = "; ".join(f"${self.known[n].latex}$: {worded(spec.meaning)}" for n, spec in specs.items())
            out.append(Section("Coordinates", [Paragraph(f"{said}.")]))
        self.writer.used |= {str(self.s.coordinates.get(name, name)) for name in specs}
        lines = []
        for (latex, values), e in zip(self.rows("g"), [*([self.vector] if self.vector else []),
                                                       *(self.s.rows[row] for row in self.single)], strict=True):
            unit = self.unit(self.s.rows[self.single[-1]] if not isinstance(e, Vector) else next(iter(self.s.rows.values())))
            lines.append(self.line(latex, e, values, KERNEL, unit) + (r" = \mathbf{0}" if isinstance(e, Vector) else " = 0"))
        return [*out, Section("Statement", self.lines(*lines) or [Paragraph("The joint holds nothing.")])]


class Relations(RecursiveValues):
    """What holds on a joint: axes and angular velocity of l by those of k."""

    def blocks(self) -> list[Block]:
        """Axes of l, its place and its angular velocity."""
        t, lines = self.tree, list[str]()
        if not self.s.turning:
            reached = t.reached or [self.s.record.atom(name, "k") for name in "xyz"]
            lines += [self.line(rf"\mathbf{{{name}}}_l", a, self.state.atom(Base(name, "l")), TREE)
                      for name, a in zip("xyz", reached, strict=True)]
            self.writer.bases |= {Base(name, "l") for name in "xyz"}
        moved = t.l.r + self.s.record.atom("s", "l")
        point = self.s.record.lift(moved - (self.s.record.atom("c", "k") + self.s.record.atom("s", "k")))
        if point.terms:  # where it vanishes, the statement says so
            self.wanted[r"\mathbf{r}_l - \mathbf{r}_k"] = BOTH
            lines.append(f"\\mathbf{{r}}_l - \\mathbf{{r}}_k = {self.writer.vector(point)}")
        self.writer.bases |= {Base("r", "k"), Base("r", "l"), Base("w", "l")}
        lines.append(self.line(r"\boldsymbol{\omega}_l", self.s.record.lift(t.spins[0]), self.state.atom(Base("w", "l")), TREE))
        return self.lines(*lines)

    def at(self, given: dict[str, Any]) -> SymbolValues:
        """A state of k and of the coordinates with l where the compiled program of the tree takes it."""
        found = self.run(self.plan.forward, state=SymbolValues(self.state.d, given))
        names = [f"l_{n}" for n in ("r1", "r2", "r3", "P1", "P2", "P3", "P4", "v1", "v2", "v3", "W1", "W2", "W3")]
        places = [("q", i) for i in range(7)] + [("u", i) for i in range(6)]
        moved = {n: np.broadcast_to(found[head, 1, i], (POINTS,)) for n, (head, i) in zip(names, places, strict=True)}
        return SymbolValues(self.state.d, given | moved)

    def columns(self, state: SymbolValues) -> list[tuple[str, str, NDArray[Any], NDArray[Any]]]:
        """Of every freedom of the joint: its letter, unit of its force, velocity of the point of l and angular velocity of l at
        rate 1, (points, 3)."""
        rates = {str(self.s.clock[c]): (self.known[name].latex, effort_unit(self.known[name].unit))
                 for name, c in self.s.coordinates.items()}
        rates |= {f"{side}_W{i + 1}": (rf"\mathbf{{{'xyz'[i]}}}_l", "N m") for side in self.s.turning.values() for i in range(3)}
        still = {name: np.zeros(POINTS) for name in [*(f"k_{n}{i}" for n in "vW" for i in "123"), *rates]}
        moved = [(said, self.at(state.given | still | {rate: np.ones(POINTS)})) for rate, said in rates.items()]
        return [(*said, found.atom(Base("v", "l")), found.atom(Base("w", "l"))) for said, found in moved]


class Forces(Stated):
    """Forces and Jacobian of a joint where it holds."""

    def __init__(self, s: ReportedLaw, relations: Relations, others: frozenset[str]) -> None:
        held = {name: v for name, v in relations.state.given.items() if name[:2] in ("k_", "l_")}
        free = random_state(s.derived, seed=12).given
        moving = [f"l_{n}{i}" for n in "vW" for i in "123"]
        own = {str(c): relations.state.given[str(relations.s.coordinates[name])] for name, c in s.coordinates.items()}
        given = free | {n: v for n, v in held.items() if n in free} | {n: free[n] for n in moving} | own
        given |= {name: v for name, v in relations.state.given.items() if name in s.law.params}
        super().__init__(s, others=others, state=SymbolValues(s.derived, given))
        self.relations, self.further = relations, dict[str, Any]()
        self.values = self.numbers()

    def given(self) -> dict[str, Any]:
        return super().given() | self.further

    def short(self, a: Vector) -> Vector:
        """A vector as one of the axes, where it is that wherever the joint holds."""
        value = self.values.vector(a)
        if float(np.max(np.abs(value))) < ROUND:
            return self.s.record.zero()
        if len(a.terms) == 1 and all(isinstance(atom, Base) for atom in a.terms):
            return a
        for side in "kl":
            for axis in "xyz":
                got, (size,) = self.state.atom(Base(axis, side)), [self.s.record.atom(axis, side)]
                for sign in (1, -1):
                    if float(np.max(np.abs(value - sign * got))) < ROUND:
                        return size * sign
        return a

    def number(self, e: Any) -> Any:
        """A scalar as 1, 0 or -1 where it is that wherever the joint holds."""
        value = np.broadcast_to(self.values.scalar(e), (POINTS,))
        return next((se.Integer(n) for n in (0, 1, -1) if float(np.max(np.abs(value - n))) < ROUND), e)

    def blocks(self) -> list[Block]:
        """Forces and what they mean; the Jacobian."""
        return [Section("Forces", self._forces()), Section("Jacobian", self._jacobian())] if self.s.rows else []

    def _forces(self) -> list[Block]:
        three, lines, w = [row for row in self.s.rows if row not in self.single], list[str](), self.writer
        if three:
            self.further[rf"\boldsymbol{{\lambda}}_{ALL}"] = np.stack([self.state.given[f"lambda_{row}"] for row in three], -1)
        for letter, side, i in self.letters():
            parts = {row: pairs[side][i] for row, (pairs, _) in self.s.gradients.items()}
            first = self.whole([parts[row] for row in three]) if three else ""
            left = self.single if first is not None else list(parts)
            rest = w.vector(sum((self.short(parts[row]) * se.Symbol(f"lambda_{row}") for row in left), self.s.record.zero()))
            text = f"{first}{plus(rest)}" if first else rest
            self.want(letter, self.at_point(side, self.kernel)[i], KERNEL)
            lines.append(f"{letter} = {text}")
        for name, symbol in self.s.coordinates.items():
            partials = {row: self.number(p[symbol]) for row, (_, p) in self.s.gradients.items()}
            along = self.along([partials[row] for row in three])
            left = self.single if along is not None else list(partials)
            text = w.scalar(sum((se.Symbol(f"lambda_{row}") * partials[row] for row in left), se.Integer(0)))
            if along is not None and along.terms:
                minus = w.vector(along).startswith("-")
                product = rf"\boldsymbol{{\lambda}}_{ALL}\cdot \left({w.vector(along * -1 if minus else along)}\right)"
                text = f"{'-' if minus else ''}{product}" if text == "0" else f"{text} {'-' if minus else '+'} {product}"
            unit = effort_unit(self.known[name].unit)
            self.want(effort(name), self.kernel.get(("u", self.s.places[name], 0), 0.0), KERNEL, unit)
            lines.append(f"{effort(name)} = {text}")
        vector = f"; $\\boldsymbol{{\\lambda}}_{ALL}$ (N) is that of $\\mathbf{{c}}_{ALL}$" if three else ""
        own = ", and with $-h$ (N along a displacement, N m about an axis) on its coordinates" if self.s.coordinates else ""
        text = (f"Each row has a multiplier $\\lambda$, the force or moment that holds it{vector}. By the virtual work"
                " $\\sum\\lambda\\,\\delta c$ the joint acts with $-\\mathbf{f}_k$, $-\\mathbf{m}_k$ on k and with"
                f" $-\\mathbf{{f}}_l$, $-\\mathbf{{m}}_l$ on l, at its points{own}:")
        return [*self.told(text, *lines), *self._free()]

    def whole(self, parts: list[Vector]) -> str | None:
        """Three vectors, one a row along the inertial axes, as what they make of the vector of multipliers; "" where they vanish,
        None where they are neither these axes nor their products with the way between the points."""
        letter, way = rf"\boldsymbol{{\lambda}}_{ALL}", self.state.atom(Base("r", "l")) - self.state.atom(Base("r", "k"))
        got = np.stack([self.values.vector(a) + np.zeros((POINTS, 3)) for a in parts], 1)
        axes = np.broadcast_to(np.eye(3), got.shape)
        forms = {"": 0 * axes, letter: axes, f"-{letter}": -axes}
        turned = np.cross(way[:, None, :], axes)
        apart = r"\left(\mathbf{r}_l - \mathbf{r}_k\right)"
        forms |= {rf"{apart}\times {letter}": turned, rf"-{apart}\times {letter}": -turned}
        return next((text for text, form in forms.items() if float(np.max(np.abs(got - form))) < ROUND), None)

    def along(self, parts: list[Any]) -> Vector | None:
        """The vector of which three scalars, one a row along the inertial axes, are the components; None where there is none."""
        found, first = self.s.record.zero(), Base("E", "x")
        for symbol in sorted(se.sympify(parts[0]).free_symbols if parts else (), key=str):
            pair = self.s.record.dots.get(symbol)
            if pair is not None and first in pair:
                other = pair[0] if pair[1] == first else pair[1]
                found = found + Vector(self.s.record, {other: se.diff(parts[0], symbol)})
        got = self.values.vector(found) + np.zeros((POINTS, 3))
        right = all(np.max(np.abs(got[:, i] - self.values.scalar(p))) < ROUND for i, p in enumerate(parts))
        return found if right else None

    def _free(self) -> list[Block]:
        """What the joint cannot hold: along the axes of its coordinates its force or moment vanishes."""
        lines, names = [], []
        own = {self.known[name].latex for name in self.s.law.scalars()} if not self.s.places else set()
        for latex, _, move, turn in (c for c in self.relations.columns(self.relations.state) if c[0] in own):
            letter, value = (r"\mathbf{m}_l", turn) if np.max(np.abs(move)) < ROUND else (r"\mathbf{f}_l", move)
            other = move if value is turn else turn
            axis = next((Base(a, side) for side in "kl" for a in "xyz"
                         if np.max(np.abs(self.state.atom(Base(a, side)) - value)) < ROUND), None)
            if axis is not None and np.max(np.abs(other)) < ROUND:
                line = rf"{letter}\cdot {self.writer.atom(axis)}"
                self.wanted[line] = BOTH
                lines.append(f"{line} = 0")
                names.append(f"${latex}$")
        if not lines:
            return []
        return self.told(f"It does no work along {' and '.join(names)}: there it holds nothing, and springs, drives and loads act"
                         " beside it.", *lines)

    def _jacobian(self) -> list[Block]:
        w, sides = self.writer, [side for side in self.s.record.sides if side not in self.s.still]
        columns = [(side, i) for side in sides for i in (0, 1) if i or side in self.s.sides]
        rows, three = [], [row for row in self.s.rows if row not in self.single]
        letter = rf"\boldsymbol{{\lambda}}_{ALL}"
        signs = [self.whole([self.s.gradients[row][0][side][i] for row in three]) for side, i in columns] if three else []
        short = {"": r"\mathbf{0}", letter: r"\mathbf{1}", f"-{letter}": r"-\mathbf{1}"}
        if together := three and {*signs} <= {*short} and not self.s.coordinates:
            rows.append(" & ".join(short[text] for text in signs if text is not None))
        for row in self.single if together else self.s.rows:
            pairs, partial = self.s.gradients[row]
            cells = ["".join(w.signed(self.short(pairs[side][i]))) + r"^{\mathsf{T}}" for side, i in columns]
            rows.append(" & ".join([*cells, *(w.scalar(self.number(partial[c])) for c in self.s.coordinates.values())]))
        speeds = [w.atom(Base("w" if i else "v", side)) for side, i in columns]
        speeds += [w.scalar(self.s.clock[c]) for c in self.s.coordinates.values()]
        marked = dict(self.rows("gd", bool(together)))
        rates = matrix([*marked])
        if len(marked) == 1:
            value = marked[rates]
            self.want(rates, value[..., None] if value.ndim == 2 else value, KERNEL)
        else:
            self.further |= marked
            self.wanted[rates] = BOTH
        text = ("Rates of the rows where the joint holds, for any velocities of the bodies, by the same factors as the forces"
                + " ($\\mathbf{1}$: the unit matrix)" * bool(together) + ":")
        return self.told(text, rf"\mathbf{{G}} = {matrix(rows)}", rf"{rates} = \mathbf{{G}}\,{matrix(speeds)}")

    def example(self) -> list[Block]:
        """The pose of the figure with a force on l: what holds it."""
        known, law = self.relations.state.given, self.s.law
        given = {n: np.zeros(POINTS) for n in known if n[:2] in ("k_", "l_")}
        given |= {f"{side}_{n}": np.ones(POINTS) for side in "kl" for n in ("Qx1", "Qy2", "Qz3")}
        poses = [str(s) for f in self.relations.state.d.frames for s in f.q]
        for f in self.relations.state.d.frames:
            for i, s in enumerate(f.q[-4:] if f.kind.by_quaternion else []):
                given[str(s)] = np.full(POINTS, 1.0 if i == 0 else 0.0)
        scalars = law.scalars()
        moved = {str(x) for step in getattr(symbolic_motion(law), "steps", ()) for x in step.amount.free_symbols}
        numbers = {name: ANGLE if spec.unit == "rad" else LENGTH for name, spec in scalars.items()}
        given |= {str(c): np.full(POINTS, numbers[name]) for name, c in self.relations.s.coordinates.items()}
        state = self.relations.at({n: v for n, v in known.items() if n not in given and n not in poses} | given
                                  | {n: np.ones(POINTS) for n in law.params if n in known})
        own = {str(c): str(self.relations.s.coordinates[name]) for name, c in self.s.coordinates.items()}
        n = FormulaValues(self.s.record, state.atom, lambda symbol: state.symbol(own.get(symbol, symbol)))
        G = _on_l(n, self.s.gradients.values())
        arm = ARM * state.atom(Base("x", "l"))[0]
        load = np.concatenate([force := np.array(LOAD), np.cross(arm, force)])
        columns = self.relations.columns(state)
        A = np.array([np.concatenate([move[0], turn[0]]) for _, _, move, turn in columns]).reshape(-1, 6)
        efforts = -A @ load
        held = np.zeros((len(A), 6))  # what holds coordinates that are unknowns acts on l by the rows
        if not self.s.values:
            held = A if _inverse(A, A) else _on_l(n, map(self.s.gradient, self.s.read.values()))
            if not _inverse(held, A):
                return []
        lam, *_ = np.linalg.lstsq(G.T, on_rows := load + held.T @ efforts, rcond=None)
        if np.max(np.abs(G.T @ lam - on_rows)) > 1e-9:
            return []
        lam = dict(zip(self.s.rows, np.where(np.abs(lam) < 1e-9, 0.0, lam), strict=True))
        three = [f"{v:.4g}" for row, v in lam.items() if row not in self.single]
        rows = [[f"$\\boldsymbol{{\\lambda}}_{ALL}$", f"({', '.join(three)})", "N"]] * bool(three)
        rows += [[f"$\\lambda_{below(row)}$", f"{lam[row]:.4g}", unit_text(self.effort(self.s.rows[row]))] for row in self.single]
        rows += [[f"held along ${latex}$" if unit == "N" else f"held about ${latex}$", f"{v + 0.0:.4g}", unit]
                 for (latex, unit, _, _), v in zip(columns, efforts, strict=False)]
        posed = ", ".join(f"${self.known[name].latex} = {v:g}$ {spec.unit}" for name, v, spec in
                          [*((name, v, scalars[name]) for name, v in numbers.items()),
                           *((name, 1.0, spec) for name, spec in law.params.items() if name in moved)])
        text = (f"As in the figure, with the axes of k along the inertial ones{' and ' * bool(posed)}{posed}: the force"
                f" $-8\\,\\mathbf{{i}}_y - 6\\,\\mathbf{{i}}_z$ (N) acts on l, {ARM:g} m along $\\mathbf{{x}}_l$ from the point"
                " of the joint, and everything rests. From the balance of l, by the compiled rows"
                + "; 'held' is what must act from outside along a free coordinate" * (len(efforts) > 0) + ":")
        return [Section("Example", [Paragraph(text), Table(["", "value", "unit"], rows)])]


def _on_l(n: FormulaValues, gradients: Iterable[Any]) -> NDArray[np.float64]:
    """Derivatives by displacement and rotation of l, (rows, 6)."""
    return np.array([np.concatenate([np.broadcast_to(n.vector(part), (POINTS, 3))[0] for part in pairs["l"]])
                     for pairs, _ in gradients])


def _inverse(wrenches: NDArray[np.float64], A: NDArray[np.float64]) -> bool:
    """Whether each wrench acts along one freedom alone, with the power of 1 at rate 1."""
    return wrenches.shape == A.shape and bool(np.max(np.abs(wrenches @ A.T - np.eye(len(A))), initial=0.0) < 1e-9)


def lecture(law: type[Joint], structure: Structure) -> Document:
    """The report of a joint that states its motion, for a lecture."""
    statement = Stated(ReportedLaw(law, structure))
    relations = Relations(law, structure, statement.taken)
    first = statement.constraint()
    forces = Forces(ReportedLaw(law, structure), relations, statement.taken | relations.taken)
    pages: list[tuple[Any, list[Block]]] = [(statement, first), (relations, [Section("On the joint", relations.blocks())]),
                                            (forces, forces.blocks())]
    origin = f"{made_from(law)}; sha256 of its equations `{fingerprint(statement.d)[:32]}…`."
    convention = ("$\\mathbf{x}, \\mathbf{y}, \\mathbf{z}$ are right-handed unit axes fixed to their body; those of k and l"
                  " coincide as drawn. A vector fixed to a body changes by $\\delta\\mathbf{a} ="
                  " \\delta\\boldsymbol{\\psi}\\times\\mathbf{a}$.")
    found = document(title_of_joint(statement.s), [*described(law), *figure_of(statement.s)], pages, convention,
                     [Paragraph(origin)], shared=48.0)
    return taught(found, forces.example() if forces.s.rows else [])


#: sections of a full report that a lecture leaves out
_LEFT_OUT = ("Symbols", "Planar form", "Origin", "Origin of the recursion", "As a recursive joint", "Solution set and branches",
             "Geometric stiffness", "Balance of forces and moments", "Sparsity", "Tangent of the element",
             "Derivatives by the parameters")


def taught(full: Document, further: list[Block]) -> Document:
    """A report without what only a reader of the code needs: every symbol is explained where it appears, checks are one sentence.
    further: blocks after its sections."""
    out: list[Block] = []
    for block in full.blocks:
        if isinstance(block, Section) and block.title == "Numeric check":
            said = next(b.text for b in block.blocks if isinstance(b, Paragraph)).partition("motion of the bodies. ")[2]
            text = "Every numbered equation was read back as it is printed and compared at random states with those integrated."
            out += [*further, Paragraph(f"{text} {'All hold.' if said[:4] == 'All ' else said}")]
        elif isinstance(block, Section) and any(isinstance(b, Section) and b.title == "Numeric check" for b in block.blocks):
            out.append(Section(block.title, taught(Document(block.title, block.blocks), []).blocks, block.level))
        elif getattr(block, "title", "") not in _LEFT_OUT and "Other statements: " not in getattr(block, "text", ""):
            out.append(block)
    return Document(full.title, numbered(out))
