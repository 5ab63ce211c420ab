"""What is looked at beside the numbers with which a search ended.

Slopes vanish at a least value, and as well at a largest one, at one that is least along some directions only, and where nothing
depends on a number as long as it changes by little, as on a damper before a stop that is not reached yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mbdae.derivatives import Bound
from mbdae.errors import MbdaeError
from mbdae.fits.functions import HELD
from mbdae.system.base import Array

#: numbers on which nothing depends are looked at, all together, at so many places of their ranges, besides their ends; where they
#: have no ranges, so far away, over their sizes
PLACES, FAR = 8, (0.5, 5.0, 50.0, 5e3, 5e5, 5e7, 5e9)
#: curvature is looked at by gradients this part of a range away, along at most so many directions; what is found is no least
#: value where it is below minus this share of the largest
ASIDE, LOOKS, CURVED = 1e-2, 5, 1e-3
#: a combination of the numbers counts as not told by the data where its change by the size of the numbers moves the run by less
#: than its error, or by this many times the accuracy over what the best told combination moves; so many of them are looked along
UNTOLD, LOOKED = 10.0, 6
UNSURE = 3.0  #: runs are different ones where what they show differs by more than so many times the errors of both
ENOUGH = 1e-8  #: change of what is made least, over its size at the start, at which the search ends
HALVES = 4  #: halvings of a distance at whose far end a run is another one, and not a better one, to find a better one between


class OutOfRunsError(Exception):
    """A search has made as many runs as it may."""


def least_curved(product: Callable[[Array], Array], first: Array, most: int, least: float) -> tuple[float, float, Array]:
    """The least curvature, the largest magnitude of a curvature, and the direction (k,) of the least one, in the space of at most
    `most` products of second derivatives with directions (Lanczos). first: the first direction (k,); least: length of the rest of
    a product below which there is no further direction."""
    basis, products, v = np.zeros((0, len(first))), np.zeros((0, len(first))), first
    while len(basis) < most and np.linalg.norm(v) > least:
        v = v / np.linalg.norm(v)
        basis, products = np.vstack([basis, v]), np.vstack([products, product(v)])
        v = products[-1] - basis.T @ (basis @ products[-1])
    if not len(basis):
        return 0.0, 0.0, np.zeros(len(first))
    bent, along = np.linalg.eigh(basis @ products.T + products @ basis.T)
    return float(bent[0]), float(np.abs(bent).max()), along[:, 0] @ basis


def between(judge: Callable[[Array], int], same: Array, other: Array) -> Array | None:
    """Numbers with a better run between those with the same run as where a search ended, and those with another one, where the
    other runs begin; None where none is met. judge: of numbers, -1 for a better run, 0 for the same, 1 for another one."""
    for _ in range(HALVES):
        middle = (same + other) / 2
        if (said := judge(middle)) < 0:
            return middle
        same, other = (middle, other) if said == 0 else (same, middle)
    return None


def in_ranges(judge: Callable[[Array], int], x: Array, flat: Sequence[int], near: float,
              felt: Callable[[Array], Any]) -> tuple[Array | None, dict[int, Array]]:
    """Better numbers than x (k,), all between 0 and 1, with other values of those on which nothing depends near x (`flat`: their
    places): None where none are met; and by the place of a number the nearest x at which a run is another one by it. judge: as of
    `between`; near: the distance up to which is known already; felt: (k,) whether slopes by the numbers differ from 0 at an x."""
    from scipy.stats.qmc import Sobol

    others: dict[int, Array] = {}
    ends = [([j], end) for j in flat for end in (0.0, 1.0)]
    for places, values in [*ends, *((list(flat), one) for one in Sobol(len(flat), scramble=False).random(PLACES)[1:])]:
        p = x.copy()
        p[places] = values
        if np.abs(p - x).max() <= near or not (said := judge(p)):
            continue
        if said < 0:
            return p, others
        by = [j for j in places if len(places) == 1 or felt(p)[j]] or places
        others |= {j: p for j in by if j not in others or np.abs(p - x).max() < np.abs(others[j] - x).max()}
    return next((found for p in others.values() if (found := between(judge, x, p)) is not None), None), others


def along(judge: Callable[[Array], int], x: Array, direction: Array, low: Array, high: Array, unit: Array) -> Array | None:
    """The numbers nearest to x (k,) in the looks along a direction (k,) and against it that have a better run, or else another
    one; None where there are none. low, high: least and largest numbers, infinite for none; unit: of the numbers, SI."""
    seen = None
    for d in (direction, -direction):
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.nanmin(np.where(d > 0, (high - x) / d, np.where(d < 0, (low - x) / d, np.inf)))
        size, before = np.abs(d * unit).max(), x
        for far in FAR:
            if far > FAR[2] and far * size > 1.0:  # a number that is tiny, as one that is to be almost 0, is looked at up to 1
                far = room if np.isfinite(room) else 0.0
            p = np.clip(x + min(far, room) * d, low, high)
            if np.array_equal(p, before):
                break
            said = judge(p)
            if said:
                found = p if said < 0 else between(judge, before, p)
                if found is not None:
                    return found
                seen = p
                break
            before = p
    return seen


# -- of designs


def unmoved(work: Any, limits: Sequence[Bound], x: Array) -> tuple[Array, list[Bound]]:
    """Bounds that are passed at x (k,) and that no number moves there, nor brings nearer to their limits at other places of the
    ranges; where one is nearer to its limit at such a place the search is to begin there, which is returned in place of x."""
    from scipy.stats.qmc import Sobol

    def passed(i: int, one: Bound, p: Array) -> float:
        return one.sign * (float(work.value(i, p)) - one.limit) / (abs(one.limit) or 1.0)

    still: dict[int, Bound] = {}
    for i, one in enumerate(limits, 1):
        if passed(i, one, x) > HELD:
            if work.largest(i):
                work.follow(i, x, one.limit)
            (work.peak_slopes if work.largest(i) else work.slope)(i, x)
            if not work.felt[-1][1].any():
                still[i] = one
    if not still:
        return x, []
    begin, known = x, {i: passed(i, one, x) for i, one in still.items()}
    for p in Sobol(len(x), scramble=False).random(PLACES)[1:]:
        try:
            there = {i: passed(i, one, p) for i, one in still.items()}
        except MbdaeError:  # the scene refuses these numbers
            continue
        begin = p if all(there[i] < known[i] - HELD for i in still) else begin
        still = {i: one for i, one in still.items() if there[i] >= known[i] - HELD}
        if not still:
            break
    return begin, list(still.values())


def lower_beside(work: Any, limits: Sequence[Bound], x: Array) -> Array | None:
    """A design beside x (k,) with a lower value, where the slopes vanish at x but it is no least value: a largest one, or one
    that is least along some directions only. None at a least value.

    The curvature is that of the Lagrange function along the bounds that decide, in the space of a few products with its second
    derivatives, which are differences of slopes (Lanczos)."""
    middle, rng = np.clip(x, ASIDE, 1 - ASIDE), np.random.default_rng(0)
    scales = [abs(one.limit) or 1.0 for one in limits]

    def least(at: Array) -> Array:
        return np.asarray(work.peak_slopes(0, at) if work.largest(0) else work.slope(0, at)[None])

    try:
        size, top = abs(work.value(0, x)) or 1.0, 0
        ties = np.zeros(0, dtype=int)
        if work.largest(0):
            sizes = work.peaks(0, x)[:, 1]
            top = int(np.argmax(sizes))
            ties = np.setdiff1d(np.flatnonzero(sizes >= (1 - HELD) * sizes.max()), [top])
        active = np.flatnonzero(work.rows(limits, scales, x) <= HELD)

        def parts(at: Array) -> tuple[Array, Array]:  # slopes of what is made least, and of the rows that decide
            own = least(at)
            return own[top], np.concatenate([own[ties] - own[top], -work.row_slopes(limits, scales, at)[active]])

        of, rows = parts(x)
        factors = np.linalg.lstsq(rows.T, -of, rcond=None)[0]
        rest = of + factors @ rows
        fixed = ((x <= 0) & (rest > HELD * size)) | ((x >= 1) & (rest < -HELD * size))
        across = np.linalg.svd(np.vstack([rows / (np.abs(rows).max(initial=0.0) or 1.0), np.eye(len(x))[fixed]]))
        space = across[2][int(np.sum(across[1] > HELD)) :].T

        def slope(at: Array) -> Array:
            own, others = parts(at)
            return np.asarray(own + factors @ others)

        own, first = slope(middle), space @ rng.normal(size=space.shape[1])
        bent, most, least_bent = least_curved(lambda v: space @ (space.T @ (slope(middle + ASIDE * v) - own)) / ASIDE, first,
                                              min(LOOKS, space.shape[1]), HELD * size)
        if bent >= -CURVED * most:
            return None
        lowest, found = work.value(0, x) - ENOUGH * size, None
        for step in (10 * ASIDE, -10 * ASIDE, ASIDE, -ASIDE):
            beside = np.clip(middle + step * least_bent, 0.0, 1.0)
            if (value := work.value(0, beside)) < lowest:
                lowest, found = value, beside
    except (OutOfRunsError, MbdaeError):
        return None
    return found


def lower_elsewhere(work: Any, limits: Sequence[Bound], x: Array) -> tuple[Array | None, dict[str, float] | None]:
    """A better design than x (k,) at other values of numbers on which nothing depends at x and beside it, None where none is
    met; and name -> the nearest value at which something depends on a number, None where there were too few runs to know."""
    try:
        flat = np.flatnonzero(~work.felt_at(x, 2 * ASIDE))
        passed, values, off = work.merits(limits, x)

        def judge(p: Array) -> int:
            try:
                there, now, error = work.merits(limits, p)
            except MbdaeError:  # the scene refuses these numbers
                return 0
            apart = np.abs(now - values) > UNSURE * (off + error)
            if there < passed - HELD or (there <= max(HELD, passed) and apart[0] and now[0] < values[0]):
                return -1
            return int(apart.any())

        better, others = in_ranges(judge, x, flat.tolist(), 2 * ASIDE, work.felt_at) if len(flat) else (None, {})
    except OutOfRunsError:
        return None, None
    return better, {work.names[j]: float(work.numbers(p)[j]) for j, p in others.items()}


# -- of fits


def told(work: Any, x: Array, free: Any) -> tuple[Array, Array, Any]:
    """What the data tell of the numbers that are free (k,) at x (k,), over the units: by how much (m,) a change along each of
    some combinations of them moves the residuals; the combinations (m, m), as rows; which (m,) move them by less than the run's
    errors."""
    J = work.jacobian(x)[:, free]
    _, size, combinations = np.linalg.svd(J, full_matrices=True)
    size = np.concatenate([size, np.zeros(J.shape[1] - len(size))])
    lost = size <= max(UNTOLD * work.f.accuracy * size.max(initial=0.0), work.unsure(work.run(x * work.unit)))
    return size, combinations, lost


def lower_fit(work: Any, free: Any, low: Array, high: Array, known: bool) -> tuple[bool, dict[str, float]]:
    """Whether there are numbers with a lower sum of squares than where a fit ended, which it then has as its best; and name -> a
    value, further off, with another run, of numbers that the data do not tell near the end. free (k,): numbers that did not end
    at their bounds, low and high; known: whether standard deviations were given."""
    x, others = work.best, dict[str, float]()
    try:
        off, best = work.residuals(x), work.least
        size, combinations, lost = told(work, x, free)
        blur, slope = work.unsure(work.run(x * work.unit)), UNTOLD * work.f.accuracy * size.max(initial=0.0)
        freedom = len(off) - int(free.sum())
        # a sum of squares is lower where it falls by more than the errors of runs, and a part of what is one standard deviation
        least = best - UNSURE * blur * np.sqrt(best) - HELD * (1.0 if known else best / max(freedom, 1))

        def judge(p: Array) -> int:
            now = work.residuals(p)
            if now @ now < least:
                return -1
            work.best, work.least = x, best
            apart = np.linalg.norm(now - off) > UNSURE * blur + slope * np.abs(p - x).max()
            return int(bool(np.isfinite(now).all() and apart))

        for d in _lost_directions(work.jacobian(x), combinations[lost], free)[:LOOKED]:
            found = along(judge, x, d, low, high, work.unit)
            if work.best is not x:
                return True, {}
            if found is not None:
                others |= {work.f.names[j]: float(found[j] * work.unit[j]) for j in np.flatnonzero(np.abs(d) > HELD)}
        if not known or best > freedom + UNSURE * np.sqrt(2 * freedom):  # else errors of the measurements explain it all
            _along_curvature(work, judge, combinations[~lost] / size[~lost][:, None], free, low, high)
    except (OutOfRunsError, MbdaeError):
        pass
    return work.best is not x, others


def _lost_directions(J: Array, lost: Array, free: Any) -> Array:
    """(m, k) directions that the data do not tell, of which `lost` (m, free numbers) is one set: single numbers where these alone
    move nothing, then combinations; the largest share of a number is 1."""
    whole = np.zeros((len(lost), len(free)))
    whole[:, free] = lost
    alone = np.linalg.norm(whole, axis=0) > 1 - HELD
    others = np.linalg.svd(np.where(alone, 0.0, whole), full_matrices=False)
    found = np.concatenate([np.eye(len(free))[alone], others[2][others[1] > HELD]])
    return np.asarray(found / np.abs(found).max(axis=1, keepdims=True))


def _along_curvature(work: Any, judge: Callable[[Array], int], combinations: Array, free: Any, low: Array, high: Array) -> None:
    """Look along the direction in which the sum of squares curves down most, if it does. combinations (m, free numbers): told by
    the data, each as long as it moves the residuals by 1."""
    x, m = work.best, len(combinations)

    def direction(v: Array) -> Array:
        whole = np.zeros(len(x))
        whole[free] = v @ combinations
        return whole

    def slope(p: Array) -> Array:
        return np.asarray(combinations @ (work.jacobian(p)[:, free].T @ work.residuals(p)))

    def product(v: Array) -> Array:
        by = float(ASIDE / np.abs(direction(v)).max())
        return (slope(x + by * direction(v)) - own) / by

    if m == 0:
        return
    kept, own = (work.best, work.least), slope(x)
    bent, most, v = least_curved(product, np.random.default_rng(0).normal(size=m), min(LOOKS, m), HELD)
    work.best, work.least = kept
    if bent < -CURVED * most:
        d = direction(v) / np.abs(direction(v)).max()
        if not any(judge(np.clip(x + by * d, low, high)) < 0 for by in (10 * ASIDE, -10 * ASIDE, ASIDE, -ASIDE)):
            rises = (1 + ENOUGH) * work.least
            along(lambda p: min(judge(p), int(np.sum(work.residuals(p) ** 2) > rises)), x, d, low, high, work.unit)
