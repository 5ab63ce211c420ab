"""Statements of joints: the law for each joint model, the forces on its coordinate, checks of the arguments."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbdae.laws.contact import JournalContact
from mbdae.laws.forces import JointDamper, JointForce, JointSpring, JointTorque
from mbdae.laws.joints import ClearanceRevolute, Distance, FixedOrientation, Prismatic, Revolute, Spherical, Weld
from mbdae.scene import reading
from mbdae.scene.components import Connection, Kinematic
from mbdae.scene.connections import ConnectionStatements
from mbdae.scene.models import friction_law, joint_model, law_of
from mbdae.scene.reading import FEEDS, Argument, reads
from mbdae.scene.record import statement
from mbdae.scene.rubbing import Rubbing, rubbing
from mbdae.symbolic.law import Joint, TwoBodyLaw


class JointStatements(ConnectionStatements):
    """`revolute`, `prismatic` and the joints without models."""

    @reads(name=reading.name, k=reading.body, l=reading.body, at=reading.point, axis=reading.direction, model=joint_model,
           angle=reading.driven("rad"), angle0=reading.quantity("rad"), rate0=reading.quantity("rad/s"),
           spring=reading.quantity("N m/rad"), damper=reading.quantity("N m s/rad", "not negative", FEEDS),
           torque=reading.driven("N m"), friction=friction_law, radius=reading.quantity("m", "positive"))  # fmt: skip
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

    @reads(name=reading.name, k=reading.body, l=reading.body, at=reading.point, axis=reading.direction,
           position=reading.driven("m"), position0=reading.quantity("m"), rate0=reading.quantity("m/s"),
           spring=reading.quantity("N/m"), damper=reading.quantity("N s/m", "not negative", FEEDS), force=reading.driven("N"),
           model=joint_model, friction=friction_law, normal_force=reading.quantity("N", "not negative"))  # fmt: skip
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

    @reads(name=reading.name, k=reading.body, l=reading.body, at=reading.point)
    @statement
    def spherical(self, name: str, k: Any, l: Any, at: Any) -> Connection:
        """The points of k and l at `at` stay together."""
        return self.add(Spherical(name, k, l, at))

    @reads(name=reading.name, k=reading.body, l=reading.body, at=reading.point)
    @statement
    def weld(self, name: str, k: Any, l: Any, at: Any = None) -> Connection:
        """l moves with k."""
        return self.add(Weld(name, k, l, at))

    @reads(name=reading.name, k=reading.body, l=reading.body, at_k=reading.point, at_l=reading.point)
    @statement
    def distance(self, name: str, k: Any, l: Any, at_k: Any, at_l: Any) -> Connection:
        """Two points keep their distance: a massless rod with ball ends."""
        length = float(np.linalg.norm(at_l - at_k))
        if length == 0:
            self.problems.append(f"distance '{name}': the two points coincide (distance 0 m); use s.spherical")
            length = 1.0
        return self.add(Distance(name, k, l, at_k, at_l=at_l, length=length))

    @reads(name=reading.name, k=reading.body, l=reading.body)
    @statement
    def fixed_orientation(self, name: str, k: Any, l: Any) -> Connection:
        """l does not turn relative to k."""
        return self.add(FixedOrientation(name, k, l))

    def _joint(self, kind: str, law: type[Joint], name: str, k: Any, l: Any, at: Any, axis: Any, model: Any, drive: Any,
               start: float | None, rate0: float | None, spring: float | None, damper: float | None,
               load: Any, rubs: Rubbing) -> Connection:  # fmt: skip
        modelled, extra = law_of(Argument(self, f"{kind} '{name}'", "model"), law, model)
        place: dict[str, Any] = {"k": k, "l": l, "at": at, "axis": reading.unit(axis)}
        unit, what = law.coordinate_unit, ("position" if law is Prismatic else "angle")
        for value, option in ((start, f"{what}0"), (rate0, "rate0")):
            if value is not None and drive is not None:
                self.problems.append(f"{kind} '{name}': its prescribed value fixes the start already; omit {option} = {value:g}")
        forces: list[tuple[type[TwoBodyLaw], dict[str, Any]]] = []
        if spring is not None:
            turns = 0.0 if start is None or law is Prismatic else 2 * math.pi * round(start / (2 * math.pi))
            forces.append((JointSpring, {"stiffness": spring, "rest": 0.0, "turns": turns}))
        if damper is not None:
            forces.append((JointDamper, {"damping": damper}))
        if load is not None:
            forces.append((JointTorque, {"torque": load}) if unit == "rad" else (JointForce, {"force": load}))
        forces += rubs.forces

        def laws(cls: type[Joint]) -> list[TwoBodyLaw]:
            options, own = {"joint": cls}, rubs.values(cls)
            return [rubs.joint(cls)(name, drive=drive, **(extra if cls is modelled else {}), **own, **place),
                    *(f(name, **values, **({} if "joint" not in f.options else options), **place) for f, values in forces)]

        item = Connection(name, kind, k, l, laws(modelled), True, start, rate0, drive, model or Kinematic(),
                          left_open=model is None)
        item.as_kinematic = laws(law) if item.recursive or item.loose else []
        if item.loose and modelled is ClearanceRevolute:
            item.laws.append(JournalContact(name, outer=model.outer, inner=model.inner, normal=model.normal,
                                            friction=model.friction, length=model.length, **place))  # fmt: skip
        return self._connect(item)
