"""The validated scene as the solver sees it: frozen, SI, without paths."""
import dataclasses
from typing import Any

from sim.backend.devices import AUTO, DEVICES
from sim.liquid import Liquid
from sim.parameters import parameter
from sim.schemes import REGISTRY as SCHEMES


@dataclasses.dataclass(frozen=True)
class Numerics:
    """How the equations are solved; the accuracy levels are named sets of these."""

    particle_spacing: float = parameter(unit="m", minimum=1e-9, meaning="mean distance between particles")
    scheme: str = parameter(next(iter(SCHEMES)), choices=tuple(SCHEMES), meaning="pressure solve and time integration")
    kernel: str = parameter("wendland_c2", choices=("wendland_c2", "cubic_spline"), meaning="smoothing kernel")
    support_ratio: float = parameter(2.5, minimum=2.0, maximum=4.0,
                                     meaning="support radius of the kernel in particle spacings")
    precision: str = parameter("f32", choices=("f32", "f64"), meaning="floating point format of the fields")
    pressure_tolerance: float = parameter(
        1e-4, minimum=1e-8, maximum=1e-1,
        meaning="mean residual of the pressure solve, as a share of the volume per step; in a full cavity with "
                "densities up to 1:2 it is taken times the largest displacement per step over dx")
    viscosity_tolerance: float = parameter(1e-4, minimum=1e-10, maximum=1e-1,
                                           meaning="relative residual of the implicit viscosity solve")
    maximum_iterations: int = parameter(200, minimum=1, maximum=10000, meaning="limit of iterations of every solve")
    courant_number: float = parameter(0.3, exclusive_minimum=0.0, maximum=1.0,
                                      meaning="largest displacement per step in particle spacings")
    time_error: float = parameter(
        0.05, minimum=0.005, maximum=0.1,
        meaning="error of slow motion under interface tension by the length of the time step, root mean square, as "
                "measured against steps of a quarter; felt where viscosity_implicit allows long steps")
    maximum_time_step: float = parameter(2e-3, unit="s", exclusive_minimum=0.0, meaning="largest time step")
    time_step: float | None = parameter(None, unit="s", exclusive_minimum=0.0,
                                        meaning="fixed time step, else the largest stable one")
    minimum_time_step: float = parameter(1e-7, unit="s", exclusive_minimum=0.0,
                                         meaning="the run stops with a diagnosis below this time step")
    wall_layers: int = parameter(3, minimum=2, maximum=4, meaning="layers of wall particles")
    threads: int = parameter(0, minimum=0, maximum=256, meaning="threads of the solver; 0 takes as many as are useful")
    device: str = parameter("auto", choices=(AUTO, *DEVICES),
                            meaning="device of the solver; auto takes cuda where there is an NVIDIA GPU, else cpu; "
                                    "threads mean nothing on a GPU")
    seed: int = parameter(0, minimum=0, meaning="seed of random choices (directions in which particles split)")


@dataclasses.dataclass(frozen=True)
class Settings:
    """Everything the solver needs beside arrays.

    ``effects`` holds one parameter object per active effect (``sim.effects.REGISTRY``), in any order;
    an effect that is not listed is not compiled, allocated or run. ``closed`` tells that the liquids fill the cavity
    completely; where they do not, they have a free surface. ``scheme`` holds the parameters of the scheme that
    ``numerics.scheme`` names, ``None`` for its defaults. ``periods`` holds, for every axis, the length, m, after which
    the liquids repeat, 0 where they do not; empty: no axis repeats. A periodic axis d runs from -periods[d]/2 to
    periods[d]/2. ``continued`` tells that the start is the end of another scene, in which the liquids may have mixed.
    """

    dimension: int
    liquids: tuple[Liquid, ...]
    numerics: Numerics
    effects: tuple[object, ...]
    closed: bool = True
    scheme: object | None = None
    periods: tuple[float, ...] = ()
    continued: bool = False

    @property
    def scheme_class(self) -> Any:
        """The scheme that ``numerics.scheme`` names."""
        return SCHEMES[self.numerics.scheme]
