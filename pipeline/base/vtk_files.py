"""VTK's XML files, written by Python: VTK's own file writing crashes on a full disk.

One convention for words: a text in the field data is an array of its UTF-8 bytes, lists have one line per entry. VTK
has arrays of strings, but meshio refuses files with them.
"""
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.base.checksum import append_checksum, check


def write_vtk(data, path: str | Path, *, compress: bool = True) -> None:
    """Write poly data (.vtp), an unstructured grid (.vtu) or an image (.vti), raw appended, with a checksum at the end.

    Parameters
    ----------
    data : object of pyvista; its class chooses the format.
    compress : with LZ4, which meshio cannot read.

    Raises
    ------
    OSError : disk full, or the folder is not writable.
    """
    import pyvista
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter, vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    writers = {pyvista.PolyData: vtkXMLPolyDataWriter, pyvista.UnstructuredGrid: vtkXMLUnstructuredGridWriter,
               pyvista.ImageData: vtkXMLImageDataWriter}
    writer = next(writer for kind, writer in writers.items() if isinstance(data, kind))()
    writer.SetInputData(data)
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    if compress:
        writer.SetCompressorTypeToLZ4()
    else:
        writer.SetCompressorTypeToNone()
    writer.WriteToOutputStringOn()
    if not writer.Write():
        raise OSError(f"{path}: VTK could not encode the file")
    content: Any = writer.GetOutputString()  # bytes, whatever its annotation says
    Path(path).write_bytes(content)
    append_checksum(path)


def read_vtk(path: str | Path):
    """Read what :func:`write_vtk` has written, as an object of pyvista.

    Raises
    ------
    DamagedFile : the checksum of the file does not fit.
    """
    check(path)
    import pyvista

    return pyvista.read(path)


def set_text(data, name: str, text: str | Iterable[str]) -> None:
    """Put a text, or a list with one line per entry, into the field data of an object of pyvista or VTK."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    lines = text if isinstance(text, str) else "\n".join(text)
    array = numpy_to_vtk(np.frombuffer(lines.encode(), np.uint8), deep=True)
    array.SetName(name)
    data.GetFieldData().AddArray(array)


def text_of(data, name: str) -> str:
    """Return a text of the field data of an object of pyvista or VTK."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return vtk_to_numpy(data.GetFieldData().GetArray(name)).tobytes().decode()


def name_components(array, names: Iterable[str]) -> None:
    """Name the components of an array of VTK."""
    for component, name in enumerate(names):
        array.SetComponentName(component, name)
