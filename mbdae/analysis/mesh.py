"""The mesh of beams on which modes were found, and the error it causes, measured by the same analysis on a finer mesh."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from mbdae.analysis.equilibrium import Equilibrium, equilibrium
from mbdae.errors import OptionError
from mbdae.notation import counted
from mbdae.run.mesh import with_finer_beams
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared


class OnMesh:
    """Base of analyses of a scene: whether it is planar; with beams their mesh, and the error that it causes."""

    prepared: Prepared
    #: makes the same analysis on a finer mesh; None where the state analysed is one of a run, which exists on the mesh of the run
    #: only
    _finer: Callable[[], Any] | None = None

    @property
    def _plane(self) -> str:
        """What a print says of a planar scene, whose equations have no motion out of the plane; "" in space."""
        return ", planar" if self.prepared.model.planar else ""

    @property
    def mesh(self) -> dict[str, tuple[tuple[int, ...], int]]:
        """The mesh of every beam by its name: the elements of each of its segments, and their order. Empty without beams."""
        beams = [line.beam for line in self.prepared.model.lines]
        return {beam.name: (tuple(int(n) for n in np.atleast_1d(beam.elements)), beam.order) for beam in beams}

    @cached_property
    def mesh_error(self) -> Array | None:
        """The error that the mesh of beams causes in each of `roots`, relative to the root: its difference from the same analysis
        with elements of one order more (twice as many elements where the order is the highest), which is made when this is read.
        NaN for a root without counterpart on the finer mesh; None without beams. Raises OptionError for the state of a run, which
        exists on the run's mesh only."""
        if not self.prepared.model.lines:
            return None
        if self._finer is None:
            raise OptionError("mesh_error: the state of a run has no counterpart on a finer mesh: linearise about "
                              "s.equilibrium() or the start, or repeat run and analysis with beams of one order "
                              "more")  # fmt: skip
        here, there = self.roots, self._finer().roots
        # pairs of roots with the least sum of squared distances: with squares, real roots are paired in rising order
        mine, others = linear_sum_assignment(np.abs(here[:, None] - there) ** 2)
        error, size = np.full(len(here), np.nan), np.maximum(np.abs(there[others]), np.finfo(float).tiny)
        error[mine] = np.abs(here[mine] - there[others]) / size
        return error

    @property
    def roots(self) -> Any:
        """What `mesh_error` compares: the eigenvalues of the modes, or the multipliers."""
        raise NotImplementedError

    @property
    def _on_mesh(self) -> str:
        """The mesh and its error in words; "" without beams."""
        if not self.mesh:
            return ""
        beams = ", ".join(f"'{name}' {counted(sum(elements), 'element')} of order {order}"
                          for name, (elements, order) in self.mesh.items())  # fmt: skip
        if "mesh_error" in vars(self):
            return f"mesh of {beams}: relative error of at most {np.nanmax(vars(self)['mesh_error'], initial=0.0):.1e}"
        return f"mesh of {beams}: its error is not covered{' (.mesh_error measures it)' if self._finer is not None else ''}"


def finer(again: Callable[..., Any], scene: SceneData, at: Any) -> Callable[[], Any] | None:
    """A function that makes the analysis again(scene, at=...) with finer beams; None where the state `at` is one of a run, which
    exists on the mesh of the run only."""
    if at is not None and not isinstance(at, Equilibrium):
        return None
    return partial(_with_finer_beams, again, scene, None if at is None else at.frame)


def _with_finer_beams(again: Callable[..., Any], scene: SceneData, frame: str | None) -> Any:
    """The analysis on a finer mesh, at the equilibrium in `frame`, or at the start of the scene where frame is None."""
    fine = with_finer_beams(scene)
    return again(fine, at=None if frame is None else equilibrium(fine, frame, out_of_plane=False))
