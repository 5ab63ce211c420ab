"""Plans: which outputs of a law are constant, linear or nonlinear, and the kernels that evaluate them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import symengine as se

from mbdae.disk.entries import keep, key_of, part_key, recall
from mbdae.kernels import Kernel
from mbdae.process import made_once
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.outputs import Target, derivatives, input_symbols, insert
from mbdae.symbolic.rebuild import jumps_with, symbols_of
from mbdae.symbolic.tree_motion import Open
from mbdae.symbolic.vectors import Expr

EntryPlace = tuple[int, Target]  #: an entry of the Jacobian: number of an output, and the unknown by which it is differentiated
Outputs = Callable[[Derived], Sequence[tuple[Target, Expr]]]  #: selects outputs of a law, see `symbolic.outputs`


@dataclass(frozen=True)
class Inputs:
    """Columns of a kernel's input: unknowns by target, parameters by name."""

    unknowns: tuple[Target, ...]
    parameters: tuple[str, ...]
    symbols: tuple[Expr, ...]


class Plan:
    """The outputs of a law, without derivatives. The tables (what the outputs belong to and which inputs they read) come from
    disk where an earlier process stored them; the expressions are derived only when something asks for them."""

    def __init__(self, d: Derived, outputs: Outputs, *options: str) -> None:
        self.derived, self._outputs = d, outputs
        self.key = _key(d, outputs, type(self).__name__, *options)
        found = recall(self.key)
        if found is None:
            keep(self.key, found := self._made())
        self._read(*found)

    def _made(self) -> tuple[Any, ...]:
        """The tables in the form in which they are stored on disk; `_read` takes them apart again."""
        return self._targets(), _kept(self.inputs(self.inserted))

    def _read(self, targets: list[Target], inputs: Any) -> None:
        self.targets, self.all_inputs = targets, _inputs(*inputs)  #: all_inputs: those on which at least one output depends

    def _targets(self) -> list[Target]:
        return [target for target, _ in self._entries]

    @cached_property
    def _entries(self) -> list[tuple[Target, Expr]]:
        return list(self._outputs(self.derived))

    @cached_property
    def expressions(self) -> list[Expr]:
        """The outputs, in terms of unknowns, parameters and symbols for intermediate results."""
        return [e for _, e in self._entries]

    @cached_property
    def inserted(self) -> list[Expr]:
        """The outputs with the intermediate results inserted, in terms of unknowns and parameters alone."""
        return insert(self.derived, self.expressions)

    @cached_property
    def _unknown(self) -> dict[Expr, Target]:
        return {symbol: target for target, symbol in input_symbols(self.derived)}

    def inputs(self, expressions: Sequence[Expr], used: set[Expr] | None = None) -> Inputs:
        """The unknowns and parameters on which some expressions depend, in a fixed order. used: the symbols in the expressions,
        None: they are looked for."""
        if used is None:
            used = symbols_of(expressions)
        unknowns = [(s, t) for s, t in self._unknown.items() if s in used]
        parameters = sorted((s for s in used if s not in self._unknown), key=str)
        symbols = tuple(s for s, _ in unknowns) + tuple(parameters)
        return Inputs(tuple(t for _, t in unknowns), tuple(map(str, parameters)), symbols)

    @cached_property
    def kernel(self) -> Kernel:
        """One kernel that evaluates all outputs."""
        return Kernel(self.all_inputs.symbols, lambda: self.inserted, None, len(self.targets), part_key(self.key, "all"))


class _Sorted(NamedTuple):
    """The outputs and derivatives of a law, sorted.

    nonlinear: numbers of the nonlinear outputs, and residual their expressions; jacobian_places and jacobian: the derivatives
    that vary; constant_places: those that are constant; offset_places: numbers of the linear outputs; constants: expressions of
    the constant derivatives, then of the constant parts of the linear outputs."""

    nonlinear: list[int]
    constant_places: list[EntryPlace]
    offset_places: list[int]
    jacobian_places: list[EntryPlace]
    constants: list[Expr]
    jacobian: list[Expr]
    residual: list[Expr]


class LinearisedPlan(Plan):
    """The outputs of a law with their exact derivatives, sorted into constant, linear and nonlinear.

    A derivative that depends on parameters only is constant. An output is linear where all its derivatives are constant and it
    neither depends on time nor jumps (as floor(x), whose derivative is 0): its terms are added without a kernel. open: where
    more parameters than the fewest are inputs, all outputs and derivatives stay in the kernels.
    """

    def __init__(self, d: Derived, outputs: Outputs, open: Open = Open.FEWEST) -> None:
        self._sort = open is Open.FEWEST
        super().__init__(d, outputs, str(self._sort))

    def _made(self) -> tuple[Any, ...]:
        found = self._sorted
        kernels = [_kept(self.inputs(e)) for e in (found.constants, found.jacobian, found.residual)]
        places = found.nonlinear, found.constant_places, found.offset_places, found.jacobian_places
        return self._targets(), places, kernels, found.constants

    def _read(self, targets: list[Target], places: Any, kernels: Any = (), constants: Any = ()) -> None:
        self.targets = targets
        self.nonlinear, self.constant_places, self.offset_places, self.jacobian_places = places
        self.constant_inputs, self.jacobian_inputs, self.residual_inputs = (_inputs(*entry) for entry in kernels)
        self.constants = Kernel(self.constant_inputs.symbols, constants)
        self.jacobian = self._kernel("jacobian", self.jacobian_inputs, len(self.jacobian_places))
        self.residual = self._kernel("residual", self.residual_inputs, len(self.nonlinear))

    @cached_property
    def all_inputs(self) -> Inputs:  # type: ignore[override]
        """The inputs on which any of the outputs depends."""
        return self.inputs(self.inserted)

    def _kernel(self, part: str, inputs: Inputs, width: int) -> Kernel:
        return Kernel(inputs.symbols, lambda: getattr(self._sorted, part), None, width, part_key(self.key, part))

    @cached_property
    def _sorted(self) -> _Sorted:
        d, sort = self.derived, self._sort
        partials = [derivatives(d, e) for e in self.expressions]
        places = [(i, target) for i, row in enumerate(partials) for target in row]
        named = [value for row in partials for value in row.values()]
        values = insert(d, named)
        clock = {symbol for pair in d.variation.clock.items() for symbol in pair}
        varying = d.variation.depending(set(self._unknown) | clock)
        constant = [sort and not (value.free_symbols & varying) for value in named]
        curved = {i for (i, _), fixed in zip(places, constant, strict=True) if not fixed}
        timed, jumps = d.variation.depending(clock), d.variation.jumping(varying)
        curved |= {i for i, e in enumerate(self.expressions) if not sort or e.free_symbols & (timed | jumps)
                   or jumps_with(e, varying)}
        nonlinear = [i for i in range(len(self.inserted)) if i in curved]
        linear = [i for i in range(len(self.inserted)) if i not in curved]
        origin = self._origin(d)
        offsets = [self._offset(i, places, values, origin) for i in linear]

        def chosen(found: list[Any], fixed: bool) -> list[Any]:
            return [f for f, c in zip(found, constant, strict=True) if c == fixed]

        return _Sorted(nonlinear, chosen(places, True), linear, chosen(places, False), chosen(values, True) + offsets,
                       chosen(values, False), [self.inserted[i] for i in nonlinear])

    def _origin(self, d: Derived) -> dict[Expr, Expr]:
        """Point at which the constant part of a linear output is evaluated: all unknowns 0, but quaternions (1, 0, 0, 0), because
        a zero quaternion has no rotation matrix."""
        first = {f.q[f.kind.translations] for f in d.frames if f.kind.by_quaternion}
        return {symbol: se.Integer(1 if symbol in first else 0) for symbol in self._unknown}

    def _offset(self, i: int, places: list[tuple[int, Target]], values: list[Expr], origin: dict[Expr, Expr]) -> Expr:
        """Constant part of the linear output i: its value at `origin` less its linear terms there."""
        symbol = {target: s for s, target in self._unknown.items()}
        linear = sum((v * origin[symbol[t]] for (o, t), v in zip(places, values, strict=True) if o == i), se.Integer(0))
        return self.inserted[i].subs(origin) - linear


def _key(d: Derived, outputs: Outputs, *words: str) -> str | None:
    """The key of a plan on disk, from the key of the law, the name of the function `outputs`, and further words. None where the
    law has no key, or where the function is not one of mbdae, because its name would not identify it."""
    module, name = getattr(outputs, "__module__", ""), getattr(outputs, "__qualname__", "<")
    if d.key is None or "<" in name or not str(module).startswith("mbdae."):
        return None
    return key_of("plan", d.key, str(module), name, *words)


def _kept(found: Inputs) -> tuple[Any, ...]:
    return found.unknowns, found.parameters, tuple(map(str, found.symbols))


def _inputs(unknowns: tuple[Target, ...], parameters: tuple[str, ...], symbols: tuple[str, ...]) -> Inputs:
    return Inputs(unknowns, parameters, tuple(map(se.Symbol, symbols)))


@made_once("derive", 512)
def plan(d: Derived, outputs: Outputs) -> Plan:
    """The plan of a derived law for some outputs; made once per process."""
    with d.naming_errors():
        return Plan(d, outputs)


@made_once("derive", 512)
def linearised_plan(d: Derived, outputs: Outputs, open: Open = Open.FEWEST) -> LinearisedPlan:
    """The plan of a derived law for some outputs, with their derivatives; made once per process. open: see `LinearisedPlan`."""
    with d.naming_errors():
        return LinearisedPlan(d, outputs, open)
