"""The section of a joint's report on its coordinates: their meaning, the motion they describe, how the frames show them."""

from __future__ import annotations

from typing import Any

from mbdae.documents.blocks import Block, Paragraph, Section, Table
from mbdae.reports.common import LawFormulas, title_of
from mbdae.reports.letters import specs_of_coordinates, unit_text, worded
from mbdae.reports.page import DERIVED, LawPage
from mbdae.reports.statement import Statement
from mbdae.reports.vectors import Vector
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.motion import AXES, Motion, Step, motion_of, no_rotation
from mbdae.symbolic.vectors import Vec


def title_of_joint(s: Statement) -> str:
    """The name of the joint, and which statement of it this is."""
    cls = s.cls
    title = title_of(cls) if "oint" in cls.__name__ or not issubclass(cls, Joint) else f"{title_of(cls)} joint"
    if issubclass(cls, Joint) and s.places and not cls.must_keep():
        title += f", {'its coordinate an unknown' if len(s.places) == 1 else 'its coordinates unknowns'}"
    return title


def other_statements(s: Statement) -> list[Block]:
    """How to get the reports of the other statements of the same joint."""
    cls = s.cls
    if not issubclass(cls, Joint) or not cls.coordinates:
        return []
    call, said = f"mb.report({cls.__name__}", []
    if not cls.must_keep():
        word = "without" if s.places else "with"
        said.append(f"`{call}, kept={not s.places})` reports the joint {word} its coordinates as unknowns")
        call += ", kept=True" * bool(s.places)
    if s.law.friction is None and cls.scalars():
        said.append(f"`{call}, friction=mb.Coulomb(...))` with friction by its own reaction")
    if any(name in s.rows for name in cls.drives()):
        said.append(f"`{call}, {next(iter(cls.drives()))}=None)` without that prescribed motion")
    return [Paragraph(f"Other statements: {'; '.join(said)}.")] if said else []


def motion_in(s: Statement) -> Motion | None:
    """The motion of a joint in the symbols of a statement; None where it states none, or a free rotation without its unknowns."""
    if not isinstance(s.law, Joint):
        return None
    symbols: dict[str, Any] = {name: s.values.get(name, s.symbol(name)) for name in s.law.coordinates}
    symbols |= {name: s.values.get(name, no_rotation()) for name in s.law.coordinates.keys() - s.law.scalars().keys()}
    return motion_of(s.law, symbols)


def coordinates_section(r: LawPage) -> Section | None:
    """Table of the coordinates, chain of motions, pose of l, coordinates as frames show them; None for a joint without."""
    specs, motion = specs_of_coordinates(r.s.law), motion_in(r.s)
    if not specs and motion is None:
        return None
    blocks: list[Block] = []
    if specs:
        known = r.formulas.known
        rows = [[f"`{name}`", f"${known[name].latex}$", _unit(spec.unit), worded(spec.meaning)] for name, spec in specs.items()]
        if not isinstance(r.s.law, Joint):
            said = "The coordinates are those of joints."
        elif r.s.places:
            said = "The coordinates are unknowns of the equations."
        else:
            said = "The coordinates are no unknowns of the equations: they are read from the frames."
        blocks += [Paragraph(said), Table(["name", "symbol", "unit", "meaning"], rows)]
        r.formulas.writer.used |= {str(r.s.coordinates.get(name, name)) for name in specs}
    if motion is not None:
        blocks += chain(motion, r.formulas, list(specs))
    return Section("Coordinates and motion", [*blocks, *_read(r)])


def _unit(unit: str) -> str:
    return "a quaternion; its rates an angular velocity, rad/s" if unit == "rotation" else unit_text(unit)


def chain(motion: Motion, formulas: LawFormulas, names: list[str]) -> list[Block]:
    """The elementary motions of a joint, one after the other."""
    if not motion.steps:
        return [Paragraph("Motion: none, l moves with k.")]
    w = formulas.writer
    free = [name for name in names if formulas.statement.law.coordinates[name].unit == "rotation"]
    rows = []
    for i, step in enumerate(motion.steps):
        if step.rotation is not None:
            rows.append([str(i + 1), "free rotation", "", f"${formulas.known[free.pop(0)].latex}$"])
        else:
            kind = "rotation about" if step.turns else "displacement along"
            rows.append([str(i + 1), kind, _axis(step), f"${w.scalar(step.amount)}$"])
    text = (
        "Motion, from the frame of k to that of l: elementary motions one after the other, each along or about an axis of the"
        " frame reached by those before it."
    )
    return [Paragraph(text), Table(["", "motion", "axis", "amount"], rows)]


def _axis(step: Step) -> str:
    named = next((name for name, unit in AXES.items() if list(unit) == list(step.axis)), None)
    return named or f"({', '.join(f'{float(c):.6g}' for c in step.axis)})"


def pose_of(s: Statement, motion: Motion) -> tuple[Vector, tuple[Vec, Vec, Vec]]:
    """Displacement of the point of l from that of k, and the axes of l, on the motion."""
    k = s.frames[0]
    moved, axes = motion.pose((k.x, k.y, k.z))
    return s.vector(moved), tuple(s.vector(a) for a in axes)  # type: ignore[return-value]


def _read(r: LawPage) -> list[Block]:
    """The coordinates as the frames show them, with the derived ones."""
    if not r.s.read:
        return []
    for name in r.s.read:
        r.want(r.formulas.known[name].latex, r.state.scalar(r.d.coordinates[name]), DERIVED)
    lines = [f"{r.formulas.known[name].latex} = {r.formulas.writer.scalar(e)}" for name, e in r.s.read.items()]
    text = "The coordinates as the frames show them, whether the rows vanish or not:"
    return [Paragraph(text), *r.formulas.lines(*lines)]
