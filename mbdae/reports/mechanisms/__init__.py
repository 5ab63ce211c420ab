"""Scenes on paper: the solution of their rows, and mechanisms over one coordinate. Here: mechanisms drawn in any plane, as such
of the plane z = 0."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from mbdae.documents.blocks import escaped
from mbdae.scene.components import Beam
from mbdae.scene.record import item_name, signature_of
from mbdae.system.prepare import Prepared, prepare


class InPlane:
    """A scene in space whose joints let its bodies move in parallel planes alone, as a scene of the plane in axes of its own.
    ValueError, with the reason, for others. told: a sentence on it; axes (3, 3): its axes in rows; prepared: as such a scene."""

    PLACES, DIRECTIONS = ("at", "at_l"), ("axis", "axis_l")
    ALONE = ("gear", "rack", "couple")  #: statements without directions

    def __init__(self, prepared: Prepared) -> None:
        scene = prepared.model.scene
        normals = [c.laws[0].axis for c in scene.joints if c.kind == "revolute"]
        if prepared.model.planar or not normals:
            raise ValueError("" if prepared.model.planar else "it has no revolute joint")
        n = np.array(normals[0]) / np.linalg.norm(normals[0])
        x = np.eye(3)[np.argmin(np.round(np.abs(n), 6))]
        x = (x - n * (n @ x)) / np.linalg.norm(x - n * (n @ x))
        self.scene, self.axes = scene, np.array([x, np.cross(n, x), n])
        for c in scene.joints:
            across = self.axes @ c.laws[0].axis / np.linalg.norm(c.laws[0].axis)
            if {"revolute": np.hypot(*across[:2]), "prismatic": abs(across[2])}.get(c.kind, 1.0) > 1e-9:
                raise ValueError(f"{escaped(c.name)} lets its bodies leave the plane of {escaped(scene.joints[0].name)}")
        flat = scene._copied([*map(self._body, scene.bodies), *(found for one in scene.statements if (found := self._item(one)))])
        flat.space, flat.gravity = "auto", self._level(scene.gravity)
        self.prepared = prepare(flat)
        words = [f"({', '.join(f'{c + 0.0:.4g}' for c in np.round(a, 12))})" for a in self.axes]
        self.told = (f"All bodies move normal to {words[2]}, so this is the motion in a plane, in axes $x$ along {words[0]}, $y$"
                     f" along {words[1]} and $z$ along {words[2]}. It has the joint forces in the plane and the moments about"
                     " $z$: they depend neither on where bodies and loads lie along $z$ nor on forces along it.")

    def _level(self, a: Any) -> list[float]:
        """A vector or place in axes of the plane, without its part normal to it."""
        return [*map(float, (self.axes @ np.array(a, dtype=float))[:2]), 0.0]

    def _body(self, b: Any) -> list[Any]:
        """The statement of a body in the plane."""
        if isinstance(b, Beam) or (b.inertia is None and not b.is_point):
            raise ValueError(f"{escaped(b.name)} is no rigid body")
        own = {} if b.gravity is None else {"gravity": self._level(b.gravity)}
        R, place = self.axes @ b.drawn.rotation, self._level(b.drawn.position)
        mass = [b.name, float(b.mass)]
        return ["point_mass", [*mass, place], own] if b.is_point else \
            ["rigid_body", [*mass, float((R @ b.inertia @ R.T)[2, 2]), place], own]

    def _item(self, one: Any) -> Any:
        """A statement of a joint or coupling in the plane; None for bodies."""
        method, args, kwargs = one
        if method in ("rigid_body", "point_mass", "link"):
            return None
        if method not in ("revolute", "prismatic", *self.ALONE) or "sensor(" in repr(one) or "'place'" in repr(one):
            raise ValueError(f"{escaped(method)} {escaped(str(item_name(one)))} may act in other directions")
        given = dict(zip(signature_of(method).parameters, ["self", *args], strict=False)) | kwargs
        given.pop("self")
        for name in (*self.PLACES, *self.DIRECTIONS) if method not in self.ALONE else ():
            if given.get(name) is not None or name == "axis":
                a = given.get(name) or (0, 0, 1)
                turns = method == "revolute" and name in self.DIRECTIONS
                given[name] = [0.0, 0.0, float(np.sign((self.axes @ a)[2]))] if turns else self._level(a)
        return [method, [], given]

    def run(self, result: Any) -> Any:
        """A run as one of the scene in the plane: times, states, joint forces and their errors."""
        start, t, A = self.prepared.start, result.t, self.axes
        q, u = np.tile(start.q, (len(t), 1)), np.tile(start.u, (len(t), 1))
        joints = {c.name: c for c in self.scene.joints}
        for node in self.prepared.model.nodes:
            if node.body is None:
                q[:, node.q], u[:, node.u] = result.coordinate(joints[node.joint], node.coordinate)
                continue
            moved, drawn = result[node.body.name], next(b for b in self.scene.bodies if b.name == node.body.name).drawn
            q[:, node.q : node.q + 2] = moved.position @ A[:2].T
            u[:, node.u : node.u + 2] = moved.velocity @ A[:2].T
            if node.kind.turns:
                R = A @ moved.rotation @ drawn.rotation.T @ A.T
                rate = u[:, node.u + 2] = moved.angular_velocity @ A[2]
                last = [start.t, start.q[node.q + 2], start.u[node.u + 2]]
                for i, angle in enumerate(np.arctan2(R[:, 1, 0], R[:, 0, 0])):  # whole turns by the rates
                    near = last[1] + (t[i] - last[0]) * (last[2] + rate[i]) / 2
                    q[i, node.q + 2] = angle + 2 * np.pi * np.round((near - angle) / (2 * np.pi))
                    last = [t[i], q[i, node.q + 2], rate[i]]
        found = {c.name: SimpleNamespace(force=result[c.name].force @ (A * [[1], [1], [0]]).T,
                                         torque=result[c.name].torque @ (A * [[0], [0], [1]]).T) for c in self.scene.joints}
        return RunInPlane(found, t, (q, u, np.tile(start.s, (len(t), 1))), result)


class RunInPlane(dict[str, Any]):
    """Joint forces of a run by joint, in axes of a plane, with its times, states, errors and accuracy."""

    def __init__(self, forces: Any, t: Any, states: Any, result: Any) -> None:
        super().__init__(forces)
        self.t, self._states, self.error, self.accuracy = t, states, result.error, result.accuracy
