"""Parts of the wall of an eye: the retina and its parts, and what closes the cavity before it.

Origin in the center of the globe, x to the patient's left, y superior, z anterior.
"""
import numpy as np

from pipeline.scenes.eye_shape import LENS_EDGE, LENS_RADIUS, EyeShape
from pipeline.scenes.retina import ORA

RETINA_ANGLE = np.radians(ORA)
MACULA_RADIUS = 2.75e-3           # m, disc at the posterior pole
REGIONS = ("retina", "macula", "pars_plana", "ciliary_body", "lens")  # the retina is that around the macula
MESH_REGIONS = ("retina", "macula", "anterior")  # of a user's mesh, whose lens is not known
CHAMBER_REGIONS = (*REGIONS, "cornea")           # where the anterior chamber is filled too
RETINA, MACULA, PARS_PLANA, CILIARY_BODY, LENS, CORNEA = range(len(CHAMBER_REGIONS))
ANTERIOR = 2


def retina_parts(points: np.ndarray) -> dict[str, np.ndarray]:
    """Return which points (n, 3) of a wall belong to the retina and its parts, name -> (n,) bool."""
    x, y, z = points.T
    retina = np.arccos(-z / np.linalg.norm(points, axis=1)) <= RETINA_ANGLE
    return {"whole": retina, "superior": retina & (y > 0), "inferior": retina & (y < 0),
            "macula": retina & (z < 0) & (np.hypot(x, y) <= MACULA_RADIUS)}


def region_names(shape: EyeShape | None) -> tuple[str, ...]:
    """Return the names of the regions of an eye; without a shape those of a user's mesh."""
    if shape is None:
        return MESH_REGIONS
    return REGIONS if shape.cornea is None else CHAMBER_REGIONS


def regions_of(points: np.ndarray, shape: EyeShape | None) -> np.ndarray:
    """Return the region of points (n, 3) of a wall: the index (n,) into ``region_names``.

    Before the retina, of the surfaces that bound the cavity the nearest counts: the globe is the pars plana, the front
    plane the ciliary body with the zonule, without a lens the iris and the pupil. Behind an artificial lens the plane
    is lens up to its edge.

    Parameters
    ----------
    shape : of a parametric eye; None of a user's mesh, whose regions are ``MESH_REGIONS``.
    """
    parts = retina_parts(points)
    if shape is None:
        front = np.full(len(points), ANTERIOR)
    else:
        globe = np.abs(np.linalg.norm(points / shape.half_axes, axis=1) - 1.0) * shape.half_axes.min()
        distances = [globe, np.abs(points[:, 2] - shape.front)]
        if shape.lens_pole is not None:
            center = np.array([0.0, 0.0, shape.lens_pole + LENS_RADIUS])
            distances.append(np.abs(np.linalg.norm(points - center, axis=1) - LENS_RADIUS))
        front = PARS_PLANA + np.argmin(distances, axis=0)
        if shape.artificial_lens:
            front[(front == CILIARY_BODY) & (np.hypot(*points[:, :2].T) < LENS_EDGE)] = LENS
        if shape.cornea is not None:
            before, iris, cornea = points[:, 2] > shape.front, shape.iris(points), shape.chamber(points)
            front[np.abs(iris) < np.abs(shape.globe(points))] = CILIARY_BODY
            front[before & (np.abs(cornea) < np.abs(iris))] = CORNEA
    return np.where(parts["macula"], MACULA, np.where(parts["whole"], RETINA, front)).astype(np.int32)
