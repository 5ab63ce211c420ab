"""Scenes on paper: the solution of their rows, and mechanisms over one coordinate. Here: mechanisms drawn in any plane, as such
of the plane z = 0; curves over the input, and the dead centres and change points that a run passes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from mbdae.documents.blocks import Drawing, escaped
from mbdae.results.errors import together
from mbdae.scene.components import Beam
from mbdae.scene.record import item_name, signature_of
from mbdae.system.prepare import Prepared, prepare

NEXT = 0.1  #: a root is next to 0 at this part of its terms: what is divided by its square has 100 times the errors of a run
MET = 1e-4  #: joints that are closer than this part of the scene's length at a change point, found to about 1e-7, coincide there


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
    """Joint forces of a run by joint, in axes of a plane, with its times, states and accuracy; whole: the run in space."""

    def __init__(self, forces: Any, t: Any, states: Any, result: Any) -> None:
        super().__init__(forces)
        self.t, self._states, self.whole, self.accuracy = t, states, result, result.accuracy


def curve(x: Any, period: float, under: str, item: str, force: Any, dots: Any) -> Drawing:
    """A force over the input, in the order of time: a line, and the run's values as rings. period: range of the input that is
    shown, 0 for all of it; under: what is written under it."""
    wide, high = 560.0, 200.0
    low = float(np.min(x))
    pieces = np.floor((x - low) / period) if period else np.zeros(len(x))
    at, size = x - period * pieces, period or float(np.ptp(x)) or 1.0
    top = float(max(np.max(force[np.isfinite(force)], initial=0.0), np.max(dots)) or 1.0)
    drawing = Drawing(wide, high, f"force of {item} over the input")
    place = np.column_stack([(at - low) / size * wide, high * (1 - force / top)])
    drawing.line([(0, 0), (0, high), (wide, high)], "#999")
    ends = np.flatnonzero((pieces[1:] != pieces[:-1]) | (np.isfinite(force[1:]) != np.isfinite(force[:-1]))) + 1
    for piece in np.split(place, ends):
        if len(piece) > 1 and np.isfinite(piece).all():
            drawing.line([(float(a), float(b)) for a, b in piece], "#0072b2", 1.5)
    for i in range(0, len(x), max(1, len(x) // 40)):
        a, b = (at[i] - low) / size * wide, high * (1 - dots[i] / top)
        drawing.line([(a + 3 * np.cos(w), b + 3 * np.sin(w)) for w in np.linspace(0, 2 * np.pi, 13)], "#bf5400")
    drawing.text(0, -8, f"{top:.4g} N", "start")
    drawing.text(wide, high + 18, f"{low + size:.4g}", "end")
    drawing.text(wide / 2, high + 18, under)
    drawing.text(0, high + 18, f"{low:.4g}", "start")
    drawing.fit()
    return drawing


def meetings(page: Any, name: str, where: str) -> list[tuple[float, str]]:
    """The change points of a branch with what is there; where: in words where its roots meet. At some its joints do."""
    if name not in page.branches:
        return []
    b, letter, n, found = page.branches[name], page.latex[name], name[2:], list[tuple[float, str]]()
    turns = range(round(page.period() / b.period)) if b.period else (0,)
    for x in b.points:
        at = page.along([x])
        met = name in page.met and np.hypot(at[f"D{n}_0"], at[f"D{n}_1"])[0] < MET * page.prepared.length
        goes = f"the loop goes through, and ${letter}$ changes its sign" if x in b.changes else "it stays on its own"
        what = (f"change point: {page.met[name] if met else where}; both branches of the loop meet here, {goes}; joint forces are"
                " not determined here and may grow without bound beside it")
        found += [(x + turn * b.period, what) for turn in turns]
    return found


def errors_within(result: Any, quantity: str, pieces: list[Any]) -> list[float] | None:
    """A run's own error of a quantity in every piece of its times (nt,), s; None where it states none."""
    errors, seen = result.accuracy.errors, list[Any]()
    if errors is None or errors.of(result, quantity) is None:
        return None

    def part(other: Any, t: Any, own: Any, beside: Any) -> float:
        seen.append((other, t, np.linalg.norm(beside - own, axis=1)))
        return 0.0

    least, found = errors._estimated(result, quantity, part).error, list[float]()
    for first, last in ((piece[0], piece[-1]) for piece in pieces):
        apart = []
        for other, t, off in seen:
            there = (t >= first) & (t <= last) if other.kind != "window" else np.ones(len(t), dtype=bool)
            there = there if there.any() else np.arange(len(t)) == np.argmin(np.abs(t - (first + last) / 2))
            apart.append((other, float(np.max(off[there]))))
        found.append(max(together(apart), least))
    return found


def passed(page: Any, t: Any, x: Any, rate: Any, q: Any, u: Any) -> tuple[Any, str]:
    """At which times of a run (nt,) a closure is next to a place where its roots meet, or on the other root than its formula; and
    sentences on the dead centres, where the input turns back, and the change points that it passes. x, rate: of the input."""
    left, told = np.zeros(len(t), dtype=bool), ""
    signs = page.branches_of(q, u)
    for name, where in page.limits.items():
        root, branch = page.at_states(page.roots[name], q, u), f"br{name[1:]}"
        sign = signs.get(branch, np.where(root >= 0, 1.0, -1.0))
        flips = sign[1:] != sign[:-1]
        turns = flips & (rate[1:] * rate[:-1] <= 0)
        through, back = (", ".join(f"{v:.4g}" for v in t[1:][at]) for at in (flips & ~turns, turns))
        if back:
            told += (f" The run passes a dead centre just before t = {back} s, where {where}; beyond it the loop is on its other"
                     " branch.")
        if branch not in page.branches:
            left |= root <= NEXT
            told += " The formulas are compared where it is on its first branch." * bool(back)
            continue
        b, letter = page.branches[branch], page.latex[branch]
        left |= np.abs(root) <= NEXT
        if through:
            told += f" The run goes through a change point just before t = {through} s, where ${letter}$ changes its sign."
        other = np.flatnonzero(page.off_change_points(x) & (sign != page.branch_at(b, x)))
        if len(other) and not back:
            told += (f" From t = {t[other[0]]:.4g} s on it is on the branch ${letter} = {sign[other[0]]:g}$, which the loop does"
                     " not reach by going through its change points: there the smallest disturbance decides, here an error of the"
                     " run.")
    return left, told
