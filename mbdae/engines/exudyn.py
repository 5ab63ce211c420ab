"""Exudyn: rigid bodies, joints, springs, loads and planar beams in absolute coordinates; open chains also in joint coordinates.

In the plane bodies are `NodeRigidBody2D`; in space they have Euler parameters, and a second model has rotation vectors with Lie
group methods. Joints are `ObjectJointGeneric`, without the rows that mbdae finds redundant; trees of hinges and slides are
`ObjectKinematicTree`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import sympy
from scipy.spatial.transform import Rotation

from mbdae.engines import INTERVALS, Case, Engine, Method, Statement, fixed_steps, script
from mbdae.engines.exudyn_script import exudyn_runs
from mbdae.errors import SceneError
from mbdae.laws.forces import AppliedForce, AppliedTorque, Bushing, JointDamper, JointLoad, JointSpring, PointSpring
from mbdae.laws.joint_rows import FixedOrientation
from mbdae.laws.joints import Cylindrical, Planar, Prismatic, Revolute, Spherical, Weld
from mbdae.results.stored_parts import started
from mbdae.scene.components import Beam, Station
from mbdae.scene.shapes import joint_axes
from mbdae.system.base import Array
from mbdae.system.model.nodes import Node, quaternion_product, rotation_matrices

#: axes that a joint holds: displacements along x, y, z, rotations about x, y, z of its frame
HELD: dict[Any, tuple[int, ...]] = {Revolute: (1, 1, 1, 1, 1, 0), Prismatic: (1, 1, 0, 1, 1, 1), Cylindrical: (1, 1, 0, 1, 1, 0),
                                    Spherical: (1, 1, 1, 0, 0, 0), Weld: (1, 1, 1, 1, 1, 1), Planar: (0, 0, 1, 1, 1, 0),
                                    FixedOrientation: (0, 0, 0, 1, 1, 1)}
ROWS = {"x": 0, "y": 1, "z": 2, "tilt_x": 3, "tilt_y": 4}  #: of a revolute joint that may be redundant: axis that is let free


class Exudyn(Engine):
    """`exudyn.SolveDynamic` with generalised-alpha, and with explicit methods in joint coordinates."""

    name, package = "exudyn", "exudyn"

    def state(self, case: Case) -> Statement:
        stated = _Stated(case)
        if stated.wrong:
            raise SceneError(stated.wrong)
        steps = fixed_steps(case)
        methods = [Method("generalised-alpha, radius 0.8", "step", steps, 2.0)]
        if not stated.data["timed"]:  # what is prescribed has no rates in exudyn
            methods.append(Method("trapezoidal, index 2", "step", steps, 2.0))
        if not (stated.data["planar"] or stated.data["timed"]):
            methods.append(Method("generalised-alpha, Lie group", "step", steps, 2.0))
        if stated.data["tree"]:
            methods += [Method(f"tree, {name}", "step", steps, order) for name, order in (
                ("RK44", 4.0), ("RK67", 6.0), ("generalised-alpha", 2.0))]
        text = "if __name__ == '__main__':\n    serve(*exudyn_runs())"
        return Statement(script(text, exudyn_runs), {"scene.json": json.dumps(stated.data).encode()}, tuple(methods))


class _Stated:
    """A scene as data for the script; wrong: what cannot be stated."""

    def __init__(self, case: Case) -> None:
        self.case, self.scene, self.wrong = case, case.scene, list[str]()
        self.start = case.start()["motion"]
        self.index = {node.name: i for i, node in enumerate(case.nodes)}
        self.planar = all(node.kind.flat for node in case.nodes)
        self.data: dict[str, Any] = {
            "planar": self.planar, "t": case.times[[0, -1]].tolist(), "timed": False, "intervals": INTERVALS, "tree": None,
            "bodies": [self._body(node) for node in case.nodes], "beams": self._beams(), "connectors": [], "loads": []}
        self.free: dict[str, list[str]] = {}
        for row in case.prepared.rank.dropped:
            item, _, name = row.name.rpartition(".")
            self.free.setdefault(item, []).append(name)
        for c in self.scene.connections:
            self._connection(c)
        for what, items in (("line load", self.scene.line_loads), ("controller", self.scene.controllers)):
            self.wrong += [f"{what} '{item.name}'" for item in items]
        if not self.wrong:
            self.data["tree"] = self._tree()

    # -- bodies

    def _body(self, node: Node) -> dict[str, Any]:
        body, found = node.body, self.start[self.index[node.name]]
        assert body is not None
        if body.is_point:
            self.wrong.append(f"'{body.name}' is a point mass")
        if self.planar != node.kind.flat:
            self.wrong.append(f"'{body.name}': bodies in the plane and in space together")
        beam, (r, P, v, w) = isinstance(body, Station), np.split(found, [3, 7, 10])
        R, J = rotation_matrices(P), np.zeros((3, 3)) if beam or body.inertia is None else body.inertia
        angle, own = self.case.prepared.start.q[node.q + 2] if self.planar else 0.0, R.T @ w
        nodes = {"NodeRigidBody2D": ([*r[:2], angle], [*v[:2], w[2]]),
                 "NodeRigidBodyEP": ([*r, *P], [*v, *quaternion_product(P, np.r_[0.0, own]) / 2]),
                 "NodeRigidBodyRotVecLG": ([*r, *Rotation.from_matrix(R).as_rotvec()], [*v, *own])}
        taken = {name: np.array(both).tolist() if self.planar else [np.array(one).tolist() for one in both]
                 for name, both in nodes.items() if self.planar == name.endswith("2D")}
        return {"nodes": taken, "beam": beam, "mass": 0.0 if beam else body.mass, "gravity": np.array(
            self.scene.gravity if body.gravity is None else body.gravity).tolist(),
            "inertia": [J[0, 0], J[1, 1], J[2, 2], J[1, 2], J[0, 2], J[0, 1]]}

    def _beams(self) -> list[dict[str, Any]]:
        beams = []
        for line in self.case.prepared.model.lines:
            n = line.numbers
            if not self.planar or line.mesh.order != 1 or np.any(np.abs(line.mesh.offsets) > 1e-12) or n.get("damping"):
                self.wrong.append(f"beam '{line.beam.name}': only straight ones in the plane, of order 1, without damping")
                continue
            section = line.beam.section.swapped if line.mesh.normal_axis == 2 else line.beam.section
            at = [self.index[node.name] for node in line.nodes]
            ends = line.mesh.curve
            beams.append({"elements": [[at[i] for i in one] for one in line.mesh.elements.tolist()],
                          "length": np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).tolist(), "EA": section.EA, "GA": section.GA2,
                          "EI": section.EI3, "mass": section.mass_per_length,
                          "rotary": float(np.broadcast_to(section.rotary_inertia, 3)[2]), "gravity": self.scene.gravity.tolist()})
        return beams

    def _side(self, law: Any, body: Any, side: str, axes: Array, name: str) -> dict[str, Any]:
        """A point of a body with axes there: its number (-1: the ground), point and axes in its own frame."""
        point = np.asarray(law.point_on(side) if law.point_on(side) is not None else body.drawn.position, dtype=float)
        if body.is_ground:
            return {"body": -1, "point": point.tolist(), "axes": axes.tolist()}
        if isinstance(body, Beam):
            near = [node for node in self.case.nodes if isinstance(node.body, Station) and node.body.beam is body]
            at = min(near, key=lambda node: float(np.linalg.norm(node.body.drawn.position - point)))  # type: ignore[union-attr]
            assert at.body is not None
            body = at.body
        else:
            at = next((node for node in self.case.nodes if node.body is body), None)  # type: ignore[assignment]
        if at is None:
            self.wrong.append(f"'{name}': '{body.name}' is no body of its own")
            return {"body": -1, "point": point.tolist(), "axes": axes.tolist()}
        R = body.drawn.rotation if not self.planar else _about_z(body.heading)
        local = R.T @ (point - body.drawn.position)
        return {"body": self.index[at.name], "point": local.tolist(), "axes": (R.T @ axes).tolist()}

    # -- joints and forces

    def _connection(self, c: Any) -> None:
        law, say = c.laws[0], self.wrong.append
        if c.others or c.loose or c.rubs:
            return say(f"'{c.name}': {type(law).__name__}{' with friction' if c.rubs else ''}")
        if c.is_joint:
            return self._joint(c)
        for one in c.laws:
            axes = np.eye(3) if one.axes_of is None else joint_axes(one, c.k)
            sides = {"k": self._side(one, c.k, "k", axes, c.name), "l": self._side(one, c.l, "l", axes, c.name)}
            values = {p: getattr(one, p) for p in one.params if getattr(one, p) is not None}
            if isinstance(one, AppliedForce | AppliedTorque):
                parts = [self._time(c, values.get(p, 0.0)) for p in one.params]
                self.data["loads"].append(sides | {"torque": isinstance(one, AppliedTorque), "follows": bool(one.following),
                                                   "parts": parts})
            elif isinstance(one, PointSpring) and one.length is not None and self._numbers(c, values):
                self._connector("ObjectConnectorSpringDamper", sides, stiffness=values.get("stiffness", 0.0),
                                damping=values.get("damping", 0.0), referenceLength=one.length)
            elif isinstance(one, Bushing) and c.k.is_ground and self._numbers(c, values):
                words = {"k": "stiffness", "c": "damping"}
                both = {word: [float(values.get(f"{p}{a}", 0.0)) for a in "xyz"] for p, word in words.items()}
                self._connector("ObjectConnectorCartesianSpringDamper", sides, **both)
            elif values and any(values.values()):
                say(f"{c.kind} '{c.name}': {type(one).__name__}{' between bodies' * isinstance(one, Bushing)}")
        return None

    def _joint(self, c: Any) -> None:
        law, say = c.laws[0], self.wrong.append
        kind = type(law)
        held = [*HELD.get(kind, ())]
        if not held:
            return say(f"joint '{c.name}': {kind.__name__}")
        A, B = joint_axes(law, c.k), joint_axes(law, c.k, "l")
        for name in self.free.get(c.name, ()):
            if kind is not Revolute or name not in ROWS:
                return say(f"joint '{c.name}': its row '{name}' is redundant")
            held[ROWS[name]] = 0
        along = 2
        if self.planar:
            A, B, held, along = _flat(kind, A, B, held)
        turns, offset = kind is Revolute, list[Any]()
        if c.prescribed:
            (value,) = c.prescribed.values()
            if kind not in (Revolute, Prismatic) or len(c.prescribed) > 1:
                return say(f"joint '{c.name}': a prescribed motion of a {kind.__name__}")
            offset, self.data["timed"] = [5 if turns else along, self._time(c, value)], True
            held[offset[0]] = 1
        sides = {"k": self._side(law, c.k, "k", A, c.name), "l": self._side(law, c.l, "l", B, c.name)}
        axes = {"rotationMarker0": sides["k"]["axes"], "rotationMarker1": sides["l"]["axes"]}
        self._connector("ObjectJointGeneric", sides, offset, constrainedAxes=held, **axes)
        for force in c.laws[1:]:
            values = {p: getattr(force, p) for p in force.params if getattr(force, p) is not None}
            if kind not in (Revolute, Prismatic) or not isinstance(force, JointSpring | JointDamper | JointLoad):
                say(f"joint '{c.name}': {type(force).__name__} on a {kind.__name__}")
            elif isinstance(force, JointLoad) and turns:
                load = self._time(c, force.load)
                for side, sign in (("l", ""), ("k", "-")):
                    z = [f"{sign}({load})*{x!r}" for x in np.array(sides[side]["axes"])[:, 2].tolist()]
                    self.data["loads"].append({"k": sides["k"], "l": sides[side], "torque": True, "follows": True, "parts": z})
            elif self._numbers(c, values):
                own = {to: float(values.get(p, 0.0))
                       for p, to in (("stiffness", "stiffness"), ("damping", "damping"), ("rest", "offset"))}
                if turns:
                    self._connector("ObjectConnectorTorsionalSpringDamper", sides, **own, **axes)
                else:
                    axis = np.array(sides["k"]["axes"])[:, along].tolist()
                    self._connector("ObjectConnectorLinearSpringDamper", sides, **own, axisMarker0=axis,
                                    force=-float(values.get("load", 0.0)))
        return None

    def _connector(self, item: str, sides: Mapping[str, Any], offset: Any = None, **values: Any) -> None:
        self.data["connectors"].append({"item": item, **sides, "offset": offset, "values": values})

    def _numbers(self, c: Any, values: Mapping[str, Any]) -> bool:
        good = all(isinstance(v, int | float) for v in values.values())
        if not good:
            self.wrong.append(f"'{c.name}': a parameter that changes during the run")
        return good

    def _time(self, c: Any, value: Any) -> str:
        """An expression of time as Python text."""
        expression = sympy.sympify(value)
        known = expression.free_symbols <= {sympy.Symbol("t")} and not expression.atoms(sympy.core.function.AppliedUndef)
        if not known:
            self.wrong.append(f"'{c.name}': a load or motion that reads sensors or tables")
            return "0.0"
        return str(sympy.pycode(sympy.N(expression, 17), fully_qualified_modules=True))

    # -- open chains in joint coordinates

    def _tree(self) -> dict[str, Any] | None:
        """Links in joint coordinates, parents first; None where the scene is no tree of hinges and slides with forces in them."""
        joints = {c.l.name: c for c in self.scene.joints if type(c.laws[0]) in (Revolute, Prismatic) and not c.prescribed}
        bodies = [node.body for node in self.case.nodes if node.body is not None]
        plain = all(isinstance(getattr(f, p), int | float | None) for c in joints.values() for f in c.laws[1:] for p in f.params)
        alone = {b.name for b in bodies} == set(joints) and len(self.scene.connections) == len(bodies)
        if not (plain and alone) or self.data["beams"]:
            return None
        ordered = list[Any]()
        while len(ordered) < len(bodies):
            more = [joints[b.name] for b in bodies if joints[b.name] not in ordered and (
                joints[b.name].k.is_ground or any(c.l is joints[b.name].k for c in ordered))]
            if not more:
                return None
            ordered += more
        at, first, links = {c.l.name: i for i, c in enumerate(ordered)}, started(self.case.prepared), []
        for c in ordered:
            law, body = c.laws[0], c.l
            if law.axis_l is not None or law.axis_x_l is not None or law.at_l is not None or body.gravity is not None:
                return None
            A, point, B, origin, parent = joint_axes(law, c.k), np.asarray(law.at, dtype=float), np.eye(3), np.zeros(3), -1
            if not c.k.is_ground:
                parent = at[c.k.name]
                before = ordered[parent]
                B, origin = joint_axes(before.laws[0], before.k), np.asarray(before.laws[0].at, dtype=float)
            inertia = np.zeros((3, 3)) if body.inertia is None else body.inertia
            R = A.T @ body.drawn.rotation
            forces = {p: sum(float(getattr(f, p) or 0.0) for f in c.laws[1:] if p in f.params)
                      for p in ("stiffness", "damping", "load", "rest")}
            sensor, turns = first[c.name], type(law) is Revolute
            links.append({"parent": parent, "turns": turns, "rotation": (B.T @ A).tolist(),
                          "offset": (B.T @ (point - origin)).tolist(), "mass": body.mass, "inertia": (R @ inertia @ R.T).tolist(),
                          "centre": (A.T @ (body.drawn.position - point)).tolist(), "body": R.tolist(),
                          "q": float((sensor.angle if turns else sensor.displacement)[0]), "v": float(sensor.rate[0]), **forces})
        order = [at[b.name] for b in bodies]
        return {"links": links, "order": order, "gravity": self.scene.gravity.tolist()}


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _flat(kind: Any, A: Array, B: Array, held: list[int]) -> tuple[Array, Array, list[int], int]:
    """Axes of a joint in the plane with z as the normal, what they hold, and the axis along which it slides."""
    if kind is Prismatic:
        turned = [np.column_stack([M[:, 2], np.cross([0.0, 0.0, 1.0], M[:, 2]), [0.0, 0.0, 1.0]]) for M in (A, B)]
        return turned[0], turned[1], [0, 1, 0, 0, 0, 1], 0
    if kind is Revolute:
        return A, B, [held[0], held[1], 0, 0, 0, 0], 2
    return A, B, [*((1, 1) if kind in (Spherical, Weld) else (0, 0)), 0, 0, 0, int(kind in (Weld, FixedOrientation))], 2
