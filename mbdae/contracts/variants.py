"""The variants of a law: which parameters may be absent, and between which kinds of nodes it can act."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

from mbdae.errors import LawError
from mbdae.laws.contact import Hertz
from mbdae.laws.friction import Coulomb, LuGre
from mbdae.laws.joints import Prismatic, Revolute
from mbdae.symbolic.derive import Side, derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Element, Force, Law, Structure
from mbdae.symbolic.part import Part, PartStructure

Variant = tuple[str, Structure, tuple[Side, ...]]
#: options of the package's laws; the options of other laws are given to `selftest`
_OPTIONS: dict[str, tuple[Any, ...]] = {
    "joint": (Revolute, Prismatic), "following": (False, True), "tilting": (False, True),
    "normal": (Hertz(1, damping=1).structure(),),
    "friction": (PartStructure(Coulomb, frozenset(), ()),
                 PartStructure(LuGre, frozenset(), (("gamma", 2.0), ("damping_decay", True)))),
}  # fmt: skip
_SPATIAL = (NodeKind.SPATIAL, NodeKind.GROUND, NodeKind.POINT)
_PLANAR = (NodeKind.PLANAR, NodeKind.PLANAR_GROUND, NodeKind.PLANAR_POINT)


def sides_of(law: type[Law]) -> list[tuple[Side, ...]]:
    """Kinds of nodes and directions of axes between which a law may act."""
    if issubclass(law, Element):
        return [((kind, Axes.GENERAL),) for kind in (*_SPATIAL, *_PLANAR, NodeKind.COORDINATE) if kind.moves]
    pairs = [(k, l, Axes.GENERAL) for k, l in product(_SPATIAL, _SPATIAL)]
    pairs += [(k, l, Axes.NORMAL) for k, l in product(_PLANAR, _PLANAR)]
    pairs += [(k, l, axes) for axes in (Axes.REVERSED, Axes.IN_PLANE) for k, l in product(_PLANAR[:2], _PLANAR[:1])]
    outside = issubclass(law, Force) and law.external
    own = [(NodeKind.COORDINATE, Axes.GENERAL)] if law.coordinates else []
    allowed = [(k, l, a) for k, l, a in pairs if (k.moves or l.moves) and not (outside and k.moves)]
    return [((k, axes), (l, axes), *own) for k, l, axes in allowed]


def structures_of(law: type[Law], options: dict[str, Any]) -> list[Structure]:
    """A law with all its parameters, with all of them functions of time, without each optional one, and with one of them only."""
    missing = [o for o in law.options if o not in options and o not in _OPTIONS]
    if missing:
        raise LawError(f"{law.__name__} has the option '{missing[0]}': say mb.selftest({law.__name__}, {missing[0]}=...)")
    found: list[Structure] = []
    given = {o: v.structure() if isinstance(v, Part) else v for o, v in options.items()}
    for chosen in product(*((given[o],) if o in given else _OPTIONS[o] for o in law.options)):
        fixed = tuple(zip(law.options, chosen, strict=True))
        optional = [p for p in law.params if _derivable(law, Structure(frozenset([p]), options=fixed))]
        absences = [frozenset[str](), *(frozenset([p]) for p in optional)]
        absences += [frozenset(optional) - {p} for p in optional] + [frozenset(optional)]
        found += [Structure(a, options=fixed) for a in dict.fromkeys(absences) if _derivable(law, Structure(a, options=fixed))]
        if law.params and not law.timeless and not issubclass(law, Element):
            found.append(Structure(timed=frozenset(law.params), options=fixed))
    return found


def _derivable(law: type[Law], structure: Structure) -> bool:
    """Whether the law can be stated with these parameters absent (arithmetic with None fails otherwise)."""
    for sides in sides_of(law):
        try:
            derive(law, structure, sides)  # type: ignore[arg-type]
        except LawError:
            continue
        except (TypeError, AttributeError, RuntimeError):
            return False
        return True
    return not structure.absent


def variants(law: type[Law], options: dict[str, Any], refused: dict[str, str]) -> Iterator[Variant]:
    """Every structure between the main pairs of node kinds, the first structure between all pairs."""
    seen: set[Any] = set()
    for structure in structures_of(law, options):
        first = structure.options not in seen
        seen.add(structure.options)
        for sides in sides_of(law):
            if not first and not _is_main(law, sides):
                continue
            name = _variant_name(structure, sides)
            try:
                derive(law, structure, sides)  # type: ignore[arg-type]
            except LawError as error:
                refused[name] = str(error)
                continue
            yield name, structure, sides


def _is_main(law: type[Law], sides: tuple[Side, ...]) -> bool:
    """Between two bodies (a body and the ground for loads from outside), the axis of a planar variant along the normal."""
    outside = issubclass(law, Force) and law.external
    return all(kind.turns for kind, _ in sides[1 if outside else 0 : 2]) and sides[0][1] in (Axes.GENERAL, Axes.NORMAL)


def _variant_name(structure: Structure, sides: tuple[Side, ...]) -> str:
    axes = f", axis {sides[0][1].value}" if any(kind.flat for kind, _ in sides) else ""
    parts = [f"{o}={getattr(v, '__name__', v)}" for o, v in structure.options]
    parts += [f"without {'/'.join(sorted(structure.absent))}"] if structure.absent else []
    parts += ["timed"] if structure.timed else []
    return f"{' - '.join(kind.value for kind, _ in sides)}{axes}{' (' + ', '.join(parts) + ')' if parts else ''}"


