"""A drop of ink falls into water, with three diffusion coefficients [song, fig. 6].

The paper shows pictures. Here how far the liquids are mixed has numbers: the variance of the volume fraction alpha of
ink over the volume of all liquid, over that of unmixed liquids m (1 - m), with m the mean of alpha (1: unmixed, 0: the
same everywhere); and the entropy of mixing, the mean of -sum alpha ln alpha over that of the mean (0: unmixed, 1: the
same everywhere). Both count what is mixed within particles; stirring alone, as with D_m = 0, changes neither.
"""
import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.measures.mixing_metrics import entropy
from pipeline.pictures.container_sheet import moments
from pipeline.pictures.picture_grid import evenly, sheet
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.model import Scene
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded
from pipeline.surfaces.saved_frame import SavedFrame
from sim.parameters import parameter

FIGURES = (
    Figure("ink_drop_variance", "Variance of the volume fraction of ink", "time / s", "variance / unmixed"),
    Figure("ink_drop_entropy", "Entropy of mixing", "time / s", "entropy / evenly mixed"),
)
PICTURES = ("ink_drop_pictures",)
WIDTH = 500  # of a picture, in pixels of the large canvas
LATE = 0.2  # share of the scene after which the order of the scenes is judged: before, the drop has hardly touched


@dataclasses.dataclass(frozen=True)
class Parameters:
    """The scenes to compare: the same but for the diffusion coefficient, which grows."""

    scenes: tuple[str, ...] = parameter(meaning="names of the scenes, by rising diffusion coefficient")
    ink: str = parameter(meaning="name of the liquid of the drop")
    pictures: int = parameter(4, minimum=1, maximum=8, meaning="times at which the scenes are drawn side by side")


def scenes(parameters: Parameters) -> tuple[str, ...]:
    """Names of the scenes whose results are read."""
    return parameters.scenes


@dataclasses.dataclass(frozen=True)
class Mixture:
    """How far one scene is mixed, frame by frame: time, s; variance and entropy as above."""

    scene: Scene
    frames: list[SavedFrame]
    time: np.ndarray
    variance: np.ndarray
    entropy: np.ndarray
    volume_change: float

    @property
    def coefficient(self) -> float:
        """D_m, m^2/s."""
        diffusion = self.scene.effects.get("diffusion")
        return diffusion.coefficient if diffusion else 0.0


def run(parameters: Parameters, folders: Mapping[str, RunFolder]) -> Outcome:
    """Measure the mixing of every scene, and whether a larger coefficient mixes faster."""
    mixtures = [_load(folders[name], parameters.ink) for name in parameters.scenes]
    outcome = Outcome(pictures={PICTURES[0]: _rows_of_pictures(mixtures, parameters.pictures)})
    for mixture in mixtures:
        at: dict[str, Any] = {"at": mixture.scene.name}
        label = f"D_m = {mixture.coefficient:g} m²/s"
        outcome.rows += [
            Row("variance of the volume fraction at the end / unmixed", mixture.variance[-1], **at),
            Row("entropy of mixing at the end / evenly mixed", mixture.entropy[-1], **at),
            bounded("largest change of the volume of ink / start", mixture.volume_change, 1e-4, **at)]
        outcome.curves += [Curve("ink_drop_variance", label, mixture.time, mixture.variance, "line"),
                           Curve("ink_drop_entropy", label, mixture.time, mixture.entropy, "line")]
    for slower, faster in itertools.pairwise(mixtures):
        outcome.rows.append(_order(slower, faster))
        outcome.remarks.append(
            f"With D_m = {faster.coefficient:g} the variance ends at {faster.variance[-1]:.3f} and the entropy at "
            f"{faster.entropy[-1]:.3f}, with {slower.coefficient:g} at {slower.variance[-1]:.3f} and "
            f"{slower.entropy[-1]:.3f}.")
    return outcome


def _order(slower: Mixture, faster: Mixture) -> Row:
    """Share of the frames, from when the drop has met the water, in which the larger coefficient is ahead in both."""
    late = slower.time >= LATE * slower.time[-1]
    ahead = (faster.variance < slower.variance) & (faster.entropy > slower.entropy)
    share = float(ahead[late].mean())
    return Row("claim: a larger D_m mixes faster (share of the frames in which it is ahead)", share, reference=1.0,
               error=1.0 - share, tolerance=0.0, at=f"{faster.scene.name} and {slower.scene.name}")


def mixing(fraction: np.ndarray, volume: np.ndarray) -> tuple[float, float]:
    """Variance and entropy, as above, of fractions (n,) of one of two liquids in particles of volumes (n,)."""
    share = volume / volume.sum()
    mean = share @ fraction
    both = np.stack([fraction, 1.0 - fraction], axis=-1)
    return (float(share @ (fraction - mean) ** 2 / (mean * (1.0 - mean))),
            float(share @ entropy(both) / entropy(np.array([mean, 1.0 - mean]))))


def _load(run: RunFolder, ink: str) -> Mixture:
    times, measured, volumes = [], [], []
    for saved in run.frames:
        frame = saved.read()
        which = list(frame.liquids).index(ink)
        fraction, volume = frame.volume_fraction[:, which].astype(float), frame.volume.astype(float)
        times.append(frame.time)
        measured.append(mixing(fraction, volume))
        volumes.append(volume @ fraction)
    variance, mixed = np.array(measured).T
    change = float(np.abs(np.array(volumes) / volumes[0] - 1.0).max())
    return Mixture(run.scene, run.frames, np.array(times), variance, mixed, change)


def _rows_of_pictures(mixtures: list[Mixture], count: int) -> bytes:
    """A row for every scene, at the same times from left to right, as PNG; colors mix as the fractions do."""
    indices = evenly(count, min(len(mixture.frames) for mixture in mixtures))
    rows = []
    for mixture in mixtures:
        def caption(number: int, frame, mixture=mixture) -> str:
            return f"{frame.time:.2f} s, variance {mixture.variance[indices[number]]:.2f}"

        rows.append((f"D_m = {mixture.coefficient:g} m²/s",
                     moments(mixture.scene, [mixture.frames[k] for k in indices], WIDTH, caption)))
    return sheet(rows)


FAMILY = Family(__name__, Parameters, run, scenes=scenes, reads=("frames", "surfaces"), figures=FIGURES,
                pictures=PICTURES)
