"""Maps of the fundus at moments of a run, side by side."""
from collections.abc import Iterator

import numpy as np
from PIL import Image

from pipeline.pictures.fundus_map import FundusMap
from pipeline.pictures.marks import OVERSAMPLING, clock, reduce
from pipeline.pictures.moments import evenly_chosen
from pipeline.pictures.paint import paint_of
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.retina import globe_radius
from pipeline.web.embedded import data_url, webp

MOMENTS = 6
SIZE = 300  # pixels


def fundus_strip(run: RunFolder) -> Iterator[tuple[str, str]]:
    """Yield time in words and map as a data URL."""
    scene, maps = run.scene, None
    for path in evenly_chosen(run.pictures, MOMENTS):
        wall = run.frame_of(path).read_wall()
        if maps is None:
            points = np.asarray(wall.points, float)
            maps = FundusMap(points, (OVERSAMPLING * SIZE, OVERSAMPLING * SIZE),
                             right_eye=scene.eye.side == "right", captions=False, paint=paint_of(scene),
                             outlines={name: one.outline() for name, one in
                                       scene.patches(globe_radius(points))["breaks"].items()})
        drawn: Image.Image = maps.draw(wall, uncertain=0.5 * scene.numerics.particle_spacing)
        yield clock(run.time_of(path), scene.output.second_means), data_url(webp(reduce(drawn)), "image/webp")
