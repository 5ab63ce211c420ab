"""URDF into a scene: yourdfpy reads the file, this module says what it means. What the parser would assume in silence, such as
missing moments of inertia, is refused before."""

from __future__ import annotations

import copy
import io
import logging
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.errors import OptionError, SceneError
from mbdae.robots import EXTRA, GROUND, Joint, Link, Pose, Robot, build, library
from mbdae.robots.bounds import bounds_of, parsed, text_of
from mbdae.robots.couplings import satisfied
from mbdae.scene.components import Stop

KINDS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed", "floating": "free",
         "planar": "planar"}
#: attributes that the parser replaces by values of its own where they are missing
NEEDED = {"inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "mass": ("value",), "joint": ("name", "type"), "link": ("name",),
          "parent": ("link",), "child": ("link",), "mimic": ("joint",), "box": ("size",), "cylinder": ("radius", "length"),
          "sphere": ("radius",), "mesh": ("filename",)}
NUMBERS = {"inertia": (*NEEDED["inertia"],), "mass": ("value",), "mimic": ("multiplier", "offset"),
           "limit": ("lower", "upper", "effort", "velocity"), "dynamics": ("damping", "friction"),
           "cylinder": ("radius", "length"), "sphere": ("radius",)}
TRIPLES = {"origin": ("xyz", "rpy"), "axis": ("xyz",), "box": ("size",), "mesh": ("scale",)}
#: attributes that are read; of others the scene says that they are not
READ = {"robot": ("name",), "link": ("name",), "joint": ("name", "type"), "origin": ("xyz", "rpy"), "axis": ("xyz",),
        "mass": ("value",), "inertia": NUMBERS["inertia"], "limit": ("lower", "upper", "effort"), "dynamics": NUMBERS["dynamics"],
        "mimic": ("joint", *NUMBERS["mimic"]), "parent": ("link",), "child": ("link",), "inertial": (), "geometry": (),
        "visual": ("name",), "box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",),
        "mesh": ("filename", "scale")}
#: elements that others have; of any further one the scene says that it is not read
INSIDE = {"link": ("inertial", "visual", "collision"), "inertial": ("origin", "mass", "inertia"),
          "visual": ("origin", "geometry", "material"), "geometry": ("box", "cylinder", "sphere", "mesh"),
          "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic")}
ONCE = ("inertial", "mass", "inertia", "origin", "axis", "limit", "dynamics", "mimic", "parent", "child", "geometry")
UNREAD = {"transmission": "transmissions", "gazebo": "what it says to Gazebo", "sensor": "sensors"}


def read(make: Any, path: Any, floating: bool, gravity: Any, packages: Any, keep: bool, limits: bool, stop: Any,
         meshes: bool) -> Any:
    """The scene of a URDF file; arguments as of `mb.read_urdf`, make: the class of scenes."""
    yourdfpy = library("yourdfpy", "reading URDF")
    found, data = text_of(path, "read_urdf")
    root = parsed(data, found.name, "robot")
    strange = next((e for e in root.iter() if isinstance(e.tag, str) and e.tag.startswith("{")), None)
    if strange is not None:
        name = f"{strange.prefix}:{strange.tag.partition('}')[2]}"
        raise OptionError(f"{found.name}, line {strange.sourceline}: <{name}> is no URDF; let xacro, or whatever reads it, write "
                          f"the URDF file first")
    wrong = _mistakes(root)
    if wrong:
        raise SceneError([f"{found.name}: {text}" for text in wrong])
    raw = _raw(yourdfpy, root, found.name)
    robot = Robot(raw.name or found.stem)
    _named(robot, raw, floating)
    _links(robot, raw, found, packages, meshes)
    _joints(robot, raw, limits, stop)
    for tag in dict.fromkeys(e.tag for e in root if e.tag not in ("link", "joint", "material")):
        what = UNREAD.get(tag, "elements that are none of URDF")
        robot.told.append(f"{what} ({len(root.findall(tag))} <{tag}>) are not read")
    said = [e for e in root.iter(*READ) if not any(a.tag in (*UNREAD, "collision") for a in e.iterancestors())]
    unread = {f"{key} of <{e.tag}>": None for e in said for key in e.attrib if key not in READ[e.tag]}
    unread |= {f"<{child.tag}> of <{e.tag}>": None for e in said for child in e if child.tag not in INSIDE.get(e.tag, ())
               and e is not root}
    if unread:
        robot.told.append(f"not read: {', '.join(unread)}")
    if any(link.find("collision") is not None for link in root.findall("link")):
        robot.told.append("shapes for collisions are not read: state contacts by s.contact")
    _root(robot, raw, floating)
    return build(make, robot, gravity, keep)


def _raw(yourdfpy: Any, root: Any, name: str) -> Any:
    """The robot as the parser sees it, who stops at shapes that it does not know: they are no more read than those for
    collisions."""
    root = copy.deepcopy(root)
    for shown in list(root.iter("visual", "collision")):
        if shown.tag == "collision" or any(shape.tag not in INSIDE["geometry"] for shape in shown.find("geometry")):
            shown.getparent().remove(shown)
    etree = library("lxml.etree", "reading URDF")
    logger = logging.getLogger("yourdfpy.urdf")
    before, logger.disabled = logger.disabled, True
    try:
        return yourdfpy.URDF.load(io.BytesIO(etree.tostring(root)), build_scene_graph=False, load_meshes=False,
                                  load_collision_meshes=False, build_collision_scene_graph=False).robot
    except Exception as error:  # whatever its parser meets in a damaged file
        raise OptionError(f"{name}: no URDF: {type(error).__name__}: {error}") from error
    finally:
        logger.disabled = before


def _mistakes(root: Any) -> list[str]:
    """Attributes that are missing, or are no numbers."""
    wrong = []
    for element in root.iter():
        tag = element.tag
        if not isinstance(tag, str) or any(a.tag in UNREAD for a in (element, *element.iterancestors())):
            continue
        where = f"line {element.sourceline}: <{tag}>"
        wrong += [f"{where} has no {key}" for key in NEEDED.get(tag, ()) if tag != "joint" or element.getparent() is root
                  if key not in element.attrib]
        wrong += [f"{where}: {key} = {element.get(key)!r} is no finite number" for key in NUMBERS.get(tag, ())
                  if key in element.attrib and _numbers(element.get(key), 1) is None]
        wrong += [f"{where}: {key} = {element.get(key)!r} is not three finite numbers" for key in TRIPLES.get(tag, ())
                  if key in element.attrib and _numbers(element.get(key), 3) is None]
        twice = [one for one in ONCE if len(element.findall(one)) > 1]
        wrong += [f"{where} has more than one <{one}>" for one in twice]
        if "quat_xyzw" in element.attrib:
            wrong.append(f"{where}: quat_xyzw is not read; state rpy")
        if tag == "inertial" and (element.find("mass") is None or element.find("inertia") is None):
            wrong.append(f"{where} needs <mass> and <inertia>")
        if tag == "joint" and element.getparent() is root and (element.find("parent") is None or element.find("child") is None):
            wrong.append(f"{where} needs <parent> and <child>")
        if tag in ("visual", "collision") and (element.find("geometry") is None or not len(element.find("geometry"))):
            wrong.append(f"{where} has no <geometry> with a shape")
    return wrong


def _numbers(text: str, count: int) -> list[float] | None:
    try:
        found = [float(part) for part in text.split()]
    except ValueError:
        return None
    return found if len(found) == count and all(map(math.isfinite, found)) and "_" not in text else None


def _pose(matrix: Any) -> Pose:
    return Pose() if matrix is None else Pose(np.array(matrix[:3, :3]), np.array(matrix[:3, 3]))


def _named(robot: Robot, raw: Any, floating: bool) -> None:
    """Give items names of their own: links and joints may share theirs in URDF, and have that of the ground."""
    if floating or GROUND in {one.child for one in raw.joints}:  # else it is held on the ground, and a frame there
        for link in (link for link in raw.links if link.name == GROUND):
            link.name = robot.own_name(GROUND, "link")
            for one in raw.joints:
                one.parent, one.child = (link.name if name == GROUND else name for name in (one.parent, one.child))
    links = {link.name for link in raw.links}
    names = {name: robot.own_name(name, "joint", links) for name in dict.fromkeys(one.name for one in raw.joints)}
    for one in raw.joints:
        one.name = names[one.name]
        if one.mimic is not None:
            one.mimic.joint = names.get(one.mimic.joint, one.mimic.joint)


def _links(robot: Robot, raw: Any, path: Path, packages: Any, meshes: bool) -> None:
    undrawn = []
    for one in raw.links:
        if one.name in robot.links:
            raise SceneError([f"{path.name}: two links have the name '{one.name}'; give each its own"])
        made = robot.links[one.name] = Link(one.name)
        if one.inertial is not None:
            frame = _pose(one.inertial.origin)
            made.mass, made.centre = float(one.inertial.mass), frame.p
            made.inertia = frame.R @ one.inertial.inertia @ frame.R.T
            made.inertia = (made.inertia + made.inertia.T) / 2
        for visual in one.visuals:
            shape = _drawn(visual, path, packages, meshes)
            if shape is not None:
                made.shapes.append(shape)
            elif meshes:
                undrawn.append(f"'{visual.geometry.mesh.filename}'")
    if undrawn:
        robot.told.append(f"meshes that were not found inside of their package, or that trimesh does not read, are not drawn: "
                          f"{', '.join(dict.fromkeys(undrawn))}")


def _drawn(visual: Any, path: Path, packages: Any, meshes: bool) -> Any:
    """A shape for pictures; a mesh as the box about it."""
    pose, g = _pose(visual.origin), visual.geometry
    sizes = [*(g.box.size if g.box is not None else ())]
    if g.box is not None:
        return ("box", pose, tuple(float(x) for x in sizes)) if min(sizes) > 0 else None
    if g.cylinder is not None:
        radius, length = float(g.cylinder.radius), float(g.cylinder.length)
        return ("cylinder", pose, (radius, length)) if min(radius, length) > 0 else None
    if g.sphere is not None:
        return ("sphere", pose, (float(g.sphere.radius),)) if g.sphere.radius > 0 else None
    file = resolved(g.mesh.filename, path, packages) if meshes else None
    box = None if file is None else bounds_of(file, g.mesh.scale)
    return None if box is None else ("box", pose @ Pose(p=box[0]), tuple(float(x) for x in box[1]))


def resolved(name: str, path: Path, packages: Any) -> Path | None:
    """The file of a mesh, inside of its package or of the folder of the robot's file; None where it is not."""
    if name.startswith("package://"):
        package, _, rest = name.removeprefix("package://").partition("/")
        given = packages.get(package) if isinstance(packages, Mapping) else None
        folders = [Path(given)] if given is not None else [
            *(Path(folder) / package for folder in (packages if isinstance(packages, list | tuple) else ())),
            *(up for up in path.resolve().parents if up.name == package), *(up / package for up in path.resolve().parents)]
    elif "://" in name and not name.startswith("file://"):
        return None
    else:
        folders, rest = [path.resolve().parent], name.removeprefix("file://")
    for folder in folders:
        file = (folder / rest).resolve()
        if file.is_file() and (file.is_relative_to(folder.resolve()) or file.is_relative_to(path.resolve().parent.parent)):
            return file
    return None


def _joints(robot: Robot, raw: Any, limits: bool, stop: Any) -> None:
    wrong: list[str] = []
    children: dict[str, str] = {}
    names: set[str] = set()
    for one in raw.joints:
        head = f"joint '{one.name}'"
        wrong += [f"{head}: there is no link '{link}'" for link in (one.parent, one.child) if link not in robot.links]
        if one.type not in KINDS:
            wrong.append(f"{head}: its type '{one.type}' is none of {', '.join(KINDS)}")
        if one.name in names:
            wrong.append(f"two joints have the name '{one.name}'; give each its own")
        if one.child in children:
            wrong.append(f"{head}: link '{one.child}' is already the child of joint '{children[one.child]}': URDF says trees")
        names.add(one.name)
        children.setdefault(one.child, one.name)
    scalar = {one.name for one in raw.joints if one.type in ("revolute", "continuous", "prismatic")}
    fixed = {one.name for one in raw.joints if one.type == "fixed"}
    mimics = {one.name: one.mimic for one in raw.joints if one.mimic is not None and one.name not in fixed}
    for one in raw.joints:
        if one.name in mimics and one.mimic.joint in fixed and not one.mimic.offset:
            robot.told.append(f"{f'joint {one.name!r}'}: it mimics the fixed joint '{one.mimic.joint}', so it is fixed too")
            one.type = "fixed"
            del mimics[one.name]
    wrong += [f"joint '{name}': it mimics '{m.joint}', which is no joint with one coordinate" for name, m in mimics.items()
              if m.joint not in scalar or name not in scalar or m.joint == name]
    for name in mimics:
        at, seen = name, list[str]()
        while at in mimics and at not in seen:
            seen.append(at)
            at = mimics[at].joint
        if at == name and len(seen) > 1:
            wrong.append(f"joint '{name}': {', '.join(map(repr, seen))} mimic each other in a circle")
    if wrong:
        raise SceneError(wrong)
    for one in _outwards(robot, raw.joints):
        robot.joints.append(_one(robot, one, None if one.name in mimics and limits else limits, stop))
    _mimics(robot, mimics)


def _one(robot: Robot, one: Any, limits: bool | None, stop: Any) -> Joint:
    """A joint; limits: whether they are wanted, None: of one that mimics another, which has its own."""
    made = Joint(one.name, KINDS[one.type], one.parent, one.child, _pose(one.origin), axis=np.array(one.axis, dtype=float))
    if one.dynamics is not None:
        made.damping, made.friction = float(one.dynamics.damping or 0), float(one.dynamics.friction or 0)
        if made.friction and one.type not in ("revolute", "continuous", "prismatic"):
            robot.told.append(f"joint '{one.name}': friction of a {one.type} joint is not read")
    if one.type in ("planar", "floating") and made.damping:
        robot.told.append(f"joint '{one.name}': its damping of {made.damping:g} acts on displacements (N s/m) and rotations "
                          f"(N m s/rad) alike")
    if one.limit is not None and (one.limit.lower or one.limit.upper) and (
            limits is None or one.type in ("planar", "floating", "continuous")):
        robot.told.append(f"joint '{one.name}': limits of a {'mimic' if limits is None else one.type} joint are not read")
    if one.type in ("revolute", "prismatic"):
        made.effort = float((one.limit.effort if one.limit else 0) or 0)
        if one.limit is not None and one.limit.effort == 0:
            robot.told.append(f"joint '{one.name}': effort=\"0\" of its limit counts as not stated")
        if one.limit is None:
            robot.told.append(f"joint '{one.name}': it states no limits; none were made")
        elif limits:
            low, high = float(one.limit.lower or 0), float(one.limit.upper or 0)
            if low >= high:
                raise SceneError([f"joint '{one.name}': its lower limit {low:g} is not below the upper one, {high:g}; make it a "
                                  f"fixed joint, or pass limits=False"])
            made.limits, made.stop = (low, high), stop
    return made


def _outwards(robot: Robot, joints: list[Any]) -> list[Any]:
    """Joints in the order of the file, those that carry others first; links likewise."""
    by_child, done, order = {j.child: j for j in joints}, dict[str, Any](), list[Any]()
    for joint in joints:
        way = []
        at = joint
        while at is not None and at.name not in done:
            way.append(at)
            if len(way) > len(joints):
                raise SceneError([f"joint '{joint.name}': its links are carried in a circle; URDF says trees"])
            at = by_child.get(at.parent)
        for one in reversed(way):
            done[one.name] = one
            order.append(one)
    roots = [name for name in robot.links if name not in by_child]
    robot.links = {name: robot.links[name] for name in (*roots, *(j.child for j in order))}
    return order


def _mimics(robot: Robot, mimics: dict[str, Any]) -> None:
    joints = {j.name: j for j in robot.joints}
    satisfied(robot, [(name, [(name, 1.0), (of.joint, -float(of.multiplier))], float(of.offset)) for name, of in mimics.items()],
              None, 0.0)
    for name, mimic in mimics.items():
        joint, of, factor, offset = joints[name], joints[mimic.joint], float(mimic.multiplier), float(mimic.offset)
        one, other = (f"{j.name}.{'angle' if j.kind == 'revolute' else 'displacement'}" for j in (joint, of))

        def tie(s: Any, _: Any, name: str = name, one: str = one, other: str = other, factor: float = factor,
                offset: float = offset) -> Any:
            return s.couple(f"{name} mimics {other.rpartition('.')[0]}", {one: 1.0, other: -factor}, offset)

        robot.closing.append(tie)


def _root(robot: Robot, raw: Any, floating: bool) -> None:
    """Hold the root link on the ground, or let it float with the mass that is fixed to it."""
    carried = {j.child for j in robot.joints}
    roots = [name for name in robot.links if name not in carried]
    if len(roots) != 1:
        raise SceneError([f"robot '{robot.name}' has {len(roots)} root links ({', '.join(map(repr, roots)) or 'none'}): one is "
                          f"needed that carries all others"])
    root = robot.links[roots[0]]
    if not floating:
        name = f"{root.name} on the ground"
        robot.joints.insert(0, Joint(name, "fixed", "", root.name))
        return
    poses = {root.name: Pose()}
    for joint in robot.joints:
        if joint.kind == "fixed" and joint.parent in poses:
            poses[joint.child] = poses[joint.parent] @ joint.pose
    heavy = next((robot.links[name] for name in poses if robot.links[name].mass > 0), None)
    if heavy is None:
        raise SceneError([f"floating=True: root link '{root.name}' and what is fixed to it have no mass; state one, or "
                          f"floating=False"])
    if heavy is not root:  # one body: the root, with the mass and the shapes of the link that is fixed to it
        pose = poses[heavy.name]
        root.mass, root.centre, root.inertia = heavy.mass, pose.point(heavy.centre), pose.R @ heavy.inertia @ pose.R.T
        root.shapes += [(kind, pose @ at, size) for kind, at, size in heavy.shapes]
        heavy.mass, heavy.inertia, heavy.shapes = 0.0, np.zeros((3, 3)), []


def options(stop: Any) -> Any:
    """Check the stop of all limits."""
    if stop is not None and not isinstance(stop, Stop):
        raise OptionError(f"stop = {stop!r}: give mb.Stop(stiffness, damping), or None; {EXTRA} reads files")
    return stop
