"""The discretisation error of beams, by the difference from the same run on a finer mesh.

The finer mesh has the same elements with one order more; measured, the estimate is 0.5 to 1.9 times the error. A comparison with
half the elements can give a thousandth of the error where a coarse mesh shifts the frequencies of vibrations (docs/beams.md).
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np

from mbdae.errors import OptionError
from mbdae.formulations import Form, system_for
from mbdae.integrators.base import Asked, Solver
from mbdae.integrators.solution import Solution
from mbdae.laws.elements.line_shape import ORDERS, table
from mbdae.results.beams import Fields, in_space
from mbdae.results.reactions import OtherRun
from mbdae.results.states import states_of
from mbdae.scene.components import Beam, Station
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.system.distance import position_distance
from mbdae.system.model.beams import Line
from mbdae.system.prepare import Prepared, prepare

TIMES = 201  #: number of times at which both meshes are compared
PLACES = np.linspace(0, 1, 5)  #: places of every element, from 0 to 1, at which both meshes are compared
#: fraction of an element by which a place at its end is moved inside it, to find the element of the other mesh on the same side
INWARDS = 1e-6


def with_finer_beams(scene: SceneData) -> SceneData:
    """A copy of the scene with beams of one order more, or with twice as many elements where there is no higher order."""
    try:
        finer = copy.deepcopy(scene)
    except TypeError as error:  # a law of the user's contains what cannot be copied: an open file, a lock, ...
        raise OptionError(f"scene '{scene.name}' cannot be copied, as a finer mesh needs ({error}): keep such an object, like an "
                          "open file, out of its laws") from error
    for beam in (body for body in finer.bodies if isinstance(body, Beam)):
        if beam.order < max(ORDERS):
            vars(beam)["order"] += 1
        else:
            vars(beam)["elements"] = (2 * np.asarray(beam.elements)).tolist()
    return finer


def mesh_error(prepared: Prepared, form: Form, solver: Solver, run: Solution, asked: Asked) -> tuple[float, OtherRun]:
    """Largest difference of positions (over the scene's length, rad), along the beams and of all bodies, between a run and the
    same run on a finer mesh; and that finer run, with which reactions are compared too. The run must begin at the start of the
    scene. Raises MbdaeError where the finer run fails."""
    end = float(run.t[-1])
    finer = prepare(with_finer_beams(prepared.model.scene), t0=prepared.start.t, t_end=end)
    again = solver.run(system_for(finer, form, solver.highest_index), replace(asked, t_end=end))
    times = np.linspace(float(run.t[0]), end, TIMES)
    at = states_of(finer, again, times)
    apart = distance_of_meshes((prepared, prepared.states(times, run(times))[0]), (finer, at.q))
    return apart, OtherRun.beside(again, times, 1.0, finer, "mesh")


def distance_of_meshes(a: tuple[Prepared, Array], b: tuple[Prepared, Array]) -> float:
    """Largest difference of positions q (nt, nq) of a scene with two meshes: over the scene's length, angles in rad."""
    (coarse, q_a), (fine, q_b) = a, b
    lines = {line.beam.name: line for line in fine.model.lines}
    apart = [_along(line, q_a, lines[line.beam.name], q_b, coarse.length) for line in coarse.model.lines]
    nodes = {node.name: node for node in fine.model.nodes}
    for node in (node for node in coarse.model.nodes if not isinstance(node.body, Station)):
        other, size = nodes[node.name], node.kind.sizes[0]
        pair = q_a[:, node.q : node.q + size], q_b[:, other.q : other.q + size]
        apart.append(float(np.max(position_distance(coarse, node, *pair))))
    return max(apart)


def _along(line: Line, q: Array, other: Line, q_other: Array, length: float) -> float:
    """Largest difference between the sections of a beam on two meshes with positions q and q_other (nt, nq): over `length` (m),
    and of rotations in rad."""
    worst, ends = 0.0, other.mesh.places[np.r_[other.mesh.elements[:, 0], other.mesh.elements[-1, -1]]]
    for e, nodes in enumerate(line.mesh.elements):
        first, last = line.mesh.places[nodes[[0, -1]]]
        for xi in PLACES:
            place, inside = (first + x * (last - first) for x in (xi, xi + INWARDS * np.sign(0.5 - xi)))
            o = int(np.clip(np.searchsorted(ends, inside, side="right") - 1, 0, len(ends) - 2))
            there = float(np.clip((place - ends[o]) / (ends[o + 1] - ends[o]), 0, 1))
            (r, R), (r_o, R_o) = _section(line, q, e, float(xi)), _section(other, q_other, o, there)
            turned = 2 * np.arcsin(np.clip(np.linalg.norm(R - R_o, axis=(1, 2)) / np.sqrt(8), 0, 1))
            worst = max(worst, float(np.max(np.linalg.norm(r - r_o, axis=1))) / length, float(np.max(turned)))
    return worst


def _section(line: Line, q: Array, element: int, xi: float) -> tuple[Array, Array]:
    """Position (nt, 3), m, and axes (nt, 3, 3) of the section at xi of an element."""
    fields = Fields(line, table(line.mesh.order, np.array([xi])), element)
    found = fields.positions(q)
    return in_space(line, found)[:, 0, 0], fields.rotations(found)[:, 0, 0]
