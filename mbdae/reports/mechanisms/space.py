"""Bodies of a mechanism in space over its input: each by its centre, its axes and its angular velocity, on joints whose
coordinates are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import symengine as se

from mbdae.documents.blocks import escaped
from mbdae.reports.mechanisms.over_input import OverInput
from mbdae.reports.vectors import ZERO
from mbdae.symbolic.frames import Frame, NodeKind
from mbdae.symbolic.motion import Motion, Step, symbolic_steps, turned
from mbdae.symbolic.vectors import UNIT, Expr, Vec
from mbdae.symbolic.vectors import ZERO as NONE
from mbdae.system.model.nodes import Instance, Node, quaternion, rotation_matrices
from mbdae.system.prepare import Prepared

Axes = tuple[Vec, Vec, Vec]


class Pose(NamedTuple):
    """Where a body is: its centre, its axes and its angular velocity, in inertial components."""

    centre: Vec
    axes: Axes
    spin: Vec

    def turned(self, a: Any) -> Vec:
        """A vector of the body in inertial components."""
        found: Vec = self.axes[0] * a[0] + self.axes[1] * a[1] + self.axes[2] * a[2]
        return found

    def point(self, a: Any) -> Vec:
        """The place of a point of the body."""
        found: Vec = self.centre + self.turned(a)
        return found

    @property
    def x(self) -> Expr:
        """The coordinate of a joint's node, which has no axes."""
        return self.centre[0]


class SpatialLink(NamedTuple):
    """A joint between two bodies, None for the ground, by the steps of its motion from k to l. frames: its axes on k and l, in
    body axes; at, Q: its points and frames in numbers."""

    item: str
    k: Node | None
    l: Node | None
    points: tuple[Vec, Vec]
    frames: tuple[Axes, Axes]
    at: tuple[Any, Any]
    Q: tuple[Any, Any]
    steps: tuple[Step, ...]
    row: Any  #: one of its rows

    @property
    def coordinates(self) -> list[str]:
        """Names of its coordinates that are no free rotations."""
        return list(dict.fromkeys(str(s) for step in self.steps for s in sorted(step.amount.free_symbols, key=str)))

    @property
    def coordinate(self) -> str:
        """Its only coordinate; "" where it has none or several."""
        return names[0] if len(names := self.coordinates) == 1 and not self.ball else ""

    @property
    def ball(self) -> bool:
        """Whether it leaves a free rotation."""
        return any(step.rotation is not None for step in self.steps)

    @property
    def turn(self) -> int:
        """1 where its coordinate is an angle."""
        return int(any(step.turns and step.amount == se.Symbol(self.coordinate) for step in self.steps))

    @property
    def slide(self) -> Step | None:
        """Its only step, where this is a displacement by a coordinate."""
        single = len(self.steps) == 1 and not self.turn and self.coordinate and self.steps[0].amount.is_Symbol
        return self.steps[0] if single else None

    @property
    def cross(self) -> bool:
        """Whether it is two turns about axes at right angles."""
        return len(self.steps) == len(self.coordinates) == 2 and not self.ball and all(
            s.turns and s.amount.is_Symbol for s in self.steps) and self.steps[0].axis @ self.steps[1].axis == 0

    def side(self, node: Node | None) -> int:
        """0 for k, 1 for l."""
        return 0 if node is self.k else 1

    def towards(self, node: Node | None) -> Motion:
        """Its motion from the other body to this one."""
        return Motion(self.steps) if node is self.l else Motion(self.steps).inverse()


class Spatial(OverInput):
    """Links of a mechanism in space, and the bodies that follow from its input by joints with known coordinates and couplings."""

    KINDS = (NodeKind.SPATIAL,)
    GROUND = Pose(NONE, UNIT, NONE)

    def __init__(self, prepared: Prepared) -> None:
        self.angles: dict[str, dict[str, Expr]] = {}  #: coordinates of joints that have several, by item
        super().__init__(prepared)

    # -- the joints

    def _link(self, instance: Instance, joint: Any, row: Any) -> SpatialLink:
        steps, n = symbolic_steps(joint), instance.numbers
        if steps is None:
            raise ValueError(f"{escaped(instance.item)} states no motion")
        points, frames, at, Q = [], list[Axes](), [], []
        for side in "kl":
            points.append(Vec(*self.number_of(instance, side, "p1", "p2", "p3")))
            x, y, z = (Vec(*self.number_of(instance, side, *(f"Q{a}{i}" for i in (1, 2, 3)))) for a in "xyz")
            frames.append((x, y, z))
            at.append(np.array([n[f"{side}_p{i}"] for i in (1, 2, 3)]))
            Q.append(np.array([[n[f"{side}_Q{a}{i}"] for a in "xyz"] for i in (1, 2, 3)]))
        return SpatialLink(instance.item, instance.nodes[0], instance.nodes[1], (points[0], points[1]), (frames[0], frames[1]),
                           (at[0], at[1]), (Q[0], Q[1]), steps, row)

    def _may_drive(self, link: Any) -> bool:
        return bool(link.coordinate)

    def _known(self, link: Any) -> bool:
        return not link.ball and (len(link.coordinates) == 0 or link.item in self.amounts or link.item in self.angles)

    def _fixed(self, link: SpatialLink, node: Node | None, what: str, a: Vec) -> Vec:
        """Letters for a vector of a joint on a known body: its arm s or an axis. a: its body components."""
        e = Vec(*map(se.expand, self.placed[node].turned(a)))
        if node is None:
            return e
        d, symbols = self.prepared.model.groups[link.row.group].derived, se.symbols(f"{'kl'[link.side(node)]}_{what}1:4")
        letters = Vec(*(c if c in (0, 1, -1) or c.is_Symbol else self._renamed(link.row, d, s)
                        for c, s in zip(e, symbols, strict=True)))
        known = dict(self.formulas)
        for s, c in zip(letters, e, strict=True):
            if s != c and str(s) not in known:
                self.follow(str(s), c)
        spin = self.placed[node].spin
        self.rates |= {s: rate for s, c, rate in zip(letters, e, spin.cross(letters), strict=True) if s != c}
        return letters

    def _frame(self, link: SpatialLink, node: Node | None) -> Axes:
        """Axes of a joint on a known body, in inertial components."""
        x, y, z = (self._fixed(link, node, what, a) for what, a in zip("xyz", link.frames[link.side(node)], strict=True))
        return x, y, z

    def _point(self, link: SpatialLink, node: Node | None) -> Vec:
        """The point of a joint on a known body."""
        found: Vec = self.placed[node].centre + self._fixed(link, node, "s", link.points[link.side(node)])
        return found

    def _amount(self, link: Any) -> Expr:
        k, l = self.placed[link.k], self.placed[link.l]
        step = next(s for s in link.steps if s.amount == se.Symbol(link.coordinate))
        ak, al = ([place.turned(a) for a in frame] for place, frame in zip((k, l), link.frames, strict=True))
        if not step.turns:
            return on_axes(ak, step.axis) @ (l.point(link.points[1]) - k.point(link.points[0]))
        p = UNIT[int(np.argmin([abs(float(c)) for c in step.axis]))]
        p = p - step.axis * (p @ step.axis)
        q = step.axis.cross(p)
        (kp, kq), lp = (on_axes(ak, a) for a in (p, q)), on_axes(al, p)
        return se.atan2(kq @ lp, kp @ lp)

    # -- the bodies

    def coordinates_of(self, node: Node) -> list[tuple[Expr, Expr, Expr]]:
        return super().coordinates_of(node) if node.kind is NodeKind.COORDINATE else [
            self.moving(f"x{at}", (v.letter, f"_{v.below}"), v.unit, v.of)
            for at in range(node.u, node.u + 3) for v in [self.velocities[at]]]

    def _defined(self, name: str, latex: str, unit: str, meaning: str, e: Expr) -> Expr:
        """A letter with its formula; 0, 1 and -1 are written as such."""
        if e in (0, 1, -1):
            return e
        self.letter(name, latex, unit, meaning)
        return self.follow(name, e)

    def _vector(self, name: str, latex: str, unit: str, meaning: str, e: Vec, spin: Vec | None = None) -> Vec:
        """Letters for the components of a vector (% in latex); spin: the angular velocity of what it is fixed to."""
        found = Vec(*(self._defined(f"{name}_{i}", latex.replace("%", "xyz"[i]), unit, f"{meaning}, component {'xyz'[i]}",
                                    se.expand(c)) for i, c in enumerate(e)))
        if spin is not None:
            self.rates |= {s: rate for s, rate in zip(found, spin.cross(found), strict=True) if s.is_Symbol}
        return found

    def _place(self, node: Node, link: Any, known: Node | None, amount: Expr, angle: Expr | None = None) -> None:
        """Define a body on a known one: its axes, its angular velocity and its centre."""
        amounts = {se.Symbol(c): e for c, e in (self.angles.get(link.item) or {link.coordinate: amount}).items()}
        axes, spin = self._frame(link, known), self.placed[known].spin
        motion, at, start = link.towards(node).substituted(amounts), axes, self._point(link, known)
        moved, there = motion.pose(axes)
        for step in motion.steps:
            if step.turns:
                spin = spin + step.direction(at) * self.rate(step.amount)
                at = turned(at, step)
        said, body = self.names.said("node", node.name), escaped(node.name)
        w = Vec(*(self._spin(node, i, said, c) for i, c in enumerate(spin)))
        own = link.frames[link.side(node)]
        columns = []
        for j in range(3):
            column = there[0] * own[0][j] + there[1] * own[1][j] + there[2] * own[2][j]
            columns.append(self._vector(f"R{node.u}{j}", f"R^{{{said}}}_{{%{j + 1}}}", "1", f"axis {'xyz'[j]} of {node.name}",
                                        column, w))
        self.placed[node] = Pose(NONE, (columns[0], columns[1], columns[2]), w)
        e = start + moved - self._fixed(link, node, "s", link.points[link.side(node)])
        letters = self.coordinates_of(node)
        for s, c in zip(letters, e, strict=True):
            self.with_rates(s, c)
        self.placed[node] = Pose(Vec(*(s[0] for s in letters)), self.placed[node].axes, w)
        dw = Vec(*(self.rates.get(c, ZERO) for c in w))
        for j in range(3):
            for d, e in (("d", w), ("dd", dw)):
                v = self.velocities[node.u + 3 + j]
                self.letter(f"x{node.u + 3 + j}{d}", f"\\{d}ot{{{v.letter}}}_{v.below}", "rad/s" if d == "d" else "rad/s^2",
                            f"{'angular velocity' if d == 'd' else 'angular acceleration'} of {body} about its axis {'xyz'[j]}")
                self.follow(f"x{node.u + 3 + j}{d}", columns[j] @ e)

    def _spin(self, node: Node, i: int, said: str, e: Expr) -> Expr:
        """A component of an angular velocity, with its rate."""
        if (e := se.expand(e)) == 0:
            return ZERO
        name, of = f"om{node.u}_{i}", f"of {node.name} along the inertial axis {'xyz'[i]}"
        w = self.letter(name, f"\\omega^{{{said}}}_{{{'xyz'[i]}}}", "rad/s", f"angular velocity {of}")
        dw = self.letter(f"{name}d", f"\\dot{{\\omega}}^{{{said}}}_{{{'xyz'[i]}}}", "rad/s^2", f"angular acceleration {of}")
        self.rates[w] = dw
        self.with_rates((w, dw), e)  # type: ignore[arg-type]
        return w

    # -- values

    def _rate_of(self, link: Any) -> Expr:
        letter = self.amounts.get(link.item, ZERO)
        return self.rates[letter] if letter in self.rates else self.rate(self._amount(link))

    def _shown(self, link: Any) -> bool:
        return bool(link.coordinate)

    def _unknowns_of(self, f: Frame, node: Node) -> dict[Expr, Expr]:
        place = self.placed[node]
        if node.kind is NodeKind.COORDINATE:
            return {f.q[0]: place.x}
        found = dict(zip(f.q, place.centre, strict=False))
        for a, b in zip(f.body, place.axes, strict=True):
            found |= dict(zip(a, b, strict=True))
        return found

    def _bodies(self) -> list[Node]:
        return [n for n in self.prepared.model.nodes if n.kind is NodeKind.SPATIAL]

    def _unplaced(self, node: Node) -> Any:
        if node.kind is NodeKind.COORDINATE:
            return super()._unplaced(node)
        axes = tuple(Vec(*(se.Symbol(f"R{node.u}{j}_{i}") for i in range(3))) for j in range(3))
        w = Vec(*(se.Symbol(f"om{node.u}_{i}") for i in range(3)))
        for s, d in zip(w, range(3), strict=True):
            self.rates.setdefault(s, se.Symbol(f"om{node.u}_{d}d"))
        for a in axes:
            for s, rate in zip(a, w.cross(a), strict=True):
                self.rates.setdefault(s, rate)
        return Pose(Vec(*(se.Symbol(f"x{node.u + i}") for i in range(3))), axes, w)  # type: ignore[arg-type]

    def states_as_letters(self, q: Any, u: Any, change: Any) -> dict[str, Any]:
        found = dict[str, Any]()
        for node in self.prepared.model.nodes:
            size, at = node.kind.sizes, node.u
            for i in range(node.kind.translations):
                found |= {f"x{at + i}": q[:, node.q + i]}
            for i in range(size[1]):
                found |= {f"x{at + i}d": u[:, at + i], f"x{at + i}dd": change[:, at + i]}
            if node.kind is NodeKind.COORDINATE:
                found[f"x{at}"] = q[:, node.q]
                continue
            R = rotation_matrices(q[:, node.q + 3 : node.q + 7])
            w, dw = (np.einsum("tij,tj->ti", R, x[:, at + 3 : at + 6]) for x in (u, change))
            found |= {f"R{at}{j}_{i}": R[:, i, j] for i in range(3) for j in range(3)}
            found |= {f"om{at}_{i}{d}": x[:, i] for d, x in (("", w), ("d", dw)) for i in range(3)}
        return found

    def drawn_letters(self, q: Any, u: Any) -> dict[str, Any]:
        found = super().drawn_letters(q, u)
        for link in (x for x in self.links if x.cross):
            k, l = (np.eye(3)[..., None] if node is None else
                    np.array([[found[f"R{node.u}{j}_{i}"] for j in range(3)] for i in range(3)]) for node in (link.k, link.l))
            M = link.Q[0].T @ k.transpose(2, 1, 0) @ l.transpose(2, 0, 1) @ link.Q[1]
            (i, a), (j, b) = (((np.array(s.axis.c, float)), str(s.amount)) for s in link.steps)
            n = np.cross(i, j)
            found[f"an{link.item}_{a}"] = np.arctan2(n @ M @ j, j @ M @ j)
            found[f"an{link.item}_{b}"] = np.arctan2(i @ M @ n, i @ M @ i)
        return found

    def states_of(self, table: dict[str, Any]) -> tuple[Any, Any]:
        nt = len(table[str(self.inputs[0])])
        q, u = np.zeros((nt, len(self.prepared.start.q))), np.zeros((nt, len(self.prepared.start.u)))
        for node in self.prepared.model.nodes:
            at = node.u
            for i in range(1 if node.kind is NodeKind.COORDINATE else 3):
                q[:, node.q + i] = table[f"x{at + i}"]
            for i in range(node.kind.sizes[1]):
                u[:, at + i] = table[f"x{at + i}d"]
            if node.kind is not NodeKind.COORDINATE:
                axes = [[np.broadcast_to(self._of(table, c), (nt,)) for c in a] for a in self.placed[node].axes]
                R = np.stack([np.stack(a, -1) for a in axes], -1)
                q[:, node.q + 3 : node.q + 7] = quaternion(R)
        return q, u


def on_axes(axes: Sequence[Vec], a: Vec) -> Vec:
    """A vector by its components along axes."""
    found: Vec = axes[0] * a[0] + axes[1] * a[1] + axes[2] * a[2]
    return found
