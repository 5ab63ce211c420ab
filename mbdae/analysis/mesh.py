"""Which mesh of beams modes were found on, and what it is off: the same analysis on a finer mesh."""

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

OF_A_RUN = ("mesh_error: the state of a run has no counterpart on a finer mesh: linearise about s.equilibrium() or the start, or "
            "repeat run and analysis with beams of one order more")  # fmt: skip


class OnMesh:
    """An analysis of a scene whose beams have a mesh: which one, and the error it makes."""

    prepared: Prepared
    _finer: Callable[[], Any] | None = None  #: the same analysis on a finer mesh; None of the state of a run

    @property
    def mesh(self) -> dict[str, tuple[tuple[int, ...], int]]:
        """The mesh of every beam by its name: the elements of each of its segments, and their order. Empty without beams."""
        beams = [line.beam for line in self.prepared.model.lines]
        return {beam.name: (tuple(int(n) for n in np.atleast_1d(beam.elements)), beam.order) for beam in beams}

    @cached_property
    def mesh_error(self) -> Array | None:
        """The error that the mesh of beams makes in each of `roots`, relative to it: the difference from the same analysis with
        elements of one order more (of the highest order: twice as many), made when this is read. NaN where no root of the finer
        mesh is left to compare with; None without beams. Raises OptionError for the state of a run, which is on its own mesh."""
        if not self.prepared.model.lines:
            return None
        if self._finer is None:
            raise OptionError(OF_A_RUN)
        here, there = self.roots, self._finer().roots
        mine, others = linear_sum_assignment(np.abs(here[:, None] - there) ** 2)  # squares: real roots in their order
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
    """The analysis again(scene, at=) with finer beams; None where the state `at` is one of a run, on a mesh of its own."""
    if at is not None and not isinstance(at, Equilibrium):
        return None
    return partial(_with_finer_beams, again, scene, None if at is None else at.frame)


def _with_finer_beams(again: Callable[..., Any], scene: SceneData, frame: str | None) -> Any:
    """The analysis on a finer mesh; frame: that in which its state is at rest, None: the start of the scene."""
    fine = with_finer_beams(scene)
    return again(fine, at=None if frame is None else equilibrium(fine, frame))
