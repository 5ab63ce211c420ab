"""The findings of `Scene.check`: properties of a scene before it is solved."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mbdae.errors import ListsAttributes
from mbdae.laws.on_coordinates import OnCoordinate
from mbdae.notation import counted, lines, titled
from mbdae.run.amplification import ringing_of
from mbdae.run.choice import Choice, Reduction, choose, reductions, with_recursive_joints
from mbdae.scene.components import Beam, Classical, Connection, Recursive
from mbdae.scene.models import not_joined
from mbdae.scene.scene import SceneData
from mbdae.symbolic.joint import Coupling, Joint
from mbdae.system.model.moved_bodies import expressions_of, timeline
from mbdae.system.model.trees import Tree
from mbdae.system.prepare import FORESIGHT, Prepared, prepare
from mbdae.values import Array

if TYPE_CHECKING:
    from mbdae.system.start_of_beams import Ringing

#: a joint whose point is off a rigid link that it holds by more than this fraction of the link's length is reported
OFF = 0.01
#: singular of the words for what `Check.unknowns` counts, for the printed check
_ONE = {"positions": "position", "velocities": "velocity", "states": "state", "multipliers": "multiplier", "stresses": "stress"}


@dataclass(frozen=True)
class Check(ListsAttributes):
    """Findings of `Scene.check`; print it to read them all."""

    prepared: Prepared
    accuracy: float = 1e-6  #: accuracy for which `choice` is made

    @cached_property
    def choice(self) -> Choice:
        """Joints, form and solver that `simulate` takes for this accuracy, with the reason; see `Choice`."""
        stated = self.prepared.model.scene
        return choose(with_recursive_joints(stated) or self.prepared, stated, self.accuracy)

    @cached_property
    def reductions(self) -> list[Reduction]:
        """How the equations become fewer from the naive formulation to the default run; see `mbdae.run.choice`."""
        return reductions(self.prepared.model.scene, self.prepared, self.choice)

    @cached_property
    def ringing(self) -> Ringing | None:
        """What rings because beams start unstrained under load: amplitude, frequency, decay; None where nothing does."""
        return ringing_of(self.prepared)

    @property
    def degrees_of_freedom(self) -> int:
        """Number of degrees of freedom left by the joints and prescribed motions."""
        return self.prepared.rank.degrees_of_freedom

    @property
    def planar(self) -> bool:
        """Whether the scene is modelled in the plane z = 0."""
        return self.prepared.model.planar

    @property
    def redundant(self) -> tuple[str, ...]:
        """Constraint rows that follow from the others, as "joint.row"; they are left out of the equations."""
        return tuple(row.name for row in self.prepared.rank.dropped)

    @property
    def not_unique(self) -> tuple[str, ...]:
        """Constraint rows whose reactions are not unique, as "joint.row": redundant rows could carry a part of their load."""
        return tuple(row.name for row in self.prepared.rank.not_unique)

    @property
    def pruned(self) -> tuple[str, ...]:
        """Constraint equations left out because they hold in every position of this scene, or need axes of a point mass, as
        "joint.row"."""
        return tuple(self.prepared.model.vanished)

    @property
    def unknowns(self) -> dict[str, int]:
        """Numbers of positions, velocities, internal states and multipliers; with beams also of their stress resultants, which
        are unknowns only with Radau IIA."""
        e, states = self.prepared.all_bodies, len(self.prepared.mechanics.numbering.states)
        found = {"positions": e.nq, "velocities": e.nu, "states": states, "multipliers": len(self.prepared.rows)}
        if self.prepared.model.lines:
            found["stresses"] = sum(len(line.stresses) for line in self.prepared.model.lines)
        return found

    @property
    def beams(self) -> dict[str, int]:
        """Number of elements of every flexible beam; attachments between its nodes add elements to those asked for."""
        return {line.beam.name: len(line.mesh.elements) for line in self.prepared.model.lines}

    @property
    def shared(self) -> tuple[str, ...]:
        """Rows of joints at nodes of beams, as "joint.row", that need no equation because the node and the body that the joint
        connects have the same unknowns."""
        rows = self.prepared.all_bodies.moved.sharing.rows
        return tuple(row.name for row in self.prepared.mechanics.rows if (row.group, row.instance, row.row) in rows)

    @property
    def recursive(self) -> tuple[str, ...]:
        """Names of recursive joints: the body that such a joint carries has no unknowns but the joint's coordinates."""
        return tuple(c.name for c in self.prepared.model.recursive)

    @property
    def rigid(self) -> tuple[str, ...]:
        """Welds, and joints that hold a point mass: their body moves with the other one and needs no unknowns."""
        return tuple(name for tree in self.prepared.all_bodies.moved.trees for name in tree.rigid)

    @property
    def remarks(self) -> dict[str, str]:
        """Remarks of joints on their own parameters, by joint, such as that a screw is self-locking."""
        said = {c.name: c.joint.remarks() for c in self.prepared.model.scene.joints if isinstance(c.joint, Joint)}
        return {name: "; ".join(texts) for name, texts in said.items() if texts}

    @property
    def kept_kinematic(self) -> dict[str, str]:
        """Joints stated as recursive, and welds, that keep their constraint equations, each with the reason."""
        return dict(self.prepared.model.stay_kinematic)

    @property
    def kept_coordinates(self) -> dict[str, str]:
        """Joints with the kinematic model, which has no coordinates as unknowns, that have them all the same, each with the
        reason."""
        found = {}
        for c in self.prepared.model.scene.joints:
            if c.kept and not isinstance(c.model, Classical | Recursive):
                found[c.name] = why_kept(c, [o for o in self.prepared.model.scene.connections if isinstance(o.joint, Coupling)])
        return found

    @property
    def not_joined(self) -> tuple[str, ...]:
        """Names of bodies that no chain of joints connects with the ground: free bodies, or ones whose joint was forgotten."""
        return not_joined(self.prepared.model.scene)

    @property
    def off_links(self) -> dict[str, dict[str, float]]:
        """Distances (m) of points of joints from the rigid links that they hold, by joint and link, where they are above OFF of
        the link's length: a bracket that is not drawn, or a mistaken coordinate."""
        found: dict[str, dict[str, float]] = {}
        for c in self.prepared.model.scene.joints:
            at = c.joint.at
            for body, point in () if at is None else ((c.k, at), (c.l, at if c.joint.at_l is None else c.joint.at_l)):
                ends = np.asarray(body.outline)
                if len(ends) > 1 and not isinstance(body, Beam):
                    away = _distance(np.asarray(point), ends)
                    if away > OFF * float(np.sum(np.linalg.norm(np.diff(ends, axis=0), axis=1))):
                        found.setdefault(c.name, {})[body.name] = away
        return found

    def __repr__(self) -> str:
        scene = self.prepared.model.scene
        return (f"<Check of '{scene.name}': {'planar' if self.planar else 'spatial'}, bodies {len(scene.bodies)}, "
                f"joints {len(scene.joints)}, degrees of freedom {self.degrees_of_freedom}; print it for more>")

    def _repr_html_(self) -> str:
        title, _, rest = str(self).partition("\n")
        return titled(title, lines(rest))

    def __str__(self) -> str:
        p, scene = self.prepared, self.prepared.model.scene
        beams = f", {counted(len(self.beams), 'flexible beam')} among them" if self.beams else ""
        loads = f", {counted(len(scene.line_loads), 'distributed load')}" if scene.line_loads else ""
        couplings = sum(isinstance(c.joint, Coupling) for c in scene.connections)
        forces = len(scene.connections) - len(scene.joints) - couplings
        coupled = f"{counted(couplings, 'coupling')}, " if couplings else ""
        lines = [f"scene '{scene.name}': {counted(len(scene.bodies), 'body')}{beams}, "
                 f"{counted(len(scene.joints), 'joint')}, {coupled}{counted(forces, 'force element')}{loads}",
                 f"  {'planar' if self.planar else 'spatial'}: {p.model.why}",
                 f"  degrees of freedom: {self.degrees_of_freedom}",
                 "  unknowns: " + ", ".join(counted(n, _ONE[kind]) for kind, n in self.unknowns.items() if n)]
        lines += [f"  not joined to the ground: {_listed(self.not_joined)}"] if self.not_joined else []
        lines += self._of_joints()
        lines += self._of_beams()
        lines += self._of_recursive_joints()
        lines += [f"  contact: {names} with {text}"
                  for names, text in _grouped((f"'{contact.item}'", contact.summary()) for contact in p.contacts)]
        lines += self._of_friction()
        lines += [f"  {names}: {text}" for names, text in _grouped((f"joint '{c}'", text) for c, text in self.remarks.items())]
        lines += [f"  joint '{name}': its point is {away:.3g} m beside the link '{link}'"
                  for name, links in self.off_links.items() for link, away in links.items()]
        flat = [b.name for _, b in p.model.bodies if b.principal_plane] if not self.planar else []
        lines += [f"  inertia that is one number counts about z alone: {_listed(flat)}"] if flat else []
        lines += self._of_inputs()
        lines += _by_joint("  constraint equations left out because they follow from the others", self.redundant)
        lines += _by_joint("  reactions not unique", self.not_unique)
        undefined = tuple(p.model.undefined)
        always = tuple(row for row in self.pruned if row not in undefined)
        lines += _by_joint("  constraint equations left out because they hold in every position", always)
        lines += _by_joint("  constraint equations left out because a point mass has no axes", undefined)
        for row in p.rank.singular_here:
            lines.append(f"  constraint equation dependent on others at the start only: {row.name}; the scene starts in a "
                         "singular position")
        lines += [f"  {note}" for note in doubts(p)]
        if p.rows:
            lines.append(f"  smallest singular value of the constraints (rows of unit length): {p.rank.smallest:.2g}")
        lines += [f"  start: {change}" for change in (*p.start.changes, self.ringing) if change]
        lines.append(f"  length {p.length:.4g} m, characteristic time {p.time:.4g} s")
        steps = ", ".join(f"{r.size.unknowns} ({r.reason.split(': ')[0]})" for r in self.reductions)
        lines.append(f"  unknowns, multipliers included, from the full equations to those that are solved: {steps}")
        lines.append(f"  to an accuracy of {self.accuracy:g}: {self.choice}")
        return "\n".join(lines)

    def _of_joints(self) -> list[str]:
        """Lines on the joints by model, with their coordinates, and on coordinates that are unknowns nevertheless."""
        models: dict[str, list[tuple[str, str]]] = {}
        for c in self.prepared.model.scene.joints:
            model = type(c.model).__name__.lower() if c.has_models else "without coordinates"
            models.setdefault(model, []).append((c.name, _coordinates(c)))
        lines = [f"  joints, {model}: " + "; ".join(names + text for names, text in _grouped(joints))
                 for model, joints in models.items()]
        kept = _grouped(self.kept_coordinates.items())
        return lines + [f"  coordinates kept as unknowns: {names}: {why}" for names, why in kept]

    def _of_beams(self) -> list[str]:
        """Lines of the printed check on beams: their meshes, and with which solvers their stress resultants are unknowns."""
        lines = self.prepared.model.lines
        if not lines:
            return []
        meshes = _grouped((line.beam.name, f"{counted(len(line.mesh.elements), 'element')} of order {line.mesh.order}, "
                           f"{len(line.nodes)} nodes") for line in lines)
        return [f"  beams: {'; '.join(f'{names} ({text})' for names, text in meshes)}",
                "  stresses: unknowns with Radau IIA; other solvers eliminate them by the compliance of the sections",
                *_by_joint("  without equations, unknowns shared with a node of a beam", self.shared)]

    @property
    def contacts(self) -> tuple[str, ...]:
        """Joints with clearance: a sentence for each on its contact law and the effects this neglects."""
        return tuple(f"'{contact.item}' with {contact.summary()}" for contact in self.prepared.contacts)

    @property
    def friction(self) -> dict[str, str]:
        """Friction law of every ideal joint that has one: its name, normal force and internal states."""
        found = {}
        for g, _, instance in self.prepared.model.instances():
            law, own = instance.law, self.prepared.model.groups[g].derived.reactive
            friction = getattr(law, "friction", None)
            if friction is None or not (own or getattr(law, "normal_force", None) is not None):
                continue
            normal = "the joint's reaction" if own else f"{law.normal_force:g} N"
            states = f", state {', '.join(friction.states)}" if friction.states else ""
            found[instance.item] = f"{type(friction).__name__}, normal force {normal}{states}"
        return found

    def _of_friction(self) -> list[str]:
        laws = "; ".join(f"{names} ({text})" for names, text in _grouped(self.friction.items()))
        return [f"  friction: {laws}"] if laws else []

    def _of_inputs(self) -> list[str]:
        """Line on jumps, kinks and shortest widths of the inputs of time in the first seconds, since the end of a run is not
        known here."""
        t0 = self.prepared.start.t
        if not expressions_of(self.prepared.model):
            return []
        found = timeline(self.prepared.model, t0, t0 + FORESIGHT)
        return [f"  inputs of time, first {FORESIGHT:g} s: {found.summary() if found else 'smooth, no breaks'}"]

    def _kernels_of(self, tree: Tree) -> str:
        """How the equations of a tree are evaluated, in words."""
        bodies = self.prepared.all_bodies
        kernels, operations = bodies.moved.passes(bodies.numbering, tree).size
        return f"{operations} operations " + (f"by {kernels} functions of single joints" if bodies.moved.ordered else
                                              "in one program")

    def _of_recursive_joints(self) -> list[str]:
        """Lines on the trees of recursive joints with operation counts, and on joints that keep their constraint equations."""
        lines = []
        for tree in self.prepared.all_bodies.moved.trees:
            root = tree.nodes[0].name if tree.nodes[0] is not None else "ground"
            names = _listed([c.name for c in tree.coordinates]) or "none"
            welded = f"; rigid: {_listed(list(tree.rigid))}" if tree.rigid else ""
            lines.append(f"  recursive joints, from '{root}' outwards: {names}{welded}; "
                         f"their bodies have no unknowns: {_listed([n.name for n in tree.nodes[1:] if n])} "
                         f"({self._kernels_of(tree)})")
        kept = _grouped(self.kept_kinematic.items())
        return lines + [f"  constraint equations kept for {names}: {why}" for names, why in kept]


def why_kept(c: Connection, couplings: list[Connection]) -> str:
    """Why the coordinates of a joint are unknowns although its joint model (kinematic) does not make them unknowns."""
    law: Any = c.joint
    if law.must_keep():
        return "without them the joint has no constraint equations"
    coupled = [o.name for o in couplings if any(joint == c.name for joint, _ in o.joint.coordinates_in(o.name))]
    if coupled:
        return f"the coupling {_listed(coupled)} counts their whole turns"
    if c.prescribed and type(law).ties is Joint.ties:
        return "without them the joint has no constraint equation that prescribes a coordinate"
    acting = [type(part).__name__.removeprefix("Joint").lower() for part in c.laws if isinstance(part, OnCoordinate)]
    acting += ["friction"] if c.rubs else []
    return ("the joint has no method `coordinate` that computes from the bodies the one of its "
            f"{_listed(list(dict.fromkeys(acting)))}")


def _coordinates(c: Connection) -> str:
    """The coordinates of a joint in brackets, with prescribed ones marked."""
    names = [name + (" prescribed" if name in c.prescribed else "") for name in c.coordinates]
    return f" ({', '.join(names)})" if names else ""


def doubts(p: Prepared) -> list[str]:
    """Warnings about constraint rows that are nearly redundant, whether they were kept or left out."""
    dropped = set(p.rank.dropped)
    left_out = ("is nearly redundant (only {:.1e} of it is independent of the others: joints are misaligned by about that "
                "many rad) and was left out: kept, it would lock the mechanism; align the joints if that is not meant")
    found = [f"constraint row {row.name} {left_out.format(size)}" for row, size in p.rank.doubtful if row in dropped]
    return found + [f"{text}; its reaction is uncertain" for text in p.rank.locking]


def _listed(names: Sequence[str]) -> str:
    """Names joined by commas, at most twelve of them."""
    return ", ".join(names[:12]) + (f", ... ({len(names)} in all)" if len(names) > 12 else "")


def _grouped(said: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """From names, each with a text: the names of every text, listed, and the text."""
    names: dict[str, list[str]] = {}
    for name, text in said:
        names.setdefault(text, []).append(name)
    return [(_listed(of_text), text) for text, of_text in names.items()]


def _by_joint(title: str, names: tuple[str, ...]) -> list[str]:
    rows: dict[str, list[str]] = {}
    for name in names:
        joint, row = name.rsplit(".", 1)
        rows.setdefault(joint, []).append(row)
    if not rows:
        return []
    said = _grouped((joint, ", ".join(r)) for joint, r in rows.items())
    return [title + ": " + "; ".join(f"{joints} ({r})" for joints, r in said)]


def check_scene(scene: SceneData, accuracy: float = 1e-6) -> Check:
    """Check a scene for an accuracy; raises SceneError with every problem found."""
    return Check(prepare(scene), accuracy)


def _distance(point: Array, ends: Array) -> float:
    """Distance (m) of a point (3,) from the straight pieces between `ends` (n, 3)."""
    along, to = np.diff(ends, axis=0), point - ends[:-1]
    part = np.clip(np.sum(to * along, axis=1) / np.sum(along * along, axis=1), 0.0, 1.0)
    return float(np.min(np.linalg.norm(to - part[:, None] * along, axis=1)))
