"""Errors and warnings of mbdae.

::

    MbdaeError
    ├── SceneError          what the user described cannot be modelled (all problems at once)
    │   └── StartError      no consistent start: loops that cannot close, prescribed values that contradict
    ├── LawError            a joint or force law is not well stated
    ├── OptionError         an option has a value that cannot be used (also a ValueError)
    └── SolverError         the integration stopped; carries the time, the culprit and the solution so far
        └── WallClockError  its wall-clock time was used up
    AccuracyWarning         a result does not, or may not, meet the accuracy asked for
"""

from __future__ import annotations

from typing import Any


class MbdaeError(Exception):
    """Base of every error raised on purpose by mbdae."""


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


class SolverError(MbdaeError):
    """The integration stopped before its end.

    time: where it stopped (s); culprit: name of the unknown or equation that resists;
    solution: what was computed until then, or None.
    """

    def __init__(self, message: str, time: float, culprit: str = "", solution: Any = None) -> None:
        super().__init__(message)
        self.time, self.culprit, self.solution = time, culprit, solution


class WallClockError(SolverError):
    """The wall-clock time allowed for a run was used up."""


class AccuracyWarning(UserWarning):
    """A result does not, or may not, meet the accuracy asked for."""
