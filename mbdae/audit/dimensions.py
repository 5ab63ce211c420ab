"""Units of formulas, found by changing the sizes of m, kg and s: a sum whose terms change differently has no unit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.audit import notation
from mbdae.audit.evaluate import SizeError, evaluate, expression_value, size
from mbdae.audit.laws import LawState, Own, derived, part_class
from mbdae.audit.motion import Motion
from mbdae.audit.notation import BASIC, Node, Statement, Unit, unit
from mbdae.audit.phrases import Definition, Env
from mbdae.errors import MbdaeError

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
        return [str(error)]
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


# -- laws of the user

_PLACES = {"center": "m", "arm": "m", "center_velocity": "m/s", "w": "1/s", "spin": "1/s"}  #: vectors of a body
#: functions of normal laws and friction laws, with the units of their arguments and of what they return
_FUNCTIONS = {"elastic_force": (("m",), "N"), "damping_force": (("m", "m/s"), "N"), "energy": (("m",), "J"),
              "coefficient": (("m/s",), "1")}  # fmt: skip
Stated = tuple[str, Any, str]  #: what a law states, the expression, the unit that it must have (or any)


def of_laws(names: Iterable[str], own: Own) -> list[str]:
    """Laws of the user among some names whose units do not fit; a law with a unit that is not known is left out."""
    out = []
    for name in sorted(set(names) & set(dict(own))):
        try:
            fault = _fault(*(_part if part_class(name, own) else _between_bodies)(name, own))
        except (MbdaeError, SizeError, ArithmeticError):
            continue
        out += [f"the law {name} that judges this has wrong units: {fault}"] if fault else []
    return out


def _fault(stated: Sequence[Stated], value: Callable[[Any, int, Mapping[str, float]], Any]) -> str:
    """value: of an expression in a random state, by the sizes of the basic units."""
    for what, e, wanted in stated:
        before = [value(e, seed, dict.fromkeys(BASIC, 1.0)) for seed in range(3)]
        after = [[value(e, seed, dict.fromkeys(BASIC, 1.0) | {basic: FACTOR}) for seed in range(3)] for basic in BASIC]
        if np.min(np.abs(before)) < 1e-12:
            continue
        p = np.log(np.abs(np.divide(after, before))) / np.log(FACTOR)
        if np.ptp(p, axis=1).max() > 1e-6:
            return f"{what} is a sum of terms with different units"
        if wanted and np.abs(p[:, 0] - unit(wanted).powers).max() > 1e-6:
            return f"{what} has the unit {shown(p[:, :1])}, not {wanted}"
    return ""


def _between_bodies(name: str, own: Own) -> tuple[list[Stated], Any]:
    d = derived(name, own)
    units = {se.Symbol(p): unit(spec.unit) for p, spec in d.law.params.items()}
    units |= {x: unit(u) for frame in d.sides for place, u in _PLACES.items() for x in getattr(frame, place)}
    for frame, spec in zip(d.frames[2:], d.law.coordinates.values() if d.frames[2:] else (), strict=False):
        units |= dict.fromkeys(frame.q, unit(spec.unit)) | dict.fromkeys(frame.u, unit(f"{spec.unit}/s"))

    def value(e: Any, seed: int, scale: Mapping[str, float]) -> Any:
        state = LawState(name, Motion(seed), {}, own)
        state.values = {x: v * units[x].size(scale) if x in units else v for x, v in state.values.items()}
        return state.number(e)

    forces = [(f"the {what} on {side}", e, u) for side in "kl" if side in d.force
              for what, u, entries in zip(("force", "moment"), ("N", "N m"), d.force[side], strict=True) for e in entries]
    rows = [(f"the row {row}", g, "") for row, g in zip(d.rows, d.g, strict=True)]
    return [*rows, ("the energy", d.energy, "J"), ("the dissipated power", d.dissipated_power, "W"), *forces], value


def _part(name: str, own: Own) -> tuple[list[Stated], Any]:
    cls: Any = part_class(name, own)

    def value(function: str, seed: int, scale: Mapping[str, float]) -> Any:
        made, motion = object.__new__(cls), Motion(seed)
        for key in (*cls.options, *getattr(cls, "states", ())):
            setattr(made, key, None)
        for p, spec in cls.params.items():
            setattr(made, p, motion.positive(p) * unit(spec.unit).size(scale))
        arguments = [motion.positive(u) * unit(u).size(scale) for u in _FUNCTIONS[function][0]]
        return expression_value(se.sympify(getattr(made, function)(*arguments)), {})

    stated = [(f"its {f}", f, u) for f, (_, u) in _FUNCTIONS.items() if f in vars(cls) and not getattr(cls, "states", ())]
    return stated, value
