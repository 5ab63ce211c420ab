"""Units of formulas, found by changing the sizes of m, kg and s: a sum whose terms change differently has no unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mbdae.audit import notation
from mbdae.audit.evaluate import SizeError, evaluate, size
from mbdae.audit.notation import Node, Statement
from mbdae.audit.phrases import Definition, Env
from mbdae.audit.units import BASIC, Unit

FACTOR = 1.25  #: by which a basic unit changes its size


def powers(node: Node, envs: Sequence[Env]) -> NDArray[np.float64] | None:
    """Powers of m, kg and s of every entry (nan where it is 0); None where an entry has no unit."""
    found = []
    for name in BASIC:
        scale = {basic: FACTOR if basic == name else 1.0 for basic in BASIC}
        ratios = []
        for env in envs:
            with np.errstate(all="ignore"):
                before = np.asarray(evaluate(node, env))
                after = evaluate(node, replace(env, scale=scale, store={}))
                ratio = np.where(np.abs(before) > 1e-9, np.abs(after / before), np.nan)
            ratios.append(np.log(np.atleast_1d(ratio)) / np.log(FACTOR))
        stacked = np.array(ratios)
        mean = np.array([np.mean(c[~np.isnan(c)]) if np.any(~np.isnan(c)) else np.nan for c in stacked.reshape(len(envs), -1).T])
        if np.nanmax(np.abs(stacked.reshape(len(envs), -1) - mean), initial=0.0) > 1e-6:
            return None
        found.append(mean)
    return np.array(found)


def faults(statement: Statement, envs: Sequence[Env]) -> list[str]:
    """Errors in the units of a statement, in words; none where they agree."""
    try:
        found = [(side, powers(side, envs)) for side in statement.sides if not notation.is_zero(side)]
        sizes = dict.fromkeys(size(evaluate(side, envs[0])) for side, _ in found)
        if len(sizes) > 1:
            return [f"sizes do not fit: {' = '.join(sizes)}"]
    except SizeError as error:
        return [f"sizes do not fit: {error}"]
    known = []
    for side, p in found:
        if p is None:
            return [_culprit(side, envs) or f"{side} has no unit"]
        known.append((side, p))
    first, p = known[0]
    for side, q in known[1:]:
        if p.shape == q.shape and np.nanmax(np.abs(p - q), initial=0.0) > 1e-6:
            return [f"{first} has the unit {shown(p)}, {side} the unit {shown(q)}"]
    return []


def of_definitions(statement: Statement, envs: Sequence[Env]) -> list[str]:
    """Definitions of the text whose unit is not the one that their formula has."""
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
    """The innermost sum whose terms have different units."""
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
            return f"in a sum {_bare(known[0][0])} has the unit {shown(known[0][1])}, {_bare(term)} the unit {shown(p)}"
    return ""


def _bare(node: Node) -> Node:
    return node.parts[0] if node.kind == "neg" else node


def shown(p: NDArray[np.float64]) -> str:
    """Units of entries in words, each once."""
    columns = [c for c in p.T if not np.any(np.isnan(c))]
    units = dict.fromkeys(str(Unit((round(c[0], 3) + 0, round(c[1], 3) + 0, round(c[2], 3) + 0))) for c in columns)
    return ", ".join(units) or "1"
