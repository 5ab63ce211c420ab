"""The compiled library of the native core, opened once.

A wheel contains it. In a clone it was compiled at installation; where the C files or MBDAE_CFLAGS have changed since, it is
compiled again in place before it is opened.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from functools import cache
from typing import Any

from mbdae.errors import LibraryError
from mbdae.native import build

#: version number of the interface between C and Python. It has to equal `mbdae_interface` of version.c, or the library is refused
INTERFACE = 13


@cache
def library() -> ctypes.CDLL:
    """The library, compiled again if its C files have changed; `declared` states the types of its functions."""
    if build.sources() and not build.is_current():
        rebuild()
    try:
        opened = ctypes.CDLL(str(build.LIBRARY))
        found = opened.mbdae_interface()
    except (OSError, AttributeError) as error:
        raise LibraryError(f"The native core of mbdae cannot be opened: {error}. Install mbdae again on this machine, as before "
                           "and with the options --force-reinstall --no-deps of pip") from error  # fmt: skip
    if found != INTERFACE:
        raise LibraryError(f"{build.LIBRARY} has interface {found}, the Python files beside it need {INTERFACE}: they are of "
                           "different versions. Install mbdae again")  # fmt: skip
    return opened


def declared(*functions: tuple[str, Any, tuple[Any, ...]]) -> Callable[[], Any]:
    """A function that opens the library and states the types of some of its functions for ctypes. functions: of each its name,
    the type of its result and those of its arguments."""

    @cache
    def opened() -> Any:
        found = library()
        for name, result, arguments in functions:
            function = getattr(found, name)
            function.restype, function.argtypes = result, arguments
        return found

    return opened


def rebuild() -> None:
    """Compile the library of a clone again; warnings of the compiler go to standard error."""
    try:
        said = build.compile_library(build.compiler())
    except build.BuildError as error:
        state = "is older than its C files" if build.LIBRARY.is_file() else "was not compiled yet"
        raise LibraryError(f"The native core of this clone of mbdae {state}, and compiling it failed.\n{error}") from error
    if said:
        print(said, file=sys.stderr, end="")
