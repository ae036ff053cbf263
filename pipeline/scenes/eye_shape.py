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

from pipeline.scenes.model import LENSES, Buckle, Eye, Staphyloma

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
SUBDIVISIONS = 5                # 20,480 triangles, edges of 0.4 mm; one more where the far wall is seen from the pupil
# Back of the cornea, of the Gullstrand eye: radius, and distance of its apex to the front.
CORNEA_RADIUS, CORNEA_THICKNESS = 6.8e-3, 0.5e-3
IRIS_ANGLE = np.radians(15.0)   # of front and back of the iris with its plane: a wedge whose edge is the pupil
LONGEST_EMMETROPIC = 25.7e-3    # m: halfway between the two groups of imaged eyes
HOUR = np.radians(30.0)         # of the clock
# Places on the axis, over the half length, from which the whole wall may be seen; directions and distances looked at.
VIEWPOINTS = (-0.5, -0.4, -0.3, -0.2, -0.1, 0.0, 0.1, 0.2)
SIGHTINGS, STEPS = 1000, 160


@dataclasses.dataclass(frozen=True)
class EyeShape:
    """Lengths (m) of one cavity.

    Attributes
    ----------
    half_axes : (3,) half axes of the globe along x, y and z.
    front : height z of the plane that closes the cavity in front: ciliary body, lens equator, or iris.
    lens_pole : height z of the posterior pole of the own lens, or None without it.
    artificial_lens : whether the front plane is an artificial lens, up to the edge of a lens.
    cornea : height z of the apex of the back of the cornea, where the cavity goes on before the iris; else None.
    pupil : radius of the pupil, of a cavity that goes on.
    buckle, staphyloma : what changes the wall of the globe.
    """

    half_axes: np.ndarray
    front: float
    lens_pole: float | None
    artificial_lens: bool = False
    cornea: float | None = None
    pupil: float = 0.0
    buckle: Buckle | None = None
    staphyloma: Staphyloma | None = None

    def level(self, points: np.ndarray) -> np.ndarray:
        """Function (...) of points (..., 3), negative inside the cavity; near the wall about the distance in m."""
        if self.cornea is not None:
            return _smooth_maximum(np.where(points[..., 2] < self.front, self.globe(points), self.chamber(points)),
                                   self.iris(points))
        inside = _smooth_maximum(self.globe(points), points[..., 2] - self.front)
        if self.lens_pole is None:
            return inside
        center = np.array([0.0, 0.0, self.lens_pole + LENS_RADIUS])
        return _smooth_maximum(inside, LENS_RADIUS - np.linalg.norm(points - center, axis=-1))

    def globe(self, points: np.ndarray) -> np.ndarray:
        """The same of the globe alone, with buckle and staphyloma."""
        scaled = points / self.half_axes
        radius = np.maximum(np.linalg.norm(scaled, axis=-1), 1e-9)
        slope = np.maximum(np.linalg.norm(scaled / self.half_axes, axis=-1), 1e-9)
        inside = (radius - 1.0) * radius / slope
        return inside if self.buckle is None and self.staphyloma is None else inside + self.indentation(points)

    def indentation(self, points: np.ndarray) -> np.ndarray:
        """How far buckle and staphyloma move the wall of the globe inward, (...) in m, in the directions of points."""
        direction = points / np.maximum(np.linalg.norm(points, axis=-1, keepdims=True), 1e-9)
        radius, inward = float(self.half_axes.mean()), np.zeros(points.shape[:-1])
        if self.buckle is not None:
            across = radius * (np.arccos(np.clip(-direction[..., 2], -1.0, 1.0)) - self.buckle.latitude)
            inward = inward + self.buckle.height * _bump(across / self.buckle.width)  # (L6)
            if self.buckle.clock_hours is not None:
                first, last = self.buckle.clock_hours
                half = 0.5 * HOUR * ((last - first) % 12.0)
                middle = HOUR * first + half
                around = np.arctan2(direction[..., 0], direction[..., 1]) - middle
                beyond = np.abs((around + np.pi) % (2.0 * np.pi) - np.pi) - half
                inward = inward * _bump(radius * np.sin(self.buckle.latitude) * np.maximum(beyond, 0.0)
                                        / self.buckle.width)
        if self.staphyloma is not None:
            away = radius * np.arccos(np.clip(direction @ _staphyloma_axis(self.staphyloma), -1.0, 1.0))
            inward = inward - self.staphyloma.depth * _bump(away / self.staphyloma.width)  # (L7)
        return inward

    def chamber(self, points: np.ndarray) -> np.ndarray:
        """The same of the ball whose front is the back of the cornea."""
        center = np.array([0.0, 0.0, (self.cornea or 0.0) - CORNEA_RADIUS])
        return np.linalg.norm(points - center, axis=-1) - CORNEA_RADIUS

    def iris(self, points: np.ndarray) -> np.ndarray:
        """Positive in the iris and the ciliary body, which are a wedge around the pupil."""
        outward = np.hypot(points[..., 0], points[..., 1]) - self.pupil
        return np.sin(IRIS_ANGLE) * outward - np.cos(IRIS_ANGLE) * np.abs(points[..., 2] - self.front)  # (L8)

    @property
    def altered(self) -> bool:
        """Whether it is more than an ellipsoid behind a lens."""
        return self.cornea is not None or self.buckle is not None or self.staphyloma is not None

    @property
    def viewpoint(self) -> np.ndarray:
        """Point (3,) on the axis that sees the whole wall: deep enough that the lens hides nothing.

        Raises
        ------
        ValueError : no point of the axis does.
        """
        if not self.altered:
            return np.array([0.0, 0.0, -0.5 * self.half_axes[2]])
        heights = [self.front] if self.cornea is not None else [share * self.half_axes[2] for share in VIEWPOINTS]
        for height in heights:
            if self._is_seen_from(np.array([0.0, 0.0, height])):
                return np.array([0.0, 0.0, height])
        raise ValueError("a part of the wall is hidden from every point of the optic axis")

    def _is_seen_from(self, viewpoint: np.ndarray) -> bool:
        height = np.linspace(-1.0, 1.0, SIGHTINGS)
        around = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(SIGHTINGS)
        across = np.sqrt(1.0 - height**2)
        direction = np.stack([across * np.cos(around), across * np.sin(around), height], axis=-1)
        reach = np.linspace(0.0, 3.0 * self.half_axes.max(), STEPS)
        outside = self.level(viewpoint + reach[:, None, None] * direction) > 0.0
        return bool((np.diff(outside.astype(int), axis=0) >= 0).all() and not outside[0].any())


def eye_shape(axial_length: float = REFERENCE_LENGTH, *, lens: str = "phakic",
              horizontal_diameter: float | None = None, vertical_diameter: float | None = None,
              pupil: float | None = None, buckle: Buckle | None = None,
              staphyloma: Staphyloma | None = None) -> EyeShape:
    """Lengths of the cavity of an eye.

    Parameters
    ----------
    axial_length : cornea to retina, m; 0.020 to 0.032 is the range of the sources. What a staphyloma adds to it at the
        posterior pole is part of it: the globe is shorter by that.
    lens : "phakic" (own lens bulges into the cavity), "pseudophakic" (thin artificial lens: flat front at the lens
        equator) or "aphakic" (no lens: the cavity reaches the plane of the iris).
    horizontal_diameter, vertical_diameter : inner diameters at the equator, m; default: grow with the axial length.
    pupil : its diameter, m, if the cavity goes on through it up to the cornea.
    """
    if lens not in LENSES:
        raise ValueError(f'lens is "{lens}", but must be one of {", ".join(LENSES)}')
    growth, bulge = (axial_length / REFERENCE_LENGTH) ** EQUATOR_EXPONENT, 0.0
    for _ in range(1 if staphyloma is None else 4):     # the globe decides how far the bulge reaches
        half_length = 0.5 * (axial_length - bulge - CORNEA_TO_GLOBE)
        half_axes = np.array([0.5 * (horizontal_diameter or growth * HORIZONTAL_DIAMETER),
                              0.5 * (vertical_diameter or growth * VERTICAL_DIAMETER), half_length])
        if staphyloma is not None:
            bulge = staphyloma.depth * float(_bump(half_axes.mean() * staphyloma.angle / staphyloma.width))
    lens_pole = half_length + CORNEA_TO_GLOBE - ANTERIOR_LENGTH
    lens_equator = lens_pole + LENS_RADIUS - np.sqrt(LENS_RADIUS**2 - LENS_EDGE**2)
    front = lens_pole + LENS_THICKNESS if lens == "aphakic" else lens_equator
    cornea = None if pupil is None else half_length + CORNEA_TO_GLOBE - CORNEA_THICKNESS
    return EyeShape(half_axes, front, lens_pole if lens == "phakic" else None, lens == "pseudophakic", cornea,
                    0.5 * (pupil or 0.0), buckle, staphyloma)


def shape_of(eye: Eye) -> EyeShape:
    """Return the lengths of a parametric eye of a scene."""
    return eye_shape(eye.axial_length, lens=eye.lens, horizontal_diameter=eye.horizontal_diameter,
                     vertical_diameter=eye.vertical_diameter, pupil=eye.pupil if eye.anterior_chamber else None,
                     buckle=eye.buckle, staphyloma=eye.staphyloma)


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

    sphere = pyvista.Icosphere(radius=1.0, nsub=SUBDIVISIONS + (shape.cornea is not None))
    directions = np.asarray(sphere.points, float)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    viewpoint = shape.viewpoint
    near, far = np.zeros(len(directions)), np.full(len(directions), 4.0 * shape.half_axes.max())
    for _ in range(60):
        middle = 0.5 * (near + far)
        outside = shape.level(viewpoint + middle[:, None] * directions) > 0.0
        near, far = np.where(outside, near, middle), np.where(outside, middle, far)
    vertices = viewpoint + near[:, None] * directions
    return trimesh.Trimesh(vertices, sphere.regular_faces, process=True)


def published_volume(axial_length: float) -> float:
    """Cavity volume in m3 of operated eyes by axial length in m (L1): 20 to 32 mm, r = 0.968."""
    return 1e-6 * float(np.polyval([5.89053e-4, -2.511493e-2, 0.6859611, -5.088227], 1e3 * axial_length))


def imaged_volume(axial_length: float) -> float:
    """Vitreous volume in m3 of eyes in magnetic resonance by axial length in m [zhou2020, abstract]. (L11)

    Of emmetropic eyes (23.1 +- 0.8 mm), from ``LONGEST_EMMETROPIC`` on of eyes with pathological myopia (28.3 +- 2.2).
    """
    length = 1e3 * axial_length
    return 1e-9 * (458.35 * length - 6331.14 if axial_length < LONGEST_EMMETROPIC else 546.27 * length - 6977.12)


def _smooth_maximum(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Larger of two levels, with the edge between them rounded over ``FILLET``."""
    overlap = np.maximum(1.0 - np.abs(a - b) / FILLET, 0.0)
    return np.maximum(a, b) + 0.25 * FILLET * overlap**2


def _bump(distance: np.ndarray | float) -> np.ndarray:
    """Smooth bump of the distance over its width at half height: 1 in the middle, 0 from one width on."""
    return np.cos(0.5 * np.pi * np.clip(distance, -1.0, 1.0)) ** 2


def _staphyloma_axis(staphyloma: Staphyloma) -> np.ndarray:
    around, down = HOUR * staphyloma.clock_hour, staphyloma.angle
    return np.array([np.sin(down) * np.sin(around), np.sin(down) * np.cos(around), -np.cos(down)])
