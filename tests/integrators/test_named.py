"""Solvers and forms by object, class and name alike."""

from __future__ import annotations

from dataclasses import dataclass
from inspect import isabstract

import pytest

import mbdae as mb
from mbdae.formulations import Form, form_of, form_words, forms
from mbdae.integrators.base import Solver
from mbdae.integrators.named import solver_of, solver_words, solvers

EXPORTED = [getattr(mb, name) for name in mb.__all__]


@dataclass(frozen=True)
class Mine(mb.IDA):
    """A solver of a user's own."""


@dataclass(frozen=True)
class Needy(mb.GGL):
    """A form that cannot be made without an argument."""

    needed: int = 0

    def __init__(self, needed: int) -> None:
        object.__setattr__(self, "needed", needed)


def test_every_exported_class_has_a_name() -> None:
    for base, known in ((Solver, solvers()), (Form, forms())):
        assert {c for c in EXPORTED if isinstance(c, type) and issubclass(c, base) and not isabstract(c)} == set(known)


@pytest.mark.parametrize("given", [mb.RadauIIA(3), mb.RadauIIA, "radau", "radau3", "RadauIIA", "RadauIIA(3)", "RADAU-IIA 3"])
def test_a_solver_by_object_class_and_name(given: object) -> None:
    assert solver_of(given) == mb.RadauIIA(3)


def test_all_variants_have_names() -> None:
    for made in solvers():
        assert solver_of(made.__name__) == solver_of(made) == made()
        for variant in made.variants():
            assert solver_of(variant.label) == variant
    for word, solver in solver_words().items():
        assert solver_of(word) == solver
    assert solver_of("cvode (bdf)") == mb.CVODE(method="BDF")
    assert solver_of("genalpha") == mb.GeneralizedAlpha()
    assert solver_of(Mine) == solver_of(Mine()) == Mine()
    for made in forms():
        assert form_of(made) == form_of(made.__name__) == form_of(made.__name__.lower()) == made()


@pytest.mark.parametrize("given", ["idaa", "", mb.GGL(), mb.GGL, 3, None, True, Solver])
def test_what_is_no_solver_is_refused_with_the_known_names(given: object) -> None:
    with pytest.raises(mb.OptionError, match=r"^solver = .*give a solver such as mb\.IDA\(\)"):
        solver_of(given)
    with pytest.raises(mb.OptionError, match=", ".join(repr(word) for word in form_words())):
        form_of(given if not isinstance(given, mb.GGL) and given is not mb.GGL else mb.IDA)


def test_a_class_that_needs_arguments_is_named() -> None:
    with pytest.raises(mb.OptionError, match="is a class that cannot be used without arguments"):
        form_of(Needy)
