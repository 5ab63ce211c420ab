"""Checks of the formulas of a recursive joint: with its rows, with the compiled program of a tree, by complex steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.kernels.plan import plan
from mbdae.kernels.tree_plan import Piece, tree_plan
from mbdae.reports.common import Check
from mbdae.reports.coordinates import pose_of
from mbdae.reports.reduction import Reduction, ReductionValues
from mbdae.reports.states import POINTS, STEP, State, random_state, residual
from mbdae.reports.vectors import Base
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.outputs import acceleration, jacobian_G, position, velocity
from mbdae.symbolic.tree_structure import Link, TreeStructure
from mbdae.system.model.rotations import quaternion, rotation_matrices


def reduction_checks(r: Reduction) -> list[Check]:
    """All checks of one joint."""
    case = _OnMotion(r)
    return [*_rows(case), *_tree(case), *_transformed(case)]


class _OnMotion:
    """Random states with l on the motion of the joint, velocities too."""

    def __init__(self, r: Reduction) -> None:
        self.r = r
        free = random_state(r.s.derived, seed=4)
        self.state = self._placed(free)
        self.rng = np.random.default_rng(5)
        self.w = np.concatenate([self.vector("w_center"), self.vector("w"), self.rates], axis=1)
        k, l = (self.state.frame(side) for side in "kl")
        self.Rk, self.Rl = (np.stack([self.state.vector(c) for c in f.body], axis=-1) for f in (k, l))
        omega = self.w[:, 3:6] + np.einsum("pc,pcj->pj", self.w[:, 6:], self.turns(self.at()))
        speeds = np.einsum("pij,pj->pi", self.at({Base("w", "l"): omega}).B, self.w)
        spin = np.einsum("pji,pj->pi", self.Rl, speeds[:, 3:])
        given = self.state.given | {f"l_v{i + 1}": speeds[:, i] for i in range(3)} | {f"l_W{i + 1}": spin[:, i] for i in range(3)}
        self.state = State(self.state.d, given)

    def vector(self, what: str) -> Any:
        """Velocity of the centre of k, or its angular velocity."""
        f = self.state.frame("k")
        return self.state.vector(f.center_velocity if what == "w_center" else f.w)

    @property
    def rates(self) -> Any:
        """Rates of the coordinates (points, n)."""
        return np.stack([self.state.given[str(c.rate)] for c in self.r.columns], -1) if self.r.columns else np.zeros((POINTS, 0))

    def turns(self, values: ReductionValues) -> Any:
        """(points, columns, 3)."""
        return np.stack([values.vector(c.turn) for c in self.r.columns], 1) if self.r.columns else np.zeros((POINTS, 0, 3))

    def _placed(self, st: State) -> State:
        """The state with l where the motion takes it."""
        moved, axes = pose_of(self.r.s, self.r.motion)
        n = self.r.formulas.numbers(st)
        A = np.stack([np.broadcast_to(n.vector(a), (POINTS, 3)) for a in axes], axis=-1)  # type: ignore[arg-type]
        Q = np.stack([np.stack([st.given[f"l_Q{a}{i}"] for i in (1, 2, 3)], -1) for a in "xyz"], -1)
        R = A @ Q.transpose(0, 2, 1)
        P = np.array([quaternion(one) for one in R])
        arm = np.einsum("pij,pj->pi", R, np.stack([st.given[f"l_p{i}"] for i in (1, 2, 3)], -1))
        centre = st.atom(Base("r", "k")) + n.vector(moved) - arm
        given = {f"l_r{i + 1}": centre[:, i] for i in range(3)} | {f"l_P{i + 1}": P[:, i] for i in range(4)}
        return State(st.d, st.given | given)

    def at(self, known: Any = None, state: State | None = None) -> ReductionValues:
        """The map in a state, by default that on the motion."""
        return self.r.at(state or self.state, known)


def _rows(case: _OnMotion) -> list[Check]:
    """The rows of the joint and their rates vanish on the motion; the second rates with the accelerations it gives to l."""
    d, st = case.r.s.derived, case.state
    p = plan(d, lambda d: [*position(d), *velocity(d), *acceleration(d), *jacobian_G(d)])
    if not d.rows:
        return []
    x = np.stack([st.given[str(symbol)] for symbol in p.all_inputs.symbols], axis=-1)
    found = dict(zip(p.targets, p.kernel.values(x).T, strict=True))
    prescribed = {i for i, row in enumerate(d.rows) if row in d.law.drives()}
    bias = case.at().bias
    change = np.concatenate([bias[:, :3], np.einsum("pji,pj->pi", case.Rl, bias[:, 3:])], axis=1)
    out = []
    for head, what in (("g", "rows"), ("gd", "rates of the rows"), ("gdd", "second rates of the rows")):
        worst = 0.0
        for i in set(range(len(d.rows))) - prescribed:
            value = found.get((head, i), np.zeros(POINTS))
            if head == "gdd":
                value = value + sum(found.get(("G", i, "l", j), 0.0) * change[:, j] for j in range(6))
            worst = max(worst, residual(value, np.zeros(POINTS)))
        out.append(Check(f"{what} of the joint vanish on its motion", worst))
    return out


def _tree(case: _OnMotion) -> list[Check]:
    """Position, velocity and acceleration of l, and the transformed residual, with the compiled program of a tree k, l."""
    r, st, rng = case.r, case.state, case.rng
    law: Any = r.s.cls
    of_side = [*("p1", "p2", "p3"), *(f"Q{a}{i}" for a in "xyz" for i in (1, 2, 3)), *(f"P{i}" for i in range(4))]
    numbers = [f"{side}_{name}" for side in "kl" for name in of_side]
    quaternions = {f"{side}_P{i}" for side in "kl" for i in range(4)}
    numbers += [name for name in law.params if name not in r.s.law.derived() and name not in r.s.structure.absent]
    names, axes = tuple(law.coordinates), (Axes.GENERAL, Axes.GENERAL)
    link = Link(law, r.s.structure, 0, "k", NodeKind.SPATIAL, axes, tuple((n, None) for n in numbers), True, names,
                (False,) * len(names), 1)  # fmt: skip
    tree = tree_plan(TreeStructure(NodeKind.SPATIAL, (link,), (), (1,)))
    up, load = rng.normal(size=(POINTS, 6 + len(r.columns))), rng.normal(size=(POINTS, 6))
    sides = [f.side for f in st.d.frames[2:]]
    starts = np.cumsum([0, *(3 if side in r.s.turning.values() else 1 for side in sides)])

    def value(place: tuple[Any, ...]) -> Any:
        head, j, i = place
        if head == "number":
            return _axes_quaternion(st, i[0])[:, int(i[3])] if i in quaternions else st.given[i]
        if head in ("wu", "wq"):
            return load[:, i] if head == "wu" else 0.0
        f = st.d.frames[0 if j == 0 else 1 - j]
        if head == "up":
            return up[:, i if j == 0 else 6 + starts[-j - 1] + i]
        return st.given[str((f.q if head == "q" else f.u)[i])]

    def run(piece: Piece) -> dict[Any, Any]:
        x = np.stack([np.broadcast_to(value(place), (POINTS,)) for place in piece.inputs], axis=-1)
        return dict(zip(piece.targets, piece.kernel.values(x).T, strict=True))

    forward, rows = run(tree.forward), run(tree.residual)
    q, u, a = (np.stack([forward[head, 1, i] for i in range(n)], -1) for head, n in (("q", 7), ("u", 6), ("up", 6)))
    values, spins = case.at(), (slice(0, 3), slice(3, 6))
    inertial = np.concatenate([up[:, :3], np.einsum("pij,pj->pi", case.Rk, up[:, spins[1]]), up[:, 6:]], axis=1)
    wanted = [np.concatenate([b[:, :3], np.einsum("pij,pj->pi", case.Rl, b[:, 3:])], axis=1) for b in (u, a, load)]
    B = values.B
    rb = np.einsum("pji,pj->pi", B, wanted[2])
    rb[:, 3:6] = np.einsum("pji,pj->pi", case.Rk, rb[:, 3:6])
    places = [(0, i) for i in range(6)] + [(-1 - n, i) for n in range(len(sides)) for i in range(starts[n + 1] - starts[n])]
    got = np.stack([np.broadcast_to(rows.get(("u", *place), 0.0), (POINTS,)) for place in places], -1)
    centre = st.vector(st.frame("l").center)
    by = "with the compiled program of a tree"
    return [
        Check(f"position of l, {by}", residual(centre, q[:, :3])),
        Check(f"attitude of l, {by}", residual(case.Rl, rotation_matrices(q[:, 3:]))),
        Check(f"velocities of l by the reduction map, {by}", residual(np.einsum("pij,pj->pi", B, case.w), wanted[0])),
        Check(f"accelerations of l, {by}", residual(np.einsum("pij,pj->pi", B, inertial) + values.bias, wanted[1])),
        Check(f"transformed residual, {by}", residual(rb, got)),
    ]


def _axes_quaternion(st: State, side: str) -> Any:
    """Quaternions (points, 4) of the joint's axes on a body."""
    Q = np.stack([np.stack([st.given[f"{side}_Q{a}{i}"] for i in (1, 2, 3)], -1) for a in "xyz"], -1)
    return np.array([quaternion(one) for one in Q])


def _transformed(case: _OnMotion) -> list[Check]:
    """Mass, damping and stiffness of a random residual at l, by complex step through the finite motion, against the formulas."""
    linear = _Linear(case)
    worst = np.max([linear.errors(e) for e in np.eye(6 + len(case.r.columns))], axis=0)
    names = ("transformed damping", "transformed stiffness with its geometric rows", "transformed mass")
    return [Check(f"{name}, with a complex step through the motion", float(e)) for name, e in zip(names, worst, strict=True)]


class _Linear:
    """A linear residual r = M a + C v + K x + r0 at l, transformed by the joint."""

    def __init__(self, case: _OnMotion) -> None:
        self.case, self.r = case, case.r
        rng, n = case.rng, 6 + len(case.r.columns)
        self.M, self.C, self.K = rng.normal(size=(3, POINTS, 6, 6))
        self.r0, self.wp = rng.normal(size=(POINTS, 6)), rng.normal(size=(POINTS, n))
        self.base = self._values(case.state, case.w)

    def _values(self, state: State, w: Any) -> ReductionValues:
        """The map at velocities w of the unknowns."""
        given = state.given | {str(c.rate): w[:, 6 + i] for i, c in enumerate(self.r.columns)}
        st = State(state.d, given)
        plain = self.case.at({Base("w", "k"): w[:, 3:6]}, st)
        omega = w[:, 3:6] + np.einsum("pc,pcj->pj", w[:, 6:], self.case.turns(plain))
        spins = {side: np.einsum("pij,pj->pi", np.stack([st.vector(c) for c in st.frame(side).body], -1), self._own(w, side))
                 for side in self.r.s.turning.values()}  # fmt: skip
        known = {Base("w", side): spin for side, spin in ({"k": w[:, 3:6], "l": omega} | spins).items()}
        return self.case.at(known, st)

    def _own(self, w: Any, side: str) -> Any:
        """Rates of a free rotation."""
        at = [i for i, c in enumerate(self.r.columns) if str(c.rate).startswith(f"{side}_W")]
        return w[:, 6 + at[0] : 9 + at[0]]

    def _moved(self, e: Any) -> tuple[State, dict[str, Any]]:
        """The state after an imaginary virtual displacement e of the unknowns, and that displacement by symbols of vectors."""
        case, s = self.case, self.r.s
        points = np.broadcast_to(e, (POINTS, len(e)))
        psi = points[:, 3:6]
        turn = psi + np.einsum("pc,pcj->pj", points[:, 6:], case.turns(self.base))
        centre = np.einsum("pij,pj->pi", self.base.B, points)[:, :3]
        move = {"k": (points[:, :3] + np.cross(psi, case.state.atom(Base("s", "k"))), psi),
                "l": (centre + np.cross(turn, case.state.atom(Base("s", "l"))), turn)}  # fmt: skip
        for side in s.turning.values():
            R = np.stack([case.state.vector(c) for c in case.state.frame(side).body], -1)
            move[side] = (0 * psi, np.einsum("pij,pj->pi", R, self._own(points, side)))
        scalars = {str(c): points[:, 6 + i] for i, column in enumerate(self.r.columns)
                   for c, dc in s.virtual.items() if dc == column.change}  # fmt: skip
        changed = case.state.changed(1j * STEP, move, scalars)
        virtual: dict[Any, Any] = {}
        for side, parts in move.items():
            virtual |= {Base("du", side): parts[0], Base("dpsi", side): parts[1]}
        return changed, virtual | {str(s.virtual[c]): scalars[str(c)] for c in s.virtual if str(c) in scalars}

    def _residual(self, values: ReductionValues, w: Any, wp: Any, x: Any) -> tuple[Any, Any]:
        """(B^T r, r) at velocities and accelerations of the unknowns and displacements x of l."""
        B = values.B
        a, v = _times(B, wp) + values.bias, _times(B, w)
        r = _times(self.M, a) + _times(self.C, v) + _times(self.K, x) + self.r0
        return _times(B.transpose(0, 2, 1), r), r

    def errors(self, e: Any) -> Any:
        """Relative errors of damping, stiffness and mass along one unknown."""
        case, w, still = self.case, self.case.w, np.zeros((POINTS, 6))
        step = 1j * STEP * e
        B, BT = self.base.B, self.base.B.transpose(0, 2, 1)
        _, r = self._residual(self.base, w, self.wp, still)
        changed, virtual = self._moved(e)
        x = _times(B, np.broadcast_to(e, w.shape))
        faster = self._values(case.state, w + step)
        wanted = [
            self._residual(faster, w + step, self.wp, still)[0],
            self._residual(self._values(changed, w), w, self.wp, 1j * STEP * x)[0],
            self._residual(self.base, w, self.wp + step, still)[0],
        ]
        atoms = {base: value for base, value in virtual.items() if isinstance(base, Base)}
        given = self.base.state.given | {name: value for name, value in virtual.items() if isinstance(name, str)}
        dB = case.at(atoms, State(case.state.d, given)).changes
        dbias = np.imag(self._values(changed, w).bias) / STEP
        geometric = _times(dB.transpose(0, 2, 1), r)
        formulas = [
            _times(BT, _times(self.C, x) + _times(self.M, np.imag(faster.bias) / STEP)),
            _times(BT, _times(self.K, x) + _times(self.C, _times(dB, w)) + _times(self.M, _times(dB, self.wp) + dbias))
            + geometric,
            _times(BT, _times(self.M, x)),
        ]
        return [residual(f, np.imag(c) / STEP) for f, c in zip(formulas, wanted, strict=True)]


def _times(A: Any, x: Any) -> Any:
    """Products of matrices (points, m, n) and vectors (points, n)."""
    return np.einsum("pij,pj->pi", A, x)
