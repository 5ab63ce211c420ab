"""Random states of a law on a line, at which the formulas of its report are compared with the derived equations."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.reports.states import POINTS, STEP, spun
from mbdae.reports.vectors import Base
from mbdae.symbolic.vectors import Expr


class LineState:
    """Random positions, quaternions, their derivatives along the line, parameters and stress resultants."""

    def __init__(self, rng: Any, law: Any, given: dict[str, Any] | None = None) -> None:
        names = ["r1", "r2", "r3", "P1", "P2", "P3", "P4"]
        self.given = given or {n + end: rng.normal(size=POINTS) for n in names for end in ("", "_xi")}
        if given is None:
            P, dP = (np.stack([self.given[f"P{i}{end}"] for i in range(1, 5)]) for end in ("", "_xi"))
            dP = dP - P * np.sum(P * dP, axis=0) / np.sum(P * P, axis=0)
            self.given |= {f"P{i + 1}_xi": dP[i] for i in range(4)}
            self.given |= {f"{n}{end}_t": rng.normal(size=POINTS) for n in names for end in ("", "_xi")}
            self.given |= {"ds": rng.uniform(0.5, 1.5, POINTS), "weight": rng.uniform(0.5, 1.5, POINTS)}
            self.given |= {n: rng.uniform(0.5, 1.5, POINTS) for n in law.params}
            self.given |= {n: rng.normal(size=POINTS) for n in ("N1", "N2", "N3", "M1", "M2", "M3")}
            self.dr, self.dpsi, self.dpsi_s = (rng.normal(size=(POINTS, 3)) for _ in range(3))

    def get(self, symbol: Expr) -> Any:
        """Value of a symbol of the derived law (points,)."""
        return self.given[str(symbol)]

    def _fields(self, end: str = "") -> tuple[Any, Any]:
        return tuple(np.stack([self.given[f"{n}{i}{end}"] for i in range(1, k)], axis=-1) for n, k in (("r", 4), ("P", 5)))  # type: ignore[return-value]

    def atom(self, base: Base) -> Any:
        """Values of a vector of the cross-section (points, 3)."""
        _, P = self._fields()
        slope, _ = self._fields("_xi")
        if base.kind == "rs":
            return slope / self.given["ds"][:, None]
        return _columns(P)[..., "xyz".index(base.kind)]

    def symbol(self, name: str) -> Any:
        """Value of a curvature, parameter or stress resultant by its name (points,)."""
        if name.startswith("kappa"):
            return self._curvature()[:, int(name[-1]) - 1]
        return self.given[name]

    def _curvature(self) -> Any:
        _, P = self._fields()
        _, dP = self._fields("_xi")
        vector = P[:, :1] * dP[:, 1:] - dP[:, :1] * P[:, 1:] - np.cross(P[:, 1:], dP[:, 1:])
        return 2 * vector / np.sum(P * P, axis=-1, keepdims=True) / self.given["ds"][:, None]

    def at_rest(self) -> LineState:
        """This state with all rates zero."""
        return LineState(None, None, {n: 0 * v if n.endswith("_t") else v for n, v in self.given.items()})

    def moving(self) -> LineState:
        """This state after a complex step in time along its rates."""
        return LineState(None, None, {n: v + 1j * STEP * self.given.get(f"{n}_t", 0) for n, v in self.given.items()})

    def changed(self) -> LineState:
        """This state after a complex step along dr', dpsi and dpsi': P changes by (0, dpsi) o P / 2, P' accordingly."""
        _, P = self._fields()
        slope, dP = self._fields("_xi")
        change = spun(self.dpsi, P)
        change_s = spun(self.dpsi, dP) + spun(self.dpsi_s * self.given["ds"][:, None], P)
        given = dict(self.given)
        for i in range(4):
            given[f"P{i + 1}"] = P[:, i] + 1j * STEP * change[:, i]
            given[f"P{i + 1}_xi"] = dP[:, i] + 1j * STEP * change_s[:, i]
        for i in range(3):
            given[f"r{i + 1}_xi"] = slope[:, i] + 1j * STEP * self.dr[:, i] * self.given["ds"]
        return LineState(None, None, given)


def _columns(P: Any) -> Any:
    """Rotation matrices (points, 3, 3) of quaternions, real or complex."""
    n = np.sum(P * P, axis=-1)[:, None, None]
    p0, p = P[:, 0, None, None], P[:, 1:]
    tilde = np.stack([np.cross(p, np.broadcast_to(e, p.shape)) for e in np.eye(3)], axis=-1)
    return np.eye(3) + 2 * (p0 * tilde + tilde @ tilde) / n
