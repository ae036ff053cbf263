"""Volume-incompressible SPH with pressures p >= 0: for free surfaces
([song, section III-A, algorithm 1], with pair forces that cancel, masses in the diagonal and the pressure as the last
part of a step). Equations: docs/methods/pressure.md.

The compression rate Gamma_i = sum of V_j W_ij counts rest volumes, so nothing is smeared where two liquids of
different density meet. Two solves per step share one symmetric matrix, both with p >= 0: the divergence solve makes
the volume rate of the velocity at most zero, the constant-volume solve the compression at most that of a lattice.

As the paper has it, the constant-volume solve acts on the velocity before the particles move. By default it moves the
particles alone, after a divergence solve that takes in gravity: the pressure of a tank at rest is then ten times as
exact (1 % instead of 12 % of rho g H in two layers of 1:2), and the solves need a third of the iterations there.
"""
import dataclasses
from types import MappingProxyType

from sim.backend import data_oriented, ti
from sim.boundary import WallStop
from sim.effects.effect import GROWTH
from sim.fields import Field
from sim.liquid import are_unlike
from sim.parameters import parameter
from sim.pressure_operators import PressureOperators
from sim.pressure_solver import Jacobi
from sim.schemes.scheme import Scheme
from sim.smoothing_kernels import lattice_sum

SPRAY = 0.5  # compression rate over that at rest, below which a particle starts from p = 0 and may converge
EIGENVALUE_INTERVAL = 100  # steps between two measurements of the largest eigenvalue
CORRECTION_RATE = 0.2  # share of the compression that moving the particles removes per step
CORRECTION_ITERATIONS = 5
CORRECTION_LIMIT = 0.1  # largest such move per step, in particle spacings


@dataclasses.dataclass(frozen=True)
class VolumeIncompressibleParameters:
    """Constant volumes at a free surface; without effect in a full cavity."""

    constant_volume: str = parameter("position", choices=("position", "velocity"),
                                     meaning="what the constant-volume solve changes; velocity as in the paper")
    pressure_method: str = parameter("accelerated_jacobi", choices=("accelerated_jacobi", "jacobi"),
                                     meaning="iteration of both solves")


@data_oriented
class VolumeIncompressibleClamped(Scheme):
    """Scheme `volume_incompressible` where a surface is free."""

    name = "volume_incompressible"
    Parameters = VolumeIncompressibleParameters
    fields = (
        Field("pressure", "scalar", "Pa", "pressure of both solves", carried=True),
        Field("divergence_pressure", "scalar", "Pa", "pressure of the divergence solve", carried=True),
        Field("volume_pressure", "scalar", "Pa or m2", "potential of the constant-volume solve", carried=True),
        Field("compression_rate", "scalar", "1", "Gamma_i = sum of V_j W_ij over liquid and wall"),
        Field("kernel_gradient_sum", "vector", "1/m", "S_i = sum of V_j grad_i W_ij over liquid and wall"),
        Field("displacement", "vector", "m", "move beside that with the velocity"),
        Field("contact", "integer", "", "1 where the wall itself stopped the particle in this step"),
    )
    lacks = MappingProxyType({GROWTH: "it works in full cavities only"})

    def __init__(self, solver):
        super().__init__(solver)
        self.operators = PressureOperators(solver.particles, self.search, self.kernel_gradient_sum,
                                           are_unlike(liquid.density for liquid in solver.liquids))
        self.pressure_solver = Jacobi(self.operators, self.parameters.pressure_method == "accelerated_jacobi")
        self.moves_positions = self.parameters.constant_volume == "position"
        self.compression_at_rest = lattice_sum(self.search.kernel, solver.rest_volume ** (1.0 / solver.dimension),
                                               solver.dimension)
        self.wall_stop = WallStop(solver.distance, self.spacing, self.count, self.contact)

    @ti.kernel
    def _measure(self):
        for i in range(self.count[None]):
            total, gradient = self.kernel_sums(i)
            self.compression_rate[i] = total
            self.kernel_gradient_sum[i] = gradient

    def measure(self) -> None:
        self._measure()
        self.operators.update()

    def set_rest_state(self) -> None:
        self.pressure_solver.set_eigenvalue(self.pressure_solver.measure_eigenvalue())

    @ti.kernel
    def _set_right_side(self, p: ti.template(), dt: float, divergence: ti.template()):
        """Volume rate (divergence solve) or compression at the end of the step (constant-volume solve), over dt.

        The pressure between particles that hardly meet is large for its small gradients: it must not outlive the step.
        """
        for b in range(self.walls.count):
            self.operators.wall_value[b] = self.operators.wall_rate(self.velocity, b, True)
        for i in range(self.count[None]):
            rate = self.operators.volume_rate(self.velocity, i)
            spray = self.compression_rate[i] < SPRAY * self.compression_at_rest
            if spray:
                p[i] = 0.0
            if ti.static(divergence):
                rate = ti.select(spray, 0.0, rate)
            else:
                rate += self.volume[i] * (self.compression_rate[i] - self.compression_at_rest) / dt
            self.pressure_solver.right_side[i] = rate / dt

    def _solve(self, pressure, dt: float, divergence: bool):
        self._set_right_side(pressure, dt, divergence)
        result = self.pressure_solver.solve(
            pressure, weighted=True, step=dt * dt, tolerance=self.numerics.pressure_tolerance,
            maximum_iterations=self.numerics.maximum_iterations)
        self.operators.accelerate(pressure, self.velocity, dt, True)
        return result

    @ti.kernel
    def _start_correction(self):
        for i in range(self.count[None]):
            self.displacement[i] = self.velocity[i] * 0.0
            self.volume_pressure[i] = 0.0
            error = self.compression_rate[i] - self.compression_at_rest
            self.pressure_solver.right_side[i] = CORRECTION_RATE * self.volume[i] * error

    def _correct_positions(self):
        """Moves that take away compression without touching the velocity; stopping early filters noise."""
        self._start_correction()
        result = self.pressure_solver.solve(
            self.volume_pressure, weighted=False, step=1.0,
            tolerance=CORRECTION_RATE * self.numerics.pressure_tolerance,
            maximum_iterations=CORRECTION_ITERATIONS)
        self.operators.accelerate(self.volume_pressure, self.displacement, 1.0, False)
        return result

    @ti.kernel
    def _move(self, dt: float):
        limit = CORRECTION_LIMIT * self.spacing
        for i in range(self.count[None]):
            x = self.position[i] + dt * self.velocity[i]
            self.pressure[i] = self.divergence_pressure[i]
            if ti.static(self.moves_positions):
                d = self.displacement[i]
                x += d * ti.min(1.0, limit / ti.max(d.norm(), 1e-30))
            else:
                self.pressure[i] += self.volume_pressure[i]
            x, v = self.wall_stop.stopped(i, x, self.velocity[i])
            self.position[i] = x
            self.velocity[i] = v

    def _push_from_walls(self, pressure, dt: float) -> None:
        self.operators.push_from_walls_above_zero(pressure, self.position, self.acceleration, self.velocity, dt)

    def _move_by_position(self, dt: float):
        solver = self.solver
        solver.accelerate(dt)
        statistics = solver.correct_velocity(dt)
        self._push_from_walls(self.divergence_pressure, dt)
        divergence = solver.timed("pressure", self._solve, self.divergence_pressure, dt, True)
        volume = solver.timed("position correction", self._correct_positions)
        return statistics, divergence, volume, (divergence,)

    def _move_by_velocity(self, dt: float):
        solver = self.solver
        divergence = solver.timed("pressure", self._solve, self.divergence_pressure, dt, True)
        solver.accelerate(dt)
        statistics = solver.correct_velocity(dt)
        self._push_from_walls(self.volume_pressure, dt)
        volume = solver.timed("pressure", self._solve, self.volume_pressure, dt, False)
        return statistics, divergence, volume, (volume, divergence)

    def step(self, dt: float) -> dict[str, float]:
        self.solver.timed("pressure", self.operators.update_diagonals, dt)
        if self.solver.step_count % EIGENVALUE_INTERVAL == 0:
            self.solver.timed("pressure", self.set_rest_state)
        advance = self._move_by_position if self.moves_positions else self._move_by_velocity
        statistics, divergence, volume, converged = advance(dt)
        self.solver.timed("position correction", self._move, dt)
        return statistics | {
            "pressure_iterations": divergence[0] + volume[0], "divergence_iterations": divergence[0],
            "volume_iterations": volume[0], "residual_mean": converged[0][1], "residual_maximum": converged[0][2],
            "pressure_limit_hit": float(max(solve[0] for solve in converged) >= self.numerics.maximum_iterations),
            "wall_contacts": float(self.wall_stop.total())}

    def state(self) -> dict:
        return {"eigenvalue": self.pressure_solver.eigenvalue[None]}

    def restore(self, state: dict) -> None:
        self.pressure_solver.set_eigenvalue(float(state["eigenvalue"]))
