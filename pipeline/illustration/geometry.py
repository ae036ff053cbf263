"""Surfaces of an opened eye and of the liquids in it, for renderers; lengths in mm, axes of the eye.

Equations: docs/methods/pictures.md.
"""
import dataclasses

import numpy as np

from pipeline.illustration.anatomy import MM, Anatomy, Level, in_meridian, in_mm
from pipeline.pictures.anterior_segment import ANGLE, CHOROID_END

PLANE_CELL = 0.1            # mm, of the plane of the cut
NEAR_LINE = 2.5             # cells of the plane from the line of the oil, within which its distance is exact
SHELL_CELL = 0.4            # mm, of the grid on which the outside of the eye is found
TURNS = 288                 # steps of half a turn about the optic axis, several of every process
SMOOTH_TURNS = 96           # of what is smooth: lens and cornea
PROCESSES = 36              # of the ciliary body in half a turn
FIBERS, FIBER_RADIUS = 150, 0.028       # zonular fibers in the half; mm
HAPTIC_RADIUS, HAPTIC_TURN = 0.09, np.radians(115.0)    # of the arms of an artificial lens, mm, and how far they turn
ROOT, OVER_LIMBUS = 0.25, 0.1           # mm: of the iris in the wall; of the sclera's outer side over the cornea
NERVE_RADIUS, NERVE_LENGTH = 1.6, 6.0  # mm
FULL_ANGLE = 180.0          # degrees from the posterior pole at the edge of the fundus texture
TOUCHING, NEAR_WALL = 0.3, 0.8          # mm: oil nearer to the wall is pushed into it; farther is left alone
PUSH = 0.65                 # mm, how far; where the wall is clear or thin, in front, only onto it
APART = 0.06                # mm, how far the whole oil is drawn in
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
    places : name of a part -> (3,) mm, for its label: a point deep in a face on the cut, or amid the interface.
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
        self.shape = count + 1, count + 1

    @property
    def middle(self) -> float:
        """Angle around the optic axis, from x to y, of the middle of the half that stays, rad."""
        return float(np.arctan2(-self.toward[1], -self.toward[0]))

    def face(self, name: str, level: np.ndarray) -> Part | None:
        """The part of the plane (n,) where a level of its points is negative; None if that is nowhere."""
        plane = self.plane.copy(deep=False)
        plane.point_data["level"] = level
        found = plane.clip_scalar(scalars="level", value=0.0, invert=True).triangulate()
        if not found.n_cells:
            return None
        points = np.asarray(found.points, float)
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
    mesh = opening.kept(_with_normals(mesh))
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
    parts: list[Part | None] = [*walls_of(eye, anatomy, opening)]
    outside = surface_of("sclera", anatomy.outside, whole, SHELL_CELL, opening)
    parts.append(outside if anatomy.shape is None else clipped(
        outside, lambda points: anatomy.before_limbus(points) + OVER_LIMBUS))
    for name in ("sclera", "choroid", "retina"):
        parts.append(opening.face(name, getattr(anatomy, name)(at)))
    if anatomy.segment is not None:
        parts += _front_of(anatomy, opening)
    return [part for part in parts if part is not None]


def _front_of(anatomy: Anatomy, opening: Opening) -> list[Part | None]:
    """What lies before the cavity of a parametric eye, but for the sclera."""
    segment, at = anatomy.segment, opening.points
    assert segment is not None
    angle = np.linspace(0.0, segment.limbus, 60)
    corner = np.linspace(segment.limbus, np.arctan2(ANGLE, segment.root), 10)
    outer, inner = _arc(segment.outside(angle), angle), _arc(segment.inside(angle), angle)
    parts: list[Part | None] = [
        revolved("cornea", outer, opening, SMOOTH_TURNS), revolved("cornea", inner, opening, SMOOTH_TURNS),
        revolved("sclera", np.stack([inner[-1], outer[-1]]), opening),
        clipped(revolved("sclera", _arc(segment.inside(corner), corner), opening), anatomy.inside)]
    parts += [opening.face(f"{name}_cut", getattr(anatomy, name)(at)) for name in ("cornea", "iris", "ciliary", "lens")]
    if segment.filled:
        return parts
    leaf = in_mm(segment.iris())
    for name, line in (("iris", leaf[:len(leaf) // 2 + 1]), ("iris_back", leaf[len(leaf) // 2:])):
        parts.append(clipped(revolved(name, line, opening), lambda points: ROOT - anatomy.enclosed(points)))
    parts[-2] = with_iris_places(parts[-2], MM * segment.pupil)
    if segment.front < segment.root:
        parts.append(ciliary_processes(anatomy, opening))
    lens = anatomy.lens_outline()
    if lens is not None:
        parts.append(revolved("lens", lens, opening, SMOOTH_TURNS))
    if segment.lens == "phakic":
        parts.append(zonular_fibers(anatomy, opening))
    elif segment.lens == "pseudophakic":
        parts.append(haptics(anatomy, opening))
    return parts


def _arc(reach: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Line (n, 2), mm, by distance (m) from the center of the globe and angle from the optic axis."""
    return MM * np.stack([reach * np.sin(angle), reach * np.cos(angle)], axis=-1)


def revolved(name: str, line: np.ndarray, opening: Opening, turns: int = TURNS,
             ridges: np.ndarray | None = None) -> Part:
    """The surface of a line (n, 2) that turns about the optic axis, in the half that stays.

    Parameters
    ----------
    line : distance from the optic axis and height, mm.
    turns : steps of the half turn.
    ridges : (``turns`` + 1, n) by which the line is moved outward in every step of the turn, mm.
    """
    turn = opening.middle + np.linspace(-0.5 * np.pi, 0.5 * np.pi, turns + 1)[:, None]
    across = line[:, 0] + (np.zeros((turns + 1, 1)) if ridges is None else ridges)
    height = np.broadcast_to(line[:, 1], across.shape)
    points = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=-1)
    corner = np.arange(turns)[:, None] * len(line) + np.arange(len(line) - 1)
    quads = np.stack([corner, corner + len(line), corner + len(line) + 1, corner + 1], axis=-1).reshape(-1, 4)
    along, around = np.gradient(points, axis=1), np.gradient(points, axis=0)
    if ridges is None:
        around = np.broadcast_to(np.stack([-np.sin(turn), np.cos(turn), 0.0 * turn], axis=-1), points.shape)
    normals = np.cross(around, along).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Part(name, points.reshape(-1, 3), triangles, normals)


def with_iris_places(part: Part, pupil: float) -> Part:
    """A part with places in the texture of the iris: around, and from the pupil (mm) to the root."""
    outward, _ = in_meridian(part.points)
    around = np.arctan2(part.points[:, 1], part.points[:, 0]) / (2.0 * np.pi)
    share = np.clip((outward - pupil) / (MM * ANGLE - pupil), 0.0, 1.0)
    return dataclasses.replace(part, places=np.stack([around, share], axis=1))


def ciliary_processes(anatomy: Anatomy, opening: Opening) -> Part:
    """The side of the ciliary body toward the lens: ridges of the outline of the section, with valleys between."""
    line = in_mm(anatomy.segment.processes())
    fine = np.linspace(0.0, len(line) - 1.0, 60)
    line = np.stack([np.interp(fine, np.arange(len(line)), column) for column in line.T], axis=-1)
    valley = np.maximum(np.linspace(line[0, 0], line[-1, 0], len(line)) - line[:, 0], 0.0)
    low = 0.5 - 0.5 * np.cos(2.0 * PROCESSES * np.linspace(0.0, np.pi, TURNS + 1)[:, None])     # none on the cut
    return clipped(revolved("ciliary", line, opening, ridges=low * valley), anatomy.inside)


def walls_of(eye, anatomy: Anatomy, opening: Opening) -> list[Part]:
    """The inner side of the wall, with places in the texture of the fundus, and the iris where it is part of it."""
    mesh = _mesh(MM * np.asarray(eye.points, float), eye.regular_faces)
    mesh = mesh.compute_normals(cell_normals=False, split_vertices=False, auto_orient_normals=True, flip_normals=True)
    wall = part_of("wall", opening.kept(mesh))
    parts = [wall]
    if anatomy.segment is not None:
        parts = [clipped(wall, anatomy.pane)]
        if anatomy.segment.filled:
            iris = clipped(clipped(wall, lambda points: -anatomy.pane(points)), anatomy.on_cornea)
            parts.append(with_iris_places(dataclasses.replace(iris, name="iris"), MM * anatomy.segment.pupil))
    parts[0].places = fundus_places(parts[0].points)
    return parts


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
    middle = start + (0.5 * NERVE_LENGTH + MM * CHOROID_END) * disc
    nerve = pyvista.Cylinder(center=middle, direction=disc, radius=NERVE_RADIUS, height=NERVE_LENGTH,
                             resolution=60).triangulate()
    return part_of("nerve", nerve.compute_normals(cell_normals=False, split_vertices=True))


def zonular_fibers(anatomy: Anatomy, opening: Opening) -> Part:
    """Fibers from the edge of the lens to the ciliary processes."""
    import pyvista

    fibers = [in_mm(fiber) for fiber in anatomy.segment.zonules()]
    places = []
    for number, turn in enumerate(opening.middle + np.linspace(-0.5 * np.pi, 0.5 * np.pi, FIBERS)[1:-1]):
        places += [[outward * np.cos(turn), outward * np.sin(turn), height]
                   for outward, height in fibers[number * 2 % len(fibers)]]
    return _tubes("zonule", pyvista.line_segments_from_points(np.array(places)), FIBER_RADIUS, opening)


def haptics(anatomy: Anatomy, opening: Opening) -> Part:
    """The two arms of an artificial lens, which lean outward from its edge to the bag of the lens."""
    import pyvista

    outward, height = in_mm(anatomy.segment.haptic()).T
    share = np.linspace(0.0, 1.0, len(outward))
    lines = []
    for side in (0.0, np.pi):
        turn = opening.middle - 0.25 * np.pi + side + HAPTIC_TURN * share**0.7
        lines.append(pyvista.lines_from_points(np.stack([outward * np.cos(turn), outward * np.sin(turn), height], 1)))
    return _tubes("haptic", lines[0].merge(lines[1]), HAPTIC_RADIUS, opening)


def _tubes(name: str, lines, radius: float, opening: Opening) -> Part | None:
    tubes = lines.tube(radius=radius, n_sides=8, capping=True).triangulate()
    tubes.clear_data()
    return half_of(name, tubes, opening)


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
    faces = oil.regular_faces
    if _signed_volume(np.asarray(oil.points, float), faces) < 0.0:      # that normals are outward, of pockets inward
        faces = faces[:, ::-1]
    smooth = _mesh(MM * np.asarray(oil.points, float), faces).smooth_taubin(n_iter=PASSES, pass_band=0.08)
    directions = np.asarray(_with_normals(smooth).point_data["Normals"])
    depth = MM * np.asarray(oil.point_data["depth"], float)
    touching = np.clip((NEAR_WALL - depth) / (NEAR_WALL - TOUCHING), 0.0, 1.0)
    if whole:
        smooth.points = np.asarray(smooth.points) - APART * touching[:, None] * directions
        middle = np.asarray(smooth.points).mean(axis=0)
        return Liquids([part_of("glass", _with_normals(smooth))], left_out, {"oil_face": middle})
    push = np.full(len(depth), PUSH)
    if anatomy.shape is not None:
        push = np.where(anatomy.pane(np.asarray(smooth.points, float)) < 0.0, depth, push)
    smooth.points = np.asarray(smooth.points) + (push * touching)[:, None] * directions
    of_oil = _distance_on_plane(smooth, opening, inside < 1.0)
    interface = half_of("interface", smooth, opening)
    found = _faces(opening, {"oil_face": np.maximum(inside, of_oil), "aqueous_face": np.maximum(inside, -of_oil)},
                   [interface], left_out)
    return dataclasses.replace(found, places=found.places | _amid(interface, anatomy))


def _amid(interface: Part | None, anatomy: Anatomy) -> dict[str, np.ndarray]:
    """The place of the interface for its label, of what of it lies away from the wall."""
    points = np.zeros((0, 3)) if interface is None else interface.points
    points = points[anatomy.inside(points) < -NEAR_WALL] if len(points) else points
    if not len(points):
        return {}
    return {"interface": points[np.linalg.norm(points - points.mean(axis=0), axis=1).argmin()]}


def _faces(opening: Opening, levels: dict[str, np.ndarray], parts: list, left_out: int) -> Liquids:
    """Faces on the plane of the cut, by name and level of the plane's points, beside other parts."""
    faces = {name: opening.face(name, level) for name, level in levels.items()}
    return Liquids([part for part in [*parts, *faces.values()] if part is not None], left_out,
                   {name: opening.points[levels[name].argmin()] for name, face in faces.items() if face is not None})


def _distance_on_plane(mesh, opening: Opening, where: np.ndarray) -> np.ndarray:
    """Signed distance (n,), mm, of points of the plane to a closed surface, negative inside; far where not asked.

    It is exact near the surface, elsewhere right to about the distance of the points.
    A surface that was pushed into the wall crosses itself at edges, and there the nearest triangle may be turned round:
    what is inside is found by how often rays cross the surface. A ray that meets an edge may count wrong; a point that
    is farther from the surface than its neighbors are from it lies on their side.
    """
    import pyvista
    from scipy.ndimage import distance_transform_edt, median_filter

    inside, level = np.zeros(len(opening.points), bool), np.full(len(opening.points), 1e3)
    asked = pyvista.PolyData(opening.points[where])
    inside[where] = asked.select_interior_points(mesh, method="cell_locator", check_surface=False)["selected_points"]
    if not inside.any():
        return level
    square = inside.reshape(opening.shape)
    rough = PLANE_CELL * (distance_transform_edt(~square) - distance_transform_edt(square)).ravel()
    level[where] = rough[where]
    near = where & (np.abs(rough) < NEAR_LINE * PLANE_CELL)
    found = pyvista.PolyData(opening.points[near]).compute_implicit_distance(mesh)["implicit_distance"]
    alone = np.abs(found) > 1.5 * PLANE_CELL
    sides = np.where(alone, median_filter(square, 3).ravel()[near], inside[near])
    level[near] = np.where(sides, -1.0, 1.0) * np.minimum(np.abs(found), NEAR_LINE * PLANE_CELL)
    return level


def _signed_volume(points: np.ndarray, triangles: np.ndarray) -> float:
    """Volume of a closed surface, negative where its triangles look inward."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def _with_normals(mesh):
    """A surface with the normals that its triangles have; VTK's own guess fails where there are pockets inside."""
    return mesh.compute_normals(cell_normals=False, split_vertices=False, auto_orient_normals=False,
                                consistent_normals=False)


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

