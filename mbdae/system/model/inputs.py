"""The inputs of time of a model: the instants at which they break, and how fast they vary in between."""

from __future__ import annotations

from dataclasses import dataclass

import symengine as se

from mbdae.inputs.breaks import TOLERANCE, switches
from mbdae.inputs.resolution import LongestStep, Stretches, resolved
from mbdae.inputs.timed import sided, split, used
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.outputs import insert, loads
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.model.model import Model

#: steps over a table are bounded so that their error of its value is at most this share of the accuracy of the run times the
#: range of the values
SHARE = 0.02


@dataclass(frozen=True)
class Timeline:
    """What the inputs of time require of the steps of a run. A break is an instant at which an input or one of its derivatives
    jumps: a step has to end there.

    edges (k+2,): start, breaks and end of the run, s; stretches: consecutive intervals, each about as long as the shortest change
    of an input in it; a step must not exceed them."""

    edges: Array
    stretches: Stretches

    @property
    def breaks(self) -> Array:
        """Instants (k,) inside the run at which an input or one of its derivatives may jump."""
        return self.edges[1:-1]

    def longest_step(self, share: float = 1.0) -> LongestStep | None:
        """Function of the time that returns the longest step (s) allowed from there: `share` times the stretch in which it lies.
        None where share is 1 and the breaks alone limit steps."""
        if share == 1 and not self.varies:
            return None
        return LongestStep(self.stretches.edges, share, self.stretches.kinks)

    @property
    def varies(self) -> bool:
        """Whether some input varies within a stretch that is shorter than the intervals between breaks."""
        return len(self.stretches.edges) > len(self.edges) or len(self.stretches.kinks) > 0

    def summary(self) -> str:
        """A line for the output of `Scene.check`: breaks, kinks and the fastest change of the inputs."""
        found = []
        if len(self.breaks):
            found.append(f"{len(self.breaks)} break{'s' * (len(self.breaks) > 1)}, the first at t = {self.breaks[0]:.6g} s")
        kinks = self.stretches.kinks
        if len(kinks):
            found.append(f"{len(kinks)} kink{'s' * (len(kinks) > 1)} of tables, the first at t = {kinks[0]:.6g} s")
        if self.varies:
            finest, where = self.stretches.finest
            found.append(f"finest change within {finest:.2g} s, at t = {where:.6g} s")
        return "; ".join(found) or "smooth, no breaks"


def expressions_of(model: Model) -> tuple[Expr, ...]:
    """Every expression of time in a model, each once."""
    found = [e for g, _, instance in model.instances() for value in instance.timed.values()
             for e in used(value, by_rates(model.groups[g].derived))]  # fmt: skip
    found += [se.sympify(value) for line in model.lines for value in line.timed.values()]
    return tuple(dict.fromkeys(found))


def by_rates(d: Derived) -> bool:
    """Whether the equations of a law contain time derivatives of its inputs: a prescribed motion does, or a damper one end of
    which an input moves."""

    def in_loads() -> bool:
        rates = set(d.variation.clock.values())
        return any(rates & e.free_symbols for e in insert(d, [e for _, e in loads(d)]))

    return bool(d.rows) or bool(d.noted(f"{__name__}.by_rates", in_loads))


def timeline(model: Model, t0: float, t1: float, accuracy: float | None = None) -> Timeline | None:
    """The timeline of a run from t0 to t1 (s); None where no input of time switches or limits steps. accuracy: that of the run,
    None where its steps are constant."""
    expressions = expressions_of(model)
    if not expressions:
        return None
    found = Timeline(*resolved(expressions, t0, t1, TOLERANCE if accuracy is None else SHARE * accuracy))
    switching = any(switches(e) or split((sided(e),)).readings for e in expressions)
    return found if switching or found.varies else None
