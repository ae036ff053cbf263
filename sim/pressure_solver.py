"""Solvers of the pressure equation A p = b behind one interface: conjugate residuals and (accelerated) Jacobi.

A completely full cavity takes any sign of the pressure and fixes it up to a constant: conjugate residuals. A liquid
with a free surface wants p >= 0 with A p >= b, and equality where p > 0: Jacobi iterations with a clamp, plain or
accelerated. Equations: docs/methods/pressure.md.
"""

from sim.backend import data_oriented, real, ti
from sim.pressure_operators import PressureOperators
from sim.reductions import blocks, first, largest_of, last, partial_results, total_of

POWER_ITERATIONS = 40  # for the largest eigenvalue of D^-1 A
JACOBI_LIMIT = 1.6  # plain relaxation over the largest eigenvalue; 2 is the limit of stability
ACCELERATED_LIMIT = 0.9  # the same for the accelerated one; 1 is the limit that its proof allows
LARGEST_VIOLATION = 30.0  # of a single particle, over the mean: a few left alone would be thrown out of a splash
DIVERGED = 100.0  # growth of the mean violation in a solve, from which the relaxation is taken to be too large


@data_oriented
class ConjugateResiduals:
    """Conjugate residuals from p = 0, with the diagonal as preconditioner; the mean of p stays 0.

    Particles count in the mean by their `lightness`: gas beside water has a pressure of about zero, for its mass does
    not bear the noise of another. What is left of the sum of b goes to particles in the same proportion.

    Parameters
    ----------
    operators : A and its diagonal, which has to be that of the present state.
    """

    def __init__(self, operators: PressureOperators):
        self.operators = operators
        self.count = operators.count
        n = operators.particles.capacity
        self.right_side, self.residual, self.direction, self.image, self.preconditioned = (
            ti.field(real(), shape=n) for _ in range(5))
        self.partial = partial_results(3)
        self.rho, self.residual_mean, self.residual_maximum = (ti.field(ti.f64, shape=()) for _ in range(3))
        self.alpha, self.beta, self.mean, self.weight = (ti.field(real(), shape=()) for _ in range(4))

    @ti.kernel
    def _start(self, p: ti.template(), weighted: ti.template()):
        """p = 0, residual = b with the mean removed."""
        n = self.count[None]
        for block in range(blocks(n)):
            total = ti.cast(0.0, ti.f64)
            weight = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                total += self.right_side[i]
                weight += self.operators.lightness(i, weighted)
            self.partial[0, block] = total
            self.partial[1, block] = weight
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.weight[None] = total_of(self.partial, 1, n)
            self.mean[None] = total_of(self.partial, 0, n) / self.weight[None]
            self.rho[None] = 0.0
        for i in range(self.count[None]):
            p[i] = 0.0
            self.residual[i] = self.right_side[i] - self.operators.lightness(i, weighted) * self.mean[None]
            self.direction[i] = 0.0
            self.image[i] = 0.0

    @ti.kernel
    def _precondition(self, diagonal: ti.template(), weighted: ti.template()):
        """preconditioned = residual / diagonal with the mean removed; mean and largest residual per volume."""
        n = self.count[None]
        for block in range(blocks(n)):
            mean = ti.cast(0.0, ti.f64)
            total = ti.cast(0.0, ti.f64)
            largest = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                z = self.residual[i] / diagonal[i]
                self.preconditioned[i] = z
                left = ti.cast(ti.abs(self.residual[i]) / self.operators.volume[i], ti.f64)
                mean += self.operators.lightness(i, weighted) * z
                total += left
                largest = ti.max(largest, left)
            self.partial[0, block] = mean
            self.partial[1, block] = total
            self.partial[2, block] = largest
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.mean[None] = total_of(self.partial, 0, n) / self.weight[None]
            self.residual_mean[None] = total_of(self.partial, 1, n) / n
            self.residual_maximum[None] = largest_of(self.partial, 2, n)
        for i in range(self.count[None]):
            self.preconditioned[i] -= self.mean[None]

    @ti.kernel
    def _advance(self, p: ti.template(), diagonal: ti.template(), weighted: ti.template()):
        """One step of conjugate residuals; rho becomes z.Az, and alpha is 0 where the search has to stop."""
        n = self.count[None]
        for block in range(blocks(n)):
            total = ti.cast(0.0, ti.f64)
            mean = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                total += ti.cast(self.preconditioned[i], ti.f64) * self.operators.applied[i]
                mean += self.operators.applied[i]
            self.partial[0, block] = total
            self.partial[1, block] = mean
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = total_of(self.partial, 0, n)
            self.mean[None] = total_of(self.partial, 1, n) / self.weight[None]
            self.beta[None] = ti.select(self.rho[None] > 0.0, total / self.rho[None], 0.0)
            self.rho[None] = total
        for block in range(blocks(n)):
            beta = self.beta[None]
            total = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                self.direction[i] = self.preconditioned[i] + beta * self.direction[i]
                # A does not map to zero mean exactly: left in, a uniform rate that no pressure can change would build
                # up.
                even = self.operators.lightness(i, weighted) * self.mean[None]
                self.image[i] = self.operators.applied[i] - even + beta * self.image[i]
                total += ti.cast(self.image[i], ti.f64) * self.image[i] / diagonal[i]
            self.partial[0, block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = total_of(self.partial, 0, n)
            self.alpha[None] = ti.select((self.rho[None] > 0.0) & (total > 0.0), self.rho[None] / total, 0.0)
        for i in range(self.count[None]):
            alpha = self.alpha[None]
            p[i] += alpha * self.direction[i]
            self.residual[i] -= alpha * self.image[i]

    def solve(self, p, *, weighted: bool, step: float, tolerance: float, maximum_iterations: int):
        """Find `p` with mean |residual| * step / V <= tolerance.

        `right_side` holds b / step already; a tolerance of 0 makes exactly `maximum_iterations`.

        Returns
        -------
        iterations : int
        residual_mean, residual_maximum : mean and largest |residual| * step / V at the end.
        """
        diagonal = self.operators.diagonal[weighted]
        self._start(p, weighted)
        self._precondition(diagonal, weighted)
        iterations = 0
        while iterations < maximum_iterations and (tolerance == 0.0 or self.residual_mean[None] * step > tolerance):
            self.operators.apply(self.preconditioned, weighted)
            self._advance(p, diagonal, weighted)
            if tolerance > 0.0 and self.alpha[None] == 0.0:
                break
            self._precondition(diagonal, weighted)
            iterations += 1
        return iterations, self.residual_mean[None] * step, self.residual_maximum[None] * step


@data_oriented
class Jacobi:
    """Relaxed Jacobi iterations with p >= 0, plain or accelerated: Nesterov's momentum with adaptive restart
    [odonoghue2015], the accelerated projected gradient of [mazhar2015] with the diagonal as metric.

    Parameters
    ----------
    operators : A and its diagonal, which has to be that of the present state.
    accelerated : with momentum.
    """

    def __init__(self, operators: PressureOperators, accelerated: bool):
        self.operators, self.accelerated = operators, accelerated
        self.count = operators.count
        n = operators.particles.capacity
        self.right_side, self.extrapolated = (ti.field(real(), shape=n) for _ in range(2))
        self.partial = partial_results(3)
        self.residual_mean, self.residual_maximum, self.turn = (ti.field(ti.f64, shape=()) for _ in range(3))
        self.relaxation, self.momentum = (ti.field(real(), shape=()) for _ in range(2))
        self.eigenvalue = ti.field(ti.f64, shape=())

    @ti.kernel
    def _random(self):
        for i in range(self.count[None]):
            self.extrapolated[i] = ti.sin(12.9898 * i) + 0.1

    @ti.kernel
    def _divide(self, diagonal: ti.template()):
        """One power iteration: extrapolated = D^-1 A extrapolated, scaled to largest entry 1."""
        n = self.count[None]
        for block in range(blocks(n)):
            largest = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                if diagonal[i] > 0.0:
                    largest = ti.max(largest, ti.abs(self.operators.applied[i] / diagonal[i]))
            self.partial[0, block] = largest
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.eigenvalue[None] = largest_of(self.partial, 0, n)
        for i in range(self.count[None]):
            d = diagonal[i]
            value = self.operators.applied[i] / (ti.max(d, 1e-30) * self.eigenvalue[None])
            self.extrapolated[i] = ti.select(d > 0.0, value, 0.0)

    def measure_eigenvalue(self) -> float:
        """Largest eigenvalue of D^-1 A by power iteration; it sets the relaxation."""
        self.operators.update_diagonals(0.0)
        return self._power_iterations(True)

    def _power_iterations(self, weighted: bool) -> float:
        self._random()
        for _ in range(POWER_ITERATIONS):
            self.operators.apply(self.extrapolated, weighted)
            self._divide(self.operators.diagonal[weighted])
        return self.eigenvalue[None]

    def set_eigenvalue(self, largest: float) -> None:
        """Choose the relaxation for a largest eigenvalue of D^-1 A."""
        self.eigenvalue[None] = largest
        self.relaxation[None] = (ACCELERATED_LIMIT if self.accelerated else JACOBI_LIMIT) / largest

    @ti.kernel
    def _start(self, p: ti.template()):
        for i in range(self.count[None]):
            p[i] = ti.max(p[i], 0.0)
            self.extrapolated[i] = p[i]

    @ti.kernel
    def _advance(self, p: ti.template(), diagonal: ti.template()):
        n = self.count[None]
        for block in range(blocks(n)):
            total = ti.cast(0.0, ti.f64)
            largest = ti.cast(0.0, ti.f64)
            turn = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                d = diagonal[i]
                missing = self.right_side[i] - self.operators.applied[i]
                y = self.extrapolated[i]
                new = 0.0
                if d > 0.0:
                    new = ti.max(y + self.relaxation[None] * missing / d, 0.0)  # (P12)
                change = new - p[i]
                left = ti.max(missing, ti.select(new > 0.0, -missing, 0.0)) / self.operators.volume[i]
                total += left
                largest = ti.max(largest, left)
                turn += ti.cast((y - new) * d, ti.f64) * change
                p[i] = new
                self.extrapolated[i] = new + self.momentum[None] * change
            self.partial[0, block] = total
            self.partial[1, block] = largest
            self.partial[2, block] = turn
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.residual_mean[None] = total_of(self.partial, 0, n) / n
            self.residual_maximum[None] = largest_of(self.partial, 1, n)
            self.turn[None] = total_of(self.partial, 2, n)

    def solve(self, p, *, weighted: bool, step: float, tolerance: float, maximum_iterations: int,
              minimum_iterations: int = 2):
        """Improve `p` until the mean violation * step / V <= tolerance, and the largest not far above.

        A violation is what is missing at p >= 0, or too much where p > 0. Arguments and results are those of conjugate
        residuals. Particles that have moved may have raised the largest eigenvalue since it was measured: a solve that
        diverges for it measures it anew and starts from p = 0, with the iterations that are left.
        """
        left, diverged = maximum_iterations, True
        while diverged and left > 0:
            spent, diverged = self._iterate(p, weighted, step, tolerance, left, minimum_iterations)
            left -= spent
            if diverged:
                p.fill(0.0)
                if spent == 1:  # what is asked for is no number, which the check of the step reports
                    break
                self._relax_less(weighted)
        return maximum_iterations - left, self.residual_mean[None] * step, self.residual_maximum[None] * step

    def _relax_less(self, weighted: bool) -> None:
        """Choose the relaxation anew for a largest eigenvalue that is surely larger than the one it was chosen for."""
        old = self.eigenvalue[None]
        self.set_eigenvalue(max(1.2 * old, self._power_iterations(weighted)))

    def _iterate(self, p, weighted, step, tolerance, maximum_iterations, minimum_iterations):
        """Iterate from p; return the number of iterations and whether they diverge."""
        self._start(p)
        theta, first = 1.0, tolerance
        for iteration in range(1, maximum_iterations + 1):
            following = 0.5 * (1.0 + (1.0 + 4.0 * theta * theta) ** 0.5)
            self.momentum[None] = (theta - 1.0) / following if self.accelerated else 0.0
            theta = following
            self.operators.apply(self.extrapolated, weighted)
            self._advance(p, self.operators.diagonal[weighted])
            if self.turn[None] > 0.0:  # the momentum points uphill
                theta = 1.0
            left, largest = self.residual_mean[None] * step, self.residual_maximum[None] * step
            if iteration == 1:
                first = max(left, tolerance)
            if not left <= DIVERGED * first:
                return iteration, True
            if iteration >= minimum_iterations and left <= tolerance and largest <= LARGEST_VIOLATION * tolerance:
                break
        return iteration, False
