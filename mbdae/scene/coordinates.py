"""Limits of a joint's coordinates with their stops, read from what users give.

Options of a joint that belong to its coordinates: one value where it has one coordinate, else values by coordinate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mbdae.laws.on_coordinates import JointDamper, JointFriction, JointLoad, JointSpring, JointStop
from mbdae.scene import reading
from mbdae.scene.components import Clearance, JointModel, Recursive, Stop
from mbdae.scene.models import friction_law
from mbdae.scene.reading import FEEDS, Argument, Reader, quantity
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import TwoBodyLaw
from mbdae.values import BadValueError, entries, number, shown

GIVE_A_STOP = "give stop=mb.Stop(stiffness, damping)"
Limits = tuple[float | None, float | None]  #: lowest and highest value, None where there is none


def limits(unit: str) -> Reader:
    """Reader of a pair (lowest, highest); None or an infinite number: no limit on that side. Returns None for a wrong value."""
    give_a_pair = f"give a pair (lowest, highest), {unit}; None for a side without limit"

    def read(arg: Argument, value: Any) -> Limits | None:
        try:
            found = entries(value)
            if found.shape != (2,):
                raise BadValueError(f"{shown(value)} is no pair of limits")
            low, high = _one(found[0], -math.inf), _one(found[1], math.inf)
        except BadValueError as reason:
            names_value = str(reason).startswith(shown(value))
            arg.wrong(reason if names_value else f"{shown(value)} has a wrong entry, {reason}", give_a_pair)
            return None
        if low is None and high is None:
            arg.wrong(shown(value), "it limits nothing; give a number, or omit limits and stop")
            return None
        if low is not None and high is not None and low >= high:
            arg.wrong(f"{shown(value)}: the lower limit is not below the upper one", give_a_pair)
            return None
        return low, high

    return read


def _one(value: Any, without: float) -> float | None:
    """A limit as a number; None for no limit, which the user states by None or by the infinite number `without`."""
    if value is None:
        return None
    try:
        if value == without:
            return None
    except Exception:  # a comparison of the user's own may raise anything; `number` says what is wrong with the value
        pass
    return number(value)


def stop(stiffness: str, damping: str) -> Reader:
    """Reader of an mb.Stop with numbers in these units; returns None for a wrong value."""

    def read(arg: Argument, value: Any) -> Stop | None:
        if not isinstance(value, Stop):
            arg.wrong(f"{shown(value)} is no stop", GIVE_A_STOP)
            return None
        before = len(arg.scene.problems)
        quantity(stiffness, "positive")(arg.part(f"{arg.option}.stiffness"), value.stiffness)
        quantity(damping, "not negative", FEEDS)(arg.part(f"{arg.option}.damping"), value.damping)
        return value if len(arg.scene.problems) == before else None

    return read


def for_each_limit(law: type[Joint], given: Any, limited: Any) -> Any:
    """One stop given once becomes that of every coordinate with limits, by coordinate; anything else is returned unchanged."""
    if isinstance(given, Mapping) or given is None or not isinstance(limited, Mapping):
        return given
    return {c: given for c, value in limited.items() if c in law.coordinates and value is not None} or given


def pairs_of(found: Mapping[str, Mapping[str, Any]], law: type[Joint]) -> dict[str, tuple[Limits, Stop]]:
    """Limits and stop by coordinate, where both can be used."""
    both = ((c, found.get("limits", {}).get(c), found.get("stop", {}).get(c)) for c in law.coordinates)
    return {c: (pair, stop) for c, pair, stop in both if pair is not None and stop is not None}


def mistakes(found: Mapping[str, Mapping[str, Any]], law: type[Joint], words: Mapping[str, str],
             model: JointModel | None) -> list[str]:
    """Mistakes in the combination of limits, stops and joint model, one sentence each; single values are checked by `limits` and
    `stop`. found: values by option and coordinate; words: name of an option in the statement, where it differs."""
    limited, stops = found.get("limits", {}), found.get("stop", {})
    wrong = [f"limits = {_written(limited[c], law, c)} have no stop; {GIVE_A_STOP}" for c in limited if c not in stops]
    wrong += [f"stop = {shown(stops[c])} does nothing without limits of its {c}; give limits=(lowest, highest), or omit it"
              for c in stops if c not in limited]
    for c in limited:
        if limited[c] is None:
            continue
        if c in found.get("prescribed", {}):
            wrong.append(f"limits = {_written(limited[c], law, c)}: its {c} is prescribed, so that no stop can hold it; omit "
                         f"limits and stop")
            continue
        start = found.get("start", {}).get(c)
        if start is not None and not _inside(start, limited[c]):
            wrong.append(f"{words.get('start', 'start')} = {start:g} {law.coordinates[c].unit} is outside limits = "
                         f"{_written(limited[c], law, c)}; start between them")
    if limited and isinstance(model, Clearance):
        wrong.append("limits of a joint with clearance are not modelled; omit them, or use model=mb.Kinematic()")
    return wrong


def _inside(value: float, pair: Limits) -> bool:
    low, high = pair
    return (low is None or value >= low) and (high is None or value <= high)


def _written(pair: Limits | None, law: type[Joint], c: str) -> str:
    if pair is None:
        return "those given"
    low, high = ("none" if value is None else f"{value:g}" for value in pair)
    return f"({low}, {high}) {law.coordinates[c].unit}"


#: option -> readers of its value for an angle and for a displacement
READERS: dict[str, tuple[Reader, Reader]] = {
    "prescribed": (reading.driven("rad"), reading.driven("m")),
    "start": (reading.quantity("rad"), reading.quantity("m")),
    "start_rate": (reading.quantity("rad/s"), reading.quantity("m/s")),
    "spring": (reading.driven("N m/rad", True), reading.driven("N/m", True)),
    "damper": (reading.driven("N m s/rad", True, least=FEEDS), reading.driven("N s/m", True, least=FEEDS)),
    "load": (reading.driven("N m", True, named=True), reading.driven("N", True, named=True)),
    "limits": (limits("rad"), limits("m")),
    "stop": (stop("N m/rad", "N m s/rad"), stop("N/m", "N s/m")),
    "friction": (friction_law, friction_law),
    "radius": (reading.quantity("m", "positive"),) * 2,
    "normal_force": (reading.quantity("N", "not negative"),) * 2,
    "rotor": (reading.quantity("kg m^2", "not negative"), reading.quantity("kg", "not negative")),
}
LawArguments = tuple[type[TwoBodyLaw], dict[str, Any]]  #: class of a law, and its arguments by name


@dataclass
class OnCoordinates:
    """What acts on the coordinates of a joint, by option and coordinate; `own`: values of the joint's own law."""

    law: type[Joint]
    values: dict[str, dict[str, Any]]
    own: dict[str, Any] = field(default_factory=dict)

    def of(self, option: str) -> dict[str, Any]:
        """The values of an option by coordinate."""
        return self.values.get(option, {})

    @property
    def unreadable(self) -> bool:
        """Whether something acts on a coordinate that can only be read where it is an unknown of its own."""
        acted = any(self.of(option) for option in ("spring", "damper", "load", "friction", "limits"))
        if self.of("rotor"):
            return True
        tied = self.law.ties is not Joint.ties
        return (acted and self.law.coordinate is Joint.coordinate) or bool(self.of("prescribed") and not tied)

    @property
    def counts_turns(self) -> bool:
        """Whether an angle has limits: it must count whole turns, which only a coordinate that is an unknown of its own does."""
        return any(self.law.coordinates[c].unit == "rad" for c in self.of("limits"))

    def forces(self) -> list[LawArguments]:
        """Class and arguments of every force law on the coordinates: springs, dampers, loads, stops and friction."""
        return [(made[0], {"coordinate": c, **made[1]}) for c in self.law.scalars() for made in self._on(c)]

    def _on(self, c: str) -> list[LawArguments]:
        found: list[LawArguments] = []
        if c in self.of("spring"):
            start = self.of("start").get(c, 0.0) if self.law.coordinates[c].unit == "rad" else 0.0
            turns = 2 * math.pi * round(start / (2 * math.pi))
            found.append((JointSpring, {"stiffness": self.of("spring")[c], "rest": 0.0, "turns": turns}))
        if c in self.of("damper"):
            found.append((JointDamper, {"damping": self.of("damper")[c]}))
        if c in self.of("load"):
            found.append((JointLoad, {"load": self.of("load")[c]}))
        if c in self.of("normal_force") and c in self.of("friction"):
            given = {"friction": self.of("friction")[c], "normal_force": self.of("normal_force")[c]}
            found.append((JointFriction, given | ({"radius": self.of("radius")[c]} if c in self.of("radius") else {})))
        pair = pairs_of(self.values, self.law).get(c)
        if pair is not None:
            (low, high), stop = pair
            found.append((JointStop, {"stiffness": stop.stiffness, "damping": stop.damping or None, "lower": low, "upper": high}))
        return found


def on_coordinates(scene: Any, item: str, law: type[Joint], words: Mapping[str, str], given: Mapping[str, Any],
                   model: JointModel | None) -> OnCoordinates:
    """The options of a joint by coordinate; mistakes are added to the scene's problems. words: option -> its name in the
    statement, where that differs, such as "angle0" for "start"."""
    given = dict(given) | {option: _where_friction_acts(law, option, given) for option in ("radius", "normal_force")}
    given["stop"] = for_each_limit(law, given.get("stop"), given.get("limits"))
    values = {option: by_coordinate(Argument(scene, item, words.get(option, option)), law, given.get(option), readers)
              for option, readers in READERS.items()}
    found = OnCoordinates(law, values)
    for option in ("start", "start_rate"):
        for c in sorted(found.of(option).keys() & found.of("prescribed").keys()):
            scene.problems.append(f"{item}: its {c} is prescribed, which fixes the start already; omit "
                                  f"{words.get(option, option)} = {found.of(option)[c]:g}")
    scene.problems += [f"{item}: {text}" for text in mistakes(values, law, words, model)]
    wrong = _friction_mistakes(found, words, model)
    scene.problems += [f"{item}: {text}" for text in wrong]
    if wrong:
        found.values |= {"friction": {}, "radius": {}, "normal_force": {}}
    own = [c for c in found.of("friction") if c not in found.of("normal_force")]
    if own:
        found.own = {"friction": found.of("friction")[own[0]], "rubs": own[0] if len(law.scalars()) > 1 else None}
        found.own |= {"friction_radius": found.of("radius")[own[0]]} if own[0] in found.of("radius") else {}
    return found


def _where_friction_acts(law: type[Joint], option: str, given: Mapping[str, Any]) -> Any:
    """Radius or normal force by coordinate: one given once, for a joint of several coordinates, is that of each with friction."""
    value, friction = given.get(option), given.get("friction")
    if value is None or isinstance(value, Mapping) or not isinstance(friction, Mapping):
        return value
    return {c: value for c, entry in law.scalars().items() if c in friction and (option != "radius" or entry.unit == "rad")}


def by_coordinate(arg: Argument, law: type[Joint], value: Any, readers: tuple[Reader, Reader]) -> dict[str, Any]:
    """Values by coordinate of an option given as one value or as a mapping; empty where it is not given."""
    names = list(law.scalars())
    if value is None:
        return {}
    if not names:
        arg.wrong(shown(value), f"a {law.__name__} has no angle or displacement; omit {arg.option}")
        return {}
    if not isinstance(value, Mapping):
        if len(names) > 1:
            arg.wrong(shown(value), f"say for which coordinate, as in {{'{names[0]}': ...}}; the joint has {', '.join(names)}")
            return {}
        return {names[0]: readers[law.coordinates[names[0]].unit == "m"](arg, value)}
    found = {}
    for name, one in value.items():
        if name not in names:
            arg.wrong(shown(value), f"there is no coordinate {shown(name)}; the joint has {', '.join(names)}")
        elif one is not None:
            found[name] = readers[law.coordinates[name].unit == "m"](arg.part(f"{arg.option}['{name}']"), one)
    return found


def _friction_mistakes(found: OnCoordinates, words: Mapping[str, str], model: JointModel | None) -> list[str]:
    """What is wrong with the friction of a joint, one sentence each."""
    friction, radius, normal = (found.of(option) for option in ("friction", "radius", "normal_force"))
    wrong = []
    for option, unit, values in (("radius", "m", radius), ("normal_force", "N", normal)):
        for c in values.keys() - friction.keys():
            wrong.append(f"{option} = {values[c]:g} {unit} does nothing without friction=; give mb.Coulomb(mu, v_c), or omit it")
    for c in friction:
        if found.law.coordinates[c].unit == "rad" and c not in radius:
            wrong.append("radius = None: friction in a bearing needs the radius of its pin, a positive number in m")
    if friction and isinstance(model, Clearance):
        friction_options = " and ".join(f"{o}=" for o in ("friction", "radius", "normal_force") if found.of(o))
        wrong.append(f"friction of a joint with clearance belongs to its model: omit {friction_options}, say "
                     f"model=mb.Clearance(outer, inner, normal, friction=...)")
    own = [c for c in friction if c not in normal]
    if own and isinstance(model, Recursive):
        wrong.append("its friction follows from its reaction, and a recursive joint has none among its unknowns; use "
                     "model=mb.Kinematic() or a given normal_force")
    if len(own) > 1:
        wrong.append(f"friction on {' and '.join(own)}: without a normal_force, friction follows from the joint's reaction, "
                     f"which is modelled for one coordinate alone; give a normal_force in N for all but one")
    return wrong
