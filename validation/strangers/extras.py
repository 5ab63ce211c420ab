"""What drawn trees get besides: couplings, feedback, and scenes of contact."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st
from strangers.inputs import loads
from strangers.story import Along, Feed, Input, Made, Said, Sampled

Draw = Any
WORD = {"revolute": "angle", "prismatic": "displacement", "screw": "angle"}
HELD = ("angle", "position", "angle0", "position0", "limits", "stop")


def coupled(draw: Draw, found: list[Said], T: float) -> list[Said]:
    """A wheel beside the tree whose turn, or a rack whose way, is coupled to a joint of it."""
    joints = [a for a in found if a.verb in WORD and not any(key in a.args for key in HELD)]
    if not joints:
        i = next(i for i, a in enumerate(found) if a.verb in WORD)
        joints = [Said(found[i].verb, {k: v for k, v in found[i].args.items() if k not in HELD})]
        found = [*found[:i], *joints, *found[i + 1 :]]
    one = draw(st.sampled_from(joints))
    spatial = any(a.verb in ("rigid_body", "link") and len(a.args.get("at", a.args.get("points", [()])[0])) == 3 for a in found)
    at = (2.0, 0.0, 0.0) if spatial else (2.0, 0.0)
    size = (0.02, 0.03, 0.04) if spatial else 0.02
    wheel = Said("rigid_body", {"name": "wheel", "mass": 1.0, "inertia": size, "at": at})
    turns = Said("revolute", {"name": "A", "k": "ground", "l": "wheel", "at": at, "axis": (0, 0, 1)})
    slides = Said("prismatic", {"name": "A", "k": "ground", "l": "wheel", "at": at, "axis": (0.0, 1.0, 0.0)[: len(at)]})
    ratio = draw(st.sampled_from([-2.0, 0.5, 3.0]))
    if one.verb == "prismatic":
        return [*found, wheel, turns, Said("rack", {"name": "C", "pinion": "A", "rack": one.name, "radius": 0.1 * ratio})]
    kind = draw(st.sampled_from(["gear", "rack", "couple"]))
    if kind == "gear":
        return [*found, wheel, turns, Said("gear", {"name": "C", "driving": one.name, "driven": "A", "ratio": ratio})]
    if kind == "rack":
        return [*found, wheel, slides, Said("rack", {"name": "C", "pinion": one.name, "rack": "A", "radius": 0.1 * ratio})]
    of = {f"{one.name}.angle": 2.0, "A.angle": ratio}
    return [*found, wheel, turns.but(torque=draw(loads(T, 1.0))), Said("couple", {"name": "C", "of": of})]


def fed(draw: Draw, found: list[Said]) -> list[Said]:
    """One joint gets feedback: smooth, limited, or sampled."""
    i = draw(st.sampled_from([i for i, a in enumerate(found) if a.verb in ("revolute", "prismatic")]))
    kept = ("name", "k", "l", "at", "axis", "spring", "damper", "rate0")
    a = Said(found[i].verb, {key: v for key, v in found[i].args.items() if key in kept})
    coordinate = WORD[a.verb]
    load = "torque" if a.verb == "revolute" else "force"
    gain, rate_gain, target = (draw(st.sampled_from(some)) for some in ([20.0, 60.0], [2.0, 0.5], [0.3, -0.5]))
    kind = draw(st.sampled_from(["smooth", "limited", "sampled"]))
    if kind == "sampled":
        f = Made("Holding", {"gain": gain, "rate_gain": rate_gain, "target": target})
        every = draw(st.sampled_from([0.05, 0.02]))
        control = Said("controller", {"name": "hold", "f": f, "every": every,
                                      "reads": (f"{a.name}.{coordinate}", f"{a.name}.rate"), "sets": ("u",)})
        return [*found[:i], control, a.but(**{load: Sampled("u")}), *found[i + 1 :]]
    limit = None if kind == "smooth" else draw(st.sampled_from([3.0, 0.5]))
    feed = Feed(a.name, coordinate, "rate", gain, rate_gain, target, limit)
    return [*found[:i], a.but(**{load: feed}), *found[i + 1 :]]


def _laws(draw: Draw) -> dict[str, Any]:
    normal = Made("Hertz", {"stiffness": draw(st.sampled_from([1e7, 3e6, 1e8])), "damping": draw(st.sampled_from([0.0, 0.3]))})
    friction = draw(st.sampled_from([None, Made("Coulomb", {"mu": 0.3, "v_c": 0.05})]))
    return {"normal": normal, "friction": friction}


def touching(draw: Draw, planar: bool, T: float) -> list[Said]:
    """One or two balls that fall on a plane, on a plank with a hinge, or on each other."""
    def at(x: float, y: float) -> tuple[float, ...]:
        return (x, y) if planar else (x, y, 0.1)

    size: Any = 0.004 if planar else (0.004, 0.004, 0.004)
    found, floor = [], "ground"
    normal = draw(st.sampled_from([(0.0, 1.0), (0.28, 0.96)]))
    if draw(st.booleans()):
        floor = "plank"
        found = [Said("rigid_body", {"name": floor, "mass": 2.0, "inertia": 0.2 if planar else (0.2, 0.1, 0.2), "at": at(0, 0)}),
                 Said("revolute", {"name": "hinge", "k": "ground", "l": floor, "at": at(-0.5, 0), "axis": (0, 0, 1),
                                   "spring": 200.0, "damper": 1.0})]
    fast = draw(st.sampled_from([0.0, 1.0, -2.0]))
    high = draw(st.sampled_from([0.12, 0.3]))
    plane = Made("Plane", {"at": at(0, 0), "normal": normal if planar else (*normal, 0.0)})
    for i in range(draw(st.integers(1, 2))):
        name, where = f"ball{i + 1}", at(0.3 * i, high + 0.25 * i)
        args = {"name": name, "mass": 1.0, "inertia": size, "at": where}
        if fast:
            args["velocity"] = at(fast, 0.0) if planar else (fast, 0.0, 0.5)
            if not planar:
                args["angular_velocity"] = (3.0, 1.0, -8.0)
        found.append(Said("rigid_body", args))
        shape = Made("Sphere", {"at": where, "radius": 0.1})
        touch = {"name": f"C{i + 1}", "k": floor, "l": name, "shape_k": plane, "shape_l": shape}
        found.append(Said("contact", {**touch, **_laws(draw)}))
        if i:
            first = next(a for a in found if a.name == "ball1").args["at"]
            one = Made("Sphere", {"at": first, "radius": 0.1})
            touch = {"name": "CC", "k": "ball1", "l": name, "shape_k": one, "shape_l": shape}
            found.append(Said("contact", {**touch, **_laws(draw)}))
    if draw(st.booleans()):
        found.append(Said("force", {"name": "F", "body": "ball1", "value": Along(draw(loads(T, 8.0)), (0.6, 0.8, 0.0))}))
    return found


def rattling(draw: Draw, T: float) -> list[Said]:
    """A pendulum or a crank with a rod, one of whose pins has play."""
    play = draw(st.sampled_from([1e-2, 1e-3]))
    model = Made("Clearance", {"outer": 0.05 + play, "inner": 0.05, **_laws(draw)})
    found = [Said("link", {"name": "b1", "points": ((0.0, 0.0), (0.6, 0.8)), "mass": 1.0})]
    if draw(st.booleans()):
        load: Input = draw(loads(T, 3.0))
        return [*found, Said("revolute", {"name": "J", "k": "ground", "l": "b1", "at": (0.0, 0.0), "model": model}),
                Said("torque", {"name": "M", "body": "b1", "value": Along(load, (0.0, 0.0, 1.0))})]
    return [*found, Said("link", {"name": "b2", "points": ((0.6, 0.8), (1.4, 0.2)), "mass": 0.5}),
            Said("revolute", {"name": "A", "k": "ground", "l": "b1", "at": (0.0, 0.0), "rate0": 2.0}),
            Said("revolute", {"name": "J", "k": "b1", "l": "b2", "at": (0.6, 0.8), "model": model})]
