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
