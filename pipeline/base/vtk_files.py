"""VTK's XML files, written by Python: VTK's own file writing crashes on a full disk.

One convention for words: a text in the field data is an array of its UTF-8 bytes, lists have one line per entry. VTK
has arrays of strings, but meshio refuses files with them.
"""
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from pipeline.base.checksum import append_checksum, check

APPENDED = b'<AppendedData encoding="raw">'
LONGEST_HEAD = 2**20  # bytes; that of a frame has 8,000
TYPES = {"Int8": "<i1", "UInt8": "<u1", "Int16": "<i2", "UInt16": "<u2", "Int32": "<i4", "UInt32": "<u4",
         "Int64": "<i8", "UInt64": "<u8", "Float32": "<f4", "Float64": "<f8"}  # in VTK and in NumPy


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


def read_raw(path: str | Path) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """Read a grid or poly data that :func:`write_vtk` has written without compression; no reader of VTK sees the file.

    VTK believes the sizes in its head and crashes on forged ones. Here every size is compared with the length of the
    file before anything is allocated.

    Returns
    -------
    Arrays of the points, name -> (n,) or (n, k); of the field data, name -> (m,) or (m, k); coordinates (n, 3).

    Raises
    ------
    DamagedFile : the checksum of the file does not fit.
    ValueError : the file is of another kind, or its head does not fit its content.
    """
    check(path)
    content = Path(path).read_bytes()
    end = content.find(APPENDED, 0, LONGEST_HEAD)
    if end < 0 or b"<!" in content[:end]:  # no entities, which may grow without end
        raise ValueError("it has no head of VTK")
    head = ElementTree.fromstring(content[:end] + b"</VTKFile>")
    if head.get("byte_order") != "LittleEndian" or head.get("compressor"):
        raise ValueError("it is not stored raw in little-endian order")
    begin = content.index(b"_", end) + 1
    size = np.dtype(TYPES[head.get("header_type", "UInt32")])
    piece = head.find("./*/Piece")
    if piece is None:
        raise ValueError("it has no piece")
    count = int(piece.get("NumberOfPoints", ""))

    def values(entry: ElementTree.Element, tuples: int) -> np.ndarray:
        kind, components = np.dtype(TYPES[entry.get("type", "")]), int(entry.get("NumberOfComponents", "1"))
        start, name = begin + int(entry.get("offset", "")), entry.get("Name")
        length = tuples * components * kind.itemsize
        if min(tuples, components - 1, start - begin) < 0 or start + size.itemsize + length > len(content):
            raise ValueError(f"{name} is larger than the file")
        if np.frombuffer(content, size, 1, start)[0] != length:
            raise ValueError(f"{name} has another size than its head says")
        flat = np.frombuffer(content, kind, tuples * components, start + size.itemsize).copy()
        return flat if components == 1 else flat.reshape(tuples, components)

    fields = {str(entry.get("Name")): values(entry, int(entry.get("NumberOfTuples", "")))
              for entry in head.findall("./*/FieldData/DataArray")}
    points = {str(entry.get("Name")): values(entry, count) for entry in piece.findall("./PointData/DataArray")}
    coordinates = piece.find("./Points/DataArray")
    if coordinates is None:
        raise ValueError("it has no points")
    return points, fields, values(coordinates, count).reshape(count, 3)


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
