"""Numeric checks of a joint's report: every formula is compared with the compiled or derived equations of the law."""

from __future__ import annotations

import functools
from functools import cached_property
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import LawError
from mbdae.kernels.plan import Outputs, plan
from mbdae.reports.calculus import Motion, Pair
from mbdae.reports.common import Check, LawFormulas, row_name
from mbdae.reports.evaluate import Numbers
from mbdae.reports.statement import Statement, derived
from mbdae.reports.states import POINTS, STEP, State, random_state, residual
from mbdae.reports.vectors import Base
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Law, Structure
from mbdae.symbolic.outputs import acceleration, dynamics, position, velocity, weighted
from mbdae.symbolic.vectors import Expr, Vec


class LawChecks:
    """One law stated with vectors, its formulas in LaTeX, and their checks at random states."""

    s: Statement
    formulas: LawFormulas
    d: Derived
    state: State

    def check(self, what: str, got: Any, wanted: Any) -> None:
        """Compare the values of a formula with those of the derived equation."""
        self.formulas.checks.append(Check(what, residual(got, wanted)))

    def compiled(self, outputs: Outputs) -> dict[Any, Any]:
        """Outputs of the compiled kernel (LLVM) at the states, by target."""
        p = plan(self.d, outputs)
        if not p.targets:
            return {}
        x = np.stack([self.state.given[str(symbol)] for symbol in p.all_inputs.symbols], axis=-1)
        return dict(zip(p.targets, p.kernel.values(x).T, strict=True))

    @cached_property
    def stated_pairs(self) -> dict[str, Pair] | None:
        """The force and torque that the law states, and those of its thrust, on all bodies, left-hand side, at their points."""
        if self.s.wrench is None and self.s.thrust is None:
            return None
        zero, record = self.s.record.zero(), self.s.record
        out = dict.fromkeys(record.sides, (zero, zero))
        if self.s.wrench is not None:
            force, torque = self.s.wrench
            d = record.single(record.atom("r", "l") - record.atom("r", "k"))
            out |= {"k": (force, torque + d.cross(force)), "l": (-force, -torque)}
        if self.s.thrust is not None:
            along, push = self.s.thrust
            for side, (move, turn) in self.s.gradient(along)[0].items():
                out[side] = (out[side][0] + move * -push, out[side][1] + turn * -push)
        return out

    @cached_property
    def stated_partials(self) -> dict[Expr, Expr]:
        """What the thrust of the law adds to the equations of the coordinates that are unknowns, left-hand side."""
        zero = dict.fromkeys(self.s.coordinates.values(), se.Integer(0))
        if self.s.thrust is None:
            return zero
        along, push = self.s.thrust
        return zero | {symbol: -push * p for symbol, p in self.s.gradient(along)[1].items()}

    def check_coordinate(self, name: str, e: Expr, kernel: dict[Any, Any]) -> None:
        """The term of the law in the equation of a coordinate, with the compiled kernel."""
        wanted = kernel.get(("u", self.s.places[name], 0), np.zeros(POINTS))
        got = np.broadcast_to(self.formulas.numbers(self.state).scalar(e), (POINTS,))
        self.check(f"row of {row_name(name)}, with the compiled kernel", got, wanted)

    def check_pair(self, side: str, pair: Pair, kernel: dict[Any, Any], where: str) -> None:
        """Force and moment on a side at its point, with the compiled kernel."""
        st, n, f = self.state, self.formulas.numbers(self.state), self.state.frame(side)
        count = f.kind.translations
        F = np.broadcast_to(n.vector(pair[0]), (POINTS, 3))
        M = n.vector(pair[1]) + np.cross(st.vector(f.arm), F)
        got = [*np.moveaxis(F, -1, 0), *(np.sum(st.vector(column) * M, axis=-1) for column in f.body)]
        wanted = [kernel.get(("u", side, i), np.zeros(POINTS)) for i in range(count + 3)]
        if count:
            self.check(f"force on {where}, with the compiled kernel", got[:3], wanted[:3])
        self.check(f"moment on {where}, in body axes about its centre, with the compiled kernel", got[3:], wanted[count:])


class JointChecks(LawChecks):
    """The rows of one joint law with the forces that follow from them, and their checks."""

    def __init__(self, law: type[Law], structure: Structure) -> None:
        self.s = Statement(law, structure)
        _ = self.s.rows, self.s.branches
        self.formulas = LawFormulas(self.s)
        self.d = self.s.derived
        self.state = random_state(self.d)
        self.duals = self.s.gradients
        self.weights = {row: se.Symbol(f"lambda_{row}") for row in self.s.rows}

    def total(self) -> dict[str, Pair]:
        """G^T lambda: force and moment on the bodies, at their points."""
        zero = self.s.record.zero()
        out = dict.fromkeys(self.s.record.sides, (zero, zero))
        for row, (pairs, _) in self.duals.items():
            out = {
                side: (out[side][0] + pairs[side][0] * self.weights[row], out[side][1] + pairs[side][1] * self.weights[row])
                for side in self.s.record.sides
            }
        return out

    def run_checks(self, rate: Motion, rates: dict[str, Expr]) -> None:
        """Every displayed formula against the compiled equations."""
        n, kernel = self.formulas.numbers(self.state), self.compiled(report_outputs)
        order = list(self.s.rows)
        for target, values in kernel.items():
            if target[0] in ("g", "gd", "gdd"):
                row = self.d.rows[target[1]]
                e = self.s.rows[row] if target[0] == "g" else rates[row] if target[0] == "gd" else rate.scalar(rates[row])
                kind = {"g": "constraint", "gd": "rate", "gdd": "second rate"}[target[0]]
                self.check(f"{kind} {row_name(row)}, with the compiled kernel", n.scalar(e), values)
        stated = self.d.law.positives(*self.d.sides)
        for name, e in self.s.branches.items():
            self.check(f"branch: {name}", n.scalar(e), self.state.scalar(self.d.variation.name(stated[name])))
        missing = [row for row in order if row not in self.d.rows]
        if missing:
            raise LawError(f"row '{missing[0]}' vanishes in space: state it where it does not")
        self._check_forces(n, kernel)
        self._check_motion(rates)

    def _check_forces(self, n: Any, kernel: dict[Any, Any]) -> None:
        stated = self.stated_pairs
        for side, (force, moment) in self.total().items():
            if stated is not None:
                force, moment = force + stated[side][0], moment + stated[side][1]
            self.check_pair(side, (force, moment), kernel, f"the side of {side}")
        for name, symbol in self.s.coordinates.items():
            total = sum(self.weights[row] * partial[symbol] for row, (_, partial) in self.duals.items())
            self.check_coordinate(name, total + self.stated_partials[symbol], kernel)

    def _check_motion(self, rates: dict[str, Expr]) -> None:
        """Rates, variations and geometric stiffness against complex steps through the quaternions of the bodies."""
        st = self.state
        motion = {side: (st.atom(Base("v", side)), st.atom(Base("w", side))) for side in self.s.record.sides}
        moved = st.changed(1j * STEP, motion, self._clock())
        n, got = self.formulas.numbers(st), self.formulas.numbers(moved)
        for row, e in self.s.rows.items():
            change = np.imag(np.broadcast_to(got.scalar(e), (POINTS,))) / STEP
            self.check(f"d/dt of row {row_name(row)} by moving the bodies, with G u", n.scalar(rates[row]), change)
        virtual = {side: (st.atom(Base("du", side)), st.atom(Base("dpsi", side))) for side in self.s.record.sides}
        changes = {str(c): st.given[str(dc)] for c, dc in self.s.virtual.items()}
        varied, rule = st.changed(1j * STEP, virtual, changes), self.s.variation()
        derived_rows = State(varied.d, varied.given)
        for row, e in self.s.rows.items():
            index = self.d.rows.index(row)
            wanted = np.imag(derived_rows.scalar(self.d.g[index])) / STEP
            self.check(
                f"variation of row {row_name(row)} by moving the bodies",
                np.broadcast_to(n.scalar(rule.scalar(e)), (POINTS,)),
                wanted,
            )
        for side, pair in covectors(self.d).items():
            arm = self.state.frame(side).arm
            for part, what, formula in ((pair[0], "force", self.total()[side][0]), (pair[1], "moment", self.total()[side][1])):
                at_point = part if what == "force" else part - arm.cross(pair[0])
                wanted = np.imag(varied.vector(at_point)) / STEP
                self.check(f"geometric stiffness, {what} on the side of {side}", n.vector(rule.vector(formula)), wanted)

    def _clock(self) -> dict[str, Any]:
        return {str(s): self.state.symbol(str(ds)) for s, ds in self.s.clock.items() if str(s) in self.state.given}

    def _check_body_frame(self) -> None:
        """Forces in joint axes, as the table has them, against J^T times the inertial ones."""
        st = self.state
        for side in self.s.sides:
            J = np.stack([st.atom(Base(a, side)) for a in "xyz"], axis=-1)
            plain = self.formulas.numbers(st)
            axes = {Base("E", a): J[:, i] for i, a in enumerate("xyz")}
            resolved = Numbers(self.s.record, functools.partial(_resolved, st, J), st.symbol, axes)
            for part, what in zip(self.total()[side], ("force", "moment"), strict=True):
                wanted = np.einsum("pji,pj->pi", J, np.broadcast_to(plain.vector(part), (POINTS, 3)))
                self.check(f"{what} on the side of {side} in joint axes", resolved.vector(part), wanted)

    def _rate_proof(self, rates: dict[str, Expr]) -> float:
        """G u from the table of forces against the rates of the rows; the largest relative difference."""
        n, worst = self.formulas.numbers(self.state), 0.0
        for row, (pairs, partial) in self.duals.items():
            Gu: Any = np.zeros(POINTS)
            for side in self.s.record.sides:
                Gu = Gu + np.sum(
                    n.vector(pairs[side][0]) * n.atom(Base("v", side)) + n.vector(pairs[side][1]) * n.atom(Base("w", side)), -1
                )
            Gu = Gu + sum(n.scalar(p) * n.scalar(self.s.clock[s]) for s, p in partial.items())
            of_time = self.s.of_time().scalar(self.s.rows[row])
            error = residual(Gu + n.scalar(of_time), n.scalar(rates[row]))
            worst = max(worst, error)
            self.formulas.checks.append(Check(f"G u of row {row_name(row)} from the forces, with its rate", error))
        return worst


def _resolved(state: State, J: Any, base: Base) -> Any:
    """A frame vector in the axes J."""
    return np.einsum("pji,pj->pi", J, state.atom(base))


def report_outputs(d: Derived) -> list[tuple[Any, Expr]]:
    """What a joint contributes to the equations: rows, their first and second rates, forces."""
    return [*position(d), *velocity(d), *acceleration(d), *dynamics(d)]


def covectors(d: Derived) -> dict[str, tuple[Vec, Vec]]:
    """G^T lambda of all frames that turn as derived: force, moment about the centre, inertial."""
    return {f.side: weighted(d, d.multipliers, f.side) for f in d.frames if f.kind.turns}


def planar_of(s: Statement) -> Derived | None:
    """The law in the plane, where it has a planar form."""
    try:
        return derived(s.cls, s.structure, planar=True)
    except LawError:
        return None
