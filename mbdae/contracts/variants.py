"""The variants of a law: which parameters may be absent, and between which kinds of nodes it can act."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product
from typing import Any

from mbdae.errors import LawError, OptionError
from mbdae.laws.bodies import JointCoordinate
from mbdae.laws.contact import Hertz
from mbdae.laws.friction import Coulomb, LuGre
from mbdae.laws.joints import Cylindrical, Prismatic, Revolute
from mbdae.laws.on_coordinates import OnCoordinate
from mbdae.symbolic.derive import Side, derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element, Force, Law, Structure
from mbdae.symbolic.motion import symbolic_motion
from mbdae.symbolic.part import Part, PartStructure
from mbdae.values import shown

# -- Values of a law's options that the contracts try: the plain law, and every further value once


Choice = dict[str, Any]  #: value of every option of a law
_DRY = PartStructure(Coulomb, frozenset(), ())
_BRISTLES = PartStructure(LuGre, frozenset(), (("gamma", 2.0), ("damping_decay", True)))
#: values tried for options of these names where `selftest` is given none. Values of options with other names have to be given,
#: except of those that all joints, or all laws for one coordinate, have
_VALUES: dict[str, tuple[Any, ...]] = {
    "following": (False, True), "tilting": (False, True), "count": (3,), "normal": (Hertz(1, damping=1).structure(),),
    "friction": (_DRY, _BRISTLES),
}
#: joints and coordinates on which a law for one coordinate (spring, motor) is tried: a displacement and an angle computed from
#: the frames, one of several coordinates, and an angle that is an unknown
_COORDINATES: tuple[Choice, ...] = (
    {"joint": Prismatic, "coordinate": None, "kept": False}, {"joint": Revolute, "coordinate": None, "kept": False},
    {"joint": Cylindrical, "coordinate": "angle", "kept": False}, {"joint": Revolute, "coordinate": None, "kept": True},
)


def refuse_missing(law: type, options: list[str]) -> None:
    """LawError for the first of the options of a law that have no value."""
    if options:
        raise LawError(f"{law.__name__} has the option '{options[0]}': say mb.selftest({law.__name__}, {options[0]}=...) with a "
                       f"value for it")


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
                                                                            for o in ("friction", "rubs"))):
        if choice[option] and not names:
            raise OptionError(f"{option} = {shown(choice[option])}: {law.__name__} has no {coordinates}; leave it out")
    if choice["rubs"] is not None and choice["rubs"] not in law.scalars():
        raise OptionError(f"rubs = {shown(choice['rubs'])}: friction acts on one of the coordinates of {law.__name__}, "
                          f"{' or '.join(law.scalars())}: give its name")


def _on_coordinate(law: type[Law]) -> tuple[list[Choice], list[Choice]]:
    if not issubclass(law, OnCoordinate):
        return [{}], []
    return [dict(_COORDINATES[0])], [dict(choice) for choice in _COORDINATES[1:]]


Variant = tuple[str, Structure, tuple[Side, ...]]
_SPATIAL = (NodeKind.SPATIAL, NodeKind.GROUND, NodeKind.POINT)
_PLANAR = (NodeKind.PLANAR, NodeKind.PLANAR_GROUND, NodeKind.PLANAR_POINT)
_OF_JOINTS = {False: NodeKind.COORDINATE, True: NodeKind.ROTATION}  #: whether a coordinate is a free rotation -> kind of its node


def sides_of(law: type[Law], structure: Structure) -> list[tuple[Side, ...]]:
    """Kinds of nodes and directions of axes between which a law may act; the joint coordinates among its unknowns come last."""
    if issubclass(law, Element):
        kinds = _OF_JOINTS.values() if issubclass(law, JointCoordinate) else (*_SPATIAL, *_PLANAR)
        return [((kind, Axes.GENERAL),) for kind in kinds if kind.moves]
    own = tuple((kind, Axes.GENERAL) for kind in _own_kinds(law, structure))
    count = len(law.frames)
    if not count:
        return [own]
    bodies = [(kinds, Axes.GENERAL) for kinds in _kinds(count, _SPATIAL)]
    bodies += [(kinds, Axes.NORMAL) for kinds in _kinds(count, _PLANAR)]
    outside = issubclass(law, Force) and law.external
    flat = (_PLANAR[outside], *[NodeKind.PLANAR] * (count - 1))
    bodies += [(flat, axes) for axes in (Axes.REVERSED, Axes.IN_PLANE)]
    allowed = [(kinds, axes) for kinds, axes in bodies if any(k.moves for k in kinds) and not (outside and kinds[0].moves)]
    return [(*((kind, axes) for kind in kinds), *own) for kinds, axes in allowed]


def _own_kinds(law: type[Law], structure: Structure) -> list[NodeKind]:
    """Kinds of the joint coordinates that are unknowns of the law."""
    named = getattr(law, "coordinates", {})
    return [_OF_JOINTS[name in named and named[name].unit == "rotation"] for name in law.symbolic(structure).own_coordinates]


def _kinds(count: int, kinds: tuple[NodeKind, ...]) -> Iterable[tuple[NodeKind, ...]]:
    """Kinds of the nodes of `count` bodies: all bodies, one of them the ground or a point; points alone, and on the ground."""
    body, ground, point = kinds
    others = [((body,) * i, other, (body,) * (count - i - 1)) for i in range(count) for other in (ground, point)]
    points = (point,) * (count - 1)
    return [(body,) * count, *((*before, other, *after) for before, other, after in others), (point, *points), (ground, *points)]


def structures_of(law: type[Law], options: dict[str, Any]) -> dict[Structure, bool]:
    """Structures of a law, each with whether it is tried in the plane too: with all parameters, with all of them functions of
    time, without each optional parameter in turn, and with only one of them. For further values of the options fewer of these."""
    found: dict[Structure, bool] = {}
    whole, once = choices(law, options)
    for i, choice in enumerate((*whole, *once)):
        fixed = tuple((o, choice[o]) for o in law.options)
        idle = _idle(law, choice)
        idle |= {d for d in law.drives() if not _derivable(law, Structure(idle | law.drives().keys() - {d}, options=fixed))}
        needed = [p for p in law.params if p not in idle]
        optional = frozenset(p for p in needed if _derivable(law, Structure(idle | {p}, options=fixed)))
        tried = [Structure(idle | a, options=fixed) for a in _absences(law, optional)]
        thorough = choice in whole and not (i and choice.get("kept"))
        if not thorough:  # coordinates as unknowns: all parameters only; options tried once: no optional parameter
            tried = tried[:1] if choice in whole else tried[-1:]
        found |= {s: s == tried[-1] or (i == 0 and s == tried[0]) for s in tried if s.absent == idle or _derivable(law, s)}
        if needed and thorough and not law.timeless and not issubclass(law, Element):
            found[Structure(idle, frozenset(needed), fixed)] = i == 0
    return found


def _absences(law: type[Law], optional: frozenset[str]) -> list[frozenset[str]]:
    """Sets of optional parameters that are left out: none, all, each alone, and all but one. Of several prescribed coordinates
    only the first is left out alone: each adds one row, so that the others would check the same again."""
    drives = list(law.drives())
    each = sorted(optional - {*drives[1:]})
    some = [frozenset([p]) for p in each] + [optional - {p} for p in each if len(drives) < 2]
    return sorted(dict.fromkeys([frozenset[str](), *some, optional]), key=lambda absent: (len(absent), sorted(absent)))


def _idle(law: type[Law], choice: Choice) -> frozenset[str]:
    """Parameters without effect for these options: the radius at which friction acts, in a joint without friction or with
    friction against a displacement."""
    if not issubclass(law, Joint) or "friction_radius" not in law.derived():
        return frozenset()
    rubbed = law.coordinates[choice["rubs"] or next(iter(law.scalars()))]
    return frozenset() if choice["friction"] and rubbed.unit == "rad" else frozenset(["friction_radius"])


def _derivable(law: type[Law], structure: Structure) -> bool:
    """Whether the law can be stated with these parameters absent (arithmetic with None fails otherwise)."""
    for sides in sides_of(law, structure):
        try:
            d = derive(law, structure, sides)
            if isinstance(d.law, Joint):
                symbolic_motion(d.law)
        except LawError:
            continue
        except (TypeError, AttributeError, RuntimeError):
            return False
        return True
    return not structure.absent


def variants(law: type[Law], options: dict[str, Any], refused: dict[str, str]) -> Iterator[Variant]:
    """Every structure of a law between bodies; the first structure of the first options between all kinds of nodes."""
    for i, (structure, flat) in enumerate(structures_of(law, options).items()):
        for sides in sides_of(law, structure):
            in_plane = any(kind.flat for kind, _ in sides)
            if i and not (_is_main(law, sides) and (flat or not in_plane)):
                continue
            name = _variant_name(structure, sides)
            try:
                derive(law, structure, sides)
            except LawError as error:
                refused[name] = str(error)
                continue
            yield name, structure, sides


def _is_main(law: type[Law], sides: tuple[Side, ...]) -> bool:
    """Whether a variant acts between bodies (an external load: on a body, from the ground), and its axis is normal to the plane
    where it is planar."""
    outside = issubclass(law, Force) and law.external
    return all(kind.turns and axes in (Axes.GENERAL, Axes.NORMAL) for kind, axes in sides[1 if outside else 0 : len(law.frames)])


def _variant_name(structure: Structure, sides: tuple[Side, ...]) -> str:
    axes = f", axis {sides[0][1].value}" if any(kind.flat for kind, _ in sides) else ""
    parts = [f"{o}={getattr(v, '__name__', v)}" for o, v in structure.options if v not in (None, False)]
    parts += [f"without {'/'.join(sorted(structure.absent))}"] if structure.absent else []
    parts += ["timed"] if structure.timed else []
    return f"{' - '.join(kind.value for kind, _ in sides)}{axes}{' (' + ', '.join(parts) + ')' if parts else ''}"
