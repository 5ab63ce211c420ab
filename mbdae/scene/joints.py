"""The joints a user states: their laws by model, what acts on their coordinates, what is wrong with them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.contact import JournalContact, Normal
from mbdae.forces import JointDamper, JointForce, JointSpring, JointTorque
from mbdae.friction import Friction
from mbdae.joints import (
    ClassicalPrismatic,
    ClassicalRevolute,
    ClearanceRevolute,
    Distance,
    FixedOrientation,
    Prismatic,
    Revolute,
    Spherical,
    Weld,
)
from mbdae.scene.components import Classical, Clearance, Connection, Kinematic, Recursive
from mbdae.scene.reading import Reading
from mbdae.scene.record import statement
from mbdae.scene.rubbing import Rubbing, rubbing
from mbdae.scene.variants import MODELS
from mbdae.symbolic.law import Force, Joint, Law


class JointStatements(Reading):
    """`revolute`, `prismatic` and the joints without models."""

    if TYPE_CHECKING:

        def add(self, law: Joint | Force) -> Connection:
            """Add a law."""

        def _connect(self, item: Connection) -> Connection:
            """Add an item."""

        def _place_of(self, body: Any) -> Any:
            """Where a body or place is."""

    @statement
    def revolute(self, name: str, k: Any, l: Any, at: Any, axis: Any = (0, 0, 1), model: Any = None, angle: Any = None,
                 angle0: float | None = None, rate0: float | None = None, spring: float | None = None,
                 damper: float | None = None, torque: Any = None, friction: Any = None,
                 radius: float | None = None) -> Connection:  # fmt: skip
        """l turns relative to k about `axis` through `at`; the angle is 0 as drawn, positive about the axis.

        `angle` prescribes it (rad, number or expression of mb.t); `angle0` rad and `rate0` rad/s hold its start;
        `spring` N m/rad, `damper` N m s/rad and `torque` N m (on l) act about the axis. `friction` (mb.Coulomb, mb.LuGre or
        one's own) of a pin of `radius` m is pressed by the joint's reaction normal to the axis."""
        rubs = rubbing(self.problems, "revolute", name, friction, "radius", radius, model)
        return self._joint("revolute", Revolute, name, k, l, at, axis, model, angle, angle0, rate0, spring, damper, torque, rubs)

    @statement
    def prismatic(self, name: str, k: Any, l: Any, at: Any, axis: Any, position: Any = None, position0: float | None = None,
                  rate0: float | None = None, spring: float | None = None, damper: float | None = None,
                  force: Any = None, model: Any = None, friction: Any = None,
                  normal_force: float | None = None) -> Connection:  # fmt: skip
        """l slides relative to k along `axis` without turning; 0 as drawn. `position` m prescribes the displacement;
        `spring` N/m, `damper` N s/m, `force` N (on l) act along the axis. `friction` (mb.Coulomb, mb.LuGre or one's own) is
        pressed by `normal_force` N, by default the joint's reaction normal to the axis (its moments do not count)."""
        rubs = rubbing(self.problems, "prismatic", name, friction, "normal_force", normal_force, model)
        given = model, position, position0, rate0, spring, damper, force, rubs
        return self._joint("prismatic", Prismatic, name, k, l, at, axis, *given)

    @statement
    def spherical(self, name: str, k: Any, l: Any, at: Any) -> Connection:
        """The points of k and l at `at` stay together."""
        return self.add(Spherical(name, k, l, at))

    @statement
    def weld(self, name: str, k: Any, l: Any, at: Any = None) -> Connection:
        """l moves with k."""
        return self.add(Weld(name, k, l, at if at is not None else self._place_of(l)))

    @statement
    def distance(self, name: str, k: Any, l: Any, at_k: Any, at_l: Any) -> Connection:
        """Two points keep their distance: a massless rod with ball ends."""
        a, b = self._vector(name, "at_k", at_k, "m"), self._vector(name, "at_l", at_l, "m")
        length = float(np.linalg.norm(b - a))
        if length == 0:
            self.problems.append(f"distance '{name}': the two points coincide (distance 0 m); use s.spherical")
            length = 1.0
        joint = Distance(name, k, l, a, length=length)
        joint.at_l = b  # type: ignore[attr-defined]
        return self.add(joint)

    @statement
    def fixed_orientation(self, name: str, k: Any, l: Any) -> Connection:
        """l does not turn relative to k."""
        return self.add(FixedOrientation(name, k, l, self._place_of(l)))

    def _joint(self, kind: str, law: type[Joint], name: str, k: Any, l: Any, at: Any, axis: Any, model: Any, drive: Any,
               start: float | None, rate0: float | None, spring: float | None, damper: float | None,
               load: Any, rubs: Rubbing) -> Connection:  # fmt: skip
        modelled, extra = self._modelled(kind, name, law, model)
        where, direction = self._vector(name, "at", at, "m"), self._axis(name, axis)
        place: dict[str, Any] = {"k": k, "l": l, "at": where, "axis": direction}
        unit, what = law.coordinate_unit, ("position" if law is Prismatic else "angle")
        prescribed = self._timed(name, what, drive, unit)
        for value, option in ((start, f"{what}0"), (rate0, "rate0")):
            if value is not None and drive is not None:
                self.problems.append(f"{kind} '{name}': its prescribed value fixes the start already; omit {option} = {value!r}")
        start = None if start is None else self._number(name, f"{what}0", start, unit)
        rate0 = None if rate0 is None else self._number(name, "rate0", rate0, f"{unit}/s")
        forces: list[tuple[type[Law], dict[str, Any]]] = []
        if spring is not None:
            stiffness = self._number(name, "spring", spring, "N m/rad" if unit == "rad" else "N/m")
            turns = 0.0 if start is None or law is Prismatic else 2 * math.pi * round(start / (2 * math.pi))
            forces.append((JointSpring, {"stiffness": stiffness, "rest": 0.0, "turns": turns}))
        if damper is not None:
            damping = self._damping(name, "damper", damper, "N m s/rad" if unit == "rad" else "N s/m")
            forces.append((JointDamper, {"damping": damping}))
        if load is not None:
            what = "torque" if unit == "rad" else "force"
            forces.append((JointTorque if unit == "rad" else JointForce, {what: self._timed(name, what, load)}))
        forces += rubs.forces

        def laws(cls: type[Joint]) -> list[Law]:
            options, own = {"joint": cls}, rubs.values(cls)
            return [rubs.joint(cls)(name, drive=prescribed, **(extra if cls is modelled else {}), **own, **place),
                    *(f(name, **values, **({} if "joint" not in f.options else options), **place) for f, values in forces)]

        item = Connection(name, kind, k, l, laws(modelled), True, start, rate0, prescribed, model or Kinematic(),
                          left_open=model is None)
        item.as_kinematic = laws(law) if item.recursive or item.loose else []
        if item.loose and modelled is ClearanceRevolute:
            item.laws.append(JournalContact(name, outer=float(model.outer), inner=float(model.inner), normal=model.normal,
                                            friction=model.friction, length=model.length, **place))  # fmt: skip
        return self._connect(item)

    def _modelled(self, kind: str, name: str, law: type[Joint], model: Any) -> tuple[type[Joint], dict[str, float]]:
        """The law of a joint model, and what Eq. 2 adds to it where it is used."""
        model = model if model is not None else Kinematic()
        if isinstance(model, Clearance):
            wrong = _wrong_clearance(model) if law is Revolute else [f"model={model!r} exists for revolute joints only"]
            self.problems += [f"{kind} '{name}': {problem}" for problem in wrong]
            return (law, {}) if wrong else (ClearanceRevolute, {"tilting": model.length is not None})
        if not isinstance(model, Kinematic | Classical | Recursive):
            self.problems.append(f"{kind} '{name}': model={model!r} is not a joint model; use {MODELS}")
            return law, {}
        by_itself = {Revolute: ClassicalRevolute, Prismatic: ClassicalPrismatic}[law]
        cls = law if isinstance(model, Kinematic) else by_itself
        if isinstance(model, Recursive):
            return cls, {}
        if law is Prismatic and model != type(model)():
            self.problems.append(f"{kind} '{name}': model={model!r}: scaling and penalty exist for revolute joints only")
            return law, {}
        scaling = self._number(name, "model.scaling", model.scaling, "")
        penalty = self._number(name, "model.penalty", model.penalty, "N m")
        if scaling <= 0 or penalty < 0:
            self.problems.append(f"{kind} '{name}': model={model!r}: give scaling > 0 and penalty >= 0")
            return law, {}
        return cls, ({"scaling": scaling} if scaling != 1 else {}) | ({"penalty": penalty} if penalty else {})


def _wrong_clearance(model: Clearance) -> list[str]:
    """What is wrong with a clearance model, one sentence each."""
    found = []
    for key in ("outer", "inner", "length"):
        value = getattr(model, key)
        if value is None and key == "length":
            continue
        if not (isinstance(value, int | float) and 0 < value < math.inf):
            found.append(f"model.{key} = {value!r} m: give a positive length")
    if not found and model.inner > model.outer:
        found.append(f"model.inner = {model.inner:g} m is larger than model.outer = {model.outer:g} m: the pin does not fit into "
                     f"the race; k carries the race, l the pin")  # fmt: skip
    if not isinstance(model.normal, Normal):
        found.append(f"model.normal = {model.normal!r} is no normal law; give mb.Hertz(stiffness, damping)")
    if not isinstance(model.friction, Friction | None):
        found.append(f"model.friction = {model.friction!r} is no friction law; give mb.Coulomb(mu, v_c), mb.LuGre(...) or None")
    return found
