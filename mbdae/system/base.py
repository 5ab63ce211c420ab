"""The System interface, by which solvers see equations. Solvers use nothing else of a scene.

A System is the implicit equation F(t, y, y') = 0 with its exact Jacobian. A scene in a form (`formulations/`) is one, equations
that a user gives as functions (`system/dae.py`) are another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import OptionError
from mbdae.inputs.resolution import LongestStep
from mbdae.threads import Owner
from mbdae.values import array, function, sequence, set_option, shown, text, word

Array = NDArray[np.float64]


SWITCH_KINDS = ("kink", "decaying", "saturating", "growing", "arc", "periodic", "power")


class Places(NamedTuple):
    """Sparsity pattern of a matrix (n, n), by columns: `indptr` (n + 1,) and `indices` (nnz,) as SciPy has them."""

    indptr: NDArray[np.intp]
    indices: NDArray[np.intp]

    @property
    def nnz(self) -> int:
        """Number of entries."""
        return len(self.indices)

    @property
    def shape(self) -> tuple[int, int]:
        """(n, n), the shape of the matrix."""
        return (len(self.indptr) - 1,) * 2


@dataclass(frozen=True)
class Switches:
    """Arguments u(t, y) of functions in the equations that switch, or that vary within a narrow range of u alone.

    arguments  function (t (k,), y (k, n)) -> values u (k, na) of the na arguments at k points; they have no unit, except those of
               kind "kink" and "power"
    kinds      of every argument the function that it belongs to: "kink" (the equations change where u changes its sign),
               "decaying" (exp(u)), "saturating" (tanh(u), erf(u)), "growing" (sinh(u), cosh(u)), "arc" (atan(u), asinh(u)),
               "periodic" (sin(u)), "power" (|u|^a)
    weights    (na,) factor of every argument's change: |a| of a power, 1 of all others
    names      of every argument the item of the scene that it belongs to, for messages

    Adaptive solvers end a step where a kink is crossed. They repeat a step with a smaller length where one of the functions would
    change and change back within it, which the error estimate cannot see."""

    arguments: Callable[[Array, Array], Array]
    kinds: tuple[str, ...]
    weights: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        set_option(self, "arguments", function, "give a function (t (k,), y (k, n)) -> (k, na)", takes="t, y")
        set_option(self, "kinds", _words, "give one for every argument", each=word, words=SWITCH_KINDS)
        set_option(self, "weights", array, "give one factor per argument")
        set_option(self, "names", _words, "give one text per argument", each=text)
        if np.ndim(self.weights) != 1:
            raise OptionError(f"weights = {shown(self.weights)} has {np.ndim(self.weights)} dimensions: give a list of numbers, "
                              "one for each value that `arguments` returns")
        if not len(self.kinds) == len(self.names) == len(self.weights):
            raise OptionError(f"kinds = {shown(self.kinds)}, weights = {shown(self.weights)}, names = {shown(self.names)}: their "
                              "lengths differ; give three lists of equal length, one entry for each value that `arguments` "
                              "returns")


@dataclass(frozen=True)
class Numbers:
    """Numbers of laws that may be varied between runs. W: the array that the native evaluation reads; slots (m,): their indices
    in W; of (m,): of each the position of its name in the list of names asked for."""

    W: Array
    slots: NDArray[np.int64]
    of: NDArray[np.int64]


def _words(value: Any, **bounds: Any) -> tuple[Any, ...]:
    return tuple(sequence(value, **bounds))


class Kept(dict[Any, Any]):
    """What is stored for later, by name, such as results that solvers store for later runs: the Systems of the parts of a run
    share one. A copy is empty."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Kept, ()


class System:
    """F(t, y, y') = 0 with n unknowns.

    n         number of unknowns
    names     name of each unknown (used in messages)
    equations name of each row of F (used in messages)
    kinds     kind of each unknown: "q" position, "v" velocity, "z" algebraic element unknown,
              "s" internal state, "lambda" multiplier, "mu" stabilising multiplier, "y" anything else
    index     (n,) index of each unknown as in RADAU5: 1 differential (or index-1 algebraic), 2, 3
    scale     (n,) typical magnitude of each unknown in its own unit; the tolerance is relative to it
    t0, y0, yp0  consistent start; see `starting`
    sparsity  None (full Jacobian) or its pattern as a scipy CSC matrix; decides the shape of `out` in `jacobian`
    sparse    whether `sparsity` is a pattern; can be asked without computing it
    label     short name of the form, for tables ("GGL", "Index3", "ODE", "DAE")"""

    n: int
    names: tuple[str, ...]
    equations: tuple[str, ...]
    kinds: tuple[str, ...]
    index: NDArray[np.int_]
    scale: Array
    t0: float
    y0: Array
    yp0: Array
    sparsity: Any
    label: str = ""
    #: characteristic time of the motion, s: in error norms collocation methods weight unknowns by (step / time)^(index - 1)
    time: float = 1.0
    #: CSC pattern (n, n) of the entries that `jacobian_values` returns, None: not known; `sparsity` may be None all the same,
    #: where dense linear algebra is faster
    pattern: Any = None

    @property
    def sparse(self) -> bool:
        """Whether `jacobian` writes the entries of the pattern `sparsity`, instead of a full matrix."""
        return self.sparsity is not None

    @property
    def jacobian_shape(self) -> tuple[int, ...]:
        """Shape of the `out` of `jacobian`."""
        return ((self.sparsity if self.pattern is None else self.pattern).nnz,) if self.sparse else (self.n, self.n)

    @property
    def has_pattern(self) -> bool:
        """Whether the Jacobian has a sparsity pattern."""
        return self.pattern is not None


    kept: Kept | None = None  #: results that solvers store for later runs of the same equations; None: nothing is stored
    #: whether `jacobian` is made by differences of the residual, for which a method may have its own
    differences: bool = False
    #: optional parts of the interface, None where a system does not have them. rhs: function (t, y, out) with out[:] = y'
    rhs: Any = None
    rate_jacobian: Any = None  #: function (t, y) -> dy'/dy (n, n), for systems with `rhs`
    #: function (t, y, directions (k, n)) -> products of dy'/dy with each direction (k, n), where these cost less than dy'/dy
    rate_products: Any = None
    partition: Any = None  #: the parts M, f, g and G of equations of motion, see `mb.DAE`
    #: table by which native methods call the equations (`mbdae.native.equations.Equations`); None: they call the functions here
    native: Any = None
    #: function (q, virtual displacements) -> displaced q, for rotations that are not added; None: displacements are added to q
    displaced: Callable[[Array, Array], Array] | None = None
    #: contacts: function (t, y) -> (gap, gap rate, duration), each (nc,): gap in m or rad (> 0 apart, < 0 penetrating), its time
    #: derivative, and the duration in s of an impact at the present approach speed (> 0; inf: no impact). Adaptive
    #: solvers shorten their steps where a contact is near, so that none is stepped over
    guards: Callable[[float, Array], tuple[Array, Array, Array]] | None = None
    #: function (times, trajectory, trajectory) -> distance over time by which runs are compared; None: that of `run.control`
    measure: Any = None
    #: name of each contact, used in messages; contacts beyond the length of this tuple are called "contact[i]"
    guard_names: tuple[str, ...] = ()
    #: unit of each gap, m or rad; m for contacts beyond the length of this tuple
    guard_units: tuple[str, ...] = ()
    guard_jumps: bool = False  #: whether a contact force jumps when the bodies touch: the error of a step over that is of order 1
    #: arguments of functions in the equations that switch or vary within a narrow range; None: there are none
    switches: Switches | None = None
    #: function that returns the name of the beam that vibrates fastest, and its angular frequency times the characteristic time
    #: of the motion (rad); None: there are no beams
    vibration: Callable[[], tuple[str, float]] | None = None

    #: function of begin and end of a run (s) and its accuracy that returns where inputs of time jump or have kinks, and how long
    #: steps may be (`system.model.inputs.Timeline`, or None where inputs are smooth and slow); None: inputs are not checked
    timeline: Callable[..., Any] | None = None
    #: function of the begin of a run (s) that returns its sampled controllers (`system.sampling.Sampling`); None: there are none
    sampled: Any = None
    #: function of the time that returns the longest step (s) allowed from there; None: no bound
    longest_step: LongestStep | None = None

    @property
    def owner(self) -> Owner:
        """Which thread runs these equations, or others that share their arrays."""
        own = vars(self)
        if "_owner" not in own:
            own.setdefault("_owner", Owner(f"the System {self.label} ({self.names[0]}, ...)"))
        return own["_owner"]  # type: ignore[no-any-return]

    def __copy__(self) -> Self:
        """A System that shares everything with this one."""
        other = type(self).__new__(type(self))
        vars(other).update(vars(self) | {"_owner": self.owner})
        return other

    def starting(self, t: float, y: Array, yp: Array, longest_step: LongestStep | None = None) -> Self:
        """These equations with another start (t, y, yp) and bound of steps, for a part of a run: a new System that shares
        everything else with this one. The attributes of a System are never changed after it is made."""
        other = copy(self)
        other.t0, other.y0, other.yp0, other.longest_step = t, y, yp, longest_step
        return other

    def sampling(self, by: Any) -> Self:
        """These equations with other sampled controllers (`system.sampling.Sampling`): a new System that shares everything else
        with this one. by=None: the outputs of the controllers keep their present values."""
        other = copy(self)
        other.sampled = by
        return other

    def renewed(self, t: float, y: Array) -> System | None:
        """Called after every accepted step at t, y (n,). Returns another System of the same unknowns with which the run has to
        continue, because some of the constraint rows of this one are about to become dependent; None: continue with this one."""
        return None

    def doubt(self, span: float) -> str:
        """What a solver should warn of before a run of `span` (s), in words; "": nothing."""
        return ""

    def memory(self) -> dict[str, Any]:
        """The state of these equations that is not in y and that a continued run needs: plain values and arrays."""
        return {}

    def remember(self, memory: dict[str, Any]) -> None:
        """Restore the state of the equations that `memory` returned earlier in the run."""

    def forget(self) -> None:
        """Discard what `renewed` stored of earlier positions, so that it checks the next one."""

    @property
    def one_by_one(self) -> bool:
        """Whether a subclass overrides `renewed`, or `accept` alone: native methods then return after each step."""
        cls = type(self)
        return cls.renewed is not System.renewed or (cls.accept is not System.accept and not self._accepts_many)

    @property
    def looks_at_steps(self) -> bool:
        """Whether a subclass overrides `accept`, `accept_many` or `renewed`, which look at every step."""
        return self.one_by_one or self._accepts_many

    @property
    def _accepts_many(self) -> bool:
        return type(self).accept_many is not System.accept_many

    def read_at(self, time: float | None) -> None:
        """From now on evaluate conditions of inputs, such as t < 1, at this time, which lies inside the present part of a run, so
        that none switches at its end; None: at the time of every evaluation again."""

    def restarted(self, t: float, y: Array) -> tuple[Array, Array]:
        """Consistent y and y' (n,) with which to continue from y (n,) at an instant t (s) at which an input jumps."""
        raise NotImplementedError

    def residual(self, t: float, y: Array, yp: Array, out: Array) -> None:
        """out[:] = F(t, y, yp), all arrays (n,)."""
        raise NotImplementedError

    def jacobian(self, t: float, y: Array, yp: Array, cj: float, out: Array) -> None:
        """out = dF/dy + cj dF/dy': (n, n) where `sparsity` is None, else (nnz,) CSC data."""
        raise NotImplementedError

    def residual_stages(self, t: Array, y: Array, yp: Array, out: Array) -> None:
        """out[i] = F(t[i], y[i], yp[i]) for s points at once: t (s,), the others (s, n)."""
        for i in range(len(t)):
            self.residual(t[i], y[i], yp[i], out[i])

    def jacobian_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy' as two arrays, each shaped like the `out` of `jacobian`."""
        fy, both = np.zeros((2, *self.jacobian_shape))
        self.jacobian(t, y, yp, 0.0, fy)
        self.jacobian(t, y, yp, 1.0, both)
        return fy, both - fy

    def dense_parts(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy' as full matrices (n, n)."""
        fy, fyp = self.jacobian_parts(t, y, yp)
        if not self.sparse:
            return fy, fyp
        full = np.zeros((2, self.n, self.n))
        rows, columns = self.sparsity.indices, np.repeat(np.arange(self.n), np.diff(self.sparsity.indptr))
        full[0, rows, columns], full[1, rows, columns] = fy, fyp
        return full[0], full[1]

    def jacobian_values(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy' as two arrays (nnz,) of data of `pattern`, for systems that have one."""
        raise NotImplementedError

    def linear_stages(self, t: Array, y: Array, yp: Array) -> tuple[Any, Array, Array]:
        """The linearised equations at k states, t (k,), y and yp (k, n): the equations themselves, and the entries (k, nnz) of
        dF/dy and of dF/dy' in their `pattern`, column by column where they have none. Equations whose multipliers are eliminated
        return those with multipliers, whose first unknowns are y."""
        values = self.jacobian_parts if self.pattern is None else self.jacobian_values
        found = [[part.ravel(order="F") for part in values(*state)] for state in zip(t.tolist(), y, yp, strict=True)]
        fy, fyp = (np.array(parts) for parts in zip(*found, strict=True))
        return self, fy, fyp

    def numbers(self, names: Sequence[str]) -> Numbers:
        """The numbers of laws with these names, such as "elbow.mass", that a batch of runs may vary; OptionError where one cannot
        be varied."""
        raise OptionError(f"numbers = {shown(list(names))}: the equations of this system are functions (mb.DAE), in which "
                          "numbers of laws are not known; give starts alone, or solve the systems one by one")

    def accept(self, t: float, y: Array) -> None:
        """Called by the step loop after every accepted step at t, y (n,): the only function in which a System may store something
        that depends on the run."""

    def accept_many(self, t: Array, y: Array) -> None:
        """The same for steps that end at t (k,), y (k, n); a SolverError says by its `time` which of them is the last."""
