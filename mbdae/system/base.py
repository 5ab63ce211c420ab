"""The System interface: what every solver sees, and all it sees.

A System is the implicit equation F(t, y, y') = 0 with its exact Jacobian. A scene in a form
(`formulations/`) is one, a textbook DAE (`system/dae.py`) is another.
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

    arguments  (t (k,), y (k, n)) -> (k, na) their values at k points, pure numbers where not "kink" or "power"
    kinds      of every argument: "kink" (the equations change where u changes its sign), "decaying" (exp(u)), "saturating"
               (tanh(u), erf(u)), "growing" (sinh(u), cosh(u)), "arc" (atan(u), asinh(u)), "periodic" (sin(u)), "power" (|u|^a)
    weights    (na,) factor of every argument's change: |a| of a power, 1 of all others
    names      of every argument, for messages: the item it belongs to

    Adaptive solvers end a step where a kink is crossed, and no step over which a function of an argument changes and returns."""

    arguments: Callable[[Array, Array], Array]
    kinds: tuple[str, ...]
    weights: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        set_option(self, "arguments", function, "give a function (t (k,), y (k, n)) -> (k, na)", takes="t, y")
        set_option(self, "kinds", _words, "give one for every argument", each=word, words=SWITCH_KINDS)
        set_option(self, "weights", array, "give one factor per argument")
        set_option(self, "names", _words, "give one text per argument", each=text)
        if not len(self.kinds) == len(self.names) == np.size(self.weights) or np.ndim(self.weights) != 1:
            raise OptionError(f"kinds = {shown(self.kinds)}, weights = {shown(self.weights)}, names = {shown(self.names)}: "
                              f"their lengths differ; give one of each per argument of mb.Switches")  # fmt: skip


@dataclass(frozen=True)
class Numbers:
    """Numbers of laws in an array W that the native evaluation reads: their slots (m,), and for each which of the names asked
    for it belongs to (m,)."""

    W: Array
    slots: NDArray[np.int64]
    of: NDArray[np.int64]


def _words(value: Any, **bounds: Any) -> tuple[Any, ...]:
    return tuple(sequence(value, **bounds))


class Kept(dict[str, Any]):
    """Results that solvers store for later runs, by name: shared by the Systems of a run's parts, empty in copies."""

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
    sparsity  None (dense Jacobian) or a scipy CSC pattern; decides the meaning of `out` in `jacobian`
    sparse    whether there is one: scenes make it when they are asked for it
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
    #: characteristic time of the motion, s: errors of unknowns of higher index are weighed by the step over this time
    time: float = 1.0
    #: CSC pattern (n, n) of the Jacobian where it is known although `sparsity` may be None; see `jacobian_values`
    pattern: Any = None

    @property
    def sparse(self) -> bool:
        """Whether the Jacobian is given by its entries, in the places of `sparsity`."""
        return self.sparsity is not None

    @property
    def jacobian_shape(self) -> tuple[int, ...]:
        """Shape of the `out` of `jacobian`."""
        places = self.sparsity if self.pattern is None else self.pattern
        return (places.nnz,) if self.sparse else (self.n, self.n)

    @property
    def has_pattern(self) -> bool:
        """Whether the Jacobian has a sparsity pattern."""
        return self.pattern is not None


    kept: Kept | None = None  #: results that solvers store for later runs of the same equations; None: nothing is stored
    #: optional parts of the interface; None where a system does not have them
    rhs: Any = None
    rate_jacobian: Any = None  #: (t, y) -> dy'/dy (n, n) of systems with a right-hand side that know it
    #: (t, y, directions (k, n)) -> dy'/dy times each (k, n), where these products cost less than dy'/dy
    rate_products: Any = None
    partition: Any = None
    #: the equations as native methods call them (`mbdae.native.equations.Equations`); None: by calls of the functions here
    native: Any = None
    displaced: Callable[[Array, Array], Array] | None = None  #: (q, displacements) -> displaced q; None: displacements are added
    #: contacts: (t, y) -> (gap, gap rate, duration), each (nc,): gap in m (> 0 apart, < 0 penetrating), its time derivative in
    #: m/s, and the duration in s of an impact at the present approach speed (> 0; inf: no impact). Adaptive solvers keep
    #: their steps short where a contact is near and never step over one
    guards: Callable[[float, Array], tuple[Array, Array, Array]] | None = None
    #: name of each contact (used in messages); "contact[i]" where there are fewer
    guard_names: tuple[str, ...] = ()
    #: unit of each gap, m or rad; m where there are fewer
    guard_units: tuple[str, ...] = ()
    guard_jumps: bool = False  #: whether the force of a contact jumps when the bodies touch: steps across that are of order 1
    #: functions in the equations that switch or vary within a narrow range; None: none
    switches: Switches | None = None
    #: name of the elastic beam that vibrates fastest and the angle (rad) of that vibration in the motion's characteristic time
    vibration: Callable[[], tuple[str, float]] | None = None

    #: begin and end of a run (s) -> where its inputs of time break, and how long steps may be (`system.model.inputs.Timeline`;
    #: None: they are smooth and slow); None: inputs of time are not checked
    timeline: Callable[..., Any] | None = None
    #: function from the begin of a run (s) to its sampled controllers (`system.sampling.Sampling`); None: there are none
    sampled: Any = None
    #: time -> longest step (s) that may be taken from there; None: no bound
    longest_step: LongestStep | None = None

    def starting(self, t: float, y: Array, yp: Array, longest_step: LongestStep | None = None) -> Self:
        """These equations with another start, for a part of a run: a new System that shares all else with this one.

        Nothing assigns the attributes of a System after it is made; a solver reads the start of its part from the System it is
        given."""
        other = copy(self)
        other.t0, other.y0, other.yp0, other.longest_step = t, y, yp, longest_step
        return other

    def sampling(self, by: Any) -> Self:
        """These equations with other sampled controllers (`system.sampling.Sampling`), or with None, so that outputs stay as they
        are: a new System that shares everything else with this one."""
        other = copy(self)
        other.sampled = by
        return other

    def renewed(self, t: float, y: Array) -> System | None:
        """A system of the same unknowns to continue with from y (n,), because some of these equations are about to depend on
        each other; None: continue with this one. Called after every accepted step."""
        return None

    def memory(self) -> dict[str, Any]:
        """The state of these equations that is not in y and that a continued run needs: plain values and arrays."""
        return {}

    def remember(self, memory: dict[str, Any]) -> None:
        """Restore what `memory` returned."""

    def forget(self) -> None:
        """Discard what `renewed` stored of earlier positions, so that it checks the next one."""

    @property
    def looks_at_steps(self) -> bool:
        """Whether `accept` or `renewed` is more than here: steps that are made many at a time are then made one by one."""
        return type(self).accept is not System.accept or type(self).renewed is not System.renewed

    def read_at(self, time: float | None) -> None:
        """Evaluate conditions of inputs (t < 1 and the like) at a time inside a part of a run from now on; None: at the time of
        every evaluation again."""

    def restarted(self, t: float, y: Array) -> tuple[Array, Array]:
        """Consistent y and y' (n,) to go on with from y (n,) at a break t."""
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

    def jacobian_values(self, t: float, y: Array, yp: Array) -> tuple[Array, Array]:
        """dF/dy and dF/dy' as two arrays (nnz,) of data of `pattern`, for systems that have one."""
        raise NotImplementedError

    def numbers(self, names: Sequence[str]) -> Numbers:
        """Slots of numbers of laws ("elbow.mass") that a batch of runs varies; OptionError where one cannot be varied."""
        raise OptionError(f"numbers = {shown(list(names))}: the equations of this system are functions (mb.DAE), in which "
                          "numbers of laws are not known; give starts alone, or solve the systems one by one")  # fmt: skip

    def accept(self, t: float, y: Array) -> None:
        """Called by the step loop after every accepted step: the only place where a System may remember something of a run."""
