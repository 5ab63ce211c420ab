"""A lattice of springs that swings under its weight from a hinge: its exact motion, large displacements included, beside that of
the reduced body and of Exudyn's, which leave out the second order of the deformation, each in its own floating frame."""

from __future__ import annotations

import json
import warnings
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import coo_matrix

import mbdae as mb

BAYS, HALF, WEIGHT, END, TIMES = 6, 0.05, np.array([0, 0, -9.81]), 0.25, 26  # of 1 m in all; m, m/s^2, s
SQUARE = ((-HALF, -HALF), (HALF, -HALF), (HALF, HALF), (-HALF, HALF))
NODES = np.array([[i / BAYS, y, z] for i in range(BAYS + 1) for y, z in SQUARE])
ENDS, INNER, SEEN = [[0, 1, 2, 3], [24, 25, 26, 27]], slice(4, 24), [24, 26]  # rigid faces; masses of 1 kg


@cache
def springs(stiffer: float) -> tuple[Any, Any, Any]:
    """Their nodes (s, 2), stiffnesses (s,), N/m, and unit vectors (s, 3)."""
    pairs, k = [], []
    for i in range(0, 4 * BAYS + 1, 4):
        pairs += [(i + a, i + b) for a in range(4) for b in range(a)]
        k += [1.0] * 6
        if i < 4 * BAYS:
            pairs += [(i + a, i + 4 + (a + b) % 4) for a in range(4) for b in (0, 1, 3)]
            k += [1.0, 0.5, 0.5] * 4
    line = NODES[[b for _, b in pairs]] - NODES[[a for a, _ in pairs]]
    return np.array(pairs), 1e6 * stiffer * np.array(k), line


def pulled(stiffer: float, on_first: Any) -> Any:
    """(28, 3) forces on the nodes; on_first (s, 3): on the first node of every spring."""
    force = np.zeros((len(NODES), 3))
    pairs, *_ = springs(stiffer)
    np.add.at(force, pairs[:, 0], on_first)
    np.subtract.at(force, pairs[:, 1], on_first)
    return force


def stiffness(stiffer: float) -> Any:
    """K (84, 84)."""
    pairs, k, line = springs(stiffer)
    along = line / np.linalg.norm(line, axis=1)[:, None]
    K = np.zeros((len(NODES), 3, len(NODES), 3))
    for (a, b), value, e in zip(pairs, k, along, strict=True):
        for i, j, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
            K[i, :, j] += sign * value * np.outer(e, e)
    return K.reshape(84, 84)


def second(stiffer: float) -> Any:
    """The internal force of the second order by two displacements."""
    pairs, k, line = springs(stiffer)
    length = np.linalg.norm(line, axis=1)[:, None]
    e = line / length

    def force(u: Any, v: Any) -> Any:
        (au, pu), (av, pv) = ((a := np.sum(e * d, axis=1)[:, None], d - a * e) for d in (
            np.diff(np.reshape(x, (-1, 3))[pairs], axis=1)[:, 0] for x in (u, v)))
        return -pulled(stiffer, k[:, None] / length * (au * pv + av * pu + np.sum(pu * pv, axis=1)[:, None] * e)).ravel()

    return force


def turned(p: Any) -> Any:
    """The rotation matrix of a quaternion."""
    w, x, y, z = p / np.linalg.norm(p)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


@cache
def exact(stiffer: float) -> Any:
    """Places (2, times, 3) of the nodes looked at, m: nodes and rigid faces by Newton and Euler, springs by their lengths."""
    pairs, k, line = springs(stiffer)
    length, n = np.linalg.norm(line, axis=1), 60
    root, tip = NODES[ENDS[0]], NODES[ENDS[1]] - NODES[ENDS[1]].mean(axis=0)
    own, about = (np.sum(f**2) * np.eye(3) - f.T @ f for f in (tip, root))

    def rate(t: float, s: Any) -> Any:
        angle, place, p = s[n], s[n + 1 : n + 4], s[n + 4 : n + 8]
        v, spin, W = s[n + 8 : 2 * n + 8], s[2 * n + 8], s[2 * n + 12 : 2 * n + 15]
        x, A = np.empty((28, 3)), turned(p)
        x[INNER], x[ENDS[1]] = s[:n].reshape(-1, 3), place + tip @ A.T
        x[ENDS[0]] = root @ turned(np.array([np.cos(angle / 2), 0, np.sin(angle / 2), 0])).T
        d = np.diff(x[pairs], axis=1)[:, 0]
        F = pulled(stiffer, (k * (1 - length / np.linalg.norm(d, axis=1)))[:, None] * d) + WEIGHT
        torque = A.T @ np.sum(np.cross(x[ENDS[1]] - place, F[ENDS[1]]), axis=0)
        turn = np.r_[-p[1:] @ W, p[0] * W + np.cross(p[1:], W)] / 2
        return np.r_[v, spin, s[2 * n + 9 : 2 * n + 12], turn, F[INNER].ravel(),
                     np.sum(np.cross(x[ENDS[0]], F[ENDS[0]]), axis=0)[1] / about[1, 1], F[ENDS[1]].sum(axis=0) / 4,
                     np.linalg.solve(own, torque - np.cross(W, own @ W))]

    start = np.r_[NODES[INNER].ravel(), 0, NODES[ENDS[1]].mean(axis=0), 1, np.zeros(3 + n + 7)]
    s = solve_ivp(rate, (0, END), start, "DOP853", np.linspace(0, END, TIMES), rtol=1e-9, atol=1e-11).y.T
    return np.array([[y[n + 1 : n + 4] + turned(y[n + 4 : n + 8]) @ tip[node - 24] for y in s] for node in SEEN])


def ours(stiffer: float, stiffening: bool, modes: int = 20) -> tuple[Any, float]:
    """The places by a reduced body, and what it says about their error, m."""
    s, by_loads = mb.Scene("lattice", gravity=tuple(WEIGHT)), second(stiffer) if stiffening else False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        body = mb.ReducedBody.craig_bampton(np.eye(84), stiffness(stiffer), NODES, {"0": ENDS[0], "1": ENDS[1]}, modes,
                                            stiffening=by_loads)
        s.reduced_body("lattice", body)
        s.revolute("hinge", s.ground, "lattice.0", at=(0, 0, 0), axis=(0, 1, 0))
        r = s.simulate(END, 1e-5, outputs=np.linspace(0, END, TIMES))
    moved = body.displacement(r["lattice.modes"], SEEN) + NODES[SEEN] - body.center
    places = np.moveaxis(r["lattice"].position[:, None] + np.einsum("tij,tkj->tki", r["lattice"].rotation, moved), 1, 0)
    return places, float(r.accuracy.deformation) * r.prepared.length


def problem(stiffer: float, modes: int = 20) -> str:
    """The same for `exudyn_run.py`."""
    entries = {name: (A.data.tolist(), A.row.tolist(), A.col.tolist()) for name, A in
               (("M", coo_matrix(np.eye(84))), ("K", coo_matrix(stiffness(stiffer))))}
    return json.dumps(entries | {
        "faces": ENDS, "modes": modes, "gravity": WEIGHT.tolist(), "at": [[0, 0, 0]], "end": END, "outputs": TIMES - 1,
        "joints": [[-1, -1, 0, 0, [1, 1, 1, 1, 0, 1]]], "seen": [[0, node] for node in SEEN], "steps": [2000, 4000],
        "radius": 0.8, "nodes": NODES.tolist()})


def off(stiffer: float, found: Any) -> tuple[float, float]:
    """Largest distance from the exact places, m, and over the largest way."""
    want = exact(stiffer)
    apart = float(np.max(np.linalg.norm(found - want, axis=2)))
    return apart, apart / float(np.max(np.linalg.norm(want - want[:, :1], axis=2)))
