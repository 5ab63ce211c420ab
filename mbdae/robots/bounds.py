"""Files of robots, read with bounds: no entities, no network, nothing outside of the folders that were given, nothing that grows
beyond reason; MuJoCo kept from writing of its own accord, and asked what it makes of a model."""

from __future__ import annotations

import ctypes
import math
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.errors import OptionError, SceneError
from mbdae.robots import Pose, library
from mbdae.scene.shapes import Box, Cylinder, Shape, Sphere

#: bytes of a file of XML, of a mesh, and how many elements one may have and how deep
LARGEST, LARGEST_MESH, MOST_ELEMENTS, DEEPEST = 32_000_000, 256_000_000, 200_000, 1000
ENCODINGS = ("utf-8", "us-ascii", "ascii", "iso-8859-1", "latin-1")
MESHES = (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf", ".off")  #: formats that are drawn
SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = 2, 3, 4, 5, 6, 7  #: of MuJoCo's geoms
MOST_INCLUDED = 100  #: files that a model may include
#: elements of a model with all copies, and pixels along an edge of a picture: MuJoCo itself grows without bounds
MOST_MADE, MOST_ALONG = 10_000, 8192
#: largest numbers (of several, their product) that lists and copies are made by: of an attribute, of one element, or of any
MOST: dict[Any, int] = {("replicate", "count"): MOST_MADE, ("composite", "count"): MOST_MADE, ("flexcomp", "count"): MOST_MADE,
                        "width": MOST_ALONG, "height": MOST_ALONG, "nrow": MOST_ALONG, "ncol": MOST_ALONG, "nsample": 10_000,
                        "actdim": 1000, ("numeric", "size"): 1_000_000, "nkey": 10_000, "nuserdata": 1_000_000}
MOST_USER = 1000  #: numbers of its user that an element has (nuser_...)
GROWING = ("composite", "flexcomp")
FREE, BALL, SLIDE, HINGE = range(4)  #: MuJoCo's kinds of joints
DOFS = {FREE: 6, BALL: 3, SLIDE: 1, HINGE: 1}  #: numbers of a joint in qvel
SAME, ROUND = 1e-6, 1e-11  #: difference of momenta and forces up to which they are the same, over them and over the largest
DIGITS = 17  #: of numbers in the file: all of them


def text_of(path: Any, what: str) -> tuple[Path, bytes]:
    """A file as bytes, which are XML in UTF-8 without declarations of types and entities."""
    try:
        found = Path(path)
    except TypeError as error:
        raise OptionError(f"{what}: path = {path!r} is no path of a file") from error
    if not found.is_file():
        raise OptionError(f"{what}: there is no file {str(found)!r}")
    size = found.stat().st_size
    if size > LARGEST:
        raise OptionError(f"{what}: {found.name} has {size} bytes, more than the {LARGEST} that are read")
    data = found.read_bytes()
    return found, clean(data, found.name)


def clean(data: bytes, name: str) -> bytes:
    """The bytes as they are, after checks; OptionError where they may hide something from these."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    declared = re.match(rb"\s*<\?xml[^>]*encoding\s*=\s*[\"']([^\"']*)[\"']", data[:400])
    encoding = declared.group(1).decode("ascii", "replace").lower() if declared else "utf-8"
    if encoding not in ENCODINGS or b"\0" in data:
        raise OptionError(f"{name}: its encoding is not UTF-8; save it as UTF-8")
    if encoding == "utf-8":
        try:
            data.decode()
        except UnicodeDecodeError as error:
            raise OptionError(f"{name}: byte {error.start} is no UTF-8; save the file as UTF-8") from error
    if re.search(rb"<!\s*(DOCTYPE|ENTITY)", data, re.IGNORECASE):
        raise OptionError(f"{name}: it declares types or entities (<!DOCTYPE, <!ENTITY), which are not read; remove them")
    return data


def parsed(data: bytes, name: str, root: str) -> Any:
    """The root element of XML, without comments; OptionError with the place of the mistake."""
    etree = library("lxml.etree", f"reading {name}")
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=True, remove_comments=True,
                             remove_pis=True, recover=False)
    try:
        found = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise OptionError(f"{name}: no XML: {error}") from error
    if found.tag != root:
        raise OptionError(f"{name}: its outermost element is <{found.tag}>; <{root}> is needed")
    count = 0
    stack = [(found, 1)]
    while stack:
        element, depth = stack.pop()
        count += 1
        if depth > DEEPEST or count > MOST_ELEMENTS:
            raise OptionError(f"{name}: more than {MOST_ELEMENTS} elements, or more than {DEEPEST} inside each other")
        stack += [(child, depth + 1) for child in element]
    return found


def bounds_of(path: Path, scale: Any) -> Any:
    """Middle and edges (2, 3), m, of the box about a mesh; None where it cannot be read."""
    trimesh = library("trimesh", "drawing meshes")
    if not path.is_file() or path.stat().st_size > LARGEST_MESH or path.suffix.lower() not in MESHES:
        return None
    try:
        found = np.asarray(trimesh.load_scene(str(path), allow_remote=False).bounds, dtype=float)
    except Exception:  # a picture alone: what a mesh reader raises depends on the format
        return None
    if found.shape != (2, 3) or not np.all(np.isfinite(found)):
        return None
    found = np.sort(found * np.asarray(1.0 if scale is None else scale), axis=0)
    return np.array([found.mean(axis=0), np.maximum(found[1] - found[0], 1e-9)])


class Files:
    """What a model and the files that it names come to, found before MuJoCo reads them: no plugins, nothing from elsewhere than
    the folders around the model, nothing beyond reason."""

    def __init__(self, path: Path, above: tuple[Path, ...] = ()) -> None:
        self.path, self.above, self.around = path, above, (*above, path)[0].parent.parent
        self.count = self.files = self.attached = self.largest = 0
        self.named: list[tuple[Path, str, str]] = []
        self.folders = {""}

    def check(self, root: Any) -> int:
        """Elements of the model, with copies and attached ones; OptionError where that or a named file is beyond bounds."""
        self._walk(root, self.path, 1, (*self.above, self.path))
        for folder, name, where in self.named:
            for base in {folder, self.path.parent}:
                for file in {base / inside / one for inside in self.folders for one in (name, Path(name).name)}:
                    if os.path.lexists(file) and not self._fits(file):
                        raise OptionError(f"{where}: {name!r} is no file in the folder of the model or beside it, or too large")
        return self.count + self.attached * self.largest

    def _fits(self, file: Path) -> bool:
        found = file.resolve()
        if not found.is_file():
            return file.is_dir()
        head = found.open("rb").read(24) if found.stat().st_size <= LARGEST_MESH and found.is_relative_to(self.around) else None
        width = [0, 0] if not head or head[:4] != b"\x89PNG" else [int.from_bytes(head[i : i + 4]) for i in (16, 20)]
        return head is not None and max(width) <= MOST_ALONG

    def _walk(self, root: Any, path: Path, times: int, above: tuple[Path, ...]) -> None:
        stack = [(root, times)]
        while stack:
            element, n = stack.pop()
            tag, where = element.tag, f"{path.name}, line {element.sourceline}"
            if tag in ("plugin", "extension"):
                raise OptionError(f"{where}: plugins are code, which is not run; remove <{tag}>")
            many = 1
            for key, value in element.attrib.items():
                if "://" in value:
                    raise OptionError(f"{where}: {value!r} is no file of this machine; nothing is fetched")
                if key not in ("name", "class") and re.search(r"(?i)(?<![\w.-])[-+]?(nan|inf|infinity)(?![\w.-])", value):
                    raise OptionError(f"{where}: {key} = {value!r} is no finite number")
                if (most := MOST_USER if key.startswith("nuser_") else MOST.get((tag, key), MOST.get(key))) is not None:
                    many *= _product(value, most, f"{where}: {key}")
                if key.endswith("dir"):
                    self.folders.add(value)
                elif key.startswith("file") and tag not in ("include", "model"):
                    self.named.append((path.parent, value, where))
            self.count += n * (many if tag in GROWING else 1)
            self.attached += n * (tag == "attach")
            if tag == "include" or (tag == "model" and "file" in element.attrib):
                self._further(element.get("file", ""), tag, path, n, above, where)
            if self.count > MOST_MADE:
                raise OptionError(f"{where}: with all copies the model has more than {MOST_MADE} elements; state fewer")
            stack += [(child, n * many if tag == "replicate" else n) for child in element]

    def _further(self, name: str, tag: str, path: Path, times: int, above: tuple[Path, ...], where: str) -> None:
        """An included file, or a model that is attached."""
        file = next((f for f in ((base / name).resolve() for base in (path.parent, self.path.parent)) if f.is_file()), None)
        self.files += 1
        if file is None or not file.is_relative_to(self.around):
            raise OptionError(f"{where}: includes {name!r}, which is no file in the folder of the model or beside it")
        if file in above or self.files > MOST_INCLUDED:
            raise OptionError(f"{where}: {name!r} includes itself, or more than {MOST_INCLUDED} files are included")
        data = text_of(file, "read_mjcf")[1]
        root = parsed(data, file.name, "mujoco" if tag == "model" else _outermost(data))
        if tag == "include":
            self._walk(root, file, times, (*above, file))
        elif (size := Files(file, above).check(root)) > self.largest:
            self.largest = size


def _product(value: str, most: int, what: str) -> int:
    """Product of whole numbers; OptionError where one is none, or more than most."""
    parts = [1, *(int(part) if re.fullmatch(r"[-+]?\d{1,15}", part) else most + 1 for part in value.split())]
    if math.prod(max(1, n) for n in parts) > most:
        raise OptionError(f"{what} = {value!r}: whole numbers up to {most} are read")
    return math.prod(max(1, n) for n in parts)


def _outermost(data: bytes) -> str:
    """Name of the first element: an included file may begin with any of them."""
    found = re.search(rb"<\s*([A-Za-z_][\w.-]*)", re.sub(rb"<!--.*?-->|<\?.*?\?>", b"", data, flags=re.DOTALL))
    return found.group(1).decode() if found else "mujoco"


@contextmanager
def quiet() -> Iterator[None]:
    """MuJoCo writes warnings to the standard streams and a file in the working folder: both are kept away."""
    sys.stdout.flush()
    sys.stderr.flush()
    before, kept = Path.cwd(), [os.dup(1), os.dup(2)]
    with tempfile.TemporaryDirectory() as folder, open(os.devnull, "w") as nothing:
        try:
            os.chdir(folder)
            os.dup2(nothing.fileno(), 1)
            os.dup2(nothing.fileno(), 2)
            yield
        finally:
            os.dup2(kept[0], 1)
            os.dup2(kept[1], 2)
            for descriptor in kept:
                os.close(descriptor)
            os.chdir(before)


def compiled(mujoco: Any, path: Path) -> Any:
    """The model of a file as MuJoCo's compiler has it."""
    file = str(path.resolve())
    try:
        with quiet():
            return mujoco.MjModel.from_xml_path(file)
    except (ValueError, RuntimeError, mujoco.FatalError, MemoryError, UnicodeError) as error:
        said = " ".join(str(error).split())
        raise OptionError(f"{path.name}: MuJoCo does not compile it: {said}") from error


def name_of(model: Any, array: str, i: int) -> str:
    """Name of entry i of a compiled model, by the array of places of names; "names": of the model."""
    at = int(getattr(model, array)[i]) if array != "names" else 0
    return str(model.names[at : model.names.index(b"\0", at)].decode("utf-8", "replace"))


def picture_of(m: Any, g: int, pose: Pose) -> list[tuple[str, Pose, tuple[float, ...]]]:
    """The shape that is drawn for geom g of a compiled model, at its pose; a mesh as the box about it."""
    kind, size = int(m.geom_type[g]), [float(x) for x in m.geom_size[g]]
    if kind == SPHERE:
        return [("sphere", pose, (size[0],))]
    if kind in (CAPSULE, CYLINDER):
        return [("cylinder", pose, (size[0], 2 * size[1]))]
    if kind in (ELLIPSOID, BOX):
        return [("box", pose, tuple(2 * x for x in size))]
    if kind == MESH:
        middle, half = m.geom_aabb[g][:3], m.geom_aabb[g][3:]
        return [("box", pose @ Pose(p=np.array(middle)), tuple(max(2 * float(x), 1e-9) for x in half))]
    return []


def geom_of(mujoco: Any, shape: Shape) -> tuple[Any, list[float], Any] | None:
    """Kind and sizes of the geom of MuJoCo that is a shape, and its axes by columns; None where there is none."""
    kinds = mujoco.mjtGeom
    if isinstance(shape, Sphere):
        return kinds.mjGEOM_SPHERE, [shape.radius, 0, 0], np.eye(3)
    if isinstance(shape, Cylinder) and shape.length is not None:
        axis = np.asarray(shape.axis, dtype=float)
        x = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        R = np.column_stack([v / np.linalg.norm(v) for v in (x, np.cross(axis, x), axis)])
        return kinds.mjGEOM_CYLINDER, [shape.radius, shape.length / 2, 0], R
    if isinstance(shape, Box):
        R = np.eye(3) if shape.rotation is None else np.asarray(shape.rotation, dtype=float)
        return kinds.mjGEOM_BOX, [x / 2 for x in np.broadcast_to(shape.size, 3)], R
    return None


def add(j: Any, word: str, value: float) -> None:
    """Add to the damping or stiffness of a joint in a specification of MuJoCo: a number, in later versions a polynomial."""
    if np.ndim(found := getattr(j, word)):
        found[0] += value
    else:
        setattr(j, word, found + value)


def verify(reader: Any) -> None:
    """Compare what a reader of MJCF has read of masses, armature, springs and dampers with the momenta and forces that MuJoCo has
    at random velocities: what it does not know of, such as what a later version brings, is refused and not left out. Actuators
    that act without control, which are not read, are told."""
    mujoco, m, d, joints = reader.mujoco, reader.m, reader.data, {j.name: j for j in reader.robot.joints}
    flags = m.opt.disableflags
    v, momenta, jac = np.random.default_rng(0).uniform(0.5, 1, size=m.nv), np.zeros(m.nv), np.zeros((2, 3, m.nv))
    before, d.qvel[:], d.qpos[:] = d.qpos.copy(), v, reader.start
    m.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    mujoco.mj_fwdPosition(m, d)
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_mulM(m, d, momenta, v)
    expected, dampers, springs = np.zeros((3, m.nv))
    for b in range(1, m.nbody):
        link, R = reader.robot.links[reader.names[b]], d.xmat[b].reshape(3, 3)
        mujoco.mj_jacBodyCom(m, d, *jac, b)
        expected += link.mass * jac[0].T @ (jac[0] @ v) + jac[1].T @ R @ link.inertia @ R.T @ (jac[1] @ v)
    for i, kind in enumerate(map(int, m.jnt_type)):
        k, q = int(m.jnt_dofadr[i]), int(m.jnt_qposadr[i])
        dampers[k : k + DOFS[kind]] = -reader._damping(i) * v[k : k + DOFS[kind]]
        if kind in (SLIDE, HINGE):
            made = joints[reader.joint_names[i]]
            expected[k] += made.rotor * v[k]
            springs[k] = -made.spring * (d.qpos[q] - m.qpos0[q] - made.rest)
    wrong = []
    pairs = {"inertia": (momenta, expected), "damping": (d.qfrc_damper, dampers), "spring": (d.qfrc_spring, springs)}
    for what, (one, other) in pairs.items():
        for k in map(int, np.flatnonzero(abs(one - other) > SAME * abs(other) + ROUND * max(abs(other), default=0.0))):
            i = int(m.dof_jntid[k])
            if what != "spring" or int(m.jnt_type[i]) in (SLIDE, HINGE):  # of others `refuse` has told
                wrong.append(f"joint '{reader.joint_names[i]}': its {what} in MuJoCo gives {one[k]:.6g} where what is read "
                             f"gives {other[k]:.6g}; something else acts on it that is not modelled: remove it from the file")
    mujoco.mj_integratePos(m, d.qpos, v, 1.0)
    mujoco.mj_fwdPosition(m, d)
    mujoco.mj_fwdVelocity(m, d)
    mujoco.mj_fwdActuation(m, d)
    if acting := [name_of(m, "name_actuatoradr", i) or f"{i}" for i in map(int, np.flatnonzero(d.actuator_force))]:
        reader.robot.heard.append(f"actuators that act without control too, as springs and dampers do, are left out: "
                                  f"{', '.join(map(repr, acting))}; state spring=, rest= and damper= of their joints")
    m.opt.disableflags, d.qvel[:], d.qpos[:] = flags, 0, before
    mujoco.mj_kinematics(m, d)
    if wrong:
        raise SceneError(list(dict.fromkeys(wrong)))


def open_at(mujoco: Any, m: Any, q: Any, v: Any) -> dict[int, float]:
    """By how much the equalities of a compiled model that are active, by their numbers, are not satisfied at a state q, v: the
    largest of places (m, rad) and their rates."""
    d, found = mujoco.MjData(m), dict[int, float]()
    d.qpos[:], d.qvel[:] = q, v
    mujoco.mj_fwdPosition(m, d)
    mujoco.mj_fwdVelocity(m, d)
    for i in range(d.ne):
        e = int(d.efc_id[i])
        found[e] = max(found.get(e, 0.0), abs(float(d.efc_pos[i])), abs(float(d.efc_vel[i])))
    return found


@contextmanager
def all_digits(mujoco: Any) -> Iterator[None]:
    """MuJoCo writes numbers with 6 digits, unless its library is told otherwise."""
    found = next(iter(sorted(Path(mujoco.__file__).parent.glob("*mujoco.*so*")) + sorted(Path(mujoco.__file__).parent.glob(
        "*mujoco*.d*"))), None)
    mine: Any = ctypes.CDLL(str(found)) if found else None
    ask, tell = (getattr(mine, f"_mjPRIVATE__{word}_xml_precision", None) for word in ("get", "set"))
    if ask is None or tell is None:
        raise OptionError(f"write_mjcf: MuJoCo {mujoco.__version__} writes numbers with 6 digits alone; install another version")
    before = ask()
    tell(DIGITS)
    try:
        yield
    finally:
        tell(before)
