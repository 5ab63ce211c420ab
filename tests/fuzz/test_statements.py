"""Every argument of every statement, law, part and joint model, replaced by values that nobody can mean.

The arguments come from the signatures: a new one is fuzzed by itself, and a new statement or class fails until it has good values
here. A value is either refused by a sentence that names the item, the argument and the value, or it is the number one, and then
it is stated as 1.0 is, whatever library wrote it.
"""

from __future__ import annotations

import copy
import inspect
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbdae as mb
from mbdae.inputs.sensed import paths
from mbdae.scene.components import JointModel
from mbdae.scene.scene import SceneData
from mbdae.symbolic.law import Law
from mbdae.symbolic.part import Part
from mbdae.values import shown

sys.path.insert(0, str(Path(__file__).parent))
from hostile import HOSTILE, ONES

Said = Callable[..., tuple[list[str], Any]]  #: the arguments by name -> (what was wrong, what was stated as plain data)
DRY, SECTION = mb.Coulomb(0.3, 1e-3), mb.Section(1, 1, 1, 1, 1, 1, 1, 1)
PAIR: dict[str, Any] = {"k": "ground", "l": "rod"}
REDUCED = mb.ReducedBody(1.0, np.zeros(3), np.eye(3), np.eye(3), {"a": np.zeros(3)}, np.zeros((3, 6, 0)), np.zeros(0),
                         np.zeros(0), {"a": np.zeros((6, 0))}, np.zeros(0), 0.0, np.eye(3)[:, :, None])
HINGE = PAIR | {"at": (0, 0, 0)}
MOVED: dict[str, Any] = {"angle": 0.1, "angle0": 0.1, "rate0": 0.1, "spring": 1.0, "damper": 1.0}
SLID: dict[str, Any] = {"position": 0.1, "position0": 0.1, "rate0": 0.1, "spring": 1.0, "damper": 1.0}
LIMITED: dict[str, Any] = {"limits": (0.0, 2.0), "stop": mb.Stop(1.0)}
ALONG: dict[str, Any] = {"name": "x", **HINGE, "axis": (1, 0)}
LOOK: dict[str, Any] = {"shape": mb.Sphere(radius=0.1), "color": "red"}


class Own(mb.Force):
    """A law of a user's own with a parameter."""

    params = mb.params(stiffness=("N/m", "stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        return self.stiffness * ((l.r - k.r) @ (l.r - k.r)) / 2


#: good values of every argument of every statement: those that are always given, and those given one at a time
STATEMENTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "rigid_body": ({"name": "x", "mass": 1.0, "inertia": (1.0, 1.0, 1.0)},
                   {"at": (0, 0, 1), "rotation": np.eye(3), "velocity": (1, 0), "angular_velocity": (0, 0, 1), "as_given": False,
                    "gravity": (0, 0), **LOOK}),
    "point_mass": ({"name": "x", "mass": 1.0, "at": (0, 1)}, {"velocity": (1, 0), "gravity": (0, 0), **LOOK}),
    "link": ({"name": "x", "points": [(0, 1), (1, 1)]}, {"mass": 1.0, "mass_per_length": 1.0, "gravity": (0, 0), **LOOK}),
    "contact": ({"name": "x", "k": "ground", "l": "rod", "shape_k": mb.Plane(at=(0, -9), normal=(0, 1)), "shape_l": mb.Point(),
                 "normal": mb.Hertz(1e8)}, {"friction": None}),
    "beam": ({"name": "x", "points": [(0, 1), (1, 1)], "section": SECTION},
             {"elements": 2, "order": 2, "curve": None, "axis2": (0, 0, 1), "velocity": (0, 0, 1), "angular_velocity": (0, 1)}),
    "reduced_body": ({"name": "x", "body": REDUCED},
                     {"at": (0, 1), "damping": 0.1, "velocity": (0, 0, 1), "angular_velocity": (0, 1)}),
    "line_load": ({"name": "x", "beam": "beam", "per_length": (0, 1.0)}, {"frame": "section"}),
    "revolute": ({"name": "x", **HINGE}, {"axis": (0, 0, 1), "model": mb.Recursive(), "torque": 1.0, "friction": None,
                                          "radius": None, "normal_force": None, "axis_l": (0, 0, 1), **MOVED, **LIMITED}),
    "prismatic": ({"name": "x", **HINGE, "axis": (1, 0)}, {"model": None, "force": 1.0, "friction": DRY, "normal_force": None,
                                                           "axis_l": (1, 0), **SLID, **LIMITED}),
    "joint": ({"joint": mb.Revolute, "name": "x", **HINGE},
              {"axis": (0, 0, 1), "axis_x": (1, 0), "model": None, "prescribed": 0.1, "start": 0.1, "start_rate": 0.1,
               "spring": 1.0, "damper": 1.0, "load": 1.0, "friction": None, "rotor": 0.1, **LIMITED}),
    "cylindrical": (ALONG, {}), "screw": ({**ALONG, "lead": 1.0}, {}), "universal": (ALONG | {"axis": (0, 0, 1)},
                                                                                {"axis_l": (0, 0, 1), "pin": (0, 1)}),
    "generic": ({"name": "x", **HINGE}, {"axis": (0, 0, 1), "axis_x": (1, 0), "free": ("x", "angle_z")}),
    "rolling": ({"name": "x", **HINGE, "axis": (0, 0, 1), "normal": (0, 1)}, {"radius": 1.0}),
    "knife_edge": ({"name": "x", **HINGE, "along": (1, 0)}, {"normal": (0, 0, 1)}),
    "planar": (ALONG, {"axis_x": (0, 1)}), "point_on_line": (ALONG, {}), "point_on_plane": (ALONG, {"axis_x": (0, 1)}),
    "couple": ({"name": "x", "of": {"A.angle": 1.0, "B.angle": 1.0}}, {"value": 1.0}),
    "gear": ({"name": "x", "driving": "A", "driven": "B", "ratio": 1.0}, {}),
    "rack": ({"name": "x", "pinion": "A", "rack": "S", "radius": 1.0}, {}),
    "differential": ({"name": "x", "first": "A", "second": "B", "carrier": "C"}, {}),
    "spherical": ({"name": "x", **HINGE}, {"model": None}), "weld": ({"name": "x", **PAIR}, {"at": (0, 0)}),
    "distance": ({"name": "x", **PAIR, "at_k": (0, 1), "at_l": (0, 0)}, {}),
    "fixed_orientation": ({"name": "x", **PAIR}, {"at": (0, 0)}),
    "rope": ({"name": "x", **PAIR, "at_k": (0, 3), "at_l": (0, 0), "stiffness": 1.0},
             {"damping": 1.0, "length": 1.0, "over": [("ground", 0.1, (9, 0))], "radius_k": 0.1, "radius_l": 0.1,
              "axis": (0, 0, 1)}),
    "spring": ({"name": "x", **PAIR, "at_k": (0, 1), "at_l": (0, 0), "stiffness": 1.0}, {"damping": 1.0, "length": 1.0}),
    "bushing": ({"name": "x", **HINGE, "stiffness": (1.0, 1.0, 1.0)}, {"damping": (1.0, 1.0, 1.0)}),
    "frame": ({"name": "x", "body": "rod"}, {"at": (0, 0), "rotation": np.eye(3)}),
    "force": ({"name": "x", "body": "rod", "value": (1.0, 0, 0)}, {"at": (0, 0), "frame": "body"}),
    "torque": ({"name": "x", "body": "rod", "value": (0, 0, 1.0)}, {"frame": "body"}),
    "add": ({"law": Own("x", "ground", "rod", stiffness=1.0)}, {"model": None}),
    "state": ({"name": "x", "rate": 1.0}, {"start": 1.0, "size": 1.0}), "signal": ({"name": "x", "value": 1.0}, {}),
    "controller": ({"name": "x", "f": lambda t, *values: 1.0, "every": 1.0, "sets": ["u"]},
                   {"reads": ["A.angle"], "memory": 1.0, "start": 1.0,
                    "derivative": lambda t, *values: [[0.0]]}),
}
NO_STATEMENTS = {"replace", "recursive", "joints", "sensor"}  #: public, but they state nothing
LAW = {"name": "x", "k": "ground", "l": "rod"}
LAW_PLACES: dict[str, Any] = {"at": (0, 1, 0), "axis": (0, 0, 1), "at_l": (0, 1), "axis_x": (1, 0), "axis_l": (0, 0, 1),
                              "axis_x_l": (1, 0)}
AUGMENTED = {"scaling": 1.0, "penalty": 1.0}
JOINT: dict[str, Any] = {**LAW_PLACES, "kept": True, "friction": None, "rubs": None}
#: the same of public classes
CLASSES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    **{name: (LAW, JOINT | dict.fromkeys(getattr(mb, name).drives(), 0.1) | dict.fromkeys(
        {"friction_radius"} & getattr(mb, name).params.keys(), 1.0))
       for name in ("Cylindrical", "FixedOrientation", "Free", "Planar", "PointOnLine", "PointOnPlane", "Prismatic",
                    "Spherical", "Universal", "Weld")},
    "Revolute": (LAW, {**JOINT, "drive": 0.1, "friction_radius": 1.0, **AUGMENTED}),
    "Joint": (LAW, {key: value for key, value in JOINT.items() if key not in ("kept", "friction", "rubs")}),
    "Screw": ({**LAW, "lead": 1.0}, {**JOINT, "drive": 0.1, "friction_radius": 1.0}), "Distance": ({**LAW, "length": 1.0}, JOINT),
    "Force": (LAW, LAW_PLACES), "Own": ({**LAW, "stiffness": 1.0}, LAW_PLACES),
    "Coulomb": ({"mu": 1.0, "v_c": 1.0}, {}), "Friction": ({}, {}), "Normal": ({}, {}), "Recursive": ({}, {}),
    "LuGre": ({"mu_k": 1.0, "mu_s": 1.0, "v_s": 1.0, "sigma0": 1e5, "sigma1": 1.0},
              {"sigma2": 1.0, "gamma": 2, "damping_decay": True}),
    "Hertz": ({"stiffness": 1.0}, {"damping": 1.0}), "Stop": ({"stiffness": 1.0}, {"damping": 1.0}),
    "Kinematic": ({}, AUGMENTED), "Classical": ({}, AUGMENTED),
    "Clearance": ({"outer": 1.0, "inner": 1.0, "normal": mb.Hertz(1.0)}, {"friction": None, "length": 1.0}),
    "Section": (dict.fromkeys(("EA", "GA2", "GA3", "GJ", "EI2", "EI3", "mass_per_length", "rotary_inertia"), 1.0),
                {"damping": 1.0}),
}
BY_MAKERS = {"Section": {"E", "shape"}}  #: given by mb.Section.circular and the like alone
STEEL = {"E": 1.0, "nu": 0.3, "rho": 1.0}
#: functions that make or use them: (function, good values)
FUNCTIONS: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Hertz.restitution": (mb.Hertz.restitution, {"stiffness": 1.0, "e": 0.5, "v": 1.0}),
    "Hertz.coefficient_of_restitution": (mb.Hertz(1.0, 1.0).coefficient_of_restitution, {"v": 1.0}),
    "section circular": (mb.Section.circular, {"radius": 1.0, **STEEL, "damping": 0.0}),
    "section tube": (mb.Section.tube, {"outer": 2.0, "inner": 0.5, **STEEL, "damping": 0.0}),
    "section rectangular": (mb.Section.rectangular, {"width": 1.0, "height": 1.0, **STEEL, "damping": 0.0}),
    "params": (mb.params, {"radius": ("m", "what it is")}),
}
PLAIN = (float, int, str, bool, type(None))
TEXTS = ("text", "digits as text")
PLANE = ("a list", "a range")  #: two or three numbers: a point, a direction, a load
VECTORS = ("at", "at_k", "at_l", "axis", "axis2", "axis_x", "axis_l", "axis_x_l", "velocity", "angular_velocity", "value",
           "per_length", "gravity")
#: (argument, kind of value) that mean something after all, with the reason
LEGITIMATE: dict[tuple[str, str], str] = (
    {("name", kind): "any text is a name" for kind in TEXTS}
    | {(argument, kind): "coordinates, the third is 0 where it is left out" for argument in VECTORS for kind in PLANE}
    | {("limits", "a list"): "two limits", ("limits", "minus infinity inside"): "no lower limit",
       **{("pin", kind): "a direction" for kind in PLANE}}
    | {("kept", kind): "a switch" for kind in ("a truth value", "numpy's")} | {("of", "a dict"): "its key is named"}
    | {("points", kind): "coordinates of the first point" for kind in PLANE}
    | {(f"bushing.{argument}", "a range"): "three numbers" for argument in ("stiffness", "damping")}
    | {(option, kind): "a switch" for option in ("damping_decay", "as_given") for kind in ("a truth value", "numpy's")}
    | {("elements", "a list"): "elements of two segments, which is told of this beam of one"}
    | {(argument, kind): "a direction" for argument in ("knife edge.normal", "knife edge.along", "rolling.normal")
       for kind in PLANE}
    | {("start", "a range"): "start values, of which there are too many"}
    | {("rotary_inertia", "a range"): "three values, the first of which is refused as rotary_inertia[0]"}
    | {("inertia", "a range"): "three principal moments", ("elements", "one entry"): "the elements of one segment"}
    | {("friction", "none"): "no friction", ("radius", "text"): "a unit", ("radius", "digits as text"): "a unit"}
    | {("radius", "a tuple of text"): "a unit and a meaning", ("point", "a list"): "a place", ("point", "a range"): "a place"}
    | {(argument, "text"): "the name of a sensor" for argument in ("torque", "load", "force")}
    | {(argument, kind): "names" for argument in ("reads", "sets") for kind in (*TEXTS, "a tuple of text")}
    | {("controller.start", kind): "the value of its one output" for kind in ("one entry", "a matrix")}
    | {("memory", kind): "anything can be remembered" for kind in HOSTILE}
    | {("f", kind): "a function" for kind in ("a function", "a lambda")}
)


def scene(with_beam: bool = False, with_joints: bool = False) -> mb.Scene:
    s = mb.Scene("fuzz")
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    for name in "ABCS" if with_joints else "":
        body = s.link(f"link {name}", (0, 0), (1, 0), mass=1.0)
        s.joint(mb.Prismatic if name == "S" else mb.Revolute, name, rod, body, at=(0, 0))
    if with_beam:
        s.beam("beam", (0, 0), (1, 0), section=SECTION, elements=2)
    return s


def stated(s: mb.Scene) -> tuple[list[str], Any]:
    """Problems, and what was stated, as JSON has it (1 is 1.0)."""
    assert not s.problems or _refuses(s)
    assert s.problems or all(type(v) in PLAIN or paths(v) for v in _values(s))
    return s.problems, None if s.problems else json.loads(json.dumps([s.name, s.space, s.gravity.tolist(), s.statements]))


def _values(s: mb.Scene) -> Iterator[Any]:
    """Every value in the statements, and every parameter of a law."""
    waiting: list[Any] = [s.statements, [[getattr(law, p) for p in law.params] for c in s.connections for law in c.laws]]
    while waiting:
        value = waiting.pop()
        if type(value) in (list, dict):
            waiting += value if type(value) is list else value.values()
        else:
            yield value


def _refuses(s: mb.Scene) -> bool:
    """Whether a scene with problems cannot become another scene that has forgotten them."""
    with pytest.raises(mb.SceneError) as caught:
        s.replace(model=mb.Classical())
    return caught.value.problems == s.problems


def say(method: str) -> Said:
    def said(**given: Any) -> tuple[list[str], Any]:
        s, rest = scene(method == "line_load", method in ("couple", "gear", "rack", "differential")), dict(given)
        first = (rest.pop("name"), *rest.pop("points")) if "points" in given else ()
        getattr(s, method)(*first, **rest)
        return stated(s)

    return said


def make(name: str) -> Said:
    """A class made, and used where it has a use."""
    cls: Any = Own if name == "Own" else getattr(mb, name)

    def made(**given: Any) -> tuple[list[str], Any]:
        found, s = cls(**given), scene()
        if isinstance(found, Law):
            s.add(found)
        elif isinstance(found, JointModel):
            s.revolute("x", s.ground, "rod", at=(0, 0), model=found)
        elif isinstance(found, mb.Section):
            s.beam("x", (0, 0), (1, 0), section=found)
        elif isinstance(found, mb.Stop):
            s.revolute("x", s.ground, "rod", at=(0, 0), limits=(-1, 1), stop=found)
        elif isinstance(found, mb.Normal):
            s.revolute("x", s.ground, "rod", at=(0, 0), model=mb.Clearance(1, 1, found))
        elif isinstance(found, Part):
            s.revolute("x", s.ground, "rod", at=(0, 0), friction=found, radius=1)
        return stated(s)

    return made


def call(function: Callable[..., Any]) -> Said:
    return lambda **given: ([], repr(function(**given)))


def arguments(function: Any) -> set[str]:
    found = list(inspect.signature(function).parameters.values())
    return {p.name for p in found if p.kind is not inspect.Parameter.VAR_KEYWORD and p.name != "self"}


def targets() -> Iterator[tuple[str, Said, dict[str, Any], dict[str, Any]]]:
    """(item, what says it, good values always given, good values given one at a time)."""
    for name, (always, once) in STATEMENTS.items():
        yield name.replace("_", " "), say(name), always, once
    for name, (always, once) in CLASSES.items():
        yield name, make(name), always, once
    for name, (function, always) in FUNCTIONS.items():
        yield name, call(function), always, {}
    yield "'rod'.at", lambda point: ([], scene()["rod"].at(point).point.tolist()), {"point": (0, 0)}, {}
    yield "scene", lambda **given: stated(mb.Scene(**given)), {"name": "x"}, {"gravity": (0, 0), "space": "planar"}
    yield "line load of a beam", _loaded, {"per_length": (0, 1.0), "name": "x"}, {"frame": "section"}


def _loaded(**given: Any) -> tuple[list[str], Any]:
    s = scene(with_beam=True)
    s["beam"].load(**given)
    return stated(s)


def cases() -> Iterator[tuple[str, Said, dict[str, Any], str, str, Any, Any]]:
    """(item, what says it, other arguments, argument, kind of value, what the argument becomes, the value in it)."""
    for item, said, always, once in targets():
        for argument, good in (always | once).items():
            others = {key: value for key, value in always.items() if key != argument}
            if item == "link" and argument not in ("mass", "mass_per_length"):
                others["mass"] = 1.0
            if argument in ("radius", "normal_force") and item in ("revolute", "prismatic"):
                others["friction"] = DRY
            if argument in ("limits", "stop") and item in ("revolute", "prismatic", "joint"):
                others |= LIMITED
                others.pop(argument)
            if (argument, item) in (("friction", "revolute"), ("friction", "joint"), ("normal_force", "revolute")):
                others["radius"] = 1.0
            for kind, value in (HOSTILE | {f"one as {k}": v for k, v in ONES.items()}).items():
                if argument == "points":
                    yield item, said, others, argument, kind, [value, *good[1:]], value
                else:
                    yield item, said, others, argument, kind, value, value
                if isinstance(good, tuple | np.ndarray) and item != "params":
                    yield item, said, others, argument, f"{kind} inside", _inside(good, value), value


def _inside(good: Any, value: Any) -> Any:
    """The good value as nested lists with another first number."""
    whole = good.tolist() if isinstance(good, np.ndarray) else list(copy.copy(good))
    if isinstance(whole[0], list):
        whole[0][0] = value
    else:
        whole[0] = value
    return whole


def outcome(said: Said, given: dict[str, Any]) -> tuple[str, Any]:
    """(text of what was wrong, plain data of what was accepted)."""
    try:
        problems, plain = said(**given)
    except mb.MbdaeError as error:
        return str(error), None
    return "\n".join(problems), plain


def test_every_public_argument_is_fuzzed() -> None:
    public = {name for base in SceneData.__mro__ for name in vars(base) if base is not object and not name.startswith("_")}
    methods = {name for name in public if callable(getattr(SceneData, name)) or isinstance(getattr(SceneData, name), property)}
    assert methods == set(STATEMENTS) | NO_STATEMENTS
    for name, (always, once) in STATEMENTS.items():
        assert arguments(getattr(SceneData, name)) == {*always, *once}, name
    classes = [name for name in mb.__all__ if isinstance(getattr(mb, name), type)]
    assert {n for n in classes if issubclass(getattr(mb, n), Law | Part | JointModel | mb.Section | mb.Stop)
            and n != "Coupling"} | {"Own"} == set(CLASSES)
    for name, (always, once) in CLASSES.items():
        cls: Any = Own if name == "Own" else getattr(mb, name)
        own = {*cls.params, *cls.options} if issubclass(cls, Law) else set()
        assert arguments(cls.__init__) - {"values"} - BY_MAKERS.get(name, set()) | own == {*always, *once}, name


@pytest.mark.parametrize("part", [6, pytest.param(1, marks=pytest.mark.slow)])
def test_nobody_can_mean_them_and_everybody_is_told(part: int) -> None:
    """Refused by name, argument and value; or the number one, stated as 1.0 is. Of every argument a part of the values, another
    one than of the argument before; or all."""
    count, wrong = 0, []
    plain: dict[Any, tuple[str, Any]] = {}
    places: dict[tuple[str, str], int] = {}
    for item, said, others, argument, kind, given, value in cases():
        turn = places[item, argument] = places.get((item, argument), len(places)) + 1
        if turn % part:
            continue
        count += 1
        text, accepted = outcome(said, others | {argument: given})
        head = kind.removesuffix(" inside")
        if head.startswith("one as "):
            key = item, argument, kind.endswith(" inside")
            if key not in plain:
                one = [1.0, *given[1:]] if argument == "points" else _inside(given, 1.0) if kind.endswith(" inside") else 1.0
                plain[key] = outcome(said, others | {argument: one})
            if (accepted is None) != (plain[key][1] is None) or accepted != plain[key][1]:
                wrong.append(f"{item}({argument} = {kind}): {text or accepted} but 1.0 gives {plain[key]}")
                continue
        elif (argument, kind) in LEGITIMATE or (f"{item}.{argument}", kind) in LEGITIMATE:
            continue
        elif not text:
            wrong.append(f"{item}({argument} = {kind}) is accepted: {accepted}")
        if text and not _told(text, item, argument, value, given):
            wrong.append(f"{item}({argument} = {kind}): {text}")
    assert count > 4000 / part
    assert not wrong, f"{len(wrong)} of {count}:\n" + "\n".join(wrong[:60])


@pytest.mark.parametrize("target", targets(), ids=lambda target: target[0])
def test_an_unknown_argument_is_named_with_the_one_meant(target: tuple[str, Said, dict[str, Any], dict[str, Any]]) -> None:
    item, said, always, once = target
    if item in ("params", "'rod'.at") or not always | once:
        return  # any name is a parameter; the place is given without a name; nothing can be given
    last = [*always, *once][-1]
    try:
        text = "".join(said(**always, **{f"{last}x": 1.0})[0])
    except (TypeError, mb.MbdaeError) as refused:
        text = str(refused)
    assert f"'{last}x': did you mean '{last}'? it" in text


def _told(text: str, item: str, argument: str, value: Any, given: Any) -> bool:
    """Whether one sentence names the item (or its kind), the argument and the value."""
    words = {"points": "point 1"}.get(argument, argument)
    names = {item, "'x'", item.partition(" ")[0].lower(), item.partition(".")[0]}
    several = isinstance(value, list | tuple | range | np.ndarray) and np.asarray(value, dtype=object).ndim
    seen = [shown(v) for v in (value, given, *(value if several else ()))]
    return any(words in line and any(n in line for n in names) and any(v in line for v in seen) for line in text.splitlines())
