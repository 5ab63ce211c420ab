"""Forms by object, class or name. The names follow from the classes."""

from __future__ import annotations

from functools import cache
from typing import Any

from mbdae.deferred import classes_in
from mbdae.formulations.base import Form
from mbdae.values import instance, option, plain

REMEDY = "give a form such as mb.GGL(), mb.Index3() or 'ggl', or None for the default of the scene"


def forms() -> tuple[type[Form], ...]:
    """The forms of the package: every class in its folder that derives from `Form`."""
    return classes_in("mbdae.formulations", Form)


@cache
def form_words() -> dict[str, Form]:
    """Word of every form, as a command line takes it -> the form with its defaults: "ggl", "index3", "index1", "ode"."""
    return {plain(made.__name__): made() for made in forms()}


def form_of(value: Any, name: str = "form", remedy: str = REMEDY) -> Form:
    """The form that an object, a class (the user's own too) or a name stands for; OptionError with the known names."""
    found: Form = value if isinstance(value, Form) else option(name, value, instance, remedy, base=Form, known=form_words())
    return found
