"""A drawn run and its verdict: right, told, silent, refused or crashed."""

from __future__ import annotations

import itertools
import time
import traceback
import warnings
from dataclasses import dataclass
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
from strangers.bodies import Array, NotStatedError
from strangers.closing import can_close
from strangers.dense import Reference
from strangers.elastic import elastic_truth
from strangers.reactions import FACTOR as FACTOR_OF_REACTIONS
from strangers.reactions import error_of_reactions
from strangers.story import Story, build, options, scene_text
from timed_inputs.judge import FACTOR, error_of, told

import mbdae as mb
from mbdae.results.result import Result

WALL = 20.0  #: of a run, s
RTOL = 3e-10  #: of the reference; a hundredth where a run seems wrong
START = 1e-7  #: a start that violates joints or stated rates by more is wrong
WRONG = ("silent", "refused", "crashed", "wrong start")


@dataclass(frozen=True)
class Verdict:
    """What became of a story: verdict, error over what is claimed, remark."""

    verdict: str
    ratio: float = nan
    note: str = ""
    cpu: float = 0.0

    @property
    def wrong(self) -> bool:
        """Whether nobody was told."""
        return self.verdict in WRONG

    def __str__(self) -> str:
        return f"{self.verdict}: error {self.ratio:.3g} x accuracy; {self.note}"


def simulate(story: Story, scene: mb.Scene | None = None, **more: Any) -> Result:
    """The run as the script makes it, within WALL."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return (scene or build(story)).simulate(story.t_end, **{"accuracy": story.accuracy, "max_wall": WALL, **options(story),
                                                                **more})


def claims(result: Result) -> bool:
    """Whether a result claims an accuracy of its motion, and says nothing against itself."""
    return "motion" in result.accuracy.covers and not told(result)


def attempt(story: Story, **more: Any) -> Result | Verdict:
    """A result, or the verdict on a run that returned none."""
    try:
        return simulate(story, **more)
    except (mb.SceneError, mb.LawError) as error:
        return Verdict("refused", note=text(error))
    except mb.MbdaeError as error:
        return Verdict("told", note=text(error))
    except Exception as error:  # a verdict too
        return Verdict("crashed", note=text(error))


def text(error: Exception) -> str:
    """In one line, with the place that raised it."""
    place = traceback.extract_tb(error.__traceback__)[-1:]
    where = "".join(f" ({Path(f.filename).name}:{f.lineno})" for f in place)
    return " ".join(f"{type(error).__name__}: {error}".split())[:400] + where


def instants(story: Story, ends: list[float]) -> Array:
    """Times at which a run is judged: equal ones and some inside every piece."""
    narrow = sorted(itertools.pairwise(ends), key=lambda e: e[1] - e[0])[:40]
    inside = [np.linspace(a, b, 4) for a, b in narrow]
    times = np.unique(np.concatenate([np.linspace(0, story.t_end, 61), *inside]))
    return np.asarray(times[(times >= 0) & (times <= story.t_end)])


def judge(story: Story) -> Verdict:
    """One run against the reference."""
    begin = time.process_time()
    try:
        found = _judged(story)
    except Exception as error:  # of a result that is looked at
        found = Verdict("crashed", note=text(error))
    return Verdict(found.verdict, found.ratio, found.note, time.process_time() - begin)


def _judged(story: Story) -> Verdict:
    result = attempt(story)
    if isinstance(result, Verdict):
        apart = any(words in result.note for words in ("cannot close", "outside its limits"))
        apart = apart and result.verdict == "refused" and not can_close(story)
        return Verdict("not judged", note="least squares find no pose within the limits either") if apart else result
    if not claims(result):
        return Verdict("told", note=told(result) or "claims no accuracy of its motion")
    try:
        return elastic_truth(story, result) if story.of("beam") else _compared(story, result)
    except NotStatedError as error:
        return Verdict("not judged", note=str(error))
    except ArithmeticError as error:
        return Verdict("not judged", note=text(error))


@dataclass(frozen=True)
class _Truth:
    """A reference that serves every run of a scene: the scene, its equations, start, times (nt,), states and sensors there."""

    scene: str
    reference: Reference
    start: Array
    times: Array
    states: list[Array]
    values: Any


_last: list[_Truth] = []  #: the one before, because a scene is run in several ways


def _truth(story: Story, result: Result) -> _Truth | Verdict:
    reference, scene = Reference(story), f"{story.t_end} {scene_text(story.but(model=''))}"
    y = reference.start(result(0.0))
    wrong = reference.wrong_start(y)
    if wrong > START:
        return Verdict("wrong start", wrong / story.accuracy, f"joints or stated rates are violated by {wrong:.2e}")
    if not (_last and _last[0].scene == scene and np.allclose(_last[0].start, y, rtol=0, atol=1e-9)):
        times = instants(story, reference.instants())
        states = reference.solve(y, times, RTOL)
        _last[:] = [_Truth(scene, reference, y, times, states, reference.shown(states))]
    return _last[0]


def _compared(story: Story, result: Result) -> Verdict:
    truth = _truth(story, result)
    if isinstance(truth, Verdict):
        return truth
    contact = bool(result.prepared.contacts)
    error = error_of(result, truth.times, truth.values, contact, story.t_end)
    pushed = error_of_reactions(truth.reference, truth.times, truth.states, result) * FACTOR / FACTOR_OF_REACTIONS
    if max(error, pushed) <= FACTOR * story.accuracy:
        return Verdict("right", error / story.accuracy)
    again = Reference(story)
    states = again.solve(truth.start, truth.times, RTOL / 100)
    if error > FACTOR * story.accuracy:
        return settled(story, result, error, error_of(result, truth.times, again.shown(states), contact, story.t_end))
    finer = error_of_reactions(again, truth.times, states, result) * FACTOR / FACTOR_OF_REACTIONS
    found = settled(story, result, pushed, finer, "reactions, ")
    return found if found.verdict == "silent" else Verdict("right", error / story.accuracy)


def settled(story: Story, result: Result, error: float, finer: float, what: str = "") -> Verdict:
    """The verdict on an error that a finer reference finds too, or does not."""
    if abs(finer - error) > 0.3 * max(finer, error) or finer == inf:
        return Verdict("not judged", finer / story.accuracy, f"references differ: errors {error:.2e} and {finer:.2e}")
    note = f"{what}asked {story.accuracy:.0e}; {result.info.choice or result.info.solver}"
    return Verdict("silent" if finer > FACTOR * story.accuracy else "right", finer / story.accuracy, note)

