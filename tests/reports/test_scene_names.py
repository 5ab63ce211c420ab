"""The sheet of scenes: every joint model and every name is read back."""

from __future__ import annotations

import pytest

import mbdae as mb
from mbdae.documents.blocks import Table, every, numbered
from mbdae.reports.mechanisms.legs import mechanism
from mbdae.system.prepare import prepare

UP, ALONG = (0, -9.81, 0), (0, 0, -9.81)


def verdict(scene: mb.Scene) -> str:
    text = mb.report(scene).to_markdown()
    found = [line for line in text.splitlines() if "comparisons hold" in line or "NOT EQUAL" in line]
    assert len(found) == 1
    return found[0]


def pendulum(tip=(1.0, 0.0), **joint) -> mb.Scene:
    s = mb.Scene("pendulum", gravity=UP)
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), tip, mass=1.0), at=(0, 0), **joint)
    return s


def double() -> mb.Scene:
    s = mb.Scene("double pendulum", gravity=UP)
    upper, lower = s.link("upper", (0, 0), (1, 0), mass=1.0), s.link("lower", (1, 0), (2, 0), mass=1.0)
    s.revolute("A", s.ground, upper, at=(0, 0))
    s.revolute("B", upper, lower, at=(1, 0))
    return s.recursive()


def spatial() -> mb.Scene:
    s = mb.Scene("spatial", gravity=ALONG)
    body = s.rigid_body("b", 2.0, (0.1, 0.2, 0.25), at=(0.3, 0, 0))
    s.revolute("R", s.ground, body, at=(0, 0, 0), axis=(0, 1, 0), model=mb.Recursive())
    return s


@pytest.mark.parametrize("scene", [
    pendulum(model=mb.Recursive()), pendulum(model=mb.Recursive(), spring=3.0, damper=0.1, torque=2.0),
    pendulum((0.6, -0.8), model=mb.Recursive(), rate0=2.0), double(), spatial(),
])
def test_balances_of_recursive_joints_hold_where_they_are_taken(scene: mb.Scene) -> None:
    assert "comparisons hold" in verdict(scene)


def two(first: str, second: str, root: str = "A", tip: str = "B") -> mb.Scene:
    s = mb.Scene("two", gravity=UP)
    u, l = s.link(first, (0, 0), (1, 0), mass=1.0), s.link(second, (1, 0), (2, 0), mass=2.0)
    s.revolute(root, s.ground, u, at=(0, 0))
    s.revolute(tip, u, l, at=(1, 0))
    return s


@pytest.mark.parametrize("names", [
    ("link-1", "link-2"), ("rod+", "rod*"), ("a'", "a"), ("m{", "m}", "\\A", "$"), ("a b", "a_b", "A_1", "A 1"), ("ab", "a b"),
])
def test_names_stay_distinct_in_formulas(names: tuple[str, ...]) -> None:
    assert "comparisons hold" in verdict(two(*names))


def test_a_name_that_is_written_otherwise_is_told() -> None:
    text = mb.report(two("rod+", "rod*")).to_markdown()
    assert "The name rod* is written rod (2)." in text
    assert "is written" not in mb.report(two("link-1", "link-2")).to_markdown()


def test_a_scene_without_rows_or_steady_start_says_so(recwarn) -> None:
    s = mb.Scene("point", gravity=ALONG)
    s.point_mass("p 摆 <i>", 1.0, at=(0, 0, 0))
    text = mb.report(s).to_markdown()
    assert "There is none: the scene has no joints." in text
    assert "There are none: the start is no steady motion" in text
    assert "floquet" not in text
    assert "A box stands for a letter" in text
    assert r"p 摆 \<i>" in text
    assert not [w for w in recwarn if "Glyph" in str(w.message) or issubclass(w.category, RuntimeWarning)]


def test_joints_without_rows_are_joints() -> None:
    s = mb.Scene("pair", gravity=UP)
    rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
    model = mb.Clearance(0.0501, 0.05, mb.Hertz(1e9, damping=0.3))
    s.revolute("hinge", s.ground, rod, at=(0, 0), model=model)
    assert "There is none: its joints have no constraint rows." in mb.report(s).to_markdown()


def test_a_joint_without_rows_is_refused() -> None:
    class Nothing(mb.Joint):
        """Nothing."""

        def constraints(self, k, l):
            return {}

    with pytest.raises(mb.LawError, match="Nothing states no rows"):
        mb.report(Nothing)


def test_a_quantity_has_one_letter():
    """The factors of couplings, in the motion and in the balances. And of bodies in space the axes of their moments are told."""
    s = mb.Scene("train", gravity=(0, -9.81, 0))
    sun, carrier, planet = (s.rigid_body(name, 1.0, (0.1, 0.1, 0.1), at=at) for name, at in
                            (("sun", (0, 0)), ("carrier", (0.05, 0)), ("planet", (0.3, 0.01))))
    s.revolute("S", s.ground, sun, at=(0, 0), angle=10 * mb.t)
    s.revolute("K", s.ground, carrier, at=(0, 0))
    s.revolute("P", carrier, planet, at=(0.3, 0))
    s.couple("ring", {"K": 4.0, "P": 2.5})
    s.couple("mesh", {"S": 3.0, "K": -2.0, "P": 0.5})
    page = mechanism(prepare(s))
    blocks = numbered([page.motion(), *page.blocks()])
    assert all(check.holds for check in page.printed(blocks))
    meanings = [row[3] for row in next(t for t in every(Table, blocks) if t.head[0] == "symbol").rows]
    factors = [words for words in meanings if words.startswith("factor") and "$" not in words]
    assert len(factors) == len({*factors}) == 5
    text = " ".join(block.text for section in page.blocks() for block in section.blocks if hasattr(block, "text"))
    assert "gyroscopic" not in text
    s = mb.Scene("arm", gravity=(0, 0, -9.81))
    s.revolute("A", s.ground, s.rigid_body("arm", 1.0, (0.1, 0.2, 0.3), at=(0.5, 0, 0)), at=(0, 0, 0), axis=(0, 1, 0.2))
    assert r"contains the gyroscopic moment $-\omega\times J\,\omega$" in mb.report(s).to_markdown()
