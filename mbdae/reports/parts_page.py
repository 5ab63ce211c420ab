"""Reports of friction laws and normal laws: the equations, limits and power that concern them in a law that contains them; and of
bodies, by their kinetic energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import symengine as se

from mbdae.documents import Document
from mbdae.documents.blocks import Block, Drawing, Paragraph, Picture, Point, Section, Table
from mbdae.kernels.plan import plan
from mbdae.laws.friction import Friction
from mbdae.laws.joints import Prismatic
from mbdae.laws.journal import JournalContact
from mbdae.laws.on_coordinates import JointFriction
from mbdae.reports.law_page import LawPage, Shown
from mbdae.reports.letters import Letter, letters, unit_text
from mbdae.reports.page import BALANCE, DERIVED, KERNEL, Page, described, document, made_from, provenance, short_hash, title_of
from mbdae.reports.statement import ReportedLaw, structure_of
from mbdae.reports.states import POINTS, STEP, random_state, value
from mbdae.reports.vectors import NamedQuantities
from mbdae.reports.writer import Writer
from mbdae.symbolic.derive import derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Element, Structure
from mbdae.symbolic.outputs import dynamics, fingerprint
from mbdae.symbolic.part import PartStructure, params
from mbdae.symbolic.vectors import Expr

TYPICAL = {"mu_k": 0.3, "mu_s": 0.5, "v_s": 1e-3, "sigma0": 1e5, "sigma1": 300.0, "sigma2": 0.4, "mu": 0.3, "v_c": 1e-3}
SLIDING = {"joint": Prismatic, "coordinate": "displacement", "kept": True}
CENTRED = {"friction": None, "length": None}


class Coefficient(Friction):
    """A friction law with an unspecified coefficient, to separate the coefficient's own equations from the rest."""

    params = params(mu=("1", "signed friction coefficient"))

    def coefficient(self, v: Expr) -> Expr:
        return self.mu


class PartPage(LawPage):
    """A friction law in a sliding joint, or a normal law in a journal contact: the equations that concern it."""

    def __init__(self, structure: PartStructure) -> None:
        self.part, self.key = structure, "friction" if issubclass(structure.cls, Friction) else "normal"
        self.user: Any = JointFriction if self.key == "friction" else JournalContact
        options = SLIDING | {"friction": structure} if self.key == "friction" else CENTRED | {"normal": structure}
        s = ReportedLaw(self.user, structure_of(self.user, options))
        super().__init__(s, "law", state=random_state(s.derived, spread=0.4))
        self.symbolic: Any = structure.symbolic(self.key)

    def document(self) -> Document:
        """The report of the friction or normal law."""
        cls = self.part.cls
        text = (f"{made_from(cls, 'object')}, in the law `{self.user.__name__}`. The sha256 of the derived equations of that law"
                " with it, between two bodies in space, is:")
        origin = Section("Origin", [Paragraph(text), Paragraph(f"`{fingerprint(self.d)}`")])
        blocks = self.friction() if self.key == "friction" else self.normal()
        what = "friction" if self.key == "friction" else "normal law"
        return document(f"{cls.__name__} {what}", described(cls), [(self, blocks)], "", [origin])

    # -- friction

    def friction(self) -> list[Block]:
        """Sections on a friction force given by a coefficient of the sliding velocity: law, limits, power."""
        (c,) = self.s.coordinates.values()
        v = self.s.clock[c]
        self.known |= {str(v): Letter("v", "m/s", "sliding velocity of l relative to k, signed"),
                       "normal_force": Letter("f_n", "N", "normal force, which presses l on k"),
                       "mu": Letter(r"\mu", "1", "signed friction coefficient")}
        self.refresh()
        plain = ReportedLaw(self.user, structure_of(self.user, SLIDING | {"friction": Coefficient(mu=1).structure()}))
        named = {se.Symbol("friction_mu"): se.Symbol("mu")}
        push = plain.thrust[1] if plain.thrust else se.Integer(0)
        push = se.sympify(plain.record.scalars.get(push, push)).subs(named)
        loss = -plain.derived.dissipated_power.subs(plain.derived.variation.insertion()).subs(named)
        row = self.compiled(dynamics)["u", self.s.places["displacement"], 0]
        mu = self.symbolic.coefficient(v)
        lines = [self.line("f_t", push, -row, KERNEL), self.line("P", loss, -self.state.scalar(self.d.dissipated_power), BALANCE),
                 self.line(r"\mu", mu, row / self.state.given["normal_force"], KERNEL)]
        out = self.told("Friction force on l along the tangent, and its power on the bodies:", *lines)
        rates = [Shown(r"\mu", "1", mu, lambda state: state.scalar(mu))]
        for i, (name, rate) in enumerate(self.symbolic.rate(v).items()):
            latex, start = self.known[f"state_{name}"].latex, self.symbolic.initial(v)[name]
            out += self.lines(self.line(rf"\dot{{{latex}}}", rate, self.state.scalar(self.d.state_rates[i]), DERIVED),
                              self.line(f"{latex}(0)", start, self.state.scalar(self.d.state_starts[i]), DERIVED))
        return [Section("Law", out), *self.by_parameters(rates, "friction_"), Section("Limits", self._limits(mu, v)),
                Section("Power and sign", self._power(mu, v))]

    def _steady(self, v: Expr) -> dict[Any, Any]:
        """Internal states at constant velocity, where their rates vanish; only for rates that are linear in their state."""
        found = {}
        for name, rate in self.symbolic.rate(v).items():
            s = se.Symbol(f"state_{name}")
            free = rate.subs({s: 0})
            found[s] = -free / se.expand(rate.subs({s: 1}) - free)
        return found

    def _limits(self, mu: Expr, v: Expr) -> list[Block]:
        values, at, blocks = self._values(), self._steady(v), list[Block]()
        for s, e in at.items():
            latex = f"{self.known[str(s)].latex}_\\infty"
            name = str(s).removeprefix("state_")
            rate = self.symbolic.rate(v)[name].subs({s: e})
            worst = f"{np.max(np.abs(self.state.scalar(rate))):.0e}"
            line = self.line(latex, e, self.state.scalar(e), f"the rate vanishes there to {worst}")
            blocks += self.lines(line, note="steady value at a constant velocity, where the rate vanishes")
        steady, scale = mu.subs(at), self._velocity(values)
        rows = [[f"{over:g}", f"{self._at(steady, values, v, np.array([over * scale]))[0]:.5g}"]
                for over in (-1e3, -1.0, -1e-3, 1e-3, 1e-1, 1.0, 10.0, 1e3)]
        units = {k: "" if self.known[k].unit == "1" else unit_text(self.known[k].unit) for k in values}
        given = ", ".join(f"${self.known[k].latex} = {val:g}$ {units[k]}".strip() for k, val in values.items())
        blocks.append(Table(["$v$ over its scale", r"$\mu$"], rows, f"Steady coefficient for {given}"))
        x = np.linspace(-4, 4, 161)
        x = x[x != 0]
        y = self._at(steady, values, v, x * scale)
        caption = "Steady friction coefficient over the sliding velocity."
        return [*blocks, Picture(curve(x, y, "v over its scale", "steady coefficient"), caption)]

    def _power(self, mu: Expr, v: Expr) -> list[Block]:
        rng, values = np.random.default_rng(3), self._values()
        scale = self._velocity(values)
        x = rng.normal(size=200) * 3 * scale
        states = {se.Symbol(f"state_{n}"): -se.Symbol(f"state_{n}") for n in self.part.cls.states}
        size = values.get("friction_mu_k", 1.0) / values.get("friction_sigma0", 1.0)
        state = {str(s): rng.normal(size=200) * size for s in states}
        one, other = (self._at(e, values, v, x, state) for e in (mu, mu.subs({v: -v, **states})))
        oddness = float(np.max(np.abs(one + other)) / max(1.0, np.max(np.abs(one))))
        power = self._at(mu.subs(self._steady(v)), values, v, x) * x
        sign = "never negative" if np.min(power) >= 0 else "NEGATIVE SOMEWHERE"
        blocks: list[Block] = [
            Paragraph(f"Reversed velocity and states reverse $\\mu$: largest difference {oddness:.1e} at 200 random states."),
            Paragraph(f"Dissipated power over normal force, $\\mu\\,v$ of steady sliding: {sign} at 200 random velocities."),
        ]
        stored = self.symbolic.stored(v)
        if states:
            text = "While the internal state changes, it stores and releases energy: the power may have either sign."
            blocks.append(Paragraph(text))
        if stored != 0:
            line = self.line("e", stored, self.state.scalar(stored), DERIVED)
            blocks += self.lines(line, note="energy stored by the state over the normal force, m")
        return blocks

    def _values(self) -> dict[str, float]:
        return {f"{self.key}_{p}": TYPICAL.get(p, 1.0) for p in self.part.cls.params if p not in self.part.absent}

    def _velocity(self, values: dict[str, float]) -> float:
        return values.get("friction_v_c", values.get("friction_v_s", 1.0))

    @staticmethod
    def _at(e: Any, values: dict[str, float], v: Any, x: Any, state: dict[str, Any] | None = None) -> Any:
        table = {**{k: np.full(len(x), val) for k, val in values.items()}, **(state or {}), str(v): x}
        return np.broadcast_to(value(se.sympify(e), lambda s: table[str(s)]), (len(x),))

    # -- normal force

    def normal(self) -> list[Block]:
        """Sections on a force that depends on the penetration, as in the contact of a journal: law, limits and power."""
        record, n = self.s.record, self.numbers()
        stated = self.d.law.observed(*self.d.sides)["normal_force"][0]
        force = self.s.scalar(self.s.law.observed(*self.s.frames)["normal_force"][0])
        energy = self.s.energy
        given = {"a": Letter("a", "m", "penetration, 0 apart"), r"\dot a": Letter(r"\dot a", "m/s", "rate of the penetration")}
        for symbol in record.scalars:
            label = record.labels.get(symbol, "")
            if label in given:
                self.defined.add(("s", str(symbol)))
                self.known[str(symbol)] = given[label]
                self.state.given[str(symbol)] = np.broadcast_to(n.scalar(symbol), (POINTS,))
        self.refresh()
        a = next((s for s in record.scalars if record.labels.get(s) == "a"), se.Symbol("a"))
        elastic = self.symbolic.elastic_force(a)
        normal = self.state.scalar(self.d.variation.resolve(self.d.variation.name(stated)))
        lines = [self.line("V", energy, self.state.scalar(self.d.energy), DERIVED),
                 self.line("f_e", elastic, self._slope(energy, a), "the derivative of $V$ by a complex step"),
                 self.line("f_n", record.scalars.get(force, force), normal, DERIVED)]
        text = "For a penetration $a$ (0 where the surfaces are apart): potential, elastic force and normal force."
        x = np.linspace(0, 1, 101)
        y = self._at(elastic, dict.fromkeys(self._values(), 1.0), a, x)
        caption = "Elastic force over the penetration, both over their scale."
        picture = Picture(curve(x, y, "penetration", "elastic force"), caption)
        pressed = Shown("f_n", "N", record.scalars.get(force, force), self._pressed)
        return [self.section("Law", text, *lines), *self.by_parameters([pressed], "normal_"),
                Section("Limits and power", [Paragraph(self._lost(a)), picture])]

    def _pressed(self, state: Any) -> Any:
        """The normal force at states, by the derived law."""
        stated = self.d.law.observed(*self.d.sides)["normal_force"][0]
        return state.scalar(self.d.variation.resolve(self.d.variation.name(stated)))

    def _slope(self, energy: Expr, a: Expr) -> Any:
        """dV/da by a complex step."""
        def get(s: Expr) -> Any:
            return self.state.get(s) + 1j * STEP if s == a else self.state.get(s)

        return np.imag(value(se.sympify(energy), get)) / STEP

    def _lost(self, a: Expr) -> str:
        rate = se.Symbol("a_rate")
        damped = self.symbolic.damping_force(a, rate)
        if damped == 0:
            return "The law dissipates nothing; its force never pulls."
        rng = np.random.default_rng(8)
        rates = {"a_rate": rng.normal(size=200)}
        lost = self._at(damped * rate, dict.fromkeys(self._values(), 1.0), a, rng.uniform(0, 1, 200), rates)
        sign = "never negative" if np.min(lost) >= 0 else "NEGATIVE SOMEWHERE"
        return (f"The force never pulls. Its dissipated power $(f_n - f_e)\\,\\dot a$, where the force is not limited to zero, is"
                f" {sign} at 200 random penetrations and rates.")


def part_section(s: ReportedLaw) -> list[Section]:
    """Section on the friction and normal laws contained in a law, and the calls that report them."""
    parts = [(key, part, part.cls.__name__) for key, part in s.structure.options if isinstance(part, PartStructure)]
    rows = [[key, f"`mb.report(mb.{name}(...))`", short_hash(PartPage(part).d)] for key, part, name in parts]
    return [Section("Laws it contains", [Table(["law", "its report", "sha256 there"], rows)])] if rows else []


def curve(x: Any, y: Any, across: str, up: str) -> Drawing:
    """A curve y(x) with its axes; across, up: labels of the axes."""
    width, height, margin = 520, 260, 46
    low, high = min(0.0, float(min(y))), max(0.0, float(max(y)))
    span, first, last = (high - low) or 1.0, float(min(x)), float(max(x))

    def at(a: float, b: float) -> Point:
        return margin + (a - first) / (last - first) * (width - margin - 12), height - 34 - (b - low) / span * (height - 52)

    found = Drawing(width, height, f"{up} over {across}")
    found.line([at(first, 0), at(last, 0)], "#999")
    found.line([at(first, low), at(first, high)], "#999")
    found.line([at(float(a), float(b)) for a, b in zip(x, y, strict=True)], "#0072b2", 2)
    for number in dict.fromkeys((low, 0.0, high)):
        found.text(margin - 6, at(first, number)[1] + 4, f"{number:.3g}", "end")
    for number in (first, last):
        found.text(at(number, 0)[0], height - 18, f"{number:.3g}")
    found.text((width + margin) / 2, height - 4, across)
    found.text(margin + 6, 14, up, "start")
    return found


class ElementPage(Page):
    """The page of a body's law."""

    def __init__(self, law: type[Element], structure: Structure) -> None:
        self.d, self.flat = (derive(law, structure, ((k, Axes.GENERAL),)) for k in (NodeKind.SPATIAL, NodeKind.PLANAR))
        self.known = letters(law, structure, self.d.law)
        for i, axis in enumerate("xyz"):
            self.known |= {
                f"b_v{i + 1}": Letter(f"v_{axis}", "m/s", f"velocity of the centre, inertial {axis}"),
                f"b_W{i + 1}": Letter(f"\\Omega_{axis}", "rad/s", f"angular velocity about body {axis}"),
                f"b_w{i + 1}": Letter(f"\\omega_{axis}", "rad/s", f"angular velocity about inertial {axis}"),
                f"b_up{i + 1}": Letter(f"\\dot v_{axis}", "m/s^2", f"acceleration of the centre, inertial {axis}"),
                f"b_up{i + 4}": Letter(f"\\dot\\Omega_{axis}", "rad/s^2", f"angular acceleration about body {axis}"),
            }
        self.writer, self.wanted = Writer(NamedQuantities(), {name: letter.latex for name, letter in self.known.items()}), {}
        rng = np.random.default_rng(2)
        self.values: dict[str, Any] = {name: rng.uniform(0.5, 1.5, POINTS) for name in self.known}

    def given(self) -> dict[str, Any]:
        return {self.known[n].latex: v for n, v in self.values.items()}

    def document(self) -> Document:
        """The whole report."""
        cls = type(self.d.law)
        return document(title_of(cls), described(cls), [(self, self.blocks())], "", [provenance(self.d, self.flat)])

    def _run(self, values: dict[str, Any]) -> dict[Any, Any]:
        """Outputs of the compiled kernel by target; inputs without a letter are set to 0.3."""
        p = plan(self.d, dynamics)
        x = np.stack([values.get(str(s), np.full(POINTS, 0.3)) for s in p.all_inputs.symbols], -1)
        return dict(zip(p.targets, p.kernel.values(x).T, strict=True))

    def blocks(self) -> list[Block]:
        """Sections on the kinetic energy and the equations of motion that follow from it."""
        rows = dynamics(self.d)
        if not rows:
            return [Section("Kinetic energy", [Paragraph("The node has no inertia of its own.")])]
        speeds = [f"b_{'v' if i < 3 else 'W'}{i % 3 + 1}" for i in range(6)]
        still = {f"b_up{i + 1}": self.values[name] for i, name in enumerate(speeds)}
        linear = self._run(self.values | still | {f"b_W{i}": np.zeros(POINTS) for i in (1, 2, 3)})
        energy = sum(row * self.values[speeds[target[2]]] for target, row in linear.items()) / 2
        first = self.lines(self.line("T", self.d.energy, energy, "the compiled mass"))
        kernel, lines = self._run(self.values), []
        for target, e in rows:
            latex = f"{'f' if target[2] < 3 else 'm'}_{'xyz'[target[2] % 3]}"
            lines.append(self.line(latex, se.expand(e), kernel[target], KERNEL))
        text = (
            "$\\frac{\\mathrm{d}}{\\mathrm{d}t}\\frac{\\partial T}{\\partial\\mathbf{v}}$ in inertial axes, and "
            "$\\frac{\\mathrm{d}}{\\mathrm{d}t}\\frac{\\partial T}{\\partial\\boldsymbol{\\Omega}} + \\boldsymbol{\\Omega}\\times"
            "\\frac{\\partial T}{\\partial\\boldsymbol{\\Omega}}$ in body axes, on the left-hand side of the rows:"
        )
        return [Section("Kinetic energy", first), self.section("Rows of the equations of motion", text, *lines)]
