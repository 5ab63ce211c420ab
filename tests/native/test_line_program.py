"""Elements of beams as native programs against the same maps in NumPy, and against complex steps."""

import numpy as np
import pytest

import mbdae as mb
from mbdae.native.program import Operations
from mbdae.system.model.beams import batches
from mbdae.system.prepare import prepare

from .running import run

STRAIGHT, BENT = [(0, 0, 0), (1, 0, 0)], [(0, 0, 0), (0.6, 0, 0), (0.9, 0.4, 0.3)]


def kernels(space, points, damping, load, mixed):
    """Line kernels of a beam with a load along it."""
    s = mb.Scene("beam", gravity=(0, 0, -9.81) if space else (0, -9.81, 0))
    points = points if space else [p[:2] for p in points]
    section = mb.Section.rectangular(0.02, 0.03, E=2e9, nu=0.3, rho=1000, damping=damping)
    beam = s.beam("b", *points, section=section, elements=3)
    if load:
        s.line_load("load", beam, (0, mb.t * 3, 1) if space else (0, mb.t * 3), frame="section")
    model = prepare(s).model
    return [batch.kernel for batch in batches(model.lines, mixed)]  # strains, loads, gyroscopic moments


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("load", [False, True])
@pytest.mark.parametrize("damping", [0.0, 0.01])
@pytest.mark.parametrize("points", [STRAIGHT, BENT])
@pytest.mark.parametrize("space", [False, True])
def test_elements_of_beams_give_what_their_maps_say(space, points, damping, load, mixed):
    found = kernels(space, points, damping, load, mixed)
    assert found
    for kernel in found:
        for name in ("values", "jacobian"):
            count = kernel.elements * len(kernel.inputs)
            operations = Operations(count)
            gather = np.arange(count).reshape(kernel.elements, -1)
            at = kernel.emit(operations, gather) if name == "values" else kernel.emit_jacobian(operations, gather)
            x = np.random.default_rng(3).uniform(0.3, 0.9, gather.shape)
            expected = kernel.values(x) if name == "values" else kernel.jacobian(x)
            W = np.full(operations.size, np.nan)
            for _ in range(2):  # nothing is left from the call before
                W[:count] = x.ravel()
                assert run(operations, W) == (0, -1)
            got = W[at]
            scale = np.abs(expected).max(axis=0)
            assert np.all(np.abs(got - expected) <= 1e-12 * scale + 1e-14 * scale.max(initial=0)), (name, kernel.targets)
