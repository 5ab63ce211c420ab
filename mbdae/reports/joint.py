"""Report of a law stated by constraints: from the rows to forces, rates and geometric stiffness, each step checked."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import LawError
from mbdae.formulations.ggl import ggl_outputs
from mbdae.kernels.plan import plan
from mbdae.reports.book import Book, Check, checks_table, described, joined, provenance, row_name, title_of
from mbdae.reports.branches import solution_set
from mbdae.reports.calculus import Dual, Motion, Pair
from mbdae.reports.document import Block, Document, Equation, Paragraph, Section, Table
from mbdae.reports.letters import multiplier
from mbdae.reports.recursive import recursive_sections
from mbdae.reports.resistance import resistance_section
from mbdae.reports.states import POINTS, State, random_state, residual
from mbdae.reports.statement import Statement, derived
from mbdae.reports.vectors import Base, Vector
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Joint, Structure
from mbdae.symbolic.outputs import acceleration, covector, dynamics, position, velocity
from mbdae.symbolic.vectors import Expr, Vec

STEP = 1e-30
CONVENTION = (
    "Body k carries the frame $\\mathbf{x}_k, \\mathbf{y}_k, \\mathbf{z}_k$, body l the frame $\\mathbf{x}_l, \\mathbf{y}_l, \\mathbf{z}_l$; "
    "both are equal as drawn, right-handed, all vectors are inertial. Coordinates are those of l relative to k, positive about or along "
    "$\\mathbf{z}_k$. A vector $\\mathbf{a}$ fixed to a body changes by $\\delta\\mathbf{a} = \\delta\\boldsymbol{\\psi}\\times\\mathbf{a}$. "
    "Equations of motion read $\\mathbf{M}\\dot{\\mathbf{u}} + \\mathbf{G}^{\\mathsf{T}}\\boldsymbol{\\lambda} + \\ldots - \\mathbf{f} = "
    "\\mathbf{0}$: what is listed as dual to a virtual displacement stands on the left-hand side, the force a body feels is its opposite."
)


class JointReport:
    """The rows of one joint law with everything that follows from them."""

    def __init__(self, law: type[Joint], structure: Structure) -> None:
        self.s = Statement(law, structure)
        _ = self.s.rows, self.s.branches
        self.book = Book(self.s)
        self.d = self.s.derived
        self.state = random_state(self.d)
        self.duals: dict[str, tuple[dict[str, Pair], dict[Expr, Expr]]] = {}
        for name, e in self.s.rows.items():
            self.duals[name] = Dual(self.s.record, symbols=tuple(self.s.coordinates.values())).of(e)
        self.weights = {row: se.Symbol(f"lambda_{row}") for row in self.s.rows}

    # -- checks

    def check(self, what: str, got: Any, wanted: Any) -> None:
        """Compare formula and integrated equation."""
        self.book.checks.append(Check(what, residual(got, wanted)))

    def compiled(self, state: State) -> dict[Any, Any]:
        """Outputs of the compiled kernel (LLVM) at states, by target."""
        p = plan(self.d, report_outputs)
        x = np.stack([state.given[str(symbol)] for symbol in p.all_inputs.symbols], axis=-1)
        return dict(zip(p.targets, p.kernel.values(x).T, strict=True))

    def total(self) -> dict[str, Pair]:
        """G^T lambda on both sides."""
        zero = self.s.record.zero()
        out = {side: (zero, zero) for side in "kl"}
        for row, (pairs, _) in self.duals.items():
            out = {side: (out[side][0] + pairs[side][0] * self.weights[row], out[side][1] + pairs[side][1] * self.weights[row])
                   for side in "kl"}  # fmt: skip
        return out

    @cached_property
    def resisted(self) -> dict[str, Pair] | None:
        """Friction on both bodies, left-hand side, at their points."""
        return resistance_pairs(self.s)

    def run_checks(self, rate: Motion, rates: dict[str, Expr]) -> None:
        """Every displayed formula against the compiled equations."""
        n, kernel = self.book.numbers(self.state), self.compiled(self.state)
        order = list(self.s.rows)
        for target, values in kernel.items():
            if target[0] in ("g", "gd", "gdd"):
                row = self.d.rows[target[1]]
                e = {"g": lambda r=row: self.s.rows[r], "gd": lambda r=row: rates[r], "gdd": lambda r=row: rate.scalar(rates[r])}
                kind = {"g": "constraint", "gd": "rate", "gdd": "second rate"}[target[0]]
                self.check(f"{kind} {row_name(row)}, with the compiled kernel", n.scalar(e[target[0]]()), values)
        stated = self.d.law.branches(*self.d.sides)
        for name, e in self.s.branches.items():
            self.check(f"branch: {name}", n.scalar(e), self.state.scalar(self.d.variation.name(stated[name])))
        missing = [row for row in order if row not in self.d.rows]
        if missing:
            raise LawError(f"row '{missing[0]}' vanishes in space: state it where it does not")
        self._check_forces(n, kernel)
        self._check_motion(rates)

    def _check_forces(self, n: Any, kernel: dict[Any, Any]) -> None:
        stated = self.resisted
        for side, (force, moment) in self.total().items():
            f = self.state.frame(side)
            if stated is not None:
                force, moment = force + stated[side][0], moment + stated[side][1]
            F = np.broadcast_to(n.vector(force), (POINTS, 3))
            M = n.vector(moment) + np.cross(self.state.vector(f.arm), F)
            body = [np.sum(self.state.vector(column) * M, axis=-1) for column in f.body]
            got = [*np.moveaxis(F, -1, 0), *body]
            wanted = [kernel.get(("u", side, i), np.zeros(POINTS)) for i in range(6)]
            self.check(f"force on the side of {side}, with the compiled kernel", got[:3], wanted[:3])
            self.check(f"moment on the side of {side}, in body axes about its centre, with the compiled kernel", got[3:], wanted[3:])
        for name, symbol in self.s.coordinates.items():
            total = sum(self.weights[row] * partial[symbol] for row, (_, partial) in self.duals.items())
            self.check(f"row of {name}, with the compiled kernel", n.scalar(total), kernel[("u", "c", 0)])

    def _check_motion(self, rates: dict[str, Expr]) -> None:
        """dg/dt by moving the bodies (complex step through the quaternions) against G u; the same for forces."""
        st = self.state
        moved = st.changed(1j * STEP, {side: (st.atom(Base("v", side)), st.atom(Base("w", side))) for side in "kl"}, self._clock())
        n, got = self.book.numbers(st), self.book.numbers(moved)
        for row, e in self.s.rows.items():
            change = np.imag(np.broadcast_to(got.scalar(e), (POINTS,))) / STEP
            self.check(f"d/dt of row {row_name(row)} by moving the bodies, with G u", n.scalar(rates[row]), change)
        virtual = {side: (st.atom(Base("du", side)), st.atom(Base("dpsi", side))) for side in "kl"}
        varied, rule = st.changed(1j * STEP, virtual), self.s.variation()
        derived_rows = State(varied.d, varied.given)
        for row, e in self.s.rows.items():
            index = self.d.rows.index(row)
            wanted = np.imag(derived_rows.scalar(self.d.g[index])) / STEP
            self.check(f"variation of row {row_name(row)} by moving the bodies", np.broadcast_to(n.scalar(rule.scalar(e)), (POINTS,)), wanted)
        for side, pair in covectors(self.d).items():
            arm = self.state.frame(side).arm
            for part, what, formula in ((pair[0], "force", self.total()[side][0]), (pair[1], "moment", self.total()[side][1])):
                at_point = part if what == "force" else part - arm.cross(pair[0])
                wanted = np.imag(varied.vector(at_point)) / STEP
                self.check(f"geometric stiffness, {what} on the side of {side}", n.vector(rule.vector(formula)), wanted)

    def _clock(self) -> dict[str, Any]:
        return {str(s): self.state.symbol(str(ds)) for s, ds in self.s.clock.items() if str(s) in self.state.given}

    # -- sections

    def document(self) -> Document:
        """The whole report."""
        rate = self.s.motion()
        rates = {row: rate.scalar(e) for row, e in self.s.rows.items()}
        sections = [self.constraint(), Section("Solution set and branches", solution_set(self)), self.variation(), self.work(),
                    self.forces(), self.body_frame(), self.balance(), self.rates(rate, rates), self.stiffness()]  # fmt: skip
        resisted = resistance_section(self)
        sections += [resisted] if resisted else []
        planar = planar_of(self.s)
        sections += recursive_sections(self)
        self.book.refresh()
        self.run_checks(rate, rates)
        symbols = Section("Symbols", [self.book.symbols(), Paragraph(CONVENTION)])
        checked = Section("Numeric check", checks_table(self.book.checks, POINTS))
        title = f"{title_of(self.s.cls)} joint" if "oint" not in self.s.cls.__name__ else title_of(self.s.cls)
        return Document(title, [*described(self.s.cls), symbols, *sections, self.plane(planar), checked, provenance(self.d, planar)])

    def constraint(self) -> Section:
        """The rows."""
        mark, w = self.book.mark(), self.book.writer
        rows: list[Block] = [Equation(f"c_{{\\text{{{row_name(name)}}}}} = {w.scalar(e)} = 0", i + 1)
                             for i, (name, e) in enumerate(self.s.rows.items())]  # fmt: skip
        multipliers = Table(["row", "multiplier", "unit"], [
            [row_name(name), f"${multiplier(name)}$", self.book.known[f"lambda_{name}"].unit] for name in self.s.rows])  # fmt: skip
        for name in self.s.rows:
            w.used.add(f"lambda_{name}")
        named = self.book.definitions(mark)
        where = [Paragraph("with"), *named] if named else []
        count = f"{len(self.s.rows)} {'row' if len(self.s.rows) == 1 else 'rows'} must vanish."
        return Section("Constraint", [Paragraph(count), *rows, *where, multipliers, *self._augmented()])

    def _augmented(self) -> list[Block]:
        if not {"scaling", "penalty"} <= set(self.s.cls.params):
            return []
        text = ("With a scaling $s$ and a penalty $p$ (both left out below) the potential of a row is $s\\,\\lambda\\,c + p\\,c^2$: "
                "its force $\\lambda$ becomes $s\\,\\lambda + 2\\,p\\,c$ everywhere in this report.")  # fmt: skip
        return [Paragraph(text)]

    def variation(self) -> Section:
        """delta c by the rule."""
        rule, lines, mark = self.s.variation(), [], self.book.mark()
        changes = {name: rule.scalar(e) for name, e in self.s.rows.items()}
        self.book.refresh()
        for name, change in changes.items():
            lines.append(f"\\delta c_{{\\text{{{row_name(name)}}}}} = {self.book.writer.scalar(change)}")
        blocks: list[Block] = [Paragraph("With $\\delta\\mathbf{a} = \\delta\\boldsymbol{\\psi}\\times\\mathbf{a}$ for every vector fixed to a "
                                         "body:"), Equation(joined(lines))]  # fmt: skip
        named = self.book.definitions(mark)
        return Section("Variation", [*blocks, *([Paragraph("with"), *named] if named else [])])

    def work(self) -> Section:
        """delta W collected by virtual displacements."""
        coordinates = "".join(f" + h_{{{name}}}\\,\\delta {self.book.known[str(symbol)].latex}" for name, symbol in self.s.coordinates.items())
        text = ("Virtual work of the rows, with the forces collected at the points of the joint. Carried to the centre of a body the force "
                "stays and the moment becomes $\\mathbf{m} + \\mathbf{s}\\times\\mathbf{f}$.")  # fmt: skip
        return Section("Virtual work", [
            Equation(r"\sum_i \lambda_i\,\delta c_i = \mathbf{f}_k\cdot\delta\mathbf{r}_k + \mathbf{m}_k\cdot\delta\boldsymbol{\psi}_k "
                     rf"+ \mathbf{{f}}_l\cdot\delta\mathbf{{r}}_l + \mathbf{{m}}_l\cdot\delta\boldsymbol{{\psi}}_l{coordinates}"),
            Paragraph(text)])  # fmt: skip

    def forces(self) -> Section:
        """Rows of forces, zero ones included."""
        w = self.book.writer
        head = ["row", r"$\mathbf{f}_k$", r"$\mathbf{m}_k$", r"$\mathbf{f}_l$", r"$\mathbf{m}_l$"]
        head += [f"$h_{{{name}}}$" for name in self.s.coordinates]
        rows = []
        for row, (pairs, partial) in self.duals.items():
            lam = self.weights[row]
            cells = [w.vector(part * lam) for side in "kl" for part in pairs[side]] + [w.scalar(lam * p) for p in partial.values()]
            rows.append([row_name(row), *(f"${c}$" for c in cells)])
        text = ("Coordinate-free, on the left-hand side: the force on body k at its point is $-\\mathbf{f}_k$, its moment about that point "
                "$-\\mathbf{m}_k$; likewise on body l.")  # fmt: skip
        blocks: list[Block] = [Paragraph(text), Table(head, rows)]
        if self.s.coordinates:
            blocks.append(Paragraph("The massless coordinate has the row " + " and ".join(
                f"$h_{{{name}}} + \\text{{(spring, damper, torque)}} = 0$, the sum over its column" for name in self.s.coordinates) + "."))
        return Section("Forces on both bodies", blocks)

    def body_frame(self) -> Section:
        """The moments in the axes of each body."""
        w, rows = self.book.writer, []
        for row, (pairs, _) in self.duals.items():
            cells = []
            for side in "kl":
                w.frame = lambda base, side=side: in_frame(base, side)
                cells += [w.vector(part * self.weights[row]) for part in pairs[side]]
                w.frame = None
            rows.append([row_name(row), *(f"${c}$" for c in cells)])
        head = ["row", r"$\bar{\mathbf{f}}_k$", r"$\bar{\mathbf{m}}_k$", r"$\bar{\mathbf{f}}_l$", r"$\bar{\mathbf{m}}_l$"]
        text = ("The same in the joint axes of the body that feels them: $\\mathbf{J} = [\\mathbf{x}\\ \\mathbf{y}\\ \\mathbf{z}]$, "
                "$\\mathbf{A} = \\mathbf{J}_k^{\\mathsf{T}}\\mathbf{J}_l$, unit triples $\\mathbf{e}_x, \\mathbf{e}_y, \\mathbf{e}_z$, a bar and "
                "the letter of the body over what is resolved there: $\\bar{\\mathbf{a}} = \\mathbf{J}^{\\mathsf{T}}\\mathbf{a}$.")  # fmt: skip
        self._check_body_frame()
        return Section("Forces in body axes", [Paragraph(text), Table(head, rows)])

    def _check_body_frame(self) -> None:
        """J^T of products equals products of J^T: the substitution the table makes."""
        st = self.state
        for side in "kl":
            J = np.stack([st.atom(Base(a, side)) for a in "xyz"], axis=-1)
            plain = self.book.numbers(st)
            from mbdae.reports.render import Numbers

            resolved = Numbers(self.s.record, lambda base, J=J: np.einsum("pji,pj->pi", J, st.atom(base)), st.symbol)
            for i, axis in enumerate("xyz"):
                resolved._known[Base("E", axis)] = J[:, i, :]
            for part, what in zip(self.total()[side], ("force", "moment"), strict=True):
                wanted = np.einsum("pji,pj->pi", J, np.broadcast_to(plain.vector(part), (POINTS, 3)))
                self.check(f"{what} on the side of {side} in joint axes", resolved.vector(part), wanted)

    def balance(self) -> Section:
        """Sum of forces and moments, row by row."""
        w, rows = self.book.writer, []
        d = self.s.record.single(self.s.record.atom("r", "l") - self.s.record.atom("r", "k"))
        self.book.refresh()
        mark, n, all_balance = self.book.mark(), self.book.numbers(self.state), True
        for row, (pairs, _) in self.duals.items():
            force = pairs["k"][0] + pairs["l"][0]
            moment = pairs["k"][1] + pairs["l"][1] + d.cross(pairs["l"][0])
            moment = _settled(moment, n)
            all_balance &= not moment.terms
            rows.append([row_name(row), f"${w.vector(force)}$", f"${w.vector(moment)}$"])
        told = ("Forces and moments balance at every attitude, on the constraint or off it." if all_balance else
                "Forces balance at every attitude; where a moment is left it vanishes on the constraint, where the points coincide: rows along "
                "inertial axes do not turn with the bodies.")  # fmt: skip
        named = self.book.definitions(mark)
        head = ["row", r"$\mathbf{f}_k + \mathbf{f}_l$",
                r"moment about $\mathbf{r}_k$: $\mathbf{m}_k + \mathbf{m}_l + (\mathbf{r}_l - \mathbf{r}_k)\times\mathbf{f}_l$"]  # fmt: skip
        return Section("Balance of forces and moments", [Paragraph("Per unit of each multiplier."), Table(head, rows), *named, Paragraph(told)])

    def rates(self, rate: Motion, rates: dict[str, Expr]) -> Section:
        """c' and c'' without accelerations."""
        w, mark = self.book.writer, self.book.mark()
        second = {name: rate.scalar(e) for name, e in rates.items()}
        self.book.refresh()
        first = [f"\\dot c_{{\\text{{{row_name(name)}}}}} = {w.scalar(e)}" for name, e in rates.items()]
        further = [f"\\gamma_{{\\text{{{row_name(name)}}}}} = {w.scalar(e)}" for name, e in second.items()]
        named = self.book.definitions(mark)
        worst = self._rate_proof(rates)
        blocks: list[Block] = [
            Paragraph("$\\mathbf{G}$ has the rows of the table of forces: $\\dot c = \\mathbf{G}\\mathbf{u} + c_t$, with"),
            Equation(joined(first)),
            Paragraph("and $\\ddot c = \\mathbf{G}\\dot{\\mathbf{u}} + \\gamma$, where $\\gamma = \\dot{\\mathbf{G}}\\mathbf{u} + \\ldots$ contains no "
                      "acceleration of a centre and no angular acceleration:"),
            Equation(joined(further)),
            *([Paragraph("with"), *named] if named else []),
            Paragraph(f"Proof that $\\frac{{\\mathrm{{d}}}}{{\\mathrm{{d}}t}} c = \\mathbf{{G}}\\mathbf{{u}} + c_t$: forces times velocities, "
                      "$\\mathbf{f}_k\\cdot\\mathbf{v}_k + \\mathbf{m}_k\\cdot\\boldsymbol{\\omega}_k + \\mathbf{f}_l\\cdot\\mathbf{v}_l + "
                      "\\mathbf{m}_l\\cdot\\boldsymbol{\\omega}_l$, and the derivative of $c$ along a motion of the bodies differ by "
                      f"{worst:.1e} at most at the random states below."),
        ]  # fmt: skip
        return Section("Jacobian and its rate", blocks)

    def _rate_proof(self, rates: dict[str, Expr]) -> float:
        """G u from the table of forces against the rates."""
        n, worst = self.book.numbers(self.state), 0.0
        for row, (pairs, partial) in self.duals.items():
            Gu: Any = np.zeros(POINTS)
            for side in "kl":
                Gu = Gu + np.sum(n.vector(pairs[side][0]) * n.atom(Base("v", side)) + n.vector(pairs[side][1]) * n.atom(Base("w", side)), -1)
            Gu = Gu + sum(n.scalar(p) * n.scalar(self.s.clock[s]) for s, p in partial.items())
            of_time = sum((se.diff(self.s.rows[row], p) * dp for p, dp in self.d.variation.clock.items()), se.Integer(0))
            for a in [a for a in self.s.record.vectors.values() if any(c.free_symbols & set(self.d.variation.clock) for c in a.terms.values())]:
                of_time += self._clocked(row, a)
            error = residual(Gu + n.scalar(of_time), n.scalar(rates[row]))
            worst = max(worst, error)
            self.book.checks.append(Check(f"G u of row {row_name(row)} from the forces, with its rate", error))
        return worst

    def _clocked(self, row: str, a: Vector) -> Expr:
        """What a row changes by the clock inside a named vector."""
        record = self.s.record
        numbers = [n for n, value in record.vectors.items() if value is a and n not in record.changes]
        total: Expr = se.Integer(0)
        for symbol in self.s.rows[row].free_symbols & set(record.dots):
            for one, other in (record.dots[symbol], record.dots[symbol][::-1]):
                if getattr(one, "number", None) in numbers:
                    changed = {atom: sum((se.diff(c, p) * dp for p, dp in self.d.variation.clock.items()), se.Integer(0))
                               for atom, c in a.terms.items()}  # fmt: skip
                    total += se.diff(self.s.rows[row], symbol) * sum(c * record.dot(atom, other) for atom, c in changed.items())
        return total

    def stiffness(self) -> Section:
        """Change of the forces at constant multipliers."""
        rule, w, mark = self.s.variation(), self.book.writer, self.book.mark()
        changes = {row: {side: [rule.vector(part * self.weights[row]) for part in pairs[side]] for side in "kl"}
                   for row, (pairs, _) in self.duals.items()}  # fmt: skip
        self.book.refresh()
        blocks: list[Block] = [Paragraph("Change of the forces in a virtual displacement at constant multipliers, $\\delta(\\mathbf{G}^{\\mathsf{T}}"
                                         "\\boldsymbol{\\lambda})$; what is not listed is zero.")]  # fmt: skip
        for row, sides in changes.items():
            lines = []
            for side, parts in sides.items():
                for letter, part in zip("fm", parts, strict=True):
                    if part.terms:
                        lines.append(f"\\delta\\mathbf{{{letter}}}_{side} = {w.vector(part)}")
            text = f"Row {row_name(row)}" + (":" if lines else ": zero.")
            blocks += [Paragraph(text), *([Equation(joined(lines))] if lines else [])]
        named = self.book.definitions(mark)
        return Section("Geometric stiffness", [*blocks, *([Paragraph("with"), *named] if named else [])])

    def plane(self, planar: Derived | None) -> Section:
        """What remains in the plane."""
        if planar is None:
            return Section("Planar form", [Paragraph("The law has no planar form.")])
        kept = ", ".join(row_name(r) for r in planar.rows) or "none"
        gone = ", ".join(row_name(r) for r in planar.vanished) or "none"
        text = ("Where all points and motions lie in the plane z = 0 and $\\mathbf{z}_k$ is its normal, the vectors above have two components, "
                "rotations and moments one, $\\boldsymbol{\\omega} = \\omega\\,\\mathbf{i}_z$. "
                f"Rows that remain: {kept}. Rows that vanish identically and are left out: {gone}.")  # fmt: skip
        w, lines = self.book.writer, []
        for row in planar.rows:
            pairs = self.duals[row][0]
            lines.append([row_name(row), *(f"${w.vector(pairs[side][0])}$" for side in "kl"),
                          *(f"${_normal_part(w.vector(pairs[side][1]))}$" for side in "kl")])  # fmt: skip
        head = ["row", r"$\mathbf{f}_k/\lambda$", r"$\mathbf{f}_l/\lambda$", r"$m_k/\lambda$", r"$m_l/\lambda$"]
        return Section("Planar form", [Paragraph(text), *([Table(head, lines)] if lines else [])])


def _normal_part(text: str) -> str:
    return "0" if text == r"\mathbf{0}" else f"\\mathbf{{i}}_z\\cdot\\left({text}\\right)"


def _settled(a: Vector, n: Any) -> Vector:
    """The vector, or zero where it vanishes at all states."""
    return a if a.terms and float(np.max(np.abs(n.vector(a)))) > 1e-12 else a.record.zero()


def in_frame(base: Base, side: str) -> str:
    """A frame vector resolved in the joint axes of one side."""
    if base.kind in ("x", "y", "z"):
        unit = f"\\mathbf{{e}}_{base.kind}"
        if base.side == side:
            return unit
        return f"\\mathbf{{A}}{unit}" if side == "k" else f"\\mathbf{{A}}^{{\\mathsf{{T}}}}{unit}"
    name = "ijk"["xyz".index(base.side)] if base.kind == "E" else base.kind
    plain = f"\\mathbf{{i}}_{base.side}" if base.kind == "E" else f"\\mathbf{{{name}}}_{base.side}"
    return f"\\mathbf{{J}}_{side}^{{\\mathsf{{T}}}}{plain}"


def report_outputs(d: Derived) -> list[tuple[Any, Expr]]:
    """What a joint adds to the equations, rows with both rates."""
    return [*position(d), *velocity(d), *acceleration(d), *dynamics(d)]


def covectors(d: Derived) -> dict[str, tuple[Vec, Vec]]:
    """G^T lambda of both sides as derived: force, moment about the centre, inertial."""
    from mbdae.symbolic.outputs import weighted

    return {f.side: weighted(d, d.multipliers, f.side) for f in d.sides}


def resistance_pairs(s: Statement) -> dict[str, Pair] | None:
    """Forces a joint states besides its rows, left-hand side, at the points."""
    if s.wrench is None:
        return None
    force, torque = s.wrench
    d = s.record.single(s.record.atom("r", "l") - s.record.atom("r", "k"))
    return {"k": (force, torque + d.cross(force)), "l": (-force, -torque)}


def planar_of(s: Statement) -> Derived | None:
    """The law in the plane, where it has a planar form."""
    try:
        return derived(s.cls, s.structure, planar=True)
    except LawError:
        return None


def joint_report(law: type[Joint], structure: Structure) -> Document:
    """The report of a joint law."""
    return JointReport(law, structure).document()


__all__ = ["JointReport", "covector", "ggl_outputs", "joint_report"]
