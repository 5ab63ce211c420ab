"""The kernels from which derivatives of runs are made, of every law in every variant: pullback, tangent, complex step agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from runner import Found

from mbdae.contracts.case import STEP, Case, Measured, compared, label
from mbdae.contracts.states import columns
from mbdae.contracts.variants import variants
from mbdae.laws import exported
from mbdae.symbolic.law import Law

LAWS = sorted(name for name, law in exported().items() if issubclass(law, Law))


def derivatives(case: Case) -> Iterator[Measured]:
    """By all inputs of all outputs of a law, by its numbers too; in NumPy, by the very expressions that are compiled."""
    plan, kernel = case.all_outputs, case.all_outputs.kernel
    if not plan.targets:
        return
    x = columns(plan.all_inputs.symbols, case.values).real
    change, weight = (case.rng.standard_normal((len(x), width)) for width in (x.shape[1], kernel.width))
    along = kernel.tangent.oracle(np.hstack([x, change])).real
    wanted = kernel.oracle(x + 1j * STEP * change).imag / STEP
    yield from compared([label(case.d, target) for target in plan.targets], along, wanted)
    back = kernel.pullback.oracle(np.hstack([x, weight])).real
    size = np.abs(weight * wanted).sum(axis=1) + np.abs(back * change).sum(axis=1) + 1e-300
    yield "pullback", float(np.max(np.abs((weight * wanted).sum(axis=1) - (back * change).sum(axis=1)) / size))


def of_laws(names: Sequence[str]) -> list[Found]:
    """The largest error over all variants of some laws."""
    worst, count = (0.0, ""), 0
    for name in names:
        law: Any = exported()[name]
        family: dict[Any, Case] = {}
        for variant, structure, sides in variants(law, {}, {}):
            count += 1
            for entry, error in derivatives(Case(law, structure, sides, {}, family, False)):
                worst = max(worst, (error if np.isfinite(error) else np.inf, f"{name}, {variant}: {entry}"))
    return [Found(worst[0], 1e-11, "relative", "tangent and pullback of laws", note=f"{count} variants; worst: {worst[1]}")]
