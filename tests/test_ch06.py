"""Chapter 6: the statement of universal approximation."""

import numpy as np
import pytest

from rlcore.nn import step_bump_network


def f(x):
    return np.cos(x) ** 2 + x  # its slope on [0, 1] is between 0 and 1


@pytest.mark.parametrize("error, n", [(0.2, 4), (0.1, 6), (0.05, 11), (0.02, 26)])
def test_for_every_error_there_is_a_number_of_neurons(error, n):
    """om-uat-statement: 1 / (2 error) bumps and one more stay below it on [0, 1]; outside no number of them helps."""
    assert n == np.ceil(1 / (2 * error)) + 1
    net, x = step_bump_network(f, n), np.linspace(0, 1, 20_001)[:, None]
    assert net.sizes == [1, 2 * n, 1]
    assert np.abs(net.forward(x) - f(x)).max() < error
    far = np.array([[-10.0], [-1.0], [2.0], [10.0]])
    np.testing.assert_allclose(net.forward(far), 0, atol=1e-12)
    assert np.abs(net.forward(far) - f(far)).max() > 10
    assert np.abs(step_bump_network(f, 1).forward(x) - f(x)).max() > 0.2  # one bump is not enough for any of them
