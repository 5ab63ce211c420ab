"""Every joint in every model it admits against a reference by hand; closed forms of joints and gears."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from joints import gears, jack, shafts
from joints.chains import MODELS, Run, admits, as_drawn, by_hand, by_package, drawn, off, random_state, scene_of, start_off
from joints.kinematics import KINDS
from joints.oracle import Chain
from runner import Case, Claim, Found

from mbdae.system.prepare import prepare

claim = Claim("joints", "every joint gives the same accelerations, reactions and runs in every model it admits, and those of "
              "closed forms",
              1e-11, "relative", "equations of motion of chains by hand, DOP853 at rtol 1e-11; closed forms")
STATES, ACCURACY, T_END = 50, 1e-8, 0.5
CLOSED = 1e-8  #: relative, of closed forms
SIDES = ("lkl", "klk")


def chain(kind: str, seed: int, sides: str) -> Chain:
    """Two joints of a kind with another between them; the last coordinate of the second prescribed where the seed is odd."""
    rng = np.random.default_rng(seed)
    between = list(KINDS)[rng.integers(len(KINDS))]
    return drawn(rng, (kind, between, kind), sides, 1 if seed % 2 else None)


def same_state(kind: str) -> list[Found]:
    """Largest differences at random states of two chains, between models and from the reference."""
    worst = np.zeros((2, 2))
    for seed, sides in enumerate(SIDES):
        c, rng = chain(kind, seed, sides), np.random.default_rng(seed)
        prepared = [prepare(scene_of(c, models)) for models in admits(c)]
        for _ in range(STATES // len(SIDES)):
            state = random_state(rng, c)
            reference, found = by_hand(c, *state), [by_package(c, p, *state) for p in prepared]
            worst[0] = np.maximum(worst[0], np.max([off(one, found[0]) for one in found[1:]], axis=0))
            worst[1] = np.maximum(worst[1], np.max([off(one, reference) for one in found], axis=0))
    return [Found(worst[i, j], quantity=f"{what}, {where}") for j, what in enumerate(("accelerations", "joint forces"))
            for i, where in enumerate(("between models", "from the reference"))]


def starts_and_runs(kind: str) -> list[Found]:
    """Largest errors of the start and of runs of two joints of a kind in every model."""
    begin, runs = 0.0, 0.0
    for seed, sides in enumerate(("lk", "kl")):
        rng = np.random.default_rng(seed + 2)
        c = drawn(rng, (kind, kind), sides, 1 if seed else None)
        _, q, v = random_state(rng, c)
        q, v = c.prescribed(0.0, as_drawn(c, q), v)
        reference = Run.of(c, q, v, T_END)
        for models in admits(c, mixed=False):
            s = scene_of(c, models, q, v)
            begin = max(begin, start_off(c, prepare(s), 0.0, q, v))
            runs = max(runs, reference.off(c, s.simulate(T_END, accuracy=ACCURACY, outputs=reference.times)))
    return [Found(begin, quantity="start"), Found(runs, 10 * ACCURACY, quantity="run")]


def closed(errors: Callable[[], Iterator[tuple[str, float]]]) -> Found:
    """The largest error of closed forms, and where it is."""
    worst, where = max((error, name) for name, error in errors())
    return Found(worst, CLOSED, note=where)


def cases() -> list[Case]:
    models = ", ".join(type(m).__name__.lower() for m in MODELS)
    forms = {"shafts with joints of Cardan": shafts.errors, "screw jack": jack.errors, "gears": gears.errors}
    return [*(Case(name, "default", lambda errors=errors: closed(errors), slow=True) for name, errors in forms.items()),
            Case(f"{STATES} states", models, same_state, slow=True, parts=list(KINDS), each=True),
            Case("runs", models, starts_and_runs, slow=True, parts=list(KINDS), each=True)]
