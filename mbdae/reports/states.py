"""Values of recorded formulas at random states of motion, where they are compared with the integrated equations."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.reports.reading import Summed
from mbdae.reports.vectors import Atom, Base, NamedQuantities, NamedVector, Vector
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.frames import Axes, Frame, NodeKind, axes_pattern
from mbdae.symbolic.rebuild import complex_atan2
from mbdae.symbolic.vectors import Expr, Vec
from mbdae.system.model.nodes import quaternion, rotation_matrices, turned

POINTS = 20  #: number of random states in every check that states no other number
STEP = 1e-30  #: size of the complex step
_RELATIONS = {"LessThan": np.less_equal, "StrictLessThan": np.less, "Equality": np.equal, "Unequality": np.not_equal}
Array = NDArray[Any]
Values = dict[str, NDArray[Any]]


def value(e: Expr, get: Callable[[Expr], Any]) -> Any:
    """Value of a scalar, real or complex; `get` returns the values of symbols."""
    if isinstance(e, se.Symbol):
        return get(e)
    if e.is_Number or e == se.pi or e == se.E:
        return float(e)
    if isinstance(e, se.Piecewise):
        return _chosen(e, get)
    a = [value(x, get) for x in e.args]
    if isinstance(e, se.Add):
        return sum(a[1:], a[0])
    if isinstance(e, se.Mul):
        out = a[0]
        for factor in a[1:]:
            out = out * factor
        return out
    if isinstance(e, se.Pow):
        base = a[0]
        exponent = a[1]
        if isinstance(exponent, float) and exponent == int(exponent):
            return base ** int(exponent) if exponent > 0 else 1.0 / base ** int(-exponent)
        return base**exponent
    name = e.get_name() if isinstance(e, se.FunctionSymbol) else type(e).__name__
    if name in ("let", "UnevaluatedExpr"):
        return a[0]
    if name in _RELATIONS:
        return _RELATIONS[name](np.real(a[0]), np.real(a[1]))
    if name == "floor":
        return np.floor(np.real(a[0]))
    if name == "atan2":
        return complex_atan2(a[0], a[1])
    return getattr(np, {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}.get(name, name))(*a)


def _chosen(e: Expr, get: Callable[[Expr], Any]) -> Any:
    """Value of a Piecewise; a case whose condition is false may be undefined."""
    conditions, values = [], []
    with np.errstate(all="ignore"):
        for result, condition in zip(e.args[::2], e.args[1::2], strict=True):
            conditions.append(True if str(condition) == "True" else value(condition, get))
            values.append(value(result, get))
        shape = np.broadcast_shapes(*(np.shape(x) for x in (*conditions, *values)))
        return np.select([np.broadcast_to(c, shape) for c in conditions], [np.broadcast_to(v, shape) for v in values])


class FormulaValues:
    """Values of a record's formulas at many states at once, from those of atoms (points, 3) and symbols (points,)."""

    def __init__(self, record: NamedQuantities, atoms: Callable[[Base], NDArray[Any]], symbols: Callable[[str], Any]) -> None:
        self.record, self.atoms, self.symbols = record, atoms, symbols
        self._known: dict[Any, Any] = {}

    def scalar(self, e: Expr) -> Any:
        """Value of a scalar (points,)."""
        return value(se.sympify(e), self._symbol)

    def _symbol(self, symbol: Expr) -> Any:
        if symbol not in self._known:
            if symbol in self.record.dots:
                a, b = (self.atom(x) for x in self.record.dots[symbol])
                self._known[symbol] = np.sum(a * b, axis=-1)
            elif symbol in self.record.scalars:
                self._known[symbol] = self.scalar(self.record.scalars[symbol])
            else:
                self._known[symbol] = self.symbols(str(symbol))
        return self._known[symbol]

    def atom(self, atom: Atom) -> NDArray[Any]:
        """Value of an atom (points, 3)."""
        if atom not in self._known:
            if isinstance(atom, Base):
                axis = atom.kind == "E"
                self._known[atom] = np.eye(3)["xyz".index(atom.side)] if axis else self.atoms(atom)
            elif isinstance(atom, NamedVector):
                self._known[atom] = self.vector(self.record.vectors[atom.number])
            else:
                self._known[atom] = np.cross(self.atom(atom.left), self.atom(atom.right))
        found: NDArray[Any] = self._known[atom]
        return found

    def vector(self, a: Vector) -> NDArray[Any]:
        """Value of a vector (points, 3)."""
        total: NDArray[Any] = np.zeros(3)
        for atom, c in a.terms.items():
            total = total + np.asarray(self.scalar(c))[..., None] * self.atom(atom)
        return total


class SymbolValues:
    """Values of all symbols of a derived law at several states."""

    def __init__(self, d: Derived, given: Values) -> None:
        self.d, self.given = d, given
        self._known: dict[Expr, Any] = {}
        self._axes: dict[str, NDArray[Any]] = {}
        self._meaning = {s: e for f in d.frames for table in (f.structure, f.meaning) for s, e in table.items()}

    def get(self, symbol: Expr) -> Any:
        """Value of a symbol: given directly, or computed from its definition."""
        if symbol not in self._known:
            name = str(symbol)
            if name in self.given:
                self._known[symbol] = self.given[name]
            else:
                self._known[symbol] = value(se.sympify(self._stated(symbol)), self.get)
        return self._known[symbol]

    def _stated(self, symbol: Expr) -> Expr:
        """Definition of a symbol: of a frame, or of an intermediate quantity that the derivation has named so far."""
        values = self.d.variation.values
        return values[symbol] if symbol in values else self._meaning[symbol]

    def symbol(self, name: str) -> Any:
        """Value of a symbol by its name."""
        return self.get(se.Symbol(name))

    def scalar(self, e: Expr) -> Any:
        """Values of a derived expression (points,)."""
        return np.broadcast_to(value(se.sympify(e), self.get), (self.points,))

    def vector(self, a: Vec) -> NDArray[Any]:
        """Values of a derived vector (points, 3)."""
        return np.stack([self.scalar(c) for c in a.c], axis=-1)

    @property
    def points(self) -> int:
        """Number of states."""
        return len(next(iter(self.given.values())))

    def axes_quaternion(self, side: str) -> NDArray[Any]:
        """Quaternions (points, 4) of the axes of a law on a body."""
        if side not in self._axes:
            columns = [[self.given[f"{side}_Q{a}{i}"] for a in "xyz"] for i in (1, 2, 3)]
            self._axes[side] = quaternion(np.moveaxis(np.array(columns), -1, 0))
        return self._axes[side]

    def frame(self, side: str) -> Frame:
        """The frame of a side."""
        return next(f for f in self.d.frames if f.side == side)

    def atom(self, base: Base) -> NDArray[Any]:
        """Values of a vector of a frame (points, 3)."""
        if base.kind in ("du", "dpsi"):
            return np.stack([self.given[f"{base.kind}_{base.side}{i}"] for i in range(3)], axis=-1)
        f = self.frame(base.side)
        vectors = {"r": f.r, "s": f.arm, "c": f.center, "x": f.x, "y": f.y, "z": f.z, "v": f.v, "w": f.w,
                   "bx": f.body[0], "by": f.body[1], "bz": f.body[2]}
        return self.vector(vectors[base.kind])

    def changed(self, step: complex, motion: dict[str, tuple[Any, Any]], symbols: dict[str, Any] | None = None) -> SymbolValues:
        """State after `step` times a change. motion: side -> displacement of its point and rotation, (points, 3) each, inertial
        axes; symbols: changes of further symbols by name."""
        given = dict(self.given)
        for side, (move, turn) in motion.items():
            f = self.frame(side)
            if not f.kind.moves:
                continue
            center = move - np.cross(turn, self.vector(f.arm))
            n = f.kind.translations
            P = np.stack([self.given[str(s)] for s in f.q[n:]], axis=-1)
            changes = [*np.moveaxis(center, -1, 0)[:n], *np.moveaxis(spun(turn, P), -1, 0)]
            given |= {str(s): given[str(s)] + step * c for s, c in zip(f.q, changes, strict=True)}
        given |= {name: given[name] + step * c for name, c in (symbols or {}).items()}
        return SymbolValues(self.d, given)


def spun(turn: NDArray[Any], P: NDArray[Any]) -> NDArray[Any]:
    """Change (points, 4) of quaternions P by small rotations (points, 3), rad, inertial components: (0, turn) o P / 2."""
    scalar = -np.sum(turn * P[:, 1:], axis=-1, keepdims=True)
    return np.concatenate([scalar, P[:, :1] * turn + np.cross(turn, P[:, 1:])], axis=-1) / 2


def random_state(d: Derived, seed: int = 7, points: int = POINTS, spread: float = 1.5) -> SymbolValues:
    """Random attitudes, positions, velocities, parameters and multipliers; `spread` bounds the rotation vectors, rad."""
    rng = np.random.default_rng(seed)
    given: Values = {}
    for f in d.frames:
        turns = rng.uniform(-spread, spread, (points, 3)) * ([0, 0, 1] if f.kind.flat else 1)
        J = np.array([_matrix(turn) for turn in turns])
        Q = np.array([_matrix(rng.uniform(-1, 1, 3)) for _ in range(points)])
        if f.kind.by_quaternion:
            P = quaternion(J @ np.swapaxes(Q, 1, 2)) * rng.uniform(0.5, 2, (points, 1))
            given |= {str(s): c for s, c in zip(f.q[f.kind.translations :], P.T, strict=True)}
        else:  # a flat frame has one of its axes along the normal of the plane
            flat = f.kind.flat and f.axes is not Axes.GENERAL
            columns = axes_pattern(f.axes, [[J[:, 0, 0], J[:, 1, 0], 0]] * 3)[0] if flat else J.T
            Q = np.array([[np.broadcast_to(x, (points,)) for x in column] for column in columns]).T
        if not f.kind.of_joint:
            given |= {f"{f.side}_Q{a}{i + 1}": Q[:, i, j] for j, a in enumerate("xyz") for i in range(3)}
            given |= {f"{f.side}_p{i + 1}": rng.normal(size=points) for i in range(3)}
        given |= {str(s): rng.normal(size=points) for s in (*f.q, *f.u) if str(s) not in given}
        given |= {f"{f.side}_theta0": rng.normal(size=points)} if f.kind is NodeKind.PLANAR else {}
    for name in d.law.params:
        given[name] = rng.uniform(0.5, 1.5, points)
        given |= {name + end: rng.normal(size=points) for end in ("_dot", "_ddot")}
    given |= {f"state_{name}": rng.normal(size=points) for name in d.law.states}
    given |= {str(s): rng.normal(size=points) for s in [*d.multipliers, *d.stabilisers]}
    given |= {f"d{f.q[0]}": rng.normal(size=points) for f in d.frames if f.kind is NodeKind.COORDINATE}
    given |= {f"{kind}_{f.side}{i}": rng.normal(size=points) for f in d.frames for kind in ("du", "dpsi") for i in range(3)}
    given |= {str(s): rng.uniform(0.5, 1.5, points) for f in d.frames for s in f.parameters if str(s) not in given}
    return SymbolValues(d, given)


def _matrix(vector: Any) -> NDArray[np.float64]:
    return rotation_matrices(turned(np.array([1.0, 0, 0, 0]), np.asarray(vector, dtype=float)))


def residual(got: Any, wanted: Any) -> float:
    """Largest difference relative to the largest wanted value (at least 1)."""
    scale = max(1.0, float(np.max(np.abs(wanted), initial=0.0)))
    worst = float(np.max(np.abs(np.asarray(got) - np.asarray(wanted)), initial=0.0)) / scale
    return worst if worst == worst else float("inf")


# -- Random states of a law on a line, at which the formulas of its report are compared with the derived equations


class LineState:
    """Random positions, quaternions, their derivatives along the line, parameters and stress resultants."""

    def __init__(self, rng: Any, law: Any, given: dict[str, Any] | None = None) -> None:
        names = ["r1", "r2", "r3", "P1", "P2", "P3", "P4"]
        self.given = given or {n + end: rng.normal(size=POINTS) for n in names for end in ("", "_xi")}
        if given is None:
            P, dP = (np.stack([self.given[f"P{i}{end}"] for i in range(1, 5)]) for end in ("", "_xi"))
            dP = dP - P * np.sum(P * dP, axis=0) / np.sum(P * P, axis=0)
            self.given |= {f"P{i + 1}_xi": dP[i] for i in range(4)}
            self.given |= {f"{n}{end}_t": rng.normal(size=POINTS) for n in names for end in ("", "_xi")}
            self.given |= {"ds": rng.uniform(0.5, 1.5, POINTS), "weight": rng.uniform(0.5, 1.5, POINTS)}
            self.given |= {n: rng.uniform(0.5, 1.5, POINTS) for n in law.params}
            self.given |= {n: rng.normal(size=POINTS) for n in ("N1", "N2", "N3", "M1", "M2", "M3")}
            self.dr, self.dpsi, self.dpsi_s = (rng.normal(size=(POINTS, 3)) for _ in range(3))

    def get(self, symbol: Expr) -> Any:
        """Value of a symbol of the derived law (points,)."""
        return self.given[str(symbol)]

    def _fields(self, end: str = "") -> tuple[Any, Any]:
        return tuple(np.stack([self.given[f"{n}{i}{end}"] for i in range(1, k)], axis=-1) for n, k in (("r", 4), ("P", 5)))  # type: ignore[return-value]

    def atom(self, base: Base) -> Any:
        """Values of a vector of the cross-section (points, 3)."""
        _, P = self._fields()
        slope, _ = self._fields("_xi")
        return slope / self.given["ds"][:, None] if base.kind == "rs" else columns(P)[..., "xyz".index(base.kind)]

    def symbol(self, name: str) -> Any:
        """Value of a curvature, parameter or stress resultant by its name (points,)."""
        return self._curvature()[:, int(name[-1]) - 1] if name.startswith("kappa") else self.given[name]

    def _curvature(self) -> Any:
        _, P = self._fields()
        _, dP = self._fields("_xi")
        vector = P[:, :1] * dP[:, 1:] - dP[:, :1] * P[:, 1:] - np.cross(P[:, 1:], dP[:, 1:])
        return 2 * vector / np.sum(P * P, axis=-1, keepdims=True) / self.given["ds"][:, None]

    def at_rest(self) -> LineState:
        """This state with all rates zero."""
        return LineState(None, None, {n: 0 * v if n.endswith("_t") else v for n, v in self.given.items()})

    def moving(self) -> LineState:
        """This state after a complex step in time along its rates."""
        return LineState(None, None, {n: v + 1j * STEP * self.given.get(f"{n}_t", 0) for n, v in self.given.items()})

    def changed(self) -> LineState:
        """This state after a complex step along dr', dpsi and dpsi': P changes by (0, dpsi) o P / 2, P' accordingly."""
        _, P = self._fields()
        slope, dP = self._fields("_xi")
        change = spun(self.dpsi, P)
        change_s = spun(self.dpsi, dP) + spun(self.dpsi_s * self.given["ds"][:, None], P)
        given = dict(self.given)
        for i in range(4):
            given[f"P{i + 1}"] = P[:, i] + 1j * STEP * change[:, i]
            given[f"P{i + 1}_xi"] = dP[:, i] + 1j * STEP * change_s[:, i]
        for i in range(3):
            given[f"r{i + 1}_xi"] = slope[:, i] + 1j * STEP * self.dr[:, i] * self.given["ds"]
        return LineState(None, None, given)


def columns(P: Any) -> Any:
    """Rotation matrices (points, 3, 3) of quaternions, real or complex."""
    n = np.sum(P * P, axis=-1)[:, None, None]
    p0, p = P[:, 0, None, None], P[:, 1:]
    tilde = np.stack([np.cross(p, np.broadcast_to(e, p.shape)) for e in np.eye(3)], axis=-1)
    return np.eye(3) + 2 * (p0 * tilde + tilde @ tilde) / n


class Layout:
    """Values of nodes and integration points as one long array over states, points and nodes."""

    def __init__(self, points: int, nodes: int) -> None:
        self.shape = (POINTS, points, nodes)

    def node(self, values: Array) -> Array:
        """Nodal values (states, nodes, ...)."""
        return self._flat(np.broadcast_to(values[:, None], (*self.shape, *values.shape[2:])))

    def point(self, values: Array) -> Array:
        """Values at the integration points (states, points, ...)."""
        return self._flat(np.broadcast_to(values[:, :, None], (*self.shape, *values.shape[2:])))

    def whole(self, values: Array) -> Array:
        """Values of the element (states, ...)."""
        return self._flat(np.broadcast_to(values[:, None, None], (*self.shape, *values.shape[1:])))

    def both(self, values: Array) -> Array:
        """Values of nodes at points (points, nodes), or (states, points, nodes)."""
        return self._flat(np.broadcast_to(values, self.shape))

    def sums(self) -> dict[str, Any]:
        """The sums over nodes and points by their LaTeX."""
        return {rf"\sum_{letter}": Summed(self.shape, axis) for letter, axis in (("i", 2), ("g", 1))}

    def _flat(self, values: Array) -> Array:
        return values.reshape(-1, *values.shape[3:])


def interpolation(order: int, points: int) -> tuple[Array, Array, Array]:
    """Gauss weights (points,) on the unit interval, values and slopes (points, nodes) of the polynomials that are 1 at one node
    and 0 at the others: the ends, and between them the extrema of the Legendre polynomial of this order."""
    gauss, weights = np.polynomial.legendre.leggauss(points)
    inner: Any = np.polynomial.legendre.Legendre.basis(order).deriv().roots()
    at, nodes = (gauss + 1) / 2, np.r_[0, (np.sort(inner) + 1) / 2, 1]
    found = [np.poly1d(np.delete(nodes, i), r=True) / np.prod(x - np.delete(nodes, i)) for i, x in enumerate(nodes)]
    return weights / 2, np.stack([p(at) for p in found], -1), np.stack([p.deriv()(at) for p in found], -1)
