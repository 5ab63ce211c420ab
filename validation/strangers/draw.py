"""Scenes that hypothesis draws: families of mechanisms, as stories. They shrink to few bodies with round numbers."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
from hypothesis import strategies as st
from strangers.extras import coupled, fed, rattling, touching
from strangers.inputs import loads, motions, tenths
from strangers.story import Along, Made, Said, Story, script

Draw = Any
GRAVITY = (0.0, -9.81, 0.0)
PLANE = [(1.0, 0.0), (0.0, -1.0), (0.8, 0.6), (-0.6, 0.8), (-1.0, 0.0), (0.6, -0.8), (0.0, 1.0), (-0.28, -0.96)]
SPACE = [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.48, 0.6, 0.64), (-0.36, 0.48, -0.8), (0.0, -0.6, 0.8),
         (0.8, -0.6, 0.0)]
LENGTHS = [0.5, 1.0, 0.3, 0.7]
ENDS = [0.5, 0.3, 1.0]
ACCURACIES = [1e-5, 1e-4, 1e-3, 1e-6, 1e-7]
PLANAR_JOINTS = ["revolute", "revolute", "revolute", "prismatic", "weld", "planar", "fixed_orientation", "distance", "bushing"]
JOINTS = ["revolute", "revolute", "spherical", "prismatic", "cylindrical", "screw", "universal", "planar", "point_on_line",
          "point_on_plane", "fixed_orientation", "weld", "distance", "bushing"]
SOLVERS: list[dict[str, str]] = [
           {}, {}, {}, {}, {"solver": "'radau3'"}, {"solver": "'radau2'"}, {"solver": "'radau5'"}, {"solver": "'ida'"},
           {"solver": "'dop853'", "form": "'index1'"}, {"solver": "'cvode'", "form": "'index1'"}, {"form": "'ggl'"},
           {"solver": "'radau3'", "form": "'index1'"}, {"solver": "'radau3'", "form": "'index3'"},
           {"solver": "mb.CVODE(method='BDF')", "form": "'index1'"}, {"solver": "mb.HHT()"}, {"verify": "True"},
           {"solver": "mb.GeneralizedAlpha()"}, {"outputs": "7"}]

BODIES, LOADS = ("rigid_body", "link", "point_mass"), ("force", "torque", "spring", "own")
BEAM_WAYS: list[dict[str, str]] = [{}, {}, {"solver": "'radau3'"}, {"solver": "'radau2'"}, {"solver": "'radau5'"}]
MODELS = ["", "", "", "kinematic", "classical", "recursive"]
IN_SPACE = [["revolute"], ["universal", "spherical"], ["spherical", "cylindrical"], ["revolute"]]  #: joints of a loop


def shifted(a: Any, b: Any, factor: float = 1.0) -> tuple[float, ...]:
    """a + factor b without noise in the last digits."""
    return tuple(round(float(p + factor * q), 6) for p, q in zip(a, b, strict=True))


def maybe(draw: Draw, one_in: int) -> bool:
    """Rarely true, and false where it shrinks."""
    return bool(draw(st.integers(0, one_in - 1)) == one_in - 1)


def directions(planar: bool) -> st.SearchStrategy[Any]:
    """Unit vectors."""
    return st.sampled_from(PLANE if planar else SPACE)


def axes(draw: Draw, planar: bool) -> tuple[float, ...]:
    """The axis of a joint that turns."""
    return draw(st.sampled_from([(0, 0, 1), (0, 0, 1), (0, 0, -1)])) if planar else draw(directions(False))


def body(draw: Draw, name: str, a: Any, b: Any, planar: bool) -> Said:
    """A body between two points: a link, or one with products of inertia, a turned frame, a start of its own."""
    mass = draw(st.sampled_from([1.0, 0.4, 3.0]))
    if planar and draw(st.booleans()):
        return Said("link", {"name": name, "points": (a, b), "mass": mass})
    size = round(mass * float(np.sum((np.array(b) - np.array(a)) ** 2)) / 12 + 1e-3, 6)
    at = tuple(round((p + q) / 2, 6) for p, q in zip(a, b, strict=True))
    if planar:
        return Said("rigid_body", {"name": name, "mass": mass, "inertia": size, "at": at})
    J: Any = tuple(round(size * f, 6) for f in draw(st.sampled_from([(1.0, 1.0, 1.0), (1.0, 0.7, 0.6), (0.6, 1.0, 1.3)])))
    if maybe(draw, 3):
        p = round(0.2 * size, 6)
        J = ((J[0], p, 0.0), (p, J[1], -p / 2), (0.0, -p / 2, J[2]))
    args = {"name": name, "mass": mass, "inertia": J, "at": at}
    if maybe(draw, 4):
        args["rotation"] = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    return Said("rigid_body", args)


def joint(draw: Draw, name: str, k: str, l: str, a: Any, b: Any, planar: bool, T: float, kinds: list[str] | None = None,
          free: bool = False) -> Said:
    """A joint at a, with options; `free` for joints of loops: without stated starts and drives."""
    kind = draw(st.sampled_from(kinds or (PLANAR_JOINTS if planar else JOINTS)))
    args: dict[str, Any] = {"name": name, "k": k, "l": l}
    if kind == "distance":
        return Said(kind, {**args, "at_k": a, "at_l": b})
    args["at"] = a
    if kind == "bushing":
        c = draw(st.sampled_from([0.0, 1.0]))
        return Said(kind, {**args, "stiffness": (200.0,) * 3, "damping": (c,) * 3})
    if kind in ("spherical", "weld", "fixed_orientation"):
        return Said(kind, args)
    args["axis"] = draw(directions(planar)) if kind in ("prismatic", "cylindrical", "point_on_line") else axes(draw, planar)
    if planar and kind == "planar":
        args["axis"] = (0, 0, 1)
    if kind == "screw":
        args["lead"] = draw(st.sampled_from([0.2, -0.3, 0.05]))
    if kind == "universal":
        args["pin"] = tuple(float(x) for x in np.round(_normal(args["axis"]), 12))
    if kind in ("revolute", "prismatic"):
        _options(draw, args, kind, T, free)
    elif kind in ("cylindrical", "planar") and maybe(draw, 2):
        args |= {"spring": {"angle": 3.0}, "damper": {"angle": 0.1}}
    elif kind == "screw" and maybe(draw, 2):
        args |= {"spring": {"angle": 3.0}, "load": {"angle": draw(loads(T, 3.0))}}
    return Said(kind, args)


def _normal(axis: Any) -> Any:
    a = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    return a / np.linalg.norm(a)


def _options(draw: Draw, args: dict[str, Any], kind: str, T: float, free: bool) -> None:
    turns = kind == "revolute"
    words = ["load", "spring", "plain", "friction", "stop"] + ([] if free else ["rate", "drive", "start"])
    word = draw(st.sampled_from(["plain", *words]))
    if word == "load":
        args["torque" if turns else "force"] = draw(loads(T, 4.0))
    if word == "spring" or (not turns and word == "plain"):
        args |= {"spring": draw(st.sampled_from([10.0, 100.0])), "damper": draw(st.sampled_from([0.0, 0.3]))}
    if word == "drive":
        args["angle" if turns else "position"] = draw(motions(T, draw(st.sampled_from([0.5, 2.0])) if turns else 0.2))
    if word == "start":
        args |= {"angle0" if turns else "position0": draw(tenths(-8, 8)), "rate0": draw(tenths(-20, 20))}
    if word == "rate":
        args["rate0"] = draw(tenths(-30, 30))
    if word == "friction":
        args |= {"friction": Made("Coulomb", {"mu": 0.3, "v_c": 0.05}), "normal_force": 5.0}
        args |= {"radius": 0.1} if turns else {}
    if word == "stop":
        high = draw(st.sampled_from([0.3, 0.1]))
        args |= {"limits": (-high, high), "stop": Made("Stop", {"stiffness": 2e3, "damping": draw(st.sampled_from([0.0, 5.0]))})}


def with_loads(draw: Draw, names: list[str], ends: dict[str, Any], planar: bool, T: float) -> list[Said]:
    """Springs to the ground and between bodies, forces and torques."""
    found = []
    for i in range(draw(st.integers(0, 2))):
        name = draw(st.sampled_from(names))
        kind = draw(st.sampled_from(["force", "spring", "torque", "own", "force"]))
        end = ends[name]
        if kind == "force":
            value = Along(draw(loads(T, 5.0)), (*draw(directions(planar)), 0.0)[:3])
            args = {"name": f"F{i}", "body": name, "value": value, "at": end}
            found.append(Said("force", {**args, "frame": "body"} if maybe(draw, 3) else args))
        elif kind == "torque":
            e = (0.0, 0.0, 1.0) if planar else draw(directions(False))
            found.append(Said("torque", {"name": f"M{i}", "body": name, "value": Along(draw(loads(T, 1.0)), e)}))
        else:
            at = shifted(end, draw(directions(planar)), 0.7)
            if kind == "spring":
                found.append(Said("spring", {"name": f"S{i}", "k": "ground", "l": name, "at_k": at, "at_l": end,
                                             "stiffness": draw(st.sampled_from([10.0, 100.0, 1000.0])),
                                             "damping": draw(st.sampled_from([0.0, 0.5]))}))
            else:
                found.append(Said("own", {"name": f"S{i}", "law": "QuarticSpring", "k": "ground", "l": name, "at": at,
                                          "at_l": end, "stiffness": 30.0}))
    return found


def gravity(draw: Draw, planar: bool) -> tuple[float, float, float]:
    """Down, or none."""
    down = GRAVITY if planar else draw(st.sampled_from([GRAVITY, (0.0, 0.0, -9.81)]))
    return draw(st.sampled_from([down, down, (0.0, 0.0, 0.0)]))


def ways(story: Story, count: int) -> list[Story]:
    """The story, and the same scene run in other ways: solver, form, joint model, accuracy, found from its text."""
    rng = random.Random(script(story))
    found = [story]
    for _ in range(count):
        options = rng.choice(BEAM_WAYS if story.of("beam") else SOLVERS)
        slow = "HHT" in str(options) or "Alpha" in str(options)
        if slow and story.family == "contact":
            continue
        least = 1e-4 if slow else 1e-5 if story.family in ("contact", "beam") else 1e-7
        model = rng.choice(models(story.statements))
        found.append(story.but(options=dict(options), accuracy=rng.choice([a for a in ACCURACIES if a >= least]), model=model))
    return found


def models(statements: Any) -> list[str]:
    """Models for all joints: none for those with clearance, and recursive where that leaves something to solve for."""
    if not any(a.verb in ("revolute", "prismatic", "cylindrical", "screw") for a in statements) or any(
            "model" in a.args for a in statements):
        return [""]
    joints = [a for a in statements if a.verb not in (*BODIES, *LOADS, "weld")]
    moves = any("angle" not in a.args and "position" not in a.args for a in joints)
    return [m for m in MODELS if m != "recursive" or moves]


def told(draw: Draw, family: str, statements: list[Said], planar: bool, T: float, finest: float = 1e-7) -> Story:
    """The story with a way to run it."""
    way = dict(draw(st.sampled_from(SOLVERS)))
    coarse = [a for a in ACCURACIES if a >= (1e-4 if "HHT" in str(way) or "Alpha" in str(way) else finest)]
    model = draw(st.sampled_from(models(statements)))
    g = gravity(draw, planar)
    return Story(family, tuple(statements), T, draw(st.sampled_from(coarse)), g, model=model, options=way)


@st.composite
def _limb(draw: Draw, i: int, ends: dict[str, Any], planar: bool, T: float, kinds: list[str] | None) -> list[Said]:
    """The next body of a tree and its joint; a strategy of its own, so that shrinking may leave out the one before."""
    name, earlier = f"b{i + 1}", draw(st.booleans())
    parent = list(ends)[-2:][0 if earlier else -1]
    a = ends[parent]
    b = shifted(a, draw(directions(planar)), draw(st.sampled_from(LENGTHS)))
    if maybe(draw, 8) and kinds is None:
        return [Said("point_mass", {"name": name, "mass": 0.5, "at": b}),
                Said("distance", {"name": f"J{i + 1}", "k": parent, "l": name, "at_k": a, "at_l": b})]
    ends[name] = b
    return [body(draw, name, a, b, planar), joint(draw, f"J{i + 1}", parent, name, a, b, planar, T, kinds)]


def _tree(draw: Draw, planar: bool, T: float, most: int = 4, kinds: list[str] | None = None) -> tuple[list[Said], Any, list[str]]:
    ends: dict[str, Any] = {"ground": (0.0,) * (2 if planar else 3)}
    found = [a for i in range(draw(st.integers(1, most))) for a in draw(_limb(i, ends, planar, T, kinds))]
    return found, ends, [n for n in ends if n != "ground"]


@st.composite
def trees(draw: Draw) -> Story:
    """Open chains and trees with all joints."""
    planar, T = draw(st.booleans()), draw(st.sampled_from(ENDS))
    found, ends, names = _tree(draw, planar, T)
    if names:
        found += with_loads(draw, names, ends, planar, T)
    return told(draw, "tree", found, planar, T)


@st.composite
def loops(draw: Draw) -> Story:
    """Chains whose end is joined to the ground where it is: four-bars, five-bars, slider-cranks, and loops in space."""
    planar, T = draw(st.booleans()), draw(st.sampled_from(ENDS))
    found: list[Said] = []
    a: Any = (0.0, 0.0) if planar else (0.0, 0.0, 0.0)
    parent, ends = "ground", {}
    turn = 0
    for i in range(draw(st.integers(3, 4))):
        turn += draw(st.integers(1, 2)) if planar else draw(st.integers(1, 3))
        step = [(1.0, 0.0), (0.6, 0.8), (0.0, 1.0), (-0.6, 0.8), (-1.0, 0.0), (-0.6, -0.8), (0.0, -1.0), (0.6, -0.8)][turn % 8]
        step = step if planar else SPACE[turn % len(SPACE)]
        b = shifted(a, step, draw(st.sampled_from([0.4, 0.7, 1.0])))
        name = f"b{i + 1}"
        kinds = ["revolute"] if planar else IN_SPACE[i]
        found += [body(draw, name, a, b, planar), joint(draw, f"J{i + 1}", parent, name, a, b, planar, T, kinds, i > 0)]
        parent, ends[name], a = name, b, b
    closing = ["revolute", "revolute", "point_on_line", "distance"] if planar else ["spherical", "spherical", "distance"]
    last = draw(st.sampled_from(closing))
    args: dict[str, Any] = {"name": "close", "k": "ground", "l": parent}
    if last == "distance":
        found.append(Said(last, {**args, "at_k": shifted(a, PLANE[2] if planar else SPACE[2], 0.6), "at_l": a}))
    elif last == "point_on_line" and planar:
        found += [Said("rigid_body", {"name": "slider", "mass": 0.5, "inertia": 0.01, "at": a}),
                  Said("revolute", {"name": "pin", "k": parent, "l": "slider", "at": a}),
                  Said("prismatic", {"name": "close", "k": "ground", "l": "slider", "at": a, "axis": (1.0, 0.0)})]
    else:
        found.append(Said(last, {**args, "at": a}))
    found += with_loads(draw, list(ends), ends, planar, T)
    return told(draw, "loop", found, planar, T)


@st.composite
def couplings(draw: Draw) -> Story:
    """Gears, racks and sums of coordinates between joints of a tree."""
    planar, T = draw(st.booleans()), draw(st.sampled_from(ENDS))
    found, ends, names = _tree(draw, planar, T, 2, ["revolute", "revolute", "prismatic", "screw"][: 3 if planar else 4])
    found = coupled(draw, found, T)
    return told(draw, "coupling", found + with_loads(draw, names, ends, planar, T), planar, T)


@st.composite
def contacts(draw: Draw) -> Story:
    """Balls on floors and each other, pins in races."""
    planar, T = draw(st.booleans()), draw(st.sampled_from([0.3, 0.5]))
    loose = planar and draw(st.booleans())
    found = rattling(draw, T) if loose else touching(draw, planar, T)
    story = told(draw, "contact", found, planar, T, 1e-5).but(gravity=GRAVITY)
    return story.but(options={}) if "HHT" in str(story.options) or "Alpha" in str(story.options) else story


@st.composite
def controlled(draw: Draw) -> Story:
    """Trees whose joints are held by feedback, saturated or sampled."""
    planar, T = draw(st.booleans()), draw(st.sampled_from(ENDS))
    found, ends, names = _tree(draw, planar, T, 3, ["revolute", "revolute", "prismatic"])
    return told(draw, "control", fed(draw, found) + with_loads(draw, names, ends, planar, T), planar, T)


@st.composite
def beams(draw: Draw) -> Story:
    """Cantilevers, pendulums and free beams with a body at the tip, in the plane or in space."""
    planar, T = draw(st.booleans()), draw(st.sampled_from([0.3, 0.5]))
    section = Made("Section", {"EA": 2e3, "GA2": 8e2, "GA3": 8e2, "GJ": 2.0, "EI2": 3.0, "EI3": draw(st.sampled_from([3.0, 1.0])),
                               "mass_per_length": 1.0, "rotary_inertia": 1e-2, "damping": draw(st.sampled_from([0.02, 0.005]))})
    a: Any = (0.0, 0.0) if planar else (0.0, 0.0, 0.0)
    b: Any = (1.0, 0.0) if planar else (0.8, 0.6, 0.0)
    found = [Said("beam", {"name": "beam", "points": (a, b), "section": section, "elements": draw(st.integers(1, 3)),
                           "order": draw(st.sampled_from([2, 1, 3])), "axis2": (-0.6, 0.8, 0.0)})]
    found = [Said("beam", {k: v for k, v in found[0].args.items() if k != "axis2"})] if planar else found
    hold = draw(st.sampled_from(["weld", "revolute", "spherical", "free"]))
    if hold == "revolute":
        args: dict[str, Any] = {"name": "J", "k": "ground", "l": "beam", "at": a, "axis": axes(draw, planar)}
        _options(draw, args, "revolute", T, True)
        args = {key: v for key, v in args.items() if key not in ("limits", "stop", "friction", "normal_force", "radius")}
        found.append(Said("revolute", args))
    elif hold != "free":
        found.append(Said(hold, {"name": "J", "k": "ground", "l": "beam", "at": a}))
    if maybe(draw, 2):
        tip = {"name": "tip", "mass": 0.3, "inertia": 0.01 if planar else (0.01, 0.02, 0.03), "at": b}
        found += [Said("rigid_body", tip), Said("weld", {"name": "W", "k": "beam", "l": "tip", "at": b})]
    value = Along(draw(loads(T, 2.0)), (*draw(directions(planar)), 0.0)[:3])
    if draw(st.booleans()):
        found.append(Said("force", {"name": "F", "body": "beam", "value": value, "at": b}))
    else:
        found.append(Said("line_load", {"name": "q", "beam": "beam", "per_length": value}))
    way = draw(st.sampled_from(BEAM_WAYS))
    model = draw(st.sampled_from(["", "", "classical"])) if hold == "revolute" else ""
    accuracy = draw(st.sampled_from([1e-4, 1e-3, 1e-5]))
    space = "auto" if planar else "spatial"  # elements in space differ from those in the plane until they are many
    return Story("beam", tuple(found), T, accuracy, gravity(draw, planar), space, model, way)


FAMILIES = {"tree": trees(), "loop": loops(), "coupling": couplings(), "contact": contacts(), "control": controlled(),
            "beam": beams()}


def stories(*families: str) -> st.SearchStrategy[Story]:
    """Scenes of some families, by default of all."""
    return st.one_of([FAMILIES[name] for name in families or FAMILIES])
