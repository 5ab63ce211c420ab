"""A sum of multiples of coordinates that has a value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import symengine as se

from mbdae.symbolic.coupling import Coupling, Reference
from mbdae.symbolic.law import params as declared
from mbdae.symbolic.part import Parameter
from mbdae.symbolic.vectors import Expr


class WeightedSum(Coupling):
    """factor1 c1 + factor2 c2 + ... = value(t). The multiplier times a factor is the force on the coordinate of that factor, N or
    N m. options: count, the number of terms."""

    params = declared(value=("rad or m", "value of the sum"))
    options = ("count",)

    def __init__(self, name: str, of: Sequence[Reference], factors: Sequence[float], value: Any = 0.0) -> None:
        super().__init__(name, {f"c{n + 1}": at for n, at in enumerate(of)}, count=len(of), value=value)
        vars(self).update({f"factor{n + 1}": float(factor) for n, factor in enumerate(factors)})

    def compose(self) -> None:
        names = [f"factor{n + 1}" for n in range(self.count)]
        self.params = {**type(self).params, **{name: Parameter("1", "factor of a coordinate") for name in names}}
        vars(self).update({name: se.Symbol(name) for name in names})
        super().compose()

    @property
    def own_coordinates(self) -> tuple[str, ...]:
        return tuple(f"c{n + 1}" for n in range(self.count))

    def constraints(self) -> dict[str, Expr]:
        terms = [getattr(self, f"factor{n + 1}") * getattr(self, name) for n, name in enumerate(self.own_coordinates)]
        return {"sum": sum(terms, se.Integer(0)) - self.value}
