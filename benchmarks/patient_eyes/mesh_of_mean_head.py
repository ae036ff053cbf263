"""Make config/meshes/mean_head_right_eye.ply: the dark vitreous of the right eye in a mean head of magnetic resonance.

    pip download --no-deps pydeface==2.1.0 && unzip pydeface-2.1.0-py3-none-any.whl pydeface/data/mean_reg2mean.nii.gz
    python benchmarks/patient_eyes/mesh_of_mean_head.py pydeface/data/mean_reg2mean.nii.gz eye.ply

The image (T1-weighted, voxels of 1 mm) is the mean of registered heads that pydeface (MIT license) takes as its
template. The mesh is the surface of equal intensity, at a level at which the vitreous is a body of its own; a mean is
blurred, so that the body is smaller than an eye. Nothing was drawn by hand.
"""
import argparse
import gzip
import struct
from pathlib import Path

import numpy as np
import trimesh
from scipy import ndimage
from skimage.measure import marching_cubes

SMOOTHED = 0.7                  # voxels: the noise of single voxels
LEVEL, INSIDE = 100.0, (120, 200, 96)   # of the intensity; a voxel in the vitreous of the right eye
AROUND = 2                      # voxels that are kept around the body


def main() -> None:
    """Run; see the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("image", type=Path)
    parser.add_argument("output", type=Path)
    options = parser.parse_args()
    intensity, affine = read_nifti(options.image)
    intensity = ndimage.gaussian_filter(intensity, SMOOTHED)
    bodies, _ = ndimage.label(intensity < LEVEL)
    body = ndimage.binary_dilation(bodies == bodies[INSIDE], iterations=AROUND)
    box = tuple(slice(side.start - AROUND, side.stop + AROUND) for side in ndimage.find_objects(body.astype(int))[0])
    vertices, faces, _, _ = marching_cubes(np.where(body, intensity, 3.0 * LEVEL)[box], LEVEL)
    vertices = trimesh.transformations.transform_points(vertices + [side.start for side in box], affine)
    mesh = trimesh.Trimesh(vertices, faces)
    if mesh.volume < 0.0:
        mesh.invert()
    mesh.export(options.output)
    sides = " x ".join(f"{side:.1f}" for side in mesh.extents)
    print(f"{len(faces)} triangles, {1e-3 * mesh.volume:.2f} mL, {sides} mm")


def read_nifti(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Voxels of 16 bits, and the matrix (4, 4) from voxels to mm: x right, y anterior, z superior."""
    data = gzip.decompress(path.read_bytes())
    shape, offset = struct.unpack("<3h", data[42:48]), int(struct.unpack("<f", data[108:112])[0])
    rows = [struct.unpack("<4f", data[start:start + 16]) for start in (280, 296, 312)]
    voxels = np.frombuffer(data, "<i2", int(np.prod(shape)), offset).reshape(shape, order="F")
    return voxels.astype(float), np.array([*rows, (0.0, 0.0, 0.0, 1.0)])


if __name__ == "__main__":
    main()
