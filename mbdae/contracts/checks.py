"""The contracts: every function measures the errors of one variant, entry by entry."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbdae.contracts.case import STEP, Case, Measured, compared, label, of_elements, rebuilt, scalars, starts, statement
from mbdae.contracts.motion import stated_motion
from mbdae.contracts.states import Values, columns, embedded, rates, rigid_velocities, rigidly_moved, rotation
from mbdae.errors import LawError
from mbdae.formulations import ggl_outputs, index3_outputs
from mbdae.kernels.plan import Outputs
from mbdae.symbolic.frames import Axes, Frame, NodeKind
from mbdae.symbolic.joint import Joint
from mbdae.symbolic.law import Element, Force
from mbdae.symbolic.outputs import acceleration, dynamics, input_symbols, position, velocity
from mbdae.system.base import Array

#: largest error that each contract allows. Most errors are relative to the largest value wanted, or absolute where that is below
#: 1; those of rows and coordinates in "motion" are absolute
BOUNDS = {
    "Jacobian": 1e-10, "compiled kernel": 1e-12, "rates": 1e-11, "virtual work": 1e-11, "action = reaction": 1e-10,
    "invariance": 1e-10, "power": 1e-11, "inertia": 1e-11, "singular states": 0.0, "planar = spatial": 1e-11, "motion": 1e-9,
}

_DERIVED = "; of a law whose functions are finite and smooth, this is an error in mbdae: please report it with the law"
#: what every contract compares, for messages
MEANS = {
    "Jacobian": f"the derivatives that solvers use, against those of the equations{_DERIVED}",
    "compiled kernel": f"the compiled equations, against NumPy{_DERIVED}",
    "rates": f"rates and accelerations of rows, against the time derivatives of the rows{_DERIVED}",
    "virtual work": f"the forces in the equations of motion, against the power of the stated forces{_DERIVED}",
    "action = reaction": "the forces and moments on all bodies, which must balance",
    "invariance": "energy, power, coordinates and rows, which a rigid motion of all bodies together must not change",
    "power": "the power of the forces, against the change of energy and the losses, which must not be negative",
    "inertia": "the power and the moment of inertia forces, against the changes of kinetic energy and angular momentum",
    "singular states": "values and derivatives as drawn, at a quarter turn and at half a turn, which must be finite; a law that "
                       'has none there says so: undefined_at returns ("points together",), ("half turn",) or both',
    "planar = spatial": f"the equations in the plane, against those in space{_DERIVED}",
    "motion": "rows, coordinates, ties and branches, against the motion that the joint states",
}


# ---- what the contracts evaluate -----------------------------------------------------------------------------------


def table(case: Case, outputs: Outputs, values: Values) -> dict[str, NDArray[Any]]:
    """Outputs (points,) by name, of a group such as `scalars` in which each output has a single word as its target."""
    out = case.evaluate(outputs, values)
    return {t[0]: out[:, i] for i, t in enumerate(case.targets(outputs))}


def covector(case: Case, values: Values) -> dict[tuple[str, int], Array]:
    """Generalised forces (points,) by side and index of the velocity."""
    out = case.evaluate(dynamics, values)
    return {(t[1], t[2]): out[:, i].real for i, t in enumerate(case.targets(dynamics))}


def power_on(case: Case, F: dict[tuple[str, int], Array], u: dict[str, Array]) -> Array:
    """Power (points,) of generalised forces F at velocities u."""
    count = len(next(iter(u.values())))
    return sum((F[side, i] * u[side][:, i] for side, i in F), np.zeros(count))


# ---- derivatives ---------------------------------------------------------------------------------------------------


def jacobian(case: Case) -> Iterator[Measured]:
    """Residual and Jacobian of GGL, composed as the assembly does; the outputs of Index3 must be among those of GGL."""
    d, split, unknowns = case.d, case.linearised, input_symbols(case.d)
    others = [*ggl_outputs(d), *((("g", t[1]), e) for t, e in ggl_outputs(d) if t[0] == "gd")]  # rows of velocities are "g" there
    missing = [label(d, t) for t, e in index3_outputs(d) if (t, e) not in others]
    yield from ((f"{name}, in Index3 but not in GGL", 1.0) for name in missing)
    if not split.targets:
        return
    index = {target: j for j, (target, _) in enumerate(unknowns)}
    residual, J = rebuilt(case, case.values, index)
    names = [label(d, t) for t in split.targets]
    yield from compared([f"value of {n}" for n in names], residual, case.evaluate(ggl_outputs, case.values).real)
    count = len(residual)
    stepped = {name: np.tile(value.astype(complex), len(unknowns)) for name, value in case.values.items()}
    for j, (_, symbol) in enumerate(unknowns):
        stepped[str(symbol)][j * count : (j + 1) * count] += 1j * STEP
    slopes = case.evaluate(ggl_outputs, stepped).imag / STEP
    slopes = np.moveaxis(slopes.reshape(len(unknowns), count, -1), 0, 2)
    places = [f"derivative of {n} by {t[0]} {label(d, t)}" for n in names for t in index]
    yield from compared(places, J.reshape(count, -1), slopes.reshape(count, -1))


def compiled(case: Case) -> Iterator[Measured]:
    """The compiled code against NumPy for all outputs of the law."""
    p = case.all_outputs
    if not (case.compiles and p.targets):
        return
    x = columns(p.all_inputs.symbols, case.values)
    yield from compared([label(case.d, t) for t in p.targets], p.kernel.values(x), p.kernel.oracle(x).real)


def rates_of_rows(case: Case) -> Iterator[Measured]:
    """G u + g_t against dg/dt, gamma against d(G u + g_t)/dt."""
    for lower, upper in ((position, velocity), (velocity, acceleration)):
        some = [i for i, row in enumerate(case.d.rows) if upper is acceleration or row not in case.d.by_rates]
        names = [label(case.d, case.targets(upper)[i]) for i in some]
        got, wanted = case.evaluate(upper, case.values).real, case.slope(lower, case.u, clock=True)
        yield from compared(names, got[:, some], wanted[:, some])


# ---- forces --------------------------------------------------------------------------------------------------------


def virtual_work(case: Case) -> Iterator[Measured]:
    """Every entry of the generalised forces against the power of the stated forces on a unit velocity."""
    d, F = case.d, covector(case, case.values)
    if isinstance(d.law, Element):
        return
    stated = {n: c.real for n, c in table(case, statement, case.values).items()}
    lam = _row_forces(case)
    for f in d.frames:
        for i in range(f.kind.sizes[1]):
            unit = {side: np.zeros_like(u) for side, u in case.u.items()}
            unit[f.side][:, i] = 1.0
            expected = np.sum(lam * case.row_slope(unit), axis=1) if d.rows else np.zeros(len(lam))
            if stated:
                expected = expected + _stated_power(case, stated, f, i, unit)
            got = F.get((f.side, i), np.zeros(len(expected)))
            yield from compared([label(d, ("u", f.side, i))], got[:, None], expected[:, None])


def _row_forces(case: Case) -> Array:
    """(points, rows) generalised forces on the rows c: the multipliers lambda, or scaling lambda + 2 penalty c for a joint with
    these parameters."""
    d, values = case.d, case.values
    lam = columns(d.multipliers, values)
    if getattr(d.law, "scaling", None) is not None:
        lam = lam * values["scaling"][:, None]
    if getattr(d.law, "penalty", None) is not None:
        lam = lam + 2 * values["penalty"][:, None] * case.evaluate(position, values).real
    return lam


def _stated_power(case: Case, stated: dict[str, Array], f: Frame, i: int, unit: dict[str, Array]) -> Array:
    """dV + dR/du - wrench - thrust (points,): the power of the stated forces on velocity number i of the frame f, with `unit`
    these unit velocities by side and `stated` the outputs of `statement`."""
    symbol = str(f.u[i])
    names = [t[0] for t in case.targets(statement)]
    slopes = case.slope(statement, unit)
    dV, along = slopes[:, names.index("V")], slopes[:, names.index("along")]
    shifted = case.values | {symbol: case.values[symbol] + 1j * STEP}
    dR = case.evaluate(statement, shifted).imag[:, names.index("R")] / STEP
    drawn_by = dV + dR - stated["push"] * along
    if f.side not in ("k", "l"):
        return np.asarray(drawn_by)
    force, torque, point = (np.stack([stated[a + b] for b in "xyz"], axis=-1) for a in "FMr")
    n = f.kind.translations
    center, move, spin = np.zeros_like(point), np.zeros_like(point), np.zeros_like(point)
    center[:, :n] = np.stack([case.values[str(s)] for s in f.q[:n]], axis=-1)
    move[:, :n] = unit[f.side][:, :n]
    if f.kind.turns:
        turning = unit[f.side][:, n:]
        spin = turning * [0, 0, 1] if f.kind.flat else np.einsum("pij,pj->pi", rotation(f, case.values), turning)
    at_point = move + np.cross(spin, point - center)
    sign = 1 if f.side == "l" else -1
    return np.asarray(drawn_by - sign * (np.sum(force * at_point, axis=1) + np.sum(torque * spin, axis=1)))


def reciprocity(case: Case) -> Iterator[Measured]:
    """No power on a common rigid motion of all sides: forces and moments balance."""
    d = case.d
    if isinstance(d.law, Element) or not all(f.kind.moves for f in d.frames):
        return
    values = case.on_manifold if isinstance(d.law, Joint) else case.values
    F = covector(case, values)
    size = max((float(np.max(np.abs(c))) for c in F.values()), default=0.0)
    for direction, name in enumerate(("force x", "force y", "force z", "moment x", "moment y", "moment z")):
        if not d.frames[0].kind.flat or direction in (0, 1, 5):
            yield name, float(np.max(np.abs(power_on(case, F, rigid_velocities(d, values, direction))))) / max(1.0, size)


def invariance(case: Case) -> Iterator[Measured]:
    """Energy, powers and coordinate under a common rigid motion; rows of joints stay zero."""
    d = case.d
    if isinstance(d.law, Element) or not all(f.kind.moves for f in d.frames):
        return
    values = case.on_manifold if isinstance(d.law, Joint) else case.values
    other = rigidly_moved(d, values, np.random.default_rng(30))
    if d.reactive and d.rows:
        other |= _moved_multipliers(case, values)
    before, after = (table(case, scalars, v) for v in (values, other))
    for name, value in before.items():
        at = _same_sense(case, values) if name.startswith("coordinate") else np.ones(len(value), dtype=bool)
        yield from compared([name], after[name].real[at, None], value.real[at, None])
    names = [label(d, t) for t in case.targets(position)]
    yield from compared(names, case.evaluate(position, other).real, case.evaluate(position, values).real)


def _same_sense(case: Case, values: Values) -> NDArray[np.bool_]:
    """(points,) whether the axes k.z and l.z do not point against each other, where a relative angle is not defined."""
    k, l = (np.einsum("pij,jp->pi", rotation(f, values), [values[f"{f.side}_Qz{i}"] for i in (1, 2, 3)]) for f in case.d.sides)
    return np.asarray(np.sum(k * l, axis=1) > -0.999)


def _moved_multipliers(case: Case, values: Values) -> Values:
    """The multipliers with which the reactions have the same power after the rigid motion of `invariance` as before. They change
    with it where rows are components along inertial axes."""
    d, m = case.d, len(case.d.rows)
    many = {name: np.tile(value, m) for name, value in values.items()}
    many |= {str(s): case.rng.normal(size=many[str(s)].shape) for f in d.frames for s in f.u}
    speeds = []  # rates of the rows due to as many random velocities, (points, velocities, rows), before and after
    for state in (many, rigidly_moved(d, many, np.random.default_rng(30))):
        still = state | {str(s): np.zeros_like(state[str(s)]) for f in d.frames for s in f.u}
        moving = case.evaluate(velocity, state).real - case.evaluate(velocity, still).real
        speeds.append(moving.reshape(m, -1, m).transpose(1, 0, 2))
    moved_ = np.linalg.solve(speeds[1], speeds[0] @ columns(d.multipliers, values)[..., None])[..., 0]
    return {str(s): moved_[:, i] for i, s in enumerate(d.multipliers)}


def power(case: Case) -> Iterator[Measured]:
    """Generalised forces . velocity = dV/dt + dissipated - work (joints: and the power of their rows); dissipated power is not
    negative."""
    d = case.d
    if not (isinstance(d.law, Force) or d.reactive):
        return
    parts = {n: c.real for n, c in table(case, scalars, case.values).items()}
    got = power_on(case, covector(case, case.values), case.u)
    zero = np.zeros(len(got))
    names = [t[0] for t in case.targets(scalars)]
    dV = case.slope(scalars, case.u, clock=True)[:, names.index("energy")] if "energy" in names else zero
    expected = dV + parts.get("dissipated", zero) - parts.get("work", zero)
    if d.rows:
        expected = expected + np.sum(_row_forces(case) * case.row_slope(case.u), axis=1)
    yield from compared(["balance"], got[:, None], expected[:, None])
    dissipated = parts.get("dissipated", zero)
    if "losses" in parts:  # losses by cause must add up to the dissipated power, which fails if a loss uses a wrong velocity
        yield from compared(["losses by cause"], parts["losses"][:, None], dissipated[:, None])
    if d.states:  # a state may hold energy and give it back
        return
    negative = float(max(0.0, -np.min(dissipated)))
    yield "dissipated power, which is negative,", negative / max(1.0, float(np.max(np.abs(dissipated))))


def inertia(case: Case) -> Iterator[Measured]:
    """Kinematic rows vanish for q' = H u; power of inertia is dT/dt; angular momentum balances."""
    d = case.d
    if not isinstance(d.law, Element):
        return
    (b,), u = d.frames, columns(d.frames[0].u, case.values)
    qp = rates(b, case.values, u)
    values = case.values | {f"{b.side}_qp{i + 1}": qp[:, i] for i in range(qp.shape[1])}
    rows = case.evaluate(of_elements, values).real
    yield from compared([label(d, t) for t in case.targets(of_elements)], rows, np.zeros_like(rows))
    up = np.stack([values[f"{b.side}_up{i + 1}"] for i in range(u.shape[1])], axis=-1)
    F = covector(case, values)
    stepped = values | {str(s): u[:, i] + 1j * STEP * up[:, i] for i, s in enumerate(b.u)}
    dT = case.evaluate(scalars, stepped).imag.sum(axis=1) / STEP  # one term, the kinetic energy, or none without mass
    yield from compared(["dT/dt"], power_on(case, F, {b.side: u})[:, None], dT[:, None])
    if b.kind is NodeKind.SPATIAL:
        L, L_dot = (_angular_momentum(case, values, b, w) for w in (u, up))
        got = np.stack([F.get((b.side, 3 + i), np.zeros(len(u))) for i in range(3)], axis=-1)
        yield from compared([f"moment {a}" for a in "xyz"], got, L_dot + np.cross(u[:, 3:], L))


def _angular_momentum(case: Case, values: Values, b: Frame, u: Array) -> Array:
    """dT/dOmega (points, 3) at velocities u, body components."""
    at = values | {str(s): u[:, i] for i, s in enumerate(b.u)}
    columns_ = [case.evaluate(scalars, at | {str(s): at[str(s)] + 1j * STEP}).imag.sum(axis=1) / STEP for s in b.u[3:]]
    return np.stack(columns_, axis=-1)


# ---- special states ------------------------------------------------------------------------------------------------


def singular(case: Case) -> Iterator[Measured]:
    """Finite values and derivatives as drawn, at a quarter turn and at half a turn; error inf where they are not."""
    split = case.linearised
    if isinstance(case.d.law, Element) or not split.targets:
        return
    excluded = case.d.law.undefined_at()
    for name, angle in (("as drawn", 0.0), ("quarter turn", np.pi / 2), ("half turn", np.pi), ("half turn back", -np.pi)):
        if "half turn" in excluded and abs(angle) == np.pi:
            continue
        together = "points together" not in excluded
        values = case.states.special(angle, together)
        state = f'{name}{", the points of both sides together" * together}'
        with np.errstate(all="ignore"):
            for kernel, inputs in ((split.residual, split.residual_inputs), (split.jacobian, split.jacobian_inputs)):
                if kernel.expressions:
                    finite = np.isfinite(case.run(kernel, columns(inputs.symbols, values)))
                    what = "values" if kernel is split.residual else "derivatives"
                    yield f"{what} {state}", 0.0 if finite.all() else np.inf


def planar(case: Case) -> Iterator[Measured]:
    """The planar variant against the spatial one in a planar state."""
    d = case.d
    if not any(f.kind.flat for f in d.frames) or (d.frames[0].axes is Axes.IN_PLANE and not isinstance(d.law, Joint)):
        return
    kinds = {NodeKind.PLANAR: NodeKind.SPATIAL, NodeKind.PLANAR_POINT: NodeKind.POINT, NodeKind.PLANAR_GROUND: NodeKind.GROUND}
    try:
        other = case.variant(tuple((kinds.get(f.kind, f.kind), Axes.GENERAL) for f in d.frames))
    except LawError:  # the law exists in the plane only; `SelfTest.refused` has the reason
        return
    values = embedded(d, case.values, other.d)
    states = {f"state_{name}": start.real for name, start in table(other, starts, values).items()}
    own, values = case.values | states, values | states
    mine, full = covector(case, own), covector(other, values)
    for f, s in zip(d.frames, other.d.frames, strict=True):
        for i in range(s.kind.sizes[1]):
            at = {0: 0, 1: 1, 5: 2}.get(i)
            zero = np.zeros(len(next(iter(values.values()))))
            if at is not None:
                got, want = mine.get((f.side, at), zero), full.get((s.side, i), zero)
                yield from compared([label(d, ("u", f.side, at))], got[:, None], want[:, None])
    for outputs in (position, velocity, acceleration):
        got, want = case.evaluate(outputs, own), other.evaluate(outputs, values)
        order = [other.d.rows.index(row) for row in d.rows]
        yield from compared([f"{outputs.__name__} '{row}'" for row in d.rows], got.real, want.real[:, order])
    a, b = table(case, scalars, own), table(other, scalars, values)
    for name in a.keys() & b.keys():
        difference = a[name].real - b[name].real
        if name.startswith("coordinate") and d.law.coordinates[name.partition(" ")[2]].unit == "rad":
            difference -= 2 * np.pi * np.round(difference / (2 * np.pi))
        yield from compared([name], difference[:, None], 0 * difference[:, None])


CONTRACTS: dict[str, Callable[[Case], Iterator[Measured]]] = {
    "Jacobian": jacobian, "compiled kernel": compiled, "rates": rates_of_rows, "virtual work": virtual_work,
    "action = reaction": reciprocity, "invariance": invariance, "power": power, "inertia": inertia,
    "singular states": singular, "planar = spatial": planar, "motion": stated_motion,
}
