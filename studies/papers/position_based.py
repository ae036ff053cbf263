"""What the position-based paper describes, side by side and by numbers: honey, drops, wetting, the constraint, walls.

The paper shows one picture, of particles that stick to walls; of the rest it gives formulas. Honey has a reference: an
axisymmetric viscous current of constant volume V spreads as R = 0.894 (g V^3/(3 nu))^(1/8) t^(1/8) (Huppert 1982),
once it is thin. A wide puddle that does not wet the floor is 2 sqrt(sigma/(rho g)) high; the tension of cohesion is
known roughly only (``sim.effects.cohesion``), so that nothing is asked there. The others are held against each other.
"""
import dataclasses
from collections.abc import Mapping

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from pipeline.base.frame_files import FrameData
from pipeline.pictures.picture_grid import sheet
from pipeline.runs.run_folder import RunFolder
from pipeline.simulation.cost_files import seconds_of
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row, compared
from sim.parameters import parameter
from studies.papers.collision import Played, played, row_of_moments

PICTURES = ("position_based_pictures",)
WIDTH = 290         # of a picture, in pixels of the large canvas
CLOSE = 0.5         # spacings: nearer particles count as clumped
SPREAD = 0.95       # quantile of the radii that counts as the edge of what has spread
HUPPERT = 0.894
HUPPERT_TOLERANCE = 0.1
GRAVITY = 9.81      # m/s^2
ROUND = 0.97        # sphericity of the hull of a drop's particles that counts as round; a cube has 0.806
AT_WALL = 0.3       # spacings: particles nearer than this stick to a wall


@dataclasses.dataclass(frozen=True)
class Parameters:
    """The scenes of every row of figures; the first of each is what the paper recommends."""

    honey: tuple[str, ...] = parameter(meaning="own viscosity by XSPH, by the implicit solve, coefficient 0.01, none")
    drops: tuple[str, ...] = parameter(meaning="with cohesion, without")
    wetting: tuple[str, ...] = parameter(meaning="adhesion, from none to strong")
    constraints: tuple[str, ...] = parameter(meaning="inequality, equality, equality with artificial pressure")
    walls: tuple[str, ...] = parameter(meaning="wall particles, clamped positions")
    pictures: int = parameter(4, minimum=2, maximum=8, meaning="times at which every scene is drawn")


def scenes(parameters: Parameters) -> tuple[str, ...]:
    """Names of the scenes whose results are read."""
    return (*parameters.honey, *parameters.drops, *parameters.wetting, *parameters.constraints, *parameters.walls)


def run(parameters: Parameters, folders: Mapping[str, RunFolder]) -> Outcome:
    """Measure every scene, and say what follows."""
    runs = {name: played(folders[name]) for name in scenes(parameters)}
    outcome = Outcome(pictures={PICTURES[0]: _contact_sheet(list(runs.values()), parameters.pictures)})
    for judge, names in ((_honey, parameters.honey), (_drops, parameters.drops), (_wetting, parameters.wetting),
                         (_constraints, parameters.constraints), (_walls, parameters.walls)):
        judge(outcome, {name: runs[name] for name in names})
    for name, each in runs.items():
        wall = float(seconds_of(each.run.costs, "wall_seconds")[1:].sum())
        outcome.rows += [Row("particles", float(len(each.frames[0].id)), at=name),
                         Row("computing time by the clock", wall, "s", at=name)]
    return outcome


def positions(frame: FrameData) -> np.ndarray:
    """Positions in double precision, m."""
    return frame.position.astype(float)[:, :frame.dimension]


def spacings(frame: FrameData) -> np.ndarray:
    """Distance of every particle to its nearest neighbor, in particle spacings."""
    x = positions(frame)
    return cKDTree(x).query(x, 2)[0][:, 1] / frame.particle_spacing


def sphericity(frame: FrameData) -> float:
    """Area of a ball over that of the particles' hull of the same volume."""
    hull = ConvexHull(positions(frame))
    return float(np.pi ** (1.0 / 3.0) * (6.0 * hull.volume) ** (2.0 / 3.0) / hull.area)


def spread(frame: FrameData, below: float = np.inf) -> float:
    """Radius about the upright axis within which 95 % of the particles are, of those below a height, m."""
    x = positions(frame)
    radius = np.linalg.norm((x - x.mean(axis=0))[:, [0, 2]], axis=1)
    low = x[:, 1] < below
    return float(np.quantile(radius[low], SPREAD)) if low.any() else 0.0


def huppert_radius(volume: float, viscosity: float, time: float) -> float:
    """Radius of a viscous current, m, from volume, m3, kinematic viscosity, m2/s, and time, s."""
    return HUPPERT * (GRAVITY * volume**3 / (3.0 * viscosity) * time) ** 0.125


def energies(each: Played, index: int) -> tuple[float, float]:
    """Kinetic energy, and potential energy above the floor, J (in 2D of a layer 1 m deep), of one frame."""
    frame = each.frames[index]
    mass = frame.volume.astype(float) * np.array([liquid.density for liquid in each.scene.liquids])[frame.phase]
    kinetic = 0.5 * mass @ (frame.velocity.astype(float) ** 2).sum(axis=1)
    return float(kinetic), float(GRAVITY * mass @ positions(frame)[:, 1])


def _honey(outcome: Outcome, runs: dict[str, Played]) -> None:
    radii = {}
    for number, (name, each) in enumerate(runs.items()):
        last, liquid = each.frames[-1], each.scene.liquids[0]
        radii[name] = spread(last) / np.sqrt(SPREAD)  # in an even layer, areas go with the square of the radius
        if number < 2:
            expected = huppert_radius(float(last.volume.astype(float).sum()),
                                      liquid.dynamic_viscosity / liquid.density, last.time)
            outcome.rows.append(compared("radius at the end, viscous current (Huppert 1982)", radii[name], expected,
                                         HUPPERT_TOLERANCE, "m", at=name))
        else:
            outcome.rows.append(Row("radius at the end", radii[name], "m", at=name))
        outcome.rows += [Row("share of particles nearer than half a spacing", float((spacings(last) < CLOSE).mean()),
                             at=name),
                         Row("kinetic energy at the end", energies(each, -1)[0], "J", at=name)]
    words = ", ".join(f"{name} {1000.0 * radius:.0f} mm" for name, radius in radii.items())
    outcome.remarks.append(f"Honey, radius after {last.time:g} s: {words}; a viscous current has "
                           f"{1000.0 * expected:.0f} mm.")


def _drops(outcome: Outcome, runs: dict[str, Played]) -> None:
    found = {name: sphericity(each.frames[-1]) for name, each in runs.items()}
    (first, value), *others = found.items()
    outcome.rows.append(Row("sphericity at the end", value, reference=1.0, error=max(0.0, ROUND - value), tolerance=0.0,
                            at=first))
    outcome.rows += [Row("sphericity at the end", other, at=name) for name, other in others]
    outcome.remarks.append("Cohesion, sphericity at the end: " + ", ".join(
        f"{name} {other:.3f}" for name, other in found.items()) + " (a cube 0.806).")


def puddle_height(tension: float, density: float) -> float:
    """Height of a wide puddle that does not wet the floor, m, from tension, N/m, and density, kg/m3."""
    return 2.0 * float(np.sqrt(tension / (density * GRAVITY)))


def _wetting(outcome: Outcome, runs: dict[str, Played]) -> None:
    heights = {}
    for name, each in runs.items():
        last = each.frames[-1]
        heights[name] = float(positions(last)[:, 1].max()) + 0.5 * last.particle_spacing
        dry = puddle_height(each.scene.effects["cohesion"].tension, each.scene.liquids[0].density)
        outcome.rows += [compared("height at the end, against a puddle that does not wet", heights[name], dry, None,
                                  "m", at=name),
                         Row("radius of the foot at the end", spread(last, 1.5 * last.particle_spacing), "m", at=name)]
    sinks = float(max(np.diff(list(heights.values()))))
    outcome.rows.append(Row("the drop sinks with the adhesion: smallest step, below 0", sinks, "m", at="wetting",
                            error=max(0.0, sinks), tolerance=0.0))
    outcome.remarks.append("Adhesion, height of the drop: " + ", ".join(
        f"{name} {1000.0 * height:.1f} mm" for name, height in heights.items())
        + f"; a wide puddle that does not wet has {1000.0 * dry:.1f} mm.")


def _constraints(outcome: Outcome, runs: dict[str, Played]) -> None:
    clumped = {}
    for name, each in runs.items():
        later = each.frames[1:]
        share = [float((spacings(frame) < CLOSE).mean()) for frame in later]
        clumped[name] = float(np.mean(share))
        outcome.rows += [
            Row("share of particles nearer than half a spacing, mean", clumped[name], at=name),
            Row("smallest spacing / dx, mean of the frames",
                float(np.mean([spacings(frame).min() for frame in later])), at=name),
            Row("mechanical energy at the end / start", sum(energies(each, -1)) / sum(energies(each, 0)), at=name),
            Row("particles without a neighbor within 1.5 spacings, mean share",
                float(np.mean([(spacings(frame) > 1.5).mean() for frame in later])), at=name)]
    first, second, *_ = clumped.values()
    outcome.rows.append(Row("clumped particles, inequality / equality", first / max(second, 1e-30), at="constraints",
                            error=max(0.0, first - second), tolerance=0.0))
    outcome.remarks.append("Constraint, particles nearer than half a spacing: " + ", ".join(
        f"{name} {100.0 * share:.1f} %" for name, share in clumped.items()) + ".")


def _walls(outcome: Outcome, runs: dict[str, Played]) -> None:
    found = {}
    for name, each in runs.items():
        last, size = each.frames[-1], np.array(each.scene.container.size)
        x = positions(last)
        nearest = np.minimum(x, size - x).min(axis=1)
        found[name] = float((nearest < AT_WALL * last.particle_spacing).mean())
        outcome.rows.append(Row("share of particles on a wall at the end", found[name], at=name))
    outcome.remarks.append("Walls, particles on one at the end: " + ", ".join(
        f"{name} {100.0 * share:.1f} %" for name, share in found.items()) + ".")


def _contact_sheet(runs: list[Played], count: int) -> bytes:
    """All scenes, two side by side, at some times, as PNG."""
    return sheet([row_of_moments(each, count, WIDTH) for each in runs], across=2)


FAMILY = Family(__name__, Parameters, run, scenes=scenes, reads=("frames", "surfaces"), pictures=PICTURES)
