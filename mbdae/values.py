"""The first among values that are equal up to rounding, so that messages, meshes and signs of modes do not depend on rounding.

Plain Python values from what users write: numbers, whole numbers, switches, words, names, arrays.

Every function returns a plain `float`, `int`, `bool`, `str` or float array, or raises `BadValueError` with one sentence about the
value. The caller knows the item and the option and puts them before it: `option` does so for options of functions, a scene
collects the sentences as problems.
"""

from __future__ import annotations

import inspect
import math
import numbers
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from decimal import Decimal
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from mbdae.errors import NamesAttributes, OptionError

#: relative difference up to which magnitudes count as equal: solved or differentiated values have errors up to about 1e-8, and
#: which of two rows is named the worst does not matter where they differ by less
ALIKE = 1e-6
NEAR = 1e-9  #: distances whose difference, over a length, is at most this count as equal


def largest(sizes: Any) -> int:
    """Index of the first of the largest of some magnitudes (n,); those within `ALIKE` (relative) of the largest count as equal.

    Where some are not finite, the index of the first of them; raises ValueError for an empty array.
    """
    found = np.asarray(sizes, dtype=float)
    top = np.max(found)
    return int(np.argmax(found >= (1 - ALIKE) * top if np.isfinite(top) else ~np.isfinite(found)))


def nearest(distances: Any, length: float) -> int:
    """Index of the first of the smallest of some distances (n,), m; those within `NEAR` times `length` of it count as equal."""
    found = np.asarray(distances, dtype=float)
    return int(np.argmax(found <= np.min(found) + NEAR * length))


Array = NDArray[np.float64]
T = TypeVar("T")

#: magnitudes between which numbers are accepted, besides 0: products of a few of them neither overflow nor vanish in double
#: precision
LARGEST, SMALLEST = 1e100, 1e-100
MOST_COUNTED = 2**53  #: largest magnitude up to which a double represents every whole number; larger ones are refused
SHOWN = 60  #: largest number of characters of a value in a message


class BadValueError(ValueError):
    """A value that cannot be used; the text is a sentence that begins with the value."""


def shown(value: Any) -> str:
    """A value in a message: its repr, cut where it is long; never raises."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # a repr of the user's own may raise anything
        text = f"an object of class {type(value).__name__}"
    return text if len(text) <= SHOWN else text[: SHOWN - 3] + "..."


def number(value: Any, *, least: float = -math.inf, above: float = -math.inf, most: float = math.inf) -> float:
    """The value as a float: a finite number within bounds, of Python, NumPy, SymPy or symengine, a fraction or a decimal."""
    found = value if type(value) is float else _float(value)
    if math.isnan(found) or math.isinf(found):
        raise BadValueError(f"{shown(value)} is not finite")
    if abs(found) > LARGEST or 0 < abs(found) < SMALLEST:
        raise BadValueError(f"{shown(value)} is too large or too small to calculate with: numbers are 0, or "
                            f"{SMALLEST:g} to {LARGEST:g} in magnitude")
    if found < least or found <= above or found > most:
        raise BadValueError(f"{shown(value)} is not {_range(least, above, most)}")
    return found


def whole(value: Any, *, least: int | None = None, most: int | None = None) -> int:
    """The value as an int: a whole number within bounds; 3.0 counts as 3."""
    found = _float(value)
    if not found.is_integer():
        raise BadValueError(f"{shown(value)} is not a whole number")
    if abs(found) > MOST_COUNTED:
        raise BadValueError(f"{shown(value)} is too large: whole numbers are exact up to {MOST_COUNTED} in magnitude")
    low, high = -math.inf if least is None else least, math.inf if most is None else most
    if not low <= found <= high:
        raise BadValueError(f"{shown(value)} is not {_range(low, -math.inf, high)}")
    return int(found)


def flag(value: Any) -> bool:
    """The value as a bool: True or False of Python or NumPy."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise BadValueError(f"{shown(value)} is neither True nor False")


def word(value: Any, words: Iterable[str]) -> str:
    """The value as a text that is one of some words."""
    known = list(words)
    if isinstance(value, str) and value in known:
        return str(value)
    raise BadValueError(f"{shown(value)} is not one of {', '.join(repr(w) for w in known)}")


def function(value: Any, *, takes: str = "") -> Callable[..., Any]:
    """The value, a function and no class, if it can be called with the arguments that `takes` names, such as "t, y"."""
    if not callable(value) or isinstance(value, type):
        raise BadValueError(f"{shown(value)} is not a function")
    arguments = takes.split(", ") if takes else []
    try:
        inspect.signature(value).bind(*arguments)
    except TypeError as error:
        raise BadValueError(f"{shown(value)} cannot be called with ({takes}): {error}") from error
    except ValueError:
        pass  # functions written in C may have no signature to check
    return value  # type: ignore[no-any-return]


def path(value: Any) -> Path:
    """The value as a Path, from a text or an object of `os.PathLike`."""
    if isinstance(value, str | os.PathLike):
        try:
            if str(found := Path(value)) not in ("", ".") and "\0" not in str(found):
                return found
        except Exception as error:  # __fspath__ may be the user's own
            raise BadValueError(f"{shown(value)} is not a path ({error})") from error
    raise BadValueError(f"{shown(value)} is not a path that names a file or folder")


def file_to_write(value: Any, *, suffixes: Sequence[str] = ()) -> Path:
    """The value as the Path of a file that can be written: with one of some suffixes (any where none is given), in a folder that
    exists."""
    found = path(value)
    if suffixes and found.suffix.lower() not in suffixes:
        raise BadValueError(f"'{found}' does not end in {' or '.join(suffixes)}")
    try:
        folder, taken = found.parent.is_dir(), found.is_dir()
    except OSError as error:
        raise BadValueError(f"'{found}' cannot be a file: {error.strerror}") from error
    if not folder:
        raise BadValueError(f"'{found}' is in a folder '{found.parent}' that does not exist")
    if taken:
        raise BadValueError(f"'{found}' is a folder")
    return found


def several(value: Any) -> bool:
    """Whether a value is a list of others: iterable, and neither text nor mapping."""
    if isinstance(value, str | bytes | bytearray | memoryview | Mapping):
        return False
    try:
        iter(value)
    except Exception:  # iterables of the user's own may raise anything
        return False
    return True


def sequence(value: Any, each: Callable[..., T], **bounds: Any) -> list[T]:
    """The value as a list whose entries are read by `each`; a text is refused, not taken as a list of letters."""
    if isinstance(value, Set | Iterator) or not several(value):
        raise BadValueError(f"{shown(value)} is not a list")
    entries = list(value)
    try:
        return [each(entry, **bounds) for entry in entries]
    except BadValueError as wrong_entry:
        raise BadValueError(f"{shown(value)} has a wrong entry, {wrong_entry}") from None


def plain(name: str) -> str:
    """A name by which something is looked up: small letters and digits alone, so that "RadauIIA(3)" is "radauiia3"."""
    return "".join(letter for letter in name.lower() if letter.isalnum())


def of_class(value: Any, *, base: type[T]) -> T:
    """The value, which has to be an object of class `base`."""
    if isinstance(value, base):
        return value
    raise BadValueError(f"{shown(value)} is not a {base.__name__}")


def instance(value: Any, base: type[T], known: Mapping[str, T]) -> T:
    """An object of a class, from the object itself, a subclass that needs no arguments, or a name among `known`, whose keys are
    `plain`."""
    if isinstance(value, base):
        return value
    if isinstance(value, str) and plain(value) in known:
        return known[plain(value)]
    if isinstance(value, type) and issubclass(value, base):
        try:
            return value()
        except TypeError as error:
            raise BadValueError(f"{shown(value)} is a class that cannot be used without arguments ({error})") from error
    raise BadValueError(f"{shown(value)} is not one of {', '.join(repr(name) for name in known)}, nor an object of class "
                        f"{base.__name__}")


def array(value: Any, *shapes: tuple[int, ...]) -> Array:
    """The value as an array of finite numbers, of one of some shapes (any where none is given); texts, truth values and complex
    numbers are refused."""
    # a masked array exists only where numpy.ma has been imported
    if "numpy.ma" in sys.modules and isinstance(value, np.ma.MaskedArray) and np.any(value.mask):
        raise BadValueError(f"{shown(value)} has masked entries: fill them, or leave them out")
    found = np.array(value) if type(value) is list and all(type(entry) is float for entry in value) else entries(value)
    try:
        if found.dtype.kind in "iuf":
            plain: Array = np.array(found, dtype=float, subok=False)
        else:
            plain = np.array([_float(entry) for entry in found.flat], dtype=float).reshape(found.shape)
    except (TypeError, ValueError, OverflowError) as error:
        raise BadValueError(f"{shown(value)} is not {'a number' if found.ndim == 0 else 'an array of numbers'}") from error
    if shapes and plain.shape not in shapes:
        needed = " or ".join(str(shape) for shape in shapes)
        raise BadValueError(f"{shown(value)} has shape {plain.shape}, needs {needed}")
    size = np.abs(plain)
    wrong = ~(size <= LARGEST) | ((size > 0) & (size < SMALLEST))
    if wrong.any() and plain.ndim == 0:
        number(value)
    if wrong.any():
        try:
            number(float(plain[wrong].flat[0]))
        except BadValueError as wrong_entry:
            raise BadValueError(f"{shown(value)} has a wrong entry, {wrong_entry}") from None
    return plain


def entries(value: Any) -> NDArray[Any]:
    """A value as an array of objects, an array unchanged; the shape is () where the value is no list."""
    if isinstance(value, np.ndarray):
        return value
    if isinstance(value, bytes | bytearray | memoryview):
        raise BadValueError(f"{shown(value)} is not an array of numbers")
    try:
        return np.asarray(value, dtype=object)
    except Exception as error:  # sequences of the user's own may raise anything
        raise BadValueError(f"{shown(value)} is not an array") from error


def text(value: Any) -> str:
    """The value as a text that is not empty."""
    if isinstance(value, str) and value.strip():
        if not value.isprintable():
            raise BadValueError(f"{shown(value)} holds characters that cannot be printed")
        return str(value)
    raise BadValueError(f"{shown(value)} is not text" if not isinstance(value, str) else f"{shown(value)} is empty")


def optional(name: str, value: Any, read: Callable[..., T], remedy: str, **bounds: Any) -> T | None:
    """An option as `option` reads it, or None."""
    return None if value is None else option(name, value, read, remedy, **bounds)


def set_option(owner: Any, name: str, read: Callable[..., Any], remedy: str, **bounds: Any) -> None:
    """Replace an option of a frozen dataclass by the plain value; None stays where that is its default."""
    value, default = getattr(owner, name), getattr(type(owner), name, ...)
    object.__setattr__(owner, name, (optional if default is None else option)(name, value, read, remedy, **bounds))


def option(name: str, value: Any, read: Callable[..., T], remedy: str, **bounds: Any) -> T:
    """An option as `read` returns it; OptionError with name, value and what to give."""
    try:
        return read(value, **bounds)
    except BadValueError as value_and_mistake:
        raise OptionError(f"{name} = {value_and_mistake}: {remedy}") from None


def _float(value: Any) -> float:
    """The nearest double of a real number of any kind."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool | np.bool_ | str | bytes | complex | np.complexfloating | np.timedelta64) or not _is_number(value):
        raise BadValueError(f"{shown(value)} is not a number")
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError, RuntimeError, ArithmeticError) as error:
        raise BadValueError(f"{shown(value)} is not a finite real number") from error


def _is_number(value: Any) -> bool:
    """Whether a value is a real number of Python or NumPy, or an expression without symbols."""
    if isinstance(value, numbers.Real | Decimal | np.integer | np.floating):
        return True
    try:
        return hasattr(value, "free_symbols") and not value.free_symbols and hasattr(value, "__float__")
    except Exception:  # an object of the user's own may raise anything
        return False


def _range(least: float, above: float, most: float) -> str:
    """A range in words: "positive", "0 or more", "between 0 and 1" and the like."""
    if math.isinf(most):
        if above == 0:
            return "positive"
        return f"more than {above:g}" if above > least else f"{least:g} or more"
    if math.isinf(least) and math.isinf(above):
        return f"{most:g} or less"
    return f"more than {above:g}, at most {most:g}" if above > least else f"between {least:g} and {most:g}"


class Stated(dict[str, Any]):
    """Values of a statement by name, which cannot be changed."""

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise AttributeError(f"{dict(self)} is part of a statement, which alone counts: give other values there, or by mb.sweep")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> Any:
        return dict, (dict(self),)


class AsStated(NamesAttributes):
    """Base of the items of a scene: what would be set on them after their statement would be no part of it, so it is refused."""

    def _settled(self) -> bool:
        """Whether the statement is complete."""
        raise NotImplementedError

    def __setattr__(self, name: str, value: Any) -> None:
        if self._settled():
            raise AttributeError(f"{self._called}: {name} = {shown(value)} comes after its statement, which alone counts: give "
                                 f"it there, in a function that makes the scene; for many values mb.sweep(scene, "
                                 f"{{'{vars(self)['name']}.{name}': [...]}}, t_end=...), for joint models "
                                 f"scene.replace(...)")
        super().__setattr__(name, Stated(value) if type(value) is dict else value)


def fixed(values: Any) -> Any:
    """A copy of an array that cannot be changed; None stays."""
    if values is None:
        return None
    found = np.array(values)
    found.flags.writeable = False
    return found


def as_floats(model: Any, *fields: str) -> None:
    """Make floats of numbers of any type; other values stay, and the scene that uses the model reports them."""
    for key in fields:
        with suppress(BadValueError):
            object.__setattr__(model, key, number(getattr(model, key)))
