"""A film as a .glb file (glTF 2.0, binary), which renderers, slides and browsers read.

Bodies are nodes that move by keys, with the solids and rods of their drawing; what changes its shape, as beams, springs and
arrows, is a chain of rods, each of which moves.
"""

from __future__ import annotations

import json
import struct
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mbdae.scene.shapes import Cylinder, Sphere
from mbdae.show import symbols
from mbdae.show.drawing import LOOKS
from mbdae.show.geometry import INK, MARK, Outline
from mbdae.show.shapes import Film
from mbdae.values import Array

FLOAT, INDEX = 5126, 5125  #: of a number in the file: float32, uint32
LINES = 3  #: a polyline, among the modes of a primitive
WIDTH = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
NOWHERE = 1e-9  #: ratio to the size of the scene of the length of a rod that is not there


class _File:
    """The parts of a .glb while they are gathered."""

    def __init__(self, film: Film) -> None:
        self.film, self.mark, self.data = film, MARK * film.seen.size, bytearray()
        self.parts: dict[str, list[Any]] = {name: [] for name in ("bufferViews", "accessors", "materials", "meshes", "nodes")}
        self.channels: list[dict[str, Any]] = []
        self.samplers: list[dict[str, Any]] = []
        self.known: dict[Any, int] = {}
        self.t = self.array(film.seen.t - film.seen.t[0])

    def add(self, kind: str, **made: Any) -> int:
        """Number of a new part."""
        self.parts[kind].append(made)
        return len(self.parts[kind]) - 1

    def array(self, values: Array, kind: int = FLOAT) -> int:
        """An accessor of values (n,) or (n, 3 or 4)."""
        values = np.ascontiguousarray(values, dtype=np.float32 if kind == FLOAT else np.uint32)
        start, rows = len(self.data), values.reshape(len(values), -1)
        self.data += values.tobytes()
        view = self.add("bufferViews", buffer=0, byteOffset=start, byteLength=values.nbytes)
        return self.add("accessors", bufferView=view, componentType=kind, count=len(values), type=WIDTH[rows.shape[1]],
                        min=rows.min(axis=0).tolist(), max=rows.max(axis=0).tolist())

    def material(self, colour: str) -> int:
        """The material of a colour, whose components are linear in a file and those of a screen here."""
        if colour not in self.known:
            from matplotlib.colors import to_rgb

            c = np.array(to_rgb(colour))
            linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
            pbr = {"baseColorFactor": [*linear.tolist(), 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.6}
            self.known[colour] = self.add("materials", pbrMetallicRoughness=pbr, doubleSided=True)
        return self.known[colour]

    def mesh(self, points: Array, faces: Any, colour: str) -> int:
        """A mesh of faces; a line where there are none."""
        primitive: dict[str, Any] = {"attributes": {"POSITION": self.array(points)}, "material": self.material(colour)}
        if len(faces):
            corners = [(face[0], a, b) for face in faces for a, b in pairwise(face[1:])]
            primitive["indices"] = self.array(np.array(corners).ravel(), INDEX)
        else:
            primitive["mode"] = LINES
        return self.add("meshes", primitives=[primitive])

    def node(self, name: str, parent: dict[str, Any], moves: dict[str, Array] | None = None, **made: Any) -> dict[str, Any]:
        """A node in its parent; moves: its translation, rotation (quaternions x y z w) and scale at every time."""
        number, moves = self.add("nodes", name=name, **made), moves or {}
        parent.setdefault("children", []).append(number)
        for path, values in moves.items():
            self.parts["nodes"][number][path] = values[0].tolist()
            if np.ptp(values, axis=0).any():
                self.samplers.append({"input": self.t, "output": self.array(values), "interpolation": "LINEAR"})
                self.channels.append({"sampler": len(self.samplers) - 1, "target": {"node": number, "path": path}})
        return self.parts["nodes"][number]  # type: ignore[no-any-return]

    def written(self, extras: dict[str, Any]) -> bytes:
        """The file."""
        animations = [{"channels": self.channels, "samplers": self.samplers}] if self.channels else []
        head = {"asset": {"version": "2.0", "generator": "mbdae", "extras": extras}, "scene": 0, "scenes": [{"nodes": [0]}],
                "buffers": [{"byteLength": len(self.data)}], **self.parts, **({"animations": animations} if animations else {})}
        text = json.dumps(head, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(self.data), 0x004E4942) + self.data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def glb(film: Film, meshed: frozenset[str]) -> bytes:
    """The file of a film; meshed: names of the bodies whose deformed meshes are left out."""
    seen, file = film.seen, _File(film)
    upright = Rotation.align_vectors([[0, 1, 0]], [-seen.gravity])[0] if not seen.planar and np.any(seen.gravity) else \
        Rotation.from_euler("x", 0 if seen.planar else -90, degrees=True)
    root = file.parts["nodes"][file.add("nodes", name=seen.name, rotation=upright.as_quat().tolist())]
    # copies: SciPy below 1.14 takes no arrays that are read-only
    turns = {name: _steady(Rotation.from_matrix(np.array(pose.rotation))) for name, pose in seen.poses.items()}
    bodies = {name: file.node(name, root, {"translation": pose.position, "rotation": turns[name]})
              for name, pose in seen.poses.items()}
    for shape in seen.shapes:
        if shape.item not in meshed or shape.body:
            _put(file, shape, bodies[shape.body] if shape.body else root)
    for trail in film.trails:
        file.node(f"path of {trail.name}", root, mesh=file.mesh(trail.points, (), trail.colour))
    return file.written({"left out": sorted(meshed)} if meshed else {})


def _put(file: _File, shape: Outline, parent: dict[str, Any]) -> None:
    """A shape as a node, or as a chain of nodes where its points move in the axes of its parent."""
    look, still = LOOKS[shape.kind], len(shape.points) == 1
    if shape.faces and still:
        file.node(shape.item, parent, mesh=file.mesh(shape.points[0], shape.faces, shape.colour))
    elif look.marker:
        ball = symbols.drawn(Sphere(at=np.zeros(3), radius=look.rod * file.mark), False, 1.0)[0]
        colour = {"ink": INK, "white": "#f4f4f4"}.get(look.face, shape.colour)
        file.node(shape.item, parent, {"translation": shape.points[:, 0]}, mesh=file.mesh(ball.points, ball.faces, colour))
    elif still and not look.rod:
        file.node(shape.item, parent, mesh=file.mesh(shape.points[0], (), shape.colour))
    else:
        key = ("rod", shape.colour)
        if key not in file.known:
            rod = symbols.drawn(Cylinder(at=(0, 0, 0.5), axis=(0, 0, 1), radius=1.0, length=1.0), False, 1.0)[0]
            file.known[key] = file.mesh(rod.points, rod.faces, shape.colour)
        for a, b in zip(shape.points.swapaxes(0, 1)[:-1], shape.points.swapaxes(0, 1)[1:], strict=True):
            if np.any(a != b):
                file.node(shape.item, parent, _between(a, b, look.rod * file.mark, file), mesh=file.known[key])


def _between(a: Array, b: Array, radius: float, file: _File) -> dict[str, Array]:
    """How a rod of length and radius 1 along z moves to reach from a to b (nt, 3)."""
    way = b - a
    length = np.maximum(np.linalg.norm(way, axis=1), NOWHERE * file.mark / MARK)[:, None]
    z = np.where(np.any(way, axis=1)[:, None], way / length, symbols.Z)
    half = np.c_[-z[:, 1], z[:, 0], np.zeros(len(z)), 1 + z[:, 2]]
    half[half[:, 3] < 1e-9] = [1, 0, 0, 0]
    wide = np.where(length > NOWHERE * file.mark / MARK, radius, NOWHERE)
    return {"translation": a, "rotation": _steady(Rotation.from_quat(half)), "scale": np.c_[wide, wide, length]}


def _steady(turns: Rotation) -> Array:
    """Quaternions (nt, 4) x y z w without jumps of sign."""
    q = np.atleast_2d(turns.as_quat())
    flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0))
    q[1:] *= flips[:, None]
    return np.asarray(q)
