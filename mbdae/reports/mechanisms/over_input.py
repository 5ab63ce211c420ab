"""A planar mechanism over its input: positions, velocities, accelerations and joint forces as formulas of one coordinate, its
dead centres over one turn, and its joint forces beside those of a run."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Paragraph, Picture, Section, Table, escaped
from mbdae.inputs import timed
from mbdae.notation import counted
from mbdae.reports.mechanisms import NEXT, curve, errors_within, meetings, passed
from mbdae.reports.mechanisms.dyads import Dyads
from mbdae.reports.page import BOUND, NEXT_TO_ZERO, Check, Printed, Wanted
from mbdae.reports.reading import key_of
from mbdae.reports.scene_forces import RUN
from mbdae.reports.states import POINTS, residual
from mbdae.reports.units import parameter_unit
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.vectors import Expr
from mbdae.system.model.nodes import Instance, Node
from mbdae.system.prepare import Prepared

AROUND = 1e-3  #: part of the range of the input left out about a change point, where what divides by the distance is noise
LOST = 4  #: a power of a root, by its terms: what joint forces by the input keep of their digits, divided by it as rates are
OF_ERROR = 3.0  #: part of a run's own error by which formulas and run may differ: it is an estimate
ROUND_OFF = 1e-9  #: least error of a run without an accuracy, part of the largest force
MOTION = "the positions, velocities and accelerations of the scene"


class OverInput(Dyads):
    """The closed forms of a mechanism of the plane, as functions of one input. Raises ValueError, with the reason, where the
    bodies do not follow from one another."""

    def __init__(self, prepared: Prepared) -> None:
        super().__init__(prepared)
        self._arms()

    # -- letters of the rows

    def _entry(self, n: int, at: int, e: Expr) -> Expr:
        found = super()._entry(n, at, e)
        if f"g{n}_{at}" in self.entries:
            self.raw[f"g{n}_{at}"] = (self.m.rows[n], e)
        return found

    def _arms(self) -> None:
        """Define the arms, axes and entries of G that the balances of the bodies contain."""
        self.say("Arms and axes of the joints:")
        groups, letters = self.prepared.model.groups, dict[str, dict[Expr, Expr]]()
        for name, (row, e) in self.raw.items():
            d, instance = groups[row.group].derived, groups[row.group].instances[row.instance]
            moving = {f.side for f, node in zip(d.frames, instance.nodes, strict=True) if node is not None and f.kind.turns}
            fixed = {s for s in e.free_symbols if str(s)[1:-1] in ("_s", "_x", "_y", "_z") and str(s)[0] in moving}
            letters[name] = {s: self._renamed(row, d, s) for s in sorted(fixed, key=str)}
        known = dict(self.formulas)
        for (g, i, symbol), name in self.places.items():
            d, instance = groups[g].derived, groups[g].instances[i]
            if symbol not in instance.numbers and name not in known:
                self.follow(name, self._in_scene(d, instance, se.Symbol(symbol)))
        for name, (row, e) in self.raw.items():
            d, instance = groups[row.group].derived, groups[row.group].instances[row.instance]
            self.follow(name, self._in_scene(d, instance, e, letters[name]))

    def _in_scene(self, d: Derived, instance: Instance, e: Expr, letters: dict[Expr, Expr] | None = None) -> Expr:
        """A formula of a law in letters of the scene, some of which are given."""
        table, meaning = dict(letters or {}), dict[Expr, Expr]()
        for f, node in zip(d.frames, instance.nodes, strict=True):
            meaning |= f.meaning | f.structure
            table |= self._unknowns_of(f, node) if node is not None else {}
        while (found := {s: meaning[s] for s in e.free_symbols - table.keys() if s in meaning}):
            e = se.sympify(e.subs(found))
        for s in e.free_symbols - table.keys():
            side, _, what = str(s).partition("_")
            if instance.item == self.input.item and str(s) in instance.timed and hasattr(instance.law, "drives"):
                table[s] = self.inputs[0]  # what prescribes a coordinate is its value
            elif str(s) in instance.numbers and what[:1] in ("p", "Q"):
                table[s] = self.number_of(instance, side, what)[0]
            elif str(s) in instance.numbers:
                table[s] = self.constant(f"n{instance.item}{s}", self.parameter_letter(instance, str(s)),
                                         instance.numbers[str(s)], parameter_unit(instance, str(s)), f"{s} of {instance.item}")
        if e.free_symbols - table.keys():
            raise ValueError(f"the rows of {escaped(instance.item)} change with time by themselves")
        return se.sympify(e.subs(table))

    def _unknowns_of(self, f: Frame, node: Node) -> dict[Expr, Expr]:
        """What the unknowns of a frame are in letters of the scene."""
        return dict(zip(f.q, self.placed[node], strict=False))

    # -- values

    def over(self, t: Any, q: Any, u: Any, s: Any = None) -> tuple[dict[str, Any], Any]:
        """Values of all letters that no formula defines, by their LaTeX, and the multipliers (nt, m), at states of the scene."""
        known, multipliers = self.values(t, q, u, s)
        change = self.m.accelerations(t, q, u, s)[0]
        amount = self._drawn_amount(self.input)
        table = dict(self.constants) | self.states_as_letters(q, u, change)
        for n in range(u.shape[1]):
            for a, b in (("", "d"), ("d", "dd")):
                self.rates.setdefault(se.Symbol(f"x{n}{a}"), se.Symbol(f"x{n}{b}"))
        for letter in self.inputs:
            known[self.latex[str(letter)]] = np.broadcast_to(self._of(table, amount), (len(t),))
            amount = self.rate(amount)
        known |= {self.latex[name]: np.full(len(t), x) for name, x in self.constants.items()}
        known |= {self.latex[name]: sign for name, sign in self.branches_of(q, u).items()}
        made = {self.latex[name] for name, _ in self.formulas}
        return {latex: v for latex, v in known.items() if latex not in made}, multipliers

    def moved(self, q: Any, u: Any, change: Any) -> dict[str, Wanted]:
        """Values that centres, their rates, and the second rates of all coordinates must have, by LaTeX."""
        angles = {f"x{at}" for at, v in self.velocities.items() if v.letter == r"\theta"}
        return {self.latex[name]: Wanted(values, MOTION) for name, values in self.states_as_letters(q, u, change).items()
                if name in self.latex and name not in angles}

    def read_at(self, blocks: list[Block], t: Any, q: Any, u: Any, s: Any) -> tuple[list[Check], Printed]:
        """Checks of the printed equations at states of a motion, and their values by the input alone."""
        known, multipliers = self.over(t, q, u, s)
        wanted = self.moved(q, u, self.m.accelerations(t, q, u, s)[0])
        wanted |= self.forces_wanted(self.values(t, q, u, s)[0], multipliers)
        printed, alone = Printed(known, wanted, len(t)), Printed(known, {}, len(t))
        checks = [*printed.read(blocks), *printed.undivided(blocks)]
        alone.read(blocks)
        part, of = np.minimum(1.0, BOUND / np.finfo(float).eps * self._least_root(q, u)**LOST), alone.stated
        for latex, w in wanted.items():
            if w.source == RUN:
                off = np.broadcast_to(alone.value(key_of(latex)), (len(t),)) - w.values
                checks.append(Check(f"${latex}$ by the input alone, {RUN}", residual((w.values + part * off)[of], w.values[of])))
        return checks, alone

    def _least_root(self, q: Any, u: Any) -> Any:
        """The smallest root of the loops by its terms, at most 1, at states (nt, n)."""
        return np.min([np.abs(self.at_states(e, q, u)) for e in self.roots.values()], axis=0, initial=1.0)

    # -- the page

    def kept(self) -> list[tuple[int, str, Expr]]:
        """The formulas that velocities, accelerations and joint forces need, with their numbers."""
        needed = {str(x) for row in self.rows.values() for e in row.values() for x in se.sympify(e).free_symbols}
        needed |= {str(x) for e in self.on_l.values() for x in e.free_symbols}
        needed |= {f"x{at}{d}" for at, v in self.velocities.items() for d in ("", "d", "dd") if d or v.letter != r"\theta"}
        found = []
        for n, (name, e) in reversed([*enumerate(self.formulas)]):
            if name in needed:
                needed |= {str(x) for x in e.free_symbols}
                found.append((n, name, e))
        return found[::-1]

    def motion(self) -> Section:
        """Section on positions, velocities and accelerations."""
        blocks, kept, w = list[Block](), self.kept(), self.writer
        left = dict(sorted(self.sayings.items()))
        for n, name, e in kept:
            blocks += [Paragraph(left.pop(at)) for at in [*left] if at <= n]
            blocks += self.lines(f"{self.latex[name]} = {w.scalar(e)}" + (r" \ne 0" if name in self.apart else ""))
        unused = {*self.constants, *(name for name, _ in self.formulas)} - w.used - {name for _, name, _ in kept}
        left_out = {self.latex[name] for name in unused} - {self.latex[name] for name in self.latex.keys() - unused}
        self.said = {latex: said for latex, said in self.said.items() if latex not in left_out}
        x, dx, ddx = (self.latex[str(s)] for s in self.inputs)
        dead = "; ".join(dict.fromkeys(d for d in (*self.limits.values(), *self.apart.values()) if d))
        what = "Dead centres or change points" if self.branches else "Dead centres"
        centres = f" {what}, where the determinant $\\Delta$ is 0: {dead}." if dead else ""
        signs = ", ".join(f"${self.latex[name]}$" for name in self.branches)
        centres += (" At change points both branches of a loop meet. With a velocity it keeps its rates there and goes through,"
                    f" by which the sign {signs} of its branch changes.") * bool(signs)
        text = (f"The input is the {escaped(self.input.coordinate)} ${x}$ of {escaped(self.input.item)}, 0 as drawn, with its"
                f" rates ${dx}$ and ${ddx}$. Every body follows from it without iteration. Rates are the derivatives of the"
                " formulas, and of the closure where a loop closes"
                f"{'' if self.without else '; $f$ are the forces of the other laws at this motion'}.{centres}")
        return Section("Motion over the input", [Paragraph(text), *blocks, *self.dead_centres()])

    # -- one turn of the input

    def branches_of(self, q: Any, u: Any) -> dict[str, Any]:
        """The signs (nt,) of all branches on which states are."""
        return {name: np.where(b.start * self.at_states(b.side, q, u) >= 0, 1.0, -1.0) for name, b in self.branches.items()}

    def off_change_points(self, at: Any) -> Any:
        """Whether values of the input are off all change points."""
        far = np.ones(np.shape(at), dtype=bool)
        for b in self.branches.values():
            for x in b.points:
                away = (at - x + b.period / 2) % b.period - b.period / 2 if b.period else at - x
                far &= np.abs(away) > AROUND * (2 * np.pi if b.period else self.prepared.length)
        return far

    def _crossings(self, of: Any, at: Any) -> list[float]:
        """Values of the input at which a function of `along` changes its sign, refined to round-off."""
        found, v = list[float](), np.broadcast_to(of(self.along(at)), at.shape)
        noise = max(1e-12, 1e-9 * np.max(np.abs(v), where=np.isfinite(v), initial=0.0))
        for i in np.flatnonzero(np.isfinite(v[1:] + v[:-1]) & ((v[1:] >= 0) != (v[:-1] >= 0))):
            if max(abs(v[i]), abs(v[i + 1])) < noise:
                continue
            low, high = at[i], at[i + 1]
            for _ in range(12):
                grid = np.linspace(low, high, 11)
                w = of(self.along(grid))
                first = int(np.argmax((w[1:] >= 0) != (w[:-1] >= 0)))
                low, high = grid[first], grid[first + 1]
            found.append(float(low))
        return found

    def _open(self, at: Any) -> Any:
        """Numbers of the values of the input at which a loop does not close."""
        closes = np.all([np.isfinite(v) for v in self.along(at).values()], axis=0)
        return np.flatnonzero(~closes & self.off_change_points(at))

    def dead_centres(self) -> list[Block]:
        """Table of the places over one turn where a dyad is at a dead centre or change point, and where what is joined to the
        ground stands still."""
        at, rows, formulas = np.union1d(self.turn(), self.lowest), list[tuple[float, str]](), dict(self.formulas)
        start, period, open_ = self.start_of(self.inputs[0]), self.period(), self._open(at)
        (low, high), closes = at[[0, -1]], not len(open_)
        if not closes:  # what lies beyond the first dead centres is not reached
            at = np.union1d(at - period, at)
            open_ = self._open(at)
            first, last = max(open_[at[open_] < start], default=0), min(open_[at[open_] >= start], default=len(at))
            at = at[first : last + 1]
        off = self.off_change_points(at)
        for name, dead in self.limits.items():
            under = next(e for e in (formulas[name], *formulas[name].args) if e.is_Pow).args[0]
            rows += [(x, f"dead centre: {dead}; the input goes no further")
                     for x in self._crossings(lambda table, e=under: self._of(table, e), at[off])]
        if not closes:
            low, high = max([at[0], *(x for x, _ in rows if x < start)]), min([at[-1], *(x for x, _ in rows if x > start)])
        for name, dead in self.limits.items():
            rows += [(x + n, what) for x, what in meetings(self, f"br{name[1:]}", dead) for n in {0.0, -period * (not closes)}]
        rows += [(x, f"dead centre: {dead}") for name, dead in self.apart.items() if dead
                 for x in self._crossings(lambda table, name=name: table[name], at[off])]
        for link in self.links:
            if link.item != self.input.item and self._shown(link):
                rate = self._rate_of(link)
                if rate.free_symbols:
                    what = f"the {escaped(link.coordinate)} of {escaped(link.item)} turns back"
                    rows += [(x, what) for x in self._crossings(lambda table, e=rate: self._of(table, e), at[off])]
        unit, x = ("rad" if self.input.turn else "m"), self.latex[str(self.inputs[0])]
        over = {0: "", 1: "one turn, ", 2: "two turns, after which it is on its first branch again, "}[
            round(self.period() / (2 * np.pi))] + f"${x}$ from {low:.6g} to {high:.6g} {unit}"
        told = (f"{'The loops close at every value of' if self.apart else 'Nothing limits'} the input over {over}." if closes else
                f"The loops do not close at every value of the input. Reachable from the start: ${x}$ from {low:.6g} to"
                f" {high:.6g} {unit}.")
        rows = [(v, what) for v, what in rows if closes or low <= v <= high]
        table = [Table([f"${x}$ [{unit}]", "what is there"], [[f"{v:.6f}", what] for v, what in sorted(rows)])] if rows else []
        return [Paragraph(told), *table]

    def _shown(self, link: Any) -> bool:
        """Whether it is said where the coordinate of a joint turns back."""
        return None in (link.k, link.l)

    def _rate_of(self, link: Any) -> Expr:
        """The rate of the coordinate of a joint."""
        return self.rate(self._amount(link))

    # -- the checks

    def on_input(self) -> tuple[Any, Any, Any, Any]:
        """States at which the loops close: at the start and places of the input near it, or at times where it is prescribed.
        Places beyond a dead centre are left out."""
        start, scene = self.prepared.start, self.prepared.model.scene
        driven = [e for c in scene.joints if c.name == self.input.item for e in c.prescribed.values()]
        t = np.full(POINTS, start.t)
        size, rates = 0.2 if self.input.turn else 0.05 * self.prepared.length, np.linspace(1.0, 2.0, POINTS)
        amounts = self.start_of(self.inputs[0]) + size * np.linspace(0, 1, POINTS)
        if driven:
            t = start.t + self.prepared.time * np.linspace(0, 1, POINTS)
            amounts, rates = (np.array([f(driven[0], x) for x in t]) for f in (timed.value_at, timed.rate_at))
        q, u = self.states_of(self.along(amounts, rates))
        closed = np.isfinite(q).all(1) & np.isfinite(u).all(1) & self.off_change_points(amounts)
        return t[closed], q[closed], u[closed], np.tile(start.s, (np.sum(closed), 1))

    def states_of(self, table: dict[str, Any]) -> tuple[Any, Any]:
        """Positions and velocities (nt, n) of the scene by the symbols of its coordinates."""
        q, u = (np.stack([table[f"x{i}{d}"] for i in range(len(self.prepared.start.u))], 1) for d in ("", "d"))
        return q, u

    def printed(self, blocks: list[Block]) -> list[Check]:
        """Checks of the formulas of the motion and of the forces over the input, and of the forces at random states."""
        t, q, u, s = self.on_input()
        if not len(t):
            told = "the loops close at a place of the input where the formulas are compared"
            return [*super().printed(blocks[1:]), Check(told, float("inf"))]
        closed = [("positions", self.m.position_residual(t, q)), ("velocities", self.m.velocity_residual(t, q, u))]
        rows = [Check(f"the rows of the scene vanish at the {what} over the input", residual(v, np.zeros_like(v)))
                for what, v in closed]
        over = self.read_at(blocks, t, q, u, s)[0]
        return [*super().printed(blocks[1:]), *rows, *over]

    # -- beside a run

    def beside(self, result: Any, blocks: list[Block]) -> tuple[Section, list[Check]]:
        """Section with the joint forces by the printed formulas over the input and those of a run, and a failed check for each
        that differs by more than `OF_ERROR` times the run's own error and its accuracy, in some piece of times one after the
        other at which they are compared: beside a change point the run's error is large."""
        t, (q, u, s) = result.t, result._states
        printed, table, curves, wrong = self.read_at(blocks, t, q, u, s)[1], list[list[str]](), list[Block](), list[Check]()
        x = np.real(printed.value(key_of(self.latex[str(self.inputs[0])])))
        near, places = passed(self, t, x, np.real(printed.value(key_of(self.latex[str(self.inputs[1])]))), q, u)
        of, root = printed.stated & ~near, self._least_root(q, u)
        at = np.flatnonzero(of)
        pieces = [p for p in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1) if len(p)]
        period = self.period() if np.ptp(x) > self.period() else 0.0
        within = f", within {'one turn' if period < 7 else 'two turns'}" if period else ""
        under = f"{self.input.coordinate}{within} [{'rad' if self.input.turn else 'm'}]"
        for letter, item in dict.fromkeys((letter, item) for letter, item, _ in self.on_l):
            name, unit = ("force", "N") if letter == "F" else ("torque", "N m")
            told, own = getattr(result[item], name), np.zeros((len(t), 3))
            for i in (i for i in range(3) if (letter, item, i) in self.on_l):
                own[:, i] = np.real(np.broadcast_to(printed.value(key_of(self._force(letter, item, i))), (len(t),)))
            off, size = np.linalg.norm(own - told, axis=1), np.linalg.norm(told, axis=1)
            errors = errors_within(getattr(result, "whole", result), f"{item}.{name}", [t[piece] for piece in pieces])
            most = max(errors, default=0.0) if errors is not None else None
            table.append([f"{name} of {escaped(item)}", unit, f"{np.max(size[of], initial=0.0):.6g}",
                          f"{np.max(off[of], initial=0.0):.2g}", "" if most is None else f"{most:.2g}"])
            for piece, error in zip(pieces, errors or [], strict=False):
                least = (result.accuracy.asked or ROUND_OFF) * float(np.max(size[piece]))
                if not np.max((off * root**2)[piece]) <= OF_ERROR * max(error, least):
                    wrong.append(Check(f"from t = {t[piece[0]]:.4g} to {t[piece[-1]]:.4g} s the {name} of {escaped(item)} over"
                                       f" the input is {np.max(off[piece]):.2g} {unit} off that of the run, whose own error there"
                                       f" is {error:.2g} {unit}", float("inf")))
            if letter == "F":
                curves.append(Picture(curve(x, period, under, item, np.where(of, np.linalg.norm(own, axis=1), np.nan), size),
                                      f"Force of {escaped(item)} over ${self.latex['in']}${within}: line, the printed formulas;"
                                      " rings, the sensor of the run."))
        left = int(np.sum(~of))
        text = (f"The printed formulas at the {len(t)} times of a run, by the input and its rates there, and the run's sensors."
                + (f" {counted(left, 'time')} are left out: there a divisor is below {NEXT_TO_ZERO:g} of its terms, the root of"
                   f" a loop below {NEXT:g} of its terms, or the loop beyond a dead centre." if left else "")
                + places)
        verdict = "NOT EQUAL: " + "; ".join(c.what for c in wrong) + "." if wrong else (
            "No time is left at which they can be compared." if left == len(t) else
            "The run states no error of its own." if all(not row[-1] for row in table) else
            f"No difference is larger than {OF_ERROR:g} times the run's own error or its accuracy"
            + ("; beside a root $r$ of a loop, by its terms, $r^2$ of it counts, as the input's errors grow by $1/r^2$."
               if self.roots else "."))
        head = ["at these times", "unit", "largest of the run", "largest difference", "the run's own error"]
        curves = [Paragraph(f"{text} {verdict}"), Table(head, table), *curves]
        return Section("Joint forces over the input, beside a run", curves), wrong
