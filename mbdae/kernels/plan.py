"""Plans: which outputs of a law are constant, linear or nonlinear, and the kernels that evaluate them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import symengine as se

from mbdae.costs import made_once
from mbdae.kernels.compile import Kernel
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.outputs import Target, derivatives, input_symbols, insert
from mbdae.symbolic.vectors import Expr

Outputs = Callable[[Derived], Sequence[tuple[Target, Expr]]]  #: selects outputs of a law, see `symbolic.outputs`


@dataclass(frozen=True)
class Inputs:
    """Columns of a kernel's input: unknowns by target, parameters by name."""

    unknowns: tuple[Target, ...]
    parameters: tuple[str, ...]
    symbols: tuple[Expr, ...]


class Plan:
    """The outputs of a law, without derivatives."""

    def __init__(self, d: Derived, outputs: Outputs) -> None:
        entries = list(outputs(d))
        self.derived, self.targets = d, [target for target, _ in entries]
        self.expressions = [e for _, e in entries]
        self.inserted = insert(d, self.expressions)
        self._unknown = {symbol: target for target, symbol in input_symbols(d)}

    def inputs(self, expressions: Sequence[Expr], used: set[Expr] | None = None) -> Inputs:
        """The unknowns and parameters on which some expressions depend, in a fixed order; `used`: their symbols, if known."""
        if used is None:
            used = set().union(*(e.free_symbols for e in expressions))
        unknowns = [(s, t) for s, t in self._unknown.items() if s in used]
        parameters = sorted((s for s in used if s not in self._unknown), key=str)
        symbols = tuple(s for s, _ in unknowns) + tuple(parameters)
        return Inputs(tuple(t for _, t in unknowns), tuple(map(str, parameters)), symbols)

    @cached_property
    def all_inputs(self) -> Inputs:
        """Inputs of all outputs."""
        return self.inputs(self.inserted)

    @cached_property
    def kernel(self) -> Kernel:
        """All outputs in one kernel."""
        return Kernel(self.all_inputs.symbols, self.inserted)


class LinearisedPlan(Plan):
    """The outputs of a law with their exact derivatives, sorted into constant, linear and nonlinear.

    A derivative that depends on parameters only is constant; an output whose derivatives are all constant and that does not
    depend on time is linear: it needs no kernel. sort: False leaves all outputs and derivatives in the kernels, whose inputs then
    are all parameters.
    """

    def __init__(self, d: Derived, outputs: Outputs, sort: bool = True) -> None:
        super().__init__(d, outputs)
        partials = [derivatives(d, e) for e in self.expressions]
        places = [(i, target) for i, row in enumerate(partials) for target in row]
        values = insert(d, [value for row in partials for value in row.values()])
        symbols = [value.free_symbols for value in values]
        clock = {symbol for pair in d.variation.clock.items() for symbol in pair}
        varying = set(self._unknown) | clock
        constant = [sort and not (found & varying) for found in symbols]
        curved = {i for (i, _), fixed in zip(places, constant, strict=True) if not fixed}
        curved |= {i for i, e in enumerate(self.inserted) if not sort or e.free_symbols & clock}
        self.nonlinear = [i for i in range(len(self.inserted)) if i in curved]
        linear = [i for i in range(len(self.inserted)) if i not in curved]
        origin = self._origin(d)
        self.constant_places = [p for p, fixed in zip(places, constant, strict=True) if fixed]
        self.offset_places = linear
        offsets = [self._offset(i, places, values, origin) for i in linear]
        fixed_values = [v for v, fixed in zip(values, constant, strict=True) if fixed]
        self.constants, self.constant_inputs = self._kernel(fixed_values + offsets)
        self.jacobian_places = [p for p, fixed in zip(places, constant, strict=True) if not fixed]
        varying_values = [v for v, fixed in zip(values, constant, strict=True) if not fixed]
        used = set().union(*(found for found, fixed in zip(symbols, constant, strict=True) if not fixed))
        self.jacobian, self.jacobian_inputs = self._kernel(varying_values, used)
        self.residual, self.residual_inputs = self._kernel([self.inserted[i] for i in self.nonlinear])

    def _origin(self, d: Derived) -> dict[Expr, Expr]:
        """Point at which the offset of a linear output is evaluated: all unknowns 0, quaternions (1, 0, 0, 0), where R exists."""
        first = {f.q[f.kind.translations] for f in d.frames if f.kind.by_quaternion}
        return {symbol: se.Integer(1 if symbol in first else 0) for symbol in self._unknown}

    def _offset(self, i: int, places: list[tuple[int, Target]], values: list[Expr], origin: dict[Expr, Expr]) -> Expr:
        """Value of a linear output at the origin without its linear terms there."""
        symbol = {target: s for s, target in self._unknown.items()}
        linear = sum((v * origin[symbol[t]] for (o, t), v in zip(places, values, strict=True) if o == i), se.Integer(0))
        return self.inserted[i].subs(origin) - linear

    def _kernel(self, expressions: list[Expr], used: set[Expr] | None = None) -> tuple[Kernel, Inputs]:
        inputs = self.inputs(expressions, used)
        return Kernel(inputs.symbols, expressions), inputs


@made_once("derive", 512)
def plan(d: Derived, outputs: Outputs) -> Plan:
    """The plan of a derived law for some outputs; made once per process."""
    return Plan(d, outputs)


@made_once("derive", 512)
def linearised_plan(d: Derived, outputs: Outputs, sort: bool = True) -> LinearisedPlan:
    """The plan with derivatives; made once per process."""
    return LinearisedPlan(d, outputs, sort)
