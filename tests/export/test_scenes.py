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
from exports.kernels import Kernels, differences, off, values
from rolling.scenes import PROBLEMS

import mbdae as mb
from mbdae.export.program import run
from mbdae.native.program import CHOLESKY, POSITIVE

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


@pytest.mark.slow
@pytest.mark.parametrize("name", SYMBOLS)
def test_jax_is_the_kernel(name):
    """Compiled by XLA in double precision; and derivatives by JAX are those of the exported Jacobian."""
    jax = pytest.importorskip("jax")
    jax.config.update("jax_enable_x64", True)
    make, form = SCENES[name]
    export, kernels = mb.export(make(), "jax", form), Kernels(make(), form)

    def call(name, **vectors):
        assert export[name].lower, "compiled at its first call"
        found = export[name](*(np.asarray(vectors[v], dtype=float) for v in export.arguments[name]))
        rows, columns = export.pattern
        return np.concatenate([np.asarray(part)[rows, columns] for part in found]) if name == "jacobian" else np.ravel(found)

    worst = differences(export, call, kernels, values(export.inputs["p"]))
    assert all(error < EXACT for error in worst.values()), worst
    t, y, yp = next(kernels.states())
    fy, _ = export["jacobian"](t, y, yp, np.array(values(export.inputs["p"])))
    slopes = jax.jit(jax.jacfwd(export["residual"], 1))(t, y, yp, np.array(values(export.inputs["p"])))
    assert np.max(np.abs(slopes - fy)) < EXACT * np.max(np.abs(fy))


@pytest.mark.parametrize("name", SYMBOLS[:4])
def test_sympy_is_the_kernel(name):
    sympy = pytest.importorskip("sympy")
    make, form = SCENES[name]
    export = mb.export(make(), "sympy", form)
    made = {}

    def call(name, **vectors):
        if name not in made:
            (steps, outputs), space = export[name], export._module(name)
            made[name] = sympy.lambdify([space[v] for v in export.arguments[name]], list(outputs),
                                        cse=lambda expressions: (steps, expressions))
        return np.array(made[name](*(vectors[v] for v in export.arguments[name])), dtype=float)

    worst = differences(export, call, Kernels(make(), form), values(export.inputs["p"]))
    assert all(error < EXACT for error in worst.values()), worst


def test_mass_matrix_and_bias_are_those_of_the_textbook():
    """Of two links by their absolute angles: m l^2 (4/3, 1/2 cos; 1/2 cos, 1/3), gravity, and the terms of the squared rates."""
    s = mb.Scene("double pendulum", gravity=(0, -9.81, 0))
    a, b = s.link("a", (0, 0), (1, 0), mass=1.0), s.link("b", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, a, at=(0, 0), model=mb.Recursive())
    s.revolute("B", a, b, at=(1, 0), model=mb.Recursive())
    export, (q1, q2, w1, w2) = mb.export(s), (0.4, 0.7, 1.1, -0.6)
    assert export.program.functions["mass_matrix"].shape == (2, 2)
    found = {}
    for name in ("mass_matrix", "bias"):
        f = export.program.functions[name]
        W = export.program.given({"t": [0.0], "y": [q1, q2, w1, w2], "p": values(export.inputs["p"])})
        run(f.steps, W)
        found[name] = W[f.at]
    c, sine, turn, g = np.cos(q2), np.sin(q2), np.array([[1, 0], [1, 1]]), 9.81
    M = turn.T @ np.array([[4 / 3, c / 2], [c / 2, 1 / 3]]) @ turn
    h = turn.T @ np.array([-sine / 2 * (w1 + w2) ** 2 + 1.5 * g * np.cos(q1), sine / 2 * w1**2 + g / 2 * np.cos(q1 + q2)])
    assert np.max(np.abs(found["mass_matrix"].reshape(2, 2) - M)) < EXACT
    assert np.max(np.abs(found["bias"] - h)) < EXACT * np.max(np.abs(h))


def test_friction_by_reactions_has_no_bias():
    s = mb.Scene("rubbing")
    a = s.link("a", (0, 0), (1, 0), mass=1.0)
    s.revolute("A", s.ground, a, at=(0, 0), friction=mb.Coulomb(0.3, 1e-3), radius=0.02, rate0=3.0)
    export = mb.export(s, "c")
    assert {"mass_matrix", "constraint_matrix"} <= set(export.outputs)
    assert "the friction of 'A' follows from the multipliers" in export.missing["bias"]


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


def door():
    """A door on two hinges, whose reactions are not unique, with a latch bolt that slides in it, whose reactions are."""
    s = mb.Scene("door", gravity=(0, 0, -9.81))
    leaf = s.rigid_body("leaf", 20.0, (6.7, 1.1, 7.8), at=(0.4, 0, 1))
    bolt = s.rigid_body("bolt", 0.2, (1e-3, 1e-3, 1e-3), at=(0.7, 0, 1))
    s.revolute("lower", s.ground, leaf, at=(0, 0, 0.2), rate0=1.0)
    s.revolute("upper", s.ground, leaf, at=(0, 0, 1.8))
    s.prismatic("guide", leaf, bolt, at=(0.7, 0, 1), axis=(1, 0, 0), spring=50.0)
    return s


def test_reactions_that_are_not_unique_are_named():
    """Two hinges share what they carry, but not the torque about their axis, nor what others carry; every format says so, and so
    does a result."""
    scene = door()
    export = mb.export(scene, "c")
    noted = {e.name for e in export.outputs["joint_forces"] if e.note}
    parts = "force[0]", "force[1]", "force[2]", "torque[0]", "torque[1]"
    assert noted == {f"{hinge}.{part}" for hinge in ("lower", "upper") for part in parts}
    written = [export.header, *(mb.export(scene, form).text for form in ("fmi", "jax", "casadi", "sympy"))]
    assert [text.count("not unique") for text in written] == [len(noted)] * 5
    assert "reactions not unique: lower, upper" in repr(scene.simulate(0.05))


def test_directions_that_come_later_are_named_too():
    """A cart on a floor with a wheel that rolls: as the cart turns, the torque that both share points along x and y."""
    noted = {e.name for e in mb.export(PROBLEMS["steered_wheel"](None)[0], "c").outputs["joint_forces"] if e.note}
    assert noted == {"floor.force[2]", "floor.torque[0]", "floor.torque[1]", "steer.force[2]", "hub.force[2]", "tyre.force[2]"}
