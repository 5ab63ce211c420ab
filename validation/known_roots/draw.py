"""Random scenes whose linear equations are known by hand: numbers spread over up to sixteen powers of ten."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpmath import mpf, workdps

import mbdae as mb

MODELS: tuple[Any, ...] = (None, mb.Kinematic(), mb.Classical(), mb.Recursive())
G, DIGITS = 9.81, 80


@dataclass(frozen=True)
class Known:
    """A scene with its exact equations M x'' + C x' + K x = 0, lists of rows of mpmath numbers; conservative: whether it has no
    damping and no follower forces; first: the matrix A of x' = A x instead, where internal states are in it."""

    kind: str
    scene: mb.Scene
    M: list[list[Any]]
    C: list[list[Any]]
    K: list[list[Any]]
    conservative: bool
    first: list[list[Any]] | None = None


class Draw:
    """Numbers of one scene."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.span = float(self.rng.choice([1.0, 4.0, 8.0, 12.0, 16.0]))  # powers of ten

    def wide(self, low: float = 1e-2) -> float:
        """A positive number anywhere in the span."""
        return float(low * 10 ** self.rng.uniform(0, self.span))

    def near(self) -> float:
        """A positive number of size 1."""
        return float(10 ** self.rng.uniform(-0.7, 0.7))

    def sometimes(self, value: float, share: float) -> float:
        """The value, or 0."""
        return value if self.rng.random() < share else 0.0

    def model(self) -> Any:
        """A joint model."""
        return MODELS[int(self.rng.integers(len(MODELS)))]


def zeros(n: int) -> list[list[Any]]:
    """n x n exact zeros."""
    return [[mpf(0)] * n for _ in range(n)]


def between(A: list[list[Any]], i: int, j: int | None, value: float) -> None:
    """Adds value (x_i - x_j)^2 / 2 to the form A; j None: the ground."""
    for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
        if a is not None and b is not None:
            A[a][b] += sign * mpf(value)


def chain(d: Draw) -> Known:
    """Masses on a rail, or coaxial rotors, with springs and dampers between neighbours; sometimes floating."""
    n, rail, floating = int(d.rng.integers(1, 6)), d.rng.random() < 0.5, d.rng.random() < 0.2
    damped = d.rng.random() < 0.7
    s = mb.Scene("chain", space=str(d.rng.choice(["auto", "spatial"])))
    M, C, K = zeros(n), zeros(n), zeros(n)
    model, tilt, before = d.model(), float(d.rng.choice([0.0, 0.4])), s.ground
    for i in range(n):
        m, k, c = d.near(), d.sometimes(d.wide(), 0.85), d.sometimes(d.wide(), 0.6) if damped else 0.0
        if i == 0 and floating:
            k = c = 0.0
        values = {"spring": k} if k else {}
        values |= {"damper": c} if c else {}
        body = s.rigid_body(f"b{i}", m if rail else 1.0, 1.0 if rail else m if s.space == "auto" else (m, m, m), at=(0, 0))
        if rail:
            s.prismatic(f"P{i}", before, body, at=(0, 0), axis=(np.cos(tilt), np.sin(tilt), 0), model=model, **values)
        else:
            s.revolute(f"R{i}", before, body, at=(0, 0), model=model, **values)
        before = body
        M[i][i] += mpf(m)
        between(K, i, i - 1 if i else None, k)
        between(C, i, i - 1 if i else None, c)
    return Known("chain", s, M, C, K, not damped)


def pendulums(d: Draw) -> Known:
    """Pendulums side by side, hanging and standing, with springs and dampers in their hinges, and rotors hung between them."""
    n, damped = int(d.rng.integers(1, 5)), d.rng.random() < 0.7
    s = mb.Scene("pendulums", gravity=(0, -G, 0), space=str(d.rng.choice(["auto", "spatial"])))
    M, C, K = zeros(n), zeros(n), zeros(n)
    model = d.model()
    for i in range(n):
        m, up = d.near(), 1 if d.rng.random() < 0.3 else -1
        k, c = d.sometimes(d.wide(), 0.3), d.sometimes(d.wide(), 0.6) if damped else 0.0
        values = ({"spring": k} if k else {}) | ({"damper": c} if c else {})
        body = s.rigid_body(f"b{i}", m, 1.0 if s.space == "auto" else (1.0, 1.0, 1.0), at=(3.0 * i, up))
        s.revolute(f"R{i}", s.ground, body, at=(3.0 * i, 0), model=model, **values)
        M[i][i] += 1 + mpf(m)
        K[i][i] += mpf(k) - up * mpf(m) * mpf(G)
        C[i][i] += mpf(c)
    return Known("pendulums", s, M, C, K, not damped)


def cart(d: Draw) -> Known:
    """A pendulum on a cart: stiff dampers and springs on the one, slow creep of the other."""
    m, mc, up, damped = d.near(), d.near(), 1 if d.rng.random() < 0.5 else -1, d.rng.random() < 0.8
    k, c = d.sometimes(d.wide(), 0.6), d.wide() if damped else 0.0
    kp, cp = d.sometimes(d.wide(), 0.3), d.sometimes(d.wide(), 0.5) if damped else 0.0
    s = mb.Scene("cart", gravity=(0, -G, 0), space=str(d.rng.choice(["auto", "spatial"])))
    model, J = d.model(), 1.0 if s.space == "auto" else (1.0, 1.0, 1.0)
    body, bob = s.rigid_body("cart", mc, J, at=(0, 0)), s.rigid_body("bob", m, J, at=(0, up))
    s.prismatic("P", s.ground, body, at=(0, 0), axis=(1, 0, 0), model=model, **({"spring": k} if k else {}),
                **({"damper": c} if c else {}))
    s.revolute("R", body, bob, at=(0, 0), model=model, **({"spring": kp} if kp else {}), **({"damper": cp} if cp else {}))
    M, C, K = zeros(2), zeros(2), zeros(2)
    M[0][0], M[1][1], M[0][1] = mpf(mc) + mpf(m), 1 + mpf(m), -up * mpf(m)
    M[1][0] = M[0][1]
    K[0][0], K[1][1] = mpf(k), mpf(kp) - up * mpf(m) * mpf(G)
    C[0][0], C[1][1] = mpf(c), mpf(cp)
    return Known("cart", s, M, C, K, not damped)


def rotor(d: Draw) -> Known:
    """A disc driven on a housing in a support with springs and dampers of all sizes: tilts coupled by the gyroscopic moment."""
    rate, J1, J3, damped = d.near() * 30, d.near(), d.near(), d.rng.random() < 0.5
    J3 = min(J3, 1.9 * J1)
    k = [d.wide(1.0) for _ in range(6)]
    c = [d.sometimes(d.wide(1e-3), 0.7) for _ in range(6)] if damped else [0.0] * 6
    s = mb.Scene("rotor", space="spatial")
    housing = s.rigid_body("housing", 5.0, (0.1, 0.1, 0.1))
    s.bushing("support", s.ground, housing, at=(0, 0), stiffness=tuple(k), damping=tuple(c))
    s.revolute("bearing", housing, s.rigid_body("disc", 20.0, (J1, J1, J3), at=(0, 0)), at=(0, 0), angle=rate * mb.t)
    M, C, K = zeros(6), zeros(6), zeros(6)
    for i in range(6):
        M[i][i] = mpf(25) if i < 3 else mpf(0.1) + mpf(J1 if i < 5 else J3)
        K[i][i], C[i][i] = mpf(k[i]), mpf(c[i])
    H = mpf(J3) * mpf(rate)
    C[3][4], C[4][3] = C[3][4] + H, C[4][3] - H
    return Known("rotor", s, M, C, K, not damped)


def ziegler(d: Draw) -> Known:
    """Two rods with a follower force at the end: stiffness that is not symmetric, and dampers of all sizes."""
    P, k1, k2, c1, c2 = d.near(), d.near(), d.near(), d.wide(1e-3), d.wide(1e-3)
    damped = d.rng.random() < 0.8
    c1, c2 = (c1, c2) if damped else (0.0, 0.0)
    s = mb.Scene("follower force", space="planar")
    a, b = s.rigid_body("a", 1.0, 1.0, at=(1, 0)), s.rigid_body("b", 1.0, 1.0, at=(2, 0))
    model = d.model()
    s.revolute("A", s.ground, a, at=(0, 0), model=model, spring=k1, **({"damper": c1} if c1 else {}))
    s.revolute("B", a, b, at=(1, 0), model=model, spring=k2, **({"damper": c2} if c2 else {}))
    s.force("F", b, (-P, 0, 0), frame="body")
    M, C, K = zeros(2), zeros(2), zeros(2)
    # absolute angles; masses at the ends of rods of 1 m, inertias 1; work of the force by the tilt of b
    M[0][0], M[0][1], M[1][0], M[1][1] = mpf(3), mpf(1), mpf(1), mpf(2)
    between(K, 0, None, k1), between(K, 1, 0, k2), between(C, 0, None, c1), between(C, 1, 0, c2)
    K[0][0] -= mpf(P)
    K[0][1] += mpf(P)
    return Known("follower force", s, M, C, K, False)


def points(d: Draw) -> Known:
    """Points of masses of all sizes on massless rods, hanging or standing, with springs and dampers in their hinges."""
    n, up, damped = int(d.rng.integers(1, 4)), 1 if d.rng.random() < 0.3 else -1, d.rng.random() < 0.7
    d.span = min(d.span, 12.0)
    s = mb.Scene("points", gravity=(0, -G, 0), space="planar")
    M, C, K = zeros(n), zeros(n), zeros(n)
    masses = [d.wide(1e-6) for _ in range(n)]
    model, before = d.model(), s.ground
    for i, m in enumerate(masses):
        k, c = d.sometimes(d.wide(1e-2), 0.5), d.sometimes(d.wide(1e-2), 0.7) if damped else 0.0
        body = s.rigid_body(f"b{i}", m, 0.0, at=(0, up * (i + 1)))
        values = ({"spring": k} if k else {}) | ({"damper": c} if c else {})
        s.revolute(f"R{i}", before, body, at=(0, up * i), model=model, **values)
        before = body
        between(K, i, i - 1 if i else None, k)
        between(C, i, i - 1 if i else None, c)
    for i in range(n):
        K[i][i] -= up * mpf(G) * sum((mpf(m) for m in masses[i:]), mpf(0))
        for j in range(n):
            M[i][j] = sum((mpf(m) for m in masses[max(i, j) :]), mpf(0))
    return Known("points", s, M, C, K, not damped)


def creeping(d: Draw) -> Known:
    """Pendulums in honey, whose slow roots m g l / c go down to 1e-12 1/s beside fast ones of c / J."""
    n = int(d.rng.integers(1, 4))
    s = mb.Scene("creeping", gravity=(0, -G, 0), space=str(d.rng.choice(["auto", "spatial"])))
    M, C, K = zeros(n), zeros(n), zeros(n)
    model = d.model()
    for i in range(n):
        m, J, up, c = d.wide(1e-4) if d.span < 12 else d.near(), d.near(), 1 if d.rng.random() < 0.3 else -1, d.wide(1e2)
        c = min(c, 1e12)
        body = s.rigid_body(f"b{i}", m, J if s.space == "auto" else (J, J, J), at=(3.0 * i, up))
        s.revolute(f"R{i}", s.ground, body, at=(3.0 * i, 0), model=model, damper=c)
        M[i][i], C[i][i], K[i][i] = mpf(J) + mpf(m), mpf(c), -up * mpf(m) * mpf(G)
    return Known("creeping", s, M, C, K, False)


def filtered(d: Draw) -> Known:
    """Masses on springs, with forces through internal states whose rates are 1e-9 1/s and more."""
    n, gain = int(d.rng.integers(1, 4)), d.rng.random() < 0.5
    s = mb.Scene("filtered")
    A = zeros(3 * n)
    for i in range(n):
        m, k, c, slow = d.near(), d.wide(), d.sometimes(d.wide(), 0.5), d.wide(1e-9)
        b = k * d.near() * 0.3 * (-1 if gain else 1)
        values = {"spring": k} | ({"damper": c} if c else {})
        s.prismatic(f"P{i}", s.ground, s.rigid_body(f"b{i}", m, 1.0, at=(0, i)), at=(0, i), axis=(1, 0, 0), **values)
        z = s.state(f"z{i}", slow * (s.sensor(f"P{i}.displacement") - s.sensor(f"z{i}")))
        s.force(f"F{i}", f"b{i}", (b * z, 0, 0))
        x, v, own = 3 * i, 3 * i + 1, 3 * i + 2
        A[x][v] = mpf(1)
        A[v][x], A[v][v], A[v][own] = -mpf(k) / mpf(m), -mpf(c) / mpf(m), mpf(b) / mpf(m)
        A[own][x], A[own][own] = mpf(slow), -mpf(slow)
    return Known("filtered", s, [], [], [], False, A)


KINDS: tuple[Callable[[Draw], Known], ...] = (chain, pendulums, cart, rotor, ziegler)
#: kinds measured from seed LATER on
SLOW: tuple[Callable[[Draw], Known], ...] = (points, creeping, filtered)
LATER = 1000


def draw(seed: int) -> Known:
    """One scene."""
    d, kinds = Draw(seed), KINDS if seed < LATER else SLOW
    with workdps(DIGITS):
        return kinds[seed % len(kinds)](d)
