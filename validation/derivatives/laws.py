"""The kernels from which derivatives of runs are made, of every law in every variant: pullback, tangent, complex step agree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import symengine as se
from runner import Found

import mbdae as mb
from mbdae.contracts.case import POINTS, STEP, Case, Measured, compared, label
from mbdae.contracts.states import columns
from mbdae.contracts.variants import variants
from mbdae.kernels import Kernel
from mbdae.laws import exported
from mbdae.laws.friction import Friction
from mbdae.laws.journal import JournalContact
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.line import LineLaw, derive_line
from mbdae.symbolic.part import Part, PartStructure

BASES = ("Friction", "Normal")  #: of parts, which state nothing themselves
VALUES = {"gamma": 2.0, "damping_decay": True}  #: of options of parts


class Hardening(mb.Force):
    """A law as a user states it: a spring between two points whose stiffness grows with its length."""

    params = mb.params(stiffness=("N/m", "at length 0"), growth=("1/m**2", "of the stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        """Elastic energy, J."""
        square = (l.r - k.r) @ (l.r - k.r)
        return self.stiffness * square * (1 + self.growth * square) / 2  # type: ignore[attr-defined]


class Fading(mb.Friction):
    """A friction law as a user states it: its coefficient falls with the speed."""

    params = mb.params(mu=("1", "coefficient at rest"), speed=("m/s", "at which it is a half"))

    def coefficient(self, slip: Any) -> Any:
        """Friction over normal force."""
        return self.mu * slip / (slip**2 + self.speed**2)  # type: ignore[attr-defined]


LAWS: dict[str, Any] = {name: law for name, law in sorted(exported().items()) if name not in BASES}
LAWS |= {"a user's law": Hardening, "a user's friction": Fading}


def differing(kernel: Kernel, names: list[str], x: Any, rng: np.random.Generator) -> Iterator[Measured]:
    """Outputs of a kernel at inputs x (points, inputs) by all inputs; in NumPy, by the very expressions that are compiled."""
    change, weight = (rng.standard_normal((len(x), width)) for width in (x.shape[1], kernel.width))
    along = kernel.tangent.oracle(np.hstack([x, change])).real
    wanted = kernel.oracle(x + 1j * STEP * change).imag / STEP
    yield from compared(names, along, wanted)
    back = kernel.pullback.oracle(np.hstack([x, weight])).real
    size = np.abs(weight * wanted).sum(axis=1) + np.abs(back * change).sum(axis=1) + 1e-300
    yield "pullback", float(np.max(np.abs((weight * wanted).sum(axis=1) - (back * change).sum(axis=1)) / size))


def of_line(law: type[LineLaw]) -> Iterator[tuple[str, list[Measured]]]:
    """A law on a line at points of it, by its fields, stresses and numbers."""
    for kind in (NodeKind.PLANAR, NodeKind.SPATIAL):
        for options in (dict.fromkeys(law.options, value) for value in ((False, True) if law.options else (False,))):
            for mixed in (True, False):
                d, rng = derive_line(law, Structure(options=tuple(options.items())), kind, mixed), np.random.default_rng(20)
                kernel = Kernel([*d.variables, *map(se.Symbol, d.parameters)], d.outputs)
                x = rng.uniform(0.3, 1.0, (POINTS, len(d.variables) + len(d.parameters)))
                names = [f"output {i + 1}" for i in range(len(d.outputs))]
                yield f"{kind.value}, {options}, stresses {mixed}", list(differing(kernel, names, x, rng)) if names else []


def of_law(law: Any) -> Iterator[tuple[str, list[Measured]]]:
    """Every variant of a law or part, with what is measured of it; nothing where it has no outputs."""
    if issubclass(law, LineLaw):
        yield from of_line(law)
        return
    options: dict[str, Any] = {}
    if issubclass(law, Part):
        role = "friction" if issubclass(law, Friction) else "normal"
        chosen = tuple((o, VALUES[o]) for o in law.options)
        law, options = JournalContact, {role: PartStructure(law, frozenset(), chosen)}
    family: dict[Any, Case] = {}
    for variant, structure, sides in variants(law, options, {}):
        case = Case(law, structure, sides, {}, family, False)
        plan = case.all_outputs
        names = [label(case.d, target) for target in plan.targets]
        x = columns(plan.all_inputs.symbols, case.values).real
        yield variant, list(differing(plan.kernel, names, x, case.rng)) if names else []


def of_laws(names: Sequence[str]) -> list[Found]:
    """The largest error over all variants of some laws; infinite where a law has nothing to compare in any of them."""
    worst, count, bare = (0.0, ""), 0, list[str]()
    for name in names:
        before = count
        for variant, measured in of_law(LAWS[name]):
            count += bool(measured)
            if not measured:
                bare.append(f"{name}, {variant}")
            for entry, error in measured:
                worst = max(worst, (error if np.isfinite(error) else np.inf, f"{name}, {variant}: {entry}"))
        if count == before:
            worst = np.inf, f"{name} has nothing to compare in any variant"
    said = f"{count} variants compared; worst: {worst[1]}; nothing to compare in {len(bare)}: {'; '.join(bare) or 'none'}"
    return [Found(worst[0], 1e-11, "relative", "tangent and pullback of laws", note=said)]
