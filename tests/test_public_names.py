"""The public name list is true, sorted and light to import."""

from __future__ import annotations

import subprocess
import sys

import pytest

import mbdae


def test_names_are_sorted_and_have_a_home() -> None:
    constants = [n for n in mbdae.__all__ if n.isupper()]
    classes = [n for n in mbdae.__all__ if n[0].isupper() and not n.isupper()]
    functions = [n for n in mbdae.__all__ if n[0].islower()]
    assert mbdae.__all__ == [*sorted(constants), *sorted(classes), *sorted(functions)]
    assert list(mbdae._HOME) == sorted(mbdae._HOME)
    here = {"t"} | {name for name in mbdae.__all__ if name.endswith(("Error", "Warning"))}
    assert set(mbdae.__all__) == set(mbdae._HOME) | here


def test_every_name_resolves() -> None:
    """In a process of its own; names of functions that are names of modules too have the last test for themselves."""
    code = """
import mbdae
from importlib import import_module
for name in mbdae.__all__:
    value = getattr(mbdae, name)
    assert name in dir(mbdae)
    elsewhere = name in mbdae._HOME and name not in ("audit", "compare", "extremes", "selftest", "sweep")
    assert not elsewhere or value is getattr(import_module(mbdae._HOME[name]), name), name
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_unknown_name() -> None:
    with pytest.raises(AttributeError, match="module 'mbdae' has no attribute 'Revolut'"):
        mbdae.Revolut  # noqa: B018


def test_import_is_light() -> None:
    code = "import sys, mbdae; print([m for m in ('sympy', 'symengine', 'matplotlib', 'scipy', 'sksundae') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_functions_survive_the_import_of_their_package() -> None:
    """`import mbdae.compare` imports a package that has the name of a function; the public name must stay the function."""
    code = "import mbdae, mbdae.compare; from mbdae.compare.comparison import compare; assert mbdae.compare is compare"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
