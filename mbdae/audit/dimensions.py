"""Units of formulas, found by scaling m, kg and s: a sum whose terms scale differently has no unit."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.audit import notation
from mbdae.audit.carried import expression_value
from mbdae.audit.evaluate import SizeError, evaluate, size
from mbdae.audit.laws import Own, derived, part_class
from mbdae.audit.motion import Motion
from mbdae.audit.notation import Node, Statement, bare
from mbdae.audit.phrases import Definition, Env
from mbdae.errors import MbdaeError
from mbdae.reports.units import BASIC, law_faults, powers_of, scales, shown, unit

PLAIN = dict.fromkeys(BASIC, 1.0)  #: sizes of the basic units; where there are sizes, functions need not be real


def powers(node: Node, envs: Sequence[Env]) -> NDArray[np.float64] | None:
    """Exponents of m, kg and s of every entry (nan where it is 0); None where an entry has no unit."""
    with np.errstate(all="ignore"):
        before, *after = (np.array([np.ravel(evaluate(node, replace(env, scale=scale, store={}))) for env in envs])
                          for scale in (PLAIN, *scales()))  # fmt: skip
    return powers_of(before, after)


def united(node: Node, envs: Sequence[Env]) -> bool:
    """Whether a formula and every sum in it have a unit."""
    return powers(node, envs) is not None and not _culprit(node, envs)


def faults(statement: Statement, envs: Sequence[Env]) -> list[str]:
    """Errors in the units of a statement, in words; an empty list where the units agree."""
    envs = [replace(env, scale=PLAIN, store={}) for env in envs]
    try:
        found = [(side, powers(side, envs)) for side in statement.sides if not notation.is_zero(side)]
        sizes = dict.fromkeys(size(evaluate(side, envs[0])) for side, _ in found)
        if len(sizes) > 1:
            return [f"sizes do not fit: {' = '.join(sizes)}"]
    except SizeError as error:
        return [str(error)]
    known = []
    for side, p in found:
        culprit = _culprit(side, envs) if p is None or np.all(np.isnan(p)) else ""  # a sum that is 0 hides the units of its terms
        if p is None or culprit:
            return [culprit or f"{side} has no unit"]
        known.append((side, p))
    for side, q in known[1:]:
        first, p = known[0]
        if p.shape == q.shape and np.nanmax(np.abs(p - q), initial=0.0) > 1e-6:
            return [f"{first} has the unit {shown(p)}, {side} the unit {shown(q)}"]
    return []


def of_definitions(statement: Statement, envs: Sequence[Env]) -> list[str]:
    """Definitions of the text whose formula has another unit than the declared one."""
    scope, out = envs[0].scope, []
    for name in sorted(scope.reached(statement.symbols())):
        meaning = scope.symbols[name]
        if isinstance(meaning, Definition) and meaning.units:
            inside = [replace(env, scope=meaning.scope, store={}) for env in envs]
            p, declared = powers(meaning.node, inside), np.array([u.powers for u in meaning.units]).T
            if p is None:
                return [_culprit(meaning.node, inside) or f"the definition of {name} has no unit"]
            rows = np.repeat(declared, max(1, p.shape[1] // declared.shape[1]), axis=1)
            if rows.shape == p.shape and np.nanmax(np.abs(p - rows), initial=0.0) > 1e-6:
                out.append(f"{name} is defined with the unit {shown(p)} and declared with {', '.join(map(str, meaning.units))}")
    return out


def _culprit(node: Node, envs: Sequence[Env]) -> str:
    """The innermost sum whose terms have different units, in words; empty where there is none."""
    for part in node.parts:
        inner = _culprit(part, envs)
        if inner:
            return inner
    if node.kind != "sum":
        return ""
    units = [(term, powers(term, envs)) for term in node.parts]
    known = [(term, p) for term, p in units if p is not None]
    for term, p in known[1:]:
        if np.nanmax(np.abs(p - known[0][1]), initial=0.0) > 1e-6:
            return f"in a sum {bare(known[0][0])} has the unit {shown(known[0][1])}, {bare(term)} the unit {shown(p)}"
    return ""


# -- laws given by the user

#: functions of normal laws and friction laws, with the units of their arguments and of what they return
_FUNCTIONS = {"elastic_force": (("m",), "N"), "damping_force": (("m", "m/s"), "N"), "energy": (("m",), "J"),
              "coefficient": (("m/s",), "1")}  # fmt: skip


def of_laws(names: Iterable[str], own: Own) -> list[str]:
    """Which of the named laws, among those given by the user (`own`), have units that do not fit, in words; laws with an unknown
    unit are left out."""
    out = []
    for name in sorted(set(names) & set(dict(own))):
        try:
            found = _of_part(part_class(name, own)) if part_class(name, own) else law_faults(derived(name, own))
        except (MbdaeError, SizeError, ArithmeticError):
            continue
        out += [f"the law {name} that judges this has wrong units: {found[0]}"] if found else []
    return out


def _of_part(cls: Any) -> list[str]:
    """The functions of a normal law or friction law that return a wrong unit, in words."""
    if getattr(cls, "states", ()):
        return []
    for function, (units, wanted) in _FUNCTIONS.items() if cls else ():
        if function in vars(cls):
            before, *after = (np.array([[_returned(cls, function, units, seed, scale)] for seed in range(3)])
                              for scale in (PLAIN, *scales()))  # fmt: skip
            p = powers_of(before, after)
            if p is None:
                return [f"its {function} has terms with different units"]
            if np.nanmax(np.abs(p[:, 0] - unit(wanted).powers), initial=0.0) > 1e-6:
                return [f"its {function} has the unit {shown(p)}, not {wanted}"]
    return []


def _returned(cls: Any, function: str, units: Sequence[str], seed: int, scale: Mapping[str, float]) -> float:
    """What a function of a law returns for random parameters and arguments (by seed), where m, kg and s have the sizes
    `scale`."""
    made, motion = object.__new__(cls), Motion(seed)
    vars(made).update(dict.fromkeys(cls.options))
    vars(made).update({p: motion.positive(p) * unit(spec.unit).size(scale) for p, spec in cls.params.items()})
    arguments = [motion.positive(u) * unit(u).size(scale) for u in units]
    return float(np.real(expression_value(se.sympify(getattr(made, function)(*arguments)), {})))
