"""Compares the roots of a linearisation, their bounds and the verdict with those of the exact equations in 80 digits."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np
from known_roots.draw import DIGITS, Known, draw
from scipy.optimize import linear_sum_assignment

NOTHING = 1e-30  #: real parts of exact roots that count as 0, relative to the root


@dataclass(frozen=True)
class Verdict:
    """One linearisation: numbers of roots and of roots outside of their bounds; bounds over errors and over roots; what `stable`
    says and what is right."""

    seed: int
    kind: str
    count: int
    outside: int
    tight: list[bool]
    said: bool | None
    right: bool | None
    conservative: bool

    @property
    def wrong(self) -> bool:
        """Whether `stable` says what is not so."""
        return self.said is not None and self.said is not self.right


def exact_roots(known: Known) -> list[Any]:
    """The roots with imaginary part >= 0, as mpmath numbers."""
    with mp.workdps(DIGITS):
        A = mp.matrix(known.first) if known.first is not None else _first_order(known)
        found = [mp.mpc(z) for z in mp.eig(A, left=False, right=False)]
        least = mp.mpf(10) ** (-DIGITS // 2 + 5) * max(abs(x) for x in A)  # a double root 0 splits that far
        found = [mp.mpc(0) if abs(z) < least else mp.mpc(z.real, 0) if abs(z.imag) < abs(z) * NOTHING else z for z in found]
        return [mp.mpc(0, z.imag) if abs(z.real) < abs(z) * NOTHING else z for z in found if z.imag >= 0]


def _first_order(known: Known) -> Any:
    n = len(known.M)
    inverse = mp.matrix(known.M) ** -1
    K, C = inverse * mp.matrix(known.K), inverse * mp.matrix(known.C)
    A = mp.zeros(2 * n)
    for i in range(n):
        A[i, n + i] = 1
        for j in range(n):
            A[n + i, j], A[n + i, n + j] = -K[i, j], -C[i, j]
    return A


def judged(seed: int) -> Verdict:
    """The verdict on one drawn scene."""
    known = draw(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        l = known.scene.linearize(out_of_plane=False)
    exact = [w for z in exact_roots(known) for w in ((z, z.conjugate()) if z.imag > 0 else (z,))]
    found = [w for z in l.eigenvalues for w in ((z, z.conjugate()) if z.imag > 0 else (z,))]
    bounds = np.array([e for z, e in zip(l.eigenvalues, l.errors, strict=True) for _ in range(2 if z.imag > 0 else 1)])
    with mp.workdps(DIGITS):
        apart = np.array([[float(abs(mp.mpc(z) - w)) for w in exact] for z in found]).reshape(len(found), -1)
    cost = np.log10(np.maximum(apart / np.maximum(bounds, 1e-250)[:, None], 1.0) + 0 * apart) + 1e-3 * np.log10(1e-30 + apart)
    mine, theirs = linear_sum_assignment(cost)
    missed = abs(len(exact) - len(found))
    outside, tight = missed, []
    for i, j in zip(mine, theirs, strict=True):
        error, bound, size = apart[i, j], bounds[i], float(abs(exact[j]))
        outside += int(error > bound)
        tight.append(bool(bound <= 1e3 * error or bound <= 1e-10 * size))
    growing = any(z.real > 0 for z in exact)
    return Verdict(seed, known.kind, len(exact), outside, tight, l.stable, not growing, known.conservative)
