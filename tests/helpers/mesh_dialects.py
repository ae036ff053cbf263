"""Mesh files in the dialects of programs, as bytes or text."""
import struct

import numpy as np


def text_stl(mesh, number="{:.6e}".format, solid="eye"):
    """Text of an STL."""
    lines = [f"solid {solid}"]
    for corners in mesh.triangles:
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {' '.join(map(number, one))}" for one in corners),
                  "endloop", "endfacet"]
    return "\n".join([*lines, f"endsolid {solid}", ""])


def binary_stl(mesh, head=b"", count=None, tail=b""):
    """Content of a binary STL, with another count of triangles or more behind them."""
    data = np.zeros(len(mesh.faces), np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]))
    data["v"] = mesh.triangles
    return head.ljust(80) + struct.pack("<I", len(mesh.faces) if count is None else count) + data.tobytes() + tail


def obj(mesh, number="{:.6f}".format, order="vertices first"):
    """Text of an OBJ: vertices first, faces first, or counted from the end."""
    vertices = [f"v {' '.join(map(number, one))}" for one in mesh.vertices]
    count = len(mesh.vertices)
    if order == "from the end":
        return "\n".join([*vertices, "g wall", *(f"f {a - count} {b - count} {c - count}" for a, b, c in mesh.faces)])
    faces = [f"f {a + 1}//{a + 1} {b + 1}//{b + 1} \\\n {c + 1}//{c + 1}  # wall" for a, b, c in mesh.faces]
    return "\n".join(["o eye", *faces, *vertices] if order == "faces first" else ["o eye", *vertices, *faces])


def comma(value):
    """A number as programs of some countries write it."""
    return f"{value:.6f}".replace(".", ",")


def ply_of_strips(mesh):
    """Content of a PLY with one strip for every triangle."""
    strips = np.column_stack([mesh.faces, np.full(len(mesh.faces), -1)]).ravel()
    return "\n".join(["ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}", "property float x",
                      "property float y", "property float z", "element tristrips 1",
                      "property list int int vertex_indices", "end_header",
                      *(" ".join(map(str, one)) for one in mesh.vertices),
                      f"{len(strips)} {' '.join(map(str, strips))}", ""]).encode()


def ply(mesh, kind="ascii", comments=""):
    """Content of a PLY; comments stand before its format."""
    return ply_of(mesh.vertices, mesh.faces.tolist(), kind, comments)


def ply_of(points, faces, kind="ascii", comments=""):
    """Content of a PLY of faces with any number of corners, as text or in a kind of bytes."""
    head = "\n".join(["ply", f"{comments}format {kind} 1.0", f"element vertex {len(points)}", "property double x",
                      "property double y", "property double z", f"element face {len(faces)}",
                      "property list uchar int vertex_indices", "end_header", ""]).encode()
    if kind == "ascii":
        return head + "\n".join([*(" ".join(map(repr, one)) for one in points.tolist()),
                                 *(" ".join(map(str, [len(face), *face])) for face in faces), ""]).encode()
    order = ">" if kind == "binary_big_endian" else "<"
    return head + points.astype(f"{order}f8").tobytes() + b"".join(
        struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)


def big_endian_stl(mesh):
    """Content of a binary STL of a computer that writes the high bytes first."""
    data = np.zeros(len(mesh.faces), np.dtype([("n", ">f4", 3), ("v", ">f4", (3, 3)), ("a", ">u2")]))
    data["v"] = mesh.triangles
    return b"".ljust(80) + struct.pack(">I", len(mesh.faces)) + data.tobytes()


def ball_of_polygons(columns=40, rows=20, radius=11.0):
    """Points and faces of a ball, mm: quadrangles, triangles around one pole, and a polygon in place of the other."""
    polar, around = np.meshgrid(np.linspace(0.5, np.pi, rows + 1)[:-1], 2.0 * np.pi * np.arange(columns) / columns,
                                indexing="ij")
    points = radius * np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    points = np.concatenate([points.reshape(-1, 3), [[0.0, 0.0, -radius]]])
    ahead = [(k, (k + 1) % columns) for k in range(columns)]
    faces = [[i * columns + a, (i + 1) * columns + a, (i + 1) * columns + b, i * columns + b]
             for i in range(rows - 1) for a, b in ahead]
    faces += [[(rows - 1) * columns + a, len(points) - 1, (rows - 1) * columns + b] for a, b in ahead]
    return points, [*faces, list(range(columns))]
