"""Program: read the triangles of a file by VTK, whose readers crash on damaged files, hence in a process of its own.

    python vtk_reader.py eye.vtk > triangles.npz
"""
import io
import re
import resource
import sys
import warnings
from pathlib import Path

import numpy as np
import pyvista

# Names of numbers of cells that tell bodies apart, as programs for meshes call them.
OF_BODIES = r"material|region|label|physical|geometrical|domain|body|entity|tag|medit:ref|gmsh:ref"
MOST_BODIES = 20
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
    if isinstance(data, pyvista.ImageData | pyvista.RectilinearGrid):
        sys.exit(f"it is an image of {' x '.join(map(str, data.dimensions))} points and no surface: save its labels as "
                 "NIfTI or NRRD, or export the surface of the cavity")
    surface = outer_surface(data)
    space = str(np.ravel(data.field_data["SPACE"])[0]).upper() if "SPACE" in data.field_data else ""
    found = io.BytesIO()  # what is written needs to be gone back in, which a pipe cannot
    np.savez(found, vertices=np.asarray(surface.points, float), faces=np.asarray(surface.regular_faces, int),
             notes=np.array(bodies_in(data), str), space=space if space in ("LPS", "RAS") else "")
    sys.stdout.buffer.write(found.getbuffer())


def outer_surface(data) -> pyvista.PolyData:
    """Return the triangles around what a reader has found."""
    if isinstance(data, pyvista.PolyData):
        return data.triangulate()
    if isinstance(data, pyvista.UnstructuredGrid) and (data.celltypes >= pyvista.CellType.TETRA).any():
        data = data.extract_cells(data.celltypes >= pyvista.CellType.TETRA)     # the triangles beside are patches
    return data.extract_surface(algorithm=None).triangulate()


def bodies_in(data) -> tuple[str, ...]:
    """Return the sentence, if any, that a volume mesh consists of several bodies, whose common outside is read."""
    if not isinstance(data, pyvista.UnstructuredGrid):
        return ()
    solid = data.extract_cells(data.celltypes >= pyvista.CellType.TETRA)
    for name in solid.cell_data:
        values = np.asarray(solid.cell_data[name])
        bodies = np.unique(values) if values.ndim == 1 and values.dtype.kind in "iu" else ()
        if 1 < len(bodies) <= MOST_BODIES and re.search(OF_BODIES, name, re.IGNORECASE):
            volume = np.abs(solid.compute_cell_sizes(length=False, area=False)["Volume"])
            shares = ", ".join(f"{body} with {100 * volume[values == body].sum() / volume.sum():.0f} %"
                               for body in bodies)
            return (f'its cells belong to {len(bodies)} bodies by "{name}" ({shares} of the volume), and the surface '
                    "around all of them was taken: export the cavity alone if it is one of them",)
    return ()


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]))
    # The readers raise anything; what called this program makes a sentence of it.
    except Exception as error:
        sys.exit(" ".join(str(error).split()) or type(error).__name__)
