"""Whether a mesh is closed, said by two."""
import pytest
import trimesh


def assert_closed(mesh):
    """Compare with trimesh, which knows nothing of our own check."""
    solid = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False)
    assert solid.is_watertight and solid.is_winding_consistent
    assert mesh.is_closed()
    assert solid.volume == pytest.approx(mesh.volume, rel=1e-9) and mesh.volume > 0
