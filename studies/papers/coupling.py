"""Two blocks of liquid, one half as dense as the other, fall into a container; three methods [song, figs. 4, 5].

The paper reads retained mechanical energy as accuracy. Energy that viscosity takes is no error, so that E(t) is also
shown with the work of the viscous forces added: what is then missing is the dissipation of the method itself (all of
it, where a scene has no viscosity). The viscous power of a frame is the sum over pairs of
2(d+2) mu_ij V_i V_j |W'|/r (v_ij.x_ij)^2/r^2, that of the solver's forces; it is integrated over the frames. An
artifact of the interface is a particle whose neighbors are of the other liquid (metric `isolated_particles`) and at
least half as many as within a liquid: what flies has fewer, and is told beside it.
"""
import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pipeline.base.frame_files import FrameData
from pipeline.measures.isolation import isolated
from pipeline.pictures.container_sheet import moments
from pipeline.pictures.picture_grid import evenly, sheet
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.model import Scene
from pipeline.simulation.cost_files import seconds_of
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded
from pipeline.surfaces.saved_frame import SavedFrame
from sim.parameters import parameter

FIGURES = (
    Figure("coupling_time", "Time per frame (Song et al., Fig. 5)", "frame", "seconds of all cores"),
    Figure("coupling_energy", "Mechanical energy (Song et al., Fig. 5)", "frame", "energy above rest / that of the "
           "reference frame"),
    Figure("coupling_balance", "Mechanical energy plus what viscosity has taken", "frame",
           "(energy above rest + viscous work) / start"),
    Figure("coupling_isolated", "Artifacts of the interface", "frame", "isolated particles / particles, without spray"),
)
PICTURES = ("coupling_pictures",)
WIDTH = 480          # of a picture, in pixels of the large canvas
OURS = "volume_incompressible"
NAMES = {OURS: "Volume-incompressible method", "dfsph": "DFSPH", "wcsph": "WCSPH"}
SIMILAR = 0.25  # relative difference of computing times that counts as about the same
AT_SURFACE = 0.5  # share of the neighbors within a liquid that a particle at a plane free surface has


@dataclasses.dataclass(frozen=True)
class Parameters:
    """The scenes to compare: the same but for ``numerics.scheme``, our method first."""

    scenes: tuple[str, ...] = parameter(meaning="names of the scenes, one per method")
    reference_frame: int = parameter(30, minimum=1, meaning="frame whose energy is 100 %, as in the paper")
    pictures: int = parameter(4, minimum=1, maximum=8, meaning="times at which the methods are drawn side by side")


def scenes(parameters: Parameters) -> tuple[str, ...]:
    """Names of the scenes whose results are read."""
    return parameters.scenes


@dataclasses.dataclass(frozen=True)
class Method:
    """What one method has computed, frame by frame; energies in J (per meter of depth), times in s.

    ``warm`` marks the frames whose time counts: not the start, and not the first of a segment, in which the solver is
    compiled.
    """

    name: str
    scene: Scene
    saved: list[SavedFrame]
    frame: np.ndarray
    cpu: np.ndarray
    wall: np.ndarray
    energy: np.ndarray
    viscous: np.ndarray
    isolated: np.ndarray
    flying: np.ndarray
    warm: np.ndarray

    @property
    def seconds(self) -> float:
        """Mean computing time per frame, of all cores."""
        return float(self.cpu[self.warm].mean())


def run(parameters: Parameters, folders: Mapping[str, RunFolder]) -> Outcome:
    """Compare the methods and state for every claim of the paper whether it holds here."""
    methods = [_load(folders[name]) for name in parameters.scenes]
    reference = min(parameters.reference_frame, len(methods[0].frame) - 1)
    outcome = Outcome(pictures={PICTURES[0]: _side_by_side(methods, parameters.pictures)})
    for method in methods:
        outcome.rows += _rows(method, reference)
        outcome.curves += _curves(method, reference)
    for row, sentence in _claims(methods, reference):
        outcome.rows.append(row)
        outcome.remarks.append(sentence)
    return outcome


def _load(run: RunFolder) -> Method:
    scene, table, saved, costs = run.scene, run.table, run.frames, run.costs
    # The first segment begins with the start, before any step.
    warm = np.array([place >= (2 if segment == 0 else 1) for segment in range(len(run.segments))
                     for place in range(len(scene.frames_of_segment(segment)))])
    power = np.array([viscous_power(scene, one.read()) for one in saved])
    time = table["time [s]"]
    viscous = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(time))])
    energy = table["kinetic_energy [J]"] + table["potential_energy [J]"] - energy_at_rest(scene, saved[0].read())
    alone = np.sum([table[column] for column in table if column.startswith("isolated_particles")], axis=0)
    amid = np.array([np.mean(amid_another(scene, one.read())) for one in saved])
    return Method(scene.numerics.scheme, scene, saved, table["frame"], seconds_of(costs, "cpu_seconds"),
                  seconds_of(costs, "wall_seconds"), energy, viscous,
                  amid, alone / len(saved[0].read().position) - amid, warm)


def amid_another(scene: Scene, frame: FrameData) -> np.ndarray:
    """Mask (n,) of the isolated particles with at least half of the neighbors that a particle within a liquid has."""
    ratio = scene.numerics.support_ratio
    within = {2: math.pi * ratio**2, 3: 4.0 / 3.0 * math.pi * ratio**3}[frame.dimension]
    return isolated(frame.position, frame.phase, len(frame.liquids), ratio * frame.particle_spacing,
                    AT_SURFACE * within)


def energy_at_rest(scene: Scene, frame: FrameData) -> float:
    """Potential energy of the liquids at rest, the heaviest at the bottom of the container, J."""
    gravity = np.asarray(frame.gravity, float)[:frame.dimension]
    axis = int(np.argmax(np.abs(gravity)))
    area = math.prod(scene.container.size) / scene.container.size[axis]
    total = level = 0.0
    for phase in np.argsort([-liquid.density for liquid in scene.liquids]):
        volume = float(frame.volume[frame.phase == phase].astype(float).sum())
        total += scene.liquids[phase].density * abs(gravity[axis]) * volume * (level + 0.5 * volume / area)
        level += volume / area
    return total


def viscous_power(scene: Scene, frame: FrameData) -> float:
    """Rate at which the viscous forces within the liquid turn energy into heat, W (per meter of depth)."""
    if not {"viscosity", "viscosity_implicit"} & set(scene.effects):
        return 0.0
    position, velocity = frame.position.astype(float), frame.velocity.astype(float)[:, :frame.dimension]
    volume = frame.volume.astype(float)
    viscosity = np.array([liquid.dynamic_viscosity for liquid in scene.liquids])[frame.phase]
    support = scene.numerics.support_ratio * frame.particle_spacing
    i, j = cKDTree(position).query_pairs(support, output_type="ndarray").T
    x = position[i] - position[j]
    r = np.sqrt((x**2).sum(axis=1))
    mean = 2.0 * viscosity[i] * viscosity[j] / np.maximum(viscosity[i] + viscosity[j], 1e-20)
    slope = _kernel_slope(scene.numerics.kernel, r / support, support, frame.dimension)
    approach = ((velocity[i] - velocity[j]) * x).sum(axis=1) / np.maximum(r, 1e-12 * support)
    return float((2.0 * (frame.dimension + 2.0) * mean * volume[i] * volume[j] * slope
                  / np.maximum(r, 1e-12 * support) * approach**2).sum())


def _kernel_slope(kernel: str, q: np.ndarray, support: float, dimension: int) -> np.ndarray:
    """|dW/dr| of the scene's kernel."""
    if kernel == "wendland_c2":
        scale = {2: 7.0 / np.pi, 3: 10.5 / np.pi}[dimension]
        return 20.0 * scale * q * np.maximum(1.0 - q, 0.0) ** 3 / support ** (dimension + 1)
    scale = {2: 40.0 / (7.0 * np.pi), 3: 8.0 / np.pi}[dimension]
    return scale * np.where(q <= 0.5, 6.0 * (2.0 * q - 3.0 * q**2), 6.0 * np.maximum(1.0 - q, 0.0) ** 2) / support ** (
        dimension + 1)


def _rows(method: Method, reference: int) -> list[Row]:
    at: dict[str, Any] = {"at": method.name, "wall_s": float(method.wall[1:].sum())}
    start = method.energy[0]
    return [
        Row("computing time per frame, all cores", method.seconds, "s", **at),
        Row("wall time per frame", float(method.wall[method.warm].mean()), "s", **at),
        Row(f"mechanical energy at the end / frame {reference}", method.energy[-1] / method.energy[reference], **at),
        Row("mechanical energy at the end / start", method.energy[-1] / start, **at),
        Row("viscous work / energy at the start", method.viscous[-1] / start, **at),
        Row("energy lost otherwise / energy at the start", 1.0 - (method.energy[-1] + method.viscous[-1]) / start,
            **at),
        bounded("largest gain of energy between frames / energy at the start",
                max(0.0, float(np.diff(method.energy).max()) / start), 0.01, **at),
        Row("isolated particles / particles, mean", float(method.isolated.mean()), **at),
        Row("isolated particles / particles, largest", float(method.isolated.max()), **at),
        Row("isolated particles that fly / particles, mean", float(method.flying.mean()), **at),
    ]


def _curves(method: Method, reference: int) -> list[Curve]:
    late = slice(reference, None)
    return [Curve("coupling_time", method.name, method.frame[method.warm], method.cpu[method.warm], "line"),
            Curve("coupling_energy", method.name, method.frame[late], method.energy[late] / method.energy[reference],
                  "line"),
            Curve("coupling_balance", method.name, method.frame, (method.energy + method.viscous) / method.energy[0],
                  "line"),
            Curve("coupling_isolated", method.name, method.frame, method.isolated, "line")]


def _claims(methods: list[Method], reference: int) -> list[tuple[Row, str]]:
    """A row and a sentence for every claim of the paper that the methods at hand can judge."""
    known = {method.name: method for method in methods}
    ours, others = known.get(OURS), [method for method in methods if method.name != OURS]
    if ours is None or not others:
        return []
    claims = []
    if "dfsph" in known:
        ratio = ours.seconds / known["dfsph"].seconds
        claims.append((Row("claim: about as fast as DFSPH (time over that of DFSPH)", ratio, reference=1.0,
                           error=abs(ratio - 1.0), tolerance=SIMILAR),
                       f"it is about as fast as DFSPH: a frame takes {ratio:.2f} times the computing time"))
    if "wcsph" in known:
        ratio = known["wcsph"].seconds / ours.seconds
        claims.append((Row("claim: twice as fast as WCSPH (time of WCSPH over ours)", ratio, reference=2.0,
                           error=max(0.0, 1.0 - ratio / 2.0), tolerance=SIMILAR, relative=True),
                       f"it is about twice as fast as WCSPH: WCSPH takes {ratio:.2f} times its computing time"))
    kept = {method.name: method.energy[-1] / method.energy[reference] for method in methods}
    best = max(others, key=lambda method: kept[method.name])
    words = ", ".join(f"{name} {100.0 * share:.1f} %" for name, share in kept.items())
    claims.append((Row("claim: keeps the most mechanical energy (ours less the best other)",
                       kept[OURS] - kept[best.name], reference=0.0, error=max(0.0, kept[best.name] - kept[OURS]),
                       tolerance=0.0),
                   f"it keeps the most mechanical energy from frame {reference} to the end: {words}"))
    alone = {method.name: float(method.isolated.mean()) for method in methods}
    least = min(alone[method.name] for method in others)
    words = ", ".join(f"{name} {1000.0 * share:.2f}" for name, share in alone.items())
    claims.append((Row("claim: no artifacts at the interface (isolated particles, ours less the least other)",
                       alone[OURS] - least, reference=0.0, error=max(0.0, alone[OURS] - least), tolerance=0.0),
                   f"it has the fewest artifacts at the interface: isolated particles per thousand, mean: {words}"))
    return [(row, f'Claim of the paper {"held" if row.holds else "NOT held"} here: {sentence}.')
            for row, sentence in claims]


def _side_by_side(methods: list[Method], count: int) -> bytes:
    """A row for every method, at the same times from left to right, as PNG."""
    indices = evenly(count, min(len(method.saved) for method in methods))
    return sheet([(NAMES.get(method.name, method.name), moments(method.scene, [method.saved[k] for k in indices], WIDTH,
                                                                lambda _, frame: f"{frame.time:.2f} s"))
                  for method in methods])


FAMILY = Family(__name__, Parameters, run, scenes=scenes, reads=("frames", "surfaces"), figures=FIGURES,
                pictures=PICTURES)
