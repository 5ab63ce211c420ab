"""What `s.tree()` returns: compiled functions of (q, v, a) over batches of states."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import ArrayLike, NDArray

from mbdae.disk.entries import key_of
from mbdae.errors import LawError, OptionError, SceneError, unknown_name
from mbdae.kernels import Kernel
from mbdae.laws.joint_rows import Free
from mbdae.robots.couplings import FLOATS, NOTHING_MOVED, Coordinate, Folded, first_of, folded_of, refuse_singular, singular
from mbdae.robots.tree import UNIT, JointSpaceProgram
from mbdae.scene.models import spanning_tree
from mbdae.scene.record import item_name, without
from mbdae.symbolic.joint import Coupling
from mbdae.symbolic.vectors import Expr, Vec, rate_from_body_spin
from mbdae.system.model.model import Model, build
from mbdae.system.model.trees import find_trees, lumped
from mbdae.threads import single_threaded

Array = NDArray[np.float64]
#: LLVM's level of optimisation, and number of steps and outputs of a function from which on it is not optimised: that takes 2 s
#: for these and grows with their square, 7 s for 8000; without it, .5 s, calls take 1.6 to 2.7 times as long: 500 000 make it up
LEVEL, OPTIMISED = 2, 7_000
FAINT = 1e-200  #: what finite inputs are multiplied by in the number that tells of wrong ones
WRONG = (2 * UNIT) ** 2  #: of that number: the square of how far squares of quaternions may be from 1
WORDS = {"q": "q", "v": "v", "a": "a", "t": "tau", "p": "at"}  #: of the inputs of functions
ORIGIN = (0.0, 0.0, 0.0)
FRICTION = ("friction", "radius", "normal_force")  #: words of a joint's statement that state its friction


class Tree:
    """Joint-space dynamics of a scene: M(q) a + bias(q, v) = tau. Arrays are one state (n,) or batches (..., n).

    Results carry no error estimate: they are closed expressions, exact up to rounding. Measured on nine robots at 100 states
    beside Pinocchio: 1e-14 of the largest entry, forward dynamics 1e-12; this grows with the condition number of M.

    names: joints in the order of q, base outwards, in the order of the scene; a body that no joint carries stands there by its
    name. coordinates: names of the entries of v, "J.angle"; q differs where a joint turns freely: it then has a quaternion
    (w, x, y, z) and v the angular velocity (3,), in axes that turn with the body and are the inertial ones as drawn, whatever the
    axes of its link. A floating body has x, y, z of its point in inertial axes, then this quaternion; v likewise. zero (nq,): q
    of the drawing or the file's zero. follows: coordinates that a coupling (a mimic joint) makes multiples of others, folded in
    and left out; closing: joints that close loops, which are no part of the tree.

    tau: forces (N) and torques (N m) along v. Of the scene's forces gravity alone counts; springs, dampers, friction, limits and
    loads act in runs. Where `at` is asked: in the axes of the link from its origin in the file, or from the centre as drawn."""

    @single_threaded
    def __init__(self, scene: Any) -> None:
        origins = {name: f.point for name, f in scene.frames.items() if f.body.name == name}
        moving = moving_scene(scene, origins)
        self._carriers, welds = lumped(moving)
        model, trees = _treed(moving)
        order = ordered(moving, trees)
        folded, couplings = folded_of(moving, set(order))
        self._coordinates = coordinates_of(model, order, folded)
        if not self._coordinates:
            raise SceneError([f"scene '{scene.name}': no joint moves, so that there is no joint space; state joints with "
                              f"coordinates"])
        self._program = JointSpaceProgram(model, self._coordinates, folded)
        self.scene = scene
        self.names = tuple(dict.fromkeys(c.joint.removesuffix(FLOATS.format("")) for c in self._coordinates))
        self.coordinates = tuple(entry for c in self._coordinates for entry in (
            [f"{c.joint}.{c.name}"] if c.nv == 1 else [f"{c.joint}.{c.name}[{i}]" for i in range(c.nv)]))
        self.nq, self.nv = sum(c.nq for c in self._coordinates), sum(c.nv for c in self._coordinates)
        self.zero = np.concatenate([np.eye(4)[0] if c.nq == 4 else np.zeros(1) for c in self._coordinates])
        self.zero.flags.writeable = False
        self.follows = tuple(f"{joint}.{name}" for joint, name in folded)
        inside = {name for tree in trees for name in tree.names} | couplings | welds
        self.closing = tuple(c.name for c in ties(scene) if c.name not in inside)
        self._frames, self._bodies = scene.frames, {b.name: b for b in (scene.ground, *scene.bodies)}
        self._made: dict[Any, tuple[Any, Any, int, tuple[int, ...]]] = {}
        self._firsts = [c.q for c in self._coordinates if c.nq == 4]
        self._quaternions = np.array([range(c.q, c.q + 4) for c in self._coordinates if c.nq == 4], dtype=np.intp)

    def __repr__(self) -> str:
        return f"<Tree of scene '{self.scene.name}': {self.nv} degrees of freedom, exact up to rounding; {', '.join(self.names)}>"

    # -- dynamics

    def mass_matrix(self, q: ArrayLike) -> Array:
        """M(q) (..., nv, nv), kg m^2, kg m or kg by the coordinates."""
        return self._at("mass_matrix", lambda p: [e for row in p.mass() for e in row], "q", (self.nv, self.nv), q)

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """tau (..., nv) that gives accelerations a at q and v."""
        return self._at("inverse_dynamics", lambda p: p.inverse(), "qva", (self.nv,), q, v, a)

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """`inverse_dynamics` without accelerations: Coriolis, centrifugal and gravity terms, (..., nv)."""
        return self._at("bias", lambda p: p.at_rest(p.inverse(), p.a), "qv", (self.nv,), q, v)

    def gravity(self, q: ArrayLike) -> Array:
        """tau (..., nv) that holds the bodies at rest against gravity."""
        return self._at("gravity", lambda p: p.at_rest(p.inverse(), [*p.a, *p.v]), "q", (self.nv,), q)

    def forward_dynamics(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> Array:
        """Accelerations a (..., nv) for forces tau at q and v."""
        try:
            return self._at("forward_dynamics", lambda p: p.forward(), "qvt", (self.nv,), q, v, tau)
        except LawError as error:  # a division by 0, seen when compiling
            raise SceneError([singular(self, self.zero) or "a coordinate: " + NOTHING_MOVED.format("")]) from error

    def _interpreted(self, q: Array, v: Array, a: Array) -> Array:
        """`inverse_dynamics` of several states, without compiling, which takes longer than some evaluations."""
        return self._kernel(lambda p: p.inverse(), "qva")[0].once(np.concatenate((q, v, a), axis=-1))[..., :-1]

    # -- frames

    def jacobian(self, link: str, q: ArrayLike, at: ArrayLike = ORIGIN) -> Array:
        """J(q) (..., 6, nv) of a point of a link: J v is its velocity (m/s), then the angular velocity (rad/s), inertial axes. at
        (3,) m, in the axes of the link from its origin in the file, or of the body from its centre."""
        return self._at(("jacobian", self._link(link)), lambda p: [e for row in p.jacobian(*self._frame(link)) for e in row],
                        "qp", (6, self.nv), q, at)

    def jacobian_rate(self, link: str, q: ArrayLike, v: ArrayLike, at: ArrayLike = ORIGIN) -> Array:
        """dJ/dt (..., 6, nv) along v: the acceleration of the point is J a + dJ/dt v."""
        def rate(p: JointSpaceProgram) -> list[Expr]:
            entries = [e for row in p.jacobian(*self._frame(link)) for e in row]
            return p.made.program.along(entries, changes(p, self._coordinates))

        return self._at(("jacobian_rate", self._link(link)), rate, "qvp", (6, self.nv), q, v, at)

    def pose(self, link: str, q: ArrayLike, at: ArrayLike = ORIGIN) -> Array:
        """(..., 3, 4): axes of the link as columns, then the position (m) of its point `at`, inertial."""
        def placed(p: JointSpaceProgram) -> list[Expr]:
            _, axes, point = p.motion(*self._frame(link))
            return [e for row, x in zip(axes, point, strict=True) for e in (*row, x)]

        return self._at(("pose", self._link(link)), placed, "qp", (3, 4), q, at)

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links: the ground, bodies of the scene, and frames, as which links of a file without mass are read."""
        return tuple(dict.fromkeys([*self._bodies, *self._frames]))

    def _link(self, link: Any) -> str:
        name = getattr(link, "name", link)
        if not isinstance(name, str) or name not in self.links:
            raise OptionError(f"link = {unknown_name(str(name), self.links)} the links are {', '.join(self.links)}")
        return name

    def _frame(self, link: Any) -> tuple[str, Array, Array]:
        """Body that carries a link, place of its origin from the centre of the body and its axes, in axes of the body."""
        name = self._link(link)
        f = self._frames.get(name)
        own, point, axes = (f.body.name, f.point, f.axes) if f is not None else (
            name, self._bodies[name].drawn.position, self._bodies[name].drawn.rotation)
        carrier = self._carriers[own]
        R = carrier.drawn.rotation
        return carrier.name, R.T @ (point - carrier.drawn.position), R.T @ axes

    # -- evaluation

    def _at(self, key: Any, outputs: Any, heads: str, shape: tuple[int, ...], *given: ArrayLike) -> Array:
        found = self._made.get(key)
        if found is None:
            found = self._made[key] = self._compiled(outputs, heads)
        one, many, width, sizes = found
        try:
            x = np.concatenate(given)
            if tuple(map(len, given)) != sizes:  # type: ignore[arg-type]
                raise ValueError
            out = np.empty(width)
            one(x, out)  # refuses what is no vector of floats
        except (ValueError, TypeError):
            x = self._batch(heads, sizes, given)
            self._refuse(x, heads, sizes)
            out = np.empty((*x.shape[:-1], width))
            if out.size:
                many(x, out=out)
            if heads == "qvt":
                refuse_singular(self, x, ~(np.abs(out[..., -1]) < WRONG))
            return out[..., :-1].reshape(*x.shape[:-1], *shape)
        if not -WRONG < out.item(-1) < WRONG:
            self._refuse(x, heads, sizes)
            if heads == "qvt":
                refuse_singular(self, x, np.True_)
        return out[:-1] if len(shape) == 1 else out[:-1].reshape(shape)

    def _batch(self, heads: str, sizes: Sequence[int], given: Sequence[ArrayLike]) -> Array:
        """One row (..., inputs) for every state; what is given once counts for all."""
        parts: list[Array] = []
        for head, n, value in zip(heads, sizes, given, strict=True):
            try:
                if np.iscomplexobj(value):
                    raise TypeError
                part = np.asarray(value, dtype=float)
            except (ValueError, TypeError) as error:
                raise OptionError(f"{WORDS[head]} is no array of real numbers; give ({n},), or (..., {n}) for several "
                                  f"states") from error
            if part.ndim == 0 or part.shape[-1] != n:
                raise OptionError(f"{WORDS[head]} has the shape {part.shape}; give ({n},), or (..., {n}) for several states, in "
                                  f"the order of {'names' if head == 'q' else 'coordinates' if head != 'p' else 'the axes'}")
            parts.append(part)
        try:
            many = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
        except ValueError as error:
            shapes = ", ".join(f"{WORDS[h]} {p.shape}" for h, p in zip(heads, parts, strict=True))
            raise OptionError(f"numbers of states differ: {shapes}; give as many of each, or one") from error
        return np.ascontiguousarray(np.concatenate([np.broadcast_to(p, (*many, p.shape[-1])) for p in parts], axis=-1))

    def _refuse(self, x: Array, heads: str, sizes: Sequence[int]) -> None:
        """Refuse numbers that are not finite, and quaternions of another length than 1."""
        bad = ~np.isfinite(x)
        if np.any(wrong := bad.any(axis=-1)):
            row, where = first_of(wrong, "")
            n, first = int(np.argmax(bad[row])), np.cumsum([0, *sizes])
            of = int(np.searchsorted(first, n, side="right")) - 1
            raise OptionError(f"{WORDS[heads[of]]} has an entry that is not finite, {self._entry(heads[of], n - int(first[of]))}"
                              f"{where}; give finite numbers")
        if not self._firsts:
            return
        off = np.abs(np.sqrt((x[..., self._quaternions] ** 2).sum(axis=-1)) - 1)
        if np.any(wrong := (off > UNIT).any(axis=-1)):
            row, where = first_of(wrong, "")
            n = int(np.argmax(off[row]))
            entries = self._quaternions[n].tolist()
            raise OptionError(f"q holds a quaternion whose length differs from 1 by {off[row][n]:.3g}, that of "
                              f"{self._entry('q', entries[0])[:-2].partition(' of ')[2]}{where}; divide it by its length "
                              f"(entries {entries} of q, in the order w, x, y, z)")

    def _entry(self, head: str, n: int) -> str:
        """An entry of an input as messages name it: its place, and the coordinate."""
        if head == "p":
            return f"at[{n}]"
        if head != "q":
            return f"{WORDS[head]}[{n}] of {self.coordinates[n]}"
        c = next(c for c in self._coordinates if c.q <= n < c.q + c.nq)
        return f"q[{n}] of {c.joint}.{c.name}" + (f".{'wxyz'[n - c.q]}" if c.nq == 4 else "")

    @single_threaded
    def _compiled(self, outputs: Any, heads: str) -> tuple[Any, Any, int, tuple[int, ...]]:
        """A function of one state, one of several, the number of outputs, and those of inputs."""
        kernel, sizes = self._kernel(outputs, heads)
        return kernel.compiled.unsafe_real, kernel.compiled, kernel.width, sizes

    def _kernel(self, outputs: Any, heads: str) -> tuple[Kernel, tuple[int, ...]]:
        """A function of states, and the numbers of its inputs. Its last output tells whether the inputs are to be looked at: it
        is beyond WRONG where one is not finite or a quaternion has not the length 1."""
        p = self._program
        known = {"q": p.q, "v": p.v, "a": p.a, "t": p.tau, "p": p.at}
        symbols, program = [s for head in heads for s in known[head]], p.made.program
        found = [se.sympify(e) for e in outputs(p)]
        lengths = [sum(c * c for c in p.q[i : i + 4]) - 1 for i in self._firsts]
        found.append(FAINT * sum(symbols) + sum(e * e for e in lengths) + p.weak)
        needed = program.needed(found)
        said = [f"{name} = {program.steps[name]}" for name in needed]  # closed, they would be written out in full
        key = key_of("joint space", str(symbols), *said, str(found))
        level = LEVEL if len(needed) + len(found) < OPTIMISED else 0
        kernel = Kernel(symbols, partial(program.by_pairs, found), level, len(found), key)
        return kernel, tuple(len(known[head]) for head in heads)


def moving_scene(scene: Any, origins: dict[str, Any]) -> Any:
    """A copy of a scene whose joints are recursive where they form trees; bodies that no joint carries move by a free joint.
    origins: points of bodies, as drawn, at which such a joint is; by default the centre."""
    if scene.problems:
        raise SceneError(list(scene.problems))
    made = scene._copied()
    rubbing = {c.name for c in made.joints if c.rubs}  # friction that follows from reactions would keep a joint out of trees
    if rubbing:
        made.statements[:] = [without(one, FRICTION) if item_name(one) in rubbing else one for one in made.statements]
        made = made._copied()
    for root in spanning_tree(made).roots:
        if root is not made.ground:
            at = origins.get(root.name, root.drawn.position)
            made.joint(Free, FLOATS.format(root.name), made.ground, root, at=at, axis=(0, 0, 1), axis_x=(1, 0, 0))
    if made.problems:
        raise SceneError(list(made.problems))
    made = made.recursive()
    made.connections[:] = ties(made)  # other forces, and what they read, are no part of joint-space dynamics
    for c in made.connections:
        del c.laws[1:]
    made.signals.clear()
    made.controllers.clear()
    return made


def _treed(scene: Any) -> tuple[Model, list[Any]]:
    """Model and trees of a scene. SceneError where beams, or bodies that constraints without coordinates hold, are in none of the
    trees; a planar scene is looked at in space, too, where balls have coordinates."""
    for space in dict.fromkeys((scene.space, "spatial" if scene.space == "auto" else scene.space)):
        scene.space = space
        trees = find_trees(model := build(scene))
        inside = {n.name for tree in trees for n in tree.nodes if n is not None}
        left = [b.name for b in scene.bodies if b.name not in inside] + [line.beam.name for line in model.lines]
        if not trees or not left:
            return model, trees
    raise SceneError([f"scene '{scene.name}': no tree of joints carries {', '.join(map(repr, dict.fromkeys(left)))}; give such "
                      f"bodies joints with coordinates, or a bushing alone, and leave beams out of these dynamics"])


def ties(scene: Any) -> list[Any]:
    """Joints and couplings of a scene."""
    return [c for c in scene.connections if c.is_joint or isinstance(c.laws[0], Coupling)]


def coordinates_of(model: Model, order: list[str], folded: dict[tuple[str, str], Folded]) -> list[Coordinate]:
    """The coordinates of joints named in their order; folded ones are left out."""
    found: list[Coordinate] = []
    q = v = 0
    for name in order:
        joint = model.scene[name]
        for c in joint.coordinates:
            if (name, c) in folded:
                continue
            nq, nv = (4, 3) if joint.unit(c) == "rotation" else (1, 1)
            found.append(Coordinate(name, c, q, v, nq, nv))
            q, v = q + nq, v + nv
    return found


def changes(p: JointSpaceProgram, coordinates: Sequence[Coordinate]) -> dict[Expr, Expr]:
    """Rate of every entry of q at velocities v."""
    found: dict[Expr, Expr] = {}
    for c in coordinates:
        q, v = p.q[c.q : c.q + c.nq], p.v[c.v : c.v + c.nv]
        found |= dict(zip(q, rate_from_body_spin(q, Vec(*v)) if c.nq > c.nv else v, strict=True))
    return found


def ordered(scene: Any, trees: list[Any]) -> list[str]:
    """Names of the joints of trees, base outwards, in the order of the scene."""
    carried: dict[str, str] = {}  #: joint -> the joint that carries its parent
    for tree in trees:
        for name, link in zip(tree.names, tree.structure.links, strict=True):
            carried[name] = tree.names[link.parent - 1] if link.parent else ""
    done: dict[str, None] = {}

    def take(name: str) -> None:
        if name and name not in done:
            take(carried[name])
            done[name] = None

    floats = [name for name in carried if name.endswith(FLOATS.format(""))]
    for name in (*floats, *(c.name for c in scene.joints if c.name in carried)):
        take(name)
    return list(done)
