"""`mb.report`: the report of a law, a joint model or a scene.

Reports of laws without constraint rows: forces by an energy, a dissipation function or a wrench; bodies by kinetic energy.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import symengine as se

from mbdae import laws
from mbdae.documents import Document
from mbdae.documents.blocks import Block, Paragraph, Section
from mbdae.errors import LawError, OptionError, meant, naming_arguments
from mbdae.inputs.reduced import ReducedBody
from mbdae.laws.contact import Hertz, Normal
from mbdae.laws.friction import Coulomb, Friction, LuGre
from mbdae.laws.joint_rows import ClearanceRevolute
from mbdae.laws.joints import Revolute
from mbdae.laws.journal import JournalContact
from mbdae.notation import together
from mbdae.reports.calculus import summed
from mbdae.reports.joint_page import COORDINATES, FIXED, FRAMES, JointReport, want_efforts
from mbdae.reports.law_page import LawPage, Shown
from mbdae.reports.lecture import lecture, taught
from mbdae.reports.letters import Letter, effort_unit
from mbdae.reports.line_element import LineReport
from mbdae.reports.page import BALANCE, DERIVED, KERNEL, described, document, effort, provenance, title_of
from mbdae.reports.parts_page import ElementPage, PartPage, part_section
from mbdae.reports.recursive_page import recursive_report
from mbdae.reports.scene_sheet import modes_page, scene_sheet
from mbdae.reports.sections import figure_of, planar_pages, power_blocks, state_blocks, thrust_blocks
from mbdae.reports.statement import ReportedLaw, structure_of
from mbdae.reports.states import POINTS
from mbdae.results.result import Result
from mbdae.scene.components import Classical, Clearance, Connection, JointModel, Kinematic, Recursive
from mbdae.scene.scene import SceneData
from mbdae.symbolic.joint import Coupling, Joint
from mbdae.symbolic.law import Element, Force, Law, Structure, TwoBodyLaw
from mbdae.symbolic.line import LineLaw
from mbdae.symbolic.outputs import dynamics
from mbdae.symbolic.part import Part
from mbdae.values import option, shown, word


class ForceReport(LawPage):
    """The report of one force law."""

    def __init__(self, law: type[Force], structure: Structure) -> None:
        s = ReportedLaw(law, structure)
        _ = s.energy, s.dissipation, s.wrench
        self.losses = {name: s.scalar(e) for name, e in s.law.losses(*s.frames).items()}
        self.gaps = [(s.scalar(g), s.scalar(rate)) for g, rate in s.law.gaps(*s.frames)]
        super().__init__(s, "law")
        self.elastic = s.gradient(s.energy)
        self.external = bool(s.law.external)
        self.kernel = self.compiled(dynamics)
        for letter, side, i in self.letters():
            self.want(letter, -self.at_point(side, self.kernel)[i], KERNEL)
        want_efforts(self)

    def document(self) -> Document:
        """The whole report."""
        laws = [self._law(), self._forces(), *self._by_parameters()]
        sections = [*laws, *self._states(), *self._gaps(), self._power(), *part_section(self.s)]
        planar, none, flat = planar_pages(self)
        pages: list[tuple[Any, list[Block]]] = [(self, [*sections, *none]), *flat]
        of_k = any(base.side == "k" for base in self.writer.bases)  # gravity knows of no other body
        head = [*described(self.s.cls), *(figure_of(self.s) if of_k else [])]
        convention = " ".join([FRAMES] * of_k + [COORDINATES] * bool(self.s.coordinates) + [FIXED] * bool(self.s.sides))
        return document(title_of(self.s.cls), head, pages, convention, [provenance(self.d, planar)])

    def _derived(self, e: Any) -> Any:
        """Values of an expression of the derived law at the random states."""
        return self.state.scalar(self.d.variation.resolve(self.d.variation.name(e)))

    def _law(self) -> Section:
        """Energy, dissipation function, force and torque as the law states them."""
        s, law, sides, blocks = self.s, self.d.law, self.d.sides, list[Block]()
        if s.energy != 0:
            blocks += self.told("Potential energy, J:", self.line("V", s.energy, self.state.scalar(self.d.energy), DERIVED))
        if s.dissipation != 0:
            line = self.line("D", s.dissipation, self._derived(law.dissipation(*sides)), DERIVED)
            blocks += self.told("Rayleigh dissipation function, half the dissipated power, W:", line)
        if s.wrench is not None:
            parts = zip("FT", s.wrench, law.wrench(*sides), strict=True)
            lines = [self.line(rf"\mathbf{{{letter}}}", part, np.stack([self._derived(c) for c in stated], -1), DERIVED)
                     for letter, part, stated in parts]
            on_k = "" if self.external else "; the opposite acts on k at the same point"
            text = f"Force $\\mathbf{{F}}$ (N) on l at its point and torque $\\mathbf{{T}}$ (N m) on l{on_k}:"
            blocks += self.told(text, *lines)
        return Section("Law", [*blocks, *thrust_blocks(self)])

    def _forces(self) -> Section:
        """Forces and moments on the bodies, and terms of the law in the equations of joint coordinates."""
        total = self.all_pairs()
        lines = [self.line(one.latex, one.formula) for one in self._shown(self.s.record.sides)]
        found = {"$-\\delta V$": self.s.energy != 0, "$-\\partial D/\\partial\\dot{\\mathbf{r}}$": self.s.dissipation != 0,
                 "the stated force": self.s.wrench is not None or self.s.thrust is not None}
        text = (f"Forces and moments on the bodies at their points, from {together([p for p in found if found[p]])}; about"
                " the centre of a body the moment is $\\mathbf{m} + \\mathbf{s}\\times\\mathbf{f}$.")
        if self.s.coordinates:
            text += " $h$ is what the law adds to the left-hand side of the equation of the joint's coordinate."
        blocks = self.told(text, *lines)
        if not self.external and self.s.sides:
            sums, _ = self.balance({side: (-pair[0], -pair[1]) for side, pair in total.items()}, must=True)
            blocks += [Paragraph("Balance:"), *sums]
        return Section("Forces on the bodies", blocks)

    def _shown(self, sides: Sequence[str]) -> list[Shown]:
        """Forces and moments on the bodies of these frames, and terms in the equations of the coordinates."""
        total, partials = self.all_pairs(), (self.elastic[1], self._drag(), self.stated_partials)

        def pair(state: Any, side: str, i: int) -> Any:
            return -self.at_point(side, {target: state.scalar(e) for target, e in dynamics(self.d)})[i]

        shown = [Shown(letter, "N m" if i else "N", -total[side][i], partial(pair, side=side, i=i))
                 for letter, side, i in self.letters() if side in sides]
        return shown + [Shown(effort(name), effort_unit(self.known[name].unit), sum((p[symbol] for p in partials), se.Integer(0)),
                              partial(self.effort_at, name=name)) for name, symbol in self.s.coordinates.items()]

    def _by_parameters(self) -> list[Section]:
        """Derivatives by the parameters; those of the first of several bodies follow by the balance, those of the contact of pin
        and race stand in the reports of its normal and friction laws."""
        if issubclass(self.s.cls, JournalContact):
            told = ("Those by the parameters of the normal law and of friction stand in the reports of these, as `mb.Hertz` and"
                    " `mb.LuGre`; those by radii and length are not printed.")
            return [Section("Derivatives by the parameters", [Paragraph(told)])]
        return self.by_parameters(self._shown(self.s.record.sides[len(self.s.sides) > 1 :]))

    def _drag(self) -> dict[Any, Any]:
        """Derivatives of the dissipation function by the rates of the coordinates."""
        return {symbol: self.s.drag[1][self.s.clock[symbol]] for symbol in self.s.coordinates.values()}

    def _states(self) -> list[Section]:
        return [Section("Internal states", state_blocks(self))] if self.d.states else []

    def _gaps(self) -> list[Section]:
        """Section on the gaps of a law that acts where they are negative; empty without gaps."""
        if not self.gaps:
            return []
        lines, several = list[str](), len(self.gaps) > 1
        for i, (pair, stated) in enumerate(zip(self.gaps, self.d.law.gaps(*self.d.sides), strict=True)):
            below = f"_{{{i + 1}}}" if several else ""
            for mark, e, wanted in zip((f"g{below}", rf"\dot g{below}"), pair, stated, strict=True):
                lines.append(self.line(mark, e, self.state.scalar(self.d.variation.name(wanted)), DERIVED))
        self.known["gap"] = Letter("g", "m", "gap: the law acts where it is negative")
        self.writer.used.add("gap")
        text = "The law acts where the gap is negative; no step of a solver passes over a change of its sign."
        return [self.section("Gap", text, *lines)]

    def _power(self) -> Section:
        """Section on the dissipated power and its sign."""
        d, s, blocks, title = self.d, self.s, list[Block](), "Power"
        dissipated: Any = np.asarray(self.state.scalar(d.dissipated_power))
        if not np.any(dissipated != 0):
            nothing = "The law dissipates nothing." if s.energy != 0 else "The power of the law counts as work."
            return Section(title, [Paragraph(nothing)])
        if self.losses:
            stated = d.law.losses(*d.sides)
            letters = {name: f"P_{{\\text{{{name}}}}}" for name in self.losses}
            for name, e in self.losses.items():
                blocks += self.lines(self.line(letters[name], e, self._derived(stated[name]), DERIVED))
            self.want("P_d", dissipated, BALANCE)
            blocks += self.lines(f"P_d = {' + '.join(letters.values())}")
            sign = "never negative" if np.min(dissipated) >= -1e-12 else "of either sign: internal states store energy"
            return Section(title, [Paragraph(f"Dissipated power: {sign} at {POINTS} random states."), *blocks])
        pairs, partials = s.drag[0], self._drag()
        if d.law.dissipative:
            pairs = summed(s.record, [pairs, self.stated_pairs])
            partials = {symbol: e + self.stated_partials[symbol] for symbol, e in partials.items()}
        bodies = {side: pairs[side] for side in s.sides}
        return Section(title, [Paragraph("Power of what dissipates, on the bodies:"), *power_blocks(self, bodies, partials)])


#: friction and normal laws with typical values; a report of their class uses only their structure
_TYPICAL: dict[type[Part], Part] = {
    Coulomb: Coulomb(0.3, 1e-3),
    LuGre: LuGre(0.3, 0.5, 1e-3, 1e5, 300.0, 0.4),
    Hertz: Hertz(1e9, damping=0.3),
}
_PAGES: dict[Any, Any] = {Joint | Coupling: JointReport, Force: ForceReport, LineLaw: LineReport, Element: ElementPage,
                          TwoBodyLaw: JointReport}


def exported() -> dict[str, type]:
    """Every law of the package that has a page, by its name in lower case."""
    return {name.lower(): law for name, law in laws.exported().items() if law not in (Normal, Friction)}


def names() -> list[str]:
    """Names that the command `mbdae report` accepts."""
    return sorted({"kinematic", "classical", "recursive", "clearance", *exported()})


@naming_arguments
def report(what: Any, level: str = "full", **options: Any) -> Document:
    """The report (a `Document`) of a law class, a law or part with values, a joint model, a joint of a scene, a scene, a
    result of one, a reduced body (its modes, with pictures), or a name.

    level "full" shows the whole derivation; "lecture" what one teaches of it, a joint on at most two pages: coordinates, one
    statement, forces and what they mean, Jacobian and an example in numbers, without the prescribed motions that a joint may
    have. options: those of the law; a parameter given as None is left out of the statement. Options of joints:

        kept       whether the coordinates are unknowns; by default True where the joint cannot be stated without them
        friction   a friction law, such as mb.Coulomb(0.3, 1e-3), pressed by the joint's own reaction; by default none
        rubs       with friction: the name of the coordinate against which it acts, "angle" or "displacement" of a joint that has
                   several; by default the first one
        model      a joint model: mb.Kinematic(), the default; mb.Classical(), with kept=True; mb.Recursive(), the joint in a tree
                   without multipliers; for mb.Revolute also mb.Clearance(...), with its contact

    `.save("x.html")` writes it, also as .md, .tex or .pdf. Raises OptionError or LawError for what a law does not have."""
    if option("level", level, word, "give one of these", words=("full", "lecture")) == "lecture":
        return _lecture(what, options)
    if isinstance(what, SceneData):
        _refuse(what, options)
        return scene_sheet(what)
    if isinstance(what, Result):
        _refuse(what, options)
        return scene_sheet(what.prepared.model.scene, what)
    if isinstance(what, ReducedBody):
        _refuse(what, options)
        return modes_page(what)
    if isinstance(what, str):
        return _by_name(what, options)
    if isinstance(what, Connection):
        return report(what.joint, **options)
    if isinstance(what, type) and issubclass(what, Joint) and "model" in options:
        return _of_model(_model(options.pop("model")), what, options)
    model = _model(what)
    if isinstance(model, JointModel | Part | Law):
        _refuse(what, options)
    if isinstance(model, JointModel):
        return _of_model(model, Revolute, {})
    if isinstance(what, Part):
        return PartPage(what.structure()).document()
    if isinstance(what, Law):
        timed = frozenset(p for p in what.params if hasattr(getattr(what, p), "free_symbols"))
        return _of_law(type(what), what.structure(timed))
    if isinstance(what, type) and issubclass(what, Part):
        if what not in _TYPICAL:
            raise LawError(f"{what.__name__} needs values to be reported: say mb.report({what.__name__}(...))")
        return PartPage(_TYPICAL[what].structure()).document()
    if isinstance(what, type) and issubclass(what, Law):
        return _of_law(what, structure_of(what, options))
    raise OptionError(f"what = {shown(what)}: give a law, a joint model, a joint, a scene, a reduced body, or one of "
                      f"{', '.join(names())}")


def _lecture(what: Any, options: dict[str, Any]) -> Document:
    """The report of what is taught of a law, joint model or scene."""
    law: Any = exported().get(what, what) if isinstance(what, str) else what.joint if isinstance(what, Connection) else what
    joint = isinstance(law, type) and issubclass(law, Joint)
    if joint:
        options = dict.fromkeys(law.drives()) | options
        if law.states_motion() and law.frames == ("k", "l") and not {"friction", "model"} & {*options}:
            return lecture(law, structure_of(law, options))
    return taught(report(law if joint else what, **options), [])


def _model(what: Any) -> Any:
    """A joint model made from its class; any other value unchanged."""
    return what() if any(what is m for m in (Kinematic, Classical, Recursive)) else what


def _refuse(what: Any, options: dict[str, Any]) -> None:
    """OptionError where options are given with something else than a class of laws."""
    if options:
        name, value = next(iter(options.items()))
        raise OptionError(f"{name} = {shown(value)}: {shown(what)} takes no options, which only classes of laws do; leave it out")


def _by_name(name: str, options: dict[str, Any]) -> Document:
    known: dict[str, Any] = {"kinematic": Revolute, "classical": Revolute, "recursive": Recursive, **exported()}
    if name == "clearance":
        _refuse(name, options)
        return _clearance(Hertz(1e9, damping=0.3), Coulomb(0.3, 1e-3), None)
    if name not in known:
        raise OptionError(f"what = {shown(name)} is not known: {meant(name, names())}give one of {', '.join(names())}, or a law "
                          f"or scene itself")
    return report(known[name], **{"kept": True} | options if name == "classical" else options)


def _of_law(law: type[Law], structure: Structure) -> Document:
    for kind, page in _PAGES.items():
        if issubclass(law, kind):
            found: Document = page(law, structure).document()
            return found
    raise LawError(f"{law.__name__} is neither joint, force, body nor line: no report shows it; give a class of one of these")


def _of_model(model: Any, law: type[Joint], options: dict[str, Any]) -> Document:
    """The report of a joint with a joint model; OptionError where `model` is none."""
    if isinstance(model, Clearance) and law is not Revolute:
        raise OptionError(f"model = {shown(model)}: of all joints only mb.Revolute has clearance; say mb.report(mb.Revolute, "
                          f"model=...)")
    if isinstance(model, Clearance):
        return _clearance(model.normal, model.friction, model.length)
    if isinstance(model, Recursive):
        return recursive_report((law,), options) if law is not Revolute or options else recursive_report()
    if not isinstance(model, JointModel):
        raise OptionError(f"model = {shown(model)}: give mb.Kinematic(), mb.Classical() or mb.Recursive(), for mb.Revolute also "
                          f"mb.Clearance(...)")
    return report(law, kept=isinstance(model, Classical) or law.must_keep(), **options)


def _clearance(normal: Any, friction: Any, length: float | None) -> Document:
    """The report of a revolute with clearance: the rows that remain, then the contact."""
    left_out: dict[str, Any] = {"length": None} if length is None else {}
    rows = report(ClearanceRevolute, tilting=length is not None, drive=None)
    contact = report(JournalContact, normal=normal, friction=friction, **left_out)
    text = (
        "A revolute joint with clearance consists of two laws: the constraint rows that remain, and the contact of pin and race."
    )
    return Document("Revolute joint with clearance", [Paragraph(text), *(Section(d.title, d.blocks) for d in (rows, contact))])
