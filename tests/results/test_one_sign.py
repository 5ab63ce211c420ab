"""The same quantity is the same number in every joint model and in a default run: multipliers by name, force, torque, power."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import mbdae as mb

MODELS = {"kinematic": mb.Kinematic(), "classical": mb.Classical(), "scaled": mb.Classical(scaling=20.0, penalty=3.0),
          "recursive": mb.Recursive(), "default": None}
TIMES = np.linspace(0, 0.3, 4)


def scene(kind: str, model: mb.JointModel | None, space: str, swapped: bool, axis: int, **options: object) -> mb.Scene:
    """Two bodies on joints A and B of one kind under gravity; k and l, and the direction of the axis, either way."""
    s = mb.Scene("two bodies", gravity=(0.5, -9.81, 0 if space == "auto" else 2.0), space=space)
    a = s.rigid_body("a", 1.0, (0.02, 0.09, 0.08), at=(0.5, 0.1, 0))
    b = s.rigid_body("b", 0.7, (0.03, 0.07, 0.06), at=(1.5, 0.3, 0))
    where = [(0, 0, 0), (1, 0.2, 0)]
    turns = {"revolute": (0, 0, 1), "prismatic": (0.6, 0.8, 0)}[kind]
    for name, at, ends, given in (("A", where[0], (s.ground, a), options), ("B", where[1], (a, b), {})):
        k, l = ends[::-1] if swapped else ends
        getattr(s, kind)(name, k, l, at=at, axis=tuple(axis * c for c in turns), model=model, **given)
    return s


def quantities(s: mb.Scene) -> dict[str, np.ndarray]:
    """Multipliers by name and sensors of both joints over the times of a run."""
    r = s.simulate(0.3, accuracy=1e-9)(TIMES)
    found = dict(zip(r.multiplier_names, r.multipliers.T, strict=True))
    for name, what in itertools.product("AB", ("force", "torque", "power", "rate")):
        found[f"{name}: {what}"] = getattr(r[name], what)
    return found


#: every kind and load in one of the spaces and ways in turn
EVERY = [pytest.param(*given, *way, marks=[pytest.mark.slow] * (i not in (1, 2, 4, 7) or k != (i + i // 2 + i // 4) % 2))
         for i, given in enumerate(itertools.product(("revolute", "prismatic"), ("driven", "loaded"), ("auto", "spatial")))
         for k, way in enumerate(((False, 1), (True, -1), (True, 1), (False, -1)))]


@pytest.mark.parametrize(("kind", "loads", "space", "swapped", "axis"), EVERY)
def test_every_model_says_the_same(kind: str, loads: str, space: str, swapped: bool, axis: int) -> None:
    what, load = {"revolute": ("angle", "torque"), "prismatic": ("position", "force")}[kind]
    driven = {what: 0.3 * mb.t + 0.5 * mb.t**2}
    given = driven if loads == "driven" else {"spring": 5.0, "damper": 0.4, load: 3.0 + mb.t, "rate0": 0.7}
    found = {name: quantities(scene(kind, model, space, swapped, axis, **given)) for name, model in MODELS.items()
             if kind == "revolute" or name != "scaled"}
    first = found["kinematic"]
    assert ("A.drive" in first) == (loads == "driven")
    for name, other in found.items():
        shared = sorted(first.keys() & other.keys())
        assert len(shared) == len(first)
        for key in shared:  # forces of some 10 N from positions and velocities to 1e-9
            np.testing.assert_allclose(other[key], first[key], atol=2e-6, err_msg=f"{key} of {name}")


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("name", sorted(MODELS))
def test_signs_are_those_the_laws_state(name: str, swapped: bool) -> None:
    """A drive lifts a level arm of 2 kg at 0.5 m: +9.81 N m on it about the axis, whichever body is l. A drive pushes 2 kg up
    with 3 m/s^2: 25.62 N on it along the axis."""
    sign = -1.0 if swapped else 1.0
    s = mb.Scene("arm", gravity=(0, -9.81, 0))
    b = s.rigid_body("b", 2.0, 0.1, at=(0.5, 0))
    s.revolute("A", *((b, s.ground) if swapped else (s.ground, b)), at=(0, 0), model=MODELS[name], angle=0 * mb.t)
    c = s.rigid_body("c", 2.0, 0.1, at=(3, 0))
    s.prismatic("P", *((c, s.ground) if swapped else (s.ground, c)), at=(3, 0), axis=(0, 1, 0),
                model=None if name == "scaled" else MODELS[name], position=sign * 1.5 * mb.t**2)
    d = s.rigid_body("d", 1.0, 1.0, at=(6, 0))  # something to solve for
    s.revolute("free", s.ground, d, at=(6, 0), model=mb.Kinematic())
    r = s.simulate(0.1)
    found = dict(zip(r.multiplier_names, r.multipliers[-1], strict=True))
    assert found["A.drive"] == pytest.approx(sign * 9.81, rel=1e-8)
    assert r["A"].torque[-1, 2] == pytest.approx(sign * 9.81, rel=1e-8)
    assert found["P.drive"] == pytest.approx(sign * 2 * 12.81, rel=1e-8)
    assert r["P"].force[-1, 1] == pytest.approx(sign * 2 * 12.81, rel=1e-8)
