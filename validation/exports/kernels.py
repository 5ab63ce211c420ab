"""The equations of a scene as its compiled kernels evaluate them, beside exported functions of the same name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

import mbdae as mb
from mbdae.formulations import default_form, system_for
from mbdae.results.sensors import reaction_outputs
from mbdae.symbolic.outputs import coordinate
from mbdae.system.assembled.right_hand_side import Rates
from mbdae.system.prepare import prepare


class Kernels:
    """The equations of a scene as they are integrated, at a state."""

    def __init__(self, scene: Any, form: Any) -> None:
        self.prepared = prepare(scene)
        self.system = system_for(self.prepared, form or default_form(self.prepared))
        # accelerations and multipliers from the equations as a whole: see the README
        self.whole = Rates(self.system.full, self.system.n, True) if hasattr(self.system, "full") else None
        self.items = [c.name for c in self.prepared.model.scene.connections]
        # without Baumgarte's terms; multipliers are derivatives, 0 as all of y' below
        self.bare = system_for(self.prepared, mb.Index1(0.0, "derivatives") if self.prepared.rows else mb.ODE())

    def __call__(self, t: float, y: Any, yp: Any) -> dict[str, Any]:
        system, n = self.system, self.system.n
        found = {"residual": np.empty(n), "rates": np.empty(n)}
        if self.whole is not None:
            self.whole.solve(t, y, found["rates"])
            found["residual"], found["jacobian"] = yp - found["rates"], [-self.whole.jacobian(t, y, found["rates"]), np.eye(n)]
        else:
            system.residual(t, y, yp, found["residual"])
            if system.rhs is not None:
                system.rhs(t, y, found["rates"])
            found["jacobian"] = [self.dense(part) for part in system.jacobian_parts(t, y, yp)]
        found["joint_forces"] = self.forces(np.array([t]), y, yp)
        return found | self.mechanics(t, y) | {"sensors": self.sensors(np.array([t]), y)}

    def mechanics(self, t: float, y: Any) -> dict[str, Any]:
        """M, h, G and gamma: derivatives by u' and values at rest of the equations that have no Baumgarte terms."""
        nb, n = self.bare.assembly.numbering, self.bare.n
        full, still, at_rest = np.zeros(n), np.zeros(n), np.empty(n)
        full[: nb.start["lambda"]] = y[: nb.start["lambda"]]
        self.bare.residual(t, full, still, at_rest)
        p, fyp = self.bare.pattern, self.bare.jacobian_parts(t, full, still)[1]
        fyp = fyp if fyp.ndim == 2 else sp.csc_matrix((fyp, p.indices, p.indptr), shape=p.shape).toarray()
        u, rows = slice(nb.nq, nb.nq + nb.nu), slice(nb.start["lambda"], n)
        return {"mass_matrix": fyp[u, u].ravel(), "constraint_matrix": fyp[rows, u].ravel(), "bias": at_rest[u],
                "gamma": at_rest[rows]}

    def sensors(self, t: Any, y: Any) -> Any:
        """Coordinates of joints with their rates, positions and velocities of bodies."""
        model, (q, u, s), found = self.prepared.model, self.prepared.states(t, y[None]), []
        for item in model.scene.connections:
            for g, p, values in self.prepared.mechanics.evaluate(coordinate, t, q, u, s):
                mine = [i for i, one in enumerate(model.groups[g].instances) if one.item == item.name][:1]
                found += [v for i in mine for v, (_, name) in zip(values[0, i], p.targets, strict=True) if name in item.scalars]
        for node in (model.node(body) for body in model.scene.bodies if model.node(body) is not None):
            n = node.kind.translations
            found += [*q[0, node.q : node.q + n], *u[0, node.u : node.u + n]]
        return np.array(found)

    def dense(self, part: Any) -> Any:
        p = self.system.pattern
        return part if part.ndim == 2 else sp.csc_matrix((part, p.indices, p.indptr), shape=p.shape).toarray()

    def forces(self, t: Any, y: Any, yp: Any) -> Any:
        """Force and torque of every item on l: by the multipliers of the form, or by those that the state has."""
        m, nb, (q, u, s) = self.prepared.mechanics, self.system.numbering, self.prepared.states(t, y[None])
        if nb.m and len(nb.rows) == len(m.rows):
            at = slice(nb.start["lambda"], nb.start["lambda"] + nb.m)
            multipliers = ((yp if nb.derivatives else y)[at] * nb.scaling())[None]
        elif self.whole is not None and len(self.whole.full.numbering.rows) == len(m.rows):
            multipliers = (self.whole.multipliers * self.whole.full.numbering.scaling())[None]
        else:
            multipliers = m.accelerations(t, q, u, s)[1]
        total = np.zeros((len(self.items), 6))
        for g, p, values in m.evaluate(reaction_outputs, t, q, u, s, multipliers):
            for i, instance in enumerate(self.prepared.model.groups[g].instances):
                if instance.item in self.items:
                    total[self.items.index(instance.item), [target[1] for target in p.targets]] += values[0, i]
        return total.ravel()

    def eliminated_off(self, t: float, y: Any) -> float:
        """Largest difference of the rates by which a scene is integrated, where the multipliers are eliminated, from `whole`,
        over the largest term of u' = M^-1 f - M^-1 G^T lambda, which is summed there; 0 for other scenes."""
        kernel = self.system._rates.kernel if self.whole is not None else None
        if kernel is None or kernel.whole:
            return 0.0
        found, wanted, nb = np.empty(self.system.n), np.empty(self.system.n), self.whole.full.numbering
        self.system.rhs(t, y, found)
        self.whole.solve(t, y, wanted)
        parts = self.mechanics(t, y)
        M, G = parts["mass_matrix"].reshape(nb.nu, nb.nu), parts["constraint_matrix"].reshape(nb.m, nb.nu)
        by_reactions = np.linalg.solve(M, G.T * self.whole.multipliers)
        terms = abs(by_reactions).sum(axis=1) + abs(wanted[nb.nq : nb.nq + nb.nu])
        return float(np.max(abs(found - wanted)) / max(np.max(terms), np.max(abs(wanted))))

    def states(self, count: int = 3) -> Iterator[tuple[float, Any, Any]]:
        """States near the start that satisfy nothing."""
        rng, n = np.random.default_rng(5), self.system.n
        for k in range(count):
            yield 0.3 + 0.1 * k, self.system.y0 + 0.1 * rng.normal(size=n), self.system.yp0 + rng.normal(size=n)

    def scales(self, wanted: dict[str, Any], y: Any, yp: Any) -> dict[str, Any]:
        """What errors are relative to: of a residual the terms of each row, of a Jacobian the entries of each row, of what a
        matrix was solved for the largest number."""
        rows = sum(abs(J) @ abs(x) for J, x in zip(wanted["jacobian"], (y, yp), strict=True)) + abs(wanted["residual"])
        found = {name: np.max(np.abs(wanted[name]), initial=0.0)
                 for name in ("rates", "joint_forces", "mass_matrix", "constraint_matrix", "bias", "gamma", "sensors")}
        if self.prepared.model.lines:  # large forces of strains leave small ones in the joints
            t, (q, u, s) = np.zeros(1), self.prepared.states(np.zeros(1), y[None])
            found["joint_forces"] = max(found["joint_forces"], np.max(np.abs(self.prepared.mechanics.load(t, q, u, s))))
        solved = self.whole is not None
        found["residual"] = found["rates"] if solved else rows
        rows = np.max(np.abs(wanted["jacobian"]), axis=None if solved else (0, 2), keepdims=True)
        found["jacobian"] = [rows.reshape(-1, 1)] * 2  # of a row in both matrices: compilers round what cancels in one otherwise
        return found


def off(found: Any, wanted: Any, scale: Any) -> float:
    """Largest difference in the scale of each number; where that is 0, the number has to be 0."""
    return float(np.max(np.abs(found - wanted) / np.where(scale > 0, scale, 1e-300), initial=0.0))


def dense(export: Any, values: Any) -> Any:
    rows, columns = export.pattern
    parts = np.zeros((2, len(export.inputs["y"]), len(export.inputs["y"])))
    parts[0][rows, columns], parts[1][rows, columns] = values[: len(rows)], values[len(rows) :]
    return parts


def values(entries: Sequence[Any]) -> list[float]:
    return [e.value for e in entries]


def differences(export: Any, call: Callable[..., Any], kernels: Kernels, p: Sequence[float]) -> dict[str, float]:
    """The largest relative difference of every function that is exported; call(name, **vectors): its outputs."""
    worst = dict.fromkeys(export.outputs, 0.0)
    for t, y, yp in kernels.states():
        wanted = kernels(t, y, yp)
        scales = kernels.scales(wanted, y, yp)
        for name in export.outputs:
            found = call(name, t=t, y=y, yp=yp, p=p, signals=values(export.inputs["signals"]))
            parts = found, wanted[name], scales[name]
            parts = (dense(export, found), *parts[1:]) if name == "jacobian" else [[part] for part in parts]
            worst[name] = max(worst[name], *(off(*part) for part in zip(*parts, strict=True)))
    return worst
