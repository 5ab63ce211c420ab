"""One number for the equations of every law: its outputs at seeded states of motion, weighted.

`python tests/reports/values.py` writes them anew into values.json, which a change of a law on purpose needs."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import symengine as se

from mbdae.reports import _TYPICAL, exported
from mbdae.reports.parts_page import PartPage
from mbdae.reports.statement import derived, structure_of
from mbdae.reports.states import random_state, value
from mbdae.symbolic.derive import derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element
from mbdae.symbolic.line import LineLaw, derive_line
from mbdae.symbolic.outputs import acceleration, dynamics, lowest
from mbdae.symbolic.part import Part

FILE = Path(__file__).parent / "values.json"


def of_law(law):
    """The number of one law."""
    weights = np.random.default_rng(1)
    if issubclass(law, LineLaw | Element):
        shape = structure_of(law, {})
        if issubclass(law, LineLaw):
            d = derive_line(law, shape, NodeKind.SPATIAL)
            outputs = [*(e for _, e in d.duals), *d.rows, *d.mass.values()]
        else:
            outputs = [e for _, e in dynamics(derive(law, shape, ((NodeKind.SPATIAL, Axes.GENERAL),)))]
        symbols = sorted(set().union(*(se.sympify(e).free_symbols for e in outputs)) if outputs else [], key=str)
        at = dict(zip(symbols, np.random.default_rng(2).uniform(0.5, 1.5, len(symbols)), strict=True))
        return float(sum(value(se.sympify(e), at.__getitem__) * weights.normal() for e in outputs))
    d = PartPage(_TYPICAL[law].structure()).d if issubclass(law, Part) else derived(law, structure_of(law, {}))
    outputs = [*lowest(d), *acceleration(d), *dynamics(d), *enumerate((*d.state_rates, *d.state_starts))]
    outputs += [*d.coordinates.items(), ("energy", d.energy), ("dissipated", d.dissipated_power)]
    if issubclass(law, Joint):
        outputs += [(k, d.variation.name(e)) for k, e in d.law.positives(*d.sides).items()]
    state = random_state(d, spread=0.4)
    return float(sum(np.sum(state.scalar(e) * weights.normal(size=state.points)) for _, e in outputs))


def all_values():
    """Every exported law by its name."""
    return {name: of_law(law) for name, law in sorted(exported().items())}


def differing(found):
    """Names whose number is not the stored one."""
    stored = json.loads(FILE.read_text(encoding="utf-8"))
    return [name for name, x in found.items() if not np.isclose(x, stored.get(name, np.inf), rtol=1e-7, atol=1e-9)]


if __name__ == "__main__":
    FILE.write_text(json.dumps(all_values(), indent=1) + "\n", encoding="utf-8")
    print(f"wrote {FILE}", file=sys.stderr)
