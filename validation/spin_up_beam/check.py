"""A beam spun up about its root: tip displacements during spin-up, and its extension in steady rotation."""

from __future__ import annotations

import numpy as np
from beam_scenes import on_hub, spin_up, spin_up_angle, spin_up_section
from runner import Case, Claim, Found
from runs import largest
from scenes import data

import mbdae as mb

claim = Claim("spin_up_beam", "the spin-up manoeuvre of Simo and Vu-Quoc", 2e-3, "m",
              "one spectral element, computed independently (3 digits); steady extension in closed form")
STEADY = 5e-7  #: m, of the steady extension


def manoeuvre(elements: int, order: int) -> list[Found]:
    """Tip in the frame that turns with the root; the extension averaged over the last 5 s of steady rotation."""
    d = data("spin_up_beam")
    rows, L = np.array(d["reference"]["rows"]), d["parameters"]["L"]
    times = np.unique(np.r_[0.0, rows[:, 0], np.linspace(15, 20, 101)])
    r = spin_up(elements, order).simulate(20.0, solver=mb.RadauIIA(3, rtol=2e-7), outputs=times)
    a, tip = spin_up_angle(r.t), r["beam"].at(1.0).position
    u = np.column_stack([np.cos(a) * tip[:, 0] + np.sin(a) * tip[:, 1] - L, np.cos(a) * tip[:, 1] - np.sin(a) * tip[:, 0]])
    at = np.searchsorted(r.t, rows[:, 0])
    extension = float(np.mean(u[r.t >= 15, 0]))
    return [Found(largest(u[at, 1], rows[:, 2]), quantity="transverse", note=f"{r.stats.steps} steps"),
            Found(largest(u[at, 0], rows[:, 1]), quantity="axial"),
            Found(abs(extension - d["steady_axial_extension_closed_form"]), STEADY, quantity="steady extension")]


def steady() -> Found:
    """The extension at rest in the frame of a hub that turns at the final rate."""
    d = data("spin_up_beam")
    p = d["parameters"]
    e = on_hub(spin_up_section(), p["omega_s"], p["L"], 4, 3).equilibrium(frame="hub")
    return Found(abs(e["beam"].at(1.0).position[0, 0] - p["L"] - d["steady_axial_extension_closed_form"]), STEADY)


def cases() -> list[Case]:
    return [Case("4 cubic elements", "RadauIIA(3)", lambda: manoeuvre(4, 3)),
            Case("8 cubic elements", "RadauIIA(3)", lambda: manoeuvre(8, 3), slow=True),
            Case("steady extension, 4 cubic elements", "equilibrium", steady)]
