"""A law derived for given kinds of nodes: what it adds to the equations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import symengine as se

from mbdae.disk.entries import keep, key_of, recall
from mbdae.errors import LawError, MbdaeError
from mbdae.symbolic.frames import Frame
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element
from mbdae.symbolic.rebuild import symbols_of
from mbdae.symbolic.stated import Stated
from mbdae.symbolic.statement import Feeds
from mbdae.symbolic.variation import Variation
from mbdae.symbolic.vectors import ZERO, Expr, Vec

Pair = tuple[Vec, Vec]  #: (force, moment) on a node, a generalised force by its inertial components
_ZERO = se.Integer(0)


class NotPlanarError(LawError):
    """A law between planar nodes that acts out of the plane; what: which part of it."""

    what = ""

    @classmethod
    def of(cls, law: Any, what: str) -> NotPlanarError:
        """The error for a law."""
        made = cls(f"{type(law).__name__} is not planar: {what} acts out of the plane")
        made.what = what
        return made


class Terms(NamedTuple):
    """The terms of a law in the equations. Expressions are in the symbols of its frames."""

    g: tuple[Expr, ...]
    G: tuple[dict[str, Pair], ...]  #: gradient of every row, by side
    speeds: tuple[Expr, ...]  #: of rows stated by velocities: what vanishes, of the others 0
    force: dict[str, Pair]  #: generalised force by side, on the left-hand side and without multipliers
    energy: Expr
    dissipated_power: Expr
    work_power: Expr
    coordinates: dict[str, Expr]  #: values of a joint's coordinates where they can be read, by name
    state_rates: tuple[Expr, ...]
    state_starts: tuple[Expr, ...]


class Facts(NamedTuple):
    """What a law has in the equations, without expressions."""

    rows: tuple[str, ...]  #: constraint rows that do not vanish
    vanished: tuple[str, ...]  #: rows that vanish identically, or are undefined
    undefined: tuple[str, ...]  #: rows left out because they need axes that a point mass does not have
    states: tuple[str, ...]
    forced: bool  #: whether the law states forces
    by_rates: tuple[str, ...]  #: those of the rows that are stated by velocities: no positions satisfy or violate them


class Derived:
    """A law for given kinds of nodes with its `Facts`, and its `Terms`, which are derived when they are first asked for.

    stated: what the law states, see `derive`; key: digest of it, with which its keys in the cache on disk begin, None: not
    cached; run: derives. It answers later questions from the statement that was derived, whatever the class states by then."""

    rows: tuple[str, ...]
    vanished: tuple[str, ...]
    undefined: tuple[str, ...]
    states: tuple[str, ...]
    forced: bool
    by_rates: tuple[str, ...]

    def __init__(self, stated: Stated, key: str | None, run: Callable[[], tuple[Facts, Terms, Variation]]) -> None:
        self.stated, self.key, self._run = stated, key, run
        self._notes: dict[str, Any] = {}
        self.law: Any = stated.law
        self.frames: tuple[Frame, ...] = stated.frames
        self.feeds: Feeds = stated.feeds
        found = recall(key)
        if found is None:
            try:
                keep(key, found := tuple(self._derivation[0]))
            # that this law is not planar is cached on disk too: every process derives a scene's laws as planar first
            except NotPlanarError as refused:
                keep(key, refused.what)
                raise
        if isinstance(found, str):
            raise NotPlanarError.of(self.law, found)
        vars(self).update(Facts(*found)._asdict())

    def __deepcopy__(self, memo: Any) -> Derived:
        return self  # what was derived does not change

    @cached_property
    def _derivation(self) -> tuple[Facts, Terms, Variation]:
        with self.naming_errors():
            return self._run()

    @contextmanager
    def naming_errors(self) -> Iterator[None]:
        """Context in which errors of the symbolic engine become a LawError with the name of the law."""
        try:
            yield
        except (MbdaeError, NotImplementedError):
            raise
        except Exception as error:
            raise LawError(f"{type(self.law).__name__} cannot be derived: {type(error).__name__}: {error}; state it by functions "
                           f"that symengine differentiates") from error

    def noted(self, what: str, find: Callable[[], Any]) -> Any:
        """A plain value that follows from the terms: from the cache on disk, or computed by `find` and cached. what: its name
        there, with that of its module."""
        if what not in self._notes:
            key = None if self.key is None else key_of("note", self.key, what)
            found = recall(key)
            if found is None:
                keep(key, found := (find(),))
            self._notes[what] = found[0]
        return self._notes[what]

    @property
    def variation(self) -> Variation:
        """The motions of its frames, with the names of intermediate results."""
        return self._derivation[2]

    if TYPE_CHECKING:
        g: tuple[Expr, ...]
        G: tuple[dict[str, Pair], ...]
        speeds: tuple[Expr, ...]
        force: dict[str, Pair]
        energy: Expr
        dissipated_power: Expr
        work_power: Expr
        coordinates: dict[str, Expr]
        state_rates: tuple[Expr, ...]
        state_starts: tuple[Expr, ...]
    else:

        def __getattr__(self, name: str) -> Any:
            if name in Terms._fields:
                return getattr(self._derivation[1], name)
            raise AttributeError(f"{type(self).__name__} has no attribute {name}")

    @property
    def multipliers(self) -> list[Expr]:
        """Symbols of the multipliers lambda."""
        return [se.Symbol(f"lambda_{row}") for row in self.rows]

    @property
    def sides(self) -> tuple[Frame, ...]:
        """The frames a law is stated on, without joint coordinates."""
        return self.frames[: len(self.law.frames)]

    @cached_property
    def read_frames(self) -> tuple[Frame, ...]:
        """The frames whose symbols the terms of the law contain: a force on a joint coordinate that is an unknown depends on the
        frame of this coordinate, and not on those of the bodies."""
        stated = [*self.g, *self.speeds, self.energy, self.dissipated_power, self.work_power, *self.coordinates.values(),
                  *self.state_rates, *self.state_starts, *self.variation.values.values()]
        stated += [c for pair in self.force.values() for part in pair for c in part]
        stated += [c for row in self.G for pair in row.values() for part in pair for c in part]
        symbols = symbols_of(stated)
        return tuple(f for f in self.frames if f.symbols & symbols or isinstance(self.law, Element))

    @property
    def row_forces(self) -> list[Expr]:
        """Factors of the rows' gradients: lambda, or scaling lambda + 2 penalty c (`law.AUGMENTED`)."""
        forces = [self.scaled(s) for s in self.multipliers]
        penalty = getattr(self.law, "penalty", None)
        return forces if penalty is None else [f + 2 * penalty * c for f, c in zip(forces, self.g, strict=True)]

    @property
    def reaction_forces(self) -> list[Expr]:
        """The forces of the rows where the rows vanish: scaling lambda."""
        return [self.scaled(s) for s in self.multipliers]

    def scaled(self, e: Expr) -> Expr:
        """A row or multiplier times the scaling of the joint."""
        return scaled(self.law, e)

    @property
    def reactions(self) -> dict[str, Expr]:
        """Force of every row by its name, on which `resistance` depends: scaling lambda, 0 where the row vanishes."""
        return reactions(self.law, self.rows, self.vanished)

    @property
    def reactive(self) -> bool:
        """Whether a joint states forces that depend on its own reactions."""
        return isinstance(self.law, Joint) and self.forced

    @property
    def pressing(self) -> Vec | None:
        """The part of a joint's reaction force that presses surfaces together where friction acts; None where the law states its
        resistance by itself."""
        if not isinstance(self.law, Joint) or self.law.friction is None:
            return None
        self.stated.refuse_other_reactions()
        return self.law.pressing(self.sides[0], self.sides[1], reaction_on_l(self.law, self.frames, self.rows, self.G))

    @property
    def rubbing(self) -> tuple[Expr, Expr] | None:
        """The coordinate against which a joint's own friction acts, and the friction on it (N or N m); None without friction."""
        if not isinstance(self.law, Joint):
            return None
        self.stated.refuse_other_reactions()
        return self.law.rubbing(reaction_on_l(self.law, self.frames, self.rows, self.G), *self.sides)

    @property
    def stabilisers(self) -> list[Expr]:
        """Symbols of the stabilising multipliers mu."""
        return [se.Symbol(f"mu_{row}") for row in self.rows]


def scaled(law: Any, e: Expr) -> Expr:
    """A row or multiplier times the scaling of its law."""
    scaling = getattr(law, "scaling", None)
    return e if scaling is None else scaling * e


def reactions(law: Any, rows: Iterable[str], vanished: Iterable[str]) -> dict[str, Expr]:
    """Force of every row by its name: scaling lambda, 0 where the row vanishes."""
    return {row: scaled(law, se.Symbol(f"lambda_{row}")) for row in rows} | dict.fromkeys(vanished, _ZERO)


def reaction_on_l(law: Any, frames: Sequence[Frame], rows: Sequence[str], G: Sequence[dict[str, Pair]]) -> Vec:
    """Reaction force of a joint on l, N, inertial components: where l does not move, the opposite of that on k."""
    l = next((f for f in frames if f.side == "l"), None)
    if l is None:
        return ZERO
    side, sign = ("l", -1) if l.kind.moves else ("k", 1)
    forces = (scaled(law, se.Symbol(f"lambda_{row}")) * sign for row in rows)
    return sum((pairs[side][0] * force for force, pairs in zip(forces, G, strict=False)), ZERO)
