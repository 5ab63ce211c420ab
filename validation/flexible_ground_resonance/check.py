"""A rotor of four elastic lagging blades on an elastic support, near its instability."""

from __future__ import annotations

import numpy as np
from beam_scenes import flexible_rotor
from runner import Case, Claim, Found
from scenes import data

import mbdae as mb
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared, prepare

claim = Claim("flexible_ground_resonance", "four elastic blades of three cubic elements: growth, recursive joints", 1e-2,
              "relative", "growth rates of linearised equations in modes of the blades, computed independently of mbdae; "
              "numbers of unknowns from the paper")
EI = 1e4  #: N m^2
SAME = 1e-6  #: largest difference of the two joint models, of the largest lag angle
FEWER = 20  #: unknowns: the paper's 199 with constraints and 179 without


def known(axes: int) -> float:
    """Growth rate at 20.01 rad/s, 1/s."""
    entries = data(claim.name)["flexible_blades"]
    return next(float(e["growth_20_01"]) for e in entries if e["axes"] == axes and e["EI"] == EI)


def fastest_growth(x: Array, dt: float, modes: int = 3) -> float:
    """Growth rate (1/s) of the fastest growing of `modes` oscillations in equally spaced samples (matrix pencil)."""
    width = len(x) // 3
    windows = np.lib.stride_tricks.sliding_window_view(x, width)
    basis = np.linalg.svd(windows, full_matrices=False)[2][: 2 * modes]
    shift = np.linalg.lstsq(basis[:, :-1].T, basis[:, 1:].T, rcond=None)[0]
    return float(np.max(np.log(np.linalg.eigvals(shift) + 0j).real) / dt)


def fitted() -> Found:
    """One axis of support: growth of the hub's motion from a small lag angle, 0 to 2 s."""
    r = flexible_rotor(axes=1, lag=1e-3).simulate(2.0, solver=mb.RadauIIA(3, step=4e-3), outputs=201)
    return Found(abs(fastest_growth(r["hub"].position[:, 0], 0.01) / known(1) - 1), quantity="growth, 1 axis, time response")


def linearised() -> Found:
    """Two axes: the fastest growing mode in the frame of the hub, about the stretched blades."""
    s = flexible_rotor(axes=2)
    modes = s.linearize(s.equilibrium(frame="hub"), "hub").modes
    return Found(abs(max(mode.growth for mode in modes) / known(2) - 1), quantity="growth, 2 axes, linearised")


def models(space: str) -> Found:
    """Lag angles with recursive and with kinematic revolutes at the same steps, to 0.3 s."""
    lags = []
    for model in (mb.Recursive(), mb.Kinematic()):
        r = flexible_rotor(1, False, space, model, 0.01).simulate(0.3, solver=mb.RadauIIA(2, step=3e-3), outputs=101)
        lags.append(np.array([r[f"lag {i + 1}"].angle for i in range(4)]))
    gap = float(np.max(np.abs(lags[0] - lags[1])) / np.max(np.abs(lags[1])))
    return Found(gap, SAME, quantity="lag angles, recursive - kinematic")


def counted(prepared: Prepared) -> int:
    """Unknowns as the paper counts: displacements, rotations and multipliers; a displacement that a revolute makes equal
    once, without its multiplier."""
    names = {c.name for c in prepared.model.scene.joints if c.kind == "revolute"}
    equal = [row for row in prepared.rows if row.name.rpartition(".")[0] in names and row.name[-2:] in (".x", ".y", ".z")]
    return prepared.all_bodies.nu + len(prepared.rows) - 2 * len(equal)


def fewer_unknowns() -> tuple[int, str]:
    """Unknowns saved by five recursive revolutes, in space, the rotor's speed free."""
    with_rows, without = (counted(prepare(flexible_rotor(1, True, "spatial", m))) for m in (mb.Kinematic(), mb.Recursive()))
    return with_rows - without, f"{with_rows} with kinematic, {without} with recursive revolutes"


def fewer() -> Found:
    """The same beside what the paper saves."""
    number, said = fewer_unknowns()
    return Found(abs(number - FEWER), 0.5, "unknowns", f"saved, beyond {FEWER}", said)


def cases() -> list[Case]:
    both = [Case(f"joint models, {space}", "RadauIIA(2)", lambda space=space: models(space), space == "spatial")
            for space in ("planar", "spatial")]
    return [Case("growth by fit", "RadauIIA(3)", fitted), Case("growth by linearisation", "eigenvalues", linearised), *both,
            Case("unknowns", "none", fewer)]
