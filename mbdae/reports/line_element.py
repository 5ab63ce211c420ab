"""An element of a law on a line on paper: interpolation, rows and nodal forces, objectivity, tangent, load and inertia. The
formulas hold at every integration point (no index) and node (index i); the sums run over all of them. They are read back at
random nodal values, in elements of every order, and compared with the kernels that are integrated."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.documents import Document
from mbdae.documents.blocks import Block, Section
from mbdae.kernels.line import LineKernel, mass_blocks
from mbdae.kernels.line_nodes import GyroscopicKernel
from mbdae.laws.beam import mass_points, strain_points
from mbdae.laws.bodies import ORDERS
from mbdae.laws.line_mesh import polyline
from mbdae.reports.calculus import ForwardDerivative, cross, dot, factor, inserted, product
from mbdae.reports.letters import SCALARS_OF_ELEMENTS, VECTORS_OF_ELEMENTS, Letter
from mbdae.reports.line_page import LinePage, LineWriter
from mbdae.reports.page import BOTH, Check, Page, Printed, Wanted
from mbdae.reports.recursive_page import matrix
from mbdae.reports.sections import plus
from mbdae.reports.states import POINTS, Layout, columns, interpolation, spun
from mbdae.reports.vectors import ZERO, Base, Vector
from mbdae.symbolic.frames import NodeKind
from mbdae.symbolic.line import LENGTH, WEIGHT, derive_line
from mbdae.symbolic.vectors import Expr
from mbdae.system.model.nodes import quaternion_product

Array = NDArray[Any]
KERNEL = "the compiled kernel of the element"
NODAL, WEIGHED = (r"\mathbf{f}_i", r"\mathbf{m}_i"), r"w\,"  #: force and moment of a node; weight as a factor
AT_NODE = rf"{WEIGHED}L_i\,"


class ElementWriter(LineWriter):
    """LaTeX writer for the vectors of an element."""

    told = LineWriter.told | VECTORS_OF_ELEMENTS


class DiscretePage(Page):
    """What elements of every order do with a law, at random nodal values."""

    writer: LineWriter

    def __init__(self, of: LinePage) -> None:
        self.of, self.record = of, of.record
        absent = of.structure.absent | ({"damping"} & {*of.law.params})
        self.d = derive_line(of.cls, replace(of.structure, absent=absent), NodeKind.SPATIAL)
        self.known = of.known | SCALARS_OF_ELEMENTS
        for name in of.strains:
            letter = self.known[name]
            self.known[f"D{name}"] = Letter(rf"\Delta {letter.latex}", letter.unit, f"change of ${letter.latex}$")
        for i in (1, 2, 3):
            self.known[f"Dkappa{i}"] = Letter(rf"\Delta\kappa_{i}", "1/m", rf"change of $\kappa_{i}$")
        self.writer = ElementWriter(self.record, {n: letter.latex for n, letter in self.known.items()})
        self.wanted = {}
        self.v = {(base.kind, base.side): Vector(self.record, {base: se.Integer(1)}) for base in ElementWriter.told}

    def symbols(self) -> list[list[str]]:
        return [*self.writer.rows(), *super().symbols()]

    def printed(self, blocks: list[Block]) -> list[Check]:
        """Checks of the equations in elements of every order; of each the largest difference."""
        worst = dict[str, float]()
        for order in ORDERS:
            known, wanted, points = self.values(order)
            for check in Printed(known, wanted, points).read(blocks):
                worst[check.what] = max(worst.get(check.what, 0.0), check.residual)
        return [Check(what, residual) for what, residual in worst.items()]

    def values(self, order: int) -> tuple[dict[str, Any], dict[str, Wanted], int]:
        """Values of the given symbols and required ones, by LaTeX, and the number of states times points times nodes."""
        raise NotImplementedError

    def summed(self, over: str, e: Expr | Vector, weight: str = "") -> str:
        r"""The sum of a formula over the nodes (i) or the integration points (g), a number before the sign. weight: factor."""
        number = next((c for c in se.sympify(e).args if c.is_Number), se.Integer(1)) if isinstance(e, se.Mul) else se.Integer(1)
        text = self.writer.of(e if isinstance(e, Vector) else e / number)
        several = len(e.terms) > 1 if isinstance(e, Vector) else isinstance(e, se.Add)
        first = "" if number == 1 else rf"{self.writer.scalar(number)}\,"
        return rf"{first}\sum_{over} {weight}{rf'{chr(92)}left({text}{chr(92)}right)' if several else text}"


class StrainElement(DiscretePage):
    """Interpolation, rows, nodal forces, objectivity and tangent of a law with strains."""

    def blocks(self) -> list[Block]:
        """The sections."""
        return [self._interpolation(), self._rows(), self._forces(), self._rigid(), self._tangent()]

    def _interpolation(self) -> Section:
        v, w = self.v, self.writer
        nodal, own = (se.Symbol("p0i"), v["p", "i"]), (se.Symbol("p0"), v["p", "b"])
        slope, inverse = (se.Symbol("p0s"), v["ps", "b"]), (se.Symbol("u0"), v["u", "b"])
        nu = se.Symbol("nu")
        L, Ls = se.Symbol("L"), se.Symbol("Ls")
        fields = [(v["rs", "b"], v["r", "i"] * Ls), (own[0], nodal[0] * L), (own[1], nodal[1] * L),
                  (slope[0], nodal[0] * Ls), (slope[1], nodal[1] * Ls)]
        lines = [f"{w.of(field)} = {self.summed('i', e)}" for field, e in fields]
        lines += [f"{w.scalar(nu)} = {w.scalar(own[0] ** 2 + dot(own[1], own[1]))}",
                  f"{w.scalar(inverse[0])} = {w.scalar(own[0] / nu)}", f"{w.vector(inverse[1])} = {w.vector(own[1] * (-1 / nu))}"]
        for i, axis in enumerate("xyz"):
            turned = product(product(own, (ZERO, self.record.axis(i))), inverse)[1]
            lines.append(f"{w.vector(v[axis, 'b'])} = {w.vector(turned)}")
        spin = product(inverse, slope)[1]
        lines += [f"{self.known[f'kappa{i + 1}'].latex} = {w.scalar(2 * dot(spin, self.record.axis(i)))}" for i in range(3)]
        told = ("An element of order $p$ has $p + 1$ nodes: its ends, and between them the extrema of the Legendre polynomial of"
                " degree $p$. Positions and quaternions $(e_0, \\mathbf{e})$ of the nodes, of any length, are interpolated by the"
                " polynomials $L_i$ of degree $p$; the axes of the section are those of the interpolated quaternion, its"
                " curvature follows from its inverse $(u_0, \\mathbf{u})$ and its derivative:")
        return self.section("The element: interpolation", told, *lines)

    def _rows(self) -> Section:
        lines = []
        for name, e in self.of.strains.items():
            start = se.Symbol(f"reference_{name}") if f"reference_{name}" in self.known else ZERO
            strain = e - start - se.Symbol(f"compliance_{name}") * se.Symbol(name)
            lines.append(f"{self._row(name)} = {self.known['weight'].latex}\\,\\left({self.writer.scalar(strain)}\\right) = 0")
        self.writer.used.add("weight")
        told = ("The strains are taken at $p$ Gauss points, of which each has its stress resultants as unknowns; with $p + 1$"
                " points the element would lock. The functional of an element, without damping, is the sum over its points of"
                " $w\\sum N\\,(\\gamma - \\varepsilon) - \\tfrac{1}{2} C N^2$; its derivatives by these are the rows")
        return self.section("The element: rows of the stress resultants", told, *lines)

    def _row(self, name: str) -> str:
        return f"R_{{{name}}}"

    def _forces(self) -> Section:
        v, w = self.v, self.writer
        nodal, inverse, slope = ((se.Symbol(s), v[a]) for s, a in (("p0i", ("p", "i")), ("u0", ("u", "b")), ("p0s", ("ps", "b"))))
        relative, stretch, L = product(nodal, inverse), product(slope, inverse), se.Symbol("L")
        a, k, b = (se.Symbol("a0"), v["a", "i"]), (se.Symbol("k0"), v["k", "b"]), (se.Symbol("b0"), v["b", "i"])
        carried = product(b, k)
        lines = []
        for (scalar, vector), (e, of) in (
            (a, relative), (k, stretch), (b, (L * a[0], a[1] * L)),
            ((se.Symbol("b0s"), v["bs", "i"]), (se.Symbol("Ls") * a[0] - carried[0], a[1] * se.Symbol("Ls") - carried[1])),
        ):
            lines += [f"{w.scalar(scalar)} = {w.scalar(e)}", f"{w.vector(vector)} = {w.vector(of)}"]
        moved = self._moved("d")
        lines += [f"{w.vector(v[kind, 'b'])} = {self.summed('i', e)}"
                  for kind, e in zip(("drs", "dpsi", "dpsis"), moved, strict=True)]
        told = ("A virtual rotation $\\delta\\boldsymbol{\\psi}_i$ of a node changes its quaternion by half the product of"
                " $(0, \\delta\\boldsymbol{\\psi}_i)$ with it. What the section makes of it follows from the quaternion"
                " $(\\alpha_i, \\mathbf{a}_i)$ that turns the section to the node:")
        stated = [f"{w.vector(v[kind, 'b'])} = {w.vector(total)}" for kind, total in zip("nqm", self.of.resultants, strict=True)]
        along = sum((dot(v[x, "b"], v[kind, "b"]) for x, kind in zip("nqm", ("drs", "dpsi", "dpsis"), strict=True)), ZERO)
        stated.append(rf"\delta W = {self.summed('g', along, WEIGHED)}")
        forces = [f"{letter} = {self.summed('g', e, WEIGHED)}" for letter, e in zip(NODAL, self._nodal(moved), strict=True)]
        text = ("The virtual work of the stress resultants, sorted by the virtual displacements of the nodes, gives their forces"
                " and moments (about the nodes, inertial axes) on the left-hand side of their equations of motion:")
        return Section("The element: virtual work and nodal forces",
                       [*self.told(told, *lines), *self.told(text, *stated, *forces)])

    def _moved(self, d: str) -> list[Vector]:
        """What a node adds to the changes of r', of the rotation and of its derivative; d: "d" virtual, "D" any."""
        v, half = self.v, se.Rational(1, 2)
        turn = (ZERO, v[f"{d}psi", "i"] * half)
        parts = [product(turn, (se.Symbol(s), v[kind, "i"]))[1] * 2 for s, kind in (("b0", "b"), ("b0s", "bs"))]
        return [v[f"{d}r", "i"] * se.Symbol("Ls"), *parts]

    def _nodal(self, moved: list[Vector]) -> list[Vector]:
        """Force and moment of a node at a point, per weight."""
        zero, v = self.record.zero(), self.v
        return [sum((factor(a, v[x, "b"], Base(move, "i")) for a, x in zip(moved, "nqm", strict=True)), zero)
                for move in ("dr", "dpsi")]

    def _rigid(self) -> Section:
        names = [*self.of.strains]
        moved, still = (rf"\begin{{pmatrix}} {row} \end{{pmatrix}}" for row in (
            r" \\ ".join(rf"\hat {self._row(n)}" for n in names), r" \\ ".join(map(self._row, names))))
        lines = [rf"\sum_i {line}" for line in ("L_i' = 0", r"\beta_i = 1", r"\mathbf{b}_i = \mathbf{0}", r"\beta_i' = 0",
                                               r"\mathbf{b}_i' = \mathbf{0}")]
        balance = [rf"\sum_i {NODAL[0]} = \mathbf{{0}}",
                   rf"\sum_i \left({NODAL[1]} + \mathbf{{r}}_i\times {NODAL[0]}\right) = \mathbf{{0}}"]
        self.wanted |= dict.fromkeys([line.partition(" = ")[0] for line in (*lines, *balance)], BOTH) | {moved: BOTH}
        told = ("The interpolation is linear in positions and quaternions, and its functions add up to 1: a rigid motion of the"
                " nodes, of any size, is that of the sections. Virtual rotations that are equal at all nodes are those of the"
                " section, since")
        large = ("Strains therefore stay as they are. The hat marks the rows after a motion $\\mathbf{r}_i \\to \\mathbf{c} +"
                 " \\mathbf{A}\\,\\mathbf{r}_i$ of all nodes, whose quaternions turn by $\\mathbf{A}$ too:")
        held = "The nodal forces are in balance, for any values of the stress resultants:"
        return Section("The element: objectivity and balance", [*self.told(told, *lines), *self.told(large, f"{moved} = {still}"),
                                                                *self.told(held, *balance)])

    def _tangent(self) -> Section:
        v, w, half = self.v, self.writer, se.Rational(1, 2)
        b, bs = (se.Symbol("b0"), v["b", "i"]), (se.Symbol("b0s"), v["bs", "i"])
        turn = ZERO, v["Dpsi", "i"] * half
        L, Ls = (se.Symbol("s0"), v["Dpsi", "b"] * half), (se.Symbol("s0s"), v["Dpsis", "b"] * half)
        lines = [f"{w.vector(v[kind, 'b'])} = {self.summed('i', e)}"
                 for kind, e in zip(("Drs", "Dpsi", "Dpsis"), self._moved("D"), strict=True)]
        lines += [f"{w.scalar(of[0])} = {self.summed('i', product(turn, by)[0])}" for of, by in ((L, b), (Ls, bs))]
        change, slope = (product(turn, x) for x in (b, bs))
        after, first, second = product(b, L), product(bs, L), product(b, Ls)
        for letter, kind, e in (("db0", "Db", tuple(x - y for x, y in zip(change, after, strict=True))),
                                ("db0s", "Dbs", tuple(x - y - z for x, y, z in zip(slope, first, second, strict=True)))):
            lines += [f"{self.known[letter].latex} = {w.scalar(se.expand(e[0]))}", f"{w.vector(v[kind, 'i'])} = {w.vector(e[1])}"]
            self.writer.used.add(letter)
        of, strains = self.of.strains, self._derivative()
        lines += [f"{self.known[f'Dkappa{i}'].latex} = {w.scalar(dot(v[axis, 'b'], v['Dpsis', 'b']))}"
                  for i, axis in enumerate("xyz", 1)]
        for name, e in of.items():
            row = strains.scalar(e) - se.Symbol(f"compliance_{name}") * se.Symbol(f"D{name}")
            lines.append(rf"\Delta {self._row(name)} = w\,\left({w.scalar(row)}\right)")
        lines += [f"{w.vector(v[f'D{x}', 'b'])} = {w.vector(strains.vector(total))}"
                  for x, total in zip("nqm", self.of.resultants, strict=True)]
        lines += [rf"\Delta {letter} = {self.summed('g', strains.vector(e), WEIGHED)}"
                  for letter, e in zip(NODAL, self._nodal(self._moved("d")), strict=True)]
        told = ("Changes of rows and nodal forces, to first order, by displacements $\\Delta\\mathbf{r}_i$ and rotations"
                " $\\Delta\\boldsymbol{\\psi}_i$ of the nodes and by changes of the stress resultants. What stands beside each of"
                " them is a column of the tangent:")
        return self.section("Tangent of the element", told, *lines)

    def _derivative(self) -> ForwardDerivative:
        """Changes of fields and unknowns in the tangent."""
        v, record = self.v, self.record

        def base(atom: Base) -> Vector | None:
            if atom.kind in "xyz" and atom.side == "b":
                return v["Dpsi", "b"].cross(Vector(record, {atom: se.Integer(1)}))
            return v.get((f"D{atom.kind}", atom.side))

        clock = {se.Symbol(name): se.Symbol(f"D{name}") for name in (*self.of.strains, "kappa1", "kappa2", "kappa3")}
        clock |= {se.Symbol("b0"): se.Symbol("db0"), se.Symbol("b0s"): se.Symbol("db0s")}
        return ForwardDerivative(record, base, clock, r"\Delta")

    def values(self, order: int) -> tuple[dict[str, Any], dict[str, Wanted], int]:
        rng, at, d = np.random.default_rng(order), strain_points(order), self.d
        n, points, names = order + 1, len(at.xi), d.stresses
        layout = Layout(points, n)
        r, P = rng.normal(size=(POINTS, n, 3)), rng.normal(size=(POINTS, 1, 4)) + 0.3 * rng.normal(size=(POINTS, n, 4))
        stress, ds = rng.normal(size=(POINTS, points, len(names))), rng.uniform(0.5, 1.5, (POINTS, points))
        numbers = {p: rng.uniform(0.5, 1.5, (POINTS, points)) for p in d.parameters if p not in (str(LENGTH), str(WEIGHT))}
        kernel = LineKernel(d, at, numbers | {str(LENGTH): ds, str(WEIGHT): ds * at.weights})
        change = [rng.normal(size=a.shape) for a in (r, r, stress)]
        virtual = [rng.normal(size=r.shape) for _ in range(2)]
        axes = columns(P.reshape(-1, 4)).reshape(POINTS, n, 3, 3)

        def at_nodes(r: Array, P: Array, stress: Array) -> Array:
            return np.concatenate([np.concatenate([r, P], -1).reshape(POINTS, -1), stress.reshape(POINTS, -1)], 1)

        def parts(values: Array) -> tuple[Array, Array, Array]:
            """Forces, moments in inertial axes, rows of an element."""
            nodal, rows = values[:, : 6 * n].reshape(POINTS, n, 6), values[:, 6 * n :].reshape(POINTS, points, -1)
            return nodal[..., :3], np.einsum("pnij,pnj->pni", axes, nodal[..., 3:]), rows

        x = at_nodes(r, P, stress)
        force, moment, rows = parts(kernel.values(x))
        turned = np.stack([spun(change[1][:, i], P[:, i]) for i in range(n)], 1)
        tangent = parts(np.einsum("poi,pi->po", kernel.full_jacobian(x), at_nodes(change[0], turned, change[2])))
        spin = rng.normal(size=(POINTS, 4))
        A = columns(spin)
        turn = np.stack([quaternion_product(spin, P[:, i]) for i in range(n)], 1)
        rigid = parts(kernel.values(at_nodes(np.einsum("pij,pnj->pni", A, r) + rng.normal(size=(POINTS, 1, 3)), turn, stress)))[2]
        v, node, point = {base: latex for base, (latex, *_) in VECTORS_OF_ELEMENTS.items()}, layout.node, layout.point
        weights, L, slopes = interpolation(order, points)
        known = layout.sums() | {"L_i": layout.both(L), "L_i'": layout.both(slopes / ds[..., None]), "w": point(ds * weights),
                                 "e_{0i}": node(P[..., 0])}
        known |= {v[Base(kind, "i")]: node(value) for kind, value in (
            ("p", P[..., 1:]), ("r", r), ("dr", virtual[0]), ("dpsi", virtual[1]), ("Dr", change[0]), ("Dpsi", change[1]))}
        known |= {self.known[p].latex: point(value) for p, value in numbers.items()}
        known |= {rf"\mathbf{{i}}_{axis}": np.tile(np.eye(3)[i], (len(known["L_i"]), 1)) for i, axis in enumerate("xyz")}
        wanted = {r"\mathbf{f}_i": node(force), r"\mathbf{m}_i": node(moment), r"\Delta \mathbf{f}_i": node(tangent[0]),
                  r"\Delta \mathbf{m}_i": node(tangent[1] + np.cross(change[1], moment)),
                  r"\delta W": layout.whole(np.sum(force * virtual[0] + moment * virtual[1], axis=(1, 2)))}
        for k, name in enumerate(names):
            known |= {self.known[name].latex: point(stress[..., k]), self.known[f"D{name}"].latex: point(change[2][..., k]),
                      rf"\hat {self._row(name)}": point(rigid[..., k])}
            wanted |= {self._row(name): point(rows[..., k]), rf"\Delta {self._row(name)}": point(tangent[2][..., k])}
        found = {latex: Wanted(values, KERNEL) for latex, values in wanted.items()}
        return known, self.wanted | found, len(known["L_i"])


class DistributedElement(DiscretePage):
    """What a load or inertia per length adds to the equations of the nodes."""

    inertia, turning = r"\mathbf{J}", r"\bar{\mathbf{m}}_i"  #: rotary inertia per length; moment of node i in its own axes
    loaded, moving = (rf"\mathbf{{f}}_{{i,\text{{{of}}}}}" for of in ("load", "inertia"))  #: what they add to the force of node i

    def blocks(self) -> list[Block]:
        """The section."""
        w, v, L = self.writer, self.v, se.Symbol("L")
        load, (momentum, spins) = self.record.lift(self.of.law.load(self.of.x)), self.of.momenta
        lines = list[str]()
        told = ("Loads and inertia are integrated with $p + 1$ Gauss points. They add to the left-hand side of the equations of"
                " the nodes")
        if load.terms:
            lines.append(f"{self.loaded} = -{self.summed('g', load, AT_NODE)}")
            told += " (a load on the axis makes no moments)"
        if momentum.terms:
            moving = inserted(momentum, {Base("v", "b"): v["dv", "b"]}, {})
            lines += [f"{w.vector(v['dv', 'b'])} = {self.summed('i', v['dv', 'i'] * L)}",
                      f"{self.moving} = {self.summed('g', moving, AT_NODE)}"]
        if spins:
            rows = [[se.diff(e, se.Symbol(name)) for name in spins] for e in spins.values()]
            own, rate, momentum = (v[name] for name in (("W", "b"), ("dW", "b"), ("H", "i")))
            turned = w.vector(cross(v["W", "i"], momentum))
            lines += [f"{self.inertia} = {matrix([' & '.join(map(w.scalar, row)) for row in rows])}",
                      *(f"{w.vector(v[kind, 'b'])} = {self.summed('i', v[kind, 'i'] * L)}" for kind in ("W", "dW")),
                      rf"{w.vector(momentum)} = \sum_g {AT_NODE}{self.inertia}\,{w.vector(own)}",
                      rf"{self.turning} = \sum_g {AT_NODE}{self.inertia}\,{w.vector(rate)}{plus(turned)}"]
            told += ("; velocities, and angular velocities in the axes of the sections, are interpolated too, so that the mass"
                     " matrix is constant, and gyroscopic moments of this form keep energy and angular momentum")
        self.writer.used |= {"weight", "L"}
        return [self.section("The element: load and inertia", f"{told}:", *lines)]

    def values(self, order: int) -> tuple[dict[str, Any], dict[str, Wanted], int]:
        rng, at, n = np.random.default_rng(order), mass_points(order), order + 1
        mesh = polyline(np.cumsum(rng.uniform(0.5, 1.5, (POINTS + 1, 1)), 0) * np.eye(3)[0], [1] * POINTS, order)
        ds, layout = mesh.measure(at), Layout(len(at.xi), n)
        numbers = {name: rng.uniform(0.5, 1.5) for name in self.of.law.params}
        moving, spin, turning = (rng.normal(size=(POINTS, n, 3)) for _ in range(3))
        P = rng.normal(size=(POINTS, 1, 4)) + 0.3 * rng.normal(size=(POINTS, n, 4))
        node, point, (weights, L, _) = layout.node, layout.point, interpolation(order, len(at.xi))
        known = layout.sums() | {"L_i": layout.both(L), "w": point(ds * weights), r"\dot{\mathbf{v}}_i": node(moving)}
        size = len(known["L_i"])
        known |= {self.known[name].latex: np.full(size, value) for name, value in numbers.items()}
        known |= {rf"\mathbf{{i}}_{axis}": np.tile(np.eye(3)[i], (size, 1)) for i, axis in enumerate("xyz")}
        sections = columns(np.einsum("ga,pai->pgi", L, P).reshape(-1, 4)).reshape(POINTS, -1, 3, 3)
        known |= {rf"\mathbf{{d}}_{i + 1}": point(sections[..., i]) for i in range(3)}
        known |= {r"\boldsymbol{\Omega}_i": node(spin), r"\dot{\boldsymbol{\Omega}}_i": node(turning)}
        wanted = dict[str, Any]()
        if self.d.duals and not self.of.strains:
            constants = numbers | {str(LENGTH): ds, str(WEIGHT): ds * at.weights}
            kernel = LineKernel(self.d, at, {p: constants[p] for p in self.d.parameters})
            q = np.concatenate([rng.normal(size=(POINTS, n, 3)), P], -1).reshape(POINTS, -1)
            wanted[self.loaded] = node(kernel.values(q).reshape(POINTS, n, 6)[..., :3])
        if self.d.mass:
            M = mass_blocks(mesh, numbers, NodeKind.SPATIAL, self.d)
            rates = np.einsum("pij,pj->pi", M, np.concatenate([moving, turning], -1).reshape(POINTS, -1)).reshape(POINTS, n, 6)
            gyroscopic = GyroscopicKernel(M, n).values(spin.reshape(POINTS, -1)).reshape(POINTS, n, 3)
            wanted[self.moving] = node(rates[..., :3])
            wanted |= {self.turning: node(rates[..., 3:] + gyroscopic)} if self.of.momenta[1] else {}
        return known, {latex: Wanted(value, KERNEL) for latex, value in wanted.items()}, size


class LineReport(LinePage):
    """The report of a law on a line: its statement at a point, and what elements make of it."""

    def document(self) -> Document:
        """The whole report."""
        elements = *((StrainElement,) if self.strains else ()), DistributedElement
        return self.written([(page, page.blocks()) for page in (of(self) for of in elements)])
