"""Figures 6 to 9 of the collision paper [mao, figs. 6-9]: what collides, and how it ends, by a number for each figure.

The paper shows pictures. Here each figure has a number: the speed at which the balls part (Fig. 6), the pieces into
which the bars break (Fig. 7), the share of the ball that is past the plane of the disk (Fig. 8), and how much of the
yolk holds together (Fig. 9). Beside them stands the share of the computing time that the collision takes; Table 1 of
the paper and the text after it name 20 to 30 %.
"""
import dataclasses
from collections.abc import Mapping

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.base.frame_files import FrameData
from pipeline.pictures.container_sheet import moments
from pipeline.pictures.picture_grid import sheet
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.model import Scene
from pipeline.simulation.cost_files import seconds_of
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row
from sim.parameters import parameter

PICTURES = ("collision_pictures",)
WIDTH = 460         # of a picture, in pixels of the large canvas
TOUCHING = 1.5      # particles of one liquid closer than this, in spacings, are of one piece
SMALLEST_PIECE = 5  # particles
TIME_SHARE = 0.3    # of the collision, at most, in the paper
TOGETHER = 0.9      # share of a body in its largest piece, or below the funnel, that counts as all of it


@dataclasses.dataclass(frozen=True)
class Parameters:
    """The scenes of every figure, in the order of the paper; the first liquid of a disk's scene is the ball's."""

    balls: tuple[str, ...] = parameter(meaning="Fig. 6: soft, stiff")
    bars: tuple[str, ...] = parameter(meaning="Fig. 7: soft, stiff")
    disks: tuple[str, ...] = parameter(meaning="Fig. 8: fast, slow, equal masses")
    eggs: tuple[str, ...] = parameter(meaning="Fig. 9: a, b, c; the second liquid is the yolk")
    pictures: int = parameter(4, minimum=2, maximum=8, meaning="times at which every scene is drawn")


def scenes(parameters: Parameters) -> tuple[str, ...]:
    """Names of the scenes whose results are read."""
    return parameters.balls + parameters.bars + parameters.disks + parameters.eggs


@dataclasses.dataclass(frozen=True)
class Played:
    """A run and what its frames hold, in memory."""

    run: RunFolder
    frames: list[FrameData]

    @property
    def scene(self) -> Scene:
        """The scene that was run."""
        return self.run.scene

    @property
    def seconds(self) -> tuple[float, float]:
        """Wall time per frame, s, and the share of the collision; without the frame in which all is compiled."""
        wall, collision = (seconds_of(self.run.costs, f"{name}_seconds")[2:] for name in ("wall", "collision"))
        return float(wall.mean()), float(collision.sum() / wall.sum())


def run(parameters: Parameters, folders: Mapping[str, RunFolder]) -> Outcome:
    """Measure every figure, and state for each whether it comes out as in the paper."""
    runs = {name: played(folders[name]) for name in scenes(parameters)}
    outcome = Outcome(pictures={PICTURES[0]: _contact_sheet(list(runs.values()), parameters.pictures)})
    for figure, names, rows in (("Fig. 6", parameters.balls, _balls), ("Fig. 7", parameters.bars, _bars),
                                ("Fig. 8", parameters.disks, _disks), ("Fig. 9", parameters.eggs, _eggs)):
        for row, words in rows([runs[name] for name in names]):
            outcome.rows.append(dataclasses.replace(row, at=f"{figure}{row.at}"))
            if row.holds is not None:
                outcome.remarks.append(f"{figure}{row.at} {'' if row.holds else 'NOT '}as in the paper: {words}")
    for name, each in runs.items():
        wall, share = each.seconds
        outcome.rows += [Row("particles", float(len(each.frames[0].id)), at=name),
                         Row("wall time per frame", wall, "s", at=name),
                         Row("share of the time in collision", share, reference=TIME_SHARE,
                             error=max(0.0, share - TIME_SHARE), tolerance=0.0, at=name)]
    return outcome


def played(run: RunFolder) -> Played:
    """Read all frames of a run."""
    return Played(run, [frame.read() for frame in run.frames])


def _at_least(quantity: str, value: float, least: float, at: str) -> Row:
    return Row(quantity, value, reference=least, error=max(0.0, least - value), tolerance=0.0, at=at)


def _balls(runs: list[Played]) -> list[tuple[Row, str]]:
    soft, stiff = (parting_speed(each) for each in runs)
    quantity = "largest speed apart / of approach"
    return [(Row(quantity, soft, at="a"), ""),
            (_at_least(quantity, stiff, max(soft, 0.0), "b"),
             f"the stiff balls part with {stiff:.3f} of their speed of approach, the soft ones with {soft:.3f}.")]


def parting_speed(each: Played) -> float:
    """Largest speed at which the centers of mass of the two liquids part, over that at which they met.

    Not the last one: what is thrown back may have met the wall of the container by then.
    """
    speeds = []
    for frame in each.frames:
        apart, relative = (of(frame, 1) - of(frame, 0) for of in (_center, _velocity))
        speeds.append(relative @ apart / np.linalg.norm(apart))
    return float(max(speeds) / np.linalg.norm(_velocity(each.frames[0], 1) - _velocity(each.frames[0], 0)))


def _center(frame: FrameData, phase: int) -> np.ndarray:
    return frame.position[frame.phase == phase].astype(float).mean(axis=0)


def _velocity(frame: FrameData, phase: int) -> np.ndarray:
    return frame.velocity[frame.phase == phase].astype(float).mean(axis=0)


def _bars(runs: list[Played]) -> list[tuple[Row, str]]:
    soft, stiff = (sum(np.count_nonzero(piece_sizes(each.frames[-1], phase) >= SMALLEST_PIECE) for phase in (0, 1))
                   for each in runs)
    quantity = f"pieces of {SMALLEST_PIECE} particles or more at the end"
    return [(Row(quantity, float(soft), at="a"), ""),
            (Row(quantity, float(stiff), reference=float(soft), error=float(max(0, stiff - soft + 1)), tolerance=0.0,
                 at="b"), f"the stiff bars are in {stiff} pieces, the soft ones in {soft} (fewer are asked for).")]


def piece_sizes(frame: FrameData, phase: int) -> np.ndarray:
    """Numbers of particles of the connected pieces of one liquid, the largest first."""
    position = frame.position[frame.phase == phase].astype(float)
    pairs = cKDTree(position).query_pairs(TOUCHING * frame.particle_spacing, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=2 * (len(position),))
    return np.sort(np.bincount(connected_components(links, directed=False)[1]))[::-1]


def _disks(runs: list[Played]) -> list[tuple[Row, str]]:
    found = []
    for letter, each, passes in zip("abc", runs, (1.0, 0.0, 0.0), strict=True):
        share = share_past(each.frames[-1])
        speed = np.linalg.norm(_velocity(each.frames[0], 0))
        found.append((Row("share of the ball past the plane of the disk", share, reference=passes,
                          error=abs(share - passes), tolerance=0.5, at=letter),
                      f"at {speed:.3g} m/s and {each.scene.liquids[0].density / each.scene.liquids[1].density:g} times "
                      f"the mass {100.0 * share:.0f} % of the ball are past the plane of the disk."))
    return found


def share_past(frame: FrameData) -> float:
    """Share of the first liquid that is past the median plane, across the line of flight x, of the second."""
    x = frame.position[:, 0]
    return float(np.mean(x[frame.phase == 0] > np.median(x[frame.phase == 1])))


def _eggs(runs: list[Played]) -> list[tuple[Row, str]]:
    found = []
    for letter, each in zip("abc", runs, strict=True):
        last = each.frames[-1]
        whole = piece_sizes(last, 1)[0] / np.count_nonzero(last.phase == 1)
        found.append((_at_least("share of the yolk in one piece", whole, TOGETHER, letter),
                      f"{100.0 * whole:.0f} % of the yolk hold together."))
        for funnel in each.scene.container.funnels:
            below = float(np.mean(last.position[:, 1] < funnel.center[1]))
            found.append((_at_least("share of the egg below the funnel", below, TOGETHER, letter),
                          f"{100.0 * below:.0f} % of the egg are through the funnel."))
    return found


def _contact_sheet(runs: list[Played], count: int) -> bytes:
    """All scenes, a row each, at some times, as PNG."""
    return sheet([row_of_moments(each, count, WIDTH) for each in runs])


def row_of_moments(each: Played, count: int, width: int):
    """Title and pictures of a run at equal times, the start and the end included, for ``sheet``."""
    saved = each.run.frames
    chosen = [saved[index] for index in np.rint(np.linspace(0, len(saved) - 1, count)).astype(int)]
    return each.scene.title, moments(each.scene, chosen, width, lambda _, frame: f"{1e3 * frame.time:.0f} ms")


FAMILY = Family(__name__, Parameters, run, scenes=scenes, reads=("frames", "surfaces"), pictures=PICTURES)
