"""The properties that every law must have, checked on any joint, force or element class: the package's or your own.

    Jacobian              exact derivatives of all outputs of the forms against complex step
    compiled kernel       compiled code against NumPy, of one variant in space and one in the plane
    rates                 G u + g_t = dg/dt and gamma = d2g/dt2 at zero acceleration, quaternions of any length
    virtual work          generalised forces = (dg/dq)^T lambda + dV/dq + dR/du - wrench - thrust, entry by entry
    action = reaction     no force and no moment on a common rigid motion (joints: where their rows vanish)
    invariance            rows, energies and coordinate unchanged by a common rigid motion
    power                 generalised forces . velocity = dV/dt + dissipated - work; dissipated >= 0
    inertia               generalised forces . velocity = dT/dt, and the balance of angular momentum
    singular states       finite as drawn, at a quarter and at a half turn
    planar = spatial      rows, forces and energy of the planar variant are those of the spatial one in the plane
    motion                rows, coordinates, ties and branches of a joint are those of the motion it states
    declaration           every parameter, coordinate and state has a unit and a meaning
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

from mbdae.contracts.case import Case
from mbdae.contracts.checks import BOUNDS, CONTRACTS, MEANS
from mbdae.contracts.variants import refuse_missing, variants
from mbdae.errors import LawError, OptionError, naming_arguments, unknown_name
from mbdae.laws.contact import Normal
from mbdae.laws.friction import Friction
from mbdae.laws.journal import JournalContact
from mbdae.notation import counted
from mbdae.reports.statement import OPTIONS, check_kind
from mbdae.symbolic.derive import Side
from mbdae.symbolic.law import Law, Structure
from mbdae.symbolic.part import Part, PartStructure
from mbdae.values import number, option, shown

#: LINES: how to read the lines of the LawError of `selftest`; MOST_LINES: largest number of lines of one contract
LINES = ("Each line: the check, the bodies k - l (spatial: a rigid body in space) and the options of the first variant that "
         "fails, and what is wrong.")
MOST_LINES = 20


@dataclass(frozen=True)
class SelfTest:
    """Outcome of `selftest`: the variants checked, those the law refuses (with its reason), the worst error of every contract."""

    law: str
    variants: tuple[str, ...]
    refused: dict[str, str]
    worst: dict[str, tuple[float, str]]

    def __repr__(self) -> str:
        name = max(self.worst, key=lambda one: self.worst[one][0] / (BOUNDS[one] or 1.0))
        refused = f", {len(self.refused)} refused" if self.refused else ""
        return (f"<SelfTest of {self.law}: {len(self.variants)} variants keep the contract{refused}; nearest to its bound of "
                f"{BOUNDS[name]:g}: {name}, {self.worst[name][0]:.1e}>")

    def __str__(self) -> str:
        lines = [f"{self.law}: {len(self.variants)} variants keep the contract"]
        lines += [f"  {name:20s} {error:8.1e}  (bound {BOUNDS[name]:g})  {where}" for name, (error, where) in self.worst.items()]
        return "\n".join(lines + [f"  refused {name}: {reason}" for name, reason in self.refused.items()])


@naming_arguments
def selftest(law: type[Law] | type[Part], **options: Any) -> SelfTest:
    """Check the contract of a law class in every variant; raises LawError with every violation.

    A friction or normal law is checked in the contact of a pin in its race. options: values of the law's options
    (`joint=mb.Revolute`) or of its parameters (`pitch=0.01`; random otherwise).
    """
    if not (isinstance(law, type) and issubclass(law, Law | Part)):
        raise OptionError(f"law = {shown(law)}: give the class of a joint, force, friction or normal law, such as mb.Revolute")
    options = {name: _read(law, name, value) for name, value in options.items()}
    return _of_part(law, options) if issubclass(law, Part) else _of_law(law, options)


def _read(law: type[Law] | type[Part], name: str, value: Any) -> Any:
    """An option as it is, or a parameter as a number; also one of a part of the law, such as `friction_mu`."""
    if name in law.options:
        check_kind(name, value, OPTIONS.get(name))
        return value
    if name in law.params or any(name.startswith(f"{part}_") for part in law.options):
        unit = law.params[name].unit if name in law.params else "its unit"
        return option(name, value, number, f"give a number in {unit}, or leave it out")
    known = [*law.options, *law.params]
    raise OptionError(f"{name} = {shown(value)}: {law.__name__} has no option or parameter {unknown_name(name, known)} it has "
                      f"{', '.join(known) or 'none'}")


def _of_law(law: type[Law], options: dict[str, Any], called: str = "") -> SelfTest:
    run = _Run(law, options)
    violations = list(declaration(law))
    for name, structure, sides in variants(law, options, run.refused):
        violations += run.check(name, structure, sides)
    if not run.checked:
        first = {reason: name for name, reason in reversed(run.refused.items())}
        reasons = "; ".join(f"{name}: {reason}" for reason, name in reversed(first.items()))
        violations.append(f"no variant can be derived ({reasons})")
    if violations:
        listed = "\n  - ".join(["", *violations])
        legend = "".join(f"\n{contract}, {counted(len(entries), 'place')}: {MEANS[contract]}"
                         for contract, entries in run.failed.items() if entries)
        what_lines_say = f"\n{LINES}{legend}" if legend else ""
        raise LawError(f"{called or law.__name__} breaks the contract of laws:{listed}{what_lines_say}")
    return SelfTest(law.__name__, tuple(run.checked), run.refused, run.worst)


def declaration(law: type[Law] | type[Part]) -> Iterator[str]:
    """Messages on parameters, coordinates and states without unit or meaning. The unit of a pure number is "1"."""
    tables = {"parameter": law.params, "coordinate": getattr(law, "coordinates", {}), "state": law.states}
    for quantity, table in tables.items():
        for name, entry in table.items():
            if not entry.unit:
                yield f"{quantity} '{name}' has no unit; give one, '1' for a pure number"
            if not entry.meaning and law.__module__.startswith("mbdae."):
                yield f"{quantity} '{name}' has no meaning; describe it in a few words"


def _of_part(part: type[Part], options: dict[str, Any]) -> SelfTest:
    """Check the contact law with a friction or normal law of that class."""
    refuse_missing(part, [o for o in part.options if o not in options])
    if not issubclass(part, Friction | Normal):
        raise LawError(f"{part.__name__} is neither a friction law (mb.Friction) nor a normal law (mb.Normal); derive it "
                       f"from one of them")
    undeclared = list(declaration(part))
    if undeclared:
        raise LawError(f"{part.__name__} breaks the contract of laws:\n  - " + "\n  - ".join(undeclared))
    chosen = PartStructure(part, frozenset(), tuple((o, options[o]) for o in part.options))
    role = "friction" if issubclass(part, Friction) else "normal"
    given = {f"{role}_{name}": value for name, value in options.items() if name in part.params}
    return replace(_of_law(JournalContact, {role: chosen, **given}, f"{part.__name__}, in the contact of a pin in its race,"),
                   law=part.__name__)


@dataclass
class _Run:
    """Collects what the contracts find over all variants."""

    law: type[Law]
    options: dict[str, Any]
    family: dict[Any, Case] = field(default_factory=dict)
    compiled: set[bool] = field(default_factory=set)  #: True in it: compiled code was checked in the plane; False: in space
    checked: list[str] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    worst: dict[str, tuple[float, str]] = field(default_factory=dict)
    failed: dict[str, set[str]] = field(default_factory=dict)  #: contract -> what fails, told only where it fails first

    def check(self, name: str, structure: Structure, sides: tuple[Side, ...]) -> list[str]:
        self.checked.append(name)
        given = {p: float(v) for p, v in self.options.items() if isinstance(v, int | float) and p not in self.law.options}
        flat = any(kind.flat for kind, _ in sides)
        case = Case(self.law, structure, sides, given, self.family, flat not in self.compiled)
        self.compiled.add(flat)
        violations = []
        for contract, measure in CONTRACTS.items():
            failed = self.failed.setdefault(contract, set())
            for entry, error in measure(case):
                if error >= self.worst.get(contract, (-1.0, ""))[0]:
                    self.worst[contract] = error, f"{name}: {entry}"
                if not error <= BOUNDS[contract] and entry not in failed:
                    failed.add(entry)
                    off = f"is off by {error:.2g} (allowed {BOUNDS[contract]:g})" if isfinite(error) else "is not a finite number"
                    violations += [f"{contract}, {name}: {entry} {off}"] if len(failed) <= MOST_LINES else []
        return violations
