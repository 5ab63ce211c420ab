"""Statements of joints: `joint` takes every joint; the others are short forms of it."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import signature
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.deferred import Later
from mbdae.errors import unknown_name
from mbdae.laws.joint_rows import Distance, FixedOrientation, KnifeEdge, PointOnLine, PointOnPlane, Rolling, RollingBall
from mbdae.laws.joints import FREE, Cylindrical, Planar, Prismatic, Revolute, Screw, Spherical, Universal, Weld, generic
from mbdae.scene import reading
from mbdae.scene.components import Clearance, Connection, Kinematic
from mbdae.scene.connections import ConnectionStatements, across, directions, where
from mbdae.scene.coordinates import on_coordinates
from mbdae.scene.models import friction_law, joint_model, law_of
from mbdae.scene.reading import FEEDS, Argument, reads
from mbdae.scene.record import STATEMENTS, statement
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import TwoBodyLaw
from mbdae.values import shown

if TYPE_CHECKING:
    from mbdae.laws.journal import JournalContact
else:
    JournalContact = Later("mbdae.laws.journal", "JournalContact")

OPTIONS = ("prescribed", "start", "start_rate", "spring", "damper", "load", "limits", "stop", "friction", "rotor")
BODIES = {"name": reading.name, "k": reading.body, "l": reading.body, "at": reading.point}
PLACED = {**BODIES, "axis": reading.direction}
#: law -> remedy in the message about a missing parameter, where another statement takes the parameter from the drawing
MEASURED: dict[type[Joint], str] = {Distance: "use s.distance(...), which measures it"}
EACH = dict.fromkeys(OPTIONS, reading.as_given)  #: values by coordinate are checked when the coordinates are known
FLAT = 1e-6  #: sine of the angle between axle and normal up to which a disc counts as lying flat
#: further arguments of every joint: where its frame on l is, if not where that on k is
OF_L = {"at_l": reading.point, "axis_l": reading.direction, "axis_x_l": reading.direction}
FURTHER = {"model": joint_model, **EACH, "further": reading.as_given}


class JointStatements(ConnectionStatements):
    """`joint`, and a word for every joint of the library."""

    @reads(joint=reading.joint_class, **PLACED, axis_x=reading.direction, **FURTHER)
    @statement
    def joint(self, joint: type[Joint], name: str, k: Any, l: Any, at: Any = None, axis: Any = (0, 0, 1), axis_x: Any = None,
              model: Any = None, prescribed: Any = None, start: Any = None, start_rate: Any = None, spring: Any = None,
              damper: Any = None, load: Any = None, limits: Any = None, stop: Any = None, friction: Any = None,
              rotor: Any = None, **further: Any) -> Connection:
        """A joint of a class derived from mb.Joint between k and l at a point (m, as drawn), with its parameters by name.

        `model`: mb.Kinematic(), mb.Classical(), mb.Recursive() or, for joints with a pin, mb.Clearance(...). The other options
        belong to a coordinate: one value where the joint has one coordinate, else a mapping by coordinate name. `prescribed`: its
        value (rad or m, number or expression of mb.t); `start`, `start_rate`: at the start; `spring` (N m/rad or N/m), `damper`
        (N m s/rad or N s/m), `load` (N m or N, on l); `limits` (lowest, highest) with `stop=mb.Stop(stiffness, damping)`;
        `friction` (mb.Coulomb, mb.LuGre or one's own) with `radius` (m) for angles, and `normal_force` (N), by default the
        joint's reaction normal to the axis; `rotor` (kg m^2 or kg) an inertia that moves with the coordinate alone, of a
        motor i^2 times that of its rotor (i its gear ratio). `axis_x`: direction of the joint's x axis, by default any normal
        to `axis`. `at_l`, `axis_l`, `axis_x_l`: the joint's frame on l, where it is drawn elsewhere or turned."""
        options = {"prescribed": prescribed, "start": start, "start_rate": start_rate, "spring": spring, "damper": damper,
                   "load": load, "limits": limits, "stop": stop, "friction": friction, "rotor": rotor}
        point = where(self, f"joint '{name}'", l, at)
        return self._joint("joint", joint, name, k, l, point, axis, axis_x, model, options, further)

    @reads(**PLACED, model=joint_model, angle=reading.driven("rad"), angle0=reading.quantity("rad"),
           rate0=reading.quantity("rad/s"), spring=reading.driven("N m/rad", True),
           damper=reading.driven("N m s/rad", True, least=FEEDS), torque=reading.driven("N m", True, named=True),
           friction=friction_law, radius=reading.quantity("m", "positive"), limits=reading.as_given, stop=reading.as_given,
           normal_force=reading.quantity("N", "not negative"), axis_l=reading.direction)
    @statement
    def revolute(self, name: str, k: Any, l: Any, at: Any, axis: Any = (0, 0, 1), model: Any = None, angle: Any = None,
                 angle0: float | None = None, rate0: float | None = None, spring: Any = None,
                 damper: Any = None, torque: Any = None, friction: Any = None, radius: float | None = None,
                 limits: Any = None, stop: Any = None, normal_force: float | None = None, axis_l: Any = None) -> Connection:
        """l turns relative to k about `axis` through `at` (m, as drawn); the angle is 0 as drawn, positive about the axis.

        `angle` prescribes it (rad, number or expression of mb.t); `angle0` rad and `rate0` rad/s hold its start;
        `spring` N m/rad, `damper` N m s/rad and `torque` N m (on l) act about the axis. `friction` (mb.Coulomb, mb.LuGre or
        one's own) of a pin of `radius` m is pressed by `normal_force` N, by default the joint's reaction normal to the axis.
        `limits` (lowest, highest) rad with `stop=mb.Stop(stiffness, damping)`. `axis_l`: the axis on l, where l is drawn turned
        against the joint; the start turns the bodies."""
        words = {"prescribed": "angle", "start": "angle0", "start_rate": "rate0", "load": "torque"}
        options = {"prescribed": angle, "start": angle0, "start_rate": rate0, "spring": spring, "damper": damper, "load": torque,
                   "friction": friction, "radius": radius, "normal_force": normal_force, "limits": limits,
                   "stop": stop}
        return self._joint("revolute", Revolute, name, k, l, at, axis, None, model, options, {"axis_l": axis_l}, words)

    @reads(**PLACED, position=reading.driven("m"), position0=reading.quantity("m"), rate0=reading.quantity("m/s"),
           spring=reading.driven("N/m", True), damper=reading.driven("N s/m", True, least=FEEDS),
           force=reading.driven("N", True, named=True), model=joint_model, friction=friction_law,
           normal_force=reading.quantity("N", "not negative"), limits=reading.as_given, stop=reading.as_given,
           axis_l=reading.direction)
    @statement
    def prismatic(self, name: str, k: Any, l: Any, at: Any, axis: Any, position: Any = None, position0: float | None = None,
                  rate0: float | None = None, spring: Any = None, damper: Any = None,
                  force: Any = None, model: Any = None, friction: Any = None, normal_force: float | None = None,
                  limits: Any = None, stop: Any = None, axis_l: Any = None) -> Connection:
        """l slides relative to k along `axis` through `at` (m) without turning; 0 as drawn. `position` m prescribes the
        displacement; `spring` N/m, `damper` N s/m, `force` N (on l) act along the axis. `friction` (mb.Coulomb, mb.LuGre or one's
        own) is pressed by `normal_force` N, by default the joint's reaction normal to the axis (its moments do not count).
        `limits` (lowest, highest) m with `stop=mb.Stop(stiffness, damping)`. `axis_l`: the axis on l, as in `revolute`."""
        words = {"prescribed": "position", "start": "position0", "start_rate": "rate0", "load": "force"}
        options = {"prescribed": position, "start": position0, "start_rate": rate0, "spring": spring, "damper": damper,
                   "load": force, "friction": friction, "normal_force": normal_force, "limits": limits, "stop": stop}
        return self._joint("prismatic", Prismatic, name, k, l, at, axis, None, model, options, {"axis_l": axis_l}, words)

    @reads(**PLACED, further=reading.as_given)
    @statement
    def cylindrical(self, name: str, k: Any, l: Any, at: Any, axis: Any, **further: Any) -> Connection:
        """l slides along `axis` and turns about it: coordinates `displacement` and `angle`. Further arguments as in `joint`."""
        return self._library("cylindrical", Cylindrical, name, k, l, at, axis, None, further)

    @reads(**PLACED, lead=reading.quantity("m"), further=reading.as_given)
    @statement
    def screw(self, name: str, k: Any, l: Any, at: Any, axis: Any, lead: float, **further: Any) -> Connection:
        """l turns about `axis` (coordinate `angle`) and travels along it by `lead` m a turn, right-handed where positive. Further
        arguments as in `joint`."""
        return self._library("screw", Screw, name, k, l, at, axis, None, {**further, "lead": lead})

    @reads(**PLACED, axis_l=reading.direction, pin=reading.direction, further=reading.as_given)
    @statement
    def universal(self, name: str, k: Any, l: Any, at: Any, axis: Any, axis_l: Any = None, pin: Any = None,
                  **further: Any) -> Connection:
        """Hooke's joint: `axis` and `axis_l` are the shafts of k and l (by default in line), `pin` the pin of k, by default
        normal to both shafts; that of l is normal to its shaft and to the pin of k. Coordinates `angle_k` of the cross about the
        pin of k, `angle_l` of l about its own, 0 as drawn. Further arguments as in `joint`."""
        shaft = reading.unit(axis)
        other = shaft if axis_l is None else reading.unit(axis_l)
        first = pins(Argument(self, f"universal '{name}'", "pin"), shaft, other, pin)
        return self._library("universal", Universal, name, k, l, at, np.cross(first, reading.unit(np.cross(other, first))), first,
                             further)

    @reads(**PLACED, axis_x=reading.direction, further=reading.as_given)
    @statement
    def planar(self, name: str, k: Any, l: Any, at: Any, axis: Any, axis_x: Any = None, **further: Any) -> Connection:
        """l slides in the plane normal to `axis` and turns about it: coordinates `x` (along `axis_x`), `y`, `angle`. Further
        arguments as in `joint`."""
        return self._library("planar", Planar, name, k, l, at, axis, axis_x, further)

    @reads(**PLACED, further=reading.as_given)
    @statement
    def point_on_line(self, name: str, k: Any, l: Any, at: Any, axis: Any, **further: Any) -> Connection:
        """The point of l at `at` slides along the line through it in k: coordinate `displacement`; all rotations are free.
        Further arguments as in `joint`."""
        return self._library("point_on_line", PointOnLine, name, k, l, at, axis, None, further)

    @reads(**PLACED, axis_x=reading.direction, further=reading.as_given)
    @statement
    def point_on_plane(self, name: str, k: Any, l: Any, at: Any, axis: Any, axis_x: Any = None, **further: Any) -> Connection:
        """The point of l at `at` stays in the plane of k normal to `axis`: coordinates `x` (along `axis_x`), `y`; all rotations
        are free. Further arguments as in `joint`."""
        return self._library("point_on_plane", PointOnPlane, name, k, l, at, axis, axis_x, further)

    @reads(**BODIES, model=joint_model)
    @statement
    def spherical(self, name: str, k: Any, l: Any, at: Any, model: Any = None) -> Connection:
        """The points of k and l at `at` (3,), m, as drawn, stay together; all rotations are free."""
        return self._joint("spherical", Spherical, name, k, l, at, (0, 0, 1), None, model, {}, {})

    @reads(name=reading.name, k=reading.body, l=reading.body, at=reading.point)
    @statement
    def weld(self, name: str, k: Any, l: Any, at: Any = None) -> Connection:
        """l is fixed to k: no relative displacement or rotation."""
        return self.add(Weld(name, k, l, at))

    @reads(name=reading.name, k=reading.body, l=reading.body, at_k=reading.point, at_l=reading.point)
    @statement
    def distance(self, name: str, k: Any, l: Any, at_k: Any, at_l: Any) -> Connection:
        """Two points, m as drawn, keep their distance: a massless rod with ball ends."""
        length = float(np.linalg.norm(at_l - at_k))
        if length == 0:
            self.problems.append(f"distance '{name}': the two points coincide (distance 0 m); use s.spherical")
            length = 1.0
        return self.add(Distance(name, k, l, at_k, at_l=at_l, length=length))

    @reads(**BODIES, further=reading.as_given)
    @statement
    def fixed_orientation(self, name: str, k: Any, l: Any, at: Any = None, **further: Any) -> Connection:
        """l does not turn relative to k: coordinates `x`, `y`, `z`, displacements of the point of l at `at`, by default its
        centre. Further arguments as in `joint`."""
        point = where(self, f"fixed_orientation '{name}'", l, at)
        return self._library("fixed_orientation", FixedOrientation, name, k, l, point, (0, 0, 1), None, further)

    @reads(**PLACED, axis_x=reading.direction, free=reading.as_given, further=reading.as_given)
    @statement
    def generic(self, name: str, k: Any, l: Any, at: Any, axis: Any = (0, 0, 1), axis_x: Any = None, free: Any = (),
                **further: Any) -> Connection:
        """l moves along and about some of the joint's axes: `axis` is its z, `axis_x` its x, by default any normal to it. `free`
        names those of x, y, z, angle_x, angle_y, angle_z that are free and its coordinates, all 0 as drawn: displacements along
        the axes of k, and rotations one after the other in this order. Further arguments as in `joint`."""
        arg = Argument(self, f"generic '{name}'", "free")
        names = [free] if isinstance(free, str) else list(free) if isinstance(free, list | tuple) else [None]
        if any(not isinstance(n, str) or n not in FREE for n in names) or len({*names}) < len(names):
            arg.wrong(f"{shown(free)} is no list of free directions", f"give some of {', '.join(FREE)}, each once")
            names = []
        law = generic(tuple(names)) if names else Weld
        return self._library("generic", law, name, k, l, at, axis, axis_x, further)

    @reads(**PLACED, radius=reading.quantity("m", "positive"), normal=reading.direction)
    @statement
    def rolling(self, name: str, k: Any, l: Any, at: Any, axis: Any = None, radius: float = 1.0,
                normal: Any = (0, 0, 1)) -> Connection:
        """The thin edge of a disc or wheel l, or a ball, rolls without slip on the plane of k with this `normal` (towards l) that
        touches it as drawn. `at`: its centre as drawn, m; `axis`: its axle, None: a ball; `radius` m. The wheel cannot
        lift off; r[name].force is the force on it. A spin that is not stated follows from the stated velocity."""
        up = reading.unit(normal)
        if axis is None:
            return self._joint("rolling", RollingBall, name, k, l, at, up, None, None, {}, {"radius": radius})
        axle = reading.unit(axis)
        lateral = up - (up @ axle) * axle
        if np.linalg.norm(lateral) < FLAT:
            Argument(self, f"rolling '{name}'", "axis").wrong(
                f"{axle.tolist()} is along normal = {up.tolist()}: the disc lies flat on the plane",
                "give the axle as drawn, at an angle to the normal")
            lateral = np.cross(axle, np.eye(3)[int(np.argmin(np.abs(axle)))])
        lean = float(np.arcsin(np.clip(up @ axle, -1, 1)))
        return self._joint("rolling", Rolling, name, k, l, at, axle, reading.unit(lateral), None, {},
                           {"radius": radius, "lean": lean or None})

    @reads(**BODIES, along=reading.direction, normal=reading.direction)
    @statement
    def knife_edge(self, name: str, k: Any, l: Any, at: Any, along: Any, normal: Any = (0, 0, 1)) -> Connection:
        """The point of l at `at` (m, as drawn) moves relative to k in the direction of a blade of l, `along` as drawn, and not
        across it, as a skate on ice: in the plane of k with this `normal`, in which other joints have to keep it."""
        up = reading.unit(normal)
        blade = across(Argument(self, f"knife_edge '{name}'", "along"), up, along, "normal")
        return self._joint("knife_edge", KnifeEdge, name, k, l, at, up, blade, None, {}, {})

    def _library(self, kind: str, law: type[Joint], name: str, k: Any, l: Any, at: Any, axis: Any, axis_x: Any,
                 further: dict[str, Any]) -> Connection:
        """A joint of the library whose options are given as for `joint`."""
        model = further.get("model")
        model = model if model is None else joint_model(Argument(self, f"{kind} '{name}'", "model"), model)
        options = {option: further.get(option) for option in OPTIONS}
        rest = {key: value for key, value in further.items() if key not in (*OPTIONS, "model")}
        return self._joint(kind, law, name, k, l, at, axis, axis_x, model, options, rest)

    def _joint(self, kind: str, law: type[Joint], name: str, k: Any, l: Any, at: Any, axis: Any, axis_x: Any, model: Any,
               options: dict[str, Any], further: dict[str, Any],
               words: Mapping[str, str] | None = None) -> Connection:
        item = f"{kind} '{name}'"
        ours = [key for key in ("radius", "normal_force") if key in further and key not in law.params]
        options = options | {key: further.pop(key) for key in ours}
        of_l = {key: further.pop(key, None) for key in OF_L}
        of_l = {key: OF_L[key](Argument(self, item, key), value) for key, value in of_l.items() if value is not None}
        given = on_coordinates(self, item, law, words or {}, options, model)
        modelled, extra = law_of(Argument(self, item, "model"), law, model)
        numbers = self._numbers(kind, item, law, further)
        place: dict[str, Any] = {"k": k, "l": l, "at": at, "at_l": of_l.pop("at_l", None),
                                 **directions(Argument(self, item, ""), axis, axis_x, **of_l)}
        forces = given.forces()

        def laws(cls: type[Joint], extra: dict[str, Any]) -> list[TwoBodyLaw]:
            drives = {cls.drive_name(c): value for c, value in given.of("prescribed").items()}
            own = {**numbers, **given.own} if cls is law else {}
            kept = extra.get("kept") or given.unreadable or given.counts_turns
            joint = cls(name, **{**drives, **extra, **own, "kept": kept}, **place)
            on = {"joint": cls, "kept": joint.kept}
            return [joint, *(f(name, **{**values, **on}, **place) for f, values in forces)]

        found = Connection(name, kind, k, l, laws(modelled, extra), True, given.of("start"), given.of("start_rate"),
                           given.of("prescribed"), model or Kinematic(), left_open=model is None)
        found.rotor = given.of("rotor")
        found.as_kinematic = laws(law, {}) if found.recursive or found.loose else []
        if isinstance(model, Clearance) and modelled is law.loose:
            found.laws.append(JournalContact(name, outer=model.outer, inner=model.inner, normal=model.normal,
                                             friction=model.friction, length=model.length, **place))
        return self._connect(found)

    def _numbers(self, kind: str, item: str, law: type[Joint], further: dict[str, Any]) -> dict[str, Any]:
        """Parameters and options of a joint by name."""
        own = {key for key in (*law.params, *law.options) if key not in law.derived()}
        found = {}
        for key, value in further.items():
            if key not in own:
                self.problems.append(f"{item}: {_no_argument(kind, law, key, own)}")
            else:
                read = reading.driven(law.params[key].unit) if key in law.params else reading.as_given
                found[key] = value if value is None else read(Argument(self, item, key), value)
        for key in sorted(own & law.params.keys() - found.keys()):
            if key not in law.optional:
                remedy = MEASURED.get(law, f"give a number in {law.params[key].unit}")
                self.problems.append(f"{item}: {key} is missing; {remedy}")
                found[key] = 1.0
        return found


def _no_argument(kind: str, law: type[Joint], key: str, own: set[str]) -> str:
    """Message that the joint does not have an argument `key`, with what to give in its place. kind: the statement; own:
    parameters of the joint."""
    coordinate = key.removesuffix("_rate")
    if coordinate not in law.scalars():
        known = {*signature(STATEMENTS.get(kind, STATEMENTS["joint"])).parameters, *OPTIONS, *OF_L, "model"} - {"self", "further"}
        return f"it has no argument {unknown_name(key, {*own, *known})} it takes {', '.join(sorted({*own, *known}))}"
    if coordinate != key:
        return f"it has no argument '{key}'; to start with a rate of its coordinate give start_rate={{'{coordinate}': ...}}"
    return (f"it has no argument '{key}'; to prescribe its coordinate give prescribed={{'{key}': ...}}, to start there "
            f"start={{'{key}': ...}}")


def pins(arg: Argument, shaft: Any, other: Any, pin: Any) -> Any:
    """Direction (3,) of k's pin in a universal joint: that given, or a normal to both shafts."""
    if pin is None:
        normal = np.cross(shaft, other)
        if np.linalg.norm(normal) < 1e-9:
            normal = np.cross(shaft, np.eye(3)[int(np.argmin(np.abs(shaft)))])
        return reading.unit(normal)
    found = reading.unit(pin)
    if abs(found @ shaft) > 1e-9:
        arg.wrong(f"{np.asarray(pin).tolist()} is not normal to axis = {shaft.tolist()}",
                  "give a direction normal to axis, the shaft of k")
        return pins(arg, shaft, other, None)
    if np.linalg.norm(np.cross(found, other)) < 1e-9:
        arg.wrong(f"{np.asarray(pin).tolist()} is along axis_l, the shaft of l", "give a direction at an angle to it")
        return pins(arg, shaft, other, None)
    return found
