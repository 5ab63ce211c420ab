"""Outputs of a derived law: the expressions it adds to the equations, each with its target, and their derivatives.

A target says where a value belongs. Of an output: ("u", side, i) dynamics row i of a node, ("q", side, i) its kinematic row,
("g", row), ("gd", row), ("gdd", row) a constraint and its rates, ("s", j) the row of a state; of an input: the unknown itself.

The fingerprint of a law: a hash of its derived equations, the same for the same equations on any machine.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import symengine as se

from mbdae.symbolic.derived import Derived, Pair
from mbdae.symbolic.frames import Frame, NodeKind, rotation_columns_of_q
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element
from mbdae.symbolic.program import Program
from mbdae.symbolic.rebuild import substituted, symbols_of
from mbdae.symbolic.variation import Variation
from mbdae.symbolic.vectors import ZERO, Expr, Vec, rate_from_body_spin, rate_from_spatial_spin

Target = tuple[Any, ...]


def scatter_pair(f: Frame, pair: Pair, role: str = "u") -> list[tuple[Target, Expr]]:
    """Entries of a generalised force (force, moment) for the velocity unknowns of a node, v inertial and spin in body components,
    each with its target; role: the first entry of the target."""
    move, turn = pair
    n = f.kind.translations
    entries = [] if not f.kind.moves else [((role, f.side, i), move[i]) for i in range(n)]
    if f.kind is NodeKind.PLANAR:
        entries.append(((role, f.side, 2), turn[2]))
    elif f.kind.by_quaternion:
        entries += [((role, f.side, n + i), c) for i, c in enumerate(f.to_body(turn))]
    return [(target, e) for target, e in entries if e != 0]


def weighted(d: Derived, weights: list[Expr], side: str) -> Pair:
    """G^T weights on one side."""
    pairs = [row[side] for row in d.G]
    move = sum((p[0] * w for w, p in zip(weights, pairs, strict=True)), ZERO)
    return move, sum((p[1] * w for w, p in zip(weights, pairs, strict=True)), ZERO)


def covector(d: Derived, f: Frame, row_forces: list[Expr]) -> Pair:
    """Generalised force of a law on the node of one side, as on the left-hand side: G^T row_forces plus the forces that it
    states."""
    move, turn = weighted(d, row_forces, f.side) if d.rows else (ZERO, ZERO)
    stated = d.force.get(f.side, (ZERO, ZERO))
    return move + stated[0], turn + stated[1]


def dynamics(d: Derived) -> list[tuple[Target, Expr]]:
    """Terms of this law in the rows M u' + G^T lambda + ... = 0."""
    if isinstance(d.law, Element):
        return _inertia(d)
    return [entry for f in d.frames for entry in scatter_pair(f, covector(d, f, d.row_forces))]


def loads(d: Derived) -> list[tuple[Target, Expr]]:
    """- f in M u' + G^T lambda - f: the left-hand side without multipliers and accelerations."""
    if isinstance(d.law, Element):
        acceleration = dict.fromkeys(_accelerations(d.frames[0]), 0)
        return [(t, e) for t, e in ((t, e.subs(acceleration)) for t, e in _inertia(d)) if e != 0]
    return [entry for f in d.frames if f.side in d.force for entry in scatter_pair(f, d.force[f.side])]


def slopes(d: Derived) -> list[tuple[Target, Expr]]:
    """Of a law whose forces depend on its own reactions: these forces (`loads`), and their derivatives by its multipliers,
    targets ("slope", side, i, row)."""
    stated = loads(d) if d.reactive else []
    by = [(("slope", *t[1:], j), d.variation.diff(e, s)) for t, e in stated for j, s in enumerate(d.multipliers)]
    return stated + [(t, e) for t, e in ((t, d.variation.resolve(e)) for t, e in by) if e != 0]


def _accelerations(b: Frame) -> list[Expr]:
    return [se.Symbol(f"{b.side}_up{i + 1}") for i in range(b.kind.sizes[1])]


def _inertia(d: Derived) -> list[tuple[Target, Expr]]:
    """d/dt dT/dv, and d/dt dT/dOmega + Omega x dT/dOmega in body components."""
    (b,), up = d.frames, _accelerations(d.frames[0])
    momentum = [se.diff(d.energy, u) for u in _kinetic_arguments(b)]
    rate = [sum((se.diff(p, u) * a for u, a in zip(_kinetic_arguments(b), up, strict=True)), se.Integer(0)) for p in momentum]
    if b.kind is NodeKind.SPATIAL:
        gyro = b.spin.cross(Vec(*momentum[3:]))
        rate[3:] = [r + c for r, c in zip(rate[3:], gyro, strict=True)]
    return [(("u", b.side, i), e) for i, e in enumerate(rate) if e != 0]


def _kinetic_arguments(b: Frame) -> list[Expr]:
    return [*list(b.center_velocity)[:2], b.spin[2]][: b.kind.sizes[1]] if b.kind.flat else list(b.u)


def kinematics(d: Derived) -> list[tuple[Target, Expr]]:
    """q' - H(q) u of the node of an element."""
    (b,) = d.frames
    nq, n = b.kind.sizes[0], b.kind.translations
    qp = [se.Symbol(f"{b.side}_qp{i + 1}") for i in range(nq)]
    right = [*b.u[:n], *rate_from_body_spin(b.q[n:], b.spin)] if b.kind.by_quaternion else list(b.u)
    return [(("q", b.side, i), p - r) for i, (p, r) in enumerate(zip(qp, right, strict=True))]


def correction(d: Derived) -> list[tuple[Target, Expr]]:
    """- H(q) G^T mu: the stabilising correction on the kinematic rows."""
    out: list[tuple[Target, Expr]] = []
    weights = [se.Integer(0) if row in d.by_rates else mu for row, mu in zip(d.rows, d.stabilisers, strict=True)]
    for f in d.frames if d.rows else ():
        move, turn = weighted(d, weights, f.side)
        if f.kind.by_quaternion:
            n = f.kind.translations
            quaternion = rate_from_spatial_spin(f.q[n:], turn)
            out += [(("q", f.side, i), -c) for i, c in enumerate([*list(move)[:n], *quaternion]) if c != 0]
        else:
            out += [(t, -e) for t, e in scatter_pair(f, (move, turn), "q")]
    return out


def position(d: Derived) -> list[tuple[Target, Expr]]:
    """g = 0; of rows of velocities 0 = 0."""
    return [(("g", i), c) for i, c in enumerate(d.g)]


def lowest(d: Derived) -> list[tuple[Target, Expr]]:
    """The rows on the level on which they are stated: g = 0, of rows of velocities G u + g_t = 0."""
    return [(("g", i), c + v) for i, (c, v) in enumerate(zip(d.g, d.speeds, strict=True))]


def beside_velocity(d: Derived) -> list[tuple[Target, Expr]]:
    """What stands beside G u + g_t = 0: g = 0; of rows of velocities, which need no correction of positions, mu = 0."""
    mu = dict(zip(d.rows, d.stabilisers, strict=True))
    return [(("g", i), mu[row] if row in d.by_rates else c) for i, (row, c) in enumerate(zip(d.rows, d.g, strict=True))]


def velocity(d: Derived) -> list[tuple[Target, Expr]]:
    """dg/dt = G u + g_t = 0."""
    return [(("gd", i), c) for i, c in enumerate(_velocity(d))]


def scaled(d: Derived, rows: list[tuple[Target, Expr]]) -> list[tuple[Target, Expr]]:
    """Constraint rows times the scaling of their joint, as a form integrates them."""
    return [(target, d.scaled(e)) for target, e in rows]


def _velocity(d: Derived) -> list[Expr]:
    rows = []
    for row, c, G, stated in zip(d.rows, d.g, d.G, d.speeds, strict=True):
        if row in d.by_rates:
            rows.append(stated)
            continue
        total = sum((d.variation.diff(c, p) * dp for p, dp in d.variation.clock.items()), se.Integer(0))
        for f in d.frames:
            if f.kind.moves:
                total += G[f.side][0] @ f.center_velocity + G[f.side][1] @ f.w
        rows.append(d.variation.resolve(total))
    return rows


def acceleration(d: Derived) -> list[tuple[Target, Expr]]:
    """gamma = d2g/dt2 at zero accelerations (d2g/dt2 = G u' + gamma)."""
    return [(("gdd", i), d.variation.resolve(d.variation.rate(row))) for i, row in enumerate(_velocity(d))]


def second_rate(d: Derived) -> list[Expr]:
    """d2g/dt2 = G u' + gamma of every row."""
    gamma = [e for _, e in acceleration(d)]
    return [c + sum((e * _accelerations(f)[t[2]] for f in d.frames for t, e in scatter_pair(f, row[f.side])), se.Integer(0))
            for c, row in zip(gamma, d.G, strict=True)]


def jacobian_G(d: Derived) -> list[tuple[Target, Expr]]:
    """Entries of G: target ("G", row, side, column)."""
    return [(("G", i, t[1], t[2]), e) for i in range(len(d.rows)) for f in d.frames for t, e in scatter_pair(f, d.G[i][f.side])]


def reaction(d: Derived) -> list[tuple[Target, Expr]]:
    """Force and torque (about l.r) on body l, inertial components: minus the generalised force of side l."""
    if len(d.sides) < 2:  # a law on joint coordinates only: its forces are part of those joints' reactions
        return [(("reaction", i), se.Integer(0)) for i in range(6)]
    l = d.frames[1]
    side = l if l.kind.moves else d.frames[0]
    sign = -1 if side is l else 1
    pair = covector(d, side, d.reaction_forces)
    force = sign * pair[0]
    resolve = d.variation.resolve
    torque = sign * pair[1] - (l.r - side.center).cross(force) if side.kind.turns else ZERO
    return [(("reaction", i), resolve(c)) for i, c in enumerate([*force, *torque])]


def power(d: Derived) -> list[tuple[Target, Expr]]:
    """Power a law delivers to its bodies: minus its generalised force times the velocities."""
    total: Expr = se.Integer(0)
    for f in d.frames:
        move, turn = covector(d, f, d.reaction_forces)
        total -= move @ f.center_velocity + turn @ f.w
    return [(("power",), d.variation.resolve(total))]


def coordinate(d: Derived) -> list[tuple[Target, Expr]]:
    """The coordinates of a joint, ("c", name), and their rates, ("cd", name)."""
    rate, resolve = d.variation.rate, d.variation.resolve
    return [entry for name, e in d.coordinates.items() for entry in ((("c", name), e), (("cd", name), resolve(rate(e))))]


def state_rows(d: Derived) -> list[tuple[Target, Expr]]:
    """s' - rate = 0 of internal states."""
    return [(("s", j), se.Symbol(f"statep_{n}") - r) for j, (n, r) in enumerate(zip(d.states, d.state_rates, strict=True))]


def input_symbols(d: Derived) -> list[tuple[Target, Expr]]:
    """Target and symbol of every unknown on which a law may depend."""
    out: list[tuple[Target, Expr]] = []
    for f in d.frames:
        nq, nu = f.kind.sizes
        out += [(("q", f.side, i), f.q[i]) for i in range(nq)] + [(("u", f.side, i), f.u[i]) for i in range(nu)]
    if isinstance(d.law, Element):
        b = d.frames[0]
        out += [(("qp", b.side, i), se.Symbol(f"{b.side}_qp{i + 1}")) for i in range(b.kind.sizes[0])]
    for f in d.frames:
        out += [(("up", f.side, i), a) for i, a in enumerate(_accelerations(f))]
    out += [(("lambda", i), s) for i, s in enumerate(d.multipliers)] + [(("mu", i), s) for i, s in enumerate(d.stabilisers)]
    out += [(("s", j), se.Symbol(f"state_{n}")) for j, n in enumerate(d.states)]
    out += [(("sp", j), se.Symbol(f"statep_{n}")) for j, n in enumerate(d.states)]
    out += [(("foreign", j), s) for j, s in enumerate(d.feeds.foreign)]
    return out


def derivatives(d: Derived, e: Expr) -> dict[Target, Expr]:
    """Partial derivatives of an output by every unknown it depends on."""
    result: dict[Target, Expr] = {}
    for f in d.read_frames:
        if f.kind.moves:
            result |= _node_derivatives(d.variation, f, e)
    free = se.sympify(e).free_symbols
    for target, symbol in input_symbols(d):
        if target[0] == "up" and symbol not in free:  # accelerations appear directly, never in a name
            continue
        if target[0] not in ("q", "u"):
            result[target] = d.variation.diff(e, symbol)
    resolve = d.variation.resolve
    return {t: r for t, r in ((t, resolve(r)) for t, r in result.items()) if r != 0}


def _node_derivatives(v: Variation, f: Frame, e: Expr) -> dict[Target, Expr]:
    nq, nu = f.kind.sizes
    n = f.kind.translations
    move, turn = v.gradient(f, e)
    out: dict[Target, Expr] = {("q", f.side, i): move[i] for i in range(n)}
    columns = rotation_columns_of_q(f)
    for i in range(n, nq):
        out["q", f.side, i] = se.diff(e, f.q[i]) + sum((turn[a] * columns[a][i - n] for a in range(3)), se.Integer(0))
    for i in range(nu):
        out["u", f.side, i] = v.diff(e, f.u[i])
    if f.kind.by_quaternion:
        _, dw = v.velocity_gradient(f, e)
        for i, c in enumerate(f.to_body(dw)):
            out["u", f.side, n + i] += c
    return out


def insert(d: Derived, expressions: list[Expr]) -> list[Expr]:
    """The expressions with all names and symbols of frames replaced, so that they contain unknowns and parameters only."""
    table = d.variation.insertion(shared=True)
    if not expressions or not table:
        return expressions
    used = symbols_of(expressions)
    return list(se.Matrix(1, len(expressions), expressions).subs({x: table[x] for x in used if x in table}))


def fingerprint(d: Derived, rates: bool = False) -> str:
    """sha256 of the terms of a law: rows, their forces, states. rates: whether to include the rates of the rows, the coordinates
    of a joint, and the expressions that must be positive (`Joint.branches`)."""
    further, reached = _further(d) if rates else [], _reached(d)
    memo: dict[Expr, str] = {}
    parts = [f"{type(d.law).__name__} {' '.join(f.kind.value for f in d.frames)} {' '.join(d.rows)}"]
    parts += [f"{name}={canonical(value, memo)}" for name, value in d.variation.values.items() if name in reached]
    parts += [f"{target}: {canonical(e, memo)}" for target, e in [*lowest(d), *dynamics(d), *state_rows(d), *further]]
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
    outputs = [*lowest(d), *dynamics(d), *state_rows(d)]
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
