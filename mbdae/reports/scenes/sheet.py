"""The sheet of a scene: bodies, joints, forces, unknowns and equations, as in the system that is integrated."""

from __future__ import annotations

from collections import Counter
from io import BytesIO
from typing import Any

import numpy as np

from mbdae.analysis import linearize
from mbdae.documents.blocks import Block, Paragraph, Picture, Section, Table, numbered
from mbdae.documents.document import Document
from mbdae.documents.drawing import pattern
from mbdae.documents.formulas import escaped
from mbdae.errors import MbdaeError
from mbdae.formulations import system_for
from mbdae.reports.printed import checks_table
from mbdae.reports.scenes.forces import ClosedForms
from mbdae.run.checks import Check
from mbdae.run.reductions import absent
from mbdae.scene.scene import SceneData
from mbdae.show.drawing import draw
from mbdae.symbolic.fingerprint import fingerprint
from mbdae.system.prepare import prepare

KINDS = {
    "q": "positions",
    "v": "velocities",
    "s": "internal states",
    "z": "stresses of beams",
    "lambda": "multipliers",
    "mu": "stabilising multipliers",
}
LISTED = 60  #: names in a list; further ones are only counted
EIGEN_UP_TO = 1500  #: largest number of unknowns for which eigenvalues are computed


class Sheet:
    """A scene with its system."""

    def __init__(self, scene: SceneData) -> None:
        self.scene = scene
        self.prepared = prepare(scene)
        self.check = Check(self.prepared)
        self.system = system_for(self.prepared)

    def document(self) -> Document:
        """The whole sheet."""
        first = (self.summary, self.bodies, self.joints, self.forces, self.unknowns, self.pruned, self.redundant)
        last = (self.eigenvalues, self.sparsity, self.laws)
        sections = [*(part() for part in first), *self.closed(), *(part() for part in last)]
        return Document(escaped(f"Scene {self.scene.name}"), sections)

    def closed(self) -> list[Section]:
        """The equations of the bodies and their joint forces in closed form, read back; or why there is none."""
        try:
            page = ClosedForms(self.prepared)
        except ValueError as reason:
            return [Section("Joint forces in closed form", [Paragraph(f"There is none: {reason}.")])]
        blocks = numbered(page.blocks())
        return [*blocks, Section("Numeric check", checks_table(page.printed(blocks)))]  # type: ignore[list-item]

    def summary(self) -> Section:
        """Drawing and the main numbers."""
        c, m = self.check, self.prepared.model
        told = (
            f"{'Planar' if c.planar else 'Spatial'}: {m.why}. {c.degrees_of_freedom} degrees of freedom; {self.system.n} unknowns"
            f" and {len(self.system.equations)} equations in the form {self.system.label}. Length {m.length:.4g} m,"
            f" characteristic time {self.prepared.time:.4g} s; gravity ({', '.join(f'{x:g}' for x in self.scene.gravity)})"
            " m/s$^{2}$."
        )
        changes = [Paragraph("Start: " + "; ".join(map(str, self.prepared.start.changes)))] if self.prepared.start.changes else []
        chosen = Paragraph(f"To an accuracy of {self.check.accuracy:g} by default: {escaped(str(self.check.choice))}.")
        return Section(
            "Scene",
            [
                Paragraph(told),
                chosen,
                *changes,
                Picture(self.drawing(), f"The scene as it starts, t = {self.prepared.start.t:g} s."),
            ],
        )

    def drawing(self) -> bytes:
        """PNG of the scene."""
        figure = draw(self.prepared)
        out = BytesIO()
        figure.savefig(out, format="png", dpi=110)
        return out.getvalue()

    def bodies(self) -> Section:
        """Bodies with their mass."""
        rows = []
        for b in self.scene.bodies:
            line = self.prepared.model.line(b)
            what = f"beam, {len(line.mesh.elements)} elements" if line else "point mass" if b.is_point else "rigid"
            node = self.prepared.model.node(b)
            kind = node.kind.value if node is not None else ("nodes of the beam" if line else "")
            centre = ", ".join(f"{round(x, 12) + 0.0:.4g}" for x in b.position)
            rows.append([escaped(b.name), what, f"{b.mass:.6g}", centre, _inertia(b), kind])
        return Section(
            "Bodies", [Table(["body", "is", "mass [kg]", "centre as drawn [m]", "principal inertia [kg m$^2$]", "node"], rows)]
        )

    def joints(self) -> Section:
        """Joints with models and rows."""
        rows = []
        kept = {row.name for row in self.system.numbering.rows}
        by_item = {
            instance.item: (g, instance)
            for g, _, instance in self.prepared.model.instances()
            if self.prepared.model.groups[g].derived.rows
        }
        for c in self.scene.joints:
            found = by_item.get(c.name)
            names = [r for r in self.prepared.model.groups[found[0]].derived.rows if f"{c.name}.{r}" in kept] if found else []
            model = type(c.model).__name__.lower() if c.model is not None else "kinematic"
            model += f" (kept kinematic: {self.check.kept_kinematic[c.name]})" if c.name in self.check.kept_kinematic else ""
            drive = escaped(str(c.prescribed)) if c.prescribed is not None else ""
            rows.append(
                [escaped(c.name), c.kind, escaped(model), escaped(c.k.name), escaped(c.l.name), ", ".join(names) or "none", drive]
            )
        head = ["joint", "kind", "model", "k", "l", "rows that are equations", "prescribed"]
        return Section("Joints", [Table(head, rows)] if rows else [Paragraph("There are none.")])

    def forces(self) -> Section:
        """Laws of force."""
        joints = {c.name for c in self.scene.joints}
        rows = []
        for group in self.prepared.model.groups:
            for i in group.instances:
                law = type(i.law).__name__
                if i.item in joints and group.derived.rows:
                    continue
                if group.derived.force:
                    numbers = ", ".join(
                        (
                            f"{name} = {getattr(i.law, name):g}"
                            if isinstance(getattr(i.law, name), int | float)
                            else f"{name} = {getattr(i.law, name)}"
                        )
                        for name in i.law.params
                        if getattr(i.law, name) is not None
                    )
                    rows.append([escaped(i.item), law, escaped(numbers)])
        return Section("Forces", [Table(["item", "law", "values (SI)"], rows)] if rows else [Paragraph("There are none.")])

    def unknowns(self) -> Section:
        """Unknowns and equations by kind and name."""
        counts = Counter(self.system.kinds)
        rows = [
            [
                KINDS.get(kind, kind),
                str(n),
                str(min(int(i) for i, k in zip(self.system.index, self.system.kinds, strict=True) if k == kind)),
                listed([name for name, k in zip(self.system.names, self.system.kinds, strict=True) if k == kind]),
            ]
            for kind, n in counts.items()
        ]
        heads = Counter(
            name.split(" of ")[0].split(" ")[0] if " of " in name else name[name.rfind("(") + 1 :].rstrip(")")
            for name in self.system.equations
        )
        equations = "; ".join(f"{n} of {kind}" for kind, n in heads.items())
        shared = [
            Paragraph(
                "Rows that need no equation, because bodies share unknowns with a node of a beam:"
                f" {listed(list(self.check.shared))}."
            )
        ]
        return Section(
            "Unknowns and equations",
            [
                Table(
                    ["unknowns", "number", "index", "names"], rows, f"{self.system.n} unknowns in the form {self.system.label}"
                ),
                Paragraph(f"{len(self.system.equations)} equations: {equations}."),
                *(shared if self.check.shared else []),
            ],
        )

    def pruned(self) -> Section:
        """Unknowns, equations and terms that the scene does not need."""
        keys = ("unknowns", "equations", "multipliers", "kernels", "operations")
        rows = [[step.reason, *(str(getattr(step.size, key)) for key in keys)] for step in self.check.reductions]
        lacking = absent(self.scene)
        blocks: list[Block] = [
            Table(
                ["after", *keys],
                rows,
                "From the naive formulation to what is integrated. Kernels and operations: of residuals and derivatives of all"
                " laws but beams, after common subexpressions",
            ),
            Paragraph(f"Without any term for: {', '.join(lacking)}." if lacking else "No kind of term is absent."),
        ]
        gone = listed(list(self.check.pruned))
        blocks.append(
            Paragraph(
                f"Rows that vanish identically for this scene: {gone}." if self.check.pruned else "No row vanishes identically."
            )
        )
        return Section("Pruned", blocks)

    def redundant(self) -> Section:
        """Redundant rows, and reactions that are not unique."""
        c = self.check
        if not self.prepared.rows:
            return Section("Redundant rows", [Paragraph("The scene has no constraint rows.")])
        told = f"Left out: {listed(list(c.redundant))}." if c.redundant else "No row is redundant."
        unique = f" Reactions that are not unique: {listed(list(c.not_unique))}." if c.not_unique else ""
        return Section(
            "Redundant rows",
            [
                Paragraph(
                    f"{told}{unique} Smallest singular value of the rows kept (of unit length): "
                    f"{self.prepared.rank.smallest:.3g}."
                )
            ],
        )

    def eigenvalues(self) -> Section:
        """Eigenvalues of small motions about the start."""
        if self.system.n > EIGEN_UP_TO:
            return Section("Eigenvalues at the start", [Paragraph(f"Not computed for {self.system.n} unknowns.")])
        try:
            found = linearize(self.scene)
        except MbdaeError as error:
            return Section("Eigenvalues at the start", [Paragraph(f"Not available: {escaped(str(error))}")])
        rows = [
            [f"{value.real:.6g}", f"{value.imag:.6g}", f"{abs(value.imag) / 2 / np.pi:.6g}"]
            for value in found.eigenvalues[:40]
            if value.imag >= 0
        ]
        head = ["real part [1/s]", "imaginary part [rad/s]", "frequency [Hz]"]
        return Section(
            "Eigenvalues at the start",
            [Table(head, rows, f"Of small motions about the start, {len(found.eigenvalues)} in all; one of each conjugate pair")],
        )

    def sparsity(self) -> Section:
        """Pattern of the iteration matrix."""
        m = self.system.pattern.tocoo()
        n, nnz = self.system.n, self.system.pattern.nnz
        entries = sorted(zip(m.row.tolist(), m.col.tolist(), strict=True))
        text = (
            f"Jacobian of the system: {n} x {n}, {nnz} entries ({100 * nnz / max(1, n * n):.1f} %); columns are unknowns in the"
            " order above."
        )
        if len(entries) > 20000:
            return Section("Sparsity", [Paragraph(text)])
        return Section("Sparsity", [Picture(pattern(entries, n, "entries of the Jacobian"), text)])

    def laws(self) -> Section:
        """The laws with their hashes."""
        rows = [
            [
                group.key[0].__name__,
                str(len(group.instances)),
                " - ".join(kind.value for kind, _ in group.key[2]),
                f"`{fingerprint(group.derived)[:32]}…`",
            ]
            for group in self.prepared.model.groups
        ]
        text = (
            "Every law as it is derived for this scene; the report of a law prints the sha256 of the same equations between two"
            " bodies in space."
        )
        return Section(
            "Laws", [Paragraph(text), Table(["law", "times", "between nodes", "sha256 of the derived equations"], rows)]
        )


def listed(names: list[str]) -> str:
    """Names, at most `LISTED` of them."""
    shown = ", ".join(escaped(n) for n in names[:LISTED])
    return shown + (f", … ({len(names)} in all)" if len(names) > LISTED else "")


def _inertia(b: Any) -> str:
    if b.inertia is None:
        return ""
    principal = np.linalg.eigvalsh(b.inertia)
    return ", ".join(f"{x if abs(x) > 1e-12 * np.max(np.abs(principal)) else 0.0:.4g}" for x in principal)


def scene_sheet(scene: SceneData) -> Document:
    """The sheet of a scene; raises SceneError with every problem found."""
    return Sheet(scene).document()
