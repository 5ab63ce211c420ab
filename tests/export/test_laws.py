"""Exported functions of laws equal the compiled kernels of their derivation, of every law of the library and of a user's own."""

from __future__ import annotations

import numpy as np
import pytest
import symengine as se

import mbdae as mb
from mbdae.export import text
from mbdae.export.for_jax import SUM, Levels
from mbdae.export.program import run
from mbdae.native.program import CALL
from mbdae.reports import exported

EXACT = 1e-12
QUICK = ("revolute", "screw", "gear", "pointspring", "jointstop", "rigidbody", "beam", "lineload")


class Magnet(mb.Force):
    """An attraction that saturates, of a user's own."""

    params = mb.params(strength="N m", reach="m")

    def energy(self, k, l):
        d = l.r - k.r
        return -self.strength * se.tanh(self.reach / se.sqrt(d @ d))


LAWS = {name: law for name, law in exported().items() if name != "jointcoordinate"} | {"magnet": Magnet}


def test_a_function_is_written_alone(monkeypatch):
    """Formulas of the Jacobian of a contact take minutes, those of its forces a second, which do not wait for them."""
    written, derivation = [], text.derivation
    monkeypatch.setattr(text, "derivation", lambda program, f: written.append(f.name) or derivation(program, f))
    law = mb.export(LAWS["pointspring"], format="sympy")
    for _ in range(2):
        _, outputs = law["forces"]
        assert outputs.shape == (12, 1)
    assert written == ["forces"]
    assert law.text.count("_steps = [") == len(law.outputs)


def kernel_values(program, name, vectors):
    """A function by the compiled kernel of the law."""
    f, W = program.functions[name], program.given(vectors)
    run(f.steps, W)
    return W[f.at]


def states(program, count=4):
    rng = np.random.default_rng(3)
    for _ in range(count):
        yield {name: rng.uniform(0.3, 0.9, len(entries)) for name, entries in program.inputs.items()}


def check(law, compiled, **options):
    export = mb.export(law, "c", **options)
    call, program = compiled(export), export.program
    found = {"c": call}
    try:
        import casadi  # noqa: F401
    except ImportError:
        pass
    else:
        functions = mb.export(law, "casadi", **options)
        found["casadi"] = lambda name, **v: np.array(functions[name](v["x"], v["p"])).ravel()
    for given in states(program):
        for name in export.outputs:
            wanted = kernel_values(program, name, given)
            scale = max(np.max(np.abs(wanted)), 1e-300)
            for format, function in found.items():
                error = np.max(np.abs(function(name, **given) - wanted)) / scale
                assert error < EXACT, f"{name} in {format} is off by {error:.2g}"
    return export


@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in LAWS])
def test_law_is_its_kernel(name, compiled):
    check(LAWS[name], compiled)


def by_levels(kernel, used, x):
    """Values of a kernel computed as for JAX, level by level, every level from the numbers of those before it."""
    levels = Levels(kernel.symbols, [se.sympify(kernel.expressions[o]) for o in used])
    W = dict(zip(range(len(x)), x, strict=True)) | {n: value for value, n in levels.constants.items()}
    names = vars(np) | {"nan": np.nan, **{f"a{of}": getattr(np, f"arc{of}") for of in ("sin", "cos", "tan", "tan2")}}
    for form, found in levels.parts():
        for level in found:
            now = {n: form.format(*(repr(float(W[a])) for a in levels.nodes[n].args), levels.nodes[n].factor) for n in level}
            assert form == SUM or len(found) == 1
            W |= {n: float(eval(text, names)) for n, text in now.items()}
    return np.array([W[n] for n in levels.at]), levels


@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in LAWS])
def test_levels_of_a_kernel_are_its_formulas(name):
    """What a language computes that takes whole arrays; and it takes far fewer operations on arrays than there are formulas."""
    program = mb.export(LAWS[name], "jax").program
    for f in program.functions.values():
        for step in (s for s in f.steps if s.fields["kind"] == CALL):
            kernel, used = step.fields["kernel"], step.fields["used"]
            x = np.random.default_rng(3).uniform(0.3, 0.9, len(kernel.symbols))
            found, levels = by_levels(kernel, used, x)
            kernel(x[None], whole := np.empty((1, len(kernel.expressions))))
            wanted = whole[0, list(used)]
            assert np.max(np.abs(found - wanted)) <= EXACT * max(1.0, np.max(np.abs(wanted)))
            parts = list(levels.parts())
            assert sum(len(level) for _, rows in parts for level in rows) == len(levels.nodes)
            assert len(parts) <= 40


def test_own_law_in_the_plane(compiled):
    export = check(Magnet, compiled, frames=("planar", "planar ground"))
    assert [e.name for e in export.inputs["p"]][-2:] == ["reach", "strength"]
    assert {e.name: e.unit for e in export.inputs["p"]}["reach"] == "m"
    assert [e.name for e in export.outputs["forces"]] == ["k.force[0]", "k.force[1]", "k.force[2]"]


def test_functions_carry_the_names_of_the_statement(compiled):
    export = check(mb.Revolute, compiled, kept=True)
    assert {"forces", "rows", "row_rates", "row_accelerations", "G", "joint_forces", "jacobian"} <= set(export.outputs)
    assert "x" in [e.name for e in export.outputs["rows"]]
    units = {e.name: e.unit for e in (*export.outputs["rows"], *export.inputs["x"])}
    assert (units["x"], units["lambda_x"], units["k_r1"], units["l_W1"]) == ("m", "N", "m", "rad/s")


def test_a_law_of_a_scene_brings_its_values():
    s = mb.Scene("s")
    a = s.link("a", (0, 0), (1, 0), mass=1.0)
    s.spring("S", s.ground, a, (0, 1), (1, 0), stiffness=40.0, damping=2.0)
    values = {e.name: e.value for e in mb.export(s["S"], "sympy").inputs["p"]}
    assert values["stiffness"] == 40.0
    assert values["damping"] == 2.0


def test_energy_gives_the_forces_in_sympy():
    """What arrives in SymPy is the statement: the force on l is minus the gradient of the potential."""
    sympy = pytest.importorskip("sympy")
    export = mb.export(Magnet, "sympy", frames=("ground", "point"))
    space = export._module("forces")
    (steps, (energy,)), (more, forces) = export["energy"], export["forces"]
    energy, forces = (e.subs(pairs[::-1]) for e, pairs in ((energy, steps), (sympy.Matrix(forces), more)))
    x = [space["x"][[e.name for e in export.inputs["x"]].index(f"l_r{i}")] for i in (1, 2, 3)]
    numbers = {s: 0.3 + 0.1 * i for i, s in enumerate((*space["x"], *space["p"]))}
    for i in range(3):
        assert float((sympy.diff(energy, x[i]) - forces[i]).subs(numbers)) == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize(("what", "options", "words"), [
    (3, {}, "give a scene"), (mb.Revolute, {"form": "ggl"}, "only a scene has"), (mb.Revolute, {"frames": ("planar",)}, "has 2"),
    (mb.Revolute, {"frames": ("round", "planar")}, "frames"),
])
def test_refusals_say_why(what, options, words):
    with pytest.raises(mb.OptionError, match=words):
        mb.export(what, **options)
