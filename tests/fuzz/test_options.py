"""Every option of every public callable outside a scene's statements, replaced by every hostile value, one at a time.

The callables and their options are read from the code: a new one fails `test_every_public_callable_is_here` or
`test_every_option_has_a_good_value` until `calls.py` names it. Where a call would work, it is stopped (`Call.stop`) at the first
function that does: what reaches it has been accepted.
"""

from __future__ import annotations

import inspect
import sys
import warnings
from contextlib import nullcontext
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from mbdae.errors import MbdaeError
from mbdae.values import shown

sys.path.insert(0, str(Path(__file__).parent))

import calls
from hostile import HOSTILE, ONES, SIGNS

#: how an option is named in messages where that is not its own name
CALLED = {("Stepper.__getitem__", "path"): "sensor",
          ("Result.__getitem__", "name"): "r[|item", ("Mode.__getitem__", "body"): "mode[", ("Result.read", "path"): "sensor",
          ("Result.phase", "x"): "sensor", ("Result.phase", "y"): "sensor", ("Result.plot", "sensors"): "sensor",
          ("Result.animate", "sensors"): "sensor", ("Result.animate", "trail"): "trail|item",
          ("Result.orbit", "place"): "place|item", ("SceneData.replace", "names"): "joint",
          ("Audit.__getitem__", "number"): "equation", ("audit", "source"): "source|file",
          ("Equilibrium.save", "path"): "equilibrium"}


class ReachedError(Exception):
    """A call got through to where it works; `args` are those of that function."""


def _reach(*args: Any, **kwargs: Any) -> Any:
    raise ReachedError(*args, *kwargs.values())


def options(name: str) -> list[str]:
    """Names of the options of a callable, in their order."""
    found = inspect.signature(calls.CALLS[name].make()).parameters.values()
    return [p.name for p in found if p.kind is not inspect.Parameter.VAR_KEYWORD]


def outcome(name: str, option: str, value: Any) -> tuple[str, str]:
    """ "accepted" with what was made of it, or "refused" with the message; anything else comes out."""
    call = calls.CALLS[name]
    function, good = call.make(), call.good() | {option: value}
    first, rest = [], {}
    for p in inspect.signature(function).parameters.values():
        if p.kind is inspect.Parameter.VAR_POSITIONAL:
            first.append(good[p.name])
        elif p.kind is not inspect.Parameter.VAR_KEYWORD:
            rest[p.name] = good[p.name]
    try:
        with patch(call.stop, _reach) if call.stop else nullcontext(), warnings.catch_warnings():
            warnings.simplefilter("error")
            return "accepted", told(function(*first, **rest))
    except ReachedError as reached:
        return "accepted", told(reached.args)
    except MbdaeError as error:
        return "refused", str(error)


def told(value: Any) -> str:
    """What can be compared of a value: plain ones as they are, others by their class."""
    if value is None or isinstance(value, bool | int | float | str):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.tolist()}"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(told, value))})"
    if isinstance(value, dict):
        return told([*value, *value.values()])
    frozen = is_dataclass(value) and value.__dataclass_params__.frozen  # others are states of a run
    return repr(value) if frozen and "at 0x" not in repr(value) else type(value).__name__


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that are written go into a folder of their own."""
    monkeypatch.chdir(tmp_path)


CASES = [(name, option) for name in calls.CALLS for option in options(name)]


def test_every_public_callable_is_here() -> None:
    assert calls.public() == set(calls.CALLS)


@pytest.mark.parametrize("name", calls.CALLS)
def test_every_option_has_a_good_value(name: str) -> None:
    assert list(calls.CALLS[name].good()) == options(name)
    for option in options(name)[:1]:
        found = outcome(name, option, calls.CALLS[name].good()[option])
        assert found[0] == "accepted" or name in ("Equilibrium.save", "Audit.__getitem__"), found


@pytest.mark.parametrize(("name", "option"), CASES, ids=lambda part: part)
def test_hostile_values_are_refused_by_name_and_value(name: str, option: str) -> None:
    accepted, wrong = set(), []
    otherwise, _ = calls.OTHERWISE.get((name, option), (set(), ""))
    default = inspect.signature(calls.CALLS[name].make()).parameters[option].default
    values = HOSTILE | SIGNS | ({} if default is None else {"none": None})
    for what, value in values.items():
        try:
            result, text = outcome(name, option, value)
        except Exception as error:
            result, text = "raised", f"{type(error).__name__}: {error}"
        if result == "accepted":
            accepted.add(what)
        elif what not in otherwise and not (result == "refused" and names(name, option, text) and shown(value) in text):
            wrong.append(f"{what} {result}: {text}")
    assert not wrong, "\n".join(wrong)
    assert accepted == calls.legitimate(name, option)


def names(name: str, option: str, text: str) -> bool:
    """Whether a message names an option."""
    return any(word in text for word in CALLED.get((name, option), option).split("|"))


@pytest.mark.parametrize(("name", "option"), CASES, ids=lambda part: part)
def test_numbers_of_all_libraries_are_alike(name: str, option: str) -> None:
    """Accepted with the same plain values as 1.0, or refused with the same words but for the value."""
    result, text = outcome(name, option, 1.0)
    for what, value in ONES.items():
        found, said = outcome(name, option, value)
        expected = text if result == "accepted" else text.replace(shown(1.0), shown(value))
        assert (found, said) == (result, expected), what


def test_that_is_many_cases() -> None:
    assert len(CASES) * (len(HOSTILE) + len(SIGNS) + len(ONES)) > 5000


@pytest.mark.parametrize("name", calls.CALLS)
def test_an_unknown_argument_is_named_with_those_that_are_known(name: str) -> None:
    """With the one that was probably meant; signature and text stay those of the function."""
    function, good = calls.CALLS[name].make(), calls.CALLS[name].good()
    given = inspect.signature(function).parameters
    if any(p.kind is inspect.Parameter.VAR_KEYWORD for p in given.values()) or name.endswith("__getitem__"):
        return
    by_name = [p.name for p in given.values() if p.kind is not inspect.Parameter.VAR_POSITIONAL]
    wrong = f"{by_name[-1]}x"
    with pytest.raises(TypeError) as refused:
        function(**{option: good[option] for option in by_name[:-1]}, **{wrong: 1})
    said = str(refused.value)
    assert f"has no argument '{wrong}': did you mean '{by_name[-1]}'? its arguments are {', '.join(given)}" in said
    assert name.partition(".")[2] in said
