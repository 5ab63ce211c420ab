"""Exported equations of scenes equal the compiled kernels that integrate them, in every format, for other parameters too."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import mbdae as mb
from mbdae.export.program import run
from mbdae.formulations import default_form, system_for
from mbdae.native.program import CHOLESKY, POSITIVE
from mbdae.results.sensors import reaction_outputs
from mbdae.system.prepare import prepare

EXAMPLES = Path(__file__).parents[2] / "examples"
EXACT = 1e-12


def example(name):
    sys.path.insert(0, str(EXAMPLES))
    try:
        return __import__(name)
    finally:
        sys.path.remove(str(EXAMPLES))


def pendulum(mass=1.0, stiffness=3.0):
    """Two recursive links; the outer one is pulled by a spring to the ground."""
    s = mb.Scene("double pendulum", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (1, 0.2), mass=mass), s.link("b", (1, 0.2), (2, 0), mass=2 * mass)
    s.revolute("A", s.ground, a, at=(0, 0), model=mb.Recursive(), damper=0.1)
    s.revolute("B", a, b, at=(1, 0.2), model=mb.Recursive(), spring=stiffness, torque=mb.t**2)
    s.spring("pull", s.ground, b, (0, 1), (2, 0), stiffness, damping=0.1, length=0.5)
    return s


def driven(mass=1.0, stiffness=3.0):
    """A link on a crank that is turned; all joints are recursive, with springs on their angles."""
    s = mb.Scene("driven crank", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (1, 0.2), mass=mass), s.link("b", (1, 0.2), (2, 0), mass=2.0)
    s.revolute("A", s.ground, a, at=(0, 0), model=mb.Recursive(), angle=0.7 * mb.t**2, spring=stiffness, damper=0.2)
    s.revolute("B", a, b, at=(1, 0.2), model=mb.Recursive(), spring=stiffness)
    return s


def four_bar(mass=0.3, stiffness=2.0):
    e = example("four_bar")
    s = mb.Scene("four-bar", gravity=(0, -9.81, 0))
    crank, coupler, rocker = s.link("crank", e.A, e.B, mass=mass), s.link("coupler", e.B, e.C, mass=0.6), s.link(
        "rocker", e.C, e.D, mass=0.5)
    s.revolute("A", s.ground, crank, at=e.A, angle=e.OMEGA * mb.t)
    s.revolute("B", crank, coupler, at=e.B)
    s.revolute("C", coupler, rocker, at=e.C, spring=stiffness, damper=0.01)
    s.revolute("D", s.ground, rocker, at=e.D)
    return s


def beam(mass=0.5, stiffness=2.0, recursive=True, space="planar"):
    """A damped beam welded to a crank."""
    s = mb.Scene("beam on a crank", gravity=(0, -9.81, 0), space=space)
    section = mb.Section.rectangular(0.01, 0.02, 70e9, 0.3, 2700, damping=1e-4)
    crank = s.link("crank", (0, 0), (0.3, 0), mass=mass)
    rod = s.beam("rod", (0.3, 0), (1, 0.1), section=section, elements=2 if space == "planar" else 1)
    s.revolute("A", s.ground, crank, at=(0, 0), spring=stiffness, model=mb.Recursive() if recursive else mb.Kinematic())
    s.weld("W", crank, rod, at=(0.3, 0))
    return s


def spinning(mass=2.0, stiffness=40.0):
    """A body on a ball joint in space, a universal joint with a friction torque on the next one."""
    s = mb.Scene("spinning", gravity=(0, 0, -9.81))
    a = s.rigid_body("a", mass, (0.1, 0.2, 0.15), at=(0.1, 0.2, 1))
    b = s.rigid_body("b", 1.0, (0.1, 0.1, 0.02), at=(0.1, 0.2, 2), angular_velocity=(0.3, 0.2, 4))
    s.spherical("A", s.ground, a, at=(0, 0, 0.5))
    s.universal("U", a, b, at=(0.1, 0.2, 1.5), axis=(0, 0, 1), axis_l=(0, 0.6, 0.8))
    s.spring("S", s.ground, b, (1, 0, 0), (0.1, 0.2, 2.2), stiffness, damping=0.5, length=0.2)
    return s


def masses(mass=1.0, stiffness=3.0):
    """Two mass points that nothing holds."""
    s = mb.Scene("masses", gravity=(0, -9.81, 0))
    s.point_mass("c", mass, at=(2, 0))
    s.point_mass("e", 2.0, at=(3, 0))
    return s


def beside(mass=1.0, stiffness=3.0):
    """Recursive links, and a mass point that nothing holds."""
    s = pendulum(mass, stiffness)
    s.point_mass("c", mass, at=(2, 1))
    return s


def floating(mass=1.0, stiffness=3.0):
    """A beam that nothing but a spring holds."""
    s = mb.Scene("floating", gravity=(0, -9.81, 0))
    section = mb.Section.rectangular(0.01, 0.02, 70e9, 0.3, 2700)
    rod = s.beam("rod", (0.3, 0), (1, 0.1), section=section, elements=2)
    s.spring("pull", s.ground, rod, (0, 0), (0.3, 0), stiffness, length=0.1)
    return s


def rolling(mass=1.0, stiffness=3.0):
    """A disc that rolls on a table that turns, on a spring: rows of positions and of velocities."""
    s = mb.Scene("rolling", gravity=(0, 0, -9.81))
    table = s.rigid_body("table", 5.0, (1, 1, 1.5), at=(0, 0, -0.1))
    s.revolute("shaft", s.ground, table, at=(0, 0, 0), axis=(0, 0, 1), angle=0.5 * mb.t**2)
    disc = s.rigid_body("disc", mass, (0.01, 0.02, 0.01), at=(0.5, 0, 0.2), velocity=(1, 0, 0))
    s.rolling("edge", table, disc, at=(0.5, 0, 0.2), axis=(0, 1, 0.1), radius=0.2)
    s.spring("pull", s.ground, disc, (0, 0, 0.5), (0.5, 0, 0.2), stiffness, length=0.3)
    return s


ELIMINATED = mb.Index1(multipliers="eliminated")
SCENES = {
    "pendulum": (pendulum, None), "driven": (driven, None), "four-bar": (four_bar, None),
    "four-bar, index 3": (four_bar, mb.Index3()),
    "four-bar, eliminated": (four_bar, ELIMINATED), "beam": (beam, None),
    "beam, GGL": (lambda *p: beam(*p, recursive=False), None),
    "beam, eliminated": (lambda *p: beam(*p, recursive=False), ELIMINATED),
    "beam in space": (lambda *p: beam(*p, space="spatial"), None), "in space, eliminated": (spinning, ELIMINATED),
    "Andrews": (lambda *p: example("andrews_squeezer").scene(), ELIMINATED),
    "clearance": (lambda *p: example("slider_crank_clearance").scene("B"), None),
    "bristles": (lambda *p: example("stick_slip").scene(), None),
    "masses": (masses, mb.ODE()), "masses, GGL": (masses, mb.GGL()), "masses, eliminated": (masses, ELIMINATED),
    "tree and mass": (beside, mb.ODE()), "floating": (floating, mb.ODE()), "floating, GGL": (floating, mb.GGL()),
    "floating, eliminated": (floating, ELIMINATED), "rolling": (rolling, mb.GGL()),
    "rolling, eliminated": (rolling, ELIMINATED),
}
#: other scenes have the same form, and others the same items
LONG = ("beam in space", "four-bar, eliminated", "four-bar, index 3", "beam, eliminated", "beam, GGL", "floating, GGL",
        "rolling, eliminated")
SYMBOLS = ("pendulum", "four-bar", "four-bar, eliminated", "beam", "clearance", "bristles", "Andrews", "rolling")
CHANGED = ("pendulum", "driven", "four-bar", "four-bar, eliminated", "beam", "beam, GGL", "in space, eliminated")


class Kernels:
    """The equations of a scene as they are integrated, at a state."""

    def __init__(self, scene, form):
        self.prepared = prepare(scene)
        self.system = system_for(self.prepared, form or default_form(self.prepared))
        self.items = [c.name for c in self.prepared.model.scene.connections]

    def __call__(self, t, y, yp):
        system, n = self.system, self.system.n
        found = {"residual": np.empty(n), "rates": np.empty(n)}
        system.residual(t, y, yp, found["residual"])
        if system.rhs is not None:
            system.rhs(t, y, found["rates"])
        found["jacobian"] = [self.dense(part) for part in system.jacobian_parts(t, y, yp)]
        found["joint_forces"] = self.forces(np.array([t]), y, yp)
        return found

    def dense(self, part):
        p = self.system.pattern
        return part if part.ndim == 2 else sp.csc_matrix((part, p.indices, p.indptr), shape=p.shape).toarray()

    def forces(self, t, y, yp):
        """Force and torque of every item on l: by the multipliers of the form, or by those that the state has."""
        m, nb, (q, u, s) = self.prepared.mechanics, self.system.numbering, self.prepared.states(t, y[None])
        if nb.m and len(nb.rows) == len(m.rows):
            at = slice(nb.start["lambda"], nb.start["lambda"] + nb.m)
            multipliers = ((yp if nb.derivatives else y)[at] * nb.scaling())[None]
        elif hasattr(self.system, "full") and not self.system.assembly.moved.sharing.nodes:
            multipliers = (self.system.multipliers * self.system.full.numbering.scaling())[None]
        else:
            multipliers = m.accelerations(t, q, u, s)[1]
        total = np.zeros((len(self.items), 6))
        for g, p, values in m.evaluate(reaction_outputs, t, q, u, s, multipliers):
            for i, instance in enumerate(self.prepared.model.groups[g].instances):
                if instance.item in self.items:
                    total[self.items.index(instance.item), [target[1] for target in p.targets]] += values[0, i]
        return total.ravel()

    def states(self, count=3):
        """States near the start that satisfy nothing."""
        rng, n = np.random.default_rng(5), self.system.n
        for k in range(count):
            yield 0.3 + 0.1 * k, self.system.y0 + 0.1 * rng.normal(size=n), self.system.yp0 + rng.normal(size=n)

    def scales(self, wanted, y, yp):
        """What errors are relative to: of a residual the terms of each row, of a Jacobian the entries of each row, of what a
        matrix was solved for the largest number."""
        rows = sum(abs(J) @ abs(x) for J, x in zip(wanted["jacobian"], (y, yp), strict=True)) + abs(wanted["residual"])
        found = {name: np.max(np.abs(wanted[name]), initial=0.0) for name in ("rates", "joint_forces")}
        if self.prepared.model.lines:  # large forces of strains leave small ones in the joints
            t, (q, u, s) = np.zeros(1), self.prepared.states(np.zeros(1), y[None])
            found["joint_forces"] = max(found["joint_forces"], np.max(np.abs(self.prepared.mechanics.load(t, q, u, s))))
        solved = hasattr(self.system, "full")
        found["residual"] = found["rates"] if solved else rows
        found["jacobian"] = [np.max(np.abs(J), axis=None if solved else 1, keepdims=True) for J in wanted["jacobian"]]
        return found


def off(found, wanted, scale):
    """Largest difference in the scale of each number; where that is 0, the number has to be 0."""
    return np.max(np.abs(found - wanted) / np.where(scale > 0, scale, 1e-300))


def dense(export, values):
    rows, columns = export.pattern
    parts = np.zeros((2, len(export.inputs["y"]), len(export.inputs["y"])))
    parts[0][rows, columns], parts[1][rows, columns] = values[: len(rows)], values[len(rows) :]
    return parts


def values(entries):
    return [e.value for e in entries]


def differences(export, call, kernels, p):
    """The largest relative difference of every function that is exported; call(name, **vectors): its outputs."""
    worst = dict.fromkeys(export.outputs, 0.0)
    for t, y, yp in kernels.states():
        wanted = kernels(t, y, yp)
        scales = kernels.scales(wanted, y, yp)
        for name in export.outputs:
            found = call(name, t=t, y=y, yp=yp, p=p)
            parts = found, wanted[name], scales[name]
            parts = (dense(export, found), *parts[1:]) if name == "jacobian" else [[part] for part in parts]
            worst[name] = max(worst[name], *(off(*part) for part in zip(*parts, strict=True)))
    return worst


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in SCENES])
def test_c_is_the_kernel(name, compiled):
    make, form = SCENES[name]
    export = mb.export(make(), "c", form)
    free = make in (masses, floating)
    assert {"residual", "jacobian"} | ({"joint_forces"} if make is not masses else set()) <= set(export.outputs)
    assert ("rates" in export.outputs) == (free or form is ELIMINATED or export.program.title.endswith("ODE"))
    worst = differences(export, compiled(export), Kernels(make(), form), values(export.inputs["p"]))
    assert all(error < EXACT for error in worst.values()), worst


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in CHANGED])
def test_parameters_are_inputs(name, compiled):
    """With the numbers of another scene the functions are those of that scene."""
    make, form = SCENES[name]
    form = replace(form, baumgarte=3.0) if form is ELIMINATED else form
    export, other = mb.export(make(), "c", form), mb.export(make(1.7, 5.3), "c", form)
    assert [e.name for e in export.inputs["p"]] == [e.name for e in other.inputs["p"]]
    assert values(export.inputs["p"]) != values(other.inputs["p"])
    worst = differences(export, compiled(export), Kernels(make(1.7, 5.3), form), values(other.inputs["p"]))
    assert all(error < EXACT for error in worst.values()), worst


def test_a_tree_has_one_kernel_for_its_accelerations(compiled):
    """As where it is integrated; without inertia the function says so."""
    export = mb.export(pendulum(), "c")
    kinds = {step.fields["kind"] for step in export.program.functions["rates"].steps}
    assert POSITIVE in kinds
    assert CHOLESKY not in kinds
    call, y = compiled(export), values(export.inputs["y"])
    given = [0.0 if e.name.endswith(("mass", "Jzz")) else e.value for e in export.inputs["p"]]
    call("rates", t=0.0, y=y, p=values(export.inputs["p"]))
    with pytest.raises(AssertionError, match="1 == 0"):
        call("rates", t=0.0, y=y, p=given)


@pytest.mark.parametrize("name", SYMBOLS)
def test_casadi_is_the_kernel(name):
    pytest.importorskip("casadi")
    make, form = SCENES[name]
    export = mb.export(make(), "casadi", form)

    def call(name, **vectors):
        found = export[name](**{v: vectors[v] for v in export.arguments[name]})
        rows, columns = export.pattern
        if name == "jacobian":
            return np.concatenate([np.array(found[part])[rows, columns] for part in ("fy", "fyp")])
        return np.array(found["out"]).ravel()

    worst = differences(export, call, Kernels(make(), form), values(export.inputs["p"]))
    assert all(error < EXACT for error in worst.values()), worst


@pytest.mark.parametrize("name", SYMBOLS[:4])
def test_sympy_is_the_kernel(name):
    sympy = pytest.importorskip("sympy")
    make, form = SCENES[name]
    export = mb.export(make(), "sympy", form)
    made = {}

    def call(name, **vectors):
        if name not in made:
            (steps, outputs), space = export[name], export._module
            made[name] = sympy.lambdify([space[v] for v in export.arguments[name]], list(outputs),
                                        cse=lambda expressions: (steps, expressions))
        return np.array(made[name](*(vectors[v] for v in export.arguments[name])), dtype=float)

    worst = differences(export, call, Kernels(make(), form), values(export.inputs["p"]))
    assert all(error < EXACT for error in worst.values()), worst


def test_names_units_and_values():
    export = mb.export(four_bar(), "c")
    y = {e.name: e for e in export.inputs["y"]}
    assert (y["crank.theta"].unit, y["crank.vx"].unit, y["lambda(A.x)"].unit, y["lambda(A.drive)"].unit) == (
        "rad", "m/s", "N s", "N m s")
    p = {e.name: (e.unit, e.value) for e in export.inputs["p"]}
    assert p["crank.mass"] == ("kg", 0.3)
    assert p["D.k_p1"] == ("m", 0.6)
    assert not [name for name in p if "#" in name]  # the mass of the body and that of its weight are one input
    assert p["C.stiffness"][1] == 2.0
    assert export.outputs["joint_forces"][6].name == "B.force[0]"
    units = {e.name: e.unit for e in export.outputs["residual"]}
    assert (units["momentum of crank.vx"], units["A.x (velocity constraint)"]) == ("N", "m/s")
    for line in ("[0] crank.mass, kg = 0.3", "int four_bar_residual(double t, const double *y"):
        assert line in export.header


def test_latex_is_what_sympy_exports():
    sympy = pytest.importorskip("sympy")
    symbols, latex = mb.export(pendulum(), "sympy"), mb.export(pendulum(), "latex")
    steps, outputs = symbols["residual"]
    lines = [line for line in latex["residual"] if not line.startswith(r"\[v_")]  # names of sums that are too long for a line
    assert len(lines) == len(steps) + len(outputs)
    y2, plain = sympy.Symbol("y2"), sympy.latex(steps[0][1])
    assert lines[0] == f"\\[w_{{0}} = {plain.replace(sympy.latex(y2), 'y_{2}')}\\]" or "w_{0}" in lines[0]
    assert r"\text{momentum of A.angle}" in lines[-2] or "momentum" in "".join(lines[-2:])
    assert latex.text.count(r"\begin{") == latex.text.count(r"\end{")


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no TeX here")
def test_latex_fits_the_page(tmp_path):
    """No line is wider than the text, and none is made smaller to fit."""
    for name, what in (("scene", four_bar()), ("law", mb.Universal)):
        export = mb.export(what, "latex")
        text = export.save(tmp_path / f"{name}.tex").read_text(encoding="utf-8")
        assert r"\resizebox" not in text
        done = subprocess.run(["pdflatex", "-interaction=nonstopmode", "-halt-on-error", f"{name}.tex"], cwd=tmp_path, check=True,
                              capture_output=True)
        wide = re.findall(r"Overfull .hbox \((\d+)", done.stdout.decode(errors="replace"))
        assert [points for points in wide if int(points) > 5] == []
    shown = repr(export)
    assert len(shown) < 300
    assert shown.startswith("Export('Universal', format 'latex': functions forces (12), rows (")


def test_parameters_that_are_zero():
    """A term that the scene does not have is no input; one that is stated as 0 is."""
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    s.revolute("hinge", s.ground, rod, at=(0, 0), damper=0.0)
    names = [e.name for e in mb.export(s).inputs["p"]]
    assert "hinge.damping" in names
    assert "rod.gy" in names
    assert not {"rod.gx", "rod.gz", "hinge.stiffness"} & {*names}


def test_files_are_written(tmp_path):
    export = mb.export(four_bar(), "c")
    export.save(tmp_path / "four_bar.c")
    assert (tmp_path / "four_bar.h").read_text(encoding="utf-8") == export.header
    with pytest.raises(mb.OptionError, match=r"ends in \.c"):
        export.save(tmp_path / "four_bar.tex")


@pytest.mark.parametrize(("arguments", "words"), [
    ({"format": "fortran"}, "format"), ({"frames": ("planar",)}, "for classes"), ({"friction": None}, "for classes"),
    ({"form": "ode"}, "without constraints"),
])
def test_refusals_say_why(arguments, words):
    with pytest.raises(mb.OptionError, match=words):
        mb.export(four_bar(), **arguments)


def test_casadi_is_asked_for_where_it_is_needed(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    export = mb.export(four_bar(), "casadi")
    assert "Function(" in export.text
    with pytest.raises(mb.OptionError, match=r"pip install 'mbdae\[casadi\]'"):
        export["residual"]


def test_friction_by_reactions_has_no_formula_for_the_accelerations():
    s = mb.Scene("rubbing")
    a = s.link("a", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, a, at=(0, 0), friction=mb.Coulomb(0.3, 1e-3), radius=0.02, rate0=3.0)
    assert "residual" in mb.export(s, "c").outputs
    with pytest.raises(mb.OptionError, match="friction"):
        mb.export(s, "c", ELIMINATED)


def test_the_reason_why_joint_forces_are_left_out_holds_in_every_form():
    s = mb.Scene("rubbing beam")
    rod = s.beam("rod", (0, 0), (1, 0), section=mb.Section.rectangular(0.01, 0.02, 70e9, 0.3, 2700), elements=1)
    a = s.link("a", (1, 0), (1.3, 0), mass=1.0)
    s.weld("W", s.ground, rod, at=(0, 0))
    s.revolute("B", rod, a, at=(1, 0), friction=mb.Coulomb(0.3, 1e-3), radius=0.02)
    for form in (mb.GGL(), mb.Index1()):
        reason = mb.export(s, "c", form).missing["joint_forces"]
        assert "friction of 'B'" in reason
        assert "GGL" not in reason
        assert "Index1" not in reason


GREEK = "".join(chr(c) for c in range(0x391, 0x3CA) if c != 0x3A2)


@pytest.mark.parametrize("write", [lambda s: mb.export(s, "latex"), mb.report], ids=["export", "report"])
def test_names_in_any_script_are_set_by_tex(write, tmp_path):
    s = mb.Scene("Ω ∂")
    a = s.link(f"{GREEK} ϑϕ Ά é ſ→ж_$", (0, 0), (0.3, 0), mass=1.0)
    s.revolute("ξ", s.ground, a, at=(0, 0))
    file = write(s).save(tmp_path / "names.tex") or tmp_path / "names.tex"
    text = file.read_text(encoding="utf-8")
    assert set(filter(lambda c: not c.isascii(), text)) <= {"é"}
    for command in (r"\alpha", r"\Omega", r"\varsigma", r"\mathrm{A}", r"U+0436", r"\partial"):
        assert command.replace("\\\\", "\\") in text
    if shutil.which("pdflatex"):
        subprocess.run(["pdflatex", "-interaction=nonstopmode", "-halt-on-error", file.name], cwd=tmp_path, check=True,
                       capture_output=True)


def test_a_planted_error_is_seen():
    """The comparison fails where a weight, a kernel or a slot of the operations is another one."""
    export, kernels = mb.export(four_bar(), "c"), Kernels(four_bar(), None)
    program = export.program
    f = program.functions["residual"]
    t, y, yp = next(kernels.states())
    everything = kernels(t, y, yp)
    wanted, scale = everything["residual"], kernels.scales(everything, y, yp)["residual"]

    def error(steps):
        W = program.given({"t": [t], "y": y, "yp": yp, "p": values(export.inputs["p"])})
        run(steps, W)
        return off(W[f.at], wanted, scale)

    assert error(f.steps) < EXACT
    for n, step in enumerate(f.steps):
        if "weight" in step.tables and np.any(step.tables["weight"]) and "to" in step.tables:
            wrong = step._replace(tables=step.tables | {"weight": -step.tables["weight"]})
        elif "kernel" in step.fields:
            kernel = step.fields["kernel"]
            kernel = type(kernel)(kernel.symbols, [-e for e in kernel.expressions])
            wrong = step._replace(fields=step.fields | {"kernel": kernel})
        else:
            continue
        assert error((*f.steps[:n], wrong, *f.steps[n + 1 :])) > 1e-6


def test_header_says_where_the_entries_of_the_jacobian_stand() -> None:
    s = mb.Scene("p", gravity=(0, -9.81, 0))
    s.revolute("h", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    header = mb.export(s, format="c").header
    assert "]:\n*/" not in header
    assert "entries at the places p_rows, p_columns" in header
