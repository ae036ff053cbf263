"""Values of the smoothing kernels at many distances."""
import itertools

import numpy as np

from sim.backend import ti
from sim.smoothing_kernels import CubicSpline, WendlandC2

KERNELS = (WendlandC2, CubicSpline)
SUPPORTS = (2.5e-3, 1.25e-4)   # of 1 mm spacing, and of 0.05 mm, where powers of 1/h would leave the range of float32
CASES = list(itertools.product(KERNELS, (2, 3), SUPPORTS))
SAMPLES = 2001


@ti.kernel
def sample(kernel: ti.template(), r: ti.template(), value: ti.template(), factor: ti.template()):
    for k in r:
        value[k] = kernel.value(r[k])
        factor[k] = kernel.gradient_factor(r[k])


def sample_kernels() -> dict[str, np.ndarray]:
    """Return the value and the gradient's factor of every kernel at distances from 0 to 1.25 h."""
    from sim.backend.runtime import real, real_numpy
    r, value, factor = (ti.field(real(), shape=SAMPLES) for _ in range(3))
    results = {}
    for case, (kernel, dimension, support) in enumerate(CASES):
        r.from_numpy(np.linspace(0.0, 1.25 * support, SAMPLES).astype(real_numpy()))
        sample(kernel(support, dimension), r, value, factor)
        results |= {f"r.{case}": r.to_numpy(), f"value.{case}": value.to_numpy(), f"factor.{case}": factor.to_numpy()}
    return results
