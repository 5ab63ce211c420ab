"""The load that a strip on edge buckles under sideways: where a frequency about the loaded state vanishes."""

from __future__ import annotations

import numpy as np
from beam_scenes import cantilever, strip
from runner import Case, Claim, Found
from scenes import data

claim = Claim("lateral_buckling_cantilever", "a cantilevered strip on edge loses its lowest frequency at the buckling load", 0.03,
              "relative", "Timoshenko and Gere: 4.0126 sqrt(EI_soft GJ) / L^2, raised by the sag before (1 to 3 %)")


def lowest(load: float, elements: int, order: int) -> float:
    """Square of the lowest frequency about the state under a load (N), (rad/s)^2; negative where it grows."""
    section, L = strip()
    scene = cantilever(section, elements, order, L, force=(0, 0, load), space="spatial", axis2=(0, 1, 0))
    values = scene.linearize(at=scene.equilibrium(), count=4).eigenvalues
    return float(-(values[np.argmin(np.abs(values))] ** 2).real)


def buckling_load(elements: int, order: int) -> tuple[float, float]:
    """The load (N), and the frequency left there over that of half the load: secants over the square of the load from below."""
    a, b = 22.0, 36.0
    first = fa = lowest(a, elements, order)
    fb = lowest(b, elements, order)
    for _ in range(8):
        c = float(np.sqrt(b * b - fb * (b * b - a * a) / (fb - fa)))
        if abs(c / b - 1) < 1e-4:
            break
        a, fa = b, fb
        b = b + 0.8 * (c - b)
        fb = lowest(b, elements, order)
    return c, float(np.sqrt(max(fb, 0.0) / first))


def buckles(elements: int, order: int) -> Found:
    load, left = buckling_load(elements, order)
    expected = data("lateral_buckling_cantilever")["corrected"]
    return Found(abs(load / expected - 1), note=f"{load:.4f} N; frequency {left:.1%} of that at half the load just below it")


def cases() -> list[Case]:
    return [Case("6 cubic elements", "linearize", lambda: buckles(6, 3)),
            Case("12 quadratic elements", "linearize", lambda: buckles(12, 2), slow=True)]
