"""`mb.report`: the report of a law, a joint model or a scene.
"""

from __future__ import annotations

from typing import Any

from mbdae import laws
from mbdae.documents import Document
from mbdae.documents.blocks import Paragraph, Section
from mbdae.errors import LawError, OptionError, meant, naming_arguments
from mbdae.laws.contact import Hertz, Normal
from mbdae.laws.friction import Coulomb, Friction, LuGre
from mbdae.laws.joint_rows import ClearanceRevolute
from mbdae.laws.joints import Revolute
from mbdae.laws.journal import JournalContact
from mbdae.reports.force_page import ElementPage, ForceReport
from mbdae.reports.joint_page import JointReport
from mbdae.reports.line_page import LinePage
from mbdae.reports.parts_page import PartPage
from mbdae.reports.recursive_page import recursive_report
from mbdae.reports.scene_sheet import scene_sheet
from mbdae.reports.statement import structure_of
from mbdae.scene.components import Classical, Clearance, Connection, JointModel, Kinematic, Recursive
from mbdae.scene.scene import SceneData
from mbdae.symbolic.joint import Coupling, Joint
from mbdae.symbolic.law import Element, Force, Law, Structure
from mbdae.symbolic.line import LineLaw
from mbdae.symbolic.part import Part
from mbdae.values import shown

#: friction and normal laws with typical values; a report of their class uses only their structure
_TYPICAL: dict[type[Part], Part] = {
    Coulomb: Coulomb(0.3, 1e-3),
    LuGre: LuGre(0.3, 0.5, 1e-3, 1e5, 300.0, 0.4),
    Hertz: Hertz(1e9, damping=0.3),
}
_PAGES: dict[Any, Any] = {Joint | Coupling: JointReport, Force: ForceReport, LineLaw: LinePage, Element: ElementPage}


def exported() -> dict[str, type]:
    """Every law of the package that has a page, by its name in lower case; rows of velocities have none."""
    return {name.lower(): law for name, law in laws.exported().items()
            if law not in (Normal, Friction) and not (
                issubclass(law, Law) and law.velocity_constraints is not Law.velocity_constraints)}


def names() -> list[str]:
    """Names that the command `mbdae report` accepts."""
    return sorted({"kinematic", "classical", "recursive", "clearance", *exported()})


@naming_arguments
def report(what: Any, **options: Any) -> Document:
    """The report (a `Document`) of a law class, a law or part with values, a joint model, a joint of a scene, a scene, or a name.

    options: those of the law; a parameter given as None is left out of the statement. Options of joints:

    kept       whether the coordinates are unknowns; by default True where the joint cannot be stated without them
    friction   a friction law, such as mb.Coulomb(0.3, 1e-3), pressed by the joint's own reaction; by default none
    rubs       with friction: the name of the coordinate against which it acts, "angle" or "displacement" of a joint that has
               several; by default the first one
    model      a joint model: mb.Kinematic(), the default; mb.Classical(), with kept=True; mb.Recursive(), the joint in a tree
               without multipliers; for mb.Revolute also mb.Clearance(...), with its contact

    `.save("x.html")` writes it, also as .md, .tex or .pdf. Raises OptionError or LawError for what a law does not have."""
    if isinstance(what, SceneData):
        _refuse(what, options)
        return scene_sheet(what)
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
    raise OptionError(f"what = {shown(what)}: give a law, a joint model, a joint, a scene, or one of {', '.join(names())}")


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
    left_out = {"length": None} if length is None else {}
    rows = report(ClearanceRevolute, tilting=length is not None, drive=None)
    contact = report(JournalContact, normal=normal, friction=friction, **left_out)
    text = (
        "A revolute joint with clearance consists of two laws: the constraint rows that remain, and the contact of pin and race."
    )
    return Document("Revolute joint with clearance", [Paragraph(text), *(Section(d.title, d.blocks) for d in (rows, contact))])
