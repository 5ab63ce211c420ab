"""Joints: a law states the coordinates of a joint and its motion, or rows that vanish, or both. Couplings between coordinates.

The *motion* takes the axes of k to those of l by the joint's coordinates (`symbolic/motion.py`). From it follow the recursive
joint, the start, and the rows of the joint with its coordinates as unknowns: the pose of l is that of the motion. *Rows*
(`constraints`) state the same joint by fewer equations without coordinates: the kinematic model. `coordinate` then reads the
coordinates from the frames, and `ties` are rows that vanish where a coordinate has a value: they prescribe it, or tie it to the
bodies as an unknown.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from functools import partial
from types import MappingProxyType
from typing import Any, ClassVar

import symengine as se

from mbdae.errors import LawError
from mbdae.symbolic.frames import Frame, angle
from mbdae.symbolic.law import TwoBodyLaw
from mbdae.symbolic.motion import Motion, across, free_axes, symbolic_motion
from mbdae.symbolic.part import Parameter, checked_value
from mbdae.symbolic.variation import let, rate
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.values import flag, shown, word

Reference = tuple[str, str]  #: name of a joint, name of one of its coordinates
OPTIONS = ("kept", "friction", "rubs")  #: options that every joint has, see `Joint`
UNITS = ("rad", "m", "rotation")  #: units of coordinates; a rotation is a quaternion, its rates an angular velocity
SENSORS = ("force", "torque", "power", "rate", "reaction_is_unique", "contacts")  #: further sensors of joints
#: N; the normal force of a joint with the reaction F is sqrt(F.F + SLIGHT^2), which has a derivative where F is 0
SLIGHT = 1e-9


class Joint(TwoBodyLaw):
    """A law between two bodies stated by `coordinates` and `motion`, by `constraints`, or by both.

    Every joint has the parameters `drive` (with several coordinates `drive_<name>`), the prescribed value of a coordinate, and
    `friction_radius`, and the options kept (its coordinates are unknowns of their own), friction (a friction law) and rubs (the
    name of the coordinate against which it acts, by default the first)."""

    #: coordinates of the motion that the joint leaves free, with their units; all are 0 as drawn
    coordinates: ClassVar[Mapping[str, Parameter]] = MappingProxyType({})
    loose: ClassVar[type[Joint] | None] = None  #: class that replaces this one where pin and race have clearance
    optional: ClassVar[tuple[str, ...]] = ()  #: parameters that a statement may leave out
    kept: Any  #: None or False: the coordinates of the joint are not unknowns of its law
    _derived: ClassVar[frozenset[str]] = frozenset()  #: parameters made from the coordinates: drives, friction radius

    def __init_subclass__(cls, **kwargs: Any) -> None:
        if isinstance(cls.params, Mapping) and isinstance(cls.coordinates, Mapping):
            stated = {name: entry for name, entry in cls.params.items() if name not in cls._derived}
            drives = {cls.drive_name(c): Parameter(entry.unit, f"prescribed {c}") for c, entry in cls.scalars().items()}
            radius = {"friction_radius": Parameter("m", "radius at which friction acts: lever of its force")} if drives else {}
            cls.params = {**drives, **stated, **radius}
            cls._derived = frozenset({*drives, *radius} - stated.keys())
        if isinstance(cls.options, tuple | list):
            cls.options = (*(o for o in cls.options if o not in OPTIONS), *OPTIONS)
        super().__init_subclass__(**kwargs)
        for name, entry in cls.coordinates.items():
            if name in SENSORS or name.endswith("_rate"):
                raise LawError(f"{cls.__name__}: the coordinate '{name}' has the name of another sensor of joints, or ends in "
                               f"'_rate' as their rates do; choose another name")
            if entry.unit not in UNITS:
                raise LawError(f"{cls.__name__}: the coordinate '{name}' has the unit '{entry.unit}'; give 'rad', 'm' or "
                               f"'rotation'")
        if hasattr(cls, "coordinate_unit"):
            raise LawError(f"{cls.__name__}: say coordinates = mb.params(angle=('rad', ...)) or (displacement=('m', ...)) in "
                           f"place of coordinate_unit")

    def compose(self) -> None:
        for option in OPTIONS:
            vars(self).setdefault(option, None)
        self.kept = (self.kept is not None and self._checked("kept", flag, "give True or False")) or self.must_keep()
        if self.rubs is not None:
            self._checked("rubs", partial(word, words=self.scalars()), "give the name of a coordinate")
        if self.friction is not None and not callable(getattr(self.friction, "coefficient", None)):
            raise LawError(f"{type(self).__name__} {shown(self.name)}: friction = {shown(self.friction)} is no friction law; "
                           f"give one such as mb.Coulomb(mu, v_c)")
        super().compose()

    def _checked(self, option: str, read: Callable[[Any], Any], remedy: str) -> Any:
        return checked_value(f"{type(self).__name__} {shown(self.name)}", option, getattr(self, option), read, remedy)

    # -- what a joint states

    def motion(self, from_k: Motion) -> Motion:
        """The chain of elementary motions by the joint's coordinates that takes the axes of k to those of l; `from_k`: its
        start."""
        return from_k

    def constraints(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        """Expressions of the frames, without the joint's coordinates, that vanish; by name of the row."""
        if type(self).velocity_constraints is not Joint.velocity_constraints:
            return {}
        if self.states_motion():
            raise LawError(f"joint law {type(self).__name__} states a motion without coordinates: where l moves with k use "
                           f"mb.Weld, else declare coordinates = mb.params(name=('rad', 'meaning')) and move by self.name")
        raise LawError(f"joint law {type(self).__name__} states none of `motion(self, from_k)`, `constraints(self, k, l)`, "
                       f"`velocity_constraints(self, k, l)`: state one of these methods")

    def coordinate(self, *frames: Any, **_: Any) -> Any:
        """{coordinate: expression of the frames}, or the expression alone where there is one coordinate; None: the coordinates
        cannot be computed from the frames."""
        return None

    def ties(self, *frames: Any, **_: Any) -> dict[str, Any]:
        """{coordinate: row that vanishes where the frames have the coordinate's value `self.<name>`, and grows with that value}.
        A row that vanishes half a turn off too is given as a pair (row, expression that is positive at the right value)."""
        return {}

    def branches(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        """Expressions that must be positive, where the rows alone admit a second solution (a joint half a turn off)."""
        return {}

    def pressing(self, k: Frame, l: Frame, force: Vec) -> Vec:
        """The part of the joint's reaction force on l (N) that presses the surfaces together, normal to axis and slides."""
        return across(force, free_axes(self, k, l, self.rubbed) if self.states_motion() else [k.z])

    def normal_force(self, k: Frame, l: Frame, force: Vec, coefficient: Expr) -> Expr:
        """The normal force at the rubbing surfaces (N, not negative) for the joint's reaction force on l (N): by default the
        magnitude of its pressing part. coefficient: signed, for joints in which friction contributes to the reaction, such as
        screws."""
        pressing = self.pressing(k, l, force)
        if all(c == 0 for c in pressing):
            raise LawError(f"friction on '{self.rubbed}' of a {type(self).__name__}: no part of the joint's force presses the "
                           f"rubbing surfaces together; give normal_force=... (N), or state normal_force(self, k, l, force, "
                           f"coefficient) in its class")
        return let(se.sqrt(let(pressing @ pressing) + SLIGHT**2))

    def remarks(self) -> list[str]:
        """Remarks of `check()` on the parameter values of this joint, one sentence each."""
        return []

    def resistance(self, *frames: Any, **_: Any) -> tuple[Vec, Vec] | None:
        """Force (N) on l at l.r and torque (N m) on l that the joint's reactions cause, inertial frame; it counts as dissipated.

        reactions: the force of every row (N or N m) by its name, 0 where the row vanishes. None: there is none."""
        return None

    def relative_angle(self, k: Frame, l: Frame) -> Expr:
        """Rotation of l relative to k about the joint axis (see `symbolic.frames.angle`)."""
        return angle(k, l)


    @classmethod
    def drive_name(cls, coordinate: str) -> str:
        """Name of the parameter, and of the row, that prescribes a coordinate."""
        return "drive" if len(cls.coordinates) == 1 else f"drive_{coordinate}"

    @classmethod
    def scalars(cls) -> dict[str, Parameter]:
        """The coordinates that are angles and displacements, not rotations."""
        return {name: entry for name, entry in cls.coordinates.items() if getattr(entry, "unit", "") != "rotation"}

    @classmethod
    def freedoms(cls) -> int:
        """Number of freedoms of its motion."""
        return sum(3 if entry.unit == "rotation" else 1 for entry in cls.coordinates.values())

    @classmethod
    def drives(cls) -> dict[str, str]:
        """{name of the row that prescribes a coordinate: the coordinate}."""
        return {cls.drive_name(c): c for c in cls.scalars()}

    @classmethod
    def derived(cls) -> frozenset[str]:
        """Parameters and options that a joint has without declaring them. Calls such as `s.revolute` give them under other
        names."""
        return cls._derived | set(OPTIONS)

    @classmethod
    def states_motion(cls) -> bool:
        """Whether the class defines `motion`."""
        return cls.motion is not Joint.motion

    @classmethod
    def states_rows(cls) -> bool:
        """Whether the class defines `constraints`."""
        return cls.constraints is not Joint.constraints

    @classmethod
    def must_keep(cls) -> bool:
        """Whether its coordinates are unknowns in every model, because the class states no rows without them."""
        without = cls.states_rows() and (cls.states_motion() or cls.coordinate is not Joint.coordinate)
        return bool(cls.coordinates) and not without

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return tuple(self.coordinates) if self.kept else ()

    @property
    def prescribed(self) -> dict[str, str]:
        """{prescribed coordinate: name of the parameter that prescribes it}."""
        return {c: name for name, c in self.drives().items() if getattr(self, name) is not None}

    def rows(self, *frames: Frame) -> dict[str, Expr]:
        if not self.kept:
            rows, ties = dict(self.constraints(*frames)), self._ties(*frames) if self.prescribed else {}
            for c, name in self.prescribed.items():
                if c not in ties:
                    raise LawError(f"{type(self).__name__} states no row (`ties`) by which its {c} could be prescribed without "
                                   f"being an unknown; use model=mb.Classical(), which makes it one")
                rows[name] = ties[c][0]
            return rows
        rows = self._rows_with_coordinates(*frames)
        return rows | {name: getattr(self, name) - getattr(self, c) for c, name in self.prescribed.items() if name not in rows}

    def _rows_with_coordinates(self, *frames: Frame) -> dict[str, Expr]:
        ties = self._complete_ties(*frames)
        if ties:
            return dict(self.constraints(*frames)) | {c: row for c, (row, _) in ties.items()}
        if not self.states_motion():
            self._refuse_untied()
            return dict(self.constraints(*frames))
        k, l = frames[:2]
        moved, axes = self._pose(k)
        d = l.r - k.r - moved
        return {"x": d[0], "y": d[1], "z": d[2], "tilt_y": axes[2] @ l.x, "tilt_x": axes[2] @ l.y, "twist": axes[0] @ l.y}

    def _refuse_untied(self) -> None:
        """Raise LawError where coordinates would be unknowns that no row contains."""
        if self.coordinates and type(self).coordinate is not Joint.coordinate:
            raise LawError(f"{type(self).__name__} states neither its motion nor rows that tie {', '.join(self.coordinates)} to "
                           f"the bodies (`ties`), one of which this joint model needs: use mb.Kinematic()")

    def positives(self, *frames: Frame) -> dict[str, Expr]:
        stated = dict(self.branches(*frames)) if self.states_rows() else {}
        ties = self._complete_ties(*frames) if self.kept else self._ties(*frames) if self.prescribed else {}
        if self.kept and not ties and self.states_motion():
            l, axes = frames[1], self._pose(frames[0])[1]
            return {"z axes in the same sense": axes[2] @ l.z, "x axes in the same sense": axes[0] @ l.x}
        held = {c: positive for c, (_, positive) in ties.items() if positive is not None and (self.kept or c in self.prescribed)}
        return stated | {f"{c}, not half a turn off": positive for c, positive in held.items()}

    def _pose(self, k: Frame) -> Any:
        return self.motion(Motion()).pose((k.x, k.y, k.z))

    def _complete_ties(self, *frames: Frame) -> dict[str, tuple[Expr, Expr | None]]:
        """Ties of all coordinates by name; empty where a coordinate has no tie."""
        complete = self.states_rows() and not self.must_keep() and self.scalars().keys() == self.coordinates.keys()
        ties = self._ties(*frames) if complete else {}
        return ties if ties.keys() == self.coordinates.keys() else {}

    def _ties(self, *frames: Frame) -> dict[str, tuple[Expr, Expr | None]]:
        """{coordinate: (row, expression to be positive or None)} of the ties. Where coordinates are no unknowns, the rows contain
        their prescribed values."""
        law = self
        if not self.kept:
            law = copy(self)
            values = {c: getattr(self, name) for name, c in self.drives().items()}
            vars(law).update({c: se.Symbol(f"free_{c}") if value is None else value for c, value in values.items()})
        return {c: tie if isinstance(tie, tuple) else (tie, None) for c, tie in law.ties(*frames).items()}

    def read(self, *frames: Frame) -> dict[str, Expr]:
        if self.kept:
            return {c: getattr(self, c) for c in self.scalars()}
        found = self.coordinate(*frames)
        if found is None or isinstance(found, Mapping):
            return dict(found or {})
        return dict.fromkeys(self.scalars(), found)

    @property
    def welds(self) -> bool:
        """Whether the joint leaves no relative motion; bodies that it joins at a node of a beam may then share the node's
        unknowns."""
        motion = None if self.coordinates else symbolic_motion(self)
        return motion is not None and not motion.steps

    @property
    def holds_point(self) -> bool:
        """Whether the point of l stays at that of k, which leaves a mass point l no motion."""
        motion = symbolic_motion(self)
        return motion is not None and not motion.slides

    # -- friction by the joint's own reaction

    @property
    def rubbed(self) -> str:
        """Name of the coordinate against which its friction acts."""
        return self.rubs or next(iter(self.scalars()))

    def lever(self) -> Expr:
        """Length by which the rate of the rubbed coordinate becomes a sliding velocity: a radius, 1 for a displacement."""
        return self.friction_radius if self.coordinates[self.rubbed].unit == "rad" else se.Integer(1)

    def sliding(self, *frames: Frame) -> Expr:
        """Velocity of l relative to k at the rubbing surfaces, m/s."""
        return let(self.lever() * rate(self.read(*frames)[self.rubbed]))

    def rubbing(self, force: Vec, *frames: Frame) -> tuple[Expr, Expr] | None:
        """The coordinate against which friction acts, as an expression, and the friction on it (N or N m), for a reaction force
        on l (N); None without friction."""
        if self.friction is None:
            return None
        k, *others = frames
        if not (k.kind.oriented and (all(f.kind.oriented for f in others) or self.coordinates[self.rubbed].unit == "m")):
            raise LawError(f"friction in a {type(self).__name__} needs axes on its bodies, and a point mass has none: use "
                           f"s.rigid_body for it")
        coefficient = let(self.friction.coefficient(self.sliding(*frames)))
        normal = self.normal_force(frames[0], frames[1], force, coefficient)
        return self.read(*frames)[self.rubbed], let(-coefficient * normal) * self.lever()

    def rates(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {} if self.friction is None else dict(self.friction.rate(self.sliding(*frames)))

    def initial(self, *frames: Any, **_: Any) -> dict[str, Expr]:
        return {} if self.friction is None else dict(self.friction.initial(self.sliding(*frames)))


class Coupling(TwoBodyLaw):
    """A law on coordinates of joints stated by `constraints`: expressions of the coordinates (`self.<name>`) that vanish.

    The forces of its rows act on both bodies of every joint, by virtual work. of: for every coordinate of the law the joint and
    the coordinate there, "joint.coordinate"; a coordinate is 0 as drawn, whole turns of angles count."""

    frames: ClassVar[tuple[str, ...]] = ()
    coordinates: ClassVar[Mapping[str, Parameter]] = MappingProxyType({})  #: of joints, with their unit (rad, m or either)

    def __init__(self, name: str, of: Mapping[str, Any], **values: Any) -> None:
        super().__init__(name, None, None, **values)
        kind = f"{type(self).__name__} {shown(name)}"
        if not self.own_coordinates:
            raise LawError(f"{kind} couples no coordinates; declare them: coordinates = mb.params(angle=('rad', 'of a wheel'))")
        names = ", ".join(self.own_coordinates)
        example = f"as in of={{'{self.own_coordinates[0]}': 'A.angle', ...}}"
        if not isinstance(of, Mapping):
            raise LawError(f"{kind}: of = {shown(of)} is no dict: say which joint's coordinate each of {names} is, {example}")
        self.of = dict(of)
        if set(self.of) != set(self.own_coordinates):
            raise LawError(f"{kind}: of = {shown(of)} must have the keys {names} and no others: say which joint's coordinate "
                           f"each is, {example}")

    def constraints(self) -> dict[str, Expr]:
        """Expressions of the coordinates that vanish, by name of the row."""
        if type(self).velocity_constraints is not Coupling.velocity_constraints:
            return {}
        raise LawError(f"coupling {type(self).__name__} does not state `constraints(self)`: return its rows, "
                       f"{{'name': expression that vanishes}}")

    def rows(self) -> dict[str, Expr]:  # type: ignore[override]
        return self.constraints()

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return tuple(self.coordinates)

    def coordinates_in(self, item: str) -> list[Reference]:
        return [self.of[name] for name in self.own_coordinates]
