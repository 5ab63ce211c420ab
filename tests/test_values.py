"""Numbers of every kind become plain ones; everything else is refused with a sentence that shows the value."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import symengine as se
import sympy as sp

from mbdae.errors import OptionError
from mbdae.values import (
    BadValueError,
    array,
    entries,
    file_to_write,
    flag,
    function,
    number,
    option,
    sequence,
    shown,
    text,
    whole,
    word,
)

NUMBERS = [0.5, np.float32(0.5), np.float64(0.5), np.array(0.5), Fraction(1, 2), Decimal("0.5"),
           sp.Rational(1, 2), se.Rational(1, 2)]
REFUSED = [True, np.True_, "0.5", b"0.5", None, 1j, np.complex128(1), sp.I, sp.zoo, sp.Symbol("w"), [0.5], np.array([0.5]), {},
           math.nan, math.inf, Decimal("nan"), 1e308, 10**400, 5e-324, float, math]


@pytest.mark.parametrize("value", NUMBERS, ids=lambda v: type(v).__name__)
def test_every_kind_of_number_becomes_a_float(value: object) -> None:
    assert number(value) == 0.5
    assert type(number(value)) is float
    assert array([value, value]).tolist() == [0.5, 0.5]


@pytest.mark.parametrize("value", REFUSED, ids=lambda v: shown(v)[:20])
def test_what_is_no_number_is_refused_with_the_value(value: object) -> None:
    with pytest.raises(BadValueError) as found:
        number(value)
    assert str(found.value).startswith(shown(value))
    with pytest.raises(BadValueError):
        array([[value, 1.0], [1.0, 1.0]])


def test_bounds_are_told() -> None:
    for bounds, value, told in (({"above": 0}, 0, "0 is not positive"), ({"least": 0}, -1, "-1 is not 0 or more"),
                                ({"least": 0, "most": 1}, 2, "2 is not between 0 and 1"),
                                ({"above": 0, "most": 1}, 0, "0 is not more than 0, at most 1")):
        with pytest.raises(BadValueError, match=f"^{told}$"):
            number(value, **bounds)
    assert number(0, least=0) == 0
    with pytest.raises(BadValueError, match=r"^2\.5 is not a whole number$"):
        whole(2.5)
    with pytest.raises(BadValueError, match=r"^0 is not 1 or more$"):
        whole(0, least=1)
    assert whole(np.int64(3)) == whole(3.0) == 3


def test_words_switches_and_shapes() -> None:
    assert word("a", "ab") == "a"
    assert flag(np.True_) is True
    for read, value in ((word, "c"), (word, ["a"]), (flag, 1), (flag, "yes")):
        with pytest.raises(BadValueError):
            read(value, "ab") if read is word else read(value)
    with pytest.raises(BadValueError, match=r"has shape \(2,\), needs \(3,\)"):
        array([1, 2], (3,))


def test_arrays_are_the_users_no_more_and_show_what_he_wrote() -> None:
    given = np.ones(3)
    array(given)[:] = 7
    assert given.tolist() == [1, 1, 1]
    assert type(array(np.ma.array([1.0]))) is np.ndarray
    for value, told in (((0, math.inf), r"^\(0, inf\) has a wrong entry, inf is not finite$"),
                        (Decimal("nan"), r"^Decimal\('NaN'\) is not finite$"),
                        (np.ma.array([1.0, 2.0], mask=[0, 1]), "masked entries: fill them"), (b"12", "not an array of numbers$"),
                        (bytearray(b"12"), "not an array of numbers$"),
                        (np.timedelta64(1, "s"), "is not a number$")):
        with pytest.raises(BadValueError, match=told):
            array(value)
    assert entries([1, [2, 3]]).shape == (2,)
    assert text(np.str_("rod")) == "rod"
    assert type(text(np.str_("rod"))) is str
    for value in ("", " ", b"rod", 5, None):
        with pytest.raises(BadValueError):
            text(value)


def test_an_option_is_named_with_its_value_and_what_to_give() -> None:
    with pytest.raises(OptionError, match=r"^accuracy = 'x' is not a number: give a positive number such as 1e-6$"):
        option("accuracy", "x", number, "give a positive number such as 1e-6", above=0)
    assert option("accuracy", 1e-6, number, "", above=0) == 1e-6


def test_a_value_is_shown_short_whatever_its_repr_does() -> None:
    class Loud:
        def __repr__(self) -> str:
            raise RuntimeError

    assert shown(Loud()) == "an object of class Loud"
    assert len(shown("x" * 1000)) == 60
    assert "\n" not in shown(np.ones((5, 5)))


def test_functions_are_asked_for_their_arguments() -> None:
    assert function(print, takes="t, y") is print
    for value, told in ((lambda t: t, "too many positional arguments"), (float, "is not a function"), ("f", "is not a function")):
        with pytest.raises(BadValueError, match=told):
            function(value, takes="t, y")


def test_paths_of_files_that_can_be_written(tmp_path: Path) -> None:
    assert file_to_write(str(tmp_path / "a.PNG"), suffixes=(".png", ".svg")) == file_to_write(tmp_path / "a.PNG")
    for value, told in ((3, "3 is not a path"), (b"a", "b'a' is not a path"), ("", "'' is not a path"), ("a\0", "is not a path"),
                        (tmp_path, "is a folder"), (tmp_path / "b" / "a", "in a folder '.*b' that does not exist"),
                        ("x" * 5000, "cannot be a file")):
        with pytest.raises(BadValueError, match=told):
            file_to_write(value)
    with pytest.raises(BadValueError, match=r"'a\.gif' does not end in \.png or \.svg"):
        file_to_write("a.gif", suffixes=(".png", ".svg"))


def test_lists_are_read_entry_by_entry_and_texts_are_none() -> None:
    assert sequence(np.array([1, 2]), number, above=0) == [1.0, 2.0]
    for value, told in (("ab", "'ab' is not a list"), (3, "3 is not a list"), ({1: 2}, "is not a list"), ({1.0}, "is not a list"),
                        (np.array(1.0), "is not a list"),
                        ([1, -2], r"\[1, -2\] has a wrong entry, -2 is not positive")):
        with pytest.raises(BadValueError, match=told):
            sequence(value, number, above=0)


def test_counts_are_exact() -> None:
    for value in (1e17, 10**30, 2**53 + 2):
        with pytest.raises(BadValueError, match="is too large: whole numbers are exact up to"):
            whole(value)
