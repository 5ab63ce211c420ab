"""DAE: both calling styles, index of the unknowns, numerical Jacobian, errors."""

import numpy as np
import pytest
from dae_problems import circle, decay, jay, pendulum

from mbdae.errors import OptionError
from mbdae.system.dae import DAE


def test_index_of_each_unknown():
    assert pendulum("index3").index.tolist() == [1, 1, 2, 2, 3]
    assert pendulum("ggl").index.tolist() == [1, 1, 1, 1, 2, 2]
    assert pendulum("ggl_rates").index.tolist() == [1] * 6
    assert jay().index.tolist() == [1, 1, 2]
    assert circle("index3").index.tolist() == [1, 1, 2, 2, 3]  # G has a zero at the start
    assert decay(index=[1, 2]).index.tolist() == [1, 2]


@pytest.mark.parametrize("sparse", [False, True])
def test_difference_quotients_agree_with_the_exact_jacobian(sparse):
    exact = pendulum("ggl_rates")
    y, yp = exact.y0 + 0.1, exact.yp0 + 0.3
    reference = np.zeros((6, 6))
    exact.jacobian(0.2, y, yp, 7.0, reference)
    pattern = np.ones((6, 6)) if sparse else None
    numeric = DAE(lambda t, y, yp, out: exact.residual(t, y, yp, out), exact.y0, exact.yp0, sparsity=pattern)
    out = np.zeros(36 if sparse else (6, 6))
    numeric.jacobian(0.2, y, yp, 7.0, out)
    found = out.reshape(6, 6).T if sparse else out
    assert found == pytest.approx(reference, abs=1e-6)


def test_filling_and_returning_are_the_same():
    def fill(t, y, yp, out):
        out[:] = yp + y

    filled, returned = np.empty(2), np.empty(2)
    DAE(fill, [1.0, 2.0], [-1.0, -2.0]).residual(0.0, np.ones(2), np.ones(2), filled)
    decay().residual(0.0, np.ones(2), np.ones(2), returned)
    assert np.array_equal(filled, returned)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y0": [1.0, np.nan]}, r"y0 = .* has a wrong entry, nan is not finite: give"),
        ({"yp0": [1.0]}, r"yp0 = .* has shape \(1,\): give 2 finite numbers"),
        ({"yp0": [-1.0, -2.1]}, r"not consistent: F\[1\] = -1\.000e-01 .* contains b"),
        ({"names": ["a", "a"]}, "give 2 different names"),
        ({"index": 4}, "index = 4: give 1, 2 or 3"),
        ({"index": 1.5}, r"index = 1\.5"),
        ({"scale": 0.0}, r"scale = 0\.0"),
        ({"sparsity": np.ones((3, 3))}, r"sparsity = .* has shape \(3, 3\)"),
        ({"residual": lambda t, y, yp, out: yp[:1]}, r"residual returns .* of shape \(1,\)"),
        ({"residual": lambda t, y, yp, out: None}, r"F\[0\] = nan at the start"),
        ({"jacobian": lambda t, y, yp, cj, out: np.ones(3)}, r"jacobian returns .* of shape \(3,\)"),
        ({"jacobian": lambda t, y, yp, cj, out: np.full((2, 2), np.inf)}, "jacobian is not finite"),
    ],
)
def test_errors(change, message):
    arguments = {
        "residual": lambda t, y, yp, out: yp + y,
        "y0": [1.0, 2.0],
        "yp0": [-1.0, -2.0],
        "names": ["a", "b"],
        **change,
    }
    with pytest.raises(OptionError, match=message):
        DAE(**arguments)


def test_scales_are_one_for_all_or_one_per_unknown():
    def fill(t, y, yp, out):
        out[:] = yp + y

    def scaled(scale):
        return DAE(fill, [1.0, 20.0], [-1.0, -20.0], scale=scale).scale

    assert np.array_equal(scaled(3.0), [3.0, 3.0])
    assert np.array_equal(scaled([3.0, 4.0]), [3.0, 4.0])
    assert np.array_equal(scaled(None), [1.0, 20.0])
    for wrong in ([3.0], [3.0, 4.0, 5.0], [3.0, -4.0]):
        with pytest.raises(OptionError, match="positive typical magnitudes"):
            scaled(wrong)
