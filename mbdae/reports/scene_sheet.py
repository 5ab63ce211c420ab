"""Overview of a scene: bodies, joints, forces, unknowns and equations of the system that is integrated; of a reduced body: its
modes."""

from __future__ import annotations

import warnings
from collections import Counter
from io import BytesIO
from typing import Any

import numpy as np

from mbdae.analysis import linearize
from mbdae.documents import Document
from mbdae.documents.blocks import Block, Drawing, Paragraph, Picture, Section, Table, escaped, numbered
from mbdae.errors import AccuracyWarning, MbdaeError, SteadyError
from mbdae.formulations import system_for
from mbdae.inputs.reduced import ReducedBody
from mbdae.notation import counted
from mbdae.reports.letters import unit_text
from mbdae.reports.mechanisms import InPlane
from mbdae.reports.mechanisms.legs import mechanism
from mbdae.reports.page import checks_section, short_hash
from mbdae.reports.scene_forces import ClosedForms
from mbdae.reports.units import law_faults, parameter_unit
from mbdae.run.checks import Check
from mbdae.run.choice import absent
from mbdae.scene.scene import SceneData
from mbdae.show.drawing import draw
from mbdae.system.prepare import prepare

KINDS = {"q": "positions", "v": "velocities", "s": "internal states", "z": "stresses of beams", "lambda": "multipliers",
         "mu": "stabilising multipliers"}
LISTED = 60  #: largest number of names in a list; further ones are only counted
EIGEN_UP_TO = 1500  #: largest number of unknowns for which eigenvalues are computed


class Sheet:
    """Sections of the overview of a scene and its system."""

    def __init__(self, scene: SceneData, run: Any = None) -> None:
        self.scene, self.run = scene, run
        self.prepared = prepare(scene) if run is None else run.prepared
        self.check = Check(self.prepared)
        self.system = system_for(self.prepared)

    def document(self) -> Document:
        """The whole sheet."""
        first = (self.summary, self.bodies, self.joints, self.forces, self.unknowns, self.pruned, self.redundant)
        last = (self.eigenvalues, self.sparsity, self.laws)
        sections = [*(part() for part in first), *self.closed(), *(part() for part in last)]
        return Document(escaped(f"Scene {self.scene.name}"), sections)

    def closed(self) -> list[Section]:
        """Motion over the input, equations of the bodies and joint forces in closed form with their checks; or the reason why
        there is none."""
        run, told, over = self.run, list[Block](), None
        try:
            over = mechanism(self.prepared)
            why = over.without
        except ValueError as reason:
            why = str(reason)
        try:
            if why:
                flat = InPlane(self.prepared)
                level = mechanism(flat.prepared)
                if over is None or not level.without:
                    over, told, run = level, [Paragraph(flat.told)], run and flat.run(run)
        except ValueError as other:
            if over is None:
                return self._without(why, str(other))
        assert over is not None
        motion = over.motion()
        blocks = numbered([Section(motion.title, [*told, *motion.blocks]), *over.blocks()])
        beside, wrong = over.beside(run, blocks) if run is not None and not over.without else (None, [])
        return [*blocks, *([beside] if beside else []), checks_section([*over.printed(blocks), *wrong])]  # type: ignore[list-item]

    def _without(self, why: str, other: str) -> list[Section]:
        """The reason why there is no closed form of the motion, and the joint forces or the reason why there is none either."""
        also = f" Nor is there one as a motion in a plane: {other}." if other else ""
        try:
            page = ClosedForms(self.prepared)
        except ValueError as reason:
            joints = Section("Joint forces in closed form", [Paragraph(f"There is none: {reason}.")])
            told = f"There is no closed form of it: {why}.{also}"
            return [*([Section("Motion over the input", [Paragraph(told)])] if self.scene.joints else []), joints]
        blocks = numbered(page.blocks())
        motion = Section("Motion over the input", [Paragraph(f"There is no closed form of it: {why}.{also}")])
        return [motion, *blocks, checks_section(page.printed(blocks))]  # type: ignore[list-item]

    def summary(self) -> Section:
        """Section with the drawing and the main numbers."""
        c, m = self.check, self.prepared.model
        told = (f"{'Planar' if c.planar else 'Spatial'}: {m.why}. {counted(c.degrees_of_freedom, 'degree of freedom')};"
                f" {counted(self.system.n, 'unknown')} and {counted(len(self.system.equations), 'equation')} in the form"
                f" {self.system.label}. Length {m.length:.4g} m, characteristic time {self.prepared.time:.4g} s; gravity"
                f" ({', '.join(f'{x:g}' for x in self.scene.gravity)}) m/s$^{{2}}$.")
        start, chosen = self.prepared.start, f"{self.check.accuracy:g} by default: {escaped(str(self.check.choice))}"
        blocks: list[Block] = [Paragraph(told), Paragraph(f"To an accuracy of {chosen}.")]
        blocks += [Paragraph("Start: " + "; ".join(map(str, start.changes)))] if start.changes else []
        png, lacking = self.drawing()
        boxes = " A box stands for a letter of a name that the font of the drawing lacks." if lacking else ""
        return Section("Scene", [*blocks, Picture(png, f"The scene as it starts, t = {start.t:g} s.{boxes}")])

    def drawing(self) -> tuple[bytes, bool]:
        """PNG of the scene, and whether the font lacks a letter of a name."""
        out = BytesIO()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            # missing letters are noticed here, when the names are measured
            draw(self.prepared).savefig(out, format="png", dpi=110)
        for warning in caught:
            if "missing from font" not in str(warning.message):
                warnings.warn(warning.message, warning.category, stacklevel=2)
        return out.getvalue(), any("missing from font" in str(warning.message) for warning in caught)

    def bodies(self) -> Section:
        """Section with a table of the bodies."""
        rows = []
        for b in self.scene.bodies:
            line = self.prepared.model.line(b)
            what = f"beam, {counted(len(line.mesh.elements), 'element')}" if line else "point mass" if b.is_point else "rigid"
            node = self.prepared.model.node(b)
            kind = node.kind.value if node is not None else ("nodes of the beam" if line else "")
            centre = ", ".join(f"{round(x, 12) + 0.0:.4g}" for x in b.drawn.position)
            rows.append([escaped(b.name), what, f"{b.mass:.6g}", centre, _inertia(b), kind])
        head = ["body", "is", "mass [kg]", "centre as drawn [m]", "principal inertia [kg m$^2$]", "node"]
        return Section("Bodies", [Table(head, rows)])

    def joints(self) -> Section:
        """Section with a table of the joints, their models and rows."""
        rows, m = [], self.prepared.model
        kept = {row.name for row in self.system.numbering.rows}
        stated = {i.item: m.groups[g].derived.rows for g, _, i in m.instances() if m.groups[g].derived.rows}
        for c in self.scene.joints:
            names = ", ".join(r for r in stated.get(c.name, ()) if f"{c.name}.{r}" in kept) or "none"
            model = type(c.model).__name__.lower() if c.model is not None else "kinematic"
            why = self.check.kept_kinematic.get(c.name)
            model += f" (keeps its constraint equations: {why})" if why else ""
            drive = escaped(", ".join(f"{name} = {e}" for name, e in c.prescribed.items()))
            rows.append([escaped(c.name), c.kind, escaped(model), escaped(c.k.name), escaped(c.l.name), names, drive])
        head = ["joint", "kind", "model", "k", "l", "rows that are equations", "prescribed"]
        return Section("Joints", [Table(head, rows)] if rows else [Paragraph("There are none.")])

    def forces(self) -> Section:
        """Section with a table of the force laws."""
        joints, rows = {c.name for c in self.scene.joints}, []
        for group in self.prepared.model.groups:
            for i in group.instances if group.derived.force else ():
                given = {name: v for name in i.law.params if (v := getattr(i.law, name)) is not None}
                for name, v in given.items() if not (i.item in joints and group.derived.rows) else ():
                    number = f"{v:g}" if isinstance(v, int | float) else escaped(str(v))
                    told = i.law.params[name].meaning
                    meaning = escaped(name if told in (name, "") else f"{name}: {told}")
                    rows.append([escaped(i.item), type(i.law).__name__, number, unit_text(parameter_unit(i, name)), meaning])
        head = ["item", "law", "value", "unit", "what it is"]
        return Section("Forces", [Table(head, rows)] if rows else [Paragraph("There are none.")])

    def unknowns(self) -> Section:
        """Section on unknowns and equations by kind and name."""
        y, rows = self.system, list[list[str]]()
        for kind, n in Counter(y.kinds).items():
            own = [i for i, k in enumerate(y.kinds) if k == kind]
            lowest = min(int(y.index[i]) for i in own)
            rows.append([KINDS.get(kind, kind), str(n), str(lowest), listed([y.names[i] for i in own])])
        heads = Counter(name.split(" of ")[0].split(" ")[0] if " of " in name else name[name.rfind("(") + 1 :].rstrip(")")
                        for name in y.equations)
        equations = "; ".join(f"{n} of {kind}" for kind, n in heads.items())
        shared = listed(list(self.check.shared))
        text = f"Rows that need no equation, because bodies share unknowns with a node of a beam: {shared}."
        table = Table(["unknowns", "number", "index", "names"], rows, f"{y.n} unknowns in the form {y.label}")
        told = [Paragraph(f"{len(y.equations)} equations: {equations}."), *([Paragraph(text)] if self.check.shared else [])]
        return Section("Unknowns and equations", [table, *told])

    def pruned(self) -> Section:
        """Section on unknowns, equations and terms that the scene does not need."""
        keys = ("unknowns", "equations", "multipliers", "kernels", "operations")
        rows = [[step.reason, *(str(getattr(step.size, key)) for key in keys)] for step in self.check.reductions]
        lacking = absent(self.scene)
        caption = ("From the naive formulation to what is integrated. Kernels and operations: of residuals and derivatives of all"
                   " laws but beams, after common subexpressions")
        gone = f"Constraint equations left out because they hold in every position: {listed(list(self.check.pruned))}."
        told = [f"Without any term for: {', '.join(lacking)}." if lacking else "No kind of term is absent.",
                gone if self.check.pruned else "No constraint equation is left out as always satisfied."]
        return Section("Pruned", [Table(["after", *keys], rows, caption), *map(Paragraph, told)])

    def redundant(self) -> Section:
        """Section on redundant rows and reactions that are not unique."""
        c = self.check
        if not self.prepared.rows:
            return Section("Redundant rows", [Paragraph("The scene has no constraint rows.")])
        told = f"Left out: {listed(list(c.redundant))}." if c.redundant else "No row is redundant."
        unique = f" Reactions that are not unique: {listed(list(c.not_unique))}." if c.not_unique else ""
        smallest = f"Smallest singular value of the rows kept (of unit length): {self.prepared.rank.smallest:.3g}."
        return Section("Redundant rows", [Paragraph(f"{told}{unique} {smallest}")])

    def eigenvalues(self) -> Section:
        """Section on the eigenvalues of small motions about the start."""
        title = "Eigenvalues at the start"
        if self.system.n > EIGEN_UP_TO:
            return Section(title, [Paragraph(f"Not computed for {self.system.n} unknowns.")])
        try:
            with warnings.catch_warnings(record=True) as heard:  # what linearize tells of the roots stands beside them
                warnings.simplefilter("always", AccuracyWarning)
                found = linearize(self.scene)
        except SteadyError as error:
            told = f"There are none: the start is no steady motion; {str(error).split(';')[0]}."
            return Section(title, [Paragraph(f"{escaped(told)} s.equilibrium() looks for a state at rest.")])
        except MbdaeError as error:
            return Section(title, [Paragraph(f"Not available: {escaped(str(error))}")])
        values = [v for v in found.eigenvalues[:40] if v.imag >= 0]
        rows = [[f"{v.real:.6g}", f"{v.imag:.6g}", f"{abs(v.imag) / 2 / np.pi:.6g}"] for v in values]
        head = ["real part [1/s]", "imaginary part [rad/s]", "frequency [Hz]"]
        caption = f"Of small motions about the start, {len(found.eigenvalues)} in all; one of each conjugate pair"
        notes = [Paragraph(f"Note: {escaped(str(w.message))}.") for w in heard if issubclass(w.category, AccuracyWarning)]
        return Section(title, [Table(head, rows, caption), *notes])

    def sparsity(self) -> Section:
        """Section with the sparsity pattern of the iteration matrix."""
        places, n = self.system.pattern, self.system.n
        if places is None:
            full = f"Jacobian of the system: {n} x {n}, full, since large trees are evaluated joint by joint."
            return Section("Sparsity", [Paragraph(full)])
        nnz, columns = places.nnz, np.repeat(np.arange(n), np.diff(places.indptr))
        entries = sorted(zip(places.indices.tolist(), columns.tolist(), strict=True))
        text = (
            f"Jacobian of the system: {n} x {n}, {nnz} entries ({100 * nnz / max(1, n * n):.1f} %); columns are unknowns in the"
            " order above."
        )
        if len(entries) > 20000:
            return Section("Sparsity", [Paragraph(text)])
        return Section("Sparsity", [Picture(pattern(entries, n, "entries of the Jacobian"), text)])

    def laws(self) -> Section:
        """Section with a table of the laws and their hashes."""
        rows = [[g.key[0].__name__, str(len(g.instances)), " - ".join(kind.value for kind, _ in g.key[2]),
                 short_hash(g.derived)] for g in self.prepared.model.groups]
        text = ("Every law as it is derived for this scene; the report of a law prints the sha256 of the same equations between"
                " two bodies in space.")
        head = ["law", "times", "between nodes", "sha256 of the derived equations"]
        groups = self.prepared.model.groups
        faults = dict.fromkeys(f"{g.instances[0].item}: {fault}" for g in groups for fault in law_faults(g.derived))
        wrong = [Paragraph(f"**The units do not fit: {escaped(fault)}.**") for fault in faults]
        return Section("Laws", [Paragraph(text), *wrong, Table(head, rows)])


def listed(names: list[str]) -> str:
    """Names joined by commas, at most `LISTED` of them."""
    shown = ", ".join(escaped(n) for n in names[:LISTED])
    return shown + (f", … ({len(names)} in all)" if len(names) > LISTED else "")


def _inertia(b: Any) -> str:
    if b.inertia is None:
        return ""
    principal = np.linalg.eigvalsh(b.inertia)
    return ", ".join(f"{x if abs(x) > 1e-12 * np.max(np.abs(principal)) else 0.0:.4g}" for x in principal)


def scene_sheet(scene: SceneData, run: Any = None) -> Document:
    """The overview of a scene; raises SceneError with every problem found. run: a result of it, whose joint forces are shown
    beside those of the formulas."""
    return Sheet(scene, run).document()


def pattern(entries: Any, n: int, title: str) -> Drawing:
    """Entries (row, column) of a square matrix as dots; in a large matrix neighbouring dots merge."""
    size = 420.0
    cell, found = size / max(n, 1), Drawing(size, size, title)
    found.line([(0, 0), (size, 0), (size, size), (0, size), (0, 0)], "#999")
    side = max(cell * 0.92, 0.7)
    for i, j in entries:
        x, y = j * cell, i * cell
        found.line([(x, y), (x + side, y), (x + side, y + side), (x, y + side)], "#0072b2", 0, fill="#0072b2")
    return found


#: the view of pictures of modes; pictures in a row, their width in pixels; how far a mode is drawn to displace, over the size of
#: the body, and to turn, rad; length of the crosses at nodes, over that size; what moves less than STILL by turns stands; largest
#: number of lines of all bodies that are drawn
VIEW = np.array([[0.94, 0.34, 0.0], [0.20, -0.54, -0.82]])
IN_ROW, WIDTH, FAR, TURNED, CROSS, STILL, LINES = 3, 230.0, 0.12, 0.6, 0.04, 1e-3, 20000
SAME = 1e-6  #: relative difference of the frequencies of a mode that was kept, in the matrices and in the reduced body


def modes_page(body: ReducedBody) -> Document:
    """Which modes a reduced body has, how each moves, and pictures of them."""
    beyond = [body.free and not np.any(np.isclose(f, body.held_frequencies, rtol=SAME)) for f in body.frequencies]
    rows = [[str(i + 1), f"{f:.4g}{'*' * beyond[i]}", *_moves(body, i)] for i, f in enumerate(body.frequencies.tolist())]
    held = ", ".join(f"{f:.4g}" for f in body.held_frequencies.tolist()) or "none"
    least = 1e-12 * float(np.max(np.abs(body.nodes)))  # below it is round-off
    places = [[name, *(f"{x if abs(x) > least else 0.0:.4g}" for x in place)] for name, place in body.interfaces.items()]
    text = ("These are frequencies of the body that flies freely; as mounted in a scene it has others, which `s.linearize()` "
            "lists. A coordinate of a mode is the largest displacement of a node by it, m. Modes of vibration that were kept, "
            f"with {'free' if body.free else 'held'} interfaces, Hz: {held}.")
    text += " With * are no vibrations of the body: what forces at interfaces deform besides those." if any(beyond) else ""
    shown = min(max(IN_ROW, LINES // (len(body.edges) + 1)), len(rows))
    caption = (f"The first {shown} modes, drawn large, over the body at rest (grey); dots are interfaces. x to the right, y "
               "away, z up.")
    return Document("Modes of a reduced body", [
        Paragraph(f"{body.summary[0].upper()}{body.summary[1:]}."), Paragraph(text),
        Table(["mode", "Hz", "moves along x / y / z, %", "farthest node"], rows),
        *([Picture(_modes_drawn(body, shown), caption)] if rows else []),
        Section("Interfaces", [Table(["interface", "x, m", "y, m", "z, m"], places)])])


def _moves(body: ReducedBody, mode: int) -> tuple[str, str]:
    """Shares of the squared displacements along the axes, or about which axis the nodes turn; the node that moves farthest."""
    moved, turned = np.split(body.shapes[:, :, mode], [3], axis=1)
    if np.max(np.abs(moved)) < STILL * body.size * np.max(np.abs(turned), initial=0.0):
        return f"turns about {'xyz'[np.argmax(np.sum(turned**2, axis=0))]}", str(np.argmax(np.linalg.norm(turned, axis=1)))
    shares = np.sum(moved**2, axis=0) / np.sum(moved**2)
    return " / ".join(f"{100 * x:.0f}" for x in shares), str(np.argmax(np.linalg.norm(moved, axis=1)))


def _modes_drawn(body: ReducedBody, shown: int) -> Drawing:
    """Modes over the body at rest, by the lines of its mesh; with six freedoms a node crosses show how the nodes turn."""
    found, size = Drawing(0, 0, "modes of the body"), body.size
    rest, cross = (body.nodes - body.center) @ VIEW.T, CROSS * size * np.eye(3)[1:]
    scale = WIDTH / np.max(np.ptp(rest, axis=0))
    for i, frequency in enumerate(body.frequencies[:shown].tolist()):
        moved, turned = np.split(body.shapes[:, :, i], [3], axis=1)
        by = min(FAR * size / np.max(np.abs(moved)), TURNED / np.max(np.abs(turned), initial=1e-300))
        at = np.array([i % IN_ROW * (1.25 * WIDTH), i // IN_ROW * (scale * np.ptp(rest[:, 1]) + 80.0)])
        bent = rest + by * moved @ VIEW.T
        for places, colour in ((rest, "#999"), (bent, "#0072b2")):
            for line in (at + scale * places)[body.edges.astype(int)]:
                found.line(line, colour)
        for place, w in zip(bent, by * turned, strict=True) if turned.size else ():
            for arm in (cross + np.cross(w, cross)) @ VIEW.T:
                found.line([at + scale * (place - arm), at + scale * (place + arm)], "#0072b2")
        for x, y in (at + scale * VIEW @ (place - body.center) for place in body.interfaces.values()):
            found.line([(x - 1, y), (x + 1, y)], "#bf5400", 5)
        found.text(at[0], at[1] + scale * np.max(rest[:, 1]) + 36, f"mode {i + 1}: {frequency:.4g} Hz")
    found.fit()
    return found
