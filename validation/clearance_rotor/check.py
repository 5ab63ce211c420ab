"""A flexible rotor in anisotropic bearings: whirl, critical speeds, unbalance, and its orbit in a bearing with clearance."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from rotor_scenes import SLENDER, TUBE, rotor_on_springs, rotor_with_clearance
from runner import Case, Claim, Found
from scenes import data

import mbdae as mb
from mbdae.errors import AccuracyWarning
from mbdae.system.base import Array

claim = Claim("clearance_rotor", "flexible rotor: whirl, critical speeds, unbalance; orbit in a bearing with clearance", 1e-2,
              "relative", "speed and radii: the paper; other data chosen here; values computed independently of mbdae by "
              "Euler-Bernoulli elements in the plane across the shaft")
FREQUENCIES = {"tube": (TUBE, 1e-2), "no shear": (SLENDER, 1e-4)}  #: section and tolerance
CRITICAL = 5e-3
BALANCE = 1e-3  #: energy error over what friction dissipates
ECCENTRICITY = 1e-4  #: m, of the unbalance response, which is linear; the reference has 1e-3 m


def lateral(stiffness: Any, speed: float, section: mb.Section, count: int) -> Array:
    """The lowest frequencies (rad/s) of bending; axial and torsional modes left out."""
    modes = rotor_on_springs(stiffness, speed, section=section).linearize(count=count + 8)
    bending = [m for m in modes if np.max(np.abs(m["shaft"].displacement[:, 1:])) > 1e-3 and m.angular_frequency > 1]
    return np.array([m.angular_frequency for m in bending])[:count]


def whirl(entry: dict[str, Any], name: str) -> Found:
    """Six whirl frequencies at 24 rad/s."""
    section, tolerance = FREQUENCIES[name]
    found, known = lateral(entry["kR"], 24.0, section, 6), np.array(entry["whirl_at_24"])
    return Found(float(np.max(np.abs(found / known - 1))), tolerance, quantity=f"whirl frequencies, {name}")


def critical(entry: dict[str, Any]) -> Found:
    """The four lowest critical speeds: those at which a whirl frequency equals the speed."""
    worst = 0.0
    for i, known in enumerate(entry["critical_speeds"][:4]):
        speed = 24.0
        for _ in range(3):
            speed = float(lateral(entry["kR"], speed, TUBE, 6)[i])
        worst = max(worst, abs(speed / known - 1))
    return Found(worst, CRITICAL, quantity="critical speeds, tube")


def amplitude(t: Array, x: Array, eigenvalues: Array) -> float:
    """Amplitude at 24 rad/s of a motion that also holds free vibrations."""
    terms = np.exp(np.outer(t, np.r_[24j, eigenvalues]))
    found = np.linalg.lstsq(np.hstack([terms.real, terms.imag]), x, rcond=None)[0]
    return float(np.hypot(found[0], found[terms.shape[1]]))


def unbalance(entry: dict[str, Any]) -> Found:
    """Disk and end of the shaft along y and z."""
    eigenvalues = 1j * lateral(entry["kR"], 24.0, SLENDER, 6)
    s = rotor_on_springs(entry["kR"], eccentricity=ECCENTRICITY)
    r = s.simulate(5.0, solver=mb.RadauIIA(3, rtol=1e-6), outputs=2001)
    worst = 0.0
    for place, name in ((0.5, "disk"), (1.0, "T")):
        path = r[s["shaft"].at(place)].position
        for i, axis in ((1, "y"), (2, "z")):
            found = amplitude(r.t, path[:, i], eigenvalues) * 1e-3 / ECCENTRICITY
            worst = max(worst, abs(found / entry[f"{name}_{axis}"] - 1))
    return Found(worst, quantity="unbalance response")


def friction(law: str) -> Any:
    if law == "coulomb":
        return mb.Coulomb(0.3, 0.01)
    with warnings.catch_warnings():  # sigma1 is above the bound of passivity, as in the reference
        warnings.simplefilter("ignore", AccuracyWarning)
        return mb.LuGre(0.3, 0.3, 0.01, 1e5, 316.23)


def orbit(law: str) -> list[Found]:
    """Largest and mean radius of the pin's path in the race at the times of the reference; bound of the radius, energy."""
    known = data(claim.name)["orbit"][law]
    radius = np.linalg.norm(known["rel_yz"], axis=1)
    r = rotor_with_clearance(friction(law)).simulate(2.0, solver=mb.RadauIIA(3, rtol=1e-7), outputs=known["t"])
    T, e = r["T"], r.energy
    found = np.linalg.norm(T.orbit, axis=1)
    everywhere = np.linalg.norm(T.at_times(r.solution.t)["orbit"], axis=1)
    beyond = float(np.max(everywhere)) - 8e-4 - T.contacts.deepest
    return [Found(abs(float(found.max() / radius.max()) - 1), quantity="largest radius of the orbit"),
            Found(abs(float(found.mean() / radius.mean()) - 1), quantity="mean radius of the orbit"),
            Found(max(beyond, 0.0), 1e-9, "m", "radius beyond clearance and indentation"),
            Found(float(np.max(np.abs(e.balance)) / e.friction[-1]), BALANCE, quantity="energy error over friction")]


def cases() -> list[Case]:
    known = data(claim.name)
    linear = [Case(f"{e['case']}, {name}", "linearize", lambda e=e, name=name: whirl(e, name))
              for e in known["linear"] for name in FREQUENCIES]
    speeds = [Case(e["case"], "linearize", lambda e=e: critical(e), slow=True) for e in known["linear"]]
    unbalanced = [Case("springs " + " ".join(f"{k:g}" for k in e["kR"]), "RadauIIA(3)", lambda e=e: unbalance(e),
                       slow=e["kR"][0] == 1e6)
                  for e in known["unbalance"]]
    orbits = [Case(f"clearance, {law}", "RadauIIA(3)", lambda law=law: orbit(law), slow=True)
              for law in ("coulomb", "lugre")]
    return linear + speeds + unbalanced + orbits
