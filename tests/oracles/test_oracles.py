"""A part of the claim `oracles`: random trees against Pinocchio, random loops against equations of motion by hand."""

from __future__ import annotations

import pytest
from oracles.by_package import MODELS
from oracles.check import ABSENT, claim, has_pinocchio, loop_off, tree_off

TREES = [(seed, MODELS[seed // 3 % len(MODELS)]) for seed in range(20)] + [(seed, "recursive") for seed in (29, 39, 109)]
LOOPS = 24


@pytest.mark.skipif(not has_pinocchio(), reason=ABSENT)
@pytest.mark.parametrize(("seed", "model"), TREES)
def test_a_tree_has_the_accelerations_and_reactions_of_pinocchio(seed, model):
    """In one joint model each; the last ones are evaluated joint by joint."""
    found = tree_off(seed, model, states=1)
    assert max(found.values()) < claim.tolerance, found


#: every second one; as many again are in tests/reference/test_loops.py
@pytest.mark.parametrize("seed", [pytest.param(seed, marks=[pytest.mark.slow] * (seed % 2)) for seed in range(LOOPS)])
def test_a_loop_has_the_accelerations_and_reactions_of_the_equations_by_hand(seed):
    found = loop_off(seed, MODELS[seed // 5 % len(MODELS)])
    assert max(found.values()) < claim.tolerance, found
