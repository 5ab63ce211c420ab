"""CPU time of the reduction beside SciPy's own solvers, and of a run beside a scene of rigid bodies; derivatives; bad input."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from reduced_bodies.beam import LENGTH, PER_LENGTH, beam_matrices
from scipy.sparse.linalg import LinearOperator, eigsh, splu

import mbdae as mb

MODES, BEST = 20, 3


def best(call: Callable[[], Any], repeats: int = BEST) -> float:
    """The least CPU time of some calls, s."""
    found = []
    for _ in range(repeats):
        begin = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            call()
        found.append(time.process_time() - begin)
    return min(found)


def reduction() -> tuple[float, str]:
    """CPU of a reduction over that of factors (splu) and of the same modes (eigsh with these) of the stiffness with both ends
    held: a beam of hexahedra."""
    import meshio
    import skfem as fem

    from mbdae.inputs.matrices import assembled

    mesh = fem.MeshHex.init_tensor(np.linspace(0, 1, 22), np.linspace(0, 0.2, 8), np.linspace(0, 0.2, 8))
    cells = [("hexahedron", mesh.t.T[:, [0, 1, 4, 2, 3, 5, 7, 6]])]
    M, K, nodes, *_ = assembled(meshio.Mesh(mesh.p.T, cells), 2.1e11, 0.3, 7800.0, 1.0, 2, "beam")
    ends = {name: np.flatnonzero(np.abs(nodes[:, 0] - x) < 1e-9) for name, x in (("root", 0.0), ("tip", 1.0))}
    free = np.setdiff1d(np.arange(len(nodes)), np.concatenate(list(ends.values())))
    dofs = (3 * free[:, None] + np.arange(3)).ravel()
    inner, mass = (sp.csc_matrix(A[dofs][:, dofs]) for A in (K, M))

    def peer() -> None:
        factors = splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        solve = LinearOperator(inner.shape, matvec=factors.solve)
        eigsh(inner, MODES, mass, sigma=0.0, OPinv=solve)

    own, other = best(lambda: mb.ReducedBody.craig_bampton(M, K, nodes, ends, MODES), 2), best(peer, 2)
    return own / other, f"{3 * len(nodes)} freedoms, {MODES} modes: {own:.1f} s beside {other:.1f} s of splu and eigsh"


def pendulum() -> mb.Scene:
    """A pendulum of 20 modes of the free body."""
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.reduced_body("beam", mb.ReducedBody.craig_bampton(*beam_matrices(10), {"root": [0], "tip": [10]}, 14))
    s.revolute("hinge", s.ground, "beam.root", at=(0, 0, 0), axis=(0, 0, 1))
    return s


def chain(count: int) -> mb.Scene:
    """A chain of rigid bodies in space of the same length and mass, hinged without springs, joints by rows with multipliers."""
    s, h = mb.Scene("chain", gravity=(0, -9.81, 0), space="spatial"), LENGTH / count
    mass, last = PER_LENGTH * h, s.ground
    for i in range(count):
        body = s.rigid_body(f"body {i}", mass, (1e-4 * h, mass * h**2 / 12, mass * h**2 / 12), at=((i + 0.5) * h, 0, 0))
        s.revolute(f"hinge {i}", last, body, at=(i * h, 0, 0), axis=(0, 0, 1), model=mb.Kinematic())
        last = body
    return s


def run(accuracy: float) -> tuple[float, str]:
    """CPU of the whole call of a run of .2 s over that of a chain of rigid bodies with as many unknowns, multipliers included."""
    one, other = pendulum(), chain(22)
    times = [best(lambda s=s: s.simulate(0.2, accuracy), 5) for s in (one, other)]
    unknowns = [s.system(mb.GGL()).n for s in (one, other)]
    return times[0] / times[1], (f"{times[0]:.3f} s with {unknowns[0]} unknowns beside {times[1]:.3f} s of 22 rigid bodies with "
                                 f"{unknowns[1]}, both GGL and Radau IIA")


def loaded(size: float) -> mb.Scene:
    s = mb.Scene("derivatives", gravity=(0, -9.81, 0))
    body = mb.ReducedBody.craig_bampton(*beam_matrices(6, 2.1e10), {"root": [0], "tip": [6]}, 2, True)
    s.reduced_body("beam", body, damping=0.02)
    s.revolute("hinge", s.ground, "beam.root", at=(0, 0, 0), damper=0.3)
    s.force("F", "beam.tip", (0, 100 * mb.number("size", size) * mb.t, 0))
    return s


def derivatives() -> tuple[float, float]:
    """Relative differences of the derivatives of the tip's place and of the hinge's force from differences of runs."""
    step, end = 1e-3, 0.05
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = loaded(1.0).simulate(end, 1e-7, derivatives=True)
        known = [made.gradient(mb.at_end(q), to=["size"])["size"].value for q in ("beam.tip.position[1]", "hinge.force[1]")]
        below, above = (loaded(1 + d).simulate(end, 1e-8) for d in (-step, step))
    ends = [(r["beam.tip"].position[-1, 1], r["hinge"].force[-1, 1]) for r in (below, above)]
    differences = (np.array(ends[1]) - np.array(ends[0])) / (2 * step)
    place, force = np.abs(np.array(known) / differences - 1)
    return float(place), float(force)


def misunderstood() -> list[str]:
    """Kinds of bad input that are not refused by a message that names them."""
    M, K, nodes = beam_matrices(4)
    apart = sp.block_diag([beam_matrices(2)[0]] * 2), sp.block_diag([beam_matrices(2)[1]] * 2), np.vstack(
        [beam_matrices(2)[2], beam_matrices(2)[2] + [2, 0, 0]])
    order = np.arange(30).reshape(5, 6).T.ravel()
    negative = sp.csc_matrix(M + sp.csc_matrix(([-5e-3, -5e-3], ([9, 15], [15, 9])), shape=(30, 30)))
    given = {"indefinite M": ((negative, K, nodes, {"a": [0]}), "M is indefinite"),
             "indefinite K": ((M, -K, nodes, {"a": [0]}), "K is indefinite"),
             "a mechanism": ((*apart, {"a": [0]}), "mechanism"),
             "wrong order": ((M[order][:, order], K[order][:, order], nodes, {"a": [0]}), "not in the order"),
             "units of 1e9 Hz": ((M * 1e-14, K, nodes, {"a": [0]}), "M in kg, K in N/m"),
             "nodes in mm": ((M, K, 1e3 * nodes, {"a": [0]}), "nodes are in another order or unit"),
             "supports in K": ((M, K + sp.diags([1e9] * 3 + [0.0] * 27), nodes, {"a": [0]}), "without supports"),
             "no nodes": ((M, K, nodes, {"a": []}), "has no nodes"),
             "half of K": ((M, sp.triu(K), nodes, {"a": [0]}), "symmetric")}
    silent = []
    for kind, (arguments, words) in given.items():
        for reduce in (mb.ReducedBody.craig_bampton, mb.ReducedBody.free_interface):
            try:
                reduce(*arguments, 1)
                said = ""
            except mb.OptionError as error:
                said = str(error)
            if words not in said:
                silent.append(f"{kind} ({reduce.__name__})")
    return silent
