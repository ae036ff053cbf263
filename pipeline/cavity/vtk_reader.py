"""Program: read the triangles of a file by VTK, whose readers crash on damaged files, hence in a process of its own.

    python vtk_reader.py eye.vtk > triangles.npz
"""
import io
import resource
import sys
import warnings
from pathlib import Path

import numpy as np
import pyvista

USUAL, PER_BYTE = 8 * 2**30, 100  # address space that is enough, bytes: in all, and per byte of the file


def main(source: Path) -> None:
    """Write the vertices (n, 3) and triangles (m, 3) of the surface of ``source`` to standard output."""
    most = USUAL + PER_BYTE * source.stat().st_size
    resource.setrlimit(resource.RLIMIT_AS, (most, most))  # damaged counts ask for more than there is
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*raised an error while reading")
        try:
            data = pyvista.read(source)
        except UserWarning:
            sys.exit("it is damaged or of another format")
    surface = outer_surface(data)
    found = io.BytesIO()  # what is written needs to be gone back in, which a pipe cannot
    np.savez(found, vertices=np.asarray(surface.points, float), faces=np.asarray(surface.regular_faces, int))
    sys.stdout.buffer.write(found.getbuffer())


def outer_surface(data) -> pyvista.PolyData:
    """Return the triangles around what a reader has found."""
    if isinstance(data, pyvista.PolyData):
        return data.triangulate()
    if isinstance(data, pyvista.UnstructuredGrid) and (data.celltypes >= pyvista.CellType.TETRA).any():
        data = data.extract_cells(data.celltypes >= pyvista.CellType.TETRA)     # the triangles beside are patches
    return data.extract_surface(algorithm=None).triangulate()


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]))
    # The readers raise anything; what called this program makes a sentence of it.
    except Exception as error:
        sys.exit(" ".join(str(error).split()) or type(error).__name__)
