"""Errors between processes."""

from __future__ import annotations

import pickle

import pytest

import mbdae as mb
from mbdae import errors


@pytest.mark.parametrize("error", [
    errors.SceneError(["the first", "the second"]), errors.SolverError("stopped", 1.5, "rod.x", object()),
    errors.WallClockError("used up", 0.5), errors.EquilibriumError("none", lambda: None, 0.3),
    errors.SteadyError("depends", object()),
    errors.OptionError("wrong"), errors.LawError("not stated"),
], ids=lambda error: type(error).__name__)
def test_errors_arrive_with_their_text(error: errors.MbdaeError) -> None:
    found = pickle.loads(pickle.dumps(error))
    assert type(found) is type(error)
    assert str(found) == str(error)
    kept = {name: value for name, value in vars(error).items() if name not in errors.COMPUTED}
    assert {name: vars(found)[name] for name in kept} == kept
    assert all(getattr(found, name) is None for name in errors.COMPUTED)


def test_warnings_point_to_the_line_of_the_user():
    """However many functions and decorators of mbdae are between."""
    s = mb.Scene("space", gravity=(0, 0, -9.81))
    s.revolute("J", s.ground, s.rigid_body("b", 1.0, 0.1, at=(1, 0, 0)), at=(0, 0, 0), axis=(0, 1, 0))
    with pytest.warns(mb.AccuracyWarning) as of_run:
        s.simulate(0.1)
    with pytest.warns(mb.AccuracyWarning) as of_law:
        mb.LuGre(mu_s=0.3, mu_k=0.2, v_s=0.01, sigma0=1e5, sigma1=300.0, damping_decay=False)
    assert [warning.filename for told in (of_run, of_law) for warning in told] == [__file__, __file__]


def test_what_is_a_function_of_the_package_and_no_method_says_so() -> None:
    with pytest.raises(AttributeError, match=r"scene 'plain' has no 'compare': write mbdae\.compare; it has add"):
        mb.Scene("plain").compare(1.0)
