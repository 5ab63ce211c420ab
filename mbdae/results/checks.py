"""What can be said of a scene before it is solved."""

from __future__ import annotations

from dataclasses import dataclass

from mbdae.scene.scene import SceneData
from mbdae.system.prepare import Prepared, prepare


@dataclass(frozen=True)
class Check:
    """Findings of `Scene.check`; `print` it."""

    prepared: Prepared

    @property
    def degrees_of_freedom(self) -> int:
        """Freedoms left by the joints and prescribed motions."""
        return self.prepared.rank.degrees_of_freedom

    @property
    def planar(self) -> bool:
        """Whether the scene is modelled in the plane z = 0."""
        return self.prepared.model.planar

    @property
    def redundant(self) -> tuple[str, ...]:
        """Constraint rows that say nothing new, "joint.row"; they are left out."""
        return tuple(row.name for row in self.prepared.rank.dropped)

    @property
    def not_unique(self) -> tuple[str, ...]:
        """Constraint rows whose reactions are not unique, "joint.row": the redundant rows could share them."""
        return tuple(row.name for row in self.prepared.rank.not_unique)

    @property
    def pruned(self) -> tuple[str, ...]:
        """Rows that vanish identically for this scene, "joint.row"."""
        return tuple(self.prepared.model.vanished)

    @property
    def unknowns(self) -> dict[str, int]:
        """Number of positions, velocities, internal states and multipliers."""
        m = self.prepared.mechanics
        return {"positions": m.nq, "velocities": m.nu, "states": len(m.numbering.states), "multipliers": m.m}

    def __str__(self) -> str:
        p, scene = self.prepared, self.prepared.model.scene
        lines = [f"scene '{scene.name}': {len(scene.bodies)} bodies, {len(scene.joints)} joints, "
                 f"{len(scene.connections) - len(scene.joints)} force elements",
                 f"  {'planar' if self.planar else 'spatial'}: {p.model.why}",
                 f"  degrees of freedom: {self.degrees_of_freedom}",
                 "  unknowns: " + ", ".join(f"{n} {kind}" for kind, n in self.unknowns.items() if n)]  # fmt: skip
        lines += _by_joint("  redundant, left out", self.redundant)
        lines += _by_joint("  reactions not unique", self.not_unique)
        lines += _by_joint("  pruned, zero in every position", self.pruned)
        for row in p.rank.singular_here:
            lines.append(f"  dependent at the start only: {row.name}; the scene starts in a singular position")
        for row, size in p.rank.doubtful:
            lines.append(f"  nearly redundant at the start: {row.name} ({size:.1e}), kept")
        lines.append(f"  smallest singular value of the constraints (rows of unit length): {p.rank.smallest:.2g}")
        lines += [f"  start: {change}" for change in p.start.changes]
        lines.append(f"  length {p.length:.4g} m, characteristic time {p.time:.4g} s")
        return "\n".join(lines)


def _by_joint(title: str, names: tuple[str, ...]) -> list[str]:
    rows: dict[str, list[str]] = {}
    for name in names:
        joint, row = name.rsplit(".", 1)
        rows.setdefault(joint, []).append(row)
    if not rows:
        return []
    return [title + ": " + "; ".join(f"{joint} ({', '.join(r)})" for joint, r in rows.items())]


def check_scene(scene: SceneData) -> Check:
    """Check a scene; raises SceneError with every problem found."""
    return Check(prepare(scene))
