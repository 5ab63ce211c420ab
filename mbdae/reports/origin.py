"""The origin of the report of a friction or normal law: the hash of a law that contains it, as it is integrated."""

from __future__ import annotations

from mbdae.documents.blocks import Block, Paragraph, Section
from mbdae.laws.contact import JournalContact
from mbdae.laws.forces import JointFriction
from mbdae.laws.friction import Friction
from mbdae.reports.statement import derived, structure_of
from mbdae.symbolic.fingerprint import fingerprint
from mbdae.symbolic.law import Force
from mbdae.symbolic.part import Part, PartStructure


def part_origin(cls: type[Part], structure: PartStructure) -> list[Block]:
    """The section on the origin."""
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

