"""Joint-space dynamics against kinematics alone, Pinocchio and MuJoCo, and files that are written and read back."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Sequence
from contextlib import chdir
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from robots import beside, drawn
from robots.beside import MJCF, STATES, URDF, off, place, robot
from robots.damaged import FILES, read_all
from robots.own import Chain
from runner import Case, Claim, Found

import mbdae as mb

claim = Claim("robots", "mass matrices, inverse and forward dynamics, Jacobians of trees and their runs are those of other "
              "programs; what is written as MJCF is the same mechanism; damaged files end in one clear error", 1e-10,
              "of the largest entry", "kinematics with complex steps; Pinocchio and MuJoCo where they are installed, on robots "
              "that packages of the registry carry")


def chain(seed: int) -> list[Found]:
    """A chain of revolute and prismatic joints about any axes against `own`."""
    own, rng = Chain(seed), np.random.default_rng(seed)
    s = mb.Scene("chain", gravity=tuple(own.g))
    k = s.ground
    for i, slides in enumerate(own.slides):
        body = s.rigid_body(f"b{i}", own.masses[i], own.J[i], at=own.centres[i])
        s.joint(mb.Prismatic if slides else mb.Revolute, f"J{i}", k, body, at=own.at[i], axis=own.axes[i], rotor=own.rotors[i])
        k = body
    tree, worst = s.tree(), np.zeros(3)
    for _ in range(STATES):
        q, v = rng.normal(size=(2, tree.nv))
        M, X = own.mass(q)
        worst = np.maximum(worst, (off(tree.mass_matrix(q), M), off(tree.bias(q, v), own.bias(q, v)),
                                   off(tree.jacobian(k.name, q)[:3], X[-1])))
    return [Found(worst[0], quantity="M"), Found(worst[1], 1e-8, quantity="bias, by differences"),
            Found(worst[2], quantity="Jacobian")]


def written(name: str) -> Found:
    """M and bias of a robot that is written and read back; the writing compares them too."""
    s, _ = robot(name)
    with tempfile.TemporaryDirectory() as folder:
        s.write_mjcf(Path(folder) / "out.xml")
        again, tree = mb.read_mjcf(Path(folder) / "out.xml", limits=False, keep_inertias=True).tree(), s.tree()
    rng, worst, of = np.random.default_rng(2), 0.0, [again.coordinates.index(name) for name in tree.coordinates]
    first = 6 if tree.nq > tree.nv else 0
    for _ in range(STATES):
        q, v, there, rates = tree.zero + 0.0, rng.normal(size=tree.nv), again.zero + 0.0, np.zeros(tree.nv)
        values = rng.normal(size=tree.nv)
        q[first + tree.nq - tree.nv :], rates[of] = values[first:], v
        values[of] = values.copy()
        there[first + tree.nq - tree.nv :] = values[first:]
        M, bias = again.mass_matrix(there)[np.ix_(of, of)], again.bias(there, rates)[of]
        worst = max(worst, off(M, tree.mass_matrix(q)), off(bias, tree.bias(q, v)))
    return Found(worst, 1e-9)


def quiet(measure: Any, *args: Any) -> Any:
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder, chdir(folder):  # MuJoCo writes a log where it is
        warnings.simplefilter("ignore", mb.AccuracyWarning)
        return measure(*args)


def damaged(numbers: Sequence[int]) -> list[Found]:
    """Damaged and hostile files: one error of the package each, in bounded time and memory; nothing fetched, started, written."""
    found = read_all(list(numbers))
    bad = [one for one in found if one["verdict"] not in ("error", "told")]
    note = "; ".join(f"{one['n']} {one['way']}: {one['verdict']}: {one['words']}" for one in bad[:3])
    return [Found(len(bad), 0, "files", "silent, unclear, crashed or touched", note=note),
            Found(max(one["cpu"] for one in found), 10, "CPU s", "longest"),
            Found(max(one["memory"] for one in found) / 1e6, 1000, "MB", "memory of the process")]


def cases() -> list[Case]:
    """Robots where the packages that carry and judge them are installed; chains everywhere."""
    found = [Case(f"chain {seed}", "tree", partial(chain, seed), slow=seed > 1) for seed in range(10)]
    seeds = [*range(drawn.MODELS)]
    suites: list[tuple[str, str, Any, Sequence[Any]]] = []
    if place("pinocchio") is not None and place("yourdfpy") is not None:
        suites += [("drawn", "Pinocchio", drawn.against_pinocchio, seeds)]
        suites += [("robots", "Pinocchio", beside.against_pinocchio, [*URDF])] if beside.descriptions() is not None else []
    if place("mujoco") is not None and place("gymnasium") is not None and place("dm_control") is not None:
        suites += [("accelerations", "MuJoCo", beside.against_mujoco, [*MJCF]), ("written", "MuJoCo", written, [*MJCF]),
                   ("runs", "MuJoCo", beside.run_beside_mujoco, [*MJCF])]
    if place("mujoco") is not None:
        suites += [("drawn, accelerations", "MuJoCo", drawn.at_states, seeds), ("drawn, runs", "MuJoCo", drawn.run, seeds),
                   ("drawn, closed", "MuJoCo", drawn.closed, seeds)]
    found += [Case(name, by, partial(quiet, measure), slow=True, parts=parts, each=True) for name, by, measure, parts in suites]
    if place("mujoco") is not None and place("yourdfpy") is not None:
        found.append(Case("damaged files", "reading", damaged, slow=True, parts=[*range(FILES)]))
    return found
