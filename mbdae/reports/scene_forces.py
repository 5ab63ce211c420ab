"""Joint forces of a scene in closed form: equations and their solution as a page, read back from its LaTeX."""

from __future__ import annotations

from functools import cached_property, reduce
from itertools import combinations
from operator import mul
from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Paragraph, Section, Table, escaped
from mbdae.reports.letters import unit_text
from mbdae.reports.mechanisms.solution import (
    Coefficients,
    SolvedTogether,
    TakenOut,
    determinant,
    divided_by,
    less,
    next_to_zeros,
    solved,
    total,
)
from mbdae.reports.page import Check, Page, Printed, Wanted, short_hash
from mbdae.reports.scene_equations import ROUNDED, SHORT, Said, SceneEquations
from mbdae.reports.states import POINTS as STATES
from mbdae.reports.states import value
from mbdae.reports.units import Unit, unit
from mbdae.reports.vectors import ZERO
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.vectors import Expr
from mbdae.system.prepare import Prepared

NOISE = 1e-13  #: a value of this part of the largest of its unit is round-off
RUN = "the multipliers of the scene at random states"


class ClosedForms(SceneEquations, Page):
    """The joint forces of a scene as formulas. Raises ValueError, with the reason, where a scene has none; with MOVES, where
    there is more to print, the reason is in `without`."""

    MOVES = False
    without = ""

    def __init__(self, prepared: Prepared) -> None:
        super().__init__(prepared)
        self.taken: dict[str, Expr] = {}  #: letters of rows that are taken from others, with their formulas
        self.coefficients: dict[str, list[list[Expr]]] = {}  #: those of such rows, by their first multiplier
        efforts, bodies = {at: str(v.effort) for at, v in self.velocities.items()}, {at: v.balance for at, v in
                                                                                     self.velocities.items()}
        try:
            self._refuse_forces()
            self.steps = solved(self.rows, self._number, efforts, bodies, self._taken, self._drawn)
        except ValueError as reason:
            if not self.MOVES:
                raise
            self.without = str(reason)

    @cached_property
    def _at_start(self) -> dict[str, Any]:
        start = self.prepared.start
        return self._letters_at(np.array([start.t]), start.q[None], start.u[None], start.s[None])

    @cached_property
    def _at_random(self) -> dict[str, Any]:
        return self._letters_at(*self.states())

    def _letters_at(self, *states: Any) -> dict[str, Any]:
        known, _ = SceneEquations.values(self, *states)
        return {name: known[latex] for name, latex in self.latex.items() if latex in known}

    def _number(self, e: Expr) -> float:
        """Value of a coefficient at the start."""
        return float(self._at(e, self._at_start, 1)[0])

    def _drawn(self, e: Expr) -> Any:
        """Values of a coefficient at random states."""
        return self._at(e, self._at_random, STATES)

    def _at(self, e: Expr, letters: dict[str, Any], points: int) -> Any:
        """Values (points,) of a coefficient by those of the letters of the rows."""
        def get(symbol: Expr) -> Any:
            name = str(symbol)
            return letters[name] if name not in self.taken else self._at(self.taken[name], letters, points)

        return np.broadcast_to(value(se.sympify(e), get), (points,))

    # -- formulas

    def _define(self, name: str, latex: str, e: Expr, unit_: str, meaning: str) -> Expr:
        """A letter of the solution with its formula."""
        self.taken[name] = e
        return self.letter(name, latex, unit_, meaning)

    def _taken(self, step: SolvedTogether, others: dict[int, Coefficients]) -> TakenOut:
        """Take rows from others, with letters for their coefficients, the determinant of these, factors, and what is left."""
        first, n, of = len(self.taken), 1 + len(self.coefficients), self.velocities
        known = [self.unit_of(x) for x in step.unknowns]
        efforts = [of[at].effort for at in step.places]
        A = [[self._define(f"b{n}_{i}{j}", f"b^{{({n})}}_{{{i + 1}{j + 1}}}", row.get(x, ZERO), str(efforts[i] / known[j]),
                           f"factor of ${self.latex[str(x)]}$") for j, x in enumerate(step.unknowns)]
             for i, row in enumerate(step.rows)]
        self.coefficients[str(step.unknowns[0])] = A
        size = reduce(mul, (e / x for e, x in zip(efforts, known, strict=True)))
        det = self._define(f"Ga{n}", rf"\Gamma^{{({n})}}", determinant(A), str(size), "determinant")
        left = dict[int, Coefficients]()
        for number, (at, row) in enumerate(others.items(), 1):
            c, factors = [row.get(x, ZERO) for x in step.unknowns], []
            for i, place in enumerate(step.places):
                e = determinant([c if j == i else A[j] for j in range(len(A))])
                meaning = f"factor of the balance along the {of[place].of} where it is taken from that along the {of[at].of}"
                factors.append(self._define(f"m{n}_{number}{i}", rf"\mu^{{({n})}}_{{{number}{i + 1}}}", se.expand(e) / det,
                                            str(of[at].effort / efforts[i]), meaning))
            left[at] = less(row, step, factors)
            for i, (x, e) in enumerate(left[at].items()):
                if len(e.free_symbols) > SHORT:
                    factor = self.unit_of(x) if x is not None else unit("1")
                    meaning = f"in what is left of the balance along the {of[at].of}, " + (
                        f"factor of ${self.latex[str(x)]}$" if x is not None else "all but reactions")
                    left[at][x] = self._define(f"w{n}_{number}{i}", f"w^{{({n})}}_{{{number}{i + 1}}}", e,
                                               str(of[at].effort / factor) if x is not None else of[at].effort.of_force, meaning)
        return TakenOut(left, [*self.taken][first:])

    def blocks(self) -> list[Block]:
        """Sections: letters with values, equations of the bodies, solution, forces on the bodies l, laws."""
        if self.without:
            why = Paragraph(f"They have no closed form: {self.without}. A run has them by its sensors.")
            return [Section("Symbols and their values at the start", [self.numbers()]), Section("Joint forces", [why])]
        balance, solution, forces = self.balance(), self.solution(), self.forces()
        numbers = self.numbers()
        turns = [letter for letter in (r"\theta", r"\psi") if any(v.letter == letter for v in self.velocities.values())]
        told = (
            f"For every body the balance of forces along $x$, $y${'' if self.prepared.model.planar else ', $z$'}"
            + f" and of moments about its centre (${'$, $'.join(turns)}$)" * bool(turns)
            + ": $p$ is inertia less all forces but reactions; the multipliers $\\lambda$ of the joints enter with their arms."
            + r" Moments $\psi$ are about the axes of the body in which its inertia $J$ is stated, and $f^\psi$ contains the"
              r" gyroscopic moment $-\omega\times J\,\omega$." * any(v.letter == r"\psi" for v in self.velocities.values())
        )
        how = (
            "Force balances give one multiplier each, without a division. The other rows are split into the smallest blocks that"
            " can be solved one after the other, by determinants; where a block has more rows than multipliers, every choice of"
            " as many counts by the square of its determinant. A block has no solution where its divisor, marked $\\ne 0$, is 0:"
        )
        if self.prepared.model.lines:
            told += (" Of beams, the nodes at which joints act: their inertia is that of the mass matrix, their forces are those"
                     " of their elements and loads, as `mb.report(\"beam\")` derives them.")
        told += "".join(f" The name {escaped(name)} is written {words}." for name, words in self.names.renamed.items())
        on_l = ("The force $F$ (N) on body l of each joint, and the moment $T$ (N m) about its point there, as sensors of a run"
                " read them: reactions, and what the joint's own springs, dampers and loads add ('own', part of $f$ above):")
        return [
            Section("Symbols and their values at the start", [numbers]),
            Section("Equations of the bodies", [Paragraph(told), *balance]),
            Section("Joint forces in closed form", [Paragraph(how), *solution, Paragraph(on_l), *forces]),
            Section("Laws of the equations", [self.laws()]),
        ]

    def balance(self) -> list[Block]:
        """For every velocity of the bodies the equation that defines p, mass times acceleration less applied force, and the
        balance of p with the joint forces."""
        w, lines = self.writer, []
        for at in self.rows:
            v = self.velocities[at]
            terms = [f"{self.mass_letter(at, j)}\\,\\ddot{{{self.velocities[j].letter}}}_{self.velocities[j].below}"
                     for j in self.mass[at]]
            lines.append(f"{self.latex[f'p{at}']} = {' + '.join(terms)} - f^{v.letter}_{v.below}")
            left = [*(e * key for key, e in self.rows[at].items() if key is not None), self.rows[at][None]]
            lines.append(f"{w.scalar(sum(left, se.Integer(0)))} = 0")
        return self.lines(*lines)

    def solution(self) -> list[Block]:
        """Equations of the multipliers in the order of their solution."""
        w, out, count = self.writer, list[Block](), 0
        for step in self.steps:
            if isinstance(step, TakenOut):
                for name in step.letters:
                    apart = r" \ne 0" if name.startswith("Ga") else ""
                    out += self.lines(f"{self.latex[name]} = {w.scalar(self.taken[name])}{apart}")
                continue
            unknowns, rows, places = step
            if any(unknown in row for row in rows for unknown in unknowns):
                count += 1
                out += self._determinants(unknowns, rows, count, [self.velocities[at].effort for at in places])
            else:
                out += self.lines(f"{w.scalar(unknowns[0])} = {w.scalar(total(rows[0]))}")
        return out

    def _determinants(self, unknowns: list[Any], rows: list[Coefficients], count: int, efforts: list[Unit]) -> list[Block]:
        """Equations of a block of rows A lambda = h, solved by Cramer's rule for every choice of as many rows as multipliers,
        weighted by the squares of their determinants. efforts: units of the rows."""
        w, n, m, lines = self.writer, len(unknowns), len(rows), []
        known = [self.unit_of(x) for x in unknowns]
        own = self.coefficients.get(str(unknowns[0]))
        A = own or [[self.letter(f"a{count}_{i}{j}", f"a^{{({count})}}_{{{i + 1}{j + 1}}}", str(efforts[i] / known[j]),
                                 f"factor of ${self.latex[str(unknowns[j])]}$") for j in range(n)] for i in range(m)]
        h = [self.letter(f"h{count}_{i}", f"h^{{({count})}}_{{{i + 1}}}", efforts[i].of_force, "minus the rest of the row")
             for i in range(m)]
        for i, row in enumerate(rows):
            apart = r" \ne 0" if m == n == 1 else ""
            lines += [f"{w.scalar(A[i][j])} = {w.scalar(row.get(unknown, ZERO))}{apart}" for j, unknown in enumerate(unknowns)
                      if own is None]
            rest = {key: e for key, e in row.items() if key not in unknowns}
            lines.append(f"{w.scalar(h[i])} = {w.scalar(se.expand(-total(rest)))}")
        if m == n == 1:
            return self.lines(*lines, f"{w.scalar(unknowns[0])} = {w.scalar(h[0] / A[0][0])}")
        size = reduce(mul, (e / x for e, x in zip(efforts, known, strict=False)))
        choices = list(combinations(range(m), n))
        minors = [determinant([A[i] for i in choice]) for choice in choices]
        for at, (choice, e) in enumerate(zip(choices, minors, strict=True)) if m > n > 1 else ():
            name = "".join(str(i + 1) for i in choice)
            latex, what = f"\\Delta^{{({count})}}_{{{name}}}", f"determinant of the rows {name}"
            minors[at] = self.letter(f"d{count}_{name}", latex, str(size), what)
            lines.append(f"{w.scalar(minors[at])} = {w.scalar(e)}")
        weights, size = (minors, size * size) if m > n else ([se.Integer(1)], size)
        what = "sum of the squares of the determinants" if m > n else "determinant"
        det = self.letter(f"d{count}", f"\\Delta^{{({count})}}", str(size), what)
        lines.append(f"{w.scalar(det)} = {w.scalar(_weighted(minors, weights))} \\ne 0")
        for j, unknown in enumerate(unknowns):
            replaced = [determinant([[h[i] if column == j else A[i][column] for column in range(n)] for i in c]) for c in choices]
            lines.append(f"{w.scalar(unknown)} = {w.scalar(_weighted(replaced, weights) / det)}")
        return self.lines(*lines)

    def _force(self, letter: str, item: str, i: int) -> str:
        """The letter of a component of a joint force or moment."""
        latex, on = f"{letter}_{{{self.names.said('item', item)},{'xyz'[i]}}}", f"of {item} on its body l, component {'xyz'[i]}"
        self.said[latex] = Said(*(("N", f"force {on}") if letter == "F" else ("N m", f"moment {on}")))
        return latex

    def forces(self) -> list[Block]:
        """Equations of the force of every joint on its body l by the multipliers of its rows."""
        lines = []
        for place, e in self.on_l.items():
            lines.append(f"{self._force(*place)} = {self.writer.scalar(e)}")
            lines += [f"{self.writer.scalar(d)} \\ne 0" for d in divided_by(se.sympify(e))]
        return self.lines(*dict.fromkeys(lines))

    def printed(self, blocks: list[Block]) -> list[Check]:
        """Checks of the equations at random states, and at such states with others next to zeros of the divisors, against the
        multipliers of the scene."""
        if self.without:
            return []
        checks, zeros = self.read(blocks, *self.values(*(states := self.states()))), next_to_zeros(self, blocks)
        if zeros is None:
            return checks
        both = [np.concatenate([a, b]) for a, b in zip(states, zeros, strict=True)]
        worst = max(c.residual for c in self.read(blocks, *self.values(*both)) if RUN in c.what)
        what = f"multipliers and forces with {len(zeros[0])} states next to zeros of divisors, where no condition names these"
        return [*checks, Check(what, worst)]

    def read(self, blocks: list[Block], known: dict[str, Any], multipliers: Any) -> list[Check]:
        """Checks of the equations against given multipliers (nt, m), and that every divisor has its condition."""
        noise = ROUNDED * np.max(np.abs(multipliers), axis=1, initial=0.0)
        printed = Printed(known, self.forces_wanted(known, multipliers), len(multipliers), self.sizes(), noise)
        return [*printed.read(blocks), *printed.undivided(blocks)]

    def forces_wanted(self, known: dict[str, Any], multipliers: Any) -> dict[str, Wanted]:
        """Values that multipliers, joint forces and moments must have, by LaTeX. known: values of the letters of the balances."""
        wanted = {self.latex[str(s)]: Wanted(multipliers[:, i], RUN) for i, s in enumerate(self.unknowns)}
        table = {name: known[latex] for name, latex in self.latex.items() if latex in known}
        table |= {str(s): multipliers[:, n] for n, s in enumerate(self.unknowns)}
        for place, e in self.on_l.items():
            wanted[self._force(*place)] = Wanted(value(se.sympify(e), lambda symbol: table[str(symbol)]), RUN)
        return wanted

    # -- tables of letters and laws

    def numbers(self) -> Table:
        """Table of letters with unit and meaning, and the value at the start of those that no equation defines."""
        start = self.prepared.start
        known, multipliers = self.values(np.array([start.t]), start.q[None], start.u[None], start.s[None])
        values = {latex: float(v[0]) for latex, v in known.items()}
        values |= {self.latex[str(s)]: float(x) for s, x in zip(self.unknowns, multipliers[0], strict=not self.without)}
        values |= {self.latex[name]: x for name, x in self.constants.items()}
        size, time, rows = self.prepared.length, self.prepared.time, list[list[str]]()
        largest = {"rad/s": 1 / time, "rad/s^2": time**-2, "1": 1.0, "m": size, "m/s": size / time, "m/s^2": size / time**2}
        for unit_, v in ((self.said[latex].unit, abs(v)) for latex, v in values.items() if latex in self.said):
            for u, f in {unit_: 1.0, "N m": size * (unit_ == "N") or (unit_ == "N m")}.items():
                largest[u] = max(largest.get(u, 0.0), v * f)
        for latex, said in self.said.items():
            meaning, x = said.meaning if "$" in said.meaning else escaped(said.meaning), values.get(latex)
            shown = "" if x is None else f"{x * (abs(x) >= NOISE * largest[said.unit]) + 0.0:.6g}"
            rows.append([f"${latex}$", shown, unit_text(said.unit), meaning])
        return Table(["symbol", "value", "unit", "meaning"], rows)

    def laws(self) -> Table:
        """Table of the joints with hashes of their laws as derived for this scene."""
        rows, seen = [], dict.fromkeys((row.group, row.instance) for row in self.m.rows)
        for g, i in seen:
            group = self.prepared.model.groups[g]
            names = ", ".join(row.name for row in self.m.rows if (row.group, row.instance) == (g, i))
            law, shape, kinds = *group.key[:2], " - ".join(kind.value for kind, _ in group.key[2])
            said_ = [f"{name}=None" for name in law.drives() if name in shape.absent] if issubclass(law, Joint) else []
            call, hash_ = ", ".join([f"mb.{law.__name__}", *said_]), short_hash(group.derived)
            rows.append([group.instances[i].item, f"`mb.report({call})`", kinds, names, hash_])
        return Table(["joint", "its law", "between", "rows", "sha256 of the derived equations"], rows)


def _weighted(values: list[Expr], weights: list[Expr]) -> Expr:
    return sum((v * weight for v, weight in zip(values, weights, strict=True)), ZERO)
