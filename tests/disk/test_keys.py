"""A key sees everything that what is kept depends on: the statement to the last bit, the code of mbdae,
releases, the processor."""

import inspect
import itertools
import os
from types import SimpleNamespace

import pytest
import symengine as se
import sympy

import mbdae as mb
from mbdae import disk as around
from mbdae.disk import Store
from mbdae.disk.entries import Digests, NoDigestError
from mbdae.disk.entries import key_of as entry_key
from mbdae.kernels import links
from mbdae.kernels.plan import _key
from mbdae.laws.forces import PointSpring
from mbdae.laws.joints import Revolute
from mbdae.symbolic.derive import _known, derive
from mbdae.symbolic.frames import Axes, NodeKind
from mbdae.symbolic.law import Element, Force, Structure
from mbdae.symbolic.outputs import dynamics, position
from mbdae.symbolic.statement import QUESTIONS
from mbdae.symbolic.tree_motion import Link, TreeStructure
from mbdae.symbolic.vectors import Vec

x, y = se.symbols("x y")
SPATIAL = ((NodeKind.SPATIAL, Axes.GENERAL),) * 2
FLAT = ((NodeKind.PLANAR, Axes.NORMAL),) * 2


def digest(value):
    return Digests().of(value)


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A store in use."""
    store = Store(tmp_path / "kept")
    for module in ("mbdae.symbolic.stated", "mbdae.disk.entries", "mbdae.kernels.links", "mbdae.disk.entries",
                   "mbdae.disk"):
        monkeypatch.setattr(f"{module}.store", lambda: store)
    around.surroundings.cache_clear()
    _known.cache_clear()
    yield store
    _known.cache_clear()
    around.surroundings.cache_clear()


# -- expressions


def test_expressions_that_differ_have_other_digests():
    values = [
        x, y, x + y, x * y, x**2, x**3, se.Integer(1), se.RealDouble(1.0), se.RealDouble(1.0 + 2**-52), se.Rational(1, 3),
        se.RealDouble(1 / 3), x * se.RealDouble(0.1), x * se.RealDouble(0.1 + 2**-56), se.sin(x), se.cos(x),
        se.Function("let")(x), se.Function("rate")(x), se.UnevaluatedExpr(x), se.atan2(x, y), se.atan2(y, x), se.pi, se.E,
        se.Piecewise((x, x > 0), (y, True)), se.Piecewise((x, x >= 0), (y, True)), se.Piecewise((x, y > 0), (y, True)),
        se.Max(x, y), se.Min(x, y), se.floor(x), x < y, x <= y, se.RealDouble(0.0), se.RealDouble(-0.0),
        se.atan2(x, se.RealDouble(0.0)), se.atan2(x, se.RealDouble(-0.0)), Vec(x, y, 0), [x, y], [y, x], [x, [y]], [[x], y],
        {"a": x}, {"b": x}, {"a": x, "b": y}, None, True, 1, 1.0, "1", NodeKind.POINT, Axes.GENERAL, ["a", "b"], ["ab"], ["a, b"],
    ]
    found = [digest(value) for value in values]
    for (a, first), (b, second) in itertools.combinations(zip(values, found, strict=True), 2):
        assert first != second, (a, b)


def test_zeros_of_both_signs_in_one_statement_stay_apart():
    plus, minus = (se.atan2(x, se.RealDouble(zero)) for zero in (0.0, -0.0))
    assert digest([plus, se.sin(minus)]) != digest([plus, se.sin(plus)])


def test_equal_expressions_have_equal_digests():
    assert digest(x + y * 2) == digest(2 * y + x)
    assert digest(sympy.Symbol("x") + 2 * sympy.sin("y")) == digest(x + 2 * se.sin(y))


class _Own(sympy.Function):
    pass


@pytest.mark.parametrize("value", [object(), lambda: 1, _Own(sympy.Symbol("x")), se.Dummy("x"), se.sin(se.Dummy("x")),
                                   [x, object()], 1j])
def test_what_a_digest_would_not_tell_has_none(value):
    with pytest.raises(NoDigestError):
        digest(value)


# -- laws


def spring(**changes):
    """A force law of a user, with some of its members replaced; always of the same name."""
    def energy(self, k, l):
        d = l.r - k.r
        return self.c * (d @ d) / 2

    return type("Own", (mb.Force,), {"params": mb.params(c="N/m"), "energy": energy} | changes)


def key_of(cls, structure=None, sides=SPATIAL, outputs=dynamics):
    _known.cache_clear()
    return _key(derive(cls, structure or Structure(), sides), outputs, "Plan")


def changed_energy(factor):
    return lambda self, k, l: self.c * factor * ((l.r - k.r) @ (l.r - k.r)) / 2


def test_every_part_of_a_law_is_in_its_key(kept):
    moment = {"wrench": lambda self, k, l: (self.c * (k.r - l.r), Vec(0, 0, 0))}
    state = {"states": mb.params(z="m"), "rates": lambda self, k, l: {"z": self.c - self.z},
             "initial": lambda self, k, l: {"z": 0}, "thrust": lambda self, k, l: ((l.r - k.r) @ k.x, self.z)}
    laws = [
        spring(), spring(energy=changed_energy(2)), spring(energy=changed_energy(1.0)), spring(energy=changed_energy(1 + 2**-52)),
        spring(dissipation=lambda self, k, l: self.c * (l.v @ l.v) / 2), spring(**moment), spring(**moment, dissipative=True),
        spring(external=True), spring(params=mb.params(c="N/m", d="1")), spring(gaps=lambda self, k, l: [(l.r @ k.x, l.v @ k.x)]),
        spring(gaps=lambda self, k, l: [(l.r @ k.x, l.v @ k.y)]), spring(losses=lambda self, k, l: {"impact": l.v @ l.v}),
        spring(observed=lambda self, k, l: {"size": [l.r @ l.r]}), spring(approach=lambda self, k, l: [l.r @ l.r]),
        spring(**state), spring(**state | {"initial": lambda self, k, l: {"z": 1}}),
        spring(**state | {"rates": lambda self, k, l: {"z": self.c - 2 * self.z}}),
        spring(**state | {"thrust": lambda self, k, l: ((l.r - k.r) @ k.y, self.z)}),
    ]
    keys = [key_of(law) for law in laws]
    keys += [key_of(spring(), sides=FLAT), key_of(spring(), sides=(SPATIAL[0], (NodeKind.GROUND, Axes.GENERAL))),
             key_of(spring(), Structure(timed=frozenset({"c"}))), key_of(spring(), outputs=position),
             key_of(spring(options=("flag",)), Structure(options=(("flag", True),))),
             key_of(spring(options=("flag",)), Structure(options=(("flag", False),)))]
    assert None not in keys
    assert [(a, b) for a, b in itertools.combinations(range(len(keys)), 2) if keys[a] == keys[b]] == []
    assert key_of(spring()) == keys[0]


def test_names_are_not_in_the_key(kept):
    other = type("Other", (mb.Force,), {"params": mb.params(c="N/m"), "energy": changed_energy(1)})
    assert key_of(spring()) == key_of(other)


def test_a_constant_from_elsewhere_is_in_the_key(kept):
    held = SimpleNamespace(factor=1.5)
    law = spring(energy=lambda self, k, l: self.c * held.factor * ((l.r - k.r) @ (l.r - k.r)))
    first = key_of(law)
    held.factor = 2.5
    assert key_of(law) != first


def test_absent_and_present_parameters_have_other_keys(kept):
    assert key_of(PointSpring, Structure(absent=frozenset({"damping"}))) != key_of(PointSpring)


def test_forces_by_reactions_are_in_the_key(kept):
    """A branch that looks at the very force which the derivation hands over."""
    def joint(factor):
        def rubbing(self, force, k, l):
            return None if force[0] == 0 else (self.read(k, l)["angle"], factor * force[0])

        return type("Own", (Revolute,), {"rubbing": rubbing})

    absent = Structure(absent=frozenset({"drive", "friction_radius", "scaling", "penalty"}), options=(
        ("kept", False), ("friction", None), ("rubs", None)))
    assert key_of(joint(1), absent) != key_of(joint(2), absent)
    assert key_of(joint(1), absent) == key_of(joint(1), absent)
    assert key_of(joint(1), absent) != key_of(Revolute, absent)


def test_a_law_that_cannot_be_told_is_refused(kept):
    law = spring(energy=lambda self, k, l: self.c * se.Dummy("d") * ((l.r - k.r) @ k.x))
    with pytest.raises(mb.LawError):  # the symbol is not declared: the derivation says so
        key_of(law)
    with pytest.raises(mb.LawError, match="no expression or number"):
        key_of(spring(gaps=lambda self, k, l: [(object(), 1)]))


def test_outputs_of_others_have_no_key(kept):
    assert key_of(spring(), outputs=lambda d: dynamics(d)) is None


def test_every_question_to_a_law_is_in_its_key():
    """Methods of the base classes that take frames: each is asked for the key, is told by those that are, or feeds no kernel."""
    by_reactions = {"resistance", "rubbing", "pressing"}
    parts_of_answers = {"constraints", "coordinate", "ties", "branches", "sliding", "relative_angle", "normal_force"}
    found = set()
    for cls in (mb.Joint, Force, Element, mb.Coupling):
        for name, method in inspect.getmembers(cls, inspect.isfunction):
            takes = inspect.signature(method).parameters
            if not name.startswith("_") and ({"frames", "k", "l", "b"} & takes.keys()) and name not in ("__init__",):
                found.add(name)
    assert {"energy", "rows", "kinetic_energy"} <= found
    assert found - set(QUESTIONS) - by_reactions - parts_of_answers == set()


# -- trees


def test_every_part_of_a_tree_is_in_its_key(kept):
    own = type("Own", (Revolute,), {"motion": lambda self, from_k: from_k.about("z", 2 * self.angle)})
    absent = Structure(absent=frozenset({"drive", "friction_radius", "scaling", "penalty"}), options=(
        ("kept", False), ("friction", None), ("rubs", None)))
    numbers = tuple((f"{side}_{name}", None) for side in "kl" for name in ("p1", "p2", "p3"))
    link = {"law": Revolute, "structure": absent, "parent": 0, "side": "k", "kind": NodeKind.SPATIAL, "axes": (Axes.GENERAL,) * 2,
            "numbers": numbers, "moves": True, "coordinates": ("angle",), "prescribed": (False,), "first": 1}
    others = {"law": own, "side": "l", "kind": NodeKind.PLANAR, "axes": (Axes.NORMAL, Axes.GENERAL), "numbers": numbers[:-1],
              "moves": False, "coordinates": ("other",), "prescribed": (True,), "first": 2, "parent": 1}
    trees = [TreeStructure(NodeKind.GROUND, (Link(**link),), ())]
    trees += [TreeStructure(NodeKind.GROUND, (Link(**link | {name: value}),), ()) for name, value in others.items()]
    trees += [TreeStructure(NodeKind.SPATIAL, (Link(**link),), ()), TreeStructure(NodeKind.GROUND, (Link(**link),), (), (1,)),
              TreeStructure(NodeKind.GROUND, (Link(**link), Link(**link)), ())]
    keys = [links.structure_key(tree) for tree in trees]
    assert None not in keys
    assert len(set(keys)) == len(keys)


# -- surroundings


def copied(package, text="A = 1\n"):
    package.mkdir()
    (package / "inner").mkdir()
    (package / "inner" / "a.py").write_text(text)
    (package / "b.py").write_text("B = 2\n")
    return package


def test_any_change_of_the_sources_changes_their_hash(kept, tmp_path):
    package = copied(tmp_path / "package")
    first = around.sources(package)
    assert around.sources(package) == first == around.sources(copied(tmp_path / "again"))
    file = package / "inner" / "a.py"
    before = file.stat()
    file.write_text("A = 3\n")  # the same size
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))  # and the same time
    second = around.sources(package)
    assert second != first
    file.rename(package / "a.py")
    assert around.sources(package) not in (first, second)


def test_releases_and_processor_are_in_every_key(kept, monkeypatch):
    first = around.surroundings()
    assert first, "what is derived and compiled is stored with every release of the libraries that is supported"
    for name in ("releases", "machine", "sources"):
        around.surroundings.cache_clear()
        with monkeypatch.context() as m:
            m.setattr(around, name, lambda *_: ["another"])
            assert around.surroundings() not in ("", first), name
    around.surroundings.cache_clear()
    assert around.surroundings() == first
    assert se.__version__ in around.releases()
    assert entry_key("law", "a") != entry_key("law", "b")
