"""Energy of a pendulum over very many periods: what Radau IIA and BDF lose, and whether the run says so."""

from __future__ import annotations

import numpy as np
from runner import Case, Claim, Found

import mbdae as mb

RTOL = 1e-6
PERIOD = 1.9376  # s, of the rod below, released from the horizontal

claim = Claim("pendulum_energy", "over 100 to 10000 periods Radau IIA loses at most rtol x periods of a pendulum's energy; BDF "
              "more, and the run says so", 1.0, "rtol x periods",
              "none needed: the energy at the start, over the energy exchanged in a swing")


def pendulum() -> mb.Scene:
    """A rod of 1 m and 1 kg, released from the horizontal."""
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    return s


def drift(r: mb.Result) -> float:
    """Largest error of the energy over what a swing exchanges."""
    return float(np.max(np.abs(r.energy.balance)) / np.ptp(r.energy.potential))


def told(r: mb.Result) -> list[str]:
    """What the run says of its energy."""
    return [note for note in r.warnings if "the energy balance drifts" in note]


def radau(periods: int) -> list[Found]:
    """Loss, and no needless word."""
    r = pendulum().simulate(periods * PERIOD, solver=mb.RadauIIA(3, rtol=RTOL), outputs=2001)
    note = f"energy error {drift(r):.1e} of the energy exchanged, {r.stats.steps} steps"
    needless = len(told(r)) * float(drift(r) < 1e-3)
    return [Found(drift(r) / (RTOL * periods), note=note), Found(needless, 0.0, "1", "needless words")]


def asked(periods: int, accuracy: float) -> Found:
    """The same with the accuracy of the motion controlled."""
    r = pendulum().simulate(periods * PERIOD, accuracy, solver=mb.RadauIIA(3), outputs=2001)
    known = f"estimated error of the motion {r.accuracy.estimated:.1e}; energy error {drift(r):.1e}"
    return Found(drift(r) / (accuracy * periods), unit="accuracy x periods", note=known)


def ida(periods: int) -> list[Found]:
    """Loss, and the word for it."""
    r = pendulum().simulate(periods * PERIOD, solver=mb.IDA(rtol=RTOL), outputs=2001)
    said = "; ".join(told(r)) or "nothing was said"
    return [Found(1.0 - float(bool(told(r))), 0.0, "1", "runs that do not tell", f"energy error {drift(r):.1e}; {said}")]


def cases() -> list[Case]:
    found = [Case("100 periods, accuracy 1e-2", "RadauIIA(3)", lambda: asked(100, 1e-2), slow=True)]
    for periods in (100, 1000, 10000):
        slow = periods > 100
        found += [Case(f"{periods} periods", "RadauIIA(3)", lambda periods=periods: radau(periods), slow),  # type: ignore[misc]
                  Case(f"{periods} periods", "IDA", lambda periods=periods: ida(periods), slow)]  # type: ignore[misc]
    return [*found, Case("1000 periods, accuracy 1e-3", "RadauIIA(3)", lambda: asked(1000, 1e-3), slow=True)]
