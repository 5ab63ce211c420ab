"""A zero of a continuous function by Brent's method, without SciPy, whose import takes longer (0.15 s) than many runs."""

from __future__ import annotations

from collections.abc import Callable

from mbdae.errors import internal

ITERATIONS = 100


def zero_between(f: Callable[[float], float], within: float) -> float:
    """A zero of f in [0, 1], with an error of at most `within`; f(0) and f(1) differ in sign, or one of them is 0 (else
    ValueError).

    b: the best point so far; a: the one before it; c: a point with the other sign, so that the zero lies between b and c. The
    next point is the zero of the parabola or straight line through these points, or, where that shortens the interval too slowly,
    the middle between b and c."""
    a, b = 0.0, 1.0
    at_a, at_b = f(a), f(b)
    if at_a == 0 or at_b == 0:
        return a if at_a == 0 else b
    if (at_a < 0) == (at_b < 0):
        raise internal(f"a zero was searched between two times at which the watched value is {at_a:g} and {at_b:g}: it needs "
                       "values of opposite sign")  # fmt: skip
    c, at_c, step, before = a, at_a, b - a, b - a
    for _ in range(ITERATIONS):
        if abs(at_c) < abs(at_b):
            a, b, c, at_a, at_b, at_c = b, c, b, at_b, at_c, at_b
        half = (c - b) / 2
        if at_b == 0 or abs(half) < within:
            break
        before, step = _next(before, step, half, (a - b, at_a / at_b), (c - b, at_c / at_b), within)
        a, at_a = b, at_b
        b += step if abs(step) > within else within if half > 0 else -within
        at_b = f(b)
        if (at_b < 0) == (at_c < 0):
            c, at_c, step, before = a, at_a, b - a, b - a
    return b


def _next(before: float, step: float, half: float, a: tuple[float, float], c: tuple[float, float],
          within: float) -> tuple[float, float]:  # fmt: skip
    """The last and the next step from the best point b. before: the step before the last; half: half of the way to c; a, c:
    distance of these points from b, and ratio of their values to that at b."""
    (to_a, ratio_a), (to_c, ratio_c) = a, c
    if abs(before) <= within or abs(ratio_a) <= 1:
        return half, half
    if to_a == to_c:  # a and c are the same point: the straight line through b and c
        found = to_c / (1 - ratio_c)
    else:  # the parabola through a, b and c, position as a function of the value
        found = to_a * ratio_c / ((1 - ratio_a) * (ratio_c - ratio_a)) - to_c * ratio_a / ((1 - ratio_c) * (ratio_c - ratio_a))
    inside = found / half > 0 and 2 * abs(found) < min(abs(before), 3 * abs(half) - within)
    return (step, found) if inside else (half, half)
