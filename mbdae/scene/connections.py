"""Joints and forces between two bodies: laws added as objects, and checks of the points at which they act."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np

from mbdae.laws.forces import AppliedTorque
from mbdae.laws.forces.on_coordinate import OnCoordinate
from mbdae.scene import reading
from mbdae.scene.beams import check_attachments
from mbdae.scene.components import Array, Beam, Body, Clearance, Connection, Kinematic, Place
from mbdae.scene.couplings import CouplingStatements
from mbdae.scene.models import joint_model, law_of
from mbdae.scene.reading import Argument, reads
from mbdae.scene.record import statement
from mbdae.symbolic.coupling import Coupling
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Force
from mbdae.values import shown

NEEDED = ("name", "k", "l", "at", "axis", "at_l", "axis_x")


def own_copy(arg: Argument, law: Any) -> Joint | Force | Coupling:
    """A copy of a law with checked bodies, places and parameters; a force law without effect where `law` is no law."""
    if not isinstance(law, Joint | Force | Coupling):
        arg.wrong(f"{shown(law)} is no joint, force or coupling", "give an object of a class derived from mb.Joint, mb.Force or "
                   "mb.Coupling, with its name, bodies and parameters")  # fmt: skip
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
    if law.axis_x is not None:
        found.axis_x = reading.direction(head.part("axis_x"), law.axis_x)
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
                  "give a number, text, a tuple of them, a class, or a part, such as mb.Coulomb(mu, v_c)")  # fmt: skip


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
        law.axis = reading.unit(law.axis)
        law.axis_x = across(Argument(self, f"{type(law).__name__.lower()} '{law.name}'", "axis_x"), law.axis, law.axis_x)
        item = Connection(law.name, type(law).__name__.lower(), law.k, law.l, [law], isinstance(law, Joint))
        if isinstance(law, Joint):
            item.prescribed = {c: getattr(law, name) for c, name in law.prescribed.items()}
            item.model, item.left_open = model or Kinematic(), model is None and item.has_models
            arg = Argument(self, f"{item.kind} '{law.name}'", "model")
            if isinstance(model, Clearance):
                arg.wrong(f"{shown(model)} cannot be given to s.add, which does not place the contact of pin and race",
                          "state the joint by s.revolute or s.joint")  # fmt: skip
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
                                 f"mass as l, or use s.rigid_body")  # fmt: skip
        if item.k is item.l:
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
                                         f"use s.rigid_body")  # fmt: skip
                if law is item.joint and item.rubs and (side == "k" or item.unit(law.rubbed) == "rad"):
                    self.problems.append(f"{item.kind} '{item.name}': friction needs axes of the body on which it acts, and "
                                         f"the point mass '{body.name}' has none; use s.rigid_body")  # fmt: skip
                at = law.point_on(side)
                if np.linalg.norm(at - body.drawn.position) > 1e-9 * (1 + np.linalg.norm(body.drawn.position)):
                    self.problems.append(f"{item.kind} '{item.name}': the point mass '{body.name}' is at "
                                         f"{body.drawn.position.tolist()} m, not at {np.asarray(at).tolist()} m; "
                                         f"attach to it where it is")  # fmt: skip
                    break


def where(scene: Any, item: str, body: Body | Place, at: Any = None) -> Array:
    """The point (3,), m, of a joint, force or shape: as stated, else the place named, else the centre of mass of a rigid body."""
    if at is not None:
        return np.asarray(at)
    if isinstance(body, Beam):
        scene.problems.append(f"{item}: at which place of the beam '{body.name}' is not stated; give a point, or its beginning "
                              f"by '{body.name}'.at(0), its end by .at(1)")  # fmt: skip
    return np.array(body.point if isinstance(body, Place) else body.drawn.position, dtype=float)


def across(arg: Argument, axis: Array, axis_x: Any) -> Array | None:
    """Unit vector (3,) in the direction of a joint's x axis, which may not be along its axis; None where none is given."""
    if axis_x is None:
        return None
    found = reading.unit(axis_x)
    if np.linalg.norm(np.cross(found, axis)) < 1e-9:
        arg.wrong(f"{np.asarray(axis_x).tolist()} is along axis", "give a direction at an angle to axis")
        return None
    return found
