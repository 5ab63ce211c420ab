"""A plate and a bracket of solid elements, assembled by scikit-fem: the force at their foot against all freedoms."""

from __future__ import annotations

import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp
from scipy.linalg import eigh
from scipy.sparse import csc_matrix, hstack

import mbdae as mb

END = 4.0  #: periods of the load
STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7800.0}
FORCE = (0.3, -0.2, 1.0)  #: N, so small that displacements are
SHAPES = {"plate": (0.3, 0.2, 0.01), "bracket": (0.2, 0.06, 0.15)}


@cache
def model(shape: str) -> Any:
    """The model that `mb.read_fe` makes of a mesh in a file."""
    import meshio
    import skfem

    x, y, z = SHAPES[shape]
    if shape == "plate":
        mesh = skfem.MeshHex.init_tensor(np.linspace(0, x, 9), np.linspace(0, y, 6), np.linspace(0, z, 2))
        cells = [("hexahedron", mesh.t.T[:, [0, 1, 4, 2, 3, 5, 7, 6]])]
    else:  # an L: a foot along x, an arm along z
        block = skfem.MeshTet.init_tensor(np.linspace(0, x, 9), np.linspace(0, y, 3), np.linspace(0, z, 7))
        middle = block.p[:, block.t].mean(axis=1)
        mesh = block.restrict(np.flatnonzero((middle[2] < 0.03) | (middle[0] < 0.03)))
        cells = [("tetra", mesh.t.T)]
    with tempfile.TemporaryDirectory() as folder:
        meshio.Mesh(mesh.p.T, cells).write(path := Path(folder) / "mesh.vtk")
        return mb.read_fe(path, **STEEL)


def ends(shape: str) -> dict[str, Any]:
    """Nodes of the foot, which is held, and of the head, which is loaded."""
    x, _, z = SHAPES[shape]
    at = model(shape).nodes
    head = at[:, 2] > z - 1e-9 if shape == "bracket" else at[:, 0] > x - 1e-9
    foot = at[:, 0] > x - 1e-9 if shape == "bracket" else at[:, 0] < 1e-9
    return {"foot": np.flatnonzero(foot), "head": np.flatnonzero(head)}


def rigid(nodes: Any, about: Any) -> Any:
    """(3 k, 6) displacements of nodes by translations and rotations about a point."""
    out = np.zeros((len(nodes), 3, 6))
    out[:, :, :3] = np.eye(3)
    for a in range(3):
        out[:, :, 3 + a] = np.cross(np.eye(3)[a], nodes - about)
    return out.reshape(-1, 6)


@cache
def whole(shape: str) -> tuple[Any, ...]:
    """All modes with the foot held and the head rigid: frequencies, shares of a force at the head, and of the foot's force."""
    fe, at = model(shape), ends(shape)
    k = len(fe.nodes)
    head = np.zeros((k, 3, 6))
    head[at["head"]] = rigid(fe.nodes[at["head"]], fe.nodes[at["head"]].mean(axis=0)).reshape(-1, 3, 6)
    free = np.setdiff1d(np.arange(k), np.concatenate(list(at.values())))
    dofs = (3 * free[:, None] + np.arange(3)).ravel()
    T = hstack([csc_matrix(head.reshape(-1, 6)), csc_matrix((np.ones(len(dofs)), (dofs, np.arange(len(dofs)))),
                                                            shape=(3 * k, len(dofs)))]).tocsc()
    values, vectors = eigh((T.T @ fe.K @ T).toarray(), (T.T @ fe.M @ T).toarray())
    foot = np.zeros((k, 3, 3))
    foot[at["foot"]] = np.eye(3)
    foot = foot.reshape(-1, 3)
    return values, np.asarray(FORCE) @ vectors[:3], (foot.T @ (fe.K @ T)) @ vectors, (foot.T @ (fe.M @ T)) @ vectors


def reference(shape: str, rate: float, t: Any) -> Any:
    """(nt, 3) force on the foot, N, for the load FORCE (1 - cos(rate t)) / 2 at the head, by superposition of all modes."""
    values, load, stiff, inert = whole(shape)
    w = np.sqrt(values)[:, None]
    forced, own = np.cos(rate * t)[None], np.cos(w * t[None])
    q = load[:, None] / 2 * ((1 - own) / values[:, None] - (forced - own) / (values[:, None] - rate**2))
    acceleration = load[:, None] * (1 - forced) / 2 - values[:, None] * q
    return (stiff @ q + inert @ acceleration).T


def error(shape: str, share: float) -> tuple[float, str]:
    """Largest error of the force at the foot over its largest value; share: of the load's rate to the lowest of the body."""
    rate = share * float(np.sqrt(whole(shape)[0][0]))
    fe = model(shape)
    body = fe.reduced(ends(shape), accelerations=True, accuracy=1e-3, up_to=rate / (2 * np.pi))
    foot, head = (fe.nodes[n].mean(axis=0) for n in ends(shape).values())
    s = mb.Scene(shape)
    s.reduced_body("body", body)
    s.weld("wall", s.ground, "body.foot", at=foot)
    s.force("F", "body.head", tuple(f * (1 - sp.cos(rate * mb.t)) / 2 for f in FORCE), at=head)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        r = s.simulate(END * 2 * np.pi / rate, accuracy=1e-4, of=["wall.force"])
    want = reference(shape, rate, r.t)
    off = np.max(np.linalg.norm(r["wall"].force - want, axis=1)) / np.max(np.linalg.norm(want, axis=1))
    return float(off), (f"{3 * len(fe.nodes)} freedoms, {len(body.modal_mass)} modes of the free body, load at {share:g} of the "
                        f"lowest frequency, told {r.accuracy.of['wall.force']:.1e}")
