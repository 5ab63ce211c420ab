"""Errors between processes."""

from __future__ import annotations

import pickle

import pytest

from mbdae import errors


@pytest.mark.parametrize("error", [
    errors.SceneError(["the first", "the second"]), errors.SolverError("stopped", 1.5, "rod.x", object()),
    errors.WallClockError("used up", 0.5), errors.EquilibriumError("none", lambda: None, 0.3),
    errors.SteadyError("depends", object()),
    errors.OptionError("wrong"), errors.LawError("not stated"),
], ids=lambda error: type(error).__name__)  # fmt: skip
def test_errors_arrive_with_their_text(error: errors.MbdaeError) -> None:
    found = pickle.loads(pickle.dumps(error))
    assert type(found) is type(error)
    assert str(found) == str(error)
    kept = {name: value for name, value in vars(error).items() if name not in errors.COMPUTED}
    assert {name: vars(found)[name] for name in kept} == kept
    assert all(getattr(found, name) is None for name in errors.COMPUTED)
