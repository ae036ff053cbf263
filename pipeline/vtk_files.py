"""VTK's XML files, written by Python: VTK's own file writing crashes on a full disk."""
from pathlib import Path

import pyvista


def write_vtk(data, path: str | Path) -> None:
    """Write a ``vtkPolyData`` (.vtp) or ``vtkImageData`` (.vti), raw appended and LZ4 compressed.

    Raises
    ------
    OSError : disk full, or the folder is not writable.
    """
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter, vtkXMLPolyDataWriter

    writer = vtkXMLPolyDataWriter() if isinstance(data, pyvista.PolyData) else vtkXMLImageDataWriter()
    writer.SetInputData(data)
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToLZ4()
    writer.WriteToOutputStringOn()
    if not writer.Write():
        raise OSError(f"{path}: VTK could not encode the file")
    Path(path).write_bytes(writer.GetOutputString())
