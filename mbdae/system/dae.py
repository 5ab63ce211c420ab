"""A textbook DAE F(t, y, y') = 0 as a System."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_matrix

from mbdae.errors import OptionError
from mbdae.system.base import SWITCH_KINDS, Array, Switches, System
from mbdae.system.partition import checked_partition
from mbdae.ties import largest

#: largest residual at the start, relative to the terms each equation cancels
START_TOLERANCE = 1e-6
ROOT_EPS = float(np.sqrt(np.finfo(float).eps))


class DAE(System):
    """F(t, y, y') = 0 given by functions.

    residual  (t, y, yp, out) that fills out (n,), or the same returning an array (n,)
    y0, yp0   (n,) consistent start at t0
    jacobian  (t, y, yp, cj, out) that fills out with dF/dy + cj dF/dy', or the same returning it; out is (n, n),
              or (nnz,) CSC data where `sparsity` is given. None: forward differences column by column
              (2 n residuals per evaluation, six to eight correct digits: give an exact one for rtol below 1e-8)
    index     index of the variables: one number for the system, or (n,) as in RADAU5: 1 differential or
              index-1 algebraic, 2, 3. From one number, 2 marks the algebraic unknowns; 3 marks the algebraic
              unknowns as 3 and those whose derivatives share an equation with them as 2
    names     name of each unknown, default y[0], y[1], ...
    scale     typical magnitude of each unknown, default max(1, |y0|)
    sparsity  pattern (n, n) of the Jacobian, dense or scipy sparse; None: dense
    guards    (t, y) -> (gap, gap rate, duration) of the contacts, each (nc,) in m, m/s and s, as in `System`; None: no contacts
    guard_names  name of each contact, default contact[0], contact[1], ...
    switches  what switches or is local in the equations (`mb.Switches`): adaptive solvers step over none of it; None: nothing
    partition  (M, f, g, G) of equations of motion with y = (q, u, lambda) or, stabilised, (q, u, lambda, mu) and q' = u + ...:
              functions M(t, q) (nu, nu), f(t, q, u) (nu,), g(t, q) (m,) and G(t, q) (m, nu); what GeneralizedAlpha and HHT need
    """

    label = "DAE"

    def __init__(
        self,
        residual: Callable[..., Any],
        y0: ArrayLike,
        yp0: ArrayLike,
        jacobian: Callable[..., Any] | None = None,
        index: int | Sequence[int] | NDArray[np.int_] = 1,
        names: Sequence[str] | None = None,
        *,
        t0: float = 0.0,
        scale: ArrayLike | None = None,
        sparsity: Any = None,
        guards: Callable[[float, Array], tuple[Array, Array, Array]] | None = None,
        guard_names: Sequence[str] | None = None,
        switches: Switches | None = None,
        partition: tuple[Callable[..., Any], ...] | None = None,
    ) -> None:
        self.t0 = float(t0)
        self.y0 = finite_vector("y0", y0)
        self.n = len(self.y0)
        self.yp0 = finite_vector("yp0", yp0, self.n)
        self.scale = np.maximum(1.0, np.abs(self.y0)) if scale is None else self._checked_scale(scale)
        self.names = self._checked_names(names)
        self.equations = tuple(f"F[{i}]" for i in range(self.n))
        self.sparsity = None if sparsity is None else csc_pattern(sparsity, self.n)
        self._function, self._jacobian = residual, jacobian
        self._check_residual()
        self._check_jacobian()
        parts = [self._dense_parts(*point) for point in self._probes()]
        self._check_start(*parts[0])
        self.index = self._checked_index(index, parts)
        algebraic = (self.index > 1) & ~np.any([fyp != 0 for _, fyp in parts], axis=(0, 1))
        self.kinds = tuple("lambda" if found else "y" for found in algebraic)
        if partition is not None:
            self.partition, self.kinds = checked_partition(self, partition)
        self.guards = guards
        self.guard_names = self._checked_guards(guard_names)
        self.switches = self._checked_switches(switches)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """out[:] = F(t, y, yp)."""
        value = self._function(t, y, yp, out)
        if value is not None:
            out[:] = value

    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        """out[...] = dF/dy + cj dF/dy'."""
        if self._jacobian is None:
            fy, fyp = self.jacobian_parts(t, y, yp)
            out[...] = fy + cj * fyp
            return
        value = self._jacobian(t, y, yp, cj, out)
        if value is not None:
            out[...] = value

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy'."""
        if self._jacobian is not None:
            return super().jacobian_parts(t, y, yp)
        fy, fyp = self._differences(t, y, yp)
        if self.sparsity is None:
            return fy, fyp
        rows, columns = self._entries()
        return fy[rows, columns], fyp[rows, columns]

    def _differences(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """Forward differences (n, n) with increments of sqrt(eps) times the magnitude of each argument."""
        base, shifted = np.empty(self.n), np.empty(self.n)
        self.residual(t, y, yp, base)
        parts = np.empty((2, self.n, self.n), order="F")
        arguments = [np.array(y, dtype=float), np.array(yp, dtype=float)]
        for which, x in enumerate(arguments):
            for j in range(self.n):
                kept = x[j]
                x[j] = kept + ROOT_EPS * max(abs(kept), self.scale[j]) * (1.0 if kept >= 0 else -1.0)
                self.residual(t, arguments[0], arguments[1], shifted)
                parts[which, :, j] = (shifted - base) / (x[j] - kept)
                x[j] = kept
        return parts[0], parts[1]

    def _entries(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Row and column (nnz,) of the entries of the pattern."""
        return self.sparsity.indices, np.repeat(np.arange(self.n), np.diff(self.sparsity.indptr))

    def _dense_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        fy, fyp = self.jacobian_parts(t, y, yp)
        if self.sparsity is None:
            return fy, fyp
        full = np.zeros((2, self.n, self.n))
        rows, columns = self._entries()
        full[0, rows, columns], full[1, rows, columns] = fy, fyp
        return full[0], full[1]

    def _probes(self) -> list[tuple[float, Array, Array]]:
        """The start, and two points beside it where no entry of the Jacobian vanishes by chance."""
        wave = np.sin(1.0 + np.arange(self.n))
        dy, dyp = self.scale * wave, self.scale * wave[::-1]
        return [(self.t0, self.y0 + k * dy, self.yp0 + k * dyp) for k in (0.0, 1e-3, -7e-4)]

    def _checked_scale(self, scale: ArrayLike) -> Array:
        values = np.full(self.n, scale, dtype=float) if np.ndim(scale) == 0 else finite_vector("scale", scale, self.n)
        if not (np.isfinite(values).all() and (values > 0).all()):
            raise OptionError(f"scale = {scale!r}: give positive typical magnitudes, one number or one per unknown")
        return values

    def _checked_names(self, names: Sequence[str] | None) -> tuple[str, ...]:
        if names is None:
            return tuple(f"y[{i}]" for i in range(self.n))
        if len(names) != self.n or len(set(names)) != self.n:
            raise OptionError(f"names = {list(names)}: give {self.n} different names, one per unknown")
        return tuple(names)

    def _checked_switches(self, switches: Switches | None) -> Switches | None:
        """The switches, whose arguments are tried at the start."""
        if switches is None:
            return None
        values = np.asarray(switches.arguments(np.full(2, self.t0), np.array([self.y0, self.y0])))
        count = len(switches.kinds)
        if values.shape != (2, count) or np.shape(switches.weights) != (count,) or len(switches.names) != count:
            raise OptionError(
                f"switches: arguments at 2 points have shape {values.shape}, weights {np.shape(switches.weights)}, names "
                f"({len(switches.names)},) for {count} kinds: return (2, {count}), and give {count} weights and names"
            )
        unknown = sorted(set(switches.kinds) - set(SWITCH_KINDS))
        if unknown:
            raise OptionError(f"switches: kind {unknown[0]!r} is not known: give one of {list(SWITCH_KINDS)}")
        return switches

    def _checked_guards(self, names: Sequence[str] | None) -> tuple[str, ...]:
        """Names (nc,) of the contacts, whose guards are tried at the start."""
        if self.guards is None:
            if names is not None:
                raise OptionError(f"guard_names = {list(names)} without guards: give guards too")
            return ()
        try:
            gap, rate, duration = (np.asarray(part, dtype=float) for part in self.guards(self.t0, self.y0.copy()))
        except (TypeError, ValueError) as error:
            raise OptionError("guards returns no three arrays: return (gap, gap rate, duration), each (nc,)") from error
        if gap.ndim != 1 or not gap.shape == rate.shape == duration.shape:
            raise OptionError(f"guards returns shapes {gap.shape}, {rate.shape}, {duration.shape}: return three times (nc,)")
        chosen = tuple(f"contact[{i}]" for i in range(len(gap))) if names is None else tuple(names)
        if len(chosen) != len(gap) or len(set(chosen)) != len(gap):
            raise OptionError(f"guard_names = {list(chosen)}: give {len(gap)} different names, one per contact")
        for name, g, r, d in zip(chosen, gap, rate, duration, strict=True):
            if not (np.isfinite(g) and np.isfinite(r) and d > 0):
                raise OptionError(
                    f"guards of {name} at the start t = {self.t0}: gap {g}, gap rate {r}, duration {d}: "
                    "gap and rate have to be finite, the duration positive (inf: no impact)"
                )
        return chosen

    def _check_residual(self) -> None:
        out = np.full(self.n, np.nan)
        value = self._function(self.t0, self.y0.copy(), self.yp0.copy(), out)
        if value is not None:
            if np.shape(value) != (self.n,):
                raise OptionError(f"residual returns shape {np.shape(value)}: return ({self.n},) or fill out")
            out[:] = value
        if not np.isfinite(out).all():
            row = int(np.flatnonzero(~np.isfinite(out))[0])
            raise OptionError(
                f"residual F[{row}] = {out[row]} at the start t = {self.t0}: "
                "fill every entry of out and check the start values"
            )

    def _check_jacobian(self) -> None:
        if self._jacobian is None:
            return
        shape = (self.n, self.n) if self.sparsity is None else (self.sparsity.nnz,)
        out = np.zeros(shape)
        value = self._jacobian(self.t0, self.y0.copy(), self.yp0.copy(), 1.0, out)
        if value is not None and np.shape(value) != shape:
            raise OptionError(f"jacobian returns shape {np.shape(value)}: return {shape} or fill out")
        found = out if value is None else np.asarray(value, dtype=float)
        if not np.isfinite(found).all():
            raise OptionError(f"jacobian is not finite everywhere at the start t = {self.t0}: check its formulas")

    def _check_start(self, fy: Array, fyp: Array) -> None:
        """Refuse a start whose residual is large against the terms of its equation."""
        out = np.empty(self.n)
        self.residual(self.t0, self.y0, self.yp0, out)
        size = np.abs(fy) @ self.scale + np.abs(fyp) @ np.maximum(self.scale, np.abs(self.yp0))
        relative = np.abs(out) / np.where(size > 0, size, 1.0)
        row = largest(relative)
        if relative[row] > START_TOLERANCE:
            raise OptionError(
                f"the start is not consistent: F[{row}] = {out[row]:.3e} at t = {self.t0}, {relative[row]:.1e} of the "
                f"size of its terms: correct y0 or yp0 (the equation contains {self._contents(row, fy, fyp)})"
            )

    def _contents(self, row: int, fy: Array, fyp: Array) -> str:
        present = (fy[row] != 0) | (fyp[row] != 0)
        return ", ".join(name for name, is_in in zip(self.names, present, strict=True) if is_in) or "no unknown"

    def _checked_index(self, index: Any, parts: list[tuple[Array, Array]]) -> NDArray[np.int_]:
        """(n,) index of each unknown."""
        values = np.asarray(index)
        if values.shape not in ((), (self.n,)) or values.dtype.kind not in "iu" or not np.isin(values, (1, 2, 3)).all():
            raise OptionError(f"index = {index}: give 1, 2 or 3, or {self.n} of them, one per unknown")
        if values.ndim:
            return values.astype(int)
        present_y = np.any([fy != 0 for fy, _ in parts], axis=0)
        present_yp = np.any([fyp != 0 for _, fyp in parts], axis=0)
        algebraic = ~present_yp.any(axis=0)
        result = np.where(algebraic, int(values), 1)
        if values == 3:
            forced = present_y[:, algebraic].any(axis=1)
            result[present_yp[forced].any(axis=0)] = 2
        return result


def finite_vector(name: str, values: ArrayLike, n: int | None = None) -> Array:
    """A float copy (n,) of values, or an error that names the entry at fault."""
    vector = np.array(values, dtype=float)
    if vector.ndim != 1 or len(vector) == 0 or (n is not None and len(vector) != n):
        raise OptionError(f"{name} has shape {vector.shape}: give {n or 'at least 1'} numbers in one dimension")
    if not np.isfinite(vector).all():
        j = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise OptionError(f"{name}[{j}] = {vector[j]}: give finite numbers")
    return vector


def csc_pattern(pattern: Any, n: int) -> csc_matrix:
    """CSC pattern (n, n) with sorted indices."""
    result = csc_matrix(pattern, dtype=float)
    if result.shape != (n, n):
        raise OptionError(f"sparsity has shape {result.shape}: give ({n}, {n})")
    result.sort_indices()
    return result
