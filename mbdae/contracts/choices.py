"""Values of a law's options that the contracts try: the plain law, and every further value once."""

from __future__ import annotations

from itertools import product
from typing import Any

from mbdae.errors import LawError, OptionError
from mbdae.laws.contact import Hertz
from mbdae.laws.forces.on_coordinate import OnCoordinate
from mbdae.laws.friction import Coulomb, LuGre
from mbdae.laws.joints import Cylindrical, Prismatic, Revolute
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Law
from mbdae.symbolic.part import Part, PartStructure
from mbdae.values import shown

Choice = dict[str, Any]  #: value of every option of a law
_DRY = PartStructure(Coulomb, frozenset(), ())
_BRISTLES = PartStructure(LuGre, frozenset(), (("gamma", 2.0), ("damping_decay", True)))
#: values tried for options of these names where `selftest` is given none. Values of options with other names have to be given,
#: except of those that all joints, or all laws for one coordinate, have
_VALUES: dict[str, tuple[Any, ...]] = {
    "following": (False, True), "tilting": (False, True), "count": (3,), "normal": (Hertz(1, damping=1).structure(),),
    "friction": (_DRY, _BRISTLES),
}  # fmt: skip
#: joints and coordinates on which a law for one coordinate (spring, motor) is tried: a displacement and an angle computed from
#: the frames, one of several coordinates, and an angle that is an unknown
_COORDINATES: tuple[Choice, ...] = (
    {"joint": Prismatic, "coordinate": None, "kept": False}, {"joint": Revolute, "coordinate": None, "kept": False},
    {"joint": Cylindrical, "coordinate": "angle", "kept": False}, {"joint": Revolute, "coordinate": None, "kept": True},
)  # fmt: skip


def refuse_missing(law: type, options: list[str]) -> None:
    """LawError for the first of the options of a law that have no value."""
    if options:
        raise LawError(f"{law.__name__} has the option '{options[0]}': say mb.selftest({law.__name__}, {options[0]}=...) with a "
                       f"value for it")  # fmt: skip


def choices(law: type[Law], given: Choice) -> tuple[list[Choice], list[Choice]]:
    """Values of the options: those tried with all parameters in every combination that matters, and others tried once.

    given: options stated by the caller. Raises LawError for options without known values, OptionError for those a joint cannot
    have."""
    given = {o: v.structure() if isinstance(v, Part) else v for o, v in given.items() if o in law.options}
    main, further = _of_joint(law) if issubclass(law, Joint) else _on_coordinate(law)
    rest = [o for o in law.options if o not in main[0]]
    refuse_missing(law, [o for o in rest if o not in given and o not in _VALUES])
    values = [(given[o],) if o in given else _VALUES[o] for o in rest]
    others = [dict(zip(rest, chosen, strict=True)) for chosen in product(*values)]
    whole = [first | other | given for first, other in product(main, others)]
    once = [first | others[0] | given for first in further]
    if issubclass(law, Joint):
        for choice in (*whole, *once):
            _check_joint(law, choice)
    whole = _different(whole)
    return whole, [choice for choice in _different(once) if choice not in whole]


def _different(found: list[Choice]) -> list[Choice]:
    return [choice for i, choice in enumerate(found) if choice not in found[:i]]


def _of_joint(law: type[Joint]) -> tuple[list[Choice], list[Choice]]:
    """Choices for a joint: first without friction, with its coordinates as unknowns and not; then, to be tried once, dry friction
    against its first coordinate and bristle friction against its last."""
    names = list(law.scalars())
    kept = [True] if law.must_keep() else [False, True] if law.coordinates else [False]
    plain = [{"kept": k, "friction": None, "rubs": None} for k in kept]
    rubbing: list[Choice] = []
    if names:
        rubbing = [{"kept": kept[0], "friction": _DRY, "rubs": names[0]},
                   {"kept": kept[-1], "friction": _BRISTLES, "rubs": names[-1]}]
    return plain, rubbing


def _check_joint(law: type[Joint], choice: Choice) -> None:
    choice["kept"] = bool(choice["kept"]) or law.must_keep()
    for option, names, coordinates in (("kept", law.coordinates, "coordinates"), *((o, law.scalars(), "angles and displacements")
                                                                            for o in ("friction", "rubs"))):  # fmt: skip
        if choice[option] and not names:
            raise OptionError(f"{option} = {shown(choice[option])}: {law.__name__} has no {coordinates}; leave it out")
    if choice["rubs"] is not None and choice["rubs"] not in law.scalars():
        raise OptionError(f"rubs = {shown(choice['rubs'])}: friction acts on one of the coordinates of {law.__name__}, "
                          f"{' or '.join(law.scalars())}: give its name")  # fmt: skip


def _on_coordinate(law: type[Law]) -> tuple[list[Choice], list[Choice]]:
    if not issubclass(law, OnCoordinate):
        return [{}], []
    return [dict(_COORDINATES[0])], [dict(choice) for choice in _COORDINATES[1:]]
