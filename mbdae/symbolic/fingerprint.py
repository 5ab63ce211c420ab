"""The fingerprint of a law: a hash of its derived equations, the same for the same equations on any machine."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import symengine as se

from mbdae.symbolic.derive import Derived
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.outputs import Target, acceleration, dynamics, position, state_rows, velocity
from mbdae.symbolic.program import Program
from mbdae.symbolic.rebuild import substituted, symbols_of
from mbdae.symbolic.vectors import Expr


def fingerprint(d: Derived, rates: bool = False) -> str:
    """sha256 of the terms of a law: rows, their forces, states. rates: whether to include the rates of the rows, the coordinates
    of a joint, and the expressions that must be positive (`Joint.branches`)."""
    further, reached = _further(d) if rates else [], _reached(d)
    memo: dict[Expr, str] = {}
    parts = [f"{type(d.law).__name__} {' '.join(f.kind.value for f in d.frames)} {' '.join(d.rows)}"]
    parts += [f"{name}={canonical(value, memo)}" for name, value in d.variation.values.items() if name in reached]
    outputs = [*position(d), *dynamics(d), *state_rows(d), *further]
    parts += [f"{target}: {canonical(e, memo)}" for target, e in outputs]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _further(d: Derived) -> list[Target]:
    """Rates of rows, coordinates, and expressions that must be positive (`Joint.branches`), in terms of the unknowns."""
    branches = {name: d.variation.name(e) for name, e in d.law.positives(*d.sides).items()} if isinstance(d.law, Joint) else {}
    stated = [*velocity(d), *acceleration(d), *d.coordinates.items(), *branches.items()]
    table = d.variation.insertion(shared=True)
    return [(("further", target), substituted(se.sympify(e), table)) for target, e in stated]


def canonical(e: Expr, memo: dict[Expr, str] | None = None) -> str:
    """A hash of an expression that does not depend on the order of its terms and factors. memo: hashes made so far."""
    memo = {} if memo is None else memo
    e = se.sympify(e)
    if e not in memo:
        args = [canonical(a, memo) for a in e.args]
        if isinstance(e, se.Add | se.Mul):
            args.sort()
        name = e.get_name() if isinstance(e, se.FunctionSymbol) else type(e).__name__
        memo[e] = hashlib.sha256(f"{name}({','.join(args)})".encode()).hexdigest()[:24] if args else str(e)
    return memo[e]


def _reached(d: Derived) -> set[Expr]:
    """Names of the intermediate results on which the outputs depend."""
    outputs = [*position(d), *dynamics(d), *state_rows(d)]
    open_, found = symbols_of(e for _, e in outputs), set()
    while open_:
        name = open_.pop()
        if name in d.variation.values and name not in found:
            found.add(name)
            open_ |= d.variation.values[name].free_symbols
    return found


def program_fingerprint(program: Program, outputs: Sequence[Expr]) -> str:
    """sha256 of some outputs of a straight-line program and of the steps on which they depend."""
    memo: dict[Expr, str] = {}
    parts = [f"{name}={canonical(program.steps[name], memo)}" for name in program.needed(outputs)]
    return hashlib.sha256("\n".join([*parts, *(canonical(e, memo) for e in outputs)]).encode()).hexdigest()
