"""Numbers a text claims, counted in systems: unknowns, multipliers, constraints of the models a text speaks of."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mbdae.audit.reading import Claimed
from mbdae.inputs.timed import time_symbol
from mbdae.laws.joints.clearance import ClearanceRevolute
from mbdae.scene.components import Kinematic, Recursive
from mbdae.scene.scene import SceneData
from mbdae.scene.section import Section
from mbdae.symbolic.derive import derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.system.prepare import Prepared, prepare

_SECTION = Section(1e6, 4e5, 4e5, 1e4, 1e4, 1e4, mass_per_length=3.0, rotary_inertia=3e-4)
#: table of the text, left half of the wing, cm
_POINTS = {1: (-4.91071, 0), 2: (-2.25663, 2.38975), 3: (-2.22156, 9.08609), 4: (-0.76893, 12.3488), 5: (-11.4767, 12.7227),
           6: (-44.0461, 13.86), 7: (-45.4988, 10.5974), 8: (-47.5828, 13.363), 9: (-48.0479, 10.7251), 10: (-52.9394, 13.4378),
           11: (-100.256, 14.0985), 12: (-11.539, 10.938)}  # fmt: skip
_LINKS = {"A": (1, 2), "B": (2, 3, 4), "C": (5, 12), "D": (4, 5, 6, 8), "E": (6, 7), "F": (3, 7), "G": (7, 9),
          "H": (9, 8, 10, 11)}  # fmt: skip
_HINGES = ((2, "A", "B"), (3, "B", "F"), (4, "B", "D"), (6, "D", "E"), (7, "E", "F"), (7, "E", "G"), (8, "D", "H"), (9, "G", "H"))


@dataclass(frozen=True)
class Count:
    """A claim with what is counted; None where there is no rule for its words."""

    claimed: Claimed
    counted: int | None
    remark: str = ""

    @property
    def verdict(self) -> str:
        """RIGHT, MISPRINT where the number is another, NOT EVALUABLE."""
        if self.counted is None:
            return "NOT EVALUABLE"
        return "RIGHT" if self.counted == self.claimed.count else "MISPRINT"


def rotor(model: Any) -> SceneData:
    """A block on one slide, a hub and four blades of three cubic elements; `model` of the five revolutes; in space."""
    s = SceneData("rotor on an elastic support", space="spatial")
    block = s.rigid_body("block", 30.0, 1.0, at=(0, 0))
    s.prismatic("support", s.ground, block, at=(0, 0), axis=(1, 0, 0), spring=12000.0, damper=150.0)
    hub = s.rigid_body("hub", 0.0, 1.0, at=(0, 0))
    s.revolute("shaft", block, hub, at=(0, 0), model=model)
    for i in range(4):
        d = np.round([math.cos(i * math.pi / 2), math.sin(i * math.pi / 2)])
        blade = s.beam(f"blade {i + 1}", tuple(0.25 * d), tuple(4.5 * d), section=_SECTION, elements=3, order=3)
        s.revolute(f"lag {i + 1}", hub, blade, at=tuple(0.25 * d), model=model)
    return s


def wing() -> SceneData:
    """Two mirrored chains of four-bars of beams, ten hinges each, two of them driven; all hinges kinematic; in space."""
    s = SceneData("flapping wing", space="spatial")
    for half, mirror in (("L", 1), ("R", -1)):
        at = {n: (0.01 * mirror * x, 0.01 * y) for n, (x, y) in _POINTS.items()}
        b = {name: s.beam(half + name, *(at[n] for n in numbers), section=_SECTION, elements=len(numbers) - 1)
             for name, numbers in _LINKS.items()}  # fmt: skip
        s.weld(half + "5", b["D"], b["C"], at=at[5])
        s.revolute(half + "1", s.ground, b["A"], at=at[1], angle=12.56 * time_symbol())
        s.revolute(half + "12", s.ground, b["C"], at=at[12])
        for n, k, l in _HINGES:
            s.revolute(f"{half}{n} {k}{l}", b[k], b[l], at=at[n])
    return s


def unknowns(prepared: Prepared) -> int:
    """Displacements, rotations and multipliers; a displacement that a revolute makes equal once, without its multiplier."""
    names = {c.name for c in prepared.model.scene.joints if c.kind == "revolute"}
    equal = [row for row in prepared.rows if row.name.rpartition(".")[0] in names and row.name[-2:] in (".x", ".y", ".z")]
    return prepared.all_bodies.nu + len(prepared.rows) - 2 * len(equal)


def _saved() -> tuple[int, str]:
    with_rows, without = (unknowns(prepare(rotor(model))) for model in (Kinematic(), Recursive()))
    return with_rows - without, f"{with_rows} with kinematic, {without} with recursive revolutes, of our model"


def _multipliers() -> tuple[int, str]:
    rows = [row.name for row in prepare(wing()).rows]
    drives = sum(name.endswith(".drive") for name in rows)
    return len(rows), f"{len(rows) - drives} rows of hinges and {drives} of drives"


def _clearance() -> tuple[int, str]:
    sides = ((NodeKind.SPATIAL, Axes.GENERAL),) * 2
    rows = derive(ClearanceRevolute, ClearanceRevolute("clearance", None, None).structure(), sides).rows
    return len(rows), f"rows {', '.join(rows)}"


COUNTS: dict[str, Callable[[], tuple[int, str]]] = {
    "unknowns fewer when the five revolutes of the rotor become recursive": _saved,
    "multipliers of the flapping wing with kinematic revolutes": _multipliers,
    "constraints of the revolute joint with clearance": _clearance,
}


def count(claimed: Claimed) -> Count:
    """What a claim says, counted."""
    if claimed.words not in COUNTS:
        return Count(claimed, None, f"no rule counts this; there are: {'; '.join(COUNTS)}")
    return Count(claimed, *COUNTS[claimed.words]())
