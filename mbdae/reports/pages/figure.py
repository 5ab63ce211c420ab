"""Figure of a law between two bodies: their points and frames, l where the motion of a joint takes it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.documents.blocks import Block, Picture
from mbdae.documents.drawing import Drawing
from mbdae.reports.evaluate import value
from mbdae.reports.letters import of_name
from mbdae.reports.statement import Statement
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.motion import motion_of, no_rotation
from mbdae.symbolic.vectors import UNIT

VIEW = np.array([[0.86, 0.5, 0.0], [-0.29, 0.5, 0.82]])  #: directions of the drawing, right and up, for z upwards
ANGLE, LENGTH = 0.6, 0.9  #: at which coordinates are drawn, rad and axis lengths
COLOURS = ("#d55e00", "#009e73", "#0072b2")


def figure_of(s: Statement) -> list[Block]:
    """The two bodies of a law with their frames; nothing for a law on other frames."""
    if s.sides != ("k", "l"):
        return []
    moved, axes, drawn = _pose(s)
    apart = np.array([1.0, 1.4, 0.3]) if not isinstance(s.law, Joint) or not s.law.states_motion() else moved
    found = Drawing(460, 300, "the bodies k and l with their frames")
    places = {"k": np.zeros(3), "l": apart}
    middle = VIEW @ (apart / 2)

    def at(point: Any) -> tuple[float, float]:
        x, y = VIEW @ np.asarray(point) - middle
        return 105 * x, -105 * y

    for side, out in (("k", np.array([-1.25, -0.5, -0.75])), ("l", apart + np.array([0.75, 1.3, -0.55]))):
        c, r = at(out), at(places[side])
        around = [(c[0] + 34 * np.cos(t), c[1] + 22 * np.sin(t)) for t in np.linspace(0, 2 * np.pi, 33)]
        found.line(around, "#999", 1, fill="#f2f2f2")
        found.line([c, r], "#999", 1.5, arrow=True)
        found.text((c[0] + r[0]) / 2 + 8, (c[1] + r[1]) / 2 + 14, rf"$\mathbf{{s}}_{side}$")
        found.text(c[0], c[1] + 4, f"body {side}")
    far = float(np.linalg.norm(apart)) > 1e-9
    if far:
        found.line([at(places["k"]), at(places["l"])], "#333", 1, arrow=not isinstance(s.law, Joint))
    same = {side: np.eye(3) if side == "k" else axes for side in "kl"}
    for side, size in (("k", 1.0), ("l", 0.72)):
        for axis, colour in zip(range(3), COLOURS, strict=True):
            end = at(places[side] + size * same[side][:, axis])
            found.line([at(places[side]), end], colour, 2 if side == "k" else 1.3, arrow=True)
            found.text(end[0] + 9, end[1] - (4 if side == "k" else -9), rf"$\mathbf{{{'xyz'[axis]}}}_{side}$", "middle", colour)
    caption = "The frames of k (long) and l (short), fixed to their bodies"
    given = f", drawn at {', '.join(drawn)}" if drawn else ""
    found.fit()
    return [Picture(found, f"{caption}{given}.")]


def _pose(s: Statement) -> tuple[Any, Any, list[str]]:
    """Displacement and axes (columns) of l for drawn coordinates, and these."""
    law, drawn = s.law, list[str]()
    if not isinstance(law, Joint) or not law.states_motion():
        return np.zeros(3), np.eye(3), drawn
    amounts: dict[str, Any] = {name: ANGLE if spec.unit == "rad" else LENGTH for name, spec in law.scalars().items()}
    drawn += [f"${of_name(n, law.coordinates[n].unit)} = {v:g}$ {law.coordinates[n].unit}" for n, v in amounts.items()]
    values = amounts | {name: no_rotation() for name in law.coordinates.keys() - amounts.keys()}
    motion = motion_of(law.symbolic(s.structure), values)
    assert motion is not None
    moved, axes = motion.pose(UNIT)

    def numbers(a: Any) -> Any:
        return np.array([float(np.real(value(c, lambda symbol: 1.0))) for c in a])

    return numbers(moved), np.stack([numbers(a) for a in axes], axis=1), drawn
