"""A planar mechanism over its input: positions, velocities, accelerations and joint forces as formulas of one coordinate, its
dead centres over one turn, and its joint forces beside those of a run."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Drawing, Paragraph, Picture, Section, Table, escaped
from mbdae.inputs import timed
from mbdae.reports.mechanisms.dyads import Dyads
from mbdae.reports.page import Check, Printed, Wanted
from mbdae.reports.reading import key_of
from mbdae.reports.scene_equations import parameter_unit
from mbdae.reports.scene_forces import RUN
from mbdae.reports.states import POINTS, residual
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.vectors import Expr
from mbdae.system.model.nodes import Instance, Node
from mbdae.system.prepare import Prepared

TURN = 361  #: places over one turn of the input at which dead centres are sought and curves drawn
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
                table[s] = self.constant(f"n{instance.item}{s}", rf"\text{{{s}}}_{{{self.names.said('item', instance.item)}}}",
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
        for latex, w in wanted.items():
            if w.source == RUN:
                got = np.broadcast_to(alone.value(key_of(latex)), (len(t),))
                checks.append(Check(f"${latex}$ by the input alone, {RUN}", residual(got[alone.stated], w.values[alone.stated])))
        return checks, alone

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
        for name in unused:
            self.said.pop(self.latex[name], None)
        x, dx, ddx = (self.latex[str(s)] for s in self.inputs)
        dead = "; ".join(dict.fromkeys(d for d in (*self.limits.values(), *self.apart.values()) if d))
        centres = f" Dead centres, where the determinant $\\Delta$ is 0: {dead}." if dead else ""
        text = (f"The input is the {escaped(self.input.coordinate)} ${x}$ of {escaped(self.input.item)}, 0 as drawn, with its"
                f" rates ${dx}$ and ${ddx}$. Every body follows from it without iteration. Rates are the derivatives of the"
                " formulas, and of the closure where a loop closes; $f$ are the forces of the other laws at this motion."
                f"{centres}")
        return Section("Motion over the input", [Paragraph(text), *blocks, *self.dead_centres()])

    # -- one turn of the input

    def along(self, at: Any, rate: Any = 1.0) -> dict[str, Any]:
        """Values of all symbols of the formulas at values of the input, with its rate and without second rate; NaN where a loop
        does not close."""
        table: dict[str, Any] = {name: np.full(len(at), x) for name, x in self.constants.items()}
        inputs = np.asarray(at), np.broadcast_to(rate, np.shape(at)), np.zeros(len(at))
        table |= dict(zip(map(str, self.inputs), inputs, strict=True))
        with np.errstate(all="ignore"):
            for name, e in self.formulas:
                try:
                    table[name] = np.broadcast_to(self._of(table, e), np.shape(at))
                except KeyError:
                    continue  # letters of the balances, which no motion defines
        return table

    def turn(self) -> Any:
        """Values of the input: one turn from the start, or for a displacement the length of the scene to both sides."""
        start = self.start_of(self.inputs[0])
        size = self.prepared.length
        return start + (np.linspace(0, 2 * np.pi, TURN) if self.input.turn else np.linspace(-size, size, TURN))

    def _crossings(self, of: Any, at: Any) -> list[float]:
        """Values of the input at which a function of `along` changes its sign, refined to round-off."""
        found, v = list[float](), np.broadcast_to(of(self.along(at)), at.shape)
        if np.max(np.abs(v), where=np.isfinite(v), initial=0.0) < 1e-12:
            return found
        for i in np.flatnonzero(np.isfinite(v[1:] + v[:-1]) & ((v[1:] >= 0) != (v[:-1] >= 0))):
            low, high = at[i], at[i + 1]
            for _ in range(12):
                grid = np.linspace(low, high, 11)
                w = of(self.along(grid))
                first = int(np.argmax((w[1:] >= 0) != (w[:-1] >= 0)))
                low, high = grid[first], grid[first + 1]
            found.append(float(low))
        return found

    def dead_centres(self) -> list[Block]:
        """Table of the places over one turn where a dyad is at a dead centre, and where what is joined to the ground stands
        still."""
        at, rows, formulas = self.turn(), list[tuple[float, str]](), dict(self.formulas)
        for name, dead in self.limits.items():
            inside = formulas[name].args[0]
            rows += [(x, f"dead centre: {dead}; the input goes no further")
                     for x in self._crossings(lambda table, e=inside: self._of(table, e), at)]
        for link in self.links:
            if link.item != self.input.item and self._shown(link):
                rate = self._rate_of(link)
                if rate.free_symbols:
                    what = f"the {escaped(link.coordinate)} of {escaped(link.item)} turns back"
                    rows += [(x, what) for x in self._crossings(lambda table, e=rate: self._of(table, e), at)]
        closed = all(np.isfinite(v).all() for v in self.along(at).values())
        over = "one turn" if self.input.turn else f"{at[-1] - at[0]:.4g} m"
        told = f"The loops close at every value of the input over {over}."
        unit, x = ("rad" if self.input.turn else "m"), self.latex[str(self.inputs[0])]
        table = [Table([f"${x}$ [{unit}]", "what is there"], [[f"{v:.6f}", what] for v, what in sorted(rows)])] if rows else []
        return [Paragraph(told if closed else "The loops do not close at every value of the input:"), *table]

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
        closed = np.isfinite(q).all(1) & np.isfinite(u).all(1)
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

    def beside(self, result: Any, blocks: list[Block]) -> Section:
        """Section with the joint forces by the printed formulas over the input, and those of a run."""
        t, (q, u, s) = result.t, result._states
        checks, printed = self.read_at(blocks, t, q, u, s)
        worst = max((c.residual for c in checks if RUN in c.what), default=0.0)
        x = np.real(printed.value(key_of(self.latex[str(self.inputs[0])])))
        rows = []
        for item in dict.fromkeys(item for letter, item, _ in self.on_l if letter == "F"):
            keys = [key_of(self._force("F", item, i)) for place in self.on_l for i in range(3) if place == ("F", item, i)]
            rows.append((item, np.sqrt(sum(np.real(np.broadcast_to(printed.value(k), (len(t),))) ** 2 for k in keys)),
                         np.linalg.norm(result[item].force, axis=1)))
        at = x % (2 * np.pi) if self.input.turn else x
        curves = [Picture(_curve(at, *row, self.input.turn != 0), f"Force of {escaped(row[0])} over ${self.latex['in']}$: line,"
                          " the printed formulas; rings, the sensor of the run.") for row in rows]
        table = [[escaped(item), f"{np.max(b):.6g}", f"{np.max(np.abs(a - b)[printed.stated], initial=0.0):.2g}"]
                 for item, a, b in rows]
        text = (f"The printed formulas at the {len(t)} times of a run, by the input and its rates there, and the sensors of the"
                f" run. Largest relative difference of a multiplier or joint force {worst:.1e}; the run's own error bounds it.")
        head = ["joint", "largest force of the run [N]", "largest difference [N]"]
        return Section("Joint forces over the input, beside a run", [Paragraph(text), Table(head, table), *curves])


def _curve(x: Any, item: str, line: Any, dots: Any, turns: bool) -> Drawing:
    """A force over the input: a line, and the run's values as rings."""
    wide, high, order = 560.0, 200.0, np.argsort(x)
    low, top = float(np.min(x)), float(max(np.max(line[np.isfinite(line)]), np.max(dots)) or 1.0)
    size = float(np.ptp(x)) or 1.0
    drawing = Drawing(wide, high, f"force of {item} over the input")
    place = [((v - low) / size * wide, high * (1 - f / top))
             for v, f in zip(x[order], line[order], strict=True) if np.isfinite(f)]
    drawing.line([(0, 0), (0, high), (wide, high)], "#999")
    drawing.line(place, "#0072b2", 1.5)
    for i in order[:: max(1, len(x) // 40)]:
        a, b = (x[i] - low) / size * wide, high * (1 - dots[i] / top)
        drawing.line([(a + 3 * np.cos(w), b + 3 * np.sin(w)) for w in np.linspace(0, 2 * np.pi, 13)], "#d55e00")
    drawing.text(0, -8, f"{top:.4g} N", "start")
    drawing.text(wide, high + 18, f"{low + size:.4g} {'rad' if turns else 'm'}", "end")
    drawing.text(0, high + 18, f"{low:.4g}", "start")
    drawing.fit()
    return drawing
