"""Trees against Pinocchio, loops against equations written by hand: accelerations and reactions in every joint model."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
from runner import Case, Claim, Found

from oracles.by_package import MODELS, compared
from oracles.random_loops import closing, off, random_loop
from oracles.trees import random_state, random_tree

claim = Claim("oracles", "random trees and loops have the accelerations and reactions of references that share no code",
              1e-9, "relative", "trees: Pinocchio; loops: dense equations by hand, solved by the rank of their rows")
TREES, LOOPS = range(300), range(150)
ABSENT = "Pinocchio is not installed: pip install 'mbdae[oracle]'"


def has_pinocchio() -> bool:
    """Whether the extra `oracle` is installed."""
    return importlib.util.find_spec("pinocchio") is not None


def tree_off(seed: int, model: str, states: int = 2) -> dict[str, float]:
    """Largest differences of a random tree in a joint model at random states."""
    from oracles.by_pinocchio import Reference

    tree, rng = random_tree(seed), np.random.default_rng([seed, 1])
    drawn, reference = [random_state(rng, tree) for _ in range(states)], Reference(tree)
    return compared(tree, model, drawn, [reference.answer(state) for state in drawn], seed)


def loop_off(seed: int, model: str) -> dict[str, float]:
    """Largest differences of a random mechanism with loops in a joint model, at its start."""
    start, prepared = closing(random_loop(seed), model)
    return off(start.mechanism, prepared)


def worst(one: Callable[[int, str], dict[str, float]], seeds: Iterable[int]) -> list[Found]:
    """The largest differences of some seeds in all models, and where they are."""
    found: dict[str, tuple[float, str]] = {}
    for seed in seeds:
        for model in MODELS:
            for name, value in one(seed, model).items():
                found[name] = max(found.get(name, (0.0, "")), (value, f"seed {seed}, {model}"))
    return [Found(value, quantity=name, note=where) for name, (value, where) in found.items()]


def trees(seeds: Iterable[int]) -> list[Found]:
    """Of random trees."""
    return worst(tree_off, seeds) if has_pinocchio() else [Found(np.nan, note=ABSENT)]


def cases() -> list[Case]:
    models = ", ".join(MODELS)
    return [Case("trees", models, trees, slow=True, parts=TREES),
            Case("loops", models, partial(worst, loop_off), slow=True, parts=LOOPS)]
