"""A beam structure assembled by hand from the kernels of its elements: what the tests of this folder solve."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from mbdae.kernels.line import mass_blocks, reference_positions, strain_kernel
from mbdae.kernels.line_nodes import GyroscopicKernel
from mbdae.laws.line_mesh import LineMesh
from mbdae.symbolic.frames import NodeKind
from mbdae.threads import one_thread


class BeamStructure:
    """One beam with all nodes as unknowns; q (n, nq), u (n, nu), stresses z (m, points * stresses)."""

    def __init__(self, mesh: LineMesh, numbers: dict[str, float], planar: bool = False, mixed: bool = True) -> None:
        self.kind = NodeKind.PLANAR if planar else NodeKind.SPATIAL
        self.mesh, self.planar, self.mixed = mesh, planar, mixed
        self.kernel = strain_kernel(mesh, numbers, self.kind, mixed)
        self.blocks = mass_blocks(mesh, numbers, self.kind)
        self.gyro = None if planar else GyroscopicKernel(self.blocks, mesh.order + 1)
        self.nodes, self.kernel_nodes = len(mesh.positions), self.kernel.nodes
        self.nq, self.nu = self.kind.sizes
        self.m, self.nz = len(mesh.elements), len(self.kernel.names)
        self.q0 = reference_positions(mesh, self.kind)
        self.force_places = (self.nu * mesh.elements[:, :, None] + np.arange(self.nu)).reshape(self.m, -1)
        self.M = self.assembled(self.blocks, self.force_places, self.force_places)

    @property
    def size(self) -> int:
        return self.nodes * self.nu + self.m * self.nz

    def assembled(self, blocks: Any, rows: Any, columns: Any) -> Any:
        n = 1 + max(rows.max(), columns.max())
        A = np.zeros((n, n))
        np.add.at(A, (rows[:, :, None], columns[:, None, :]), blocks)
        return A

    def inputs(self, q: Any, z: Any, u: Any = None) -> Any:
        parts = [q[self.mesh.elements].reshape(self.m, -1)]
        if self.kernel.derived.damped:
            u = np.zeros((self.nodes, self.nu)) if u is None else u
            parts.append(u[self.mesh.elements].reshape(self.m, -1))
        return np.hstack([*parts, z])

    def internal(self, q: Any, z: Any, u: Any = None) -> tuple[Any, Any]:
        """Momentum rows (n, nu), left-hand side, with the gyroscopic term; rows of the stresses (m, nz)."""
        values = self.kernel.values(self.inputs(q, z, u))
        split = self.force_places.shape[1]
        forces = np.bincount(self.force_places.ravel(), values[:, :split].ravel()).reshape(self.nodes, self.nu)
        if self.gyro is not None and u is not None:
            spins = u[self.mesh.elements][..., 3:].reshape(self.m, -1)
            places = self.force_places.reshape(self.m, -1, self.nu)[..., 3:]
            forces += np.bincount(places.ravel(), self.gyro.values(spins).ravel()).reshape(self.nodes, self.nu)
        return forces, values[:, split:]

    def tangent(self, q: Any, z: Any) -> Any:
        """Derivative of all rows by virtual displacements of the nodes (body-frame rotations) and by stresses."""
        x = self.inputs(q, z)
        J = self.kernel.full_jacobian(x).transpose(1, 2, 0)
        nodal = self.mesh.order + 1
        by_q = self.kernel_nodes.velocity_columns(J[:, : nodal * self.nq], q[self.mesh.elements])
        blocks = np.concatenate([by_q, J[:, J.shape[1] - self.nz :]], axis=1).transpose(2, 0, 1)
        own = self.nodes * self.nu + np.arange(self.m * self.nz).reshape(self.m, self.nz)
        places = np.hstack([self.force_places, own])
        return self.assembled(blocks, places, places)

    def moved(self, q: Any, d: Any) -> Any:
        """Positions after virtual displacements d (n, nu); quaternions stay of unit length."""
        if self.planar:
            return q + d
        q = q.copy()
        q[:, :3] += d[:, :3]
        half = np.linalg.norm(d[:, 3:], axis=1, keepdims=True) / 2
        w, p = np.cos(half), d[:, 3:] / 2 * np.sinc(half / np.pi)
        a, b = q[:, 3:4], q[:, 4:]
        q[:, 3:] = np.hstack([a * w - np.sum(b * p, axis=1, keepdims=True), a * p + w * b + np.cross(b, p)])
        q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1, keepdims=True)
        return q

    def equilibrium(self, load: Any, steps: int = 1, q: Any = None, tolerance: float = 1e-11) -> tuple[Any, Any, int]:
        """q, z and the number of Newton iterations, the first node clamped, under dead nodal loads (n, nu)."""
        q, z = self.q0 if q is None else q, np.zeros((self.m, self.nz))
        count = 0
        for step in range(1, steps + 1):
            for _ in range(60):
                forces, rows = self.internal(q, z)
                residual = np.r_[(forces - load * step / steps).ravel(), rows.ravel()]
                d = np.zeros(self.size)
                d[self.nu :] = np.linalg.solve(self.tangent(q, z)[self.nu :, self.nu :], -residual[self.nu :])
                move = d[: self.nodes * self.nu].reshape(self.nodes, self.nu)
                q, z = self.moved(q, move), z + d[self.nodes * self.nu :].reshape(z.shape)
                count += 1
                if np.abs(move).max() < tolerance * self.mesh.length:
                    break
            else:
                raise AssertionError(f"no equilibrium in load step {step}")
        return q, z, count

    def tip_load(self, *components: float) -> Any:
        load = np.zeros((self.nodes, self.nu))
        load[-1] = components
        return load


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    with one_thread():
        yield


@pytest.fixture
def structure() -> type[BeamStructure]:
    return BeamStructure
