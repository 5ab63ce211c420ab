"""Solvers by object, class or name; the names are derived from the classes."""

from __future__ import annotations

from functools import cache
from typing import Any

from mbdae.deferred import classes_in
from mbdae.errors import OptionError
from mbdae.integrators.base import Solver
from mbdae.values import instance, option, plain, shown

REMEDY = "give a solver such as mb.IDA(), mb.RadauIIA(3) or 'radau3'"


def solvers() -> tuple[type[Solver], ...]:
    """The solvers of the package: every class in its folder that derives from `Solver`."""
    return classes_in("mbdae.integrators", Solver)


@cache
def solver_words() -> dict[str, Solver]:
    """All solvers with default options, by their names on the command line: "ida", "radau", "radau2", "cvodebdf"."""
    found: dict[str, Solver] = {}
    for made in solvers():
        word = made.word or plain(made.__name__)
        for variant in made.variants():
            found.setdefault(word, made())
            found[plain(variant.label).replace(plain(made.__name__), word)] = variant
    return found


@cache
def _full_names() -> dict[str, Solver]:
    """All solvers by their labels without punctuation, in small letters: "radauiia3", "generalizedalpha"."""
    by_label = {plain(variant.label): variant for made in solvers() for variant in made.variants()}
    return {plain(made.__name__): made() for made in solvers()} | by_label


@cache
def _elsewhere() -> dict[str, list[str]]:
    """Names of methods in other programs, with the names of their counterparts among the solvers."""
    found: dict[str, list[str]] = {}
    for made in solvers():
        for name, own in vars(made).get("counterparts", {}).items():
            found.setdefault(name, []).append(f"'{own}'")
    return found


def solver_of(value: Any, name: str = "solver", remedy: str = REMEDY) -> Solver:
    """The solver that an object, a class (the user's own too) or a name stands for; OptionError with the known names."""
    if isinstance(value, Solver):  # the list of all would import them
        return value
    meant = _full_names().get(plain(value), value) if isinstance(value, str) else value
    if isinstance(meant, str) and (own := _elsewhere().get(plain(meant))):
        raise OptionError(f"{name} = {shown(value)} is a method of other programs; its counterpart here is {' or '.join(own)}")
    found: Solver = option(name, meant, instance, remedy, base=Solver, known=solver_words())
    return found
