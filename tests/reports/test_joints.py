"""Reports of joints in all their statements: coordinates, motion, friction, recursion; laws on three frames; couplings."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import symengine as se

import mbdae as mb
from mbdae.laws import forces, joints, on_coordinates
from mbdae.reports.letters import worded
from mbdae.reports.statement import structure_of

sys.path.insert(0, str(Path(__file__).parent))

from reading import holds_and_defines

JOINTS = [getattr(joints, name) for name in joints.__all__]
FRICTION = mb.Coulomb(0.3, 1e-3)
UNPRESSED = (joints.Free, joints.FixedOrientation)  #: without a reaction that presses


def variants():
    """Every joint, without and with its coordinates as unknowns, without and with friction."""
    for i, law in enumerate(JOINTS):
        for kept in dict.fromkeys([law.must_keep(), bool(law.coordinates)]):
            for friction in [None, FRICTION] if law.scalars() and law not in UNPRESSED else [None]:
                if kept or friction is not None:  # the plain statement has its test by name
                    name = f"{law.__name__}{', kept' * kept}{', friction' * bool(friction)}"
                    part = (i + kept + bool(friction)) % 5 == 0 or (law is joints.Revolute and kept)
                    yield pytest.param(law, kept, friction, id=name, marks=[] if part else pytest.mark.slow)


@pytest.mark.parametrize(("law", "kept", "friction"), variants())
def test_every_statement_of_a_joint_has_its_report(law, kept, friction):
    document = mb.report(law, kept=kept, friction=friction)
    holds_and_defines(document, law.__name__)
    text = document.to_markdown()
    assert ("## Friction" in text) == (friction is not None)
    assert ("## As a recursive joint" in text) == law.states_motion()
    for name, spec in law.coordinates.items():
        assert re.search(rf"\| `{name}` \| \$.*\$ \| .* \| {re.escape(worded(spec.meaning))} \|", text)


@pytest.mark.parametrize("law", UNPRESSED)
def test_friction_that_nothing_presses_has_no_report(law):
    with pytest.raises(mb.LawError, match=r"friction on 'x' of a .*: no part of the joint's force presses"):
        mb.report(law, friction=FRICTION)


@pytest.mark.parametrize("joint", [pytest.param(law, marks=[pytest.mark.slow] * (i % 2))
                                   for i, law in enumerate(law for law in JOINTS if law.scalars())],
                         ids=lambda law: law.__name__)
def test_forces_on_the_last_coordinate_of_a_joint(joint):
    kept = joint.must_keep()
    for law, options in (("JointSpring", {}), ("JointLoad", {}), ("JointFriction", {"friction": FRICTION})):
        chosen = {"joint": joint, "coordinate": list(joint.scalars())[-1], "kept": kept, **options}
        holds_and_defines(mb.report(getattr(forces, law), **chosen), f"{law} of {joint.__name__}")


class Bent(mb.Joint):
    """Amounts are functions of several coordinates, an axis lies between k's."""

    coordinates = mb.params(turn=("rad", "turn"), lift=("m", "lift"))
    params = mb.params(pitch=("m/rad^2", "pitch"), radius=("m", "radius of a roller"))

    def motion(self, from_k):
        further = from_k.about((1, 2, 2), self.turn).along("x", self.pitch * self.turn**2)
        return further.about("y", self.lift / self.radius + self.turn).along("z", self.lift)


class Arm(mb.Joint):
    """A ball joint, then a rod that slides and turns."""

    coordinates = mb.params(rotation=("rotation", "ball"), out=("m", "length"), spin=("rad", "turn of the rod"))

    def motion(self, from_k):
        return from_k.turned(self.rotation).along("x", self.out).about("x", self.spin)


@pytest.mark.parametrize("law", [pytest.param(Bent, marks=pytest.mark.slow), Arm])
def test_joints_of_ones_own(law):
    holds_and_defines(mb.report(law), law.__name__)
    holds_and_defines(mb.report(law, model=mb.Recursive()), law.__name__)


def terms_of_the_program():
    """Terms of the program of a tree: the file, what stands there, and what is put in its place."""
    motion, tree = "mbdae.symbolic.tree_motion", "mbdae.symbolic.tree"
    return [
        (motion, " + w.cross(self.speed)", ""), (motion, "e * m.second + w.cross(e) * m.rate", "e * m.second"),
        (motion, "program.vec(w.cross(arm) + self.speed)", "program.vec(arm.cross(w) + self.speed)"),
        (motion, "vec(w + spin), vec(found.al + change)", "vec(w - spin), vec(found.al + change)"),
        (motion, "self.change = self.change + e * m.second", "self.change = self.change"),
        (tree, "vec(a - al.cross(t) - w.cross(wt))", "vec(a - al.cross(t) + w.cross(wt))"),
        (tree, "vec(v - wt)", "vec(v + wt)"),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(terms_of_the_program())))
def test_terms_of_the_program_of_a_tree_are_its_report(number):
    """A term dropped or turned in the program changes the recursion that is printed, its hash, and a check says so."""
    module, old, new = terms_of_the_program()[number]
    code = "\n".join([
        "import sys, importlib, importlib.util, pathlib, mbdae",
        f"spec = importlib.util.find_spec('{module}')",
        "text = pathlib.Path(spec.origin).read_text(encoding='utf-8')",
        f"old, new = {old!r}, {new!r}",
        "assert text.count(old) == 1, old",
        "found = importlib.util.module_from_spec(spec)",
        "sys.modules[spec.name] = found",
        "exec(compile(text.replace(old, new) if sys.argv[1] == 'edited' else text, spec.origin, 'exec'), found.__dict__)",
        "import mbdae as mb",
        "print(mb.report('recursive').to_markdown())",
    ])
    without = os.environ | {"MBDAE_CACHE": "off"}  # which takes the file of the module for what runs
    run = [subprocess.run([sys.executable, "-c", code, which], capture_output=True, encoding="utf-8", check=True,
                          env=without).stdout
           for which in ("plain", "edited")]
    assert "comparisons hold" in run[0]
    assert "NOT EQUAL" in run[1]
    hashes = [re.findall(r"`([0-9a-f]{32})…`", text) for text in run]
    assert any(a != b for a, b in zip(*hashes, strict=True))
    formulas = [re.findall(r"^(.*) \\tag", text, re.M) for text in run]
    assert formulas[0] != formulas[1]


def test_models_of_a_joint():
    assert mb.report(joints.Cylindrical, model=mb.Classical()).title == "Cylindrical joint, its coordinates unknowns"
    assert mb.report(joints.Cylindrical, model=mb.Kinematic).title == "Cylindrical joint"
    assert mb.report(joints.Screw, model=mb.Kinematic()).title == mb.report(joints.Screw).title == "Screw joint"
    assert mb.report(joints.Planar, model=mb.Recursive).title == "Planar joint, recursive"
    assert mb.report("recursive").title == "Recursive joint"
    for options, said in (
        ({"model": 3}, "model = 3: give mb.Kinematic"),
        ({"model": mb.Clearance(0.0501, 0.05, mb.Hertz(1e9))}, "of all joints only mb.Revolute has clearance"),
    ):
        with pytest.raises(mb.OptionError, match=said):
            mb.report(joints.Prismatic, **options)
    with pytest.raises(mb.LawError, match="Distance has no recursive form: state motion"):
        mb.report(joints.Distance, model=mb.Recursive())


def test_options_a_joint_cannot_have():
    for law, options, said in (
        (joints.Screw, {"kept": False}, "unknowns in every joint model"),
        (joints.Spherical, {"friction": FRICTION}, "no angle or displacement against which"),
        (joints.Universal, {"friction": FRICTION, "rubs": "angle"}, r"has no such coordinate; give one of angle_k, angle_l"),
        (forces.JointSpring, {"joint": joints.Weld}, "no angle or displacement on which"),
        (forces.JointSpring, {"joint": joints.Planar, "coordinate": "z"}, "has no such coordinate"),
    ):
        with pytest.raises(mb.OptionError, match=said):
            mb.report(law, **options)


class Between(mb.Joint):
    """The point of m stays in the middle between those of k and l."""

    frames = ("k", "l", "m")

    def constraints(self, k, l, m):
        d = m.r - (k.r + l.r) / 2
        return {"x": d[0], "y": d[1], "z": d[2]}


class Bow(mb.Force):
    """An elastic string from k over a carrier to l."""

    frames = ("k", "l", "carrier")
    params = mb.params(stiffness=("N/m", "stiffness"))

    def energy(self, k, l, carrier):
        return self.stiffness * ((carrier.r - k.r).norm() + (l.r - carrier.r).norm()) ** 2 / 2


class Torn(Bow):
    """A drag of the carrier against the mean of the others: its moments do not balance."""

    def dissipation(self, k, l, carrier):
        v = carrier.v - (k.v + l.v) / 2
        return self.stiffness * (v @ v) / 2


def test_laws_on_three_frames():
    for law in (Between, Bow):
        holds_and_defines(mb.report(law), law.__name__)
    assert r"\mathbf{f}_{\text{carrier}}" in mb.report(Bow).to_markdown()
    text = mb.report(Torn).to_markdown()
    number = re.search(r"(?s)\\mathbf\{m\}_k \+ \\mathbf\{m\}_l.*?\\tag\{(\d+)\}", text)[1]
    assert f"NOT EQUAL: ({number}) both sides" in text


@pytest.mark.parametrize("name", [n for n in on_coordinates.__all__ if issubclass(vars(on_coordinates)[n], mb.Coupling)])
def test_couplings(name):
    text = mb.report(getattr(on_coordinates, name)).to_markdown()
    assert "comparisons hold" in text
    assert "h_" in text


class Rows(mb.Joint):
    """Rows of several units."""

    params = mb.params(length=("m", "length"), pitch=("m/rad", "travel per angle"), radius=("m", "radius"))

    def constraints(self, k, l):
        d = l.r - k.r
        return {"cosine": k.x @ l.y, "length": d @ k.z, "norm": d.norm() - self.length, "area": d @ d - self.length**2,
                "thread": self.pitch * self.relative_angle(k, l), "ratio": k.z @ d / self.radius,
                "sine": se.sin(k.z @ d / self.radius)}


def test_units_of_multipliers():
    """Force times row is an energy: powers of a length are counted, not guessed from what appears."""
    from mbdae.reports.joint_page import JointReport

    r = JointReport(Rows, structure_of(Rows, {}))
    assert {name: r.effort(row) for name, row in r.s.rows.items()} == {
        "cosine": "N m", "length": "N", "norm": "N", "area": "N m^-1", "thread": "N", "ratio": "N m", "sine": "N m"}


def test_friction_is_checked():
    """A wrong friction is seen by the check of the forces, and by that of the dissipated power."""
    from mbdae.reports.joint_page import JointReport

    for kept in (False, True):
        r = JointReport(mb.Revolute, structure_of(mb.Revolute, {"friction": FRICTION, "kept": kept}))
        along, push = r.s.thrust
        r.s.thrust = along, 2 * push
        text = r.document().to_markdown()
        wrong = re.findall(r"^\| \(\d+\) \$(.*?)\$,.*NO \|$", text, re.M)
        assert {"P", "Q"} <= set(wrong)
        assert (r"h_{\text{angle}}" if kept else r"\mathbf{m}^{\text{all}}_l") in wrong
