"""Statements of couplings between coordinates of joints.

Joints and forces between two bodies: laws added as objects, and checks of the points at which they act.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from typing import Any

import numpy as np

from mbdae.errors import LawError
from mbdae.laws.forces import AppliedTorque
from mbdae.laws.on_coordinates import Differential, Gear, OnCoordinate, Rack, WeightedSum
from mbdae.scene import reading
from mbdae.scene.beams import check_attachments
from mbdae.scene.components import Beam, Body, Clearance, Connection, Kinematic, Place
from mbdae.scene.models import joint_model, law_of
from mbdae.scene.reading import Argument, reads
from mbdae.scene.record import SceneItems, statement
from mbdae.symbolic.class_checks import PLACES
from mbdae.symbolic.joint import Coupling, Joint, Reference
from mbdae.symbolic.law import Force
from mbdae.values import Array, BadValueError, number, shown

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
              f"state the joints before the coupling")
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
                            [first, second, carrier])

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
                                     f"angle are not counted; give that joint another model")
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
                       f"each of {known}")
    unit = law.coordinates[coordinate].unit
    return unit if unit in ("rad", "m") else ""


NEEDED = ("name", "k", "l", *PLACES)


def own_copy(arg: Argument, law: Any) -> Joint | Force | Coupling:
    """A copy of a law with checked bodies, places and parameters; a force law without effect where `law` is no law."""
    if not isinstance(law, Joint | Force | Coupling):
        arg.wrong(f"{shown(law)} is no joint, force or coupling", "give an object of a class derived from mb.Joint, mb.Force or "
                   "mb.Coupling, with its name, bodies and parameters")
        return _nothing(arg)
    kind = type(law).__name__
    needed = ("name", "of") if isinstance(law, Coupling) else NEEDED
    missing = [key for key in (*needed, *law.params, *law.options) if key not in vars(law)]
    if missing:
        own = "name, of, **parameters" if isinstance(law, Coupling) else "name, k, l, at=at, axis=axis, **parameters"
        arg.wrong(f"a {kind} whose attribute {missing[0]} was not set", f"let {kind}.__init__ call super().__init__({own})")
        return _nothing(arg)
    found: Any = copy(law)
    found.name = reading.name(Argument(arg.scene, kind, "name"), law.name)
    head = Argument(arg.scene, f"{kind} '{found.name}'", "")
    if not isinstance(law, Coupling):
        _read_places(head, law, found)
    for key, parameter in law.params.items():
        value = getattr(law, key)
        sensors = isinstance(law, Force)
        read = reading.quantity(parameter.unit) if law.timeless else reading.driven(parameter.unit, sensors)
        setattr(found, key, None if value is None else read(head.part(key), value))
    for key in law.options:
        _refuse_unhashable(head.part(key), getattr(law, key))
    return found  # type: ignore[no-any-return]


def _read_places(head: Argument, law: Joint | Force, found: Any) -> None:
    """Write the checked bodies, points and directions of a law into its copy `found`."""
    found.k, found.l = (reading.body(head.part(side), getattr(law, side)) for side in "kl")
    found.at = None if law.at is None else reading.point(head.part("at"), law.at)
    found.axis = reading.direction(head.part("axis"), law.axis)
    for key in ("axis_x", "axis_l", "axis_x_l"):
        if getattr(law, key) is not None:
            setattr(found, key, reading.direction(head.part(key), getattr(law, key)))
    for side in law.frames[2:]:
        setattr(found, side, reading.body(head.part(side), getattr(law, side)))
    found.points = {side: reading.point(head.part(f"at_{side}"), point) for side, point in law.points.items()}
    if law.at_l is not None:
        found.at_l = reading.point(head.part("at_l"), law.at_l)


def _refuse_unhashable(arg: Argument, value: Any) -> None:
    """Report a value of an option that is not hashable: derived equations are cached by the options of their law."""
    try:
        hash(value)
    except Exception:  # a hash of the user's own may raise anything
        arg.wrong(f"{shown(value)} is not hashable, which options of laws have to be",
                  "give a number, text, a tuple of them, a class, or a part, such as mb.Coulomb(mu, v_c)")


def _nothing(arg: Argument) -> Force:
    return Force(reading.NAMELESS, reading.nobody(arg.scene), reading.nobody(arg.scene), at=np.zeros(3))


class ConnectionStatements(CouplingStatements):
    """`add`, and the entry of every joint and force into the scene."""

    @reads(law=own_copy, model=joint_model)
    @statement
    def add(self, law: Joint | Force | Coupling, model: Any = None) -> Connection:
        """Add a joint, force or coupling, the package's or the user's own; `model` of a joint as in `joint`. The scene keeps a
        copy: what happens to the law afterwards does not change it."""
        if isinstance(law, Coupling):
            return self._add_coupling(law)
        if law.at is None:
            law.at = where(self, f"{type(law).__name__.lower()} '{law.name}'", law.l, None)
        vars(law).update(directions(Argument(self, f"{type(law).__name__.lower()} '{law.name}'", ""), law.axis, law.axis_x,
                                    law.axis_l, law.axis_x_l))
        item = Connection(law.name, type(law).__name__.lower(), law.k, law.l, [law], isinstance(law, Joint))
        if isinstance(law, Joint):
            item.prescribed = {c: getattr(law, name) for c, name in law.prescribed.items()}
            item.model, item.left_open = model or Kinematic(), model is None and item.has_models
            arg = Argument(self, f"{item.kind} '{law.name}'", "model")
            if isinstance(model, Clearance):
                arg.wrong(f"{shown(model)} cannot be given to s.add, which does not place the contact of pin and race",
                          "state the joint by s.revolute or s.joint")
            elif model is not None:
                modelled = law_of(arg, type(law), model)[1]
                item.as_kinematic = [copy(law)] if item.recursive else []
                vars(law).update(modelled | {"kept": modelled.get("kept", False) or law.must_keep()})
        elif model is not None:
            self.problems.append(f"{item.kind} '{law.name}': model = {shown(model)}: a force has no joint model; omit it")
        return self._connect(item)

    def _connect(self, item: Connection) -> Connection:
        item.places = {side: b.point for side, b in (("k", item.k), ("l", item.l)) if isinstance(b, Place)}
        item.k, item.l = (b.body if isinstance(b, Place) else b for b in (item.k, item.l))
        first = item.laws[0]
        item.others = {side: getattr(first, side) for side in first.frames[2:]}
        for law in (*item.laws, *item.as_kinematic):
            law.k, law.l = item.k, item.l
            if item.loose and item.l.is_point:  # the pin may be drawn anywhere in its play
                law.at_l = item.l.drawn.position
        if item.loose and item.k.is_point:
            self.problems.append(f"{item.kind} '{item.name}': mb.Clearance has its race on body k, and the point "
                                 f"mass '{item.k.name}' cannot carry the race: it has no orientation; give the point "
                                 f"mass as l, or use s.rigid_body")
        if item.k is item.l and not item.others:
            self.problems.append(f"{item.kind} '{item.name}': connects '{item.k.name}' with itself; name two different bodies")
        self._check_point_masses(item)
        check_attachments(self, item)
        self._claim(item.name)
        self.connections.append(item)
        self._keep_read_coordinates(item)
        return item

    def _check_point_masses(self, item: Connection) -> None:
        """Report torques and friction on point masses, which have no axes, and attachments at other points than their own."""
        for body, side in ((item.k, "k"), (item.l, "l")):
            for law in item.laws if body.is_point else ():
                turns = isinstance(law, OnCoordinate) and law.loads and law.unit == "rad"
                if turns or isinstance(law, AppliedTorque):
                    self.problems.append(f"{item.kind} '{item.name}': a torque does nothing on the point mass '{body.name}'; "
                                         f"use s.rigid_body")
                if law is item.joint and item.rubs and (side == "k" or item.unit(law.rubbed) == "rad"):
                    self.problems.append(f"{item.kind} '{item.name}': friction needs axes of the body on which it acts, and "
                                         f"the point mass '{body.name}' has none; use s.rigid_body")
                at = law.point_on(side)
                if np.linalg.norm(at - body.drawn.position) > 1e-9 * (1 + np.linalg.norm(body.drawn.position)):
                    self.problems.append(f"{item.kind} '{item.name}': the point mass '{body.name}' is at "
                                         f"{body.drawn.position.tolist()} m, not at {np.asarray(at).tolist()} m; "
                                         f"attach to it where it is")
                    break


def where(scene: Any, item: str, body: Body | Place, at: Any = None) -> Array:
    """The point (3,), m, of a joint, force or shape: as stated, else the place named, else the centre of mass of a rigid body."""
    if at is not None:
        return np.asarray(at)
    if isinstance(body, Beam):
        scene.problems.append(f"{item}: at which place of the beam '{body.name}' is not stated; give a point, or its beginning "
                              f"by '{body.name}'.at(0), its end by .at(1)")
    return np.array(body.point if isinstance(body, Place) else body.drawn.position, dtype=float)


def directions(item: Argument, axis: Any, axis_x: Any, axis_l: Any = None, axis_x_l: Any = None) -> dict[str, Any]:
    """The directions of a law's frames on k and on l as unit vectors, by argument."""
    z, z_l = reading.unit(axis), None if axis_l is None else reading.unit(axis_l)
    x_l = across(item.part("axis_x_l"), z if z_l is None else z_l, axis_x_l, "axis_l")
    if z_l is not None and x_l is None and z @ z_l < 1e-12 - 1:
        item.part("axis_l").wrong(f"{z_l.tolist()} is opposite to axis, so that l may turn either way to the frame of k",
                                  "give axis_x_l too, or the axis in the other sense")
        z_l = None
    return {"axis": z, "axis_x": across(item.part("axis_x"), z, axis_x), "axis_l": z_l, "axis_x_l": x_l}


def across(arg: Argument, axis: Array, axis_x: Any, word: str = "axis") -> Array | None:
    """Unit vector (3,) in the direction of a joint's x axis, not along its axis; None where none is given. word: the statement's
    name of the axis."""
    if axis_x is None:
        return None
    found = reading.unit(axis_x)
    if np.linalg.norm(np.cross(found, axis)) < 1e-9:
        arg.wrong(f"{np.asarray(axis_x).tolist()} is along {word}", f"give a direction at an angle to {word}")
        return None
    return found
