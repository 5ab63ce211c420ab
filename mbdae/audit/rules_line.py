"""Rules of lines (beams): strains, stress resultants and energy of a law at a section, from the law that runs."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.evaluate import Value, expression_value
from mbdae.audit.motion import axial, quaternion
from mbdae.audit.notation import AuditError
from mbdae.audit.phrases import Env, phrase
from mbdae.laws.elements.beam import Beam
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.law import Structure
from mbdae.symbolic.line import LENGTH, WEIGHT, LineDerived, LineLaw, derive_line, make_point


def _class(name: str, env: Env) -> Any:
    found = ({"Beam": Beam} | dict(env.scope.own)).get(name)
    if not (isinstance(found, type) and issubclass(found, LineLaw)):
        raise AuditError(f"there is no law on a line '{name}'; give your own class with audit(..., laws=...)")
    return found


@lru_cache(maxsize=8)
def _derived(cls: Any) -> tuple[LineDerived, Any]:
    structure = Structure(absent=frozenset({"damping"} & set(cls.params)))
    return derive_line(cls, structure, NodeKind.SPATIAL), cls.symbolic(structure)


def _values(env: Env, law: Any) -> dict[Any, Any]:
    """Symbols of a point of a line in the state of the section, ds/dxi = 1; parameters as random positive numbers."""
    key = ("line", type(law))
    if key not in env.motion.memory:
        env.motion.memory[key] = _point(env, law)
    found: dict[Any, Any] = env.motion.memory[key]
    return found


def _point(env: Env, law: Any) -> dict[Any, Any]:
    r, Q = env.motion.section()
    r_s = env.changes("line", lambda e: e.motion.section()[0])
    Q_s = env.changes("line", lambda e: e.motion.section()[1])
    P = quaternion(Q)
    K = axial(Q_s @ Q.T)
    slope = np.vstack([-K.T @ P[1:], P[0, 0] * K + np.cross(K, P[1:], axis=0)]) / 2
    names = ["r1", "r2", "r3", "P1", "P2", "P3", "P4"]
    numbers = dict(zip(names, np.vstack([r, P])[:, 0], strict=True))
    numbers |= dict(zip([n + "_xi" for n in names], np.vstack([r_s, slope])[:, 0], strict=True))
    v, spin = (env.changes("time", lambda e: e.motion.section()[0]), Q.T @ env.of("angular velocity of the section"))
    numbers |= {f"u{i + 1}": x for i, x in enumerate(np.vstack([v, spin])[:, 0])}
    numbers |= {p: env.motion.positive(f"parameter {p}") for p in law.params}
    return {se.Symbol(n): complex(x) for n, x in numbers.items()} | {LENGTH: 1 + 0j, WEIGHT: 1 + 0j}


def _number(e: Any, values: dict[Any, Any]) -> Value:
    return expression_value(se.sympify(e), values)


@phrase("strains {names} of {name2}", vanishes=True)
@phrase("strain {names} of {name2}", vanishes=True)
def _strains(env: Env, names: str, of: str) -> Value:
    _, law = _derived(_class(of, env))
    stated, values = law.strains(make_point(NodeKind.SPATIAL)), _values(env, law)
    return _column(env, of, names, stated, values)


def _column(env: Env, of: str, names: str, known: dict[str, Any], values: dict[Any, Any]) -> Value:
    wanted = [n.strip() for n in names.split(",")]
    if missing := [n for n in wanted if n not in known]:
        raise AuditError(f"{of} has no strain '{missing[0]}'; it has {', '.join(known)}")
    found = np.array([[_number(known[n], values)] for n in wanted])
    return found if len(wanted) > 1 else found[0, 0]


@phrase("stress resultants {names} of {name2}", vanishes=True)
def _resultants(env: Env, names: str, of: str) -> Value:
    d, law = _derived(_class(of, env))
    return _column(env, of, names, dict(d.resultants), _values(env, law))


@phrase("energy of {name} per length")
def _energy(env: Env, of: str) -> Value:
    d, law = _derived(_class(of, env))
    return _number(d.energy, _values(env, law))


@phrase("kinetic energy of {name} per length")
def _kinetic(env: Env, of: str) -> Value:
    _, law = _derived(_class(of, env))
    return _number(law.kinetic_energy(make_point(NodeKind.SPATIAL)), _values(env, law))
