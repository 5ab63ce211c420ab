"""Friction and normal laws: scalar laws of a sliding velocity or a penetration, with their limits and power."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents.blocks import Block, Equation, Paragraph, Picture, Section, Table
from mbdae.documents.document import Document
from mbdae.documents.svg import curve
from mbdae.laws.contact import JournalContact
from mbdae.laws.forces import JointFriction
from mbdae.laws.friction import Friction
from mbdae.reports.common import LawFormulas, described
from mbdae.reports.evaluate import value
from mbdae.reports.letters import Letter, of_name, unit_text
from mbdae.reports.statement import Statement, derived, structure_of
from mbdae.reports.vectors import Record
from mbdae.reports.writer import Writer
from mbdae.symbolic.fingerprint import fingerprint
from mbdae.symbolic.law import Force
from mbdae.symbolic.part import Part, PartStructure

POINTS = 200


class PartReport:
    """A friction or normal law with symbols for its parameters."""

    def __init__(self, structure: PartStructure) -> None:
        self.structure, self.part = structure, structure.symbolic("")
        for p in structure.cls.params:  # names without that of the law the part belongs to
            if p not in structure.absent:
                setattr(self.part, p, se.Symbol(p))
        self.known = {p: Letter(of_name(p, spec.unit), spec.unit, spec.meaning) for p, spec in structure.cls.params.items()}
        self.known |= {
            f"state_{n}": Letter(of_name(n, spec.unit), spec.unit, f"{spec.meaning}, internal state")
            for n, spec in structure.cls.states.items()
        }
        self.known |= {
            "v": Letter("v", "m/s", "sliding velocity of l relative to k, signed"),
            "a": Letter("a", "m", "penetration, 0 apart"),
            "a_rate": Letter(r"\dot a", "m/s", "rate of the penetration"),
        }
        self.writer = Writer(Record(), {name: letter.latex for name, letter in self.known.items()})

    def symbols(self) -> Table:
        """Symbols used."""
        return Table(["symbol", "unit", "meaning"], [self.known[n].row for n in sorted(self.writer.used)])

    def sections(self) -> list[Section]:
        """Law, limits, power."""
        return self.friction() if isinstance(self.part, Friction) else self.normal()

    def friction(self) -> list[Section]:
        """A coefficient of the sliding velocity."""
        part: Any = self.part
        v, w = se.Symbol("v"), self.writer
        mu, rates = part.coefficient(v), part.rate(v)
        law: list[Block] = [
            Paragraph("Friction force on l along the tangent and its power on the bodies:"),
            Equation(r"f_t = -\mu(v)\,f_n \\ P = f_t\,v = -\mu(v)\,v\,f_n"),
            Equation(f"\\mu(v) = {w.scalar(mu)}"),
        ]
        for name, rate in rates.items():
            start = part.initial(v)[name]
            latex = self.known[f"state_{name}"].latex
            law.append(Equation(f"\\dot{{{latex}}} = {w.scalar(rate)} \\\\ {latex}(0) = {w.scalar(start)}"))
        return [
            Section("Law", law),
            Section("Limits", self._limits(mu, rates)),
            Section("Power and sign", self._power(mu, rates)),
        ]

    def _steady(self, rates: dict[str, Any]) -> dict[Any, Any]:
        """States at rest, for rates linear in their state."""
        found = {}
        for name, rate in rates.items():
            s = se.Symbol(f"state_{name}")
            free = rate.subs({s: 0})
            found[s] = -free / se.expand(rate.subs({s: 1}) - free)
        return found

    def _limits(self, mu: Any, rates: dict[str, Any]) -> list[Block]:
        v, w, values = se.Symbol("v"), self.writer, self._values()
        blocks: list[Block] = []
        steady = mu
        if rates:
            at = self._steady(rates)
            for s, e in at.items():
                blocks.append(
                    Equation(
                        f"{self.known[str(s)].latex}_\\infty = {w.scalar(e)}",
                        note="steady value at a constant velocity, where the rate vanishes",
                    )
                )
            steady = mu.subs(at)
        scale = self._velocity(values)
        rows = []
        for over in (-1e3, -1.0, -1e-3, 1e-3, 1e-1, 1.0, 10.0, 1e3):
            rows.append([f"{over:g}", f"{self._at(steady, values, v, np.array([over * scale]))[0]:.5g}"])
        given = ", ".join(
            f"${self.known[k].latex} = {val:g}$ {unit_text(self.known[k].unit) if self.known[k].unit != '1' else ''}".strip()
            for k, val in values.items()
        )
        blocks.append(Table(["$v$ over its scale", r"$\mu$"], rows, f"Steady coefficient for {given}"))
        x = np.linspace(-4, 4, 161)
        x = x[x != 0]
        y = self._at(steady, values, v, x * scale)
        blocks.append(
            Picture(
                curve(x, y, "v over its scale", "steady coefficient"), "Steady friction coefficient over the sliding velocity."
            )
        )
        return blocks

    def _power(self, mu: Any, rates: dict[str, Any]) -> list[Block]:
        rng, v, values = np.random.default_rng(3), se.Symbol("v"), self._values()
        scale = self._velocity(values)
        x = rng.normal(size=POINTS) * 3 * scale
        states = {se.Symbol(f"state_{n}"): -se.Symbol(f"state_{n}") for n in self.structure.cls.states}
        mirrored = mu.subs({v: -v, **states})
        state = {str(s): rng.normal(size=POINTS) * self._state_scale(values) for s in states}
        one, other = (self._at(e, values, v, x, state) for e in (mu, mirrored))
        oddness = float(np.max(np.abs(one + other)) / max(1.0, np.max(np.abs(one))))
        steady = mu.subs(self._steady(rates)) if rates else mu
        power = self._at(steady, values, v, x) * x
        sign = "never negative" if np.min(power) >= 0 else "NEGATIVE SOMEWHERE"
        blocks: list[Block] = [
            Paragraph(
                f"$\\mu(-v) = -\\mu(v)$ with internal states reversed: largest difference {oddness:.1e} at {POINTS} random"
                " states."
            ),
            Paragraph(
                f"Dissipated power over normal force $\\mu\\,v$ of steady sliding: {sign} at {POINTS} random velocities "
                f"(least {np.min(power):.2g} m/s)."
            ),
        ]
        if rates:
            blocks.append(
                Paragraph("While the internal state changes, it stores and releases energy: the power may have either sign.")
            )
            part: Any = self.part
            stored = part.stored(v)
            if stored != 0:
                blocks.append(
                    Equation(f"e = {self.writer.scalar(stored)}", note="energy stored by the state over the normal force, m")
                )
        return blocks

    def _values(self) -> dict[str, float]:
        typical = {"mu_k": 0.3, "mu_s": 0.5, "v_s": 1e-3, "sigma0": 1e5, "sigma1": 300.0, "sigma2": 0.4, "mu": 0.3, "v_c": 1e-3}
        return {p: typical.get(p, 1.0) for p in self.structure.cls.params if p not in self.structure.absent}

    def _velocity(self, values: dict[str, float]) -> float:
        return values.get("v_c", values.get("v_s", 1.0))

    def _state_scale(self, values: dict[str, float]) -> float:
        return values.get("mu_k", 1.0) / values.get("sigma0", 1.0)

    @staticmethod
    def _at(e: Any, values: dict[str, float], v: Any, x: Any, state: dict[str, Any] | None = None) -> Any:
        table = {**{k: np.full(len(x), val) for k, val in values.items()}, **(state or {}), str(v): x}
        return np.broadcast_to(value(se.sympify(e), lambda s: table[str(s)]), (len(x),))

    def _damping_sign(self, power: Any) -> str:
        """The sign of the power of damping at random penetrations and rates."""
        rng = np.random.default_rng(8)
        values = dict.fromkeys(self._values(), 1.0)
        lost = self._at(power, values, se.Symbol("a"), rng.uniform(0, 1, POINTS), {"a_rate": rng.normal(size=POINTS)})
        sign = "never negative" if np.min(lost) >= 0 else "NEGATIVE SOMEWHERE"
        return f"dissipated power where the force is not limited to zero, W: {sign} at {POINTS} random penetrations and rates"

    def normal(self) -> list[Section]:
        """A force of the penetration."""
        part: Any = self.part
        a, rate, w = se.Symbol("a"), se.Symbol("a_rate"), self.writer
        V, damped = part.energy(a), part.damping_force(a, rate)
        elastic = part.elastic_force(a)
        law: list[Block] = [
            Paragraph("For a penetration $a > 0$ (nothing acts where $a \\le 0$):"),
            Equation(f"V = {w.scalar(V)}"),
            Equation(f"f_n = \\max\\left(0,\\ {w.scalar(elastic)}{' + ' + w.scalar(damped) if damped != 0 else ''}\\right)"),
        ]
        text = (
            "The elastic part is $\\mathrm{d}V/\\mathrm{d}a$, continuous with its first derivative at $a = 0$ where the exponent"
            " exceeds 1; the force never pulls."
        )
        blocks: list[Block] = [Paragraph(text)]
        if damped != 0:
            blocks.append(Equation(f"P = {w.scalar(damped * rate)}", note=self._damping_sign(damped * rate)))
        x = np.linspace(0, 1, 101)
        y = self._at(elastic, dict.fromkeys(self._values(), 1.0), a, x)
        blocks.append(
            Picture(curve(x, y, "penetration", "elastic force"), "Elastic force over the penetration, both over their scale.")
        )
        return [Section("Law", law), Section("Limits and power", blocks)]


def part_sections(s: Statement, formulas: LawFormulas) -> list[Section]:
    """The friction and normal laws a law contains, each with its own symbols."""
    out = []
    for key, structure in s.structure.options:
        if isinstance(structure, PartStructure):
            r = PartReport(structure)
            sections = r.sections()
            word = {"normal": "Normal law", "friction": "Friction law"}.get(key, key)
            out.append(Section(f"{word}: {structure.cls.__name__}", [*described(structure.cls), r.symbols(), *sections]))
    return out


def part_report(cls: type[Part], structure: PartStructure) -> Document:
    """The report of a friction or normal law."""
    r = PartReport(structure)
    sections = r.sections()
    what = "friction" if issubclass(cls, Friction) else "normal law"
    return Document(
        f"{cls.__name__} {what}", [*described(cls), Section("Symbols", [r.symbols()]), *sections, *part_origin(cls, structure)]
    )


def part_origin(cls: type[Part], structure: PartStructure) -> list[Block]:
    """The section on the origin: the hash of a law that contains it, as it is integrated."""
    user: type[Force] = JointFriction if issubclass(cls, Friction) else JournalContact
    options = {"friction": structure} if issubclass(cls, Friction) else {"normal": structure, "friction": None}
    d = derived(user, structure_of(user, options))
    return [
        Section(
            "Origin",
            [
                Paragraph(
                    f"This report was made from the object that is integrated, `{cls.__module__}.{cls.__qualname__}`. The sha256"
                    f" of the derived equations of `{user.__name__}` with it, between two bodies in space, is:"
                ),
                Paragraph(f"`{fingerprint(d)}`"),
            ],
        )
    ]

