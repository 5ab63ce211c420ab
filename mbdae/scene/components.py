"""What a scene consists of: plain data."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import InitVar, dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mbdae.errors import NamesArguments, OptionError
from mbdae.inputs.sensed import paths
from mbdae.scene.shapes import Shape
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import TwoBodyLaw
from mbdae.values import Array, AsStated, BadValueError, array, as_floats, fixed, number, shown

if TYPE_CHECKING:
    from mbdae.laws.beam import LineLoad
    from mbdae.laws.contact import Normal
    from mbdae.laws.friction import Friction

FINE = 2048  #: number of chords by which the length along a curve is measured to find a place at a share of it
MOVING = ("position", "rotation", "velocity", "angular_velocity")  #: quantities of a run that are no attributes of a body


@dataclass(frozen=True, eq=False)
class Drawn:
    """Where a body is drawn, and how it starts: position (3,) of the centre of mass, m; rotation (3, 3), body to inertial;
    velocity (3,) of the centre of mass, m/s; angular_velocity (3,), rad/s, inertial frame."""

    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array


@dataclass(eq=False, repr=False)
class Body(AsStated, NamesArguments):
    """A body as drawn. `inertia` (3, 3) about the centre of mass in body axes, None for a point mass or the ground; `drawn`: see
    `Drawn`. The motion in a run is no attribute of it: a load would silently use the value as drawn."""

    name: str
    mass: float
    inertia: Array | None
    position: InitVar[Array]
    rotation: InitVar[Array]
    velocity: InitVar[Array]
    angular_velocity: InitVar[Array]
    given_velocity: bool = False  #: whether a velocity or angular velocity other than 0 is stated
    outline: Array = field(default_factory=lambda: np.zeros((0, 3)))  #: points of the body's line as drawn, m, inertial axes
    is_point: bool = False
    is_ground: bool = False
    principal_plane: bool = False  #: whether the inertia is given as one number, about z
    scene: Any = field(default=None, repr=False)  #: the scene in which the body is stated
    shapes: tuple[Shape, ...] | None = None  #: shapes to draw; None: not stated, drawn from mass and attachments
    color: str | None = None  #: "#rrggbb", None: chosen by the drawing
    gravity: Array | None = None  #: (3,) its own gravity, m/s^2; None: that of the scene
    drawn: Drawn = field(init=False)

    def __post_init__(self, position: Array, rotation: Array, velocity: Array, angular_velocity: Array) -> None:
        self.inertia, self.outline, self.gravity = map(fixed, (self.inertia, self.outline, self.gravity))
        self.drawn = Drawn(*map(fixed, (position, rotation, velocity, angular_velocity)))

    def _settled(self) -> bool:
        return "drawn" in vars(self) and self.scene is not None and bool(self.scene.recording)

    if not TYPE_CHECKING:  # a type checker would take every attribute to exist

        def __getattr__(self, name: str) -> Any:
            if name not in MOVING:
                return super().__getattr__(name)
            path = f"{self.name}.{name}[{'0, 0' if name == 'rotation' else 0}]"
            raise AttributeError(f"'{self.name}' has no {name} before it moves: as drawn it is .drawn.{name}, in a load "
                                 f"s.sensor('{path}'), in a result r['{self.name}'].{name}")

    @property
    def owner(self) -> Body:
        """The body that the user stated: this one, or the beam of which this is a node."""
        return self

    @property
    def heading(self) -> float:
        """Angle of the body's x axis in the plane as drawn, rad."""
        return math.atan2(self.drawn.rotation[1, 0], self.drawn.rotation[0, 0])

    def at(self, point: Any) -> Place:
        """A place fixed to the body: a point as drawn (inertial, m), or 0..1 along a link; OptionError for anything else."""
        try:
            given = array(point)
            if given.ndim == 0:
                return Place(self, self._along(number(float(given), least=0, most=1)))
            if given.shape not in ((2,), (3,)):
                raise BadValueError(f"{shown(point)} has shape {given.shape}, needs (2,) or (3,)")
        except BadValueError as value_and_reason:
            raise OptionError(f"'{self.name}'.at: point = {value_and_reason}; give a number from 0 to 1 along a link or beam, or "
                              f"a point of 2 or 3 coordinates, m") from None
        return Place(self, np.append(given, np.zeros(3 - len(given))))

    def _along(self, s: float) -> Array:
        points = self.outline
        if len(points) < 2:
            raise OptionError(f"'{self.name}'.at: point = {s:g}: a number is a place along a link or beam, and '{self.name}' is "
                              f"neither; give a point of 2 or 3 coordinates, m")
        lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
        return np.array([np.interp(s * lengths[-1], lengths, points[:, i]) for i in range(3)])


@dataclass(eq=False, repr=False)
class Beam(Body):
    """A flexible beam along its outline, or along `curve` (position by a parameter from 0 to 1)."""

    section: Any = None
    elements: Any = 1
    order: int = 2
    curve: Callable[[float], Any] | None = None
    axis2: Any = None

    def _along(self, s: float) -> Array:
        if self.curve is None or not 0 < s < 1:
            return super()._along(s)
        parameters = np.linspace(0, 1, FINE + 1)
        points = np.array([self.curve(x) for x in parameters], dtype=float)
        lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
        found = np.asarray(self.curve(float(np.interp(s * lengths[-1], lengths, parameters))), dtype=float)
        return np.pad(found, (0, 3 - len(found)))

    def load(self, per_length: Any, frame: str = "inertial", name: str | None = None) -> Any:
        """A force per reference length on the axis, N/m, three numbers or expressions of mb.t: dead (in the inertial
        frame), or following the section (frame="section": its axes 1, 2, 3)."""
        return self.scene.line_load(f"load on {self.name}" if name is None else name, self, per_length, frame)


@dataclass(eq=False, repr=False)
class Station(Body):
    """A node of a beam, as a body without mass to which joints and forces attach."""

    beam: Body | None = None
    turned: float = 0.0  #: angle of the node's x axis in the plane as drawn, continuous along the beam, rad
    quaternion: Array = field(default_factory=lambda: np.eye(4)[0])  #: of its axes as drawn; sign continuous along the beam

    @property
    def owner(self) -> Body:
        assert self.beam is not None
        return self.beam

    @property
    def heading(self) -> float:
        return self.turned


@dataclass(frozen=True, eq=False)
class BeamLoad:
    """A load distributed along a beam; its components by name, numbers or expressions of time."""

    name: str
    beam: Beam
    law: LineLoad


@dataclass(frozen=True, eq=False)
class Place:
    """A point fixed to a body, by its position as drawn."""

    body: Body
    point: Array


@dataclass(frozen=True, eq=False)
class Signal:
    """What loads may depend on besides motion and time: a "state" with its law, a named expression ("signal") with its value, an
    "output" of a controller with the law that holds it."""

    name: str
    kind: str
    law: TwoBodyLaw | None = None
    value: Any = None

    def reads(self) -> list[str]:
        """Paths of the sensors on which it depends."""
        return paths(getattr(self.law, "rate", None) if self.law is not None else self.value)


@dataclass(frozen=True, eq=False)
class AsGiven:
    """An object of the user's own that a scene keeps as it is: the function of a controller, or what it remembers."""

    value: Any


@dataclass(frozen=True, eq=False)
class Controller:
    """A function that is called every `every` s: paths of the sensors it reads, names of the outputs it sets, its memory at the
    start, None: it has no memory; derivative: function of the same arguments, (outputs, values), None: not known."""

    name: str
    function: Callable[..., Any]
    memory: AsGiven | None
    every: float
    reads: tuple[str, ...]
    sets: tuple[str, ...]
    derivative: Callable[..., Any] | None = None


@dataclass(frozen=True)
class JointModel:
    """How a joint is modelled. ideal: whether as the ideal joint, so that models differ by method alone."""
    ideal: ClassVar[bool] = True


@dataclass(frozen=True)
class Constrained(JointModel):
    """Joint models with constraint rows c.

    scaling > 0, penalty >= 0: of the potential V = scaling lambda.c + penalty c.c over the rows of a revolute joint (penalty
    in N m, rows in m count as rad); validation/paper names the source.
    """

    scaling: float = 1.0
    penalty: float = 0.0

    def __post_init__(self) -> None:
        as_floats(self, "scaling", "penalty")


@dataclass(frozen=True)
class Kinematic(Constrained):
    """Constraints between the absolute coordinates of bodies, and a further one where a coordinate is prescribed. A joint whose
    law states no such constraints keeps its coordinates as unknowns, as with `Classical`."""


@dataclass(frozen=True)
class Classical(Constrained):
    """Every coordinate (angle, displacement) is an unknown of its own, tied to the bodies by a row; a further one where it is
    prescribed."""


@dataclass(frozen=True)
class Recursive(JointModel):
    """The coordinates (angle, displacement) are the unknowns and the body they carry has none: no constraint, no multiplier. A
    scene whose joints are all recursive is an ordinary differential equation."""


@dataclass(frozen=True)
class Clearance(JointModel):
    """A pin (radius `inner`, m, on body l) with play in a race (radius `outer`, m, on body k): contact instead of constraints.
    In space the pin stays in the middle along the axis and parallel to it (three rows); in the plane nothing is
    constrained. normal: mb.Hertz(...) or a normal law of one's own; friction: mb.Coulomb(...), mb.LuGre(...), one's own, or
    None. length: of a bearing, m: the pin touches at both its ends, each with the normal law given, and may tilt in it.
    Equal radii are allowed: the gap is then 0 in every direction."""

    ideal: ClassVar[bool] = False
    outer: float
    inner: float
    normal: Normal
    friction: Friction | None = None
    length: float | None = None

    def __post_init__(self) -> None:
        as_floats(self, "outer", "inner", "length")


@dataclass(frozen=True)
class Stop:
    """An elastic stop at the limits of a joint's coordinate: force stiffness p + damping dp/dt where that pushes back, else 0; p:
    excess over the limit, rad or m. stiffness: N m/rad or N/m; damping: N m s/rad or N s/m."""
    stiffness: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        as_floats(self, "stiffness", "damping")


@dataclass(eq=False, repr=False)
class Connection(AsStated):
    """A joint or force element: its laws, and the start values the user stated."""

    name: str
    kind: str
    k: Any
    l: Any
    laws: list[TwoBodyLaw]
    is_joint: bool = False
    hold: dict[str, float] = field(default_factory=dict)  #: start values by coordinate
    hold_rate: dict[str, float] = field(default_factory=dict)
    prescribed: dict[str, Any] = field(default_factory=dict)  #: expressions of time by coordinate
    model: JointModel | None = None
    left_open: bool = False  #: True only where the user named no joint model
    as_kinematic: list[TwoBodyLaw] = field(default_factory=list)  #: laws of the ideal kinematic joint in place of another model
    rotor: dict[str, float] = field(default_factory=dict)  #: inertia of a coordinate's own, by coordinate
    others: dict[str, Any] = field(default_factory=dict)  #: bodies of further frames than k and l, by frame
    shapes: tuple[Shape, ...] = ()  #: of a contact, the shapes of k and of l; empty for all others
    places: dict[str, Array] = field(default_factory=dict)  #: side "k" or "l" -> the point of that body the user named, as drawn

    def _settled(self) -> bool:
        return "places" in vars(self) and bool(getattr(getattr(self.k, "scene", None), "recording", False))

    @property
    def recursive(self) -> bool:
        """Whether the joint's coordinate is to be the only unknown of the body it carries."""
        return isinstance(self.model, Recursive)

    @property
    def rigid(self) -> bool:
        """Whether one rigid body cannot move relative to the other: a weld, or a point mass held where it is."""
        law, points = self.laws[0], self.k.is_point + self.l.is_point
        if len(self.laws) > 1 or isinstance(self.k, Beam) or isinstance(self.l, Beam) or not isinstance(law, Joint):
            return False
        return (points < 2 and law.welds) or (points == 1 and not self.prescribed and not self.rubs and law.holds_point)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the joint's coordinates; none of a force."""
        law = self.laws[0]
        return tuple(law.coordinates) if isinstance(law, Joint) else ()

    @property
    def scalars(self) -> tuple[str, ...]:
        """Names of the coordinates that are angles and displacements, not rotations."""
        return tuple(c for c in self.coordinates if self.unit(c) != "rotation")

    @property
    def kept(self) -> bool:
        """Whether the coordinates are unknowns of their own."""
        return bool(self.laws[0].own_coordinates) and self.is_joint

    def unit(self, coordinate: str) -> str:
        """Unit of a coordinate: "rad", "m", or "rotation" for a free rotation."""
        return str(self.laws[0].coordinates[coordinate].unit)

    @property
    def has_models(self) -> bool:
        """Whether it has coordinates, which joint models treat differently."""
        return bool(self.coordinates)

    @property
    def loose(self) -> bool:
        """Whether pin and race have play."""
        return isinstance(self.model, Clearance)

    @property
    def rubs(self) -> bool:
        """Whether friction in the joint follows from its own reaction."""
        return isinstance(self.laws[0], Joint) and self.laws[0].friction is not None

    @property
    def joint(self) -> TwoBodyLaw:
        """The law with the constraints of the joint, or the first law of a force element."""
        return self.laws[0]
