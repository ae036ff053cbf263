"""Surfaces of an opened eye and of the liquids in it, for renderers; lengths in mm, axes of the eye.

Equations: docs/methods/pictures.md.
"""
import dataclasses

import numpy as np

from pipeline.illustration.anatomy import CHOROID, CILIARY_TIP, MM, Anatomy, Level

PLANE_CELL = 0.1            # mm, of the plane of the cut
SHELL_CELL, FRONT_CELL = 0.4, 0.14      # mm, of the grids on which the surfaces of the parts are found
FIBERS, FIBER_RADIUS = 150, 0.028       # zonular fibers in the half, from either side of the lens; mm
NERVE_RADIUS, NERVE_LENGTH = 1.6, 6.0  # mm
FULL_ANGLE = 180.0          # degrees from the posterior pole at the edge of the fundus texture
TOUCHING, NEAR_WALL = 0.3, 0.8          # mm: oil nearer to the wall is pushed into it; farther is left alone
PUSH, APART = 0.65, 0.06    # mm, how far, or how far the whole oil is drawn in
PASSES = 8                  # of Taubin's smoothing of the interface
SMALLEST_BODY = 3.0         # particles: smaller drops of oil are left out


@dataclasses.dataclass
class Part:
    """A surface and what it is made of.

    Attributes
    ----------
    name : of the part, such as "sclera"; what it looks like is with the renderers.
    points : (n, 3) mm.
    triangles : (m, 3).
    normals : (n, 3), or None where faces are flat.
    places : (n, 2) of the texture, or None.
    """

    name: str
    points: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray | None = None
    places: np.ndarray | None = None


@dataclasses.dataclass(frozen=True)
class Liquids:
    """What is shown of one frame.

    Attributes
    ----------
    parts : interface and faces on the plane of the cut.
    left_out : drops of oil too small to draw.
    places : name of a part -> (3,) mm, a point deep in a face on the cut, for its label.
    """

    parts: list[Part]
    left_out: int = 0
    places: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)


class Opening:
    """The plane that opens an eye through its optic axis, fine enough to be clipped.

    Parameters
    ----------
    toward : (3,) unit vector along x or y, toward the half that is taken away.
    bounds : half width of the plane, mm.
    """

    def __init__(self, toward: np.ndarray, bounds: float):
        import pyvista

        self.toward = np.asarray(toward, float)
        across = np.cross([0.0, 0.0, 1.0], self.toward)
        count = int(np.ceil(2.0 * bounds / PLANE_CELL))
        plane = pyvista.Plane(center=(0.0, 0.0, 0.0), direction=tuple(self.toward), i_size=2.0 * bounds,
                              j_size=2.0 * bounds, i_resolution=count, j_resolution=count).triangulate()
        plane.clear_data()
        self.plane, self.points, self.across = plane, np.asarray(plane.points, float), across

    def face(self, name: str, level: np.ndarray, lifted: float = 0.0) -> Part | None:
        """The part of the plane (n,) where a level of its points is negative; None if that is nowhere."""
        plane = self.plane.copy(deep=False)
        plane.point_data["level"] = level
        found = plane.clip_scalar(scalars="level", value=0.0, invert=True).triangulate()
        if not found.n_cells:
            return None
        points = np.asarray(found.points, float) + lifted * self.toward
        return Part(name, points, found.regular_faces, np.tile(self.toward, (len(points), 1)))

    def kept(self, mesh):
        """The half of a pyvista.PolyData that stays."""
        return mesh.clip(normal=tuple(self.toward), origin=(0.0, 0.0, 0.0), invert=True).triangulate()


def surface_of(name: str, level: Level, box: np.ndarray, cell: float, opening: Opening) -> Part | None:
    """The surface of a level in a box (2, 3), mm, in the half that stays; None if there is none."""
    from skimage.measure import marching_cubes

    axes = [np.arange(low, high + cell, cell) for low, high in box.T]
    values = level(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    if values.min() >= 0.0 or values.max() <= 0.0:
        return None
    vertices, faces, _, _ = marching_cubes(values, 0.0, spacing=[cell] * 3, gradient_direction="ascent")
    return half_of(name, _mesh(vertices + box[0], faces), opening)


def half_of(name: str, mesh, opening: Opening) -> Part | None:
    """The half of a surface that stays, with the normals of the whole."""
    mesh = opening.kept(mesh.compute_normals(cell_normals=False, split_vertices=False, auto_orient_normals=False,
                                             consistent_normals=False))
    return part_of(name, mesh) if mesh.n_cells else None


def clipped(part: Part, level: Level) -> Part:
    """What of a part lies where a level is positive."""
    mesh = _mesh(part.points, part.triangles)
    mesh.point_data["Normals"], mesh.point_data["level"] = part.normals, level(part.points)
    return part_of(part.name, mesh.clip_scalar(scalars="level", value=0.0, invert=False).triangulate())


def part_of(name: str, mesh) -> Part:
    """A part of a pyvista.PolyData with normals."""
    return Part(name, np.asarray(mesh.points, float), mesh.regular_faces, np.asarray(mesh.point_data["Normals"], float))


def parts_of_eye(eye, anatomy: Anatomy, opening: Opening) -> list[Part]:
    """Everything that stays as it is: the wall from inside, its layers, and what lies in front.

    Parameters
    ----------
    eye : pyvista.PolyData of the cavity, m.
    """
    at = opening.points
    reach = float(np.abs(opening.points).max())
    whole = np.array([[-reach] * 3, [reach] * 3])
    parts: list[Part | None] = [wall_of(eye, anatomy, opening)]
    outside = surface_of("sclera", anatomy.outside, whole, SHELL_CELL, opening)
    parts.append(outside if anatomy.shape is None else clipped(outside, anatomy.before_limbus))
    for name in ("sclera", "choroid", "retina"):
        parts.append(opening.face(name, getattr(anatomy, name)(at)))
    if anatomy.shape is not None:
        front = np.array([[-8.5, -8.5, anatomy.front - 4.0], [8.5, 8.5, anatomy.front + 3.5]])
        parts.append(surface_of("ciliary", lambda p: anatomy.ciliary(p, processes=True), front, FRONT_CELL, opening))
        parts.append(opening.face("ciliary_cut", anatomy.ciliary(at)))
        iris = surface_of("iris", anatomy.iris, front, FRONT_CELL, opening)
        if iris is not None:
            outward = np.linalg.norm(iris.points[:, :2], axis=1)
            around = np.arctan2(iris.points[:, 1], iris.points[:, 0]) / (2.0 * np.pi) % 1.0
            inward = np.clip((outward - anatomy.pupil) / (6.4 - anatomy.pupil), 0.0, 1.0)
            iris.places = np.stack([around, inward], axis=1)
        parts += [iris, opening.face("iris_cut", anatomy.iris(at))]
        parts.append(surface_of("lens", anatomy.lens, front, FRONT_CELL, opening))
        parts.append(opening.face("lens_cut", anatomy.lens(at)))
        dome = np.array([[-7.0, -7.0, anatomy.front], [7.0, 7.0, anatomy.apex + 0.5]])
        parts.append(surface_of("cornea", anatomy.cornea, dome, 0.2, opening))
        parts.append(opening.face("cornea_cut", anatomy.cornea(at)))
        if anatomy.shape.lens_pole is not None:
            parts.append(zonular_fibers(anatomy, opening))
    return [part for part in parts if part is not None]


def wall_of(eye, anatomy: Anatomy, opening: Opening) -> Part:
    """The inner side of the wall, with places in the texture of the fundus; what the lens closes is left out."""
    mesh = _mesh(MM * np.asarray(eye.points, float), eye.regular_faces)
    mesh = mesh.compute_normals(cell_normals=False, split_vertices=False, auto_orient_normals=True, flip_normals=True)
    if anatomy.shape is not None:
        mesh.point_data["open"] = anatomy.pane(np.asarray(mesh.points, float))
        mesh = mesh.clip_scalar(scalars="open", value=0.0, invert=False).triangulate()
    part = part_of("wall", opening.kept(mesh))
    part.places = fundus_places(part.points)
    return part


def fundus_places(points: np.ndarray) -> np.ndarray:
    """Places (n, 2) of points in the texture of the fundus, 0 to 1: angle from the posterior pole and meridian (Z3)."""
    angle = np.degrees(np.arccos(np.clip(-points[:, 2] / np.linalg.norm(points, axis=1), -1.0, 1.0)))
    meridian = np.arctan2(points[:, 1], points[:, 0])
    return 0.5 + 0.5 * angle[:, None] / FULL_ANGLE * np.stack([np.cos(meridian), np.sin(meridian)], axis=1)


def optic_nerve(anatomy: Anatomy, disc: np.ndarray, opening: Opening) -> Part | None:
    """A piece of the optic nerve behind the disc, where that half stays; ``disc`` (3,) is the direction to the disc."""
    import pyvista

    if disc @ opening.toward > 0.0:
        return None
    reach = np.linspace(0.0, 20.0, 400)[:, None] * disc
    start = reach[np.argmax(anatomy.inside(reach) > 0.0)]
    nerve = pyvista.Cylinder(center=start + (0.5 * NERVE_LENGTH + CHOROID) * disc, direction=disc, radius=NERVE_RADIUS,
                             height=NERVE_LENGTH, resolution=60).triangulate()
    return part_of("nerve", nerve.compute_normals(cell_normals=False, split_vertices=True))


def zonular_fibers(anatomy: Anatomy, opening: Opening) -> Part:
    """Fibers from the edge of the lens to the ciliary processes."""
    import pyvista

    middle = np.arctan2(-opening.toward[1], -opening.toward[0])
    places = []
    for number, turn in enumerate(np.linspace(-0.5 * np.pi, 0.5 * np.pi, FIBERS)[1:-1]):
        out = np.array([np.cos(middle + turn), np.sin(middle + turn), 0.0])
        ends = ((4.35, 0.62), (CILIARY_TIP + 0.05, 0.9)) if number % 2 else ((4.5, 0.2), (CILIARY_TIP, 0.35))
        places += [outward * out + [0.0, 0.0, anatomy.front + height] for outward, height in ends]
    mesh = pyvista.line_segments_from_points(np.array(places)).tube(radius=FIBER_RADIUS, n_sides=5).triangulate()
    mesh.clear_data()
    return part_of("zonule", mesh.compute_normals(cell_normals=False, split_vertices=False))


def liquids_of(oil, anatomy: Anatomy, opening: Opening, particle: float, whole: bool = False) -> Liquids:
    """Interface of the oil and the faces of both liquids on the plane of the cut; or the ``whole`` oil, uncut.

    Where oil touches the wall its surface is pushed into the wall, which is opaque: what is left is the interface.
    The whole oil is drawn in from the wall by ``APART`` instead, that no surface lies on another.

    Parameters
    ----------
    oil : closed pyvista.PolyData with ``depth``, m; empty where there is none.
    particle : volume of a particle, m3.
    """
    inside = anatomy.inside(opening.points)
    oil, left_out = _large_bodies(oil, particle) if oil.n_cells else (None, 0)
    if oil is None:
        return Liquids([], left_out) if whole else _faces(opening, {"aqueous_face": inside}, [], left_out)
    smooth = _mesh(MM * np.asarray(oil.points, float), oil.regular_faces).smooth_taubin(n_iter=PASSES, pass_band=0.08)
    normals = smooth.compute_normals(cell_normals=False, split_vertices=False, auto_orient_normals=True)
    depth = MM * np.asarray(oil.point_data["depth"], float)
    touching = np.clip((NEAR_WALL - depth) / (NEAR_WALL - TOUCHING), 0.0, 1.0)
    push = -APART if whole else PUSH
    smooth.points = np.asarray(smooth.points) + push * touching[:, None] * np.asarray(normals.point_data["Normals"])
    if whole:
        smooth = smooth.compute_normals(cell_normals=False, split_vertices=False, auto_orient_normals=True)
        return Liquids([part_of("glass", smooth)], left_out, {"oil_face": MM * np.asarray(oil.points).mean(axis=0)})
    of_oil = _distance_on_plane(smooth, opening, inside < 1.0)
    return _faces(opening, {"oil_face": np.maximum(inside, of_oil), "aqueous_face": np.maximum(inside, -of_oil)},
                  [half_of("interface", smooth, opening)], left_out)


def _faces(opening: Opening, levels: dict[str, np.ndarray], parts: list, left_out: int) -> Liquids:
    """Faces on the plane of the cut, by name and level of the plane's points, beside other parts."""
    faces = {name: opening.face(name, level) for name, level in levels.items()}
    return Liquids([part for part in [*parts, *faces.values()] if part is not None], left_out,
                   {name: opening.points[levels[name].argmin()] for name, face in faces.items() if face is not None})


def _distance_on_plane(mesh, opening: Opening, where: np.ndarray) -> np.ndarray:
    """Signed distance (n,), mm, of points of the plane to a closed surface, negative inside; far where not asked."""
    import pyvista

    level = np.full(len(opening.points), 1e3)
    found = pyvista.PolyData(opening.points[where]).compute_implicit_distance(mesh)
    level[where] = np.asarray(found.point_data["implicit_distance"])
    return level


def _large_bodies(oil, particle: float):
    """The bodies of a surface from ``SMALLEST_BODY`` particles on, None if there is none, and how many are smaller."""
    import trimesh

    bodies = oil.connectivity()
    number = np.asarray(bodies.point_data["RegionId"])
    faces = bodies.regular_faces
    kept, left_out = np.zeros(len(number), bool), 0
    for one in range(number.max() + 1):
        of_one = number == one
        volume = abs(trimesh.Trimesh(np.asarray(bodies.points), faces[of_one[faces[:, 0]]], process=False).volume)
        if volume >= SMALLEST_BODY * particle:
            kept |= of_one
        else:
            left_out += 1
    if not kept.any():
        return None, left_out
    if kept.all():
        return oil, left_out
    chosen = _mesh(np.asarray(bodies.points), faces[kept[faces[:, 0]]])
    chosen.point_data["depth"] = np.asarray(bodies.point_data["depth"])
    return chosen.clean(), left_out


def _mesh(points: np.ndarray, triangles: np.ndarray):
    import pyvista

    return pyvista.make_tri_mesh(np.asarray(points, float), triangles)

