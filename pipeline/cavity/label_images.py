"""A labelled image, NIfTI or NRRD, as segmentation programs write it, and the smooth surface of one label in it.

Equations: docs/methods/walls.md.
"""
import dataclasses
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from pipeline.base.errors import UserError
from pipeline.cavity.eye_files import detached
from pipeline.cavity.mesh_files import GZIP, MeshFile, cannot_be_read, refuse_others
from pipeline.cavity.voxel_steps import smoothed
from pipeline.scenes.eye_shape import LARGEST_VOLUME, SMALLEST_VOLUME
from pipeline.scenes.model import MESH_UNITS

MOST_VOXELS = 500_000_000       # 800 along every side, 4 GB as numbers of 8 bytes
AT_ONCE = 10_000_000            # voxels that are counted
MOST_LABELS = 1000              # more different values are those of a gray image; atlases of the brain have 200
TOLD = 12                       # labels that a sentence lists
FEWEST_ACROSS = 8               # voxels across the cavity
SPECKS, HOLLOWS = 0.05, 0.05    # shares of the volume of a label: loose pieces are dropped, hollows filled up to these
BALL = math.pi / 6.0            # share of its box that a ball fills
APART = (40e-3, 85e-3)          # m, between the centers of both eyes of a head, from left to right
ASKEW = 20e-3                   # m, between them otherwise, where the head is turned
ALIKE = 1.5                     # ratio of the volumes of both eyes, at most
HEAD = 120e-3                   # m, from left to right: such an image shows a whole head
BESIDE = (18e-3, 50e-3)         # m, of an eye from the middle of such an image
NIFTI_UNITS = {"mm": "mm", "meter": "m", "micron": "um"}
NRRD_UNITS = {"mm": "mm", "millimeter": "mm", "millimeters": "mm", "cm": "cm", "m": "m", "meter": "m", "meters": "m",
              "um": "um", "µm": "um", "micron": "um", "microns": "um", "in": "in"}
NRRD_SPACES = {"right-anterior-superior": "RAS", "left-posterior-superior": "LPS", "left-anterior-superior": "LAS"}
TO_RIGHT = {"RAS": 1.0, "LPS": -1.0}    # where the patient's right is on the first axis
ENDS = {"RAS": (("left", "right"), ("posterior", "anterior"), ("inferior", "superior")),
        "LPS": (("right", "left"), ("anterior", "posterior"), ("inferior", "superior"))}
SIDED = {"right": r"\b(right|od)\b", "left": r"\b(left|os)\b"}   # in the name of a label


@dataclasses.dataclass(frozen=True)
class LabelImage:
    """What a file holds.

    Attributes
    ----------
    labels : (i, j, k) of whole numbers.
    affine : (4, 4), from the indices of a voxel to its middle, in ``unit`` and the axes of ``space``.
    space : "RAS" or "LPS"; "" where the head of the file names no axes.
    unit : one of ``MESH_UNITS``; "" where the head names none.
    names : of labels, where the file has any.
    notes : sentences on what was unusual in it.
    """

    labels: np.ndarray
    affine: np.ndarray
    space: str
    unit: str
    names: Mapping[int, str]
    notes: tuple[str, ...] = ()

    @property
    def voxel(self) -> float:
        """Volume of a voxel, in the cube of ``unit``."""
        return abs(float(np.linalg.det(self.affine[:3, :3])))

    @property
    def sizes(self) -> np.ndarray:
        """Sides of a voxel (3,), in ``unit``."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    def places(self, index: np.ndarray) -> np.ndarray:
        """Places (n, 3) of indices (n, 3), in ``unit``."""
        return index @ self.affine[:3, :3].T + self.affine[:3, 3]


def read_label(path: Path, label: int | None, unit: str, force: bool, side: str) -> MeshFile:
    """Read one label of an image as a closed surface without the steps of its voxels.

    Parameters
    ----------
    label : its number; ``None`` where none was chosen.
    unit : of the image where its head names none, and where it is not mm, which is what is assumed.
    force : accept a cavity that the border of the image may cut off, and another side.
    side : which eye it should be.

    Raises
    ------
    UserError : the file is missing, cannot be read or is no image of labels; there is no such label, or it is no
        cavity.
    """
    image = read_image(path)
    if unit != "mm" or not image.unit:
        note = () if image.unit else (f"its head names no unit of length: it was taken to be in {unit} (eye.unit)",)
        image = dataclasses.replace(image, unit=unit, notes=(*image.notes, *note))
    found = _volumes(image)
    if len(found) > MOST_LABELS:
        raise UserError(f"{path} (eye.path): holds {len(found)} different values, like a gray image, but an image of "
                        "labels is needed: segment the vitreous cavity, and export its labels")
    if label is None or label not in found:
        raise UserError(f"{path} (eye.label): " + _choice(image, label, found))
    mask, low = _cut_out(image.labels == label)
    _refuse_border(path, image, mask, low, force)
    mask, said = _one_body(path, image, label, mask, low)
    across = np.array([np.ptp(np.flatnonzero(mask.any(axis=tuple({0, 1, 2} - {k})))) + 1 for k in range(3)])
    mm = 1e3 * MESH_UNITS[image.unit] * image.sizes
    sizes = " x ".join(f"{one:.3g}" for one in mm)
    if across.min() < FEWEST_ACROSS:
        raise UserError(f"{path} (eye.label: {label}): the label is only {across.min()} voxels wide along one of its "
                        f"axes, of {sizes} mm each, but {FEWEST_ACROSS} are needed to tell a shape: segment an image "
                        "with finer slices")
    mesh = _surface(image, mask, low)
    shape = " x ".join(map(str, image.labels.shape))
    name = f" ({image.names[label]})" if label in image.names else ""
    told = [f"read label {label}{name} of an image of {shape} voxels of {sizes} mm: "
            f"{1e6 * MESH_UNITS[image.unit] ** 3 * mesh.volume:.2f} mL; its steps were smoothed at the same volume",
            *said]
    notes = (*image.notes, *_sides(path, image, label, found, mask, low, side, force))
    return MeshFile(np.asarray(mesh.vertices, float), np.asarray(mesh.faces), notes, image.space, image.unit,
                    tuple(told))


def read_image(path: Path) -> LabelImage:
    """Read a labelled image.

    Raises
    ------
    UserError : the file is missing, of another kind than its name says, or cannot be read; it is no image of labels in
        three dimensions.
    """
    if not path.is_file():
        raise UserError(f"{path} (eye.path): no such file")
    packed = path.name.lower().endswith(".gz")
    with path.open("rb") as file:
        head = file.read(4096)
    nifti = path.name.lower().endswith((".nii", ".nii.gz"))
    if nifti and head and packed != head.startswith(GZIP):
        raise UserError(f"{path} (eye.path): is {'not ' * packed}compressed by gzip: give it the ending "
                        f"{'.nii' if packed else '.nii.gz'}")
    refuse_others(path, head, packed)
    try:
        return _read_nifti(path) if nifti else _read_nrrd(path)
    except (MemoryError, UserError):
        raise
    # The readers raise anything from OSError to their own kinds; all mean that the content is not of this format.
    except Exception as error:
        raise cannot_be_read(path, "NIfTI" if nifti else "NRRD", error) from error


def _read_nifti(path: Path) -> LabelImage:
    import nibabel

    with nibabel.imageglobals.LoggingOutputSuppressor():  # what it mends is looked at below
        image: Any = nibabel.load(path)  # of the class that the content has
    head = image.header
    if image.get_data_dtype().fields:
        raise UserError(f"{path} (eye.path): is a color image, but an image of labels is needed")
    shape = _refuse_shape(path, image.shape)
    codes = int(head["sform_code"]), int(head["qform_code"])
    code, notes = codes[0] or codes[1], []
    sizes, placed = _raw_sizes(path, type(head)), np.linalg.norm(image.affine[:3, :3], axis=0)
    if not codes[0] and not (np.isfinite(sizes) & (sizes != 0.0)).all():
        raise UserError(f"{path} (eye.path): its head gives voxels without a size or a place, export it again")
    if not code:
        notes.append("its head does not tell how it lies (sform_code and qform_code are 0), so that left and right may "
                     "be exchanged")
    elif code in (3, 4):
        notes.append(f"it was laid on a template ({'Talairach' if code == 3 else 'MNI'}), so that its size may not be "
                     "the patient's")
    if all(codes) and not np.allclose(image.get_sform(), image.get_qform(), atol=0.1):
        notes.append("sform and qform in its head differ; sform was taken")
    elif not np.allclose(np.abs(sizes), placed, rtol=0.01):
        notes.append(f"its head gives voxels of {_by(np.abs(sizes))} (pixdim) and of {_by(placed)} ("
                     f"{'sform' if codes[0] else 'qform'}); the latter were taken")
    unit = NIFTI_UNITS.get(head.get_xyzt_units()[0], "")
    return LabelImage(_whole(path, np.asanyarray(image.dataobj).reshape(shape)), _sound(path, image.affine),
                      "RAS" if code else "", unit, {}, tuple(notes))


def _raw_sizes(path: Path, head: Any) -> np.ndarray:
    """Sides of a voxel (3,) as the head of a NIfTI gives them, which its reader mends where they are 0 or negative."""
    import nibabel

    with nibabel.openers.ImageOpener(str(path)) as file:
        return np.array(head.from_fileobj(file, check=False)["pixdim"][1:4], float)


def _by(sizes: np.ndarray) -> str:
    return " x ".join(f"{one:.3g}" for one in sizes)


def _read_nrrd(path: Path) -> LabelImage:
    import nrrd

    data = detached(path)
    if data is not None and not data.is_file():
        raise UserError(f"{path} (eye.path): its voxels are in {data.name}, which is not beside it")
    head = nrrd.read_header(str(path))
    shape, count = _refuse_shape(path, tuple(int(size) for size in head["sizes"])), int(head["dimension"])
    directions = head.get("space directions")
    directions_given = directions is not None
    if directions is None:
        spacings = np.asarray(head.get("spacings", np.full(count, np.nan)), float)
        if not np.isfinite(spacings[np.asarray(head["sizes"]) > 1]).all():
            raise UserError(f"{path} (eye.path): its head gives voxels without a size (it has neither space directions "
                            "nor spacings of all axes), export it again")
        directions = np.diag(np.nan_to_num(spacings, nan=1.0))
        notes: tuple[str, ...] = ("its head does not tell how it lies (it has no space directions), so that left and "
                                  "right may be exchanged",)
    else:
        directions, notes = np.array([np.full(3, np.nan) if one is None else one for one in directions], float), ()
    kept = [k for k in range(count) if np.isfinite(directions[k]).all()] if directions.shape[1] == 3 else range(count)
    kept = [k for k in kept if head["sizes"][k] > 1][:3]
    if len(kept) < 3:
        raise UserError(f"{path} (eye.path): its head gives directions of {len(kept)} axes, but three are needed")
    affine = np.eye(4)
    affine[:3, :3] = directions[kept][:, :3].T if directions.shape[1] == 3 else directions[np.ix_(kept, kept)].T
    affine[:3, 3] = np.nan_to_num(np.asarray(head.get("space origin", np.zeros(3)), float))[:3]
    named = str(head.get("space", "")).lower().removesuffix("-time")
    space = NRRD_SPACES.get(named, named.upper() if named.upper() in NRRD_SPACES.values() else "")
    if directions_given and not space:
        notes = ("its head does not tell how the patient lies (" + (f'its space is "{named}"' if named else
                 "it names no space") + "), so that left and right may be exchanged",)
    if space == "LAS":
        affine, space = np.diag([-1.0, 1.0, 1.0, 1.0]) @ affine, "RAS"
    units = {str(one).strip('" ').lower() for one in np.atleast_1d(head.get("space units", head.get("units", ())))}
    units -= {"", "none", "???"}
    if units and (len(units) > 1 or not units <= NRRD_UNITS.keys()):
        raise UserError(f"{path} (eye.path): its units are {', '.join(sorted(units))}, but must be one of "
                        f"{', '.join(MESH_UNITS)}, the same of all axes")
    names = {int(head[f"{key[:-5]}_LabelValue"]): str(name) for key, name in head.items()
             if re.fullmatch(r"Segment\d+_Name", key) and f"{key[:-5]}_LabelValue" in head}
    values, _ = nrrd.read(str(path))
    return LabelImage(_whole(path, values.reshape(shape)), _sound(path, affine), space,
                      NRRD_UNITS[units.pop()] if units else "", names, notes)


def _refuse_shape(path: Path, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the numbers of voxels along three axes, without axes of one voxel."""
    sides = tuple(size for size in shape if size != 1)
    if len(sides) > 3:
        raise UserError(f"{path} (eye.path): has {len(sides)} axes ({' x '.join(map(str, sides))}), but a labelled "
                        "image has three: export one time, or segments that do not overlap")
    if len(sides) < 3:
        raise UserError(f"{path} (eye.path): is one slice ({' x '.join(map(str, shape))} voxels), but an image of the "
                        "whole cavity is needed")
    if math.prod(sides) > MOST_VOXELS:
        raise UserError(f"{path} (eye.path): has {math.prod(sides):,} voxels, but at most {MOST_VOXELS:,} are read: "
                        "cut out the eye")
    return sides


def _whole(path: Path, values: np.ndarray) -> np.ndarray:
    """Values as whole numbers."""
    if values.dtype.kind in "bui":
        return values.astype(np.uint8) if values.dtype.kind == "b" else values
    if values.dtype.kind != "f" or not np.isfinite(values).all() or (np.rint(values) != values).any() \
            or np.abs(values).max(initial=0.0) > 2**31 - 1:
        raise UserError(f"{path} (eye.path): its values are not whole numbers, as those of gray images and of "
                        "probabilities are, but an image of labels is needed")
    return values.astype(np.int32)


def _sound(path: Path, affine: np.ndarray) -> np.ndarray:
    """The place of the voxels, if it can be one."""
    if not np.isfinite(affine).all() or abs(np.linalg.det(affine[:3, :3])) <= 0.0:
        raise UserError(f"{path} (eye.path): its head gives voxels without a size or a place, export it again")
    return np.array(affine, float)


def _volumes(image: LabelImage) -> dict[int, float]:
    """Volume of every label but 0, m3."""
    flat = image.labels.ravel(order="K")
    low, high = int(flat.min()), int(flat.max())
    if low >= 0 and high < 2**16:
        counts = np.zeros(high + 1, np.int64)
        for begin in range(0, len(flat), AT_ONCE):  # NumPy makes numbers of 8 bytes of what it counts
            counts += np.bincount(flat[begin:begin + AT_ONCE], minlength=high + 1)
        numbers = np.flatnonzero(counts)
        counts = counts[numbers]
    else:
        numbers, counts = np.unique(flat, return_counts=True)
    voxel = image.voxel * MESH_UNITS[image.unit] ** 3
    return {int(number): float(voxel * count) for number, count in zip(numbers, counts, strict=True) if number}


def _choice(image: LabelImage, label: int | None, found: dict[int, float]) -> str:
    """What is said where no label, or one that is not there, was chosen."""
    asked = "is missing" if label is None else f"is {label}, which is not in the image"
    if not found:
        return f"{asked}; it has no labels at all, every voxel is 0"
    largest = sorted(found, key=lambda one: -found[one])[:TOLD]
    told = ", ".join(f"{one} ({image.names[one] + ', ' if one in image.names else ''}{1e6 * found[one]:.3g} mL)"
                     for one in sorted(largest))
    more = f" and {len(found) - TOLD} smaller ones" if len(found) > TOLD else ""
    likely = [one for one in largest if SMALLEST_VOLUME <= found[one] <= LARGEST_VOLUME]
    if not likely:
        return f"{asked}; the image has {told}{more}, none of them of 2 to 12 mL as the vitreous cavity of an eye"
    best = min(likely, key=lambda one: abs(_share_of_box(image.labels == one) - BALL))
    return f"{asked}; the image has {told}{more}: {best} is probably meant, set eye.label: {best}"


def _cut_out(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The part of a mask that is not empty, and its first index (3,)."""
    spans = []
    for k in range(3):
        there = np.flatnonzero(mask.any(axis=tuple({0, 1, 2} - {k})))
        spans.append(slice(int(there[0]), int(there[-1]) + 1))
    return mask[tuple(spans)], np.array([one.start for one in spans])


def _share_of_box(mask: np.ndarray) -> float:
    return float(_cut_out(mask)[0].mean())


def _refuse_border(path: Path, image: LabelImage, mask: np.ndarray, low: np.ndarray, force: bool) -> None:
    """Raise where a label, cut out from an index (3,) on, reaches the end of the image."""
    high = low + mask.shape == image.labels.shape
    for k, end in ((k, end) for k in range(3) for end in (0, 1)):
        if not force and (high[k] if end else low[k] == 0):
            way = image.affine[:3, k] * (1 if end else -1)
            near = int(np.abs(way).argmax())
            where = f"{ENDS[image.space][near][int(way[near] > 0)]} " if image.space else ""
            raise UserError(f"{path} (eye.label): the label reaches the {where}border of the image, which may cut it "
                            "off: export it with a margin (eye.force: true takes it as it is)")


def _one_body(path: Path, image: LabelImage, label: int, mask: np.ndarray, low: np.ndarray
              ) -> tuple[np.ndarray, list[str]]:
    """The largest piece of a mask without hollows, and sentences on what was dropped and filled."""
    from scipy import ndimage

    pieces, count = ndimage.label(mask)
    said, total = [], int(mask.sum())
    if count > 1:
        sizes = np.bincount(pieces.ravel())[1:]
        largest = int(sizes.argmax()) + 1
        loose = total - int(sizes[largest - 1])
        if loose > SPECKS * total:
            factor = 1e3 * MESH_UNITS[image.unit]
            big = [one for one in np.argsort(-sizes, kind="stable") + 1 if sizes[one - 1] > SPECKS * total][:3]
            middles = factor * image.places(np.array(ndimage.center_of_mass(mask, pieces, big)) + low)
            places = "; ".join(f"{1e-3 * factor**3 * image.voxel * sizes[one - 1]:.3g} mL around "
                               f"({', '.join(f'{value:.3g}' for value in middle)}) mm"
                               for one, middle in zip(big, middles, strict=True))
            raise UserError(f"{path} (eye.label: {label}): the label has {count} separate pieces ({places}), but one "
                            "closed cavity is needed: give each eye a label of its own, or remove what is none")
        mask = pieces == largest
        said.append(f"dropped {count - 1} loose pieces with {100 * loose / total:.2g} % of the volume of the label")
    filled = ndimage.binary_fill_holes(mask)
    hollow = int(filled.sum()) - int(mask.sum())
    if hollow > HOLLOWS * total:
        raise UserError(f"{path} (eye.label: {label}): the label encloses a hollow of {100 * hollow / total:.0f} % of "
                        "its volume, like the wall of the eye: choose the label of what is in it")
    if hollow:
        said.append(f"filled hollows with {100 * hollow / total:.2g} % of the volume of the label")
    return filled, said


def _surface(image: LabelImage, mask: np.ndarray, low: np.ndarray) -> trimesh.Trimesh:
    """Smooth surface of a mask that begins at an index (3,), with the volume of its voxels, in units of the image."""
    from skimage.measure import marching_cubes

    vertices, faces, *_ = marching_cubes(np.pad(mask, 1).astype(np.float32), 0.5)
    mesh = trimesh.Trimesh(image.places(vertices - 1.0 + low), faces, process=False)
    if mesh.volume < 0.0:
        mesh.invert()
    return smoothed(mesh, image.voxel * float(mask.sum()))


def _sides(path: Path, image: LabelImage, label: int, found: dict[int, float], mask: np.ndarray, low: np.ndarray,
           side: str, force: bool) -> list[str]:
    """Sentences on the side of the patient that an eye is on, where the image tells it.

    Raises
    ------
    UserError : it is the other side than `side`, for sure.
    """
    told, why, sure = _side(image, label, found, mask, low)
    if not told or told == side:
        return []
    words = f"it is the {told} eye {why}, but eye.side is {side}"
    if sure and not force:
        raise UserError(f"{path} (eye.label: {label}): {words}: set eye.side: {told} (eye.force: true takes it as it "
                        "is)")
    return [f"{words}: set eye.side: {told} if that is right"]


def _side(image: LabelImage, label: int, found: dict[int, float], mask: np.ndarray, low: np.ndarray
          ) -> tuple[str, str, bool]:
    """Side of the patient, what tells it, and whether that is sure; "" where nothing does."""
    name = image.names.get(label, "")
    by_name = [side for side, words in SIDED.items() if re.search(words, name.replace("_", " "), re.IGNORECASE)]
    if len(by_name) == 1:
        return by_name[0], f'by the name of its label, "{name}"', True
    if not image.space:
        return "", "", False
    to_right, length = TO_RIGHT[image.space], MESH_UNITS[image.unit]

    def middle(mask, low):
        return length * image.places((np.argwhere(mask).mean(axis=0) + low)[None])[0]

    here = middle(mask, low)
    for other, volume in found.items():
        if other == label or not found[label] / ALIKE <= volume <= found[label] * ALIKE:
            continue
        arm = middle(*_cut_out(image.labels == other)) - here
        if APART[0] <= abs(arm[0]) <= APART[1] and np.abs(arm[1:]).max() <= ASKEW:
            return "left" if to_right * arm[0] > 0.0 else "right", f"beside the one with the label {other}", True
    shape = np.array(image.labels.shape)
    corners = length * image.places(np.array(np.meshgrid(*np.stack([0 * shape, shape - 1], axis=1))).reshape(3, -1).T)
    beside = here[0] - 0.5 * (corners[:, 0].min() + corners[:, 0].max())
    if np.ptp(corners[:, 0]) >= HEAD and BESIDE[0] <= abs(beside) <= BESIDE[1]:
        return "right" if to_right * beside > 0.0 else "left", "by its place in the image of a head", False
    return "", "", False
