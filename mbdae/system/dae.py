"""Equations F(t, y, y') = 0 that a user gives as functions, as a System."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbdae.deferred import csc_matrix, issparse
from mbdae.errors import OptionError, WallClockError
from mbdae.notation import counted
from mbdae.system.base import Array, Switches, System
from mbdae.system.shown_index import Differences, checked_partition, contradiction
from mbdae.threads import check
from mbdae.values import array, function, largest, number, of_class, option, optional, sequence, shown, text

#: largest residual of an equation at the start that is accepted, over the magnitude of its terms as estimated from its
#: derivatives and the scales of the unknowns
START_TOLERANCE = 1e-6
#: name of a method of DAE -> function that does it; entered by the module that has it (`run.own.equations`), on which this one
#: must not depend
ATTACHED: dict[str, Callable[..., Any]] = {}


class DAE(System):
    """F(t, y, y') = 0 given by functions.

    residual  (t, y, yp, out) that fills out (n,), or the same returning an array (n,)
    y0, yp0   (n,) consistent start at t0
    jacobian  (t, y, yp, cj, out) that fills out with dF/dy + cj dF/dy', or the same returning it; out is (n, n),
              or (nnz,) CSC data where `sparsity` is given. None: forward differences, by IDA along
              (y, cj y') (n residuals), for others of y and y' (2 n); with a pattern fewer, as columns that have no row in
              common are changed together. Six to eight digits are right: give an exact one for rtol below 1e-8
    index     index of the variables: one number for the system, or (n,) as in RADAU5: 1 differential or
              index-1 algebraic, 2, 3. One number is given to all algebraic unknowns (no derivative of which is in F), and 1
              to the others; with 3, those whose derivative is in an equation with an algebraic unknown get 2
    names     name of each unknown, default y[0], y[1], ...
    scale     typical magnitude of each unknown, default max(1, |y0|)
    sparsity  pattern (n, n) of the Jacobian, dense or scipy sparse; None: dense
    guards    (t, y) -> (gap, gap rate, duration) of the contacts, each (nc,) in m, m/s and s, as in `System`; None: no contacts
    guard_names  name of each contact, default contact[0], contact[1], ...
    switches  functions in the equations that switch or vary within a narrow range (`mb.Switches`), so that no adaptive solver
              steps over them; None: none
    partition  (M, f, g, G) of equations of motion with y = (q, u, lambda) or, stabilised, (q, u, lambda, mu) and q' = u + ...:
              functions M(t, q) (nu, nu), f(t, q, u) (nu,), g(t, q) (m,) and G(t, q) (m, nu); what GeneralizedAlpha and HHT need
    rhs       (t, y, out) that fills out with y' (n,), or the same returning it, where nothing is constrained; what CVODE needs"""

    label = "DAE"
    _doubt: str | None = None
    declared: int | None = None  #: the index, where one number was given for the system

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
        rhs: Callable[..., Any] | None = None,
    ) -> None:
        self.t0 = option("t0", t0, number, "give the time of the start, s")
        self.y0 = finite_vector("y0", y0)
        self.n = len(self.y0)
        self.yp0 = finite_vector("yp0", yp0, self.n)
        self.scale = np.maximum(1.0, np.abs(self.y0)) if scale is None else self._checked_scale(scale)
        self.names = self._checked_names(names)
        self.equations = tuple(f"F[{i}]" for i in range(self.n))
        self.sparsity = None if sparsity is None else csc_pattern(sparsity, self.n)
        self._function = option("residual", residual, function, "give a function F(t, y, y', out)", takes="t, y, yp, out")
        self._jacobian = optional("jacobian", jacobian, function, "give a function J(t, y, y', cj, out), or None",
                                  takes="t, y, yp, cj, out")
        self._own_differences = Differences(self.residual, self.scale, self.sparsity)
        self.by_differences = jacobian is None
        self.differences = self.by_differences and self.sparsity is None
        self.guards = optional("guards", guards, function, "give a function (t, y), or None", takes="t, y")
        optional("switches", switches, of_class, "give mb.Switches(...), or None", base=Switches)
        self._check_residual()
        self._check_jacobian()
        parts = [self.dense_parts(*point) for point in self.probes()]
        self._check_start(self.yp0, *parts[0], "the start is not consistent", "correct y0 or yp0")
        self._rates: Any = optional("rhs", rhs, function, "give a function f(t, y, out), or None", takes="t, y, out")
        if self._rates is not None:
            self.rhs = self._filled_rates
            self.rhs(self.t0, self.y0.copy(), rates := np.full(self.n, np.nan))
            if not np.isfinite(rates).all():
                row = int(np.flatnonzero(~np.isfinite(rates))[0])
                raise OptionError(f"rhs: y'[{row}] = {rates[row]} at the start t = {self.t0:g} s: fill every entry of out, and "
                                  "check its formula")
            if jacobian is None:
                self.rate_jacobian = partial(self._own_differences.of_rates, self.rhs)
            self._check_start(rates, *parts[0], "rhs contradicts the residual", "correct one of the two functions")
        self.index = self._checked_index(index, parts)
        algebraic = (self.index > 1) & ~np.any([fyp != 0 for _, fyp in parts], axis=(0, 1))
        self.kinds = tuple("lambda" if found else "y" for found in algebraic)
        if partition is not None:
            self.partition, self.kinds = checked_partition(self, partition)
        self.guard_names = self._checked_guards(guard_names)
        self.switches = self._checked_switches(switches)

    def doubt(self, span: float) -> str:
        """What the declared index contradicts in the equations, in words; "" where it does not. span: time of the run, s."""
        if self._doubt is None:
            try:
                self._doubt = contradiction(self, span)
            except WallClockError:
                raise
            except Exception:  # a function that fails here fails in the run too, which says after which time
                self._doubt = ""
        return self._doubt

    def simulate(self, t_end: float, accuracy: float = 1e-6, solver: Any = None,
                 outputs: int | Sequence[float] | Array = 201, *, max_wall: float | None = None,
                 progress: Callable[..., None] | bool | None = None) -> Any:
        """Integrate to t_end (s), so that the error over the run is within `accuracy`: that of every unknown, multipliers too,
        over its largest value in the run or, where that is more, over 1e-3 of its `scale`. Returns the unknowns over time:
        `r["x"]` by name, `.t`, `.accuracy`, `.warnings`, `.reliable`, `r(t)` at other times.

        The error is estimated from a companion run at a looser tolerance, and the run repeated with a tighter one where needed.
        solver: an object, a class or a name; by default chosen. One with a tolerance or step of its own runs once, and its error
        is not known. outputs: a number of equally spaced times, or the times (s). max_wall: limit of wall-clock time (s).
        progress: True shows a bar; a function is called as progress(t, t_end, stats).
        Raises OptionError, before anything is solved, where the declared index is not that of the equations, or where the start
        violates a derivative of a constraint; SolverError where a solver cannot go on. Its attribute `solution`, like that of the
        KeyboardInterrupt of Ctrl-C, is the result until then."""
        return ATTACHED["simulate"](self, t_end, accuracy, solver, outputs, max_wall, progress)

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """out[:] = F(t, y, yp)."""
        check("the residual was evaluated")
        _fill("residual", self._function(t, y, yp, out), out, t)

    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        """out[...] = dF/dy + cj dF/dy'."""
        if self._jacobian is None:
            fy, fyp = self.jacobian_parts(t, y, yp)
            out[...] = fy + cj * fyp
            return
        check("the Jacobian was evaluated")
        _fill("jacobian", self._jacobian(t, y, yp, cj, out), out, t)

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy'."""
        if self._jacobian is not None:
            return super().jacobian_parts(t, y, yp)
        return self._own_differences.parts(t, y, yp)

    def _filled_rates(self, t: float, y: Array, out: Array) -> None:
        check("the right-hand side was evaluated")
        _fill("rhs", self._rates(t, y, out), out, t)

    def probes(self) -> list[tuple[float, Array, Array]]:
        """States (t, y, y') at which the pattern of the Jacobian is found: the start, where entries may be 0 by chance, and two
        points near it."""
        wave = np.sin(1.0 + np.arange(self.n))
        dy, dyp = self.scale * wave, self.scale * wave[::-1]
        return [(self.t0, self.y0 + k * dy, self.yp0 + k * dyp) for k in (0.0, 1e-3, -7e-4)]

    def _checked_scale(self, scale: ArrayLike) -> Array:
        remedy = f"give positive typical magnitudes, one number or {self.n}, one per unknown"
        values: Array = option("scale", scale, array, remedy)
        if values.shape not in ((), (self.n,)):
            raise OptionError(f"scale = {shown(scale)} has shape {values.shape}: {remedy}")
        if not (values > 0).all():
            raise OptionError(f"scale = {shown(scale)} has {values[~(values > 0)].flat[0]}, which is not positive: {remedy}")
        return np.full(self.n, values) if values.ndim == 0 else values

    def _checked_names(self, names: Sequence[str] | None) -> tuple[str, ...]:
        if names is None:
            return tuple(f"y[{i}]" for i in range(self.n))
        return _different("names", names, self.n, "unknown")

    def _checked_switches(self, switches: Switches | None) -> Switches | None:
        """The switches as given; raises OptionError where their arguments cannot be evaluated at the start."""
        if switches is None:
            return None
        values = np.asarray(switches.arguments(np.full(2, self.t0), np.array([self.y0, self.y0])))
        count = len(switches.kinds)
        if values.shape != (2, count) or values.dtype.kind not in "fiu":
            raise OptionError(f"switches: `arguments` returns {shown(values)} of shape {values.shape} and type "
                              f"{values.dtype} for 2 times: return real numbers of shape (2, {count}), one column for each of "
                              "its kinds")
        return switches

    def _checked_guards(self, names: Sequence[str] | None) -> tuple[str, ...]:
        """Names (nc,) of the contacts; raises OptionError where `guards` cannot be evaluated at the start."""
        if self.guards is None:
            if names is not None:
                raise OptionError(f"guard_names = {shown(names)} without guards, whose contacts they would name: give guards too")
            return ()
        given = self.guards(self.t0, self.y0.copy())
        parts = [np.asarray(part) for part in given] if isinstance(given, tuple | list | np.ndarray) else []
        if len(parts) != 3 or any(part.dtype.kind not in "fiu" for part in parts):
            raise OptionError(f"guards returns {shown(given)}: return (gap, gap rate, duration), three arrays with one real "
                              "number per contact")
        gap, rate, duration = parts
        if gap.ndim != 1 or not gap.shape == rate.shape == duration.shape:
            raise OptionError(f"guards returns shapes {gap.shape}, {rate.shape}, {duration.shape}: return three arrays of one "
                              "dimension and equal length, one number per contact")
        default = tuple(f"contact[{i}]" for i in range(len(gap)))
        chosen = default if names is None else _different("guard_names", names, len(gap), "contact")
        for name, g, r, d in zip(chosen, gap, rate, duration, strict=True):
            if not (np.isfinite(g) and np.isfinite(r) and d > 0):
                raise OptionError(
                    f"guards returns for {name} at the start t = {self.t0:g} s: gap {g}, gap rate {r}, duration of an impact "
                    f"{d} s; return a finite gap and rate, and a positive duration (inf: no impact)"
                )
        return chosen

    def _check_residual(self) -> None:
        out = np.full(self.n, np.nan)
        self.residual(self.t0, self.y0.copy(), self.yp0.copy(), out)
        if not np.isfinite(out).all():
            row = int(np.flatnonzero(~np.isfinite(out))[0])
            raise OptionError(
                f"residual F[{row}] = {out[row]} at the start t = {self.t0:g} s: "
                "fill every entry of out and check the start values"
            )

    def _check_jacobian(self) -> None:
        if self._jacobian is None:
            return
        out = np.zeros((self.n, self.n) if self.sparsity is None else (self.sparsity.nnz,))
        self.jacobian(self.t0, self.y0.copy(), self.yp0.copy(), 1.0, out)
        if not np.isfinite(out).all():
            raise OptionError(f"jacobian is not finite everywhere at the start t = {self.t0:g} s: check its formulas")

    def _check_start(self, yp: Array, fy: Array, fyp: Array, contradiction: str, remedy: str) -> None:
        """Raise OptionError where the residual at y0, yp is not finite, or too large for START_TOLERANCE. fy, fyp (n, n):
        derivatives of F, by which the terms of an equation are estimated; contradiction, remedy: for the message."""
        out = np.empty(self.n)
        self.residual(self.t0, self.y0, yp, out)
        size = np.abs(fy) @ self.scale + np.abs(fyp) @ np.maximum(self.scale, np.abs(yp))
        relative = np.abs(out) / np.where(size > 0, size, 1.0)
        row = largest(relative)
        if not relative[row] <= START_TOLERANCE:
            raise OptionError(
                f"{contradiction}: F[{row}] = {out[row]:.3e} instead of 0 at t = {self.t0:g} s, {relative[row]:.1e} of the "
                f"size of its terms: {remedy} (the equation contains {self._contents(row, fy, fyp)})"
            )

    def _contents(self, row: int, fy: Array, fyp: Array) -> str:
        present = (fy[row] != 0) | (fyp[row] != 0)
        return ", ".join(name for name, is_in in zip(self.names, present, strict=True) if is_in) or "no unknown"

    def _checked_index(self, index: Any, parts: list[tuple[Array, Array]]) -> NDArray[np.int_]:
        """Index (n,) of each unknown, from the option `index` (one number or (n,)). parts: dF/dy and dF/dy' at the states of
        `probes`, which show what unknowns the equations contain."""
        remedy = f"give 1, 2 or 3, or {self.n} of them, one per unknown"
        values: Array = option("index", index, array, remedy)
        if values.shape not in ((), (self.n,)) or not np.isin(values, (1, 2, 3)).all():
            raise OptionError(f"index = {shown(index)}: {remedy}")
        if values.ndim:
            return values.astype(int)
        present_y = np.any([fy != 0 for fy, _ in parts], axis=0)
        present_yp = np.any([fyp != 0 for _, fyp in parts], axis=0)
        algebraic = ~present_yp.any(axis=0)
        self.declared = int(values)
        result = np.where(algebraic, int(values), 1)
        if values == 3:
            result[present_yp[present_y[:, algebraic].any(axis=1)].any(axis=0)] = 2
        return result


def finite_vector(name: str, values: ArrayLike, n: int | None = None) -> Array:
    """A float copy (n,) of values, or an error that names the entry at fault."""
    remedy = f"give {n or 'at least 1'} finite numbers in one dimension"
    vector: Array = option(name, values, array, remedy)
    if vector.ndim != 1 or len(vector) == 0 or (n is not None and len(vector) != n):
        raise OptionError(f"{name} = {shown(values)} has shape {vector.shape}: {remedy}")
    return vector


def _different(name: str, values: Any, n: int, what: str) -> tuple[str, ...]:
    """The values of the option `name` as n different texts; what: that which each text names, such as "unknown", for messages."""
    remedy = f"give {n} different names, one per {what}"
    found = option(name, values, sequence, remedy, each=text)
    if len(found) != n:
        raise OptionError(f"{name} = {shown(values)} has {counted(len(found), 'entry')}: {remedy}")
    if len(set(found)) != n:
        raise OptionError(f"{name} = {shown(values)} has an entry twice: {remedy}")
    return tuple(found)


def _fill(name: str, value: Any, out: Array, t: float) -> None:
    """Write what the user's function `name` returned into `out`, unless it returned None because it filled `out` itself. Raises
    an error for another shape and for values that are not real numbers."""
    if value is None:
        return
    found = np.asarray(value)
    if found.shape != out.shape or found.dtype.kind not in "fiu":
        raise OptionError(f"{name} returns {shown(value)} of shape {found.shape} and type {found.dtype} at t = {t:g} s: return "
                          f"real numbers of shape {out.shape}, or fill out and return None")
    out[...] = found


def csc_pattern(pattern: Any, n: int) -> csc_matrix:
    """A pattern (n, n), dense or sparse, as a CSC matrix with sorted indices."""
    remedy = f"give the pattern of the Jacobian, ({n}, {n}), as an array or a sparse matrix of SciPy"
    result = csc_matrix(pattern if issparse(pattern) else option("sparsity", pattern, array, remedy), dtype=float)
    if result.shape != (n, n):
        raise OptionError(f"sparsity = {shown(pattern)} has shape {result.shape}: {remedy}")
    result.sort_indices()
    return result
