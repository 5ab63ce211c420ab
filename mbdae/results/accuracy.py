"""What is known of the error of a run, and what it says nothing of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

WORDS = ("motion", "reactions", "mesh")  #: whose errors are told apart
#: of a run whose solver had a tolerance or a step of its own
RUN_ONCE = "not estimated: the solver ran once, as it was given; leave out its rtol or step, or give verify=True"
NO_RUN_BESIDE = "not estimated: no other run came to an end beside this one"
NOT_REPEATED = "not measured: verify=True repeats the run on a finer mesh"
MODEL = ("the scene is solved as it is stated: what its rigid bodies, ideal joints, laws and their numbers are beside the real "
         "ones, no solver can tell")  # fmt: skip


@dataclass(frozen=True, repr=False)
class Accuracy:
    """What is known of the error of a run: bounds of the largest error over its time.

    asked, estimated, verified: of the motion (positions relative to the scene's length, angles in rad, velocities relative to
    length / characteristic time; with beams positions and angles alone); estimated by a companion run of the same method,
    verified by another method, or None.
    reactions: of the forces and torques that joints and force elements show, over the largest of the run (torques count over
    the scene's length); by the runs that told the errors of the motion, in time and of the mesh.
    mesh: of the positions and angles that the elements of beams cause, all along the beams and of all bodies; None where it
    was not measured.
    `covers` names what is within the accuracy asked, `not_covered` the rest with its reason.
    """

    asked: float | None
    estimated: float | None
    verified: float | None = None
    mesh: float | None = None
    has_mesh: bool = False  #: False in a scene without beams, where there is no error of a mesh
    unknown: Mapping[str, str] = field(default_factory=dict)  #: why an error is not known, by its word
    found_reactions: Callable[[], float] | float | None = field(default=None, compare=False)  #: evaluated where it is read first

    @property
    def motion(self) -> float | None:
        """The best knowledge of the error of the motion in time: verified, else estimated."""
        return self.verified if self.verified is not None else self.estimated

    @cached_property
    def reactions(self) -> float | None:
        """Error of forces and torques over the largest force of the run (times the scene's length); None where not known."""
        return self.found_reactions() if callable(self.found_reactions) else self.found_reactions

    @property
    def met(self) -> bool | None:
        """Whether the motion is within what was asked, by the best that is known of its errors in time and, where it was
        measured, of the mesh; None where nothing was asked. Reactions do not count: see `covers`."""
        if self.asked is None or self.motion is None:
            return None
        return self.motion <= self.asked and (self.mesh is None or self.mesh <= self.asked)

    @property
    def covers(self) -> frozenset[str]:
        """Which of "motion", "reactions" and "mesh" are within the accuracy asked, as far as runs can tell. Scenes without
        beams have no mesh: "mesh" is neither here nor in `not_covered`."""
        return frozenset(self._errors) - frozenset(self.not_covered)

    @property
    def not_covered(self) -> dict[str, str]:
        """The others, each with its reason, or with its error where that is known; and "model", of which no run says anything."""
        found = {}
        for word, error in self._errors.items():
            if error is None or self.asked is None:
                found[word] = self.unknown.get(word, RUN_ONCE)
            elif not error <= self.asked:
                found[word] = f"about {error:.1e}{' of the largest' if word == 'reactions' else ''}, {self.asked:g} was asked"
        return found | {"model": MODEL}

    @property
    def _errors(self) -> dict[str, float | None]:
        """Every error there is, by its word."""
        return {"motion": self.motion, "reactions": self.reactions} | ({"mesh": self.mesh} if self.has_mesh else {})

    @property
    def brief(self) -> str:
        """What is covered, in a line; the known errors of what is not."""
        missing = [word for word in self._errors if word not in self.covers]
        left_out = [f"{word}{f' ({self._errors[word]:.1e})' if self._errors[word] is not None else ''}" for word in missing]
        return f"covers {', '.join(word for word in self._errors if word in self.covers) or 'nothing'}" + (
            f", not {', '.join(left_out)}" if missing else "")  # fmt: skip

    def as_data(self) -> dict[str, Any]:
        """Plain data of which `Accuracy(**data)` is equal."""
        return {"asked": self.asked, "estimated": self.estimated, "verified": self.verified, "mesh": self.mesh,
                "has_mesh": self.has_mesh, "unknown": dict(self.unknown), "found_reactions": self.reactions}  # fmt: skip

    def __repr__(self) -> str:
        told = (f"{name}={value:.2g}" for name, value in (("asked", self.asked), ("estimated", self.estimated),
                ("verified", self.verified), *self._errors.items()) if value is not None and name != "motion")  # fmt: skip
        reasons = "".join(f"\n  {word}: not covered: {why}" for word, why in self.not_covered.items())
        return f"<Accuracy {', '.join((*told, self.brief))}>{reasons}"
