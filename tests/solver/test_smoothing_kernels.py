"""Smoothing kernels: integral, gradient, support and range, in 2D and 3D, in single and double precision."""
import numpy as np
import pytest
from helpers.kernel_samples import CASES, sample_kernels


@pytest.fixture(scope="module")
def samples(taichi, single_precision):
    return {"f64": sample_kernels(), "f32": {name.removeprefix("kernels."): values
                                             for name, values in single_precision("kernels").items()}}


@pytest.fixture(params=[f"{kernel.__name__}-{dimension}D-{support}" for kernel, dimension, support in CASES])
def case(request):
    return request.param_index


@pytest.fixture(params=["f64", "f32"])
def sampled(request, samples, case):
    """Return distances, values, dW/dr, dimension, support and the rounding of the precision."""
    arrays = [samples[request.param][f"{name}.{case}"] for name in ("r", "value", "factor")]
    rounding = float(np.finfo(arrays[0].dtype).eps)
    r, value, factor = (a.astype(float) for a in arrays)
    return r, value, factor * r, *CASES[case][1:], rounding


def shell(r, dimension):
    return 2.0 * np.pi * r if dimension == 2 else 4.0 * np.pi * r**2


@pytest.mark.thorough_cases("f64-WendlandC2-2D-0.000125", "f64-WendlandC2-2D-0.0025")
def test_integral_is_one(sampled):
    r, value, _, dimension, _, rounding = sampled
    # The trapezoid rule itself errs by some 1e-6 at 1600 points within the support.
    assert np.trapezoid(value * shell(r, dimension), r) == pytest.approx(1.0, abs=5e-6 + 20.0 * rounding)


def test_gradient_is_the_slope_of_the_value(sampled):
    r, value, slope, _, support, rounding = sampled
    step = r[1] - r[0]
    differences = (value[2:] - value[:-2]) / (2.0 * step)
    scale = value[0] / support
    # Central differences err by W''' step^2/6 (and once at the joints of the pieces); rounding by eps W/step.
    tolerance = scale * (100.0 * (step / support) ** 2 + 2.0 * rounding * support / step)
    np.testing.assert_allclose(slope[1:-1], differences, rtol=0.0, atol=tolerance)


def test_first_moment_of_the_gradient(sampled):
    """-Integral of r W' over space is the dimension: the consistency of every SPH gradient."""
    r, _, slope, dimension, _, rounding = sampled
    assert -np.trapezoid(slope * r * shell(r, dimension), r) == pytest.approx(dimension, rel=5e-6 + 20.0 * rounding)


def test_positive_falling_and_zero_beyond_the_support(sampled):
    r, value, slope, _, support, _ = sampled
    assert np.isfinite(value).all() and np.isfinite(slope).all()
    inside = r < 0.999 * support
    assert (value[inside] > 0.0).all() and (slope[inside] <= 0.0).all() and (np.diff(value) <= 0.0).all()
    assert not value[r > support * 1.001].any() and not slope[r > support * 1.001].any()


def test_value_at_the_origin(sampled, case):
    kernel, dimension, support = CASES[case]
    assert sampled[1][0] == pytest.approx(kernel(support, dimension).at_zero, rel=4.0 * sampled[5])
