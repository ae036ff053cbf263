"""VTK's XML files, written by Python: VTK's own file writing crashes on a full disk."""
from pathlib import Path
from typing import Any

import pyvista


def write_vtk(data, path: str | Path, *, compress: bool = True) -> None:
    """Write poly data (.vtp), an unstructured grid (.vtu) or an image (.vti), raw appended.

    Parameters
    ----------
    data : object of pyvista; its class chooses the format.
    compress : with LZ4, which meshio cannot read.

    Raises
    ------
    OSError : disk full, or the folder is not writable.
    """
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
