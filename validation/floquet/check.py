"""Floquet multipliers of a rotor in ground resonance, with equal and with unequal lag dampers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from runner import Case, Claim, Found
from scenes import data

import mbdae as mb
from mbdae.system.base import Array

claim = Claim("floquet", "growth rates of four lagging blades on an elastic support, by s.floquet", 1e-6, "1/s",
              "eigenvalues of the linear equations in minimal coordinates (one axis of support, and equal dampers), computed "
              "independently of mbdae; with unequal dampers a fit to the nonlinear motion")
GIVEN = data(claim.name)["given"]
PERIOD = 2 * np.pi / GIVEN["Omega"]
FITTED = 1e-2  #: relative
FAILED = {"one damper failed": (0.0, 400.0, 400.0, 400.0), "four unequal dampers": (100.0, 900.0, 300.0, 600.0)}  #: N m s
LAG, LINEAR = 1e-7, 1e-2  #: rad (and rad/s): lag of blade 1 at the start, size up to which the growth is fitted
TIGHT = mb.RadauIIA(3, rtol=1e-11, atol=1e-15)


def rotor(axes: int, dampers: Sequence[float], across: float = GIVEN["damping"], model: Any = None, space: str = "auto",
          lag: float = 0.0) -> mb.Scene:
    """A hub on slides along x, and along y with the damping `across` (N s/m); dampers (N m s) of the lag hinges."""
    s = mb.Scene("rotor", space=space)
    block = s.rigid_body("block", GIVEN["block"], 1.0 if axes == 1 else (1.0, 1.0, 1.0), at=(0, 0))
    carriage = s.rigid_body("carriage", 0.0, 0.0, at=(0, 0)) if axes == 2 else block
    spring, along = GIVEN["stiffness"], GIVEN["damping"]
    s.prismatic("x", s.ground, carriage, (0, 0), axis=(1, 0, 0), spring=spring, damper=along, model=model)
    if axes == 2:
        s.prismatic("y", carriage, block, (0, 0), axis=(0, 1, 0), spring=spring, damper=across, model=model)
    hub = s.rigid_body("hub", 0.0, 0.0, at=(0, 0))
    s.revolute("shaft", block, hub, at=(0, 0), angle=GIVEN["Omega"] * mb.t, model=model)
    for i, damper in enumerate(dampers):
        d = np.round([np.cos(i * np.pi / 2), np.sin(i * np.pi / 2)])
        root = GIVEN["hinge"] * d
        blade = s.link(f"blade{i + 1}", root, root + GIVEN["L"] * d, mass=GIVEN["mass"])
        s.revolute(f"lag{i + 1}", hub, blade, at=root, damper=damper, angle0=lag if i == 0 else 0.0, model=model)
    return s


def growth(axes: int, damper: float, known: float, model: Any, space: str, across: float = GIVEN["damping"]) -> Found:
    """The largest growth rate."""
    found = rotor(axes, (damper,) * 4, across, model, space).floquet(PERIOD)
    return Found(abs(float(found.growth.max()) - known), note=f"{found.steps} steps")


def spectrum(axes: int) -> list[Found]:
    """All growth rates, and that there are two multipliers per degree of freedom."""
    known = np.array(data(claim.name)["linear"][f"eig_{axes}axis"])
    f = rotor(axes, (0.0,) * 4, model=mb.Recursive()).floquet(PERIOD)
    count = 2 * (4 + axes)
    off = np.abs(np.sort(f.exponents.real) - np.sort(known[:, 0])) if len(f.exponents) == count else np.array([np.nan])
    multipliers = np.abs(turned(f.exponents) - turned(known @ [1, 1j]))
    return [Found(float(off.max()), quantity="all growth rates"),
            Found(float(multipliers.max()), quantity="all multipliers", unit="-")]


def turned(exponents: Array) -> Array:
    """Multipliers in the order of their size."""
    mu = np.exp(exponents * PERIOD)
    return np.array(sorted(mu, key=lambda z: (round(abs(z), 6), round(z.imag, 6))))


def fitted(axes: int, dampers: Sequence[float]) -> Found:
    """Growth by floquet and in the nonlinear motion, from a small lag until it leaves the linear range."""
    known = float(rotor(axes, dampers, model=mb.Recursive()).floquet(PERIOD).growth.max())
    times = PERIOD * np.arange(29)
    r = rotor(axes, dampers, model=mb.Recursive(), lag=LAG).simulate(float(times[-1]), solver=TIGHT, outputs=times)
    x = np.column_stack([part for i in range(4) for part in (r[f"lag{i + 1}"].angle, r[f"lag{i + 1}"].rate)])
    x = x[np.max(np.abs(x), axis=1) < LINEAR][-12:]
    return Found(abs(rate(x) / known - 1), FITTED, "relative", note=f"{known:.4f} 1/s")


def rate(x: Array) -> float:
    """Growth rate (1/s) of states (n, k) seen once per period when one pair of multipliers is left:
    x[i + 2] = a x[i + 1] + b x[i]."""
    a, b = np.linalg.lstsq(np.column_stack([x[1:-1].ravel(), x[:-2].ravel()]), x[2:].ravel(), rcond=None)[0]
    return float(np.log(np.max(np.abs(np.roots([1, -a, -b])))) / PERIOD)


def cases() -> list[Case]:
    d = data(claim.name)
    runs = [(e["axes"], e["c_zeta"], e["growth"]) for e in d["lag_damper_sweep"]]
    found = [Case(f"axes {axes}, lag dampers {damper:g} N m s", "Floquet",
                  lambda axes=axes, damper=damper, known=known: growth(axes, damper, known, mb.Recursive(), "planar"))
             for axes, damper, known in runs]
    across = d["linear"]["growth_2axis_damper_x_only"]
    found.append(Case("axes 2, support damped along x only", "Floquet",
                      lambda: growth(2, 0.0, across, mb.Recursive(), "planar", across=0.0)))
    models = [(mb.Kinematic(), "planar"), (mb.Classical(), "planar"), (mb.Recursive(), "spatial"), (mb.Kinematic(), "spatial")]
    for model, space in models:
        label = f"axes 1, {type(model).__name__.lower()} joints, {space}"
        found.append(Case(label, "Floquet", lambda model=model, space=space: growth(*runs[4], model, space),
                          slow=type(model) is mb.Classical or (type(model), space) == (mb.Kinematic, "spatial")))
    found += [Case(f"axes {axes}, all", "Floquet", lambda axes=axes: spectrum(axes)) for axes in (1, 2)]
    return found + [Case(f"axes {axes}, {name}", "Floquet, RadauIIA(3)", lambda axes=axes, own=own: fitted(axes, own),
                         slow=(axes, name) != (1, "one damper failed"))
                    for axes in (1, 2) for name, own in FAILED.items()]
