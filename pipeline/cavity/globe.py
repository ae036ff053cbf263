"""The globe of a surface, and the side on which it is flatter: the lens is there.

Both are weighed by area, so that they do not depend on where the vertices are dense, nor on where the surface lies.
Equations: docs/methods/walls.md.
"""
import numpy as np
import trimesh

ROUND_WITHIN, GLOBE_WITHIN = 0.06, 0.03     # shares of the radius: what is nearer to a ball, an ellipsoid, is fitted
MOST_ROUNDS = 30


def vertex_areas(mesh: trimesh.Trimesh) -> np.ndarray:
    """Area (n,) that belongs to every vertex: a third of its triangles'."""
    return np.bincount(mesh.faces.ravel(), np.repeat(mesh.area_faces / 3.0, 3), len(mesh.vertices))


def globe_center(mesh: trimesh.Trimesh) -> np.ndarray:
    """Center (3,) in m of the ellipsoid that fits the wall best, without what is off it: lens, spikes, bulges."""
    points, areas = np.asarray(mesh.vertices, float), vertex_areas(mesh)
    origin = areas @ points / areas.sum()
    points = points - origin
    size = np.sqrt(areas @ (points**2).sum(axis=1) / areas.sum())
    points, kept = points / size, np.ones(len(points), bool)
    center = np.zeros(3)
    for fit, within in ((_ball, ROUND_WITHIN), (_ellipsoid, GLOBE_WITHIN)):
        for _ in range(MOST_ROUNDS):
            center, level = fit(points, np.where(kept, areas, 0.0))
            near = np.abs(level - 1.0) < within
            if (near == kept).all() or areas[near].sum() < 0.3 * areas.sum():
                break
            kept = near
    return origin + size * center


def _ball(points: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Center (3,) of the ball that fits points (n, 3) best, and how far out every point is, 1 on it (n,)."""
    square = points**2 @ np.ones(3)
    root = np.sqrt(weights)
    solution, *_ = np.linalg.lstsq(root[:, None] * np.column_stack([2.0 * points, np.ones(len(points))]),
                                   root * square)
    center = solution[:3]
    return center, np.linalg.norm(points - center, axis=1) / np.sqrt(max(solution[3] + center @ center, 1e-12))


def _ellipsoid(points: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same of the ellipsoid, x Q x with a Q whose trace is 3; the ball's where there is none."""
    x, y, z = points.T
    root = np.sqrt(weights)
    columns = np.column_stack([x * x - z * z, y * y - z * z, x * y, x * z, y * z, 2.0 * points, np.ones(len(points))])
    a, b, c, d, e, *linear, constant = np.linalg.lstsq(root[:, None] * columns, root * (points**2 @ np.ones(3)))[0]
    form = np.eye(3) - np.array([[a, c / 2, d / 2], [c / 2, b, e / 2], [d / 2, e / 2, -a - b]])
    if np.linalg.eigvalsh(form)[0] < 0.2:
        return _ball(points, weights)
    center = np.linalg.solve(form, linear)
    arm = points - center
    return center, np.sqrt(np.einsum("ni,ij,nj->n", arm, form, arm) / max(constant + center @ form @ center, 1e-12))


def front_of(mesh: trimesh.Trimesh, center: np.ndarray) -> tuple[np.ndarray, float]:
    """Direction (3,) in which a surface is flatter than its globe, and how one-sided it is: 1 if nowhere else."""
    arm = mesh.triangles_center - center
    distance = np.linalg.norm(arm, axis=1)
    globe = np.sqrt((mesh.area_faces * distance**2).sum() / mesh.area_faces.sum())
    weight = mesh.area_faces * np.maximum(globe - distance, 0.0) ** 2  # (L9)
    mean = (weight[:, None] * arm / np.maximum(distance, 1e-30)[:, None]).sum(axis=0) / max(weight.sum(), 1e-300)
    length = float(np.linalg.norm(mean))
    return mean / max(length, 1e-30), length
