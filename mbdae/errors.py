"""Errors and warnings of mbdae.

::

    MbdaeError
    ├── SceneError          the scene cannot be modelled (all problems at once)
    │   └── StartError      no consistent start: loops that cannot close, prescribed values that contradict
    ├── LawError            a joint or force law is not well stated
    ├── OptionError         an option has a value that cannot be used (also a ValueError)
    │   ├── ExpressionError an expression of mb.t where only a number has a meaning (also a TypeError)
    │   └── DiskError       a run cannot be kept in its folder, which is full or gone; with the solution so far
    ├── SolverError         the integration stopped; with the time, the culprit and the solution so far
    │   ├── WallClockError  its wall-clock time was used up
    │   └── ChatteringError the motion switches back and forth without end
    ├── StoppedError        a run kept in a folder was ended by SIGTERM; the same call goes on; with the solution so far
    ├── DerivativeError     a derivative that there is not, with the reason
    ├── EquilibriumError    no state at rest was found; with the last one under a part of the loads, and its load factor
    ├── SteadyError         the linearised equations depend on time; with their coefficients at that instant
    └── LibraryError        the compiled part of the package cannot be opened, or its changed C files cannot be compiled
    AccuracyWarning         a result does not, or may not, meet the accuracy asked for

Ctrl-C raises KeyboardInterrupt out of every function. Its text says what was stopped, and its attribute `solution` is what
was computed until then: a Result of `simulate`, a Sweep of `sweep`.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from difflib import get_close_matches
from functools import wraps
from inspect import signature
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from mbdae import process

P = ParamSpec("P")
T = TypeVar("T")


class MbdaeError(Exception):
    """Base of every error that mbdae raises itself. Pickling, as between processes, leaves out computed states."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _raised_elsewhere, (type(self), self.args, {k: v for k, v in vars(self).items() if k not in COMPUTED})


#: attributes of errors with computed states, which are left out when an error is pickled
COMPUTED = ("solution", "equilibrium", "frozen")


def _raised_elsewhere(kind: type[MbdaeError], args: tuple[Any, ...], state: dict[str, Any]) -> MbdaeError:
    error = kind.__new__(kind, *args)
    error.args = args
    vars(error).update(dict.fromkeys(COMPUTED) | state)
    return error


class SceneError(MbdaeError):
    """The scene cannot be modelled. `problems` lists every finding, one sentence each."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = list(problems)
        head = f"{len(problems)} problem{'s' if len(problems) > 1 else ''} in the scene:"
        super().__init__("\n  - ".join([head, *problems]))


class StartError(SceneError):
    """No start state satisfies the joints and the prescribed values."""


class LawError(MbdaeError):
    """A law (joint, force, element) is not well stated."""


class OptionError(MbdaeError, ValueError):
    """An option has a value that cannot be used."""


class NotReadError(OptionError):
    """A parameter of a law cannot be varied: it has no effect on the equations, or was compiled into them as a constant."""


class ExpressionError(OptionError, TypeError):
    """An expression of time was used where only a number has a meaning."""


class SolverError(MbdaeError):
    """The integration stopped before its end.

    time: where it stopped (s); culprit: name of the unknown or equation that did not converge, if one is known;
    solution: what was computed until then, or None."""

    def __init__(self, message: str, time: float, culprit: str = "", solution: Any = None) -> None:
        super().__init__(message)
        self.time, self.culprit, self.solution = time, culprit, solution


class ControllerError(MbdaeError):
    """A sampled controller failed. time: the instant (s); inputs: values of its sensors by path."""

    def __init__(self, message: str, time: float, inputs: dict[str, float]) -> None:
        super().__init__(message)
        self.time, self.inputs = time, inputs


class WallClockError(SolverError):
    """The wall-clock time allowed for a run was used up."""


class DiskError(OptionError):
    """A run or study cannot be kept where it was asked for (`checkpoint`, `resume`): the disk is full or the folder is gone. What
    is there is an earlier state, from which the same call goes on; solution: what was computed until now, or None."""

    solution: Any = None


class ChatteringError(SolverError):
    """The motion switches back and forth without end: a force jumps at a state to which it drives the motion from both sides."""


FINAL = (WallClockError, ChatteringError, DiskError)  #: errors of a run after which no other solver or tolerance is tried


class DerivativeError(MbdaeError):
    """There is no derivative by a number, or of a run, and why."""


class StoppedError(MbdaeError):
    """A run that is kept in a folder was ended by SIGTERM after a step; `solution`: until then; the same call goes on."""


class Stopping(BaseException):
    """Raised to end the process after it was asked to end (SIGTERM) and its run has been stored."""


#: what ends a call, with what was computed until then as attribute `solution`
ENDS = (KeyboardInterrupt, SystemExit, process.RaisedError, DiskError, Stopping)


def interrupted(error: BaseException, text: str, solution: Any) -> None:
    """Say in a KeyboardInterrupt what it stopped, and attach what was computed until then as `solution` to it or another of ENDS.
    The class of the exception stays: a script that does not catch it ends as Ctrl-C ends any script."""
    if isinstance(error, KeyboardInterrupt):
        error.args = (text,)
    error.solution = solution  # type: ignore[attr-defined]


@contextmanager
def keeping(solution: Any, text: str) -> Iterator[None]:
    """Context that attaches `solution` to one of ENDS raised inside; text: description of what is kept."""
    try:
        yield
    except ENDS as error:
        interrupted(error, f"interrupted: {text}", solution)
        raise


def with_text_when_interrupted(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator: a KeyboardInterrupt without a text gets the text that nothing was computed yet."""

    @wraps(function)
    def told(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return function(*args, **kwargs)
        except KeyboardInterrupt as error:
            if not error.args:
                error.args = ("interrupted before the first step, while the equations were derived and compiled",)
            raise

    return told


class EquilibriumError(MbdaeError):
    """No state at rest under the full loads was found.

    equilibrium: the last state at rest that was found, under the loads times `load_factor`; None where there is none.
    load_factor: share of the loads it belongs to, 0 to 1."""

    def __init__(self, message: str, equilibrium: Any = None, load_factor: float = 0.0) -> None:
        super().__init__(message)
        self.equilibrium, self.load_factor = equilibrium, load_factor


class SteadyError(MbdaeError):
    """The linearised equations depend on time in the frame asked for.

    frozen: the linearisation with the coefficients of that instant; its eigenvalues decide nothing about stability."""

    def __init__(self, message: str, frozen: Any = None) -> None:
        super().__init__(message)
        self.frozen = frozen


class LibraryError(MbdaeError):
    """The compiled part of the package cannot be opened, or, in a clone whose C files have changed, not be compiled."""


def internal(found: str, kind: type[Exception] = ValueError) -> Exception:
    """The error for a check between two parts of mbdae that failed: no mistake of the user. found: what was compared."""
    return kind(f"{found}. This is an error in mbdae, not in what you stated: please report it with the scene or the equations")


class AccuracyWarning(UserWarning):
    """A result does not, or may not, meet the accuracy asked for."""


def warn(text: str) -> None:
    """An AccuracyWarning that points to the line outside of mbdae from which it was called."""
    package, level, frame = str(Path(__file__).parent), 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(package):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, AccuracyWarning, stacklevel=level)


def say(text: str) -> None:
    """Tell on the error stream, by `logging` (logger "mbdae"), what goes another way or takes long: no doubt about a result."""
    import logging

    logging.getLogger("mbdae").warning("mbdae: %s", text)


def meant(name: str, known: Iterable[str]) -> str:
    """The question "did you mean ...? " with the known name closest to `name`, ignoring case; "" where no name is close."""
    by_letters = {one.lower(): one for one in known}
    close = get_close_matches(name.lower(), by_letters, 1)
    return f"did you mean '{by_letters[close[0]]}'? " if close else ""


def unknown_name(name: str, known: Iterable[str]) -> str:
    """Part of a message: an unknown name, and the known one that was probably meant; the caller adds which names are known."""
    return f"'{name}': {close}".rstrip() if (close := meant(name, known)) else f"'{name}';"


def call_refused(function: Callable[..., Any], args: tuple[Any, ...], given: Mapping[str, Any], name: str = "") -> str:
    """Message about wrong arguments of a call: which are unknown, what was probably meant, which there are; "" where they fit.
    args, given: as they are passed, with the object of a method first; name: of the function in the message."""
    known = signature(function)
    try:
        known.bind(*args, **given)
    except TypeError as error:
        parameters = list(known.parameters.values())[1 if _bound(function) else 0 :]
        names = [p.name for p in parameters]
        unknown = [key for key in given if key not in names]
        if any(p.kind is p.VAR_KEYWORD for p in parameters):
            unknown = []
        wrong = "".join(f" has no argument {unknown_name(key, names)}" for key in unknown) or f": {error};"
        return f"{name or function.__name__}(){wrong} its arguments are {', '.join(names) or 'none'}"
    return ""


def _bound(function: Callable[..., Any]) -> bool:
    """Whether a function is a method, told by the name `self` or `cls` of its first argument."""
    return next(iter(signature(function).parameters), "") in ("self", "cls")


def of_user_alone(cause: BaseException | None) -> BaseException | None:
    """The cause of an error where lines of the user's own led to it, such as those of a law, without those of mbdae."""
    if cause is None or "MBDAE_TRACEBACK" in os.environ:
        return cause
    own = process.of_user(cause.__traceback__)
    return None if own is None else cause.with_traceback(own)


def naming_arguments(function: Callable[P, T]) -> Callable[P, T]:
    """Decorator: a call with wrong arguments raises TypeError with the text of `call_refused`. Signature and docstring stay."""

    @wraps(function)
    def told(*args: P.args, **kwargs: P.kwargs) -> T:
        if process.from_user(1) and (replaced := process.heard()):
            return process.ended(told, replaced, args, kwargs)
        try:
            return function(*args, **kwargs)
        except MbdaeError as error:
            raise error.with_traceback(process.of_user(error.__traceback__)) from of_user_alone(error.__cause__)
        except TypeError:
            owner = (args[0] if isinstance(args[0], type) else type(args[0])).__name__ if args and _bound(function) else ""
            name = owner if function.__name__ == "__init__" else ".".join(filter(None, (owner, function.__name__)))
            if text := call_refused(function, args, kwargs, name):
                raise TypeError(text) from None
            raise

    told.names_arguments = True  # type: ignore[attr-defined]
    return told


def methods_naming_arguments(cls: type) -> None:
    """Decorate the public methods that a class defines, and its constructor, by `naming_arguments`, in place."""
    for name, member in list(vars(cls).items()):
        function = member.__func__ if isinstance(member, staticmethod | classmethod) else member
        named = not name.startswith("_") or name in ("__init__", "__call__")
        if named and isinstance(function, FunctionType) and not hasattr(function, "names_arguments"):
            told = naming_arguments(function)
            setattr(cls, name, type(member)(told) if function is not member else told)


class NamesArguments:
    """Base of classes whose objects users get as results of calls: the public methods are decorated by `naming_arguments`. Arrays
    that are computed once cannot be changed, since all who read them get the same ones."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        methods_naming_arguments(cls)
        process.keep_unchanged(cls)


class NamesAttributes:
    """Base of what users hold: the error for an attribute that does not exist names the closest one, and all there are. Objects
    are printed by their kind and name."""

    @property
    def _called(self) -> str:
        """Name of the object in messages, such as "revolute 'hinge'" or "a Result"."""
        own, kind = vars(self), type(self).__name__
        return f"{own.get('kind', kind.lower())} '{own['name']}'" if "name" in own else f"a {kind}"

    def __repr__(self) -> str:
        return f"<{self._called}>"

    if not TYPE_CHECKING:  # a type checker would take every attribute to exist

        def __getattr__(self, name: str) -> Any:
            if hasattr(type(self), name):  # a property that raised AttributeError itself: raise that
                return object.__getattribute__(self, name)
            if name.startswith("_"):
                raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
            known = [n for n in dir(self) if not n.startswith("_")]
            close = f"write mbdae.{name}; " if name in getattr(sys.modules.get("mbdae"), "__all__", ()) else meant(name, known)
            raise AttributeError(f"{self._called} has no '{name}': {close}it has {', '.join(known)}")


class ListsAttributes(NamesAttributes, NamesArguments):
    """Base of results; objects without a text of their own are printed with the names of what they have. What a user would set on
    them would be read by some of their parts alone, so it is refused."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_") and type(self).__module__.startswith("mbdae.") and process.from_user(1):
            known = [n for n in dir(self) if not n.startswith("_")]
            raise AttributeError(f"{self._called}: {'' if name in known else meant(name, known)}{name} cannot be set: a result "
                                 "stays as it was computed; keep values of your own beside it")
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        known = [n for n in dir(self) if not n.startswith("_")]
        return f"<{self._called.removeprefix('the ')}: {', '.join(known)}>"
