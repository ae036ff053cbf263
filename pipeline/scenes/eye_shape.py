"""Parametric surface of the vitreous cavity: an ellipsoid behind the lens.

Sources: magnetic resonance of 31 adult eyes (inner diameters 22.46 / 23.29 / 22.62 mm, vitreous 16.0 mm long)
[pubmed19176097, abstract], cavity volume of 144 operated eyes against axial length [santana, abstract], vitreous depth
0.66 of the axial length of 640 eyes [takkar2019, abstract], and the posterior lens radius of 6 mm and thickness of
3.6 mm of the Gullstrand eye. Equations: docs/methods/walls.md.
Axes: origin = center of the globe, +x the patient's left, +y superior, +z anterior; lengths in m, volumes in m3.
"""
import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from pipeline.scenes.model import LENSES, Eye

if TYPE_CHECKING:
    import trimesh

REFERENCE_LENGTH = 24.0e-3
# Diameters of [pubmed19176097, abstract] times 0.968: at 24 mm the cavity then holds what was found in operated eyes
# (L1), 5.05 mL, not 5.4 mL. The equator grows slower than the length (myopic eyes are long); the exponent fits (L1)
# from 20 to 30 mm.
HORIZONTAL_DIAMETER = 0.968 * 22.46e-3
VERTICAL_DIAMETER = 0.968 * 23.29e-3
EQUATOR_EXPONENT = 0.55
ANTERIOR_LENGTH = 8.16e-3       # cornea to posterior lens pole: 0.34 of 24 mm, the same in short and long eyes
CORNEA_TO_GLOBE = 1.38e-3       # axial length less the inner length of the globe: 24.0 - 22.62 mm
LENS_RADIUS = 6.0e-3            # posterior surface of the lens
LENS_EDGE = 4.5e-3              # radius of the lens at its equator
LENS_THICKNESS = 3.6e-3         # without a lens the liquid reaches the plane of the iris, this far before the pole
FILLET = 1.0e-3                 # width over which the edges at lens and ciliary body are rounded
SMALLEST_VOLUME, LARGEST_VOLUME = 2e-6, 12e-6  # of any cavity, m3; eyes of 20 to 32 mm hold 3.3 to 10 mL
SUBDIVISIONS = 5                # 20,480 triangles, edges of 0.4 mm


@dataclasses.dataclass(frozen=True)
class EyeShape:
    """Lengths (m) of one cavity.

    Attributes
    ----------
    half_axes : (3,) half axes of the globe along x, y and z.
    front : height z of the plane that closes the cavity in front: ciliary body, lens equator, or iris.
    lens_pole : height z of the posterior pole of the own lens, or None without it.
    artificial_lens : whether the front plane is an artificial lens, up to the edge of a lens.
    """

    half_axes: np.ndarray
    front: float
    lens_pole: float | None
    artificial_lens: bool = False

    def level(self, points: np.ndarray) -> np.ndarray:
        """Function (...) of points (..., 3), negative inside the cavity; near the wall about the distance in m."""
        scaled = points / self.half_axes
        radius = np.maximum(np.linalg.norm(scaled, axis=-1), 1e-9)
        slope = np.maximum(np.linalg.norm(scaled / self.half_axes, axis=-1), 1e-9)
        inside = _smooth_maximum((radius - 1.0) * radius / slope, points[..., 2] - self.front)
        if self.lens_pole is None:
            return inside
        center = np.array([0.0, 0.0, self.lens_pole + LENS_RADIUS])
        return _smooth_maximum(inside, LENS_RADIUS - np.linalg.norm(points - center, axis=-1))

    @property
    def viewpoint(self) -> np.ndarray:
        """Point (3,) on the axis that sees the whole wall: deep enough that the lens hides nothing."""
        return np.array([0.0, 0.0, -0.5 * self.half_axes[2]])


def eye_shape(axial_length: float = REFERENCE_LENGTH, *, lens: str = "phakic",
              horizontal_diameter: float | None = None, vertical_diameter: float | None = None) -> EyeShape:
    """Lengths of the cavity of an eye.

    Parameters
    ----------
    axial_length : cornea to retina, m; 0.020 to 0.030 is the range of the sources.
    lens : "phakic" (own lens bulges into the cavity), "pseudophakic" (thin artificial lens: flat front at the lens
        equator) or "aphakic" (no lens: the cavity reaches the plane of the iris).
    horizontal_diameter, vertical_diameter : inner diameters at the equator, m; default: grow with the axial length.
    """
    if lens not in LENSES:
        raise ValueError(f'lens is "{lens}", but must be one of {", ".join(LENSES)}')
    growth = (axial_length / REFERENCE_LENGTH) ** EQUATOR_EXPONENT
    half_length = 0.5 * (axial_length - CORNEA_TO_GLOBE)
    lens_pole = half_length + CORNEA_TO_GLOBE - ANTERIOR_LENGTH
    lens_equator = lens_pole + LENS_RADIUS - np.sqrt(LENS_RADIUS**2 - LENS_EDGE**2)
    half_axes = np.array([0.5 * (horizontal_diameter or growth * HORIZONTAL_DIAMETER),
                          0.5 * (vertical_diameter or growth * VERTICAL_DIAMETER), half_length])
    front = lens_pole + LENS_THICKNESS if lens == "aphakic" else lens_equator
    return EyeShape(half_axes, front, lens_pole if lens == "phakic" else None, lens == "pseudophakic")


def globe_of(eye: Eye) -> float:
    """Return the radius of the globe behind, m; of a mesh, before it is read, that of the default eye."""
    return float(eye_shape(eye.axial_length if eye.model == "parametric" else REFERENCE_LENGTH).half_axes[2])


def eye_mesh(shape: EyeShape) -> "trimesh.Trimesh":
    """Closed triangle mesh of the cavity in m, normals outward.

    The wall is seen whole from the shape's viewpoint, so each vertex of an icosphere slides along its ray to the wall
    (bisection): the mesh is closed and its triangles are even by construction.
    """
    import pyvista
    import trimesh

    sphere = pyvista.Icosphere(radius=1.0, nsub=SUBDIVISIONS)
    directions = np.asarray(sphere.points, float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    near, far = np.zeros(len(directions)), np.full(len(directions), 4.0 * shape.half_axes.max())
    for _ in range(60):
        middle = 0.5 * (near + far)
        outside = shape.level(shape.viewpoint + middle[:, None] * directions) > 0.0
        near, far = np.where(outside, near, middle), np.where(outside, middle, far)
    vertices = shape.viewpoint + near[:, None] * directions
    return trimesh.Trimesh(vertices, sphere.regular_faces, process=True)


def published_volume(axial_length: float) -> float:
    """Cavity volume in m3 of operated eyes by axial length in m (L1): 20 to 32 mm, r = 0.968."""
    return 1e-6 * float(np.polyval([5.89053e-4, -2.511493e-2, 0.6859611, -5.088227], 1e3 * axial_length))


def _smooth_maximum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Larger of two levels, with the edge between them rounded over ``FILLET``."""
    overlap = np.maximum(1.0 - np.abs(a - b) / FILLET, 0.0)
    return np.maximum(a, b) + 0.25 * FILLET * overlap**2
