"""Statements of couplings between coordinates of joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mbdae.errors import LawError
from mbdae.laws.couplings import Differential, Gear, Rack, WeightedSum
from mbdae.scene import reading
from mbdae.scene.components import Connection
from mbdae.scene.items import SceneItems
from mbdae.scene.reading import Argument, reads
from mbdae.scene.record import statement
from mbdae.symbolic.coupling import Coupling, Reference
from mbdae.values import BadValueError, number, shown

NOBODY = ""  #: used for a coordinate that was not found, after the mistake has been reported


def reference(unit: str = "") -> reading.Reader:
    """Reader of a reference to a coordinate: the name of a joint that has one coordinate, or "joint.coordinate". Returns
    "joint.coordinate". unit: the coordinate has to have this unit, where it is given."""

    def read(arg: Argument, value: Any) -> str:
        joint, name = found_joint(arg, value)
        if joint is None:
            return NOBODY
        known = [c for c in joint.coordinates if joint.unit(c) == unit or (not unit and joint.unit(c) != "rotation")]
        if name in known or (not name and len(known) == 1):
            return f"{joint.name}.{name or known[0]}"
        wanted = {"rad": "angle", "m": "displacement"}.get(unit, "coordinate")
        if not known:
            arg.wrong(f"{shown(value)}: {joint.kind} '{joint.name}' has no {wanted}", f"name a joint that has one; {_has(joint)}")
        else:
            arg.wrong(shown(value), f"say which {wanted}: {' or '.join(repr(f'{joint.name}.{c}') for c in known)}")
        return NOBODY

    return read


def found_joint(arg: Argument, value: Any) -> tuple[Connection | None, str]:
    """The joint of a reference, and the coordinate it names."""
    scene = arg.scene
    if isinstance(value, Connection) and any(value is c for c in scene.joints):
        return value, ""
    text = value if isinstance(value, str) else ""
    for c in scene.joints:
        if text == c.name or text in [f"{c.name}.{name}" for name in c.coordinates]:
            return c, text[len(c.name) + 1 :]
    arg.wrong(f"{shown(value)} is no joint's coordinate of this scene", f"there are {', '.join(_known(scene)) or 'none'}; "
              f"state the joints before the coupling")  # fmt: skip
    return None, ""


def _has(joint: Connection) -> str:
    """What coordinates a joint has, as a sentence."""
    turns = [c for c in joint.coordinates if joint.unit(c) == "rotation"]
    others = [c for c in joint.coordinates if c not in turns]
    found = [f"'{joint.name}' has {', '.join(others) or 'no coordinates'}"] if others or not turns else []
    found += [f"its {' and '.join(turns)} is no single number that could be coupled"] if turns else []
    return "; ".join(found)


def _known(scene: Any) -> list[str]:
    return [repr(f"{c.name}.{name}") for c in scene.joints for name in c.coordinates if c.unit(name) != "rotation"][:12]


def _terms(arg: Argument, value: Any) -> dict[str, float]:
    """Reader of the factors of a coupling, by "joint.coordinate"."""
    if not isinstance(value, Mapping) or not value:
        arg.wrong(shown(value), "give factors by coordinate, such as {'A.angle': 2, 'B.angle': 1}")
        return {}
    found: dict[str, float] = {}
    for key, factor in value.items():
        at = reference()(arg.part(arg.option), key)
        if at in found and at != NOBODY:
            arg.wrong(shown(value), f"it names {shown(at)} twice; name a coordinate once")
        try:
            found[at] = found.get(at, 0.0) + number(factor)
        except BadValueError as value_and_reason:
            arg.part(f"{arg.option}[{shown(key)}]").wrong(value_and_reason, "give a number")
    if found and not any(found.values()):
        arg.wrong(shown(value), "every factor is 0, so that nothing is coupled; give factors other than 0")
    return found


def _ratio(arg: Argument, value: Any) -> float:
    """Reader of a number that is not 0."""
    before = len(arg.scene.problems)
    found = reading.quantity("1")(arg, value)
    if found == 0 and len(arg.scene.problems) == before:
        arg.wrong("0: the driven wheel would not turn", "give angle(driven)/angle(driving)")
    return found or 1.0


class CouplingStatements(SceneItems):
    """`couple`, `gear`, `rack`, `differential`: equations between coordinates, 0 as drawn, whole turns counted."""

    @reads(name=reading.name, of=_terms, value=reading.driven("rad or m"))
    @statement
    def couple(self, name: str, of: Any, value: Any = 0.0) -> Connection:
        """The sum of multiples of coordinates, {"A.angle": 18, "C.angle": -18, "P.angle": 24}, equals a value in rad or m: a
        number or an expression of mb.t."""
        return self._couple("couple", name, lambda *at: WeightedSum(name, at, list(of.values()), value), list(of))

    @reads(name=reading.name, driving=reference("rad"), driven=reference("rad"), ratio=_ratio)
    @statement
    def gear(self, name: str, driving: Any, driven: Any, ratio: float) -> Connection:
        """angle(driven) = ratio * angle(driving) of two joints, relative to their bodies k (a carrier that may move): negative
        for wheels that mesh outside, positive for a ring gear or a belt."""
        return self._couple("gear", name, lambda a, b: Gear(name, {"driving": a, "driven": b}, ratio=ratio), [driving, driven])

    @reads(name=reading.name, pinion=reference("rad"), rack=reference("m"), radius=reading.quantity("m"))
    @statement
    def rack(self, name: str, pinion: Any, rack: Any, radius: float) -> Connection:
        """displacement(rack) = radius * angle(pinion) of two joints; radius in m, negative where the rack moves backwards."""
        return self._couple("rack", name, lambda a, d: Rack(name, {"angle": a, "displacement": d}, radius=radius), [pinion, rack])

    @reads(name=reading.name, first=reference("rad"), second=reference("rad"), carrier=reference("rad"))
    @statement
    def differential(self, name: str, first: Any, second: Any, carrier: Any) -> Connection:
        """angle(first) + angle(second) = 2 angle(carrier) of three joints."""
        return self._couple("differential", name, lambda a, b, c: Differential(name, {"first": a, "second": b, "carrier": c}),
                            [first, second, carrier])  # fmt: skip

    def _couple(self, kind: str, name: str, make: Callable[..., Coupling], of: list[str]) -> Connection:
        if NOBODY in of or not of:
            return Connection(name, kind, self.ground, self.ground, [])
        return self._coupled(kind, make(*map(self._at, of)))

    def _at(self, text: str) -> Reference:
        """Joint and coordinate of a reference that has been read."""
        return next((c.name, name) for c in self.joints for name in c.coordinates if text == f"{c.name}.{name}")

    def _coupled(self, kind: str, law: Coupling) -> Connection:
        """Enter a coupling: its joints keep their coordinates as unknowns, so that whole turns count."""
        of = law.coordinates_in("")
        if len(set(of)) < len(of):
            self.problems.append(f"{kind} '{law.name}': it names a coordinate twice; name different ones")
        joints = [self[joint] for joint, _ in of]
        first = joints[0]
        law.k, law.l, law.at, law.axis = first.k, first.l, first.joint.at, first.joint.axis
        for joint in joints:
            if joint.loose:
                self.problems.append(f"{kind} '{law.name}': joint '{joint.name}' has clearance, where whole turns of its "
                                     f"angle are not counted; give that joint another model")  # fmt: skip
            for part in (*joint.laws, *joint.as_kinematic):
                if hasattr(part, "kept"):
                    part.kept = True
        item = Connection(law.name, kind, first.k, first.l, [law])
        self._claim(law.name)
        self.connections.append(item)
        return item

    def _add_coupling(self, law: Coupling) -> Connection:
        """Enter a coupling that was given to `add` as an object, after its coordinates have been read."""
        kind, before = type(law).__name__.lower(), len(self.problems)
        arg = Argument(self, f"{kind} '{law.name}'", "of")
        of = {c: reference(_unit(law, c))(arg.part(f"of['{c}']"), value) for c, value in law.of.items()}
        if len(self.problems) > before:
            return Connection(law.name, kind, self.ground, self.ground, [])
        law.of = {c: self._at(text) for c, text in of.items()}
        return self._coupled(kind, law)


def _unit(law: Coupling, coordinate: str) -> str:
    """Unit of a coordinate, rad or m, where the law states one of them; else ""."""
    if coordinate not in law.coordinates:
        known = ", ".join(law.coordinates)
        raise LawError(f"{type(law).__name__} '{law.name}': of names the coordinate {coordinate!r}, which it does not have; give "
                       f"each of {known}")  # fmt: skip
    unit = law.coordinates[coordinate].unit
    return unit if unit in ("rad", "m") else ""
