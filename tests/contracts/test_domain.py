"""Motions of one's own: functions of limited domain, functions without derivatives, names of any kind."""

from __future__ import annotations

from typing import Any

import pytest
import symengine as se

import mbdae as mb


def joint(move: Any, params: dict[str, Any] | None = None, **coordinates: Any) -> type[mb.Joint]:
    """A joint class with this motion."""
    named = coordinates or {"q": ("m", "way")}
    return type("Own", (mb.Joint,), {"__doc__": "A joint.", "__module__": "own", "motion": move,
                                     "coordinates": mb.params(**named), "params": mb.params(**(params or {}))})


@pytest.mark.usefixtures("between_bodies")
@pytest.mark.parametrize("amount", [lambda q: se.asin(q / 4), se.sqrt,
                                    pytest.param(lambda q: se.log(q / 2), marks=pytest.mark.slow)])
def test_coordinates_stay_where_the_motion_is_defined(amount: Any) -> None:
    assert mb.selftest(joint(lambda self, k: k.along("x", self.q).about("z", amount(self.q)))).variants


@pytest.mark.usefixtures("between_bodies")
def test_a_motion_that_is_defined_nowhere_asks_for_parameters() -> None:
    law = joint(lambda self, k: k.along("z", self.q).along("x", se.sqrt(self.p - 5 - self.q**2)), {"p": ("m2", "area")})
    with pytest.raises(mb.OptionError, match=r"finite and real at none of .* with p = .*; give values of its parameters"):
        mb.selftest(law)
    assert mb.selftest(law, p=9).variants


@pytest.mark.parametrize(("amount", "words"), [
    (se.Abs, r"Own.motion contains abs\(q\), whose derivatives are not known: .*se.Piecewise"),
    (lambda q: se.Max(q, 0), r"Own.motion contains max\(0, q\)"),
    (lambda q: se.gamma(q + 2), r"contains gamma\(2 \+ "),
    (lambda q: mb.t * q, r"contains mb.t: state a parameter"),
    (lambda q: se.Symbol("other") * q, r"contains the symbol other, which it does not declare"),
])
@pytest.mark.parametrize("model", [None, mb.Kinematic(), mb.Classical(), mb.Recursive()])
def test_motions_that_cannot_be_derived_are_refused(amount: Any, words: str, model: Any) -> None:
    law = joint(lambda self, k: k.along("z", amount(self.q)))
    with pytest.raises(mb.LawError, match=words):
        mb.selftest(law)
    s = mb.Scene("refused")
    s.rigid_body("b", 1.0, (1, 1, 1), at=(0, 0, 0))
    s.joint(law, "j", s.ground, "b", at=(0, 0, 0), model=model)
    with pytest.raises((mb.LawError, mb.SceneError), match=words.replace("it does not", "(it|the class) does not")):
        s.simulate(0.1)


def test_a_motion_without_coordinates() -> None:
    law = type("Still", (mb.Joint,), {"motion": lambda self, k: k.along("z", 0.1), "__module__": "own"})
    with pytest.raises(mb.LawError, match=r"states a motion without coordinates: where l moves with k use mb.Weld"):
        mb.selftest(law)


@pytest.mark.usefixtures("between_bodies")
@pytest.mark.parametrize("name", ["e", *(pytest.param(n, marks=pytest.mark.slow) for n in ("pi", "I", "E", "x", "c"))])
def test_names_of_constants_and_letters(name: str) -> None:
    law = joint(lambda self, k: k.about("z", getattr(self, name)), **{name: ("rad", "turn")})
    assert mb.selftest(law).variants
    law = joint(lambda self, k: k.about("z", self.a).along("z", getattr(self, name) * self.a), {name: ("m", "pitch")},
                a=("rad", "turn"))
    assert mb.report(law)


@pytest.mark.parametrize("name", ["t", "q_c1_0", "k_P0", "named1"])
def test_names_of_derivations_are_refused(name: str) -> None:
    with pytest.raises(mb.LawError, match=rf"'{name}' in coordinates is (the time|a name that derivations use)"):
        joint(lambda self, k: k.about("z", getattr(self, name)), **{name: ("rad", "turn")})
