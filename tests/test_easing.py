import numpy as np
import pytest

from blendcap.numerics.easing import least_jerk, smoothstep


@pytest.mark.parametrize(("ease", "powers"), [(lambda x: smoothstep(0, 1, x), [0, 0, 3, -2]),
                                              (least_jerk, [0, 0, 0, 10, -15, 6])])  # fmt: skip
def test_the_way_is_the_polynomial_that_begins_and_ends_level(ease, powers):
    x, way = np.linspace(0, 1, 101), np.polynomial.Polynomial(powers)
    np.testing.assert_allclose(ease(x), way(x), rtol=0, atol=1e-14)
    slopes = [way.deriv(order)(end) for order in range(1, len(powers) // 2) for end in (0, 1)]
    np.testing.assert_allclose(slopes, 0, atol=1e-12)
    assert ease(np.array([-np.inf, -0.1, 1.1, np.inf])).tolist() == [0, 0, 1, 1]


def test_a_step_may_fall():
    x = np.linspace(-10, 10, 41)
    np.testing.assert_allclose(smoothstep(4, -2, x), 1 - smoothstep(-2, 4, x), rtol=0, atol=1e-14)
