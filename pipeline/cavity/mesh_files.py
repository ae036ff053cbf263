"""What programs write into mesh files: their triangles, in the dialects that there are, and which way up they lie.

STL and OBJ are read here, for readers of libraries refuse decimal commas, capitals, or bytes behind the last triangle.
"""
import contextlib
import dataclasses
import io
import itertools
import logging
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path

import meshio
import numpy as np
import pyvista
import trimesh

from pipeline.base.errors import UserError
from pipeline.cavity import large_stl, vtk_reader
from pipeline.cavity.vtk_reader import bodies_in, outer_surface
from pipeline.scenes.model import IMAGES

FORMATS = (".obj", ".ply", ".stl", ".vtk", ".vtp", ".vtu", ".msh")
HEAD = 4096                     # bytes at the start of a file that tell what it is
TRAILING = 10_000               # bytes behind the last triangle of an STL that programs add, such as colors
GZIP = b"\x1f\x8b"
# Axes of the file that segmentation programs name in its head, as rows: to the patient's left, superior, anterior.
SPACES = {"LPS": ((1, 0, 0), (0, 0, 1), (0, -1, 0)), "RAS": ((-1, 0, 0), (0, 0, 1), (0, 1, 0))}
PACKED = (".gz", ".bz2", ".xz", ".zst", ".zip", ".7z", ".rar")
# How the formats begin, and the endings of their files.
BEGINNINGS = ((rb"ply\s*[\r\n]", ".ply"), (rb"# vtk DataFile", ".vtk"),
              (rb"(<\?xml[^>]*>\s*)?<VTKFile[^>]*PolyData", ".vtp"),
              (rb"(<\?xml[^>]*>\s*)?<VTKFile[^>]*UnstructuredGrid", ".vtu"), (rb"\$MeshFormat", ".msh"),
              (rb"NRRD000\d", ".nrrd"), (rb"solid\b[^\0]*?\bfacet\s+normal", ".stl"))
# What begins with these bytes is no mesh, whatever its name says: what it is, and what helps.
OTHERS = ((b"version https://git-lfs", "is a pointer of Git LFS in place of the file: run git lfs pull"),
          (b"/annex/objects/", "is a pointer of git-annex in place of the file: run git annex get"),
          (b"PK\x03\x04", "is a zip archive: unpack it, and name the mesh in it"),
          (GZIP, "is compressed by gzip: unpack it, and name the mesh in it"),
          (b"7z\xbc\xaf", "is a 7z archive: unpack it, and name the mesh in it"),
          (b"Rar!", "is a rar archive: unpack it, and name the mesh in it"),
          (b"%PDF", "is a PDF: export the surface itself"),
          *((start, "is a picture: export the surface itself") for start in (
              b"\x89PNG", b"\xff\xd8\xff", b"GIF8", b"II*\0", b"MM\0*")),
          *((start, "is a Windows shortcut: copy the file that it points to") for start in (
              b"L\0\0\0\1\x14\2", b"[InternetShortcut]")),
          (b"glTF", "is a glTF file: export the surface as STL, OBJ or PLY"),
          (b"Kaydara FBX", "is an FBX file: export the surface as STL, OBJ or PLY"),
          (b"ISO-10303", "is a STEP file of a CAD program: export the surface as STL"))


@dataclasses.dataclass(frozen=True)
class MeshFile:
    """What a file holds.

    Attributes
    ----------
    vertices, faces : (n, 3) in the unit of the file, and triangles (m, 3).
    notes : sentences on what was unusual in it.
    space : "LPS" or "RAS" where its head names its axes; else "".
    unit : of length where its head names one; else "".
    made : sentences on how the triangles were made of an image.
    """

    vertices: np.ndarray
    faces: np.ndarray
    notes: tuple[str, ...] = ()
    space: str = ""
    unit: str = ""
    made: tuple[str, ...] = ()


def read_mesh_file(path: Path) -> MeshFile:
    """Read the triangles of a file.

    Raises
    ------
    UserError : the file is missing, of another kind than its name says, or cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix in PACKED:
        raise UserError(f'{path} (eye.path): is compressed ("{suffix}"): unpack it, and name the mesh in it')
    if suffix not in FORMATS:
        raise UserError(f'{path} (eye.path): the format "{suffix}" is not known, use one of '
                        f'{", ".join((*FORMATS, *IMAGES))}')
    if not path.is_file():
        raise UserError(f"{path} (eye.path): {'is a folder: name the mesh in it' if path.is_dir() else 'no such file'}")
    with path.open("rb") as file:
        head = file.read(HEAD)
    refuse_others(path, head)
    begins = next((ending for start, ending in BEGINNINGS if re.match(start, head.lstrip(), re.IGNORECASE)), suffix)
    if begins != suffix:
        raise UserError(f"{path} (eye.path): is a file of another format than its name says: give it the ending "
                        f"{begins}")
    named = re.search(rb"\bSPACE\s*[=:]\s*(LPS|RAS)\b", head, re.IGNORECASE)
    try:
        found = {".stl": _read_stl, ".obj": _read_obj, ".ply": _read_ply, ".msh": _read_gmsh}.get(
            suffix, _read_by_vtk)(path)
    except (OSError, MemoryError, UserError):
        raise
    # The readers raise anything from ValueError to their own kinds; all mean that the content is not of this format.
    except Exception as error:
        raise cannot_be_read(path, suffix[1:].upper(), error) from error
    if not len(found.faces):
        raise UserError(f"{path} (eye.path): holds {len(found.vertices)} points and no triangles, but a closed surface "
                        "is needed; " + ("make one of the points in the program that wrote them" if len(found.vertices)
                                         else "export or copy it again"))
    return dataclasses.replace(found, space=named[1].decode().upper()) if named else found


def cannot_be_read(path: Path, kind: str, error: Exception) -> UserError:
    """Return what is said of a file that its reader refuses."""
    reason = str(error).strip().splitlines()
    return UserError(f"{path} (eye.path): cannot be read as {kind} ({reason[0] if reason else type(error).__name__})")


def refuse_others(path: Path, head: bytes, packed: bool = False) -> None:
    """Raise where the content is of another kind than a mesh or an image; those `packed` are compressed by gzip."""
    if not head.strip():
        raise UserError(f"{path} (eye.path): is {'cut short: it has blanks only' if head else 'empty'}, export or copy "
                        "it again")
    found = next((words for start, words in OTHERS if head.startswith(start) and not (packed and start == GZIP)), None)
    if found is None and head[128:132] == b"DICM":
        found = "is a DICOM image: segment the vitreous cavity, and export its surface"
    start = head.lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if found is None and (start.startswith(b"<!doctype html") or start.startswith(b"<html")):
        found = "is a page of the web (HTML), as is saved where a download asks for a login: download it again"
    if found is not None:
        raise UserError(f"{path} (eye.path): {found}")


def _text(data: bytes) -> str:
    """The text of a file, with or without a byte order mark; letters that cannot be read are in names only."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    return data.decode("utf-8-sig", errors="replace")


def _numbers(words: list[str]) -> np.ndarray:
    """Numbers with decimal points or, as programs write them in some countries, commas; Fortran has 1.5D+01."""
    text = " ".join(words)
    for written, meant in ((",", "."), ("D", "E")):
        text = text.replace(written, meant)
    return np.array(text.split(), float)


def _read_stl(path: Path) -> MeshFile:
    """Triangles of an STL; its corners are joined where they have the same coordinates."""
    if large_stl.many_triangles(path):
        return MeshFile(*large_stl.read_reduced(path))
    data = path.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        data = _text(data).encode()
    if _is_text(data[:HEAD]):
        if b"endsolid" not in data[-1024:].lower():
            raise UserError(f"{path} (eye.path): is cut short (a text STL ends with the word endsolid), export or copy "
                            "it again")
        return MeshFile(*_joined(_facets(_text(data))))
    if re.fullmatch(rb"[\t\r\n -~]*", data[:HEAD]):
        raise UserError(f"{path} (eye.path): is a text file, but no STL: export the surface as STL, or give the "
                        "file the ending of its format")
    size, kind = len(data), large_stl.TRIANGLE
    if size < large_stl.HEAD:
        raise UserError(f"{path} (eye.path): is cut short (a binary STL has a head of 84 bytes), export or copy it "
                        "again")
    announced = int.from_bytes(data[80:large_stl.HEAD], "little")
    there, rest = divmod(size - large_stl.HEAD, kind.itemsize)
    notes: tuple[str, ...] = ()
    if announced > there and not rest and int.from_bytes(data[80:large_stl.HEAD], "big") == there:
        announced, kind = there, kind.newbyteorder(">")
        notes = ("its numbers have their bytes in the order of other computers (big-endian), and were read so",)
    if not announced and there and not rest:
        announced, notes = there, (f"its head gives no number of triangles; all {there} were read",)
    if announced > there:
        raise UserError(f"{path} (eye.path): is cut short (it announces {announced} triangles and holds {there}), "
                        "export or copy it again")
    beyond = size - large_stl.HEAD - kind.itemsize * announced
    if beyond > TRAILING:
        raise ValueError("it is damaged or of another format")
    if beyond:
        notes = (f"{beyond} bytes behind the last triangle were left out",)
    corners = np.frombuffer(data, kind, announced, large_stl.HEAD)["corners"]
    return MeshFile(*_joined(corners.astype(float)), notes)


def _facets(text: str) -> np.ndarray:
    """Triangles (m, 3, 3) of a text STL, whose facets may have more corners than the three that the format has."""
    found = re.findall(r"vertex\s+(\S+)\s+(\S+)\s+(\S+)|(endloop)", text, re.IGNORECASE)
    corners = _numbers([word for *corner, end in found if not end for word in corner]).reshape(-1, 3)
    ends = np.flatnonzero([bool(end) for *_, end in found])
    sizes = np.diff(ends, prepend=-1) - 1
    if sizes.sum() != len(corners) or sizes.min(initial=3) < 3:
        raise ValueError("a facet does not have the three corners and the word endloop: it may be cut short")
    if (sizes == 3).all():
        return corners.reshape(-1, 3, 3)
    begins = np.cumsum(sizes) - sizes
    return np.array([corners[[begin, begin + one, begin + one + 1]] for begin, size in zip(begins, sizes, strict=True)
                     for one in range(1, size - 1)])


def _is_text(head: bytes) -> bool:
    """Tell whether an STL is text: binary ones may begin with the word solid too, but hold zeros."""
    return b"facet" in head.lower() and b"\0" not in head


def _joined(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) in the order in which they appear, and triangles (m, 3), of corners (m, 3, 3)."""
    points = corners.reshape(-1, 3) + 0.0  # minus zero is zero
    keys = np.ascontiguousarray(points).view(np.dtype((np.void, 24))).ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order))
    return points[first[order]], rank[inverse.ravel()].reshape(-1, 3)


def _read_obj(path: Path) -> MeshFile:
    """Triangles of an OBJ; faces may stand before the vertices, have more corners, and count from the end."""
    vertices: list[str] = []
    faces: list[list[int]] = []
    for number, (key, *words) in _obj_lines(_text(path.read_bytes())):
        if key in ("v", "V"):
            if len(words) < 3:
                raise ValueError(f"line {number} has a vertex of {len(words)} coordinates: it may be cut short")
            vertices += words[:3]
        elif key in ("f", "F"):
            corners = [int(word.split("/")[0]) for word in words]
            if len(corners) < 3 or 0 in corners:
                raise ValueError(f"line {number} is no face of three corners or more, counted from 1: it may be cut "
                                 "short")
            corners = [one - 1 if one > 0 else len(vertices) // 3 + one for one in corners]
            faces += [[corners[0], second, third] for second, third in itertools.pairwise(corners[1:])]
    return MeshFile(_numbers(vertices).reshape(-1, 3), np.array(faces, int).reshape(-1, 3))


def _obj_lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Number and words of the lines of an OBJ without comments; a vertex or a face may go on in the next line."""
    begun: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        line = line.split("#", 1)[0].rstrip()
        words = [*begun, *line.removesuffix("\\").split()]
        begun = words if line.endswith("\\") and words and words[0] in ("v", "V", "f", "F") else []
        if words and not begun:
            yield number, words
    if begun:
        raise ValueError("its last line is to go on in the next one, which is not there: it is cut short")


def _read_ply(path: Path) -> MeshFile:
    """Triangles of a PLY, also where it holds strips of them."""
    data = path.read_bytes()
    text = re.search(rb"^format\s+ascii", data[:HEAD], re.MULTILINE)
    if text:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    head, end, body = data.partition(b"end_header")
    # The reader looks for the format in the second line, where others have a comment.
    head = re.sub(rb"\A(\s*ply)((?:\s*^(?:comment|obj_info)[^\n]*)+)(\s*^format[^\n]*)", rb"\1\3\2", head,
                  flags=re.MULTILINE)
    if text:
        announced = sum(map(int, re.findall(rb"^element\s+\S+\s+(\d+)", head, re.MULTILINE)))
        if (there := len(re.findall(rb"^.*\S", body, re.MULTILINE))) < announced:
            raise UserError(f"{path} (eye.path): is cut short (its head announces {announced} lines and {there} are "
                            "there), export or copy it again")
        body = body.replace(b",", b".") if b"," in body else body
    try:
        mesh = trimesh.load(io.BytesIO(head + end + body), file_type="ply", process=False)
    except ValueError as error:  # faces of different numbers of corners, or bytes behind the last one
        if text or "length" not in str(error):
            raise
        return _read_by_vtk(path)
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(getattr(mesh, "faces", ()), int).reshape(-1, 3)
    raw = mesh.metadata.get("_ply_raw", {})
    if "tristrips" in raw:
        faces = np.concatenate([faces, _of_strips(raw["tristrips"]["data"])])
    return MeshFile(vertices, faces)


def _of_strips(data) -> np.ndarray:
    """Triangles (m, 3) of the strips of a PLY, in which -1 begins a new strip; every second triangle is turned."""
    rows = next(iter(data.values())) if isinstance(data, dict) else data[data.dtype.names[0]]
    rows = rows["f1"] if getattr(getattr(rows, "dtype", None), "names", None) else rows
    faces = []
    for row in rows:
        row = np.asarray(row, int).ravel()
        for strip in np.split(row, np.flatnonzero(row < 0)):
            strip = strip[strip >= 0]
            some = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1) if len(strip) > 2 else np.empty((0, 3), int)
            some[1::2] = some[1::2, [1, 0, 2]]
            faces.append(some)
    return np.concatenate(faces) if faces else np.empty((0, 3), int)


def _read_gmsh(path: Path) -> MeshFile:
    with _silent_reader():
        data = pyvista.from_meshio(meshio.gmsh.read(path))
        surface = outer_surface(data)
    return MeshFile(np.asarray(surface.points, float), np.asarray(surface.regular_faces, int), bodies_in(data))


def _read_by_vtk(path: Path) -> MeshFile:
    """What VTK reads, in a process of its own, for damaged files crash its readers."""
    done = subprocess.run([sys.executable, "-P", vtk_reader.__file__, path], capture_output=True)
    # -P: no file beside the reader takes the place of a library
    if done.returncode:
        reason = done.stderr.decode(errors="replace").strip().splitlines()
        raise ValueError(reason[-1] if reason and done.returncode > 0 else
                         "it is cut short, damaged or of another format")
    with np.load(io.BytesIO(done.stdout)) as found:
        return MeshFile(found["vertices"], found["faces"], tuple(found["notes"].tolist()), str(found["space"]))


@contextlib.contextmanager
def _silent_reader() -> Iterator[None]:
    """Keep complaints about a broken file off the screen: the user gets one sentence instead."""
    disabled = logging.root.manager.disable
    with pyvista.vtk_verbosity("off"), warnings.catch_warnings(action="ignore"):
        logging.disable(logging.CRITICAL)
        try:
            yield
        finally:
            logging.disable(disabled)
