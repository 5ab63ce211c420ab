"""The data of a scene, on which all statements work: its items by name, the statements made, the mistakes found."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbdae.errors import NamesAttributes, SceneError, meant
from mbdae.scene import reading
from mbdae.scene.components import Beam, BeamLoad, Body, Connection, Controller, Signal
from mbdae.scene.reading import Argument, Reader
from mbdae.scene.record import Own, Statement
from mbdae.scene.sensed import keep_read_coordinates, keep_wanted, read_by
from mbdae.values import fixed, shown

READ: dict[str, Reader] = {"name": reading.name, "space": reading.one_of("auto", "planar", "spatial"),
        "gravity": lambda arg, value: fixed(reading.vector("m/s^2")(arg, value))}  # fmt: skip

KEPT = {"recording", "_known", "_sent"}  #: attributes by which a scene keeps what it found


class SceneItems(NamesAttributes):
    """The items of a scene by name (bodies, joints, forces, loads, signals, controllers), the statements made, the mistakes
    found."""

    def __init__(self, name: str = "scene", gravity: Any = (0.0, 0.0, 0.0), space: str = "auto") -> None:
        """`gravity` (3,) in m/s^2; `space` "auto" (planar where that can be proved), "planar" or "spatial"."""
        self.problems: list[str] = []
        self.name, self.space, self.gravity = name, space, gravity  # read by __setattr__
        self.statements: list[Statement] = []  #: the statements made on the scene, in order, as plain data (see `record.py`)
        self.own: Own = {}  #: classes and functions by the names they have in `statements`
        self.recording = True
        eye, zero = np.eye(3), np.zeros(3)
        self.ground = Body("ground", math.inf, None, zero, eye, zero, zero, is_ground=True, scene=self)
        self.bodies: list[Body] = []
        self.connections: list[Connection] = []
        self.line_loads: list[BeamLoad] = []
        self.signals: list[Signal] = []  #: states, named expressions, outputs of controllers
        self.controllers: list[Controller] = []
        self._known: dict[str, Any] = {"ground": self.ground}  #: items by name, as far as `_by_name` has read the lists
        self._read = [0] * 5  #: how many entries of each list `_by_name` has read
        self._wanted: dict[str, set[str]] = {}  #: joint's name -> its quantities that sensors read, see `keep_read_coordinates`
        self.attachments: dict[Beam, tuple[float, ...]] = {}  #: places on beams where something is attached, see `nearest_place`

    def __setattr__(self, name: str, value: Any) -> None:
        """Read what may be set after the scene was made too; AttributeError for everything else, which would have no effect."""
        own, read = vars(self), READ.get(name)
        made, known = "attachments" in own, len(own.get("problems", ()))
        if read is not None:
            head = f"scene '{own['name']}'" if "name" in own else "scene"
            value = read(Argument(self, head, name), value)
            if made and len(self.problems) > known:
                raise SceneError([self.problems.pop()])
        elif made and self.recording and name not in KEPT and (name in own or type(self).__module__.startswith("mbdae.")):
            raise AttributeError(f"scene '{self.name}': {meant(name, READ)}{name} = {shown(value)} would have no effect: of a "
                                 f"scene only {', '.join(READ)} are set, all else is stated (s.link, ...)")  # fmt: skip
        super().__setattr__(name, value)

    @property
    def _items(self) -> list[Any]:
        return [*self.bodies, *self.connections, *self.line_loads, *self.signals, *self.controllers]

    @property
    def joints(self) -> list[Connection]:
        """The joints, in the order of their statement."""
        return [c for c in self.connections if c.is_joint]

    @property
    def _by_name(self) -> dict[str, Any]:
        """Items by name; of equal names the one stated first."""
        lists: tuple[list[Any], ...] = self.bodies, self.connections, self.line_loads, self.signals, self.controllers
        for n, items in enumerate(lists):
            for item in items[self._read[n] :]:
                self._known.setdefault(item.name, item)
            self._read[n] = len(items)
        return self._known

    def __getitem__(self, name: str) -> Any:
        found = self._by_name.get(name)
        if found is not None:
            return found
        raise SceneError([f"there is no item '{name}' in scene '{self.name}'; it has {self._names()}"])

    def _names(self) -> str:
        names = [item.name for item in self._items]
        return ", ".join(repr(n) for n in names[:12]) + (", ..." if len(names) > 12 else "") or "none"

    def _keep_read_coordinates(self, item: Any) -> None:
        """Make unknowns of the coordinates that a new item reads, and of its own that others read."""
        keep_read_coordinates(self, read_by(item))
        keep_wanted(self, item)

    def _claim(self, name: str) -> None:
        """Report a name that another item has already."""
        if name != reading.NAMELESS and name in self._by_name:
            self.problems.append(f"two items have the name '{name}'; give each its own")

    def _add_body(self, body: Body) -> Body:
        body.scene = self
        self._claim(body.name)
        self.bodies.append(body)
        return body
