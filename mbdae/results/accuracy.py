"""The errors of a run as far as they are known, and why the others are not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mbdae.results.errors import Errors

WORDS = ("motion", "reactions", "mesh")  #: the three errors of a run
#: why an error is not known where the solver had a tolerance or a step of its own
RUN_ONCE = "not estimated: the solver ran once, as it was given; leave out its rtol or step, or give verify=True"
NO_RUN_BESIDE = "not estimated: no second run for comparison was completed"
NOT_REPEATED = "not measured: verify=True repeats the run on a finer mesh"
MODEL = ("how far the model itself (rigid bodies, ideal joints, laws and their numbers) differs from the real system cannot be "
         "estimated by a solver")  # fmt: skip


@dataclass(frozen=True, repr=False)
class Accuracy:
    """The largest errors of a run over its time, as far as they are known.

    asked, estimated, verified: error of the motion (positions relative to the scene's length, angles in rad, velocities relative
    to length / characteristic time; with beams positions and angles alone): asked for; estimated from a companion run of the same
    method; verified by another method; or None.
    reactions: error of the forces and torques of joints and force elements, over the largest of the run (torques are divided by
    the scene's length); from the same runs as the errors of motion and mesh.
    amplification: growth of small disturbances over the run, computed when it is read (some 50 us of CPU a step).
    mesh: error of positions and angles, all along the beams and of all bodies, caused by the elements of beams; None where it was
    not measured.
    `covers` names the errors within the accuracy asked, `not_covered` the others with the reason.
    """

    asked: float | None
    estimated: float | None
    verified: float | None = None
    mesh: float | None = None
    has_mesh: bool = False  #: False in a scene without beams, where there is no error of a mesh
    unknown: Mapping[str, str] = field(default_factory=dict)  #: name of an error -> why it is not known
    #: error of the reactions, or what computes it when it is read
    found_reactions: Callable[[], float] | float | None = field(default=None, compare=False)
    #: growth of small disturbances, or what computes it when it is read
    found_amplification: Callable[[], float | None] | float | None = field(default=None, compare=False)

    @property
    def motion(self) -> float | None:
        """Error of the motion in time: verified, else estimated."""
        return self.verified if self.verified is not None else self.estimated

    @cached_property
    def reactions(self) -> float | None:
        """Error of forces and torques over the largest force of the run (times the scene's length); None where not known."""
        return self.found_reactions() if callable(self.found_reactions) else self.found_reactions

    @cached_property
    def amplification(self) -> float | None:
        """Natural logarithm of the largest factor by which small disturbances grow from one time of the run to a later one; None
        where an impact or a switch leaves it unknown, and with more than 50 000 steps. A disturbance is measured by positions and
        angles, and by velocities in units in which they are as large. Its error is some tenths."""
        return self.found_amplification() if callable(self.found_amplification) else self.found_amplification

    @property
    def errors(self) -> Errors | None:
        """The errors of everything that the result shows; None where no other run was made, or none was kept."""
        return self.found_reactions if isinstance(self.found_reactions, Errors) else None

    @property
    def met(self) -> bool | None:
        """Whether the errors of the motion and, where measured, of the mesh are within the accuracy asked; None where none was
        asked or the error is not known. Reactions do not count: see `covers`."""
        if self.asked is None or self.motion is None:
            return None
        return self.motion <= self.asked and (self.mesh is None or self.mesh <= self.asked)

    @property
    def covers(self) -> frozenset[str]:
        """Which of "motion", "reactions" and "mesh" are within the accuracy asked. Scenes without beams have no mesh: "mesh" is
        neither here nor in `not_covered`."""
        return frozenset(self._errors) - frozenset(self.not_covered)

    @property
    def not_covered(self) -> dict[str, str]:
        """The errors that are not within the accuracy asked, each with its size, or with the reason why that is not known; and
        "model", whose error no run can measure."""
        found = {}
        for word, error in self._errors.items():
            if error is None or self.asked is None:
                found[word] = self.unknown.get(word, RUN_ONCE)
            elif not error <= self.asked:
                of = " of the largest" if word == "reactions" else ""
                found[word] = f"error of about {error:.1e}{of}, {self.asked:g} was asked"
        return found | {"model": MODEL}

    @property
    def _errors(self) -> dict[str, float | None]:
        """The errors by name: "motion", "reactions" and, in a scene with beams, "mesh"."""
        return {"motion": self.motion, "reactions": self.reactions} | ({"mesh": self.mesh} if self.has_mesh else {})

    @property
    def brief(self) -> str:
        """`covers` in one line, with the known errors of what is not covered."""
        missing = [word for word in self._errors if word not in self.covers]
        left_out = [f"{word}{f' ({self._errors[word]:.1e})' if self._errors[word] is not None else ''}" for word in missing]
        return f"covers {', '.join(word for word in self._errors if word in self.covers) or 'nothing'}" + (
            f", not {', '.join(left_out)}" if missing else "")  # fmt: skip

    def as_data(self) -> dict[str, Any]:
        """Plain data; `Accuracy(**data)` is equal to this one."""
        return {"asked": self.asked, "estimated": self.estimated, "verified": self.verified, "mesh": self.mesh,
                "has_mesh": self.has_mesh, "unknown": dict(self.unknown), "found_reactions": self.reactions,
                "found_amplification": self.amplification}  # fmt: skip

    def __repr__(self) -> str:
        told = (f"{name}={value:.2g}" for name, value in (("asked", self.asked), ("estimated", self.estimated),
                ("verified", self.verified), *self._errors.items()) if value is not None and name != "motion")  # fmt: skip
        reasons = "".join(f"\n  {word}: not covered: {why}" for word, why in self.not_covered.items())
        return f"<Accuracy {', '.join((*told, self.brief))}>{reasons}"
