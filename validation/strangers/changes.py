"""Metamorphic checks: the same scene stated, seen or run in another way has the same motion and the same reactions."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from math import isnan, nan
from pathlib import Path
from typing import Any

import numpy as np
from strangers import laws
from strangers.arguments import Change, changed
from strangers.bodies import Array, rods
from strangers.dense import Reference
from strangers.elastic import pieces
from strangers.judge import WRONG, Verdict, attempt, claims
from strangers.story import Along, Feed, Input, Said, Story
from timed_inputs.judge import error_of, told

import mbdae as mb
from mbdae.results.result import Result

FACTOR = 10.0  #: difference over the accuracy asked up to which two runs are the same
NONE = Change()
TURNED = Change(Q=np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]]), by=np.array([0.3, -0.2, 0.5]))
TURNED_IN_PLANE = Change(Q=np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]), by=np.array([0.3, -0.2, 0.0]))
MIRRORED = Change(Q=np.diag([-1.0, 1.0, 1.0]), by=np.array([0.5, 0.0, 0.0]))
UNITS = Change(mass=1e3, length=0.01, time=10.0)
BODIES = ("rigid_body", "link", "point_mass", "beam")
Other = tuple[Any, Change, bool]  #: the other result or verdict, how it is seen, whether a refusal is legitimate
Way = Callable[[Story, Result], Other | None]  #: None: it does not apply


def _stated(story: Story, change: Change = NONE, may: bool = False) -> Other:
    return attempt(story), change, may


def turned(story: Story, _: Result) -> Other | None:
    """The whole is turned and moved."""
    change = TURNED_IN_PLANE if story.planar else TURNED
    return _stated(changed(story, change), change)


def mirrored(story: Story, _: Result) -> Other | None:
    """The whole is seen in a mirror."""
    return _stated(changed(story, MIRRORED), MIRRORED)


def in_units(story: Story, _: Result) -> Other | None:
    """Units of mass, length and time are others."""
    return _stated(changed(story, UNITS), UNITS)


def reordered(story: Story, _: Result) -> Other | None:
    """Statements come in the opposite order, bodies before joints before couplings."""
    return _stated(story.but(statements=backwards(story)))


def backwards(story: Story) -> tuple[Said, ...]:
    """The statements in the opposite order, as far as one needs no other."""
    return tuple(a for rank in range(4) for a in story.statements[::-1] if _rank(a) == rank)


def _rank(a: Said) -> int:
    return 0 if a.verb in BODIES else {"controller": 1, "gear": 3, "rack": 3, "couple": 3}.get(a.verb, 2)


def modelled(word: str) -> Way:
    """All joints in one model."""

    def way(story: Story, _: Result) -> Other | None:
        if story.model == word or any("model" in a.args for a in story.statements):
            return None
        return _stated(story.but(model=word, options={}), may=True)

    return way


def formed(form: str, solver: str) -> Way:
    """Another form and solver."""

    def way(story: Story, _: Result) -> Other | None:
        return _stated(story.but(options={"form": repr(form), "solver": repr(solver)}), may=True)

    return way


def split(story: Story, _: Result, share: float = 1.0) -> Other | None:
    """The run is divided and continued by start=; of the accuracy, the first part gets a share."""
    if story.of("controller"):
        return None  # a continued run begins with the controller's first instant
    first = attempt(story.but(t_end=round(0.37 * story.t_end, 6), accuracy=max(1e-11, share * story.accuracy)))
    if isinstance(first, Verdict) or not claims(first):
        return first, NONE, False
    return attempt(story, start=first), NONE, False


def saved(story: Story, base: Result) -> Other | None:
    """The result is stored and loaded."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.npz"
        try:
            base.save(path)
            return mb.load(path, laws=[laws.QuarticSpring, laws.Holding] if story.of("own", "controller") else []), NONE, False
        except mb.errors.OptionError as error:  # controllers that are objects are not stored
            return Verdict("told", note=str(error)), NONE, True
        except Exception as error:
            return Verdict("crashed", note=f"{type(error).__name__}: {error}"), NONE, False


def continued(story: Story, base: Result) -> Other | None:
    """The run begins later, all inputs too: from bodies that rest where they are drawn."""
    moving = ("rate0", "angle0", "position0", "velocity", "angular_velocity", "start", "angle", "position")
    if story.of("controller", "beam") or any(key in a.args for a in story.statements for key in moving):
        return None
    later = round(0.7 * story.t_end, 6)
    still = tuple(_still(a) for a in story.statements if a.verb not in ("force", "torque", "contact", "own"))
    space = "planar" if base.prepared.model.planar else "spatial"  # it may rest in the plane, and leave it later
    before = attempt(story.but(gravity=(0.0, 0.0, 0.0), statements=still, t_end=later, options={}, space=space))
    if isinstance(before, Verdict):
        return before, NONE, False
    shifted = story.but(t_end=story.t_end + later, statements=tuple(_later(a, later) for a in story.statements))
    return attempt(shifted, start=before), replace(NONE, by=np.array([0.0, 0.0, later])), False


def _still(a: Said) -> Said:
    """The statement without what moves a body at rest: loads, and targets of feedback."""
    args = {key: replace(v, target=0.0) if isinstance(v, Feed) else v for key, v in a.args.items()}
    return Said(a.verb, {key: v for key, v in args.items() if not isinstance(v, Input) and key != "load"})


def _later(a: Said, later: float) -> Said:
    return Said(a.verb, {key: _moved(value, later) for key, value in a.args.items()})


def _moved(value: Any, later: float) -> Any:
    if isinstance(value, Along):
        return Along(_moved(value.value, later), value.direction)
    if isinstance(value, dict):
        return {key: _moved(v, later) for key, v in value.items()}
    return replace(value, delay=value.delay - value.pace * later) if isinstance(value, Input) else value


def lifted(story: Story, _: Result) -> Other | None:
    """A planar scene is modelled in space, its bodies with inertias about all axes."""
    if not story.planar or story.of("bushing", "beam") or story.space != "auto":
        return None  # planar beams interpolate angles, spatial ones rotations: they agree as elements become many
    return _stated(story.but(space="spatial", statements=tuple(map(_solid, story.statements))))


def _solid(a: Said) -> Said:
    if a.verb == "rigid_body":
        J = a.args["inertia"]
        return a.but(inertia=(0.7 * J, 0.8 * J, J))
    if a.verb != "link":
        return a
    c, J = rods(a.args["points"], a.args["mass"])
    J[0, 0], J[1, 1] = J[0, 0] + 0.1 * J[2, 2], J[1, 1] + 0.1 * J[2, 2]
    return Said("rigid_body", {"name": a.name, "mass": a.args["mass"], "inertia": tuple(map(tuple, J.tolist())),
                               "at": tuple(c.tolist())})


WAYS: dict[str, Way] = {
    "turned": turned, "mirrored": mirrored, "units": in_units, "order": reordered, "kinematic": modelled("kinematic"),
    "classical": modelled("classical"), "recursive": modelled("recursive"), "ggl": formed("ggl", "radau3"),
    "index1": formed("index1", "radau3"), "index3": formed("index3", "radau3"), "split": split, "saved": saved,
    "later": continued, "lifted": lifted}


def compare(story: Story, base: Result, name: str) -> Verdict:
    """The verdict on one other way; `base` claims its accuracy. What a continued run claims begins at its start: where a divided
    run differs, its first part is made a thousand times better, and what still differs is not that part's error, grown."""
    found = _compared(story, base, name, WAYS[name](story, base))
    if name == "split" and found.verdict == "differs":
        return _compared(story, base, name, split(story, base, 1e-3))
    return found


def _compared(story: Story, base: Result, name: str, found: Other | None) -> Verdict:
    if found is None:
        return Verdict("does not apply")
    other, change, may = found
    if isinstance(other, Verdict):
        return Verdict("told", note=other.note) if may and other.verdict == "refused" else other
    if not claims(other):
        return Verdict("told", note=told(other) or "claims no accuracy")
    later = 0.0
    if name == "later":
        later, change = float(change.by[2]), NONE
    times = np.linspace((float(other.solution.t[0]) - later) / change.time, story.t_end, 31)
    jumps = np.array(pieces(story) if story.of("beam") else Reference(story).instants())  # where reactions may have two values
    times = times[np.min(np.abs(times[:, None] - jumps), axis=1) > 1e-6 * story.t_end]
    motion = moved(story, base, other, change, times, later)
    pushed = reactions(story, base, other, change, times, later, name == "lifted")
    worst = max(motion, 0.0 if isnan(pushed) else pushed)
    said = f"motion {motion / story.accuracy:.2g}, reactions {pushed / story.accuracy:.2g} x accuracy"
    return Verdict("same" if worst <= FACTOR * story.accuracy else "differs", worst / story.accuracy, said)


def moved(story: Story, base: Result, other: Result, c: Change, times: Array, later: float) -> float:
    """Largest difference of the motion, as accuracy measures it."""
    here, truth = base(times), {}
    for a in story.of(*BODIES):
        if a.verb == "beam":
            continue
        b = here[a.name]
        truth[f"{a.name}.position"] = (b.position @ c.Q.T + c.by) * c.length
        truth[f"{a.name}.velocity"] = b.velocity @ c.Q.T * (c.length / c.time)
        if a.verb != "point_mass":
            truth[f"{a.name}.rotation"] = c.Q @ b.rotation @ c.Q.T
            truth[f"{a.name}.angular_velocity"] = c.sense * b.angular_velocity @ c.Q.T / c.time
    elastic = story.of("beam")
    rough, longest = bool(elastic or base.prepared.contacts), story.t_end * c.time
    bound = error_of(other, later + times * c.time, truth, rough, longest) if truth else 0.0
    for a in elastic:
        ends = [here[f"{a.name}.at({x})"].position for x in (0.5, 1.0)]
        there = [other(later + times * c.time)[f"{a.name}.at({x})"].position for x in (0.5, 1.0)]
        gap = (np.array(ends) @ c.Q.T + c.by) * c.length - there
        bound = max(bound, float(np.max(np.abs(gap))) / other.prepared.length)
    return bound


def reactions(story: Story, base: Result, other: Result, c: Change, times: Array, later: float, planar: bool) -> float:
    """Largest difference of joint forces and torques over the largest force, torques over the scene's length, as accuracy counts
    them; nan where one run does not cover them."""
    if not all("reactions" in r.accuracy.covers for r in (base, other)):
        return nan
    here, there, worst, forces = base(times), other(later + times * c.time), [], [0.0]
    unit = c.scale((1, 1, -2))
    for a in story.statements:
        if "k" not in a.args or "l" not in a.args:
            continue
        one, two = here[a.name], there[a.name]
        f, g, m, n = one.force @ c.Q.T, two.force / unit, c.sense * one.torque @ c.Q.T, two.torque / unit / c.length
        forces.append(max(float(np.max(np.abs(f))), float(np.max(np.abs(m))) / base.prepared.length))
        if not (_unique(one) and _unique(two)):
            continue
        axes = [2] if planar else [0, 1, 2]
        worst += [float(np.max(np.abs(f - g))), float(np.max(np.abs((m - n)[:, axes]))) / base.prepared.length]
    top = max(forces)
    least = 1e-9 * min(a.args.get("mass", 1.0) for a in story.of(*BODIES)) * base.prepared.length / base.prepared.time**2
    return max(worst, default=0.0) / max(top, least)  # nothing presses where nothing moves, up to round-off


def _unique(sensor: Any) -> bool:
    found = getattr(sensor, "reaction_is_unique", True)
    return bool(np.all(found))


def check(story: Story, ways: Any = None) -> dict[str, Verdict]:
    """Every way that applies to a story, none where its own run claims nothing."""
    base = attempt(story)
    if isinstance(base, Verdict) or not claims(base):
        return {}
    found = {name: compare(story, base, name) for name in ways or WAYS}
    return {name: v for name, v in found.items() if v.verdict != "does not apply"}


def failed(verdict: Verdict) -> bool:
    """Whether a way contradicts the first run."""
    return verdict.verdict == "differs" or verdict.verdict in WRONG

